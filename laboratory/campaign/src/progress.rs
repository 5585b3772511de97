//! What a runner says of itself: a file for others, bars on a terminal, lines in the log.

use super::timeline::duration;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, IsTerminal as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Its file in the campaign's folder.
pub const STATUS: &str = "status.json";
/// How often the file is written.
const WRITTEN_EVERY: Duration = Duration::from_secs(1);
/// How often the bars are drawn.
const DRAWN_EVERY: Duration = Duration::from_millis(200);
/// How often the log has a line, in laboratory and in real time.
const LOGGED_EVERY_S: f64 = 600.0;
const LOGGED_EVERY: Duration = Duration::from_secs(10);

/// A runner at one moment. Times are the laboratory's.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Snapshot {
    /// Seconds since 1970.
    pub unix_s: f64,
    /// Laboratory time over real time.
    pub speed: f64,
    /// What it does.
    pub phase: String,
    /// Where: set point and position, or verification run.
    pub place: String,
    /// Units that are complete.
    pub unit: usize,
    /// Units in all.
    pub units: usize,
    /// What it waits for.
    pub waits_for: String,
    /// Chamber: target \[degC\]; null when there is none.
    pub target_c: Option<f64>,
    /// Chamber: commanded set point \[degC\]; null until one was.
    pub commanded_c: Option<f64>,
    /// Chamber: air \[degC\]; null until read.
    pub air_c: Option<f64>,
    /// Chamber: rate \[degC/h\]; null until known.
    pub chamber_c_per_h: Option<f64>,
    /// IMU: fastest temperature \[unit/h\]; null until known.
    pub telemetry_per_h: Option<f64>,
    /// Turntable \[deg\]; null until read.
    pub angles_deg: Option<[f64; 2]>,
    /// Requests to the chamber, and to the table, that had to be repeated.
    pub repeated: [u64; 2],
    /// Counted time of the unit in progress \[s\].
    pub collected_s: f64,
    /// What is left \[s\], if nothing happens.
    pub left_s: f64,
    /// Why it pauses; null if it does not.
    pub paused: Option<String>,
    /// The last time that all was well, seconds since 1970.
    pub well_unix_s: f64,
    /// How it ended; null while it runs.
    pub ended: Option<String>,
    /// Whether it ended in the safe state, for certain.
    pub safe: bool,
}

impl Snapshot {
    /// One line for people.
    pub fn line(&self) -> String {
        format!("{} | {} | {} left", self.doing(), self.readings(), self.remaining())
    }

    /// What it does.
    fn doing(&self) -> String {
        let state = self.paused.as_ref().map_or_else(|| self.waits_for.clone(), |cause| format!("PAUSED: {cause}"));
        let colon = if state.is_empty() { "" } else { ": " };
        format!("{} of {} | {} {}{colon}{state}", self.unit, self.units, self.phase, self.place)
    }

    /// What the instruments say.
    fn readings(&self) -> String {
        let or = |value: Option<f64>, digits| value.map_or_else(|| "?".to_owned(), |value| format!("{value:.digits$}"));
        let rate =
            |value: Option<f64>, digits| value.map_or_else(|| "?".to_owned(), |rate| format!("{rate:+.digits$}"));
        let mut text = format!(
            "chamber {} of {} degC, {} degC/h | IMU {} per h | table {} {} deg",
            or(self.air_c, 1),
            or(self.target_c, 1),
            rate(self.chamber_c_per_h, 2),
            rate(self.telemetry_per_h, 4),
            or(self.angles_deg.map(|angles| angles[0]), 3),
            or(self.angles_deg.map(|angles| angles[1]), 3)
        );
        for (count, name) in self.repeated.iter().zip(["chamber", "table"]).filter(|(count, _)| **count > 0) {
            text += &format!(" | {count} requests to the {name} repeated");
        }
        text
    }

    /// What is left, in real time.
    pub fn remaining(&self) -> String {
        duration(self.left_s / self.speed)
    }
}

/// Writes the status file. What cannot be written now is written the next time.
pub fn write(path: &Path, snapshot: &Snapshot) {
    // Renamed, but not forced onto the disk every second: the journal is what lasts.
    let aside = path.with_extension("json.new");
    let write = || {
        fs::write(&aside, serde_json::to_string_pretty(snapshot)?)?;
        fs::rename(&aside, path)
    };
    let result: io::Result<()> = write();
    if let Err(error) = result {
        tracing::warn!("writing {}: {error}", path.display());
    }
}

fn due(last: Option<Instant>, every: Duration) -> bool {
    last.is_none_or(|last| last.elapsed() >= every)
}

/// Tells everybody.
pub struct Progress {
    path: PathBuf,
    /// All units; the one in progress; what the instruments say.
    bars: Option<[ProgressBar; 3]>,
    written: Option<Instant>,
    phase: &'static str,
    drawn: Option<Instant>,
    logged: Option<(Instant, f64)>,
}

impl Progress {
    /// For the campaign in `folder` with so many units.
    pub fn new(folder: &Path, units: usize) -> Self {
        let bars = io::stderr().is_terminal().then(|| {
            let bars = indicatif::MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(5));
            let bar = |length, template: &str| {
                let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
                bars.add(ProgressBar::new(length).with_style(style))
            };
            // A line that is too long for the terminal is cut, not wrapped.
            const BAR: &str = "{bar:20} {wide_msg}";
            [bar(units as u64, BAR), bar(1000, BAR), bar(1000, "{wide_msg}")]
        });
        Self { path: folder.join(STATUS), bars, written: None, phase: "", drawn: None, logged: None }
    }

    /// Something has happened.
    pub fn event(&self, text: &str) {
        match &self.bars {
            Some([bar, ..]) => bar.println(format!("{}  {text}", isotherm_calibration::provenance::now())),
            None => tracing::info!("{text}"),
        }
    }

    /// Whether anybody wants to be told now; `now` is laboratory time \[s\]. Another phase is always told.
    pub fn is_due(&mut self, now: f64, phase: &'static str) -> bool {
        if phase != self.phase {
            (self.phase, self.written) = (phase, None);
        }
        due(self.written, WRITTEN_EVERY) || self.draws() || self.logs(now)
    }

    fn draws(&self) -> bool {
        self.bars.is_some() && due(self.drawn, DRAWN_EVERY)
    }

    fn logs(&self, now: f64) -> bool {
        let due = |(real, at): (Instant, f64)| real.elapsed() >= LOGGED_EVERY && now - at >= LOGGED_EVERY_S;
        self.bars.is_none() && self.logged.is_none_or(due)
    }

    /// The state of the moment at laboratory time `now` \[s\]; `part` is how much of the unit in progress is done.
    pub fn tell(&mut self, now: f64, part: f64, snapshot: &Snapshot) {
        if due(self.written, WRITTEN_EVERY) {
            self.written = Some(Instant::now());
            self.write(snapshot);
        }
        if self.logs(now) {
            self.logged = Some((Instant::now(), now));
            tracing::info!("{}", snapshot.line());
        }
        if let Some([units, unit, readings]) = self.bars.as_ref().filter(|_| self.draws()) {
            units.set_position(snapshot.unit as u64);
            units.set_message(format!("{} of {}, {} left", snapshot.unit, snapshot.units, snapshot.remaining()));
            unit.set_position((part * 1000.0) as u64);
            unit.set_message(snapshot.doing());
            readings.set_message(snapshot.readings());
            self.drawn = Some(Instant::now());
        }
    }

    /// For those who look at it from outside.
    pub fn write(&self, snapshot: &Snapshot) {
        write(&self.path, snapshot);
    }

    /// Takes the bars away.
    pub fn finish(&self) {
        self.bars.iter().flatten().for_each(ProgressBar::finish_and_clear);
    }
}
