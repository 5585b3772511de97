//! Table files: every fault is refused, all faults are reported together, and the seal is checked.

use isotherm_tests::{TABLE, TestDomain, table, text, variant};
use std::fs;
use std::os::unix::fs::symlink;

/// A table of format 2. Its faults one by one are in shared/tests/format_2.rs.
const WHOLE: &str = include_str!("../../../examples/tables/imu-whole.toml");

/// Kinds of bad tables: description, text to replace, replacement, and the line and key that the message must name.
const BAD: [(&str, &str, &str, &str); 52] = [
    ("format missing", "format = 1\n", "", ":1: format: "),
    ("format unknown", "format = 1", "format = 4", ":1: format: "),
    ("format of the wrong type", "format = 1", "format = \"1\"", ":1: format: "),
    ("key unknown at the top", "format = 1", "format = 1\nformt = 1", ":2: formt: "),
    ("key unknown in imu", "[imu]", "[imu]\nserail = \"x\"", ":3: imu.serail: "),
    ("key unknown in temperature", "unit = \"V\"", "unit = \"V\"\nmax_age = 3.0", ":7: temperature.max_age: "),
    ("key unknown in an axis", "name = \"A2\"", "name = \"A2\"\nrate = 1.0", ":15: axis.A2.rate: "),
    ("key unknown in a polynomial", "c3 = -53.712", "c3 = -53.712, c8 = 1.0", ":10: axis.A1.bias.c8: "),
    ("section unknown", "[temperature]", "[notes]\na = 1\n[temperature]", ":5: notes: "),
    ("imu missing", "[imu]\nid = \"imu-a\"\ngravity = 9.8015\n", "", ":1: imu: "),
    ("temperature missing", "[temperature]\nunit = \"V\"\nout_of_range = \"clamp\"\n", "", ":1: temperature: "),
    ("an axis missing", "[[axis]]\nname = \"A3\"", "[axes]\nname = \"A3\"", ": axis: 2 of them"),
    ("axes in the wrong order", "name = \"A2\"", "name = \"A3\"", ":14: axis.2.name: "),
    ("axis of another name", "name = \"A1\"", "name = \"X\"", ":9: axis.1.name: "),
    ("axis without a name", "name = \"A1\"\n", "", ":8: axis.1.name: "),
    ("id missing", "id = \"imu-a\"\n", "", ":2: imu.id: "),
    ("id in capitals", "imu-a", "IMU-A", ":3: imu.id: "),
    ("id too long", "imu-a", "imu-aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", ":3: imu.id: "),
    ("id empty", "\"imu-a\"", "\"\"", ":3: imu.id: "),
    ("number not finite", "c0 = 793.55", "c0 = nan", ":10: axis.A1.bias.c0: "),
    ("number infinite", "c2 = 646.83", "c2 = inf", ":11: axis.A1.positive_scale_factor.c2: "),
    ("number that overflows", "c2 = 646.83", "c2 = 1e999", ":11: axis.A1.positive_scale_factor.c2: "),
    ("number in quotation marks", "c0 = 793.55", "c0 = \"793.55\"", ":10: axis.A1.bias.c0: "),
    ("coefficients as a list", "c0 = 793.55", "c0 = [793.55]", ":10: axis.A1.bias.c0: "),
    ("coefficient left out", "c1 = -1074.70, ", "", ":10: axis.A1.bias.c1: "),
    (
        "no coefficient",
        "c0 = 793.55, c1 = -1074.70, c2 = 420.81, c3 = -53.712",
        "center = 1.0",
        ":10: axis.A1.bias.c0: ",
    ),
    ("gravity too small", "9.8015", "9.6", ":4: imu.gravity: "),
    ("gravity too large", "9.8015", "9.91", ":4: imu.gravity: "),
    ("gravity missing", "gravity = 9.8015\n", "", ":2: imu.gravity: "),
    (
        "range empty",
        "bias = { unit = \"ug0\", range = [0.9, 4.2], c0 = 118.72",
        "bias = { unit = \"ug0\", range = [0.9, 0.9], c0 = 118.72",
        ":15: axis.A2.bias.range: ",
    ),
    (
        "range reversed",
        "range = [0.9, 4.2], c0 = 118.72",
        "range = [4.2, 0.9], c0 = 118.72",
        ":15: axis.A2.bias.range: ",
    ),
    ("range missing", "range = [0.9, 4.2], c0 = 118.72", "c0 = 118.72", ":15: axis.A2.bias.range: "),
    (
        "range of three",
        "range = [0.9, 4.2], c0 = 118.72",
        "range = [0.9, 2.0, 4.2], c0 = 118.72",
        ":15: axis.A2.bias.range: ",
    ),
    (
        "bias beyond 1 g0",
        "unit = \"ug0\", range = [0.9, 4.2], c0 = 118.72",
        "unit = \"g0\", range = [0.9, 4.2], c0 = 118.72",
        ":15: axis.A2.bias: ",
    ),
    (
        "bias beyond 1 g0 inside its range only",
        "c0 = 118.72, c1 = -201.30, c2 = 101.35, c3 = -14.823",
        "c0 = -10500000.0, c1 = 9000000.0, c2 = -1760000.0",
        ":15: axis.A2.bias: ",
    ),
    ("K+ negative", "c0 = 91733.0", "c0 = -91733.0", ":11: axis.A1.positive_scale_factor: "),
    ("K- positive", "c0 = -90072.0", "c0 = 90072.0", ":12: axis.A1.negative_scale_factor: "),
    (
        "K+ zero inside its range only",
        "c0 = 91042.0, c1 = 262.28, c2 = -46.73, c3 = 6.220",
        "c0 = 650250.0, c1 = -510000.0, c2 = 100000.0",
        ":16: axis.A2.positive_scale_factor: ",
    ),
    (
        "K+ below 1 in a notch of the seventh order",
        "c0 = 91042.0, c1 = 262.28, c2 = -46.73, c3 = 6.220",
        "center = 2.345, scale = 1.0, c0 = 0.5, c1 = 0.0, c2 = 1e9, c3 = 0.0, c4 = 1e9, c5 = 0.0, c6 = 1e9, c7 = 1.0",
        ":16: axis.A2.positive_scale_factor: ",
    ),
    (
        "K- smaller than 1",
        "c0 = -90546.0, c1 = -651.79, c2 = 182.9, c3 = -19.534",
        "c0 = -0.5",
        ":17: axis.A2.negative_scale_factor: ",
    ),
    ("scale of 0", "c3 = -53.712", "c3 = -53.712, scale = 0.0", ":10: axis.A1.bias.scale: "),
    (
        "order over 7",
        "c3 = -53.712",
        "c3 = -53.712, c4 = 0.0, c5 = 0.0, c6 = 0.0, c7 = 0.0, c8 = 0.0",
        ":10: axis.A1.bias.c8: ",
    ),
    (
        "unit missing",
        "unit = \"ug0\", range = [0.9, 4.2], c0 = 118.72",
        "range = [0.9, 4.2], c0 = 118.72",
        ":15: axis.A2.bias.unit: ",
    ),
    (
        "unit unknown",
        "\"ug0\", range = [0.9, 4.2], c0 = 118.72",
        "\"ugal\", range = [0.9, 4.2], c0 = 118.72",
        ":15: axis.A2.bias.unit: ",
    ),
    (
        "unit misplaced",
        "unit = \"pulse/(s*g0)\", range = [0.9, 4.2], c0 = 91733.0",
        "unit = \"ug0\", range = [0.9, 4.2], c0 = 91733.0",
        ":11: axis.A1.positive_scale_factor.unit: ",
    ),
    ("policy unknown", "\"clamp\"", "\"hold\"", ":7: temperature.out_of_range: "),
    (
        "alignment not 3x3",
        "format = 1",
        "format = 1\n[alignment]\nmatrix = [[1, 0], [0, 1]]\n",
        ":3: alignment.matrix: ",
    ),
    (
        "alignment singular",
        "format = 1",
        "format = 1\n[alignment]\nmatrix = [[1, 2, 3], [2, 4, 6], [0, 0, 1]]\n",
        ":3: alignment.matrix: ",
    ),
    ("digest wrong", "format = 1", "format = 1\ndigest = \"sha256:00\"", ":2: digest: "),
    ("max_rate of 0", "name = \"A1\"", "name = \"A1\"\nmax_rate = 0.0", ":10: axis.A1.max_rate: "),
    ("max_age_s negative", "unit = \"V\"", "unit = \"V\"\nmax_age_s = -1", ":7: temperature.max_age_s: "),
    ("no TOML", "[imu]", "[imu", ":2: "),
];

#[test]
fn every_kind_of_bad_table_is_refused_with_line_and_key() {
    let domain = TestDomain::new();
    for (kind, from, to, place) in BAD {
        assert!(TABLE.contains(from), "{kind}: {from:?} is not in the table");
        domain.write("bad.toml", &TABLE.replacen(from, to, 1));
        let output = domain.run(&["check", "bad.toml"]);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(78), "{kind}: {message}");
        assert!(
            message.contains(&format!("bad.toml{place}")) || message.contains(place),
            "{kind}: no {place:?} in\n{message}"
        );
        assert!(output.stdout.is_empty(), "{kind}");
    }
}

#[test]
fn unsuitable_files_are_refused() {
    let domain = TestDomain::new();
    fs::write(
        domain.path("latin1.toml"),
        TABLE
            .replacen("[imu]", "# \u{e9}\n[imu]", 1)
            .replace('\u{e9}', "E")
            .into_bytes()
            .iter()
            .map(|&byte| if byte == b'E' { 0xe9 } else { byte })
            .collect::<Vec<_>>(),
    )
    .unwrap();
    domain.write("large.toml", &format!("{TABLE}# {}\n", "x".repeat(1 << 20)));
    fs::create_dir(domain.path("folder.toml")).unwrap();
    mkfifo(&domain, "pipe.toml");
    domain.write("empty.toml", "");
    for (file, message) in [
        ("latin1.toml", "latin1.toml:2: not UTF-8"),
        ("large.toml", "over 1048576 bytes"),
        ("folder.toml", "not a regular file"),
        ("pipe.toml", "not a regular file"),
        ("/dev/zero", "not a regular file"),
        ("empty.toml", "neither a coefficient table"),
    ] {
        let output = domain.run(&["check", file]);
        assert_eq!(output.status.code(), Some(78), "{file}");
        assert!(text(&output.stderr).contains(message), "{file}: {}", text(&output.stderr));
    }
    assert_eq!(domain.run(&["check", "absent.toml"]).status.code(), Some(74));
}

fn mkfifo(domain: &TestDomain, name: &str) {
    let status = std::process::Command::new("mkfifo").arg(domain.path(name)).status().unwrap();
    assert!(status.success());
}

#[test]
fn all_faults_of_all_files_are_reported_together() {
    let domain = TestDomain::new();
    let bad = TABLE
        .replace("format = 1", "format = 4")
        .replace("gravity = 9.8015", "gravity = 98.015")
        .replace("c0 = 91733.0", "c0 = 0.0, c9 = 1.0")
        .replace(
            "unit = \"ug0\", range = [0.9, 4.2], c0 = 84.70",
            "unit = \"ug0\", range = [4.2, 0.9], c0 = \"84.70\"",
        );
    domain.write("bad.toml", &bad);
    domain.write("worse.toml", "[[imu]]\nid = \"A\"\n");
    domain.write("good.toml", TABLE);
    let output = domain.run(&["check", "bad.toml", "good.toml", "worse.toml"]);
    assert_eq!(output.status.code(), Some(78));
    let message = text(&output.stderr);
    for place in [
        "bad.toml:1: format: ",
        "bad.toml:4: imu.gravity: ",
        "bad.toml:11: axis.A1.positive_scale_factor: ",
        "bad.toml:11: axis.A1.positive_scale_factor.c9: ",
        "bad.toml:20: axis.A3.bias.range: ",
        "bad.toml:20: axis.A3.bias.c0: ",
        "worse.toml:2: imu.1.id: ",
        "worse.toml:1: imu.1.table: ",
    ] {
        assert!(message.contains(place), "no {place:?} in\n{message}");
    }
    assert!(text(&output.stdout).starts_with("good.toml: table of imu-a, sha256:"));
    domain.write(
        "service.toml",
        "[[imu]]\nid = \"imu-a\"\ntable = \"bad.toml\"\n[[imu]]\nid = \"imu-b\"\ntable = \"good.toml\"\n",
    );
    for command in [&["check", "service.toml"][..], &["serve", "--config", "service.toml"]] {
        let output = domain.run(command);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(78), "{message}");
        assert!(message.contains("bad.toml:20: ") && message.contains("belongs to imu-a, not to imu-b"), "{message}");
    }
}

#[test]
fn a_seal_is_written_and_checked_and_survives_irrelevant_changes() {
    let domain = TestDomain::new();
    let path = domain.write("imu-a.toml", &format!("# a comment\n{TABLE}\n[provenance]\nby = \"hand\"\n"));
    assert!(domain.run_ok(&["check", "imu-a.toml"]).contains("not sealed"));
    symlink("imu-a.toml", domain.path("link.toml")).unwrap();
    assert!(domain.run_ok(&["check", "--seal", "link.toml"]).contains("sealed"));
    assert!(fs::symlink_metadata(domain.path("link.toml")).unwrap().is_symlink());
    let sealed = fs::read_to_string(&path).unwrap();
    let digest = table(TABLE).digest().to_string();
    assert_eq!(
        sealed,
        format!("# a comment\n{TABLE}\n[provenance]\nby = \"hand\"\n").replacen(
            "format = 1\n",
            &format!("format = 1\ndigest = \"{digest}\"\n"),
            1
        )
    );
    for unimportant in [
        sealed.replace("# a comment\n", ""),
        sealed.replace("by = \"hand\"", "by = \"machine\""),
        sealed.replace("c0 = 91733.0", "c0 = 9.1733e4"),
        sealed.replace("c0 = 793.55, c1 = -1074.70", "c1 = -1074.7, c0 = 793.55, center = 0, scale = 1"),
    ] {
        domain.write("imu-a.toml", &unimportant);
        assert!(domain.run_ok(&["check", "imu-a.toml"]).contains("seal intact"), "{unimportant}");
    }
    for important in [
        sealed.replace("91733.0", "91733.1"),
        sealed.replace("imu-a", "imu-b"),
        sealed.replace("\"clamp\"", "\"reject\""),
        sealed.replace("\"V\"", "\"mV\""),
        sealed.replace("gravity = 9.8015", "gravity = 9.8015\nserial = \"S\""),
        sealed.replacen("format = 1", "format = 2", 1),
        format!("{sealed}[alignment]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"),
    ] {
        domain.write("imu-a.toml", &important);
        let output = domain.run(&["check", "imu-a.toml"]);
        assert_eq!(output.status.code(), Some(78), "{important}");
        assert!(text(&output.stderr).contains("digest"), "{}", text(&output.stderr));
        domain.run_ok(&["check", "--seal", "imu-a.toml"]);
        assert!(domain.run_ok(&["check", "imu-a.toml"]).contains("seal intact"));
    }
    domain.write("bad.toml", &TABLE.replace("91733.0", "-1.0"));
    assert_eq!(domain.run(&["check", "--seal", "bad.toml"]).status.code(), Some(78));
    assert!(!fs::read_to_string(domain.path("bad.toml")).unwrap().contains("digest"));
}

#[test]
fn a_table_written_by_the_program_is_the_same_table() {
    for text in [variant(0), variant(3), variant(50), WHOLE.to_owned()] {
        let original = table(&text);
        assert_eq!(table(&original.to_toml()), original);
    }
}

#[test]
fn check_describes_a_whole_imu_and_reports_its_faults() {
    let domain = TestDomain::new();
    domain.write("whole.toml", WHOLE);
    domain.write("imu-a.toml", TABLE);
    let described = domain.run_ok(&["check", "whole.toml", "imu-a.toml"]);
    for line in [
        "  lag of the head temperature: 240 s",
        "  transient: A1 -31 ug0 per V, A3 14 ug0 per V, G1 0.71 deg/h per V, G3 -0.05 deg/h per V",
        "  G1: bias in deg/h over 0.9 .. 4.2 V; K+ and K- in pulse/arcsec over 0.9 .. 4.2 V and 0.9 .. 4.2 V; \
         g-sensitivity 0.62, -0.18, 0.09 deg/h/g0",
        "  G2: bias in deg/h over 0.9 .. 4.2 V; K+ and K- in pulse/arcsec over 0.9 .. 4.2 V and 0.9 .. 4.2 V",
        "  alignment of the gyroscopes",
    ] {
        assert!(described.lines().any(|found| found == line), "no {line:?} in\n{described}");
    }
    // A table of format 1 is described in one line, as ever.
    let (_, last) = described.split_once("imu-a.toml: ").unwrap();
    assert_eq!(last, format!("table of imu-a, {}, not sealed\n", table(TABLE).digest()));

    let bad = WHOLE
        .replacen("time_constant_s = 240.0", "time_constant_s = 1e6", 1)
        .replacen("transient = 0.71", "transient = 11000.0", 1)
        .replacen("c0 = 0.9871", "c0 = -0.9871", 1)
        .replacen("a2 = 0.27, ", "", 1);
    domain.write("bad.toml", &bad);
    let output = domain.run(&["check", "bad.toml"]);
    assert_eq!(output.status.code(), Some(78));
    let message = text(&output.stderr);
    for place in [
        ":16: lag.time_constant_s: ",
        ":46: gyroscope.G1.bias.transient: ",
        ":55: gyroscope.G2.positive_scale_factor: ",
        ":64: gyroscope.G3.g_sensitivity.a2: ",
    ] {
        assert!(message.contains(&format!("bad.toml{place}")), "no {place:?} in\n{message}");
    }
}

#[test]
fn a_number_that_is_none_is_shown_and_a_digest_is_told_beside_other_faults() {
    let domain = TestDomain::new();
    let refused = |name: &str, content: &str| {
        domain.write(name, content);
        let checked = domain.run(&["check", name]);
        // The service says the same.
        let served = domain.run(&["serve", "--imu", &format!("imu-a={name}")]);
        assert_eq!([&checked, &served].map(|output| output.status.code()), [Some(78); 2]);
        let [checked, served] = [&checked, &served].map(|output| text(&output.stderr));
        assert_eq!(checked, served);
        checked.replace("isotherm: ", "")
    };
    let found = refused("letters.toml", &TABLE.replace("420.81", "42O.81").replace("9.8015", "9,8015"));
    assert!(found.starts_with("letters.toml:4: not TOML: "), "{found}");
    // The place: the letter in the number, in what is shown of the line.
    let shown = |found: &str, name: &str| {
        let mut lines = found.lines().skip_while(|line| !line.starts_with(&format!("{name}: not TOML: ")));
        let [_, line, mark] =
            [lines.next(), lines.next(), lines.next()].map(|line| line.unwrap_or_default().to_owned());
        assert!(mark.trim_start() == "^", "{found}");
        line[mark.len() - 1..].to_owned()
    };
    assert!(shown(&found, "letters.toml:10").starts_with("O.81"), "{found}");
    // The digest of a text that cannot be read cannot be checked; that of other faults can.
    domain.write("sealed.toml", TABLE);
    domain.run_ok(&["check", "--seal", "sealed.toml"]);
    let sealed = fs::read_to_string(domain.path("sealed.toml")).unwrap();
    let found = refused("unread.toml", &sealed.replace("91733.0", "9l733.0"));
    let digest = "unread.toml:2: digest: cannot be checked until these are right\n";
    assert!(found.starts_with(&format!("{digest}unread.toml:12: not TOML: invalid float")), "{found}");
    assert!(shown(&found, "unread.toml:12").starts_with("l733.0"), "{found}");
    // A letter in front, and a row of a matrix that begins lines above.
    let matrix =
        "[alignment] # of the body\nmatrix = [\n  [1.0, 0.0, 0.0],\n  [0.0, l.0, 0.0],\n  [0.0, 0.0, 1.0],\n]\n";
    let found = refused("matrix.toml", &format!("{}{matrix}", TABLE.replace("420.81", "O420.81")));
    assert!(shown(&found, "matrix.toml:10").starts_with("O420.81"), "{found}");
    assert!(found.contains("matrix.toml:26: not TOML: string values must be quoted"), "{found}");
    let found = refused("both.toml", &sealed.replace("91733.0", "-91733.0"));
    let lines: Vec<_> = found.lines().collect();
    assert_eq!(lines.len(), 2, "{found}");
    assert!(lines[0].starts_with("both.toml:2: digest: is \"sha256:") && lines[0].contains("but the content has"));
    assert!(lines[1].starts_with("both.toml:12: axis.A1.positive_scale_factor: is -92551"), "{found}");
    let found = refused("partial.toml", &sealed.replace("gravity = 9.8015", "gravity = \"x\""));
    assert!(found.contains("partial.toml:2: digest: cannot be checked until these are right"), "{found}");
}
