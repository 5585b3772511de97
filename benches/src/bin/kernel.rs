//! What the kernel takes for a sample under three tables: of format 1, of format 2 with transient terms, and of a whole
//! IMU. The accelerometers are the same in all three, with `max_rate` and an alignment. All samples are within the
//! ranges.
//!
//! The tables are measured in turns of some milliseconds, so that other load of the machine affects all alike. The
//! ratio is the median of the ratios of the turns.

use clap::Parser;
use isotherm_benches::{BenchResult, Common, LAG_NS, TABLE, cores, median, no_role, pin, run, sample};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_shared::wire::{AXES, RawSample, Triad};
use serde_json::{Value, json};
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

/// Compensations of a turn.
const COUNT: usize = 50_000;
/// Different samples.
const SAMPLES: usize = 256;

/// Measures the kernel under tables of both formats
#[derive(Debug, Parser)]
struct KernelArguments {
    #[command(flatten)]
    common: Common,
}

/// A table, and the time of a sample in each turn \[ns\].
struct Case {
    name: &'static str,
    table: CoefficientTable,
    times: Vec<f64>,
}

fn main() -> ExitCode {
    run(no_role, bench)
}

fn bench(KernelArguments { common }: KernelArguments) -> BenchResult<()> {
    pin(cores().first().copied());
    let mut cases = cases()?;
    let samples: Vec<_> = (0..SAMPLES).map(varied).collect();
    let turns = common.rounds(3, 400);
    for _ in 0..turns {
        for case in &mut cases {
            case.times.push(turn(&case.table, &samples));
        }
    }
    let results = cases.iter().map(|case| case.figures(&cases[0])).collect::<Vec<_>>();
    common.show(json!({"samples_per_turn": COUNT, "turns": turns, "cases": results}));
    Ok(())
}

impl Case {
    fn figures(&self, first: &Self) -> Value {
        let ratio = median(self.times.iter().zip(&first.times).map(|(time, first)| time / first).collect());
        let fastest = self.times.iter().copied().fold(f64::INFINITY, f64::min);
        json!({"table": self.name, "ns": median(self.times.clone()), "fastest_ns": fastest, "ratio": ratio})
    }
}

/// The time of a sample in one turn \[ns\].
fn turn(table: &CoefficientTable, samples: &[RawSample]) -> f64 {
    let started = Instant::now();
    for sample in samples.iter().cycle().take(COUNT) {
        black_box(answer(Some(black_box(table)), black_box(sample)));
    }
    started.elapsed().as_secs_f64() * 1e9 / COUNT as f64
}

fn cases() -> BenchResult<[Case; 3]> {
    let whole = CoefficientTable::from_toml(TABLE, None)?;
    let transient = Content { gyroscopes: None, ..whole.content().clone() };
    let mut plain = Content { format: 1, lag_s: None, ..transient.clone() };
    plain.axes.iter_mut().for_each(|axis| axis.transient = 0.0);
    let table = |content: Content| {
        CoefficientTable::new(content).map_err(|refusals| refusals.iter().map(ToString::to_string).collect::<String>())
    };
    let case = |name, table| Case { name, table, times: Vec::new() };
    Ok([
        case("format 1", table(plain)?),
        case("format 2, transient", table(transient)?),
        case("format 2, whole IMU", whole),
    ])
}

/// A sample within all ranges; each has other counts and other temperature.
fn varied(number: usize) -> RawSample {
    let step = number as f64 / SAMPLES as f64;
    let triad = |triad: Triad| Triad {
        positive_pulses: triad.positive_pulses.map(|pulses| pulses + number as u32),
        head_temperature: [1.0 + step; AXES],
        board_temperature: [2.0 + step; AXES],
        head_lagged: [1.1 + step; AXES],
        ..triad
    };
    let sample = sample();
    RawSample {
        lag_ns: LAG_NS,
        accelerometers: triad(sample.accelerometers),
        gyroscopes: triad(sample.gyroscopes),
        ..sample
    }
}
