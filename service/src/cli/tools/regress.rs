use super::calibrate::{bytes_bar, spinner};
use super::written;
use crate::failure::{Exit, Failure};
use crate::files::open_recording;
use clap::Args;
use isotherm_calibration::diagnostics::Diagnostics;
use isotherm_calibration::double_double::DoubleDouble;
use isotherm_calibration::order::{Rule, choose};
use isotherm_calibration::regression::{Fit, MAX_ORDER, Partial, Point, Regression, f_limit};
use isotherm_shared::csv::{RecordingError, Rows};
use serde_json::json;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::PathBuf;

/// What can be read.
const NUMBER: &str = "a finite number, 0 or of size 1e-140 to 1e140";
/// Highest order of the table, where the data allow it and none is asked for.
const DEFAULT_ORDER: usize = 6;

/// Fit polynomials of one column on another: order table, chosen order, and what speaks against it
///
/// Every order from 1 to the highest is fitted, in double-double arithmetic on the decimals as they are written. The chosen
/// order is the highest whose last term is both significant and moves the curve by more than a threshold.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm regress dwells.csv --x a1_head --y a1_bias\n  isotherm regress dwells.csv --x u --y k --weights w --max-order 10 --json"
)]
pub struct Regress {
    /// Comma-separated data with a header row; - is stdin
    #[arg(value_name = "DATA.csv")]
    data: PathBuf,
    /// Column of the variable, for example the telemetry
    #[arg(long, value_name = "COLUMN")]
    x: String,
    /// Column of the quantity
    #[arg(long, value_name = "COLUMN")]
    y: String,
    /// Highest order, up to 15 [default: 6, or what the number of different x allows]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = clap::value_parser!(u8).range(1..=MAX_ORDER as i64))]
    max_order: Option<u8>,
    /// Column of the weights, inverse variances up to a factor, over 0
    #[arg(long, value_name = "COLUMN")]
    weights: Option<String>,
    /// Smallest change of the curve that matters, in the unit of y [default: a quarter of the residual standard deviation]
    #[arg(long, value_name = "Y", allow_negative_numbers = true, value_parser = not_negative)]
    min_effect: Option<f64>,
    /// One JSON document
    #[arg(long)]
    json: bool,
}

fn not_negative(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|value: &f64| *value >= 0.0 && value.is_finite())
        .ok_or_else(|| "give a number from 0".into())
}

impl Regress {
    pub fn run(self) -> Result<(), Failure> {
        let source = open_recording(&self.data).map_err(|error| Failure::io("opening", &self.data, &error))?;
        let bar = bytes_bar(&self.data, "reading");
        let read = self.read(bar.wrap_read(source));
        bar.finish_and_clear();
        let (points, lines) = read.map_err(|error| Failure::recording(&self.data, &error))?;
        let failed = |error: String| Failure::new(Exit::Data, format!("{}: {error}", self.data.display()));
        let highest = match self.max_order {
            Some(order) => usize::from(order),
            None => {
                let mut x: Vec<_> = points.iter().map(|point| point.x.value()).collect();
                x.sort_by(f64::total_cmp);
                x.dedup();
                DEFAULT_ORDER.min(x.len().saturating_sub(2)).max(1)
            }
        };
        let spinner = spinner("fitting");
        let regression = Regression::new(points, highest).map_err(|error| failed(error.to_string()))?;
        let choice = choose(&regression, &Rule { effect: self.min_effect, ..Rule::default() });
        let diagnostics = Diagnostics::of(&regression, choice.order);
        spinner.finish_and_clear();
        let outliers: Vec<_> = diagnostics.outliers.iter().filter_map(|&index| lines.get(index).copied()).collect();
        let mut warnings = diagnostics.warnings.clone();
        if !outliers.is_empty() {
            let lines: Vec<_> = outliers.iter().take(20).map(ToString::to_string).collect();
            let more = if outliers.len() > 20 { format!(" and {} more", outliers.len() - 20) } else { String::new() };
            warnings.push(format!(
                "out of all proportion to the other residuals, but kept: line {}{more}; look at them",
                lines.join(", ")
            ));
        }
        for warning in &warnings {
            let _ = writeln!(io::stderr(), "isotherm: warning: {warning}");
        }
        let text = if self.json {
            let document = json!({
                "n": regression.n(),
                "x": self.x,
                "y": self.y,
                "center": regression.center(),
                "scale": regression.scale(),
                "orders": regression.fits()[1..].iter().map(order_json).collect::<Vec<_>>(),
                "selected": choice.order,
                "reason": choice.reason,
                "residuals": regression.residuals(choice.order),
                "diagnostics": {
                    "lag1": diagnostics.lag1,
                    "runs": diagnostics.runs,
                    "heating_cooling": diagnostics.heating_cooling,
                    "outlier_lines": outliers,
                },
                "warnings": warnings,
            });
            format!("{document:#}\n")
        } else {
            table(&regression, &self.y, &self.x) + &format!("\nChosen: order {}; {}.\n", choice.order, choice.reason)
        };
        written(None, io::stdout().write_all(text.as_bytes()))
    }

    /// The points, and the line of each.
    fn read(&self, source: impl io::Read) -> Result<(Vec<Point>, Vec<u64>), RecordingError> {
        let mut rows = Rows::new(source);
        rows.next_row()?;
        let hint = "is this comma-separated with a header row?";
        let mut names = vec![self.x.as_str(), self.y.as_str()];
        names.extend(self.weights.as_deref());
        let columns = rows.columns(&names, hint)?;
        let count = rows.len();
        let (mut points, mut lines) = (Vec::new(), Vec::new());
        while rows.next_row()? {
            rows.expect_len(count)?;
            let number = |index: usize, right: &str, valid: fn(&DoubleDouble) -> bool| {
                rows.parse(&columns[index], right, |text| DoubleDouble::parse(text).filter(valid))
            };
            let (x, y) = (number(0, NUMBER, |_| true)?, number(1, NUMBER, |_| true)?);
            let weight = match self.weights {
                Some(_) => {
                    number(2, "a weight over 0, and from 1e-140 to 1e140", |weight| *weight > DoubleDouble::ZERO)?
                }
                None => DoubleDouble::ONE,
            };
            points.push(Point { x, y, weight });
            lines.push(rows.line());
        }
        Ok((points, lines))
    }
}

fn order_json(fit: &Fit) -> serde_json::Value {
    let mut value = serde_json::to_value(fit).unwrap_or_default();
    let limit = |d1: usize, p: f64| (fit.df_residual > 0).then(|| f_limit(p, d1 as f64, fit.df_residual as f64));
    value["f_limit"] = json!({"0.05": limit(fit.order, 0.05), "0.01": limit(fit.order, 0.01)});
    value["partial_f_limit"] = json!({"0.05": limit(1, 0.05), "0.01": limit(1, 0.01)});
    value
}

/// The order table for people.
pub fn table(regression: &Regression, y: &str, x: &str) -> String {
    let mut text = format!(
        "{y} as a polynomial of {x}: {} points\n\n order  residual sd          R2           R            F        p   \
         leave-one-out rms         max      effect\n",
        regression.n()
    );
    let fits = &regression.fits()[1..];
    // Writing to a String cannot fail.
    for fit in fits {
        let _ = writeln!(
            text,
            "{:6} {} {:11.9} {:11.9} {} {} {:>19} {} {}",
            fit.order,
            number(fit.residual_sd, 12),
            fit.r_squared.unwrap_or(f64::NAN),
            fit.r.unwrap_or(f64::NAN),
            number(fit.f, 12),
            number(fit.f_p, 8),
            number(fit.leave_one_out_rms, 11),
            number(fit.leave_one_out_max, 11),
            number(Some(fit.effect), 11),
        );
    }
    for fit in fits {
        let _ = writeln!(
            text,
            "\norder {}: coefficients of {x}^k; partial sums of squares in the basis centred at {:.6}, scaled by {:.6}\n  \
             k            coefficient  standard error     partial sum            F        p",
            fit.order,
            regression.center(),
            regression.scale()
        );
        for (k, coefficient) in fit.coefficients.iter().enumerate() {
            let error = fit.standard_errors.as_ref().map(|errors| errors[k]);
            let none = Partial { term: 0, sum_of_squares: f64::NAN, f: None, p: None };
            let partial = if k == 0 { &none } else { fit.partial_centred.get(k - 1).unwrap_or(&none) };
            let sum = (k > 0).then_some(partial.sum_of_squares);
            let _ = writeln!(
                text,
                "  {k:1} {coefficient:>22.14e} {} {} {} {}",
                number(error, 15),
                number(sum, 15),
                number(partial.f, 12),
                number(partial.p, 8)
            );
        }
    }
    text
}

fn number(value: Option<f64>, width: usize) -> String {
    match value {
        Some(value) if value == 0.0 || (1e-3..1e6).contains(&value.abs()) => {
            let digits = 5_usize.saturating_sub(value.abs().max(1.0).log10() as usize);
            format!("{value:>width$.digits$}")
        }
        Some(value) => format!("{:>width$}", format!("{value:.*e}", width.min(12).saturating_sub(8).max(1))),
        None => format!("{:>width$}", "-"),
    }
}
