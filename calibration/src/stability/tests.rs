//! Stability of simulated runs whose truth is known.

use super::*;
use crate::simulate::{Chain, MISALIGNMENT, Noise, RunSchedule, Truth, run};

fn truth() -> Truth {
    let table = CoefficientTable::from_toml(include_str!("../../../examples/tables/imu-paper.toml"), None);
    Truth::new(table.unwrap().content().clone(), MISALIGNMENT, [0.0; 2], 9.79).unwrap()
}

fn stability(truth: &Truth, attitude: Option<[f64; AXES]>, change: impl Fn(usize, &mut RawSample)) -> Stability {
    let schedule = RunSchedule {
        direction: [0.6, -0.48, 0.64],
        ramp_c_per_s: 70.0 / 3600.0,
        hold_s: 60.0,
        interval_ns: 1_000_000_000,
        chain: Chain::default(),
        noise: Noise::NONE,
        ..RunSchedule::default()
    };
    let mut collector = Collector::new(&truth.table, 10.0);
    for (index, mut raw) in run(truth, &schedule, 1).enumerate() {
        change(index, &mut raw);
        collector.add(&raw);
    }
    collector.finish(&Setup { attitude, gravity_local: 9.79 }).unwrap()
}

#[test]
fn the_truth_is_stable_and_as_long_as_gravity() {
    let found = stability(&truth(), Some([0.6, -0.48, 0.64]), |_, _| {});
    assert_eq!(found.windows.len(), 372);
    assert!(found.windows.iter().all(|window| window.counts && window.still && !window.flagged));
    for axis in &found.axes {
        // Pulses are whole: the output of a window is uncertain by one or two pulses in 10 s.
        assert!(axis.rms_after < 3e-6 && axis.factor() > 50.0, "{axis:?}");
        assert!(axis.sd_before > 100e-6 && axis.rms_before >= axis.sd_before * 0.99, "{axis:?}");
    }
    let modulus = found.modulus.unwrap();
    assert!(modulus.windows == 372 && modulus.mean.abs() < 0.5e-6 && modulus.worst < 5e-6, "{modulus:?}");
    assert!((found.resolution[0][0].unwrap() - 76e-6).abs() < 2e-6, "{:?}", found.resolution);
}

#[test]
fn a_constant_error_shows_only_at_a_stated_attitude() {
    let mut content = truth().table.content().clone();
    let bias = &mut content.axes[1].bias;
    let mut coefficients = bias.coefficients().to_vec();
    coefficients[0] += 50.0;
    *bias = Polynomial::new(&coefficients, 0.0, 1.0, bias.range()).unwrap();
    let (right, wrong) = (truth(), CoefficientTable::new(content).unwrap());
    let off = Truth { table: wrong, ..right.clone() };
    let run_with = |attitude| {
        let mut collector = Collector::new(&off.table, 10.0);
        for raw in
            run(&right, &RunSchedule { interval_ns: 10_000_000_000, noise: Noise::NONE, ..RunSchedule::default() }, 1)
        {
            collector.add(&raw);
        }
        collector.finish(&Setup { attitude, gravity_local: 9.79 }).unwrap()
    };
    let stated = run_with(Some([0.6, -0.48, 0.64]));
    assert!(stated.stated && (stated.axes[1].rms_after - 50e-6).abs() < 2e-6 && stated.axes[1].sd_after < 2e-6);
    let median = run_with(None);
    assert!(!median.stated && median.axes[1].rms_after < 2e-6);
}

#[test]
fn windows_with_motion_do_not_count() {
    let found = stability(&truth(), None, |index, raw| {
        if (1000..1100).contains(&index) {
            raw.positive_pulses[0] += 4000;
        }
    });
    let counted = found.windows.iter().filter(|window| window.counts).count();
    assert_eq!((found.windows.len() - counted, found.modulus.unwrap().windows), (10, 372 - 4));
    assert!(found.axes[0].sd_after < 3e-6);
}

#[test]
fn a_window_that_is_not_a_number_on_any_axis_does_not_count() {
    for axis in 0..AXES {
        let found = stability(&truth(), Some([0.6, -0.48, 0.64]), |index, raw| {
            if index == 1_500 {
                raw.head_temperature[axis] = f64::NAN;
            }
        });
        let of_axis = &found.axes[axis];
        let left_out = &found.windows[150];
        assert!(left_out.after[axis].is_nan() && !left_out.counts && !left_out.still, "{left_out:?}");
        assert_eq!(found.windows.iter().filter(|window| !window.counts).count(), 1, "axis {axis}");
        assert!(of_axis.rms_after < 3e-6 && of_axis.factor() > 50.0, "{of_axis:?}");
        let modulus = found.modulus.unwrap();
        assert!(modulus.mean.abs() < 0.5e-6 && modulus.worst < 5e-6, "{modulus:?}");
    }
}

#[test]
fn too_few_windows_are_refused() {
    let truth = truth();
    let setup = Setup { attitude: Some([0.0, 0.0, 1.0]), gravity_local: 9.8 };
    let short = Collector::new(&truth.table, 10.0).finish(&setup).unwrap_err();
    assert_eq!(short, StabilityError::TooShort { windows: 0, window_s: 10.0 });
    let mut collector = Collector::new(&truth.table, 10.0);
    run(&truth, &RunSchedule { interval_ns: 10_000_000_000, ..RunSchedule::default() }, 1)
        .for_each(|raw| collector.add(&raw));
    assert!(matches!(collector.finish(&setup), Err(StabilityError::OffAttitude { counted: 0, .. })));
}
