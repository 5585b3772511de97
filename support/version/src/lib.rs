//! What a program of Isotherm was built from, for `--version` and for bug reports.
//!
//! A separate crate, because every commit rebuilds it: only the packages with programs depend on it, so no other crate
//! is rebuilt.

/// Version; commit; profile and target: one line each.
pub const LONG_VERSION: &str =
    concat!(env!("CARGO_PKG_VERSION"), "\ncommit: ", env!("ISOTHERM_COMMIT"), "\nbuilt: ", env!("ISOTHERM_BUILT"));
