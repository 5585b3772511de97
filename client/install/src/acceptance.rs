//! What the operator accepts: a table that changes too much, by its digest.
//!
//! Each acceptance is a [`Note`] of its own in the domain's folder, where nobody else can write. Its name,
//! `accepted-IMU.WORD`, is never used again. So a process that has read an acceptance and removes it later removes that
//! one, and none that was written meanwhile, not even one of the same digest.

use isotherm_client::{Domain, ImuId, Note, own_files};
use isotherm_shared::table::Digest;
use std::hash::{BuildHasher as _, RandomState};
use std::io;

/// One table of an IMU that is to be taken although it changes too much.
#[derive(Clone, Debug)]
pub struct Acceptance {
    note: Note,
    digest: Vec<u8>,
}

impl Acceptance {
    /// Accepts the table with this digest, `sha256:` and 64 hexadecimal digits, in the place of what was accepted for
    /// the IMU before.
    ///
    /// # Errors
    /// If it cannot be written into the domain's folder.
    pub fn write(domain: &Domain, imu: &ImuId, digest: &str) -> io::Result<Self> {
        let before = Self::read_all(domain, imu);
        let word = RandomState::new().hash_one(std::process::id());
        let note = Note::new(domain, &format!("{}.{word:016x}", name(imu)));
        note.write(digest.as_bytes())?;
        before.iter().for_each(Self::remove);
        Ok(Self { note, digest: digest.into() })
    }

    /// All that are accepted for an IMU. There are several only if they were written at the same time.
    #[must_use]
    pub fn read_all(domain: &Domain, imu: &ImuId) -> Vec<Self> {
        let prefix = domain.prefix();
        let first = format!("{prefix}{}", name(imu));
        let names = own_files(domain.root_path(), &first).filter_map(|file| {
            let name = file.path.file_name()?.to_str()?.to_owned();
            let word = name.strip_prefix(&first)?;
            is_word(word).then(|| Note::new(domain, &name[prefix.len()..]))
        });
        names.filter_map(|note| note.read().map(|digest| Self { note, digest })).collect()
    }

    /// Whether it is the acceptance of the table with this digest.
    #[must_use]
    pub fn is_of(&self, digest: &Digest) -> bool {
        self.digest.trim_ascii() == digest.to_string().as_bytes()
    }

    /// Removes it. It may be gone already.
    pub fn remove(&self) {
        self.note.remove();
    }
}

/// How the names of the acceptances of an IMU begin. No name of an IMU has a dot.
fn name(imu: &ImuId) -> String {
    format!("accepted-{imu}")
}

/// Whether this is the end of a complete note's name: a dot and 16 hexadecimal digits.
fn is_word(end: &str) -> bool {
    end.strip_prefix('.').is_some_and(|word| word.len() == 16 && word.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digests(domain: &Domain, imu: &ImuId) -> Vec<String> {
        let digests = Acceptance::read_all(domain, imu).into_iter();
        digests.map(|acceptance| String::from_utf8(acceptance.digest).unwrap()).collect()
    }

    #[test]
    fn removing_one_that_was_read_leaves_what_was_written_meanwhile() {
        let folder = tempfile::tempdir().unwrap();
        let domain = Domain::new("acceptance", folder.path().to_str().unwrap()).unwrap();
        let [imu, other] = ["imu-a", "imu-a2"].map(|name| ImuId::new(name).unwrap());
        Acceptance::write(&domain, &imu, "one").unwrap();
        Acceptance::write(&domain, &other, "of another IMU").unwrap();
        for next in ["two", "two", "three"] {
            let seen = Acceptance::read_all(&domain, &imu);
            assert_eq!(seen.len(), 1, "the newest takes the place of the one before");
            Acceptance::write(&domain, &imu, next).unwrap();
            seen.iter().for_each(Acceptance::remove);
            assert_eq!(digests(&domain, &imu), [next]);
        }
        assert_eq!(digests(&domain, &other), ["of another IMU"]);
    }

    #[test]
    fn half_a_note_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let domain = Domain::new("acceptance", folder.path().to_str().unwrap()).unwrap();
        let imu = ImuId::new("imu-a").unwrap();
        for name in ["accepted-imu-a.0123456789abcdef.4711", "accepted-imu-a.4711", "accepted-imu-a-b"] {
            Note::new(&domain, name).write(b"none").unwrap();
        }
        assert!(digests(&domain, &imu).is_empty());
        Acceptance::write(&domain, &imu, "new").unwrap();
        assert_eq!(digests(&domain, &imu), ["new"]);
    }
}
