//! The round trip of an acquisition in Rust, in C and in Python, side by side in one run against one service.
//!
//!     cargo build --profile dist && cargo run --profile dist -p isotherm-benches --bin languages
//!
//! `--python PYTHON` is an interpreter that has the package `isotherm`; without it that language is left out. `--smoke`
//! is short.
//!
//! Each acquisition is a process of its own: this very program, `round_trip.c` compiled here with `cc -O2` against the
//! shared library beside this program, and `round_trip.py`. A second one in Rust shows the random differences between
//! processes. They are measured in alternating blocks of some milliseconds. After some blocks all of them and the
//! service are started again, with other IMUs: this is a round.
//!
//! The protocol of all acquisitions: `PROGRAM --imu ID --domain NAME` connects and prints a line, `ready`. For each
//! line `go N` it makes N round trips, timed from before the loan to after the answer, and writes their durations: N
//! native-endian `u64` \[ns\]. It ends at the end of its input.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

use clap::Parser;
use isotherm_benches::{
    BenchDomain, BenchResult, Common, Series, Spin, imu, own_folder, pin_apart, run, sample, served_by,
};
use isotherm_client::{Acquisition, Options, RawSample, domain};
use serde_json::{Map, json};
use std::hint::black_box;
use std::io::{BufRead as _, BufReader, Read as _, Write as _, stdin, stdout};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, ExitCode, Stdio};
use std::time::{Duration, Instant};

const FOLDER: &str = env!("CARGO_MANIFEST_DIR");
/// Round trips of a block.
const BLOCK: usize = 5_000;
/// Uncounted round trips before each block, while caches and the service's core warm up.
const WARM_UP: usize = 300;

/// Measures the round trip of acquisitions in Rust, C and Python beside each other
#[derive(Debug, Parser)]
struct LanguagesArguments {
    /// An interpreter that has the package `isotherm`
    #[arg(long)]
    python: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

fn main() -> ExitCode {
    run(acquisition, bench)
}

/// The acquisition in Rust.
fn acquisition(words: &[&str]) -> BenchResult<ExitCode> {
    let ["--imu", imu, "--domain", name] = words else { return Err("unknown words".into()) };
    let options = Options::new(domain(Some(name))?, Duration::from_secs(5));
    let mut acquisition = Acquisition::connect(&imu.parse()?, &options)?;
    println!("ready");
    for line in stdin().lines() {
        let line = line?;
        let count = line.strip_prefix("go ").ok_or("go N")?.parse()?;
        let mut times = Vec::with_capacity(count);
        for _ in 0..count {
            times.push(round_trip(&mut acquisition)?);
        }
        let bytes: Vec<u8> = times.into_iter().flat_map(u64::to_ne_bytes).collect();
        stdout().write_all(&bytes)?;
        stdout().flush()?;
    }
    Ok(ExitCode::SUCCESS)
}

fn round_trip(acquisition: &mut Acquisition) -> BenchResult<u64> {
    let sent = Instant::now();
    let mut loan = acquisition.loan()?;
    *loan = RawSample { session: loan.session, sequence: loan.sequence, ..sample() };
    acquisition.send(loan)?;
    let mut spin = Spin::default();
    while black_box(acquisition.receive()?).is_none() {
        spin.turn()?;
    }
    Ok(sent.elapsed().as_nanos() as u64)
}

/// How an acquisition is started.
struct Language {
    name: &'static str,
    program: PathBuf,
    script: Option<PathBuf>,
}

fn bench(LanguagesArguments { python, common }: LanguagesArguments) -> BenchResult<()> {
    let (rounds, blocks, count) = (common.rounds(2, 20), common.of(2, 5), if common.smoke { 300 } else { BLOCK });
    let folder = BenchDomain::new()?;
    let languages = languages(&folder, python.as_deref())?;
    // The acquisitions inherit this core; the service is pinned to another one.
    let settings = served_by("spin", pin_apart());
    let mut series = Series::default();
    for round in 0..rounds {
        let domain = BenchDomain::new()?;
        let _service = domain.serve_many(languages.len(), 1, &settings)?;
        let start = |(index, language)| Running::start(language, &domain, &imu((index + round) % languages.len()));
        let mut running = languages.iter().enumerate().map(start).collect::<BenchResult<Vec<_>>>()?;
        series.begin_round(languages.iter().map(|language| language.name.to_owned()));
        for turn in (0..blocks).flat_map(|block| (block..).take(languages.len())) {
            let index = (round + turn) % languages.len();
            running[index].go(WARM_UP)?;
            series.path(index).add(&running[index].go(count)?, false);
        }
        running.into_iter().try_for_each(Running::end)?;
    }
    series.sort();
    let couples: Vec<_> = languages[1..].iter().map(|language| format!("{}/rust", language.name)).collect();
    let paths: Map<_, _> = series.paths().map(|(name, times)| (name.clone(), times.figures().into())).collect();
    common.show(json!({"rounds": rounds, "paths": paths, "ratios": series.ratios(&couples)}));
    Ok(())
}

/// All languages; the C program is compiled into the folder.
fn languages(folder: &BenchDomain, python: Option<&Path>) -> BenchResult<Vec<Language>> {
    let own = std::env::current_exe()?;
    let language = |name, program| Language { name, program, script: None };
    let mut languages = vec![
        language("rust", own.clone()),
        language("rust_again", own),
        language("c", folder.compiled("round_trip.c", &own_folder()?)?),
    ];
    if let Some(python) = python {
        let script = Some(Path::new(FOLDER).join("src/round_trip.py"));
        languages.push(Language { name: "python", program: std::path::absolute(python)?, script });
    }
    Ok(languages)
}

/// The process of an acquisition. It waits for the next `go N`.
struct Running {
    name: &'static str,
    process: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Running {
    fn start(language: &Language, domain: &BenchDomain, imu: &str) -> BenchResult<Self> {
        let mut command = domain.command(&language.program);
        command.args(&language.script).args(["--imu", imu, "--domain", domain.as_domain().name()]);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = command.spawn().map_err(|error| format!("{}: {error}", language.program.display()))?;
        let input = process.stdin.take();
        let output = BufReader::new(process.stdout.take().ok_or("no output")?);
        let mut running = Self { name: language.name, process, input, output };
        let mut line = String::new();
        running.output.read_line(&mut line)?;
        if line == "ready\n" { Ok(running) } else { Err(format!("{} does not start", language.name).into()) }
    }

    /// Makes `count` round trips. Returns their durations \[ns\].
    fn go(&mut self, count: usize) -> BenchResult<Vec<u32>> {
        writeln!(self.input.as_ref().ok_or("no input")?, "go {count}")?;
        let mut bytes = vec![0; count * size_of::<u64>()];
        self.output.read_exact(&mut bytes).map_err(|_| format!("{} has stopped", self.name))?;
        let times = bytes.as_chunks::<8>().0.iter().map(|time| u64::from_ne_bytes(*time));
        Ok(times.map(|time| u32::try_from(time).unwrap_or(u32::MAX)).collect())
    }

    fn end(mut self) -> BenchResult<()> {
        self.input = None;
        let status = self.process.wait()?;
        if status.success() { Ok(()) } else { Err(format!("{} has failed: {status}", self.name).into()) }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Fails if the process has already ended, which is the usual case.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
