//! What commands leave when they end early: by a signal, a full disk, a limit, a closed standard output;
//! docs/operate.md has it in short.

use isotherm_tests::{Process, RUN, TABLE, TestDomain, may_mount, text, wait_until};
use rustix::process::Signal;
use std::fs::{self, File, Permissions};
use std::io::{PipeWriter, Write as _, pipe};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Command, Output};

const CAMPAIGN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/campaign");
/// Bytes of the input that a command gets before it is ended; less than a pipe holds.
const FIRST: usize = 30_000;
const SIGNALS: [Signal; 4] = [Signal::INT, Signal::TERM, Signal::HUP, Signal::KILL];

/// A command that makes results from what it reads on standard input, with the files that it replaces.
struct Derived {
    arguments: &'static [&'static str],
    input: &'static str,
    results: &'static [&'static str],
}

const DERIVED: [Derived; 3] = [
    Derived {
        arguments: &["replay", "--table", "imu-a.toml", "-", "-o", "out.csv"],
        input: RUN,
        results: &["out.csv"],
    },
    Derived {
        arguments: &["verify", "--table", "imu-a.toml", "-", "--report", "r.html"],
        input: "still/run.csv",
        results: &["r.html"],
    },
    Derived {
        arguments: &["calibrate", "turntable", "campaign.toml", "-", "-o", "t.toml", "--report", "r.html"],
        input: concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/campaign/samples.csv"),
        results: &["t.toml", "r.html"],
    },
];

impl Derived {
    /// A folder with the command's inputs, and with old results.
    fn prepare(&self) -> TestDomain {
        let domain = TestDomain::new();
        domain.write("imu-a.toml", TABLE);
        fs::copy(format!("{CAMPAIGN}/campaign.toml"), domain.path("campaign.toml")).unwrap();
        if self.input.starts_with("still/") {
            domain.run_ok(&["simulate", "run", "-o", "still", "--interval", "5"]);
            fs::rename(domain.path("still/truth.toml"), domain.path("imu-a.toml")).unwrap();
        }
        self.results.iter().for_each(|name| drop(domain.write(name, "old\n")));
        domain
    }

    /// Starts the command, gives it the first of its rows, and waits until it has created its files. It then waits for
    /// the rest.
    fn start(&self, domain: &TestDomain) -> (Process, PipeWriter) {
        let (input, mut writer) = pipe().unwrap();
        writer.write_all(&fs::read(domain.path(self.input)).unwrap()[..FIRST]).unwrap();
        let mut command = domain.isotherm(self.arguments);
        command.stdin(input);
        let process = domain.start(command);
        wait_until("staged files", || staged(domain).len() == self.results.len());
        (process, writer)
    }

    fn assert_old(&self, domain: &TestDomain, what: &str) {
        for name in self.results {
            assert_eq!(fs::read_to_string(domain.path(name)).unwrap(), "old\n", "{what}: {name}");
        }
    }
}

/// The names of files in the test's folder that are not complete.
fn staged(domain: &TestDomain) -> Vec<String> {
    let names = fs::read_dir(domain.path("")).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with(".isotherm-")).collect()
}

#[test]
fn what_can_be_made_again_leaves_nothing() {
    for derived in &DERIVED {
        let name = derived.arguments[0];
        for signal in SIGNALS {
            let domain = derived.prepare();
            let (process, _input) = derived.start(&domain);
            process.signal(signal);
            let (status, log) = process.wait();
            assert_eq!(status.signal(), Some(signal.as_raw()), "{name}: {status}\n{log}");
            derived.assert_old(&domain, name);
            // No program can do anything about SIGKILL: its temporary files stay.
            let left = staged(&domain);
            let expected = if signal == Signal::KILL { derived.results.len() } else { 0 };
            assert_eq!(left.len(), expected, "{name}, {signal:?}: {left:?}");
            assert!(left.iter().all(|name| name.starts_with(".isotherm-")), "{left:?}");
        }
        // A refused input: the first row comes again.
        let domain = derived.prepare();
        let (process, mut input) = derived.start(&domain);
        let text = fs::read_to_string(domain.path(derived.input)).unwrap();
        write!(input, "\n{}\n", text.lines().nth(1).unwrap()).unwrap();
        drop(input);
        let (status, log) = process.wait();
        assert_eq!(status.code(), Some(65), "{name}: {log}");
        derived.assert_old(&domain, name);
        assert!(staged(&domain).is_empty());
    }
}

/// Runs the command after these commands of a shell, with its input from the file.
fn run_after(domain: &TestDomain, unshare: &[&str], preparation: &str, arguments: &[&str], input: &str) -> Output {
    let mut command = domain.isotherm_after(unshare, preparation, arguments);
    command.stdin(File::open(domain.path(input)).unwrap());
    domain.finish(command)
}

fn assert_failed(output: &Output, what: &str, cause: &str) {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(74), "{what}: {}\n{said}", output.status);
    assert!(said.contains(cause), "{what}: {cause:?} is not in:\n{said}");
}

#[test]
fn a_file_limit_is_an_error_and_leaves_nothing() {
    for derived in &DERIVED {
        let domain = derived.prepare();
        // A shell counts blocks of 512 or 1024 bytes; both are too few for any of the results.
        let output = run_after(&domain, &[], "ulimit -f 4", derived.arguments, derived.input);
        assert_failed(&output, derived.arguments[0], "File too large");
        derived.assert_old(&domain, derived.arguments[0]);
        assert!(staged(&domain).is_empty());
    }
    for arguments in [&["simulate", "run", "-o", "run"][..], &["man", "-o", "man"]] {
        let domain = TestDomain::new();
        assert_failed(
            &domain.finish(domain.isotherm_after(&[], "ulimit -f 1", arguments)),
            arguments[0],
            "File too large",
        );
        let folder = domain.path(arguments.last().unwrap());
        let cut = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let cut: Vec<_> = cut.filter(|name| !name.ends_with(".1")).collect();
        assert!(cut.is_empty(), "{cut:?}");
    }
}

/// Runs the command in a folder that is a full disk; `first` is copied there before the rest is filled. Returns also
/// what is there afterwards.
fn run_on_full_disk(
    domain: &TestDomain,
    first: &str,
    room: &str,
    arguments: &[&str],
    input: &str,
) -> (Output, Vec<String>) {
    fs::create_dir(domain.path("full")).unwrap();
    let fill = format!("head -c {room} /dev/zero > room && head -c 1m /dev/zero > fill 2> /dev/null; rm room");
    let script = format!(
        "mount -t tmpfs -o size=512k tmpfs full && cp {first} full && cd full && {{ {fill}; \
         \"$0\" \"$@\"; code=$?; echo left: $(ls -A) >&2; exit $code; }}"
    );
    let plain = domain.isotherm(arguments);
    let mut command = Command::new("unshare");
    command.args(["-m", "sh", "-c", &script]).arg(plain.get_program()).args(plain.get_args());
    command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?))));
    command.current_dir(domain.path("")).stdin(File::open(domain.path(input)).unwrap());
    let output = domain.finish(command);
    let said = text(&output.stderr);
    let left = said.lines().find_map(|line| line.strip_prefix("left: ")).unwrap_or_else(|| panic!("{said}"));
    let left = left.split(' ').map(str::to_owned).collect();
    (output, left)
}

#[test]
fn a_full_disk_is_an_error_and_leaves_nothing() {
    if !may_mount() {
        return;
    }
    for derived in &DERIVED {
        let domain = derived.prepare();
        let inputs = ["campaign.toml", "imu-a.toml"];
        let inputs: Vec<_> = inputs.into_iter().filter(|name| derived.arguments.contains(name)).collect();
        let first = [&inputs, derived.results].concat().join(" ");
        let (output, left) = run_on_full_disk(&domain, &first, "4096", derived.arguments, derived.input);
        assert_failed(&output, derived.arguments[0], "No space left on device");
        let mut expected = [&["fill"], &inputs[..], derived.results].concat();
        expected.sort_unstable();
        assert_eq!(left, expected, "{}", derived.arguments[0]);
    }
}

#[test]
fn a_closed_standard_output_is_an_error() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    domain.write("line.csv", "x,y\n0,1\n1,1.1\n2,1.2\n3,1.3\n");
    fs::copy(format!("{CAMPAIGN}/campaign.toml"), domain.path("campaign.toml")).unwrap();
    let plan = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/plan.toml");
    let samples = format!("{CAMPAIGN}/samples.csv");
    let prints: [&[&str]; 14] = [
        &["replay", "--table", "imu-a.toml", RUN],
        &["verify", "--table", "imu-a.toml", RUN],
        &["regress", "line.csv", "--x", "x", "--y", "y"],
        &["calibrate", "turntable", "campaign.toml", &samples, "-o", "-"],
        &["simulate", "run", "-o", "run"],
        &["feed", "--imu", "imu-a", RUN],
        &["record", "--imu", "imu-a", "-o", "-"],
        &["status"],
        &["check", "imu-a.toml"],
        &["clean"],
        &["completions", "bash"],
        &["man"],
        &["campaign", "check", plan],
        &["--help"],
    ];
    for arguments in prints {
        // Closed, and open for reading only.
        for redirection in ["exec >&-", "exec 1< imu-a.toml"] {
            let output = domain.finish(domain.isotherm_after(&[], redirection, arguments));
            assert_failed(
                &output,
                &format!("{arguments:?} {redirection}"),
                "stdout: it is closed or cannot be written",
            );
        }
    }
    assert!(!domain.path("run").exists(), "made before the check");
    // /dev/null is a choice, however it is opened.
    for redirection in ["exec > /dev/null", "exec 1<> /dev/null"] {
        let output = domain.finish(domain.isotherm_after(&[], redirection, prints[0]));
        assert!(output.status.success(), "{redirection}: {}", text(&output.stderr));
    }
    // Commands whose results are files need no standard output.
    for arguments in
        [&["replay", "--table", "imu-a.toml", RUN, "-o", "o.csv"][..], &["feed", "--imu", "imu-a", RUN, "-o", "f.csv"]]
    {
        let output = domain.finish(domain.isotherm_after(&[], "exec >&-", arguments));
        assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    }
    assert_eq!(fs::read(domain.path("o.csv")).unwrap(), fs::read(domain.path("f.csv")).unwrap());
    service.terminate();
    // Other mistakes are reported, too, with its own exit code.
    domain.write("bad.toml", "bad\n");
    for (arguments, code) in [(&["check", "bad.toml"][..], 78), (&["status"], 69)] {
        let output = domain.finish(domain.isotherm_after(&[], "exec >&-", arguments));
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", text(&output.stderr));
    }
}

/// A feed writes whole rows of a whole file, or none; a recording keeps what it has.
#[test]
fn a_feed_that_ends_early_leaves_the_old_file() {
    for signal in SIGNALS {
        let domain = TestDomain::new();
        let service = domain.serve_recording();
        domain.write("fed.csv", "old\n");
        let process = domain.spawn(&["feed", "--imu", "imu-a", "-o", "fed.csv", "--rate", "500", RUN]);
        wait_until("samples", || domain.imu_status()["received"].as_u64() > Some(10));
        process.signal(signal);
        let (status, log) = process.wait();
        if signal == Signal::KILL {
            assert_eq!(status.signal(), Some(signal.as_raw()), "{log}");
        } else {
            assert_eq!((status.code(), log.contains("interrupted")), (Some(1), true), "{log}");
        }
        assert_eq!(fs::read_to_string(domain.path("fed.csv")).unwrap(), "old\n");
        assert_eq!(staged(&domain).len(), usize::from(signal == Signal::KILL));
        domain.run_ok(&["feed", "--imu", "imu-a", "-o", "fed.csv", RUN]);
        let whole = domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
        assert_eq!(fs::read_to_string(domain.path("fed.csv")).unwrap(), whole);
        service.terminate();
    }
}

#[test]
fn a_recording_keeps_its_rows_up_to_a_file_limit() {
    let domain = TestDomain::new();
    domain.run_ok(&["simulate", "run", "-o", "run", "--interval", "0.5", "--imu", "imu-a"]);
    let service = domain.serve(&["--imu", "imu-a=run/truth.toml"]);
    // 1.5 or 3 MB, as a shell counts. The objects in shared memory are smaller, and the file takes 3.4 MB.
    let record = ["record", "--imu", "imu-a", "--stream", "raw", "--flush", "0.05", "-o", "r.csv"];
    let recorder = domain.start(domain.isotherm_after(&[], "ulimit -f 3000", &record));
    recorder.wait_for_log("recording imu-a");
    // If the recorder has left rows out, it gets the whole run again.
    while !recorder.has_ended() {
        domain.run_ok(&["feed", "--imu", "imu-a", "run/run.csv"]);
    }
    let (status, log) = recorder.wait();
    assert_eq!(status.code(), Some(74), "{log}");
    assert!(
        log.contains("rows at the end could not be written") && log.contains("writing r.csv: File too large"),
        "{log}"
    );
    assert!(domain.run_ok(&["replay", "--table", "run/truth.toml", "r.csv"]).lines().count() > 1000);
    service.terminate();
}

#[test]
fn a_new_file_has_the_permissions_of_the_old_one() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let commands: [&[&str]; 2] =
        [&["feed", "--imu", "imu-a", "-o", "o.csv", RUN], &["replay", "--table", "imu-a.toml", "-o", "o.csv", RUN]];
    for arguments in commands {
        // None is there, and the umask counts; it counts no more for a file that is replaced.
        for (old, new) in [(None, 0o600), (Some(0o666), 0o666), (Some(0o600), 0o600), (Some(0o640), 0o640)] {
            let _ = fs::remove_file(domain.path("o.csv"));
            if let Some(mode) = old {
                fs::set_permissions(domain.write("o.csv", "old\n"), Permissions::from_mode(mode)).unwrap();
            }
            let output = domain.finish(domain.isotherm_after(&[], "umask 077", arguments));
            assert!(output.status.success(), "{}", text(&output.stderr));
            let mode = fs::metadata(domain.path("o.csv")).unwrap().permissions().mode() & 0o7777;
            assert_eq!(mode, new, "{}, {old:?}: {mode:o}", arguments[0]);
        }
    }
    service.terminate();
}
