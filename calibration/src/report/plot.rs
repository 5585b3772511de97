//! One x-y figure as inline SVG.
//!
//! Colours, line widths and fonts come from the stylesheet of the [`page`](super::page) by class, so a figure follows
//! its palette. The SVG itself contains only geometry and text, and no identifier that could occur twice on a page. Series
//! differ by colour, by the shape of their points and, unless they are dense, by their dashes.

use maud::{Markup, PreEscaped, html};
use std::collections::BTreeSet;

use super::axis::{PlotAxis, usable};
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
#[derive(Clone, Debug)]
pub struct Plot {
    title: String,
    x_label: String,
    y_label: String,
    series: Vec<PlotSeries>,
    markers: Vec<(f64, String)>,
    zero: bool,
}

#[derive(Clone, Debug)]
struct PlotSeries {
    name: String,
    style: Style,
    points: Vec<(f64, f64)>,
    /// x, lower and upper edge.
    band: Vec<(f64, f64, f64)>,
}

/// Sizes in the drawing's own units; the page scales the drawing to the available width.
const WIDTH: f64 = 440.0;
const RIGHT: f64 = WIDTH - 16.0;
const PLOT_HEIGHT: f64 = 196.0;
const LINE_HEIGHT: f64 = 17.0;
/// Number of series colours in the stylesheet.
const COLOURS: usize = 6;
/// Largest number of points that are drawn at full size; the points of a longer series are smaller.
const MAX_LARGE_POINTS: usize = 150;
/// Largest number of rows of marker labels.
const MARKER_ROWS: usize = 3;

impl Plot {
    /// A figure without series. Labels are quantity and unit, e.g. "Bias / 1e-6 g0"; a text that is too long is cut.
    #[must_use]
    pub fn new(title: &str, x_label: &str, y_label: &str) -> Self {
        let [title, x_label, y_label] = [title, x_label, y_label].map(String::from);
        Self { title, x_label, y_label, series: Vec::new(), markers: Vec::new(), zero: false }
    }

    /// Adds a series of (x, y). The legend appears with the second one.
    #[must_use]
    pub fn series(mut self, name: &str, style: Style, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let points = points.into_iter().collect();
        self.series.push(PlotSeries { name: name.into(), style, points, band: Vec::new() });
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

    /// Draws a vertical line at x, with a label above the plot area, and extends the range of x to include it.
    #[must_use]
    pub fn marker(mut self, x: f64, label: &str) -> Self {
        if usable(x) {
            self.markers.push((x, label.into()));
            self.markers.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        self
    }

    /// The figure as SVG for [`Page::figure`](super::page::Page::figure).
    #[must_use]
    pub fn svg(&self) -> Markup {
        let drawn = |&&(x, y): &&(f64, f64)| usable(x) && usable(y);
        let points = || self.series.iter().flat_map(|s| s.points.iter().filter(drawn));
        let rows = || self.series.iter().flat_map(|s| s.band.iter().filter(|row| complete(row)));
        let xs = points().map(|p| p.0).chain(rows().map(|r| r.0)).chain(self.markers.iter().map(|m| m.0));
        let ys = points().map(|p| p.1).chain(rows().flat_map(|r| [r.1, r.2])).chain(self.zero.then_some(0.0));
        let (x_axis, y_axis) = (PlotAxis::new(xs, 0.03, 6), PlotAxis::new(ys, 0.06, 8));

        let left = 10.0 + y_axis.ticks.iter().map(|(_, label)| text_width(label)).fold(22.0, f64::max);
        let x = |value: f64| left + x_axis.fraction(value) * (RIGHT - left);
        let labels = self.marker_labels(x);
        let marker_rows = labels.iter().map(|label| label.0 + 1).max().unwrap_or(0);
        let top = 48.0 + marker_rows as f64 * LINE_HEIGHT;
        let bottom = top + PLOT_HEIGHT;
        let y = |value: f64| bottom - y_axis.fraction(value) * PLOT_HEIGHT;

        let mut out = Svg(String::new());
        out.text("t", 2.0, 16.0, &cut(&self.title, WIDTH * 0.92), "");
        out.text("a", 2.0, 37.0, &cut(&self.y_label, RIGHT - text_width(&y_axis.note)), &y_axis.note);
        let (mut grid, mut frame) = (String::new(), String::new());
        for (value, label) in &y_axis.ticks {
            grid += &format!("M{} {}H{RIGHT}", short(left), short(y(*value)));
            out.text("k e", left - 6.0, y(*value) + 4.5, label, "");
        }
        for (value, label) in &x_axis.ticks {
            grid += &format!("M{} {}V{}", short(x(*value)), short(top), short(bottom));
            frame += &format!("M{} {}v4", short(x(*value)), short(bottom));
            out.text("k m", x(*value), bottom + 17.0, label, "");
        }
        out.path("grid", &grid);
        frame += &format!("M{} {}V{}H{RIGHT}", short(left), short(top), short(bottom));
        out.path("frame", &frame);
        let middle = f64::midpoint(left, RIGHT);
        let x_label = cut(&self.x_label, WIDTH - 24.0 - text_width(&x_axis.note));
        out.text("a m", middle, bottom + 35.0, &x_label, &x_axis.note);
        if self.zero {
            out.path("zero", &format!("M{} {}H{RIGHT}", short(left), short(y(0.0))));
        }
        for (value, _) in &self.markers {
            out.path("mark", &format!("M{} {}V{}", short(x(*value)), short(top - 4.0), short(bottom)));
        }
        for (row, at, label) in &labels {
            out.text("g m", *at, top - 8.0 - *row as f64 * LINE_HEIGHT, label, "");
        }
        for (index, series) in self.series.iter().enumerate() {
            out.band(index, &series.band, x, y);
        }
        for (index, series) in self.series.iter().enumerate() {
            out.series(index, series, x, y);
        }
        if points().next().is_none() && rows().next().is_none() {
            out.text("a m", middle, f64::midpoint(top, bottom), "no data", "");
        }
        let height = self.legend(&mut out, bottom + 42.0);
        let summary = format!("{}: {} over {}", self.title, self.y_label, self.x_label);
        let names: Vec<_> = self.series.iter().map(|s| format!("{} ({} points)", s.name, s.points.len())).collect();
        html! {
            svg.plot viewBox={ "0 0 " (WIDTH) " " (short(height)) } role="img" aria-label=(summary) {
                title { (self.title) }
                desc { "Series: " (names.join(", ")) }
                (PreEscaped(out.0))
            }
        }
    }

    /// Row, centre and text of the marker labels. Labels of one row do not overlap; a label that fits into no row is omitted.
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
            if series.style != Style::Line {
                let size = if series.points.len() > MAX_LARGE_POINTS { 1.8 } else { 3.2 };
                out.path(&class("p", index), &shape(index, left + 12.0, middle, size));
            }
            out.text("g", left + 30.0, middle + 4.5, &name, "");
            left += width + 14.0;
        }
        middle + 10.0
    }
}

impl Svg {
    fn band(&mut self, index: usize, rows: &[(f64, f64, f64)], x: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) {
        let edge = |upper: bool| -> Vec<(f64, f64)> {
            let value = |r: &(f64, f64, f64)| if upper { r.2 } else { r.1 };
            rows.iter().map(|r| (r.0, if complete(r) { value(r) } else { f64::NAN })).collect()
        };
        let [mut kept, upper] = [false, true].map(|upper| extremes(&edge(upper), MAX_VERTICES / 2));
        kept.extend(upper);
        let mut d = String::new();
        for segment in segments(&kept, |i| complete(&rows[i])) {
            let lower = segment.iter().map(|&i| (x(rows[i].0), y(rows[i].1)));
            let upper = segment.iter().rev().map(|&i| (x(rows[i].0), y(rows[i].2)));
            d += &path(lower.chain(upper));
            d.push('z');
        }
        self.path(&class("b", index), &d);
    }

    fn series(&mut self, index: usize, series: &PlotSeries, x: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) {
        let at = |i: usize| (x(series.points[i].0), y(series.points[i].1));
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
        let size = if single.len() > MAX_LARGE_POINTS { 1.8 } else { 3.2 };
        let points: String = single.into_iter().map(|i| shape(index, at(i).0, at(i).1, size)).collect();
        self.path(&class(if is_dense(series) { "l f" } else { "l d" }, index), &line);
        self.path(&class("p", index), &points);
    }
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
mod tests {
    use super::super::page::tests::assert_well_formed;
    use super::*;

    fn checked(plot: &Plot) -> String {
        let svg = plot.svg().into_string();
        assert_well_formed(&svg);
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        svg
    }

    fn of_class<'a>(svg: &'a str, class: &str) -> Vec<&'a str> {
        let start = format!("<path class=\"{class}\" d=\"");
        svg.split(start.as_str()).skip(1).filter_map(|rest| rest.split('"').next()).collect()
    }

    #[test]
    fn degenerate_data_is_drawn() {
        let bad = [(f64::NAN, 1.0), (1.0, f64::INFINITY), (1e300, 1e300)];
        for points in [vec![], bad.to_vec(), vec![(1.0, 2.0)], vec![(1.0, 2.0); 5], vec![(0.0, 0.0), (5e-324, 1e99)]] {
            for style in [Style::Line, Style::Points, Style::Both] {
                let band = points.iter().map(|p| (p.0, p.1, p.1));
                let plot = Plot::new("", "x", "y").series("", style, points.clone()).band(band).zero_line();
                checked(&plot.clone().marker(f64::NAN, "nowhere").marker(1.0, "here"));
                checked(&plot);
            }
        }
        assert!(checked(&Plot::new("t", "x", "y")).contains("no data"));
        assert!(!checked(&Plot::new("t", "x", "y").series("", Style::Line, [(1.0, 2.0)])).contains("no data"));
    }

    #[test]
    fn a_missing_value_breaks_line_and_band() {
        let points = [(0.0, 0.0), (1.0, 1.0), (2.0, f64::NAN), (3.0, 1.0), (4.0, 0.0), (5.0, f64::NAN), (6.0, 1.0)];
        let band = points.map(|(x, y)| (x, y - 1.0, y + 1.0));
        let svg = checked(&Plot::new("t", "x", "y").series("", Style::Line, points).band(band));
        assert_eq!(of_class(&svg, "l d s1")[0].matches('M').count(), 2);
        assert_eq!(of_class(&svg, "p s1")[0].matches('M').count(), 1, "the lone point");
        assert_eq!(of_class(&svg, "b s1")[0].matches('z').count(), 3);
    }

    #[test]
    fn values_are_drawn_where_the_ticks_say() {
        let svg = checked(&Plot::new("t", "x", "y").series("", Style::Line, [(0.0, -10.0), (10.0, 10.0)]).zero_line());
        let [x0, y0, x1, y1] = of_class(&svg, "l d s1")[0]
            .split(['M', 'L', ' '])
            .filter_map(|number| number.parse::<f64>().ok())
            .collect::<Vec<_>>()[..]
        else {
            panic!("{svg}")
        };
        assert!(x0 < x1 && y0 > y1, "y points up");
        let label = |x: f64| svg.contains(&format!("<text class=\"k m\" x=\"{}\"", short(x)));
        assert!(label(x0) && label(x1), "ticks at 0 and 10");
        assert!(of_class(&svg, "zero")[0].contains(&format!(" {}H", short(f64::midpoint(y0, y1)))));
    }

    #[test]
    fn long_series_are_thinned_and_keep_the_peak() {
        let wave = |i: i32| (f64::from(i), if i == 54_321 { 40.0 } else { f64::from(i).sin() });
        let plot = |n: i32| Plot::new("t", "x", "y").series("a", Style::Both, (0..n).map(wave));
        let svg = checked(&plot(100_000).band((0..100_000).map(|i| (f64::from(i), -1.0, wave(i).1))));
        assert!(svg.len() < 200_000, "{}", svg.len());
        let top = |d: &str| d.split(['M', 'L']).filter_map(|p| p.split(' ').nth(1)?.parse().ok()).fold(999.0, f64::min);
        let peak = top(of_class(&svg, "l f s1")[0]);
        assert!(peak < 48.0 + 0.07 * PLOT_HEIGHT, "the peak is lost: {peak}");
        assert!(top(of_class(&checked(&plot(1_000)), "l f s1")[0]) > 48.0, "and is there only if it is in the data");
    }

    #[test]
    fn the_legend_comes_with_the_second_series() {
        let plot = Plot::new("t", "x", "y").series("first", Style::Line, [(0.0, 1.0), (1.0, 2.0)]);
        assert!(!checked(&plot).contains(">first</text>"));
        let svg = checked(&plot.series("second", Style::Points, [(0.0, 2.0)]));
        assert!(svg.contains(">first</text>") && svg.contains(">second</text>"));
    }

    #[test]
    fn text_is_escaped_and_cut_and_labels_do_not_overlap() {
        let evil = "</svg><script>alert('1')</script>\u{0}\"&";
        let long = "W".repeat(500);
        let mut plot =
            Plot::new(evil, evil, evil).series(evil, Style::Line, [(0.0, 1.0)]).series(&long, Style::Both, []);
        for i in 0..20 {
            plot = plot.marker(f64::from(i) * 0.01, "a marker").series(evil, Style::Line, []);
        }
        let svg = checked(&plot);
        assert!(!svg.contains("<script"));
        let labels = plot.marker_labels(|x| 100.0 + 300.0 * x);
        for (index, a) in labels.iter().enumerate() {
            for b in labels[index + 1..].iter().filter(|b| b.0 == a.0) {
                assert!((a.1 - b.1).abs() >= text_width("a marker"), "{labels:?}");
            }
        }
    }
}
