//! The sections on ramps: the verdict, the conditions, the loops between heating and cooling, and the search over the
//! time constant.

use super::loops::pictures;
use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use super::quantity::digits;
use isotherm_fit::{BiasTransient, Condition, Prediction, TransientVerdict, Transients, TriadUnits};
use isotherm_statistics::band;

/// The sections but for the [`verdict`], which is on the first screen. `unit` is that of the temperature.
pub(super) fn sections(page: &mut Page, found: &Transients, unit: &str) {
    page.heading(2, "transients", "Transients");
    page.paragraph(
        "Heating and cooling differ where the sensing elements are behind their temperature by a lag, or by hysteresis. A lag has one time constant; hysteresis depends only on the \
         temperature. A transient is written only where the ramps show a lag.",
    );
    found.words.iter().skip(1).for_each(|reason| page.paragraph(reason));
    page.key_values(&time_constant(found));
    biases(page, found, unit);
    conditions(page, found);
    page.heading(3, "transients-loops", "Heating and cooling");
    page.paragraph(
        "Residual of the bias against its temperature, mean of each block: without transient, and with the transient as estimated, whether it is written or not.",
    );
    for bias in &found.biases {
        let units = TriadUnits::of(bias.kind);
        page.figures(&pictures(bias.name(), units.bias_on_page, units.bias_factor, &bias.before, &bias.after));
    }
    search(page, found);
}

/// What was decided; the reasons are in [`sections`].
pub(super) fn verdict(page: &mut Page, found: &Transients) {
    let kind = match found.verdict {
        TransientVerdict::Lag | TransientVerdict::None => NoteKind::Good,
        TransientVerdict::Given | TransientVerdict::Undetermined | TransientVerdict::Hysteresis => NoteKind::Warning,
    };
    page.note(kind, found.words.first().map_or("", String::as_str), "");
}

/// What the biases were, and what they are with their transients.
pub(super) fn before_after(page: &mut Page, found: &Transients) {
    let number = |it: &BiasTransient, value: Option<f64>| {
        let units = TriadUnits::of(it.kind);
        Cell::known(value.map(|value| value * units.bias_factor), units.bias_decimals)
    };
    let factor = |it: &BiasTransient| band(&it.before).zip(band(&it.after)).map(|(before, after)| before / after);
    let columns: [Column<'_, &BiasTransient>; 6] = [
        ("Bias", &|it| Cell::text(it.name())),
        ("Unit", &|it| Cell::text(TriadUnits::of(it.kind).bias_on_page)),
        ("Before", &|it| number(it, band(&it.before))),
        ("After", &|it| number(it, band(&it.after))),
        ("Factor", &|it| Cell::known(factor(it), 1)),
        ("Error of the curve, +-", &|it| number(it, it.curve_error.as_ref().map(|band| band.half_width))),
    ];
    page.columns(
        "Hysteresis band between heating and cooling, without and with the transient",
        &found.biases,
        &columns,
    );
}

fn time_constant(found: &Transients) -> Vec<(&'static str, String)> {
    let tau = &found.time_constant;
    let [low, high] = tau.interval_s;
    let origin = match (tau.given, tau.kept) {
        (true, _) => "given by the user",
        (false, true) => "that of the table in force, which is within the interval",
        (false, false) => "found in the ramps",
    };
    let mut rows = vec![("Time constant", format!("{:.1} s, {origin}", tau.value_s))];
    if !tau.given {
        rows.push(("95 % interval", format!("{low:.1} to {high:.1} s")));
    }
    rows
}

/// The transient of each bias.
fn biases(page: &mut Page, found: &Transients, unit: &str) {
    let number = |it: &BiasTransient, value: f64| {
        let units = TriadUnits::of(it.kind);
        Cell::number(value * units.bias_factor, units.bias_decimals)
    };
    let known = |it: &BiasTransient, value: Option<f64>| number(it, value.unwrap_or(f64::NAN));
    let predicted = |it: &BiasTransient, of: fn(&Prediction) -> f64| known(it, it.prediction.as_ref().map(of));
    let t_tau = |it: &BiasTransient| it.estimate * TriadUnits::of(it.kind).bias_factor * found.time_constant.value_s;
    let columns: [Column<'_, &BiasTransient>; 13] = [
        ("Bias", &|it| Cell::text(it.name())),
        ("Unit", &|it| Cell::text(TriadUnits::of(it.kind).bias_on_page)),
        ("Written", &|it| number(it, it.transient)),
        ("Estimate", &|it| number(it, it.estimate)),
        ("Its error", &|it| number(it, it.standard_error)),
        ("t tau", &|it| Cell::number(t_tau(it), 1)),
        ("Static curve", &|it| predicted(it, |it| it.static_curve)),
        ("Hysteresis", &|it| predicted(it, |it| it.hysteresis)),
        ("Lag and hysteresis", &|it| predicted(it, |it| it.lag_and_hysteresis)),
        ("As written", &|it| predicted(it, |it| it.written)),
        ("Band without", &|it| known(it, band(&it.before))),
        ("Band with", &|it| known(it, band(&it.after))),
        ("Error of the curve", &|it| known(it, it.curve_error.as_ref().map(|band| band.half_width))),
    ];
    let caption = format!(
        "Transients per {unit}, t tau in its unit times seconds per {unit}; rms of sweeps left out, by model; hysteresis band"
    );
    page.columns(&caption, &found.biases, &columns);
}

fn conditions(page: &mut Page, found: &Transients) {
    let limit = |it: &Condition| format!("{} {}", if it.above { "above" } else { "below" }, digits(it.limit, 3));
    let verdict = |it: &Condition| match (it.met, it.decides) {
        (true, _) => Cell::Verdict(NoteKind::Good, "met".to_owned()),
        (false, true) => Cell::Verdict(NoteKind::Bad, "not met".to_owned()),
        (false, false) => Cell::Verdict(NoteKind::Warning, "not met, does not decide".to_owned()),
    };
    let columns: [Column<'_, (&str, &Condition)>; 5] = [
        ("Of", &|(of, _)| Cell::text(*of)),
        ("Condition", &|(_, it)| Cell::text(it.name)),
        ("Figure", &|(_, it)| Cell::Number(digits(it.figure, 3))),
        ("Must be", &|(_, it)| Cell::text(limit(it))),
        ("Result", &|(_, it)| verdict(it)),
    ];
    let of_all = found.conditions.iter().map(|condition| ("time constant", condition));
    let of_biases = found.biases.iter().flat_map(|it| it.conditions.iter().map(|condition| (it.name(), condition)));
    page.columns("Conditions for a transient to be written", of_all.chain(of_biases), &columns);
}

fn search(page: &mut Page, found: &Transients) {
    let tau = &found.time_constant;
    let least = tau.search.iter().map(|(_, objective)| *objective).fold(f64::INFINITY, f64::min);
    let points = tau.search.iter().map(|(s, objective)| (libm::log10(*s), objective - least));
    let plot =
        Plot::new("Search over the time constant", "log10 of the time constant / s", "Objective above its minimum");
    let plot = plot.series("Sum over the biases of n log(SSE/n)", Style::Both, points);
    let svg = plot.marker(libm::log10(tau.value_s), &format!("{:.0} s", tau.value_s)).svg();
    page.figure(&svg, "The best time constant has the least objective. A minimum at an end shows no time constant.");
}
