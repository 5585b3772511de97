//! Data that are recognised and not converted, with the way to those that are.

use super::telemetry_log;
use isotherm_shared::content::{PARQUET_MAGIC, READ_PARQUET};

/// Why data that begin with these bytes are refused; `None` if they may be converted.
pub(super) fn reason(beginning: &[u8]) -> Option<String> {
    if beginning.trim_ascii().is_empty() {
        return Some("there are no data".to_owned());
    }
    let known = KNOWN.iter().find(|(magic, _)| beginning.starts_with(magic)).map(|(_, message)| *message);
    let known = known.map(|message| match message {
        ZIP if memchr::memmem::find(beginning, b".npy").is_some() => NPZ,
        _ => message,
    });
    known.map(str::to_owned).or_else(|| telemetry_log::reason(beginning))
}

/// What reads every text.
pub(super) const BY_PYTHON: &str = "read the text with pandas or polars, and give the frame to Python's \
     calibrate_warm_up, calibrate_tumble or noise: docs/your-data.md#in-python";
/// How data begin, and what they are, with the way to a format that is read.
const KNOWN: [(&[u8], &str); 27] = [
    (
        b"SQLite format 3\0",
        "a SQLite file, as rosbag2 writes with .db3; convert it to MCAP: ros2 bag convert -i IN.db3 -o TO_MCAP.yaml, \
         or rosbags-convert --src FOLDER --dst NEW --dst-storage mcap",
    ),
    (
        b"#ROSBAG V",
        "a bag of ROS 1; convert it to MCAP: mcap convert IN.bag OUT.mcap, or \
         rosbags-convert --src IN.bag --dst NEW --dst-storage mcap",
    ),
    (PARQUET_MAGIC, READ_PARQUET),
    (b"\xaa\x44\x12", BINARY_NOVATEL),
    (b"\xaa\x44\x13", BINARY_NOVATEL),
    (
        b"H Product:Blackbox",
        "a blackbox log of Betaflight, which has no temperatures: it shows nothing of an IMU over temperature",
    ),
    (
        b"$@",
        "SBF of Septentrio; make ASCII of its block ExtSensorMeas with SBF Converter of RxTools, and give a mapping",
    ),
    (
        b"\xff\x5a",
        "sbgECom of SBG Systems; make text of its IMU logs with sbgBasicLogger of the sbgECom library, and give a \
         mapping: sbgBasicLogger -i FILE -w --dir=FOLDER",
    ),
    (
        b"\xfa\xff",
        "messages of Xsens or Movella, as in an .mtb file; export them as ASCII with MT Manager or MT File Exporter, \
         and give a mapping",
    ),
    (
        b"$IMURAW\0",
        "an IMR file of Waypoint Inertial Explorer; behind a header of 512 bytes its rows are a time and six counts. \
         Make CSV of it, and give a mapping without header: python3 -c \"import numpy as n; n.savetxt('OUT.csv', \
         [(t, *v) for t, v in n.fromfile('IN.imr', [('t', '<f8'), ('v', '<i4', 6)], offset=512)], '%.9f', ',')\"",
    ),
    (
        b"MATLAB 5.0 MAT-file",
        "a MAT-file of MATLAB; save the variable as CSV, in MATLAB writematrix(NAME, 'OUT.csv'), or: \
         python3 -c \"import numpy as n, scipy.io as s; \
         n.savetxt('OUT.csv', s.loadmat('IN.mat')['NAME'], '%.17g', ',')\"",
    ),
    (
        b"MATLAB 7.3 MAT-file",
        "a MAT-file of MATLAB 7.3; save the variable as CSV, in MATLAB writematrix(NAME, 'OUT.csv'), or: \
         python3 -c \"import numpy as n, h5py; n.savetxt('OUT.csv', h5py.File('IN.mat')['NAME'][()].T, '%.17g', ',')\"",
    ),
    (
        b"\x89HDF\r\n\x1a\n",
        "HDF5; save the data set as CSV: python3 -c \"import numpy as n, h5py; n.savetxt('OUT.csv', \
         h5py.File('IN.h5')['NAME'][()], '%.17g', ',')\"",
    ),
    (
        b"\x93NUMPY",
        "an array of NumPy; save it as CSV: python3 -c \"import numpy as n; n.savetxt('OUT.csv', n.load('IN.npy'), \
         '%.17g', ',')\"",
    ),
    (b"\xd4\xc3\xb2\xa1", PCAP),
    (b"\xa1\xb2\xc3\xd4", PCAP),
    (b"\x4d\x3c\xb2\xa1", PCAP),
    (b"\xa1\xb2\x3c\x4d", PCAP),
    (b"\x0a\x0d\x0d\x0a", PCAP),
    (b"\x1f\x8b", "compressed with gzip; unpack it first: zcat FILE | isotherm convert - .."),
    (b"PK\x03\x04", ZIP),
    (b"\x28\xb5\x2f\xfd", "compressed with Zstandard; unpack it first: zstd -dc FILE | isotherm convert - .."),
    (b"\xfd7zXZ\0", "compressed with xz; unpack it first: xzcat FILE | isotherm convert - .."),
    (b"BZh", "compressed with bzip2; unpack it first: bzcat FILE | isotherm convert - .."),
    (b"\x04\x22\x4d\x18", "compressed with LZ4; unpack it first: lz4 -dc FILE | isotherm convert - .."),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive; unpack it first: 7z x FILE"),
    (b"Rar!\x1a\x07", "a RAR archive; unpack it first: unrar x FILE"),
];
const BINARY_NOVATEL: &str = "NovAtel logs in binary form; log RAWIMUSXA or convert them to ASCII with NovAtel Convert";
const ZIP: &str = "a ZIP archive or a spreadsheet; unpack it, or save it as CSV";
const NPZ: &str = "arrays of NumPy (.npz); save one as CSV: python3 -c \"import numpy as n; n.savetxt('OUT.csv', \
                   n.load('IN.npz')['NAME'], '%.17g', ',')\"";
const PCAP: &str = "packets of a network (pcap); the messages of the IMU are within them: convert them with the program \
                    of the sensor's maker, or list their bytes: tshark -r FILE -T fields -e frame.time_epoch -e data";
const UBX: &str =
    "UBX of u-blox; make CSV of its messages ESF-RAW or ESF-MEAS with pyubx2 (pip install pyubx2), and give a mapping";

/// Whether data have two messages of UBX that follow each other, as behind lines of NMEA.
fn is_ubx(beginning: &[u8]) -> bool {
    const MAGIC: [u8; 2] = [0xb5, 0x62];
    memchr::memmem::find_iter(beginning, &MAGIC).any(|at| {
        let length = beginning.get(at + 4..at + 6).map(|bytes| usize::from(u16::from_le_bytes([bytes[0], bytes[1]])));
        let next = length.and_then(|length| beginning.get(at + 8 + length..));
        next.is_some_and(|next| next.starts_with(&MAGIC) || at == 0 && next.is_empty())
    })
}

/// Lines with bytes that no text has may be this part of all, or one: they are spoilt.
const SPOILT: usize = 100;

/// Fewer lines are no text if one of them is spoilt.
const FEWEST_LINES: usize = 10;

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
        let lines = beginning.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty());
        let spoilt = lines.clone().filter(|line| line.iter().any(is_binary)).count();
        let lines = lines.count();
        if spoilt > (lines / SPOILT).max(1) || lines < FEWEST_LINES {
            if is_ubx(beginning) {
                return Some(UBX.to_owned());
            }
            let what = "a binary format that is not read; export it as text";
            return Some(format!("not text: byte 0x{:02x} at {at}; {what}", beginning[at]));
        }
    }
    let lines = beginning.trim_ascii_end();
    (lines.contains(&b'\r') && !beginning.contains(&b'\n')).then(|| {
        "its lines end with only a carriage return; make line feeds of them: tr '\\r' '\\n' <FILE | isotherm convert - .."
            .to_owned()
    })
}
