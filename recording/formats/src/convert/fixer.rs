//! Rows with bad stamps get a time between their neighbours', are put in order or are left out; a clock that starts
//! again begins a session; a counter that rolls over is joined.
//!
//! Rows wait until [`WINDOW`] of them are there. While none of their stamps is odd they are given as they are, each for
//! the next one. Around an odd stamp the [`chain`] says which stamps are right.

use super::bad_stamps::{BadStamp, Remedy, Spot, StampTally};
use super::chain::{ChainLink, ChainStep, Rhythm, chain};
use super::placed::{SessionRow, near};
use super::rhythm::Twice;
use super::rollover::Rollover;
use isotherm_recording::foreign::Counter;
use isotherm_recording::foreign::ForeignRow;
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
/// Most that a row which is put in order may be off its place, in steps.
const OFF: f64 = 0.35;
/// Last rows that a row may repeat.
const REMEMBERED: usize = 1024;

/// Fixes the stamps of rows.
#[derive(Clone, Debug)]
pub(super) struct Fixer {
    rhythm: Rhythm,
    /// Which rows are left out, since they are there twice.
    twice: Twice,
    /// Whether the values of a row that is left out count for the next one.
    adds_up: bool,
    rollover: Rollover,
    waiting: VecDeque<WaitingRow>,
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
    tally: StampTally,
}

type Values = [i64; 2 * AXES];

#[derive(Clone, Copy, Debug)]
struct WaitingRow {
    reading: ForeignRow,
    stamp_ns: u64,
    /// Number of the row, from 1.
    row: u64,
    is_odd: bool,
}

impl Fixer {
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
            tally: StampTally::default(),
        }
    }

    /// Takes the next row. Rows that have their time go to `ready`.
    pub(super) fn push(&mut self, reading: ForeignRow, counter: Counter, ready: &mut VecDeque<ForeignRow>) {
        let Some(stamp_ns) = reading.timestamp_ns else { return ready.push_back(reading) };
        self.read += 1;
        self.rollover.set_counter(counter);
        if self.is_twice(stamp_ns, &reading.pulses) {
            return self.tally.take_twice(reading.place);
        }
        let newest_ns = self.newest_ns.replace(stamp_ns);
        let is_odd = newest_ns.map_or(stamp_ns == 0, |newest_ns| {
            self.rhythm.is_odd(newest_ns, stamp_ns) && self.usual_rollover(newest_ns, stamp_ns).is_none()
        });
        if is_odd {
            self.first_odd.get_or_insert(self.front + self.waiting.len() as u64);
        }
        self.highest_ns = self.highest_ns.max(stamp_ns);
        if self.remembered.len() == REMEMBERED {
            self.remembered.pop_front();
        }
        self.remembered.push_back((stamp_ns, reading.pulses));
        self.waiting.push_back(WaitingRow { reading, stamp_ns, row: self.read, is_odd });
        while self.waiting.len() >= WINDOW {
            match self.first_odd {
                Some(odd) if odd <= self.front + HEAD as u64 => self.resolve(false, ready),
                _ => self.give_first(ready),
            }
        }
    }

    /// Gives all rows that wait.
    pub(super) fn end(&mut self, ready: &mut VecDeque<ForeignRow>) {
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
    pub(super) const fn tally(&self) -> &StampTally {
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

    /// The width of a counter \[ns\] that has rolled over before, and does so again from one row to the next.
    fn usual_rollover(&self, earlier_ns: u64, later_ns: u64) -> Option<u64> {
        if later_ns >= earlier_ns || !self.rollover.is_found() {
            return None;
        }
        let width_ns = self.rollover.width_between(earlier_ns, later_ns, self.rhythm.period_ns)?;
        self.rhythm.is_in_step((width_ns - earlier_ns + later_ns) as f64, 1).then_some(width_ns)
    }

    /// Gives the first row that waits as it is.
    fn give_first(&mut self, ready: &mut VecDeque<ForeignRow>) {
        let Some(WaitingRow { mut reading, stamp_ns, row, .. }) = self.waiting.pop_front() else { return };
        self.front += 1;
        let mut time_ns = stamp_ns;
        if let Some((last_stamp_ns, last_ns)) = self.last {
            let width_ns = self.usual_rollover(last_stamp_ns, stamp_ns);
            width_ns.iter().for_each(|width_ns| self.rollover.take(*width_ns, row));
            time_ns = after(last_ns, last_stamp_ns, stamp_ns.wrapping_add(width_ns.unwrap_or(0)));
            self.rollover.step(stamp_ns.saturating_sub(last_stamp_ns));
        }
        self.last = Some((stamp_ns, time_ns));
        reading.timestamp_ns = Some(time_ns);
        ready.push_back(reading);
    }

    /// Finds the good rows of the window, gives those up to a calm place, and fixes what is between them.
    fn resolve(&mut self, is_end: bool, ready: &mut VecDeque<ForeignRow>) {
        let stamps: Vec<_> = self.waiting.iter().map(|row| row.stamp_ns).collect();
        let mut chain = chain(&stamps, self.last.map(|(stamp_ns, _)| stamp_ns), is_end, &self.rhythm, &self.rollover);
        let mut rows = stamps.len();
        if !is_end {
            chain.truncate(cut(&chain, rows.saturating_sub(TAIL)));
            rows = chain.last().map_or(rows, |last| last.at + 1);
        }
        let good = self.good(&chain);
        let mut placed = good.clone();
        let mut is_good = vec![false; rows];
        good.iter().for_each(|row| is_good[row.at] = true);
        let mut at = 0;
        while at < rows {
            let end = (at..rows).find(|at| is_good[*at]).unwrap_or(rows);
            if at < end {
                self.fix(&good, at..end, &mut placed);
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
    fn good(&mut self, chain: &[ChainStep]) -> Vec<SessionRow> {
        let (mut last, mut session) = (self.last, 0);
        let mut good = Vec::with_capacity(chain.len());
        for ChainStep { at, link, .. } in chain.iter().copied() {
            let WaitingRow { stamp_ns, row, reading, .. } = self.waiting[at];
            let time_ns = match (last, link) {
                (Some((earlier_ns, time_ns)), ChainLink::Step) => {
                    self.rollover.step(stamp_ns.saturating_sub(earlier_ns));
                    after(time_ns, earlier_ns, stamp_ns)
                }
                (Some((earlier_ns, time_ns)), ChainLink::Rollover(width_ns)) => {
                    self.rollover.take(width_ns, row);
                    after(time_ns, earlier_ns, stamp_ns.wrapping_add(width_ns))
                }
                (Some((before_ns, _)), ChainLink::Session) => {
                    session += 1;
                    self.tally.take_restart(Spot { place: reading.place, stamp_ns, before_ns: Some(before_ns) });
                    stamp_ns
                }
                (None, _) => stamp_ns,
            };
            last = Some((stamp_ns, time_ns));
            good.push(SessionRow { session, time_ns, at, is_fixed: false });
        }
        good
    }

    /// Places the bad rows of a run between two good ones, and counts them: where their own stamps have them in this
    /// hole or the ones next to it; or in order, where as many places are left as rows; or where their own stamps have
    /// them nearby.
    fn fix(&mut self, good: &[SessionRow], run: core::ops::Range<usize>, placed: &mut Vec<SessionRow>) {
        let next = good.partition_point(|row| row.at < run.start);
        let before = next.checked_sub(1).map(|before| (good[before], self.waiting[good[before].at].stamp_ns));
        let first = self.last.map(|(stamp_ns, time_ns)| (SessionRow { time_ns, ..SessionRow::default() }, stamp_ns));
        let earlier = before.or(first);
        let later = good.get(next).map(|row| (*row, self.waiting[row.at].stamp_ns));
        let around = [earlier, later].map(|row| row.map(|(_, stamp_ns)| stamp_ns));
        let rows = run.len() + 1;
        let own = |fixer: &Self, at: usize, good: &[SessionRow], placed: &[SessionRow]| {
            let (clock, first_ns) = earlier.or(later)?;
            let time_ns = after(clock.time_ns, first_ns, fixer.waiting[at].stamp_ns);
            fixer.own_place(SessionRow { time_ns, at, ..clock }, good, placed)
        };
        let mut left = Vec::new();
        let mut highest_ns = around[0].unwrap_or(0);
        let beside = &good[next.saturating_sub(2)..good.len().min(next + 2)];
        let first = first.filter(|_| next < 2).map(|(row, _)| row);
        let holes: Vec<_> = first.iter().chain(beside).copied().collect();
        for at in run {
            match own(self, at, &holes, placed) {
                Some(row) => {
                    placed.push(row);
                    let stamp_ns = self.waiting[at].stamp_ns;
                    if stamp_ns < highest_ns || around[1].is_some_and(|later_ns| later_ns < stamp_ns) {
                        self.tally.take(BadStamp::Overtaken, Remedy::Sorted, self.spot(at));
                    }
                    highest_ns = highest_ns.max(stamp_ns);
                }
                None => left.push(at),
            }
        }
        let free = earlier.zip(later).and_then(|(earlier, later)| self.free(&earlier.0, &later.0, rows, placed));
        let mut free = free.filter(|free| free.len() == left.len()).into_iter().flatten();
        for at in left {
            let (kind, spot) = (self.kind(at, around), self.spot(at));
            if let Some(row) = free.next() {
                placed.push(SessionRow { at, ..row });
                self.tally.take(kind, Remedy::Fixed, spot);
            } else if let Some(row) = own(self, at, near(good, at), placed) {
                placed.push(row);
                self.tally.take(BadStamp::Overtaken, Remedy::Sorted, spot);
            } else {
                self.tally.take(kind, Remedy::LeftOut, spot);
                self.carry(at, later.map(|(row, _)| row.at));
            }
        }
    }

    /// The places that are free between two good rows which are `rows` apart; `None` if the time between them is not
    /// that of as many rows.
    fn free(
        &self,
        earlier: &SessionRow,
        later: &SessionRow,
        rows: usize,
        placed: &[SessionRow],
    ) -> Option<Vec<SessionRow>> {
        let (hole, session) = (earlier.hole(later), later.session);
        if earlier.session != session || !self.rhythm.is_in_step(hole.length_ns(), rows) {
            return None;
        }
        let taken: Vec<_> = hole.taken(session, rows as f64, placed).collect();
        let free = (1..rows).filter(|slot| !taken.contains(slot)).map(|slot| {
            let step_ns = i128::from(later.time_ns) - i128::from(earlier.time_ns);
            let time_ns = i128::from(earlier.time_ns) + step_ns * slot as i128 / rows as i128;
            SessionRow { session, time_ns: time_ns as u64, at: 0, is_fixed: true }
        });
        Some(free.collect())
    }

    fn spot(&self, at: usize) -> Spot {
        let WaitingRow { stamp_ns, reading, .. } = self.waiting[at];
        let before = at.checked_sub(1).map(|before| self.waiting[before].stamp_ns);
        let before_ns = before.or(self.last.map(|(before_ns, _)| before_ns));
        Spot { place: reading.place, stamp_ns, before_ns }
    }

    /// What is wrong with the stamp of a bad row, by the good rows before and behind it.
    fn kind(&self, at: usize, [earlier_ns, later_ns]: [Option<u64>; 2]) -> BadStamp {
        let stamp_ns = self.waiting[at].stamp_ns;
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

    /// The place of a row in a hole between two of these good rows, if its own time is there.
    fn own_place(&self, row: SessionRow, good: &[SessionRow], placed: &[SessionRow]) -> Option<SessionRow> {
        let is_around = |pair: &&[SessionRow]| {
            let [earlier, later] = [pair[0], pair[1]];
            earlier.session == row.session && later.session == row.session && earlier.hole(&later).contains(row.time_ns)
        };
        let pair = good.windows(2).find(is_around).filter(|_| self.rhythm.is_even())?;
        let hole = pair[0].hole(&pair[1]);
        let slots = (hole.length_ns() / self.rhythm.period_ns).round();
        let slot = hole.slot(row.time_ns, slots);
        let is_near = (slot - slot.round()).abs() <= OFF && (1.0..slots).contains(&slot.round());
        let is_free = is_near && !hole.taken(row.session, slots, placed).any(|taken| taken == slot.round() as usize);
        is_free.then_some(SessionRow { is_fixed: false, ..row })
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
    fn give(&mut self, rows: usize, mut placed: Vec<SessionRow>, ready: &mut VecDeque<ForeignRow>) {
        placed.sort_unstable();
        let mut session = 0;
        for row in placed {
            let reading = self.waiting[row.at].reading;
            let begins_session = core::mem::replace(&mut session, row.session) != row.session;
            let timestamp_ns = Some(row.time_ns);
            ready.push_back(ForeignRow { timestamp_ns, begins_session, is_fixed: row.is_fixed, ..reading });
        }
        self.waiting.drain(..rows);
        self.front += rows as u64;
    }
}

/// The time of a stamp on the clock on which `earlier_ns` was `time_ns`.
const fn after(time_ns: u64, earlier_ns: u64, stamp_ns: u64) -> u64 {
    time_ns.wrapping_add(stamp_ns.wrapping_sub(earlier_ns))
}

/// How many rows of the chain are given: up to a row among calm ones, before the row `limit` of the window.
fn cut(chain: &[ChainStep], limit: usize) -> usize {
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
