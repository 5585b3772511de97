//! The ways in which commands write, with what another user can put in the place of their file: nothing is written
//! through a link, into a hard link or into a pipe, and no command hangs. A result is written whole, a recording and a
//! journal grow, and a table is installed with a way back.
//!
//! The other user is `nobody`, so only root can run these tests.

use isotherm_tests::{Needs, RUN, TABLE, TestDomain, skip, text, variant};
use rustix::fs::{CWD, FileType, Mode, OFlags, mknodat, open};
use std::fs::{self, File, Permissions};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, lchown, symlink};
use std::path::{Path, PathBuf};

const NOBODY: u32 = 65_534;
/// In the arguments: the path that is written.
const OUT: &str = "OUT";

/// A command that writes.
struct Writing {
    arguments: &'static [&'static str],
    /// Names of files that are written in the folder that the command names; none if it names a file.
    inside: &'static [&'static str],
    /// How the command ends where nobody is in the way; `None` if that needs more than there is here.
    ends: Option<i32>,
}

const WRITING: [Writing; 6] = [
    // Whole.
    Writing { arguments: &["replay", "--table", "imu-a.toml", RUN, "-o", OUT], inside: &[], ends: Some(0) },
    Writing { arguments: &["check", "--seal", OUT], inside: &[], ends: Some(0) },
    Writing { arguments: &["man", "-o", OUT], inside: &["isotherm.1", "isotherm-service.5"], ends: Some(0) },
    // With a way back.
    Writing { arguments: &["rollback", OUT], inside: &[], ends: Some(0) },
    // Growing. There is no frame in the bytes.
    Writing {
        arguments: &["acquire", "source.toml", "--device", "bytes", "--dry-run", "--record", "OUT.csv"],
        inside: &[],
        ends: Some(65),
    },
    Writing {
        arguments: &["campaign", "run", "plan.toml"],
        inside: &["runner.lock", "journal.jsonl", "status.json.new", "campaign.csv"],
        ends: None,
    },
];

/// What another user can put in the place of an output.
const OBJECTS: [&str; 7] =
    ["link", "link to nothing", "link to a device", "hard link", "pipe", "sparse file", "folder"];

/// A folder in which another user can do that.
#[derive(Clone, Copy)]
enum Place {
    OfAnother,
    Open,
    Sticky,
}

/// The inputs of all commands, and what must stay as it is.
struct Fixture {
    domain: TestDomain,
    /// A folder that nobody else may enter, but may name.
    victims: PathBuf,
}

impl Fixture {
    fn new() -> Self {
        let domain = TestDomain::new();
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let read = |name: &str| fs::read_to_string(repository.join(name)).unwrap();
        domain.write("imu-a.toml", TABLE);
        domain.write("source.toml", &read("examples/acquire/stim300.toml"));
        domain.write("bytes", &"x".repeat(5000));
        // Nobody listens there, and that is known at once: `campaign stop` looks for the instruments first.
        domain.write("plan.in", &read("examples/plan.toml").replace("192.0.2.10:9888", "127.0.0.1:1"));
        fs::set_permissions(domain.path(""), Permissions::from_mode(0o755)).unwrap();
        let victims = domain.path("victims");
        fs::create_dir(&victims).unwrap();
        Self { domain, victims }
    }

    fn victim(&self) -> PathBuf {
        self.victims.join("victim")
    }

    /// Puts an object of the other user at `path`.
    fn plant(&self, object: &str, path: &Path) {
        fs::write(self.victim(), "precious").unwrap();
        match object {
            "link" => symlink(self.victim(), path).unwrap(),
            "link to nothing" => symlink(self.victims.join("absent"), path).unwrap(),
            "link to a device" => symlink("/dev/full", path).unwrap(),
            // As where the kernel lets everybody make hard links to a file that he may not write.
            "hard link" => return fs::hard_link(self.victim(), path).unwrap(),
            "pipe" => mknodat(CWD, path, FileType::Fifo, Mode::from_raw_mode(0o666), 0).unwrap(),
            "sparse file" => File::create(path).unwrap().set_len(1 << 40).unwrap(),
            _ => fs::create_dir(path).unwrap(),
        }
        lchown(path, Some(NOBODY), Some(NOBODY)).unwrap();
    }

    /// Runs a command that writes to `out`. Returns its exit code and what it said.
    fn run(&self, writing: &Writing, out: &Path) -> (Option<i32>, String) {
        let out = out.to_str().unwrap();
        if writing.arguments.contains(&"plan.toml") {
            let plan = fs::read_to_string(self.domain.path("plan.in")).unwrap();
            self.domain.write("plan.toml", &plan.replace("imu-a-campaign", out));
        }
        let arguments: Vec<_> = writing.arguments.iter().map(|argument| argument.replace(OUT, out)).collect();
        let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
        let output = self.domain.finish(self.domain.isotherm_after(&[], "umask 022", &arguments));
        (output.status.code(), text(&output.stderr))
    }

    /// Everything that no command may change.
    fn assert_untouched(&self, context: &str) {
        assert_eq!(fs::read_to_string(self.victim()).unwrap(), "precious", "{context}");
        assert_eq!(fs::read_dir(&self.victims).unwrap().count(), 1, "{context}: something was made behind a link");
    }

    /// Tries an option with an object at `path`; the command is given `out`. Returns what is wrong.
    fn attempt(&self, writing: &Writing, object: &str, path: &Path, out: &Path) -> Option<String> {
        self.plant(object, path);
        let before = fs::symlink_metadata(path).unwrap();
        // While it is open, no other file gets its number.
        let _planted = open(path, OFlags::PATH | OFlags::NOFOLLOW, Mode::empty()).unwrap();
        let (code, said) = self.run(writing, out);
        let context = format!("{} with a {object}: {code:?}\n{said}", writing.arguments[0]);
        self.assert_untouched(&context);
        let after = fs::symlink_metadata(path).unwrap();
        let same = (before.ino(), before.len(), before.uid()) == (after.ino(), after.len(), after.uid());
        // What is replaced is a file of its own, which has only the name.
        let replaced = after.is_file() && after.ino() != before.ino() && before.is_file();
        // The message names the file, or the folder if that is refused as a whole.
        let named = [path.file_name().unwrap(), path.parent().unwrap().as_os_str()];
        let named = named.iter().any(|name| said.contains(name.to_str().unwrap()));
        let refused = same && code.is_some_and(|code| code != 0) && named;
        // A folder that is there is used. Each file in it is judged by itself.
        let used = same && object == "folder" && path == out && !writing.inside.is_empty();
        let right = refused || (replaced || used) && writing.ends.is_none_or(|ends| code == Some(ends));
        fs::remove_file(path).or_else(|_| fs::remove_dir_all(path)).unwrap();
        (!right).then_some(context)
    }
}

/// Whether it is a recording, which never replaces a file and has a name that determines its format.
fn is_new(writing: &Writing) -> bool {
    writing.arguments.contains(&"OUT.csv")
}

/// Tries every way of writing in a folder of this kind, with every object.
fn attempt_all(place: Place) {
    if !rustix::process::geteuid().is_root() {
        return skip("only root can be another user", Needs::Machine);
    }
    let (owner, mode) = match place {
        Place::OfAnother => (NOBODY, 0o755),
        Place::Open => (0, 0o777),
        Place::Sticky => (0, 0o1777),
    };
    let fixture = Fixture::new();
    let folder = fixture.domain.path("hostile");
    let mut wrong = Vec::new();
    for writing in &WRITING {
        let renew = || {
            let _ = fs::remove_dir_all(&folder);
            fs::create_dir(&folder).unwrap();
            lchown(&folder, Some(owner), Some(owner)).unwrap();
            fs::set_permissions(&folder, Permissions::from_mode(mode)).unwrap();
        };
        for object in OBJECTS {
            renew();
            let name = if is_new(writing) { "out.csv" } else { "out" };
            wrong.extend(fixture.attempt(writing, object, &folder.join(name), &folder.join("out")));
            for inside in writing.inside {
                renew();
                wrong.extend(fixture.attempt(writing, object, &folder.join(inside), &folder));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn in_a_folder_of_another_user_nothing_is_written_through_what_he_has_put_there() {
    attempt_all(Place::OfAnother);
}

#[test]
fn in_a_folder_that_everybody_may_write_nothing_is_written_through_what_is_there() {
    attempt_all(Place::Open);
}

#[test]
fn in_a_folder_with_the_sticky_bit_nothing_is_written_through_what_another_user_has_put_there() {
    attempt_all(Place::Sticky);
}

/// Otherwise the others would show nothing: a command could fail for another reason.
#[test]
fn where_nobody_is_in_the_way_each_of_them_writes() {
    let fixture = Fixture::new();
    for writing in WRITING.iter().filter(|writing| writing.ends.is_some()) {
        let folder = fixture.domain.path("own");
        fs::create_dir(&folder).unwrap();
        let out = folder.join("out");
        // What is changed must be there; a link of one's own is followed.
        let changed = ["check", "rollback"].contains(&writing.arguments[0]);
        if changed {
            fs::write(&out, TABLE).unwrap();
            fs::write(out.with_extension("previous"), variant(1)).unwrap();
        } else if writing.inside.is_empty() && !is_new(writing) {
            symlink("target", &out).unwrap();
        }
        let (code, said) = fixture.run(writing, &out);
        assert_eq!(code, writing.ends, "{}: {said}", writing.arguments[0]);
        let written = match () {
            () if changed || !writing.inside.is_empty() => out,
            () if is_new(writing) => out.with_extension("csv"),
            () => folder.join("target"),
        };
        assert!(written.exists() && fs::symlink_metadata(&written).unwrap().len() > 0, "{}", writing.arguments[0]);
        for inside in writing.inside {
            assert!(written.join(inside).is_file(), "{}: {inside}", writing.arguments[0]);
        }
        fs::remove_dir_all(folder).unwrap();
    }
}
