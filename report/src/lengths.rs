//! A verification by the lengths over standstills as text, JSON and page.

use super::page::{Cell, NoteKind, Page};
use super::plot::{Plot, Style};
use super::verification::VerificationSource;
use crate::parts::file_names;
use isotherm_shared::table::CoefficientTable;
use isotherm_verification::{Length, Lengths, Requirement};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// What the lengths do not show.
pub const NOT_JUDGED: &str = "not judged: the direction of the output, and errors across the specific force; standstills in unknown attitudes show the length alone";

/// The lengths as text: the figures, then a line for each standstill.
#[must_use]
pub fn text(lengths: &Lengths) -> String {
    let Lengths { standstills, mean, rms, .. } = lengths;
    let largest = lengths.largest();
    let mut text = format!(
        "{}\nLocal gravity {}\n\nLength of the output less local gravity [1e-6 g0], 95 %\n  largest  {} in standstill {}\n  mean     {}\n  rms      {:.3}\n  {NOT_JUDGED}\n\n",
        counts(lengths),
        lengths.gravity_source,
        shown(largest.error.value, largest.error.interval),
        largest.reading.number,
        shown(mean.value, mean.interval),
        rms * 1e6,
    );
    text += "  standstill    start / s   length / s   specific force, output axes / g0   head telemetry          error / 1e-6 g0\n";
    for length in standstills {
        let Length { reading, force, error, out_of_range } = length;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "  {:>10} {:>12.2} {:>12.2}   {:>8.4} {:>8.4} {:>8.4} {:>20.3} {:>24}{}",
            reading.number,
            reading.start_s,
            reading.seconds,
            force[0],
            force[1],
            force[2],
            head(length),
            shown(error.value, error.interval),
            if *out_of_range { "  telemetry outside the table's range" } else { "" }
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
    let judgements = required.map(|required| lengths.judge(&required));
    let largest = lengths.largest();
    let standstill = |length: &Length| {
        json!({
            "number": length.reading.number,
            "start_s": length.reading.start_s,
            "length_s": length.reading.seconds,
            "rows": length.reading.rows.len(),
            "specific_force_g0": length.force,
            "head_in_unit_of_telemetry": length.reading.head,
            "error_g0": length.error.value,
            "interval_g0": length.error.interval,
            "out_of_range": length.out_of_range,
        })
    };
    json!({
        "judged_by": "standstills",
        "window_s": window_s,
        "standstills": lengths.standstills.len(),
        "too_short": lengths.too_short,
        "invalid": lengths.invalid,
        "gravity_local_m_s2": lengths.gravity_source.value(),
        "gravity_source": lengths.gravity_source.name(),
        "largest": { "standstill": largest.reading.number, "value_g0": largest.error.value, "interval_g0": largest.error.interval },
        "mean": { "value_g0": lengths.mean.value, "interval_g0": lengths.mean.interval },
        "rms_g0": lengths.rms,
        "standstill": lengths.standstills.iter().map(standstill).collect::<Vec<_>>(),
        "required": required.map(|required| required.to_string()),
        "judgements": judgements.as_ref().map(|judgements| json!(judgements)),
        "met": judgements.map(|judgements| judgements.iter().all(|judgement| judgement.met)),
        "not_judged": NOT_JUDGED,
    })
}

/// The page as HTML.
#[must_use]
pub fn html(table: &CoefficientTable, lengths: &Lengths, source: &VerificationSource) -> String {
    let title = format!("Verification of {} by standstills", table.content().imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", file_names(&source.recording), source.time, source.tool));
    page.heading(2, "result", "Result");
    let largest = lengths.largest();
    page.key_values(&[
        ("Standstills", counts(lengths)),
        ("Local gravity", lengths.gravity_source.to_string()),
        (
            "Largest error",
            format!(
                "{}e-6 g0, standstill {}",
                shown(largest.error.value, largest.error.interval),
                largest.reading.number
            ),
        ),
        ("Mean error", format!("{}e-6 g0", shown(lengths.mean.value, lengths.mean.interval))),
        ("Rms error", format!("{:.3}e-6 g0", lengths.rms * 1e6)),
        ("Table", table.digest().to_string()),
    ]);
    page.paragraph(&format!("This is {NOT_JUDGED}."));
    for judgement in source.required.iter().flat_map(|required| lengths.judge(required)) {
        let kind = if judgement.met { NoteKind::Good } else { NoteKind::Bad };
        page.note(kind, if judgement.met { "Met" } else { "Not met" }, &judgement.message);
    }
    page.heading(2, "standstills", "Standstills");
    let errors = || lengths.standstills.iter().map(|length| length.error);
    let points: Vec<(f64, f64)> =
        lengths.standstills.iter().map(|length| (length.reading.number as f64, length.error.value * 1e6)).collect();
    let plot = Plot::new("Length of the output less local gravity", "Number of the standstill", "Error / 1e-6 g0");
    let plot =
        plot.series("Error", Style::Points, points).errors(errors().map(|error| error.interval * 1e6)).zero_line();
    page.figure(&plot.svg(), "Bars: 95 % from the noise of each mean.");
    let rows: Vec<Vec<Cell>> = lengths
        .standstills
        .iter()
        .map(|length| {
            vec![
                Cell::number(length.reading.number as f64, 0),
                Cell::number(length.reading.start_s, 2),
                Cell::number(length.reading.seconds, 2),
                Cell::number(length.force[0], 4),
                Cell::number(length.force[1], 4),
                Cell::number(length.force[2], 4),
                Cell::number(head(length), 3),
                Cell::number(length.error.value * 1e6, 3),
                Cell::number(length.error.interval * 1e6, 3),
            ]
        })
        .collect();
    let header = [
        "Number",
        "Start / s",
        "Length / s",
        "A1 / g0",
        "A2 / g0",
        "A3 / g0",
        "Head telemetry",
        "Error / 1e-6 g0",
        "95 % / 1e-6 g0",
    ];
    page.table("Standstills: specific force along the output axes", &header, &rows);
    page.finish()
}
