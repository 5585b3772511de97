//! Recording the streams: a thread takes their copies out of shared memory ([`tap`]), another encodes and writes them ([`files`]).

pub mod columns;
mod csv;
pub mod files;
mod growing;
mod mcap;
mod parquet;
pub mod protobuf;
pub mod tally;
pub mod tap;
