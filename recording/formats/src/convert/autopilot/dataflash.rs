//! The messages of a DataFlash log, binary or as text.
//!
//! Binary: `A3 95`, number, body; the log defines each number before it uses it. Text: a line per message, with its
//! name and its fields, separated by commas, as ground stations write it.

use super::dataflash_format::{Body, FMT, Format, HEADER};
use super::window::{Damage, Window};
use isotherm_recording::RecordingError;
use std::collections::HashMap;
use std::io::{self, BufRead as _, BufReader, Read};
use std::rc::Rc;

/// What every binary message begins with.
const MAGIC: [u8; 2] = [0xa3, 0x95];
/// Longest line of a text \[bytes\].
const MAX_LINE: u64 = 1 << 14;
/// Most definitions of a text.
const MAX_FORMATS: usize = 1000;

/// Whether data that begin with these bytes are a binary log.
pub(in super::super) fn is_binary_log(beginning: &[u8]) -> bool {
    beginning.starts_with(&MAGIC)
}

/// Whether data that begin with these bytes are a log as text.
pub(in super::super) fn is_text_log(beginning: &[u8]) -> bool {
    let beginning = beginning.strip_prefix("\u{feff}".as_bytes()).unwrap_or(beginning).trim_ascii_start();
    beginning.strip_prefix(b"FMT").is_some_and(|rest| rest.trim_ascii_start().starts_with(b","))
}

/// A message that concerns a conversion.
pub(super) struct Message<'a> {
    /// Its byte or line.
    pub(super) place: u64,
    pub(super) format: Rc<Format>,
    pub(super) body: Body<'a>,
}

/// The messages of a log.
pub(super) enum Messages {
    Binary(Binary),
    Text(Text),
}

/// Of a binary log.
pub(super) struct Binary {
    window: Window,
    /// Bytes of the last message, which are passed with the next call.
    held: usize,
    /// By number.
    formats: Vec<Option<Rc<Format>>>,
    damage: Damage,
}

/// Of a text.
pub(super) struct Text {
    source: BufReader<Box<dyn Read>>,
    line: u64,
    text: String,
    formats: HashMap<String, Rc<Format>>,
    damage: Damage,
}

/// Whether a conversion needs messages of this name.
fn is_wanted(name: &str) -> bool {
    name.starts_with("IMU") || matches!(name, "PARM" | "FMTU" | "TCLR" | "EV" | "ARM" | "STAT")
}

impl Messages {
    pub(super) fn new(source: Box<dyn Read>, is_text: bool) -> Self {
        let definitions = Rc::new(Format::of_definitions());
        if is_text {
            let formats = HashMap::from([(definitions.name.clone(), definitions)]);
            let source = BufReader::with_capacity(1 << 16, source);
            return Self::Text(Text { source, line: 0, text: String::new(), formats, damage: Damage::default() });
        }
        let mut formats = vec![None; 1 << 8];
        formats[usize::from(FMT)] = Some(definitions);
        Self::Binary(Binary { window: Window::new(source), held: 0, formats, damage: Damage::default() })
    }

    /// The next message that concerns a conversion.
    pub(super) fn next(&mut self) -> io::Result<Option<Message<'_>>> {
        match self {
            Self::Binary(log) => log.next(),
            Self::Text(log) => log.next(),
        }
    }

    /// An error at a place, or else here.
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
    pub(super) fn imu_format(&self, number: u8) -> Option<Rc<Format>> {
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
    fn next(&mut self) -> io::Result<Option<Message<'_>>> {
        loop {
            self.window.pass(core::mem::take(&mut self.held));
            if self.window.is_at_end()? {
                return Ok(None);
            }
            let place = self.window.place();
            let Some(format) = self.format(0)? else {
                if self.find()? {
                    self.damage.leave_out(place, self.window.place() - place);
                    continue;
                }
                self.damage.cut(place);
                return Ok(None);
            };
            let bytes = self.window.ahead(format.length)?;
            if bytes.len() < format.length {
                self.damage.cut(place);
                return Ok(None);
            }
            self.held = format.length;
            if format.number == FMT {
                let new = Format::read(&format, Body::Binary(&bytes[HEADER..]));
                if let Some(new) = new.filter(|new| new.number != FMT) {
                    let number = usize::from(new.number);
                    self.formats[number] = Some(Rc::new(new));
                }
            } else if is_wanted(&format.name) {
                let body = Body::Binary(&self.window.ahead(format.length)?[HEADER..]);
                return Ok(Some(Message { place, format, body }));
            }
        }
    }

    /// The definition of the message that stands `after` bytes ahead.
    fn format(&mut self, after: usize) -> io::Result<Option<Rc<Format>>> {
        let header = self.window.ahead(after + HEADER)?.get(after..).unwrap_or_default();
        let number = header.strip_prefix(&MAGIC).and_then(<[u8]>::first);
        Ok(number.and_then(|number| self.formats[usize::from(*number)].clone()))
    }

    /// Goes to the next place where two messages follow each other, or one up to the end; `false` if there is none.
    fn find(&mut self) -> io::Result<bool> {
        loop {
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
    fn next(&mut self) -> io::Result<Option<Message<'_>>> {
        let format = loop {
            self.line += 1;
            let mut bytes = Vec::new();
            if (&mut self.source).take(MAX_LINE).read_until(b'\n', &mut bytes)? == 0 {
                self.line -= 1;
                return Ok(None);
            }
            self.text = String::from_utf8_lossy(&bytes).trim_start_matches('\u{feff}').trim().to_owned();
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
        Ok(Some(Message { place: self.line, format, body }))
    }

    /// The definition of the message in this line; `None` if it is none.
    fn format(&self) -> Option<Rc<Format>> {
        let (name, fields) = fields(&self.text);
        let format = self.formats.get(name)?;
        (fields.split(',').count() >= format.width()).then(|| Rc::clone(format))
    }

    fn define(&mut self, definitions: &Format) {
        match Format::read(definitions, Body::Text(fields(&self.text).1)) {
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
