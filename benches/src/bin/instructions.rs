//! Counts the instructions of a sample: of the kernel and of publishing in `isothermd`, and of loan, send and receive
//! in the C library.
//!
//!     cargo build --release && cargo run -p isotherm-benches --bin instructions -- target/release
//!
//! A count does not depend on what else the machine does, so it can guard what a time cannot: the same build has the
//! same count, and a build that leaves small functions as calls shows at once. `--check` fails if a count is over its
//! bound. With the folders of two builds it also fails if one needs over 5 % more than the other. `--python PYTHON`, an
//! interpreter that has the package `isotherm`, counts send and receive of its module too.
//!
//! `isothermd` and the acquisition, `instructions.c`, which is compiled here with `cc`, run under valgrind's tool
//! `callgrind`. Each function is counted with all that it calls, and the count of a run is taken from that of a longer
//! one: what happens only once does not count. Under valgrind, which is slow, each reading of the clock is one of the
//! kernel's clock, in every build.

use clap::Parser;
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, Common, IMU, no_role, own_folder, run};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

const FOLDER: &str = env!("CARGO_MANIFEST_DIR");
/// Samples of the shorter and of the longer run.
const SAMPLES: [u64; 2] = [10, 60];
/// A build may need this much more than another.
const MAX_RATIO: f64 = 1.05;
/// Longest time of a program under valgrind.
const TIMEOUT: Duration = Duration::from_secs(120);

/// What is counted: a name, the program, a part of the function's name, and the bound, 20 % above what was reached.
struct Count(&'static str, Program, &'static str, f64);

const COUNTS: [Count; 5] = [
    Count("isothermd: kernel", Program::Daemon, "isotherm_shared::compensate::answer_with", 400.0),
    Count("isothermd: publish", Program::Daemon, "isotherm_client::transport::ports::Payload>::publish", 1600.0),
    Count("C library: loan", Program::Acquisition, "isotherm_loan", 110.0),
    Count("C library: send", Program::Acquisition, "isotherm_send", 2110.0),
    Count("C library: receive", Program::Acquisition, "isotherm_receive", 770.0),
];
const PYTHON: [Count; 3] = [
    Count("Python module: loan", Program::Python, "Acquisition::__pymethod_loan__", 610.0),
    Count("Python module: send", Program::Python, "Acquisition::__pymethod_send__", 2780.0),
    Count("Python module: receive", Program::Python, "Acquisition::__pymethod_receive__", 1570.0),
];

/// Counts the instructions of a sample
#[derive(Debug, Parser)]
struct InstructionsArguments {
    /// Folders with isothermd and the C library, as target/release; this program's if none is given
    folders: Vec<PathBuf>,
    /// An interpreter that has the package `isotherm`
    #[arg(long)]
    python: Option<PathBuf>,
    /// Fail if a count is over its bound
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    common: Common,
}

#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Program {
    Daemon,
    Acquisition,
    Python,
}

fn main() -> ExitCode {
    run(no_role, bench)
}

fn bench(arguments: InstructionsArguments) -> BenchResult<()> {
    let InstructionsArguments { mut folders, python, check, common } = arguments;
    if folders.is_empty() {
        folders.push(own_folder()?);
    }
    let of_python: &[Count] = if python.is_some() { &PYTHON } else { &[] };
    let mut profiles = Vec::new();
    for folder in &folders {
        let [shorter, longer] = SAMPLES.map(|samples| profile(folder, samples, python.as_deref()));
        profiles.push((shorter?, longer?));
    }
    let mut rows = Vec::new();
    for count in COUNTS.iter().chain(of_python) {
        let counts = profiles.iter().map(|(shorter, longer)| count.of(shorter, longer));
        rows.push((count, counts.collect::<BenchResult<Vec<_>>>()?));
    }
    let document =
        |(Count(name, .., bound), counts): &(&Count, Vec<f64>)| json!({"name": name, "counts": counts, "bound": bound});
    common.show(json!({"folders": folders, "instructions": rows.iter().map(document).collect::<Vec<_>>()}));
    if check { rows.iter().try_for_each(|(count, counts)| count.check(counts)) } else { Ok(()) }
}

/// The profiles of the programs of a run.
struct Profiles {
    samples: u64,
    of: [String; 3],
}

impl Count {
    /// Fails if the count of a build is over the bound, or if the builds differ too much.
    fn check(&self, counts: &[f64]) -> BenchResult<()> {
        let Self(name, .., bound) = self;
        let most = counts.iter().copied().fold(0.0, f64::max);
        let least = counts.iter().copied().fold(f64::INFINITY, f64::min);
        if most > *bound {
            return Err(format!("{name}: {most:.1} instructions, over the bound of {bound}").into());
        }
        if most > least * MAX_RATIO {
            return Err(format!("{name}: {most:.1} instructions in one build, {least:.1} in the other").into());
        }
        Ok(())
    }

    /// Instructions of a call.
    fn of(&self, shorter: &Profiles, longer: &Profiles) -> BenchResult<f64> {
        let Self(name, program, function, _) = self;
        let profile = |profiles: &Profiles| calls(&profiles.of[*program as usize], function);
        let ((few, little), (many, much)) = (profile(shorter), profile(longer));
        let (more, samples) = (many.saturating_sub(few), longer.samples - shorter.samples);
        if more < samples {
            return Err(format!("{name}: {more} calls of {function} in {samples} samples").into());
        }
        Ok(much.saturating_sub(little) as f64 / more as f64)
    }
}

/// Counts the programs of a folder.
fn profile(folder: &Path, samples: u64, python: Option<&Path>) -> BenchResult<Profiles> {
    let folder = fs::canonicalize(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let domain = BenchDomain::new()?;
    let acquisition = domain.compiled("instructions.c", &folder)?;
    // A worker that blocks has no rehearsals, whose number would depend on the time.
    domain.configure("[wait]\nstrategy = \"block\"\n")?;
    let count = samples.to_string();
    let mut daemon = start(&domain, "daemon", &folder.join("isothermd"), &["serve", "--config", "service.toml"])?;
    ends(&mut start(&domain, "acquisition", &acquisition, &[IMU, &count])?, &domain)?;
    if let Some(python) = python {
        let script = format!("{FOLDER}/src/instructions.py");
        ends(&mut start(&domain, "python", &std::path::absolute(python)?, &[&script, IMU, &count])?, &domain)?;
    }
    daemon.terminate();
    ends(&mut daemon, &domain)?;
    let read = |name: &str| fs::read_to_string(domain.path(&format!("{name}.callgrind"))).unwrap_or_default();
    Ok(Profiles { samples, of: ["daemon", "acquisition", "python"].map(read) })
}

/// Waits until a process has ended.
fn ends(process: &mut BenchProcess, domain: &BenchDomain) -> BenchResult<()> {
    match process.succeeds_within(TIMEOUT) {
        Ok(true) => Ok(()),
        _ => Err(domain.failure("a program failed or did not end; the log")),
    }
}

/// Starts a program under valgrind.
fn start(domain: &BenchDomain, name: &str, program: &Path, words: &[&str]) -> BenchResult<BenchProcess> {
    let (output, program) = (format!("--callgrind-out-file={name}.callgrind"), program.display().to_string());
    let mut all = vec![
        "--quiet",
        "--vgdb=no",
        "--tool=callgrind",
        "--compress-strings=no",
        "--compress-pos=no",
        &output,
        &program,
    ];
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
            && is(called, function)
        {
            let number = |text: Option<&str>| text.and_then(|text| text.parse::<u64>().ok()).unwrap_or_default();
            sum.0 += number(line.split(' ').next());
            sum.1 += number(cost.split(' ').nth(1));
        }
    }
    sum
}

/// Whether a name of a profile is that of this function. A name from Rust may end in a hash, and that of a method
/// begins with its type, and with `as` where a trait has it.
fn is(name: &str, function: &str) -> bool {
    let end = name.rfind(function).map(|at| {
        (
            ["::", " as ", ""].iter().any(|before| name[..at].ends_with(before) && (!before.is_empty() || at == 0)),
            &name[at + function.len()..],
        )
    });
    end.is_some_and(|(begins, rest)| begins && (rest.is_empty() || rest.starts_with("::h")))
}
