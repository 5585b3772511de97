//! Latency for different numbers of IMUs: with one that sends while the others are idle, and with all sending.

use crate::Effort;
use crate::open::{self, SendSchedule};
use crate::paths::{Isotherm, Path as _};
use isotherm_benches::statistics::figures;
use isotherm_benches::{BenchDomain, BenchResult, cores, imu, pin, sample, worker_time};
use isotherm_client::Acquisition;
use serde_json::{Map, Value, json};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Numbers of IMUs, of which one sends.
const COUNTS: [usize; 3] = [1, 8, 32];
/// Rate at which every IMU sends where all do \[Hz\].
const RATE: u32 = 400;

pub fn measure(effort: Effort) -> BenchResult<Value> {
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));
    let core = theirs.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();

    let mut idle = Map::new();
    for count in COUNTS {
        let domain = BenchDomain::new()?;
        let _service = domain.serve_many(count, 1, &format!("[wait]\nstrategy = \"spin\"\n{core}"))?;
        let mut path = Isotherm(Acquisition::connect(&imu(0).parse()?, &domain.options())?);
        let trips = effort.of(5_000, 200_000);
        let mut times = Vec::with_capacity(trips);
        for turn in 0..trips + trips / 20 {
            let sent = Instant::now();
            black_box(path.round_trip(&sample())?);
            if turn >= trips / 20 {
                times.push(u32::try_from(sent.elapsed().as_nanos()).unwrap_or(u32::MAX));
            }
        }
        idle.insert(count.to_string(), figures(times).into());
    }

    let mut active = Map::new();
    for (count, workers) in [(1, 1), (8, 1), (8, 2), (32, 1), (32, 2)] {
        let domain = BenchDomain::new()?;
        // Two workers and the sender need three cores, and there may be only two. So the scheduler places two workers.
        let core = if workers == 1 { core.as_str() } else { "" };
        let service = domain.serve_many(count, workers, core)?;
        let acquisitions = (0..count).map(|index| Ok(Acquisition::connect(&imu(index).parse()?, &domain.options())?));
        let mut acquisitions = acquisitions.collect::<BenchResult<Vec<_>>>()?;
        let schedule = SendSchedule {
            period: Duration::from_secs(1) / RATE,
            warm_up: RATE as usize / 4,
            count: effort.of(50, 6 * RATE as usize),
            spin: true,
        };
        let mut start = None;
        let latencies =
            open::run(&mut acquisitions, schedule, || start = Some((Instant::now(), worker_time(&service))))?;
        let (begun, before) = start.ok_or("nothing was counted")?;
        let share = worker_time(&service).saturating_sub(before).as_secs_f64() / begun.elapsed().as_secs_f64();
        let mut figures = latencies.figures();
        figures.insert("cpu_percent".to_owned(), json!((share * 1e4).round() / 1e2));
        active.insert(format!("{count} IMUs, {workers} workers"), figures.into());
    }
    let p50 = |count: &str| idle[count]["p50_ns"].as_f64();
    let each = p50("32").zip(p50("1")).map(|(many, one)| (many - one) / 31.0);
    Ok(json!({"scale": {"idle": idle, "ns_per_idle_stream": each, "active": active, "rate_hz": RATE}}))
}
