//! There are no signals: who runs the program ends it as a whole, with its files.

use isotherm_support::failure::Failure;

pub(crate) fn hold_signals() {}

/// There is nothing to do.
///
/// # Errors
/// None.
pub fn remove_unfinished_on_signals() -> Result<(), Failure> {
    Ok(())
}

/// There is nothing to do.
pub fn report_file_limit() {}
