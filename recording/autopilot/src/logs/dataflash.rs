//! The messages of a DataFlash log, binary, as text, or as lines of JSON.
//!
//! Binary: `A3 95`, number, body; the log defines each number before it uses it. Text: a line per message, with its
//! name and its fields, separated by commas, as ground stations write it.
//!
//! Nothing shows whether the body of a binary message is whole. So a message that damage follows counts as damage: it
//! may begin within its body.

use super::dataflash_format::{Body, FMT, FMT_LENGTH, HEADER, MessageFormat};
use super::dataflash_json::{JsonMessage, first_message};
use super::window::{ByteWindow, Damage};
use isotherm_recording::RecordingError;
use isotherm_recording::steps;
use isotherm_shared::content::{DATAFLASH_MAGIC, is_dataflash_text};
use std::collections::HashMap;
use std::io::{self, BufRead as _, BufReader, Read};
use std::rc::Rc;

/// Longest line of a text \[bytes\].
const MAX_LINE: u64 = 1 << 14;
/// Most definitions of a text.
const MAX_FORMATS: usize = 1000;

/// How a log is written.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum LogEncoding {
    /// Binary, as the autopilot writes it.
    Binary,
    /// As ground stations write it.
    Text,
    /// As mavlogdump writes it.
    Json,
}

impl LogEncoding {
    /// That of a log that begins with these bytes; `None` of other data. Before the first definition there may be what
    /// a console or a damaged card put there.
    pub fn of(beginning: &[u8]) -> Option<Self> {
        let definition = [DATAFLASH_MAGIC[0], DATAFLASH_MAGIC[1], FMT];
        let is_followed =
            |at: usize| beginning[at..].get(FMT_LENGTH..).is_some_and(|n| n.starts_with(&DATAFLASH_MAGIC));
        if beginning.starts_with(&DATAFLASH_MAGIC) || memchr::memmem::find_iter(beginning, &definition).any(is_followed)
        {
            return Some(Self::Binary);
        }
        let is_first = |line: &[u8]| {
            let mut fields = line.split(|byte| *byte == b',').map(<[u8]>::trim_ascii);
            fields.next() == Some(b"FMT") && fields.next() == Some(b"128")
        };
        let text = beginning.strip_prefix("\u{feff}".as_bytes()).unwrap_or(beginning);
        if is_dataflash_text(text) || text.split(|byte| *byte == b'\n').any(is_first) {
            return Some(Self::Text);
        }
        first_message(beginning).map(|_| Self::Json)
    }
}

/// A message that concerns a conversion.
pub(super) struct DataFlashMessage<'a> {
    /// Its byte or line.
    pub(super) place: u64,
    pub(super) format: Rc<MessageFormat>,
    pub(super) body: Body<'a>,
}

/// The messages of a log.
pub(super) enum DataFlashMessages {
    Binary(Binary),
    Text(Text),
}

/// Of a binary log.
pub(super) struct Binary {
    window: ByteWindow,
    /// Bytes of the last message, which are passed with the next call.
    held: usize,
    /// By number.
    formats: Vec<Option<Rc<MessageFormat>>>,
    damage: Damage,
}

/// Of a text.
pub(super) struct Text {
    source: BufReader<Box<dyn Read>>,
    line: u64,
    text: String,
    formats: HashMap<String, Rc<MessageFormat>>,
    is_json: bool,
    damage: Damage,
}

/// Whether a conversion needs messages of this name.
fn is_wanted(name: &str) -> bool {
    name.starts_with("IMU") || matches!(name, "PARM" | "FMTU" | "TCLR" | "EV" | "ARM" | "STAT")
}

impl DataFlashMessages {
    pub(super) fn new(source: Box<dyn Read>, encoding: LogEncoding) -> Self {
        let definitions = Rc::new(MessageFormat::of_definitions());
        if encoding != LogEncoding::Binary {
            let formats = HashMap::from([(definitions.name.clone(), definitions)]);
            let source = BufReader::with_capacity(1 << 16, source);
            let (text, is_json, damage) = (String::new(), encoding == LogEncoding::Json, Damage::default());
            return Self::Text(Text { source, line: 0, text, formats, is_json, damage });
        }
        let mut formats = vec![None; 1 << 8];
        formats[usize::from(FMT)] = Some(definitions);
        Self::Binary(Binary { window: ByteWindow::new(source), held: 0, formats, damage: Damage::default() })
    }

    /// The next message that concerns a conversion.
    pub(super) fn next(&mut self) -> io::Result<Option<DataFlashMessage<'_>>> {
        match self {
            Self::Binary(log) => log.next(),
            Self::Text(log) => log.next(),
        }
    }

    /// An error at a place, otherwise here.
    pub(super) fn error(&self, place: u64, message: String) -> RecordingError {
        match self {
            Self::Binary(log) => {
                let place = if place == 0 { log.window.place() } else { place };
                RecordingError::Place { place: format!("byte {place}"), message }
            }
            Self::Text(log) => RecordingError::Data { line: if place == 0 { log.line.max(1) } else { place }, message },
        }
    }

    /// The definition of this number, if it is of an IMU's rows.
    pub(super) fn imu_format(&self, number: u8) -> Option<Rc<MessageFormat>> {
        let format = match self {
            Self::Binary(log) => log.formats[usize::from(number)].as_ref(),
            Self::Text(log) => log.formats.values().find(|format| format.number == number),
        };
        format.filter(|format| format.imu.is_some()).cloned()
    }

    /// What was no message, and the unit of its places.
    pub(super) const fn damage(&self) -> (&Damage, &'static str) {
        match self {
            Self::Binary(log) => (&log.damage, "byte"),
            Self::Text(log) => (&log.damage, "line"),
        }
    }

    /// The name of a unit of places.
    pub(super) const fn unit(&self) -> &'static str {
        self.damage().1
    }
}

impl Binary {
    fn next(&mut self) -> io::Result<Option<DataFlashMessage<'_>>> {
        loop {
            self.window.pass(core::mem::take(&mut self.held));
            if self.window.is_at_end()? {
                return Ok(None);
            }
            let place = self.window.place();
            let Some(format) = self.whole()? else {
                if self.find()? {
                    self.damage.leave_out(place, self.window.place() - place);
                    continue;
                }
                self.damage.cut(place);
                return Ok(None);
            };
            self.held = format.length;
            if format.number == FMT {
                let bytes = self.window.ahead(format.length)?;
                let new = MessageFormat::read(&format, Body::Binary(&bytes[HEADER..]));
                if let Some(new) = new.filter(|new| new.number != FMT) {
                    let number = usize::from(new.number);
                    self.formats[number] = Some(Rc::new(new));
                }
            } else if is_wanted(&format.name) {
                let body = Body::Binary(&self.window.ahead(format.length)?[HEADER..]);
                return Ok(Some(DataFlashMessage { place, format, body }));
            }
        }
    }

    /// The definition of the message that stands at the next place, if it is whole and another message, of whatever
    /// number, or the end follows.
    fn whole(&mut self) -> io::Result<Option<Rc<MessageFormat>>> {
        let Some(format) = self.format(0)? else { return Ok(None) };
        let length = format.length;
        let Some(next) = self.window.ahead(length + DATAFLASH_MAGIC.len())?.get(length..) else { return Ok(None) };
        let follows = DATAFLASH_MAGIC.starts_with(next);
        Ok(follows.then_some(format))
    }

    /// The definition of the message that stands `after` bytes ahead.
    fn format(&mut self, after: usize) -> io::Result<Option<Rc<MessageFormat>>> {
        let header = self.window.ahead(after + HEADER)?.get(after..).unwrap_or_default();
        let number = header.strip_prefix(&DATAFLASH_MAGIC).and_then(<[u8]>::first);
        Ok(number.and_then(|number| self.formats[usize::from(*number)].clone()))
    }

    /// Goes to the next place where two messages follow each other, or one up to the end; `false` if there is none.
    fn find(&mut self) -> io::Result<bool> {
        loop {
            steps::count(1);
            self.window.pass(1);
            if self.window.is_at_end()? {
                return Ok(false);
            }
            let Some(first) = self.format(0)? else { continue };
            if self.format(first.length)?.is_some() || self.window.ahead(first.length + 1)?.len() == first.length {
                return Ok(true);
            }
        }
    }
}

impl Text {
    fn next(&mut self) -> io::Result<Option<DataFlashMessage<'_>>> {
        let format = loop {
            self.line += 1;
            steps::count(1);
            let mut bytes = Vec::new();
            if (&mut self.source).take(MAX_LINE).read_until(b'\n', &mut bytes)? == 0 {
                self.line -= 1;
                return Ok(None);
            }
            self.text = match self.is_json {
                // What is no message has no known name.
                true => self.json(&bytes).unwrap_or_else(|| "?".to_owned()),
                false => String::from_utf8_lossy(&bytes).trim_start_matches('\u{feff}').trim().to_owned(),
            };
            if self.text.is_empty() {
                continue;
            }
            match self.format() {
                Some(format) if format.number == FMT => self.define(&format),
                Some(format) if is_wanted(&format.name) => break format,
                Some(_) => {}
                // The last line has no end if it is cut.
                None if !bytes.ends_with(b"\n") && bytes.len() < MAX_LINE as usize => self.damage.cut(self.line),
                None => self.damage.leave_out(self.line, 1),
            }
        };
        let body = Body::Text(fields(&self.text).1);
        Ok(Some(DataFlashMessage { place: self.line, format, body }))
    }

    /// A line of JSON as one of a text. What it is about is defined by the first one, if the log has no definitions.
    fn json(&mut self, line: &[u8]) -> Option<String> {
        if line.trim_ascii().is_empty() {
            return Some(String::new());
        }
        let message = JsonMessage::read(line)?;
        let name = message.name();
        if !self.formats.contains_key(name) && self.formats.len() < MAX_FORMATS {
            let columns: Vec<_> = message.columns().collect();
            self.formats.insert(name.to_owned(), Rc::new(MessageFormat::of_names(name, &columns)));
        }
        self.formats.get(name).map(|format| message.line(format.names()))
    }

    /// The definition of the message in this line; `None` if it is none.
    fn format(&self) -> Option<Rc<MessageFormat>> {
        let (name, fields) = fields(&self.text);
        let format = self.formats.get(name)?;
        (fields.split(',').count() >= format.width()).then(|| Rc::clone(format))
    }

    fn define(&mut self, definitions: &MessageFormat) {
        match MessageFormat::read(definitions, Body::Text(fields(&self.text).1)) {
            Some(new) if new.number == FMT => {}
            Some(new) if self.formats.len() < MAX_FORMATS => drop(self.formats.insert(new.name.clone(), Rc::new(new))),
            _ => self.damage.leave_out(self.line, 1),
        }
    }
}

/// Name and fields of a line.
fn fields(line: &str) -> (&str, &str) {
    line.split_once(',').map_or((line, ""), |(name, fields)| (name.trim(), fields))
}
