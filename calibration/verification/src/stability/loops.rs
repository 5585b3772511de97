//! The loops between heating and cooling of a run: what the output is off in each direction, with the transients of the
//! table and without.

use crate::window::Window;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{LoopPoint, band, shared_bins, sweeps};
use serde::{Deserialize, Serialize};

/// The lagged temperature needs so many time constants before it has forgotten how it began.
pub(super) const SOAK: u64 = 3;
/// Least part of the range of a bias's temperature that a run must cover: in less, noise makes sweeps.
const LEAST_RANGE: f64 = 0.05;

/// Why the temperature does not change enough; the first that holds is the reason.
const STEADY: [&str; 3] = [
    "the temperature hardly changes",
    "the temperature hardly changes in the windows that are judged",
    "the temperature hardly changes after the 3 time constants in which the lagged temperature settles",
];

/// The residuals of a triad over the temperature of its heads, with their direction, by axis \[g0 or deg/h\].
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Loops {
    /// Of the static model, which is the table without its transients; `None` if the table has no lag.
    pub static_model: Option<[Vec<LoopPoint>; AXES]>,
    /// Of the full model.
    pub full: [Vec<LoopPoint>; AXES],
    /// Why the temperature of an axis does not change enough, if so: the place in [`STEADY`].
    steady: [Option<usize>; AXES],
}

/// The hysteresis band of a bias \[g0 or deg/h\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopBand {
    /// Of the static model; `None` if the table has no lag.
    pub static_model: Option<f64>,
    /// Of the full model.
    pub full: f64,
    /// Bins of temperature that heating and cooling share, of the 12.
    pub bins: usize,
}

impl Loops {
    /// The loops of the windows that count, without those that are `unsettled`. `static_output` are the outputs of the
    /// static model, `right` is what the outputs should be.
    pub(super) fn of(
        windows: &[Window],
        static_output: Option<&[[f64; AXES]]>,
        unsettled: &[bool],
        right: [f64; AXES],
        axes: &[Axis; AXES],
    ) -> Self {
        let shown: Vec<_> = (0..windows.len()).filter(|index| windows[*index].counts && !unsettled[*index]).collect();
        let points = |output: &dyn Fn(usize) -> [f64; AXES]| {
            [0, 1, 2].map(|axis| {
                let temperature: Vec<_> = shown.iter().map(|index| windows[*index].head[axis]).collect();
                let point = |at: usize, heating: bool| LoopPoint {
                    temperature: temperature[at],
                    residual: output(shown[at])[axis] - right[axis],
                    heating,
                };
                let sweeps = sweeps(&temperature).into_iter();
                sweeps
                    .flat_map(|sweep| sweep.values.map(move |at| (at, sweep.heating)))
                    .map(|(at, heating)| point(at, heating))
                    .collect()
            })
        };
        let steady = [0, 1, 2].map(|axis| {
            let [low, high] = axes[axis].bias.range();
            let covers = |used: &dyn Fn(usize) -> bool| {
                let heads = (0..windows.len()).filter(|index| used(*index)).map(|index| windows[index].head[axis]);
                let (least, most) =
                    heads.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), u| (least.min(u), most.max(u)));
                most - least >= LEAST_RANGE * (high - low)
            };
            let steps: [&dyn Fn(usize) -> bool; STEADY.len()] =
                [&|_| true, &|index| windows[index].counts, &|index| shown.binary_search(&index).is_ok()];
            steps.into_iter().position(|used| !covers(used))
        });
        Self {
            static_model: static_output.map(|outputs| points(&|index| outputs[index])),
            full: points(&|index| windows[index].after),
            steady,
        }
    }

    /// The hysteresis band of an axis.
    ///
    /// # Errors
    /// Why it is not judged, in words.
    pub fn band(&self, axis: usize) -> Result<LoopBand, &'static str> {
        let points = &self.full[axis];
        if let Some(why) = self.steady[axis].and_then(|place| STEADY.get(place)) {
            return Err(why);
        }
        let full = band(points).ok_or("only one direction")?;
        let static_model = self.static_model.as_ref().and_then(|points| band(&points[axis]));
        Ok(LoopBand { static_model, full, bins: shared_bins(points) })
    }
}

/// The table without its transients, if it has a lag.
pub(super) fn static_table(table: &CoefficientTable) -> Option<CoefficientTable> {
    let mut content = table.content().clone();
    content.lag_s.take()?;
    let gyroscopes = content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes);
    content.axes.iter_mut().chain(gyroscopes).for_each(|axis| axis.transient = 0.0);
    // What is refused of a transient cannot be; all else is as it was.
    CoefficientTable::new(content).ok()
}
