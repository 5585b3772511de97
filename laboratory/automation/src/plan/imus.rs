//! The IMUs of a plan: `imus`, several on one turntable in one chamber.

use super::files::taken_name;
use super::model::{Plan, RampPlan, VerificationPlan};
use isotherm_campaign::{Campaign, Member, Position, members, nearest_rotation};
use isotherm_shared::document::Section;
use nalgebra::{Matrix3, Vector3};
use std::path::{Path, PathBuf};

/// An IMU of `imus`.
pub(super) struct PlannedImu {
    pub member: Member,
    /// The file that its table is installed as.
    install: Option<PathBuf>,
}

/// Reads `imus`; `None` if one of them is wrong. `refuse_install` gives the fault of a file to install.
pub(super) fn imus(
    root: &Section<'_, '_>,
    folder: &Path,
    refuse_install: impl Fn(&Path) -> Option<String>,
) -> Option<Vec<PlannedImu>> {
    root.ignore("install");
    if root.has("install") {
        root.fault("install", "there is imus too, where each IMU has its own install; give it there");
    }
    let sections = root.list("imus");
    let members = members(root, &sections);
    let mut installs: Vec<Option<PathBuf>> = Vec::new();
    for section in sections {
        let install = section.optional_string("install").map(|path| folder.join(path));
        let fault = install.as_deref().and_then(|path| match installs.iter().flatten().any(|other| other == path) {
            true => Some("is the install of another IMU too; give each its own file".to_owned()),
            false => refuse_install(path),
        });
        section.refuse("install", fault);
        section.refuse("id", section.optional_string("id").and_then(taken_name));
        installs.push(install);
        section.finish();
    }
    Some(members?.into_iter().zip(installs).map(|(member, install)| PlannedImu { member, install }).collect())
}

/// The lines of the campaign file that name the IMUs.
pub(super) fn imus_toml(imus: &[PlannedImu]) -> String {
    let items: String = imus.iter().map(|imu| format!("    {},\n", imu.member.to_toml())).collect();
    format!("imus = [\n{items}]\n")
}

/// The plan of a batch: `plan` with the axes of an IMU without mounting, and in it the plan of each IMU with its own.
pub(super) fn batch(plan: Plan, imus: Vec<PlannedImu>, campaigns: Vec<Campaign>) -> Plan {
    let of_imu = |(PlannedImu { member, install }, campaign): (PlannedImu, Campaign)| {
        let rotation = nearest_rotation(&member.mounting).unwrap_or_else(Matrix3::identity);
        let mounted = |position: &Position| {
            // Adding 0 turns -0 into 0.
            let force = (rotation * Vector3::from(position.specific_force)).map(|force| force + 0.0).into();
            Position { specific_force: force, ..position.clone() }
        };
        let all = |positions: &[Position]| positions.iter().map(mounted).collect();
        let ramp = |ramp: &RampPlan| RampPlan { attitude: mounted(&ramp.attitude), ..ramp.clone() };
        let verify = plan.verify.as_ref();
        Plan {
            imu: member.imu.clone(),
            positions: all(&plan.positions),
            ramps: plan.ramps.iter().map(ramp).collect(),
            verify: verify.map(|verify| VerificationPlan { attitudes: all(&verify.attitudes), ..verify.clone() }),
            install,
            campaign,
            member: Some(member),
            ..plan.clone()
        }
    };
    let batch = imus.into_iter().zip(campaigns).map(of_imu).collect();
    Plan { batch, ..plan }
}

impl Plan {
    /// The plan of each IMU, with its own axes: only this plan, or those of the batch.
    #[must_use]
    pub fn each(&self) -> &[Self] {
        if self.batch.is_empty() { std::slice::from_ref(self) } else { &self.batch }
    }

    /// Whether the plan has `imus`, be it one or several.
    #[must_use]
    pub const fn is_batch(&self) -> bool {
        !self.batch.is_empty()
    }

    /// The names of the IMUs, as messages show them.
    #[must_use]
    pub fn names(&self) -> String {
        self.each().iter().map(|plan| plan.imu.as_str()).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests;
