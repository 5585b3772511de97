//! A laboratory for tests of the automatic campaign: a real service and the processes of a simulated station, hundreds
//! of times as fast as a real one.

use crate::{Process, TABLE, TIMEOUT, TestDomain, text, wait_until};
use isotherm_laboratory_bench::{assert_units, linear};
use serde_json::Value;
use std::fs;
use std::process::Output;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Laboratory time divided by real time.
const SPEED: &str = "700";

/// Serial number of a truth with gyroscopes.
pub const SERIAL: &str = "SN 42";

/// A station in `DIR/station` with a service for its IMU, and a plan for both.
pub struct TestLaboratory {
    /// The domain and the folder of both.
    pub domain: TestDomain,
    /// The service.
    pub service: Process,
    /// The station.
    pub station: Process,
    /// Dropped last: when the processes have ended.
    _place: Place,
}

/// Most simulated laboratories at a time: with more, replies are late on two cores.
const PLACES: usize = 6;
static TAKEN: Mutex<usize> = Mutex::new(0);
static FREED: Condvar = Condvar::new();

/// The place of a simulated laboratory on this machine.
struct Place;

impl Place {
    /// Waits for a place.
    fn take() -> Self {
        let taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner);
        let mut taken = FREED.wait_while(taken, |taken| *taken >= PLACES).unwrap_or_else(PoisonError::into_inner);
        *taken += 1;
        Self
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        *TAKEN.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        FREED.notify_one();
    }
}

/// Replacements in the station's plan that make the campaign as short as the simulated physics allows.
const SHORTER_PLAN: [(&str, &str); 7] = [
    ("ramp_c_per_min = 1\n", "ramp_c_per_min = 3\n"),
    ("time_s = 3600\nstay_s = 4200\nwindow_s = 900", "time_s = 600\nstay_s = 0\nwindow_s = 300"),
    ("time_s = 300", "time_s = 60"),
    ("start_c = -25\nstop_c = 45\nstep_c = 5", "list_c = [20, 23]"),
    ("chamber_c_per_h = 2\n", "chamber_c_per_h = 20\n"),
    // Long time limits: on a loaded machine the simulated time runs ahead of the processes.
    ("[limits]", "[patience]\npause_s = 60000\nstream_s = 30000\nsettle_s = 20000\nstable_s = 60000\n\n[limits]"),
    (
        "\n[verify]\nruns = 2\nattitudes_deg = [[50, 130], [230, 130]]\nfrom_c = -25\nto_c = 45\nramp_c_per_h = 20\nhold_s = 1800\n",
        "",
    ),
];

impl TestLaboratory {
    /// Starts service and station, and applies `SHORTER_PLAN` and then `changes` to the station's plan.
    pub fn new(changes: &[(&str, &str)]) -> Self {
        Self::with_station(&[], changes)
    }

    /// The same, with more arguments for the station.
    pub fn with_station(more: &[&str], changes: &[(&str, &str)]) -> Self {
        Self::with_truth("", more, changes)
    }

    /// The same, with more lines at the end of the truth.
    pub fn with_truth(more_truth: &str, more: &[&str], changes: &[(&str, &str)]) -> Self {
        Self::with_imus(&["imu-a"], more_truth, more, changes)
    }

    /// The same, with these IMUs on the turntable.
    pub fn with_imus(imus: &[&str], more_truth: &str, more: &[&str], changes: &[(&str, &str)]) -> Self {
        let place = Place::take();
        let domain = TestDomain::new();
        // A linear truth, so that a few set points are enough to choose the order.
        let truth: String = TABLE.lines().map(linear).collect();
        let truth = if more_truth.contains("[[gyroscope]]") {
            truth.replacen("format = 1", "format = 2", 1).replacen("[imu]", &format!("[imu]\nserial = {SERIAL:?}"), 1)
        } else {
            truth
        };
        domain.write("truth-table.toml", &(truth + more_truth));
        let served: Vec<_> = imus.iter().map(|imu| format!("{imu}={imu}.toml")).collect();
        let served = served.iter().flat_map(|imu| ["--imu", imu]);
        let service = domain.serve(&["--allow-uncalibrated"].into_iter().chain(served).collect::<Vec<_>>());
        let arguments = [
            "simulate",
            "station",
            "-o",
            "station",
            "--truth",
            "truth-table.toml",
            "--speed",
            SPEED,
            // Less than 1.5 times the plan's limit of 3: a set point that was late on a loaded machine must not end the
            // campaign.
            "--chamber-ramp",
            "3.5",
            "--positioning",
            "0",
        ];
        let interval: &[&str] = if more.contains(&"--interval") { &[] } else { &["--interval", "10"] };
        let on_table: Vec<_> = imus.iter().flat_map(|imu| ["--imu", imu]).collect();
        let station = domain.spawn(&[&arguments, &on_table[..], interval, more].concat());
        let on_terminals = !more.contains(&"--tcp");
        wait_until("the station", || {
            let ports = ["station/chamber", "station/table"];
            domain.path("station/faults").exists()
                && (!on_terminals || ports.iter().all(|port| domain.path(port).exists()))
        });
        let mut plan = fs::read_to_string(domain.path("station/plan.toml")).unwrap();
        for (from, to) in SHORTER_PLAN.iter().chain(changes) {
            assert!(plan.contains(from), "{from}\n{plan}");
            plan = plan.replacen(from, to, 1);
        }
        for imu in imus {
            plan = plan.replace(&format!("install = \"{imu}.toml\""), &format!("install = \"../{imu}.toml\""));
        }
        // The temperature still drifts after such a short soak: without this key its drift is not checked.
        plan = plan
            .lines()
            .filter(|line| !line.starts_with("temperature_per_h"))
            .map(|line| format!("{line}\n"))
            .collect();
        domain.write("station/plan.toml", &plan);
        Self { domain, service, station, _place: place }
    }

    fn arguments<'a>(more: &[&'a str]) -> Vec<&'a str> {
        [&["campaign", "run", "station/plan.toml", "--speed", SPEED], more].concat()
    }

    /// Runs the campaign to its end.
    pub fn run(&self, more: &[&str]) -> Output {
        self.domain.run(&Self::arguments(more))
    }

    /// Starts the campaign.
    pub fn spawn(&self) -> Process {
        self.domain.spawn(&Self::arguments(&[]))
    }

    /// A file of the campaign's folder; empty if it is not there.
    pub fn file(&self, name: &str) -> Vec<u8> {
        fs::read(self.domain.path("station/campaign").join(name)).unwrap_or_default()
    }

    /// The journal's lines with this event; an incomplete last line is left out.
    pub fn events(&self, event: &str) -> Vec<Value> {
        self.journal().into_iter().filter(|line| line["event"] == event).collect()
    }

    /// How many of these events the journal has before the first of the event `other`.
    pub fn events_before(&self, event: &str, other: &str) -> usize {
        let journal = self.journal();
        journal.iter().take_while(|line| line["event"] != other).filter(|line| line["event"] == event).count()
    }

    /// The whole lines of the journal.
    fn journal(&self) -> Vec<Value> {
        let text = text(&self.file("journal.jsonl"));
        let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
        whole.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// The names of the events on the live page, oldest first.
    pub fn events_on_page(&self) -> Vec<String> {
        isotherm_laboratory_bench::events_on_page(&text(&self.file("live.html")))
    }

    /// Waits until the journal has `count` lines with this event, and asserts that the campaign goes on meanwhile.
    pub fn wait_for(&self, event: &str, count: usize) {
        let before = self.events("safe").len();
        wait_long(event, || {
            let safe = self.events("safe");
            assert_eq!(safe.len(), before, "the campaign has ended before {event}: {safe:?}");
            self.events(event).len() >= count
        });
    }

    /// The runner's present phase; empty before its first status.
    pub fn phase(&self) -> String {
        self.place().0
    }

    /// The runner's present phase, and the number of complete units.
    pub fn place(&self) -> (String, u64) {
        let status: Value = serde_json::from_slice(&self.file("status.json")).unwrap_or_default();
        (status["phase"].as_str().unwrap_or_default().to_owned(), status["unit"].as_u64().unwrap_or_default())
    }

    /// Phase, the chamber's set point \[degC\], and outer and inner angle \[deg\], of each complete row of the
    /// readbacks.
    pub fn readbacks(&self) -> Vec<(String, f64, [f64; 2])> {
        let text = text(&self.file("readbacks.csv"));
        let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
        let row = |row: &str| {
            let fields: Vec<_> = row.split(',').collect();
            let [set_point_c, outer, inner] = [4, 6, 7].map(|column: usize| fields[column].parse().unwrap());
            (fields[2].to_owned(), set_point_c, [outer, inner])
        };
        whole.lines().skip(1).map(row).collect()
    }

    /// Sets the faults that the station injects from now on, one a line.
    pub fn faults(&self, lines: &str) {
        self.domain.replace("station/faults", lines);
    }

    /// Asserts that the journal has every unit exactly once, in order, that the file has exactly the bytes of the
    /// dwells and turns, and that every turn is whole.
    pub fn assert_complete(&self, units: usize) {
        assert_units(&self.events("kept"), &text(&self.file("campaign.csv")), units, 6);
    }

    /// Asserts that the last safe state was reached: the chamber is in standby and the turntable is stopped.
    pub fn assert_in_standby(&self) {
        let safe = self.events("safe");
        let last = safe.last().unwrap();
        assert!(last["chamber"].as_str().unwrap().starts_with("chamber in standby"), "{last}");
        assert!(last["table"].as_str().unwrap().starts_with("turntable stopped at"), "{last}");
    }

    /// Fits the complete campaign again, which must end with this exit code. Returns stderr.
    pub fn calibrate(&self, more: &[&str], code: i32) -> String {
        let output = self.run(&[&["--calibrate"], more].concat());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{more:?}\n{}\n{said}", text(&output.stdout));
        said
    }

    /// As [`calibrate`](Self::calibrate), and asserts that nothing is installed: the table in force, its predecessor
    /// and the service are as they were.
    pub fn refused(&self, more: &[&str], code: i32) -> String {
        let state = || {
            let files = ["imu-a.toml", "imu-a.toml.previous"].map(|name| fs::read(self.domain.path(name)).ok());
            (files, self.domain.imu_status()["table"].clone())
        };
        let before = state();
        let said = self.calibrate(more, code);
        assert_eq!(state(), before, "{said}");
        said
    }

    /// What `campaign status` says.
    pub fn status(&self) -> String {
        self.domain.run_ok(&["campaign", "status", "station/plan.toml"])
    }

    /// The same, with another exit code than 0.
    pub fn status_of(&self, code: i32) -> String {
        let output = self.domain.run(&["campaign", "status", "station/plan.toml"]);
        assert_eq!(output.status.code(), Some(code), "{}", text(&output.stderr));
        text(&output.stdout)
    }

    /// Whether a table was installed over another one.
    pub fn has_predecessor(&self) -> bool {
        self.domain.path("imu-a.toml.previous").exists()
    }
}

/// As [`wait_until`], with five times its time limit: a campaign takes long, on a loaded machine even more so.
pub fn wait_long(what: &str, mut condition: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !condition() {
        assert!(begun.elapsed() < 5 * TIMEOUT, "{what} did not happen");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What a command printed that must have succeeded.
pub fn stdout_of_success(output: &Output) -> String {
    assert!(output.status.success(), "{}\n{}\n{}", output.status, text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// Waits for the end of a campaign; whether it succeeded, and its log.
pub fn wait_for_end(runner: Process) -> (bool, String) {
    wait_long("the end", || runner.has_ended());
    let (status, log) = runner.wait();
    (status.success(), log)
}
