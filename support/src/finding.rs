//! What is found anywhere is a [`Finding`]: a fault or a warning with a name, a place and a message. A name has its
//! meaning and its remedy in [`name`]; [`Admission`] says which findings a user accepts.
//!
//! ```
//! use isotherm_support::finding::{Admission, Finding, Severity, name};
//!
//! let found = vec![
//!     Finding::whole(Severity::Warning, name::MISSING_ROWS, "1.2 % of the rows are missing".to_owned()),
//!     Finding::whole(Severity::Fault, name::INTERVAL, "interval_ns is 1.0213 of the time from row to row".to_owned()),
//! ];
//! let refused = Admission::default().admit(found.clone(), &mut Vec::new());
//! assert!(refused.is_err_and(|findings| findings[0].name == name::INTERVAL)); // faults first
//! let mut accepted = Vec::new();
//! let admission = Admission { accept: &[name::INTERVAL], strict: false };
//! let warnings = admission.admit(found, &mut accepted);
//! assert_eq!((warnings.map(|all| all.len()), accepted), (Ok(2), vec!["interval"]));
//! ```

mod admission;
pub mod name;
mod record;

pub use admission::{Admission, any_fault};
pub use record::{Finding, Location, Record, RunNumber, Severity};
