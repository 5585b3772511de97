//! Everything that is on the screen: what has been told of late, what has been selected, and what follows from it.

use super::increments::CurvePoint;
use super::source::Waiting;
use super::style::{Theme, Weight};
use isotherm_client::ConnectError;
use isotherm_shared::status::{ImuStatus, ServiceStatus};
use isotherm_shared::wire::AXES;
use ratatui::widgets::TableState;
use std::collections::VecDeque;

/// Rates are taken over at least so long \[ns\].
const RATE_NS: u64 = 1_000_000_000;
/// The histogram shows so long \[ns\].
const MINUTE_NS: u64 = 60_000_000_000;
/// Points of a curve that are kept; no screen is wider.
const POINTS: usize = 400;
/// This close to an end of the calibrated range is worth a look, as a part of it.
const EDGE: f64 = 0.05;

/// What is on the screen.
pub struct Model {
    /// The domain's name.
    pub domain: String,
    /// What the terminal can show.
    pub look: Theme,
    /// What has been told, a second or so apart, the newest last and from any time.
    told: VecDeque<ServiceStatus>,
    /// What is waited for.
    pub waiting: Option<Waiting>,
    /// The row that is selected, and which are in view.
    pub table: TableState,
    /// Whose increments are in `points`.
    points_of: String,
    /// Means of the selected IMU's increments, the newest last; `None` where none came.
    pub points: VecDeque<Option<CurvePoint>>,
    /// Why its increments cannot be read.
    pub unread: Option<String>,
    /// Whether the picture stands.
    pub paused: bool,
    /// Whether the keys are explained.
    pub help: bool,
}

/// How an IMU does, in a word.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct State {
    /// The word or two.
    pub text: &'static str,
    /// How much it matters.
    pub weight: Weight,
}

impl Model {
    /// With nothing told yet.
    pub fn new(domain: &str, look: Theme) -> Self {
        Self {
            domain: domain.to_owned(),
            look,
            told: VecDeque::new(),
            waiting: None,
            table: TableState::new().with_selected(0),
            points_of: String::new(),
            points: VecDeque::new(),
            unread: None,
            paused: false,
            help: false,
        }
    }

    /// Takes what one tick has brought.
    pub fn take(
        &mut self,
        news: Option<ServiceStatus>,
        waiting: Option<Waiting>,
        point: Result<Option<CurvePoint>, ConnectError>,
    ) {
        self.waiting = waiting;
        if let Some(status) = news {
            self.keep(status);
        }
        let id = self.selected_id().unwrap_or_default().to_owned();
        if id != self.points_of {
            // This tick's point is still of the one selected before.
            self.points_of = id;
            self.points.clear();
            self.unread = None;
            return;
        }
        match point {
            Ok(point) => self.points.push_back(point),
            Err(error) => self.unread = Some(error.to_string()),
        }
        if self.points.back().is_some_and(Option::is_some) {
            self.unread = None;
        }
        if self.points.len() > POINTS {
            self.points.pop_front();
        }
    }

    fn keep(&mut self, status: ServiceStatus) {
        if self.told.back().is_some_and(|last| last.pid != status.pid) {
            // Another service counts anew.
            self.told.clear();
        }
        // The newest may be from any time; those before it are a second apart.
        let mut from_the_end = self.told.iter().rev();
        if let (Some(last), Some(before)) = (from_the_end.next(), from_the_end.next())
            && last.taken_ns < before.taken_ns + RATE_NS
        {
            self.told.pop_back();
        }
        let oldest = status.taken_ns.saturating_sub(MINUTE_NS);
        while self.told.get(1).is_some_and(|second| second.taken_ns <= oldest) {
            self.told.pop_front();
        }
        let count = status.imus.len();
        self.told.push_back(status);
        let last = count.saturating_sub(1);
        self.table.select(Some(self.selected().min(last)));
    }

    /// The newest status.
    pub fn status(&self) -> Option<&ServiceStatus> {
        self.told.back()
    }

    /// The number of the selected IMU.
    pub fn selected(&self) -> usize {
        self.table.selected().unwrap_or(0)
    }

    /// The selected IMU.
    pub fn imu(&self) -> Option<&ImuStatus> {
        self.status()?.imus.get(self.selected())
    }

    /// Its name.
    pub fn selected_id(&self) -> Option<&str> {
        self.imu().map(|imu| imu.id.as_str())
    }

    fn imus(&self) -> usize {
        self.status().map_or(0, |status| status.imus.len())
    }

    /// Selects another IMU, as far as there are any.
    pub fn select_by(&mut self, step: isize) {
        let last = self.imus().saturating_sub(1);
        self.table.select(Some(self.selected().saturating_add_signed(step).min(last)));
    }

    /// The next one, or the first.
    pub fn select_next(&mut self) {
        let count = self.imus().max(1);
        self.table.select(Some((self.selected() + 1) % count));
    }

    /// The one before, or the last.
    pub fn select_previous(&mut self) {
        let count = self.imus().max(1);
        self.table.select(Some((self.selected() + count - 1) % count));
    }

    /// The newest status that is at least so old, or else the oldest; none if there is only one.
    fn before(&self, age_ns: u64) -> Option<&ServiceStatus> {
        let newest = self.status()?.taken_ns;
        let old_enough = |status: &&ServiceStatus| status.taken_ns + age_ns <= newest;
        let found = self.told.iter().rev().find(old_enough).or_else(|| self.told.front());
        found.filter(|status| status.taken_ns < newest)
    }

    /// How fast a count of an IMU rises \[1/s\]; none while only one status is known, or there is no service.
    pub fn rate(&self, imu: usize, count: impl Fn(&ImuStatus) -> u64) -> Option<f64> {
        let (before, now) = (self.before(RATE_NS)?, self.status()?);
        let risen = count(now.imus.get(imu)?).saturating_sub(count(before.imus.get(imu)?));
        let rate = risen as f64 * 1e9 / (now.taken_ns - before.taken_ns) as f64;
        self.waiting.is_none().then_some(rate)
    }

    /// Latency of the selected IMU by coarse buckets, and over what time \[s\]: the last minute, or what is known of it.
    pub fn distribution(&self) -> (Vec<u64>, f64) {
        let Some((before, now)) = self.before(MINUTE_NS).zip(self.status()) else { return (Vec::new(), 0.0) };
        let counts = |status: &ServiceStatus| {
            status.imus.get(self.selected()).map(|imu| imu.latency_distribution.counts.clone()).unwrap_or_default()
        };
        let risen = counts(now).into_iter().zip(counts(before)).map(|(now, before)| now.saturating_sub(before));
        (risen.collect(), (now.taken_ns - before.taken_ns) as f64 * 1e-9)
    }

    /// How an IMU does: the worst that can be said of it.
    pub fn state(&self, index: usize, imu: &ImuStatus) -> State {
        let (bad, warning) = (Weight::Bad, Weight::Warning);
        let say = |text, weight| State { text, weight };
        let rises = |count: fn(&ImuStatus) -> u64| self.rate(index, count).is_some_and(|rate| rate > 0.0);
        let workers = self.status().map_or(&[][..], |status| &status.workers);
        if self.waiting.is_some() {
            say("not served", bad)
        } else if workers.iter().any(|worker| worker.stands_still && worker.imus.contains(&imu.id)) {
            say("stands still", bad)
        } else if imu.table.is_none() {
            say("no table", bad)
        } else if imu.last_reload_error.is_some() {
            say("file REFUSED", bad)
        } else if !imu.acquisition_connected {
            say("no acquisition", warning)
        } else if !rises(|imu| imu.received) {
            say("no samples", warning)
        } else if rises(|imu| imu.missing) {
            say("losing samples", bad)
        } else if Thermometer::all_of(imu).any(|place| place.part().is_none_or(|part| !(0.0..=1.0).contains(&part))) {
            say("out of range", bad)
        } else if rises(|imu| imu.flagged.iter().filter(|(name, _)| *name != "late").map(|(_, count)| count).sum()) {
            say("flagged", warning)
        } else if rises(|imu| imu.flagged.get("late").copied().unwrap_or(0)) {
            say("late", warning)
        } else if Thermometer::all_of(imu).any(|place| place.weight() != Weight::Good) {
            say("near range end", warning)
        } else {
            say("ok", Weight::Good)
        }
    }
}

/// One temperature within the range that its polynomials were calibrated over.
#[derive(Clone, Copy, Debug)]
pub struct Thermometer {
    /// The telemetry; none if it is not finite or has not come.
    pub value: Option<f64>,
    /// The range's ends; none without a table.
    pub range: Option<[f64; 2]>,
}

impl Thermometer {
    /// Head and board telemetry of an axis.
    pub fn of(imu: &ImuStatus, axis: usize) -> [Self; 2] {
        let ranges = imu.ranges.as_ref();
        [
            Self { value: imu.head_temperature[axis], range: ranges.map(|ranges| ranges.head[axis]) },
            Self { value: imu.board_temperature[axis], range: ranges.map(|ranges| ranges.board[axis]) },
        ]
    }

    /// All six.
    pub fn all_of(imu: &ImuStatus) -> impl Iterator<Item = Self> {
        (0..AXES).flat_map(|axis| Self::of(imu, axis))
    }

    /// Where within the range it is: 0 at the lower end, 1 at the upper.
    pub fn part(self) -> Option<f64> {
        let (value, [low, high]) = (self.value?, self.range?);
        Some((value - low) / (high - low))
    }

    /// How much it matters where it is.
    pub fn weight(self) -> Weight {
        match self.part() {
            Some(part) if (EDGE..=1.0 - EDGE).contains(&part) => Weight::Good,
            Some(part) if (0.0..=1.0).contains(&part) => Weight::Warning,
            _ => Weight::Bad,
        }
    }
}
