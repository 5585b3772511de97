//! Comparison of tables of one IMU: what has changed between two calibrations, and what changes over the years.
//!
//! Curves are compared, never coefficients: other orders, centres, units and values of 1 g0 do not matter. Biases are
//! compared in m/s2 and shown in ug0 of 9.80665e-6 m/s2, scale factors in pulse/(m/s) and shown in ppm of the old one.
//! At each of 41 points of the common range the variance of the difference is the sum of the variances that the
//! covariances in both provenances give,
//!
//! ```text
//! v = p' C p,    p = (1, x, x^2, ..),    x = (U - center)/scale
//! ```
//! with Welch's degrees of freedom. A curve has changed if its difference d exceeds the band of Scheffe with 1 - 0.05/n
//! anywhere: `|d| > sqrt(k F(k, df; 1 - 0.05/n)) sqrt(v)`, k the number of coefficients, n that of the curves: 9, or 18
//! with gyroscopes. So in 5 of 100 comparisons at most any curve counts as changed where nothing has changed. The
//! misalignments share 5 % of their own.
//!
//! The errors are those of each campaign. They do not hold what differs between two mountings of the IMU.

mod alignment;
mod curves;
mod requirement;
mod table;
mod trend;

pub use alignment::AlignmentComparison;
pub use curves::CurveComparison;
pub use requirement::{ComparisonRequirement, Compliance};
pub use table::Convention;
pub use trend::{Trend, YEAR_S};

pub(crate) use curves::common_range;
use isotherm_fit::TableFile;
pub(crate) use isotherm_shared::table::difference::points;
use isotherm_shared::table::difference::scale_multipliers;
use isotherm_statistics::QUANTITIES;
use isotherm_support::finding::{Finding, name};
pub(crate) use table::{Form, FormCurve};

use isotherm_shared::table::Content;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure};
use std::fmt;

/// What the errors do not hold, for every report.
pub const NOT_IN_THE_ERRORS: &str =
    "The errors are those of each campaign. They do not hold what differs between two mountings of the IMU.";

/// Why tables cannot be compared.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub struct ComparisonError(pub Vec<String>);

impl fmt::Display for ComparisonError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "comparing tables: {}", self.0.join("\n"))
    }
}

impl From<ComparisonError> for Failure {
    fn from(error: ComparisonError) -> Self {
        Self::new(Exit::Config, error.to_string())
    }
}

/// A comparison of two tables, or of the oldest and the newest of several.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// All tables: two as they were given, more by their dates.
    pub tables: Vec<TableFile>,
    /// How misalignments are compared.
    pub convention: Convention,
    /// Bias, K+ and K- of each sensor.
    pub curves: Vec<CurveComparison>,
    /// Of the accelerometers, and of the gyroscopes if both tables have them.
    pub alignments: Vec<AlignmentComparison>,
    /// A line through each quantity over the dates, of three tables or more.
    pub trends: Vec<Trend>,
    /// What a reader must know about the comparison.
    pub notes: Vec<String>,
    /// Warnings about the tables.
    pub findings: Vec<Finding>,
}

/// Compares tables: the first is the old one, the second the new one. Three or more are put in the order of their dates
/// first; then the oldest and the newest are compared, and each quantity gets a line over the dates. With
/// `other_device` they may be of different IMUs.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::compare;
/// use isotherm_fit::TableFile;
///
/// let text = include_str!("../../../tests/data/imu-a.toml");
/// let one = TableFile::from_toml("a.toml", text)?;
/// let other = TableFile::from_toml("b.toml", &text.replace("imu-a", "imu-b"))?;
/// assert!(compare(vec![one.clone(), other.clone()], false).is_err()); // another IMU
/// let comparison = compare(vec![one, other], true).map_err(|error| error.to_string())?;
/// assert_eq!(comparison.curves.len(), 9); // bias, K+ and K- of three accelerometers
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If there are fewer than two, if they are of different IMUs or have temperature in different units, if a curve has no
/// common range, or if three or more have no dates.
pub fn compare(mut tables: Vec<TableFile>, other_device: bool) -> Result<Comparison, ComparisonError> {
    let mut faults = faults(&tables, other_device);
    if tables.len() > 2 {
        faults.extend(dates(&tables));
    }
    if !faults.is_empty() {
        return Err(ComparisonError(faults));
    }
    let time = |table: &TableFile| table.origin.unix_s.unwrap_or(f64::NAN);
    if tables.len() > 2 {
        tables.sort_by(|a, b| time(a).total_cmp(&time(b)));
    }
    let convention = Convention::of(&tables);
    let first = &tables[0].table;
    let forms = tables.iter().map(|table| {
        let [of_first, own] = scale_multipliers(first, &table.table).unwrap_or([1.0; 2]);
        Form::of(table, convention).with_scale_factors_times(own / of_first)
    });
    let forms: Vec<_> = forms.collect();
    // The constants of a nominal table hold at any temperature. It has no date, so of three tables or more none is
    // nominal.
    let is_first = tables.last().is_some_and(|last| last.table.is_first_calibration_after(first));
    let ranged = usize::from(is_first);
    let (Some(old), Some(new)) = (forms.first(), forms.last()) else { return Err(ComparisonError(Vec::new())) };
    // Gyroscopes are compared if all tables have them.
    let sensors = forms.iter().map(|form| form.curves.len()).min().unwrap_or(0);
    let kinds = [SensorKind::Accelerometer, SensorKind::Gyroscope];
    let places = kinds.into_iter().flat_map(|kind| (0..AXES).map(move |axis| (kind, axis)));
    let quantities = places.take(sensors).enumerate();
    let quantities = quantities
        .flat_map(|(index, (kind, axis))| (0..QUANTITIES.len()).map(move |quantity| (index, (kind, axis, quantity))));
    let from = time(&tables[0]);
    let years: Vec<_> = tables.iter().map(|table| (time(table) - from) / YEAR_S).collect();
    let count = sensors * QUANTITIES.len();
    let (mut curves, mut trends) = (Vec::new(), Vec::new());
    for (index, place) in quantities {
        let (kind, axis, quantity) = place;
        let all: Vec<_> = forms.iter().map(|form| &form.curves[index][quantity]).collect();
        let Some(range) = common_range(all[ranged..].iter().copied()) else {
            let ranges: Vec<_> = all.iter().map(|curve| format!("{:?}", curve.range())).collect();
            let name = format!("{} {}", kind.names()[axis], QUANTITIES[quantity]);
            return Err(ComparisonError(vec![format!("{name}: no common range, {}", ranges.join(" and "))]));
        };
        // The range of the pair may be wider than that of all.
        let pair = [&old.curves[index][quantity], &new.curves[index][quantity]];
        curves.push(CurveComparison::of(
            place,
            pair,
            common_range(pair[ranged..].iter().copied()).unwrap_or(range),
            count,
        ));
        if tables.len() > 2 {
            trends.push(Trend::of(place, &all, f64::midpoint(range[0], range[1]), &years));
        }
    }
    let triads = sensors / AXES;
    let alignments = kinds.into_iter().take(triads);
    let alignments: Vec<_> = alignments.map(|kind| AlignmentComparison::of(kind, [old, new], triads)).collect();
    let (notes, findings) = (notes(&tables, convention), findings(&tables, &curves, &alignments));
    Ok(Comparison { tables, convention, curves, alignments, trends, notes, findings })
}

/// Why the tables cannot be compared, whatever their curves are.
fn faults(tables: &[TableFile], other_device: bool) -> Vec<String> {
    let different = |of: fn(&TableFile) -> &str| Some(unique(tables.iter().map(of))).filter(|names| names.len() > 1);
    let few = (tables.len() < 2).then(|| "there are fewer than two; give an old one and a new one".to_owned());
    let imus = different(|table| table.table.content().imu.as_str()).filter(|_| !other_device);
    let imus = imus.map(|imus| {
        let count = if imus.len() == 2 { "two".to_owned() } else { imus.len().to_string() };
        format!(
            "tables of {count} IMUs: {}; give those of one, or --other-device to compare different ones",
            imus.join(", ")
        )
    });
    let units = different(|table| &table.table.content().temperature_unit);
    let units = units.map(|units| format!("temperature in {}; give tables with one temperature", units.join(" and ")));
    few.into_iter().chain(imus).chain(units).chain(other_interval(tables)).collect()
}

/// That scale factors are of different nominal intervals, and cannot be alike.
fn other_interval(tables: &[TableFile]) -> Option<String> {
    let interval = |table: &TableFile| table.table.content().nominal_interval_s;
    let first = tables.iter().find(|table| interval(table).is_some())?;
    let other = tables.iter().find(|other| scale_multipliers(&first.table, &other.table).is_none())?;
    let [first, other] = [interval(first)?, interval(other)?];
    Some(format!("scale factors of {first} s and of {other} s (nominal_interval_s); give tables of one interval"))
}

/// Texts in their order, each once.
fn unique<'a>(texts: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    texts.into_iter().fold(Vec::new(), |mut found, text| {
        if !found.contains(&text) {
            found.push(text);
        }
        found
    })
}

/// Why there is no line over the dates.
fn dates(tables: &[TableFile]) -> Vec<String> {
    let undated = tables.iter().filter(|table| table.origin.unix_s.is_none());
    let mut faults: Vec<_> = undated
        .map(|table| {
            let found = table.origin.time.as_ref().map_or("has no time".to_owned(), |time| format!("has the time {time:?}"));
            format!(
                "{}: its provenance {found}; a line over the dates needs time = \"2026-03-01T10:00:00Z\" (RFC 3339 in UTC)",
                table.name
            )
        })
        .collect();
    let times = || tables.iter().filter_map(|table| table.origin.unix_s);
    if faults.is_empty() && times().fold(f64::INFINITY, f64::min) >= times().fold(f64::NEG_INFINITY, f64::max) {
        faults.push("all tables have the same date; a line over the dates needs two different ones".to_owned());
    }
    faults
}

/// What a reader must know about the comparison.
fn notes(tables: &[TableFile], convention: Convention) -> Vec<String> {
    let mut notes: Vec<_> = convention.note().map(str::to_owned).into_iter().collect();
    let without = names(tables, |table| table.table.content().alignment.is_none());
    notes.extend(without.map(|names| format!("{names}: no alignment matrix, which counts as the identity.")));
    let transient = |table: &TableFile| table.sensors().any(|(_, _, axis)| axis.transient != 0.0);
    if tables.iter().any(transient) {
        notes.push("The transients of the biases are not compared.".to_owned());
    }
    if tables.iter().all(TableFile::has_gyroscopes) {
        notes.push("The g-sensitivities of the gyroscopes are not compared.".to_owned());
    }
    notes
}

/// The names of the tables that are `of` a kind, if some are and others are not.
fn names(tables: &[TableFile], of: impl Fn(&TableFile) -> bool) -> Option<String> {
    let names: Vec<_> = tables.iter().filter(|table| of(table)).map(|table| table.name.as_str()).collect();
    (!names.is_empty() && names.len() < tables.len()).then(|| names.join(", "))
}

/// That two tables have the same content, whatever they are called, or come from the same rows.
fn same(one: &TableFile, other: &TableFile) -> Option<String> {
    let (a, b) = (one.table.content(), other.table.content());
    let copy = Content { imu: a.imu.clone(), serial: a.serial.clone(), ..b.clone() };
    let (of, and) = (&one.name, &other.name);
    match () {
        () if one.table.digest() == other.table.digest() => Some(format!("the same table: {of} and {and}")),
        () if *a == copy => Some(format!("the same table under another name: {of} of {}, {and} of {}", a.imu, b.imu)),
        () if one.origin.shares_rows_with(&other.origin) => {
            Some(format!("from the same recording: {of} and {and}; what differs is not the IMU"))
        }
        () => None,
    }
}

/// Warnings about the tables.
fn findings(tables: &[TableFile], curves: &[CurveComparison], alignments: &[AlignmentComparison]) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut add = |name, message| found.push(Finding::warning(name, message));
    for (index, one) in tables.iter().enumerate() {
        for other in &tables[index + 1..] {
            same(one, other).into_iter().for_each(|message| add(name::SAME_TABLE, message));
        }
    }
    let serials: Vec<_> = tables.iter().map(|table| table.table.content().serial.as_deref()).collect();
    if serials.windows(2).any(|pair| matches!(pair, [Some(a), Some(b)] if a != b)) {
        let list: Vec<_> = serials.iter().flatten().copied().collect();
        add(name::SERIALS, format!("The serial numbers differ: {}.", list.join(", ")));
    }
    if let [old, new] = tables
        && old.origin.unix_s.zip(new.origin.unix_s).is_some_and(|(old, new)| new < old)
    {
        add(name::DATES, format!("{} is dated before {}: the new table is the older one.", new.name, old.name));
    }
    let unknown = "only the values decide, and nothing says whether a difference is more than the errors.";
    let missing: Vec<_> = curves.iter().filter(|curve| curve.band.is_none()).map(|curve| curve.name()).collect();
    if !missing.is_empty() {
        let which = if missing.len() == curves.len() { "any curve".to_owned() } else { missing.join(", ") };
        let message = format!("The provenances do not have the covariances of {which} in both tables: {unknown}");
        add(name::ERRORS_UNKNOWN, message);
    }
    for alignment in alignments.iter().filter(|alignment| alignment.half_width_urad.is_none()) {
        let of = alignment.name();
        let message = format!("The errors of the misalignments of the {of} are not known in both tables: {unknown}");
        add(name::ERRORS_UNKNOWN, message);
    }
    if let Some(names) = names(tables, |table| !table.has_gyroscopes()) {
        add(name::NOT_COMPARED, format!("{names}: no gyroscopes, so that those of the others are not compared."));
    }
    found
}

/// A bound, judged.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveJudgement {
    /// Curve or triad.
    pub name: String,
    /// Whether its difference is within the bound.
    pub verdict: Compliance,
    /// The judgement in words, with values and bound.
    pub message: String,
    /// What to do, unless it is within.
    pub remedy: Option<&'static str>,
}

impl Comparison {
    /// The old table: the first, or the oldest of three or more.
    #[must_use]
    pub fn old_table(&self) -> &TableFile {
        &self.tables[0]
    }

    /// The new table: the second, or the newest of three or more.
    #[must_use]
    pub fn new_table(&self) -> &TableFile {
        &self.tables[self.tables.len() - 1]
    }

    /// Names of the curves and triads that have changed by more than their errors.
    #[must_use]
    pub fn changed(&self) -> Vec<String> {
        let curves = self.curves.iter().filter(|curve| curve.is_changed() == Some(true)).map(|curve| curve.name());
        let alignments = self.alignments.iter().filter(|alignment| alignment.is_changed() == Some(true));
        curves.chain(alignments.map(|alignment| format!("alignment of the {}", alignment.name()))).collect()
    }

    /// Whether the errors of all curves and misalignments are known.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.curves.iter().all(|curve| curve.band.is_some())
            && self.alignments.iter().all(|alignment| alignment.half_width_urad.is_some())
    }

    /// What has changed, in words.
    #[must_use]
    pub fn conclusion(&self) -> String {
        let changed = self.changed();
        match (changed.is_empty(), self.has_errors()) {
            (false, _) => format!("Changed by more than the errors: {}.", changed.join(", ")),
            (true, true) => "Nothing has changed by more than the errors.".to_owned(),
            (true, false) => "Whether anything has changed by more than the errors is not known.".to_owned(),
        }
    }

    /// Judges every bound that is given.
    #[must_use]
    pub fn judge(&self, required: &ComparisonRequirement) -> Vec<CurveJudgement> {
        let imu = |table: &TableFile| table.table.content().imu.clone();
        let beyond = match imu(self.old_table()) == imu(self.new_table()) {
            true => "install the new table, and look for the cause",
            false => "these are different IMUs; give each a table of its own",
        };
        let judgement =
            |name: String, ends: [Option<f64>; 2], largest: f64, verdict: Compliance, bound: f64, unit: &str| {
                let places = if unit == "deg/h" { 5 } else { 3 };
                let difference = match ends {
                    [Some(lower), Some(upper)] => {
                        format!("{largest:.places$}, with its band {lower:.places$} to {upper:.places$} {unit}")
                    }
                    _ => format!("{largest:.places$} {unit}, errors not known"),
                };
                let message = format!("{name}: {difference}, at most {bound:.places$} {unit} is required: {verdict}");
                let remedy = match verdict {
                    Compliance::Within => None,
                    Compliance::Undecided => Some("a longer campaign has smaller errors"),
                    Compliance::Beyond => Some(beyond),
                };
                CurveJudgement { name, verdict, message, remedy }
            };
        let mut found = Vec::new();
        for curve in &self.curves {
            if let Some(bound) = required.of_curve(curve.unit) {
                let ends = [curve.lower(), curve.upper()];
                found.push(judgement(curve.name(), ends, curve.largest().0, curve.verdict(bound), bound, curve.unit));
            }
        }
        if let Some(bound) = required.alignment.map(|alignment| alignment * 1e6) {
            found.extend(self.alignments.iter().map(|alignment| {
                let name = format!("alignment of the {}", alignment.name());
                let ends = [alignment.lower_urad(), alignment.upper_urad()];
                judgement(name, ends, alignment.largest_urad(), alignment.verdict(bound), bound, "urad")
            }));
        }
        if required.rate.is_some() && !self.curves.iter().any(|curve| curve.unit == "deg/h") {
            let (name, verdict) = ("rate".to_owned(), Compliance::Undecided);
            let message = "rate: not judged, the tables do not all have gyroscopes".to_owned();
            let remedy = Some("leave rate out, or give only tables with gyroscopes");
            found.push(CurveJudgement { name, verdict, message, remedy });
        }
        found
    }

    /// The worst verdict; `None` if nothing is required.
    #[must_use]
    pub fn verdict(&self, required: &ComparisonRequirement) -> Option<Compliance> {
        self.judge(required).into_iter().map(|judgement| judgement.verdict).max()
    }

    /// Whether everything that is required is within its bound.
    ///
    /// # Errors
    /// The judgements that are not, each with its remedy below it; those with the same one are together.
    pub fn check(&self, required: &ComparisonRequirement) -> Result<(), String> {
        let judgements = self.judge(required);
        let missed: Vec<_> = judgements.iter().filter(|judgement| judgement.verdict != Compliance::Within).collect();
        if missed.is_empty() {
            return Ok(());
        }
        let remedies = unique(missed.iter().filter_map(|judgement| judgement.remedy));
        let part = |remedy: &&'static str| {
            let lines = missed.iter().filter(|judgement| judgement.remedy == Some(*remedy));
            let lines: String = lines.map(|judgement| format!("\n  {}", judgement.message)).collect();
            format!("{lines}\nremedy: {remedy}")
        };
        Err(format!("the requirement is not met:{}", remedies.iter().map(part).collect::<String>()))
    }
}
