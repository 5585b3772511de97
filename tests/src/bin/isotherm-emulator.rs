//! An emulated IMU behind a pseudo-terminal, for the tests of `isotherm acquire`. It prints the terminal's path, waits
//! until a program has opened it, and sends frames in absolute time. Without a reader frames are lost, as on a wire. A
//! new emulator with the same link stands for a device that comes back.
#![allow(clippy::print_stderr, clippy::print_stdout, reason = "a program for tests")]

use isotherm_tests::emulator::plan::{Plan, USAGE};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::{Errno, ioctl_fionbio, ioctl_fionread};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use rustix::time::{ClockId, clock_gettime};
use std::ffi::OsString;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;
use std::{env, fs};

/// The longest sleep before a signal is looked for.
const LOOK: Duration = Duration::from_millis(20);
/// How long a reader may take to set the line up after it has opened it.
const SET_UP: Duration = Duration::from_secs(1);
/// The rate of a line that no reader has set up \[Bd\].
const UNUSUAL: u32 = 50;
/// How long a full terminal is waited for before bytes are lost, and how long for the last bytes to be read.
const FULL: Duration = Duration::from_secs(10);

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let plan = match Plan::parse(&arguments) {
        Ok(plan) => plan,
        Err(reason) => {
            eprintln!("{reason}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    match run(&plan) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("emulator: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(plan: &Plan) -> io::Result<()> {
    let ended = Arc::<AtomicBool>::default();
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&ended))?;
    }
    let line = Line::new(plan.link.clone())?;
    println!("{}", line.link.as_deref().unwrap_or(&line.path).display());
    io::stdout().flush()?;
    if !line.wait_for_reader(plan.wait_s, &ended) {
        return if ended.load(Ordering::Relaxed) {
            Ok(())
        } else {
            Err(io::Error::other("nobody opened the terminal"))
        };
    }
    let log = send(plan, &line, &ended);
    line.drain(&ended);
    match &plan.log {
        Some(path) => fs::write(path, log),
        None => Ok(()),
    }
}

/// Sends all frames, or as many as there were before the signal. Returns the log.
fn send(plan: &Plan, line: &Line, ended: &AtomicBool) -> String {
    let mut log = String::new();
    let mut lost = 0;
    let start = now_ns();
    for number in plan.numbers() {
        let bytes = plan.bytes(number);
        sleep_until(start + plan.written_ns(number), ended);
        if ended.load(Ordering::Relaxed) {
            break;
        }
        let written = now_ns();
        lost += bytes.len() - line.write(&bytes, ended);
        if plan.log.is_some() && !plan.drop.contains(&number) {
            let _ = writeln!(log, "{number} {written} {}", start + plan.due_ns(number));
        }
    }
    if lost > 0 {
        eprintln!("emulator: {lost} bytes were not taken");
    }
    log
}

fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

fn sleep_until(moment_ns: u64, ended: &AtomicBool) {
    loop {
        let left = Duration::from_nanos(moment_ns.saturating_sub(now_ns()));
        if left.is_zero() || ended.load(Ordering::Relaxed) {
            return;
        }
        thread::sleep(left.min(LOOK));
    }
}

/// The device's end of a pseudo-terminal.
struct Line {
    controller: OwnedFd,
    path: PathBuf,
    link: Option<PathBuf>,
}

impl Line {
    fn new(link: Option<PathBuf>) -> io::Result<Self> {
        let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&controller)?;
        unlockpt(&controller)?;
        ioctl_fionbio(&controller, true)?;
        let path = PathBuf::from(OsString::from_vec(ptsname(&controller, Vec::new())?.into_bytes()));
        // Closed at once: from then on the controller tells whether a reader has the other end open.
        let user_side = open_user_side(&path)?;
        let mut settings = tcgetattr(&user_side)?;
        settings.make_raw();
        settings.set_speed(UNUSUAL)?;
        tcsetattr(&user_side, OptionalActions::Now, &settings)?;
        if let Some(link) = &link {
            let _ = fs::remove_file(link);
            symlink(&path, link)?;
        }
        Ok(Self { controller, path, link })
    }

    fn has_reader(&self) -> bool {
        !self.poll(PollFlags::empty(), Duration::ZERO).contains(PollFlags::HUP)
    }

    fn poll(&self, events: PollFlags, patience: Duration) -> PollFlags {
        let mut polled = [PollFd::new(&self.controller, events)];
        let patience = Timespec { tv_sec: patience.as_secs() as i64, tv_nsec: patience.subsec_nanos().into() };
        match poll(&mut polled, Some(&patience)) {
            Ok(_) => polled[0].revents(),
            Err(_) => PollFlags::empty(),
        }
    }

    /// Whether a reader came in time.
    fn wait_for_reader(&self, seconds: f64, ended: &AtomicBool) -> bool {
        let deadline = now_ns() + (seconds * 1e9) as u64;
        while !self.has_reader() {
            if now_ns() >= deadline || ended.load(Ordering::Relaxed) {
                return false;
            }
            thread::sleep(Duration::from_millis(1));
        }
        // What comes while a line is set up is discarded. A reader that sets no rate has nothing to set up.
        let set_up = now_ns() + SET_UP.as_nanos() as u64;
        while now_ns() < set_up && !self.is_set_up() {
            thread::sleep(Duration::from_millis(1));
        }
        true
    }

    /// Whether the reader has given the line its rate.
    fn is_set_up(&self) -> bool {
        tcgetattr(&self.controller).is_ok_and(|settings| settings.output_speed() != UNUSUAL)
    }

    /// Writes, and returns how many bytes were taken: none without a reader.
    fn write(&self, bytes: &[u8], ended: &AtomicBool) -> usize {
        let (mut taken, deadline) = (0, now_ns() + FULL.as_nanos() as u64);
        while taken < bytes.len() && self.has_reader() && !ended.load(Ordering::Relaxed) {
            match rustix::io::write(&self.controller, &bytes[taken..]) {
                Ok(count) => taken += count,
                Err(Errno::AGAIN) if now_ns() < deadline => {
                    self.poll(PollFlags::OUT, LOOK);
                }
                Err(Errno::INTR) => {}
                Err(_) => break,
            }
        }
        taken
    }

    /// Waits until the reader has taken what was written: what it has not is lost when the controller closes.
    fn drain(&self, ended: &AtomicBool) {
        let deadline = now_ns() + FULL.as_nanos() as u64;
        let Ok(user_side) = open_user_side(&self.path) else {
            // A reader may have it alone.
            sleep_until(now_ns() + 100_000_000, ended);
            return;
        };
        let mut empty = 0;
        // Between the terminal's ends is another buffer, which nothing tells of.
        while empty < 100 && now_ns() < deadline && !ended.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(5));
            empty = if ioctl_fionread(&user_side).unwrap_or(0) == 0 { empty + 1 } else { 0 };
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            && fs::read_link(link).is_ok_and(|target| target == self.path)
        {
            let _ = fs::remove_file(link);
        }
    }
}

fn open_user_side(path: &Path) -> io::Result<OwnedFd> {
    Ok(open(path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?)
}
