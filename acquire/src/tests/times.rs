//! Periods and times of frames.

use crate::frames::Arrival;
use crate::timeline::{Counter, DeviceClock, Observed, Placed, Timeline};

const INTERVAL: u64 = 500_000;
const EIGHT_BITS: Counter = Counter { bits: 8, step: 1 };

fn at(ns: u64) -> Option<Arrival> {
    Some(Arrival { after_ns: ns, by_ns: ns })
}

/// A device at 2 kHz whose frames arrive up to 1 ms late, as USB bursts them.
fn late(frame: u64) -> u64 {
    let time = 7_000_000_000 + frame * INTERVAL;
    time.next_multiple_of(1_000_000)
}

fn counted(timeline: &mut Timeline, frame: u64, arrival: Option<Arrival>) -> Placed {
    timeline.place(Observed { arrival, counter: Some(frame % 256), ..Observed::default() })
}

#[test]
fn jitter_of_a_millisecond_does_not_reach_the_times() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    let (mut last, mut worst) = (0, 0.0f64);
    for frame in 0..20_000 {
        match counted(&mut timeline, frame, at(late(frame))) {
            Placed::First { timestamp_ns } => last = timestamp_ns,
            Placed::Next { periods, timestamp_ns, is_ambiguous } => {
                assert_eq!((periods, is_ambiguous), (1, false));
                let step = (timestamp_ns as f64 - last as f64 - INTERVAL as f64).abs();
                assert!(step < 0.06 * INTERVAL as f64, "frame {frame}: {step} ns");
                if frame > 4000 {
                    worst = worst.max(step);
                }
                last = timestamp_ns;
            }
            Placed::Repeated => panic!("frame {frame}"),
        }
    }
    assert!(worst < 2_000.0, "steps of the times differ by {worst} ns");
    let delay = last as f64 - (7e9 + 19_999.0 * INTERVAL as f64);
    assert!((0.0..1e6).contains(&delay), "{delay}");
    let (deviation, seconds) = timeline.deviation(at(late(19_999))).unwrap();
    assert!(deviation.abs() < 2e-4 && seconds > 8.0, "{deviation} over {seconds} s");
}

#[test]
fn gaps_have_their_length_over_several_turns_of_the_counter() {
    for missing in [0, 1, 7, 255, 256, 257, 1000, 5000] {
        let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
        for frame in 0..3000 {
            counted(&mut timeline, frame, at(late(frame)));
        }
        let next = 3000 + missing;
        let damaged = u64::from(missing > 0);
        let observed = Observed { arrival: at(late(next)), counter: Some(next % 256), damaged, ..Observed::default() };
        let placed = timeline.clone().place(observed);
        let Placed::Next { periods, is_ambiguous, .. } = placed else { panic!("{missing}: {placed:?}") };
        assert_eq!((periods, is_ambiguous), (missing + 1, false), "{missing}");
        // Without a trace of damage they count when the frames have not caught up.
        let mut sum = 0;
        for frame in next..next + 1000 {
            match counted(&mut timeline, frame, at(late(frame))) {
                Placed::Next { periods, .. } => sum += periods,
                other => assert!(matches!(other, Placed::Repeated), "{missing}: {other:?}"),
            }
        }
        assert_eq!(sum, missing + 1000, "{missing}");
    }
}

/// A device that is a tenth faster than described: its rate is measured whatever the times do.
#[test]
fn a_wrong_rate_is_measured() {
    for tenths in [9, 11] {
        let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
        let arrival = |frame: u64| at(7_000_000_000 + frame * INTERVAL * 10 / tenths);
        for frame in 0..12_000 {
            counted(&mut timeline, frame, arrival(frame));
        }
        let (deviation, seconds) = timeline.deviation(arrival(11_999)).unwrap();
        let right = 10.0 / tenths as f64 - 1.0;
        assert!((deviation - right).abs() < 0.03 && seconds > 3.0, "{deviation}, not {right}, over {seconds} s");
    }
}

/// An adapter, or the whole machine, stops for half a second: all frames come, late.
#[test]
fn frames_that_catch_up_are_no_gap() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    let mut without = Timeline::new(INTERVAL, None, None);
    for frame in 0..6000 {
        let arrival = if (3000..4000).contains(&frame) { late(4000) + (frame - 3000) * 10_000 } else { late(frame) };
        let is_next = |placed| frame == 0 || matches!(placed, Placed::Next { periods: 1, .. });
        assert!(is_next(counted(&mut timeline, frame, at(arrival))), "{frame}");
        assert!(is_next(without.place(Observed { arrival: at(arrival), ..Observed::default() })), "{frame}");
    }
}

#[test]
fn a_doubled_frame_is_repeated_and_an_outage_of_a_turn_is_a_new_session() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    for frame in 0..3000 {
        counted(&mut timeline, frame, at(late(frame)));
    }
    assert_eq!(counted(&mut timeline, 2999, at(late(3000))), Placed::Repeated);
    let away = |frames: u64| Observed {
        arrival: at(late(2999 + frames)),
        counter: Some((2999 + frames) % 256),
        after_outage: true,
        ..Observed::default()
    };
    let mut short = timeline.clone();
    assert!(matches!(short.place(away(200)), Placed::Next { periods: 200, .. }));
    assert!(matches!(timeline.place(away(300)), Placed::First { .. }));
}

/// The process was held back for five seconds: what lay in the line's buffer is no gap, what did not fit is one.
#[test]
fn a_backlog_is_no_gap() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    for frame in 0..3000 {
        counted(&mut timeline, frame, at(late(frame)));
    }
    let (stopped, back) = (late(2999), late(13_000));
    let backlog = Some(Arrival { after_ns: stopped, by_ns: back });
    for frame in 3000..4000 {
        let placed = counted(&mut timeline, frame, backlog);
        assert!(matches!(placed, Placed::Next { periods: 1, .. }), "{frame}: {placed:?}");
    }
    let cut = Observed { arrival: at(late(13_001)), counter: Some(13_001 % 256), damaged: 1, ..Observed::default() };
    let placed = timeline.place(cut);
    assert!(matches!(placed, Placed::Next { periods: 9002, .. }), "{placed:?}");
}

/// A server, or a pipe, has kept a second of frames: they come at once, the others at their time.
#[test]
fn frames_that_had_waited_do_not_shift_the_times_of_the_others() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    let begin = late(2000);
    for frame in 0..10_000 {
        let arrival = late(frame).max(begin);
        let placed = counted(&mut timeline, frame, at(arrival));
        if let Placed::Next { periods, timestamp_ns, .. } = placed {
            assert_eq!(periods, 1, "{frame}");
            let early = arrival as f64 - timestamp_ns as f64;
            let largest = if frame < 6000 { 25e6 } else { 2e6 };
            assert!(frame < 2000 || early.abs() < largest, "frame {frame} is {early} ns before its arrival");
        }
    }
    let (deviation, _) = timeline.deviation(at(late(9_999))).unwrap();
    assert!(deviation.abs() < 1e-3, "{deviation}");
}

/// Connecting to the service took a second, as it may on a busy machine: what came meanwhile is no new session.
#[test]
fn a_backlog_at_the_beginning_is_no_new_session() {
    for (counter, clock) in [(Some(EIGHT_BITS), None), (None, Some(DeviceClock { turn_ns: None }))] {
        let mut timeline = Timeline::new(INTERVAL, counter, clock);
        for frame in 0..6000 {
            let (after_ns, by_ns) = if frame < 2000 { (late(0), late(2000)) } else { (late(frame), late(frame)) };
            let arrival = Some(Arrival { after_ns, by_ns });
            let (counter, clock_ns) = (Some(frame % 256), Some(frame * INTERVAL));
            let placed = timeline.place(Observed { arrival, counter, clock_ns, ..Observed::default() });
            assert!(frame == 0 || matches!(placed, Placed::Next { periods: 1, .. }), "{frame}: {placed:?}");
        }
    }
}

#[test]
fn a_wide_counter_that_begins_anew_is_a_new_session() {
    let counter = Counter { bits: 16, step: 4 };
    let mut timeline = Timeline::new(INTERVAL, Some(counter), None);
    let observed = |count: u64, frame: u64| Observed {
        arrival: at(late(frame)),
        counter: Some(count % 65_536),
        ..Observed::default()
    };
    assert!(matches!(timeline.place(observed(65_528, 0)), Placed::First { .. }));
    assert!(matches!(timeline.place(observed(65_532, 1)), Placed::Next { periods: 1, .. }));
    assert!(matches!(timeline.place(observed(65_536, 2)), Placed::Next { periods: 1, .. }));
    assert!(matches!(timeline.place(observed(65_536 + 12, 5)), Placed::Next { periods: 3, .. }));
    assert!(matches!(timeline.place(observed(40_000, 6)), Placed::First { .. }));
    assert!(matches!(timeline.place(observed(40_002, 7)), Placed::First { .. }), "half a step");
}

#[test]
fn the_devices_own_clock_counts_periods_wraps_and_restarts() {
    let turn = (1u64 << 32) * 1000;
    let clock = DeviceClock { turn_ns: Some(turn) };
    let mut timeline = Timeline::new(INTERVAL, None, Some(clock));
    let begin = turn - 700_000;
    let observed = |time: u64, frame: u64| Observed {
        arrival: at(late(frame)),
        clock_ns: Some(time % turn),
        ..Observed::default()
    };
    assert_eq!(timeline.place(observed(begin, 0)), Placed::First { timestamp_ns: begin });
    let second = Placed::Next { periods: 1, timestamp_ns: begin + 501_000, is_ambiguous: false };
    assert_eq!(timeline.place(observed(begin + 501_000, 1)), second);
    assert_eq!(timeline.place(observed(begin + 501_000, 1)), Placed::Repeated);
    // Over the turn, and one is lost.
    let third = Placed::Next { periods: 2, timestamp_ns: begin + 1_500_000, is_ambiguous: false };
    assert_eq!(timeline.place(observed(begin + 1_500_000, 3)), third);
    assert!(matches!(timeline.place(observed(5_000, 4)), Placed::First { timestamp_ns: 5_000 }));
}

#[test]
fn without_counter_and_clock_damage_and_silence_are_gaps() {
    let mut timeline = Timeline::new(INTERVAL, None, None);
    let observed = |frame: u64, damaged: u64| Observed { arrival: at(late(frame)), damaged, ..Observed::default() };
    for frame in 0..2000 {
        let placed = timeline.place(observed(frame, 0));
        assert!(frame == 0 || matches!(placed, Placed::Next { periods: 1, .. }), "{frame}: {placed:?}");
    }
    assert!(matches!(timeline.place(observed(2002, 2)), Placed::Next { periods: 3, .. }));
    // A second of silence, which the frames after it do not catch up.
    let periods = (4002..5002).map(|frame| match timeline.place(observed(frame, 0)) {
        Placed::Next { periods, .. } => periods,
        other => panic!("{frame}: {other:?}"),
    });
    let sum: u64 = periods.sum();
    assert!((2990..=3010).contains(&sum), "{sum}");
}

#[test]
fn a_files_rows_follow_each_other_at_the_interval() {
    let mut timeline = Timeline::new(INTERVAL, Some(EIGHT_BITS), None);
    assert_eq!(counted(&mut timeline, 0, None), Placed::First { timestamp_ns: INTERVAL });
    let next = |periods, intervals| Placed::Next { periods, timestamp_ns: intervals * INTERVAL, is_ambiguous: false };
    assert_eq!(counted(&mut timeline, 1, None), next(1, 2));
    assert_eq!(counted(&mut timeline, 4, None), next(3, 5));
}

/// Counters and clocks of 64 bits that jump: no time or number overflows, and times rise within a session.
#[test]
fn a_device_that_jumps_over_centuries_begins_a_new_session() {
    let wide = Counter { bits: 64, step: 1 };
    let mut timeline = Timeline::new(INTERVAL, Some(wide), None);
    let jump = |count: u64| Observed { counter: Some(count), ..Observed::default() };
    assert!(matches!(timeline.place(jump(0)), Placed::First { .. }));
    assert!(matches!(timeline.place(jump(u64::MAX)), Placed::First { .. }));
    assert!(matches!(timeline.place(jump(0)), Placed::Next { periods: 1, .. }));
    let clock = DeviceClock { turn_ns: Some(1 << 63) };
    let mut timeline = Timeline::new(INTERVAL, None, Some(clock));
    let now = |time: u64| Observed { clock_ns: Some(time), ..Observed::default() };
    assert!(matches!(timeline.place(now((1 << 63) - 1)), Placed::First { .. }));
    assert!(matches!(timeline.place(now(1 << 61)), Placed::Next { .. }));
    assert!(matches!(timeline.place(now((1 << 62) + (1 << 61))), Placed::Next { .. }));
    assert!(matches!(timeline.place(now((1 << 63) - 1)), Placed::Next { .. }));
    assert!(matches!(timeline.place(now(1 << 61)), Placed::First { .. }));
    // A clock in milliseconds, twice the same within two periods of a counter.
    let mut timeline = Timeline::new(INTERVAL, Some(wide), Some(DeviceClock { turn_ns: None }));
    let both =
        |count: u64| Observed { counter: Some(count), clock_ns: Some(count / 2 * 1_000_000), ..Observed::default() };
    assert_eq!(timeline.place(both(4)), Placed::First { timestamp_ns: 2_000_000 });
    let second = Placed::Next { periods: 1, timestamp_ns: 2_000_001, is_ambiguous: false };
    assert_eq!(timeline.place(both(5)), second);
}

/// A device that did not count while it was away, as one that was reset to where it was, is not slow.
#[test]
fn what_a_device_did_while_it_was_away_is_not_measured() {
    let counter = Counter { bits: 16, step: 1 };
    let mut timeline = Timeline::new(INTERVAL, Some(counter), None);
    for frame in 0..6000 {
        let away = if frame < 500 { 0 } else { 1000 };
        let after_outage = frame == 500;
        let arrival = at(late(frame + away));
        timeline.place(Observed { arrival, counter: Some(frame), after_outage, ..Observed::default() });
    }
    let (deviation, seconds) = timeline.deviation(at(late(6999))).unwrap();
    assert!(deviation.abs() < 1e-3 && (1.7..1.8).contains(&seconds), "{deviation} over {seconds} s");
}
