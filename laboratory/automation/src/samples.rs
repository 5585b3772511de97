//! The IMU's raw samples: tapped from the raw stream, assigned to a unit by their time, summed into rows, and written.
//!
//! # Which samples belong to a dwell
//! A sample belongs to a dwell if its whole interval lies after the turntable had settled and before the next motion is
//! commanded. Only the first condition needs a test: the motion is commanded after the last sample was received.
//!
//! A sample has the time of the acquisition's clock, a reading of the turntable that of the runner's. The sample of the
//! last minutes with the shortest time from its end to its sending gives the offset between the two clocks. Other
//! samples do not change the offset; therefore a sample that arrives late is not mistaken for one that was taken late.
//! After a start, an interruption or in another session all samples so far may have been late; therefore no unit begins
//! before the offset of every IMU is stable.
//!
//! # Turns
//! The samples of a turn are one unbroken run from the rest before to the rest after it. A missing sample would be a
//! missing angle; therefore a gap or a sample that cannot be used makes the turn useless, and all its rows are sums of
//! the same number of samples.
//!
//! Over 400 lines: tap, clock offset, recorder and row form one path of a sample, in this order.

use super::journal::Kept;
use super::machine::Unit;
use super::plan::{MAX_ROW_DEG, Plan};
use isotherm_campaign::implausible;
use isotherm_client::{Options, Realtime, Tap, TapSettings};
use isotherm_files::{Trust, read_text, replace};
use isotherm_fit::{HashingStream, implausible as gyroscopes_implausible};
use isotherm_instruments::{Moment, Time};
use isotherm_recording::{Layout, RawCsvWriter};
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample, StreamSample, Triad, device};
use isotherm_support::failure::{Exit, Failure, shown};
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, BufWriter, Read as _, Seek as _, SeekFrom};
use std::mem;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pause of the tap when the stream is empty: at 2 kHz, a sixth of the queue is filled meanwhile.
const TAP_PAUSE: Duration = Duration::from_millis(5);
/// Capacity of the queue between tap and runner \[samples\]. Further samples are lost and count as a gap.
const TAP_DEPTH: usize = 1 << 16;
/// Pause before a tap that an error has ended is started again.
const TAP_RETRY: Duration = Duration::from_millis(500);
/// Span of the clock offset's maximum: in laboratory time, and at least this in real time \[s\].
const OFFSET_SPAN_S: [f64; 2] = [300.0, 30.0];
/// The offset is stable if it has not risen for so long: in laboratory time, and at least this in real time \[s\].
const STABLE_S: [f64; 2] = [30.0, 3.0];
/// Rises up to this are none: in laboratory time, and at least this in real time \[s\].
const RISE_S: [f64; 2] = [0.1, 0.001];
/// Longest credible time from a sample's sending to its reception \[ns\]. Beyond it, the time of reception replaces
/// `sent_ns`.
const MAX_TRANSIT_NS: u64 = 10_000_000_000;

/// Largest credible step of the timestamp from one sample to the next \[ns\]: a day.
const MAX_STEP_NS: u64 = 86_400_000_000_000;

/// Length limit of a header that is read \[bytes\].
const MAX_HEADER: u64 = 4096;

/// Jitter of the intervals may make a row of a turn longer by this factor.
const ROW_DEG_MARGIN: f64 = 1.01;

/// Laboratory time: real time multiplied by the speed of a simulated laboratory.
#[derive(Clone)]
pub struct LaboratoryClock {
    time: Arc<dyn Time>,
    origin: Moment,
    /// Ratio of laboratory time to real time.
    pub speed: f64,
}

impl LaboratoryClock {
    /// A clock that begins at 0 now.
    pub fn new(time: Arc<dyn Time>, speed: f64) -> Self {
        Self { origin: time.now(), time, speed }
    }

    /// The present laboratory time \[s\].
    pub fn now(&self) -> f64 {
        self.at(self.time.now().ns())
    }

    /// The clocks behind it.
    pub fn time(&self) -> &dyn Time {
        self.time.as_ref()
    }

    /// The present Unix time \[s\].
    pub fn unix_s(&self) -> f64 {
        self.time.unix_s()
    }

    /// The laboratory time \[s\] at a time of `CLOCK_MONOTONIC` \[ns\].
    pub fn at(&self, ns: u64) -> f64 {
        (ns as f64 - self.origin.ns() as f64) / 1e9 * self.speed
    }
}

/// Where the raw samples of an IMU come from.
pub trait SampleSource {
    /// The next sample and the time of its reception, `CLOCK_MONOTONIC` \[ns\]; or the next error; `None` if there is
    /// neither.
    fn take_sample(&mut self) -> Option<Result<(RawSample, u64), String>>;
}

/// What starts the sources of samples.
pub trait SampleSources {
    /// Starts that of an IMU.
    ///
    /// # Errors
    /// If no thread can be started.
    fn start(&self, imu: &ImuId) -> io::Result<Box<dyn SampleSource>>;

    /// Where they come from, for messages: the service's domain.
    fn domain(&self) -> &str;
}

/// The raw streams of a service.
impl SampleSources for Options {
    fn start(&self, imu: &ImuId) -> io::Result<Box<dyn SampleSource>> {
        Ok(Box::new(SampleTap::start(imu.clone(), self.clone())?))
    }

    fn domain(&self) -> &str {
        self.domain.name()
    }
}

/// A tap on the IMU's raw stream for the whole campaign. Its errors are returned, and the tap is started again.
struct SampleTap {
    imu: ImuId,
    options: Options,
    tap: Tap,
    /// When a tap that an error has ended is started again; `None` while it runs.
    retry_at: Option<Instant>,
}

impl SampleTap {
    fn start(imu: ImuId, options: Options) -> io::Result<Self> {
        let tap = start_tap(&imu, &options)?;
        Ok(Self { imu, options, tap, retry_at: None })
    }
}

impl SampleSource for SampleTap {
    fn take_sample(&mut self) -> Option<Result<(RawSample, u64), String>> {
        while let Some(tapped) = self.tap.pop() {
            if let StreamSample::Raw(sample) = tapped.sample {
                return Some(Ok((sample, tapped.received_ns)));
            }
        }
        if let Some(warning) = self.tap.take_warning() {
            return Some(Err(warning));
        }
        if !self.tap.has_ended() {
            return None;
        }
        let now = Instant::now();
        match self.retry_at {
            Some(at) if now < at => None,
            Some(_) => {
                self.retry_at = None;
                match start_tap(&self.imu, &self.options) {
                    Ok(tap) => {
                        let ended = mem::replace(&mut self.tap, tap);
                        ended.finish().err().map(|error| Err(error.to_string()))
                    }
                    Err(error) => Some(Err(error.to_string())),
                }
            }
            None => {
                self.retry_at = Some(now + TAP_RETRY);
                None
            }
        }
    }
}

fn start_tap(imu: &ImuId, options: &Options) -> io::Result<Tap> {
    let settings = TapSettings { depth: TAP_DEPTH, pause: TAP_PAUSE, realtime: Realtime::default() };
    Tap::start(&[(imu.clone(), StreamKind::Raw)], options, settings)
}

/// Offset of the acquisition's clock from laboratory time \[s\]: the largest over the last one to two spans, which is
/// that of the sample with the least delay.
struct ClockOffset {
    speed: f64,
    /// When the present span began.
    began_at: f64,
    /// The largest offset of the present span, and of the one before.
    largest: [f64; 2],
    /// When the first sample and the last sample were sent.
    samples_at: Option<[f64; 2]>,
    /// The largest offset at its last rise, and when that was.
    risen: [f64; 2],
}

impl ClockOffset {
    const fn new(speed: f64) -> Self {
        let none = [f64::NEG_INFINITY; 2];
        Self { speed, began_at: f64::NEG_INFINITY, largest: none, samples_at: None, risen: none }
    }

    /// A time in laboratory time, and at least in real time \[s\].
    fn span(&self, [laboratory_s, real_s]: [f64; 2]) -> f64 {
        laboratory_s.max(real_s * self.speed)
    }

    fn add(&mut self, at: f64, offset: f64) {
        if at - self.began_at > self.span(OFFSET_SPAN_S) {
            self.began_at = at;
            self.largest = [f64::NEG_INFINITY, self.largest[0]];
        }
        self.largest[0] = self.largest[0].max(offset);
        self.samples_at = Some([self.samples_at.map_or(at, |[first, _]| first), at]);
        if self.largest() > self.risen[0] + self.span(RISE_S) {
            self.risen = [self.largest(), at];
        }
    }

    fn largest(&self) -> f64 {
        self.largest[0].max(self.largest[1])
    }

    /// Whether the offset has not risen for a while, or is known for its whole span: clocks may drift.
    fn is_stable(&self) -> bool {
        self.samples_at.is_some_and(|[first, last]| {
            last - self.risen[1] >= self.span(STABLE_S) || last - first >= self.span(OFFSET_SPAN_S)
        })
    }
}

/// The name of the file of a unit's samples of the IMU of `plan`.
pub fn file_of(unit: Unit, plan: &Plan) -> String {
    match unit {
        Unit::Dwell { .. } | Unit::Turn { .. } => plan.samples_file(),
        Unit::Ramp(ramp) => plan.ramp_file(ramp),
        Unit::Run(run) => plan.run_file(run),
    }
}

/// Decides which samples are used, and writes those of the unit in progress.
pub struct SampleRecorder<'p> {
    plan: &'p Plan,
    clock: LaboratoryClock,
    /// End \[ns\], session and shift \[ns\] of the last kept unit.
    previous: Option<(u64, u64, u64)>,
    /// Age of the last kept unit at laboratory time 0 \[s\]; negative if it was kept later.
    previous_age_s: f64,
    /// The last usable sample.
    last: Option<RawSample>,
    /// Added to the timestamps of the present session \[ns\].
    shift_ns: u64,
    /// Laboratory time of the last usable sample \[s\].
    usable_at: Option<f64>,
    offset: ClockOffset,
    open: Option<OpenUnit>,
    /// Whether samples of another unit than the plan's are taken.
    takes_other_device: bool,
    /// Whether a sample has had gyroscopes.
    has_gyroscopes: bool,
}

/// The file of a unit, buffered, with the hash of what is written.
type Sink = HashingStream<BufWriter<File>>;

/// The unit in progress.
struct OpenUnit {
    unit: Unit,
    /// Laboratory time after which samples belong to the unit \[s\].
    since: f64,
    /// Where the unit begins in its file \[bytes\].
    from: u64,
    sink: RawCsvWriter<Sink>,
    row: Option<RowSum>,
    /// Samples of a row of a turn; `None` before its first row.
    row_samples: Option<u32>,
    /// Number of rows written.
    rows: u64,
    /// Counted time: the sum of the rows' intervals \[ns\].
    counted_ns: u64,
    /// The session of the first sample; `None` before it.
    session: Option<u64>,
    /// End of the last row, as written \[ns\].
    end_ns: u64,
    gaps: u64,
    left_out: u64,
    /// Why the unit cannot be used.
    spoiled: Option<String>,
}

impl<'p> SampleRecorder<'p> {
    /// Goes on after `previous`, the last kept unit, which was kept `previous_age_s` of laboratory time ago.
    pub fn new(plan: &'p Plan, clock: LaboratoryClock, previous: Option<&Kept>, previous_age_s: f64) -> Self {
        Self {
            plan,
            offset: ClockOffset::new(clock.speed),
            clock,
            previous: previous.map(|kept| (kept.end_ns, kept.session, kept.shift_ns)),
            previous_age_s,
            last: None,
            shift_ns: 0,
            usable_at: None,
            open: None,
            takes_other_device: false,
            has_gyroscopes: false,
        }
    }

    /// Takes samples of another unit than the plan's, if `takes`.
    #[must_use]
    pub fn with_other_device(self, takes: bool) -> Self {
        Self { takes_other_device: takes, ..self }
    }

    /// Laboratory time of the last usable sample \[s\].
    pub const fn usable_at(&self) -> Option<f64> {
        self.usable_at
    }

    /// Whether the times of samples and turntable can be compared: a unit may begin.
    pub fn knows_clock(&self) -> bool {
        self.offset.is_stable()
    }

    /// Counted time of the unit in progress \[s\].
    pub fn collected_s(&self) -> f64 {
        self.open.as_ref().map_or(0.0, |open| open.counted_ns as f64 / 1e9)
    }

    /// Whether the counted time is enough for a dwell. It may be short by half a row, which is nearer than another row.
    pub fn complete(&self) -> bool {
        self.open.as_ref().is_some_and(|open| {
            let row = open.counted_ns as f64 / open.rows.max(1) as f64;
            open.rows > 0 && open.counted_ns as f64 + 0.5 * row >= self.plan.dwell.time_s * 1e9
        })
    }

    /// Why the unit in progress cannot be used.
    pub fn spoiled(&self) -> Option<&str> {
        self.open.as_ref()?.spoiled.as_deref()
    }

    /// Takes the next sample, received at `received_ns` of `CLOCK_MONOTONIC`. Returns whether it is usable.
    ///
    /// # Errors
    /// If a row cannot be written, or if it is a sample of another unit, or of an IMU without the gyroscopes that are
    /// to be calibrated.
    pub fn take(&mut self, sample: &RawSample, received_ns: u64) -> Result<bool, Failure> {
        self.check_imu(sample)?;
        let sent_ns = sample.sent_ns;
        let plausible = sent_ns <= received_ns && received_ns - sent_ns < MAX_TRANSIT_NS;
        let sent_at = self.clock.at(if plausible { sent_ns } else { received_ns });
        let new_session = self.last.is_none_or(|last| last.session != sample.session);
        if new_session {
            self.offset = ClockOffset::new(self.clock.speed);
            self.shift_ns = self.shift(sample);
            if let Some(open) = self.open.as_mut().filter(|open| open.session.is_some()) {
                open.spoiled = Some("the acquisition was started anew".to_owned());
            }
        }
        let last = self.last.filter(|_| !new_session);
        if self.unusable(sample, last.as_ref()) {
            if let Some(open) = &mut self.open {
                open.left_out += 1;
                open.miss_in_turn("a sample cannot be used: its time, a counter or its telemetry");
            }
            return Ok(false);
        }
        let gap = last.is_some_and(|last| sample.sequence != last.sequence.wrapping_add(1));
        self.last = Some(*sample);
        self.usable_at = Some(sent_at);
        self.offset.add(sent_at, sample.timestamp_ns as f64 / 1e9 - sent_at);
        self.add(sample, gap)?;
        Ok(true)
    }

    /// Checks that a sample is of the plan's unit, and that it has gyroscopes if they are calibrated.
    fn check_imu(&mut self, sample: &RawSample) -> Result<(), Failure> {
        let imu = &self.plan.imu;
        let serial = self.plan.campaign.serial.as_deref().unwrap_or_default();
        let (planned, found) = (device(serial), sample.device);
        if !self.takes_other_device && planned != 0 && found != 0 && found != planned {
            let message = format!(
                "the samples of {imu} are of another unit, device {found:016x}, than serial = {serial:?} of the plan; mount that unit, correct the \
                 serial number, or give --other-device"
            );
            return Err(Failure::new(Exit::Data, message));
        }
        self.has_gyroscopes |= Layout::of(&StreamSample::Raw(*sample)).gyroscopes;
        if !self.plan.turns.is_empty() && !self.has_gyroscopes {
            let message = format!(
                "the samples of {imu} have no gyroscopes, but the plan takes turns to calibrate them; let the acquisition send them, or leave \
                 [turns] out of the plan to calibrate the accelerometers alone"
            );
            return Err(Failure::new(Exit::Data, message));
        }
        Ok(())
    }

    /// The shift of a new session's timestamps that makes them follow those already written \[ns\].
    fn shift(&self, sample: &RawSample) -> u64 {
        let begin = sample.timestamp_ns.saturating_sub(sample.interval_ns);
        match self.previous {
            Some((_, session, shift_ns)) if session == sample.session => shift_ns,
            Some((end_ns, ..)) if begin < end_ns => {
                let away_ns = ((self.previous_age_s + self.clock.now()).max(0.0) * 1e9) as u64;
                end_ns.saturating_add(away_ns) - begin
            }
            _ => 0,
        }
    }

    /// Whether a sample is left out: `calibrate` would refuse it, its time is wrong, or its telemetry is stale.
    fn unusable(&self, sample: &RawSample, last: Option<&RawSample>) -> bool {
        let RawSample { timestamp_ns, interval_ns, .. } = *sample;
        let previous_ns = last.map(|last| last.timestamp_ns);
        let far_ahead = previous_ns.is_some_and(|previous_ns| timestamp_ns.saturating_sub(previous_ns) > MAX_STEP_NS);
        let stale = self.plan.campaign.max_age_s.is_some_and(|most| sample.telemetry_age_s() > most);
        let gyroscopes = !self.plan.turns.is_empty() && gyroscopes_implausible(&sample.gyroscopes.or_zero()).is_some();
        implausible(sample, previous_ns).is_some() || gyroscopes || timestamp_ns < interval_ns || far_ahead || stale
    }

    /// Adds a usable sample to the unit in progress if it belongs to it, and writes the row that it completes.
    fn add(&mut self, sample: &RawSample, gap: bool) -> Result<(), Failure> {
        let complete = self.complete();
        let Some(open) = &mut self.open else { return Ok(()) };
        if complete && matches!(open.unit, Unit::Dwell { .. }) || open.spoiled.is_some() {
            return Ok(());
        }
        if open.session.is_none() {
            let begin_s = (sample.timestamp_ns - sample.interval_ns) as f64 / 1e9;
            if begin_s < open.since + self.offset.largest() {
                return Ok(());
            }
            open.session = Some(sample.session);
        } else if gap {
            open.gaps += 1;
            open.miss_in_turn("samples are missing");
        }
        let is_turn = matches!(open.unit, Unit::Turn { .. });
        let row_s = if is_turn { self.plan.turn.row_s } else { self.plan.dwell.row_s };
        let row = match open.row.take() {
            None => RowSum::new(sample),
            Some(row) => row.with(sample),
        };
        let is_full = match open.row_samples {
            Some(samples) => row.count >= samples,
            None => row.sum.interval_ns + sample.interval_ns / 2 >= (row_s * 1e9) as u64,
        };
        if !is_full && row.has_room() {
            open.row = Some(row);
            return Ok(());
        }
        if is_turn {
            open.row_samples = Some(row.count);
            if let Some(reason) = unfit_for_turn(&row, is_full, self.plan.turn.rate_deg_s) {
                open.spoiled.get_or_insert(reason);
            }
        }
        let mut written = row.mean();
        written.timestamp_ns = written.timestamp_ns.saturating_add(self.shift_ns);
        if written.telemetry_ns > 0 {
            written.telemetry_ns = written.telemetry_ns.saturating_add(self.shift_ns);
        }
        open.rows += 1;
        open.counted_ns += written.interval_ns;
        open.end_ns = written.timestamp_ns;
        let leading = match open.unit {
            Unit::Dwell { visit, position } => {
                format!(
                    "{},{},{}",
                    self.plan.set_points_c[visit], self.plan.positions[position].number, written.session
                )
            }
            Unit::Turn { visit, turn } => {
                format!("{},{},{}", self.plan.set_points_c[visit], self.plan.turns[turn].number, written.session)
            }
            Unit::Ramp(_) | Unit::Run(_) => written.session.to_string(),
        };
        let file = file_of(open.unit, self.plan);
        open.sink.write(leading, &written).map_err(|error| self.failed("writing", &file, &error))
    }

    fn failed(&self, phase: &str, file: &str, error: &io::Error) -> Failure {
        Failure::io(phase, &self.plan.output.join(file), error)
    }

    /// Begins a unit: samples that begin after the laboratory time `since` belong to it. `kept` is the length of the
    /// kept part of its file \[bytes\].
    ///
    /// # Errors
    /// If its file cannot be opened.
    pub fn begin(&mut self, unit: Unit, since: f64, kept: u64) -> Result<(), Failure> {
        let name = file_of(unit, self.plan);
        let sink = self.sink(unit, &name, kept).map_err(|error| self.failed("opening", &name, &error))?;
        self.open = Some(OpenUnit {
            unit,
            since,
            from: kept,
            sink,
            row: None,
            row_samples: None,
            rows: 0,
            counted_ns: 0,
            session: None,
            end_ns: 0,
            gaps: 0,
            left_out: 0,
            spoiled: None,
        });
        Ok(())
    }

    fn sink(&self, unit: Unit, name: &str, kept: u64) -> io::Result<RawCsvWriter<Sink>> {
        let path = self.plan.output.join(name);
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        // Remove everything that the journal does not list.
        file.set_len(kept)?;
        let layout = if kept == 0 { self.layout() } else { layout_of(&file)? };
        file.seek(SeekFrom::Start(kept))?;
        let sink = HashingStream::new(BufWriter::new(file));
        let leading = if unit.has_own_file() { "session" } else { "set_point_c,position,session" };
        if kept == 0 {
            RawCsvWriter::with_layout(sink, leading, true, layout)
        } else {
            Ok(RawCsvWriter::resume_with_layout(sink, true, true, layout))
        }
    }

    /// The columns of a new file: the gyroscopes' if they are calibrated, the device's if the samples tell it.
    fn layout(&self) -> Layout {
        let device = self.last.is_some_and(|last| last.device != 0);
        Layout { device, gyroscopes: !self.plan.turns.is_empty(), lag: false }
    }

    /// Forgets the last sample and the clock offset, after an interruption: one sample with a wrong time must not make
    /// all later ones unusable.
    pub fn reset_timing(&mut self) {
        self.last = None;
        self.offset = ClockOffset::new(self.clock.speed);
    }

    /// Discards the unit in progress.
    pub fn discard(&mut self) {
        if let Some(open) = self.open.take() {
            let path = self.plan.output.join(file_of(open.unit, self.plan));
            let from = open.from;
            // Dropping the sink flushes its buffer: before the file is truncated, not after it.
            drop(open.sink);
            // A failure is ignored: the next unit of the file truncates it again.
            let _ = OpenOptions::new().write(true).open(path).and_then(|file| file.set_len(from));
        }
    }

    /// Completes the unit in progress and syncs its file; `None` if there is no unit.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&mut self, number: usize) -> Result<Option<Kept>, Failure> {
        let Some(open) = self.open.take() else { return Ok(None) };
        let file = file_of(open.unit, self.plan);
        let failed = |error: io::Error| Failure::io("writing", &self.plan.output.join(&file), &error);
        let sink = open.sink.finish().map_err(failed)?;
        let (sink, sha256) = sink.finish();
        sink.get_ref().sync_data().map_err(failed)?;
        let to = sink.get_ref().metadata().map_err(failed)?.len();
        if open.from == 0 {
            // The name of a new file is durable only when its folder is synced.
            File::open(&self.plan.output).and_then(|folder| folder.sync_all()).map_err(failed)?;
        }
        let session = open.session.unwrap_or_default();
        self.previous = Some((open.end_ns, session, self.shift_ns));
        self.previous_age_s = -self.clock.now();
        Ok(Some(Kept {
            unit: number,
            name: open.unit.name(self.plan),
            angles_deg: Some(open.unit.angles_deg(self.plan)),
            turn: None,
            from: open.from,
            to,
            sha256,
            rows: open.rows,
            seconds: open.counted_ns as f64 / 1e9,
            end_ns: open.end_ns,
            session,
            shift_ns: self.shift_ns,
            gaps: open.gaps,
            left_out: open.left_out,
            file,
            others: Vec::new(),
        }))
    }
}

/// Why a turn at this rate cannot have this row; `None` if it can. A row that is not full has filled its counters.
fn unfit_for_turn(row: &RowSum, is_full: bool, rate_deg_s: f64) -> Option<String> {
    if !is_full {
        return Some("a row's pulses do not fit into its counters; give a shorter turns.row_s".to_owned());
    }
    let (seconds, row_deg) = (row.seconds, row.seconds * rate_deg_s);
    (row_deg > MAX_ROW_DEG * ROW_DEG_MARGIN).then(|| {
        format!(
            "a row of {seconds:.3} s turns by up to {row_deg:.1} deg, {MAX_ROW_DEG:?} deg is allowed: sample faster, or give a lower turns.rate_deg_s"
        )
    })
}

impl OpenUnit {
    /// A turn of which a sample is missing cannot be used.
    fn miss_in_turn(&mut self, reason: &str) {
        if matches!(self.unit, Unit::Turn { .. }) && self.session.is_some() {
            self.spoiled = Some(reason.to_owned());
        }
    }
}

/// The columns of a file that rows are appended to: those of its header.
fn layout_of(file: &File) -> io::Result<Layout> {
    let mut header = String::new();
    BufReader::new(file).take(MAX_HEADER).read_line(&mut header)?;
    let has = |name: &str| header.trim_end().split(',').any(|column| column == name);
    Ok(Layout { device: has("device"), gyroscopes: has("g1_positive"), lag: false })
}

/// The sum of the samples of a row: pulses and intervals are added, telemetry is averaged over time.
struct RowSum {
    sum: RawSample,
    count: u32,
    first: RawSample,
    seconds: f64,
    accelerometers: TelemetrySum,
    gyroscopes: TelemetrySum,
    /// Sum of each sample's telemetry time times its interval \[ns2\]; 0 if a sample has no telemetry time.
    read_ns2: u128,
}

/// Sums of a triad's telemetry times the interval, by sensor.
#[derive(Clone, Copy, Default)]
struct TelemetrySum {
    head: [f64; AXES],
    board: [f64; AXES],
}

impl TelemetrySum {
    /// Adds `triad`'s telemetry over `seconds`, and its pulses to `sum`.
    fn add(&mut self, sum: &mut Triad, triad: &Triad, seconds: f64) {
        for axis in 0..AXES {
            sum.positive_pulses[axis] = sum.positive_pulses[axis].saturating_add(triad.positive_pulses[axis]);
            sum.negative_pulses[axis] = sum.negative_pulses[axis].saturating_add(triad.negative_pulses[axis]);
            self.head[axis] += triad.head_temperature[axis] * seconds;
            self.board[axis] += triad.board_temperature[axis] * seconds;
        }
    }

    /// `sum` with the mean telemetry of `seconds`.
    fn mean(&self, sum: Triad, seconds: f64) -> Triad {
        let mean = |sums: [f64; AXES]| sums.map(|sum| sum / seconds);
        Triad { head_temperature: mean(self.head), board_temperature: mean(self.board), ..sum }
    }
}

impl RowSum {
    fn new(first: &RawSample) -> Self {
        let empty = |triad: Triad| Triad { positive_pulses: [0; AXES], negative_pulses: [0; AXES], ..triad };
        let (accelerometers, gyroscopes) = (empty(first.accelerometers), empty(first.gyroscopes));
        // A mean of lagged telemetry is of no use: whoever reads the rows computes it from them.
        let sum = RawSample { interval_ns: 0, lag_ns: 0, accelerometers, gyroscopes, ..*first };
        let (accelerometers, gyroscopes) = (TelemetrySum::default(), TelemetrySum::default());
        Self { sum, count: 0, first: *first, seconds: 0.0, accelerometers, gyroscopes, read_ns2: 0 }.with(first)
    }

    fn with(mut self, sample: &RawSample) -> Self {
        let seconds = sample.interval_ns as f64 / 1e9;
        self.count += 1;
        self.seconds += seconds;
        self.sum.timestamp_ns = sample.timestamp_ns;
        let known = sample.telemetry_ns > 0 && (self.count == 1 || self.read_ns2 > 0);
        self.read_ns2 += u128::from(sample.telemetry_ns) * u128::from(sample.interval_ns);
        self.read_ns2 *= u128::from(known);
        self.sum.interval_ns += sample.interval_ns;
        self.accelerometers.add(&mut self.sum.accelerometers, &sample.accelerometers, seconds);
        self.gyroscopes.add(&mut self.sum.gyroscopes, &sample.gyroscopes, seconds);
        self
    }

    /// Whether the counters have room for as much again.
    fn has_room(&self) -> bool {
        let triads = [&self.sum.accelerometers, &self.sum.gyroscopes];
        let most = triads.iter().flat_map(|triad| triad.positive_pulses.iter().chain(&triad.negative_pulses)).max();
        most.is_none_or(|most| *most < u32::MAX / 2) && self.sum.interval_ns < MAX_INTERVAL_NS / 2
    }

    /// The row. A row of one sample is that sample.
    fn mean(&self) -> RawSample {
        if self.count == 1 {
            return RawSample { lag_ns: 0, ..self.first };
        }
        // The mean fits into u64: it is at most the largest telemetry time.
        let telemetry_ns = (self.read_ns2 / u128::from(self.sum.interval_ns)) as u64;
        let accelerometers = self.accelerometers.mean(self.sum.accelerometers, self.seconds);
        let gyroscopes = self.gyroscopes.mean(self.sum.gyroscopes, self.seconds);
        RawSample { telemetry_ns, accelerometers, gyroscopes, ..self.sum }
    }
}

/// Writes the campaign file beside the samples. If another text is there, the log says so: the fit takes what the plan
/// says.
///
/// # Errors
/// If it cannot be written.
pub fn write_campaign_file(plan: &Plan) -> Result<(), Failure> {
    let path = plan.output.join("campaign.toml");
    match read_text(&path, Trust::Any) {
        Ok((text, _)) if text == plan.campaign_toml => return Ok(()),
        Ok((text, _)) => {
            // What is there less is at the end.
            let pairs = text.lines().chain([""]).zip(plan.campaign_toml.lines().chain([""]));
            let different = (1..).zip(pairs).find(|(_, (there, planned))| there != planned);
            let different = different.map_or_else(String::new, |(number, (there, planned))| {
                format!(": line {number} was `{there}`, is `{planned}`")
            });
            tracing::warn!("{} was not what the plan gives; it is written anew from the plan{different}", shown(&path));
        }
        Err(_) => {}
    }
    replace(&path, &plan.campaign_toml).map_err(|error| Failure::io("writing", &path, &error))
}

#[cfg(test)]
mod tests;
