//! Which device gives which wanted channel.

use super::device::{Device, find};
use super::error::{IioError, IioFault};
use super::settings::IioSettings;
use super::setup::Buffer;
use super::temperature;

/// A device of the description and its buffer.
pub(super) struct DeviceBuffer<'a> {
    pub(super) device: &'a Device,
    pub(super) buffer: Buffer,
}

/// A channel of one of the members.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct Channel {
    pub(super) member: usize,
    pub(super) name: String,
}

/// Where a temperature is.
pub(super) enum TemperatureSource<'a> {
    Scanned(Channel),
    Polled(&'a Device, String),
}

/// The devices of the description, one or two, each with a buffer.
pub(super) fn members<'a>(all: &'a [Device], settings: &IioSettings) -> Result<Vec<DeviceBuffer<'a>>, IioError> {
    let fault = |cause: String, remedy: &str| {
        Err(IioError::new(IioFault::Description, "IIO: source.iio.device", cause, remedy))
    };
    if !(1..=2).contains(&settings.devices.len()) {
        return fault(format!("names {} devices", settings.devices.len()), "name one device, or two");
    }
    let mut members: Vec<DeviceBuffer<'a>> = Vec::new();
    for wanted in &settings.devices {
        let device = find(all, wanted)?;
        if members.iter().any(|member| member.device.index == device.index) {
            return fault(format!("both names are {}", device.title()), "name two devices, or one");
        }
        let Some(buffer) = Buffer::find(device) else {
            let phase = device.folder.phase("looking for its buffer");
            let remedy = "a newer kernel's driver may have one; some need an interrupt line in the device tree";
            return Err(IioError::new(IioFault::Description, phase, "its driver has no buffer", remedy));
        };
        members.push(DeviceBuffer { device, buffer });
    }
    Ok(members)
}

/// The device and the channel that a description names: `CHANNEL` or `DEVICE/CHANNEL`.
fn split(name: &str) -> (Option<&str>, &str) {
    name.rsplit_once('/').map_or((None, name), |(device, channel)| (Some(device), channel))
}

/// The scan element that a column names.
pub(super) fn column(all: &[Device], members: &[DeviceBuffer<'_>], name: &str) -> Result<Channel, IioError> {
    let (device, channel) = split(name);
    let only = device.map(|device| find(all, device)).transpose()?.map(|device| device.index);
    let found: Vec<usize> = (0..)
        .zip(members)
        .filter(|(_, member)| only.is_none_or(|index| index == member.device.index) && member.buffer.has(channel))
        .map(|(at, _)| at)
        .collect();
    match found[..] {
        [member] => Ok(Channel { member, name: channel.to_owned() }),
        [] => {
            let titles: Vec<String> = members.iter().map(scans).collect();
            let cause = format!("no scan element has this name; {}", titles.join("; "));
            Err(IioError::new(IioFault::Description, format!("IIO channel {name}"), cause, "name one of these"))
        }
        _ => {
            let titles: Vec<String> = members.iter().map(|member| member.device.title()).collect();
            let cause = format!("several devices have it: {}", titles.join(", "));
            let remedy = "name it as DEVICE/CHANNEL";
            Err(IioError::new(IioFault::Description, format!("IIO channel {name}"), cause, remedy))
        }
    }
}

fn scans(member: &DeviceBuffer<'_>) -> String {
    let names: Vec<&str> = member.buffer.channels.iter().map(|element| element.name.as_str()).collect();
    format!("{} has {}", member.device.title(), names.join(" "))
}

/// Where the temperature of this name is: a scan element if there is one, otherwise an attribute. Two devices of one
/// chip both have its temperature: the first's is taken.
pub(super) fn temperature<'a>(
    all: &'a [Device],
    members: &[DeviceBuffer<'a>],
    name: &str,
) -> Result<TemperatureSource<'a>, IioError> {
    let (device, channel) = split(name);
    let candidates: Vec<&Device> = match device {
        Some(device) => vec![find(all, device)?],
        None => members.iter().map(|member| member.device).collect(),
    };
    let buffer = |device: &Device| (0..).zip(members).find(|(_, member)| member.device.index == device.index);
    let place = |device: &'a Device| match buffer(device) {
        Some((member, DeviceBuffer { buffer, .. })) if buffer.has(channel) => {
            Some(TemperatureSource::Scanned(Channel { member, name: channel.to_owned() }))
        }
        _ => temperature::has(device, channel).then(|| TemperatureSource::Polled(device, channel.to_owned())),
    };
    let found = candidates.into_iter().find_map(place);
    found.ok_or_else(|| {
        let known = members.first().map(|member| temperature::known(&member.device.folder)).unwrap_or_default();
        let cause = format!("the device has no temperature of this name; temperatures are {known}");
        let remedy = "name one of these as DEVICE/CHANNEL, or give [temperature] a constant";
        IioError::new(IioFault::Description, format!("IIO temperature {name}"), cause, remedy)
    })
}
