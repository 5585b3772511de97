//! The source of rows: bytes through a decoder, the buffers of IIO, or messages.

use crate::description::{Description, Kind, Port};
use crate::frames::{DecodedFrame, FrameArrival};
use crate::identity::Recognition;
use crate::iio::{self, IioClock, IioFault, IioScale, IioSource};
use crate::intake::{Intake, RowArrival};
use crate::messages::Messages;
use crate::notice::Notice;
use crate::number::Value;
use crate::port::{OpenPort, PendingPort, PortRead, name_of, open_port, refused};
use crate::stream::StreamDecoder;
use isotherm_client::{RawSample, monotonic_ns};
use isotherm_support::failure::{Exit, Failure, tell};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Bytes that are read at once.
const BUFFER: usize = 1 << 16;
/// Reads before the caller gets its turn, on a line that never is silent.
const READS: usize = 16;

/// Outages that are reported one by one within a minute.
const TOLD: u32 = 10;

/// The source of rows.
pub(crate) enum Source {
    Bytes(Box<Bytes>),
    Iio(Box<Scans>),
    Messages(Messages),
}

/// What reading has brought.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum SourceState {
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
    opening: Option<PendingPort>,
    decoder: StreamDecoder,
    recognition: Recognition,
    buffer: Vec<u8>,
    /// When the line was last known to be empty \[ns\].
    empty_ns: u64,
    /// Of a file that is read at the rate of its frames: when that began \[ns\], its interval, and frames so far.
    pace: Option<(u64, u64, u64)>,
    losses: Notice,
    returns: Notice,
    /// Datagrams of others at sockets that are closed.
    strangers: u64,
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
    /// sent a sample since the machine was started. Then a device that cannot be opened is waited for.
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
        let has_device = !matches!(description.kind, Kind::Messages(..));
        if has_device && !matches!(description.port(), Some(Port::File { .. } | Port::Stdin)) {
            recognition.announce();
        }
        match &description.kind {
            Kind::Frames(port, _) | Kind::Lines(port, _) => Bytes::open(port, description, recognition, has_sent, end),
            Kind::Iio(settings) => {
                let open = unless_away(iio::open(&sysfs, settings).map_err(Failure::from), has_sent)?;
                open.iter().flat_map(IioSource::remarks).for_each(|remark| tell("isotherm", remark));
                let row = vec![Value::ABSENT; settings.columns.len() + settings.temperature.len()];
                let settings = settings.clone();
                let (polled_ns, empty_ns) = (None, monotonic_ns());
                Ok(Self::Iio(Box::new(Scans { root: sysfs, settings, open, row, polled_ns, empty_ns, unpaired: 0 })))
            }
            Kind::Messages(queue, stamps) => Ok(Self::Messages(Messages::new(queue, *stamps))),
        }
    }

    /// How long a byte takes on the line \[ns\].
    pub(crate) fn byte_ns(&self) -> f64 {
        match self {
            Self::Bytes(bytes) => match &bytes.port {
                Port::Serial(serial) => serial.character_s() * 1e9,
                _ => 0.0,
            },
            Self::Iio(_) | Self::Messages(_) => 0.0,
        }
    }

    /// Whether rows come when they were sampled, and not as fast as they are read.
    pub(crate) fn is_live(&self) -> bool {
        match self {
            Self::Bytes(bytes) => bytes.is_live(),
            Self::Iio(_) | Self::Messages(_) => true,
        }
    }

    /// Whether rows have a time of their own on the monotonic clock.
    pub(crate) fn is_stamped(&self) -> bool {
        match self {
            Self::Bytes(_) => false,
            Self::Iio(scans) => scans.open.as_ref().is_none_or(|open| *open.clock() == IioClock::Monotonic),
            Self::Messages(messages) => messages.is_stamped(),
        }
    }

    /// The scales of the sensors where the kernel gives them and the device is there.
    pub(crate) fn scales(&self) -> &[IioScale] {
        match self {
            Self::Iio(scans) => scans.open.as_ref().map_or(&[], IioSource::scales),
            Self::Bytes(_) | Self::Messages(_) => &[],
        }
    }

    /// Waits up to `longest` until there is something to read.
    pub(crate) fn wait(&self, longest: Duration) {
        if let Self::Messages(messages) = self {
            return messages.queue().wait(longest);
        }
        let Ok(longest) = Timespec::try_from(longest) else { return };
        // The result is not used: a read shows what there is.
        let _ = match self {
            Self::Bytes(bytes) => match &bytes.open {
                Some(open) => poll(&mut [PollFd::new(open, PollFlags::IN)], Some(&longest)),
                None => match &bytes.opening {
                    Some(opening) => poll(&mut [PollFd::new(opening, PollFlags::IN)], Some(&longest)),
                    None => poll(&mut [], Some(&longest)),
                },
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
            Self::Messages(_) => return,
        };
    }

    /// Whether the device is there.
    pub(crate) const fn is_there(&self) -> bool {
        match self {
            Self::Bytes(bytes) => bytes.open.is_some(),
            Self::Iio(scans) => scans.open.is_some(),
            Self::Messages(_) => true,
        }
    }

    /// Closes a device that is silent, to open it again.
    pub(crate) fn reopen(&mut self, why: &str, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) {
        match self {
            Self::Bytes(bytes) => {
                bytes.lose(why, intake, sink);
            }
            Self::Iio(_) | Self::Messages(_) => {}
        }
    }

    /// Reads what is there, without waiting, and gives each sample to `sink`.
    ///
    /// # Errors
    /// If the source cannot be read, and waiting would not help.
    pub(crate) fn read(
        &mut self,
        intake: &mut Intake,
        sink: &mut dyn FnMut(RawSample, u64),
    ) -> Result<SourceState, Failure> {
        match self {
            Self::Bytes(bytes) => bytes.read(intake, sink),
            Self::Iio(scans) => scans.read(intake, sink),
            Self::Messages(messages) => {
                messages.read(intake, sink);
                Ok(SourceState::Open)
            }
        }
    }

    /// Looks for a source that is away, and begins to open it if `may_begin`. May take seconds only for IIO.
    pub(crate) fn look(&mut self, may_begin: bool) {
        match self {
            Self::Bytes(bytes) => bytes.look(may_begin),
            Self::Iio(scans) if may_begin => {
                // Otherwise it is unplugged, or its driver is not there yet.
                if let Ok(open) = iio::open(&scans.root, &scans.settings) {
                    (scans.open, scans.empty_ns) = (Some(open), monotonic_ns());
                    tell("isotherm", format!("{} is back", scans.settings.devices.join(" and ")));
                }
            }
            Self::Iio(_) | Self::Messages(_) => {}
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
                let open = bytes.open.as_ref().map_or(0, OpenPort::strangers);
                intake.tally.strangers = bytes.strangers + open;
            }
            Self::Iio(scans) => {
                let open = scans.open.as_ref().map_or(0, |open| open.counters().unpaired);
                intake.tally.unpaired = scans.unpaired + open;
            }
            Self::Messages(_) => {}
        }
    }
}

impl Bytes {
    fn open(
        port: &Port,
        description: &Description,
        mut recognition: Recognition,
        waits: bool,
        end: &AtomicBool,
    ) -> Result<Source, Failure> {
        let none = || Failure::new(Exit::Config, "the source has no bytes");
        let decoder = StreamDecoder::new(description).ok_or_else(none)?;
        let open = unless_away(open_port(port, end), waits && !end.load(Ordering::Relaxed))?;
        if open.as_ref().is_some_and(OpenPort::is_heard) {
            recognition.begin();
        }
        let empty_ns = monotonic_ns();
        if open.is_some() {
            tell("isotherm", format!("reading {port}"));
        }
        let interval_ns = description.timing.interval_ns;
        let pace = matches!(port, Port::File { pace: true, .. }).then_some((empty_ns, interval_ns, 0));
        let buffer = vec![0; BUFFER];
        let port = port.clone();
        let (losses, returns) = (Notice::of(TOLD), Notice::of(TOLD));
        let opening = None;
        Ok(Source::Bytes(Box::new(Self {
            port,
            open,
            opening,
            decoder,
            recognition,
            buffer,
            empty_ns,
            pace,
            losses,
            returns,
            strangers: 0,
        })))
    }

    fn read(&mut self, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) -> Result<SourceState, Failure> {
        for _ in 0..READS {
            let is_live = self.is_live();
            let Some(open) = &mut self.open else { return Ok(SourceState::Away) };
            let before = monotonic_ns();
            // A file at the rate of its frames is read as far as they would have come.
            let due = self.pace.map(|(began, interval, frames)| (before.saturating_sub(began) / interval) > frames);
            if due == Some(false) {
                std::thread::sleep(Duration::from_micros(200));
                return Ok(SourceState::Open);
            }
            let room = if self.pace.is_some() { 64 } else { self.buffer.len() };
            let count = match open.read(&mut self.buffer[..room]) {
                Ok(PortRead::Bytes(count)) => count,
                Ok(PortRead::Nothing) => {
                    self.empty_ns = before;
                    self.recognition.hear(&[], &mut intake.tally, &mut |bytes| open.write(bytes))?;
                    return Ok(SourceState::Open);
                }
                Ok(PortRead::End) if matches!(self.port, Port::File { .. } | Port::Stdin) => {
                    return Ok(SourceState::Ended);
                }
                Ok(PortRead::End) => return Ok(self.lose("the other side closed it", intake, sink)),
                // A pipe or a file does not come back.
                Err(error) if matches!(self.port, Port::File { .. } | Port::Stdin) => {
                    return Err(refused(&self.port, &error));
                }
                Err(error) => return Ok(self.lose(&error.to_string(), intake, sink)),
            };
            // What comes while the device is asked and set up is not used.
            let heard = &self.buffer[..count];
            let begin = self.recognition.hear(heard, &mut intake.tally, &mut |bytes| open.write(bytes))?;
            intake.tally.bytes += (count - begin) as u64;
            let arrival = match open.received_ns() {
                Some(at) => FrameArrival { after_ns: at, by_ns: at },
                None => FrameArrival { after_ns: self.empty_ns, by_ns: monotonic_ns() },
            };
            let (mut frames, mut refused) = (0, Ok(()));
            let of_other = intake.tally.other_device;
            let recognition = &mut self.recognition;
            intake.signature = recognition.signature();
            let mut take = |found: DecodedFrame<'_>| {
                frames += 1;
                if refused.is_ok() {
                    refused = recognition.see(found.row, &mut intake.tally);
                }
                if refused.is_ok() {
                    intake.signature = recognition.signature();
                    intake.take(found.row, RowArrival::of(&found, is_live), sink);
                }
            };
            self.decoder.push(&self.buffer[begin..count], arrival, &mut take);
            refused?;
            if intake.tally.other_device > of_other {
                self.recognition.remind();
            }
            if let Some((.., passed)) = &mut self.pace {
                *passed += frames;
            }
            if !is_live {
                // The caller sends these first.
                return Ok(SourceState::Open);
            }
        }
        Ok(SourceState::Open)
    }

    const fn is_live(&self) -> bool {
        !matches!(self.port, Port::File { pace: false, .. })
    }

    fn lose(&mut self, why: &str, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) -> SourceState {
        let name = name_of(&self.port);
        self.losses.tell(|| format!("{name} went away: {why}; waiting for it to come back"));
        self.strangers += self.open.take().as_ref().map_or(0, OpenPort::strangers);
        self.decoder.end();
        intake.outage(sink);
        SourceState::Away
    }

    fn look(&mut self, may_begin: bool) {
        let Some(opening) = &self.opening else {
            if may_begin {
                self.opening = PendingPort::start(&self.port).ok();
            }
            return;
        };
        let Some((result, opened_ns)) = opening.poll() else { return };
        self.opening = None;
        if let Ok(open) = result {
            if open.is_heard() {
                self.recognition.begin();
            }
            (self.open, self.empty_ns) = (Some(open), opened_ns);
            let name = name_of(&self.port);
            self.returns.tell(|| format!("{name} is back"));
        }
    }
}

/// What was opened; nothing if it could not be, and is waited for.
fn unless_away<T>(opened: Result<T, Failure>, waits: bool) -> Result<Option<T>, Failure> {
    match opened {
        Ok(open) => Ok(Some(open)),
        Err(failure) if waits => {
            tell("isotherm", format!("{failure}; this IMU has sent before, so it is waited for"));
            Ok(None)
        }
        Err(failure) => Err(failure),
    }
}

impl Scans {
    fn read(&mut self, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) -> Result<SourceState, Failure> {
        let Some(open) = &mut self.open else { return Ok(SourceState::Away) };
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
            let arrival = Some(FrameArrival { after_ns: empty_ns, by_ns: now });
            intake.take(row, RowArrival { arrival, stamp, ..RowArrival::default() }, sink);
        });
        self.empty_ns = now;
        match read {
            Ok(()) => Ok(SourceState::Open),
            Err(error) if error.kind == IioFault::Gone || intake.goes_on() => {
                tell("isotherm", format!("{error}; waiting for it to come back"));
                self.unpaired += open.counters().unpaired;
                (self.open, self.polled_ns) = (None, None);
                intake.outage(sink);
                Ok(SourceState::Away)
            }
            Err(error) => Err(error.into()),
        }
    }
}
