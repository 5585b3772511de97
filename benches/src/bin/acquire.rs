//! `isotherm acquire` from an emulated STIM300 behind a pseudo-terminal to the service and its readers: what is lost,
//! how long a frame takes, how even its times are, and what it costs.
//!
//! The emulator, `isotherm-emulator` of the tests, must be built beside this program. A pseudo-terminal has no rate:
//! the latency is that from the write of a frame to its sending, without the time that a line would take.

use clap::Parser;
use isotherm_benches::{
    BenchDomain, BenchProcess, BenchResult, Common, TIMEOUT, figures, nearest_rank, own_folder, run, status_number,
};
use isotherm_client::{CompensatedIncrement, ImuId, RawSample, Reader, Streamed};
use isotherm_recording::RawCsvReader;
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

/// Increments whose counter rises by 2 in each frame, at any rate of the emulator.
const PROFILE: &str = include_str!("../../../examples/acquire/stim300.toml");
const EMULATOR: &str = "isotherm-emulator";
/// Silence before the first frame, in which the acquisition connects: a pseudo-terminal that is full holds the emulator
/// up, as no device is.
const SILENCE: Duration = Duration::from_secs(1);
/// Time before anything is measured.
const WARM_UP: Duration = Duration::from_secs(2);
/// The times of frames settle in this time, and are not judged before.
const SETTLED: Duration = Duration::from_secs(5);
/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(5);

/// Measures the acquisition from an emulated device
#[derive(Debug, Parser)]
struct Arguments {
    #[command(flatten)]
    common: Common,
    /// Seconds that each part is measured
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// The higher of the two rates in Hz; 2000 unless given
    #[arg(long, value_name = "HZ")]
    rate: Option<u32>,
}

fn main() -> ExitCode {
    run(|_| Ok(isotherm_cli::main()), bench)
}

fn bench(Arguments { common, seconds, rate }: Arguments) -> BenchResult<()> {
    let seconds = seconds.unwrap_or(common.of(1, 20) as f64);
    // A build that is not optimized, on a busy machine, must keep up with it.
    let rate = rate.unwrap_or(common.of(500, 2000) as u32);
    let emulator = own_folder()?.join(EMULATOR);
    if !emulator.exists() {
        let folder = emulator.display();
        return Err(format!("{folder} is not built; `cargo build [--release] -p isotherm-tests` makes it").into());
    }
    let part = |rate, jitter_ms| Part { emulator: &emulator, rate, jitter_ms, seconds }.measure();
    let mut document = json!({});
    document[rate.to_string()] = part(rate, 0)?;
    document["400"] = part(400, 0)?;
    document["bursts of 1 ms"] = part(rate, 1)?;
    document["babble"] = babble(common.of(1, 16))?;
    common.show(document);
    Ok(())
}

/// One run of device, acquisition, service and readers.
struct Part<'a> {
    emulator: &'a Path,
    rate: u32,
    jitter_ms: u32,
    seconds: f64,
}

impl Part<'_> {
    fn measure(&self) -> BenchResult<Value> {
        let domain = BenchDomain::new()?;
        let interval_ns = (1e9 / f64::from(self.rate)).round() as u64;
        describe(&domain, interval_ns, &format!("serial = \"{}\"\nbaud = 921600", domain.path("line").display()))?;
        let mut nominal = domain.spawn(&["acquire", "source.toml", "--nominal", "imu-a.toml"])?;
        if !nominal.succeeds_within(TIMEOUT)? {
            return Err(domain.failure("there is no nominal table"));
        }
        domain.replace("service.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n")?;
        let service = domain.serve_again()?;
        let (seen, measured) = self.flow(&domain)?;
        drop(service);
        self.judge(&domain, interval_ns, &seen, measured)
    }

    /// Lets it run. Returns what readers have seen, and what the process took.
    fn flow(&self, domain: &BenchDomain) -> BenchResult<(Seen, Value)> {
        let whole = self.seconds + 2.0 * WARM_UP.as_secs_f64();
        let frames = (whole * f64::from(self.rate)).ceil();
        let [rate, frames, jitter] =
            [f64::from(self.rate), frames, f64::from(self.jitter_ms)].map(|number| number.to_string());
        let words = ["stim300", "--rate", &rate, "--frames", &frames, "--jitter-ms", &jitter];
        let words = [&words[..], &["--log", "frames.txt", "--link", "line", "--pause", "0:1"]].concat();
        let readers = Readers::start(domain)?;
        let _device = domain.spawn_program(self.emulator, &words)?;
        domain.wait_until("the device's line", [TIMEOUT, LOOK], || Ok(domain.path("line").exists()))?;
        let mut acquire = domain.spawn(&["acquire", "source.toml", "--record", "acquired.csv", "--json"])?;
        sleep(SILENCE + WARM_UP);
        let (began, before, at_begin) = (Instant::now(), processor_s(&acquire)?, memory_kb(&acquire));
        sleep(Duration::from_secs_f64(self.seconds));
        let (after, passed, at_end) = (processor_s(&acquire)?, began.elapsed().as_secs_f64(), memory_kb(&acquire));
        let away = Duration::from_secs_f64(whole) + TIMEOUT;
        domain.wait_until("the end of the device", [away, LOOK], || Ok(domain.whole_log().contains("went away")))?;
        acquire.terminate();
        if !acquire.succeeds_within(TIMEOUT)? {
            return Err(domain.failure("the acquisition failed"));
        }
        let measured = json!({
            "cpu_percent": (after - before) / passed * 100.0,
            "rss_begin_kb": at_begin,
            "rss_end_kb": at_end,
        });
        Ok((readers.end()?, measured))
    }

    fn judge(&self, domain: &BenchDomain, interval_ns: u64, seen: &Seen, measured: Value) -> BenchResult<Value> {
        let tally: Value = serde_json::from_str(domain.output().lines().last().unwrap_or_default())?;
        // Frame, and when it was written. The first frame has sequence 0.
        let log = fs::read_to_string(domain.path("frames.txt"))?;
        let number = |word: Option<&str>| word.and_then(|word| word.parse::<u64>().ok()).unwrap_or_default();
        let written: BTreeMap<u64, u64> = log
            .lines()
            .map(|line| line.split(' '))
            .map(|mut words| (number(words.next()), number(words.next())))
            .collect();
        let raw: BTreeMap<u64, &RawSample> = seen.raw.iter().map(|raw| (raw.sequence, raw)).collect();
        let lost = written.keys().filter(|number| !raw.contains_key(number)).count();
        let latencies = raw.iter().filter_map(|(number, raw)| raw.sent_ns.checked_sub(*written.get(number)?));
        let latencies = latencies.map(|ns| u32::try_from(ns).unwrap_or(u32::MAX)).collect();

        let (unequal, recorded) = unequal(domain, seen)?;
        let mut document = json!({ "write_to_sent": figures(latencies) });
        document["frames"] = json!({
            "written": written.len(),
            "lost": lost,
            "repeated": seen.raw.len() - raw.len(),
            "recorded": recorded,
            "increments": seen.increments.len(),
            "increments_unequal": unequal,
            "dropped": tally["service"]["dropped"],
            "gaps": tally["gaps"],
        });
        document["times"] = steps(&raw, interval_ns, self.rate);
        document["process"] = measured;
        Ok(document)
    }
}

/// Writes the description of a STIM300 at a source.
fn describe(domain: &BenchDomain, interval_ns: u64, source: &str) -> BenchResult<()> {
    let interval = format!("interval_s = {}", interval_ns as f64 / 1e9);
    let text = PROFILE.replace("serial = \"/dev/ttyUSB0\"\nbaud = 921600", source);
    let text = text.replace("interval_s = 0.001", &interval);
    domain.replace("source.toml", &text)?;
    Ok(())
}

/// Increments that are not those of the record, and rows of the record.
fn unequal(domain: &BenchDomain, seen: &Seen) -> BenchResult<(usize, usize)> {
    let table = CoefficientTable::from_toml(&fs::read_to_string(domain.path("imu-a.toml"))?, None)?;
    let rows = RawCsvReader::new(File::open(domain.path("acquired.csv"))?)?.collect::<Result<Vec<_>, _>>()?;
    let exact: BTreeMap<_, _> =
        rows.iter().map(|raw| ((raw.session, raw.sequence), bits(&answer(Some(&table), raw)))).collect();
    let differs = |increment: &&CompensatedIncrement| {
        exact.get(&(increment.session, increment.sequence)) != Some(&bits(increment))
    };
    Ok((seen.increments.iter().filter(differs).count(), rows.len()))
}

/// What of an increment a replay gives, too.
fn bits(increment: &CompensatedIncrement) -> [u64; 9] {
    let CompensatedIncrement { timestamp_ns, interval_ns, velocity_increment, angle_increment, table, .. } = *increment;
    let [[x, y, z], [r, s, t]] = [velocity_increment, angle_increment].map(|triad| triad.map(f64::to_bits));
    [timestamp_ns, interval_ns, x, y, z, r, s, t, table]
}

/// How the steps of the times differ from the interval \[ns\], once they have settled.
fn steps(raw: &BTreeMap<u64, &RawSample>, interval_ns: u64, rate: u32) -> Value {
    let settled = (SETTLED.as_secs_f64() * f64::from(rate)) as u64;
    let first = if raw.len() as u64 > 2 * settled { settled } else { raw.len() as u64 / 2 };
    let times: Vec<_> = raw.range(first..).map(|(number, raw)| (*number, raw.timestamp_ns)).collect();
    let follow = times.windows(2).filter(|pair| pair[0].0 + 1 == pair[1].0);
    let mut errors: Vec<f64> =
        follow.map(|pair| (pair[1].1 as f64 - pair[0].1 as f64 - interval_ns as f64).abs()).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let rms = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len().max(1) as f64).sqrt();
    json!({ "step_rms_ns": rms, "step_p99_ns": nearest_rank(&errors, 0.99), "step_worst_ns": errors.last() })
}

/// All that was published.
struct Seen {
    raw: Vec<RawSample>,
    increments: Vec<CompensatedIncrement>,
}

/// Readers of both streams, each in a thread of its own.
struct Readers {
    ended: Arc<AtomicBool>,
    raw: Reading<RawSample>,
    increments: Reading<CompensatedIncrement>,
}

type Reading<T> = thread::JoinHandle<Result<Vec<T>, String>>;

impl Readers {
    fn start(domain: &BenchDomain) -> BenchResult<Self> {
        let ended = Arc::<AtomicBool>::default();
        let (ready, is_ready) = sync_channel(2);
        let (raw, increments) = (reading(domain, &ended, &ready), reading(domain, &ended, &ready));
        // Both, before the first frame.
        is_ready.recv()?;
        is_ready.recv()?;
        Ok(Self { ended, raw, increments })
    }

    fn end(self) -> BenchResult<Seen> {
        self.ended.store(true, Ordering::Relaxed);
        let raw = self.raw.join().map_err(|_| "a reader has panicked")??;
        let increments = self.increments.join().map_err(|_| "a reader has panicked")??;
        Ok(Seen { raw, increments })
    }
}

/// Reads a stream until it is told to end and nothing more comes.
fn reading<T: Streamed + Send + 'static>(
    domain: &BenchDomain,
    ended: &Arc<AtomicBool>,
    ready: &SyncSender<()>,
) -> Reading<T> {
    let (options, ended, ready) = (domain.options(), Arc::clone(ended), ready.clone());
    let read = move || -> BenchResult<Vec<T>> {
        // Connected here: a reader stays in its thread.
        let mut reader = Reader::<T>::connect("imu-a".parse::<ImuId>()?, &options)?;
        ready.send(())?;
        let mut all = Vec::new();
        loop {
            match reader.receive_timeout(Duration::from_millis(100))? {
                Some(one) => all.push(one),
                None if ended.load(Ordering::Relaxed) => return Ok(all),
                None => {}
            }
        }
    };
    thread::spawn(move || read().map_err(|error| error.to_string()))
}

fn folder(process: &BenchProcess) -> PathBuf {
    format!("/proc/{}", process.pid()).into()
}

/// The processor time of all threads of a process so far, finer than the ticks of its `stat` \[s\].
fn processor_s(process: &BenchProcess) -> BenchResult<f64> {
    let mut ns = 0.0;
    for thread in fs::read_dir(folder(process).join("task"))?.flatten() {
        // A thread may just have ended.
        let text = fs::read_to_string(thread.path().join("schedstat")).unwrap_or_default();
        ns += text.split_whitespace().next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or_default();
    }
    Ok(ns / 1e9)
}

fn memory_kb(process: &BenchProcess) -> Option<u64> {
    status_number(&folder(process), "VmRSS")
}

/// How long bytes that are no frames take, from a file, beyond a start without any.
fn babble(megabytes: usize) -> BenchResult<Value> {
    let domain = BenchDomain::new()?;
    describe(&domain, 1_000_000, "file = \"bytes\"")?;
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    let count = megabytes << 20;
    let noise = (0..count).map(|_| random()).collect();
    let kinds: [(&str, Vec<u8>); 3] = [("none", Vec::new()), ("noise", noise), ("sync", vec![0xA5; count])];
    let mut times = Vec::new();
    for (kind, bytes) in kinds {
        fs::write(domain.path("bytes"), bytes)?;
        let began = Instant::now();
        // Bytes without a frame are bad data, exit code 65.
        let status = domain.spawn(&["acquire", "source.toml", "--dry-run"])?.ends_within(6 * TIMEOUT)?;
        if status.code() != Some(65) {
            return Err(domain.failure(&format!("{kind}: {status}")));
        }
        times.push(began.elapsed().as_secs_f64() * 1e3);
    }
    let [none, noise, sync] = times[..] else { return Err("a kind of babble is missing".into()) };
    let of_megabyte = |ms: f64| (ms - none).max(0.0) / megabytes as f64;
    Ok(json!({ "megabytes": megabytes, "noise_ms_per_mb": of_megabyte(noise), "sync_ms_per_mb": of_megabyte(sync) }))
}
