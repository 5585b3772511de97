//! Data that are recognised and not converted, with the way to those that are.

use isotherm_recording::columns::PARQUET_MAGIC;

/// Why data that begin with these bytes are refused; `None` if they may be converted.
pub(super) fn reason(beginning: &[u8]) -> Option<String> {
    const KNOWN: [(&[u8], &str); 8] = [
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
        (b"\x1f\x8b", "compressed with gzip; unpack it first: zcat FILE | isotherm convert - .."),
        (b"PK\x03\x04", "a ZIP archive or a spreadsheet; unpack it, or save it as CSV"),
        (b"\x28\xb5\x2f\xfd", "compressed with Zstandard; unpack it first: zstd -dc FILE | isotherm convert - .."),
    ];
    if beginning.trim_ascii().is_empty() {
        return Some("there are no data".to_owned());
    }
    KNOWN.iter().find(|(magic, _)| beginning.starts_with(magic)).map(|(_, message)| (*message).to_owned())
}

const BINARY_NOVATEL: &str = "NovAtel logs in binary form; log RAWIMUSXA or convert them to ASCII with NovAtel Convert";
