//! `calibrate --one-attitude` of a log with several IMUs: a table for each, and one report and one file of parameters
//! for the vehicle.

use super::arguments::Calibrate;
use super::one_attitude::WarmUp;
use crate::commands::export::{tell_exported, tell_left_out, tell_notes};
use isotherm_autopilot::{Autopilot, Exported, vehicle};
use isotherm_campaign::Campaign;
use isotherm_client::ImuId;
use isotherm_files::StagedText;
use isotherm_fit::tool;
use isotherm_pipeline::{INSTANCE, Made, Refused, Vehicle, VehicleImu, now};
use isotherm_report::vehicle::{Outcome, html};
use isotherm_support::failure::{Exit, Failure, shown, tell};
use serde_json::{Value, json};
use std::io::{self, Write as _};
use std::path::PathBuf;

/// A table that is made, with the parameters of each `--export`.
struct MadeOne {
    campaign: Campaign,
    made: Made,
    exported: Vec<Exported>,
}

/// What became of an IMU.
struct Member<'a> {
    of: &'a VehicleImu,
    table: PathBuf,
    made: Result<MadeOne, Refused>,
}

impl Calibrate {
    /// Makes a table of each IMU. An IMU whose rows give no table is dropped with its reason, and the others go on, as
    /// in a batch. The inner result tells which ones were dropped.
    ///
    /// What is wrong for all of them, as the command line or a folder of the outputs, ends the command.
    pub(super) fn make_vehicle(
        &self,
        imu: &ImuId,
        vehicle: &Vehicle,
        warm_up: &WarmUp,
    ) -> Result<Result<(), Failure>, Refused> {
        self.check_vehicle(vehicle)?;
        let tables: Vec<_> = vehicle.imus.iter().map(|member| self.table_of(member)).collect();
        let [_, report] = self.outputs(imu);
        let outputs: Vec<_> = tables.iter().map(|path| Some(path.as_path())).chain([report.as_deref()]).collect();
        self.refuse_overlaps_at_one_attitude(&warm_up.files, &outputs)?;
        // All files are created before the fits.
        let staged = tables.iter().map(|path| StagedText::create(Some(path))).collect::<Result<Vec<_>, _>>()?;
        let page = report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let exports = self.staged_exports()?;
        let mut members = Vec::new();
        for (of, table) in vehicle.imus.iter().zip(tables) {
            let made = self.make_one(of, warm_up);
            match made {
                Err(refused) if refused.failure.exit == Exit::Usage => return Err(refused),
                made => members.push(Member { of, table, made }),
            }
        }
        members.iter().for_each(|member| self.tell_member(member));
        let mut texts = Vec::new();
        for (member, staged) in members.iter().zip(staged) {
            if let Ok(one) = &member.made {
                texts.push(staged.write(&one.made.table)?);
            }
        }
        texts.extend(page.map(|page| page.write(&self.page(&members))).transpose()?);
        let mut written = Vec::new();
        for (index, (to, path, staged)) in exports.into_iter().enumerate() {
            let joint = joint(to, &members, index);
            if members.iter().any(|member| member.made.is_ok()) {
                texts.push(staged.write(&joint.text)?);
                written.push((joint, to, path));
            }
        }
        StagedText::finish_together(texts)?;
        for (joint, to, path) in &written {
            tell_notes(&joint.notes);
            tell_exported(joint, *to, path);
        }
        self.print_json(&json!({ "imus": members.iter().map(Member::json).collect::<Vec<_>>() }))?;
        Ok(self.dropped(&members))
    }

    /// Refuses what several IMUs would share.
    fn check_vehicle(&self, vehicle: &Vehicle) -> Result<(), Failure> {
        let Vehicle { imus, listed } = vehicle;
        let log = shown(self.campaign());
        let usage = |message: String| Err(Failure::new(Exit::Usage, message));
        let is_each = VehicleImu::tells_apart;
        if !is_each(self.output()) && !self.output().is_dir() {
            let output = shown(self.output());
            return usage(format!(
                "{log}: {} IMUs, and -o names one file, {output}; for a table of each give a folder that is there, or a \
                 name with {INSTANCE} in it; or choose one with --instance: {listed}",
                imus.len()
            ));
        }
        if let Some(nominal) = self.at_one_attitude.nominal.as_deref().filter(|path| !is_each(path)) {
            let nominal = shown(nominal);
            return usage(format!(
                "{log}: {} IMUs, and --nominal names one table, {nominal}; give a name with {INSTANCE} in it, or choose \
                 an IMU with --instance: {listed}",
                imus.len()
            ));
        }
        if self.at_one_attitude.parameters.device_id.is_some() {
            return usage(format!(
                "{log}: {} IMUs, each with the device numbers of the log; leave --device-id out, or choose an IMU with \
                 --instance: {listed}",
                imus.len()
            ));
        }
        Ok(())
    }

    fn make_one(&self, of: &VehicleImu, warm_up: &WarmUp) -> Result<MadeOne, Refused> {
        let (campaign, made) = self.fit_at_one_attitude(of, warm_up)?;
        let exported = self.exported(&made)?;
        Ok(MadeOne { campaign, made, exported })
    }

    /// Prints what was found.
    fn tell_member(&self, member: &Member<'_>) {
        let imu = &member.of.imu;
        if !self.json {
            let _ = io::stderr().write_all(format!("{imu}:\n").as_bytes());
        }
        match &member.made {
            Ok(one) => {
                self.tell_made(&one.made);
                one.exported.iter().for_each(tell_left_out);
            }
            Err(refused) => tell("isotherm", format_args!("{imu} is dropped: {}", refused.failure.message)),
        }
    }

    fn page(&self, members: &[Member<'_>]) -> String {
        let imus: Vec<_> = members.iter().map(|member| (member.of.imu.as_str(), member.outcome())).collect();
        let log = self.campaign().file_name().unwrap_or_default().to_string_lossy();
        html(&format!("{log} · {} · {}", now(), tool()), &imus)
    }

    /// Which IMUs were dropped.
    fn dropped(&self, members: &[Member<'_>]) -> Result<(), Failure> {
        let names: Vec<_> =
            members.iter().filter(|member| member.made.is_err()).map(|member| member.of.imu.as_str()).collect();
        if names.is_empty() {
            return Ok(());
        }
        let (log, count, names) = (shown(self.campaign()), members.len(), (names.len(), names.join(", ")));
        let message = format!("{log}: {} of {count} IMUs dropped, the reasons are above: {}", names.0, names.1);
        Err(Failure::new(Exit::Failed, message))
    }
}

impl Member<'_> {
    fn outcome(&self) -> Outcome<'_> {
        match &self.made {
            Ok(one) => Ok((&one.campaign, &one.made.fitted, &one.made.source)),
            Err(refused) => Err(&refused.failure.message),
        }
    }

    fn json(&self) -> Value {
        let (imu, instance) = (self.of.imu.as_str(), self.of.instance);
        match &self.made {
            Ok(one) => {
                let table = self.table.display().to_string();
                json!({ "imu": imu, "instance": instance, "table": table, "calibration": one.made.json() })
            }
            Err(refused) => json!({ "imu": imu, "instance": instance, "dropped": refused.document }),
        }
    }
}

/// The parameters of the vehicle: those of the `--export` with this index.
fn joint(to: Autopilot, members: &[Member<'_>], index: usize) -> Exported {
    let exported = |member: &Member<'_>| member.made.as_ref().ok().and_then(|one| one.exported.get(index).cloned());
    let all: Vec<_> = members.iter().map(|member| (member.of.imu.as_str(), exported(member))).collect();
    let all: Vec<_> = all.iter().map(|(name, exported)| (*name, exported.as_ref())).collect();
    vehicle(to, &all)
}
