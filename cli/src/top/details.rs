//! The selected IMU: its table, samples, temperatures, latency and flags.

use super::model::{Model, RangeTemperature};
use super::numbers::{age, microseconds, whole};
use super::style::{AlertLevel, Theme};
use isotherm_client::unix_s;
use isotherm_shared::status::{ImuStatus, LATENCY_BOUNDS_NS};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Sparkline, SparklineBar, Wrap};

/// Lines of the histogram, at least.
const HISTOGRAM: u16 = 3;
/// Columns of the latency figures.
const LATENCY_COLUMNS: u16 = 42;

/// Lines that [`draw`] needs.
pub(super) fn lines(imu: &ImuStatus) -> u16 {
    3 + 1 + triads(imu).count() as u16 * AXES as u16 + 2 + HISTOGRAM + 1
}

/// The triads that an IMU has.
fn triads(imu: &ImuStatus) -> impl Iterator<Item = SensorKind> {
    let gyroscopes = imu.gyroscopes.as_ref().map(|_| SensorKind::Gyroscope);
    [SensorKind::Accelerometer].into_iter().chain(gyroscopes)
}

/// Draws all details. Lines that are left over make the histogram higher.
pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, model: &Model) {
    let Some(imu) = model.imu() else { return };
    let theme = model.theme;
    let alerts = alert_lines(theme, imu).len() as u16;
    let histogram = HISTOGRAM + area.height.saturating_sub(lines(imu) + alerts + 2).min(8);
    let temperatures = 1 + triads(imu).count() as u16 * AXES as u16;
    let parts = [3 + alerts, temperatures, 2 + histogram].map(Constraint::Length);
    let parts = parts.into_iter().chain([Constraint::Min(0)]);
    let [about, temperatures, latency, flags] = Layout::vertical(parts).areas(area);
    frame.render_widget(Paragraph::new(about_lines(model, imu, about.width)), about);
    frame.render_widget(Paragraph::new(temperature_lines(theme, imu, temperatures.width)), temperatures);
    draw_latency(frame, latency, model, imu);
    frame.render_widget(Paragraph::new(flag_line(model, imu)).wrap(Wrap { trim: true }), flags);
}

fn about_lines(model: &Model, imu: &ImuStatus, width: u16) -> Vec<Line<'static>> {
    let theme = model.theme;
    let rule = theme.rule().repeat(2);
    let digest = imu.table.as_deref().map_or("no table", short);
    let title = format!("{rule} {} {rule} {digest} {rule} ", imu.id);
    let room = usize::from(width).saturating_sub(title.chars().count());
    let file = end_of(&imu.table_file, room);
    let title = format!("{title}{file} {}", theme.rule().repeat(room.saturating_sub(file.chars().count() + 1)));
    let now = unix_s();
    let since = |unix_s: Option<f64>| unix_s.map_or("-".to_owned(), |then| age(now - then));
    let table = match &imu.table {
        Some(_) => format!(
            "taken {} ago, file of {} ago; {} reloads, {} refused",
            since(imu.table_taken_unix_s),
            since(imu.table_modified_unix_s),
            imu.reloads,
            imu.refusals
        ),
        None if imu.waits_for_table => "waits for its first table: increments are NaN until it is there".to_owned(),
        None => "none: increments are NaN until the file is there".to_owned(),
    };
    let acquisition = if imu.acquisition_connected { "acquisition" } else { "NO acquisition" };
    let samples = format!(
        "{}, {} missing in {} gaps, {} repeated; {acquisition}, {} readers",
        imu.received, imu.missing, imu.gaps, imu.repeats, imu.readers
    );
    let mut lines = vec![Line::styled(title, theme.heading()), labelled(theme, "table", table)];
    lines.extend(alert_lines(theme, imu));
    lines.push(labelled(theme, "samples", samples));
    lines
}

/// Lines that say why the table file as it is now is not in force, and that the samples are of another device, or have
/// another lag, than the table.
fn alert_lines(theme: Theme, imu: &ImuStatus) -> Vec<Line<'static>> {
    let refused = imu.last_reload_error.as_ref().filter(|_| !imu.waits_for_table).map(|error| {
        let since = imu.refused_unix_s.map_or(String::new(), |then| format!(" {} ago", age(unix_s() - then)));
        format!("REFUSED{since}: {}", error.replace('\n', "; "))
    });
    let other = imu.other_device.as_ref().map(|device| {
        let serial = imu.serial.as_deref().unwrap_or_default();
        format!("OTHER DEVICE: samples of {device}, table of serial {serial:?}")
    });
    let other_lag = imu.other_lag().zip(imu.lag_s);
    let other_lag = other_lag.map(|(other, lag_s)| format!("OTHER LAG: samples {other}, table {lag_s} s"));
    refused
        .into_iter()
        .chain(other)
        .chain(other_lag)
        .map(|text| Line::styled(text, theme.level(AlertLevel::Bad)))
        .collect()
}

fn labelled(theme: Theme, label: &str, text: String) -> Line<'static> {
    Line::from(vec![Span::styled(format!("{label:<10}"), theme.label()), Span::raw(text)])
}

fn temperature_lines(theme: Theme, imu: &ImuStatus, width: u16) -> Vec<Line<'static>> {
    let unit = imu.ranges.as_ref().map_or(String::new(), |ranges| format!(" [{}]", ranges.unit));
    let half = usize::from(width.saturating_sub(4)) / 2;
    let lag = imu.lag_s.map_or(String::new(), |lag| format!(", lag {lag} s"));
    let head = format!("{:<4}{:<half$}{}", "", format!("head{unit}{lag}"), format_args!("board{unit}"));
    let mut lines = vec![Line::styled(head, theme.label())];
    let sensors = triads(imu).flat_map(|triad| (0..AXES).map(move |axis| (triad, axis)));
    for (triad, axis) in sensors {
        let mut spans = vec![Span::styled(format!("{:<4}", triad.names()[axis]), theme.label())];
        for place in RangeTemperature::of(imu, triad, axis) {
            spans.extend(gauge(theme, place, half.saturating_sub(2)));
            spans.push(Span::raw("  "));
        }
        lines.push(Line::from(spans));
    }
    lines
}

/// A value, and a bar with its position between the ends of its range. Outside the range the marker is an arrow.
fn gauge(theme: Theme, place: RangeTemperature, width: usize) -> Vec<Span<'static>> {
    let style = theme.level(place.level());
    let value = place.value.map_or("none".to_owned(), significant);
    let value = Span::styled(format!("{value:>8}"), style);
    let Some(range) = place.range else {
        return vec![value, Span::raw(format!("{:<1$}", "  no table", width.saturating_sub(8)))];
    };
    let [low, high] = range.map(significant);
    let bar = width.saturating_sub(8 + 1 + low.len() + 1 + 1 + high.len()).max(3);
    let (line, marker) = theme.gauge();
    let mut cells = vec![line; bar];
    let (marker, at) = match place.fraction() {
        Some(part) if part < 0.0 => ('<', Some(0)),
        Some(part) if part > 1.0 => ('>', Some(bar - 1)),
        part => (marker, part.map(|part| (part * (bar - 1) as f64).round() as usize)),
    };
    let at = at.unwrap_or(bar);
    cells.insert(at, marker);
    let [before, after] =
        [&cells[..at], cells.get(at + 2..).unwrap_or_default()].map(|cells| cells.iter().collect::<String>());
    let marker = if at == bar { String::new() } else { marker.to_string() };
    vec![
        value,
        Span::raw(format!(" {low}|{before}")),
        Span::styled(marker, style),
        Span::raw(format!("{after}|{high}")),
    ]
}

fn draw_latency(frame: &mut Frame<'_>, area: Rect, model: &Model, imu: &ImuStatus) {
    let theme = model.theme;
    let [figures, picture] = Layout::horizontal([Constraint::Length(LATENCY_COLUMNS), Constraint::Min(0)]).areas(area);
    draw_distribution(frame, picture, model);
    let budget = model.status().map_or(0.0, |status| status.budget_us);
    let head = format!("{:<10}{:>7}{:>8}{:>8}{:>8}", "latency us", "p50", "p99", "p99.9", "max");
    let mut lines = vec![Line::styled(head, theme.label())];
    let latencies = [("second", imu.latency_second_ns), ("minute", imu.latency_minute_ns), ("all", imu.latency_ns)];
    for (name, latency) in latencies {
        let text = match latency {
            Some(latency) => {
                let [p50, p99, p999, max] =
                    [latency.p50, latency.p99, latency.p999, latency.max].map(|ns| microseconds(Some(ns)));
                format!("  {name:<8}{p50:>7}{p99:>8}{p999:>8}{max:>8}")
            }
            None => format!("  {name:<8}no samples"),
        };
        lines.push(Line::raw(text));
    }
    let late = imu.flagged.get("late").copied().unwrap_or(0);
    lines.push(Line::raw(format!("  budget {budget} us, {late} were late")));
    frame.render_widget(Paragraph::new(lines), figures);
}

/// Draws the histogram of the latency.
fn draw_distribution(frame: &mut Frame<'_>, picture: Rect, model: &Model) {
    let theme = model.theme;
    let [head, bars, axis] =
        Layout::vertical([Constraint::Length(1), Constraint::Min(0), Constraint::Length(1)]).areas(picture);
    let (counts, seconds) = model.distribution();
    let columns = (picture.width / (LATENCY_BOUNDS_NS.len() as u16 + 1)).clamp(1, 3);
    let budget_ns = model.status().map_or(0.0, |status| status.budget_us) * 1e3;
    let bar = |(index, count): (usize, &u64)| {
        let over = LATENCY_BOUNDS_NS.get(index).is_none_or(|bound| *bound as f64 > budget_ns);
        let height = if *count > 0 { (100.0 * (1.0 + libm::log10(*count as f64))) as u64 } else { 0 };
        let style = if over { theme.level(AlertLevel::Warning) } else { theme.curve() };
        vec![SparklineBar::from(height).style(Some(style)); columns.into()]
    };
    let data: Vec<_> = counts.iter().enumerate().flat_map(bar).collect();
    frame.render_widget(Line::styled(format!("the last {seconds:.0} s, logarithmic"), theme.label()), head);
    frame.render_widget(Sparkline::default().data(data).bar_set(theme.bars()), bars);
    let step = usize::from(columns) * 6;
    let label = format!("{:<4$}{:<step$}{:<step$}{:<step$}1s", "", "1us", "100us", "10ms", usize::from(columns) * 2);
    frame.render_widget(Line::styled(label, theme.label()), axis);
}

/// The flags that have been raised, with counts and rates. Those that are being raised now come first.
fn flag_line(model: &Model, imu: &ImuStatus) -> Line<'static> {
    let theme = model.theme;
    let rate = |name: &str| model.rate(model.selected(), |imu| imu.flagged.get(name).copied().unwrap_or(0));
    let mut raised: Vec<_> = imu.flagged.iter().filter(|(_, count)| **count > 0).collect();
    raised.sort_by_key(|(name, _)| rate(name).is_none_or(|rate| rate == 0.0));
    let mut spans = vec![Span::styled("flags     ", theme.label())];
    if raised.is_empty() {
        spans.push("none".into());
    }
    for (index, (name, count)) in raised.into_iter().enumerate() {
        let now = rate(name);
        let comes = now.is_some_and(|rate| rate > 0.0);
        let text = if comes { format!("{name} {count} ({}/s)", whole(now)) } else { format!("{name} {count}") };
        spans.push(if index == 0 { "".into() } else { ", ".into() });
        spans.push(if comes { Span::styled(text, theme.level(AlertLevel::Warning)) } else { text.into() });
    }
    Line::from(spans)
}

/// The part of a digest that increments carry: its first 16 hexadecimal digits.
fn short(digest: &str) -> &str {
    let digits = digest.strip_prefix("sha256:").unwrap_or(digest);
    digits.get(..16).unwrap_or(digits)
}

/// A path, or only its end if it has more than `room` characters.
fn end_of(path: &str, room: usize) -> String {
    let over = path.chars().count().saturating_sub(room);
    if over == 0 { path.to_owned() } else { format!("..{}", path.chars().skip(over + 2).collect::<String>()) }
}

/// A value with about five significant digits.
fn significant(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if !(1e-3..1e5).contains(&size) => format!("{value:.1e}"),
        size if size < 10.0 => format!("{value:.4}"),
        size if size < 100.0 => format!("{value:.3}"),
        _ => format!("{value:.1}"),
    }
}
