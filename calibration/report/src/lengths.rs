//! A verification by the lengths over standstills as text, JSON and page.

use super::json::{Figures, JudgedView, with_unit};
use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use super::verification::VerificationSource;
use super::view::{value, view};
use crate::parts::{self, file_names};
use isotherm_shared::table::CoefficientTable;
use isotherm_verification::{Length, Lengths, Requirement};
use serde_json::Value;
use std::fmt::Write as _;

/// What the lengths do not show.
pub const NOT_JUDGED: &str = "not judged: the direction of the output, and errors across the specific force; standstills in unknown attitudes show the length alone";

/// The lengths as text: the figures, then a line for each standstill.
#[must_use]
pub fn text(lengths: &Lengths) -> String {
    let Lengths { standstills, mean, rms, .. } = lengths;
    let largest = lengths.largest();
    let mut text = parts::first_line(lengths.made_the_table);
    text += &format!(
        "{}\nLocal gravity {}\n{}\n\nLength of the output less local gravity [1e-6 g0], 95 %\n  largest  {} in standstill {}\n  mean     {}\n  rms      {:.3}\n  {NOT_JUDGED}\n\n",
        counts(lengths),
        lengths.gravity_source,
        lengths.shown,
        shown(largest.error.value, largest.error.interval),
        largest.reading.number,
        shown(mean.value, mean.interval),
        rms * 1e6,
    );
    text += "  standstill    start / s   length / s   specific force, output axes / g0   head telemetry          error / 1e-6 g0\n";
    for length in standstills {
        let Length { reading, force: [a1, a2, a3], error, out_of_range } = length;
        let remark = if *out_of_range { "  telemetry outside the table's range" } else { "" };
        let (number, start_s, seconds) = (reading.number, reading.start_s, reading.seconds);
        let (head, error) = (head(length), shown(error.value, error.interval));
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "  {number:>10} {start_s:>12.2} {seconds:>12.2}   {a1:>8.4} {a2:>8.4} {a3:>8.4} {head:>20.3} {error:>24}{remark}"
        );
    }
    text
}

fn counts(lengths: &Lengths) -> String {
    let invalid = match lengths.invalid {
        0 => String::new(),
        count => format!(", {count} without a valid output"),
    };
    format!("{} standstills, {} too short{invalid}", lengths.standstills.len(), lengths.too_short)
}

fn shown(value: f64, interval: f64) -> String {
    format!("{:.3} +- {:.3}", value * 1e6, interval * 1e6)
}

fn head(length: &Length) -> f64 {
    length.reading.head.iter().sum::<f64>() / 3.0
}

/// The lengths as JSON, with the judgement of what is required.
#[must_use]
pub fn json(lengths: &Lengths, window_s: f64, required: Option<Requirement>) -> Value {
    value(&LengthsView::of(lengths, window_s, JudgedView::of(required, &|it| lengths.judge(it))))
}

view! { LengthsView<'a>(lengths: &'a Lengths, window_s: f64, judged: JudgedView) {
    judged_by: &'a str = "standstills",
    window_s: f64 = window_s,
    standstills: usize = lengths.standstills.len(),
    too_short: usize = lengths.too_short,
    turned: usize = lengths.turned,
    invalid: usize = lengths.invalid,
    made_the_table: bool = lengths.made_the_table,
    driven_parts: [[f64; 2]; 3] = lengths.shown.driven,
    not_shown: &'a [String] = &lengths.shown.undriven,
    telemetry_part: f64 = lengths.shown.telemetry,
    hole: Option<&'a str> = lengths.shown.hole.as_deref(),
    gravity_local_m_s2: Option<f64> = lengths.gravity_source.value(),
    gravity_source: &'a str = lengths.gravity_source.name(),
    largest: LargestView = LargestView::of(lengths.largest()),
    mean: Figures = with_unit(&lengths.mean, "g0"),
    rms_g0: f64 = lengths.rms,
    standstill: Vec<LengthView<'a>> = lengths.standstills.iter().map(LengthView::of).collect(),
    #[serde(flatten)]
    judged: JudgedView = judged,
    not_judged: &'a str = NOT_JUDGED,
}}

view! { LargestView(length: &Length) {
    standstill: usize = length.reading.number,
    value_g0: f64 = length.error.value,
    interval_g0: f64 = length.error.interval,
}}

view! { LengthView<'a>(length: &'a Length) {
    number: usize = length.reading.number,
    start_s: f64 = length.reading.start_s,
    length_s: f64 = length.reading.seconds,
    rows: usize = length.reading.rows.len(),
    specific_force_g0: &'a [f64] = &length.force,
    head_in_unit_of_telemetry: &'a [f64] = &length.reading.head,
    error_g0: f64 = length.error.value,
    interval_g0: f64 = length.error.interval,
    out_of_range: bool = length.out_of_range,
}}

/// The page as HTML.
#[must_use]
pub fn html(table: &CoefficientTable, lengths: &Lengths, source: &VerificationSource) -> String {
    let title = format!("Verification of {} by standstills", table.content().imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", file_names(&source.recording), source.time, source.tool));
    result(&mut page, table, lengths, source);
    standstills(&mut page, lengths);
    page.finish()
}

fn result(page: &mut Page, table: &CoefficientTable, lengths: &Lengths, source: &VerificationSource) {
    page.heading(2, "result", "Result");
    parts::own_recording(page, lengths.made_the_table);
    let largest = lengths.largest();
    let error = shown(largest.error.value, largest.error.interval);
    page.key_values(&[
        ("Standstills", counts(lengths)),
        ("Local gravity", lengths.gravity_source.to_string()),
        ("Shown", lengths.shown.to_string()),
        ("Largest error", format!("{error}e-6 g0, standstill {}", largest.reading.number)),
        ("Mean error", format!("{}e-6 g0", shown(lengths.mean.value, lengths.mean.interval))),
        ("Rms error", format!("{:.3}e-6 g0", lengths.rms * 1e6)),
        ("Table", table.digest().to_string()),
    ]);
    page.paragraph(&format!("This is {NOT_JUDGED}."));
    for judgement in source.required.iter().flat_map(|required| lengths.judge(required)) {
        let (kind, title) = if judgement.met { (NoteKind::Good, "Met") } else { (NoteKind::Bad, "Not met") };
        page.note(kind, title, &judgement.message);
    }
}

fn standstills(page: &mut Page, lengths: &Lengths) {
    page.heading(2, "standstills", "Standstills");
    let points = lengths.standstills.iter().map(|it| (it.reading.number as f64, it.error.value * 1e6));
    let bars = lengths.standstills.iter().map(|it| it.error.interval * 1e6);
    let plot = Plot::new("Length of the output less local gravity", "Number of the standstill", "Error / 1e-6 g0");
    let plot = plot.series("Error", Style::Points, points).errors(bars).zero_line();
    page.figure(&plot.svg(), "Bars: 95 % from the noise of each mean.");
    let columns: [Column<'_, &Length>; 9] = [
        ("Number", &|it| Cell::number(it.reading.number as f64, 0)),
        ("Start / s", &|it| Cell::number(it.reading.start_s, 2)),
        ("Length / s", &|it| Cell::number(it.reading.seconds, 2)),
        ("A1 / g0", &|it| Cell::number(it.force[0], 4)),
        ("A2 / g0", &|it| Cell::number(it.force[1], 4)),
        ("A3 / g0", &|it| Cell::number(it.force[2], 4)),
        ("Head telemetry", &|it| Cell::number(head(it), 3)),
        ("Error / 1e-6 g0", &|it| Cell::number(it.error.value * 1e6, 3)),
        ("95 % / 1e-6 g0", &|it| Cell::number(it.error.interval * 1e6, 3)),
    ];
    page.columns("Standstills: specific force along the output axes", &lengths.standstills, &columns);
}
