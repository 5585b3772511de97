//! Watches table files and decides when to load one.
//!
//! The folder of each table is watched. The watch reports a file that is renamed over the table, written in place, or
//! removed and created again, and a symbolic link that is switched. Polling the file every [`TICK`] finds the other
//! changes: an exchanged parent folder, a written link target, a file system without notifications.
//!
//! A file that was renamed or closed after writing is loaded at once. A file that only differs, or that is not valid,
//! must first stay unchanged for [`SETTLE`]: its writer may not have finished. No file is loaded more often than once
//! in [`LOAD_INTERVAL`], however often it changes.
//!
//! Each folder has a thread of its own, which looks at its files and loads them: a disk or a network may let it wait.
//! The control thread gets what was found as an event.

use crate::events::{EventQueue, FileChange, FileReport};
use isotherm_documents::{LoadError, load_table};
use isotherm_files::{Identity, Trust};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::shown;
use notify::event::{AccessKind, AccessMode, EventKind, ModifyKind};
use notify::{Event, RecommendedWatcher, RecursiveMode, Watcher as _};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::{io, mem, thread};
use tracing::warn;

/// How often every table file is polled.
pub(crate) const TICK: Duration = Duration::from_millis(50);
/// How long a file that was not closed or renamed must stay unchanged.
const SETTLE: Duration = Duration::from_millis(150);
/// How long a file may be missing before that is reported.
const ABSENCE: Duration = Duration::from_secs(1);
/// Shortest time between two loads of a file.
const LOAD_INTERVAL: Duration = Duration::from_millis(100);
/// A look at the files of a folder that takes longer is reported.
const LOOK_LIMIT: Duration = Duration::from_secs(5);

/// The threads that look at the table files. Dropping it ends them.
pub(crate) struct TableFiles {
    folders: Vec<Arc<FolderLink>>,
}

impl TableFiles {
    /// Starts to look at the files, which have the numbers of their IMUs. Each is loaded and reported once at the
    /// beginning, and then whenever it has changed.
    ///
    /// # Errors
    /// If the operating system refuses a thread.
    pub(crate) fn start(files: Vec<WatchedFile>, events: &Arc<EventQueue>) -> io::Result<Self> {
        let mut by_folder: BTreeMap<PathBuf, Vec<(usize, WatchedFile)>> = BTreeMap::new();
        for (imu, file) in files.into_iter().enumerate() {
            by_folder.entry(folder_of(file.path())).or_default().push((imu, file));
        }
        let start = |(folder, files): (PathBuf, Vec<(usize, WatchedFile)>)| {
            let link = Arc::new(FolderLink { folder, orders: Mutex::default(), changed: Condvar::new() });
            let body = {
                let (link, events) = (Arc::clone(&link), Arc::clone(events));
                move || TableFolder::new(link, events, files).run()
            };
            thread::Builder::new().name("tables".to_owned()).spawn(body).map(|_| link)
        };
        let folders = by_folder.into_iter().map(start).collect::<io::Result<_>>()?;
        Ok(Self { folders })
    }

    /// Orders to load and report all files, whatever their state.
    pub(crate) fn load_all(&self) {
        for folder in &self.folders {
            folder.order(|orders| orders.load_all = true);
        }
    }

    /// The folders whose disk has not answered for longer than [`LOOK_LIMIT`].
    pub(crate) fn silent_folders(&self) -> Vec<&Path> {
        let is_silent =
            |folder: &&Arc<FolderLink>| folder.lock().looking_since.is_some_and(|since| since.elapsed() > LOOK_LIMIT);
        self.folders.iter().filter(is_silent).map(|folder| folder.folder.as_path()).collect()
    }
}

impl Drop for TableFiles {
    fn drop(&mut self) {
        for folder in &self.folders {
            folder.order(|orders| orders.ended = true);
        }
    }
}

/// What the control thread, the watch and the thread of a folder share.
struct FolderLink {
    folder: PathBuf,
    orders: Mutex<Orders>,
    changed: Condvar,
}

#[derive(Default)]
struct Orders {
    /// The files that were renamed or closed after writing, by their places in the folder.
    completed: BTreeSet<usize>,
    load_all: bool,
    ended: bool,
    /// When the present look at the files began.
    looking_since: Option<Instant>,
}

impl FolderLink {
    fn lock(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn order(&self, order: impl FnOnce(&mut Orders)) {
        order(&mut self.lock());
        self.changed.notify_one();
    }
}

/// The files of one folder, in their thread.
struct TableFolder {
    link: Arc<FolderLink>,
    events: Arc<EventQueue>,
    /// With the numbers of their IMUs.
    files: Vec<(usize, WatchedFile)>,
    /// The places of the files that are complete and not loaded yet.
    completed: BTreeSet<usize>,
}

impl TableFolder {
    const fn new(link: Arc<FolderLink>, events: Arc<EventQueue>, files: Vec<(usize, WatchedFile)>) -> Self {
        Self { link, events, files, completed: BTreeSet::new() }
    }

    fn run(mut self) {
        self.link.lock().looking_since = Some(Instant::now());
        // Before the files are read, so that no change is missed.
        let _watcher = self.watch();
        self.load_all(false);
        let mut next_tick = Instant::now() + TICK;
        loop {
            let Some(load_all) = self.wait(next_tick) else { return };
            if load_all {
                self.load_all(true);
            }
            self.load_completed();
            if Instant::now() >= next_tick {
                for place in 0..self.files.len() {
                    let change = self.files[place].1.poll(Instant::now());
                    self.report(place, change, false);
                }
                next_tick = Instant::now() + TICK;
            }
        }
    }

    /// Watches the folder, if that is possible.
    fn watch(&self) -> Option<RecommendedWatcher> {
        let paths: Vec<_> = self.files.iter().map(|(_, file)| file.path().to_owned()).collect();
        let (link, names) = (Arc::clone(&self.link), paths.clone());
        let (watcher, failures) = watch(&paths, move |name| {
            let places = names.iter().enumerate().filter(|(_, path)| path.file_name() == Some(&name));
            link.order(|orders| orders.completed.extend(places.map(|(place, _)| place)));
        });
        for cause in failures {
            warn!("watching a table's folder: {cause}; its files are checked every {} ms instead", TICK.as_millis());
        }
        watcher
    }

    /// Waits until there is something to do, at most until the next tick. Returns whether all files are to be loaded;
    /// `None` at the end.
    fn wait(&mut self, next_tick: Instant) -> Option<bool> {
        let mut orders = self.link.lock();
        orders.looking_since = None;
        let due = self.completed.iter().map(|place| self.files[*place].1.next_load()).chain([next_tick]).min();
        let due = due.unwrap_or(next_tick);
        // A file that waits for its next load may change as often as it likes.
        while orders.completed.is_subset(&self.completed) && !orders.load_all && !orders.ended {
            let left = due.saturating_duration_since(Instant::now());
            if left == Duration::ZERO {
                break;
            }
            orders = self.link.changed.wait_timeout(orders, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        if orders.ended {
            return None;
        }
        orders.looking_since = Some(Instant::now());
        self.completed.append(&mut orders.completed);
        Some(mem::take(&mut orders.load_all))
    }

    fn load_all(&mut self, is_requested: bool) {
        for place in 0..self.files.len() {
            let change = self.files[place].1.load().into();
            self.report(place, change, is_requested);
        }
    }

    fn load_completed(&mut self) {
        let now = Instant::now();
        for place in mem::take(&mut self.completed) {
            let file = &mut self.files[place].1;
            if file.next_load() > now {
                self.completed.insert(place);
                continue;
            }
            let change = file.load_complete(now);
            self.report(place, change, false);
        }
    }

    fn report(&self, place: usize, change: FileChange, is_requested: bool) {
        if matches!(change, FileChange::Unchanged) {
            return;
        }
        let (imu, file) = &self.files[place];
        let is_absent = matches!(change, FileChange::Refused(_)) && file.handled.is_none();
        self.events.file(*imu, FileReport { change, state: file.handled, is_absent, is_requested });
    }
}

/// The folder of a file; `.` for only a name.
fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Watches the folders of `paths`. Calls `on_complete` with the name of each of these files that was renamed or closed
/// after writing. The second part of the result names the folders that could not be watched; their files are still
/// polled every [`TICK`].
fn watch(
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
    let mut failures = Vec::new();
    for folder in paths.iter().map(|path| folder_of(path)).collect::<BTreeSet<_>>() {
        if let Err(error) = watcher.watch(&folder, RecursiveMode::NonRecursive) {
            failures.push(format!("{}: {error}", shown(&folder)));
        }
    }
    (Some(watcher), failures)
}

/// The file of one IMU's table.
#[derive(Debug)]
pub(crate) struct WatchedFile {
    imu: ImuId,
    path: PathBuf,
    trust: Trust,
    /// The state that was last loaded or refused.
    handled: Option<Identity>,
    /// A new state, and when it was first found.
    candidate: Option<(Option<Identity>, Instant)>,
    /// When it may be loaded again.
    next_load: Instant,
}

impl WatchedFile {
    /// The file of `imu`'s table; it is not read yet.
    pub(crate) fn new(imu: ImuId, path: PathBuf, trust: Trust) -> Self {
        Self { imu, path, trust, handled: None, candidate: None, next_load: Instant::now() }
    }

    /// The path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// When it may be loaded again.
    const fn next_load(&self) -> Instant {
        self.next_load
    }

    /// Loads the file as it is now.
    ///
    /// # Errors
    /// Why it is no valid table for this IMU.
    pub(crate) fn load(&mut self) -> Result<Arc<CoefficientTable>, LoadError> {
        self.candidate = None;
        self.next_load = Instant::now() + LOAD_INTERVAL;
        self.handled = Identity::of(&self.path);
        let (table, identity) = load_table(&self.path, Some(&self.imu), self.trust)?;
        self.handled = Some(identity);
        Ok(Arc::new(table))
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

impl From<Result<Arc<CoefficientTable>, LoadError>> for FileChange {
    fn from(loaded: Result<Arc<CoefficientTable>, LoadError>) -> Self {
        loaded.map_or_else(Self::Refused, Self::Loaded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const TABLE: &str = include_str!("../../tests/data/imu-a.toml");

    fn file(folder: &tempfile::TempDir) -> WatchedFile {
        let path = folder.path().join("imu-a.toml");
        fs::write(&path, TABLE).unwrap();
        let mut file = WatchedFile::new(ImuId::new("imu-a").unwrap(), path, Trust::Owned);
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
        assert!(matches!(file.load_complete(now), FileChange::Unchanged), "another process may still be writing");
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
        assert_eq!(failures.len(), 1, "one folder is missing, the other is watched anyway: {failures:?}");
        let mut half = fs::File::create(&table).unwrap();
        io::Write::write_all(&mut half, TABLE.as_bytes()).unwrap();
        fs::write(folder.path().join("other.toml"), TABLE).unwrap();
        fs::rename(folder.path().join("other.toml"), folder.path().join("third.toml")).unwrap();
        let marker = folder.path().join("marker");
        fs::write(&marker, TABLE).unwrap();
        fs::rename(&marker, &table).unwrap();
        // EventQueue arrive in order, so a wrong event would arrive before this one.
        assert_eq!(names.recv_timeout(Duration::from_secs(20)).unwrap(), "imu-a.toml");
        drop(half);
    }
}
