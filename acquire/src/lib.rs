//! Acquisition: from an IMU on a serial line, a network or Linux' IIO to the service, without a line of code.
//!
//! A [`Description`] says where bytes come from, what frames they are and what their numbers stand for. [`run`] makes
//! raw samples of them, each with the number and the time of its control period, and sends them as every client does.
//! What does not arrive whole is a gap with its number; every byte that is no frame is counted ([`Tally`]).
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_acquire::{Description, RunSettings, Target, run};
//! use std::path::Path;
//!
//! let description = Description::from_toml(&std::fs::read_to_string("stim300.toml")?)?;
//! let settings = RunSettings {
//!     target: Target::Rows(Some(5)),
//!     record: None,
//!     sysfs: Path::new("/").to_owned(),
//!     end: Default::default(),
//!     tell: |tally| eprintln!("{tally}"),
//! };
//! run(&description, settings)?;
//! # Ok(())
//! # }
//! ```

mod checksum;
mod datagrams;
mod description;
mod dialogue;
mod frames;
mod gravity;
mod health;
mod identity;
pub mod iio;
mod intake;
mod lines;
mod link;
mod message;
mod message_queue;
mod messages;
mod nominal;
mod note;
mod note_writer;
mod notice;
mod number;
mod offline;
mod port;
mod profiles;
mod pulses;
mod rate;
mod recorder;
mod run;
mod sample;
mod sink;
mod source;
mod stream;
mod tally;
#[cfg(test)]
mod tests;
mod thermometer;
mod timeline;

pub use description::Description;
pub use frames::{DecodedFrame, FrameArrival, MAX_FRAME};
pub use isotherm_recording_formats::convert::{acceleration_units, rate_units};
pub use link::LinkCounts;
pub use message_queue::{DeviceMessage, MessageQueue, MessageStamps};
pub use messages::MessageSettings;
pub use notice::Notice;
pub use number::Value;
pub use offline::samples_of;
pub use port::serial_ports;
pub use profiles::{PROFILES, ProbeResult, probe};
pub use recorder::RecordingTarget;
pub use run::{RunSettings, Target, run};
pub use stream::StreamDecoder;
pub use tally::{Cause, SkippedBytes, Tally};
