//! The kill matrix.

use crate::feeder::{Seen, feed, table_text, tables};
use isotherm_benches::{Outcome, Partner, World, imu};
use isotherm_client::{Acquisition, RawSample};
use std::fs;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// The feed that must not notice.
const PERIOD: Duration = Duration::from_micros(500);
/// A service is back by then, or it does not come back.
const RETURN: Duration = Duration::from_secs(15);
/// Tables that take turns, so that the first answer of a new service can be told from the last of the old one, even if that has just reloaded.
const TABLES: usize = 3;

/// A system under a feed at 2 kHz through IMU 0; IMU 1 is for acquisitions that are killed.
struct System<'a> {
    world: &'a World,
    service: Option<Partner>,
    seen: &'a Seen,
    ids: [u64; TABLES],
    turn: usize,
    state: u64,
}

/// One line of the matrix.
struct Row {
    who: &'static str,
    when: &'static str,
    kills: usize,
    times: Vec<Duration>,
}

impl System<'_> {
    /// A pause of up to `longest`, never the same.
    fn pause(&mut self, longest: Duration) {
        self.state = self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        thread::sleep(longest.mul_f64((self.state >> 33) as f64 / f64::from(1_u32 << 31)));
    }

    fn write_table(&self, name: &str) -> Outcome<()> {
        fs::write(self.world.path("next.toml"), table_text(&imu(0), self.turn as u32))?;
        Ok(fs::rename(self.world.path("next.toml"), self.world.path(name))?)
    }

    /// Starts the service with the other table, and gives the time until the feed has an answer of it.
    fn start_and_serve(&mut self, since: Instant) -> Outcome<Duration> {
        self.turn = (self.turn + 1) % TABLES;
        self.write_table("imu-0.toml")?;
        self.service = Some(self.world.spawn(&["serve", "--config", "service.toml"])?);
        while self.seen.table.load(Relaxed) != self.ids[self.turn] {
            if since.elapsed() > RETURN {
                return Err(format!(
                    "the service did not come back within {} s\n{}",
                    RETURN.as_secs(),
                    self.world.log()
                )
                .into());
            }
            thread::sleep(Duration::from_micros(200));
        }
        Ok(since.elapsed())
    }

    fn kill_service(&mut self) -> Instant {
        // Dropping it kills it with SIGKILL and waits for its end.
        self.service = None;
        Instant::now()
    }

    /// Makes and prints one line, with what the feed has seen meanwhile.
    fn row(&mut self, make: impl FnOnce(&mut Self) -> Outcome<Row>) -> Outcome<()> {
        let seen = self.seen;
        let before = [&seen.disorder, &seen.wrong].map(|count| count.load(Relaxed));
        let row = make(self)?;
        // What is in flight is answered before it is counted.
        let (sent, waiting) = (seen.sent.load(Relaxed), Instant::now());
        while seen.answered.load(Relaxed) < sent && waiting.elapsed() < RETURN {
            thread::sleep(Duration::from_millis(1));
        }
        let lost = sent.saturating_sub(seen.answered.load(Relaxed));
        print(row, lost, seen.disorder.load(Relaxed) - before[0], seen.wrong.load(Relaxed) - before[1]);
        Ok(())
    }

    fn killed_while_running(&mut self, kills: usize) -> Outcome<Row> {
        let mut times = Vec::new();
        for _ in 0..kills {
            self.pause(Duration::from_millis(200));
            let killed = self.kill_service();
            times.push(self.start_and_serve(killed)?);
        }
        Ok(Row { who: "service", when: "running", kills, times })
    }

    fn killed_while_reloading(&mut self, kills: usize) -> Outcome<Row> {
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

    fn killed_while_stopping(&mut self, kills: usize) -> Outcome<Row> {
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

    /// Kills it at any moment from its first instruction to its readiness; after every tenth it must serve.
    fn killed_while_creating(&mut self, kills: usize, start: Duration) -> Outcome<Row> {
        let mut times = Vec::new();
        self.kill_service();
        for kill in 1..=kills {
            let service = self.world.spawn(&["serve", "--config", "service.toml"])?;
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

    /// Kills acquisitions of IMU 1 at any moment from their start on. The next one must be answered.
    fn acquisitions_killed(&mut self, kills: usize) -> Outcome<Row> {
        let mut times = Vec::new();
        for kill in 1..=kills {
            let acquisition = self.world.spawn(&["send", "imu-1"])?;
            self.pause(Duration::from_millis(60));
            drop(acquisition);
            if kill.is_multiple_of(10) {
                let killed = Instant::now();
                let mut next = Acquisition::connect(&imu(1).parse()?, &self.world.options())?;
                let mut loan = next.loan()?;
                let (session, sequence) = (loan.session, loan.sequence);
                *loan = RawSample { session, sequence, interval_ns: 500_000, ..RawSample::default() };
                next.compensate(loan, RETURN)?;
                times.push(killed.elapsed());
            }
        }
        Ok(Row { who: "acquisition", when: "connecting, running", kills, times })
    }

    fn readers_killed(&mut self, kills: usize) -> Outcome<Row> {
        for _ in 0..kills {
            let reader = self.world.spawn(&["read", "imu-0"])?;
            self.pause(Duration::from_millis(60));
            drop(reader);
        }
        Ok(Row { who: "reader", when: "connecting, running", kills, times: Vec::new() })
    }
}

pub fn run(smoke: bool) -> Outcome<()> {
    let count = |full: usize| if smoke { full.div_ceil(50).max(2) } else { full };
    let world = World::new()?;
    let service = world.serve_many(2, 1, "")?;
    // That with which the service starts is among them.
    let known = tables(&imu(0), 16)?;
    let ids = [known[0].id(), known[1].id(), known[2].id()];
    let (seen, stop) = (Seen::default(), AtomicBool::new(false));
    println!(
        "who          when                  kills     lost  out of order    wrong   served again after p50 / max [ms]"
    );
    let options = world.options();
    thread::scope(|scope| {
        let feeding =
            scope.spawn(|| feed(&imu(0), &options, PERIOD, &known, &seen, &stop).map_err(|error| error.to_string()));
        let mut system = System { world: &world, service: Some(service), seen: &seen, ids, turn: 0, state: 1 };
        let result: Outcome<()> = (|| {
            let killed = system.kill_service();
            let start = system.start_and_serve(killed)?;
            system.row(|system| system.killed_while_running(count(100)))?;
            system.row(|system| system.killed_while_creating(count(500), start))?;
            system.row(|system| system.killed_while_reloading(count(50)))?;
            system.row(|system| system.killed_while_stopping(count(50)))?;
            system.row(|system| system.acquisitions_killed(count(500)))?;
            system.row(|system| system.readers_killed(count(500)))
        })();
        stop.store(true, Relaxed);
        let fed = feeding.join().map_err(|_| "the feed panicked".to_owned()).flatten();
        result.and(fed.map_err(Into::into))
    })?;
    let (sent, wrong, disorder) = (seen.sent.load(Relaxed), seen.wrong.load(Relaxed), seen.disorder.load(Relaxed));
    println!(
        "{sent} samples through IMU 0 at 2 kHz: {} lost, {disorder} out of order or repeated, {wrong} wrong",
        seen.lost()
    );
    if seen.lost() + wrong + disorder > 0 { Err("something was lost, repeated or wrong".into()) } else { Ok(()) }
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
