//! The waiting line of an acquisition, with a service that stands still: what fits arrives, what does not is a gap of
//! as many periods, and every period has the lag of its time.

use isotherm_client::{
    Acquisition, ClosingNote, Flags, Lag, LagOption, RawReader, RawSample, SendError, TimeConstant, Triad,
};
use isotherm_client::{CompensatedIncrement, MOST_KEPT, Sensor};
use isotherm_tests::{TestDomain, id, wait_until};
use std::collections::BTreeMap;

const PERIOD_NS: u64 = 2_500_000;

/// Fills control period `number` in.
fn fill(sample: &mut RawSample, number: u64, head: f64) {
    (sample.timestamp_ns, sample.interval_ns) = ((number + 1) * PERIOD_NS, PERIOD_NS);
    sample.telemetry_ns = sample.timestamp_ns;
    sample.accelerometers = Triad {
        head_temperature: [head; 3],
        board_temperature: [2.5; 3],
        positive_pulses: [1, 2, 3],
        ..Triad::default()
    };
}

/// Sends periods from 0 on until the service has no room for one, which is kept. Returns the number of the next.
fn fill_up(acquisition: &mut Acquisition) -> u64 {
    for number in 0.. {
        let mut sample = acquisition.loan().unwrap();
        fill(&mut sample, number, 2.5);
        match acquisition.send(sample) {
            Ok(()) => {}
            Err(SendError::Full(sample)) => {
                acquisition.keep(sample).unwrap();
                return number + 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
    0
}

#[test]
fn what_does_not_fit_into_memory_is_a_gap_of_as_many_periods() {
    const DROPPED: u64 = 10;
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let (mut acquisition, mut reader) = (domain.acquisition("imu-a"), domain.reader("imu-a"));
    service.stop();
    let begun = fill_up(&mut acquisition);
    let end = begun + 3 * (MOST_KEPT as u64 + DROPPED) - 1;
    for number in begun..end {
        let mut sample = acquisition.loan().unwrap();
        fill(&mut sample, number, 2.5);
        // Another device after each three, so that a sum ends.
        sample.device = 1 + (number - begun + 1) / 3 % 2;
        acquisition.keep(sample).unwrap();
    }
    assert_eq!(acquisition.kept(), 3 * MOST_KEPT as u64, "the oldest are dropped");
    assert_eq!(acquisition.lost(), end - acquisition.in_flight() as u64, "what waits counts until it is sent");
    assert!(matches!(acquisition.begin_session(), Err(error) if error.0 > MOST_KEPT));

    service.resume();
    let (mut passed, mut gaps) = (0, vec![]);
    let mut last: Option<CompensatedIncrement> = None;
    wait_until("all that was kept", || {
        acquisition.send_kept().unwrap();
        while acquisition.receive().unwrap().is_some() {}
        while let Some(increment) = reader.receive().unwrap() {
            let missing = last.map_or(0, |last| increment.sequence - last.sequence - 1);
            passed += missing * PERIOD_NS + increment.interval_ns;
            assert_eq!(increment.timestamp_ns, passed, "in order, and the gap is where the time is missing");
            assert_eq!(Flags(increment.flags).intersects(Flags::LOST), missing > 0);
            gaps.extend(Some(missing).filter(|missing| *missing > 0));
            last = Some(increment);
        }
        acquisition.kept() == 0 && acquisition.in_flight() == 0 && passed == end * PERIOD_NS
    });
    assert_eq!(gaps, [3 * DROPPED]);
    let imu = domain.imu_status();
    assert_eq!(
        (&imu["gaps"], &imu["missing"], &imu["repeats"]),
        (&1.into(), &(3 * DROPPED).into(), &0.into()),
        "{imu}"
    );
    let ClosingNote { lost, unanswered } = acquisition.close();
    assert_eq!((lost, unanswered), (3 * DROPPED, 0));
    wait_until("the closing", || domain.imu_status()["closed"]["lost"] == 3 * DROPPED);
    service.terminate();
}

#[test]
fn periods_that_were_kept_have_the_lag_of_their_time_and_count_when_they_are_given_up() {
    const TAU_S: f64 = 10.0;
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let lag = LagOption::Fixed(TimeConstant::from_seconds(TAU_S).unwrap());
    let options = isotherm_client::Options { lag, ..domain.options() };
    let mut acquisition = Acquisition::connect(&id("imu-a"), &options).unwrap();
    acquisition.lag().soaked();
    let mut recorder = RawReader::connect(id("imu-a"), &domain.options()).unwrap();
    service.stop();
    let (mut expected, mut known) = (Lag::new(10_000_000_000), BTreeMap::new());
    let mut read = |acquisition: &mut Acquisition, number: u64, head: f64| {
        let time_ns = (number + 1) * PERIOD_NS;
        for (sensor, _) in &Sensor::NAMES[..3] {
            acquisition.lag().read(*sensor, head, time_ns);
            expected.read(*sensor as usize, head, time_ns);
        }
        known.insert(time_ns, expected.sensors[0].unwrap().lagged);
    };
    let begun = fill_up(&mut acquisition);
    for number in begun..begun + 300 {
        let head = 2.5 + 1e-3 * number as f64;
        read(&mut acquisition, number, head);
        let mut sample = acquisition.loan().unwrap();
        fill(&mut sample, number, head);
        acquisition.keep(sample).unwrap();
    }
    // What comes later changes nothing about what waits.
    read(&mut acquisition, begun + 100_000, 9.0);
    service.resume();
    let mut sums = vec![];
    wait_until("all that was kept", || {
        acquisition.send_kept().unwrap();
        while acquisition.receive().unwrap().is_some() {}
        sums.extend(
            std::iter::from_fn(|| recorder.receive().unwrap()).filter(|raw| raw.timestamp_ns > begun * PERIOD_NS),
        );
        acquisition.kept() == 0 && acquisition.in_flight() == 0
    });
    // The one that was handed back while the service was full had no lag, and is part of the first sum. The table is
    // not known to an acquisition that does not ask for its time constant, so sums end at 64 periods.
    let lengths: Vec<_> = sums.iter().map(|raw| raw.interval_ns / PERIOD_NS).collect();
    assert_eq!(lengths, [64, 64, 64, 64, 45]);
    for raw in &sums {
        let lagged = known[&raw.timestamp_ns];
        assert!(raw.accelerometers.head_lagged.iter().all(|value| *value == lagged), "{lagged} {raw:?}");
        assert_eq!(raw.lag_ns, 10_000_000_000);
    }

    // What still waits at the end is lost, all periods of it.
    service.stop();
    for number in 0..200 {
        let mut sample = acquisition.loan().unwrap();
        fill(&mut sample, begun + 300 + number, 2.5);
        acquisition.keep(sample).unwrap();
    }
    assert_eq!(acquisition.close(), ClosingNote { lost: 200, unanswered: 0 });
    service.resume();
    wait_until("the closing", || domain.imu_status()["closed"]["lost"] == 200);
    service.terminate();
}
