//! The recordings in tests/data/any_lab: one simulated with its truth, the others real.

use super::common::{calibrated, campaign, json, messages, recording, samples};
use isotherm_campaign::find_static_poses;
use isotherm_fit::{ScaleFactorChoice, TumbleCalibration, TumbleOptions, calibrate_tumble};
use isotherm_shared::compensate::answer;
use nalgebra::Vector3;
use serde_json::Value;

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// The values of a constant curve of each axis.
fn constants(found: &TumbleCalibration, quantity: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| found.curves[axis][quantity].at(found.mid(axis, quantity)))
}

#[test]
fn tumble3_is_calibrated_over_its_range() {
    let truth = json("tumble3/truth.json");
    let gravity = ["gravity_local", "gravity_reference"].map(|key| number(&truth[key]));
    let found = calibrate_tumble(
        &campaign(gravity),
        &[recording(&samples("tumble3/recording.csv"))],
        &TumbleOptions::default(),
    )
    .unwrap();
    assert_eq!((found.readings.len(), found.too_short, found.groups.levels), (78, 0, 3));
    assert!(found.unknowns.order == 1 && found.unknowns.split && messages(&found).is_empty(), "{:?}", messages(&found));
    let reached = json("tumble3/reference_reached.json");
    let dilution = found.dilution.times_root_n / 78_f64.sqrt();
    assert!((dilution / number(&reached["dil"]) - 1.0).abs() < 0.02, "{dilution}");
    let (mut worst_bias, mut worst_scale_factor) = (0.0_f64, 0.0_f64);
    for (axis, name) in ["A1", "A2", "A3"].into_iter().enumerate() {
        let axis_truth = &truth["axes"][name];
        for (quantity, key) in ["bias_g0_triangular", "kp_triangular", "kn_triangular"].into_iter().enumerate() {
            let c: Vec<f64> = axis_truth[key].as_array().unwrap().iter().map(number).collect();
            for temperature in [-10.0, 7.5, 25.0, 42.5, 60.0] {
                let x = (temperature - 25.0) / 40.0;
                let right = c[0] + c[1] * x + c[2] * x * x;
                let off = found.curves[axis][quantity].at(temperature) - right;
                if quantity == 0 {
                    worst_bias = worst_bias.max(off.abs());
                } else {
                    worst_scale_factor = worst_scale_factor.max((off / right).abs());
                }
            }
        }
    }
    let m = |i: usize, j: usize| (found.misalignment[(i, j)] - number(&truth["M_triangular"][i][j])).abs();
    assert!(worst_bias < 16e-6 && worst_scale_factor < 25e-6, "{worst_bias} {worst_scale_factor}");
    assert!(m(0, 1).max(m(0, 2)).max(m(1, 2)) < 6e-6, "{} {} {}", m(0, 1), m(0, 2), m(1, 2));
}

#[test]
fn xsens_agrees_with_its_certificate_and_the_reference() {
    let expected = json("xsens/expected.json");
    let rows = samples("xsens/recording.csv");
    let found = calibrated(&rows, |options| options.temperature_range = Some([0.0, 50.0])).unwrap();
    let reference = &expected["single_K"];
    assert_eq!(found.readings.len(), 40);
    assert!(!found.unknowns.split, "{:?}", found.reasons);
    assert!(found.residual_rms() < 0.11e-3, "{}", found.residual_rms());
    for axis in 0..3 {
        // Rows of 0.04 s have four readings of counts: K is 100 times counts/g0.
        let scale_factor = constants(&found, 1)[axis] / 100.0 / 9.81;
        let right = number(&reference["scale_factor_counts_per_m_s2"][axis]);
        assert!((scale_factor - right).abs() < 0.01, "{scale_factor} {right}");
        let certificate = number(&expected["certificate"]["scale_factor_counts_per_m_s2"][axis]);
        assert!((scale_factor / certificate - 1.0).abs() < 2e-3, "{scale_factor} {certificate}");
        let bias = constants(&found, 0)[axis] - number(&reference["bias_g0"][axis]);
        assert!(bias.abs() < number(&reference["bias_standard_error_g0"][axis]), "{bias}");
    }
    // Along A2 and A1 the sensitivity is longer than K: M has 1 on the diagonal, not rows of length 1.
    let row = found.misalignment.row(0).norm();
    assert!((row - 1.0).abs() > 2e-5, "{row}");
    let split = calibrated(&rows, |options| {
        options.temperature_range = Some([0.0, 50.0]);
        options.scale_factor = ScaleFactorChoice::Split;
    });
    let split = split.unwrap();
    for axis in 0..3 {
        let ratio = (-constants(&split, 1)[axis] / constants(&split, 2)[axis] - 1.0) * 1e6;
        let right = number(&expected["split"]["Kplus_over_Kminus_minus_1_ppm"][axis]);
        assert!((ratio - right).abs() < 200.0, "{ratio} {right}");
    }
}

#[test]
fn each_of_five_mpu9150_is_calibrated() {
    let expected = json("five_mpu9150/expected.json");
    for unit in 0..5 {
        let rows = samples(&format!("five_mpu9150/imu{unit}.csv"));
        let found = calibrated(&rows, |options| options.temperature_range = Some([15.0, 35.0])).unwrap();
        let reference = &expected[format!("imu{unit}")];
        let count = found.readings.len();
        assert_eq!(count, [22, 22, 24, 23, 22][unit], "imu{unit}");
        // Movement in the first 30 s is no obstacle. The reference has, of the degrees of freedom, 217 to 321e-6 g0.
        let evidence = found.evidence.as_ref().unwrap();
        let right = [217e-6, 262e-6, 222e-6, 196e-6, 321e-6][unit];
        assert!((evidence.within / right - 1.0).abs() < 0.02, "imu{unit}: {}", evidence.within);
        // Attitudes that the reference splits, or leaves out, are found here.
        let dilution = found.dilution.times_root_n;
        assert!((dilution / number(&reference["dilution_sqrt_n"]) - 1.0).abs() < 0.15, "imu{unit}: {dilution}");
        for axis in 0..3 {
            let bias = constants(&found, 0)[axis] - number(&reference["bias_g0"][axis]);
            assert!(
                bias.abs() < 2.0 * number(&reference["bias_standard_error_g0"][axis]),
                "imu{unit} A{}: {bias}",
                axis + 1
            );
            // 1e-4 m/s2 a count, rows of 0.05 s.
            let scale_factor = constants(&found, 1)[axis] * 0.05 / 98_100.0;
            let off = scale_factor - number(&reference["scale_factor_relative"][axis]);
            let error = number(&reference["scale_factor_standard_error_ppm"][axis]) * 1e-6;
            assert!(off.abs() < 2.0 * error, "imu{unit} A{}: {off} {error}", axis + 1);
        }
    }
}

#[test]
fn six_faces_are_refused_by_name_and_give_no_errors_without_misalignments() {
    let rows = samples("ferraris/recording.csv");
    let range = Some([0.0, 50.0]);
    let refused = calibrated(&rows, |options| options.temperature_range = range).unwrap_err().to_string();
    assert!(refused.contains("6 static poses for 9 unknowns") && refused.contains(": m12, m13, m23;"), "{refused}");
    let found = calibrated(&rows, |options| {
        options.temperature_range = range;
        options.misalignment = false;
    });
    let found = found.unwrap();
    let expected = &json("ferraris/expected.json")["without_misalignment"];
    assert!((found.dilution.times_root_n - number(&expected["dilution_sqrt_n"])).abs() < 1e-3);
    assert!(found.freedom == 0 && found.misalignment_error.is_none() && found.table.content().alignment.is_none());
    assert!(found.curves.iter().flatten().all(|curve| curve.standard_error(25.0).is_none()));
    assert!(messages(&found).iter().any(|warning| warning.contains("no standard errors")), "{:?}", messages(&found));
    for axis in 0..3 {
        let scale_factor = constants(&found, 1)[axis] / (constants(&found, 1)[0]);
        let right = number(&expected["scale_factor_counts_per_m_s2"][axis]);
        assert!((scale_factor * number(&expected["scale_factor_counts_per_m_s2"][0]) / right - 1.0).abs() < 5e-4);
    }
}

#[test]
fn the_table_gives_the_residuals_of_the_fit() {
    let rows = samples("xsens/recording.csv");
    let found = calibrated(&rows, |options| options.temperature_range = Some([0.0, 50.0])).unwrap();
    let poses = find_static_poses(&rows, None).unwrap();
    assert!(!poses.glitches.is_empty());
    for (reading, residual) in found.readings.iter().zip(&found.residuals) {
        let mut sum = Vector3::zeros();
        for row in poses.rows(&rows, reading.rows.clone()) {
            sum += Vector3::from(answer(Some(&found.table), row).velocity_increment);
        }
        let length = sum.norm() / reading.seconds / 9.81;
        assert!((length - 1.0 - residual).abs() < 1e-11, "{} {residual}", length - 1.0);
    }
}
