//! Reading recordings: the format is told by the first bytes, and several pieces of one recording are read as one, in whatever order they
//! are named.

mod mcap;
mod numbers;
mod pages;
mod panics;
mod parquet;
mod places;
mod recording;
mod table;

pub use numbers::{NumberRow, read_numbers};
pub use places::Places;
pub use recording::{Recording, RowKind, Samples};
pub use table::ImuChoice;

#[cfg(test)]
mod tests;
