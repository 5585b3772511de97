//! What every crate of Isotherm says in the same way: how a program fails ([`failure`]), and what is found in data
//! ([`finding`]).

pub mod failure;
pub mod finding;
