//! The exhaustive search: every state of a small [world](super::world) that any order of steps and faults leads to.
#![allow(
    clippy::panic,
    clippy::print_stdout,
    reason = "in a test the panic is the report, and the coverage is printed"
)]

use super::world::{Bounds, Mutation, Step, World};
use std::collections::HashSet;
use std::collections::hash_map::DefaultHasher;
use std::hash::Hasher as _;

/// More steps than any undisturbed run needs until every sample is answered.
const PATIENCE: usize = 300;

/// What a search without a finding has covered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Covered {
    pub states: usize,
    /// Steps from the beginning to the state farthest from it.
    pub depth: usize,
}

/// A property that does not hold, and the shortest way there.
#[derive(Debug)]
pub(super) struct Finding {
    pub what: String,
    pub steps: Vec<Step>,
}

/// A state's fingerprint. With a million states two of them coincide with a probability of 3e-8.
fn fingerprint(world: &World) -> u64 {
    let mut hasher = DefaultHasher::new();
    world.hash_into(&mut hasher);
    hasher.finish()
}

/// Explores breadth first until no new state is left. From each state it also lets the processes go on undisturbed.
pub(super) fn explore(bounds: Bounds, mutation: Option<Mutation>) -> Result<Covered, Finding> {
    let beginning = World::new(bounds, mutation);
    let mut known = HashSet::from([fingerprint(&beginning)]);
    // States from which an undisturbed run answers every sample.
    let mut settling = HashSet::new();
    // For each state the number of the state before it, and the step between them.
    let mut ways: Vec<(usize, Option<Step>)> = vec![(0, None)];
    let (mut level, mut depth) = (vec![(0, beginning)], 0);
    loop {
        let mut next_level = Vec::new();
        for (number, world) in level {
            for (step, outcome) in world.next() {
                let found = |what| Finding { what, steps: way_to(&ways, number, Some(step)) };
                let next = outcome.map_err(found)?;
                if known.insert(fingerprint(&next)) {
                    ways.push((number, Some(step)));
                    next_level.push((ways.len() - 1, next));
                }
            }
            if let Err(what) = settles(&world, &mut settling) {
                return Err(Finding { what, steps: way_to(&ways, number, None) });
            }
        }
        if next_level.is_empty() {
            return Ok(Covered { states: known.len(), depth });
        }
        depth += 1;
        level = next_level;
    }
}

fn way_to(ways: &[(usize, Option<Step>)], mut number: usize, last: Option<Step>) -> Vec<Step> {
    let mut steps: Vec<_> = last.into_iter().collect();
    while let (before, Some(step)) = ways[number] {
        steps.push(step);
        number = before;
    }
    steps.reverse();
    steps
}

/// Whether every sample gets answered, and another one can be sent, once nothing disturbs any more.
fn settles(world: &World, settling: &mut HashSet<u64>) -> Result<(), String> {
    let (mut world, mut passed) = (world.left_alone(), Vec::new());
    while passed.len() < PATIENCE {
        let state = fingerprint(&world);
        if world.is_settled() || settling.contains(&state) {
            settling.extend(passed);
            return Ok(());
        }
        passed.push(state);
        let Some(outcome) = world.goes_on() else { break };
        world = outcome?;
    }
    Err("samples stay unanswered though nothing disturbs any more".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two samples in flight, one resend to the same service, no faults.
    const CALM: Bounds = Bounds {
        samples: 4,
        depth: 2,
        queue: 4,
        answers: 4,
        resends: 1,
        service_kills: 0,
        acquisition_kills: 0,
        new_sessions: 0,
        lost_samples: 0,
        lost_answers: 0,
        failed_sends: 0,
        skips: 0,
        loans: 0,
        reader: false,
        removals: 0,
        rejoins: 0,
    };

    fn holds(name: &str, bounds: Bounds) {
        let begun = std::time::Instant::now();
        match explore(bounds, None) {
            Ok(Covered { states, depth }) => {
                println!("{name}: {states} states, the farthest after {depth} steps, in {:.1?}", begun.elapsed());
                // A world in which little can happen proves little.
                assert!(states > 5000 && depth > 20, "{name}: only {states} states");
            }
            Err(finding) => panic!("{name}: {finding:?}"),
        }
    }

    #[test]
    fn restarts_of_the_service() {
        holds("twice", Bounds { samples: 3, service_kills: 2, ..CALM });
        holds("three in flight", Bounds { depth: 3, queue: 6, service_kills: 1, ..CALM });
        holds("one in flight", Bounds { samples: 3, depth: 1, queue: 2, service_kills: 2, resends: 2, ..CALM });
    }

    #[test]
    fn losses_in_the_queues() {
        holds(
            "of a sample and an answer",
            Bounds { samples: 3, service_kills: 1, lost_samples: 1, lost_answers: 1, ..CALM },
        );
        holds("of two samples", Bounds { samples: 3, depth: 3, queue: 6, service_kills: 1, lost_samples: 2, ..CALM });
        holds("of overwritten answers", Bounds { service_kills: 1, answers: 2, lost_samples: 1, ..CALM });
    }

    #[test]
    fn losses_at_the_sender() {
        holds(
            "sends that fail, and sequences left out",
            Bounds { samples: 3, service_kills: 1, failed_sends: 1, skips: 1, ..CALM },
        );
    }

    #[test]
    fn samples_on_loan() {
        holds("discarded, cancelled, out of order", Bounds { samples: 3, service_kills: 1, loans: 2, ..CALM });
        let bounds = Bounds { samples: 3, depth: 1, queue: 2, service_kills: 1, new_sessions: 1, loans: 2, ..CALM };
        holds("behind a full queue, in two sessions", bounds);
    }

    #[test]
    fn sessions() {
        holds(
            "two acquisitions, three sessions",
            Bounds { samples: 3, service_kills: 1, acquisition_kills: 1, new_sessions: 1, ..CALM },
        );
    }

    #[test]
    fn readers() {
        holds("late readers", Bounds { samples: 3, service_kills: 1, reader: true, ..CALM });
        let bounds = Bounds { samples: 2, service_kills: 1, acquisition_kills: 1, reader: true, ..CALM };
        holds("late readers of two sessions", bounds);
    }

    #[test]
    fn joining_anew() {
        holds("after a removal", Bounds { samples: 3, service_kills: 1, removals: 1, ..CALM });
        holds("after two removals", Bounds { samples: 3, removals: 2, reader: true, resends: 0, ..CALM });
        holds("three in flight", Bounds { depth: 3, queue: 6, removals: 1, lost_samples: 1, ..CALM });
        holds("for want of answers", Bounds { samples: 3, service_kills: 1, rejoins: 1, lost_samples: 1, ..CALM });
    }

    #[test]
    #[ignore = "minutes: cargo test --release -p isotherm-shared --lib protocol::search -- --ignored --nocapture"]
    fn larger_worlds() {
        holds("restarts", Bounds { samples: 5, service_kills: 3, resends: 2, ..CALM });
        holds("three in flight", Bounds { depth: 3, queue: 6, service_kills: 2, lost_samples: 1, ..CALM });
        holds("loans", Bounds { service_kills: 2, failed_sends: 1, new_sessions: 1, loans: 2, ..CALM });
        holds(
            "losses",
            Bounds {
                samples: 3,
                service_kills: 2,
                lost_samples: 1,
                lost_answers: 1,
                failed_sends: 1,
                skips: 1,
                ..CALM
            },
        );
        holds(
            "sessions",
            Bounds { samples: 3, service_kills: 2, acquisition_kills: 2, new_sessions: 1, lost_samples: 1, ..CALM },
        );
        holds(
            "readers",
            Bounds { samples: 3, service_kills: 2, acquisition_kills: 1, resends: 2, reader: true, ..CALM },
        );
        holds(
            "removals",
            Bounds { service_kills: 1, acquisition_kills: 1, removals: 2, rejoins: 1, reader: true, ..CALM },
        );
    }

    #[track_caller]
    fn is_found(mutation: Mutation, bounds: Bounds, expected: &str) -> Vec<Step> {
        match explore(bounds, Some(mutation)) {
            Ok(covered) => panic!("{mutation:?} is not found: {covered:?}"),
            Err(Finding { what, steps }) => {
                assert!(what.contains(expected), "{mutation:?}: {what} after {steps:?}");
                steps
            }
        }
    }

    const RESTART: Bounds = Bounds { depth: 3, queue: 6, service_kills: 1, lost_samples: 1, ..CALM };

    /// The search finds what goes wrong with a changed rule of the protocol.
    #[test]
    fn each_rule_is_needed() {
        let false_gap = "a false gap";
        // An answer has overtaken an earlier one when the service is killed. The next service does not get the answered
        // sample, and takes it for missing. Two restarts are enough for that, or one and a lost sample.
        let bounds = Bounds { service_kills: 2, resends: 0, ..CALM };
        let steps = is_found(Mutation::ResendsUnansweredOnly, bounds, false_gap);
        assert_eq!(steps.iter().filter(|step| **step == Step::KillService).count(), 2, "{steps:?}");
        is_found(Mutation::ResendsUnansweredOnly, RESTART, false_gap);
        // A resend that was meant for the old service reaches the new one, and a new sample follows it.
        for mutation in [Mutation::SilenceRepeatsOldest, Mutation::ResendsOvertakenOnly] {
            let steps = is_found(mutation, RESTART, false_gap);
            assert!(steps.ends_with(&[Step::KillService, Step::Subscribe]), "{mutation:?}: {steps:?}");
        }
        // Repeats fill the queue, a new sample finds no room.
        is_found(Mutation::IgnoresSurplus, Bounds { queue: 3, resends: 2, ..CALM }, false_gap);
        is_found(
            Mutation::IgnoresSurplus,
            Bounds { samples: 5, queue: 2, service_kills: 1, resends: 0, ..CALM },
            false_gap,
        );
        is_found(Mutation::OneSession, Bounds { acquisition_kills: 1, ..CALM }, "without its flag");
        for mutation in [Mutation::NeverResends, Mutation::ResendsNewestOnly] {
            is_found(mutation, RESTART, "stay unanswered");
        }
        // The discarded period gets no gap: the next one has its number.
        let loans = Bounds { loans: 2, ..CALM };
        is_found(Mutation::DiscardingCancels, loans, "lost in silence");
        is_found(Mutation::CancelsAnyNumber, loans, "same number");
        is_found(Mutation::HandsOutAtOnce, RESTART, "out of order");
        is_found(Mutation::ReaderForgets, Bounds { reader: true, ..RESTART }, "twice");
        let bounds = Bounds { samples: 2, service_kills: 1, acquisition_kills: 1, ..CALM };
        let steps = is_found(Mutation::ForgetsSessions, bounds, "without its flag");
        assert!(steps.contains(&Step::Note) && steps.contains(&Step::KillAcquisition), "{steps:?}");
        is_found(Mutation::EverySessionIsNew, Bounds { service_kills: 1, ..CALM }, "a flag too much");
    }
}
