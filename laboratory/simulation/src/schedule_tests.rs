use super::*;
use isotherm_campaign::Scheme;
use isotherm_shared::compensate::answer;
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_shared::wire::{AXES, RawSample};
use nalgebra::Matrix3;

const TABLE: &str = include_str!("../../../examples/tables/imu-paper.toml");
/// Upper limit of a pulse of any axis \[g0*s\].
const PULSE: f64 = 1.0 / 85_000.0;

fn content() -> Content {
    CoefficientTable::from_toml(TABLE, None).unwrap().content().clone()
}

pub(super) fn truth() -> Truth {
    Truth::new(content(), MISALIGNMENT, TILT_RAD, 9.81).unwrap()
}

/// Temperature without quantisation, and a chamber without oscillation.
fn steady() -> Chain {
    Chain { oscillation_c: 0.0, telemetry_lsb_micro: 0, ..Chain::default() }
}

/// Integral of the specific force \[g0*s\] over the sample, compensated with the truth.
fn compensated(truth: &Truth, raw: &RawSample) -> [f64; AXES] {
    let increment = answer(Some(&truth.table), raw);
    assert_eq!(increment.flags, 0);
    increment.velocity_increment.map(|dv| dv / truth.table.content().gravity)
}

#[test]
fn without_noise_the_integral_is_exact_to_one_pulse_over_any_time() {
    let truth = truth();
    let mut imu = SimulatedImu::new(&truth, &steady(), &Noise::NONE, 17.0, 1);
    for force in [[0.6, -0.48, 0.64], [0.0, 1e-4, -1.0], [-0.3, 0.0, 2e-5]] {
        let mut sum = [0.0; AXES];
        for count in 1..=5000 {
            let dv = compensated(&truth, &imu.step(&InertialMotion::of_force(force), 7_000_000));
            for i in 0..AXES {
                sum[i] += dv[i];
                // At both ends the remaining charge is less than a pulse; the misalignment adds a thousandth of it.
                assert!((dv[i] - force[i] * 0.007).abs() < 2.01 * PULSE, "{count}: {dv:?}");
                assert!((sum[i] - force[i] * 0.007 * f64::from(count)).abs() < 2.01 * PULSE, "{count}: {sum:?}");
            }
        }
        // From a discharged converter the error is one pulse over any time.
        let mut fresh = SimulatedImu::new(&truth, &steady(), &Noise::NONE, 17.0, 1);
        let mut total = fresh.step(&InertialMotion::of_force(force), 7_000_000);
        (1..100_000).for_each(|_| total.merge(&fresh.step(&InertialMotion::of_force(force), 7_000_000)).unwrap());
        let dv = compensated(&truth, &total);
        for i in 0..AXES {
            assert!((dv[i] - force[i] * 700.0).abs() < 1.01 * PULSE, "{dv:?}");
        }
    }
}

#[test]
fn vibration_gives_pulses_on_both_channels_and_leaves_the_mean() {
    let truth = truth();
    let chain = Chain { vibration_g0: 0.5, vibration_hz: 40.0, ..steady() };
    let force = [0.0, 0.01, -0.01];
    let mut imu = SimulatedImu::new(&truth, &chain, &Noise::NONE, 0.0, 1);
    let mut sum = [0.0; AXES];
    for _ in 0..400 {
        let raw = imu.step(&InertialMotion::of_force(force), 25_000_000);
        // 0.5 g0 over half a period of 12.5 ms, times 2/pi and 90 000 pulses/(s*g0), is 358 pulses.
        for (positive, negative) in raw.accelerometers.positive_pulses.iter().zip(raw.accelerometers.negative_pulses) {
            assert!((300..400).contains(positive) && (300..400).contains(&negative), "{raw:?}");
        }
        for (sum, dv) in sum.iter_mut().zip(compensated(&truth, &raw)) {
            *sum += dv;
        }
    }
    for i in 0..AXES {
        assert!((sum[i] - force[i] * 10.0).abs() < 1.01 * PULSE, "{sum:?}");
    }
    // Signed pulses with one common scale factor rectify the vibration into a bias.
    let raw =
        SimulatedImu::new(&truth, &chain, &Noise::NONE, 0.0, 1).step(&InertialMotion::of_force(force), 10_000_000_000);
    let axis = &truth.table.content().axes[0];
    let signed = f64::from(raw.accelerometers.positive_pulses[0]) - f64::from(raw.accelerometers.negative_pulses[0]);
    let naive = signed / axis.positive_scale_factor.at(2.26) - axis.bias_at(2.1).0 * 10.0;
    assert!((naive - compensated(&truth, &raw)[0]).abs() > 100.0 * PULSE);
}

#[test]
fn temperature_is_quantised_and_as_old_as_stated() {
    let run_1s = RunSchedule { chain: Chain { temperature_s: 1.0, ..Chain::default() }, ..RunSchedule::default() };
    let samples: Vec<_> = run(&truth(), &run_1s, 3).take(100).collect();
    for (index, raw) in (0..).zip(&samples) {
        assert_eq!(raw.telemetry_ns, (index / 10 * 10 + 1) * 100_000_000);
        let first = &samples[index as usize / 10 * 10];
        assert_eq!(
            (raw.accelerometers.head_temperature, raw.accelerometers.board_temperature),
            (first.accelerometers.head_temperature, first.accelerometers.board_temperature)
        );
        for temperature in raw.accelerometers.head_temperature.into_iter().chain(raw.accelerometers.board_temperature) {
            let steps = temperature * 1e6 / 76.0;
            assert!((steps - steps.round()).abs() < 1e-6, "{temperature}");
            assert!(temperature.to_string().len() <= 8, "{temperature}");
        }
    }
    assert_ne!(samples[0].accelerometers.head_temperature, samples[10].accelerometers.head_temperature);
    let every: Vec<_> = run(&truth(), &RunSchedule::default(), 3).take(10).collect();
    assert!(every.iter().all(|raw| raw.telemetry_ns == raw.timestamp_ns));
}

#[test]
fn temperature_gives_the_temperatures_of_head_and_board() {
    let raw =
        SimulatedImu::new(&truth(), &steady(), &Noise::NONE, -25.0, 1).step(&InertialMotion::default(), 1_000_000);
    for (temperature, right) in raw.accelerometers.head_temperature.iter().zip([1.1, 1.125, 1.15]) {
        assert!((temperature - right).abs() < 1e-12);
    }
    for (temperature, right) in raw.accelerometers.board_temperature.iter().zip([1.26, 1.24, 1.22]) {
        assert!((temperature - right).abs() < 1e-12);
    }
    assert!((Chain::default().temperature(45.0) - 3.9).abs() < 1e-12);
}

#[test]
fn the_campaign_keeps_to_its_schedule() {
    let schedule = CampaignSchedule::default();
    let rows: Vec<_> = campaign(&truth(), &schedule, 5).collect();
    assert_eq!((rows.len(), schedule.rows()), (15 * 12 * 30, 5400));
    for (index, row) in (0..).zip(&rows) {
        let (visit, dwell, period) = (index / 360, index / 30 % 12, index % 30);
        assert_eq!(row.set_point_c, -25.0 + 5.0 * visit as f64);
        assert_eq!((u64::from(row.position), row.raw.sequence), (dwell + 1, index));
        let end_s = visit * (4200 + 12 * 360) + 4200 + dwell * 360 + 60 + (period + 1) * 10;
        assert_eq!((row.raw.timestamp_ns, row.raw.interval_ns), (end_s * 1_000_000_000, 10_000_000_000));
        // After the soak the heads have the chamber's temperature, within the oscillation and six sigma of the
        // temperature.
        let head_c = (row.raw.accelerometers.head_temperature[0] - 1.1) / 0.04 - 25.0;
        assert!((head_c - row.set_point_c).abs() < 0.05 + 0.02, "{head_c} at {}", row.set_point_c);
    }
    // If the dwell is no multiple of the period, the rest of the dwell passes without a row.
    let odd =
        CampaignSchedule { dwell_s: 29.0, soak_s: 100.0, set_points_c: vec![10.0], ..CampaignSchedule::default() };
    let ends: Vec<_> = campaign(&truth(), &odd, 5).take(4).map(|row| row.raw.timestamp_ns / 1_000_000_000).collect();
    assert_eq!(ends, [170, 180, 259, 269]);
    assert_eq!(campaign(&truth(), &CampaignSchedule { dwell_s: 9.0, ..CampaignSchedule::default() }, 5).count(), 0);
    assert_eq!(
        campaign(&truth(), &CampaignSchedule { positions: Vec::new(), ..CampaignSchedule::default() }, 5).count(),
        0
    );
}

#[test]
fn the_positions_are_those_of_the_tilted_turntable() {
    let truth = truth();
    let schedule = CampaignSchedule {
        chain: steady(),
        noise: Noise::NONE,
        set_points_c: vec![20.0],
        dwell_s: 10.0,
        ..CampaignSchedule::default()
    };
    let gravity = 9.81 / 9.8015;
    for (row, position) in campaign(&truth, &schedule, 1).zip(&schedule.positions) {
        let by_tilt = position.by_tilt().unwrap();
        let dv = compensated(&truth, &row.raw);
        for i in 0..AXES {
            let tilted = by_tilt[i][0] * 4e-5 - by_tilt[i][1] * 6e-5;
            let force = gravity * (position.specific_force[i] + tilted);
            assert!((dv[i] / 10.0 - force).abs() < 0.3 * PULSE, "{}: {dv:?}", row.position);
        }
    }
    // +Z up at headings 0 and 180 deg: the effect of the tilt on A1 and A2 changes its sign.
    let rows: Vec<_> = campaign(&truth, &schedule, 1).take(2).map(|row| compensated(&truth, &row.raw)).collect();
    assert!((rows[0][0] - 6e-4 * gravity).abs() < 2.0 * PULSE && (rows[1][0] + 6e-4 * gravity).abs() < 2.0 * PULSE);
}

#[test]
fn the_run_ramps_between_its_holds() {
    let schedule =
        RunSchedule { chain: steady(), noise: Noise::NONE, interval_ns: 10_000_000_000, ..RunSchedule::default() };
    let truth = truth();
    let samples: Vec<_> = run(&truth, &schedule, 1).collect();
    assert_eq!((samples.len(), schedule.samples()), (1620, 1620));
    let head_c = |index: usize| (samples[index].accelerometers.head_temperature[0] - 1.1) / 0.04 - 25.0;
    assert!((head_c(179) + 25.0).abs() < 1e-9 && head_c(185) > -24.99);
    // In the middle of the ramp the heads lag by their time constant of 300 s.
    let midway = -25.0 + 20.0 / 3600.0 * (6300.0 - 300.0);
    assert!((head_c(180 + 629) - midway).abs() < 1e-6, "{}", head_c(809));
    assert!((head_c(1619) - 45.0).abs() < 0.01);
    let force = schedule.specific_force(&truth);
    assert!((force[1] + 0.48 * 9.81 / 9.8015).abs() < 1e-12);
    for raw in &samples {
        for (dv, force) in compensated(&truth, raw).iter().zip(force) {
            // Two pulses, and the temperature is read 5 s after the middle of the row: 1.1 mV, at most 1.7 % per volt.
            assert!((dv - force * 10.0).abs() < 2.0 * PULSE + 1.2e-4, "{dv} {force}");
        }
    }
}

#[test]
fn noise_has_the_stated_size() {
    let truth = truth();
    let noise = Noise { sensor_g0: 50e-6, ..Noise::NONE };
    let mut imu = SimulatedImu::new(&truth, &steady(), &noise, 20.0, 9);
    let force = [0.5, 0.5, -0.5];
    for (interval_s, right) in [(1.0, 50e-6), (0.25, 100e-6)] {
        let values: Vec<_> = (0..4000)
            .map(|_| {
                compensated(&truth, &imu.step(&InertialMotion::of_force(force), (interval_s * 1e9) as u64))[1]
                    / interval_s
                    - 0.5
            })
            .collect();
        let rms = (values.iter().map(|v| v * v).sum::<f64>() / 4000.0).sqrt();
        // Quantisation adds pulse/sqrt(6): 4.6 ug0 in 1 s, 18 ug0 in 0.25 s.
        assert!((rms / right - 1.0).abs() < 0.06, "{rms} {right}");
    }
    // One offset for each visit, constant during the visit.
    let noise = Noise { bias_g0: 100e-6, ..Noise::NONE };
    let mut imu = SimulatedImu::new(&truth, &steady(), &noise, 20.0, 9);
    let mut offsets = Vec::new();
    for _ in 0..200 {
        imu.visit();
        let [first, second] = [(); 2]
            .map(|()| compensated(&truth, &imu.step(&InertialMotion::of_force(force), 60_000_000_000))[0] / 60.0 - 0.5);
        assert!((first - second).abs() < 1e-6);
        offsets.push(first);
    }
    let rms = (offsets.iter().map(|v| v * v).sum::<f64>() / 200.0).sqrt();
    assert!((rms / 100e-6 - 1.0).abs() < 0.15, "{rms}");
}

#[test]
fn the_same_seed_gives_the_same_data() {
    let schedule = CampaignSchedule { set_points_c: vec![0.0, 5.0], ..CampaignSchedule::default() };
    let rows = |seed| campaign(&Truth::varied(&content(), seed).unwrap(), &schedule, seed).collect::<Vec<_>>();
    assert_eq!(rows(1), rows(1));
    assert_ne!(rows(1)[0].raw.accelerometers.head_temperature, rows(2)[0].raw.accelerometers.head_temperature);
}

#[test]
fn a_varied_truth_stays_within_its_documented_limits() {
    let (given, mut gravities) = (content(), Vec::new());
    for seed in 0..200 {
        let truth = Truth::varied(&given, seed).unwrap();
        gravities.push(truth.gravity_local);
        assert!((9.78..9.83).contains(&truth.gravity_local));
        assert!(truth.tilt_rad.iter().all(|tilt| tilt.abs() < 3e-4 && *tilt != 0.0));
        let product = truth.table.content().alignment.unwrap() * truth.misalignment;
        assert!((product - Matrix3::identity()).norm() < 1e-15);
        for (axis, given) in truth.table.content().axes.iter().zip(&given.axes) {
            let ([b0, b1, ..], [g0, g1, ..]) = (axis.bias.coefficients(), given.bias.coefficients()) else { panic!() };
            assert!((b0 - g0).abs() < 300.0 && (b1 / g1 - 1.0).abs() < 0.2 && b0 != g0 && b1 != g1);
            let (k, given) = (axis.negative_scale_factor.coefficients(), given.negative_scale_factor.coefficients());
            assert!((k[0] / given[0] - 1.0).abs() < 0.02 && (k[3] / given[3] - 1.0).abs() < 0.2);
        }
    }
    gravities.sort_by(f64::total_cmp);
    assert!(gravities[0] < 9.785 && gravities[199] > 9.825);
}

#[test]
fn the_truth_reads_back_as_a_table_with_its_provenance() {
    let (truth, schedule) = (truth(), CampaignSchedule::default());
    let text = truth.to_toml("isotherm simulate", 5, &schedule).unwrap();
    assert_eq!(CoefficientTable::from_toml(&text, None).unwrap(), truth.table);
    let parsed: toml::Table = text.parse().unwrap();
    let provenance = &parsed["provenance"];
    assert_eq!(provenance["seed"].as_integer(), Some(5));
    assert_eq!(provenance["misalignment"][0][1].as_float(), Some(3e-4));
    assert_eq!(provenance["misalignment"][1][0].as_float(), Some(-1.5e-4));
    assert_eq!(provenance["tilt_rad"][1].as_float(), Some(-6e-5));
    assert_eq!(provenance["noise"]["sensor_g0"].as_float(), Some(5e-6));
    assert_eq!(provenance["chain"]["telemetry_lsb_micro"].as_integer(), Some(76));
    // A table without alignment gives a truth without misalignment; a table with alignment gives back the misalignment.
    let plain = Truth::of(CoefficientTable::new(content()).unwrap());
    assert_eq!((plain.misalignment, plain.gravity_local), (Matrix3::identity(), 9.8015));
    assert!((Truth::of(truth.table.clone()).misalignment - truth.misalignment).norm() < 1e-15);
    assert!(Truth::new(content(), Matrix3::zeros(), [0.0; 2], 9.8).is_err());
}

#[test]
fn a_chamber_outside_the_range_of_the_truth_is_reported() {
    let (truth, chain) = (truth(), Chain::default());
    assert_eq!(truth.outside(&chain, -25.0, 45.0), None);
    // 4.2 V is 52.5 degC, and the board of A1 is 4 degC warmer than the chamber.
    assert!(truth.outside(&chain, -25.0, 48.6).unwrap().contains("axis.A1.positive_scale_factor"));
    assert!(truth.outside(&chain, -30.1, 45.0).unwrap().contains("axis.A1.bias"));
    // Typical gyroscopes are defined up to 85 degC.
    let whole = Content { format: 2, gyroscopes: typical_gyroscopes(&chain), ..content() };
    let whole = Truth::of(CoefficientTable::new(whole).unwrap());
    assert_eq!(whole.outside(&chain, -25.0, 45.0), None);
    let hot = Chain { gyroscope_head_offset_c: [0.0, 50.0, 0.0], ..chain };
    assert!(whole.outside(&hot, -25.0, 45.0).unwrap().contains("gyroscope.G2.bias"));
}

#[test]
fn the_campaign_file_has_every_key() {
    let positions = Scheme::SixFacesSixEdges.positions();
    let imu = content().imu;
    let text = campaign_toml(imu.as_str(), "samples.csv", 9.8015, 9.81, "V", &positions);
    let parsed: toml::Table = text.parse().unwrap();
    assert_eq!(parsed["imu"].as_str(), Some("imu-paper"));
    assert_eq!(
        (parsed["gravity_reference"].as_float(), parsed["gravity_local"].as_float()),
        (Some(9.8015), Some(9.81))
    );
    let list = parsed["position"].as_array().unwrap();
    assert_eq!(list.len(), 12);
    assert_eq!((list[1]["up"].as_str(), list[1]["outer_deg"].as_integer()), (Some("+z"), Some(0)));
    assert_eq!(list[0]["specific_force"][2].as_float(), Some(positions[0].specific_force[2]));
    assert!(!text.contains("-0,") && !text.contains("-0]"));
}
