//! The motion of the two-axis turntable, and the specific force on the IMU at its angles.
//!
//! # Equations
//! A move from rest to rest over the angle d with the rate v and the acceleration a is a trapezoid of rate over time:
//! up with +-a, on at +-v, down with -+a. One shorter than `v v / a` is a triangle up to the rate sqrt(a |d|). A move
//! takes
//!
//! ```text
//! |d| / v + v / a,   or 2 sqrt(|d| / a) if |d| < v v / a                                                       [s]
//! ```
//! The motion is a list of segments of constant acceleration, each exact for any step h: `angle += rate h + a h h / 2`,
//! `rate += a h`. An axis that gets a new target while it moves comes to rest first.
//!
//! R = Rx(outer) Rz(inner) rotates the body's axes into those of the laboratory. With the base's tilt (tx, ty) the
//! specific force along the body's axes is
//!
//! ```text
//! f = g_local/g0 * R' u,    u = (-ty, tx, 1) / |(-ty, tx, 1)|                                                  [g0]
//! ```

use super::model::Truth;
use core::f64::consts::TAU;
use isotherm_campaign::laboratory_axes;
use isotherm_shared::wire::AXES;
use std::collections::VecDeque;

/// Frequency of the oscillation of a turntable that does not settle \[Hz\].
const SWING_HZ: f64 = 0.7;
/// Time in which an oscillation of this amplitude begins or ceases \[s\].
const SWING_RAMP_S: f64 = 1.0;

/// The specific force \[g0\] along the body's axes at rest at the given angles \[deg\].
#[must_use]
pub fn specific_force(truth: &Truth, outer_deg: f64, inner_deg: f64) -> [f64; AXES] {
    let [x, y, z] = laboratory_axes(outer_deg, inner_deg);
    // The derivatives by (tx, ty) are Y and -X, so the sum is exact.
    let [tx, ty] = truth.tilt_rad;
    let length = (1.0 + tx * tx + ty * ty).sqrt();
    let gravity = truth.gravity_local / truth.table.content().gravity;
    core::array::from_fn(|i| (z[i] + y[i] * tx - x[i] * ty) / length * gravity)
}

/// One axis of a turntable.
#[derive(Clone, Debug, Default)]
struct AxisMotion {
    angle_deg: f64,
    rate_deg_s: f64,
    /// Remaining segments of the motion: time \[s\] and acceleration \[deg/s2\].
    segments: VecDeque<(f64, f64)>,
    /// Angle at the end of the motion; it replaces the integrated angle there, so that rounding errors do not add up.
    target_deg: f64,
}

impl AxisMotion {
    fn stop(&mut self, acceleration: f64) {
        self.segments.clear();
        let time_s = self.rate_deg_s.abs() / acceleration;
        self.target_deg = self.angle_deg + self.rate_deg_s * time_s / 2.0;
        if time_s > 0.0 {
            self.segments.push_back((time_s, -acceleration.copysign(self.rate_deg_s)));
        }
    }

    fn go_to(&mut self, target_deg: f64, rate: f64, acceleration: f64) {
        self.stop(acceleration);
        let distance_deg = target_deg - self.target_deg;
        // A short motion ends before the rate is reached.
        let peak = rate.min((acceleration * distance_deg.abs()).sqrt());
        let (ramp_s, acceleration) = (peak / acceleration, acceleration.copysign(distance_deg));
        if distance_deg != 0.0 {
            let cruise_s = distance_deg.abs() / peak - ramp_s;
            self.segments.extend([(ramp_s, acceleration), (cruise_s.max(0.0), 0.0), (ramp_s, -acceleration)]);
        }
        self.target_deg = target_deg;
    }

    fn wait(&mut self, mut time_s: f64) {
        while let Some((left_s, acceleration)) = self.segments.front_mut() {
            let step = left_s.min(time_s);
            self.angle_deg += self.rate_deg_s * step + *acceleration * step * step / 2.0;
            self.rate_deg_s += *acceleration * step;
            *left_s -= step;
            time_s -= step;
            if *left_s > 0.0 {
                return;
            }
            self.segments.pop_front();
        }
        (self.angle_deg, self.rate_deg_s) = (self.target_deg, 0.0);
    }
}

/// The oscillation of both axes when the turntable does not settle. Its amplitude changes gradually, so that no angle
/// jumps.
#[derive(Clone, Copy, Debug, Default)]
struct Swing {
    /// Amplitude when it was last commanded, and the one commanded \[deg\].
    from_deg: f64,
    to_deg: f64,
    /// Time since it was last commanded \[s\].
    elapsed_s: f64,
    time_s: f64,
}

impl Swing {
    fn command(&mut self, amplitude_deg: f64) {
        *self = Self { from_deg: self.amplitude().0, to_deg: amplitude_deg, elapsed_s: 0.0, ..*self };
    }

    fn wait(&mut self, time_s: f64) {
        self.elapsed_s += time_s;
        self.time_s += time_s;
    }

    /// The amplitude \[deg\] and its rate of change \[deg/s\].
    fn amplitude(&self) -> (f64, f64) {
        if self.elapsed_s >= SWING_RAMP_S {
            return (self.to_deg, 0.0);
        }
        let growth = (self.to_deg - self.from_deg) / SWING_RAMP_S;
        (self.from_deg + growth * self.elapsed_s, growth)
    }

    fn angle_deg(&self) -> f64 {
        self.amplitude().0 * libm::sin(TAU * SWING_HZ * self.time_s)
    }

    fn rate_deg_s(&self) -> f64 {
        let (amplitude, growth) = self.amplitude();
        let (sine, cosine) = libm::sincos(TAU * SWING_HZ * self.time_s);
        growth * sine + amplitude * TAU * SWING_HZ * cosine
    }
}

/// A two-axis turntable; axis 0 is the outer one. It begins at rest with both angles 0.
///
/// ```
/// use isotherm_simulation::SimulatedTurntable;
///
/// let mut turntable = SimulatedTurntable::at([0.0, 0.0]);
/// turntable.go_to(1, 90.0, 10.0, 10.0); // the inner axis to 90 deg, at 10 deg/s and 10 deg/s2
/// turntable.wait(5.0);
/// assert!((turntable.rates_deg_s()[1] - 10.0).abs() < 1e-9);
/// turntable.wait(5.0); // it takes 9 s and 1 s to accelerate and stop
/// assert!((turntable.angles_deg()[1] - 90.0).abs() < 1e-6);
/// ```
#[derive(Clone, Debug, Default)]
pub struct SimulatedTurntable {
    axes: [AxisMotion; 2],
    swing: Swing,
}

impl SimulatedTurntable {
    /// A turntable at rest at outer and inner angle \[deg\].
    #[must_use]
    pub fn at(angles_deg: [f64; 2]) -> Self {
        let axes = angles_deg.map(|angle_deg| AxisMotion { angle_deg, target_deg: angle_deg, ..AxisMotion::default() });
        Self { axes, ..Self::default() }
    }

    /// Moves an axis to `target_deg` at up to `rate` \[deg/s\] with `acceleration` \[deg/s2\]; both must be over 0.
    pub fn go_to(&mut self, axis: usize, target_deg: f64, rate: f64, acceleration: f64) {
        self.axes[axis].go_to(target_deg, rate, acceleration);
    }

    /// Brings an axis to rest with `acceleration` \[deg/s2\], which must be over 0.
    pub fn stop(&mut self, axis: usize, acceleration: f64) {
        self.axes[axis].stop(acceleration);
    }

    /// Makes both axes oscillate with `amplitude_deg` from now on; 0 ends it.
    pub fn swing(&mut self, amplitude_deg: f64) {
        self.swing.command(amplitude_deg);
    }

    /// Advances by `time_s` \[s\].
    pub fn wait(&mut self, time_s: f64) {
        self.swing.wait(time_s);
        self.axes.iter_mut().for_each(|axis| axis.wait(time_s));
    }

    /// Outer and inner angle \[deg\].
    #[must_use]
    pub fn angles_deg(&self) -> [f64; 2] {
        let swing = self.swing.angle_deg();
        [0, 1].map(|axis| self.axes[axis].angle_deg + swing)
    }

    /// Outer and inner rate \[deg/s\].
    #[must_use]
    pub fn rates_deg_s(&self) -> [f64; 2] {
        let swing = self.swing.rate_deg_s();
        [0, 1].map(|axis| self.axes[axis].rate_deg_s + swing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_takes_the_time_that_rate_and_acceleration_require() {
        let mut turntable = SimulatedTurntable::default();
        turntable.go_to(0, 90.0, 10.0, 5.0);
        turntable.go_to(1, -1.0, 10.0, 4.0);
        // 2 s up, 20 deg of ramps, 70 deg at 10 deg/s, 2 s down; and 0.5 s up to 2 deg/s, 0.5 s down.
        turntable.wait(0.5);
        assert_eq!(turntable.rates_deg_s(), [2.5, -2.0]);
        turntable.wait(0.5);
        assert_eq!((turntable.angles_deg()[1], turntable.rates_deg_s()[1]), (-1.0, 0.0));
        turntable.wait(9.99);
        assert!(turntable.angles_deg()[0] < 90.0 && turntable.rates_deg_s()[0] > 0.0);
        turntable.wait(0.02);
        assert_eq!((turntable.angles_deg(), turntable.rates_deg_s()), ([90.0, -1.0], [0.0, 0.0]));
    }

    #[test]
    fn the_step_length_does_not_matter_and_another_target_is_reached_from_a_moving_axis() {
        let (mut one, mut many) = (SimulatedTurntable::default(), SimulatedTurntable::default());
        for turntable in [&mut one, &mut many] {
            turntable.go_to(0, 90.0, 10.0, 5.0);
        }
        one.wait(3.7);
        (0..3700).for_each(|_| many.wait(0.001));
        for turntable in [&mut one, &mut many] {
            turntable.go_to(0, -20.0, 20.0, 5.0);
        }
        one.wait(6.1);
        (0..6100).for_each(|_| many.wait(0.001));
        assert!((one.angles_deg()[0] - many.angles_deg()[0]).abs() < 1e-9);
        one.stop(0, 500.0);
        one.wait(10.0);
        assert!(one.rates_deg_s()[0] == 0.0 && one.angles_deg()[0] > -20.0);
        one.go_to(0, -20.0, 20.0, 5.0);
        one.wait(100.0);
        assert_eq!(one.angles_deg()[0], -20.0);
        one.swing(0.05);
        one.wait(1.5);
        let amplitude = libm::hypot(one.angles_deg()[0] + 20.0, one.rates_deg_s()[1] / (TAU * SWING_HZ));
        assert!((amplitude - 0.05).abs() < 1e-9, "{amplitude}");
    }

    /// A turn of 720 degrees: 1 s up, 71 s at 10 deg/s, 1 s down.
    #[test]
    fn a_turn_has_angle_and_rate_at_any_time_and_a_stop_interrupts_it() {
        let mut turntable = SimulatedTurntable::default();
        let near = |found: f64, right: f64| assert!((found - right).abs() < 1e-9, "{found} {right}");
        let mut now_s = 0.0;
        let mut at = |turntable: &mut SimulatedTurntable, time_s: f64, angle_deg: f64, rate_deg_s: f64| {
            turntable.wait(time_s - now_s);
            now_s = time_s;
            near(turntable.angles_deg()[0], angle_deg);
            near(turntable.rates_deg_s()[0], rate_deg_s);
        };
        turntable.go_to(0, 720.0, 10.0, 10.0);
        for (time_s, angle_deg, rate_deg_s) in [
            (0.5, 1.25, 5.0),
            (1.0, 5.0, 10.0),
            (36.5, 360.0, 10.0),
            (72.0, 715.0, 10.0),
            (72.5, 718.75, 5.0),
            (73.0, 720.0, 0.0),
            (90.0, 720.0, 0.0),
        ] {
            at(&mut turntable, time_s, angle_deg, rate_deg_s);
        }
        turntable.go_to(0, 0.0, 10.0, 10.0);
        at(&mut turntable, 126.5, 360.0, -10.0);
        // It brakes from 10 deg/s within 0.2 s and 1 degree, and then goes on from there.
        turntable.stop(0, 50.0);
        at(&mut turntable, 126.6, 359.25, -5.0);
        at(&mut turntable, 126.7, 359.0, 0.0);
        at(&mut turntable, 130.0, 359.0, 0.0);
        turntable.go_to(0, 0.0, 10.0, 10.0);
        at(&mut turntable, 166.9, 0.0, 0.0);
        assert_eq!((turntable.angles_deg(), turntable.rates_deg_s()), ([0.0; 2], [0.0; 2]));
    }

    #[test]
    fn an_oscillation_begins_and_ends_without_a_jump() {
        let mut turntable = SimulatedTurntable::default();
        let mut before = [0.0; 2];
        for step in 0..400 {
            match step {
                137 => turntable.swing(0.05),
                211 => turntable.swing(0.0),
                _ => {}
            }
            turntable.wait(0.01);
            let after = turntable.angles_deg();
            let rate = turntable.rates_deg_s()[0];
            assert!((after[0] - before[0] - rate * 0.01).abs() < 1e-3, "{step}: {before:?} {after:?} {rate}");
            before = after;
        }
        assert_eq!(turntable.angles_deg(), [0.0; 2]);
    }
}
