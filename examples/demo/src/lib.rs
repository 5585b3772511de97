//! The demonstration: a service and an acquisition as separate processes with real shared memory. A simulated IMU goes
//! through a temperature run, and the service reloads its table meanwhile.

mod acquisition;
mod imu;
mod report;

use acquisition::{Message, RunOutcome};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use isotherm_client::{Domain, ImuId, Options, STATE_VARIABLE, fetch_status};
use isotherm_files::{StagedText, print};
use isotherm_install::{NewTable, TableInstaller};
use isotherm_service::clean::clean;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::status::ServiceStatus;
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::{Exit, Failure, shown};
use report::Report;
use rustix::process::{Pid, Signal, kill_process};
use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The published tables of the source paper.
pub const TABLE: &str = include_str!("../../tables/imu-paper.toml");
/// The same accelerometers with gyroscopes: what the demonstration simulates, except for the terms of temperature in
/// motion.
const WHOLE_TABLE: &str = include_str!("../../tables/imu-whole.toml");
const IMU: &str = "imu-whole";
/// Longest time for the service to start, to answer and to stop.
const SERVICE_TIMEOUT: Duration = Duration::from_secs(5);

/// Show the whole chain on embedded data
///
/// Runs a service and an acquisition through a temperature run, with a table that is replaced in flight.
///
/// The demonstration starts real processes in a domain of its own, prints what they did and writes a report. It leaves
/// nothing else behind.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm demo\n  isotherm demo --report -")]
pub struct Demo {
    /// Write the report to this file
    ///
    /// - writes none
    #[arg(long, value_name = "FILE", default_value = "isotherm-demo-report.txt")]
    report: PathBuf,
    /// Be the demonstration's acquisition process
    #[arg(long, hide = true)]
    acquisition: bool,
}

impl Demo {
    /// Runs the demonstration.
    ///
    /// # Errors
    /// If a process fails (the message then contains the service's log), or if the increments are wrong.
    pub fn run(self, domain: Domain) -> Result<(), Failure> {
        let truth = truth()?;
        let imu: ImuId = IMU.parse().map_err(|error| Failure::new(Exit::Failed, format!("{error}")))?;
        if self.acquisition {
            return acquisition::run(&imu, &truth, &Options::new(domain, SERVICE_TIMEOUT));
        }
        let has_report = self.report != Path::new("-");
        let report = has_report.then(|| StagedText::create(Some(&self.report))).transpose()?;
        let interrupted = Arc::new(AtomicBool::new(false));
        for signal in isotherm_files::end_signals() {
            // If the handler cannot be registered, the signal ends this program without cleaning up.
            let _ = signal_hook::flag::register(signal, Arc::clone(&interrupted));
        }
        let domain = isotherm_client::domain(Some(&format!("demo-{}", std::process::id())));
        let domain = domain.map_err(|error| Failure::new(Exit::Usage, error.to_string()))?;
        let result = run_processes(&domain, &imu, &truth);
        let cleaned = clean(&domain);
        if interrupted.load(Ordering::Relaxed) {
            return Err(Failure::new(Exit::Failed, "interrupted"));
        }
        let text = result?;
        cleaned?;
        print(&text)?;
        if let Some(report) = report {
            report.write(&text)?.finish()?;
            print(&format!("\nThe same in {}.\n", shown(&self.report)))?;
        }
        Ok(())
    }
}

/// Runs the processes and returns the report.
fn run_processes(domain: &Domain, imu: &ImuId, truth: &CoefficientTable) -> Result<String, Failure> {
    let started = Instant::now();
    let io = |phase: &'static str| move |error: io::Error| Failure::new(Exit::Io, format!("{phase}: {error}"));
    let folder =
        tempfile::Builder::new().prefix("isotherm-demo-").tempdir().map_err(io("creating a temporary folder"))?;
    let (table, log) = (folder.path().join("table.toml"), folder.path().join("log"));
    let frozen = frozen(truth)?;
    // With a provenance it is a calibration like the next one, and no nominal table.
    let text = format!("{}\n[provenance]\ntool = \"isotherm demo\"\n", frozen.to_toml());
    fs::write(&table, text).map_err(io("writing the table"))?;

    let isotherm = |arguments: &[&str]| -> Result<Command, Failure> {
        let mut command = Command::new(std::env::current_exe().map_err(io("finding this program"))?);
        command.args(["--domain", domain.name()]).args(arguments).stdin(Stdio::null());
        Ok(command)
    };
    let log_file = File::create(&log).map_err(io("creating the service's log"))?;
    let mut serve = isotherm(&["serve", "--imu", &format!("{imu}={}", table.display())])?;
    // Nothing of the demonstration stays.
    let serve = serve.env(STATE_VARIABLE, folder.path()).stderr(log_file).spawn();
    let mut service = ChildProcess(serve.map_err(io("starting the service"))?);
    let feed = isotherm(&["demo", "--acquisition"])?.stdout(Stdio::piped()).spawn();
    let mut acquisition = ChildProcess(feed.map_err(io("starting the acquisition"))?);

    let outcome = wait_for_outcome(&mut acquisition, || {
        let new = NewTable { table: truth, text: &truth.to_toml(), source: &table, is_accepted: false };
        TableInstaller::lock(domain, imu, &table)?.install(&new).map(drop)
    });
    let outcome = outcome.map_err(|failure| with_log(failure, &log))?;
    let status =
        fetch_status(&Options::new(domain.clone(), SERVICE_TIMEOUT)).map_err(|error| with_log(error.into(), &log))?;
    service.terminate().map_err(|failure| with_log(failure, &log))?;

    let wrong = lost(&outcome, &status) + outcome.out_of_order + outcome.flagged;
    if outcome.tables != [frozen.id(), truth.id()] || wrong > 0 {
        return Err(Failure::new(
            Exit::Failed,
            format!(
                "the increments are not what they should be: {} lost, {} out of order, {} flagged, tables {:016x?}",
                lost(&outcome, &status),
                outcome.out_of_order,
                outcome.flagged,
                outcome.tables
            ),
        ));
    }
    let report = Report { outcome: &outcome, status: &status, tables: [&frozen, truth], elapsed: started.elapsed() };
    Ok(report.to_string())
}

/// Samples without an answer, counted by the acquisition, plus missed samples, counted by the service.
fn lost(outcome: &RunOutcome, status: &ServiceStatus) -> u64 {
    outcome.sent - outcome.answered + status.imus.iter().map(|imu| imu.missing).sum::<u64>()
}

/// The embedded table without the terms of temperature in motion.
fn truth() -> Result<CoefficientTable, Failure> {
    let failed = |cause: &dyn Display| Failure::new(Exit::Failed, format!("the embedded table: {cause}"));
    let table = CoefficientTable::from_toml(WHOLE_TABLE, None).map_err(|faults| failed(&faults))?;
    let mut content = table.content().clone();
    content.lag_s = None;
    let gyroscopes = content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes);
    for axis in content.axes.iter_mut().chain(gyroscopes) {
        axis.transient = 0.0;
    }
    CoefficientTable::new(content).map_err(|refusals| failed(&format!("{refusals:?}")))
}

/// The table without temperature dependence: every polynomial is frozen at its value in the middle of the run.
fn frozen(truth: &CoefficientTable) -> Result<CoefficientTable, Failure> {
    let freeze = |polynomial: &mut Polynomial| {
        let constant = Polynomial::new(&[polynomial.at(imu::middle())], 0.0, 1.0, polynomial.range());
        constant.map(|constant| *polynomial = constant)
    };
    let mut content = truth.content().clone();
    let gyroscopes = content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes);
    let frozen = content.axes.iter_mut().chain(gyroscopes).try_for_each(|axis| {
        freeze(&mut axis.bias)?;
        freeze(&mut axis.positive_scale_factor)?;
        freeze(&mut axis.negative_scale_factor)
    });
    let table = frozen.and_then(|()| CoefficientTable::new(content).ok());
    table.ok_or_else(|| Failure::new(Exit::Failed, "freezing the embedded table"))
}

/// Reads the messages of the acquisition process until it ends. `reload` installs the new table.
fn wait_for_outcome(
    acquisition: &mut ChildProcess,
    reload: impl Fn() -> Result<(), Failure>,
) -> Result<RunOutcome, Failure> {
    let failed = |cause: &str| Failure::new(Exit::Failed, format!("the demonstration's acquisition process {cause}"));
    // The bar is drawn on stderr, and only if that is a terminal.
    let style =
        ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}").unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(1000).with_style(style).with_message("heating, frozen table");
    let stdout = acquisition.0.stdout.take().ok_or_else(|| failed("has no output"))?;
    let mut outcome = None;
    for line in BufReader::new(stdout).lines() {
        let line = line.map_err(|error| failed(&format!("has unreadable output: {error}")))?;
        match serde_json::from_str(&line).map_err(|error| failed(&format!("sent an invalid message: {error}")))? {
            Message::Progress(share) => bar.set_position((share * 1000.0) as u64),
            Message::Turning => {
                reload()?;
                bar.set_message("cooling, full model");
            }
            Message::RunOutcome(result) => outcome = Some(*result),
        }
    }
    bar.finish_and_clear();
    let status = acquisition.0.wait().map_err(|error| failed(&format!("cannot be waited for: {error}")))?;
    outcome.filter(|_| status.success()).ok_or_else(|| failed(&format!("ended with {status}")))
}

fn with_log(failure: Failure, log: &Path) -> Failure {
    let log = fs::read_to_string(log).unwrap_or_default();
    Failure::new(failure.exit, format!("{failure}\nthe service's log:\n{log}"))
}

/// A child process that is killed when this is dropped.
struct ChildProcess(Child);

impl ChildProcess {
    /// Sends SIGTERM and waits for the end; the exit code must be 0.
    fn terminate(&mut self) -> Result<(), Failure> {
        let failed = |cause: String| Failure::new(Exit::Failed, format!("stopping the service: {cause}"));
        let pid = Pid::from_child(&self.0);
        kill_process(pid, Signal::TERM).map_err(|error| failed(error.to_string()))?;
        let deadline = Instant::now() + SERVICE_TIMEOUT;
        while Instant::now() < deadline {
            match self.0.try_wait().map_err(|error| failed(error.to_string()))? {
                Some(status) if status.success() => return Ok(()),
                Some(status) => return Err(failed(status.to_string())),
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        }
        Err(failed("it does not end".to_owned()))
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        // Both calls fail if the process has already ended, which is the normal case.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
