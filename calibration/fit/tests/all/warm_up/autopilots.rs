//! What the autopilots' own scripts made of the real run: their parameters as curves.

use std::collections::HashMap;

/// The cubics of A1 to G3 \[m/s2, rad/s\] about a reference temperature, 0 there.
pub(super) struct AutopilotCubics {
    reference: f64,
    powers: [[f64; 3]; 6],
}

impl AutopilotCubics {
    pub(super) fn at(&self, sensor: usize, temperature: f64) -> f64 {
        let d = temperature - self.reference;
        let [one, two, three] = self.powers[sensor];
        d * (one + d * (two + d * three))
    }

    /// PX4's parameters.
    pub(super) fn px4(text: &str) -> Self {
        let fields =
            text.lines().filter(|line| !line.starts_with('#')).map(|line| line.split('\t').collect::<Vec<_>>());
        let all: HashMap<_, f64> = fields.map(|it| (it[2].to_owned(), it[3].parse().unwrap())).collect();
        let power = |sensor: usize, k: usize| all[&format!("TC_{}0_X{k}_{}", ["A", "G"][sensor / 3], sensor % 3)];
        Self { reference: all["TC_A0_TREF"], powers: powers(power) }
    }

    /// ArduPilot's parameters.
    pub(super) fn ardupilot(text: &str) -> Self {
        let all: HashMap<_, f64> =
            text.lines().filter_map(|line| line.split_once(' ')).map(|(name, v)| (name, v.parse().unwrap())).collect();
        let name = |sensor: usize, k: usize| {
            format!("INS_TCAL1_{}{k}_{}", ["ACC", "GYR"][sensor / 3], ["X", "Y", "Z"][sensor % 3])
        };
        Self { reference: 35.0, powers: powers(|sensor, k| all[name(sensor, k).as_str()] * 1e-6) }
    }
}

fn powers(power: impl Fn(usize, usize) -> f64) -> [[f64; 3]; 6] {
    core::array::from_fn(|sensor| [1, 2, 3].map(|k| power(sensor, k)))
}

pub(super) fn of_all_rows() -> [AutopilotCubics; 2] {
    [
        AutopilotCubics::px4(include_str!("../../data/autopilots/full.params")),
        AutopilotCubics::ardupilot(include_str!("../../data/autopilots/full.parm")),
    ]
}

pub(super) fn of_the_heating() -> [AutopilotCubics; 2] {
    [
        AutopilotCubics::px4(include_str!("../../data/autopilots/heating.params")),
        AutopilotCubics::ardupilot(include_str!("../../data/autopilots/heating.parm")),
    ]
}
