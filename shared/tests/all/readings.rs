//! Readings become pulses without a loss, and the nominal table and the kernel turn them back into readings.

use isotherm_shared::compensate::answer;
use isotherm_shared::readings::{ReadingError, Readings, Resolution};
use isotherm_shared::table::{
    CoefficientTable, Nominal, OutOfRange, PulseMismatch, PulseScale, nominal_content, nominal_table,
};
use isotherm_shared::wire::{AXES, CompensatedIncrement, Flags, MAX_INTERVAL_NS, RawSample, Triad};
use num_rational::BigRational;
use num_traits::{Signed as _, Zero as _};
use proptest::prelude::*;

const INTERVAL_NS: u64 = 2_500_000;

fn readings() -> Readings {
    Readings::new(Resolution::default(), INTERVAL_NS)
}

fn nominal() -> Nominal {
    Nominal::new("imu-a".parse().unwrap(), INTERVAL_NS, [-40.0, 85.0])
}

/// A sample of an IMU with gyroscopes, at 25 degC.
fn warm() -> RawSample {
    let triad = Triad { head_temperature: [25.0; AXES], board_temperature: [25.0; AXES], ..Triad::default() };
    RawSample { accelerometers: triad, gyroscopes: triad, ..RawSample::default() }
}

fn net(triad: &Triad, axis: usize) -> i64 {
    i64::from(triad.positive_pulses[axis]) - i64::from(triad.negative_pulses[axis])
}

fn exact(value: f64) -> BigRational {
    BigRational::from_float(value).unwrap()
}

/// A reading as its number of pulses over the nominal interval, and the own interval as its ratio to it.
type Part = (f64, f64);

prop_compose! {
    /// Readings of one sign or both, from far below a pulse to nearly all that a channel holds.
    fn parts()(signs in prop::sample::select(vec![vec![1.0], vec![-1.0], vec![1.0, -1.0]]))(
        parts in prop::collection::vec(
            (-3.0..9.6f64, prop::sample::select(signs), prop_oneof![Just(1.0), 0.9..1.07f64, Just(0.5)]),
            1..8,
        ),
    ) -> Vec<Part> {
        parts.into_iter().map(|(size, sign, ratio)| (sign * libm::pow(10.0_f64, size), ratio)).collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    #[test]
    fn the_pulses_of_a_million_samples_are_the_integral_to_half_a_pulse(
        parts in parts(),
        resolution in (-9.0..-2.0f64, -9.0..-2.0f64),
        interval_ns in 100_000..1_000_000_000_u64,
    ) {
        let resolution =
            Resolution { accelerometer: libm::pow(10.0_f64, resolution.0), gyroscope: libm::pow(10.0_f64, resolution.1) };
        let mut readings = Readings::new(resolution, interval_ns);
        // The samples go through these again and again, so that the integral is known without rounding.
        let cycle: Vec<_> = parts
            .iter()
            .map(|(pulses, ratio)| {
                let own_ns = (interval_ns as f64 * ratio) as u64;
                (pulses * resolution.accelerometer, pulses * resolution.gyroscope, own_ns)
            })
            .collect();
        let integral = |resolution: f64, of: &dyn Fn(usize) -> f64| {
            let unit = exact(resolution) * BigRational::from_integer(interval_ns.into());
            let parts = cycle.iter().enumerate();
            parts.map(|(i, part)| exact(of(i)) * BigRational::from_integer(part.2.into()) / &unit).collect::<Vec<_>>()
        };
        let force = integral(resolution.accelerometer, &|i| cycle[i].0);
        let rate = integral(resolution.gyroscope, &|i| cycle[i].1);
        let (mut counted, mut sample) = ([0_i64; 2], 0_usize);
        for round in 0..1_000_000 / cycle.len() {
            for (force, rate, own_ns) in &cycle {
                let mut raw = RawSample { interval_ns: *own_ns, ..RawSample::default() };
                readings.fill(&mut raw, [0.0, *force, 0.0], Some([0.0, 0.0, *rate])).unwrap();
                counted[0] += net(&raw.accelerometers, 1);
                counted[1] += net(&raw.gyroscopes, 2);
                prop_assert_eq!(raw.interval_ns, *own_ns);
            }
            sample += cycle.len();
            if round.is_power_of_two() || round + 1 == 1_000_000 / cycle.len() {
                for (counted, parts) in counted.iter().zip([&force, &rate]) {
                    let sum = parts.iter().fold(BigRational::zero(), |sum, part| sum + part);
                    let integral = sum * BigRational::from_integer((round + 1).into());
                    let difference = (BigRational::from_integer((*counted).into()) - integral).abs();
                    prop_assert!(difference < exact(0.500_001), "{} pulses after {} samples", difference, sample);
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn the_nominal_table_gives_the_readings_back_to_one_resolution(
        force in prop::array::uniform3(-200.0..200.0f64),
        rate in prop::array::uniform3(-40.0..40.0f64),
        interval_ns in 100_000..1_000_000_000_u64,
        merged in 1..8_u64,
        gravity in 9.7..9.9f64,
    ) {
        let nominal = Nominal { interval_ns, gravity, ..nominal() };
        let table = nominal_table(&nominal).unwrap();
        let mut readings = Readings::new(nominal.resolution, interval_ns);
        let mut raw = RawSample { interval_ns: merged * interval_ns, ..warm() };
        readings.fill(&mut raw, force, Some(rate)).unwrap();
        let increment = answer(Some(&table), &raw);
        prop_assert_eq!(Flags(increment.flags), Flags::default());
        for axis in 0..AXES {
            let lacking = [
                (increment.specific_force()[axis] - force[axis]) / nominal.resolution.accelerometer,
                (increment.angular_rate()[axis] - rate[axis]) / nominal.resolution.gyroscope,
            ];
            // Half a pulse over the own interval, and the rounding of doubles.
            prop_assert!(lacking.iter().all(|lacking| lacking.abs() <= 0.51 / merged as f64 + 1e-4), "{:?}", lacking);
        }
    }

    #[test]
    fn no_number_panics(
        force in any::<f64>(),
        rate in any::<f64>(),
        own in any::<u64>(),
        pulse in any::<f64>(),
        remainder in any::<f64>(),
    ) {
        let resolution = Resolution { accelerometer: pulse, gyroscope: pulse };
        for resolution in [resolution, Resolution { accelerometer: 1e-15, gyroscope: 1e6 }, Resolution::default()] {
            for (interval_ns, own) in [(own, own), (own % MAX_INTERVAL_NS, own % 1_000_000), (INTERVAL_NS, 0)] {
                let mut readings = Readings { resolution, interval_ns, remainders: [remainder; 6] };
                let mut raw = RawSample { interval_ns: own, ..RawSample::default() };
                let filled = readings.fill(&mut raw, [force; AXES], Some([rate; AXES]));
                if filled.is_ok() {
                    prop_assert!(readings.remainders.iter().all(|remainder| remainder.abs() <= 0.5));
                }
            }
        }
    }
}

#[test]
fn a_refused_reading_names_its_axis_and_changes_nothing() {
    let mut readings = readings();
    let mut raw = warm();
    readings.fill(&mut raw, [0.000_000_3; AXES], Some([0.000_000_04; AXES])).unwrap();
    let (before, sample) = (readings, raw);
    assert_ne!(before, self::readings(), "a remainder is kept");
    let numbers = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 4295.0, -4295.0];
    for (axis, sensor) in ["A1", "A2", "A3", "G1", "G2", "G3"].into_iter().enumerate() {
        for number in numbers {
            let mut all = [0.000_000_4; 6];
            all[axis] = number;
            let [a1, a2, a3, g1, g2, g3] = all;
            let error = readings.fill(&mut raw, [a1, a2, a3], Some([g1, g2, g3])).unwrap_err();
            let right = match error {
                ReadingError::NotFinite { sensor: named, .. } => named == sensor && !number.is_finite(),
                ReadingError::OutOfRange { sensor: named, .. } => named == sensor && number.is_finite(),
                _ => false,
            };
            assert!(right && error.to_string().starts_with(&format!("{sensor}: the reading ")), "{error}");
            assert_eq!((readings, raw), (before, sample));
        }
    }
}

#[test]
fn a_channel_holds_its_last_pulse_and_no_more() {
    let most = f64::from(u32::MAX);
    let resolution = Resolution { accelerometer: 1.0, gyroscope: 1.0 };
    let mut readings = Readings::new(resolution, INTERVAL_NS);
    let mut raw = RawSample::default();
    readings.fill(&mut raw, [most, -most, most + 0.25], None).unwrap();
    assert_eq!(raw.accelerometers.positive_pulses, [u32::MAX, 0, u32::MAX]);
    assert_eq!(raw.accelerometers.negative_pulses, [0, u32::MAX, 0]);
    let error = readings.fill(&mut raw, [0.0, 0.0, most + 0.25], None).unwrap_err();
    assert_eq!(error, ReadingError::OutOfRange { sensor: "A3", reading: most + 0.25 }, "with the remainder");
    readings.reset();
    readings.fill(&mut raw, [0.0, 0.0, most + 0.25], None).unwrap();
}

#[test]
fn an_interval_of_zero_becomes_the_nominal_one_and_another_counts() {
    let mut readings = readings();
    let mut raw = RawSample::default();
    readings.fill(&mut raw, [1.0, -2.0, 0.0], None).unwrap();
    assert_eq!(raw.interval_ns, INTERVAL_NS);
    assert_eq!(raw.accelerometers.positive_pulses, [1_000_000, 0, 0]);
    raw.interval_ns = 3 * INTERVAL_NS;
    readings.fill(&mut raw, [1.0, -2.0, 0.0], None).unwrap();
    assert_eq!(raw.accelerometers.positive_pulses, [3_000_000, 0, 0]);
    assert_eq!(raw.accelerometers.negative_pulses, [0, 6_000_000, 0]);
    let (before, sample) = (readings, raw);
    raw.interval_ns = MAX_INTERVAL_NS + 1;
    let error = readings.fill(&mut raw, [1.0, -2.0, 0.0], None).unwrap_err();
    assert_eq!(error, ReadingError::Interval(MAX_INTERVAL_NS + 1));
    assert_eq!((readings, raw.accelerometers), (before, sample.accelerometers));
}

#[test]
fn gyroscopes_without_a_reading_are_absent() {
    let (mut readings, mut raw) = (readings(), warm());
    readings.fill(&mut raw, [1.0; AXES], Some([0.5; AXES])).unwrap();
    assert_eq!(raw.gyroscopes.positive_pulses, [5_000_000; AXES]);
    readings.fill(&mut raw, [1.0; AXES], None).unwrap();
    assert!(raw.gyroscopes.is_absent());
    let increment = answer(Some(&nominal_table(&nominal()).unwrap()), &raw);
    assert!(increment.angular_rate().iter().all(|rate| rate.is_nan()));
    assert!(Flags(increment.flags).intersects(Flags::INVALID), "the old pulses are not sent again");
}

#[test]
fn resolutions_and_intervals_that_cannot_be_are_refused() {
    for accelerometer in [0.0, -1e-6, f64::NAN, f64::INFINITY, 1e-16, 1e7] {
        let resolution = Resolution { accelerometer, ..Resolution::default() };
        let error = Readings::new(resolution, INTERVAL_NS).fill(&mut warm(), [0.0; AXES], None).unwrap_err();
        assert!(matches!(error, ReadingError::Resolution(_)), "{error}");
        let error = nominal_table(&Nominal { resolution, ..nominal() }).unwrap_err().to_string();
        assert!(error.contains("the resolution is "), "{error}");
    }
    for interval_ns in [0, MAX_INTERVAL_NS + 1, u64::MAX] {
        let mut readings = Readings::new(Resolution::default(), interval_ns);
        let mut raw = RawSample { interval_ns: INTERVAL_NS, ..warm() };
        assert_eq!(readings.fill(&mut raw, [0.0; AXES], None), Err(ReadingError::Interval(interval_ns)));
        let error = nominal_table(&Nominal { interval_ns, ..nominal() }).unwrap_err().to_string();
        assert!(error.contains(&format!("the interval is {interval_ns} ns")), "{error}");
    }
}

#[test]
fn the_nominal_table_says_what_the_resolution_says() {
    let nominal = Nominal { max_specific_force: Some(160.0), max_angular_rate: Some(35.0), ..nominal() };
    let content = nominal_content(&nominal).unwrap();
    let gyroscopes = content.gyroscopes.clone().unwrap();
    // 9.80665 / (1e-6 * 0.0025), and 1 / (1e-7 * 0.0025 * 206264.806)
    let near = |value: f64, expected: f64| assert!((value / expected - 1.0).abs() < 1e-9, "{value} {expected}");
    near(content.axes[0].positive_scale_factor_at(20.0).0, 3.922_66e9);
    near(content.axes[2].negative_scale_factor_at(20.0).0, -3.922_66e9);
    near(gyroscopes.axes[1].positive_scale_factor_at(20.0).0, 1e10 / 2.5 / 206_264.806_247_096_36);
    assert_eq!((content.axes[1].bias_at(80.0).0, content.out_of_range), (0.0, OutOfRange::Clamp));
    assert_eq!(content.nominal_interval_s, Some(0.0025));
    let table = CoefficientTable::new(content).unwrap();
    assert!(table.is_nominal());
    assert_eq!(CoefficientTable::from_toml(&table.to_toml(), None).unwrap(), table);

    let mut readings = readings();
    let mut flags = |force: f64, rate: f64| {
        let mut raw = warm();
        readings.fill(&mut raw, [force, -force, 0.0], Some([0.0, -rate, 0.0])).unwrap();
        Flags(answer(Some(&table), &raw).flags).to_string()
    };
    assert_eq!(flags(160.0, 35.0), "-", "the largest reading itself");
    assert_eq!(flags(160.1, 35.1), "a1-rate|a2-rate|g2-rate");
}

#[test]
fn a_nominal_table_without_gyroscopes_or_with_a_wrong_range() {
    let table = nominal_table(&Nominal { has_gyroscopes: false, ..nominal() }).unwrap();
    assert_eq!(table.content().gyroscopes, None);
    for (wrong, message) in [
        (Nominal { range: [25.0, 25.0], ..nominal() }, "the range of the temperature is 25.0 to 25.0"),
        (Nominal { gravity: 1.0, ..nominal() }, "imu.gravity: is 1.0"),
        (Nominal { max_angular_rate: Some(f64::NAN), ..nominal() }, "gyroscope.G1.max_rate"),
        (
            Nominal {
                interval_ns: MAX_INTERVAL_NS,
                resolution: Resolution { accelerometer: 1.0, gyroscope: 1e-7 },
                ..nominal()
            },
            "axis.A1.positive_scale_factor",
        ),
    ] {
        let error = nominal_table(&wrong).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn an_increment_without_an_interval_is_no_reading() {
    let increment = CompensatedIncrement { velocity_increment: [1.0, 0.0, -1.0], ..CompensatedIncrement::default() };
    assert!(increment.specific_force().iter().chain(&increment.angular_rate()).all(|value| value.is_nan()));
    let increment =
        CompensatedIncrement { interval_ns: 500_000_000, angle_increment: [f64::NAN, 1.0, 2.0], ..increment };
    assert_eq!(increment.specific_force(), [2.0, 0.0, -2.0]);
    assert!(increment.angular_rate()[0].is_nan());
    assert_eq!(increment.angular_rate()[1..], [2.0, 4.0]);
}

#[test]
fn a_pulse_of_a_source_is_compared_with_that_of_the_table() {
    let resolution = Resolution { accelerometer: 1e-6, gyroscope: 1e-7 };
    let nominal = Nominal { resolution, ..Nominal::new("imu-a".parse().unwrap(), 5_000_000, [-40.0, 85.0]) };
    let scale = PulseScale::of(&nominal_table(&nominal).unwrap());
    assert_eq!(scale.nominal_ns, 5_000_000);
    let near = |is: f64, right: f64| (is / right - 1.0).abs() < 1e-12;
    assert!(scale.velocity.iter().all(|velocity| near(*velocity, 5e-9)), "{scale:?}");
    assert!(scale.angle.unwrap().iter().all(|angle| near(*angle, 5e-10)), "{scale:?}");
    for (ratio, fits) in [(1.0, true), (0.801, true), (1.249, true), (0.799, false), (1.251, false), (f64::NAN, false)]
    {
        let of = |ratios: [Option<f64>; 2]| {
            let [velocity, angle] = ratios;
            scale.check([velocity.map(|ratio| ratio * 5e-9), angle.map(|ratio| ratio * 5e-10)]).is_ok()
        };
        assert_eq!([of([Some(ratio), None]), of([None, Some(ratio)])], [fits; 2], "{ratio}");
        assert!(of([None, None]));
    }
    let wrong = scale.check([Some(5e-9), Some(1e-9)]).err();
    assert!(matches!(wrong, Some(PulseMismatch::Weight { sensor: "G1", .. })), "{wrong:?}");
    // Counts hold for one interval, within 1 %.
    for (interval_ns, fits) in [(5_000_000, true), (5_049_000, true), (5_051_000, false), (10_000_000, false)] {
        assert_eq!(scale.check_counts(interval_ns).is_ok(), fits, "{interval_ns}");
    }
    assert!(PulseScale { nominal_ns: 0, ..scale }.check_counts(10_000_000).is_ok());
    // A table of accelerometers compares no gyroscopes.
    let without = nominal_table(&Nominal { has_gyroscopes: false, ..nominal }).unwrap();
    assert!(PulseScale::of(&without).check([Some(5e-9), Some(1.0)]).is_ok());
}

#[test]
fn pulses_of_another_interval_are_rescaled_and_invalid_samples_have_no_temperature() {
    let mut raw = RawSample::default();
    raw.accelerometers.positive_pulses = [100, u32::MAX, 3];
    raw.accelerometers.negative_pulses = [0, 0, 7];
    raw.accelerometers.rescale(2.5);
    assert_eq!(raw.accelerometers.positive_pulses, [250, u32::MAX, 8]);
    assert_eq!(raw.accelerometers.negative_pulses, [0, 0, 18]);
    raw.accelerometers.head_temperature = [25.0; 3];
    raw.accelerometers.board_temperature = [25.0; 3];
    raw.invalidate();
    assert!(raw.accelerometers.head_temperature.iter().all(|temperature| temperature.is_nan()));
    assert!(raw.gyroscopes.is_absent());
}
