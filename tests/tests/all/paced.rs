//! The examples that send at the pace of an IMU, in C, C++ and Rust: none loses a period while the service is away.

use isotherm_client::{RawSample, Triad};
use isotherm_shared::compensate::answer;
use isotherm_tests::programs::{C, CPP, compile, start};
use isotherm_tests::{TABLE, TestDomain, table, wait_until};
use std::fs;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

const PERIODS: u64 = 1200;

/// The numbers of a line of an example, in their order.
fn numbers(line: &str) -> Vec<f64> {
    line.split([' ', ',', ':']).filter_map(|word| word.parse().ok()).collect()
}

/// Velocity after all periods, as the kernel computes it from what the examples send.
fn velocity() -> f64 {
    let exact = table(TABLE);
    let of_period = |period: u64| {
        let head = 2.5 + 1e-6 * (period / 40 * 40) as f64;
        let positive_pulses = [140, 141, 142];
        let triad =
            Triad { head_temperature: [head; 3], board_temperature: [head; 3], positive_pulses, ..Triad::default() };
        let raw = RawSample { interval_ns: 2_500_000, accelerometers: triad, ..RawSample::default() };
        answer(Some(&exact), &raw).velocity_increment[0]
    };
    (0..PERIODS).map(of_period).sum()
}

#[test]
fn no_period_is_lost_while_the_service_stands_still_and_is_replaced() {
    let domain = TestDomain::new();
    let compiled = [(C, "examples/c/paced.c"), (CPP, "examples/cpp/paced.cpp")];
    let compiled = compiled.into_iter().filter_map(|(language, source)| compile(&domain, language, source));
    let programs: Vec<_> = compiled.chain([PathBuf::from(env!("CARGO_BIN_EXE_example-paced"))]).collect();
    let ids = ["imu-a", "imu-b", "imu-c"];
    let served: Vec<_> = ids.iter().flat_map(|id| ["--imu".to_owned(), format!("{id}={id}.toml")]).collect();
    let served: Vec<_> = served.iter().map(String::as_str).collect();
    ids.iter().for_each(|id| drop(domain.write(&format!("{id}.toml"), &TABLE.replace("imu-a", id))));
    let service = domain.serve(&served);
    let received = || {
        domain.status()["imus"]
            .as_array()
            .unwrap()
            .iter()
            .map(|imu| imu["received"].as_u64().unwrap())
            .collect::<Vec<_>>()
    };
    let begin =
        |(program, id): (&PathBuf, &&str)| start(&domain, program, &[id, &PERIODS.to_string()], &format!("{id}.txt"));
    let mut running: Vec<_> = programs.iter().zip(&ids).map(begin).collect();
    wait_until("samples of each", || received()[..programs.len()].iter().all(|received| *received > 20));
    // For longer than 64 periods, so that the queues fill and periods are merged; then a new service.
    service.stop();
    sleep(Duration::from_millis(500));
    service.kill();
    let service = domain.serve(&served);
    for (child, id) in running.iter_mut().zip(ids) {
        assert!(child.wait().unwrap().success(), "{id}");
        let printed = fs::read_to_string(domain.path(&format!("{id}.txt"))).unwrap();
        let (counts, end) = printed.split_once('\n').unwrap();
        let [periods, answered, late, merged, lost] = numbers(counts)[..] else { panic!("{printed}") };
        assert_eq!((periods, lost, answered + late + merged), (PERIODS as f64, 0.0, periods), "{printed}");
        assert!(late >= 64.0 && merged > 0.0, "{printed}");
        let velocity = velocity();
        assert!((numbers(end)[0] - velocity).abs() < 1e-6 * velocity.abs(), "{printed}: {velocity}");
    }
    let status = domain.status();
    for imu in status["imus"].as_array().unwrap() {
        assert_eq!(
            (&imu["missing"], &imu["flagged"]["time-step"], &imu["closed"]),
            (&0.into(), &0.into(), &().into()),
            "{imu}"
        );
    }
    service.terminate();
}
