//! A verification by the magnitudes over static poses as text, JSON and page.

use super::json::{Figures, JudgedView, with_unit};
use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use super::verification::VerificationSource;
use super::view::{value, view};
use crate::parts::{self, file_names};
use isotherm_shared::table::CoefficientTable;
use isotherm_verification::{Magnitude, Magnitudes, Requirement};
use serde_json::Value;

/// What the magnitudes do not show.
pub const NOT_JUDGED: &str = "not judged: the direction of the output, and errors across the specific force; static poses in unknown attitudes show only the magnitude";

/// The magnitudes as text: the figures, then a line for each static pose.
#[must_use]
pub fn text(magnitudes: &Magnitudes) -> String {
    let Magnitudes { poses, mean, rms, .. } = magnitudes;
    let largest = magnitudes.largest();
    let mut text = parts::first_line(magnitudes.made_the_table);
    text += &format!(
        "{}\nLocal gravity {}\n{}\n\nLength of the output less local gravity [1e-6 g0], 95 %\n  largest  {} in static pose {}\n  mean     {}\n  rms      {:.3}\n  {NOT_JUDGED}\n\n",
        counts(magnitudes),
        magnitudes.gravity_source,
        magnitudes.shown,
        shown(largest.error.value, largest.error.interval),
        largest.reading.number,
        shown(mean.value, mean.interval),
        rms * 1e6,
    );
    text += "  static pose    start / s   length / s   specific force, output axes / g0   head temperature          error / 1e-6 g0\n";
    for magnitude in poses {
        let Magnitude { reading, force: [a1, a2, a3], error, out_of_range } = magnitude;
        let remark = if *out_of_range { "  temperature outside the table's range" } else { "" };
        let (number, start_s, seconds) = (reading.number, reading.start_s, reading.seconds);
        let (head, error) = (head(magnitude), shown(error.value, error.interval));
        text += &format!(
            "  {number:>10} {start_s:>12.2} {seconds:>12.2}   {a1:>8.4} {a2:>8.4} {a3:>8.4} {head:>20.3} {error:>24}{remark}\n"
        );
    }
    text
}

fn counts(magnitudes: &Magnitudes) -> String {
    let invalid = match magnitudes.invalid {
        0 => String::new(),
        count => format!(", {count} without a valid output"),
    };
    format!("{} static poses, {} too short{invalid}", magnitudes.poses.len(), magnitudes.too_short)
}

fn shown(value: f64, interval: f64) -> String {
    format!("{:.3} +- {:.3}", value * 1e6, interval * 1e6)
}

fn head(magnitude: &Magnitude) -> f64 {
    magnitude.reading.head.iter().sum::<f64>() / 3.0
}

/// The magnitudes as JSON, with the judgement of what is required.
#[must_use]
pub fn json(magnitudes: &Magnitudes, window_s: f64, required: Option<Requirement>) -> Value {
    value(&MagnitudesView::of(magnitudes, window_s, JudgedView::of(required, &|it| magnitudes.judge(it))))
}

view! { MagnitudesView<'a>(magnitudes: &'a Magnitudes, window_s: f64, judged: JudgedView) {
    judged_by: &'a str = "static_poses",
    window_s: f64 = window_s,
    static_poses: usize = magnitudes.poses.len(),
    too_short: usize = magnitudes.too_short,
    turned: usize = magnitudes.turned,
    invalid: usize = magnitudes.invalid,
    made_the_table: bool = magnitudes.made_the_table,
    driven_parts: [[f64; 2]; 3] = magnitudes.shown.driven,
    not_shown: &'a [String] = &magnitudes.shown.undriven,
    temperature_part: f64 = magnitudes.shown.temperature,
    hole: Option<&'a str> = magnitudes.shown.hole.as_deref(),
    gravity_local_m_s2: Option<f64> = magnitudes.gravity_source.value(),
    gravity_source: &'a str = magnitudes.gravity_source.name(),
    largest: LargestView = LargestView::of(magnitudes.largest()),
    mean: Figures = with_unit(&magnitudes.mean, "g0"),
    rms_g0: f64 = magnitudes.rms,
    static_pose: Vec<MagnitudeView<'a>> = magnitudes.poses.iter().map(MagnitudeView::of).collect(),
    #[serde(flatten)]
    judged: JudgedView = judged,
    not_judged: &'a str = NOT_JUDGED,
}}

view! { LargestView(magnitude: &Magnitude) {
    static_pose: usize = magnitude.reading.number,
    value_g0: f64 = magnitude.error.value,
    interval_g0: f64 = magnitude.error.interval,
}}

view! { MagnitudeView<'a>(magnitude: &'a Magnitude) {
    number: usize = magnitude.reading.number,
    start_s: f64 = magnitude.reading.start_s,
    length_s: f64 = magnitude.reading.seconds,
    rows: usize = magnitude.reading.rows.len(),
    specific_force_g0: &'a [f64] = &magnitude.force,
    head_in_unit_of_temperature: &'a [f64] = &magnitude.reading.head,
    error_g0: f64 = magnitude.error.value,
    interval_g0: f64 = magnitude.error.interval,
    out_of_range: bool = magnitude.out_of_range,
}}

/// The page as HTML.
#[must_use]
pub fn html(table: &CoefficientTable, magnitudes: &Magnitudes, source: &VerificationSource) -> String {
    let title = format!("Verification of {} by static poses", table.content().imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", file_names(&source.recording), source.time, source.tool));
    result(&mut page, magnitudes, source);
    static_poses(&mut page, magnitudes);
    page.heading(2, "provenance", "Provenance");
    page.key_values(&[
        ("Static poses", counts(magnitudes)),
        ("Local gravity", magnitudes.gravity_source.to_string()),
        ("Shown", magnitudes.shown.to_string()),
        ("Recording", source.recording.clone()),
        ("Table", table.digest().to_string()),
    ]);
    page.paragraph(&format!("This is {NOT_JUDGED}."));
    page.finish()
}

fn result(page: &mut Page, magnitudes: &Magnitudes, source: &VerificationSource) {
    page.heading(2, "result", "Result");
    parts::own_recording(page, magnitudes.made_the_table);
    let largest = magnitudes.largest();
    page.paragraph(&format!(
        "The output is longer or shorter than local gravity by {} ug0 at most, in static pose {}; by {} ug0 in the mean, and by {:.3} ug0 rms.",
        shown(largest.error.value, largest.error.interval),
        largest.reading.number,
        shown(magnitudes.mean.value, magnitudes.mean.interval),
        magnitudes.rms * 1e6
    ));
    for judgement in source.required.iter().flat_map(|required| magnitudes.judge(required)) {
        let (kind, title) = if judgement.met { (NoteKind::Good, "Met") } else { (NoteKind::Bad, "Not met") };
        page.note(kind, title, &judgement.message);
    }
}

fn static_poses(page: &mut Page, magnitudes: &Magnitudes) {
    page.heading(2, "static_poses", "Static poses");
    let points = magnitudes.poses.iter().map(|it| (it.reading.number as f64, it.error.value * 1e6));
    let bars = magnitudes.poses.iter().map(|it| it.error.interval * 1e6);
    let plot = Plot::new("Length of the output less local gravity", "Number of the static pose", "Error / 1e-6 g0");
    let plot = plot.series("Error", Style::Points, points).errors(bars).zero_line();
    page.figure(&plot.svg(), "Bars: 95 % from the noise of each mean.");
    let columns: [Column<'_, &Magnitude>; 9] = [
        ("Number", &|it| Cell::number(it.reading.number as f64, 0)),
        ("Start / s", &|it| Cell::number(it.reading.start_s, 2)),
        ("Length / s", &|it| Cell::number(it.reading.seconds, 2)),
        ("A1 / g0", &|it| Cell::number(it.force[0], 4)),
        ("A2 / g0", &|it| Cell::number(it.force[1], 4)),
        ("A3 / g0", &|it| Cell::number(it.force[2], 4)),
        ("Head temperature", &|it| Cell::number(head(it), 3)),
        ("Error / 1e-6 g0", &|it| Cell::number(it.error.value * 1e6, 3)),
        ("95 % / 1e-6 g0", &|it| Cell::number(it.error.interval * 1e6, 3)),
    ];
    page.columns("Static poses: specific force along the output axes", &magnitudes.poses, &columns);
}
