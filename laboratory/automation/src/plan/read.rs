//! Parsing a plan. Each part is checked where it is read, against the plan's limits too. All faults are reported at
//! once.

use super::files::{ramp_file, samples_file};
use super::imus::{PlannedImu, batch, imus, imus_toml};
use super::model::{DwellPlan, MotionPlan, Patience, Plan, RampPlan, SoakPlan, VerificationPlan};
use super::number::{at_most, not_negative, positive};
use super::ramps::ramps;
use super::stay::{AirLimits, position_at, way};
use super::turns::{self, PlanTurn, turn_plan};
use crate::limits::{self, Limits};
use isotherm_campaign::{Campaign, IMU, Position, Ramp, SAME_DIRECTION, Scheme, mounting};
use isotherm_files::target_of;
use isotherm_fit::observable;
use isotherm_instruments::{ChamberConfig, TurntableConfig};
use isotherm_shared::document::{Faults, Section};
use isotherm_shared::names::ImuId;
use isotherm_simulation::campaign_toml;
use isotherm_support::failure::shown;
use nalgebra::Matrix3;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Largest number of set points of a plan.
const MAX_SET_POINTS: usize = 1000;

/// Reads a plan. A fault in one part does not stop the checks of the others. With `to_run`, the folder of `install`
/// must exist.
pub(super) fn plan(root: &Section<'_, '_>, folder: &Path, to_run: bool) -> Option<Plan> {
    let format = root.number("format", "format = 1, the version of this file format");
    root.refuse("format", format.filter(|f| *f != 1.0).map(|_| "unknown; this version reads format = 1".to_owned()));
    // These values are checked below, by the parser of the campaign file that they go into.
    let is_batch = root.has("imus");
    let header = CampaignHeader::read(root, is_batch);
    let output = root.string("output", "the folder that the campaign is written into").map(|path| folder.join(path));
    let (install, imus) = installations(root, folder, to_run);
    let limits = root.section("limits", "[limits] with chamber_c, outer_deg and inner_deg").map(limits::read);
    let limits = &limits.unwrap_or(Limits::ABSOLUTE);
    let (chamber, ramp_c_per_s, tolerance_c) = chamber(root, limits);
    let (turntable, motion, mounting) = turntable(root, limits, is_batch);
    let rotation = mounting.unwrap_or_else(Matrix3::identity);
    let air = AirLimits { limits, tolerance_c };
    let set_points_c = root.section("set_points", "[set_points] with start_c, stop_c and step_c, or list_c");
    let set_points_c = set_points_c.and_then(|section| set_points(section, &air));
    let positions = positions(root, &rotation, limits);
    let turns = turns::turns(root, positions.as_ref(), &rotation, header.latitude_deg(), limits);
    let turn = turn_plan(root, limits, turns.as_deref());
    let soak = soak(root, tolerance_c);
    let dwell = dwell(root);
    let patience = patience(root);
    let ambient_c = safe(root, limits);
    let ramps = ramps(root, &rotation, &air);
    let verify = root.optional_section("verify").and_then(|section| verify(section, &rotation, &air));
    let (ramps_in_file, imus_in_file) = (ramps.as_deref().unwrap_or_default(), imus.as_deref().unwrap_or_default());
    let campaign_toml = header.campaign(positions.as_deref(), turns.as_deref(), ramps_in_file, imus_in_file);
    let campaigns = Campaign::batch_from_toml(&campaign_toml);
    // The keys are the same in both files; therefore the faults are reported as faults of the plan.
    let report = |faults: Faults| faults.0.into_iter().for_each(|fault| root.fault(&fault.key, fault.message));
    let campaigns = campaigns.map_err(report).ok()?;
    // The others of a batch differ only by their mountings.
    let campaign = campaigns.first()?.clone();
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
        turns: turns?.into_iter().map(|(_, planned)| planned).collect(),
        turn,
        ramps: ramps?,
        ramp_c_per_s,
        motion,
        limits: *limits,
        patience,
        ambient_c,
        verify,
        install,
        chamber: chamber?,
        turntable: mounting.and(turntable)?,
        campaign_toml,
        campaign,
        member: None,
        batch: Vec::new(),
    };
    if !is_batch {
        return header.imu.map(|imu| Plan { imu, ..plan });
    }
    Some(batch(plan, imus?, campaigns))
}

/// The file that the table of a single IMU is installed as, and the IMUs of a batch; no IMUs without one, and `None` if
/// one of them is wrong.
fn installations(root: &Section<'_, '_>, folder: &Path, to_run: bool) -> (Option<PathBuf>, Option<Vec<PlannedImu>>) {
    let refuse_install = |file: &Path| if to_run { missing_folder(file) } else { None };
    if root.has("imus") {
        return (None, imus(root, folder, refuse_install));
    }
    let install = root.optional_string("install").map(|path| folder.join(path));
    root.refuse("install", install.as_deref().and_then(refuse_install));
    (install, Some(Vec::new()))
}

/// The fault of a file to be written whose folder does not exist.
fn missing_folder(file: &Path) -> Option<String> {
    // The installation writes where a link leads.
    let file = if file.is_symlink() { target_of(file) } else { file.to_owned() };
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty())?;
    (!folder.is_dir()).then(|| format!("there is no folder {}; make it", shown(folder)))
}

/// The values that go into the campaign file unchanged.
struct CampaignHeader<'d> {
    imu: Option<ImuId>,
    serial: Option<&'d str>,
    gravity: [Option<f64>; 2],
    unit: Option<&'d str>,
    out_of_range: Option<&'d str>,
    numbers: [(&'static str, Option<f64>); 4],
}

impl<'d> CampaignHeader<'d> {
    /// The IMUs of a batch are not read here.
    fn read(root: &Section<'d, '_>, is_batch: bool) -> Self {
        let reference = root.number("gravity_reference", "the value of 1 g0 in m/s2, for example 9.8015");
        let local = root.number("gravity_local", "gravity at the station in m/s2");
        Self {
            imu: if is_batch { None } else { root.imu_id("imu") },
            serial: if is_batch { None } else { root.optional_string("serial") },
            gravity: [reference, local],
            unit: root.string("temperature_unit", "the unit of the temperature, for example \"V\""),
            out_of_range: root.optional_string("out_of_range"),
            numbers: ["max_age_s", "max_rate", "latitude_deg", "height_m"].map(|key| (key, root.optional_number(key))),
        }
    }

    fn latitude_deg(&self) -> Option<f64> {
        self.numbers.iter().find(|(key, _)| *key == "latitude_deg").and_then(|(_, value)| *value)
    }

    /// The text of the campaign file. Valid values, positions and turns replace missing ones, which are reported as
    /// faults already, so that the other parts are checked.
    fn campaign(
        &self,
        positions: Option<&[Position]>,
        turns: Option<&[PlanTurn]>,
        ramps: &[RampPlan],
        imus: &[PlannedImu],
    ) -> String {
        let positions = positions.map_or_else(|| Scheme::SixFacesTwoHeadings.positions(), <[_]>::to_vec);
        let whole_turns =
            || turns::whole_turns(&positions, &Matrix3::identity(), self.latitude_deg(), &Limits::ABSOLUTE);
        let turns = turns.map_or_else(|| whole_turns().unwrap_or_default(), <[_]>::to_vec);
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let mut text = String::new();
        // Writing to a String cannot fail.
        for (key, value) in [("serial", self.serial), ("out_of_range", self.out_of_range)] {
            let _ = value.map(|value| writeln!(text, "{key} = {}", quoted(value)));
        }
        for (key, value) in self.numbers {
            let _ = value.map(|value| writeln!(text, "{key} = {value:?}"));
        }
        let imu = self.imu.as_ref().map_or("imu", ImuId::as_str);
        let [reference, local] = self.gravity.map(|gravity| gravity.unwrap_or(9.8));
        let in_files = if imus.is_empty() { None } else { Some(IMU) };
        let samples = samples_file(in_files);
        text += &campaign_toml(imu, &samples, reference, local, self.unit.unwrap_or("V"), &positions);
        if !imus.is_empty() {
            text = text.replacen(&format!("imu = \"{imu}\"\n"), &imus_toml(imus), 1);
        }
        let turns = turns.iter().map(|(turn, _)| turn.to_toml());
        let ramps = ramps.iter().enumerate().map(|(number, ramp)| {
            Ramp { samples: ramp_file(number, in_files), specific_force: Some(ramp.attitude.specific_force) }.to_toml()
        });
        turns.chain(ramps).fold(text, |text, section| text + "\n" + &section)
    }
}

/// The chamber's configuration, its ramp \[degC/s\], and the tolerance of its air \[degC\].
fn chamber(root: &Section<'_, '_>, limits: &Limits) -> (Option<ChamberConfig>, f64, f64) {
    let Some(section) = root.section("chamber", "[chamber] with driver and port") else {
        return (None, 1.0 / 60.0, 0.5);
    };
    let config = ChamberConfig::read(&section);
    let ramp_c_per_min = positive(&section, "ramp_c_per_min", 1.0);
    section.refuse("ramp_c_per_min", limits.ramp(ramp_c_per_min));
    let tolerance_c = at_most(&section, "tolerance_c", 0.5, 5.0);
    section.finish();
    (config, ramp_c_per_min / 60.0, tolerance_c)
}

/// The turntable's configuration, its motion, and the mounting of the IMU; the mounting is `None` if it is wrong.
///
/// In a batch the mounting is the identity: each IMU has its own.
fn turntable(
    root: &Section<'_, '_>,
    limits: &Limits,
    is_batch: bool,
) -> (Option<TurntableConfig>, MotionPlan, Option<Matrix3<f64>>) {
    let section = root.section("turntable", "[turntable] with driver and port");
    let config = section.as_ref().and_then(TurntableConfig::read);
    let number =
        |key, default, limit| section.as_ref().map_or(default, |section| at_most(section, key, default, limit));
    let motion = MotionPlan {
        rate_deg_s: number("rate_deg_s", 10.0, f64::INFINITY),
        acceleration_deg_s2: number("acceleration_deg_s2", 10.0, f64::INFINITY),
        tolerance_deg: number("tolerance_deg", 0.005, 1.0),
        still_deg_s: number("still_deg_s", 0.01, 1.0),
        settle_s: section.as_ref().map_or(10.0, |section| not_negative(section, "settle_s", 10.0)),
    };
    let mounting = section.as_ref().and_then(mounting);
    if let Some(section) = section.as_ref().filter(|section| is_batch && section.has("mounting")) {
        section.fault("mounting", "there is imus, where each IMU has its own mounting; give it there");
    }
    if let Some(section) = section {
        section.refuse("rate_deg_s", limits.rate(motion.rate_deg_s));
        section.refuse("acceleration_deg_s2", limits.acceleration(motion.acceleration_deg_s2));
        section.finish();
    }
    (config, motion, mounting)
}

fn set_points(section: Section<'_, '_>, air: &AirLimits<'_>) -> Option<Vec<f64>> {
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
            // Rounded to 1e-9 degC, so that three steps of 0.1 give exactly 0.3.
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
    // One wrong key makes many set points wrong: name the first of them and count the others.
    let mut wrong = list.iter().flatten().filter_map(|celsius| air.set_point(*celsius));
    section.refuse(
        "",
        wrong.next().map(|first| match wrong.count() {
            0 => first,
            more => format!("{first}; so are {more} more set points"),
        }),
    );
    section.finish();
    list
}

fn positions(root: &Section<'_, '_>, mounting: &Matrix3<f64>, limits: &Limits) -> Option<Vec<Position>> {
    let wrong_angles = |position: &Position| limits.angles(position.angles.unwrap_or_default());
    let scheme = root.optional_choice("positions", &Scheme::NAMES);
    let sections = root.list("position");
    if scheme.is_some() && !sections.is_empty() {
        root.fault("positions", "there are [[position]] too; give one of the two");
    }
    if sections.is_empty() {
        let scheme = scheme.unwrap_or(Scheme::SixFacesTwoHeadings);
        let numbered = (1..).zip(scheme.angles());
        let positions = numbered.map(|(number, [outer, inner])| position_at(number, "", [outer, inner], mounting));
        let positions: Vec<_> = positions.collect();
        for position in &positions {
            let wrong = wrong_angles(position);
            root.refuse("positions", wrong.map(|wrong| format!("position {}: {wrong}", position.number)));
        }
        return Some(positions);
    }
    let mut positions: Vec<Position> = Vec::new();
    let mut complete = true;
    for section in sections {
        let position = position(&section, mounting);
        section.refuse("", position.as_ref().and_then(wrong_angles));
        match position {
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

fn position(section: &Section<'_, '_>, mounting: &Matrix3<f64>) -> Option<Position> {
    let number = section.integer("number", 0..=i64::from(u32::MAX), "the number that the samples will carry");
    let label = section.optional_string("up").unwrap_or_default();
    let outer = section.number("outer_deg", "the turntable's outer angle in degrees");
    let inner = section.number("inner_deg", "the turntable's inner angle in degrees");
    let claimed = section.has("specific_force").then(|| section.numbers("specific_force", "three numbers"));
    let position = position_at(u32::try_from(number?).ok()?, label, [outer?, inner?], mounting);
    if let Some(claimed) = claimed {
        let actual = position.specific_force;
        let agrees = |claimed: &Vec<f64>| {
            claimed.len() == 3 && claimed.iter().zip(actual).all(|(a, b)| (a - b).abs() < SAME_DIRECTION)
        };
        if !claimed.is_some_and(|claimed| agrees(&claimed)) {
            let [a1, a2, a3] = actual;
            let message = format!(
                "the angles and the mounting give [{a1:.3}, {a2:.3}, {a3:.3}]; correct either, or leave specific_force out"
            );
            section.fault("specific_force", message);
        }
    }
    Some(position)
}

fn soak(root: &Section<'_, '_>, tolerance_c: f64) -> SoakPlan {
    let mut soak = SoakPlan {
        time_s: 3600.0,
        stay_s: 4200.0,
        tolerance_c,
        window_s: 900.0,
        chamber_c_per_h: 2.0,
        temperature_per_h: None,
    };
    if let Some(section) = root.optional_section("soak") {
        soak.time_s = not_negative(&section, "time_s", soak.time_s);
        soak.stay_s = not_negative(&section, "stay_s", soak.stay_s);
        soak.window_s = positive(&section, "window_s", soak.window_s);
        soak.chamber_c_per_h = positive(&section, "chamber_c_per_h", soak.chamber_c_per_h);
        soak.temperature_per_h =
            section.has("temperature_per_h").then(|| positive(&section, "temperature_per_h", f64::INFINITY));
        section.finish();
    }
    soak
}

fn dwell(root: &Section<'_, '_>) -> DwellPlan {
    let mut dwell = DwellPlan { time_s: 300.0, row_s: 10.0 };
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
fn safe(root: &Section<'_, '_>, limits: &Limits) -> Option<f64> {
    let section = root.optional_section("safe")?;
    let ambient = section.optional_choice("chamber", &[(false, "standby"), (true, "ambient")]).unwrap_or_default();
    let ambient_c = section.optional_number("ambient_c").unwrap_or(20.0);
    let ambient_c = ambient.then_some(ambient_c);
    section.refuse("ambient_c", ambient_c.and_then(|celsius| limits.chamber(celsius)));
    section.finish();
    ambient_c
}

fn verify(section: Section<'_, '_>, mounting: &Matrix3<f64>, air: &AirLimits<'_>) -> Option<VerificationPlan> {
    let runs = section.optional_integer("runs", 1..=100).unwrap_or(3) as u32;
    let way = way(&section, air);
    let attitudes = attitudes(&section, mounting, air.limits);
    let few = attitudes.as_ref().map(Vec::len).filter(|attitudes| *attitudes > runs as usize);
    section.refuse(
        "runs",
        few.map(|attitudes| format!("is {runs}, give at least one for each of the {attitudes} attitudes")),
    );
    section.finish();
    Some(VerificationPlan { runs, way: way?, attitudes: attitudes? })
}

/// The attitudes of the verification runs: `attitudes_deg`, or one with `outer_deg` and `inner_deg`.
fn attitudes(section: &Section<'_, '_>, mounting: &Matrix3<f64>, limits: &Limits) -> Option<Vec<Position>> {
    let angle = |key, default| section.optional_number(key).unwrap_or(default);
    let one = [angle("outer_deg", 50.0), angle("inner_deg", 130.0)];
    let right = "outer and inner angle of each attitude in deg, for example [[50, 130], [230, 130]]";
    let angles: Vec<[f64; 2]> = if section.has("attitudes_deg") {
        section.forbid(&["outer_deg", "inner_deg"], "there is attitudes_deg too; give either");
        let rows = section.matrix("attitudes_deg", right)?;
        let pairs = rows.iter().map(|row| row.as_slice().try_into().ok()).collect::<Option<Vec<_>>>();
        let Some(pairs) = pairs.filter(|pairs| !pairs.is_empty()) else {
            section.fault("attitudes_deg", format!("give {right}"));
            return None;
        };
        pairs
    } else {
        vec![one]
    };
    for angles in &angles {
        section.refuse("", limits.angles(*angles));
    }
    Some((1..).zip(angles).map(|(number, angles)| position_at(number, "", angles, mounting)).collect())
}
