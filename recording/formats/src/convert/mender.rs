//! Rows with bad stamps get a time between their neighbours', are put in order or are left out; a clock that starts
//! again begins a session; a counter that rolls over is joined.
//!
//! Rows wait until [`WINDOW`] of them are there. While none of their stamps is odd they are given as they are, each for
//! the next one. Around an odd stamp the [`chain`] says which stamps are right.

use super::bad_stamps::{BadStamp, Remedy, Spot, Tally};
use super::chain::{Link, Linked, Rhythm, chain};
use super::rhythm::Twice;
use super::rollover::{Counter, Rollover};
use super::source::Reading;
use isotherm_shared::wire::AXES;
use std::collections::VecDeque;

/// Rows that wait.
pub(super) const WINDOW: usize = 128;
/// Rows before an odd stamp that may be wrong themselves: it shows that they were ahead.
const HEAD: usize = 48;
/// Rows behind those that are judged, which show how it goes on.
const TAIL: usize = 48;
/// Rows on both sides of a cut that have to be in step.
const CALM: usize = 8;
/// Most rows by which a row is overtaken.
const OVERTAKEN: usize = 8;
/// Most that a row which is put in order may be off its place, in steps.
const OFF: f64 = 0.35;
/// Last rows that a row may repeat.
const REMEMBERED: usize = 1024;

/// Mends the stamps of rows.
#[derive(Clone, Debug)]
pub(super) struct Mender {
    rhythm: Rhythm,
    /// Which rows are left out, since they are there twice.
    twice: Twice,
    /// Whether the values of a row that is left out count for the next one.
    adds_up: bool,
    rollover: Rollover,
    waiting: VecDeque<Waiting>,
    /// Numbers of the first row that waits, and of the first one with an odd stamp.
    front: u64,
    first_odd: Option<u64>,
    /// The last row that was given: its stamp and its time \[ns\].
    last: Option<(u64, u64)>,
    /// The last stamp that was taken, and the highest of those that may be repeated \[ns\].
    newest_ns: Option<u64>,
    highest_ns: u64,
    /// The last rows, without those that were left out as repeated.
    remembered: VecDeque<(u64, Values)>,
    read: u64,
    tally: Tally,
}

type Values = [i64; 2 * AXES];

#[derive(Clone, Copy, Debug)]
struct Waiting {
    reading: Reading,
    stamp_ns: u64,
    /// Number of the row, from 1.
    row: u64,
    is_odd: bool,
}

/// A row that gets its time.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
struct Placed {
    /// How often the clock has started again since the last row before the window.
    session: u32,
    time_ns: u64,
    at: usize,
    is_mended: bool,
}

impl Mender {
    /// Of rows whose stamps have this rhythm. `adds_up`: the values count since the row before.
    pub(super) fn new(rhythm: Rhythm, twice: Twice, adds_up: bool) -> Self {
        Self {
            rhythm,
            twice,
            adds_up,
            rollover: Rollover::default(),
            waiting: VecDeque::new(),
            front: 0,
            first_odd: None,
            last: None,
            newest_ns: None,
            highest_ns: 0,
            remembered: VecDeque::new(),
            read: 0,
            tally: Tally::default(),
        }
    }

    /// Takes the next row. Rows that have their time go to `ready`.
    pub(super) fn push(&mut self, reading: Reading, counter: Counter, ready: &mut VecDeque<Reading>) {
        let Some(stamp_ns) = reading.timestamp_ns else { return ready.push_back(reading) };
        self.read += 1;
        self.rollover.set_counter(counter);
        if self.is_twice(stamp_ns, &reading.pulses) {
            return self.tally.take_twice(reading.place);
        }
        let newest_ns = self.newest_ns.replace(stamp_ns);
        let is_odd = newest_ns.map_or(stamp_ns == 0, |newest_ns| self.rhythm.is_odd(newest_ns, stamp_ns));
        if is_odd {
            self.first_odd.get_or_insert(self.front + self.waiting.len() as u64);
        }
        self.highest_ns = self.highest_ns.max(stamp_ns);
        if self.remembered.len() == REMEMBERED {
            self.remembered.pop_front();
        }
        self.remembered.push_back((stamp_ns, reading.pulses));
        self.waiting.push_back(Waiting { reading, stamp_ns, row: self.read, is_odd });
        while self.waiting.len() >= WINDOW {
            match self.first_odd {
                Some(odd) if odd <= self.front + HEAD as u64 => self.resolve(false, ready),
                _ => self.give_first(ready),
            }
        }
    }

    /// Gives all rows that wait.
    pub(super) fn end(&mut self, ready: &mut VecDeque<Reading>) {
        while !self.waiting.is_empty() {
            match self.first_odd {
                Some(_) => self.resolve(true, ready),
                None => self.give_first(ready),
            }
        }
    }

    /// Number of rows that have been read.
    pub(super) const fn rows(&self) -> u64 {
        self.read
    }

    /// The stamps that were bad.
    pub(super) const fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The rollovers.
    pub(super) const fn rollover(&self) -> &Rollover {
        &self.rollover
    }

    /// Whether a row has the stamp and the values of an earlier one.
    fn is_twice(&self, stamp_ns: u64, values: &Values) -> bool {
        let may_be = self.newest_ns.is_some() && stamp_ns <= self.highest_ns;
        let is_judged =
            may_be && if self.newest_ns == Some(stamp_ns) { self.twice.standing } else { self.twice.earlier };
        is_judged && self.remembered.iter().rev().any(|(of, their)| *of == stamp_ns && their == values)
    }

    /// Gives the first row that waits as it is.
    fn give_first(&mut self, ready: &mut VecDeque<Reading>) {
        let Some(Waiting { mut reading, stamp_ns, .. }) = self.waiting.pop_front() else { return };
        self.front += 1;
        let mut time_ns = stamp_ns;
        if let Some((last_stamp_ns, last_ns)) = self.last {
            time_ns = after(last_ns, last_stamp_ns, stamp_ns);
            self.rollover.step(stamp_ns.saturating_sub(last_stamp_ns));
        }
        self.last = Some((stamp_ns, time_ns));
        reading.timestamp_ns = Some(time_ns);
        ready.push_back(reading);
    }

    /// Finds the good rows of the window, gives those up to a calm place, and mends what is between them.
    fn resolve(&mut self, is_end: bool, ready: &mut VecDeque<Reading>) {
        let stamps: Vec<_> = self.waiting.iter().map(|row| row.stamp_ns).collect();
        let mut chain = chain(&stamps, self.last.map(|(stamp_ns, _)| stamp_ns), &self.rhythm, &self.rollover);
        let mut rows = stamps.len();
        if !is_end {
            chain.truncate(cut(&chain, rows.saturating_sub(TAIL)));
            rows = chain.last().map_or(rows, |last| last.at + 1);
        }
        let good = self.good(&chain);
        let mut placed = good.clone();
        let mut bad = Bad { good: &good, next: 0 };
        let mut is_good = vec![false; rows];
        good.iter().for_each(|row| is_good[row.at] = true);
        let mut at = 0;
        while at < rows {
            let end = (at..rows).find(|at| is_good[*at]).unwrap_or(rows);
            if at < end {
                bad.next = good.partition_point(|row| row.at < at);
                self.mend(&bad, at..end, &mut placed);
            }
            at = end + 1;
        }
        self.give(rows, placed, ready);
        if let Some(last) = good.last() {
            self.last = Some((stamps[last.at], last.time_ns));
        }
        // The row before the first one that waits may be left out.
        if let Some((first, (last_ns, _))) = self.waiting.front_mut().zip(self.last) {
            first.is_odd |= self.rhythm.is_odd(last_ns, first.stamp_ns);
        }
        let waiting = self.waiting.iter().map(|row| row.stamp_ns);
        self.highest_ns = self.last.iter().map(|(stamp_ns, _)| *stamp_ns).chain(waiting).max().unwrap_or(0);
        self.first_odd = self.waiting.iter().position(|row| row.is_odd).map(|at| self.front + at as u64);
    }

    /// The rows of the chain with their times.
    fn good(&mut self, chain: &[Linked]) -> Vec<Placed> {
        let (mut last, mut session) = (self.last, 0);
        let mut good = Vec::with_capacity(chain.len());
        for Linked { at, link, .. } in chain.iter().copied() {
            let Waiting { stamp_ns, row, reading, .. } = self.waiting[at];
            let time_ns = match (last, link) {
                (Some((earlier_ns, time_ns)), Link::Step) => {
                    self.rollover.step(stamp_ns.saturating_sub(earlier_ns));
                    after(time_ns, earlier_ns, stamp_ns)
                }
                (Some((earlier_ns, time_ns)), Link::Rollover(width_ns)) => {
                    self.rollover.take(width_ns, row);
                    after(time_ns, earlier_ns, stamp_ns.wrapping_add(width_ns))
                }
                (Some((before_ns, _)), Link::Session) => {
                    session += 1;
                    self.tally.take_restart(Spot { place: reading.place, stamp_ns, before_ns });
                    stamp_ns
                }
                (None, _) => stamp_ns,
            };
            last = Some((stamp_ns, time_ns));
            good.push(Placed { session, time_ns, at, is_mended: false });
        }
        good
    }

    /// Places the bad rows of a run between two good ones, and counts them.
    fn mend(&mut self, bad: &Bad<'_>, run: core::ops::Range<usize>, placed: &mut Vec<Placed>) {
        let before = bad.before();
        let earlier = match before {
            Some(row) => Some((row.at as i64, row.session, row.time_ns, self.waiting[row.at].stamp_ns)),
            None => self.last.map(|(stamp_ns, time_ns)| (-1, 0, time_ns, stamp_ns)),
        };
        let later = bad.after();
        // Both neighbours, if the time between them is that of the rows.
        let between = earlier.zip(later).and_then(|((at, session, time_ns, stamp_ns), later)| {
            let (rows, step_ns) = (later.at as i64 - at, later.time_ns as f64 - time_ns as f64);
            let is_right = session == later.session && self.rhythm.is_in_step(step_ns, rows as usize);
            is_right.then_some((time_ns, stamp_ns, later.time_ns, rows))
        });
        let slots = between.map(|(time_ns, stamp_ns, end_ns, rows)| {
            let own = run.clone().map(|at| after(time_ns, stamp_ns, self.waiting[at].stamp_ns));
            slots(own, self.rhythm.is_even(), time_ns, end_ns, rows as u64)
        });
        let mut slots = slots.unwrap_or_default().into_iter();
        let mut highest_ns = 0;
        for at in run {
            let Waiting { stamp_ns, reading, .. } = self.waiting[at];
            let kind = self.kind(at, earlier.map(|(.., stamp_ns)| stamp_ns), later.map(|row| row.at));
            let before_ns = if at > 0 { Some(self.waiting[at - 1].stamp_ns) } else { self.last.map(|(ns, _)| ns) };
            let spot = Spot { place: reading.place, stamp_ns, before_ns: before_ns.unwrap_or(stamp_ns) };
            if let Some(((time_ns, first_ns, end_ns, rows), slot)) = between.zip(slots.next()) {
                let session = earlier.map_or(0, |(_, session, ..)| session);
                match slot {
                    Slot::Own => {
                        let time_ns = after(time_ns, first_ns, stamp_ns);
                        placed.push(Placed { session, time_ns, at, is_mended: false });
                        if stamp_ns < highest_ns {
                            self.tally.take(BadStamp::Overtaken, Remedy::Sorted, spot);
                        }
                        highest_ns = highest_ns.max(stamp_ns);
                    }
                    Slot::Free(slot) => {
                        let step_ns = i128::from(end_ns) - i128::from(time_ns);
                        let time_ns = (i128::from(time_ns) + step_ns * i128::from(slot) / i128::from(rows)) as u64;
                        placed.push(Placed { session, time_ns, at, is_mended: true });
                        self.tally.take(kind, Remedy::Mended, spot);
                    }
                }
            } else if let Some(row) = self.own_place(bad, at, placed) {
                placed.push(row);
                self.tally.take(BadStamp::Overtaken, Remedy::Sorted, spot);
            } else {
                self.tally.take(kind, Remedy::LeftOut, spot);
                self.carry(at, later.map(|row| row.at));
            }
        }
    }

    /// What is wrong with the stamp of a bad row, by the good rows before and behind it.
    fn kind(&self, at: usize, earlier_ns: Option<u64>, later: Option<usize>) -> BadStamp {
        let stamp_ns = self.waiting[at].stamp_ns;
        let later_ns = later.map(|later| self.waiting[later].stamp_ns);
        let beside = at.checked_sub(1).into_iter().chain([at + 1]).filter_map(|at| self.waiting.get(at));
        let mut beside = beside.map(|row| row.stamp_ns).chain(earlier_ns).chain(later_ns);
        match (earlier_ns, later_ns) {
            _ if stamp_ns == 0 => BadStamp::Zero,
            _ if beside.any(|of| of == stamp_ns) => BadStamp::Repeated,
            (Some(earlier_ns), _) if stamp_ns < earlier_ns => BadStamp::Back,
            (None, Some(later_ns)) if stamp_ns < later_ns => BadStamp::Back,
            _ => BadStamp::Ahead,
        }
    }

    /// The place of a row that was overtaken by a few others: by its own stamp, in a hole between two good rows.
    fn own_place(&self, bad: &Bad<'_>, at: usize, placed: &[Placed]) -> Option<Placed> {
        if !self.rhythm.is_even() {
            return None;
        }
        let near = bad.good.iter().filter(|row| row.at.abs_diff(at) <= OVERTAKEN);
        let first = self.last.map(|(stamp_ns, time_ns)| (0, time_ns, stamp_ns)).filter(|_| at < OVERTAKEN);
        let near = near.map(|row| (row.session, row.time_ns, self.waiting[row.at].stamp_ns));
        let near: Vec<_> = first.into_iter().chain(near).collect();
        let stamp_ns = self.waiting[at].stamp_ns;
        near.windows(2).find_map(|pair| {
            let [(session, from_ns, first_ns), (other, to_ns, _)] = [pair[0], pair[1]];
            let time_ns = after(from_ns, first_ns, stamp_ns);
            let slots = ((to_ns.checked_sub(from_ns)? as f64) / self.rhythm.period_ns).round();
            let is_within = session == other && (from_ns + 1..to_ns).contains(&time_ns);
            let slot = is_within.then(|| slot(time_ns, from_ns, to_ns, slots)).flatten()?;
            let is_taken = |row: &Placed| {
                let is_within = row.session == session && (from_ns + 1..to_ns).contains(&row.time_ns);
                is_within && slot_near(row.time_ns, from_ns, to_ns, slots) == slot
            };
            let row = Placed { session, time_ns, at, is_mended: false };
            (!placed.iter().any(is_taken)).then_some(row)
        })
    }

    /// Adds what a row that is left out has counted to the next one.
    fn carry(&mut self, at: usize, to: Option<usize>) {
        if let Some(to) = to.filter(|_| self.adds_up) {
            let counted = self.waiting[at].reading.pulses;
            let all = &mut self.waiting[to].reading.pulses;
            all.iter_mut().zip(counted).for_each(|(all, counted)| *all += counted);
        }
    }

    /// Gives the first `rows` rows that wait, those that have a time, in its order.
    fn give(&mut self, rows: usize, mut placed: Vec<Placed>, ready: &mut VecDeque<Reading>) {
        placed.sort_unstable();
        let mut session = 0;
        for row in placed {
            let reading = self.waiting[row.at].reading;
            let begins_session = core::mem::replace(&mut session, row.session) != row.session;
            let timestamp_ns = Some(row.time_ns);
            ready.push_back(Reading { timestamp_ns, begins_session, is_mended: row.is_mended, ..reading });
        }
        self.waiting.drain(..rows);
        self.front += rows as u64;
    }
}

/// The good rows, and the first of them behind a run of bad ones.
struct Bad<'a> {
    good: &'a [Placed],
    next: usize,
}

impl Bad<'_> {
    fn before(&self) -> Option<&Placed> {
        self.good.get(self.next.checked_sub(1)?)
    }

    fn after(&self) -> Option<&Placed> {
        self.good.get(self.next)
    }
}

/// The time of a stamp on the clock on which `earlier_ns` was `time_ns`.
const fn after(time_ns: u64, earlier_ns: u64, stamp_ns: u64) -> u64 {
    time_ns.wrapping_add(stamp_ns.wrapping_sub(earlier_ns))
}

/// How many rows of the chain are given: up to a row among calm ones, before the row `limit` of the window.
fn cut(chain: &[Linked], limit: usize) -> usize {
    let before = chain.partition_point(|row| row.at < limit);
    let is_calm = |number: &usize| {
        let (first, last) = (number.checked_sub(CALM), number + CALM);
        let Some((first, last)) = first.and_then(|first| Some((chain.get(first)?, chain.get(last)?))) else {
            return false;
        };
        let all = &chain[number - CALM + 1..=number + CALM];
        last.at - first.at == 2 * CALM && all.iter().all(|row| row.is_in_step)
    };
    (0..before).rev().find(is_calm).map_or(before.max(1), |number| number + 1)
}

/// The slot of a time among so many from one time to another, if it is near one and not at the ends.
fn slot(time_ns: u64, from_ns: u64, to_ns: u64, slots: f64) -> Option<u64> {
    let at = (time_ns - from_ns) as f64 * slots / (to_ns - from_ns) as f64;
    let is_near = (at - at.round()).abs() <= OFF && at.round() >= 1.0 && at.round() <= slots - 1.0;
    is_near.then_some(at.round() as u64)
}

/// The slot that is nearest.
fn slot_near(time_ns: u64, from_ns: u64, to_ns: u64, slots: f64) -> u64 {
    ((time_ns - from_ns) as f64 * slots / (to_ns - from_ns) as f64).round() as u64
}

/// Where a bad row is between two good ones.
#[derive(Clone, Copy, Debug)]
enum Slot {
    /// Where its own stamp has it, out of order.
    Own,
    /// In this slot of those that are left.
    Free(u64),
}

/// The slots of bad rows between two times that are `rows` periods apart: rows with these times `own` are in their own
/// slot, if that may be and no other one claims it. The others fill what is left, in their order.
fn slots(own: impl Iterator<Item = u64>, may_be_own: bool, from_ns: u64, to_ns: u64, rows: u64) -> Vec<Slot> {
    let of = |time_ns: u64| {
        let is_within = may_be_own && from_ns < time_ns && time_ns < to_ns;
        is_within.then(|| slot(time_ns, from_ns, to_ns, rows as f64)).flatten()
    };
    let claims: Vec<_> = own.map(of).collect();
    let is_only = |claim: u64| claims.iter().filter(|other| **other == Some(claim)).count() == 1;
    let mut free = (1..rows).filter(|slot| !claims.contains(&Some(*slot)) || !is_only(*slot));
    let all = claims.iter().map(|claim| match claim {
        Some(claim) if is_only(*claim) => Slot::Own,
        _ => Slot::Free(free.next().unwrap_or(rows)),
    });
    all.collect()
}
