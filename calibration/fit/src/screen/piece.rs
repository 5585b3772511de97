//! The rows of one channel that are judged together.

/// Rows of one channel without a gap between them.
pub(super) struct Piece<'a> {
    /// \[s\]
    pub times: &'a [f64],
    pub values: &'a [f64],
    /// Values that differ by no more are equal.
    pub tolerance: f64,
    /// Rows that are bad already.
    pub is_known: &'a [bool],
    pub is_thermometer: bool,
}
