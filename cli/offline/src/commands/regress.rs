//! `regress`: one polynomial regression with its order table.

use super::part::PartArgs;
use crate::parse::size;
use crate::progress::{bytes_bar, spinner};
use clap::Args;
use isotherm_files::{check_stdout, check_written, print, print_data, sources};
use isotherm_recording_formats::read::{ImuChoice, NumberRow, NumberTable, read_numbers};
use isotherm_shared::names::ImuId;
use isotherm_statistics::{
    DataPoint, DoubleDouble, LinearColumn, MAX_ORDER, OrderTable, Regression, Rule, default_order,
};
use isotherm_support::failure::{Exit, Failure};
use serde_json::json;
use std::path::PathBuf;
use tracing::{info, warn};

/// Descriptions of a valid number and a valid weight, for messages.
const NUMBER: &str = "a finite number, 0 or of size 1e-140 to 1e140";
const WEIGHT: &str = "a weight over 0, and from 1e-140 to 1e140";
/// Most outliers whose lines are listed.
const NAMED: usize = 20;

/// Fit polynomials of one column on another
///
/// Fits polynomials of one column on another, and further columns linearly. Prints a table of the orders, the chosen
/// order, and warnings.
///
/// A column can be `a-b`, the difference of the columns a and b. The separator of the columns is detected: commas,
/// semicolons, tabs or spaces. Decimal commas are detected where commas do not separate the columns. Every order from 1
/// to the highest is fitted in double-double arithmetic, on the decimals as they are written. The chosen order is the
/// highest whose last term is significant and also changes the curve by more than a threshold.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm regress dwells.csv --x a1_head --y a1_bias\n  isotherm regress dwells.csv --x u --y k --weights w --max-order 10 --json\n  isotherm regress ramp.csv --x a1_head --x a1_head_lagged-a1_head --y a1_positive-a1_negative"
)]
pub struct Regress {
    /// Read these data with named columns
    ///
    /// CSV with a header row or MCAP, or the pieces of one recording in any order; - is stdin.
    #[arg(value_name = "DATA", required = true)]
    data: Vec<PathBuf>,
    /// Read the columns of this IMU
    ///
    /// For a recording of several IMUs.
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Use this column as the variable
    ///
    /// For example, the temperature. Each further --x enters linearly.
    #[arg(long, value_name = "COLUMN", required = true)]
    x: Vec<String>,
    /// Fit this column
    #[arg(long, value_name = "COLUMN")]
    y: String,
    /// Set the highest order, up to 15
    ///
    /// Default: 6, or fewer if there are too few different x
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = clap::value_parser!(u8).range(1..=MAX_ORDER as i64))]
    max_order: Option<u8>,
    /// Weight the rows by this column
    ///
    /// The weights are positive: inverse variances up to a common factor.
    #[arg(long, value_name = "COLUMN")]
    weights: Option<String>,
    /// Set the smallest change that matters
    ///
    /// The smallest change of the curve that matters, in the unit of y [default: a quarter of the residual standard
    /// deviation]
    #[arg(long, value_name = "Y", allow_negative_numbers = true, value_parser = size)]
    min_effect: Option<f64>,
    #[command(flatten)]
    part: PartArgs,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

impl Regress {
    pub(crate) fn run(self) -> Result<(), Failure> {
        check_written(None, check_stdout())?;
        let (x, linear) = self.x.split_first().ok_or_else(|| Failure::new(Exit::Usage, "--x is missing"))?;
        let names: Vec<_> = self.x.iter().chain([&self.y]).chain(&self.weights).map(String::as_str).collect();
        let y_index = self.x.len();
        let choice = self.imu.clone().map_or(ImuChoice::Any, ImuChoice::Only);
        let bar = bytes_bar(&self.data, "reading");
        let read = read_numbers(&sources(&self.data)?, &names, &choice, self.part.get()?, &bar, |name, text| {
            let number = DoubleDouble::parse(text);
            if name > y_index {
                number.filter(|weight| *weight > DoubleDouble::ZERO).ok_or(WEIGHT)
            } else {
                number.ok_or(NUMBER)
            }
        });
        bar.finish();
        let NumberTable { rows, places, notes } = read?;
        for note in &notes {
            info!("{note}");
        }
        let point = |row: &NumberRow<DoubleDouble>| {
            let weight = row.values.get(y_index + 1).copied().unwrap_or(DoubleDouble::ONE);
            DataPoint { x: row.values[0], y: row.values[y_index], weight }
        };
        let points: Vec<_> = rows.iter().map(point).collect();
        let column = |(name, index): (&String, usize)| LinearColumn {
            name: name.clone(),
            values: rows.iter().map(|row| row.values[index]).collect(),
        };
        let linear: Vec<_> = linear.iter().zip(1..).map(column).collect();
        let highest = self.max_order.map(usize::from).unwrap_or_else(|| {
            let values: Vec<_> = points.iter().map(|point| point.x.value()).collect();
            default_order(&values, linear.len())
        });
        let spinner = spinner("fitting");
        let regression = Regression::with_linear(points, x, linear, highest);
        let table = regression
            .map(|regression| OrderTable::choose(regression, &Rule { effect: self.min_effect, ..Rule::default() }));
        spinner.finish_and_clear();
        let path = self.data.first().map(|path| path.display().to_string()).unwrap_or_default();
        let table = table.map_err(|error| Failure::new(Exit::Data, format!("{path}: {error}")))?;
        let outliers = table.diagnostics.outliers.iter().filter_map(|&index| rows.get(index));
        let outliers: Vec<_> = outliers.map(|row| row.line).collect();
        let mut warnings = table.diagnostics.warnings.clone();
        if !outliers.is_empty() {
            let named = outliers.iter().take(NAMED);
            let named: Vec<_> = match self.data.len() {
                1 => named.map(ToString::to_string).collect(),
                _ => named.map(|line| places.locate(*line)).collect(),
            };
            let more = outliers.len() - named.len();
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            warnings.push(format!(
                "far larger than the other residuals, but kept: line {}{more}; look at them",
                named.join(", ")
            ));
        }
        for warning in &warnings {
            warn!("warning: {warning}");
        }
        if !self.json {
            return print(&table.text(x, &self.y));
        }
        let mut document = table.json();
        document["x"] = json!(x);
        document["y"] = json!(self.y);
        let lines: Vec<_> = outliers.iter().map(|line| places.within_piece(*line)).collect();
        let located: Vec<_> = outliers.iter().map(|line| places.locate(*line)).collect();
        document["diagnostics"]["outlier_lines"] = json!(lines);
        document["diagnostics"]["outlier_places"] = json!(located);
        document["warnings"] = json!(warnings);
        if !notes.is_empty() {
            document["notes"] = json!(notes);
        }
        print_data(&format!("{document:#}\n"))
    }
}
