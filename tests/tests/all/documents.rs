//! The documents and the program's help are correct: links, commands, options and the quick start.

use isotherm_tests::{TestDomain, binary, text};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Every document with its text.
fn documents() -> Vec<(PathBuf, String)> {
    let mut paths = vec![];
    for folder in ["", "docs", "tests/fuzz", "python"] {
        let entries = fs::read_dir(Path::new(ROOT).join(folder)).unwrap().map(|entry| entry.unwrap().path());
        paths.extend(entries.filter(|path| path.extension().is_some_and(|extension| extension == "md")));
    }
    assert!(paths.len() > 10);
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), fs::read_to_string(&path).unwrap())).collect()
}

/// The link target of a heading: letters, digits, `-` and `_` are kept, spaces become `-`, everything else is removed.
fn anchor(heading: &str) -> String {
    let heading = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = heading.chars().filter(|letter| letter.is_alphanumeric() || "-_ ".contains(*letter));
    kept.map(|letter| if letter == ' ' { '-' } else { letter }).collect()
}

#[test]
fn links_have_existing_targets() {
    let mut links = 0;
    let mut dead = Vec::new();
    for (path, document) in documents() {
        for target in document.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target) {
            if target.contains("://") {
                continue;
            }
            links += 1;
            let (file, fragment) = target.split_once('#').unwrap_or((target, ""));
            let file = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            let headings = || {
                let text = fs::read_to_string(&file).unwrap_or_default();
                text.lines().filter(|line| line.starts_with('#')).map(anchor).collect::<Vec<_>>()
            };
            if !file.exists() || !fragment.is_empty() && !headings().contains(&fragment.to_owned()) {
                dead.push(format!("{}: {target}", path.display()));
            }
        }
    }
    assert!(links > 40, "{links}");
    assert!(dead.is_empty(), "{}", dead.join("\n"));
}

#[test]
fn lines_of_documents_have_120_columns_at_most() {
    let mut long = Vec::new();
    for (path, document) in documents() {
        // A row of a table is one line.
        let is_long = |line: &str| line.chars().count() > 120 && !line.starts_with('|');
        for (number, line) in document.lines().enumerate().filter(|(_, line)| is_long(line)) {
            long.push(format!("{}:{}: {line}", path.display(), number + 1));
        }
    }
    assert!(long.is_empty(), "{}", long.join("\n"));
}

/// Comments of Rust, TOML, Python and shell; data of tests are as their programs made them.
#[test]
fn comments_have_120_columns_at_most() {
    let mut long = Vec::new();
    let mut count = 0;
    let mut folders = vec![PathBuf::from(ROOT)];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            let name = path.file_name().unwrap().to_string_lossy();
            if path.is_dir() && !name.starts_with('.') && !["target", "data", "corpus"].contains(&&*name) {
                folders.push(path);
            } else if [".rs", ".toml", ".py", ".sh"].iter().any(|extension| name.ends_with(extension)) {
                let text = fs::read_to_string(&path).unwrap();
                let mark = if name.ends_with(".rs") { "//" } else { "#" };
                let comments = text.lines().filter(|line| line.trim_start().starts_with(mark));
                let wide = comments.filter(|line| line.chars().count() > 120);
                long.extend(wide.map(|line| format!("{}: {line}", path.display())));
                count += 1;
            }
        }
    }
    assert!(count > 50, "{count}");
    assert!(long.is_empty(), "{}", long.join("\n"));
}

#[test]
fn the_page_of_findings_is_what_the_program_prints() {
    let printed = TestDomain::new().run_ok(&["explain", "--markdown", "findings"]);
    let page = fs::read_to_string(Path::new(ROOT).join("docs/findings.md")).unwrap();
    assert!(page == printed, "renew it: cargo run -p isotherm-cli -- explain --markdown findings > docs/findings.md");
}

/// What the documents say of the daemon's names holds for `isothermd` too, but for findings, metrics and states of
/// `top`.
#[test]
fn every_name_is_explained_and_an_unknown_one_tells_the_nearest() {
    let domain = TestDomain::new();
    for name in ["position-off", "a2-rate", "isotherm_gaps_total", "held_back_ms", "78", "near range end"] {
        assert!(domain.run_ok(&["explain", name]).contains(name), "{name}");
        let daemon = Command::new(binary("isothermd")).args(["explain", name]).output().unwrap();
        let laboratory = ["position-off", "isotherm_gaps_total", "near range end"].contains(&name);
        assert_eq!(daemon.status.code(), Some(if laboratory { 64 } else { 0 }), "{name}");
    }
    let output = domain.run(&["explain", "positon-off"]);
    assert_eq!(output.status.code(), Some(64));
    assert!(text(&output.stderr).contains("near it are position-off"), "{}", text(&output.stderr));
    let list = domain.run_ok(&["explain"]);
    for line in list.lines().filter(|line| line.starts_with("  ")) {
        assert!(line.chars().count() <= 120 && line.ends_with(['.', '`']), "{line}");
    }
}

/// The command lines in a document: those in code blocks, and those between back quotes in the text.
fn command_lines(document: &str) -> impl Iterator<Item = &str> {
    let blocks = document.lines().map(|line| line.trim().trim_start_matches("$ "));
    let quoted = document.split('`').skip(1).step_by(2);
    blocks.chain(quoted).filter(|line| line.starts_with("isotherm ") && !line.contains('\n'))
}

/// The help of a command; `None` if there is no such command.
fn help(command: &[&str]) -> Option<String> {
    let output = Command::new(binary("isotherm")).args(command).arg("--help").output().unwrap();
    output.status.success().then(|| text(&output.stdout))
}

#[test]
fn commands_and_options_in_the_documents_exist() {
    let mut known = BTreeMap::<Vec<String>, Option<String>>::new();
    let mut wrong = BTreeSet::new();
    let mut count = 0;
    for (path, document) in documents().into_iter().filter(|(path, _)| !path.ends_with("CHANGELOG.md")) {
        for line in command_lines(&document) {
            let line_end = line.find([';', '|', '#', '>', '&', '(', ')']).unwrap_or(line.len());
            let words: Vec<_> = line[..line_end].split_whitespace().skip(1).collect();
            let command: Vec<_> =
                words.iter().take_while(|word| is_name(word)).map(|word| (*word).to_owned()).collect();
            // The first one or two words are the command, the rest are its arguments.
            let help_of = |command: &[String]| help(&command.iter().map(String::as_str).collect::<Vec<_>>());
            let depth = if matches!(command.first().map(String::as_str), Some("simulate" | "campaign" | "calibrate")) {
                2
            } else {
                1
            };
            let command = command[..command.len().min(depth)].to_vec();
            if command.is_empty() && !words.iter().any(|word| word.starts_with("--")) {
                continue;
            }
            count += 1;
            let help = known.entry(command.clone()).or_insert_with(|| help_of(&command));
            let Some(help) = help else {
                wrong.insert(format!("{}: no such command: {line}", path.display()));
                continue;
            };
            let options = words.iter().filter(|word| word.starts_with("--") && word.len() > 2);
            for option in options.map(|word| word.trim_end_matches([',', ']', '`']).split('=').next().unwrap()) {
                if !help.contains(option) {
                    wrong.insert(format!("{}: no option {option}: {line}", path.display()));
                }
            }
        }
    }
    assert!(count > 40, "{count}");
    assert!(wrong.is_empty(), "{}", wrong.into_iter().collect::<Vec<_>>().join("\n"));
}

fn is_name(word: &str) -> bool {
    word.chars().all(|letter| letter.is_ascii_lowercase() || letter == '-') && !word.starts_with('-')
}

/// Runs all blocks of the quick start in one shell.
#[test]
fn the_quick_start_works_as_it_stands() {
    let domain = TestDomain::new();
    for folder in ["tests/data", "examples", "recording/formats/tests/data/autopilots"] {
        let made = Command::new("cp").args(["-r", "--parents", folder]).arg(domain.path("")).current_dir(ROOT).status();
        assert!(made.unwrap().success());
    }
    let document = fs::read_to_string(Path::new(ROOT).join("docs/quickstart.md")).unwrap();
    let blocks = document.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let script = format!(
        "set -eu -o pipefail\ntrap 'kill $(jobs -p) 2> /dev/null || true' EXIT\n{}",
        blocks.collect::<String>()
    );
    let mut shell = Command::new("bash");
    let path = format!("{}:{}", binary("isotherm").parent().unwrap().display(), std::env::var("PATH").unwrap());
    shell.args(["-m", "-c", &script]).env("PATH", path).current_dir(domain.path("")).stdin(Stdio::null());
    shell.env("ISOTHERM_DOMAIN", domain.client_domain().name()).env("ISOTHERM_ROOT", domain.path(""));
    let output = shell.output().unwrap();
    let (printed, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{script}\n--\n{printed}\n--\n{stderr}");
    assert!(printed.contains(" is served, as quickstart/imu-a.toml"), "{printed}");
}

#[test]
fn the_version_names_commit_and_profile() {
    let domain = TestDomain::new();
    let version = domain.run_ok(&["--version"]);
    assert!(version.starts_with(&format!("isotherm {}\n", env!("CARGO_PKG_VERSION"))), "{version}");
    let line = |name: &str| version.lines().find_map(|line| line.strip_prefix(name).map(str::to_owned)).unwrap();
    let repository = Command::new("git").args(["rev-parse", "HEAD"]).current_dir(ROOT).output();
    if repository.is_ok_and(|output| output.status.success()) {
        let commit = line("commit: ");
        let (hash, date) = commit.split_once(' ').unwrap();
        assert!(hash.len() == 12 && u64::from_str_radix(hash, 16).is_ok() && date.len() == 12, "{version}");
    }
    let (profile, target) = line("built: ").split_once(", ").map(|(a, b)| (a.to_owned(), b.to_owned())).unwrap();
    assert!(["debug", "release", "dist"].contains(&profile.as_str()), "{version}");
    assert!(target.contains("linux"), "{version}");
}

/// The commands of a program, from its help.
fn commands_of(help: &str) -> Vec<String> {
    let list = help.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap().lines();
    // Lines with more than two leading spaces continue a description.
    let commands = list.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = commands.map(|line| line.split_whitespace().next().unwrap().to_owned());
    names.filter(|name| name != "help").collect()
}

#[test]
fn manual_pages_completions_and_examples_are_there_for_every_command() {
    let domain = TestDomain::new();
    let commands = commands_of(&help(&[]).unwrap());
    assert!(commands.len() > 10, "{commands:?}");
    domain.run_ok(&["man", "-o", "man"]);
    let page = |name: &str| fs::read_to_string(domain.path(&format!("man/{name}"))).unwrap();
    let completions = domain.run_ok(&["completions", "bash"]);
    for command in &commands {
        assert!(help(&[command]).unwrap().contains("Examples:"), "isotherm {command} --help has no examples");
        let page = page(&format!("isotherm-{command}.1"));
        assert!(page.contains(".SH DESCRIPTION") && page.contains("Examples:"), "{page}");
        assert!(completions.contains(command.as_str()), "{command}");
    }
    let daemon = Command::new(binary("isothermd")).arg("--help").output().unwrap();
    let of_the_daemon = commands_of(&text(&daemon.stdout));
    assert!(of_the_daemon.len() > 4, "{of_the_daemon:?}");
    assert!(page("isothermd.1").contains("isothermd"));
    assert!(page("isotherm-exporter.1").contains("--listen") || page("isotherm-exporter.1").contains("\\-\\-listen"));
    for command in of_the_daemon {
        let page = page(&format!("isothermd-{command}.1"));
        assert!(page.contains("Examples:") && page.contains("isothermd"), "{page}");
    }
    // What the page of the configuration shows is the example, but for the escapes.
    let shown = page("isotherm-service.5").replace("\\-", "-").replace("\\&", "").replace("\\e", "\\");
    let example = fs::read_to_string(Path::new(ROOT).join("examples/service.toml")).unwrap();
    assert!(shown.contains(&example), "{shown}");
    let script = domain.write("completions", &completions);
    let mut shell = Command::new("bash");
    shell.arg("-c").arg(format!(
        "source {} && COMP_WORDS=(isotherm stat) COMP_CWORD=1 && _isotherm isotherm stat isotherm && echo \"${{COMPREPLY[*]}}\"",
        script.display()
    ));
    let output = shell.output().unwrap();
    assert_eq!(text(&output.stdout), "status\n", "{}", text(&output.stderr));
}

/// The first lines of the help of a command, of its options and of the commands below it.
fn first_lines(command: &clap::Command) -> Vec<(String, String)> {
    let name = command.get_name();
    let mut found: Vec<_> = command.get_about().map(|about| (name.to_owned(), about.to_string())).into_iter().collect();
    let helped = command.get_arguments().filter_map(|argument| argument.get_help().map(|help| (argument, help)));
    found.extend(helped.map(|(argument, help)| (format!("{name} {}", argument.get_id()), help.to_string())));
    found.extend(command.get_subcommands().flat_map(first_lines).map(|(path, line)| (format!("{name} {path}"), line)));
    found
}

#[test]
fn the_first_line_of_a_help_has_eight_words_at_most() {
    let lines =
        [isotherm_cli::command(), isotherm_service::command("")].iter().flat_map(first_lines).collect::<Vec<_>>();
    assert!(lines.len() > 200, "{}", lines.len());
    let is_wrong = |line: &str| line.split_whitespace().count() > 8 || line.contains('\n') || line.ends_with('.');
    let wrong: Vec<_> = lines.iter().filter(|(_, line)| is_wrong(line)).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
