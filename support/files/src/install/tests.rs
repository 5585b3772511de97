use super::*;
use std::fs::Permissions;
use std::os::unix::fs::{PermissionsExt as _, symlink};
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

    fn install(&self, text: &str) -> bool {
        self.lock().install(text).unwrap()
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
fn the_predecessor_is_kept_and_comes_back() {
    let folder = Folder::new("one");
    fs::remove_file(folder.path("imu-a.toml")).unwrap();
    assert!(!folder.install("one"));
    assert!(folder.lock().roll_back().is_err());
    assert_eq!(folder.both(), [Some("one".to_owned()), None]);
    assert!(folder.install("two"));
    assert!(!folder.install("two"));
    assert_eq!(folder.both(), both("two", "one"));
    folder.lock().roll_back().unwrap();
    assert_eq!(folder.both(), both("one", "two"));
    folder.lock().roll_back().unwrap();
    assert_eq!(folder.both(), both("two", "one"));
    // Where the file system cannot exchange two files.
    folder.lock().swap().unwrap();
    assert_eq!(folder.both(), both("one", "two"));
    folder.lock().swap().unwrap();
    assert_eq!(folder.both(), both("two", "one"));
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
    assert!(folder.install("two"));
    let (new, kept) = (state("tables/one.toml"), state("tables/one.toml.previous"));
    assert_eq!((kept.ino(), kept.mode() & 0o777, new.mode() & 0o777), (old.ino(), 0o640, 0o640));
    let beside = Installation::lock(&folder.path("tables/one.toml")).unwrap().previous().to_owned();
    assert_eq!(fs::canonicalize(beside).unwrap(), folder.lock().previous());
    folder.lock().roll_back().unwrap();
    assert!(folder.path("imu-a.toml").is_symlink());
    assert_eq!((state("imu-a.toml").ino(), state("tables/one.toml.previous").ino()), (old.ino(), new.ino()));
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
        drop(folder.lock());
        assert_eq!(&folder.both(), after, "{file} {left:?}");
    }
    // Of a rollback without an exchange.
    let folder = Folder::new("one");
    folder.write(replaced, "two");
    drop(folder.lock());
    assert_eq!(folder.both(), both("one", "two"));
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
fn a_table_is_compared_and_replaced_under_one_lock() {
    let folder = Folder::new("one");
    let compared = Identity::of(&folder.path("imu-a.toml"));
    let first = folder.lock();
    first.check_unchanged(compared).unwrap();
    let target = folder.path("imu-a.toml");
    let (sender, second) = mpsc::channel();
    let waiting = thread::spawn(move || {
        let installation = Installation::lock(&target).unwrap();
        sender.send(installation.check_unchanged(compared)).unwrap();
        drop(installation);
    });
    assert!(first.install("two").unwrap());
    assert!(second.try_recv().is_err(), "the first one has the lock");
    drop(first);
    let failure = second.recv().unwrap().unwrap_err();
    assert!(failure.exit == Exit::Failed && failure.message.contains(" has changed meanwhile; "), "{failure}");
    waiting.join().unwrap();
    assert!(folder.lock().check_unchanged(None).is_err());
    assert_eq!(folder.both(), both("two", "one"));
}
