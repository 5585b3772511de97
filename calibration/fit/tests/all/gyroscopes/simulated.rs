//! Simulated campaigns of a whole IMU against their truth: `isotherm_simulation`, as `isotherm simulate
//! campaign --gyroscopes` drives it.

use isotherm_campaign::Campaign;
use isotherm_fit::{Calibration, CalibrationOptions, calibrate, read_measurements};
use isotherm_recording::CampaignRow;
use isotherm_shared::compensate::answer;
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_simulation::{
    CampaignSchedule, Chain, InertialMotion, MISALIGNMENT, Noise, RunSchedule, SimulatedImu, TILT_RAD, Truth,
    TurnSchedule, campaign, run, typical_gyroscopes, worst_gyroscope_errors,
};
use nalgebra::Vector3;

const PAPER: &str = include_str!("../../../../../examples/tables/imu-paper.toml");

/// What has to be met: D \[deg/h\], K \[ppm\], s \[deg/h/g0\], M \[rad\].
const BOUNDS: [f64; 4] = [0.013, 4.0, 0.006, 7e-7];

fn accelerometers() -> Content {
    CoefficientTable::from_toml(PAPER, None).unwrap().content().clone()
}

/// The paper's accelerometers with typical gyroscopes.
fn whole() -> Content {
    Content { format: 2, gyroscopes: typical_gyroscopes(&Chain::default()), ..accelerometers() }
}

fn truth() -> Truth {
    Truth::new(whole(), MISALIGNMENT, TILT_RAD, 9.8).unwrap()
}

fn schedule(angle_deg: f64) -> CampaignSchedule {
    CampaignSchedule { turns: Some(TurnSchedule::six_turns(13, angle_deg)), ..CampaignSchedule::default() }
}

fn calibrated(truth: &Truth, schedule: &CampaignSchedule, seed: u64) -> Calibration {
    let file =
        Campaign::from_toml(&schedule.campaign_toml(truth, "samples.csv")).unwrap_or_else(|faults| panic!("{faults}"));
    let rows = (2..).zip(campaign(truth, schedule, seed)).map(|(line, row)| {
        Ok(CampaignRow { line, set_point_c: row.set_point_c, position: Some(row.position), sample: row.raw })
    });
    let measurements = read_measurements(&file, rows).unwrap();
    calibrate(&file, measurements, CalibrationOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Calibrates a campaign, and compares the gyroscopes with the truth.
fn check(name: &str, truth: &Truth, angle_deg: f64, seed: u64) {
    let calibration = calibrated(truth, &schedule(angle_deg), seed);
    let errors = worst_gyroscope_errors(&calibration.table, &truth.table).unwrap();
    println!("{name}: {errors:?}");
    assert!(errors.iter().zip(BOUNDS).all(|(error, bound)| *error < bound), "{name}: {errors:?}");
    let earth = calibration.gyroscopes.as_ref().unwrap().solution.earth.unwrap();
    let [x, y, _] = truth.earth_rate();
    assert!((earth[0] - x).abs() < 0.006 && (earth[1] - y).abs() < 0.006, "{name}: {earth:?}, {x} {y}");
}

#[test]
fn a_simulated_campaign_gives_back_its_truth() {
    let truth = truth();
    check("360 deg", &truth, 360.0, 1);
    check("720 deg", &truth, 720.0, 2);
}

#[test]
fn any_latitude_heading_and_tilt() {
    for (seed, latitude_deg, heading_deg, tilt_rad) in
        [(3, -33.9, 200.0, [-7e-5, 5e-5]), (4, 69.6, 310.0, [5e-4, -4e-4]), (5, 0.0, 90.0, [0.0; 2])]
    {
        let truth = Truth { latitude_deg, heading_deg, tilt_rad, ..truth() };
        check(&format!("latitude {latitude_deg}"), &truth, 720.0, seed);
    }
}

#[test]
fn other_imus_in_other_laboratories() {
    for seed in 6..8 {
        let truth = Truth::varied(&whole(), seed).unwrap();
        check(&format!("varied {seed}"), &truth, 720.0, seed);
    }
}

/// The IMU's temperature without resolution and noise, in a chamber that does not oscillate.
fn steady() -> Chain {
    Chain { oscillation_c: 0.0, telemetry_lsb_micro: 0, ..Chain::default() }
}

#[test]
fn the_pulses_are_the_integral_of_the_motion_within_one_pulse() {
    let (truth, schedule) = (truth(), CampaignSchedule { chain: steady(), noise: Noise::NONE, ..schedule(360.0) });
    let content = truth.table.content().gyroscopes.clone().unwrap();
    for turn in &schedule.turns.as_ref().unwrap().turns {
        let schedule = CampaignSchedule {
            set_points_c: vec![20.0],
            positions: schedule.positions[..1].to_vec(),
            turns: schedule.turns.clone().map(|turns| TurnSchedule { turns: vec![turn.clone()], ..turns }),
            ..schedule.clone()
        };
        let rows: Vec<RawSample> =
            campaign(&truth, &schedule, 1).filter(|row| row.position == turn.start.number).map(|row| row.raw).collect();
        // 5 s of rest, 37 s, 5 s of rest.
        assert_eq!(rows.len(), 47);
        let seconds = rows.len() as f64;
        let mut sums = Triad::default();
        for raw in &rows {
            for i in 0..3 {
                sums.positive_pulses[i] += raw.gyroscopes.positive_pulses[i];
                sums.negative_pulses[i] += raw.gyroscopes.negative_pulses[i];
            }
        }
        // J of the method, with Ic = rests + rate/acceleration = 11 s and Is = 0: what is across the axis.
        let k = Vector3::from(turn.axis);
        let backwards = |v: Vector3<f64>| k * k.dot(&v) * seconds + (v - k * k.dot(&v)) * 11.0;
        let at_rest = InertialMotion::at_rest(&truth, turn.start.angles.unwrap(), 1.0);
        let angle = truth.gyroscope_misalignment() * (turn.turned() + backwards(at_rest.angle.into()));
        let force = backwards(at_rest.specific_force.into());
        for i in 0..3 {
            let axis = &content.axes[i];
            let head = rows[0].gyroscopes.head_temperature[i];
            let board = rows[0].gyroscopes.board_temperature[i];
            let indicated = angle[i]
                + axis.bias_at(head).0 * seconds
                + Vector3::from(content.g_sensitivity[i].unwrap()).dot(&force);
            let [plus, minus] = [axis.positive_scale_factor_at(board).0, axis.negative_scale_factor_at(board).0];
            let counted = f64::from(sums.positive_pulses[i]) / plus + f64::from(sums.negative_pulses[i]) / minus;
            // Up to one pulse is left over at each end.
            assert!((counted - indicated).abs() < 1.02 / plus, "{}: {counted} {indicated}", turn.start.number);
        }
        // Compensation with the truth takes bias and g-sensitivity off again.
        let turned: Vector3<f64> =
            rows.iter().map(|raw| Vector3::from(answer(Some(&truth.table), raw).angle_increment) / ARCSEC).sum();
        let right = turn.turned() + backwards(at_rest.angle.into());
        assert!((turned - right).amax() < 1.1, "{}: {turned} {right}", turn.start.number);
    }
}

#[test]
fn the_accelerometers_do_not_depend_on_the_gyroscopes() {
    let [with, without] = [whole(), accelerometers()].map(|content| Truth::varied(&content, 9).unwrap());
    assert_eq!(with.table.content().axes, without.table.content().axes);
    assert_eq!(
        (with.misalignment, with.tilt_rad, with.gravity_local),
        (without.misalignment, without.tilt_rad, without.gravity_local)
    );
    let schedule = RunSchedule { interval_ns: 20_000_000_000, ..RunSchedule::default() };
    for (a, b) in run(&with, &schedule, 9).zip(run(&without, &schedule, 9)) {
        assert_eq!(a.accelerometers, b.accelerometers);
        assert_eq!(b.gyroscopes, Triad::ABSENT);
        assert!(a.gyroscopes.head_temperature.iter().all(|temperature| *temperature > 1.0));
    }
}

#[test]
fn a_run_at_rest_has_the_angles_of_its_attitude() {
    let truth = Truth { tilt_rad: [4e-4, -3e-4], latitude_deg: -33.9, ..truth() };
    for direction in [[0.6, -0.48, 0.64], [-1.0, 0.0, 0.0], [0.3, 0.2, -0.9], [0.0, 1.0, 0.001]] {
        let schedule = RunSchedule { direction, chain: steady(), noise: Noise::NONE, ..RunSchedule::default() };
        let at_rest = InertialMotion::at_rest(&truth, schedule.angles_deg(&truth), 0.1);
        let force = schedule.specific_force(&truth);
        for i in 0..3 {
            assert!((at_rest.specific_force[i] - force[i]).abs() < 1e-14, "{at_rest:?} {force:?}");
        }
        // The truth compensates the hold of 1800 s to Earth's rate at these angles.
        let hold: Vector3<f64> = run(&truth, &schedule, 1)
            .take(17_000)
            .map(|raw| Vector3::from(answer(Some(&truth.table), &raw).angle_increment) / ARCSEC)
            .sum();
        assert!((hold / 1700.0 - Vector3::from(at_rest.angle) / 0.1).amax() < 2.0 / 1700.0, "{hold}");
    }
    // Along the inner axis a tilted base reaches the direction only within its tilt.
    let up = RunSchedule { direction: [0.0, 0.0, 1.0], ..RunSchedule::default() };
    assert!(up.angles_deg(&truth).iter().all(|angle| angle.is_finite()));
}

#[test]
fn noise_of_the_gyroscopes_has_the_stated_size() {
    let truth = truth();
    let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
    // 0.05 deg/sqrt(h) is 3 arcsec in 1 s, and 6 in 4 s; a pulse is 1 arcsec.
    let noise = Noise { random_walk: 0.05, ..Noise::NONE };
    let mut imu = SimulatedImu::new(&truth, &steady(), &noise, 20.0, 9);
    for (seconds, right) in [(1.0, 3.0), (4.0, 6.0)] {
        let motion = InertialMotion::at_rest(&truth, [0.0, 0.0], seconds);
        let values: Vec<f64> = (0..4000)
            .map(|_| {
                let raw = imu.step(&motion, (seconds * 1e9) as u64);
                answer(Some(&truth.table), &raw).angle_increment[1] / ARCSEC - motion.angle[1]
            })
            .collect();
        assert!((rms(&values) / right - 1.0).abs() < 0.06, "{}", rms(&values));
    }
    // One offset for each visit, constant during the visit.
    let noise = Noise { gyroscope_bias: 0.5, ..Noise::NONE };
    let mut imu = SimulatedImu::new(&truth, &steady(), &noise, 20.0, 9);
    let motion = InertialMotion::at_rest(&truth, [0.0, 0.0], 1000.0);
    let mut offsets = Vec::new();
    for _ in 0..200 {
        imu.visit();
        let [first, second] = [(); 2].map(|()| {
            let raw = imu.step(&motion, 1_000_000_000_000);
            (answer(Some(&truth.table), &raw).angle_increment[0] / ARCSEC - motion.angle[0]) / 1000.0
        });
        assert!((first - second).abs() < 0.003);
        offsets.push(first);
    }
    assert!((rms(&offsets) / 0.5 - 1.0).abs() < 0.15, "{}", rms(&offsets));
}
