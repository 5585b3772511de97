//! Where frames are placed after outages of all lengths, over devices, transports and rates, against what is true. With
//! `ISOTHERM_SEEDS=40` there are so many runs of each device over each transport.

use std::cell::Cell;

use super::world::{Event, Numbers, Random, Seen, Transport, World};

/// Devices with their intervals \[ns\].
const DEVICES: [(Numbers, f64); 7] = [
    (Numbers::CountsTime(8, 2), 1e6),
    (Numbers::CountsFrames(8), 0.5e6),
    (Numbers::CountsFrames(16), 5e6),
    (Numbers::Clock(1), 2.5e6),
    (Numbers::Clock(1000), 10e6),
    (Numbers::Nothing, 5e6),
    (Numbers::Nothing, 1e6),
];
const TRANSPORTS: [Transport; 4] =
    [Transport::Late(20e3), Transport::Late(300e3), Transport::Bursts(1e6), Transport::Bursts(16e6)];

/// Runs worlds of an event over all devices and transports, and checks each. Prints what they have shown.
fn all(name: &str, event: impl Fn(&mut Random) -> Event, check: impl Fn(&World, &Seen)) {
    let (mut runs, mut sum, mut wait, mut right) = (0, Seen::default(), 0.0f64, 0);
    for (numbers, interval_ns) in DEVICES {
        for transport in TRANSPORTS {
            for seed in 0..seeds() {
                let mut random = Random(seed * 77 + 5);
                let world = World { numbers, transport, event: event(&mut random), interval_ns, seed };
                let seen = world.seen();
                check(&world, &seen);
                runs += 1;
                right += u64::from(seen.stamp <= 0.0);
                wait = wait.max(seen.longest_wait);
                sum.wrong += u64::from(seen.wrong > 0);
                sum.ambiguous += u64::from(seen.ambiguous > 0);
                sum.sessions += u64::from(seen.sessions > 1);
                sum.steps += u64::from(seen.steps > 0);
            }
        }
    }
    println!(
        "{name}: {runs} runs, {right} with all stamps in their bound, {} with a wrong count, {} with one that is said to \
         be uncertain, {} with a new session, {} with a false step of time; longest wait {:.0} ms",
        sum.wrong,
        sum.ambiguous,
        sum.sessions,
        sum.steps,
        wait / 1e6
    );
}

/// Runs of each device over each transport.
fn seeds() -> u64 {
    std::env::var("ISOTHERM_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(1)
}

impl World {
    /// Whether nothing shows how many frames are missing: the jitter is longer than the interval.
    fn is_blind(&self) -> bool {
        matches!(self.numbers, Numbers::Nothing) && self.jitter() > 0.5 * self.interval_ns
    }

    /// Stamps within an interval and the jitter, counts exact or said to be uncertain, the interval certain, no sample
    /// with a false step of time, and none that has waited for longer than a quarter of a second.
    fn assert_true(&self, seen: &Seen) {
        let is_true = seen.stamp <= 0.0 && seen.wrong == 0 || self.is_blind();
        let is_regular = seen.steps == 0 && seen.uncertain == 0 && seen.longest_wait < 0.29e9;
        assert!(is_true && is_regular, "{}: {seen:?}", self.name());
    }

    fn name(&self) -> String {
        format!("{:?}, {:?}, {:?}, seed {}", self.numbers, self.transport, self.event, self.seed)
    }
}

/// From 10 ms to 50 s, every length as often as ten times that.
fn length(random: &mut Random) -> f64 {
    libm::pow(10f64, -2.0 + 3.7 * random.part())
}

#[test]
fn without_an_event_nothing_is_missing() {
    all(
        "nothing",
        |_| Event::Nothing,
        |world, seen| {
            world.assert_true(seen);
            assert_eq!((seen.sessions, seen.gaps, seen.repeated), (1, 0, 0), "{}: {seen:?}", world.name());
        },
    );
}

#[test]
fn a_silence_is_a_gap_of_its_length() {
    all(
        "silence",
        |random| Event::Silence(length(random)),
        |world, seen| {
            world.assert_true(seen);
            assert!(seen.gaps + seen.sessions <= 2, "{}: {seen:?}", world.name());
        },
    );
}

#[test]
fn a_device_that_was_unplugged_goes_on_or_begins_a_session() {
    all(
        "unplugged",
        |random| Event::Unplugged(length(random).max(0.25)),
        |world, seen| {
            world.assert_true(seen);
            assert_eq!(seen.gaps + seen.sessions, 2, "{}: {seen:?}", world.name());
        },
    );
}

/// The line holds 85 frames meanwhile.
#[test]
fn a_reader_that_was_stalled_knows_what_is_missing() {
    all("stalled", |random| Event::Stalled(length(random), 85), World::assert_true);
}

#[test]
fn frames_that_catch_up_are_no_gap() {
    all(
        "delayed",
        |random| Event::Delayed(length(random).min(0.2)),
        |world, seen| {
            world.assert_true(seen);
            assert_eq!((seen.sessions, seen.gaps), (1, 0), "{}: {seen:?}", world.name());
        },
    );
}

#[test]
fn datagrams_in_the_wrong_order_are_put_in_order() {
    all(
        "overtaken",
        |_| Event::Overtaken(50),
        |world, seen| {
            // Without numbers nobody knows.
            if !matches!(world.numbers, Numbers::Nothing) {
                world.assert_true(seen);
                assert_eq!((seen.gaps, seen.sessions, seen.repeated), (0, 1, 0), "{}: {seen:?}", world.name());
            }
        },
    );
}

/// Without numbers two that are near each other are one gap.
#[test]
fn lost_frames_are_gaps() {
    all(
        "lossy",
        |_| Event::Lossy(50),
        |world, seen| {
            if !matches!(world.numbers, Numbers::Nothing) {
                world.assert_true(seen);
                assert_eq!(seen.sessions, 1, "{}: {seen:?}", world.name());
            }
        },
    );
}

/// A counter that happens to begin where the old one would be now cannot be distinguished from it: that is one in ten
/// or twenty of those with eight bits, and the stamps are right all the same.
#[test]
fn a_device_that_starts_again_begins_a_session_or_says_that_it_may_have() {
    let (runs, wrong) = (Cell::new(0), Cell::new(0));
    all(
        "reset",
        |random| Event::Reset(length(random).clamp(0.1, 20.0)),
        |world, seen| {
            if matches!(
                (world.numbers, world.transport),
                (Numbers::CountsFrames(8) | Numbers::CountsTime(..), Transport::Bursts(16e6))
            ) {
                // The jitter is an eighth of a turn.
                return;
            }
            runs.set(runs.get() + 1);
            wrong.set(wrong.get() + u64::from(seen.wrong > 0 && !world.is_blind()));
            world.assert_true(&Seen { wrong: 0, ..*seen });
        },
    );
    println!("{} of {} have a count of periods that is wrong", wrong.get(), runs.get());
    assert!(wrong.get() * 8 <= runs.get(), "{} of {}", wrong.get(), runs.get());
}

/// Within 20 frames or 0.1 s, and the jitter.
#[test]
fn another_rate_is_seen_soon_and_taken() {
    for ratio in [0.1, 0.2, 0.5, 1.5, 2.0, 5.0, 10.0] {
        all(
            &format!("interval times {ratio}"),
            |_| Event::Rate(ratio),
            |world, seen| {
                if matches!(world.numbers, Numbers::CountsTime(..)) && ratio < 0.5 {
                    // Its counter stands still from frame to frame.
                    return;
                }
                let interval = ratio * world.interval_ns;
                let soon = ((20.0 * interval).max(0.1e9) + 3.0 * world.jitter()) / interval;
                let soon = soon.ceil() as u64;
                assert!(seen.false_interval <= soon && seen.sessions == 1, "{}: {seen:?}", world.name());
            },
        );
    }
}
