use super::*;
use std::os::unix::fs::symlink;
use std::sync::mpsc;
use tempfile::TempDir;

/// A folder with the table `imu-a.toml`.
struct Folder(TempDir);

impl Folder {
    fn new(text: &str) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("imu-a.toml", text);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn lock(&self) -> Installation {
        Installation::lock(&self.path("imu-a.toml")).unwrap()
    }

    fn install(&self, text: &str) {
        let installation = self.lock();
        installation.install(text).unwrap();
        installation.complete().unwrap();
    }

    /// The table and its predecessor. Nothing else is there.
    fn both(&self) -> [Option<String>; 2] {
        let both = ["imu-a.toml", "imu-a.toml.previous"].map(|name| fs::read_to_string(self.path(name)).ok());
        assert_eq!(fs::read_dir(self.0.path()).unwrap().count(), both.iter().flatten().count(), "nothing else is left");
        both
    }
}

fn both(file: &str, previous: &str) -> [Option<String>; 2] {
    [file, previous].map(|text| Some(text.to_owned()))
}

#[test]
fn the_predecessor_is_kept_unless_it_is_discarded() {
    let folder = Folder::new("one");
    fs::remove_file(folder.path("imu-a.toml")).unwrap();
    folder.install("one");
    assert_eq!(folder.both(), [Some("one".to_owned()), None]);
    folder.install("two");
    assert_eq!(folder.both(), both("two", "one"));
    let installation = folder.lock();
    installation.install("three").unwrap();
    installation.discard().unwrap();
    drop(installation);
    assert_eq!(folder.both(), both("three", "one"));
}

#[test]
fn the_predecessor_is_the_old_file_itself_and_a_link_stays() {
    let folder = Folder::new("");
    fs::remove_file(folder.path("imu-a.toml")).unwrap();
    fs::create_dir(folder.path("tables")).unwrap();
    fs::write(folder.path("tables/one.toml"), b"\xff not UTF-8").unwrap();
    fs::set_permissions(folder.path("tables/one.toml"), Permissions::from_mode(0o640)).unwrap();
    symlink("tables/one.toml", folder.path("imu-a.toml")).unwrap();
    let state = |name: &str| fs::metadata(folder.path(name)).unwrap();
    let old = state("tables/one.toml");
    folder.install("two");
    let (new, kept) = (state("tables/one.toml"), state("tables/one.toml.previous"));
    assert_eq!((kept.ino(), kept.mode() & 0o777, new.mode() & 0o777), (old.ino(), 0o640, 0o640));
    let beside = Installation::lock(&folder.path("tables/one.toml")).unwrap().previous().to_owned();
    assert_eq!(fs::canonicalize(beside).unwrap(), folder.lock().previous());
    assert!(folder.path("imu-a.toml").is_symlink());
    assert_eq!(fs::read_dir(folder.path("tables")).unwrap().count(), 2);
}

/// What SIGKILL leaves between any two steps, and what the next process makes of it.
#[test]
fn what_a_kill_has_left_is_completed_or_taken_back() {
    let [new, replaced] = [".isotherm-imu-a.toml.new", "imu-a.toml.replaced"];
    let not_done = both("two", "one");
    let done = both("three", "two");
    for (file, left, after) in [
        // Of an installation of "three".
        ("two", &[(new, "tw")][..], &not_done),
        ("two", &[(new, "two")], &not_done),
        ("two", &[(replaced, "two")], &not_done),
        ("two", &[(replaced, "two"), (new, "thr")], &not_done),
        ("two", &[(replaced, "two"), (new, "three")], &not_done),
        ("three", &[(replaced, "two"), (new, "two")], &done),
        ("three", &[(replaced, "two")], &done),
    ] {
        let folder = Folder::new(file);
        folder.write("imu-a.toml.previous", "one");
        folder.write(".isotherm-imu-a.toml.lock", "");
        left.iter().for_each(|(name, text)| folder.write(name, text));
        folder.lock().complete().unwrap();
        assert_eq!(&folder.both(), after, "{file} {left:?}");
    }
}

#[test]
fn what_is_no_regular_file_is_refused_and_nothing_is_changed() {
    for name in ["imu-a.toml.previous", "imu-a.toml.replaced", ".isotherm-imu-a.toml.new", ".isotherm-imu-a.toml.lock"]
    {
        let folder = Folder::new("one");
        symlink("imu-a.toml", folder.path(name)).unwrap();
        let failure = Installation::lock(&folder.path("imu-a.toml")).err().unwrap();
        assert!(
            failure.exit == Exit::Io && failure.message.contains(&format!("{name} is not a regular file")),
            "{failure}"
        );
        assert_eq!(fs::read_to_string(folder.path("imu-a.toml")).unwrap(), "one");
        assert_eq!(fs::read_dir(folder.path("")).unwrap().count(), 2, "nothing unfinished is left");
    }
    let folder = Folder::new("one");
    assert!(Installation::lock(&folder.path("")).is_err());
    let failure = Installation::lock(&folder.path("none/imu-a.toml")).err().unwrap();
    assert!(failure.message.contains("there is no folder "), "{failure}");
}

#[test]
fn what_is_put_back_leaves_everything_as_it_was() {
    let folder = Folder::new("one");
    folder.install("two");
    let state = || ["imu-a.toml", "imu-a.toml.previous"].map(|name| fs::metadata(folder.path(name)).unwrap().ino());
    let before = state();
    let installation = folder.lock();
    for text in ["three", "four"] {
        installation.install(text).unwrap();
        assert!(installation.is_pending());
    }
    installation.put_back().unwrap();
    drop(installation);
    assert_eq!((folder.both(), state()), (both("two", "one"), before));
    // There was no file.
    fs::remove_file(folder.path("imu-a.toml")).unwrap();
    let installation = folder.lock();
    installation.install("five").unwrap();
    installation.put_back().unwrap();
    drop(installation);
    assert_eq!(folder.both(), [None, Some("one".to_owned())]);
}

#[test]
fn a_table_is_compared_and_replaced_under_one_lock() {
    let folder = Folder::new("one");
    let compared = Identity::of(&folder.path("imu-a.toml"));
    let first = folder.lock();
    assert_eq!(first.state(), compared);
    let busy = Installation::lock_within(Duration::ZERO, &folder.path("imu-a.toml")).err().unwrap();
    assert_eq!(busy.exit, Exit::Temporary, "{busy}");
    let target = folder.path("imu-a.toml");
    let (sender, second) = mpsc::channel();
    let waiting = thread::spawn(move || sender.send(Installation::lock(&target).unwrap().state()).unwrap());
    first.install("two").unwrap();
    first.complete().unwrap();
    assert!(second.try_recv().is_err(), "the first one has the lock");
    drop(first);
    assert_ne!(second.recv().unwrap(), compared);
    waiting.join().unwrap();
    assert_eq!(folder.both(), both("two", "one"));
}
