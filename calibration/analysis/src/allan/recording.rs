//! The noise of an IMU from a recording at rest.
//!
//! The longest stretch of rows without a long gap, a movement or another session is analysed; short gaps in it are
//! bridged. With a table the outputs are compensated by the kernel, in g0 and deg/h; without one they are net counts
//! (positive less negative) a second.

use super::curve::{Allan, MIN_ROWS};
use super::sensor::{SensorNoise, above};
use super::stretch::{BridgedRows, MOST_BRIDGED, MOST_MISSING};
use core::ops::Range;
use isotherm_campaign::StaticPoseError;
use isotherm_recording::Losses;
use isotherm_recording::foreign::LeftOutRows;
use isotherm_support::finding::{Finding, name};

/// Most part of the rows that may be left out by their stamps.
pub(super) const MOST_LEFT_OUT: f64 = 0.05;

/// The noise of an IMU.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::{NoiseAnalysis, imu_yaml};
/// use isotherm_shared::table::CoefficientTable;
/// use isotherm_simulation::{Chain, InertialMotion, Noise, SimulatedImu, Truth};
///
/// let table = CoefficientTable::from_toml(include_str!("../../../../tests/data/imu-a.toml"), None)?;
/// let (truth, noise) = (Truth::of(table), Noise { sensor_g0: 1e-3, ..Noise::NONE }); // in a mean over 1 s
/// let mut imu = SimulatedImu::new(&truth, &Chain::default(), &noise, 20.0, 1);
/// let at_rest = InertialMotion::of_force([0.6, -0.48, 0.64]);
/// let rows: Vec<_> = (0..10_000).map(|_| imu.step(&at_rest, 10_000_000)).collect();
/// let analysis = NoiseAnalysis::of(&rows, Some(&truth.table), [0.0, f64::INFINITY])?;
/// let allan = analysis.sensors[0].allan.as_ref().ok_or("the rate changes")?;
/// assert!((allan.points[0].adev / 10e-3 - 1.0).abs() < 0.1); // g0 in a row of 10 ms
/// // The same for kalibr, in SI units.
/// let yaml = imu_yaml(&analysis, 9.8015, "rest.csv").ok_or("counts have no unit")?;
/// assert!(yaml.contains("accelerometer_noise_density"), "{yaml}");
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseAnalysis {
    /// Rows of the whole recording.
    pub rows: usize,
    /// The rows that are analysed: the first, the last and those between.
    pub used: Range<usize>,
    /// The rows that are missing between them, and are bridged.
    pub bridged: BridgedRows,
    /// Rows at rest of the same session and interval, from which gaps that are too long to be bridged split others off.
    pub at_rest: usize,
    /// Begin of the first and end of the last of them, since the begin of the recording \[s\].
    pub used_s: [f64; 2],
    /// Mean time from row to row \[s\].
    pub interval_s: f64,
    /// The sensors: accelerometers, then gyroscopes where the recording, and the table if there is one, have them.
    pub sensors: Vec<SensorNoise>,
    /// Rows that are missing by their sequences, and steps of time, in the part of the recording that was asked for.
    pub losses: Losses,
    /// What is to be known of all sensors.
    pub of_recording: Vec<Finding>,
    /// Unit of the temperature, that of the table; "unit" without one.
    pub temperature_unit: String,
}

/// Why the noise cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoiseError {
    /// There is no row in the part of the recording.
    #[error("no row from {} s to {} s; the recording is {seconds:.1} s long", part[0], part[1])]
    Nothing {
        /// The part that was asked for \[s\].
        part: [f64; 2],
        /// Length of the recording \[s\].
        seconds: f64,
    },
    /// The IMU was not at rest.
    #[error(transparent)]
    StaticPose(#[from] StaticPoseError),
    /// Too many rows have stamps that cannot be right.
    #[error(
        "{} of {} rows are left out, since their stamps cannot be right: {:.2} %, over {:.0} %, so that the noise is \
         not that of the IMU; give other times, as with --time, or look for what loses the rows",
        .0.rows, .0.of, .0.share() * 100.0, MOST_LEFT_OUT * 100.0
    )]
    LeftOut(LeftOutRows),
    /// Too few rows.
    #[error(
        "the longest stretch without a gap, a movement, a new session or an output that is not a number has {} rows, {} to {}; at least {MIN_ROWS} \
         rows are needed: record longer at rest{}",
        rows.len(), rows.start + 1, rows.end,
        if *not_a_number > 0 { format!("; {not_a_number} rows have an output that is not a number: look at their temperature and the table's range") } else { String::new() }
    )]
    TooShort {
        /// The rows of the stretch.
        rows: Range<usize>,
        /// Rows with an output that is not a number.
        not_a_number: usize,
    },
}

impl NoiseAnalysis {
    /// Why no figure may be certified, as Kalibr's file does: too many rows are bridged, or long gaps leave less than
    /// half of the rows at rest. `None` if it may.
    #[must_use]
    pub fn lost(&self) -> Option<String> {
        let Self { bridged, used_s: [from_s, to_s], at_rest, .. } = self;
        let kept = bridged.of - bridged.rows;
        if bridged.is_too_much() {
            let most = MOST_BRIDGED * 100.0;
            let rows = bridged.words();
            return Some(format!(
                "{rows}, over {most} %: look for what loses them, or take a part that has fewer, with --from and --to"
            ));
        }
        (2 * kept < *at_rest).then(|| {
            format!(
                "gaps of over {MOST_MISSING} rows leave a stretch of {kept} of {at_rest} rows at rest, which shows no slow \
                 noise: look for what loses the rows, or take only this stretch, with --from {from_s:.3} --to {to_s:.3}"
            )
        })
    }

    /// What is to be said of gaps, those that are bridged and those that are not.
    pub(super) fn of_gaps(&self) -> Option<Finding> {
        let told = |message| Some(Finding::warning(name::MISSING_ROWS, message));
        match self.lost() {
            Some(lost) => told(format!("{lost}; the numbers are not certain, and no file for Kalibr is written")),
            None if self.bridged.rows > 0 => {
                told(format!("{}; they are bridged, as rows around them scatter and correlate", self.bridged.words()))
            }
            None => None,
        }
    }

    /// The same of a recording that has so many rows more before these, over this time \[s\].
    #[must_use]
    pub fn behind(mut self, (rows, seconds): (u64, f64)) -> Self {
        let more = usize::try_from(rows).unwrap_or(usize::MAX);
        self.rows = self.rows.saturating_add(more);
        self.used = self.used.start.saturating_add(more)..self.used.end.saturating_add(more);
        self.used_s = self.used_s.map(|end| end + seconds);
        self
    }

    /// All findings: those of the recording, then those of each sensor.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        self.of_recording.iter().cloned().chain(self.sensors.iter().flat_map(SensorNoise::findings)).collect()
    }
}

/// That values of a triad repeat.
pub(super) fn repeated(triad: &[SensorNoise], interval_s: f64) -> Option<Finding> {
    let repeat: Vec<_> = triad.iter().filter_map(|sensor| Some((sensor, sensor.new_every_s?))).collect();
    let (_, new_every_s) = repeat.first()?;
    let names: Vec<_> = repeat.iter().map(|(sensor, _)| sensor.name).collect();
    let curves = repeat.iter().filter_map(|(sensor, _)| sensor.allan.as_ref());
    let from_s = curves.map(Allan::holds_from_s).reduce(|a, b| Some(a?.max(b?))).flatten();
    let message = format!(
        "{}: values repeat, {:.1} new ones a second in {:.1} rows a second; {}; record each value once",
        names.join(", "),
        1.0 / new_every_s,
        1.0 / interval_s,
        above(from_s)
    );
    Some(Finding::warning(name::REPEATED, message))
}
