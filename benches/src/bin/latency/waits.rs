//! Samples at a steady rate under each waiting strategy: latency, and the processor time that it costs the service.

use crate::Effort;
use crate::open::{self, Latencies, SendSchedule};
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, IMU, cores, pin, worker_time};
use isotherm_client::Acquisition;
use serde_json::{Map, Value, json};
use std::time::{Duration, Instant};

const STRATEGIES: [&str; 3] = ["spin", "anticipate", "block"];
/// Rates \[Hz\] and how long each strategy is measured at them \[ms\].
const RATES: [(u32, usize); 2] = [(400, 5_600), (2_000, 3_000)];
/// Number of turns of each strategy.
const TURNS: usize = 4;
/// Uncounted time at the beginning of each turn.
const WARM_UP: Duration = Duration::from_millis(150);

/// What is measured with one waiting strategy.
struct StrategyRun {
    name: &'static str,
    acquisition: [Acquisition; 1],
    service: BenchProcess,
    latencies: Latencies,
    /// Processor time of the worker during `counted`.
    worker: Duration,
    /// Duration of the counted part of all turns.
    counted: Duration,
    _domain: BenchDomain,
}

pub fn measure(effort: Effort) -> BenchResult<Value> {
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));
    let core = theirs.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();
    let mut document = Map::new();
    for (rate, milliseconds) in RATES {
        let mut series = Vec::new();
        for name in STRATEGIES {
            let domain = BenchDomain::new()?;
            let service = domain.serve(&format!("[wait]\nstrategy = \"{name}\"\n{core}"))?;
            let acquisition = [Acquisition::connect(&IMU.parse()?, &domain.options())?];
            service.pause();
            let (latencies, worker, counted) = Default::default();
            series.push(StrategyRun { name, acquisition, service, latencies, worker, counted, _domain: domain });
        }
        let period = Duration::from_secs(1) / rate;
        let count = effort.of(200, milliseconds) * rate as usize / 1000 / TURNS;
        let warm_up = (WARM_UP.as_secs_f64() * f64::from(rate)) as usize;
        for _ in 0..TURNS {
            for series in &mut series {
                turn(series, SendSchedule { period, warm_up, count, spin: true })?;
            }
        }
        let named = series.into_iter().map(|series| {
            let mut figures = series.latencies.figures();
            let share = series.worker.as_secs_f64() / series.counted.as_secs_f64();
            figures.insert("cpu_percent".to_owned(), json!((share * 1e4).round() / 1e2));
            (series.name.to_owned(), Value::Object(figures))
        });
        document.insert(rate.to_string(), named.collect::<Map<_, _>>().into());
    }
    Ok(document.into())
}

fn turn(series: &mut StrategyRun, schedule: SendSchedule) -> BenchResult<()> {
    series.service.resume();
    let mut start = None;
    let service = &series.service;
    let latencies =
        open::run(&mut series.acquisition, schedule, || start = Some((Instant::now(), worker_time(service))))?;
    let (begun, before) = start.ok_or("nothing was counted")?;
    series.counted += begun.elapsed();
    series.worker += worker_time(service).saturating_sub(before);
    series.service.pause();
    series.latencies.append(latencies);
    Ok(())
}
