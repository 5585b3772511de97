//! The report of a calibration.
//!
//! Over 400 lines: one function for each section of the page, in the order of the page. Only the order tables are a module of
//! their own.

mod orders;

use super::navigation;
use super::page::{Cell, NoteKind, Page};
use super::plot::{Plot, Style};
use crate::accuracy::Accuracy;
use crate::calibrate::{Calibration, Method};
use crate::campaign::{Campaign, Dwell};
use crate::curve::{CONFIDENCE, student_quantile};
use crate::positions::PARAMETERS;
use crate::provenance::CampaignSource;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;

/// Intervals between the points of a drawn curve.
const CURVE_INTERVALS: usize = 120;
/// Name and unit of the three quantities; [`factor`] converts a value to its unit.
const QUANTITY_NAMES: [(&str, &str); 3] = [("Bias", "1e-6 g0"), ("K+", "pulse/(s g0)"), ("K-", "pulse/(s g0)")];

/// Factor from a value to the unit in [`QUANTITY_NAMES`]: the bias is calculated in g0 and shown in 1e-6 g0.
const fn factor(quantity: usize) -> f64 {
    if quantity == 0 { 1e6 } else { 1.0 }
}

/// The page as HTML.
#[must_use]
pub fn html(campaign: &Campaign, calibration: &Calibration, source: &CampaignSource) -> String {
    let report = Report { campaign, calibration, source };
    let title = format!("Calibration of {}", campaign.imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", source.campaign, source.time, source.tool));
    report.result(&mut page);
    report.curves(&mut page);
    report.residuals(&mut page);
    report.orders(&mut page);
    report.misalignments(&mut page);
    report.before_after(&mut page);
    report.budget(&mut page);
    report.set_points(&mut page);
    report.dwells(&mut page);
    report.positions(&mut page);
    report.provenance(&mut page);
    page.finish()
}

struct Report<'a> {
    campaign: &'a Campaign,
    calibration: &'a Calibration,
    source: &'a CampaignSource,
}

impl Report<'_> {
    fn unit(&self) -> &str {
        &self.campaign.temperature_unit
    }

    fn telemetry(&self, quantity: usize) -> String {
        format!("{} telemetry / {}", if quantity == 0 { "Head" } else { "Board" }, self.unit())
    }

    fn position_number(&self, dwell: &Dwell) -> u32 {
        self.campaign.positions[dwell.position].number
    }

    fn result(&self, page: &mut Page) {
        let calibration = self.calibration;
        page.heading(2, "result", "Result");
        if calibration.findings.is_empty() {
            let text = "Positions, time, soak, stillness, telemetry, saturation, fit and outliers were looked at without a remark.";
            page.note(NoteKind::Good, "Nothing found", text);
        }
        for finding in &calibration.findings {
            let line = finding
                .line
                .map_or(String::new(), |line| format!("{}, line {line}: ", self.campaign.samples.join(", ")));
            page.note(NoteKind::Warning, "Look at this", &format!("{line}{finding}"));
        }
        let conditions = calibration.observability.iter().map(|o| format!("{:.1}", o.condition));
        let accuracy = Accuracy::of(calibration);
        page.paragraph(&format!("{accuracy}."));
        if let Some(caution) = accuracy.caution() {
            page.note(NoteKind::Warning, "Caution", &caution);
        }
        let mut rows = vec![
            ("Table", calibration.table.digest().to_string()),
            ("IMU", self.campaign.imu.to_string()),
            ("Serial", self.campaign.serial.clone().unwrap_or_else(|| "not stated".to_owned())),
            ("Set points", calibration.set_points.len().to_string()),
            ("Dwells", calibration.dwells.len().to_string()),
            ("Left out", self.excluded()),
            ("Method", calibration.options.method.name().to_owned()),
            (
                "Order",
                calibration.options.order.map_or_else(|| "auto".to_owned(), |order| format!("{order}, asked for")),
            ),
            ("1 g0", format!("{} m/s2", self.campaign.gravity_reference)),
            ("Gravity at the station", format!("{} m/s2", self.campaign.gravity_local)),
            ("Condition of the positions", conditions.collect::<Vec<_>>().join(", ")),
        ];
        if let Some([x, y]) = calibration.solution.tilt {
            rows.push(("Tilt of the base", format!("{:.2}e-6, {:.2}e-6 rad about X, Y", x * 1e6, y * 1e6)));
        }
        let residuals = (0..AXES).map(|axis| format!("{:.3}", calibration.residual_sd(axis) * 1e6));
        rows.push(("Residuals, rms", format!("{} [1e-6 g0]", residuals.collect::<Vec<_>>().join(", "))));
        page.key_values(&rows);
    }

    fn excluded(&self) -> String {
        let places = self.calibration.options.exclude.iter().map(|(set_point, number)| format!("{set_point}/{number}"));
        Some(places.collect::<Vec<_>>().join(", ")).filter(|t| !t.is_empty()).unwrap_or_else(|| "nothing".to_owned())
    }

    /// Telemetry and value of a quantity at each set point, in the unit of the plots.
    fn points(&self, axis: usize, quantity: usize) -> Vec<(f64, f64)> {
        let points = self.calibration.orders[axis][quantity].regression.points();
        points.iter().map(|point| (point.x.value(), point.y.value() * factor(quantity))).collect()
    }

    /// Half length of the error bar of each set point's own value, in the unit of the value; NaN without degrees of freedom.
    fn errors(&self, axis: usize, quantity: usize) -> Vec<f64> {
        let of_set_points = self.calibration.set_points.iter().zip(&self.calibration.reduced);
        of_set_points
            .map(|(stay, reduced)| half_length(reduced[axis].standard_errors[quantity], stay.dwells.len()))
            .collect()
    }

    /// A figure over the telemetry of a quantity, with the temperatures of the chamber as its second scale.
    fn plot_over_telemetry(&self, title: &str, y_label: &str, axis: usize, quantity: usize) -> Plot {
        let of_set_points = self.calibration.set_points.iter().zip(&self.calibration.reduced);
        let pairs = of_set_points.map(|(stay, reduced)| (reduced[axis].telemetry[quantity], stay.set_point_c));
        Plot::new(title, &self.telemetry(quantity), y_label).second_scale("Set point / degC", pairs)
    }

    /// Figure 5 of the paper.
    fn curves(&self, page: &mut Page) {
        page.heading(2, "curves", "Bias and scale factors over temperature");
        page.paragraph(
            "Points are the set points, freed of the drift within them where the one-stage fit knows it; the line is the table. Bars: 95 % \
             of each set point's own value, by Student's t from the scatter of its dwells, drift and tilt included: where the points are freed of \
             the drift, they scatter less than the bars say. Band: 95 % of the table's curve. What is too small to be seen here is in the \
             residuals below. Upper scale: the chamber's set points, with straight lines between them.",
        );
        for (quantity, (name, unit)) in QUANTITY_NAMES.iter().enumerate() {
            let figure = |axis: usize| {
                let curve = &self.calibration.solution.axes[axis].curves[quantity];
                let factor = factor(quantity);
                let line = grid(curve.range()).map(|u| (u, curve.at(u) * factor));
                let band = grid(curve.range()).filter_map(|u| {
                    let half = curve.interval(u, CONFIDENCE)?;
                    Some((u, (curve.at(u) - half) * factor, (curve.at(u) + half) * factor))
                });
                let title = format!("{name} of {}", AXIS_NAMES[axis]);
                let plot = self
                    .plot_over_telemetry(&title, &format!("{name} / {unit}"), axis, quantity)
                    .series(&format!("Table, order {}, 95 %", curve.order()), Style::Line, line)
                    .band(band)
                    .series("Set points, 95 %", Style::Points, self.points(axis, quantity))
                    .errors(self.errors(axis, quantity).into_iter().map(|half| half * factor));
                (plot.svg(), String::new())
            };
            page.figures(&[figure(0), figure(1), figure(2)]);
        }
    }

    fn residuals(&self, page: &mut Page) {
        page.heading(2, "residuals", "Residuals");
        page.heading(3, "residuals-set-points", "Set points");
        page.paragraph(
            "Bars: 95 % of each set point's own value, as above. Band: 95 % of the table's curve. By chance at most one bar in twenty misses the \
             true curve; more of them are a sign of an order that is too low, or of an error that changes between set points.",
        );
        for (quantity, (name, _)) in QUANTITY_NAMES.iter().enumerate() {
            let figure = |axis: usize| {
                let curve = &self.calibration.solution.axes[axis].curves[quantity];
                let [low, high] = curve.range();
                let size = if quantity == 0 { 1e6 } else { 1e6 / curve.at(0.5 * (low + high)).abs() };
                let unit = if quantity == 0 { "1e-6 g0" } else { "ppm" };
                let band = grid([low, high]).filter_map(|u| {
                    let half = curve.interval(u, CONFIDENCE)? * size;
                    Some((u, -half, half))
                });
                let points = &self.calibration.orders[axis][quantity].regression;
                let points = points.points().iter().map(|point| (point.x.value(), point.y.value()));
                let points = points.map(|(x, y)| (x, (y - curve.at(x)) * size));
                let title = format!("{name} of {}: set point less table", AXIS_NAMES[axis]);
                let plot = self
                    .plot_over_telemetry(&title, &format!("Residual / {unit}"), axis, quantity)
                    .series("Table, 95 %", Style::Line, grid([low, high]).map(|u| (u, 0.0)))
                    .band(band)
                    .series("Set points, 95 %", Style::Points, points)
                    .errors(self.errors(axis, quantity).into_iter().map(|half| half * size));
                (plot.svg(), String::new())
            };
            page.figures(&[figure(0), figure(1), figure(2)]);
        }
        page.heading(3, "residuals-dwells", "Dwells");
        let start = self.calibration.dwells.first().map_or(0, |dwell| dwell.time_ns[0]);
        let hours = |dwell: &Dwell| dwell.time_ns[0].saturating_sub(start) as f64 / 3.6e12;
        let figures_over = |x: &dyn Fn(usize, &Dwell) -> f64, title: &str, label: &str| {
            let figure = |axis: usize| {
                let dwells = self.calibration.dwells.iter().zip(&self.calibration.solution.residuals);
                let points = dwells.map(|(dwell, residual)| (x(axis, dwell), residual[axis] * 1e6));
                let plot = Plot::new(&format!("{}: {title}", AXIS_NAMES[axis]), label, "Residual / 1e-6 g0");
                (plot.zero_line().series("Dwells", Style::Points, points).svg(), String::new())
            };
            [figure(0), figure(1), figure(2)]
        };
        page.figures(&figures_over(&|_, dwell| hours(dwell), "residuals over time", "Time / h"));
        let label = format!("dU/dt of the head / ({} per h)", self.unit());
        page.figures(&figures_over(&|axis, dwell| dwell.head_per_s(axis) * 3600.0, "residuals against drift", &label));
        page.paragraph(
            "A trend against dU/dt would mean that heads or boards lag behind their telemetry: no polynomial of the telemetry \
             removes that.",
        );
    }

    fn misalignments(&self, page: &mut Page) {
        page.heading(2, "misalignments", "Misalignments");
        let mut rows = Vec::new();
        for (axis, part) in self.calibration.solution.axes.iter().enumerate() {
            for (k, m) in part.misalignment.iter().enumerate() {
                let error = part.misalignment_error.map_or(f64::NAN, |errors| errors[k]);
                let interval = part.misalignment_interval(CONFIDENCE).map_or(f64::NAN, |half| half[k]);
                rows.push(vec![
                    Cell::text(format!("{} onto {}", AXIS_NAMES[axis], AXIS_NAMES[(axis + 1 + k) % AXES])),
                    Cell::number(m * 1e6, 3),
                    Cell::number(error * 1e6, 3),
                    Cell::number(interval * 1e6, 3),
                ]);
            }
        }
        let header = ["Misalignment", "Value", "Standard error", "95 % interval +-"];
        page.table("Misalignments [1e-6 rad]", &header, &rows);
        page.paragraph(match (self.calibration.table.content().alignment, self.calibration.left_without_alignment()) {
            (Some(_), _) => {
                "The table has the alignment matrix that undoes them. It turns the axes of the output onto those of the turntable: how the IMU sat on \
                 the fixture is part of it."
            }
            (None, Some(_)) => {
                "The table has no alignment matrix: outputs stay along the sensors' input axes, and the misalignments are part of the error. This IMU \
                 needs one (calibrate --alignment)."
            }
            (None, None) => {
                "The table has no alignment matrix, and needs none: no misalignment exceeds its 99 % interval and 1e-6 rad. Outputs stay along the \
                 sensors' input axes."
            }
        });
    }

    /// Errors of the campaign's own dwells. Figure 6 of the paper, over a separate run, is in the report of a verification.
    fn before_after(&self, page: &mut Page) {
        page.heading(2, "before-after", "Before and after, on the campaign's own dwells");
        page.paragraph(
            "Output less the specific force that the position asks for. Before: coefficients frozen at mid temperature. These dwells made the \
             table, so this is a check of the fit, not of the table: run verify on another recording.",
        );
        let solution = &self.calibration.solution;
        let before = |axis: usize| -> Vec<f64> {
            let [bias, plus, minus] = &solution.axes[axis].curves;
            let middle = |range: [f64; 2]| 0.5 * (range[0] + range[1]);
            let frozen =
                (bias.at(middle(bias.range())), plus.at(middle(plus.range())), minus.at(middle(minus.range())));
            let dwells = self.calibration.dwells.iter().zip(&solution.residuals);
            dwells
                .map(|(dwell, residual)| {
                    let (head, board) = (dwell.head(axis), dwell.board(axis));
                    let [n_plus, n_minus] = dwell.sums.rates(axis);
                    let change = n_plus * (1.0 / frozen.1 - 1.0 / plus.at(board))
                        + n_minus * (1.0 / frozen.2 - 1.0 / minus.at(board))
                        - (frozen.0 - bias.at(head));
                    (residual[axis] + change) * 1e6
                })
                .collect()
        };
        let start = self.calibration.dwells.first().map_or(0, |dwell| dwell.time_ns[0]);
        let hours = |dwell: &Dwell, _: usize| dwell.time_ns[0].saturating_sub(start) as f64 / 3.6e12;
        let head = |dwell: &Dwell, axis: usize| dwell.head(axis);
        const ERROR: &str = "Error / 1e-6 g0";
        let over_time = |axis: usize| Plot::new(&format!("{} over time", AXIS_NAMES[axis]), "Time / h", ERROR);
        let over_head =
            |axis: usize| self.plot_over_telemetry(&format!("{} over temperature", AXIS_NAMES[axis]), ERROR, axis, 0);
        type DwellView<'a> = (&'a dyn Fn(usize) -> Plot, &'a dyn Fn(&Dwell, usize) -> f64);
        let views: [DwellView<'_>; 2] = [(&over_time, &hours), (&over_head, &head)];
        let errors = [0, 1, 2].map(|axis| {
            let after: Vec<f64> = solution.residuals.iter().map(|residual| residual[axis] * 1e6).collect();
            (before(axis), after)
        });
        let mut figures = Vec::new();
        for (plot, x) in views {
            for (axis, (before, after)) in errors.iter().enumerate() {
                let over = |values: &[f64]| -> Vec<(f64, f64)> {
                    self.calibration.dwells.iter().map(|dwell| x(dwell, axis)).zip(values.iter().copied()).collect()
                };
                let plot = plot(axis).zero_line().series("Before", Style::Points, over(before)).series(
                    "After",
                    Style::Points,
                    over(after),
                );
                figures.push((plot.svg(), String::new()));
            }
        }
        let rms = |v: &[f64]| (v.iter().map(|v| v * v).sum::<f64>() / v.len() as f64).sqrt();
        let row = |(name, (before, after)): (&&str, &(Vec<f64>, Vec<f64>))| {
            vec![
                Cell::text(*name),
                Cell::number(rms(before), 3),
                Cell::number(rms(after), 3),
                Cell::number(rms(before) / rms(after), 1),
            ]
        };
        let rows: Vec<_> = AXIS_NAMES.iter().zip(&errors).map(row).collect();
        page.figures(&figures);
        page.table("Error of all dwells, rms [1e-6 g0]", &["Axis", "Before", "After", "Factor"], &rows);
    }

    fn budget(&self, page: &mut Page) {
        page.heading(2, "budget", "Error budget in navigation units");
        page.paragraph(
            "Standard errors are means over the range. At 1 g0 an error of the scale factor counts fully. An error of 1e-6 g0 tilts a level by 0.206 arc \
             seconds; in 60 s it grows to the velocity and position given.",
        );
        let mut rows = Vec::new();
        for (axis, part) in self.calibration.solution.axes.iter().enumerate() {
            let name = AXIS_NAMES[axis];
            // Errors of the bias are in g0, errors of a scale factor are relative to it.
            let size = |quantity: usize, u: f64| if quantity == 0 { 1.0 } else { part.curves[quantity].at(u).abs() };
            let mean = |quantity: usize| {
                let curve = &part.curves[quantity];
                let squares =
                    grid(curve.range()).map(|u| curve.standard_error(u).map(|e| (e / size(quantity, u)).powi(2)));
                squares.sum::<Option<f64>>().map(|sum| (sum / (CURVE_INTERVALS + 1) as f64).sqrt())
            };
            let slope = |quantity: usize| {
                let curve = &part.curves[quantity];
                let slopes = grid(curve.range()).map(|u| curve.slope(u).abs() / size(quantity, u));
                slopes.fold(0.0, f64::max) * 1e-3
            };
            let fit = |quantity: usize| {
                let orders = &self.calibration.orders[axis][quantity];
                let fit = &orders.regression.fits()[orders.choice.order];
                fit.leave_one_out_rms.map(|rms| rms / size(quantity, part.curves[quantity].range()[0]))
            };
            let misalignment = part.misalignment_error.map(|errors| errors[0].hypot(errors[1]));
            let lines = [
                ("standard error of the bias", mean(0)),
                ("standard error of K+, at 1 g0", mean(1)),
                ("standard error of K-, at 1 g0", mean(2)),
                ("leave-one-set-point-out, bias", fit(0)),
                ("leave-one-set-point-out, K+ at 1 g0", fit(1)),
                ("leave-one-set-point-out, K- at 1 g0", fit(2)),
                ("misalignments, at 1 g0 across", misalignment),
                ("residual of a dwell", Some(self.calibration.residual_sd(axis))),
            ];
            for (label, value) in lines {
                rows.push(navigation(&format!("{name} {label}"), value.unwrap_or(f64::NAN)));
            }
            rows.push(navigation(
                &format!("{name} 0.001 {} of head telemetry, bias at its steepest", self.unit()),
                slope(0),
            ));
            let steepest = slope(1).max(slope(2));
            rows.push(navigation(
                &format!("{name} 0.001 {} of board telemetry, K at its steepest, at 1 g0", self.unit()),
                steepest,
            ));
        }
        page.table("Errors and what they cost", &super::NAVIGATION, &rows);
    }

    fn set_points(&self, page: &mut Page) {
        page.heading(2, "set-points", "Set points reduced by themselves");
        page.paragraph(match self.calibration.options.method {
            Method::OneStage => {
                "The paper's two-stage values, for comparison; the table comes from all dwells at once."
            }
            Method::TwoStage => "The values that the polynomials go through.",
        });
        for (axis, name) in AXIS_NAMES.iter().enumerate() {
            let rows: Vec<_> = self
                .calibration
                .set_points
                .iter()
                .zip(&self.calibration.reduced)
                .map(|(stay, reduced)| {
                    let reduced = &reduced[axis];
                    vec![
                        Cell::text(format!("{} degC", stay.set_point_c)),
                        Cell::number(reduced.telemetry[0], 5),
                        Cell::number(reduced.telemetry[1], 5),
                        Cell::number(reduced.values[0] * 1e6, 3),
                        Cell::number(reduced.standard_errors[0] * 1e6, 3),
                        Cell::number(reduced.values[1], 3),
                        Cell::number(reduced.standard_errors[1], 3),
                        Cell::number(reduced.values[2], 3),
                        Cell::number(reduced.standard_errors[2], 3),
                        Cell::number(reduced.values[3] * 1e6, 2),
                        Cell::number(reduced.values[4] * 1e6, 2),
                    ]
                })
                .collect();
            let (m, o) = (AXIS_NAMES[(axis + 1) % AXES], AXIS_NAMES[(axis + 2) % AXES]);
            let header = [
                "Set point",
                "Head",
                "Board",
                "A / 1e-6 g0",
                "+-",
                "K+",
                "+-",
                "K-",
                "+-",
                &format!("onto {m} / 1e-6"),
                &format!("onto {o} / 1e-6"),
            ];
            page.table(&format!("{name}: errors from the scatter within the set point, tilt included"), &header, &rows);
        }
    }

    fn dwells(&self, page: &mut Page) {
        page.heading(2, "dwells", "Dwell check list");
        let rows: Vec<_> = self
            .calibration
            .dwells
            .iter()
            .enumerate()
            .map(|(index, dwell)| {
                let residual = self.calibration.solution.residuals[index];
                let place = Some((dwell.set_point_c, Some(self.position_number(dwell))));
                let verdict = if self.calibration.findings.iter().any(|finding| finding.place == place) {
                    Cell::Verdict(NoteKind::Warning, "see result".to_owned())
                } else {
                    Cell::Verdict(NoteKind::Good, "good".to_owned())
                };
                vec![
                    Cell::text(format!("{} / {}", dwell.set_point_c, self.position_number(dwell))),
                    Cell::Number(format!("{} to {}", dwell.lines[0], dwell.lines[1])),
                    Cell::Number(dwell.rows.to_string()),
                    Cell::number(dwell.sums.seconds, 1),
                    Cell::number(dwell.head(0), 5),
                    Cell::number(dwell.head_per_s(0) * 3600.0, 5),
                    Cell::number(residual[0] * 1e6, 2),
                    Cell::number(residual[1] * 1e6, 2),
                    Cell::number(residual[2] * 1e6, 2),
                    verdict,
                ]
            })
            .collect();
        let header = [
            "Set point / position",
            "Lines",
            "Rows",
            "Time / s",
            &format!("A1 head / {}", self.unit()),
            &format!("drift / ({}/h)", self.unit()),
            "A1 / 1e-6 g0",
            "A2 / 1e-6 g0",
            "A3 / 1e-6 g0",
            "Check",
        ];
        page.table("Dwells with their residuals", &header, &rows);
    }

    fn positions(&self, page: &mut Page) {
        page.heading(2, "positions", "Positions and ranges");
        let rows: Vec<_> = self
            .campaign
            .positions
            .iter()
            .map(|position| {
                let angle = |k: usize| position.angles.map_or("-".to_owned(), |angles| angles[k].to_string());
                let mut row = vec![Cell::text(position.number.to_string()), Cell::text(position.label.clone())];
                row.extend([Cell::Number(angle(0)), Cell::Number(angle(1))]);
                row.extend(position.specific_force.map(|f| Cell::number(f, 6)));
                row
            })
            .collect();
        let header = ["Number", "Name", "Outer / deg", "Inner / deg", "A1", "A2", "A3"];
        page.table("Specific force in units of the local gravity", &header, &rows);
        let range = |[low, high]: [f64; 2]| format!("{low} to {high} {}", self.unit());
        let rows: Vec<_> = AXIS_NAMES
            .iter()
            .zip(&self.calibration.solution.axes)
            .map(|(name, part)| {
                let [bias, plus, _] = &part.curves;
                vec![Cell::text(*name), Cell::Number(range(bias.range())), Cell::Number(range(plus.range()))]
            })
            .collect();
        page.table("Ranges of the table", &["Axis", "Head telemetry", "Board telemetry"], &rows);
    }

    fn provenance(&self, page: &mut Page) {
        page.heading(2, "provenance", "Provenance");
        page.key_values(&[
            ("Tool", self.source.tool.as_str()),
            ("Time", &self.source.time),
            ("Campaign file", &self.source.campaign),
            ("its SHA-256", &self.source.campaign_sha256),
            ("Samples", &self.campaign.samples.join(", ")),
            ("their SHA-256", &self.source.samples_sha256),
            ("Table", &self.calibration.table.digest().to_string()),
        ]);
    }
}

/// Half length of the error bar of a value that is reduced from this number of dwells; NaN without degrees of freedom.
fn half_length(standard_error: f64, dwells: usize) -> f64 {
    match dwells.saturating_sub(PARAMETERS) {
        0 => f64::NAN,
        freedom => standard_error * student_quantile(CONFIDENCE, freedom),
    }
}

/// Evenly spaced telemetry over a range, both ends included, for drawing and averaging.
fn grid([low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
    (0..=CURVE_INTERVALS).map(move |i| low + (high - low) * i as f64 / CURVE_INTERVALS as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_bars_widen_with_few_dwells_and_need_one_more_than_there_are_parameters() {
        assert!(half_length(1.0, PARAMETERS).is_nan() && half_length(1.0, 2).is_nan());
        assert!(half_length(f64::NAN, 12).is_nan());
        // Student's t with 1 and 7 degrees of freedom.
        assert!((half_length(2.0, PARAMETERS + 1) - 2.0 * 12.7062).abs() < 1e-3);
        assert!((half_length(2.0, 12) - 2.0 * 2.36462).abs() < 1e-4);
    }
}
