//! Which rooms of the house meet the operating system. Below `calibration/pipeline` no crate opens a file, starts a
//! thread, asks a clock or prints: who calls gives it bytes, times and a place to write.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// The crates, and their folders, in the order in which they use each other.
const QUIET: [(&str, &str); 12] = [
    ("isotherm-support", "support"),
    ("isotherm-shared", "shared"),
    ("isotherm-recording", "recording"),
    ("isotherm-autopilot", "recording/autopilot"),
    ("isotherm-recording-formats", "recording/formats"),
    ("isotherm-statistics", "calibration/statistics"),
    ("isotherm-campaign", "calibration/campaign"),
    ("isotherm-fit", "calibration/fit"),
    ("isotherm-verification", "calibration/verification"),
    ("isotherm-analysis", "calibration/analysis"),
    ("isotherm-report", "calibration/report"),
    ("isotherm-simulation", "laboratory/simulation"),
];
/// What their code may not have outside of tests.
const WORDS: [&str; 29] = [
    "fs::",
    "File::open",
    "File::create",
    "OpenOptions",
    ".is_dir()",
    ".exists()",
    ".canonicalize()",
    ".read_dir()",
    ".symlink_metadata()",
    "thread::",
    "Instant",
    "SystemTime",
    "println!",
    "eprintln!",
    "print!",
    "dbg!",
    "stdin()",
    "stdout()",
    "stderr()",
    "tell(",
    "env::var",
    "env::args",
    "std::process",
    "std::net",
    "std::os::",
    "rustix",
    "tempfile",
    "indicatif",
    "isotherm_files",
];
/// What they may have all the same, and why.
const ALLOWED: [(&str, &str, &str); 5] = [
    ("support/src/failure/printable.rs", "tell(", "the one line of a program on stderr, which no crate of these calls"),
    ("support/src/failure/printable.rs", "stderr()", "the same"),
    ("support/src/checkpoint.rs", "thread::", "whether the work unwinds, and whose watch it is"),
    ("support/src/failure.rs", ".is_dir()", "a message about a file says whether its folder is missing"),
    (
        "calibration/fit/src/provenance/source.rs",
        "SystemTime",
        "when a table was made, where its caller does not say it",
    ),
];
/// The transport, which no crate up to `calibration/pipeline` links.
const TRANSPORT: [&str; 4] = ["iceoryx2", "iceoryx2-cal", "iceoryx2-bb-posix", "iceoryx2-pal-posix"];
/// Crates of files and terminals, which these do not use by themselves.
const OF_SYSTEM: [&str; 6] = ["indicatif", "isotherm-files", "notify", "rustix", "signal-hook", "tempfile"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The code of a file without comments and tests, line by line, and the modules that are tests.
fn code_of(text: &str) -> (Vec<(usize, &str)>, Vec<&str>) {
    let (mut code, mut tests) = (Vec::new(), Vec::new());
    let mut lines = text.lines().zip(1..);
    while let Some((line, number)) = lines.next() {
        let begin = line.trim_start();
        if !begin.starts_with("#[cfg(test)]") {
            if !begin.starts_with("//") {
                code.push((number, line));
            }
            continue;
        }
        let Some((item, _)) = lines.find(|(line, _)| !line.trim_start().starts_with("#[")) else { break };
        if let Some((_, name)) = item.trim_end_matches(';').split_once("mod ").filter(|_| item.ends_with(';')) {
            tests.push(name);
        } else if !item.ends_with([';', '}', ',']) {
            // Up to the brace under the begin of the item.
            let end = format!("{}}}", &line[..line.len() - begin.len()]);
            lines.find(|(line, _)| *line == end);
        }
    }
    (code, tests)
}

/// Whether a line has this, and not as the end of a longer name.
fn has_word(line: &str, word: &str) -> bool {
    let is_begun = |at: usize| {
        let before = line[..at].chars().next_back();
        word.starts_with('.') || before.is_none_or(|letter| !letter.is_alphanumeric() && letter != '_')
    };
    line.match_indices(word).any(|(at, _)| is_begun(at))
}

/// The files of a module and of those in it, without tests.
fn files_of(file: &Path, folder: &Path, found: &mut Vec<PathBuf>) {
    let text = fs::read_to_string(file).unwrap();
    let (code, _) = code_of(&text);
    found.push(file.to_owned());
    for (_, line) in code {
        let line = line.trim_start();
        let Some((before, name)) = line.strip_suffix(';').and_then(|line| line.split_once("mod ")) else { continue };
        let file = folder.join(name).with_extension("rs");
        if (before.is_empty() || before.starts_with("pub")) && file.exists() {
            files_of(&file, &folder.join(name), found);
        }
    }
}

#[test]
fn below_the_pipeline_no_crate_meets_the_operating_system() {
    let (root, mut found) = (root(), Vec::new());
    for (_, folder) in QUIET {
        let source = root.join(folder).join("src");
        let mut files = Vec::new();
        files_of(&source.join("lib.rs"), &source, &mut files);
        for file in files {
            let name = file.strip_prefix(&root).unwrap().to_str().unwrap();
            let text = fs::read_to_string(&file).unwrap();
            for (number, line) in code_of(&text).0 {
                let is_allowed = |word: &str| ALLOWED.iter().any(|(of, allowed, _)| *of == name && *allowed == word);
                let words = WORDS.iter().filter(|word| has_word(line, word) && !is_allowed(word));
                found.extend(words.map(|word| format!("{name}:{number}: {word}: {}", line.trim())));
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn what_is_looked_at_is_code_without_tests() {
    let text = "//! fs::read\nuse a;\n#[cfg(test)]\nmod tests;\n#[cfg(test)]\n#[path = \"x.rs\"]\nmod y {\n    fs::x\n}\nfn b() {\n    \
                #[cfg(test)]\n    fn c() {\n        d\n    }\n    e\n}\n";
    let (code, tests) = code_of(text);
    assert_eq!(code.iter().map(|(_, line)| line.trim()).collect::<Vec<_>>(), ["use a;", "fn b() {", "e", "}"]);
    assert_eq!(tests, ["tests"]);
}

#[test]
fn no_crate_up_to_the_pipeline_links_the_transport() {
    let mut metadata = Command::new(env::var_os("CARGO").unwrap());
    // What is only for other platforms is not there after a build.
    let version = Command::new("rustc").arg("-vV").output().unwrap();
    let version = String::from_utf8(version.stdout).unwrap();
    let host = version.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
    metadata.args(["metadata", "--offline", "--locked", "--format-version", "1", "--filter-platform", host]);
    metadata.current_dir(root());
    let output = metadata.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let list = |value: &serde_json::Value| value.as_array().unwrap().clone();
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    let names: BTreeMap<_, _> = list(&all["packages"]).iter().map(|of| (text(&of["id"]), text(&of["name"]))).collect();
    let mut used: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for node in list(&all["resolve"]["nodes"]) {
        let normal = |of: &serde_json::Value| list(&of["dep_kinds"]).iter().any(|kind| kind["kind"].is_null());
        let normal = list(&node["deps"]).into_iter().filter(normal).map(|of| names[&text(&of["pkg"])].clone());
        used.entry(names[&text(&node["id"])].clone()).or_default().extend(normal);
    }
    for name in QUIET.map(|(name, _)| name).into_iter().chain(["isotherm-files", "isotherm-pipeline"]) {
        let (mut linked, mut waiting) = (BTreeSet::new(), vec![name.to_owned()]);
        while let Some(of) = waiting.pop() {
            waiting.extend(used[&of].iter().filter(|next| linked.insert((*next).clone())).cloned());
        }
        assert!(linked.len() > 3, "{name}");
        let found: Vec<_> = TRANSPORT.iter().filter(|of| linked.contains(**of)).collect();
        assert!(found.is_empty(), "{name} links {found:?}");
    }
    for (name, _) in QUIET {
        let found: Vec<_> = OF_SYSTEM.iter().filter(|of| used[name].contains(**of)).collect();
        assert!(found.is_empty(), "{name} uses {found:?}");
    }
}
