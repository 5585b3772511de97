//! The order tables of a triad's curves.

use crate::effects::{BIAS_EFFECT, GYROSCOPE_BIAS_EFFECT, GYROSCOPE_SCALE_FACTOR_EFFECT, SCALE_FACTOR_EFFECT};
use crate::error::CalibrationError;
use crate::one_stage::SetPointValues;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, OrderTable, PureError, QUANTITIES, Rule};

/// The lowest order of a curve that is chosen, as far as the set points allow it: the model is cubic. A term that the
/// noise of a set point hides still moves the curve by some ppm.
const LEAST_ORDER: usize = 3;
/// Probability of choosing a gyroscope's term without effect, over the orders of a curve: 1 % over the nine curves of
/// the triad.
const SIGNIFICANCE: f64 = 0.01 / 9.0;

/// How the orders of a triad's curves are chosen.
pub(crate) struct OrderRules {
    names: [&'static str; AXES],
    /// Of the biases.
    bias: Rule,
    /// Of the scale factors; its effect is relative.
    scale_factor: Rule,
}

impl OrderRules {
    /// Those of the accelerometers.
    pub(crate) fn accelerometers() -> Self {
        let rule = |effect, unit| Rule { effect: Some(effect), unit, least: LEAST_ORDER, ..Rule::default() };
        let scale_factor = rule(SCALE_FACTOR_EFFECT, "pulse/(s*g0)");
        Self { names: AXIS_NAMES, bias: rule(BIAS_EFFECT, "g0"), scale_factor }
    }

    /// Those of the gyroscopes.
    pub(crate) fn gyroscopes() -> Self {
        let rule = |effect, unit| Rule {
            significance: SIGNIFICANCE,
            effect: Some(effect),
            unit,
            least: LEAST_ORDER,
            own_error: None,
        };
        let scale_factor = rule(GYROSCOPE_SCALE_FACTOR_EFFECT, "pulse/arcsec");
        Self { names: GYROSCOPE_NAMES, bias: rule(GYROSCOPE_BIAS_EFFECT, "deg/h"), scale_factor }
    }

    /// The order tables of the values of the set points, by axis and quantity: of the order `fixed`, or of one up to
    /// `highest` that is chosen. `own_error` is that of a set point, if it is known.
    ///
    /// # Errors
    /// If a curve of the order `fixed` cannot be fitted.
    pub(crate) fn tables(
        &self,
        values: &[SetPointValues],
        fixed: Option<usize>,
        highest: usize,
        own_error: impl Fn(usize, usize) -> Option<PureError>,
    ) -> Result<[[OrderTable; 3]; AXES], CalibrationError> {
        let of = |axis: usize, q: usize| {
            let values = || values.iter().map(|value| value[axis][q]);
            let size = values().map(|(_, y)| y.abs()).fold(0.0, f64::max);
            let relative = Rule { effect: self.scale_factor.effect.map(|effect| effect * size), ..self.scale_factor };
            let rule = if q == 0 { self.bias } else { relative };
            let rule = Rule { own_error: own_error(axis, q), ..rule };
            let failed = |error| CalibrationError::Order { axis: self.names[axis], quantity: QUANTITIES[q], error };
            OrderTable::of_set_points(values(), fixed, highest, &rule).map_err(failed)
        };
        let axis = |axis: usize| Ok::<_, CalibrationError>([of(axis, 0)?, of(axis, 1)?, of(axis, 2)?]);
        Ok([axis(0)?, axis(1)?, axis(2)?])
    }
}

/// The curves of the chosen orders over the ranges of head and board temperature.
pub(crate) fn curves(orders: &[[OrderTable; 3]; AXES], ranges: &[[[f64; 2]; 2]; AXES]) -> [[Curve; 3]; AXES] {
    let curve = |axis: usize, q: usize| {
        Curve::of(&orders[axis][q].regression, orders[axis][q].choice.order, ranges[axis][q.min(1)])
    };
    [0, 1, 2].map(|axis| [0, 1, 2].map(|q| curve(axis, q)))
}
