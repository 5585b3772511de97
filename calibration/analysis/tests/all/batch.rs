//! Statistics of a batch: real devices, false alarms, what is found, and devices with other orders.

use isotherm_analysis::{Batch, batch, least_found, leave_one_out, limit, stand_outs};
use isotherm_fit::{Origin, TableFile};
use isotherm_shared::names::ImuId;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::RandomGenerator;
use nalgebra::Matrix3;
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fit/tests/data");

#[test]
fn among_five_real_units_nobody_stands_out() {
    let text = fs::read_to_string(format!("{DATA}/any_lab/five_mpu9150/batch.csv")).unwrap();
    let (mut names, mut values): (Vec<&str>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
    for line in text.lines().skip(1) {
        let [_, quantity, value] = line.split(',').collect::<Vec<_>>().try_into().unwrap();
        let index = names.iter().position(|name| *name == quantity).unwrap_or_else(|| {
            names.push(quantity);
            values.push(Vec::new());
            names.len() - 1
        });
        values[index].push(value.parse().unwrap());
    }
    assert_eq!((values.len(), values[0].len()), (9, 5));
    assert_eq!(format!("{:.1}", limit(5, 9).unwrap()), "12.5");
    assert_eq!(stand_outs(&values).unwrap(), []);
    // Two of the five are far off, and hide each other.
    let bias = &values[names.iter().position(|name| *name == "A3 bias mg").unwrap()];
    assert_eq!(
        bias.iter().map(|value| format!("{value:.1}")).collect::<Vec<_>>(),
        ["34.9", "34.3", "-4.6", "-0.7", "18.6"]
    );
    // The same five, if one of them is 30 standard deviations off.
    values[0][2] += 30.0 * 5.0 * spread(&values[0]);
    let found = stand_outs(&values).unwrap();
    assert_eq!((found[0].unit, found[0].quantity, found.len()), (2, 0, 1));
}

fn spread(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::MIN, f64::max) - values.iter().copied().fold(f64::MAX, f64::min)
}

#[test]
fn false_alarms_are_as_rare_as_stated() {
    const REPORTS: u32 = 2000;
    let mut random = RandomGenerator::new(1, 0);
    for devices in [5, 8, 16, 32] {
        let (mut alarms, mut found) = (0, 0);
        let size = least_found(devices, 30).unwrap();
        for _ in 0..REPORTS {
            let mut values: Vec<Vec<f64>> = (0..30).map(|_| (0..devices).map(|_| random.normal()).collect()).collect();
            alarms += u32::from(!stand_outs(&values).unwrap().is_empty());
            values[7][3] += size;
            found += u32::from(stand_outs(&values).unwrap().iter().any(|it| (it.unit, it.quantity) == (3, 7)));
        }
        let percent = |count: u32| f64::from(count) * 100.0 / f64::from(REPORTS);
        println!(
            "{devices} devices: false alarms {} %; {size:.1} standard deviations found in {} %",
            percent(alarms),
            percent(found)
        );
        assert!((2.5..=6.5).contains(&percent(alarms)), "{devices}: {alarms}");
        assert!((87.0..93.0).contains(&percent(found)), "{devices}: {found}");
    }
}

#[test]
fn a_quarter_of_the_units_at_most_is_taken_out_one_at_a_time() {
    // Two of eight devices are off, the one far enough to hide the other at first.
    let mut values = vec![0.3, -1.0, 0.8, -0.2, 1.1, -0.7, 100.0, 1.0e5];
    let found = stand_outs(&[values.clone()]).unwrap();
    assert_eq!(found.iter().map(|it| it.unit).collect::<Vec<_>>(), [7, 6]);
    assert!(leave_one_out(&values)[6].unwrap().abs() < 1.0);
    assert!(found[1].limit > found[0].limit, "{found:?}");
    // A third one is more than a quarter.
    values[0] = 1.0e8;
    assert_eq!(stand_outs(&[values]).unwrap().len(), 2);
}

/// The published table with other numbers, as one of a device: biases with `bias_ug0` more and `slope` ug0/V more,
/// orders of 3 or, with `order`, another one.
fn unit(name: &str, bias_ug0: f64, slope: f64, order: Option<usize>) -> TableFile {
    let text = fs::read_to_string(format!("{DATA}/any_lab/compare/2023.toml")).unwrap();
    let table = CoefficientTable::from_toml(&text, None).unwrap();
    let mut content = table.content().clone();
    content.imu = ImuId::new(name).unwrap();
    for axis in &mut content.axes {
        let mut coefficients = axis.bias.coefficients().to_vec();
        coefficients[0] += bias_ug0 - slope * 2.5;
        coefficients[1] += slope;
        // A coefficient of 0 is another order of the same curve.
        coefficients.extend(core::iter::repeat_n(0.0, order.map_or(0, |order| order - 3)));
        axis.bias = Polynomial::new(&coefficients, 0.0, 1.0, axis.bias.range()).unwrap();
    }
    let origin = Origin {
        misalignment: [Some(Matrix3::new(1.0, 1e-4 + bias_ug0 * 1e-6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)), None],
        residual_sd_g0: Some([1e-6 + bias_ug0.abs() * 1e-9; 3]),
        ..Origin::default()
    };
    TableFile { name: format!("{name}.toml"), table: CoefficientTable::new(content).unwrap(), origin }
}

fn of(shifts: &[(f64, f64)], order: Option<usize>) -> Batch {
    let names = ["imu-a", "imu-b", "imu-c", "imu-d", "imu-e", "imu-f"];
    let devices: Vec<_> = names
        .iter()
        .zip(shifts)
        .enumerate()
        .map(|(i, (name, (bias, slope)))| unit(name, *bias, *slope, order.filter(|_| i == 2)))
        .collect();
    batch(&devices).unwrap()
}

#[test]
fn units_with_other_orders_are_compared_by_their_curves() {
    let shifts = [(1.0, 0.1), (-2.0, 0.3), (3.0, -0.2), (0.5, 0.0), (-1.0, -0.1)];
    let (same, other) = (of(&shifts, None), of(&shifts, Some(6)));
    assert_eq!(same.quantities, other.quantities);
    assert_eq!(same.stand_outs, Some(Vec::new()));
    // Bias at three temperatures and its slope; K+ and K- are the same in all devices. One misalignment, and the
    // residuals.
    let names: Vec<_> = same.quantities.iter().take(4).map(|quantity| quantity.name.as_str()).collect();
    assert_eq!(names, ["A1 bias at 1.1000", "A1 bias at 2.5000", "A1 bias at 3.9000", "A1 bias slope"]);
    assert_eq!((same.quantities.len(), same.judged()), (3 * 12 + 1 + 3, 3 * 4 + 1 + 3));
    let mid = &same.quantities[1];
    assert!((spread(&mid.values) - 5.0).abs() < 1e-9 && (mid.median() - mid.values[3]).abs() < 1e-12);
    assert!((mid.sd() - 1.923_538_4).abs() < 1e-6, "{}", mid.sd());
    let slope = &same.quantities[3];
    assert!((spread(&slope.values) - 0.5).abs() < 1e-9 && slope.unit == "ug0/V");
    assert!(
        same.verdict()[0]
            .starts_with("No device stands out: no |t| is over 15.1, the limit for 5 devices and 16 quantities."),
        "{:?}",
        same.verdict()
    );
    assert!(same.power().starts_with("Here: 25 among 5 devices. With 16 quantities"), "{}", same.power());
    // The curves are of one family: they differ by constants and small slopes.
    assert!(same.families()[0].ends_with("5 of 5 devices gain: a family curve is useful"), "{:?}", same.families());
}

#[test]
fn misalignments_are_compared_by_one_convention() {
    let table = |name: &str, imu: &str| {
        let text = fs::read_to_string(format!("{DATA}/any_lab/compare/{name}_alignment.toml")).unwrap();
        let mut file = TableFile::from_toml(name, &text.replace("\"imu-a\"", &format!("\"{imu}\""))).unwrap();
        // As `calibrate` writes them.
        file.origin.misalignment[0] = file.table.content().alignment.unwrap().try_inverse();
        file
    };
    let misalignments = |tables: &[TableFile]| {
        let found = batch(tables).unwrap();
        let quantities: Vec<_> =
            found.quantities.into_iter().filter(|quantity| quantity.name.contains("misalignment")).collect();
        (quantities, found.notes)
    };
    // The same unit by both conventions has the same three misalignments.
    let (mixed, notes) = misalignments(&[table("full", "imu-a"), table("triangular", "imu-b")]);
    assert_eq!(mixed.len(), 3, "{mixed:?}");
    assert!(mixed.iter().all(|quantity| (quantity.values[0] - quantity.values[1]).abs() < 1e-6), "{mixed:?}");
    assert!(notes.iter().any(|note| note.contains("They are compared with three")), "{notes:?}");
    // Of one convention, nothing is converted.
    let (full, notes) = misalignments(&[table("full", "imu-a"), table("full", "imu-b")]);
    assert!(full.len() == 6 && !notes.iter().any(|note| note.contains("three")), "{full:?}");
}

#[test]
fn a_unit_that_stands_out_is_named_with_its_value() {
    let found = of(&[(1.0, 0.1), (-2.0, 0.3), (3.0, -0.2), (0.5, 0.0), (-1.0, -0.1), (500.0, 0.2)], None);
    let lines = found.verdict();
    assert!(lines.iter().all(|line| line.starts_with("imu-f stands out: ")), "{lines:?}");
    assert!(lines.iter().any(|line| line.starts_with("imu-f stands out: A1 bias at 2.5000 ")), "{lines:?}");
    // Its slope does not.
    assert!(!lines.iter().any(|line| line.contains("slope")), "{lines:?}");
    let four = of(&[(1.0, 0.1), (-2.0, 0.3), (3.0, -0.2), (5000.0, 0.0)], None);
    assert_eq!(four.verdict(), ["4 devices are too few to say whether one stands out; it takes 5."]);
    assert!(four.power().starts_with("With 16 quantities"), "{}", four.power());
}

#[test]
fn tables_that_are_no_batch_are_refused() {
    let unit = |name: &str| unit(name, 0.0, 0.0, None);
    let refused = |devices: &[TableFile]| batch(devices).unwrap_err().to_string();
    assert!(refused(&[unit("imu-a")]).contains("fewer than two tables"));
    assert!(refused(&[unit("imu-a"), unit("imu-b"), unit("imu-a")]).contains("two tables are of imu-a"));
    let text = fs::read_to_string(format!("{DATA}/any_lab/compare/celsius.toml")).unwrap().replace("imu-a", "imu-c");
    let celsius = TableFile::from_toml("celsius.toml", &text).unwrap();
    assert!(refused(&[unit("imu-a"), celsius]).contains("temperature in V and degC"));
    let text = fs::read_to_string(format!("{DATA}/any_lab/compare/far.toml")).unwrap().replace("imu-a", "imu-c");
    let far = batch(&[unit("imu-a"), TableFile::from_toml("far.toml", &text).unwrap()]).unwrap();
    assert!(
        far.quantities.is_empty() && far.findings[0].message.starts_with("A1 bias: the devices have no common range"),
        "{far:?}"
    );
}
