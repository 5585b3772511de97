//! `calibrate` of a batch: a table for each IMU, and the statistics of all.

use super::Staged;
use super::arguments::Calibrate;
use crate::commands::common::inputs;
use isotherm_analysis::{batch, same_rows};
use isotherm_campaign::{Campaign, IMU, select_imu};
use isotherm_files::{StagedText, refuse_overlap};
use isotherm_fit::{TableFile, tool};
use isotherm_pipeline::Refused;
use isotherm_pipeline::{CampaignFile, now};
use isotherm_report::batch::{BatchSource, document, html, text};
use isotherm_report::json::findings;
use isotherm_support::failure::{Exit, Failure, printable, shown, tell};
use isotherm_support::finding::Finding;
use serde_json::{Value, json};
use std::io::{self, Write as _};
use std::path::PathBuf;

/// # Errors
/// With all faults, if there are any.
fn refuse_same(faults: &[Finding]) -> Result<(), Refused> {
    if faults.is_empty() {
        return Ok(());
    }
    let lines: Vec<_> = faults.iter().map(|finding| finding.tagged(|line| line.to_string())).collect();
    let mut refused = Refused::from(Failure::new(Exit::Data, lines.join("\n")));
    refused.document["findings"] = findings(faults, |line| line.to_string());
    Err(refused)
}

impl Calibrate {
    /// The campaigns that tables are made of: all, or that of `--imu`.
    pub(super) fn chosen(&self, campaigns: Vec<Campaign>) -> Result<Vec<Campaign>, Failure> {
        let Some(imu) = &self.without_turntable.imu else { return Ok(campaigns) };
        let chosen = select_imu(campaigns, Some(imu.as_str()));
        let chosen = chosen.map_err(|message| format!("--imu: {}: {message}", shown(self.campaign())));
        Ok(vec![chosen.map_err(|message| Failure::new(Exit::Usage, message))?])
    }

    /// Makes a table of each campaign, and the statistics of all tables. An IMU whose samples cannot be read or give no
    /// table is dropped with its reason, and the others go on. The inner result tells which ones were dropped.
    ///
    /// What is wrong for all of them, as the command line or a folder of the outputs, ends the command.
    pub(super) fn make_batch(
        &self,
        campaigns: &[Campaign],
        file: &CampaignFile,
    ) -> Result<Result<(), Failure>, Refused> {
        self.check_names(campaigns.len())?;
        let samples = |campaign| Ok((campaign, self.sample_files(campaign, file)?));
        let all = campaigns.iter().map(samples).collect::<Result<Vec<_>, Failure>>()?;
        self.refuse_overlaps(&all, Some(file))?;
        let page = self.batch.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let (mut tables, mut dropped, mut documents): (_, _, Vec<Value>) = (Vec::new(), Vec::new(), Vec::new());
        let (mut staged, mut ended) = (Vec::new(), None);
        for (campaign, samples) in all {
            match self.stage(campaign, &samples, Some(file)) {
                Ok(Ok(made)) => {
                    let [output, _] = self.outputs(&campaign.imu);
                    let name = output.unwrap_or_default().display().to_string();
                    let read = TableFile::from_toml(name.clone(), &made.made.table);
                    tables.push(read.map_err(|faults| Failure::new(Exit::Failed, format!("{name}: {faults}")))?);
                    documents
                        .push(json!({ "imu": campaign.imu.as_str(), "table": name, "calibration": made.made.json() }));
                    staged.push((campaign, Ok(made)));
                }
                Ok(Err(Refused { failure, document, .. })) => {
                    documents.push(json!({ "imu": campaign.imu.as_str(), "dropped": document }));
                    staged.push((campaign, Err(failure.message)));
                }
                Err(refused) => {
                    ended = Some(refused);
                    break;
                }
            }
        }
        // Whose rows they are is not known, so that no table is written.
        refuse_same(&same_rows(&tables))?;
        for (campaign, made) in staged {
            let imu = campaign.imu.as_str();
            if !self.json {
                let _ = io::stderr().write_all(format!("{imu}:\n").as_bytes());
            }
            match made {
                Ok(Staged { made, table, page }) => self.write(campaign, &made, table, page, Vec::new())?,
                Err(message) => {
                    tell("isotherm", format_args!("{imu} is dropped: {message}"));
                    dropped.push((imu.to_owned(), message));
                }
            }
        }
        if let Some(refused) = ended {
            return Err(refused);
        }
        let statistics = batch(&tables);
        let found = statistics.as_ref();
        if let Some(page) = page {
            let source = BatchSource {
                tool: tool(),
                time: now(),
                source: self.campaign().file_name().unwrap_or_default().to_string_lossy().into_owned(),
                dropped: dropped.clone(),
            };
            let reason = found.map_err(ToString::to_string);
            page.write(&html(reason.as_ref().copied().map_err(String::as_str), &source))?.finish()?;
        }
        if !self.json {
            let text = found.map_or_else(|reason| format!("{reason}\n"), text);
            let _ = io::stderr().write_all(printable(&text).as_bytes());
        }
        self.print_json(&json!({ "imus": documents, "batch": found.map_or(Value::Null, document) }))?;
        if dropped.is_empty() {
            return Ok(Ok(()));
        }
        let names: Vec<_> = dropped.iter().map(|(imu, _)| imu.as_str()).collect();
        let message = format!(
            "{}: {} of {} IMUs dropped, the reasons are above: {}",
            shown(self.campaign()),
            dropped.len(),
            campaigns.len(),
            names.join(", ")
        );
        Ok(Err(Failure::new(Exit::Failed, message)))
    }

    /// Refuses outputs that are an input of any IMU, or that are there twice. `text` is that of the campaign file, if
    /// there is one.
    pub(super) fn refuse_overlaps<S: AsRef<[PathBuf]>>(
        &self,
        all: &[(&Campaign, S)],
        file: Option<&CampaignFile>,
    ) -> Result<(), Failure> {
        let named = all.iter().filter_map(|(campaign, _)| Some((file?.ramps(campaign), file?.curves(campaign))));
        let others: Vec<_> = named.collect();
        let mut files: Vec<_> = all.iter().flat_map(|(_, samples)| inputs(samples.as_ref())).collect();
        files.extend(others.iter().flat_map(|(ramps, _)| inputs(ramps)));
        files.extend(others.iter().filter_map(|(_, curves)| Some((curves.as_deref()?, "the table curves"))));
        files.extend(self.foreign.inputs());
        files.extend(file.map(|_| (self.campaign(), "the campaign file")));
        let outputs: Vec<_> =
            all.iter().flat_map(|(campaign, _)| self.outputs(&campaign.imu)).chain([self.batch.clone()]).collect();
        let outputs: Vec<_> = outputs.iter().map(Option::as_deref).collect();
        refuse_overlap(&files, &outputs)
    }

    /// Refuses names and samples that several IMUs would share.
    fn check_names(&self, count: usize) -> Result<(), Failure> {
        if count < 2 {
            return Ok(());
        }
        let wrong = |message: String| Err(Failure::new(Exit::Usage, message));
        for (option, path) in [("-o", Some(self.output())), ("--report", self.report.as_deref())] {
            if let Some(path) = path.filter(|path| !path.to_string_lossy().contains(IMU)) {
                let name = shown(path);
                return wrong(format!(
                    "{option} {name}: there are {count} IMUs; give a name with {IMU} in it, or choose one with --imu"
                ));
            }
        }
        match self.samples.is_empty() {
            true => Ok(()),
            false => wrong(format!(
                "samples: there are {count} IMUs, whose samples the campaign file names; choose one with --imu"
            )),
        }
    }
}
