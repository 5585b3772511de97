//! The table of all IMUs, one line for each.

use super::model::{Model, RangeTemperature};
use super::numbers::{microseconds, whole};
use isotherm_shared::status::ImuStatus;
use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Cell, Row, Table};

/// Below this width only the most important columns are shown.
const WIDE: u16 = 70;

/// Draws the table, with the selected IMU in view.
pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, model: &mut Model) {
    let wide = area.width >= WIDE;
    let names: &[(&str, u16)] = if wide {
        &[("1/s", 6), ("p50 us", 7), ("p99.9 us", 8), ("T [%]", 8), ("miss", 7), ("flag/s", 7), ("state", 14)]
    } else {
        &[("1/s", 6), ("p99.9", 6), ("state", 14)]
    };
    let last = names.len() - 1;
    let head = names.iter().enumerate().map(|(index, (name, _))| {
        Cell::from(Line::from(*name).alignment(if index == last { Alignment::Left } else { Alignment::Right }))
    });
    let head = Row::new([Cell::from("IMU")].into_iter().chain(head)).style(model.theme.heading());
    let widths = [Constraint::Fill(1)].into_iter().chain(names.iter().map(|(_, width)| Constraint::Length(*width)));
    let imus = model.status().map_or(&[][..], |status| &status.imus);
    let rows: Vec<_> = imus.iter().enumerate().map(|(index, imu)| row(model, index, imu, wide)).collect();
    let table = Table::new(rows, widths).header(head).row_highlight_style(model.theme.inverse());
    frame.render_stateful_widget(table, area, &mut model.table);
}

fn row(model: &Model, index: usize, imu: &ImuStatus, wide: bool) -> Row<'static> {
    let rate = |count: fn(&ImuStatus) -> u64| whole(model.rate(index, count));
    let state = model.condition(index, imu);
    let latency = imu.latency_second_ns.filter(|_| model.waiting.is_none());
    let p999 = microseconds(latency.map(|latency| latency.p999));
    let mut cells = vec![rate(|imu| imu.received)];
    if wide {
        cells.push(microseconds(latency.map(|latency| latency.p50)));
        cells.push(p999);
        cells.push(span(imu));
        cells.push(imu.missing.to_string());
        cells.push(rate(|imu| imu.flagged.values().sum()));
    } else {
        cells.push(p999);
    }
    let cells = cells.into_iter().map(|text| Cell::from(Line::from(text).alignment(Alignment::Right)));
    let state = Cell::from(Span::styled(state.text, model.theme.level(state.level)));
    Row::new([Cell::from(imu.id.clone())].into_iter().chain(cells).chain([state]))
}

/// The positions of the coldest and the warmest sensor within their ranges \[%\].
fn span(imu: &ImuStatus) -> String {
    let parts: Vec<_> =
        RangeTemperature::all_of(imu).filter_map(RangeTemperature::fraction).map(|part| 100.0 * part).collect();
    let low = parts.iter().copied().reduce(f64::min);
    let high = parts.iter().copied().reduce(f64::max);
    match low.zip(high) {
        // More than three digits do not fit, and mean nothing more.
        Some((low, high)) => format!("{:.0}..{:.0}", low.clamp(-999.0, 999.0), high.clamp(-999.0, 999.0)),
        None => "-".to_owned(),
    }
}
