//! The IMU's raw samples: tapped beside the service, told apart by when they were taken, summed into rows, written.
//!
//! # Which samples belong to a dwell
//! Those whose whole interval lies after the table had settled, and before it is told to move, which is after the last was received.
//! A sample carries the acquisition's clock, the readings of the table the runner's. Of the samples of the last minutes, the one that
//! took the least time from its end to its sending maps one clock onto the other. One that took longer makes no difference, so that a
//! sample that comes late is not taken for one that was taken late.

use super::journal::Kept;
use super::machine::Unit;
use super::plan::{Plan, SAMPLES};
use isotherm_calibration::campaign::implausible;
use isotherm_calibration::provenance::Hashed;
use isotherm_client::{Options, Realtime, Tap, TapSettings, monotonic_ns};
use isotherm_failure::Failure;
use isotherm_files::replace;
use isotherm_recording::RawCsvWriter;
use isotherm_shared::stream::{ImuId, StreamKind};
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample, StreamSample};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek as _, SeekFrom};
use std::mem;
use std::time::{Duration, Instant};

/// Pause of the tap when nothing is there: at 2 kHz it fills a sixth of the queue.
const TAP_PAUSE: Duration = Duration::from_millis(5);
/// Samples between tap and runner; more, if the runner is held up, are lost and show as a gap.
const TAP_DEPTH: usize = 1 << 16;
/// Pause before a tap that has ended by an error is started again.
const TAP_RETRY: Duration = Duration::from_millis(500);
/// The clocks are compared over this and up to twice this, in laboratory time \[s\] and in real time \[s\].
const COMPARED_S: [f64; 2] = [300.0, 30.0];
/// A sample that claims to have been on its way for longer does not tell when it was sent \[ns\].
const ON_ITS_WAY_NS: u64 = 10_000_000_000;

/// A sample that is so far ahead of the one before has a wrong time \[ns\]: a day.
const FAR_AHEAD_NS: u64 = 86_400_000_000_000;

/// Laboratory time: real time, times the speed of a simulated laboratory.
#[derive(Clone, Copy, Debug)]
pub struct LaboratoryClock {
    origin_ns: u64,
    /// Laboratory time over real time.
    pub speed: f64,
}

impl LaboratoryClock {
    /// One that begins now.
    pub fn new(speed: f64) -> Self {
        Self { origin_ns: monotonic_ns(), speed }
    }

    /// Now \[s\].
    pub fn now(&self) -> f64 {
        self.at(monotonic_ns())
    }

    /// At a time of `CLOCK_MONOTONIC` \[s\].
    pub fn at(&self, ns: u64) -> f64 {
        (ns as f64 - self.origin_ns as f64) / 1e9 * self.speed
    }
}

/// The IMU's raw stream, tapped for as long as the campaign takes: what stands in the way is told, and tried again.
pub struct SampleTap {
    imu: ImuId,
    options: Options,
    tap: Tap,
    /// When the tap has ended by an error, and is started again.
    retry_at: Option<Instant>,
}

impl SampleTap {
    /// Begins.
    ///
    /// # Errors
    /// If there can be no thread.
    pub fn start(imu: ImuId, options: Options) -> io::Result<Self> {
        let tap = tap(&imu, &options)?;
        Ok(Self { imu, options, tap, retry_at: None })
    }

    /// The next sample and when it was received, `CLOCK_MONOTONIC` \[ns\]; or why there is none.
    pub fn take_sample(&mut self) -> Option<Result<(RawSample, u64), String>> {
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
                match tap(&self.imu, &self.options) {
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

fn tap(imu: &ImuId, options: &Options) -> io::Result<Tap> {
    let settings = TapSettings { depth: TAP_DEPTH, pause: TAP_PAUSE, realtime: Realtime::default() };
    Tap::start(&[(imu.clone(), StreamKind::Raw)], options, settings)
}

/// The acquisition's clock less ours \[s\]: the largest of the last while, which is the one of the sample that came with the least delay.
struct ClockOffset {
    span_s: f64,
    /// When the present span began, and the largest of it and of the one before.
    began_at: f64,
    most: [f64; 2],
}

impl ClockOffset {
    fn new(speed: f64) -> Self {
        let span_s = COMPARED_S[0].max(COMPARED_S[1] * speed);
        Self { span_s, began_at: f64::NEG_INFINITY, most: [f64::NEG_INFINITY; 2] }
    }

    fn add(&mut self, at: f64, offset: f64) {
        if at - self.began_at > self.span_s {
            self.began_at = at;
            self.most = [f64::NEG_INFINITY, self.most[0]];
        }
        self.most[0] = self.most[0].max(offset);
    }

    fn most(&self) -> f64 {
        self.most[0].max(self.most[1])
    }
}

/// The file of a unit's samples.
pub fn file_of(place: Unit) -> String {
    match place {
        Unit::Dwell { .. } => SAMPLES.to_owned(),
        Unit::Run(run) => format!("verify-{}.csv", run + 1),
    }
}

/// What becomes of the samples.
pub struct SampleRecorder<'p> {
    plan: &'p Plan,
    clock: LaboratoryClock,
    /// The last kept unit's end, session and shift, and how long ago that was \[s\] when this began.
    before: Option<(u64, u64, u64)>,
    away_s: f64,
    last: Option<RawSample>,
    shift_ns: u64,
    /// Laboratory time of the last usable sample \[s\].
    usable_at: Option<f64>,
    offset: ClockOffset,
    open: Option<OpenUnit>,
}

/// Bytes on their way to a file.
type Sink = Hashed<BufWriter<File>>;

/// The unit in progress.
struct OpenUnit {
    place: Unit,
    /// Laboratory time since which samples count \[s\].
    since: f64,
    /// Where it begins in its file.
    from: u64,
    sink: RawCsvWriter<Sink>,
    row: Option<RowSum>,
    rows: u64,
    ns: u64,
    session: Option<u64>,
    end_ns: u64,
    gaps: u64,
    left_out: u64,
    spoiled: Option<String>,
}

impl<'p> SampleRecorder<'p> {
    /// Goes on after `before`, the last unit that was kept, `away_s` of laboratory time ago.
    pub fn new(plan: &'p Plan, clock: LaboratoryClock, before: Option<&Kept>, away_s: f64) -> Self {
        Self {
            plan,
            clock,
            before: before.map(|kept| (kept.end_ns, kept.session, kept.shift_ns)),
            away_s,
            last: None,
            shift_ns: 0,
            usable_at: None,
            offset: ClockOffset::new(clock.speed),
            open: None,
        }
    }

    /// Laboratory time of the last usable sample \[s\].
    pub const fn usable_at(&self) -> Option<f64> {
        self.usable_at
    }

    /// Counted time of the unit in progress \[s\].
    pub fn collected_s(&self) -> f64 {
        self.open.as_ref().map_or(0.0, |unit| unit.ns as f64 / 1e9)
    }

    /// Whether that is all of a dwell: half a row less is nearer than half a row more.
    pub fn complete(&self) -> bool {
        self.open.as_ref().is_some_and(|unit| {
            let row = unit.ns as f64 / unit.rows.max(1) as f64;
            unit.rows > 0 && unit.ns as f64 + 0.5 * row >= self.plan.dwell.time_s * 1e9
        })
    }

    /// Why the unit in progress cannot be used.
    pub fn spoiled(&self) -> Option<&str> {
        self.open.as_ref()?.spoiled.as_deref()
    }

    /// Takes the next sample, received at `received_ns` of `CLOCK_MONOTONIC`; whether it was usable.
    ///
    /// # Errors
    /// If a row cannot be written.
    pub fn take(&mut self, sample: &RawSample, received_ns: u64) -> Result<bool, Failure> {
        let sent_ns = sample.sent_ns;
        let plausible = sent_ns <= received_ns && received_ns - sent_ns < ON_ITS_WAY_NS;
        let sent_at = self.clock.at(if plausible { sent_ns } else { received_ns });
        let new_session = self.last.is_none_or(|last| last.session != sample.session);
        if new_session {
            self.offset = ClockOffset::new(self.clock.speed);
            self.shift_ns = self.shift(sample);
            if let Some(unit) = self.open.as_mut().filter(|unit| unit.session.is_some()) {
                unit.spoiled = Some("the acquisition was started anew".to_owned());
            }
        }
        let last = self.last.filter(|_| !new_session);
        if self.unusable(sample, last.as_ref()) {
            if let Some(unit) = &mut self.open {
                unit.left_out += 1;
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

    /// What a new session's timestamps need so that they follow those that are written.
    fn shift(&self, sample: &RawSample) -> u64 {
        let begin = sample.timestamp_ns.saturating_sub(sample.interval_ns);
        match self.before {
            Some((_, session, shift_ns)) if session == sample.session => shift_ns,
            Some((end_ns, ..)) if begin < end_ns => {
                let away_ns = ((self.away_s + self.clock.now()).max(0.0) * 1e9) as u64;
                end_ns.saturating_add(away_ns) - begin
            }
            _ => 0,
        }
    }

    /// Whether a sample is left out: `calibrate` could not use it, its time is wrong, or its telemetry too old.
    fn unusable(&self, sample: &RawSample, last: Option<&RawSample>) -> bool {
        let RawSample { timestamp_ns, interval_ns, telemetry_ns, .. } = *sample;
        let previous_ns = last.map(|last| last.timestamp_ns);
        let far_ahead = previous_ns.is_some_and(|previous_ns| timestamp_ns.saturating_sub(previous_ns) > FAR_AHEAD_NS);
        let age_s = timestamp_ns.saturating_sub(telemetry_ns) as f64 / 1e9;
        let stale = telemetry_ns > 0 && self.plan.campaign.max_age_s.is_some_and(|most| age_s > most);
        implausible(sample, previous_ns).is_some() || timestamp_ns < interval_ns || far_ahead || stale
    }

    fn add(&mut self, sample: &RawSample, gap: bool) -> Result<(), Failure> {
        let complete = self.complete();
        let Some(unit) = &mut self.open else { return Ok(()) };
        if complete && matches!(unit.place, Unit::Dwell { .. }) || unit.spoiled.is_some() {
            return Ok(());
        }
        if unit.session.is_none() {
            let begin_s = (sample.timestamp_ns - sample.interval_ns) as f64 / 1e9;
            if begin_s < unit.since + self.offset.most() {
                return Ok(());
            }
            unit.session = Some(sample.session);
        } else {
            unit.gaps += u64::from(gap);
        }
        let row_ns = (self.plan.dwell.row_s * 1e9) as u64;
        let row = match unit.row.take() {
            None => RowSum::new(sample),
            Some(row) => row.with(sample),
        };
        if row.sum.interval_ns + sample.interval_ns / 2 < row_ns && row.has_room() {
            unit.row = Some(row);
            return Ok(());
        }
        let mut written = row.mean();
        written.timestamp_ns = written.timestamp_ns.saturating_add(self.shift_ns);
        if written.telemetry_ns > 0 {
            written.telemetry_ns = written.telemetry_ns.saturating_add(self.shift_ns);
        }
        unit.rows += 1;
        unit.ns += written.interval_ns;
        unit.end_ns = written.timestamp_ns;
        let leading = match unit.place {
            Unit::Dwell { visit, position } => {
                let (set_point, number) = (self.plan.set_points_c[visit], self.plan.positions[position].number);
                format!("{set_point},{number},{}", written.session)
            }
            Unit::Run(_) => written.session.to_string(),
        };
        let file = file_of(unit.place);
        unit.sink.write(leading, &written).map_err(|error| self.failed("writing", &file, &error))
    }

    fn failed(&self, phase: &str, file: &str, error: &io::Error) -> Failure {
        Failure::io(phase, &self.plan.output.join(file), error)
    }

    /// Begins a unit: samples that begin after the laboratory time `since` belong to it. `kept` is how much of its file is kept.
    ///
    /// # Errors
    /// If its file cannot be opened.
    pub fn begin(&mut self, place: Unit, since: f64, kept: u64) -> Result<(), Failure> {
        let name = file_of(place);
        let sink = self.sink(place, &name, kept).map_err(|error| self.failed("opening", &name, &error))?;
        self.open = Some(OpenUnit {
            place,
            since,
            from: kept,
            sink,
            row: None,
            rows: 0,
            ns: 0,
            session: None,
            end_ns: 0,
            gaps: 0,
            left_out: 0,
            spoiled: None,
        });
        Ok(())
    }

    fn sink(&self, place: Unit, name: &str, kept: u64) -> io::Result<RawCsvWriter<Sink>> {
        let path = self.plan.output.join(name);
        let mut file = OpenOptions::new().write(true).create(true).truncate(false).open(path)?;
        // Nothing but what the journal lists stays.
        file.set_len(kept)?;
        file.seek(SeekFrom::Start(kept))?;
        let sink = Hashed::new(BufWriter::new(file));
        let leading = if matches!(place, Unit::Dwell { .. }) { "set_point_c,position,session" } else { "session" };
        if kept == 0 { RawCsvWriter::new(sink, leading, true) } else { Ok(RawCsvWriter::resume(sink, true, true)) }
    }

    /// Whatever comes next may begin anywhere: one sample with a wrong time must not make all others late.
    pub fn forget(&mut self) {
        self.last = None;
        self.offset = ClockOffset::new(self.clock.speed);
    }

    /// Throws the unit in progress away.
    pub fn discard(&mut self) {
        if let Some(unit) = self.open.take() {
            let path = self.plan.output.join(file_of(unit.place));
            let from = unit.from;
            // Written out now or never.
            drop(unit.sink);
            // What stays is cut off when the next unit begins.
            let _ = OpenOptions::new().write(true).open(path).and_then(|file| file.set_len(from));
        }
    }

    /// Makes the unit in progress last; `None` if there is none.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&mut self, number: usize) -> Result<Option<Kept>, Failure> {
        let Some(unit) = self.open.take() else { return Ok(None) };
        let file = file_of(unit.place);
        let failed = |error: io::Error| Failure::io("writing", &self.plan.output.join(&file), &error);
        let sink = unit.sink.finish().map_err(failed)?;
        let (sink, sha256) = sink.finish();
        sink.get_ref().sync_data().map_err(failed)?;
        let to = sink.get_ref().metadata().map_err(failed)?.len();
        if unit.from == 0 {
            // The file's name is the folder's to keep.
            File::open(&self.plan.output).and_then(|folder| folder.sync_all()).map_err(failed)?;
        }
        let session = unit.session.unwrap_or_default();
        self.before = Some((unit.end_ns, session, self.shift_ns));
        self.away_s = -self.clock.now();
        Ok(Some(Kept {
            unit: number,
            name: unit.place.name(self.plan),
            from: unit.from,
            to,
            sha256,
            rows: unit.rows,
            seconds: unit.ns as f64 / 1e9,
            end_ns: unit.end_ns,
            session,
            shift_ns: self.shift_ns,
            gaps: unit.gaps,
            left_out: unit.left_out,
            file,
        }))
    }
}

/// Samples summed into a row: pulses and intervals added up, telemetry averaged over time.
struct RowSum {
    sum: RawSample,
    count: u32,
    first: RawSample,
    seconds: f64,
    telemetry: [[f64; 2]; AXES],
    /// When the telemetry was read, times the interval \[ns2\]; 0 if that is unknown of a sample.
    read_ns2: u128,
}

impl RowSum {
    fn new(first: &RawSample) -> Self {
        let zero = RawSample { interval_ns: 0, positive_pulses: [0; AXES], negative_pulses: [0; AXES], ..*first };
        Self { sum: zero, count: 0, first: *first, seconds: 0.0, telemetry: [[0.0; 2]; AXES], read_ns2: 0 }.with(first)
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
        for axis in 0..AXES {
            self.sum.positive_pulses[axis] =
                self.sum.positive_pulses[axis].saturating_add(sample.positive_pulses[axis]);
            self.sum.negative_pulses[axis] =
                self.sum.negative_pulses[axis].saturating_add(sample.negative_pulses[axis]);
            self.telemetry[axis][0] += sample.head_temperature[axis] * seconds;
            self.telemetry[axis][1] += sample.board_temperature[axis] * seconds;
        }
        self
    }

    /// Whether another sample like those before fits into the counters.
    fn has_room(&self) -> bool {
        let most = self.sum.positive_pulses.iter().chain(&self.sum.negative_pulses).max();
        most.is_none_or(|most| *most < u32::MAX / 2) && self.sum.interval_ns < MAX_INTERVAL_NS / 2
    }

    /// A row of one sample is that sample.
    fn mean(&self) -> RawSample {
        if self.count == 1 {
            return self.first;
        }
        let of = |part: usize| [0, 1, 2].map(|axis: usize| self.telemetry[axis][part] / self.seconds);
        // A mean is not over the largest.
        let telemetry_ns = (self.read_ns2 / u128::from(self.sum.interval_ns)) as u64;
        RawSample { head_temperature: of(0), board_temperature: of(1), telemetry_ns, ..self.sum }
    }
}

/// Writes the campaign file beside the samples.
///
/// # Errors
/// If it cannot be written.
pub fn describe(plan: &Plan) -> Result<(), Failure> {
    let path = plan.output.join("campaign.toml");
    if fs::read_to_string(&path).is_ok_and(|text| text == plan.campaign_toml) {
        return Ok(());
    }
    replace(&path, &plan.campaign_toml).map_err(|error| Failure::io("writing", &path, &error))
}

#[cfg(test)]
mod tests;
