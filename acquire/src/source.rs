//! The source of rows: bytes through a decoder, or the buffers of IIO.

use crate::description::{Description, Kind, Port};
use crate::frames::{Arrival, Found};
use crate::identity::Recognition;
use crate::iio::{self, IioClock, IioFault, IioSource};
use crate::intake::{Came, Intake};
use crate::number::Value;
use crate::port::{OpenPort, Opening, Read, name_of, open_port, refused};
use crate::stream::StreamDecoder;
use isotherm_client::{RawSample, monotonic_ns};
use isotherm_failure::{Exit, Failure, tell};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Bytes that are read at once.
const BUFFER: usize = 1 << 16;
/// Reads before the caller gets its turn, on a line that never is silent.
const READS: usize = 16;

/// The source of rows.
pub(crate) enum Source {
    Bytes(Box<Bytes>),
    Iio(Box<Scans>),
}

/// What reading has brought.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum State {
    /// The source goes on.
    Open,
    /// It is away, and looked for.
    Away,
    /// It has ended, as a file does.
    Ended,
}

/// A stream of bytes.
pub(crate) struct Bytes {
    port: Port,
    open: Option<OpenPort>,
    opening: Option<Opening>,
    decoder: StreamDecoder,
    recognition: Recognition,
    buffer: Vec<u8>,
    /// When the line was last known to be empty \[ns\].
    empty_ns: u64,
    /// Of a file that is read at the rate of its frames: when that began \[ns\], its interval, and frames so far.
    pace: Option<(u64, u64, u64)>,
}

/// The buffers of IIO.
pub(crate) struct Scans {
    root: PathBuf,
    settings: iio::IioSettings,
    open: Option<IioSource>,
    row: Vec<Value>,
    polled_ns: Option<u64>,
    empty_ns: u64,
    /// Scans without partner of sources that are closed.
    unpaired: u64,
}

impl Source {
    /// Opens the source of a description. `sysfs` is `/`, or the root of a tree for tests; `has_sent`: this IMU has
    /// sent a sample since the machine was started.
    ///
    /// # Errors
    /// If it cannot be opened. May take seconds.
    pub(crate) fn open(
        description: &Description,
        has_sent: bool,
        sysfs: PathBuf,
        end: &AtomicBool,
    ) -> Result<Self, Failure> {
        let recognition = Recognition::new(description, has_sent);
        if !matches!(description.port(), Some(Port::File { .. } | Port::Stdin)) {
            recognition.announce();
        }
        match &description.kind {
            Kind::Frames(port, _) | Kind::Lines(port, _) => Bytes::open(port, description, recognition, end),
            Kind::Iio(settings) => {
                let open = iio::open(&sysfs, settings)?;
                open.remarks().iter().for_each(|remark| tell("isotherm", remark));
                let row = vec![Value::ABSENT; settings.columns.len() + settings.temperature.len()];
                let settings = settings.clone();
                let (open, polled_ns, empty_ns) = (Some(open), None, monotonic_ns());
                Ok(Self::Iio(Box::new(Scans { root: sysfs, settings, open, row, polled_ns, empty_ns, unpaired: 0 })))
            }
        }
    }

    /// How long a byte takes on the line \[ns\].
    pub(crate) fn byte_ns(&self) -> f64 {
        match self {
            Self::Bytes(bytes) => match &bytes.port {
                Port::Serial(serial) => serial.character_s() * 1e9,
                _ => 0.0,
            },
            Self::Iio(_) => 0.0,
        }
    }

    /// Whether rows come when they were sampled, and not as fast as they are read.
    pub(crate) fn is_live(&self) -> bool {
        match self {
            Self::Bytes(bytes) => bytes.is_live(),
            Self::Iio(_) => true,
        }
    }

    /// Whether rows have a time of their own on the monotonic clock.
    pub(crate) fn is_stamped(&self) -> bool {
        match self {
            Self::Bytes(_) => false,
            Self::Iio(scans) => scans.open.as_ref().is_some_and(|open| *open.clock() == IioClock::Monotonic),
        }
    }

    /// Waits up to `longest` until there is something to read.
    pub(crate) fn wait(&self, longest: Duration) {
        let Ok(longest) = Timespec::try_from(longest) else { return };
        // The result is not used: a read tells what there is.
        let _ = match self {
            Self::Bytes(bytes) => match &bytes.open {
                Some(open) => poll(&mut [PollFd::new(open, PollFlags::IN)], Some(&longest)),
                None => poll(&mut [], Some(&longest)),
            },
            Self::Iio(scans) => match &scans.open {
                Some(open) => {
                    let mut all = open.descriptors().map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN));
                    match (all.next(), all.next()) {
                        (Some(first), Some(second)) => poll(&mut [first, second], Some(&longest)),
                        (Some(first), None) => poll(&mut [first], Some(&longest)),
                        _ => poll(&mut [], Some(&longest)),
                    }
                }
                None => poll(&mut [], Some(&longest)),
            },
        };
    }

    /// Reads what is there, without waiting, and gives each sample to `sink`.
    ///
    /// # Errors
    /// If the source cannot be read, and waiting would not help.
    pub(crate) fn read(&mut self, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) -> Result<State, Failure> {
        match self {
            Self::Bytes(bytes) => bytes.read(intake, sink),
            Self::Iio(scans) => scans.read(intake, sink),
        }
    }

    /// Looks for a source that is away. May take seconds only for IIO.
    pub(crate) fn look(&mut self) {
        match self {
            Self::Bytes(bytes) => bytes.look(),
            Self::Iio(scans) => {
                // Else it is unplugged, or its driver is not there yet.
                if let Ok(open) = iio::open(&scans.root, &scans.settings) {
                    (scans.open, scans.empty_ns) = (Some(open), monotonic_ns());
                    tell("isotherm", format!("{} is back", scans.settings.devices.join(" and ")));
                }
            }
        }
    }

    /// Ends the stream: what was begun is cut. Counts what is not frames so far.
    pub(crate) fn end(&mut self, intake: &mut Intake) {
        if let Self::Bytes(bytes) = self {
            bytes.decoder.end();
        }
        self.count(intake);
    }

    /// Brings the tally up to date.
    pub(crate) fn count(&self, intake: &mut Intake) {
        match self {
            Self::Bytes(bytes) => {
                intake.tally.skipped = *bytes.decoder.skipped();
            }
            Self::Iio(scans) => {
                let open = scans.open.as_ref().map_or(0, |open| open.counters().unpaired);
                intake.tally.unpaired = scans.unpaired + open;
            }
        }
    }
}

impl Bytes {
    fn open(
        port: &Port,
        description: &Description,
        mut recognition: Recognition,
        end: &AtomicBool,
    ) -> Result<Source, Failure> {
        let none = || Failure::new(Exit::Config, "the source has no bytes");
        let decoder = StreamDecoder::new(description).ok_or_else(none)?;
        let open = open_port(port, end)?;
        if open.is_heard() {
            recognition.begin();
        }
        let empty_ns = monotonic_ns();
        tell("isotherm", format!("reading {port}"));
        let interval_ns = description.timing.interval_ns;
        let pace = matches!(port, Port::File { pace: true, .. }).then_some((empty_ns, interval_ns, 0));
        let buffer = vec![0; BUFFER];
        let (port, open, opening) = (port.clone(), Some(open), None);
        Ok(Source::Bytes(Box::new(Self { port, open, opening, decoder, recognition, buffer, empty_ns, pace })))
    }

    fn read(&mut self, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) -> Result<State, Failure> {
        for _ in 0..READS {
            let is_live = self.is_live();
            let Some(open) = &mut self.open else { return Ok(State::Away) };
            let before = monotonic_ns();
            // A file at the rate of its frames is read as far as they would have come.
            let due = self.pace.map(|(began, interval, frames)| (before.saturating_sub(began) / interval) > frames);
            if due == Some(false) {
                std::thread::sleep(Duration::from_micros(200));
                return Ok(State::Open);
            }
            let most = if self.pace.is_some() { 64 } else { self.buffer.len() };
            let count = match open.read(&mut self.buffer[..most]) {
                Ok(Read::Bytes(count)) => count,
                Ok(Read::Nothing) => {
                    self.empty_ns = before;
                    self.recognition.hear(&[], &mut intake.tally, &mut |bytes| open.write(bytes))?;
                    return Ok(State::Open);
                }
                Ok(Read::End) if matches!(self.port, Port::File { .. } | Port::Stdin) => return Ok(State::Ended),
                Ok(Read::End) => return Ok(self.lose("the other side closed it", intake)),
                // A pipe or a file does not come back.
                Err(error) if matches!(self.port, Port::File { .. } | Port::Stdin) => {
                    return Err(refused(&self.port, &error));
                }
                Err(error) => return Ok(self.lose(&error.to_string(), intake)),
            };
            // What comes while the device is asked and set up is not used.
            let heard = &self.buffer[..count];
            let begin = self.recognition.hear(heard, &mut intake.tally, &mut |bytes| open.write(bytes))?;
            intake.tally.bytes += (count - begin) as u64;
            let arrival = Arrival { after_ns: self.empty_ns, by_ns: monotonic_ns() };
            let (mut frames, mut refused) = (0, Ok(()));
            let recognition = &mut self.recognition;
            let mut take = |found: Found<'_>| {
                frames += 1;
                if refused.is_ok() {
                    refused = recognition.see(found.row, &mut intake.tally);
                }
                if refused.is_ok()
                    && let Some((raw, session)) = intake.take(found.row, Came::of(&found, is_live))
                    && let Some(raw) = recognition.sign(raw, &mut intake.tally)
                {
                    sink(raw, session);
                }
            };
            self.decoder.push(&self.buffer[begin..count], arrival, &mut take);
            refused?;
            if let Some((.., passed)) = &mut self.pace {
                *passed += frames;
            }
            if !is_live {
                // The caller sends these first.
                return Ok(State::Open);
            }
            if count < most {
                // All that was there has been read.
                self.empty_ns = before;
                return Ok(State::Open);
            }
        }
        Ok(State::Open)
    }

    const fn is_live(&self) -> bool {
        !matches!(self.port, Port::File { pace: false, .. })
    }

    fn lose(&mut self, why: &str, intake: &mut Intake) -> State {
        tell("isotherm", format!("{} went away: {why}; waiting for it to come back", name_of(&self.port)));
        self.open = None;
        self.decoder.end();
        intake.outage();
        State::Away
    }

    fn look(&mut self) {
        let Some(opening) = &self.opening else {
            self.opening = Opening::start(&self.port).ok();
            return;
        };
        let Some(result) = opening.poll() else { return };
        self.opening = None;
        if let Ok(open) = result {
            if open.is_heard() {
                self.recognition.begin();
            }
            (self.open, self.empty_ns) = (Some(open), monotonic_ns());
            tell("isotherm", format!("{} is back", name_of(&self.port)));
        }
    }
}

impl Scans {
    fn read(&mut self, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) -> Result<State, Failure> {
        let Some(open) = &mut self.open else { return Ok(State::Away) };
        let now = monotonic_ns();
        let is_monotonic = *open.clock() == IioClock::Monotonic;
        let (row, polled_ns, empty_ns) = (&mut self.row, &mut self.polled_ns, self.empty_ns);
        let read = open.read(now, &mut |scan| {
            row.fill(Value::ABSENT);
            for (value, raw) in row.iter_mut().zip(scan.values) {
                *value = Value { number: *raw as f64, whole: Some(raw.cast_unsigned()) };
            }
            // A temperature that is polled counts when it is new.
            if scan.polled_ns.is_none() || scan.polled_ns != *polled_ns {
                *polled_ns = scan.polled_ns;
                for (value, temperature) in row.iter_mut().skip(scan.values.len()).zip(scan.temperatures) {
                    *value = Value::real(*temperature);
                }
            }
            let stamp = scan.timestamp_ns.filter(|_| is_monotonic).map(i64::cast_unsigned);
            let arrival = Some(Arrival { after_ns: empty_ns, by_ns: now });
            if let Some((raw, session)) = intake.take(row, Came { arrival, stamp, ..Came::default() }) {
                sink(raw, session);
            }
        });
        self.empty_ns = now;
        match read {
            Ok(()) => Ok(State::Open),
            Err(error) if error.kind == IioFault::Gone => {
                tell("isotherm", format!("{error}; waiting for it to come back"));
                self.unpaired += open.counters().unpaired;
                (self.open, self.polled_ns) = (None, None);
                intake.outage();
                Ok(State::Away)
            }
            Err(error) => Err(error.into()),
        }
    }
}
