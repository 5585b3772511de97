//! The sections of a calibration's page that only gyroscopes have.

use super::parts::{CalibrationPage, angle, remark};
use super::triad::Budget;
use crate::page::{Cell, Column, Page};
use crate::plot::{Plot, Style};
use isotherm_campaign::Turn;
use isotherm_fit::{CalibratedTriad, FittedRun, GyroscopeCalibration, RunPlace, TriadObservability};
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, largest};

/// Column headings of a run's residuals.
pub(super) const RESIDUALS: [&str; AXES] = ["G1 / arcsec", "G2 / arcsec", "G3 / arcsec"];

/// The label of an error, and its size: a rate \[deg/h\], or a part of the rate.
type ErrorCost = (String, Option<f64>, Option<f64>);

/// A whole turn \[arcsec\].
const WHOLE_TURN: f64 = 1_296_000.0;

impl CalibrationPage<'_> {
    /// What the first list of the page says about the gyroscopes.
    pub(super) fn gyroscope_facts(&self) -> Vec<(&'static str, String)> {
        let Some(found) = &self.calibration.gyroscopes else { return Vec::new() };
        let walks = (0..AXES).map(|axis| format!("{:.5}", found.random_walk(axis)));
        let TriadObservability { condition, rank, unknowns, .. } = &found.observability;
        let condition = format!("{condition:.1}, with {rank} of {unknowns} unknowns of a set point determined");
        let mut rows = vec![
            ("Turns", found.turns().to_string()),
            ("Condition of positions and turns", condition),
            ("Random walk, G1 to G3", format!("{} deg/sqrt(h)", walks.collect::<Vec<_>>().join(", "))),
        ];
        rows.extend(self.earth_facts(found).into_iter().flatten());
        rows.extend(found.left_over.as_ref().map(|left| {
            let text = format!(
                "at most {:.4} deg/h of bias, {:.2} ppm of scale factor, {:.4} deg/h/g0 of g-sensitivity, {:.2}e-6 rad of misalignment",
                left.bias,
                left.scale_factor * 1e6,
                left.g_sensitivity,
                left.misalignment * 1e6
            );
            ("Left of Earth's rate", text)
        }));
        rows
    }

    fn earth_facts(&self, found: &GyroscopeCalibration) -> Option<[(&'static str, String); 2]> {
        let (earth, [x, y], latitude) = (found.earth?, found.solution.earth?, self.campaign.latitude_deg?);
        let interval = found.horizontal_rate_interval(CONFIDENCE).unwrap_or(f64::NAN);
        let horizontal = format!(
            "{:.4} +- {interval:.4} deg/h, 95 %; at a latitude of {latitude} degrees it is {:.4} deg/h",
            earth.found, earth.expected
        );
        let components = format!("{x:.4}, {y:.4}, {:.4} deg/h; Z is that of the latitude", earth.along_z);
        Some([("Earth's horizontal rate", horizontal), ("Earth's rate along the base's X, Y, Z", components)])
    }

    /// Residuals of the gyroscopes in each dwell and turn.
    pub(super) fn run_residuals(&self, page: &mut Page, found: &GyroscopeCalibration) {
        page.heading(3, "residuals-runs", "Dwells and turns");
        let start_ns = found.runs.iter().filter_map(|run| run.start_ns).min().unwrap_or(0);
        let are_timed = found.runs.iter().all(|run| run.start_ns.is_some());
        let label = if are_timed { "Time / h" } else { "Number of the run" };
        let figure = |axis: usize| {
            let points = |turns: bool| {
                let runs = found.runs.iter().enumerate();
                let runs = runs.filter(move |(_, run)| matches!(run.place, RunPlace::Turn(_)) == turns);
                runs.map(move |(index, run)| {
                    let hours = run.start_ns.filter(|_| are_timed).map(|ns| (ns - start_ns) as f64 / 3.6e12);
                    (hours.unwrap_or(index as f64 + 1.0), run.residual[axis] / run.seconds.sqrt())
                })
            };
            let title = format!("{}: residuals over time", GYROSCOPE_NAMES[axis]);
            let plot = Plot::new(&title, label, "Residual / (arcsec/sqrt(s))").zero_line();
            plot.series("Dwells", Style::Points, points(false)).series("Turns", Style::Points, points(true))
        };
        page.plots(&[0, 1, 2].map(figure));
        page.paragraph(
            "Residuals over the root of the run's length, as the fit weighs them: of a random walk of the angle, dwells and turns scatter alike.",
        );
    }

    pub(super) fn g_sensitivities(&self, page: &mut Page, found: &GyroscopeCalibration) {
        page.heading(2, "g-sensitivities", "g-sensitivities");
        let part = |axis: &usize| &found.solution.gyroscopes[*axis];
        let interval = |axis: &usize| part(axis).g_sensitivity_interval(CONFIDENCE);
        let columns: [Column<'_, (usize, usize)>; 4] = [
            ("g-sensitivity", &|(axis, k)| Cell::text(format!("{} along {}", GYROSCOPE_NAMES[*axis], AXIS_NAMES[*k]))),
            ("Value", &|(axis, k)| Cell::number(part(axis).g_sensitivity[*k], 4)),
            ("Standard error", &|(axis, k)| Cell::known(part(axis).g_sensitivity_error.map(|it| it[*k]), 4)),
            ("95 % interval, +-", &|(axis, k)| Cell::known(interval(axis).map(|it| it[*k]), 4)),
        ];
        let rows = (0..AXES * AXES).map(|index| (index / AXES, index % AXES));
        page.columns("g-sensitivities [deg/h/g0]", rows, &columns);
        page.paragraph(
            "The part along the vertical comes with Earth's vertical rate, which the dwells cannot distinguish from it: that rate is taken from the latitude. \
             0.1 degrees of latitude are 0.02 deg/h/g0.",
        );
    }

    /// What the errors cost: those of the bias in an hour at rest, those of the scale factors and misalignments in a
    /// whole turn.
    pub(super) fn gyroscope_budget(&self, page: &mut Page, triad: &CalibratedTriad<'_>, found: &GyroscopeCalibration) {
        self.heading(page, triad, "budget", "Error budget in navigation units");
        page.paragraph(
            "Standard errors are means over the range. An error of 1 deg/h turns the attitude by 1 arcsec in a second, 60 arcsec in a minute; an error of \
             1 ppm, or of 1e-6 rad of misalignment, by 1.296 arcsec in a whole turn.",
        );
        let of_axis = |(axis, name): (usize, &str)| {
            let Budget { standard_error, leave_one_out, slope, misalignment } = Budget::of(triad, axis);
            let s = found.solution.gyroscopes[axis].g_sensitivity_error;
            let at_rest = [
                ("standard error of the bias", standard_error[0]),
                ("leave-one-set-point-out, bias", leave_one_out[0]),
                ("g-sensitivity, at 1 g0", s.map(largest)),
                ("head temperature 0.001 off, bias at its steepest", Some(slope[0])),
            ];
            let in_motion = [
                ("standard error of K+", standard_error[1]),
                ("standard error of K-", standard_error[2]),
                ("leave-one-set-point-out, K+", leave_one_out[1]),
                ("leave-one-set-point-out, K-", leave_one_out[2]),
                ("misalignments, turning across", misalignment),
                ("board temperature 0.001 off, K at its steepest", Some(slope[1].max(slope[2]))),
            ];
            let at_rest = at_rest.map(|(label, rate)| (format!("{name} {label}"), rate, None));
            let in_motion = in_motion.map(|(label, part)| (format!("{name} {label}"), None, part));
            at_rest.into_iter().chain(in_motion)
        };
        let columns: [Column<'_, ErrorCost>; 5] = [
            ("Error", &|(label, ..)| Cell::text(label)),
            ("Rate / deg/h", &|(_, rate, _)| Cell::known(*rate, 5)),
            ("In 60 s / arcsec", &|(_, rate, _)| Cell::known(rate.map(|rate| rate * 60.0), 3)),
            ("Scale / 1e-6", &|(.., part)| Cell::known(part.map(|part| part * 1e6), 3)),
            ("In a turn / arcsec", &|(.., part)| Cell::known(part.map(|part| part * WHOLE_TURN), 3)),
        ];
        let errors = triad.names.into_iter().enumerate().flat_map(of_axis);
        page.columns("Errors and what they cost", errors, &columns);
    }

    /// The residuals of the gyroscopes in the dwell whose first row is on this line; `None` without gyroscopes.
    pub(super) fn gyroscope_residuals(&self, line: u64) -> Option<[Cell; AXES]> {
        let found = self.calibration.gyroscopes.as_ref()?;
        let run = found.runs.iter().find(|run| run.lines[0] == line);
        Some([0, 1, 2].map(|axis| Cell::number(run.map_or(f64::NAN, |run| run.residual[axis]), 2)))
    }

    /// The turns that were taken.
    pub(super) fn turns(&self, page: &mut Page) {
        let Some(found) = &self.calibration.gyroscopes else { return };
        page.heading(2, "turns", "Turn check list");
        // What is wrong with a turn at every set point is one finding, without a place, on a line of one of its runs.
        let is_everywhere = |place: RunPlace| {
            let of_place = found.runs.iter().filter(|run| run.place == place).map(|run| run.lines[0]..=run.lines[1]);
            let lines: Vec<_> =
                self.calibration.findings.iter().filter(|it| it.place.is_none()).filter_map(|it| it.line).collect();
            of_place.into_iter().any(|rows| lines.iter().any(|line| rows.contains(line)))
        };
        let row = |run: &FittedRun| {
            let set_point_c = self.calibration.set_points[run.set_point].set_point_c;
            let number = run.place.number(self.campaign);
            let mut row = vec![
                Cell::text(format!("{set_point_c} / {}", number.value())),
                Cell::Number(format!("{} to {}", run.lines[0], run.lines[1])),
                Cell::number(run.seconds, 1),
            ];
            row.extend(run.residual.map(|residual| Cell::number(residual, 2)));
            row.push(if is_everywhere(run.place) { remark() } else { self.verdict(set_point_c, number) });
            row
        };
        let turns = found.runs.iter().filter(|run| matches!(run.place, RunPlace::Turn(_)));
        let rows: Vec<_> = turns.map(row).collect();
        let header = ["Set point / turn", "Lines", "Time / s"].into_iter().chain(RESIDUALS).chain(["Check"]);
        page.compact_table("Turns with their residuals", &header.collect::<Vec<_>>(), rows);
    }

    /// The turns of the campaign file.
    pub(super) fn turn_list(&self, page: &mut Page) {
        if self.calibration.gyroscopes.is_none() {
            return;
        }
        let columns: [Column<'_, &Turn>; 10] = [
            ("Number", &|it| Cell::text(it.start.number.to_string())),
            ("Angle / deg", &|it| Cell::Number(it.angle_deg.to_string())),
            ("about A1", &|it| Cell::number(it.axis[0], 6)),
            ("A2", &|it| Cell::number(it.axis[1], 6)),
            ("A3", &|it| Cell::number(it.axis[2], 6)),
            ("Outer / deg", &|it| angle(&it.start, 0)),
            ("Inner / deg", &|it| angle(&it.start, 1)),
            ("A1", &|it| Cell::number(it.start.specific_force[0], 6)),
            ("A2", &|it| Cell::number(it.start.specific_force[1], 6)),
            ("A3", &|it| Cell::number(it.start.specific_force[2], 6)),
        ];
        let caption = "Turns: axis, where they begin, and the specific force there in units of the local gravity";
        page.columns(caption, &self.campaign.turns, &columns);
    }
}
