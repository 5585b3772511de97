//! SIGTERM ends an acquisition whatever its line does, and the record is whole then.

use super::pipeline::{received, serve_vn100};
use super::{Acquire, Device, ENDLESS, counts, describe, profile};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TIMEOUT, TestDomain, wait_until};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::ioctl_fionbio;
use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::ffi::OsString;
use std::fs;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::os::unix::fs::symlink;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Instant;

/// A pseudo-terminal at the test's line, whose other end is this test's.
pub(super) struct Terminal {
    controller: OwnedFd,
    /// Kept open, so that the line is there without a reader.
    _user_side: OwnedFd,
}

impl Terminal {
    pub(super) fn new(domain: &TestDomain) -> Self {
        let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&controller).unwrap();
        unlockpt(&controller).unwrap();
        ioctl_fionbio(&controller, true).unwrap();
        let path = OsString::from_vec(ptsname(&controller, Vec::new()).unwrap().into_bytes());
        let user_side = open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty()).unwrap();
        let mut settings = tcgetattr(&user_side).unwrap();
        settings.make_raw();
        tcsetattr(&user_side, OptionalActions::Now, &settings).unwrap();
        symlink(path, super::line(domain)).unwrap();
        Self { controller, _user_side: user_side }
    }

    /// Writes what the line takes within a moment. Returns how much that is.
    pub(super) fn write(&self, bytes: &[u8]) -> usize {
        let moment = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
        let _ = poll(&mut [PollFd::new(&self.controller, PollFlags::OUT)], Some(&moment));
        rustix::io::write(&self.controller, bytes).unwrap_or(0)
    }

    /// Writes all.
    pub(super) fn write_all(&self, mut bytes: &[u8]) {
        let begun = Instant::now();
        while !bytes.is_empty() {
            bytes = &bytes[self.write(bytes)..];
            assert!(begun.elapsed() < TIMEOUT, "nobody reads the line");
        }
    }
}

/// What the line does when the signal comes.
#[derive(Clone, Copy, Debug)]
enum Line {
    Silent,
    /// Bytes that each could begin a frame, without end.
    Syncs,
    /// Random bytes, without end.
    Noise,
}

/// Bytes of one kind, a few thousand.
fn babble(line: Line) -> Vec<u8> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    match line {
        Line::Silent => Vec::new(),
        Line::Syncs => vec![0xA5; 4096],
        Line::Noise => (0..4096).map(|_| random()).collect(),
    }
}

const FRAMES: u64 = 200;

#[test]
fn a_signal_ends_it_while_the_line_babbles_or_is_silent() {
    for line in [Line::Silent, Line::Syncs, Line::Noise] {
        for (service, record) in [(false, "acquired.mcap"), (true, "acquired.mcap"), (true, "acquired.csv")] {
            let domain = TestDomain::new();
            let terminal = Terminal::new(&domain);
            describe(&domain, Emulator::Stim300Rate, &[]);
            domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
            let service = service.then(|| domain.serve(&["--imu", "imu-a=imu-a.toml"]));
            let acquire = Acquire::start(&domain, "acquire", &["--record", record]);
            acquire.process.wait_for_log("reading ");
            let frames: Vec<_> = (0..FRAMES).flat_map(|number| Emulator::Stim300Rate.frame(number)).collect();
            terminal.write_all(&frames);
            let (ended, written) = (AtomicBool::new(false), AtomicU64::new(0));
            let tally = thread::scope(|scope| {
                scope.spawn(|| {
                    let babble = babble(line);
                    while !babble.is_empty() && !ended.load(Ordering::Relaxed) {
                        written.fetch_add(terminal.write(&babble) as u64, Ordering::Relaxed);
                    }
                });
                let is_babbling = || matches!(line, Line::Silent) || written.load(Ordering::Relaxed) > 1 << 20;
                wait_until("the babble", is_babbling);
                if service.is_some() {
                    wait_until("all answers", || domain.imu_status()["received"] == FRAMES);
                } else {
                    acquire.process.wait_for_log("waiting: ");
                }
                let asked = Instant::now();
                let tally = acquire.end();
                println!("{line:?}, {record}: ended after {:.0} ms", asked.elapsed().as_secs_f64() * 1e3);
                ended.store(true, Ordering::Relaxed);
                tally
            });
            // Without a service nothing shows when all has been read.
            let [samples] = counts(&tally, ["samples"]);
            let sent = if service.is_some() { FRAMES } else { 0 };
            assert!(samples == FRAMES || service.is_none() && samples > 0, "{line:?}, {record}: {tally}");
            let names = ["service/sent", "service/answered", "not_recorded"];
            assert_eq!(counts(&tally, names), [sent, sent, 0], "{line:?}, {record}: {tally}");
            if let Some(service) = service {
                service.terminate();
            }
            let replayed = domain.run_ok(&["replay", "--table", "imu-a.toml", record]);
            assert_eq!(replayed.lines().count() as u64, samples + 1, "{line:?}, {record}");
        }
    }
}

/// A pipe on stderr that is full and that nobody reads costs log lines, and nothing else.
#[test]
fn nobody_need_read_the_log() {
    let domain = TestDomain::new();
    let service = serve_vn100(&domain);
    let full = "mkfifo full && exec 2<>full && { dd if=/dev/zero of=full bs=4096 oflag=nonblock 2>/dev/null; true; }";
    let start = |words: &[&str]| {
        let words = [&["acquire", "source.toml"], words].concat();
        domain.start(domain.isotherm_after(&[], full, &words))
    };
    // Its last word waits for nobody either.
    let (status, log) = start(&[]).wait();
    assert_eq!((status.code(), log.as_str()), (Some(74), ""), "the device is absent");
    fs::remove_file(domain.path("full")).unwrap();
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let acquire = start(&[]);
    wait_until("samples", || received(&domain) > 100);
    acquire.signal(Signal::TERM);
    assert!(acquire.wait().0.success());
    device.0.terminate();
    service.terminate();
}

/// A device that never sends ends it, too, before the first byte; and a line without a device is none to wait for.
#[test]
fn a_signal_ends_it_before_anything_has_come() {
    let domain = TestDomain::new();
    let _terminal = Terminal::new(&domain);
    domain.write("source.toml", &profile(&domain, Emulator::Kvh1750, &[]));
    let acquire = Acquire::start(&domain, "acquire", &["--record", "empty.mcap"]);
    acquire.process.wait_for_log("nothing has come for");
    let tally = acquire.end();
    assert_eq!(counts(&tally, ["bytes", "frames", "samples", "sessions"]), [0; 4], "{tally}");
    assert!(domain.path("empty.mcap").exists());
}
