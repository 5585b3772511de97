//! Reads the text of a campaign file.

use crate::direction::{DIRECTION, direction};
use crate::geometry::specific_force;
use crate::gravity::{GravitySource, Place, gravity_fault};
use crate::members::{check_files, check_mountings, members, of_member};
use crate::model::Campaign;
use crate::mount::{contradiction, mount};
use crate::position::{Position, angles};
use crate::ramp::ramps;
use crate::samples::{SampleLayout, samples};
use crate::turn::{Turn, turns};
use isotherm_shared::document::{Document, Faults, Section};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{GRAVITY_ONLY, GRAVITY_RANGE, OutOfRange};
use nalgebra::{Matrix3, Vector3};

impl Campaign {
    /// Reads the text of a campaign file of one IMU.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_campaign::Campaign;
    ///
    /// let text = r#"
    ///     format = 1
    ///     imu = "imu-a"
    ///     samples = "samples.csv"
    ///     gravity_reference = 9.80665   # m/s2
    ///     gravity_local = 98.1          # m/s2
    ///     temperature_unit = "V"
    ///     [[position]]
    ///     number = 1
    ///     specific_force = [0, 0, 1]
    /// "#;
    /// let faults = Campaign::from_toml(text).err().ok_or("the local gravity is ten times too large")?;
    /// assert_eq!((faults.0.len(), faults.0[0].line), (1, 6));
    /// assert!(Campaign::from_toml(&text.replace("98.1", "9.8012")).is_ok());
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All faults of the text, with line and key; also if it has several IMUs.
    pub fn from_toml(text: &str) -> Result<Self, Faults> {
        parse(text, |root| {
            let several = root.has("imus") && root.list("imus").len() > 1;
            root.fault_if(several, "imus", "are several, and one is wanted here; leave the others out");
            campaigns(root)?.pop()
        })
    }

    /// Reads the text of a campaign file: one campaign for each IMU of `imus`, in that order, or the one of `imu`. In a
    /// file with `imus`, directions are those along the axes of an IMU without `mounting`; here they are along each
    /// IMU's own axes.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_campaign::Campaign;
    ///
    /// let one = include_str!("../../../examples/campaign/campaign.toml");
    /// // A second IMU, which is turned by 90 degrees about A3.
    /// let imus = r#"imus = [{ id = "imu-a" }, { id = "imu-b", mounting = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] }]"#;
    /// let two = one.replace("imu = \"imu-paper\"", imus).replace("samples.csv", "{imu}.csv");
    /// let [a, b] = Campaign::batch_from_toml(&two)?.try_into().map_err(|_| "two IMUs")?;
    /// assert_eq!((b.imu.as_str(), b.samples), ("imu-b", vec!["imu-b.csv".to_owned()]));
    /// assert_eq!(a.positions[4].specific_force[0], -b.positions[4].specific_force[1]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All faults of the text, with line and key.
    pub fn batch_from_toml(text: &str) -> Result<Vec<Self>, Faults> {
        parse(text, campaigns)
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
    root.fault_if(format.is_some_and(|format| format != 1.0), "format", "unknown; this version reads format = 1");
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
    check_files(root, &batch);
    check_mountings(root, &batch, members.as_deref().unwrap_or_default());
    Some(members?.iter().map(|member| of_member(&batch, member)).collect())
}

/// The campaign of one IMU, whose axes are those that the file's directions refer to. All keys are asked for before the
/// first one that is missing ends this function.
fn campaign(root: &Section<'_, '_>, imu: Option<ImuId>, serial: Option<String>) -> Option<Campaign> {
    let gravity_only = gravity_only(root);
    let temperature_range = temperature_range(root, gravity_only);
    let ramps_alone = root.has("ramp") && !root.has("position") && !gravity_only;
    let samples = samples_of(root, ramps_alone, gravity_only);
    let nominal_scale_factor = positive(root, "nominal_scale_factor");
    let gravity_reference = gravity(root, "gravity_reference", "the value of 1 g0 in m/s2, for example 9.8015");
    let [latitude_deg, height_m] = place(root);
    let place = latitude_deg.zip(height_m).and_then(|(latitude, height)| Place::new(latitude, height).ok());
    let (gravity_local, gravity_source) = gravity_local(root, place.filter(|_| gravity_only), place);
    let unit = root.string("temperature_unit", "the unit of the temperature, for example \"V\"").map(str::to_owned);
    let is_open = root.is_open("temperature_unit");
    root.fault_if(is_open, "temperature_unit", "is \"?\", which is to be filled in; give the unit");
    let out_of_range = root.optional_choice("out_of_range", &OutOfRange::NAMES);
    let [max_age_s, max_rate, soak_s] = ["max_age_s", "max_rate", "soak_s"].map(|key| positive(root, key));
    let sections = root.list("position");
    if sections.is_empty() && !ramps_alone && !gravity_only {
        root.fault("position", "none; give one [[position]] each, with number and specific_force");
    }
    let curves = curves(root, ramps_alone);
    let ramps = ramps(root);
    let (mut positions, complete) = positions(root, sections);
    let mount = mount(&positions);
    take_exact_directions(&mut positions, mount);
    let turns = turns_of(root, complete.then_some(&positions), ramps_alone, mount, latitude_deg);
    let (samples, layout) = samples?;
    if layout == SampleLayout::Means && root.has("turn") {
        root.fault(
            "turn",
            "a mean shows no turn: turns need rows; give files in place of means, or leave the turns out",
        );
    }
    Some(Campaign {
        imu: imu?,
        serial,
        samples,
        layout,
        nominal_scale_factor,
        gravity_reference: gravity_reference?,
        gravity_local: gravity_local?,
        gravity_source,
        temperature_unit: unit?,
        out_of_range,
        max_age_s,
        max_rate,
        soak_s,
        turns: turns?,
        positions: complete.then_some(positions)?,
        mount,
        latitude_deg,
        height_m,
        ramps: ramps?,
        curves: curves?.map(str::to_owned),
        is_tumble: gravity_only,
        temperature_range: temperature_range?,
    })
}

/// Whether the method needs no turntable. It refuses the keys of one.
fn gravity_only(root: &Section<'_, '_>) -> bool {
    let gravity_only = root.optional_choice("method", &[((), GRAVITY_ONLY)]).is_some();
    let others =
        ["position", "turn", "ramp", "curves", "soak_s"].into_iter().filter(|key| gravity_only && root.has(key));
    for key in others {
        root.ignore(key);
        root.fault(key, format!("is not for method = \"{GRAVITY_ONLY}\", which knows no directions; leave it out"));
    }
    gravity_only
}

/// The files of the samples, and how they are laid out. Ramps have their own.
fn samples_of(root: &Section<'_, '_>, ramps_alone: bool, gravity_only: bool) -> Option<(Vec<String>, SampleLayout)> {
    if ramps_alone && !root.has("samples") {
        return Some((Vec::new(), SampleLayout::Rows));
    }
    samples(root, gravity_only)
}

fn gravity(root: &Section<'_, '_>, key: &'static str, right: &'static str) -> Option<f64> {
    let value = root.number(key, right);
    let [low, high] = GRAVITY_RANGE;
    let wrong = value.filter(|value| !(low..=high).contains(value));
    root.refuse(key, wrong.map(|value| format!("is {value:?}, give {low} to {high} m/s2")));
    value
}

fn positive(root: &Section<'_, '_>, key: &'static str) -> Option<f64> {
    let value = root.optional_number(key);
    let wrong = value.filter(|value| *value <= 0.0);
    root.refuse(key, wrong.map(|value| format!("is {value:?}, give a number over 0")));
    value
}

/// The positions that are right, and whether all are.
fn positions(root: &Section<'_, '_>, sections: Vec<Section<'_, '_>>) -> (Vec<Position>, bool) {
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
    (positions, complete)
}

/// Where the mounting only exchanges axes, the directions are those of the angles to the last digit.
fn take_exact_directions(positions: &mut [Position], mount: Option<Matrix3<f64>>) {
    let Some(rotation) = mount.filter(|rotation| *rotation == rotation.map(f64::round)) else { return };
    for position in positions {
        let [outer, inner] = position.angles.unwrap_or_default();
        position.specific_force = (rotation * Vector3::from(specific_force(outer, inner))).map(|f| f + 0.0).into();
    }
}

fn turns_of(
    root: &Section<'_, '_>,
    positions: Option<&Vec<Position>>,
    ramps_alone: bool,
    mount: Option<Matrix3<f64>>,
    latitude_deg: Option<f64>,
) -> Option<Vec<Turn>> {
    if ramps_alone && root.has("turn") {
        root.fault(
            "turn",
            "turns need positions, and there are none; give [[position]] and samples, or leave them out",
        );
    }
    turns(root, positions, mount, latitude_deg)
}

/// Where a table without a turntable is valid; the outer `None` if the key is wrong.
fn temperature_range(root: &Section<'_, '_>, gravity_only: bool) -> Option<Option<[f64; 2]>> {
    const KEY: &str = "temperature_range";
    if !root.has(KEY) {
        return Some(None);
    }
    let range = root.numbers(KEY, "the lowest and the highest temperature, for example [15, 35]")?;
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

/// The table that gives what ramps do not show; the outer `None` if the key is wrong, or missing.
fn curves<'d>(root: &Section<'d, '_>, ramps_alone: bool) -> Option<Option<&'d str>> {
    const TABLE: &str = "name the table that has them, for example curves = \"imu.toml\"";
    let curves = root.optional_string("curves");
    let fault = match curves {
        None if ramps_alone && !root.has("curves") => Some(format!(
            "missing; ramps show neither scale factors nor misalignments nor the constant of a bias: {TABLE}, or give [[position]] and samples"
        )),
        Some("") => Some(format!("is empty; {TABLE}")),
        Some(_) if !ramps_alone && root.has("position") => {
            Some("is for campaigns with only ramps: here the positions give the curves; leave it out".to_owned())
        }
        Some(_) if !ramps_alone => {
            Some("is for campaigns with only ramps, and there is no [[ramp]]; give one, or leave it out".to_owned())
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

/// Local gravity \[m/s2\] and its source: as stated, and checked by the place of the station; normal gravity at
/// `unstated` if it is not stated.
fn gravity_local(
    root: &Section<'_, '_>,
    unstated: Option<Place>,
    place: Option<Place>,
) -> (Option<f64>, GravitySource) {
    const KEY: &str = "gravity_local";
    if let Some(place) = unstated.filter(|_| !root.has(KEY)) {
        return (Some(place.normal_gravity()), GravitySource::Normal(place));
    }
    let stated = gravity(root, KEY, "gravity at the station in m/s2");
    root.refuse(KEY, stated.zip(place).and_then(|(gravity, place)| gravity_fault(gravity, place)));
    (stated, GravitySource::Stated)
}

/// Latitude \[deg\] and height \[m\] of the station, if they are stated.
fn place(root: &Section<'_, '_>) -> [Option<f64>; 2] {
    let ranges = [("latitude_deg", Place::LATITUDES), ("height_m", Place::HEIGHTS)];
    let [latitude, height] = ranges.map(|(key, range)| {
        let value = root.optional_number(key);
        let wrong = value.filter(|value| !range.contains(value));
        root.refuse(key, wrong.map(|value| format!("is {value:?}, give {} to {}", range.start(), range.end())));
        value.filter(|value| range.contains(value))
    });
    match (latitude, height) {
        (Some(_), Some(_)) | (None, None) => {}
        _ if root.has("latitude_deg") && root.has("height_m") => {}
        // The turns of gyroscopes need only the latitude.
        (Some(_), None) if root.has("turn") => {}
        _ => root.fault("", "give both latitude_deg and height_m, or neither; a latitude without height is for turns: [[turn]], in a plan [turns]"),
    }
    [latitude, height]
}

fn position(section: &Section<'_, '_>) -> Option<Position> {
    let number = section.integer("number", 0..=i64::from(u32::MAX), "the number that the samples carry");
    let label = section.optional_string("up").unwrap_or_default().to_owned();
    let (angles, _) = angles(section);
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
