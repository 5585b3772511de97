//! Reads recordings. The format is detected by the first bytes. Several pieces of a recording, named in any order, are
//! read as one. A piece may be foreign data, which are then read as [`convert`](crate::convert) makes raw samples of
//! them.

mod borders;
pub(crate) mod chunk;
mod contents;
mod converted;
mod fields;
mod frames;
mod increments;
mod input;
mod mcap;
mod numbers;
mod open;
mod order;
mod pair;
pub(crate) mod panics;
mod part;
mod piece;
mod pieces;
mod places;
pub(crate) mod plausible;
mod recognise;
mod recording;
pub(crate) mod records;
pub(crate) mod skip;
pub(crate) mod summary;
mod table;

pub use contents::RecordingContents;
pub use increments::read_increments;
pub use input::Input;
pub use numbers::{NumberRow, NumberTable, read_numbers};
pub use order::RowOrder;
pub use part::{ConversionPart, Part, RecordingTime};
pub use piece::RowKind;
pub use pieces::Pieces;
pub use places::Places;
pub use recording::{Recording, Samples};
pub use table::ImuChoice;

#[cfg(test)]
pub(crate) mod tests;
