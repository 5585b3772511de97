//! Writers of ULog and DataFlash, as far as tests need them.

use isotherm_files::source;
use isotherm_recording::foreign::VehicleState;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use tempfile::TempDir;

/// Definition of both sensors: 46 bytes, 7 of them padding at the end.
const SENSOR: &str = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;\
                      float temperature;uint8_t[3] clip_counter;uint8_t[7] _padding0;";

/// A ULog file that is being made.
pub(crate) struct Ulog {
    pub(crate) bytes: Vec<u8>,
}

impl Ulog {
    /// Header and flags.
    pub(crate) fn empty() -> Self {
        let mut log = Self { bytes: b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".to_vec() };
        log.message(b'B', &[0; 40]);
        log
    }

    /// With two IMUs; accelerometers have the numbers 0 and 1, gyroscopes 10 and 11.
    pub(crate) fn new() -> Self {
        let mut log = Self::empty();
        for (name, first) in [("sensor_accel", 0), ("sensor_gyro", 10)] {
            log.message(b'F', format!("{name}:{SENSOR}").as_bytes());
            for imu in [0, 1] {
                log.subscribe(imu, first + u16::from(imu), name);
            }
        }
        log
    }

    pub(crate) fn message(&mut self, kind: u8, body: &[u8]) -> &mut Self {
        self.bytes.extend((body.len() as u16).to_le_bytes());
        self.bytes.push(kind);
        self.bytes.extend(body);
        self
    }

    pub(crate) fn subscribe(&mut self, instance: u8, number: u16, name: &str) -> &mut Self {
        let [low, high] = number.to_le_bytes();
        self.message(b'A', &[&[instance, low, high], name.as_bytes()].concat())
    }

    pub(crate) fn accel(&mut self, imu: u8, time_us: u64, values: [f32; 3], celsius: f32) -> &mut Self {
        self.accel_of(imu, time_us, 1000 + u32::from(imu), values, celsius)
    }

    pub(crate) fn accel_of(&mut self, imu: u8, time_us: u64, device: u32, values: [f32; 3], celsius: f32) -> &mut Self {
        self.sensor(imu.into(), time_us, device, values, celsius)
    }

    pub(crate) fn gyro(&mut self, imu: u8, time_us: u64, values: [f32; 3], celsius: f32) -> &mut Self {
        self.sensor(10 + u16::from(imu), time_us, 2000 + u32::from(imu), values, celsius)
    }

    /// A row of both sensors of the first IMU.
    pub(crate) fn imu(&mut self, time_us: u64) -> &mut Self {
        self.accel(0, time_us, [0.5, -0.25, -9.5], 25.5).gyro(0, time_us, [0.125, 0.0, -0.5], 26.5)
    }

    /// A row, without the padding at its end. It was published 100 us after it was sampled.
    fn sensor(&mut self, number: u16, time_us: u64, device: u32, values: [f32; 3], celsius: f32) -> &mut Self {
        let mut body = number.to_le_bytes().to_vec();
        body.extend((time_us + 100).to_le_bytes());
        body.extend(time_us.to_le_bytes());
        body.extend(device.to_le_bytes());
        values.iter().chain([&celsius]).for_each(|value| body.extend(value.to_le_bytes()));
        body.extend([0; 3]);
        self.message(b'D', &body)
    }
}

/// Letters and names of the columns of `IMU`.
pub(crate) const IMU_FORMAT: &str = "QBffffffIIfBBHH";
pub(crate) const IMU_NAMES: &str = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz";

/// A row of `IMU`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImuRow {
    pub(crate) time_us: u64,
    pub(crate) instance: u8,
    pub(crate) rate: [f32; 3],
    pub(crate) acceleration: [f32; 3],
    pub(crate) celsius: f32,
    pub(crate) health: u8,
}

impl Default for ImuRow {
    fn default() -> Self {
        let (rate, acceleration) = ([0.125, 0.0, -0.5], [0.5, -0.25, -9.5]);
        Self { time_us: 0, instance: 0, rate, acceleration, celsius: 25.5, health: 1 }
    }
}

/// A DataFlash log that is being made, binary and as text.
pub(crate) struct Dataflash {
    pub(crate) bytes: Vec<u8>,
    pub(crate) text: String,
    numbers: BTreeMap<String, u8>,
}

impl Dataflash {
    pub(crate) fn new() -> Self {
        let mut log = Self { bytes: Vec::new(), text: String::new(), numbers: BTreeMap::new() };
        log.define(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns");
        log
    }

    fn define(&mut self, number: u8, length: u8, name: &str, letters: &str, names: &str) {
        self.bytes.extend([0xa3, 0x95, 128, number, length]);
        for (text, length) in [(name, 4), (letters, 16), (names, 64)] {
            self.bytes.extend(padded(text, length));
        }
        writeln!(self.text, "FMT, {number}, {length}, {name}, {letters}, {names}").unwrap();
    }

    /// A message of any name; the first one of a name defines it. IMU has 131, others what comes next.
    pub(crate) fn message(&mut self, name: &str, letters: &str, names: &str, values: &[&str]) -> &mut Self {
        let next = 140 + self.numbers.len() as u8;
        let body: Vec<_> = letters.bytes().zip(values).flat_map(|(letter, value)| binary(letter, value)).collect();
        let number = *self.numbers.entry(name.to_owned()).or_insert(if name == "IMU" { 131 } else { next });
        if number == next || (name == "IMU" && !self.text.contains("FMT, 131,")) {
            self.define(number, 3 + body.len() as u8, name, letters, names);
        }
        self.bytes.extend([0xa3, 0x95, number]);
        self.bytes.extend(body);
        writeln!(self.text, "{name}, {}", values.join(", ")).unwrap();
        self
    }

    pub(crate) fn parameter(&mut self, name: &str, value: f32) -> &mut Self {
        self.message("PARM", "QNff", "TimeUS,Name,Value,Default", &["7", name, &value.to_string(), "0"])
    }

    pub(crate) fn imu(&mut self, row: &ImuRow) -> &mut Self {
        let [time, instance] = [row.time_us.to_string(), row.instance.to_string()];
        let six: Vec<_> = row.rate.iter().chain(&row.acceleration).map(f32::to_string).collect();
        let [celsius, health] = [row.celsius.to_string(), row.health.to_string()];
        let six: [&str; 6] = core::array::from_fn(|index| six[index].as_str());
        let begin = [&[time.as_str(), &instance][..], &six].concat();
        let values = [&begin[..], &["0", "0", &celsius, &health, "1", "1000", "1000"]].concat();
        self.message("IMU", IMU_FORMAT, IMU_NAMES, &values)
    }
}

fn padded(text: &str, length: usize) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(length, 0);
    bytes
}

fn binary(letter: u8, value: &str) -> Vec<u8> {
    match letter {
        b'B' => value.parse::<u8>().unwrap().to_le_bytes().to_vec(),
        b'H' => value.parse::<u16>().unwrap().to_le_bytes().to_vec(),
        b'I' => value.parse::<u32>().unwrap().to_le_bytes().to_vec(),
        b'Q' => value.parse::<u64>().unwrap().to_le_bytes().to_vec(),
        b'f' => value.parse::<f32>().unwrap().to_le_bytes().to_vec(),
        b'N' => padded(value, 16),
        b'Z' => padded(value, 64),
        _ => panic!("{letter}"),
    }
}

/// The rows of a log, and in lines all that is reported.
pub(crate) fn convert(data: &[u8], extension: &str, settings: &Settings) -> Result<(Vec<RawSample>, String), Failure> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log").with_extension(extension);
    fs::write(&path, data).unwrap();
    let mut conversion = Conversion::open(&source(&path), None, settings)?;
    let samples = (&mut conversion).collect::<Result<Vec<_>, _>>()?;
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    Ok((samples, findings.chain(conversion.notes()).collect::<Vec<_>>().join("\n")))
}

pub(crate) fn converted(data: &[u8], extension: &str, settings: &Settings) -> (Vec<RawSample>, String) {
    convert(data, extension, settings).unwrap()
}

/// Why a log is refused.
pub(crate) fn refused(data: &[u8], extension: &str, settings: &Settings) -> (Exit, String) {
    let failure = convert(data, extension, settings).err().unwrap();
    (failure.exit, failure.message)
}

/// What the vehicle did, by the log.
pub(crate) fn vehicle_state(data: &[u8], extension: &str) -> VehicleState {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log").with_extension(extension);
    fs::write(&path, data).unwrap();
    Conversion::open(&source(&path), None, &Settings::default()).unwrap().vehicle_state()
}
