//! The report of a verification: the paper's table 4 and figure 6 for a recording.

use super::loops::pictures;
use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use super::quantity::sentence;
use super::shown::{DEGREES_PER_HOUR, FLAGGED, FigureFormat, MICRO_G0, RANDOM_WALK, SOAKED, named_errors};
use crate::parts::{NAVIGATION, file_names, navigation, own_recording};
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{BINS, largest};
use isotherm_verification::{
    AxisStability, Errors, Estimate, Force, GyroscopeStability, LoopBand, Loops, Requirement, Stability, Window,
};

/// What the report states in addition to the table and the stability; only the caller knows it.
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
    let mut page = Page::new(&title, &format!("{} · {} · {}", file_names(&source.recording), source.time, source.tool));
    result(&mut page, table, stability, source);
    figures(&mut page, table, stability);
    page.heading(2, "loops", "Heating and cooling");
    hysteresis(&mut page, AXIS_NAMES, &stability.loops, stability.unsettled_s, MICRO_G0);
    length(&mut page, table, stability);
    budget(&mut page, table, stability);
    gyroscopes(&mut page, table, stability);
    measurement(&mut page, table, stability);
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
    own_recording(page, stability.made_the_table);
    page.paragraph(&headline(stability));
    let gyroscopes = stability.gyroscopes.as_ref().and_then(|found| found.as_ref().ok());
    gyroscopes.iter().for_each(|found| page.paragraph(&found.conclusion()));
    for judgement in source.required.iter().flat_map(|required| required.judge(stability)) {
        let (kind, word) =
            if judgement.met { (NoteKind::Good, "Requirement met") } else { (NoteKind::Bad, "Requirement missed") };
        let remedy = judgement.remedy.map(|remedy| format!(" ({remedy})")).unwrap_or_default();
        page.note(kind, word, &(judgement.message + &remedy));
    }
    warnings(page, table, stability, source.required.is_none());
    let caption = format!("Means over {} s of output less specific force [1e-6 g0]", source.window_s);
    figures_table(page, &caption, AXIS_NAMES, &stability.axes, MICRO_G0);
    if let Some(found) = gyroscopes {
        gyroscope_figures(page, found, source.window_s);
    }
    let rows: Vec<_> = named_errors(stability).map(|(name, errors)| errors_row(name, errors, MICRO_G0)).collect();
    let verdict = &stability.verdict;
    let caption = format!(
        "Errors of the full model with 95 % intervals, {} groups of {} windows [1e-6 g0], level in urad",
        verdict.groups, verdict.windows
    );
    page.compact_table(&caption, &ERRORS_HEADER, rows);
}

/// What was measured, and what the figures are.
fn measurement(page: &mut Page, table: &CoefficientTable, stability: &Stability) {
    page.heading(2, "measurement", "Measurement");
    page.paragraph(
        "Before: the coefficients frozen at the run's mid temperature. After: the full model. sd: about the mean; rms: about zero. \
         Factor: sd before over sd after.",
    );
    page.paragraph(
        "Constant: the mean over the run. Variation: of the mean of a group of windows about it. Worst: the largest mean of a group. \
         Intervals: 95 %; that of constant from slow changes of the run too, those of variation and worst from the noise, for all groups at once.",
    );
    page.key_values(&[
        ("Windows", stability.judged_windows()),
        ("Windows at this attitude", format!("{} of {}", counted(stability).count(), stability.windows.len())),
        ("Specific force", Force(stability.specific_force).to_string()),
        ("Local gravity", stability.gravity_source.to_string()),
        ("Frozen at head, board", frozen_at(&stability.middle, table)),
        ("Covered", stability.covered.to_string()),
    ]);
}

/// What the output was, what it is, and by how much it is off, for the axis with the least factor.
fn headline(stability: &Stability) -> String {
    let axes = AXIS_NAMES.iter().zip(&stability.axes);
    let Some((name, axis)) = axes.min_by(|(_, a), (_, b)| a.factor().total_cmp(&b.factor())) else {
        return String::new();
    };
    let [before, after] = [axis.sd_before, axis.sd_after].map(|sd| sd * 1e6);
    let factor = axis.factor();
    let conclusion = match stability.nothing_claimed() {
        Some(_) => "Nothing can be claimed, see below.".to_owned(),
        None => stability.verdict.conclusion(),
    };
    format!(
        "With coefficients frozen at mid temperature the output of {name} varies by {before:.1}e-6 g0, with the table by {after:.2}e-6 g0: \
         {factor:.1} times less, and of the other axes at least as much. {conclusion}"
    )
}

/// What is to be known before the figures are used. Where nothing is `required`, also that nothing can be claimed.
fn warnings(page: &mut Page, table: &CoefficientTable, stability: &Stability, nothing_required: bool) {
    let flagged = Some(stability.windows.iter().filter(|window| window.flagged).count()).filter(|count| *count > 0);
    warn(page, "Flagged samples", flagged.map(|count| format!("In {count} windows samples are flagged: {FLAGGED}.")));
    if let Some(reason) = stability.nothing_claimed().filter(|_| nothing_required) {
        page.note(NoteKind::Bad, "Nothing can be claimed", &sentence(&reason));
    }
    let hole = stability.covered.hole().map(|hole| format!("No judged window is in {hole}: no error shows there."));
    warn(page, "Not covered", hole);
    warn(page, "Not all is judged", stability.verdict.missing().map(|parts| parts.join("; ")));
    warn(page, "Time", stability.time_fault.map(|fault| format!("{fault}; {}", stability.losses)));
    warn(page, "Intervals", stability.interval_warning());
    warn(page, "Attitude", stability.attitude_warning());
    let misaligned =
        "The table has no alignment matrix: the rms about zero includes what misalignments make of this attitude.";
    let counts = stability.stated && table.content().alignment.is_none();
    warn(page, "Misalignments count", counts.then(|| misaligned.to_owned()));
}

fn warn(page: &mut Page, title: &str, text: Option<String>) {
    text.iter().for_each(|text| page.note(NoteKind::Warning, title, &sentence(text)));
}

fn counted(stability: &Stability) -> impl Iterator<Item = &Window> + Clone {
    stability.windows.iter().filter(|window| window.counts)
}

/// The temperature at which the coefficients are frozen.
fn frozen_at(middle: &[[f64; 2]; AXES], table: &CoefficientTable) -> String {
    let middle = middle.map(|[head, board]| format!("{head:.4}, {board:.4}")).join("; ");
    format!("{middle} {}", table.content().temperature_unit)
}

/// Table 4 of the paper for a triad.
fn figures_table(
    page: &mut Page,
    caption: &str,
    names: [&str; AXES],
    axes: &[AxisStability; AXES],
    shown: FigureFormat,
) {
    let number = |figure: f64| Cell::number(figure * shown.factor, shown.places);
    let columns: [Column<'_, (&str, &AxisStability)>; 6] = [
        ("Axis", &|(name, _)| Cell::text(*name)),
        ("sd before", &|(_, axis)| number(axis.sd_before)),
        ("sd after", &|(_, axis)| number(axis.sd_after)),
        ("Factor", &|(_, axis)| Cell::number(axis.factor(), 2)),
        ("rms before", &|(_, axis)| number(axis.rms_before)),
        ("rms after", &|(_, axis)| number(axis.rms_after)),
    ];
    page.columns(caption, names.into_iter().zip(axes), &columns);
}

const ERRORS_HEADER: [&str; 6] =
    ["Error of", "constant", "largest variation", "worst", "noise of a window", "largest window"];

/// A value with its interval.
fn estimate(it: Estimate, FigureFormat { factor, places, .. }: FigureFormat) -> Cell {
    Cell::Number(format!("{:.places$} ± {:.places$}", it.value * factor, it.interval * factor))
}

fn errors_row(name: &str, errors: &Errors, shown: FigureFormat) -> Vec<Cell> {
    let FigureFormat { factor, places, .. } = shown;
    vec![
        Cell::text(name),
        errors.constant.map_or_else(|| Cell::Number("not judged".to_owned()), |it| estimate(it, shown)),
        estimate(errors.variation, shown),
        estimate(errors.worst, shown),
        Cell::number(errors.noise * factor, places),
        Cell::number(errors.largest_window * factor, places),
    ]
}

/// The windows of a triad, as the figures show them.
struct TriadView<'a> {
    names: [&'static str; AXES],
    /// Those that count.
    windows: Vec<&'a Window>,
    /// What the output should be.
    right: [f64; AXES],
    shown: FigureFormat,
}

/// The gyroscopes, if there are any.
fn gyroscopes(page: &mut Page, table: &CoefficientTable, stability: &Stability) {
    let found = match &stability.gyroscopes {
        Some(Ok(found)) => found,
        Some(Err(reason)) => {
            page.heading(2, "gyroscopes", "Gyroscopes");
            return page.note(NoteKind::Warning, "Not judged", reason);
        }
        None => return,
    };
    page.heading(2, "gyroscopes", "Gyroscopes");
    warn(page, "Not all is judged", found.missing().map(|parts| parts.join("; ")));
    let misaligned =
        "The table has no alignment matrix of the gyroscopes: what misalignments make of Earth's rate counts.";
    warn(page, "Misalignments count", (!found.aligned).then(|| misaligned.to_owned()));
    gyroscope_errors(page, found);
    let view = TriadView {
        names: GYROSCOPE_NAMES,
        windows: found.windows.iter().filter(|window| window.counts).collect(),
        right: found.subtracted,
        shown: DEGREES_PER_HOUR,
    };
    let earth_rate = found.earth_rate.map_or_else(|| "not known".to_owned(), |earth_rate| earth_rate.to_string());
    page.key_values(&[
        ("Earth's rate", earth_rate),
        ("Frozen at head, board", frozen_at(&found.middle, table)),
        ("Covered", found.covered.to_string()),
        ("Windows at rest", format!("{} of {}", view.windows.len(), found.windows.len())),
    ]);
    for plots in error_figures(&view, &table.content().temperature_unit) {
        page.plots(&plots);
    }
    page.heading(3, "gyroscope-loops", "Heating and cooling");
    hysteresis(page, GYROSCOPE_NAMES, &found.loops, stability.unsettled_s, DEGREES_PER_HOUR);
}

/// The figures of the gyroscopes.
fn gyroscope_figures(page: &mut Page, found: &GyroscopeStability, window_s: f64) {
    let what = if found.earth_rate.is_some() { "Earth's rate" } else { "its median" };
    let caption = format!("Means over {window_s} s of output less {what} [deg/h]");
    figures_table(page, &caption, GYROSCOPE_NAMES, &found.axes, DEGREES_PER_HOUR);
}

/// The errors of the gyroscopes.
fn gyroscope_errors(page: &mut Page, found: &GyroscopeStability) {
    let rows = GYROSCOPE_NAMES.iter().zip(&found.errors).zip(found.random_walk).map(|((name, errors), walk)| {
        let mut row = errors_row(name, errors, DEGREES_PER_HOUR);
        row.push(estimate(walk, RANDOM_WALK));
        row
    });
    let caption =
        format!("Errors of the full model, {} groups of {} windows [deg/h]", found.groups, found.windows_in_group);
    let header: Vec<_> = ERRORS_HEADER.into_iter().chain(["random walk / (deg/sqrt(h))"]).collect();
    page.compact_table(&caption, &header, rows.collect());
    page.paragraph(
        "As for the accelerometers. The intervals of constant and worst contain the errors of Earth's rate. Random walk: noise of a window times the \
         root of its length, rounding of the pulses included.",
    );
}

/// The hysteresis bands of a triad with their loops, where the run shows them.
fn hysteresis(page: &mut Page, names: [&str; AXES], loops: &Loops, unsettled_s: Option<f64>, shown: FigureFormat) {
    let band = |axis: &usize| loops.band(*axis).ok();
    let number = |value: Option<f64>| value.map(|it| format!("{:.*}", shown.places, it * shown.factor));
    let judged = |text: Option<String>| Cell::Number(text.unwrap_or_default());
    let of_static = |band: LoopBand| number(band.static_model).unwrap_or_else(|| "no lag".to_owned());
    let columns: [Column<'_, usize>; 5] = [
        ("Axis", &|axis| Cell::text(names[*axis])),
        ("Static model", &|axis| judged(band(axis).map(of_static))),
        ("Full model", &|axis| judged(number(band(axis).map(|band| band.full)))),
        ("Bins", &|axis| judged(band(axis).map(|band| format!("{} of {BINS}", band.bins)))),
        ("Remark", &|axis| {
            Cell::text(loops.band(*axis).err().map_or_else(String::new, |why| format!("not judged: {why}")))
        }),
    ];
    page.columns(&format!("Hysteresis band [{}]", shown.unit), 0..AXES, &columns);
    page.paragraph(
        "The error in heating less that in cooling, rms over those of 12 bins of temperature that have both. The static model is the table without its \
         transients. Lag, hysteresis and a drift with time all open the loop.",
    );
    if let Some(seconds) = unsettled_s {
        page.paragraph(&format!("The first {seconds} s are left out, 3 time constants: {SOAKED}."));
    }
    let figures = (0..AXES).filter(|axis| loops.band(*axis).is_ok()).flat_map(|axis| {
        let full = &loops.full[axis];
        let static_model = loops.static_model.as_ref().map_or(full, |points| &points[axis]);
        pictures(names[axis], shown.unit, shown.factor, static_model, full)
    });
    let figures: Vec<_> = figures.collect();
    if !figures.is_empty() {
        page.figures(&figures);
    }
}

/// Figure 6 of the paper.
fn figures(page: &mut Page, table: &CoefficientTable, stability: &Stability) {
    page.heading(2, "output", "Output before and after");
    let view = TriadView {
        names: AXIS_NAMES,
        windows: counted(stability).collect(),
        right: stability.specific_force,
        shown: MICRO_G0,
    };
    let [both, after, rates] = error_figures(&view, &table.content().temperature_unit);
    page.plots(&both);
    page.heading(3, "after", "What is left");
    page.plots(&after);
    page.heading(3, "drift", "What is left, against dU/dt");
    page.plots(&rates);
    page.paragraph("A trend against dU/dt means that heads or boards lag behind their temperature.");
}

/// The errors before and after, only those after, and those after against the drift; each over time, then over
/// temperature, by sensor.
fn error_figures(view: &TriadView<'_>, temperature_unit: &str) -> [Vec<Plot>; 3] {
    let head = format!("Head temperature / {temperature_unit}");
    let (mut both, mut after) = (Vec::new(), Vec::new());
    type WindowView<'a> = (&'a str, &'a str, &'a dyn Fn(&Window, usize) -> f64, Style);
    let views: [WindowView<'_>; 2] = [
        ("over time", "Time / h", &|window, _| window.time_s / 3600.0, Style::Line),
        ("over temperature", &head, &|window, axis| window.head[axis], Style::Points),
    ];
    for (title, x_label, x, style) in views {
        for (axis, name) in view.names.iter().enumerate() {
            let line = |of: fn(&Window) -> &[f64; 3]| {
                view.windows.iter().map(move |window| (x(window, axis), view.error(of(window)[axis], axis)))
            };
            let plot = view.plot(&format!("{name} {title}"), x_label);
            let plot = plot.series("Before", Style::Line, line(|window| &window.before));
            both.push(plot.series("After", Style::Line, line(|window| &window.after)));
            let plot = view.plot(&format!("{name} after, {title}"), x_label);
            after.push(plot.series("After", style, line(|window| &window.after)));
        }
    }
    [both, after, view.drift_figures(&format!("dU/dt of the head / ({temperature_unit} per h)"))]
}

impl TriadView<'_> {
    fn error(&self, value: f64, axis: usize) -> f64 {
        (value - self.right[axis]) * self.shown.factor
    }

    fn plot(&self, title: &str, x_label: &str) -> Plot {
        Plot::new(title, x_label, &format!("Error / {}", self.shown.unit)).zero_line()
    }

    /// The errors after against dU/dt, by sensor.
    fn drift_figures(&self, x_label: &str) -> Vec<Plot> {
        // dU/dt is taken over at least a minute; over a shorter time the temperature's noise hides it.
        let step = (60.0 / self.windows.first().map_or(60.0, |window| window.seconds)).ceil().max(1.0) as usize;
        let thinned: Vec<_> = self.windows.iter().copied().step_by(step).collect();
        let figure = |(axis, name): (usize, &&str)| {
            let rate = |pair: &[&Window]| {
                let seconds = pair[1].time_s - pair[0].time_s;
                let error = self.error(0.5 * (pair[0].after[axis] + pair[1].after[axis]), axis);
                ((pair[1].head[axis] - pair[0].head[axis]) / seconds * 3600.0, error)
            };
            let plot = self.plot(&format!("{name} after, against drift"), x_label);
            plot.series("After", Style::Points, thinned.windows(2).map(rate))
        };
        self.names.iter().enumerate().map(figure).collect()
    }
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
        // Change of a value by one step of the temperature, where the curve is steepest in the run.
        let steepest = |value: &dyn Fn(f64) -> f64, of: fn(&Window) -> &[f64; 3], step: f64| {
            let change = |window: &Window| (value(of(window)[index] + step) - value(of(window)[index])).abs();
            largest(counted(stability).map(change))
        };
        if let Some(step) = head {
            let change = steepest(&|u| axis.bias_at(u).0, |window| &window.head, step);
            rows.push(navigation(&format!("{name} one step of head temperature ({step:.2e}), bias"), change));
        }
        if let Some(step) = board {
            let relative = |u: f64| {
                libm::log(axis.positive_scale_factor_at(u).0).max(libm::log(-axis.negative_scale_factor_at(u).0))
            };
            let change = steepest(&relative, |window| &window.board, step);
            rows.push(navigation(&format!("{name} one step of board temperature ({step:.2e}), K at 1 g0"), change));
        }
    }
    page.compact_table("Errors and what they cost", &NAVIGATION, rows);
}
