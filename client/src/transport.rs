//! The streams of Isotherm on iceoryx2: their names and settings, and the parts of the transport that are ours.
//!
//! [`Acquisition`](crate::Acquisition) and the readers are what a program uses. This module is for programs that are
//! part of Isotherm, and for peers that open the streams by themselves.

pub mod nodes;
pub mod own_static;
pub mod own_storage;
pub mod ports;
pub mod recycled;
pub mod stream;
