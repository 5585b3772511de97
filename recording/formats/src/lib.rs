//! Recordings in every format: CSV, Parquet and MCAP.
//!
//! [`read`] tells a file's format by its first bytes, and reads several pieces of one recording as one. [`write`] writes recordings that are
//! whole up to the last flush at every moment.

mod protobuf;
pub mod read;
mod varint;
pub mod write;
