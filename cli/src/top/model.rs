//! Everything that is on the screen: the recent statuses, the selection, and what is derived from them.

use super::style::{AlertLevel, Theme};
use isotherm_service::StatusWait;
use isotherm_shared::status::{ImuStatus, ServiceStatus};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use ratatui::widgets::TableState;
use std::collections::VecDeque;
use std::time::Duration;

/// Period of reading and drawing.
pub(super) const TICK: Duration = Duration::from_millis(200);
/// Shortest time that a rate is taken over \[ns\].
const RATE_NS: u64 = 1_000_000_000;
/// Time that the histogram covers \[ns\].
const MINUTE_NS: u64 = 60_000_000_000;
/// Fraction of the calibrated range at each of its ends in which a temperature is a warning.
const EDGE: f64 = 0.05;

/// What is on the screen.
pub(super) struct Model {
    /// The domain's name.
    pub domain: String,
    /// What the terminal can show.
    pub theme: Theme,
    /// Statuses about a second apart, the newest last. Only the newest may follow its predecessor sooner.
    history: VecDeque<ServiceStatus>,
    /// The wait for the service, if it does not answer.
    pub waiting: Option<StatusWait>,
    /// The selected row, and which rows are in view.
    pub table: TableState,
    /// Whether the picture is frozen.
    pub paused: bool,
    /// Whether the help is shown.
    pub help: bool,
}

/// The conditions of an IMU, the first that applies is shown; and what each means, with its remedy.
pub(crate) const STATES: &[(&str, &str)] = &[
    ("not served", "Bad: the service does not answer; the line above says why. It continues automatically."),
    ("stands still", "Bad: the worker's loop has not turned for a second: `isotherm explain stands_still`."),
    ("first table", "To be looked into: it waits for its first table, and increments are NaN: install the file."),
    ("no table", "Bad: the service has no table for it yet, and increments are NaN: install the file."),
    ("file REFUSED", "Bad: the table's file is not in force: `last_reload_error` of the status says why."),
    ("other device", "Bad: the samples are of another device than the table: `isotherm explain other-device`."),
    ("no acquisition", "To be looked into: no acquisition is connected."),
    ("no samples", "To be looked into: an acquisition is connected, and none of its samples come."),
    ("losing samples", "Bad: samples are missing: `isotherm explain gap`."),
    ("wrong interval", "Bad: scale factors of another interval: `isotherm explain interval-not-nominal`."),
    ("time steps", "Bad: timestamps do not fit the intervals: `isotherm explain time-step`."),
    ("new session", "Bad: another session of the acquisition follows: `isotherm explain session`."),
    ("out of range", "Bad: temperature is outside of the calibrated range, not finite, or has not come."),
    ("lag unknown", "To be looked into: transient terms are left out: `isotherm explain lag-unknown`."),
    ("flagged", "To be looked into: increments carry flags, which the lower part of the screen names."),
    ("late", "To be looked into: increments take longer than the latency budget; they are right."),
    ("near range end", "To be looked into: temperature is within 5 % of an end of the calibrated range."),
    ("ok", "Samples are answered, and none carries a flag."),
];

/// The condition of an IMU in one or two words.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct ImuCondition {
    /// The words.
    pub text: &'static str,
    /// How serious it is.
    pub level: AlertLevel,
}

impl Model {
    /// A model without any status yet.
    pub(super) fn new(domain: &str, theme: Theme) -> Self {
        Self {
            domain: domain.to_owned(),
            theme,
            history: VecDeque::new(),
            waiting: None,
            table: TableState::new().with_selected(0),
            paused: false,
            help: false,
        }
    }

    /// Adds what has been read at one tick.
    pub(super) fn update(&mut self, newest: Option<ServiceStatus>, waiting: Option<StatusWait>) {
        self.waiting = waiting;
        if let Some(status) = newest {
            self.add_status(status);
        }
    }

    fn add_status(&mut self, status: ServiceStatus) {
        if self.history.back().is_some_and(|last| last.pid != status.pid) {
            // A new service counts from 0.
            self.history.clear();
        }
        // Replace the newest status if it is less than a second after its predecessor.
        let mut from_the_end = self.history.iter().rev();
        if let (Some(last), Some(before)) = (from_the_end.next(), from_the_end.next())
            && last.taken_ns < before.taken_ns + RATE_NS
        {
            self.history.pop_back();
        }
        let oldest = status.taken_ns.saturating_sub(MINUTE_NS);
        while self.history.get(1).is_some_and(|second| second.taken_ns <= oldest) {
            self.history.pop_front();
        }
        let count = status.imus.len();
        self.history.push_back(status);
        let last = count.saturating_sub(1);
        self.table.select(Some(self.selected().min(last)));
    }

    /// The newest status.
    pub(super) fn status(&self) -> Option<&ServiceStatus> {
        self.history.back()
    }

    /// The index of the selected IMU.
    pub(super) fn selected(&self) -> usize {
        self.table.selected().unwrap_or(0)
    }

    /// The selected IMU.
    pub(super) fn imu(&self) -> Option<&ImuStatus> {
        self.status()?.imus.get(self.selected())
    }

    fn imus(&self) -> usize {
        self.status().map_or(0, |status| status.imus.len())
    }

    /// Moves the selection by `step`, at most to the first or last IMU.
    pub(super) fn select_by(&mut self, step: isize) {
        let last = self.imus().saturating_sub(1);
        self.table.select(Some(self.selected().saturating_add_signed(step).min(last)));
    }

    /// Selects the next IMU, and after the last one the first.
    pub(super) fn select_next(&mut self) {
        let count = self.imus().max(1);
        self.table.select(Some((self.selected() + 1) % count));
    }

    /// Selects the previous IMU, and before the first one the last.
    pub(super) fn select_previous(&mut self) {
        let count = self.imus().max(1);
        self.table.select(Some((self.selected() + count - 1) % count));
    }

    /// The newest status that is at least `age_ns` older than the last one, otherwise the oldest. `None` if there is
    /// only one status.
    fn before(&self, age_ns: u64) -> Option<&ServiceStatus> {
        let newest = self.status()?.taken_ns;
        let old_enough = |status: &&ServiceStatus| status.taken_ns + age_ns <= newest;
        let found = self.history.iter().rev().find(old_enough).or_else(|| self.history.front());
        found.filter(|status| status.taken_ns < newest)
    }

    /// How fast a count of an IMU rises \[1/s\]. `None` while only one status is known, or the service is waited for.
    pub(super) fn rate(&self, imu: usize, count: impl Fn(&ImuStatus) -> u64) -> Option<f64> {
        let (before, now) = (self.before(RATE_NS)?, self.status()?);
        let risen = count(now.imus.get(imu)?).saturating_sub(count(before.imus.get(imu)?));
        let rate = risen as f64 * 1e9 / (now.taken_ns - before.taken_ns) as f64;
        self.waiting.is_none().then_some(rate)
    }

    /// Latency counts of the selected IMU by coarse buckets, and the time that they cover \[s\]: the last minute, or
    /// less at the beginning.
    pub(super) fn distribution(&self) -> (Vec<u64>, f64) {
        let Some((before, now)) = self.before(MINUTE_NS).zip(self.status()) else { return (Vec::new(), 0.0) };
        let counts = |status: &ServiceStatus| {
            status.imus.get(self.selected()).map(|imu| imu.latency_distribution.counts.clone()).unwrap_or_default()
        };
        let risen = counts(now).into_iter().zip(counts(before)).map(|(now, before)| now.saturating_sub(before));
        (risen.collect(), (now.taken_ns - before.taken_ns) as f64 * 1e-9)
    }

    /// The condition of an IMU: the first in this order that applies.
    pub(super) fn condition(&self, index: usize, imu: &ImuStatus) -> ImuCondition {
        let (bad, warning) = (AlertLevel::Bad, AlertLevel::Warning);
        let rises = |count: &dyn Fn(&ImuStatus) -> u64| self.rate(index, count).is_some_and(|rate| rate > 0.0);
        let is_raised = |flag: &'static str| rises(&|imu: &ImuStatus| imu.flagged.get(flag).copied().unwrap_or(0));
        let other_flags =
            |imu: &ImuStatus| imu.flagged.iter().filter(|(name, _)| *name != "late").map(|(_, count)| count).sum();
        let mut workers = self.status().into_iter().flat_map(|status| &status.workers);
        let mut thermometers = RangeTemperature::all_of(imu);
        let is_outside = |place: RangeTemperature| place.fraction().is_none_or(|part| !(0.0..=1.0).contains(&part));
        let conditions = [
            ("not served", bad, self.waiting.is_some()),
            ("stands still", bad, workers.any(|it| it.stands_still && it.imus.contains(&imu.id))),
            ("first table", warning, imu.waits_for_table),
            ("no table", bad, imu.table.is_none()),
            ("file REFUSED", bad, imu.last_reload_error.is_some()),
            ("other device", bad, imu.other_device.is_some()),
            ("no acquisition", warning, !imu.acquisition_connected),
            ("no samples", warning, !rises(&|imu| imu.received)),
            ("losing samples", bad, rises(&|imu| imu.missing)),
            ("wrong interval", bad, is_raised("interval-not-nominal")),
            ("time steps", bad, is_raised("time-step")),
            ("new session", bad, is_raised("session")),
            ("out of range", bad, RangeTemperature::all_of(imu).any(is_outside)),
            ("lag unknown", warning, is_raised("lag-unknown")),
            ("flagged", warning, rises(&other_flags)),
            ("late", warning, is_raised("late")),
            ("near range end", warning, thermometers.any(|place| place.level() != AlertLevel::Good)),
        ];
        let found = conditions.into_iter().find(|(.., applies)| *applies);
        let (text, level) = found.map_or(("ok", AlertLevel::Good), |(text, level, _)| (text, level));
        debug_assert!(STATES.iter().any(|(name, _)| *name == text), "{text} is not explained");
        ImuCondition { text, level }
    }
}

/// A temperature, and the range that its polynomials were calibrated over.
#[derive(Clone, Copy, Debug)]
pub(super) struct RangeTemperature {
    /// The temperature; `None` if it is not finite or has not come.
    pub value: Option<f64>,
    /// The ends of the range; `None` without a table.
    pub range: Option<[f64; 2]>,
}

impl RangeTemperature {
    /// Head and board temperature of a triad's sensor. An IMU without gyroscopes has none for them.
    pub(super) fn of(imu: &ImuStatus, kind: SensorKind, axis: usize) -> [Self; 2] {
        let (ranges, head, board) = match (kind, &imu.gyroscopes) {
            (SensorKind::Accelerometer, _) => (imu.ranges.as_ref(), imu.head_temperature, imu.board_temperature),
            (SensorKind::Gyroscope, Some(gyroscopes)) => {
                (Some(&gyroscopes.ranges), gyroscopes.head_temperature, gyroscopes.board_temperature)
            }
            (SensorKind::Gyroscope, None) => (None, [None; AXES], [None; AXES]),
        };
        [
            Self { value: head[axis], range: ranges.map(|ranges| ranges.head[axis]) },
            Self { value: board[axis], range: ranges.map(|ranges| ranges.board[axis]) },
        ]
    }

    /// The temperatures of all sensors.
    pub(super) fn all_of(imu: &ImuStatus) -> impl Iterator<Item = Self> {
        let gyroscopes = imu.gyroscopes.as_ref().map(|_| SensorKind::Gyroscope);
        let kinds = [SensorKind::Accelerometer].into_iter().chain(gyroscopes);
        kinds.flat_map(move |kind| (0..AXES).flat_map(move |axis| Self::of(imu, kind, axis)))
    }

    /// Position within the range: 0 at the lower end, 1 at the upper.
    pub(super) fn fraction(self) -> Option<f64> {
        let (value, [low, high]) = (self.value?, self.range?);
        Some((value - low) / (high - low))
    }

    /// How serious the position within the range is.
    pub(super) fn level(self) -> AlertLevel {
        match self.fraction() {
            Some(part) if (EDGE..=1.0 - EDGE).contains(&part) => AlertLevel::Good,
            Some(part) if (0.0..=1.0).contains(&part) => AlertLevel::Warning,
            _ => AlertLevel::Bad,
        }
    }
}
