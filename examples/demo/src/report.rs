//! The report of the demonstration.

use crate::acquisition::{MeanStability, RunOutcome};
use crate::{imu, lost};
use isotherm_shared::status::ServiceStatus;
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use std::fmt::{Display, Formatter, Result};
use std::time::Duration;

/// What the report is about.
pub(crate) struct Report<'a> {
    pub outcome: &'a RunOutcome,
    pub status: &'a ServiceStatus,
    /// The frozen table, and the true one.
    pub tables: [&'a CoefficientTable; 2],
    pub elapsed: Duration,
}

impl Display for Report<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(f, "Isotherm {}: {}.", self.status.version, imu::DESCRIPTION)?;
        self.stability(f)?;
        self.reload(f)?;
        self.latency(f)?;
        writeln!(f, "\nDone in {:.1} s.", self.elapsed.as_secs_f64())
    }
}

impl Report<'_> {
    fn stability(&self, f: &mut Formatter<'_>) -> Result {
        let RunOutcome { before, after, .. } = self.outcome;
        writeln!(f, "\nOutput stability: 10 s means of output minus specific force [1e-6 g0]")?;
        triad(f, &AXIS_NAMES, [&before.accelerometers, &after.accelerometers], (1e6, 2))?;
        writeln!(f, "\nOutput stability: 100 s means of output minus Earth's rate [deg/h]")?;
        triad(f, &GYROSCOPE_NAMES, [&before.gyroscopes, &after.gyroscopes], (1.0, 3))?;
        writeln!(
            f,
            "  ({} and {} means of 10 s. This IMU follows its table except for the noise; a real one keeps what no",
            before.accelerometers[0].means, after.accelerometers[0].means
        )?;
        writeln!(f, "  polynomial knows: the source paper reports factors of 10 to 16 for accelerometers.)")
    }

    fn reload(&self, f: &mut Formatter<'_>) -> Result {
        let RunOutcome { reload_ns, during_reload, sent, out_of_order, .. } = self.outcome;
        let reloads = self.status.imus.first().map_or(0, |imu| imu.reloads);
        let [frozen, truth] = self.tables.map(CoefficientTable::id);
        writeln!(f, "\nHot reload in flight: {reloads} reload, table {frozen:016x} -> {truth:016x}")?;
        let reload_ms = *reload_ns as f64 / 1e6;
        writeln!(
            f,
            "  {reload_ms:.2} ms from asking to the first increment under the new table, {during_reload} increments meanwhile,"
        )?;
        let lost = lost(self.outcome, self.status);
        writeln!(f, "  {sent} samples in all, {lost} lost, {out_of_order} out of order")
    }

    fn latency(&self, f: &mut Formatter<'_>) -> Result {
        let trips = &self.outcome.round_trips_ns;
        let percentile = |part: f64| {
            let rank = ((trips.len() as f64 * part).ceil() as usize).clamp(1, trips.len().max(1));
            u64::from(trips.get(rank - 1).copied().unwrap_or_default())
        };
        writeln!(
            f,
            "\nLatency, one sample in flight, as fast as answered [us]        p50       p99     p99.9       max"
        )?;
        let round_trip = [0.5, 0.99, 0.999, 1.0].map(percentile);
        let inside = self.status.imus.first().and_then(|imu| imu.latency_ns);
        let inside = inside.map(|latency| [latency.p50, latency.p99, latency.p999, latency.max]);
        for (name, figures) in [
            ("round trip, seen by the acquisition", Some(round_trip)),
            ("from sending to just before publishing", inside),
        ] {
            if let Some(figures) = figures {
                let [p50, p99, p999, max] = figures.map(|ns| ns as f64 / 1e3);
                writeln!(f, "  {name:<55} {p50:>9.2} {p99:>9.2} {p999:>9.2} {max:>9.2}")?;
            }
        }
        writeln!(f, "  (this machine, as it is; `cargo run --profile dist -p isotherm-benches --bin latency` compares)")
    }
}

/// The stability of a triad before and after, a line for each sensor, in a unit of which `unit` are one of the
/// statistics, with this number of digits.
fn triad(
    f: &mut Formatter<'_>,
    names: &[&str; AXES],
    [before, after]: [&[MeanStability; AXES]; 2],
    (unit, digits): (f64, usize),
) -> Result {
    writeln!(f, "        table frozen at mid temperature      full model")?;
    writeln!(
        f,
        "        std. deviation   rms about zero      std. deviation   rms about zero      factor (std. dev.)"
    )?;
    for (name, (before, after)) in names.iter().zip(before.iter().zip(after)) {
        write!(f, "  {name} ")?;
        for MeanStability { deviation, rms, .. } in [before, after] {
            write!(f, "   {:>14.digits$}   {:>14.digits$}   ", deviation * unit, rms * unit)?;
        }
        writeln!(f, "   {:>6.1}", before.deviation / after.deviation)?;
    }
    Ok(())
}
