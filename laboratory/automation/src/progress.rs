//! The state that a runner shows: a status file for other processes, bars on a terminal, lines in a log.

use super::stamp::UpTime;
use super::timeline::duration;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use isotherm_instruments::{Moment, Time};
use isotherm_support::failure::{printable, shown};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, IsTerminal as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// The status file in the campaign's folder.
pub const STATUS: &str = "status.json";
/// Period of the status file.
const FILE_PERIOD: Duration = Duration::from_secs(1);
/// Period of the bars.
const BARS_PERIOD: Duration = Duration::from_millis(200);
/// Shortest time between two log lines with the state, laboratory time \[s\].
const LOG_PERIOD_S: f64 = 600.0;
/// Shortest time between two log lines with the state, real time.
const LOG_PERIOD: Duration = Duration::from_secs(10);

/// An IMU of a batch that is dropped.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct DroppedImu {
    /// Its name.
    pub imu: String,
    /// Where, and why.
    pub reason: String,
}

/// The state of a campaign at one moment. Durations are laboratory time.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Snapshot {
    /// Unix time \[s\].
    pub unix_s: f64,
    /// Ratio of laboratory time to real time.
    pub speed: f64,
    /// The machine's phase.
    pub phase: String,
    /// Name of the unit in progress: set point and position, ramp or verification run.
    pub place: String,
    /// Number of complete units.
    pub unit: usize,
    /// Number of all units.
    pub units: usize,
    /// What the machine waits for.
    pub waits_for: String,
    /// Chamber: set point of the unit in progress, in a ramp or a verification run that of the end it goes to \[degC\];
    /// null when all are complete.
    pub target_c: Option<f64>,
    /// Chamber: commanded set point \[degC\]; null before the first command.
    pub commanded_c: Option<f64>,
    /// Chamber: air \[degC\]; null before the first reading.
    pub air_c: Option<f64>,
    /// Chamber: rate of change of the air \[degC/h\]; null until its window is full.
    pub chamber_c_per_h: Option<f64>,
    /// IMU: rate of change of the fastest temperature \[unit/h\]; null until all windows are full.
    #[serde(rename = "telemetry_per_h")]
    pub temperature_per_h: Option<f64>,
    /// Turntable: outer and inner angle \[deg\]; null before the first reading.
    pub angles_deg: Option<[f64; 2]>,
    /// Repeated requests to the chamber, and to the turntable.
    pub repeated: [u64; 2],
    /// Counted time of the unit in progress \[s\].
    pub collected_s: f64,
    /// Estimated time until the campaign is complete, without interruptions \[s\].
    pub left_s: f64,
    /// Cause of the pause; null outside a pause.
    pub paused: Option<String>,
    /// The last time that all was well, Unix time \[s\].
    pub well_unix_s: f64,
    /// The same by the clock that only rises; `None` on a system that does not name its starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub well_up: Option<UpTime>,
    /// How the runner ended; null while it runs.
    pub ended: Option<String>,
    /// Whether the runner ended in a confirmed safe state.
    pub safe: bool,
    /// The IMUs of a batch that are dropped; not there if none is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<DroppedImu>,
}

impl Snapshot {
    /// The state in one line of text.
    pub fn line(&self) -> String {
        format!("{} | {} | {} left", self.state(), self.readings(), self.remaining())
    }

    /// Progress, phase and unit as text.
    fn state(&self) -> String {
        let state = self.paused.as_ref().map_or_else(|| self.waits_for.clone(), |cause| format!("PAUSED: {cause}"));
        let colon = if state.is_empty() { "" } else { ": " };
        format!("{} of {} | {} {}{colon}{state}", self.unit, self.units, self.phase, self.place)
    }

    /// Readings of the instruments as text.
    fn readings(&self) -> String {
        let number =
            |value: Option<f64>, digits| value.map_or_else(|| "?".to_owned(), |value| format!("{value:.digits$}"));
        let rate =
            |value: Option<f64>, digits| value.map_or_else(|| "?".to_owned(), |rate| format!("{rate:+.digits$}"));
        // After the last unit no set point is aimed at.
        let target = self.target_c.map_or_else(String::new, |target| format!(" of {target:.1}"));
        let mut text = format!(
            "chamber {}{target} degC, {} degC/h | IMU {} per h | turntable {} {} deg",
            number(self.air_c, 1),
            rate(self.chamber_c_per_h, 2),
            rate(self.temperature_per_h, 4),
            number(self.angles_deg.map(|angles| angles[0]), 3),
            number(self.angles_deg.map(|angles| angles[1]), 3)
        );
        for (count, name) in self.repeated.iter().zip(["chamber", "turntable"]).filter(|(count, _)| **count > 0) {
            text += &format!(" | {count} requests to the {name} repeated");
        }
        if !self.dropped.is_empty() {
            let imus: Vec<_> = self.dropped.iter().map(|dropped| dropped.imu.as_str()).collect();
            text += &format!(" | dropped: {}", imus.join(", "));
        }
        text
    }

    /// Estimated real time until the campaign is complete, as text.
    pub fn remaining(&self) -> String {
        duration(self.left_s / self.speed)
    }
}

/// Writes the status file. A failure is only logged, because the file is soon written again.
pub fn write(path: &Path, snapshot: &Snapshot) {
    // Renamed, but not synced: the journal is the durable record.
    let staged = path.with_extension("json.new");
    let write = || {
        fs::write(&staged, serde_json::to_string_pretty(snapshot)?)?;
        fs::rename(&staged, path)
    };
    let result: io::Result<()> = write();
    if let Err(error) = result {
        tracing::warn!("writing {}: {error}", shown(path));
    }
}

/// Publishes the state of the campaign: status file, and bars on a terminal or lines in the log.
pub struct CampaignProgress {
    path: PathBuf,
    time: Arc<dyn Time>,
    /// On a terminal: all units, the unit in progress, and the readings.
    bars: Option<[ProgressBar; 3]>,
    written: Option<Moment>,
    /// How often the status file is written.
    period: Duration,
    phase: &'static str,
    drawn: Option<Moment>,
    logged: Option<(Moment, f64)>,
}

impl CampaignProgress {
    /// For the campaign in `folder` with this number of units.
    pub fn new(folder: &Path, units: usize, time: Arc<dyn Time>) -> Self {
        let bars = io::stderr().is_terminal().then(|| {
            let bars = indicatif::MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(5));
            let bar = |length, template: &str| {
                let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
                bars.add(ProgressBar::new(length).with_style(style))
            };
            // `wide_msg` truncates a line that is too long for the terminal.
            const BAR: &str = "{bar:20} {wide_msg}";
            [bar(units as u64, BAR), bar(1000, BAR), bar(1000, "{wide_msg}")]
        });
        Self {
            path: folder.join(STATUS),
            time,
            bars,
            written: None,
            period: FILE_PERIOD,
            phase: "",
            drawn: None,
            logged: None,
        }
    }

    /// Writes the status file this often.
    #[must_use]
    pub fn with_period(self, period: Duration) -> Self {
        Self { period, ..self }
    }

    /// Prints an event above the bars, or into the log.
    pub fn event(&self, text: &str) {
        match &self.bars {
            Some([bar, ..]) => bar.println(format!("{}  {}", isotherm_pipeline::now(), printable(text))),
            None => tracing::info!("{text}"),
        }
    }

    /// Whether the status file, the bars or the log are due at laboratory time `now` \[s\]. A change of phase makes the
    /// file due.
    pub fn is_due(&mut self, now: f64, phase: &'static str) -> bool {
        if phase != self.phase {
            (self.phase, self.written) = (phase, None);
        }
        self.is_past(self.written, self.period) || self.bars_due() || self.log_due(now)
    }

    fn is_past(&self, last: Option<Moment>, period: Duration) -> bool {
        last.is_none_or(|last| self.time.now().since(last) >= period)
    }

    fn bars_due(&self) -> bool {
        self.bars.is_some() && self.is_past(self.drawn, BARS_PERIOD)
    }

    fn log_due(&self, now: f64) -> bool {
        let due = |(real, at): (Moment, f64)| self.is_past(Some(real), LOG_PERIOD) && now - at >= LOG_PERIOD_S;
        self.bars.is_none() && self.logged.is_none_or(due)
    }

    /// Updates what is due with the state at laboratory time `now` \[s\]. `fraction` of the unit in progress is done, 0
    /// to 1.
    pub fn update(&mut self, now: f64, fraction: f64, snapshot: &Snapshot) {
        if self.is_past(self.written, self.period) {
            self.written = Some(self.time.now());
            self.write(snapshot);
        }
        if self.log_due(now) {
            self.logged = Some((self.time.now(), now));
            tracing::info!("{}", snapshot.line());
        }
        if let Some([units, unit, readings]) = self.bars.as_ref().filter(|_| self.bars_due()) {
            units.set_position(snapshot.unit as u64);
            units.set_message(format!("{} of {}, {} left", snapshot.unit, snapshot.units, snapshot.remaining()));
            unit.set_position((fraction * 1000.0) as u64);
            unit.set_message(printable(&snapshot.state()).into_owned());
            readings.set_message(printable(&snapshot.readings()).into_owned());
            self.drawn = Some(self.time.now());
        }
    }

    /// Writes the status file now.
    pub fn write(&self, snapshot: &Snapshot) {
        write(&self.path, snapshot);
    }

    /// Removes the bars from the terminal.
    pub fn finish(&self) {
        self.bars.iter().flatten().for_each(ProgressBar::finish_and_clear);
    }
}
