//! Periods and times of frames.

use crate::frames::FrameArrival;
use crate::timeline::{Counter, DeviceClock, FrameObservation, FramePlace, FramePlacement, Timeline};

const INTERVAL: u64 = 500_000;
const EIGHT_BITS: Counter = Counter { bits: 8, step: 1 };

fn at(ns: u64) -> Option<FrameArrival> {
    Some(FrameArrival { after_ns: ns, by_ns: ns })
}

/// A device at 2 kHz whose frames arrive up to 1 ms late, as USB bursts them.
fn late(frame: u64) -> u64 {
    let time = 7_000_000_000 + frame * INTERVAL;
    time.next_multiple_of(1_000_000)
}

/// A frame of a device with a counter of 8 bits.
fn counted(frame: u64, arrival: Option<FrameArrival>) -> FrameObservation {
    FrameObservation { arrival, counter: Some(frame % 256), ..FrameObservation::default() }
}

/// Places all frames.
fn place(timeline: &mut Timeline<()>, frames: impl IntoIterator<Item = FrameObservation>) -> Vec<FramePlacement> {
    frames.into_iter().for_each(|observed| timeline.push(observed, ()));
    timeline.settle_all();
    std::iter::from_fn(|| timeline.next()).map(|(placed, ())| placed).collect()
}

fn periods(placed: &[FramePlacement]) -> Vec<u64> {
    let periods = placed.iter().filter_map(|placed| match placed.place {
        FramePlace::Next { periods, .. } => Some(periods),
        FramePlace::First | FramePlace::Repeated => None,
    });
    periods.collect()
}

fn sessions(placed: &[FramePlacement]) -> usize {
    placed.iter().filter(|placed| placed.place == FramePlace::First).count()
}

#[test]
fn jitter_of_a_millisecond_does_not_reach_the_times() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    let placed = place(&mut timeline, (0..20_000).map(|frame| counted(frame, at(late(frame)))));
    assert_eq!((sessions(&placed), periods(&placed)), (1, vec![1; 19_999]));
    for (frame, pair) in placed.windows(2).enumerate() {
        let step = (pair[1].timestamp_ns - pair[0].timestamp_ns).abs_diff(INTERVAL);
        assert!(step < if frame > 4000 { 2_000 } else { 30_000 }, "frame {frame}: {step} ns");
    }
    let delay = placed[19_999].timestamp_ns as f64 - (7e9 + 19_999.0 * INTERVAL as f64);
    assert!((0.0..1e6).contains(&delay), "{delay}");
    let (deviation, seconds) = timeline.deviation(at(late(19_999))).unwrap();
    assert!(deviation.abs() < 2e-4 && seconds > 8.0, "{deviation} over {seconds} s");
}

/// A device that is a tenth faster than described: its rate is measured whatever the times do.
#[test]
fn a_wrong_rate_is_measured() {
    for tenths in [9, 11] {
        let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
        let arrival = |frame: u64| at(7_000_000_000 + frame * INTERVAL * 10 / tenths);
        place(&mut timeline, (0..12_000).map(|frame| counted(frame, arrival(frame))));
        let (deviation, seconds) = timeline.deviation(arrival(11_999)).unwrap();
        let right = 10.0 / tenths as f64 - 1.0;
        assert!((deviation - right).abs() < 0.03 && seconds > 3.0, "{deviation}, not {right}, over {seconds} s");
    }
}

#[test]
fn a_doubled_frame_is_repeated_and_an_outage_of_a_turn_is_a_new_session() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    place(&mut timeline, (0..3000).map(|frame| counted(frame, at(late(frame)))));
    let repeated = place(&mut timeline, [counted(2999, at(late(3000)))]);
    assert_eq!(repeated[0].place, FramePlace::Repeated);
    let away = |missing: u64| {
        let frames = (3000 + missing)..(4000 + missing);
        frames.map(move |frame| {
            let after_outage = frame == 3000 + missing;
            FrameObservation { after_outage, ..counted(frame, at(late(frame))) }
        })
    };
    let placed = place(&mut timeline.clone(), away(199));
    assert_eq!((sessions(&placed), periods(&placed)[0]), (0, 200));
    let placed = place(&mut timeline, away(299));
    assert_eq!((sessions(&placed), periods(&placed)), (1, vec![1; 999]));
}

/// A server, a pipe, or a process that was held up while it connected, has kept a second of frames: they come at once,
/// the others at their time.
#[test]
fn frames_that_had_waited_at_the_beginning_have_their_times() {
    let clock = DeviceClock { turn_ns: None };
    for (counter, clock) in [(Some(EIGHT_BITS), None), (None, None), (None, Some(clock))] {
        let mut timeline = Timeline::new(INTERVAL, counter, clock);
        let begin = late(2000);
        let frames = (0..6000).map(|frame| {
            let (after_ns, by_ns) = if frame < 2000 { (late(0), begin) } else { (late(frame), late(frame)) };
            let arrival = Some(FrameArrival { after_ns, by_ns });
            FrameObservation { clock_ns: Some(frame * INTERVAL), ..counted(frame, arrival) }
        });
        let placed = place(&mut timeline, frames);
        assert_eq!((sessions(&placed), periods(&placed)), (1, vec![1; 5999]));
        for (frame, pair) in placed.windows(2).enumerate() {
            let step = pair[1].timestamp_ns - pair[0].timestamp_ns;
            assert!(step.abs_diff(INTERVAL) < INTERVAL / 10, "frame {frame}: {step} ns");
            let early = late(frame as u64) as f64 - pair[0].timestamp_ns as f64;
            assert!(clock.is_some() || early.abs() < 2e6, "frame {frame} is {early} ns before its arrival");
        }
    }
}

#[test]
fn a_wide_counter_that_begins_anew_is_a_new_session() {
    let counter = Counter { bits: 16, step: 4 };
    let mut timeline = Timeline::new(INTERVAL, Some(counter), None);
    let observed =
        |count: u64, frame: u64| FrameObservation { counter: Some(count % 65_536), ..counted(frame, at(late(frame))) };
    let before = (0..1000).map(|frame| observed(65_536 - 400 + 4 * frame, frame));
    let lost = (1003..1100).map(|frame| observed(65_536 - 400 + 4 * frame, frame));
    let anew = (1100..2000).map(|frame| observed(40_000 + 4 * frame, frame));
    let placed = place(&mut timeline, before.chain(lost).chain(anew));
    let kinds: Vec<_> = placed.iter().map(|placed| placed.place).collect();
    let next = |periods| FramePlace::Next { periods, is_ambiguous: false };
    assert_eq!(
        [kinds[0], kinds[999], kinds[1000], kinds[1097]],
        [FramePlace::First, next(1), next(4), FramePlace::First]
    );
    assert_eq!(sessions(&placed), 2);
    // Half a step.
    let odd = (2000..3000).map(|frame| observed(50_002 + 4 * frame, frame));
    assert_eq!(sessions(&place(&mut timeline, odd)), 1);
}

#[test]
fn the_devices_own_clock_counts_periods_wraps_and_restarts() {
    let turn = (1u64 << 32) * 1000;
    let clock = DeviceClock { turn_ns: Some(turn) };
    let mut timeline = Timeline::new(INTERVAL, None, Some(clock));
    let begin = turn - 500 * INTERVAL;
    let timed =
        |time: u64, frame: u64| FrameObservation { clock_ns: Some(time % turn), ..counted(frame, at(late(frame))) };
    // Over the turn, with jitter, and one is lost.
    let before = (0..1000).map(|frame| timed(begin + frame * INTERVAL + frame % 3 * 1000, frame));
    let after = (1001..1300).map(|frame| timed(begin + frame * INTERVAL, frame));
    let placed = place(&mut timeline, before.chain(after));
    assert_eq!(placed[0].timestamp_ns, begin);
    assert_eq!(placed[999].timestamp_ns, begin + 999 * INTERVAL);
    assert_eq!((periods(&placed)[998], periods(&placed)[999]), (1, 2));
    assert_eq!(placed[1000].timestamp_ns, begin + 1001 * INTERVAL);
    let anew = place(&mut timeline, (1300..1900).map(|frame| timed(5_000 + (frame - 1300) * INTERVAL, frame)));
    assert_eq!((anew[0].place, anew[0].timestamp_ns, sessions(&anew)), (FramePlace::First, 5_000, 1));
}

/// Two frames with the same time of a clock in milliseconds are two samples, where they do not say the same.
#[test]
fn a_clock_that_is_coarser_than_the_interval_loses_no_frame() {
    for interval in [500_000, 400_000] {
        let mut timeline = Timeline::new(interval, None, Some(DeviceClock { turn_ns: None }));
        let frames = (0..4000).map(|frame| {
            let time = 7_000_000_000 + frame * interval;
            let clock_ns = Some(time / 1_000_000 * 1_000_000);
            FrameObservation { arrival: at(time + 30_000), clock_ns, ..FrameObservation::default() }
        });
        let placed = place(&mut timeline, frames);
        assert_eq!((sessions(&placed), periods(&placed)), (1, vec![1; 3999]));
        for (frame, placed) in placed.iter().enumerate() {
            let error = placed.timestamp_ns.abs_diff(7_000_000_000 + frame as u64 * interval);
            assert!(error <= 1_000_000 + interval, "frame {frame}: {error} ns");
        }
    }
    let same = |is_same| FrameObservation {
        arrival: at(8_000_000_000),
        clock_ns: Some(5),
        is_same,
        ..FrameObservation::default()
    };
    let mut timeline = Timeline::new(INTERVAL, None, Some(DeviceClock { turn_ns: None }));
    assert_eq!(place(&mut timeline, [same(false), same(true)])[1].place, FramePlace::Repeated);
}

#[test]
fn a_files_rows_follow_each_other_at_the_interval() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    let placed = place(&mut timeline, [0, 1, 4].map(|frame| counted(frame, None)));
    let stamps: Vec<_> = placed.iter().map(|placed| placed.timestamp_ns).collect();
    assert_eq!(stamps, [INTERVAL, 2 * INTERVAL, 5 * INTERVAL]);
    assert_eq!(periods(&placed), [1, 3]);
}

/// Counters and clocks of 64 bits that jump: no time or number overflows, and times rise within a session.
#[test]
fn a_device_that_jumps_over_centuries_begins_a_new_session() {
    let wide = Counter { bits: 64, step: 1 };
    let mut timeline = Timeline::new(INTERVAL, Some(wide), None);
    let jump = |count: u64| FrameObservation { counter: Some(count), ..FrameObservation::default() };
    let placed = place(&mut timeline, [0, u64::MAX, 0].map(jump));
    assert_eq!((sessions(&placed), periods(&placed)), (2, vec![1]));
    let clock = DeviceClock { turn_ns: Some(1 << 63) };
    let mut timeline = Timeline::new(INTERVAL, None, Some(clock));
    let now = |time: u64| FrameObservation { clock_ns: Some(time), ..FrameObservation::default() };
    let times = [(1 << 63) - 1, 1 << 61, (1 << 62) + (1 << 61), (1 << 63) - 1, 1 << 61];
    let placed = place(&mut timeline, times.map(now));
    let firsts: Vec<_> = placed.iter().map(|placed| placed.place == FramePlace::First).collect();
    assert_eq!(firsts, [true, false, false, false, true]);
    // A clock in milliseconds, twice the same within two periods of a counter.
    let mut timeline = Timeline::new(INTERVAL, Some(wide), Some(DeviceClock { turn_ns: None }));
    let both = |count: u64| FrameObservation {
        counter: Some(count),
        clock_ns: Some(count / 2 * 1_000_000),
        ..FrameObservation::default()
    };
    let placed = place(&mut timeline, [4, 5].map(both));
    assert_eq!(placed.iter().map(|placed| placed.timestamp_ns).collect::<Vec<_>>(), [2_000_000, 2_500_000]);
}

/// A device that did not count while it was away, as one that was reset to where it was, is not slow.
#[test]
fn what_a_device_did_while_it_was_away_is_not_measured() {
    let counter = Counter { bits: 16, step: 1 };
    let mut timeline = Timeline::new(INTERVAL, Some(counter), None);
    let frames = (0..6000).map(|frame| {
        let away = if frame < 500 { 0 } else { 1000 };
        FrameObservation { counter: Some(frame), after_outage: frame == 500, ..counted(frame, at(late(frame + away))) }
    });
    place(&mut timeline, frames);
    let (deviation, seconds) = timeline.deviation(at(late(6999))).unwrap();
    assert!(deviation.abs() < 1e-3 && (1.5..1.8).contains(&seconds), "{deviation} over {seconds} s");
}
