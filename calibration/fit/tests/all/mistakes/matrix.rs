//! Mistakes that a laboratory can make, put into simulated campaigns, and correct campaigns of other laboratories.
//!
//! The test and the example `mistakes` share this file and `gate.rs`.
//!
//! Over 400 lines: the list of the mistakes is long.

use isotherm_campaign::{Campaign, Place, Position, Scheme, normal_gravity, read_dwells, specific_force};
use isotherm_fit::{Calibration, CalibrationError, CalibrationOptions, Measurements, calibrate};
use isotherm_recording::{CampaignRow, RecordingError, SequenceRule};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::RawSample;
use isotherm_simulation::{
    CampaignSchedule, Chain, Noise, RandomGenerator, SimulatedRow, Truth, campaign, campaign_toml, worst_errors,
};
use nalgebra::Matrix3;
use std::path::Path;

/// A campaign before it is calibrated: the campaign file, and the rows. And what of a mistake stays after the campaign.
pub(crate) struct Case {
    pub truth: Truth,
    pub file: Campaign,
    /// What is said about the campaign file, if it is refused.
    pub file_fault: Option<String>,
    pub rows: Vec<SimulatedRow>,
    /// How the rows were taken.
    pub schedule: CampaignSchedule,
    /// What the acquisition does to every later sample too: wiring, units, clocks.
    pub in_use: fn(&mut RawSample),
    /// How far the turntable's angles are from the stated ones, everywhere \[deg\].
    pub turned_deg: [f64; 2],
    /// The specific force that this laboratory states, where it is another one.
    pub stated: fn([f64; 3]) -> [f64; 3],
    /// The same campaign without the mistake.
    pub good: fn(u64) -> Case,
}

/// What must happen.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum ExpectedOutcome {
    /// No table; the first line has these words.
    Refused(&'static str),
    /// A table and a warning with these words: the data could be true.
    Warned(&'static str),
    /// A table: nothing in the data of a campaign shows the mistake. The words say what becomes of it.
    Invisible(&'static str),
    /// A wrong table that can be installed: nothing in the data of a campaign or of a verification run shows the
    /// mistake. The words say why.
    InPrinciple(&'static str),
    /// A table and a warning with these words; no verification run shows more.
    WarnedAlone(&'static str),
}

/// A mistake: its name, what it does to a campaign, and what must happen.
pub(crate) struct Mistake {
    pub name: &'static str,
    pub make: fn(u64) -> Case,
    pub expected: ExpectedOutcome,
}

/// What happened.
pub(crate) struct Outcome {
    /// The error of the bias \[1e-6 g0\] and of the scale factors \[ppm\], if there is a table.
    pub errors: Option<[f64; 2]>,
    /// What is printed.
    pub lines: Vec<String>,
}

impl Outcome {
    pub(crate) fn first(&self) -> &str {
        self.lines.first().map_or("", String::as_str)
    }

    /// Whether it is as expected.
    pub(crate) fn is(&self, expected: ExpectedOutcome) -> bool {
        match expected {
            ExpectedOutcome::Refused(words) => self.errors.is_none() && self.first().contains(words),
            ExpectedOutcome::Warned(words) | ExpectedOutcome::WarnedAlone(words) => {
                self.errors.is_some() && self.lines.iter().any(|line| line.contains(words))
            }
            ExpectedOutcome::Invisible(_) | ExpectedOutcome::InPrinciple(_) => self.errors.is_some(),
        }
    }
}

/// Calibrates a case with `options`. Rows have the lines of a file with a header. The error has its text.
pub(crate) fn calibrated(
    case: &Case,
    options: CalibrationOptions,
) -> Result<Calibration, (Option<CalibrationError>, String)> {
    if let Some(fault) = &case.file_fault {
        return Err((None, fault.clone()));
    }
    let mut rule = SequenceRule::default();
    let rows = (2..).zip(&case.rows).map(|(line, &SimulatedRow { set_point_c, position, raw: sample })| {
        rule.check(&sample).map_err(|message| RecordingError::Data { line, message })?;
        Ok(CampaignRow { line, set_point_c, position: Some(position), sample })
    });
    let dwells = read_dwells(&case.file, rows);
    let dwells = dwells.map_err(|error| (None, error.failure(Path::new("samples.csv")).to_string()))?;
    // As the command does.
    let measurements = Measurements { dwells, ..Measurements::default() };
    calibrate(&case.file, measurements, options).map_err(|error| {
        let failure = error.failure(Path::new("campaign.toml"), Path::new("samples.csv"), locate);
        (Some(error), failure.to_string())
    })
}

fn locate(line: u64) -> String {
    format!("samples.csv:{line}")
}

/// What `calibrate` says about a case.
pub(crate) fn outcome(case: &Case) -> Outcome {
    match calibrated(case, CalibrationOptions::default()) {
        Ok(Calibration { table, findings, .. }) => {
            let lines = findings.iter().map(|finding| finding.tagged(locate)).collect();
            Outcome { errors: Some(worst_errors(&table, &case.truth.table)), lines }
        }
        Err((_, text)) => Outcome { errors: None, lines: text.lines().map(str::to_owned).collect() },
    }
}

fn paper() -> CoefficientTable {
    CoefficientTable::from_toml(include_str!("../../../../../examples/tables/imu-paper.toml"), None).unwrap()
}

/// The IMU of `seed`, with temperature in `unit`: 0 degC reads `zero`, and 1 degC is `slope`.
pub(crate) fn truth_in(unit: &str, zero: f64, slope: f64, seed: u64) -> Truth {
    let mut content = paper().content().clone();
    // The published curves are over volts, 2.1 V + 0.04 V/degC.
    let volts = slope / 0.04;
    let converted = |p: &Polynomial| {
        let range = p.range().map(|u| (u - 2.1) * volts + zero);
        Polynomial::new(p.coefficients(), zero - 2.1 * volts, volts, range).unwrap()
    };
    if unit != "V" {
        content.temperature_unit = unit.to_owned();
        for axis in &mut content.axes {
            axis.bias = converted(&axis.bias);
            axis.positive_scale_factor = converted(&axis.positive_scale_factor);
            axis.negative_scale_factor = converted(&axis.negative_scale_factor);
        }
    }
    Truth::varied(&content, seed).unwrap()
}

pub(crate) fn case(truth: Truth, schedule: &CampaignSchedule, seed: u64) -> Case {
    let content = truth.table.content();
    let (imu, unit) = (content.imu.as_str(), content.temperature_unit.as_str());
    let text = campaign_toml(imu, "samples.csv", content.gravity, truth.gravity_local, unit, &schedule.positions);
    Case {
        file: Campaign::from_toml(&text).unwrap(),
        file_fault: None,
        rows: campaign(&truth, schedule, seed).collect(),
        schedule: schedule.clone(),
        in_use: |_| {},
        turned_deg: [0.0; 2],
        stated: |force| force,
        good: volts,
        truth,
    }
}

/// Seven set points, temperature in volts.
fn volts(seed: u64) -> Case {
    let schedule = CampaignSchedule {
        set_points_c: (-2..=4).map(|k| 10.0 * f64::from(k)).collect(),
        ..CampaignSchedule::default()
    };
    case(truth_in("V", 2.1, 0.04, seed), &schedule, seed)
}

/// Seven set points, temperature in `unit`.
fn in_unit(unit: &str, zero: f64, slope: f64, seed: u64) -> Case {
    let chain =
        Chain { temperature_zero: zero, temperature_slope: slope, telemetry_lsb_micro: 2000, ..Chain::default() };
    let schedule = CampaignSchedule {
        set_points_c: (-2..=4).map(|k| 10.0 * f64::from(k)).collect(),
        chain,
        noise: Noise { temperature: 2.5e-3, ..Noise::default() },
        ..CampaignSchedule::default()
    };
    let good = |seed| in_unit("degC", 0.0, 1.0, seed);
    Case { good, ..case(truth_in(unit, zero, slope, seed), &schedule, seed) }
}

/// A campaign in volts of an acquisition that makes other samples, in the campaign and later.
fn acquired(seed: u64, change: fn(&mut RawSample)) -> Case {
    Case { in_use: change, ..rows(seed, |row| change(&mut row.raw)) }
}

/// A campaign in volts with other rows.
fn rows(seed: u64, change: impl Fn(&mut SimulatedRow)) -> Case {
    let mut case = volts(seed);
    case.rows.iter_mut().for_each(change);
    case
}

/// Rows with a function of the position's number.
fn numbers(seed: u64, change: impl Fn(f64, u32) -> u32) -> Case {
    rows(seed, |row| row.position = change(row.set_point_c, row.position))
}

const fn exchanged(number: u32, a: u32, b: u32) -> u32 {
    if number == a {
        b
    } else if number == b {
        a
    } else {
        number
    }
}

/// A campaign whose turntable really goes to `actual` where the campaign file states the usual positions.
fn at(seed: u64, actual: impl Fn(&mut [f64; 2], u32)) -> Case {
    let stated = Scheme::SixFacesTwoHeadings.positions();
    let mut schedule = CampaignSchedule {
        set_points_c: (-2..=4).map(|k| 10.0 * f64::from(k)).collect(),
        ..CampaignSchedule::default()
    };
    for position in &mut schedule.positions {
        let mut angles = position.angles.unwrap();
        actual(&mut angles, position.number);
        *position = Position::at(position.number, angles[0], angles[1]);
    }
    let mut case = case(truth_in("V", 2.1, 0.04, seed), &schedule, seed);
    let content = case.truth.table.content();
    let (imu, unit) = (content.imu.as_str(), content.temperature_unit.as_str());
    let text = campaign_toml(imu, "samples.csv", content.gravity, case.truth.gravity_local, unit, &stated);
    case.file = Campaign::from_toml(&text).unwrap();
    case
}

/// A campaign whose turntable is off by these angles everywhere.
fn turned(seed: u64, turned_deg: [f64; 2]) -> Case {
    let case = at(seed, |angles, _| (0..2).for_each(|k| angles[k] += turned_deg[k]));
    Case { turned_deg, ..case }
}

fn scale(value: &mut u32, factor: f64) {
    *value = (f64::from(*value) * factor).round() as u32;
}

/// Every time divided by `DIVISOR`.
fn shorter<const DIVISOR: u64>(raw: &mut RawSample) {
    raw.timestamp_ns /= DIVISOR;
    raw.interval_ns /= DIVISOR;
    raw.telemetry_ns /= DIVISOR;
}

/// All pulses times `factor`.
fn scale_all(raw: &mut RawSample, factor: f64) {
    for axis in 0..3 {
        scale(&mut raw.accelerometers.positive_pulses[axis], factor);
        scale(&mut raw.accelerometers.negative_pulses[axis], factor);
    }
}

/// The case with the place of the station in its campaign file.
fn with_place(mut case: Case) -> Case {
    // Where normal gravity is the station's; below that of the equator, as high above it as needed.
    let gravity = case.truth.gravity_local;
    let equator = normal_gravity(0.0, 0.0);
    let (mut low, mut high) = (0.0, 90.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        *if normal_gravity(middle, 0.0) < gravity { &mut low } else { &mut high } = middle;
    }
    let height_m = ((equator - gravity) / 3.086e-6).max(0.0);
    let content = case.truth.table.content();
    let (reference, local) = (case.file.gravity_reference, case.file.gravity_local);
    let text = campaign_toml(content.imu.as_str(), "samples.csv", reference, local, "V", &case.schedule.positions);
    let text = format!("latitude_deg = {low:.4}\nheight_m = {height_m:.1}\n{text}");
    case.file_fault = Campaign::from_toml(&text).err().map(|faults| faults.to_string());
    case.file = case.file.at_place(Place::new(low, height_m).unwrap());
    case
}

/// The rows of another IMU of the same kind, from the same station.
fn another_imu(seed: u64) -> Case {
    let right = volts(seed);
    let mut other = truth_in("V", 2.1, 0.04, seed + 100);
    (other.tilt_rad, other.gravity_local) = (right.truth.tilt_rad, right.truth.gravity_local);
    Case { rows: campaign(&other, &right.schedule, seed).collect(), ..right }
}

fn exchanged_gravity(seed: u64) -> Case {
    let mut case = volts(seed);
    std::mem::swap(&mut case.file.gravity_local, &mut case.file.gravity_reference);
    case
}

fn gravity_of_another_place(seed: u64) -> Case {
    let mut case = volts(seed);
    case.file.gravity_local = if case.file.gravity_local > 9.805 { 9.785 } else { 9.825 };
    case
}

fn first_index(case: &Case, set_point_c: f64, number: u32) -> usize {
    case.rows.iter().position(|row| (row.set_point_c, row.position) == (set_point_c, number)).unwrap()
}

/// All mistakes.
pub(crate) fn mistakes() -> Vec<Mistake> {
    use ExpectedOutcome::{InPrinciple, Invisible, Refused, Warned, WarnedAlone};
    fn swap_pulses(raw: &mut RawSample, a: usize, b: usize) {
        raw.accelerometers.positive_pulses.swap(a, b);
        raw.accelerometers.negative_pulses.swap(a, b);
    }
    fn swap_channels(raw: &mut RawSample, axis: usize) {
        std::mem::swap(&mut raw.accelerometers.positive_pulses[axis], &mut raw.accelerometers.negative_pulses[axis]);
    }
    const IN_USE: &str = "the table is right as long as the acquisition stays so";
    macro_rules! list {
        ($($name:literal, $expected:expr, $make:expr;)*) => { vec![$(Mistake { name: $name, make: $make, expected: $expected }),*] };
    }
    list! {
        // Time.
        "intervals in us", Refused("[interval]: interval_ns is 1.000e-3 of the time from row to row in all dwells: it looks 1000 times too short"),
            |seed| acquired(seed, |raw| raw.interval_ns /= 1000);
        "intervals in ms", Refused("it looks 1000000 times too short"), |seed| acquired(seed, |raw| raw.interval_ns /= 1_000_000);
        "intervals in minutes", Refused("it looks 60 times too short"), |seed| acquired(seed, |raw| raw.interval_ns /= 60);
        "intervals 1000 times too long", Refused("give 1 to 3600000000000"), |seed| acquired(seed, |raw| raw.interval_ns *= 1000);
        "timestamps in us, intervals in ns", Refused("1000 times as long, so interval_ns or timestamp_ns is in another unit"),
            |seed| acquired(seed, |raw| raw.timestamp_ns /= 1000);
        "all times in us", Refused("all times look 1000 times too short"), |seed| acquired(seed, shorter::<1000>);
        "all times in ms", Refused("all times look 1000000 times too short"), |seed| acquired(seed, shorter::<1_000_000>);
        "intervals that are not the row's: 9 s of 10 s", Refused("interval_ns is 0.9000 of the time from row to row in all dwells"),
            |seed| acquired(seed, |raw| raw.interval_ns = raw.interval_ns / 10 * 9);
        "interval of a single sample under sums of ten", Refused("interval_ns is 0.1000 of the time from row to row"),
            |seed| rows(seed, |row| row.raw.interval_ns = 1_000_000_000);
        "intervals of 9 s from 20 degC on", Refused("interval_ns is 0.9000 of the time from row to row, here and in 17 more dwells"),
            |seed| rows(seed, |row| if row.set_point_c >= 20.0 && row.position > 6 { row.raw.interval_ns = 9_000_000_000 });
        "all times 0.5 % too long", InPrinciple("the clock of the acquisition is the only one"), |seed| acquired(seed, |raw| {
            raw.timestamp_ns += raw.timestamp_ns / 200;
            raw.interval_ns += raw.interval_ns / 200;
            raw.telemetry_ns += raw.telemetry_ns / 200;
        });
        "no soak between set points", Warned("[soak]"), |seed| rows(seed, |row| {
            let visit = ((row.set_point_c + 20.0) / 10.0).round() as u64;
            row.raw.timestamp_ns -= visit * 4_100_000_000_000;
        });
        // Positions.
        "positions 3 and 9 exchanged", Refused("[positions-exchanged]: positions 3 and 9 look exchanged: exchange their numbers in the campaign file"),
            |seed| numbers(seed, |_, number| exchanged(number, 3, 9));
        "positions 1 and 3 exchanged", Refused("positions 1 and 3 look exchanged"), |seed| numbers(seed, |_, number| exchanged(number, 1, 3));
        "positions 5 and 7 exchanged at 20 degC", Refused("positions 5 and 7 look exchanged at set point 20 degC"),
            |seed| numbers(seed, |set_point, number| if set_point == 20.0 { exchanged(number, 5, 7) } else { number });
        "positions 6 and 11 exchanged from 10 degC on", Refused("positions 6 and 11 look exchanged at 4 of 7 set points"),
            |seed| numbers(seed, |set_point, number| if set_point >= 10.0 { exchanged(number, 6, 11) } else { number });
        "numbers of the positions shifted by one", Refused("the position numbers look shifted by 1"), |seed| numbers(seed, |_, number| number % 12 + 1);
        "numbers of the positions from 0", Refused("no such position; the campaign file lists 1"), |seed| numbers(seed, |_, number| number - 1);
        "position 8 missing everywhere", Refused("position 8 of the campaign file is missing at all 7 set points"), |seed| {
            let mut case = volts(seed);
            case.rows.retain(|row| row.position != 8);
            case
        };
        "position 8 missing at 0 degC", Refused("[missing-position]: samples.csv"), |seed| {
            let mut case = volts(seed);
            case.rows.retain(|row| (row.position, row.set_point_c) != (8, 0.0));
            case
        };
        "a file that is cut in the last set point", Refused("positions 9, 10, 11, 12 of the campaign file are missing"), |seed| {
            let mut case = volts(seed);
            let end = first_index(&case, 40.0, 9);
            case.rows.truncate(end);
            case
        };
        "heading off by 180 degrees", Refused("[heading]: the IMU looks turned by 180 degrees about A3"), |seed| turned(seed, [0.0, 180.0]);
        "heading off by 90 degrees", Refused("add 90 to every inner_deg"), |seed| turned(seed, [0.0, 90.0]);
        "heading off by -90 degrees", Refused("add -90 to every inner_deg"), |seed| turned(seed, [0.0, -90.0]);
        "outer angle off by 90 degrees", Refused("outer_deg of every position looks off by 90 degrees"), |seed| turned(seed, [90.0, 0.0]);
        "gravity instead of specific force in the campaign file", Refused("every specific_force looks to have the wrong sign"), |seed| {
            let mut case = volts(seed);
            for position in &mut case.file.positions {
                position.specific_force = position.specific_force.map(|f| -f);
            }
            case.stated = |force| force.map(|f| -f);
            case.file.mount = isotherm_campaign::mount(&case.file.positions);
            case
        };
        "sign of A2 in the campaign file", Refused("or the sign of A2 in every specific_force"), |seed| {
            let mut case = volts(seed);
            case.file.positions.iter_mut().for_each(|position| position.specific_force[1] *= -1.0);
            case.stated = |[a1, a2, a3]| [a1, -a2, a3];
            case.file.mount = isotherm_campaign::mount(&case.file.positions);
            case
        };
        "position 5 at outer 180 instead of 90", Refused("as at outer_deg = 180.00"), |seed| at(seed, |angles, number| if number == 5 { angles[0] = 180.0 });
        "position 9 at inner 180 instead of 0", Refused("position 9 is 180.0"), |seed| at(seed, |angles, number| if number == 9 { angles[1] = 180.0 });
        "position 7 off by 1 degree", Refused("[position-off]: position 7 is 1.00"), |seed| at(seed, |angles, number| if number == 7 { angles[0] += 1.0 });
        "position 3 off by 0.1 degree", Refused("[position-off]: position 3 is 0.1"), |seed| at(seed, |angles, number| if number == 3 { angles[0] += 0.1 });
        "position 3 off by 0.05 degree", Warned("warning [level]: position 3 is "), |seed| at(seed, |angles, number| if number == 3 { angles[0] += 0.05 });
        "position 3 off by 0.01 degree", Warned("warning [level]: position 3 is "), |seed| at(seed, |angles, number| if number == 3 { angles[0] += 0.01 });
        "position 7 off by 0.05 degree", Warned("warning [level]: position 7 is "), |seed| at(seed, |angles, number| if number == 7 { angles[0] += 0.05 });
        "positions 7 and 8 off by 0.002 g0 on A3", Warned("[level]"),
            |seed| rows(seed, |row| if matches!(row.position, 7 | 8) { row.raw.accelerometers.positive_pulses[2] += 1840; });
        "positions with inner angles from 180 degrees on off by 0.15 degree", Warned("[level]"),
            |seed| at(seed, |angles, _| if angles[1] >= 180.0 { angles[1] += 0.15 });
        "position 10 off by 1 degree at 20 degC", Refused("position 10 is 1.00"), |seed| {
            let (mut case, off) = (volts(seed), at(seed, |angles, number| if number == 10 { angles[0] += 1.0 }));
            for (row, off) in case.rows.iter_mut().zip(off.rows) {
                if (row.set_point_c, row.position) == (20.0, 10) { *row = off; }
            }
            case
        };
        "the turntable moved within a dwell", Refused("position 7: A1 was not still"), |seed| {
            let mut case = volts(seed);
            let from = first_index(&case, 30.0, 7);
            for row in &mut case.rows[from..from + 6] { row.raw.accelerometers.negative_pulses[0] /= 2; }
            case
        };
        // Cables and channels.
        "pulses of A1 and A2 exchanged", Refused("[axes-exchanged]: A1 and A2 look exchanged"), |seed| acquired(seed, |raw| swap_pulses(raw, 0, 1));
        "pulses of A2 and A3 exchanged", Refused("[axes-exchanged]: A2 and A3 look exchanged"), |seed| acquired(seed, |raw| swap_pulses(raw, 1, 2));
        "pulses of A1, A2, A3 in the columns of A2, A3, A1", Refused("the columns a1, a2, a3 carry A3, A1, A2"), |seed| acquired(seed, |raw| {
            raw.accelerometers.positive_pulses.rotate_right(1);
            raw.accelerometers.negative_pulses.rotate_right(1);
        });
        "pulses of A1 and A3 exchanged from 20 degC on", Refused("A1 and A3 look exchanged at 3 of 7 set points"),
            |seed| Case {
                in_use: |raw| swap_pulses(raw, 0, 2),
                ..rows(seed, |row| if row.set_point_c >= 20.0 { swap_pulses(&mut row.raw, 0, 2) })
            };
        "channels of A2 exchanged", Refused("[channels-exchanged]: the two channels of A2 look exchanged"), |seed| acquired(seed, |raw| swap_channels(raw, 1));
        "channels of A1 and A3 exchanged", Refused("the channels of A1 and A3 are exchanged"), |seed| acquired(seed, |raw| { swap_channels(raw, 0); swap_channels(raw, 2); });
        "- channel of A1 dead", Refused("[no-pulses]: the - channel of A1 gives no pulse in the whole campaign"), |seed| acquired(seed, |raw| raw.accelerometers.negative_pulses[0] = 0);
        "A3 dead", Refused("A3 gives no pulse in the whole campaign"), |seed| acquired(seed, |raw| (raw.accelerometers.positive_pulses[2], raw.accelerometers.negative_pulses[2]) = (0, 0));
        "counts without their sign", Refused("no accelerometer gives a pulse on its - channel"), |seed| acquired(seed, |raw| for axis in 0..3 {
            raw.accelerometers.positive_pulses[axis] += raw.accelerometers.negative_pulses[axis];
            raw.accelerometers.negative_pulses[axis] = 0;
        });
        "- channel of A2 divided by 2", Refused("[channels-differ]: A2: K+ is"), |seed| acquired(seed, |raw| scale(&mut raw.accelerometers.negative_pulses[1], 0.5));
        "pulses of A3 divided by 4", Warned("[axes-differ]"), |seed| acquired(seed, |raw| {
            scale(&mut raw.accelerometers.positive_pulses[2], 0.25);
            scale(&mut raw.accelerometers.negative_pulses[2], 0.25);
        });
        "a converter that saturates", Refused("gives the same 92000 pulse/s in every row"),
            |seed| acquired(seed, |raw| raw.accelerometers.positive_pulses[2] = raw.accelerometers.positive_pulses[2].min((92 * raw.interval_ns / 1_000_000) as u32));
        "pulses of all channels divided by 4", Invisible(IN_USE), |seed| acquired(seed, |raw| scale_all(raw, 0.25));
        "pulses of single samples in rows of 10 s", Invisible("the run's samples are whole, and show it"),
            |seed| rows(seed, |row| scale_all(&mut row.raw, 0.1));
        "pulses 0.02 % too many from 10 degC on", Warned("[lack-of-fit]"),
            |seed| rows(seed, |row| if row.set_point_c >= 10.0 { scale_all(&mut row.raw, 1.0002) });
        "rows of another IMU of the same kind", Invisible("a run of the right IMU shows it"), another_imu;
        // Temperature.
        "Fahrenheit under degC", Refused("[temperature-slope]: temperature (a1_head, a1_board and 4 more columns) changes by 1.80"), |seed| in_unit("degC", 32.0, 1.8, seed);
        "Fahrenheit under K", Refused("it looks like degrees Fahrenheit"), |seed| in_unit("K", 32.0, 1.8, seed);
        "kelvin under degC", Refused("it looks like kelvin"), |seed| in_unit("degC", 273.15, 1.0, seed);
        "degC under K", Refused("it looks like degC"), |seed| in_unit("K", 0.0, 1.0, seed);
        "1/1000 degC under degC", Refused("changes by 1000"), |seed| in_unit("degC", 0.0, 1000.0, seed);
        "volts under degC", Warned("[temperature-offset]"), |seed| {
            let mut case = volts(seed);
            case.file.temperature_unit = "degC".to_owned();
            case
        };
        "degC under V", Invisible("the unit is a label: the table is right"), |seed| in_unit("V ", 0.0, 1.0, seed);
        "head temperature of A1 and A2 exchanged", Invisible(IN_USE), |seed| acquired(seed, |raw| raw.accelerometers.head_temperature.swap(0, 1));
        "head temperature of A3 stuck", Refused("[temperature-constant]: a3_head is the same at every set point"), |seed| acquired(seed, |raw| raw.accelerometers.head_temperature[2] = 2.5);
        "board temperature of A1 stuck from 20 degC on", Refused("[temperature-repeated]"), |seed| Case {
            in_use: |raw| raw.accelerometers.board_temperature[0] = 2.9,
            ..rows(seed, |row| if row.set_point_c >= 20.0 { row.raw.accelerometers.board_temperature[0] = 2.9 })
        };
        "board temperature of A1 stuck at 40 degC, with noise", Warned("[lack-of-fit]"), |seed| {
            let mut random = RandomGenerator::new(seed, 79);
            let mut case = volts(seed);
            for row in case.rows.iter_mut().filter(|row| row.set_point_c == 40.0) {
                row.raw.accelerometers.board_temperature[0] = 3.5 + 1e-4 * random.normal();
            }
            case
        };
        "a temperature reading of 0", Refused("[temperature-drift]: samples.csv:7:"), |seed| {
            let mut case = volts(seed);
            case.rows[5].raw.accelerometers.head_temperature[1] = 0.0;
            case
        };
        "labels of the set points 0 and 20 degC exchanged", Warned("[temperature-order]"),
            |seed| rows(seed, |row| row.set_point_c = match row.set_point_c { 0.0 => 20.0, 20.0 => 0.0, other => other });
        // Rows.
        "5 % of the rows missing", Warned("[missing-rows]"), |seed| {
            let mut case = volts(seed);
            case.rows.retain(|row| row.raw.sequence % 20 != 13);
            case
        };
        "a row twice", Refused("time must rise from row to row; is the row there twice?"), |seed| {
            let mut case = volts(seed);
            let mut again = case.rows[700];
            again.raw.sequence += 1;
            case.rows.iter_mut().skip(701).for_each(|row| row.raw.sequence += 1);
            case.rows.insert(701, again);
            case
        };
        "rows of a dwell sorted wrongly", Refused("it must rise from row to row"), |seed| {
            let mut case = volts(seed);
            case.rows.swap(100, 101);
            case
        };
        // Gravity.
        "local and reference gravity exchanged", InPrinciple("all K are wrong alike, in the run too"), exchanged_gravity;
        "the same, over 0.003 m/s2 apart, with latitude_deg and height_m", Refused("exchanged with gravity_reference"), |seed| {
            // The stations of the seeds are at 9.78 to 9.83 m/s2, one g0 is 9.8015 m/s2.
            let seed = (seed * 10..).find(|&seed| (volts(seed).truth.gravity_local - 9.8015).abs() > 0.0035).unwrap();
            with_place(exchanged_gravity(seed))
        };
        "normal gravity of another place as local gravity", InPrinciple("all K are wrong alike, in the run too"), gravity_of_another_place;
        "the same, with latitude_deg and height_m", Refused("or of another place"), |seed| with_place(gravity_of_another_place(seed));
        "local gravity 0.0025 m/s2 off, with latitude_deg and height_m", WarnedAlone("warning [local-gravity]: local gravity is "), |seed| {
            let mut case = volts(seed);
            case.file.gravity_local += 0.0025;
            with_place(case)
        };
    }
}

/// A correct campaign of another laboratory: set points, positions, rows, temperature, tilt and noise are drawn from
/// `seed`. Returns the case and what it is.
pub(crate) fn correct(seed: u64) -> (Case, String) {
    correct_of(seed, |truth| truth)
}

/// The same campaign of an IMU without misalignment.
pub(crate) fn without_misalignment(seed: u64) -> Case {
    let straight = |truth: Truth| {
        let content = truth.table.content().clone();
        Truth::new(content, Matrix3::identity(), truth.tilt_rad, truth.gravity_local).unwrap()
    };
    correct_of(seed, straight).0
}

fn correct_of(seed: u64, imu: impl Fn(Truth) -> Truth) -> (Case, String) {
    let mut random = RandomGenerator::new(seed, 77);
    let mut pick = |count: u64| (random.between(0.0, count as f64) as u64).min(count - 1);
    let set_points_c: Vec<f64> = match pick(6) {
        0 => (-5..=9).map(|k| 5.0 * f64::from(k)).collect(),
        1 => vec![-20.0, 40.0],
        2 => vec![-10.0, 15.0, 40.0],
        3 => vec![40.0, 25.0, 10.0, -5.0, -20.0],
        4 => (-2..=4).chain((-2..=4).rev()).map(|k| 10.0 * f64::from(k)).collect(),
        _ => vec![-24.0, -11.0, -3.0, 8.0, 21.0, 29.0, 44.0],
    };
    let scheme = Scheme::NAMES[pick(3) as usize];
    let (list, mut positions) = match pick(5) {
        2 => {
            let faces = [[0.0, 0.0], [180.0, 0.0], [90.0, 0.0], [90.0, 90.0], [90.0, 180.0], [90.0, 270.0]];
            ("six faces", faces.into_iter().zip(1..).map(|([o, i], number)| Position::at(number, o, i)).collect())
        }
        0 => {
            let outer = [0.0, 35.0, 90.0, 145.0, 180.0, 215.0, 270.0, 325.0];
            let angles =
                outer.into_iter().flat_map(|outer| [0.0, 72.0, 144.0, 216.0, 288.0].map(|inner| [outer, inner]));
            (
                "forty positions",
                angles.zip(100..).map(|([outer, inner], number)| Position::at(number, outer, inner)).collect(),
            )
        }
        1 => {
            // Six faces and eight corners, without a turntable's angles.
            let corner = libm::acos((1.0_f64 / 3.0).sqrt()).to_degrees();
            let corners = [corner, 180.0 - corner]
                .into_iter()
                .flat_map(|outer| [45.0, 135.0, 225.0, 315.0].map(|inner| [outer, inner]));
            let faces = [[0.0, 0.0], [180.0, 0.0], [90.0, 0.0], [90.0, 90.0], [90.0, 180.0], [90.0, 270.0]];
            (
                "faces and corners",
                faces.into_iter().chain(corners).zip(1..).map(|([o, i], number)| Position::at(number, o, i)).collect(),
            )
        }
        _ => (scheme.1, scheme.0.positions()),
    };
    let with_angles = pick(4) > 0;
    let (unit, zero, slope, lsb, noise) = match pick(4) {
        0 => ("degC", 0.0, 1.0, 2000, 2.5e-3),
        1 => ("K", 273.15, 1.0, 10_000, 5e-3),
        2 => ("degC", 20.0, 0.2, 2000, 1e-3),
        _ => ("V", 2.1, 0.04, 76, 1e-4),
    };
    let (interval_ns, dwell_s) = [
        (10_000_000_000, 300.0),
        (60_000_000_000, 240.0),
        (1_000_000_000, 60.0),
        (250_000_000, 30.0),
        (100_000_000_000, 300.0),
    ][pick(5) as usize];
    let tilt = pick(2) > 0;
    let move_s = [1.0, 20.0, 60.0][pick(3) as usize];
    let noise = Noise {
        sensor_g0: [2e-6, 5e-6, 50e-6, 2e-4][pick(4) as usize],
        temperature: noise,
        bias_g0: [0.2e-6, 2e-6, 20e-6][pick(3) as usize],
        scale_factor: [0.3e-6, 5e-6][pick(2) as usize],
        positioning_rad: [1.0, 5.0, 60.0, 600.0][pick(4) as usize] * (1.0_f64 / 3600.0).to_radians(),
        ..Noise::NONE
    };
    let mut truth = imu(truth_in(unit, zero, slope, seed));
    if !tilt {
        truth.tilt_rad = [0.0; 2];
    } else if pick(3) == 0 {
        truth.tilt_rad = [4e-4, -3e-4];
    }
    if !with_angles {
        for position in &mut positions {
            let [outer, inner] = position.angles.unwrap();
            (position.angles, position.specific_force) = (None, specific_force(outer, inner));
        }
    }
    let oscillation_c = [0.05, 0.3][pick(2) as usize];
    let chain = Chain {
        temperature_zero: zero,
        temperature_slope: slope,
        telemetry_lsb_micro: lsb,
        oscillation_c,
        ..Chain::default()
    };
    let words = format!(
        "seed {seed}: {} set points, {list}, {unit} of slope {slope}, rows of {} s in {dwell_s} s, moves of {move_s} s, angles {with_angles}, \
         tilt {:?}, {noise:?}",
        set_points_c.len(),
        interval_ns as f64 / 1e9,
        truth.tilt_rad
    );
    let schedule = CampaignSchedule {
        set_points_c,
        positions,
        interval_ns,
        dwell_s,
        move_s,
        chain,
        noise,
        ..CampaignSchedule::default()
    };
    let mut case = case(truth, &schedule, seed);
    match pick(5) {
        // Sums of raw samples: the sequence is that of the last sample.
        0 => case.rows.iter_mut().for_each(|row| row.raw.sequence = row.raw.sequence * 100 + 99),
        // The acquisition was started again for each set point.
        1 => {
            for row in &mut case.rows {
                row.raw.session = (row.set_point_c * 10.0 + 1000.0) as u64;
            }
        }
        // A row in fifty was lost.
        2 => case.rows.retain(|row| row.raw.sequence % 50 != 7),
        _ => {}
    }
    (case, words)
}
