//! The report of a verification: the paper's table 4 and figure 6 for a recording.

use super::navigation;
use super::page::{Cell, NoteKind, Page};
use super::plot::{Plot, Style};
use crate::requirement::Requirement;
use crate::stability::{Force, Stability, Window};
use crate::verdict::{Errors, Estimate};
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable};

/// What the report states besides the table and the stability; only the caller knows it.
#[derive(Clone, Debug)]
pub struct VerificationSource {
    /// Program and version.
    pub tool: String,
    /// Time of the verification as RFC 3339 in UTC.
    pub time: String,
    /// Name of the table file.
    pub table: String,
    /// Name of the recording.
    pub recording: String,
    /// Length of the windows \[s\].
    pub window_s: f64,
    /// What is required, if there is a requirement.
    pub required: Option<Requirement>,
}

/// The page as HTML.
#[must_use]
pub fn html(table: &CoefficientTable, stability: &Stability, source: &VerificationSource) -> String {
    let title = format!("Verification of {}", table.content().imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", source.recording, source.time, source.tool));
    result(&mut page, table, stability, source);
    verdict(&mut page, stability);
    figures(&mut page, table, stability);
    length(&mut page, table, stability);
    budget(&mut page, table, stability);
    page.heading(2, "provenance", "Provenance");
    page.key_values(&[
        ("Tool", source.tool.clone()),
        ("Time", source.time.clone()),
        ("Table file", source.table.clone()),
        ("Table", table.digest().to_string()),
        ("Recording", source.recording.clone()),
        ("Windows", format!("{} s, {} in all", source.window_s, stability.windows.len())),
    ]);
    page.finish()
}

fn result(page: &mut Page, table: &CoefficientTable, stability: &Stability, source: &VerificationSource) {
    page.heading(2, "result", "Stability");
    for judgement in source.required.iter().flat_map(|required| required.judge(stability)) {
        let (kind, word) =
            if judgement.met { (NoteKind::Good, "Requirement met") } else { (NoteKind::Bad, "Requirement missed") };
        let remedy = judgement.remedy.map(|remedy| format!(" ({remedy})")).unwrap_or_default();
        page.note(kind, word, &(judgement.message + &remedy));
    }
    let flagged = stability.windows.iter().filter(|window| window.flagged).count();
    if flagged > 0 {
        let text =
            format!("In {flagged} windows samples are flagged: telemetry out of the table's range, or not plausible.");
        page.note(NoteKind::Warning, "Flagged samples", &text);
    }
    if let Some(reason) = stability.nothing_claimed().filter(|_| source.required.is_none()) {
        page.note(NoteKind::Bad, "Nothing can be claimed", &format!("Look at this: {reason}."));
    }
    if let Some([missing, remedy]) = stability.verdict.missing() {
        page.note(NoteKind::Warning, "Not all is judged", &format!("{missing}; {remedy}"));
    }
    if let Some(warning) = stability.interval_warning() {
        page.note(NoteKind::Warning, "Intervals", &warning);
    }
    if stability.stated && table.content().alignment.is_none() {
        let text =
            "The table has no alignment matrix: the rms about zero includes what misalignments make of this attitude.";
        page.note(NoteKind::Warning, "Misalignments count", text);
    }
    let rows: Vec<_> = AXIS_NAMES
        .iter()
        .zip(&stability.axes)
        .map(|(name, axis)| {
            vec![
                Cell::text(*name),
                Cell::number(axis.factor(), 2),
                Cell::number(axis.sd_before * 1e6, 3),
                Cell::number(axis.sd_after * 1e6, 3),
                Cell::number(axis.rms_before * 1e6, 3),
                Cell::number(axis.rms_after * 1e6, 3),
            ]
        })
        .collect();
    let header = ["Axis", "Factor", "sd before", "sd after", "rms before", "rms after"];
    let caption = format!("Means over {} s of output less specific force [1e-6 g0]", source.window_s);
    page.table(&caption, &header, &rows);
    page.paragraph(
        "Before: the coefficients frozen at the run's mid temperature. After: the full model. sd: about the mean; rms: about zero. \
         Factor: sd before over sd after.",
    );
    let middle = stability.middle.map(|[head, board]| format!("{head:.4}, {board:.4}")).join("; ");
    page.key_values(&[
        ("Specific force", Force(stability.specific_force).to_string()),
        ("Frozen at head, board", format!("{middle} {}", table.content().temperature_unit)),
        ("Covered", stability.covered.to_string()),
        ("Windows at this attitude", format!("{} of {}", counted(stability).count(), stability.windows.len())),
    ]);
}

/// The errors with their intervals, and the largest of them in words.
fn verdict(page: &mut Page, stability: &Stability) {
    page.heading(2, "verdict", "Verdict");
    let verdict = &stability.verdict;
    let text = if stability.nothing_claimed().is_some() {
        "Nothing can be claimed, see above.".to_owned()
    } else {
        verdict.conclusion()
    };
    page.paragraph(&text);
    let estimate = |estimate: Estimate| format!("{:.3} ± {:.3}", estimate.value * 1e6, estimate.interval * 1e6);
    let length = verdict.length.iter().map(|errors| ("length", errors));
    let errors = AXIS_NAMES.iter().copied().zip(&verdict.axes).chain(length).chain([("level", &verdict.level)]);
    let rows: Vec<_> = errors
        .map(|(name, errors)| {
            vec![
                Cell::text(name),
                Cell::Number(errors.constant.map_or_else(|| "not judged".to_owned(), estimate)),
                Cell::Number(estimate(errors.variation)),
                Cell::Number(estimate(errors.worst)),
                Cell::number(errors.noise * 1e6, 3),
                Cell::number(errors.largest_window * 1e6, 3),
            ]
        })
        .collect();
    let header = ["", "constant", "largest variation", "worst", "noise of a window", "largest window"];
    let caption = format!(
        "Errors of the full model, {} groups of {} windows [1e-6 g0, level 1e-6 rad]",
        verdict.groups, verdict.windows
    );
    page.table(&caption, &header, &rows);
    page.paragraph(
        "Constant: the mean over the run. Variation: of the mean of a group of windows about it. Worst: the largest mean of a group. \
         Intervals: 95 %; that of constant from slow changes of the run too, those of variation and worst from the noise, for all groups at once.",
    );
    page.key_values(&[("Local gravity", stability.gravity_source.to_string())]);
}

fn counted(stability: &Stability) -> impl Iterator<Item = &Window> + Clone {
    stability.windows.iter().filter(|window| window.counts)
}

/// Figure 6 of the paper.
fn figures(page: &mut Page, table: &CoefficientTable, stability: &Stability) {
    page.heading(2, "output", "Output before and after");
    let head = format!("Head telemetry / {}", table.content().temperature_unit);
    let drift = format!("dU/dt of the head / ({} per h)", table.content().temperature_unit);
    let force = stability.specific_force;
    type WindowView<'a> = (&'a str, &'a str, &'a dyn Fn(&Window, usize) -> f64, Style);
    let views: [WindowView<'_>; 2] = [
        ("over time", "Time / h", &|window, _| window.time_s / 3600.0, Style::Line),
        ("over temperature", &head, &|window, axis| window.head[axis], Style::Points),
    ];
    let (mut both, mut after, mut rates) = (Vec::new(), Vec::new(), Vec::new());
    for (title, label, x, style) in views {
        for (axis, name) in AXIS_NAMES.iter().enumerate() {
            let line = |of: fn(&Window) -> &[f64; 3]| -> Vec<(f64, f64)> {
                counted(stability).map(|window| (x(window, axis), (of(window)[axis] - force[axis]) * 1e6)).collect()
            };
            let plot = |title: String| Plot::new(&title, label, "Error / 1e-6 g0").zero_line();
            let plot_both =
                plot(format!("{name} {title}")).series("Before", Style::Line, line(|window| &window.before));
            both.push((plot_both.series("After", Style::Line, line(|window| &window.after)).svg(), String::new()));
            let plot_after = plot(format!("{name} after, {title}"));
            after.push((plot_after.series("After", style, line(|window| &window.after)).svg(), String::new()));
        }
    }
    for (axis, name) in AXIS_NAMES.iter().enumerate() {
        let windows: Vec<_> = counted(stability).collect();
        let rate = |pair: &[&Window]| {
            let seconds = pair[1].time_s - pair[0].time_s;
            let error = 0.5 * (pair[0].after[axis] + pair[1].after[axis]) - force[axis];
            ((pair[1].head[axis] - pair[0].head[axis]) / seconds * 3600.0, error * 1e6)
        };
        // dU/dt is taken over at least a minute; over a shorter time the telemetry's noise hides it.
        let step = (60.0 / windows.first().map_or(60.0, |window| window.seconds)).ceil().max(1.0) as usize;
        let thinned: Vec<_> = windows.iter().copied().step_by(step).collect();
        let points: Vec<_> = thinned.windows(2).map(rate).collect();
        let plot = Plot::new(&format!("{name} after, against drift"), &drift, "Error / 1e-6 g0").zero_line();
        rates.push((plot.series("After", Style::Points, points).svg(), String::new()));
    }
    page.figures(&both);
    page.heading(3, "after", "What is left");
    page.figures(&after);
    page.heading(3, "drift", "What is left, against dU/dt");
    page.figures(&rates);
    page.paragraph("A trend against dU/dt means that heads or boards lag behind their telemetry.");
}

fn length(page: &mut Page, table: &CoefficientTable, stability: &Stability) {
    page.heading(2, "gravity", "Length of the output against gravity");
    let Some(Errors { constant: Some(constant), largest_window, .. }) = stability.verdict.length else {
        page.paragraph("The IMU was never still, or local gravity is unknown: the length of the output is not judged.");
        return;
    };
    let points = stability.windows.iter().filter(|window| window.still);
    let points: Vec<_> =
        points.map(|window| (window.time_s / 3600.0, (window.length() - stability.gravity) * 1e6)).collect();
    let count = points.len().to_string();
    let plot = Plot::new("Length of the output less gravity", "Time / h", "Difference / 1e-6 g0").zero_line();
    page.figure(
        &plot.series("Still windows", Style::Line, points).svg(),
        "Needs no turntable: at rest the three outputs together are as long as gravity.",
    );
    page.key_values(&[
        ("Still windows", count),
        ("Constant", format!("{:.3}e-6 g0", constant.value * 1e6)),
        ("Largest window", format!("{:.3}e-6 g0", largest_window * 1e6)),
    ]);
    if table.content().alignment.is_none() {
        page.note(
            NoteKind::Warning,
            "Misalignments are part of it",
            "The table has no alignment matrix: 1e-4 rad may count for as much as 1e-4 g0 here.",
        );
    }
}

fn budget(page: &mut Page, table: &CoefficientTable, stability: &Stability) {
    page.heading(2, "budget", "Error budget in navigation units");
    let mut rows = Vec::new();
    for (index, axis) in table.content().axes.iter().enumerate() {
        let name = AXIS_NAMES[index];
        rows.push(navigation(&format!("{name} what is left, rms about zero"), stability.axes[index].rms_after));
        let [head, board] = stability.resolution[index];
        // Change of a value by one step of the telemetry, where the curve is steepest in the run.
        let steepest = |value: &dyn Fn(f64) -> f64, of: fn(&Window) -> &[f64; 3], step: f64| {
            let change = |window: &Window| (value(of(window)[index] + step) - value(of(window)[index])).abs();
            counted(stability).map(change).fold(0.0, f64::max)
        };
        if let Some(step) = head {
            let change = steepest(&|u| axis.bias_at(u).0, |window| &window.head, step);
            rows.push(navigation(&format!("{name} one step of head telemetry ({step:.2e}), bias"), change));
        }
        if let Some(step) = board {
            let relative =
                |u: f64| axis.positive_scale_factor_at(u).0.ln().max((-axis.negative_scale_factor_at(u).0).ln());
            let change = steepest(&relative, |window| &window.board, step);
            rows.push(navigation(&format!("{name} one step of board telemetry ({step:.2e}), K at 1 g0"), change));
        }
    }
    page.table("Errors and what they cost", &super::NAVIGATION, &rows);
}
