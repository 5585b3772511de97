//! Table files replaced while the service runs, in every way in which files are replaced.

use isotherm_client::{Acquisition, CompensatedIncrement, Flags, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_tests::{
    Process, TABLE, TIMEOUT, TestDomain, WHOLE_TABLE, completed, recording, round_trip, same, table, variant,
    wait_until, whole_recording,
};
use rustix::process::Signal;
use std::collections::{HashMap, HashSet};
use std::fs::{self, File};
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::thread;
use std::time::{Duration, Instant};

/// A service and an acquisition that sends one sample again and again.
struct ReloadFixture {
    domain: TestDomain,
    service: Process,
    acquisition: Acquisition,
    sample: RawSample,
}

impl ReloadFixture {
    fn new() -> Self {
        let domain = TestDomain::new();
        let service = domain.serve_recording();
        Self::with(domain, service)
    }

    fn with(domain: TestDomain, service: Process) -> Self {
        let acquisition = domain.acquisition("imu-a");
        Self { domain, service, acquisition, sample: recording()[0] }
    }

    fn increment(&mut self) -> CompensatedIncrement {
        round_trip(&mut self.acquisition, &self.sample)
    }

    /// Waits until increments are computed with this table, and checks one of them.
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
    let mut fixture = ReloadFixture::new();
    fixture.wait_for("the first table", TABLE);
    fixture.domain.replace("imu-a.toml", &variant(1));
    fixture.wait_for("renamed over", &variant(1));
    fixture.domain.write("imu-a.toml", &variant(2));
    fixture.wait_for("written in place", &variant(2));
    fs::remove_file(fixture.domain.path("imu-a.toml")).unwrap();
    fixture.domain.write("imu-a.toml", &variant(3));
    fixture.wait_for("removed and created again at once", &variant(3));
    fs::remove_file(fixture.domain.path("imu-a.toml")).unwrap();
    fixture.service.wait_for_log("table refused");
    fixture.wait_for("its absence changes nothing", &variant(3));
    fixture.domain.write("imu-a.toml", &variant(4));
    fixture.wait_for("created again later", &variant(4));
    let status = fixture.domain.imu_status();
    assert_eq!((&status["reloads"], &status["last_reload_error"]), (&4.into(), &serde_json::Value::Null));
    fixture.end();
}

#[test]
fn symbolic_links_switched_at_any_place_of_the_path() {
    let domain = TestDomain::new();
    for (folder, text) in [("v1", variant(1)), ("v2", variant(2)), ("v3", variant(3))] {
        fs::create_dir(domain.path(folder)).unwrap();
        domain.write(&format!("{folder}/imu-a.toml"), &text);
    }
    let switch = |target: &str, link: &str| {
        let staged = domain.path("aside");
        symlink(target, &staged).unwrap();
        fs::rename(staged, domain.path(link)).unwrap();
    };
    switch("v1", "current");
    switch("current/imu-a.toml", "imu-a.toml");
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let mut acquisition = domain.acquisition("imu-a");
    let sample = recording()[0];
    let mut wait_for = |what: &str, text: &str| {
        wait_until(what, || round_trip(&mut acquisition, &sample).table == table(text).id());
    };
    wait_for("through two links", &variant(1));
    switch("v2", "current");
    wait_for("the folder's link switched", &variant(2));
    switch("v3/imu-a.toml", "imu-a.toml");
    wait_for("the file's link switched", &variant(3));
    domain.write("v3/imu-a.toml", &variant(4));
    wait_for("the link's target written", &variant(4));
    service.terminate();
}

#[test]
fn ten_edits_a_second_end_with_the_last_one() {
    let mut fixture = ReloadFixture::new();
    for number in 1..=20 {
        if number % 2 == 0 {
            fixture.domain.replace("imu-a.toml", &variant(number));
        } else {
            fixture.domain.write("imu-a.toml", &variant(number));
        }
        let next = Instant::now() + Duration::from_millis(100);
        while Instant::now() < next {
            fixture.increment();
        }
    }
    fixture.wait_for("the last edit", &variant(20));
    assert_eq!(fixture.service.count_in_log("table refused"), 0, "{}", fixture.service.log());
    fixture.end();
}

#[test]
fn a_file_that_is_still_being_written_is_left_alone() {
    let mut fixture = ReloadFixture::new();
    let text = variant(5);
    let (first, second) = text.split_at(text.len() / 2);
    let mut file = File::create(fixture.domain.path("imu-a.toml")).unwrap();
    file.write_all(first.as_bytes()).unwrap();
    // An event of another file in the folder must not trigger a reload of this one.
    fixture.domain.replace("other.toml", "x = 1\n");
    fixture.wait_for("half a file changes nothing", TABLE);
    file.write_all(second.as_bytes()).unwrap();
    drop(file);
    fixture.wait_for("the whole file", &text);
    assert_eq!(fixture.domain.imu_status()["last_reload_error"], serde_json::Value::Null);
    fixture.end();
}

#[test]
fn a_bad_file_is_reported_once_and_the_next_good_one_taken() {
    let mut fixture = ReloadFixture::new();
    let bad = [
        ("format = 4\n".to_owned(), "imu-a.toml:1: format: "),
        (TABLE.replace("91733.0", "-91733.0"), "positive_scale_factor"),
        (TABLE.replace("imu-a", "imu-b"), "belongs to imu-b"),
        (variant(6)[..300].to_owned(), "not TOML"),
        (
            TABLE.replacen("format = 1", &format!("format = 1\ndigest = \"{}\"", table(&variant(9)).digest()), 1),
            "digest",
        ),
    ];
    for (number, (text, reason)) in (1..).zip(&bad) {
        fixture.domain.replace("imu-a.toml", text);
        fixture.service.wait_for_log_lines("table refused", number);
        let log = fixture.service.log();
        let refusal = log.lines().rfind(|line| line.contains("table refused")).unwrap();
        assert!(refusal.contains(reason), "no {reason:?} in {refusal}");
        fixture.wait_for("a bad file changes nothing", TABLE);
    }
    // The control loop polls the files every 50 ms: ten times in half a second of its uptime.
    let uptime = |fixture: &ReloadFixture| fixture.domain.status()["uptime_s"].as_f64().unwrap();
    let reported = uptime(&fixture);
    wait_until("ten more polls", || uptime(&fixture) > reported + 0.5);
    assert_eq!(fixture.service.count_in_log("table refused"), bad.len(), "{}", fixture.service.log());
    let error = fixture.domain.imu_status()["last_reload_error"].as_str().unwrap().to_owned();
    assert!(error.contains("imu-a.toml:2: digest: "), "{error}");
    fixture.domain.replace("imu-a.toml", &variant(7));
    fixture.wait_for("the next good file", &variant(7));
    assert_eq!(fixture.domain.imu_status()["last_reload_error"], serde_json::Value::Null);
    fixture.end();
}

#[test]
fn sighup_loads_all_tables() {
    let mut fixture = ReloadFixture::new();
    for reloads in 1..=3 {
        fixture.service.signal(Signal::HUP);
        wait_until("the reload", || fixture.domain.imu_status()["reloads"] == reloads);
    }
    fixture.wait_for("the same table", TABLE);
    fixture.domain.replace("imu-a.toml", "nonsense");
    fixture.service.wait_for_log("table refused");
    fixture.service.signal(Signal::HUP);
    fixture.service.wait_for_log_lines("SIGHUP", 4);
    fixture.service.wait_for_log_lines("table refused", 2);
    fixture.wait_for("a bad file changes nothing", TABLE);
    fixture.end();
}

/// The README's figure: 100 reloads during a 2 kHz feed. No increment is lost, and each one matches the table that it
/// names.
#[test]
fn a_hundred_reloads_under_two_kilohertz() {
    let texts: Vec<String> = (0..5).map(variant).collect();
    reload_under_two_kilohertz(&texts, &recording(), 100);
}

/// Each reload adds gyroscopes, lag and transient terms, or takes them away.
#[test]
fn reloads_between_the_formats_under_two_kilohertz() {
    let whole = WHOLE_TABLE.replace("\"imu-g\"", "\"imu-a\"");
    let whole = |number: u32| whole.replace("9.8015", &format!("{:.4}", 9.81 + f64::from(number) * 1e-4));
    let texts = [variant(1), whole(1), variant(2), whole(2)];
    let samples = completed(&whole_recording(1000), 240_000_000_000, "");
    let received = reload_under_two_kilohertz(&texts, &samples, 60);
    let of_format_2: HashSet<_> = [1, 2].map(|number| table(&whole(number)).id()).into();
    for increment in &received {
        let has_gyroscopes = of_format_2.contains(&increment.table);
        assert!(increment.angle_increment.iter().all(|angle| angle.is_nan() != has_gyroscopes), "{increment:?}");
        assert_eq!(increment.flags & Flags::SAMPLE.0, 0, "{}", Flags(increment.flags));
    }
    assert!(received.iter().any(|increment| of_format_2.contains(&increment.table)));
}

/// Exchanges the table of a service during a 2 kHz feed of `samples`. Asserts that no increment is lost, and that each
/// one is exactly that of the table that it names; returns them.
fn reload_under_two_kilohertz(texts: &[String], samples: &[RawSample], wanted: u32) -> Vec<CompensatedIncrement> {
    const PERIOD: Duration = Duration::from_micros(500);
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let tables: HashMap<u64, CoefficientTable> =
        texts.iter().map(|text| table(text)).chain([table(TABLE)]).map(|table| (table.id(), table)).collect();
    let mut acquisition = domain.acquisition("imu-a");
    let (mut sent, mut received, mut reloads, mut in_force) = (Vec::new(), Vec::new(), 0, table(TABLE).id());
    let mut requested = None;
    let started = Instant::now();
    let take = |increment: CompensatedIncrement, reloads: &mut u32, requested: &mut Option<u64>, in_force: &mut u64| {
        if increment.table != *in_force {
            assert_eq!(Some(increment.table), *requested, "only the requested table may come into force");
            (*in_force, *requested) = (increment.table, None);
            *reloads += 1;
        }
        increment
    };
    while reloads < wanted {
        assert!(started.elapsed() < 4 * TIMEOUT, "{reloads} reloads only");
        let due = started + PERIOD * u32::try_from(sent.len()).unwrap();
        while Instant::now() < due {
            if let Some(increment) = acquisition.receive().unwrap() {
                received.push(take(increment, &mut reloads, &mut requested, &mut in_force));
            }
            thread::yield_now();
        }
        if requested.is_none() && sent.len() % 10 == 0 {
            let text = &texts[reloads as usize % texts.len()];
            requested = Some(table(text).id());
            // Gyroscopes that come or go need it.
            domain.accept("imu-a", text);
            domain.replace("imu-a.toml", text);
        }
        while acquisition.in_flight() == acquisition.depth() {
            let increment = acquisition.receive_timeout(TIMEOUT).unwrap().unwrap();
            received.push(take(increment, &mut reloads, &mut requested, &mut in_force));
        }
        let mut loan = acquisition.loan().unwrap();
        let sample = &samples[sent.len() % samples.len()];
        *loan = RawSample { session: loan.session, sequence: loan.sequence, ..*sample };
        sent.push(*loan);
        acquisition.send(loan).unwrap();
    }
    while acquisition.in_flight() > 0 {
        received.push(acquisition.receive_timeout(TIMEOUT).unwrap().unwrap());
    }
    let lost = sent.len() - received.len();
    let wrong = sent.iter().zip(&received).filter(|(raw, increment)| {
        let exact = answer(tables.get(&increment.table), raw);
        !same(increment, &exact)
    });
    let wrong = wrong.count();
    println!("{reloads} reloads, {} increments, lost {lost}, not from the table they name {wrong}", received.len());
    assert_eq!((lost, wrong), (0, 0));
    assert_eq!(domain.imu_status()["gaps"], 0);
    service.terminate();
    received
}
