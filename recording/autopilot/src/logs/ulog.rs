//! The messages of a ULog file.
//!
//! Source: PX4's page "ULog File Format". A header of 16 bytes; then messages: length of the body (u16), type (a
//! letter), body. `B` says where data were appended after a crash, and the message before may be cut there. `F` defines
//! a message, `A` subscribes a number to one, `D` has the number and data, `O` says for how long the logger lost data.
//! Other types, known or not, are passed over.
//!
//! Nothing shows whether the body of a message is whole. So a message that damage follows counts as damage: it may
//! begin within its body.

use super::reports::Aspect;
use super::ulog_format::{FieldLengths, Formats, SensorLayout, StateLayout, WrongDefinition};
use super::window::{ByteWindow, Damage};
use isotherm_recording::RecordingError;
use isotherm_recording::steps;
use isotherm_shared::content::ULOG_MAGIC;
use std::collections::HashMap;
use std::io::{self, Read};
use std::rc::Rc;

/// Length of the header of the file.
const FILE_HEADER: usize = 16;
/// Length of the header of a message.
const HEADER: usize = 3;
/// Body of a synchronization message.
const SYNC: [u8; 8] = [0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
/// Messages that must follow each other where the reading begins again, and behind an unknown one.
const CHAIN: usize = 3;
/// The longest message of an unknown type \[bytes\].
const LONGEST_UNKNOWN: usize = 4096;
/// Types of messages that are known, but for data, whose number may be unknown.
const TYPES: &[u8] = b"BFIPMQALCROS";
/// The only incompatible flag that is known: data are appended.
const APPENDED: u8 = 1;

/// Whether data that begin with these bytes are ULog.
pub fn is_ulog(beginning: &[u8]) -> bool {
    beginning.starts_with(ULOG_MAGIC)
}

/// The topics that concern a conversion.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub(super) enum UlogTopic {
    SensorAccel,
    SensorGyro,
    /// Corrected by the autopilot.
    Corrected(&'static str),
    /// What the vehicle does.
    State(&'static State),
    Other,
}

/// A field that says what the vehicle does, by a value.
#[derive(Debug, Eq, Hash, PartialEq)]
pub(super) struct State {
    pub(super) topic: &'static str,
    field: &'static str,
    pub(super) aspect: Aspect,
    pub(super) value: u8,
}

/// ARMING_STATE_ARMED is 2, of all versions.
const STATES: [State; 3] = [
    State { topic: "vehicle_status", field: "arming_state", aspect: Aspect::Armed, value: 2 },
    State { topic: "actuator_armed", field: "armed", aspect: Aspect::Armed, value: 1 },
    State { topic: "vehicle_land_detected", field: "landed", aspect: Aspect::Flying, value: 0 },
];

const TOPICS: [(&str, UlogTopic); 5] = [
    ("sensor_accel", UlogTopic::SensorAccel),
    ("sensor_gyro", UlogTopic::SensorGyro),
    ("sensor_combined", UlogTopic::Corrected("sensor_combined")),
    ("vehicle_imu", UlogTopic::Corrected("vehicle_imu")),
    ("vehicle_imu_status", UlogTopic::Corrected("vehicle_imu_status")),
];

/// What a number of messages stands for.
pub(super) struct Subscription {
    pub(super) topic: UlogTopic,
    pub(super) instance: u8,
    lengths: Option<FieldLengths>,
    /// Of a sensor; `Err` says what is wrong with its definition.
    pub(super) layout: Result<SensorLayout, String>,
    /// Of a state.
    pub(super) state: Option<StateLayout>,
}

/// Data of a topic that concerns a conversion.
pub(super) struct UlogRecord<'a> {
    /// Place of the message.
    pub(super) place: u64,
    pub(super) of: Rc<Subscription>,
    pub(super) body: &'a [u8],
}

/// The messages of a file.
pub(super) struct UlogMessages {
    window: ByteWindow,
    /// Bytes of the last message, which are passed with the next call.
    held: usize,
    formats: Formats,
    subscriptions: HashMap<u16, Rc<Subscription>>,
    /// Where data were appended.
    appended: Vec<u64>,
    pub(super) damage: Damage,
    /// Messages of unknown types or numbers.
    pub(super) unknown: u64,
    /// Number of dropouts, what they lasted \[ms\], place of the first.
    pub(super) dropouts: (u64, u64, u64),
}

/// What stands at a place.
enum Standing {
    /// A message of this length.
    Message(usize),
    /// One of an unknown type or number.
    Unknown(usize),
    /// One that is cut.
    Cut,
    Damage,
}

impl UlogMessages {
    /// Begins to read.
    ///
    /// # Errors
    /// If the header is none.
    pub(super) fn new(source: Box<dyn Read>) -> Result<Self, RecordingError> {
        let mut window = ByteWindow::new(source);
        let header = window.ahead(FILE_HEADER)?;
        if header.len() < FILE_HEADER {
            return Err(error(header.len() as u64, "the header of the file is cut; copy it again".to_owned()));
        }
        window.pass(FILE_HEADER);
        Ok(Self {
            window,
            held: 0,
            formats: Formats::default(),
            subscriptions: HashMap::new(),
            appended: Vec::new(),
            damage: Damage::default(),
            unknown: 0,
            dropouts: (0, 0, 0),
        })
    }

    /// The next data of a topic that concerns a conversion.
    ///
    /// # Errors
    /// Of reading, and of definitions, with their place.
    pub(super) fn next(&mut self) -> Result<Option<UlogRecord<'_>>, RecordingError> {
        loop {
            let Some(length) = self.advance()? else { return Ok(None) };
            let place = self.window.place();
            let bytes = self.window.ahead(length)?;
            let (kind, body) = (bytes[2], &bytes[HEADER..]);
            match kind {
                b'D' => {
                    let number = u16::from_le_bytes([body[0], body[1]]);
                    let of = self.subscriptions.get(&number).filter(|of| of.topic != UlogTopic::Other).map(Rc::clone);
                    if let Some(of) = of {
                        return Ok(Some(UlogRecord { place, of, body: &self.window.ahead(length)?[HEADER + 2..] }));
                    }
                }
                b'F' => match self.formats.add(body) {
                    Ok(()) => {}
                    Err(WrongDefinition::None) => self.damage.leave_out(place, length as u64),
                    Err(WrongDefinition::TooMany(message)) => return Err(error(place, message)),
                },
                b'A' => {
                    let (instance, number) = (body[0], u16::from_le_bytes([body[1], body[2]]));
                    let name = String::from_utf8_lossy(&body[3..]).into_owned();
                    let subscription = Subscription::new(&mut self.formats, &name, instance);
                    self.subscriptions.insert(number, Rc::new(subscription));
                }
                // Flags are the first message.
                b'B' if place == FILE_HEADER as u64 => {
                    if body[8] & !APPENDED != 0 || body[9..16].iter().any(|flags| *flags != 0) {
                        let message = "flags of a newer ULog that this program does not know; convert with ulog2csv";
                        return Err(error(place, message.to_owned()));
                    }
                    let offsets = body[16..40].chunks_exact(8).filter_map(|bytes| bytes.first_chunk().copied());
                    self.appended = offsets.map(u64::from_le_bytes).filter(|offset| *offset > 0).collect();
                    self.appended.sort_unstable();
                }
                b'O' => {
                    let (count, ms, first) = self.dropouts;
                    let lost = u64::from(u16::from_le_bytes([body[0], body[1]]));
                    self.dropouts = (count + 1, ms + lost, if count == 0 { place } else { first });
                }
                _ => {}
            }
        }
    }

    /// Place of the message that comes next.
    pub(super) const fn place(&self) -> u64 {
        self.window.place()
    }

    /// Goes to the next message of a known type, and gives its length.
    fn advance(&mut self) -> io::Result<Option<usize>> {
        self.window.pass(core::mem::take(&mut self.held));
        while !self.window.is_at_end()? {
            steps::count(1);
            let place = self.window.place();
            let standing = self.standing()?;
            // A message before appended data may be cut.
            let boundary = self.appended.iter().find(|offset| **offset > place).map(|offset| offset - place);
            match (standing, boundary) {
                (Standing::Message(length) | Standing::Unknown(length), Some(boundary)) if length as u64 > boundary => {
                    self.pass_to(boundary)?;
                    self.damage.leave_out(place, boundary);
                }
                (Standing::Message(length), _) => {
                    self.held = length;
                    return Ok(Some(length));
                }
                (Standing::Unknown(length), _) => {
                    self.unknown += 1;
                    self.window.pass(length);
                }
                // A cut message ends the log, unless its length is wrong.
                (Standing::Cut | Standing::Damage, boundary) => {
                    if !self.find(boundary)? {
                        self.damage.cut(place);
                        return Ok(None);
                    }
                    self.damage.leave_out(place, self.window.place() - place);
                }
            }
        }
        Ok(None)
    }

    /// Goes to the next place where messages follow each other, `boundary` bytes at most; `false` if there is none.
    fn find(&mut self, boundary: Option<u64>) -> io::Result<bool> {
        let limit = boundary.map(|boundary| self.window.place() + boundary);
        loop {
            steps::count(1);
            self.window.pass(1);
            if self.window.is_at_end()? {
                return Ok(false);
            }
            if limit == Some(self.window.place()) || (self.message(0)?.is_some() && self.is_chain(0)?) {
                return Ok(true);
            }
        }
    }

    fn pass_to(&mut self, boundary: u64) -> io::Result<()> {
        let boundary = boundary as usize;
        self.window.ahead(boundary)?;
        self.window.pass(boundary);
        Ok(())
    }

    /// What stands at the next place.
    fn standing(&mut self) -> io::Result<Standing> {
        let standing = self.standing_at(0)?;
        let Standing::Message(length) = standing else { return Ok(standing) };
        Ok(match self.standing_at(length)? {
            Standing::Damage => Standing::Damage,
            _ => standing,
        })
    }

    /// What stands `after` bytes ahead; the end of the log is a cut message.
    fn standing_at(&mut self, after: usize) -> io::Result<Standing> {
        if let Some(length) = self.message(after)? {
            let is_whole = self.window.ahead(after + length)?.len() == after + length;
            return Ok(if is_whole { Standing::Message(length) } else { Standing::Cut });
        }
        let Some(length) = self.unknown(after)? else {
            let is_cut = self.window.ahead(after + HEADER)?.len() < after + HEADER;
            return Ok(if is_cut { Standing::Cut } else { Standing::Damage });
        };
        // What follows distinguishes an unknown message from damage.
        Ok(if self.is_chain(after + length)? { Standing::Unknown(length) } else { Standing::Damage })
    }

    /// The length of the message of an unknown type, a letter, or of an unknown number that may stand `after` bytes
    /// ahead. What looks like one within damage would hide messages: it is not long.
    fn unknown(&mut self, after: usize) -> io::Result<Option<usize>> {
        let Some([low, high, kind]) = self.window.ahead(after + HEADER)?.get(after..) else { return Ok(None) };
        let size = usize::from(u16::from_le_bytes([*low, *high]));
        let is_known = TYPES.contains(kind);
        Ok(((1..=LONGEST_UNKNOWN).contains(&size) && kind.is_ascii_alphabetic() && !is_known).then_some(HEADER + size))
    }

    /// Whether messages follow each other from `after` bytes ahead on: several of them, or up to the end. The numbers
    /// of data may be subscribed to by a message before.
    fn is_chain(&mut self, mut after: usize) -> io::Result<bool> {
        for _ in 0..CHAIN {
            if self.window.ahead(after + 1)?.len() <= after {
                break;
            }
            let is_data = self.window.ahead(after + HEADER)?.get(after..).is_some_and(|header| header.ends_with(b"D"));
            let unknown = if is_data { self.unknown(after)? } else { None };
            match self.message(after)?.or(unknown) {
                Some(length) => after += length,
                None => return Ok(false),
            }
        }
        Ok(self.window.ahead(after)?.len() == after)
    }

    /// The length of the message that stands `after` bytes ahead, if its header and its first bytes are those of one.
    fn message(&mut self, after: usize) -> io::Result<Option<usize>> {
        let bytes = self.window.ahead(after + HEADER + SYNC.len())?;
        let Some([low, high, kind, first @ ..]) = bytes.get(after..) else { return Ok(None) };
        let size = usize::from(u16::from_le_bytes([*low, *high]));
        let is_text = |text: core::ops::Range<usize>| {
            let (from, count) = (text.start, text.len());
            first.iter().skip(from).take(count).all(|byte| (b' '..=b'~').contains(byte))
        };
        let key = |at: usize| {
            let end = at + 1 + first.get(at).map_or(0, |length| usize::from(*length));
            end < size && is_text(at + 1..end)
        };
        let byte = |at: usize, known: core::ops::RangeInclusive<u8>| first.get(at).is_none_or(|of| known.contains(of));
        let is_message = match kind {
            b'B' => size >= 40 && self.window.place() + after as u64 == FILE_HEADER as u64,
            b'F' => size > 2 && is_text(0..size),
            b'I' | b'P' => size > 2 && key(0),
            b'M' => size > 3 && byte(0, 0..=1) && key(1),
            b'Q' => size > 3 && key(1),
            b'A' => size > 3 && is_text(3..size),
            b'L' => size >= 9 && byte(0, b'0'..=b'7'),
            b'C' => size >= 11 && byte(0, b'0'..=b'7'),
            b'R' | b'O' => size == 2,
            b'S' => size == SYNC.len() && first.starts_with(&SYNC[..first.len().min(SYNC.len())]),
            b'D' => {
                let of = first.first_chunk().and_then(|number| self.subscriptions.get(&u16::from_le_bytes(*number)));
                let lengths = of.map(|of| of.lengths);
                let fits = |lengths: FieldLengths| (lengths.least + 2..=lengths.most + 2).contains(&size);
                size >= 2 && lengths.is_some_and(|lengths| lengths.is_none_or(fits))
            }
            _ => false,
        };
        Ok(is_message.then_some(HEADER + size))
    }
}

impl Subscription {
    fn new(formats: &mut Formats, name: &str, instance: u8) -> Self {
        let state = STATES.iter().find(|state| state.topic == name);
        let topic = TOPICS.iter().find(|(known, _)| *known == name).map(|(_, topic)| *topic);
        let topic = topic.or(state.map(UlogTopic::State)).unwrap_or(UlogTopic::Other);
        let layout = match topic {
            UlogTopic::SensorAccel | UlogTopic::SensorGyro => formats.sensor(name),
            _ => Err(String::new()),
        };
        let state = state.and_then(|state| formats.state(name, state.field));
        Self { topic, instance, lengths: formats.lengths(name).ok(), layout, state }
    }
}

/// An error at a place.
pub(super) fn error(place: u64, message: String) -> RecordingError {
    RecordingError::Place { place: format!("byte {place}"), message }
}
