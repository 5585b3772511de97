//! The elements of a scan and their places in it.

use super::error::{IioError, IioFault};
use super::format::Format;
use super::sysfs::Folder;

/// The channel of the kernel's time of a scan.
pub(super) const TIMESTAMP: &str = "timestamp";

/// One scan element.
#[derive(Clone, Debug)]
pub(super) struct Element {
    /// As in `in_NAME_en`.
    pub(super) name: String,
    /// Order in the scan.
    pub(super) index: u32,
    /// The text of its `_type`.
    pub(super) kind: String,
}

/// All scan elements in the order of their indices.
pub(super) fn elements(folder: &Folder) -> Vec<Element> {
    let mut elements: Vec<Element> = folder
        .names()
        .iter()
        .filter_map(|file| {
            let name = file.strip_prefix("in_")?.strip_suffix("_en")?;
            let index = folder.glance(&format!("in_{name}_index"))?.parse().ok()?;
            let kind = folder.glance(&format!("in_{name}_type"))?;
            Some(Element { name: name.to_owned(), index, kind })
        })
        .collect();
    elements.sort_by_key(|element| element.index);
    elements
}

/// A number in a scan.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct ElementPlace {
    at: usize,
    format: Format,
}

impl ElementPlace {
    /// The number in this scan.
    pub(super) fn read(&self, scan: &[u8]) -> i64 {
        self.format.decode(scan.get(self.at..).unwrap_or_default())
    }
}

/// Where each enabled element is.
#[derive(Debug)]
pub(super) struct Layout {
    places: Vec<(String, ElementPlace)>,
    /// Bytes from one scan to the next.
    pub(super) bytes: usize,
}

impl Layout {
    /// The layout of these enabled elements, as `iio_compute_scan_bytes` of the kernel has it: in the order of their
    /// indices, each at a multiple of its own size, the timestamp last, the whole a multiple of the largest.
    ///
    /// Kernels before 5.5 do not round the whole. With a timestamp that makes no difference.
    pub(super) fn new(folder: &Folder, enabled: &[Element]) -> Result<Self, IioError> {
        let mut ordered: Vec<&Element> = enabled.iter().collect();
        ordered.sort_by_key(|element| (element.name == TIMESTAMP, element.index));
        let (mut end, mut largest, mut places) = (0_usize, 1, Vec::new());
        for element in ordered {
            let format = Format::parse(&element.kind).map_err(|cause| {
                IioError::new(
                    IioFault::Description,
                    folder.phase(&format!("scan element {}", element.name)),
                    cause,
                    "name another channel, or report the driver",
                )
            })?;
            let at = end.next_multiple_of(format.bytes());
            end = at + format.bytes();
            largest = largest.max(format.bytes());
            places.push((element.name.clone(), ElementPlace { at, format }));
        }
        Ok(Self { places, bytes: end.next_multiple_of(largest) })
    }

    /// The place of this channel's only number, or why there is none.
    pub(super) fn place(&self, folder: &Folder, channel: &str) -> Result<ElementPlace, IioError> {
        let phase = || folder.phase(&format!("scan element {channel}"));
        match self.places.iter().find(|(name, _)| name == channel) {
            Some((_, place)) if place.format.repeat == 1 => Ok(*place),
            Some((_, place)) => Err(IioError::new(
                IioFault::Description,
                phase(),
                format!("it holds {} numbers, and a column is one", place.format.repeat),
                "name another channel",
            )),
            None => Err(IioError::new(
                IioFault::Refused,
                phase(),
                "the driver did not enable it",
                "some channels exclude each other (`dmesg`)",
            )),
        }
    }

    #[cfg(test)]
    pub(super) fn at(&self, channel: &str) -> Option<usize> {
        self.places.iter().find(|(name, _)| name == channel).map(|(_, place)| place.at)
    }
}
