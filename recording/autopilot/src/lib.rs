//! PX4 and ArduPilot: coefficient tables as their temperature parameters, and back; and their [`logs`].
//!
//! # Formulas
//! Both firmwares subtract a polynomial of order 3 of the temperature T \[degC\], clamped to a range, from readings in
//! m/s2 and rad/s. With a bias `b(T) = a0 + a1 (T - T0) + a2 (T - T0)^2 + a3 (T - T0)^3` and `h = 35 degC - T0`
//!
//! ```text
//! PX4        reading - (X0 + X1 d + X2 d^2 + X3 d^3)               d = T - TREF
//!            TREF = T0, Xk = a_k
//! ArduPilot  reading - (p(T) - p(CALTEMP)) - OFFS                  p(T) = 1e-6 (c1 t + c2 t^2 + c3 t^3), t = T - 35
//!            c1 = 1e6 (a1 + 2 a2 h + 3 a3 h^2), c2 = 1e6 (a2 + 3 a3 h), c3 = 1e6 a3
//!            OFFS = b(CALTEMP), if a CALTEMP is asked for
//! ```
//! Isotherm subtracts a bias, too: the signs agree. The axes X, Y, Z are A1, A2, A3 and G1, G2, G3.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_autopilot::{Autopilot, ExportOptions, ImportOptions, export, import};
//! use isotherm_shared::table::STANDARD_GRAVITY;
//!
//! let options = ImportOptions {
//!     autopilot: Autopilot::Px4,
//!     instance: None,
//!     imu: "imu-a".parse()?,
//!     interval_ns: 2_500_000,
//!     gravity: STANDARD_GRAVITY, // m/s2
//! };
//! let table = import(include_str!("../tests/data/full.params"), &options)?;
//! let options = ExportOptions { at_c: Some(25.0), ..ExportOptions::new(Autopilot::ArduPilot) };
//! let exported = export(&table, &options)?;
//! assert!(exported.text.starts_with("INS_TCAL1_ENABLE 1\nINS_TCAL1_TMIN -17.603062"));
//! assert!(exported.lost.is_empty() && exported.difference.accelerometers < 2e-7); // m/s2
//! # Ok(())
//! # }
//! ```

mod ardupilot;
mod autopilot;
mod curve;
mod effect;
mod export;
mod firmware;
mod import;
mod lines;
pub mod logs;
mod number;
mod parameters;
mod px4;
mod triad;
mod vehicle;

pub use autopilot::{Autopilot, InstanceError};
pub use curve::HIGHEST_ORDER;
pub use effect::{Effect, EffectLoss};
pub use export::{Difference, ExportError, ExportOptions, ExportedParameters, export};
pub use firmware::{ARDUPILOT_REFERENCE, ArduPilotTriad, Constants, Px4Triad};
pub use import::{ImportError, ImportOptions, import};
pub use number::size;
pub use parameters::{Parameters, ReadError};
pub use vehicle::vehicle;
