//! The raw streams of the IMUs, side by side: of the one IMU of a plan, or of each IMU of a batch, with what is written
//! of it.
//!
//! An IMU of a batch that fails is dropped, and the others go on. A stream that stops is the fault of its IMU only
//! while another one sends: if all stop, it is the service or the machine, and nobody is dropped.

use super::journal::{History, KeptStep};
use super::plan::Plan;
use super::readbacks::Readbacks;
use super::samples::{LaboratoryClock, SampleRecorder, SampleSource, SampleSources};
use super::stability::{Trends, temperature};
use super::stamp::Stamp;
use super::step::CampaignStep;
use isotherm_instruments::{ChamberReading, TurntableReading};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure};

/// A stream that has stopped for longer than this fraction of the patience does not flow.
const FLOWS: f64 = 0.5;
/// In a turn, an IMU with less than this fraction of the counted time of another one sends too little.
const TOO_LITTLE: f64 = 0.9;

/// When a stream flows. Times are laboratory time \[s\].
#[derive(Clone, Copy, Debug)]
struct Flow {
    /// The last usable sample.
    last: f64,
    /// Since when it flows, or flowed last.
    since: f64,
}

impl Default for Flow {
    fn default() -> Self {
        Self { last: f64::NEG_INFINITY, since: f64::INFINITY }
    }
}

impl Flow {
    /// Notes a usable sample.
    fn add(&mut self, at: f64, patience_s: f64) {
        if at - self.last > FLOWS * patience_s {
            self.since = at;
        }
        self.last = at;
    }

    /// Time since the last usable sample \[s\].
    fn age_s(&self, now: f64) -> f64 {
        now - self.last
    }

    /// The streams that have stopped for longer than `patience_s`, while another one has flowed for longer than
    /// `others_s`.
    fn silent(flows: &[(usize, Self)], now: f64, patience_s: f64, others_s: f64) -> Vec<usize> {
        let flow = flows.iter().filter(|(_, flow)| flow.age_s(now) <= FLOWS * patience_s);
        let long = flow.map(|(_, flow)| now - flow.since).fold(f64::NEG_INFINITY, f64::max) > others_s;
        let silent = flows.iter().filter(|(_, flow)| long && flow.age_s(now) > patience_s);
        silent.map(|(imu, _)| *imu).collect()
    }
}

/// An IMU, its stream and its files.
struct ImuStream<'p> {
    plan: &'p Plan,
    /// `None` after the IMU was dropped.
    tap: Option<Box<dyn SampleSource>>,
    is_dropped: bool,
    recorder: SampleRecorder<'p>,
    readbacks: Readbacks,
    /// Head and board of each accelerometer and each gyroscope in the last usable sample.
    temperature: [[f64; 2]; 2 * AXES],
    /// Length of the kept part of the dwells' file \[bytes\].
    kept_bytes: u64,
    /// The transport's last error; `None` after a sample.
    error: Option<String>,
    flow: Flow,
    /// Why the IMU has spoiled the earlier attempts at the unit in progress, one reason each.
    spoiled: Vec<String>,
}

impl<'p> ImuStream<'p> {
    /// The stream of the IMU of `plan`, where `history` ends, `age_s` after its last unit.
    fn new(plan: &'p Plan, history: &History, clock: LaboratoryClock, age_s: f64) -> Result<Self, Failure> {
        let of_imu =
            |kept: &&KeptStep| CampaignStep::of(plan, kept.unit).is_some_and(|unit| unit.file(plan) == kept.file);
        let kept = || history.kept.iter().flat_map(KeptStep::each).filter(of_imu);
        let samples = plan.samples_file();
        Ok(Self {
            plan,
            tap: None,
            is_dropped: history.reason_dropped(&plan.imu).is_some(),
            recorder: SampleRecorder::new(plan, clock, kept().last(), age_s),
            readbacks: Readbacks::open(plan)?,
            temperature: [[f64::NAN; 2]; 2 * AXES],
            kept_bytes: kept().filter(|kept| kept.file == samples).last().map_or(0, |kept| kept.to),
            error: None,
            flow: Flow::default(),
            spoiled: Vec::new(),
        })
    }

    const fn is_in(&self) -> bool {
        !self.is_dropped
    }

    /// Why there is no usable sample.
    fn silence(&self, now: f64, domain: &str) -> String {
        let imu = &self.plan.imu;
        let age_s = self.flow.age_s(now);
        let since = if age_s.is_finite() { format!("for {age_s:.0} s") } else { "yet".to_owned() };
        let cause = self.error.clone().unwrap_or_else(|| {
            format!("see with `isotherm status` whether a service serves {imu} in domain {domain:?} and its acquisition runs")
        });
        format!("no usable sample of {imu} {since}; {cause}")
    }
}

/// An IMU that has failed: its number in the plan, and the reason.
pub(crate) struct FailedImu {
    /// Its number in the plan, from 0.
    pub imu: usize,
    /// The reason.
    pub reason: String,
}

/// The streams of all IMUs of a plan.
pub(crate) struct Streams<'p> {
    all: Vec<ImuStream<'p>>,
    clock: LaboratoryClock,
    /// Name of the service's domain.
    domain: String,
}

impl<'p> Streams<'p> {
    /// Starts the streams of the IMUs that are not dropped, and goes on where `history` ends.
    ///
    /// # Errors
    /// If a file or a thread cannot be created.
    pub(crate) fn start(
        plan: &'p Plan,
        history: &History,
        clock: LaboratoryClock,
        sources: &dyn SampleSources,
    ) -> Result<Self, Failure> {
        let age_s = |kept_at: &Stamp| kept_at.age_s(clock.time()).unwrap_or_else(|| clock.unix_s() - kept_at.unix_s);
        let age_s = history.kept_at.as_ref().map_or(0.0, age_s).max(0.0) * clock.speed;
        let start = |plan: &'p Plan| {
            let stream = ImuStream::new(plan, history, clock.clone(), age_s)?;
            let tap = stream.is_in().then(|| sources.start(&plan.imu)).transpose();
            let tap = tap.map_err(|error| Failure::new(Exit::Failed, format!("starting a thread: {error}")))?;
            Ok(ImuStream { tap, ..stream })
        };
        let all = plan.each().iter().map(start).collect::<Result<_, Failure>>()?;
        Ok(Self { all, clock, domain: sources.domain().to_owned() })
    }

    /// Takes samples of another device than the plan's, if `accepts`.
    #[must_use]
    pub(crate) fn with_other_device(self, accepts: bool) -> Self {
        let imu = |stream: ImuStream<'p>| ImuStream { recorder: stream.recorder.with_other_device(accepts), ..stream };
        Self { all: self.all.into_iter().map(imu).collect(), ..self }
    }

    fn present(&self) -> impl Iterator<Item = &ImuStream<'p>> {
        self.all.iter().filter(|stream| stream.is_in())
    }

    fn present_mut(&mut self) -> impl Iterator<Item = &mut ImuStream<'p>> {
        self.all.iter_mut().filter(|stream| stream.is_in())
    }

    /// Whether an IMU can be dropped: another one is left then.
    #[must_use]
    pub(crate) fn has_others(&self) -> bool {
        self.present().count() > 1
    }

    /// Gives all received samples to the recorders and the trends. Returns the first IMU whose samples cannot be those
    /// of its plan.
    ///
    /// # Errors
    /// If a row cannot be written.
    pub(crate) fn drain(&mut self, trends: &mut Trends, patience_s: f64) -> Result<Option<FailedImu>, Failure> {
        for (imu, stream) in self.all.iter_mut().enumerate() {
            let Some(tap) = &mut stream.tap else { continue };
            while let Some(next) = tap.take_sample() {
                let (sample, received_ns) = match next {
                    Ok(sample) => sample,
                    Err(error) => {
                        stream.error = Some(error);
                        continue;
                    }
                };
                stream.error = None;
                match stream.recorder.take(&sample, received_ns) {
                    Ok(true) => {}
                    Ok(false) => continue,
                    Err(Failure { exit: Exit::Data, message, .. }) => {
                        return Ok(Some(FailedImu { imu, reason: message }));
                    }
                    Err(failure) => return Err(failure),
                }
                if let Some(at) = stream.recorder.usable_at() {
                    stream.flow.add(at, patience_s);
                }
                trends.sample(imu, &sample);
                stream.temperature = temperature(&sample);
            }
        }
        Ok(None)
    }

    /// Why a stream has stopped for longer than `patience_s`; `None` if all flow.
    #[must_use]
    pub(crate) fn silence(&self, patience_s: f64) -> Option<String> {
        let now = self.clock.now();
        let silent = self.present().find(|stream| stream.flow.age_s(now) > patience_s);
        silent.map(|stream| stream.silence(now, &self.domain))
    }

    /// The IMUs whose streams have stopped for longer than `patience_s`, while another one has flowed for longer than
    /// `others_s`.
    #[must_use]
    pub(crate) fn silent(&self, patience_s: f64, others_s: f64) -> Vec<FailedImu> {
        let now = self.clock.now();
        let present = self.all.iter().enumerate().filter(|(_, stream)| stream.is_in());
        let flows: Vec<_> = present.map(|(imu, stream)| (imu, stream.flow)).collect();
        let silent = Flow::silent(&flows, now, patience_s, others_s).into_iter();
        silent.map(|imu| FailedImu { imu, reason: self.all[imu].silence(now, &self.domain) }).collect()
    }

    /// The IMU that has spoiled the most attempts at the unit in progress, of several the first: if the unit is
    /// spoiled, and this is the last attempt or the IMU has spoiled as many as the plan allows.
    #[must_use]
    pub(crate) fn spoiler(&self, is_last_attempt: bool) -> Option<FailedImu> {
        let reasons = |stream: &ImuStream<'_>| {
            let mut reasons = stream.spoiled.clone();
            reasons.extend(stream.recorder.spoiled().map(str::to_owned));
            reasons
        };
        self.spoiled()?;
        let present = self.all.iter().enumerate().filter(|(_, stream)| stream.is_in());
        let all = present.map(|(imu, stream)| (imu, stream.plan.patience.attempts, reasons(stream)));
        let (imu, attempts, reasons) = all.rev().max_by_key(|(_, _, reasons)| reasons.len())?;
        let is_dropped = is_last_attempt || reasons.len() >= attempts as usize;
        let reason = format!("{}; attempts spoiled: {}", reasons.last()?, reasons.len());
        is_dropped.then_some(FailedImu { imu, reason })
    }

    /// The IMUs that have sent too few usable samples for the unit in progress, while others have sent enough. That is,
    /// of those that have stopped for longer than `patience_s`, the reason.
    #[must_use]
    pub(crate) fn slow(&self, unit: CampaignStep, reason: &str, patience_s: f64) -> Vec<FailedImu> {
        let now = self.clock.now();
        let most_s = self.present().map(|stream| stream.recorder.collected_s()).fold(0.0, f64::max);
        let slow = |stream: &ImuStream<'_>| match unit {
            CampaignStep::Dwell { .. } => !stream.recorder.complete(),
            _ => stream.recorder.collected_s() < TOO_LITTLE * most_s,
        };
        if self.present().all(slow) {
            return Vec::new();
        }
        let failed = self.all.iter().enumerate().filter(|(_, stream)| stream.is_in() && slow(stream));
        let reason = |stream: &ImuStream<'_>| match stream.flow.age_s(now) > patience_s {
            true => stream.silence(now, &self.domain),
            false => reason.to_owned(),
        };
        failed.map(|(imu, stream)| FailedImu { imu, reason: reason(stream) }).collect()
    }

    /// Drops an IMU: no more samples of it are taken. Its complete units stay in its files. Returns its plan.
    pub(crate) fn drop_imu(&mut self, imu: usize) -> &'p Plan {
        let stream = &mut self.all[imu];
        stream.recorder.discard();
        (stream.tap, stream.is_dropped) = (None, true);
        stream.temperature = [[f64::NAN; 2]; 2 * AXES];
        stream.plan
    }

    /// Whether the clocks of all IMUs are known, see [`SampleRecorder::knows_clock`].
    #[must_use]
    pub(crate) fn know_clocks(&self) -> bool {
        self.present().all(|stream| stream.recorder.knows_clock())
    }

    /// Counted time of the unit in progress \[s\]: that of the slowest IMU.
    #[must_use]
    pub(crate) fn collected_s(&self) -> f64 {
        self.present().map(|stream| stream.recorder.collected_s()).reduce(f64::min).unwrap_or_default()
    }

    /// Whether the counted time of every IMU is enough for a dwell.
    #[must_use]
    pub(crate) fn complete(&self) -> bool {
        self.present().all(|stream| stream.recorder.complete())
    }

    /// Why the unit in progress cannot be used; `None` if it can.
    #[must_use]
    pub(crate) fn spoiled(&self) -> Option<String> {
        self.present().find_map(|stream| {
            let reason = stream.recorder.spoiled()?;
            Some(match &stream.plan.member {
                Some(member) => format!("{}: {reason}", member.imu),
                None => reason.to_owned(),
            })
        })
    }

    /// Begins a unit of all IMUs, now.
    ///
    /// # Errors
    /// If a file cannot be opened.
    pub(crate) fn begin(&mut self, unit: CampaignStep) -> Result<(), Failure> {
        let since = self.clock.now();
        self.present_mut().try_for_each(|stream| {
            let kept = if unit.has_own_file() { 0 } else { stream.kept_bytes };
            stream.recorder.begin(unit, since, kept)
        })
    }

    /// Discards the unit in progress.
    pub(crate) fn discard(&mut self) {
        for stream in &mut self.all {
            stream.spoiled.extend(stream.recorder.spoiled().map(str::to_owned));
            stream.recorder.discard();
        }
    }

    /// Forgets the last samples and the clock offsets, after an interruption.
    pub(crate) fn reset_timing(&mut self) {
        self.present_mut().for_each(|stream| stream.recorder.reset_timing());
    }

    /// Completes the unit in progress and syncs its files; `None` if there is no unit.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn keep(&mut self, unit: CampaignStep, number: usize) -> Result<Option<KeptStep>, Failure> {
        let mut all = Vec::new();
        for stream in self.present_mut() {
            stream.spoiled.clear();
            let kept = stream.recorder.keep(number)?;
            if let Some(kept) = kept.as_ref().filter(|_| !unit.has_own_file()) {
                stream.kept_bytes = kept.to;
            }
            all.extend(kept);
        }
        let mut all = all.into_iter();
        Ok(all.next().map(|first| KeptStep { others: all.collect(), ..first }))
    }

    /// Appends a row to the read-backs of each IMU.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write_readbacks(
        &mut self,
        chamber: &ChamberReading,
        turntable: &TurntableReading,
        phase: &str,
        now: f64,
    ) -> Result<(), Failure> {
        let times = [now, self.clock.unix_s()];
        let write =
            |stream: &mut ImuStream<'_>| stream.readbacks.write(chamber, turntable, stream.temperature, phase, times);
        self.all.iter_mut().try_for_each(write)
    }

    /// The read-backs of each IMU, in the order of the plan.
    pub(crate) fn readbacks(&self) -> impl Iterator<Item = &Readbacks> {
        self.all.iter().map(|stream| &stream.readbacks)
    }
}

#[cfg(test)]
pub(crate) mod tests;
