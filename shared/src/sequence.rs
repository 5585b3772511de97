//! The order of the samples of a session: one rule for what an acquisition sends and for what a recording has.

/// Whether a sample with this `sequence` may follow the sample `last` of its session; with `None` it is the session's first.
///
/// The first sample may have any sequence, each later one a higher one. Every number of 64 bits is a sequence, the highest too;
/// after the highest a new session must begin, since sequences do not wrap.
#[inline]
#[must_use]
pub const fn rises(last: Option<u64>, sequence: u64) -> bool {
    match last {
        Some(last) => sequence > last,
        None => true,
    }
}

#[cfg(test)]
mod tests {
    use super::rises;

    #[test]
    fn any_first_sequence_then_only_higher_ones_up_to_the_highest() {
        for first in [0, 1, u64::MAX] {
            assert!(rises(None, first));
        }
        assert!(rises(Some(0), 1) && rises(Some(0), u64::MAX) && rises(Some(u64::MAX - 1), u64::MAX));
        for (last, sequence) in [(0, 0), (5, 4), (u64::MAX, 0), (u64::MAX, u64::MAX)] {
            assert!(!rises(Some(last), sequence), "{sequence} after {last}");
        }
    }
}
