//! Text from files, names and streams cannot steer the terminal of the person who reads it.

use isotherm_support::failure::printable;
use isotherm_tests::{RUN, TABLE, TestDomain, text, wait_until};
use std::fs;
use std::process::Output;

/// Sets the title of a terminal, clears it, returns to the beginning of the line, turns the direction of writing, and
/// begins a line.
const HOSTILE: &str = "\u{1b}]0;x\u{7}\u{9b}2J\r\u{202e}\nFORGED";
/// The same in TOML.
const HOSTILE_TOML: &str = r"\u001b]0;x\u0007\u009b2J\r\u202e\nFORGED";

/// Asserts that the output has the hostile text, and has it escaped.
#[track_caller]
fn assert_escaped(printed: &str) {
    assert_eq!(printable(printed), printed);
    assert!(!printed.lines().any(|line| line.trim_start().starts_with("FORGED")), "{printed}");
    let shown = ["\\u{1b}", "\\u{202e}", "\\x1b"];
    assert!(shown.iter().any(|escaped| printed.contains(escaped)), "the hostile text is not in: {printed}");
}

#[track_caller]
fn assert_refused(output: &Output, code: i32) {
    let printed = text(&output.stderr) + &text(&output.stdout);
    assert_eq!(output.status.code(), Some(code), "{printed}");
    assert_escaped(&printed);
}

#[test]
fn hostile_text_in_files_is_escaped() {
    let domain = TestDomain::new();
    let table = domain.write("good.toml", TABLE);
    let table = table.to_str().unwrap();
    // TOML: keys, values, and what is no TOML.
    for (name, content) in [
        ("key.toml", TABLE.replacen("[imu]", &format!("[imu]\n\"{HOSTILE_TOML}\" = 1"), 1)),
        ("section.toml", format!("{TABLE}\n[\"{HOSTILE_TOML}\"]\na = 1\n")),
        ("id.toml", TABLE.replacen("\"imu-a\"", &format!("\"{HOSTILE_TOML}\""), 1)),
        ("unit.toml", TABLE.replacen("\"ug0\"", &format!("\"{HOSTILE_TOML}\""), 1)),
        ("plan.toml", format!("[chamber]\n\"{HOSTILE_TOML}\" = 1\n")),
        ("config.toml", format!("[[imu]]\nid = \"{HOSTILE_TOML}\"\ntable = \"{HOSTILE_TOML}\"\n")),
        ("campaign.toml", format!("[[position]]\n\"{HOSTILE_TOML}\" = 1\n")),
    ] {
        domain.write(name, &content);
        assert_refused(&domain.run(&["check", domain.path(name).to_str().unwrap()]), 78);
    }
    // Arguments that are repeated, such as the name of a file that looks like an option.
    assert_refused(&domain.run(&["check", &format!("--{}", HOSTILE.replace('\n', ""))]), 64);
    // CSV: names of columns and fields. A carriage return in a row is refused without being shown.
    let hostile = HOSTILE.replace(['\r', '\n'], "");
    let run = fs::read_to_string(RUN).unwrap();
    let (header, rows) = run.split_once('\n').unwrap();
    for (name, content) in [
        ("header.csv", format!("{}\n{rows}", header.replace("a1_head", &hostile))),
        ("field.csv", format!("{header}\n{hostile}{}\n", ",0".repeat(14))),
    ] {
        domain.write(name, &content);
        assert_refused(&domain.run(&["replay", "--table", table, domain.path(name).to_str().unwrap()]), 65);
    }
    // MCAP: the name of a chunk's compression.
    let mut chunk: Vec<u8> = [[0; 8], [0; 8], [0; 8]].concat();
    chunk.extend([0; 4]);
    chunk.extend((HOSTILE.len() as u32).to_le_bytes());
    chunk.extend(HOSTILE.as_bytes());
    chunk.extend([0; 8]);
    let mut mcap = b"\x89MCAP0\r\n\x06".to_vec();
    mcap.extend((chunk.len() as u64).to_le_bytes());
    mcap.extend(chunk);
    fs::write(domain.path("r.mcap"), mcap).unwrap();
    assert_refused(&domain.run(&["replay", "--table", table, domain.path("r.mcap").to_str().unwrap()]), 65);
    // Names of files, in what is printed when all is well too.
    domain.write(&format!("{HOSTILE}.toml"), TABLE);
    assert_escaped(&domain.run_ok(&["check", domain.path(&format!("{HOSTILE}.toml")).to_str().unwrap()]));
    assert_refused(&domain.run(&["check", domain.path(&format!("{HOSTILE}/none")).to_str().unwrap()]), 74);
}

#[test]
fn the_columns_of_a_regression_are_escaped_and_its_json_is_json() {
    let domain = TestDomain::new();
    let rows: String = (0..20).map(|x| format!("{x},{}\n", 2 * x + x % 3)).collect();
    let column = HOSTILE.replace(['\r', '\n'], "");
    let data = domain.write("data.csv", &format!("{column},y\n{rows}"));
    let data = data.to_str().unwrap();
    let arguments = ["regress", data, "--x", &column, "--y", "y"];
    assert_escaped(&domain.run_ok(&arguments));
    let json = domain.run_ok(&[&arguments[..], &["--json"]].concat());
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(document["x"], column);
}

/// The log, `status` and its JSON, of a service whose table has a hostile name and then a hostile fault.
#[test]
fn a_services_log_and_status_are_escaped() {
    let domain = TestDomain::new();
    let name = format!("{HOSTILE}.toml");
    domain.write(&name, TABLE);
    let path = domain.path(&name);
    let service = domain.serve(&["--imu", &format!("imu-a={}", path.display())]);
    assert_escaped(&domain.run_ok(&["status"]));
    domain.replace(&name, &TABLE.replacen("[imu]", &format!("[imu]\n\"{HOSTILE_TOML}\" = 1"), 1));
    wait_until("the refusal", || !domain.imu_status()["last_reload_error"].is_null());
    let status = domain.run_ok(&["status"]);
    assert!(status.contains("REFUSED"), "{status}");
    assert_escaped(&status);
    assert_eq!(domain.imu_status()["table_file"], path.display().to_string());
    service.wait_for_log("table refused");
    assert_escaped(&service.log());
    service.terminate();
}
