//! The simulated chamber and its controller.

use super::faults::InjectedFault;
use super::link::DeviceEvent;
use super::station::SimulatedStation;
use super::wire;
use isotherm_simulation::{Chain, SimulatedChamber};

/// Time constant of the controller's own sensor \[s\].
const SENSOR_LAG_S: f64 = 20.0;
/// Rate at which a chamber that is off drifts to the laboratory's temperature \[degC/s\].
const DRIFT_C_PER_S: f64 = 0.2 / 60.0;
/// Overshoot beyond the set point, and remaining difference to a set point that is never reached \[degC\].
const OVERSHOOT_C: f64 = 3.0;
const SHORTFALL_C: f64 = 3.0;
/// Range of the set point \[degC\].
pub(crate) const RANGE_C: [f64; 2] = [-70.0, 150.0];

/// Mode of the controller.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Mode {
    /// No heating, no cooling.
    Off,
    /// No heating, no cooling, but ready.
    Standby,
    /// Holds the set point.
    Constant,
}

/// The chamber with its controller.
pub(crate) struct ChamberDevice {
    chamber: SimulatedChamber,
    ambient_c: f64,
    ramp_c_per_s: f64,
    now_s: f64,
    target_c: f64,
    /// Air temperature when the set point was set \[degC\].
    from_c: f64,
    /// Temperature of the overshoot, until it is reached \[degC\].
    beyond_c: Option<f64>,
    overshoots: bool,
    never_there: bool,
    events: Vec<(f64, DeviceEvent)>,
    /// Set point \[degC\].
    pub set_point_c: f64,
    /// Mode of the controller.
    pub mode: Mode,
    /// Whether somebody has set the controller to manual: it does not follow the set point.
    pub is_manual: bool,
    /// Whether it has an alarm.
    pub alarm: bool,
}

impl ChamberDevice {
    /// A chamber that is off, in equilibrium with the laboratory.
    pub(crate) fn new(station: &SimulatedStation) -> Self {
        let chain = Chain { head_lag_s: SENSOR_LAG_S, ..station.chain };
        let ambient_c = station.ambient_c;
        Self {
            chamber: SimulatedChamber::new(&chain, ambient_c, station.seed),
            ambient_c,
            ramp_c_per_s: station.ramp_c_per_s,
            now_s: 0.0,
            target_c: ambient_c,
            from_c: ambient_c,
            beyond_c: None,
            overshoots: false,
            never_there: false,
            events: Vec::new(),
            set_point_c: ambient_c,
            mode: Mode::Off,
            is_manual: false,
            alarm: false,
        }
    }

    /// Temperature that the controller measures \[degC\].
    pub(crate) fn air_c(&self) -> f64 {
        self.chamber.head_and_board_c().0
    }

    /// Sets the set point \[degC\]; `false` if it is out of range.
    pub(crate) fn set(&mut self, celsius: f64) -> bool {
        let [low, high] = RANGE_C;
        if !(low..=high).contains(&celsius) {
            return false;
        }
        (self.set_point_c, self.from_c) = (celsius, self.chamber.air_c());
        self.beyond_c = self.overshoots.then(|| celsius + OVERSHOOT_C.copysign(celsius - self.from_c));
        self.update_target();
        true
    }

    /// Changes the mode.
    pub(crate) fn switch(&mut self, mode: Mode) {
        self.mode = mode;
        self.update_target();
    }

    /// Determines the target temperature, and starts a ramp if it has changed.
    fn update_target(&mut self) {
        let (target_c, ramp_c_per_s) = if self.mode != Mode::Constant {
            (self.ambient_c, DRIFT_C_PER_S)
        } else if self.never_there {
            (self.set_point_c + SHORTFALL_C.copysign(self.from_c - self.set_point_c), self.ramp_c_per_s)
        } else {
            (self.beyond_c.unwrap_or(self.set_point_c), self.ramp_c_per_s)
        };
        if target_c != self.target_c {
            self.target_c = target_c;
            self.chamber.go_to(target_c, ramp_c_per_s);
            self.events.push((self.now_s, DeviceEvent::Chamber { target_c, ramp_c_per_s }));
        }
    }
}

impl wire::SimulatedDevice for ChamberDevice {
    fn advance(&mut self, now_s: f64, active: &[InjectedFault]) {
        if now_s > self.now_s {
            self.chamber.wait(now_s - self.now_s);
            self.now_s = now_s;
        }
        self.overshoots = active.contains(&InjectedFault::Overshoot);
        self.never_there = active.contains(&InjectedFault::NeverThere);
        self.alarm = active.contains(&InjectedFault::Alarm);
        if self.alarm && self.mode == Mode::Constant {
            self.mode = Mode::Standby;
        }
        self.beyond_c = self.beyond_c.filter(|beyond_c| *beyond_c != self.chamber.air_c());
        self.update_target();
    }

    fn events(&mut self) -> Vec<(f64, DeviceEvent)> {
        std::mem::take(&mut self.events)
    }
}
