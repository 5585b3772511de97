//! The live page: state, curves and events of the campaign in one HTML file that a browser reloads by itself. The clock
//! is UTC, as in the log.

use super::control::snapshot;
use super::curves::PlottedCurves;
use super::events::{PageEvent, PageEvents};
use super::journal::{self, JOURNAL};
use super::plan::Plan;
use super::progress::{DroppedImu, Snapshot};
use super::readbacks::Readbacks;

use isotherm_report::{Cell, NoteKind, Page, Plot, Style};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_support::failure::Failure;
use std::time::{Duration, UNIX_EPOCH};
use std::{fs, io};

/// The page's file in the campaign's folder.
const PAGE: &str = "live.html";
/// Period at which the page is written, and reloaded by a browser \[s\].
pub(crate) const PERIOD_S: u32 = 10;
/// Length of the additional figures of the latest curves \[h\].
const RECENT_H: f64 = 3.0;
/// Largest number of events that are listed and marked: the latest ones.
const MAX_EVENTS: usize = 200;
/// Possible distances between two ticks of the clock \[s\]; from a day on they are whole days.
const CLOCK_STEPS_S: [u32; 17] =
    [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 10_800, 21_600, 43_200];
/// Length of a day \[s\].
const DAY_S: f64 = 86_400.0;

/// The name of a curve in the legend, and its number in [`PlottedCurves`].
type NamedCurve = (&'static str, usize);

/// The points of a curve of an IMU: Unix time \[s\] and value.
type Points<'a> = &'a dyn Fn(&PlottedCurves, usize) -> Vec<(f64, f64)>;

const CHAMBER: [NamedCurve; 2] = [("air", 0), ("set point", 1)];
const HEADS: [NamedCurve; 3] = [(AXIS_NAMES[0], 2), (AXIS_NAMES[1], 3), (AXIS_NAMES[2], 4)];
const BOARDS: [NamedCurve; 3] = [(AXIS_NAMES[0], 5), (AXIS_NAMES[1], 6), (AXIS_NAMES[2], 7)];

/// The page of a running campaign. It reads what is new in the journal.
#[derive(Default)]
pub(crate) struct LivePage {
    events: PageEvents,
    /// So much of the journal is read \[bytes\].
    read: u64,
}

impl LivePage {
    /// Replaces the page. `curves` are those of each IMU, in the order of the plan.
    ///
    /// # Errors
    /// If the operating system cannot write it, or the journal cannot be read.
    pub(crate) fn write(&mut self, plan: &Plan, snapshot: &Snapshot, curves: &[&PlottedCurves]) -> io::Result<()> {
        let staged = plan.output.join("live.html.new");
        // The journal has a line for each unit and each event, of earlier runners and of `campaign stop` too.
        let new = journal::read_since(&plan.output.join(JOURNAL), self.read);
        let (lines, read) = new.map_err(io::Error::other)?;
        lines.iter().for_each(|line| self.events.add(plan, line));
        self.read = read;
        fs::write(&staged, html(plan, snapshot, curves, self.events.all()))?;
        fs::rename(staged, plan.output.join(PAGE))
    }
}

/// Replaces the page after the runner's end: with the state that it has left, and the curves of all readings.
///
/// # Errors
/// As [`LivePage::write`]. Without a state there is no page.
pub(crate) fn rewrite(plan: &Plan) -> Result<(), Failure> {
    let Some(snapshot) = snapshot(&plan.output)? else { return Ok(()) };
    let readbacks = plan.each().iter().map(Readbacks::open).collect::<Result<Vec<_>, _>>()?;
    let curves: Vec<_> = readbacks.iter().map(Readbacks::curves).collect();
    let failed = |error: io::Error| Failure::io("writing", &plan.output.join(PAGE), &error);
    LivePage::default().write(plan, &snapshot, &curves).map_err(failed)
}

fn html(plan: &Plan, snapshot: &Snapshot, curves: &[&PlottedCurves], events: &[PageEvent]) -> String {
    let written = utc(snapshot.unix_s);
    let kinds = match (plan.turns.is_empty(), plan.ramps.is_empty()) {
        (true, true) => "dwells and runs",
        (false, true) => "dwells, turns and runs",
        (true, false) => "dwells, ramps and runs",
        (false, false) => "dwells, turns, ramps and runs",
    };
    let subtitle =
        format!("{} of {} {kinds} · {} left · {written}", snapshot.unit, snapshot.units, snapshot.remaining());
    let mut page = Page::new(&format!("Campaign of {}", plan.names()), &subtitle);
    match (&snapshot.ended, &snapshot.paused) {
        (Some(ended), _) => {
            let kind = if snapshot.unit == snapshot.units { NoteKind::Good } else { NoteKind::Warning };
            page.note(kind, "Ended", &ended.replace('\n', "; "));
        }
        (None, Some(cause)) => page.note(NoteKind::Warning, "Paused", cause),
        (None, None) => page.note(NoteKind::Good, "Running", &snapshot.line()),
    }
    for DroppedImu { imu, reason } in &snapshot.dropped {
        page.note(NoteKind::Bad, "Dropped", &format!("{imu} {}", reason.replace('\n', "; ")));
    }
    if snapshot.ended.is_none() {
        page.reload_every(PERIOD_S);
    }
    // The readings of the chamber are the same of every IMU.
    let [begin_s, end_s] = curves.iter().find_map(|curves| curves.span_s()).unwrap_or([f64::NAN; 2]);
    let hours = |unix_s: f64| (unix_s - begin_s) * snapshot.speed / 3600.0;
    // The latest events with their numbers. One before the first reading is listed, but has no place in the curves.
    let numbered: Vec<_> = (1..).zip(events).skip(events.len().saturating_sub(MAX_EVENTS)).collect();
    let marks_since = |since_s: f64| numbered.iter().filter(move |(_, event)| event.marked && event.unix_s >= since_s);
    let figures = |since_s: f64, points: Points<'_>| {
        let draw = |curves: &PlottedCurves, title: &str, label: &str, named: &[NamedCurve]| {
            let clock = clock_ticks([since_s, end_s]).into_iter().map(|(unix_s, label)| (hours(unix_s), label));
            let plot = Plot::new(title, "Time / h", label).upper_axis("UTC", clock);
            let mark =
                |plot: Plot, (number, event): &(u32, &PageEvent)| plot.marker(hours(event.unix_s), &number.to_string());
            let plot = marks_since(since_s).fold(plot, mark);
            let plot = named.iter().fold(plot, |plot, (name, curve)| {
                let points = broken(points(curves, *curve), events);
                plot.series(name, Style::Line, points.into_iter().map(|(unix_s, value)| (hours(unix_s), value)))
            });
            (plot.svg(), String::new())
        };
        let label = format!("Temperature / {}", plan.campaign.temperature_unit);
        let chamber = curves.iter().take(1).map(|curves| draw(curves, "Chamber", "Temperature / degC", &CHAMBER));
        let of_imu = |(plan, curves): (&Plan, &&PlottedCurves)| {
            let imu = plan.member.as_ref().map_or_else(String::new, |member| format!(" of {}", member.imu));
            let [heads, boards] = ["Heads", "Boards"].map(|title| format!("{title}{imu}"));
            [draw(curves, &heads, &label, &HEADS), draw(curves, &boards, &label, &BOARDS)]
        };
        chamber.chain(plan.each().iter().zip(curves).flat_map(of_imu)).collect::<Vec<_>>()
    };
    if hours(end_s) > RECENT_H {
        let since_s = end_s - RECENT_H * 3600.0 / snapshot.speed;
        page.heading(2, "recent", &format!("The last {RECENT_H} hours"));
        page.figures(&figures(since_s, &|curves, curve| curves.recent(curve, since_s).collect()));
    }
    page.heading(2, "all", "All of it");
    page.figures(&figures(begin_s, &|curves, curve| curves.all(curve).collect()));
    page.heading(2, "events", "Events");
    page.paragraph(
        "The latest first. The numbers are those of the vertical marks in the figures; what follows the readings has no mark.",
    );
    let row = |(number, event): &(u32, &PageEvent)| {
        vec![
            Cell::Number(number.to_string()),
            Cell::Number(utc(event.unix_s)),
            Cell::Verdict(event.kind, event.name.to_owned()),
            Cell::text(event.text.clone()),
            Cell::number(hours(event.unix_s), 2),
        ]
    };
    let rows: Vec<_> = numbered.iter().rev().map(row).collect();
    let more = events.len() - numbered.len();
    let caption = if more > 0 { format!("; {more} earlier ones are in {JOURNAL}") } else { String::new() };
    let caption = format!("{} events{caption}", rows.len());
    page.table(&caption, &["No.", "Clock / UTC", "Event", "Where and why", "Time / h"], &rows);
    page.finish()
}

/// The points of a line, with a break where nothing was read: at every start and pause.
fn broken(mut points: Vec<(f64, f64)>, events: &[PageEvent]) -> Vec<(f64, f64)> {
    points.extend(events.iter().filter(|event| event.interrupts).map(|event| (event.unix_s, f64::NAN)));
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// A Unix time \[s\], RFC 3339 in UTC, to the second.
pub(crate) fn utc(unix_s: f64) -> String {
    // The cast turns NaN and negative times into 0; the last time that RFC 3339 can write is in the year 9999.
    let seconds = (unix_s as u64).min(253_402_300_799);
    humantime::format_rfc3339_seconds(UNIX_EPOCH + Duration::from_secs(seconds)).to_string()
}

/// Round times of the clock in a span of Unix time \[s\], with their labels: three or four over days, otherwise up to
/// seven.
fn clock_ticks([begin_s, end_s]: [f64; 2]) -> Vec<(f64, String)> {
    let span_s = end_s - begin_s;
    if !(span_s > 0.0 && span_s < 1e10 && begin_s > 0.0) {
        return Vec::new();
    }
    let dated = span_s > 0.8 * DAY_S;
    // Long labels need more room.
    let limit = match span_s {
        _ if dated => 3.0,
        240.0.. => 6.0,
        _ => 4.0,
    };
    let steps = CLOCK_STEPS_S.into_iter().map(f64::from);
    let step_s = steps.into_iter().find(|step_s| span_s / step_s <= limit);
    let step_s = step_s.unwrap_or_else(|| (span_s / limit / DAY_S).ceil() * DAY_S);
    let label = |unix_s: f64| {
        let text = utc(unix_s); // 2026-11-22T06:00:00Z
        if dated {
            format!("{} {}", &text[5..10], &text[11..16])
        } else {
            text[11..if step_s < 60.0 { 19 } else { 16 }].to_owned()
        }
    };
    let first = (begin_s / step_s).ceil() as u64;
    (first..)
        .map(|n| n as f64 * step_s)
        .take_while(|&unix_s| unix_s <= end_s)
        .map(|unix_s| (unix_s, label(unix_s)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::curves::{CURVES, CurveRow};
    use super::*;
    use std::path::Path;

    fn labels(span_s: [f64; 2]) -> Vec<String> {
        clock_ticks(span_s).into_iter().map(|tick| tick.1).collect()
    }

    #[test]
    fn the_clock_has_round_times_in_any_span() {
        let day = 1_795_305_600.0; // 2026-11-22T00:00:00Z
        assert_eq!(utc(day), "2026-11-22T00:00:00Z");
        assert_eq!(labels([day + 7.0, day + 29.0]), ["00:00:10", "00:00:20"]);
        assert_eq!(labels([day + 3540.0, day + 3.2 * 3600.0]), ["01:00", "01:30", "02:00", "02:30", "03:00"]);
        assert_eq!(labels([day + 100.0, day + 2.0 * DAY_S]), ["11-23 00:00", "11-24 00:00"]);
        assert_eq!(labels([day, day + 1.2 * DAY_S]), ["11-22 00:00", "11-22 12:00", "11-23 00:00"]);
        for span_s in [0.5, 3.0, 61.0, 1e3, 1e4, 5e4, 69_000.0, 70_000.0, 1e5, 1e6, 1e8] {
            let ticks = clock_ticks([day + 0.3, day + 0.3 + span_s]);
            assert!(ticks.len() <= 7 && (span_s < 2.0 || !ticks.is_empty()), "{span_s}: {ticks:?}");
            assert!(ticks.iter().all(|tick| (day..=day + 0.3 + span_s).contains(&tick.0)), "{span_s}: {ticks:?}");
        }
        for bad in [[f64::NAN, 1.0], [0.0, 0.0], [2.0, 1.0], [1.0, f64::INFINITY], [f64::NEG_INFINITY, 1.0]] {
            assert_eq!(clock_ticks(bad), []);
        }
        assert_eq!([f64::NAN, -5.0, 1e300].map(utc)[2], "9999-12-31T23:59:59Z");
    }

    fn page(rows: u32, events: &[PageEvent]) -> String {
        let plan = Plan::from_toml(include_str!("../../../examples/plan.toml"), Path::new("/")).unwrap();
        let mut curves = PlottedCurves::default();
        for row in 0..rows {
            curves.add(CurveRow { unix_s: 1_795_305_600.0 + 60.0 * f64::from(row), values: [20.0; CURVES] });
        }
        let snapshot = Snapshot { unix_s: 1_795_309_200.0, speed: 1.0, ..Snapshot::default() };
        html(&plan, &snapshot, &[&curves], events)
    }

    fn event(minute: u32, text: &str) -> PageEvent {
        let unix_s = 1_795_305_600.0 + 60.0 * f64::from(minute);
        PageEvent {
            unix_s,
            kind: NoteKind::Warning,
            name: "pause",
            text: text.to_owned(),
            interrupts: true,
            marked: true,
        }
    }

    #[test]
    fn events_are_marked_in_every_figure_and_listed_with_the_clock() {
        let page = page(60, &[event(10, "first <cause>"), event(30, "second")]);
        assert_eq!(page.matches("class=\"mark\"").count(), 3 * 2, "three figures");
        assert_eq!(page.matches(">UTC</text>").count(), 3);
        let at = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text}: {page}"));
        assert!(at("2026-11-22T00:30:00Z") < at("2026-11-22T00:10:00Z"), "the latest first");
        assert!(page.contains("first &lt;cause&gt;") && page.contains("<td class=\"number\">0.50</td>"));
        assert!(page.contains("2026-11-22T01:00:00Z"), "when it was written");
        let air = page.split("<path class=\"l d s1\" d=\"").nth(1).unwrap().split('"').next().unwrap();
        assert_eq!(air.matches('M').count(), 3, "the line breaks at both pauses: {air}");
        assert!(page.contains("air (60 points)"), "a break is no point");
    }

    #[test]
    fn the_page_stays_bounded_with_any_number_of_events_and_without_curves() {
        let many: Vec<_> = (0..5000).map(|minute| event(minute, "again")).collect();
        let page_of_many = page(10, &many);
        assert!(page_of_many.len() < 200_000, "{}", page_of_many.len());
        assert!(page_of_many.contains("200 events; 4800 earlier ones are in journal.jsonl"));
        assert!(!page(0, &many).contains("class=\"mark\""), "no curves, no marks");
        assert!(page(0, &[]).contains("no data"));
    }
}
