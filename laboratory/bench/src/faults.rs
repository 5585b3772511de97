//! What goes wrong, and when.

use isotherm_station::InjectedFault;
use std::ops::Range;

/// Something that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DrawnFault {
    /// In the chamber, or on its line.
    Chamber(InjectedFault),
    /// In the turntable, or on its line.
    Turntable(InjectedFault),
    /// The beginning of some replies of the turntable arrives, and the rest never.
    CutReply,
    /// Replies of the turntable, or of the chamber, arrive at any time, some when the request was given up and the line
    /// was quiet; but one after the other.
    Slow {
        /// Whether of the turntable.
        turntable: bool,
    },
    /// The next angle that the turntable sends is wrong, and beyond its limits: once.
    Misread,
    /// Somebody else sends the turntable far beyond its limits, by more than a turn.
    RunAway,
    /// No sample of the IMU arrives.
    Silent,
    /// No sample of this IMU arrives; its number, from 0.
    SilentImu(usize),
    /// Every tenth sample is missing.
    Gaps,
    /// The acquisition starts again: another session.
    Restarted,
    /// SIGTERM.
    Signal,
    /// SIGKILL: the runner does not run any more.
    Killed,
    /// The machine loses its power: what was not synced is lost or torn, and it starts again.
    PowerLoss,
    /// The time of day is set back by an hour.
    ClockSetBack,
}

/// The faults of a campaign, with the times of each \[s\].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaultPlan(pub Vec<(DrawnFault, Range<f64>)>);

impl FaultPlan {
    /// Up to four faults within the first `seconds`, drawn from a seed.
    #[must_use]
    pub fn drawn(seed: u64, seconds: f64) -> Self {
        const LINE: [InjectedFault; 9] = [
            InjectedFault::Garbled,
            InjectedFault::Late,
            InjectedFault::Missing,
            InjectedFault::Duplicated,
            InjectedFault::Babble,
            InjectedFault::Dead,
            InjectedFault::Na,
            InjectedFault::Alarm,
            InjectedFault::PortLoss,
        ];
        const OTHERS: [DrawnFault; 15] = [
            DrawnFault::PowerLoss,
            DrawnFault::Slow { turntable: true },
            DrawnFault::Slow { turntable: false },
            DrawnFault::Misread,
            DrawnFault::Turntable(InjectedFault::NoSettle),
            DrawnFault::Chamber(InjectedFault::Overshoot),
            DrawnFault::Chamber(InjectedFault::NeverThere),
            DrawnFault::CutReply,
            DrawnFault::RunAway,
            DrawnFault::Silent,
            DrawnFault::Gaps,
            DrawnFault::Restarted,
            DrawnFault::Signal,
            DrawnFault::Killed,
            DrawnFault::ClockSetBack,
        ];
        let mut random = SeededRandom(seed);
        let count = random.below(5);
        let fault = |random: &mut SeededRandom| match random.below(LINE.len() * 2 + OTHERS.len()) {
            place if place < LINE.len() => DrawnFault::Chamber(LINE[place]),
            place if place < 2 * LINE.len() => DrawnFault::Turntable(LINE[place - LINE.len()]),
            place => OTHERS[place - 2 * LINE.len()],
        };
        let drawn = (0..count).map(|_| {
            let fault = fault(&mut random);
            let begin = random.uniform() * seconds;
            // From a tenth of a second to some minutes.
            (fault, begin..begin + 0.1 * libm::pow(3000.0_f64, random.uniform()))
        });
        Self(drawn.collect())
    }

    /// The faults that are active at this time \[s\].
    pub(crate) fn active(&self, at_s: f64) -> impl Iterator<Item = DrawnFault> {
        self.0.iter().filter(move |(_, times)| times.contains(&at_s)).map(|(fault, _)| *fault)
    }

    /// When one that is an event happens \[s\].
    pub(crate) fn events(&self, event: DrawnFault) -> impl Iterator<Item = f64> {
        self.0.iter().filter(move |(fault, _)| *fault == event).map(|(_, times)| times.start)
    }
}

/// Numbers of a seed: `SplitMix64`.
pub(crate) struct SeededRandom(pub u64);

impl SeededRandom {
    const fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }
}
