//! What a list of positions and turns determines, before there are data.
//!
//! K+ and K- are judged only by the turns: each gyroscope needs 90 degrees about its own axis in each direction. The
//! rank would not show that one is missing, because Earth's rate drives every channel a little. Everything else is
//! judged by the rank and the condition of the equations of one set point, with turns of 10 deg/s and Earth's rate not
//! counted where it only helps.

use super::earth::{Start, eliminate_horizontal};
use super::fit::design;
use super::input::{GyroscopeRun, TurnMotion};
use super::model::PARAMETERS;
use super::runs::{FittedRun, RunPlace, TurnBlock};
use isotherm_campaign::{
    Campaign, LEAST_TURN, MAX_CONDITION, Position, Turn, outer_axis, specific_force, vector_words,
};
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Length of a dwell \[s\].
const DWELL: f64 = 300.0;
/// Rest before and after a turn \[s\].
const REST: u32 = 5;
/// Angle of a row of 1 s \[arcsec\]: 10 deg.
const ROW: f64 = 36_000.0;
/// Singular values below this part of the largest are 0.
const ZERO: f64 = 1e-6;
/// Most additions that are looked for.
const MAX_ADDITIONS: usize = 4;

/// What positions and turns determine.
#[derive(Clone, Debug, PartialEq)]
pub struct TriadObservability {
    /// Rank of the equations of one set point.
    pub rank: usize,
    /// Number of their unknowns: 26, or 24 without angles.
    pub unknowns: usize,
    /// Largest singular value over the smallest, with columns of length 1; infinite where the rank is not full.
    pub condition: f64,
    /// The parameters that are not determined, and positions or turns that would help.
    pub deficiencies: Vec<String>,
}

impl TriadObservability {
    /// The observability of the gyroscopes; without turns nothing is determined.
    #[must_use]
    pub fn of(campaign: &Campaign) -> Self {
        let mut deficiencies = scale_factors(&campaign.turns);
        let matrix = matrix(campaign);
        let Judgement { rank, unknowns, condition, open } = judge(&matrix);
        // Where a scale factor is missing, its turn may well fix the rest.
        if !open.is_empty() && deficiencies.is_empty() {
            let names: Vec<_> = open.iter().map(|column| parameter(*column)).collect();
            let missing = additions(campaign);
            let missing = if missing.is_empty() { String::new() } else { format!("; missing: {}", missing.join(", ")) };
            deficiencies
                .push(format!("{} cannot be distinguished by these positions and turns{missing}", names.join(", ")));
        }
        Self { rank, unknowns, condition, deficiencies }
    }
}

/// The scale factors that none of the turns drives.
pub(super) fn scale_factors<'a>(turns: impl IntoIterator<Item = &'a Turn> + Clone) -> Vec<String> {
    let mut missing = Vec::new();
    for (axis, gyroscope) in GYROSCOPE_NAMES.iter().enumerate() {
        for (sign, name, word, comparison) in [(1.0, "K+", "positive", '>'), (-1.0, "K-", "negative", '<')] {
            if !turns.clone().into_iter().any(|turn| turn.turned()[axis] * sign >= LEAST_TURN) {
                let mut unit = Vector3::zeros();
                unit[axis] = 1.0;
                missing.push(format!(
                    "{name} of {gyroscope}: no turn drives it {word}; add angle_deg {comparison} 0 about {}, of 90 degrees at least",
                    vector_words(unit)
                ));
            }
        }
    }
    missing
}

/// The name of an unknown.
fn parameter(column: usize) -> String {
    let (axis, k) = (column / PARAMETERS, column % PARAMETERS);
    match (axis, k) {
        (AXES, 0) => "w_X (Earth's rate along the outer axis)".to_owned(),
        (AXES, _) => "w_Y (Earth's rate across the outer axis)".to_owned(),
        (_, 0) => format!("bias D of {}", GYROSCOPE_NAMES[axis]),
        (_, 1) => format!("K+ of {}", GYROSCOPE_NAMES[axis]),
        (_, 2) => format!("K- of {}", GYROSCOPE_NAMES[axis]),
        (_, 3 | 4) => {
            format!("misalignment of {} onto {}", GYROSCOPE_NAMES[axis], GYROSCOPE_NAMES[(axis + k - 2) % AXES])
        }
        _ => format!("g-sensitivity of {} along {}", GYROSCOPE_NAMES[axis], AXIS_NAMES[k - 5]),
    }
}

/// The rows of a turn from rest to rest, as gyroscopes of 1 pulse/arcsec see it.
fn rows(turned: Vector3<f64>) -> Vec<TurnBlock> {
    let steps = (turned.norm() / ROW).ceil().max(1.0);
    let block = |part: f64| {
        let pulses = [0, 1, 2].map(|axis| [turned[axis].max(0.0) * part, (-turned[axis]).max(0.0) * part]);
        TurnBlock { line: 0, seconds: 1.0, pulses }
    };
    let rest = || (0..REST).map(|_| block(0.0));
    let ends = || core::iter::once(block(0.5 / steps));
    let middle = (1..steps as usize).map(|_| block(1.0 / steps));
    rest().chain(ends()).chain(middle).chain(ends()).chain(rest()).collect()
}

/// The equations of one set point, as rows of three gyroscopes, with columns of length 1 where they are not 0.
fn matrix(campaign: &Campaign) -> DMatrix<f64> {
    let blocks: Vec<_> = campaign.turns.iter().map(|turn| rows(turn.turned())).collect();
    let run = |start: &Position, turn: Option<(&Turn, &'_ [TurnBlock])>| -> (Start, f64) {
        let seconds = turn.map_or(DWELL, |(_, blocks)| blocks.iter().map(|block| block.seconds).sum());
        (Start::of(campaign, start, None), seconds)
    };
    let mut runs = Vec::new();
    let mut places = Vec::new();
    let positions =
        campaign.positions.iter().enumerate().map(|(index, position)| (RunPlace::Position(index), position, None));
    let turns = campaign
        .turns
        .iter()
        .zip(&blocks)
        .enumerate()
        .map(|(index, (turn, blocks))| (RunPlace::Turn(index), &turn.start, Some((turn, blocks.as_slice()))));
    for (place, start, turn) in positions.chain(turns) {
        let (Start { force, by_horizontal, .. }, seconds) = run(start, turn);
        let pulses = [0, 1, 2].map(|axis| {
            [0, 1].map(|channel| {
                turn.map_or(0.0, |(_, blocks)| blocks.iter().map(|block| block.pulses[axis][channel]).sum())
            })
        });
        places.push(FittedRun { set_point: 0, place, lines: [0; 2], start_ns: None, seconds, residual: [0.0; AXES] });
        runs.push(GyroscopeRun {
            set_point: 0,
            seconds,
            pulses,
            head: [0.0; AXES],
            board: [0.0; AXES],
            force,
            // Earth's rate makes misalignments visible in dwells too, but only a little.
            earth: Vector3::zeros(),
            by_horizontal,
            horizontal: Vec::new(),
            group: None,
            turn: turn.map(|(turn, blocks)| TurnMotion {
                axis: Vector3::from(turn.axis),
                angle: turn.angle_deg * 3600.0,
                hand: 1.0,
                blocks,
            }),
        });
    }
    if campaign.mount.is_none() {
        eliminate_horizontal(&mut runs, &places);
    }
    design(&runs)
}

struct Judgement {
    rank: usize,
    unknowns: usize,
    condition: f64,
    /// The columns that are not determined.
    open: Vec<usize>,
}

fn judge(matrix: &DMatrix<f64>) -> Judgement {
    let unknowns = matrix.ncols();
    // At least as many rows as columns, so that the decomposition has all singular values.
    let square = matrix.clone().resize_vertically(matrix.nrows().max(unknowns), 0.0);
    let nothing = Judgement { rank: 0, unknowns, condition: f64::INFINITY, open: (0..unknowns).collect() };
    let Some(svd) = square.try_svd(false, true, f64::EPSILON, 10_000) else { return nothing };
    let Some(v) = svd.v_t else { return nothing };
    let largest = svd.singular_values.max();
    let is_zero = |value: f64| value <= ZERO * largest;
    let rank = svd.singular_values.iter().filter(|value| !is_zero(**value)).count();
    let condition = if rank < unknowns { f64::INFINITY } else { largest / svd.singular_values.min() };
    let weak: Vec<_> = (0..unknowns)
        .filter(|&k| {
            is_zero(svd.singular_values[k]) || (rank == unknowns && largest / svd.singular_values[k] > MAX_CONDITION)
        })
        .collect();
    let open = (0..unknowns).filter(|&j| weak.iter().any(|&k| v[(k, j)].abs() > 0.05)).collect();
    Judgement { rank, unknowns, condition, open }
}

/// Positions and turns that would make the list sufficient, the most useful first; each in words.
fn additions(campaign: &Campaign) -> Vec<String> {
    let mut campaign = campaign.clone();
    let candidates = candidates(&campaign);
    let mut found = Vec::new();
    while found.len() < MAX_ADDITIONS {
        let tried = candidates.iter().map(|(words, positions, turns)| {
            let mut with = campaign.clone();
            with.positions.extend(positions.iter().cloned());
            with.turns.extend(turns.iter().cloned());
            let judgement = judge(&matrix(&with));
            (judgement, words, with)
        });
        let better = |a: &Judgement, b: &Judgement| a.rank.cmp(&b.rank).then(b.condition.total_cmp(&a.condition));
        let Some((judgement, words, with)) = tried.max_by(|(a, ..), (b, ..)| better(a, b)) else { break };
        found.push(words.clone());
        campaign = with;
        if judgement.open.is_empty() {
            break;
        }
    }
    found
}

type Candidate = (String, Vec<Position>, Vec<Turn>);

/// What could be added: faces in four headings and turns of the turntable; without angles, faces in two headings and
/// turns about the vertical.
fn candidates(campaign: &Campaign) -> Vec<Candidate> {
    match campaign.mount {
        Some(mount) => at_angles(mount),
        None => (0..AXES).flat_map(|axis| [1.0, -1.0].map(|sign| (axis, sign))).flat_map(about_vertical).collect(),
    }
}

fn position(force: Vector3<f64>, angles: Option<[f64; 2]>) -> Position {
    Position { number: 0, label: String::new(), angles, specific_force: force.map(|f| f + 0.0).into() }
}

/// A turn in each direction.
fn both_turns(start: &Position, axis: Vector3<f64>) -> Vec<Turn> {
    let turn = |angle_deg| Turn { start: start.clone(), axis: axis.into(), angle_deg, about: None };
    vec![turn(360.0), turn(-360.0)]
}

/// Positions, and turns, with one axis up or down.
fn about_vertical((axis, sign): (usize, f64)) -> [Candidate; 2] {
    let mut force = Vector3::zeros();
    force[axis] = sign;
    let start = position(force, None);
    let name = AXIS_NAMES[axis];
    let word = if sign > 0.0 { "up" } else { "down" };
    let positions = format!("two positions with {name} {word}, in headings 180 degrees apart");
    let turns = format!("turns of 360 and -360 degrees about {} with {name} {word}", vector_words(force.abs()));
    [(positions, vec![start.clone(), start.clone()], Vec::new()), (turns, Vec::new(), both_turns(&start, force.abs()))]
}

/// Faces in four headings, and turns about the axes of the turntable.
fn at_angles(mount: Matrix3<f64>) -> Vec<Candidate> {
    let quarters = [0.0, 90.0, 180.0, 270.0];
    let at =
        |outer: f64, inner: f64| position(mount * Vector3::from(specific_force(outer, inner)), Some([outer, inner]));
    let faces = quarters.into_iter().flat_map(|outer| quarters.map(|inner| (outer, inner))).map(|(outer, inner)| {
        (format!("a position with outer_deg = {outer} and inner_deg = {inner}"), vec![at(outer, inner)], Vec::new())
    });
    let axes = [(0.0, mount * outer_axis(0.0)), (90.0, mount * outer_axis(90.0)), (0.0, mount * Vector3::z())];
    let axes = axes.map(|(inner, axis)| {
        let words = format!(
            "turns of 360 and -360 degrees about {} at outer_deg = 0 and inner_deg = {inner}",
            vector_words(axis)
        );
        (words, Vec::new(), both_turns(&at(0.0, inner), axis))
    });
    faces.chain(axes).collect()
}
