//! The numbers of the firmwares' own functions.

use crate::common::{FULL_PARAMS, FULL_PARM, HEATING_PARAMS, HEATING_PARM, KINDS, imported, subtracted};
use isotherm_autopilot::{Autopilot, Parameters};

/// A row of `golden.csv`.
struct Row {
    set: String,
    /// Calibration temperatures of accelerometers and gyroscopes.
    calibrated: [f32; 2],
    temperature: f32,
    /// What PX4 subtracts [m/s2; rad/s].
    px4: [[f32; 3]; 2],
    /// What ArduPilot adds.
    ardupilot: [[f32; 3]; 2],
}

/// The rows of both sets whose parameters are here.
fn rows() -> Vec<Row> {
    let text = include_str!("../data/golden.csv");
    let row = |line: &str| {
        let (set, numbers) = line.split_once(',').unwrap();
        let n: Vec<f32> = numbers.split(',').map(|number| number.parse().unwrap()).collect();
        let three = |from: usize| [n[from], n[from + 1], n[from + 2]];
        Row {
            set: set.to_owned(),
            calibrated: [n[0], n[1]],
            temperature: n[2],
            px4: [three(3), three(6)],
            ardupilot: [three(9), three(12)],
        }
    };
    let all: Vec<Row> = text.lines().skip(1).map(row).collect();
    assert_eq!(all.len(), 216);
    // The third set, `first6180`, comes without its parameters.
    let here: Vec<Row> = all.into_iter().filter(|row| row.set != "first6180").collect();
    assert_eq!(here.len(), 144);
    here
}

fn texts(set: &str) -> (&'static str, &'static str) {
    match set {
        "full" => (FULL_PARAMS, FULL_PARM),
        "heating" => (HEATING_PARAMS, HEATING_PARM),
        _ => panic!("{set}"),
    }
}

#[test]
fn the_formulas_are_those_of_the_firmwares_to_the_last_bit() {
    for row in rows() {
        let (params, parm) = texts(&row.set);
        let px4 = Parameters::read(params, Autopilot::Px4, None).unwrap();
        for (kind, offset) in KINDS.into_iter().zip(row.px4) {
            assert_eq!(px4.offset(kind, row.temperature), Some(offset), "{} {}", row.set, row.temperature);
        }
        let ardupilot = Parameters::read(parm, Autopilot::ArduPilot, None).unwrap();
        let Parameters::ArduPilot(accelerometers, Some(gyroscopes)) = ardupilot else { panic!("no gyroscopes") };
        let [accelerometer, gyroscope] = row.calibrated;
        let corrections = [
            accelerometers.correction(row.temperature, accelerometer),
            gyroscopes.correction(row.temperature, gyroscope),
        ];
        assert_eq!(corrections, row.ardupilot, "{} {} {:?}", row.set, row.temperature, row.calibrated);
    }
}

/// Compares what the kernel subtracts with numbers of a firmware, times `sign`. Returns the largest difference.
fn compared(subtracted: [[f64; 3]; 2], golden: [[f32; 3]; 2], sign: f64) -> f64 {
    let pairs = subtracted.as_flattened().iter().zip(golden.as_flattened());
    let differences = pairs.map(|(subtracted, golden)| {
        let golden = f64::from(*golden) * sign;
        let difference = (subtracted - golden).abs();
        assert!(difference <= 2e-6 + 1e-6 * golden.abs(), "{subtracted} {golden}");
        difference
    });
    differences.fold(0.0, f64::max)
}

#[test]
fn the_kernel_with_an_imported_table_subtracts_what_px4_subtracts() {
    let difference = |row: Row| {
        let table = imported(texts(&row.set).0, Autopilot::Px4);
        compared(subtracted(&table, row.temperature.into()), row.px4, 1.0)
    };
    let largest = rows().into_iter().map(difference).fold(0.0, f64::max);
    println!("PX4: {largest:e}");
    assert!(largest < 1.5e-7, "{largest}");
}

#[test]
fn the_kernel_with_an_imported_table_subtracts_what_ardupilot_adds() {
    let difference = |row: Row| {
        let [accelerometer, gyroscope] = row.calibrated;
        let offsets = |sensor: &str| ['X', 'Y', 'Z'].map(|axis| format!("INS_{sensor}OFFS_{axis} 0\n")).concat();
        let constants = format!(
            "INS_ACC1_CALTEMP {accelerometer}\n{}INS_GYR1_CALTEMP {gyroscope}\n{}",
            offsets("ACC"),
            offsets("GYR")
        );
        let table = imported(&(texts(&row.set).1.to_owned() + &constants), Autopilot::ArduPilot);
        compared(subtracted(&table, row.temperature.into()), row.ardupilot, -1.0)
    };
    let largest = rows().into_iter().map(difference).fold(0.0, f64::max);
    println!("ArduPilot: {largest:e}");
    assert!(largest < 1.5e-7, "{largest}");
}
