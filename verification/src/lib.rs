//! What a table is worth on a recording that it was not made from: the stability of its output, what that allows to be claimed, what is
//! required, and the gate that decides whether a new table replaces the one in force.
//!
//! This crate opens no file: a caller gives rows and tables.

pub mod gate;
pub mod lengths;
pub mod requirement;
pub mod stability;
pub mod verdict;
pub mod window;
