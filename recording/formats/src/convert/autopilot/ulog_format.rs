//! The definitions of a ULog file: names, types and places of the fields of a message.
//!
//! Source: PX4's page "ULog File Format". A definition is `name:type field;type[n] field;..`; a type may be the name of
//! another definition. Values are little-endian and not aligned: padding has fields of its own, `_padding..`, and at
//! the end of a message it is not written.

use isotherm_shared::wire::AXES;
use std::collections::HashMap;

/// Most bytes of all definitions together.
const MAX_TEXT: usize = 1 << 22;
/// Most types within each other.
const MAX_DEPTH: usize = 16;
/// Longest message \[bytes\].
const MAX_SIZE: usize = u16::MAX as usize;

/// All definitions.
#[derive(Default)]
pub(super) struct Formats {
    /// The fields of each name, as text.
    fields: HashMap<String, String>,
    text: usize,
}

/// Lengths of the data of a message: without the padding at its end, and with it.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Lengths {
    pub(super) least: usize,
    pub(super) most: usize,
}

/// Where `sensor_accel` and `sensor_gyro` have their values.
#[derive(Clone, Debug)]
pub(super) struct SensorLayout {
    timestamp: usize,
    sample: Option<usize>,
    device: Option<usize>,
    values: [Real; AXES],
    temperature: Option<Real>,
}

/// Where a message has its time, and a byte that says a state.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateLayout {
    timestamp: usize,
    state: usize,
}

/// A row of a sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct SensorRow {
    /// When it was sampled, or else when it was published \[us\].
    pub(super) time_us: u64,
    pub(super) device: Option<u32>,
    /// \[m/s2 or rad/s\]
    pub(super) values: [f64; AXES],
    /// \[degC\]
    pub(super) celsius: Option<f64>,
}

/// Place of a number.
#[derive(Clone, Copy, Debug)]
enum Real {
    Float(usize),
    Double(usize),
}

struct Field<'a> {
    name: &'a str,
    kind: &'a str,
    count: usize,
}

impl Formats {
    /// Takes a definition.
    ///
    /// # Errors
    /// If it is none, or if there are too many.
    pub(super) fn add(&mut self, definition: &[u8]) -> Result<(), String> {
        let text = str::from_utf8(definition).ok().and_then(|text| text.split_once(':'));
        let (name, fields) = text.ok_or("a definition without a name; the log is damaged")?;
        self.text += definition.len();
        if self.text > MAX_TEXT {
            return Err(format!("over {MAX_TEXT} bytes of definitions; the log is damaged"));
        }
        self.fields.insert(name.trim().to_owned(), fields.to_owned());
        Ok(())
    }

    /// The lengths of a message of this name.
    pub(super) fn lengths(&self, name: &str) -> Result<Lengths, String> {
        let (mut least, mut most) = (0, 0);
        for (field, _, end) in self.placed(name)? {
            most = end;
            if !field.name.starts_with("_padding") {
                least = end;
            }
        }
        Ok(Lengths { least, most })
    }

    /// Where a sensor of this name has its values.
    pub(super) fn sensor(&self, name: &str) -> Result<SensorLayout, String> {
        let placed = self.placed(name)?;
        let of = |wanted: &str, kinds: &[&str]| {
            let mut all = placed.iter().filter(|(field, ..)| field.name == wanted && field.count == 1);
            all.find(|(field, ..)| kinds.contains(&field.kind)).map(|(field, at, _)| (field.kind, *at))
        };
        let real = |wanted: &str| {
            let (kind, at) = of(wanted, &["float", "double"])?;
            Some(if kind == "float" { Real::Float(at) } else { Real::Double(at) })
        };
        let missing =
            |wanted: &str| format!("{name} has no {wanted} as the log defines it; is it of PX4, 1.9 or later?");
        let mut values = [Real::Float(0); AXES];
        for (value, axis) in values.iter_mut().zip(["x", "y", "z"]) {
            *value = real(axis).ok_or_else(|| missing(axis))?;
        }
        Ok(SensorLayout {
            timestamp: of("timestamp", &["uint64_t"]).ok_or_else(|| missing("timestamp"))?.1,
            sample: of("timestamp_sample", &["uint64_t"]).map(|(_, at)| at),
            device: of("device_id", &["uint32_t"]).map(|(_, at)| at),
            values,
            temperature: real("temperature"),
        })
    }

    /// Where a message of this name has its time and the byte of this name; `None` if it has none.
    pub(super) fn state(&self, name: &str, field: &str) -> Option<StateLayout> {
        let placed = self.placed(name).ok()?;
        let of = |wanted: &str, kinds: &[&str]| {
            let is_wanted = |of: &Field<'_>| of.name == wanted && of.count == 1 && kinds.contains(&of.kind);
            placed.iter().find(|(of, ..)| is_wanted(of)).map(|(_, at, _)| *at)
        };
        Some(StateLayout { timestamp: of("timestamp", &["uint64_t"])?, state: of(field, &["uint8_t", "bool"])? })
    }

    /// The fields of a message of this name, each with its first byte and the one behind it.
    fn placed<'a>(&'a self, name: &str) -> Result<Vec<(Field<'a>, usize, usize)>, String> {
        let fields = self.fields.get(name).ok_or_else(|| format!("no definition of {name}; the log is damaged"))?;
        let (mut placed, mut at) = (Vec::new(), 0);
        for field in split(fields) {
            let field = field?;
            let end = at + self.size(&field, MAX_DEPTH)?;
            if end > MAX_SIZE {
                return Err(format!("{name} has over {MAX_SIZE} bytes; the log is damaged"));
            }
            placed.push((field, at, end));
            at = end;
        }
        Ok(placed)
    }

    fn size(&self, field: &Field<'_>, depth: usize) -> Result<usize, String> {
        let one = match field.kind {
            "int8_t" | "uint8_t" | "bool" | "char" => 1,
            "int16_t" | "uint16_t" => 2,
            "int32_t" | "uint32_t" | "float" => 4,
            "int64_t" | "uint64_t" | "double" => 8,
            nested => {
                let fields = self.fields.get(nested).filter(|_| depth > 0);
                let fields = fields.ok_or_else(|| format!("no definition of {nested}; the log is damaged"))?;
                let mut sum = 0;
                for field in split(fields) {
                    sum += self.size(&field?, depth - 1)?;
                    if sum > MAX_SIZE {
                        return Err(format!("{nested} has over {MAX_SIZE} bytes; the log is damaged"));
                    }
                }
                // Without a byte, types within types could take for ever.
                sum.max(1)
            }
        };
        Ok(one * field.count)
    }
}

/// The fields of a definition.
fn split(fields: &str) -> impl Iterator<Item = Result<Field<'_>, String>> {
    fields.split(';').map(str::trim).filter(|field| !field.is_empty()).map(|text| {
        let wrong = || format!("the field {text:?} is no type and name; the log is damaged");
        let (kind, name) = text.split_once(' ').ok_or_else(wrong)?;
        let (kind, count) = match kind.split_once('[') {
            Some((kind, count)) => (kind, count.strip_suffix(']').and_then(|count| count.parse::<u16>().ok())),
            None => (kind, Some(1)),
        };
        Ok(Field { name: name.trim(), kind, count: count.ok_or_else(wrong)?.into() })
    })
}

impl SensorLayout {
    /// The row in the data of a message; `None` if they are too short.
    pub(super) fn row(&self, data: &[u8]) -> Option<SensorRow> {
        let time_us = match self.sample.map(|at| bytes(data, at).map(u64::from_le_bytes)) {
            Some(sample) if sample? > 0 => sample?,
            _ => u64::from_le_bytes(bytes(data, self.timestamp)?),
        };
        let device = match self.device {
            Some(at) => Some(u32::from_le_bytes(bytes(data, at)?)),
            None => None,
        };
        let mut values = [0.0; AXES];
        for (value, place) in values.iter_mut().zip(self.values) {
            *value = place.read(data)?;
        }
        let celsius = match self.temperature {
            Some(place) => Some(place.read(data)?),
            None => None,
        };
        Some(SensorRow { time_us, device, values, celsius })
    }
}

impl StateLayout {
    /// Time \[us\] and state in the data of a message; `None` if they are too short.
    pub(super) fn read(self, data: &[u8]) -> Option<(u64, u8)> {
        let [state] = bytes(data, self.state)?;
        Some((u64::from_le_bytes(bytes(data, self.timestamp)?), state))
    }
}

impl Real {
    fn read(self, data: &[u8]) -> Option<f64> {
        match self {
            Self::Float(at) => bytes(data, at).map(|bytes| f32::from_le_bytes(bytes).into()),
            Self::Double(at) => bytes(data, at).map(f64::from_le_bytes),
        }
    }
}

fn bytes<const N: usize>(data: &[u8], at: usize) -> Option<[u8; N]> {
    data.get(at..)?.first_chunk().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn formats(definitions: &[&str]) -> Formats {
        let mut formats = Formats::default();
        definitions.iter().for_each(|definition| formats.add(definition.as_bytes()).unwrap());
        formats
    }

    #[test]
    fn nested_types_arrays_and_padding_have_their_bytes() {
        let formats = formats(&[
            "inner:uint8_t a;uint16_t[3] b;",
            "middle:inner[2] i;double d;",
            "sensor_accel:middle m;char[5] name;uint64_t timestamp;uint8_t[2] _padding0;double x;float y;float z;\
             uint8_t[4] _padding1;",
        ]);
        // middle: 2 * (1 + 6) + 8 = 22; the name 5.
        assert_eq!(formats.lengths("sensor_accel"), Ok(Lengths { least: 53, most: 57 }));
        let layout = formats.sensor("sensor_accel").unwrap();
        let mut data = vec![0; 27];
        data.extend(7_u64.to_le_bytes());
        data.extend([0; 2]);
        data.extend(1.5_f64.to_le_bytes());
        data.extend([2.5_f32.to_le_bytes(), (-3.5_f32).to_le_bytes()].concat());
        let row = layout.row(&data).unwrap();
        assert_eq!((row.time_us, row.values, row.device, row.celsius), (7, [1.5, 2.5, -3.5], None, None));
        assert!(layout.row(&data[..data.len() - 1]).is_none());
    }

    #[test]
    fn wrong_definitions_are_refused() {
        let endless = formats(&["a:b b;", "b:a a;", "c:d d;", "e:uint8_t[65535] x;uint8_t y;", "f:g[9] x;", "g:;"]);
        assert!(endless.lengths("a").unwrap_err().contains("no definition of"));
        assert!(endless.lengths("c").unwrap_err().contains("no definition of d"));
        assert!(endless.lengths("e").unwrap_err().contains("over 65535 bytes"));
        assert_eq!(endless.lengths("f"), Ok(Lengths { least: 9, most: 9 }));
        // Each level has ten of the next one: 10^12 fields.
        let mut many = Formats::default();
        for level in 0..12 {
            let fields = format!("t{} x;", level + 1).repeat(10);
            many.add(format!("t{level}:{fields}").as_bytes()).unwrap();
        }
        many.add(b"t12:uint8_t x;").unwrap();
        assert!(many.lengths("t0").unwrap_err().contains("over 65535 bytes"));
        for wrong in ["x:float", "x:float[y] z;", "x:float[70000] z;", "x:float[2 z;"] {
            assert!(formats(&[wrong]).lengths("x").is_err(), "{wrong}");
        }
        assert!(Formats::default().add(b"no colon").is_err() && Formats::default().add(b"\xff:").is_err());
        let sensor = formats(&["sensor_gyro:uint64_t timestamp;float x;float y;"]).sensor("sensor_gyro").unwrap_err();
        assert!(sensor.contains("sensor_gyro has no z"), "{sensor}");
    }
}
