//! Whether the numbers of a device can be in the unit that is said of them: the first seconds against gravity, and each
//! rate against what hardly any gyroscope measures.
//!
//! A wrong unit of the rates cannot be seen at rest, and counts whose unit nobody says are not judged.

use crate::description::{Description, Kind};
use crate::iio::IioScale;
use crate::notice::Notice;
use crate::number::Value;
use crate::sample::Axes;
use isotherm_recording_formats::convert::{Kind as Count, Sensors, acceleration_units, rate_units};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::tell;
use std::ops::RangeInclusive;

/// How long the accelerations are averaged \[ns\].
const SPAN_NS: u64 = 5_000_000_000;
/// The length of a mean that may be gravity, and gravity \[m/s2\].
const POSSIBLE: RangeInclusive<f64> = 3.0..=30.0;
const GRAVITY: f64 = 9.8;
/// The largest rate that is not warned of \[rad/s\].
const MOST_RATE: f64 = 40.0;

/// By what the unit of three sensors is said.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum UnitKey {
    /// A key of the node of ROS 2.
    Message,
    /// `unit` of a section.
    Unit,
    /// `scale` of a section, or the kernel.
    Scale,
}

/// Three sensors whose unit is known.
#[derive(Clone, Copy, Debug)]
struct ScaledTriad {
    columns: [usize; AXES],
    /// Taken off each number first, in the column's unit.
    offset: f64,
    /// One number of each sensor \[m/s2 or rad/s; of increments m/s or rad\].
    scale: [f64; AXES],
    /// What these scales make of a number that is a reading in m/s2 or rad/s.
    one: f64,
    is_increment: bool,
    key: UnitKey,
}

/// Accelerations that are averaged.
#[derive(Clone, Copy, Debug, Default)]
struct AccelerationSum {
    since_ns: Option<u64>,
    sum: [f64; AXES],
    count: u64,
}

/// Looks at the units of a source.
#[derive(Debug)]
pub(crate) struct UnitCheck {
    accelerometer: Option<ScaledTriad>,
    gyroscope: Option<ScaledTriad>,
    /// Until gravity was compared, if there is any.
    mean: Option<AccelerationSum>,
    rates: Notice,
}

impl ScaledTriad {
    /// `None` for counts whose unit the description does not say.
    fn of(axes: &Axes, sensors: &Sensors, resolution: f64, kind: &Kind) -> Option<Self> {
        let is_increment = sensors.kind == Count::Increment;
        let is_plain = !is_increment && resolution != 1.0 && sensors.offset == 0.0;
        let one = sensors.unit.or((is_plain && !matches!(kind, Kind::Iio(_))).then_some(1.0))?;
        let is_named = acceleration_units().iter().chain(&rate_units()).any(|(factor, _)| *factor == one);
        let key = match kind {
            Kind::Messages(..) => UnitKey::Message,
            _ if is_named && !is_increment => UnitKey::Unit,
            _ => UnitKey::Scale,
        };
        Some(Self { columns: axes.columns, offset: axes.offset, scale: [one; AXES], one, is_increment, key })
    }

    fn of_kernel(axes: &Axes, sensors: &Sensors, scales: &[IioScale]) -> Option<Self> {
        let [x, y, z] = scales else { return None };
        Some(Self {
            columns: axes.columns,
            offset: axes.offset - x.offset,
            scale: [x.scale, y.scale, z.scale],
            one: 1.0,
            is_increment: sensors.kind == Count::Increment,
            key: UnitKey::Scale,
        })
    }

    /// The values of a row over this interval; not finite where a number is not there.
    fn values(&self, row: &[Value], interval_ns: u64) -> [f64; AXES] {
        let per_interval = if self.is_increment { 1e9 / interval_ns as f64 } else { 1.0 };
        let number = |axis: usize| row.get(self.columns[axis]).map_or(f64::NAN, |value| value.number);
        std::array::from_fn(|axis| (number(axis) - self.offset) * self.scale[axis] * per_interval)
    }

    /// How the unit that has this factor and name is said of the accelerometers.
    fn remedy(&self, factor: f64, name: &str) -> String {
        let scale = factor * self.scale[0] / self.one;
        match self.key {
            UnitKey::Message => format!("give accelerometer_unit = \"{name}\""),
            UnitKey::Unit => format!("give unit = \"{name}\" in [accelerometer]"),
            UnitKey::Scale => format!("give scale = {scale} in [accelerometer]"),
        }
    }
}

impl UnitCheck {
    pub(crate) fn new(description: &Description) -> Self {
        let (columns, sensors) = (&description.columns, &description.sensors);
        let of = |axes: &Axes, sensors: &Sensors, resolution: f64| {
            ScaledTriad::of(axes, sensors, resolution, &description.kind)
        };
        let gyroscope = columns.gyroscope.as_ref().zip(sensors.gyroscope.as_ref());
        Self {
            accelerometer: of(&columns.accelerometer, &sensors.accelerometer, columns.resolution.accelerometer),
            gyroscope: gyroscope.and_then(|(axes, sensors)| of(axes, sensors, columns.resolution.gyroscope)),
            mean: description.has_gravity.then(AccelerationSum::default),
            rates: Notice::default(),
        }
    }

    /// Takes the scales that the kernel gives, where the description says none.
    pub(crate) fn with_scales(mut self, description: &Description, scales: &[IioScale]) -> Self {
        let (columns, sensors) = (&description.columns, &description.sensors);
        let part = |from: usize| scales.get(from..from + AXES).unwrap_or_default();
        if self.accelerometer.is_none() {
            self.accelerometer = ScaledTriad::of_kernel(&columns.accelerometer, &sensors.accelerometer, part(0));
        }
        if let (None, Some(axes), Some(sensors)) = (&self.gyroscope, &columns.gyroscope, &sensors.gyroscope) {
            self.gyroscope = ScaledTriad::of_kernel(axes, sensors, part(AXES));
        }
        self
    }

    /// Another session begins, whose times may be of another clock.
    pub(crate) const fn begin_session(&mut self) {
        if let Some(mean) = &mut self.mean {
            mean.since_ns = None;
        }
    }

    /// Takes the row of a sample of this time over this interval \[ns\], and says what cannot be.
    pub(crate) fn take(&mut self, row: &[Value], now_ns: u64, interval_ns: u64) {
        if let Some(text) = self.gravity_text(row, now_ns, interval_ns) {
            tell("isotherm", text);
        }
        if let Some(text) = self.rate_text(row, interval_ns) {
            self.rates.tell(|| text);
        }
    }

    /// What is to be said, once, of the accelerations of the first seconds.
    pub(crate) fn gravity_text(&mut self, row: &[Value], now_ns: u64, interval_ns: u64) -> Option<String> {
        let (Some(mean), Some(triad)) = (&mut self.mean, &self.accelerometer) else { return None };
        let values = triad.values(row, interval_ns);
        if values.iter().all(|value| value.is_finite()) {
            mean.sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
            mean.count += 1;
        }
        if now_ns.saturating_sub(*mean.since_ns.get_or_insert(now_ns)) < SPAN_NS {
            return None;
        }
        let sum = mean.sum.iter().map(|sum| sum * sum).sum::<f64>().sqrt();
        let length = sum / mean.count as f64;
        self.mean = None;
        if POSSIBLE.contains(&length) || !length.is_finite() {
            return None;
        }
        let numbers = length / triad.one;
        let off = |factor: f64| (numbers * factor / GRAVITY).max(GRAVITY / (numbers * factor));
        let units = acceleration_units().into_iter().filter(|(factor, _)| POSSIBLE.contains(&(numbers * factor)));
        let best = units.min_by(|(one, _), (other, _)| off(*one).total_cmp(&off(*other)));
        let remedy = match best {
            Some((factor, name)) => format!("the numbers seem to be in {name}: {}; ", triad.remedy(factor, name)),
            None if length < GRAVITY => String::new(),
            None => format!(
                "the numbers seem to be counts, of {:.3e} m/s2 each if it is at rest: give scale from the data sheet; ",
                GRAVITY / numbers
            ),
        };
        Some(format!(
            "warning: the mean acceleration of the first {} s is {length:.4} m/s2 long, and gravity is {GRAVITY}: {remedy}\
             for a source without gravity give gravity = false",
            SPAN_NS / 1_000_000_000
        ))
    }

    /// What is to be said of a rate that is too large to be one.
    pub(crate) fn rate_text(&self, row: &[Value], interval_ns: u64) -> Option<String> {
        let triad = self.gyroscope.as_ref()?;
        let rates = triad.values(row, interval_ns);
        let rate = rates.into_iter().map(f64::abs).filter(|rate| rate.is_finite()).fold(0.0, f64::max);
        let remedy = match triad.key {
            UnitKey::Message => "give gyroscope_unit = \"deg/s\"",
            UnitKey::Unit => "give unit = \"deg/s\" in [gyroscope]",
            UnitKey::Scale => "compare scale in [gyroscope] with the data sheet",
        };
        (rate > MOST_RATE).then(|| {
            format!(
                "warning: a rate of {rate:.1} rad/s is more than {MOST_RATE} rad/s: if the numbers are in another unit, {remedy}"
            )
        })
    }
}
