//! How a coefficient table comes into use: [`TableInstaller`] installs it, keeps its predecessor, and waits until the
//! service has judged the file.
//!
//! The service writes a [`TableNote`] for each IMU into the folder of its domain. The note says what the service reads,
//! serves and refuses, and a lock shows whether the service lives. So an installation needs no stream.
//! By an [`Acceptance`] an operator accepts a table that the service would refuse.

mod acceptance;
mod installer;
mod note;

pub use acceptance::Acceptance;
pub use installer::{NewTable, TableInstaller, table_file};
pub use note::{TableJudgement, TableNote, remove_notes, service_lock};
