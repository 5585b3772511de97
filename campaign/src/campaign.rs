//! A campaign: the campaign file (campaign.toml) and the dwells made from the samples.
//!
//! It has positions, ramps beside them, or ramps alone. Ramps alone give bias curves at one attitude; another table gives the rest.
//!
//! Over 400 lines: one file format, and the reader of its samples.

mod batch;
mod direction;
mod dwell;
mod ramp;

pub use batch::{IMU, MOST_IMUS, Member, members, select};
pub use dwell::{Block, Dwell, DwellSums, RowSteps, range};
pub use ramp::Ramp;

use crate::gravity::fault;
use crate::positions::{Position, contradiction, mount, specific_force};
use crate::turn::{Turn, turns};
use direction::{DIRECTION, direction};
use isotherm_recording::{CampaignRow, RecordingError};
use isotherm_shared::document::{Document, Faults, Section};
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::{AXIS_NAMES, GRAVITY_ONLY, GRAVITY_RANGE, OutOfRange};
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample};
use nalgebra::{Matrix3, Matrix3x2, Vector2, Vector3};
use ramp::ramps;

/// The content of a campaign file.
#[derive(Clone, Debug, PartialEq)]
pub struct Campaign {
    /// The IMU that was measured.
    pub imu: ImuId,
    /// Serial number, free text.
    pub serial: Option<String>,
    /// Files of the samples, relative to the campaign file: one file, or the pieces of one recording in any order. Not required with ramps
    /// alone.
    pub samples: Vec<String>,
    /// The value of 1 g0 \[m/s2\]; it is written into the table.
    pub gravity_reference: f64,
    /// Gravity at the station \[m/s2\].
    pub gravity_local: f64,
    /// Unit of the telemetry; only a label.
    pub temperature_unit: String,
    /// The table's policy for telemetry out of range, if stated; else a fitted table clamps, and one of ramps alone keeps the policy of its predecessor `curves`.
    pub out_of_range: Option<OutOfRange>,
    /// Telemetry older than this is flagged \[s\]; it is written into the table.
    pub max_age_s: Option<f64>,
    /// Largest plausible rate of both channels together \[pulse/s\]; a higher rate means saturation. It is written into the
    /// table.
    pub max_rate: Option<f64>,
    /// Least time between two set points \[s\], if stated.
    pub soak_s: Option<f64>,
    /// The positions; none with ramps alone. If `mount` only exchanges axes or their signs, the directions are computed exactly from the angles.
    pub positions: Vec<Position>,
    /// Orientation of the IMU on the turntable, if the angles are stated; see [`mount`].
    pub mount: Option<Matrix3<f64>>,
    /// The turns from rest to rest; none if the gyroscopes are not calibrated.
    pub turns: Vec<Turn>,
    /// Latitude of the station \[deg\], north positive; always there with turns.
    pub latitude_deg: Option<f64>,
    /// The ramps, for the transients; none if they are not estimated.
    pub ramps: Vec<Ramp>,
    /// The table that gives what ramps alone do not show, relative to the campaign file. There with ramps alone, and only with them.
    pub curves: Option<String>,
    /// Whether gravity's length alone is the reference: the samples are recordings of an IMU put down in many attitudes, see
    /// [`gravity_only`](isotherm_calibration::gravity_only). Then there are no positions, turns or ramps.
    pub gravity_only: bool,
    /// Where a table of order 0 is valid, in the telemetry's unit; only with `gravity_only`.
    pub temperature_range: Option<[f64; 2]>,
}

impl Campaign {
    /// Reads the text of a campaign file of one IMU.
    ///
    /// # Errors
    /// All faults of the text, with line and key; also if it has several IMUs.
    pub fn from_toml(text: &str) -> Result<Self, Faults> {
        parse(text, |root| {
            let several = root.has("imus") && root.list("imus").len() > 1;
            root.refuse(
                "imus",
                several.then(|| "are several, and one is wanted here; leave the others out".to_owned()),
            );
            campaigns(root)?.pop()
        })
    }

    /// Reads the text of a campaign file: one campaign for each IMU of `imus`, in that order, or the one of `imu`. In a file with `imus`, directions
    /// are those along the axes of an IMU without `mounting`; here they are along each IMU's own axes.
    ///
    /// # Errors
    /// All faults of the text, with line and key.
    pub fn batch_from_toml(text: &str) -> Result<Vec<Self>, Faults> {
        parse(text, campaigns)
    }

    /// The campaign of an IMU that is put down by hand, with gravity's length as the reference: local gravity and the value of 1 g0 \[m/s2\], and the
    /// telemetry's unit. It has no files.
    #[must_use]
    pub fn gravity_only(imu: ImuId, [gravity_local, gravity_reference]: [f64; 2], temperature_unit: &str) -> Self {
        Self {
            imu,
            serial: None,
            samples: Vec::new(),
            gravity_reference,
            gravity_local,
            temperature_unit: temperature_unit.to_owned(),
            out_of_range: None,
            max_age_s: None,
            max_rate: None,
            soak_s: None,
            positions: Vec::new(),
            mount: None,
            turns: Vec::new(),
            latitude_deg: None,
            ramps: Vec::new(),
            curves: None,
            gravity_only: true,
            temperature_range: None,
        }
    }

    /// Whether there are ramps, and no positions: the samples give bias curves and transients, nothing else.
    #[must_use]
    pub const fn has_ramps_alone(&self) -> bool {
        self.positions.is_empty() && !self.gravity_only
    }

    /// Specific force along A1, A2, A3 in `position` \[g0\], and its derivatives by the base's tilt \[g0/rad\].
    /// Without a tilt, or without angles, the base is level and the derivatives are 0.
    ///
    /// ```text
    /// f = g_local/g0 * mount * R' u,    u = (-ty, tx, 1) / |(-ty, tx, 1)|
    /// ```
    #[must_use]
    pub fn force(&self, position: &Position, tilt: Option<[f64; 2]>) -> ([f64; AXES], [[f64; 2]; AXES]) {
        let gravity = self.gravity_local / self.gravity_reference;
        let level = Vector3::from(position.specific_force) * gravity;
        let (Some([tx, ty]), Some(mount), Some(by_tilt)) = (tilt, self.mount, position.by_tilt()) else {
            return (level.into(), [[0.0; 2]; AXES]);
        };
        let by_tilt = mount * Matrix3x2::from_fn(|i, j| by_tilt[i][j]) * gravity;
        let length = (1.0 + tx * tx + ty * ty).sqrt();
        let force = (level + by_tilt * Vector2::new(tx, ty)) / length;
        let change = by_tilt / length - force * Vector2::new(tx, ty).transpose() / (length * length);
        (force.into(), [0, 1, 2].map(|i| [change[(i, 0)], change[(i, 1)]]))
    }
}

fn parse<T>(text: &str, read: impl FnOnce(&Section<'_, '_>) -> Option<T>) -> Result<T, Faults> {
    let document = Document::parse_as(text, "give the campaign file that names it")?;
    let root = document.root();
    let content = read(&root);
    root.finish();
    document.finish(content)
}

/// The campaign of each IMU.
fn campaigns(root: &Section<'_, '_>) -> Option<Vec<Campaign>> {
    let format = root.number("format", "format = 1, the version of this file format");
    if format.is_some_and(|format| format != 1.0) {
        root.fault("format", "unknown; this version reads format = 1");
    }
    if !root.has("imus") {
        let imu = root.imu_id("imu");
        let serial = root.optional_string("serial").map(str::to_owned);
        return Some(vec![campaign(root, imu, serial)?]);
    }
    let sections = root.list("imus");
    let members = members(root, &sections);
    sections.into_iter().for_each(Section::finish);
    // Without a name, the rest is still checked.
    let first = members.iter().flatten().next().map(|member| member.imu.clone()).or_else(|| ImuId::new("imu"));
    let batch = campaign(root, first, None)?;
    batch::check_files(root, &batch);
    batch::check_mountings(root, &batch, members.as_deref().unwrap_or_default());
    Some(members?.iter().map(|member| batch::of_member(&batch, member)).collect())
}

/// The campaign of one IMU, whose axes are those that the file's directions refer to.
fn campaign(root: &Section<'_, '_>, imu: Option<ImuId>, serial: Option<String>) -> Option<Campaign> {
    let gravity_only = root.optional_choice("method", &[((), GRAVITY_ONLY)]).is_some();
    let others =
        ["position", "turn", "ramp", "curves", "soak_s"].into_iter().filter(|key| gravity_only && root.has(key));
    for key in others {
        root.ignore(key);
        root.fault(key, format!("is not for method = \"{GRAVITY_ONLY}\", which knows no directions; leave it out"));
    }
    let temperature_range = temperature_range(root, gravity_only);
    // Ramps have their own files.
    let ramps_alone = root.has("ramp") && !root.has("position") && !gravity_only;
    let samples = if ramps_alone && !root.has("samples") {
        Some(Vec::new())
    } else {
        root.strings("samples", "the file of the samples, for example \"samples.csv\", or a list of files")
    };
    let gravity = |key, right| {
        let value = root.number(key, right);
        let [low, high] = GRAVITY_RANGE;
        let wrong = value.filter(|value| !(low..=high).contains(value));
        root.refuse(key, wrong.map(|value| format!("is {value:?}, give {low} to {high} m/s2")));
        value
    };
    let gravity_reference = gravity("gravity_reference", "the value of 1 g0 in m/s2, for example 9.8015");
    let gravity_local = gravity("gravity_local", "gravity at the station in m/s2");
    let latitude_deg = place(root, gravity_local);
    let unit = root.string("temperature_unit", "the unit of the telemetry, for example \"V\"").map(str::to_owned);
    let out_of_range = root.optional_choice("out_of_range", &OutOfRange::NAMES);
    let positive = |key| {
        let value = root.optional_number(key);
        let wrong = value.filter(|value| *value <= 0.0);
        root.refuse(key, wrong.map(|value| format!("is {value:?}, give a number over 0")));
        value
    };
    let (max_age_s, max_rate, soak_s) = (positive("max_age_s"), positive("max_rate"), positive("soak_s"));
    let sections = root.list("position");
    if sections.is_empty() && !ramps_alone && !gravity_only {
        root.fault("position", "none; give one [[position]] each, with number and specific_force");
    }
    let curves = curves(root, ramps_alone);
    let ramps = ramps(root);
    let mut positions: Vec<Position> = Vec::new();
    let mut complete = true;
    for section in sections {
        match position(&section) {
            Some(position) if positions.iter().any(|other| other.number == position.number) => {
                section.fault("number", format!("{} is there twice", position.number));
            }
            Some(position) => positions.push(position),
            None => complete = false,
        }
        section.finish();
    }
    if complete {
        root.refuse("position", contradiction(&positions));
    }
    let mount = mount(&positions);
    if let Some(rotation) = mount.filter(|rotation| *rotation == rotation.map(f64::round)) {
        for position in &mut positions {
            let [outer, inner] = position.angles.unwrap_or_default();
            position.specific_force = (rotation * Vector3::from(specific_force(outer, inner))).map(|f| f + 0.0).into();
        }
    }
    // All keys are asked for before the first one that is missing ends this function.
    if ramps_alone && root.has("turn") {
        root.fault(
            "turn",
            "turns need positions, and there are none; give [[position]] and samples, or leave them out",
        );
    }
    let turns = turns(root, complete.then_some(&positions), mount, latitude_deg);
    Some(Campaign {
        imu: imu?,
        serial,
        samples: samples?.into_iter().map(str::to_owned).collect(),
        gravity_reference: gravity_reference?,
        gravity_local: gravity_local?,
        temperature_unit: unit?,
        out_of_range,
        max_age_s,
        max_rate,
        soak_s,
        turns: turns?,
        positions: complete.then_some(positions)?,
        mount,
        latitude_deg,
        ramps: ramps?,
        curves: curves?.map(str::to_owned),
        gravity_only,
        temperature_range: temperature_range?,
    })
}

/// Where a table without a turntable is valid; the outer `None` if the key is wrong.
fn temperature_range(root: &Section<'_, '_>, gravity_only: bool) -> Option<Option<[f64; 2]>> {
    const KEY: &str = "temperature_range";
    if !root.has(KEY) {
        return Some(None);
    }
    let range = root.numbers(KEY, "the lowest and the highest telemetry, for example [15, 35]")?;
    match range.as_slice() {
        _ if !gravity_only => {
            root.fault(
                KEY,
                format!("is for method = \"{GRAVITY_ONLY}\"; the set points show their range: leave it out"),
            );
            None
        }
        &[low, high] if low < high => Some(Some([low, high])),
        _ => {
            root.fault(KEY, "give two numbers, the lower one first");
            None
        }
    }
}

/// The table that gives what ramps alone do not show; the outer `None` if the key is wrong, or missing.
fn curves<'d>(root: &Section<'d, '_>, ramps_alone: bool) -> Option<Option<&'d str>> {
    const TABLE: &str = "name the table that has them, for example curves = \"imu.toml\"";
    let curves = root.optional_string("curves");
    let fault = match curves {
        None if ramps_alone && !root.has("curves") => Some(format!(
            "missing; ramps alone show neither scale factors nor misalignments nor the constant of a bias: {TABLE}, or give [[position]] and samples"
        )),
        Some("") => Some(format!("is empty; {TABLE}")),
        Some(_) if !ramps_alone && root.has("position") => {
            Some("is for ramps alone: here the positions give the curves; leave it out".to_owned())
        }
        Some(_) if !ramps_alone => {
            Some("is for ramps alone, and there is no [[ramp]]; give one, or leave it out".to_owned())
        }
        _ => None,
    };
    if root.has("curves") && curves.is_none() {
        return None;
    }
    let right = fault.is_none();
    root.refuse("curves", fault);
    right.then_some(curves)
}

/// Checks local gravity by the place of the station, if it is stated. Returns the latitude \[deg\].
fn place(root: &Section<'_, '_>, gravity_local: Option<f64>) -> Option<f64> {
    let ranges = [("latitude_deg", -90.0..=90.0), ("height_m", -1000.0..=9000.0)];
    let [latitude, height] = ranges.map(|(key, range)| {
        let value = root.optional_number(key);
        let wrong = value.filter(|value| !range.contains(value));
        root.refuse(key, wrong.map(|value| format!("is {value:?}, give {} to {}", range.start(), range.end())));
        value.filter(|value| range.contains(value))
    });
    match (latitude, height) {
        (Some(latitude), Some(height)) => {
            root.refuse("gravity_local", gravity_local.and_then(|gravity| fault(gravity, latitude, height)));
        }
        (None, None) => {}
        _ if root.has("latitude_deg") && root.has("height_m") => {}
        // The turns of gyroscopes need the latitude alone.
        (Some(_), None) if root.has("turn") => {}
        _ => root.fault("", "give both latitude_deg and height_m, or neither; the latitude alone is for turns: [[turn]], in a plan [turns]"),
    }
    latitude
}

fn position(section: &Section<'_, '_>) -> Option<Position> {
    let number = section.optional_integer("number", 0..=i64::from(u32::MAX));
    if number.is_none() && !section.has("number") {
        section.fault("number", "missing; give the number that the samples carry");
    }
    let label = section.optional_string("up").unwrap_or_default().to_owned();
    let (outer, inner) = (section.optional_number("outer_deg"), section.optional_number("inner_deg"));
    if outer.is_some() != inner.is_some() {
        section.fault("", "give both outer_deg and inner_deg, or neither");
    }
    let angles = outer.zip(inner).map(|(outer, inner)| [outer, inner]);
    let force = if section.has("specific_force") {
        direction(section)
    } else if let Some([outer, inner]) = angles {
        Some(specific_force(outer, inner))
    } else {
        section.fault("specific_force", format!("missing; give {DIRECTION}, or both angles"));
        None
    };
    Some(Position { number: u32::try_from(number?).ok()?, label, angles, specific_force: force? })
}

/// Makes dwells of the samples of `campaign`. The rows come from a
/// [`CampaignCsvReader`](isotherm_recording::CampaignCsvReader) or another source.
///
/// # Errors
/// At the first row that cannot be read or used, with its line: an unknown position, a timestamp that does not increase, an
/// interval out of range or longer than the time since the previous row, telemetry that is not finite, a full counter.
pub fn read(
    campaign: &Campaign,
    rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
) -> Result<Vec<Dwell>, RecordingError> {
    let mut dwells: Vec<Dwell> = Vec::new();
    let mut previous: Option<CampaignRow> = None;
    let mut open = false;
    for row in rows {
        let row = row?;
        let fault = |message: String| {
            let place = match row.position {
                Some(number) => format!("set point {} degC, position {number}: ", row.set_point_c),
                None => format!("set point {} degC: ", row.set_point_c),
            };
            Err(RecordingError::Data { line: row.line, message: place + &message })
        };
        let sample = &row.sample;
        if let Some(wrong) = implausible(sample, previous.as_ref().map(|row| row.sample.timestamp_ns)) {
            return fault(wrong);
        }
        let same = |last: &CampaignRow| (last.set_point_c, last.position) == (row.set_point_c, row.position);
        open &= previous.as_ref().is_some_and(same);
        previous = Some(row);
        let Some(number) = row.position else { continue };
        // The rows of a turn are those of the gyroscopes.
        if campaign.turns.iter().any(|turn| turn.start.number == number) {
            continue;
        }
        if !open {
            let Some(position) = campaign.positions.iter().position(|position| position.number == number) else {
                let known: Vec<_> = campaign.positions.iter().map(|position| position.number.to_string()).collect();
                return fault(format!("no such position; the campaign file lists {}", known.join(", ")));
            };
            dwells.push(Dwell::new(&row, position));
            open = true;
        }
        if let Some(dwell) = dwells.last_mut() {
            dwell.add(&row);
        }
    }
    Ok(dwells)
}

/// Factors between units of time that are exchanged by mistake.
pub const UNIT_FACTORS: [f64; 4] = [60.0, 1e3, 1e6, 1e9];
/// A ratio is such a factor if it differs from it by less than this part.
pub const UNIT_TOLERANCE: f64 = 0.01;

/// The reason why a raw sample of a campaign cannot be used; `None` if it can. `previous_ns` is the timestamp of the
/// previous sample. The automatic campaign leaves such samples out, `calibrate` refuses them.
#[must_use]
pub fn implausible(sample: &RawSample, previous_ns: Option<u64>) -> Option<String> {
    let RawSample { timestamp_ns, interval_ns, .. } = *sample;
    if interval_ns == 0 || interval_ns > MAX_INTERVAL_NS {
        return Some(format!("interval_ns is {interval_ns}, give 1 to {MAX_INTERVAL_NS}"));
    }
    if let Some(previous_ns) = previous_ns {
        if timestamp_ns <= previous_ns {
            let cause = if timestamp_ns == previous_ns { "; is the row there twice?" } else { "" };
            return Some(format!(
                "timestamp_ns {timestamp_ns} after {previous_ns}; time must rise from row to row{cause}"
            ));
        }
        // Up to 1.5 times the elapsed time is clock jitter; more is a wrong unit or an overlap.
        if interval_ns / 3 * 2 > timestamp_ns - previous_ns {
            let passed = timestamp_ns - previous_ns;
            let ratio = interval_ns as f64 / passed as f64;
            let unit = UNIT_FACTORS.into_iter().find(|factor| (ratio / factor - 1.0).abs() < UNIT_TOLERANCE);
            let cause = unit.map(|factor| {
                format!(": {factor} times as long, so interval_ns or timestamp_ns is in another unit than nanoseconds")
            });
            return Some(format!(
                "interval_ns is {interval_ns}, but only {passed} ns have passed since the row before; pulses would be counted twice{}",
                cause.unwrap_or_default()
            ));
        }
    }
    for (axis, accelerometer) in AXIS_NAMES.iter().enumerate() {
        for (telemetry, name) in [
            (sample.accelerometers.head_temperature[axis], "head"),
            (sample.accelerometers.board_temperature[axis], "board"),
        ] {
            if !telemetry.is_finite() {
                return Some(format!("a{}_{name} is {telemetry}, which is no temperature", axis + 1));
            }
        }
        if sample.accelerometers.positive_pulses[axis] == u32::MAX
            || sample.accelerometers.negative_pulses[axis] == u32::MAX
        {
            return Some(format!("the counter of {accelerometer} is full: saturated"));
        }
    }
    None
}
