//! The live screen, on a pseudo-terminal.

use isotherm_tests::programs::whole_csv;
use isotherm_tests::{RUN, TIMEOUT, TestDomain, kill, text, wait_until, whole_recording};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcgetattr, tcsetwinsize};
use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::num::NonZeroU16;
use std::os::fd::OwnedFd;
use std::os::unix::fs::OpenOptionsExt as _;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// `isotherm top` on a terminal.
struct TopScreen {
    child: Child,
    keyboard: Arc<File>,
    /// Kept open, so that the terminal's settings can be read after the end.
    terminal: OwnedFd,
    settings_before: String,
    /// The terminal emulator, and everything that was written to the terminal.
    captured: Arc<Mutex<(vt100::Parser, Vec<u8>)>>,
    hung_up: Arc<AtomicBool>,
    capture_thread: Option<JoinHandle<()>>,
}

impl TopScreen {
    fn start(domain: &TestDomain, (columns, rows): (u16, u16), environment: &[(&str, &str)]) -> Self {
        let (master, slave) = terminal();
        tcsetwinsize(&slave, Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
        let settings_before = settings(&slave);
        let plain = domain.isotherm(&["top"]);
        // As after a login: the terminal controls the session, so its signals reach the program.
        let mut command = Command::new("setsid");
        command.arg("--ctty").arg(plain.get_program()).args(plain.get_args()).current_dir(domain.path(""));
        command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?))));
        command.env("TERM", "xterm-256color").env("LC_ALL", "C.UTF-8").env_remove("NO_COLOR");
        command.envs(environment.iter().copied());
        let stdio = || Stdio::from(slave.try_clone().unwrap());
        let child = command.stdin(stdio()).stdout(stdio()).stderr(stdio()).spawn().unwrap();
        domain.register_process(child.id());
        let captured = Arc::new(Mutex::new((vt100::Parser::new(cells(rows), cells(columns), 0), Vec::new())));
        let (keyboard, hung_up) = (Arc::new(File::from(master)), Arc::<AtomicBool>::default());
        let (sink, output, over) = (Arc::clone(&captured), Arc::clone(&keyboard), Arc::clone(&hung_up));
        let capture_thread = thread::spawn(move || {
            let mut buffer = [0; 4096];
            while !over.load(Relaxed) {
                let poll_time = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
                if poll(&mut [PollFd::new(&*output, PollFlags::IN)], Some(&poll_time)) == Ok(0) {
                    continue;
                }
                let Ok(length @ 1..) = (&*output).read(&mut buffer) else { return };
                let mut captured = sink.lock().unwrap();
                captured.0.process(&buffer[..length]);
                captured.1.extend_from_slice(&buffer[..length]);
            }
        });
        Self {
            child,
            keyboard,
            terminal: slave,
            settings_before,
            captured,
            hung_up,
            capture_thread: Some(capture_thread),
        }
    }

    fn screen(&self) -> String {
        self.captured.lock().unwrap().0.screen().contents()
    }

    /// Everything that has been written to the terminal.
    fn written(&self) -> Vec<u8> {
        self.captured.lock().unwrap().1.clone()
    }

    fn wait_for(&self, what: &str, condition: impl Fn(&str) -> bool) -> String {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            let screen = self.screen();
            if condition(&screen) {
                return screen;
            }
            assert!(Instant::now() < deadline, "{what} did not appear on the screen:\n{screen}");
            thread::sleep(Duration::from_millis(5));
        }
    }

    fn wait_for_text(&self, part: &str) -> String {
        self.wait_for(part, |screen| screen.contains(part))
    }

    fn press(&mut self, keys: &str) {
        (&*self.keyboard).write_all(keys.as_bytes()).unwrap();
    }

    fn resize(&self, (columns, rows): (u16, u16)) {
        self.captured.lock().unwrap().0.screen_mut().set_size(cells(rows), cells(columns));
        tcsetwinsize(&self.terminal, Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
    }

    /// Waits for the end and asserts that the terminal is as before.
    fn end(&mut self) -> ExitStatus {
        let mut status = None;
        wait_until("the end of top", || {
            status = self.child.try_wait().unwrap();
            status.is_some()
        });
        assert_eq!(settings(&self.terminal), self.settings_before, "the terminal's settings have changed");
        wait_until("the terminal's first screen", || {
            let captured = self.captured.lock().unwrap();
            !captured.0.screen().alternate_screen() && !captured.0.screen().hide_cursor()
        });
        status.unwrap()
    }
}

/// Closes the other end of the terminal, as when a remote connection breaks, and waits for the end.
fn hang_up(mut top: TopScreen) -> ExitStatus {
    top.hung_up.store(true, Relaxed);
    top.capture_thread.take().unwrap().join().unwrap();
    let nowhere = File::open("/dev/null").unwrap();
    top.keyboard = Arc::new(nowhere.try_clone().unwrap());
    top.terminal = nowhere.into();
    let mut status = None;
    wait_until("the end of top", || {
        status = top.child.try_wait().unwrap();
        status.is_some()
    });
    status.unwrap()
}

impl Drop for TopScreen {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Both ends of a new pseudo-terminal. They are closed on exec: a process that inherited them would keep the terminal
/// open.
fn terminal() -> (OwnedFd, OwnedFd) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let no_controlling_terminal = i32::try_from(OpenptFlags::NOCTTY.bits()).unwrap();
    let slave = OpenOptions::new().read(true).write(true).custom_flags(no_controlling_terminal).open(name).unwrap();
    (master, slave.into())
}

/// The settings of a terminal, as text.
fn settings(terminal: &OwnedFd) -> String {
    format!("{:?}", tcgetattr(terminal).unwrap())
}

fn cells(count: u16) -> NonZeroU16 {
    NonZeroU16::new(count).unwrap()
}

/// The number of received samples on the screen.
fn received(screen: &str) -> Option<u64> {
    screen.lines().find_map(|line| line.strip_prefix("samples ")?.trim_start().split(',').next()?.parse().ok())
}

/// Whether the output has an SGR sequence that sets a colour.
fn sets_colour(written: &[u8]) -> bool {
    let written = String::from_utf8_lossy(written);
    let sequences = written.split("\x1b[").skip(1).filter_map(|rest| {
        let end = rest.find(|character: char| !matches!(character, '0'..='9' | ';' | ':'))?;
        rest[end..].starts_with('m').then_some(&rest[..end])
    });
    let numbers =
        |sequence: &str| sequence.split([';', ':']).filter_map(|number| number.parse().ok()).collect::<Vec<u32>>();
    sequences.flat_map(numbers).any(|number| matches!(number, 30..=38 | 40..=48 | 90..=107))
}

#[test]
fn the_screen_updates_pauses_and_leaves_the_terminal_as_it_was() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "100", RUN]);
    let mut top = TopScreen::start(&domain, (80, 24), &[]);
    for part in ["imu-a", "117fc01d0047a7a2", "head [V]", "●", "latency us", "p99.9", "flags", "q quit", "? help"] {
        top.wait_for_text(part);
    }
    let count = received(&top.wait_for("samples", |screen| received(screen).is_some_and(|count| count > 0)));
    top.wait_for("more samples", |screen| received(screen) > count);
    assert!(sets_colour(&top.written()));

    top.press("p");
    let still = received(&top.wait_for_text("PAUSED"));
    let sent = || domain.imu_status()["received"].as_u64().unwrap();
    let before = sent();
    wait_until("samples during the pause", || sent() > before + 100);
    assert_eq!(received(&top.screen()), still);
    top.press("p");
    top.wait_for("more samples after the pause", |screen| received(screen) > still);
    top.press("?");
    top.wait_for_text("within the calibrated range");
    top.press("q");
    top.wait_for("the screen without the help", |screen| !screen.contains("within the calibrated range"));
    top.press("q");
    assert!(top.end().success());
    drop(feed);
    service.terminate();
}

#[test]
fn a_whole_imu_has_both_triads() {
    const RUN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/run-g.csv");
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let feed = domain.spawn(&["feed", "--imu", "imu-g", "--rate", "100", RUN]);
    let mut top = TopScreen::start(&domain, (80, 24), &[]);
    let parts = ["head [V], lag 240 s", "A1    ", "G1    ", "latency us", "? help"];
    top.wait_for("both triads", |screen| parts.iter().all(|part| screen.contains(part)));
    top.press("q");
    assert!(top.end().success());
    drop(feed);
    service.terminate();
}

#[test]
fn another_time_constant_than_the_tables_is_shown() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let (header, lines) = whole_csv(&whole_recording(4000));
    domain.write("whole.csv", &(header + &lines.concat()));
    let feed = domain.spawn(&["feed", "--imu", "imu-g", "--rate", "100", "--lag", "100", "whole.csv"]);
    let mut top = TopScreen::start(&domain, (80, 24), &[]);
    for part in ["OTHER LAG: samples 100 s, table 240 s", "lag-unknown "] {
        top.wait_for_text(part);
    }
    top.press("q");
    assert!(top.end().success());
    drop(feed);
    service.terminate();
}

#[test]
fn a_small_terminal_without_colours_is_served_and_a_signal_restores_it() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let top = &mut TopScreen::start(&domain, (80, 24), &[("NO_COLOR", "1"), ("LC_ALL", "C")]);
    top.wait_for_text("no acquisition");
    let screen = top.wait_for_text("? help");
    assert!(screen.is_ascii(), "{screen}");
    top.resize((40, 10));
    top.wait_for("the small screen", |screen| screen.contains("q quit") && !screen.contains("minute"));
    top.resize((120, 40));
    top.wait_for("the large screen", |screen| screen.contains("latency us") && screen.contains("117fc01d0047a7a2"));
    assert!(!sets_colour(&top.written()), "a colour in spite of NO_COLOR");
    kill(top.child.id(), Signal::TERM);
    assert!(top.end().success());

    let mut top = TopScreen::start(&domain, (80, 24), &[]);
    top.wait_for_text("no acquisition");
    top.press("\x03");
    assert!(top.end().success(), "Ctrl-C must end it as a key, not as a signal");

    let top = TopScreen::start(&domain, (80, 24), &[]);
    top.wait_for_text("no acquisition");
    hang_up(top);
    service.terminate();
}

#[test]
fn it_waits_for_a_service_and_continues_when_one_returns() {
    let domain = TestDomain::new();
    let mut top = TopScreen::start(&domain, (80, 24), &[]);
    top.wait_for_text("waiting for the service since");
    top.wait_for_text("isotherm serve --domain");
    for round in 0..2 {
        let service = domain.serve_recording();
        let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "100", RUN]);
        let pid = format!("pid {}", service.pid());
        top.wait_for("the service", |screen| screen.contains(&pid) && received(screen).is_some_and(|count| count > 0));
        if round == 0 {
            service.kill();
            top.wait_for_text("below is its last status");
            top.wait_for_text("not served");
        } else {
            drop(feed);
            service.terminate();
        }
    }
    top.press("q");
    assert!(top.end().success());
}

#[test]
fn without_a_suitable_terminal_it_says_so() {
    let domain = TestDomain::new();
    let output = domain.run(&["top"]);
    assert_eq!(output.status.code(), Some(64));
    assert!(text(&output.stderr).contains("`isotherm status` prints the same once"), "{}", text(&output.stderr));
    let mut dumb = TopScreen::start(&domain, (80, 24), &[("TERM", "dumb")]);
    assert_eq!(dumb.end().code(), Some(64));
    dumb.wait_for_text("a terminal with a cursor that moves");
}
