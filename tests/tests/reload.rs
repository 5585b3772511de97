//! Tables replaced under a running service, in every way that files are replaced.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::{Acquisition, CompensatedIncrement, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_tests::{PATIENCE, Process, TABLE, World, recording, round_trip, same, table, variant, wait_until};
use rustix::process::Signal;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::thread;
use std::time::{Duration, Instant};

/// A service with an acquisition that keeps sending.
struct Bench {
    world: World,
    service: Process,
    acquisition: Acquisition,
    sample: RawSample,
}

impl Bench {
    fn new() -> Self {
        let world = World::new();
        let service = world.serve_recording();
        Self::with(world, service)
    }

    fn with(world: World, service: Process) -> Self {
        let acquisition = world.acquisition("imu-a");
        Self { world, service, acquisition, sample: recording()[0] }
    }

    fn increment(&mut self) -> CompensatedIncrement {
        round_trip(&mut self.acquisition, &self.sample)
    }

    /// Waits until increments come from the table with this text, and checks one of them.
    fn wait_for(&mut self, what: &str, text: &str) {
        let table = table(text);
        wait_until(what, || self.increment().table == table.id());
        let increment = self.increment();
        assert_eq!(increment.velocity_increment, answer(Some(&table), &self.sample).velocity_increment, "{what}");
    }

    fn end(self) {
        self.service.terminate();
    }
}

#[test]
fn renamed_over_written_in_place_and_created_again() {
    let mut bench = Bench::new();
    bench.wait_for("the first table", TABLE);
    bench.world.replace("imu-a.toml", &variant(1));
    bench.wait_for("renamed over", &variant(1));
    bench.world.write("imu-a.toml", &variant(2));
    bench.wait_for("written in place", &variant(2));
    fs::remove_file(bench.world.path("imu-a.toml")).unwrap();
    bench.world.write("imu-a.toml", &variant(3));
    bench.wait_for("removed and created again at once", &variant(3));
    fs::remove_file(bench.world.path("imu-a.toml")).unwrap();
    bench.service.wait_for_log("table refused");
    bench.wait_for("its absence changes nothing", &variant(3));
    bench.world.write("imu-a.toml", &variant(4));
    bench.wait_for("created again later", &variant(4));
    let status = bench.world.imu_status();
    assert_eq!((&status["reloads"], &status["last_reload_error"]), (&4.into(), &serde_json::Value::Null));
    bench.end();
}

#[test]
fn symbolic_links_switched_at_any_place_of_the_path() {
    let world = World::new();
    for (folder, text) in [("v1", variant(1)), ("v2", variant(2)), ("v3", variant(3))] {
        fs::create_dir(world.path(folder)).unwrap();
        world.write(&format!("{folder}/imu-a.toml"), &text);
    }
    let switch = |target: &str, link: &str| {
        let aside = world.path("aside");
        symlink(target, &aside).unwrap();
        fs::rename(aside, world.path(link)).unwrap();
    };
    switch("v1", "current");
    switch("current/imu-a.toml", "imu-a.toml");
    let service = world.serve(&["--imu", "imu-a=imu-a.toml"]);
    let mut acquisition = world.acquisition("imu-a");
    let sample = recording()[0];
    let mut wait_for = |what: &str, text: &str| {
        wait_until(what, || round_trip(&mut acquisition, &sample).table == table(text).id());
    };
    wait_for("through two links", &variant(1));
    switch("v2", "current");
    wait_for("the folder's link switched", &variant(2));
    switch("v3/imu-a.toml", "imu-a.toml");
    wait_for("the file's link switched", &variant(3));
    world.write("v3/imu-a.toml", &variant(4));
    wait_for("the link's target written", &variant(4));
    service.terminate();
}

#[test]
fn ten_edits_a_second_end_with_the_last_one() {
    let mut bench = Bench::new();
    for number in 1..=20 {
        if number % 2 == 0 {
            bench.world.replace("imu-a.toml", &variant(number));
        } else {
            bench.world.write("imu-a.toml", &variant(number));
        }
        let next = Instant::now() + Duration::from_millis(100);
        while Instant::now() < next {
            bench.increment();
        }
    }
    bench.wait_for("the last edit", &variant(20));
    assert_eq!(bench.service.count_in_log("table refused"), 0, "{}", bench.service.log());
    bench.end();
}

#[test]
fn a_file_that_is_still_being_written_is_left_alone() {
    let mut bench = Bench::new();
    let text = variant(5);
    let (first, second) = text.split_at(text.len() / 2);
    let mut file = File::create(bench.world.path("imu-a.toml")).unwrap();
    file.write_all(first.as_bytes()).unwrap();
    // What happens to other files of the folder says nothing about this one.
    bench.world.replace("other.toml", "x = 1\n");
    bench.wait_for("half a file changes nothing", TABLE);
    file.write_all(second.as_bytes()).unwrap();
    drop(file);
    bench.wait_for("the whole file", &text);
    assert_eq!(bench.world.imu_status()["last_reload_error"], serde_json::Value::Null);
    bench.end();
}

#[test]
fn a_bad_file_is_reported_once_and_the_next_good_one_taken() {
    let mut bench = Bench::new();
    let bad = [
        ("format = 2\n".to_owned(), "imu-a.toml:1: format: "),
        (TABLE.replace("91733.0", "-91733.0"), "positive_scale_factor"),
        (TABLE.replace("imu-a", "imu-b"), "belongs to imu-b"),
        (variant(6)[..300].to_owned(), "not TOML"),
        (
            TABLE.replacen("format = 1", &format!("format = 1\ndigest = \"{}\"", table(&variant(9)).digest()), 1),
            "digest",
        ),
    ];
    for (number, (text, reason)) in (1..).zip(&bad) {
        bench.world.replace("imu-a.toml", text);
        bench.service.wait_for_log_lines("table refused", number);
        let log = bench.service.log();
        let refusal = log.lines().rfind(|line| line.contains("table refused")).unwrap();
        assert!(refusal.contains(reason), "no {reason:?} in {refusal}");
        bench.wait_for("a bad file changes nothing", TABLE);
    }
    // The control loop goes on looking at the files; half a second of its own time is ten looks.
    let up = |bench: &Bench| bench.world.status()["uptime_s"].as_f64().unwrap();
    let reported = up(&bench);
    wait_until("ten more looks", || up(&bench) > reported + 0.5);
    assert_eq!(bench.service.count_in_log("table refused"), bad.len(), "{}", bench.service.log());
    let error = bench.world.imu_status()["last_reload_error"].as_str().unwrap().to_owned();
    assert!(error.contains("imu-a.toml:2: digest: "), "{error}");
    bench.world.replace("imu-a.toml", &variant(7));
    bench.wait_for("the next good file", &variant(7));
    assert_eq!(bench.world.imu_status()["last_reload_error"], serde_json::Value::Null);
    bench.end();
}

#[test]
fn sighup_loads_all_tables() {
    let mut bench = Bench::new();
    for reloads in 1..=3 {
        bench.service.signal(Signal::HUP);
        wait_until("the reload", || bench.world.imu_status()["reloads"] == reloads);
    }
    bench.wait_for("the same table", TABLE);
    bench.world.replace("imu-a.toml", "nonsense");
    bench.service.wait_for_log("table refused");
    bench.service.signal(Signal::HUP);
    bench.service.wait_for_log_lines("SIGHUP", 4);
    bench.service.wait_for_log_lines("table refused", 2);
    bench.wait_for("a bad file changes nothing", TABLE);
    bench.end();
}

/// The figure of the README: 100 reloads under a 2 kHz feed, nothing lost, everything from the table that it names.
#[test]
fn a_hundred_reloads_under_two_kilohertz() {
    const RELOADS: u32 = 100;
    const PERIOD: Duration = Duration::from_micros(500);
    let world = World::new();
    let service = world.serve_recording();
    let texts: Vec<String> = (0..5).map(variant).collect();
    let tables: HashMap<u64, CoefficientTable> =
        texts.iter().map(|text| table(text)).chain([table(TABLE)]).map(|table| (table.id(), table)).collect();
    let samples = recording();
    let mut acquisition = world.acquisition("imu-a");
    let (mut sent, mut received, mut reloads, mut in_force) = (Vec::new(), Vec::new(), 0, table(TABLE).id());
    let mut asked = None;
    let started = Instant::now();
    let take = |increment: CompensatedIncrement, reloads: &mut u32, asked: &mut Option<u64>, in_force: &mut u64| {
        if increment.table != *in_force {
            assert_eq!(Some(increment.table), *asked, "only the table asked for comes into force");
            (*in_force, *asked) = (increment.table, None);
            *reloads += 1;
        }
        increment
    };
    while reloads < RELOADS {
        assert!(started.elapsed() < 4 * PATIENCE, "{reloads} reloads only");
        let due = started + PERIOD * u32::try_from(sent.len()).unwrap();
        while Instant::now() < due {
            if let Some(increment) = acquisition.receive().unwrap() {
                received.push(take(increment, &mut reloads, &mut asked, &mut in_force));
            }
            thread::yield_now();
        }
        if asked.is_none() && sent.len() % 10 == 0 {
            let text = &texts[reloads as usize % texts.len()];
            asked = Some(table(text).id());
            world.replace("imu-a.toml", text);
        }
        while acquisition.in_flight() == acquisition.depth() {
            let increment = acquisition.receive_timeout(PATIENCE).unwrap().unwrap();
            received.push(take(increment, &mut reloads, &mut asked, &mut in_force));
        }
        let mut loan = acquisition.loan().unwrap();
        let sample = &samples[sent.len() % samples.len()];
        *loan = RawSample { session: loan.session, sequence: loan.sequence, ..*sample };
        sent.push(*loan);
        acquisition.send(loan).unwrap();
    }
    while acquisition.in_flight() > 0 {
        received.push(acquisition.receive_timeout(PATIENCE).unwrap().unwrap());
    }
    let lost = sent.len() - received.len();
    let wrong = sent.iter().zip(&received).filter(|(raw, increment)| {
        let exact = answer(tables.get(&increment.table), raw);
        !same(increment, &exact)
    });
    let wrong = wrong.count();
    println!("{reloads} reloads, {} increments, lost {lost}, not from the table they name {wrong}", received.len());
    assert_eq!((lost, wrong), (0, 0));
    assert_eq!(world.imu_status()["gaps"], 0);
    service.terminate();
}
