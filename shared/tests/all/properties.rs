//! Properties of tables and of the kernel: round trip through TOML, agreement with exact rational arithmetic, and
//! policies.
//!
//! Over 400 lines: the kernel in rational arithmetic, next to the tables and samples that it is compared on.

use isotherm_shared::compensate::{Compensator, answer};
use isotherm_shared::names::ImuId;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable, Content, Gyroscopes, OutOfRange};
use isotherm_shared::units::{ARCSEC, BiasUnit};
use isotherm_shared::wire::{AXES, CompensatedIncrement, Flags, MAX_INTERVAL_NS, RawSample, Triad};
use nalgebra::Matrix3;
use num_rational::BigRational;
use num_traits::{Signed as _, ToPrimitive as _, Zero as _};
use proptest::prelude::*;
use std::sync::Arc;

/// A polynomial near `size` over its range: order 0 to 7, and with centre and scale, with scale only, or with neither.
fn polynomial(size: f64) -> impl Strategy<Value = Polynomial> {
    let part = size.abs() * 0.02;
    let higher = prop::collection::vec(-part..part, 0..=7);
    (higher, 0..3, 0.5..1.5f64, 3.0..4.5f64, 0.6..0.9f64).prop_map(move |(higher, kind, low, high, scale)| {
        // Either |x| is about 1 at most, or the coefficients decrease with the power: the value keeps the sign of
        // `size`.
        let (center, scale, fall) = match kind {
            0 => (2.5, 2.5 / scale, 1.0),
            1 => (0.0, 5.0, 1.0),
            _ => (0.0, 1.0, 0.2),
        };
        let higher = higher.iter().zip(1..).map(|(coefficient, power)| coefficient * f64::powi(fall, power));
        let coefficients: Vec<_> = std::iter::once(size).chain(higher).collect();
        Polynomial::new(&coefficients, center, scale, [low, high]).unwrap()
    })
}

/// Sizes of bias, transient and scale factor in the units of an accelerometer or gyroscope.
type Sizes = (BiasUnit, f64, f64, f64);
const GYROSCOPE: Sizes = (BiasUnit::DegreePerHour, 5.0, 1.0, 1.05);

fn accelerometer() -> impl Strategy<Value = Sizes> {
    let units = [(BiasUnit::G0, 1e-3), (BiasUnit::MilliG0, 0.7), (BiasUnit::MicroG0, 800.0)];
    prop::sample::select(units.map(|(unit, size)| (unit, size, 0.05 * size, 91_000.0)).to_vec())
}

prop_compose! {
    fn axis(sizes: impl Strategy<Value = Sizes>)(sizes in sizes)(
        bias_unit in Just(sizes.0),
        bias in polynomial(sizes.1),
        transient in prop_oneof![Just(0.0), -sizes.2..sizes.2],
        positive_scale_factor in polynomial(sizes.3),
        negative_scale_factor in polynomial(-0.99 * sizes.3),
        max_rate in prop::option::of(1e4..1e6f64),
    ) -> Axis {
        Axis { bias_unit, bias, transient, positive_scale_factor, negative_scale_factor, max_rate }
    }
}

/// The temperatures of heads and boards.
fn temperatures(raw: &mut RawSample) -> Vec<&mut f64> {
    let RawSample { accelerometers: a, gyroscopes: g, .. } = raw;
    let all = [&mut a.head_temperature, &mut a.board_temperature, &mut g.head_temperature, &mut g.board_temperature];
    all.into_iter().flatten().collect()
}

/// The bits of an answer.
fn bits(increment: &CompensatedIncrement) -> (u64, Vec<u64>) {
    let numbers = increment.velocity_increment.iter().chain(&increment.angle_increment);
    (increment.flags, numbers.map(|number| number.to_bits()).collect())
}

fn alignment() -> impl Strategy<Value = Matrix3<f64>> {
    prop::array::uniform9(-1e-3..1e-3f64).prop_map(|small| Matrix3::identity() + Matrix3::from_row_slice(&small))
}

prop_compose! {
    fn gyroscopes()(
        axes in [axis(Just(GYROSCOPE)), axis(Just(GYROSCOPE)), axis(Just(GYROSCOPE))],
        g_sensitivity in prop::array::uniform3(prop::option::of(prop::array::uniform3(-3.0..3.0f64))),
        alignment in prop::option::of(alignment()),
    ) -> Gyroscopes {
        Gyroscopes { axes, g_sensitivity, alignment }
    }
}

prop_compose! {
    fn table()(
        imu in "[a-z0-9_-]{1,32}",
        serial in prop::option::of("\\PC{0,20}"),
        gravity in 9.7..9.9f64,
        nominal_interval_s in prop::option::of(1e-9..3600f64),
        temperature_unit in "\\PC{0,10}",
        out_of_range in prop::sample::select(OutOfRange::NAMES.map(|(policy, _)| policy).to_vec()),
        max_age_s in prop::option::of(1e-3..1e3f64),
        axes in [axis(accelerometer()), axis(accelerometer()), axis(accelerometer())],
        alignment in prop::option::of(alignment()),
        gyroscopes in prop::option::of(gyroscopes()),
        with_lag in any::<bool>(),
    ) -> CoefficientTable {
        let imu = ImuId::new(&imu).unwrap();
        let (mut axes, mut gyroscopes) = (axes, gyroscopes);
        if !with_lag {
            for axis in axes.iter_mut().chain(gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes)) {
                axis.transient = 0.0;
            }
        }
        let lag_s = with_lag.then_some(LAG_NS as f64 / 1e9);
        let mut content = Content {
            format: 1, imu, serial, gravity, nominal_interval_s, temperature_unit, out_of_range, max_age_s, lag_s, axes,
            alignment, gyroscopes,
        };
        content.format = content.least_format();
        CoefficientTable::new(content).unwrap()
    }
}

/// Time constant of the tables with a lag.
const LAG_NS: u64 = 240_000_000_000;

prop_compose! {
    fn triad(temperature: std::ops::Range<f64>)(
        positive_pulses in prop::array::uniform3(any::<u32>()),
        negative_pulses in prop::array::uniform3(any::<u32>()),
        head_temperature in prop::array::uniform3(temperature.clone()),
        board_temperature in prop::array::uniform3(temperature.clone()),
        head_lagged in prop::array::uniform3(temperature),
    ) -> Triad {
        Triad { positive_pulses, negative_pulses, head_temperature, board_temperature, head_lagged }
    }
}

prop_compose! {
    /// Half of the samples are inside the ranges of all polynomials, as nearly all real samples are.
    fn sample()(temperature in prop::sample::select(vec![0.0..5.0f64, 1.5..3.0]))(
        interval_ns in 1..=MAX_INTERVAL_NS,
        lag_ns in prop::sample::select(vec![0, LAG_NS, LAG_NS, LAG_NS, LAG_NS + 1]),
        accelerometers in triad(temperature.clone()),
        gyroscopes in triad(temperature),
    ) -> RawSample {
        RawSample { interval_ns, lag_ns, accelerometers, gyroscopes, ..RawSample::default() }
    }
}

fn exact(value: f64) -> BigRational {
    BigRational::from_float(value).unwrap()
}

fn whole(value: u32) -> BigRational {
    BigRational::from_integer(value.into())
}

/// The polynomial and the sum of the absolute values of its terms, without any rounding.
fn exact_polynomial(polynomial: &Polynomial, temperature: f64) -> (BigRational, BigRational) {
    let x = (exact(temperature) - exact(polynomial.center())) / exact(polynomial.scale());
    let (mut sum, mut size, mut power) = (BigRational::zero(), BigRational::zero(), whole(1));
    for coefficient in polynomial.coefficients() {
        let term = exact(*coefficient) * &power;
        size += term.abs();
        sum += term;
        power *= &x;
    }
    (sum, size)
}

/// Whether the term of `transient` counts in this sample.
fn has_transient(axis: &Axis, raw: &RawSample, triad: &Triad, index: usize) -> bool {
    let [low, high] = axis.bias.range();
    let difference = triad.head_lagged[index] - triad.head_temperature[index];
    axis.transient != 0.0 && raw.lag_ns == LAG_NS && difference.abs() <= high - low
}

/// N+/K+ + N-/K- - bias * Ts of one sensor in rational arithmetic, and the size of everything that is added up: the
/// terms of the polynomials too (at most 2n of them by Horner's rule).
fn exact_indicated(
    policy: OutOfRange,
    axis: &Axis,
    raw: &RawSample,
    triad: &Triad,
    index: usize,
) -> (BigRational, BigRational) {
    let used = |polynomial: &Polynomial, temperature: f64| match policy {
        OutOfRange::Clamp => polynomial.clamp(temperature),
        _ => temperature,
    };
    let (head, board) = (triad.head_temperature[index], triad.board_temperature[index]);
    let at = |polynomial, temperature| exact_polynomial(polynomial, used(polynomial, temperature));
    let (k_plus, k_plus_size) = at(&axis.positive_scale_factor, board);
    let (k_minus, k_minus_size) = at(&axis.negative_scale_factor, board);
    let (mut bias, mut bias_size) = at(&axis.bias, head);
    if has_transient(axis, raw, triad, index) {
        let (lagged, transient) = (exact(triad.head_lagged[index]), exact(axis.transient));
        bias += &transient * (&lagged - exact(head));
        bias_size += transient.abs() * (lagged.abs() + exact(head).abs());
    }
    let ts = BigRational::new(raw.interval_ns.into(), 1_000_000_000.into());
    let unit = exact(axis.bias_unit.factor());
    let positive = whole(triad.positive_pulses[index]) / &k_plus;
    let negative = whole(triad.negative_pulses[index]) / &k_minus;
    let sum = &positive + &negative - &bias * &unit * &ts;
    let size = positive.abs() * (k_plus_size / k_plus.abs())
        + negative.abs() * (k_minus_size / k_minus.abs())
        + bias_size * unit * ts;
    (sum, size)
}

/// A few devices in the last place of everything that is added up.
fn rounding(size: &BigRational) -> f64 {
    size.to_f64().unwrap() * 40.0 * f64::EPSILON
}

/// Equation (17) for one accelerometer in rational arithmetic, and a bound on the kernel's rounding error.
fn exact_increment(table: &Content, raw: &RawSample, index: usize) -> (f64, f64) {
    let (sum, size) = exact_indicated(table.out_of_range, &table.axes[index], raw, &raw.accelerometers, index);
    let gravity = exact(table.gravity);
    ((&gravity * sum).to_f64().unwrap(), rounding(&(gravity * size)))
}

proptest! {
    #[test]
    fn a_table_survives_its_file(table in table()) {
        let text = table.to_toml();
        prop_assert_eq!(CoefficientTable::from_toml(&text, None).unwrap(), table, "{}", text);
    }

    #[test]
    fn the_kernel_agrees_with_exact_arithmetic(table in table(), raw in sample()) {
        let mut content = Content { alignment: None, ..table.content().clone() };
        if let Some(gyroscopes) = &mut content.gyroscopes {
            gyroscopes.alignment = None;
        }
        let result = answer(Some(&CoefficientTable::new(content.clone()).unwrap()), &raw);
        let rejected = |index: usize, flags: Flags| {
            let outside = [Flags::head_below(index), Flags::head_above(index), Flags::board_below(index), Flags::board_above(index)];
            content.out_of_range == OutOfRange::Reject && outside.iter().any(|flag| flags.intersects(*flag))
        };
        for index in 0..AXES {
            let dv = result.velocity_increment[index];
            if rejected(index, Flags(result.flags)) {
                prop_assert!(dv.is_nan());
                continue;
            }
            let (exact, bound) = exact_increment(&content, &raw, index);
            prop_assert!((dv - exact).abs() <= bound, "axis {}: {} for {}, bound {}", index, dv, exact, bound);
        }
        let Some(gyroscopes) = &content.gyroscopes else {
            prop_assert!(result.angle_increment.iter().all(|da| da.is_nan()));
            return Ok(());
        };
        let q_known = result.velocity_increment.iter().all(|dv| dv.is_finite());
        let needs_g = gyroscopes.g_sensitivity.iter().any(Option::is_some);
        prop_assert_eq!(Flags(result.flags).intersects(Flags::G_UNKNOWN), needs_g && !q_known);
        for (index, axis) in gyroscopes.axes.iter().enumerate() {
            let da = result.angle_increment[index];
            if rejected(index, Flags(result.flags >> 32)) {
                prop_assert!(da.is_nan());
                continue;
            }
            let (mut angle, mut size) = exact_indicated(content.out_of_range, axis, &raw, &raw.gyroscopes, index);
            if let Some(coefficients) = gyroscopes.g_sensitivity[index].filter(|_| q_known) {
                for (coefficient, dv) in coefficients.iter().zip(result.velocity_increment) {
                    let term = exact(*coefficient) * exact(dv) / exact(content.gravity);
                    size += term.abs();
                    angle -= term;
                }
            }
            let (exact, bound) = ((angle * exact(ARCSEC)).to_f64().unwrap(), rounding(&(size * exact(ARCSEC))));
            prop_assert!((da - exact).abs() <= bound, "gyroscope {}: {} for {}, bound {}", index, da, exact, bound);
        }
    }

    /// The kernel equals the expression of the specification, implemented here a second time, bit for bit.
    #[test]
    fn the_kernel_is_the_one_expression(table in table(), raw in sample()) {
        let content = table.content();
        let value = |p: &Polynomial, temperature: f64| {
            let u = if content.out_of_range == OutOfRange::Clamp { temperature.max(p.range()[0]).min(p.range()[1]) } else { temperature };
            let x = (u - p.center()) / p.scale();
            let c = p.coefficients();
            let mut r = c[c.len() - 1];
            for k in (0..c.len() - 1).rev() {
                r = r * x + c[k];
            }
            r
        };
        let ts = raw.interval_ns as f64 / 1e9;
        let indicated = |axis: &Axis, triad: &Triad, i: usize| {
            let (head, board) = (triad.head_temperature[i], triad.board_temperature[i]);
            let inside = |p: &Polynomial, u: f64| u >= p.range()[0] && u <= p.range()[1];
            let all_inside = inside(&axis.bias, head)
                && inside(&axis.positive_scale_factor, board)
                && inside(&axis.negative_scale_factor, board);
            if content.out_of_range == OutOfRange::Reject && !all_inside {
                return f64::NAN;
            }
            let mut p = value(&axis.bias, head);
            if has_transient(axis, &raw, triad, i) {
                p += axis.transient * (triad.head_lagged[i] - head);
            }
            let a = p * axis.bias_unit.factor();
            let k = (value(&axis.positive_scale_factor, board), value(&axis.negative_scale_factor, board));
            if content.out_of_range == OutOfRange::Extrapolate && !all_inside && (k.0 <= 0.0 || k.1 >= 0.0) {
                return f64::NAN;
            }
            let (positive, negative) = (f64::from(triad.positive_pulses[i]), f64::from(triad.negative_pulses[i]));
            (positive / k.0 + negative / k.1) - a * ts
        };
        let aligned = |matrix: &Option<Matrix3<f64>>, v: [f64; AXES]| match matrix {
            None => v,
            Some(m) => [0, 1, 2].map(|i| (m[(i, 0)] * v[0] + m[(i, 1)] * v[1]) + m[(i, 2)] * v[2]),
        };
        let sensor = [0, 1, 2].map(|i| content.gravity * indicated(&content.axes[i], &raw.accelerometers, i));
        let dv = aligned(&content.alignment, sensor);
        let result = answer(Some(&table), &raw);
        let da = content.gyroscopes.as_ref().map_or([f64::NAN; AXES], |gyroscopes| {
            let q = dv.map(|dv| dv / content.gravity);
            let sensor = [0, 1, 2].map(|i| {
                let angle = indicated(&gyroscopes.axes[i], &raw.gyroscopes, i);
                match gyroscopes.g_sensitivity[i].filter(|_| q.iter().all(|q| q.is_finite())) {
                    Some(s) => angle - ((s[0] * q[0] + s[1] * q[1]) + s[2] * q[2]),
                    None => angle,
                }
            });
            aligned(&gyroscopes.alignment, sensor).map(|angle| angle * 4.84813681109536e-06)
        });
        let found = result.velocity_increment.iter().chain(&result.angle_increment);
        for (found, expected) in found.zip(dv.into_iter().chain(da)) {
            prop_assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(), "{found} for {expected}");
        }
    }

    /// A compensator, which keeps what it has evaluated, gives the answers of the kernel, bit for bit: whichever of the
    /// temperatures are those of the sample before.
    #[test]
    fn a_compensator_answers_as_the_kernel(
        table in table(),
        samples in prop::collection::vec((sample(), any::<u16>()), 1..12),
        odd in any::<f64>(),
    ) {
        let mut compensator = Compensator::new(Arc::new(table.clone()));
        let mut before = RawSample::default();
        for (mut raw, changes) in samples {
            for (bit, (now, before)) in temperatures(&mut raw).into_iter().zip(temperatures(&mut before)).enumerate() {
                match (changes >> bit & 1, changes >> 12) {
                    (1, 0) => *now = odd,
                    (1, 1..6) => {}
                    _ => *now = *before,
                }
            }
            let mut increment = CompensatedIncrement::default();
            compensator.answer_into(&raw, &mut increment);
            prop_assert_eq!(bits(&increment), bits(&answer(Some(&table), &raw)));
            before = raw;
        }
    }

    /// A clamped bias has no step at the end of its range and is constant beyond it.
    #[test]
    fn clamping_is_continuous(table in table(), raw in sample(), upper in any::<bool>(), beyond in 0.0..10.0f64) {
        let content = Content { out_of_range: OutOfRange::Clamp, alignment: None, ..table.content().clone() };
        let table = CoefficientTable::new(content.clone()).unwrap();
        for index in 0..AXES {
            let end = content.axes[index].bias.range()[usize::from(upper)];
            let at = |head: f64| {
                // The transient term takes the unclamped temperature.
                let mut raw = RawSample { lag_ns: 0, ..raw };
                raw.accelerometers.head_temperature[index] = head;
                (answer(Some(&table), &raw).velocity_increment[index], raw)
            };
            let (there, raw_there) = at(end);
            let (outside, inside) = if upper { (end + beyond, end.next_down()) } else { (end - beyond, end.next_up()) };
            prop_assert_eq!(at(outside).0.to_bits(), there.to_bits());
            // The smallest step of the temperature changes the bias by its slope times 1e-15: less than the rounding of
            // the terms.
            let (_, bound) = exact_increment(&content, &raw_there, index);
            prop_assert!((at(inside).0 - there).abs() <= 2.0 * bound);
        }
    }

    /// For every bit pattern the kernel gives a finite number or NaN, and does not panic.
    #[test]
    fn any_bit_pattern_gives_a_finite_number_or_nan(table in table(), words in prop::array::uniform32(any::<u64>())) {
        let triad = |words: &[u64]| {
            let doubles = |from: usize| [0, 1, 2].map(|i| f64::from_bits(words[from + i]));
            Triad {
                positive_pulses: [words[0] as u32, words[1] as u32, words[2] as u32],
                negative_pulses: [0, 1, 2].map(|i| (words[i] >> 32) as u32),
                head_temperature: doubles(3),
                board_temperature: doubles(6),
                head_lagged: doubles(9),
            }
        };
        let raw = RawSample {
            session: words[0],
            sequence: words[1],
            timestamp_ns: words[2],
            interval_ns: words[3],
            sent_ns: words[4],
            telemetry_ns: words[5],
            lag_ns: if words[6] % 2 == 0 { LAG_NS } else { words[6] },
            device: words[7],
            accelerometers: triad(&words[8..20]),
            gyroscopes: triad(&words[20..]),
        };
        let increment = answer(Some(&table), &raw);
        prop_assert!(increment.velocity_increment.iter().all(|dv| dv.is_finite() || dv.is_nan()));
        prop_assert!(increment.angle_increment.iter().all(|da| da.is_finite() || da.is_nan()));
        prop_assert_eq!(increment.flags & !Flags::SAMPLE.0, 0);
        for index in 0..AXES {
            let finite = |triad: &Triad| triad.head_temperature[index].is_finite() && triad.board_temperature[index].is_finite();
            let (accelerometer, gyroscope) = (finite(&raw.accelerometers), finite(&raw.gyroscopes));
            prop_assert_eq!(Flags(increment.flags).intersects(Flags::not_finite(index)), !accelerometer);
            prop_assert!(accelerometer || increment.velocity_increment[index].is_nan());
            let flagged = Flags(increment.flags).intersects(Flags::not_finite(index).of_gyroscopes());
            prop_assert_eq!(flagged, table.content().gyroscopes.is_some() && !gyroscope);
            prop_assert!(gyroscope || increment.angle_increment[index].is_nan());
        }
        let nothing = answer(None, &raw);
        prop_assert!(nothing.velocity_increment.iter().chain(&nothing.angle_increment).all(|value| value.is_nan()));
        prop_assert!(Flags(nothing.flags).intersects(Flags::NO_TABLE));
    }
}

#[test]
fn the_digest_is_the_documented_one() {
    let text = include_str!("../../../examples/tables/imu-b.toml");
    let table = CoefficientTable::from_toml(text, None).unwrap();
    let canonical = table.content().canonical();
    let lines: Vec<_> = canonical.lines().collect();
    assert_eq!(lines[0], "isotherm-table 1");
    assert_eq!(lines[1], "imu.id 696d752d62");
    assert_eq!(lines[3], format!("imu.gravity {:016x}", 9.80665_f64.to_bits()));
    assert_eq!(lines.len(), 7 + 3 * 16 + 1);
    // Computed independently by docs/digest.py from the description in docs/table.md.
    assert_eq!(table.digest().to_string(), "sha256:7bea61de3e0c1e9eea47b5e77e0715ba18c15b89b17d2514ff07e2637d419b61");
    assert_eq!(format!("{:016x}", table.id()), "7bea61de3e0c1e9e");
}

#[test]
fn stale_temperature_and_high_rates_are_flagged() {
    let text = include_str!("../../../examples/tables/imu-b.toml");
    let table = CoefficientTable::from_toml(text, None).unwrap();
    let raw = |telemetry_ns, pulses| RawSample {
        timestamp_ns: 100_000_000_000,
        telemetry_ns,
        interval_ns: 1_000_000_000,
        accelerometers: Triad { positive_pulses: [pulses, 0, 0], negative_pulses: [1, 0, 0], ..Triad::default() },
        ..RawSample::default()
    };
    let flags = |raw: RawSample| Flags(answer(Some(&table), &raw).flags);
    assert_eq!(flags(raw(0, 0)), Flags::default(), "unknown age");
    assert_eq!(flags(raw(70_000_000_000, 0)), Flags::default(), "30 s old");
    assert_eq!(flags(raw(69_999_999_999, 0)), Flags::TELEMETRY_STALE);
    assert_eq!(flags(raw(100_000_000_001, 0)), Flags::default(), "read after the period's end");
    assert_eq!(flags(raw(130_000_000_000, 0)), Flags::default(), "30 s after it");
    for telemetry_ns in [130_000_000_001, 1_700_000_000_000_000_000, u64::MAX / 2] {
        assert_eq!(flags(raw(telemetry_ns, 0)), Flags::TELEMETRY_STALE, "of another clock");
    }
    let late = RawSample { timestamp_ns: 0, ..raw(u64::MAX / 2, 0) };
    assert_eq!(flags(late), Flags::default(), "unknown end of the period");
    // The mark of the acquisition counts under every table, and is no part of the time.
    let without = CoefficientTable::new(Content { max_age_s: None, ..table.content().clone() }).unwrap();
    for time_ns in [0, 1, 69_999_999_999, 99_999_999_999] {
        let mut marked = raw(time_ns, 0);
        let unmarked = answer(Some(&without), &marked);
        marked.mark_stale();
        assert_eq!(marked.temperature_time_ns(), time_ns);
        assert_eq!(marked.temperature_age_s(), raw(time_ns, 0).temperature_age_s());
        assert_eq!(flags(marked), Flags::TELEMETRY_STALE, "{time_ns}");
        let stale = answer(Some(&without), &marked);
        assert_eq!(stale.flags, unmarked.flags | Flags::TELEMETRY_STALE.0);
        assert_eq!(stale.velocity_increment.map(f64::to_bits), unmarked.velocity_increment.map(f64::to_bits));
    }
    assert_eq!(flags(raw(0, 1_999_999)), Flags::default(), "both channels together at the limit");
    assert_eq!(flags(raw(0, 2_000_000)), Flags::rate(0));
    for interval_ns in [0, MAX_INTERVAL_NS + 1] {
        let result = answer(Some(&table), &RawSample { interval_ns, ..raw(0, u32::MAX) });
        assert_eq!(Flags(result.flags), Flags::INTERVAL);
        assert!(result.velocity_increment.iter().all(|dv| dv.is_nan()));
    }
}

/// Constants do not depend on the temperature. It must be finite and in range all the same.
#[test]
fn temperature_is_checked_under_constants_too() {
    let text = include_str!("../../../examples/tables/imu-whole.toml");
    let mut content = CoefficientTable::from_toml(text, None).unwrap().content().clone();
    let axes = content.axes.iter_mut().chain(content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes));
    for axis in axes {
        axis.transient = 0.0;
        for polynomial in [&mut axis.bias, &mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
            *polynomial = Polynomial::new(&polynomial.coefficients()[..1], 0.0, 1.0, polynomial.range()).unwrap();
        }
    }
    let triad = Triad { head_temperature: [2.0; AXES], board_temperature: [2.0; AXES], ..Triad::default() };
    let usual = RawSample { interval_ns: 2_500_000, accelerometers: triad, gyroscopes: triad, ..RawSample::default() };
    let tables = [content.clone(), Content { gyroscopes: None, ..content }]
        .map(|content| CoefficientTable::new(content).unwrap());
    for table in tables {
        let whole = table.content().gyroscopes.is_some();
        let flags = |raw: &RawSample| Flags(answer(Some(&table), raw).flags);
        assert_eq!(flags(&usual), Flags::default());
        let not_numbers = [f64::NAN, -f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        for (index, value) in (0..AXES).flat_map(|index| not_numbers.map(|value| (index, value))) {
            let mut raws = [usual; 4];
            raws[0].accelerometers.head_temperature[index] = value;
            raws[1].accelerometers.board_temperature[index] = value;
            raws[2].gyroscopes.head_temperature[index] = value;
            raws[3].gyroscopes.board_temperature[index] = value;
            for (raw, of_gyroscopes) in raws.iter().zip([false, false, true, true]) {
                let own = Flags::not_finite(index);
                let own = if of_gyroscopes { own.of_gyroscopes() } else { own };
                let g_unknown = if of_gyroscopes || !whole { Flags::default() } else { Flags::G_UNKNOWN };
                let expected = if of_gyroscopes && !whole { Flags::default() } else { own | g_unknown };
                assert_eq!(flags(raw), expected, "{value} at {index}");
            }
        }
    }
}

/// A polynomial is checked to rounding: this K+ is at least 1 for the check, and -16 at the end of its range.
#[test]
fn a_scale_factor_that_rounds_to_the_wrong_sign_keeps_the_sign_of_zero() {
    let text = include_str!("../../../examples/tables/imu-paper.toml");
    let mut content = CoefficientTable::from_toml(text, None).unwrap().content().clone();
    let range = [14.0, 18_014_398_509_482_024.0];
    for axis in &mut content.axes {
        axis.bias = Polynomial::new(&[-0.0], 0.0, 1.0, [-1.0, 1.0]).unwrap();
        axis.positive_scale_factor = Polynomial::new(&[126_100_789_566_374_160.0, -7.0], 0.0, 1.0, range).unwrap();
        axis.negative_scale_factor = Polynomial::new(&[-1000.0], 0.0, 1.0, range).unwrap();
    }
    assert_eq!(content.axes[0].positive_scale_factor.at(range[1]), -16.0);
    let table = CoefficientTable::new(content).unwrap();
    let accelerometers =
        Triad { head_temperature: [-0.5; AXES], board_temperature: [range[1]; AXES], ..Triad::default() };
    let raw = RawSample { interval_ns: 1_000_000_000, accelerometers, ..RawSample::default() };
    assert_eq!(answer(Some(&table), &raw).velocity_increment.map(f64::to_bits), [0; AXES]);
}

/// A scale factor that crosses zero beyond its range has the wrong sign there, or is 0. An extrapolation is NaN then,
/// with the flag of the range, and not an increment of the wrong sign.
#[test]
fn an_extrapolated_scale_factor_of_the_wrong_sign_gives_nan() {
    // K+ of A1 is 10 - 5 U, K- of A2 is 5 U - 10, and A3 has constants.
    let axis = |name| {
        let (plus, minus) = if name == "A1" { (-5.0, 0.0) } else { (0.0, if name == "A2" { 5.0 } else { 0.0 }) };
        format!(
            "[[axis]]\nname = \"{name}\"\nbias = {{ unit = \"g0\", range = [0.0, 1.0], c0 = -0.0 }}\n\
             positive_scale_factor = {{ unit = \"pulse/(s*g0)\", range = [0.0, 1.0], c0 = 10.0, c1 = {plus:?} }}\n\
             negative_scale_factor = {{ unit = \"pulse/(s*g0)\", range = [0.0, 1.0], c0 = -10.0, c1 = {minus:?} }}\n"
        )
    };
    let head = "format = 1\n[imu]\nid = \"imu-z\"\ngravity = 9.8\n[temperature]\nunit = \"V\"\nout_of_range = \"extrapolate\"\n";
    let text = head.to_owned() + &["A1", "A2", "A3"].map(axis).concat();
    let table = CoefficientTable::from_toml(&text, None).unwrap();
    let above = (0..AXES).fold(Flags::default(), |flags, axis| flags | Flags::board_above(axis));
    for (board, finite) in
        [(1.0, [true; 3]), (1.5, [true; 3]), (2.0, [false, false, true]), (5.0, [false, false, true])]
    {
        let accelerometers = Triad {
            positive_pulses: [40; 3],
            negative_pulses: [2; 3],
            head_temperature: [0.5; 3],
            board_temperature: [board; 3],
            ..Triad::default()
        };
        let raw = RawSample { interval_ns: 1_000_000_000, accelerometers, ..RawSample::default() };
        let increment = answer(Some(&table), &raw);
        assert_eq!(increment.velocity_increment.map(f64::is_finite), finite, "{board} V");
        assert_eq!(Flags(increment.flags), if board > 1.0 { above } else { Flags::default() }, "{board} V");
        assert!(increment.velocity_increment.iter().all(|dv| dv.is_nan() || *dv > 0.0), "{increment:?}");
    }
}
