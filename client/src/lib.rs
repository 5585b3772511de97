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
//!     // Your hardware's gate: counts latched with the interval's edge.
//!     while let Some((positive, negative, head, board, timestamp_ns)) = latch_pulses_and_temperatures() {
//!         let mut raw = acquisition.loan()?;            // lies in shared memory; nothing is copied from here on
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
//! * [`IncrementReader`] is for everybody else: navigation, loggers. [`RawReader`] reads the raw samples: recorders.
//!
//! # Guarantees
//! * Sending and receiving allocate nothing, take no lock and make no system call while service and readers stay the same, but
//!   the one that wakes a service that sleeps.
//! * Nothing is lost in silence: at most [`Acquisition::depth`] samples are unanswered at once, the next is handed back
//!   ([`SendError::Full`]) and may wait, be dropped, or be summed with its successor ([`RawSample::merge`]).
//! * A service that dies and returns is sent again what it had not answered; each answer is handed out once, in order.
//!
//! Service and clients must run as the same user and meet in one [`Domain`]. An application that itself depends on
//! `iceoryx2` must leave that crate's `console` feature off.

mod acquisition;
mod clock;
mod connect;
mod error;
mod loan;
mod once;
mod peers;
mod pending;
mod reader;
mod realtime;
mod resources;
mod status;
mod tap;

pub use acquisition::Acquisition;
pub use clock::{Clock, monotonic_ns, unix_s};
pub use connect::{
    DOMAIN_VARIABLE, Options, ROOT_VARIABLE, check_owner, domain, in_mode, join, join_existing, sweep_half_created,
};
pub use error::ConnectError;
pub use isotherm_shared::stream::{Domain, DomainError, ImuId};
pub use isotherm_shared::wire::{CompensatedIncrement, Flags, MergeError, RawSample};
pub use loan::{CompensateError, InFlight, Loan, SendError, TransportError};
pub use peers::{publisher_of, subscribers_of};
pub use reader::{IncrementReader, RawReader, Reader, Streamed};
pub use realtime::{Realtime, RealtimeError, process_kb};
pub use resources::{check_room, reserve};
pub use status::{StatusError, StatusReader, fetch_status};
pub use tap::{Tap, TapSettings, TappedSample};
