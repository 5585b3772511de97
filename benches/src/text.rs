//! Text tables of figures that are in a document.

use serde_json::{Map, Value};

/// The columns of figures: title, name in the document, width.
const FIGURES: [(&str, &str, usize); 7] = [
    ("p50", "p50_ns", 9),
    ("p90", "p90_ns", 9),
    ("p99", "p99_ns", 9),
    ("p99.9", "p999_ns", 9),
    ("p99.99", "p9999_ns", 9),
    ("max", "max_ns", 10),
    ("count", "count", 9),
];
/// The columns of ratios.
const RATIOS: [(&str, &str, usize); 4] =
    [("p50", "p50", 19), ("p90", "p90", 19), ("p99", "p99", 19), ("p99.9", "p999", 19)];

/// A line of a table: a name of this width, then cells with their widths, aligned to the right.
fn line(name: &str, width: usize, cells: impl IntoIterator<Item = (String, usize)>) {
    let cells: String = cells.into_iter().map(|(cell, width)| format!(" {cell:>width$}")).collect();
    println!("{name:<width$}{cells}");
}

/// The head of a table of figures.
pub fn heading(title: &str) {
    println!("\n{title}");
    line("", 34, FIGURES.map(|(title, _, width)| (title.to_owned(), width)));
}

/// A line of a table of figures.
pub fn row(name: &str, figures: &Value) {
    line(name, 34, FIGURES.map(|(_, key, width)| (number(&figures[key], 0), width)));
}

/// A line for each path, with the worker's share of a core where it is known.
pub fn path_rows(paths: &Value) {
    for (name, figures) in members(paths) {
        let share = figures["cpu_percent"].as_f64().map(|share| format!(", {share:.1} %"));
        row(&format!("{name}{}", share.unwrap_or_default()), figures);
    }
}

/// A table of ratios with their intervals.
pub fn ratios(title: &str, ratios: &Value) {
    println!();
    line(title, 42, RATIOS.map(|(title, _, width)| (title.to_owned(), width)));
    for (name, ratio) in members(ratios) {
        line(name, 42, RATIOS.map(|(_, key, width)| (with_interval(&ratio[key]), width)));
    }
}

/// A number; `-` if it was not measured.
pub fn number(value: &Value, digits: usize) -> String {
    value.as_f64().map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

/// A ratio and its interval.
pub fn with_interval(value: &Value) -> String {
    let of = |name: &str| value[name].as_f64();
    let Some(((ratio, low), high)) = of("ratio").zip(of("low")).zip(of("high")) else { return "-".to_owned() };
    let digits = if ratio < 10.0 { 2 } else { 0 };
    format!("{ratio:.digits$} ({low:.digits$} {high:.digits$})")
}

/// The members of an object.
pub fn members(object: &Value) -> impl Iterator<Item = (&String, &Value)> {
    object.as_object().into_iter().flat_map(Map::iter)
}

/// The machine and the time of the bench.
pub(crate) fn footer(document: &Value) {
    let machine = &document["machine"];
    let text = |name: &str| machine[name].as_str().unwrap_or("unknown").to_owned();
    println!(
        "\n{}, {} cores{}, kernel {}, clock source {}, governor {}; {} s",
        text("cpu"),
        machine["cores"],
        if machine["virtual"] == true { " of a virtual machine" } else { "" },
        text("kernel"),
        text("clock_source"),
        text("governor"),
        number(&document["seconds"], 0)
    );
    println!(
        "- : fewer than 20 samples beyond it. Absolute times mean nothing on a shared machine; ratios of one run do."
    );
}
