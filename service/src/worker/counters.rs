//! Counters that a worker writes and the control thread reads. Writer and reader are types, so that a second writer
//! does not compile.
//!
//! Only the one writer stores: it needs no atomic addition, a load and a store are enough. Different counters may be of
//! different moments. Only what is computed with two of them is ordered: a counted sample has its session, and a device
//! is reported with the table of its samples.
//!
//! A second writer does not compile:
//! ```compile_fail,E0599
//! let (writer, reader) = isotherm_service::worker::counters::counters();
//! let second = writer.clone();
//! ```
//! A second reader compiles:
//! ```
//! let (writer, reader) = isotherm_service::worker::counters::counters();
//! let second = reader.clone();
//! ```
//! Two threads that write do not compile. Stable Rust does not compare the error code, but the example below differs in
//! one line only, and it compiles:
//! ```compile_fail,E0499
//! let (mut writer, reader) = isotherm_service::worker::counters::counters();
//! std::thread::scope(|scope| {
//!     scope.spawn(|| writer.transport_failed());
//!     scope.spawn(|| writer.transport_failed());
//! });
//! ```
//! One thread that writes and one that reads compile:
//! ```
//! let (mut writer, reader) = isotherm_service::worker::counters::counters();
//! std::thread::scope(|scope| {
//!     scope.spawn(|| writer.transport_failed());
//!     scope.spawn(|| reader.transport_errors());
//! });
//! ```

use super::histogram::{BucketCounts, Histogram};
use isotherm_client::sync::AtomicU64;
use isotherm_shared::protocol::{Arrival, LastSession};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::{AXES, Flags, RawSample};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::{Arc, OnceLock};

/// How many flags are counted: bits 0 to 50.
const FLAGS: usize = 51;
/// The bit of [`Flags::OTHER_DEVICE`].
const OTHER_DEVICE: usize = Flags::OTHER_DEVICE.0.trailing_zeros() as usize;
/// Head and board temperature of both triads.
const TEMPERATURE: usize = 4 * AXES;

/// The counters of one IMU since the start of the service.
#[derive(Debug, Default)]
struct Counters {
    received: AtomicU64,
    compensated: AtomicU64,
    gaps: AtomicU64,
    missing: AtomicU64,
    repeats: AtomicU64,
    sessions: AtomicU64,
    session_missing: AtomicU64,
    session_unknown: AtomicU64,
    /// Session of the last sample that was no resend.
    session: AtomicU64,
    /// That sample, after the end.
    last: OnceLock<LastSession>,
    transport_errors: AtomicU64,
    flagged: FlagCounts,
    table: AtomicU64,
    /// Which other device than that of the table in force the last sample came from; 0 if it came from none, or before
    /// the table.
    last_other_device: AtomicU64,
    /// The same of the last sample that had [`Flags::OTHER_DEVICE`].
    other_device: AtomicU64,
    /// Time constant of the lagged temperature of the last sample \[ns\].
    lag_ns: AtomicU64,
    /// Age of the temperature of the last sample \[s\], as bits of an `f64`; NaN if it is not given.
    temperature_age: AtomicU64,
    /// Whether the last increment was flagged stale.
    is_stale: AtomicBool,
    /// Temperature of the last sample, as bits of an `f64`: heads and boards of the accelerometers, then of
    /// the gyroscopes.
    temperature: [AtomicU64; TEMPERATURE],
    latency: Histogram,
}

/// How many increments had each flag, by bit.
#[derive(Debug)]
struct FlagCounts([AtomicU64; FLAGS]);

impl Default for FlagCounts {
    fn default() -> Self {
        Self([const { AtomicU64::new(0) }; FLAGS])
    }
}

/// A sample's unit that is not the unit of the table that the sample was answered with.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct DeviceMismatch {
    /// Number of the sample's unit.
    pub device: u64,
    /// Id of the table.
    pub table: u64,
}

/// New counters of one IMU: the half that writes and the half that reads.
#[must_use]
pub fn counters() -> (CounterWriter, CounterReader) {
    let counters = Arc::<Counters>::default();
    (CounterWriter(Arc::clone(&counters)), CounterReader(counters))
}

/// The half that writes. There is only one; the worker has it.
#[derive(Debug)]
pub struct CounterWriter(Arc<Counters>);

/// The half that reads.
#[derive(Clone, Debug)]
pub struct CounterReader(Arc<Counters>);

/// Adds to a counter. Only the counter's one writer may call it.
#[inline]
fn add(counter: &AtomicU64, by: u64) {
    counter.store(counter.load(Relaxed).saturating_add(by), Relaxed);
}

impl CounterWriter {
    /// The table with this id ([`CoefficientTable::id`](isotherm_shared::table::CoefficientTable::id)) is in force for
    /// all further samples. What is known of other devices than its own begins anew.
    #[inline]
    pub fn table_taken(&mut self, id: u64) {
        let counters = &*self.0;
        counters.last_other_device.store(0, Relaxed);
        counters.other_device.store(0, Relaxed);
        counters.flagged.0[OTHER_DEVICE].store(0, Relaxed);
        counters.table.store(id, Release);
    }

    /// Receiving or publishing failed in the transport.
    #[inline]
    pub fn transport_failed(&mut self) {
        add(&self.0.transport_errors, 1);
    }

    /// No more samples are served; this was the last one.
    pub fn ended(&mut self, last: LastSession) {
        // There is one end.
        let _ = self.0.last.set(last);
    }

    /// A sample was received, and its increment published unless the transport failed.
    #[inline]
    pub fn answered(&mut self, raw: &RawSample, arrival: Arrival, flags: Flags, latency_ns: u64, published: bool) {
        let counters = &*self.0;
        counters.lag_ns.store(raw.lag_ns, Relaxed);
        let has_age = raw.temperature_time_ns() != 0 && raw.timestamp_ns != 0;
        let age_s = if has_age { raw.temperature_age_s() } else { f64::NAN };
        counters.temperature_age.store(age_s.to_bits(), Relaxed);
        counters.is_stale.store(flags.intersects(Flags::TELEMETRY_STALE), Relaxed);
        if !arrival.repeated {
            counters.session.store(raw.session, Relaxed);
        }
        let is_other = flags.intersects(Flags::OTHER_DEVICE);
        counters.last_other_device.store(if is_other { raw.device } else { 0 }, Release);
        if is_other {
            counters.other_device.store(raw.device, Release);
        }
        let [a, g] = [&raw.accelerometers, &raw.gyroscopes];
        let temperature = [a.head_temperature, a.board_temperature, g.head_temperature, g.board_temperature];
        for (kept, value) in counters.temperature.iter().zip(temperature.as_flattened()) {
            kept.store(value.to_bits(), Relaxed);
        }
        // After its session: a note for the next service is made of it.
        counters.received.store(counters.received.load(Relaxed).saturating_add(1), Release);
        add(if published { &counters.compensated } else { &counters.transport_errors }, 1);
        if arrival.missing > 0 {
            add(&counters.gaps, 1);
            add(&counters.missing, arrival.missing);
        }
        if arrival.repeated {
            add(&counters.repeats, 1);
        }
        if arrival.begins {
            add(&counters.sessions, 1);
        }
        match arrival.change.map(|change| change.missing) {
            Some(Some(missing)) => add(&counters.session_missing, missing),
            Some(None) => add(&counters.session_unknown, 1),
            None => {}
        }
        let mut rest = flags.0;
        while rest != 0 {
            if let Some(counter) = counters.flagged.0.get(rest.trailing_zeros() as usize) {
                add(counter, 1);
            }
            rest &= rest - 1;
        }
        counters.latency.record(u32::try_from(latency_ns).unwrap_or(u32::MAX));
    }
}

impl CounterReader {
    /// Raw samples received.
    pub fn received(&self) -> u64 {
        self.0.received.load(Acquire)
    }

    /// Increments published.
    pub fn compensated(&self) -> u64 {
        self.0.compensated.load(Relaxed)
    }

    /// Gaps: samples before which others of their session were missing.
    pub fn gaps(&self) -> u64 {
        self.0.gaps.load(Relaxed)
    }

    /// How many samples were missing in all gaps.
    pub fn missing(&self) -> u64 {
        self.0.missing.load(Relaxed)
    }

    /// Resends: samples whose sequence number was not above the highest of their session.
    pub fn repeats(&self) -> u64 {
        self.0.repeats.load(Relaxed)
    }

    /// Sessions that have begun.
    pub fn sessions(&self) -> u64 {
        self.0.sessions.load(Relaxed)
    }

    /// Control periods between two sessions, in sum, where they are known.
    pub fn session_missing(&self) -> u64 {
        self.0.session_missing.load(Relaxed)
    }

    /// How often another session followed after an unknown time.
    pub fn session_unknown(&self) -> u64 {
        self.0.session_unknown.load(Relaxed)
    }

    /// The session of the last sample that was no resend, with that sample after the end; `None` before the first.
    pub fn last_session(&self) -> Option<LastSession> {
        let session = || LastSession { session: self.0.session.load(Relaxed), last: None };
        (self.received() > 0).then(|| self.0.last.get().copied().unwrap_or_else(session))
    }

    /// Failures of the transport.
    pub fn transport_errors(&self) -> u64 {
        self.0.transport_errors.load(Relaxed)
    }

    /// Increments that carried the flag of this bit.
    pub fn flagged(&self, bit: u32) -> u64 {
        self.0.flagged.0.get(bit as usize).map_or(0, |count| count.load(Relaxed))
    }

    /// Id of the table in force, 0 for none.
    pub fn table(&self) -> u64 {
        self.0.table.load(Relaxed)
    }

    /// The unit of the last sample, if that is not the unit of its table, and the id of that table.
    pub fn last_other_device(&self) -> Option<DeviceMismatch> {
        self.of_table(&self.0.last_other_device)
    }

    /// The unit of the last sample that was not of its table's unit, and the id of that table; `None` if no sample has
    /// come from another device since the table was taken.
    pub fn other_device(&self) -> Option<DeviceMismatch> {
        self.of_table(&self.0.other_device)
    }

    /// A unit and the table that its sample was answered with; `None` also while the worker takes another table.
    fn of_table(&self, device: &AtomicU64) -> Option<DeviceMismatch> {
        let table = self.0.table.load(Acquire);
        let device = device.load(Acquire);
        (device != 0 && self.0.table.load(Relaxed) == table).then_some(DeviceMismatch { device, table })
    }

    /// Time constant of the lagged temperature of the last sample \[ns\], 0 if it has none.
    pub fn lag_ns(&self) -> u64 {
        self.0.lag_ns.load(Relaxed)
    }

    /// Age of the temperature of the last sample \[s\]; `None` if it is not given, or no sample has come yet.
    pub fn temperature_age_s(&self) -> Option<f64> {
        let age_s = f64::from_bits(self.0.temperature_age.load(Relaxed));
        (self.received() > 0 && age_s.is_finite()).then_some(age_s)
    }

    /// Whether the last increment was flagged stale.
    pub fn is_stale(&self) -> bool {
        self.0.is_stale.load(Relaxed)
    }

    /// Temperature of a triad in the last sample, heads and boards; `None` where it is not finite or no sample has come
    /// yet.
    pub fn temperature(&self, kind: SensorKind) -> [[Option<f64>; AXES]; 2] {
        let has_sample = self.received() > 0;
        let value = |place: usize| {
            let value = f64::from_bits(self.0.temperature[place].load(Relaxed));
            (has_sample && value.is_finite()).then_some(value)
        };
        let heads = match kind {
            SensorKind::Accelerometer => 0,
            SensorKind::Gyroscope => 2 * AXES,
        };
        [heads, heads + AXES].map(|first| core::array::from_fn(|axis| value(first + axis)))
    }

    /// Latencies of all increments.
    pub fn latency(&self) -> BucketCounts {
        self.0.latency.counts()
    }
}

/// A new heartbeat of a thread: the half that beats, and the half that counts the beats.
#[must_use]
pub fn heartbeat() -> (HeartbeatWriter, HeartbeatReader) {
    let beats = Arc::<AtomicU64>::default();
    (HeartbeatWriter(Arc::clone(&beats)), HeartbeatReader(beats))
}

/// The half that beats; the worker has it.
#[derive(Debug)]
pub struct HeartbeatWriter(Arc<AtomicU64>);

/// The half that reads the count.
#[derive(Clone, Debug)]
pub struct HeartbeatReader(Arc<AtomicU64>);

impl HeartbeatWriter {
    /// Adds a beat.
    #[inline]
    pub fn beat(&mut self) {
        add(&self.0, 1);
    }
}

impl HeartbeatReader {
    /// How many beats there were since the start.
    pub fn count(&self) -> u64 {
        self.0.load(Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::wire::Triad;

    #[test]
    fn temperature_is_given_only_when_it_has_come_and_is_finite() {
        let (mut writer, reader) = counters();
        let temperature = || [SensorKind::Accelerometer, SensorKind::Gyroscope].map(|kind| reader.temperature(kind));
        assert_eq!(temperature(), [[[None; 3]; 2]; 2]);
        let triad =
            |head_temperature, board_temperature| Triad { head_temperature, board_temperature, ..Triad::default() };
        let raw = RawSample {
            accelerometers: triad([1.0, f64::NAN, -3.0], [4.0, 5.0, f64::INFINITY]),
            gyroscopes: triad([6.0, 7.0, 8.0], [9.0, f64::NEG_INFINITY, -11.0]),
            ..RawSample::default()
        };
        writer.answered(&raw, Arrival::default(), Flags(0), 100, true);
        let expected = [
            [[Some(1.0), None, Some(-3.0)], [Some(4.0), Some(5.0), None]],
            [[Some(6.0), Some(7.0), Some(8.0)], [Some(9.0), None, Some(-11.0)]],
        ];
        assert_eq!(temperature(), expected);
    }

    #[test]
    fn flags_are_counted_by_bit() {
        let (mut writer, reader) = counters();
        let last = Flags::rate(2).of_gyroscopes();
        for flags in [Flags::GAP | Flags::head_below(0), Flags::GAP | last, Flags(1 << 63)] {
            writer.answered(&RawSample::default(), Arrival::default(), flags, 0, true);
        }
        let counts: Vec<_> = (0..64).map(|bit| reader.flagged(bit)).collect();
        assert_eq!((counts[24], counts[0], counts[49], counts.iter().sum::<u64>()), (2, 1, 1, 4));
        assert!(Flags::NAMES.iter().all(|(bit, _)| (*bit as usize) < FLAGS), "every flag has a counter");
    }

    #[test]
    fn the_other_unit_is_kept_when_the_right_one_returns() {
        let (mut writer, reader) = counters();
        for (device, flags) in [(1, Flags(0)), (2, Flags::OTHER_DEVICE), (1, Flags(0))] {
            let raw = RawSample { device, ..RawSample::default() };
            writer.answered(&raw, Arrival::default(), flags, 0, true);
        }
        assert_eq!(
            (reader.last_other_device(), reader.other_device()),
            (None, Some(DeviceMismatch { device: 2, table: 0 }))
        );
    }

    #[test]
    fn other_units_are_counted_for_the_table_in_force() {
        let (mut writer, reader) = counters();
        let raw = RawSample { device: 2, ..RawSample::default() };
        let found = || (reader.last_other_device(), reader.other_device(), reader.flagged(OTHER_DEVICE as u32));
        for table in [7, 8] {
            writer.table_taken(table);
            assert_eq!(found(), (None, None, 0));
            for number in 1..=3 {
                writer.answered(&raw, Arrival::default(), Flags::OTHER_DEVICE, 0, true);
                let other = Some(DeviceMismatch { device: 2, table });
                assert_eq!(found(), (other, other, number));
            }
        }
        assert_eq!(reader.received(), 6);
    }
}

#[cfg(test)]
#[cfg(isotherm_loom)]
mod explored {
    use super::*;
    use isotherm_client::sync::{explore, thread};

    #[test]
    fn explored_a_counted_sample_has_its_session() {
        let found = explore(|| {
            let (mut writer, reader) = counters();
            let looking = {
                let reader = reader.clone();
                thread::spawn(move || {
                    let session = reader.last_session().map(|last| last.session);
                    assert!(session.is_none_or(|session| session == 7), "{session:?}");
                })
            };
            let raw = RawSample { session: 7, ..RawSample::default() };
            writer.answered(&raw, Arrival::default(), Flags::default(), 0, true);
            looking.join().unwrap();
        });
        assert_eq!(found.needed.len(), 2, "{found:?}");
    }

    /// A worker takes tables while another thread looks. The unit of each table's samples is ten times its id.
    #[test]
    fn explored_another_device_is_found_with_the_table_of_its_sample() {
        for look in [CounterReader::other_device, CounterReader::last_other_device] {
            let found = explore(move || {
                let (mut writer, reader) = counters();
                let looking = {
                    let reader = reader.clone();
                    thread::spawn(move || {
                        let found = look(&reader);
                        assert!(found.is_none_or(|DeviceMismatch { device, table }| device == 10 * table), "{found:?}");
                    })
                };
                for table in 1..=2 {
                    writer.table_taken(table);
                    let raw = RawSample { device: 10 * table, ..RawSample::default() };
                    writer.answered(&raw, Arrival::default(), Flags::OTHER_DEVICE, 0, true);
                }
                looking.join().unwrap();
                assert_eq!(look(&reader), Some(DeviceMismatch { device: 20, table: 2 }));
            });
            assert_eq!(found.needed.len(), 4, "{found:?}");
        }
    }
}
