//! The client library of Isotherm.
//!
//! The shortest acquisition program. It loses no control period while the service stalls, is away for half a minute, or
//! is replaced. `examples/rust/paced.rs` is a whole program to start from.
//!
//! ```no_run
//! use isotherm_client::{Acquisition, ImuId, Options, Sensor, Triad};
//! use std::time::Duration;
//!
//! # struct Latched {
//! #     accelerometers: Triad, gyroscopes: Triad, timestamp_ns: u64,
//! #     new_temperature: Vec<(Sensor, f64, u64)>, telemetry_ns: u64,
//! # }
//! # fn latch() -> Option<Latched> { None }
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let imu: ImuId = "imu-a".parse()?;
//!     // Waits up to 5 s for the service, in the domain that ISOTHERM_DOMAIN names.
//!     let options = Options { serial: Some("SN 42".to_owned()), ..Options::from_environment()? };
//!     let mut acquisition = Acquisition::connect(&imu, &options)?;
//!
//!     // Your hardware latches the counts at the end of each control period.
//!     while let Some(latched) = latch() {
//!         // Temperature that has been measured since the last period; in most periods there is none.
//!         for (sensor, value, measured_ns) in latched.new_temperature {
//!             acquisition.lag().read(sensor, value, measured_ns);
//!         }
//!         let mut raw = acquisition.loan()?;            // in shared memory; sending does not copy it
//!         raw.timestamp_ns = latched.timestamp_ns;      // end of the period, your clock
//!         raw.telemetry_ns = latched.telemetry_ns;      // when the temperatures were measured, your clock
//!         raw.interval_ns = 2_500_000;                  // the measured gate length, here 2.5 ms
//!         raw.accelerometers = latched.accelerometers;  // pulses of both channels; temperature in the table's unit
//!         raw.gyroscopes = latched.gyroscopes;          // leave them out where the IMU has none
//!         // All increments that have arrived, each once and in the order of sending.
//!         for increment in acquisition.exchange(raw, Duration::from_millis(1))? {
//!             println!("{:?} m/s, {:?} rad", increment.velocity_increment, increment.angle_increment);
//!         }
//!     }
//!     Ok(())
//! }
//! ```
//!
//! * [`Acquisition`] is the one process that sends an IMU's raw samples. [`exchange`](Acquisition::exchange) serves a
//!   control period in one call; [`send`](Acquisition::send) and [`receive`](Acquisition::receive) are its parts.
//! * [`Acquisition::lag`] takes the temperatures as they are measured. The library keeps its first-order lag,
//!   which a table with transient terms needs, and sends it with each sample. [`isotherm_shared::lag`] has the formula,
//!   `docs/temperature-in-motion.md` the whole story.
//! * [`Acquisition::fill`] turns readings in m/s2 and rad/s into the pulses of a sample, and increments have
//!   [`specific_force`](CompensatedIncrement::specific_force) and [`angular_rate`](CompensatedIncrement::angular_rate).
//! * [`Acquisition::prepare`], called while you wait for the end of a control period, warms the way of the next sample.
//! * [`IncrementReader`] is for all other readers of increments: navigation, loggers. It sleeps until increments are
//!   there ([`receive_timeout`](IncrementReader::receive_timeout)), or gives a
//!   [descriptor](IncrementReader::descriptor) to an event loop, and shows whether the service lives
//!   ([`heartbeat_age`](IncrementReader::heartbeat_age)). [`RawReader`] reads the raw samples, for recorders.
//!
//! # Guarantees
//! * Loaning, sending and receiving allocate nothing, take no lock and make no system call while service and readers
//!   stay the same. The one exception is the system call that wakes a sleeping service.
//! * No call waits for longer than its time-out. What may take long, as joining again, is done by a helper thread of
//!   each acquisition, under `SCHED_OTHER` and with all signals blocked.
//! * No control period is lost without notice. At most [`Acquisition::depth`] samples are unanswered at once, and up to
//!   [`Options::kept`] more wait in private memory: an outage of the service of 30 s loses nothing up to 546 Hz. A loan
//!   has its sequence from the beginning, so dropping one is a gap, which every reader sees. [`Acquisition::close`]
//!   returns what was lost.
//! * After a restart of the service the unanswered samples are sent to it again. Each answer is returned once, in
//!   order.
//! * A program that is cut off from the service, as by somebody who tidies `/dev/shm`, joins it again by itself. It
//!   warns through `tracing` then, or on stderr if there is no subscriber and stderr can be written at once.
//!
//! Service and clients must run as the same user and use the same [`Domain`]. An application that itself depends on
//! `iceoryx2` must not enable that crate's `console` feature.

mod acquisition;
mod arrival;
mod clock;
mod closing;
mod connect;
mod error;
mod folder;
mod heartbeat;
mod helper;
mod kept;
mod lag;
mod lag_option;
mod loan;
mod loss;
mod objects;
mod pace;
mod peers;
mod process;
mod reader;
mod realtime;
mod rehearsal;
mod resources;
mod source_pulses;
mod status;
pub mod sync;
mod table_watch;
mod tap;
pub mod transport;
mod unix_time;
mod warning;

pub use acquisition::answers::LateAnswers;
pub use acquisition::{Acquisition, LagAccess};
pub use arrival::descriptor;
pub use clock::{Clock, boot, clock_offset_ns, monotonic_ns, unix_s};
pub use closing::{ClosingNote, last_closing};
pub use connect::{
    DOMAIN_VARIABLE, Options, ROOT_VARIABLE, STATE_VARIABLE, check_domain, domain, join, join_existing,
    sweep_half_created,
};
pub use error::{ConnectError, shortage};
pub use folder::{check_owner, domain_owner, prepare};
pub use isotherm_shared::lag::{Lag, LaggedReading};
pub use isotherm_shared::names::{Domain, DomainError, ImuId};
pub use isotherm_shared::readings::{ReadingError, Resolution};
pub use isotherm_shared::time_constant::{InvalidTimeConstant, TimeConstant};
pub use isotherm_shared::wire::{CompensatedIncrement, Flags, MergeError, RawSample, Triad, device};
pub use kept::{KEPT_RANGE, MOST_KEPT};
pub use lag::{Sensor, UnknownSensor};
pub use lag_option::LagOption;
pub use loan::{CompensateError, ExchangeError, InFlight, Loan, LoanMergeError, SendError, TransportError};
pub use loss::removed_object;
pub use objects::{Note, OwnFile, domain_files, foreign_object, own_files, sweep};
pub use peers::{
    NodeHolder, Peers, is_alive, named, payload_of, pid_namespace, pid_of, publisher_of, service_pid, subscribers_of,
};
pub use process::Process;
pub use reader::{IncrementReader, RawReader, Reader};
pub use realtime::{Realtime, RealtimeError, process_kb};
pub use rehearsal::Rehearsal;
pub use resources::{check_descriptors, check_room, note_memory};
pub use source_pulses::SourcePulses;
pub use status::{StatusError, StatusNote, StatusReader, fetch_status};
pub use tap::{Tap, TapSettings, TappedSample};
pub use transport::ports::Payload;
pub use unix_time::{UnixClock, UnixOffset};
