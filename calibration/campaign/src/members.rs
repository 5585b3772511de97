//! The IMUs of a batch: `imus` in a campaign file, or in a plan. They are on one turntable, in one chamber, at the same
//! time.

use crate::model::Campaign;
use crate::mount::{mounting, nearest_rotation};
use crate::position::Position;
use crate::ramp::Ramp;
use crate::samples::IMU;
use crate::turn::Turn;
use isotherm_shared::document::Section;
use isotherm_shared::names::ImuId;
use nalgebra::{Matrix3, Vector3};

/// Most IMUs of a batch.
pub const MOST_IMUS: usize = 100;

/// One IMU of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Its name.
    pub imu: ImuId,
    /// Serial number, free text.
    pub serial: Option<String>,
    /// The rotation from the batch's axes to its own: the specific force along its A1, A2, A3 is this times the one
    /// that the batch's file has. As stated, so to a few digits.
    pub mounting: Matrix3<f64>,
}

impl Member {
    /// The item of `imus` in a campaign file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let serial = self.serial.as_deref().map_or_else(String::new, |serial| format!(", serial = {}", quoted(serial)));
        // Adding 0 turns -0 into 0.
        let row = |i: usize| {
            let [x, y, z] = [0, 1, 2].map(|j| self.mounting[(i, j)] + 0.0);
            format!("[{x}, {y}, {z}]")
        };
        let rows = [0, 1, 2].map(row).join(", ");
        format!("{{ id = {}{serial}, mounting = [{rows}] }}", quoted(self.imu.as_str()))
    }
}

/// Reads the IMUs of `imus`, whose items are `sections`; `None` if one of them is wrong. The caller may ask for more
/// keys of the sections, and finishes them.
#[must_use]
pub fn members(root: &Section<'_, '_>, sections: &[Section<'_, '_>]) -> Option<Vec<Member>> {
    const IMUS: &str = "give one { id = \"imu-a\" } for each IMU, with serial and mounting if it has them";
    for key in ["imu", "serial"].into_iter().filter(|key| root.has(key)) {
        root.ignore(key);
        root.fault(key, "there is imus too, where each IMU has its own id and serial; give either");
    }
    let fault = match sections.len() {
        0 => Some(format!("names no IMU; {IMUS}")),
        1..=MOST_IMUS => None,
        many => Some(format!("names {many} IMUs, give at most {MOST_IMUS}")),
    };
    if fault.is_some() {
        root.refuse("imus", fault);
        return None;
    }
    let mut members: Vec<Member> = Vec::new();
    let mut complete = true;
    for section in sections {
        match member(section) {
            Some(member) if members.iter().any(|other| other.imu == member.imu) => {
                section.fault("id", format!("{} is there twice; each IMU is in a batch once", member.imu));
                complete = false;
            }
            Some(member) => members.push(member),
            None => complete = false,
        }
    }
    complete.then_some(members)
}

fn member(section: &Section<'_, '_>) -> Option<Member> {
    let imu = section.imu_id("id");
    let serial = section.optional_string("serial").map(str::to_owned);
    let mounting = mounting(section);
    Some(Member { imu: imu?, serial, mounting: mounting? })
}

/// The campaign of only `imu`, or the only one.
///
/// # Errors
/// If there is no such IMU, or if there are several and none is chosen.
pub fn select_imu(campaigns: Vec<Campaign>, imu: Option<&str>) -> Result<Campaign, String> {
    let names: Vec<_> = campaigns.iter().map(|campaign| campaign.imu.to_string()).collect();
    let names = names.join(", ");
    let several = campaigns.len() > 1;
    let mut chosen = campaigns.into_iter().filter(|campaign| imu.is_none_or(|imu| campaign.imu.as_str() == imu));
    match (chosen.next(), imu) {
        (Some(_), None) if several => Err(format!("it has several IMUs; choose one of {names}")),
        (Some(campaign), _) => Ok(campaign),
        (None, imu) => Err(format!("there is no {}; it has {names}", imu.unwrap_or_default())),
    }
}

/// Reports the files of a batch whose names do not hold [`IMU`].
pub(crate) fn check_files(root: &Section<'_, '_>, campaign: &Campaign) {
    let ramps = campaign.ramps.iter().map(|ramp| ("ramp", &ramp.samples));
    let files = campaign.samples.iter().map(|file| ("samples", file)).chain(ramps);
    for (key, file) in files.chain(campaign.curves.iter().map(|file| ("curves", file))) {
        if !file.contains(IMU) {
            let message =
                format!("{file:?} is one file; each IMU of a batch has its own, so give a name with {IMU} in it");
            root.fault(key, message);
        }
    }
}

/// Reports mountings where no directions are known.
pub(crate) fn check_mountings(root: &Section<'_, '_>, campaign: &Campaign, members: &[Member]) {
    let turned = members.iter().find(|member| campaign.is_tumble && member.mounting != Matrix3::identity());
    let message = |member: &Member| {
        format!("the mounting of {} has no effect: without a turntable no direction is known; leave it out", member.imu)
    };
    root.refuse("imus", turned.map(message));
}

/// The campaign of one IMU. `batch` is the campaign of an IMU whose axes are those of the batch's file.
pub(crate) fn of_member(batch: &Campaign, member: &Member) -> Campaign {
    let rotation = nearest_rotation(&member.mounting).unwrap_or_else(Matrix3::identity);
    let mounted = |vector: [f64; 3]| (rotation * Vector3::from(vector)).map(|component| component + 0.0).into();
    let position =
        |position: &Position| Position { specific_force: mounted(position.specific_force), ..position.clone() };
    let named = |file: &String| file.replace(IMU, member.imu.as_str());
    Campaign {
        imu: member.imu.clone(),
        serial: member.serial.clone(),
        samples: batch.samples.iter().map(named).collect(),
        positions: batch.positions.iter().map(position).collect(),
        mount: batch.mount.map(|mount| rotation * mount),
        turns: batch
            .turns
            .iter()
            .map(|turn| Turn { start: position(&turn.start), axis: mounted(turn.axis), ..turn.clone() })
            .collect(),
        ramps: batch
            .ramps
            .iter()
            .map(|ramp| Ramp { samples: named(&ramp.samples), specific_force: ramp.specific_force.map(mounted) })
            .collect(),
        curves: batch.curves.as_ref().map(named),
        ..batch.clone()
    }
}
