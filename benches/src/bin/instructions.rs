//! Counts the instructions of a sample: of the kernel and of publishing in `isothermd`, and of loan, send and receive in the C library.
//!
//!     cargo build --release && cargo run -p isotherm-benches --bin instructions -- target/release
//!
//! A count does not depend on what else the machine does, so it can guard what a time cannot: it is the same again with the same build, and
//! a build that leaves small functions as calls shows at once. `--check` fails if a count is over its bound. With the folders of two
//! builds it also fails if one needs over 5 % more than the other. With `--python PYTHON`, an interpreter that has the package
//! `isotherm`, send and receive of its module are counted too.
//!
//! `isothermd` and the acquisition, `instructions.c`, which is compiled here with `cc`, run under valgrind's tool `callgrind`. Each function is
//! counted with all that it calls. valgrind cannot read the processor's counter fast enough for the clock's extrapolation, so each reading of
//! the clock is one of the kernel's, in every build.
#![allow(clippy::print_stdout, reason = "the table is the product")]

use clap::Parser;
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, IMU, TABLE};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Duration;

const FOLDER: &str = env!("CARGO_MANIFEST_DIR");
/// Samples that are counted.
const SAMPLES: u64 = 50;
/// A build may need this much more than another.
const MAX_RATIO: f64 = 1.05;
/// Longest time of a program under valgrind.
const TIMEOUT: Duration = Duration::from_secs(120);

/// What is counted: its name, the program, the function's name or its beginning, and the bound, 20 % above what was reached.
const COUNTS: [(&str, Program, &str, f64); 5] = [
    ("isothermd: kernel", Program::Daemon, "isotherm_shared::compensate::answer_into", 600.0),
    ("isothermd: publish", Program::Daemon, "isotherm_client::rehearsal::publish", 1000.0),
    ("C library: loan", Program::Acquisition, "isotherm_loan", 100.0),
    ("C library: send", Program::Acquisition, "isotherm_send", 2000.0),
    ("C library: receive", Program::Acquisition, "isotherm_receive", 1000.0),
];

/// Counts the instructions of a sample
#[derive(Debug, Parser)]
struct InstructionsArguments {
    /// Folders with isothermd and the C library, as target/release; this program's if none is given
    folders: Vec<PathBuf>,
    /// Fail if a count is over its bound
    #[arg(long)]
    check: bool,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Program {
    Daemon,
    Acquisition,
}

fn main() -> ExitCode {
    match bench(&InstructionsArguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("instructions: {error}");
            ExitCode::FAILURE
        }
    }
}

fn bench(arguments: &InstructionsArguments) -> BenchResult<()> {
    let mut folders = arguments.folders.clone();
    if folders.is_empty() {
        folders.push(std::env::current_exe()?.parent().ok_or("this program is in no folder")?.to_owned());
    }
    let counts = folders.iter().map(|folder| count(folder)).collect::<BenchResult<Vec<_>>>()?;
    let of = |row: usize| counts.iter().map(move |counts| counts[row]);
    let ratio = |row: usize| of(row).fold(0.0, f64::max) / of(row).fold(f64::INFINITY, f64::min);
    if arguments.json {
        let rows = COUNTS.iter().enumerate().map(
            |(row, (name, _, _, bound))| json!({"name": name, "counts": of(row).collect::<Vec<_>>(), "bound": bound}),
        );
        println!("{:#}", json!({"folders": folders, "samples": SAMPLES, "instructions": rows.collect::<Vec<_>>()}));
    } else {
        println!("{:<24}{:>10}  {}", "instructions a sample", "bound", names(&folders));
        for (row, (name, _, _, bound)) in COUNTS.iter().enumerate() {
            let figures: String = of(row).map(|count| format!("{count:>10.1}")).collect();
            println!("{name:<24}{bound:>10}{figures}");
        }
    }
    let over = COUNTS.iter().enumerate().find(|(row, (.., bound))| of(*row).any(|count| count > *bound));
    if let Some((row, (name, _, _, bound))) = over.filter(|_| arguments.check) {
        let counts: Vec<_> = of(row).collect();
        return Err(format!("{name}: {counts:.1?} instructions, over the bound of {bound}").into());
    }
    let apart = (0..COUNTS.len()).find(|row| ratio(*row) > MAX_RATIO);
    if let Some(row) = apart.filter(|_| arguments.check) {
        return Err(format!("{}: the builds differ by a factor of {:.3}", COUNTS[row].0, ratio(row)).into());
    }
    Ok(())
}

fn names(folders: &[PathBuf]) -> String {
    folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join("  ")
}

/// Instructions of each of [`COUNTS`] in the programs of a folder.
fn count(folder: &Path) -> BenchResult<Vec<f64>> {
    let folder = fs::canonicalize(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let domain = BenchDomain::new()?;
    let acquisition = compiled(&domain, &folder)?;
    fs::write(domain.path("table.toml"), TABLE)?;
    // A worker that blocks has no rehearsals, whose number would depend on the time.
    let config = format!("[[imu]]\nid = \"{IMU}\"\ntable = \"table.toml\"\n[wait]\nstrategy = \"block\"\n");
    fs::write(domain.path("service.toml"), config)?;
    let daemon = folder.join("isothermd");
    let mut daemon = run(&domain, "daemon", &[&daemon.display().to_string(), "serve", "--config", "service.toml"])?;
    let samples = SAMPLES.to_string();
    let words = [&*acquisition.display().to_string(), IMU, &samples];
    if !run(&domain, "acquisition", &words)?.succeeds_within(TIMEOUT)? {
        return Err(format!("the acquisition failed:\n{}", domain.log()).into());
    }
    daemon.terminate();
    if !daemon.succeeds_within(TIMEOUT)? {
        return Err(format!("isothermd failed:\n{}", domain.log()).into());
    }
    let [of_daemon, of_acquisition] =
        ["daemon", "acquisition"].map(|name| fs::read_to_string(domain.path(&format!("{name}.callgrind"))));
    let (of_daemon, of_acquisition) = (of_daemon?, of_acquisition?);
    let counts = COUNTS.iter().map(|(name, program, function, _)| {
        let profile = if *program == Program::Daemon { &of_daemon } else { &of_acquisition };
        match calls(profile, function) {
            (calls, instructions) if calls >= SAMPLES => Ok(instructions as f64 / calls as f64),
            (calls, _) => Err(format!("{name}: {calls} calls of {function} in {SAMPLES} samples").into()),
        }
    });
    counts.collect()
}

/// Runs a program under valgrind.
fn run(domain: &BenchDomain, name: &str, words: &[&str]) -> BenchResult<BenchProcess> {
    let output = format!("--callgrind-out-file={name}.callgrind");
    let mut all = vec!["--tool=callgrind", "--compress-strings=no", "--compress-pos=no", &output];
    all.extend(words);
    domain.spawn_program(Path::new("valgrind"), &all).map_err(|error| format!("valgrind: {error}").into())
}

/// Calls of a function in callgrind's profile, and the instructions of them all, with those of what it calls.
fn calls(profile: &str, function: &str) -> (u64, u64) {
    let (mut called, mut sum, mut lines) = ("", (0, 0), profile.lines());
    while let Some(line) = lines.next() {
        if let Some(name) = line.strip_prefix("cfn=") {
            called = name;
        } else if let Some(line) = line.strip_prefix("calls=")
            && let Some(cost) = lines.next()
            && (called == function || called.strip_prefix(function).is_some_and(|rest| rest.starts_with("::h")))
        {
            let number = |text: Option<&str>| text.and_then(|text| text.parse::<u64>().ok()).unwrap_or_default();
            sum.0 += number(line.split(' ').next());
            sum.1 += number(cost.split(' ').nth(1));
        }
    }
    sum
}

/// Compiles the acquisition against the library of a folder. Returns the path of its program.
fn compiled(domain: &BenchDomain, libraries: &Path) -> BenchResult<PathBuf> {
    let (program, libraries) = (domain.path("acquisition"), libraries.display());
    let mut compiler = Command::new("cc");
    compiler.args(["-std=c11", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
    compiler.arg(format!("-I{FOLDER}/../client/include")).arg(format!("{FOLDER}/src/instructions.c"));
    compiler.arg(format!("-L{libraries}")).arg(format!("-Wl,-rpath,{libraries}")).arg("-lisotherm_client");
    let status = compiler.arg("-o").arg(&program).status()?;
    if status.success() { Ok(program) } else { Err("cc cannot compile instructions.c".into()) }
}
