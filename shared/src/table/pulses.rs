//! What one pulse stands for by a table, and whether the pulses of a source are such pulses.

use super::content::Axis;
use super::model::CoefficientTable;
use crate::nominal::comparable;
use crate::units::{ARCSEC, SensorKind};
use crate::wire::AXES;

/// What one pulse of a source stands for may be so much of what it stands for by the table: no calibration of working
/// sensors changes a scale factor by a quarter, and another interval or resolution changes it by more.
const ALIKE: core::ops::RangeInclusive<f64> = 0.8..=1.25;

/// The nominal interval of a table, and what one pulse stands for by its scale factors: g0 / K+ of an accelerometer and
/// 1 arcsec / K+ of a gyroscope, each K+ in the middle of its range.
///
/// A source of readings makes pulses of this interval, whatever its own one is. So its increments are right at any
/// rate: see [`Readings`](crate::readings::Readings).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PulseScale {
    /// The nominal interval \[ns\]; 0 if the table has none.
    pub nominal_ns: u64,
    /// One pulse of A1 to A3 \[m/s\].
    pub velocity: [f64; AXES],
    /// One pulse of G1 to G3 \[rad\]; `None` without gyroscopes.
    pub angle: Option<[f64; AXES]>,
}

impl PulseScale {
    /// That of a table.
    #[must_use]
    pub fn of(table: &CoefficientTable) -> Self {
        let content = table.content();
        let pulse = |axis: &Axis, one: f64| {
            let [low, high] = axis.positive_scale_factor.range();
            one / axis.positive_scale_factor.at(low + (high - low) / 2.0)
        };
        Self {
            nominal_ns: table.nominal_ns(),
            velocity: content.axes.each_ref().map(|axis| pulse(axis, content.gravity)),
            angle: content.gyroscopes.as_ref().map(|of| of.axes.each_ref().map(|axis| pulse(axis, ARCSEC))),
        }
    }

    /// Whether one pulse of a source, \[m/s\] of its accelerometers and \[rad\] of its gyroscopes, is one of the table:
    /// the ratio is from 0.8 to 1.25. What is `None`, or not in the table, is not compared.
    ///
    /// # Errors
    /// [`PulseMismatch::Weight`].
    pub fn check(&self, source: [Option<f64>; 2]) -> Result<(), PulseMismatch> {
        let all = [
            (SensorKind::Accelerometer, source[0], Some(self.velocity), "m/s"),
            (SensorKind::Gyroscope, source[1], self.angle, "rad"),
        ];
        for (kind, source, table, unit) in all {
            let Some((source, table)) = source.zip(table) else { continue };
            let compared = kind.names().into_iter().zip(table);
            if let Some((sensor, table)) = compared.into_iter().find(|(_, table)| !ALIKE.contains(&(source / table))) {
                return Err(PulseMismatch::Weight { sensor, own: source, table, unit });
            }
        }
        Ok(())
    }

    /// Whether counts of this interval \[ns\] are counts of the table: it has no nominal interval, or that one within
    /// 1 %. Counts of a fixed scale have scale factors for one interval only.
    ///
    /// # Errors
    /// [`PulseMismatch::Interval`].
    pub fn check_counts(&self, interval_ns: u64) -> Result<(), PulseMismatch> {
        let [own_s, table_s] = [interval_ns, self.nominal_ns].map(|ns| ns as f64 / 1e9);
        if self.nominal_ns == 0 || comparable(Some(table_s), Some(own_s)) {
            return Ok(());
        }
        Err(PulseMismatch::Interval { own_s, table_s })
    }
}

/// Why the pulses of a source are not those of a table.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PulseMismatch {
    /// A pulse stands for something else.
    #[error(
        "{sensor}: one pulse of the source is {own:.4e} {unit}, and by the scale factor of the table it is \
         {table:.4e} {unit}, {:.3} of it; give the resolution that the table was made with, or the table of this source",
        own / table
    )]
    Weight {
        /// A1 to G3.
        sensor: &'static str,
        /// One pulse of the source \[m/s or rad\].
        own: f64,
        /// One pulse by the table \[m/s or rad\].
        table: f64,
        /// m/s or rad.
        unit: &'static str,
    },
    /// Counts are of another interval than the table.
    #[error(
        "the counts are of an interval of {own_s} s, and the scale factors of the table are of {table_s} s \
         (nominal_interval_s); they hold for one interval: give the table of this interval, or set the device to that \
         one"
    )]
    Interval {
        /// The interval of the source \[s\].
        own_s: f64,
        /// The nominal interval of the table \[s\].
        table_s: f64,
    },
    /// The table has no nominal interval, so it is none of readings.
    #[error(
        "the table has no nominal interval (imu.nominal_interval_s), so it is one of counts; give a table of readings, \
         as `isotherm convert --nominal` makes it"
    )]
    NoNominal,
}
