//! A document as text tables. An object with figures is a line: its path in the document, then its cells. Lines with
//! the same first column are a table; where a line has no cell of a column there is a `-`.

use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// Columns that come before all others, in this order.
const FIRST: [&str; 11] =
    ["p50_ns", "p90_ns", "p99_ns", "p999_ns", "p9999_ns", "max_ns", "p50", "p90", "p99", "p999", "count"];

/// A line: its path, and the object with its cells.
type Line<'a> = (String, &'a Map<String, Value>);

/// Prints all figures of a document.
pub(crate) fn print(document: &Map<String, Value>) {
    let mut lines = Vec::new();
    collect("", document, &mut lines);
    while let Some(first) = lines.first().map(|(_, cells)| columns(cells).remove(0)) {
        let (table, others): (Vec<_>, _) = lines.into_iter().partition(|(_, cells)| columns(cells)[0] == first);
        print_table(&table);
        lines = others;
    }
    println!(
        "- : not measured, or fewer than 20 samples beyond it. Only ratios of one run mean much on a shared machine."
    );
}

fn print_table(lines: &[Line<'_>]) {
    let all: BTreeSet<_> = lines.iter().flat_map(|(_, cells)| columns(cells)).collect();
    let rows: Vec<Vec<_>> =
        lines.iter().map(|(_, cells)| all.iter().map(|(_, name)| cell(cells.get(*name))).collect()).collect();
    let path = lines.iter().map(|(path, _)| path.len()).max().unwrap_or(0);
    let widths = all
        .iter()
        .enumerate()
        .map(|(column, (_, name))| rows.iter().map(|row| row[column].len()).max().unwrap_or(0).max(name.len()));
    let widths: Vec<_> = widths.collect();
    let print = |name: &str, cells: &mut dyn Iterator<Item = &str>| {
        let cells: String = cells.zip(&widths).map(|(cell, width)| format!("  {cell:>width$}")).collect();
        println!("{name:<path$}{cells}");
    };
    println!();
    print("", &mut all.iter().map(|(_, name)| *name));
    lines.iter().zip(&rows).for_each(|((name, _), row)| print(name, &mut row.iter().map(String::as_str)));
}

/// Adds the lines of an object and of what is in it. If the names of siblings are numbers, the lowest is the first.
fn collect<'a>(path: &str, object: &'a Map<String, Value>, lines: &mut Vec<Line<'a>>) {
    if !columns(object).is_empty() {
        lines.push((path.to_owned(), object));
    }
    let mut members: Vec<_> = object.iter().collect();
    members.sort_by_key(|(name, _)| name.parse::<u32>().unwrap_or_default());
    for (name, value) in members {
        let path = format!("{path} {name}").trim_start().to_owned();
        match value {
            Value::Object(member) if !is_cell(value) => collect(&path, member, lines),
            Value::Array(items) if !is_cell(value) => {
                items.iter().filter_map(Value::as_object).for_each(|item| collect(&path, item, lines));
            }
            _ => {}
        }
    }
}

/// The names of an object's cells, each after its place in [`FIRST`].
fn columns(object: &Map<String, Value>) -> Vec<(usize, &str)> {
    let cells = object.iter().filter(|(_, value)| is_cell(value)).map(|(name, _)| name.as_str());
    let place = |name: &str| FIRST.iter().position(|first| *first == name).unwrap_or(FIRST.len());
    let mut columns: Vec<_> = cells.map(|name| (place(name), name)).collect();
    columns.sort_unstable();
    columns
}

/// Whether a value is shown within a line: a figure, a list of figures, or a ratio with its interval.
fn is_cell(value: &Value) -> bool {
    match value {
        Value::Object(object) => object.contains_key("ratio") && object.contains_key("low"),
        Value::Array(items) => !items.iter().any(Value::is_object),
        _ => true,
    }
}

fn cell(value: Option<&Value>) -> String {
    match value {
        Some(Value::Object(ratio)) => {
            let [ratio, low, high] = ["ratio", "low", "high"].map(|name| cell(ratio.get(name)));
            format!("{ratio} ({low} {high})")
        }
        Some(Value::Array(items)) => items.iter().map(|item| cell(Some(item))).collect::<Vec<_>>().join(" "),
        Some(Value::String(text)) => text.clone(),
        Some(Value::Bool(value)) => value.to_string(),
        Some(Value::Number(number)) => number.as_f64().map_or_else(String::new, |number| match number.abs() {
            _ if number.fract() == 0.0 => format!("{number}"),
            large if large >= 1000.0 => format!("{number:.0}"),
            large if large >= 10.0 => format!("{number:.1}"),
            _ => format!("{number:.3}"),
        }),
        Some(Value::Null) | None => "-".to_owned(),
    }
}
