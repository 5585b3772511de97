//! Writes recordings that grow. They are complete up to the last flush at every moment, even if the recorder is killed.

mod container;
mod files;
mod growing;
mod mcap;
mod open;
mod patient;
mod pieces;
mod publication;
mod ros;
mod stream;
mod vacant;
mod zstd;

pub use files::{Files, Format, IMU_PLACEHOLDER, MoreColumns, Rotation};
pub use open::FileError;
pub use patient::PatientFiles;
pub use ros::{RosTable, RosWriter, refuse_same_topics};
pub use stream::RowWriter;
pub use vacant::is_vacant;
