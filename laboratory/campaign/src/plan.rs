//! The plan of a campaign: everything that is asked for, checked before anything moves.

use super::limits::{self, Limits};
use isotherm_calibration::calibrate::observable;
use isotherm_calibration::campaign::Campaign;
use isotherm_calibration::positions::{Position, SAME_DIRECTION, Scheme, specific_force};
use isotherm_calibration::simulate::campaign_toml;
use isotherm_files::{Guard, LoadError, read_text};
use isotherm_instruments::{ChamberConfig, TurntableConfig};
use isotherm_shared::document::{Document, Faults, Section};
use isotherm_shared::stream::ImuId;
use nalgebra::{Matrix3, Vector3};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The samples' file in the campaign's folder.
pub const SAMPLES: &str = "campaign.csv";
/// Most set points of a plan.
const MAX_SET_POINTS: usize = 1000;

/// A checked plan. Times \[s\] are the laboratory's.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Whose campaign it is.
    pub imu: ImuId,
    /// Folder of everything that the campaign writes.
    pub output: PathBuf,
    /// Chamber temperatures, in order \[degC\].
    pub set_points_c: Vec<f64>,
    /// At each set point, in order; all with angles.
    pub positions: Vec<Position>,
    /// When a set point counts as reached and settled.
    pub soak: Soak,
    /// What is taken in a position.
    pub dwell: Dwell,
    /// How the chamber is led.
    pub ramp_c_per_s: f64,
    /// How the table moves, and when it counts as arrived.
    pub motion: Motion,
    /// What no command and no reading may exceed.
    pub limits: Limits,
    /// How long things may take that should not.
    pub patience: Patience,
    /// The safe state's chamber: a set point to hold \[degC\], or standby.
    pub ambient_c: Option<f64>,
    /// Verification runs.
    pub verify: Option<Verify>,
    /// Where the table goes if the verification holds.
    pub install: Option<PathBuf>,
    /// The chamber's driver and line.
    pub chamber: ChamberConfig,
    /// The table's driver and line.
    pub table: TurntableConfig,
    /// The campaign file that will lie beside the samples.
    pub campaign_toml: String,
    /// The same, read.
    pub campaign: Campaign,
}

/// When a set point counts as settled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Soak {
    /// At the set point before the first position.
    pub time_s: f64,
    /// At the set point in all.
    pub stay_s: f64,
    /// The air is at the set point within this \[degC\].
    pub tolerance_c: f64,
    /// Rates of change are taken over this.
    pub window_s: f64,
    /// Largest rate of change of the air \[degC/h\].
    pub chamber_c_per_h: f64,
    /// Largest rate of change of each of the IMU's temperatures \[unit/h\].
    pub telemetry_per_h: Option<f64>,
}

/// What is taken in a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dwell {
    /// Counted time.
    pub time_s: f64,
    /// Samples are summed into rows of this; 0 for every sample.
    pub row_s: f64,
}

/// How the table moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// \[deg/s\]
    pub rate_deg_s: f64,
    /// \[deg/s2\]
    pub acceleration_deg_s2: f64,
    /// Arrived: this near \[deg\],
    pub tolerance_deg: f64,
    /// this slow \[deg/s\],
    pub still_deg_s: f64,
    /// for this long.
    pub settle_s: f64,
}

/// How long things may take that should not, before the campaign pauses or gives up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// A pause: an instrument or the IMU's stream is away.
    pub pause_s: f64,
    /// Without a usable sample.
    pub stream_s: f64,
    /// To the set point, beyond the ramp.
    pub approach_s: f64,
    /// Until stable, beyond the soak.
    pub stable_s: f64,
    /// Until the table has settled, beyond the way.
    pub settle_s: f64,
    /// An interruption that is longer makes the soak begin anew.
    pub resoak_s: f64,
    /// Attempts at one dwell, and interruptions between two.
    pub attempts: u32,
}

/// Verification: the IMU at rest while the chamber runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verify {
    /// How many.
    pub runs: u32,
    /// Chamber at the beginning \[degC\].
    pub from_c: f64,
    /// Chamber at the end \[degC\].
    pub to_c: f64,
    /// The ramp between them \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Before the ramp, and again after it.
    pub hold_s: f64,
    /// Outer and inner angle \[deg\].
    pub angles_deg: [f64; 2],
    /// Direction of the specific force there.
    pub attitude: [f64; 3],
}

impl Verify {
    /// Where the IMU is at rest.
    pub const fn position(&self) -> Position {
        let label = String::new();
        Position { number: 0, label, angles: Some(self.angles_deg), specific_force: self.attitude }
    }
}

impl Plan {
    /// Reads a plan. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// Everything that is wrong with the file.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        let (text, _) = read_text(path, Guard::Lax)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::from_toml(&text, folder).map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })
    }

    /// Reads a plan's text; `folder` is where its relative paths begin.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub fn from_toml(text: &str, folder: &Path) -> Result<Self, Faults> {
        let document = Document::parse_as(text, "give the campaign plan")?;
        let root = document.root();
        let plan = plan(&root, folder);
        root.finish();
        document.finish(plan)
    }

    /// Whether the text of a TOML file is a plan.
    #[must_use]
    pub fn is_meant(document: &Document<'_>) -> bool {
        ["set_points", "soak", "dwell", "chamber", "limits", "patience", "verify"].iter().any(|key| document.has(key))
    }

    /// What makes the data what they are, for telling whether a journal is this plan's: key and value.
    #[must_use]
    pub fn identity(&self) -> Vec<(String, String)> {
        let pair = |key: &str, value: String| (key.to_owned(), value);
        let Self { soak, dwell, motion, .. } = self;
        let numbers = [
            ("soak.time_s", soak.time_s),
            ("soak.stay_s", soak.stay_s),
            ("soak.window_s", soak.window_s),
            ("soak.chamber_c_per_h", soak.chamber_c_per_h),
            ("dwell.time_s", dwell.time_s),
            ("dwell.row_s", dwell.row_s),
            ("chamber.ramp_c_per_min", self.ramp_c_per_s * 60.0),
            ("chamber.tolerance_c", soak.tolerance_c),
            ("table.rate_deg_s", motion.rate_deg_s),
            ("table.acceleration_deg_s2", motion.acceleration_deg_s2),
            ("table.tolerance_deg", motion.tolerance_deg),
            ("table.still_deg_s", motion.still_deg_s),
            ("table.settle_s", motion.settle_s),
        ];
        let mut identity: Vec<_> = numbers.iter().map(|(key, value)| pair(key, format!("{value:?}"))).collect();
        identity.push(pair("set_points", format!("{:?}", self.set_points_c)));
        identity.extend(soak.telemetry_per_h.map(|limit| pair("soak.telemetry_per_h", format!("{limit:?}"))));
        if let Some(verify) = &self.verify {
            let Verify { runs, from_c, to_c, ramp_c_per_s, hold_s, angles_deg, .. } = verify;
            let ramp = ramp_c_per_s * 3600.0;
            let value = format!(
                "{runs} runs, {from_c:?} to {to_c:?} degC at {ramp:?} degC/h, hold {hold_s:?} s, at {angles_deg:?} deg"
            );
            identity.push(pair("verify", value));
        }
        // What stands above the positions: imu, gravity and the like.
        let above = self.campaign_toml.lines().take_while(|line| !line.starts_with('['));
        identity
            .extend(above.filter_map(|line| line.split_once(" = ")).map(|(key, value)| pair(key, value.to_owned())));
        identity.extend(self.positions.iter().map(|position| {
            let Position { number, angles, specific_force, .. } = position;
            pair(&format!("position.{number}"), format!("{:?} deg, {specific_force:?}", angles.unwrap_or_default()))
        }));
        identity
    }
}

fn plan(root: &Section<'_, '_>, folder: &Path) -> Option<Plan> {
    let format = root.number("format", "format = 1, the version of this file format");
    root.refuse("format", format.filter(|f| *f != 1.0).map(|_| "unknown; this version reads format = 1".to_owned()));
    // Read as the campaign file that it becomes, below; asked for here so that the plan knows them.
    let about = About::read(root);
    let output = root.string("output", "the folder that the campaign is written into").map(|path| folder.join(path));
    let install = root.optional_string("install").map(|path| folder.join(path));
    let limits = root.section("limits", "[limits] with chamber_c, outer_deg and inner_deg").and_then(limits::read);
    // What is wrong with one section is no reason not to look at the others.
    let (chamber, ramp_c_per_s, tolerance_c) = chamber(root);
    let (table, motion, mounting) = table(root);
    let mounted_as = mounting.unwrap_or_else(Matrix3::identity);
    let set_points_c = root.section("set_points", "[set_points] with start_c, stop_c and step_c, or list_c");
    let set_points_c = set_points_c.and_then(set_points);
    let positions = positions(root, &mounted_as);
    let soak = soak(root, tolerance_c);
    let dwell = dwell(root);
    let patience = patience(root);
    let ambient_c = safe(root);
    let verify = root.optional_section("verify").and_then(|section| verify(section, &mounted_as));
    let campaign_toml = about?.campaign(positions.as_ref()?);
    let campaign = match Campaign::from_toml(&campaign_toml) {
        Ok(campaign) => campaign,
        // The same keys, so that what is wrong with them is said of the plan.
        Err(faults) => {
            faults.0.iter().for_each(|fault| root.fault(&fault.key, fault.message.clone()));
            return None;
        }
    };
    if let Err(error) = observable(&campaign) {
        root.fault("positions", error.to_string());
    }
    let plan = Plan {
        imu: campaign.imu.clone(),
        output: output?,
        set_points_c: set_points_c?,
        positions: positions?,
        soak,
        dwell,
        ramp_c_per_s,
        motion,
        limits: limits?,
        patience,
        ambient_c,
        verify,
        install,
        chamber: chamber?,
        table: mounting.and(table)?,
        campaign_toml,
        campaign,
    };
    within_limits(root, &plan);
    Some(plan)
}

/// What goes into the campaign file as it is.
struct About<'d> {
    imu: ImuId,
    serial: Option<&'d str>,
    gravity: [f64; 2],
    unit: &'d str,
    out_of_range: Option<&'d str>,
    positive: [(&'static str, Option<f64>); 2],
}

impl<'d> About<'d> {
    fn read(root: &Section<'d, '_>) -> Option<Self> {
        let imu = root.imu_id("imu");
        let serial = root.optional_string("serial");
        let reference = root.number("gravity_reference", "the value of 1 g0 in m/s2, for example 9.8015");
        let local = root.number("gravity_local", "gravity at the station in m/s2");
        let unit = root.string("temperature_unit", "the unit of the telemetry, for example \"V\"");
        let out_of_range = root.optional_string("out_of_range");
        let positive = ["max_age_s", "max_rate"].map(|key| (key, root.optional_number(key)));
        Some(Self { imu: imu?, serial, gravity: [reference?, local?], unit: unit?, out_of_range, positive })
    }

    fn campaign(&self, positions: &[Position]) -> String {
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let mut text = String::new();
        // Writing to a String cannot fail.
        for (key, value) in [("serial", self.serial), ("out_of_range", self.out_of_range)] {
            let _ = value.map(|value| writeln!(text, "{key} = {}", quoted(value)));
        }
        for (key, value) in self.positive {
            let _ = value.map(|value| writeln!(text, "{key} = {value:?}"));
        }
        let [reference, local] = self.gravity;
        text + &campaign_toml(&self.imu, SAMPLES, reference, local, self.unit, positions)
    }
}

/// A number over 0, or `default`.
pub(super) fn positive(section: &Section<'_, '_>, key: &'static str, default: f64) -> f64 {
    let value = section.optional_number(key);
    section.refuse(key, value.filter(|v| *v <= 0.0).map(|v| format!("is {v:?}, give a number over 0")));
    value.unwrap_or(default)
}

/// A number from 0 up, or `default`.
fn not_negative(section: &Section<'_, '_>, key: &'static str, default: f64) -> f64 {
    let value = section.optional_number(key);
    section.refuse(key, value.filter(|v| *v < 0.0).map(|v| format!("is {v:?}, give a number from 0 up")));
    value.unwrap_or(default)
}

/// A number over 0 and up to `most`, or `default`.
fn at_most(section: &Section<'_, '_>, key: &'static str, default: f64, most: f64) -> f64 {
    let value = section.optional_number(key);
    let wrong = value.filter(|value| !(*value > 0.0 && *value <= most));
    section.refuse(key, wrong.map(|value| format!("is {value:?}, give a number over 0 and up to {most:?}")));
    value.unwrap_or(default)
}

fn chamber(root: &Section<'_, '_>) -> (Option<ChamberConfig>, f64, f64) {
    let Some(section) = root.section("chamber", "[chamber] with driver and port") else {
        return (None, 1.0 / 60.0, 0.5);
    };
    let config = ChamberConfig::read(&section);
    let ramp_c_per_s = positive(&section, "ramp_c_per_min", 1.0) / 60.0;
    let tolerance_c = at_most(&section, "tolerance_c", 0.5, 5.0);
    section.finish();
    (config, ramp_c_per_s, tolerance_c)
}

fn table(root: &Section<'_, '_>) -> (Option<TurntableConfig>, Motion, Option<Matrix3<f64>>) {
    let section = root.section("table", "[table] with driver and port");
    let config = section.as_ref().and_then(TurntableConfig::read);
    let number = |key, default, most| section.as_ref().map_or(default, |section| at_most(section, key, default, most));
    let motion = Motion {
        rate_deg_s: number("rate_deg_s", 10.0, f64::INFINITY),
        acceleration_deg_s2: number("acceleration_deg_s2", 10.0, f64::INFINITY),
        tolerance_deg: number("tolerance_deg", 0.005, 1.0),
        still_deg_s: number("still_deg_s", 0.01, 1.0),
        settle_s: section.as_ref().map_or(10.0, |section| not_negative(section, "settle_s", 10.0)),
    };
    let mounting = section.as_ref().and_then(mounting);
    if let Some(section) = section {
        section.finish();
    }
    (config, motion, mounting)
}

/// How the IMU sits on the table: a rotation.
fn mounting(section: &Section<'_, '_>) -> Option<Matrix3<f64>> {
    if !section.has("mounting") {
        return Some(Matrix3::identity());
    }
    let right = "three rows of three numbers, a rotation: the specific force along A1, A2, A3 is mounting times that at the \
                 table's angles";
    let rows = section.matrix("mounting", right)?;
    let flat: Vec<f64> = rows.iter().flatten().copied().collect();
    let matrix = (rows.len() == 3 && flat.len() == 9).then(|| Matrix3::from_row_slice(&flat));
    let rotation =
        |m: &Matrix3<f64>| (m * m.transpose() - Matrix3::identity()).amax() < SAME_DIRECTION && m.determinant() > 0.0;
    let matrix = matrix.filter(rotation);
    if matrix.is_none() {
        section.fault("mounting", format!("give {right}"));
    }
    matrix
}

fn set_points(section: Section<'_, '_>) -> Option<Vec<f64>> {
    let steps = ["start_c", "stop_c", "step_c"];
    let list = if section.has("list_c") {
        for key in steps.into_iter().filter(|key| section.has(key)) {
            section.number(key, "a number of degC");
            section.fault(key, "there is list_c too; give either");
        }
        section.numbers("list_c", "set points in degC, for example [-25, 0, 45]")
    } else {
        let [start, stop, step] = steps.map(|key| section.number(key, "a number of degC, or list_c instead of these"));
        start.zip(stop).zip(step).and_then(|((start, stop), step)| {
            let steps = (stop - start) / step;
            if !(0.0..MAX_SET_POINTS as f64).contains(&steps) || (steps - steps.round()).abs() > 1e-6 {
                section.fault("step_c", format!("{step:?} does not lead from {start:?} to {stop:?}"));
                return None;
            }
            // To 1e-9 degC, so that 0.1 three times is 0.3.
            let at = |index: u32| ((start + step * f64::from(index)) * 1e9).round() / 1e9;
            Some((0..=steps.round() as u32).map(at).collect())
        })
    };
    let list = list.filter(|list| {
        let twice = list.windows(2).find(|pair| pair[0] == pair[1]);
        let wrong = match twice {
            Some(pair) => Some(format!("{:?} comes twice in a row", pair[0])),
            None if (1..=MAX_SET_POINTS).contains(&list.len()) => None,
            None => Some(format!("has {} set points, give 1 to {MAX_SET_POINTS}", list.len())),
        };
        let right = wrong.is_none();
        section.refuse("list_c", wrong);
        right
    });
    section.finish();
    list
}

fn positions(root: &Section<'_, '_>, mounting: &Matrix3<f64>) -> Option<Vec<Position>> {
    let scheme = root.optional_choice("positions", &Scheme::NAMES);
    let sections = root.list("position");
    if scheme.is_some() && !sections.is_empty() {
        root.fault("positions", "there are [[position]] too; give one of the two");
    }
    if sections.is_empty() {
        let scheme = scheme.unwrap_or(Scheme::SixFacesTwoHeadings);
        let numbered = (1..).zip(scheme.angles());
        return Some(numbered.map(|(number, [outer, inner])| at(number, "", [outer, inner], mounting)).collect());
    }
    let mut positions: Vec<Position> = Vec::new();
    let mut complete = true;
    for section in sections {
        match position(&section, mounting) {
            Some(position) if positions.iter().any(|other| other.number == position.number) => {
                section.fault("number", format!("{} is there twice", position.number));
            }
            Some(position) => positions.push(position),
            None => complete = false,
        }
        section.finish();
    }
    complete.then_some(positions)
}

/// A position at the table's angles \[deg\]; without a label it is called after what points up.
fn at(number: u32, label: &str, [outer, inner]: [f64; 2], mounting: &Matrix3<f64>) -> Position {
    let force = mounted(mounting, [outer, inner]);
    let up = force.iter().position(|f| (f.abs() - 1.0).abs() < 1e-9);
    let named = up.map_or_else(
        || format!("{outer}/{inner}"),
        |axis| format!("{}{}", if force[axis] > 0.0 { '+' } else { '-' }, ["x", "y", "z"][axis]),
    );
    let label = if label.is_empty() { named } else { label.to_owned() };
    Position { number, label, angles: Some([outer, inner]), specific_force: force }
}

/// Direction of the specific force along A1, A2, A3 at the table's angles \[deg\].
fn mounted(mounting: &Matrix3<f64>, [outer, inner]: [f64; 2]) -> [f64; 3] {
    (mounting * Vector3::from(specific_force(outer, inner))).map(|f| f + 0.0).into()
}

fn position(section: &Section<'_, '_>, mounting: &Matrix3<f64>) -> Option<Position> {
    let number = section.optional_integer("number", 0..=i64::from(u32::MAX));
    if !section.has("number") {
        section.fault("number", "missing; give the number that the samples will carry");
    }
    let label = section.optional_string("up").unwrap_or_default();
    let outer = section.number("outer_deg", "the table's outer angle in degrees");
    let inner = section.number("inner_deg", "the table's inner angle in degrees");
    let claimed = section.has("specific_force").then(|| section.numbers("specific_force", "three numbers"));
    let position = at(u32::try_from(number?).ok()?, label, [outer?, inner?], mounting);
    if let Some(claimed) = claimed {
        let there = position.specific_force;
        let agrees = |claimed: &Vec<f64>| {
            claimed.len() == 3 && claimed.iter().zip(there).all(|(a, b)| (a - b).abs() < SAME_DIRECTION)
        };
        if !claimed.is_some_and(|claimed| agrees(&claimed)) {
            let [a1, a2, a3] = there;
            let message = format!(
                "the angles and the mounting give [{a1:.3}, {a2:.3}, {a3:.3}]; correct either, or leave specific_force out"
            );
            section.fault("specific_force", message);
        }
    }
    Some(position)
}

fn soak(root: &Section<'_, '_>, tolerance_c: f64) -> Soak {
    let mut soak = Soak {
        time_s: 3600.0,
        stay_s: 4200.0,
        tolerance_c,
        window_s: 900.0,
        chamber_c_per_h: 2.0,
        telemetry_per_h: None,
    };
    if let Some(section) = root.optional_section("soak") {
        soak.time_s = not_negative(&section, "time_s", soak.time_s);
        soak.stay_s = not_negative(&section, "stay_s", soak.stay_s);
        soak.window_s = positive(&section, "window_s", soak.window_s);
        soak.chamber_c_per_h = positive(&section, "chamber_c_per_h", soak.chamber_c_per_h);
        soak.telemetry_per_h =
            section.has("telemetry_per_h").then(|| positive(&section, "telemetry_per_h", f64::INFINITY));
        section.finish();
    }
    soak
}

fn dwell(root: &Section<'_, '_>) -> Dwell {
    let mut dwell = Dwell { time_s: 300.0, row_s: 10.0 };
    if let Some(section) = root.optional_section("dwell") {
        dwell.time_s = positive(&section, "time_s", dwell.time_s);
        dwell.row_s = not_negative(&section, "row_s", dwell.row_s);
        let long = (dwell.row_s > dwell.time_s.min(3600.0))
            .then(|| format!("is {:?}, give at most the dwell and an hour", dwell.row_s));
        section.refuse("row_s", long);
        section.finish();
    }
    dwell
}

fn patience(root: &Section<'_, '_>) -> Patience {
    let mut patience = Patience {
        pause_s: 1800.0,
        stream_s: 60.0,
        approach_s: 7200.0,
        stable_s: 7200.0,
        settle_s: 120.0,
        resoak_s: 600.0,
        attempts: 5,
    };
    if let Some(section) = root.optional_section("patience") {
        let Patience { pause_s, stream_s, approach_s, stable_s, settle_s, resoak_s, attempts } = &mut patience;
        let times: [(&'static str, &mut f64); 5] = [
            ("pause_s", pause_s),
            ("stream_s", stream_s),
            ("approach_s", approach_s),
            ("stable_s", stable_s),
            ("settle_s", settle_s),
        ];
        times.into_iter().for_each(|(key, value)| *value = positive(&section, key, *value));
        *resoak_s = not_negative(&section, "resoak_s", *resoak_s);
        *attempts = section.optional_integer("attempts", 1..=100).map_or(*attempts, |attempts| attempts as u32);
        section.finish();
    }
    patience
}

/// The chamber's set point in the safe state; `None` is standby.
fn safe(root: &Section<'_, '_>) -> Option<f64> {
    let section = root.optional_section("safe")?;
    let ambient = section.optional_choice("chamber", &[(false, "standby"), (true, "ambient")]).unwrap_or_default();
    let ambient_c = section.optional_number("ambient_c").unwrap_or(20.0);
    section.finish();
    ambient.then_some(ambient_c)
}

fn verify(section: Section<'_, '_>, mounting: &Matrix3<f64>) -> Option<Verify> {
    let runs = section.optional_integer("runs", 1..=100).unwrap_or(3) as u32;
    let from_c = section.number("from_c", "the chamber's temperature at the beginning in degC");
    let to_c = section.number("to_c", "the chamber's temperature at the end in degC");
    let ramp_c_per_s = positive(&section, "ramp_c_per_h", 20.0) / 3600.0;
    let hold_s = not_negative(&section, "hold_s", 1800.0);
    let angle = |key, default| section.optional_number(key).unwrap_or(default);
    let angles_deg = [angle("outer_deg", 50.0), angle("inner_deg", 130.0)];
    section.finish();
    let attitude = mounted(mounting, angles_deg);
    Some(Verify { runs, from_c: from_c?, to_c: to_c?, ramp_c_per_s, hold_s, angles_deg, attitude })
}

/// Everything that the plan will command, against its limits.
fn within_limits(root: &Section<'_, '_>, plan: &Plan) {
    let Plan { limits, motion, .. } = plan;
    let sweep = plan.verify.iter().flat_map(|verify| [verify.from_c, verify.to_c]);
    // The air is at a set point within the tolerance, which must not be an alarm.
    let tolerance = plan.soak.tolerance_c;
    let temperatures = plan.set_points_c.iter().map(|&t| ("set_points", t)).chain(sweep.map(|t| ("verify", t)));
    for (key, temperature) in temperatures {
        let outside = |t: f64| limits.chamber(t).map(|wrong| (t, wrong));
        let wrong = [0.0, -tolerance, tolerance].into_iter().find_map(|off| outside(temperature + off));
        let wrong = wrong.map(|(t, wrong)| {
            if t == temperature { wrong } else { format!("{temperature:?} degC, within chamber.tolerance_c: {wrong}") }
        });
        root.refuse(key, wrong);
    }
    root.refuse("safe", plan.ambient_c.and_then(|ambient_c| limits.chamber(ambient_c)));
    let ramps = plan.verify.iter().map(|verify| ("verify", verify.ramp_c_per_s));
    for (key, ramp) in ramps.chain([("chamber", plan.ramp_c_per_s)]) {
        root.refuse(key, limits.ramp(ramp * 60.0));
    }
    for position in &plan.positions {
        let wrong = limits.angles(position.angles.unwrap_or_default());
        root.refuse("positions", wrong.map(|wrong| format!("position {}: {wrong}", position.number)));
    }
    root.refuse("verify", plan.verify.and_then(|verify| limits.angles(verify.angles_deg)));
    root.refuse("table", limits.motion(motion.rate_deg_s, motion.acceleration_deg_s2));
}

#[cfg(test)]
mod tests;
