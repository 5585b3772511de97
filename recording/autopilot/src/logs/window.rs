//! Bytes of a log as they pass, with a look ahead, and what of them were no messages.

use isotherm_support::finding::{Finding, name};
use std::io::{self, Read};

/// Bytes that are read at once.
const CHUNK: u64 = 1 << 18;

/// A source, of which some bytes are in memory.
pub(super) struct ByteWindow {
    source: Box<dyn Read>,
    bytes: Vec<u8>,
    /// Index of the first byte that has not been passed.
    begin: usize,
    /// Its place in the source.
    place: u64,
    has_ended: bool,
}

impl ByteWindow {
    pub(super) fn new(source: Box<dyn Read>) -> Self {
        Self { source, bytes: Vec::new(), begin: 0, place: 0, has_ended: false }
    }

    /// The next bytes: as many as wanted, or all that are left.
    pub(super) fn ahead(&mut self, wanted: usize) -> io::Result<&[u8]> {
        while self.bytes.len() - self.begin < wanted && !self.has_ended {
            self.bytes.drain(..self.begin);
            self.begin = 0;
            self.has_ended = (&mut self.source).take(CHUNK).read_to_end(&mut self.bytes)? == 0;
        }
        let rest = &self.bytes[self.begin..];
        Ok(&rest[..wanted.min(rest.len())])
    }

    /// Passes bytes that have been looked at.
    pub(super) fn pass(&mut self, count: usize) {
        let count = count.min(self.bytes.len() - self.begin);
        self.begin += count;
        self.place += count as u64;
    }

    /// Place of the next byte.
    pub(super) const fn place(&self) -> u64 {
        self.place
    }

    /// Whether all bytes have been passed.
    pub(super) fn is_at_end(&mut self) -> io::Result<bool> {
        Ok(self.ahead(1)?.is_empty())
    }
}

/// Bytes, or lines, that are no messages.
#[derive(Debug, Default)]
pub(super) struct Damage {
    /// Place of the first.
    first: Option<u64>,
    count: u64,
    /// Where the last message is cut, or behind the last one.
    cut: Option<u64>,
}

impl Damage {
    /// `count` of them from `place` on are left out, and there are messages behind them.
    pub(super) fn leave_out(&mut self, place: u64, count: u64) {
        self.first.get_or_insert(place);
        self.count += count;
    }

    /// How many there are, and one more if the end is cut.
    pub(super) fn count(&self) -> u64 {
        self.count + u64::from(self.cut.is_some())
    }

    /// No whole message comes from this place on.
    pub(super) fn cut(&mut self, place: u64) {
        self.cut = Some(place);
    }

    /// As findings; `unit` is what places and counts are of, such as `byte`.
    pub(super) fn findings(&self, unit: &str) -> impl Iterator<Item = Finding> {
        let damaged = self.first.map(|first| {
            let count = self.count;
            let message = format!(
                "{count} {unit}s are not messages of the log, the first is {unit} {first}: it is damaged there, and \
                 rows may be missing; copy it again"
            );
            Finding::warning(name::MISSING_ROWS, message)
        });
        let cut = self.cut.map(|place| {
            let message = format!("no whole message comes from {unit} {place} on; the rows before it are used");
            Finding::warning(name::TRUNCATED, message)
        });
        damaged.into_iter().chain(cut)
    }
}
