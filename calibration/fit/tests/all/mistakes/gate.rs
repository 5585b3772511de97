//! The gate of a campaign, and whether a wrong table gets through it.
//!
//! # Definition
//! After the campaign the same IMU stays at [`ANGLES_DEG`] while the temperature runs up, and again while it runs down.
//! What of the mistake is in the acquisition, in the turntable's angles or in the laboratory's own statements stays in
//! these runs; wrong rows and wrong labels of the campaign do not. [`isotherm_verification::gate`] judges the runs, as
//! in an automatic campaign, with the bounds of the fit and a factor of 10.
//!
//! **True error** of a table: the largest error of its output against the simulated truth, without noise, over fourteen
//! attitudes (six faces and eight corners) and eleven temperatures from the lowest to the highest set point, from
//! samples as this laboratory's acquisition makes them; 1e-6 g0 of a scale factor's error at a face is 1 ppm. A table
//! is **wrong** if its true error is over 20e-6 g0 and over 3 times that of the table from the same campaign without
//! the mistake.

use super::matrix::{Case, calibrated};
use isotherm_campaign::{Position, specific_force as direction};
use isotherm_fit::{AlignmentChoice, Calibration, CalibrationError, CalibrationOptions};
use isotherm_report as report;
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::{InertialMotion, Noise, RandomGenerator, RunSchedule, SimulatedImu, run, specific_force};
use isotherm_support::finding::{Severity, name};
use isotherm_verification::{Collector, GateRefusal, LocalGravity, Requirement, Setup, Stability, StabilityError};
use std::collections::BTreeSet;

/// The turntable's angles in the runs, as a plan has them by default \[deg\].
pub(crate) const ANGLES_DEG: [f64; 2] = [50.0, 130.0];
/// Length of a window \[s\], as the automatic campaign has it.
const WINDOW_S: f64 = 10.0;
/// A true error below this is never wrong \[g0\].
pub(crate) const WRONG: f64 = 20e-6;
/// Nor one below this many times that of the good table.
const WRONG_FACTOR: f64 = 3.0;
/// The runs end this far inside the set points \[degC\].
const INSIDE_C: f64 = 1.0;
/// A random stream and seeds that no campaign uses.
const RUN_STREAM: u64 = 78;
const RUN_SEED: u64 = 1000;

/// What the gate has found.
#[derive(Clone, Debug)]
pub(crate) struct Gate {
    /// What refuses the table, if anything: the kinds of causes.
    pub refused_by: BTreeSet<&'static str>,
    /// The causes in words.
    pub causes: Vec<String>,
    /// The last line of `verify` about the first run.
    pub last_line: String,
    /// The smallest ratio of a bound to the upper end of what it bounds.
    pub margin: f64,
    /// The bound of every axis, or that of what a table without the matrix that it needs may leave \[g0\].
    pub bound: f64,
}

/// A run at these angles: samples with what stays of the mistake.
fn stability(
    case: &Case,
    calibration: &Calibration,
    tables: &[&CoefficientTable],
    [outer, inner]: [f64; 2],
    up: bool,
    seed: u64,
) -> Vec<Result<Stability, StabilityError>> {
    let Case { truth, file, schedule, .. } = case;
    // The turntable's repeatability is that of the campaign, unless the positions have no angles.
    let mut random = RandomGenerator::new(seed, RUN_STREAM + u64::from(up));
    let has_angles = schedule.positions.iter().all(|position| position.angles.is_some());
    let spread = if has_angles { schedule.noise.positioning_rad.to_degrees() } else { 0.0 };
    let mut real = |k: usize, stated: f64| stated + case.turned_deg[k] + spread * random.normal();
    let (real_outer, real_inner) = (real(0, outer), real(1, inner));
    let level = direction(real_outer, real_inner);
    // The chamber's oscillation must not leave the range of the table.
    let (low, high) = range(case);
    let (low, high) = (low + INSIDE_C, high - INSIDE_C);
    let run_schedule = RunSchedule {
        direction: if has_angles { specific_force(truth, real_outer, real_inner) } else { level },
        from_c: if up { low } else { high },
        to_c: if up { high } else { low },
        interval_ns: 1_000_000_000,
        chain: schedule.chain,
        noise: schedule.noise,
        ..RunSchedule::default()
    };
    let mut collectors: Vec<_> = tables.iter().map(|table| Collector::new(table, WINDOW_S)).collect();
    for mut raw in run(truth, &run_schedule, seed + RUN_SEED + u64::from(up)) {
        (case.in_use)(&mut raw);
        collectors.iter_mut().for_each(|collector| collector.add(&raw));
    }
    let angles = has_angles.then_some([outer, inner]);
    let stated =
        Position { number: 0, label: String::new(), angles, specific_force: (case.stated)(direction(outer, inner)) };
    let attitude = file.force(&stated, calibration.solution.tilt).0;
    let setup = Setup::new(Some(attitude), LocalGravity::Stated(file.gravity_local));
    collectors.into_iter().map(|collector| collector.finish(&setup)).collect()
}

fn range(case: &Case) -> (f64, f64) {
    let all = &case.schedule.set_points_c;
    all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &c| (low.min(c), high.max(c)))
}

/// Judges the table of a calibration at these angles of the turntable, up and down, with a factor of stability if it is
/// required.
pub(crate) fn gate(
    case: &Case,
    calibration: &Calibration,
    in_force: Option<&CoefficientTable>,
    angles_deg: [f64; 2],
    factor: Option<f64>,
    seed: u64,
) -> Gate {
    let force = (case.stated)(direction(angles_deg[0], angles_deg[1]));
    let require = Requirement { factor, ..Requirement::default() };
    let mut found = Gate {
        refused_by: BTreeSet::new(),
        causes: Vec::new(),
        last_line: String::new(),
        margin: f64::INFINITY,
        bound: 0.0,
    };
    let mut refuse = |GateRefusal { by, cause }| {
        found.refused_by.insert(by);
        found.causes.push(cause);
    };
    let gate = match isotherm_verification::Gate::new(require, calibration, force) {
        Ok(gate) => gate,
        Err(cause) => {
            refuse(GateRefusal { by: "no bound", cause });
            return found;
        }
    };
    found.bound = gate.require.bias.unwrap_or_default();
    if calibration.left_without_alignment().is_some() {
        found.bound = found.bound.min(gate.left);
    }
    gate.refuses_table(calibration, in_force).into_iter().for_each(&mut refuse);
    let tables: Vec<&CoefficientTable> = [&calibration.table].into_iter().chain(in_force).collect();
    for up in [true, false] {
        let mut judged = stability(case, calibration, &tables, angles_deg, up, seed);
        let present = if judged.len() > 1 { judged.pop() } else { None };
        let stability = match judged.remove(0) {
            Ok(stability) => stability,
            Err(error) => {
                if found.last_line.is_empty() {
                    found.last_line = error.to_string();
                }
                refuse(GateRefusal { by: "data", cause: error.to_string() });
                continue;
            }
        };
        gate.refuses_run(&stability, present.and_then(Result::ok).as_ref()).into_iter().for_each(&mut refuse);
        found.margin = found.margin.min(margin(&gate.require, &stability));
        if found.last_line.is_empty() {
            let aligned = calibration.table.content().alignment.is_some();
            let text = report::text::stability(&stability, WINDOW_S, aligned);
            found.last_line = text.lines().last().unwrap_or_default().to_owned();
        }
    }
    found
}

/// The smallest ratio of a bound to the upper end of what it bounds.
fn margin(require: &Requirement, stability: &Stability) -> f64 {
    let verdict = &stability.verdict;
    let axes = verdict.axes.iter().map(|errors| errors.worst.most()).fold(0.0, f64::max);
    let length = verdict.length.as_ref().map(|errors| errors.worst.most() / stability.gravity);
    let level = verdict.level.worst.most();
    let pairs = [(require.bias, Some(axes)), (require.scale, length), (require.level, Some(level))];
    pairs.into_iter().filter_map(|(bound, most)| Some(bound? / most?)).fold(f64::INFINITY, f64::min)
}

/// The true error of a table \[g0\]; infinite where the output is not a number.
pub(crate) fn true_error(case: &Case, table: &CoefficientTable) -> f64 {
    const TEMPERATURES: u32 = 11;
    const INTERVAL_S: f64 = 1000.0;
    let truth = &case.truth;
    let chain = isotherm_simulation::Chain { oscillation_c: 0.0, telemetry_lsb_micro: 0, ..case.schedule.chain };
    let corner = (1.0_f64 / 3.0).sqrt();
    let mut attitudes: Vec<[f64; 3]> =
        (0..8).map(|k| [1, 2, 4].map(|bit| if k & bit > 0 { corner } else { -corner })).collect();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            attitudes.push([0, 1, 2].map(|k| if k == axis { sign } else { 0.0 }));
        }
    }
    let (low, high) = range(case);
    let mut worst = 0.0_f64;
    for step in 0..TEMPERATURES {
        let celsius = low + (high - low) * f64::from(step) / f64::from(TEMPERATURES - 1);
        for attitude in &attitudes {
            let force = attitude.map(|a| a * truth.gravity_local / truth.table.content().gravity);
            let mut imu = SimulatedImu::new(truth, &chain, &Noise::NONE, celsius, 1);
            let mut raw = imu.step(&InertialMotion::of_force(force), (INTERVAL_S * 1e9) as u64);
            (case.in_use)(&mut raw);
            let velocity = answer(Some(table), &raw).velocity_increment;
            for axis in 0..3 {
                let error = (velocity[axis] / INTERVAL_S - attitude[axis] * truth.gravity_local).abs();
                worst = if error.is_nan() { f64::INFINITY } else { worst.max(error / truth.table.content().gravity) };
            }
        }
    }
    worst
}

/// What became of the table of a case.
pub(crate) struct Installation {
    /// The table's true error \[g0\].
    pub true_error: f64,
    /// Whether this is wrong.
    pub wrong: bool,
    /// Without a table in force, and with the good one in force.
    pub gates: [Gate; 2],
}

impl Installation {
    /// Whether a wrong table can be installed: without a table in force, and with the good one in force.
    pub(crate) fn wrong_installed(&self) -> [bool; 2] {
        [0, 1].map(|k| self.wrong && self.gates[k].refused_by.is_empty())
    }
}

/// Tries to install the table of a case. `accept` has the names of the faults that are accepted. The text is why there
/// is no table.
pub(crate) fn install(case: &Case, good: &Good, accept: &[&'static str], seed: u64) -> Result<Installation, String> {
    let fit = |alignment| {
        let options = CalibrationOptions { accept: accept.to_vec(), alignment, ..CalibrationOptions::default() };
        calibrated(case, options).map_err(|(_, text)| text)
    };
    let first = fit(AlignmentChoice::IfNeeded)?;
    let with = good.table.content().alignment.is_some();
    // An installation keeps the choice of the table in force.
    let kept = fit(AlignmentChoice::of(with, !with))?;
    let gates = [
        gate(case, &first, None, ANGLES_DEG, Some(10.0), seed),
        gate(case, &kept, Some(&good.table), ANGLES_DEG, Some(10.0), seed),
    ];
    let true_error = true_error(case, &first.table).max(true_error(case, &kept.table));
    let wrong = true_error > WRONG && true_error > WRONG_FACTOR * good.true_error;
    Ok(Installation { true_error, wrong, gates })
}

/// The table from the same campaign without the mistake.
pub(crate) struct Good {
    pub table: CoefficientTable,
    pub true_error: f64,
}

impl Good {
    pub(crate) fn of(case: &Case, seed: u64) -> Self {
        let good = (case.good)(seed);
        let Ok(calibration) = calibrated(&good, CalibrationOptions::default()) else {
            panic!("the campaign without the mistake is refused, seed {seed}");
        };
        Self { true_error: true_error(&good, &calibration.table), table: calibration.table }
    }
}

/// The names of all faults of a case that must be accepted for a table, or why there is none however many are accepted.
/// Empty if the table is made at once.
pub(crate) fn faults(case: &Case) -> Result<Vec<&'static str>, String> {
    let mut accept: Vec<&'static str> = Vec::new();
    loop {
        let options = CalibrationOptions { accept: accept.clone(), ..CalibrationOptions::default() };
        let (error, text) = match calibrated(case, options) {
            Ok(_) => return Ok(accept),
            Err(failed) => failed,
        };
        let Some(CalibrationError::Faults { diagnosis, findings }) = error else { return Err(text) };
        let all = findings.iter().filter(|finding| finding.severity == Severity::Fault);
        let before = accept.len();
        for fault in all.chain(diagnosis.iter().map(|diagnosis| &diagnosis.finding)) {
            name::acceptable(fault.name).map_err(|error| error.clone())?;
            if !accept.contains(&fault.name) {
                accept.push(fault.name);
            }
        }
        if accept.len() == before {
            return Err(text);
        }
    }
}
