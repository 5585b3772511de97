//! What the logs of both autopilots have in common: their IMUs, and how a row becomes pulses.

use super::left_out::Flaw;
use super::settings::LogSettings;
use isotherm_recording::LogImu;
use isotherm_recording::foreign::Units;
use isotherm_recording::foreign::{ForeignRow, OpenData, pulses};
use isotherm_shared::readings::Resolution;
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure, shown};
use std::collections::BTreeMap;
use std::fmt;
use std::io::Read;
use std::path::Path;

/// One pulse of the accelerometers of a log \[m/s2\].
pub const LOG_ACCELERATION_PULSE: f64 = 1e-6;
/// One pulse of the gyroscopes of a log \[rad/s\].
pub const LOG_RATE_PULSE: f64 = 1e-7;

/// What helps where the accelerometers have no temperature.
pub(super) const NO_TEMPERATURE: &str = "take another IMU of the log with --instance; --temperature gives one for all rows, which is \
                              enough for noise, and not for curves over temperature";

/// An IMU of a log.
#[derive(Clone, Debug, Default)]
pub(super) struct ImuOfLog {
    pub(super) rows: u64,
    /// Device ids of accelerometers and gyroscopes, if the log has them.
    pub(super) devices: [Option<u32>; 2],
}

impl ImuOfLog {
    /// As the log names it.
    pub(super) fn named(&self, number: u8) -> LogImu {
        LogImu { instance: number.into(), devices: self.devices }
    }
}

/// An IMU that is in a log.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct FoundImu {
    /// Its names.
    pub imu: LogImu,
    /// Number of its rows.
    pub rows: u64,
}

/// `0 (device 3014666, 3500 rows)`.
impl fmt::Display for FoundImu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LogImu { instance, devices: [device, _] } = self.imu;
        let device = device.map_or("unknown device".to_owned(), |device| format!("device {device}"));
        write!(f, "{instance} ({device}, {} rows)", self.rows)
    }
}

/// The IMUs of a log, by their numbers.
pub(super) fn found(imus: &BTreeMap<u8, ImuOfLog>) -> Vec<FoundImu> {
    imus.iter().map(|(number, imu)| FoundImu { imu: imu.named(*number), rows: imu.rows }).collect()
}

/// What a log has of one instant: specific force \[m/s2\], angular rate \[rad/s\], temperature \[degC\] of both.
pub(super) struct Values {
    pub(super) acceleration: [f64; AXES],
    pub(super) rate: Option<[f64; AXES]>,
    pub(super) celsius: [f64; 2],
}

/// What the pulses of a log stand for.
pub(super) fn units() -> Units {
    let resolution = Resolution { accelerometer: LOG_ACCELERATION_PULSE, gyroscope: LOG_RATE_PULSE };
    Units { resolution, ..Units::default() }
}

/// Takes the bytes of a log, which are read twice.
pub(super) fn take(data: &mut OpenData<'_>) -> Result<Box<dyn Read>, Failure> {
    if !data.source.is_file() {
        let message = format!("{}: a log of an autopilot is read twice; give a file, not a stream", shown(data.name()));
        return Err(Failure::new(Exit::Usage, message));
    }
    Ok(data.take())
}

/// The IMU that is wanted, otherwise the only one, otherwise the preferred one, with its number in the log. There is
/// one at least.
pub(super) fn choose(
    path: &Path,
    imus: &BTreeMap<u8, ImuOfLog>,
    settings: &LogSettings,
) -> Result<(u8, ImuOfLog), Failure> {
    let is_preferred = |(number, imu): &(&u8, &ImuOfLog)| {
        settings.preferred.is_some_and(|preferred| !preferred.differs_from(&imu.named(**number)))
    };
    let found = match (settings.instance, imus.len()) {
        (Some(wanted), _) => imus.iter().find(|(number, _)| u32::from(**number) == wanted),
        (None, 1) => imus.iter().next(),
        (None, _) => imus.iter().find(is_preferred),
    };
    if let Some((number, imu)) = found {
        return Ok((*number, imu.clone()));
    }
    let problem = match settings.instance {
        Some(wanted) => format!("no IMU {wanted}; choose one with --instance"),
        None => "several IMUs; choose one with --instance".to_owned(),
    };
    let listed = found_listed(&self::found(imus));
    Err(Failure::new(Exit::Usage, format!("{}: {problem}: {listed}", shown(path))))
}

/// The IMUs of a log, for messages: `0 (device 3014666, 3500 rows), 1 (device 2621450, 3500 rows)`.
#[must_use]
pub fn found_listed(imus: &[FoundImu]) -> String {
    imus.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

impl Values {
    /// As a row. `temperature` stands for all temperatures, if it is given.
    ///
    /// # Errors
    /// What is wrong with the values.
    pub(super) fn reading(&self, place: u64, time_us: u64, temperature: Option<f64>) -> Result<ForeignRow, Flaw> {
        let timestamp_ns = Some(time_us.checked_mul(1000).ok_or(Flaw::Time)?);
        let mut reading = ForeignRow { place, timestamp_ns, ..ForeignRow::default() };
        let rate = self.rate.unwrap_or_default();
        let of = |values: [f64; AXES], pulse, celsius| values.map(|value| (value, pulse, celsius));
        let [acceleration, rate] =
            [of(self.acceleration, LOG_ACCELERATION_PULSE, self.celsius[0]), of(rate, LOG_RATE_PULSE, self.celsius[1])];
        for (index, (value, pulse, celsius)) in acceleration.into_iter().chain(rate).enumerate() {
            (reading.pulses[index], reading.rest[index]) = pulses(value, 0.0, pulse, 1.0).map_err(|_| Flaw::Value)?;
            let celsius = temperature.unwrap_or(celsius);
            if !celsius.is_finite() {
                return Err(Flaw::Temperature);
            }
            (reading.head[index], reading.board[index]) = (celsius, celsius);
        }
        Ok(reading)
    }
}
