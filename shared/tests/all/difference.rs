//! The plain difference of two tables, and the limits of what a service takes.

use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::difference::{MaxChange, POINTS, TableDifference};
use isotherm_shared::table::{CoefficientTable, Content, Nominal, OutOfRange, nominal_content};
use nalgebra::Matrix3;
use proptest::prelude::*;

const TABLE: &str = include_str!("../../../tests/data/imu-a.toml");
/// With gyroscopes, both alignments, g-sensitivity and transients.
const WHOLE: &str = include_str!("../../../tests/data/imu-g.toml");

fn table(text: &str) -> CoefficientTable {
    CoefficientTable::from_toml(text, None).unwrap()
}

/// What the default limits say of the change of one text of the table into another.
fn refusals(text: &str, from: &str, to: &str) -> Vec<String> {
    let changed = text.replacen(from, to, 1);
    assert_ne!(changed, text, "{from}");
    MaxChange::default().refusals(&TableDifference::of(&table(text), &table(&changed)), 1.0)
}

#[test]
fn a_table_does_not_differ_from_itself() {
    for text in [TABLE, WHOLE] {
        let difference = TableDifference::of(&table(text), &table(text));
        assert!(difference.changes.iter().all(|change| change.size == 0.0));
        assert!(difference.incomparable.is_empty() && difference.others.is_empty());
        assert_eq!(difference.to_string(), "no curve changes");
    }
}

#[test]
fn every_part_of_a_table_has_a_limit() {
    // Of standard gravity, whatever the table calls 1 g0.
    assert!(refusals(TABLE, "c0 = 793.55", "c0 = 100793.55").is_empty());
    let beyond = refusals(TABLE, "c0 = 793.55", "c0 = 100893.55");
    assert!(
        beyond[0].starts_with("A1 bias changes by 100047 ug0, from ")
            && beyond[0].ends_with("at most 100 mg0 is taken (max_change.bias)"),
        "{beyond:?}"
    );
    // The slope is 2 % at the far end.
    assert!(refusals(TABLE, "91733.0", "100600.0").is_empty());
    assert!(refusals(TABLE, "91733.0", "101000.0")[0].contains("max_change.scale"));
    assert!(refusals(TABLE, "-90072.0", "-99000.0").is_empty());
    assert!(refusals(TABLE, "-90072.0", "-99500.0")[0].starts_with("A1 negative_scale_factor"));
    for (from, to, name) in WHOLE_CHANGES {
        let beyond = refusals(WHOLE, from, to);
        assert!(beyond.len() == 1 && beyond[0].starts_with(name), "{beyond:?}");
    }
}

/// Changes of [`WHOLE`] beyond a limit, and how the refusal begins.
const WHOLE_CHANGES: [(&str, &str, &str); 7] = [
    (
        "transient = -35.0",
        "transient = -31000.0",
        "A1 transient changes by 102131 ug0, from -34.9816 to -30983.7 ug0 a unit",
    ),
    ("c0 = 6.213", "c0 = 3606.5", "G1 bias changes by 3600.29 deg/h, from "),
    ("c0 = 1.05214", "c0 = 1.1575", "G1 positive_scale_factor changes by 100"),
    ("transient = 0.83", "transient = 1092.0", "G1 transient changes by 3600.86 deg/h"),
    ("a1 = 0.731", "a1 = -3599.9", "G1 g_sensitivity changes by 3600.63 deg/h, from [0.731, -0.214, 0.0875] to"),
    ("-0.0003,", "0.0998,", "alignment changes by 100.1 mrad, from -0.0003 to 0.0998 in row 1, column 2"),
    ("0.00031,", "0.1004,", "gyroscope_alignment changes by 100.09 mrad"),
];

#[test]
fn a_unit_of_temperature_and_half_of_the_range_must_stay() {
    assert!(refusals(TABLE, "unit = \"V\"", "unit = \"K\"")[0].starts_with("temperature.unit"));
    for (range, is_taken) in
        [("[2.54, 4.2]", true), ("[2.56, 4.2]", false), ("[-9.0, 2.56]", true), ("[4.2, 9.0]", false)]
    {
        let refusals = refusals(TABLE, "range = [0.9, 4.2]", &format!("range = {range}"));
        assert_eq!(refusals.is_empty(), is_taken, "{range}: {refusals:?}");
    }
}

#[test]
fn scale_factors_of_another_interval_are_not_compared() {
    const MEMS: &str = include_str!("../../../examples/tables/imu-mems.toml");
    let line = "nominal_interval_s = 0.0025";
    let refused = refusals(MEMS, line, "nominal_interval_s = 0.005");
    assert_eq!(refused, ["imu.nominal_interval_s: the scale factors were of 0.0025 s, now they are of 0.005 s"]);
    assert!(refusals(MEMS, line, "nominal_interval_s = 0.00252").is_empty());
    assert!(refusals(MEMS, line, "").is_empty());
    let without = TableDifference::of(&table(MEMS), &table(&MEMS.replacen(line, "", 1)));
    assert_eq!(without.others, ["nominal_interval_s 0.0025 -> none"]);
}

/// A table without curves that change, and without provenance.
fn nominal() -> String {
    let constant = |line: &str| line.find(", c1 = ").map_or(line.to_owned(), |end| format!("{} }}", &line[..end]));
    TABLE.lines().map(|line| constant(line) + "\n").collect()
}

fn refused(old: &str, new: &str) -> Vec<String> {
    MaxChange::default().refusals(&TableDifference::of(&table(old), &table(new)), 1.0)
}

#[test]
fn what_no_limit_can_measure_is_refused() {
    let without = WHOLE.split_inclusive("\n[[gyroscope]]").next().unwrap().trim_end_matches("[[gyroscope]]");
    let without = without.to_owned();
    assert!(table(&without).content().gyroscopes.is_none());
    assert_eq!(refused(WHOLE, &without), ["the table before has gyroscopes, and this one has none"]);
    assert_eq!(refused(&without, WHOLE), ["this table has gyroscopes, and the one before has none"]);
    // A policy that rejects decides whether there are increments.
    let policy = |name: &str| TABLE.replace("\"clamp\"", &format!("\"{name}\""));
    assert_eq!(refused(TABLE, &policy("reject")), ["temperature.out_of_range: it was \"clamp\", now it is \"reject\""]);
    assert_eq!(refused(&policy("reject"), &policy("extrapolate")).len(), 1);
    assert!(refused(TABLE, &policy("extrapolate")).is_empty());
    // No nominal table in between walks round the limits.
    assert!(table(&nominal()).is_nominal());
    assert!(refused(TABLE, &nominal())[0].contains("a calibration and this one is no calibration"));
    assert!(refused(&nominal(), &nominal().replace("91733.0", "9173.0"))[0].starts_with("A1 positive_scale_factor"));
}

/// The content of the nominal table of readings at 100 Hz.
fn of_readings() -> Content {
    nominal_content(&Nominal::new("imu-a".parse().unwrap(), 10_000_000, [-40.0, 85.0])).unwrap()
}

/// The same over 30 K of a warm-up, with bias curves of 40 mg0 and 0.5 deg/s.
fn warmed_up() -> Content {
    let mut content = of_readings();
    let curve = |coefficients: &[f64]| Polynomial::new(coefficients, 40.0, 15.0, [25.0, 55.0]).unwrap();
    for axis in &mut content.axes {
        axis.bias = curve(&[30e3, 10e3]);
    }
    for axis in &mut content.gyroscopes.as_mut().unwrap().axes {
        axis.bias = curve(&[1500.0, 300.0]);
    }
    scaled(content, 1.0)
}

/// The content with all scale factors over the range of a warm-up, times a number.
fn scaled(mut content: Content, factor: f64) -> Content {
    let gyroscopes = content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes);
    for axis in content.axes.iter_mut().chain(gyroscopes) {
        for curve in [&mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
            let scale_factor = curve.coefficients()[0] * factor;
            *curve = Polynomial::new(&[scale_factor], 0.0, 1.0, [25.0, 55.0]).unwrap();
        }
    }
    content
}

/// Why a table of one content may not follow that of another; the second one is of a calibration.
fn refusals_of_first([nominal, mut calibrated]: [Content; 2]) -> Vec<String> {
    calibrated.format = calibrated.least_format();
    let nominal = CoefficientTable::new(nominal).unwrap();
    let calibrated = CoefficientTable::new(calibrated).unwrap().with_provenance();
    assert!(calibrated.is_first_calibration_after(&nominal) && !nominal.is_first_calibration_after(&calibrated));
    MaxChange::default().refusals(&TableDifference::of(&nominal, &calibrated), 1.0)
}

/// What a first calibration has that a nominal table has not, all of it ordinary.
fn ordinary() -> [fn(&mut Content); 8] {
    [
        |_| {},
        |content| content.serial = Some("17".to_owned()),
        // Of counts, or of a program that does not write it.
        |content| content.nominal_interval_s = None,
        // The same resolution, at 200 Hz.
        |content| {
            *content = scaled(content.clone(), 2.0);
            content.nominal_interval_s = Some(0.005);
        },
        |content| content.out_of_range = OutOfRange::Reject,
        |content| content.max_age_s = Some(5.0),
        |content| {
            content.lag_s = Some(60.0);
            content.axes[0].transient = 200.0;
            content.gyroscopes.as_mut().unwrap().axes[2].transient = 20.0;
        },
        |content| {
            content.axes[1].max_rate = Some(4e9);
            let gyroscopes = content.gyroscopes.as_mut().unwrap();
            gyroscopes.g_sensitivity[0] = Some([30.0, -20.0, 10.0]);
            let misaligned = Matrix3::new(1.0, 0.02, -0.01, -0.015, 1.0, 0.025, 0.01, -0.03, 1.0);
            (content.alignment, gyroscopes.alignment) = (Some(misaligned), Some(misaligned));
        },
    ]
}

#[test]
fn a_nominal_table_is_followed_by_its_first_calibration() {
    let mut all = warmed_up();
    for change in ordinary() {
        let mut calibrated = warmed_up();
        change(&mut calibrated);
        assert_eq!(refusals_of_first([of_readings(), calibrated]), [""; 0]);
        change(&mut all);
    }
    assert_eq!(refusals_of_first([of_readings(), all.clone()]), [""; 0]);
    // Sealed or not, as long as no seal is lost.
    let tables = [of_readings(), all].map(|content| CoefficientTable::new(content).unwrap().to_toml());
    let unsealed = |text: &str| text.lines().filter(|line| !line.starts_with("digest")).collect::<Vec<_>>().join("\n");
    for (old, new, count) in [
        (tables[0].clone(), tables[1].clone(), 0),
        (unsealed(&tables[0]), tables[1].clone(), 0),
        (unsealed(&tables[0]), unsealed(&tables[1]), 0),
        (tables[0].clone(), unsealed(&tables[1]), 1),
    ] {
        assert_eq!(refused(&old, &new).len(), count, "{:?}", refused(&old, &new));
    }
    // A range that the nominal table does not have is judged all the same.
    let mut elsewhere = of_readings();
    elsewhere.axes[0].bias = Polynomial::new(&[0.0], 0.0, 1.0, [-40.0, 20.0]).unwrap();
    assert_eq!(refusals_of_first([elsewhere.clone(), warmed_up()]), [""; 0]);
    let mut beyond = warmed_up();
    beyond.axes[0].bias = Polynomial::new(&[0.0, 8e3], 25.0, 1.0, [25.0, 55.0]).unwrap();
    let words = refusals_of_first([elsewhere, beyond]);
    assert!(
        words.len() == 1 && words[0].starts_with("A1 bias changes by 240000 ug0, from 0 to 240000 ug0 at 55"),
        "{words:?}"
    );
}

#[test]
fn a_first_calibration_of_another_unit_or_quantum_is_refused_with_both_numbers() {
    let refused = |change: fn(&mut Content)| {
        let mut calibrated = warmed_up();
        change(&mut calibrated);
        refusals_of_first([of_readings(), calibrated])
    };
    let constant = |value: f64| Polynomial::new(&[value], 0.0, 1.0, [25.0, 55.0]).unwrap();
    // Biases beyond the limits.
    let mut calibrated = warmed_up();
    calibrated.axes[2].bias = constant(150e3);
    calibrated.gyroscopes.as_mut().unwrap().axes[0].bias = constant(-5000.0);
    let of_bias =
        "A3 bias changes by 150000 ug0, from 0 to 150000 ug0 at 25; at most 100 mg0 is taken (max_change.bias)";
    // The whole offset of a gyroscope is new: it may be any that a table may have, unless a limit is given.
    assert_eq!(refusals_of_first([of_readings(), calibrated.clone()]), [of_bias]);
    calibrated.format = calibrated.least_format();
    let difference = TableDifference::of(
        &CoefficientTable::new(of_readings()).unwrap(),
        &CoefficientTable::new(calibrated).unwrap().with_provenance(),
    );
    let of_rate =
        "G1 bias changes by 5000 deg/h, from 0 to -5000 deg/h at 25; at most 3600 deg/h is taken (max_change.rate)";
    let given = MaxChange { rate: Some(3600.0), ..MaxChange::default() };
    assert_eq!(given.refusals(&difference, 1.0), [of_bias, of_rate]);
    // The interval without its scale factors, and the scale factors without their interval, are a factor 2. Readings in
    // g and in degrees, and another unit of the sensor, change only the scale factors.
    let halved = refused(|content| content.nominal_interval_s = Some(0.005));
    let values = "A1 positive_scale_factor changes by 500000 ppm, from 980665000 (nominal_interval_s 0.01) to 980665000 (nominal_interval_s 0.005) pulse/(s*g0) at 25; at most 10 %";
    assert!(halved.len() == 12 && halved[0].starts_with(values), "{halved:?}");
    let doubled = refused(|content| *content = scaled(content.clone(), 2.0));
    let values = "A1 positive_scale_factor changes by 1000000 ppm, from 980665000 to 1961330000 pulse/(s*g0) at 25";
    assert!(doubled.len() == 12 && doubled[0].starts_with(values), "{doubled:?}");
    for change in [
        |content: &mut Content| *content = scaled(content.clone(), 1.0 / 9.80665),
        |content: &mut Content| *content = scaled(content.clone(), 180.0 / std::f64::consts::PI),
        |content: &mut Content| *content = scaled(content.clone(), 1.12),
        |content: &mut Content| {
            // Without an interval, K itself counts.
            *content = scaled(content.clone(), 2.0);
            content.nominal_interval_s = None;
        },
    ] {
        assert_eq!(refused(change).len(), 12);
    }
    assert!(refused(|content| content.temperature_unit = "K".to_owned())[0].starts_with("temperature.unit"));
    assert_eq!(
        refused(|content| content.gyroscopes = None),
        ["the table before has gyroscopes, and this one has none"]
    );
    assert!(refused(|content| content.alignment = Some(Matrix3::identity() * 1.2))[0].starts_with("alignment changes"));
    assert!(
        refused(|content| {
            content.lag_s = Some(60.0);
            content.axes[0].transient = 4000.0;
        })[0]
            .starts_with("A1 transient changes by 120000 ug0")
    );
    // Two serial numbers that are both there.
    let of_unit = |mut content: Content, serial: &str| {
        content.serial = Some(serial.to_owned());
        content
    };
    assert_eq!(refusals_of_first([of_unit(of_readings(), "17"), of_unit(warmed_up(), "17")]), [""; 0]);
    assert_eq!(refusals_of_first([of_unit(of_readings(), "17"), warmed_up()]), [""; 0]);
    let words = refusals_of_first([of_unit(of_readings(), "17"), of_unit(warmed_up(), "18")]);
    assert_eq!(words, ["imu.serial: it was \"17\", now it is \"18\", and the curves change too"]);
    // Nor is a nominal table of another interval a first calibration.
    let [one, mut other] = [of_readings(), scaled(of_readings(), 2.0)];
    other.nominal_interval_s = Some(0.005);
    let [one, other] = [one, other].map(|content| CoefficientTable::new(content).unwrap());
    let words = MaxChange::default().refusals(&TableDifference::of(&one, &other), 1.0);
    assert_eq!(words, ["imu.nominal_interval_s: the scale factors were of 0.01 s, now they are of 0.005 s"]);
}

#[test]
fn another_serial_number_with_other_curves_is_another_unit() {
    let plain: String =
        TABLE.lines().filter(|line| !line.starts_with("serial")).map(|line| format!("{line}\n")).collect();
    let serial = |name: &str| plain.replacen("[imu]\n", &format!("[imu]\nserial = \"{name}\"\n"), 1);
    assert_ne!(serial("7"), plain);
    let bent = |text: &str| text.replace("c0 = 793.55", "c0 = 793.56");
    // Added or corrected while no curve changes.
    for (old, new) in [(plain.clone(), serial("7")), (serial("7"), serial("8"))] {
        assert!(refused(&old, &new).is_empty());
        let difference = TableDifference::of(&table(&old), &table(&new));
        assert!(difference.others[0].starts_with("serial "), "{difference}");
        let refusals = refused(&old, &bent(&new));
        assert!(refusals.len() == 1 && refusals[0].starts_with("imu.serial: it was "), "{refusals:?}");
    }
    assert!(refused(&serial("7"), &bent(&serial("7"))).is_empty());
    // A table that does not name its unit is not of another one.
    assert!(refused(&serial("7"), &bent(&plain)).is_empty());
}

#[test]
fn limits_count_as_often_as_the_caller_says() {
    let raised = TABLE.replace("c0 = 793.55", "c0 = 250793.55");
    let difference = TableDifference::of(&table(TABLE), &table(&raised));
    assert!(MaxChange::default().refusals(&difference, 3.0).is_empty());
    assert_eq!(MaxChange::default().refusals(&difference, 2.0).len(), 1);
}

/// A record of a stated error.
fn stated(axis: &str, quantity: &str, unit: &str, error: f64) -> String {
    format!(
        "[[provenance.curve]]\naxis = \"{axis}\"\nquantity = \"{quantity}\"\nunit = \"{unit}\"\nlargest_interval = {error}\n"
    )
}

#[test]
fn limits_follow_from_the_errors_and_ranges_of_the_old_table() {
    let curves = [stated("A1", "bias", "ug0", 4.0), stated("A1", "positive_scale_factor", "pulse/(s*g0)", 0.36)];
    let old = format!("{WHOLE}\n[provenance]\n{}", curves.concat());
    let refused_by = |limits: MaxChange, changes: &[(&str, &str)]| {
        let new = changes.iter().fold(old.clone(), |text, (from, to)| text.replacen(from, to, 1));
        limits.refusals(&TableDifference::of(&table(&old), &table(&new)), 1.0)
    };
    let refused = |changes: &[(&str, &str)]| refused_by(MaxChange::default(), changes);
    // A single number: ten times the error, 40 ug0 and 40 ppm.
    assert!(refused(&[("c0 = 793.55", "c0 = 833.5")]).is_empty());
    let words = refused(&[("c0 = 793.55", "c0 = 833.9")]);
    assert!(words.len() == 1 && words[0].contains("at most 39.979 ug0 is taken, by the errors"), "{words:?}");
    assert!(refused(&[("91733.0", "91736.0")]).is_empty());
    assert!(refused(&[("91733.0", "91737.0")])[0].starts_with("A1 positive_scale_factor changes by "));
    // With others: 0.4 of the 404 ug0 that the biases range over in addition.
    let other = ("c0 = 118.72", "c0 = 118.73");
    assert!(refused(&[("c0 = 793.55", "c0 = 993.0"), other]).is_empty());
    assert!(refused(&[("c0 = 793.55", "c0 = 997.0"), other])[0].starts_with("A1 bias changes by "));
    // A curve without an error has the widest limit, and so has every one if the user gives no less.
    assert!(refused(&[("c0 = 118.72", "c0 = 90118.72")]).is_empty());
    let limits = MaxChange { bias: Some(5e-5), ..MaxChange::default() };
    assert!(refused_by(limits, &[("c0 = 793.55", "c0 = 833.9")]).is_empty());
    assert!(
        refused_by(limits, &[("c0 = 118.72", "c0 = 170.0")])[0]
            .ends_with("at most 0.05 mg0 is taken (max_change.bias)")
    );
    assert!(refused_by(MaxChange::WIDEST, &[("c0 = 793.55", "c0 = 1833.5")]).is_empty());
    // The widest limits stay the widest.
    let vague = old.replace("largest_interval = 4", "largest_interval = 4e9");
    let raised = vague.replacen("c0 = 793.55", "c0 = 101793.55", 1);
    let refusals = MaxChange::default().refusals(&TableDifference::of(&table(&vague), &table(&raised)), 1.0);
    assert!(refusals[0].ends_with("at most 100 mg0 is taken (max_change.bias)"), "{refusals:?}");
}

#[test]
fn errors_are_read_as_calibrate_writes_them_and_as_a_service_keeps_them() {
    let errors = |provenance: &str| *table(&format!("{WHOLE}\n[provenance]\n{provenance}")).errors();
    let same = [
        // Recordings at one attitude, in SI units; the larger one counts.
        (
            "[[provenance.curve]]\naxis = \"G2\"\nunit = \"rad/s\"\ninterval_95 = 1e-9\nband = 4.84813681109536e-6\n"
                .to_owned(),
            stated("G2", "bias", "deg/h", 1.0),
        ),
        (
            "[[provenance.curve]]\naxis = \"A3\"\nunit = \"m/s2\"\nband = 9.8015e-6\n".to_owned(),
            stated("A3", "bias", "ug0", 1.0),
        ),
        // Ramps.
        (
            "[[provenance.transients.bias]]\naxis = \"A1\"\nunit = \"ug0\"\nstandard_error = 0.5\ncurve_error = 7.0\n"
                .to_owned(),
            stated("A1", "bias", "ug0", 7.0) + &stated("A1", "transient", "ug0", 1.0),
        ),
        // Matrices, a row for each sensor.
        (
            "gyroscope_misalignment_standard_error = [[0, 1e-6, 2e-6], [0, 0, 0], [0, 0, 0]]\n\
             g_sensitivity_standard_error = [[0, 0, 0], [0, 0, 0], [0.1, 0.2, 0.3]]\n"
                .to_owned(),
            stated("G1", "misalignment", "rad", 4e-6) + &stated("G3", "g_sensitivity", "deg/h/g0", 0.6),
        ),
        // What cannot be right states nothing.
        (
            stated("A1", "bias", "V", 1.0) + &stated("A9", "bias", "ug0", 1.0) + &stated("A1", "bias", "ug0", -1.0),
            String::new(),
        ),
        ("curve = 7\ntransients = [1]\nmisalignment_standard_error = \"x\"\n".to_owned(), String::new()),
    ];
    for (one, other) in same {
        let (found, expected) = (errors(&one).to_toml(table(WHOLE).content()), errors(&other));
        let found = found.replace("0.9999999999999999", "1.0").replace("1.0000000000000002", "1.0");
        assert_eq!(errors(&found), expected, "{one}");
    }
}

#[test]
fn an_unsealed_table_does_not_follow_a_sealed_one() {
    let sealed = table(TABLE).to_toml();
    let moved = |text: &str| text.replace("c0 = 793.55", "c0 = 793.56");
    assert!(table(&sealed).is_sealed() && !table(TABLE).is_sealed());
    assert!(refused(&sealed, &moved(TABLE))[0].contains("seal it with `check --seal`"));
    // A half of the file, whose seal is lost or does not come any more.
    for (old, new) in [(TABLE, &*moved(TABLE)), (TABLE, &*sealed), (&*sealed, &*table(&moved(TABLE)).to_toml())] {
        assert!(refused(old, new).is_empty());
    }
    // A service keeps every table with a digest, and notes there that its file had none.
    let kept = format!("{sealed}\n[provenance]\nunsealed = true\n");
    assert!(!table(&kept).is_sealed() && refused(&kept, &moved(TABLE)).is_empty());
    assert!(table(&format!("{}[provenance]\nunsealed = true\n", nominal())).is_nominal());
}

proptest! {
    /// A polynomial in other coefficients, centred and scaled or in another unit, is the same curve.
    #[test]
    fn the_same_curve_in_another_form_has_no_difference(center in -3.0..3.0_f64, scale in 0.3..3.0_f64) {
        // c0 + c1 U of A1's bias, in U and in (U - center)/scale.
        let plain = TABLE.replace("c0 = 793.55, c1 = -1074.70, c2 = 420.81, c3 = -53.712", "c0 = 793.55, c1 = -1074.70");
        let (c0, c1) = ((793.55 - 1074.70 * center) / 1e3, -1074.70 * scale / 1e3);
        let other = plain.replace(
            "bias = { unit = \"ug0\", range = [0.9, 4.2], c0 = 793.55, c1 = -1074.70",
            &format!("bias = {{ unit = \"mg0\", center = {center:?}, scale = {scale:?}, range = [0.9, 4.2], c0 = {c0:?}, c1 = {c1:?}"),
        );
        prop_assert_ne!(&plain, &other);
        let difference = TableDifference::of(&table(&plain), &table(&other));
        prop_assert!(difference.changes.iter().all(|change| change.size < 1e-8), "{}", difference);
    }

    /// The size is the largest at the points, whichever table is the old one, and is refused exactly beyond the limit.
    #[test]
    fn sizes_are_those_of_the_points(c0 in -2e5..2e5_f64, c3 in -2e3..2e3_f64, limit in 1e-4..0.2_f64) {
        let changed = TABLE.replace("c0 = 793.55", &format!("c0 = {c0:?}")).replace("c3 = -53.712", &format!("c3 = {c3:?}"));
        let (old, new) = (table(TABLE), table(&changed));
        let size = |from, to| TableDifference::of(from, to).changes.into_iter().find(|change| change.name == "A1 bias").unwrap().size;
        let found = size(&old, &new);
        let at = |i: usize| 0.9 + 3.3 * i as f64 / (POINTS - 1) as f64;
        let difference = |u: f64| ((c0 - 793.55) + (c3 + 53.712) * u.powi(3)).abs() * 9.8015 / 9.806_65;
        let largest = (0..POINTS).map(|i| difference(at(i))).fold(0.0, f64::max);
        prop_assert!((found - largest).abs() <= 1e-9 * largest + 1e-6, "{} {}", found, largest);
        prop_assert!((found - size(&new, &old)).abs() <= 1e-9 * found);
        let limits = MaxChange { bias: Some(limit), ..MaxChange::default() };
        prop_assert_eq!(limits.refusals(&TableDifference::of(&old, &new), 1.0).len(), usize::from(found > limit * 1e6));
    }
}
