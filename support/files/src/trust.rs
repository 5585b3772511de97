//! Whose file it is that is read.

#[cfg(not(target_os = "wasi"))]
use crate::place::is_trusted;
#[cfg(not(target_os = "wasi"))]
use isotherm_support::failure::shown;
#[cfg(not(target_os = "wasi"))]
use rustix::process::geteuid;
use std::fs::Metadata;
#[cfg(not(target_os = "wasi"))]
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

/// Whose file is read.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Trust {
    /// Of this process's user or of root, and not writable by everybody. For the service: it reloads the file, so a
    /// user who can write or replace it changes what the service does.
    Owned,
    /// Of anybody, but not writable by everybody. For a command that says what a service would take, which may be
    /// another user's.
    Protected,
    /// Any. For a command that reads the file once: its user has chosen the file.
    Any,
}

impl Trust {
    /// [`Owned`](Self::Owned) unless the option `--allow-world-writable` is given.
    #[must_use]
    pub const fn owned_unless(given: bool) -> Self {
        if given { Self::Any } else { Self::Owned }
    }

    /// [`Protected`](Self::Protected) unless the option `--allow-world-writable` is given.
    #[must_use]
    pub const fn protected_unless(given: bool) -> Self {
        if given { Self::Any } else { Self::Protected }
    }

    /// Why the file, which has been opened by this path, is not trusted.
    #[cfg(not(target_os = "wasi"))]
    #[must_use]
    pub fn refusal(self, path: &Path, opened: &Metadata) -> Option<String> {
        let name = shown(path);
        if self != Self::Any && opened.mode() & 0o002 != 0 {
            return Some(format!("everybody may write it; chmod o-w {name}, or give --allow-world-writable"));
        }
        if self != Self::Owned {
            return None;
        }
        // Another user could have made a link to a file that would be trusted by itself.
        let link = std::fs::symlink_metadata(path).ok().filter(Metadata::is_symlink);
        let mut owners = [Some(opened), link.as_ref()].into_iter().flatten().map(Metadata::uid);
        let (foreign, own) = (owners.find(|owner| !is_trusted(*owner))?, geteuid().as_raw());
        Some(format!(
            "it belongs to user {foreign}, who could change what the service does; if it is as it should be, chown -h {own} {name}, \
         or give --allow-world-writable"
        ))
    }

    /// Files of nobody else are there.
    #[cfg(target_os = "wasi")]
    #[must_use]
    pub fn refusal(self, _: &Path, _: &Metadata) -> Option<String> {
        None
    }
}
