//! The report of a calibration: the page, and the sections that only accelerometers have.
//!
//! 1. `triad`, `orders`: the sections that are the same for accelerometers and gyroscopes.
//! 2. `gyroscopes`: those that only gyroscopes have.

mod gyroscopes;
mod orders;
mod parts;
mod triad;

use super::page::{Cell, NoteKind, Page};
use super::plot::{Plot, Style};
use crate::calibration::parts::{Report, remark};
use crate::parts::{NAVIGATION, navigation, provenance};
use isotherm_calibration::{Accuracy, CalibratedTriad, Calibration, CampaignSource};
use isotherm_campaign::{Campaign, Dwell};
use isotherm_finding::{Location, RunNumber};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use triad::Budget;

/// The page as HTML.
#[must_use]
pub fn html(campaign: &Campaign, calibration: &Calibration, source: &CampaignSource) -> String {
    let report = Report { campaign, calibration, source, triads: CalibratedTriad::all(calibration).collect() };
    let title = format!("Calibration of {}", campaign.imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", source.campaign, source.time, source.tool));
    report.result(&mut page);
    for triad in &report.triads {
        report.curves(&mut page, triad);
        report.set_point_residuals(&mut page, triad);
        match triad.gyroscopes {
            None => report.dwell_residuals(&mut page),
            Some(found) => report.run_residuals(&mut page, found),
        }
        report.orders(&mut page, triad);
        report.misalignments(&mut page, triad);
        match triad.gyroscopes {
            None => {
                report.before_after(&mut page);
                report.budget(&mut page);
            }
            Some(found) => {
                report.g_sensitivities(&mut page, found);
                report.gyroscope_budget(&mut page, triad, found);
            }
        }
        report.set_points(&mut page, triad);
    }
    if let Some(found) = &calibration.transients {
        super::transients::sections(&mut page, found, &campaign.temperature_unit);
    }
    report.dwells(&mut page);
    report.turns(&mut page);
    report.positions(&mut page);
    report.provenance(&mut page);
    page.finish()
}

impl Report<'_> {
    fn unit(&self) -> &str {
        &self.campaign.temperature_unit
    }

    fn position_number(&self, dwell: &Dwell) -> u32 {
        self.campaign.positions[dwell.position].number
    }

    fn result(&self, page: &mut Page) {
        let calibration = self.calibration;
        page.heading(2, "result", "Result");
        if calibration.findings.is_empty() {
            let turns = if calibration.gyroscopes.is_some() { "turns, Earth's rate, " } else { "" };
            let text = format!(
                "Positions, {turns}time, soak, stillness, telemetry, saturation, fit and outliers were looked at without a remark."
            );
            page.note(NoteKind::Good, "Nothing found", &text);
        }
        for finding in &calibration.findings {
            let line = finding
                .line
                .map_or(String::new(), |line| format!("{}, line {line}: ", self.campaign.samples.join(", ")));
            page.note(NoteKind::Warning, "Look at this", &format!("{line}{finding}"));
        }
        let conditions = calibration.observability.iter().map(|o| format!("{:.1}", o.condition));
        for triad in &self.triads {
            let accuracy = Accuracy::of_triad(calibration, triad);
            page.paragraph(&format!("{}{accuracy}.", self.whose(triad)));
            if let Some(caution) = accuracy.caution() {
                page.note(NoteKind::Warning, "Caution", &caution);
            }
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
        rows.extend(self.gyroscope_facts());
        page.key_values(&rows);
    }

    fn excluded(&self) -> String {
        let places = self.calibration.options.exclude.iter().map(|(set_point, number)| format!("{set_point}/{number}"));
        Some(places.collect::<Vec<_>>().join(", ")).filter(|t| !t.is_empty()).unwrap_or_else(|| "nothing".to_owned())
    }

    /// Residuals of the accelerometers in each dwell.
    fn dwell_residuals(&self, page: &mut Page) {
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

    /// Errors of the campaign's own dwells. Figure 6 of the paper, over a separate run, is in the report of a
    /// verification.
    fn before_after(&self, page: &mut Page) {
        self.heading(page, &self.triads[0], "before-after", "Before and after, on the campaign's own dwells");
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
        let over_head = |axis: usize| {
            let title = format!("{} over temperature", AXIS_NAMES[axis]);
            self.plot_over_telemetry(&self.triads[0], &title, ERROR, axis, 0)
        };
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
        self.heading(page, &self.triads[0], "budget", "Error budget in navigation units");
        page.paragraph(
            "Standard errors are means over the range. At 1 g0 an error of the scale factor counts fully. An error of 1e-6 g0 tilts a level by 0.206 arc \
             seconds; in 60 s it grows to the velocity and position given.",
        );
        let triad = &self.triads[0];
        let mut rows = Vec::new();
        for (axis, name) in triad.names.into_iter().enumerate() {
            let Budget { standard_error, leave_one_out, slope, misalignment } = Budget::of(triad, axis);
            let lines = [
                ("standard error of the bias", standard_error[0]),
                ("standard error of K+, at 1 g0", standard_error[1]),
                ("standard error of K-, at 1 g0", standard_error[2]),
                ("leave-one-set-point-out, bias", leave_one_out[0]),
                ("leave-one-set-point-out, K+ at 1 g0", leave_one_out[1]),
                ("leave-one-set-point-out, K- at 1 g0", leave_one_out[2]),
                ("misalignments, at 1 g0 across", misalignment),
                ("residual of a dwell", Some(self.calibration.residual_sd(axis))),
            ];
            for (label, value) in lines {
                rows.push(navigation(&format!("{name} {label}"), value.unwrap_or(f64::NAN)));
            }
            rows.push(navigation(
                &format!("{name} 0.001 {} of head telemetry, bias at its steepest", self.unit()),
                slope[0],
            ));
            rows.push(navigation(
                &format!("{name} 0.001 {} of board telemetry, K at its steepest, at 1 g0", self.unit()),
                slope[1].max(slope[2]),
            ));
        }
        page.table("Errors and what they cost", &NAVIGATION, &rows);
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
                let number = RunNumber::Position(self.position_number(dwell));
                let mut row = vec![
                    Cell::text(format!("{} / {}", dwell.set_point_c, self.position_number(dwell))),
                    Cell::Number(format!("{} to {}", dwell.lines[0], dwell.lines[1])),
                    Cell::Number(dwell.rows.to_string()),
                    Cell::number(dwell.sums.seconds, 1),
                    Cell::number(dwell.head(0), 5),
                    Cell::number(dwell.head_per_s(0) * 3600.0, 5),
                    Cell::number(residual[0] * 1e6, 2),
                    Cell::number(residual[1] * 1e6, 2),
                    Cell::number(residual[2] * 1e6, 2),
                ];
                row.extend(self.gyroscope_residuals(dwell.lines[0]).into_iter().flatten());
                row.push(self.verdict(dwell.set_point_c, number));
                row
            })
            .collect();
        let (head, drift) = (format!("A1 head / {}", self.unit()), format!("drift / ({}/h)", self.unit()));
        let header = ["Set point / position", "Lines", "Rows", "Time / s", &head, &drift];
        let residuals = ["A1 / 1e-6 g0", "A2 / 1e-6 g0", "A3 / 1e-6 g0"];
        let gyroscopes = self.calibration.gyroscopes.iter().flat_map(|_| gyroscopes::RESIDUALS);
        let header: Vec<_> = header.into_iter().chain(residuals).chain(gyroscopes).chain(["Check"]).collect();
        page.table("Dwells with their residuals", &header, &rows);
    }

    /// Whether there is a finding about a dwell or turn.
    fn verdict(&self, set_point_c: f64, number: RunNumber) -> Cell {
        let place = Some(Location::SetPoint(set_point_c, Some(number)));
        if self.calibration.findings.iter().any(|finding| finding.place == place) {
            remark()
        } else {
            Cell::Verdict(NoteKind::Good, "good".to_owned())
        }
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
        self.turn_list(page);
        let range = |[low, high]: [f64; 2]| format!("{low} to {high} {}", self.unit());
        let sensors = self.triads.iter().flat_map(|triad| triad.names.into_iter().zip(triad.curves));
        let rows: Vec<_> = sensors
            .map(|(name, [bias, plus, _])| {
                vec![Cell::text(name), Cell::Number(range(bias.range())), Cell::Number(range(plus.range()))]
            })
            .collect();
        page.table("Ranges of the table", &["Axis", "Head telemetry", "Board telemetry"], &rows);
    }

    fn provenance(&self, page: &mut Page) {
        let samples = self.campaign.samples.join(", ");
        let samples = [("Samples", samples.as_str()), ("their SHA-256", &self.source.samples_sha256)];
        provenance(page, self.campaign, self.source, &samples, &self.calibration.table);
    }
}
