//! Rows of a campaign to dwells, and samples that cannot be right.

use crate::dwell::Dwell;
use crate::model::Campaign;
use isotherm_recording::{CampaignRow, Continuity, RecordingError};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::{MAX_INTERVAL_NS, RawSample};

/// Makes dwells of the samples of `campaign`. The rows come from a
/// [`CampaignCsvReader`](isotherm_recording::CampaignCsvReader) or another source.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_campaign::{Campaign, read_dwells};
/// use isotherm_recording::CampaignCsvReader;
///
/// let campaign = Campaign::from_toml(include_str!("../../../examples/campaign/campaign.toml"))?;
/// let samples: &[u8] = include_bytes!("../../../examples/campaign/samples.csv");
/// let dwells = read_dwells(&campaign, CampaignCsvReader::new(samples)?)?;
/// assert_eq!(dwells.len(), 15 * 12); // 15 set points, 12 positions
/// assert_eq!((dwells[0].set_point_c, dwells[0].sums.seconds), (-25.0, 300.0));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// At the first row that cannot be read or used, with its line: an unknown position, a timestamp that does not
/// increase, an interval out of range, temperature that is not finite, a full counter. At the row where
/// [`Overlap`](isotherm_recording::Overlap) shows.
pub fn read_dwells(
    campaign: &Campaign,
    rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
) -> Result<Vec<Dwell>, RecordingError> {
    let mut dwells: Vec<Dwell> = Vec::new();
    let mut previous: Option<CampaignRow> = None;
    let mut open = false;
    let mut continuity = Continuity::default();
    for row in rows {
        let row = row?;
        let fault = |message: String| {
            let place = match row.position {
                Some(number) => format!("set point {} degC, position {number}: ", row.set_point_c),
                None => format!("set point {} degC: ", row.set_point_c),
            };
            Err(RecordingError::Data { line: row.line, message: place + &message })
        };
        let sample = &row.sample;
        if let Some(wrong) = implausible(sample, previous.as_ref().map(|row| row.sample.timestamp_ns)) {
            return fault(wrong);
        }
        continuity.add(sample);
        if let Some(overlap) = continuity.overlap_so_far() {
            return fault(overlap.to_string());
        }
        let same = |last: &CampaignRow| (last.set_point_c, last.position) == (row.set_point_c, row.position);
        open &= previous.as_ref().is_some_and(same);
        previous = Some(row);
        let Some(number) = row.position else { continue };
        // The rows of a turn are those of the gyroscopes.
        if campaign.turns.iter().any(|turn| turn.start.number == number) {
            continue;
        }
        if !open {
            let Some(position) = campaign.positions.iter().position(|position| position.number == number) else {
                let known: Vec<_> = campaign.positions.iter().map(|position| position.number.to_string()).collect();
                return fault(format!("no such position; the campaign file lists {}", known.join(", ")));
            };
            dwells.push(Dwell::new(&row, position));
            open = true;
        }
        if let Some(dwell) = dwells.last_mut() {
            dwell.add(&row);
        }
    }
    match (continuity.overlap(), previous) {
        (Some(overlap), Some(row)) => Err(RecordingError::Data { line: row.line, message: overlap.to_string() }),
        _ => Ok(dwells),
    }
}

/// The reason why a raw sample of a campaign cannot be used; `None` if it can. `previous_ns` is the timestamp of the
/// previous sample. The automatic campaign leaves such samples out, `calibrate` refuses them.
#[must_use]
pub fn implausible(sample: &RawSample, previous_ns: Option<u64>) -> Option<String> {
    implausible_time(sample, previous_ns).or_else(|| implausible_values(sample))
}

/// The same, only by interval and time: the values of the sample are not looked at.
#[must_use]
pub fn implausible_time(sample: &RawSample, previous_ns: Option<u64>) -> Option<String> {
    let RawSample { interval_ns, .. } = *sample;
    if interval_ns == 0 || interval_ns > MAX_INTERVAL_NS {
        return Some(format!("interval_ns is {interval_ns}, give 1 to {MAX_INTERVAL_NS}"));
    }
    previous_ns.and_then(|previous_ns| implausible_step(sample, previous_ns))
}

/// The same, by the time since the previous sample.
fn implausible_step(sample: &RawSample, previous_ns: u64) -> Option<String> {
    let RawSample { timestamp_ns, .. } = *sample;
    let cause = if timestamp_ns == previous_ns { "; is the row there twice?" } else { "" };
    let message = || format!("timestamp_ns {timestamp_ns} after {previous_ns}; time must rise from row to row{cause}");
    (timestamp_ns <= previous_ns).then(message)
}

/// The same, by temperature and counters.
fn implausible_values(sample: &RawSample) -> Option<String> {
    for (axis, accelerometer) in AXIS_NAMES.iter().enumerate() {
        for (temperature, name) in [
            (sample.accelerometers.head_temperature[axis], "head"),
            (sample.accelerometers.board_temperature[axis], "board"),
        ] {
            if !temperature.is_finite() {
                return Some(format!("a{}_{name} is {temperature}, which is not a temperature", axis + 1));
            }
        }
        if sample.accelerometers.positive_pulses[axis] == u32::MAX
            || sample.accelerometers.negative_pulses[axis] == u32::MAX
        {
            return Some(format!("the counter of {accelerometer} is full: saturated"));
        }
    }
    None
}
