//! The order of turns: which channel a worker polls next, and what it does when no sample waits.

/// The channels of a worker, by number.
pub(super) trait Queues {
    /// How many there are.
    fn count(&self) -> usize;
    /// Answers the next sample of a channel, and returns whether there was one.
    fn serve(&mut self, channel: usize) -> bool;
    /// Whether no sample of a channel waits.
    fn is_empty(&self, channel: usize) -> bool;
    /// Does what the last answer of a channel has left to do.
    fn settle(&mut self, channel: usize);
}

/// The order of turns, from one round over all channels to the next.
#[derive(Debug, Default)]
pub(super) struct Turns {
    /// The channel that was served last.
    latest: usize,
    /// Whether its queue has been seen empty since.
    emptied: bool,
    /// How many polls of others have found nothing since.
    idle_polls: usize,
}

impl Turns {
    /// Polls every channel once, and returns whether any sample was served.
    ///
    /// A queue that was not empty since its last sample is a burst: first every other channel is polled. The channel
    /// that was served last is polled again after every idle one: its next sample then waits for the poll of one idle
    /// channel, not of all.
    #[inline(always)]
    pub(super) fn round(&mut self, queues: &mut impl Queues) -> bool {
        let (count, mut any) = (queues.count(), false);
        for turn in 0..count {
            if turn == self.latest && !self.emptied && self.idle_polls + 1 < count {
                continue;
            }
            if queues.serve(turn) {
                (*self, any) = (Self { latest: turn, ..Self::default() }, true);
                continue;
            }
            self.idle_polls += usize::from(turn != self.latest);
            if !self.emptied && (turn == self.latest || queues.is_empty(self.latest)) {
                self.emptied = true;
                queues.settle(self.latest);
            }
            if self.emptied && turn != self.latest && queues.serve(self.latest) {
                (*self, any) = (Self { latest: self.latest, ..Self::default() }, true);
            }
        }
        any
    }
}

/// What a worker does after a round that has served nothing.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(super) enum Idle {
    /// It does what the answers have left to do.
    #[default]
    Settle,
    /// It has just woken up before a sample: it rehearses for those that are expected.
    Expect,
    /// It rehearses when it is time to, otherwise it waits.
    Wait,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Channels with so many samples each, and what was done with them.
    #[derive(Default)]
    struct Waiting {
        samples: Vec<usize>,
        done: Vec<String>,
    }

    impl Queues for Waiting {
        fn count(&self) -> usize {
            self.samples.len()
        }
        fn serve(&mut self, channel: usize) -> bool {
            let waits = self.samples[channel] > 0;
            self.samples[channel] -= usize::from(waits);
            self.done.push(format!("{}{channel}", if waits { "serve " } else { "poll " }));
            waits
        }
        fn is_empty(&self, channel: usize) -> bool {
            self.samples[channel] == 0
        }
        fn settle(&mut self, channel: usize) {
            self.done.push(format!("settle {channel}"));
        }
    }

    impl Waiting {
        /// One round with these samples more.
        fn round(&mut self, turns: &mut Turns, samples: &[usize]) -> (bool, String) {
            self.samples.resize(samples.len(), 0);
            self.samples.iter_mut().zip(samples).for_each(|(waiting, more)| *waiting += more);
            (turns.round(self), std::mem::take(&mut self.done).join(", "))
        }
    }

    #[test]
    fn a_single_channel_is_polled_in_each_round_and_settled_once() {
        let (mut turns, mut waiting) = (Turns::default(), Waiting::default());
        let rounds = [
            (0, false, "poll 0, settle 0"),
            (2, true, "serve 0"),
            (0, true, "serve 0"),
            (0, false, "poll 0, settle 0"),
            (0, false, "poll 0"),
            (1, true, "serve 0"),
        ];
        for (samples, any, done) in rounds {
            assert_eq!(waiting.round(&mut turns, &[samples]), (any, done.to_owned()));
        }
    }

    #[test]
    fn the_channel_that_was_served_last_is_polled_after_every_idle_one() {
        let (mut turns, mut waiting) = (Turns::default(), Waiting::default());
        let first = waiting.round(&mut turns, &[0, 1, 0, 0]);
        assert_eq!(first, (true, "serve 1, poll 2, settle 1, poll 1, poll 3, poll 1".to_owned()));
        let idle = waiting.round(&mut turns, &[0, 0, 0, 0]);
        assert_eq!(idle, (false, "poll 0, poll 1, poll 1, poll 2, poll 1, poll 3, poll 1".to_owned()));
        let (any, done) = waiting.round(&mut turns, &[0, 1, 0, 0]);
        assert_eq!((any, done.as_str()), (true, "poll 0, serve 1, poll 2, settle 1, poll 1, poll 3, poll 1"));
    }

    #[test]
    fn a_burst_waits_until_every_other_channel_was_polled() {
        let (mut turns, mut waiting) = (Turns::default(), Waiting::default());
        let burst = waiting.round(&mut turns, &[9, 0, 1]);
        // The worker begins as if it had just served channel 0.
        assert_eq!(burst, (true, "poll 1, serve 2".to_owned()));
        let (_, done) = waiting.round(&mut turns, &[0, 1, 1]);
        assert_eq!(done, "serve 0, serve 1, serve 2");
        let (_, done) = waiting.round(&mut turns, &[0, 0, 0]);
        assert_eq!(done, "serve 0, poll 1, poll 2");
        let (_, done) = waiting.round(&mut turns, &[0, 0, 0]);
        assert_eq!(done, "serve 0, poll 1, poll 2", "every other one was polled: its turn has come again");
    }

    #[test]
    fn no_channel_is_starved_by_floods_of_the_others() {
        let (mut turns, mut waiting) = (Turns::default(), Waiting::default());
        let mut served = [0; 3];
        for _ in 0..100 {
            let (_, done) = waiting.round(&mut turns, &[2, 2, 2]);
            (0..3).for_each(|channel| served[channel] += done.matches(&format!("serve {channel}")).count());
        }
        assert!(served.iter().all(|count| (90..=110).contains(count)), "{served:?}");
    }
}
