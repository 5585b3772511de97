//! A calibration without a turntable as text, JSON and page.

use super::findings::findings;
use super::page::{Cell, Page};
use super::plot::{Plot, Style};
use super::quantity::sentence;
use super::text::within;
use super::view::{value, view};
use crate::parts::grid;
use isotherm_campaign::{Campaign, GravitySource, joint_range};
use isotherm_fit::{CampaignSource, Reading, TumbleCalibration, largest_band, largest_interval};
use isotherm_recording::Losses;
use isotherm_shared::table::{AXIS_NAMES, GRAVITY_ONLY, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, Curve, QUANTITIES, student_quantile_of};
use serde_json::Value;

/// What no calibration without a turntable shows.
const NOT_OBSERVABLE: &str = "not observable without a turntable: a rotation of the sensors in the housing, a reversed sign, exchanged axes; output axis 3 is along A3, output axis 2 in the \
                              plane of A2 and A3";
/// Intervals between the points of a drawn curve.
const CURVE_INTERVALS: usize = 60;

/// A calibration in a few lines, then a line for each static pose.
#[must_use]
pub fn text(calibration: &TumbleCalibration) -> String {
    let mut text = choices(calibration);
    text.extend(within(calibration.losses, "the recordings"));
    text += &values_at_mid_temperature(calibration);
    text.extend(largest_bands(calibration));
    text += &evidence(calibration);
    text + &static_poses(calibration)
}

/// What there is, and what was chosen.
fn choices(calibration: &TumbleCalibration) -> String {
    let TumbleCalibration { readings, too_short, groups, unknowns, reasons, .. } = calibration;
    format!(
        "{} static poses in {} at {}, {too_short} too short, digest {}\n\n  order {}: {}\n  {}: {}\n\n",
        readings.len(),
        counted(groups.count, "group", "groups"),
        counted(groups.levels, "temperature", "temperatures"),
        calibration.table.digest(),
        unknowns.order,
        reasons[0],
        if unknowns.split { "K+ and K-" } else { "one K, K- = -K+" },
        reasons[1],
    )
}

fn values_at_mid_temperature(calibration: &TumbleCalibration) -> String {
    let mut text =
        "  at mid temperature, 95 %    bias / 1e-6 g0           K+ / (pulse/(s*g0))          K- / (pulse/(s*g0))\n"
            .to_owned();
    for (axis, name) in AXIS_NAMES.iter().enumerate() {
        let [bias, plus, minus] = mid_in_words(calibration, axis);
        text += &format!("  {name:<22} {bias:>20} {plus:>27} {minus:>28}\n");
    }
    for (name, value, error) in misalignments(calibration) {
        let interval = error.map(|error| error * student_quantile_of(CONFIDENCE, calibration.misalignment_freedom));
        text += &format!("  {name} {} [1e-6 rad]\n", with_interval((value, interval), 1e6, 2));
    }
    text
}

/// The largest bands of the whole curves, if all are known.
fn largest_bands(calibration: &TumbleCalibration) -> Option<String> {
    let [bias, scale_factors] = calibration.largest_bands()?;
    let [low, high] = joint_range(calibration.curves.iter().flatten().map(Curve::measured));
    Some(format!(
        "  largest 95 % band for each whole curve over the temperature of the static poses, {low:.2} to {high:.2}: bias {:.2}e-6 g0, scale factors {:.2} ppm\n",
        bias * 1e6,
        scale_factors * 1e6
    ))
}

/// How well the static poses agree, and what they cannot show.
fn evidence(calibration: &TumbleCalibration) -> String {
    let dilution = calibration.dilution.times_root_n;
    let mut text =
        normal_gravity(calibration).map_or_else(String::new, |gravity| format!("  local gravity {gravity}\n"));
    text += &format!(
        "  residuals {:.2}e-6 g0 rms, {} degrees of freedom{}\n  D sqrt(n) {dilution:.2}: an error of 1 in each static pose is one of {:.2} in the output\n  {NOT_OBSERVABLE}\n",
        calibration.residual_rms() * 1e6,
        calibration.freedom,
        shared(calibration),
        dilution / (calibration.readings.len() as f64).sqrt()
    );
    if let Some([g1, g2, g3]) = calibration.gyroscope_rates() {
        text += &format!(
            "  gyroscopes, mean over the static poses: {g1:.4} {g2:.4} {g3:.4} pulse/s; Earth's rate is in it, and nothing of them goes into the table\n"
        );
    }
    text
}

fn static_poses(calibration: &TumbleCalibration) -> String {
    let mut text =
        "\n  static pose    start / s   length / s   specific force A1 A2 A3 / g0   head temperature   residual / 1e-6 g0\n".to_owned();
    let poses = calibration.readings.iter().zip(&calibration.forces).zip(&calibration.residuals);
    for ((reading, [a1, a2, a3]), residual) in poses {
        let Reading { number, start_s, seconds, .. } = reading;
        let (head, residual) = (head(reading), residual * 1e6);
        text += &format!(
            "  {number:>10} {start_s:>12.2} {seconds:>12.2}   {a1:>8.4} {a2:>8.4} {a3:>8.4} {head:>18.3} {residual:>20.2}\n"
        );
    }
    text
}

/// Local gravity with its error and its source, if nobody stated it.
fn normal_gravity(calibration: &TumbleCalibration) -> Option<String> {
    let (source, local) = (calibration.gravity_source, calibration.table.gravity_local()?);
    let GravitySource::Normal(place) = source else { return None };
    let half = source.half_width();
    Some(format!(
        "{local:.5} +- {:.5} m/s2, normal gravity at {place}: its {:.0} ppm are in the intervals of the scale factors",
        half * local,
        half * 1e6
    ))
}

fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// What the static poses of a group share.
fn shared(calibration: &TumbleCalibration) -> String {
    let Some(evidence) = &calibration.evidence else { return String::new() };
    let walk = format!("bias walks {:.1}e-6 g0 in a tumble", evidence.walk_bias * 1e6);
    if calibration.groups.count == 1 {
        return format!("\n  {walk}; one group: what another power-up changes is not in the intervals");
    }
    format!(
        "\n  between groups: bias {:.1}e-6 g0, scale factor {:.1} ppm; {walk}",
        evidence.group_bias * 1e6,
        evidence.group_gain * 1e6
    )
}

/// Value at mid temperature with the half width of its 95 % interval.
fn mid(calibration: &TumbleCalibration, axis: usize, quantity: usize) -> (f64, Option<f64>) {
    let (curve, temperature) = (&calibration.curves[axis][quantity], calibration.mid(axis, quantity));
    (curve.at(temperature), curve.interval(temperature, CONFIDENCE))
}

/// Bias, K+ and K- of an axis at mid temperature, with their 95 % intervals.
fn mid_in_words(calibration: &TumbleCalibration, axis: usize) -> [String; 3] {
    let [bias, plus, minus] = [0, 1, 2].map(|quantity| mid(calibration, axis, quantity));
    [with_interval(bias, 1e6, 2), with_relative(plus), with_relative(minus)]
}

fn with_interval((value, interval): (f64, Option<f64>), factor: f64, decimals: usize) -> String {
    let interval = interval.map_or_else(|| "not known".to_owned(), |half| format!("{:.decimals$}", half * factor));
    format!("{:.decimals$} +- {interval}", value * factor)
}

fn with_relative((value, interval): (f64, Option<f64>)) -> String {
    let interval =
        interval.map_or_else(|| "not known".to_owned(), |half| format!("{:.1} ppm", (half / value).abs() * 1e6));
    format!("{value:.3} +- {interval}")
}

/// m12, m13 and m23 with their standard errors \[rad\]; none if they are not estimated.
fn misalignments(calibration: &TumbleCalibration) -> Vec<(&'static str, f64, Option<f64>)> {
    if !calibration.unknowns.misalignment {
        return Vec::new();
    }
    let errors = calibration.misalignment_error.map_or([None; 3], |errors| errors.map(Some));
    let places = [("m12", 0, 1), ("m13", 0, 2), ("m23", 1, 2)];
    places.iter().zip(errors).map(|(&(name, i, j), error)| (name, calibration.misalignment[(i, j)], error)).collect()
}

fn head(reading: &Reading) -> f64 {
    reading.head.iter().sum::<f64>() / 3.0
}

/// A calibration as JSON. `locate` gives file and line of a row.
#[must_use]
pub fn json(calibration: &TumbleCalibration, locate: impl Fn(u64) -> String) -> Value {
    value(&CalibrationView::of(calibration, findings(&calibration.findings, locate)))
}

view! { CalibrationView<'a>(found: &'a TumbleCalibration, all: Value) {
    imu: &'a str = found.table.content().imu.as_str(),
    digest: String = found.table.digest().to_string(),
    method: &'a str = GRAVITY_ONLY,
    static_poses: usize = found.readings.len(),
    too_short: usize = found.too_short,
    losses: Losses = found.losses,
    groups: usize = found.groups.count,
    temperatures: usize = found.groups.levels,
    unit: &'a str = &found.table.content().temperature_unit,
    gravity_local_m_s2: Option<f64> = found.table.gravity_local(),
    gravity_source: &'a str = found.gravity_source.name(),
    gravity_half_width_ppm: Option<f64> =
        Some(found.gravity_source.half_width() * 1e6).filter(|half| *half > 0.0),
    order: usize = found.unknowns.order,
    order_reason: &'a str = &found.reasons[0],
    scale_factor: &'a str = if found.unknowns.split { "split" } else { "single" },
    scale_factor_reason: &'a str = &found.reasons[1],
    parameters: usize = found.unknowns.count(),
    degrees_of_freedom: usize = found.freedom,
    residual_rms_g0: f64 = found.residual_rms(),
    dilution_sqrt_n: f64 = found.dilution.times_root_n,
    bias_g0: [f64; AXES] = values(found, 0),
    bias_standard_error_g0: Option<[f64; AXES]> = errors(found, 0),
    positive_scale_factor_pulse_per_s_g0: [f64; AXES] = values(found, 1),
    positive_scale_factor_standard_error_ppm: Option<[f64; AXES]> = errors(found, 1),
    negative_scale_factor_pulse_per_s_g0: [f64; AXES] = values(found, 2),
    negative_scale_factor_standard_error_ppm: Option<[f64; AXES]> = errors(found, 2),
    m12_m13_m23_rad: Option<Vec<f64>> = Some(misalignments(found).into_iter().map(|(_, value, _)| value).collect())
        .filter(|values: &Vec<f64>| !values.is_empty()),
    m_standard_error_rad: Option<[f64; AXES]> = found.misalignment_error,
    gyroscope_rate_pulse_per_s: Option<[f64; AXES]> = found.gyroscope_rates(),
    not_observable: &'a str = NOT_OBSERVABLE,
    curves: Vec<CurveView<'a>> =
        (0..9).map(|index| CurveView::of(&found.curves[index / 3][index % 3], index / 3, index % 3)).collect(),
    static_pose: Vec<StaticPoseView> =
        (0..found.readings.len()).map(|index| StaticPoseView::of(found, &found.readings[index], index)).collect(),
    findings: Value = all,
}}

view! { CurveView<'a>(curve: &Curve, number: usize, of: usize) {
    axis: &'a str = AXIS_NAMES[number],
    quantity: &'a str = QUANTITIES[of],
    unit: &'a str = if of == 0 { "g0" } else { "pulse/(s*g0)" },
    order: usize = curve.order(),
    range_in_unit_of_temperature: [f64; 2] = curve.range(),
    measured_in_unit_of_temperature: [f64; 2] = curve.measured(),
    largest_interval_in_unit: Option<f64> = largest_interval(curve, false),
    largest_band_in_unit: Option<f64> = largest_band(curve, false),
}}

view! { StaticPoseView(found: &TumbleCalibration, reading: &Reading, index: usize) {
    number: usize = reading.number,
    recording: usize = reading.recording + 1,
    start_s: f64 = reading.start_s,
    length_s: f64 = reading.seconds,
    rows: usize = reading.rows.len(),
    specific_force_g0: [f64; AXES] = found.forces[index],
    head_in_unit_of_temperature: [f64; AXES] = reading.head,
    board_in_unit_of_temperature: [f64; AXES] = reading.board,
    residual_g0: f64 = found.residuals[index],
    gyroscope_rate_pulse_per_s: Option<[f64; AXES]> = reading.gyroscopes,
}}

/// A quantity of each axis at mid temperature.
fn values(found: &TumbleCalibration, quantity: usize) -> [f64; AXES] {
    [0, 1, 2].map(|axis| found.curves[axis][quantity].at(found.mid(axis, quantity)))
}

/// Their standard errors, those of scale factors in ppm; `None` if one of them is not known.
fn errors(found: &TumbleCalibration, quantity: usize) -> Option<[f64; AXES]> {
    let error = |axis: usize| {
        let (curve, at) = (&found.curves[axis][quantity], found.mid(axis, quantity));
        let relative = if quantity == 0 { 1.0 } else { 1e6 / curve.at(at).abs() };
        Some(curve.standard_error(at)? * relative)
    };
    Some([error(0)?, error(1)?, error(2)?])
}

/// The page as HTML.
#[must_use]
pub fn html(campaign: &Campaign, calibration: &TumbleCalibration, source: &CampaignSource) -> String {
    let title = format!("Calibration of {} without a turntable", campaign.imu);
    let mut page = Page::new(&title, &format!("{} · {}", source.time, source.tool));
    page.heading(2, "result", "Result");
    page.paragraph(&sentence(&calibration.accuracy()));
    let cells = |axis: usize| core::iter::once(AXIS_NAMES[axis].to_owned()).chain(mid_in_words(calibration, axis));
    let rows: Vec<Vec<Cell>> = (0..AXES).map(|axis| cells(axis).map(Cell::text).collect()).collect();
    let header = ["Axis", "Bias / 1e-6 g0", "K+ / (pulse/(s*g0))", "K- / (pulse/(s*g0))"];
    page.table("Values at mid temperature with 95 % intervals", &header, &rows);
    page.findings(&calibration.findings, |_| String::new());
    if calibration.unknowns.order > 0 {
        curves(&mut page, calibration);
    }
    residuals(&mut page, calibration);
    if let Some(rates) = calibration.gyroscope_rates() {
        page.heading(2, "gyroscopes", "Gyroscopes");
        page.paragraph("Mean rate over the static poses. Earth's rate is in it; nothing of it goes into the table.");
        let rows: Vec<_> =
            GYROSCOPE_NAMES.iter().zip(rates).map(|(name, rate)| (*name, format!("{rate:.4} pulse/s"))).collect();
        page.key_values(&rows);
    }
    page.heading(2, "measurement", "Measurement");
    page.key_values(&[
        ("Static poses", format!("{}, {} too short", calibration.readings.len(), calibration.too_short)),
        ("Groups by file, power-up and temperature", calibration.groups.count.to_string()),
        ("Temperatures", calibration.groups.levels.to_string()),
        ("Order", format!("{}: {}", calibration.unknowns.order, calibration.reasons[0])),
        ("Scale factors", calibration.reasons[1].clone()),
        ("Residuals", format!("{:.2}e-6 g0 rms", calibration.residual_rms() * 1e6)),
        ("Degrees of freedom", calibration.freedom.to_string()),
        ("D sqrt(n)", format!("{:.2}", calibration.dilution.times_root_n)),
        ("Local gravity", normal_gravity(calibration).unwrap_or_else(|| format!("{} m/s2", campaign.gravity_local))),
        ("1 g0", format!("{} m/s2", campaign.gravity_reference)),
    ]);
    page.heading(2, "provenance", "Provenance");
    let digest = calibration.table.digest().to_string();
    let mut rows = vec![("Tool", source.tool.as_str()), ("Time", source.time.as_str()), ("Table", &digest)];
    if !source.campaign.is_empty() {
        rows.extend([("Campaign file", source.campaign.as_str()), ("its SHA-256", &source.campaign_sha256)]);
    }
    rows.extend(source.recordings_sha256.iter().map(|sha256| ("SHA-256 of a recording", sha256.as_str())));
    page.key_values(&rows);
    page.paragraph(&format!("This is {NOT_OBSERVABLE}."));
    page.finish()
}

fn residuals(page: &mut Page, calibration: &TumbleCalibration) {
    page.heading(2, "static_poses", "Static poses");
    let points = calibration.readings.iter().zip(&calibration.residuals);
    let points: Vec<(f64, f64)> = points.map(|(reading, residual)| (reading.number as f64, residual * 1e6)).collect();
    let plot = Plot::new("Length of the output less local gravity", "Number of the static pose", "Residual / 1e-6 g0");
    let plot = plot.series("Residual", Style::Points, points).zero_line();
    page.figure(&plot.svg(), "");
    let rows: Vec<Vec<Cell>> = (0..calibration.readings.len())
        .map(|index| {
            let (reading, force) = (&calibration.readings[index], calibration.forces[index]);
            vec![
                Cell::number(reading.number as f64, 0),
                Cell::number(reading.start_s, 2),
                Cell::number(reading.seconds, 2),
                Cell::number(force[0], 4),
                Cell::number(force[1], 4),
                Cell::number(force[2], 4),
                Cell::number(head(reading), 3),
                Cell::number(calibration.residuals[index] * 1e6, 2),
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
        "Head temperature",
        "Residual / 1e-6 g0",
    ];
    page.table("Static poses: specific force along the output axes", &header, &rows);
}

fn curves(page: &mut Page, calibration: &TumbleCalibration) {
    page.heading(2, "curves", "Curves");
    let unit = &calibration.table.content().temperature_unit;
    let mut figures = Vec::new();
    for (axis, name) in AXIS_NAMES.iter().enumerate() {
        for (quantity, label) in ["Bias / 1e-6 g0", "K+ / ppm", "K- / ppm"].into_iter().enumerate() {
            let curve = &calibration.curves[axis][quantity];
            let middle = curve.at(calibration.mid(axis, quantity));
            let quantile = curve.band_quantile(CONFIDENCE);
            let shown = |value: f64| if quantity == 0 { value * 1e6 } else { (value / middle - 1.0) * 1e6 };
            let points: Vec<f64> = grid(curve.range(), CURVE_INTERVALS).collect();
            let band = points.iter().filter_map(|&at| {
                let half = curve.half_width(at, quantile?)?;
                let ends = [curve.at(at) - half, curve.at(at) + half].map(shown);
                Some((at, ends[0].min(ends[1]), ends[0].max(ends[1])))
            });
            let temperature = if quantity == 0 { "Head" } else { "Board" };
            let plot = Plot::new(&format!("{name}: {label}"), &format!("{temperature} temperature / {unit}"), label);
            let plot = plot.series("Curve", Style::Line, points.iter().map(|&at| (at, shown(curve.at(at))))).band(band);
            figures.push((plot.svg(), String::new()));
        }
    }
    page.figures(&figures);
}
