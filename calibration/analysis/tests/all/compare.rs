//! Comparison of tables: figures that a program without shared code has computed (`expected.json`), error rates, and
//! what cannot be compared.

use isotherm_analysis::{Comparison, ComparisonRequirement, Compliance, Convention, YEAR_S, compare};
use isotherm_fit::{CurveErrors, Origin, TableFile};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, Gyroscopes, Nominal, nominal_table};
use isotherm_shared::units::BiasUnit;
use isotherm_simulation::RandomGenerator;
use nalgebra::{DMatrix, DVector, Matrix3};
use serde_json::Value;
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fit/tests/data/any_lab/compare");

fn text(name: &str) -> String {
    fs::read_to_string(format!("{DATA}/{name}.toml")).unwrap()
}

fn table(name: &str) -> TableFile {
    TableFile::from_toml(format!("{name}.toml"), &text(name)).unwrap()
}

fn compared(names: &[&str]) -> Comparison {
    compare(names.iter().map(|name| table(name)).collect(), false).unwrap()
}

fn expected() -> Value {
    serde_json::from_str(&fs::read_to_string(format!("{DATA}/expected.json")).unwrap()).unwrap()
}

/// Asserts that a figure is the expected one to its six printed digits, or to 1e-6 where all that is left is rounding.
fn assert_figure(what: &str, found: f64, expected: &Value) {
    let expected = expected.as_f64().unwrap();
    assert!((found - expected).abs() <= 6e-6 * expected.abs() + 1e-8, "{what}: {found}, expected {expected}");
}

#[test]
fn the_figures_are_those_of_an_independent_program() {
    let mut curves = 0;
    for (case, expected) in expected().as_object().unwrap() {
        let (names, require) = case.split_once(" --require ").unwrap_or((case, ""));
        let names: Vec<_> = names.split(' ').collect();
        let tables: Vec<_> = names.iter().map(|name| table(name)).collect();
        if let Some(refused) = expected.get("refused") {
            let error = compare(tables, false).unwrap_err();
            let reasons = refused.as_array().unwrap();
            assert_eq!(error.0.len(), reasons.len());
            for (reason, expected) in error.0.iter().zip(reasons) {
                assert!(reason.starts_with(expected.as_str().unwrap()), "{case}: {reason}");
            }
            let exit = isotherm_support::failure::Failure::from(error).exit as u8;
            assert_eq!(Value::from(exit), expected["exit"]);
            continue;
        }
        let found = compare(tables, false).unwrap();
        if names.len() > 2 {
            for trend in &found.trends {
                let (name, expected) = (trend.name(), &expected[trend.name()]);
                assert_eq!(expected["unit"], format!("{}/year", trend.unit));
                assert_figure(&name, trend.slope, &expected["slope"]);
                assert_figure(&name, trend.slope_error, &expected["se"]);
                assert_figure(&name, trend.p.unwrap(), &expected["p"]);
                assert_figure(&name, trend.chi2.unwrap(), &expected["chi2"]);
                assert_eq!(expected["dof"], trend.freedom);
            }
            assert_eq!(found.trends.len(), expected.as_object().unwrap().len());
            continue;
        }
        let require: ComparisonRequirement = require.parse().unwrap();
        assert_eq!(found.convention.name(), expected["convention"]);
        assert_eq!(found.verdict(&require).unwrap().name(), expected["verdict"], "{case}");
        assert_eq!(found.check(&require).is_ok(), expected["exit"] == 0);
        for (curve, judgement) in found.curves.iter().zip(found.judge(&require)) {
            let (what, expected) = (format!("{case} {}", curve.name()), &expected["curves"][curve.name()]);
            let (largest, at) = curve.largest();
            assert_eq!(curve.unit, expected["unit"]);
            assert_eq!(Value::from(curve.range.to_vec()), expected["range"]);
            assert_figure(&what, curve.mean(), &expected["mean"]);
            assert_figure(&what, largest, &expected["max_abs"]);
            if largest > 1e-6 {
                assert_figure(&what, at, &expected["at"]);
            }
            assert_eq!(
                (&judgement.name, judgement.verdict.name()),
                (&curve.name(), expected["verdict"].as_str().unwrap())
            );
            assert_eq!(curve.band.is_some(), expected.get("se").is_some(), "{what}");
            if let Some(band) = &curve.band {
                assert_figure(&what, curve.standard_error().unwrap(), &expected["se"]);
                assert_figure(&what, band.freedom, &expected["degrees_of_freedom"]);
                assert_figure(&what, band.factor, &expected["band_factor"]);
                assert_figure(&what, curve.worst_ratio().unwrap(), &expected["worst_ratio"]);
                assert_eq!(curve.is_changed(), expected["changed"].as_bool());
                assert_figure(&what, curve.upper().unwrap(), &expected["upper"]);
                assert_figure(&what, curve.lower().unwrap(), &expected["lower"]);
            }
            curves += 1;
        }
        for (found, expected) in
            found.alignments[0].difference_urad.iter().zip(expected["alignment_urad"].as_array().unwrap())
        {
            for (found, expected) in found.iter().zip(expected.as_array().unwrap()) {
                assert_figure(case, *found, expected);
            }
        }
    }
    assert_eq!(curves, 45);
}

#[test]
fn other_units_gravity_and_powers_are_the_same_curves() {
    let same = compared(&["2023", "same_other_form"]);
    assert_eq!(same.conclusion(), "Nothing has changed by more than the errors.");
    let content = |name: &str| table(name).table.content().clone();
    let [a, b] = ["2023", "same_other_form"].map(content);
    assert!(a.gravity != b.gravity && a.axes[0].bias_unit != b.axes[0].bias_unit && b.axes[0].bias.center() != 0.0);
    // Six misalignments and three are the same table, both ways, also in a line over the dates.
    for names in [["full_alignment", "triangular_alignment"], ["triangular_alignment", "full_alignment"]] {
        let found = compared(&names);
        assert_eq!(found.convention, Convention::Triangular);
        assert!(found.notes[0].contains("others six. They are compared with three"), "{:?}", found.notes);
        assert!(found.curves.iter().all(|curve| curve.largest().0 < 1e-8), "{found:?}");
        assert!(found.alignments[0].largest_urad() < 1e-6);
    }
    // The difference that the convention makes of the tables' numbers: K of A3 500 ppm.
    let [full, triangular] = ["full_alignment", "triangular_alignment"].map(content);
    let k = |content: &isotherm_shared::table::Content| content.axes[2].positive_scale_factor.at(2.5);
    assert!((k(&triangular) / k(&full) - 1.000_499_88).abs() < 1e-8);
    // Of one convention, nothing is converted.
    assert_eq!(compared(&["full_alignment", "full_alignment"]).convention, Convention::AsWritten);
}

#[test]
fn scale_factors_of_different_intervals_are_not_compared() {
    let with = |nominal_interval_s| {
        let file = table("2023");
        let mut content = file.table.content().clone();
        content.nominal_interval_s = nominal_interval_s;
        content.format = content.least_format();
        TableFile { table: CoefficientTable::new(content).unwrap(), ..file }
    };
    let refused = compare(vec![with(Some(0.0025)), with(Some(0.005))], false).unwrap_err();
    assert_eq!(
        refused.0,
        ["scale factors of 0.0025 s and of 0.005 s (nominal_interval_s); give tables of one interval"]
    );
    for other in [Some(0.00252), None] {
        compare(vec![with(Some(0.0025)), with(other)], false).unwrap();
    }
}

/// As the service compares them: as what a pulse stands for, over the range of the calibration.
#[test]
fn a_nominal_table_is_compared_with_the_first_calibration_whatever_its_interval_and_range_are() {
    let nominal = |interval_ns, range| {
        nominal_table(&Nominal::new("imu-a".parse().unwrap(), interval_ns, range)).unwrap().to_toml()
    };
    let file = |name: &str, text: &str| TableFile::from_toml(name, text).unwrap();
    let calibrated = |interval_ns, range| nominal(interval_ns, range) + "\n[provenance]\ntool = \"by hand\"\n";
    let old = nominal(10_000_000, [-40.0, 20.0]);
    let tables = || vec![file("old.toml", &old), file("new.toml", &calibrated(5_000_000, [25.0, 55.0]))];
    let comparison = compare(tables(), false).unwrap();
    assert_eq!(comparison.curves.len(), 18);
    for curve in &comparison.curves {
        assert_eq!((curve.range, curve.largest().0 < 1e-6), ([25.0, 55.0], true), "{}", curve.name());
    }
    // The scale factors of 10 ms with the interval of 5 ms are half of it.
    let wrong = calibrated(10_000_000, [25.0, 55.0]).replace("nominal_interval_s = 0.01", "nominal_interval_s = 0.005");
    let wrong = wrong.lines().filter(|line| !line.starts_with("digest")).collect::<Vec<_>>().join("\n");
    let comparison = compare(vec![file("old.toml", &old), file("wrong.toml", &wrong)], false).unwrap();
    assert!((comparison.curves[1].largest().0 - 500_000.0).abs() < 1e-3, "{:?}", comparison.curves[1]);
    // There is no such way back, nor between two nominal tables.
    let back = tables().into_iter().rev().collect();
    assert!(compare(back, false).unwrap_err().0[0].contains("nominal_interval_s"));
    let other = nominal(5_000_000, [-40.0, 20.0]);
    let refused = compare(vec![file("old.toml", &old), file("other.toml", &other)], false).unwrap_err();
    assert!(refused.0[0].contains("nominal_interval_s"));
}

/// The table with gyroscopes whose curves are those of 2023's accelerometers in deg/h, with these errors of both
/// triads' misalignments \[rad\].
fn with_gyroscopes(file: TableFile, alignment: Option<Matrix3<f64>>, errors: [f64; 2]) -> TableFile {
    let (mut content, mut origin) = (file.table.content().clone(), file.origin);
    let mut axes = table("2023").table.content().axes.clone();
    for axis in &mut axes {
        axis.bias_unit = BiasUnit::DegreePerHour;
    }
    content.gyroscopes = Some(Gyroscopes { axes, g_sensitivity: [None; 3], alignment });
    content.format = content.least_format();
    for index in 0..3 {
        origin.curves[3 + index] = origin.curves[index].clone();
    }
    origin.misalignment_error = errors.map(|error| Some(Matrix3::from_fn(|i, j| if i == j { 0.0 } else { error })));
    TableFile { name: file.name, table: CoefficientTable::new(content).unwrap(), origin }
}

#[test]
fn gyroscopes_turn_with_the_axes_of_their_matrix() {
    let [full, triangular] = ["full_alignment", "triangular_alignment"].map(table);
    let matrix = |table: &TableFile| table.table.content().alignment.unwrap();
    // The rotation between the axes of both tables: M = R Q; the triangular table has R with a diagonal of 1, and the
    // diagonal in its K.
    let k = |table: &TableFile, i: usize| table.table.content().axes[i].positive_scale_factor.at(2.5);
    let d = Matrix3::from_diagonal(&[0, 1, 2].map(|i| k(&triangular, i) / k(&full, i)).into());
    let q = matrix(&triangular) * d.try_inverse().unwrap() * matrix(&full).try_inverse().unwrap();
    let pair = |gyroscopes: [Option<Matrix3<f64>>; 2]| {
        let tables = [full.clone(), triangular.clone()].into_iter().zip(gyroscopes);
        let tables = tables.map(|(table, matrix)| with_gyroscopes(table, matrix, [3e-6, 4e-6]));
        compare(tables.collect(), false).unwrap()
    };
    // Without a matrix they stay along their input axes.
    let found = pair([None; 2]);
    assert_eq!((found.convention, found.alignments[1].largest_urad()), (Convention::Triangular, 0.0));
    assert_eq!(found.changed(), [""; 0]);
    // With one, the angles of the rotation have the errors of the accelerometers' misalignments: 5e-6 rad with those of
    // the gyroscopes.
    let own = Matrix3::new(1.0, 1e-3, 0.0, 0.0, 1.0, -2e-3, 1e-3, 0.0, 1.0);
    let found = pair([Some(own), Some(q * own)]);
    assert_eq!(found.changed(), [""; 0]);
    assert!(found.alignments[1].largest_urad() < 0.01, "{:?}", found.alignments[1]);
    let half = |found: &Comparison| found.alignments[1].half_width_urad.unwrap()[0][1];
    let same = compare(vec![with_gyroscopes(triangular.clone(), Some(own), [3e-6, 4e-6]); 2], false).unwrap();
    // Welch's degrees of freedom of 25 and 16 are a few less than those of 16 and 16.
    let ratio = half(&found) / half(&same);
    assert!((ratio - f64::sqrt(41.0 / 32.0)).abs() < 0.01, "{ratio}");
}

#[test]
fn misalignments_without_errors_are_not_known() {
    let found = compared(&["triangular_alignment", "triangular_alignment"]);
    assert!(found.curves.iter().all(|curve| curve.band.is_some()) && !found.has_errors());
    assert_eq!(found.conclusion(), "Whether anything has changed by more than the errors is not known.");
    assert!(
        found.findings.iter().any(|finding| finding.message.starts_with(
            "The errors of the misalignments of the accelerometers are not known in both tables: only the values decide"
        )),
        "{:?}",
        found.findings
    );
    let file = table("triangular_alignment");
    let known = compare(vec![with_gyroscopes(file, None, [1e-6; 2]); 2], false).unwrap();
    assert_eq!(known.conclusion(), "Nothing has changed by more than the errors.");
    // Its 18 curves share the 5 % that 9 have without gyroscopes.
    let factor = |found: &Comparison| found.curves[0].band.as_ref().unwrap().factor;
    assert!(factor(&known) > 1.03 * factor(&found), "{} {}", factor(&known), factor(&found));
}

#[test]
fn what_cannot_be_compared_is_said() {
    let missing = compared(&["2023", "no_covariance"]);
    assert!(
        !missing.has_errors() && missing.findings[0].message.contains("only the values decide"),
        "{:?}",
        missing.findings
    );
    assert_eq!(missing.conclusion(), "Whether anything has changed by more than the errors is not known.");
    // Another IMU, if the user says so.
    assert!(compare(vec![table("2023"), table("other_imu")], true).is_ok());
    let both = compare(vec![table("celsius"), table("other_imu")], false).unwrap_err();
    assert_eq!(both.0.len(), 2, "{both}");
    assert!(both.to_string().starts_with("comparing tables: tables of two IMUs: imu-a, imu-b; give those of one"));
    assert!(compare(vec![table("2023")], false).unwrap_err().to_string().contains("fewer than two"));
    // No line without dates.
    let undated = |time: &str| {
        let text = text("2024").replace("\"2024-03-05T10:00:00Z\"", time);
        compare(vec![table("2023"), TableFile::from_toml("undated.toml", &text).unwrap(), table("2025")], false)
    };
    let reason = undated("\"spring\"").unwrap_err().to_string();
    assert!(
        reason.contains("undated.toml: its provenance has the time \"spring\"; a line over the dates needs"),
        "{reason}"
    );
    assert!(undated("1").unwrap_err().to_string().contains("undated.toml: its provenance has no time"));
    assert!(undated("2024-03-05T10:00:00Z").is_ok());
    let same = vec![table("2023"), table("2023"), table("2023")];
    assert!(compare(same, false).unwrap_err().to_string().contains("all tables have the same date"));
    // A covariance that cannot be right is as good as none: one row too few, one of another device, one that is no
    // covariance.
    for (from, to) in [
        ("degrees_of_freedom = 11", "degrees_of_freedom = 0"),
        ("degrees_of_freedom = 11", "degrees_of_freedom = 11\nunit = \"mg0\""),
        ("covariance = [[0.46", "covariance = [[1.0]] # [[0.46"),
        ("covariance = [[0.46", "covariance = [[-9.46"),
    ] {
        let broken = TableFile::from_toml("broken.toml", &text("2024").replacen(from, to, 1)).unwrap();
        let found = compare(vec![table("2023"), broken], false).unwrap();
        assert_eq!(found.curves[0].band, None, "{to}");
        assert!(
            found.curves[1].band.is_some() && found.findings[0].message.contains("covariances of A1 bias in both"),
            "{:?}",
            found.findings
        );
    }
}

#[test]
fn files_out_of_date_order_give_the_same_line() {
    let sorted = compared(&["2023", "2024", "2025", "2026"]);
    let mixed = compared(&["2025", "2026", "2023", "2024"]);
    assert_eq!(mixed.trends, sorted.trends);
    assert_eq!((mixed.old_table().name.as_str(), mixed.new_table().name.as_str()), ("2023.toml", "2026.toml"));
    assert_eq!(mixed.curves, sorted.curves);
    // Two are taken as they are given, which is said.
    let backwards = compared(&["2024", "2023"]);
    let messages: Vec<_> = backwards.findings.iter().map(ToString::to_string).collect();
    assert_eq!(messages, ["2023.toml is dated before 2024.toml: the new table is the older one."]);
    assert!((backwards.curves[0].mean() + compared(&["2023", "2024"]).curves[0].mean()).abs() < 1e-9);
}

/// Temperature of the set points of a simulated calibration.
fn set_points() -> Vec<f64> {
    (0..15).map(|i| 1.1 + 0.2 * f64::from(i)).collect()
}

/// A calibration of `truth` in which each curve is a regression of its own with 15 set points, so that every error is
/// known: 0.1 ug0 and 0.5 ppm. Its biases are off by `shift_ug0`.
fn simulated(truth: &CoefficientTable, random: &mut RandomGenerator, shift_ug0: f64, unix_s: f64) -> TableFile {
    let temperature = set_points();
    let design = DMatrix::from_fn(temperature.len(), 4, |i, k| ((temperature[i] - 2.5) / 1.4).powi(k as i32));
    let inverse = (design.transpose() * &design).try_inverse().unwrap();
    let (mut content, mut origin) = (truth.content().clone(), Origin { unix_s: Some(unix_s), ..Origin::default() });
    let gyroscopes = content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes);
    for (axis, errors) in content.axes.iter_mut().chain(gyroscopes).zip(&mut origin.curves) {
        let curves = [&mut axis.bias, &mut axis.positive_scale_factor, &mut axis.negative_scale_factor];
        for ((curve, error), (shift, sd)) in
            curves.into_iter().zip(errors).zip([(shift_ug0, 0.1), (0.0, 0.045), (0.0, 0.045)])
        {
            let y = DVector::from_iterator(15, temperature.iter().map(|u| curve.at(*u) + shift + sd * random.normal()));
            let coefficients = &inverse * design.transpose() * &y;
            let variance = (&y - &design * &coefficients).norm_squared() / 11.0;
            *curve = Polynomial::new(coefficients.as_slice(), 2.5, 1.4, [1.1, 3.9]).unwrap();
            *error = Some(CurveErrors { covariance: &inverse * variance, freedom: 11.0, measured: None, slope: None });
        }
    }
    TableFile { name: "simulated".to_owned(), table: CoefficientTable::new(content).unwrap(), origin }
}

#[test]
fn false_alarms_are_rare_and_changes_are_found() {
    let truth = table("2023");
    false_alarms(&truth.table, 9);
    false_alarms(&with_gyroscopes(truth, None, [0.0; 2]).table, 18);
}

fn false_alarms(truth: &CoefficientTable, curves: usize) {
    const COMPARISONS: u32 = 1000;
    let (mut alarms, mut found, mut random) = (0, 0, RandomGenerator::new(4, 0));
    for _ in 0..COMPARISONS {
        let mut pair = |shift: f64| {
            compare(vec![simulated(truth, &mut random, 0.0, 0.0), simulated(truth, &mut random, shift, 1.0)], false)
                .unwrap()
        };
        let same = pair(0.0);
        assert_eq!(same.curves.len(), curves);
        alarms += u32::from(!same.changed().is_empty());
        found += u32::from(pair(0.5).curves[0].is_changed().unwrap());
    }
    let percent = |count: u32| f64::from(count) * 100.0 / f64::from(COMPARISONS);
    println!(
        "{curves} curves: false alarms {} %, shifts of 5 standard deviations found {} %",
        percent(alarms),
        percent(found)
    );
    assert!(percent(alarms) <= 5.0 && alarms > 0, "{alarms}");
    assert!(percent(found) > 99.0, "{found}");
}

#[test]
fn a_drift_is_recovered_within_its_error() {
    let truth = table("2023").table;
    let mut random = RandomGenerator::new(9, 0);
    let (mut squares, mut count, mut false_drifts) = (0.0, 0.0, 0.0);
    for _ in 0..100 {
        let tables = (0..6).map(|year| simulated(&truth, &mut random, 4.0 * f64::from(year), f64::from(year) * YEAR_S));
        let found = compare(tables.collect(), false).unwrap();
        for trend in &found.trends {
            let slope = if trend.quantity == "bias" { 4.0 } else { 0.0 };
            squares += ((trend.slope - slope) / trend.slope_error).powi(2);
            count += 1.0;
            false_drifts += f64::from(u8::from(slope == 0.0 && trend.p.unwrap() < 0.05 / 9.0));
            assert!(slope == 0.0 || (trend.p.unwrap() < 1e-4 && (trend.slope - slope).abs() < 0.1), "{trend:?}");
        }
    }
    let rms = f64::sqrt(squares / count);
    println!("(slope - truth)/error: {rms:.3} rms; false drifts {} %", false_drifts * 100.0 / (count * 2.0 / 3.0));
    assert!((0.7..1.1).contains(&rms), "{rms}");
    assert!(false_drifts <= 0.01 * count, "{false_drifts}");
}

#[test]
fn verdicts_are_within_beyond_or_undecided() {
    let found = compared(&["2023", "2024"]);
    let verdict = |text: &str| found.verdict(&text.parse().unwrap());
    // A1's bias has changed by 3.8 to 4.8 ug0, the others by a little less.
    assert_eq!(verdict("bias=2ug0"), Some(Compliance::Beyond));
    assert_eq!(verdict("bias=4.2ug0"), Some(Compliance::Undecided));
    assert_eq!(verdict("bias=5ug0"), Some(Compliance::Within));
    assert_eq!(verdict("bias=20ug0,alignment=1urad"), Some(Compliance::Within));
    assert_eq!(verdict("bias=20ug0,rate=1deg/h"), Some(Compliance::Undecided));
    let message = found.check(&"bias=4.2ug0".parse().unwrap()).unwrap_err();
    assert!(
        message.starts_with("the requirement is not met:\n  A1 bias: 4.258, with its band 3.818 to 4.772 ug0, at most 4.200 ug0 is required: undecided"),
        "{message}"
    );
    assert!(message.ends_with("\nremedy: a longer campaign has smaller errors"), "{message}");
    // Each judgement has its own remedy; those with the same one are together.
    let message = found.check(&"bias=4.2ug0,scale=0.1ppm,rate=1deg/h".parse().unwrap()).unwrap_err();
    let remedies: Vec<_> = message.lines().filter(|line| line.starts_with("remedy: ")).collect();
    assert_eq!(remedies.len(), 3, "{message}");
    assert!(
        message.ends_with("rate: not judged, the tables do not all have gyroscopes\nremedy: leave rate out, or give only tables with gyroscopes"),
        "{message}"
    );
    assert!(message.contains("\nremedy: install the new table, and look for the cause\n"), "{message}");
    // The table of another IMU is none to install.
    let others = compare(vec![table("2023"), table("other_imu")], true).unwrap();
    let message = others.check(&"bias=0.001ug0".parse().unwrap()).unwrap_err();
    assert!(!message.contains("install"), "{message}");
}
