//! The steps after the campaign's data are complete: fit, verify, install.

use super::journal::{Entry, Journal};
use super::plan::{Plan, SAMPLES};
use super::runner::{run_files, stopped_by};
use isotherm_calibration::calibrate::{CalibrationOptions, calibrate};
use isotherm_calibration::campaign::{Campaign, read};
use isotherm_calibration::provenance::{CampaignSource, Hashed, now, sealed_table, sha256, tool};
use isotherm_calibration::report::{self, verification::VerificationSource};
use isotherm_calibration::stability::{Collector, Setup};
use isotherm_client::{Options, fetch_status};
use isotherm_failure::{Exit, Failure, printable, tell};
use isotherm_files::{LoadError, StagedText, WorldWritable, load_table, open_recording, print, read_text, replace};
use isotherm_recording::{CampaignCsvReader, RawCsvReader};
use isotherm_shared::table::CoefficientTable;
use std::fs;
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::atomic::AtomicUsize;
use std::thread;
use std::time::{Duration, Instant};

/// The name of the fitted table in the campaign's folder.
pub const TABLE: &str = "table.toml";
/// Longest time until the service has the installed table in force; it takes milliseconds if the service watches the file.
const IN_FORCE_TIMEOUT: Duration = Duration::from_secs(10);

/// Options of the steps after the data.
#[derive(Clone, Copy, Debug)]
pub struct Finish {
    /// Smallest factor that every axis must reach in every verification run; `None` installs nothing.
    pub require: Option<f64>,
    /// Whether the table gets an alignment matrix.
    pub alignment: bool,
}

impl Finish {
    /// Fits the table, verifies it with every run, and installs it if all runs reach the factor and no signal has asked to end.
    ///
    /// # Errors
    /// The step that has failed. A failure before the installation leaves the installed table unchanged.
    pub fn run(
        self,
        plan: &Plan,
        journal: &mut Journal,
        options: &Options,
        stop_signal: &AtomicUsize,
    ) -> Result<(), Failure> {
        let folder = &plan.output;
        let table = folder.join(TABLE);
        print_message("fitting");
        let tilt = calibrate_campaign(folder, &table, self.alignment)?;
        let (fitted, _) = load_table(&table, Some(&plan.imu), WorldWritable::Allow)?;
        journal.write_synced(Entry::Calibrated { digest: fitted.digest().to_string() })?;
        let gravity = plan.campaign.gravity_local;
        // The attitude includes the tilt of the base that the fit has found.
        let attitude = plan.verify.map(|verify| plan.campaign.force(&verify.position(), tilt).0);
        let setup = Setup::new(attitude, Some(gravity), &fitted);
        let mut failed = Vec::new();
        for run in run_files(plan) {
            check_stop_signal(stop_signal)?;
            // All runs are verified and reported before a failure ends the function.
            if let Err(failure) = verify_run(&fitted, &table, &folder.join(&run), &setup, self.require) {
                failed.push(Failure::new(failure.exit, format!("{run}: {failure}")));
            }
        }
        if let Some(first) = failed.first() {
            let messages: Vec<_> = failed.iter().map(ToString::to_string).collect();
            return Err(Failure::new(
                first.exit,
                format!("{}\nnothing is installed; {} is what was fitted", messages.join("\n"), table.display()),
            ));
        }
        let Some(target) = &plan.install else {
            print_message(&format!("{} is the table; the plan has no install, so it stays there", table.display()));
            return Ok(());
        };
        if self.require.is_none() || plan.verify.is_none() {
            print_message(&format!(
                "{} is the table; it is installed only after [verify] runs and with --require",
                table.display()
            ));
            return Ok(());
        }
        check_stop_signal(stop_signal)?;
        install(&table, target)?;
        journal.write_synced(Entry::Installed { digest: fitted.digest().to_string(), file: target.clone() })?;
        print_message(&format!("{} is installed as {}", fitted.digest(), target.display()));
        wait_until_in_force(plan, &fitted, options)
    }
}

/// Fits the table of the campaign in `folder`, and writes it with its report. Returns the tilt of the base, if it was fitted.
fn calibrate_campaign(folder: &Path, table: &Path, alignment: bool) -> Result<Option<[f64; 2]>, Failure> {
    let (file, samples) = (folder.join("campaign.toml"), folder.join(SAMPLES));
    let (text, _) = read_text(&file, WorldWritable::Allow)?;
    let campaign = Campaign::from_toml(&text);
    let campaign = campaign.map_err(|faults| LoadError::Refused { path: file.clone(), faults })?;
    let source = open_recording(&samples).map_err(|error| Failure::io("opening the samples", &samples, &error))?;
    let mut hashed = Hashed::new(source);
    let dwells = CampaignCsvReader::new(&mut hashed).and_then(|rows| read(&campaign, rows));
    let dwells = dwells.map_err(|error| error.failure(&samples))?;
    let locate = |line| format!("{}:{line}", samples.display());
    let options = CalibrationOptions { alignment, ..CalibrationOptions::default() };
    let calibration = calibrate(&campaign, dwells, options);
    let calibration = calibration.map_err(|error| error.failure(&file, &samples, locate))?;
    let source = CampaignSource {
        tool: tool(),
        time: now(),
        campaign: "campaign.toml".to_owned(),
        campaign_sha256: sha256(text.as_bytes()),
        samples_sha256: hashed.finish().1,
    };
    let sealed = sealed_table(&campaign, &calibration, &source);
    let sealed = sealed.map_err(|message| Failure::new(Exit::Failed, message))?;
    for finding in &calibration.findings {
        print_message(&format!("warning: {}", finding.located(locate)));
    }
    let _ = io::stderr().write_all(printable(&report::text::calibration(&calibration)).as_bytes());
    let page = StagedText::create(Some(&folder.join("calibration.html")))?;
    let page = page.write(&report::calibration::html(&campaign, &calibration, &source))?;
    StagedText::finish_together(vec![StagedText::create(Some(table))?.write(&sealed)?, page])?;
    Ok(calibration.solution.tilt)
}

/// Length of the windows of the stability \[s\].
const WINDOW_S: f64 = 10.0;

/// Prints the stability of a verification run, writes its report, and checks it against the required factor.
fn verify_run(
    table: &CoefficientTable,
    table_file: &Path,
    recording: &Path,
    setup: &Setup,
    require: Option<f64>,
) -> Result<(), Failure> {
    let source = open_recording(recording).map_err(|error| Failure::io("opening", recording, &error))?;
    let mut collector = Collector::new(table, WINDOW_S);
    for sample in RawCsvReader::new(source).map_err(|error| error.failure(recording))? {
        collector.add(&sample.map_err(|error| error.failure(recording))?);
    }
    let stability = collector.finish(setup);
    let stability = stability.map_err(|error| Failure::new(Exit::Data, format!("{}: {error}", recording.display())))?;
    if let Some(warning) = stability.gravity_mismatch() {
        print_message(&format!("warning: {}: {warning}", recording.display()));
    }
    let name = recording.file_name().unwrap_or_default().to_string_lossy();
    let aligned = table.content().alignment.is_some();
    print(&format!("{name}:\n{}", report::text::stability(&stability, WINDOW_S, aligned)))?;
    let source = VerificationSource {
        tool: tool(),
        time: now(),
        table: table_file.display().to_string(),
        recording: recording.display().to_string(),
        window_s: WINDOW_S,
        required: require,
    };
    let page = report::verification::html(table, &stability, &source);
    StagedText::create(Some(&recording.with_extension("html")))?.write(&page)?.finish()?;
    let verdict = require.map_or(Ok(()), |factor| stability.require(factor));
    verdict.map_err(|message| Failure::new(Exit::Failed, message))
}

fn check_stop_signal(stop_signal: &AtomicUsize) -> Result<(), Failure> {
    let stopped = |signal| Err(Failure::new(Exit::Failed, format!("{signal}; nothing is installed")));
    stopped_by(stop_signal).map_or(Ok(()), stopped)
}

fn print_message(message: &str) {
    tell("isotherm", message);
}

/// Installs the table by a rename, so that a service that watches the file never sees a part of it.
fn install(table: &Path, target: &Path) -> Result<(), Failure> {
    let text = fs::read_to_string(table).map_err(|error| Failure::io("reading", table, &error))?;
    replace(target, &text).map_err(|error| Failure::io("installing", target, &error))
}

/// Waits until the service's status shows the table in force.
fn wait_until_in_force(plan: &Plan, table: &CoefficientTable, options: &Options) -> Result<(), Failure> {
    let begun = Instant::now();
    let digest = table.digest().to_string();
    loop {
        let status = fetch_status(options);
        let cause = match &status {
            Ok(status) => match status.imus.iter().find(|imu| imu.id == plan.imu.to_string()) {
                Some(imu) if imu.table.as_deref() == Some(&digest) => {
                    print_message("the service has it in force");
                    return Ok(());
                }
                Some(imu) => imu.last_reload_error.clone().unwrap_or_else(|| format!("it watches {}", imu.table_file)),
                None => format!("it does not serve {}", plan.imu),
            },
            Err(error) => error.to_string(),
        };
        if begun.elapsed() > IN_FORCE_TIMEOUT {
            let message = format!("the table is installed, but the service does not have it in force: {cause}");
            return Err(Failure::new(Exit::Unavailable, message));
        }
        thread::sleep(Duration::from_millis(50));
    }
}
