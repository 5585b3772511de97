//! A message in which a device says its serial number, in a stream of bytes with frames before and behind it.

use crate::checksum::Checksum;
use crate::number::{ByteOrder, NumberType};
use memchr::memmem::Finder;

/// Longest line that is a message \[bytes\].
const MAX_LINE: usize = 128;

/// What a message with a serial number looks like.
#[derive(Clone)]
pub(crate) struct Message {
    /// Its first bytes, one at least.
    pub(crate) begins: Vec<u8>,
    pub(crate) form: Form,
}

/// How a message goes on.
#[derive(Clone)]
pub(crate) enum Form {
    /// The number follows the beginning, up to a comma, `*` or the end of the line. `*hh` must be the exclusive or of
    /// the bytes before it, but for a `$` at the beginning.
    Line,
    /// It has a length and maybe a checksum, and the number has a place.
    Frame { length: usize, checksum: Option<Checksum>, serial: Serial },
}

/// Where a serial number stands in a message, and how.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Serial {
    pub(crate) at: usize,
    pub(crate) form: SerialForm,
    /// What the number begins with that the message has not.
    pub(crate) prefix: String,
}

/// How a serial number is written.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum SerialForm {
    /// So many characters; spaces and zeros at the end are none.
    Text(usize),
    /// So many bytes, of two hexadecimal digits each: decimal ones, where they are packed so.
    Hex(usize),
    /// A number, written in decimal digits.
    Number(NumberType, ByteOrder),
}

impl SerialForm {
    /// How many bytes it takes.
    pub(crate) const fn bytes(self) -> usize {
        match self {
            Self::Text(bytes) | Self::Hex(bytes) => bytes,
            Self::Number(number, _) => number.bytes(),
        }
    }
}

impl Serial {
    fn read(&self, message: &[u8]) -> Option<String> {
        let bytes = message.get(self.at..self.at + self.form.bytes())?;
        let text = match self.form {
            SerialForm::Text(_) => {
                let text = std::str::from_utf8(bytes).ok()?.trim_matches(|end: char| end == '\0' || end == ' ');
                text.to_owned()
            }
            SerialForm::Hex(_) => bytes.iter().map(|byte| format!("{byte:02X}")).collect(),
            SerialForm::Number(number, order) => number.read(bytes, order).whole?.to_string(),
        };
        is_serial(&text).then(|| format!("{}{text}", self.prefix))
    }
}

/// Whether a text may be a serial number.
fn is_serial(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_graphic() || byte == b' ')
}

/// What the bytes at the beginning of a message are.
enum MessageStart {
    /// A message of this length with this number.
    Message(usize, String),
    Other,
    /// More bytes are needed.
    Open,
}

impl Message {
    fn beginning(&self, bytes: &[u8]) -> MessageStart {
        match &self.form {
            Form::Line => self.line(bytes),
            Form::Frame { length, checksum, serial } => {
                let Some(message) = bytes.get(..*length) else { return MessageStart::Open };
                let is_right = checksum.as_ref().is_none_or(|checksum| checksum.is_right(message) == Some(true));
                let number = if is_right { serial.read(message) } else { None };
                number.map_or(MessageStart::Other, |number| MessageStart::Message(*length, number))
            }
        }
    }

    fn line(&self, bytes: &[u8]) -> MessageStart {
        let Some(end) = bytes.iter().take(MAX_LINE).position(|byte| *byte == b'\n' || *byte == b'\r') else {
            let is_text = bytes.iter().skip(self.begins.len()).all(u8::is_ascii_graphic);
            return if is_text && bytes.len() < MAX_LINE { MessageStart::Open } else { MessageStart::Other };
        };
        let line = &bytes[..end];
        let text = match line.iter().rposition(|byte| *byte == b'*') {
            Some(star) if is_sealed(line, star) => &line[..star],
            Some(_) => return MessageStart::Other,
            None => line,
        };
        let number = text.get(self.begins.len()..).unwrap_or_default();
        let number = number.split(|byte| *byte == b',').next().unwrap_or_default();
        match std::str::from_utf8(number) {
            Ok(number) if is_serial(number) => MessageStart::Message(end + 1, number.to_owned()),
            _ => MessageStart::Other,
        }
    }
}

/// Whether a line has the right checksum behind the `*`.
fn is_sealed(line: &[u8], star: usize) -> bool {
    let text = line[..star].strip_prefix(b"$").unwrap_or(&line[..star]);
    let sum = text.iter().fold(0, |sum, byte| sum ^ byte);
    line[star + 1..].eq_ignore_ascii_case(format!("{sum:02X}").as_bytes())
}

/// Finds messages in a stream.
pub(crate) struct MessageFinder {
    message: Message,
    begins: Finder<'static>,
    /// What may be the beginning of a message.
    rest: Vec<u8>,
}

impl MessageFinder {
    pub(crate) fn new(message: Message) -> Self {
        Self { begins: Finder::new(&message.begins).into_owned(), rest: Vec::new(), message }
    }

    /// Takes the next bytes. Gives each serial number that is complete to `sink`, and how many of these bytes came up
    /// to its end.
    pub(crate) fn push(&mut self, bytes: &[u8], mut sink: impl FnMut(String, usize)) {
        let before = self.rest.len();
        self.rest.extend_from_slice(bytes);
        let mut done = 0;
        loop {
            let Some(begin) = self.begins.find(&self.rest[done..]) else {
                // Its first bytes may be at the end.
                done = done.max((self.rest.len() + 1).saturating_sub(self.message.begins.len()));
                break;
            };
            done += begin;
            match self.message.beginning(&self.rest[done..]) {
                MessageStart::Message(length, number) => {
                    done += length;
                    sink(number, done.saturating_sub(before));
                }
                MessageStart::Other => done += 1,
                MessageStart::Open => break,
            }
        }
        self.rest.drain(..done);
    }

    /// Another stream begins, as after the line was plugged in again.
    pub(crate) fn reset(&mut self) {
        self.rest.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checksum::Sum;
    use crate::number::Place;

    fn found(message: &Message, bytes: &[u8], piece: usize) -> Vec<(String, usize)> {
        let (mut finder, mut all, mut before) = (MessageFinder::new(message.clone()), Vec::new(), 0);
        for piece in bytes.chunks(piece) {
            finder.push(piece, |number, end| all.push((number, before + end)));
            before += piece.len();
        }
        all
    }

    /// What the manual's register 3 answers, with the numbers of public programs: 0100061897 and its checksum 5C.
    #[test]
    fn a_line_is_found_between_frames_however_the_bytes_come() {
        let message = Message { begins: b"$VNRRG,03,".to_vec(), form: Form::Line };
        let line = b"$VNRRG,03,0100061897*5C\r\n";
        let bytes = [&[0xFA, 0x05, b'$', b'V'][..], line, b"\xFA$VNRRG,03,0100061897*5D\r\n$VNRRG,03,", line].concat();
        for piece in 1..bytes.len() {
            let numbers = found(&message, &bytes, piece);
            assert_eq!(numbers.len(), 2, "{piece}");
            assert_eq!(numbers[0], ("0100061897".to_owned(), 4 + line.len() - 1), "{piece}");
        }
        assert_eq!(found(&message, b"$VNRRG,03,A-7,1\n", 16), [("A-7".to_owned(), 16)]);
        let endless = [b"$VNRRG,03,".to_vec(), vec![b'1'; 1000], b"\n".to_vec()].concat();
        assert_eq!(found(&message, &endless, 7), []);
    }

    #[test]
    fn a_frame_is_found_by_its_checksum() {
        let checksum = Checksum {
            sum: Sum::AddedToZero,
            at: Place(-1),
            order: ByteOrder::Big,
            from: Place(1),
            to: Place(-1),
            pad: 1,
        };
        let of = |form, prefix: &str| Message {
            begins: vec![0xFA, 0xFF, 0x01, 0x04],
            form: Form::Frame {
                length: 9,
                checksum: Some(checksum.clone()),
                serial: Serial { at: 4, form, prefix: prefix.to_owned() },
            },
        };
        let mut bytes = vec![0xFA, 0xFF, 0x01, 0x04, 0x03, 0x80, 0x1A, 0xBC];
        bytes.push(bytes[1..].iter().fold(0, |sum: u8, byte| sum.wrapping_sub(*byte)));
        let damaged = [&bytes[..7], &[0], &bytes[8..]].concat();
        let stream = [&damaged[..], &bytes, &[0xFA]].concat();
        for piece in 1..stream.len() {
            assert_eq!(found(&of(SerialForm::Hex(4), "N"), &stream, piece), [("N03801ABC".to_owned(), 18)], "{piece}");
        }
        let number = SerialForm::Number(NumberType::Unsigned(4), ByteOrder::Big);
        assert_eq!(found(&of(number, ""), &stream, 30), [(0x0380_1ABC.to_string(), 18)]);
        assert_eq!(found(&of(SerialForm::Text(4), ""), &stream, 30), []);
    }
}
