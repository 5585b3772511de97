//! What the joint fits of accelerometers and of gyroscopes share: Gauss-Newton steps with a QR factorisation, and the
//! covariance from the scatter between set points.

use isotherm_statistics::{LeastSquares, least_squares};
use isotherm_support::checkpoint::checkpoint;
use nalgebra::{DMatrix, DVector};

/// Most Gauss-Newton steps; four or five are usual.
const MAX_STEPS: usize = 30;

/// Why there is no solution.
#[derive(Clone, Copy, Debug, Eq, PartialEq, thiserror::Error)]
pub enum OneStageError {
    /// The dwells do not determine all unknowns.
    #[error("the dwells do not determine {unknowns} unknowns; take a lower order, or more set points or positions")]
    Undetermined {
        /// Number of unknowns.
        unknowns: usize,
    },
    /// The Gauss-Newton steps do not become small.
    #[error("the fit does not converge; the samples contradict the positions")]
    Divergence,
}

/// A linearisation and its solution.
pub(crate) struct NewtonStep {
    pub jacobian: DMatrix<f64>,
    pub residual: DVector<f64>,
    /// H^-1, with H = J'J.
    pub inverse: DMatrix<f64>,
    pub change: DVector<f64>,
    /// Condition number of the Jacobian with columns of length 1.
    pub condition: f64,
}

impl NewtonStep {
    /// `None` if the equations do not determine the unknowns.
    pub(crate) fn of(jacobian: DMatrix<f64>, residual: DVector<f64>) -> Option<Self> {
        checkpoint();
        let LeastSquares { change, inverse, condition } = least_squares(&jacobian, &residual)?;
        Some(Self { jacobian, residual, inverse, change, condition })
    }

    /// Covariance of the unknowns: that of the deviations of the set points' own parameters from the fit, propagated
    /// through the estimator. Each set point has its deviations and B = J'L, see the header of `one_stage`;
    /// `freedom` gives the degrees of freedom of each parameter.
    pub(crate) fn covariance(
        &self,
        set_points: &[(DVector<f64>, DMatrix<f64>)],
        parameters: usize,
        freedom: impl Fn(usize) -> f64,
    ) -> DMatrix<f64> {
        let s = DMatrix::from_fn(parameters, parameters, |i, j| {
            set_points.iter().map(|(delta, _)| delta[i] * delta[j]).sum::<f64>() / (freedom(i) * freedom(j)).sqrt()
        });
        let middle = set_points.iter().map(|(_, score)| score * &s * score.transpose()).sum::<DMatrix<f64>>();
        &self.inverse * middle * &self.inverse
    }
}

/// Equations, and the current values of their unknowns.
pub(crate) trait JointModel {
    /// The steps end when one is smaller than this.
    const CONVERGED: f64;
    /// Rounding can keep the last step above that limit; below this one it is taken all the same.
    const AT_ROUNDING: f64;

    /// Number of unknowns of the fit.
    fn unknowns(&self) -> usize;

    /// The current values; those of the fit come first.
    fn values(&mut self) -> &mut DVector<f64>;

    /// Linearises at the current values and solves, with the equations that are `counted`.
    fn step(&mut self, counted: &[bool]) -> Option<NewtonStep>;

    /// How large a step is, in the unit of the limits.
    fn size(step: &NewtonStep) -> f64;

    /// Repeats Gauss-Newton steps until they are at rounding level.
    fn converge(&mut self, counted: &[bool]) -> Result<NewtonStep, OneStageError> {
        let undetermined = OneStageError::Undetermined { unknowns: self.unknowns() };
        let mut step = self.step(counted).ok_or(undetermined)?;
        for _ in 0..MAX_STEPS {
            let size = Self::size(&step);
            if !size.is_finite() {
                return Err(OneStageError::Divergence);
            }
            let mut values = self.values().rows_mut(0, step.change.len());
            values += &step.change;
            step = self.step(counted).ok_or(undetermined)?;
            if size < Self::CONVERGED {
                return Ok(step);
            }
        }
        if Self::size(&step) < Self::AT_ROUNDING { Ok(step) } else { Err(OneStageError::Divergence) }
    }
}

/// Numbers unknowns one after the other.
#[derive(Default)]
pub(crate) struct Numbering(usize);

impl Numbering {
    /// The first of `count` further unknowns.
    pub(crate) const fn take(&mut self, count: usize) -> usize {
        self.0 += count;
        self.0 - count
    }

    /// How many there are.
    pub(crate) const fn count(&self) -> usize {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = exp(a x), of which y is measured at each x.
    struct Exponential {
        points: Vec<(f64, f64)>,
        a: DVector<f64>,
    }

    impl JointModel for Exponential {
        const CONVERGED: f64 = 1e-12;
        const AT_ROUNDING: f64 = 0.0;

        fn unknowns(&self) -> usize {
            1
        }

        fn values(&mut self) -> &mut DVector<f64> {
            &mut self.a
        }

        fn step(&mut self, counted: &[bool]) -> Option<NewtonStep> {
            let of = |i: usize| libm::exp(self.a[0] * self.points[i].0);
            let weight = |i: usize| f64::from(u8::from(counted[i]));
            let n = self.points.len();
            let jacobian = DMatrix::from_fn(n, 1, |i, _| weight(i) * self.points[i].0 * of(i));
            NewtonStep::of(jacobian, DVector::from_fn(n, |i, _| weight(i) * (of(i) - self.points[i].1)))
        }

        fn size(step: &NewtonStep) -> f64 {
            step.change.amax()
        }
    }

    #[test]
    fn steps_converge_on_what_is_counted() {
        let points: Vec<_> = [1.0, 2.0, 3.0].map(|x: f64| (x, libm::exp(0.3 * x))).to_vec();
        let broken = [points.clone(), vec![(2.0, 50.0)]].concat();
        let mut model = Exponential { points: broken, a: DVector::zeros(1) };
        model.converge(&[true, true, true, false]).unwrap();
        assert!((model.a[0] - 0.3).abs() < 1e-12, "{}", model.a);
        let mut nothing = Exponential { points: vec![(0.0, 1.0)], a: DVector::zeros(1) };
        assert_eq!(nothing.converge(&[true]).err(), Some(OneStageError::Undetermined { unknowns: 1 }));
    }

    #[test]
    fn the_covariance_is_that_of_the_set_points() {
        // Two set points with one equation each of one unknown: the variance of their mean.
        let step = NewtonStep::of(DMatrix::from_element(2, 1, 1.0), DVector::zeros(2)).unwrap();
        let part = |delta: f64| (DVector::from_element(1, delta), DMatrix::from_element(1, 1, 1.0));
        let covariance = step.covariance(&[part(1.0), part(-1.0)], 1, |_| 1.0);
        assert!((covariance[(0, 0)] - 1.0).abs() < 1e-12, "{covariance}");
    }
}
