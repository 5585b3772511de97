//! A station, a service for its IMU and a plan, in a world of their own.

use isotherm_benches::{Outcome, Partner, World};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Nothing takes longer, or something is broken.
pub const PATIENCE: Duration = Duration::from_secs(600);
/// Between two looks.
const LOOK: Duration = Duration::from_millis(2);

/// What makes the station's plan short.
pub const SHORT: [(&str, &str); 7] = [
    ("ramp_c_per_min = 1\n", "ramp_c_per_min = 3\n"),
    ("time_s = 3600\nstay_s = 4200\nwindow_s = 900", "time_s = 600\nstay_s = 0\nwindow_s = 300"),
    ("time_s = 300", "time_s = 60"),
    ("start_c = -25\nstop_c = 45\nstep_c = 5", "list_c = [20, 23]"),
    ("chamber_c_per_h = 2\n", "chamber_c_per_h = 20\n"),
    // A machine that has other things to do is slow in laboratory time.
    ("[limits]", "[patience]\npause_s = 60000\nstream_s = 30000\nsettle_s = 20000\nstable_s = 60000\n\n[limits]"),
    ("\n[verify]\nruns = 3\nfrom_c = -25\nto_c = 45\nramp_c_per_h = 20\nhold_s = 1800\n", ""),
];

/// All of it; ended and removed when dropped.
pub struct Laboratory {
    _station: Partner,
    _service: Partner,
    /// The world that it is in.
    pub world: World,
    speed: String,
}

impl Laboratory {
    /// At `speed`, with the table's angles off by `positioning` \[arcsec\] and the station's plan changed, `telemetry_per_h` in force or
    /// not.
    pub fn new(speed: u32, positioning: &str, changes: &[(&str, &str)], telemetry: bool) -> Outcome<Self> {
        let world = World::new()?;
        let service = world.spawn(&["serve", "--allow-uncalibrated", "--imu", "imu-a=imu-a.toml"])?;
        let speed = speed.to_string();
        let words = ["simulate", "station", "-o", "station", "--imu", "imu-a", "--speed", &speed, "--interval", "10"];
        let station = world.spawn(&[&words[..], &["--chamber-ramp", "5", "--positioning", positioning]].concat())?;
        let laboratory = Self { _station: station, _service: service, world, speed };
        laboratory.until("the station", || {
            Ok(["chamber", "table", "plan.toml"].iter().all(|name| laboratory.path(name).exists()))
        })?;
        let path = laboratory.path("plan.toml");
        let mut plan = fs::read_to_string(&path)?.replace("install = \"imu-a.toml\"", "install = \"../imu-a.toml\"");
        for (from, to) in changes {
            if !plan.contains(from) {
                return Err(format!("the station's plan has no {from:?}").into());
            }
            plan = plan.replacen(from, to, 1);
        }
        let kept = |line: &&str| telemetry || !line.starts_with("telemetry_per_h");
        fs::write(path, plan.lines().filter(kept).map(|line| format!("{line}\n")).collect::<String>())?;
        Ok(laboratory)
    }

    /// A file of the station.
    pub fn path(&self, name: &str) -> PathBuf {
        self.world.path("station").join(name)
    }

    /// A file of the campaign's folder; empty if it is not there.
    pub fn file(&self, name: &str) -> Vec<u8> {
        fs::read(self.path("campaign").join(name)).unwrap_or_default()
    }

    /// Starts the runner.
    pub fn run(&self, more: &[&str]) -> Outcome<Partner> {
        self.world.spawn(&[&["campaign", "run", "station/plan.toml", "--speed", &self.speed], more].concat())
    }

    /// The journal's whole lines.
    pub fn journal(&self) -> Outcome<Vec<Value>> {
        let text = String::from_utf8(self.file("journal.jsonl"))?;
        let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
        Ok(whole.lines().map(serde_json::from_str).collect::<Result<_, _>>()?)
    }

    /// The journal's lines of an event.
    pub fn events(&self, event: &str) -> Outcome<Vec<Value>> {
        Ok(self.journal()?.into_iter().filter(|line| line["event"] == event).collect())
    }

    /// What the runner does.
    pub fn phase(&self) -> String {
        let status: Value = serde_json::from_slice(&self.file("status.json")).unwrap_or_default();
        status["phase"].as_str().unwrap_or_default().to_owned()
    }

    /// Has these faults from now on.
    pub fn faults(&self, lines: &str) -> Outcome<()> {
        fs::write(self.path("faults.new"), lines)?;
        Ok(fs::rename(self.path("faults.new"), self.path("faults"))?)
    }

    /// Waits.
    pub fn until(&self, what: &str, condition: impl Fn() -> Outcome<bool>) -> Outcome<()> {
        let begun = Instant::now();
        while !condition()? {
            if begun.elapsed() > PATIENCE {
                return Err(format!("{what} did not come to be:\n{}", self.world.log()).into());
            }
            std::thread::sleep(LOOK);
        }
        Ok(())
    }

    /// What is wrong with the units that are kept: each once, in order, with the rows and bytes that it should have.
    pub fn wrong(&self, units: usize, rows: u64) -> Outcome<Option<String>> {
        let kept = self.events("kept")?;
        if kept.len() != units {
            return Ok(Some(format!("{} units instead of {units}", kept.len())));
        }
        let mut end = 0;
        for (number, unit) in kept.iter().enumerate() {
            let dwell = unit["file"] == "campaign.csv";
            if unit["unit"].as_u64() != Some(number as u64) || dwell && unit["from"].as_u64() != Some(end) {
                return Ok(Some(format!("out of order: {unit}")));
            }
            if dwell {
                end = unit["to"].as_u64().unwrap_or_default();
                if unit["rows"].as_u64() != Some(rows) {
                    return Ok(Some(format!("rows: {unit}")));
                }
            }
        }
        let samples = self.file("campaign.csv").len() as u64;
        Ok((samples != end).then(|| format!("{samples} bytes of samples instead of {end}")))
    }
}
