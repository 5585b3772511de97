//! Four IMUs at 10 kHz with and without `isotherm record` beside them: what it loses, what it costs, and what the others notice.

use crate::Effort;
use crate::open::{self, Schedule};

use isotherm_benches::statistics::{figures, pooled_ratio};
use isotherm_benches::{Outcome, PATIENCE, Partner, World, imu};
use isotherm_client::{Acquisition, Realtime};
use serde_json::{Map, Value, json};
use std::fs;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

const IMUS: usize = 4;
/// Of each IMU.
const PERIOD: Duration = Duration::from_micros(100);
const WARM_UP: usize = 2_000;
/// Blocks with each of these follow each other: no recorder, then one a format.
const STATES: [&str; 4] = ["none", "csv", "parquet", "mcap"];
/// `SCHED_FIFO` priorities, where they may be had: the service before its client before the recorder.
const PRIORITIES: (i32, i32, &str) = (50, 49, "48");
/// Ticks of processor time in a second.
const TICKS: f64 = 100.0;

/// What a recorder has done.
#[derive(Default)]
struct Recorded {
    sent: u64,
    rows: u64,
    missing: u64,
    bytes: u64,
    cpu_s: f64,
    seconds: f64,
}

pub fn measure(effort: Effort) -> Outcome<Value> {
    let world = World::new()?;
    // Whether a thread of this process may have a priority is found out in one of its own: it stays.
    let realtime = thread::spawn(|| priority(PRIORITIES.0).apply().is_ok()).join().unwrap_or(false);
    let settings = if realtime { format!("[realtime]\npriority = {}\n", PRIORITIES.0) } else { String::new() };
    let _service = world.serve_many(IMUS, 1, &settings)?;
    thread::scope(|scope| {
        // Recorders are started by a thread without a priority, or they would inherit it.
        let (ask, asked) = mpsc::channel::<&str>();
        let (give, given) = mpsc::channel();
        let starting = &world;
        scope.spawn(move || {
            for format in asked {
                let _ = give.send(start(starting, format, realtime).map_err(|error| error.to_string()));
            }
        });
        let start = move |format| -> Outcome<Partner> {
            ask.send(format)?;
            Ok(given.recv()??)
        };
        // In a thread of its own, since real-time settings are a thread's and stay.
        let sending =
            scope.spawn(move || alternate(effort, starting, realtime, start).map_err(|error| error.to_string()));
        let result = sending.join().map_err(|_| "the bench panicked")?;
        Ok(result?)
    })
}

fn priority(number: i32) -> Realtime {
    Realtime { priority: Some(number), ..Realtime::default() }
}

fn alternate(
    effort: Effort,
    world: &World,
    realtime: bool,
    start: impl Fn(&'static str) -> Outcome<Partner>,
) -> Outcome<Value> {
    if realtime {
        priority(PRIORITIES.1).apply()?;
    }
    let connect = |index| -> Outcome<Acquisition> { Ok(Acquisition::connect(&imu(index).parse()?, &world.options())?) };
    let mut acquisitions = (0..IMUS).map(connect).collect::<Outcome<Vec<_>>>()?;
    let schedule = Schedule { period: PERIOD, warm_up: WARM_UP, count: effort.of(2_000, 20_000), spin: false };
    let mut sent = STATES.map(|_| Vec::new());
    let mut recorded = STATES.map(|_| Recorded::default());
    for _ in 0..effort.of(1, 10) {
        for (index, state) in STATES.iter().enumerate() {
            for acquisition in &mut acquisitions {
                acquisition.begin_session()?;
            }
            let recorder = if index == 0 { None } else { Some(start(state)?) };
            let started = Instant::now();
            sent[index].push(open::run(&mut acquisitions, schedule, || ())?.sent);
            if let Some(recorder) = recorder {
                let total = &mut recorded[index];
                total.seconds += started.elapsed().as_secs_f64();
                total.sent += ((schedule.warm_up + schedule.count) * IMUS * 2) as u64;
                end(world, recorder, total)?;
            }
        }
    }
    let mut document = Map::new();
    for (index, state) in STATES.iter().enumerate() {
        let mut entry = json!({ "round_trip_from_send": figures(sent[index].concat()) });
        if index > 0 {
            let Recorded { sent: rows_sent, rows, missing, bytes, cpu_s, seconds } = recorded[index];
            let ratio = |part: f64| pooled_ratio(&sent[index], &sent[0], part);
            entry["rows_sent"] = rows_sent.into();
            entry["rows_lost"] = rows_sent.saturating_sub(rows).into();
            entry["rows_missing_as_told"] = missing.into();
            entry["bytes_a_row"] = (bytes as f64 / rows.max(1) as f64).into();
            entry["cpu_percent"] = (cpu_s / seconds * 100.0).into();
            entry["seconds"] = seconds.into();
            entry["ratio_to_none"] = json!({"p50": ratio(0.5), "p99": ratio(0.99), "p999": ratio(0.999)});
        }
        document.insert((*state).to_owned(), entry);
    }
    Ok(json!({"record": document, "imus": IMUS, "rate_hz": 1e9 / PERIOD.as_nanos() as f64, "real_time": realtime}))
}

/// For people.
pub fn print(document: &Value) {
    let number = |value: &Value| value.as_f64().map_or("-".to_owned(), |value| format!("{value:.2}"));
    let ratio =
        |value: &Value| format!("{} ({} {})", number(&value["ratio"]), number(&value["low"]), number(&value["high"]));
    println!(
        "Recording {} IMUs at {} Hz each, raw samples and increments, real-time priorities: {}",
        document["imus"], document["rate_hz"], document["real_time"]
    );
    println!(
        "{:<8} {:>10} {:>8} {:>11} {:>10}   round trip with/without recorder: {:<18} {:<18} p99.9",
        "format", "rows", "lost", "bytes/row", "% of core", "p50", "p99"
    );
    for state in &STATES[1..] {
        let entry = &document["record"][state];
        let ratios = &entry["ratio_to_none"];
        println!(
            "{state:<8} {:>10} {:>8} {:>11} {:>10}   {:33} {:<18} {:<18} {}",
            entry["rows_sent"].to_string(),
            entry["rows_lost"].to_string(),
            number(&entry["bytes_a_row"]),
            number(&entry["cpu_percent"]),
            "",
            ratio(&ratios["p50"]),
            ratio(&ratios["p99"]),
            ratio(&ratios["p999"])
        );
    }
    for state in STATES {
        let trip = &document["record"][state]["round_trip_from_send"];
        let us = |name: &str| trip[name].as_f64().map_or("-".to_owned(), |ns| format!("{:.1}", ns / 1e3));
        let [p50, p99, p999, max] = ["p50_ns", "p99_ns", "p999_ns", "max_ns"].map(us);
        println!("round trip, {state:<8} [us]: p50 {p50}, p99 {p99}, p99.9 {p999}, max {max}");
    }
}

/// A recorder of all IMUs that has found their streams.
fn start(world: &World, format: &str, realtime: bool) -> Outcome<Partner> {
    fs::create_dir_all(world.path("recorded"))?;
    fs::write(world.path("log"), "")?;
    let name = if format == "mcap" { "recorded/all.mcap".to_owned() } else { format!("recorded/{{imu}}.{format}") };
    let ids: Vec<_> = (0..IMUS).map(imu).collect();
    let mut words = vec!["record", "-o", &name];
    ids.iter().for_each(|id| words.extend(["--imu", id]));
    if realtime {
        words.extend(["--priority", PRIORITIES.2]);
    }
    let recorder = world.spawn(&words)?;
    wait(world, "the recorder finds no streams", |log| {
        ids.iter().all(|id| log.contains(&format!("recording {id}\n")))
    })?;
    Ok(recorder)
}

/// Ends it and adds up what it says.
fn end(world: &World, recorder: Partner, total: &mut Recorded) -> Outcome<()> {
    let stat = fs::read_to_string(format!("/proc/{}/stat", recorder.pid()))?;
    let ticks = stat.rsplit(") ").next().unwrap_or_default().split(' ').skip(11).take(2);
    total.cpu_s += ticks.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS;
    recorder.terminate();
    wait(world, "the recorder does not end", |log| log.contains(" rotations\n"))?;
    for line in fs::read_to_string(world.path("log"))?.lines() {
        let Some((_, counts)) = line.split_once(": imu-").and_then(|(_, line)| line.split_once(": ")) else { continue };
        let numbers: Vec<u64> = counts.split([' ', ',']).filter_map(|word| word.parse().ok()).collect();
        if let [rows, _sessions, missing, _repeats, ..] = numbers[..] {
            total.rows += rows;
            total.missing += missing;
        }
    }
    drop(recorder);
    for entry in fs::read_dir(world.path("recorded"))? {
        let entry = entry?;
        total.bytes += entry.metadata()?.len();
        fs::remove_file(entry.path())?;
    }
    Ok(())
}

fn wait(world: &World, trouble: &str, condition: impl Fn(&str) -> bool) -> Outcome<()> {
    let deadline = Instant::now() + 2 * PATIENCE;
    while !condition(&fs::read_to_string(world.path("log"))?) {
        if Instant::now() > deadline {
            return Err(format!("{trouble}:\n{}", world.log()).into());
        }
        thread::sleep(Duration::from_millis(10));
    }
    Ok(())
}
