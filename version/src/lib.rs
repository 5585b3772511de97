//! What a program of Isotherm was built from, for `--version` and for reports of faults.
//!
//! A crate of its own: every commit builds it anew, and nothing above it but the programs.

/// Version, commit, profile and target, a line each.
pub const LONG_VERSION: &str =
    concat!(env!("CARGO_PKG_VERSION"), "\ncommit: ", env!("ISOTHERM_COMMIT"), "\nbuilt: ", env!("ISOTHERM_BUILT"));
