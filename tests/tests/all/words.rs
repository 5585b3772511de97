//! One word for one thing (`docs/glossary.md`), names that one can read aloud, and natural prose.

mod prose;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Words that are not used, what is used in their place, and the names that keep a word, since other programs read
/// them.
const WORDS: &[(&str, &str, &[&str])] = &[
    (
        "telemetry",
        "temperature",
        &[
            "telemetry_ns",
            "telemetry-stale",
            "telemetry_stale",
            "isotherm_telemetry",
            "telemetry log",
            "telemetry_log",
            "telemetry_lsb_micro",
            "telemetry_per_h",
            "double telemetry",
            "sensor, telemetry",
            "].telemetry",
        ],
    ),
    ("standstill", "static pose", &[]),
    ("put down by hand", "tumble", &[]),
    ("mended", "fixed", &["recommended"]),
    ("mends", "fixes", &["amends", "commends", "recommends"]),
];

/// Public types that end as a participle does, and are nouns of the field.
const NOUNS: &[&str] = &[
    "ChamberReading",
    "Encoding",
    "Finding",
    "LaggedReading",
    "LogEncoding",
    "Mapping",
    "RampRecording",
    "Reading",
    "Recording",
    "TumbleRecording",
    "TurntableReading",
    "isotherm_lagged_reading", // the C interface
];

/// Files in which an old word stands because it is refused, or because an interface keeps it.
const EXCEPT: &[&str] = &[
    "client/c/src/lag.rs",
    "client/c/abi/libisotherm_client.so.0",
    "shared/src/document.rs",
    "calibration/fit/src/provenance/tumble.rs",
    "support/src/finding/name.rs",
    "cli/tests/all/findings.rs",
    "docs/glossary.md",
];

/// The text files of the project, less data, this list, and the page that lists what was renamed.
fn files() -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::from(ROOT)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap().flatten() {
            let (path, name) = (entry.path(), entry.file_name().into_string().unwrap_or_default());
            let is_other = [
                "target",
                "data",
                "corpus",
                "artifacts",
                "CHANGELOG.md",
                "Cargo.lock",
                "words.rs",
                "proptest-regressions",
            ]
            .contains(&&*name);
            if is_other || name.starts_with('.') && name != ".ci" {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else if let Ok(text) = fs::read_to_string(&path) {
                found.push((path.strip_prefix(Path::new(ROOT)).unwrap().display().to_string(), text));
            }
        }
    }
    found
}

#[test]
fn one_word_stands_for_one_thing() {
    let mut found = Vec::new();
    for (name, text) in files().into_iter().filter(|(name, _)| !EXCEPT.contains(&&**name)) {
        for (number, line) in text.lines().enumerate() {
            for (word, right, kept) in WORDS {
                let lower = line.to_lowercase();
                let left = kept.iter().fold(lower, |line, name| line.replace(name, ""));
                if left.contains(word) {
                    found.push(format!("{name}:{}: {word}, which is {right} here: {}", number + 1, line.trim()));
                }
            }
        }
    }
    assert!(found.is_empty(), "{} lines\n{}", found.len(), found.join("\n"));
}

#[test]
fn public_types_are_nouns_and_have_names_of_their_own() {
    let mut types: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (name, text) in files() {
        let is_test = name.split('/').any(|part| ["tests", "bench", "benches", "python", "examples"].contains(&part));
        if !name.ends_with(".rs") || is_test {
            continue;
        }
        for line in text.lines() {
            let declared = ["pub struct ", "pub enum ", "pub trait "].iter().find_map(|start| line.strip_prefix(start));
            if let Some(rest) = declared {
                let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
                types.entry(rest[..end].to_owned()).or_default().push(name.clone());
            }
        }
    }
    assert!(types.len() > 300, "{}", types.len());
    let twice = types.iter().filter(|(_, files)| files.len() > 1);
    let twice: Vec<_> = twice.collect();
    assert!(twice.is_empty(), "{twice:#?}");
    let participles: Vec<_> = types
        .keys()
        .filter(|name| (name.ends_with("ed") || name.ends_with("ing")) && !NOUNS.contains(&&***name))
        .collect();
    assert!(participles.is_empty(), "{participles:?}");
}
