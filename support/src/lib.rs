//! What every crate of Isotherm says in the same way: how a program fails ([`failure`]), and what is found in data
//! ([`finding`]); and what takes the place of files where none are opened: [`source`] and [`storage`].

pub mod failure;
pub mod finding;
pub mod source;
pub mod storage;
