//! Services that die within the first second.
//!
//! What dead processes leave in shared memory may be damaged, by a fault of the memory or by a program that wrote where
//! it should not. A service that finds it dies at its start, whenever it is started. So a start that finds no living
//! process of the domain removes everything first. Where processes live, they keep what they use, until two services in
//! a row have crashed within their first second: each start leaves a mark, to which a crash adds a letter, and which is
//! removed when the service has run for a second or ends in order.

use crate::crash::{self, CRASH};
use crate::{clean, leftovers};
use isotherm_client::{Domain, Note};
use std::time::{Duration, Instant};
use tracing::{debug, warn};

/// So long a service must have run.
const EARLY: Duration = Duration::from_secs(1);
/// So many services in a row must have crashed early before the domain is cleared under processes that use it. They
/// join again, but may miss increments. A service that was killed has not crashed.
const CRASHES_BESIDE_OTHERS: u32 = 2;
/// The mark of a start: how many services before have crashed early, and whether this one has.
#[derive(Debug)]
pub(crate) struct StartMark {
    note: Note,
    ready: Option<Instant>,
}

impl StartMark {
    /// Leaves the mark. Removes what is left of the domain if nobody uses it, or if services keep crashing.
    pub(crate) fn leave(domain: &Domain) -> Self {
        let note = Note::new(domain, "starting");
        let crashes = note.read().as_deref().map_or(0, crashes);
        // Before it is known who lives: what a process makes that joins meanwhile is not among them.
        let objects = clean::streams(domain);
        if crashes >= CRASHES_BESIDE_OTHERS || leftovers::living_nodes(domain).next().is_none() {
            match objects.remove() {
                Ok(removed) if crashes > 0 && removed > 0 => warn!(
                    "the last service has died within a second of its start: {removed} objects that were left of the domain are removed, since \
                     they may be damaged"
                ),
                Ok(removed) => debug!("{removed} objects of dead processes are removed"),
                Err(error) => warn!("removing what is left of the domain: {error}"),
            }
        }
        let mark = Self { note, ready: None };
        mark.write(&crashes.to_string());
        mark
    }

    fn write(&self, text: &str) {
        match self.note.write(text.as_bytes()) {
            Ok(()) => crash::mark_in(&self.note.path()),
            Err(error) => warn!("noting that the service starts: {error}"),
        }
    }

    /// The service is ready. Returns whether the mark was removed, which is when it has run for a second.
    pub(crate) fn remove_after_a_second(&mut self) -> bool {
        let ready = *self.ready.get_or_insert_with(Instant::now);
        let is_over = ready.elapsed() > EARLY;
        if is_over {
            self.note.remove();
        }
        is_over
    }

    /// The service ends in order.
    pub(crate) fn remove(&self) {
        self.note.remove();
    }
}

/// How many services in a row have crashed early, by a mark that was found.
fn crashes(mark: &[u8]) -> u32 {
    // A panic that becomes an abort marks twice.
    let numbers = mark.iter().position(|byte| *byte == CRASH);
    let Some(before) = numbers.map(|end| &mark[..end]) else { return 0 };
    let before: u32 = str::from_utf8(before).ok().and_then(|text| text.parse().ok()).unwrap_or(0);
    before.saturating_add(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_crashes_in_a_row_count() {
        for (mark, count) in [
            ("", 0),
            ("0", 0),
            ("3", 0),
            ("0x", 1),
            ("1x", 2),
            ("1xx", 2),
            ("x", 1),
            ("?x", 1),
            ("4294967295x", u32::MAX),
        ] {
            assert_eq!(crashes(mark.as_bytes()), count, "{mark:?}");
        }
    }
}
