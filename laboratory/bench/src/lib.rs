//! The automatic campaign on a virtual clock, for tests: the runner itself, real drivers, and a simulated station of
//! which nothing waits. One seed gives one course of everything, byte by byte.
//!
//! There is one thread. Time passes where somebody waits: a sleep, a read or a write of a port. The two instruments do
//! not know each other; so what the runner does [`both`](isotherm_instruments::Time::both) at once happens one after
//! the other, and the clock goes back between.

// What cannot be set up ends a test.
#![allow(clippy::panic)]

mod campaign;
mod faults;
mod found;
mod invariants;
mod script;
mod setup;
mod world;

pub use campaign::{Campaign, CampaignEnd};
pub use faults::{DrawnFault, FaultPlan};
pub use found::{assert_units, events_on_page};
pub use invariants::violations;
pub use script::{ScriptAction, ScriptStep, Trigger};
pub use setup::{GYROSCOPES, Setup, linear};
pub use world::{Request, VirtualWorld};
