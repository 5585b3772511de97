//! From rows to samples: each gets its period, its time and its number.

use crate::description::{Description, Kind};
use crate::frames::{Arrival, Found};
use crate::health::Health;
use crate::link::Soaked;
use crate::number::Value;
use crate::sample::{Assembler, NoSample, Telemetry};
use crate::tally::{Tally, of_described};
use crate::timeline::{Counter, Observed, Placed, RATE_LIMIT, Timeline};
use isotherm_client::RawSample;
use isotherm_failure::{Exit, Failure, tell};

/// Gaps that are told one by one; the tally has all.
const TOLD_GAPS: u64 = 10;
/// So many new sessions without ten regular frames in between show a counter that is not as described.
const RESTARTS: u64 = 20;
/// By how much bytes may come late \[s\] without a device being taken for slow or fast: a busy machine, or what lay in
/// the line's buffer at the beginning.
const LATE_S: f64 = 0.25;
/// How long the rate is measured before it is judged \[s\], and before it is warned of.
const JUDGED_S: f64 = 2.0;
const WARNED_S: f64 = 10.0;
/// A deviation of the rate that is warned of.
const WARNED: f64 = 1e-3;
/// A device whose own clock or counter began so long ago was just powered \[ns\], unless it may have turned: it turns
/// within less than a day \[ns\].
const JUST_POWERED_NS: u64 = 10_000_000_000;
const LONG_TURN_NS: u128 = 86_400_000_000_000;

/// Makes samples of rows, and counts.
pub(crate) struct Intake {
    description: Description,
    /// How long a byte takes on the line \[ns\].
    byte_ns: f64,
    timeline: Timeline,
    assembler: Assembler,
    sequence: u64,
    /// The time of the last frame \[ns\].
    last_ns: u64,
    /// Whether this session has a sample, and whether its last period has one.
    has_sample: (bool, bool),
    /// What happened since the last frame that was placed: the device was away, and frames were damaged.
    after_outage: bool,
    damaged: u64,
    /// New sessions since the last ten regular frames, and regular frames since the last one.
    restarts: (u64, u64),
    warned_of_rate: bool,
    /// When the rate was off, by both clocks since it is measured \[s\].
    suspected: Option<(f64, f64)>,
    last_arrival: Option<Arrival>,
    health: Health,
    /// Where the device is taken to be soaked.
    pub(crate) soaked: Soaked,
    pub(crate) tally: Tally,
}

/// When a row came, and what it took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Came {
    /// `None` for rows that do not come at their time.
    pub(crate) arrival: Option<Arrival>,
    pub(crate) bytes: usize,
    pub(crate) damaged: u64,
    /// The time of the row, on the clock of its arrival \[ns\].
    pub(crate) stamp: Option<u64>,
}

impl Came {
    pub(crate) fn of(found: &Found<'_>, is_live: bool) -> Self {
        let arrival = is_live.then_some(found.arrival);
        Self { arrival, bytes: found.bytes, damaged: found.damaged, stamp: None }
    }
}

impl Intake {
    /// `stamped`: rows have a time of their own.
    pub(crate) fn new(description: &Description, byte_ns: f64, stamped: bool) -> Self {
        let timing = &description.timing;
        let clock = if stamped { Some(STAMPS) } else { timing.clock.map(|(.., clock)| clock) };
        Self {
            timeline: Timeline::new(timing.interval_ns, timing.counter.map(|(_, counter)| counter), clock),
            assembler: Assembler::new(description.columns),
            byte_ns,
            sequence: 0,
            last_ns: 0,
            has_sample: (false, false),
            after_outage: false,
            damaged: 0,
            restarts: (0, 0),
            warned_of_rate: false,
            suspected: None,
            last_arrival: None,
            health: Health::default(),
            soaked: Soaked::default(),
            tally: Tally { imu: description.imu.to_string(), ..Tally::default() },
            description: description.clone(),
        }
    }

    /// Takes a row. Returns the sample, with the number of its session from 1, if it is one.
    pub(crate) fn take(&mut self, row: &[Value], came: Came) -> Option<(RawSample, u64)> {
        self.tally.frames += 1;
        self.damaged += came.damaged;
        let timing = self.description.timing;
        let value = |column: usize| row.get(column).copied().unwrap_or(Value::ABSENT);
        let latency = timing.latency.map_or(0.0, |(column, unit)| value(column).number * unit);
        let late = came.bytes as f64 * self.byte_ns + if latency.is_finite() { latency.max(0.0) } else { 0.0 };
        let earlier = |at: u64| at.saturating_sub(late as u64);
        let arrival = came
            .arrival
            .map(|Arrival { after_ns, by_ns }| Arrival { after_ns: earlier(after_ns), by_ns: earlier(by_ns) });
        self.last_arrival = arrival;
        let clock_ns = timing.clock.and_then(|(column, unit_ns, _)| {
            let value = value(column);
            // With a fraction, as seconds in a text, or a unit of its own.
            let rounded = (value.number * unit_ns as f64).round();
            let whole = value.whole.filter(|_| value.number >= 0.0).map(|whole| whole.saturating_mul(unit_ns));
            whole.or((0.0..1.8e19).contains(&rounded).then_some(rounded as u64))
        });
        let observed = Observed {
            arrival,
            counter: timing.counter.and_then(|(column, _)| value(column).whole),
            clock_ns: came.stamp.or(clock_ns),
            damaged: self.damaged,
            after_outage: self.after_outage,
        };
        if self.has_items() && !self.assembler.has_sensors(row) {
            // Another message of the device, as one of its GNSS receiver.
            self.tally.others += 1;
            self.assembler.take_telemetry(row, self.last_ns);
            return None;
        }
        if timing.counter.is_some() && observed.counter.is_none()
            || timing.clock.is_some() && observed.clock_ns.is_none()
        {
            self.tally.incomplete += 1;
            return None;
        }
        (self.damaged, self.after_outage) = (0, false);
        let timestamp_ns = match self.timeline.place(observed) {
            Placed::Repeated => {
                self.tally.repeated += 1;
                return None;
            }
            Placed::First { timestamp_ns } => {
                self.begin_session();
                self.note_power(&observed, timestamp_ns);
                timestamp_ns
            }
            Placed::Next { periods, timestamp_ns, is_ambiguous } => {
                self.pass(periods, is_ambiguous);
                timestamp_ns
            }
        };
        self.last_ns = timestamp_ns;
        self.sample(row, timestamp_ns)
    }

    /// Whether frames may lack the sensors.
    fn has_items(&self) -> bool {
        matches!(&self.description.kind, Kind::Frames(_, frame) if frame.items.is_some())
    }

    fn begin_session(&mut self) {
        self.tally.sessions += 1;
        if self.tally.sessions > 1 {
            tell("isotherm", "the device has started again, or was away for over a turn of its counter: a new session");
        }
        self.restarts = (self.restarts.0 + 1, 0);
        self.sequence = 0;
        self.has_sample = (false, false);
        self.assembler.reset();
    }

    /// Notes whether the device is taken to be soaked, since its own clock or counter has just begun.
    fn note_power(&mut self, observed: &Observed, timestamp_ns: u64) {
        let timing = &self.description.timing;
        let session = self.tally.sessions;
        if matches!(self.description.columns.telemetry, Telemetry::Constant(_)) {
            // What never changes has no lag.
            self.soaked = Soaked { session, until_ns: u64::MAX };
            return;
        }
        let ns = |counts: u64, step: u64| u128::from(counts) * u128::from(timing.interval_ns) / u128::from(step.max(1));
        let of_counter = timing.counter.zip(observed.counter).map(|((_, Counter { bits, step }), counter)| {
            let most = u64::MAX >> (64 - bits.clamp(1, 64));
            (ns(counter & most, step), ns(most, step))
        });
        // A stamp of the kernel is no clock of the device.
        let of_clock = timing
            .clock
            .zip(observed.clock_ns)
            .map(|((.., clock), clock_ns)| (u128::from(clock_ns), clock.turn_ns.map_or(u128::MAX, u128::from)));
        let is_new = |(since_ns, turn_ns): (u128, u128)| since_ns < JUST_POWERED_NS.into() && turn_ns >= LONG_TURN_NS;
        if [of_counter, of_clock].into_iter().flatten().any(is_new) {
            self.soaked = Soaked { session, until_ns: timestamp_ns.saturating_add(JUST_POWERED_NS) };
        }
    }

    /// Counts the periods up to this frame.
    fn pass(&mut self, periods: u64, is_ambiguous: bool) {
        self.restarts.1 += 1;
        if self.restarts.1 >= 10 {
            self.restarts.0 = 0;
        }
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
            let last = if self.tally.gaps == TOLD_GAPS { "; later ones are in the tally alone" } else { "" };
            let sequence = self.sequence;
            tell("isotherm", format!("gap: {missing} missing{uncertain} before sequence {sequence}{last}"));
        }
    }

    fn sample(&mut self, row: &[Value], timestamp_ns: u64) -> Option<(RawSample, u64)> {
        match self.assembler.sample(row, timestamp_ns) {
            Ok((raw, unhealthy)) => {
                self.tally.samples += 1;
                self.tally.unhealthy += u64::from(unhealthy != 0);
                self.health.note(unhealthy);
                self.has_sample = (true, true);
                Some((RawSample { sequence: self.sequence, ..raw }, self.tally.sessions))
            }
            Err(why) => {
                self.missing_sample(&why);
                None
            }
        }
    }

    /// A frame that is no sample: its period is missing, unless the session has no sample before it.
    fn missing_sample(&mut self, why: &NoSample) {
        let (count, message) = match why {
            NoSample::Incomplete => {
                (&mut self.tally.incomplete, "has not all columns of the sensors, or one that is no number".to_owned())
            }
            NoSample::NoTemperature => {
                (&mut self.tally.without_temperature, "comes before the first temperature".to_owned())
            }
            NoSample::OutOfRange(error) => (&mut self.tally.out_of_range, error.to_string()),
        };
        *count += 1;
        if *count == 1 {
            tell("isotherm", format!("frame {}: {message}; it is no sample; later ones are counted", self.sequence));
        }
        let (has_begun, has_last) = &mut self.has_sample;
        if *has_begun {
            self.tally.missing += 1;
            self.tally.gaps += u64::from(std::mem::take(has_last));
        }
    }

    /// The device was away.
    pub(crate) const fn outage(&mut self) {
        self.tally.outages += 1;
        self.after_outage = true;
        self.assembler.forget();
    }

    /// Whether the rate is another one: it is off by more than late bytes explain, and goes on to be. A device or a
    /// machine that stood still once is measured anew.
    fn is_other_rate(&mut self, deviation: f64, seconds: f64) -> bool {
        let nominal = seconds / (1.0 + deviation);
        if (deviation.abs() - RATE_LIMIT) * nominal <= LATE_S {
            self.suspected = None;
            return false;
        }
        match self.suspected {
            Some((since, before)) if seconds >= since => {
                if seconds - since < JUDGED_S {
                    return false;
                }
                let now = (seconds - since) / (nominal - before).max(f64::EPSILON) - 1.0;
                if now.abs() > RATE_LIMIT && now.signum() == deviation.signum() {
                    return true;
                }
                self.suspected = None;
                self.timeline.measure_anew(self.last_arrival);
            }
            _ => self.suspected = Some((seconds, nominal)),
        }
        false
    }

    /// Judges the rate.
    ///
    /// # Errors
    /// If it is not that of the description, or if the counter is not.
    pub(crate) fn judge(&mut self) -> Result<(), Failure> {
        let nominal = self.description.timing.interval_ns as f64;
        if self.restarts.0 > RESTARTS {
            let message = format!(
                "{} new sessions within {} frames: the counter or the clock does not rise as described; compare \
                 timing.counter.step and bits, or timing.time, with the data sheet",
                self.restarts.0, self.tally.frames
            );
            return Err(Failure::new(Exit::Config, message));
        }
        let Some((deviation, seconds)) = self.timeline.deviation(self.last_arrival) else { return Ok(()) };
        if seconds < JUDGED_S {
            return Ok(());
        }
        let measured = nominal * (1.0 + deviation);
        (self.tally.rate_hz, self.tally.deviation_ppm) = (1e9 / measured, deviation * 1e6);
        let compared = format!(
            "the device sends {:.6} Hz, an interval of {:.9} s, and timing.interval_s is {:.9}",
            1e9 / measured,
            measured / 1e9,
            nominal / 1e9
        );
        if self.is_other_rate(deviation, seconds) {
            let remedy = "give the interval that the device is set to, or set the device";
            return Err(Failure::new(Exit::Config, format!("{compared}; {remedy}")));
        }
        if deviation.abs() > WARNED && seconds > WARNED_S && !self.warned_of_rate {
            self.warned_of_rate = true;
            tell("isotherm", format!("warning: {compared}: {}", of_described(deviation)));
        }
        Ok(())
    }
}

/// The clock of IIO's stamps.
const STAMPS: crate::timeline::DeviceClock = crate::timeline::DeviceClock { turn_ns: None };
