//! What commands leave when they end early: by a signal, a full disk, a limit, a closed standard output;
//! docs/operate.md has it in short.
//!
//! Over 400 lines: one table, one file.

use isotherm_tests::{Needs, Process, RUN, TABLE, TIMEOUT, TestDomain, may_mount, skip, text, wait_until};
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::fs::{self, File, Permissions};
use std::io::{PipeWriter, Write as _, pipe};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, lchown};
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{Command, Output};
use std::thread;
use std::time::{Duration, Instant};

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

/// The names of files in the test's folder that begin or end like files that are not complete.
fn staged(domain: &TestDomain) -> Vec<String> {
    let names = fs::read_dir(domain.path("")).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with(".isotherm-") || name.ends_with(".partial")).collect()
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
        // A refused input.
        let domain = derived.prepare();
        let (process, mut input) = derived.start(&domain);
        input.write_all(b"x\nx\n").unwrap();
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
         \"$0\" \"$@\"; code=$?; echo left: $(ls -A) >&2; cat *.partial > ../kept 2> /dev/null; exit $code; }}"
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

/// The table and the report after the command has been stopped before its `number`th removal or renaming of a file, and
/// then got this signal.
#[cfg(target_arch = "x86_64")]
fn stopped_before(number: usize, signal: Signal) -> Option<BTreeMap<&'static str, bool>> {
    let derived = &DERIVED[2];
    let domain = derived.prepare();
    let (process, mut input) = derived.start(&domain);
    let pid = Pid::from_raw(process.pid().cast_signed());
    if ptrace::seize(pid, ptrace::Options::PTRACE_O_TRACESYSGOOD).is_err() {
        skip("this user may not trace a process", Needs::Machine);
        return None;
    }
    // Only a stopped thread can be made to stop at every system call.
    ptrace::interrupt(pid).unwrap();
    let writer = thread::spawn(move || input.write_all(&fs::read(DERIVED[2].input).unwrap()[FIRST..]).unwrap());
    let (deadline, mut seen) = (Instant::now() + TIMEOUT, 0);
    let names = [libc::SYS_rename, libc::SYS_renameat, libc::SYS_renameat2, libc::SYS_unlink, libc::SYS_unlinkat];
    loop {
        assert!(Instant::now() < deadline, "the traced command does not end");
        match waitpid(pid, Some(WaitPidFlag::WNOHANG | WaitPidFlag::__WALL)).unwrap() {
            WaitStatus::StillAlive => thread::sleep(Duration::from_micros(50)),
            WaitStatus::PtraceSyscall(_) => {
                let registers = ptrace::getregs(pid).unwrap();
                // At the entry of a system call its result is not there yet.
                let entry = registers.rax.cast_signed() == -i64::from(libc::ENOSYS);
                if entry && names.contains(&registers.orig_rax.cast_signed()) {
                    if seen == number {
                        break;
                    }
                    seen += 1;
                }
                ptrace::syscall(pid, None).unwrap();
            }
            WaitStatus::PtraceEvent(..) => ptrace::syscall(pid, None).unwrap(),
            WaitStatus::Stopped(_, signal) => ptrace::syscall(pid, signal).unwrap(),
            other => panic!("{other:?}"),
        }
    }
    process.signal(signal);
    if signal != Signal::KILL {
        // The thread that handles the signal runs while the main thread is stopped. It must wait.
        thread::sleep(Duration::from_millis(300));
        ptrace::detach(pid, None).unwrap();
    }
    let (status, log) = process.wait();
    assert!(status.success() || status.signal() == Some(signal.as_raw()), "{status}\n{log}");
    writer.join().unwrap();
    let new = |name| fs::read_to_string(domain.path(name)).ok().map(|text| (name, text != "old\n"));
    Some(derived.results.iter().filter_map(|name| new(*name)).collect())
}

#[cfg(target_arch = "x86_64")]
#[test]
fn no_old_table_stays_beside_a_new_report() {
    let (old, new) = (false, true);
    let sigkill: [&[(&str, bool)]; 4] = [
        // Before the old report gets a hidden name, before the table is renamed, before the report is renamed, and
        // before the old report is removed.
        &[("t.toml", old), ("r.html", old)],
        &[("t.toml", old)],
        &[("t.toml", new)],
        &[("t.toml", new), ("r.html", new)],
    ];
    for (number, expected) in sigkill.into_iter().enumerate() {
        let Some(left) = stopped_before(number, Signal::KILL) else { return };
        assert_eq!(left, expected.iter().copied().collect(), "killed before step {number}");
        // Every other signal waits until both are there.
        for signal in [Signal::INT, Signal::TERM] {
            let left = stopped_before(number, signal).unwrap();
            assert_eq!(left, BTreeMap::from([("t.toml", new), ("r.html", new)]), "{signal:?} before step {number}");
        }
    }
}

#[test]
fn a_table_that_cannot_be_replaced_leaves_both_old_files() {
    let derived = &DERIVED[2];
    for fixed in derived.results {
        let domain = derived.prepare();
        // In a folder with the sticky bit, only its owner may replace a file: a root that lacks two capabilities may
        // not.
        fs::set_permissions(domain.path(""), Permissions::from_mode(0o1777)).unwrap();
        if !(give_to_nobody(&domain.path("")) && give_to_nobody(&domain.path(fixed))) {
            return;
        }
        let plain = domain.isotherm(derived.arguments);
        let mut command = Command::new("setpriv");
        command.arg("--bounding-set=-fowner,-chown").arg(plain.get_program()).args(plain.get_args());
        command.current_dir(domain.path("")).stdin(File::open(domain.path(derived.input)).unwrap());
        let output = domain.finish(command);
        assert_failed(&output, fixed, &format!("writing {fixed}: "));
        derived.assert_old(&domain, fixed);
        assert!(staged(&domain).is_empty());
    }
}

/// The rows that `feed` has kept; asserts that they are the first ones of the whole result.
fn kept(domain: &TestDomain, name: &str) -> usize {
    let kept = fs::read_to_string(domain.path(name)).unwrap();
    let whole = domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
    assert!(kept.ends_with('\n') && whole.starts_with(&kept), "not the first rows:\n{kept}");
    kept.lines().count() - 1
}

fn feed(domain: &TestDomain, more: &[&str]) -> Process {
    domain.spawn(&[&["feed", "--imu", "imu-a", "-o", "fed.csv"], more].concat())
}

fn wait_for_rows(domain: &TestDomain, name: &str) {
    wait_until("rows", || fs::read_to_string(domain.path(name)).is_ok_and(|text| text.lines().count() > 10));
}

#[test]
fn a_feed_that_ends_early_keeps_its_rows() {
    for signal in SIGNALS {
        let domain = TestDomain::new();
        let service = domain.serve_recording();
        domain.write("fed.csv", "old\n");
        let process = feed(&domain, &["--rate", "500", RUN]);
        wait_for_rows(&domain, "fed.csv.partial");
        process.signal(signal);
        let (status, log) = process.wait();
        let rows = kept(&domain, "fed.csv.partial");
        if signal == Signal::KILL {
            assert_eq!(status.signal(), Some(signal.as_raw()), "{log}");
        } else {
            assert_eq!(status.code(), Some(1), "{log}");
            assert!(
                log.contains(&format!("{rows} rows are in ")) && log.contains("fed.csv.partial: interrupted"),
                "{log}"
            );
        }
        assert!(rows > 9);
        assert_eq!(fs::read_to_string(domain.path("fed.csv")).unwrap(), "old\n");
        assert_eq!(staged(&domain), ["fed.csv.partial"]);
        // The next run does not replace the rows, and says what to do.
        let refused = domain.run(&["feed", "--imu", "imu-a", "-o", "fed.csv", RUN]);
        assert_failed(&refused, "feed", "fed.csv.partial has what an earlier run received; move or remove it");
        assert_eq!(kept(&domain, "fed.csv.partial"), rows);
        fs::remove_file(domain.path("fed.csv.partial")).unwrap();
        domain.run_ok(&["feed", "--imu", "imu-a", "-o", "fed.csv", RUN]);
        assert_eq!(kept(&domain, "fed.csv"), 4000);
        assert!(staged(&domain).is_empty());
        service.terminate();
    }
}

#[test]
fn a_feed_without_rows_leaves_nothing() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let acquisition = domain.acquisition("imu-a");
    for signal in SIGNALS {
        let process = feed(&domain, &[RUN]);
        process.wait_for_log(&format!(
            "waiting up to 15 s: IMU imu-a already has an acquisition process, pid {}",
            std::process::id()
        ));
        // Another one with the same output.
        let second = domain.run(&["feed", "--imu", "imu-a", "-o", "fed.csv", RUN]);
        assert_failed(&second, "feed", "another process is writing ");
        process.signal(signal);
        let (status, log) = process.wait();
        assert_eq!(status.signal(), Some(signal.as_raw()), "{log}");
        // The file without rows that a SIGKILL leaves is used by the next run.
        assert_eq!(staged(&domain).len(), usize::from(signal == Signal::KILL));
    }
    drop(acquisition);
    domain.run_ok(&["feed", "--imu", "imu-a", "-o", "fed.csv", RUN]);
    assert_eq!(kept(&domain, "fed.csv"), 4000);
    assert!(staged(&domain).is_empty());
    let nowhere = domain.run(&["feed", "--imu", "imu-a", "-o", "nowhere/fed.csv", RUN]);
    assert_failed(&nowhere, "feed", "writing nowhere/fed.csv: there is no folder nowhere; make it, or name another");
    service.terminate();
}

#[test]
fn a_feed_keeps_its_rows_whatever_ends_it() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let said = |output: &Output, code: i32, cause: &str| {
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        let rows = kept(&domain, "fed.csv.partial");
        assert!(said.contains(&format!("{rows} rows are in ")) && said.contains(cause), "{said}");
        fs::remove_file(domain.path("fed.csv.partial")).unwrap();
        rows
    };
    // A refused sample.
    let recording = fs::read_to_string(RUN).unwrap();
    let lines: Vec<_> = recording.lines().take(1001).collect();
    domain.write("refused.csv", &format!("{}\nx{}\n", lines.join("\n"), lines[1000]));
    let output = domain.run(&["feed", "--imu", "imu-a", "-o", "fed.csv", "refused.csv"]);
    assert_eq!(said(&output, 65, "refused.csv:1002: "), 1000);
    // A full disk.
    if may_mount() {
        let (output, left) =
            run_on_full_disk(&domain, "imu-a.toml", "40960", &["feed", "--imu", "imu-a", "-o", "fed.csv", RUN], RUN);
        assert_eq!(left, ["fed.csv.partial", "fill", "imu-a.toml"]);
        fs::rename(domain.path("kept"), domain.path("fed.csv.partial")).unwrap();
        let rows = said(&output, 74, "fed.csv.partial: writing fed.csv: No space left on device");
        assert!((100..4000).contains(&rows), "{rows}");
    }
    // A time-out.
    let process = feed(&domain, &["--rate", "500", "--timeout", "1", RUN]);
    wait_for_rows(&domain, "fed.csv.partial");
    service.kill();
    let (status, log) = process.wait();
    assert_eq!(status.code(), Some(69), "{log}");
    let rows = kept(&domain, "fed.csv.partial");
    assert!(
        log.contains(&format!("{rows} rows are in ")) && log.contains("no answer from the service for 1 s"),
        "{log}"
    );
}

#[test]
fn feed_and_record_keep_their_rows_up_to_a_file_limit() {
    let domain = TestDomain::new();
    domain.run_ok(&["simulate", "run", "-o", "run", "--interval", "0.5", "--imu", "imu-a"]);
    let service = domain.serve(&["--imu", "imu-a=run/truth.toml"]);
    // 1.5 or 3 MB, as a shell counts. The objects in shared memory are smaller, and each of the files takes 3.4 MB.
    let limited = |arguments: &[&str]| domain.isotherm_after(&[], "ulimit -f 3000", arguments);
    let record = ["record", "--imu", "imu-a", "--stream", "raw", "--flush", "0.05", "-o", "r.csv"];
    let recorder = domain.start(limited(&record));
    recorder.wait_for_log("recording imu-a");
    let output = domain.finish(limited(&["feed", "--imu", "imu-a", "-o", "fed.csv", "run/run.csv"]));
    let replay = |file: &str| domain.run_ok(&["replay", "--table", "run/truth.toml", file]);
    let kept = fs::read_to_string(domain.path("fed.csv.partial")).unwrap();
    assert!(kept.ends_with('\n') && replay("run/run.csv").starts_with(&kept));
    let rows = kept.lines().count() - 1;
    assert_failed(&output, "feed", &format!("{rows} rows are in fed.csv.partial: writing fed.csv: File too large"));
    assert!(rows > 1000 && staged(&domain) == ["fed.csv.partial"]);
    // The recorder has got as many; if that was not enough for its limit, it gets the whole run.
    if !recorder.has_ended() {
        domain.run_ok(&["feed", "--imu", "imu-a", "run/run.csv"]);
    }
    let (status, log) = recorder.wait();
    assert_eq!(status.code(), Some(74), "{log}");
    assert!(
        log.contains("rows at the end could not be written") && log.contains("writing r.csv: File too large"),
        "{log}"
    );
    assert!(replay("r.csv").lines().count() > 1000);
    service.terminate();
}

const NOBODY: u32 = 65_534;

/// Gives a file, link or folder to another user; false if this user may not.
fn give_to_nobody(path: &Path) -> bool {
    let root = rustix::process::geteuid().is_root();
    if root {
        lchown(path, Some(NOBODY), Some(NOBODY)).unwrap();
    } else {
        skip("only root can give a file to another user", Needs::Machine);
    }
    root
}

fn shell(domain: &TestDomain, script: &str) {
    let mut command = Command::new("sh");
    command.args(["-c", script]).current_dir(domain.path(""));
    assert!(command.status().unwrap().success(), "{script}");
}

#[test]
fn a_feed_writes_into_nothing_that_was_there_before() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    // As /tmp.
    fs::create_dir(domain.path("shared")).unwrap();
    fs::set_permissions(domain.path("shared"), Permissions::from_mode(0o1777)).unwrap();
    let partial = domain.path("shared/fed.csv.partial");
    let feed = ["feed", "--imu", "imu-a", "-o", "shared/fed.csv", RUN];
    let assert_refused = |kind: &str| {
        let before = fs::symlink_metadata(&partial).unwrap();
        let output = domain.run(&feed);
        let why =
            format!("fed.csv.partial is a {kind} of user {}; have it removed, or name another file", before.uid());
        assert_failed(&output, kind, &why);
        let after = fs::symlink_metadata(&partial).unwrap();
        assert_eq!((before.ino(), before.uid(), before.len()), (after.ino(), after.uid(), after.len()));
        assert!(!domain.path("shared/fed.csv").exists());
    };
    for (kind, script) in
        [("pipe", "mkfifo shared/fed.csv.partial"), ("link", "touch x; ln -s ../x shared/fed.csv.partial")]
    {
        shell(&domain, script);
        assert_refused(kind);
        fs::remove_file(&partial).unwrap();
    }
    fs::create_dir(&partial).unwrap();
    assert_refused("folder");
    fs::remove_dir(&partial).unwrap();
    // What a run of this user has left is removed, and not used: another name of it stays empty.
    shell(&domain, "touch shared/fed.csv.partial; ln shared/fed.csv.partial left");
    domain.run_ok(&feed);
    assert_eq!(kept(&domain, "shared/fed.csv"), 4000);
    assert_eq!(fs::read(domain.path("left")).unwrap(), b"");
    fs::remove_file(domain.path("shared/fed.csv")).unwrap();

    shell(&domain, "touch shared/fed.csv.partial; chmod 666 shared/fed.csv.partial");
    if give_to_nobody(&partial) {
        assert_refused("file");
        // The lock of another user says nothing about another run.
        let lock = File::open(&partial).unwrap();
        lock.lock().unwrap();
        assert_refused("file");
        drop(lock);
        // A run of root leaves this where it replaces a file of that user, in a folder that not everybody may write.
        for (name, content) in [("fed.csv", "old\n"), ("fed.csv.partial", "")] {
            give_to_nobody(&domain.write(name, content));
        }
        domain.run_ok(&["feed", "--imu", "imu-a", "-o", "fed.csv", RUN]);
        assert_eq!(kept(&domain, "fed.csv"), 4000);
        assert_eq!(fs::metadata(domain.path("fed.csv")).unwrap().uid(), NOBODY);
    }
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
            // What a killed run may have left.
            let left = domain.write("o.csv.partial", "");
            fs::set_permissions(left, Permissions::from_mode(0o666)).unwrap();
            let output = domain.finish(domain.isotherm_after(&[], "umask 077", arguments));
            assert!(output.status.success(), "{}", text(&output.stderr));
            let mode = fs::metadata(domain.path("o.csv")).unwrap().permissions().mode() & 0o7777;
            assert_eq!(mode, new, "{}, {old:?}: {mode:o}", arguments[0]);
        }
    }
    service.terminate();
}

#[test]
fn a_feed_does_not_take_its_input_for_its_rows() {
    let domain = TestDomain::new();
    fs::copy(RUN, domain.path("in.csv.partial")).unwrap();
    let output = domain.run(&["feed", "--imu", "imu-a", "-o", "in.csv", "in.csv.partial"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(64), "{said}");
    assert!(said.contains("in.csv.partial is the recording; write to another file"), "{said}");
    assert_eq!(fs::read(domain.path("in.csv.partial")).unwrap(), fs::read(RUN).unwrap());
}
