//! The soak: one service keeps running and must not grow; another one is killed repeatedly and must not lose anything.

use crate::feeder::{FeedProgress, check, describe, failures, feed, read, table_text, tables};
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, imu, shared_memory, status_number};
use isotherm_shared::table::CoefficientTable;
use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;
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
        self.domain.replace(&format!("{id}.toml"), &text).map(drop)
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
        let count = |folder: PathBuf| fs::read_dir(folder).map_or(0, Iterator::count);
        let (domain, own) = (system.domain.as_domain(), PathBuf::from("/proc/self"));
        let of_service = PathBuf::from(format!("/proc/{}", service.pid()));
        let blocks: Vec<_> = shared_memory(&domain.prefix())
            .map(|entry| entry.metadata().map_or(0, |metadata| metadata.blocks()))
            .collect();
        let resident = |process| status_number(process, "VmRSS").unwrap_or(0);
        Self {
            service_kb: resident(&of_service),
            service_descriptors: count(of_service.join("fd")),
            bench_kb: resident(&own),
            bench_descriptors: count(own.join("fd")),
            shared_objects: blocks.len(),
            shared_kb: blocks.iter().sum::<u64>() / 2,
            files: ["nodes", "services"].map(|name| count(PathBuf::from(domain.root_path()).join(name))).iter().sum(),
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

/// Both services, and what is done to them.
struct Soak {
    steady: FedService,
    killed: FedService,
    started: Instant,
    time: Duration,
    reloads: AtomicU64,
    kills: AtomicU64,
    lives: AtomicU64,
    /// What the readers have read, how many of it were wrong, and how many came twice.
    read: [AtomicU64; 3],
}

impl Soak {
    fn over(&self) -> bool {
        self.started.elapsed() >= self.time
    }

    fn reload(&self) -> BenchResult<()> {
        while !self.over() {
            let count = self.reloads.fetch_add(1, Relaxed);
            [&self.steady, &self.killed].into_iter().try_for_each(|system| system.reload(count))?;
            thread::sleep(RELOAD);
        }
        Ok(())
    }

    /// Reads, and kills another reader.
    fn read(&self) -> BenchResult<()> {
        let FedService { domain, tables, .. } = &self.steady;
        for life in 0.. {
            let index = life % IMUS;
            let counts = read(&imu(index), &domain.options(), Duration::from_millis(700), &tables[index])?;
            for (sum, count) in self.read.iter().zip(counts) {
                sum.fetch_add(count, Relaxed);
            }
            let child = domain.spawn(&["read", &imu(index)])?;
            thread::sleep(Duration::from_millis(300));
            drop(child);
            self.lives.fetch_add(1, Relaxed);
            if self.over() {
                break;
            }
        }
        Ok(())
    }

    /// Kills the second service and starts it again. A child process ends with the thread that has started it. So this
    /// thread stays until it is `done`: the last answers have come.
    fn kill(&self, mut service: BenchProcess, done: &AtomicBool) -> BenchResult<()> {
        let mut since = Instant::now();
        while !done.load(Relaxed) {
            if since.elapsed() >= LIFE && !self.over() {
                drop(service);
                service = self.killed.domain.serve_again()?;
                self.kills.fetch_add(1, Relaxed);
                since = Instant::now();
            }
            thread::sleep(Duration::from_millis(20));
        }
        Ok(())
    }

    /// Prints what the first service uses, seven times and at the end.
    fn watch(&self, service: &BenchProcess) {
        let print = || {
            println!("{:>5.0} s  {}", self.started.elapsed().as_secs_f64(), ResourceUse::of(&self.steady, service));
            println!("         {}", latency(&self.steady));
        };
        let warm_up = WARM_UP.min(self.time / 3);
        let mut next = warm_up;
        while !self.over() {
            if self.started.elapsed() >= next {
                print();
                next += (self.time - warm_up).div_f64(6.0).max(Duration::from_secs(1));
            }
            thread::sleep(Duration::from_millis(50));
        }
        print();
    }

    /// Runs everything until the time is over and the last answers have come.
    fn run(&self, living: &BenchProcess, dying: BenchProcess) -> Result<(), String> {
        let (stop, done) = (AtomicBool::new(false), AtomicBool::new(false));
        let text = |result: BenchResult<()>| result.map_err(|error| error.to_string());
        let joined =
            |thread: ScopedJoinHandle<'_, _>| thread.join().map_err(|_| "a thread panicked".to_owned()).flatten();
        thread::scope(|scope| {
            let systems = [&self.steady, &self.killed].into_iter();
            let feeding: Vec<_> = systems.flat_map(|system| system.feed(scope, &stop)).collect();
            let reloading = scope.spawn(|| text(self.reload()));
            let reading = scope.spawn(|| text(self.read()));
            let killing = scope.spawn(|| text(self.kill(dying, &done)));
            self.watch(living);
            let others = joined(reloading).and(joined(reading));
            stop.store(true, Relaxed);
            let fed = feeding.into_iter().map(joined).fold(Ok(()), Result::and);
            done.store(true, Relaxed);
            others.and(fed).and(joined(killing))
        })
    }
}

pub(crate) fn run(minutes: f64) -> BenchResult<()> {
    let (steady, living) = FedService::new()?;
    let (killed, dying) = FedService::new()?;
    println!("soak of {minutes} minutes: 2 services, {IMUS} IMUs each at 400 Hz");
    let soak = Soak {
        steady,
        killed,
        started: Instant::now(),
        time: Duration::from_secs_f64(minutes * 60.0),
        reloads: AtomicU64::new(0),
        kills: AtomicU64::new(0),
        lives: AtomicU64::new(0),
        read: Default::default(),
    };
    soak.run(&living, dying)?;
    let [read, wrong, twice] = soak.read.each_ref().map(|count| count.load(Relaxed));
    let [reloads, lives, kills] = [&soak.reloads, &soak.lives, &soak.kills].map(|count| count.load(Relaxed));
    println!("{}", describe("the service that lives", &soak.steady.progress));
    println!(
        "  {reloads} reloads; {lives} readers came and went, as many were killed: {read} increments read, {wrong} wrong, {twice} twice"
    );
    println!("{}", describe(&format!("the service that was killed {kills} times"), &soak.killed.progress));
    check(failures(&soak.steady.progress) + failures(&soak.killed.progress) + wrong + twice)
}

/// The latency of the last minute, from the status of the service.
fn latency(system: &FedService) -> String {
    let ask = || -> BenchResult<String> {
        let output = system.domain.command(&std::env::current_exe()?).args(["status", "--json"]).output()?;
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
