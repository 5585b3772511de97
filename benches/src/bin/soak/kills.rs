//! The kill matrix: which process was killed, when and how often, and what was lost.

use crate::feeder::{FeedProgress, RETURN_TIMEOUT, check, describe, failures, feed, table_text, tables};
use isotherm_benches::{BenchDomain, BenchProcess, BenchResult, Random, imu, nearest_rank};
use isotherm_client::RawSample;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::{Duration, Instant};

/// Period of the feed, which must lose nothing.
const PERIOD: Duration = Duration::from_micros(500);
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
    random: Random,
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
        thread::sleep(longest.mul_f64(self.random.unit()));
    }

    /// Gives the service its next table.
    fn next_table(&mut self) -> BenchResult<()> {
        self.turn = (self.turn + 1) % TABLES;
        self.domain.replace("imu-0.toml", &table_text(&imu(0), self.turn as u32)).map(drop)
    }

    /// Starts the service with the next table. Returns the time from `since` to the feed's first answer under this
    /// table.
    fn start_and_serve(&mut self, since: Instant) -> BenchResult<Duration> {
        self.next_table()?;
        self.service = Some(self.domain.serve_again()?);
        let what = format!("the service did not come back within {} s", RETURN_TIMEOUT.as_secs());
        let served = || Ok(self.progress.table.load(Relaxed) == self.ids[self.turn]);
        self.domain.wait_until(&what, [RETURN_TIMEOUT, Duration::from_micros(200)], served)?;
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

    /// Kills the service some time after `disturb`.
    fn service_killed(
        &mut self,
        when: &'static str,
        kills: usize,
        disturb: impl Fn(&mut Self) -> BenchResult<()>,
    ) -> BenchResult<Row> {
        let mut times = Vec::new();
        for _ in 0..kills {
            disturb(self)?;
            let killed = self.kill_service();
            times.push(self.start_and_serve(killed)?);
        }
        Ok(Row { who: "service", when, kills, times })
    }

    fn killed_while_running(&mut self, kills: usize) -> BenchResult<Row> {
        self.service_killed("running", kills, |target| {
            target.pause(Duration::from_millis(200));
            Ok(())
        })
    }

    fn killed_while_reloading(&mut self, kills: usize) -> BenchResult<Row> {
        self.service_killed("reloading", kills, |target| {
            target.pause(Duration::from_millis(100));
            target.next_table()?;
            target.pause(Duration::from_millis(2));
            Ok(())
        })
    }

    fn killed_while_stopping(&mut self, kills: usize) -> BenchResult<Row> {
        self.service_killed("stopping", kills, |target| {
            target.pause(Duration::from_millis(100));
            target.service.iter().for_each(BenchProcess::terminate);
            target.pause(Duration::from_millis(20));
            Ok(())
        })
    }

    /// Kills the service at any moment from its first instruction to its readiness. After every tenth kill it must
    /// serve.
    fn killed_while_creating(&mut self, kills: usize, start: Duration) -> BenchResult<Row> {
        let mut times = Vec::new();
        self.kill_service();
        for kill in 1..=kills {
            let service = self.domain.serve_again()?;
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
                let mut next = self.domain.acquisition(&imu(1))?;
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
        let mut target = KillTarget {
            domain: &domain,
            service: Some(service),
            progress: &progress,
            ids,
            turn: 0,
            random: Random::default(),
        };
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
    let feeds = std::slice::from_ref(&progress);
    println!("{}", describe("IMU 0 at 2 kHz", feeds));
    check(failures(feeds))
}

fn print(row: Row, lost: u64, disorder: u64, wrong: u64) {
    let Row { who, when, kills, mut times } = row;
    times.sort_unstable();
    let [median, longest] = [0.5, 1.0].map(|part| {
        let time = nearest_rank(&times, part);
        time.map_or_else(|| "-".to_owned(), |time| format!("{:.0}", time.as_secs_f64() * 1e3))
    });
    println!(
        "{who:<12} {when:<20} {kills:>6} {lost:>8} {disorder:>13} {wrong:>8}   {median} / {longest} ({} times)",
        times.len()
    );
}
