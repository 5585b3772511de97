//! Who can have put what is at a path. Every output goes through here before something is made or written.
//!
//! The folder decides. Only this user and root may write in most folders, and whom they have let into the group: there
//! a link is followed, a pipe is written. In a folder that everybody may write and that has the sticky bit, such as
//! `/tmp`, nobody can replace an entry of this user or root; an entry of somebody else is refused. In any other folder
//! others can replace every entry at any moment: there only regular files are replaced, by renaming, and nothing is
//! opened that was there before.

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;
use rustix::process::geteuid;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// Permission to write for everybody.
const EVERYBODY: u32 = 0o002;
/// Only the owner of an entry, or of the folder, may rename or remove it.
const STICKY: u32 = 0o1000;
/// Limit of links that lead to each other, as in Linux.
const MAX_LINKS: usize = 40;

/// The folder of a file; `.` for only a name.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether what this user owns belongs to somebody whom this process trusts: its own user, or root.
pub(crate) fn is_trusted(owner: u32) -> bool {
    [geteuid().as_raw(), 0].contains(&owner)
}

/// What kind of object it is, for a message.
pub(crate) fn kind_of(found: &Metadata) -> &'static str {
    let kind = found.file_type();
    match () {
        () if kind.is_file() => "file",
        () if kind.is_symlink() => "link",
        () if kind.is_dir() => "folder",
        () if kind.is_fifo() => "pipe",
        () => "device or socket",
    }
}

/// Who else may make entries in a folder.
enum FolderAccess {
    /// Nobody but this user and root, and whom they have let into the group.
    Own,
    /// Everybody, and each removes his own only.
    Sticky,
    /// Its owner, another user.
    Other(u32),
    /// Everybody, and each may replace all.
    Everybody,
}

impl FolderAccess {
    fn of(folder: &Metadata) -> Self {
        let (mode, own) = (folder.mode(), is_trusted(folder.uid()));
        match mode & EVERYBODY != 0 {
            false if own => Self::Own,
            false => Self::Other(folder.uid()),
            true if own && mode & STICKY != 0 => Self::Sticky,
            true => Self::Everybody,
        }
    }
}

/// Checks what is at `path`, where something is to be written. Returns whether it is a link to follow.
fn check(path: &Path) -> io::Result<bool> {
    let (Ok(folder), Ok(entry)) = (fs::metadata(folder_of(path)), fs::symlink_metadata(path)) else {
        return Ok(false);
    };
    let (owner, kind) = (entry.uid(), kind_of(&entry));
    let refused = |who: &str| {
        let message = format!("{who}; have it removed, or name another file");
        Err(io::Error::other(message))
    };
    let everybody = || refused(&format!("it belongs to user {owner}, and everybody may make one there"));
    let access = FolderAccess::of(&folder);
    match access {
        FolderAccess::Sticky | FolderAccess::Everybody if !is_trusted(owner) => everybody(),
        FolderAccess::Own | FolderAccess::Sticky => Ok(entry.is_symlink()),
        _ if entry.is_file() || entry.is_dir() => Ok(false),
        FolderAccess::Other(user) => refused(&format!("it is a {kind} in a folder of user {user}")),
        FolderAccess::Everybody => refused(&format!("it is a {kind}, and everybody may put one there")),
    }
}

/// Where something is written that is to be found at `path`: through links that this user or root has made, where
/// nobody else could make or replace them. What is there, if anything, is no link, and no other user has put it into
/// the way.
///
/// # Errors
/// If another user has, or can have.
pub fn output_place(path: &Path) -> io::Result<PathBuf> {
    let mut place = path.to_owned();
    for _ in 0..MAX_LINKS {
        if !check(&place)? {
            return Ok(place);
        }
        let target = place.parent().unwrap_or(Path::new("")).join(fs::read_link(&place)?);
        // What a link of /proc/self/fd names need not be a path, as for a pipe.
        if fs::symlink_metadata(&target).is_err() && fs::metadata(&place).is_ok() {
            return Ok(place);
        }
        place = target;
    }
    Err(Errno::LOOP.into())
}

/// Makes the folder `path` for results, and those above it, unless it is there. Each file in it still has to be judged.
///
/// # Errors
/// As [`output_place`], and if it cannot be made.
pub fn create_folder(path: &Path) -> io::Result<()> {
    fs::create_dir_all(output_place(path)?)
}

/// As [`create_folder`], for a folder whose files are written in their place, over and over: nobody else may make
/// entries in it.
///
/// # Errors
/// As [`create_folder`], and if it belongs to another user, or everybody may write it.
pub fn create_own_folder(path: &Path) -> io::Result<()> {
    create_folder(path)?;
    check_own_folder(path)
}

/// Checks that nobody else may make entries in the folder `path`.
///
/// # Errors
/// If it belongs to another user than this one and root, or everybody may write it, or it cannot be looked at.
pub fn check_own_folder(path: &Path) -> io::Result<()> {
    let found = fs::metadata(output_place(path)?)?;
    let message = match FolderAccess::of(&found) {
        FolderAccess::Own => return Ok(()),
        FolderAccess::Other(user) => format!("it belongs to user {user}; name a folder of your own"),
        FolderAccess::Sticky | FolderAccess::Everybody => {
            "everybody may write it; chmod o-w it, or name another folder".to_owned()
        }
    };
    Err(io::Error::other(message))
}

/// The one name of what is at a path.
///
/// # Errors
/// Those of the operating system, where there is nothing.
pub(crate) fn canonical(path: &Path) -> io::Result<PathBuf> {
    fs::canonicalize(path)
}

/// Opens a file for reading. Where the path is a pipe, it does not wait for a writer.
///
/// # Errors
/// If it cannot be opened.
pub fn open_without_waiting(path: &Path) -> io::Result<File> {
    OpenOptions::new().read(true).custom_flags(libc::O_NONBLOCK).open(path)
}

/// Waits until the names in the folder of `path` are on the disk: after a rename that makes something lasting.
///
/// # Errors
/// If the disk fails or is full. A folder that this user may not read, and a file system that cannot do it, are none.
pub fn sync_folder(path: &Path) -> io::Result<()> {
    let Ok(folder) = File::open(folder_of(path)) else { return Ok(()) };
    match folder.sync_all() {
        Err(error) if is_failure(&error) => Err(error),
        _ => Ok(()),
    }
}

fn is_failure(error: &io::Error) -> bool {
    let errno = Errno::from_io_error(error);
    errno.is_some_and(|errno| [Errno::IO, Errno::NOSPC, Errno::DQUOT, Errno::ROFS].contains(&errno))
}

/// Gives a file another name, in the same folder, and waits until that is on the disk.
///
/// # Errors
/// If it cannot be renamed; and as [`sync_folder`], after it has been renamed.
pub(crate) fn rename(from: &Path, to: &Path) -> io::Result<()> {
    fs::rename(from, to)?;
    sync_folder(to)
}

/// Exchanges two files of a folder in one step; `false` if the file system cannot. [`sync_folder`] makes it last.
///
/// # Errors
/// If they cannot be exchanged.
pub(crate) fn exchange(one: &Path, other: &Path) -> io::Result<bool> {
    match renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE) {
        Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => Ok(false),
        exchanged => Ok(exchanged.map(|()| true)?),
    }
}

/// Where `path` leads, for a message: through symbolic links to their target, which need not exist. The path itself
/// where nothing would be written.
#[must_use]
pub fn target_of(path: &Path) -> PathBuf {
    output_place(path).unwrap_or_else(|_| path.to_owned())
}
