//! The simulated turntable and its controller: two axes with interlocks.

use super::faults::InjectedFault;
use super::link::DeviceEvent;
use super::server;
use isotherm_calibration::simulate::SimulatedTurntable;

/// Acceleration of a stop \[deg/s2\].
const STOP_DEG_S2: f64 = 50.0;
/// Amplitude of a turntable that does not settle \[deg\].
const SWING_DEG: f64 = 0.05;
/// Highest angle \[deg\], rate \[deg/s\] and acceleration \[deg/s2\].
pub const LIMITS: [f64; 3] = [720.0, 200.0, 500.0];

/// State of an axis's interlock.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Interlock {
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
pub struct TurntableDevice {
    turntable: SimulatedTurntable,
    now_s: f64,
    swings: bool,
    alarm: bool,
    interlocks: [Interlock; 2],
    events: Vec<(f64, DeviceEvent)>,
}

impl TurntableDevice {
    /// Angle of an axis \[deg\].
    pub fn angle_deg(&self, axis: usize) -> f64 {
        self.turntable.angles_deg()[axis]
    }

    /// Rate of an axis \[deg/s\].
    pub fn rate_deg_s(&self, axis: usize) -> f64 {
        self.turntable.rates_deg_s()[axis]
    }

    /// State of an axis's interlock.
    pub const fn interlock(&self, axis: usize) -> Interlock {
        self.interlocks[axis]
    }

    /// Resets the fault of an axis, if its cause no longer exists.
    pub fn reset(&mut self, axis: usize) {
        if !self.alarm && self.interlocks[axis] == Interlock::Fault {
            self.interlocks[axis] = Interlock::Open;
        }
    }

    /// Powers an axis; returns `false` if it has a fault.
    pub fn close(&mut self, axis: usize) -> bool {
        if self.interlocks[axis] != Interlock::Fault {
            self.interlocks[axis] = Interlock::Closed;
        }
        self.interlocks[axis] == Interlock::Closed
    }

    /// Stops an axis and switches its power off.
    pub fn open(&mut self, axis: usize) {
        self.stop(axis);
        if self.interlocks[axis] == Interlock::Closed {
            self.interlocks[axis] = Interlock::Open;
        }
    }

    /// Starts a move of an axis. Returns `false` if it has no power or the move exceeds the limits.
    pub fn go_to(&mut self, axis: usize, angle_deg: f64, rate: f64, acceleration: f64) -> bool {
        let [max_angle, max_rate, max_acceleration] = LIMITS;
        let possible = angle_deg.abs() <= max_angle && (1e-3..=max_rate).contains(&rate);
        if self.interlocks[axis] != Interlock::Closed || !possible || !(1e-3..=max_acceleration).contains(&acceleration)
        {
            return false;
        }
        self.turntable.go_to(axis, angle_deg, rate, acceleration);
        self.events.push((self.now_s, DeviceEvent::GoTo { axis, angle_deg, rate, acceleration }));
        true
    }

    /// Brings an axis to rest.
    pub fn stop(&mut self, axis: usize) {
        self.turntable.stop(axis, STOP_DEG_S2);
        self.events.push((self.now_s, DeviceEvent::Stop { axis, acceleration: STOP_DEG_S2 }));
    }
}

impl server::SimulatedDevice for TurntableDevice {
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
