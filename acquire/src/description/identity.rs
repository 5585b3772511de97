//! The sections `[identity]` and `[[setup]]`: who the device is, and how it is set up.

use super::columns::Names;
use super::frame;
use super::port::Port;
use crate::dialogue::{DialogueAnswer, DialogueStep};
use crate::frames::{Length, MAX_FRAME};
use crate::message::{Form, Message, Serial, SerialForm};
use crate::number::{ByteOrder, NumberType};
use isotherm_shared::document::Section;

/// Most steps of a dialogue, and most bytes of what is sent or answered.
const MAX_STEPS: usize = 64;
const MAX_BYTES: usize = 256;

/// How a device says who it is, and what becomes of another one's samples.
#[derive(Clone)]
pub(crate) struct Identity {
    pub(crate) says: SerialNumberSource,
    /// What is asked when the port was opened; none, if it says so unasked.
    pub(crate) ask: Vec<DialogueStep>,
    /// Whether nothing of another device is sent.
    pub(crate) holds: bool,
}

/// Where a device says its serial number.
#[derive(Clone)]
pub(crate) enum SerialNumberSource {
    /// In a column of this place in a row, as a whole number.
    Field(usize),
    /// In a message between the frames.
    Message(Message),
}

/// Reads both sections; `port`: where bytes come from, if that is known.
pub(super) fn read(
    root: &Section<'_, '_>,
    port: Option<&Port>,
    names: &mut Names,
) -> (Option<Identity>, Vec<DialogueStep>) {
    let set_up = root.list("setup");
    if names.are_channels() {
        root.fault_if(!set_up.is_empty(), "setup", "is not for IIO; leave it out");
        root.fault_if(root.optional_section("identity").is_some(), "identity", "is not for IIO; leave it out");
        return (None, Vec::new());
    }
    let section = root.optional_section("identity");
    let asks = section.as_ref().is_some_and(|section| section.has("ask"));
    if let Some(section) = section.as_ref().filter(|_| root.has("serial") && matches!(port, Some(Port::Udp(_)))) {
        refuse_silent(section, "ask", port);
    }
    let identity = section.and_then(|section| identity(section, names));
    if root.has("setup") && root.has("identity") && !asks {
        root.fault("setup", "is sent once the device has said who it is; give identity.ask, or leave one out");
    }
    refuse_silent(root, "setup", port);
    (identity, steps(set_up, false))
}

fn identity(section: Section<'_, '_>, names: &mut Names) -> Option<Identity> {
    let field = section.has("field").then(|| names.all_of_section(&section, "field"));
    section.ignore("field");
    let field = field.map(|places| places.and_then(|places| places.first().copied()));
    let message = section.optional_section("message").map(message);
    let ask = steps(section.list("ask"), true);
    let holds = section.optional_choice("on_other", &[(false, "flag"), (true, "hold")]).unwrap_or(false);
    match (&field, &message) {
        (None, None) => section.fault("message", "missing; give how the device says who it is: field or message"),
        (Some(_), Some(_)) => section.fault("field", "is given in addition to message; give one of them"),
        (Some(_), None) if section.has("ask") => {
            section.fault("ask", "is for a message; a field comes unasked, so leave it out");
        }
        _ => {}
    }
    let asked = ask.iter().filter(|step| step.answer == DialogueAnswer::Message).count();
    section.refuse(
        "ask",
        (!ask.is_empty() && asked != 1)
            .then(|| format!("has {asked} steps without answer; give one, which message answers")),
    );
    section.finish();
    let says = field.map_or_else(
        || message.flatten().map(SerialNumberSource::Message),
        |place| place.map(SerialNumberSource::Field),
    );
    Some(Identity { says: says?, ask, holds })
}

/// Who cannot hear is not spoken to.
fn refuse_silent(section: &Section<'_, '_>, key: &str, port: Option<&Port>) {
    let what = match port {
        Some(Port::Udp(_)) => "datagrams have",
        Some(Port::File { .. } | Port::Stdin) => "a file has",
        _ => return,
    };
    let message = format!("{what} nobody to whom it could be sent; connect by serial or tcp, or leave it out");
    section.refuse(key, section.has(key).then_some(message));
}

/// The steps of a dialogue; of `ask` one without answer is answered by the message.
fn steps(sections: Vec<Section<'_, '_>>, of_ask: bool) -> Vec<DialogueStep> {
    let mut steps = Vec::new();
    if let Some(section) = sections.get(MAX_STEPS) {
        section.fault("", format!("is one too many; give {MAX_STEPS} at most"));
    }
    for section in sections {
        let [send, answer] = ["send", "answer"].map(|key| bytes(&section, key));
        if send.is_none() && !section.has("send") && !section.has("answer") {
            section.fault("send", "missing; give what is sent, as in \"I\\r\" or [0xFA, 0xFF], or only an answer");
        }
        let answer = match answer {
            Some(answer) => DialogueAnswer::Bytes(answer),
            None if of_ask => DialogueAnswer::Message,
            None => DialogueAnswer::Nothing,
        };
        section.finish();
        steps.push(DialogueStep { send: send.unwrap_or_default(), answer });
    }
    steps
}

/// A text or a list of bytes.
fn bytes(section: &Section<'_, '_>, key: &'static str) -> Option<Vec<u8>> {
    let bytes = section.optional_bytes(key)?;
    let right = (1..=MAX_BYTES).contains(&bytes.len());
    section.refuse(key, (!right).then(|| format!("has {} bytes; give 1 to {MAX_BYTES}", bytes.len())));
    right.then_some(bytes)
}

fn message(section: Section<'_, '_>) -> Option<Message> {
    if !section.has("begins") {
        section.fault("begins", "missing; give the first bytes of the message, as in \"$VNRRG,03,\" or [0xB5]");
    }
    let begins = bytes(&section, "begins");
    let form = if section.has("length") {
        frame_form(&section, begins.as_ref().map_or(1, Vec::len))
    } else {
        for key in ["checksum", "serial"].into_iter().filter(|key| section.has(key)) {
            section.fault(key, "is for a message with a length; give it, or leave this out for a line of text");
            section.ignore(key);
        }
        Some(Form::Line)
    };
    section.finish();
    Some(Message { begins: begins?, form: form? })
}

fn frame_form(section: &Section<'_, '_>, begins: usize) -> Option<Form> {
    let length = section.optional_integer("length", begins as i64..=MAX_FRAME as i64).map(|length| length as usize);
    let checksum = frame::checksum(section, ByteOrder::Big, length.map(Length::Fixed));
    let serial = section.section("serial", "where the number stands, as serial = { at = 4, bytes = 4, as = \"hex\" }");
    let serial = serial.and_then(|serial| place_of_serial(serial, length));
    Some(Form::Frame { length: length?, checksum: checksum?, serial: serial? })
}

fn place_of_serial(section: Section<'_, '_>, length: Option<usize>) -> Option<Serial> {
    let at = section.integer("at", 0..=MAX_FRAME as i64, "its place in the message, in bytes").map(|at| at as usize);
    let name = section.string("as", "\"text\", \"hex\", or the type of a number");
    let prefix = section.optional_string("prefix").unwrap_or_default().to_owned();
    let form = match name {
        Some(name @ ("text" | "hex")) => {
            let bytes = section.integer("bytes", 1..=64, "how many bytes it has").map(|bytes| bytes as usize);
            bytes.map(if name == "text" { SerialForm::Text } else { SerialForm::Hex })
        }
        Some(name) => {
            let number = NumberType::NAMES.iter().find(|(number, of)| *of == name && number.is_unsigned());
            let wrong = number.is_none().then(|| format!("is {name:?}; give text, hex, u8, u16, u24, u32 or u64"));
            section.refuse("as", wrong);
            let order = section.optional_choice("byte_order", &ByteOrder::NAMES).unwrap_or(ByteOrder::Big);
            number.map(|(number, _)| SerialForm::Number(*number, order))
        }
        None => None,
    };
    if let (Some(at), Some(form), Some(length)) = (at, form, length) {
        let outside = at + form.bytes() > length;
        let bytes = form.bytes();
        section.refuse("at", outside.then(|| format!("is {at}, and the {bytes} bytes are not within the {length}")));
    }
    section.finish();
    Some(Serial { at: at?, form: form?, prefix })
}
