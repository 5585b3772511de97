//! Who the device is: what it says of itself, against the description's serial number.

use crate::description::{Description, SerialNumberSource};
use crate::dialogue::{Dialogue, DialogueProgress, DialogueStep, shown};
use crate::message::MessageFinder;
use crate::notice::Notice;
use crate::number::Value;
use crate::tally::Tally;
use isotherm_client::device;
use isotherm_support::failure::{Exit, Failure, tell};
use std::time::Instant;

/// What a device says of itself, and whether it is the description's.
pub(crate) struct Recognition {
    /// The number of the description's unit; `None`: any device is taken.
    serial: Option<String>,
    /// The place of the number in a row.
    field: Option<usize>,
    finder: Option<MessageFinder>,
    ask: Vec<DialogueStep>,
    setup: Vec<DialogueStep>,
    holds: bool,
    /// The exit code of a refusal.
    refusal: Exit,
    /// Whether this IMU had sent a sample before this process began, since the machine was started.
    has_sent: bool,
    known: DeviceKnowledge,
    /// Questions that were not answered yet: a message that nobody asked for comes from a device that was just powered.
    asked: usize,
    under_way: Option<(Dialogue, DialogueSubject)>,
    /// Why the device is refused, once the dialogue is over that is under way: it is not left in the midst of it.
    refused: Option<Failure>,
    notices: Notices,
}

/// What is said of the device's identity. Who sends without end chooses how often it changes, so each kind is said once
/// a minute.
#[derive(Debug, Default)]
struct Notices {
    right: Notice,
    right_again: Notice,
    other: Notice,
    powered: Notice,
    unanswered: Notice,
    unknown: Notice,
    not_set_up: Notice,
}

/// Which device it is, as far as it has said so.
#[derive(Clone, Debug, Eq, PartialEq)]
enum DeviceKnowledge {
    Unknown,
    Right,
    /// Another one, with this number.
    Other(String),
}

/// What a dialogue is about.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum DialogueSubject {
    Identity,
    SetUp,
}

impl Recognition {
    /// `has_sent`: this IMU has sent a sample since the machine was started. Then another device is flagged or held,
    /// otherwise it is refused.
    pub(crate) fn new(description: &Description, has_sent: bool) -> Self {
        let identity = description.identity.as_ref();
        let (field, finder) = match identity.map(|identity| &identity.says) {
            Some(SerialNumberSource::Field(place)) => (Some(*place), None),
            Some(SerialNumberSource::Message(message)) => (None, Some(MessageFinder::new(message.clone()))),
            None => (None, None),
        };
        Self {
            serial: description.serial.clone(),
            field,
            finder,
            ask: identity.map(|identity| identity.ask.clone()).unwrap_or_default(),
            setup: description.setup.clone(),
            holds: identity.is_some_and(|identity| identity.holds),
            refusal: description.contradiction(),
            has_sent,
            known: DeviceKnowledge::Unknown,
            asked: 0,
            under_way: None,
            refused: None,
            notices: Notices::default(),
        }
    }

    /// Says at the start what will not be noticed.
    pub(crate) fn announce(&self) {
        let message = if self.field.is_none() && self.finder.is_none() {
            "the description has no [identity]: the device cannot say who it is, and another one at its place is taken \
             for it"
        } else if self.serial.is_none() {
            "the description has no serial: the device is not asked who it is, and any one is taken"
        } else {
            return;
        };
        tell("isotherm", message);
    }

    /// The port was opened: the device is asked who it is, and then set up.
    pub(crate) fn begin(&mut self) {
        self.asked = 0;
        // Another one may be there now. That it is the right one again it has to say itself.
        if self.known == DeviceKnowledge::Right {
            self.known = DeviceKnowledge::Unknown;
        }
        if let Some(finder) = &mut self.finder {
            finder.reset();
        }
        let question = Dialogue::new(if self.serial.is_some() { &self.ask } else { &[] });
        self.under_way = match question {
            Some(question) => {
                self.asked = 1;
                Some((question, DialogueSubject::Identity))
            }
            None => Dialogue::new(&self.setup).map(|set_up| (set_up, DialogueSubject::SetUp)),
        };
    }

    /// Takes bytes that came, before frames are sought in them; none, if only time has passed. Returns how many of them
    /// are not to be used, since they came while a question or a setting was under way.
    ///
    /// # Errors
    /// If it is another device, and this IMU has sent no sample since the machine was started.
    pub(crate) fn hear(
        &mut self,
        bytes: &[u8],
        tally: &mut Tally,
        write: &mut dyn FnMut(&[u8]) -> usize,
    ) -> Result<usize, Failure> {
        let (mut numbers, mut message) = (Vec::new(), None);
        if let Some(finder) = &mut self.finder {
            finder.push(bytes, |number, end| {
                numbers.push(number);
                message = Some(end);
            });
        }
        for number in numbers {
            match self.asked {
                0 => {
                    tally.power_ups += 1;
                    let gone = if self.setup.is_empty() { "" } else { "; what setup has set may be gone" };
                    let powered = &mut self.notices.powered;
                    powered.tell(|| format!("the device was just powered: it says that it is {number}{gone}"));
                }
                _ => self.asked -= 1,
            }
            let found = self.is(number, tally);
            match &self.under_way {
                Some(_) => self.refused = self.refused.take().or(found.err()),
                None => found?,
            }
        }
        let Some((dialogue, subject)) = &mut self.under_way else { return Ok(0) };
        let DialogueProgress::Over(left) = dialogue.go_on(bytes, message, Instant::now(), write) else {
            return Ok(bytes.len());
        };
        let (unanswered, subject) = (dialogue.unanswered().to_vec(), *subject);
        tally.unanswered += unanswered.len() as u64;
        self.under_way = self.next(subject, &unanswered);
        if let Some(refused) = self.refused.take() {
            return Err(refused);
        }
        Ok(if self.under_way.is_some() { bytes.len() } else { bytes.len() - left })
    }

    /// What follows a dialogue, whose faults are reported.
    fn next(&mut self, subject: DialogueSubject, unanswered: &[DialogueStep]) -> Option<(Dialogue, DialogueSubject)> {
        let notices = &mut self.notices;
        if !unanswered.is_empty() {
            let what = |step: &DialogueStep| match step.send.is_empty() {
                true => "what was to follow".to_owned(),
                false => shown(&step.send),
            };
            let all: Vec<_> = unanswered.iter().map(what).collect();
            let all = all.join(", ");
            notices
                .unanswered
                .tell(|| format!("warning: the device has not answered {all} within 1 s as the description says"));
        }
        if subject == DialogueSubject::SetUp {
            return None;
        }
        if self.known == DeviceKnowledge::Unknown {
            let unknown = "warning: the device has not said who it is: it is unknown, and taken as it comes";
            notices.unknown.tell(|| unknown.to_owned());
        }
        if self.known == DeviceKnowledge::Right {
            return Dialogue::new(&self.setup).map(|set_up| (set_up, DialogueSubject::SetUp));
        }
        if !self.setup.is_empty() {
            let not_set_up = "warning: it is not set up, since it is not known to be the unit of this description";
            notices.not_set_up.tell(|| not_set_up.to_owned());
        }
        None
    }

    /// Takes a row, which may have the number.
    ///
    /// # Errors
    /// As [`hear`](Self::hear).
    pub(crate) fn see(&mut self, row: &[Value], tally: &mut Tally) -> Result<(), Failure> {
        let number = self.field.and_then(|place| row.get(place)?.whole);
        number.map_or(Ok(()), |number| self.is(number.to_string(), tally))
    }

    /// The device has said its number.
    fn is(&mut self, number: String, tally: &mut Tally) -> Result<(), Failure> {
        let Some(serial) = &self.serial else { return Ok(()) };
        tally.device.clone_from(&number);
        let was = match number == *serial {
            true => std::mem::replace(&mut self.known, DeviceKnowledge::Right),
            false => std::mem::replace(&mut self.known, DeviceKnowledge::Other(number.clone())),
        };
        tally.is_other = self.known != DeviceKnowledge::Right;
        if was == self.known {
            return Ok(());
        }
        if self.known == DeviceKnowledge::Right {
            match was {
                DeviceKnowledge::Unknown => self.notices.right.tell(|| format!("the device is {serial}")),
                _ => self.notices.right_again.tell(|| format!("the device is {serial} again")),
            }
            return Ok(());
        }
        if !self.has_sent && tally.samples == 0 {
            let message = format!(
                "the device says that it is {number}, and the description is of {serial}: connect that device, give this \
                 one its own description and table, or exchange the ports of the two descriptions"
            );
            return Err(Failure::new(self.refusal, message));
        }
        Ok(())
    }

    /// Under whose number samples go out.
    pub(crate) fn signature(&self) -> Signature {
        match &self.known {
            DeviceKnowledge::Other(_) if self.holds => Signature::Held,
            DeviceKnowledge::Other(number) => Signature::Other(device(number)),
            DeviceKnowledge::Unknown | DeviceKnowledge::Right => Signature::Own,
        }
    }

    /// Reports that samples were of another device.
    pub(crate) fn remind(&mut self) {
        let DeviceKnowledge::Other(number) = &self.known else { return };
        let serial = self.serial.as_deref().unwrap_or_default();
        let what = if self.holds { "nothing of it is sent" } else { "its samples go out under its own number" };
        self.notices
            .other
            .tell(|| format!("warning: the device is {number}, and not {serial}: {what}; connect that device"));
    }
}

/// Under whose number samples go out.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(crate) enum Signature {
    /// The description's.
    #[default]
    Own,
    /// Another device's.
    Other(u64),
    /// They are not sent.
    Held,
}
