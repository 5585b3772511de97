//! Rehearsals are seen by nobody, and a process that is killed in one leaves nothing behind. A burst of one IMU does
//! not delay another.

use isotherm_client::{Acquisition, CompensatedIncrement, RawReader, RawSample};
use isotherm_shared::wire::Flags;
use isotherm_tests::{TABLE, TIMEOUT, TestDomain, id, recording, round_trip, same, wait_until};
use rustix::process::Signal;
use std::collections::BTreeSet;
use std::thread;
use std::time::Duration;

const STRATEGIES: [&str; 3] = ["spin", "anticipate", "block"];

/// A service of `imus` with a waiting strategy.
fn configure(domain: &TestDomain, imus: &[&str], strategy: &str) {
    let mut text = format!("[wait]\nstrategy = \"{strategy}\"\n");
    for imu in imus {
        domain.write(&format!("{imu}.toml"), &TABLE.replace("\"imu-a\"", &format!("\"{imu}\"")));
        text = format!("{text}[[imu]]\nid = \"{imu}\"\ntable = \"{imu}.toml\"\n");
    }
    domain.write("service.toml", &text);
}

#[test]
fn nobody_sees_a_rehearsal() {
    for strategy in STRATEGIES {
        let domain = TestDomain::new();
        configure(&domain, &["imu-a"], strategy);
        let service = domain.serve(&["--config", "service.toml"]);
        let (mut increments, mut raws) =
            (domain.reader("imu-a"), RawReader::connect(id("imu-a"), &domain.options()).unwrap());
        let mut acquisition = domain.acquisition("imu-a");
        let mut plain = Vec::new();
        // Once without and once with rehearsals in all phases: nothing sent, on loan, in flight.
        for rehearse in [false, true] {
            let prepare = |acquisition: &mut Acquisition| {
                (0..100).filter(|_| rehearse).for_each(|_| acquisition.prepare());
            };
            acquisition.begin_session().unwrap();
            prepare(&mut acquisition);
            let answers: Vec<_> = recording()[..200]
                .iter()
                .map(|sample| {
                    let mut loan = acquisition.loan().unwrap();
                    prepare(&mut acquisition);
                    let (session, sequence) = (loan.session, loan.sequence);
                    *loan = RawSample { session, sequence, ..*sample };
                    acquisition.send(loan).unwrap();
                    prepare(&mut acquisition);
                    let answer = acquisition.receive_timeout(TIMEOUT).unwrap().unwrap();
                    // A worker that waits rehearses too.
                    if sequence % 50 == 0 {
                        thread::sleep(Duration::from_millis(20));
                    }
                    answer
                })
                .collect();
            for (answer, sequence) in answers.iter().zip(0..) {
                let (raw, increment) = (raws.receive().unwrap().unwrap(), increments.receive().unwrap().unwrap());
                assert_eq!((answer.sequence, raw.sequence, increment.sequence), (sequence, sequence, sequence));
                assert!(same(answer, &increment) && answer.flags & Flags::GAP.0 == 0);
            }
            if rehearse {
                let of_the_other = |a: &CompensatedIncrement, b: &CompensatedIncrement| CompensatedIncrement {
                    session: b.session,
                    ..*a
                };
                assert!(plain.iter().zip(&answers).all(|(a, b)| same(&of_the_other(a, b), b)), "{strategy}");
            }
            plain = answers;
        }
        assert!(raws.receive().unwrap().is_none() && increments.receive().unwrap().is_none());
        wait_until("the status", || domain.imu_status()["received"] == 400);
        let status = domain.imu_status();
        for (key, value) in [("compensated", 400), ("gaps", 0), ("missing", 0), ("repeats", 0), ("sessions", 2)] {
            assert_eq!(status[key], value, "{strategy}: {key} in {status}");
        }
        service.terminate();
    }
}

#[test]
fn who_is_killed_in_a_rehearsal_leaves_its_places_free() {
    let domain = TestDomain::new();
    // A worker that spins rehearses all the time, and this program before every second sample.
    configure(&domain, &["imu-a"], "spin");
    let mut service = Some(domain.serve(&["--config", "service.toml"]));
    for round in 0..24 {
        let received = || domain.imu_status()["received"].as_u64().unwrap();
        let before = received();
        let client = domain.start(domain.program("counted", &["send", "imu-a", "1000000000000"]));
        // Not whether one is connected: a dead one counts as connected for a while.
        wait_until("samples of this acquisition", || received() > before);
        thread::sleep(Duration::from_micros(700 * round));
        client.signal(Signal::KILL);
        client.wait();
        if round % 4 == 3 {
            service.take().unwrap().kill();
            service = Some(domain.serve(&["--config", "service.toml"]));
        }
    }
    let mut acquisition = domain.acquisition("imu-a");
    for sample in &recording()[..50] {
        acquisition.prepare();
        assert_eq!(round_trip(&mut acquisition, sample).flags & Flags::GAP.0, 0);
    }
    drop(acquisition);
    service.take().unwrap().terminate();
    assert!(domain.run(&["clean"]).status.success());
}

/// The worker is stopped while samples are sent, so that it finds a full queue of one IMU and one sample of another;
/// the others are idle.
#[test]
fn a_burst_of_one_imu_delays_another_by_one_sample() {
    let imus = ["imu-a", "imu-b", "imu-c", "imu-d", "imu-e"];
    for strategy in STRATEGIES {
        let domain = TestDomain::new();
        configure(&domain, &imus, strategy);
        let service = domain.serve(&["--config", "service.toml"]);
        let sample = recording()[0];
        let mut acquisitions = imus.map(|imu| domain.acquisition(imu));
        let mut raws = imus.map(|imu| RawReader::connect(id(imu), &domain.options()).unwrap());
        for (acquisition, raws) in acquisitions.iter_mut().zip(&mut raws) {
            round_trip(acquisition, &sample);
            raws.receive().unwrap().unwrap();
        }
        let pairs = (0..imus.len()).flat_map(|burst| (0..imus.len()).map(move |other| (burst, other)));
        for (burst, other) in pairs.filter(|(burst, other)| burst != other) {
            service.stop();
            for (imu, count) in [(burst, acquisitions[burst].depth()), (other, 1)] {
                for _ in 0..count {
                    let mut loan = acquisitions[imu].loan().unwrap();
                    loan.interval_ns = sample.interval_ns;
                    acquisitions[imu].send(loan).unwrap();
                }
            }
            service.resume();
            // When each increment was published, and of which IMU it is.
            let mut published = BTreeSet::new();
            for imu in [burst, other] {
                while acquisitions[imu].in_flight() > 0 {
                    let answer = acquisitions[imu].receive_timeout(TIMEOUT).unwrap().unwrap();
                    let raw = raws[imu].receive().unwrap().unwrap();
                    assert_eq!(raw.sequence, answer.sequence);
                    published.insert((raw.sent_ns + answer.latency_ns, answer.sequence, imu));
                }
            }
            let before = published.iter().position(|(_, _, imu)| *imu == other).unwrap();
            assert!(before <= 1, "{strategy}: {before} samples of {burst} before the one of {other}");
        }
        service.terminate();
    }
}
