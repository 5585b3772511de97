//! `campaign`: the automatic campaign.

use super::common::options;
use clap::{Args, Subcommand};
use isotherm_automation::control::{self, CampaignLock, StopOutcome, runner_pid, snapshot};
use isotherm_automation::finish::{Finish, dropped};
use isotherm_automation::journal::{self, Journal};
use isotherm_automation::outcome::{outcome, outcomes};
use isotherm_automation::plan::Plan;
use isotherm_automation::progress::{DroppedImu, STATUS, Snapshot};
use isotherm_automation::runner::Runner;
use isotherm_automation::stop;
use isotherm_automation::timeline::{duration, left_s, milestones, units};
use isotherm_campaign::Member;
use isotherm_client::Domain;
use isotherm_files::{create_own_folder, end_signals, print, print_data};
use isotherm_fit::{AlignmentChoice, LagChoice};
use isotherm_instruments::Surroundings;
use isotherm_offline::commands::common::joined;
use isotherm_offline::parse::{lag_choice, seconds};
use isotherm_service::commands::no_domain;
use isotherm_service::logging::{self, LogFormat};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::name;
use isotherm_verification::Requirement;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::time::Duration;
use tracing::warn;

/// Drive chamber and turntable through a campaign
///
/// Drives a temperature chamber and a two-axis turntable through a campaign, and records the samples.
///
/// A plan defines set points, positions, rules and instruments. The samples are taken from the raw stream of the
/// running service. `isotherm calibrate` reads the folder that the campaign writes.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    after_help = "Examples:\n  isotherm campaign check plan.toml\n  isotherm campaign run plan.toml --calibrate --require 10\n  isotherm campaign status plan.toml"
)]
pub(crate) struct CampaignCommand {
    #[command(subcommand)]
    action: CampaignAction,
}

#[derive(Debug, Subcommand)]
enum CampaignAction {
    Run(RunCampaign),
    #[command(arg = no_domain())]
    Check(CheckCampaign),
    #[command(arg = no_domain())]
    Status(StatusCampaign),
    #[command(arg = no_domain())]
    Stop(StopCampaign),
}

/// Run a campaign, or continue it
///
/// An interrupted campaign continues with the first missing dwell, turn, ramp or run.
///
/// SIGINT, SIGTERM, `isotherm campaign stop` and every error end in the safe state: the turntable is stopped, and the
/// chamber goes to standby or to the ambient temperature that the plan states. To continue, run the command again.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm campaign run plan.toml\n  isotherm campaign run plan.toml --calibrate --require 10,bias=20ug0"
)]
struct RunCampaign {
    /// Read this plan
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
    /// Fit the table after the campaign
    ///
    /// Also writes its report, and evaluates the verification runs.
    #[arg(long)]
    calibrate: bool,
    /// Install the table if it meets these bounds
    ///
    /// With --calibrate. Every verification run must meet the bounds: a factor of stability, or
    /// bias=20ug0,scale=50ppm,level=5arcsec.
    ///
    /// Bounds that are not given come from the errors of the fit. A table is not installed if it is worse than the one
    /// in force on the same runs, or covers less of its range. The predecessor of an installed table is kept next to it
    /// (isotherm rollback)
    #[arg(long, value_name = "BOUNDS", requires = "calibrate")]
    require: Vec<Requirement>,
    /// Give the table an alignment matrix
    ///
    /// Default: as the table in force; if there is none, as the IMU needs it.
    #[arg(long, requires = "calibrate", conflicts_with = "no_alignment")]
    alignment: bool,
    /// Give the table no alignment matrix
    #[arg(long, requires = "calibrate")]
    no_alignment: bool,
    /// Set the lag behind the temperature [s]
    ///
    /// The time constant, for example that of another device of the same type; or none, for a table without transients
    /// [default: found in the ramps]
    #[arg(long, value_name = "S|none", requires = "calibrate", value_parser = lag_choice)]
    lag: Option<LagChoice>,
    /// Continue in spite of this fault
    ///
    /// Makes the table in spite of a fault of this name. Give several names with commas, or repeat the option.
    #[arg(long, value_name = "NAME", requires = "calibrate", value_delimiter = ',', value_parser = name::acceptable)]
    accept: Vec<&'static str>,
    /// Treat every warning as a fault
    ///
    /// Applies to every warning of the fit that is not accepted.
    #[arg(long, requires = "calibrate")]
    strict: bool,
    /// Accept samples of another device
    ///
    /// Accepts samples of a device whose serial number differs from that of the plan.
    #[arg(long)]
    other_device: bool,
    /// Set the speed of a simulated laboratory
    ///
    /// The waits of the plan are divided by N. The time-outs of the lines are not.
    #[arg(long, value_name = "N", default_value = "1", value_parser = speed)]
    speed: f64,
    /// Choose the format of log lines
    ///
    /// On a terminal, progress bars take the place of log lines for people.
    #[arg(long, value_enum, default_value_t, value_name = "FORMAT")]
    log_format: LogFormat,
}

/// Validate a plan and print its time line
///
/// Also estimates the duration of the campaign.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm campaign check plan.toml")]
struct CheckCampaign {
    /// Read this plan
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
}

/// Show the progress of a campaign
///
/// Shows the progress of a running or interrupted campaign, and the results of fit, verification and installation.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm campaign status plan.toml --json")]
struct StatusCampaign {
    /// Read this plan
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// End a running campaign in the safe state
///
/// Stops the campaign and waits until the safe state is reached.
///
/// A file in the campaign's folder asks the runner to stop, which may run in another container. If no runner answers
/// within 5 s, this command sets the safe state itself.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm campaign stop plan.toml --timeout 300")]
struct StopCampaign {
    /// Read this plan
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
    /// Wait this long for the safe state [s]
    #[arg(long, value_name = "S", default_value = "120", value_parser = seconds)]
    timeout: Duration,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed: &f64| (1.0..=1e5).contains(speed));
    speed.ok_or_else(|| "give a number from 1 to 100000".to_owned())
}

impl CampaignCommand {
    /// Whether it writes a log.
    pub(crate) const fn logs(&self) -> bool {
        matches!(self.action, CampaignAction::Run(_))
    }

    pub(crate) fn run(self, domain: Domain) -> Result<(), Failure> {
        match self.action {
            CampaignAction::Run(run) => run.run(domain),
            CampaignAction::Check(check) => check.run(),
            CampaignAction::Status(status) => status.run(),
            CampaignAction::Stop(stop) => stop.run(),
        }
    }
}

impl RunCampaign {
    fn run(self, domain: Domain) -> Result<(), Failure> {
        logging::start(self.log_format);
        let require = joined(&self.require)?;
        let plan = Plan::load_to_run(&self.plan)?;
        if require.is_some() && plan.verify.is_none() {
            let message = format!("--require needs verification runs; give {} a [verify]", shown(&self.plan));
            return Err(Failure::new(Exit::Usage, message));
        }
        for warning in plan.warnings() {
            tracing::warn!("{warning}");
        }
        for finding in plan.findings() {
            tracing::warn!("[{}] {finding}", finding.name);
        }
        create_own_folder(&plan.output).map_err(|error| Failure::io("making", &plan.output, &error))?;
        // Before the first file in the folder: a refusal leaves none.
        journal::refuse_data_of_others(&plan.output)?;
        let _lock = CampaignLock::take(&plan.output)?;
        let ended = Arc::<AtomicUsize>::default();
        for signal in end_signals() {
            let registered = signal_hook::flag::register_usize(signal, Arc::clone(&ended), signal as usize);
            registered.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        control::watch_requests(&plan.output, &ended)?;
        let options = options(domain, Duration::ZERO);
        let left = journal::needs_safe_state(&plan.output);
        let runner = (|| {
            let (journal, history) = Journal::open(&plan)?;
            plan.write_campaign_file()?;
            let done = history.kept.len() == units(&plan) && history.safe;
            let runner = || Runner::new(&plan, (journal, &history), &options, self.speed, Surroundings::real(&ended));
            if done { Ok(None) } else { runner().map(|runner| Some(runner.with_other_device(self.other_device))) }
        })();
        let runner = runner.map_err(|failure| {
            let hint = "\nan earlier runner has left chamber and table as they are; `isotherm campaign stop` brings them into the safe state";
            let message = format!("{failure}{}", if left { hint } else { "" });
            Failure::new(failure.exit, message)
        })?;
        match runner {
            Some(runner) => runner.run()?,
            None => tracing::info!("all {} units are complete", units(&plan)),
        }
        let finished = if self.calibrate {
            let (mut journal, _) = Journal::open(&plan)?;
            let alignment = AlignmentChoice::of(self.alignment, self.no_alignment);
            let finish = Finish {
                require,
                alignment,
                lag: self.lag.unwrap_or_default(),
                accept: self.accept,
                strict: self.strict,
            };
            finish.run(&plan, &mut journal, &options.domain, &ended)
        } else {
            Ok(())
        };
        if !plan.is_batch() {
            return finished;
        }
        let dropped = dropped(&plan)?.into_iter();
        let dropped =
            dropped.map(|DroppedImu { imu, reason }| Failure::new(Exit::Failed, format!("{imu} is dropped {reason}")));
        Failure::all(dropped.chain(finished.err()).collect()).map_or(Ok(()), Err)
    }
}

/// What a batch's plan says of each IMU: one line each. Empty if there is only one IMU.
fn imus(plan: &Plan) -> String {
    let mut text = String::new();
    for plan in &plan.batch {
        let Some(Member { imu, serial, mounting }) = &plan.member else { continue };
        let serial = serial.as_ref().map_or_else(String::new, |serial| format!(", serial {serial}"));
        let rows = [0, 1, 2].map(|i| format!("[{}, {}, {}]", mounting[(i, 0)], mounting[(i, 1)], mounting[(i, 2)]));
        let install = plan.install.as_ref().map_or_else(String::new, |file| format!(", to install as {}", shown(file)));
        // Writing to a String cannot fail.
        let _ =
            writeln!(text, "  {imu}{serial}, mounting [{}], samples {}{install}", rows.join(", "), plan.samples_file());
    }
    text
}

impl CheckCampaign {
    fn run(self) -> Result<(), Failure> {
        let plan = Plan::load_to_run(&self.plan)?;
        let takes_s = left_s(&plan, 0);
        let mut text = format!("{}: campaign of {}, {}", shown(&self.plan), plan.names(), plan.size());
        // Writing to a String cannot fail.
        let _ = plan.verify.as_ref().map(|verify| {
            let s = if verify.runs == 1 { "" } else { "s" };
            write!(text, ", {} verification run{s}", verify.runs)
        });
        let _ = writeln!(text, "; about {}\n", duration(takes_s));
        if plan.is_batch() {
            let _ = writeln!(text, "{}", imus(&plan));
        }
        for milestone in milestones(&plan) {
            let _ = writeln!(text, "  {:>12}  {}", duration(milestone.at_s), milestone.event);
        }
        for warning in plan.warnings() {
            warn!("warning: {warning}");
        }
        for finding in plan.findings() {
            warn!("warning [{}]: {finding}", finding.name);
        }
        print(&text)
    }
}

impl StatusCampaign {
    fn run(self) -> Result<(), Failure> {
        let plan = Plan::load(&self.plan)?;
        let (runner, snapshot) = (runner_pid(&plan.output), snapshot(&plan.output)?);
        let pid = runner.as_ref().ok().copied().flatten();
        let outcome = outcome(&plan.output);
        let imus = if plan.is_batch() { outcomes(&plan) } else { Ok(Vec::new()) };
        let has_outcome = outcome.as_ref().is_ok_and(|outcome| outcome.fit.is_some());
        if snapshot.is_none() && !has_outcome {
            let message = format!("{}: no campaign has been run there", shown(&plan.output));
            return Err(Failure::new(Exit::Unavailable, message));
        }
        let died = matches!(runner, Ok(None)) && snapshot.as_ref().is_some_and(|snapshot| snapshot.ended.is_none());
        if self.json {
            let document = if plan.is_batch() {
                serde_json::json!({ "pid": pid, "campaign": snapshot, "imus": imus.as_ref().ok() })
            } else {
                serde_json::json!({ "pid": pid, "campaign": snapshot, "outcome": outcome.as_ref().ok() })
            };
            print_data(&format!("{document:#}\n"))?;
        } else {
            let state = match (pid, &snapshot) {
                (Some(pid), _) => format!("running, pid {pid}"),
                _ if runner.is_err() => "whether it runs cannot be seen".to_owned(),
                (None, Some(Snapshot { ended: Some(ended), .. })) => format!("ended: {ended}"),
                (None, Some(_)) => "NOT RUNNING".to_owned(),
                (None, None) => format!("not running; its {STATUS} is missing, or of another version"),
            };
            let line = snapshot.map_or_else(String::new, |snapshot| snapshot.line() + "\n");
            let outcome = if plan.is_batch() {
                imus.iter().flatten().map(ToString::to_string).collect()
            } else {
                outcome.as_ref().map_or_else(|_| String::new(), ToString::to_string)
            };
            print(&format!("{state}\n{line}{outcome}"))?;
        }
        // The state is printed even if the journal, or the lock of another user, cannot be read.
        outcome?;
        runner?;
        if died {
            let message = "its runner has died, chamber and table are as it left them; `isotherm campaign run` \
                           continues, `isotherm campaign stop` brings them into the safe state";
            return Err(Failure::new(Exit::Failed, message));
        }
        Ok(())
    }
}

impl StopCampaign {
    fn run(self) -> Result<(), Failure> {
        let plan = Plan::load(&self.plan)?;
        let stopped = control::stop(&plan.output, self.timeout)?;
        if let StopOutcome::Unknown(failure) = stopped {
            return Err(safe_in_spite(&plan, stop::STOPPED_WHATEVER_RUNS, &failure));
        }
        if journal::needs_safe_state(&plan.output) {
            return safe(&plan, matches!(stopped, StopOutcome::NoAnswer));
        }
        match stopped {
            StopOutcome::Ended | StopOutcome::Unknown(_) => {}
            StopOutcome::Nobody => {
                let message = format!("{}: no process runs this campaign", shown(&plan.output));
                return Err(Failure::new(Exit::Unavailable, message));
            }
            StopOutcome::NoAnswer => {
                let message = format!(
                    "{}: the instruments are in the safe state; its runner is asked to end, but has not answered yet",
                    shown(&plan.output)
                );
                return Err(Failure::new(Exit::Failed, message));
            }
        }
        let ended = snapshot(&plan.output)?.and_then(|snapshot| snapshot.ended);
        print(&(ended.unwrap_or_default() + "\n"))
    }
}

/// Brings chamber and table into the safe state: after a runner that ended without doing so, or while one does not
/// answer, whoever holds the lock.
fn safe(plan: &Plan, beside_runner: bool) -> Result<(), Failure> {
    let lock = if beside_runner { Ok(None) } else { CampaignLock::take(&plan.output).map(Some) };
    let _lock = lock.map_err(|failure| safe_in_spite(plan, stop::STOPPED_WHATEVER_RUNS, &failure))?;
    let reason = if beside_runner { stop::STOPPED_BESIDE_RUNNER } else { stop::STOPPED_WITHOUT_RUNNER };
    let (text, certain) = stop::make_safe(plan, Surroundings::default(), reason)?;
    if certain { print(&format!("{text}\n")) } else { Err(Failure::new(Exit::Unavailable, text)) }
}

/// Brings chamber and table into the safe state although something is wrong with the campaign's folder, where nothing
/// is noted. That is complained of afterwards.
fn safe_in_spite(plan: &Plan, reason: &str, failure: &Failure) -> Failure {
    let text = stop::make_safe_without_note(plan, Surroundings::default(), reason);
    Failure::new(failure.exit, format!("{text}\n{failure}"))
}
