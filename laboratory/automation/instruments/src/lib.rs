//! Temperature chambers and turntables: one trait for each, and the drivers that a configuration can name.
//!
//! Every driver uses a line (module `line`): it sends one request, then waits for the reply or the time-out, and never
//! has two requests under way. An error of an instrument or its line is an [`InstrumentFault`]; its [`FaultKind`]
//! decides how a campaign reacts. A driver repeats a request without a reply, or with a garbled one, up to `retries`
//! times. That is safe because every request is idempotent: it reads, or it sets an absolute value.
//!
//! [`Line::begin_orders`] is for the safe state: the same stop requests of the same drivers then go out at once,
//! without waiting for silence on the line.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_instruments::ChamberConfig;
//! use isotherm_shared::document::Document;
//!
//! let text = "[chamber]\ndriver = \"espec\"\nport = \"/dev/ttyUSB0\"\n";
//! let document = Document::parse(text)?;
//! let root = document.root();
//! let section = root.section("chamber", "[chamber] with driver and port").ok_or("no section")?;
//! let config = ChamberConfig::read(&section);
//! section.finish();
//! root.finish();
//! assert_eq!(document.finish(config)?.line.port, "/dev/ttyUSB0");
//! # Ok(())
//! # }
//! ```

pub mod acutrol;
pub mod aerosmith;
pub mod ascii2;
pub mod config;
pub mod espec;
pub mod f4t;
mod fault;
mod instrument;
mod line;
mod line_config;
mod open;
mod port;
mod reply;
mod surroundings;
mod time;

pub use config::{ChamberConfig, TurntableConfig};
pub use fault::{FaultKind, InstrumentFault};
pub use instrument::{ChamberInstrument, ChamberReading, Instrument, TurntableInstrument, TurntableReading, turn_deg};
pub use isotherm_serial::Parity;
pub use line::Line;
pub use line_config::LineConfig;
pub use open::{chamber, turntable};
pub use port::{PendingPort, Port, Ports, RealPorts};
pub use surroundings::Surroundings;
pub use time::{Moment, RealTime, Time};
