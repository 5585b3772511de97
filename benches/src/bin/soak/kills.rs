//! The kill matrix: which process was killed, when and how often, and what was lost.

use crate::feeder::{FeedProgress, feed, table_text, tables};
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, imu};
use isotherm_client::{Acquisition, RawSample};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Period of the feed, which must lose nothing.
const PERIOD: Duration = Duration::from_micros(500);
/// Longest time in which a killed service must return.
const RETURN_TIMEOUT: Duration = Duration::from_secs(15);
/// Number of tables that are used in turn. With three of them the first answer of a new service has another table than
/// the last answer of the old one, even if the old one has just reloaded.
const TABLES: usize = 3;

/// A service with a feed at 2 kHz through IMU 0. IMU 1 is for acquisitions that are killed.
struct KillTarget<'a> {
    domain: &'a BenchDomain,
    service: Option<BenchProcess>,
    progress: &'a FeedProgress,
    ids: [u64; TABLES],
    turn: usize,
    random_state: u64,
}

/// One line of the matrix.
struct Row {
    who: &'static str,
    when: &'static str,
    kills: usize,
    times: Vec<Duration>,
}

impl KillTarget<'_> {
    /// Sleeps for a pseudo-random time up to `longest`.
    fn pause(&mut self, longest: Duration) {
        self.random_state =
            self.random_state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        thread::sleep(longest.mul_f64((self.random_state >> 33) as f64 / f64::from(1_u32 << 31)));
    }

    fn write_table(&self, name: &str) -> BenchResult<()> {
        fs::write(self.domain.path("next.toml"), table_text(&imu(0), self.turn as u32))?;
        Ok(fs::rename(self.domain.path("next.toml"), self.domain.path(name))?)
    }

    /// Starts the service with the next table. Returns the time from `since` to the feed's first answer under this
    /// table.
    fn start_and_serve(&mut self, since: Instant) -> BenchResult<Duration> {
        self.turn = (self.turn + 1) % TABLES;
        self.write_table("imu-0.toml")?;
        self.service = Some(self.domain.spawn(&["serve", "--config", "service.toml"])?);
        while self.progress.table.load(Relaxed) != self.ids[self.turn] {
            if since.elapsed() > RETURN_TIMEOUT {
                return Err(format!(
                    "the service did not come back within {} s\n{}",
                    RETURN_TIMEOUT.as_secs(),
                    self.domain.log()
                )
                .into());
            }
            thread::sleep(Duration::from_micros(200));
        }
        Ok(since.elapsed())
    }

    fn kill_service(&mut self) -> Instant {
        // Dropping the process kills it with SIGKILL and waits for its end.
        self.service = None;
        Instant::now()
    }

    /// Runs one line of the matrix, and prints it with what the feed has counted meanwhile.
    fn row(&mut self, make: impl FnOnce(&mut Self) -> BenchResult<Row>) -> BenchResult<()> {
        let progress = self.progress;
        let before = [&progress.disorder, &progress.wrong].map(|count| count.load(Relaxed));
        let row = make(self)?;
        // Wait for the answers to samples in flight before counting.
        let (sent, waiting) = (progress.sent.load(Relaxed), Instant::now());
        while progress.answered.load(Relaxed) < sent && waiting.elapsed() < RETURN_TIMEOUT {
            thread::sleep(Duration::from_millis(1));
        }
        let lost = sent.saturating_sub(progress.answered.load(Relaxed));
        print(row, lost, progress.disorder.load(Relaxed) - before[0], progress.wrong.load(Relaxed) - before[1]);
        Ok(())
    }

    fn killed_while_running(&mut self, kills: usize) -> BenchResult<Row> {
        let mut times = Vec::new();
        for _ in 0..kills {
            self.pause(Duration::from_millis(200));
            let killed = self.kill_service();
            times.push(self.start_and_serve(killed)?);
        }
        Ok(Row { who: "service", when: "running", kills, times })
    }

    fn killed_while_reloading(&mut self, kills: usize) -> BenchResult<Row> {
        let mut times = Vec::new();
        for _ in 0..kills {
            self.pause(Duration::from_millis(100));
            self.turn = (self.turn + 1) % TABLES;
            self.write_table("imu-0.toml")?;
            self.pause(Duration::from_millis(2));
            let killed = self.kill_service();
            times.push(self.start_and_serve(killed)?);
        }
        Ok(Row { who: "service", when: "reloading", kills, times })
    }

    fn killed_while_stopping(&mut self, kills: usize) -> BenchResult<Row> {
        let mut times = Vec::new();
        for _ in 0..kills {
            self.pause(Duration::from_millis(100));
            if let Some(service) = &self.service {
                service.terminate();
            }
            self.pause(Duration::from_millis(20));
            let killed = self.kill_service();
            times.push(self.start_and_serve(killed)?);
        }
        Ok(Row { who: "service", when: "stopping", kills, times })
    }

    /// Kills the service at any moment from its first instruction to its readiness. After every tenth kill it must
    /// serve.
    fn killed_while_creating(&mut self, kills: usize, start: Duration) -> BenchResult<Row> {
        let mut times = Vec::new();
        self.kill_service();
        for kill in 1..=kills {
            let service = self.domain.spawn(&["serve", "--config", "service.toml"])?;
            self.pause(start);
            drop(service);
            if kill.is_multiple_of(10) || kill == kills {
                times.push(self.start_and_serve(Instant::now())?);
                if kill < kills {
                    self.kill_service();
                }
            }
        }
        Ok(Row { who: "service", when: "creating", kills, times })
    }

    /// Kills acquisitions of IMU 1 at any moment after their start. After every tenth kill a new acquisition must get
    /// an answer.
    fn acquisitions_killed(&mut self, kills: usize) -> BenchResult<Row> {
        let mut times = Vec::new();
        for kill in 1..=kills {
            let acquisition = self.domain.spawn(&["send", "imu-1"])?;
            self.pause(Duration::from_millis(60));
            drop(acquisition);
            if kill.is_multiple_of(10) {
                let killed = Instant::now();
                let mut next = Acquisition::connect(&imu(1).parse()?, &self.domain.options())?;
                let mut loan = next.loan()?;
                let (session, sequence) = (loan.session, loan.sequence);
                *loan = RawSample { session, sequence, interval_ns: 500_000, ..RawSample::default() };
                next.compensate(loan, RETURN_TIMEOUT)?;
                times.push(killed.elapsed());
            }
        }
        Ok(Row { who: "acquisition", when: "connecting, running", kills, times })
    }

    fn readers_killed(&mut self, kills: usize) -> BenchResult<Row> {
        for _ in 0..kills {
            let reader = self.domain.spawn(&["read", "imu-0"])?;
            self.pause(Duration::from_millis(60));
            drop(reader);
        }
        Ok(Row { who: "reader", when: "connecting, running", kills, times: Vec::new() })
    }
}

pub(crate) fn run(smoke: bool) -> BenchResult<()> {
    let count = |full: usize| if smoke { full.div_ceil(50).max(2) } else { full };
    let domain = BenchDomain::new()?;
    let service = domain.serve_many(2, 1, "")?;
    // The table that the service starts with is among these 16.
    let known = tables(&imu(0), 16)?;
    let ids = [known[0].id(), known[1].id(), known[2].id()];
    let (progress, stop) = (FeedProgress::default(), AtomicBool::new(false));
    println!(
        "who          when                  kills     lost  out of order    wrong   served again after p50 / max [ms]"
    );
    let options = domain.options();
    thread::scope(|scope| {
        let feeding = scope
            .spawn(|| feed(&imu(0), &options, PERIOD, &known, &progress, &stop).map_err(|error| error.to_string()));
        let mut target =
            KillTarget { domain: &domain, service: Some(service), progress: &progress, ids, turn: 0, random_state: 1 };
        let result: BenchResult<()> = (|| {
            let killed = target.kill_service();
            let start = target.start_and_serve(killed)?;
            target.row(|target| target.killed_while_running(count(100)))?;
            target.row(|target| target.killed_while_creating(count(500), start))?;
            target.row(|target| target.killed_while_reloading(count(50)))?;
            target.row(|target| target.killed_while_stopping(count(50)))?;
            target.row(|target| target.acquisitions_killed(count(500)))?;
            target.row(|target| target.readers_killed(count(500)))
        })();
        stop.store(true, Relaxed);
        let fed = feeding.join().map_err(|_| "the feed panicked".to_owned()).flatten();
        result.and(fed.map_err(Into::into))
    })?;
    let (sent, wrong, disorder) =
        (progress.sent.load(Relaxed), progress.wrong.load(Relaxed), progress.disorder.load(Relaxed));
    println!(
        "{sent} samples through IMU 0 at 2 kHz: {} lost, {disorder} out of order or repeated, {wrong} wrong",
        progress.lost()
    );
    if progress.lost() + wrong + disorder > 0 { Err("something was lost, repeated or wrong".into()) } else { Ok(()) }
}

fn print(row: Row, lost: u64, disorder: u64, wrong: u64) {
    let Row { who, when, kills, mut times } = row;
    times.sort_unstable();
    let at = |index: usize| {
        times.get(index).map_or_else(|| "-".to_owned(), |time| format!("{:.0}", time.as_secs_f64() * 1e3))
    };
    let (median, longest) = (at(times.len() / 2), at(times.len().saturating_sub(1)));
    println!(
        "{who:<12} {when:<20} {kills:>6} {lost:>8} {disorder:>13} {wrong:>8}   {median} / {longest} ({} times)",
        times.len()
    );
}
