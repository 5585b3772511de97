//! What the IMU feels over a period, while the turntable stands or moves.
//!
//! # Equations
//! R = Rx(outer) Rz(inner) rotates the IMU's axes into those of the base. Earth's rate w and the specific force f are
//! constant in the base; in the IMU they are R' w and R' f. With the rates of the turntable's axes,
//!
//! ```text
//! angle          = S ( outer' (cos(inner), -sin(inner), 0) + inner' (0, 0, 1) + R' w ) dt            [arcsec]
//! specific force = 1/T S R' f dt                                                                     [g0]
//! ```
//! Both are summed over steps of at most 50 ms, with Simpson's rule; an outer angle is a parabola within a step. What
//! the turntable turns by is exact where one axis moves at a time.

use super::model::Truth;
use super::turntable::specific_force;
use isotherm_campaign::{laboratory_axes, outer_axis};
use isotherm_shared::wire::AXES;
use nalgebra::{Matrix3, Vector3};

/// Longest step of the integration \[s\].
const STEP_S: f64 = 0.05;

/// What the IMU feels over a period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InertialMotion {
    /// Angle about each of the IMU's axes in inertial space, right-handed: the integral of the rate over the period
    /// \[arcsec\].
    pub angle: [f64; AXES],
    /// Mean specific force along each of the IMU's axes \[g0\].
    pub specific_force: [f64; AXES],
}

impl InertialMotion {
    /// A specific force \[g0\] without any rotation, for an IMU without gyroscopes.
    #[must_use]
    pub const fn of_force(specific_force: [f64; AXES]) -> Self {
        Self { angle: [0.0; AXES], specific_force }
    }

    /// At rest at outer and inner angle \[deg\] for `seconds`: Earth's rate and gravity.
    #[must_use]
    pub fn at_rest(truth: &Truth, angles_deg: [f64; 2], seconds: f64) -> Self {
        let [outer, inner] = angles_deg;
        Self {
            angle: (earth_rate(truth, angles_deg) * seconds).into(),
            specific_force: specific_force(truth, outer, inner),
        }
    }

    /// The same along the axes of an IMU that is mounted with this rotation: along its axes all is `mounting` times
    /// that along the turntable's.
    #[must_use]
    pub fn mounted(self, mounting: &Matrix3<f64>) -> Self {
        let turned = |vector: [f64; AXES]| (mounting * Vector3::from(vector)).into();
        Self { angle: turned(self.angle), specific_force: turned(self.specific_force) }
    }

    /// On the moving turntable for `seconds`.
    ///
    /// `angles_deg` gives outer and inner angle \[deg\] at a time of the period \[s\]. It is called with rising times,
    /// once for each, from 0 to `seconds`; so it may move a simulated turntable. Angles go on over a whole turn: one
    /// from 0 to 720 is twice around. At rest the result is that of [`at_rest`](Self::at_rest).
    #[must_use]
    pub fn over(truth: &Truth, seconds: f64, mut angles_deg: impl FnMut(f64) -> [f64; 2]) -> Self {
        // At least one step. Half steps are counted, so that the last time is the end exactly.
        let steps = (seconds / STEP_S).ceil().max(1.0);
        let mut at = |half_steps: f64| angles_deg(seconds * (half_steps / (2.0 * steps)));
        let first = at(0.0);
        let (mut begin, mut moves) = (first, false);
        let (mut turned, mut earth, mut force) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        for step in 0..steps as u64 {
            let middle = at(2.0 * step as f64 + 1.0);
            let end = at(2.0 * step as f64 + 2.0);
            moves |= middle != first || end != first;
            let mean = |of: &dyn Fn([f64; 2]) -> Vector3<f64>| (of(begin) + of(middle) * 4.0 + of(end)) / 6.0;
            // What the outer axis would turn by at its rate at the beginning, in the middle and at the end, from the
            // parabola through its angles.
            let outer = [
                4.0 * middle[0] - 3.0 * begin[0] - end[0],
                end[0] - begin[0],
                begin[0] - 4.0 * middle[0] + 3.0 * end[0],
            ];
            let axes = [begin, middle, end].map(|[_, inner]| outer_axis(inner));
            turned += (axes[0] * outer[0] + axes[1] * (4.0 * outer[1]) + axes[2] * outer[2]) * (3600.0 / 6.0);
            turned.z += (end[1] - begin[1]) * 3600.0;
            earth += mean(&|angles| earth_rate(truth, angles));
            force += mean(&|[outer, inner]| specific_force(truth, outer, inner).into());
            begin = end;
        }
        if !moves {
            return Self::at_rest(truth, first, seconds);
        }
        Self { angle: (turned + earth * (seconds / steps)).into(), specific_force: (force / steps).into() }
    }
}

/// Earth's rate along the IMU's axes \[deg/h\], which is arcsec/s.
fn earth_rate(truth: &Truth, [outer, inner]: [f64; 2]) -> Vector3<f64> {
    let rate = truth.earth_rate();
    laboratory_axes(outer, inner).into_iter().zip(rate).map(|(axis, rate)| Vector3::from(axis) * rate).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{MISALIGNMENT, TILT_RAD};
    use crate::turntable::SimulatedTurntable;
    use isotherm_campaign::EARTH_RATE;
    use isotherm_shared::table::CoefficientTable;

    fn truth() -> Truth {
        let table = include_str!("../../../examples/tables/imu-paper.toml");
        let table = CoefficientTable::from_toml(table, None).unwrap();
        Truth::new(table.content().clone(), MISALIGNMENT, TILT_RAD, 9.81).unwrap()
    }

    /// The motion over a whole movement of the turntable, in periods of `period_s`, and the time that it takes \[s\].
    fn moved(truth: &Truth, targets: &[(usize, f64)], start: [f64; 2], period_s: f64, periods: u32) -> InertialMotion {
        let mut turntable = SimulatedTurntable::at(start);
        for (axis, target) in targets {
            turntable.go_to(*axis, *target, 10.0, 10.0);
        }
        let mut sum = InertialMotion::default();
        for _ in 0..periods {
            let mut now = 0.0;
            let motion = InertialMotion::over(truth, period_s, |t| {
                turntable.wait(t - now);
                now = t;
                turntable.angles_deg()
            });
            for i in 0..AXES {
                sum.angle[i] += motion.angle[i];
                sum.specific_force[i] += motion.specific_force[i] * period_s;
            }
        }
        assert_eq!(turntable.rates_deg_s(), [0.0; 2]);
        sum
    }

    #[test]
    fn a_turn_is_its_angle_and_what_the_base_holds_turns_backwards() {
        let truth = truth();
        let (tilted, earth) = (Truth { tilt_rad: [4e-4, -3e-4], ..truth.clone() }, Vector3::from(truth.earth_rate()));
        assert!((earth.norm() - EARTH_RATE).abs() < 1e-12);
        // 80 s of which the turntable moves 37 s or 73 s: accelerating 1 s, at 10 deg/s, decelerating 1 s.
        for (axis, start, own, sign) in
            [(0, [0.0, 0.0], 0, 1.0), (0, [0.0, 90.0], 1, -1.0), (1, [0.0, 0.0], 2, 1.0), (1, [90.0, 0.0], 2, 1.0)]
        {
            for (angle, truth) in [(360.0, &truth), (-720.0, &truth), (360.0, &tilted), (90.0, &tilted)] {
                let motion = moved(truth, &[(axis, start[axis] + angle)], start, 1.0, 80);
                // J of the method: T k (k.v) + Ic (v - k (k.v)) - Is (k x v), with the integrals of cosine and sine
                // over the profile.
                let [ic, is] = cosine_and_sine(angle, 80.0);
                let mut k = Vector3::zeros();
                k[own] = sign;
                let backwards = |v: Vector3<f64>| {
                    let along = k * k.dot(&v);
                    along * 80.0 + (v - along) * ic - k.cross(&v) * is
                };
                let turned = k * (angle * 3600.0) + backwards(earth_rate(truth, start));
                let force = backwards(specific_force(truth, start[0], start[1]).into());
                let off = [
                    (Vector3::from(motion.angle) - turned).norm() / (angle.abs() * 3600.0),
                    (Vector3::from(motion.specific_force) - force).norm() / 80.0,
                ];
                assert!(off[0] < 1e-9 && off[1] < 1e-9, "{axis} {start:?} {angle}: {off:?}");
            }
        }
    }

    /// The integrals of cosine and sine of the angle so far over `seconds`, for a turn by `angle` \[deg\] from rest
    /// that begins at once.
    fn cosine_and_sine(angle: f64, seconds: f64) -> [f64; 2] {
        let motion_s = angle.abs() / 10.0 + 1.0;
        let so_far = |t: f64| {
            let size = if t < 1.0 {
                5.0 * t * t
            } else if t < motion_s - 1.0 {
                10.0 * t - 5.0
            } else {
                angle.abs() - 5.0 * (motion_s - t).max(0.0).powi(2)
            };
            (size * angle.signum()).to_radians()
        };
        // The midpoint rule, in steps of 0.5 ms.
        let steps = (seconds * 2000.0) as u32;
        (0..steps)
            .map(|step| libm::sincos(so_far((f64::from(step) + 0.5) / 2000.0)))
            .fold([0.0; 2], |[ic, is], (sine, cosine)| [ic + cosine / 2000.0, is + sine / 2000.0])
    }

    #[test]
    fn at_rest_and_both_axes_at_once() {
        let truth = truth();
        // To the last bit, so that a turntable that stands gives what a position gives.
        assert_eq!(
            InertialMotion::over(&truth, 10.0, |_| [45.0, 30.0]),
            InertialMotion::at_rest(&truth, [45.0, 30.0], 10.0)
        );
        assert_eq!(
            InertialMotion::at_rest(&truth, [45.0, 30.0], 1.0).specific_force,
            specific_force(&truth, 45.0, 30.0)
        );
        // The steps are short enough: half as long they give the same.
        let targets = [(0, 90.0), (1, 270.0)];
        let whole = moved(&truth, &targets, [0.0, 0.0], 1.0, 40);
        let short = moved(&truth, &targets, [0.0, 0.0], 0.02, 2000);
        for i in 0..AXES {
            assert!((whole.angle[i] - short.angle[i]).abs() < 1e-7 * 360.0 * 3600.0, "{whole:?} {short:?}");
            assert!((whole.specific_force[i] - short.specific_force[i]).abs() < 1e-6, "{whole:?} {short:?}");
        }
    }

    #[test]
    fn earths_rate_has_latitude_and_heading() {
        let at = |latitude_deg, heading_deg| {
            Truth { latitude_deg, heading_deg, tilt_rad: [0.0; 2], ..truth() }
                .earth_rate()
                .map(|rate| rate / EARTH_RATE)
        };
        let close = |rate: [f64; 3], right: [f64; 3]| rate.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(at(90.0, 77.0), [0.0, 0.0, 1.0]) && close(at(-90.0, 77.0), [0.0, 0.0, -1.0]));
        // X to the north; X to the east has north along Y.
        assert!(close(at(0.0, 0.0), [1.0, 0.0, 0.0]) && close(at(0.0, 90.0), [0.0, 1.0, 0.0]));
        let half = 0.5_f64.sqrt();
        assert!(close(at(-45.0, 180.0), [-half, 0.0, -half]));
    }
}
