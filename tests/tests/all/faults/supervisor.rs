//! A stand-in for systemd: it listens on `NOTIFY_SOCKET` and notes when what came.

use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// The watchdog's time, as in the unit file.
pub(super) const WATCHDOG: Duration = Duration::from_secs(3);

type Messages = Arc<(Mutex<Vec<(Instant, String)>>, Condvar)>;

/// The supervisor of one service.
pub(super) struct Supervisor {
    path: PathBuf,
    messages: Messages,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Supervisor {
    /// Listens on a socket of this name.
    pub(super) fn listen(path: &Path) -> Self {
        let _ = std::fs::remove_file(path);
        let socket = UnixDatagram::bind(path).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let (messages, ended) = (Messages::default(), Arc::<AtomicBool>::default());
        let (sink, end) = (Arc::clone(&messages), Arc::clone(&ended));
        let thread = thread::spawn(move || {
            let mut buffer = [0; 4096];
            while !end.load(Ordering::Relaxed) {
                if let Ok(length) = socket.recv(&mut buffer) {
                    let text = String::from_utf8_lossy(&buffer[..length]).into_owned();
                    sink.0.lock().unwrap().push((Instant::now(), text));
                    sink.1.notify_all();
                }
            }
        });
        Self { path: path.to_owned(), messages, ended, thread: Some(thread) }
    }

    /// What a service needs in its environment.
    pub(super) fn environment(&self) -> [(&'static str, String); 2] {
        [("NOTIFY_SOCKET", self.path.display().to_string()), ("WATCHDOG_USEC", WATCHDOG.as_micros().to_string())]
    }

    /// Waits for a message that begins with `text`, at most for `limit`. Returns when it came.
    pub(super) fn wait_for(&self, text: &str, limit: Duration) -> Option<Instant> {
        let find = |messages: &[(Instant, String)]| {
            messages.iter().find(|(_, message)| message.starts_with(text)).map(|(time, _)| *time)
        };
        let missing = |messages: &mut Vec<(Instant, String)>| find(messages).is_none();
        let (messages, _) =
            self.messages.1.wait_timeout_while(self.messages.0.lock().unwrap(), limit, missing).unwrap();
        find(&messages)
    }

    /// Waits until the watchdog has been fed so often after `begin`, at most for `limit`. Returns whether it was.
    pub(super) fn is_fed(&self, begin: Instant, times: usize, limit: Duration) -> bool {
        let fed = |messages: &[(Instant, String)]| {
            messages.iter().filter(|(time, message)| *time > begin && message.contains("WATCHDOG=1")).count() >= times
        };
        let missing = |messages: &mut Vec<(Instant, String)>| !fed(messages);
        let (messages, _) =
            self.messages.1.wait_timeout_while(self.messages.0.lock().unwrap(), limit, missing).unwrap();
        fed(&messages)
    }

    /// The longest time from `begin` to `end` without a message that feeds the watchdog.
    pub(super) fn largest_gap(&self, begin: Instant, end: Instant) -> Duration {
        let messages = self.messages.0.lock().unwrap();
        let feeds = messages.iter().filter(|(_, message)| message.contains("WATCHDOG=1")).map(|(time, _)| *time);
        let times: Vec<_> =
            [begin].into_iter().chain(feeds.filter(|time| (begin..end).contains(time))).chain([end]).collect();
        times.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or_default()
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}
