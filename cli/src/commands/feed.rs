//! `feed`: sends a recording as an acquisition process does.

use super::common::options;
use clap::Args;
use isotherm_client::{
    Acquisition, CompensatedIncrement, ConnectError, Domain, Flags, ImuId, LagOption, Options, RawSample, StatusError,
    TimeConstant, device, fetch_status,
};
use isotherm_files::{Output, check_written, end_flag, refuse_overlap, sources};
use isotherm_offline::commands::common::{ForeignArgs, GyroscopeCheck, LagArgs, OfData, inputs};
use isotherm_offline::parse::seconds;
use isotherm_offline::progress::playing_bar;
use isotherm_pipeline::no_bar;
use isotherm_recording::{IncrementCsvWriter, IncrementLayout};
use isotherm_recording_formats::read::{ImuChoice, Samples};
use isotherm_shared::lag::ReadingLimits;
use isotherm_shared::status::ImuStatus;
use isotherm_shared::table::PulseScale;
use isotherm_support::failure::{Exit, Failure};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use tracing::info;

/// Longest single wait for an answer; signals and flushes are checked after each.
const PAUSE: Duration = Duration::from_millis(50);
/// How long connecting may take before a message says what is waited for. The place of a killed acquisition is free
/// sooner.
const PATIENCE: Duration = Duration::from_millis(300);

/// Send a recording through the running service
///
/// Sends a recording through the running service, as an acquisition process does.
///
/// If the service dies and returns, unanswered samples are sent again, and each increment is written once, in order. If
/// the command ends early, it writes no file.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm feed --imu imu-a run.csv -o increments.csv\n  isotherm feed --imu imu-a --rate 400 --window 1 run.csv > increments.csv"
)]
pub(crate) struct Feed {
    /// Send the samples of this IMU
    #[arg(long, value_name = "ID")]
    imu: ImuId,
    /// Send this recording of raw samples
    ///
    /// A recording of raw samples (CSV, MCAP) or third-party data, or the pieces of one recording in any
    /// order; - is stdin.
    ///
    /// If the recording has several IMUs, only the samples of --imu are sent
    #[arg(value_name = "RAW", required = true)]
    recording: Vec<PathBuf>,
    /// Set the serial number of the device
    ///
    /// The serial number of the device that the samples come from [default: the recording's column device]
    ///
    /// The service flags samples of a device that the table was not made for
    #[arg(long, value_name = "S/N", value_parser = serial)]
    serial: Option<String>,
    #[command(flatten)]
    lag: LagArgs,
    /// Write the increments to this file (CSV)
    ///
    /// - is stdout
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
    /// Send this many samples per second
    ///
    /// Default: as fast as the service answers.
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// Keep at most this many samples in flight
    ///
    /// Default: the depth of the service's queue.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    window: Option<u64>,
    /// Wait this long for a service [s]
    ///
    /// Applies if no service is running, or if it does not answer.
    #[arg(long, value_name = "S", default_value = "15", value_parser = seconds)]
    timeout: Duration,
    /// Add a column with the delivery flags
    #[arg(long)]
    delivery: bool,
    #[command(flatten)]
    foreign: ForeignArgs,
}

impl Feed {
    pub(crate) fn run(self, domain: Domain) -> Result<(), Failure> {
        let path = self.output.as_deref();
        let all: Vec<_> = inputs(&self.recording).into_iter().chain(self.foreign.inputs()).collect();
        refuse_overlap(&all, &[path])?;
        // No bar if the increments go to stdout, which may be the same terminal.
        let progress = if path.is_some() { playing_bar(&self.recording) } else { no_bar(&[], "") };
        let input = (ImuChoice::Prefer(self.imu.clone()), self.foreign.read()?);
        let mut samples = Samples::open(&sources(&self.recording)?, input, &progress)?;
        // The output is opened before anything is sent, so that the answers can be written.
        let sink = Output::create(path)
            .map_err(|error| Failure::io("writing", path.unwrap_or(Path::new("stdout")), &error))?;
        // The recording's lagged temperature is sent, so the library keeps none.
        let options = |timeout| Options { lag: LagOption::None, ..options(domain.clone(), timeout) };
        let acquisition = patiently(self.timeout, |timeout| Acquisition::connect(&self.imu, &options(timeout)))?;
        let served = ServedTable::ask(&self.imu, &options(self.timeout))?;
        samples.set_lag(self.lag.ns.unwrap_or(served.lag_ns));
        samples.set_limits(served.limits);
        samples.set_table(served.pulses);
        let layout = IncrementLayout { gyroscopes: served.gyroscopes, delivery: self.delivery };
        let writer = match IncrementCsvWriter::new(sink, layout) {
            Ok(writer) => writer,
            Err(error) => return check_written(path, Err(error)),
        };
        let window = self.window.map_or(acquisition.depth(), |window| acquisition.depth().min(window as usize));
        let (last_activity, interrupted) = (Instant::now(), end_flag());
        let mut feeder = Feeder {
            acquisition,
            writer,
            window,
            timeout: self.timeout,
            last_activity,
            flushed: last_activity,
            gyroscopes: layout.gyroscopes,
            interrupted,
            lag_unknown: None,
            lost_angles: false,
        };
        let result = self.play(&mut feeder, &mut samples, &served, &options);
        progress.finish();
        OfData::of(samples.recording()).tell();
        match result {
            Ok(()) => check_written(path, feeder.writer.finish().and_then(Output::finish)),
            Err(FeedError::Failed(failure)) => {
                // What stdout or a pipe has got so far is to be whole rows.
                let _ = feeder.writer.flush();
                Err(failure)
            }
            Err(FeedError::Write(error)) => check_written(path, Err(error)),
        }
    }

    /// Sends the samples, each session and each period as the recording has them, and receives all answers.
    fn play(
        &self,
        feeder: &mut Feeder,
        samples: &mut Samples,
        served: &ServedTable,
        options: &impl Fn(Duration) -> Options,
    ) -> Result<(), FeedError> {
        let period = self.rate.map(|rate| Duration::from_secs_f64(1.0 / rate));
        let (mut due, mut session, mut asked) = (Instant::now(), None, served.table);
        let device = self.serial.as_deref().map(device);
        let mut warning = GyroscopeCheck::new(served.gyroscopes);
        loop {
            // A reload has brought another time constant: a few samples more are flagged until the next one.
            if let (None, Some(table)) = (self.lag.ns, feeder.lag_unknown.take())
                && table != asked
                && let Ok(now) = ServedTable::fetch(&self.imu, &options(self.timeout))
            {
                asked = now.table;
                samples.set_lag(now.lag_ns);
                samples.set_limits(now.limits);
            }
            let Some(sample) = samples.next() else { break };
            let sample = match sample {
                Ok(sample) => sample,
                Err(error) => {
                    // Write the answers to what has been sent, as `replay` would.
                    feeder.drain()?;
                    return Err(error.into());
                }
            };
            if session.replace(sample.session).is_some_and(|session| session != sample.session) {
                feeder.drain()?;
                let begun = feeder.acquisition.begin_session();
                begun.map_err(|error| Failure::new(Exit::Failed, error.to_string()))?;
            }
            warning.check(&sample);
            if let Some(period) = period {
                feeder.receive_until(due)?;
                due += period;
            }
            feeder.send(&RawSample { device: device.unwrap_or(sample.device), ..sample })?;
        }
        feeder.drain()?;
        // The program that writes to our stdin may have got the same signal: this is not the whole recording then.
        feeder.check_interrupted()
    }
}

/// Connects within the time-out. If that takes long, says once what is waited for.
fn patiently<T>(
    timeout: Duration,
    mut connect: impl FnMut(Duration) -> Result<T, ConnectError>,
) -> Result<T, ConnectError> {
    let left = timeout.saturating_sub(PATIENCE);
    let cause = match connect(timeout.min(PATIENCE)) {
        Err(cause) if !left.is_zero() => cause,
        result => return result,
    };
    if cause.is_permanent() {
        return Err(cause);
    }
    match cause {
        ConnectError::Occupied { .. } | ConnectError::NoRoom { .. } | ConnectError::NoService(_) => {
            info!("waiting up to {} s: {cause}", timeout.as_secs_f64());
        }
        // So it looks while a service is starting.
        _ => {}
    }
    connect(left)
}

/// Why feeding ends early.
enum FeedError {
    Failed(Failure),
    Write(std::io::Error),
}

impl<T: Into<Failure>> From<T> for FeedError {
    fn from(error: T) -> Self {
        Self::Failed(error.into())
    }
}

/// The acquisition and the writer of its increments.
struct Feeder {
    acquisition: Acquisition,
    writer: IncrementCsvWriter<Output>,
    window: usize,
    timeout: Duration,
    /// When the last increment came, or the first unanswered sample was sent.
    last_activity: Instant,
    flushed: Instant,
    /// Whether the output has columns for angle increments.
    gyroscopes: bool,
    interrupted: Arc<AtomicBool>,
    /// The table of the last increment whose lagged temperature had another time constant than the table's.
    lag_unknown: Option<u64>,
    /// Whether angle increments have been left out, since the output has no columns for them.
    lost_angles: bool,
}

/// What the feed must know of the table that the service has in force.
struct ServedTable {
    /// The table's id; 0 without a table.
    table: u64,
    /// Time constant of the lagged temperature \[ns\]; 0 without one.
    lag_ns: u64,
    /// Which temperatures are readings; `None` without a table.
    limits: Option<ReadingLimits>,
    gyroscopes: bool,
    pulses: Option<PulseScale>,
}

impl ServedTable {
    /// Waits for the service's status, up to the time-out of the options.
    fn ask(imu: &ImuId, options: &Options) -> Result<Self, Failure> {
        let started = Instant::now();
        loop {
            match Self::fetch(imu, options) {
                Err(StatusError::Connect(error)) if error.is_permanent() => return Err(error.into()),
                Err(StatusError::Connect(_) | StatusError::Silent(_)) if started.elapsed() < options.timeout => {
                    thread::sleep(PAUSE);
                }
                result => return Ok(result?),
            }
        }
    }

    fn fetch(imu: &ImuId, options: &Options) -> Result<Self, StatusError> {
        let status = fetch_status(options)?;
        let imu = status.imus.into_iter().find(|served| served.id == imu.as_str());
        let lag = |imu: &ImuStatus| TimeConstant::from_seconds(imu.lag_s?).ok().map(TimeConstant::ns);
        Ok(Self {
            lag_ns: imu.as_ref().and_then(lag).unwrap_or(0),
            limits: imu.as_ref().and_then(ReadingLimits::of_status),
            gyroscopes: imu.as_ref().is_some_and(|imu| imu.gyroscopes.is_some()),
            table: imu.as_ref().map_or(0, ImuStatus::table_id),
            pulses: imu.as_ref().and_then(ImuStatus::pulse_scale),
        })
    }
}

impl Feeder {
    /// Looks at an increment for what a reload of the table has changed.
    fn note(&mut self, increment: &CompensatedIncrement) {
        if Flags(increment.flags).intersects(Flags::LAG_UNKNOWN) {
            self.lag_unknown = Some(increment.table);
        }
        if !self.gyroscopes && !self.lost_angles && increment.angle_increment.iter().any(|angle| angle.is_finite()) {
            self.lost_angles = true;
            let message =
                "warning: the table now has gyroscopes, which the output has no columns for; restart the feed";
            info!("{message}");
        }
    }

    fn send(&mut self, sample: &RawSample) -> Result<(), FeedError> {
        while self.acquisition.in_flight() >= self.window || self.acquisition.is_full() {
            self.receive(PAUSE)?;
        }
        let loan = self.acquisition.loan_record(sample)?;
        if self.acquisition.in_flight() == 0 {
            self.last_activity = Instant::now();
        }
        let sent = self.acquisition.send(loan);
        sent.map_err(|error| Failure::new(Exit::Failed, format!("sending sample {}: {error}", sample.sequence)).into())
    }

    fn drain(&mut self) -> Result<(), FeedError> {
        while self.acquisition.in_flight() > 0 {
            self.receive(PAUSE)?;
        }
        Ok(())
    }

    fn receive_until(&mut self, due: Instant) -> Result<(), FeedError> {
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if !self.receive(left.min(PAUSE))? && left.is_zero() {
                return Ok(());
            }
        }
    }

    /// Waits up to `timeout` for the next increment and writes it. Returns whether one came.
    fn receive(&mut self, timeout: Duration) -> Result<bool, FeedError> {
        let increment = self.acquisition.receive_timeout(timeout)?;
        let now = Instant::now();
        if let Some(increment) = &increment {
            self.last_activity = now;
            self.note(increment);
            self.writer.write(increment).map_err(FeedError::Write)?;
        } else if self.acquisition.in_flight() > 0 && now - self.last_activity > self.timeout {
            let message = format!(
                "no answer from the service for {} s, {} samples unanswered; start it again, or give it longer with --timeout",
                self.timeout.as_secs_f64(),
                self.acquisition.in_flight()
            );
            return Err(Failure::new(Exit::Unavailable, message).into());
        }
        // Flush, so that a program that reads the output gets what has come, and SIGKILL takes little of it.
        if now - self.flushed > PAUSE {
            self.writer.flush().map_err(FeedError::Write)?;
            self.flushed = now;
        }
        self.check_interrupted()?;
        Ok(increment.is_some())
    }

    fn check_interrupted(&self) -> Result<(), FeedError> {
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(Failure::new(Exit::Failed, "interrupted").into());
        }
        Ok(())
    }
}

/// A serial number. An empty one would turn the comparison with the table's unit off.
fn serial(text: &str) -> Result<String, String> {
    if device(text) == 0 {
        Err("give the device's serial number, or leave --serial out".to_owned())
    } else {
        Ok(text.to_owned())
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let rate: f64 = text.parse().map_err(|_| "give a number of samples per second".to_owned())?;
    if (1e-3..=1e6).contains(&rate) { Ok(rate) } else { Err("give a rate from 0.001 to 1000000 Hz".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_will_not_change_is_tried_once() {
        let (imu, domain): (ImuId, _) = ("imu-a".parse().unwrap(), "default".to_owned());
        let text = String::new;
        let errors: [(ConnectError, usize); 6] = [
            (ConnectError::Permission { domain: text(), root: text(), made_by: None }, 1),
            (ConnectError::Exhausted(text()), 1),
            (ConnectError::Occupied { imu: imu.clone(), pid: None }, 2),
            (ConnectError::NoService(text()), 2),
            (ConnectError::NoSuchImu { imu, domain }, 2),
            (ConnectError::Transport { phase: "opening the streams", cause: text() }, 2),
        ];
        for (error, expected) in errors {
            let mut tries = 0;
            let result: Result<(), _> = patiently(Duration::from_secs(1), |_| {
                tries += 1;
                Err(error.clone())
            });
            assert_eq!((result, tries), (Err(error), expected));
        }
    }
}
