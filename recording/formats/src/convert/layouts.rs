//! What the columns of a text are, if it has one of the layouts that are known: the same columns, in the same units,
//! wherever they come from.

use super::looked::{LookedColumn, LookedTable, length};
use super::roles::{CELSIUS, ColumnRoles, Role, SensorRole};
use super::unit::{self, Quantity, UnitWord, without_brackets};
use isotherm_shared::wire::AXES;
use std::path::Path;

mod table;

pub(super) use table::Layout;
use table::{IMU_TK, LAYOUTS, PLAIN, UNNAMED_OPENLOG};

/// Lengths of the specific force \[m/s2\], of a sensor that need not be still, and with its bias.
const GRAVITY: std::ops::Range<f64> = 7.0..13.0;

/// The columns of a layout in a text, from 0.
struct LayoutColumns {
    time: (usize, &'static str),
    /// Those of accelerometers and gyroscopes.
    sensors: [Option<[usize; AXES]>; 2],
    /// Those of the times that these are sums over.
    durations: [Option<usize>; 2],
    temperature: Option<usize>,
}

/// The layout of a text, and what its columns are. `name` is that of its file.
///
/// # Errors
/// The reason why a text of a known layout has no accelerations, with the remedy.
pub(super) fn known(looked: &LookedTable, name: &Path) -> Result<Option<(&'static Layout, ColumnRoles)>, String> {
    let Some((layout, columns)) = (if looked.header { by_names(looked) } else { by_numbers(looked) }) else {
        return Ok(None);
    };
    let accelerometer = columns.sensors[0].map(|columns| of(looked, columns));
    if accelerometer.is_some_and(|columns| are_rates(layout, columns, name)) {
        return Err(format!(
            "a text as of {}: it has only rates; give the file of the accelerometers, and this one with \
             --gyroscope-file FILE",
            layout.name
        ));
    }
    let temperature = columns.temperature.map(|column| &looked.columns[column]);
    let is_credible = temperature.is_none_or(|column| column.median().is_some_and(|it| CELSIUS.contains(&it)));
    let fit = (0..2).all(|index| columns.sensors[index].is_none_or(|of| fits(looked, layout, index, of)));
    Ok((is_credible && fit).then(|| (layout, columns.roles(looked, layout))))
}

/// Names of columns as layouts have them.
fn bases(columns: &[LookedColumn]) -> Vec<String> {
    let base = |column: &LookedColumn| {
        let name = without_brackets(column.name.trim().trim_start_matches('#')).to_lowercase();
        name.split_whitespace().collect::<String>()
    };
    columns.iter().map(base).collect()
}

fn of(looked: &LookedTable, columns: [usize; AXES]) -> [&LookedColumn; AXES] {
    columns.map(|column| &looked.columns[column])
}

fn by_names(looked: &LookedTable) -> Option<(&'static Layout, LayoutColumns)> {
    let bases = bases(&looked.columns);
    let layout = LAYOUTS.iter().find(|layout| layout.fits(&bases))?;
    let place = |name: &str| bases.iter().position(|base| base == name);
    let triad = |[x, y, z]: [&str; AXES]| Some([place(x)?, place(y)?, place(z)?]);
    let time = layout.time.iter().find_map(|(column, unit)| Some((place(column)?, *unit)))?;
    let columns = LayoutColumns {
        time: (time.0, unit::of_time(&looked.columns[time.0].name).unwrap_or(time.1)),
        sensors: [triad(layout.accelerometer), layout.gyroscope.and_then(triad)],
        durations: layout.durations.map_or([None; 2], |durations| durations.map(place)),
        temperature: layout.temperature.iter().find_map(|column| place(column)),
    };
    Some((layout, columns))
}

/// Layouts whose rows show what they are.
fn by_numbers(looked: &LookedTable) -> Option<(&'static Layout, LayoutColumns)> {
    let columns = &looked.columns;
    // Rows may end in separators.
    let width = columns.iter().rposition(LookedColumn::is_numeric).map_or(0, |last| last + 1);
    let numeric = |from: usize| columns[from..width].iter().all(LookedColumn::is_numeric);
    if width == 13 && numeric(2) && columns[1].has_times() && !columns[0].is_numeric() {
        let sensors = [Some([2, 3, 4]), Some([5, 6, 7])];
        let time = (1, "iso8601");
        return Some((&UNNAMED_OPENLOG, LayoutColumns { time, sensors, durations: [None; 2], temperature: Some(11) }));
    }
    let are_counts = || columns[1..].iter().all(|column| column.values.iter().all(|value| value.fract() == 0.0));
    let rises = |values: &[f64]| values.windows(2).all(|pair| pair[0] <= pair[1]) && values.first() < values.last();
    let is_imu_tk = width == 4
        && columns.iter().all(|column| column.is_exponential)
        && numeric(0)
        && rises(&columns[0].values)
        && are_counts();
    let sensors = [Some([1, 2, 3]), None];
    is_imu_tk.then_some((&IMU_TK, LayoutColumns { time: (0, "s"), sensors, durations: [None; 2], temperature: None }))
}

/// Whether columns that are called x, y, z, or nothing, are those of gyroscopes: by the name of the file, otherwise by
/// their length.
fn are_rates(layout: &Layout, columns: [&LookedColumn; AXES], name: &Path) -> bool {
    let file = name.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
    let has_plain_names = layout.accelerometer == PLAIN.accelerometer;
    match (file.contains("gyr"), file.contains("acc")) {
        (true, false) => has_plain_names,
        (false, true) => false,
        _ => {
            let length = length(columns).filter(|_| has_plain_names && !layout.units[0].is_empty());
            length.is_some_and(|length| !GRAVITY.contains(&length))
        }
    }
}

/// Whether the numbers can be what the layout says, of accelerometers (0) or gyroscopes (1): a script may write the
/// names of a layout above numbers in another unit.
fn fits(looked: &LookedTable, layout: &Layout, index: usize, columns: [usize; AXES]) -> bool {
    let columns = of(looked, columns);
    let quantity = [Quantity::Acceleration, Quantity::Rate][index];
    let said = match looked.header {
        true => quantity.of_triad(columns.map(|column| column.name.as_str())),
        false => UnitWord::Nothing,
    };
    match (said, layout.units[index]) {
        (UnitWord::Nothing, "") => !looked.header || columns.iter().all(|column| column.is_whole()),
        (UnitWord::Nothing, _) if index == 1 || layout.durations.is_some() => true,
        (UnitWord::Nothing, unit) => {
            let factor = quantity.choices().into_iter().find(|(_, name)| *name == unit);
            let length = length(columns).zip(factor).map(|(length, (factor, _))| length * factor);
            length.is_none_or(|length| GRAVITY.contains(&length))
        }
        (UnitWord::Unit(said), unit) => said.name == unit,
        (UnitWord::Unknown(_), _) => false,
    }
}

impl LayoutColumns {
    fn roles(&self, looked: &LookedTable, layout: &Layout) -> ColumnRoles {
        let sensors = |index: usize| {
            let columns = self.sensors[index]?;
            let is_unsigned = of(looked, columns).iter().all(|column| column.is_around_32768());
            Some(SensorRole {
                columns,
                numbers: layout.numbers(index),
                offset: (layout.units[index].is_empty() && is_unsigned).then_some("32768"),
                duration: self.durations[index],
            })
        };
        ColumnRoles {
            time: Role::Known((self.time.0, Some(self.time.1))),
            sensors: [0, 1].map(|index| sensors(index).map_or(Role::Absent, Role::Known)),
            temperature: self.temperature.map_or(Role::Absent, |column| Role::Known(vec![column])),
        }
    }
}
