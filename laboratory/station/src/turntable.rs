//! The simulated turntable and its controller: two axes with interlocks.

use super::faults::InjectedFault;
use super::link::DeviceEvent;
use super::wire;
use isotherm_simulation::SimulatedTurntable;

/// Acceleration of a stop \[deg/s2\].
const STOP_DEG_S2: f64 = 50.0;
/// Amplitude of a turntable that does not settle \[deg\].
const SWING_DEG: f64 = 0.05;
/// Highest angle \[deg\], rate \[deg/s\] and acceleration \[deg/s2\].
pub(crate) const LIMITS: [f64; 3] = [720.0, 200.0, 500.0];

/// State of an axis's interlock.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(crate) enum Interlock {
    /// The axis has no power.
    #[default]
    Open,
    /// The axis has power.
    Closed,
    /// The axis has no power until the fault is reset.
    Fault,
}

/// The turntable with its controller.
#[derive(Default)]
pub(crate) struct TurntableDevice {
    turntable: SimulatedTurntable,
    /// Whether it takes and shows angles modulo 360 degrees.
    wrap: bool,
    now_s: f64,
    swings: bool,
    alarm: bool,
    interlocks: [Interlock; 2],
    events: Vec<(f64, DeviceEvent)>,
}

impl TurntableDevice {
    /// A turntable at rest at both angles 0. With `wrap` it takes angles modulo 360 degrees, goes the shorter way, and
    /// shows angles from 0 to 360.
    pub(crate) fn new(wrap: bool) -> Self {
        Self { wrap, ..Self::default() }
    }

    /// Angle of an axis as the controller shows it \[deg\].
    pub(crate) fn angle_deg(&self, axis: usize) -> f64 {
        let angle_deg = self.turntable.angles_deg()[axis];
        if self.wrap { angle_deg.rem_euclid(360.0) } else { angle_deg }
    }

    /// Rate of an axis \[deg/s\].
    pub(crate) fn rate_deg_s(&self, axis: usize) -> f64 {
        self.turntable.rates_deg_s()[axis]
    }

    /// State of an axis's interlock.
    pub(crate) const fn interlock(&self, axis: usize) -> Interlock {
        self.interlocks[axis]
    }

    /// Resets the fault of an axis, if its cause no longer exists.
    pub(crate) fn reset(&mut self, axis: usize) {
        if !self.alarm && self.interlocks[axis] == Interlock::Fault {
            self.interlocks[axis] = Interlock::Open;
        }
    }

    /// Powers an axis; returns `false` if it has a fault.
    pub(crate) fn close(&mut self, axis: usize) -> bool {
        if self.interlocks[axis] != Interlock::Fault {
            self.interlocks[axis] = Interlock::Closed;
        }
        self.interlocks[axis] == Interlock::Closed
    }

    /// Stops an axis and switches its power off.
    pub(crate) fn open(&mut self, axis: usize) {
        self.stop(axis);
        if self.interlocks[axis] == Interlock::Closed {
            self.interlocks[axis] = Interlock::Open;
        }
    }

    /// Starts a move of an axis. Returns `false` if it has no power or the move exceeds the limits.
    pub(crate) fn go_to(&mut self, axis: usize, angle_deg: f64, rate: f64, acceleration: f64) -> bool {
        let [max_angle, max_rate, max_acceleration] = LIMITS;
        let possible = angle_deg.abs() <= max_angle && (1e-3..=max_rate).contains(&rate);
        if self.interlocks[axis] != Interlock::Closed || !possible || !(1e-3..=max_acceleration).contains(&acceleration)
        {
            return false;
        }
        let angle_deg = if self.wrap { nearest(angle_deg, self.turntable.angles_deg()[axis]) } else { angle_deg };
        self.turntable.go_to(axis, angle_deg, rate, acceleration);
        self.events.push((self.now_s, DeviceEvent::GoTo { axis, angle_deg, rate, acceleration }));
        true
    }

    /// Brings an axis to rest.
    pub(crate) fn stop(&mut self, axis: usize) {
        self.turntable.stop(axis, STOP_DEG_S2);
        self.events.push((self.now_s, DeviceEvent::Stop { axis, acceleration: STOP_DEG_S2 }));
    }
}

/// The angle nearest to `from_deg` that is `angle_deg` modulo 360 \[deg\]. If two are as near, it is the higher one.
fn nearest(angle_deg: f64, from_deg: f64) -> f64 {
    angle_deg + 360.0 * ((from_deg - angle_deg) / 360.0 + 0.5).floor()
}

impl wire::SimulatedDevice for TurntableDevice {
    fn advance(&mut self, now_s: f64, active: &[InjectedFault]) {
        if now_s > self.now_s {
            self.turntable.wait(now_s - self.now_s);
            self.now_s = now_s;
        }
        let swings = active.contains(&InjectedFault::NoSettle);
        if swings != self.swings {
            self.swings = swings;
            let amplitude_deg = if swings { SWING_DEG } else { 0.0 };
            self.turntable.swing(amplitude_deg);
            self.events.push((self.now_s, DeviceEvent::Swing { amplitude_deg }));
        }
        let alarm = active.contains(&InjectedFault::Alarm);
        if alarm && !self.alarm {
            for axis in [0, 1] {
                self.stop(axis);
                self.interlocks[axis] = Interlock::Fault;
            }
        }
        self.alarm = alarm;
    }

    fn events(&mut self) -> Vec<(f64, DeviceEvent)> {
        std::mem::take(&mut self.events)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::SimulatedDevice as _;

    /// The angle that the controller shows, and the one that the axis has, after each command.
    #[test]
    fn a_table_that_wraps_goes_the_shorter_way() {
        let mut device = TurntableDevice::new(true);
        assert!(device.close(0));
        let mut now_s = 0.0;
        for (commanded_deg, turned_deg) in [
            (120.0, 120.0),
            (240.0, 240.0),
            (0.0, 360.0),
            (359.0, 359.0),
            (90.0, 450.0),
            (270.0, 630.0),
            (-91.0, 629.0),
        ] {
            assert!(device.go_to(0, commanded_deg, 10.0, 10.0));
            now_s += 60.0;
            device.advance(now_s, &[]);
            let Some((_, DeviceEvent::GoTo { angle_deg, .. })) = device.events().pop() else { panic!("no move") };
            assert_eq!((angle_deg, device.turntable.angles_deg()[0]), (turned_deg, turned_deg));
            assert_eq!(device.angle_deg(0), turned_deg.rem_euclid(360.0));
        }
    }
}
