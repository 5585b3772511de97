//! Watching table files and deciding when one is to be loaded.
//!
//! The folder of each table is watched, which sees a file renamed over it, written in place, removed and created again,
//! or a symbolic link switched; a look at the file every [`TICK`] sees the rest (a folder further up exchanged, a link's
//! target written, a file system that does not notify). A file that was renamed or closed is loaded at once; one that is
//! just seen to differ, or that is not good, must have stayed the same for [`SETTLE`] first: its writer may not be done.

use isotherm_files::{Guard, Identity, LoadError, load_table};
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::CoefficientTable;
use notify::event::{AccessKind, AccessMode, EventKind, ModifyKind};
use notify::{Event, RecommendedWatcher, RecursiveMode, Watcher as _};
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How often every table file is looked at.
pub const TICK: Duration = Duration::from_millis(50);
/// How long a file that was not closed or renamed must stay the same.
pub const SETTLE: Duration = Duration::from_millis(150);
/// How long a file may be away before that is reported.
pub const ABSENCE: Duration = Duration::from_secs(1);

/// Watches the folders of `paths` and tells `on_complete` the name of every file of theirs that was renamed or closed after
/// writing. The second part of the result says which folders could not be watched; the look every [`TICK`] still works.
pub fn watch(
    paths: &[PathBuf],
    on_complete: impl Fn(OsString) + Send + 'static,
) -> (Option<RecommendedWatcher>, Vec<String>) {
    let names: BTreeSet<OsString> = paths.iter().filter_map(|path| path.file_name()).map(OsStr::to_owned).collect();
    let handler = move |event: notify::Result<Event>| {
        let Ok(event) = event else { return };
        if matches!(
            event.kind,
            EventKind::Access(AccessKind::Close(AccessMode::Write)) | EventKind::Modify(ModifyKind::Name(_))
        ) {
            let touched = event.paths.iter().filter_map(|path| path.file_name());
            touched.filter(|name| names.contains(*name)).for_each(|name| on_complete(name.to_owned()));
        }
    };
    let mut watcher = match notify::recommended_watcher(handler) {
        Ok(watcher) => watcher,
        Err(error) => return (None, vec![error.to_string()]),
    };
    let folder = |path: &PathBuf| match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let mut failures = Vec::new();
    for folder in paths.iter().map(folder).collect::<BTreeSet<_>>() {
        if let Err(error) = watcher.watch(&folder, RecursiveMode::NonRecursive) {
            failures.push(format!("{}: {error}", folder.display()));
        }
    }
    (Some(watcher), failures)
}

/// The file of one IMU's table.
#[derive(Debug)]
pub struct TableFile {
    imu: ImuId,
    path: PathBuf,
    guard: Guard,
    /// The state that was loaded or refused last.
    seen: Option<Identity>,
    /// A new state and since when it has been seen.
    candidate: Option<(Option<Identity>, Instant)>,
}

/// What was found at a table's file.
#[derive(Debug)]
pub enum FileChange {
    /// Nothing new, or not yet complete.
    Unchanged,
    /// A valid table.
    Loaded(Box<CoefficientTable>),
    /// Something that is no table for this IMU, or nothing.
    Refused(LoadError),
}

impl TableFile {
    /// The file of `imu`'s table, not looked at yet.
    pub const fn new(imu: ImuId, path: PathBuf, guard: Guard) -> Self {
        Self { imu, path, guard, seen: None, candidate: None }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// When the file that was loaded or refused last was changed, in seconds of Unix time.
    pub fn modified_unix_s(&self) -> Option<f64> {
        self.seen.map(|seen| seen.modified_unix_s())
    }

    /// Loads the file as it is.
    pub fn load(&mut self) -> FileChange {
        self.candidate = None;
        self.seen = Identity::of(&self.path);
        match load_table(&self.path, Some(&self.imu), self.guard) {
            Ok((table, identity)) => {
                self.seen = Some(identity);
                FileChange::Loaded(Box::new(table))
            }
            Err(error) => FileChange::Refused(error),
        }
    }

    /// Loads the file because it is said to be complete. If it is not good after all, another writer may be at it: that is
    /// for [`look`](Self::look) to find out.
    pub fn load_complete(&mut self, now: Instant) -> FileChange {
        let (seen, current) = (self.seen, Identity::of(&self.path));
        match self.load() {
            FileChange::Refused(_) => {
                self.seen = seen;
                self.candidate = Some((current, now));
                FileChange::Unchanged
            }
            look => look,
        }
    }

    /// Looks whether the file has changed, and loads it if it has and is at rest.
    pub fn look(&mut self, now: Instant) -> FileChange {
        let current = Identity::of(&self.path);
        if current == self.seen {
            self.candidate = None;
            return FileChange::Unchanged;
        }
        let since = match self.candidate {
            Some((candidate, since)) if candidate == current => since,
            _ => now,
        };
        self.candidate = Some((current, since));
        let patience = if current.is_none() { ABSENCE } else { SETTLE };
        if now.duration_since(since) < patience { FileChange::Unchanged } else { self.load() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const TABLE: &str = include_str!("../../tests/data/imu-a.toml");

    fn file(folder: &tempfile::TempDir) -> TableFile {
        let path = folder.path().join("imu-a.toml");
        fs::write(&path, TABLE).unwrap();
        let mut file = TableFile::new(ImuId::new("imu-a").unwrap(), path, Guard::Strict);
        assert!(matches!(file.load(), FileChange::Loaded(_)));
        file
    }

    #[test]
    fn a_change_without_a_close_must_settle() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = file(&folder);
        let start = Instant::now();
        assert!(matches!(file.look(start), FileChange::Unchanged));
        fs::write(file.path(), TABLE.replace("9.8015", "9.8016")).unwrap();
        assert!(matches!(file.look(start), FileChange::Unchanged));
        fs::write(file.path(), TABLE.replace("9.8015", "9.80171")).unwrap();
        assert!(matches!(file.look(start + SETTLE), FileChange::Unchanged), "it has changed again");
        let FileChange::Loaded(table) = file.look(start + 2 * SETTLE) else { panic!("settled") };
        assert_eq!(table.content().gravity, 9.80171);
        assert!(matches!(file.look(start + 9 * SETTLE), FileChange::Unchanged));
    }

    #[test]
    fn a_complete_file_is_loaded_at_once_and_a_bad_one_reported_once_when_at_rest() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = file(&folder);
        let now = Instant::now();
        fs::write(folder.path().join("new"), "format = 2\n").unwrap();
        fs::rename(folder.path().join("new"), file.path()).unwrap();
        assert!(matches!(file.load_complete(now), FileChange::Unchanged), "somebody may still be writing");
        assert!(matches!(file.look(now + SETTLE), FileChange::Refused(_)));
        assert!(matches!(file.look(now + 9 * SETTLE), FileChange::Unchanged));
        fs::remove_file(file.path()).unwrap();
        assert!(matches!(file.look(now), FileChange::Unchanged), "it may come back");
        assert!(matches!(file.look(now + ABSENCE), FileChange::Refused(LoadError::Io { .. })));
        assert!(matches!(file.look(now + 2 * ABSENCE), FileChange::Unchanged));
        fs::write(file.path(), TABLE).unwrap();
        assert!(matches!(file.load_complete(now), FileChange::Loaded(_)));
    }

    #[test]
    fn only_a_tables_own_file_is_said_to_be_complete() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("imu-a.toml");
        let (sender, told) = std::sync::mpsc::channel();
        let absent = folder.path().join("absent").join("imu-b.toml");
        let (_watcher, failures) = watch(&[absent, table.clone()], move |name| sender.send(name).unwrap());
        assert_eq!(failures.len(), 1, "one folder is missing, the other is watched all the same: {failures:?}");
        let mut half = fs::File::create(&table).unwrap();
        std::io::Write::write_all(&mut half, TABLE.as_bytes()).unwrap();
        fs::write(folder.path().join("other.toml"), TABLE).unwrap();
        fs::rename(folder.path().join("other.toml"), folder.path().join("third.toml")).unwrap();
        let marker = folder.path().join("marker");
        fs::write(&marker, TABLE).unwrap();
        fs::rename(&marker, &table).unwrap();
        // Events come in order: had another file's been passed on, it would be first.
        assert_eq!(told.recv_timeout(Duration::from_secs(20)).unwrap(), "imu-a.toml");
        drop(half);
    }
}
