//! The report of a calibration: the page, and the sections that only accelerometers have.
//!
//! 1. `headline`: the first screen.
//! 2. `triad`, `orders`: the sections that are the same for accelerometers and gyroscopes.
//! 3. `gyroscopes`: those that only gyroscopes have.

mod gyroscopes;
mod headline;
mod orders;
mod parts;
mod triad;

use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use crate::calibration::parts::{CalibrationPage, angle, remark};
use crate::parts::{NAVIGATION, navigation, never_shown, provenance};
use isotherm_campaign::{Campaign, Dwell, Position};
use isotherm_fit::{CalibratedTriad, Calibration, CampaignSource};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::Curve;
use isotherm_support::finding::{Location, RunNumber};
use triad::Budget;

/// Label of errors of accelerometers.
const ERROR: &str = "Error / 1e-6 g0";

/// The page as HTML. `locate` gives file and line of a row.
#[must_use]
pub fn html(
    campaign: &Campaign,
    calibration: &Calibration,
    source: &CampaignSource,
    locate: &dyn Fn(u64) -> String,
) -> String {
    let report =
        CalibrationPage { campaign, calibration, source, locate, triads: CalibratedTriad::all(calibration).collect() };
    let title = format!("Calibration of {}", campaign.imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", source.campaign, source.time, source.tool));
    report.result(&mut page);
    for triad in &report.triads {
        report.triad(&mut page, triad);
    }
    if let Some(found) = &calibration.transients {
        super::transients::sections(&mut page, found, &campaign.temperature_unit);
    }
    report.dwells(&mut page);
    report.turns(&mut page);
    report.positions(&mut page);
    report.measurement(&mut page);
    report.provenance(&mut page);
    page.finish()
}

/// The set points of a curve as the page draws them: temperature, value, and half length of the error bar, NaN where it
/// is
/// not known; in the unit of the fit.
#[must_use]
pub fn set_points(triad: &CalibratedTriad<'_>, axis: usize, quantity: usize) -> Vec<[f64; 3]> {
    let points = triad::points(triad, axis, quantity, &|_| 0.0, 1.0);
    points.zip(triad::errors(triad, axis, quantity)).map(|((at, value), half)| [at, value, half]).collect()
}

impl CalibrationPage<'_> {
    fn triad(&self, page: &mut Page, triad: &CalibratedTriad<'_>) {
        self.curves(page, triad);
        self.set_point_residuals(page, triad);
        match triad.gyroscopes {
            None => self.dwell_residuals(page),
            Some(found) => self.run_residuals(page, found),
        }
        self.orders(page, triad);
        self.misalignments(page, triad);
        match triad.gyroscopes {
            None => {
                self.before_after(page);
                self.budget(page);
            }
            Some(found) => {
                self.g_sensitivities(page, found);
                self.gyroscope_budget(page, triad, found);
            }
        }
        self.set_points(page, triad);
    }

    fn unit(&self) -> &str {
        &self.campaign.temperature_unit
    }

    fn position_number(&self, dwell: &Dwell) -> u32 {
        self.campaign.positions[dwell.position].number
    }

    fn result(&self, page: &mut Page) {
        page.heading(2, "result", "Result");
        self.headline(page);
    }

    /// What was measured, and how the table was made of it.
    fn measurement(&self, page: &mut Page) {
        page.heading(2, "measurement", "Measurement");
        page.key_values(&[self.facts(), self.gyroscope_facts()].concat());
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let (calibration, campaign) = (self.calibration, self.campaign);
        let order = calibration.options.order.map_or_else(|| "auto".to_owned(), |order| format!("{order}, asked for"));
        let conditions = calibration.observability.iter().map(|o| format!("{:.1}", o.condition));
        let mut rows = vec![
            ("IMU", campaign.imu.to_string()),
            ("Serial", campaign.serial.clone().unwrap_or_else(|| "not stated".to_owned())),
            ("Set points", calibration.set_points.len().to_string()),
            ("Dwells", calibration.dwells.len().to_string()),
            ("Left out", self.excluded()),
            ("Method", calibration.options.method.name().to_owned()),
            ("Order", order),
            ("1 g0", format!("{} m/s2", campaign.gravity_reference)),
            ("Gravity at the station", format!("{} m/s2", campaign.gravity_local)),
            ("Condition of the positions", conditions.collect::<Vec<_>>().join(", ")),
        ];
        if let Some([x, y]) = calibration.solution.tilt {
            rows.push(("Tilt of the base", format!("{:.2}e-6 rad about X, {:.2}e-6 rad about Y", x * 1e6, y * 1e6)));
        }
        let residuals = (0..AXES).map(|axis| format!("{:.3}", calibration.residual_sd(axis) * 1e6));
        rows.push(("Residuals, rms", format!("{} ug0", residuals.collect::<Vec<_>>().join(", "))));
        rows
    }

    fn excluded(&self) -> String {
        let places = self.calibration.options.exclude.iter().map(|(set_point, number)| format!("{set_point}/{number}"));
        Some(places.collect::<Vec<_>>().join(", ")).filter(|t| !t.is_empty()).unwrap_or_else(|| "nothing".to_owned())
    }

    /// What dwells are shown over: their times, or their order if they have none.
    fn order_label(&self) -> &'static str {
        let are_timed = self.calibration.dwells.iter().all(|dwell| dwell.time_ns.is_some());
        if are_timed { "Time / h" } else { "Number of the dwell" }
    }

    /// Time of a dwell since the first one \[h\], or its number, from 1.
    fn order_of(&self, dwell: &Dwell) -> f64 {
        let dwells = &self.calibration.dwells;
        let start = dwells.first().and_then(|dwell| dwell.time_ns);
        match dwell.time_ns.zip(start) {
            Some(([begin_ns, _], [start_ns, _])) => begin_ns.saturating_sub(start_ns) as f64 / 3.6e12,
            None => dwells.iter().take_while(|other| other.lines != dwell.lines).count() as f64 + 1.0,
        }
    }

    /// Residuals of the accelerometers in each dwell.
    fn dwell_residuals(&self, page: &mut Page) {
        page.heading(3, "residuals-dwells", "Dwells");
        let mut plots = |x: &dyn Fn(usize, &Dwell) -> f64, title: &str, label: &str| {
            page.plots(&[0, 1, 2].map(|axis| {
                let dwells = self.calibration.dwells.iter().zip(&self.calibration.solution.residuals);
                let points = dwells.map(|(dwell, residual)| (x(axis, dwell), residual[axis] * 1e6));
                let plot = Plot::new(&format!("{}: {title}", AXIS_NAMES[axis]), label, "Residual / 1e-6 g0");
                plot.zero_line().series("Dwells", Style::Points, points)
            }));
        };
        plots(&|_, dwell| self.order_of(dwell), "residuals over time", self.order_label());
        let label = format!("dU/dt of the head / ({} per h)", self.unit());
        plots(&|axis, dwell| dwell.head_per_s(axis) * 3600.0, "residuals against drift", &label);
        page.paragraph(
            "A trend against dU/dt would mean that heads or boards lag behind their temperature: no polynomial of the temperature \
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
        let errors = [0, 1, 2].map(|axis| [self.frozen_errors(axis), self.errors(axis)]);
        let series = |plot: Plot, axis: usize, x: &dyn Fn(&Dwell) -> f64| {
            let [before, after] = [0, 1].map(|time| {
                let points = self.calibration.dwells.iter().zip(&errors[axis][time]);
                points.map(|(dwell, error)| (x(dwell), *error)).collect::<Vec<_>>()
            });
            plot.zero_line().series("Before", Style::Points, before).series("After", Style::Points, after)
        };
        let over_time = |axis: usize| {
            let plot = Plot::new(&format!("{} over time", AXIS_NAMES[axis]), self.order_label(), ERROR);
            series(plot, axis, &|dwell| self.order_of(dwell))
        };
        let over_head = |axis: usize| {
            let title = format!("{} over temperature", AXIS_NAMES[axis]);
            let plot = self.plot_over_temperature(&self.triads[0], &title, ERROR, axis, 0);
            series(plot, axis, &|dwell| dwell.head(axis))
        };
        page.plots(&[[0, 1, 2].map(over_time), [0, 1, 2].map(over_head)].concat());
    }

    /// The errors of the dwells \[1e-6 g0\].
    fn errors(&self, axis: usize) -> Vec<f64> {
        self.calibration.solution.residuals.iter().map(|residual| residual[axis] * 1e6).collect()
    }

    /// The errors of the dwells with the coefficients frozen at mid temperature \[1e-6 g0\].
    fn frozen_errors(&self, axis: usize) -> Vec<f64> {
        let solution = &self.calibration.solution;
        let [bias, plus, minus] = &solution.axes[axis].curves;
        let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
        let frozen = [bias, plus, minus].map(|curve| curve.at(middle(curve.range())));
        let error = |(dwell, residual): (&Dwell, &[f64; AXES])| {
            let (head, board) = (dwell.head(axis), dwell.board(axis));
            let [n_plus, n_minus] = dwell.sums.rates(axis);
            let change = n_plus * (1.0 / frozen[1] - 1.0 / plus.at(board))
                + n_minus * (1.0 / frozen[2] - 1.0 / minus.at(board))
                - (frozen[0] - bias.at(head));
            (residual[axis] + change) * 1e6
        };
        self.calibration.dwells.iter().zip(&solution.residuals).map(error).collect()
    }

    fn budget(&self, page: &mut Page) {
        self.heading(page, &self.triads[0], "budget", "Error budget in navigation units");
        page.paragraph(
            "Standard errors are means over the range. At 1 g0 an error of the scale factor counts fully. An error of 1e-6 g0 tilts a level by 0.206 arc \
             seconds; in 60 s it grows to the velocity and position given.",
        );
        let triad = &self.triads[0];
        let of_axis = |(axis, name): (usize, &str)| {
            let Budget { standard_error, leave_one_out, slope, misalignment } = Budget::of(triad, axis);
            let step = |of: &str| format!("0.001 {} of {of} at its steepest", self.unit());
            let lines = [
                ("standard error of the bias".to_owned(), standard_error[0]),
                ("standard error of K+, at 1 g0".to_owned(), standard_error[1]),
                ("standard error of K-, at 1 g0".to_owned(), standard_error[2]),
                ("leave-one-set-point-out, bias".to_owned(), leave_one_out[0]),
                ("leave-one-set-point-out, K+ at 1 g0".to_owned(), leave_one_out[1]),
                ("leave-one-set-point-out, K- at 1 g0".to_owned(), leave_one_out[2]),
                ("misalignments, at 1 g0 across".to_owned(), misalignment),
                ("residual of a dwell".to_owned(), Some(self.calibration.residual_sd(axis))),
                (step("head temperature, bias"), Some(slope[0])),
                (step("board temperature, K") + ", at 1 g0", Some(slope[1].max(slope[2]))),
            ];
            lines.map(|(label, value)| navigation(&format!("{name} {label}"), value.unwrap_or(f64::NAN)))
        };
        let rows: Vec<_> = triad.names.into_iter().enumerate().flat_map(of_axis).collect();
        page.compact_table("Errors and what they cost", &NAVIGATION, rows);
    }

    fn dwells(&self, page: &mut Page) {
        page.heading(2, "dwells", "Dwell check list");
        let row = |(dwell, residual): (&Dwell, &[f64; AXES])| {
            let number = self.position_number(dwell);
            let mut row = vec![
                Cell::text(format!("{} / {number}", dwell.set_point_c)),
                Cell::Number(format!("{} to {}", dwell.lines[0], dwell.lines[1])),
                Cell::Number(dwell.rows.to_string()),
                Cell::number(dwell.sums.seconds, 1),
                Cell::number(dwell.head(0), 5),
                Cell::number(dwell.head_per_s(0) * 3600.0, 5),
            ];
            row.extend(residual.map(|residual| Cell::number(residual * 1e6, 2)));
            row.extend(self.gyroscope_residuals(dwell.lines[0]).into_iter().flatten());
            row.push(self.verdict(dwell.set_point_c, RunNumber::Position(number)));
            row
        };
        let rows: Vec<_> = self.calibration.dwells.iter().zip(&self.calibration.solution.residuals).map(row).collect();
        let (head, drift) = (format!("A1 head / {}", self.unit()), format!("drift / ({}/h)", self.unit()));
        let header = ["Set point / position", "Lines", "Rows", "Time / s", &head, &drift];
        let residuals = ["A1 / 1e-6 g0", "A2 / 1e-6 g0", "A3 / 1e-6 g0"];
        let gyroscopes = self.calibration.gyroscopes.iter().flat_map(|_| gyroscopes::RESIDUALS);
        let header: Vec<_> = header.into_iter().chain(residuals).chain(gyroscopes).chain(["Check"]).collect();
        page.compact_table("Dwells with their residuals", &header, rows);
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
        let columns: [Column<'_, &Position>; 7] = [
            ("Number", &|it| Cell::text(it.number.to_string())),
            ("Name", &|it| Cell::text(&it.label)),
            ("Outer / deg", &|it| angle(it, 0)),
            ("Inner / deg", &|it| angle(it, 1)),
            ("A1", &|it| Cell::number(it.specific_force[0], 6)),
            ("A2", &|it| Cell::number(it.specific_force[1], 6)),
            ("A3", &|it| Cell::number(it.specific_force[2], 6)),
        ];
        page.columns("Specific force in units of the local gravity", &self.campaign.positions, &columns);
        self.turn_list(page);
        let range = |curve: &Curve| {
            let [low, high] = curve.range();
            Cell::Number(format!("{low} to {high} {}", self.unit()))
        };
        let columns: [Column<'_, (&str, &[Curve; 3])>; 3] = [
            ("Axis", &|(name, _)| Cell::text(*name)),
            ("Head temperature", &|(_, [bias, ..])| range(bias)),
            ("Board temperature", &|(_, [_, plus, _])| range(plus)),
        ];
        let sensors = self.triads.iter().flat_map(|triad| triad.names.into_iter().zip(triad.curves));
        page.columns("Ranges of the table", sensors, &columns);
    }

    fn provenance(&self, page: &mut Page) {
        let samples = self.campaign.samples.join(", ");
        let samples = [("Samples", samples.as_str()), ("their SHA-256", &self.source.samples_sha256)];
        provenance(page, self.campaign, self.source, &samples, &self.calibration.table);
        let parts = [
            "how good the table is on other data, which verify shows on another recording",
            "an error that all set points share",
        ];
        never_shown(page, &parts.map(str::to_owned));
    }
}
