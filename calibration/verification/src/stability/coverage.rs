//! What of a triad's part of a table a run exercises: the temperature of its windows, and the channels that the
//! specific force drives. At rest no channel of a gyroscope is driven: Earth's rate shows 1e-5 of an error of the scale
//! factor.

use crate::occupancy::{MOST_UNTOUCHED, Occupancy};
use crate::window::Window;
use core::fmt;
use isotherm_campaign::joint_range;
use isotherm_shared::table::Axis;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use serde::{Deserialize, Serialize};

/// Least specific force that drives a channel \[g0\]. The run shows the error of the scale factor times this: an error
/// that a bound lets pass is at most 1/0.3 of the bound at 1 g0.
pub const DRIVEN: f64 = 0.3;

/// What of a table a run exercises: of the rest it says nothing.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Coverage {
    /// The triad.
    pub kind: SensorKind,
    /// Lowest and highest temperature of the windows that count, without the flagged ones: head and board, by axis.
    pub temperature: [[[f64; 2]; 2]; AXES],
    /// What of the bias's range, and of that of K+ and K-, the rows of these windows touch.
    pub occupancy: [[Occupancy; 2]; AXES],
    /// Unit of the temperature.
    pub unit: String,
    /// Whether the specific force drives the channel: + and -, by axis.
    pub driven: [[bool; 2]; AXES],
}

/// Nothing of the range of the bias, and of that of K+ and K-, by axis.
pub(super) fn untouched(axes: &[Axis; AXES]) -> [[Occupancy; 2]; AXES] {
    axes.each_ref().map(|axis| {
        let scale_factor = joint_range([axis.positive_scale_factor.range(), axis.negative_scale_factor.range()]);
        [axis.bias.range(), scale_factor].map(|range| Occupancy::of(range, []))
    })
}

/// The windows that are judged: those that count, without the flagged ones unless all are.
fn judged(windows: &[Window]) -> impl Iterator<Item = &Window> {
    let good = windows.iter().any(|window| window.counts && !window.flagged);
    windows.iter().filter(move |window| window.counts && !(good && window.flagged))
}

/// Names of the curves over head and board temperature.
const CURVES: [&str; 2] = ["bias", "K"];

impl Coverage {
    /// Without channels.
    pub(crate) fn of(windows: &[Window], kind: SensorKind, axes: &[Axis; AXES], unit: &str) -> Self {
        let all = |axis: usize, sensor: usize| judged(windows).map(move |window| window.temperature[axis][sensor]);
        let mut occupancy = untouched(axes);
        for window in judged(windows) {
            let all = occupancy.as_flattened_mut().iter_mut().zip(window.touched.as_flattened());
            all.for_each(|(occupancy, touched)| *occupancy = occupancy.with(*touched));
        }
        let each = [0, 1, 2].map(|axis| [(axis, 0), (axis, 1)]);
        Self {
            kind,
            temperature: each.map(|pair| pair.map(|(axis, sensor)| joint_range(all(axis, sensor)))),
            occupancy,
            unit: unit.to_owned(),
            driven: [[false; 2]; AXES],
        }
    }

    /// With the channels of the accelerometers that the specific force \[g0\] drives.
    pub(super) fn driven_by(mut self, force: [f64; AXES]) -> Self {
        self.driven = force.map(|f| [f >= DRIVEN, f <= -DRIVEN]);
        self
    }

    /// The part of the table's range that the run covers: of head and board, by axis. See [`Occupancy::part`].
    #[must_use]
    pub fn parts(&self) -> [[f64; 2]; AXES] {
        self.occupancy.each_ref().map(|pair| pair.each_ref().map(Occupancy::part))
    }

    /// The curve that is covered least, by axis and index: 0 for the bias, 1 for K+ and K-. Only the biases of
    /// gyroscopes count.
    #[must_use]
    pub fn least(&self) -> (usize, usize) {
        let parts = self.parts();
        self.curves().min_by(|a, b| parts[a.0][a.1].total_cmp(&parts[b.0][b.1])).unwrap_or_default()
    }

    fn curves(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let count = if self.kind == SensorKind::Accelerometer { 2 } else { 1 };
        (0..AXES).flat_map(move |axis| [(axis, 0), (axis, 1)].into_iter().take(count))
    }

    /// The largest hole of all curves, in words: "2.5 to 37.2 degC of bias of A1, 87 % of its range". Nothing is
    /// known of the table's error in it. `None` if every hole is at most a tenth of its curve's range.
    #[must_use]
    pub fn hole(&self) -> Option<String> {
        self.hole_over(MOST_UNTOUCHED)
    }

    /// The largest hole of all curves in words, if it is over this part of its curve's range.
    pub(crate) fn hole_over(&self, part: f64) -> Option<String> {
        let untouched = |(axis, k): (usize, usize)| self.occupancy[axis][k].untouched();
        let (axis, k) = self.curves().min_by(|a, b| untouched(*b).total_cmp(&untouched(*a)))?;
        let curve = format!("{} of {}", CURVES[k], self.kind.names()[axis]);
        hole(&self.occupancy[axis][k], part, &curve, &self.unit)
    }

    /// Together with what another run exercises of the same table.
    #[must_use]
    pub(crate) fn and(&self, other: &Self) -> Self {
        let sensors = [0, 1, 2].map(|axis| [(axis, 0), (axis, 1)]);
        let occupancy = |(axis, k): (usize, usize)| self.occupancy[axis][k].and(other.occupancy[axis][k]);
        Self {
            temperature: sensors
                .map(|pair| pair.map(|(axis, k)| joint_range([self.temperature[axis][k], other.temperature[axis][k]]))),
            occupancy: sensors.map(|pair| pair.map(occupancy)),
            driven: sensors.map(|pair| pair.map(|(axis, k)| self.driven[axis][k] || other.driven[axis][k])),
            ..self.clone()
        }
    }

    /// Names of the channels that the run drives, as `K+ of A1`.
    #[must_use]
    pub fn channels(&self) -> Vec<String> {
        self.named(true)
    }

    /// Names of those that it does not drive.
    #[must_use]
    pub fn undriven(&self) -> Vec<String> {
        self.named(false)
    }

    fn named(&self, driven: bool) -> Vec<String> {
        let of = |axis: usize| ["+", "-"].into_iter().zip(self.driven[axis]).map(move |(sign, is)| (axis, sign, is));
        let all = (0..AXES).flat_map(of).filter(|(.., is)| *is == driven);
        all.map(|(axis, sign, _)| format!("K{sign} of {}", self.kind.names()[axis])).collect()
    }
}

/// The temperature that is covered least, and the channels.
impl fmt::Display for Coverage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (axis, k) = self.least();
        let ([low, high], [from, to]) = (self.temperature[axis][k], self.occupancy[axis][k].range);
        let (name, unit, percent) = (self.kind.names()[axis], &self.unit, 100.0 * self.parts()[axis][k]);
        let channels = self.channels();
        let channels = if channels.is_empty() { "none".to_owned() } else { channels.join(", ") };
        let of_kind = match self.kind {
            SensorKind::Accelerometer => {
                format!("channels {channels}; not judged beyond, and not shown: {}", self.undriven().join(", "))
            }
            SensorKind::Gyroscope => {
                "at rest scale factors and misalignments are not driven, and not judged".to_owned()
            }
        };
        let places = decimals(to - from);
        write!(
            f,
            "{} of {name}: {low:.places$} to {high:.places$} {unit} of {from:.places$} to {to:.places$} {unit}, {percent:.0} %, the least; {of_kind}",
            CURVES[k]
        )?;
        self.hole().map_or(Ok(()), |hole| write!(f, "; no window is in {hole}"))
    }
}

/// The largest hole of a curve in words, if it is over this part of the curve's range.
pub(crate) fn hole(occupancy: &Occupancy, part: f64, curve: &str, unit: &str) -> Option<String> {
    let [from, to] = occupancy.largest_hole().filter(|_| occupancy.untouched() > part)?;
    let ([low, high], percent) = (occupancy.range, 100.0 * occupancy.untouched());
    let places = decimals(high - low);
    Some(format!("{from:.places$} to {to:.places$} {unit} of {curve}, {percent:.0} % of its range"))
}

/// Decimals that show a hundredth of `range`, at least none.
fn decimals(range: f64) -> usize {
    (2.0 - libm::log10(range).floor()).clamp(0.0, 9.0) as usize
}
