//! Latency under load: with and without a busy process on every core, with and without real-time settings, with and
//! without reloads.

use crate::open::{self, Latencies, SendSchedule};
use isotherm_benches::{BenchDomain, BenchResult, Common, IMU, TABLE, cores, pin_apart, pooled_ratio, stolen_ticks};
use isotherm_client::Realtime;
use serde_json::{Map, Value, json};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

/// Rate of the samples \[Hz\].
const RATE: u32 = 2_000;
/// Number of turns: each is a second without reloads and a second with them.
const TURNS: usize = 20;
const RELOADS_PER_SECOND: u32 = 10;
/// `SCHED_FIFO` priorities of the service and of its client.
const PRIORITIES: (i32, i32) = (50, 49);

/// Role of a neighbour process: uses all the processor time that it gets.
pub(crate) fn spin_forever() -> ! {
    loop {
        core::hint::black_box(0);
    }
}

pub(crate) fn measure(common: Common) -> BenchResult<Value> {
    let scenarios = [
        ("quiet", false, false),
        ("quiet, real-time", false, true),
        ("neighbours", true, false),
        ("neighbours, real-time", true, true),
    ];
    // Before a thread is bound to one of them.
    let cores = cores();
    let mut document = Map::new();
    for (name, neighbours, realtime) in scenarios {
        let neighbours = if neighbours { cores.clone() } else { Vec::new() };
        // In a new thread, because real-time settings apply to a thread and stay.
        let result = thread::spawn(move || scenario(common, &neighbours, realtime).map_err(|error| error.to_string()));
        let result = result.join().map_err(|_| "a scenario panicked")?;
        document.insert(name.to_owned(), result.unwrap_or_else(|cause| json!({"not_measured": cause})));
    }
    Ok(json!({"load": document, "rate_hz": RATE, "reloads_per_s": RELOADS_PER_SECOND}))
}

/// Measures with a busy process on each of these cores.
fn scenario(common: Common, neighbours: &[usize], realtime: bool) -> BenchResult<Value> {
    let domain = BenchDomain::new()?;
    let start = |core: &usize| domain.spawn(&["child", &core.to_string(), "hungry"]);
    let _neighbours = neighbours.iter().map(start).collect::<BenchResult<Vec<_>>>()?;
    let core = cores().get(1).map(|core| format!("core = {core}\n")).unwrap_or_default();
    let more = if realtime { format!("priority = {}\nlock_memory = true\n", PRIORITIES.0) } else { String::new() };
    let _service = domain.serve(None, &format!("[realtime]\n{core}{more}"))?;
    let on = AtomicBool::new(false);
    let (end, ended) = mpsc::channel();
    thread::scope(|scope| {
        scope.spawn(|| reload(&domain, &on, &{ ended }));
        let _end = end;
        // Only now, because processes and threads that this thread starts inherit its settings.
        pin_apart();
        if realtime {
            Realtime { priority: Some(PRIORITIES.1), lock_memory: true, ..Realtime::default() }.apply()?;
        }
        send(common, &domain, &on)
    })
}

fn send(common: Common, domain: &BenchDomain, on: &AtomicBool) -> BenchResult<Value> {
    let mut acquisition = [domain.acquisition(IMU)?];
    let schedule = SendSchedule {
        period: Duration::from_secs(1) / RATE,
        warm_up: RATE as usize / 20,
        count: common.of(200, RATE as usize),
    };
    let (mut without, mut with, mut disturbed) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..common.rounds(6, TURNS) {
        let before = stolen_ticks();
        for (reloads, turns) in [(false, &mut without), (true, &mut with)] {
            on.store(reloads, Relaxed);
            turns.push(open::run(&mut acquisition, schedule)?);
        }
        disturbed.push(stolen_ticks() != before);
    }
    Ok(figures(without, with, &disturbed))
}

/// The figures of turns without and with reloads. Those with steal time are left out of the ratio, because they make it
/// less certain. The figures of both keep them.
fn figures(without: Vec<Latencies>, with: Vec<Latencies>, disturbed: &[bool]) -> Value {
    let sent = |turns: &[Latencies]| {
        let undisturbed = turns.iter().zip(disturbed).filter(|(_, disturbed)| !**disturbed);
        undisturbed.map(|(turn, _)| turn.sent.clone()).collect::<Vec<_>>()
    };
    let (with_sent, without_sent) = (sent(&with), sent(&without));
    let ratio = |part: f64| pooled_ratio(&with_sent, &without_sent, part);
    let ratios = json!({"p99": ratio(0.99), "p999": ratio(0.999)});
    let figures = |turns: Vec<Latencies>| {
        let mut all = Latencies::default();
        turns.into_iter().for_each(|turn| all.append(turn));
        all.figures()
    };
    json!({
        "no_reloads": figures(without),
        "reloads": figures(with),
        "ratios from_send, reloads/no_reloads": ratios,
        "turns": disturbed.len(),
        "disturbed_turns": disturbed.iter().filter(|disturbed| **disturbed).count(),
    })
}

/// Replaces the table ten times a second while `on` is set, until the other side of the channel is gone.
fn reload(domain: &BenchDomain, on: &AtomicBool, ended: &Receiver<()>) {
    let mut number = 0;
    while ended.recv_timeout(Duration::from_secs(1) / RELOADS_PER_SECOND) == Err(RecvTimeoutError::Timeout) {
        if on.load(Relaxed) {
            number = (number + 1) % 9;
            // If this fails, a reload is missing; the latencies stay valid.
            let _ = domain.replace("table.toml", &TABLE.replace("9.8015", &format!("9.80{number}")));
        }
    }
}
