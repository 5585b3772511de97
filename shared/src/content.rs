//! What a file has that is none of Isotherm's TOML files, recognised by how it begins. For a wrong file, the message
//! names the command that reads it.

/// The first bytes of PX4's logs, ULog.
pub const ULOG_MAGIC: &[u8] = b"ULog\x01\x12\x35";
/// What every message of ArduPilot's binary logs, DataFlash, begins with.
pub const DATAFLASH_MAGIC: [u8; 2] = [0xa3, 0x95];
/// The first bytes of a Parquet file.
pub const PARQUET_MAGIC: &[u8] = b"PAR1";
/// What makes a recording of a file in Parquet, for messages.
pub const READ_PARQUET: &str = "Parquet, which Python makes a recording of: import isotherm, pyarrow.parquet as pq; \
     isotherm.write_recording(\"NEW.mcap\", isotherm.from_arrow(pq.read_table(\"FILE\"))); save data of another program \
     as CSV: import pandas; pandas.read_parquet(\"FILE\").to_csv(\"NEW.csv\", index=False)";
/// What makes a file in Parquet of a recording, for messages.
pub const WRITE_PARQUET: &str = "Parquet is written by Python: import isotherm, pyarrow.parquet as pq; \
     pq.write_table(isotherm.to_arrow(isotherm.read_recording(\"FILE.mcap\")), \"FILE.parquet\")";
/// The first bytes of an MCAP file.
pub const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Columns that only recordings have. Two of them are enough, so that a header that is damaged is one.
const COLUMNS: [&str; 5] = ["recorded_ns", "session", "sequence", "timestamp_ns", "interval_ns"];
/// Lines of a text that are looked at.
const MOST_LINES: usize = 64;
/// So many parameters are no accident.
const FEW_PARAMETERS: usize = 3;

/// The content of a file.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum FileContent {
    /// A log of PX4.
    Ulog,
    /// A log of ArduPilot, binary or as text.
    DataFlash,
    /// A recording, or messages of ROS.
    Mcap,
    /// A recording.
    Parquet,
    /// A recording.
    Csv,
    /// Parameters of an autopilot.
    Parameters,
}

impl FileContent {
    /// What a file has that begins so; `None` if it is something else.
    #[must_use]
    pub fn of(beginning: &[u8]) -> Option<Self> {
        let magics = [
            (ULOG_MAGIC, Self::Ulog),
            (&DATAFLASH_MAGIC, Self::DataFlash),
            (MCAP_MAGIC, Self::Mcap),
            (PARQUET_MAGIC, Self::Parquet),
        ];
        if let Some((_, content)) = magics.iter().find(|(magic, _)| beginning.starts_with(magic)) {
            return Some(*content);
        }
        let text = beginning.strip_prefix(b"\xef\xbb\xbf").unwrap_or(beginning);
        if is_dataflash_text(text) {
            return Some(Self::DataFlash);
        }
        let first = text.split(|byte| *byte == b'\n').next().unwrap_or_default();
        let has = |name: &str| first.split(|byte| *byte == b',').any(|field| field.trim_ascii() == name.as_bytes());
        if COLUMNS.iter().filter(|name| has(name)).count() > 1 {
            return Some(Self::Csv);
        }
        let lines = text.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii);
        let lines = lines.filter(|line| !line.is_empty() && !line.starts_with(b"#"));
        let parameters = lines.take(MOST_LINES).filter(|line| is_parameter(line)).count();
        (parameters >= FEW_PARAMETERS).then_some(Self::Parameters)
    }

    /// Its name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ulog => "a log of PX4 (ULog)",
            Self::DataFlash => "a log of ArduPilot (DataFlash)",
            Self::Mcap => "a recording or messages of ROS (MCAP)",
            Self::Parquet => "a file in Parquet",
            Self::Csv => "a recording (CSV)",
            Self::Parameters => "parameters of an autopilot",
        }
    }

    /// Which commands read it, for messages. `file` is its path as the user gave it.
    #[must_use]
    pub fn readers(self, file: &str) -> String {
        match self {
            Self::Parameters => format!(
                "`isotherm import {file} --from px4|ardupilot --imu ID --interval S -o ID.toml` makes a table of them"
            ),
            Self::Parquet => READ_PARQUET.to_owned(),
            _ => format!(
                "`isotherm calibrate warm-up --imu ID {file} -o ID.toml` makes a table of a warm-up, \
                 `isotherm calibrate tumble` one of a tumble; replay, verify and noise read it, too, and a campaign file names it"
            ),
        }
    }
}

/// Whether a text is a log of ArduPilot: it begins with the definition of a message.
#[must_use]
pub fn is_dataflash_text(text: &[u8]) -> bool {
    text.trim_ascii_start().strip_prefix(b"FMT").is_some_and(|rest| rest.trim_ascii_start().starts_with(b","))
}

/// Whether a line is a parameter in one of the usual forms: `NAME VALUE`, or vehicle, component, name, value, type.
fn is_parameter(line: &[u8]) -> bool {
    let words = line.split(|byte| b" \t,=".contains(byte)).filter(|word| !word.is_empty());
    let mut words = words.skip_while(|word| word.iter().all(u8::is_ascii_digit));
    let is_name = |name: &[u8]| {
        let all = name.iter().all(|byte| byte.is_ascii_uppercase() || byte.is_ascii_digit() || *byte == b'_');
        all && name.contains(&b'_') && name[0].is_ascii_uppercase()
    };
    let is_value = |value: &[u8]| str::from_utf8(value).is_ok_and(|value| value.parse::<f64>().is_ok());
    words.next().is_some_and(is_name) && words.next().is_some_and(is_value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_by_how_they_begin() {
        for (beginning, content) in [
            (b"ULog\x01\x12\x35\x01".as_slice(), Some(FileContent::Ulog)),
            (b"\xa3\x95\x80\x80\x59", Some(FileContent::DataFlash)),
            (b"FMT, 128, 89, FMT, BBnNZ, Type,Length", Some(FileContent::DataFlash)),
            (b"\xef\xbb\xbfsequence,timestamp_ns,a1\n", Some(FileContent::Csv)),
            (b"# v\n1\t1\tTC_A0_ID\t3\t6\n1\t1\tCAL_X\t1\t6\n1\t1\tA_B\t-1e-5\t9\n", Some(FileContent::Parameters)),
            (b"FRAME_CLASS,1\r\nINS_TCAL1_TMIN,-17.6\r\nINS_TCAL1_TMAX,70\r\n", Some(FileContent::Parameters)),
            (b"FRAME_CLASS=1\nINS_TCAL1_TMIN=2\n", None),
            (b"format = 1\ngravity = 9.8\ninterval = 1\n[imu]\n", None),
            (b"t,x,y,z\n1,2,3,4\n", None),
            (b"", None),
            (b"\xff\xfe", None),
        ] {
            assert_eq!(FileContent::of(beginning), content, "{}", String::from_utf8_lossy(beginning));
        }
    }
}
