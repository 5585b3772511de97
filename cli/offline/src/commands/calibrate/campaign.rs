//! The tables of a campaign file: one, or one for each IMU and the statistics of all.

use super::outcome::tell_outcome;
use super::several::{TableMember, check_dropped};
use super::table::{TableArgs, TableFiles, path_of};
use crate::commands::common::inputs;
use crate::messages::print_text;
use isotherm_analysis::{batch, same_rows};
use isotherm_campaign::{Campaign, IMU, select_imu};
use isotherm_files::{StagedText, refuse_overlap};
use isotherm_fit::{TableFile, tool};
use isotherm_pipeline::{CampaignFile, JobFailure, JobOutcome, now};
use isotherm_report::batch::{BatchSource, document, html, text};
use isotherm_report::json::findings;
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::Finding;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The tables of one or several campaigns.
pub(super) struct CampaignJob<'a> {
    pub table: &'a TableArgs,
    pub output: &'a Path,
    /// The campaign file; `None` if options describe the only campaign.
    pub file: Option<&'a CampaignFile>,
    /// Samples that replace those of the campaign file.
    pub samples: &'a [PathBuf],
    /// The report of all.
    pub batch: Option<&'a Path>,
    /// Further files that are read.
    pub others: Vec<(&'a Path, &'static str)>,
    pub calibrate: &'a dyn Fn(&Campaign) -> Result<JobOutcome, JobFailure>,
}

/// A campaign, and the files of its samples.
type CampaignSamples<'c> = (&'c Campaign, Vec<PathBuf>);

impl CampaignJob<'_> {
    /// Makes the tables of all campaigns, or of that of `imu`.
    pub(super) fn run(&self, campaigns: Vec<Campaign>, imu: Option<&ImuId>) -> Result<(), JobFailure> {
        let campaigns = self.chosen(campaigns, imu)?;
        match campaigns.as_slice() {
            [campaign] if self.batch.is_none() => self.make_table(campaign),
            campaigns => self.make_batch(campaigns),
        }
    }

    fn make_table(&self, campaign: &Campaign) -> Result<(), JobFailure> {
        self.refuse_overlaps(&[(campaign, self.sample_files(campaign)?)])?;
        let files = self.create_files(campaign)?;
        let outcome = (self.calibrate)(campaign)?;
        tell_outcome(&outcome, self.table.json);
        StagedText::finish_all(files.write(campaign, &outcome, &[])?)?;
        Ok(self.table.json.print(&outcome.json())?)
    }

    /// Makes a table of each campaign, and the statistics of all tables. What is wrong for all of them, as the command
    /// line or a folder of the outputs, ends the command; the tables before it are written.
    fn make_batch(&self, campaigns: &[Campaign]) -> Result<(), JobFailure> {
        self.check_names(campaigns.len())?;
        let samples = |campaign| Ok((campaign, self.sample_files(campaign)?));
        self.refuse_overlaps(&campaigns.iter().map(samples).collect::<Result<Vec<_>, Failure>>()?)?;
        let page = self.batch.map(|path| StagedText::create(Some(path))).transpose()?;
        let (mut members, mut staged, mut ended) = (Vec::new(), Vec::new(), Ok(()));
        for campaign in campaigns {
            match self.make_member(campaign) {
                Ok((member, files)) => {
                    members.push(member);
                    staged.push(files);
                }
                Err(failure) => {
                    ended = Err(failure);
                    break;
                }
            }
        }
        let tables = members.iter().filter_map(table_of).collect::<Result<Vec<_>, _>>()?;
        // Whose rows they are is not known, so that no table is written.
        refuse_same(&same_rows(&tables))?;
        for (member, files) in members.iter().zip(staged) {
            member.tell(self.table.json);
            if let Ok((campaign, outcome)) = &member.result {
                StagedText::finish_all(files.write(campaign, outcome, &[])?)?;
            }
        }
        ended?;
        let statistics = batch(&tables);
        let statistics = statistics.as_ref();
        if let Some(page) = page {
            let reason = statistics.map_err(ToString::to_string);
            let reason = reason.as_ref().copied().map_err(String::as_str);
            page.write(&html(reason, &self.batch_source(&members)))?.finish()?;
        }
        if !self.table.json.is_given() {
            print_text(&statistics.map_or_else(|reason| format!("{reason}\n"), text));
        }
        let documents: Vec<_> = members.iter().map(TableMember::json).collect();
        let document = json!({ "imus": documents, "batch": statistics.map_or(Value::Null, document) });
        self.table.json.finish(document, check_dropped(self.path(), &members))
    }

    /// Makes the table of one of several; its files wait to be written.
    fn make_member(&self, campaign: &Campaign) -> Result<(TableMember, TableFiles), JobFailure> {
        let files = self.create_files(campaign)?;
        let result = match (self.calibrate)(campaign) {
            Err(refusal) if refusal.failure.exit == Exit::Usage => return Err(refusal),
            result => result.map(|outcome| (campaign.clone(), outcome)),
        };
        let [table, _] = self.outputs(campaign);
        Ok((TableMember { imu: campaign.imu.clone(), table: table.unwrap_or_default(), result }, files))
    }

    fn create_files(&self, campaign: &Campaign) -> Result<TableFiles, Failure> {
        let [table, report] = self.outputs(campaign);
        TableFiles::create(&table.unwrap_or_default(), report.as_deref())
    }

    /// Where table and report of an IMU go.
    fn outputs(&self, campaign: &Campaign) -> [Option<PathBuf>; 2] {
        [Some(self.output), self.table.report.as_deref()].map(|path| path.map(|path| path_of(path, &campaign.imu)))
    }

    fn batch_source(&self, members: &[TableMember]) -> BatchSource {
        let dropped = |member: &TableMember| {
            let refusal = member.result.as_ref().err()?;
            Some((member.imu.as_str().to_owned(), refusal.failure.message.clone()))
        };
        let source = self.file.map(CampaignFile::name).unwrap_or_default();
        BatchSource { tool: tool(), time: now(), source, dropped: members.iter().filter_map(dropped).collect() }
    }

    fn path(&self) -> &Path {
        self.file.map_or(Path::new(""), |file| &file.path)
    }

    /// The campaigns that tables are made of: all, or that of `imu`.
    fn chosen(&self, campaigns: Vec<Campaign>, imu: Option<&ImuId>) -> Result<Vec<Campaign>, Failure> {
        let Some(imu) = imu.filter(|_| self.file.is_some()) else { return Ok(campaigns) };
        let chosen = select_imu(campaigns, Some(imu.as_str()));
        let chosen = chosen.map_err(|message| format!("--imu: {}: {message}", shown(self.path())));
        Ok(vec![chosen.map_err(|message| Failure::new(Exit::Usage, message))?])
    }

    /// The files of the samples: those that are given, or that the campaign file names.
    fn sample_files(&self, campaign: &Campaign) -> Result<Vec<PathBuf>, Failure> {
        match self.file {
            Some(file) if self.samples.is_empty() => file.samples(campaign),
            Some(_) if campaign.has_ramps_alone() => {
                let message =
                    "samples are for positions, and the campaign file has only ramps; name them as [[ramp]] in it";
                Err(Failure::new(Exit::Usage, message))
            }
            _ => Ok(self.samples.to_owned()),
        }
    }

    /// Refuses outputs that are an input of any IMU, or that are there twice.
    fn refuse_overlaps(&self, all: &[CampaignSamples<'_>]) -> Result<(), Failure> {
        let named =
            all.iter().filter_map(|(campaign, _)| Some((self.file?.ramps(campaign), self.file?.curves(campaign))));
        let named: Vec<_> = named.collect();
        let mut files: Vec<_> = all.iter().flat_map(|(_, samples)| inputs(samples)).collect();
        files.extend(named.iter().flat_map(|(ramps, _)| inputs(ramps)));
        files.extend(named.iter().filter_map(|(_, curves)| Some((curves.as_deref()?, "the table curves"))));
        files.extend(&self.others);
        files.extend(self.file.map(|file| (file.path.as_path(), "the campaign file")));
        let outputs: Vec<_> = all.iter().flat_map(|(campaign, _)| self.outputs(campaign)).collect();
        let outputs: Vec<_> = outputs.iter().map(Option::as_deref).chain([self.batch]).collect();
        refuse_overlap(&files, &outputs)
    }

    /// Refuses names and samples that several IMUs would share.
    fn check_names(&self, count: usize) -> Result<(), Failure> {
        if count < 2 {
            return Ok(());
        }
        let wrong = |message: String| Err(Failure::new(Exit::Usage, message));
        for (option, path) in [("-o", Some(self.output)), ("--report", self.table.report.as_deref())] {
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

/// The table of a member that has one, for the statistics.
fn table_of(member: &TableMember) -> Option<Result<TableFile, Failure>> {
    let (_, outcome) = member.result.as_ref().ok()?;
    let name = member.table.display().to_string();
    let table = TableFile::from_toml(name.clone(), &outcome.table);
    Some(table.map_err(|faults| Failure::new(Exit::Failed, format!("{name}: {faults}"))))
}

/// # Errors
/// With all faults, if there are any.
fn refuse_same(faults: &[Finding]) -> Result<(), JobFailure> {
    if faults.is_empty() {
        return Ok(());
    }
    let lines: Vec<_> = faults.iter().map(|finding| finding.tagged(|line| line.to_string())).collect();
    let mut refusal = JobFailure::from(Failure::new(Exit::Data, lines.join("\n")));
    refusal.document["findings"] = findings(faults, |line| line.to_string());
    Err(refusal)
}

/// The subcommand that takes a campaign file.
pub(super) fn job_of_campaign(path: &Path) -> &'static str {
    let campaigns = CampaignFile::read(path).and_then(|file| file.campaigns()).unwrap_or_default();
    if campaigns.iter().any(|campaign| campaign.is_tumble) { "tumble" } else { "turntable" }
}
