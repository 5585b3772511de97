//! Whose file it is that is read.

use crate::load::Trust;
use crate::place::is_trusted;
use isotherm_support::failure::shown;
use rustix::process::geteuid;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

/// Why the file, which has been opened by this path, is not trusted.
pub(crate) fn refusal(trust: Trust, path: &Path, opened: &Metadata) -> Option<String> {
    let name = shown(path);
    if trust != Trust::Any && opened.mode() & 0o002 != 0 {
        return Some(format!("everybody may write it; chmod o-w {name}, or give --allow-world-writable"));
    }
    if trust != Trust::Owned {
        return None;
    }
    // Another user could have made a link to a file that would be trusted by itself.
    let link = fs::symlink_metadata(path).ok().filter(Metadata::is_symlink);
    let mut owners = [Some(opened), link.as_ref()].into_iter().flatten().map(Metadata::uid);
    let (foreign, own) = (owners.find(|owner| !is_trusted(*owner))?, geteuid().as_raw());
    Some(format!(
        "it belongs to user {foreign}, who could change what the service does; if it is as it should be, chown -h {own} {name}, \
         or give --allow-world-writable"
    ))
}
