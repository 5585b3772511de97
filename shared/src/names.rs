//! Names: of IMUs, of their streams, and of the domain that processes belong to.

use core::fmt;
use sha2::{Digest as _, Sha256};

/// Length limit of IMU and domain names.
pub const MAX_NAME: usize = 32;

/// One of an IMU's two streams of samples.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum StreamKind {
    /// Raw samples.
    Raw,
    /// Compensated increments.
    Increment,
}

impl StreamKind {
    /// Both streams.
    pub const BOTH: [Self; 2] = [Self::Raw, Self::Increment];

    /// The last part of the stream's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Increment => "increment",
        }
    }
}

/// Rule for the names of IMUs and domains, as text for messages.
pub const NAME_RULE: &str = "1 to 32 of a-z 0-9 - _";

/// The name of an IMU; follows [`NAME_RULE`].
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_shared::names::ImuId;
///
/// let imu: ImuId = "imu-a".parse()?;
/// assert_eq!(imu.as_str(), "imu-a");
/// assert_eq!(ImuId::new("IMU A"), None); // 1 to 32 of a-z 0-9 - _
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct ImuId(String);

impl ImuId {
    /// `None` unless `name` follows [`NAME_RULE`].
    #[must_use]
    pub fn new(name: &str) -> Option<Self> {
        is_name(name).then(|| Self(name.to_owned()))
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for ImuId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl core::str::FromStr for ImuId {
    type Err = InvalidName;
    fn from_str(name: &str) -> Result<Self, InvalidName> {
        Self::new(name).ok_or_else(|| InvalidName(name.to_owned()))
    }
}

/// A name that does not follow [`NAME_RULE`].
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
#[error("{0:?} is not a valid name; give {NAME_RULE}")]
pub struct InvalidName(pub String);

fn is_name(name: &str) -> bool {
    let valid = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-' || byte == b'_';
    (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(valid)
}

/// Separates one service and its clients from others: processes communicate only within one domain.
///
/// A domain is a name prefix for all shared memory objects, and a folder for the transport's files. A peer that does
/// not use this crate sets both in its iceoryx2 configuration; `isotherm status --json` prints them.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Domain {
    name: String,
    root: String,
}

/// Longest path of the root folder \[bytes\]: the operating system limits the paths of the sockets in it.
pub const MAX_ROOT: usize = 52;

impl Domain {
    /// Name of the domain if none is given.
    pub const DEFAULT: &'static str = "default";

    /// `name` follows [`NAME_RULE`]; `root` is the folder for the files of this domain only.
    ///
    /// # Errors
    /// [`DomainError`] for an invalid name, or a folder that is not absolute or longer than [`MAX_ROOT`].
    pub fn new(name: &str, root: &str) -> Result<Self, DomainError> {
        if !is_name(name) {
            return Err(DomainError::Name(InvalidName(name.to_owned())));
        }
        if !root.starts_with('/') || root.len() > MAX_ROOT || root.contains('\0') {
            return Err(DomainError::Root(root.to_owned()));
        }
        Ok(Self { name: name.to_owned(), root: root.to_owned() })
    }

    /// The domain's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Prefix of all shared memory objects of this domain: `isotherm_`, the first 8 hexadecimal digits of the SHA-256
    /// of the folder's path, and `_`. So it is short for every name, is not a prefix of another domain's prefix, and
    /// differs for the same name under another folder.
    #[must_use]
    pub fn prefix(&self) -> String {
        let digest = Sha256::digest(&self.root);
        let digits: String = digest.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
        format!("isotherm_{digits}_")
    }

    /// Folder of all files of this domain.
    #[must_use]
    pub fn root_path(&self) -> &str {
        &self.root
    }
}

/// Why a domain cannot be used.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub enum DomainError {
    /// The name does not follow [`NAME_RULE`].
    #[error("domain: {0}")]
    Name(InvalidName),
    /// The folder cannot be used.
    #[error(
        "domain: the folder {0:?} must be absolute and at most {MAX_ROOT} characters; set ISOTHERM_ROOT to a shorter one"
    )]
    Root(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked() {
        for name in ["a", "imu-a_2", "0123456789abcdefghijklmnopqrstuv"] {
            assert_eq!(ImuId::new(name).unwrap().as_str(), name);
        }
        for name in ["", "IMU", "a/b", "a b", "\u{e4}", "0123456789abcdefghijklmnopqrstuvw"] {
            assert_eq!(ImuId::new(name), None, "{name}");
            assert!(Domain::new(name, "/tmp").is_err());
        }
        assert!(matches!(Domain::new("x", "relative"), Err(DomainError::Root(_))));
        assert!(matches!(Domain::new("x", &format!("/{}", "r".repeat(60))), Err(DomainError::Root(_))));
        let prefix = |name: &str, root: &str| Domain::new(name, root).unwrap().prefix();
        assert_eq!(prefix("x", "/tmp/x").len(), "isotherm_01234567_".len());
        assert_ne!(prefix("x", "/tmp/x"), prefix("x", "/run/x"));
        assert_ne!(prefix("x", "/tmp/x"), prefix("x_y", "/tmp/x_y"));
    }
}
