//! The digest of a table.

use core::fmt;

/// SHA-256 of a table's canonical form.
#[derive(Clone, Copy, Eq, PartialEq)]
pub struct Digest(pub(super) [u8; 32]);

impl Digest {
    /// The first 8 bytes, big-endian.
    #[must_use]
    pub fn id(&self) -> u64 {
        self.0.iter().take(8).fold(0, |id, &byte| id << 8 | u64::from(byte))
    }
}

/// `sha256:` and 64 hexadecimal digits.
impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("sha256:")?;
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}
