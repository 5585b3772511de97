//! What `acquire --record` does when its disk is full, and how its files follow each other.

use super::{Device, ENDLESS, counts, describe, samples, tally_of};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{Process, TestDomain, may_mount, wait_until};
use rustix::fs::statvfs;
use rustix::process::Signal;
use serde_json::Value;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A disk of its own, in the folder `small`, as long as its process lives.
struct Disk {
    holder: Process,
    /// Where this process finds it.
    inside: PathBuf,
    folder: PathBuf,
}

impl Disk {
    fn mount(domain: &TestDomain, size: &str) -> Self {
        let folder = domain.path("small");
        fs::create_dir(&folder).unwrap();
        let mut holder = Command::new("unshare");
        let mount = format!("mount -t tmpfs -o size={size} tmpfs small && echo mounted >&2 && exec sleep 1000");
        holder.args(["-m", "sh", "-c", &mount]).current_dir(domain.path(""));
        let holder = domain.start(holder);
        holder.wait_for_log("mounted");
        let inside = PathBuf::from(format!("/proc/{}/root{}", holder.pid(), folder.display()));
        Self { holder, inside, folder }
    }

    /// Fills it up, but for so many bytes.
    fn fill_but(&self, bytes: u64) {
        let more = vec![0; self.free().saturating_sub(bytes) as usize];
        let fill = fs::File::options().create(true).append(true).open(self.inside.join("fill"));
        fill.unwrap().write_all(&more).unwrap();
    }

    fn free(&self) -> u64 {
        let found = statvfs(&self.inside).unwrap();
        found.f_bavail * found.f_frsize
    }

    fn make_room(&self) {
        fs::remove_file(self.inside.join("fill")).unwrap();
    }

    /// Starts `isotherm acquire source.toml --dry-run --json` with these words, where the disk is.
    fn acquire(&self, domain: &TestDomain, words: &[&str]) -> Process {
        let plain = domain.isotherm(&[&["acquire", "source.toml", "--dry-run", "--json"], words].concat());
        let mut command = Command::new("nsenter");
        command.args(["-m", "-t", &self.holder.pid().to_string(), "sh", "-c", "cd \"$0\" && exec \"$@\""]);
        command.arg(self.folder.parent().unwrap()).arg(plain.get_program()).args(plain.get_args());
        command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?))));
        domain.start(command)
    }

    /// Rows of all pieces, which have no gap but where a process was killed.
    fn rows(&self, files: &[PathBuf]) -> u64 {
        files.iter().map(|file| samples(&fs::read_to_string(file).unwrap()).len() as u64).sum()
    }

    /// The pieces of `r.csv`, in their order.
    fn pieces(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.inside).unwrap().map(|entry| entry.unwrap().path());
        let is_piece = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("r-"));
        let mut pieces: Vec<_> = entries.filter(is_piece).collect();
        pieces.sort();
        pieces
    }
}

/// Ends it with SIGTERM. Returns its exit code, its last tally and its log.
fn end(acquire: Process) -> (Option<i32>, Value, String) {
    acquire.signal(Signal::TERM);
    let (status, log) = acquire.wait();
    (status.code(), tally_of(&log), log)
}

fn device(domain: &TestDomain) -> Device {
    describe(domain, Emulator::Vn100, &[]);
    Device::start(domain, Emulator::Vn100, &["--frames", ENDLESS])
}

/// It is full when the acquisition begins, has room, is full again, has room, and is full at the end. Each row is
/// written or counted.
#[test]
fn a_full_disk_costs_no_row_that_is_not_counted() {
    if !may_mount() {
        return;
    }
    for format in ["csv", "mcap"] {
        let domain = TestDomain::new();
        let device = device(&domain);
        domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
        let disk = Disk::mount(&domain, "4m");
        disk.fill_but(0);
        let name = format!("small/r.{format}");
        let acquire = disk.acquire(&domain, &["--record", &name]);
        acquire.wait_for_log("rows wait for room");
        disk.make_room();
        let inside = disk.inside.join(format!("r.{format}"));
        let length = || fs::metadata(&inside).map_or(0, |found| found.len());
        wait_until("rows", || length() > 20_000);
        disk.fill_but(8192);
        acquire.wait_for_log("what is written stays, the rest waits for room");
        let full = length();
        disk.make_room();
        acquire.wait_for_log("there is room again, recording continues");
        wait_until("more rows", || length() > full);
        disk.fill_but(0);
        let before = length();
        // Nobody says it again within a minute: the file stays as it is while the device goes on.
        let mut same = 0;
        wait_until("a disk that is full", || {
            same = if length() == before { same + 1 } else { 0 };
            std::thread::sleep(std::time::Duration::from_millis(100));
            same > 15
        });
        let (code, tally, log) = end(acquire);
        let [taken, recorded, lost] = counts(&tally, ["samples", "recorded", "not_recorded"]);
        assert_eq!(recorded + lost, taken, "{format}: {log}");
        assert!(recorded > 0 && lost > 0 && code == Some(74), "{format}: {code:?} {log}");
        assert!(log.contains(&format!("{lost} rows were not recorded")), "{log}");
        let copy = format!("copy.{format}");
        fs::copy(&inside, domain.path(&copy)).unwrap();
        let replayed = domain.run_ok(&["replay", "--table", "imu-a.toml", &copy]);
        assert_eq!(replayed.lines().count() as u64, recorded + 1, "{format}: {log}");
        device.0.terminate();
    }
}

/// The files follow each other, the oldest goes, also one of a process that was killed, and nothing else does.
#[test]
fn the_oldest_files_make_room() {
    if !may_mount() {
        return;
    }
    const KEEP: u64 = 1_000_000;
    let domain = TestDomain::new();
    let device = device(&domain);
    let disk = Disk::mount(&domain, "4m");
    disk.fill_but(KEEP + 300_000);
    let precious = disk.inside.join("r-0001.csv");
    fs::write(&precious, "a note").unwrap();
    let words = ["--record", "small/r.csv", "--rotate-size", "50k", "--keep-free", "1M", "--delete-oldest"];
    let acquire = disk.acquire(&domain, &words);
    acquire.wait_for_log("removed small/r-0002.csv, the oldest");
    assert!(disk.free() >= KEEP);
    acquire.kill();
    let last = disk.pieces().last().unwrap().clone();
    let acquire = disk.acquire(&domain, &words);
    let name = |path: &Path| format!("removed small/{}, the oldest", path.file_name().unwrap().display());
    acquire.wait_for_log(&name(&last));
    assert!(disk.free() >= KEEP);
    let (code, tally, log) = end(acquire);
    let [taken, recorded, lost] = counts(&tally, ["samples", "recorded", "not_recorded"]);
    assert_eq!((code, recorded, lost), (Some(0), taken, 0), "{log}");
    let pieces = disk.pieces();
    assert_eq!((&pieces[0], fs::read_to_string(&precious).unwrap().as_str()), (&precious, "a note"));
    assert!(pieces[1] > last && pieces.len() > 2, "{pieces:?}");
    // From the second on each piece is the next one.
    let of_pieces: Vec<_> = pieces[1..].iter().flat_map(|file| samples(&fs::read_to_string(file).unwrap())).collect();
    assert!(of_pieces.windows(2).all(|pair| pair[0].sequence + 1 == pair[1].sequence));
    assert_eq!(of_pieces.last().unwrap().sequence + 1, taken);
    // Without the order to remove, nothing is removed: rows wait, and go on when there is room.
    disk.fill_but(KEEP);
    let acquire = disk.acquire(&domain, &words[..6]);
    acquire.wait_for_log("fewer than 1000000 bytes would stay free");
    disk.make_room();
    let before = disk.rows(&pieces[1..]);
    wait_until("more rows", || disk.pieces().len() > pieces.len() && disk.rows(&disk.pieces()[1..]) > before + 100);
    let (code, tally, log) = end(acquire);
    let [taken, recorded, lost] = counts(&tally, ["samples", "recorded", "not_recorded"]);
    assert_eq!((code, recorded, lost), (Some(0), taken, 0), "{log}");
    assert_eq!(disk.rows(&disk.pieces()[1..]), before + recorded);
    device.0.terminate();
}

#[test]
fn options_of_files_that_cannot_be_are_refused() {
    let domain = TestDomain::new();
    describe(&domain, Emulator::Vn100, &[]);
    for (words, cause) in [
        (&["--rotate-size", "1M"][..], "are for --record"),
        (&["--record", "r.csv", "--delete-oldest"], "--keep-free"),
        (&["--record", "r.csv", "--keep-free", "1M", "--delete-oldest"], "give --rotate-size or --rotate-time"),
    ] {
        let output = domain.run(&[&["acquire", "source.toml"], words].concat());
        let log = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(64) && log.contains(cause), "{words:?}: {log}");
    }
}
