//! Running the commands on files, as a user types them.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

/// Runs a command. What this user's services have left in other domains does not count.
pub(crate) fn isotherm(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.args(arguments).current_dir(folder).env("ISOTHERM_ROOT", folder).env_remove("ISOTHERM_STATE");
    command.output().unwrap()
}

/// Runs a command that must end with `code`. Returns what it printed on stdout and stderr.
pub(crate) fn run(folder: &Path, code: i32, arguments: &[&str]) -> (String, String) {
    let output = isotherm(folder, arguments);
    let texts = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{}\n{}", texts.0, texts.1);
    texts
}

/// The samples of another unit of a kind: in each row, A3 has `more` pulses more, where it has any.
pub(crate) fn other_device(samples: &str, more: u32) -> String {
    let mut lines = samples.lines();
    let header = lines.next().unwrap();
    let columns = header.split(',').enumerate().filter(|(_, name)| ["a3_positive", "a3_negative"].contains(name));
    let columns: Vec<_> = columns.map(|(index, _)| index).collect();
    let row = |line: &str| {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        for column in &columns {
            let count: u32 = fields[*column].parse().unwrap();
            fields[*column] = (if count > 0 { count + more } else { 0 }).to_string();
        }
        fields.join(",") + "\n"
    };
    format!("{header}\n") + &lines.map(row).collect::<String>()
}

/// A folder that is removed in the end.
pub(crate) fn folder() -> TempDir {
    tempfile::Builder::new().prefix("iso-").tempdir().unwrap()
}

/// Checks that a report with over six figures loads nothing from elsewhere, and has these texts.
pub(crate) fn assert_self_contained(path: &Path, contains: &[&str]) {
    assert_page(path, 6, contains);
}

/// Checks that a report with over `figures` figures loads nothing from elsewhere, and has these texts.
pub(crate) fn assert_page(path: &Path, figures: usize, contains: &[&str]) {
    let html = fs::read_to_string(path).unwrap();
    for word in ["http://", "https://", "<script", "<link", "src=", "NaN", "inf<"] {
        assert!(!html.contains(word), "{}: {word}", path.display());
    }
    for word in contains {
        assert!(html.contains(word), "{}: {word}", path.display());
    }
    let drawn = html.matches("<svg").count();
    assert!(drawn > figures && drawn == html.matches("</svg>").count(), "{}: {drawn} figures", path.display());
}
