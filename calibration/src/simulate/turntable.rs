//! The two-axis turntable in motion, and the specific force that it gives the IMU.
//!
//! # Equations
//! An axis accelerates with +-a up to the rate v and comes to rest at its target: a list of stretches of constant acceleration, each
//! exact for any step h, `angle += rate h + a h h / 2`, `rate += a h`. One that is moving when it is sent elsewhere comes to rest first.
//!
//! At the outer and inner angles R = Rx(outer) Rz(inner) turns body into laboratory, and with the base's tilt (tx, ty) the specific force
//! along the body's axes is
//!
//! ```text
//! f = g_local/g0 * R' u,    u = (-ty, tx, 1) / |(-ty, tx, 1)|                                                  [g0]
//! ```

use super::Truth;
use crate::positions::Position;
use core::f64::consts::TAU;
use isotherm_shared::wire::AXES;
use std::collections::VecDeque;

/// Frequency at which a table that does not settle swings \[Hz\].
const SWING_HZ: f64 = 0.7;

/// The specific force \[g0\] along the body's axes at rest, at the angles \[deg\].
#[must_use]
pub fn specific_force(truth: &Truth, outer_deg: f64, inner_deg: f64) -> [f64; AXES] {
    let there = Position::at(0, outer_deg, inner_deg);
    // The derivatives by (tx, ty) are R's second and minus its first row: exact, not to first order.
    let by_tilt = there.by_tilt().unwrap_or_default();
    let [tx, ty] = truth.tilt_rad;
    let length = (1.0 + tx * tx + ty * ty).sqrt();
    let gravity = truth.gravity_local / truth.table.content().gravity;
    core::array::from_fn(|i| (there.specific_force[i] + by_tilt[i][0] * tx + by_tilt[i][1] * ty) / length * gravity)
}

/// One axis of a turntable.
#[derive(Clone, Debug, Default)]
struct AxisMotion {
    angle_deg: f64,
    rate_deg_s: f64,
    /// Left of the way: time \[s\] and acceleration \[deg/s2\].
    stretches: VecDeque<(f64, f64)>,
    /// Where the way ends, so that rounding does not add up.
    target_deg: f64,
}

impl AxisMotion {
    fn stop(&mut self, acceleration: f64) {
        self.stretches.clear();
        let time_s = self.rate_deg_s.abs() / acceleration;
        self.target_deg = self.angle_deg + self.rate_deg_s * time_s / 2.0;
        if time_s > 0.0 {
            self.stretches.push_back((time_s, -acceleration.copysign(self.rate_deg_s)));
        }
    }

    fn go_to(&mut self, target_deg: f64, rate: f64, acceleration: f64) {
        self.stop(acceleration);
        let way = target_deg - self.target_deg;
        // A short way is over before the rate is reached.
        let peak = rate.min((acceleration * way.abs()).sqrt());
        let (ramp_s, acceleration) = (peak / acceleration, acceleration.copysign(way));
        if way != 0.0 {
            let cruise_s = way.abs() / peak - ramp_s;
            self.stretches.extend([(ramp_s, acceleration), (cruise_s.max(0.0), 0.0), (ramp_s, -acceleration)]);
        }
        self.target_deg = target_deg;
    }

    fn wait(&mut self, mut time_s: f64) {
        while let Some((left_s, acceleration)) = self.stretches.front_mut() {
            let step = left_s.min(time_s);
            self.angle_deg += self.rate_deg_s * step + *acceleration * step * step / 2.0;
            self.rate_deg_s += *acceleration * step;
            *left_s -= step;
            time_s -= step;
            if *left_s > 0.0 {
                return;
            }
            self.stretches.pop_front();
        }
        (self.angle_deg, self.rate_deg_s) = (self.target_deg, 0.0);
    }
}

/// A two-axis turntable; axis 0 is the outer one. It begins at rest at 0, 0.
#[derive(Clone, Debug, Default)]
pub struct SimulatedTurntable {
    axes: [AxisMotion; 2],
    swing_deg: f64,
    time_s: f64,
}

impl SimulatedTurntable {
    /// Sends an axis to `target_deg` at up to `rate` \[deg/s\] with `acceleration` \[deg/s2\], both over 0.
    pub fn go_to(&mut self, axis: usize, target_deg: f64, rate: f64, acceleration: f64) {
        self.axes[axis].go_to(target_deg, rate, acceleration);
    }

    /// Brings an axis to rest with `acceleration` \[deg/s2\], over 0.
    pub fn stop(&mut self, axis: usize, acceleration: f64) {
        self.axes[axis].stop(acceleration);
    }

    /// From now on both axes swing by `amplitude_deg`; 0 for not at all.
    pub fn swing(&mut self, amplitude_deg: f64) {
        self.swing_deg = amplitude_deg;
    }

    /// Lets `time_s` pass.
    pub fn wait(&mut self, time_s: f64) {
        self.time_s += time_s;
        self.axes.iter_mut().for_each(|axis| axis.wait(time_s));
    }

    /// Outer and inner angle \[deg\].
    #[must_use]
    pub fn angles_deg(&self) -> [f64; 2] {
        let swing = self.swing_deg * (TAU * SWING_HZ * self.time_s).sin();
        [0, 1].map(|axis| self.axes[axis].angle_deg + swing)
    }

    /// Outer and inner rate \[deg/s\].
    #[must_use]
    pub fn rates_deg_s(&self) -> [f64; 2] {
        let swing = self.swing_deg * TAU * SWING_HZ * (TAU * SWING_HZ * self.time_s).cos();
        [0, 1].map(|axis| self.axes[axis].rate_deg_s + swing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_takes_the_time_that_rate_and_acceleration_ask_for() {
        let mut table = SimulatedTurntable::default();
        table.go_to(0, 90.0, 10.0, 5.0);
        table.go_to(1, -1.0, 10.0, 4.0);
        // 2 s up, 20 deg of ramps, 70 deg at 10 deg/s, 2 s down; and 0.5 s up to 2 deg/s, 0.5 s down.
        table.wait(0.5);
        assert_eq!(table.rates_deg_s(), [2.5, -2.0]);
        table.wait(0.5);
        assert_eq!((table.angles_deg()[1], table.rates_deg_s()[1]), (-1.0, 0.0));
        table.wait(9.99);
        assert!(table.angles_deg()[0] < 90.0 && table.rates_deg_s()[0] > 0.0);
        table.wait(0.02);
        assert_eq!((table.angles_deg(), table.rates_deg_s()), ([90.0, -1.0], [0.0, 0.0]));
    }

    #[test]
    fn the_step_length_does_not_matter_and_another_target_is_reached_from_a_moving_axis() {
        let (mut one, mut many) = (SimulatedTurntable::default(), SimulatedTurntable::default());
        for table in [&mut one, &mut many] {
            table.go_to(0, 90.0, 10.0, 5.0);
        }
        one.wait(3.7);
        (0..3700).for_each(|_| many.wait(0.001));
        for table in [&mut one, &mut many] {
            table.go_to(0, -20.0, 20.0, 5.0);
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
        one.wait(0.3);
        assert!((one.angles_deg()[0] + 20.0).abs() > 0.01 && one.rates_deg_s()[1].abs() > 0.01);
    }
}
