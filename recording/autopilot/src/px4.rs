//! PX4's parameters by name, in the order of the files of its own tool.

use crate::autopilot::Autopilot;
use crate::firmware::Px4Triad;
use crate::lines::Lines;
use crate::number::shortest;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;

/// The first lines of a file.
pub(crate) const HEAD: &str =
    "# Sensor thermal compensation parameters\n#\n# Vehicle-Id Component-Id Name Value Type\n";

/// MAVLink's types of the fifth column.
const INT32: u8 = 6;
const FLOAT: u8 = 9;

const POWERS: usize = 4;

#[derive(Clone, Copy)]
enum Field {
    Id,
    Low,
    High,
    Reference,
    Power { k: usize, axis: usize },
}

/// The parameters of a triad, in order.
fn fields(kind: SensorKind) -> Vec<Field> {
    let power = |k, axis| Field::Power { k, axis };
    match kind {
        SensorKind::Accelerometer => {
            let powers = (0..AXES).flat_map(|axis| (0..POWERS).map(move |k| power(k, axis)));
            [Field::Id, Field::Low, Field::High, Field::Reference].into_iter().chain(powers).collect()
        }
        SensorKind::Gyroscope => {
            let powers = (0..POWERS).flat_map(|k| (0..AXES).map(move |axis| power(k, axis)));
            [Field::Id, Field::High, Field::Low, Field::Reference].into_iter().chain(powers).collect()
        }
    }
}

const fn letter(kind: SensorKind) -> char {
    match kind {
        SensorKind::Accelerometer => 'A',
        SensorKind::Gyroscope => 'G',
    }
}

fn name(kind: SensorKind, instance: u8, field: Field) -> String {
    let prefix = prefix(kind, instance);
    match field {
        Field::Id => format!("{prefix}ID"),
        Field::Low => format!("{prefix}TMIN"),
        Field::High => format!("{prefix}TMAX"),
        Field::Reference => format!("{prefix}TREF"),
        Field::Power { k, axis } => format!("{prefix}X{k}_{axis}"),
    }
}

fn prefix(kind: SensorKind, instance: u8) -> String {
    format!("TC_{}{instance}_", letter(kind))
}

/// The parameter that makes PX4 compensate all sensors of a kind.
pub(crate) fn enable(kind: SensorKind) -> String {
    format!("TC_{}_ENABLE", letter(kind))
}

/// The line of a file that sets it.
pub(crate) fn enable_line(kind: SensorKind) -> String {
    line(&enable(kind), "1", INT32)
}

fn line(name: &str, value: &str, kind: u8) -> String {
    format!("1\t1\t{name}\t{value}\t{kind}\n")
}

/// The first parameter of an axis that its bias comes from.
pub(crate) fn bias_name(kind: SensorKind, instance: u8, axis: usize) -> String {
    name(kind, instance, Field::Power { k: 0, axis })
}

/// The text of a file with these triads of one instance, each with its device.
pub(crate) fn write(triads: &[(SensorKind, Px4Triad)], instance: u8, devices: [u32; 2]) -> String {
    let mut text = HEAD.to_owned();
    for ((kind, triad), device) in triads.iter().zip(devices) {
        text += &enable_line(*kind);
        for field in fields(*kind) {
            let name = name(*kind, instance, field);
            let value = match field {
                Field::Id => {
                    text += &line(&name, &device.to_string(), INT32);
                    continue;
                }
                Field::Low => triad.range[0],
                Field::High => triad.range[1],
                Field::Reference => triad.reference,
                Field::Power { k, axis } => triad.coefficients[axis][k],
            };
            text += &line(&name, &shortest(value), FLOAT);
        }
    }
    text
}

/// Reads a triad of an instance. Accelerometers must be there; gyroscopes need not: `Some(None)`.
pub(crate) fn read(lines: &mut Lines<'_>, kind: SensorKind, instance: u8) -> Option<Option<Px4Triad>> {
    let id = name(kind, instance, Field::Id);
    let unused = lines.whole(&id).is_some_and(|id| id == 0.0);
    let absent = !lines.any(&prefix(kind, instance));
    if absent || unused {
        if kind == SensorKind::Gyroscope {
            return Some(None);
        }
        let why = if unused { "is 0: the instance is not used" } else { "missing: the file has not this instance" };
        let elsewhere = lines.elsewhere();
        lines
            .wrong(&id, format!("{why}; give another instance or file ({} was to be read){elsewhere}", Autopilot::Px4));
        return None;
    }
    let enable = enable(kind);
    if lines.whole(&enable).is_some_and(|enabled| enabled != 1.0) {
        lines.wrong(&enable, "is not 1: PX4 does not use these parameters; give 1 if it shall");
    }
    refuse_scale_factors(lines, kind, instance);
    // In whose line a missing one is reported.
    let names = fields(kind).into_iter().map(|field| name(kind, instance, field));
    let beside = names.into_iter().find(|name| lines.line(name).is_some()).unwrap_or_default();
    let of = |field| name(kind, instance, field);
    let range = lines.range(&of(Field::Low), &of(Field::High), &beside);
    let reference = lines.number(&of(Field::Reference), &beside);
    let powers = [0, 1, 2, 3].map(|k| lines.three([0, 1, 2].map(|axis| of(Field::Power { k, axis })), &beside));
    let [x0, x1, x2, x3] = powers;
    let (x0, x1, x2, x3) = (x0?, x1?, x2?, x3?);
    let coefficients = [0, 1, 2].map(|axis| [x0[axis], x1[axis], x2[axis], x3[axis]]);
    Some(Some(Px4Triad { range: range?, reference: reference?, coefficients }))
}

/// An older PX4 multiplies the corrected readings of each axis by a factor, which no table of biases has.
fn refuse_scale_factors(lines: &mut Lines<'_>, kind: SensorKind, instance: u8) {
    for axis in 0..AXES {
        let name = format!("{}SCL_{axis}", prefix(kind, instance));
        if let Some(factor) = lines.factor(&name).filter(|factor| *factor != 1.0) {
            lines.wrong(
                &name,
                format!(
                    "is {factor}: an older PX4 multiplies the readings by it, and a newer one does not have it; leave \
                     the line out for a newer one, or give 1 and multiply the scale factor of the vehicle's calibration"
                ),
            );
        }
    }
}
