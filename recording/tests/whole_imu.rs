//! The whole IMU: a recording with gyroscopes and lagged temperature, read, compensated, and compared with exact
//! increments.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_recording::RawCsvReader;
use isotherm_recording::csv::Rows;
use isotherm_shared::compensate::answer;
use isotherm_shared::lag::Lag;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::{AXES, Flags, RawSample, Triad};
use nalgebra::Matrix3;

const TABLE: &str = include_str!("../../tests/data/imu-g.toml");
const RUN: &str = include_str!("../../tests/data/run-g.csv");
const DOUBLE: &str = include_str!("../../tests/data/run-g.double.csv");
const EXPECTED: &str = include_str!("../../tests/data/run-g.expected.csv");

fn table() -> CoefficientTable {
    CoefficientTable::from_toml(TABLE, None).unwrap()
}

fn samples(text: &str) -> Vec<RawSample> {
    RawCsvReader::new(text.as_bytes()).unwrap().map(Result::unwrap).collect()
}

/// The increments and flags of a file: sequence, three velocities and three angles, flags.
fn increments(text: &str) -> Vec<(u64, [f64; 2 * AXES], String)> {
    let mut rows = Rows::new(text.as_bytes());
    assert!(rows.next_row().unwrap());
    let names = ["sequence", "a1_dv", "a2_dv", "a3_dv", "g1_da", "g2_da", "g3_da", "flags"];
    let columns = rows.columns(&names, "").unwrap();
    let mut found = Vec::new();
    while rows.next_row().unwrap() {
        let values = core::array::from_fn(|index| rows.float(&columns[1 + index]).unwrap());
        let flags = rows.parse(&columns[7], "", |text| Some(text.to_owned())).unwrap();
        found.push((rows.integer(&columns[0]).unwrap(), values, flags));
    }
    found
}

#[test]
fn a_whole_imu_is_compensated_bit_for_bit() {
    let table = table();
    let (samples, expected) = (samples(RUN), increments(DOUBLE));
    assert_eq!((samples.len(), expected.len()), (2000, 2000));
    for (raw, (sequence, values, flags)) in samples.iter().zip(expected) {
        let increment = answer(Some(&table), raw);
        let [a, g] = [increment.velocity_increment, increment.angle_increment];
        let own = [a[0], a[1], a[2], g[0], g[1], g[2]];
        // A text has one NaN.
        let bits =
            |values: [f64; 2 * AXES]| values.map(|value| if value.is_nan() { u64::MAX } else { value.to_bits() });
        assert_eq!((increment.sequence, bits(own)), (sequence, bits(values)), "{own:?} {values:?}");
        assert_eq!(Flags(increment.flags).to_string(), flags, "sequence {sequence}");
    }
}

/// The sum of the absolute values of the terms of a polynomial.
fn size(polynomial: &Polynomial, temperature: f64) -> f64 {
    let x = (polynomial.clamp(temperature) - polynomial.center()) / polynomial.scale();
    polynomial.coefficients().iter().rev().fold(0.0, |sum, coefficient| sum * x.abs() + coefficient.abs())
}

/// The sum of the absolute values of everything that is added up to what a sensor indicates, in g0*s or arcsec.
fn indicated_size(table: &CoefficientTable, axis: &Axis, raw: &RawSample, triad: &Triad, index: usize) -> f64 {
    let (head, board) = (triad.head_temperature[index], triad.board_temperature[index]);
    let term = |pulses: u32, polynomial: &Polynomial| {
        let value = polynomial.at(polynomial.clamp(board));
        f64::from(pulses) / value.abs() * (size(polynomial, board) / value.abs())
    };
    let [low, high] = axis.bias.range();
    let lagged = triad.head_lagged[index];
    let counts = raw.lag_ns == table.lag_ns() && (lagged - head).abs() <= high - low;
    let transient = if counts { axis.transient.abs() * (lagged.abs() + head.abs()) } else { 0.0 };
    let bias = (size(&axis.bias, head) + transient) * axis.bias_unit.factor() * (raw.interval_ns as f64 / 1e9);
    term(triad.positive_pulses[index], &axis.positive_scale_factor)
        + term(triad.negative_pulses[index], &axis.negative_scale_factor)
        + bias
}

fn aligned_size(matrix: Option<&Matrix3<f64>>, sizes: [f64; AXES]) -> [f64; AXES] {
    let row = |matrix: &Matrix3<f64>, row: usize| (0..AXES).map(|j| matrix[(row, j)].abs() * sizes[j]).sum();
    matrix.map_or(sizes, |matrix| core::array::from_fn(|index| row(matrix, index)))
}

#[test]
fn a_whole_imu_agrees_with_rational_arithmetic() {
    let table = table();
    let content = table.content();
    let gyroscopes = table.content().gyroscopes.as_ref().unwrap();
    let (mut largest, mut ordinary, mut compared) = (0.0_f64, [0.0_f64; 2], 0);
    for (raw, (sequence, exact, flags)) in samples(RUN).iter().zip(increments(EXPECTED)) {
        let increment = answer(Some(&table), raw);
        assert_eq!((increment.sequence, Flags(increment.flags).to_string()), (sequence, flags));
        let of = |axes: &[Axis; AXES], triad: &Triad| -> [f64; AXES] {
            core::array::from_fn(|index| indicated_size(&table, &axes[index], raw, triad, index))
        };
        let velocity = aligned_size(content.alignment.as_ref(), of(&content.axes, &raw.accelerometers));
        let velocity = velocity.map(|size| content.gravity * size);
        let q_known = increment.velocity_increment.iter().all(|dv| dv.is_finite());
        let mut angle = of(&gyroscopes.axes, &raw.gyroscopes);
        for (size, g_sensitivity) in angle.iter_mut().zip(&gyroscopes.g_sensitivity) {
            if let (Some(s), true) = (g_sensitivity, q_known) {
                *size += (0..AXES).map(|j| s[j].abs() * velocity[j] / content.gravity).sum::<f64>();
            }
        }
        let angle = aligned_size(gyroscopes.alignment.as_ref(), angle).map(|size| size * ARCSEC);
        let own = [increment.velocity_increment, increment.angle_increment];
        for (kind, (own, sizes)) in own.into_iter().zip([velocity, angle]).enumerate() {
            for index in 0..AXES {
                let (own, exact) = (own[index], exact[kind * AXES + index]);
                assert_eq!(own.is_nan(), exact.is_nan(), "sequence {sequence}");
                if !own.is_nan() {
                    let error = (own - exact).abs();
                    assert!(
                        error <= 1e-15 * sizes[index],
                        "sequence {sequence}: {own} for {exact}, S {}",
                        sizes[index]
                    );
                    largest = largest.max(error / sizes[index]);
                    if sequence < 1000 {
                        ordinary[kind] = ordinary[kind].max(error);
                    }
                    compared += 1;
                }
            }
        }
    }
    let [velocity, angle] = ordinary;
    println!("{compared} increments: at most {largest:.2e} S; of ordinary samples {velocity:.1e} m/s, {angle:.1e} rad");
    assert!(compared > 11_000, "{compared}");
}

/// Another program has computed the lagged temperature of the file from the same readings.
#[test]
fn the_lag_of_a_recording_is_the_one_that_was_recorded() {
    let mut lag = Lag::new(240_000_000_000);
    let (mut readings, mut largest) = (0, 0.0_f64);
    for raw in samples(RUN).iter().take(1000) {
        let (before, mut filled) = (lag, *raw);
        lag.follow(raw);
        readings += usize::from(lag != before);
        lag.fill(&mut filled);
        assert_eq!(filled.lag_ns, raw.lag_ns);
        for (own, theirs) in [(filled.accelerometers, raw.accelerometers), (filled.gyroscopes, raw.gyroscopes)] {
            for (own, theirs) in own.head_lagged.iter().zip(theirs.head_lagged) {
                largest = largest.max((own - theirs).abs());
            }
        }
    }
    println!("{readings} readings, largest difference {largest:.1e} V");
    assert!(largest < 1e-13, "{largest}");
    assert_eq!(readings, 50, "the temperature was read every 20 samples");
}
