//! Tables of format 3: the nominal interval is read, written, refused with line and key, and part of the digest, which
//! is the documented one.

use isotherm_shared::table::{CoefficientTable, Content};

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
    let other = read(&TABLE.replacen("0.0025", "0.0026", 1));
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
