//! `calibrate warm-up` of a log with several IMUs: a table for each, and one report and one file of parameters for the
//! vehicle.

use super::WarmUp;
use super::export::{exported, named, staged_exports};
use crate::commands::calibrate::several::{TableMember, check_dropped};
use crate::commands::export::{tell_left_out, tell_notes};
use isotherm_autopilot::{ExportedParameters, vehicle};
use isotherm_files::StagedText;
use isotherm_fit::tool;
use isotherm_pipeline::{INSTANCE, InputOptions, JobFailure, Vehicle, VehicleImu, now};
use isotherm_report::vehicle::{Outcome, html};
use isotherm_report::with_files;
use isotherm_support::failure::{Exit, Failure, shown};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

impl WarmUp {
    /// Makes a table of each IMU. An IMU whose rows give no table is dropped with its reason, and the others go on, as
    /// in a batch.
    ///
    /// What is wrong for all of them, as the command line or a folder of the outputs, ends the command.
    pub(super) fn make_vehicle(&self, vehicle: &Vehicle, input: &InputOptions) -> Result<(), JobFailure> {
        self.check_vehicle(vehicle)?;
        let tables: Vec<_> = vehicle.imus.iter().map(|member| self.table_of(member)).collect();
        let report = self.report(&self.imu);
        let outputs: Vec<_> = tables.iter().map(|path| Some(path.as_path())).chain([report.as_deref()]).collect();
        self.refuse_overlaps(&outputs)?;
        // All files are created before the fits.
        let staged = tables.iter().map(|path| StagedText::create(Some(path))).collect::<Result<Vec<_>, _>>()?;
        let page = report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let exports = staged_exports(&self.export)?;
        let (mut members, mut exported) = (Vec::new(), Vec::new());
        for (of, table) in vehicle.imus.iter().zip(tables) {
            let (member, parameters) = self.make_member(of, table, input)?;
            members.push(member);
            exported.push(parameters);
        }
        for (member, exported) in members.iter().zip(&exported) {
            member.tell(self.table.json);
            exported.iter().for_each(tell_left_out);
        }
        let mut texts = Vec::new();
        for (member, staged) in members.iter().zip(staged) {
            if let Ok((_, outcome)) = &member.result {
                texts.push(staged.write(&outcome.table)?);
            }
        }
        let has_table = members.iter().any(|member| member.result.is_ok());
        let joint = if has_table { self.joint(&members, &exported) } else { Vec::new() };
        let html = with_files(&self.page(&members), &named(&self.export, &joint));
        texts.extend(page.map(|page| page.write(&html)).transpose()?);
        for (staged, joint) in exports.into_iter().zip(&joint) {
            texts.push(staged.write(&joint.text)?);
        }
        StagedText::finish_all(texts)?;
        for (file, joint) in self.export.iter().zip(&joint) {
            tell_notes(&joint.notes);
            file.tell(joint);
        }
        let documents = members.iter().zip(&vehicle.imus).map(|(member, of)| {
            let mut document = member.json();
            document["instance"] = Value::from(of.instance);
            document
        });
        let document = json!({ "imus": documents.collect::<Vec<_>>() });
        self.table.json.finish(document, check_dropped(self.log(), &members))
    }

    /// Makes the table of one IMU, with the parameters of each `--export`.
    fn make_member(
        &self,
        of: &VehicleImu,
        table: PathBuf,
        input: &InputOptions,
    ) -> Result<(TableMember, Vec<ExportedParameters>), JobFailure> {
        let made = self.calibrate(of, input).and_then(|made| {
            let exported = exported(&self.export, &self.parameters, &made.1)?;
            Ok((made, exported))
        });
        let (result, exported) = match made {
            Ok((made, exported)) => (Ok(made), exported),
            Err(refusal) if refusal.failure.exit == Exit::Usage => return Err(refusal),
            Err(refusal) => (Err(refusal), Vec::new()),
        };
        Ok((TableMember { imu: of.imu.clone(), table, result }, exported))
    }

    /// Refuses what several IMUs would share.
    fn check_vehicle(&self, Vehicle { imus, listed }: &Vehicle) -> Result<(), Failure> {
        let (log, count) = (shown(self.log()), imus.len());
        let is_each = VehicleImu::tells_apart;
        let nominal = self.nominal.as_deref().filter(|path| !is_each(path));
        let message = if !is_each(&self.output) && !self.output.is_dir() {
            let output = shown(&self.output);
            format!(
                "{log}: {count} IMUs, and -o names one file, {output}; for a table of each give a folder that is there, or a \
                 name with {INSTANCE} in it; or choose one with --instance: {listed}"
            )
        } else if let Some(nominal) = nominal {
            let nominal = shown(nominal);
            format!(
                "{log}: {count} IMUs, and --nominal names one table, {nominal}; give a name with {INSTANCE} in it, or choose \
                 an IMU with --instance: {listed}"
            )
        } else if self.parameters.device_id.is_some() {
            format!(
                "{log}: {count} IMUs, each with the device numbers of the log; leave --device-id out, or choose an IMU with \
                 --instance: {listed}"
            )
        } else {
            return Ok(());
        };
        Err(Failure::new(Exit::Usage, message))
    }

    fn log(&self) -> &Path {
        self.logs.first().map_or(Path::new(""), |log| log)
    }

    fn page(&self, members: &[TableMember]) -> String {
        let imus: Vec<_> = members.iter().map(|member| (member.imu.as_str(), page_outcome(member))).collect();
        let log = self.log().file_name().unwrap_or_default().to_string_lossy();
        html(&format!("{log} · {} · {}", now(), tool()), &imus)
    }

    /// The parameters of the vehicle, for each `--export`.
    fn joint(&self, members: &[TableMember], exported: &[Vec<ExportedParameters>]) -> Vec<ExportedParameters> {
        let of_file = |(index, autopilot)| {
            let imus = members.iter().zip(exported);
            let imus: Vec<_> = imus.map(|(member, exported)| (member.imu.as_str(), exported.get(index))).collect();
            vehicle(autopilot, &imus)
        };
        self.export.iter().map(|file| file.autopilot).enumerate().map(of_file).collect()
    }
}

/// What became of an IMU, for the report.
fn page_outcome(member: &TableMember) -> Outcome<'_> {
    match &member.result {
        Ok((campaign, outcome)) => Ok((campaign, &outcome.fitted, &outcome.source)),
        Err(refusal) => Err(&refusal.failure.message),
    }
}
