//! The shared memory of a domain is removed under its running processes, as systemd-logind does at a logout. All of
//! them come back by themselves, and what is lost is counted.

use isotherm_client::{Acquisition, IncrementReader, RawSample, SendError};
use isotherm_shared::compensate::answer;
use isotherm_tests::{RUN, TABLE, TIMEOUT, TestDomain, id, recording, same, table, text, wait_until};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::collections::BTreeSet;
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(2);

/// Removes all that the domain has in shared memory. Returns how many objects there were.
pub(crate) fn remove_memory(domain: &TestDomain) -> usize {
    let prefix = domain.client_domain().prefix();
    let entries = fs::read_dir("/dev/shm").unwrap().flatten();
    let own = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
    own.filter(|entry| fs::remove_file(entry.path()).is_ok()).count()
}

/// Sends one sample in each period, and takes the answers.
struct Sender {
    acquisition: Acquisition,
    /// Content of the samples, by their sequence.
    samples: Vec<RawSample>,
    /// A sample for which there is no room yet.
    waiting: Option<isotherm_client::Loan>,
    sent: u64,
    answered: u64,
    next: Instant,
}

impl Sender {
    fn new(acquisition: Acquisition) -> Self {
        Self { acquisition, samples: recording(), waiting: None, sent: 0, answered: 0, next: Instant::now() }
    }

    /// Sends for a period, and checks every answer that has come. A sample without room waits, and the samples after it
    /// with it.
    fn go(&mut self) {
        self.next = (self.next + PERIOD).max(Instant::now());
        let loan = self.waiting.take().unwrap_or_else(|| {
            let mut loan = self.acquisition.loan().unwrap();
            let sample = self.samples[loan.sequence as usize % self.samples.len()];
            *loan = RawSample { session: loan.session, sequence: loan.sequence, ..sample };
            loan
        });
        match self.acquisition.send(loan) {
            Ok(()) => self.sent += 1,
            Err(SendError::Full(loan)) => self.waiting = Some(loan),
            Err(error) => panic!("{error}"),
        }
        while Instant::now() < self.next {
            self.take();
            thread::sleep(Duration::from_micros(100));
        }
    }

    fn take(&mut self) {
        while let Some(increment) = self.acquisition.receive().unwrap() {
            assert_eq!(increment.sequence, self.answered, "each answer comes once and in order");
            let sample = &self.samples[increment.sequence as usize % self.samples.len()];
            let sample = RawSample { session: increment.session, sequence: increment.sequence, ..*sample };
            assert!(same(&increment, &answer(Some(&table(TABLE)), &sample)), "{increment:?}");
            self.answered += 1;
        }
    }

    fn until(&mut self, what: &str, mut done: impl FnMut(&Self) -> bool) {
        let begun = Instant::now();
        while !done(self) {
            assert!(begun.elapsed() < TIMEOUT, "{what} did not happen; {} unanswered", self.acquisition.in_flight());
            self.go();
        }
    }
}

/// A reader in a thread of its own. It notes the newest sequence that it has read.
struct Reading {
    newest: Arc<AtomicU64>,
    end: Arc<AtomicBool>,
    thread: thread::JoinHandle<BTreeSet<u64>>,
}

impl Reading {
    fn start(
        domain: &TestDomain,
        mut receive: impl FnMut(&mut IncrementReader, &mut BTreeSet<u64>) + Send + 'static,
    ) -> Self {
        let (newest, end) = (Arc::<AtomicU64>::default(), Arc::<AtomicBool>::default());
        let (options, note, ended) = (domain.options(), Arc::clone(&newest), Arc::clone(&end));
        let thread = thread::spawn(move || {
            let mut reader = IncrementReader::connect(id("imu-a"), &options).unwrap();
            let mut read = BTreeSet::new();
            while !ended.load(Ordering::Relaxed) {
                receive(&mut reader, &mut read);
                note.store(read.last().map_or(0, |last| last + 1), Ordering::Relaxed);
            }
            read
        });
        Self { newest, end, thread }
    }

    /// One that waits for increments.
    fn waiting(domain: &TestDomain) -> Self {
        Self::start(domain, |reader, read| {
            if let Some(increment) = reader.receive_timeout(Duration::from_millis(20)).unwrap() {
                assert!(read.insert(increment.sequence), "twice: {}", increment.sequence);
            }
        })
    }

    fn newest(&self) -> u64 {
        self.newest.load(Ordering::Relaxed)
    }

    fn finish(self) -> BTreeSet<u64> {
        self.end.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

#[test]
fn service_acquisition_readers_and_recorder_come_back_three_times() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let recorder = domain.spawn(&["record", "--imu", "imu-a", "-o", "flight.csv"]);
    recorder.wait_for_log("recording imu-a");
    let waiting = Reading::waiting(&domain);
    let polling = Reading::start(&domain, |reader, read| {
        let timeout = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
        if let Ok(descriptor) = reader.descriptor() {
            let _ = poll(&mut [PollFd::from_borrowed_fd(descriptor, PollFlags::IN)], Some(&timeout));
        }
        while let Some(increment) = reader.receive().unwrap() {
            assert!(read.insert(increment.sequence), "twice: {}", increment.sequence);
        }
    });
    let mut sender = Sender::new(domain.acquisition("imu-a"));
    sender.until("the first answers", |sender| sender.answered > 100 && waiting.newest() > 50 && polling.newest() > 50);
    let pid = service.pid();
    for round in 1..=3 {
        assert!(remove_memory(&domain) > 10);
        let removed = Instant::now();
        service_is_back(&service, round, &mut sender);
        let (sent, begun) = (sender.sent, sender.answered);
        sender.until("answers after the removal", |sender| sender.answered > sent.max(begun) + 100);
        let newest = sender.answered;
        sender.until("the readers", |_| waiting.newest() > newest && polling.newest() > newest);
        println!("round {round}: all are back after {:.2?}", removed.elapsed());
        assert_eq!(service.pid(), pid, "it executes itself again");
    }
    sender.until("the rest", |sender| sender.waiting.is_none());
    while sender.acquisition.in_flight() > 0 {
        sender.take();
        thread::sleep(Duration::from_millis(1));
    }
    let (sent, answered) = (sender.sent, sender.answered);
    assert_eq!(sent, answered, "nothing is lost");
    wait_until("the last increment", || waiting.newest() == sent && polling.newest() == sent);
    drop(sender);
    for (name, read) in [("waiting", waiting.finish()), ("polling", polling.finish())] {
        println!("{name} reader: {} of {sent} increments", read.len());
        assert!(read.len() as u64 <= sent && read.len() > 400);
    }
    recorder.terminate();
    let recorded =
        domain.run_ok(&["replay", "--table", "imu-a.toml", "flight.csv", "-o", "-"]).lines().count() as u64 - 1;
    assert!(recorded <= sent && recorded > 400, "{recorded} of {sent}");
    assert!(service.log().contains("was removed under the running service: by systemd-logind at a logout (RemoveIPC)"));
    service.terminate();
}

/// Sends on until the service is ready for another time.
fn service_is_back(service: &isotherm_tests::Process, round: usize, sender: &mut Sender) {
    sender.until("the service", |_| service.count_in_log(" ready ") > round);
}

#[test]
fn they_come_back_after_the_folder_was_removed_too() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let reading = Reading::waiting(&domain);
    let mut sender = Sender::new(domain.acquisition("imu-a"));
    sender.until("the first answers", |sender| sender.answered > 50 && reading.newest() > 10);
    fs::remove_dir_all(domain.client_domain().root_path()).unwrap();
    service_is_back(&service, 1, &mut sender);
    let sent = sender.sent;
    sender.until("answers after the removal", |sender| sender.answered > sent + 100 && reading.newest() > sent);
    drop(sender);
    reading.finish();
    service.terminate();
}

#[test]
fn they_come_back_after_the_files_of_the_streams_were_removed_too() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let reading = Reading::waiting(&domain);
    let mut sender = Sender::new(domain.acquisition("imu-a"));
    sender.until("the first answers", |sender| sender.answered > 50 && reading.newest() > 10);
    for round in 1..=2 {
        let files = fs::read_dir(format!("{}/services", domain.client_domain().root_path())).unwrap();
        files.for_each(|file| fs::remove_file(file.unwrap().path()).unwrap());
        service_is_back(&service, round, &mut sender);
        let sent = sender.sent;
        sender.until("answers after the removal", |sender| sender.answered > sent + 100 && reading.newest() > sent);
        let open = fs::read_dir(format!("/proc/{}/fd", service.pid())).unwrap().flatten();
        let locks =
            open.filter_map(|file| fs::read_link(file.path()).ok()).filter(|path| path.ends_with(lock(&domain)));
        assert_eq!(locks.count(), 1, "it keeps the one that it had");
    }
    drop(sender);
    reading.finish();
    service.terminate();
}

/// The name of the file that keeps a second service out.
fn lock(domain: &TestDomain) -> String {
    format!("{}service.lock", domain.client_domain().prefix())
}

#[test]
fn a_supervisor_starts_it_anew() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let mut command = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
    command.env("INVOCATION_ID", "0123456789abcdef0123456789abcdef");
    let service = domain.start(command);
    service.wait_for_log("ready");
    // Another service finds the lock, whatever is left of the memory.
    remove_memory(&domain);
    let (status, log) = service.wait();
    assert_eq!(status.code(), Some(74), "{log}");
    assert!(log.contains("ending, so that the supervisor restarts the service"), "{log}");
    domain.serve(&["--imu", "imu-a=imu-a.toml"]).terminate();
}

/// A shell below the service manager of a user hands its variables on to what it runs.
#[test]
fn a_supervisor_of_another_process_does_not_count() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let mut command = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
    command.env("INVOCATION_ID", "0123456789abcdef0123456789abcdef").env("SYSTEMD_EXEC_PID", "1");
    let service = domain.start(command);
    service.wait_for_log("ready");
    remove_memory(&domain);
    wait_until("a new beginning", || service.count_in_log(" ready ") == 2);
    service.terminate();
}

#[test]
fn a_second_service_is_kept_out_while_the_memory_is_away() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    service.stop();
    remove_memory(&domain);
    let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    let words = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.contains("another service is running in domain"), "{words}");
    assert!(words.contains(&format!("pid {}", service.pid())), "{words}");
    // Anyone who comes meanwhile gets the reason.
    for command in [&["status"][..], &["feed", "--imu", "imu-a", "--timeout", "1", RUN, "-o", "/dev/null"]] {
        let output = domain.run(command);
        let words = text(&output.stderr);
        assert!(
            !output.status.success() && words.contains("its shared memory was removed, by systemd-logind"),
            "{words}"
        );
    }
    service.resume();
    service.wait_for_log_lines(" ready ", 2);
    service.terminate();
}
