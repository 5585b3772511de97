//! The waiting line of an acquisition, with a service that stands still: each period waits as it is, and what does not
//! fit is a gap.

use isotherm_client::{Acquisition, ClosingNote, Flags, Lag, LagOption, Options, RawReader, RawSample, SendError};
use isotherm_client::{CompensateError, Sensor, TimeConstant, Triad};
use isotherm_tests::{TIMEOUT, TestDomain, id, wait_until};
use std::collections::BTreeMap;
use std::time::Duration;

const PERIOD_NS: u64 = 2_500_000;

/// Loans control period `number`, filled in.
fn period(acquisition: &mut Acquisition, number: u64, head: f64) -> isotherm_client::Loan {
    let mut sample = acquisition.loan().unwrap();
    fill(&mut sample, number, head);
    sample
}

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
        let sample = period(acquisition, number, 2.5);
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
    const KEPT: u64 = 300;
    const DROPPED: u64 = 10;
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut reader = domain.reader("imu-a");
    let options = Options { kept: KEPT as usize, ..domain.options() };
    let mut acquisition = Acquisition::connect(&id("imu-a"), &options).unwrap();
    service.stop();
    let begun = fill_up(&mut acquisition);
    for number in begun..begun + KEPT - 1 + DROPPED {
        let sample = period(&mut acquisition, number, 2.5);
        acquisition.keep(sample).unwrap();
    }
    let end = begun + KEPT - 1 + DROPPED;
    assert_eq!((acquisition.kept(), acquisition.lost()), (KEPT, DROPPED), "the oldest are dropped, the others wait");
    assert!(matches!(acquisition.begin_session(), Err(error) if error.0 > KEPT as usize));
    assert_eq!(acquisition.closing().lost, KEPT + DROPPED);

    service.resume();
    let (mut next, mut gaps) = (0, vec![]);
    wait_until("all that was kept", || {
        while acquisition.receive_timeout(Duration::from_millis(1)).unwrap().is_some() {}
        while let Some(increment) = reader.receive().unwrap() {
            let missing = increment.sequence - next;
            assert_eq!((increment.timestamp_ns, increment.interval_ns), ((next + missing + 1) * PERIOD_NS, PERIOD_NS));
            assert_eq!(Flags(increment.flags).intersects(Flags::LOST), missing > 0);
            gaps.extend(Some(missing).filter(|missing| *missing > 0));
            next = increment.sequence + 1;
        }
        acquisition.kept() == 0 && acquisition.in_flight() == 0 && next == end
    });
    assert_eq!(gaps, [DROPPED]);
    let imu = domain.imu_status();
    assert_eq!((&imu["gaps"], &imu["missing"], &imu["repeats"]), (&1.into(), &DROPPED.into(), &0.into()), "{imu}");
    assert_eq!(acquisition.close(), ClosingNote { lost: DROPPED, unanswered: 0 });
    wait_until("the closing", || domain.imu_status()["closed"]["lost"] == DROPPED);
    service.terminate();
}

#[test]
fn a_period_that_waits_has_lag_and_sending_time_of_its_moment() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let lag = LagOption::Fixed(TimeConstant::from_seconds(10.0).unwrap());
    let options = Options { lag, ..domain.options() };
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
    let kept_since = isotherm_client::monotonic_ns();
    for number in begun..begun + 300 {
        let head = 2.5 + 1e-6 * number as f64;
        read(&mut acquisition, number, head);
        let sample = period(&mut acquisition, number, head);
        acquisition.keep(sample).unwrap();
    }
    let kept_until = isotherm_client::monotonic_ns();
    // What comes later changes nothing about what waits.
    read(&mut acquisition, begun + 100_000, 2.6);
    service.resume();
    let mut sent = vec![];
    wait_until("all that was kept", || {
        while acquisition.receive_timeout(Duration::from_millis(1)).unwrap().is_some() {}
        sent.extend(
            std::iter::from_fn(|| recorder.receive().unwrap()).filter(|raw| raw.timestamp_ns > begun * PERIOD_NS),
        );
        acquisition.kept() == 0 && acquisition.in_flight() == 0 && sent.len() == 300
    });
    for raw in &sent {
        let lagged = known[&raw.timestamp_ns];
        assert!(raw.accelerometers.head_lagged.iter().all(|value| *value == lagged), "{lagged} {raw:?}");
        assert_eq!((raw.lag_ns, raw.interval_ns), (10_000_000_000, PERIOD_NS));
        assert!((kept_since..=kept_until).contains(&raw.sent_ns), "{raw:?}");
    }

    // What still waits at the end is lost.
    service.stop();
    for number in 0..200 {
        let sample = period(&mut acquisition, begun + 300 + number, 2.5);
        acquisition.keep(sample).unwrap();
    }
    assert_eq!((acquisition.lost(), acquisition.kept()), (0, 200));
    assert_eq!(acquisition.close(), ClosingNote { lost: 200, unanswered: 0 });
    service.resume();
    wait_until("the closing", || domain.imu_status()["closed"]["lost"] == 200);
    service.terminate();
}

#[test]
fn keeping_without_sending_what_is_kept_silences_nobody() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    service.stop();
    let mut number = fill_up(&mut acquisition);
    service.resume();
    wait_until("a round trip", || {
        let sample = period(&mut acquisition, number, 2.5);
        number += 1;
        match acquisition.compensate(sample, TIMEOUT) {
            Ok(_) => true,
            Err(CompensateError::Send(SendError::Full(sample))) => {
                acquisition.keep(sample).unwrap();
                false
            }
            Err(other) => panic!("{other}"),
        }
    });
    assert_eq!((acquisition.kept(), acquisition.lost()), (0, 0));
    service.terminate();
}
