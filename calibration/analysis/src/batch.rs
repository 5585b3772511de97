//! A batch of IMUs of one kind: how their curves spread, which device stands out, and whether one curve fits all.
//!
//! Everything is computed from the tables and their provenance. Curves are evaluated at three temperatures of the range
//! that all devices have, never compared by coefficients: devices may have other orders. All values are in the first
//! table's 1 g0.

mod family;
mod outliers;

pub use family::Family;
pub(crate) use outliers::FEWEST_DEVICES;
pub use outliers::{StandOut, least_found, leave_one_out, limit, stand_outs};

use crate::compare::{Convention, Form, FormCurve, common_range, points};
use isotherm_fit::TableFile;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{QUANTITIES, median};
use isotherm_support::failure::{Exit, Failure};
use isotherm_support::finding::{Finding, name};

/// Why there are no statistics of tables.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
#[error("statistics of the batch: {0}")]
pub struct BatchError(pub String);

impl From<BatchError> for Failure {
    fn from(error: BatchError) -> Self {
        Self::new(Exit::Config, error.to_string())
    }
}

/// One quantity of all devices.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// For example, `A1 bias at 1.1`.
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// Decimals that are shown.
    pub places: usize,
    /// Value of each device.
    pub values: Vec<f64>,
    /// How far each device is from the others, see [`leave_one_out`].
    pub t: Vec<Option<f64>>,
}

impl Quantity {
    fn new(name: String, unit: String, places: usize, values: Vec<f64>) -> Self {
        Self { t: leave_one_out(&values), name, unit, places, values }
    }

    /// The median of the devices.
    #[must_use]
    pub fn median(&self) -> f64 {
        median(self.values.iter().copied())
    }

    /// Standard deviation of the devices.
    #[must_use]
    pub fn sd(&self) -> f64 {
        let count = self.values.len() as f64;
        let mean = self.values.iter().sum::<f64>() / count;
        (self.values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt()
    }

    /// Whether it is not the same in all devices, which no unit could stand out in.
    fn differs(&self) -> bool {
        let [low, high] = self.range();
        high - low > 1e-12 * low.abs().max(high.abs())
    }

    /// Smallest and largest value.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        let fold = |start: f64, of: fn(f64, f64) -> f64| self.values.iter().copied().fold(start, of);
        [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
    }
}

/// One curve of all devices.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchCurve {
    /// For example, `A1 bias`.
    pub name: String,
    /// Unit of the curves less their mid values: of a bias its own, of a scale factor ppm.
    pub unit: &'static str,
    /// Points of the range that all devices have.
    pub temperature: Vec<f64>,
    /// For each device, its curve at the points less its mid value.
    pub curves: Vec<Vec<f64>>,
    /// Whether the mean of the others says how a device's curve runs; `None` under three devices, and where no curve
    /// changes.
    pub family: Option<Family>,
}

/// The statistics of a batch.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Names of the devices: their IMUs.
    pub devices: Vec<String>,
    /// The value of 1 g0 \[m/s2\] that all values are in.
    pub gravity: f64,
    /// Unit of the temperature.
    pub temperature_unit: String,
    /// All quantities.
    pub quantities: Vec<Quantity>,
    /// All curves.
    pub curves: Vec<BatchCurve>,
    /// The values that stand out; `None` under five devices. The indices are those of `devices` and `quantities`.
    pub stand_outs: Option<Vec<StandOut>>,
    /// What a reader must know about the statistics.
    pub notes: Vec<String>,
    /// What is not looked at, because not all tables have it.
    pub findings: Vec<Finding>,
}

/// A fault for each two tables that were made from the same rows: one of them is of another device than it says.
#[must_use]
pub fn same_rows(tables: &[TableFile]) -> Vec<Finding> {
    let pairs =
        tables.iter().enumerate().flat_map(|(index, one)| tables[..index].iter().map(move |other| (other, one)));
    let same = pairs.filter(|(one, other)| one.origin.shares_rows_with(&other.origin));
    let fault = |(one, other): (&TableFile, &TableFile)| {
        let [one, other] = [one, other].map(|table| &table.table.content().imu);
        let message = format!("{one} and {other} have the same recording; give each device its own");
        Finding::fault(name::SAME_RECORDING, message)
    };
    same.map(fault).collect()
}

/// The statistics of tables of different devices of one kind.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::batch;
/// use isotherm_fit::TableFile;
///
/// let text = include_str!("../../../tests/data/imu-a.toml");
/// let table = |unit| TableFile::from_toml(unit, &text.replace("imu-a", unit));
/// let batch = batch(&[table("imu-a")?, table("imu-b")?, table("imu-c")?]).map_err(|error| error.0)?;
/// assert_eq!(batch.devices, ["imu-a", "imu-b", "imu-c"]);
/// assert_eq!(batch.quantities[0].sd(), 0.0); // these devices are all the same
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If there are fewer than two, if two are of one IMU or from one recording, or if their temperature is in different
/// devices.
pub fn batch(tables: &[TableFile]) -> Result<Batch, BatchError> {
    let devices: Vec<_> = tables.iter().map(|table| table.table.content().imu.to_string()).collect();
    let Some(first) = tables.first().filter(|_| tables.len() > 1) else {
        return Err(BatchError("there are fewer than two tables; give one of each device".to_owned()));
    };
    if let Some(twice) = devices.iter().enumerate().find(|(index, unit)| devices[..*index].contains(unit)) {
        return Err(BatchError(format!("two tables are of {}; give one of each device", twice.1)));
    }
    if let Some(refused) = same_rows(tables).into_iter().next() {
        return Err(BatchError(refused.message));
    }
    let content = first.table.content();
    let unit = &content.temperature_unit;
    if let Some(other) = tables.iter().map(|table| &table.table.content().temperature_unit).find(|other| *other != unit)
    {
        return Err(BatchError(format!("temperature in {unit} and {other}; give tables with one temperature")));
    }
    let mut found = Batch {
        devices,
        gravity: content.gravity,
        temperature_unit: unit.clone(),
        quantities: Vec::new(),
        curves: Vec::new(),
        stand_outs: None,
        notes: Vec::new(),
        findings: Vec::new(),
    };
    let convention = Convention::of(tables);
    let forms: Vec<_> = tables.iter().map(|table| Form::of(table, convention)).collect();
    found.notes.extend(convention.note().map(str::to_owned));
    let sensors = forms.iter().map(|form| form.curves.len()).min().unwrap_or(0);
    if forms.iter().any(|form| form.curves.len() != sensors) {
        found.skip("Not all tables have gyroscopes: only the accelerometers are looked at.".to_owned());
    }
    for kind in [SensorKind::Accelerometer, SensorKind::Gyroscope].into_iter().take(sensors / AXES) {
        for axis in 0..AXES {
            for quantity in 0..QUANTITIES.len() {
                found.add_curve((kind, axis, quantity), &forms);
            }
        }
        found.add_misalignments(kind, &forms);
    }
    found.add_residuals(tables);
    // What is the same in all devices is no quantity that a device can stand out in.
    let judged: Vec<_> = (0..found.quantities.len()).filter(|q| found.quantities[*q].differs()).collect();
    let values: Vec<_> = judged.iter().map(|q| found.quantities[*q].values.clone()).collect();
    found.stand_outs = stand_outs(&values).map(|all| {
        let place = |it: StandOut| StandOut { quantity: judged[it.quantity], ..it };
        all.into_iter().map(place).collect()
    });
    Ok(found)
}

impl Batch {
    /// Notes what is not looked at.
    fn skip(&mut self, message: String) {
        self.findings.push(Finding::warning(name::NOT_COMPARED, message));
    }

    /// Adds a curve: its values at the ends and the middle of the common range, its slope, and how it runs.
    fn add_curve(&mut self, (kind, axis, quantity): (SensorKind, usize, usize), forms: &[Form]) {
        let of = |quantity: usize| -> Vec<&FormCurve> {
            let index = if kind == SensorKind::Gyroscope { AXES + axis } else { axis };
            forms.iter().map(|form| &form.curves[index][quantity]).collect()
        };
        let (all, name) = (of(quantity), format!("{} {}", kind.names()[axis], QUANTITIES[quantity]));
        let Some(range) = common_range(all.iter().copied()) else {
            self.skip(format!("{name}: the devices have no common range of the temperature, so it is not looked at."));
            return;
        };
        let temperature = points(range);
        // A scale factor that was fitted as one, with K- = -K+, is one quantity.
        let opposite = |(plus, minus): (&FormCurve, &FormCurve)| {
            temperature.iter().all(|u| (plus.at(*u) + minus.at(*u)).abs() <= 1e-12 * plus.at(*u).abs())
        };
        if quantity == 2 && of(1).into_iter().zip(all.iter().copied()).all(opposite) {
            return;
        }
        let (unit, factor, places) = match (kind, quantity) {
            (SensorKind::Accelerometer, 0) => ("ug0", 1e6 / self.gravity, 3),
            (SensorKind::Gyroscope, 0) => ("deg/h", 1.0, 5),
            (SensorKind::Accelerometer, _) => ("pulse/(s*g0)", self.gravity, 3),
            (SensorKind::Gyroscope, _) => ("pulse/arcsec", 1.0, 7),
        };
        let values: Vec<Vec<f64>> =
            all.iter().map(|curve| temperature.iter().map(|u| curve.at(*u) * factor).collect()).collect();
        let last = temperature.len() - 1;
        let constant = all.iter().all(|curve| curve.coefficients() == 1);
        for point in [0, last / 2, last].into_iter().filter(|point| !constant || *point == last / 2) {
            let name = format!("{name} at {:.4}", temperature[point]);
            let values = values.iter().map(|curve| curve[point]).collect();
            self.quantities.push(Quantity::new(name, unit.to_owned(), places, values));
        }
        if constant {
            return;
        }
        let slopes = values.iter().map(|curve| (curve[last] - curve[0]) / (range[1] - range[0])).collect();
        let slope_unit = format!("{unit}/{}", self.temperature_unit);
        self.quantities.push(Quantity::new(format!("{name} slope"), slope_unit, places, slopes));
        let relative = |curve: &Vec<f64>| -> Vec<f64> {
            let mid = curve[last / 2];
            let factor = if quantity == 0 { 1.0 } else { 1e6 / mid };
            curve.iter().map(|value| (value - mid) * factor).collect()
        };
        let curves: Vec<_> = values.iter().map(relative).collect();
        let unit = if quantity == 0 { unit } else { "ppm" };
        self.curves.push(BatchCurve { name, unit, temperature, family: Family::of(&curves), curves });
    }

    /// Adds the misalignments of a triad: those of the provenance, or of the alignment matrix.
    fn add_misalignments(&mut self, kind: SensorKind, forms: &[Form]) {
        let triad = usize::from(kind == SensorKind::Gyroscope);
        let Some(matrices) = forms.iter().map(|form| form.misalignment[triad]).collect::<Option<Vec<_>>>() else {
            self.skip("Not all tables have misalignments, so they are not looked at.".to_owned());
            return;
        };
        for (i, j) in (0..AXES).flat_map(|i| (0..AXES).map(move |j| (i, j))).filter(|(i, j)| i != j) {
            let values: Vec<_> = matrices.iter().map(|matrix| matrix[(i, j)] * 1e6).collect();
            // By the convention of three misalignments the others are 0.
            if values.iter().any(|value| *value != 0.0) {
                let name = format!("{} misalignment onto axis {}", kind.names()[i], j + 1);
                self.quantities.push(Quantity::new(name, "urad".to_owned(), 2, values));
            }
        }
    }

    /// Adds the residuals of the accelerometers, in each table's own 1 g0.
    fn add_residuals(&mut self, tables: &[TableFile]) {
        let mut add = |name: String, values: Vec<f64>| {
            let values = values.into_iter().map(|value| value * 1e6).collect();
            self.quantities.push(Quantity::new(name, "ug0".to_owned(), 3, values));
        };
        let by_axis: Option<Vec<_>> = tables.iter().map(|table| table.origin.residual_sd_g0).collect();
        let rms: Option<Vec<_>> = tables.iter().map(|table| table.origin.residual_rms_g0).collect();
        match (by_axis, rms) {
            (Some(all), _) => {
                for (axis, name) in SensorKind::Accelerometer.names().into_iter().enumerate() {
                    add(format!("{name} residual"), all.iter().map(|of_unit| of_unit[axis]).collect());
                }
            }
            (None, Some(all)) => add("residual".to_owned(), all),
            (None, None) => {
                self.skip("Not all tables have the same kind of residuals, so they are not looked at.".to_owned());
            }
        }
    }

    /// Quantities that a device can stand out in.
    #[must_use]
    pub fn judged(&self) -> usize {
        self.quantities.iter().filter(|quantity| quantity.differs()).count()
    }

    /// The size of t that a value must exceed to stand out; `None` under five devices.
    #[must_use]
    pub fn limit(&self) -> Option<f64> {
        limit(self.devices.len(), self.judged())
    }

    /// Which devices stand out, a line each.
    #[must_use]
    pub fn verdict(&self) -> Vec<String> {
        let count = self.devices.len();
        let (Some(found), Some(limit)) = (&self.stand_outs, self.limit()) else {
            return vec![format!(
                "{count} devices are too few to say whether one stands out; it takes {FEWEST_DEVICES}."
            )];
        };
        if found.is_empty() {
            return vec![format!(
                "No device stands out: no |t| is over {limit:.1}, the limit for {count} devices and {} quantities.",
                self.judged()
            )];
        }
        let line = |it: &StandOut| {
            let quantity = &self.quantities[it.quantity];
            let (value, places) = (quantity.values[it.unit], quantity.places);
            format!(
                "{} stands out: {} {value:.places$} {}, median {:.places$}, t = {:.1}, limit {:.1}",
                self.devices[it.unit],
                quantity.name,
                quantity.unit,
                quantity.median(),
                it.t,
                it.limit
            )
        };
        found.iter().map(line).collect()
    }

    /// How far off a device must be to be found, here and among more devices.
    #[must_use]
    pub fn power(&self) -> String {
        let quantities = self.judged();
        let of = |devices: usize| least_found(devices, quantities).map(|size| format!("{size:.0} among {devices}"));
        let sizes: Vec<_> = [5, 8, 16, 32].into_iter().filter_map(of).collect();
        let here = of(self.devices.len()).map_or_else(String::new, |here| format!("Here: {here} devices. "));
        format!(
            "{here}With {quantities} quantities a device is found in 9 of 10 cases if in one of them it is off by this many standard deviations of the \
             devices: {}.",
            sizes.join(", ")
        )
    }

    /// Whether one curve fits all devices, a line each.
    #[must_use]
    pub fn families(&self) -> Vec<String> {
        let line = |curve: &BatchCurve| {
            let family = curve.family.as_ref()?;
            Some(format!(
                "{}: the mean of the other devices leaves {:.2} of the rms, {} of {} devices gain: a family curve is {}",
                curve.name,
                family.ratio(),
                family.gains(),
                self.devices.len(),
                if family.is_useful() { "useful" } else { "not useful" }
            ))
        };
        self.curves.iter().filter_map(line).collect()
    }
}
