//! A calibration at one attitude as text, as JSON and as HTML.

use crate::findings::findings;
use crate::json::transients::TransientsView;
use crate::page::{Cell, NoteKind, Page};
use crate::parts::{CURVE_INTERVALS, grid, never_shown, provenance};
use crate::plot::{Plot, Style};
use crate::quantity::digits;
use crate::text::{transients, within};
use crate::view::{value, view};
use isotherm_campaign::Campaign;
use isotherm_fit::{
    BEHIND_S, BadKind, BiasCurve, CampaignSource, LagChoice, LeftOutPart, OrderChoice, RowAccount, Spread, SweepPoint,
    TriadUnits, TriedOrder, WarmUpCalibration,
};
use isotherm_recording::Losses;
use isotherm_shared::polynomial::Polynomial;
use serde_json::Value;

/// A calibration in a few lines: the error of the curves, then what they leave.
#[must_use]
pub fn text(calibration: &WarmUpCalibration) -> String {
    let content = calibration.table().content();
    let unit = &content.temperature_unit;
    let mut text = format!(
        "{}\n{}, digest {}\n\nnot known:\n",
        calibration.accuracy(),
        order_words(&calibration.order),
        calibration.table().digest()
    );
    calibration.not_known().iter().for_each(|sentence| text += &format!("  {sentence}\n"));
    text.push('\n');
    text.extend(within(calibration.ramps.transients.losses, "the recordings"));
    text += &left_out(calibration);
    text += &format!("over temperature: means of bins of {} {unit}, about their mean:\n", shown(calibration.bin));
    let names = calibration.biases.iter().flat_map(|bias| &bias.on_board).map(|it| it.name.chars().count() + 4);
    let width = names.fold(12, usize::max);
    let line = |cells: [&str; 8]| {
        let [name, unit, before, most, after, left, band, other] = cells;
        format!("  {name:<width$}{unit:<6}{before:>12}{most:>12}{after:>12}{left:>12}{band:>12}   {other}\n")
    };
    text += &line(["", "", "before: std", "largest", "after: std", "largest", "band +-", "after, band"]);
    for bias in &calibration.biases {
        let units = TriadUnits::of(bias.kind);
        let si = |value: f64| shown(units.si(value, content.gravity).0);
        let in_unit = |value: f64| shown(value * units.bias_factor);
        let band = bias.band.as_ref().map(|band| band.half_width);
        let known = |value: Option<String>| value.unwrap_or_else(|| "not known".to_owned());
        let other = format!("{} {}, {}", in_unit(bias.after.sd), units.bias, known(band.map(in_unit)));
        let row = |name: &str, after: Spread, band: &str, other: &str| {
            let [before, most] = [bias.before.sd, bias.before.largest].map(si);
            let [sd, left] = [after.sd, after.largest].map(si);
            line([name, units.si(0.0, 1.0).1, &before, &most, &sd, &left, band, other])
        };
        text += &row(bias.name(), bias.after, &known(band.map(si)), &other);
        for (autopilot, _, spread) in &bias.beside {
            text += &row(&format!("  {}", autopilot.title()), *spread, "-", "");
        }
        for on_board in &bias.on_board {
            text += &row(&format!("  {}", on_board.name), on_board.after, "-", "");
        }
    }
    if has_lag(calibration) {
        text.push('\n');
        text += &transients(&calibration.ramps.transients, unit);
    }
    text
}

/// Whether a lag was looked for. If not, as for an autopilot's parameters, no transient is written, and none is a
/// result.
fn has_lag(calibration: &WarmUpCalibration) -> bool {
    calibration.options.lag != LagChoice::None
}

/// What was left out of the recordings, a line each; nothing where all is used.
fn left_out(calibration: &WarmUpCalibration) -> String {
    let mut text = String::new();
    for account in &calibration.rows {
        let parts = [account.left_out_words(), account.bad_words()];
        for words in parts.iter().filter(|words| !words.is_empty()) {
            text += &format!("left out of {}: {words}\n", account.recording);
        }
    }
    text
}

/// How the order was found, in words.
fn order_words(order: &OrderChoice) -> String {
    let how = match (order.given, order.order, order.sweeps_left_out) {
        (true, ..) => "given",
        (_, 4.., _) => "which predicts sweeps left out better than a cubic",
        (_, 3, _) => "the autopilots' cubic",
        _ => "the highest that the temperature determines",
    };
    format!("order {}, {how}", order.order)
}

/// Three digits.
fn shown(value: f64) -> String {
    let before = libm::log10(value.abs().max(1e-12)).floor();
    format!("{value:.*}", (2.0 - before).clamp(0.0, 9.0) as usize)
}

/// A calibration as JSON. `locate` gives file and line of a row.
#[must_use]
pub fn json(calibration: &WarmUpCalibration, locate: impl Fn(u64) -> String) -> Value {
    value(&View::of(calibration, findings(&calibration.ramps.findings, locate)))
}

view! { View<'a>(found: &'a WarmUpCalibration, all: Value) {
    imu: &'a str = found.table().content().imu.as_str(),
    digest: String = found.table().digest().to_string(),
    nominal_digest: String = found.ramps.curves.digest().to_string(),
    method: &'a str = "one-attitude",
    recordings: &'a [String] = &found.recordings,
    accuracy: String = found.accuracy(),
    not_known: Vec<String> = found.not_known(),
    unit: &'a str = &found.table().content().temperature_unit,
    reference_temperature: f64 = found.at,
    bin: f64 = found.bin,
    rows: Vec<RowsView<'a>> = found.rows.iter().map(RowsView::of).collect(),
    order: OrderView<'a> = OrderView::of(&found.order, found),
    biases: Vec<BiasView<'a>> =
        found.biases.iter().map(|bias| BiasView::of(bias, found.table().content().gravity)).collect(),
    losses: Losses = found.ramps.transients.losses,
    transients: TransientsView<'a> = TransientsView::of(&found.ramps.transients),
    accepted: &'a [&'static str] = &found.ramps.accepted,
    findings: Value = all,
}}

view! {
/// What was used of the rows of a recording, and what was left out.
RowsView<'a>(account: &'a RowAccount) {
    recording: &'a str = &account.recording,
    count: usize = account.rows,
    /// Begin and end of each stretch that is used, since the recording began.
    used_s: &'a [[f64; 2]] = &account.used_s,
    bumps: Vec<BumpView> = account.bumps.iter().map(BumpView::of).collect(),
    left_out: Vec<LeftOutView> = account.left_out.iter().map(LeftOutView::of).collect(),
    bad: Vec<BadView> = account.bad.counts().into_iter().map(|counted| BadView::of(counted, account)).collect(),
}}

view! { BumpView(bump: &[f64; 2]) {
    age_s: f64 = bump[0],
    size_rad: f64 = bump[1],
}}

view! { LeftOutView(part: &LeftOutPart) {
    cause: &'static str = part.cause.words(),
    from_s: f64 = part.age_s[0],
    to_s: f64 = part.age_s[1],
}}

view! { BadView(counted: (BadKind, usize), account: &RowAccount) {
    kind: &'static str = counted.0.name(),
    count: usize = counted.1,
    /// First and last row of each group, since the recording began.
    groups_s: Vec<[f64; 2]> = account.bad_groups_s(counted.0),
}}

view! { OrderView<'a>(order: &'a OrderChoice, found: &WarmUpCalibration) {
    order: usize = order.order,
    given: bool = order.given,
    left_out: &'static str = if order.sweeps_left_out > 0 { "sweeps" } else { "none" },
    count: usize = order.sweeps_left_out,
    tried: Vec<TriedView<'a>> = order.tried.iter().map(|it| TriedView::of(it, found)).collect(),
}}

view! { TriedView<'a>(tried: &'a TriedOrder, found: &WarmUpCalibration) {
    order: usize = tried.order,
    terms: &'a [f64] = &tried.terms,
    /// By bias, in its unit.
    errors: Vec<f64> = found.errors_of(tried),
}}

view! {
/// The figures are in its `unit`.
BiasView<'a>(bias: &'a BiasCurve, gravity: f64) {
    name: &'a str = bias.name(),
    unit: &'a str = TriadUnits::of(bias.kind).si(0.0, gravity).1,
    before: SpreadView = SpreadView::of(bias.before, bias, gravity),
    after: SpreadView = SpreadView::of(bias.after, bias, gravity),
    interval_95: f64 = TriadUnits::of(bias.kind).si(bias.interval, gravity).0,
    behind_60_s: f64 = TriadUnits::of(bias.kind).si(bias.behind, gravity).0,
    band: Option<f64> =
        bias.band.as_ref().map(|band| TriadUnits::of(bias.kind).si(band.half_width, gravity).0),
    band_at: Option<f64> = bias.band.as_ref().map(|band| band.at),
    /// Cubics of autopilots, then parameters on board by the names of their files.
    beside: Vec<BesideView<'a>> = others(bias).map(|(name, spread)| BesideView::of(name, spread, bias, gravity)).collect(),
}}

view! { SpreadView(spread: Spread, bias: &BiasCurve, gravity: f64) {
    standard_deviation: f64 = TriadUnits::of(bias.kind).si(spread.sd, gravity).0,
    largest: f64 = TriadUnits::of(bias.kind).si(spread.largest, gravity).0,
}}

view! { BesideView<'a>(name: &'a str, spread: Spread, bias: &BiasCurve, gravity: f64) {
    name: &'a str = name,
    after: SpreadView = SpreadView::of(spread, bias, gravity),
}}

/// What is shown next to a curve: its name, and what it leaves.
fn others(bias: &BiasCurve) -> impl Iterator<Item = (&str, Spread)> {
    let cubics = bias.beside.iter().map(|(autopilot, _, spread)| (autopilot.title(), *spread));
    cubics.chain(bias.on_board.iter().map(|on_board| (on_board.name.as_str(), on_board.after)))
}

/// The page as HTML.
#[must_use]
pub fn html(campaign: &Campaign, calibration: &WarmUpCalibration, source: &CampaignSource) -> String {
    let title = format!("Calibration of {} at one attitude", campaign.imu);
    let mut page = Page::new(&title, &format!("{} · {}", source.time, source.tool));
    fill(&mut page, campaign, calibration, source);
    page.finish()
}

/// The sections of a page.
pub(crate) fn fill(page: &mut Page, campaign: &Campaign, calibration: &WarmUpCalibration, source: &CampaignSource) {
    page.heading(2, "result", "Result");
    let has_band = calibration.biases.iter().any(|bias| bias.band.is_some());
    page.paragraph(&headline(calibration));
    before_and_after(page, calibration);
    if has_band {
        page.note(NoteKind::Good, "Error known", "It is half of the band between heating and cooling.");
    } else {
        let text = "The last columns of the table do not replace a band between heating and cooling.";
        page.note(NoteKind::Warning, "Error not known", text);
    }
    page.findings(&calibration.ramps.findings, |_| String::new());
    if has_lag(calibration) {
        crate::transients::verdict(page, &calibration.ramps.transients);
    }
    let unit = &campaign.temperature_unit;
    left_out_section(page, calibration);
    curves(page, calibration, unit);
    residuals(page, calibration, unit);
    orders(page, calibration);
    if has_lag(calibration) {
        crate::transients::sections(page, &calibration.ramps.transients, unit);
    }
    page.heading(2, "measurement", "Measurement");
    page.key_values(&[
        ("IMU", campaign.imu.to_string()),
        ("Recordings", calibration.recordings.join(", ")),
        ("Sweeps", sweeps(calibration)),
        ("Order", order_words(&calibration.order)),
        ("Reference temperature", format!("{:.2} {unit}", calibration.at)),
        ("1 g0", format!("{} m/s2", campaign.gravity_reference)),
    ]);
    let nominal = calibration.ramps.curves.digest().to_string();
    provenance(page, campaign, source, &[("Nominal table", nominal.as_str())], calibration.table());
    never_shown(page, &calibration.not_known());
}

/// `cooling 51.6 to -17.6, heating -17.6 to 74.0`.
fn sweeps(calibration: &WarmUpCalibration) -> String {
    let words = calibration.sweeps.iter().map(|sweep| {
        let [from, to] = sweep.temperature;
        format!("{} {from:.1} to {to:.1}", if sweep.heating { "heating" } else { "cooling" })
    });
    words.collect::<Vec<_>>().join(", ")
}

fn left_out_section(page: &mut Page, calibration: &WarmUpCalibration) {
    let words = left_out(calibration);
    if words.is_empty() {
        return;
    }
    page.heading(2, "left-out", "Left out");
    words.lines().for_each(|line| page.paragraph(line));
}

/// Unit and factor of the figures of a bias: mm/s2 or deg/h.
fn page_unit(bias: &BiasCurve, gravity: f64) -> (f64, &'static str) {
    let units = TriadUnits::of(bias.kind);
    match units.si(1.0, gravity) {
        (factor, "m/s2") => (factor * 1e3, "mm/s2"),
        _ => (units.bias_factor, units.bias_on_page),
    }
}

/// The bias that gains least, with its factor.
pub(crate) fn least_gain(calibration: &WarmUpCalibration) -> Option<(&BiasCurve, f64)> {
    let factors = calibration.biases.iter().map(|bias| (bias, bias.before.sd / bias.after.sd));
    factors.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// What the bias that gains least was, and what it is.
fn headline(calibration: &WarmUpCalibration) -> String {
    least_gain(calibration).map_or_else(String::new, |(bias, gain)| {
        let (factor, unit) = page_unit(bias, calibration.table().content().gravity);
        let [before, after] = [bias.before.sd, bias.after.sd].map(|sd| digits(sd * factor, 3));
        format!(
            "Without the table the bias of {} varies by {before} {unit} over temperature, with the table by {after} {unit}: {gain:.1} times less. \
             The biases of the other sensors gain at least as much.",
            bias.name()
        )
    })
}

fn before_and_after(page: &mut Page, calibration: &WarmUpCalibration) {
    let gravity = calibration.table().content().gravity;
    let number = |bias: &BiasCurve, value: f64| Cell::Number(digits(value * page_unit(bias, gravity).0, 3));
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in calibration.biases.iter().flat_map(others) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let row = |bias: &BiasCurve| {
        let mut cells = vec![
            Cell::text(bias.name()),
            Cell::text(page_unit(bias, gravity).1),
            number(bias, bias.before.sd),
            number(bias, bias.after.sd),
            Cell::number(bias.before.sd / bias.after.sd, 1),
        ];
        let left = |name: &&str| others(bias).find(|other| other.0 == *name).map_or(f64::NAN, |other| other.1.sd);
        cells.extend(names.iter().map(|name| number(bias, left(name))));
        let band = bias.band.as_ref().map_or(f64::NAN, |band| band.half_width);
        cells.extend([bias.after.largest, band, bias.interval, bias.behind].map(|value| number(bias, value)));
        cells
    };
    let after: Vec<_> = names.iter().map(|name| format!("After: {name}")).collect();
    let behind = format!("{BEHIND_S} s of lag, +-");
    let mut header = vec!["Axis", "Unit", "Before", "After", "Factor"];
    header.extend(after.iter().map(String::as_str));
    header.extend(["Largest left", "Band, +-", "Noise, +-", &behind]);
    let caption = format!(
        "Before and after: standard deviation of the bias over temperature, from means of bins of {} {}. Errors of the curve: half the band between \
         heating and cooling; 95 % from noise only; and what a lag of {BEHIND_S} s behind the temperature would add",
        digits(calibration.bin, 3),
        calibration.table().content().temperature_unit
    );
    page.compact_table(&caption, &header, calibration.biases.iter().map(row).collect());
}

fn line(curve: &Polynomial, factor: f64) -> Vec<(f64, f64)> {
    grid(curve.range(), CURVE_INTERVALS).map(|u| (u, curve.at(curve.clamp(u)) * factor)).collect()
}

fn name_of(calibration: &WarmUpCalibration, sweep: usize) -> String {
    let span = &calibration.sweeps[sweep];
    let direction = if span.heating { "heating" } else { "cooling" };
    let number = sweep + 1;
    match calibration.recordings.as_slice() {
        [_] => format!("{number}: {direction}"),
        _ => format!("{number}: {direction} of recording {}", span.recording + 1),
    }
}

/// A plot with a series for each sweep.
fn by_sweep(
    mut plot: Plot,
    calibration: &WarmUpCalibration,
    bias: &BiasCurve,
    point: impl Fn(&SweepPoint) -> (f64, f64),
) -> Plot {
    for sweep in 0..calibration.sweeps.len() {
        let own = bias.points.iter().filter(|it| it.sweep == sweep).map(&point);
        plot = plot.series(&name_of(calibration, sweep), Style::Points, own);
    }
    plot
}

fn curves(page: &mut Page, calibration: &WarmUpCalibration, unit: &str) {
    page.heading(2, "curves", "Curves");
    page.paragraph(
        "The curve with its band, and the means of each sweep. An accelerometer is that of the nominal table at the reference temperature. What \
         others make of the same rows is shown as the difference from the curve.",
    );
    let gravity = calibration.table().content().gravity;
    let x_label = format!("Head temperature / {unit}");
    let figures = calibration.biases.iter().flat_map(|bias| {
        let (factor, unit) = page_unit(bias, gravity);
        let curve = line(&bias.curve, factor);
        let plot = Plot::new(&format!("Bias of {}", bias.name()), &x_label, &format!("Bias / ({unit})"));
        let mut plot = plot.series("Curve", Style::Line, curve.iter().copied());
        if let Some(band) = &bias.band {
            let half = band.half_width * factor;
            plot = plot.band(curve.iter().map(|(at, value)| (*at, value - half, value + half)));
        }
        let plot = by_sweep(plot, calibration, bias, |it| (it.temperature, it.value * factor));
        core::iter::once(plot).chain(differences(bias, (factor, unit), &x_label))
    });
    page.plots(&figures.collect::<Vec<_>>());
}

/// The curves of others less that of the table; `None` without any.
fn differences(bias: &BiasCurve, (factor, unit): (f64, &str), x_label: &str) -> Option<Plot> {
    let title = format!("Bias of {}: others less the curve", bias.name());
    let plot = Plot::new(&title, x_label, &format!("Difference / ({unit})")).zero_line();
    let less = |(at, value): (f64, f64)| (at, value - bias.curve.at(bias.curve.clamp(at)) * factor);
    let cubics = bias.beside.iter().map(|(autopilot, curve, _)| (autopilot.title(), line(curve, factor)));
    let on_board = bias.on_board.iter().map(|it| {
        (it.name.as_str(), it.points.iter().map(|(temperature, value)| (*temperature, value * factor)).collect())
    });
    let others: Vec<(&str, Vec<_>)> = cubics.chain(on_board).collect();
    let draw =
        |plot: Plot, (name, points): (&str, Vec<_>)| plot.series(name, Style::Line, points.into_iter().map(less));
    (!others.is_empty()).then(|| others.into_iter().fold(plot, draw))
}

fn residuals(page: &mut Page, calibration: &WarmUpCalibration, unit: &str) {
    page.heading(2, "residuals", "Residuals");
    page.paragraph("What the curve leaves of each sweep, over temperature and over time. Sweeps that are apart are the band; a step in time is a bump.");
    let gravity = calibration.table().content().gravity;
    let figures = calibration.biases.iter().flat_map(|bias| {
        let (factor, si) = page_unit(bias, gravity);
        let label = format!("Residual / ({si})");
        let temperature =
            Plot::new(&format!("{} by sweep", bias.name()), &format!("Head temperature / {unit}"), &label);
        let time = Plot::new(&format!("{} in time", bias.name()), "Time since the begin / s", &label);
        let plots = [
            by_sweep(temperature, calibration, bias, |it| (it.temperature, it.residual * factor)),
            by_sweep(time, calibration, bias, |it| (it.age_s, it.residual * factor)),
        ];
        plots.map(Plot::zero_line)
    });
    page.plots(&figures.collect::<Vec<_>>());
}

fn orders(page: &mut Page, calibration: &WarmUpCalibration) {
    page.heading(2, "order", "Order");
    page.paragraph(&format!("{}. All curves have one order.", order_words(&calibration.order)));
    let gravity = calibration.table().content().gravity;
    let mut table = |caption: &str, unit: &dyn Fn(&BiasCurve) -> String, figures: &dyn Fn(&TriedOrder) -> Vec<f64>| {
        let row = |tried: &TriedOrder| {
            let cells = figures(tried).into_iter().map(|figure| Cell::Number(digits(figure, 3)));
            core::iter::once(Cell::number(tried.order as f64, 0)).chain(cells).collect()
        };
        let header: Vec<_> = core::iter::once("Order".to_owned()).chain(calibration.biases.iter().map(unit)).collect();
        let header: Vec<_> = header.iter().map(String::as_str).collect();
        page.compact_table(caption, &header, calibration.order.tried.iter().map(row).collect());
    };
    table("Highest term in standard errors, by order", &|bias| bias.name().to_owned(), &|it| it.terms.clone());
    if calibration.order.sweeps_left_out > 0 {
        let with_unit = |bias: &BiasCurve| format!("{} / ({})", bias.name(), page_unit(bias, gravity).1);
        let caption = "Standard deviation of what is left of sweeps left out, by order";
        let in_unit = |(error, bias): (&f64, &BiasCurve)| error * page_unit(bias, gravity).0;
        table(caption, &with_unit, &|it| it.errors.iter().zip(&calibration.biases).map(in_unit).collect());
    }
}
