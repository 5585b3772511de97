//! Properties of tables and of the kernel: round trip through TOML, agreement with exact rational arithmetic, and policies.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_shared::compensate::{answer, compensate, uncompensated};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::{Axis, CoefficientTable, Content, OutOfRange};
use isotherm_shared::units::BiasUnit;
use isotherm_shared::wire::{AXES, Flags, MAX_INTERVAL_NS, RawSample};
use nalgebra::Matrix3;
use num_rational::BigRational;
use num_traits::{Signed as _, ToPrimitive as _, Zero as _};
use proptest::prelude::*;

/// A polynomial near `size` over its range: order 0 to 7, and with centre and scale, with scale only, or with neither.
fn polynomial(size: f64) -> impl Strategy<Value = Polynomial> {
    let part = size.abs() * 0.02;
    let higher = prop::collection::vec(-part..part, 0..=7);
    (higher, 0..3, 0.5..1.5f64, 3.0..4.5f64, 0.6..0.9f64).prop_map(move |(higher, kind, low, high, scale)| {
        // Either |x| is about 1 at most, or the coefficients decrease with the power: the value keeps the sign of `size`.
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

prop_compose! {
    fn axis()(
        (bias_unit, size) in prop::sample::select(vec![(BiasUnit::G0, 1e-3), (BiasUnit::MilliG0, 0.7), (BiasUnit::MicroG0, 800.0)]),
    )(
        bias_unit in Just(bias_unit),
        bias in polynomial(size),
        positive_scale_factor in polynomial(91_000.0),
        negative_scale_factor in polynomial(-90_000.0),
        max_rate in prop::option::of(1e4..1e6f64),
    ) -> Axis {
        Axis { bias_unit, bias, positive_scale_factor, negative_scale_factor, max_rate }
    }
}

fn alignment() -> impl Strategy<Value = Matrix3<f64>> {
    prop::array::uniform9(-1e-3..1e-3f64).prop_map(|small| Matrix3::identity() + Matrix3::from_row_slice(&small))
}

prop_compose! {
    fn table()(
        imu in "[a-z0-9_-]{1,32}",
        serial in prop::option::of("\\PC{0,20}"),
        gravity in 9.7..9.9f64,
        temperature_unit in "\\PC{0,10}",
        out_of_range in prop::sample::select(OutOfRange::NAMES.map(|(policy, _)| policy).to_vec()),
        max_age_s in prop::option::of(1e-3..1e3f64),
        axes in [axis(), axis(), axis()],
        alignment in prop::option::of(alignment()),
    ) -> CoefficientTable {
        let imu = ImuId::new(&imu).unwrap();
        CoefficientTable::new(Content { imu, serial, gravity, temperature_unit, out_of_range, max_age_s, axes, alignment })
            .unwrap()
    }
}

prop_compose! {
    /// Half of the samples are inside the ranges of all polynomials, as nearly all real samples are.
    fn sample()(telemetry in prop::sample::select(vec![0.0..5.0f64, 1.5..3.0]))(
        interval_ns in 1..=MAX_INTERVAL_NS,
        positive_pulses in prop::array::uniform3(any::<u32>()),
        negative_pulses in prop::array::uniform3(any::<u32>()),
        head_temperature in prop::array::uniform3(telemetry.clone()),
        board_temperature in prop::array::uniform3(telemetry),
    ) -> RawSample {
        RawSample { interval_ns, positive_pulses, negative_pulses, head_temperature, board_temperature, ..RawSample::default() }
    }
}

fn exact(value: f64) -> BigRational {
    BigRational::from_float(value).unwrap()
}

fn whole(value: u32) -> BigRational {
    BigRational::from_integer(value.into())
}

/// The polynomial and the sum of the absolute values of its terms, without any rounding.
fn exact_polynomial(polynomial: &Polynomial, telemetry: f64) -> (BigRational, BigRational) {
    let x = (exact(telemetry) - exact(polynomial.center())) / exact(polynomial.scale());
    let (mut sum, mut size, mut power) = (BigRational::zero(), BigRational::zero(), whole(1));
    for coefficient in polynomial.coefficients() {
        let term = exact(*coefficient) * &power;
        size += term.abs();
        sum += term;
        power *= &x;
    }
    (sum, size)
}

/// Equation (17) for one axis in rational arithmetic, and a bound on the kernel's rounding error: a few units in the last
/// place of every term, including the terms of the polynomials (at most 2n of them by Horner's rule).
fn exact_increment(table: &Content, raw: &RawSample, index: usize) -> (f64, f64) {
    let axis = &table.axes[index];
    let used = |polynomial: &Polynomial, telemetry: f64| match table.out_of_range {
        OutOfRange::Clamp => polynomial.clamp(telemetry),
        _ => telemetry,
    };
    let (head, board) = (raw.head_temperature[index], raw.board_temperature[index]);
    let at = |polynomial, telemetry| exact_polynomial(polynomial, used(polynomial, telemetry));
    let (k_plus, k_plus_size) = at(&axis.positive_scale_factor, board);
    let (k_minus, k_minus_size) = at(&axis.negative_scale_factor, board);
    let (bias, bias_size) = at(&axis.bias, head);
    let ts = BigRational::new(raw.interval_ns.into(), 1_000_000_000.into());
    let unit = exact(axis.bias_unit.in_g0());
    let positive = whole(raw.positive_pulses[index]) / &k_plus;
    let negative = whole(raw.negative_pulses[index]) / &k_minus;
    let gravity = exact(table.gravity);
    let dv = &gravity * (&positive + &negative - &bias * &unit * &ts);
    let size = gravity
        * (positive.abs() * (k_plus_size / k_plus.abs())
            + negative.abs() * (k_minus_size / k_minus.abs())
            + bias_size * unit * ts);
    (dv.to_f64().unwrap(), size.to_f64().unwrap() * 40.0 * f64::EPSILON)
}

proptest! {
    #[test]
    fn a_table_survives_its_file(table in table()) {
        let text = table.to_toml();
        prop_assert_eq!(CoefficientTable::from_toml(&text, None).unwrap(), table, "{}", text);
    }

    #[test]
    fn the_kernel_agrees_with_exact_arithmetic(table in table(), raw in sample()) {
        let content = Content { alignment: None, ..table.content().clone() };
        let result = compensate(&CoefficientTable::new(content.clone()).unwrap(), &raw);
        for index in 0..AXES {
            let dv = result.velocity_increment[index];
            let outside = [Flags::head_below(index), Flags::head_above(index), Flags::board_below(index), Flags::board_above(index)];
            if content.out_of_range == OutOfRange::Reject && outside.iter().any(|flag| result.flags.intersects(*flag)) {
                prop_assert!(dv.is_nan());
                continue;
            }
            let (exact, bound) = exact_increment(&content, &raw, index);
            prop_assert!((dv - exact).abs() <= bound, "axis {}: {} for {}, bound {}", index, dv, exact, bound);
        }
    }

    /// The kernel equals the expression of the specification, implemented here a second time, bit for bit.
    #[test]
    fn the_kernel_is_the_one_expression(table in table(), raw in sample()) {
        let content = table.content();
        let value = |p: &Polynomial, telemetry: f64| {
            let u = if content.out_of_range == OutOfRange::Clamp { telemetry.max(p.range()[0]).min(p.range()[1]) } else { telemetry };
            let x = (u - p.center()) / p.scale();
            let c = p.coefficients();
            let mut r = c[c.len() - 1];
            for k in (0..c.len() - 1).rev() {
                r = r * x + c[k];
            }
            r
        };
        let sensor: Vec<f64> = content.axes.iter().enumerate().map(|(i, axis)| {
            let (head, board) = (raw.head_temperature[i], raw.board_temperature[i]);
            let inside = |p: &Polynomial, u: f64| u >= p.range()[0] && u <= p.range()[1];
            let all_inside = inside(&axis.bias, head)
                && inside(&axis.positive_scale_factor, board)
                && inside(&axis.negative_scale_factor, board);
            if content.out_of_range == OutOfRange::Reject && !all_inside {
                return f64::NAN;
            }
            let ts = raw.interval_ns as f64 / 1e9;
            let a = value(&axis.bias, head) * axis.bias_unit.in_g0();
            let k = (value(&axis.positive_scale_factor, board), value(&axis.negative_scale_factor, board));
            let (positive, negative) = (f64::from(raw.positive_pulses[i]), f64::from(raw.negative_pulses[i]));
            content.gravity * ((positive / k.0 + negative / k.1) - a * ts)
        }).collect();
        let expected: Vec<f64> = match &content.alignment {
            None => sensor,
            Some(m) => (0..AXES).map(|i| (m[(i, 0)] * sensor[0] + m[(i, 1)] * sensor[1]) + m[(i, 2)] * sensor[2]).collect(),
        };
        let result = compensate(&table, &raw);
        for (found, expected) in result.velocity_increment.iter().zip(expected) {
            prop_assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(), "{found} for {expected}");
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
                let mut raw = raw;
                raw.head_temperature[index] = head;
                (compensate(&table, &raw).velocity_increment[index], raw)
            };
            let (there, raw_there) = at(end);
            let (outside, inside) = if upper { (end + beyond, end.next_down()) } else { (end - beyond, end.next_up()) };
            prop_assert_eq!(at(outside).0.to_bits(), there.to_bits());
            // The smallest step of the telemetry changes the bias by its slope times 1e-15: less than the rounding of the terms.
            let (_, bound) = exact_increment(&content, &raw_there, index);
            prop_assert!((at(inside).0 - there).abs() <= 2.0 * bound);
        }
    }

    /// For every bit pattern the kernel gives a finite number or NaN, and does not panic.
    #[test]
    fn any_bit_pattern_gives_a_finite_number_or_nan(table in table(), words in prop::array::uniform16(any::<u64>())) {
        let raw = RawSample {
            session: words[0],
            sequence: words[1],
            timestamp_ns: words[2],
            interval_ns: words[3],
            sent_ns: words[4],
            telemetry_ns: words[5],
            positive_pulses: [words[6] as u32, words[7] as u32, words[8] as u32],
            negative_pulses: [words[9] as u32, words[6] as u32, words[7] as u32],
            head_temperature: [words[10], words[11], words[12]].map(f64::from_bits),
            board_temperature: [words[13], words[14], words[15]].map(f64::from_bits),
        };
        let increment = answer(Some(&table), &raw);
        prop_assert!(increment.velocity_increment.iter().all(|dv| dv.is_finite() || dv.is_nan()));
        prop_assert_eq!(increment.flags & !Flags::SAMPLE.0, 0);
        for index in 0..AXES {
            let finite = raw.head_temperature[index].is_finite() && raw.board_temperature[index].is_finite();
            prop_assert_eq!(Flags(increment.flags).intersects(Flags::not_finite(index)), !finite);
            prop_assert!(finite || increment.velocity_increment[index].is_nan());
        }
        let nothing = uncompensated(&raw);
        prop_assert!(nothing.velocity_increment.iter().all(|dv| dv.is_nan()) && nothing.flags.intersects(Flags::NO_TABLE));
    }
}

#[test]
fn the_digest_is_the_documented_one() {
    let text = include_str!("../../examples/tables/imu-b.toml");
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
fn stale_telemetry_and_high_rates_are_flagged() {
    let text = include_str!("../../examples/tables/imu-b.toml");
    let table = CoefficientTable::from_toml(text, None).unwrap();
    let raw = |telemetry_ns, pulses| RawSample {
        timestamp_ns: 100_000_000_000,
        telemetry_ns,
        interval_ns: 1_000_000_000,
        positive_pulses: [pulses, 0, 0],
        negative_pulses: [1, 0, 0],
        ..RawSample::default()
    };
    let flags = |raw: RawSample| compensate(&table, &raw).flags;
    assert_eq!(flags(raw(0, 0)), Flags::default(), "unknown age");
    assert_eq!(flags(raw(70_000_000_000, 0)), Flags::default(), "30 s old");
    assert_eq!(flags(raw(69_999_999_999, 0)), Flags::TELEMETRY_STALE);
    assert_eq!(flags(raw(u64::MAX, 0)), Flags::default(), "from the future");
    assert_eq!(flags(raw(0, 1_999_999)), Flags::default(), "both channels together at the limit");
    assert_eq!(flags(raw(0, 2_000_000)), Flags::rate(0));
    for interval_ns in [0, MAX_INTERVAL_NS + 1] {
        let result = compensate(&table, &RawSample { interval_ns, ..raw(0, u32::MAX) });
        assert_eq!(result.flags, Flags::INTERVAL);
        assert!(result.velocity_increment.iter().all(|dv| dv.is_nan()));
    }
}
