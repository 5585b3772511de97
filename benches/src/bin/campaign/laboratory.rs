//! A station, a service for its IMU and a plan, in a domain of their own.

use isotherm_benches::{BenchDomain, BenchProcess, BenchResult};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

/// Longest wait; after it the bench fails.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(600);
/// Pause between two polls.
const POLL_PAUSE: Duration = Duration::from_millis(2);

/// Replacements that make the station's plan short.
pub(crate) const SHORT: [(&str, &str); 7] = [
    ("ramp_c_per_min = 1\n", "ramp_c_per_min = 3\n"),
    ("time_s = 3600\nstay_s = 4200\nwindow_s = 900", "time_s = 600\nstay_s = 0\nwindow_s = 300"),
    ("time_s = 300", "time_s = 60"),
    ("start_c = -25\nstop_c = 45\nstep_c = 5", "list_c = [20, 23]"),
    ("chamber_c_per_h = 2\n", "chamber_c_per_h = 20\n"),
    // Waits are long in laboratory time, because the machine may be busy with other work.
    ("[limits]", "[patience]\npause_s = 60000\nstream_s = 30000\nsettle_s = 20000\nstable_s = 60000\n\n[limits]"),
    (
        "\n[verify]\nruns = 2\nattitudes_deg = [[50, 130], [230, 130]]\nfrom_c = -25\nto_c = 45\nramp_c_per_h = 20\nhold_s = 1800\n",
        "",
    ),
];

/// Station, service and plan. Dropping it ends the processes and removes the files.
pub(crate) struct BenchLaboratory {
    _station: BenchProcess,
    _service: BenchProcess,
    /// The domain of station and service.
    pub domain: BenchDomain,
    speed: String,
}

impl BenchLaboratory {
    /// Starts station and service at `speed`. The turntable's angles are off by `positioning` \[arcsec\]. `changes` are
    /// made in the station's plan; without `telemetry` its rule `temperature_per_h` is removed, too.
    pub(crate) fn new(speed: u32, positioning: &str, changes: &[(&str, &str)], telemetry: bool) -> BenchResult<Self> {
        let domain = BenchDomain::new()?;
        let service = domain.spawn(&["serve", "--allow-uncalibrated", "--imu", "imu-a=imu-a.toml"])?;
        let speed = speed.to_string();
        let words = ["simulate", "station", "-o", "station", "--imu", "imu-a", "--gyroscopes", "--speed", &speed];
        let station = domain.spawn(&[&words[..], &["--chamber-ramp", "5", "--positioning", positioning]].concat())?;
        let laboratory = Self { _station: station, _service: service, domain, speed };
        laboratory.wait_until("the station", || {
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
        let kept = |line: &&str| telemetry || !line.starts_with("temperature_per_h");
        fs::write(path, plan.lines().filter(kept).map(|line| format!("{line}\n")).collect::<String>())?;
        Ok(laboratory)
    }

    /// A file of the station.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.domain.path("station").join(name)
    }

    /// A file of the campaign's folder; empty if it is not there.
    pub(crate) fn file(&self, name: &str) -> Vec<u8> {
        fs::read(self.path("campaign").join(name)).unwrap_or_default()
    }

    /// Starts the runner.
    pub(crate) fn run(&self, more: &[&str]) -> BenchResult<BenchProcess> {
        self.domain.spawn(&[&["campaign", "run", "station/plan.toml", "--speed", &self.speed], more].concat())
    }

    /// The complete lines of the journal.
    pub(crate) fn journal(&self) -> BenchResult<Vec<Value>> {
        let text = String::from_utf8(self.file("journal.jsonl"))?;
        let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
        Ok(whole.lines().map(serde_json::from_str).collect::<Result<_, _>>()?)
    }

    /// The lines of the journal for an event.
    pub(crate) fn events(&self, event: &str) -> BenchResult<Vec<Value>> {
        Ok(self.journal()?.into_iter().filter(|line| line["event"] == event).collect())
    }

    /// The current phase of the runner.
    pub(crate) fn phase(&self) -> String {
        let status: Value = serde_json::from_slice(&self.file("status.json")).unwrap_or_default();
        status["phase"].as_str().unwrap_or_default().to_owned()
    }

    /// Sets the faults that the station injects from now on.
    pub(crate) fn set_faults(&self, lines: &str) -> BenchResult<()> {
        fs::write(self.path("faults.new"), lines)?;
        Ok(fs::rename(self.path("faults.new"), self.path("faults"))?)
    }

    /// Waits until `condition` holds. `what` names it in the error.
    pub(crate) fn wait_until(&self, what: &str, condition: impl Fn() -> BenchResult<bool>) -> BenchResult<()> {
        self.domain.wait_until(&format!("{what} did not come to be"), [TIMEOUT, POLL_PAUSE], condition)
    }

    /// Checks that each unit was kept once, in order, with its bytes, and a dwell with `rows` rows. Returns what is
    /// wrong.
    pub(crate) fn wrong(&self, units: usize, rows: u64) -> BenchResult<Option<String>> {
        let kept = self.events("kept")?;
        if kept.len() != units {
            return Ok(Some(format!("{} units instead of {units}", kept.len())));
        }
        let mut end = 0;
        for (number, unit) in kept.iter().enumerate() {
            let run = unit["file"] != "campaign.csv";
            if unit["unit"].as_u64() != Some(number as u64) || !run && unit["from"].as_u64() != Some(end) {
                return Ok(Some(format!("out of order: {unit}")));
            }
            if !run {
                end = unit["to"].as_u64().unwrap_or_default();
            }
            if !run && unit["turn"].is_null() && unit["rows"].as_u64() != Some(rows) {
                return Ok(Some(format!("rows: {unit}")));
            }
        }
        let samples = self.file("campaign.csv").len() as u64;
        Ok((samples != end).then(|| format!("{samples} bytes of samples instead of {end}")))
    }
}
