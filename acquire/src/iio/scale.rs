//! Scales and offsets of channels.

use super::error::{IioError, IioFault};
use super::sysfs::Folder;

/// What a raw number stands for: `(raw + offset) * scale`, in m/s2 or rad/s (m/s or rad for deltas).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IioScale {
    /// Unit of one count; not 0.
    pub scale: f64,
    /// Added to the raw number first.
    pub offset: f64,
    /// How much of `scale` its last digit in sysfs is: the kernel cuts scales off after 6 or 9 decimals, so that
    /// `0.000000006` may be 0.0000000067. 0 for whole numbers.
    pub rounding: f64,
}

/// The names under which a channel's shared attributes are sought: `accel_x`, `accel`; `temp0`, `temp`.
pub(super) fn families(channel: &str) -> Vec<String> {
    let mut names = vec![channel.to_owned()];
    let mut add = |name: &str| {
        if !name.is_empty() && !names.iter().any(|known| known == name) {
            names.push(name.to_owned());
        }
    };
    let family = channel.rsplit_once('_').map_or(channel, |(family, _)| family);
    add(family);
    add(family.trim_end_matches(|digit: char| digit.is_ascii_digit()));
    names
}

/// The first of a channel's attributes with this ending that is there: file and text.
pub(super) fn attribute(folder: &Folder, channel: &str, ending: &str) -> Result<Option<(String, String)>, IioError> {
    for family in families(channel) {
        let file = format!("in_{family}_{ending}");
        if let Some(text) = folder.read(&file)? {
            return Ok(Some((file, text)));
        }
    }
    Ok(None)
}

/// The scale and offset of a channel; 1 and 0 where the device has none.
pub(super) fn scale(folder: &Folder, channel: &str) -> Result<IioScale, IioError> {
    let (scale, rounding) = match attribute(folder, channel, "scale")? {
        Some((file, text)) => {
            let scale = number(folder, &file, &text)?;
            if scale == 0.0 {
                let cause = format!("{file} is 0 ({text})");
                let remedy = "the driver rounds it to nothing, or has not set the range: set the range, then try again";
                return Err(IioError::new(IioFault::Refused, folder.phase("reading the scale"), cause, remedy));
            }
            (scale, rounding(&text, scale))
        }
        None => (1.0, 0.0),
    };
    let offset = match attribute(folder, channel, "offset")? {
        Some((file, text)) => number(folder, &file, &text)?,
        None => 0.0,
    };
    Ok(IioScale { scale, offset, rounding })
}

/// The last digit's unit over the scale.
fn rounding(text: &str, scale: f64) -> f64 {
    let digits =
        text.split_once('.').map_or(0, |(_, decimals)| decimals.bytes().take_while(u8::is_ascii_digit).count());
    let digits = i32::try_from(digits).unwrap_or(i32::MAX);
    if digits == 0 { 0.0 } else { (10_f64.powi(-digits) / scale).abs() }
}

/// The finite number that an attribute is.
pub(super) fn number(folder: &Folder, file: &str, text: &str) -> Result<f64, IioError> {
    let first = text.split_ascii_whitespace().next().unwrap_or_default();
    first.parse::<f64>().ok().filter(|number| number.is_finite()).ok_or_else(|| {
        let phase = folder.phase(&format!("reading {file}"));
        IioError::new(
            IioFault::Refused,
            phase,
            format!("{text:?} is not a number"),
            "report it to the driver's maintainer",
        )
    })
}
