//! The order tables of a calibration's report.

use super::parts::{CalibrationPage, QUANTITY_NAMES};
use crate::page::{Cell, Column, NoteKind, Page};
use crate::quantity::digits;
use isotherm_fit::CalibratedTriad;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, Diagnostics, Fit, OrderTable, Test, root};

impl CalibrationPage<'_> {
    pub(super) fn orders(&self, page: &mut Page, triad: &CalibratedTriad<'_>) {
        self.heading(page, triad, "orders", "Order tables");
        page.paragraph(if triad.gyroscopes.is_some() {
            "As above. The order is 3 at least, the order of the model."
        } else {
            "Equations (9) to (16) of the source paper. The sentence below each table says why the order was chosen. The F of the last term is the partial F of the highest power; the terms' partial \
             sums of squares are in the basis centred on the temperature's range, on which those of the lower terms depend. \
             Leave-one-out: errors at a set point of the fit without it."
        });
        for axis in 0..AXES {
            for quantity in 0..QUANTITY_NAMES.len() {
                self.order_table(page, triad, axis, quantity);
            }
        }
    }

    fn order_table(&self, page: &mut Page, triad: &CalibratedTriad<'_>, axis: usize, quantity: usize) {
        let (table, curve) = (&triad.orders[axis][quantity], &triad.curves[axis][quantity]);
        let (factor, unit) = (triad.units.factor(quantity), triad.units.on_page(quantity));
        let title = format!("{} {}", triad.names[axis], QUANTITY_NAMES[quantity]);
        page.heading(3, &format!("orders-{axis}-{quantity}"), &title);
        orders(page, &format!("{title}: orders, in {unit}"), table, factor);
        page.paragraph(&format!("Order {}: {}.", table.choice.order, table.choice.reason));
        let [center, scale] = curve.basis();
        let power = if curve.is_raw() { format!("{}ᵏ", self.unit()) } else { format!("((U - {center})/{scale})ᵏ") };
        let caption = format!("{title}: coefficients of the table, in {unit} per {power}");
        coefficients(page, &caption, table.chosen(), curve, factor);
        diagnostics(page, &table.diagnostics, factor);
    }
}

/// The fits of all orders. `factor` leads to the unit of the page.
fn orders(page: &mut Page, caption: &str, table: &OrderTable, factor: f64) {
    let order = |it: &Fit| match it.order == table.choice.order {
        true => Cell::Verdict(NoteKind::Good, format!("{} chosen", it.order)),
        false => Cell::text(it.order.to_string()),
    };
    let in_unit = |value: Option<f64>| number(value.map(|value| value * factor));
    let columns: [Column<'_, &Fit>; 7] = [
        ("Order", &|it| order(it)),
        ("Residual sd", &|it| in_unit(it.residual_sd)),
        ("F", &|it| number(it.f)),
        ("F last term", &|it| number(it.partial.last().and_then(|last| last.f))),
        ("Effect", &|it| in_unit(Some(it.effect))),
        ("Leave-one-out rms", &|it| in_unit(it.leave_one_out_rms)),
        ("Leave-one-out max", &|it| in_unit(it.leave_one_out_max)),
    ];
    page.columns(caption, &table.regression.fits()[1..], &columns);
}

/// The coefficients of a curve, each with the test of its term in the fit.
fn coefficients(page: &mut Page, caption: &str, fit: &Fit, curve: &Curve, factor: f64) {
    let errors = curve.table_covariance().map(|c| c.diagonal().map(root));
    let partial = |power: usize| fit.partial_centred.get(power.checked_sub(1)?);
    let sum = |power: usize| Some(partial(power)?.sum_of_squares * factor * factor).filter(|sum| sum.is_finite());
    let columns: [Column<'_, (usize, f64)>; 5] = [
        ("Power", &|(power, _)| Cell::text(format!("c{power}"))),
        ("Coefficient", &|(_, c)| Cell::Number(digits(c * factor, 10))),
        ("Standard error", &|(power, _)| number(errors.as_ref().map(|errors| errors[*power] * factor))),
        ("Partial sum of squares", &|(power, _)| number(sum(*power))),
        ("Partial F", &|(power, _)| number(partial(*power).and_then(|partial| partial.f))),
    ];
    let polynomial = curve.polynomial(1.0);
    let coefficients = polynomial.iter().flat_map(|polynomial| polynomial.coefficients()).copied();
    page.columns(caption, coefficients.enumerate(), &columns);
}

fn diagnostics(page: &mut Page, found: &Diagnostics, factor: f64) {
    let test = |test: Option<Test>| {
        let chance = |it: &Test| if it.p < 0.05 { "more than chance makes of it" } else { "as chance makes of it" };
        test.map_or_else(|| "not applicable".to_owned(), |it| format!("{}, {}", digits(it.value, 3), chance(&it)))
    };
    page.key_values(&[
        ("Lag-1 correlation of residuals", test(found.lag1)),
        ("Runs test, deviate", test(found.runs)),
        ("Heating less cooling", test(found.heating_cooling.map(|it| Test { value: it.value * factor, p: it.p }))),
    ]);
}

/// A number with five digits; a dash if it is not known.
fn number(value: Option<f64>) -> Cell {
    Cell::Number(digits(value.unwrap_or(f64::NAN), 5))
}
