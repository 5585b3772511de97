//! Four IMUs at 10 kHz with and without `isotherm record`: the rows that it loses, its processor time, and its effect
//! on the round trips.

use crate::open::{self, SendSchedule};
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, Common, TIMEOUT, figures, imu, pooled_ratio};
use isotherm_client::Realtime;
use serde_json::{Map, Value, json};
use std::sync::mpsc;
use std::time::{Duration, Instant};
use std::{fs, thread};

const IMUS: usize = 4;
/// Period of each IMU's samples.
const PERIOD: Duration = Duration::from_micros(100);
const WARM_UP: usize = 2_000;
/// The states of alternating blocks: no recorder, then a recorder of each format.
const STATES: [&str; 3] = ["none", "csv", "mcap"];
/// `SCHED_FIFO` priorities of the service, its client and the recorder, if they are permitted.
const PRIORITIES: (i32, i32, &str) = (50, 49, "48");
/// Ticks of processor time in a second.
const TICKS: f64 = 100.0;

/// The totals of the recorders of a state.
#[derive(Default)]
struct Recorded {
    sent: u64,
    rows: u64,
    missing: u64,
    bytes: u64,
    cpu_s: f64,
    seconds: f64,
}

impl Recorded {
    fn describe(&self, entry: &mut Value) {
        entry["rows_sent"] = self.sent.into();
        entry["rows_lost"] = self.sent.saturating_sub(self.rows).into();
        entry["rows_missing_as_told"] = self.missing.into();
        entry["bytes_a_row"] = (self.bytes as f64 / self.rows.max(1) as f64).into();
        entry["cpu_percent"] = (self.cpu_s / self.seconds * 100.0).into();
        entry["seconds"] = self.seconds.into();
    }
}

pub(crate) fn measure(common: Common) -> BenchResult<Value> {
    let domain = BenchDomain::new()?;
    // Whether a priority is permitted is tried in a new thread, because the thread keeps it.
    let realtime = thread::spawn(|| priority(PRIORITIES.0).apply().is_ok()).join().unwrap_or(false);
    let settings = if realtime { format!("[realtime]\npriority = {}\n", PRIORITIES.0) } else { String::new() };
    let _service = domain.serve_many(IMUS, 1, &settings)?;
    thread::scope(|scope| {
        // A thread without a priority starts the recorders, because they inherit its priority.
        let (ask, asked) = mpsc::channel::<&str>();
        let (give, given) = mpsc::channel();
        let starting = &domain;
        scope.spawn(move || {
            for format in asked {
                let _ = give.send(start(starting, format, realtime).map_err(|error| error.to_string()));
            }
        });
        let start = move |format| -> BenchResult<BenchProcess> {
            ask.send(format)?;
            Ok(given.recv()??)
        };
        // In a new thread, because real-time settings apply to a thread and stay.
        let sending =
            scope.spawn(move || alternate(common, starting, realtime, start).map_err(|error| error.to_string()));
        let result = sending.join().map_err(|_| "the bench panicked")?;
        Ok(result?)
    })
}

fn priority(number: i32) -> Realtime {
    Realtime { priority: Some(number), ..Realtime::default() }
}

fn alternate(
    common: Common,
    domain: &BenchDomain,
    realtime: bool,
    start: impl Fn(&'static str) -> BenchResult<BenchProcess>,
) -> BenchResult<Value> {
    if realtime {
        priority(PRIORITIES.1).apply()?;
    }
    let mut acquisitions = (0..IMUS).map(|index| domain.acquisition(&imu(index))).collect::<BenchResult<Vec<_>>>()?;
    let schedule = SendSchedule { period: PERIOD, warm_up: WARM_UP, count: common.of(2_000, 20_000) };
    let mut sent = STATES.map(|_| Vec::new());
    let mut recorded = STATES.map(|_| Recorded::default());
    for _ in 0..common.rounds(1, 10) {
        for (index, state) in STATES.iter().enumerate() {
            for acquisition in &mut acquisitions {
                acquisition.begin_session()?;
            }
            let recorder = if index == 0 { None } else { Some(start(state)?) };
            let started = Instant::now();
            sent[index].push(open::run(&mut acquisitions, schedule)?.sent);
            if let Some(recorder) = recorder {
                let total = &mut recorded[index];
                total.seconds += started.elapsed().as_secs_f64();
                total.sent += ((schedule.warm_up + schedule.count) * IMUS * 2) as u64;
                end(domain, recorder, total)?;
            }
        }
    }
    let documents = STATES.iter().zip(&sent).zip(&recorded).map(|((state, times), recorded)| {
        let mut entry = json!({ "round_trip_from_send": figures(times.concat()) });
        if *state != STATES[0] {
            let ratio = |part: f64| pooled_ratio(times, &sent[0], part);
            recorded.describe(&mut entry);
            entry["ratio_to_none"] = json!({"p50": ratio(0.5), "p99": ratio(0.99), "p999": ratio(0.999)});
        }
        ((*state).to_owned(), entry)
    });
    let documents: Map<_, _> = documents.collect();
    Ok(json!({"record": documents, "imus": IMUS, "rate_hz": 1e9 / PERIOD.as_nanos() as f64, "real_time": realtime}))
}

/// Starts a recorder of all IMUs, and waits until it has found their streams.
fn start(domain: &BenchDomain, format: &str, realtime: bool) -> BenchResult<BenchProcess> {
    fs::create_dir_all(domain.path("recorded"))?;
    domain.clear_log()?;
    let name = if format == "mcap" { "recorded/all.mcap".to_owned() } else { format!("recorded/{{imu}}.{format}") };
    let ids: Vec<_> = (0..IMUS).map(imu).collect();
    let mut words = vec!["record", "-o", &name];
    ids.iter().for_each(|id| words.extend(["--imu", id]));
    if realtime {
        words.extend(["--priority", PRIORITIES.2]);
    }
    let recorder = domain.spawn(&words)?;
    wait(domain, "the recorder finds no streams", |log| {
        ids.iter().all(|id| log.contains(&format!("recording {id}\n")))
    })?;
    Ok(recorder)
}

/// Ends the recorder, and adds what it prints to `total`.
fn end(domain: &BenchDomain, recorder: BenchProcess, total: &mut Recorded) -> BenchResult<()> {
    let stat = fs::read_to_string(format!("/proc/{}/stat", recorder.pid()))?;
    let ticks = stat.rsplit(") ").next().unwrap_or_default().split(' ').skip(11).take(2);
    total.cpu_s += ticks.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS;
    recorder.terminate();
    wait(domain, "the recorder does not end", |log| log.contains(" rotations\n"))?;
    for line in domain.whole_log().lines() {
        let Some((_, counts)) = line.split_once(": imu-").and_then(|(_, line)| line.split_once(": ")) else { continue };
        let numbers: Vec<u64> = counts.split([' ', ',']).filter_map(|word| word.parse().ok()).collect();
        if let [rows, _sessions, missing, _repeats, ..] = numbers[..] {
            total.rows += rows;
            total.missing += missing;
        }
    }
    drop(recorder);
    for entry in fs::read_dir(domain.path("recorded"))? {
        let entry = entry?;
        total.bytes += entry.metadata()?.len();
        fs::remove_file(entry.path())?;
    }
    Ok(())
}

fn wait(domain: &BenchDomain, failure: &str, condition: impl Fn(&str) -> bool) -> BenchResult<()> {
    domain.wait_until(failure, [2 * TIMEOUT, Duration::from_millis(10)], || Ok(condition(&domain.whole_log())))
}
