//! The gate for tables of a whole IMU: what it lets pass, and what it refuses.

use super::station::Station;
use super::verification::{changed, off, verified};
use isotherm_fit::{Calibration, CalibrationOptions};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, Content, Gyroscopes};
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_verification::{ExercisedChannels, Gate, GateRefusal, Requirement};
use nalgebra::{Matrix3, Rotation3};
use std::collections::BTreeSet;

/// Two opposite attitudes, which drive every channel of the accelerometers.
const ATTITUDES: [[f64; 2]; 2] = [[50.0, 130.0], [230.0, 130.0]];

/// A campaign with noise, and runs of the same IMU.
struct Laboratory {
    calibration: Calibration,
    truth: CoefficientTable,
    runs: [Vec<RawSample>; 2],
}

impl Laboratory {
    fn new(seed: u64) -> Self {
        let station = Station::new(seed).noisy();
        let calibration = station.calibrate(CalibrationOptions::default()).unwrap();
        // The runs end inside the set points: the ends of the table's range are those of its data.
        let inside = Station { set_points: vec![-24.0, 44.0], ..station.clone() };
        Self {
            calibration,
            truth: as_measured(&station.table()),
            runs: ATTITUDES.map(|angles| inside.run(angles, 1440)),
        }
    }

    /// The calibration with another table.
    fn with(&self, change: impl FnOnce(&CoefficientTable) -> CoefficientTable) -> Calibration {
        Calibration { table: change(&self.calibration.table), ..self.calibration.clone() }
    }

    /// What refuses the table, by kind and in words; and what is not judged.
    fn refused(
        &self,
        calibration: &Calibration,
        in_force: Option<&CoefficientTable>,
        require: &str,
        in_use: fn(&mut RawSample),
    ) -> (BTreeSet<&'static str>, String, Vec<String>) {
        let require = if require.is_empty() { Requirement::default() } else { require.parse().unwrap() };
        let gate = Gate::new(require, calibration, [0.6, 0.5, 0.65]).unwrap();
        let mut refusals = gate.refuses_table(calibration, in_force);
        let mut exercised = ExercisedChannels::default();
        for (angles, run) in ATTITUDES.into_iter().zip(&self.runs) {
            let mut run = run.clone();
            run.iter_mut().for_each(in_use);
            // The place is that of the new table, whatever the table in force says.
            let turntable = self.calibration.table.turntable().copied();
            let stability = |table: &CoefficientTable| {
                let table = table.clone().measured_at(self.truth.gravity_local()).measured_on(turntable);
                verified(&table, &run, Some(angles))
            };
            let found = stability(&calibration.table);
            exercised.add(&found);
            refusals.extend(gate.refuses_run(&found, in_force.map(stability).as_ref()));
        }
        refusals.extend(gate.refuses_together(&exercised, &calibration.table, in_force));
        let causes: Vec<_> = refusals.iter().map(|GateRefusal { cause, .. }| cause.as_str()).collect();
        let text = causes.join("\n");
        (refusals.iter().map(|refusal| refusal.by).collect(), text, exercised.not_judged(&calibration.table))
    }
}

/// With ranges as a campaign has them.
fn as_measured(table: &CoefficientTable) -> CoefficientTable {
    let within = |curve: &Polynomial, range: [f64; 2]| Polynomial::new(curve.coefficients(), 0.0, 1.0, range).unwrap();
    changed(table, |content| {
        for axis in content.axes.iter_mut().chain(&mut content.gyroscopes.as_mut().unwrap().axes) {
            axis.bias = within(&axis.bias, [1.05, 4.0]);
            axis.positive_scale_factor = within(&axis.positive_scale_factor, [1.15, 4.08]);
            axis.negative_scale_factor = within(&axis.negative_scale_factor, [1.15, 4.08]);
        }
    })
}

fn gyroscopes(table: &CoefficientTable, change: impl FnOnce(&mut Gyroscopes)) -> CoefficientTable {
    changed(table, |content: &mut Content| change(content.gyroscopes.as_mut().unwrap()))
}

fn without_gyroscopes(table: &CoefficientTable) -> CoefficientTable {
    changed(table, |content| content.gyroscopes = None)
}

fn as_used(_: &mut RawSample) {}

fn times(curve: &Polynomial, factor: f64) -> Polynomial {
    let coefficients: Vec<_> = curve.coefficients().iter().map(|c| c * factor).collect();
    Polynomial::new(&coefficients, curve.center(), curve.scale(), curve.range()).unwrap()
}

fn set<const N: usize>(names: [&'static str; N]) -> BTreeSet<&'static str> {
    names.into_iter().collect()
}

#[test]
fn a_good_table_passes_and_a_wrong_one_is_refused_by_what_shows_it() {
    let laboratory = Laboratory::new(4);
    let good = &laboratory.calibration;
    let (truth, plain) = (&laboratory.truth, without_gyroscopes(&laboratory.truth));
    for in_force in [None, Some(truth), Some(&plain), Some(&good.table)] {
        let (by, text, not_judged) = laboratory.refused(good, in_force, "", as_used);
        assert_eq!(by, set([]), "{text}");
        assert!(
            not_judged.last().unwrap().starts_with("scale factors and misalignments of the gyroscopes"),
            "{not_judged:?}"
        );
    }
    let bound = Gate::new(Requirement::default(), good, [0.6; 3]).unwrap().require.rate.unwrap();
    println!("the bound of the fit: {bound} deg/h");
    assert!(bound > 0.1 && bound < 0.6, "{bound}");

    // Bias, its slope, and the g-sensitivity along the force: the runs show them, with or without a table in force.
    let bias = laboratory.with(|table| off(table, 1, 0.8));
    let (by, text, _) = laboratory.refused(&bias, None, "", as_used);
    assert_eq!(by, set(["rate"]), "{text}");
    assert!(text.contains("rate: G2 0."), "{text}");
    let (by, text, _) = laboratory.refused(&bias, Some(truth), "rate=5deg/h", as_used);
    assert_eq!(by, set(["table in force"]), "{text}");
    assert!(text.contains("worse than the table in force: G2 is off by 0."), "{text}");
    // Nothing is compared with a table that has no gyroscopes.
    assert_eq!(laboratory.refused(&bias, Some(&plain), "rate=5deg/h", as_used).0, set([]));
    let slope = laboratory.with(|table| {
        gyroscopes(table, |part| {
            let bias = &mut part.axes[2].bias;
            let mut coefficients = bias.coefficients().to_vec();
            coefficients[1] += 0.8;
            *bias = Polynomial::new(&coefficients, bias.center(), bias.scale(), bias.range()).unwrap();
        })
    });
    assert_eq!(laboratory.refused(&slope, None, "", as_used).0, set(["rate"]));

    // In use a gyroscope is the other way round.
    let reversed = |raw: &mut RawSample| {
        let Triad { positive_pulses, negative_pulses, .. } = &mut raw.gyroscopes;
        core::mem::swap(&mut positive_pulses[0], &mut negative_pulses[0]);
    };
    let (by, text, _) = laboratory.refused(good, None, "", reversed);
    assert!(by.contains("rate") && text.contains("rate: G1 "), "{text}");

    // The runs have no gyroscopes, or the new table has lost them.
    let (by, text, _) = laboratory.refused(good, None, "", |raw| raw.gyroscopes = Triad::default());
    assert!(by == set(["rate", "runs"]) && text.contains("the recording has none"), "{text}");
    let lost = Calibration { gyroscopes: None, ..laboratory.with(without_gyroscopes) };
    let (by, text, not_judged) = laboratory.refused(&lost, Some(truth), "", as_used);
    assert_eq!(by, set(["gyroscopes"]), "{text}");
    assert!(text.contains("the table in force has gyroscopes, the new one has none"), "{text}");
    assert_eq!(not_judged, Vec::<String>::new());
    assert_eq!(laboratory.refused(&lost, Some(&plain), "", as_used).0, set([]));
}

#[test]
fn what_no_run_at_rest_shows_must_agree_with_the_table_in_force() {
    let laboratory = Laboratory::new(6);
    let truth = &laboratory.truth;
    let check = |change: &dyn Fn(&mut Gyroscopes), words: &str| {
        let wrong = laboratory.with(|table| gyroscopes(table, change));
        let (by, text, _) = laboratory.refused(&wrong, Some(truth), "", as_used);
        assert_eq!(by, set(["gyroscopes"]), "{words}: {text}");
        assert!(text.contains(words), "{words}: {text}");
        // This is not known without gyroscopes in force.
        assert_eq!(laboratory.refused(&wrong, Some(&without_gyroscopes(truth)), "", as_used).0, set([]), "{words}");
        assert_eq!(laboratory.refused(&wrong, None, "", as_used).0, set([]), "{words}");
    };
    check(
        &|part| part.axes[0].negative_scale_factor = times(&part.axes[0].negative_scale_factor, 1.0002),
        "K- of G1, which no run at rest shows, is 20",
    );
    check(
        &|part| {
            let matrix = part.alignment.unwrap() * Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 1e-4, 0.0, 0.0, 1.0);
            part.alignment = Some(matrix);
        },
        "the misalignment of G2 against the accelerometers, which no run at rest shows, is ",
    );
    // Across both attitudes, which are opposite: the specific force is (0.587, -0.492, 0.643) there.
    check(
        &|part| {
            let s = part.g_sensitivity[2].as_mut().unwrap();
            (s[0], s[1]) = (s[0] + 0.492, s[1] + 0.587);
        },
        "the g-sensitivity of G3 across the specific forces of the runs, which no run at rest shows, is 0.7",
    );
    // A user who knows better states it.
    let wrong = laboratory.with(|table| {
        gyroscopes(table, |part| {
            part.axes[0].negative_scale_factor = times(&part.axes[0].negative_scale_factor, 1.0002);
        })
    });
    assert_eq!(laboratory.refused(&wrong, Some(truth), "scale=300ppm", as_used).0, set([]));
    // The IMU sits otherwise on the fixture: both triads turn alike.
    let turned = Rotation3::from_euler_angles(3e-4, -2e-4, 1e-4).into_inner();
    let remounted = changed(truth, |content| {
        content.alignment = content.alignment.map(|matrix| turned * matrix);
        let part = content.gyroscopes.as_mut().unwrap();
        part.alignment = part.alignment.map(|matrix| turned * matrix);
    });
    let (by, text, _) = laboratory.refused(&laboratory.calibration, Some(&remounted), "", as_used);
    assert_eq!(by, set([]), "{text}");
    // A range that is smaller than that in force.
    let wide = gyroscopes(truth, |part| {
        let bias = &part.axes[1].bias;
        part.axes[1].bias = Polynomial::new(bias.coefficients(), 0.0, 1.0, [0.5, 4.6]).unwrap();
    });
    let (by, text, _) = laboratory.refused(&laboratory.calibration, Some(&wide), "", as_used);
    assert!(by == set(["range"]) && text.contains("bias of G2 covers "), "{text}");
}

#[test]
fn the_other_hemisphere_is_refused_unless_it_is_accepted() {
    let station = Station::new(5);
    let fit = |accept: &[&'static str]| {
        let stated = Station { stated_latitude: Some(-station.latitude), ..station.clone() };
        let calibration =
            stated.calibrate(CalibrationOptions { accept: accept.to_vec(), ..Default::default() }).unwrap();
        let gate = Gate::new(Requirement::default(), &calibration, [0.6, 0.5, 0.65]).unwrap();
        gate.refuses_table(&calibration, None)
    };
    let refusals = fit(&[]);
    assert!(refusals.iter().any(|refusal| refusal.by == "latitude" && refusal.cause.contains("the other hemisphere")));
    assert!(fit(&["latitude"]).iter().all(|refusal| refusal.by != "latitude"));
}
