//! The live page: the campaign so far as curves, in one file that a browser loads again by itself.

use super::plan::Plan;
use super::progress::Snapshot;
use super::readbacks::READBACKS;
use isotherm_calibration::report::page::{NoteKind, Page};
use isotherm_calibration::report::plot::{Plot, Style};
use isotherm_shared::table::AXIS_NAMES;
use std::fs;
use std::io;

/// Its file in the campaign's folder.
const PAGE: &str = "live.html";
/// How often a browser loads it again \[s\].
pub const EVERY_S: u32 = 10;
/// The curves of the last while are drawn once more \[h\].
const RECENT_H: f64 = 3.0;

/// A name and what it is in a row of the readbacks.
type Curve = (&'static str, &'static str);

const CHAMBER: [Curve; 2] = [("air", "chamber_air_c"), ("set point", "chamber_set_point_c")];
const HEADS: [Curve; 3] = [(AXIS_NAMES[0], "a1_head"), (AXIS_NAMES[1], "a2_head"), (AXIS_NAMES[2], "a3_head")];
const BOARDS: [Curve; 3] = [(AXIS_NAMES[0], "a1_board"), (AXIS_NAMES[1], "a2_board"), (AXIS_NAMES[2], "a3_board")];

/// Writes the page anew, from the readbacks.
///
/// # Errors
/// As the operating system gives them.
pub fn write(plan: &Plan, snapshot: &Snapshot) -> io::Result<()> {
    let readbacks = fs::read_to_string(plan.output.join(READBACKS))?;
    let aside = plan.output.join("live.html.new");
    fs::write(&aside, html(plan, snapshot, &readbacks))?;
    fs::rename(aside, plan.output.join(PAGE))
}

fn html(plan: &Plan, snapshot: &Snapshot, readbacks: &str) -> String {
    let subtitle = format!("{} of {} dwells and runs · {} left", snapshot.unit, snapshot.units, snapshot.remaining());
    let mut page = Page::new(&format!("Campaign of {}", plan.imu), &subtitle);
    match (&snapshot.ended, &snapshot.paused) {
        (Some(ended), _) => {
            let kind = if snapshot.unit == snapshot.units { NoteKind::Good } else { NoteKind::Warning };
            page.note(kind, "Ended", &ended.replace('\n', "; "));
        }
        (None, Some(cause)) => page.note(NoteKind::Warning, "Paused", cause),
        (None, None) => page.note(NoteKind::Good, "Running", &snapshot.line()),
    }
    if snapshot.ended.is_none() {
        page.reload_every(EVERY_S);
    }
    let rows = Rows::new(readbacks, snapshot.speed);
    let figures = |since_h: f64| {
        let draw = |title: &str, label: &str, curves: &[Curve]| {
            let plot = Plot::new(title, "Time / h", label);
            let plot = curves.iter().fold(plot, |plot, (name, column)| {
                plot.series(name, Style::Line, rows.curve(column).filter(|point| point.0 >= since_h))
            });
            (plot.svg(), String::new())
        };
        let unit = &plan.campaign.temperature_unit;
        [
            draw("Chamber", "Temperature / degC", &CHAMBER),
            draw("Heads", &format!("Telemetry / {unit}"), &HEADS),
            draw("Boards", &format!("Telemetry / {unit}"), &BOARDS),
        ]
    };
    let end_h = rows.end_h();
    if end_h > RECENT_H {
        page.heading(2, "recent", &format!("The last {RECENT_H} hours"));
        page.figures(&figures(end_h - RECENT_H));
    }
    page.heading(2, "all", "All of it");
    page.figures(&figures(f64::NEG_INFINITY));
    page.finish()
}

/// The readbacks as columns over time.
struct Rows<'t> {
    names: Vec<&'t str>,
    rows: Vec<Vec<&'t str>>,
    /// Laboratory time over real time.
    speed: f64,
}

impl<'t> Rows<'t> {
    fn new(text: &'t str, speed: f64) -> Self {
        let mut lines = text.lines().map(|line| line.split(',').collect());
        Self { names: lines.next().unwrap_or_default(), rows: lines.collect(), speed }
    }

    /// Hours since the first row, and the value; without a value where there is none.
    fn curve(&self, name: &str) -> impl Iterator<Item = (f64, f64)> {
        let column = |name: &str| self.names.iter().position(|other| *other == name).unwrap_or(usize::MAX);
        let number =
            |row: &[&str], column: usize| row.get(column).and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN);
        let (time, value) = (column("unix_s"), column(name));
        let begin = self.rows.first().map_or(f64::NAN, |row| number(row, time));
        let hours = move |row: &[&str]| (number(row, time) - begin) * self.speed / 3600.0;
        self.rows.iter().map(move |row| (hours(row), number(row, value)))
    }

    fn end_h(&self) -> f64 {
        self.curve("unix_s").last().map_or(0.0, |last| last.0)
    }
}
