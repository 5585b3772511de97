//! Counters that wrap within a row: a channel that counts more in short rows than in long ones.

use crate::gyroscopes::Measurements;
use isotherm_campaign::Dwell;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};

/// Rows that are longer by this factor are of another length.
const LONGER: f64 = 1.5;
/// The largest rate of a channel in rows of one length is not larger by this factor than in others: scale factors
/// change less with temperature.
const MORE: f64 = 1.25;
/// A channel below this counts nothing that matters \[pulse/s\].
const LEAST: f64 = 1000.0;

/// The fault of a campaign whose rows have different lengths, as those of dwells and of turns have.
pub(crate) fn wraps(measurements: &Measurements) -> Option<Finding> {
    let turns = &measurements.gyroscopes.turns;
    let accelerometers: Vec<&Dwell> =
        measurements.dwells.iter().chain(turns.iter().map(|turn| &turn.accelerometers)).collect();
    let gyroscopes: Vec<&Dwell> = measurements.gyroscopes.dwells.iter().collect();
    let triads = [(AXIS_NAMES, accelerometers), (GYROSCOPE_NAMES, gyroscopes)];
    let channels = triads.iter().flat_map(|(names, runs)| {
        (0..AXES).flat_map(move |axis| (0..2).filter_map(move |channel| of_channel(names[axis], runs, axis, channel)))
    });
    let found: Vec<(String, u64, String)> = channels.collect();
    let (_, line, words) = found.first()?;
    let all: Vec<_> = found.iter().map(|(channel, ..)| channel.as_str()).collect();
    let message = format!(
        "the counters of {} wrap within a row: {words}; record short rows throughout, or read the counters more often",
        all.join(", ")
    );
    Some(Finding { line: Some(*line), ..Finding::fault(name::COUNTER_WRAPS, message) })
}

/// Mean length of a run's rows \[s\].
fn row_s(run: &Dwell) -> f64 {
    run.sums.seconds / run.rows as f64
}

/// A channel that wraps: its name, the line of the longer rows, and the two rates in words.
fn of_channel(sensor: &str, runs: &[&Dwell], axis: usize, channel: usize) -> Option<(String, u64, String)> {
    let rate = |run: &Dwell| run.sums.rates(axis)[channel];
    let fastest = runs.iter().max_by(|a, b| rate(a).total_cmp(&rate(b)))?;
    let longer = runs.iter().filter(|run| row_s(run) > LONGER * row_s(fastest));
    let other = longer.max_by(|a, b| rate(a).total_cmp(&rate(b)))?;
    (rate(fastest) > LEAST && rate(fastest) > MORE * rate(other)).then(|| {
        let name = format!("{sensor}{}", ["+", "-"][channel]);
        let words = format!(
            "{name} counts {:.0} pulse/s in rows of {:.3} s, and at most {:.0} in rows of {:.3} s",
            rate(fastest),
            row_s(fastest),
            rate(other),
            row_s(other)
        );
        (name, other.lines[0], words)
    })
}
