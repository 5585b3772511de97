//! What the Isotherm service, its clients and its offline tools share.
//!
//! # Primer
//! An IMU has three accelerometers, A1, A2, A3, and often three gyroscopes, G1, G2, G3, of any technology: from quartz
//! flexure accelerometers to MEMS, whose readings are turned into pulses. Each sensor delivers **pulses** on two
//! channels, one for each sign, and two **temperatures**. For an accelerometer the temperature of the sensor head
//! drives the **bias** A \[g0\]; the temperature of the converter board drives the **scale factors** K+ > 0 and K- < 0
//! \[pulse/(s*g0)\]. All three are polynomials of the temperature, kept in a
//! [`CoefficientTable`](table::CoefficientTable). Over a control period Ts \[s\]
//!
//! ```text
//! dv = |g0| * ( N+/K+(U_board) + N-/K-(U_board) - A(U_head) * Ts )                 [m/s]
//! ```
//! is the **velocity increment** along the sensor's input axis (at rest, an axis that points up gives +|g| * Ts); with
//! an alignment matrix it is along the body's axes. The angle increment of a gyroscope has an equation of the same
//! form, with a g-sensitivity. Only [`compensate`](mod@compensate) implements this equation: the service, the replay
//! and the tests all call it, so they cannot disagree.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_shared::{compensate::answer, table::CoefficientTable, wire::RawSample};
//!
//! let table = CoefficientTable::from_toml(include_str!("../../tests/data/imu-a.toml"), None)?;
//! let mut raw = RawSample { interval_ns: 2_500_000, ..RawSample::default() };
//! raw.accelerometers.positive_pulses = [4, 0, 234];
//! raw.accelerometers.negative_pulses = [0, 204, 0];
//! raw.accelerometers.head_temperature = [1.099949, 1.111955, 1.123814]; // V
//! raw.accelerometers.board_temperature = [1.180102, 1.171937, 1.163957];
//! let increment = answer(Some(&table), &raw);
//! assert!((increment.velocity_increment[2] - 0.024_500_236_531).abs() < 1e-12); // m/s
//! assert_eq!((increment.table, increment.flags), (table.id(), 0));
//! # Ok(())
//! # }
//! ```
//!
//! An acquisition process sends [`RawSample`](wire::RawSample)s, and the service answers with
//! [`CompensatedIncrement`](wire::CompensatedIncrement)s. [`names`] has the names of IMUs, streams and domains,
//! [`document`] reads files, and [`status`] is the document that describes the running service.
//!
//! This crate opens no file, starts no thread and asks no clock. It knows nothing of the transport: the streams are in
//! `isotherm-client`.

pub mod bounds;
pub mod compensate;
pub mod content;
pub mod document;
mod kernel;
pub mod kind;
pub mod lag;
pub mod names;
pub mod nominal;
pub mod polynomial;
pub mod protocol;
pub mod readings;
pub mod sequence;
pub mod status;
pub mod table;
pub mod time_constant;
pub mod units;
pub mod wire;
