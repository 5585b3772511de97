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

mod clock;
mod row;
mod source;

pub use clock::LaboratoryClock;
pub use source::{SampleSource, SampleSources};

use super::journal::KeptStep;
use super::plan::{MAX_ROW_DEG, Plan};
use super::step::CampaignStep;
use clock::ClockOffset;
use isotherm_campaign::implausible;
use isotherm_fit::{HashingStream, implausible as gyroscopes_implausible};
use isotherm_recording::{Layout, RawCsvWriter};
use isotherm_shared::wire::{RawSample, StreamSample, device};
use isotherm_support::failure::{Exit, Failure};
use row::RowSum;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, BufWriter, Read as _, Seek as _, SeekFrom};

/// Longest credible time from a sample's sending to its reception \[ns\]. Beyond it, the time of reception replaces
/// `sent_ns`.
const MAX_TRANSIT_NS: u64 = 10_000_000_000;

/// Largest credible step of the timestamp from one sample to the next \[ns\]: a day.
const MAX_STEP_NS: u64 = 86_400_000_000_000;

/// Length limit of a header that is read \[bytes\].
const MAX_HEADER: u64 = 4096;

/// Jitter of the intervals may make a row of a turn longer by this factor.
const ROW_DEG_MARGIN: f64 = 1.01;

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
    open: Option<OpenStep>,
    /// Whether samples of another device than the plan's are taken.
    takes_other_device: bool,
    /// Whether a sample has had gyroscopes.
    has_gyroscopes: bool,
}

/// The file of a unit, buffered, with the hash of what is written.
type Sink = HashingStream<BufWriter<File>>;

/// The unit in progress.
struct OpenStep {
    unit: CampaignStep,
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
    pub fn new(plan: &'p Plan, clock: LaboratoryClock, previous: Option<&KeptStep>, previous_age_s: f64) -> Self {
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

    /// Takes samples of another device than the plan's, if `takes`.
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
    /// If a row cannot be written, or if it is a sample of another device, or of an IMU without the gyroscopes that are
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
                open.spoiled = Some("the acquisition was restarted".to_owned());
            }
        }
        let last = self.last.filter(|_| !new_session);
        if self.unusable(sample, last.as_ref()) {
            if let Some(open) = &mut self.open {
                open.left_out += 1;
                open.miss_in_turn("a sample cannot be used: its time, a counter or its temperature");
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
                "the samples of {imu} are of another device, device {found:016x}, than serial = {serial:?} of the plan; mount that unit, correct the \
                 serial number, or give --other-device"
            );
            return Err(Failure::new(Exit::Data, message));
        }
        self.has_gyroscopes |= Layout::of(&StreamSample::Raw(*sample)).gyroscopes;
        if !self.plan.turns.is_empty() && !self.has_gyroscopes {
            let message = format!(
                "the samples of {imu} have no gyroscopes, but the plan takes turns to calibrate them; let the acquisition send them, or leave \
                 [turns] out of the plan to calibrate only the accelerometers"
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

    /// Whether a sample is left out: `calibrate` would refuse it, its time is wrong, or its temperature is stale.
    fn unusable(&self, sample: &RawSample, last: Option<&RawSample>) -> bool {
        let RawSample { timestamp_ns, interval_ns, .. } = *sample;
        let previous_ns = last.map(|last| last.timestamp_ns);
        let far_ahead = previous_ns.is_some_and(|previous_ns| timestamp_ns.saturating_sub(previous_ns) > MAX_STEP_NS);
        let stale = sample.is_marked_stale()
            || self.plan.campaign.max_age_s.is_some_and(|limit| sample.temperature_age_s() > limit);
        let gyroscopes = !self.plan.turns.is_empty() && gyroscopes_implausible(&sample.gyroscopes.or_zero()).is_some();
        implausible(sample, previous_ns).is_some() || gyroscopes || timestamp_ns < interval_ns || far_ahead || stale
    }

    /// Adds a usable sample to the unit in progress if it belongs to it, and writes the row that it completes.
    fn add(&mut self, sample: &RawSample, gap: bool) -> Result<(), Failure> {
        let complete = self.complete();
        let Some(open) = &mut self.open else { return Ok(()) };
        if complete && matches!(open.unit, CampaignStep::Dwell { .. }) || open.spoiled.is_some() {
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
        let is_turn = matches!(open.unit, CampaignStep::Turn { .. });
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
            CampaignStep::Dwell { visit, position } => {
                format!(
                    "{},{},{}",
                    self.plan.set_points_c[visit], self.plan.positions[position].number, written.session
                )
            }
            CampaignStep::Turn { visit, turn } => {
                format!("{},{},{}", self.plan.set_points_c[visit], self.plan.turns[turn].number, written.session)
            }
            CampaignStep::Ramp(_) | CampaignStep::Run(_) => written.session.to_string(),
        };
        let file = open.unit.file(self.plan);
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
    pub fn begin(&mut self, unit: CampaignStep, since: f64, kept: u64) -> Result<(), Failure> {
        let name = unit.file(self.plan);
        let sink = self.sink(unit, &name, kept).map_err(|error| self.failed("opening", &name, &error))?;
        self.open = Some(OpenStep {
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

    fn sink(&self, unit: CampaignStep, name: &str, kept: u64) -> io::Result<RawCsvWriter<Sink>> {
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

    /// The columns of a new file: the gyroscopes' if they are calibrated, the device's if the samples show it.
    fn layout(&self) -> Layout {
        let device = self.last.is_some_and(|last| last.device != 0);
        Layout { device, gyroscopes: !self.plan.turns.is_empty(), lag: false, unix_offset: false }
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
            let path = self.plan.output.join(open.unit.file(self.plan));
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
    pub fn keep(&mut self, number: usize) -> Result<Option<KeptStep>, Failure> {
        let Some(open) = self.open.take() else { return Ok(None) };
        let file = open.unit.file(self.plan);
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
        Ok(Some(KeptStep {
            unit: number,
            name: open.unit.name(self.plan),
            angles_deg: open.unit.angles_deg(self.plan),
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

impl OpenStep {
    /// A turn of which a sample is missing cannot be used.
    fn miss_in_turn(&mut self, reason: &str) {
        if matches!(self.unit, CampaignStep::Turn { .. }) && self.session.is_some() {
            self.spoiled = Some(reason.to_owned());
        }
    }
}

/// The columns of a file that rows are appended to: those of its header.
fn layout_of(file: &File) -> io::Result<Layout> {
    let mut header = String::new();
    BufReader::new(file).take(MAX_HEADER).read_line(&mut header)?;
    let has = |name: &str| header.trim_end().split(',').any(|column| column == name);
    Ok(Layout { device: has("device"), gyroscopes: has("g1_positive"), lag: false, unix_offset: false })
}

#[cfg(test)]
mod tests;
