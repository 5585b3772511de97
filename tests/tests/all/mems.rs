//! The examples whose IMU delivers readings, in C, C++ and Rust: what they print is what the kernel makes of the
//! readings.

use isotherm_client::{Flags, RawSample, Resolution, Triad};
use isotherm_shared::compensate::answer;
use isotherm_shared::readings::Readings;
use isotherm_tests::programs::{C, CPP, compile, run};
use isotherm_tests::{TestDomain, table};
use std::fs;
use std::path::PathBuf;

const MEMS_TABLE: &str = include_str!("../../../examples/tables/imu-mems.toml");
const SAMPLES: u64 = 40;

/// The lines that an example prints.
fn expected() -> String {
    let table = table(MEMS_TABLE);
    let mut readings = Readings::new(Resolution { accelerometer: 1e-6, gyroscope: 1e-7 }, 2_500_000);
    let line = |number: u64| {
        let turn = number as f64 / 7.0;
        let triad = Triad { head_temperature: [31.25; 3], board_temperature: [31.25; 3], ..Triad::default() };
        let mut raw = RawSample { accelerometers: triad, gyroscopes: triad, ..RawSample::default() };
        let rate = [0.012_345_67, -turn, 0.000_012_34];
        readings.fill(&mut raw, [0.123_456_7, -0.234_567_8 - turn, 9.801_234_5], Some(rate)).unwrap();
        let increment = answer(Some(&table), &raw);
        assert_eq!(Flags(increment.flags), Flags::default());
        let ([x, y, z], [p, q, r]) = (increment.specific_force(), increment.angular_rate());
        format!("{number}: {x:.9} {y:.9} {z:.9} m/s2, {p:.9} {q:.9} {r:.9} rad/s\n")
    };
    (0..SAMPLES).map(line).collect()
}

#[test]
fn the_examples_turn_readings_into_increments_and_back() {
    let domain = TestDomain::new();
    domain.write("imu-mems.toml", MEMS_TABLE);
    let service = domain.serve(&["--imu", "imu-mems=imu-mems.toml"]);
    let compiled = [(C, "examples/c/mems.c"), (CPP, "examples/cpp/mems.cpp")];
    let compiled = compiled.into_iter().filter_map(|(language, source)| compile(&domain, language, source));
    for program in compiled.chain([PathBuf::from(env!("CARGO_BIN_EXE_example-mems"))]) {
        run(&domain, &program, &["imu-mems", &SAMPLES.to_string()], "out");
        assert_eq!(fs::read_to_string(domain.path("out")).unwrap(), expected(), "{}", program.display());
    }
    service.terminate();
}

#[test]
fn c_gets_pulses_errors_and_readings_as_documented() {
    let domain = TestDomain::new();
    domain.write("imu-mems.toml", MEMS_TABLE);
    let service = domain.serve(&["--imu", "imu-mems=imu-mems.toml"]);
    let Some(program) = compile(&domain, C, "tests/programs/readings.c") else { return };
    run(&domain, &program, &["imu-mems"], "out");
    service.terminate();
}
