//! The devices and triggers that there are, and how a description names one.

use super::error::{IioError, IioFault};
use super::sysfs::{Folder, Tree};

/// One device.
pub(super) struct Device {
    pub(super) index: u32,
    pub(super) name: String,
    pub(super) label: Option<String>,
    pub(super) folder: Folder,
}

impl Device {
    /// `adis16505-2 (iio:device0)`, with the label if there is one.
    pub(super) fn title(&self) -> String {
        let label = self.label.as_ref().map(|label| format!(", label {label}")).unwrap_or_default();
        format!("{} (iio:device{}{label})", self.name, self.index)
    }
}

/// All devices in the order of their numbers.
pub(super) fn devices(tree: &Tree) -> Vec<Device> {
    let mut devices: Vec<Device> = numbered(tree, "iio:device")
        .into_iter()
        .map(|(index, folder)| {
            let name = folder.glance("name").unwrap_or_default();
            let label = folder.glance("label").filter(|label| !label.is_empty());
            let owner = format!("IIO device {name} (iio:device{index})");
            Device { index, name, label, folder: tree.folder(folder.path, &owner) }
        })
        .collect();
    devices.sort_by_key(|device| device.index);
    devices
}

/// All triggers: name and folder.
pub(super) fn triggers(tree: &Tree) -> Vec<(String, Folder)> {
    let mut triggers: Vec<_> = numbered(tree, "trigger")
        .into_iter()
        .filter_map(|(_, folder)| {
            let name = folder.glance("name")?;
            let owner = format!("IIO trigger {name}");
            Some((name, tree.folder(folder.path, &owner)))
        })
        .collect();
    triggers.sort_by(|a, b| a.0.cmp(&b.0));
    triggers
}

/// The folders whose name is `prefix` and a number.
fn numbered(tree: &Tree, prefix: &str) -> Vec<(u32, Folder)> {
    let all = tree.folder(tree.devices(), "IIO");
    let number = |name: &String| name.strip_prefix(prefix)?.parse().ok();
    all.names().iter().filter_map(|name| Some((number(name)?, all.sub(name)))).collect()
}

/// The device that a description names: by name or label, `iio:deviceN` or N, or a unique beginning of a name or label.
pub(super) fn find<'a>(devices: &'a [Device], wanted: &str) -> Result<&'a Device, IioError> {
    let phase = || format!("IIO device {wanted:?}: looking for it");
    let names = |device: &'a Device| [Some(device.name.as_str()), device.label.as_deref()];
    let is = |device: &&'a Device| names(device).contains(&Some(wanted));
    let number = wanted.strip_prefix("iio:device").unwrap_or(wanted).parse::<u32>().ok();
    let has_number = |device: &&'a Device| Some(device.index) == number;
    let begins = |device: &&'a Device| {
        !wanted.is_empty() && names(device).into_iter().flatten().any(|name| name.starts_with(wanted))
    };
    let steps: [&dyn Fn(&&'a Device) -> bool; 3] = [&is, &has_number, &begins];
    for step in steps {
        let found: Vec<&Device> = devices.iter().filter(step).collect();
        match found[..] {
            [] => {}
            [device] => return Ok(device),
            _ => {
                let cause = format!("{} devices match: {}", found.len(), titles(&found));
                return Err(IioError::new(
                    IioFault::Description,
                    phase(),
                    cause,
                    "name one by its label or as iio:deviceN",
                ));
            }
        }
    }
    Err(absent(devices, phase()))
}

fn absent(devices: &[Device], phase: String) -> IioError {
    if devices.is_empty() {
        return IioError::new(
            IioFault::Absent,
            phase,
            "the kernel has no IIO device",
            "load its driver (modprobe, device tree overlay); `dmesg` says why a driver found no chip",
        );
    }
    let all: Vec<&Device> = devices.iter().collect();
    let remedy = "name one of these, or load the driver (`isotherm acquire --list` shows channels)";
    IioError::new(IioFault::Absent, phase, format!("there are {}", titles(&all)), remedy)
}

fn titles(devices: &[&Device]) -> String {
    devices.iter().map(|device| device.title()).collect::<Vec<_>>().join(", ")
}
