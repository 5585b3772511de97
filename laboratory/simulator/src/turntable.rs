//! The simulated table: two axes with interlocks.

use super::faults::What;
use super::link::Event;
use super::server;
use isotherm_calibration::simulate::SimulatedTurntable;

/// Acceleration of a stop that nobody has chosen \[deg/s2\].
const STOP_DEG_S2: f64 = 50.0;
/// How far a table that does not settle swings \[deg\].
const SWING_DEG: f64 = 0.05;
/// What it can do \[deg\], \[deg/s\], \[deg/s2\].
pub const MOST: [f64; 3] = [720.0, 200.0, 500.0];

/// State of an axis's interlock.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Interlock {
    /// No power.
    #[default]
    Open,
    /// Power.
    Closed,
    /// No power until it is reset.
    Fault,
}

/// Table and controller.
#[derive(Default)]
pub struct TurntableMachine {
    turntable: SimulatedTurntable,
    now_s: f64,
    swings: bool,
    alarm: bool,
    interlocks: [Interlock; 2],
    events: Vec<(f64, Event)>,
}

impl TurntableMachine {
    /// \[deg\]
    pub fn angle_deg(&self, axis: usize) -> f64 {
        self.turntable.angles_deg()[axis]
    }

    /// \[deg/s\]
    pub fn rate_deg_s(&self, axis: usize) -> f64 {
        self.turntable.rates_deg_s()[axis]
    }

    /// Of an axis.
    pub const fn interlock(&self, axis: usize) -> Interlock {
        self.interlocks[axis]
    }

    /// Ends a fault whose cause has gone.
    pub fn reset(&mut self, axis: usize) {
        if !self.alarm && self.interlocks[axis] == Interlock::Fault {
            self.interlocks[axis] = Interlock::Open;
        }
    }

    /// Powers an axis; `false` if it has a fault.
    pub fn close(&mut self, axis: usize) -> bool {
        if self.interlocks[axis] != Interlock::Fault {
            self.interlocks[axis] = Interlock::Closed;
        }
        self.interlocks[axis] == Interlock::Closed
    }

    /// Takes the power off an axis.
    pub fn open(&mut self, axis: usize) {
        self.stop(axis);
        if self.interlocks[axis] == Interlock::Closed {
            self.interlocks[axis] = Interlock::Open;
        }
    }

    /// Sends an axis somewhere; `false` if it has no power or cannot.
    pub fn go_to(&mut self, axis: usize, angle_deg: f64, rate: f64, acceleration: f64) -> bool {
        let [angle, most_rate, most_acceleration] = MOST;
        let able = angle_deg.abs() <= angle && (1e-3..=most_rate).contains(&rate);
        if self.interlocks[axis] != Interlock::Closed || !able || !(1e-3..=most_acceleration).contains(&acceleration) {
            return false;
        }
        self.turntable.go_to(axis, angle_deg, rate, acceleration);
        self.events.push((self.now_s, Event::GoTo { axis, angle_deg, rate, acceleration }));
        true
    }

    /// Brings an axis to rest.
    pub fn stop(&mut self, axis: usize) {
        self.turntable.stop(axis, STOP_DEG_S2);
        self.events.push((self.now_s, Event::Stop { axis, acceleration: STOP_DEG_S2 }));
    }
}

impl server::Machine for TurntableMachine {
    fn advance(&mut self, now_s: f64, active: &[What]) {
        if now_s > self.now_s {
            self.turntable.wait(now_s - self.now_s);
            self.now_s = now_s;
        }
        let swings = active.contains(&What::NoSettle);
        if swings != self.swings {
            self.swings = swings;
            let amplitude_deg = if swings { SWING_DEG } else { 0.0 };
            self.turntable.swing(amplitude_deg);
            self.events.push((self.now_s, Event::Swing { amplitude_deg }));
        }
        let alarm = active.contains(&What::Alarm);
        if alarm && !self.alarm {
            for axis in [0, 1] {
                self.stop(axis);
                self.interlocks[axis] = Interlock::Fault;
            }
        }
        self.alarm = alarm;
    }

    fn events(&mut self) -> Vec<(f64, Event)> {
        std::mem::take(&mut self.events)
    }
}
