//! What a table may have and parameters cannot say, and how much is lost without it.

use crate::autopilot::Autopilot;
use crate::curve::{common, hull, is_higher, largest, third_order};
use crate::triad::Triad;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::Axis;
use isotherm_shared::units::SensorKind;
use std::fmt;
use std::str::FromStr;

/// Something of a table that the parameters of an autopilot cannot say.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Effect {
    /// Scale factors that depend on temperature.
    ScaleTemperature,
    /// K- apart from K+.
    NegativeScale,
    /// An alignment matrix.
    Alignment,
    /// Biases that depend on the lagged temperature.
    Lag,
    /// Gyroscopes that feel specific force.
    GSensitivity,
    /// Bias polynomials above order 3. Without it each becomes the nearest one of order 3.
    Order,
    /// Biases that are calibrated over several ranges, where the autopilot has one. Without it the range that all have
    /// is written.
    Ranges,
}

impl Effect {
    /// Every effect with its name in options.
    pub const NAMES: [(Self, &'static str); 7] = [
        (Self::ScaleTemperature, "scale-temperature"),
        (Self::NegativeScale, "negative-scale"),
        (Self::Alignment, "alignment"),
        (Self::Lag, "lag"),
        (Self::GSensitivity, "g-sensitivity"),
        (Self::Order, "order"),
        (Self::Ranges, "ranges"),
    ];

    /// The name in options.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ScaleTemperature => "scale-temperature",
            Self::NegativeScale => "negative-scale",
            Self::Alignment => "alignment",
            Self::Lag => "lag",
            Self::GSensitivity => "g-sensitivity",
            Self::Order => "order",
            Self::Ranges => "ranges",
        }
    }

    /// What it is, in words.
    const fn meaning(self) -> &'static str {
        match self {
            Self::ScaleTemperature => "scale factors that depend on temperature",
            Self::NegativeScale => "K- apart from K+",
            Self::Alignment => "an alignment matrix",
            Self::Lag => "biases that follow the lagged temperature",
            Self::GSensitivity => "g-sensitivity",
            Self::Order => "biases above order 3",
            Self::Ranges => "several ranges, where the autopilot has one",
        }
    }

    /// The input at which its size is given, of a kind of sensor.
    const fn condition(self, kind: SensorKind) -> &'static str {
        match (self, kind) {
            (Self::Lag, _) => " at 1 degC/min",
            (Self::Order | Self::Ranges, _) => "",
            (Self::GSensitivity, _) | (_, SensorKind::Accelerometer) => " at 1 g0",
            (_, SensorKind::Gyroscope) => " at 1 rad/s",
        }
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Effect {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::NAMES.iter().find(|(_, known)| *known == name);
        let names = || Self::NAMES.map(|(_, name)| name).join(", ");
        found.map(|(effect, _)| *effect).ok_or_else(|| format!("is {name:?}, give one of {}", names()))
    }
}

/// An effect of a table, with the size of what is lost without it: the largest over the range, of all its sensors.
///
/// Those of scale and alignment are at 1 g0 and 1 rad/s, that of the g-sensitivity at 1 g0, that of the lag when the
/// temperature has changed by 1 degC a minute for long. All are proportional.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectLoss {
    /// The effect.
    pub effect: Effect,
    /// The sensors that have it, A1 to G3.
    pub sensors: Vec<&'static str>,
    /// Of accelerometers \[m/s2\], if any has it.
    pub accelerometers: Option<f64>,
    /// Of gyroscopes \[rad/s\], if any has it.
    pub gyroscopes: Option<f64>,
}

impl fmt::Display for EffectLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} ({}), up to ", self.effect, self.effect.meaning(), self.sensors.join(", "))?;
        let part = |kind, size: Option<f64>, unit| {
            size.map(|size| format!("{} {unit}{}", crate::size(size), self.effect.condition(kind)))
        };
        let accelerometers = part(SensorKind::Accelerometer, self.accelerometers, "m/s2");
        let gyroscopes = part(SensorKind::Gyroscope, self.gyroscopes, "rad/s");
        f.write_str(&accelerometers.into_iter().chain(gyroscopes).collect::<Vec<_>>().join(" and "))
    }
}

/// All effects of the triads that the autopilot's parameters cannot say.
pub(crate) fn losses(triads: &[Triad<'_>], autopilot: Autopilot, lag_s: Option<f64>) -> Vec<EffectLoss> {
    let loss = |(effect, _): (Effect, &str)| {
        let mut loss = EffectLoss { effect, sensors: Vec::new(), accelerometers: None, gyroscopes: None };
        for triad in triads {
            for (index, (axis, name)) in triad.axes.iter().zip(triad.kind.names()).enumerate() {
                let size = match effect {
                    Effect::ScaleTemperature => scale_temperature(axis) * triad.input,
                    Effect::NegativeScale => negative_scale(axis) * triad.input,
                    Effect::Alignment => triad.misalignment.get(index).map_or(0.0, |part| part * triad.input),
                    Effect::Lag => axis.transient.abs() * triad.factor(axis) * lag_s.unwrap_or(0.0) / 60.0,
                    Effect::GSensitivity => triad.g_sensitivity.get(index).map_or(0.0, |part| part * triad.unit),
                    Effect::Order => order(&axis.bias) * triad.factor(axis),
                    Effect::Ranges => ranges(axis, &together(triads, triad, autopilot)) * triad.factor(axis),
                };
                if size > 0.0 {
                    loss.sensors.push(name);
                    let all = match triad.kind {
                        SensorKind::Accelerometer => &mut loss.accelerometers,
                        SensorKind::Gyroscope => &mut loss.gyroscopes,
                    };
                    *all = Some(all.map_or(size, |most: f64| most.max(size)));
                }
            }
        }
        (!loss.sensors.is_empty()).then_some(loss)
    };
    Effect::NAMES.into_iter().filter_map(loss).collect()
}

/// The ranges of the biases that share one range in the autopilot with this triad.
pub(crate) fn together(triads: &[Triad<'_>], triad: &Triad<'_>, autopilot: Autopilot) -> Vec<[f64; 2]> {
    let shares = |other: &&Triad<'_>| autopilot == Autopilot::ArduPilot || other.kind == triad.kind;
    triads.iter().filter(shares).flat_map(|other| other.axes).map(|axis| axis.bias.range()).collect()
}

/// Largest relative change of a scale factor from the middle of its range.
fn scale_temperature(axis: &Axis) -> f64 {
    let change = |k: &Polynomial| {
        let [low, high] = k.range();
        let middle = k.at(f64::midpoint(low, high));
        largest(k.range(), |at| k.at(at) / middle - 1.0)
    };
    change(&axis.positive_scale_factor).max(change(&axis.negative_scale_factor))
}

/// Largest relative difference of the two scale factors.
fn negative_scale(axis: &Axis) -> f64 {
    let (positive, negative) = (&axis.positive_scale_factor, &axis.negative_scale_factor);
    let both = hull([positive.range(), negative.range()].into_iter());
    largest(both, |at| positive.at(positive.clamp(at)) / -negative.at(negative.clamp(at)) - 1.0)
}

/// What a polynomial has above order 3, in its unit.
fn order(bias: &Polynomial) -> f64 {
    if !is_higher(bias) {
        return 0.0;
    }
    third_order(bias).map_or(f64::INFINITY, |third| largest(bias.range(), |at| third.at(at) - bias.at(at)))
}

/// What the common range of these changes in a bias, in its unit.
fn ranges(axis: &Axis, all: &[[f64; 2]]) -> f64 {
    let whole = hull(all.iter().copied());
    let Some([low, high]) = common(all.iter().copied()) else { return f64::INFINITY };
    largest(whole, |at| axis.bias.at(axis.bias.clamp(at)) - axis.bias.at(at.clamp(low, high)))
}
