//! Each set point by itself.

use super::input::GyroscopeRun;
use super::model::{GyroscopeCurves, GyroscopeModel, PARAMETERS, QUANTITIES};
use crate::joint::JointModel as _;
use crate::joint::OneStageError;
use crate::one_stage::SetPointValues;
use crate::sensor::ReducedSensor;
use isotherm_shared::wire::AXES;

/// One set point reduced by itself: D, K+, K-, two misalignments and three g-sensitivities of each gyroscope.
#[derive(Clone, Debug, PartialEq)]
pub struct SetPointReduction {
    /// D \[deg/h\], K+, K- \[pulse/arcsec\], m, m \[rad\], s, s, s \[deg/h/g0\], by gyroscope.
    pub values: [[f64; PARAMETERS]; AXES],
    /// Their standard errors, from the scatter within the set point.
    pub standard_errors: [[f64; PARAMETERS]; AXES],
    /// Effective temperature of D, K+ and K-: the mean over the runs with the weights that they have in the value.
    pub temperature: [[f64; QUANTITIES]; AXES],
    /// Earth's rate along the base's X and Y \[deg/h\], if there are angles.
    pub earth: Option<[f64; 2]>,
    /// Residual standard deviation \[arcsec/sqrt(s)\].
    pub residual_sd: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
    /// Condition number of the equations.
    pub condition: f64,
}

impl SetPointReduction {
    /// What both triads have.
    pub(crate) fn sensors(&self) -> [ReducedSensor<'_>; AXES] {
        [0, 1, 2].map(|axis| ReducedSensor {
            temperature: self.temperature[axis],
            values: &self.values[axis],
            standard_errors: &self.standard_errors[axis],
            freedom: self.freedom,
        })
    }
}

/// Reduces the runs of one set point. `start` has constant curves.
pub(super) fn reduce(runs: &[GyroscopeRun<'_>], start: &GyroscopeCurves) -> Result<SetPointReduction, OneStageError> {
    let mut model = GyroscopeModel::new(runs, 1, start);
    let step = model.converge(&vec![true; runs.len()])?;
    let unknown = |axis: usize| -> [usize; PARAMETERS] {
        let ([d, k_plus, k_minus], m, s) =
            (model.offsets[axis], model.misalignments[axis], model.g_sensitivities[axis]);
        [d, k_plus, k_minus, m, m + 1, s, s + 1, s + 2]
    };
    let freedom = step.residual.len().saturating_sub(model.unknowns());
    let residual_sd = (step.residual.norm_squared() / freedom as f64).sqrt();
    let weights = &step.inverse * step.jacobian.transpose();
    let effective = |axis: usize, quantity: usize| -> f64 {
        let j = unknown(axis)[quantity];
        let temperature = |run: &GyroscopeRun<'_>| if quantity == 0 { run.head[axis] } else { run.board[axis] };
        let terms = runs.iter().enumerate().map(|(r, run)| {
            let weight: f64 = (0..AXES).map(|i| weights[(j, AXES * r + i)] * step.jacobian[(AXES * r + i, j)]).sum();
            weight * temperature(run)
        });
        terms.sum()
    };
    Ok(SetPointReduction {
        values: [0, 1, 2].map(|axis| unknown(axis).map(|j| model.unknown[j])),
        standard_errors: [0, 1, 2].map(|axis| unknown(axis).map(|j| residual_sd * step.inverse[(j, j)].sqrt())),
        temperature: [0, 1, 2].map(|axis| [0, 1, 2].map(|quantity| effective(axis, quantity))),
        earth: model.with_earth.then(|| [model.unknown[model.earth], model.unknown[model.earth + 1]]),
        residual_sd,
        freedom,
        condition: step.condition,
    })
}

/// Fits all unknowns, and gives D, K+ and K- of each set point without the drift within it: the curve at the effective
/// temperature plus the correction from the set point's residuals. A set point that does not determine its parameters
/// keeps its reduced values.
pub(super) fn corrected_values(
    runs: &[GyroscopeRun<'_>],
    reduced: &[SetPointReduction],
    start: &GyroscopeCurves,
) -> Result<Vec<SetPointValues>, OneStageError> {
    let mut model = GyroscopeModel::new(runs, reduced.len(), start);
    let counted = vec![true; runs.len()];
    let step = model.converge(&counted)?;
    let solution = model.solution(&step, &counted);
    let values = |(set_point, reduced): (usize, &SetPointReduction)| {
        let deviations = model.deviations(set_point, &step, &counted);
        [0, 1, 2].map(|axis| {
            [0, 1, 2].map(|quantity| {
                let temperature = reduced.temperature[axis][quantity];
                let curve = &solution.gyroscopes[axis].curves[quantity];
                // A residual falls where its parameter rises by the deviation.
                let value = match &deviations {
                    Some((deviation, _)) => curve.at(temperature) - deviation[axis * PARAMETERS + quantity],
                    None => reduced.values[axis][quantity],
                };
                (temperature, value)
            })
        })
    };
    Ok(reduced.iter().enumerate().map(values).collect())
}
