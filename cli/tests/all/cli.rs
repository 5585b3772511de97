//! The command line's own behaviour: exit codes, help, and what goes to stdout and stderr.

use std::process::{Command, Output};

fn isotherm(arguments: &[&str]) -> Output {
    // No service runs in this domain, and none of these commands leaves anything in it.
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.args(arguments).env("ISOTHERM_DOMAIN", "cli-test").env("ISOTHERM_ROOT", folder.path());
    let output = command.output().unwrap();
    assert_eq!(folder.path().read_dir().unwrap().count(), 0, "{arguments:?} left something behind");
    output
}

#[test]
fn exit_codes_are_those_of_sysexits() {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data");
    let (run, table) = (format!("{data}/run.csv"), format!("{data}/imu-a.toml"));
    let cases: [(&[&str], i32); 14] = [
        (&["--help"], 0),
        (&["--version"], 0),
        (&[], 64),
        (&["frobnicate"], 64),
        (&["feed", "--imu", "IMU", &run], 64),
        (&["feed", "--imu", "imu-a", "--rate", "0", &run], 64),
        (&["--domain", "No Domain", "status"], 64),
        (&["serve"], 64),
        (&["status"], 69),
        (&["feed", "--imu", "imu-a", "--timeout", "0.1", &run], 69),
        (&["replay", "--table", &table, "/nowhere/run.csv"], 74),
        (&["replay", "--table", &table, &table], 65),
        (&["replay", "--table", &run, &run], 78),
        (&["serve", "--config", &table], 78),
    ];
    for (arguments, code) in cases {
        let output = isotherm(arguments);
        let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{out}\n{err}");
        assert_eq!(
            code == 0,
            err.is_empty(),
            "{arguments:?}: words go to stderr, and only if something is wrong\n{err}"
        );
        assert_eq!(code == 0, !out.is_empty(), "{arguments:?}: nothing but data goes to stdout\n{out}");
    }
}

/// The help of every command and subcommand, by its path.
fn helps(path: &[&str], helps: &mut Vec<(String, String)>) {
    let output = isotherm(&[path, &["--help"]].concat());
    let help = String::from_utf8(output.stdout).unwrap();
    let names = help.split("\nCommands:\n").nth(1).and_then(|rest| rest.split("\n\n").next()).unwrap_or_default();
    // A description's second line is indented further.
    let names = names.lines().filter_map(|line| line.strip_prefix("  ")).filter(|line| !line.starts_with(' '));
    for name in names.filter_map(|line| line.split(' ').next()).filter(|name| *name != "help") {
        self::helps(&[path, &[name]].concat(), helps);
    }
    helps.push((path.join(" "), help));
}

#[test]
fn every_help_has_examples_and_exit_codes_and_the_domain_where_there_is_one() {
    let mut all = Vec::new();
    helps(&[], &mut all);
    assert!(all.len() > 22, "{}", all.len());
    let without = [
        "calibrate",
        "check",
        "compare",
        "completions",
        "convert",
        "demo",
        "describe",
        "explain",
        "export",
        "import",
        "man",
        "noise",
        "regress",
        "replay",
        "verify",
    ];
    let without_below = [
        "calibrate tumble",
        "calibrate turntable",
        "calibrate warm-up",
        "campaign check",
        "campaign status",
        "campaign stop",
        "simulate campaign",
        "simulate ramp",
        "simulate run",
    ];
    for (path, help) in all {
        assert!(help.contains("Examples:"), "{path}");
        assert!(help.contains("Exit codes: 0 done, 1 failed, 64 usage"), "{path}:\n{help}");
        let without = without.contains(&path.as_str()) || without_below.contains(&path.as_str());
        assert_eq!(help.contains("--domain <NAME>"), !without, "{path}:\n{help}");
    }
}

#[test]
fn the_domain_is_accepted_where_it_is_not_shown() {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data");
    let (run, table) = (format!("{data}/run.csv"), format!("{data}/imu-a.toml"));
    let plan = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/plan.toml");
    for arguments in [
        &["replay", "--domain", "other", "--table", &table, &run][..],
        &["--domain", "other", "check", &table],
        &["campaign", "check", "--domain", "other", plan],
    ] {
        let output = isotherm(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    assert_eq!(isotherm(&["check", "--domain", "No Domain", &table]).status.code(), Some(64));
}

#[test]
fn columns_that_are_missing_are_named_beside_those_that_are_there() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let (run, table) = (format!("{root}/tests/data/run.csv"), format!("{root}/tests/data/imu-a.toml"));
    let (cubic, campaign) = (format!("{root}/examples/cubic.csv"), format!("{root}/examples/campaign/campaign.toml"));
    for (arguments, missing, found) in [
        (
            &["replay", "--table", &table, &format!("{root}/tests/data/run.expected.csv")][..],
            "a1_positive, a1_negative, a1_head",
            "; found: sequence, timestamp_ns, ",
        ),
        (&["regress", &cubic, "--x", "u", "--y", "y"], "missing columns: u", "; found: x, y"),
        (
            &["calibrate", "turntable", &campaign, &run, "-o", "/dev/null"],
            "missing columns: set_point_c, position",
            "; found: sequence, timestamp_ns",
        ),
    ] {
        let output = isotherm(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(65), "{arguments:?}: {said}");
        assert!(said.contains(missing) && said.contains(found), "{arguments:?}: {said}");
    }
}

#[test]
fn a_csv_given_for_a_toml_is_recognised() {
    let run = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/run.csv");
    for (arguments, wanted) in [
        (&["calibrate", "turntable", run, "-o", "/dev/null"][..], "give the campaign file that names it"),
        (&["campaign", "check", run], "give the campaign plan"),
        (&["replay", "--table", run, run], "give the coefficient table"),
        (&["serve", "--config", run], "give the service configuration"),
        (&["serve", "--imu", &format!("imu-a={run}")], "give the coefficient table"),
    ] {
        let output = isotherm(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(78), "{arguments:?}: {said}");
        assert!(said.contains("CSV") && said.contains(wanted), "{arguments:?}: {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

/// `check` and `campaign check` say the same of a plan.
#[test]
fn a_plan_whose_alarms_nobody_reads_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let plan = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/plan.toml")).unwrap();
    let path = folder.path().join("plan.toml");
    std::fs::write(&path, plan.replace("driver = \"acutrol\"", "driver = \"aerosmith\"")).unwrap();
    let path = path.to_str().unwrap();
    for arguments in [&["check", path][..], &["campaign", "check", path]] {
        let output = isotherm(arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(said.contains("warning [faults-not-read]: "), "{arguments:?}: {said}");
    }
}

/// The first line of each help, as a list shows it.
fn first_lines(command: &clap::Command, path: &str, lines: &mut Vec<(String, String)>) {
    let path = format!("{path}{} ", command.get_name());
    lines.push((path.clone(), command.get_about().map(ToString::to_string).unwrap_or_default()));
    for argument in command.get_arguments().filter(|argument| !argument.is_hide_set()) {
        let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
        lines.push((format!("{path}{}", argument.get_id()), help));
    }
    for subcommand in command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set()) {
        first_lines(subcommand, &path, lines);
    }
}

#[test]
fn every_help_begins_with_at_most_eight_words() {
    let mut lines = Vec::new();
    first_lines(&isotherm_cli::command(), "", &mut lines);
    first_lines(&isotherm_service::command("0"), "", &mut lines);
    let is_short = |line: &str| (2..=8).contains(&line.split_whitespace().count());
    let begins = |line: &str| line.starts_with(char::is_uppercase);
    let long: Vec<_> =
        lines.iter().filter(|(_, line)| !is_short(line) || !begins(line) || line.ends_with(['.', ':', ';'])).collect();
    assert!(lines.len() > 200 && long.is_empty(), "{} of {}: {long:#?}", long.len(), lines.len());
}

#[test]
fn messages_can_be_silenced() {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data");
    let (run, table) = (format!("{data}/run.csv"), format!("{data}/imu-a.toml"));
    let replay = ["replay", "--table", &table, &run];
    assert!(isotherm(&replay).stderr.starts_with(b"isotherm: "));
    let quiet = isotherm(&[&["-q"], &replay[..]].concat());
    assert!(quiet.status.success() && quiet.stderr.is_empty() && quiet.stdout == isotherm(&replay).stdout);
    let failed = isotherm(&["replay", "--quiet", "--table", &table, "/nowhere/run.csv"]);
    assert!(failed.status.code() == Some(74) && failed.stderr.starts_with(b"isotherm: "));
    assert_eq!(isotherm(&["-q", "-v", "status"]).status.code(), Some(64));
}
