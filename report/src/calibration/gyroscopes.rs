//! The sections of a calibration's page that only gyroscopes have.

use super::parts::{Report, remark};
use super::triad::Budget;
use crate::page::{Cell, Page};
use crate::plot::{Plot, Style};
use isotherm_calibration::{CalibratedTriad, FittedRun, GyroscopeCalibration, Place};
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::CONFIDENCE;

/// Column headings of a run's residuals.
pub(super) const RESIDUALS: [&str; AXES] = ["G1 / arcsec", "G2 / arcsec", "G3 / arcsec"];

/// A whole turn \[arcsec\].
const WHOLE_TURN: f64 = 1_296_000.0;

impl Report<'_> {
    /// What the first list of the page says about the gyroscopes.
    pub(super) fn gyroscope_facts(&self) -> Vec<(&'static str, String)> {
        let Some(found) = &self.calibration.gyroscopes else { return Vec::new() };
        let walks = (0..AXES).map(|axis| format!("{:.5}", found.random_walk(axis)));
        let observability = &found.observability;
        let mut rows = vec![
            ("Turns", found.turns().to_string()),
            (
                "Condition of positions and turns",
                format!(
                    "{:.1}, with {} of {} unknowns of a set point determined",
                    observability.condition, observability.rank, observability.unknowns
                ),
            ),
            ("Random walk, G1 to G3", format!("{} deg/sqrt(h)", walks.collect::<Vec<_>>().join(", "))),
        ];
        if let (Some(earth), Some([x, y]), Some(latitude)) =
            (found.earth, found.solution.earth, self.campaign.latitude_deg)
        {
            let interval = found.horizontal_rate_interval(CONFIDENCE).unwrap_or(f64::NAN);
            let horizontal = format!(
                "{:.4} +- {interval:.4} deg/h, 95 %; at a latitude of {latitude} degrees it is {:.4} deg/h",
                earth.found, earth.expected
            );
            rows.push(("Earth's horizontal rate", horizontal));
            let components = format!("{x:.4}, {y:.4}, {:.4} deg/h; Z is that of the latitude", earth.along_z);
            rows.push(("Earth's rate along the base's X, Y, Z", components));
        }
        if let Some(left) = &found.left_over {
            let text = format!(
                "at most {:.4} deg/h of bias, {:.2} ppm of scale factor, {:.4} deg/h/g0 of g-sensitivity, {:.2}e-6 rad of misalignment",
                left.bias,
                left.scale_factor * 1e6,
                left.g_sensitivity,
                left.misalignment * 1e6
            );
            rows.push(("Left of Earth's rate", text));
        }
        rows
    }

    /// Residuals of the gyroscopes in each dwell and turn.
    pub(super) fn run_residuals(&self, page: &mut Page, found: &GyroscopeCalibration) {
        page.heading(3, "residuals-runs", "Dwells and turns");
        let start = found.runs.iter().map(|run| run.start_ns).min().unwrap_or(0);
        let figure = |axis: usize| {
            let points = |turns: bool| {
                let runs = found.runs.iter().filter(move |run| matches!(run.place, Place::Turn(_)) == turns);
                runs.map(move |run| ((run.start_ns - start) as f64 / 3.6e12, run.residual[axis] / run.seconds.sqrt()))
            };
            let title = format!("{}: residuals over time", GYROSCOPE_NAMES[axis]);
            let plot = Plot::new(&title, "Time / h", "Residual / (arcsec/sqrt(s))").zero_line();
            let plot = plot.series("Dwells", Style::Points, points(false)).series("Turns", Style::Points, points(true));
            (plot.svg(), String::new())
        };
        page.figures(&[figure(0), figure(1), figure(2)]);
        page.paragraph(
            "Residuals over the root of the run's length, as the fit weighs them: of a random walk of the angle, dwells and turns scatter alike.",
        );
    }

    pub(super) fn g_sensitivities(&self, page: &mut Page, found: &GyroscopeCalibration) {
        page.heading(2, "g-sensitivities", "g-sensitivities");
        let mut rows = Vec::new();
        for (name, part) in GYROSCOPE_NAMES.iter().zip(&found.solution.gyroscopes) {
            let errors = part.g_sensitivity_error.unwrap_or([f64::NAN; AXES]);
            let intervals = part.g_sensitivity_interval(CONFIDENCE).unwrap_or([f64::NAN; AXES]);
            for (k, along) in AXIS_NAMES.iter().enumerate() {
                let mut row = vec![Cell::text(format!("{name} along {along}"))];
                row.extend([part.g_sensitivity[k], errors[k], intervals[k]].map(|value| Cell::number(value, 4)));
                rows.push(row);
            }
        }
        let header = ["g-sensitivity", "Value", "Standard error", "95 % interval +-"];
        page.table("g-sensitivities [deg/h/g0]", &header, &rows);
        page.paragraph(
            "The part along the vertical comes with Earth's vertical rate, which the dwells cannot tell from it: that rate is taken from the latitude. \
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
        let mut rows = Vec::new();
        for (axis, name) in triad.names.into_iter().enumerate() {
            let Budget { standard_error, leave_one_out, slope, misalignment } = Budget::of(triad, axis);
            let s = found.solution.gyroscopes[axis].g_sensitivity_error;
            let at_rest = [
                ("standard error of the bias", standard_error[0]),
                ("leave-one-set-point-out, bias", leave_one_out[0]),
                ("g-sensitivity, at 1 g0", s.map(|errors| errors.into_iter().fold(0.0, f64::max))),
                ("head telemetry 0.001 off, bias at its steepest", Some(slope[0])),
            ];
            let in_motion = [
                ("standard error of K+", standard_error[1]),
                ("standard error of K-", standard_error[2]),
                ("leave-one-set-point-out, K+", leave_one_out[1]),
                ("leave-one-set-point-out, K-", leave_one_out[2]),
                ("misalignments, turning across", misalignment),
                ("board telemetry 0.001 off, K at its steepest", Some(slope[1].max(slope[2]))),
            ];
            let row = |label: &str, [rate, minute, ppm, turn]: [f64; 4]| {
                let numbers = [(rate, 5), (minute, 3), (ppm, 3), (turn, 3)];
                let cells = numbers.map(|(value, decimals)| Cell::number(value, decimals));
                [Cell::text(format!("{name} {label}"))].into_iter().chain(cells).collect::<Vec<_>>()
            };
            rows.extend(at_rest.map(|(label, value)| {
                let rate = value.unwrap_or(f64::NAN);
                row(label, [rate, rate * 60.0, f64::NAN, f64::NAN])
            }));
            rows.extend(in_motion.map(|(label, value)| {
                let part = value.unwrap_or(f64::NAN);
                row(label, [f64::NAN, f64::NAN, part * 1e6, part * WHOLE_TURN])
            }));
        }
        let header = ["Error", "Rate / deg/h", "In 60 s / arcsec", "Scale / 1e-6", "In a turn / arcsec"];
        page.table("Errors and what they cost", &header, &rows);
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
        let is_everywhere = |place: Place| {
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
        let turns = found.runs.iter().filter(|run| matches!(run.place, Place::Turn(_)));
        let rows: Vec<_> = turns.map(row).collect();
        let header = ["Set point / turn", "Lines", "Time / s"].into_iter().chain(RESIDUALS).chain(["Check"]);
        page.table("Turns with their residuals", &header.collect::<Vec<_>>(), &rows);
    }

    /// The turns of the campaign file.
    pub(super) fn turn_list(&self, page: &mut Page) {
        if self.calibration.gyroscopes.is_none() {
            return;
        }
        let rows: Vec<_> = self
            .campaign
            .turns
            .iter()
            .map(|turn| {
                let angle = |k: usize| turn.start.angles.map_or("-".to_owned(), |angles| angles[k].to_string());
                let mut row = vec![Cell::text(turn.start.number.to_string()), Cell::Number(turn.angle_deg.to_string())];
                row.extend(turn.axis.map(|part| Cell::number(part, 6)));
                row.extend([Cell::Number(angle(0)), Cell::Number(angle(1))]);
                row.extend(turn.start.specific_force.map(|f| Cell::number(f, 6)));
                row
            })
            .collect();
        let axis = ["about A1", "A2", "A3"];
        let header =
            ["Number", "Angle / deg"].into_iter().chain(axis).chain(["Outer / deg", "Inner / deg", "A1", "A2", "A3"]);
        let caption = "Turns: axis, where they begin, and the specific force there in units of the local gravity";
        page.table(caption, &header.collect::<Vec<_>>(), &rows);
    }
}
