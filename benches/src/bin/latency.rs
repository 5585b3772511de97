//! Round trips through Isotherm beside a bare iceoryx2 pair of the same payloads, in alternating blocks of one run.
//!
//! Real processes: this one is the acquisition, its children are the service (waiting by `spin`) and an echo that does
//! nothing but answer. The child that is not being measured is stopped, so that it does not compete for the cores. Both
//! paths are timed by the same clock around the same work: fill in a sample, send it, spin until the answer is there.
//! Ratios are taken block by block, each block against the one measured just before, and their median is given: these
//! machines drift between slow and fast states, and only neighbours in time can be compared.
#![allow(clippy::print_stdout, reason = "the table is the product")]

use clap::Parser;
use core::fmt::Debug;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{BackpressureStrategy, IceoryxSend, ZeroCopySend, ipc};
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::builder::publish_subscribe::Builder;
use isotherm_benches::{IMU, Outcome, PATIENCE, TABLE, World, cores, pin};
use isotherm_client::{Acquisition, CompensatedIncrement, Domain, RawSample, join};
use isotherm_shared::compensate::answer;
use isotherm_shared::stream::IpcNode;
use isotherm_shared::table::CoefficientTable;
use rustix::process::Signal;
use serde_json::{Value, json};
use std::fs;
use std::hint::{black_box, spin_loop};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Uncounted round trips at the start of each block, while caches and the child's core wake up.
const WARM_UP: usize = 500;
/// A percentile with fewer samples beyond it is not given.
const BEYOND: usize = 20;

/// Measures round trips through Isotherm beside a bare iceoryx2 pair.
#[derive(Debug, Parser)]
struct Arguments {
    /// Print one JSON document
    #[arg(long)]
    json: bool,
    /// Pairs of blocks
    #[arg(long, default_value_t = 100)]
    blocks: usize,
    /// Round trips in a block
    #[arg(long, default_value_t = 20_000)]
    round_trips: usize,
    /// A few blocks only, to see that everything works
    #[arg(long)]
    smoke: bool,
}

fn main() -> ExitCode {
    // The children are this very program: the service as its users run it, and the echo.
    let mut words = std::env::args().skip(1);
    let result = match words.next().as_deref() {
        Some("serve") => return isotherm_service::main(),
        Some("echo") => echo(&words.collect::<Vec<_>>()),
        _ => bench(&Arguments::parse()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("latency: {error}");
            ExitCode::FAILURE
        }
    }
}

/// One way to send a sample and get its answer.
trait Path {
    fn round_trip(&mut self, sample: &RawSample) -> Outcome<CompensatedIncrement>;
}

struct Isotherm(Acquisition);

impl Path for Isotherm {
    fn round_trip(&mut self, sample: &RawSample) -> Outcome<CompensatedIncrement> {
        let mut loan = self.0.loan()?;
        let (session, sequence) = (loan.session, loan.sequence);
        *loan = RawSample { session, sequence, ..*sample };
        self.0.send(loan)?;
        let started = Spin::new();
        loop {
            if let Some(increment) = self.0.receive()? {
                return Ok(increment);
            }
            started.go_on()?;
        }
    }
}

struct Bare {
    publisher: Publisher<ipc::Service, RawSample, ()>,
    spare: Option<SampleMut<ipc::Service, RawSample, ()>>,
    subscriber: Subscriber<ipc::Service, CompensatedIncrement, ()>,
    _node: IpcNode,
}

impl Path for Bare {
    fn round_trip(&mut self, sample: &RawSample) -> Outcome<CompensatedIncrement> {
        let mut loan = match self.spare.take() {
            Some(loan) => loan,
            None => self.publisher.loan()?,
        };
        *loan = *sample;
        loan.send()?;
        self.spare = Some(self.publisher.loan()?);
        let started = Spin::new();
        loop {
            if let Some(increment) = self.subscriber.receive()? {
                return Ok(*increment);
            }
            started.go_on()?;
        }
    }
}

struct InProcess(CoefficientTable);

impl Path for InProcess {
    fn round_trip(&mut self, sample: &RawSample) -> Outcome<CompensatedIncrement> {
        Ok(answer(Some(&self.0), black_box(sample)))
    }
}

/// Spinning that ends some day. The clock is looked at rarely.
struct Spin(core::cell::Cell<u32>, core::cell::Cell<Option<Instant>>);

impl Spin {
    const fn new() -> Self {
        Self(core::cell::Cell::new(0), core::cell::Cell::new(None))
    }

    #[inline]
    fn go_on(&self) -> Outcome<()> {
        spin_loop();
        self.0.set(self.0.get().wrapping_add(1));
        if self.0.get().is_multiple_of(1 << 16) {
            let started = self.1.get().unwrap_or_else(Instant::now);
            self.1.set(Some(started));
            if started.elapsed() > PATIENCE {
                return Err("no answer; the other process has stopped".into());
            }
        }
        Ok(())
    }
}

/// A bare stream at its best: one publisher, one subscriber, small queues.
fn bare<T: IceoryxSend + ZeroCopySend + Debug>(node: &IpcNode, name: &str) -> Outcome<Builder<T, (), ipc::Service>> {
    let builder = node.service_builder(&name.try_into()?).publish_subscribe::<T>();
    Ok(builder.max_publishers(1).max_subscribers(1).subscriber_max_buffer_size(2).enable_safe_overflow(true))
}

fn echo(words: &[String]) -> Outcome<()> {
    let [domain, root, core] = words else { return Err("echo DOMAIN ROOT CORE".into()) };
    pin(core.parse().ok());
    let node = join(&Domain::new(domain, root)?)?;
    let subscriber = bare::<RawSample>(&node, "bench/raw")?.open_or_create()?.subscriber_builder().create()?;
    let answers = bare::<CompensatedIncrement>(&node, "bench/increment")?.open_or_create()?;
    let answers = answers.publisher_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create()?;
    let mut spare = Some(answers.loan_uninit()?);
    let parent = rustix::process::getppid();
    for turn in 0u64.. {
        if let Some(sample) = subscriber.receive()? {
            let raw = *sample;
            let increment = CompensatedIncrement { session: raw.session, sequence: raw.sequence, ..Default::default() };
            let loan = spare.take().ok_or("no loan")?;
            loan.write_payload(increment).send()?;
            drop(sample);
            spare = Some(answers.loan_uninit()?);
        } else if turn.is_multiple_of(1 << 20) && rustix::process::getppid() != parent {
            break; // the bench has gone
        }
    }
    Ok(())
}

/// What the blocks of one path have measured.
struct Blocks {
    name: &'static str,
    sorted: Vec<Vec<u32>>,
}

fn bench(arguments: &Arguments) -> Outcome<()> {
    let (blocks, round_trips) =
        if arguments.smoke { (4, 2_000) } else { (arguments.blocks.max(2), arguments.round_trips) };
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));

    let world = World::new()?;
    let service = world.serve("spin", theirs)?;
    let mut isotherm = Isotherm(Acquisition::connect(&IMU.parse()?, &world.options())?);
    service.signal(Signal::STOP);
    let core = theirs.map(|core| core.to_string()).unwrap_or_default();
    let echo = world.spawn(&["echo", world.domain().name(), world.domain().root_path(), &core])?;
    let mut bare = connect_bare(world.domain())?;
    echo.signal(Signal::STOP);
    let mut in_process = InProcess(CoefficientTable::from_toml(TABLE, None).map_err(|faults| faults.to_string())?);

    let named = |name| Blocks { name, sorted: Vec::with_capacity(blocks) };
    let mut measured = [named("iceoryx2"), named("isotherm"), named("in_process")];
    let started = Instant::now();
    for _ in 0..blocks {
        echo.signal(Signal::CONT);
        measured[0].sorted.push(block(&mut bare, round_trips)?);
        echo.signal(Signal::STOP);
        service.signal(Signal::CONT);
        measured[1].sorted.push(block(&mut isotherm, round_trips)?);
        service.signal(Signal::STOP);
        measured[2].sorted.push(block(&mut in_process, round_trips)?);
    }
    report(arguments.json, &measured, started.elapsed(), &cores);
    Ok(())
}

/// Connects to the echo, which may not be ready yet.
fn connect_bare(domain: &Domain) -> Outcome<Bare> {
    let node = join(domain)?;
    let publisher = bare::<RawSample>(&node, "bench/raw")?.open_or_create()?;
    let publisher = publisher.publisher_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create()?;
    let answers = bare::<CompensatedIncrement>(&node, "bench/increment")?.open_or_create()?;
    let subscriber = answers.subscriber_builder().create()?;
    let deadline = Instant::now() + PATIENCE;
    while subscriber.receive()?.is_none() {
        // Until the echo has subscribed nobody gets these.
        publisher.send_copy(RawSample::default())?;
        std::thread::sleep(Duration::from_millis(1));
        if Instant::now() > deadline {
            return Err("the echo does not answer".into());
        }
    }
    std::thread::sleep(Duration::from_millis(20));
    while subscriber.receive()?.is_some() {}
    Ok(Bare { spare: Some(publisher.loan()?), publisher, subscriber, _node: node })
}

/// Times a block's round trips \[ns\], sorted.
fn block(path: &mut impl Path, round_trips: usize) -> Outcome<Vec<u32>> {
    let sample = RawSample {
        interval_ns: 2_500_000,
        positive_pulses: [140, 0, 150],
        negative_pulses: [0, 110, 0],
        head_temperature: [2.4, 2.41, 2.42],
        board_temperature: [2.5, 2.51, 2.52],
        ..RawSample::default()
    };
    for _ in 0..WARM_UP {
        path.round_trip(&sample)?;
    }
    let mut times = Vec::with_capacity(round_trips);
    for _ in 0..round_trips {
        let sent = Instant::now();
        black_box(path.round_trip(black_box(&sample))?);
        times.push(u32::try_from(sent.elapsed().as_nanos()).unwrap_or(u32::MAX));
    }
    times.sort_unstable();
    Ok(times)
}

/// The percentile, if enough samples lie beyond it.
fn percentile(sorted: &[u32], part: f64) -> Option<f64> {
    let rank = (sorted.len() as f64 * part).ceil() as usize;
    (sorted.len() >= rank + BEYOND).then(|| f64::from(sorted[rank.max(1) - 1]))
}

const PARTS: [(&str, f64); 4] = [("p50", 0.5), ("p99", 0.99), ("p999", 0.999), ("p9999", 0.9999)];

fn report(as_json: bool, measured: &[Blocks; 3], elapsed: Duration, cores: &[usize]) {
    let [iceoryx2, isotherm, _] = measured;
    let path = |blocks: &Blocks| {
        let mut all = blocks.sorted.concat();
        all.sort_unstable();
        let mut figures: serde_json::Map<_, _> =
            PARTS.iter().map(|(name, part)| (format!("{name}_ns"), json!(percentile(&all, *part)))).collect();
        figures.insert("max_ns".to_owned(), json!(all.last()));
        figures.insert("count".to_owned(), json!(all.len()));
        (blocks.name.to_owned(), Value::Object(figures))
    };
    let paths: serde_json::Map<_, _> = measured.iter().map(path).collect();
    let ratios = |of: &dyn Fn(f64) -> Option<f64>| -> Value {
        PARTS[..3]
            .iter()
            .map(|(name, part)| ((*name).to_owned(), json!(of(*part))))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    // Each block against the baseline's block just before it; the baseline against its own next block.
    let against = |part| median(iceoryx2.sorted.iter().zip(&isotherm.sorted), part);
    let itself = |part| median(iceoryx2.sorted.iter().zip(&iceoryx2.sorted[1..]), part);
    let document = json!({
        "paths": paths,
        "ratios": {"isotherm/iceoryx2": ratios(&against), "iceoryx2/iceoryx2": ratios(&itself)},
        "machine": {
            "cpu": cpu(),
            "cores": cores.len(),
            "pinned": cores.len() > 1,
            "clock_source": first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
            "governor": first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        },
        "blocks": iceoryx2.sorted.len(),
        "disturbed_blocks": disturbed(iceoryx2) + disturbed(isotherm),
        "seconds": elapsed.as_secs_f64(),
    });
    if as_json {
        println!("{document:#}");
    } else {
        print_table(&document);
    }
}

fn print_table(document: &Value) {
    let number = |value: &Value| value.as_f64().map_or_else(|| "-".to_owned(), |value| format!("{value:.0}"));
    println!("round trips [ns]       p50       p99     p99.9    p99.99       max       count");
    for name in ["iceoryx2", "isotherm", "in_process"] {
        let path = &document["paths"][name];
        let cell = |key: &str| number(&path[key]);
        println!(
            "{name:<14} {:>11} {:>9} {:>9} {:>9} {:>9} {:>11}",
            cell("p50_ns"),
            cell("p99_ns"),
            cell("p999_ns"),
            cell("p9999_ns"),
            cell("max_ns"),
            cell("count")
        );
    }
    println!("\nratio, median over blocks  p50     p99   p99.9");
    for name in ["isotherm/iceoryx2", "iceoryx2/iceoryx2"] {
        let ratio =
            |part: &str| document["ratios"][name][part].as_f64().map_or_else(|| "-".to_owned(), |r| format!("{r:.2}"));
        println!("{name:<22} {:>7} {:>7} {:>7}", ratio("p50"), ratio("p99"), ratio("p999"));
    }
    let machine = &document["machine"];
    println!(
        "\n{}, {} cores, pinned: {}, clock source {}, governor {}; {} blocks each, {} disturbed, {:.1} s",
        machine["cpu"].as_str().unwrap_or("unknown processor"),
        machine["cores"],
        machine["pinned"],
        machine["clock_source"].as_str().unwrap_or("unknown"),
        machine["governor"].as_str().unwrap_or("unknown"),
        document["blocks"],
        document["disturbed_blocks"],
        document["seconds"].as_f64().unwrap_or_default()
    );
    println!("absolute times mean nothing on a shared machine; the second ratio shows what noise alone does");
}

/// Median over pairs of blocks of the second's percentile over the first's.
fn median<'a>(pairs: impl Iterator<Item = (&'a Vec<u32>, &'a Vec<u32>)>, part: f64) -> Option<f64> {
    let ratio = |(base, other): (&Vec<u32>, &Vec<u32>)| Some(percentile(other, part)? / percentile(base, part)?);
    let mut ratios: Vec<f64> = pairs.map(ratio).collect::<Option<_>>()?;
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied()
}

/// Blocks whose median is more than half as much again as the median of all blocks' medians.
fn disturbed(blocks: &Blocks) -> usize {
    let medians: Vec<_> = blocks.sorted.iter().map(|sorted| sorted[sorted.len() / 2]).collect();
    let mut sorted = medians.clone();
    sorted.sort_unstable();
    let usual = sorted[sorted.len() / 2];
    medians.iter().filter(|median| **median > usual + usual / 2).count()
}

fn first_line(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().and_then(|text| text.lines().next().map(str::to_owned))
}

fn cpu() -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(": ").map(|(_, name)| name.to_owned())
}
