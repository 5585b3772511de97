//! Figures read back from their SVG.

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

/// The numbers of the n-th element of path data with this class.
fn numbers(svg: &str, class: &str) -> Vec<f64> {
    let d = of_class(svg, class)[0];
    d.split(|c: char| c.is_ascii_alphabetic() || c == ' ').filter_map(|number| number.parse().ok()).collect()
}

#[test]
fn error_bars_reach_from_end_to_end_and_belong_to_their_points() {
    let points = [(0.0, 10.0), (5.0, 20.0), (10.0, 10.0), (10.0, f64::NAN)];
    let line = [(0.0, 0.0), (10.0, 40.0)];
    let svg =
        checked(&Plot::new("t", "x", "y").series("a", Style::Line, line).series("b", Style::Points, points).errors([
            10.0,
            f64::NAN,
            -4.0,
            1.0,
        ]));
    let [left, bottom, right, top] = numbers(&svg, "l d s1")[..] else { panic!("{svg}") };
    let [low, high] = [0.0, 20.0].map(|value| short(bottom + (top - bottom) * value / 40.0));
    let bars = of_class(&svg, "er s2")[0];
    assert_eq!(bars.matches('V').count(), 2, "the points with a finite error: {bars}");
    assert!(bars.contains(&format!("M{} {low}V{high}", short(left))), "{bars}");
    let [low, high] = [6.0, 14.0].map(|value| short(bottom + (top - bottom) * value / 40.0));
    assert!(bars.contains(&format!("M{} {low}V{high}", short(right))), "{bars}");
    // The key in the legend has a bar too, and the range of y includes every bar.
    assert_eq!(of_class(&svg, "er s2").len(), 2);
    let svg = checked(&Plot::new("t", "x", "y").series("a", Style::Points, [(0.0, 1.0)]).errors([30.0]));
    assert!(svg.contains(">20</text>") && svg.contains(">−20</text>"), "{svg}");
    // Errors without a series, more errors than points, and fewer.
    for count in 0..4 {
        let errors = [1.0; 4].into_iter().take(count);
        checked(&Plot::new("t", "x", "y").errors(errors.clone()));
        let bars = checked(&Plot::new("t", "x", "y").series("a", Style::Both, [(0.0, 1.0), (1.0, 2.0)]).errors(errors));
        assert_eq!(bars.matches("v").count() > 0 && bars.contains("class=\"er s1\""), count > 0);
    }
}

#[test]
fn the_upper_axis_has_its_ticks_where_x_has_these_values() {
    let plot = Plot::new("t", "x", "y").series("a", Style::Line, [(0.0, 0.0), (10.0, 1.0)]);
    let svg = checked(&plot.clone().second_scale("T / degC", [(0.0, -20.0), (10.0, 40.0)]));
    assert!(svg.contains(">T / °C</text>"));
    let [left, _, right, _] = numbers(&svg, "l d s1")[..] else { panic!("{svg}") };
    for (label, place) in [("−20", left), ("10", f64::midpoint(left, right)), ("40", right)] {
        let text = |y: &str| format!("<text class=\"k m\" x=\"{}\" y=\"{y}\">{label}</text>", short(place));
        assert!(svg.contains(&text("58")), "{label} at {place}: {svg}");
    }
    // Outside the range of x there is no tick, and without ticks there is no axis.
    let outside = plot.clone().upper_axis("u", [(-5.0, "low".to_owned()), (5.0, "middle".to_owned())]);
    let svg = checked(&outside);
    assert!(svg.contains(">middle</text>") && !svg.contains(">low</text>"));
    for none in [vec![], vec![(f64::NAN, "nowhere".to_owned())]] {
        assert_eq!(checked(&plot.clone().upper_axis("u", none)), checked(&plot));
    }
    // Labels never overlap, however many there are.
    let many = (0..100).map(|n| (f64::from(n) * 0.1, "12:34:56".to_owned()));
    let svg = checked(&plot.upper_axis(&"long ".repeat(50), many));
    assert!((3..7).contains(&svg.matches(">12:34:56</text>").count()), "{svg}");
}

#[test]
fn marker_labels_are_between_the_upper_axis_and_the_plot() {
    let plot = Plot::new("t", "x", "y").series("a", Style::Line, [(0.0, 0.0), (10.0, 1.0)]).marker(5.0, "7");
    let svg = checked(&plot.upper_axis("UTC", [(5.0, "12:00".to_owned())]));
    let baseline = |label: &str| -> f64 {
        let text = svg.split("<text ").find(|text| text.contains(&format!(">{label}</text>")));
        let text = text.unwrap_or_else(|| panic!("{label}: {svg}"));
        text.split("y=\"").nth(1).and_then(|y| y.split('"').next()?.parse().ok()).unwrap()
    };
    let mark = numbers(&svg, "mark");
    assert!(baseline("12:00") + 13.0 < baseline("7") && baseline("7") < mark[1], "{svg}");
}

#[test]
fn long_series_are_thinned_and_keep_the_peak() {
    let wave = |i: i32| (f64::from(i), if i == 54_321 { 40.0 } else { libm::sin(f64::from(i)) });
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
    let mut plot = Plot::new(evil, evil, evil).series(evil, Style::Line, [(0.0, 1.0)]).series(&long, Style::Both, []);
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
