//! What must be true of every campaign, whatever goes wrong.

use crate::campaign::{Campaign, Ended};
use crate::faults::{Fault, FaultPlan};
use crate::world::{Place, Request};
use isotherm_automation::journal::{self, Entry, Journal};
use isotherm_automation::timeline::units;
use isotherm_simulator::{DeviceEvent, InjectedFault};
use std::collections::BTreeMap;
use std::fs;

/// Longest time from a signal, or from a pause while the turntable moves, to the stop orders \[s\].
const ORDERS_S: f64 = 5.0;
/// Longest time until a reading shows where the turntable is \[s\].
const NOTICED_S: f64 = 3.0;
/// What stops an axis of the turntable.
const STOP: &[u8] = b":mode:off ";
/// A row of a dwell is off its position by at most this \[deg\].
const OFF_DEG: f64 = 0.01;
/// The turntable moves if its angles change by more than this from one sample to the next \[deg\].
const MOVES_DEG: f64 = 0.01;
/// The air of a row is off its set point by at most this \[degC\]: the tolerance, and what the controller's own sensor
/// is behind when the air leaves.
const OFF_C: f64 = 1.2;
/// Unix time at the begin of the world \[s\].
const BEGIN_UNIX_S: f64 = 1.8e9;

/// What is wrong with a campaign and the ends of its runners, one line each.
#[must_use]
pub fn violations(campaign: &Campaign, ended: &[Ended]) -> Vec<String> {
    let (events, places) = campaign.world.course();
    let course =
        Course { campaign, faults: campaign.world.faults(), events, places, requests: campaign.world.requests() };
    let mut found = course.beyond_limits(ended);
    found.extend(course.late_orders(ended));
    found.extend(course.unsafe_ends(ended));
    found.extend(course.journal());
    found.extend(course.wrong_rows());
    if ended.last().is_none_or(|last| last.failure.is_some()) {
        let last = ended.last().and_then(|last| last.failure.clone());
        found.push(format!("it is not complete after {} runners: {}", ended.len(), last.unwrap_or_default()));
    }
    found
}

struct Course<'a> {
    campaign: &'a Campaign,
    faults: FaultPlan,
    events: Vec<(f64, DeviceEvent)>,
    places: Vec<Place>,
    requests: Vec<Request>,
}

impl Course<'_> {
    /// Commands beyond the limits, and true angles beyond them that no stop order follows.
    fn beyond_limits(&self, ended: &[Ended]) -> Vec<String> {
        let limits = &self.campaign.plan.limits;
        // What somebody else has commanded is not the runner's.
        let of_others: Vec<f64> = self.faults.events(Fault::RunAway).collect();
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
        let is_beyond = |place: &Place| limits.reading(place.angles_deg, [0.0; 2], false).is_some();
        let leaves = self.places.windows(2).filter(|pair| !is_beyond(&pair[0]) && is_beyond(&pair[1]));
        let leaves = leaves.map(|pair| pair[1].end_s).filter(|at_s| self.runs(ended, *at_s));
        let unseen = leaves.filter(|at_s| self.has_port(*at_s) && !self.is_stopped(*at_s, NOTICED_S + ORDERS_S));
        let reached = unseen.map(|at_s| format!("no stop order after the limits were left at {at_s:.1} s"));
        commanded.chain(reached).collect()
    }

    /// Whether a runner runs at this time.
    fn runs(&self, ended: &[Ended], at_s: f64) -> bool {
        let killed: Vec<f64> = self.faults.events(Fault::Killed).collect();
        let run = ended.iter().find(|it| it.times_s[0] <= at_s && at_s < it.times_s[1]);
        run.is_some_and(|run| !run.is_killed || killed.iter().any(|kill| run.times_s[0] < *kill && at_s < *kill))
    }

    /// Whether a stop order goes to the turntable within these seconds.
    fn is_stopped(&self, at_s: f64, within_s: f64) -> bool {
        let times = at_s - 0.5..=at_s + within_s;
        let is_order = |it: &Request| it.to_turntable && times.contains(&it.at_s) && it.bytes.starts_with(STOP);
        self.requests.iter().any(is_order)
    }

    /// Whether the turntable's port exists over the time of an order.
    fn has_port(&self, at_s: f64) -> bool {
        let lost = Fault::Turntable(InjectedFault::PortLoss);
        ![at_s, at_s + ORDERS_S].iter().any(|at_s| self.faults.active(*at_s).any(|fault| fault == lost))
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
    fn late_orders(&self, ended: &[Ended]) -> Vec<String> {
        let signals = self.faults.events(Fault::Signal).filter(|at_s| self.runs(ended, *at_s));
        let begins =
            signals.map(|at_s| ("SIGTERM", at_s)).chain(self.pauses().into_iter().map(|at_s| ("a pause", at_s)));
        let late = begins.filter(|(_, at_s)| self.has_port(*at_s) && !self.is_stopped(*at_s, ORDERS_S));
        late.map(|(what, at_s)| format!("no stop order within {ORDERS_S} s of {what} at {at_s:.1} s")).collect()
    }

    /// When the runner paused while the turntable moved.
    fn pauses(&self) -> Vec<f64> {
        let set_back: Vec<f64> = self.faults.events(Fault::ClockSetBack).collect();
        if !set_back.is_empty() {
            // The journal's times do not tell it.
            return Vec::new();
        }
        let (lines, _) = journal::read(&self.campaign.plan.output.join(journal::JOURNAL)).unwrap_or_default();
        let paused = lines.iter().filter(|line| matches!(line.entry, Entry::Paused { .. }));
        paused.map(|line| line.unix_s - BEGIN_UNIX_S).filter(|at_s| self.moves(*at_s)).collect()
    }

    /// Runners that have said that all is safe, and the turntable moves after that or the chamber runs.
    fn unsafe_ends(&self, ended: &[Ended]) -> Vec<String> {
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
                self.faults.active(end.times_s[1]).any(|it| it == Fault::Turntable(InjectedFault::NoSettle));
            if !is_still && !is_swinging && !is_beyond {
                found.push(format!("the turntable moves after the end at {:.1} s", end.times_s[1]));
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
        let places: BTreeMap<(u64, u64), &Place> =
            self.places.iter().map(|place| ((place.session, place.sequence), place)).collect();
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let column = |name: &str| header.iter().position(|it| *it == name);
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
            let position = plan.positions.iter().find(|it| f64::from(it.number) == number(position));
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
