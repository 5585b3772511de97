//! The section `[iio]`.

use crate::iio::IioSettings;
use isotherm_shared::document::Section;

/// The settings, but for what other sections say.
pub(super) fn read(root: &Section<'_, '_>) -> Option<IioSettings> {
    let section = root.section("iio", "a section [iio]")?;
    let devices = section.strings("device", "the name of the device, or of two: that of the accelerometers first");
    let many = devices.as_ref().filter(|devices| devices.len() > 2);
    section.refuse("device", many.map(|devices| format!("has {} devices; give one or two", devices.len())));
    let trigger = section.optional_string("trigger").map(str::to_owned);
    let watermark = section.optional_integer("watermark", 1..=16_384).unwrap_or(1) as u32;
    let poll = section.optional_number("poll_s").unwrap_or(1.0);
    let right = (0.01..=3600.0).contains(&poll);
    section.refuse("poll_s", (!right).then(|| format!("is {poll:?}, give seconds from 0.01 to 3600")));
    section.finish();
    Some(IioSettings {
        devices: devices?.into_iter().map(str::to_owned).collect(),
        trigger,
        watermark,
        interval_ns: 0,
        columns: Vec::new(),
        temperature: Vec::new(),
        poll_ns: (poll * 1e9) as u64,
    })
}
