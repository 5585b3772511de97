//! The thread that writes a note into the domain's folder, which may be on a disk that lets a writer wait.

use isotherm_client::Note;
use isotherm_support::failure::tell;
use serde::Serialize;
use std::io::{self, ErrorKind};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

/// How long the end waits for the disk.
const END_LIMIT: Duration = Duration::from_secs(1);

/// Writes the contents of one note, each over the one before. Nobody waits for it.
pub(crate) struct NoteWriter {
    contents: SyncSender<Vec<u8>>,
    ended: Receiver<()>,
}

impl NoteWriter {
    /// Starts the thread. If it cannot start, nothing is written, and a warning says what is lost: `loss`.
    pub(crate) fn start(note: Note, loss: &'static str) -> Self {
        let (contents, received) = sync_channel::<Vec<u8>>(1);
        let (end, ended) = sync_channel(1);
        let body = move || {
            let mut is_told = false;
            for content in received {
                match note.write(&content) {
                    Ok(()) => {}
                    // The service has not made the folder yet.
                    Err(error) if error.kind() == ErrorKind::NotFound => {}
                    Err(error) if !is_told => {
                        is_told = true;
                        warn(loss, &error);
                    }
                    Err(_) => {}
                }
            }
            let _ = end.send(());
        };
        if let Err(error) = thread::Builder::new().name("note".to_owned()).spawn(body) {
            warn(loss, &error);
        }
        Self { contents, ended }
    }

    /// Hands a content over, to be written as JSON. Returns false if the disk has not taken the one before yet.
    pub(crate) fn write(&self, content: &impl Serialize) -> bool {
        let Ok(content) = serde_json::to_vec(content) else { return true };
        !matches!(self.contents.try_send(content), Err(TrySendError::Full(_)))
    }

    /// Waits until all is written, for a second at most.
    pub(crate) fn end(self) {
        drop(self.contents);
        // The thread ends, or the disk hangs.
        let _ = self.ended.recv_timeout(END_LIMIT);
    }
}

fn warn(loss: &str, error: &io::Error) {
    tell("isotherm", format!("warning: the domain's folder takes no note, and {loss}: {error}"));
}
