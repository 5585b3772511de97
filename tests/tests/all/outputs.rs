//! Every option that writes a file or a folder, with what another user can put in its place: nothing is written through
//! a link, into a hard link or into a pipe, and no command hangs.
//!
//! The other user is `nobody`, so only root can run these tests.

use clap::Command;
use isotherm_tests::{Needs, RUN, TABLE, TestDomain, is_nightly, skip, text, variant};
use rustix::fs::{CWD, FileType, Mode, OFlags, mknodat, open};
use std::collections::BTreeSet;
use std::fs::{self, File, Permissions};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, lchown, symlink};
use std::path::{Path, PathBuf};

const NOBODY: u32 = 65_534;
/// The log of an IMU that warms up.
const HEATING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/formats/tests/data/autopilots/heating.BIN");
/// The recordings of tumbles of several devices at one temperature.
const TUMBLE_RECORDINGS: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data/any_lab/five_mpu9150");
/// A campaign file of tumbles, without its IMUs and recordings.
const TUMBLES: &str = "format = 1\nmethod = \"gravity-only\"\ntemperature_range = [20, 30]\ngravity_reference = 9.81\n\
                       gravity_local = 9.81\ntemperature_unit = \"degC\"\n";
/// In the arguments: the path that is written.
const OUT: &str = "OUT";

/// An option that writes a file, or into a folder that is there.
const INTO_FOLDER: &str = "calibrate warm-up output";

/// An option that writes.
struct Writing {
    /// Command and argument, as clap names them.
    option: &'static str,
    arguments: &'static [&'static str],
    /// Names of files that are written in the folder that the option names; none if it names a file.
    inside: &'static [&'static str],
    /// How the command ends where nobody is in the way; `None` if that needs more than there is here.
    ends: Option<i32>,
}

const fn file(option: &'static str, arguments: &'static [&'static str]) -> Writing {
    Writing { option, arguments, inside: &[], ends: Some(0) }
}

/// Every option that writes. An option of a path that is neither here nor in [`READING`] fails the tests.
const WRITING: &[Writing] = &[
    // There is no frame in the bytes.
    Writing {
        ends: Some(65),
        ..file("acquire record", &["acquire", "source.toml", "--device", "bytes", "--dry-run", "--record", "OUT.csv"])
    },
    file("acquire nominal", &["acquire", "source.toml", "--nominal", OUT]),
    file("calibrate turntable output", &["calibrate", "turntable", "campaign.toml", "-o", OUT]),
    file(
        "calibrate turntable report",
        &["calibrate", "turntable", "campaign.toml", "-o", "made.toml", "--report", OUT],
    ),
    Writing {
        ends: None,
        ..file(
            "calibrate turntable batch",
            &["calibrate", "turntable", "batch.toml", "-o", "{imu}.toml", "--other-device", "--batch", OUT],
        )
    },
    Writing {
        ends: None,
        ..file("calibrate tumble batch", &["calibrate", "tumble", "tumbles.toml", "-o", "{imu}.toml", "--batch", OUT])
    },
    file("calibrate tumble output", &["calibrate", "tumble", "tumble.toml", "-o", OUT]),
    file("calibrate tumble report", &["calibrate", "tumble", "tumble.toml", "-o", "made.toml", "--report", OUT]),
    file(
        "calibrate warm-up export",
        &[
            "calibrate",
            "warm-up",
            HEATING,
            "--imu",
            "i",
            "-o",
            "made.toml",
            "--device-id",
            "1,2",
            "--export",
            "px4=OUT",
        ],
    ),
    file(INTO_FOLDER, &["calibrate", "warm-up", HEATING, "--imu", "i", "-o", OUT]),
    file(
        "calibrate warm-up report",
        &["calibrate", "warm-up", HEATING, "--imu", "i", "-o", "made.toml", "--report", OUT],
    ),
    Writing {
        option: "campaign run plan",
        arguments: &["campaign", "run", "plan.toml"],
        inside: &["runner.lock", "journal.jsonl", "status.json.new", "campaign.csv"],
        ends: None,
    },
    Writing {
        option: "campaign stop plan",
        arguments: &["campaign", "stop", "plan.toml"],
        inside: &["runner.lock", "journal.jsonl"],
        ends: None,
    },
    file("check files", &["check", "--seal", OUT]),
    file("compare report", &["compare", "imu-a.toml", "next.toml", "--report", OUT]),
    file("convert output", &["convert", HEATING, "-o", OUT]),
    file("convert nominal", &["convert", HEATING, "-o", "made.csv", "--nominal", OUT]),
    Writing { ends: None, ..file("demo report", &["demo", "--report", OUT]) },
    file("export output", &["export", "mems.toml", "--to", "px4", "--device-id", "1,2", "-o", OUT]),
    file("feed output", &["feed", "--imu", "imu-a", RUN, "-o", OUT]),
    file("import output", &["import", "full.params", "--from", "px4", "--imu", "i", "--interval", "0.0025", "-o", OUT]),
    Writing { inside: &["isotherm.1", "isotherm-service.5"], ..file("man output", &["man", "-o", OUT]) },
    file("noise report", &["noise", RUN, "--report", OUT]),
    file("noise kalibr", &["noise", RUN, "--table", "imu-a.toml", "--kalibr", OUT]),
    Writing { ends: None, ..file("record output", &["record", "--imu", "imu-a", "-o", "OUT.csv"]) },
    file("repair output", &["repair", RUN, "-o", "OUT.csv"]),
    file("replay output", &["replay", "--table", "imu-a.toml", RUN, "-o", OUT]),
    file("rollback table", &["rollback", OUT]),
    Writing {
        inside: &["plan.toml", "truth.toml"],
        ends: None,
        ..file("simulate station output", &["simulate", "station", "-o", OUT])
    },
    Writing {
        inside: &["campaign.toml", "samples.csv"],
        ..file(
            "simulate campaign output",
            &["simulate", "campaign", "--dwell", "20", "--soak", "3600", "--set-points", "0:10:10", "-o", OUT],
        )
    },
    Writing {
        inside: &["ramp-1.csv", "table.toml"],
        ..file("simulate ramp output", &["simulate", "ramp", "--interval", "10", "-o", OUT])
    },
    Writing {
        inside: &["run.csv", "truth.toml"],
        ..file("simulate run output", &["simulate", "run", "--interval", "10", "-o", OUT])
    },
    file("verify report", &["verify", "--table", "still/truth.toml", "still/run.csv", "--report", OUT]),
];

/// Every other option of a path: it is only read, or names a device.
const READING: &[&str] = &[
    "acquire device",
    "acquire probe",
    "acquire source",
    "acquire sysfs",
    "calibrate tumble gyroscope_file",
    "calibrate tumble mapping",
    "calibrate tumble recordings",
    "calibrate turntable campaign",
    "calibrate turntable propose",
    "calibrate turntable samples",
    "calibrate warm-up gyroscope_file",
    "calibrate warm-up logs",
    "calibrate warm-up mapping",
    "calibrate warm-up nominal",
    "campaign check plan",
    "campaign status plan",
    "check against",
    "compare tables",
    "convert input",
    "convert gyroscope_file",
    "convert mapping",
    "convert table",
    "describe files",
    "describe gyroscope_file",
    "describe mapping",
    "export table",
    "feed gyroscope_file",
    "feed mapping",
    "feed recording",
    "import file",
    "noise gyroscope_file",
    "noise mapping",
    "noise recording",
    "noise table",
    "record tables",
    "regress data",
    "repair recording",
    "replay gyroscope_file",
    "replay mapping",
    "replay recording",
    "replay table",
    "serve config",
    "serve imu",
    "simulate campaign truth",
    "simulate ramp truth",
    "simulate run truth",
    "simulate station truth",
    // The folder that `simulate station` has judged.
    "simulate station-part folder",
    "verify campaign",
    "verify gyroscope_file",
    "verify mapping",
    "verify recording",
    "verify table",
];

/// The options of a command and its subcommands whose value is a path, or has one.
fn paths(command: &Command, name: &str, found: &mut BTreeSet<String>) {
    for argument in command.get_arguments().filter(|argument| argument.get_action().takes_values()) {
        let parser = format!("{:?}", argument.get_value_parser());
        if ["path_buf", "PathBuf", "os_string", "OsString"].iter().any(|kind| parser.contains(kind)) {
            found.insert(format!("{name}{}", argument.get_id()));
        }
    }
    for subcommand in command.get_subcommands() {
        paths(subcommand, &format!("{name}{} ", subcommand.get_name()), found);
    }
}

#[test]
fn every_option_of_a_path_is_listed() {
    let mut found = BTreeSet::new();
    paths(&isotherm_cli::command(), "", &mut found);
    paths(&isotherm_service::command("version"), "", &mut found);
    let writing = WRITING.iter().map(|writing| writing.option);
    let listed: BTreeSet<_> = writing.chain(READING.iter().copied()).map(str::to_owned).collect();
    let missing: Vec<_> = found.difference(&listed).collect();
    assert!(missing.is_empty(), "put them into WRITING or READING: {missing:?}");
    // The path of an export stands behind the name of an autopilot.
    let gone: Vec<_> = listed.difference(&found).filter(|option| *option != "calibrate warm-up export").collect();
    assert!(gone.is_empty(), "there is no such option: {gone:?}");
}

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

/// The inputs of all commands, a service for the feed, and what must stay as it is.
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
        domain.write("next.toml", &variant(1));
        domain.write("mems.toml", &read("examples/tables/imu-mems.toml"));
        domain.write("full.params", &read("recording/autopilot/tests/data/full.params"));
        for name in ["samples.csv", "imu-a.csv"] {
            domain.write(name, &read("examples/campaign/samples.csv"));
        }
        // From another device.
        domain.run_ok(&["simulate", "campaign", "-o", "other", "--seed", "2", "--vary"]);
        fs::rename(domain.path("other/samples.csv"), domain.path("imu-b.csv")).unwrap();
        let campaign = read("examples/campaign/campaign.toml");
        let imus = "imus = [{ id = \"imu-a\" }, { id = \"imu-b\" }]";
        let batch = campaign.replace("imu = \"imu-paper\"", imus).replace("samples.csv", "{imu}.csv");
        domain.write("batch.toml", &batch);
        domain.write("campaign.toml", &campaign);
        domain.write("tumble.toml", &format!("{TUMBLES}imu = \"imu0\"\nsamples = \"imu0.csv\"\n"));
        domain.write(
            "tumbles.toml",
            &format!("{TUMBLES}imus = [{{ id = \"imu0\" }}, {{ id = \"imu1\" }}]\nsamples = \"{{imu}}.csv\"\n"),
        );
        for name in ["imu0.csv", "imu1.csv"] {
            fs::copy(Path::new(TUMBLE_RECORDINGS).join(name), domain.path(name)).unwrap();
        }
        domain.write("source.toml", &read("examples/acquire/stim300.toml"));
        domain.write("bytes", &"x".repeat(5000));
        // Nobody listens there, and that is known at once: `campaign stop` looks for the instruments first.
        domain.write("plan.in", &read("examples/plan.toml").replace("192.0.2.10:9888", "127.0.0.1:1"));
        domain.run_ok(&["simulate", "run", "-o", "still", "--interval", "5"]);
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
        let context = format!("{} with a {object}: {code:?}\n{said}", writing.option);
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
        let takes_folder = !writing.inside.is_empty() || writing.option == INTO_FOLDER;
        let used = same && object == "folder" && path == out && takes_folder;
        let right = refused || (replaced || used) && writing.ends.is_none_or(|ends| code == Some(ends));
        fs::remove_file(path).or_else(|_| fs::remove_dir_all(path)).unwrap();
        (!right).then_some(context)
    }
}

/// Whether it is a recording, which never replaces a file and has a name that determines its format.
fn is_new(writing: &Writing) -> bool {
    writing.arguments.contains(&"OUT.csv")
}

/// Tries every option in a folder of this kind with a third of the objects, so that the three kinds together have every
/// object; with `ISOTHERM_NIGHTLY` set, with all of them.
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
    let service = fixture.domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let folder = fixture.domain.path("hostile");
    let mut wrong = Vec::new();
    for (number, writing) in WRITING.iter().enumerate() {
        let renew = || {
            let _ = fs::remove_dir_all(&folder);
            fs::create_dir(&folder).unwrap();
            lchown(&folder, Some(owner), Some(owner)).unwrap();
            fs::set_permissions(&folder, Permissions::from_mode(mode)).unwrap();
        };
        let drawn = |index: usize| is_nightly() || (number + index) % 3 == place as usize;
        for (_, object) in OBJECTS.into_iter().enumerate().filter(|(index, _)| drawn(*index)) {
            renew();
            let name = if is_new(writing) { "out.csv" } else { "out" };
            wrong.extend(fixture.attempt(writing, object, &folder.join(name), &folder.join("out")));
            for inside in writing.inside {
                renew();
                wrong.extend(fixture.attempt(writing, object, &folder.join(inside), &folder));
            }
        }
    }
    service.terminate();
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
fn where_nobody_is_in_the_way_every_option_writes() {
    let fixture = Fixture::new();
    let service = fixture.domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    for writing in WRITING.iter().filter(|writing| writing.ends.is_some()) {
        let folder = fixture.domain.path("own");
        fs::create_dir(&folder).unwrap();
        let out = folder.join("out");
        // What is changed must be there; a link of one's own is followed.
        let changed = ["check files", "rollback table"].contains(&writing.option);
        if changed {
            fs::write(&out, TABLE).unwrap();
            fs::write(out.with_extension("previous"), variant(1)).unwrap();
        } else if writing.inside.is_empty() && !is_new(writing) {
            symlink("target", &out).unwrap();
        }
        let (code, said) = fixture.run(writing, &out);
        assert_eq!(code, writing.ends, "{}: {said}", writing.option);
        let written = match () {
            () if changed || !writing.inside.is_empty() => out,
            () if is_new(writing) => out.with_extension("csv"),
            () => folder.join("target"),
        };
        assert!(written.exists() && fs::symlink_metadata(&written).unwrap().len() > 0, "{}", writing.option);
        for inside in writing.inside {
            assert!(written.join(inside).is_file(), "{}: {inside}", writing.option);
        }
        fs::remove_dir_all(folder).unwrap();
    }
    service.terminate();
}
