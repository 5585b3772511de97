//! Correct data of laboratories that do things differently: no fault.

use super::common::{campaign_file, paper};
use isotherm_campaign::read_dwells;
use isotherm_fit::{Calibration, CalibrationError, CalibrationOptions, calibrate_accelerometers};
use isotherm_recording::CampaignRow;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::wire::RawSample;
use isotherm_simulation::{
    CampaignSchedule, Chain, MISALIGNMENT, Noise, RandomGenerator, SimulatedRow, TILT_RAD, Truth, campaign,
};
use isotherm_support::finding::name;
use nalgebra::Matrix3;

/// The paper's IMU with `factor` times its scale factors.
fn truth(factor: f64) -> Truth {
    let mut content = paper().content().clone();
    let scaled = |p: &Polynomial| {
        let coefficients: Vec<f64> = p.coefficients().iter().map(|c| c * factor).collect();
        Polynomial::new(&coefficients, p.center(), p.scale(), p.range()).unwrap()
    };
    for axis in &mut content.axes {
        axis.positive_scale_factor = scaled(&axis.positive_scale_factor);
        axis.negative_scale_factor = scaled(&axis.negative_scale_factor);
        axis.max_rate = None;
    }
    Truth::new(content, MISALIGNMENT, TILT_RAD, 9.8015).unwrap()
}

/// Seven set points from -20 to 40 degC, as the paper's laboratory measures them.
fn usual() -> CampaignSchedule {
    CampaignSchedule { set_points_c: (-2..=4).map(|k| 10.0 * f64::from(k)).collect(), ..CampaignSchedule::default() }
}

fn rows(truth: &Truth, schedule: &CampaignSchedule) -> Vec<SimulatedRow> {
    campaign(truth, schedule, 5).collect()
}

/// Calibrates rows whose temperature is in `unit`.
fn table_of(
    unit: &str,
    truth: &Truth,
    schedule: &CampaignSchedule,
    rows: Vec<SimulatedRow>,
) -> Result<Calibration, String> {
    let mut file = campaign_file(truth, schedule);
    file.temperature_unit = unit.to_owned();
    let row = |(line, row): (u64, SimulatedRow)| {
        Ok(CampaignRow { line, set_point_c: row.set_point_c, position: Some(row.position), sample: row.raw })
    };
    let dwells = read_dwells(&file, (2..).zip(rows).map(row)).map_err(|error| error.to_string())?;
    calibrate_accelerometers(&file, dwells, CalibrationOptions::default()).map_err(|error| match &error {
        CalibrationError::Faults { .. } => {
            error.lines(true, |finding| finding.tagged(|line| line.to_string())).join("\n")
        }
        _ => error.to_string(),
    })
}

fn temperature(raw: &mut RawSample, change: impl Fn(f64) -> f64) {
    for value in raw.accelerometers.head_temperature.iter_mut().chain(&mut raw.accelerometers.board_temperature) {
        *value = change(*value);
    }
}

/// The same laboratory with other set points.
fn at(set_points_c: impl IntoIterator<Item = f64>) -> CampaignSchedule {
    CampaignSchedule { set_points_c: set_points_c.into_iter().collect(), ..usual() }
}

/// A campaign whose temperature is read otherwise.
fn read_as(unit: &str, schedule: &CampaignSchedule, change: fn(f64) -> f64) -> Result<Calibration, String> {
    let truth = truth(1.0);
    let mut rows = rows(&truth, schedule);
    rows.iter_mut().for_each(|row| temperature(&mut row.raw, change));
    table_of(unit, &truth, schedule, rows)
}

/// The names of the warnings about temperature.
fn about_temperature(calibration: &Calibration) -> Vec<&'static str> {
    let names = calibration.findings.iter().map(|finding| finding.name);
    names.filter(|name| name.starts_with("temperature") || *name == name::SET_POINT).collect()
}

/// Temperature of the usual temperature \[degC\].
fn celsius(volts: f64) -> f64 {
    (volts - 2.1) / 0.04
}

/// A thermistor of 10 kOhm at 25 degC, read to 1 Ohm \[kOhm\].
fn thermistor(volts: f64) -> f64 {
    let kelvin = celsius(volts) + 273.15;
    (10.0 * libm::exp(3950.0 * (1.0 / kelvin - 1.0 / 298.15)) * 1000.0).round() / 1000.0
}

#[test]
fn temperature_may_be_in_any_unit_and_fall() {
    let none: [&str; 0] = [];
    for unit in ["kΩ", "kOhm", "k"] {
        assert_eq!(about_temperature(&read_as(unit, &usual(), thermistor).unwrap()), none, "{unit}");
    }
    let counts = read_as("counts", &usual(), |volts| 65535.0 - (volts / 5.0 * 65535.0).round()).unwrap();
    assert_eq!(about_temperature(&counts), none);
    for (unit, change) in
        [("mV", (|volts| volts * 1000.0) as fn(f64) -> f64), ("1/K", |volts| (celsius(volts) + 273.15).recip())]
    {
        assert_eq!(about_temperature(&read_as(unit, &usual(), change).unwrap()), none, "{unit}");
    }
    // 1/100 degC, and a small c for counts.
    for unit in ["degC/100", "c"] {
        assert_eq!(
            about_temperature(&read_as(unit, &usual(), |volts| (celsius(volts) * 100.0).round()).unwrap()),
            none
        );
    }
}

#[test]
fn the_steps_of_a_thermistor_may_differ_by_orders_of_magnitude() {
    let wide = [-40.0, -30.0, -20.0, 0.0, 20.0, 40.0, 60.0, 70.0, 80.0];
    // A chamber that oscillates by a quarter of a step is within its set point.
    for (schedule, oscillation_c) in [(at((-5..=9).map(|k| 5.0 * f64::from(k))), 1.2), (at(wide), 0.3)] {
        let chain = Chain { oscillation_c, ..Chain::default() };
        let calibration = read_as("Ohm", &CampaignSchedule { chain, ..schedule }, thermistor).unwrap();
        // At the hot end steps are small, and no set point was missed.
        assert!(!about_temperature(&calibration).contains(&name::SET_POINT), "{:?}", calibration.findings);
    }
}

#[test]
fn temperature_may_have_few_digits() {
    let whole: fn(f64) -> f64 = |volts| celsius(volts).round();
    assert!(about_temperature(&read_as("degC", &usual(), whole).unwrap()).is_empty());
    for step in [0.5, 1.0, 2.0] {
        let schedule = at((0..7).map(|k| 20.0 + step * f64::from(k)));
        let calibration = read_as("degC", &schedule, whole).unwrap();
        let expected: &[_] = if step < 2.0 { &[name::TEMPERATURE_DRIFT] } else { &[] };
        assert_eq!(about_temperature(&calibration), expected, "{step}");
    }
    // A reading that is broken, and a sensor that is lost, are seen in whole degrees too.
    let truth = truth(1.0);
    let refused = |change: fn(usize, &mut SimulatedRow)| {
        let mut rows = rows(&truth, &usual());
        for (index, row) in rows.iter_mut().enumerate() {
            temperature(&mut row.raw, whole);
            change(index, row);
        }
        table_of("degC", &truth, &usual(), rows).unwrap_err()
    };
    let broken = refused(|index, row| row.raw.accelerometers.head_temperature[1] *= f64::from(u8::from(index != 5)));
    assert!(
        broken.starts_with("fault [temperature-drift]: 7: set point -20 degC, position 1: a2_head runs from"),
        "{broken}"
    );
    let lost = refused(|_, row| {
        row.raw.accelerometers.board_temperature[0] = row.raw.accelerometers.board_temperature[0].min(24.0);
    });
    assert!(lost.starts_with("fault [temperature-repeated]: ") && lost.contains("set point 30 degC"), "{lost}");
}

#[test]
fn a_head_may_be_in_an_oven() {
    let (truth, usual, mut random) = (truth(1.0), usual(), RandomGenerator::new(1, 1));
    for digit in [0.002, 0.1] {
        let mut rows = rows(&truth, &usual);
        for row in &mut rows {
            for head in &mut row.raw.accelerometers.head_temperature {
                *head = ((65.04 + 0.01 * random.normal()) / digit).round() * digit;
            }
        }
        let calibration = table_of("degC", &truth, &usual, rows).unwrap();
        assert_eq!(about_temperature(&calibration), [name::TEMPERATURE_OFFSET, name::TEMPERATURE_DRIFT], "{digit}");
        let one = calibration.findings.iter().find(|finding| finding.name == name::TEMPERATURE_DRIFT).unwrap();
        assert!(one.message.contains("(a1_head, a2_head, a3_head)") && one.message.contains("in an oven"), "{one}");
    }
    // Not a single digit moves: nothing shows that the sensor is connected.
    let mut rows = rows(&truth, &usual);
    rows.iter_mut().for_each(|row| row.raw.accelerometers.head_temperature[2] = 65.0);
    assert!(table_of("degC", &truth, &usual, rows).unwrap_err().contains("fault [temperature-constant]: a3_head"));
}

#[test]
fn rows_may_have_any_length_and_scale_factors_any_size() {
    // Of 3.003 s the last blocks are a few rows. With K of 200 pulse/(s*g0) such a row has no pulse, or one.
    for (interval_ns, dwell_s, factor) in [
        (300_000_000_000, 300.0, 1.0),
        (300_000_000_000, 300.0, 0.01),
        (100_000_000_000, 300.0, 10.0),
        (1_000_000, 3.003, 1.0),
        (1_000_000, 3.003, 0.01),
        (1_000_000, 3.003, 0.002),
        (2_500_000, 5.0, 0.01),
    ] {
        let (truth, schedule) = (truth(factor), at([-20.0, 10.0, 40.0]));
        let schedule = CampaignSchedule { interval_ns, dwell_s, ..schedule };
        let calibration = table_of("V", &truth, &schedule, rows(&truth, &schedule)).unwrap();
        let moved = calibration.findings.iter().find(|finding| finding.name == name::NOT_STILL);
        assert_eq!(moved, None, "{interval_ns} ns, factor {factor}");
    }
}

#[test]
fn a_good_converter_is_not_full() {
    // A good converter, of an accelerometer without noise whose K does not depend on the temperature, is not full.
    let mut alike = 0;
    for trial in 0..6 {
        let mut content = truth(0.03).table.content().clone();
        for axis in &mut content.axes {
            let flat = |p: &Polynomial| {
                let constant = p.coefficients()[0] + 0.003 * f64::from(trial);
                Polynomial::new(&[constant], p.center(), p.scale(), p.range()).unwrap()
            };
            axis.bias = flat(&axis.bias);
            axis.positive_scale_factor = flat(&axis.positive_scale_factor);
            axis.negative_scale_factor = flat(&axis.negative_scale_factor);
        }
        let flat = Truth::new(content, MISALIGNMENT, TILT_RAD, 9.8015).unwrap();
        let noise = Noise { temperature: 1e-4, ..Noise::NONE };
        let schedule = CampaignSchedule { interval_ns: 60_000_000_000, dwell_s: 180.0, noise, ..usual() };
        let calibration = table_of("V", &flat, &schedule, rows(&flat, &schedule)).unwrap();
        alike += calibration.findings.iter().filter(|finding| finding.name == name::SATURATED).count();
    }
    assert!(alike > 0, "no two dwells are alike");
}

#[test]
fn positions_and_set_points_may_have_any_order() {
    let (truth, usual) = (truth(1.0), usual());
    let mut reversed = usual.clone();
    reversed.positions.reverse();
    table_of("V", &truth, &usual, rows(&truth, &reversed)).unwrap();
    // Twice, in a row too, and the last visit of a third of the positions.
    let repeated = at([-20.0, 0.0, 20.0, 40.0, 20.0, 20.0, -20.0, 20.0]);
    let mut all = rows(&truth, &repeated);
    table_of("V", &truth, &repeated, all.clone()).unwrap();
    all.truncate(all.len() - 30 * 8);
    table_of("V", &truth, &repeated, all).unwrap();
    // One position after the other, through all temperatures.
    let mut all = rows(&truth, &usual);
    all.sort_by_key(|row| (row.position, row.raw.timestamp_ns));
    let (mut time_ns, mut before) = (0, None);
    for (row, sequence) in all.iter_mut().zip(0..) {
        let here = Some((row.set_point_c, row.position));
        time_ns += row.raw.interval_ns + if before == here { 0 } else { 4_000_000_000_000 };
        (row.raw.timestamp_ns, row.raw.telemetry_ns, row.raw.sequence, before) = (time_ns, 0, sequence, here);
    }
    table_of("V", &truth, &usual, all).unwrap();
    // Rows were left out in the middle of each dwell.
    let mut all = rows(&truth, &usual);
    all.retain(|row| !(10..=20).contains(&(row.raw.sequence % 30)));
    table_of("V", &truth, &usual, all).unwrap();
}

#[test]
fn clocks_may_begin_anywhere() {
    let (truth, usual) = (truth(1.0), usual());
    for begin_ns in [1 << 63, u64::MAX - 90_000_000_000_000, 1_700_000_000_000_000_000] {
        let mut all = rows(&truth, &usual);
        for SimulatedRow { raw, .. } in &mut all {
            raw.timestamp_ns += begin_ns;
            raw.telemetry_ns += begin_ns;
        }
        table_of("V", &truth, &usual, all).unwrap();
    }
}

#[test]
fn bias_misalignment_and_temperature_coefficients_may_be_large() {
    for (bias_ug0, per_unit) in [(3e5, 0.0), (-2e5, 3000.0), (0.0, 6000.0)] {
        let mut content = paper().content().clone();
        for axis in &mut content.axes {
            axis.max_rate = None;
            let more = |p: &Polynomial, constant: f64, slope: f64| {
                let mut coefficients = p.coefficients().to_vec();
                coefficients[0] += constant;
                coefficients[1] += slope;
                Polynomial::new(&coefficients, p.center(), p.scale(), p.range()).unwrap()
            };
            axis.bias = more(&axis.bias, bias_ug0, 0.0);
            axis.positive_scale_factor = more(&axis.positive_scale_factor, 0.0, per_unit);
            axis.negative_scale_factor = more(&axis.negative_scale_factor, 0.0, -per_unit);
        }
        let misalignment = Matrix3::new(1.0, 0.03, -0.04, 0.02, 1.0, 0.05, -0.03, 0.04, 1.0);
        let truth = Truth::new(content, misalignment, TILT_RAD, 9.8015).unwrap();
        for every in [1, 2] {
            for angles in [true, false] {
                let mut schedule = usual();
                schedule.positions = schedule.positions.into_iter().step_by(every).collect();
                if !angles {
                    schedule.positions.iter_mut().for_each(|position| position.angles = None);
                }
                table_of("V", &truth, &schedule, rows(&truth, &schedule)).unwrap();
            }
        }
    }
}
