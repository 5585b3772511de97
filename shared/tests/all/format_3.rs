//! Tables of format 3: the nominal interval is read, written, refused with line and key, and part of the digest, which
//! is the documented one.

use isotherm_shared::compensate::answer;
use isotherm_shared::nominal::{interval_fits, nominal_ns};
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_shared::wire::{AXES, Flags, MAX_INTERVAL_NS, RawSample, Triad};
use proptest::prelude::*;

const TABLE: &str = include_str!("../../../examples/tables/imu-mems.toml");
const LINE: &str = "nominal_interval_s = 0.0025";

fn read(text: &str) -> CoefficientTable {
    CoefficientTable::from_toml(text, None).unwrap_or_else(|faults| panic!("{faults}"))
}

/// Key, line and message of the only fault of the example with `from` replaced by `to`.
fn fault(from: &str, to: &str) -> (String, usize, String) {
    let faults = CoefficientTable::from_toml(&TABLE.replacen(from, to, 1), None).unwrap_err();
    let [fault] = &faults.0[..] else { panic!("{to}: not one fault but\n{faults}") };
    (fault.key.clone(), fault.line, fault.message.clone())
}

#[test]
fn the_example_is_valid_and_survives_its_file() {
    let table = read(TABLE);
    assert_eq!(table.content().nominal_interval_s, Some(0.0025));
    let again = read(&table.to_toml());
    assert_eq!((again.digest(), again.content()), (table.digest(), table.content()));
}

#[test]
fn the_digest_of_format_3_is_the_documented_one() {
    let table = read(TABLE);
    let canonical = table.content().canonical();
    let lines: Vec<_> = canonical.lines().collect();
    assert_eq!(lines[0], "isotherm-table 3");
    assert_eq!(lines[3], format!("imu.gravity {:016x}", 9.80665_f64.to_bits()));
    assert_eq!(lines[4], format!("imu.nominal_interval_s {:016x}", 0.0025_f64.to_bits()));
    assert!(lines[5].starts_with("temperature.unit "));
    // Computed independently by docs/digest.py from the description in docs/table.md.
    assert_eq!(table.digest().to_string(), "sha256:0fbb9849eb155c16c6b2416fd91642d928f5d7639a31479bfd25a69529c2840d");
    let other = read(&TABLE.replacen(LINE, "nominal_interval_s = 0.0026", 1));
    assert_ne!(other.digest(), table.digest());
}

#[test]
fn only_a_nominal_interval_needs_format_3() {
    let with = read(TABLE).content().clone();
    assert_eq!(with.least_format(), 3);
    let without = Content { nominal_interval_s: None, ..with.clone() };
    assert_eq!((without.least_format(), Content { gyroscopes: None, ..without }.least_format()), (2, 1));
    for format in [1, 2] {
        let refusals = CoefficientTable::new(Content { format, ..with.clone() }).unwrap_err();
        assert_eq!(
            (refusals[0].key.as_str(), refusals[0].message.as_str()),
            ("format", format!("is {format}, give 3").as_str())
        );
    }
    // The key is optional in the format that has it.
    assert_eq!(read(&TABLE.replacen(LINE, "", 1)).content().nominal_interval_s, None);
}

#[test]
fn a_bad_nominal_interval_is_refused_at_its_line_and_key() {
    let at = 1 + TABLE[..TABLE.find(LINE).unwrap()].matches('\n').count();
    for (value, reason) in [
        ("0", "1e-9 to 3600 s"),
        ("-0.0025", "1e-9 to 3600 s"),
        ("9.9e-10", "1e-9 to 3600 s"),
        ("3600.1", "1e-9 to 3600 s"),
        ("nan", "finite"),
        ("inf", "finite"),
        ("\"2.5 ms\"", "number"),
    ] {
        let (key, line, message) = fault(LINE, &format!("nominal_interval_s = {value}"));
        assert_eq!((key.as_str(), line), ("imu.nominal_interval_s", at), "{message}");
        assert!(message.contains(reason), "{value}: {message}");
    }
    for value in ["1e-9", "3600"] {
        read(&TABLE.replacen(LINE, &format!("nominal_interval_s = {value}"), 1));
    }
}

#[test]
fn formats_1_and_2_have_no_nominal_interval() {
    let at = 1 + TABLE[..TABLE.find(LINE).unwrap()].matches('\n').count();
    let (key, line, message) = fault("format = 3", "format = 2");
    assert_eq!((key.as_str(), line), ("imu.nominal_interval_s", at));
    assert!(message.contains("is a part of format 3; give format = 3"), "{message}");
    let paper = include_str!("../../../examples/tables/imu-paper.toml");
    let text = paper.replacen("[imu]\n", &format!("[imu]\n{LINE}\n"), 1);
    let faults = CoefficientTable::from_toml(&text, None).unwrap_err();
    assert_eq!(faults.0.len(), 1, "{faults}");
    assert_eq!(faults.0[0].key, "imu.nominal_interval_s");
}

/// A sample inside all ranges, of `parts` thousandths of the nominal interval.
fn sample(parts: u64) -> RawSample {
    let triad = |pulses| Triad {
        positive_pulses: [pulses; AXES],
        head_temperature: [20.0; AXES],
        board_temperature: [20.0; AXES],
        ..Triad::default()
    };
    let interval_ns = parts * 2500;
    RawSample { interval_ns, accelerometers: triad(9_806_650), gyroscopes: triad(1234), ..RawSample::default() }
}

#[test]
fn a_sample_is_flagged_unless_its_interval_is_within_1_percent_of_a_multiple() {
    let (table, none) = (read(TABLE), read(&TABLE.replacen(LINE, "", 1)));
    assert_eq!((table.nominal_ns(), none.nominal_ns()), (2_500_000, 0));
    for (parts, is_flagged) in [
        (989, true),
        (990, false),
        (1000, false),
        (1010, false),
        (1011, true),
        (1500, true),
        (1979, true),
        (1980, false),
        (2020, false),
        (2021, true),
        (48_490, true),
        (50_500, false),
        (64_000, false),
        (64_640, false),
        (64_641, true),
        (65_000, true),
        (1, true),
        (202_000, true),
    ] {
        let raw = sample(parts);
        let (found, plain) = (answer(Some(&table), &raw), answer(Some(&none), &raw));
        let expected = if is_flagged { Flags::INTERVAL_NOT_NOMINAL } else { Flags::default() };
        assert_eq!((Flags(found.flags), Flags(plain.flags)), (expected, Flags::default()), "{parts}");
        // The increment is computed all the same.
        assert_eq!(found.velocity_increment, plain.velocity_increment);
        assert!(found.velocity_increment.iter().chain(&found.angle_increment).all(|value| value.is_finite()));
    }
}

#[test]
fn merged_samples_are_multiples() {
    let table = read(TABLE);
    let mut sum = sample(1000);
    for count in 2..=65 {
        sum.merge(&sample(1000)).unwrap();
        let flagged = Flags(answer(Some(&table), &sum).flags).intersects(Flags::INTERVAL_NOT_NOMINAL);
        assert_eq!(flagged, count == 65, "{count}");
    }
}

#[test]
fn an_interval_that_cannot_be_has_its_own_flag_alone() {
    let table = read(TABLE);
    for interval_ns in [0, MAX_INTERVAL_NS + 1, u64::MAX] {
        let increment = answer(Some(&table), &RawSample { interval_ns, ..sample(1000) });
        assert_eq!(Flags(increment.flags), Flags::INTERVAL);
    }
    let longest = RawSample { interval_ns: MAX_INTERVAL_NS, ..sample(1000) };
    assert_eq!(Flags(answer(Some(&table), &longest).flags), Flags::INTERVAL_NOT_NOMINAL);
    assert_eq!(Flags(answer(None, &sample(989)).flags), Flags::NO_TABLE);
    // Outside a range too.
    let mut cold = sample(989);
    cold.accelerometers.head_temperature[1] = -20.0;
    assert_eq!(Flags(answer(Some(&table), &cold).flags), Flags::head_below(1) | Flags::INTERVAL_NOT_NOMINAL);
}

#[test]
fn seconds_become_whole_nanoseconds() {
    for (seconds, ns) in [(0.0025, 2_500_000), (1e-9, 1), (1.5e-9, 2), (3600.0, MAX_INTERVAL_NS), (0.505, 505_000_000)]
    {
        assert_eq!(nominal_ns(seconds), ns);
        assert_eq!((seconds * 1e9 + 0.5).floor() as u64, ns, "as documented");
    }
}

proptest! {
    /// The nearest multiple decides as all 64 together do.
    #[test]
    fn the_nearest_multiple_is_the_one_that_counts(nominal_ns in 1..=MAX_INTERVAL_NS, parts in 0.0..70.0_f64) {
        let interval_ns = ((nominal_ns as f64 * parts) as u64).clamp(1, MAX_INTERVAL_NS);
        let of_any = (1..=64).any(|m| interval_ns.abs_diff(m * nominal_ns) * 100 <= m * nominal_ns);
        prop_assert_eq!(interval_fits(nominal_ns, interval_ns), of_any);
    }

    /// Small numbers, where halves are exact.
    #[test]
    fn the_nearest_multiple_of_a_small_interval_counts(nominal_ns in 1..400_u64, interval_ns in 1..26_000_u64) {
        let of_any = (1..=64).any(|m| interval_ns.abs_diff(m * nominal_ns) * 100 <= m * nominal_ns);
        prop_assert_eq!(interval_fits(nominal_ns, interval_ns), of_any);
    }
}
