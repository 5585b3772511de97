//! The plain difference of two tables: how much each curve and each alignment changes. `compare` builds its bands on
//! it; the service refuses a table that changes too much, by limits that may follow from the errors of the old one.
//!
//! Curves are compared at 41 points of their common range, in units that no table's 1 g0 changes. What a scale factor
//! changes is relative to its old value, the difference of two biases is in ug0 of 9.80665e-6 m/s2, of two rates in
//! deg/h.
//!
//! The first calibration after a nominal table is compared with less. The constants of a nominal table hold at any
//! temperature, so that the range of the calibration counts, and what the table says of its own range does not. Its
//! scale factors are compared as what a pulse stands for, whatever its interval is ([`scale_multipliers`]).

use super::content::{AXIS_NAMES, Axis, Content, GYROSCOPE_NAMES, Gyroscopes, OutOfRange};
pub use super::curves::{POINTS, QUANTITIES, STANDARD_GRAVITY, UnitCurve, common_range, points, unit, unit_factor};
use super::model::CoefficientTable;
use super::stated::StatedLimits;
use crate::bounds::{self, Bound};
use crate::nominal::comparable;
use crate::polynomial::Polynomial;
use crate::units::SensorKind;
use crate::wire::AXES;
use core::fmt;
use nalgebra::Matrix3;

/// Alignment matrices that turn the axes by less do not differ \[mrad\]: two fits of one mounting differ by some 1e-3.
const SAME_AXES_MRAD: f64 = 0.01;

/// The difference of one curve in two tables: new less old.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveDifference {
    /// A1 to G3.
    pub sensor: &'static str,
    /// `bias`, `positive_scale_factor` or `negative_scale_factor`.
    pub quantity: &'static str,
    /// Unit of the difference: ug0 of 9.80665e-6 m/s2, deg/h, or ppm of the old scale factor.
    pub unit: &'static str,
    /// The common range of the temperature.
    pub range: [f64; 2],
    /// Temperature of the points, rising evenly over the range.
    pub temperature: Vec<f64>,
    /// Difference at each point.
    pub differences: Vec<f64>,
}

impl CurveDifference {
    /// The difference of a quantity of a sensor over a range that both curves have.
    #[must_use]
    pub fn of(
        (kind, axis, quantity): (SensorKind, usize, usize),
        [old, new]: [&UnitCurve; 2],
        range: [f64; 2],
    ) -> Self {
        let temperature = points(range);
        let difference = |u: &f64| (new.at(*u) - old.at(*u)) * unit_factor(kind, quantity, old.at(*u));
        Self {
            sensor: kind.names()[axis],
            quantity: QUANTITIES[quantity],
            unit: unit(kind, quantity),
            range,
            differences: temperature.iter().map(difference).collect(),
            temperature,
        }
    }

    /// Sensor and quantity, as `A1 bias`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{} {}", self.sensor, self.quantity)
    }

    /// Size of the largest difference, and its temperature.
    #[must_use]
    pub fn largest(&self) -> (f64, f64) {
        let sizes = self.differences.iter().map(|difference| difference.abs()).zip(self.temperature.iter().copied());
        // The first of several.
        sizes.rev().max_by(|(a, _), (b, _)| a.total_cmp(b)).unwrap_or((f64::NAN, f64::NAN))
    }
}

/// What a change is limited by.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Limit {
    /// Bias of an accelerometer, and its transient times the range.
    Bias,
    /// K+ and K-.
    Scale,
    /// Bias of a gyroscope, its transient times the range, and its g-sensitivity at 1 g0.
    Rate,
    /// An entry of an alignment matrix.
    Alignment,
}

impl Limit {
    /// Its name in a service configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.bound().name
    }

    /// How its value is written.
    #[must_use]
    pub const fn bound(self) -> Bound {
        match self {
            Self::Bias => bounds::BIAS,
            Self::Scale => bounds::SCALE,
            Self::Rate => bounds::RATE,
            Self::Alignment => bounds::ALIGNMENT,
        }
    }
}

/// The largest change of one curve, transient, g-sensitivity or alignment.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Sensor and quantity, as `A1 bias`; or `alignment`, `gyroscope_alignment`.
    pub name: String,
    /// Which limit it has.
    pub limit: Limit,
    /// Its size, in `unit`.
    pub size: f64,
    /// ug0, ppm, deg/h or mrad.
    pub unit: &'static str,
    /// Where, and both values, in words.
    pub values: String,
    /// The largest size that follows from what the old table states of its errors and ranges, in `unit`.
    pub stated: Option<f64>,
}

/// The largest changes that are taken. A limit that is not given follows from what the old table states, and is
/// [`MaxChange::WIDEST`] at most, or [`MaxChange::WIDEST_OF_FIRST`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaxChange {
    /// \[g0\]
    pub bias: Option<f64>,
    /// Relative.
    pub scale: Option<f64>,
    /// \[deg/h\]
    pub rate: Option<f64>,
    /// \[rad\]
    pub alignment: Option<f64>,
}

impl MaxChange {
    /// 100 mg0, 10 %, 1 deg/s, 100 mrad: more than any calibration of any IMU changes.
    pub const WIDEST: Self = Self { bias: Some(0.1), scale: Some(0.1), rate: Some(3600.0), alignment: Some(0.1) };
    /// For the first calibration after a nominal table, which shows the whole zero-rate offset of the gyroscopes: that
    /// of a consumer MEMS is several deg/s. 10 deg/s is the most that a table may have.
    pub const WIDEST_OF_FIRST: Self = Self { rate: Some(36_000.0), ..Self::WIDEST };

    /// A limit in its own unit, if it is given.
    const fn given(&self, limit: Limit) -> Option<f64> {
        match limit {
            Limit::Bias => self.bias,
            Limit::Scale => self.scale,
            Limit::Rate => self.rate,
            Limit::Alignment => self.alignment,
        }
    }

    /// The largest size of a change, in its unit, and what is said of it.
    fn of(&self, change: &Change, factor: f64, widest: &Self) -> (f64, String) {
        let (to_unit, shown, shown_unit) = match change.limit {
            Limit::Bias => (1e6, 1e3, "mg0"),
            Limit::Scale => (1e6, 1e2, "%"),
            Limit::Rate => (1.0, 1.0, "deg/h"),
            Limit::Alignment => (1e3, 1e3, "mrad"),
        };
        let (key, unit) = (change.limit.name(), change.unit);
        let given = self.given(change.limit);
        // Each limit has a widest value.
        let most = given.or(widest.given(change.limit)).unwrap_or(0.0);
        match change.stated.filter(|stated| given.is_none() && *stated < most * to_unit) {
            Some(stated) => {
                let stated = stated * factor;
                let words = format!(
                    "at most {} {unit} is taken, by the errors and ranges that the table before states, unless max_change.{key} is set",
                    rounded(stated)
                );
                (stated, words)
            }
            None => {
                let words =
                    format!("at most {} {shown_unit} is taken (max_change.{key})", rounded(most * factor * shown));
                (most * factor * to_unit, words)
            }
        }
    }

    /// Why a table that differs so from the one before is refused; empty if it is taken. The limits count `factor`
    /// times.
    #[must_use]
    pub fn refusals(&self, difference: &TableDifference, factor: f64) -> Vec<String> {
        let widest = if difference.is_first { Self::WIDEST_OF_FIRST } else { Self::WIDEST };
        let beyond = difference.changes.iter().filter_map(|change| {
            let (most, words) = self.of(change, factor, &widest);
            // NaN is beyond.
            let within = change.size <= most;
            let Change { name, size, unit, values, .. } = change;
            (!within).then(|| format!("{name} changes by {} {unit}, {values}; {words}", rounded(*size)))
        });
        difference.incomparable.iter().cloned().chain(beyond).collect()
    }
}

/// What the scale factors of two tables of one IMU are multiplied with before they are compared: usually 1. `None` if
/// they cannot be compared, because they are of different nominal intervals.
///
/// The first calibration after a nominal table may be of another interval T than that table, because each follows from
/// what made its pulses. Then K T is compared, which is 1 g0 or 1 arcsec/s over what a pulse stands for. If a table has
/// no nominal interval, a pulse is a count of the device, and K itself is compared.
#[must_use]
pub fn scale_multipliers(old: &CoefficientTable, new: &CoefficientTable) -> Option<[f64; 2]> {
    match [old, new].map(|table| table.content().nominal_interval_s) {
        [Some(from), Some(to)] if new.is_first_calibration_after(old) => Some([from, to]),
        [from, to] => comparable(from, to).then_some([1.0; 2]),
    }
}

/// By what two tables are compared.
struct Terms<'t> {
    /// What the old table states about the limits.
    stated: StatedLimits<'t>,
    /// Whether the new table is the first calibration after a nominal table.
    is_first: bool,
    /// Of the scale factors, see [`scale_multipliers`].
    multipliers: [f64; 2],
}

/// What changes from one table to another.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TableDifference {
    /// The largest change of everything that both tables have.
    pub changes: Vec<Change>,
    /// What cannot be compared, whatever its size: another unit of the temperature, scale factors of another interval,
    /// too little of a range in common, gyroscopes that only one table has, no calibration
    /// ([`CoefficientTable::is_nominal`]) after one, a policy that begins or ends to reject, another serial number with
    /// other curves, a table without a digest after one that had it. After a nominal table the interval, the range, the
    /// policy and a serial number that only the calibration has are not among them.
    pub incomparable: Vec<String>,
    /// All else that changes, in words.
    pub others: Vec<String>,
    /// Whether the new table is the first calibration after a nominal table.
    pub is_first: bool,
}

/// `A1 bias changes by 12.3 ug0, A1 positive_scale_factor by 45.6 ppm, ..; besides: lag none -> 240`
impl fmt::Display for TableDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let changed = self.changes.iter().filter(|change| change.size != 0.0).enumerate();
        let changed = changed.map(|(index, change)| {
            let Change { name, size, unit, .. } = change;
            format!("{name}{} by {} {unit}", if index == 0 { " changes" } else { "" }, rounded(*size))
        });
        let changed: Vec<_> = changed.chain(self.incomparable.iter().cloned()).collect();
        f.write_str(&if changed.is_empty() { "no curve changes".to_owned() } else { changed.join(", ") })?;
        if self.others.is_empty() { Ok(()) } else { write!(f, "; in addition: {}", self.others.join(", ")) }
    }
}

impl TableDifference {
    /// From `old` to `new`.
    #[must_use]
    pub fn of(old: &CoefficientTable, new: &CoefficientTable) -> Self {
        let is_first = new.is_first_calibration_after(old);
        let loses_kind = new.is_nominal() && !old.is_nominal();
        let loses_seal = old.is_sealed() && !new.is_sealed();
        let multipliers = scale_multipliers(old, new);
        let stated = StatedLimits::of(old, new);
        let (old, new) = (old.content(), new.content());
        let mut found = Self { others: others(old, new), is_first, ..Self::default() };
        if is_first {
            found.others.insert(0, "this is the first calibration after a nominal table".to_owned());
        }
        if old.imu != new.imu {
            found.incomparable.push(format!("imu.id: the table before is of {}, this one of {}", old.imu, new.imu));
            return found;
        }
        if old.temperature_unit != new.temperature_unit {
            let (from, to) = (&old.temperature_unit, &new.temperature_unit);
            found.incomparable.push(format!("temperature.unit: the temperature was in {from:?}, now it is in {to:?}"));
            return found;
        }
        let Some(multipliers) = multipliers else {
            let [from, to] = [old, new].map(|content| content.nominal_interval_s.unwrap_or_default());
            let text = format!("imu.nominal_interval_s: the scale factors were of {from} s, now they are of {to} s");
            found.incomparable.push(text);
            return found;
        };
        if loses_kind {
            let text = "the table before is a calibration and this one is no calibration: it has constant curves and no [provenance]";
            found.incomparable.push(text.to_owned());
            return found;
        }
        found.compare(old, new, &Terms { stated, is_first, multipliers });
        if !is_first {
            found.policy([old.out_of_range, new.out_of_range]);
        }
        // A nominal table need not say which unit it is for.
        if !is_first || old.serial.is_some() {
            found.serial([&old.serial, &new.serial]);
        }
        if loses_seal {
            let text = "digest: the table before is sealed and this one is not, so it may be a part of a file; seal it with `check --seal`";
            found.incomparable.push(text.to_owned());
        }
        found
    }

    /// What an operator should know of the change, in five lines at most: the largest change of each kind, and what
    /// else changes.
    #[must_use]
    pub fn summary(&self) -> Vec<String> {
        let kinds = [Limit::Bias, Limit::Scale, Limit::Rate, Limit::Alignment];
        let of_kind =
            |limit: Limit| self.changes.iter().filter(move |change| change.limit == limit && change.size != 0.0);
        let largest =
            kinds.iter().filter_map(|limit| of_kind(*limit).max_by(|one, other| one.size.total_cmp(&other.size)));
        let mut lines: Vec<_> = largest
            .map(|change| {
                let Change { name, size, unit, values, .. } = change;
                let turns = name == "alignment" && *size > SAME_AXES_MRAD;
                let remedy = if turns { "; the axes turn: boresight the vehicle again" } else { "" };
                format!("{name} changes by {} {unit}, {values}{remedy}", rounded(*size))
            })
            .collect();
        if !self.changes_a_curve() {
            lines.push("no curve changes".to_owned());
        }
        let others: Vec<_> = self.incomparable.iter().chain(&self.others).map(String::as_str).collect();
        lines.extend(Some(others.join("; ")).filter(|others| !others.is_empty()));
        lines
    }

    /// Compares all curves and alignments that both tables have.
    fn compare(&mut self, old: &Content, new: &Content, terms: &Terms<'_>) {
        self.sensors(SensorKind::Accelerometer, [(&old.axes, old.gravity), (&new.axes, new.gravity)], terms);
        self.matrix(SensorKind::Accelerometer, [old.alignment, new.alignment], &terms.stated);
        let incomparable = match (&old.gyroscopes, &new.gyroscopes) {
            (Some(from), Some(to)) => return self.gyroscopes([(from, old.gravity), (to, new.gravity)], terms),
            (Some(_), None) => "the table before has gyroscopes, and this one has none",
            (None, Some(_)) => "this table has gyroscopes, and the one before has none",
            (None, None) => return,
        };
        self.incomparable.push(incomparable.to_owned());
    }

    fn gyroscopes(&mut self, [(from, old_gravity), (to, new_gravity)]: [(&Gyroscopes, f64); 2], terms: &Terms<'_>) {
        self.sensors(SensorKind::Gyroscope, [(&from.axes, old_gravity), (&to.axes, new_gravity)], terms);
        for (axis, pair) in from.g_sensitivity.iter().zip(&to.g_sensitivity).enumerate() {
            self.g_sensitivity(axis, [pair.0.unwrap_or_default(), pair.1.unwrap_or_default()], &terms.stated);
        }
        self.matrix(SensorKind::Gyroscope, [from.alignment, to.alignment], &terms.stated);
    }

    /// A policy that begins or ends to reject decides whether there are increments at all.
    fn policy(&mut self, policies: [OutOfRange; 2]) {
        if policies[0] != policies[1] && policies.contains(&OutOfRange::Reject) {
            let [from, to] = policies.map(OutOfRange::name);
            self.incomparable.push(format!("temperature.out_of_range: it was {from:?}, now it is {to:?}"));
        }
    }

    /// Another serial number with the same curves is a correction. With other curves it is another unit.
    fn serial(&mut self, [old, new]: [&Option<String>; 2]) {
        if new.is_some() && old != new && self.changes_a_curve() {
            let [from, to] = [old, new].map(|serial| serial.as_deref().unwrap_or("none"));
            self.incomparable.push(format!("imu.serial: it was {from:?}, now it is {to:?}, and the curves change too"));
        }
    }

    /// Whether any curve or alignment differs, or something cannot be compared.
    #[must_use]
    pub fn changes_a_curve(&self) -> bool {
        // NaN is a change.
        !self.incomparable.is_empty() || !self.changes.iter().all(|change| change.size == 0.0)
    }

    fn sensors(
        &mut self,
        kind: SensorKind,
        [(old, old_gravity), (new, new_gravity)]: [(&[Axis; AXES], f64); 2],
        terms: &Terms<'_>,
    ) {
        for (axis, (from, to)) in old.iter().zip(new).enumerate() {
            let curves = [UnitCurve::of_sensor(kind, from, old_gravity), UnitCurve::of_sensor(kind, to, new_gravity)];
            for (quantity, (from, to)) in curves[0].iter().zip(&curves[1]).enumerate() {
                self.curve((kind, axis, quantity), [from, to], terms);
            }
            self.transient((kind, axis), [from, to], [curves[0][0].factor(), curves[1][0].factor()], &terms.stated);
        }
    }

    fn curve(&mut self, place: (SensorKind, usize, usize), pair: [&UnitCurve; 2], terms: &Terms<'_>) {
        let (kind, axis, quantity) = place;
        let name = format!("{} {}", kind.names()[axis], QUANTITIES[quantity]);
        let [old, new] = pair.map(|curve| curve.polynomial().range());
        let width = |[low, high]: [f64; 2]| high - low;
        let common = || common_range(pair).filter(|range| width(*range) >= width(old) / 2.0);
        let Some(range) = (if terms.is_first { Some(new) } else { common() }) else {
            let text = format!("{name}: its range {new:?} has less than half of the range before, {old:?}, in common");
            return self.incomparable.push(text);
        };
        let multipliers = if quantity == 0 { [1.0; 2] } else { terms.multipliers };
        let scaled = [0, 1].map(|table| pair[table].times(multipliers[table]));
        let pair = scaled.each_ref();
        let difference = CurveDifference::of(place, pair, range);
        let (size, temperature) = difference.largest();
        // Biases in the unit of their difference, since tables may have several; scale factors have one unit.
        let (value, of_values): (&dyn Fn(&UnitCurve) -> f64, _) = match quantity {
            0 => (&|curve: &UnitCurve| curve.at(temperature) * unit_factor(kind, 0, 1.0), difference.unit),
            _ => (&|curve: &UnitCurve| curve.polynomial().at(temperature), kind.scale_factor_unit()),
        };
        // As they are in the files: with the intervals, if those differ too.
        let has_other_interval = (multipliers[1] - multipliers[0]).abs() > 0.0;
        let interval = |seconds: f64| has_other_interval.then(|| format!(" (nominal_interval_s {seconds})"));
        let written = |table: usize| rounded(value(pair[table])) + &interval(multipliers[table]).unwrap_or_default();
        let values = [0, 1].map(written);
        let limit = match (kind, quantity) {
            (SensorKind::Accelerometer, 0) => Limit::Bias,
            (SensorKind::Gyroscope, 0) => Limit::Rate,
            _ => Limit::Scale,
        };
        let values = format!("from {} to {} {of_values} at {}", values[0], values[1], rounded(temperature));
        let middle = pair[0].at(f64::midpoint(old[0], old[1]));
        let stated = terms.stated.curve(place, pair[0].factor() * unit_factor(kind, quantity, middle));
        self.changes.push(Change { name, limit, size, unit: difference.unit, values, stated });
    }

    /// A transient times the range counts as bias.
    fn transient(
        &mut self,
        (kind, axis): (SensorKind, usize),
        [old, new]: [&Axis; 2],
        factors: [f64; 2],
        stated: &StatedLimits<'_>,
    ) {
        if old.transient == 0.0 && new.transient == 0.0 {
            return;
        }
        let [low, high] = new.bias.range();
        let size = ((new.transient * factors[1] - old.transient * factors[0]) * (high - low)).abs();
        let (limit, unit) = match kind {
            SensorKind::Accelerometer => (Limit::Bias, unit(kind, 0)),
            SensorKind::Gyroscope => (Limit::Rate, unit(kind, 0)),
        };
        let factor = unit_factor(kind, 0, 1.0);
        let [from, to] =
            [(old, factors[0]), (new, factors[1])].map(|(axis, own)| rounded(axis.transient * own * factor));
        let values = format!("from {from} to {to} {unit} a unit of temperature, times the range");
        let name = format!("{} transient", kind.names()[axis]);
        let stated = stated.transient(kind, axis, factors[0] * factor * (high - low));
        self.changes.push(Change { name, limit, size: size * factor, unit, values, stated });
    }

    /// A g-sensitivity counts as rate, at 1 g0.
    fn g_sensitivity(&mut self, axis: usize, [old, new]: [[f64; AXES]; 2], stated: &StatedLimits<'_>) {
        let sizes = old.iter().zip(&new).map(|(old, new)| (new - old).abs());
        let size = sizes.fold(0.0, f64::max);
        if old != [0.0; AXES] || new != [0.0; AXES] {
            let values = format!("from {old:?} to {new:?} deg/h/g0 at 1 g0");
            let name = format!("{} g_sensitivity", GYROSCOPE_NAMES[axis]);
            let stated = stated.g_sensitivity(axis);
            self.changes.push(Change { name, limit: Limit::Rate, size, unit: "deg/h", values, stated });
        }
    }

    /// A table without a matrix has the identity.
    fn matrix(&mut self, kind: SensorKind, pair: [Option<Matrix3<f64>>; 2], stated: &StatedLimits<'_>) {
        if pair == [None, None] {
            return;
        }
        let [old, new] = pair.map(|matrix| matrix.unwrap_or_else(Matrix3::identity));
        let difference = new - old;
        let place = difference.iamax_full();
        let values = format!(
            "from {} to {} in row {}, column {}",
            rounded(old[place]),
            rounded(new[place]),
            place.0 + 1,
            place.1 + 1
        );
        let size = difference[place].abs() * 1e3;
        let name = match kind {
            SensorKind::Accelerometer => "alignment",
            SensorKind::Gyroscope => "gyroscope_alignment",
        };
        let stated = stated.alignment(kind, &old).map(|limit| limit * 1e3);
        self.changes.push(Change {
            name: name.to_owned(),
            limit: Limit::Alignment,
            size,
            unit: "mrad",
            values,
            stated,
        });
    }
}

/// What else changes, in words.
fn others(old: &Content, new: &Content) -> Vec<String> {
    let mut found = Vec::new();
    let mut note = |name: &str, from: String, to: String| {
        if from != to {
            found.push(format!("{name} {from} -> {to}"));
        }
    };
    let optional = |value: Option<f64>| value.map_or("none".to_owned(), |value| value.to_string());
    note("format", old.format.to_string(), new.format.to_string());
    let serial = |content: &Content| content.serial.clone().unwrap_or_else(|| "none".to_owned());
    note("serial", serial(old), serial(new));
    note("gravity", old.gravity.to_string(), new.gravity.to_string());
    note("nominal_interval_s", optional(old.nominal_interval_s), optional(new.nominal_interval_s));
    note("out_of_range", old.out_of_range.name().to_owned(), new.out_of_range.name().to_owned());
    note("max_age_s", optional(old.max_age_s), optional(new.max_age_s));
    note("lag", optional(old.lag_s), optional(new.lag_s));
    let gyroscopes = |content: &Content| if content.gyroscopes.is_some() { "yes" } else { "none" }.to_owned();
    note("gyroscopes", gyroscopes(old), gyroscopes(new));
    let mut axes = |names: [&str; AXES], old: &[Axis; AXES], new: &[Axis; AXES]| {
        for (name, (old, new)) in names.iter().zip(old.iter().zip(new)) {
            note(&format!("{name} max_rate"), optional(old.max_rate), optional(new.max_rate));
            let ranges = |axis: &Axis| {
                let all = [&axis.bias, &axis.positive_scale_factor, &axis.negative_scale_factor];
                format!("{:?}", all.map(Polynomial::range))
            };
            note(&format!("{name} ranges"), ranges(old), ranges(new));
        }
    };
    axes(AXIS_NAMES, &old.axes, &new.axes);
    if let (Some(old), Some(new)) = (&old.gyroscopes, &new.gyroscopes) {
        axes(GYROSCOPE_NAMES, &old.axes, &new.axes);
    }
    found
}

/// A number with six significant digits.
fn rounded(value: f64) -> String {
    let text = format!("{value:.5e}");
    text.parse::<f64>().map_or(text, |value| value.to_string())
}

impl Content {
    /// Scale factors that a lost digit may have made: K+ and K- of a sensor, or K of the sensors of a triad, that
    /// differ by more than a factor 2 in the middle of their ranges. A table is not refused for it.
    #[must_use]
    pub fn unlike_scale_factors(&self) -> Vec<String> {
        let gyroscopes = self.gyroscopes.as_ref().map(|gyroscopes| (SensorKind::Gyroscope, &gyroscopes.axes));
        let triads = [Some((SensorKind::Accelerometer, &self.axes)), gyroscopes].into_iter().flatten();
        triads.flat_map(|(kind, axes)| unlike(kind, axes)).collect()
    }
}

fn unlike(kind: SensorKind, axes: &[Axis; AXES]) -> Vec<String> {
    /// The factor.
    const MOST: f64 = 2.0;
    let middle = |polynomial: &Polynomial| {
        let [low, high] = polynomial.range();
        polynomial.at(f64::midpoint(low, high)).abs()
    };
    let (names, unit) = (kind.names(), kind.scale_factor_unit());
    let both = axes.each_ref().map(|axis| [middle(&axis.positive_scale_factor), middle(&axis.negative_scale_factor)]);
    let mut found = Vec::new();
    for (name, [positive, negative]) in names.iter().zip(both) {
        if positive.max(negative) > MOST * positive.min(negative) {
            let (positive, negative) = (rounded(positive), rounded(negative));
            found
                .push(format!("K+ and K- of {name} differ by more than a factor 2: {positive} and -{negative} {unit}"));
        }
    }
    let means = both.map(|[positive, negative]| f64::midpoint(positive, negative));
    let (least, most) =
        (means.iter().copied().fold(f64::INFINITY, f64::min), means.iter().copied().fold(0.0, f64::max));
    if most > MOST * least {
        let all = names.iter().zip(means).map(|(name, mean)| format!("{name} {}", rounded(mean)));
        let all = all.collect::<Vec<_>>().join(", ");
        found.push(format!("the scale factors of {} differ by more than a factor 2: {all} {unit}", names.join(", ")));
    }
    found
}
