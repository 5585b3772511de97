//! What the header of a text says of units, compared with what the mapping says.

use super::columns::{ColumnRef, Kind, Sensors, Temperature};
use super::mapping::Mapping;
use super::unit::{Quantity, UnitWord, of_temperature};
use isotherm_shared::wire::AXES;

/// Gives the mapping the units that the header says and the mapping does not. `full` makes the name that the header has
/// of one in the mapping. Returns what that was, for notes.
///
/// # Errors
/// What the header and the mapping contradict each other in, with the key; a temperature in another unit than degC
/// without its scale and offset.
pub(super) fn apply(mapping: &mut Mapping, full: impl Fn(&str) -> Option<String>) -> Result<Vec<String>, String> {
    let mut notes = Vec::new();
    let all =
        [(Quantity::Acceleration, Some(&mut mapping.accelerometer)), (Quantity::Rate, mapping.gyroscope.as_mut())];
    for (quantity, sensors) in all {
        if let Some(sensors) = sensors.filter(|sensors| sensors.kind == Kind::Reading) {
            notes.extend(of_sensors(quantity, sensors, &full)?);
        }
    }
    let Temperature::Columns { head, linear: None, .. } = &mapping.temperature else { return Ok(notes) };
    for name in head.iter().filter_map(|column| full(name(column)?)) {
        let unit = of_temperature(&name).filter(|unit| unit.linear.scale != 1.0 || unit.linear.offset != 0.0);
        if let Some(unit) = unit {
            let [scale, offset] = [unit.linear.scale, unit.linear.offset];
            return Err(format!(
                "temperature.columns: the header says {} of {name}; give temperature.scale = {scale} and \
                 temperature.offset = {offset} in the mapping, which make degC of it, or scale = 1 to leave the \
                 numbers as they are",
                unit.name
            ));
        }
    }
    Ok(notes)
}

fn of_sensors(
    quantity: Quantity,
    sensors: &mut Sensors,
    full: impl Fn(&str) -> Option<String>,
) -> Result<Option<String>, String> {
    let section = quantity.section();
    let names: Vec<_> = sensors.columns.iter().filter_map(|column| full(name(column)?)).collect();
    let Ok(names) = <[String; AXES]>::try_from(names) else { return Ok(None) };
    let given = sensors.unit.map(|factor| (factor, quantity.named(factor)));
    match (quantity.of_triad(names.each_ref().map(String::as_str)), given) {
        (UnitWord::Unit(said), Some((_, Some(given)))) if said != given => Err(format!(
            "{section}.unit: the mapping says {}, but the header says {} ({}); correct {section}.unit, or give \
             {section}.scale in its place",
            given.name,
            said.name,
            names.join(", ")
        )),
        (UnitWord::Unit(said), None) => {
            sensors.unit = Some(said.factor);
            let is_default = said.factor == 1.0;
            Ok((!is_default).then(|| format!("{section}: the unit is {}, as the header says", said.name)))
        }
        (UnitWord::Unknown(text), None) if quantity.is_other(&text) => Err(format!(
            "{section}.columns: the header says {text} ({}), which is not a unit of the {section}; give its columns, \
             or {section}.unit",
            names.join(", ")
        )),
        _ => Ok(None),
    }
}

fn name(column: &ColumnRef) -> Option<&str> {
    match column {
        ColumnRef::Name(name) => Some(name),
        ColumnRef::Number(_) => None,
    }
}
