//! The converters of a triad, and the gyroscopes in front of theirs.
//!
//! # Equations
//! A converter holds the charge q \[g0*s or arcsec\], which grows by the integral of what its sensor indicates. While
//! q >= 1/K+, it gives a positive pulse and subtracts 1/K+ from q; while q <= -1/|K-|, it gives a negative pulse and
//! adds 1/|K-|. So over any time N+/K+ + N-/K- is the integral to within one pulse.
//!
//! Over T \[s\] a gyroscope indicates, with its row M_i of the misalignment, the angle in inertial space S w dt
//! \[arcsec\], the bias D \[deg/h\], the g-sensitivity s_i \[deg/h/g0\] and the mean specific force f \[g0\],
//!
//! ```text
//! x = M_i . S w dt + (D(U_head) + memory + offset of the visit) T + s_i . f T + random walk           [arcsec]
//! ```

use super::model::Truth;
use super::motion::InertialMotion;
use isotherm_shared::table::Axis;
use isotherm_shared::wire::{AXES, Triad};
use nalgebra::{Matrix3, Vector3};

/// The converters of three sensors. Their state: the charges, and what differs in this visit of a set point.
#[derive(Clone, Debug)]
pub struct SimulatedTriad {
    axes: [Axis; AXES],
    offsets: [VisitOffset; AXES],
    /// Charge that is less than a pulse \[g0*s or arcsec\].
    charge: [f64; AXES],
}

/// Offsets of a sensor that change from one visit of a set point to the next.
#[derive(Clone, Copy, Debug, Default)]
struct VisitOffset {
    /// Of the bias \[g0 or deg/h\].
    bias: f64,
    /// Of K+ and K-, relative.
    scale_factors: [f64; 2],
}

impl SimulatedTriad {
    /// Converters without charge, without offsets.
    #[must_use]
    pub fn new(axes: &[Axis; AXES]) -> Self {
        Self { axes: axes.clone(), offsets: [VisitOffset::default(); AXES], charge: [0.0; AXES] }
    }

    /// Begins a visit of a set point: draws new offsets, which stay until the next visit. `bias` \[g0 or deg/h\] and
    /// `scale_factor` (relative) are standard deviations; `normal` gives Gaussian numbers.
    pub fn visit(&mut self, bias: f64, scale_factor: f64, mut normal: impl FnMut() -> f64) {
        for offset in &mut self.offsets {
            let bias = bias * normal();
            *offset = VisitOffset { bias, scale_factors: [scale_factor * normal(), scale_factor * normal()] };
        }
    }

    /// Bias of a sensor (0 to 2) at the temperature of its head, with the offset of the visit \[g0 or deg/h\].
    #[must_use]
    pub fn bias(&self, axis: usize, head: f64) -> f64 {
        self.axes[axis].bias_at(head).0 + self.offsets[axis].bias
    }

    /// K+ and K- of each converter at the temperature of its board, with the offsets of the visit.
    #[must_use]
    pub fn scale_factors(&self, board: [f64; AXES]) -> [[f64; 2]; AXES] {
        core::array::from_fn(|i| {
            let (axis, [positive, negative]) = (&self.axes[i], self.offsets[i].scale_factors);
            [
                axis.positive_scale_factor_at(board[i]).0 * (1.0 + positive),
                axis.negative_scale_factor_at(board[i]).0 * (1.0 + negative),
            ]
        })
    }

    /// Adds what the sensors indicate \[g0*s or arcsec\] to the charges, and the pulses that follow to `pulses`, at
    /// `scale_factors` K+ and K-.
    pub fn convert(&mut self, indicated: [f64; AXES], scale_factors: &[[f64; 2]; AXES], pulses: &mut Triad) {
        for i in 0..AXES {
            self.charge[i] += indicated[i];
            let [positive, negative] = balance(&mut self.charge[i], scale_factors[i]);
            pulses.positive_pulses[i] = pulses.positive_pulses[i].saturating_add(positive);
            pulses.negative_pulses[i] = pulses.negative_pulses[i].saturating_add(negative);
        }
    }
}

/// Takes all whole pulses out of `charge` \[g0*s or arcsec\] and returns the numbers of positive and negative pulses.
/// K+ > 0 and K- < 0.
fn balance(charge: &mut f64, [positive, negative]: [f64; 2]) -> [u32; 2] {
    let scale_factor = if *charge >= 0.0 { positive } else { negative };
    let pulses = (*charge * scale_factor).floor();
    *charge -= pulses / scale_factor;
    if scale_factor > 0.0 { [pulses as u32, 0] } else { [0, pulses as u32] }
}

/// Three gyroscopes with their converters.
#[derive(Clone, Debug)]
pub struct SimulatedGyroscopes {
    triad: SimulatedTriad,
    misalignment: Matrix3<f64>,
    g_sensitivity: [[f64; AXES]; AXES],
}

impl SimulatedGyroscopes {
    /// The gyroscopes of `truth`; `None` if its table has none.
    #[must_use]
    pub fn of(truth: &Truth) -> Option<Self> {
        let gyroscopes = truth.table.content().gyroscopes.as_ref()?;
        Some(Self {
            triad: SimulatedTriad::new(&gyroscopes.axes),
            misalignment: truth.gyroscope_misalignment(),
            g_sensitivity: gyroscopes.g_sensitivity.map(Option::unwrap_or_default),
        })
    }

    /// Begins a visit of a set point, see [`SimulatedTriad::visit`]: `bias` in deg/h, `scale_factor` relative.
    pub fn visit(&mut self, bias: f64, scale_factor: f64, normal: impl FnMut() -> f64) {
        self.triad.visit(bias, scale_factor, normal);
    }

    /// Adds the pulses of a period of `seconds` with this `motion` to `pulses`. `head` and `board` are the true
    /// temperature; `added` is what random walk and the memory of the biases add \[arcsec\].
    pub fn feel(
        &mut self,
        motion: &InertialMotion,
        seconds: f64,
        [head, board]: [[f64; AXES]; 2],
        added: [f64; AXES],
        pulses: &mut Triad,
    ) {
        let angle = self.misalignment * Vector3::from(motion.angle);
        let force = Vector3::from(motion.specific_force);
        let indicated = core::array::from_fn(|i| {
            let rate = self.triad.bias(i, head[i]) + Vector3::from(self.g_sensitivity[i]).dot(&force);
            angle[i] + rate * seconds + added[i]
        });
        let scale_factors = self.triad.scale_factors(board);
        self.triad.convert(indicated, &scale_factors, pulses);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_converter_gives_whole_pulses_and_keeps_the_rest() {
        let factors = [8.0, -4.0];
        let mut charge = 1.0 + 0.1;
        assert_eq!(balance(&mut charge, factors), [8, 0]);
        assert!((charge - 0.1).abs() < 1e-15);
        // 0.1 is less than a positive pulse of 1/8, and -0.2 less than a negative one of 1/4.
        assert_eq!(balance(&mut charge, factors), [0, 0]);
        charge -= 0.3;
        assert_eq!(balance(&mut charge, factors), [0, 0]);
        charge -= 0.55;
        assert_eq!(balance(&mut charge, factors), [0, 3]);
        assert!(charge.abs() < 1e-15);
    }
}
