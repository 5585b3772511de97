//! The layout of the whole screen.

use super::model::Model;
use super::numbers::age;
use super::style::AlertLevel;
use super::{details, overview};
use humantime::format_rfc3339_seconds;
use isotherm_client::service_pid;
use isotherm_service::StatusWait;
use isotherm_shared::status::WorkerStatus;
use isotherm_support::failure::printable;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph, Wrap};
use std::time::SystemTime;

const HELP: &str = "\
q Esc Ctrl-C   quit
up down j k    select an IMU; Tab, PgUp, PgDn, Home, End
p space        pause: the screen is frozen
? h            this help

T [%]     temperature within the calibrated range, coldest to warmest sensor; 0 and 100 are its ends
miss      raw samples that never came
flag/s    flags on the increments per second
latency   from sending a sample to just before publishing its increment
histogram of the last minute at most, logarithmic; what is over the budget stands out

isotherm status prints the same once, --json for scripts";

/// Draws everything.
pub(super) fn draw(frame: &mut Frame<'_>, model: &mut Model) {
    let area = frame.area();
    let [top, middle, bottom] =
        Layout::vertical([Constraint::Length(1), Constraint::Min(0), Constraint::Length(1)]).areas(area);
    frame.render_widget(header(model, top.width), top);
    frame.render_widget(keys(model), bottom);
    let middle = match &model.waiting {
        Some(waiting) => {
            let text = banner(model, waiting);
            let lines = text.len().div_ceil(usize::from(area.width.max(1))) as u16;
            let [above, below] = Layout::vertical([Constraint::Length(lines), Constraint::Min(0)]).areas(middle);
            let style = model.theme.level(AlertLevel::Bad);
            frame.render_widget(Paragraph::new(text).style(style).wrap(Wrap { trim: true }), above);
            below
        }
        None => middle,
    };
    let needed = model.imu().map_or(0, details::lines);
    let imus = model.status().map_or(0, |status| status.imus.len()) as u16;
    // The details of the selected IMU get the lines that they need. The table gets the rest, at least its heading and
    // one line.
    let rows = imus.min(middle.height.saturating_sub(needed + 1)).max(1);
    let [table, rest] = Layout::vertical([Constraint::Length(rows + 1), Constraint::Min(0)]).areas(middle);
    if imus > 0 {
        overview::draw(frame, table, model);
        details::draw(frame, rest, model);
    }
    if model.help {
        help(frame, area);
    }
    // The status is the text of another process. ratatui leaves control characters out, but not those of the direction
    // of writing.
    for cell in &mut frame.buffer_mut().content {
        if printable(cell.symbol()) != cell.symbol() {
            cell.set_symbol("?");
        }
    }
}

fn header(model: &Model, width: u16) -> Line<'static> {
    let worker = |worker: &WorkerStatus| {
        let held_ms = worker.held_back_ms;
        let held = if held_ms >= 1.0 { format!(", held {held_ms:.0} ms") } else { String::new() };
        format!("{:.0} %{held}", worker.cpu_percent)
    };
    let text = match model.status() {
        None => format!(" Isotherm, domain {}", model.domain),
        Some(status) => format!(
            " Isotherm {}  {}  {}  up {}  {}  cpu {}",
            status.version,
            status.domain.name,
            service_pid(status),
            age(status.uptime_s),
            status.wait,
            status.workers.iter().map(worker).collect::<Vec<_>>().join(" | ")
        ),
    };
    Line::styled(format!("{text:width$}", width = width.into()), model.theme.inverse())
}

fn banner(model: &Model, waiting: &StatusWait) -> String {
    // Only the time of day, for example 12:34:56 of 2026-03-01T12:34:56Z.
    let since = format_rfc3339_seconds(SystemTime::now() - waiting.time).to_string();
    let what = if model.status().is_some() { "; below is its last status" } else { "" };
    let clock = since.get(11..19).unwrap_or_default();
    format!("waiting for the service since {clock} UTC, {}{what}: {}", age(waiting.time.as_secs_f64()), waiting.cause)
}

fn keys(model: &Model) -> Line<'static> {
    let key = |key: &'static str| Span::styled(key, model.theme.inverse());
    let mut spans = vec![key("q"), " quit  ".into(), key("up down"), " IMU  ".into()];
    spans.extend([
        key("p"),
        if model.paused { " go on  ".into() } else { " pause  ".into() },
        key("?"),
        " help".into(),
    ]);
    if model.paused {
        spans.push("  ".into());
        spans.push(Span::styled("PAUSED", model.theme.level(AlertLevel::Warning)));
    }
    Line::from(spans)
}

fn help(frame: &mut Frame<'_>, area: Rect) {
    let wanted = Rect::new(0, 0, 78, HELP.lines().count() as u16 + 4);
    let inside = Rect::new(
        area.width.saturating_sub(wanted.width) / 2,
        area.height.saturating_sub(wanted.height) / 2,
        wanted.width.min(area.width),
        wanted.height.min(area.height),
    );
    frame.render_widget(Clear, inside);
    // No border if the text does not fit with it.
    let block = if inside.height < wanted.height { Block::new() } else { Block::bordered().title(" Keys ") };
    frame.render_widget(Paragraph::new(HELP).wrap(Wrap { trim: false }).block(block), inside);
}
