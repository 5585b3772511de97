//! One x-y figure as inline SVG.
//!
//! Colours, line widths and fonts come from the stylesheet of the [`page`](super::page) by class, so a figure follows
//! its palette. The SVG itself contains only geometry and text, and no identifier that could occur twice on a page.
//! Series differ by colour, by the shape of their points and, unless they are dense, by their dashes.
//!
//! Over 400 lines: one figure, from its parts to the drawing.

use maud::{Markup, PreEscaped, html};
use std::collections::BTreeSet;

use super::axis::{PlotAxis, second_scale, usable};
use super::quantity::printed;
use super::svg::{Svg, cut, path, shape, short, text_width};
use super::thin::{MAX_VERTICES, extremes, scatter, segments};

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// A line through the points in the given order.
    Line,
    /// Single points.
    Points,
    /// A line with its points.
    Both,
}

/// A figure with its series and markers.
///
/// Values that are NaN, infinite or beyond 1e100 are skipped and break a line. A series of more than 1500 points is
/// thinned: every column of the figure keeps its smallest and its largest value, so extremes stay visible while the
/// size of the figure stays bounded.
///
/// ```
/// use isotherm_report::{Plot, Style};
///
/// let points = [(1.0, 0.2), (2.0, f64::NAN), (3.0, -0.1)];
/// let plot = Plot::new("Residual", "Temperature / V", "Residual / ug0").series("A1", Style::Points,
/// points).zero_line();
/// assert!(plot.svg().into_string().contains("Residual / µg"));
/// ```
#[derive(Clone, Debug)]
pub struct Plot {
    title: String,
    x_label: String,
    y_label: String,
    series: Vec<PlotSeries>,
    markers: Vec<(f64, String)>,
    upper: Option<UpperAxis>,
    /// Values that the range of y includes in addition to those of the series.
    also_y: Vec<f64>,
    zero: bool,
    /// Whether all coordinates are decimal logarithms.
    logarithmic: bool,
}

#[derive(Clone, Debug)]
struct PlotSeries {
    name: String,
    style: Style,
    points: Vec<(f64, f64)>,
    /// Half the length of the error bar of each point; shorter than `points` if the last ones have none.
    errors: Vec<f64>,
    /// x, lower and upper edge.
    band: Vec<(f64, f64, f64)>,
}

/// A second scale of x.
#[derive(Clone, Debug)]
struct UpperAxis {
    label: String,
    /// Where the ticks are on the lower axis, and their labels.
    ticks: Vec<(f64, String)>,
}

/// Sizes in the drawing's own units; the page scales the drawing to the available width.
const WIDTH: f64 = 400.0;
const RIGHT: f64 = WIDTH - 16.0;
const PLOT_HEIGHT: f64 = 196.0;
const LINE_HEIGHT: f64 = 17.0;
/// Number of series colours in the stylesheet.
const COLOURS: usize = 6;
/// Half the width of a point in a short series, and in the legend.
const POINT: f64 = 3.2;
/// Largest number of rows of marker labels.
const MARKER_ROWS: usize = 3;
/// Half the width of the ends of an error bar.
const CAP: f64 = 3.0;

impl Plot {
    /// A figure without series. Labels are quantity and unit, e.g. "Bias / 1e-6 g0"; a text that is too long is cut.
    #[must_use]
    pub fn new(title: &str, x_label: &str, y_label: &str) -> Self {
        let [title, x_label, y_label] = [title, x_label, y_label].map(printed);
        Self {
            title,
            x_label,
            y_label,
            series: Vec::new(),
            markers: Vec::new(),
            upper: None,
            also_y: Vec::new(),
            zero: false,
            logarithmic: false,
        }
    }

    /// Adds a series of (x, y). The legend appears with the second one.
    #[must_use]
    pub fn series(mut self, name: &str, style: Style, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let points = points.into_iter().collect();
        self.series.push(PlotSeries { name: printed(name), style, points, errors: Vec::new(), band: Vec::new() });
        self
    }

    /// Gives each point of the last series an error bar of this half length. A point whose half length is NaN has none.
    /// Without a series it does nothing.
    #[must_use]
    pub fn errors(mut self, half_lengths: impl IntoIterator<Item = f64>) -> Self {
        if let Some(series) = self.series.last_mut() {
            series.errors = half_lengths.into_iter().collect();
        }
        self
    }

    /// Shades the band of (x, lower, upper) in the colour of the last series. Without a series it does nothing.
    #[must_use]
    pub fn band(mut self, rows: impl IntoIterator<Item = (f64, f64, f64)>) -> Self {
        if let Some(series) = self.series.last_mut() {
            series.band = rows.into_iter().collect();
        }
        self
    }

    /// Draws a line at y = 0 and extends the range of y to include it.
    #[must_use]
    pub fn zero_line(mut self) -> Self {
        self.zero = true;
        self
    }

    /// Extends the range of y to include these values: figures with the same ones, whose own values are among them,
    /// have one scale.
    #[must_use]
    pub fn include_y(mut self, values: impl IntoIterator<Item = f64>) -> Self {
        self.also_y.extend(values);
        self
    }

    /// Puts both axes on logarithmic scales. Call it after everything else. Values that are not over 0 are skipped;
    /// error bars are not drawn.
    #[must_use]
    pub fn logarithmic(mut self) -> Self {
        let log = |value: f64| if value > 0.0 { libm::log10(value) } else { f64::NAN };
        for series in &mut self.series {
            series.points.iter_mut().for_each(|(x, y)| (*x, *y) = (log(*x), log(*y)));
            series.band.iter_mut().for_each(|row| *row = (log(row.0), log(row.1), log(row.2)));
            series.errors.clear();
        }
        self.markers.iter_mut().for_each(|(x, _)| *x = log(*x));
        self.markers.retain(|(x, _)| usable(*x));
        self.also_y.iter_mut().for_each(|y| *y = log(*y));
        self.logarithmic = true;
        self
    }

    /// Draws a vertical line at x, with a label above the plot area, and extends the range of x to include it.
    #[must_use]
    pub fn marker(mut self, x: f64, label: &str) -> Self {
        if usable(x) {
            self.markers.push((x, printed(label)));
            self.markers.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        self
    }

    /// Adds a second scale of x above the plot area, by pairs of x and the value there on the second scale, with ticks
    /// at round values. Without at least two pairs, or if they do not rise or fall all along x, it does nothing.
    #[must_use]
    pub fn second_scale(self, label: &str, pairs: impl IntoIterator<Item = (f64, f64)>) -> Self {
        self.upper_axis(label, second_scale(pairs))
    }

    /// Adds an axis above the plot area: the x of each tick, and its label. A tick outside the range of x is omitted,
    /// and so is a label that would overlap the one before.
    #[must_use]
    pub fn upper_axis(mut self, label: &str, ticks: impl IntoIterator<Item = (f64, String)>) -> Self {
        let mut ticks: Vec<_> = ticks.into_iter().filter(|tick| usable(tick.0)).collect();
        ticks.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.upper = (!ticks.is_empty()).then(|| UpperAxis { label: printed(label), ticks });
        self
    }

    /// The figure as SVG for [`Page::figure`](super::page::Page::figure).
    #[must_use]
    pub fn svg(&self) -> Markup {
        let frame = self.frame();
        let mut out = Svg(String::new());
        self.titles(&mut out, &frame);
        self.axes(&mut out, &frame);
        self.markers(&mut out, &frame);
        for (index, series) in self.series.iter().enumerate() {
            out.band(index, &series.band, &frame);
        }
        for (index, series) in self.series.iter().enumerate() {
            out.series(index, series, &frame);
        }
        if self.points().next().is_none() && self.bands().next().is_none() {
            out.text("a m", frame.middle(), f64::midpoint(frame.top, frame.bottom), "no data", "");
        }
        let height = self.legend(&mut out, frame.bottom + 42.0);
        let summary = format!("{}: {} over {}", self.title, self.y_label, self.x_label);
        let names: Vec<_> = self.series.iter().map(|s| format!("{} ({} points)", s.name, s.drawn().count())).collect();
        html! {
            svg.plot viewBox={ "0 0 " (WIDTH) " " (short(height)) } role="img" aria-label=(summary) {
                title { (self.title) }
                desc { "Series: " (names.join(", ")) }
                (PreEscaped(out.0))
            }
        }
    }

    /// The points that can be drawn.
    fn points(&self) -> impl Iterator<Item = &(f64, f64)> {
        self.series.iter().flat_map(PlotSeries::drawn)
    }

    /// The rows of bands that can be drawn.
    fn bands(&self) -> impl Iterator<Item = &(f64, f64, f64)> {
        self.series.iter().flat_map(|series| series.band.iter().filter(|row| complete(row)))
    }

    /// The axes over all that is drawn, and where the plot area is.
    fn frame(&self) -> Frame {
        let xs = self.points().map(|p| p.0).chain(self.bands().map(|r| r.0)).chain(self.markers.iter().map(|m| m.0));
        let ys = self.points().map(|p| p.1).chain(self.bands().flat_map(|r| [r.1, r.2]));
        let bars = self.series.iter().flat_map(PlotSeries::bars).flat_map(|(_, low, high)| [low, high]);
        let ys = ys.chain(self.zero.then_some(0.0)).chain(bars).chain(self.also_y.iter().copied());
        let (x_axis, y_axis) = if self.logarithmic {
            (PlotAxis::decades(xs), PlotAxis::decades(ys))
        } else {
            (PlotAxis::new(xs, 0.03, 6), PlotAxis::new(ys, 0.06, 8))
        };
        let left = 10.0 + y_axis.ticks.iter().map(|(_, label)| text_width(label)).fold(22.0, f64::max);
        let mut frame = Frame { x_axis, y_axis, left, upper: 48.0, top: 0.0, bottom: 0.0 };
        let rows = self.marker_labels(|value| frame.x(value)).iter().map(|label| label.0 + 1).max().unwrap_or(0);
        frame.upper += if self.upper.is_some() { LINE_HEIGHT } else { 0.0 };
        let gap = if self.upper.is_some() && rows > 0 { 6.0 } else { 0.0 };
        frame.top = frame.upper + gap + rows as f64 * LINE_HEIGHT;
        frame.bottom = frame.top + PLOT_HEIGHT;
        frame
    }

    /// The title, and the labels above the plot area.
    fn titles(&self, out: &mut Svg, frame: &Frame) {
        out.text("t", 2.0, 16.0, &cut(&self.title, WIDTH * 0.92), "");
        let (note, upper_label) = (&frame.y_axis.note, self.upper.as_ref().map_or("", |axis| &axis.label));
        let upper_label = cut(upper_label, WIDTH / 3.0);
        let room = RIGHT - text_width(note) - text_width(&upper_label) - 8.0;
        out.text("a", 2.0, 37.0, &cut(&self.y_label, room), note);
        out.text("a e", RIGHT, 37.0, &upper_label, "");
    }

    /// Grid, frame, ticks with their labels, the label of x and the line at 0.
    fn axes(&self, out: &mut Svg, frame: &Frame) {
        let Frame { x_axis, y_axis, left, upper, top, bottom } = frame;
        let [left_edge, upper_edge, top_edge, bottom_edge] = [*left, *upper, *top, *bottom].map(short);
        let (mut grid, mut lines) = (String::new(), String::new());
        for (value, label) in &y_axis.ticks {
            let y = frame.y(*value);
            grid += &format!("M{left_edge} {}H{RIGHT}", short(y));
            out.text("k e", left - 6.0, y + 4.5, label, "");
        }
        for (value, label) in &x_axis.ticks {
            let (at, x) = (frame.x(*value), short(frame.x(*value)));
            grid += &format!("M{x} {top_edge}V{bottom_edge}");
            lines += &format!("M{x} {bottom_edge}v4");
            out.text("k m", at, bottom + 17.0, label, "");
        }
        if self.upper.is_some() {
            lines += &format!("M{left_edge} {upper_edge}H{RIGHT}");
        }
        for (at, label) in self.upper_ticks(frame) {
            lines += &format!("M{} {upper_edge}v-4", short(at));
            out.text("k m", at, upper - 7.0, label, "");
        }
        out.path("grid", &grid);
        out.path("frame", &format!("{lines}M{left_edge} {top_edge}V{bottom_edge}H{RIGHT}"));
        let label = cut(&self.x_label, WIDTH - 24.0 - text_width(&x_axis.note));
        out.text("a m", frame.middle(), bottom + 35.0, &label, &x_axis.note);
        if self.zero {
            out.path("zero", &format!("M{left_edge} {}H{RIGHT}", short(frame.y(0.0))));
        }
    }

    fn markers(&self, out: &mut Svg, frame: &Frame) {
        for (value, _) in &self.markers {
            let (x, top, bottom) = (short(frame.x(*value)), short(frame.top - 4.0), short(frame.bottom));
            out.path("mark", &format!("M{x} {top}V{bottom}"));
        }
        for (row, at, label) in self.marker_labels(|value| frame.x(value)) {
            out.text("g m", at, frame.top - 8.0 - row as f64 * LINE_HEIGHT, &label, "");
        }
    }

    /// Position and label of the ticks of the upper axis.
    fn upper_ticks(&self, frame: &Frame) -> Vec<(f64, &str)> {
        let (mut end, mut ticks) = (f64::NEG_INFINITY, Vec::new());
        for (value, label) in self.upper.iter().flat_map(|axis| &axis.ticks) {
            let (at, half) = (frame.x(*value), text_width(label) / 2.0);
            if (frame.left..=RIGHT).contains(&at) && at + half <= WIDTH && at - half >= end {
                end = at + half + 6.0;
                ticks.push((at, label.as_str()));
            }
        }
        ticks
    }

    /// Row, centre and text of the marker labels. Labels of one row do not overlap; a label that fits into no row is
    /// omitted.
    fn marker_labels(&self, x: impl Fn(f64) -> f64) -> Vec<(usize, f64, String)> {
        let mut ends = [0.0; MARKER_ROWS];
        let mut labels = Vec::new();
        for (value, label) in self.markers.iter().filter(|marker| !marker.1.is_empty()) {
            let label = cut(label, WIDTH / 3.0);
            let half = text_width(&label) / 2.0;
            let centre = x(*value).max(half).min(WIDTH - half);
            if let Some(row) = ends.iter().position(|&end| centre - half >= end) {
                ends[row] = centre + half + 8.0;
                labels.push((row, centre, label));
            }
        }
        labels
    }

    /// Draws the legend as rows below `top` and returns the height of the figure.
    fn legend(&self, out: &mut Svg, top: f64) -> f64 {
        if self.series.len() < 2 {
            return top;
        }
        let (mut left, mut middle) = (2.0, top + 8.0);
        for (index, series) in self.series.iter().enumerate() {
            let name = cut(&series.name, WIDTH - 40.0);
            let width = 30.0 + text_width(&name);
            if left > 2.0 && left + width > WIDTH {
                (left, middle) = (2.0, middle + LINE_HEIGHT);
            }
            let key = [(left, middle), (left + 24.0, middle)];
            if !series.band.is_empty() {
                out.path(&class("b", index), &format!("M{} {}h24v10h-24z", short(left), short(middle - 5.0)));
            }
            if series.style != Style::Points {
                let dashed = if is_dense(series) { "l" } else { "l d" };
                out.path(&class(dashed, index), &path(key.iter().copied()));
            }
            if !series.errors.is_empty() {
                out.path(&class("er", index), &error_bar(left + 12.0, [middle - 6.0, middle + 6.0]));
            }
            if series.style != Style::Line {
                out.path(&class("p", index), &shape(index, left + 12.0, middle, POINT));
            }
            out.text("g", left + 30.0, middle + 4.5, &name, "");
            left += width + 14.0;
        }
        middle + 10.0
    }
}

/// Where the plot area is in the drawing, and what its edges mean.
struct Frame {
    x_axis: PlotAxis,
    y_axis: PlotAxis,
    left: f64,
    /// Where the upper axis is.
    upper: f64,
    top: f64,
    bottom: f64,
}

impl Frame {
    fn x(&self, value: f64) -> f64 {
        self.left + self.x_axis.fraction(value) * (RIGHT - self.left)
    }

    fn y(&self, value: f64) -> f64 {
        self.bottom - self.y_axis.fraction(value) * PLOT_HEIGHT
    }

    /// The middle between left and right.
    const fn middle(&self) -> f64 {
        f64::midpoint(self.left, RIGHT)
    }
}

impl Svg {
    fn band(&mut self, index: usize, rows: &[(f64, f64, f64)], frame: &Frame) {
        let edge = |upper: bool| -> Vec<(f64, f64)> {
            let value = |r: &(f64, f64, f64)| if upper { r.2 } else { r.1 };
            rows.iter().map(|r| (r.0, if complete(r) { value(r) } else { f64::NAN })).collect()
        };
        let [mut kept, upper] = [false, true].map(|upper| extremes(&edge(upper), MAX_VERTICES / 2));
        kept.extend(upper);
        let mut d = String::new();
        for segment in segments(&kept, |i| complete(&rows[i])) {
            let lower = segment.iter().map(|&i| (frame.x(rows[i].0), frame.y(rows[i].1)));
            let upper = segment.iter().rev().map(|&i| (frame.x(rows[i].0), frame.y(rows[i].2)));
            d += &path(lower.chain(upper));
            d.push('z');
        }
        self.path(&class("b", index), &d);
    }

    fn series(&mut self, index: usize, series: &PlotSeries, frame: &Frame) {
        let at = |i: usize| (frame.x(series.points[i].0), frame.y(series.points[i].1));
        let (mut line, mut single) = (String::new(), BTreeSet::new());
        if series.style != Style::Line {
            single = scatter(&series.points, MAX_VERTICES);
        }
        if series.style != Style::Points {
            let kept = extremes(&series.points, MAX_VERTICES);
            for segment in segments(&kept, |i| usable(series.points[i].0) && usable(series.points[i].1)) {
                match segment[..] {
                    [lone] => _ = single.insert(lone), // a single point makes no line
                    _ => line += &path(segment.iter().map(|&i| at(i))),
                }
            }
        }
        let size = point_size(single.len());
        let bars = single.iter().filter_map(|&i| series.bar(i));
        let bars: String = bars.map(|(at, low, high)| error_bar(frame.x(at), [frame.y(low), frame.y(high)])).collect();
        self.path(&class("er", index), &bars);
        let points: String = single.into_iter().map(|i| shape(index, at(i).0, at(i).1, size)).collect();
        self.path(&class(if is_dense(series) { "l f" } else { "l d" }, index), &line);
        self.path(&class("p", index), &points);
    }
}

impl PlotSeries {
    /// The points that can be drawn.
    fn drawn(&self) -> impl Iterator<Item = &(f64, f64)> {
        self.points.iter().filter(|(x, y)| usable(*x) && usable(*y))
    }

    /// x, lower and upper end of the error bar of a point; `None` if it has none.
    fn bar(&self, index: usize) -> Option<(f64, f64, f64)> {
        let (&(x, y), half) = (self.points.get(index)?, self.errors.get(index)?.abs());
        Some((x, y - half, y + half)).filter(complete)
    }

    fn bars(&self) -> impl Iterator<Item = (f64, f64, f64)> {
        (0..self.errors.len()).filter_map(|index| self.bar(index))
    }
}

/// Half the width of the points of a series of this length.
const fn point_size(points: usize) -> f64 {
    match points {
        0..=150 => POINT,
        151..=600 => 2.5,
        _ => 1.8,
    }
}

/// Path data of an error bar between two heights, with its ends.
fn error_bar(x: f64, ends: [f64; 2]) -> String {
    let [a, b] = ends.map(short);
    let (left, width) = (short(x - CAP), short(2.0 * CAP));
    format!("M{left} {a}h{width}M{left} {b}h{width}M{} {a}V{b}", short(x))
}

fn complete(row: &(f64, f64, f64)) -> bool {
    usable(row.0) && usable(row.1) && usable(row.2)
}

/// Whether the line is too dense for dashes to be visible.
fn is_dense(series: &PlotSeries) -> bool {
    series.points.len() > MAX_VERTICES / 4
}

/// Class of an element of a series: kind and colour.
fn class(kind: &str, index: usize) -> String {
    format!("{kind} s{}", index % COLOURS + 1)
}

#[cfg(test)]
mod tests;
