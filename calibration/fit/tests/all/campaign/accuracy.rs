//! From rows to a table: the accuracy against the truth for lists of positions and both methods, and the warnings of
//! the fit.
//!
//! Over 400 lines: each test is one kind of campaign, and all of them share the simulated campaigns of `common`.

use super::common::{calibrated, campaign_file, csv, dwells, noiseless, paper, paper_truth as truth, quiet, worst};
use isotherm_campaign::{Campaign, Position, Scheme};
use isotherm_fit::{
    Accuracy, AlignmentChoice, Calibration, CalibrationOptions, Method, calibrate_accelerometers, reduce,
};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_simulation::{CampaignSchedule, InertialMotion, MISALIGNMENT, SimulatedRow, TILT_RAD, Truth, campaign};
use isotherm_support::finding::name;
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");
const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples");

fn shipped(options: CalibrationOptions) -> Calibration {
    let file = Campaign::from_toml(&fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap()).unwrap();
    let dwells = dwells(&file, &fs::read(format!("{EXAMPLES}/campaign/samples.csv")).unwrap()).unwrap();
    calibrate_accelerometers(&file, dwells, options).unwrap()
}

#[test]
fn the_campaign_with_a_known_truth() {
    let json: Value =
        serde_json::from_str(&fs::read_to_string(format!("{EXAMPLES}/campaign/truth.json")).unwrap()).unwrap();
    // The truth is the paper's tables; its ranges are wider than the campaign's.
    assert_eq!(json["truth"]["A3"]["kn"][3], paper().content().axes[2].negative_scale_factor.coefficients()[3]);
    for (method, limits) in [(Method::OneStage, [0.1, 0.38]), (Method::TwoStage, [0.11, 0.44])] {
        let calibration = shipped(CalibrationOptions { method, ..CalibrationOptions::default() });
        let found = worst(&calibration.table, &paper());
        println!("{}: bias {:.4}e-6 g0, scale factors {:.4} ppm", method.name(), found[0], found[1]);
        println!("{}", Accuracy::of(&calibration));
        assert!(found[0] < limits[0] && found[1] < limits[1], "{found:?}");
        for (name, tables) in ["A1", "A2", "A3"].iter().zip(&calibration.orders) {
            assert!(tables.iter().all(|table| table.choice.order == 3), "{name}");
        }
        for i in 0..3 {
            for j in 0..3 {
                let right = json["misalignment"][i][j].as_f64().unwrap();
                assert!((calibration.misalignment()[(i, j)] - right).abs() < 0.2e-6, "{i} {j}");
            }
        }
    }
    let tilt = shipped(CalibrationOptions::default()).solution.tilt.unwrap();
    assert!((tilt[0] - 4e-5).abs() < 0.1e-6 && (tilt[1] + 6e-5).abs() < 0.1e-6, "{tilt:?}");
}

#[test]
fn the_steps_of_the_temperature_are_in_the_figure_and_are_no_soak() {
    const STEP: f64 = 0.03;
    let truth = truth(TILT_RAD, 9.8015);
    let schedule = CampaignSchedule { noise: quiet(), ..CampaignSchedule::default() };
    let mut rows: Vec<SimulatedRow> = campaign(&truth, &schedule, 1).collect();
    let read = |value: &mut f64| *value = ((*value / STEP).round() * STEP * 1e6).round() / 1e6;
    for row in &mut rows {
        row.raw.accelerometers.head_temperature.iter_mut().for_each(read);
        row.raw.accelerometers.board_temperature.iter_mut().for_each(read);
    }
    let file = campaign_file(&truth, &schedule);
    let found = calibrate_accelerometers(&file, dwells(&file, &csv(rows)).unwrap(), CalibrationOptions::default());
    let found = found.unwrap();
    assert!(found.findings.iter().all(|finding| !finding.to_string().contains("soak")), "{:?}", found.findings);
    // In use a reading is off by up to half a step.
    let error = |axis: usize| {
        let [right, made] = [&truth.table, &found.table].map(|table| &table.content().axes[axis]);
        let [low, high] = made.bias.range();
        let points = (0..=1000).map(|k| low + (high - low) * f64::from(k) / 1e3);
        let off = |u: f64| (made.bias_at((u / STEP).round() * STEP).0 - right.bias_at(u).0).abs();
        points.map(off).fold(0.0, f64::max)
    };
    let stated = Accuracy::of(&found).bias.map(|interval| interval.unwrap());
    for (axis, stated) in stated.into_iter().enumerate() {
        println!("A{}: {:.3}e-6 g0, stated {:.3}", axis + 1, error(axis) * 1e6, stated * 1e6);
        assert!((0.9..3.0).contains(&(stated / error(axis))), "A{}", axis + 1);
    }
}

#[test]
fn other_campaigns_with_other_coefficients_gravity_and_tilt() {
    let schedule = CampaignSchedule { noise: quiet(), ..CampaignSchedule::default() };
    for seed in 1..=12 {
        let mut truth = Truth::varied(paper().content(), seed).unwrap();
        if seed % 3 == 0 {
            // A tilt far larger than the bias: the pairs of horizontal positions straddle zero.
            truth.tilt_rad = [4e-4, -3e-4];
        }
        for alignment in [false, true] {
            let alignment = AlignmentChoice::of(alignment, !alignment);
            let options = CalibrationOptions { alignment, ..CalibrationOptions::default() };
            let (_, calibration) = calibrated(&truth, &schedule, seed, options).unwrap();
            let found = worst(&calibration.table, &truth.table);
            println!("{seed}: bias {:.3}e-6 g0, scale factors {:.3} ppm", found[0], found[1]);
            assert!(found[0] < 0.35 && found[1] < 0.7, "{seed}: {found:?}");
        }
    }
}

#[test]
fn other_lists_of_positions() {
    let twenty: Vec<_> = [0.0, 35.0, 90.0, 145.0, 180.0, 215.0, 270.0, 325.0]
        .into_iter()
        .flat_map(|outer| [0.0, 72.0, 144.0, 216.0, 288.0].map(|inner| [outer, inner]))
        .zip(100..)
        .map(|([outer, inner], number)| Position::at(number, outer, inner))
        .collect();
    let lists = [Scheme::SixFacesSixEdges.positions(), Scheme::FourPointTumble.positions(), twenty];
    for positions in lists {
        let schedule = noiseless(positions);
        let truth = truth(TILT_RAD, 9.7936);
        let (_, calibration) = calibrated(&truth, &schedule, 1, CalibrationOptions::default()).unwrap();
        let found = worst(&calibration.table, &truth.table);
        // The drift within a dwell and the quantisation of the pulses remain.
        assert!(found[0] < 0.05 && found[1] < 0.1, "{} positions: {found:?}", schedule.positions.len());
        let tilt = calibration.solution.tilt.unwrap();
        assert!((tilt[0] - TILT_RAD[0]).abs() < 1e-7 && (tilt[1] - TILT_RAD[1]).abs() < 1e-7, "{tilt:?}");
    }
}

#[test]
fn the_tilt_is_estimated_through_any_mount_and_counts_in_both_methods() {
    let turn = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let oblique = *nalgebra::Rotation3::from_euler_angles(0.4, -0.3, 0.2).matrix();
    let truth = truth([5e-4, -3e-4], 9.79);
    for (scheme, mount) in
        [(Scheme::SixFacesSixEdges, turn), (Scheme::FourPointTumble, turn), (Scheme::SixFacesSixEdges, oblique)]
    {
        let schedule = noiseless(scheme.positions());
        // The IMU is mounted on another side of the fixture: its axes are not those of the turntable.
        let text = csv(mounted(&truth, &schedule, &mount));
        let mut file = campaign_file(&truth, &schedule);
        for position in &mut file.positions {
            let force = mount * Vector3::from(position.specific_force);
            // A few digits are sufficient if the mount only exchanges axes.
            let digits = if mount == turn { 1e3 } else { 1e12 };
            position.specific_force = force.map(|f| (f * digits).round() / digits).into();
        }
        let file = Campaign::from_toml(&campaign_toml(&file)).unwrap();
        for method in [Method::OneStage, Method::TwoStage] {
            let options = CalibrationOptions { method, order: Some(3), ..CalibrationOptions::default() };
            let calibration = calibrate_accelerometers(&file, dwells(&file, &text).unwrap(), options).unwrap();
            let found = worst(&calibration.table, &truth.table);
            let tilt = calibration.solution.tilt.unwrap();
            assert!((tilt[0] - 5e-4).abs() < 1e-7 && (tilt[1] + 3e-4).abs() < 1e-7, "{tilt:?}");
            // The two-stage values also contain the effect of the drift within a set point.
            let limit = if method == Method::OneStage { [0.1, 0.2] } else { [4.0, 4.0] };
            assert!(found[0] < limit[0] && found[1] < limit[1], "{scheme:?} {method:?}: {found:?}");
        }
    }
}

/// The rows of a campaign with the IMU rotated on the turntable by `mount`. The simulated IMU itself is not rotated;
/// the specific forces, with the level errors, are rotated instead.
fn mounted(truth: &Truth, schedule: &CampaignSchedule, mount: &Matrix3<f64>) -> Vec<SimulatedRow> {
    let gravity = truth.gravity_local / truth.table.content().gravity;
    let chain = &schedule.chain;
    let mut imu = isotherm_simulation::SimulatedImu::new(truth, chain, &schedule.noise, schedule.set_points_c[0], 1);
    let mut rows = Vec::new();
    for &set_point_c in &schedule.set_points_c {
        imu.go_to(set_point_c, schedule.ramp_c_per_s);
        imu.visit();
        imu.wait(4_200_000_000_000);
        for position in &schedule.positions {
            let [outer, inner] = position.angles.unwrap();
            let level = Vector3::from(isotherm_campaign::specific_force(outer, inner));
            let by_tilt = position.by_tilt().unwrap();
            let [tx, ty] = truth.tilt_rad;
            let change = Vector3::from([0, 1, 2].map(|i: usize| by_tilt[i][0] * tx + by_tilt[i][1] * ty));
            let force: [f64; 3] = (mount * ((level + change).normalize() * gravity)).into();
            imu.wait(60_000_000_000);
            for _ in 0..30 {
                rows.push(SimulatedRow {
                    set_point_c,
                    position: position.number,
                    raw: imu.step(&InertialMotion::of_force(force), 10_000_000_000),
                });
            }
        }
    }
    rows
}

/// The text of a campaign file with the positions of `file`.
fn campaign_toml(file: &Campaign) -> String {
    let unit = &file.temperature_unit;
    isotherm_simulation::campaign_toml(
        file.imu.as_str(),
        "samples.csv",
        file.gravity_reference,
        file.gravity_local,
        unit,
        &file.positions,
    )
}

#[test]
fn a_level_error_that_is_not_estimated_gives_a_warning() {
    let truth = truth([5e-4, 0.0], 9.8015);
    let calibrated = |scheme: Scheme, change: &dyn Fn(&mut Campaign), exclude: &[(f64, u32)]| {
        let schedule = noiseless(scheme.positions());
        let mut file = campaign_file(&truth, &schedule);
        change(&mut file);
        let dwells = dwells(&file, &csv(campaign(&truth, &schedule, 1))).unwrap();
        let options = CalibrationOptions { order: Some(3), exclude: exclude.to_vec(), ..CalibrationOptions::default() };
        calibrate_accelerometers(&file, dwells, options)
    };
    let warnings = |scheme: Scheme, change: &dyn Fn(&mut Campaign), exclude: &[(f64, u32)]| -> String {
        let calibration = calibrated(scheme, change, exclude).unwrap();
        calibration.findings.iter().map(|finding| format!("{finding}\n")).collect()
    };
    let no_angles = |file: &mut Campaign| file.mount = None;
    let text = warnings(Scheme::SixFacesSixEdges, &no_angles, &[]);
    assert!(
        text.contains("the base's tilt is not estimated, and not every direction was measured at two opposite"),
        "{text}"
    );
    let text = warnings(Scheme::SixFacesTwoHeadings, &no_angles, &[]);
    assert!(text.contains("which cancels only if each direction was measured at two opposite headings"), "{text}");
    let text = warnings(Scheme::SixFacesTwoHeadings, &no_angles, &[(0.0, 1)]);
    assert!(text.contains("not every direction was measured at two opposite"), "{text}");
    assert_eq!(warnings(Scheme::SixFacesTwoHeadings, &|_| {}, &[(0.0, 1)]), "");
    let text = warnings(Scheme::SixFacesTwoHeadings, &|file| file.positions.swap(0, 1), &[]);
    assert_eq!(text, "", "the order of the list does not matter");
    // Two headings of one face are exchanged: no tilt causes such residuals.
    let exchange = |file: &mut Campaign| {
        file.positions[0].number = 2;
        file.positions[1].number = 1;
    };
    let text = calibrated(Scheme::SixFacesTwoHeadings, &exchange, &[]).unwrap_err().to_string();
    assert!(text.starts_with("positions 1 and 2 look exchanged: exchange their numbers"), "{text}");
}

#[test]
fn a_curve_that_does_not_fit_gives_a_warning_about_the_curve_and_not_about_dwells() {
    let truth = truth(TILT_RAD, 9.8015);
    let warnings = |set_points_c: Vec<f64>, order: Option<usize>| -> String {
        let schedule = CampaignSchedule { set_points_c, noise: quiet(), ..CampaignSchedule::default() };
        let (_, calibration) =
            calibrated(&truth, &schedule, 1, CalibrationOptions { order, ..CalibrationOptions::default() }).unwrap();
        calibration.findings.iter().map(|finding| format!("{finding}\n")).collect()
    };
    let all = || CampaignSchedule::default().set_points_c;
    assert_eq!(warnings(all(), None), "");
    let text = warnings(all(), Some(1));
    assert!(text.contains(": the set points scatter by") && text.contains("the order is too low"), "{text}");
    assert!(!text.contains("--exclude"), "{text}");
    assert!(warnings(vec![-25.0, 10.0, 45.0], None).contains("there are too few set points"));
    assert!(warnings(vec![-25.0, 0.0, 20.0, 45.0], Some(3)).contains("order 3 takes all 4 set points"));
}

#[test]
fn without_the_tilt_no_figure_is_printed() {
    // Six faces at one heading: angles or not, the tilt is taken for bias, scale factors and misalignments.
    let truth = truth([1e-4, -5e-5], 9.8015);
    let schedule = CampaignSchedule {
        positions: Scheme::SixFacesTwoHeadings.positions().into_iter().step_by(2).collect(),
        noise: quiet(),
        ..CampaignSchedule::default()
    };
    for with_angles in [true, false] {
        let mut file = campaign_file(&truth, &schedule);
        file.mount = file.mount.filter(|_| with_angles);
        let dwells = dwells(&file, &csv(campaign(&truth, &schedule, 1))).unwrap();
        let calibration = calibrate_accelerometers(&file, dwells, CalibrationOptions::default()).unwrap();
        let [bias, _] = worst(&calibration.table, &truth.table);
        assert!(bias > 20.0, "{bias}");
        assert!(calibration.findings.iter().any(|finding| finding.name == name::LEVEL));
        let accuracy = Accuracy::of(&calibration);
        assert!(accuracy.bias.iter().chain(&accuracy.scale_factor_band).all(Option::is_none), "{accuracy}");
        let text = isotherm_report::text::calibration(&calibration);
        let lines =
            ["bias not known (the tilt of the base is open)", "caution: these positions cannot separate the tilt"];
        assert!(lines.iter().all(|line| text.contains(line)), "{text}");
        assert!(!text.contains("+-") && !text.contains("NaN"), "{text}");
    }
}

#[test]
fn the_residual_in_g0_cancels_a_level_error_that_straddles_zero() {
    // Without angles the tilt cannot be estimated. It must cancel in each pair, although the two readings use different
    // channels.
    let schedule = noiseless(Scheme::SixFacesTwoHeadings.positions());
    let mut truth = truth([2e-4, 1.5e-4], 9.8015);
    // K+ and K- differ by 10 %, so that an error from weighting with them would be visible.
    let mut content = truth.table.content().clone();
    for axis in &mut content.axes {
        let k = &axis.negative_scale_factor;
        let scaled: Vec<_> = k.coefficients().iter().map(|c| 0.9 * c).collect();
        axis.negative_scale_factor =
            isotherm_shared::polynomial::Polynomial::new(&scaled, 0.0, 1.0, k.range()).unwrap();
    }
    truth = Truth::new(content, MISALIGNMENT, truth.tilt_rad, truth.gravity_local).unwrap();
    let mut file = campaign_file(&truth, &schedule);
    file.mount = None;
    let dwells = dwells(&file, &csv(campaign(&truth, &schedule, 1))).unwrap();
    for method in [Method::OneStage, Method::TwoStage] {
        let options = CalibrationOptions { method, order: Some(3), ..CalibrationOptions::default() };
        let calibration = calibrate_accelerometers(&file, dwells.clone(), options).unwrap();
        assert_eq!(calibration.solution.tilt, None);
        let found = worst(&calibration.table, &truth.table);
        // The second order of the tilt (2e-4 squared is 0.04e-6) and the quantisation of the pulses remain.
        // The two-stage values also contain the effect of the drift within a set point.
        let limit = if method == Method::OneStage { 0.2 } else { 0.5 };
        assert!(found[0] < 0.1 && found[1] < limit, "{method:?}: {found:?}");
    }
}

#[test]
fn gravity_of_the_station_is_not_1_g0() {
    let truth = truth([0.0; 2], 9.78);
    let (_, calibration) =
        calibrated(&truth, &noiseless(Scheme::SixFacesTwoHeadings.positions()), 1, CalibrationOptions::default())
            .unwrap();
    let found = worst(&calibration.table, &truth.table);
    assert!(found[0] < 0.05 && found[1] < 0.1, "{found:?}");
    assert_eq!(calibration.table.content().gravity, 9.8015);
}

#[test]
fn the_alignment_undoes_the_misalignment() {
    let truth = truth(TILT_RAD, 9.8015);
    let schedule = noiseless(Scheme::SixFacesTwoHeadings.positions());
    let options = CalibrationOptions { alignment: AlignmentChoice::With, ..CalibrationOptions::default() };
    let (_, calibration) = calibrated(&truth, &schedule, 1, options).unwrap();
    // A whole compensated dwell gives the specific force of the position, tilt included.
    let mut sums = [0.0; 3];
    let rows: Vec<SimulatedRow> =
        campaign(&truth, &schedule, 1).filter(|row| row.set_point_c == 10.0 && row.position == 1).collect();
    for row in &rows {
        let out = answer(Some(&calibration.table), &row.raw).velocity_increment;
        (0..3).for_each(|axis| sums[axis] += out[axis] / (9.8015 * 300.0));
    }
    for (got, right) in sums.into_iter().zip([-TILT_RAD[1], TILT_RAD[0], 1.0]) {
        assert!((got - right).abs() < 0.3e-6, "{sums:?}");
    }
}

/// Worked examples: three lists of positions with counts and their known least-squares solutions.
#[test]
fn set_points_are_reduced_as_in_the_worked_examples() {
    let examples: Value =
        serde_json::from_str(&fs::read_to_string(format!("{DATA}/twelve_position.json")).unwrap()).unwrap();
    let schemes = [
        ("S1_six_faces_two_headings", Scheme::SixFacesTwoHeadings),
        ("S2_six_faces_six_edges_45deg", Scheme::SixFacesSixEdges),
        ("S4_three_axes_four_point_tumble", Scheme::FourPointTumble),
    ];
    let number = |value: &Value| value.as_str().map_or_else(|| value.as_f64().unwrap(), |text| text.parse().unwrap());
    for (name, scheme) in schemes {
        let example = &examples["examples"]["data"][name];
        let schedule = noiseless(scheme.positions());
        let file = campaign_file(&truth([0.0; 2], 9.8015), &schedule);
        for (outputs, right) in [("outputs", "parameters"), ("outputs_noisy", "ls_noisy")] {
            // The counts of an hour, so that rounding to whole pulses does not matter.
            let rows = (0..12).map(|index| {
                let mut raw = RawSample {
                    sequence: index,
                    timestamp_ns: (index + 1) * 3_600_000_000_000,
                    interval_ns: 3_600_000_000_000,
                    accelerometers: Triad::default(),
                    ..RawSample::default()
                };
                for (axis, letter) in ["x", "y", "z"].iter().enumerate() {
                    let counts = number(&example[outputs][letter][index as usize]) * 3600.0;
                    let channel = if counts > 0.0 {
                        &mut raw.accelerometers.positive_pulses
                    } else {
                        &mut raw.accelerometers.negative_pulses
                    };
                    channel[axis] = counts.abs().round() as u32;
                }
                SimulatedRow { set_point_c: 20.0, position: index as u32 + 1, raw }
            });
            let dwells = dwells(&file, &csv(rows)).unwrap();
            for (axis, letter) in ["x", "y", "z"].iter().enumerate() {
                let right = &example[right][letter];
                let parts: Vec<_> = dwells.iter().collect();
                let got = reduce(&file, &parts, axis, None).unwrap().values;
                let (up, down) = (number(&right["SF_plus"]), number(&right["SF_minus"]));
                // The example's bias and misalignments are in counts, the same for both signs. Ours are in g0,
                // converted with K+ or K-. These differ by some 2e-5 of their size, and the results and the weights of
                // the noise with them.
                let tolerance = if outputs == "outputs" { 0.05 } else { 0.2 };
                assert!(
                    (got[1] - up).abs() < tolerance && (got[2] + down).abs() < tolerance,
                    "{name} {letter}: {got:?} {right}"
                );
                for (value, key) in [(got[0], "K0"), (got[3], "M_next"), (got[4], "M_prev")] {
                    let counts = value * 0.5 * (up + down);
                    assert!(
                        (counts - number(&right[key])).abs() < tolerance,
                        "{name} {letter} {key}: {counts} {right}"
                    );
                }
                if scheme == Scheme::SixFacesTwoHeadings && outputs == "outputs_noisy" {
                    // The mean of an up and a down reading is not the bias, because K+ != -K-.
                    let two_point = number(&right["two_point_bias_(E+ + E-)/2"]);
                    assert!((got[0] * 0.5 * (up + down) - two_point).abs() > 0.4, "{letter}");
                }
            }
        }
    }
}

#[test]
fn raw_samples_and_sums_over_seconds_give_the_same_table() {
    let truth = truth(TILT_RAD, 9.8015);
    let schedule = |interval_ns| CampaignSchedule {
        interval_ns,
        set_points_c: vec![-20.0, 0.0, 20.0, 40.0],
        ..noiseless(Scheme::SixFacesTwoHeadings.positions())
    };
    let options = || CalibrationOptions { order: Some(2), ..CalibrationOptions::default() };
    let (_, raw) = calibrated(&truth, &schedule(250_000_000), 1, options()).unwrap();
    let (_, sums) = calibrated(&truth, &schedule(10_000_000_000), 1, options()).unwrap();
    let difference = worst(&raw.table, &sums.table);
    assert!(difference[0] < 0.03 && difference[1] < 0.05, "{difference:?}");
    // The rows are merged into fewer blocks.
    assert_eq!(raw.dwells[0].rows, 1200);
    assert!(raw.dwells[0].blocks.len() <= 512);
}

#[test]
fn rows_while_the_turntable_moves_are_left_out() {
    let truth = truth(TILT_RAD, 9.8015);
    let schedule = noiseless(Scheme::SixFacesTwoHeadings.positions());
    let text = String::from_utf8(csv(campaign(&truth, &schedule, 1))).unwrap();
    // The first three rows of each dwell have no position, and pulses that fit none.
    let moving = |(index, line): (usize, &str)| {
        let mut fields: Vec<&str> = line.split(',').collect();
        if index > 0 && (index - 1) % 30 < 3 {
            (fields[1], fields[5]) = ("", "77777");
        }
        fields.join(",") + "\n"
    };
    let text: String = text.lines().enumerate().map(moving).collect();
    let file = campaign_file(&truth, &schedule);
    let calibration =
        calibrate_accelerometers(&file, dwells(&file, text.as_bytes()).unwrap(), CalibrationOptions::default())
            .unwrap();
    assert_eq!((calibration.dwells.len(), calibration.dwells[5].rows), (180, 27));
    let found = worst(&calibration.table, &truth.table);
    assert!(found[0] < 0.05 && found[1] < 0.1, "{found:?}");
}

#[test]
fn dwells_sorted_by_position_are_grouped_by_set_point() {
    let truth = truth(TILT_RAD, 9.8015);
    let schedule = noiseless(Scheme::SixFacesTwoHeadings.positions());
    let mut rows: Vec<SimulatedRow> = campaign(&truth, &schedule, 1).collect();
    rows.sort_by_key(|row| row.position);
    for (index, row) in (0..).zip(&mut rows) {
        // A minute from dwell to dwell, and over an hour from position to position.
        let moved_s = index / 30 * 60 + index / 30 / 15 * 4000;
        (row.raw.sequence, row.raw.timestamp_ns) = (index, ((index + 1) * 10 + moved_s) * 1_000_000_000);
    }
    let file = campaign_file(&truth, &schedule);
    let calibration =
        calibrate_accelerometers(&file, dwells(&file, &csv(rows)).unwrap(), CalibrationOptions::default()).unwrap();
    assert_eq!(calibration.set_points.len(), 15);
    let found = worst(&calibration.table, &truth.table);
    assert!(found[0] < 0.05 && found[1] < 0.1, "{found:?}");
}

#[test]
fn a_difference_between_heating_and_cooling_gives_a_warning() {
    let truth = truth(TILT_RAD, 9.8015);
    let up: Vec<f64> = (-2..=4).map(|k| 10.0 * f64::from(k)).collect();
    let down: Vec<f64> = up.iter().rev().copied().collect();
    let schedule =
        CampaignSchedule { set_points_c: [up, down].concat(), ..noiseless(Scheme::SixFacesTwoHeadings.positions()) };
    let mut rows: Vec<SimulatedRow> = campaign(&truth, &schedule, 1).collect();
    // The last set point of the heating is the first of the cooling: one stay. While cooling, A1 reads 20e-6 g0 more.
    let half = rows.len() / 2;
    for row in &mut rows[half..] {
        if row.raw.accelerometers.positive_pulses[0] > 300 {
            row.raw.accelerometers.positive_pulses[0] += 18;
        }
    }
    let file = campaign_file(&truth, &schedule);
    let options = CalibrationOptions { order: Some(3), ..CalibrationOptions::default() };
    let calibration = calibrate_accelerometers(&file, dwells(&file, &csv(rows)).unwrap(), options).unwrap();
    assert_eq!(calibration.set_points.len(), 13);
    let warned =
        calibration.findings.iter().any(|f| f.message.starts_with("A1 positive_scale_factor: heating and cooling"));
    assert!(warned, "{:?}", calibration.findings);
}

#[test]
fn tables_of_a_calibration_read_back() {
    let calibration = shipped(CalibrationOptions::default());
    let text = calibration.table.to_toml();
    assert_eq!(CoefficientTable::from_toml(&text, None).unwrap(), calibration.table);
}
