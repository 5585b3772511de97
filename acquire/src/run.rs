//! The loop: one thread waits for the device, decodes, and sends.

use crate::description::Description;
use crate::intake::Intake;
use crate::link::Link;
use crate::note::AcquisitionNote;
use crate::note_writer::NoteWriter;
use crate::notice::Notice;
use crate::rate::Rate;
use crate::recorder::{Recorder, RecordingTarget};
use crate::sink::{PrintedRows, Sink};
use crate::source::{Source, SourceState};
use crate::tally::Tally;
use isotherm_client::{Domain, ImuId, Note, Options, monotonic_ns, unix_s};
use isotherm_support::failure::{Exit, Failure, shown, tell};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Longest wait for the device, so that the service's answers and the end are looked at.
const PAUSE: Duration = Duration::from_millis(20);
/// Longest wait while samples wait for room in the service's queue.
const BUSY: Duration = Duration::from_millis(1);
/// How often the tally is printed and written for the exporter, and how often the rate is checked.
const TOLD: Duration = Duration::from_secs(60);
const WRITTEN: Duration = Duration::from_secs(1);
const JUDGED: Duration = Duration::from_millis(500);
/// Pause between two looks for a device that is away.
const LOOK: Duration = Duration::from_millis(250);
/// A silence that is reported, and this many intervals.
const SILENT: Duration = Duration::from_secs(2);
const SILENT_INTERVALS: u32 = 10;
/// After this time without a frame a message reports once per minute what came instead.
const LONG: Duration = Duration::from_secs(10);

/// When a numbered file is full that nothing but its name asks for.
const NEVER: Duration = Duration::from_secs(3_000_000_000);

/// What to do where bytes are no frames.
const COMPARE: &str = "compare baud rate, sync, length and checksum with the device's setting; `isotherm acquire \
                       --probe` tries the profiles that are known";

/// Where samples go.
pub enum Target {
    /// To the service, with these options; a time-out of 0 waits for it for ever.
    Service(Options),
    /// To the standard output, as rows in CSV, so many at most.
    Rows(Option<u64>),
}

/// How an acquisition runs.
pub struct RunSettings {
    /// Where samples go.
    pub target: Target,
    /// Where all samples are recorded.
    pub record: Option<RecordingTarget>,
    /// Root of `/sys` and `/dev` for IIO: `/`, or a tree for tests.
    pub sysfs: PathBuf,
    /// Set to end the acquisition.
    pub end: Arc<AtomicBool>,
    /// Gets the tally once a minute and at the end.
    pub tell: fn(&Tally),
}

/// Acquires until the end is asked for, or the source ends. Returns what was counted.
///
/// The calling thread is the one that receives and sends: it gets the description's real-time settings.
///
/// # Errors
/// If the source cannot be opened or is not as described, or the service cannot be reached by waiting. The tally is
/// reported before.
pub fn run(description: &Description, settings: RunSettings) -> Result<Tally, Failure> {
    description.realtime.apply().map_err(|error| Failure::new(Exit::Config, format!("realtime: {error}")))?;
    let imu = description.imu.clone();
    // What a file has is of no time, and no successor goes on with it.
    let note = match &settings.target {
        Target::Service(options) if description.is_of_device() => Some(AcquisitionNote::load(&options.domain, &imu)),
        _ => None,
    };
    let has_sent = note.as_ref().is_some_and(AcquisitionNote::has_sent);
    let mut settings = settings;
    match &mut settings.record {
        // What ran before has recorded under this name, and nothing may end this one.
        Some(recording) if has_sent && Recorder::is_there(recording) => {
            recording.rotation.time = Some(NEVER);
            let path = shown(&recording.path);
            tell(
                "isotherm",
                format!(
                    "{path} has rows of before: the recording continues in a numbered file next to \
                it"
                ),
            );
        }
        recording => drop(recording.as_ref().map(Recorder::check).transpose()?),
    }
    let tally_note = match &settings.target {
        Target::Service(options) => Some(TallyNote::start(&options.domain, &imu)),
        Target::Rows(_) => None,
    };
    let source = Source::open(description, has_sent, settings.sysfs.clone(), &settings.end)?;
    // A source that cannot be opened leaves no file behind.
    let recorder =
        settings.record.as_ref().map(|recording| Recorder::create(recording, &description.imu)).transpose()?;
    let intake = Intake::new(description, source.byte_ns(), source.is_stamped());
    let intake = intake.with_scales(source.scales());
    let intake = intake.with_pulses(&settings.sysfs, source.is_live()).of_sender(has_sent);
    let sink = match settings.target {
        Target::Service(ref options) => {
            let pulses = Some(description.pulses(&settings.sysfs));
            let options = Options { serial: description.serial.clone(), pulses, ..options.clone() };
            let kept = source.is_live().then_some(description.timing.interval_ns);
            Sink::Service(Box::new(Link::new((imu, description.contradiction()), options, kept, note, recorder)))
        }
        Target::Rows(limit) => Sink::Rows(Box::new(PrintedRows::new(imu, limit, recorder)?)),
    };
    let now = Instant::now();
    let acquiring = AcquisitionLoop {
        description,
        settings,
        source,
        intake,
        sink,
        began: now,
        told: now,
        written: now,
        judged: now,
        looked: now,
        tally_note,
        heard: DeviceContact::new(now, Tally::default()),
        pace: Rate::default(),
    };
    acquiring.run()
}

struct AcquisitionLoop<'a> {
    description: &'a Description,
    settings: RunSettings,
    source: Source,
    intake: Intake,
    sink: Sink,
    began: Instant,
    told: Instant,
    written: Instant,
    tally_note: Option<TallyNote>,
    judged: Instant,
    looked: Instant,
    heard: DeviceContact,
    pace: Rate,
}

/// When something was last heard of the device.
struct DeviceContact {
    at: Instant,
    /// What had been counted then.
    tally: Tally,
    told: bool,
    /// What came instead of frames.
    instead: Notice,
    /// When the device was opened again, or heard.
    opened: Instant,
}

impl DeviceContact {
    fn new(at: Instant, tally: Tally) -> Self {
        Self { at, tally, told: false, instead: Notice::default(), opened: at }
    }
}

impl AcquisitionLoop<'_> {
    fn run(mut self) -> Result<Tally, Failure> {
        let result = self.acquire();
        let ended = self.finish();
        self.bring_up_to_date();
        (self.settings.tell)(&self.intake.tally);
        let failure = Failure::all([result.err(), ended.err()].into_iter().flatten().collect());
        if let Some(tally_note) = self.tally_note {
            tally_note.end(&self.intake.tally, failure.is_some());
        }
        failure.map_or(Ok(self.intake.tally), Err)
    }

    fn acquire(&mut self) -> Result<(), Failure> {
        loop {
            if self.settings.end.load(Ordering::Relaxed) {
                return Ok(());
            }
            let pause = match (self.description.spin, self.sink.is_waiting()) {
                (true, _) => Duration::ZERO,
                (false, true) => BUSY,
                (false, false) => PAUSE,
            };
            if self.source.is_live() || !self.sink.is_waiting() {
                self.source.wait(pause);
                let sink = &mut self.sink;
                let mut take = |raw, session| sink.take(raw, session);
                let state = self.source.read(&mut self.intake, &mut take)?;
                match state {
                    SourceState::Open => self.intake.look(monotonic_ns(), &mut take),
                    SourceState::Away => self.look(),
                    SourceState::Ended => {
                        self.intake.settle(&mut take);
                        return self.drain();
                    }
                }
            } else {
                std::thread::sleep(BUSY);
            }
            self.sink.note_soaked(self.intake.soaked);
            if self.sink.pump()? {
                return Ok(());
            }
            if let Some(pulse_ns) = self.sink.pulse_interval() {
                self.intake.set_pulse_interval(pulse_ns);
            }
            self.intake.has_sent |= self.sink.has_sent();
            self.look_around()?;
        }
    }

    fn look(&mut self) {
        let is_due = self.looked.elapsed() >= LOOK;
        self.source.look(is_due);
        if is_due {
            self.looked = Instant::now();
        }
    }

    /// What is to be done from time to time.
    fn look_around(&mut self) -> Result<(), Failure> {
        let now = Instant::now();
        if now - self.judged < JUDGED {
            return Ok(());
        }
        self.judged = now;
        self.intake.judge()?;
        self.listen(now);
        if now - self.told >= TOLD {
            self.told = now;
            self.bring_up_to_date();
            (self.settings.tell)(&self.intake.tally);
        }
        if now - self.written >= WRITTEN {
            self.written = now;
            self.bring_up_to_date();
            if let Some(tally_note) = &self.tally_note {
                tally_note.writer.write(&self.intake.tally.document());
            }
        }
        Ok(())
    }

    /// Reports if the device is silent, or babbles, and when it is heard again. Opens a silent one again.
    fn listen(&mut self, now: Instant) {
        self.source.count(&mut self.intake);
        let tally = &self.intake.tally;
        let heard = &mut self.heard;
        self.pace.note(now, tally.frames);
        if tally.frames != heard.tally.frames {
            if heard.told {
                tell("isotherm", "frames come");
            }
            self.intake.tally.last_frame_s = unix_s();
            *heard = DeviceContact::new(now, self.intake.tally.clone());
            return;
        }
        let interval = Duration::from_nanos(self.description.timing.interval_ns);
        let (passed, bytes) = (now - heard.at, tally.bytes - heard.tally.bytes);
        if passed < SILENT.max(interval * SILENT_INTERVALS) || !self.source.is_live() {
            return;
        }
        let seconds = passed.as_secs_f64();
        if !heard.told {
            heard.told = true;
            tell(
                "isotherm",
                match bytes {
                    0 => format!(
                        "warning: nothing has come for {seconds:.1} s: is the device on, connected, and set to send?"
                    ),
                    bytes => format!("warning: {bytes} bytes have come in {seconds:.1} s, and no frame: {COMPARE}"),
                },
            );
        }
        if passed >= LONG {
            let instead = tally.skipped.since(&heard.tally.skipped);
            heard.instead.tell(|| format!("warning: no frame for {seconds:.0} s; instead came {bytes} bytes{instead}"));
        }
        let is_due = |after: Duration| now - heard.opened >= after.max(interval * 2 * SILENT_INTERVALS);
        if bytes == 0 && self.source.is_there() && self.description.reopen_after.is_some_and(is_due) {
            heard.opened = now;
            let sink = &mut self.sink;
            let why = format!("silent for {seconds:.0} s, so it is opened again");
            self.source.reopen(&why, &mut self.intake, &mut |raw, session| sink.take(raw, session));
        }
    }

    /// Sends what a source that has ended has given, as long as the service takes it.
    ///
    /// # Errors
    /// If it had no frame at all.
    fn drain(&mut self) -> Result<(), Failure> {
        if self.intake.tally.frames == 0 {
            let message = format!("{} bytes, and no frame; {COMPARE}", self.intake.tally.bytes);
            return Err(Failure::new(Exit::Data, message));
        }
        while !self.settings.end.load(Ordering::Relaxed) {
            if self.sink.pump()? || !self.sink.is_waiting() {
                return Ok(());
            }
            std::thread::sleep(BUSY);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), Failure> {
        self.source.end(&mut self.intake);
        let sink = &mut self.sink;
        self.intake.settle(&mut |raw, session| sink.take(raw, session));
        self.sink.finish()
    }

    fn bring_up_to_date(&mut self) {
        self.source.count(&mut self.intake);
        self.intake.tally.seconds = self.began.elapsed().as_secs_f64();
        self.intake.tally.is_there = self.source.is_there();
        self.intake.tally.rate_hz = self.pace.hz();
        self.sink.count(&mut self.intake.tally);
    }
}

/// The tally in the domain's folder, for the exporter of metrics.
struct TallyNote {
    note: Note,
    writer: NoteWriter,
}

impl TallyNote {
    fn start(domain: &Domain, imu: &ImuId) -> Self {
        let note = Note::of_tally(domain, imu);
        let writer = NoteWriter::start(note.clone(), "the exporter has no metrics of this acquisition");
        Self { note, writer }
    }

    /// Leaves the last tally after a failure, so that the monitoring sees that the acquisition is gone, and nothing
    /// after an end that was asked for.
    fn end(self, tally: &Tally, has_failed: bool) {
        self.writer.write(&tally.document());
        self.writer.end();
        if !has_failed {
            self.note.remove();
        }
    }
}
