//! Reads recordings. The format is detected by the first bytes. Several pieces of a recording, named in any order, are
//! read as one.

mod fields;
mod mcap;
mod numbers;
mod pages;
mod panics;
mod parquet;
mod places;
mod recording;
pub(crate) mod records;
mod table;

pub use numbers::{NumberRow, NumberTable, read_numbers};
pub use places::Places;
pub use recording::{Recording, RowKind, Samples};
pub use table::ImuChoice;

#[cfg(test)]
mod tests;
