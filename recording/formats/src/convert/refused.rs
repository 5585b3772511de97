//! Data that are recognised and not converted, with the way to those that are.

use super::telemetry_log;
use isotherm_recording::columns::PARQUET_MAGIC;

/// Why data that begin with these bytes are refused; `None` if they may be converted.
pub(super) fn reason(beginning: &[u8]) -> Option<String> {
    const KNOWN: [(&[u8], &str); 9] = [
        (
            b"SQLite format 3\0",
            "a SQLite file, as rosbag2 writes with .db3; convert it to MCAP: ros2 bag convert -i IN.db3 -o TO_MCAP.yaml, \
             or rosbags-convert --src FOLDER --dst NEW --dst-storage mcap",
        ),
        (
            b"#ROSBAG V",
            "a bag of ROS 1; convert it to MCAP: mcap convert IN.bag OUT.mcap, or rosbags-convert --src IN.bag --dst NEW --dst-storage mcap",
        ),
        (
            PARQUET_MAGIC,
            "Parquet; if it is a recording of Isotherm, every command reads it as it is; else save it as CSV",
        ),
        (b"\xaa\x44\x12", BINARY_NOVATEL),
        (b"\xaa\x44\x13", BINARY_NOVATEL),
        (
            b"H Product:Blackbox",
            "a blackbox log of Betaflight, which has no temperatures: it shows nothing of an IMU over temperature",
        ),
        (b"\x1f\x8b", "compressed with gzip; unpack it first: zcat FILE | isotherm convert - .."),
        (b"PK\x03\x04", "a ZIP archive or a spreadsheet; unpack it, or save it as CSV"),
        (b"\x28\xb5\x2f\xfd", "compressed with Zstandard; unpack it first: zstd -dc FILE | isotherm convert - .."),
    ];
    if beginning.trim_ascii().is_empty() {
        return Some("there are no data".to_owned());
    }
    let known = KNOWN.iter().find(|(magic, _)| beginning.starts_with(magic)).map(|(_, message)| (*message).to_owned());
    known.or_else(|| telemetry_log::reason(beginning))
}

/// Why data of no known format are no lines of text; `None` if they may be.
pub(super) fn no_text(beginning: &[u8]) -> Option<String> {
    const UTF_16: &str = "a text in UTF-16; save it as UTF-8: iconv -f UTF-16 -t UTF-8 FILE | isotherm convert - ..";
    let zeros = |odd: usize| {
        let bytes = beginning.iter().skip(odd).step_by(2).take(64);
        bytes.clone().count() > 3 && bytes.clone().all(|byte| *byte == 0)
    };
    let is_marked = beginning.starts_with(b"\xff\xfe") || beginning.starts_with(b"\xfe\xff");
    // Letters and digits of UTF-16 have every second byte 0.
    if is_marked || zeros(0) != zeros(1) {
        return Some(UTF_16.to_owned());
    }
    // Tabulators, line ends, form feeds and the sequences of terminals are in texts.
    let is_binary = |byte: &u8| *byte < b' ' && !b"\t\n\x0b\x0c\r\x1b".contains(byte);
    if let Some(at) = beginning.iter().position(is_binary) {
        let what = "a binary format that is not read; export it as text";
        return Some(format!("not text: byte 0x{:02x} at {at}; {what}", beginning[at]));
    }
    let lines = beginning.trim_ascii_end();
    (lines.contains(&b'\r') && !beginning.contains(&b'\n')).then(|| {
        "its lines end with a carriage return alone; make line feeds of them: tr '\\r' '\\n' <FILE | isotherm convert - .."
            .to_owned()
    })
}

const BINARY_NOVATEL: &str = "NovAtel logs in binary form; log RAWIMUSXA or convert them to ASCII with NovAtel Convert";
