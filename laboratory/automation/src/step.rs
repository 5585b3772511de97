//! A step of the campaign: a dwell, a turn, a ramp or a verification run. Messages call it a unit.

use super::plan::{Plan, PlannedTurn, ThereAndBack};

/// A unit of the data: it is kept whole or not at all.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum CampaignStep {
    /// A dwell.
    Dwell {
        /// Index into the plan's set points; the same temperature may be listed more than once.
        visit: usize,
        /// Index into the plan's positions.
        position: usize,
    },
    /// A turn.
    Turn {
        /// As of a dwell.
        visit: usize,
        /// Index into the plan's turns.
        turn: usize,
    },
    /// A ramp, counted from 0.
    Ramp(usize),
    /// A verification run, counted from 0.
    Run(usize),
}

impl CampaignStep {
    /// The unit of this index, from 0; `None` after the last.
    pub fn of(plan: &Plan, index: usize) -> Option<Self> {
        let (positions, each) = (plan.positions.len(), plan.units_of_set_point());
        let (visit, number) = (index / each, index % each);
        if visit < plan.set_points_c.len() {
            return Some(match number.checked_sub(positions) {
                None => Self::Dwell { visit, position: number },
                Some(turn) => Self::Turn { visit, turn },
            });
        }
        let ramp = index - plan.set_points_c.len() * each;
        let Some(run) = ramp.checked_sub(plan.ramps.len()) else { return Some(Self::Ramp(ramp)) };
        let runs = plan.verify.as_ref().map_or(0, |verify| verify.runs as usize);
        (run < runs).then_some(Self::Run(run))
    }

    /// Index of the device's set point; `None` for a ramp or a verification run.
    pub const fn visit(self) -> Option<usize> {
        match self {
            Self::Dwell { visit, .. } | Self::Turn { visit, .. } => Some(visit),
            Self::Ramp(_) | Self::Run(_) => None,
        }
    }

    /// The chamber's way in a ramp or a verification run; `None` for other units.
    pub fn way(self, plan: &Plan) -> Option<&ThereAndBack> {
        match self {
            Self::Dwell { .. } | Self::Turn { .. } => None,
            Self::Ramp(ramp) => plan.ramps.get(ramp).map(|ramp| &ramp.way),
            Self::Run(_) => plan.verify.as_ref().map(|verify| &verify.way),
        }
    }

    /// Whether the unit has a file of its own: a ramp or a verification run.
    pub const fn has_own_file(self) -> bool {
        self.visit().is_none()
    }

    /// The chamber's set point at the beginning of the unit \[degC\].
    pub fn set_point_c(self, plan: &Plan) -> f64 {
        match self {
            Self::Dwell { visit, .. } | Self::Turn { visit, .. } => plan.set_points_c[visit],
            Self::Ramp(_) | Self::Run(_) => self.way(plan).map_or(0.0, |way| way.from_c),
        }
    }

    /// Outer and inner angle of the turntable at the end of the unit \[deg\].
    pub fn end_angles_deg(self, plan: &Plan) -> [f64; 2] {
        match self {
            Self::Turn { turn, .. } => plan.turns[turn].to_deg,
            Self::Dwell { .. } | Self::Ramp(_) | Self::Run(_) => self.angles_deg(plan),
        }
    }

    /// Outer and inner angle of the turntable, at the beginning of a turn \[deg\].
    pub fn angles_deg(self, plan: &Plan) -> [f64; 2] {
        match self {
            Self::Dwell { position, .. } => plan.positions[position].angles,
            Self::Turn { turn, .. } => Some(plan.turns[turn].from_deg),
            Self::Ramp(ramp) => plan.ramps.get(ramp).and_then(|ramp| ramp.attitude.angles),
            Self::Run(run) => plan.verify.as_ref().and_then(|verify| verify.attitude(run).angles),
        }
        .unwrap_or_default()
    }

    /// The name that messages show.
    pub fn name(self, plan: &Plan) -> String {
        match self {
            Self::Dwell { visit, position } => {
                let position = &plan.positions[position];
                format!("{} degC, position {} ({})", plan.set_points_c[visit], position.number, position.label)
            }
            Self::Turn { visit, turn } => {
                let PlannedTurn { number, axis, from_deg, to_deg } = plan.turns[turn];
                let (from, to, axis_name) = (from_deg[axis], to_deg[axis], ["outer", "inner"][axis]);
                format!("{} degC, turn {number} ({axis_name} {from} to {to} deg)", plan.set_points_c[visit])
            }
            Self::Ramp(ramp) => format!("ramp {}", ramp + 1),
            Self::Run(run) => format!("verification run {}", run + 1),
        }
    }

    /// The name of the file of its samples of the IMU of `plan`.
    pub fn file(self, plan: &Plan) -> String {
        match self {
            Self::Dwell { .. } | Self::Turn { .. } => plan.samples_file(),
            Self::Ramp(ramp) => plan.ramp_file(ramp),
            Self::Run(run) => plan.run_file(run),
        }
    }
}
