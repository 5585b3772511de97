//! Setting a device up: scan elements, clock, trigger, frequency, buffer.

use std::io;

use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;

use super::clock::{IioClock, set_monotonic};
use super::device::{Device, triggers};
use super::element::{Element, Layout, TIMESTAMP, elements};
use super::error::{IioError, IioFault};
use super::rate;
use super::settings::IioSettings;
use super::sysfs::{Folder, Tree};

/// Shortest time that a kernel's buffer holds without a reader \[ns\].
const HELD_NS: u64 = 500_000_000;
/// Least and most scans of a kernel's buffer.
const SCANS: (u64, u64) = (64, 65_536);
/// Largest watermark.
const WATERMARK: u32 = 16_384;

/// A device's buffer: its scan elements and its switches.
pub(super) struct Buffer {
    pub(super) elements: Folder,
    pub(super) control: Folder,
    pub(super) channels: Vec<Element>,
}

impl Buffer {
    /// The buffer that is read through the node: `buffer0` since Linux 5.11, `scan_elements` and `buffer` before.
    pub(super) fn find(device: &Device) -> Option<Self> {
        let both = [("buffer0", "buffer0"), ("scan_elements", "buffer")];
        both.into_iter().find_map(|(scan, control)| {
            let (scan, control) = (device.folder.sub(scan), device.folder.sub(control));
            let channels = elements(&scan);
            (!channels.is_empty() && control.has("enable")).then_some(Self { elements: scan, control, channels })
        })
    }

    pub(super) fn has(&self, channel: &str) -> bool {
        self.channels.iter().any(|element| element.name == channel)
    }
}

/// A device that is set up, its buffer still off.
pub(super) struct DeviceSetup {
    pub(super) layout: Layout,
    pub(super) clock: IioClock,
    /// Scans that the kernel holds at most.
    pub(super) length: usize,
}

/// Opens a device's node, which one program at a time can, and switches its buffer off: one that is on was left by a
/// program that was killed. If a chip has two devices, both must be off before either is set up.
pub(super) fn claim(tree: &Tree, device: &Device, buffer: &Buffer) -> Result<OwnedFd, IioError> {
    let path = tree.node(device.index);
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let node = rustix::fs::open(&path, flags, Mode::empty())
        .map_err(|errno| IioError::io(device.folder.phase("opening its node"), &path, &errno.into()))?;
    if buffer.control.read("enable")?.is_some_and(|enabled| enabled != "0") {
        buffer.control.write("enable", "0")?;
    }
    Ok(node)
}

/// Sets a device up to give these channels.
pub(super) fn prepare(
    tree: &Tree,
    device: &Device,
    buffer: &Buffer,
    channels: &[String],
    settings: &IioSettings,
) -> Result<DeviceSetup, IioError> {
    let layout = select(buffer, channels)?;
    let clock = if buffer.has(TIMESTAMP) { set_monotonic(&device.folder) } else { IioClock::None };
    let trigger = trigger(tree, device, settings)?;
    rate::set(&device.folder, trigger.as_ref(), channels, settings.interval_ns)?;
    let length = size(buffer, settings)?;
    Ok(DeviceSetup { layout, clock, length })
}

/// Enables these channels and the timestamp, and no other.
fn select(buffer: &Buffer, channels: &[String]) -> Result<Layout, IioError> {
    let is_wanted = |element: &&Element| element.name == TIMESTAMP || channels.contains(&element.name);
    let (wanted, others): (Vec<&Element>, Vec<&Element>) = buffer.channels.iter().partition(is_wanted);
    // Others first: some drivers refuse one channel in addition to another.
    for (elements, state) in [(others, "0"), (wanted, "1")] {
        for element in elements {
            let file = format!("in_{}_en", element.name);
            if buffer.elements.read(&file)?.as_deref() != Some(state) {
                buffer.elements.write(&file, state)?;
            }
        }
    }
    let is_on = |element: &&Element| {
        buffer.elements.glance(&format!("in_{}_en", element.name)).is_some_and(|state| state != "0")
    };
    let enabled: Vec<Element> = buffer.channels.iter().filter(is_on).cloned().collect();
    Layout::new(&buffer.elements, &enabled)
}

/// Sets the trigger if one is named; the folder of the device's trigger then, if it has one.
fn trigger(tree: &Tree, device: &Device, settings: &IioSettings) -> Result<Option<Folder>, IioError> {
    const CURRENT: &str = "current_trigger";
    let attribute = device.folder.sub("trigger");
    let has_trigger = attribute.has(CURRENT);
    let all = triggers(tree);
    if let Some(wanted) = &settings.trigger {
        let phase = || device.folder.phase(&format!("setting the trigger {wanted}"));
        if !has_trigger && settings.devices.len() == 1 {
            let cause = "the device takes no trigger: it paces itself";
            return Err(IioError::new(IioFault::Description, phase(), cause, "take `trigger` out of [iio]"));
        }
        if has_trigger && !all.iter().any(|(name, _)| name == wanted) {
            let cause = format!("there is no such trigger; there are {}", names(&all));
            let remedy = "name one of these, or make one (docs/iio.md)";
            return Err(IioError::new(IioFault::Description, phase(), cause, remedy));
        }
        if has_trigger && attribute.read(CURRENT)?.as_ref() != Some(wanted) {
            attribute.write(CURRENT, wanted)?;
        }
    }
    let current = attribute.glance(CURRENT);
    Ok(all.into_iter().find(|(name, _)| Some(name) == current.as_ref()).map(|(_, folder)| folder))
}

fn names(triggers: &[(String, Folder)]) -> String {
    let names: Vec<&str> = triggers.iter().map(|(name, _)| name.as_str()).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// Sets length and watermark; the length in scans.
fn size(buffer: &Buffer, settings: &IioSettings) -> Result<usize, IioError> {
    let watermark = settings.watermark;
    if watermark == 0 || watermark > WATERMARK {
        let phase = buffer.control.phase("setting the watermark");
        let cause = format!("is {watermark}, which is not 1 to {WATERMARK}");
        return Err(IioError::new(IioFault::Description, phase, cause, "give iio.watermark = 1, or a few scans"));
    }
    let held = HELD_NS / settings.interval_ns.max(1);
    let length = held.max(4 * u64::from(watermark)).clamp(SCANS.0, SCANS.1);
    let length = at_least(&buffer.control, "length", length, u64::from(watermark))?;
    if buffer.control.has("watermark") {
        at_least(&buffer.control, "watermark", u64::from(watermark), 1)?;
    }
    Ok(usize::try_from(length.min(SCANS.1)).unwrap_or_default())
}

/// Writes a number; one that cannot be written, as with buffers in hardware, may stay if it is `least` or more.
fn at_least(folder: &Folder, name: &str, value: u64, least: u64) -> Result<u64, IioError> {
    let text = value.to_string();
    let result = folder.try_write(name, &text);
    let now = folder.glance(name).and_then(|text| text.parse().ok()).filter(|now| *now >= least);
    match (result, now) {
        (_, Some(now)) => Ok(now),
        (Ok(()), None) => Ok(value),
        (Err(error), None) => Err(folder.failed(name, &text, &error)),
    }
}

/// Switches a buffer on.
pub(super) fn enable(tree: &Tree, device: &Device, buffer: &Buffer) -> Result<(), IioError> {
    let Err(error) = buffer.control.try_write("enable", "1") else { return Ok(()) };
    let is = |error: &io::Error, errno: Errno| error.raw_os_error() == Some(errno.raw_os_error());
    if !is(&error, Errno::INVAL) {
        return Err(buffer.control.failed("enable", "1", &error));
    }
    let phase = device.folder.phase("starting its buffer");
    let current = device.folder.sub("trigger").glance("current_trigger");
    let (cause, remedy) = if current.is_some_and(|trigger| trigger.is_empty()) {
        let triggers = triggers(tree);
        let cause = format!("no trigger is set, and the driver needs one; there are {}", names(&triggers));
        (cause, "name one as `trigger` in [iio], or make an hrtimer trigger first (docs/iio.md)")
    } else {
        let cause = "the driver refuses these channels together, or this trigger (EINVAL)".to_owned();
        (cause, "`dmesg` may say why; take fewer channels, or another trigger")
    };
    Err(IioError::new(IioFault::Description, phase, cause, remedy))
}
