//! The soak: one service keeps running and must not grow; another one is killed repeatedly and must not lose anything.

use crate::feeder::{FeedProgress, feed, read, table_text, tables};
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, imu};
use isotherm_shared::table::CoefficientTable;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::thread::{self, ScopedJoinHandle};
use std::time::{Duration, Instant};
use std::{fmt, fs};

const IMUS: usize = 4;
/// Period of each IMU's samples.
const PERIOD: Duration = Duration::from_micros(2_500);
/// After this time queues, caches and allocators have what they need.
const WARM_UP: Duration = Duration::from_secs(20);
/// Time between two kills of the second service.
const LIFE: Duration = Duration::from_secs(5);
/// Time between two reloads.
const RELOAD: Duration = Duration::from_millis(500);
/// Number of tables that are loaded in turn. The last one is the table that a service starts with.
const TABLES: u32 = 16;

/// A service that is fed: its domain, its tables, and the progress of the feed of each IMU.
struct FedService {
    domain: BenchDomain,
    tables: Vec<Vec<CoefficientTable>>,
    progress: Vec<FeedProgress>,
}

impl FedService {
    fn new() -> BenchResult<(Self, BenchProcess)> {
        let domain = BenchDomain::new()?;
        let service = domain.serve_many(IMUS, 1, "")?;
        let tables = (0..IMUS).map(|index| tables(&imu(index), TABLES)).collect::<BenchResult<_>>()?;
        Ok((Self { domain, tables, progress: (0..IMUS).map(|_| FeedProgress::default()).collect() }, service))
    }

    fn feed<'scope>(
        &'scope self,
        scope: &'scope thread::Scope<'scope, '_>,
        stop: &'scope AtomicBool,
    ) -> Vec<ScopedJoinHandle<'scope, Result<(), String>>> {
        let options = self.domain.options();
        (0..IMUS)
            .map(|index| {
                let (options, tables, progress) = (options.clone(), &self.tables[index], &self.progress[index]);
                scope.spawn(move || {
                    feed(&imu(index), &options, PERIOD, tables, progress, stop).map_err(|error| error.to_string())
                })
            })
            .collect()
    }

    fn reload(&self, count: u64) -> BenchResult<()> {
        let id = imu(count as usize % IMUS);
        let text = table_text(&id, (count / IMUS as u64 % u64::from(TABLES)) as u32);
        fs::write(self.domain.path("next.toml"), text)?;
        Ok(fs::rename(self.domain.path("next.toml"), self.domain.path(&format!("{id}.toml")))?)
    }

    fn sum(&self, count: fn(&FeedProgress) -> &AtomicU64) -> u64 {
        self.progress.iter().map(|progress| count(progress).load(Relaxed)).sum()
    }

    fn describe(&self, name: &str) -> String {
        let lost: u64 = self.progress.iter().map(FeedProgress::lost).sum();
        format!(
            "{name}: {} samples sent, {} increments checked, {} wrong, {} out of order or repeated, {lost} lost",
            self.sum(|progress| &progress.sent),
            self.sum(|progress| &progress.answered),
            self.sum(|progress| &progress.wrong),
            self.sum(|progress| &progress.disorder),
        )
    }

    fn failures(&self) -> u64 {
        self.progress.iter().map(FeedProgress::lost).sum::<u64>()
            + self.sum(|progress| &progress.wrong)
            + self.sum(|progress| &progress.disorder)
    }
}

/// Memory, descriptors and files that the processes use.
struct ResourceUse {
    service_kb: u64,
    service_descriptors: usize,
    bench_kb: u64,
    bench_descriptors: usize,
    shared_objects: usize,
    shared_kb: u64,
    files: usize,
}

impl ResourceUse {
    fn of(system: &FedService, service: &BenchProcess) -> Self {
        let count = |folder: &str| fs::read_dir(folder).map_or(0, Iterator::count);
        let resident = |process: &str| {
            let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
            let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
            line.and_then(|line| line.trim().split(' ').next()?.parse().ok()).unwrap_or(0)
        };
        let (domain, pid) = (system.domain.as_domain(), service.pid().to_string());
        let (mut shared_objects, mut shared_kb) = (0, 0);
        for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&domain.prefix()) {
                use std::os::unix::fs::MetadataExt as _;
                shared_objects += 1;
                shared_kb += entry.metadata().map_or(0, |metadata| metadata.blocks() / 2);
            }
        }
        Self {
            service_kb: resident(&pid),
            service_descriptors: count(&format!("/proc/{pid}/fd")),
            bench_kb: resident("self"),
            bench_descriptors: count("/proc/self/fd"),
            shared_objects,
            shared_kb,
            files: ["nodes", "services"].iter().map(|name| count(&format!("{}/{name}", domain.root_path()))).sum(),
        }
    }
}

impl fmt::Display for ResourceUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "service {} kB and {} descriptors; clients {} kB and {} descriptors; shared memory {} objects, {} kB; {} files",
            self.service_kb,
            self.service_descriptors,
            self.bench_kb,
            self.bench_descriptors,
            self.shared_objects,
            self.shared_kb,
            self.files
        )
    }
}

pub(crate) fn run(minutes: f64) -> BenchResult<()> {
    let time = Duration::from_secs_f64(minutes * 60.0);
    let (steady, living) = FedService::new()?;
    let (killed, dying) = FedService::new()?;
    let (stop, done) = (AtomicBool::new(false), AtomicBool::new(false));
    let (reloads, kills, lives) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
    let read_counts = [(); 3].map(|()| AtomicU64::new(0));
    println!("soak of {minutes} minutes: 2 services, {IMUS} IMUs each at 400 Hz");
    let started = Instant::now();
    let over = || started.elapsed() >= time;
    thread::scope(|scope| {
        let feeding: Vec<_> = [&steady, &killed].into_iter().flat_map(|system| system.feed(scope, &stop)).collect();
        let reloading = scope.spawn(|| -> Result<(), String> {
            while !over() {
                let count = reloads.fetch_add(1, Relaxed);
                for system in [&steady, &killed] {
                    system.reload(count).map_err(|error| error.to_string())?;
                }
                thread::sleep(RELOAD);
            }
            Ok(())
        });
        let reading = scope.spawn(|| -> Result<(), String> {
            let options = steady.domain.options();
            for life in 0.. {
                let index = life % IMUS;
                let counts = read(&imu(index), &options, Duration::from_millis(700), &steady.tables[index]);
                let counts = counts.map_err(|error| error.to_string())?;
                for (sum, count) in read_counts.iter().zip(counts) {
                    sum.fetch_add(count, Relaxed);
                }
                let child = steady.domain.spawn(&["read", &imu(index)]).map_err(|error| error.to_string())?;
                thread::sleep(Duration::from_millis(300));
                drop(child);
                lives.fetch_add(1, Relaxed);
                if over() {
                    break;
                }
            }
            Ok(())
        });
        let killing = scope.spawn(|| -> Result<(), String> {
            let mut service = dying;
            let mut since = Instant::now();
            // A child process ends with the thread that has started it. So this thread stays until the last answers
            // have come.
            while !done.load(Relaxed) {
                if since.elapsed() >= LIFE && !over() {
                    drop(service);
                    let next = killed.domain.spawn(&["serve", "--config", "service.toml"]);
                    service = next.map_err(|error| error.to_string())?;
                    kills.fetch_add(1, Relaxed);
                    since = Instant::now();
                }
                thread::sleep(Duration::from_millis(20));
            }
            Ok(())
        });
        let mut next = WARM_UP.min(time / 3);
        while !over() {
            if started.elapsed() >= next {
                println!("{:>5.0} s  {}", started.elapsed().as_secs_f64(), ResourceUse::of(&steady, &living));
                println!("         {}", latency(&steady));
                next += (time - WARM_UP.min(time / 3)).div_f64(6.0).max(Duration::from_secs(1));
            }
            thread::sleep(Duration::from_millis(50));
        }
        let joined =
            |result: thread::Result<Result<(), String>>| result.map_err(|_| "a thread panicked".to_owned()).flatten();
        let others = joined(reloading.join()).and(joined(reading.join()));
        println!("{:>5.0} s  {}", started.elapsed().as_secs_f64(), ResourceUse::of(&steady, &living));
        println!("         {}", latency(&steady));
        stop.store(true, Relaxed);
        let fed = feeding.into_iter().map(|feed| joined(feed.join())).fold(Ok(()), Result::and);
        done.store(true, Relaxed);
        others.and(fed).and(joined(killing.join()))
    })?;
    let [read, wrong, twice] = read_counts.each_ref().map(|count| count.load(Relaxed));
    println!("{}", steady.describe("the service that lives"));
    println!(
        "  {} reloads; {} readers came and went, as many were killed: {read} increments read, {wrong} wrong, {twice} twice",
        reloads.load(Relaxed),
        lives.load(Relaxed)
    );
    println!("{}", killed.describe(&format!("the service that was killed {} times", kills.load(Relaxed))));
    if steady.failures() + killed.failures() + wrong + twice > 0 {
        return Err("something was lost, repeated or wrong".into());
    }
    Ok(())
}

/// The latency of the last minute, from the status of the service.
fn latency(system: &FedService) -> String {
    let ask = || -> BenchResult<String> {
        let output = std::process::Command::new(std::env::current_exe()?)
            .args(["status", "--json"])
            .env("ISOTHERM_DOMAIN", system.domain.as_domain().name())
            .env("ISOTHERM_ROOT", system.domain.path(""))
            .output()?;
        let status: serde_json::Value = serde_json::from_slice(&output.stdout)?;
        let minute = &status["imus"][0]["latency_minute_ns"];
        let figure = |name: &str| minute[name].as_u64().unwrap_or(0);
        Ok(format!(
            "IMU 0 in the last minute: p50 {} ns, p99 {} ns, max {} ns",
            figure("p50"),
            figure("p99"),
            figure("max")
        ))
    };
    ask().unwrap_or_else(|error| format!("no status: {error}"))
}
