//! From rows to samples: each gets its period, its time and its number.

mod judge;

use crate::description::{Description, Kind, Port};
use crate::frames::{DecodedFrame, FrameArrival};
use crate::gravity::UnitCheck;
use crate::health::Health;
use crate::identity::Signature;
use crate::iio::IioScale;
use crate::link::SoakSpan;
use crate::notice::Notice;
use crate::number::Value;
use crate::pulses::PulseClock;
use crate::sample::{Assembler, NoSample, TemperatureColumns};
use crate::tally::Tally;
use crate::thermometer::Thermometer;
use crate::timeline::{Counter, FrameObservation, FramePlace, FramePlacement, Timeline};
use isotherm_client::RawSample;
use isotherm_support::failure::tell;
use std::path::Path;

/// Gaps that are reported one by one; the tally has all.
const TOLD_GAPS: u64 = 10;
/// A device whose own clock or counter began so long ago was just powered \[ns\], unless it may have turned: it turns
/// within less than a day \[ns\].
const JUST_POWERED_NS: u64 = 10_000_000_000;
const LONG_TURN_NS: u128 = 86_400_000_000_000;

/// Makes samples of rows, and counts.
pub(crate) struct Intake {
    description: Description,
    /// How long a byte takes on the line \[ns\].
    byte_ns: f64,
    timeline: Timeline<Vec<Value>>,
    assembler: Assembler,
    thermometer: Thermometer,
    units: UnitCheck,
    /// Room for rows that wait.
    spare: Vec<Vec<Value>>,
    last_row: Vec<Value>,
    /// The pulses with which the second of the device's clock begins.
    pulses: Option<PulseClock>,
    /// Whether a rate or a counter that is not as described ends the acquisition, also after the first sample.
    ends: bool,
    /// Whether the IMU has sent a sample since the machine was started: then nothing ends the acquisition.
    pub(crate) has_sent: bool,
    sequence: u64,
    /// The time of the last frame \[ns\].
    last_ns: u64,
    /// Whether this session has a sample.
    has_sample: bool,
    /// Whether the last period of this session has a sample.
    last_has_sample: bool,
    /// What happened since the last frame that was placed: the device was away, and frames were damaged.
    after_outage: bool,
    damaged: u64,
    restarts: SessionRestarts,
    warned_of_rate: bool,
    /// When the rate was off, by both clocks since it is measured \[s\].
    suspected: Option<(f64, f64)>,
    last_arrival: Option<FrameArrival>,
    sessions: Notice,
    counts: Notice,
    rates: Notice,
    health: Health,
    /// Where the device is taken to be soaked.
    pub(crate) soaked: SoakSpan,
    /// Times that the device had said that it was just powered, when a session began.
    power_ups: u64,
    /// Under whose number samples go out.
    pub(crate) signature: Signature,
    pub(crate) tally: Tally,
}

/// New sessions that follow each other closely: the counter or the clock is then not as described.
#[derive(Clone, Copy, Debug, Default)]
struct SessionRestarts {
    /// Sessions since the last run of [`Self::REGULAR`] frames.
    sessions: u64,
    /// Frames of the present session after its first one.
    frames: u64,
}

impl SessionRestarts {
    /// So many frames after the first one show that a session goes on.
    const REGULAR: u64 = 10;

    const fn begin_session(&mut self) {
        *self = Self { sessions: self.sessions + 1, frames: 0 };
    }

    const fn count_frame(&mut self) {
        self.frames += 1;
        if self.frames >= Self::REGULAR {
            self.sessions = 0;
        }
    }
}

/// When a row came, and what it took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RowArrival {
    /// `None` for rows that do not come at their time.
    pub(crate) arrival: Option<FrameArrival>,
    pub(crate) bytes: usize,
    pub(crate) damaged: u64,
    /// The time of the row, on the clock of its arrival \[ns\].
    pub(crate) stamp: Option<u64>,
}

impl RowArrival {
    pub(crate) fn of(found: &DecodedFrame<'_>, is_live: bool) -> Self {
        let arrival = is_live.then_some(found.arrival);
        Self { arrival, bytes: found.bytes, damaged: found.damaged, stamp: None }
    }
}

impl Intake {
    /// `stamped`: rows have a time of their own.
    pub(crate) fn new(description: &Description, byte_ns: f64, stamped: bool) -> Self {
        let timing = &description.timing;
        let clock = if stamped { Some(STAMPS) } else { timing.clock.map(|(.., clock)| clock) };
        let timeline = Timeline::new(timing.interval_ns, timing.counter.map(|(_, counter)| counter), clock);
        let port = match &description.kind {
            Kind::Frames(port, _) | Kind::Lines(port, _) => Some(port),
            Kind::Iio(_) | Kind::Messages(..) => None,
        };
        let is_datagrams = matches!(port, Some(Port::Udp(_)));
        let ends = matches!(port, Some(Port::File { .. } | Port::Stdin));
        let timeline = if is_datagrams { timeline.of_datagrams() } else { timeline };
        Self {
            // What a program hands on may come at any pace.
            timeline: if ends { timeline.at_any_pace() } else { timeline },
            assembler: Assembler::new(description.columns),
            thermometer: Thermometer::new(description),
            units: UnitCheck::new(description),
            spare: Vec::new(),
            last_row: Vec::new(),
            pulses: None,
            ends,
            has_sent: false,
            byte_ns,
            sequence: 0,
            last_ns: 0,
            has_sample: false,
            last_has_sample: false,
            after_outage: false,
            damaged: 0,
            restarts: SessionRestarts::default(),
            warned_of_rate: false,
            suspected: None,
            last_arrival: None,
            sessions: Notice::default(),
            counts: Notice::default(),
            rates: Notice::default(),
            health: Health::default(),
            soaked: SoakSpan::default(),
            power_ups: 0,
            signature: Signature::Own,
            tally: Tally { imu: description.imu.to_string(), ..Tally::default() },
            description: description.clone(),
        }
    }

    /// For an IMU that has sent a sample since the machine was started.
    pub(crate) fn of_sender(self, has_sent: bool) -> Self {
        Self { has_sent, ..self }
    }

    /// For a device of which the kernel knows the scales.
    pub(crate) fn with_scales(self, scales: &[IioScale]) -> Self {
        Self { units: self.units.with_scales(&self.description, scales), ..self }
    }

    /// For a device whose clock has pulses, if they are described. They are in `sysfs`, which is `/`, or the root of a
    /// tree for tests. Rows that come as fast as they are read have none.
    pub(crate) fn with_pulses(mut self, sysfs: &Path, is_live: bool) -> Self {
        self.pulses = self.description.timing.pulses.filter(|_| is_live).map(|number| PulseClock::new(sysfs, number));
        if self.pulses.is_some() {
            self.timeline = self.timeline.with_clock(STAMPS);
        }
        self
    }

    /// Whether this IMU has sent a sample, so that nothing but a signal ends the acquisition from its device.
    pub(crate) const fn goes_on(&self) -> bool {
        !self.ends && self.has_sent
    }

    /// Makes the pulses of readings for this interval from now on \[ns\]: that of the table.
    pub(crate) const fn set_pulse_interval(&mut self, pulse_ns: u64) {
        self.assembler.set_pulse_interval(pulse_ns);
    }

    /// Takes a row. Gives each sample that is placed to `sink`, with the number of its session from 1.
    pub(crate) fn take(&mut self, row: &[Value], arrived: RowArrival, sink: &mut dyn FnMut(RawSample, u64)) {
        self.tally.frames += 1;
        self.damaged += arrived.damaged;
        let timing = self.description.timing;
        let value = |column: usize| row.get(column).copied().unwrap_or(Value::ABSENT);
        let latency = timing.latency.map_or(0.0, |(column, unit)| value(column).number * unit);
        let late = arrived.bytes as f64 * self.byte_ns + if latency.is_finite() { latency.max(0.0) } else { 0.0 };
        let earlier = |at: u64| at.saturating_sub(late as u64);
        let arrival = arrived.arrival.map(|FrameArrival { after_ns, by_ns }| FrameArrival {
            after_ns: earlier(after_ns),
            by_ns: earlier(by_ns),
        });
        self.last_arrival = arrival;
        let is_same = row.len() == self.last_row.len() && row.iter().zip(&self.last_row).all(|(a, b)| a.is_same(b));
        self.last_row.clear();
        self.last_row.extend_from_slice(row);
        let observed = FrameObservation {
            arrival,
            counter: self.counter_of(row),
            clock_ns: arrived.stamp.or_else(|| self.stamp_of(row, arrival)),
            damaged: self.damaged,
            after_outage: self.after_outage,
            is_same,
        };
        if self.has_items() && !self.assembler.has_sensors(row) {
            // Another message of the device, as one of its GNSS receiver.
            self.tally.others += 1;
            self.assembler.take_temperature(row, self.last_ns);
            self.thermometer.take(row, self.last_ns);
            return;
        }
        if timing.counter.is_some() && observed.counter.is_none()
            || timing.clock.is_some() && observed.clock_ns.is_none()
        {
            self.tally.incomplete += 1;
            return;
        }
        (self.damaged, self.after_outage) = (0, false);
        let mut kept = self.spare.pop().unwrap_or_default();
        kept.clear();
        kept.extend_from_slice(row);
        self.timeline.push(observed, kept);
        self.hand_out(sink);
    }

    /// The device's counter in a row.
    fn counter_of(&self, row: &[Value]) -> Option<u64> {
        self.description.timing.counter.and_then(|(column, _)| row.get(column)?.whole)
    }

    /// The device's clock in a row \[ns\]; where it has pulses, on the clock of this machine.
    fn stamp_of(&mut self, row: &[Value], arrival: Option<FrameArrival>) -> Option<u64> {
        let clock_ns = self.clock_of(row)?;
        match (&mut self.pulses, arrival) {
            (Some(pulses), Some(arrival)) => pulses.stamp_ns(clock_ns, arrival.by_ns),
            _ => Some(clock_ns),
        }
    }

    /// The device's clock in a row \[ns\].
    fn clock_of(&self, row: &[Value]) -> Option<u64> {
        let (column, unit_ns, _) = self.description.timing.clock?;
        let value = row.get(column)?;
        // With a fraction, as seconds in a text, or a unit of its own.
        let rounded = (value.number * unit_ns as f64).round();
        let whole = value.whole.filter(|_| value.number >= 0.0).map(|whole| whole.saturating_mul(unit_ns));
        whole.or((0.0..1.8e19).contains(&rounded).then_some(rounded as u64))
    }

    /// Hands out what has waited long enough at this time \[ns\].
    pub(crate) fn look(&mut self, now_ns: u64, sink: &mut dyn FnMut(RawSample, u64)) {
        if self.timeline.is_waiting() {
            self.timeline.look(now_ns);
            self.hand_out(sink);
        }
    }

    /// Hands out all that waits: nothing more comes for now.
    pub(crate) fn settle(&mut self, sink: &mut dyn FnMut(RawSample, u64)) {
        self.timeline.settle_all();
        self.hand_out(sink);
    }

    fn hand_out(&mut self, sink: &mut dyn FnMut(RawSample, u64)) {
        while let Some((placed, row)) = self.timeline.next() {
            // Before the first sample another rate is refused, and nothing is sent.
            if self.goes_on() || self.ends || !self.timeline.is_other_rate() {
                self.hand_out_one(placed, &row, sink);
            } else {
                self.tally.other_rate += 1;
            }
            self.spare.push(row);
        }
    }

    fn hand_out_one(&mut self, placed: FramePlacement, row: &[Value], sink: &mut dyn FnMut(RawSample, u64)) {
        let timestamp_ns = placed.timestamp_ns;
        match placed.place {
            FramePlace::Repeated => {
                self.tally.repeated += 1;
                return;
            }
            FramePlace::First => {
                self.begin_session();
                self.note_power(row, timestamp_ns);
            }
            FramePlace::Next { periods, is_ambiguous } => self.pass(periods, is_ambiguous),
        }
        self.last_ns = timestamp_ns;
        let is_other = placed.interval_ns != self.description.timing.interval_ns;
        let is_valid = placed.is_certain && (!is_other || self.description.columns.adopts());
        self.assembler.set_interval(placed.interval_ns);
        if let Some((mut raw, session)) = self.sample(row, timestamp_ns) {
            if is_valid {
                self.units.take(row, timestamp_ns, placed.interval_ns);
            } else {
                raw.invalidate();
                self.tally.other_rate += 1;
            }
            match self.signature {
                Signature::Own => {}
                Signature::Other(device) => {
                    raw.device = device;
                    self.tally.other_device += 1;
                }
                Signature::Held => {
                    self.tally.other_device += 1;
                    self.tally.held += 1;
                    return;
                }
            }
            sink(raw, session);
        }
    }

    /// Whether frames may lack the sensors.
    fn has_items(&self) -> bool {
        matches!(&self.description.kind, Kind::Frames(_, frame) if frame.items.is_some())
    }

    fn begin_session(&mut self) {
        self.tally.sessions += 1;
        if self.tally.sessions > 1 {
            let text = "the device has started again, or was away for over a turn of its counter: a new session";
            self.sessions.tell(|| text.to_owned());
        }
        self.restarts.begin_session();
        self.sequence = 0;
        (self.has_sample, self.last_has_sample) = (false, false);
        self.assembler.reset();
        self.thermometer.begin_session();
        self.units.begin_session();
    }

    /// Notes whether the device is taken to be soaked, since its own clock or counter has just begun.
    fn note_power(&mut self, row: &[Value], timestamp_ns: u64) {
        let timing = &self.description.timing;
        let session = self.tally.sessions;
        if matches!(self.description.columns.temperature, TemperatureColumns::Constant(_)) {
            // What never changes has no lag.
            self.soaked = SoakSpan { session, until_ns: u64::MAX };
            return;
        }
        let was_powered = std::mem::replace(&mut self.power_ups, self.tally.power_ups) != self.tally.power_ups;
        let ns = |counts: u64, step: u64| u128::from(counts) * u128::from(timing.interval_ns) / u128::from(step.max(1));
        let of_counter = timing.counter.zip(self.counter_of(row)).map(|((_, Counter { bits, step }), counter)| {
            let limit = u64::MAX >> (64 - bits.clamp(1, 64));
            (ns(counter & limit, step), ns(limit, step))
        });
        // A stamp of the kernel is no clock of the device, and one that pulses set does not begin with its power.
        let of_clock = timing
            .clock
            .filter(|_| timing.pulses.is_none())
            .zip(self.clock_of(row))
            .map(|((.., clock), clock_ns)| (u128::from(clock_ns), clock.turn_ns.map_or(u128::MAX, u128::from)));
        let is_new = |(since_ns, turn_ns): (u128, u128)| since_ns < JUST_POWERED_NS.into() && turn_ns >= LONG_TURN_NS;
        if was_powered || [of_counter, of_clock].into_iter().flatten().any(is_new) {
            self.soaked = SoakSpan { session, until_ns: timestamp_ns.saturating_add(JUST_POWERED_NS) };
        }
    }

    /// Counts the periods up to this frame.
    fn pass(&mut self, periods: u64, is_ambiguous: bool) {
        self.restarts.count_frame();
        self.sequence = self.sequence.saturating_add(periods);
        let missing = periods - 1;
        if missing == 0 {
            return;
        }
        self.assembler.reset();
        self.tally.gaps += 1;
        self.tally.missing = self.tally.missing.saturating_add(missing);
        self.tally.ambiguous += u64::from(is_ambiguous);
        if self.tally.gaps <= TOLD_GAPS {
            let uncertain = if is_ambiguous { ", or other turns of the counter" } else { "" };
            let last = if self.tally.gaps == TOLD_GAPS { "; later ones are only in the tally" } else { "" };
            let sequence = self.sequence;
            tell("isotherm", format!("gap: {missing} missing{uncertain} before sequence {sequence}{last}"));
        }
    }

    fn sample(&mut self, row: &[Value], timestamp_ns: u64) -> Option<(RawSample, u64)> {
        self.thermometer.take(row, timestamp_ns);
        match self.assembler.sample(row, timestamp_ns) {
            Ok((mut raw, unhealthy)) => {
                if self.thermometer.is_stale(timestamp_ns) {
                    raw.mark_stale();
                    self.tally.stale += 1;
                }
                self.tally.samples += 1;
                self.tally.unhealthy += u64::from(unhealthy != 0);
                self.health.note(unhealthy);
                (self.has_sample, self.last_has_sample) = (true, true);
                Some((RawSample { sequence: self.sequence, ..raw }, self.tally.sessions))
            }
            Err(cause) => {
                if cause == NoSample::NoTemperature {
                    self.thermometer.wait(timestamp_ns);
                }
                self.missing_sample(&cause);
                None
            }
        }
    }

    /// A frame that is no sample: its period is missing, unless the session has no sample before it.
    fn missing_sample(&mut self, cause: &NoSample) {
        let (count, message) = match cause {
            NoSample::Incomplete => (
                &mut self.tally.incomplete,
                "has not all columns of the sensors, or one that is not a number".to_owned(),
            ),
            NoSample::NoTemperature => {
                (&mut self.tally.without_temperature, "comes before the first temperature".to_owned())
            }
            NoSample::OutOfRange(error) => (&mut self.tally.out_of_range, error.to_string()),
        };
        *count += 1;
        if *count == 1 {
            tell("isotherm", format!("frame {}: {message}; it is not a sample; later ones are counted", self.sequence));
        }
        if self.has_sample {
            self.tally.missing += 1;
            self.tally.gaps += u64::from(std::mem::take(&mut self.last_has_sample));
        }
    }

    /// The device was away: what waits is handed out.
    pub(crate) fn outage(&mut self, sink: &mut dyn FnMut(RawSample, u64)) {
        self.settle(sink);
        self.tally.outages += 1;
        self.after_outage = true;
        self.assembler.forget();
        self.thermometer.forget();
    }
}

/// The clock of IIO's stamps.
const STAMPS: crate::timeline::DeviceClock = crate::timeline::DeviceClock { turn_ns: None };
