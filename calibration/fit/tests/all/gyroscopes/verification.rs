//! Verification runs of a whole IMU whose truth is known.

use super::station::{Random, Station};
use isotherm_report as report;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, Content, Turntable};
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_verification::{Collector, Estimate, GyroscopeStability, LocalGravity, Requirement, Setup, Stability};

const ANGLES: [f64; 2] = [50.0, 130.0];
const WINDOW_S: f64 = 10.0;

/// The station with the noise of the sensors, and pulses so fine that their rounding does not count.
fn station(seed: u64) -> Station {
    Station { random_walk: 0.003 * 60.0, ..Station::new(seed) }.fine()
}

pub(crate) fn verified(table: &CoefficientTable, samples: &[RawSample], angles: Option<[f64; 2]>) -> Stability {
    let mut collector = Collector::new(table, WINDOW_S);
    samples.iter().for_each(|sample| collector.add(sample));
    let setup = Setup::new(None, LocalGravity::of(None, table)).at_angles(table, angles).unwrap();
    collector.finish(&setup).unwrap()
}

fn gyroscopes(stability: &Stability) -> &GyroscopeStability {
    stability.judged_gyroscopes().unwrap()
}

/// The table with another content, measured at the same station.
pub(crate) fn changed(table: &CoefficientTable, change: impl FnOnce(&mut Content)) -> CoefficientTable {
    let mut content = table.content().clone();
    change(&mut content);
    let (gravity, turntable) = (table.gravity_local(), table.turntable().copied());
    CoefficientTable::new(content).unwrap().measured_at(gravity).measured_on(turntable)
}

/// The table with a bias of this gyroscope that is off by `error` [deg/h].
pub(crate) fn off(table: &CoefficientTable, axis: usize, error: f64) -> CoefficientTable {
    changed(table, |content| {
        let bias = &mut content.gyroscopes.as_mut().unwrap().axes[axis].bias;
        let mut coefficients = bias.coefficients().to_vec();
        coefficients[0] += error;
        *bias = Polynomial::new(&coefficients, 0.0, 1.0, bias.range()).unwrap();
    })
}

fn judged(require: &str, stability: &Stability) -> Result<(), String> {
    require.parse::<Requirement>().unwrap().check(stability)
}

#[test]
fn the_truth_has_no_constant_error_and_no_variation() {
    let station = Station { random_walk: 0.0, ..station(3) };
    let found = verified(&station.table(), &station.run(ANGLES, 400), Some(ANGLES));
    let gyroscopes = gyroscopes(&found);
    for (errors, axis) in gyroscopes.errors.iter().zip(&gyroscopes.axes) {
        assert!(errors.worst.most() < 0.005 && errors.constant.unwrap().value.abs() < 2e-4, "{errors:?}");
        assert!(axis.sd_before > 0.3 && axis.factor() > 100.0, "{axis:?}");
    }
    assert_eq!((gyroscopes.missing(), gyroscopes.unjudged(), found.nothing_claimed()), (None, None, None));
    assert_eq!(judged("rate=0.02deg/h,bias=20ug0,level=5arcsec,factor=10", &found), Ok(()));
    assert!(judged("rate=1e-6deg/h", &found).is_err());
}

/// 200 runs of an hour: 600 gyroscopes. Earth's horizontal rate is known with standard errors of 0.004 and 0.006 deg/h,
/// those of 15 set points.
#[test]
fn intervals_contain_the_truth_at_their_rate() {
    const RUNS: u64 = 200;
    let (mut constant, mut variation, mut walk, mut without_earth) = (0_u32, 0_u32, 0_u32, 0_u32);
    for seed in 0..RUNS {
        let station = station(seed);
        let mut random = Random(seed ^ 0xEA27);
        let errors = [0.004, 0.006];
        let mut turntable = station.turntable();
        // What a fit of 15 set points says of its errors scatters, as chi squared with 14 degrees of freedom.
        turntable.earth_rate_standard_error = Some(errors.map(|error| {
            let squares: f64 = (0..turntable.freedom).map(|_| random.normal().powi(2)).sum();
            error * (squares / turntable.freedom as f64).sqrt()
        }));
        (0..2).for_each(|k| turntable.earth_rate_deg_h[k] += errors[k] * random.normal());
        let table = station.table().measured_on(Some(turntable));
        let angles = [360.0 * random.uniform(), 360.0 * random.uniform()];
        let found = verified(&table, &station.run(angles, 360), Some(angles));
        let found = gyroscopes(&found);
        let of_earth = found.earth_rate.unwrap().interval.unwrap();
        for (axis, of_earth) in of_earth.into_iter().enumerate() {
            let errors = found.errors[axis];
            let holds = |it: Estimate| u32::from(it.value.abs() <= it.interval);
            let middle = errors.constant.unwrap();
            constant += holds(middle);
            without_earth += u32::from(middle.value.powi(2) <= middle.interval.powi(2) - of_earth.powi(2));
            variation += holds(errors.variation);
            walk += u32::from((found.random_walk[axis].value - 0.003).abs() <= found.random_walk[axis].interval);
        }
    }
    let percent =
        [constant, variation, walk, without_earth].map(|count| f64::from(count) / (3.0 * RUNS as f64) * 100.0);
    println!("within 95 %: constant, variation, random walk, constant without the errors of Earth's rate: {percent:?}");
    // 600 trials scatter by 0.9 %. Two half widths are joined as if both were normal, which is a little too wide.
    assert!((93.0..=98.5).contains(&percent[0]), "{percent:?}");
    assert!((93.0..=99.0).contains(&percent[1]), "{percent:?}");
    assert!((92.5..=97.5).contains(&percent[2]), "{percent:?}");
    assert!(percent[3] < 90.0, "{percent:?}");
}

#[test]
fn a_wrong_bias_is_found_with_its_size_and_its_gyroscope() {
    let station = station(5);
    let (table, run) = (station.table(), station.run(ANGLES, 1440));
    for axis in 0..3 {
        let found = verified(&off(&table, axis, 0.05), &run, Some(ANGLES));
        // The matrix of the table mixes 5e-4 of it into the others.
        let constant = gyroscopes(&found).errors[axis].constant.unwrap();
        assert!((constant.value + 0.05).abs() < constant.interval.max(0.005), "{constant:?}");
        assert!(constant.interval < 0.01, "{constant:?}");
        let name = ["G1", "G2", "G3"][axis];
        let message = judged("rate=0.03deg/h", &found).unwrap_err();
        assert!(
            message.contains(&format!("rate: {name} 0.0")) && message.contains("at most 0.0300 deg/h"),
            "{message}"
        );
        assert!(gyroscopes(&found).conclusion().contains(&format!("is that of {name}, 0.0")));
    }
    // A slope of the bias is variation.
    let slope = changed(&table, |content| {
        let bias = &mut content.gyroscopes.as_mut().unwrap().axes[1].bias;
        let mut coefficients = bias.coefficients().to_vec();
        (coefficients[0], coefficients[1]) = (coefficients[0] - 0.25, coefficients[1] + 0.1);
        *bias = Polynomial::new(&coefficients, 0.0, 1.0, bias.range()).unwrap();
    });
    let errors = gyroscopes(&verified(&slope, &run, Some(ANGLES))).errors[1];
    assert!((errors.variation.value - 0.14).abs() < 0.04, "{errors:?}");
}

/// Along the vertical the wrong hemisphere is 2 w_Z off, whatever the attitude.
#[test]
fn the_wrong_hemisphere_shows() {
    let station = Station { latitude: 39.9, ..station(7) };
    let table = station.table();
    let wrong = |turntable: &mut Turntable| turntable.earth_rate_deg_h[2] *= -1.0;
    let mut turntable = station.turntable();
    wrong(&mut turntable);
    let found = verified(&table.measured_on(Some(turntable)), &station.run(ANGLES, 360), Some(ANGLES));
    let errors = gyroscopes(&found).errors.map(|errors| errors.constant.unwrap().value);
    let size = errors.iter().map(|error| error * error).sum::<f64>().sqrt();
    assert!((size - 2.0 * 15.041_067 * libm::sin(39.9_f64.to_radians())).abs() < 0.05, "{errors:?}");
    assert!(judged("rate=1deg/h", &found).is_err());
    // Angles that are not those of the run are another attitude, or another heading.
    let (table, run) = (station.table(), station.run([0.0, 20.0], 360));
    let other_heading = verified(&table, &run, Some([0.0, 25.0]));
    assert!(judged("bias=20ug0,level=20arcsec", &other_heading).is_ok());
    assert!(judged("rate=0.2deg/h", &other_heading).is_err());
}

#[test]
fn without_the_angles_only_the_variation_is_judged() {
    let station = station(9);
    let (table, run) = (off(&station.table(), 0, 3.0), station.run(ANGLES, 360));
    let found = verified(&table, &run, None);
    let errors = &gyroscopes(&found).errors;
    assert!(errors.iter().all(|errors| errors.constant.is_none() && errors.worst.most() < 0.2), "{errors:?}");
    let message = judged("rate=0.1deg/h", &found).unwrap_err();
    assert!(message.contains("not judged, without the angles of the turntable only the variation"), "{message}");
    assert!(message.ends_with("remedy: give --angles OUTER,INNER, the angles in the run"), "{message}");
    let text = report::text::stability(&found, WINDOW_S, true);
    for words in [
        "Gyroscopes: means over 10 s of output minus its median [deg/h]",
        "; give --angles OUTER,INNER",
        "The largest error of the gyroscopes that could be judged is that of G",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(!text.contains("Earth's rate ("), "{text}");
    let json = report::json::verification(&found, WINDOW_S, None);
    let part = &json["gyroscopes"];
    assert!(part["axes"][0]["constant_deg_h"].is_null() && part["earth_rate_deg_h"].is_null(), "{part}");
    assert!(part["not_judged"].as_str().unwrap().contains("--angles"), "{part}");
    // A table that has no Earth's rate: angles say nothing.
    let bare = station.table().measured_on(None);
    let missing = gyroscopes(&verified(&bare, &run, None)).missing().unwrap();
    assert!(missing[1].contains("earth_rate_deg_h"), "{missing:?}");
    let setup = Setup::new(None, LocalGravity::Unknown);
    assert!(setup.at_angles(&bare, Some(ANGLES)).unwrap_err().contains("earth_rate_deg_h"));
    // The stated attitude must be that of the angles.
    let of = |attitude| Setup::new(Some(attitude), LocalGravity::Unknown).at_angles(&table, Some(ANGLES));
    assert!(of([0.5868, -0.4924, 0.6428]).is_ok());
    let message = of([0.6, -0.48, 0.64]).unwrap_err();
    assert!(message.contains("the angles give (0.58") && message.contains("the attitude is (0.6000"), "{message}");
}

#[test]
fn what_only_the_table_or_only_the_recording_has_is_named() {
    let station = station(11);
    let (table, run) = (station.table(), station.run(ANGLES, 60));
    let plain_run: Vec<_> = run.iter().map(|raw| RawSample { gyroscopes: Triad::default(), ..*raw }).collect();
    let plain_table = changed(&table, |content| content.gyroscopes = None);
    for (table, run, words) in [
        (&table, &plain_run, "The gyroscopes are not judged: the table has gyroscopes, the recording has none.\n"),
        (&plain_table, &run, "The gyroscopes are not judged: the recording has gyroscopes, the table has none.\n"),
    ] {
        let found = verified(table, run, Some(ANGLES));
        assert!(report::text::stability(&found, WINDOW_S, true).ends_with(words));
        assert!(report::json::verification(&found, WINDOW_S, None)["gyroscopes"]["not_judged"].is_string());
        assert!(judged("rate=1deg/h", &found).unwrap_err().contains("not judged, the "));
        // The accelerometers are judged as ever.
        assert_eq!(judged("bias=20ug0,factor=1", &found), Ok(()));
        assert!(found.windows.iter().all(|window| window.counts && !window.flagged));
    }
    // Neither has any: not a word.
    let neither = verified(&plain_table, &plain_run, Some(ANGLES));
    assert!(!report::text::stability(&neither, WINDOW_S, true).contains("yroscope"));
    assert!(report::json::verification(&neither, WINDOW_S, None).get("gyroscopes").is_none());
    assert!(judged("rate=1deg/h", &neither).unwrap_err().contains("neither the table nor the recording"));
    // A gyroscope without output does not hide the accelerometers.
    let dead: Vec<_> = run
        .iter()
        .map(|raw| {
            let mut raw = *raw;
            raw.gyroscopes.head_temperature[2] = f64::NAN;
            raw
        })
        .collect();
    let found = verified(&table, &dead, Some(ANGLES));
    assert!(matches!(&found.gyroscopes, Some(Err(reason)) if reason.contains("look at g3_head and g3_board")));
    assert_eq!(judged("bias=20ug0", &found), Ok(()));
    assert!(found.windows.iter().all(|window| !window.flagged));
}

/// Turning about the vertical, the accelerometers feel nothing.
#[test]
fn an_imu_that_turned_is_not_judged() {
    let station = station(13);
    let (table, run) = (station.table(), station.run([0.0, 0.0], 400));
    let turned = |windows: usize| {
        let mut run = run.clone();
        // 0.05 deg/s along the vertical.
        for raw in &mut run[100..100 + windows] {
            raw.gyroscopes.positive_pulses[2] += (1800.0 * 0.97 * 50.0) as u32;
        }
        verified(&table, &run, Some([0.0, 0.0]))
    };
    assert_eq!(judged("rate=0.3deg/h,factor=1", &turned(4)), Ok(()));
    let found = turned(5);
    let reason = gyroscopes(&found).unjudged().unwrap();
    assert!(reason.starts_with("5 of 400 windows are not at rest"), "{reason}");
    assert!(judged("rate=0.3deg/h", &found).unwrap_err().contains(&reason));
    assert_eq!(judged("bias=20ug0", &found), Ok(()));
    let text = report::text::stability(&found, WINDOW_S, true);
    assert!(text.ends_with(&format!("Nothing can be claimed of the gyroscopes: {reason}.\n")), "{text}");
    assert!(report::json::verification(&found, WINDOW_S, None)["gyroscopes"]["largest"].is_null());
}

#[test]
fn the_g_sensitivity_is_part_of_the_full_model() {
    let station = station(15);
    let (table, run) = (station.table(), station.run(ANGLES, 360));
    let without = changed(&table, |content| content.gyroscopes.as_mut().unwrap().g_sensitivity = [None; 3]);
    let (right, wrong) = (verified(&table, &run, Some(ANGLES)), verified(&without, &run, Some(ANGLES)));
    let force = right.specific_force;
    for (axis, truth) in station.gyroscopes.iter().enumerate() {
        let expected: f64 = truth.s.iter().zip(force).map(|(s, f)| s * f).sum();
        let constant = |found: &Stability| gyroscopes(found).errors[axis].constant.unwrap();
        assert!((constant(&wrong).value - expected).abs() < 0.03, "{expected} {:?}", constant(&wrong));
        assert!(constant(&right).value.abs() < 0.03, "{:?}", constant(&right));
    }
}
