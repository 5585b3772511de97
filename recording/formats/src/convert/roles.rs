//! What the columns of a text are, by their names.

use super::heading::ColumnHeading;
use super::looked::LookedTable;
use super::unit::{self, Quantity, UnitWord};
use isotherm_shared::wire::AXES;

/// Temperatures of an IMU \[degC\].
pub(super) const CELSIUS: std::ops::RangeInclusive<f64> = -60.0..=150.0;

/// Which columns are something.
pub(super) enum Role<T> {
    Known(T),
    /// Some of these, if it is to be found among them.
    Open(Vec<usize>),
    Absent,
}

/// What the columns of a text are, from 0.
pub(super) struct ColumnRoles {
    /// The time, and its unit if that is known.
    pub(super) time: Role<(usize, Option<&'static str>)>,
    /// Accelerometers and gyroscopes.
    pub(super) sensors: [Role<SensorRole>; 2],
    /// The temperature: one column, or one of each sensor.
    pub(super) temperature: Role<Vec<usize>>,
}

/// Three sensors.
pub(super) struct SensorRole {
    pub(super) columns: [usize; AXES],
    pub(super) numbers: ColumnNumbers,
    pub(super) offset: Option<&'static str>,
    /// The column of the time that the numbers are sums over.
    pub(super) duration: Option<usize>,
}

/// What the numbers of a sensor are.
pub(super) enum ColumnNumbers {
    /// Readings in this unit, and one pulse of them.
    Unit(&'static str, &'static str),
    /// Readings in a unit that is not known, and what the header says in its place.
    Unsaid(Option<String>),
    /// Counts that are readings.
    Counts,
    /// Whole numbers, which may be counts of any kind.
    Whole,
}

impl ColumnRoles {
    /// By the names of the columns. All is open without names.
    pub(super) fn by_names(looked: &LookedTable) -> Self {
        let headings: Vec<_> = match looked.header {
            true => looked.columns.iter().map(|column| ColumnHeading::new(&column.name)).collect(),
            false => vec![ColumnHeading::default(); looked.columns.len()],
        };
        let names = NamedColumns { looked, headings };
        let time = names.time();
        let taken = |column: usize| matches!(time, Role::Known((time, _)) if time == column);
        let accelerometer = match names.triad(Quantity::Acceleration, ColumnHeading::accelerometer) {
            Role::Absent => Role::Open(names.find(|column| !taken(column) && looked.columns[column].is_numeric())),
            found => found,
        };
        let gyroscope = names.triad(Quantity::Rate, ColumnHeading::gyroscope);
        let temperature = names.temperature(taken, matches!(gyroscope, Role::Known(_)));
        Self { time, sensors: [accelerometer, gyroscope], temperature }
    }
}

struct NamedColumns<'a> {
    looked: &'a LookedTable,
    headings: Vec<ColumnHeading>,
}

impl NamedColumns<'_> {
    fn find(&self, is: impl Fn(usize) -> bool) -> Vec<usize> {
        (0..self.headings.len()).filter(|column| is(*column)).collect()
    }

    /// The time: the only column that is named so, or the only one of these that says its unit; otherwise t.
    fn time(&self) -> Role<(usize, Option<&'static str>)> {
        let unit = |column: usize| match self.looked.columns[column].has_times() {
            true => Some("iso8601"),
            false => unit::of_time(&self.headings[column].name),
        };
        let is_time = |column: usize| self.looked.columns[column].has_times() || self.headings[column].is_time();
        let mut found = self.find(is_time);
        if found.is_empty() {
            found = self.find(|column| self.headings[column].is_t());
        }
        let said: Vec<_> = found.iter().copied().filter(|column| unit(*column).is_some()).collect();
        match (&found[..], &said[..]) {
            (_, [column]) | ([column], _) => Role::Known((*column, unit(*column))),
            ([], _) => Role::Absent,
            _ => Role::Open(found),
        }
    }

    /// Three sensors: the only columns of their axes 1, 2, 3.
    fn triad(&self, quantity: Quantity, axis_of: fn(&ColumnHeading) -> Option<usize>) -> Role<SensorRole> {
        let of_axis = [0, 1, 2].map(|axis| self.find(|column| axis_of(&self.headings[column]) == Some(axis)));
        match of_axis.each_ref().map(Vec::as_slice) {
            [[x], [y], [z]] => Role::Known(self.sensors(quantity, [*x, *y, *z])),
            axes if axes.iter().any(|columns| columns.is_empty()) => Role::Absent,
            _ => Role::Open(self.find(|column| axis_of(&self.headings[column]).is_some())),
        }
    }

    fn sensors(&self, quantity: Quantity, columns: [usize; AXES]) -> SensorRole {
        let all = columns.map(|column| &self.looked.columns[column]);
        let is_whole = all.iter().all(|column| column.is_whole());
        let numbers = match quantity.of_triad(all.map(|column| column.name.as_str())) {
            UnitWord::Unit(unit) => ColumnNumbers::Unit(unit.name, unit.resolution()),
            UnitWord::Unknown(text) => ColumnNumbers::Unsaid(Some(text)),
            UnitWord::Nothing if is_whole => ColumnNumbers::Whole,
            UnitWord::Nothing => ColumnNumbers::Unsaid(None),
        };
        let is_unsigned = matches!(numbers, ColumnNumbers::Whole) && all.iter().all(|column| column.is_around_32768());
        SensorRole { columns, numbers, offset: is_unsigned.then_some("\"?\""), duration: None }
    }

    /// The temperature: the only column that is named so, but for those of other things than the IMU; or one of the
    /// accelerometers and one of the gyroscopes.
    fn temperature(&self, taken: impl Fn(usize) -> bool, has_gyroscopes: bool) -> Role<Vec<usize>> {
        let all = self.find(|column| {
            !taken(column) && self.headings[column].is_temperature() && self.looked.columns[column].is_numeric()
        });
        let own: Vec<_> = all.iter().copied().filter(|column| !self.headings[*column].is_of_another()).collect();
        let is_of = |column: usize, quantity| self.headings[column].is_of(quantity);
        match own[..] {
            [one] => Role::Known(vec![one]),
            [a, g] if has_gyroscopes && is_of(a, Quantity::Acceleration) && is_of(g, Quantity::Rate) => {
                Role::Known(vec![a, a, a, g, g, g])
            }
            [] if all.is_empty() => Role::Absent,
            _ => Role::Open(all),
        }
    }
}
