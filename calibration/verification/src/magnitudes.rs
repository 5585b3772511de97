//! Verification without a turntable: over each static pose of a recording, the magnitude of the compensated output
//! against local gravity.
//!
//! It shows neither the direction of the output nor an error across the specific force.

use crate::gate::exercised::{DRIVEN, undriven};
use crate::occupancy::{MOST_UNTOUCHED, Occupancy};
use crate::requirement::{Judgement, Requirement, all_met, no_evidence};
use crate::stability::{LocalGravity, hole};
use crate::verdict::Estimate;
use core::fmt;
use isotherm_campaign::{StaticPose, StaticPoseError, StaticPoses, begins_ns, find_static_poses};
use isotherm_fit::{Reading, error_of_magnitude, errors_of_means, temperature_steps};
use isotherm_shared::compensate::answer;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::{CONFIDENCE, student_quantile};
use nalgebra::Vector3;

/// Static poses whose specific forces are all within this angle are of one attitude \[rad\].
const ONE_ATTITUDE: f64 = 0.1;
/// Degrees of freedom of the noise, from so many rows that the normal quantile holds.
const NOISE_FREEDOM: usize = 1000;
/// Fewest static poses that a bound is judged by.
const LEAST_STATIC_POSES: usize = 6;

/// The output over one static pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Magnitude {
    /// What the IMU indicated.
    pub reading: Reading,
    /// Mean specific force along the output axes \[g0\].
    pub force: [f64; AXES],
    /// Its magnitude less local gravity \[g0\], with the 95 % interval that the noise of the mean allows.
    pub error: Estimate,
    /// Whether temperature was outside the table's range in a row.
    pub out_of_range: bool,
}

/// What of the table the static poses show.
#[derive(Clone, Debug, PartialEq)]
pub struct TableCoverage {
    /// Share of the rows in which the specific force drives the channel, with over 0.3 g0: + and -, by axis.
    pub driven: [[f64; 2]; AXES],
    /// Names of the channels that no static pose drives, as `K+ of A2`.
    pub undriven: Vec<String>,
    /// Part of the range of head temperature that the static poses touch, for the bias of which that is least.
    pub temperature: f64,
    /// The largest hole between them, in words, if it is over a tenth of a bias's range.
    pub hole: Option<String>,
}

/// The magnitudes over all static poses of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Magnitudes {
    /// Each static pose, in order of time.
    pub poses: Vec<Magnitude>,
    /// Static poses that were left out because they are too short.
    pub too_short: usize,
    /// Static poses that were left out because the IMU turned in them.
    pub turned: usize,
    /// Static poses without a valid output in a row; they are left out.
    pub invalid: usize,
    /// Samples of another device than the table's, which were accepted.
    pub other_device: usize,
    /// What of the table the static poses show.
    pub shown: TableCoverage,
    /// Whether the table was made from this recording, as its provenance says; the caller looks.
    pub made_the_table: bool,
    /// Local gravity \[g0\].
    pub gravity: f64,
    /// Where local gravity comes from.
    pub gravity_source: LocalGravity,
    /// Mean of the errors \[g0\] with its 95 % interval from their scatter.
    pub mean: Estimate,
    /// Root mean square of the errors \[g0\].
    pub rms: f64,
}

/// Why magnitudes cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MagnitudesError {
    /// There is no usable static pose.
    #[error(transparent)]
    StaticPose(#[from] StaticPoseError),
    /// Samples are of another device than the table's.
    #[error("{0} samples are of another device than the table's; take its own table, or accept them: --other-device")]
    OtherDevice(usize),
    /// Nothing to compare with.
    #[error("local gravity is unknown, so there is nothing to compare the lengths with; state --gravity-local")]
    Gravity,
    /// No static pose has a valid output.
    #[error("no static pose has a valid output; is the temperature within the table's range?")]
    Invalid,
}

impl Magnitude {
    /// The output over a static pose; `None` if it is not valid. `errors` are those of the mean, `gravity` is in g0.
    fn of(
        table: &CoefficientTable,
        rows: (&[RawSample], &StaticPoses),
        reading: Reading,
        errors: [f64; AXES],
        gravity: f64,
    ) -> Option<Self> {
        let mut sum = Vector3::zeros();
        let (all, poses) = rows;
        for row in poses.rows(all, reading.rows.clone()) {
            sum += Vector3::from(answer(Some(table), row).velocity_increment);
        }
        let force = sum / reading.seconds / table.content().gravity;
        if !force.norm().is_finite() {
            return None;
        }
        let scale_factor = |axis: usize| {
            let at = &table.content().axes[axis].positive_scale_factor;
            at.at(at.clamp(reading.board[axis]))
        };
        let half = error_of_magnitude(&force, errors, scale_factor) * student_quantile(CONFIDENCE, NOISE_FREEDOM);
        let error = Estimate { value: force.norm() - gravity, interval: half };
        let out_of_range = is_out_of_range(table, &reading);
        Some(Self { reading, force: force.into(), error, out_of_range })
    }
}

impl TableCoverage {
    fn of(table: &CoefficientTable, poses: &[Magnitude]) -> Self {
        let forces: Vec<_> = poses.iter().map(|magnitude| magnitude.force).collect();
        let rows = |driven: &dyn Fn(&Magnitude) -> bool| -> f64 {
            poses.iter().filter(|it| driven(it)).map(|it| it.reading.rows.len() as f64).sum()
        };
        let all = rows(&|_| true);
        let share = |axis: usize| [1.0, -1.0].map(|sign| rows(&|it| sign * it.force[axis] >= DRIVEN) / all);
        let biases = table.content().axes.iter().map(|axis| axis.bias.range()).enumerate();
        let occupancy = biases.map(|(axis, range)| {
            (AXIS_NAMES[axis], Occupancy::of(range, poses.iter().map(|it| it.reading.head_range[axis])))
        });
        let occupancy: Vec<_> = occupancy.collect();
        let unit = &table.content().temperature_unit;
        let largest = occupancy.iter().min_by(|a, b| b.1.untouched().total_cmp(&a.1.untouched()));
        Self {
            driven: [0, 1, 2].map(share),
            undriven: undriven(&forces).iter().map(ToString::to_string).collect(),
            temperature: occupancy.iter().map(|(_, occupancy)| occupancy.part()).fold(1.0, f64::min),
            hole: largest
                .and_then(|(name, occupancy)| hole(occupancy, MOST_UNTOUCHED, &format!("bias of {name}"), unit)),
        }
    }
}

/// In a line: the share of each channel, and that of the temperature.
impl fmt::Display for TableCoverage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let channels = self.driven.iter().zip(AXIS_NAMES).flat_map(|([plus, minus], axis)| {
            [("+", plus), ("-", minus)].map(|(sign, share)| format!("K{sign} of {axis} {:.0} %", 100.0 * share))
        });
        let channels: Vec<_> = channels.collect();
        write!(
            f,
            "driven: {}; temperature {:.0} % of the table's range",
            channels.join(", "),
            100.0 * self.temperature
        )?;
        let undriven = Some(self.undriven.join(", ")).filter(|channels| !channels.is_empty());
        let hole = self.hole.iter().map(|hole| format!("; no static pose is in {hole}"));
        let rest = undriven.into_iter().map(|channels| format!("; not shown: {channels}")).chain(hole);
        f.write_str(&rest.collect::<String>())
    }
}

impl Magnitudes {
    /// Compares the magnitudes over the static poses of `rows`, with windows of `window_s` seconds for the
    /// search; see [`find_static_poses`].
    /// `other_device` says whether samples of another device than the table's are judged.
    ///
    /// # Errors
    /// If there are no static poses, if local gravity is unknown, or if samples are of another device.
    pub fn of(
        table: &CoefficientTable,
        rows: &[RawSample],
        window_s: Option<f64>,
        gravity_source: LocalGravity,
        other_device: bool,
    ) -> Result<Self, MagnitudesError> {
        let is_other = |row: &&RawSample| row.device != 0 && table.device() != 0 && row.device != table.device();
        let others = rows.iter().filter(is_other).count();
        if others > 0 && !other_device {
            return Err(MagnitudesError::OtherDevice(others));
        }
        let gravity = gravity_source.value().ok_or(MagnitudesError::Gravity)? / table.content().gravity;
        let found = find_static_poses(rows, window_s)?.without_turned()?;
        let (begins_ns, steps) = (begins_ns(rows), temperature_steps(rows));
        let reading = |(index, pose): (usize, &StaticPose)| {
            let start_s = begins_ns[pose.rows.start] as f64 / 1e9;
            Reading::of([index + 1, 0], rows, pose.rows.clone(), start_s, &found, &steps, false)
        };
        let readings: Vec<Reading> = found.found.iter().enumerate().map(reading).collect();
        let (noise, count) = (errors_of_means(&readings), readings.len());
        let magnitudes = readings
            .into_iter()
            .zip(noise)
            .map(|(reading, errors)| Magnitude::of(table, (rows, &found), reading, errors, gravity));
        let poses: Vec<Magnitude> = magnitudes.flatten().collect();
        if poses.is_empty() {
            return Err(MagnitudesError::Invalid);
        }
        let n = poses.len() as f64;
        let errors = || poses.iter().map(|magnitude| magnitude.error.value);
        let mean = errors().sum::<f64>() / n;
        let scatter = (errors().map(|error| (error - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let interval = match poses.len() {
            1 => f64::INFINITY,
            many => scatter / n.sqrt() * student_quantile(CONFIDENCE, many - 1),
        };
        Ok(Self {
            invalid: count - poses.len(),
            too_short: found.too_short,
            turned: found.turned,
            other_device: others,
            shown: TableCoverage::of(table, &poses),
            made_the_table: false,
            gravity,
            gravity_source,
            mean: Estimate { value: mean, interval },
            rms: (errors().map(|error| error * error).sum::<f64>() / n).sqrt(),
            poses,
        })
    }

    /// Whether the static poses have more than one attitude; otherwise the recording is a run at one attitude.
    #[must_use]
    pub fn several_attitudes(&self) -> bool {
        let forces: Vec<_> = self.poses.iter().map(|magnitude| Vector3::from(magnitude.force)).collect();
        forces.iter().any(|force| force.angle(&forces[0]) > ONE_ATTITUDE)
    }

    /// The static pose with the largest error, the upper end of its interval counted.
    #[must_use]
    pub fn largest(&self) -> &Magnitude {
        let most = |magnitude: &&Magnitude| magnitude.error.most();
        let all = self.poses.iter();
        all.max_by(|a, b| most(a).total_cmp(&most(b))).unwrap_or(&self.poses[0])
    }

    /// Judges the bounds: `scale` by the largest error of the magnitude relative to gravity. The others need an
    /// attitude.
    #[must_use]
    pub fn judge(&self, requirement: &Requirement) -> Vec<Judgement> {
        let mut found = Vec::new();
        if let Some(most) = requirement.scale {
            let error = self.largest().error.times(1.0 / self.gravity);
            let limit = format!("at most {:.3} ppm is required", most * 1e6);
            let value = format!("the length {:.3} +- {:.3} ppm", error.value * 1e6, error.interval * 1e6);
            let few = self.poses.len() < LEAST_STATIC_POSES;
            let outside = self.poses.iter().any(|magnitude| magnitude.out_of_range);
            let unshown = format!("not shown, no static pose drives {}", self.shown.undriven.join(", "));
            // Static poses are at a few temperatures, however carefully the IMU is put down.
            let hole = self.shown.hole.as_ref().map(|hole| format!("; not shown over {hole}")).unwrap_or_default();
            let met = format!("met at the temperatures of the static_poses{hole}");
            let (word, remedy) = match (error.most() <= most, error.value.abs() <= most) {
                _ if self.made_the_table => ("not judged, see below", None),
                _ if few => ("not judged, under 6 static poses", Some("put the IMU down in more attitudes")),
                _ if outside => {
                    ("not judged, temperature was outside the table's range", Some("record within the table's range"))
                }
                (true, _) if !self.shown.undriven.is_empty() => {
                    (unshown.as_str(), Some("put the IMU down with each axis up and down"))
                }
                (true, _) => (if hole.is_empty() { "met" } else { &met }, None),
                (false, true) => ("the interval reaches over it", Some("rest longer at each attitude")),
                (false, false) => ("missed", Some("calibrate again, or look at the report")),
            };
            let message = format!("scale: {value}, {limit}: {word}");
            let met = remedy.is_none() && !self.made_the_table;
            found.push(Judgement { bound: "scale", met, message, remedy });
        }
        let others = [
            ("factor", requirement.factor.is_some()),
            ("bias", requirement.bias.is_some()),
            ("level", requirement.level.is_some()),
            ("rate", requirement.rate.is_some()),
        ];
        for (bound, _) in others.into_iter().filter(|(_, given)| *given) {
            found.push(Judgement {
                bound,
                met: false,
                message: format!("{bound}: not judged, static poses in unknown attitudes show only the magnitude"),
                remedy: Some("record at one attitude, and state it"),
            });
        }
        found.extend(no_evidence(self.made_the_table));
        found
    }

    /// Checks that every bound is met.
    ///
    /// # Errors
    /// The bounds that are not, in words, a line each; then the remedies.
    pub fn check(&self, requirement: &Requirement) -> Result<(), String> {
        all_met(&self.judge(requirement))
    }
}

/// Whether temperature of a static pose is outside the table's ranges.
fn is_out_of_range(table: &CoefficientTable, reading: &Reading) -> bool {
    let beyond = |polynomial: &Polynomial, [low, high]: [f64; 2]| {
        let [from, to] = polynomial.range();
        low < from || high > to
    };
    table.content().axes.iter().enumerate().any(|(axis, coefficients)| {
        beyond(&coefficients.bias, reading.head_range[axis])
            || beyond(&coefficients.positive_scale_factor, reading.board_range[axis])
            || beyond(&coefficients.negative_scale_factor, reading.board_range[axis])
    })
}
