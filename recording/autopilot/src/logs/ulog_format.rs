//! The definitions of a ULog file: names, types and places of the fields of a message.
//!
//! Source: PX4's page "ULog File Format". A definition is `name:type field;type[n] field;..`; a type may be the name of
//! another definition. Values are little-endian and not aligned: padding has fields of its own, `_padding..`, and at
//! the end of a message it is not written.

//!
//! Each field is resolved once, however many types have its type: what is known of a definition is kept, and goes on
//! from the first field whose type has not been defined yet.

use isotherm_recording::steps;
use isotherm_shared::wire::AXES;
use std::collections::HashMap;

/// Most bytes of all definitions together.
const MAX_TEXT: usize = 1 << 22;
/// Most types within each other.
const MAX_DEPTH: usize = 16;
/// Most fields of a definition. PX4's longest have a few hundred.
const MAX_FIELDS: usize = 4096;
/// Longest name, and longest field \[bytes\].
const MAX_NAME: usize = 256;
const MAX_FIELD: usize = 1024;
/// Longest message \[bytes\].
const MAX_SIZE: usize = u16::MAX as usize;

/// All definitions.
#[derive(Default)]
pub(super) struct Formats {
    definitions: HashMap<String, Definition>,
    text: usize,
    /// What was found of the topics that concern a conversion.
    sensors: HashMap<String, Result<SensorLayout, String>>,
    states: HashMap<String, Option<StateLayout>>,
}

/// A definition, as far as it is resolved.
#[derive(Clone, Default)]
struct Definition {
    /// Its fields.
    text: String,
    /// Bytes of the text that are resolved, and the fields in them.
    passed: usize,
    fields: usize,
    /// The lengths of these fields.
    lengths: FieldLengths,
    /// Whether it is being resolved.
    is_open: bool,
}

/// Why a definition is not taken.
#[derive(Debug)]
pub(super) enum WrongDefinition {
    /// It is none.
    None,
    /// There are too many.
    TooMany(String),
}

/// Lengths of the data of a message: without the padding at its end, and with it.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(super) struct FieldLengths {
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
    /// When it was sampled, otherwise when it was published \[us\].
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

struct UlogField<'a> {
    name: &'a str,
    kind: &'a str,
    count: usize,
}

/// A field, and its first byte in a message.
struct FieldPlace<'a> {
    field: UlogField<'a>,
    at: usize,
}

impl Formats {
    /// Takes a definition.
    ///
    /// # Errors
    /// If it is none, or another one of a name that has one; if there are too many.
    pub(super) fn add(&mut self, definition: &[u8]) -> Result<(), WrongDefinition> {
        let text = str::from_utf8(definition).ok().and_then(|text| text.split_once(':'));
        let (name, fields) = text.filter(|(name, _)| name.len() <= MAX_NAME).ok_or(WrongDefinition::None)?;
        match self.definitions.get(name.trim()) {
            Some(known) if known.text == fields => return Ok(()),
            Some(_) => return Err(WrongDefinition::None),
            None => {}
        }
        self.text += definition.len();
        if self.text > MAX_TEXT {
            let message = format!("over {MAX_TEXT} bytes of definitions; the log is damaged");
            return Err(WrongDefinition::TooMany(message));
        }
        let definition = Definition { text: fields.to_owned(), ..Definition::default() };
        self.definitions.insert(name.trim().to_owned(), definition);
        Ok(())
    }

    /// The lengths of a message of this name.
    pub(super) fn lengths(&mut self, name: &str) -> Result<FieldLengths, String> {
        self.resolve(name, MAX_DEPTH)
    }

    /// Where a sensor of this name has its values.
    pub(super) fn sensor(&mut self, name: &str) -> Result<SensorLayout, String> {
        if let Some(known) = self.sensors.get(name) {
            return known.clone();
        }
        self.lengths(name)?;
        let layout = SensorLayout::of(name, &self.placed(name)?);
        self.sensors.insert(name.to_owned(), layout.clone());
        layout
    }

    /// Where a message of this name has its time and the byte of this name; `None` if it has none.
    pub(super) fn state(&mut self, name: &str, field: &str) -> Option<StateLayout> {
        if let Some(known) = self.states.get(name) {
            return *known;
        }
        self.lengths(name).ok()?;
        let layout = StateLayout::of(&self.placed(name).ok()?, field);
        self.states.insert(name.to_owned(), layout);
        layout
    }

    /// The fields of a message of this name, whose types are resolved, each with its first byte.
    fn placed<'a>(&'a self, name: &str) -> Result<Vec<FieldPlace<'a>>, String> {
        let (mut placed, mut at) = (Vec::new(), 0);
        for field in split(self.definitions.get(name).map_or("", |definition| &definition.text)) {
            steps::count(1);
            let field = field?;
            let nested = || self.definitions.get(field.kind).map_or(0, Definition::size);
            let length = basic(field.kind).unwrap_or_else(nested) * field.count;
            placed.push(FieldPlace { field, at });
            at += length;
        }
        Ok(placed)
    }

    /// Resolves the fields of a definition that are not yet, and those of its types. `depth`: types that may be within
    /// each other.
    fn resolve(&mut self, name: &str, depth: usize) -> Result<FieldLengths, String> {
        let missing = || format!("no definition of {name}; the log is damaged");
        let known = self.definitions.get_mut(name).ok_or_else(missing)?;
        if known.passed == known.text.len() && !known.is_open {
            return Ok(known.lengths);
        }
        if depth == 0 || known.is_open {
            return Err(format!("{name} is within itself, or within over {MAX_DEPTH} types; the log is damaged"));
        }
        let open = Definition { is_open: true, ..Definition::default() };
        let mut definition = std::mem::replace(known, open);
        let resolved = self.go_on(name, &mut definition, depth);
        let lengths = definition.lengths;
        if let Some(known) = self.definitions.get_mut(name) {
            *known = definition;
        }
        resolved.map(|()| lengths)
    }

    /// Resolves the fields that are left.
    fn go_on(&mut self, name: &str, definition: &mut Definition, depth: usize) -> Result<(), String> {
        let Definition { text, passed, fields, lengths, .. } = definition;
        while *passed < text.len() {
            steps::count(1);
            let rest = &text[*passed..];
            let end = rest.bytes().take(MAX_FIELD).position(|byte| byte == b';').map_or(rest.len(), |at| at + 1);
            if end > MAX_FIELD {
                return Err(format!("{name} has a field of over {MAX_FIELD} bytes; the log is damaged"));
            }
            if let Some(field) = split(&rest[..end]).next() {
                let field = field?;
                let one = match basic(field.kind) {
                    Some(size) => size,
                    None => {
                        self.resolve(field.kind, depth - 1)?;
                        self.definitions.get(field.kind).map_or(0, Definition::size)
                    }
                };
                *fields += 1;
                let most = lengths.most + one * field.count;
                if most > MAX_SIZE || *fields > MAX_FIELDS {
                    return Err(format!(
                        "{name} has over {MAX_SIZE} bytes, or over {MAX_FIELDS} fields; the log is damaged"
                    ));
                }
                lengths.most = most;
                if !field.name.starts_with("_padding") {
                    lengths.least = most;
                }
            }
            *passed += end;
        }
        Ok(())
    }
}

impl Definition {
    /// Its bytes as those of a field. Without a byte, types within types could take for ever.
    fn size(&self) -> usize {
        self.lengths.most.max(1)
    }
}

/// The bytes of a type that needs no definition.
fn basic(kind: &str) -> Option<usize> {
    match kind {
        "int8_t" | "uint8_t" | "bool" | "char" => Some(1),
        "int16_t" | "uint16_t" => Some(2),
        "int32_t" | "uint32_t" | "float" => Some(4),
        "int64_t" | "uint64_t" | "double" => Some(8),
        _ => None,
    }
}

/// The fields of a definition.
fn split(fields: &str) -> impl Iterator<Item = Result<UlogField<'_>, String>> {
    fields.split(';').map(str::trim).filter(|field| !field.is_empty()).map(|text| {
        let wrong = || format!("the field {text:?} is not a type and a name; the log is damaged");
        let (kind, name) = text.split_once(' ').ok_or_else(wrong)?;
        let (kind, count) = match kind.split_once('[') {
            Some((kind, count)) => (kind, count.strip_suffix(']').and_then(|count| count.parse::<u16>().ok())),
            None => (kind, Some(1)),
        };
        Ok(UlogField { name: name.trim(), kind, count: count.ok_or_else(wrong)?.into() })
    })
}

/// The first of the fields with this name and one of these types: its type and its place.
fn single<'a>(placed: &[FieldPlace<'a>], name: &str, kinds: &[&str]) -> Option<(&'a str, usize)> {
    let mut all = placed.iter().filter(|placed| placed.field.name == name && placed.field.count == 1);
    all.find(|placed| kinds.contains(&placed.field.kind)).map(|placed| (placed.field.kind, placed.at))
}

impl SensorLayout {
    fn of(name: &str, placed: &[FieldPlace<'_>]) -> Result<Self, String> {
        let of = |wanted: &str, kind: &str| single(placed, wanted, &[kind]).map(|(_, at)| at);
        let real = |wanted: &str| {
            let (kind, at) = single(placed, wanted, &["float", "double"])?;
            Some(if kind == "float" { Real::Float(at) } else { Real::Double(at) })
        };
        let missing =
            |wanted: &str| format!("{name} has no {wanted} as the log defines it; is it of PX4, 1.9 or later?");
        let mut values = [Real::Float(0); AXES];
        for (value, axis) in values.iter_mut().zip(["x", "y", "z"]) {
            *value = real(axis).ok_or_else(|| missing(axis))?;
        }
        Ok(Self {
            timestamp: of("timestamp", "uint64_t").ok_or_else(|| missing("timestamp"))?,
            sample: of("timestamp_sample", "uint64_t"),
            device: of("device_id", "uint32_t"),
            values,
            temperature: real("temperature"),
        })
    }

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
    fn of(placed: &[FieldPlace<'_>], field: &str) -> Option<Self> {
        let (_, timestamp) = single(placed, "timestamp", &["uint64_t"])?;
        let (_, state) = single(placed, field, &["uint8_t", "bool"])?;
        Some(Self { timestamp, state })
    }

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
        let mut formats = formats(&[
            "inner:uint8_t a;uint16_t[3] b;",
            "middle:inner[2] i;double d;",
            "sensor_accel:middle m;char[5] name;uint64_t timestamp;uint8_t[2] _padding0;double x;float y;float z;\
             uint8_t[4] _padding1;",
        ]);
        // middle: 2 * (1 + 6) + 8 = 22; the name 5.
        assert_eq!(formats.lengths("sensor_accel"), Ok(FieldLengths { least: 53, most: 57 }));
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
        let mut endless = formats(&["a:b b;", "b:a a;", "c:d d;", "e:uint8_t[65535] x;uint8_t y;", "f:g[9] x;", "g:;"]);
        assert!(endless.lengths("a").unwrap_err().contains("a is within itself"));
        assert!(endless.lengths("c").unwrap_err().contains("no definition of d"));
        assert!(endless.lengths("e").unwrap_err().contains("over 65535 bytes"));
        assert_eq!(endless.lengths("f"), Ok(FieldLengths { least: 9, most: 9 }));
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
        let mut twice = formats(&["x:float a;", "x:float a;"]);
        assert!(twice.add(b"x:double a;").is_err());
        assert_eq!(twice.lengths("x"), Ok(FieldLengths { least: 4, most: 4 }));
        let name = "n".repeat(MAX_NAME + 1);
        assert!(twice.add(format!("{name}:float a;").as_bytes()).is_err());
        assert!(formats(&[&format!("x:{name}{name}{name}{name} a;")]).lengths("x").unwrap_err().contains("over 1024"));
        let many = "uint8_t[0] x;".repeat(MAX_FIELDS + 1);
        assert!(formats(&[&format!("x:{many}")]).lengths("x").unwrap_err().contains("over 4096 fields"));
    }

    /// What a definition lacked before is found once it is there.
    #[test]
    fn a_type_may_be_defined_behind_its_use() {
        let mut formats = formats(&["x:uint8_t a;inner b;uint8_t c;"]);
        for _ in 0..3 {
            assert!(formats.lengths("x").unwrap_err().contains("no definition of inner"));
        }
        formats.add(b"inner:float a;").unwrap();
        assert_eq!(formats.lengths("x"), Ok(FieldLengths { least: 6, most: 6 }));
    }

    /// The steps that it takes to ask as often for the lengths of a type as there are bytes of definitions.
    fn steps_of(mut formats: Formats, name: &str, more: impl Fn(usize) -> Option<String>) -> (u64, usize) {
        let begun = steps::taken();
        for asked in 0..formats.text {
            let _ = (formats.lengths(name), formats.sensor(name), formats.state(name, "armed"));
            more(asked).into_iter().for_each(|definition| formats.add(definition.as_bytes()).unwrap());
        }
        (steps::taken() - begun, formats.text)
    }

    /// A hundred fields of each type within the next one, as deep as may be; fields of one byte; fields whose types
    /// are defined one after the other, each before the next question.
    #[test]
    fn each_field_is_resolved_once() {
        let level = |level: usize| format!("t{level}:{}", format!("t{} x;", level + 1).repeat(100));
        let nested: Vec<String> = (0..12).map(level).chain(["t12:uint8_t[0] x;".to_owned()]).collect();
        let nested: Vec<&str> = nested.iter().map(String::as_str).collect();
        let wide = format!("sensor_accel:{}", "uint8_t x;".repeat(4000));
        let late = format!("x:{}", (0..1000).map(|at| format!("t{at} f;")).collect::<String>());
        let found = [
            steps_of(formats(&nested), "t0", |_| None),
            steps_of(formats(&[&wide]), "sensor_accel", |_| None),
            steps_of(formats(&[&late]), "x", |asked| (asked < 1000).then(|| format!("t{asked}:char c;"))),
        ];
        for (number, (steps, bytes)) in found.into_iter().enumerate() {
            let most = 4 * MAX_DEPTH * bytes;
            assert!(steps <= most as u64, "{number}: {steps} steps for {bytes} bytes, asked as often");
        }
    }
}
