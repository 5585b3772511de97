//! How the worker waits: a pure state machine. The worker calls it for every sample and whenever no sample is there.
//!
//! `anticipate` learns each IMU's period, sleeps until a guard time before the next sample is due, then spins for a
//! short, bounded time. It expects samples on a grid. The **earliest** recent samples set the phase of the grid, not
//! the last one: a late sample must not make the next prediction late. The guard time follows the measured wake-up
//! delays. For streams that have stopped or are irregular the worker sleeps until it is notified; if the rate leaves no
//! time to sleep, it spins.
//!
//! Over 400 lines: one state machine and its tests, which are nearly half of the file.

use crate::config::Strategy;

/// Longest sleep \[ns\], and therefore the longest delay after a lost notification.
pub const BOUND_NS: u64 = 20_000_000;
/// Arrivals on the grid before a stream counts as periodic.
const CONFIDENT: u32 = 8;
/// Confidence that is lost by an arrival off the grid, and by one that is whole periods late.
const OFF_GRID_COST: u32 = 4;
const SKIPPED_COST: u32 = 2;
/// How far from the grid an arrival may be \[parts of a period\].
const ON_GRID: f64 = 0.25;
/// Part of the difference between measured and learned period by which each measurement corrects the period.
const PERIOD_GAIN: f64 = 1.0 / 64.0;
/// After this many samples on or after their grid points, the grid moves to the earliest of them.
const WINDOW: u32 = 32;
/// The delay estimate covers this part of the wake-up delays.
const COVERED: f64 = 0.98;
/// A longer delay raises the estimate by `COVERED` times this step, any other lowers it by `1 - COVERED` times this
/// step \[ns\].
const DELAY_STEP: f64 = 8_000.0;
/// Guard time beyond the estimated delay \[ns\].
const MARGIN: f64 = 10_000.0;
/// A rehearsal that took longer was interrupted: it does not predict the next one \[ns\].
const REHEARSAL_MAX_NS: u64 = 20_000;
/// Limits of the guard time \[ns\], and the part of a period that it may take; the worker spins for that part of the
/// time.
const GUARD_MIN: f64 = 20_000.0;
const GUARD_MAX: f64 = 200_000.0;
const GUARD_MAX_PART: f64 = 0.25;
/// If the guard time needs a larger part of a period, there is no time to sleep: the worker spins.
const SPIN_PART: f64 = 1.0 / 3.0;
/// Shorter sleeps are not worth their system call \[ns\].
const SHORTEST_SLEEP_NS: u64 = 20_000;
/// While no period is known, the worker spins for this long after a sample \[ns\]. It is then awake for an acquisition
/// that sends as soon as it has its answer, and can measure the period of that stream.
const SPIN_AFTER_SAMPLE_NS: u64 = 50_000;
/// The worker stays awake for this long after a sample, so that it does not lower its event before the sender has
/// notified \[ns\].
const LINGER_NS: u64 = 5_000;
/// Predictions that may be missed in a row before a stream counts as stopped.
const MAX_MISSES: u32 = 3;

/// What the worker does when there is nothing to serve.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Wait {
    /// Poll again at once.
    Spin,
    /// Sleep at most this long \[ns\]; a notification ends it early.
    Sleep(u64),
}

/// Decides how one worker waits for its streams.
#[derive(Debug)]
pub struct Waiter {
    strategy: Strategy,
    grids: Vec<ArrivalGrid>,
    /// Estimate of how late a sleep ends \[ns\]; it covers the part [`COVERED`] of the sleeps.
    delay: f64,
    /// How long a rehearsal takes: a maximum that decays \[ns\].
    rehearsal: f64,
    /// When the sleep under way should end \[ns\]; `None` once the worker is awake.
    wake: Option<u64>,
    /// When the last sample of any stream was served \[ns\].
    last: u64,
}

impl Waiter {
    /// A waiter for `streams` streams.
    pub fn new(strategy: Strategy, streams: usize) -> Self {
        let grids = vec![ArrivalGrid::default(); streams];
        Self { strategy, grids, delay: 2.0 * GUARD_MIN, rehearsal: 0.0, wake: None, last: 0 }
    }

    /// A sample of `stream` was served at `now`.
    #[inline]
    pub fn arrived(&mut self, stream: usize, now: u64) {
        if self.strategy == Strategy::Anticipate {
            // Only a sleep measures the delay. An estimate so long that it forbids sleep must decay, or it would stay
            // for ever.
            self.delay -= self.delay / 4096.0;
            self.last = now;
            self.grids[stream].arrived(now);
        }
    }

    /// Nothing is there at `now`.
    #[inline]
    pub fn next(&mut self, now: u64) -> Wait {
        match self.strategy {
            Strategy::Spin => Wait::Spin,
            Strategy::Block => Wait::Sleep(BOUND_NS),
            Strategy::Anticipate => self.anticipate(now),
        }
    }

    /// The streams whose next sample is due so soon after `now` that a sleep ends for it, or that no sleep begins
    /// before it.
    pub fn expected(&self, now: u64) -> impl Iterator<Item = usize> {
        let (guard, _) = self.guard();
        let soon = 2 * guard + LINGER_NS + SHORTEST_SLEEP_NS;
        let expected =
            move |grid: &ArrivalGrid| grid.known_period().is_some() && grid.due > now && grid.due - now <= soon;
        (0..).zip(&self.grids).filter(move |(_, grid)| expected(grid)).map(|(stream, _)| stream)
    }

    /// A rehearsal took `time` \[ns\].
    pub fn rehearsed(&mut self, time: u64) {
        if time <= REHEARSAL_MAX_NS {
            self.rehearsal = (time as f64).max(self.rehearsal - self.rehearsal / 64.0);
        }
    }

    /// The guard time \[ns\], and whether the periods leave time to sleep.
    fn guard(&self) -> (u64, bool) {
        let known = || self.grids.iter().filter_map(ArrivalGrid::known_period);
        let shortest = known().fold(f64::INFINITY, f64::min);
        let wanted = (self.delay + MARGIN + self.rehearsal * known().count() as f64).clamp(GUARD_MIN, GUARD_MAX);
        let guard = wanted.min((shortest * GUARD_MAX_PART).max(GUARD_MIN)) as u64;
        (guard, wanted <= shortest * SPIN_PART)
    }

    fn anticipate(&mut self, now: u64) -> Wait {
        let (guard, can_sleep) = self.guard();
        let Some(due) = self.grids.iter_mut().filter_map(|grid| grid.due(now, 2 * guard)).min() else {
            return if now.saturating_sub(self.last) < SPIN_AFTER_SAMPLE_NS {
                Wait::Spin
            } else {
                Wait::Sleep(BOUND_NS)
            };
        };
        if now.saturating_sub(self.last) < LINGER_NS {
            return Wait::Spin;
        }
        let sleep = due.saturating_sub(guard).saturating_sub(now);
        if sleep < SHORTEST_SLEEP_NS || !can_sleep {
            return Wait::Spin;
        }
        let sleep = sleep.min(BOUND_NS);
        self.wake = Some(now + sleep);
        Wait::Sleep(sleep)
    }

    /// A sleep has ended at `now`. Updates the delay estimate if it has run its full time. A delay that no guard time
    /// can cover, as when the host suspends a virtual machine, is ignored: it does not predict the next one.
    pub fn woke(&mut self, now: u64) {
        if let Some(delay) = self.wake.take().and_then(|wake| now.checked_sub(wake))
            && delay as f64 <= GUARD_MAX
        {
            let longer = delay as f64 > self.delay;
            self.delay += DELAY_STEP * if longer { COVERED } else { COVERED - 1.0 };
            self.delay = self.delay.clamp(0.0, GUARD_MAX);
        }
    }
}

/// The expected times of one stream's samples: period and phase, learned from the arrivals.
#[derive(Clone, Debug, Default)]
struct ArrivalGrid {
    last: u64,
    /// \[ns\]; 0 until the first sample.
    period: f64,
    /// The next point of the grid, or the previous one while its sample is still awaited \[ns\].
    due: u64,
    confidence: u32,
    misses: u32,
    /// Whether the last sample was off the grid.
    off_grid: bool,
    /// How many samples on the grid have come since it was last moved, and how late the earliest of them was \[ns\].
    after: u32,
    earliest: f64,
    /// How late samples are: a maximum that decays \[ns\].
    lateness: f64,
}

impl ArrivalGrid {
    fn arrived(&mut self, now: u64) {
        let step = now.saturating_sub(core::mem::replace(&mut self.last, now));
        self.misses = 0;
        if self.confidence == 0 {
            self.restart(step, now);
            return;
        }
        // Use the nearest point of the grid: the prediction may already be past the point of a late sample.
        let ahead = ((now as f64 - self.due as f64) / self.period).round() * self.period;
        let expected = self.due.saturating_add_signed(ahead as i64);
        let late = now as f64 - expected as f64;
        self.due = expected + self.period as u64;
        let last_was_off_grid = core::mem::replace(&mut self.off_grid, late.abs() > self.period * ON_GRID);
        if self.off_grid {
            self.lose_confidence(OFF_GRID_COST, step, now);
            return;
        }
        self.lateness = late.max(self.lateness - self.lateness / 256.0);
        self.adjust_phase(late);
        if (step as f64 / self.period).round() != 1.0 {
            self.lose_confidence(SKIPPED_COST, step, now);
        } else {
            self.confidence = (self.confidence + 1).min(2 * CONFIDENT);
            if !last_was_off_grid {
                self.period += (step as f64 - self.period) * PERIOD_GAIN;
            }
        }
    }

    /// Moves the grid to the earliest samples: at once if this sample is before its grid point, otherwise when
    /// [`WINDOW`] samples have come after theirs.
    fn adjust_phase(&mut self, late: f64) {
        self.after += 1;
        self.earliest = if self.after == 1 { late } else { self.earliest.min(late) };
        if late < 0.0 || self.after == WINDOW {
            self.due = self.due.saturating_add_signed(self.earliest as i64);
            self.after = 0;
        }
    }

    /// Starts to learn again, with the last step as the period; the next samples confirm or reject it.
    fn restart(&mut self, step: u64, now: u64) {
        self.period = step.max(1) as f64;
        self.due = now + step;
        self.after = 0;
        self.confidence = 1;
    }

    /// Lowers the confidence; at 0 learning starts again.
    fn lose_confidence(&mut self, by: u32, step: u64, now: u64) {
        self.confidence = self.confidence.saturating_sub(by);
        if self.confidence == 0 {
            self.restart(step, now);
        }
    }

    /// The period, once the stream counts as periodic.
    fn known_period(&self) -> Option<f64> {
        (self.confidence >= CONFIDENT).then_some(self.period)
    }

    /// When the next sample is due \[ns\]; `None` if the stream is not periodic or has stopped. A prediction counts as
    /// missed when it has passed by more than `tolerance` \[ns\] and by more than samples are usually late; then the
    /// next point of the grid is due.
    fn due(&mut self, now: u64, tolerance: u64) -> Option<u64> {
        self.known_period()?;
        let usual = (self.lateness * 1.25).min(self.period / 8.0);
        let tolerance = tolerance.max(usual as u64);
        while now > self.due + tolerance {
            self.misses += 1;
            if self.misses > MAX_MISSES {
                self.confidence = 0;
                return None;
            }
            self.due += (self.period as u64).max(1);
        }
        Some(self.due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Runs a waiter on arrivals. Returns for each arrival whether the worker was awake (spinning), and the share of
    /// time spent spinning.
    fn run(waiter: &mut Waiter, arrivals: &[(u64, usize)]) -> (Vec<bool>, f64) {
        let (mut now, mut spinning, started) = (arrivals[0].0, 0, arrivals[0].0);
        let mut awake = Vec::new();
        for &(at, stream) in arrivals {
            let mut hit = true;
            while now < at {
                match waiter.next(now) {
                    Wait::Spin => {
                        let step = 1_000.min(at - now);
                        spinning += step;
                        now += step;
                        hit = true;
                    }
                    Wait::Sleep(time) => {
                        // A notification ends the sleep early; either way it takes 20 us to wake.
                        now = at.min(now + time) + 20_000;
                        waiter.woke(now);
                        hit = now < at;
                    }
                }
            }
            now = now.max(at);
            awake.push(hit);
            waiter.arrived(stream, now);
        }
        (awake, spinning as f64 / (now - started) as f64)
    }

    fn share(awake: &[bool]) -> f64 {
        awake.iter().filter(|hit| **hit).count() as f64 / awake.len() as f64
    }

    fn periodic(start: u64, period: u64, count: u64, jitter: impl Fn(u64) -> u64) -> Vec<(u64, usize)> {
        (0..count).map(|k| (start + k * period + jitter(k), 0)).collect()
    }

    fn pseudo_random(k: u64) -> u64 {
        let mut x = k.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        x ^= x >> 29;
        x.wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 20
    }

    #[test]
    fn spin_never_sleeps_and_block_always_does() {
        let mut spin = Waiter::new(Strategy::Spin, 1);
        let mut block = Waiter::new(Strategy::Block, 1);
        for now in 1..100 {
            spin.arrived(0, now * MS);
            block.arrived(0, now * MS);
            assert_eq!(spin.next(now * MS + 5), Wait::Spin);
            assert_eq!(block.next(now * MS + 5), Wait::Sleep(BOUND_NS));
        }
    }

    #[test]
    fn a_periodic_stream_is_met_awake_at_little_cost() {
        for (period, most) in [(2_500_000, 0.06), (500_000, 0.25)] {
            let mut waiter = Waiter::new(Strategy::Anticipate, 1);
            let (awake, spinning) = run(&mut waiter, &periodic(MS, period, 2000, |_| 0));
            assert!(share(&awake[20..]) > 0.999, "{}", share(&awake[20..]));
            assert!(spinning < most, "{spinning}");
        }
    }

    #[test]
    fn jitter_and_drift_are_followed() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 1);
        // 30 us of jitter, and a clock that is 200 ppm slow.
        let arrivals = periodic(MS, 2_500_500, 3000, |k| pseudo_random(k) % 30_000);
        let (awake, spinning) = run(&mut waiter, &arrivals);
        assert!(share(&awake[50..]) > 0.99 && spinning < 0.08, "{} {spinning}", share(&awake[50..]));
    }

    #[test]
    fn jitter_that_is_not_symmetric_is_followed_too() {
        for period in [500_000, 2_500_000] {
            for jitter in [|k| k % 25 * 2_000, |k| 48_000 - k % 25 * 2_000, |k| pseudo_random(k) % 60_000] {
                let mut waiter = Waiter::new(Strategy::Anticipate, 1);
                let (awake, spinning) = run(&mut waiter, &periodic(MS, period, 4000, jitter));
                assert!(share(&awake[200..]) > 0.95, "{period}: {}", share(&awake[200..]));
                assert!(spinning < 0.4, "{spinning}");
            }
        }
    }

    #[test]
    fn one_long_oversleep_does_not_make_it_spin_for_ever() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 1);
        run(&mut waiter, &periodic(MS, 500_000, 200, |_| 0));
        waiter.delay = GUARD_MAX;
        run(&mut waiter, &periodic(MS + 200 * 500_000, 500_000, 10_000, |_| 0));
        let (awake, spinning) = run(&mut waiter, &periodic(MS + 10_200 * 500_000, 500_000, 4000, |_| 0));
        assert!(share(&awake) > 0.99 && spinning < 0.25, "{} {spinning}", share(&awake));
    }

    #[test]
    fn a_first_step_that_is_too_long_is_soon_forgotten() {
        for first in [3_750_000, 4_975_000] {
            let mut waiter = Waiter::new(Strategy::Anticipate, 1);
            let mut arrivals = vec![(MS, 0)];
            arrivals.extend(periodic(MS + first, 2_500_000, 1000, |_| 0));
            let (awake, _) = run(&mut waiter, &arrivals);
            assert!(share(&awake[150..]) > 0.99, "{}", share(&awake[150..]));
        }
    }

    #[test]
    fn one_late_sample_does_not_make_the_next_prediction_late() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 1);
        let late = |k| if k % 50 == 49 { 900_000 } else { 0 };
        let (awake, _) = run(&mut waiter, &periodic(MS, 2_500_000, 2000, late));
        let after: Vec<bool> = (51..2000).filter(|k| k % 50 == 0).map(|k| awake[k as usize]).collect();
        assert!(share(&after) > 0.95, "{}", share(&after));
    }

    #[test]
    fn a_pause_is_slept_through_and_a_doubled_rate_learned() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 1);
        run(&mut waiter, &periodic(MS, 2_500_000, 100, |_| 0));
        let stopped = MS + 100 * 2_500_000 + 50 * MS;
        assert_eq!(waiter.next(stopped), Wait::Sleep(BOUND_NS));
        let (awake, spinning) = run(&mut waiter, &periodic(stopped + MS, 1_250_000, 500, |_| 0));
        assert!(share(&awake[60..]) > 0.99 && spinning < 0.12, "{} {spinning}", share(&awake[60..]));
    }

    #[test]
    fn irregular_samples_are_waited_for_asleep() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 1);
        let mut at = MS;
        let arrivals = (0..2000).map(|k| {
            at += if pseudo_random(k).is_multiple_of(2) { 200_000 } else { 9 * MS };
            (at, 0)
        });
        let arrivals: Vec<_> = arrivals.collect();
        let (_, spinning) = run(&mut waiter, &arrivals);
        assert!(spinning < 0.05, "{spinning}");
    }

    #[test]
    fn a_rate_that_leaves_no_time_to_sleep_is_spun() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 1);
        let (awake, spinning) = run(&mut waiter, &periodic(MS, 50_000, 2000, |_| 0));
        assert!(share(&awake[20..]) > 0.999 && spinning > 0.9);
    }

    #[test]
    fn two_streams_are_both_met() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 2);
        let mut arrivals = periodic(MS, 2_500_000, 2000, |_| 0);
        arrivals.extend((0..1250).map(|k| (MS + 700_000 + k * 4_000_000, 1)));
        arrivals.sort_unstable();
        let (awake, spinning) = run(&mut waiter, &arrivals);
        assert!(share(&awake[50..]) > 0.99 && spinning < 0.1, "{} {spinning}", share(&awake[50..]));
    }

    #[test]
    fn it_wakes_early_enough_to_rehearse() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 2);
        run(&mut waiter, &periodic(MS, 2_500_000, 100, |_| 0));
        waiter.delay = GUARD_MIN;
        let (before, _) = waiter.guard();
        waiter.rehearsed(8_000);
        assert_eq!(waiter.guard().0, before + 8_000, "one of the two streams is periodic");
        waiter.rehearsed(3_000_000);
        assert_eq!(waiter.guard().0, before + 8_000, "an interrupted rehearsal predicts nothing");
        (0..1000).for_each(|_| waiter.rehearsed(1_000));
        assert!(waiter.guard().0 < before + 1_100);
    }

    #[test]
    fn only_a_sample_that_is_due_soon_is_expected() {
        let mut waiter = Waiter::new(Strategy::Anticipate, 2);
        run(&mut waiter, &periodic(MS, 2_500_000, 100, |_| 0));
        let (due, (guard, _)) = (waiter.grids[0].due, waiter.guard());
        for (before, expected) in [(1_000, true), (guard, true), (2 * guard + 30_000, false), (MS, false)] {
            assert_eq!(waiter.expected(due - before).eq([0]), expected, "{before}");
        }
        assert_eq!(waiter.expected(due + 1_000).count(), 0, "it is late: a rehearsal would delay it");
    }

    #[test]
    fn the_guard_covers_the_usual_delays_and_forgets_the_rare_ones() {
        // Delays of up to 60 us, and one in a hundred of 3 ms.
        let usual = |k: u64| if k.is_multiple_of(100) { 3 * MS } else { pseudo_random(k) % 60_000 };
        let guard_for = |delay: &dyn Fn(u64) -> u64| {
            let mut waiter = Waiter::new(Strategy::Anticipate, 1);
            let mut now = MS;
            for k in 0..20_000 {
                let at = MS + k * 2_500_000;
                while now < at {
                    match waiter.next(now) {
                        Wait::Spin => now += 1_000,
                        Wait::Sleep(time) => {
                            now = at.min(now + time) + delay(k);
                            waiter.woke(now);
                        }
                    }
                }
                now = now.max(at);
                waiter.arrived(0, now);
            }
            waiter.delay
        };
        let (usual, short) = (guard_for(&usual), guard_for(&|_| 1_000));
        assert!((50_000.0..75_000.0).contains(&usual), "{usual}");
        assert!(short < 2_000.0, "{short}");
    }
}
