//! The sections on ramps: the verdict, the conditions, the loops between heating and cooling, and the search over the
//! time constant.

use super::loops::pictures;
use super::page::{Cell, NoteKind, Page};
use super::plot::{Plot, Style};
use isotherm_calibration::{BiasTransient, Condition, TransientVerdict, Transients, TriadUnits};
use isotherm_statistics::band;

/// The sections. `unit` is that of the telemetry.
pub(super) fn sections(page: &mut Page, found: &Transients, unit: &str) {
    page.heading(2, "transients", "Transients");
    page.paragraph(
        "Heating and cooling differ where the sensing elements are behind their telemetry by a lag, or by hysteresis. A lag has one time constant; hysteresis depends on the \
         temperature alone. A transient is written only where the ramps show a lag.",
    );
    let kind = match found.verdict {
        TransientVerdict::Lag | TransientVerdict::None => NoteKind::Good,
        TransientVerdict::Given | TransientVerdict::Undetermined | TransientVerdict::Hysteresis => NoteKind::Warning,
    };
    let mut words = found.words.iter();
    page.note(kind, words.next().map_or("", String::as_str), "");
    words.for_each(|sentence| page.paragraph(sentence));
    page.key_values(&time_constant(found));
    biases(page, found, unit);
    conditions(page, found);
    page.heading(3, "transients-loops", "Heating and cooling");
    page.paragraph(
        "Residual of the bias against its telemetry, mean of each block: without transient, and with the transient as estimated, whether it is written or not.",
    );
    for bias in &found.biases {
        let units = TriadUnits::of(bias.kind);
        page.figures(&pictures(bias.name(), units.bias_on_page, units.bias_factor, &bias.before, &bias.after));
    }
    search(page, found);
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

fn biases(page: &mut Page, found: &Transients, unit: &str) {
    let row = |bias: &BiasTransient| {
        let units = TriadUnits::of(bias.kind);
        let decimals = units.bias_decimals;
        let number = |value: f64| Cell::number(value * units.bias_factor, decimals);
        let known = |value: Option<f64>| number(value.unwrap_or(f64::NAN));
        let prediction = |of: fn(&isotherm_calibration::Prediction) -> f64| known(bias.prediction.as_ref().map(of));
        vec![
            Cell::text(bias.name()),
            Cell::text(units.bias_on_page),
            number(bias.transient),
            number(bias.estimate),
            number(bias.standard_error),
            Cell::number(bias.estimate * units.bias_factor * found.time_constant.value_s, 1),
            prediction(|it| it.static_curve),
            prediction(|it| it.hysteresis),
            prediction(|it| it.lag_and_hysteresis),
            prediction(|it| it.written),
            known(band(&bias.before)),
            known(band(&bias.after)),
        ]
    };
    let header = [
        "Bias",
        "Unit",
        "Written",
        "Estimate",
        "Its error",
        "t tau",
        "Static curve",
        "Hysteresis",
        "Lag and hysteresis",
        "As written",
        "Band without",
        "Band with",
    ];
    page.table(
        &format!(
            "Transients per {unit}, t tau in its unit times seconds per {unit}; rms of sweeps left out, by model; hysteresis band"
        ),
        &header,
        &found.biases.iter().map(row).collect::<Vec<_>>(),
    );
}

fn conditions(page: &mut Page, found: &Transients) {
    let row = |of: &str, condition: &Condition| {
        let verdict = match (condition.met, condition.decides) {
            (true, _) => Cell::Verdict(NoteKind::Good, "met".to_owned()),
            (false, true) => Cell::Verdict(NoteKind::Bad, "not met".to_owned()),
            (false, false) => Cell::Verdict(NoteKind::Warning, "not met, does not decide".to_owned()),
        };
        let side = if condition.above { "above" } else { "below" };
        let figure = |value: f64| if value.is_finite() { format!("{value:.3}") } else { "–".to_owned() };
        vec![
            Cell::text(of),
            Cell::text(condition.name),
            // Biases differ by many powers of ten.
            Cell::Number(if condition.name == "matters" {
                format!("{:.2e}", condition.figure)
            } else {
                figure(condition.figure)
            }),
            Cell::text(if condition.name == "matters" {
                format!("{side} {:e}", condition.limit)
            } else {
                format!("{side} {}", figure(condition.limit))
            }),
            verdict,
        ]
    };
    let all = found.conditions.iter().map(|condition| row("time constant", condition));
    let of_biases =
        found.biases.iter().flat_map(|bias| bias.conditions.iter().map(|condition| row(bias.name(), condition)));
    let rows: Vec<_> = all.chain(of_biases).collect();
    page.table("Conditions for a transient to be written", &["Of", "Condition", "Figure", "Must be", ""], &rows);
}

fn search(page: &mut Page, found: &Transients) {
    let tau = &found.time_constant;
    let least = tau.search.iter().map(|(_, objective)| *objective).fold(f64::INFINITY, f64::min);
    let points = tau.search.iter().map(|(s, objective)| (s.log10(), objective - least));
    let plot =
        Plot::new("Search over the time constant", "log10 of the time constant / s", "Objective above its minimum");
    let plot = plot.series("Sum over the biases of n log(SSE/n)", Style::Both, points);
    let svg = plot.marker(tau.value_s.log10(), &format!("{:.0} s", tau.value_s)).svg();
    page.figure(&svg, "The best time constant has the least objective. A minimum at an end shows no time constant.");
}
