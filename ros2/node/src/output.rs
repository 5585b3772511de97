//! Publishes the increments of one IMU.

use crate::network::Network;
use isotherm_acquire::Notice;
use isotherm_client::{
    CompensatedIncrement, ConnectError, Flags, ImuId, IncrementReader, Options, UnixClock, monotonic_ns,
};
use isotherm_documents::read_text;
use isotherm_files::Trust;
use isotherm_ros2::{
    IMU, ImuComposer, NoiseDensities, OutputCounts, OutputReport, OutputSettings, SensorImu, StampClock, StampState,
    TableErrors, TimeMessage,
};
use isotherm_support::failure::{Exit, Failure, shown};
use ros2_client::Publisher;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Longest wait for an increment, so that the end is looked at.
const WAIT: Duration = Duration::from_millis(100);

/// An IMU that is published.
pub(crate) struct Output {
    pub(crate) settings: OutputSettings,
    pub(crate) composer: Arc<Mutex<ImuComposer>>,
    progress: Arc<Mutex<OutputReport>>,
    thread: Option<JoinHandle<Result<(), ConnectError>>>,
}

impl Output {
    /// Begins to publish.
    ///
    /// # Errors
    /// If the file of the noise cannot be read, or the network or the operating system refuses it.
    pub(crate) fn start(
        settings: &OutputSettings,
        network: &mut Network,
        options: &Options,
        end: &Arc<AtomicBool>,
    ) -> Result<Self, Failure> {
        let noise = settings.noise.as_ref().map(|path| {
            let (text, _) = read_text(path, Trust::Any)?;
            let refused = |fault: String| Failure::new(Exit::Config, format!("{}: {fault}", shown(path)));
            NoiseDensities::from_yaml(&text).map_err(refused)
        });
        let noise = noise.transpose()?.unwrap_or_default();
        let composer = Arc::new(Mutex::new(ImuComposer::new(settings, noise)));
        let publisher = network.publisher::<SensorImu>(&settings.topics().imu, IMU, settings.queue)?;
        let progress = Arc::new(Mutex::new(OutputReport {
            imu: settings.imu.clone(),
            counts: OutputCounts::default(),
            stamps: StampState::Unknown,
            uncertainty_ns: 0,
            assumed_temperature: settings.assumed_temperature,
        }));
        let publication = Publication {
            imu: settings.imu.clone(),
            publisher,
            composer: Arc::clone(&composer),
            stamps: StampClock::new(settings.has_other_clock),
            unix: UnixClock::new(),
            counts: OutputCounts::default(),
            progress: Arc::clone(&progress),
            refused: Notice::default(),
            untaken: Notice::default(),
            invalid: Notice::default(),
        };
        let (options, end) = (options.clone(), Arc::clone(end));
        let body = move || publication.run(&options, &end);
        let thread = thread::Builder::new().name("output".to_owned()).spawn(body);
        let thread = thread.map_err(|error| Failure::new(Exit::Failed, format!("starting a thread: {error}")))?;
        Ok(Self { settings: settings.clone(), composer, progress, thread: Some(thread) })
    }

    /// How it goes.
    pub(crate) fn report(&self) -> OutputReport {
        lock(&self.progress).clone()
    }

    /// Takes the errors of the table in force.
    pub(crate) fn take_errors(&self, errors: TableErrors) {
        lock(&self.composer).errors = errors;
    }

    /// Waits for the end.
    ///
    /// # Errors
    /// What ended it.
    pub(crate) fn finish(&mut self) -> Result<(), Failure> {
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => Ok(result?),
            Some(Err(_)) => Err(Failure::new(Exit::Failed, format!("publishing {} has failed", self.settings.imu))),
            None => Ok(()),
        }
    }
}

/// The thread that publishes.
struct Publication {
    imu: ImuId,
    publisher: Publisher<SensorImu>,
    composer: Arc<Mutex<ImuComposer>>,
    stamps: StampClock,
    unix: UnixClock,
    counts: OutputCounts,
    progress: Arc<Mutex<OutputReport>>,
    refused: Notice,
    untaken: Notice,
    invalid: Notice,
}

impl Publication {
    fn run(mut self, options: &Options, end: &AtomicBool) -> Result<(), ConnectError> {
        // Readers stay in their thread.
        let mut reader = IncrementReader::new(self.imu.clone(), options);
        loop {
            let is_last = end.load(Ordering::Relaxed);
            let wait = if is_last { Duration::ZERO } else { WAIT };
            match reader.receive_timeout(wait) {
                Ok(Some(increment)) => self.publish(&increment, reader.lost_before().unwrap_or(0)),
                Ok(None) if is_last => return Ok(()),
                Ok(None) => {}
                Err(_) if is_last => return Ok(()),
                Err(error) => {
                    // What does not go away by waiting is said, and looked at again.
                    let imu = &self.imu;
                    self.refused.tell(|| format!("warning: {imu}: {error}"));
                    thread::sleep(WAIT);
                }
            }
        }
    }

    fn publish(&mut self, increment: &CompensatedIncrement, missing: u64) {
        let arrived_ns = monotonic_ns();
        self.counts.missing = self.counts.missing.saturating_add(missing);
        // The offset is measured each time, so that no message follows a step late.
        self.unix.look();
        let offset = self.unix.offset();
        let steps = Flags(increment.flags).intersects(Flags::TIME_STEP);
        let unix_ns = self.stamps.unix_ns(increment.session, increment.timestamp_ns, arrived_ns, steps, offset);
        match unix_ns.and_then(TimeMessage::of_unix_ns) {
            Some(stamp) => self.publish_at(increment, stamp),
            None => {
                self.counts.untimed += 1;
                let (imu, state) = (&self.imu, self.stamps.state());
                self.refused.tell(|| match state {
                    StampState::Refused(delay_ns) => format!(
                        "warning: {imu}: timestamps are {:.1} s from now, so they are not of CLOCK_MONOTONIC, and nothing is \
                         published; give clock = \"other\" in a description",
                        delay_ns as f64 / 1e9
                    ),
                    _ => format!("warning: {imu}: timestamps cannot be put on Unix time, and nothing is published"),
                });
            }
        }
        let mut progress = lock(&self.progress);
        progress.counts = self.counts;
        progress.stamps = self.stamps.state();
        progress.uncertainty_ns = self.stamps.uncertainty_ns(offset);
    }

    fn publish_at(&mut self, increment: &CompensatedIncrement, stamp: TimeMessage) {
        let (message, is_whole) = lock(&self.composer).message(increment, stamp);
        if !is_whole {
            self.counts.invalid += 1;
            let (imu, flags) = (&self.imu, Flags(increment.flags));
            self.invalid.tell(|| format!("warning: {imu}: an increment is not whole: {flags}"));
        }
        let Some(message) = message else { return };
        match self.publisher.publish(message) {
            Ok(()) => self.counts.published += 1,
            Err(error) => {
                self.counts.untaken += 1;
                let imu = &self.imu;
                self.untaken.tell(|| format!("warning: {imu}: a message is not taken by the network: {error}"));
            }
        }
    }
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
