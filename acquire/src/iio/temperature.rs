//! Temperatures: numbers of a scan, or attributes that are polled.

use std::fs::File;
use std::io;
use std::path::PathBuf;

use super::device::{Device, devices};
use super::error::{IioError, IioFault};
use super::scale::scale;
use super::sysfs::Folder;

/// IIO's unit of temperature, in degC.
const MILLI: f64 = 1e-3;

/// Where a temperature comes from.
pub(super) enum Temperature {
    /// A number of the scan: its place among the numbers.
    Scanned { slot: usize, scale: f64, offset: f64 },
    /// An attribute that is read from time to time.
    Polled(PolledTemperature),
}

impl Temperature {
    /// A number of the scan.
    pub(super) fn scanned(folder: &Folder, channel: &str, slot: usize) -> Result<Self, IioError> {
        let scale = scale(folder, channel)?;
        Ok(Self::Scanned { slot, scale: scale.scale, offset: scale.offset })
    }
}

/// A temperature that is polled.
pub(super) struct PolledTemperature {
    file: File,
    path: PathBuf,
    phase: String,
    scale: f64,
    offset: f64,
}

impl PolledTemperature {
    /// The attribute `in_CHANNEL_input` or `in_CHANNEL_raw`.
    pub(super) fn open(device: &Device, channel: &str) -> Result<Self, IioError> {
        let folder = &device.folder;
        let is_input = folder.has(&format!("in_{channel}_input"));
        let path = folder.path.join(format!("in_{channel}_{}", if is_input { "input" } else { "raw" }));
        let phase = folder.phase(&format!("reading the temperature {channel}"));
        let file = File::open(&path).map_err(|error| IioError::io(&phase, &path, &error))?;
        let (scale, offset) = if is_input {
            (1.0, 0.0)
        } else {
            let scale = scale(folder, channel)?;
            (scale.scale, scale.offset)
        };
        Ok(Self { file, path, phase, scale, offset })
    }

    /// The temperature now \[degC\].
    pub(super) fn read(&self) -> io::Result<f64> {
        let mut bytes = [0; 64];
        // From the start each time: sysfs then asks the driver again.
        let length = rustix::io::pread(&self.file, &mut bytes, 0)?;
        let text = bytes.get(..length).and_then(|bytes| std::str::from_utf8(bytes).ok()).unwrap_or_default();
        let number: f64 = text.trim().parse().map_err(|_| io::Error::from(io::ErrorKind::InvalidData))?;
        Ok((number + self.offset) * self.scale * MILLI)
    }

    /// What the failure of a read says, before anything runs.
    pub(super) fn failed(&self, error: &io::Error) -> IioError {
        if error.kind() == io::ErrorKind::ResourceBusy {
            let cause = "the driver gives no temperature while its buffer runs";
            let remedy = "take [temperature] from another IIO device (DEVICE/CHANNEL), or give a constant";
            return IioError::new(IioFault::Description, &self.phase, cause, remedy);
        }
        IioError::io(&self.phase, &self.path, error)
    }
}

/// A scanned number as degC.
pub(super) fn celsius(raw: i64, scale: f64, offset: f64) -> f64 {
    (raw as f64 + offset) * scale * MILLI
}

/// Whether a device has this temperature as an attribute.
pub(super) fn has(device: &Device, channel: &str) -> bool {
    ["raw", "input"].iter().any(|ending| device.folder.has(&format!("in_{channel}_{ending}")))
}

/// All temperatures that there are, as `DEVICE/CHANNEL`, for a message.
pub(super) fn known(folder: &Folder) -> String {
    let mut known = Vec::new();
    for device in devices(folder.tree()) {
        let channels = device.folder.names().into_iter().filter_map(|file| {
            let name = file.strip_prefix("in_")?;
            let name = name.strip_suffix("_raw").or_else(|| name.strip_suffix("_input"))?;
            name.starts_with("temp").then(|| format!("{}/{name}", device.name))
        });
        known.extend(channels);
    }
    if known.is_empty() { "none".to_owned() } else { known.join(", ") }
}
