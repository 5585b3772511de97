//! After the data: fit, verify, install.

use super::journal::{Entry, Journal};
use super::plan::Plan;
use super::runner::{runs, stopped_by};
use crate::cli::calibrate::Calibrate;
use crate::cli::verify::Verify;
use crate::failure::{Exit, Failure};
use crate::files::{Guard, Output, load_table};
use crate::status::fetch;
use isotherm_client::Options;
use isotherm_shared::table::CoefficientTable;
use std::fs;
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::atomic::AtomicUsize;
use std::thread;
use std::time::{Duration, Instant};

/// The fitted table's name in the campaign's folder.
pub const TABLE: &str = "table.toml";
/// A service that watches the file takes the table within milliseconds.
const TAKEN_WITHIN: Duration = Duration::from_secs(10);

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Finish {
    /// Least factor of every axis in every verification run; without one nothing is installed.
    pub require: Option<f64>,
    /// Whether the table gets an alignment matrix.
    pub alignment: bool,
}

impl Finish {
    /// Fits the table, looks at every verification run, and installs the table if all of them hold and nobody has asked it to end.
    ///
    /// # Errors
    /// What has failed; the table that was in force is then untouched.
    pub fn run(
        self,
        plan: &Plan,
        journal: &mut Journal,
        options: &Options,
        ended: &AtomicUsize,
    ) -> Result<(), Failure> {
        let folder = &plan.output;
        let table = folder.join(TABLE);
        tell("fitting");
        let calibrate =
            Calibrate::of(&folder.join("campaign.toml"), &table, &folder.join("calibration.html"), self.alignment);
        let tilt = calibrate.calibrate()?.solution.tilt;
        let (fitted, _) = load_table(&table, Some(&plan.imu), Guard::Lax)?;
        journal.lasting(Entry::Calibrated { digest: fitted.digest().to_string() })?;
        let gravity = plan.campaign.gravity_local;
        // On a base as tilted as it was found to be.
        let attitude = plan.verify.map(|verify| plan.campaign.force(&verify.position(), tilt).0);
        let mut failed = Vec::new();
        for run in runs(plan) {
            asked_to_end(ended)?;
            let heading = writeln!(io::stdout(), "{run}:");
            heading.map_err(|error| Failure::new(Exit::Io, format!("writing to stdout: {error}")))?;
            let recording = folder.join(&run);
            let report = recording.with_extension("html");
            let verify = Verify::of(&table, &recording, self.require, attitude, gravity, &report);
            // All of them are looked at before any decides.
            if let Err(failure) = verify.run() {
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
            tell(&format!("{} is the table; the plan has no install, so it stays there", table.display()));
            return Ok(());
        };
        if self.require.is_none() || plan.verify.is_none() {
            tell(&format!(
                "{} is the table; it is installed only after [verify] runs and with --require",
                table.display()
            ));
            return Ok(());
        }
        asked_to_end(ended)?;
        install(&table, target)?;
        journal.lasting(Entry::Installed { digest: fitted.digest().to_string(), file: target.clone() })?;
        tell(&format!("{} is installed as {}", fitted.digest(), target.display()));
        taken(plan, &fitted, options)
    }
}

fn asked_to_end(ended: &AtomicUsize) -> Result<(), Failure> {
    let stopped = |signal| Err(Failure::new(Exit::Failed, format!("{signal}; nothing is installed")));
    stopped_by(ended).map_or(Ok(()), stopped)
}

fn tell(words: &str) {
    let _ = writeln!(io::stderr(), "isotherm: {words}");
}

/// Aside and renamed, so that a service that watches the file sees a whole one.
fn install(table: &Path, target: &Path) -> Result<(), Failure> {
    let text = fs::read_to_string(table).map_err(|error| Failure::io("reading", table, &error))?;
    let write = || {
        let mut output = Output::create(Some(target))?;
        output.write_all(text.as_bytes())?;
        output.finish()
    };
    write().map_err(|error| Failure::io("installing", target, &error))
}

/// Waits until the service says that the table is in force.
fn taken(plan: &Plan, table: &CoefficientTable, options: &Options) -> Result<(), Failure> {
    let begun = Instant::now();
    let digest = table.digest().to_string();
    loop {
        let status = fetch(options);
        let why = match &status {
            Ok(status) => match status.imus.iter().find(|imu| imu.id == plan.imu.to_string()) {
                Some(imu) if imu.table.as_deref() == Some(&digest) => {
                    tell("the service has it in force");
                    return Ok(());
                }
                Some(imu) => imu.last_reload_error.clone().unwrap_or_else(|| format!("it watches {}", imu.table_file)),
                None => format!("it does not serve {}", plan.imu),
            },
            Err(failure) => failure.to_string(),
        };
        if begun.elapsed() > TAKEN_WITHIN {
            let message = format!("the table is installed, but the service does not have it in force: {why}");
            return Err(Failure::new(Exit::Unavailable, message));
        }
        thread::sleep(Duration::from_millis(50));
    }
}
