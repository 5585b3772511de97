//! The C interface of the client library. Its documentation is `docs/c.md` and the header `client/include/isotherm.h`,
//! which is generated from this crate's comments. The C++ wrapper is `client/include/isotherm.hpp`.
//!
//! Every object that C gets is a [`handle::Handle`]. A call with a handle always returns a code. A handle admits one
//! caller at a time and none in a forked child, and no panic leaves it.
#![allow(
    unsafe_code,
    clippy::missing_safety_doc,
    reason = "C passes pointers; the header's introduction has the rules for them, once for all functions"
)]
#![allow(unreachable_pub, reason = "what is pub is in the header")]

mod acquisition;
mod code;
pub mod flags;
mod handle;
mod lag;
mod reader;
mod readings;
mod thread;
mod values;
