//! Frames in a stream of bytes: found by their first bytes, held right by their checksum.
//!
//! A frame whose checksum is right is taken as a whole: its bytes are not searched. After one that is wrong the search
//! goes on one byte behind its beginning, so one wrong byte costs one frame. What the frames are depends only on the
//! bytes, not on how they arrive in pieces. The work for each byte is bounded by the length of the longest frame, and
//! so is the memory.

use crate::checksum::Checksum;
use crate::number::{ByteOrder, Field, NumberType, Place, Value};
use crate::tally::{Cause, SkippedBytes};
use memchr::memmem::Finder;
use std::collections::VecDeque;

/// Longest frame \[bytes\].
pub const MAX_FRAME: usize = 1024;

/// The length of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Length {
    /// Always the same \[bytes\], up to [`MAX_FRAME`].
    Fixed(usize),
    /// What a number in the frame says, and so many bytes more.
    Stated {
        /// Where it stands.
        at: usize,
        /// Its type.
        number: NumberType,
        /// Order of its bytes.
        order: ByteOrder,
        /// Bytes that it does not count.
        add: usize,
    },
}

/// An item of a frame: a part with an identifier and a length.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Item {
    /// Its identifier.
    pub(crate) id: u64,
    /// Length of its data \[bytes\].
    pub(crate) length: usize,
    /// The index of its first field among those of [`Frame::fields`], and how many there are.
    pub(crate) fields: std::ops::Range<usize>,
}

/// How items follow each other in a frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Items {
    /// Where the first begins.
    pub(crate) at: usize,
    /// After the last.
    pub(crate) end: Place,
    /// Type of an identifier.
    pub(crate) id: NumberType,
    /// Type of a length, which follows the identifier.
    pub(crate) length: NumberType,
    /// Order of the bytes of both.
    pub(crate) order: ByteOrder,
    /// The items that are used. Others are stepped over.
    pub(crate) known: Vec<Item>,
}

/// What a frame looks like.
#[derive(Clone)]
pub(crate) struct Frame {
    /// Its first bytes, one at least.
    pub(crate) sync: Vec<u8>,
    /// Its length.
    pub(crate) length: Length,
    /// Its checksum. Without one a frame counts if another begins behind it.
    pub(crate) checksum: Option<Checksum>,
    /// Its fields, which are the columns of the source.
    pub(crate) fields: Vec<Field>,
    /// Its items, to which the fields belong; `None` if they have fixed places.
    pub(crate) items: Option<Items>,
}

/// Finds frames, and reads their fields.
pub(crate) struct Decoder {
    frame: Frame,
    sync: Finder<'static>,
    buffer: Vec<u8>,
    /// Bytes of the buffer that are done with.
    done: usize,
    /// Bytes of the stream before the buffer.
    before: u64,
    /// Where each piece of the stream ended, and when it arrived.
    arrivals: VecDeque<(u64, FrameArrival)>,
    /// Up to here bytes are skipped for this cause: the end of a frame that was not right.
    damaged: Option<(u64, Cause)>,
    /// Whether the last bytes that were done with are a frame.
    adjoins: bool,
    row: Vec<Value>,
    skipped: SkippedBytes,
    /// Bytes skipped since the last frame.
    skipped_here: u64,
}

/// When bytes arrived: not before the first time, at which the line was known to be empty, and not after the second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameArrival {
    /// The line was empty \[ns, monotonic clock\].
    pub after_ns: u64,
    /// The bytes were there \[ns, monotonic clock\].
    pub by_ns: u64,
}

/// A frame that was found.
#[derive(Debug)]
pub struct DecodedFrame<'a> {
    /// The values of the fields.
    pub row: &'a [Value],
    /// When its last byte arrived.
    pub arrival: FrameArrival,
    /// Its length \[bytes\].
    pub bytes: usize,
    /// How many frames were lost on the line before this one, as far as damaged bytes show it.
    pub damaged: u64,
}

/// What the bytes at the beginning of the buffer are.
enum FrameStart {
    Frame(usize),
    /// Not a frame. The bytes up to here are skipped for this cause.
    Wrong(usize, Cause),
    /// More bytes are needed.
    Open,
}

impl Decoder {
    /// A decoder at the beginning of a stream.
    #[must_use]
    pub(crate) fn new(frame: Frame) -> Self {
        let sync = Finder::new(&frame.sync).into_owned();
        let row = vec![Value::ABSENT; frame.fields.len()];
        Self {
            sync,
            row,
            buffer: Vec::with_capacity(2 * MAX_FRAME + PIECE),
            done: 0,
            before: 0,
            arrivals: VecDeque::with_capacity(2 * MAX_FRAME + PIECE),
            damaged: None,
            adjoins: false,
            skipped: SkippedBytes::default(),
            skipped_here: 0,
            frame,
        }
    }

    /// Takes the next bytes of the stream, and gives each frame that is complete to `sink`.
    pub(crate) fn push(&mut self, bytes: &[u8], arrival: FrameArrival, sink: &mut impl FnMut(DecodedFrame<'_>)) {
        for piece in bytes.chunks(PIECE) {
            self.buffer.extend_from_slice(piece);
            let end = self.before + self.buffer.len() as u64;
            self.arrivals.push_back((end, arrival));
            self.search(sink);
            self.before += self.done as u64;
            self.buffer.drain(..self.done);
            self.done = 0;
            while self.arrivals.front().is_some_and(|(end, _)| *end <= self.before) {
                self.arrivals.pop_front();
            }
        }
    }

    /// Ends the stream: what is left is no frame. Another stream may begin, as after a line was plugged in again.
    pub(crate) fn end(&mut self) {
        let left = self.buffer.len();
        self.skip(left, Cause::Cut);
        self.before += left as u64;
        self.buffer.clear();
        (self.done, self.damaged, self.adjoins) = (0, None, false);
        self.arrivals.clear();
    }

    /// Bytes that were no frame, by cause.
    #[must_use]
    pub(crate) const fn skipped(&self) -> &SkippedBytes {
        &self.skipped
    }

    fn search(&mut self, sink: &mut impl FnMut(DecodedFrame<'_>)) {
        loop {
            let rest = &self.buffer[self.done..];
            let Some(begin) = self.sync.find(rest) else {
                // The beginning of a sync may be at the end.
                let keep = self.frame.sync.len() - 1;
                return self.skip(rest.len().saturating_sub(keep), Cause::Noise);
            };
            self.skip(begin, Cause::Noise);
            match self.beginning() {
                FrameStart::Frame(length) => self.take(length, sink),
                FrameStart::Wrong(length, cause) => {
                    let end = self.before + (self.done + length) as u64;
                    if self.damaged.is_none() {
                        self.damaged = Some((end, cause));
                        self.skipped.damaged += 1;
                    }
                    self.skip(1, cause);
                }
                FrameStart::Open => return,
            }
        }
    }

    /// Looks at the bytes that begin with a sync.
    fn beginning(&self) -> FrameStart {
        let rest = &self.buffer[self.done..];
        let length = match self.frame.length {
            Length::Fixed(length) => length,
            Length::Stated { at, number, order, add } => {
                let Some(bytes) = rest.get(at..at + number.bytes()) else { return FrameStart::Open };
                let stated = number.read(bytes, order).whole.and_then(|whole| usize::try_from(whole).ok());
                let length = stated.and_then(|stated| stated.checked_add(add));
                match length {
                    Some(length) if (self.least()..=MAX_FRAME).contains(&length) => length,
                    _ => return FrameStart::Wrong(at + number.bytes(), Cause::Length),
                }
            }
        };
        let Some(frame) = rest.get(..length) else { return FrameStart::Open };
        match &self.frame.checksum {
            Some(checksum) if checksum.is_right(frame) == Some(true) => FrameStart::Frame(length),
            Some(_) => FrameStart::Wrong(length, Cause::Checksum),
            None if self.adjoins => FrameStart::Frame(length),
            None => match rest.get(length..length + self.frame.sync.len()) {
                Some(next) if next == self.frame.sync => FrameStart::Frame(length),
                Some(_) => FrameStart::Wrong(length, Cause::Unconfirmed),
                None => FrameStart::Open,
            },
        }
    }

    /// The shortest frame whose length is stated.
    fn least(&self) -> usize {
        let stated = match self.frame.length {
            Length::Stated { at, number, .. } => at + number.bytes(),
            Length::Fixed(length) => length,
        };
        stated.max(self.frame.sync.len())
    }

    fn take(&mut self, length: usize, sink: &mut impl FnMut(DecodedFrame<'_>)) {
        let frame = &self.buffer[self.done..self.done + length];
        let is_read = match &self.frame.items {
            None => {
                for (value, field) in self.row.iter_mut().zip(&self.frame.fields) {
                    *value = field.value(frame);
                }
                true
            }
            Some(items) => items.read(frame, &self.frame.fields, &mut self.row),
        };
        self.damaged = None;
        if !is_read {
            // The checksum is right, so nothing else begins inside.
            self.skipped.unread += 1;
            return self.skip(length, Cause::Items);
        }
        self.done += length;
        let end = self.before + self.done as u64;
        let arrival =
            self.arrivals.iter().find(|(piece, _)| *piece >= end).map_or_else(FrameArrival::default, |(_, at)| *at);
        let skipped = std::mem::take(&mut self.skipped_here);
        self.adjoins = true;
        // A part of a frame is a lost frame.
        sink(DecodedFrame { row: &self.row, arrival, bytes: length, damaged: skipped.div_ceil(length as u64) });
    }

    /// Skips bytes for this cause, or for that of the damaged frame to which they belong.
    fn skip(&mut self, count: usize, cause: Cause) {
        if count == 0 {
            return;
        }
        let count = count as u64;
        let begin = self.before + self.done as u64;
        let damaged = self.damaged.map_or((0, cause), |(end, cause)| (end.saturating_sub(begin).min(count), cause));
        self.skipped.add(damaged.1, damaged.0);
        self.skipped.add(cause, count - damaged.0);
        self.damaged = self.damaged.filter(|(end, _)| *end > begin + count);
        self.skipped_here += count;
        self.adjoins = false;
        self.done += count as usize;
    }
}

/// Bytes that are searched at once.
const PIECE: usize = 4096;

impl Items {
    /// Reads the fields of the items of a frame. Returns whether the items fill their place, and each known one has its
    /// length.
    fn read(&self, frame: &[u8], fields: &[Field], row: &mut [Value]) -> bool {
        row.fill(Value::ABSENT);
        let Some(mut rest) = self.end.within(frame.len()).and_then(|end| frame.get(self.at..end)) else { return false };
        while !rest.is_empty() {
            let (id, length) = (self.id.bytes(), self.length.bytes());
            let Some((head, data)) = rest.split_at_checked(id + length) else { return false };
            let whole = |number: NumberType, bytes: &[u8]| number.read(bytes, self.order).whole.unwrap_or(u64::MAX);
            let (id, length) = (whole(self.id, head), whole(self.length, &head[id..]));
            let parts = usize::try_from(length).ok().and_then(|length| data.split_at_checked(length));
            let Some((data, next)) = parts else { return false };
            if let Some(item) = self.known.iter().find(|item| item.id == id) {
                if item.length != data.len() {
                    return false;
                }
                for (value, field) in row[item.fields.clone()].iter_mut().zip(&fields[item.fields.clone()]) {
                    *value = field.value(data);
                }
            }
            rest = next;
        }
        true
    }
}
