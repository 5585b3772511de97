//! Tables of format 2: every fault of gyroscopes, lag and transient terms is refused with line and key, and the digest
//! is the documented one.

use isotherm_shared::table::CoefficientTable;
use nalgebra::Matrix3;

const TABLE: &str = include_str!("../../../examples/tables/imu-whole.toml");

/// The table with `from`, which must be in it, replaced where it first occurs after `after`; and the number of the last
/// line of `to`.
fn changed(after: &str, from: &str, to: &str) -> (String, usize) {
    let start = TABLE.find(after).unwrap_or_else(|| panic!("{after:?} is not in the table"));
    let at =
        TABLE[start..].find(from).unwrap_or_else(|| panic!("{from:?} is not in the table after {after:?}")) + start;
    let (head, tail) = (format!("{}{to}", &TABLE[..at]), &TABLE[at + from.len()..]);
    (format!("{head}{tail}"), 1 + head.matches('\n').count())
}

/// Everything from the line that begins with `first` up to the line that begins with `next`.
fn without(first: &str, next: &str) -> String {
    let start = TABLE.find(first).unwrap();
    let end = start + TABLE[start..].find(next).unwrap();
    format!("{}{}", &TABLE[..start], &TABLE[end..])
}

/// The number of the line with `text`, the first one after `after`.
fn line_of(table: &str, after: &str, text: &str) -> usize {
    let start = table.find(after).unwrap();
    let at = start + table[start..].find(text).unwrap();
    1 + table[..at].matches('\n').count()
}

const G1: &str = "name = \"G1\"";
const G2: &str = "name = \"G2\"";
const G3: &str = "name = \"G3\"";
const A1: &str = "name = \"A1\"";

#[test]
fn the_example_is_valid_and_survives_its_file() {
    let table = CoefficientTable::from_toml(TABLE, None).unwrap();
    let again = CoefficientTable::from_toml(&table.to_toml(), None).unwrap();
    assert_eq!(again, table);
    assert_eq!(again.digest(), table.digest());
    assert_eq!((table.lag_ns(), table.device()), (240_000_000_000, isotherm_shared::wire::device("S/N 0107")));
}

#[test]
fn the_digest_of_format_2_is_the_documented_one() {
    let table = CoefficientTable::from_toml(TABLE, None).unwrap();
    let canonical = table.content().canonical();
    assert!(canonical.starts_with("isotherm-table 2\nimu.id 696d752d77686f6c65\n"), "{canonical}");
    // Computed independently by docs/digest.py from the description in docs/table.md.
    let digest = "sha256:448a74bda0ca784959fa8fc39cdb8681b0b6ef1a4c04869febd8efa2b07e81be";
    assert_eq!(table.digest().to_string(), digest);
    // Each part of format 2 counts.
    for (after, from, to) in [
        ("[lag]", "240.0", "241.0"),
        (A1, "transient = -31.0", "transient = -30.0"),
        (G1, "c0 = 5.87", "c0 = 5.88"),
        (G1, "transient = 0.71", "transient = 0.72"),
        (G1, "a3 = 0.09", "a3 = 0.08"),
        (G2, "max_rate = 4000000.0", "max_rate = 4000001.0"),
        ("[gyroscope_alignment]", "0.00035", "0.00036"),
    ] {
        let other = CoefficientTable::from_toml(&changed(after, from, to).0, None).unwrap();
        assert_ne!(other.digest(), table.digest(), "{to}");
    }
    let (same, _) = changed("negative_scale_factor", "c2 = 6.6233", "c2 = 6.62330");
    assert_eq!(CoefficientTable::from_toml(&same, None).unwrap().digest(), table.digest());
    let (explicit_zero, _) = changed(G2, "c3 = 0.0594", "c3 = 0.0594, transient = 0.0");
    assert_eq!(CoefficientTable::from_toml(&explicit_zero, None).unwrap().digest(), table.digest());
}

/// Values that are refused: the text that they come after, what is replaced, by what, the key of the fault, and a part
/// of its message.
type BadValue = (&'static str, &'static str, &'static str, &'static str, &'static str);

const BAD_VALUES: [BadValue; 47] = [
    ("format", "format = 2", "format = 4", "format", "reads format = 1, 2 and 3"),
    ("[lag]", "time_constant_s = 240.0", "time_constant_s = 0.0999", "lag.time_constant_s", "0.1 to 86400 s"),
    ("[lag]", "time_constant_s = 240.0", "time_constant_s = 86400.1", "lag.time_constant_s", "0.1 to 86400 s"),
    ("[lag]", "time_constant_s = 240.0", "time_constant_s = -240.0", "lag.time_constant_s", "0.1 to 86400 s"),
    ("[lag]", "time_constant_s = 240.0", "time_constant_s = 0", "lag.time_constant_s", "0.1 to 86400 s"),
    ("[lag]", "time_constant_s = 240.0", "time_constant_s = inf", "lag.time_constant_s", "finite"),
    ("[lag]", "time_constant_s = 240.0", "time_constant_s = \"240\"", "lag.time_constant_s", "number"),
    ("[lag]", "time_constant_s = 240.0", "time_constant_s = 240.0\nunit = \"s\"", "lag.unit", "unknown key"),
    (A1, "transient = -31.0", "transient = nan", "axis.A1.bias.transient", "finite"),
    (A1, "transient = -31.0", "transient = [1.0]", "axis.A1.bias.transient", "number"),
    // The range is 3.3 V wide: 1 g0 and 36000 deg/h over 3.3 V.
    (A1, "transient = -31.0", "transient = -303031.0", "axis.A1.bias.transient", "at most +-303030.3"),
    (A1, "transient = -31.0", "transient = 303031.0", "axis.A1.bias.transient", "at most +-303030.3"),
    (G1, "transient = 0.71", "transient = 10910.0", "gyroscope.G1.bias.transient", "at most +-10909.0"),
    (G3, "transient = -0.05", "transient = -10910.0", "gyroscope.G3.bias.transient", "at most +-10909.0"),
    (A1, "c3 = -89.142", "c3 = -89.142, transient = 1.0", "axis.A1.positive_scale_factor.transient", "unknown key"),
    ("[[gyroscope]]", "name = \"G1\"", "name = \"G2\"", "gyroscope.1.name", "give \"G1\""),
    ("[[gyroscope]]", "name = \"G1\"", "name = \"A1\"", "gyroscope.1.name", "give \"G1\""),
    (G2, "name = \"G3\"", "name = \"G2\"", "gyroscope.3.name", "give \"G3\""),
    (G1, "max_rate = 4000000.0", "max_rate = 0.0", "gyroscope.G1.max_rate", "over 0"),
    (G1, "max_rate = 4000000.0", "rate = 4000000.0", "gyroscope.G1.rate", "unknown key"),
    (G1, "range = [0.9, 4.2]", "range = [4.2, 0.9]", "gyroscope.G1.bias.range", "reversed"),
    (G1, "c2 = 1.611, ", "", "gyroscope.G1.bias.c2", "give c2 = 0.0"),
    (G1, "c0 = 1.0512", "scale = 0.0, c0 = 1.0512", "gyroscope.G1.positive_scale_factor.scale", "is 0"),
    // Beyond its bound in the middle of the range only.
    (
        G2,
        "c0 = -1.87, c1 = 0.83, c2 = -0.402, c3 = 0.0594",
        "center = 2.5, c0 = 36000.5, c1 = 0.0, c2 = -1.0",
        "gyroscope.G2.bias",
        "+-36000",
    ),
    (
        G2,
        "c0 = -1.87, c1 = 0.83, c2 = -0.402, c3 = 0.0594",
        "center = 2.5, c0 = -36000.5, c1 = 0.0, c2 = 1.0",
        "gyroscope.G2.bias",
        "+-36000",
    ),
    (
        G2,
        "c0 = 0.9871, c1 = -0.00024, c2 = 0.000107, c3 = -0.000016",
        "center = 2.5, c0 = 0.0000009, c1 = 0.0, c2 = 1.0",
        "gyroscope.G2.positive_scale_factor",
        "positive",
    ),
    (G2, "c0 = 0.9871", "c0 = -0.9871", "gyroscope.G2.positive_scale_factor", "positive"),
    (
        G2,
        "c0 = -0.9883, c1 = 0.00018, c2 = -0.000063, c3 = 0.000009",
        "center = 2.5, c0 = -0.0000009, c1 = 0.0, c2 = -1.0",
        "gyroscope.G2.negative_scale_factor",
        "negative",
    ),
    (G2, "c0 = -0.9883", "c0 = 0.9883", "gyroscope.G2.negative_scale_factor", "negative"),
    (G1, "a1 = 0.62", "a1 = 3600.1", "gyroscope.G1.g_sensitivity.a1", "+-3600"),
    (G1, "a2 = -0.18", "a2 = -3600.1", "gyroscope.G1.g_sensitivity.a2", "+-3600"),
    (G1, "a3 = 0.09", "a3 = nan", "gyroscope.G1.g_sensitivity.a3", "finite"),
    (G1, "a1 = 0.62, ", "", "gyroscope.G1.g_sensitivity.a1", "all three"),
    (G1, "a2 = -0.18, ", "", "gyroscope.G1.g_sensitivity.a2", "all three"),
    (G1, ", a3 = 0.09", "", "gyroscope.G1.g_sensitivity.a3", "all three"),
    (G1, "a3 = 0.09", "a3 = 0.09, a4 = 0.0", "gyroscope.G1.g_sensitivity.a4", "unknown key"),
    (G1, "unit = \"deg/h/g0\", ", "", "gyroscope.G1.g_sensitivity.unit", "deg/h/g0"),
    (G1, "\"deg/h/g0\"", "\"deg/h\"", "gyroscope.G1.g_sensitivity.unit", "deg/h/g0"),
    (G1, "\"deg/h/g0\"", "\"deg/s/g0\"", "gyroscope.G1.g_sensitivity.unit", "deg/h/g0"),
    // Units of the other kind.
    (A1, "unit = \"ug0\"", "unit = \"deg/h\"", "axis.A1.bias.unit", "\"ug0\""),
    (A1, "\"pulse/(s*g0)\"", "\"pulse/arcsec\"", "axis.A1.positive_scale_factor.unit", "pulse/(s*g0)"),
    (G1, "unit = \"deg/h\"", "unit = \"ug0\"", "gyroscope.G1.bias.unit", "deg/h"),
    (G1, "unit = \"deg/h\"", "unit = \"deg/s\"", "gyroscope.G1.bias.unit", "deg/h"),
    (G3, "\"pulse/arcsec\"", "\"pulse/(s*g0)\"", "gyroscope.G3.positive_scale_factor.unit", "pulse/arcsec"),
    ("[gyroscope_alignment]", "[[1.0, -0.0003, 0.0002], ", "[", "gyroscope_alignment.matrix", "not 3x3"),
    ("[gyroscope_alignment]", "[1.0, -0.0003, 0.0002]", "[0.0, 0.0, 0.0]", "gyroscope_alignment.matrix", "singular"),
    ("[gyroscope_alignment]", "[1.0, -0.0003, 0.0002]", "[1.0, nan, 0.0002]", "gyroscope_alignment.matrix", "finite"),
];

#[test]
fn every_bad_value_is_refused_at_its_line_and_key() {
    for (after, from, to, key, reason) in BAD_VALUES {
        let (text, line) = changed(after, from, to);
        let faults = CoefficientTable::from_toml(&text, None).expect_err(key);
        let [fault] = &faults.0[..] else { panic!("{key}, {to:?} after {after}: not one fault but\n{faults}") };
        assert_eq!((fault.key.as_str(), fault.line), (key, line), "{to:?}: {fault}");
        assert!(fault.message.contains(reason), "no {reason:?} in {fault}");
    }
}

#[test]
fn values_at_their_bounds_are_accepted() {
    for (after, from, to) in [
        ("[lag]", "240.0", "0.1"),
        ("[lag]", "240.0", "86400"),
        (A1, "transient = -31.0", "transient = -303030.0"),
        (G1, "transient = 0.71", "transient = 10909.0"),
        (G2, "c0 = -1.87, c1 = 0.83, c2 = -0.402, c3 = 0.0594", "center = 2.5, c0 = 36000.0, c1 = 0.0, c2 = -1.0"),
        (
            G2,
            "c0 = 0.9871, c1 = -0.00024, c2 = 0.000107, c3 = -0.000016",
            "center = 2.5, c0 = 0.0000011, c1 = 0.0, c2 = 1.0",
        ),
        (G2, "c0 = 0.9871, c1 = -0.00024, c2 = 0.000107, c3 = -0.000016", "c0 = 0.000001"),
        (G2, "c0 = -0.9883, c1 = 0.00018, c2 = -0.000063, c3 = 0.000009", "c0 = -0.000001"),
        (G1, "a1 = 0.62, a2 = -0.18", "a1 = 3600.0, a2 = -3600"),
    ] {
        let (text, _) = changed(after, from, to);
        if let Err(faults) = CoefficientTable::from_toml(&text, None) {
            panic!("{to}: {faults}");
        }
    }
}

/// Keys and lines of all faults.
fn places(text: &str) -> Vec<(String, usize)> {
    let faults = CoefficientTable::from_toml(text, None).unwrap_err();
    faults.0.into_iter().map(|fault| (fault.key, fault.line)).collect()
}

#[test]
fn one_or_two_gyroscopes_are_refused() {
    let two = without("[[gyroscope]]\nname = \"G3\"", "[gyroscope_alignment]");
    let one = without("[[gyroscope]]\nname = \"G2\"", "[gyroscope_alignment]");
    for (count, text) in [(2, two), (1, one)] {
        let faults = CoefficientTable::from_toml(&text, None).unwrap_err();
        assert_eq!(places(&text), [("gyroscope".to_owned(), line_of(&text, "#", "[[gyroscope]]"))], "{faults}");
        assert!(faults.0[0].message.starts_with(&format!("{count} of them; give exactly three")), "{faults}");
    }
    let four = format!(
        "{TABLE}\n{}",
        &TABLE[TABLE.find("[[gyroscope]]\nname = \"G3\"").unwrap()..TABLE.find("[gyroscope_alignment]").unwrap()]
    );
    assert_eq!(places(&four).len(), 1);
    let none = without("# K+ and K-", "[gyroscope_alignment]");
    assert_eq!(places(&none), [("gyroscope_alignment".to_owned(), line_of(&none, "#", "[gyroscope_alignment]"))]);
    let none = none
        .replace("[gyroscope_alignment]", "[alignment_before]")
        .replace("[alignment_before]\nmatrix", "[provenance.x]\nmatrix");
    CoefficientTable::from_toml(&none, None).unwrap();
}

#[test]
fn a_transient_needs_a_lag() {
    let text = without("[lag]", "[[axis]]");
    let key = |name: &str| format!("{name}.bias.transient");
    let line = |name: &str| line_of(&text, name, "transient");
    let expected = [
        (key("axis.A1"), line(A1)),
        (key("axis.A3"), line("name = \"A3\"")),
        (key("gyroscope.G1"), line(G1)),
        (key("gyroscope.G3"), line(G3)),
    ];
    assert_eq!(places(&text), expected);
    let faults = CoefficientTable::from_toml(&text, None).unwrap_err();
    assert!(faults.0.iter().all(|fault| fault.message.contains("give [lag] with time_constant_s")), "{faults}");
}

#[test]
fn format_1_has_no_part_of_format_2() {
    let text = TABLE.replacen("format = 2", "format = 1", 1);
    let keys: Vec<_> = places(&text).into_iter().map(|(key, _)| key).collect();
    let expected = [
        "lag",
        "axis.A1.bias.transient",
        "axis.A3.bias.transient",
        "gyroscope",
        "gyroscope.G1.bias.transient",
        "gyroscope.G3.bias.transient",
        "gyroscope_alignment",
    ];
    assert_eq!(keys, expected);
    let faults = CoefficientTable::from_toml(&text, None).unwrap_err();
    assert!(faults.0.iter().all(|fault| fault.message.contains("part of format 2; give format = 2")), "{faults}");
}

#[test]
fn a_transient_in_format_1_is_one_fault() {
    let text =
        include_str!("../../../examples/tables/imu-b.toml").replacen("c2 = 0.02", "c2 = 0.02, transient = 1.0", 1);
    assert_eq!(places(&text), [("axis.A1.bias.transient".to_owned(), line_of(&text, A1, "transient"))]);
}

#[test]
fn a_wrong_digest_is_refused() {
    let table = CoefficientTable::from_toml(TABLE, None).unwrap();
    let sealed = TABLE.replacen("format = 2\n", &format!("format = 2\ndigest = \"{}\"\n", table.digest()), 1);
    CoefficientTable::from_toml(&sealed, None).unwrap();
    let text = sealed.replacen("a1 = 0.62", "a1 = 0.63", 1);
    assert_eq!(places(&text), [("digest".to_owned(), 4)]);
}

/// What the provenance says of the turntable is not part of the digest, and is as good as absent if it cannot be right.
#[test]
fn the_turntable_is_read_from_the_provenance() {
    let read = |keys: &str| {
        let (table, _) = TABLE.split_once("[provenance]").unwrap();
        let text = format!("{table}\n[provenance]\n{keys}\n");
        CoefficientTable::from_toml(&text, None).unwrap().turntable().copied()
    };
    const EARTH: &str = "earth_rate_deg_h = [9.0, -7.0, 9.6]";
    let bare = read(EARTH).unwrap();
    assert_eq!((bare.earth_rate_deg_h, bare.tilt_rad), ([9.0, -7.0, 9.6], [0.0; 2]));
    assert_eq!((bare.earth_rate_standard_error, bare.mounting), (None, Matrix3::identity()));
    let rotated = "mounting = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]";
    let whole = format!(
        "{EARTH}\nearth_rate_standard_error = [0.003, 0.004]\nset_points = 15\ntilt_rad = [1e-5, -2e-5]\n{rotated}"
    );
    let whole = read(&whole).unwrap();
    assert_eq!((whole.earth_rate_standard_error, whole.freedom), (Some([0.003, 0.004]), 14));
    assert_eq!((whole.tilt_rad, whole.mounting[(0, 1)], whole.mounting[(1, 0)]), ([1e-5, -2e-5], 1.0, -1.0));
    for wrong in [
        "gravity_local = 9.8",
        "earth_rate_deg_h = [9.0, -7.0]",
        "earth_rate_deg_h = [9.0, -7.0, 19.6]",
        "earth_rate_deg_h = [9.0, -7.0, nan]",
        "earth_rate_deg_h = \"north\"",
        &format!("{EARTH}\ntilt_rad = [1e-5]"),
        &format!("{EARTH}\ntilt_rad = [0.2, 0.0]"),
        &format!("{EARTH}\nearth_rate_standard_error = [-0.003, 0.004]"),
        &format!("{EARTH}\nmounting = [[1, 0, 0], [0, 1, 0]]"),
        &format!("{EARTH}\nmounting = [[1, 0, 0], [0, 2, 0], [0, 0, 1]]"),
        &format!("{EARTH}\nmounting = 1"),
    ] {
        assert_eq!(read(wrong), None, "{wrong}");
    }
    assert_eq!(CoefficientTable::from_toml(TABLE, None).unwrap().turntable(), None);
}
