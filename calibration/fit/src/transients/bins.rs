//! A sensor's bias bin by bin: a second, or a row if rows are longer.

use super::blocks::indicated;
use super::options::CurveSource;
use super::readings::{behind, interpolated};
use super::recording::{Bin, RampRecording};
use isotherm_shared::table::Axis;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;

/// One bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BinValue {
    /// Middle of the bin, since the recording began \[s\].
    pub age_s: f64,
    /// Head temperature there.
    pub temperature: f64,
    /// Lagged temperature less temperature; 0 without a lag.
    pub difference: f64,
    /// What the sensor indicates with the scale factors of the table, its bias included \[g0 or deg/h\].
    pub value: f64,
}

/// The bins of a sensor whose scale factors are those of `axis`. The lagged temperature has the time constant `lag_s`,
/// and begins soaked. Empty without temperature.
pub(crate) fn bin_values(
    recording: &RampRecording,
    kind: SensorKind,
    index: usize,
    axis: &Axis,
    lag_s: Option<f64>,
) -> Vec<BinValue> {
    let sensor = index + if kind == SensorKind::Gyroscope { AXES } else { 0 };
    let (heads, boards) = (recording.heads(sensor), recording.boards(sensor));
    let (Some(first), false) = (recording.bins().first(), heads.is_empty() || boards.is_empty()) else {
        return Vec::new();
    };
    let times_ns: Vec<_> = recording.bins().iter().map(Bin::middle_ns).collect();
    let (head, board) = (interpolated(&heads, &times_ns), interpolated(&boards, &times_ns));
    let values = indicated(recording, sensor, axis, CurveSource::Ramps, &head, &board);
    let differences = lag_s.map(|lag_s| behind(&heads, &times_ns, &head, (lag_s * 1e9).round() as u64));
    let of_bin = |(i, (&temperature, value)): (usize, (&f64, f64))| BinValue {
        age_s: (times_ns[i] - first.begin_ns) as f64 / 1e9,
        temperature,
        difference: differences.as_ref().map_or(0.0, |all| all[i]),
        value,
    };
    head.iter().zip(values).enumerate().map(of_bin).collect()
}
