//! The live page: state and curves of the campaign in one HTML file that a browser reloads by itself.

use super::curves::PlottedCurves;
use super::plan::Plan;
use super::progress::Snapshot;

use isotherm_calibration::report::page::{NoteKind, Page};
use isotherm_calibration::report::plot::{Plot, Style};
use isotherm_shared::table::AXIS_NAMES;
use std::fs;
use std::io;

/// The page's file in the campaign's folder.
const PAGE: &str = "live.html";
/// Period at which the page is written, and reloaded by a browser \[s\].
pub const PERIOD_S: u32 = 10;
/// Length of the additional figures of the latest curves \[h\].
const RECENT_H: f64 = 3.0;

/// The name of a curve in the legend, and its number in [`PlottedCurves`].
type NamedCurve = (&'static str, usize);

const CHAMBER: [NamedCurve; 2] = [("air", 0), ("set point", 1)];
const HEADS: [NamedCurve; 3] = [(AXIS_NAMES[0], 2), (AXIS_NAMES[1], 3), (AXIS_NAMES[2], 4)];
const BOARDS: [NamedCurve; 3] = [(AXIS_NAMES[0], 5), (AXIS_NAMES[1], 6), (AXIS_NAMES[2], 7)];

/// Replaces the page.
///
/// # Errors
/// If the operating system cannot write it.
pub fn write(plan: &Plan, snapshot: &Snapshot, curves: &PlottedCurves) -> io::Result<()> {
    let staged = plan.output.join("live.html.new");
    fs::write(&staged, html(plan, snapshot, curves))?;
    fs::rename(staged, plan.output.join(PAGE))
}

fn html(plan: &Plan, snapshot: &Snapshot, curves: &PlottedCurves) -> String {
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
        page.reload_every(PERIOD_S);
    }
    let [begin_s, end_s] = curves.span_s().unwrap_or_default();
    let hours = |unix_s: f64| (unix_s - begin_s) * snapshot.speed / 3600.0;
    let figures = |points: &dyn Fn(usize) -> Vec<(f64, f64)>| {
        let draw = |title: &str, label: &str, named: &[NamedCurve]| {
            let plot = Plot::new(title, "Time / h", label);
            let plot = named.iter().fold(plot, |plot, (name, curve)| {
                plot.series(name, Style::Line, points(*curve).into_iter().map(|(unix_s, value)| (hours(unix_s), value)))
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
    if hours(end_s) > RECENT_H {
        let since_s = end_s - RECENT_H * 3600.0 / snapshot.speed;
        page.heading(2, "recent", &format!("The last {RECENT_H} hours"));
        page.figures(&figures(&|curve| curves.recent(curve, since_s).collect()));
    }
    page.heading(2, "all", "All of it");
    page.figures(&figures(&|curve| curves.all(curve).collect()));
    page.finish()
}
