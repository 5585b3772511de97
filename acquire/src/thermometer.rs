//! How old the temperature is: when it is stale, and that it never comes.
//!
//! The pace of a thermometer shows in its last readings. A reading is a finite value that has come in a row, whether or
//! not it is another one than before. A device that repeats its last temperature in every row therefore seems to have
//! a thermometer that is alive.

use crate::description::{Description, Kind};
use crate::number::Value;
use crate::sample::TemperatureColumns;
use isotherm_recording_formats::convert::{ColumnRef, Temperature};
use isotherm_support::failure::tell;

const SECOND_NS: u64 = 1_000_000_000;
/// A temperature is stale that is older than this many of the longest distance between its last readings.
const DISTANCES: u64 = 5;
/// Distances that are looked at, and those that show the pace.
const LAST: usize = 20;
const ENOUGH: usize = 3;
/// No temperature is stale before this age \[ns\], and before the pace is known.
const LEAST_NS: u64 = 5 * SECOND_NS;
const UNKNOWN_NS: u64 = 60 * SECOND_NS;
/// Pause between two messages that a temperature is stale \[ns\], on the clock of the samples.
const PAUSE_NS: u64 = 60 * SECOND_NS;
/// How often it is said that samples wait for a temperature \[ns\], on that clock.
const WAITING_NS: u64 = 10 * SECOND_NS;

/// The ages at which temperatures are stale.
#[derive(Clone, Copy, Debug)]
struct AgeLimits {
    /// What the description says \[ns\].
    given_ns: Option<u64>,
    /// Once the pace is known, at least \[ns\]; and before.
    least_ns: u64,
    unknown_ns: u64,
}

/// One column of temperatures.
#[derive(Debug)]
struct TemperatureColumn {
    /// Its place in a row.
    place: usize,
    name: String,
    /// Whether a value has come since the device was away.
    is_there: bool,
    /// When it came last, in this session \[ns\]; `None` if that is not known.
    last_ns: Option<u64>,
    /// From where its age is counted then: the first sample \[ns\].
    since_ns: Option<u64>,
    /// The last distances between readings \[ns\], the oldest in place of the next one.
    distances: [u64; LAST],
    count: usize,
    is_stale: bool,
}

/// The thermometer of a device.
#[derive(Debug)]
pub(crate) struct Thermometer {
    /// None for a temperature that is always the same.
    columns: Vec<TemperatureColumn>,
    limits: AgeLimits,
    /// When it was said last that the temperature is stale \[ns\], and whether its end is to be said.
    told_ns: Option<u64>,
    is_told: bool,
    /// Since when samples wait for a temperature, and when it was said last \[ns\].
    waiting_ns: Option<[u64; 2]>,
}

impl TemperatureColumn {
    fn take(&mut self, now_ns: Option<u64>) {
        if let (Some(last_ns), Some(now_ns)) = (self.last_ns, now_ns)
            && now_ns > last_ns
        {
            self.distances[self.count % LAST] = now_ns - last_ns;
            self.count += 1;
        }
        (self.is_there, self.is_stale) = (true, false);
        (self.last_ns, self.since_ns) = (now_ns, None);
    }

    fn limit_ns(&self, limits: &AgeLimits) -> u64 {
        let longest_ns = self.distances.iter().fold(0, |longest, distance| longest.max(*distance));
        let of_pace = || match self.count {
            0..ENOUGH => limits.unknown_ns,
            _ => longest_ns.saturating_mul(DISTANCES).max(limits.least_ns),
        };
        limits.given_ns.unwrap_or_else(of_pace)
    }
}

impl Thermometer {
    pub(crate) fn new(description: &Description) -> Self {
        let mut columns: Vec<TemperatureColumn> = Vec::new();
        for (place, name) in description.temperature_places() {
            if columns.iter().all(|column| column.place != place) {
                let (distances, count) = ([0; LAST], 0);
                let (is_there, is_stale, last_ns, since_ns) = (false, false, None, None);
                columns.push(TemperatureColumn {
                    place,
                    name,
                    is_there,
                    last_ns,
                    since_ns,
                    distances,
                    count,
                    is_stale,
                });
            }
        }
        let given = description.sensors.temperature_max_age_s;
        let polled_ns = match &description.kind {
            Kind::Iio(settings) => settings.poll_ns.saturating_mul(DISTANCES),
            _ => 0,
        };
        let limits = AgeLimits {
            given_ns: given.map(|seconds| (seconds * 1e9) as u64),
            least_ns: LEAST_NS.max(polled_ns),
            unknown_ns: UNKNOWN_NS.max(polled_ns),
        };
        Self { columns, limits, told_ns: None, is_told: false, waiting_ns: None }
    }

    /// Takes the temperatures of a row of this time \[ns\], which is 0 before the first one that has a time.
    pub(crate) fn take(&mut self, row: &[Value], now_ns: u64) {
        for column in &mut self.columns {
            if row.get(column.place).is_some_and(|value| value.number.is_finite()) {
                column.take((now_ns != 0).then_some(now_ns));
            }
        }
    }

    /// Another session begins, whose times may be of another clock: the ages are counted anew, but what is stale stays
    /// so.
    pub(crate) fn begin_session(&mut self) {
        self.columns.iter_mut().for_each(|column| (column.last_ns, column.since_ns) = (None, None));
        self.waiting_ns = None;
    }

    /// The device was away, and its temperatures are forgotten. The pace is that of before.
    pub(crate) fn forget(&mut self) {
        self.begin_session();
        for column in &mut self.columns {
            (column.is_there, column.is_stale) = (false, false);
        }
    }

    /// Whether the temperature of a sample of this time \[ns\] is stale, which is said.
    pub(crate) fn is_stale(&mut self, now_ns: u64) -> bool {
        let (is_stale, text) = self.judge(now_ns);
        if let Some(text) = text {
            tell("isotherm", text);
        }
        is_stale
    }

    /// Whether the temperature of a sample of this time \[ns\] is stale, and what is to be said of it: at the
    /// beginning, then once a minute, and at the end if the beginning was said.
    pub(crate) fn judge(&mut self, now_ns: u64) -> (bool, Option<String>) {
        self.waiting_ns = None;
        let mut oldest: Option<(u64, u64, &str)> = None;
        for column in &mut self.columns {
            let since_ns = column.last_ns.unwrap_or_else(|| *column.since_ns.get_or_insert(now_ns));
            let age_ns = now_ns.saturating_sub(since_ns);
            let limit_ns = column.limit_ns(&self.limits);
            column.is_stale |= age_ns > limit_ns;
            if column.is_stale && oldest.is_none_or(|(before_ns, ..)| age_ns > before_ns) {
                oldest = Some((age_ns, limit_ns, &column.name));
            }
        }
        let Some((age_ns, limit_ns, name)) = oldest else {
            let is_back = std::mem::take(&mut self.is_told);
            return (false, is_back.then(|| "the temperature has come again".to_owned()));
        };
        // The clock may have begun anew.
        if self.told_ns.is_some_and(|told_ns| now_ns.abs_diff(told_ns) < PAUSE_NS) {
            return (true, None);
        }
        (self.told_ns, self.is_told) = (Some(now_ns), true);
        let [age_s, limit_s] = [age_ns, limit_ns].map(|ns| ns as f64 / 1e9);
        let text = format!(
            "warning: the temperature of {name} is {age_s:.1} s old, and it is stale after {limit_s:.1} s: increments are computed \
             with it and flagged telemetry-stale; look at the thermometer, or give temperature_max_age_s"
        );
        (true, Some(text))
    }

    /// A frame of this time \[ns\] waits for the first temperature, which is said from time to time.
    pub(crate) fn wait(&mut self, now_ns: u64) {
        if let Some(text) = self.waiting_text(now_ns) {
            tell("isotherm", text);
        }
    }

    /// What is to be said every ten seconds while samples wait for a temperature.
    pub(crate) fn waiting_text(&mut self, now_ns: u64) -> Option<String> {
        let [since_ns, told_ns] = self.waiting_ns.get_or_insert([now_ns; 2]);
        if now_ns.saturating_sub(*told_ns) < WAITING_NS {
            return None;
        }
        *told_ns = now_ns;
        let seconds = now_ns.saturating_sub(*since_ns) as f64 / 1e9;
        let missing: Vec<_> =
            self.columns.iter().filter(|column| !column.is_there).map(|of| of.name.as_str()).collect();
        let missing = missing.join(", ");
        Some(format!(
            "warning: no temperature of {missing} has come for {seconds:.0} s, and no sample is sent before it: is the \
             thermometer on, and its name right?"
        ))
    }
}

impl Description {
    /// The places of the temperatures in a row, and what they are called: their column or topic. None if the
    /// temperature is constant.
    fn temperature_places(&self) -> Vec<(usize, String)> {
        let (TemperatureColumns::Columns { head, board, .. }, Temperature::Columns { head: heads, board: boards, .. }) =
            (&self.columns.temperature, &self.sensors.temperature)
        else {
            return Vec::new();
        };
        let named = |places: &[usize], names: &[ColumnRef]| {
            let name = |sensor: usize| match names.get(sensor % names.len().max(1)) {
                Some(ColumnRef::Name(name)) => name.clone(),
                Some(ColumnRef::Number(number)) => format!("column {number}"),
                None => String::new(),
            };
            places.iter().enumerate().map(|(sensor, place)| (*place, name(sensor))).collect::<Vec<_>>()
        };
        [named(head, heads), named(board, boards)].concat()
    }
}
