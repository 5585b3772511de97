//! The description of a source: where the bytes come from, what they are, and what their numbers stand for.
//!
//! `examples/acquire` has one for each device that is known, `docs/acquire.md` says how to write one. All faults are
//! reported together, with line and key; unknown keys are faults.

mod columns;
mod frame;
mod identity;
mod iio;
mod line;
mod port;
mod timing;

pub(crate) use identity::{Identity, SerialNumberSource};
pub(crate) use port::{Peer, Port, Udp};
pub(crate) use timing::Timing;

use crate::dialogue::DialogueStep;
use crate::frames::Frame;
use crate::iio::IioSettings;
use crate::lines::Line;
use crate::message_queue::{MessageQueue, MessageStamps};
use crate::sample::Columns;
use columns::Names;
use isotherm_client::{ImuId, Realtime, device};
use isotherm_documents::{LoadError, read_text};
use isotherm_files::Trust;
use isotherm_recording_formats::convert::{SensorColumns, Temperature};
use isotherm_shared::document::{Document, Faults, Section};
use isotherm_support::failure::{Exit, Failure};
use std::num::NonZeroU64;
use std::path::Path;
use std::time::Duration;

/// The description of a source.
#[derive(Clone)]
pub struct Description {
    /// The IMU.
    pub imu: ImuId,
    /// Serial number of the device.
    pub serial: Option<String>,
    /// What the rows come from.
    pub(crate) kind: Kind,
    /// When the rows were sampled.
    pub(crate) timing: Timing,
    /// Whether its accelerometers feel gravity.
    pub(crate) has_gravity: bool,
    /// The places of the sensors in a row.
    pub(crate) columns: Columns,
    /// How the device says who it is.
    pub(crate) identity: Option<Identity>,
    /// How it is set up when the port was opened.
    pub(crate) setup: Vec<DialogueStep>,
    /// The names of the columns of a row.
    pub(crate) names: Vec<String>,
    /// The sensors, as the file has them.
    pub(crate) sensors: SensorColumns,
    /// Settings of the thread that receives and sends.
    pub(crate) realtime: Realtime,
    /// Whether that thread never sleeps.
    pub(crate) spin: bool,
    /// A device that is silent for this long is opened again; `None`: never.
    pub(crate) reopen_after: Option<Duration>,
}

/// What rows come from.
#[derive(Clone)]
pub(crate) enum Kind {
    /// Binary frames in a stream of bytes.
    Frames(Port, Box<Frame>),
    /// Lines of text in a stream of bytes.
    Lines(Port, Line),
    /// A buffer of Linux' Industrial I/O.
    Iio(IioSettings),
    /// Messages that another part of the program receives.
    Messages(MessageQueue, MessageStamps),
}

#[derive(Clone, Copy, Eq, PartialEq)]
enum KindName {
    Frames,
    Lines,
    Iio,
}

const KINDS: [(KindName, &str); 3] = [(KindName::Frames, "frames"), (KindName::Lines, "lines"), (KindName::Iio, "iio")];

impl Description {
    /// Reads the file of a description.
    ///
    /// # Errors
    /// If it cannot be read, and everything that is wrong with it.
    pub fn load(path: &Path, trust: Trust) -> Result<Self, LoadError> {
        let (text, _) = read_text(path, trust)?;
        Self::from_toml(&text).map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })
    }

    /// Reads the text of a description.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_acquire::Description;
    ///
    /// let text = include_str!("../../examples/acquire/stim300.toml");
    /// assert!(Description::from_toml(text)?.summary().contains("accelerometers and gyroscopes"));
    /// let faults = Description::from_toml(&text.replace("baud", "bauds")).err().ok_or("no such key")?;
    /// assert!(faults.to_string().contains("source.bauds: unknown key"));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub fn from_toml(text: &str) -> Result<Self, Faults> {
        let document = Document::parse_as(text, "give the description of the source")?;
        let root = document.root();
        let description = read(&document, &root);
        root.finish();
        document.finish(description)
    }

    /// Takes another device in the place of the file's: a serial line, a file, or an IIO device. A file of what a
    /// serial line has sent may take its place; `-` is stdin.
    ///
    /// # Errors
    /// If the source is a network address.
    pub fn set_device(&mut self, device: &Path) -> Result<(), Failure> {
        let port = match &mut self.kind {
            Kind::Frames(port, _) | Kind::Lines(port, _) => port,
            Kind::Iio(settings) => {
                settings.devices = vec![device.display().to_string()];
                return Ok(());
            }
            Kind::Messages(..) => {
                return Err(Failure::new(Exit::Usage, "messages have no device: leave --device out"));
            }
        };
        match port {
            _ if device == Path::new("-") => *port = Port::Stdin,
            Port::Serial(_) if device.is_file() => *port = Port::File { path: device.to_owned(), pace: false },
            Port::Serial(serial) => device.clone_into(&mut serial.path),
            Port::File { path, .. } => device.clone_into(path),
            Port::Tcp(_) | Port::Udp(_) | Port::Stdin => {
                let message = "--device takes the place of a serial line, a file or an IIO device; the source is a network address or \
                               stdin: change the description";
                return Err(Failure::new(Exit::Usage, message));
            }
        }
        Ok(())
    }

    /// Where the bytes come from; `None` for IIO and messages.
    pub(crate) const fn port(&self) -> Option<&Port> {
        match &self.kind {
            Kind::Frames(port, _) | Kind::Lines(port, _) => Some(port),
            Kind::Iio(_) | Kind::Messages(..) => None,
        }
    }

    /// Whether the source is a device, which may come back, and not a file or the standard input.
    pub(crate) const fn is_of_device(&self) -> bool {
        match self.port() {
            Some(port) => !matches!(port, Port::File { .. } | Port::Stdin),
            None => true,
        }
    }

    /// The exit code if what comes contradicts the description. Over a network anybody may have sent it, so the
    /// acquisition is worth another attempt.
    pub(crate) const fn contradiction(&self) -> Exit {
        match (&self.kind, self.port()) {
            (Kind::Messages(..), _) | (_, Some(Port::Tcp(_) | Port::Udp(_))) => Exit::Temporary,
            _ => Exit::Config,
        }
    }

    /// The names of the columns of a row; empty for lines without names.
    #[must_use]
    pub fn columns(&self) -> Vec<String> {
        self.names.clone()
    }

    /// One line for people.
    #[must_use]
    pub fn summary(&self) -> String {
        let rate = 1e9 / self.timing.interval_ns as f64;
        let sensors = if self.columns.gyroscope.is_some() { "accelerometers and gyroscopes" } else { "accelerometers" };
        let from = match &self.kind {
            Kind::Frames(port, _) => format!("frames from {port}"),
            Kind::Lines(port, _) => format!("lines from {port}"),
            Kind::Iio(settings) => format!("IIO, {}", settings.devices.join(" and ")),
            Kind::Messages(..) => "messages".to_owned(),
        };
        format!("source of {}: {from}, {sensors} at {rate} Hz", self.imu)
    }
}

fn read(document: &Document<'_>, root: &Section<'_, '_>) -> Option<Description> {
    root.fault_if(!root.has("format"), "format", "missing; give 1");
    root.optional_integer("format", 1..=1);
    let imu = root.imu_id("imu");
    let serial = root.optional_string("serial");
    root.refuse(
        "serial",
        serial.filter(|text| device(text) == 0).map(|_| "is empty; give it, or leave it out".to_owned()),
    );
    let has_gravity = root.optional_bool("gravity").unwrap_or(true);
    let source = root.section("source", "a section [source]")?;
    let kind = source.choice("kind", &KINDS);
    let port = if kind == Some(KindName::Iio) { None } else { port::read(&source) };
    let reopen_after = port.as_ref().and_then(|port| port::reopen_after(&source, port));
    source.finish();
    let kind = kind?;
    let (names, form) = match kind {
        KindName::Frames => {
            frame::read(root).map(|frame| (Names::of_fields(&frame.fields), Form::Frames(Box::new(frame))))
        }
        KindName::Lines => line::read(root).map(|(names, line)| (names, Form::Lines(line))),
        KindName::Iio => iio::read(root).map(|settings| (Names::channels(), Form::Iio(settings))),
    }
    .unzip();
    // Without columns the other sections are looked at all the same: all faults are reported together.
    let mut names = names.unwrap_or(Names::unknown(kind != KindName::Lines || has_names(root)));
    let named = names.are_named();
    let sensors = SensorColumns::read(document, root, named);
    let timing = timing::read(root, &mut names);
    let status = columns::status(root, &mut names);
    let (identity, setup) = identity::read(root, port.as_ref(), &mut names);
    let (realtime, spin) = realtime(root);
    let (sensors, timing) = (sensors?, timing?);
    let device = serial.map_or(0, device);
    let columns = columns::resolve(root, &sensors, &mut names, timing.interval_ns, status, device)?;
    let kind = match form? {
        Form::Frames(frame) => Kind::Frames(port?, frame),
        Form::Lines(line) => Kind::Lines(port?, Line { used: names.used(), ..line }),
        Form::Iio(settings) => Kind::Iio(complete(settings, &names, &sensors, timing.interval_ns)),
    };
    let names = names.of_row();
    Some(Description {
        imu: imu?,
        serial: serial.map(str::to_owned),
        kind,
        timing,
        has_gravity,
        columns,
        identity,
        setup,
        names,
        sensors,
        realtime,
        spin,
        reopen_after,
    })
}

/// What rows come from, but for the columns that are used.
enum Form {
    Frames(Box<Frame>),
    Lines(Line),
    Iio(IioSettings),
}

/// Whether lines seem to have named columns, in a description whose section of lines is wrong.
fn has_names(root: &Section<'_, '_>) -> bool {
    root.unchecked("lines").is_some_and(|lines| lines.has("names"))
}

/// The settings of IIO with the channels that the sections of the sensors name.
fn complete(settings: IioSettings, names: &Names, sensors: &SensorColumns, interval_ns: u64) -> IioSettings {
    let channels = names.names();
    let first = match &sensors.temperature {
        Temperature::Constant(_) => channels.len(),
        Temperature::Columns { .. } => 3 + if sensors.gyroscope.is_some() { 3 } else { 0 },
    };
    let (columns, temperature) = channels.split_at(first.min(channels.len()));
    IioSettings { columns: columns.to_vec(), temperature: temperature.to_vec(), interval_ns, ..settings }
}

/// The section `[realtime]`: the settings of the thread, and whether it spins.
fn realtime(root: &Section<'_, '_>) -> (Realtime, bool) {
    let Some(section) = root.optional_section("realtime") else { return (Realtime::default(), false) };
    let slack = section.optional_integer("timer_slack_ns", 1..=1_000_000_000);
    let settings = Realtime {
        core: section.optional_integer("core", 0..=1023).map(|core| core as usize),
        priority: section.optional_integer("priority", 1..=99).map(|priority| priority as i32),
        lock_memory: section.optional_bool("lock_memory").unwrap_or_default(),
        timer_slack_ns: slack.and_then(|slack| NonZeroU64::new(slack.cast_unsigned())),
    };
    let spin = section.optional_bool("spin").unwrap_or_default();
    section.finish();
    (settings, spin)
}
