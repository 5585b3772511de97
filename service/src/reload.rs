//! Watches table files and decides when to load one.
//!
//! The folder of each table is watched. The watch reports a file that is renamed over the table, written in place, or
//! removed and created again, and a symbolic link that is switched. Polling the file every [`TICK`] finds the other
//! changes: an exchanged parent folder, a written link target, a file system without notifications.
//!
//! A file that was renamed or closed after writing is loaded at once. A file that only differs, or that is not valid,
//! must first stay unchanged for [`SETTLE`]: its writer may not have finished.

use isotherm_files::{Identity, LoadError, Trust, load_table};
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::CoefficientTable;
use notify::event::{AccessKind, AccessMode, EventKind, ModifyKind};
use notify::{Event, RecommendedWatcher, RecursiveMode, Watcher as _};
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How often every table file is polled.
pub(crate) const TICK: Duration = Duration::from_millis(50);
/// How long a file that was not closed or renamed must stay unchanged.
pub(crate) const SETTLE: Duration = Duration::from_millis(150);
/// How long a file may be missing before that is reported.
pub(crate) const ABSENCE: Duration = Duration::from_secs(1);

/// Watches the folders of `paths`. Calls `on_complete` with the name of each of these files that was renamed or closed
/// after writing. The second part of the result names the folders that could not be watched; their files are still
/// polled every [`TICK`].
pub(crate) fn watch(
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
pub(crate) struct TableFile {
    imu: ImuId,
    path: PathBuf,
    trust: Trust,
    /// The state that was last loaded or refused.
    handled: Option<Identity>,
    /// A new state, and when it was first found.
    candidate: Option<(Option<Identity>, Instant)>,
}

/// The result of checking a table's file.
#[derive(Debug)]
pub(crate) enum FileChange {
    /// No new state, or a new one that may not be complete.
    Unchanged,
    /// A valid table.
    Loaded(Box<CoefficientTable>),
    /// The file is not a valid table for this IMU, or is missing.
    Refused(LoadError),
}

impl TableFile {
    /// The file of `imu`'s table; it is not read yet.
    pub(crate) const fn new(imu: ImuId, path: PathBuf, trust: Trust) -> Self {
        Self { imu, path, trust, handled: None, candidate: None }
    }

    /// The path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// When the file that was last loaded or refused was changed, Unix time \[s\].
    pub(crate) fn modified_unix_s(&self) -> Option<f64> {
        self.handled.map(|state| state.modified_unix_s())
    }

    /// Loads the file as it is now.
    ///
    /// # Errors
    /// Why it is no valid table for this IMU.
    pub(crate) fn load(&mut self) -> Result<Box<CoefficientTable>, LoadError> {
        self.candidate = None;
        self.handled = Identity::of(&self.path);
        let (table, identity) = load_table(&self.path, Some(&self.imu), self.trust)?;
        self.handled = Some(identity);
        Ok(Box::new(table))
    }

    /// Loads the file after an event that says that it is complete. If it is not valid, another process may be writing
    /// it: then [`poll`](Self::poll) decides later.
    pub(crate) fn load_complete(&mut self, now: Instant) -> FileChange {
        let (handled, current) = (self.handled, Identity::of(&self.path));
        self.load().map_or_else(
            |_| {
                self.handled = handled;
                self.candidate = Some((current, now));
                FileChange::Unchanged
            },
            FileChange::Loaded,
        )
    }

    /// Checks whether the file has changed, and loads it if it has changed and then stayed unchanged for long enough.
    pub(crate) fn poll(&mut self, now: Instant) -> FileChange {
        let current = Identity::of(&self.path);
        if current == self.handled {
            self.candidate = None;
            return FileChange::Unchanged;
        }
        let since = match self.candidate {
            Some((candidate, since)) if candidate == current => since,
            _ => now,
        };
        self.candidate = Some((current, since));
        let settle = if current.is_none() { ABSENCE } else { SETTLE };
        if now.duration_since(since) < settle { FileChange::Unchanged } else { self.load().into() }
    }
}

impl From<Result<Box<CoefficientTable>, LoadError>> for FileChange {
    fn from(loaded: Result<Box<CoefficientTable>, LoadError>) -> Self {
        loaded.map_or_else(Self::Refused, Self::Loaded)
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
        let mut file = TableFile::new(ImuId::new("imu-a").unwrap(), path, Trust::Owned);
        file.load().unwrap();
        file
    }

    #[test]
    fn a_change_without_a_close_must_settle() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = file(&folder);
        let start = Instant::now();
        assert!(matches!(file.poll(start), FileChange::Unchanged));
        fs::write(file.path(), TABLE.replace("9.8015", "9.8016")).unwrap();
        assert!(matches!(file.poll(start), FileChange::Unchanged));
        fs::write(file.path(), TABLE.replace("9.8015", "9.80171")).unwrap();
        assert!(matches!(file.poll(start + SETTLE), FileChange::Unchanged), "it has changed again");
        let FileChange::Loaded(table) = file.poll(start + 2 * SETTLE) else { panic!("settled") };
        assert_eq!(table.content().gravity, 9.80171);
        assert!(matches!(file.poll(start + 9 * SETTLE), FileChange::Unchanged));
    }

    #[test]
    fn a_complete_file_is_loaded_at_once_and_a_bad_one_reported_once_when_at_rest() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = file(&folder);
        let now = Instant::now();
        fs::write(folder.path().join("new"), "format = 3\n").unwrap();
        fs::rename(folder.path().join("new"), file.path()).unwrap();
        assert!(matches!(file.load_complete(now), FileChange::Unchanged), "somebody may still be writing");
        assert!(matches!(file.poll(now + SETTLE), FileChange::Refused(_)));
        assert!(matches!(file.poll(now + 9 * SETTLE), FileChange::Unchanged));
        fs::remove_file(file.path()).unwrap();
        assert!(matches!(file.poll(now), FileChange::Unchanged), "it may come back");
        assert!(matches!(file.poll(now + ABSENCE), FileChange::Refused(LoadError::Io { .. })));
        assert!(matches!(file.poll(now + 2 * ABSENCE), FileChange::Unchanged));
        fs::write(file.path(), TABLE).unwrap();
        assert!(matches!(file.load_complete(now), FileChange::Loaded(_)));
    }

    #[test]
    fn only_a_tables_own_file_is_said_to_be_complete() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("imu-a.toml");
        let (sender, names) = std::sync::mpsc::channel();
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
        // Events arrive in order, so a wrong event would arrive before this one.
        assert_eq!(names.recv_timeout(Duration::from_secs(20)).unwrap(), "imu-a.toml");
        drop(half);
    }
}
