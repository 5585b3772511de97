//! The steps after the campaign's data are complete: fit, verify, install.

mod fitted_table;
mod verify;

use super::in_force::InForce;
use super::journal::{self, Entry, History, JOURNAL, Journal};
use super::page;
use super::plan::Plan;
use super::progress::DroppedImu;
use super::step::CampaignStep;
use fitted_table::{FittedTable, print_message};
use isotherm_client::Domain;
use isotherm_files::StagedText;
use isotherm_fit::{Accuracy, AlignmentChoice, Calibration, CalibrationOptions, CalibrationOutcome, LagChoice};
use isotherm_pipeline::{CampaignFile, InputOptions, Inputs, no_bar};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::table::difference::TableDifference;
use isotherm_support::failure::{Exit, Failure, printable, shown};
use isotherm_verification::Requirement;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicUsize;
use verify::{InstallationRefusal, check_stop_signal, verify};

/// Begin of the name of the fitted table in the campaign's folder; see [`Plan::file`].
const TABLE: &str = "table";
/// Why the table of an IMU that is dropped is not installed.
const DROPPED: &str = "it is not verified: the IMU is dropped, and verification runs of it are missing";
/// Options of the steps after the data.
#[derive(Clone, Debug)]
pub struct Finish {
    /// What every verification run must show; bounds that are not given come from the fit ([`Requirement::of_fit`]).
    /// `None` installs nothing.
    pub require: Option<Requirement>,
    /// Whether the table gets an alignment matrix. If it is not said, the table in force decides, and the fit if there
    /// is none.
    pub alignment: AlignmentChoice,
    /// How the time constant of the lag is found, from the ramps.
    pub lag: LagChoice,
    /// Names of faults that count as warnings.
    pub accept: Vec<&'static str>,
    /// Whether every warning that is not accepted is a fault.
    pub strict: bool,
}

impl Finish {
    /// Fits the table, verifies it with every run, and installs it if all runs show what is required, none shows that
    /// the table in force is better, and no signal has asked to end. The journal has what becomes of each step, and so
    /// has the live page. In a batch, each IMU that is not dropped has its own table; a failure of one does not stop
    /// the others. One that is dropped has its table, which is neither verified nor installed, if only verification
    /// runs of it are missing.
    ///
    /// # Errors
    /// The step that has failed; of a batch those of all IMUs, with [`Exit::Failed`]. A failure before the installation
    /// leaves the installed table unchanged.
    pub fn run(
        self,
        plan: &Plan,
        journal: &mut Journal,
        domain: &Domain,
        stop_signal: &AtomicUsize,
    ) -> Result<(), Failure> {
        let result = if plan.is_batch() {
            self.batch(plan, journal, domain, stop_signal)
        } else {
            self.steps(plan, journal, domain, stop_signal, false)
        };
        if let Err(error) = page::rewrite(plan) {
            tracing::warn!("writing the live page: {error}");
        }
        result
    }

    /// The steps of each IMU of a batch, as far as its data allow if it is dropped.
    fn batch(
        &self,
        plan: &Plan,
        journal: &mut Journal,
        domain: &Domain,
        stop_signal: &AtomicUsize,
    ) -> Result<(), Failure> {
        let history = history(plan)?;
        let mut failed = Vec::new();
        for plan in plan.each() {
            let is_dropped = history.reason_dropped(&plan.imu).is_some();
            if is_dropped && !has_all_to_fit(plan, &history) {
                continue;
            }
            check_stop_signal(stop_signal)?;
            journal.about(Some(&plan.imu));
            let result = self.steps(plan, journal, domain, stop_signal, is_dropped);
            journal.about(None);
            if let Err(failure) = result {
                failed.extend(failure.message.lines().map(|line| format!("{}: {line}", plan.imu)));
            }
        }
        check_stop_signal(stop_signal)?;
        if failed.is_empty() { Ok(()) } else { Err(Failure::new(Exit::Failed, failed.join("\n"))) }
    }

    fn steps(
        &self,
        plan: &Plan,
        journal: &mut Journal,
        domain: &Domain,
        stop_signal: &AtomicUsize,
        is_dropped: bool,
    ) -> Result<(), Failure> {
        journal.write_synced(Entry::FitBegun)?;
        let fit = match self.fit(plan) {
            Ok(fit) => fit,
            Err(failure) => {
                return Err(noted(journal, Entry::NotCalibrated { reason: failure.to_string() }, failure));
            }
        };
        let accuracy = Accuracy::of(&fit.calibration);
        let accuracy = match Accuracy::of_gyroscopes(&fit.calibration) {
            Some(gyroscopes) => format!("accelerometers: {accuracy}; gyroscopes: {gyroscopes}"),
            None => accuracy.to_string(),
        };
        let transients = fit.calibration.transients.iter().flat_map(|found| &found.words);
        let accuracy = transients.fold(accuracy, |accuracy, words| format!("{accuracy}; {words}"));
        journal.write_synced(Entry::Calibrated { digest: fit.digest(), accuracy })?;
        let table_path = plan.output.join(plan.file(TABLE, "toml"));
        let table_file = shown(&table_path);
        // The runs of one that is dropped are not complete.
        let placement = match is_dropped {
            true => Ok(TablePlacement::LeftAside(DROPPED)),
            false => self.verify_and_install(plan, journal, &fit, &table_path, domain, stop_signal),
        };
        match placement {
            Ok(TablePlacement::Installed(target, judged)) => {
                // A journal is UTF-8, and is read from other working directories.
                let file = std::path::absolute(target).unwrap_or_else(|_| target.to_owned());
                let file = PathBuf::from(file.to_string_lossy().into_owned());
                journal.write_synced(Entry::Installed { digest: fit.digest(), file })?;
                judged
            }
            Ok(TablePlacement::LeftAside(reason)) => {
                print_message(&format!("{table_file} is the table; it is not installed: {reason}"));
                journal.write_synced(Entry::NotInstalled { reason: reason.to_owned() })
            }
            Err(InstallationRefusal { failure, reason, remedy }) => {
                let text = format!("{failure}\nnothing is installed; the table is left aside as {table_file}{remedy}");
                Err(noted(journal, Entry::NotInstalled { reason }, Failure::new(failure.exit, text)))
            }
        }
    }

    /// Verifies the table by every run, and installs it if that is asked for.
    fn verify_and_install<'p>(
        &self,
        plan: &'p Plan,
        journal: &mut Journal,
        fit: &FittedTable,
        table_file: &Path,
        domain: &Domain,
        stop_signal: &AtomicUsize,
    ) -> Result<TablePlacement<'p>, InstallationRefusal> {
        verify(self.require, plan, journal, fit, stop_signal)?;
        check_stop_signal(stop_signal)?;
        Ok(match self.target(plan) {
            Ok(target) => match fit.install(table_file, target, domain) {
                Err(failure) if failure.exit != Exit::Temporary => return Err(failure.into()),
                judged => TablePlacement::Installed(target, judged),
            },
            Err(reason) => TablePlacement::LeftAside(reason),
        })
    }

    /// The file to install the table in, or why none is wanted.
    fn target<'p>(&self, plan: &'p Plan) -> Result<&'p Path, &'static str> {
        let target = plan.install.as_deref().ok_or("the plan has no install")?;
        let wanted = self.require.is_some() && plan.verify.is_some();
        if wanted { Ok(target) } else { Err("that takes --require and [verify] runs") }
    }

    /// Fits the table of the campaign, and writes it with its report.
    fn fit(&self, plan: &Plan) -> Result<FittedTable, Failure> {
        let in_force = plan.install.as_deref().map(|target| InForce::read(target, plan)).transpose();
        let in_force = match in_force {
            Ok(in_force) => in_force.flatten(),
            Err(failure) if self.target(plan).is_ok() => return Err(failure),
            // Nothing is to be installed: the fit can do without it.
            Err(failure) => {
                print_message(&failure.to_string());
                None
            }
        };
        print_message(
            &plan.member.as_ref().map_or_else(|| "fitting".to_owned(), |member| format!("fitting {}", member.imu)),
        );
        let (mut calibration, text) =
            self.calibrate_campaign(plan, in_force.as_ref().map(|in_force| &in_force.table))?;
        // What the file says: it has the digest and the stated errors.
        calibration.table = CoefficientTable::from_toml(&text, Some(&plan.imu))
            .map_err(|error| Failure::new(Exit::Failed, error.to_string()))?;
        for change in
            in_force.iter().flat_map(|in_force| TableDifference::of(&in_force.table, &calibration.table).summary())
        {
            print_message(&format!("note: against the table in force, {change}"));
        }
        Ok(FittedTable { calibration, text, in_force })
    }

    /// Fits the table of the IMU of `plan` from the campaign's folder, and writes it with its report. Returns also the
    /// text of the table.
    fn calibrate_campaign(
        &self,
        plan: &Plan,
        in_force: Option<&CoefficientTable>,
    ) -> Result<(Calibration, String), Failure> {
        let folder = &plan.output;
        let file = CampaignFile::read(&folder.join("campaign.toml"))?;
        let campaign = file.campaigns()?.into_iter().find(|campaign| campaign.imu == plan.imu);
        let campaign = campaign.ok_or_else(|| {
            let (file, imu) = (shown(&file.path), &plan.imu);
            let message = format!("{file}: {imu} is not in it; run the campaign again, which writes it again");
            Failure::new(Exit::Data, message)
        })?;
        let (options, input) = (self.options(in_force), InputOptions::default());
        let inputs = Inputs::turntable(&campaign, &file, Vec::new(), options, &input, &no_bar);
        let made = inputs.and_then(|inputs| inputs.fit(&campaign, Some(&file))).map_err(|refused| refused.failure)?;
        made.findings().for_each(|finding| print_message(&finding));
        let _ = io::stderr().write_all(printable(&made.text()).as_bytes());
        let write = |name: &str, extension, text: &str| {
            StagedText::create(Some(&folder.join(plan.file(name, extension))))?.write(text)
        };
        let texts = vec![write(TABLE, "toml", &made.table)?, write("calibration", "html", &made.html(&campaign))?];
        StagedText::finish_all(texts)?;
        match made.fitted {
            CalibrationOutcome::Campaign(calibration) => Ok((*calibration, made.table)),
            _ => Err(Failure::new(Exit::Failed, "an automatic campaign has positions")),
        }
    }

    /// The options of the fit. A vehicle is boresighted with the axes of the table in force, so an installation keeps
    /// them.
    fn options(&self, in_force: Option<&CoefficientTable>) -> CalibrationOptions {
        let alignment = match (self.alignment, in_force) {
            (AlignmentChoice::IfNeeded, Some(table)) => {
                let with = table.content().alignment.is_some();
                let word = if with { "with" } else { "without" };
                print_message(&format!("{word} an alignment matrix, as the table in force"));
                AlignmentChoice::of(with, !with)
            }
            (choice, _) => choice,
        };
        CalibrationOptions {
            alignment,
            accept: self.accept.clone(),
            strict: self.strict,
            lag: self.lag,
            predecessor_lag_s: in_force.and_then(|table| table.content().lag_s),
            ..CalibrationOptions::default()
        }
    }
}

/// The IMUs of the batch of `plan` that are dropped.
///
/// # Errors
/// If the journal cannot be read.
pub fn dropped(plan: &Plan) -> Result<Vec<DroppedImu>, Failure> {
    let dropped = history(plan)?.dropped.into_iter();
    Ok(dropped.map(|(imu, reason)| DroppedImu { imu, reason }).collect())
}

fn history(plan: &Plan) -> Result<History, Failure> {
    let (lines, _) = journal::read(&plan.output.join(JOURNAL))?;
    Ok(journal::history(&lines))
}

/// Whether every dwell, turn and ramp of the IMU of `plan` is complete.
fn has_all_to_fit(plan: &Plan, history: &History) -> bool {
    let units =
        (0..).map_while(|index| CampaignStep::of(plan, index)).take_while(|unit| !matches!(unit, CampaignStep::Run(_)));
    units.enumerate().all(|(index, unit)| {
        let file = unit.file(plan);
        history.kept.get(index).is_some_and(|kept| kept.each().any(|kept| kept.file == file))
    })
}

/// What has become of a fitted table.
enum TablePlacement<'p> {
    /// It is installed as this file. The service has not judged it in time if there is a failure.
    Installed(&'p Path, Result<(), Failure>),
    /// It stays in the campaign's folder for this reason, which is no failure.
    LeftAside(&'static str),
}

/// Notes in the journal why a step has failed. If that fails too, the failure says both.
fn noted(journal: &mut Journal, entry: Entry, failure: Failure) -> Failure {
    match journal.write_synced(entry) {
        Ok(()) => failure,
        Err(second) => Failure::new(failure.exit, format!("{failure}\n{second}")),
    }
}
