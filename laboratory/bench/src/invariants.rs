//! What must be true of every campaign, whatever goes wrong.

use crate::campaign::{Campaign, CampaignEnd};
use crate::faults::{DrawnFault, FaultPlan};
use crate::world::{Request, SampleState};
use isotherm_automation::journal::{self, Entry, Journal, JournalLine};
use isotherm_automation::timeline::units;
use isotherm_station::{DeviceEvent, InjectedFault};
use std::collections::BTreeMap;
use std::fs;

/// Longest time from a signal, or from a pause while the turntable moves, to the stop orders \[s\].
const ORDERS_S: f64 = 5.0;
/// Longest time until a reading shows where the turntable is \[s\].
const NOTICED_S: f64 = 3.0;
/// Longest pause after a fault of the line is over \[s\].
const PAUSED_S: f64 = 12.0;
/// What stops an axis of the turntable.
const STOP: &[u8] = b":mode:off ";
/// A row of a dwell is off its position by at most this \[deg\].
const OFF_DEG: f64 = 0.01;
/// The turntable moves if its angles change by more than this from one sample to the next \[deg\].
const MOVES_DEG: f64 = 0.01;
/// The air of a row is off its set point by at most this \[degC\]: the tolerance, and what the controller's own sensor
/// is behind when the air leaves.
const OFF_C: f64 = 1.2;
/// The turntable was read within this time before a row of the readbacks \[s\], the longest time that a slow line takes
/// for a reading, and is read within this, twice the swing of one that does not settle \[deg\].
const READ_WITHIN_S: f64 = 60.0;
const READ_DEG: f64 = 0.11;
/// A set point is off the air by at most a step and what the air and its sensor are behind \[degC\].
const STEP_C: f64 = 1.2;
/// A chamber that is stopped changes more slowly than this \[degC/s\].
const OFF_C_PER_S: f64 = 0.01;
/// A ramp lasts at most this many times as long as its plan says: the air is behind the set point.
const LONGER: f64 = 1.2;
/// Length of a row, at most \[s\].
const ROW_S: f64 = 10.0;
/// Unix time at the begin of the world \[s\].
const BEGIN_UNIX_S: f64 = 1.8e9;
/// Reading of the clock that only rises at the begin of the world \[s\].
const BEGIN_UP_S: f64 = 1000.0;

/// What is wrong with a campaign and the ends of its runners, one line each.
#[must_use]
pub fn violations(campaign: &Campaign, ended: &[CampaignEnd]) -> Vec<String> {
    let (events, places) = campaign.world.course();
    let course = CampaignCourse {
        campaign,
        faults: campaign.world.faults(),
        events,
        places,
        requests: campaign.world.requests(),
    };
    let mut found = course.beyond_limits(ended);
    found.extend(course.late_orders(ended));
    found.extend(course.unsafe_ends(ended));
    found.extend(course.journal());
    found.extend(course.wrong_rows());
    found.extend(course.wrong_readings());
    found.extend(course.ended_by_mistake(ended));
    found.extend(course.steps());
    found.extend(course.ramps());
    if ended.last().is_none_or(|last| last.failure.is_some()) {
        let last = ended.last().and_then(|last| last.failure.clone());
        found.push(format!("it is not complete after {} runners: {}", ended.len(), last.unwrap_or_default()));
    }
    found
}

struct CampaignCourse<'a> {
    campaign: &'a Campaign,
    faults: FaultPlan,
    events: Vec<(f64, DeviceEvent)>,
    places: Vec<SampleState>,
    requests: Vec<Request>,
}

impl CampaignCourse<'_> {
    /// Commands beyond the limits, and true angles beyond them that no stop order follows.
    fn beyond_limits(&self, ended: &[CampaignEnd]) -> Vec<String> {
        let limits = &self.campaign.plan.limits;
        // What somebody else has commanded is not the runner's.
        let of_others: Vec<f64> = self.faults.events(DrawnFault::RunAway).collect();
        let is_own = |at_s: f64| !of_others.iter().any(|other| (at_s - other).abs() < 1.0);
        let commanded = self.events.iter().filter_map(|(at_s, event)| {
            let fault = match event {
                DeviceEvent::GoTo { angle_deg, .. } => limits.angles([*angle_deg, *angle_deg]),
                // A set point that is overshot was not commanded.
                DeviceEvent::Chamber { target_c, .. } => limits.chamber(*target_c),
                DeviceEvent::Stop { .. } | DeviceEvent::Swing { .. } => None,
            };
            fault.filter(|_| is_own(*at_s)).map(|fault| format!("commanded at {at_s:.1} s: {fault}"))
        });
        // Once for each time that the turntable leaves them.
        let is_beyond = |place: &SampleState| limits.reading(place.angles_deg, [0.0; 2], false).is_some();
        let leaves = self.places.windows(2).filter(|pair| !is_beyond(&pair[0]) && is_beyond(&pair[1]));
        let leaves = leaves.map(|pair| pair[1].end_s).filter(|at_s| self.runs(ended, *at_s));
        let unseen = leaves.filter(|at_s| self.has_line(*at_s) && !self.is_stopped(*at_s, NOTICED_S + ORDERS_S));
        let reached = unseen.map(|at_s| format!("no stop order after the limits were left at {at_s:.1} s"));
        commanded.chain(reached).collect()
    }

    /// Whether a runner runs at this time.
    fn runs(&self, ended: &[CampaignEnd], at_s: f64) -> bool {
        let killed = [DrawnFault::Killed, DrawnFault::PowerLoss].map(|event| self.faults.events(event));
        let killed: Vec<f64> = killed.into_iter().flatten().collect();
        let run = ended.iter().find(|end| end.times_s[0] <= at_s && at_s < end.times_s[1]);
        run.is_some_and(|run| !run.is_killed || killed.iter().any(|kill| run.times_s[0] < *kill && at_s < *kill))
    }

    /// Whether a stop order goes to the turntable within these seconds.
    fn is_stopped(&self, at_s: f64, within_s: f64) -> bool {
        let times = at_s - 0.5..=at_s + within_s;
        let is_order = |request: &Request| {
            request.to_turntable && times.contains(&request.at_s) && request.bytes.starts_with(STOP)
        };
        self.requests.iter().any(is_order)
    }

    /// Whether the turntable's port exists over the time of an order.
    fn has_port(&self, at_s: f64) -> bool {
        // A serial line that is dead takes nothing.
        let lost = [InjectedFault::PortLoss, InjectedFault::Dead].map(DrawnFault::Turntable);
        ![at_s, at_s + ORDERS_S].iter().any(|at_s| self.faults.active(*at_s).any(|fault| lost.contains(&fault)))
    }

    /// Whether nothing disturbs the turntable's line at this time and until it is noticed.
    fn has_line(&self, at_s: f64) -> bool {
        let disturbs = |fault| match fault {
            DrawnFault::Turntable(fault) => fault != InjectedFault::NoSettle,
            DrawnFault::Slow { turntable } => turntable,
            fault => fault == DrawnFault::CutReply,
        };
        let until_s = at_s + NOTICED_S;
        !self
            .faults
            .0
            .iter()
            .any(|(fault, times)| disturbs(*fault) && times.start < until_s && times.end > at_s - PAUSED_S)
    }

    /// Whether the turntable moves at this time.
    fn moves(&self, at_s: f64) -> bool {
        let next = self.places.partition_point(|place| place.end_s < at_s);
        let near = self.places.get(next.saturating_sub(1)..(next + 1).min(self.places.len())).unwrap_or_default();
        let [before, after] = near else { return false };
        (0..2).any(|axis| (before.angles_deg[axis] - after.angles_deg[axis]).abs() > MOVES_DEG)
    }

    /// Stop orders that did not go out within 5 s of a signal, or of a pause in a motion. A port that does not exist
    /// takes none.
    fn late_orders(&self, ended: &[CampaignEnd]) -> Vec<String> {
        let signals = self.faults.events(DrawnFault::Signal).filter(|at_s| self.runs(ended, *at_s));
        let begins =
            signals.map(|at_s| ("SIGTERM", at_s)).chain(self.pauses().into_iter().map(|at_s| ("a pause", at_s)));
        let late = begins.filter(|(_, at_s)| self.has_port(*at_s) && !self.is_stopped(*at_s, ORDERS_S));
        late.map(|(what, at_s)| format!("no stop order within {ORDERS_S} s of {what} at {at_s:.1} s")).collect()
    }

    /// When the runner paused while the turntable moved.
    fn pauses(&self) -> Vec<f64> {
        let (lines, _) = journal::read(&self.campaign.plan.output.join(journal::JOURNAL)).unwrap_or_default();
        let paused = lines.iter().filter(|line| matches!(line.entry, Entry::Paused { .. }));
        let at_s = |line: &JournalLine| Some(line.at.up.as_ref()?.s - BEGIN_UP_S);
        paused.filter_map(at_s).filter(|at_s| self.moves(*at_s)).collect()
    }

    /// Runners that have said that all is safe, and the turntable moves after that or the chamber runs.
    fn unsafe_ends(&self, ended: &[CampaignEnd]) -> Vec<String> {
        let mut found = Vec::new();
        for (number, end) in ended.iter().enumerate().filter(|(_, end)| !end.is_killed) {
            if end.failure.as_ref().is_some_and(|message| message.contains("GO THERE AND LOOK")) {
                continue;
            }
            let until_s = ended.get(number + 1).map_or(f64::INFINITY, |next| next.times_s[0]);
            let after = self.places.iter().filter(|place| place.end_s > end.times_s[1] && place.end_s < until_s);
            let angles: Vec<_> = after.map(|place| place.angles_deg).collect();
            let is_still =
                angles.windows(2).all(|pair| (0..2).all(|axis| (pair[0][axis] - pair[1][axis]).abs() < 1e-3));
            let is_beyond = end.failure.as_ref().is_some_and(|message| message.contains("is outside limits"));
            let is_swinging =
                self.faults.active(end.times_s[1]).any(|fault| fault == DrawnFault::Turntable(InjectedFault::NoSettle));
            if !is_still && !is_swinging && !is_beyond {
                found.push(format!("the turntable moves after the end at {:.1} s", end.times_s[1]));
            }
        }
        found
    }

    /// Readings of the turntable that are at no angle where it was shortly before: replies to other requests, or parts
    /// of replies.
    fn wrong_readings(&self) -> Vec<String> {
        let event = |fault| self.faults.events(fault).next().is_some();
        if event(DrawnFault::ClockSetBack) || event(DrawnFault::RunAway) {
            // The times of the rows do not show when they were taken; or the turntable turns back between two samples.
            return Vec::new();
        }
        let text = fs::read_to_string(self.campaign.plan.output.join("readbacks.csv")).unwrap_or_default();
        let (mut found, mut last) = (Vec::new(), [f64::NAN; 2]);
        for row in text.lines().skip(1) {
            let fields: Vec<&str> = row.split(',').collect();
            let number = |column: usize| fields.get(column).and_then(|field| field.parse().ok()).unwrap_or(f64::NAN);
            let (at_s, angles_deg) = (number(0) - BEGIN_UNIX_S, [number(6), number(7)]);
            let rates = [number(8), number(9)];
            if rates.iter().any(|rate| rate.abs() > self.campaign.plan.motion.rate_deg_s + 1.0) {
                found.push(format!("rates were read as {rates:?} deg/s before {at_s:.1} s"));
            }
            // One that is not new was checked when it was; before the first one there is 0.
            let is_new = angles_deg != last && angles_deg != [0.0; 2];
            last = angles_deg;
            if is_new && !self.was_at(angles_deg, at_s) {
                found
                    .push(format!("the turntable was read at {angles_deg:?} deg before {at_s:.1} s, where it was not"));
            }
        }
        found
    }

    /// Whether the turntable was at these angles in the time before.
    fn was_at(&self, angles_deg: [f64; 2], at_s: f64) -> bool {
        let [begin, end] = [at_s - READ_WITHIN_S, at_s + 1.0]
            .map(|at_s| self.places.partition_point(|place| place.end_s < at_s).min(self.places.len()));
        let near = &self.places[begin..end];
        (0..2).all(|axis| {
            let angles = || near.iter().map(|place| place.angles_deg[axis]);
            let [low, high] = [angles().fold(f64::INFINITY, f64::min), angles().fold(f64::NEG_INFINITY, f64::max)];
            (low - READ_DEG..=high + READ_DEG).contains(&angles_deg[axis])
        })
    }

    /// Runners that ended for an angle or a rate beyond the limits that was only misread.
    fn ended_by_mistake(&self, ended: &[CampaignEnd]) -> Vec<String> {
        let runs_away = self.faults.events(DrawnFault::RunAway).next().is_some();
        let is_mistaken = |end: &&CampaignEnd| {
            let message = end.failure.as_deref().unwrap_or_default();
            let is_beyond =
                message.contains("is outside limits.outer_deg") && !message.contains("cannot be read again");
            is_beyond && !runs_away || message.contains("over limits.rate_deg_s")
        };
        let mistaken = ended.iter().filter(is_mistaken);
        mistaken.map(|end| format!("it ended for a reading that was wrong: {:?}", end.failure)).collect()
    }

    /// Whether the chamber does not go where it is sent.
    fn has_strange_chamber(&self) -> bool {
        let strange = [InjectedFault::Overshoot, InjectedFault::NeverThere].map(DrawnFault::Chamber);
        self.faults.0.iter().any(|(fault, _)| strange.contains(fault))
    }

    /// Set points farther from the air than the steps of a ramp.
    fn steps(&self) -> Vec<String> {
        if self.has_strange_chamber() {
            return Vec::new();
        }
        let commanded = self.events.iter().filter_map(|(at_s, event)| match event {
            // A chamber that is stopped goes to the laboratory's temperature by itself, slowly.
            DeviceEvent::Chamber { target_c, ramp_c_per_s } if *ramp_c_per_s > OFF_C_PER_S => {
                let air_c = self.places.get(self.places.partition_point(|place| place.end_s < *at_s))?.air_c;
                Some((at_s, target_c, air_c))
            }
            _ => None,
        });
        let far = commanded.filter(|(_, target_c, air_c)| (*target_c - air_c).abs() > STEP_C);
        far.map(|(at_s, target_c, air_c)| format!("a step from {air_c:.2} to {target_c} degC at {at_s:.1} s")).collect()
    }

    /// Kept ramps that do not last as long as their plan says, or are not there and back once.
    fn ramps(&self) -> Vec<String> {
        let plan = &self.campaign.plan;
        let (lines, _) = journal::read(&plan.output.join(journal::JOURNAL)).unwrap_or_default();
        let mut found = Vec::new();
        for line in &lines {
            let Entry::Kept(kept) = &line.entry else { continue };
            let number = kept.file.strip_prefix("ramp-").and_then(|rest| rest.strip_suffix(".csv"));
            let Some(ramp) = number.and_then(|number| plan.ramps.get(number.parse::<usize>().ok()? - 1)) else {
                continue;
            };
            let (nominal_s, recording) = (ramp.way.time_s(), self.campaign.file(&kept.file));
            let times: Vec<f64> = column(&recording, "timestamp_ns");
            let span_s = times.last().zip(times.first()).map_or(0.0, |(last, first)| (last - first) / 1e9);
            // The first row has its own length, which its time does not show.
            let longest_s = if self.has_strange_chamber() { f64::INFINITY } else { LONGER * nominal_s };
            if !(nominal_s - ROW_S..=longest_s).contains(&span_s) {
                found.push(format!("{} lasts {span_s:.0} s, its plan {nominal_s:.0} s", kept.file));
            }
            let ends = ends_of(&recording);
            if ends != 3 {
                found.push(format!("{} is at {ends} ends of its temperatures, not there and back once", kept.file));
            }
        }
        found
    }

    /// A journal that cannot be read, or units that are not there once and in order.
    fn journal(&self) -> Vec<String> {
        let plan = &self.campaign.plan;
        match Journal::open(plan) {
            Ok((_, history)) => {
                let in_order = history.kept.iter().enumerate().all(|(number, kept)| kept.unit == number);
                let is_right = in_order && history.kept.len() <= units(plan);
                (!is_right).then(|| "the units are not in order".to_owned()).into_iter().collect()
            }
            Err(failure) => vec![format!("the journal cannot be opened: {failure}")],
        }
    }

    /// Kept rows whose true attitude or temperature is not that of their position.
    fn wrong_rows(&self) -> Vec<String> {
        let plan = &self.campaign.plan;
        let path = plan.output.join(plan.samples_file());
        let Ok(text) = fs::read_to_string(&path) else { return Vec::new() };
        let places: BTreeMap<(u64, u64), &SampleState> =
            self.places.iter().map(|place| ((place.session, place.sequence), place)).collect();
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let column = |name: &str| header.iter().position(|column| *column == name);
        let (Some(session), Some(sequence), Some(position), Some(set_point)) =
            (column("session"), column("sequence"), column("position"), column("set_point_c"))
        else {
            return vec![format!("the rows have the columns {header:?}")];
        };
        let mut found = Vec::new();
        for line in lines {
            let fields: Vec<&str> = line.split(',').collect();
            let number =
                |index: usize| fields.get(index).and_then(|field| field.parse::<f64>().ok()).unwrap_or(f64::NAN);
            let key = (number(session) as u64, number(sequence) as u64);
            let place = places.get(&key);
            let position = plan.positions.iter().find(|planned| f64::from(planned.number) == number(position));
            let (Some(place), Some(angles_deg)) = (place, position.and_then(|position| position.angles)) else {
                found.push(format!("a row of session and sequence {key:?} is of no sample or of no position"));
                continue;
            };
            let off = (0..2).map(|axis| (place.angles_deg[axis] - angles_deg[axis]).abs()).fold(0.0, f64::max);
            if off > OFF_DEG {
                found.push(format!("a row at {:.1} s is {off:.3} deg off its position", place.end_s));
            }
            let off_c = (place.air_c - number(set_point)).abs();
            if off_c > OFF_C {
                found.push(format!("a row at {:.1} s is {off_c:.2} degC off its set point", place.end_s));
            }
        }
        found
    }
}

/// How many times a recording is at an end of its temperatures, in the outer quarters of their range: once more than it
/// goes from one to the other.
fn ends_of(recording: &str) -> usize {
    let heads = column(recording, "a1_head");
    let (low, high) = heads.iter().fold((f64::MAX, f64::MIN), |(low, high), head| (low.min(*head), high.max(*head)));
    let places = heads.iter().map(|head| (head - low) / (high - low));
    let mut ends: Vec<_> = places.filter(|place| !(0.25..0.75).contains(place)).map(|place| place > 0.5).collect();
    ends.dedup();
    ends.len()
}

/// The numbers in a column of a recording.
fn column(recording: &str, name: &str) -> Vec<f64> {
    let mut rows = recording.lines();
    let header = rows.next().unwrap_or_default();
    let Some(column) = header.split(',').position(|known| known == name) else { return Vec::new() };
    rows.filter_map(|row| row.split(',').nth(column)?.parse().ok()).collect()
}
