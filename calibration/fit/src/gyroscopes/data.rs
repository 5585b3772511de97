//! The runs of the gyroscopes with their set points.

use super::earth;
use super::input::{GyroscopeRun, TurnMotion};
use super::runs::{FittedRun, GyroscopeRuns, RunPlace, TurnRun};
use crate::error::CalibrationError;
use crate::result::Calibration;
use isotherm_campaign::{Campaign, Dwell, Position, joint_range};
use isotherm_shared::wire::AXES;
use nalgebra::Vector3;

/// The runs of the gyroscopes with their set points.
pub(super) struct Data<'a> {
    pub campaign: &'a Campaign,
    /// Temperatures of the set points \[degC\].
    pub set_points_c: Vec<f64>,
    pub tilt: Option<[f64; 2]>,
    /// Set point and dwell.
    pub dwells: Vec<(usize, &'a Dwell)>,
    /// Set point and turn.
    pub turns: Vec<(usize, &'a TurnRun)>,
    /// Turns at set points without dwells.
    pub strays: Vec<&'a TurnRun>,
}

impl<'a> Data<'a> {
    pub(super) fn new(
        campaign: &'a Campaign,
        calibration: &Calibration,
        gyroscopes: &'a GyroscopeRuns,
        excluded_turns: &[(f64, u32)],
    ) -> Result<Self, CalibrationError> {
        let number = |turn: &TurnRun| campaign.turns[turn.run.position].start.number;
        let is = |turn: &TurnRun, place: &(f64, u32)| (turn.run.set_point_c, number(turn)) == *place;
        // A turn that is missing may be left out as well as one that is there.
        let mut runs = gyroscopes.dwells.iter().chain(gyroscopes.turns.iter().map(|turn| &turn.run));
        let unknown = excluded_turns.iter().find(|(set_point_c, _)| !runs.any(|run| run.set_point_c == *set_point_c));
        if let Some(&(set_point_c, number)) = unknown {
            return Err(CalibrationError::NothingToExclude(set_point_c, number));
        }
        let mut dwells = Vec::new();
        for (index, set_point) in calibration.set_points.iter().enumerate() {
            for &dwell in &set_point.dwells {
                // Both triads' dwells are of the same rows.
                let line = calibration.dwells[dwell].lines[0];
                dwells
                    .extend(gyroscopes.dwells.iter().find(|dwell| dwell.lines[0] == line).map(|dwell| (index, dwell)));
            }
        }
        // A turn belongs to the visit of its temperature that is nearest in the file.
        let set_point = |turn: &TurnRun| {
            let distance = |dwell: &Dwell| dwell.lines[0].abs_diff(turn.run.lines[0]);
            let of_its_temperature = dwells.iter().filter(|(_, dwell)| dwell.set_point_c == turn.run.set_point_c);
            of_its_temperature.min_by_key(|(_, dwell)| distance(dwell)).map(|(set_point, _)| *set_point)
        };
        let (mut turns, mut strays) = (Vec::new(), Vec::new());
        for turn in gyroscopes.turns.iter().filter(|turn| !excluded_turns.iter().any(|place| is(turn, place))) {
            match set_point(turn) {
                Some(set_point) => turns.push((set_point, turn)),
                None => strays.push(turn),
            }
        }
        let set_points_c = calibration.set_points.iter().map(|set_point| set_point.set_point_c).collect();
        Ok(Self { campaign, set_points_c, tilt: calibration.solution.tilt, dwells, turns, strays })
    }

    /// The runs for the fit: the dwells, then the turns; with the place of each.
    pub(super) fn runs(&self) -> (Vec<GyroscopeRun<'a>>, Vec<FittedRun>) {
        let dwells = self.dwells.iter().map(|(set_point, dwell)| {
            let start = &self.campaign.positions[dwell.position];
            (self.run(*set_point, dwell, start, None), placed(*set_point, dwell, RunPlace::Position(dwell.position)))
        });
        let turns = self.turns.iter().map(|(set_point, turn)| {
            let start = &self.campaign.turns[turn.run.position].start;
            let place = RunPlace::Turn(turn.run.position);
            (self.run(*set_point, &turn.run, start, Some(turn)), placed(*set_point, &turn.run, place))
        });
        dwells.chain(turns).unzip()
    }

    /// A dwell, or the run of a `turn`, that began at `start`.
    fn run(&self, set_point: usize, run: &Dwell, start: &Position, turn: Option<&'a TurnRun>) -> GyroscopeRun<'a> {
        let earth::Start { force, earth, by_horizontal } = earth::Start::of(self.campaign, start, self.tilt);
        GyroscopeRun {
            set_point,
            seconds: run.sums.seconds,
            pulses: [0, 1, 2].map(|axis| [run.sums.positive[axis], run.sums.negative[axis]]),
            head: [0, 1, 2].map(|axis| run.head(axis)),
            board: [0, 1, 2].map(|axis| run.board(axis)),
            force,
            earth,
            by_horizontal,
            horizontal: Vec::new(),
            group: None,
            turn: turn.map(|turn| TurnMotion {
                axis: Vector3::from(self.campaign.turns[run.position].axis),
                angle: self.campaign.turns[run.position].angle_deg * 3600.0,
                hand: self.campaign.mount.map_or(1.0, |mount| mount.determinant().signum()),
                blocks: &turn.blocks,
            }),
        }
    }

    /// Lowest and highest temperature of all runs: head and board, by gyroscope.
    pub(super) fn ranges(&self) -> [[[f64; 2]; 2]; AXES] {
        let runs = || self.dwells.iter().map(|(_, dwell)| *dwell).chain(self.turns.iter().map(|(_, turn)| &turn.run));
        [0, 1, 2].map(|axis| {
            [joint_range(runs().map(|run| run.head_range(axis))), joint_range(runs().map(|run| run.board_range(axis)))]
        })
    }
}

/// A run with its place, not yet fitted.
fn placed(set_point: usize, run: &Dwell, place: RunPlace) -> FittedRun {
    let (start_ns, seconds) = (run.time_ns.map(|[begin_ns, _]| begin_ns), run.sums.seconds);
    FittedRun { set_point, place, lines: run.lines, start_ns, seconds, residual: [0.0; AXES] }
}
