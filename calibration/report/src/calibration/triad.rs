//! The sections of a calibration's page that are the same for accelerometers and gyroscopes.

use super::parts::{CalibrationPage, QUANTITY_NAMES};
use crate::page::{Cell, Column, Page};
use crate::parts::{CURVE_INTERVALS, grid};
use crate::plot::{Plot, Style};
use isotherm_fit::{CalibratedTriad, Method, ReducedSensor};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, largest, student_quantile};

impl CalibrationPage<'_> {
    /// `accelerometers: ` if there are gyroscopes too, otherwise nothing: with one triad it is clear what is meant.
    pub(super) fn whose(&self, triad: &CalibratedTriad<'_>) -> String {
        if self.triads.len() > 1 { format!("{}s: ", triad.units.sensor) } else { String::new() }
    }

    /// Begins a section of a triad.
    pub(super) fn heading(&self, page: &mut Page, triad: &CalibratedTriad<'_>, id: &str, title: &str) {
        let id = if triad.gyroscopes.is_some() { format!("gyroscope-{id}") } else { id.to_owned() };
        let sensors = if self.triads.len() > 1 { format!(", {}s", triad.units.sensor) } else { String::new() };
        page.heading(2, &id, &format!("{title}{sensors}"));
    }

    fn temperature(&self, quantity: usize) -> String {
        format!("{} temperature / {}", if quantity == 0 { "Head" } else { "Board" }, self.unit())
    }

    /// A figure over the temperature of a quantity, with the temperatures of the chamber as its second scale.
    pub(super) fn plot_over_temperature(
        &self,
        triad: &CalibratedTriad<'_>,
        title: &str,
        y_label: &str,
        axis: usize,
        quantity: usize,
    ) -> Plot {
        let pairs =
            triad.set_points.iter().map(|(set_point_c, parts)| (parts[axis].temperature[quantity], *set_point_c));
        Plot::new(title, &self.temperature(quantity), y_label).second_scale("Set point / degC", pairs)
    }

    /// Figure 5 of the paper.
    pub(super) fn curves(&self, page: &mut Page, triad: &CalibratedTriad<'_>) {
        self.heading(page, triad, "curves", "Bias and scale factors over temperature");
        page.paragraph(if triad.gyroscopes.is_some() {
            "As above. The bars come from the scatter of the set point's dwells and turns."
        } else {
            "Points are the set points, freed of the drift within them where the one-stage fit knows it; the line is the table. Bars: 95 % \
             of each set point's own value, by Student's t from the scatter of its dwells, drift and tilt included: where the points are freed of \
             the drift, they scatter less than the bars say. Band: 95 % for the table's whole curve at once. What is too small to be seen here is in the \
             residuals below. Upper scale: the chamber's set points, with straight lines between them."
        });
        for (quantity, name) in QUANTITY_NAMES.iter().enumerate() {
            page.plots(&[0, 1, 2].map(|axis| {
                let curve = &triad.curves[axis][quantity];
                let (factor, unit) = (triad.units.factor(quantity), triad.units.on_page(quantity));
                let (title, label) = (format!("{name} of {}", triad.names[axis]), format!("{name} / {unit}"));
                let order = format!("Table, order {}, 95 %", curve.order());
                self.plot_of_curve(triad, [&title, &label, &order], [axis, quantity], factor, &|_| 0.0)
            }));
        }
    }

    /// A curve with its band and its set points, all less `from` and times `factor`. The labels are the title, that of
    /// y and that of the curve.
    fn plot_of_curve(
        &self,
        triad: &CalibratedTriad<'_>,
        [title, y_label, label]: [&str; 3],
        [axis, quantity]: [usize; 2],
        factor: f64,
        from: &dyn Fn(f64) -> f64,
    ) -> Plot {
        let curve = &triad.curves[axis][quantity];
        let value = |u: f64| curve.at(u) - from(u);
        let quantile = curve.band_quantile(CONFIDENCE);
        let band = grid(curve.range(), CURVE_INTERVALS).filter_map(|u| {
            let half = curve.half_width(u, quantile?)?;
            Some((u, (value(u) - half) * factor, (value(u) + half) * factor))
        });
        self.plot_over_temperature(triad, title, y_label, axis, quantity)
            .series(label, Style::Line, grid(curve.range(), CURVE_INTERVALS).map(|u| (u, value(u) * factor)))
            .band(band)
            .series("Set points, 95 %", Style::Points, points(triad, axis, quantity, from, factor))
            .errors(errors(triad, axis, quantity).into_iter().map(|half| half * factor))
    }

    pub(super) fn set_point_residuals(&self, page: &mut Page, triad: &CalibratedTriad<'_>) {
        self.heading(page, triad, "residuals", "Residuals");
        page.heading(3, "residuals-set-points", "Set points");
        page.paragraph(
            "Bars: 95 % of each set point's own value, as above. Band: 95 % for the table's whole curve at once. By chance at most one bar in twenty misses the \
             true curve; more of them are a sign of an order that is too low, or of an error that changes between set points.",
        );
        for (quantity, name) in QUANTITY_NAMES.iter().enumerate() {
            page.plots(&[0, 1, 2].map(|axis| {
                let curve = &triad.curves[axis][quantity];
                let [low, high] = curve.range();
                let (size, unit) = match quantity {
                    0 => (triad.units.factor(0), triad.units.on_page(0)),
                    _ => (1e6 / curve.at(0.5 * (low + high)).abs(), "ppm"),
                };
                let title = format!("{name} of {}: set point less table", triad.names[axis]);
                let label = format!("Residual / {unit}");
                self.plot_of_curve(triad, [&title, &label, "Table, 95 %"], [axis, quantity], size, &|u| curve.at(u))
            }));
        }
    }

    pub(super) fn misalignments(&self, page: &mut Page, triad: &CalibratedTriad<'_>) {
        self.heading(page, triad, "misalignments", "Misalignments");
        let names = |axis: usize, k: usize| [triad.names[axis], triad.names[(axis + 1 + k) % AXES]].join(" onto ");
        let micro = |values: Option<[f64; 2]>, k: usize| Cell::known(values.map(|values| values[k] * 1e6), 3);
        let columns: [Column<'_, (usize, usize)>; 4] = [
            ("Misalignment", &|(axis, k)| Cell::text(names(*axis, *k))),
            ("Value", &|(axis, k)| micro(Some(triad.misalignment[*axis]), *k)),
            ("Standard error", &|(axis, k)| micro(triad.misalignment_error[*axis], *k)),
            ("95 % interval, +-", &|(axis, k)| micro(triad.misalignment_interval[*axis], *k)),
        ];
        page.columns("Misalignments [1e-6 rad]", (0..2 * AXES).map(|index| (index / 2, index % 2)), &columns);
        page.paragraph(self.alignment(triad));
    }

    /// What is said of the table's alignment matrix.
    fn alignment(&self, triad: &CalibratedTriad<'_>) -> &'static str {
        let left = match triad.gyroscopes {
            None => self.calibration.left_without_alignment(),
            Some(found) => found.left_without_alignment(&self.calibration.table),
        };
        match (self.calibration.table.content().alignment, left) {
            (Some(_), _) => {
                "The table has the alignment matrix that undoes them. It turns the axes of the output onto those of the turntable: how the IMU sat on \
                 the fixture is part of it."
            }
            (None, Some(_)) => {
                "The table has no alignment matrix: outputs stay along the sensors' input axes, and the misalignments are part of the error. This IMU \
                 needs one (calibrate turntable --alignment)."
            }
            (None, None) => {
                "The table has no alignment matrix, and needs none: no misalignment exceeds its 99 % interval and 1e-6 rad. Outputs stay along the \
                 sensors' input axes."
            }
        }
    }

    pub(super) fn set_points(&self, page: &mut Page, triad: &CalibratedTriad<'_>) {
        self.heading(page, triad, "set-points", "Set points reduced by themselves");
        page.paragraph(match (self.calibration.options.method, triad.gyroscopes) {
            (Method::OneStage, None) => {
                "The paper's two-stage values, for comparison; the table comes from all dwells at once."
            }
            (Method::OneStage, Some(_)) => "For comparison; the table comes from all dwells and turns at once.",
            (Method::TwoStage, _) => "The values that the polynomials go through.",
        });
        let units = triad.units;
        let (bias, with) = match triad.gyroscopes {
            None => ("A", "tilt"),
            Some(_) => ("D", "Earth's rate"),
        };
        for (axis, name) in triad.names.into_iter().enumerate() {
            let row = |(set_point_c, parts): &(f64, [ReducedSensor<'_>; AXES])| {
                let part = &parts[axis];
                let mut row = vec![Cell::text(format!("{set_point_c} degC"))];
                row.extend(part.temperature[..2].iter().map(|temperature| Cell::number(*temperature, 5)));
                for quantity in 0..QUANTITY_NAMES.len() {
                    let decimals = if quantity == 0 { units.bias_decimals } else { units.scale_factor_decimals };
                    let both = [part.values[quantity], part.standard_errors[quantity]];
                    row.extend(both.map(|value| Cell::number(value * units.factor(quantity), decimals)));
                }
                row.extend(part.values[3..5].iter().map(|m| Cell::number(m * 1e6, 2)));
                row.extend(part.values[5..].iter().map(|s| Cell::number(*s, 4)));
                row
            };
            let rows: Vec<_> = triad.set_points.iter().map(row).collect();
            let (m, o) = (triad.names[(axis + 1) % AXES], triad.names[(axis + 2) % AXES]);
            let bias = format!("{bias} / {}", units.bias_on_page);
            let (m, o) = (format!("onto {m} / 1e-6 rad"), format!("onto {o} / 1e-6 rad"));
            let mut header = vec!["Set point", "Head", "Board", &bias, "+-", "K+", "+-", "K-", "+-", &m, &o];
            if triad.gyroscopes.is_some() {
                header.extend(["s along A1 / deg/h/g0", "A2", "A3"]);
            }
            let caption = format!("{name}: errors from the scatter within the set point, {with} included");
            page.compact_table(&caption, &header, rows);
        }
    }
}

/// Errors of a sensor: of the bias in the unit of the fit, of K+ and K- relative to them.
pub(super) struct Budget {
    /// Standard errors, means over the range.
    pub standard_error: [Option<f64>; 3],
    /// Leave-one-set-point-out, rms.
    pub leave_one_out: [Option<f64>; 3],
    /// What 0.001 of temperature changes where the curve is steepest.
    pub slope: [f64; 3],
    /// Standard error of both misalignments together \[rad\].
    pub misalignment: Option<f64>,
}

impl Budget {
    pub(super) fn of(triad: &CalibratedTriad<'_>, axis: usize) -> Self {
        let curves = triad.curves[axis];
        let size = |quantity: usize, u: f64| if quantity == 0 { 1.0 } else { curves[quantity].at(u).abs() };
        let mean = |quantity: usize| {
            let curve = &curves[quantity];
            let squares = grid(curve.range(), CURVE_INTERVALS)
                .map(|u| curve.standard_error(u).map(|e| (e / size(quantity, u)).powi(2)));
            squares.sum::<Option<f64>>().map(|sum| (sum / (CURVE_INTERVALS + 1) as f64).sqrt())
        };
        let slope = |quantity: usize| {
            let curve = &curves[quantity];
            let slopes = grid(curve.range(), CURVE_INTERVALS).map(|u| curve.slope(u).abs() / size(quantity, u));
            largest(slopes) * 1e-3
        };
        let leave_one_out = |quantity: usize| {
            let orders = &triad.orders[axis][quantity];
            let fit = &orders.regression.fits()[orders.choice.order];
            fit.leave_one_out_rms.map(|rms| rms / size(quantity, curves[quantity].range()[0]))
        };
        Self {
            standard_error: [0, 1, 2].map(mean),
            leave_one_out: [0, 1, 2].map(leave_one_out),
            slope: [0, 1, 2].map(slope),
            misalignment: triad.misalignment_error[axis].map(|errors| libm::hypot(errors[0], errors[1])),
        }
    }
}

/// Temperature of a quantity at each set point, and its value less `from` times `factor`.
pub(super) fn points<'a>(
    triad: &'a CalibratedTriad<'_>,
    axis: usize,
    quantity: usize,
    from: &'a dyn Fn(f64) -> f64,
    factor: f64,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    let points = triad.orders[axis][quantity].regression.points().iter();
    let points = points.map(|point| (point.x.value(), point.y.value()));
    points.map(move |(x, y)| (x, (y - from(x)) * factor))
}

/// Half length of the error bar of each set point's own value, in the unit of the fit; NaN without degrees of freedom.
pub(super) fn errors(triad: &CalibratedTriad<'_>, axis: usize, quantity: usize) -> Vec<f64> {
    let parts = triad.set_points.iter().map(|(_, parts)| &parts[axis]);
    parts.map(|part| half_length(part.standard_errors[quantity], part.freedom)).collect()
}

/// Half length of the error bar of a value with these degrees of freedom; NaN without any.
fn half_length(standard_error: f64, freedom: usize) -> f64 {
    if freedom == 0 { f64::NAN } else { standard_error * student_quantile(CONFIDENCE, freedom) }
}

/// How far the set points of a curve are off it, in half lengths of their error bars.
pub(super) struct Bars {
    /// As in "bias of A1".
    pub(super) name: String,
    off: Vec<f64>,
}

impl Bars {
    /// Those of every curve of a triad.
    pub(super) fn of_triad(triad: &CalibratedTriad<'_>) -> impl Iterator<Item = Self> {
        let curves = (0..AXES).flat_map(|axis| (0..QUANTITY_NAMES.len()).map(move |quantity| (axis, quantity)));
        curves.map(|(axis, quantity)| {
            let curve = &triad.curves[axis][quantity];
            let residuals: Vec<_> = points(triad, axis, quantity, &|u| curve.at(u), 1.0).collect();
            let bars = residuals.into_iter().zip(errors(triad, axis, quantity));
            let off = bars.map(|((_, residual), bar)| residual.abs() / bar).filter(|off| off.is_finite()).collect();
            Self { name: format!("{} of {}", ["bias", "K+", "K-"][quantity], triad.names[axis]), off }
        })
    }

    /// How many set points have an error bar.
    pub(super) fn known(&self) -> usize {
        self.off.len()
    }

    /// How many bars miss the curve.
    pub(super) fn missed(&self) -> usize {
        self.off.iter().filter(|off| **off > 1.0).count()
    }

    /// How far the worst one is off, in half lengths of its bar.
    pub(super) fn largest(&self) -> f64 {
        self.off.iter().copied().fold(0.0, f64::max)
    }

    /// Whether more bars miss the curve than chance allows: one in twenty, and 3.5 standard deviations.
    pub(super) fn is_misfit(&self) -> bool {
        let n = self.off.len() as f64;
        self.missed() as f64 > 0.05 * n + 3.5 * (n * 0.05 * 0.95).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_chance_one_bar_in_twenty_misses_the_curve() {
        let bars = |missed: usize, of: usize| {
            let off = (0..of).map(|bar| if bar < missed { 1.1 } else { 0.9 }).collect();
            Bars { name: String::new(), off }.is_misfit()
        };
        assert_eq!([bars(2, 6), bars(3, 6), bars(3, 15), bars(4, 15), bars(0, 0)], [false, true, false, true, false]);
    }

    #[test]
    fn error_bars_widen_with_few_dwells_and_need_one_more_than_there_are_parameters() {
        assert!(half_length(1.0, 0).is_nan() && half_length(f64::NAN, 7).is_nan());
        // Student's t with 1 and 7 degrees of freedom.
        assert!((half_length(2.0, 1) - 2.0 * 12.7062).abs() < 1e-3);
        assert!((half_length(2.0, 7) - 2.0 * 2.36462).abs() < 1e-4);
    }
}
