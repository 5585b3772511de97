//! Recordings in every format: CSV, Parquet and MCAP.
//!
//! [`mod@read`] detects the format of a file by its first bytes and reads several pieces of a recording as one. [`mod@write`]
//! writes recordings that are complete up to the last flush at every moment. [`mod@convert`] makes raw samples of foreign data.

pub mod convert;
mod protobuf;
pub mod read;
pub mod ros;
mod varint;
pub mod write;
