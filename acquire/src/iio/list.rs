//! What there is, for a user to choose from.

use std::path::Path;

use serde::Serialize;

use super::device::{Device, devices};
use super::error::{IioError, IioFault};
use super::rate::FREQUENCY;
use super::scale::scale;
use super::setup::Buffer;
use super::sysfs::Tree;

/// One IIO device.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IioDevice {
    /// N of `iio:deviceN`.
    pub index: u32,
    /// Name of the driver's device.
    pub name: String,
    /// Label, from the device tree.
    pub label: Option<String>,
    /// Channels, those of a scan first, in its order.
    pub channels: Vec<IioChannel>,
    /// Sampling frequencies.
    pub rates: Vec<IioRate>,
    /// The trigger that is set, empty if none is; `None` if the device takes none.
    pub trigger: Option<String>,
}

/// A channel of a device.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IioChannel {
    /// As a description names it.
    pub name: String,
    /// Storage in a scan, as `le:s16/16>>0`; `None` if it can only be polled.
    pub scan: Option<String>,
    /// Unit of one count, in m/s2, rad/s, milli-degC, ...; `None` if it cannot be read.
    pub scale: Option<f64>,
    /// Added to a raw number before the scale.
    pub offset: Option<f64>,
}

/// A sampling frequency of a device.
#[derive(Clone, Debug, Eq, PartialEq, Serialize)]
pub struct IioRate {
    /// The attribute's name.
    pub attribute: String,
    /// What it is now \[Hz\].
    pub now: String,
    /// What it can be \[Hz\]: a list, or a range `[lowest step highest]`.
    pub available: Option<String>,
}

/// All IIO devices in the order of their numbers. `root` as in [`open`](super::open).
///
/// # Errors
///
/// If the kernel's list of devices is there and cannot be read.
pub fn list(root: &Path) -> Result<Vec<IioDevice>, IioError> {
    let tree = Tree::new(root);
    if let Err(error) = std::fs::read_dir(tree.devices())
        && error.kind() != std::io::ErrorKind::NotFound
    {
        let error = IioError::io("IIO: listing devices", &tree.devices(), &error);
        return Err(IioError { kind: IioFault::Permission, ..error });
    }
    Ok(devices(&tree).iter().map(describe).collect())
}

fn describe(device: &Device) -> IioDevice {
    let mut channels = Vec::new();
    let mut add = |name: &str, scan: Option<String>| {
        if name == super::element::TIMESTAMP || channels.iter().any(|channel: &IioChannel| channel.name == name) {
            return;
        }
        let scale = scale(&device.folder, name).ok();
        let (scale, offset) = (scale.map(|scale| scale.scale), scale.map(|scale| scale.offset));
        channels.push(IioChannel { name: name.to_owned(), scan, scale, offset });
    };
    for element in Buffer::find(device).into_iter().flat_map(|buffer| buffer.channels) {
        add(&element.name, Some(element.kind));
    }
    let files = device.folder.names();
    for file in &files {
        let Some(name) = file.strip_prefix("in_") else { continue };
        if let Some(name) = name.strip_suffix("_raw").or_else(|| name.strip_suffix("_input")) {
            add(name, None);
        }
    }
    let rates = files.iter().filter(|file| file.ends_with(FREQUENCY)).map(|file| IioRate {
        attribute: file.clone(),
        now: device.folder.glance(file).unwrap_or_default(),
        available: device.folder.glance(&format!("{file}_available")),
    });
    IioDevice {
        index: device.index,
        name: device.name.clone(),
        label: device.label.clone(),
        channels,
        rates: rates.collect(),
        trigger: device.folder.sub("trigger").glance("current_trigger"),
    }
}
