//! What every crate of Isotherm says in the same way: how a program fails ([`failure`]), what is found in data
//! ([`finding`]), and where long work can be watched and ended ([`checkpoint`](checkpoint::checkpoint)); and what takes
//! the place of files where none are opened: [`source`] and [`storage`].

pub mod checkpoint;
pub mod failure;
pub mod finding;
pub mod source;
pub mod storage;
