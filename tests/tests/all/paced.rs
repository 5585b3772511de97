//! The examples that send at the pace of an IMU, in C, C++ and Rust: none loses a period while the service is away, and
//! every reader gets the velocity and the angle of every period.

use isotherm_client::{CompensatedIncrement, Flags, IncrementReader, RawSample, Resolution, Triad};
use isotherm_shared::compensate::answer;
use isotherm_shared::readings::Readings;
use isotherm_tests::programs::{C, CPP, SERIAL, compile, start};
use isotherm_tests::{Process, TIMEOUT, TestDomain, id, table, wait_until};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::{self, sleep};
use std::time::Duration;

const MEMS_TABLE: &str = include_str!("../../../examples/tables/imu-mems.toml");
const IMU: &str = "imu-mems";
const PERIOD_NS: u64 = 2_500_000;

/// Sums of velocity and angle.
type Sums = [f64; 6];

fn add(sums: &mut Sums, increment: &CompensatedIncrement) {
    let values = increment.velocity_increment.iter().chain(&increment.angle_increment);
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

/// Velocity and angle after all periods, as the kernel computes them from what the examples read.
fn generated(periods: u64) -> Sums {
    let table = table(MEMS_TABLE);
    let mut readings = Readings::new(Resolution { accelerometer: 1e-6, gyroscope: 1e-7 }, PERIOD_NS);
    let mut sums = Sums::default();
    for period in 0..periods {
        let temperature = [31.25 + 1e-6 * (period / 40 * 40) as f64; 3];
        let triad = Triad { head_temperature: temperature, board_temperature: temperature, ..Triad::default() };
        let mut raw = RawSample { accelerometers: triad, gyroscopes: triad, ..RawSample::default() };
        let turn = (period % 100) as f64;
        let rate = [0.01, 1e-5 * turn - 0.02, 7.292e-5];
        readings.fill(&mut raw, [0.1 + 1e-4 * turn, -0.3, 9.80665], Some(rate)).unwrap();
        add(&mut sums, &answer(Some(&table), &raw));
    }
    sums
}

fn assert_all_arrived(sums: &Sums, periods: u64, whose: &str) {
    for (sum, generated) in sums.iter().zip(generated(periods)) {
        // What is printed has nine places.
        assert!((sum - generated).abs() < 2e-9, "{whose}: {sums:?}, generated {generated}");
    }
}

/// The numbers of a line of an example, in their order.
fn numbers(line: &str) -> Vec<f64> {
    line.split([' ', ',', ':']).filter_map(|word| word.parse().ok()).collect()
}

/// Runs an example while the service is away: `away` ends it, and may wait. No period may be lost, and none flagged.
fn survives(domain: &TestDomain, program: &Path, periods: u64, away: impl FnOnce(Process)) {
    domain.write("imu-mems.toml", &MEMS_TABLE.replace("S/N 0311", SERIAL));
    let served = ["--imu", "imu-mems=imu-mems.toml"];
    let service = domain.serve(&served);
    // It reads all the time, as navigation does: after the outage increments come faster than a queue lasts.
    let (options, has_ended) = (domain.options(), Arc::new(AtomicBool::new(false)));
    let ended = Arc::clone(&has_ended);
    let (connected, is_connected) = mpsc::channel();
    let reading = thread::spawn(move || {
        let mut reader = IncrementReader::connect(id(IMU), &options).unwrap();
        connected.send(()).unwrap();
        let (mut sums, mut flags, mut read_all) = (Sums::default(), Flags::default(), 0);
        loop {
            let is_last = ended.load(Ordering::Acquire);
            while let Some(increment) = reader.receive_timeout(Duration::from_millis(10)).unwrap() {
                add(&mut sums, &increment);
                flags |= Flags(increment.flags);
                assert_eq!((increment.sequence, increment.interval_ns), (read_all, PERIOD_NS), "each period by itself");
                read_all += 1;
            }
            if is_last {
                return (sums, flags, read_all);
            }
        }
    });
    is_connected.recv_timeout(TIMEOUT).unwrap();
    let mut child = start(domain, program, &[IMU, &periods.to_string()], "out");
    wait_until("samples", || domain.imu_status()["received"].as_u64().unwrap() > 20);
    away(service);
    let service = domain.serve(&served);

    let mut status = None;
    wait_until("the end of the example", || {
        status = child.try_wait().unwrap();
        status.is_some()
    });
    has_ended.store(true, Ordering::Release);
    let (sums, flags, read_all) = reading.join().unwrap();
    assert!(status.unwrap().success());
    assert_eq!(flags.only(Flags(!Flags::LATE.0)), Flags::default(), "no gap, no time step, no interval-not-nominal");
    assert_eq!(read_all, periods);
    assert_all_arrived(&sums, periods, "a reader");

    let printed = fs::read_to_string(domain.path("out")).unwrap();
    let lines: Vec<_> = printed.lines().map(numbers).collect();
    let [counts, velocity, angle] = &lines[..] else { panic!("{printed}") };
    assert_eq!(counts, &[periods as f64, periods as f64, 0.0], "{printed}");
    assert_all_arrived(&[&velocity[..], angle].concat().try_into().unwrap(), periods, &printed);
    let imu = domain.imu_status();
    let counted = ["missing", "closed"].map(|key| imu[key].clone());
    assert_eq!((counted, &imu["flagged"]["interval-not-nominal"]), ([0.into(), ().into()], &0.into()), "{imu}");
    service.terminate();
}

fn survives_10_s(domain: &TestDomain, program: &Path) {
    // 2.5 s more than the outage, for the start of the program and of the service.
    survives(domain, program, 5000, |service| {
        service.kill();
        sleep(Duration::from_secs(10));
    });
}

#[test]
fn rust_loses_nothing_in_10_s_without_the_service() {
    survives_10_s(&TestDomain::new(), Path::new(env!("CARGO_BIN_EXE_example-paced")));
}

#[test]
fn c_loses_nothing_in_10_s_without_the_service() {
    let domain = TestDomain::new();
    let Some(program) = compile(&domain, C, "examples/c/paced.c") else { return };
    survives_10_s(&domain, &program);
}

#[test]
fn cpp_loses_nothing_in_10_s_without_the_service() {
    let domain = TestDomain::new();
    let Some(program) = compile(&domain, CPP, "examples/cpp/paced.cpp") else { return };
    survives_10_s(&domain, &program);
}

#[test]
fn no_period_is_lost_while_the_service_stands_still_and_is_replaced() {
    let program = Path::new(env!("CARGO_BIN_EXE_example-paced"));
    survives(&TestDomain::new(), program, 1200, |service| {
        service.stop();
        // For longer than 64 periods, so that the queues fill and periods are kept.
        sleep(Duration::from_millis(500));
        service.kill();
    });
}
