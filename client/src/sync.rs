//! The atomics that threads of Isotherm share.
//!
//! They are the standard ones. A build with `--cfg isotherm_loom` has others of the same names, so that the very code
//! that flies is explored under weak memory: within `explore`, loom tries every order of the threads' operations, and
//! every value that the memory model of C++20 allows a load to give. Then `explore` weakens each ordering that it has
//! met to `Relaxed`, one at a time, and returns which of them let it find a fault: the code needs these.
//!
//! ```text
//! RUSTFLAGS="--cfg isotherm_loom" CARGO_TARGET_DIR=target/loom cargo test --lib explored \
//!     -p isotherm-client -p isotherm-client-c -p isotherm-service
//! ```

#[cfg(not(isotherm_loom))]
pub use core::cell::UnsafeCell;
#[cfg(not(isotherm_loom))]
pub use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU64};

#[cfg(isotherm_loom)]
mod explored;
#[cfg(isotherm_loom)]
pub use explored::{AtomicBool, AtomicU8, AtomicU64, Exploration, UnsafeCell, explore};
#[cfg(isotherm_loom)]
pub use loom::thread;
