//! The client library of Isotherm.
//!
//! A complete acquisition program:
//!
//! ```no_run
//! use isotherm_client::{Acquisition, ImuId, Options};
//! use std::time::Duration;
//!
//! # fn latch_pulses_and_temperatures() -> Option<([u32; 3], [u32; 3], [f64; 3], [f64; 3], u64)> { None }
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let imu: ImuId = "imu-a".parse()?;
//!     // Waits up to 5 s for the service, in the domain that ISOTHERM_DOMAIN names.
//!     let mut acquisition = Acquisition::connect(&imu, &Options::from_environment()?)?;
//!
//!     // Your hardware latches the counts at the end of each control period.
//!     while let Some((positive, negative, head, board, timestamp_ns)) = latch_pulses_and_temperatures() {
//!         let mut raw = acquisition.loan()?;            // in shared memory; sending does not copy it
//!         raw.timestamp_ns = timestamp_ns;              // end of the period, your clock
//!         raw.interval_ns = 2_500_000;                  // the measured gate length, here 2.5 ms
//!         raw.positive_pulses = positive;
//!         raw.negative_pulses = negative;
//!         raw.head_temperature = head;                  // in the table's unit
//!         raw.board_temperature = board;
//!         let increment = acquisition.compensate(raw, Duration::from_millis(10))?;
//!         println!("{:?} m/s, flags {:#x}", increment.velocity_increment, increment.flags);
//!     }
//!     Ok(())
//! }
//! ```
//!
//! * [`Acquisition`] is the one process that sends an IMU's raw samples. Besides the round trip in one call it has
//!   [`send`](Acquisition::send) and [`receive`](Acquisition::receive), for several samples in flight.
//! * [`IncrementReader`] is for all other readers of increments: navigation, loggers. [`RawReader`] reads the raw samples,
//!   for recorders.
//!
//! # Guarantees
//! * Sending and receiving allocate nothing, take no lock and make no system call while service and readers stay the same. The
//!   one exception is the system call that wakes a sleeping service.
//! * No sample is lost without notice: at most [`Acquisition::depth`] samples are unanswered at once. The next one is handed
//!   back ([`SendError::Full`]); it may wait, be dropped, or be summed with its successor ([`RawSample::merge`]).
//! * After a restart of the service the unanswered samples are sent to it again. Each answer is returned once, in order.
//!
//! Service and clients must run as the same user and use the same [`Domain`]. An application that itself depends on
//! `iceoryx2` must not enable that crate's `console` feature.

mod acquisition;
mod clock;
mod connect;
mod error;
mod folder;
mod loan;
mod objects;
mod once;
mod peers;
mod pending;
mod process;
mod reader;
mod realtime;
mod resources;
mod status;
mod tap;

pub use acquisition::Acquisition;
pub use clock::{Clock, monotonic_ns, unix_s};
pub use connect::{
    DOMAIN_VARIABLE, Options, ROOT_VARIABLE, check_domain, domain, join, join_existing, sweep_half_created,
};
pub use error::ConnectError;
pub use folder::check_owner;
pub use isotherm_shared::stream::{Domain, DomainError, ImuId};
pub use isotherm_shared::wire::{CompensatedIncrement, Flags, MergeError, RawSample};
pub use loan::{CompensateError, InFlight, Loan, SendError, TransportError};
pub use objects::{OwnFile, domain_files, foreign_object, own_files};
pub use peers::{publisher_of, subscribers_of};
pub use process::Process;
pub use reader::{IncrementReader, RawReader, Reader, Streamed};
pub use realtime::{Realtime, RealtimeError, process_kb};
pub use resources::{check_room, reserve};
pub use status::{StatusError, StatusReader, fetch_status};
pub use tap::{Tap, TapSettings, TappedSample};
