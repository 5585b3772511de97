//! The C interface of the client library. Its documentation is the header that is made of this crate's comments,
//! `client/include/isotherm.h`, and `docs/c.md`; the C++ wrapper is `client/include/isotherm.hpp`.
//!
//! Everything that C holds is a [`handle::Handle`]: it answers with a code whatever it is asked, lets one caller in at a time, none
//! in a forked child, and no panic out.
#![allow(
    unsafe_code,
    clippy::missing_safety_doc,
    reason = "C hands over pointers; what it must keep to is in the header's introduction, once for all functions"
)]

mod acquisition;
mod code;
pub mod flags;
mod handle;
mod reader;
mod thread;
mod values;
