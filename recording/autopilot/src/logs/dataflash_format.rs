//! The definitions of a DataFlash log: names, types and places of the columns of a message.
//!
//! Source: ArduPilot's developer page "Logging" (types of columns), and the definitions in the logs themselves. A
//! definition has number, length with the header, name, a letter per column, and the names of the columns. Values are
//! little-endian and not aligned.

use isotherm_recording::steps;
use isotherm_shared::wire::AXES;

/// Length of the header of a binary message.
pub(super) const HEADER: usize = 3;
/// The number of definitions.
pub(super) const FMT: u8 = 0x80;
/// Length of a definition itself, with the header \[bytes\].
pub(super) const FMT_LENGTH: usize = 89;

/// Most columns of a message; a binary definition has 16 letters.
const MAX_COLUMNS: usize = 64;

/// How a message is built.
#[derive(Debug)]
pub(super) struct MessageFormat {
    pub(super) number: u8,
    /// With the header \[bytes\].
    pub(super) length: usize,
    pub(super) name: String,
    columns: Vec<MessageColumn>,
    /// Columns of the rows of an IMU.
    pub(super) imu: Option<ImuColumns>,
}

#[derive(Debug)]
struct MessageColumn {
    name: String,
    kind: u8,
    at: usize,
}

/// Which columns of a row are what.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImuColumns {
    /// The number of the IMU; without it, it is in the name.
    pub(super) instance: Option<usize>,
    pub(super) gyroscopes: [usize; AXES],
    pub(super) accelerometers: [usize; AXES],
    pub(super) temperature: Option<usize>,
    /// Whether gyroscopes and accelerometers are healthy.
    pub(super) health: [Option<usize>; 2],
}

/// What a message has behind its header.
#[derive(Clone, Copy, Debug)]
pub(super) enum Body<'a> {
    Binary(&'a [u8]),
    /// The fields, separated by commas.
    Text(&'a str),
}

impl MessageFormat {
    /// The definition of definitions, which every log has first.
    pub(super) fn of_definitions() -> Self {
        Self::new(FMT, FMT_LENGTH, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    }

    /// Of the letters and the names of its columns.
    pub(super) fn new(number: u8, length: usize, name: &str, letters: &str, names: &str) -> Self {
        let mut at = 0;
        let names = names.split(',').map(|name| name.trim().to_owned());
        let columns = letters.bytes().zip(names).take(MAX_COLUMNS).map(|(kind, name)| {
            steps::count(1);
            let column = MessageColumn { name, kind, at };
            at += size(kind);
            column
        });
        let columns = columns.collect();
        let mut format = Self { number, length, name: name.to_owned(), columns, imu: None };
        format.imu = if name.starts_with("IMU") { format.imu_columns() } else { None };
        format
    }

    /// The definition in a message; `None` if it is none.
    pub(super) fn read(definitions: &Self, body: Body<'_>) -> Option<Self> {
        let whole = |column| definitions.number(body, column).map(|number| number as usize);
        let (number, length) = (u8::try_from(whole(0)?).ok()?, whole(1)?);
        let text = |column| definitions.text(body, column);
        let names = match body {
            Body::Binary(_) => text(4)?,
            // The names of the columns are separated as the fields are.
            Body::Text(fields) => fields.splitn(5, ',').nth(4)?.to_owned(),
        };
        let (name, letters) = (text(2)?, text(3)?);
        (length >= HEADER).then(|| Self::new(number, length, &name, &letters, &names))
    }

    /// Of a message of which only the names of the columns are known.
    pub(super) fn of_names(name: &str, names: &[&str]) -> Self {
        let names = &names[..names.len().min(MAX_COLUMNS)];
        Self::new(0, HEADER, name, &"-".repeat(names.len()), &names.join(","))
    }

    /// The names of its columns.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|column| column.name.as_str())
    }

    /// The number of columns.
    pub(super) const fn width(&self) -> usize {
        self.columns.len()
    }

    /// The column of this name.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// A number in a message; `None` if it has none there.
    pub(super) fn number(&self, body: Body<'_>, column: usize) -> Option<f64> {
        let MessageColumn { kind, at, .. } = self.columns.get(column)?;
        match body {
            Body::Text(fields) => field(fields, column)?.parse().ok(),
            Body::Binary(bytes) => number(bytes.get(*at..)?, *kind),
        }
    }

    /// A text in a message.
    pub(super) fn text(&self, body: Body<'_>, column: usize) -> Option<String> {
        let MessageColumn { kind, at, .. } = self.columns.get(column)?;
        match body {
            Body::Text(fields) => field(fields, column).map(str::to_owned),
            Body::Binary(bytes) => {
                let bytes = bytes.get(*at..)?.get(..size(*kind))?;
                let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
                Some(String::from_utf8_lossy(&bytes[..end]).trim().to_owned())
            }
        }
    }

    /// The column of the time, and the microseconds of its unit.
    fn time(&self) -> Option<(usize, u64)> {
        match (self.column("TimeUS"), self.column("TimeMS")) {
            (Some(time), _) => Some((time, 1)),
            (None, time) => Some((time?, 1000)),
        }
    }

    /// The time of a message \[us\].
    pub(super) fn time_us(&self, body: Body<'_>) -> Option<u64> {
        let (column, unit) = self.time()?;
        Some((self.number(body, column)? as u64).saturating_mul(unit))
    }

    fn imu_columns(&self) -> Option<ImuColumns> {
        let three = |names: [&str; AXES]| {
            let [x, y, z] = names.map(|name| self.column(name));
            Some([x?, y?, z?])
        };
        self.time()?;
        Some(ImuColumns {
            instance: self.column("I"),
            gyroscopes: three(["GyrX", "GyrY", "GyrZ"])?,
            accelerometers: three(["AccX", "AccY", "AccZ"])?,
            // Before 3.5 it was `Temp`.
            temperature: self.column("T").or_else(|| self.column("Temp")),
            health: [["GH", "GyHlt"], ["AH", "AcHlt"]].map(|names| names.iter().find_map(|name| self.column(name))),
        })
    }
}

impl ImuColumns {
    /// Which IMU a row is of, from 0.
    pub(super) fn instance(&self, format: &MessageFormat, body: Body<'_>) -> Option<u8> {
        match self.instance {
            Some(column) => format.number(body, column).map(|number| number as u8),
            // Before instances had a column: IMU, IMU2, IMU3.
            None => match format.name.strip_prefix("IMU")? {
                "" => Some(0),
                number => number.parse::<u8>().ok()?.checked_sub(1),
            },
        }
    }
}

fn field(fields: &str, column: usize) -> Option<&str> {
    fields.split(',').nth(column).map(str::trim)
}

/// Length of a column \[bytes\].
const fn size(kind: u8) -> usize {
    match kind {
        b'b' | b'B' | b'M' => 1,
        b'h' | b'H' | b'c' | b'C' | b'g' => 2,
        b'i' | b'I' | b'f' | b'n' | b'e' | b'E' | b'L' => 4,
        b'd' | b'q' | b'Q' => 8,
        b'N' => 16,
        b'Z' | b'a' => 64,
        _ => 0,
    }
}

/// A number of a binary message. Letters of hundredths are those of their whole numbers.
fn number(bytes: &[u8], kind: u8) -> Option<f64> {
    Some(match kind {
        b'b' => f64::from(first::<1>(bytes)?[0].cast_signed()),
        b'B' | b'M' => f64::from(first::<1>(bytes)?[0]),
        b'h' => i16::from_le_bytes(first(bytes)?).into(),
        b'H' => u16::from_le_bytes(first(bytes)?).into(),
        b'c' => f64::from(i16::from_le_bytes(first(bytes)?)) / 100.0,
        b'C' => f64::from(u16::from_le_bytes(first(bytes)?)) / 100.0,
        b'i' | b'L' => i32::from_le_bytes(first(bytes)?).into(),
        b'I' => u32::from_le_bytes(first(bytes)?).into(),
        b'e' => f64::from(i32::from_le_bytes(first(bytes)?)) / 100.0,
        b'E' => f64::from(u32::from_le_bytes(first(bytes)?)) / 100.0,
        b'f' => f32::from_le_bytes(first(bytes)?).into(),
        b'd' => f64::from_le_bytes(first(bytes)?),
        b'q' => i64::from_le_bytes(first(bytes)?) as f64,
        b'Q' => u64::from_le_bytes(first(bytes)?) as f64,
        _ => return None,
    })
}

fn first<const N: usize>(bytes: &[u8]) -> Option<[u8; N]> {
    bytes.first_chunk().copied()
}
