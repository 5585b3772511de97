//! The campaign with a known truth and an independent fit, see `tests/data/gyro/README.md`.

use isotherm_campaign::Campaign;
use isotherm_fit::{
    Accuracy, AlignmentChoice, Calibration, CalibrationOptions, GyroscopeCalibration, Method, calibrate,
    read_measurements,
};
use isotherm_recording::CampaignCsvReader;
use isotherm_shared::compensate::answer;
use isotherm_shared::table::{CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::units::ARCSEC;
use serde_json::Value;
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gyro");

pub(crate) fn text(name: &str) -> String {
    fs::read_to_string(format!("{DATA}/{name}")).unwrap()
}

fn json(name: &str) -> Value {
    serde_json::from_str(&text(name)).unwrap()
}

fn calibrated(options: CalibrationOptions) -> Calibration {
    let campaign = Campaign::from_toml(&text("campaign.toml")).unwrap();
    let samples = text("samples.csv");
    let rows = CampaignCsvReader::new(samples.as_bytes()).unwrap();
    let measurements = read_measurements(&campaign, rows).unwrap();
    calibrate(&campaign, measurements, options).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Largest differences: D \[deg/h\], K \[ppm\], s \[deg/h/g0\], M \[rad\].
fn against_truth(found: &GyroscopeCalibration) -> [f64; 4] {
    let truth = json("truth.json");
    let mut worst = [0.0_f64; 4];
    for (axis, name) in GYROSCOPE_NAMES.into_iter().enumerate() {
        let (part, right) = (&found.solution.gyroscopes[axis], &truth["gyroscopes"][name]);
        for (q, (key, curve)) in ["bias", "kp", "kn"].into_iter().zip(&part.curves).enumerate() {
            let [low, high] = curve.range();
            for step in 0..=64 {
                let u = low + (high - low) * f64::from(step) / 64.0;
                let right = polynomial(&numbers(&right[key]), u);
                let error = (curve.at(u) - right).abs();
                let (place, error) = if q == 0 { (0, error) } else { (1, error / right.abs() * 1e6) };
                worst[place] = worst[place].max(error);
            }
        }
        for (got, right) in part.g_sensitivity.into_iter().zip(numbers(&right["g_sensitivity"])) {
            worst[2] = worst[2].max((got - right).abs());
        }
        for j in 0..3 {
            let right = truth["gyroscope_misalignment"][axis][j].as_f64().unwrap();
            worst[3] = worst[3].max((found.misalignment()[(axis, j)] - right).abs());
        }
    }
    worst
}

fn against_reference(found: &GyroscopeCalibration) -> [f64; 4] {
    let reference = json("reference.json");
    let mut worst = [0.0_f64; 4];
    for (axis, name) in GYROSCOPE_NAMES.into_iter().enumerate() {
        let (part, right) = (&found.solution.gyroscopes[axis], &reference["gyroscopes"][name]);
        let keys = [("head", "bias_deg_h"), ("board", "positive_scale_factor"), ("board", "negative_scale_factor")];
        for (q, ((temperature, key), curve)) in keys.into_iter().zip(&part.curves).enumerate() {
            for (u, right) in numbers(&right[temperature]).into_iter().zip(numbers(&right[key])) {
                let error = (curve.at(u) - right).abs();
                let (place, error) = if q == 0 { (0, error) } else { (1, error / right.abs() * 1e6) };
                worst[place] = worst[place].max(error);
            }
        }
        for (got, right) in part.g_sensitivity.into_iter().zip(numbers(&right["g_sensitivity_deg_h_g0"])) {
            worst[2] = worst[2].max((got - right).abs());
        }
        // In the order of the columns, without the diagonal.
        let columns = (0..3).filter(|column| *column != axis);
        for (column, right) in columns.zip(numbers(&right["misalignment_rad"])) {
            worst[3] = worst[3].max((found.misalignment()[(axis, column)] - right).abs());
        }
    }
    worst
}

fn all_below(found: [f64; 4], limits: [f64; 4]) -> bool {
    found.iter().zip(limits).all(|(found, limit)| *found < limit)
}

#[test]
fn the_campaign_with_a_known_truth_and_an_independent_fit() {
    for method in [Method::OneStage, Method::TwoStage] {
        let calibration = calibrated(CalibrationOptions { method, ..CalibrationOptions::default() });
        let found = calibration.gyroscopes.as_ref().unwrap();
        let (truth, reference) = (against_truth(found), against_reference(found));
        println!("{}: truth {truth:?}, reference {reference:?}", method.name());
        println!("{}\n{}", Accuracy::of(&calibration), Accuracy::of_gyroscopes(&calibration).unwrap());
        assert!(all_below(truth, [0.013, 4.0, 0.006, 7e-7]), "{truth:?}");
        if method == Method::OneStage {
            assert!(all_below(reference, [0.0005, 0.05, 0.0002, 2e-8]), "{reference:?}");
        } else {
            assert!(all_below(reference, [0.002, 1.0, 0.003, 1e-7]), "{reference:?}");
        }
        for tables in &found.orders {
            assert!(tables.iter().all(|table| table.choice.order == 3));
            assert!(tables.iter().all(|table| table.regression.fits()[3].leave_one_out_rms.is_some()));
        }
        let [x, y] = found.solution.earth.unwrap();
        let right = numbers(&json("truth.json")["earth_in_base_deg_h"]);
        assert!((x - right[0]).abs() < 0.003 && (y - right[1]).abs() < 0.003, "{x} {y}");
        assert!((found.earth.unwrap().along_z - right[2]).abs() < 1e-5);
        // The random walk that the data were made with: 0.003, 0.003, 0.004 deg/sqrt(h), and a little for the pulses.
        for (axis, right) in [0.003, 0.003, 0.004].into_iter().enumerate() {
            assert!((found.random_walk(axis) / right - 1.0).abs() < 0.1, "{}", found.random_walk(axis));
        }
        assert_eq!(calibration.findings, []);
        assert_eq!((found.runs.len(), found.outliers.len()), (15 * 18, 0));
    }
}

#[test]
fn the_accelerometers_of_the_same_campaign_are_as_before() {
    let calibration = calibrated(CalibrationOptions::default());
    let truth = json("truth.json");
    let mut worst = [0.0_f64; 2];
    for (name, part) in ["A1", "A2", "A3"].into_iter().zip(&calibration.solution.axes) {
        for (q, (key, curve)) in ["bias", "kp", "kn"].into_iter().zip(&part.curves).enumerate() {
            let [low, high] = curve.range();
            for step in 0..=64 {
                let u = low + (high - low) * f64::from(step) / 64.0;
                let right = polynomial(&numbers(&truth["truth"][name][key]), u);
                let error = if q == 0 { curve.at(u) * 1e6 - right } else { (curve.at(u) / right - 1.0) * 1e6 };
                worst[q.min(1)] = worst[q.min(1)].max(error.abs());
            }
        }
    }
    println!("accelerometers: {worst:?}");
    assert!(worst[0] < 0.35 && worst[1] < 0.7, "{worst:?}");
    // The turns change nothing in them: the same without turns.
    let file = text("campaign.toml");
    let file = &file[..file.find("[[turn]]").unwrap()].replace("latitude_deg = 39.9 ", "# ");
    let campaign = Campaign::from_toml(file).unwrap();
    let samples = text("samples.csv");
    let only_dwells: String = samples
        .lines()
        .filter(|line| line.split(',').nth(1).unwrap().parse().map_or(true, |number: u32| number <= 12))
        .map(|line| format!("{line}\n"))
        .collect();
    let rows = CampaignCsvReader::new(only_dwells.as_bytes()).unwrap();
    let dwells = isotherm_campaign::read_dwells(&campaign, rows).unwrap();
    let alone = isotherm_fit::calibrate_accelerometers(&campaign, dwells, CalibrationOptions::default()).unwrap();
    assert_eq!(alone.table.content().axes, calibration.table.content().axes);
    assert_eq!(alone.table.content().alignment, calibration.table.content().alignment);
}

#[test]
fn the_table_has_both_triads_and_both_alignments_or_neither() {
    for (choice, aligned) in
        [(AlignmentChoice::IfNeeded, true), (AlignmentChoice::With, true), (AlignmentChoice::Without, false)]
    {
        let calibration = calibrated(CalibrationOptions { alignment: choice, ..CalibrationOptions::default() });
        let content = calibration.table.content();
        let gyroscopes = content.gyroscopes.as_ref().unwrap();
        assert_eq!(
            (content.format, content.alignment.is_some(), gyroscopes.alignment.is_some()),
            (2, aligned, aligned)
        );
        let text = calibration.table.to_toml();
        assert_eq!(CoefficientTable::from_toml(&text, None).unwrap(), calibration.table);
    }
    // Through the kernel, a whole turn gives its angle: about its axis 360 deg, across it what Earth's rate gives.
    let calibration = calibrated(CalibrationOptions::default());
    let samples = text("samples.csv");
    let rows = CampaignCsvReader::new(samples.as_bytes()).unwrap().map(Result::unwrap);
    let (mut angle, mut seconds) = ([0.0; 3], 0.0);
    for row in rows.filter(|row| (row.set_point_c, row.position) == (20.0, Some(17))) {
        // In motion the velocity increments of a still table's g-sensitivity are right too: gravity is along the axis.
        let out = answer(Some(&calibration.table), &row.sample).angle_increment;
        (0..3).for_each(|axis| angle[axis] += out[axis] / ARCSEC);
        seconds += row.sample.interval_ns as f64 / 1e9;
    }
    let earth = calibration.gyroscopes.as_ref().unwrap().earth.unwrap().along_z * seconds;
    println!("turn 17: {angle:?} arcsec in {seconds} s, {earth} of Earth's rate");
    // 1.2 arcsec of random walk, a pulse, and what the table repeats to.
    assert!((angle[2] - 1_296_000.0 - earth).abs() < 5.0, "{angle:?}");
    // Ic is 11 s, and Earth's horizontal rate 11.5 deg/h.
    assert!(libm::hypot(angle[0], angle[1]) < 1.3 * 11.0 * 11.5 + 5.0, "{angle:?}");
}
