//! The order tables of a calibration's report.

use super::parts::{QUANTITY_NAMES, Report};
use crate::page::{Cell, NoteKind, Page};
use isotherm_calibration::CalibratedTriad;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Partial, Test};

impl Report<'_> {
    pub(super) fn orders(&self, page: &mut Page, triad: &CalibratedTriad<'_>) {
        self.heading(page, triad, "orders", "Order tables");
        page.paragraph(if triad.gyroscopes.is_some() {
            "As above. The order is 3 at least, the order of the model."
        } else {
            "Equations (9) to (16) of the source paper. The F of the last term is the partial F of the highest power; the terms' partial \
             sums of squares are in the basis centred on the telemetry's range, on which those of the lower terms depend. \
             Leave-one-out: errors at a set point of the fit without it."
        });
        for axis in 0..AXES {
            for quantity in 0..QUANTITY_NAMES.len() {
                self.order_table(page, triad, axis, quantity);
            }
        }
    }

    fn order_table(&self, page: &mut Page, triad: &CalibratedTriad<'_>, axis: usize, quantity: usize) {
        let orders = &triad.orders[axis][quantity];
        let (factor, unit) = (triad.units.factor(quantity), triad.units.on_page(quantity));
        let title = format!("{} {}", triad.names[axis], QUANTITY_NAMES[quantity]);
        page.heading(3, &format!("orders-{axis}-{quantity}"), &title);
        let number_cell = |value: Option<f64>| Cell::Number(value.map_or("-".to_owned(), short));
        let rows: Vec<_> = orders.regression.fits()[1..]
            .iter()
            .map(|fit| {
                let chosen = fit.order == orders.choice.order;
                let last = fit.partial.last();
                vec![
                    if chosen {
                        Cell::Verdict(NoteKind::Good, format!("{} chosen", fit.order))
                    } else {
                        Cell::text(fit.order.to_string())
                    },
                    number_cell(fit.residual_sd.map(|sd| sd * factor)),
                    Cell::Number(fit.r_squared.map_or("-".to_owned(), |r| format!("{r:.9}"))),
                    Cell::Number(fit.r.map_or("-".to_owned(), |r| format!("{r:.9}"))),
                    number_cell(fit.f),
                    number_cell(fit.f_p),
                    number_cell(last.and_then(|partial| partial.f)),
                    number_cell(last.and_then(|partial| partial.p)),
                    number_cell(Some(fit.effect * factor)),
                    number_cell(fit.leave_one_out_rms.map(|rms| rms * factor)),
                    number_cell(fit.leave_one_out_max.map(|max| max * factor)),
                ]
            })
            .collect();
        let header = [
            "Order",
            "Residual sd",
            "R2",
            "R",
            "F",
            "p",
            "F last term",
            "p last term",
            "Effect",
            "Leave-one-out rms",
            "Leave-one-out max",
        ];
        page.table(&format!("{title}: orders, in {unit}"), &header, &rows);
        page.paragraph(&format!("Order {}: {}.", orders.choice.order, orders.choice.reason));
        let curve = &triad.curves[axis][quantity];
        let fit = &orders.regression.fits()[orders.choice.order];
        let errors = curve.table_covariance().map(|c| c.diagonal().map(|v| v.max(0.0).sqrt()));
        let missing = Partial { term: 0, sum_of_squares: f64::NAN, f: None, p: None };
        let coefficients = curve.polynomial(1.0).map_or_else(Vec::new, |p| p.coefficients().to_vec());
        let rows: Vec<_> = coefficients
            .iter()
            .enumerate()
            .map(|(power, c)| {
                let partial = power.checked_sub(1).and_then(|k| fit.partial_centred.get(k)).unwrap_or(&missing);
                let sum = Some(partial.sum_of_squares * factor * factor).filter(|sum| sum.is_finite());
                vec![
                    Cell::text(format!("c{power}")),
                    Cell::Number(format!("{:.9e}", c * factor)),
                    number_cell(errors.as_ref().map(|errors| errors[power] * factor)),
                    number_cell(sum),
                    number_cell(partial.f),
                    number_cell(partial.p),
                ]
            })
            .collect();
        let header = ["Power", "Coefficient", "Standard error", "Partial sum of squares", "Partial F", "p"];
        let [center, scale] = curve.basis();
        let power = if curve.is_raw() { format!("{}^k", self.unit()) } else { format!("((U - {center})/{scale})^k") };
        page.table(&format!("{title}: coefficients of the table, in {unit} per {power}"), &header, &rows);
        let found = &orders.diagnostics;
        let test = |test: Option<Test>| {
            test.map_or("not applicable".to_owned(), |test| format!("{} (p {})", short(test.value), short(test.p)))
        };
        page.key_values(&[
            ("Lag-1 correlation of residuals", test(found.lag1)),
            ("Runs test, deviate", test(found.runs)),
            ("Heating less cooling", test(found.heating_cooling.map(|t| Test { value: t.value * factor, p: t.p }))),
        ]);
    }
}

/// 1e-3 to 1e5 with at most five significant digits and four decimals, other values in exponent notation with three
/// digits.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = 4_usize.saturating_sub(value.abs().max(1.0).log10() as usize);
        format!("{value:.digits$}")
    } else {
        format!("{value:.2e}")
    }
}
