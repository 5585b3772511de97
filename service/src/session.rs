//! Which session of an IMU was served last: noted in the domain's folder, so that the next service flags a session that
//! is new, and none that goes on. The note counts until the machine starts again; `isotherm clean` removes it.
//!
//! The control thread writes it within one tick of the first increment of a session, and once more at the end, then
//! with the last sample. So after a kill the periods between two sessions are unknown. A service that is killed within
//! that tick leaves the note before: its successor flags the session a second time, or, if it was the first since boot
//! and its acquisition was replaced too, does not flag the next one.

use isotherm_client::{Domain, ImuId, Note, boot};
use isotherm_shared::protocol::LastSession;
use isotherm_shared::sequence::{Period, Seen};
use isotherm_support::failure::shown;
use tracing::warn;

/// The note of one IMU.
pub(crate) struct SessionNote {
    imu: ImuId,
    note: Note,
    boot: u64,
    /// What the service before had noted in this boot.
    before: Option<LastSession>,
    /// What is in it.
    noted: Option<LastSession>,
    has_failed: bool,
}

impl SessionNote {
    /// Reads what is noted of an IMU, and takes the last sample out: from now on it may be another one.
    pub(crate) fn take(domain: &Domain, imu: &ImuId) -> Self {
        let (note, boot) = (Note::new(domain, &format!("session-{imu}")), boot());
        let before = note.read().and_then(|text| parse(core::str::from_utf8(&text).ok()?, boot));
        let mut taken = Self { imu: imu.clone(), note, boot, before, noted: before, has_failed: false };
        taken.keep(before.map(|before| LastSession { last: None, ..before }));
        taken
    }

    /// What the service before had noted; `None` if no session was since boot.
    pub(crate) const fn before(&self) -> Option<LastSession> {
        self.before
    }

    /// As [`keep`](Self::keep), at the end: without a sample since the start, what the service before had noted stays.
    pub(crate) fn end(&mut self, last: Option<LastSession>) {
        self.keep(last.or(self.before));
    }

    /// Notes this, if it is anything new. What cannot be written is tried again at the next call.
    pub(crate) fn keep(&mut self, last: Option<LastSession>) {
        if last.is_none() || last == self.noted {
            return;
        }
        match self.note.write(print(last, self.boot).as_bytes()) {
            Ok(()) => (self.noted, self.has_failed) = (last, false),
            Err(error) if !self.has_failed => {
                self.has_failed = true;
                warn!(
                    imu = %self.imu,
                    "noting the session in {}: {error}; a service that takes over may flag it as new, or not flag the next one",
                    shown(&self.note.path())
                );
            }
            Err(_) => {}
        }
    }
}

/// Boot and session, then of the last sample, if it is known: sequence, timestamp, interval, and when it was seen.
fn print(last: Option<LastSession>, boot: u64) -> String {
    let Some(LastSession { session, last }) = last else { return String::new() };
    let sample = last.map(|Seen { period: Period { sequence, timestamp_ns, interval_ns, .. }, at_ns }| {
        format!(" {sequence} {timestamp_ns} {interval_ns} {at_ns}")
    });
    format!("{boot} {session}{}\n", sample.unwrap_or_default())
}

fn parse(text: &str, boot: u64) -> Option<LastSession> {
    let numbers: Vec<u64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
    match numbers[..] {
        [of, session] if of == boot => Some(LastSession { session, last: None }),
        [of, session, sequence, timestamp_ns, interval_ns, at_ns] if of == boot => {
            let period = Period { session, sequence, timestamp_ns, interval_ns };
            Some(LastSession { session, last: Some(Seen { period, at_ns }) })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_is_read_as_it_was_written_and_only_since_the_same_boot() {
        let period = Period { session: u64::MAX, sequence: 3, timestamp_ns: u64::MAX, interval_ns: 5 };
        let last = Some(Seen { period, at_ns: 6 });
        for last in [LastSession { session: 0, last: None }, LastSession { session: u64::MAX, last }] {
            let text = print(Some(last), 77);
            assert_eq!([parse(&text, 77), parse(&text, 78)], [Some(last), None], "{text}");
        }
        for text in ["", "77", "77 1 2", "77 1 2 3 4 5 6", "77 x", "77 -1", "77 18446744073709551616"] {
            assert_eq!(parse(text, 77), None, "{text}");
        }
    }
}
