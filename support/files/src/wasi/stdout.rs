//! Standard output is always there.

use std::io;

/// There is nothing to check.
///
/// # Errors
/// None.
pub fn check_stdout() -> io::Result<()> {
    Ok(())
}
