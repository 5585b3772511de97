//! What parameters cannot say: refused by name, or dropped with its size.

use crate::common::{DEVICES, mixed, parsed, subtracted, table};
use isotherm_autopilot::{Autopilot, Effect, EffectLoss, ExportError, ExportOptions, Parameters, export};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_shared::units::{ARCSEC, SensorKind};
use nalgebra::Matrix3;

const GRAVITY: f64 = 9.8015;
const BOTH: [Autopilot; 2] = [Autopilot::Px4, Autopilot::ArduPilot];

fn options(autopilot: Autopilot, drop: Vec<Effect>) -> ExportOptions {
    let device_id = (autopilot == Autopilot::Px4).then_some(DEVICES);
    ExportOptions { device_id, drop, ..ExportOptions::new(autopilot) }
}

/// The mixed table with a change.
fn changed(change: impl FnOnce(&mut Content)) -> CoefficientTable {
    let mut content = parsed(&mixed()).content().clone();
    change(&mut content);
    CoefficientTable::new(content).unwrap()
}

fn losses(table: &CoefficientTable, options: &ExportOptions) -> Vec<EffectLoss> {
    match export(table, options) {
        Err(ExportError::Effects(losses)) => losses,
        other => panic!("{other:?}"),
    }
}

/// The one effect that both autopilots refuse, and leave out on request; no other name leaves it out.
fn refused(table: &CoefficientTable, effect: Effect) -> EffectLoss {
    let others: Vec<_> = Effect::NAMES.iter().map(|(other, _)| *other).filter(|other| *other != effect).collect();
    let mut all = Vec::new();
    for autopilot in BOTH {
        all.extend(losses(table, &options(autopilot, Vec::new())));
        all.extend(losses(table, &options(autopilot, others.clone())));
        all.extend(export(table, &options(autopilot, vec![effect])).unwrap().lost);
    }
    assert!(all.len() == 6 && all.iter().all(|loss| *loss == all[0] && loss.effect == effect), "{all:?}");
    let error = ExportError::Effects(all.clone()).to_string();
    assert!(error.contains(&format!("--drop {effect} leaves it out")), "{error}");
    all.swap_remove(0)
}

fn near(found: Option<f64>, right: f64) {
    assert!(found.is_some_and(|found| (found / right - 1.0).abs() < 1e-9), "{found:?} {right}");
}

#[test]
fn scale_factors_that_depend_on_temperature() {
    // Half a percent from the middle of the range to its ends.
    let curve = |k: f64| Polynomial::new(&[k, 0.005 * k], 22.5, 62.5, [-40.0, 85.0]).unwrap();
    let table = changed(|content| {
        let axes = [&mut content.axes[1], &mut content.gyroscopes.as_mut().unwrap().axes[0]];
        for (axis, k) in axes.into_iter().zip([9e4, 1.0]) {
            (axis.positive_scale_factor, axis.negative_scale_factor) = (curve(k), curve(-k));
        }
    });
    let loss = refused(&table, Effect::ScaleTemperature);
    assert_eq!(loss.sensors, ["A2", "G1"]);
    near(loss.accelerometers, 0.005 * GRAVITY); // m/s2 at 1 g0
    near(loss.gyroscopes, 0.005); // rad/s at 1 rad/s
    let said = "(A2, G1), up to 0.049 m/s2 at 1 g0 and 5.0e-3 rad/s at 1 rad/s";
    assert!(loss.to_string().ends_with(said), "{loss}");
}

#[test]
fn k_minus_apart_from_k_plus() {
    let loss = refused(&parsed(&mixed().replacen("-9e4", "-9.9e4", 1)), Effect::NegativeScale);
    assert_eq!((loss.sensors.as_slice(), loss.gyroscopes), (&["A1"][..], None));
    near(loss.accelerometers, GRAVITY * (1.0 - 1.0 / 1.1)); // m/s2 at 1 g0
}

#[test]
fn alignment() {
    let matrix = Some(Matrix3::new(1.0, 3e-4, 4e-4, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0));
    let loss = refused(&changed(|content| content.alignment = matrix), Effect::Alignment);
    assert_eq!((loss.sensors.as_slice(), loss.gyroscopes), (&["A1"][..], None));
    near(loss.accelerometers, 5e-4 * GRAVITY);
    let table = changed(|content| content.gyroscopes.as_mut().unwrap().alignment = matrix);
    let loss = refused(&table, Effect::Alignment);
    assert_eq!((loss.sensors.as_slice(), loss.accelerometers), (&["G1"][..], None));
    near(loss.gyroscopes, 5e-4);
    // A matrix that does nothing is none.
    let none = changed(|content| content.alignment = Some(Matrix3::identity()));
    assert!(export(&none, &options(Autopilot::Px4, Vec::new())).unwrap().lost.is_empty());
}

#[test]
fn lag() {
    let table = changed(|content| {
        content.lag_s = Some(240.0);
        content.axes[1].transient = -31.0; // ug0 for each degC
        content.gyroscopes.as_mut().unwrap().axes[2].transient = 2.0; // deg/h for each degC
    });
    let loss = refused(&table, Effect::Lag);
    assert_eq!(loss.sensors, ["A2", "G3"]);
    // After long, the lagged temperature is 240 s behind: 4 degC at 1 degC/min.
    near(loss.accelerometers, 31e-6 * GRAVITY * 4.0);
    near(loss.gyroscopes, 2.0 * ARCSEC * 4.0);
}

#[test]
fn g_sensitivity() {
    let table = changed(|content| content.gyroscopes.as_mut().unwrap().g_sensitivity[1] = Some([0.0, 3.0, -4.0]));
    let loss = refused(&table, Effect::GSensitivity);
    assert_eq!((loss.sensors.as_slice(), loss.accelerometers), (&["G2"][..], None));
    near(loss.gyroscopes, 5.0 * ARCSEC);
    assert!(loss.to_string().ends_with("rad/s at 1 g0"), "{loss}");
}

#[test]
fn several_effects_are_reported_together() {
    let table = changed(|content| {
        content.alignment = Some(Matrix3::from_diagonal_element(1.01));
        content.gyroscopes.as_mut().unwrap().g_sensitivity[1] = Some([0.0, 3.0, -4.0]);
    });
    let effects = |options: &ExportOptions| losses(&table, options).iter().map(|loss| loss.effect).collect::<Vec<_>>();
    let both = [Effect::Alignment, Effect::GSensitivity];
    assert_eq!(effects(&options(Autopilot::Px4, Vec::new())), both);
    assert_eq!(effects(&options(Autopilot::Px4, vec![Effect::Alignment])), both[1..]);
    assert_eq!(export(&table, &options(Autopilot::Px4, both.to_vec())).unwrap().lost.len(), 2);
}

/// The largest difference between what the firmware subtracts without an effect, and the kernel with it.
fn left(table: &CoefficientTable, autopilot: Autopilot, effect: Effect, [low, high]: [f64; 2]) -> f64 {
    let at_c = (autopilot == Autopilot::ArduPilot).then_some(10.0);
    let exported = export(table, &ExportOptions { at_c, ..options(autopilot, vec![effect]) }).unwrap();
    let parameters = Parameters::read(&exported.text, autopilot, None).unwrap();
    let at = |k: u32| {
        let temperature = (low + (high - low) * f64::from(k) / 2000.0) as f32;
        let firmware = parameters.offset(SensorKind::Accelerometer, temperature).unwrap();
        let [kernel, _] = subtracted(table, temperature.into());
        kernel
            .into_iter()
            .zip(firmware)
            .map(|(kernel, firmware)| (kernel - f64::from(firmware)).abs())
            .fold(0.0, f64::max)
    };
    (0..=2000).map(at).fold(0.0, f64::max)
}

#[test]
fn orders_above_three() {
    let curve =
        "unit = \"mg0\", range = [-30.0, 70.0], center = 20.0, scale = 50.0, c0 = 1.0, c1 = 2.0, c2 = 0.0, c3 = 0.0";
    let rate = "unit = \"deg/h\", range = [-30.0, 70.0], c0 = 12.0, c1 = 0.1";
    let table = parsed(&table([&format!("{curve}, c4 = 8.0"), curve, &format!("{curve}, c4 = 0.0")], [rate; 3]));
    let loss = refused(&table, Effect::Order);
    // A term of order 4 that says nothing is none.
    assert_eq!((loss.sensors.as_slice(), loss.gyroscopes), (&["A1"][..], None));
    // 8 x^4 has T4 above order 3.
    near(loss.accelerometers, 1e-3 * GRAVITY);
    for autopilot in BOTH {
        let found = left(&table, autopilot, Effect::Order, [-30.0, 70.0]);
        assert!((found / (1e-3 * GRAVITY) - 1.0).abs() < 1e-3, "{found}");
    }
}

#[test]
fn several_ranges() {
    let accelerometer = |range: &str| format!("unit = \"mg0\", range = {range}, c0 = 1.0, c1 = 0.2");
    let gyroscope = |range: &str| format!("unit = \"deg/h\", range = {range}, c0 = 1.0, c1 = 0.2");
    let (wide, narrow) = ("[-30.0, 70.0]", "[-20.0, 60.0]");
    let (a, g) = (accelerometer(wide), gyroscope(wide));
    let with_second = |range: &str| parsed(&table([&a, &accelerometer(range), &a], [&g, &g, &g]));
    let one_narrow = with_second(narrow);
    let [loss] = &losses(&one_narrow, &options(Autopilot::Px4, Vec::new()))[..] else { panic!() };
    // The narrow one stays as it is; the others lose 10 degC at each end.
    assert_eq!((loss.effect, loss.sensors.as_slice()), (Effect::Ranges, &["A1", "A3"][..]));
    near(loss.accelerometers, 0.2e-3 * 10.0 * GRAVITY);
    assert_eq!(loss.gyroscopes, None, "PX4 has a range for each kind of sensor");
    let found = left(&one_narrow, Autopilot::Px4, Effect::Ranges, [-60.0, 100.0]);
    assert!((found / (2e-3 * GRAVITY) - 1.0).abs() < 1e-3, "{found}");
    // Kinds with ranges of their own: PX4 can say so, ArduPilot cannot.
    let narrow = gyroscope(narrow);
    let kinds = parsed(&table([&a, &a, &a], [&narrow, &narrow, &narrow]));
    assert!(export(&kinds, &options(Autopilot::Px4, Vec::new())).unwrap().lost.is_empty());
    let [loss] = &losses(&kinds, &options(Autopilot::ArduPilot, Vec::new()))[..] else { panic!() };
    assert_eq!(loss.sensors, ["A1", "A2", "A3"]);
    // No temperature in all of them.
    for drop in [Vec::new(), vec![Effect::Ranges]] {
        let exported = export(&with_second("[71.0, 80.0]"), &options(Autopilot::Px4, drop));
        assert_eq!(exported, Err(ExportError::NoCommonRange));
    }
}

#[test]
fn temperature_that_is_no_temperature() {
    let volts = parsed(&mixed().replace("\"degC\"", "\"V\""));
    let all = Effect::NAMES.map(|(effect, _)| effect).to_vec();
    for autopilot in BOTH {
        let error = export(&volts, &options(autopilot, all.clone())).unwrap_err();
        assert_eq!(error, ExportError::Unit("V".to_owned()));
    }
    for unit in ["degC", "\u{b0}C", "C"] {
        let celsius = parsed(&mixed().replace("\"degC\"", &format!("\"{unit}\"")));
        assert!(export(&celsius, &options(Autopilot::Px4, Vec::new())).is_ok());
    }
}

#[test]
fn a_range_too_narrow_for_float32_is_refused() {
    let narrow = "unit = \"mg0\", range = [25.0, 25.0000001], c0 = 1.0";
    let rate = "unit = \"deg/h\", range = [-30.0, 70.0], c0 = 12.0";
    let error = export(&parsed(&table([narrow; 3], [rate; 3])), &options(Autopilot::Px4, Vec::new())).unwrap_err();
    assert!(matches!(error, ExportError::Float32(_)), "{error}");
}

#[test]
fn effects_have_names() {
    for (effect, name) in Effect::NAMES {
        assert_eq!((effect.name(), name.parse()), (name, Ok(effect)));
    }
    let error = "scale".parse::<Effect>().unwrap_err();
    assert!(error.contains("give one of scale-temperature, negative-scale, alignment, lag"), "{error}");
}
