//! Makes an IMU of a driver's topics.

use crate::network::Network;
use crate::output::lock;
use isotherm_acquire::{Description, MessageQueue, Notice, RunSettings, Tally, Target, run};
use isotherm_client::{ImuId, Options, UnixClock, monotonic_ns};
use isotherm_ros2::{
    IMU, InputCounts, InputGate, InputSettings, SensorImu, SensorTemperature, TEMPERATURE, TemperatureOrigin,
};
use isotherm_support::failure::{Exit, Failure, tell};
use ros2_client::Subscription;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

/// A driver that is an IMU.
pub(crate) struct Input {
    pub(crate) imu: ImuId,
    topics: Vec<(String, (&'static str, &'static str), Notice)>,
    gate: Arc<Mutex<InputGate>>,
    thread: Option<JoinHandle<Result<Tally, Failure>>>,
}

impl Input {
    /// Begins to subscribe and to acquire.
    ///
    /// # Errors
    /// If the network or the operating system refuses it.
    pub(crate) fn start(
        settings: &InputSettings,
        network: &mut Network,
        options: &Options,
        end: &Arc<AtomicBool>,
    ) -> Result<Self, Failure> {
        let imu = settings.samples.imu.clone();
        let gate = Arc::new(Mutex::new(InputGate::new(settings)));
        let queue = MessageQueue::default();
        let mut topics = vec![(settings.topic.clone(), IMU, Notice::default())];
        match &settings.temperature {
            TemperatureOrigin::Topic(topic) => {
                let subscription = network.subscription::<SensorTemperature>(topic, TEMPERATURE, settings.queue)?;
                topics.push((topic.clone(), TEMPERATURE, Notice::default()));
                let gate = Arc::clone(&gate);
                started("thermometer", move || take_temperatures(&subscription, &gate))?;
            }
            TemperatureOrigin::Constant(constant) => {
                tell(
                    "isotherm-ros2",
                    format!(
                        "{imu}: no thermometer: the temperature is taken to be {constant} degC, and nothing is compensated for it"
                    ),
                );
            }
        }
        let subscription = network.subscription::<SensorImu>(&settings.topic, IMU, settings.queue)?;
        let readings = Readings {
            topic: settings.topic.clone(),
            gate: Arc::clone(&gate),
            queue: queue.clone(),
            unix: UnixClock::new(),
            refused: Notice::default(),
            unread: Notice::default(),
        };
        started("input", move || readings.take(&subscription))?;
        let description = Description::of_messages(settings.samples.clone(), &queue);
        let run_settings = RunSettings {
            target: Target::Service(options.clone()),
            record: None,
            sysfs: Path::new("/").to_owned(),
            end: Arc::clone(end),
            tell: |tally| tell("isotherm-ros2", tally),
        };
        let thread = started("acquisition", move || run(&description, run_settings))?;
        Ok(Self { imu, topics, gate, thread: Some(thread) })
    }

    /// Whether the acquisition has ended by itself.
    pub(crate) fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Says if others use its topics under another type.
    pub(crate) fn look(&mut self, network: &Network) {
        for (topic, own, notice) in &mut self.topics {
            if let Some(other) = network.other_type(topic, *own) {
                let (package, message) = own;
                notice.tell(|| {
                    format!("warning: {topic} is of type {other} elsewhere, and {package}/{message} is asked for: nothing comes")
                });
            }
        }
    }

    /// What was counted.
    pub(crate) fn counts(&self) -> InputCounts {
        lock(&self.gate).counts
    }

    /// Waits for the end.
    ///
    /// # Errors
    /// What ended it.
    pub(crate) fn finish(&mut self) -> Result<(), Failure> {
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result.map(drop),
            Some(Err(_)) => Err(Failure::new(Exit::Failed, format!("the acquisition of {} has failed", self.imu))),
            None => Ok(()),
        }
    }
}

fn started<T: Send + 'static>(name: &str, body: impl FnOnce() -> T + Send + 'static) -> Result<JoinHandle<T>, Failure> {
    let thread = thread::Builder::new().name(name.to_owned()).spawn(body);
    thread.map_err(|error| Failure::new(Exit::Failed, format!("starting a thread: {error}")))
}

fn take_temperatures(subscription: &Subscription<SensorTemperature>, gate: &Mutex<InputGate>) {
    loop {
        match futures::executor::block_on(subscription.async_take()) {
            Ok((message, _)) => lock(gate).take_temperature(&message),
            Err(_) => lock(gate).counts.bad_temperatures += 1,
        }
    }
}

/// The thread that takes a driver's readings.
struct Readings {
    topic: String,
    gate: Arc<Mutex<InputGate>>,
    queue: MessageQueue,
    unix: UnixClock,
    refused: Notice,
    unread: Notice,
}

impl Readings {
    fn take(mut self, subscription: &Subscription<SensorImu>) {
        loop {
            let received = futures::executor::block_on(subscription.async_take());
            let arrived_ns = monotonic_ns();
            let topic = &self.topic;
            let message = match received {
                Ok((message, _)) => message,
                Err(error) => {
                    lock(&self.gate).counts.unreadable += 1;
                    self.unread.tell(|| format!("warning: {topic}: a message cannot be read: {error}"));
                    continue;
                }
            };
            self.unix.look();
            let mut gate = lock(&self.gate);
            match gate.take(&message, arrived_ns, self.unix.offset()) {
                Ok(message) if self.queue.push(message) => {}
                Ok(_) => gate.counts.overflow += 1,
                Err(why) => self.refused.tell(|| format!("warning: {topic}: a message {why}; it is not taken")),
            }
        }
    }
}
