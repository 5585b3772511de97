//! What is said of all: temperature and diagnostics to the network, counts to the log.

use crate::input::Input;
use crate::network::Network;
use crate::output::{Output, lock};
use isotherm_client::UnixClock;
use isotherm_documents::read_text;
use isotherm_files::Trust;
use isotherm_fit::TableFile;
use isotherm_ros2::{
    DIAGNOSTIC_ARRAY, DiagnosticArrayMessage, NodeDescription, QueueSettings, SensorTemperature, TEMPERATURE,
    TableErrors, TemperatureOutput, TimeMessage, diagnostics,
};
use isotherm_service::StatusSource;
use isotherm_shared::status::{ImuStatus, ServiceStatus};
use isotherm_support::failure::Failure;
use ros2_client::Publisher;
use std::path::Path;
use std::time::{Duration, Instant};
use tracing::{info, warn};

/// How often diagnostics are published, and counts are logged.
const PUBLISHED: Duration = Duration::from_secs(1);
const TOLD: Duration = Duration::from_secs(60);
const TOPIC: &str = "/diagnostics";
/// Where simulated time is, for those who follow it.
const CLOCK: &str = "/clock";
const QUEUE: QueueSettings = QueueSettings { is_reliable: true, depth: 10 };

/// Reads the status and says what there is to say.
pub(crate) struct Reporter {
    source: StatusSource,
    status: Option<ServiceStatus>,
    before: Option<ServiceStatus>,
    cause: String,
    unix: UnixClock,
    diagnostics: Option<Publisher<DiagnosticArrayMessage>>,
    imus: Vec<ImuReport>,
    /// Whether it was said that other nodes may be on simulated time.
    has_told_clock: bool,
    published: Instant,
    told: Instant,
}

/// What is said of one IMU.
struct ImuReport {
    imu: String,
    topic: String,
    /// `None` where nobody measures the temperature.
    thermometer: Option<Publisher<SensorTemperature>>,
    temperatures: TemperatureOutput,
    /// The table whose file was read, and what it says.
    table: Option<(String, Option<TableFile>)>,
    subscribers: usize,
}

impl Reporter {
    /// # Errors
    /// If the network refuses it.
    pub(crate) fn new(
        description: &NodeDescription,
        source: StatusSource,
        network: &mut Network,
    ) -> Result<Self, Failure> {
        let is_wanted = description.diagnostics;
        let diagnostics = is_wanted.then(|| network.publisher(TOPIC, DIAGNOSTIC_ARRAY, QUEUE)).transpose()?;
        let imus = description.outputs.iter().map(|output| {
            let topics = output.topics();
            let is_measured = output.assumed_temperature.is_none();
            let thermometer =
                is_measured.then(|| network.publisher(&topics.temperature, TEMPERATURE, output.queue)).transpose()?;
            Ok(ImuReport {
                imu: output.imu.to_string(),
                topic: topics.imu,
                thermometer,
                temperatures: TemperatureOutput::default(),
                table: None,
                subscribers: 0,
            })
        });
        let now = Instant::now();
        Ok(Self {
            imus: imus.collect::<Result<_, Failure>>()?,
            source,
            status: None,
            before: None,
            cause: String::new(),
            unix: UnixClock::new(),
            diagnostics,
            has_told_clock: false,
            published: now,
            told: now,
        })
    }

    /// Looks at all, and says what is due.
    pub(crate) fn turn(&mut self, outputs: &[Output], inputs: &mut [Input], network: &Network) {
        let now = Instant::now();
        if let Some(step_ns) = self.unix.look() {
            warn!("Unix time was set by {:+.6} s; the stamps follow it", step_ns as f64 / 1e9);
        }
        match self.source.poll(now) {
            (Some(status), _) => {
                if self.status.is_none() || !self.cause.is_empty() {
                    info!("the service is there");
                }
                self.cause.clear();
                self.publish_temperatures(&status, outputs);
                self.status = Some(status);
            }
            (None, Some(wait)) => {
                if wait.cause != self.cause {
                    warn!("waiting for the service: {}", wait.cause);
                    self.cause = wait.cause;
                }
                self.status = None;
            }
            (None, None) => {}
        }
        for imu in &mut self.imus {
            let subscribers = network.subscribers(&imu.topic);
            if subscribers != imu.subscribers {
                info!("{}: {subscribers} subscribers", imu.topic);
                imu.subscribers = subscribers;
            }
        }
        if now - self.published >= PUBLISHED {
            self.published = now;
            self.publish_diagnostics(outputs);
            inputs.iter_mut().for_each(|input| input.look(network));
            if !self.has_told_clock && network.has_topic(CLOCK) {
                self.has_told_clock = true;
                warn!(
                    "{CLOCK} is in this domain: other nodes may be on simulated time (use_sim_time), which this node does not \
                     follow; its stamps are of this machine's Unix time"
                );
            }
        }
        if now - self.told >= TOLD {
            self.told = now;
            self.tell(outputs, inputs);
        }
    }

    fn publish_temperatures(&mut self, status: &ServiceStatus, outputs: &[Output]) {
        let offset = self.unix.offset();
        for (report, output) in self.imus.iter_mut().zip(outputs) {
            let Some(imu) = status.imus.iter().find(|imu| imu.id == report.imu) else { continue };
            output.take_errors(report.errors(imu));
            let next = report.temperatures.next(imu, status.taken_ns);
            if let (Some((temperature, read_ns)), Some(thermometer)) = (next, &report.thermometer) {
                let stamp = TimeMessage::of_unix_ns(offset.unix_ns(read_ns)).unwrap_or_default();
                let message = lock(&output.composer).temperature(temperature, stamp);
                // The next one comes soon.
                let _ = thermometer.publish(message);
            }
        }
    }

    fn publish_diagnostics(&mut self, outputs: &[Output]) {
        let Some(publisher) = &self.diagnostics else { return };
        let reports: Vec<_> = outputs.iter().map(Output::report).collect();
        let offset = self.unix.offset();
        let stamp = TimeMessage::of_unix_ns(offset.unix_ns(isotherm_client::monotonic_ns())).unwrap_or_default();
        let array = diagnostics(self.status.as_ref(), self.before.as_ref(), &reports, offset, stamp);
        let _ = publisher.publish(array);
        self.before.clone_from(&self.status);
    }

    /// Logs what was counted.
    pub(crate) fn tell(&self, outputs: &[Output], inputs: &[Input]) {
        for report in outputs.iter().map(Output::report) {
            let counts = report.counts;
            info!(
                "{}: {} published, {} missing before, {} invalid, {} without a time, {} not taken by the network",
                report.imu, counts.published, counts.missing, counts.invalid, counts.untimed, counts.untaken
            );
        }
        for input in inputs {
            let counts = input.counts();
            info!(
                "{}: {} messages, {} of another frame, {} with an absurd stamp, {} unreadable, {} without room; {} \
                 temperatures, {} bad",
                input.imu,
                counts.messages,
                counts.other_frame,
                counts.absurd_stamp,
                counts.unreadable,
                counts.overflow,
                counts.temperatures,
                counts.bad_temperatures
            );
        }
    }
}

impl ImuReport {
    /// The errors that the table in force states, if its file can be read and is that table.
    fn errors(&mut self, imu: &ImuStatus) -> TableErrors {
        let Some(table) = &imu.table else { return TableErrors::default() };
        if self.table.as_ref().is_none_or(|(known, _)| known != table) {
            let path = Path::new(&imu.table_file);
            let text = read_text(path, Trust::Any).ok().map(|(text, _)| text);
            let file = text.and_then(|text| TableFile::from_toml(&*imu.table_file, &text).ok());
            let file = file.filter(|file| file.table.digest().to_string() == *table);
            self.table = Some((table.clone(), file));
        }
        let file = self.table.as_ref().and_then(|(_, file)| file.as_ref());
        file.map_or(TableErrors::default(), |file| TableErrors::of(file, imu))
    }
}
