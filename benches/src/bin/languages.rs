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
use isotherm_benches::statistics::{figures, ratios};
use isotherm_benches::{BenchDomain, BenchResult, Spin, become_child, cores, imu, pin, sample};
use isotherm_client::{Acquisition, Options, RawSample, domain};
use serde_json::Value;
use std::hint::black_box;
use std::io::{BufRead as _, BufReader, Read as _, Write as _, stdin, stdout};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitCode, Stdio};
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
    /// A few samples only, to see that everything works
    #[arg(long)]
    smoke: bool,
}

fn main() -> ExitCode {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        ["serve", ..] => {
            become_child();
            return isotherm_service::main(env!("CARGO_PKG_VERSION"));
        }
        ["--imu", imu, "--domain", name] => acquisition(imu, name),
        _ => bench(&LanguagesArguments::parse()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("languages: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The acquisition in Rust.
fn acquisition(imu: &str, name: &str) -> BenchResult<()> {
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
    Ok(())
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

fn bench(arguments: &LanguagesArguments) -> BenchResult<()> {
    let (rounds, blocks, count) = if arguments.smoke { (2, 2, 300) } else { (20, 5, BLOCK) };
    let folder = BenchDomain::new()?;
    let own = std::env::current_exe()?;
    let language = |name, program| Language { name, program, script: None };
    let mut languages = vec![
        language("rust", own.clone()),
        language("rust_again", own.clone()),
        language("c", folder.compiled("round_trip.c", own.parent().ok_or("this program is in no folder")?)?),
    ];
    if let Some(python) = &arguments.python {
        let script = Some(Path::new(FOLDER).join("src/round_trip.py"));
        languages.push(Language { name: "python", program: python.clone(), script });
    }
    let cores = cores();
    let service_core = cores.get(1).map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();

    // The acquisitions inherit this core; the service is pinned to another one.
    pin(cores.first().copied().filter(|_| cores.len() > 1));
    // Round trips by language and round \[ns\].
    let mut series = vec![Vec::new(); languages.len()];
    for round in 0..rounds {
        let domain = BenchDomain::new()?;
        let _service =
            domain.serve_many(languages.len(), 1, &format!("[wait]\nstrategy = \"spin\"\n{service_core}"))?;
        let mut running = Vec::new();
        for (index, language) in languages.iter().enumerate() {
            running.push(Running::start(language, &domain, &imu((index + round) % languages.len()))?);
        }
        series.iter_mut().for_each(|series| series.push(Vec::new()));
        for block in 0..blocks {
            for turn in 0..languages.len() {
                let index = (round + block + turn) % languages.len();
                running[index].go(WARM_UP)?;
                let times = running[index].go(count)?;
                series[index][round].extend(times);
            }
        }
        for running in running {
            running.end()?;
        }
        series.iter_mut().for_each(|series| series[round].sort_unstable());
    }
    print(&languages, &series, rounds);
    Ok(())
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
        let mut command = Command::new(&language.program);
        command.args(&language.script).args(["--imu", imu, "--domain", domain.as_domain().name()]);
        command.env("ISOTHERM_ROOT", domain.path("")).stdin(Stdio::piped()).stdout(Stdio::piped());
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

fn print(languages: &[Language], series: &[Vec<Vec<u32>>], rounds: usize) {
    println!("round trips, one sample in flight, {rounds} rounds of new processes [ns]");
    println!("{:<12} {:>9} {:>9} {:>9} {:>11} {:>9}", "", "p50", "p99", "p99.9", "max", "count");
    for (language, rounds) in languages.iter().zip(series) {
        let figures = figures(rounds.concat());
        let cell = |name: &str| figures[name].as_f64().map_or_else(|| "-".to_owned(), |value| format!("{value:.0}"));
        let [p50, p99, p999, max, count] = ["p50_ns", "p99_ns", "p999_ns", "max_ns", "count"].map(cell);
        println!("{:<12} {p50:>9} {p99:>9} {p999:>9} {max:>11} {count:>9}", language.name);
    }
    println!("\n{:<18} {:>20} {:>20} {:>20}", "ratio, 95 % interval", "p50", "p99", "p99.9");
    for (language, rounds) in languages.iter().zip(series).skip(1) {
        let ratios = ratios(rounds, &series[0]);
        let [p50, p99, p999] = ["p50", "p99", "p999"].map(|part| with_interval(&ratios[part]));
        println!("{:<20} {p50:>18} {p99:>20} {p999:>20}", format!("{}/rust", language.name));
    }
    println!(
        "- : fewer than 20 samples beyond it. Absolute times mean nothing on a shared machine; ratios of one run do."
    );
}

fn with_interval(value: &Value) -> String {
    let of = |name: &str| value[name].as_f64();
    let Some(((ratio, low), high)) = of("ratio").zip(of("low")).zip(of("high")) else { return "-".to_owned() };
    format!("{ratio:.2} ({low:.2} {high:.2})")
}
