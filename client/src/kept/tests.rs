use super::*;
use isotherm_shared::nominal::interval_fits;
use isotherm_shared::protocol::{SequenceTracker, queue_depth};
use isotherm_shared::sequence::Seen;
use isotherm_shared::wire::AXES;
use proptest::prelude::*;

const NOMINAL_NS: u64 = 2_500_000;
type State = AcquisitionState<RawSample, u64>;

fn state(depth: usize) -> State {
    State::new(7, depth, queue_depth(depth), 1)
}

/// Control period `number` of an IMU that reads 1 g with `pulses` on its third axis.
fn period(number: u64, pulses: u32) -> RawSample {
    let triad = |positive_pulses| Triad {
        positive_pulses,
        head_temperature: [21.0; AXES],
        board_temperature: [22.0; AXES],
        ..Triad::default()
    };
    let (accelerometers, gyroscopes) = (triad([0, 0, pulses]), triad([1, 2, 3]));
    let timestamp_ns = (number + 1) * NOMINAL_NS;
    RawSample { session: 7, timestamp_ns, interval_ns: NOMINAL_NS, accelerometers, gyroscopes, ..RawSample::default() }
}

/// Keeps a period that is loaned just now, as every acquisition does that keeps.
fn keep(kept: &mut Kept, state: &mut State, raw: RawSample, ceiling: Ceiling) {
    let sequence = state.loan();
    kept.take(state, RawSample { sequence, ..raw }, true, ceiling).unwrap();
}

/// Sends everything and answers it; returns what was sent.
fn send_all(kept: &mut Kept, state: &mut State) -> Vec<Sum> {
    std::iter::from_fn(|| {
        let sum = kept.next(state)?;
        state.send(sum.raw.sequence, &sum.raw, 0);
        assert!(state.answered(7, sum.raw.sequence, &0));
        Some(sum)
    })
    .collect()
}

#[test]
fn an_outage_of_30_s_loses_nothing_where_one_period_fits() {
    // 1 g at 1e-6 m/s2 a pulse, of which 437 fit; and the finest resolution, of which none fits into a sum of two.
    for (pulses, of_each) in [(9_806_650, 437), (u32::MAX / 2 + 1, 1)] {
        let (mut kept, mut state) = (Kept::new(MOST_KEPT), state(64));
        (0..12_000).for_each(|number| keep(&mut kept, &mut state, period(number, pulses), Ceiling::COUNTS));
        assert_eq!((kept.periods(), kept.sums() as u64), (12_000, 12_000_u64.div_ceil(of_each)));
        assert_eq!((kept.dropped(), state.lost() + kept.unnumbered()), (0, 12_000), "they count until they are sent");
        let sent = send_all(&mut kept, &mut state);
        let (mut all, mut expected) = ([0; 2], 0);
        for (sum, sequence) in sent.iter().zip(0..) {
            all[0] += u64::from(sum.raw.accelerometers.positive_pulses[2]);
            all[1] += u64::from(sum.raw.gyroscopes.positive_pulses[2]);
            expected += sum.periods * NOMINAL_NS;
            assert_eq!((sum.raw.sequence, sum.raw.timestamp_ns), (sequence, expected), "in order, without a gap");
        }
        assert_eq!(all, [12_000 * u64::from(pulses), 36_000]);
        assert_eq!((state.lost(), kept.periods(), kept.is_empty()), (0, 0, true));
    }
}

#[test]
fn sums_of_readings_keep_their_scale_factors() {
    for percent in [-9, 0, 9] {
        let (mut kept, mut state) = (Kept::new(MOST_KEPT), state(64));
        let interval_ns = NOMINAL_NS.checked_add_signed(percent * NOMINAL_NS.cast_signed() / 1000).unwrap();
        let mut timestamp_ns = 0;
        for number in 0..1000 {
            timestamp_ns += interval_ns;
            let raw = RawSample { interval_ns, timestamp_ns, ..period(number, 1000) };
            keep(&mut kept, &mut state, raw, Ceiling::readings(NOMINAL_NS));
        }
        let sent = send_all(&mut kept, &mut state);
        assert!(sent.iter().all(|sum| interval_fits(NOMINAL_NS, sum.raw.interval_ns)), "{percent}");
        assert!(sent.iter().any(|sum| sum.periods == 64) && sent.len() <= 17, "{percent}: {}", sent.len());
        assert_eq!(sent.iter().map(|sum| sum.raw.interval_ns).sum::<u64>(), 1000 * interval_ns);
    }
    let (mut kept, mut state) = (Kept::new(MOST_KEPT), state(64));
    (0..130).for_each(|number| keep(&mut kept, &mut state, period(number, 1), Ceiling::UNKNOWN));
    assert_eq!(send_all(&mut kept, &mut state).iter().map(|sum| sum.periods).collect::<Vec<_>>(), [64, 64, 2]);
}

#[test]
fn a_sum_hides_nothing() {
    let raw = period(2, 1);
    let mut invalid = raw;
    invalid.gyroscopes.head_temperature[1] = f64::NAN;
    for (what, changed) in [
        ("another unit", RawSample { device: 9, ..raw }),
        ("no interval", RawSample { interval_ns: 0, ..raw }),
        ("a time step", RawSample { timestamp_ns: raw.timestamp_ns + 2 * NOMINAL_NS, ..raw }),
        ("no gyroscopes", RawSample { gyroscopes: Triad::ABSENT, ..raw }),
        ("zeroed gyroscopes", RawSample { gyroscopes: Triad::default(), ..raw }),
        ("one invalid temperature", invalid),
    ] {
        let (mut kept, mut state) = (Kept::new(8), state(8));
        for raw in [period(0, 1), period(1, 1), changed] {
            keep(&mut kept, &mut state, raw, Ceiling::COUNTS);
        }
        let sent = send_all(&mut kept, &mut state);
        assert_eq!(sent.iter().map(|sum| sum.periods).collect::<Vec<_>>(), [2, 1], "{what}");
        assert_eq!(sent[1].raw, RawSample { sequence: 1, ..changed }, "{what}");
    }
}

#[test]
fn what_is_dropped_leaves_as_many_numbers_out_as_it_held() {
    let (mut kept, mut state) = (Kept::new(2), state(2));
    let of_three = Ceiling { periods: 3, ..Ceiling::COUNTS };
    let first = state.loan();
    state.send(first, &period(0, 1), 0);
    state.answered(7, first, &0);
    // Sums of 3, 3, 3 and 1: two are dropped.
    (1..11).for_each(|number| keep(&mut kept, &mut state, period(number, 1), of_three));
    assert_eq!((kept.dropped(), kept.periods(), state.lost() + kept.unnumbered()), (6, 4, 10));
    let loan = state.loan();
    state.cancel(loan);
    let sent = send_all(&mut kept, &mut state);
    assert_eq!(sent.iter().map(|sum| (sum.raw.sequence, sum.periods)).collect::<Vec<_>>(), [(7, 3), (8, 1)]);
    assert_eq!((state.lost(), state.loan(), loan), (6, 9, 9));
}

#[test]
fn what_cannot_give_its_number_back_begins_another_sum() {
    let (mut kept, mut state) = (Kept::new(8), state(8));
    let mut take = |state: &mut State, sequence, is_own| {
        kept.take(state, RawSample { sequence, ..period(sequence, 1) }, is_own, Ceiling::COUNTS)
    };
    let (one, two, three) = (state.loan(), state.loan(), state.loan());
    assert_eq!((take(&mut state, one, true), take(&mut state, two, true)), (Ok(()), Ok(())), "3 is on loan still");
    assert_eq!(take(&mut state, one, true), Err(SequenceRefusal));
    assert_eq!(take(&mut state, three, true), Ok(()));
    // Raised over lost periods, and a record of a recording.
    assert_eq!((state.loan(), take(&mut state, 5, false), take(&mut state, 6, false)), (2, Ok(()), Ok(())));
    assert_eq!(state.loan(), 7, "one above what is kept");
    let sent = send_all(&mut kept, &mut state);
    assert_eq!(
        sent.iter().map(|sum| (sum.raw.sequence, sum.periods)).collect::<Vec<_>>(),
        [(0, 1), (1, 2), (5, 1), (6, 1)]
    );
    assert_eq!(state.lost(), 3 + 1, "2, 3 and 4 were left out, and 7 is on loan");
}

#[test]
fn a_session_may_begin_anywhere_with_what_is_kept() {
    let (mut kept, mut state) = (Kept::new(4), state(4));
    kept.take(&mut state, RawSample { sequence: 1000, ..period(0, 1) }, false, Ceiling::COUNTS).unwrap();
    assert_eq!((state.lost(), state.loan()), (1, 1001));
    state.cancel(1001);
    assert_eq!((send_all(&mut kept, &mut state).len(), state.lost()), (1, 0));
    let end = u64::MAX;
    kept.take(&mut state, RawSample { sequence: end, ..period(0, 1) }, false, Ceiling::COUNTS).unwrap();
    assert_eq!(
        kept.take(&mut state, RawSample { sequence: end, ..period(1, 1) }, true, Ceiling::COUNTS),
        Err(SequenceRefusal)
    );
    assert_eq!(send_all(&mut kept, &mut state).len(), 1);
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Keep,
    Discard,
    Answer,
    SendKept { fails: bool },
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        6 => Just(Step::Keep),
        1 => Just(Step::Discard),
        3 => Just(Step::Answer),
        3 => Just(Step::SendKept { fails: false }),
        1 => Just(Step::SendKept { fails: true }),
    ];
    prop::collection::vec(step, 0..200)
}

/// A sample as the service sees it.
fn seen(raw: &RawSample) -> Seen {
    Seen { period: Period::from(raw), at_ns: 0 }
}

proptest! {
    /// Every control period is received once, in order, or is a missing sequence at its place, and counted.
    #[test]
    fn no_period_vanishes_whatever_happens(steps in steps(), most in 1_usize..4, periods in 1_u64..5) {
        let (mut kept, mut state, mut service) = (Kept::new(most), state(2), SequenceTracker::default());
        let ceiling = Ceiling { periods, ..Ceiling::COUNTS };
        let (mut number, mut passed, mut lost) = (1, 1, 0);
        let mut flight = vec![];
        let first = RawSample { sequence: state.loan(), ..period(0, 1) };
        service.note(seen(&first));
        state.send(first.sequence, &first, 0);
        state.answered(7, first.sequence, &0);
        // The end sends all that waits, and a last one.
        let end = [Step::Answer, Step::Answer, Step::SendKept { fails: false }].repeat(8);
        for step in steps.into_iter().chain(end.clone()).chain([Step::Keep]).chain(end) {
            match step {
                Step::Keep => {
                    keep(&mut kept, &mut state, period(number, 1), ceiling);
                    number += 1;
                }
                Step::Discard => {
                    state.loan();
                    number += 1;
                }
                Step::Answer => {
                    if !flight.is_empty() {
                        state.answered(7, flight.remove(0), &0);
                    }
                }
                Step::SendKept { fails } => {
                    let Some(sum) = kept.next(&mut state) else { continue };
                    state.send(sum.raw.sequence, &sum.raw, 0);
                    if fails {
                        state.send_failed();
                        kept.failed(&mut state, &sum);
                        continue;
                    }
                    flight.push(sum.raw.sequence);
                    let arrival = service.note(seen(&sum.raw));
                    lost += arrival.missing;
                    passed += arrival.missing + sum.periods;
                    prop_assert_eq!(sum.raw.timestamp_ns, passed * NOMINAL_NS, "the gap is where the time is missing");
                    prop_assert_eq!(sum.raw.interval_ns, sum.periods * NOMINAL_NS);
                }
            }
            prop_assert_eq!(state.lost() + kept.unnumbered() + (passed - lost), number, "all are accounted for");
        }
        prop_assert_eq!((passed, state.lost(), kept.is_empty()), (number, lost, true));
    }
}
