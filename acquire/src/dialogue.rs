//! A dialogue with a device: bytes that are sent, and answers that are waited for, while frames may go on between them.

use std::time::{Duration, Instant};

/// How long an answer may take.
pub(crate) const PATIENCE: Duration = Duration::from_secs(1);
/// Bytes of a stream in which an answer is looked for.
const HEARD: usize = 4096;

/// A step of a dialogue.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) struct DialogueStep {
    /// What is sent; nothing, if the step only waits.
    pub(crate) send: Vec<u8>,
    pub(crate) answer: DialogueAnswer,
}

/// What a device answers.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) enum DialogueAnswer {
    /// Nothing that is waited for.
    Nothing,
    /// These bytes, somewhere in the stream.
    Bytes(Vec<u8>),
    /// The message with its serial number.
    Message,
}

/// What a dialogue has come to.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum DialogueProgress {
    /// It goes on: all that was heard is its.
    Open,
    /// It is over. So many bytes at the end of what was heard last came behind the last answer.
    Over(usize),
}

/// A dialogue that is under way.
pub(crate) struct Dialogue {
    steps: Vec<DialogueStep>,
    /// The step that is under way, and how many of its bytes are sent.
    at: usize,
    sent: usize,
    since: Option<Instant>,
    /// What was heard since the last answer.
    heard: Vec<u8>,
    /// The steps whose answer did not come.
    unanswered: Vec<DialogueStep>,
}

impl Dialogue {
    /// `None` if there is nothing to say.
    pub(crate) fn new(steps: &[DialogueStep]) -> Option<Self> {
        let dialogue =
            Self { steps: steps.to_vec(), at: 0, sent: 0, since: None, heard: Vec::new(), unanswered: Vec::new() };
        (!steps.is_empty()).then_some(dialogue)
    }

    /// The steps whose answer did not come.
    pub(crate) fn unanswered(&self) -> &[DialogueStep] {
        &self.unanswered
    }

    /// Goes on with what was heard now; `message` is how many bytes of it came up to the end of the last message. What
    /// `write` does not take, it gets again.
    pub(crate) fn go_on(
        &mut self,
        heard: &[u8],
        message: Option<usize>,
        now: Instant,
        write: &mut dyn FnMut(&[u8]) -> usize,
    ) -> DialogueProgress {
        self.heard.extend_from_slice(heard);
        let mut message = message.map(|end| heard.len() - end);
        while let Some(step) = self.steps.get(self.at) {
            let since = *self.since.get_or_insert(now);
            let is_late = now - since >= PATIENCE;
            let (sent, all) = (self.sent, step.send.len());
            if sent < all && !is_late {
                // What came before a question is no answer to it.
                self.heard.clear();
                message = None;
                self.sent += write(&step.send[sent..]).min(all - sent);
                if self.sent < all {
                    return DialogueProgress::Open;
                }
            }
            let left = match &step.answer {
                DialogueAnswer::Nothing => Some(self.heard.len()),
                DialogueAnswer::Bytes(bytes) => {
                    let place = memchr::memmem::find(&self.heard, bytes);
                    place.map(|place| self.heard.len() - place - bytes.len())
                }
                DialogueAnswer::Message => message,
            };
            match left {
                Some(left) => drop(self.heard.drain(..self.heard.len().saturating_sub(left))),
                None if is_late => self.unanswered.push(step.clone()),
                None => {
                    let old = self.heard.len().saturating_sub(HEARD);
                    self.heard.drain(..old);
                    return DialogueProgress::Open;
                }
            }
            (self.at, self.sent, self.since) = (self.at + 1, 0, None);
        }
        DialogueProgress::Over(self.heard.len().min(heard.len()))
    }
}

/// Bytes for people: as text where they are, otherwise in hexadecimal digits.
pub(crate) fn shown(bytes: &[u8]) -> String {
    let is_text = bytes.iter().all(|byte| byte.is_ascii_graphic() || b" \r\n".contains(byte));
    match std::str::from_utf8(bytes) {
        Ok(text) if is_text => format!("{:?}", text.trim_end()),
        _ => bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(send: &str, answer: &str) -> DialogueStep {
        let answer =
            if answer.is_empty() { DialogueAnswer::Nothing } else { DialogueAnswer::Bytes(answer.as_bytes().to_vec()) };
        DialogueStep { send: send.as_bytes().to_vec(), answer }
    }

    #[test]
    fn steps_wait_for_their_answers_and_what_follows_the_last_is_left() {
        let now = Instant::now();
        let mut dialogue = Dialogue::new(&[step("ab", "X"), step("", ">"), step("c", "YZ")]).unwrap();
        let mut sent = Vec::new();
        // One byte at a time is taken.
        let mut write = |bytes: &[u8]| {
            sent.push(bytes[0]);
            1
        };
        assert_eq!(dialogue.go_on(b"X>", None, now, &mut write), DialogueProgress::Open);
        assert_eq!(
            dialogue.go_on(b"X>", None, now, &mut write),
            DialogueProgress::Open,
            "it came before all was asked"
        );
        assert_eq!(dialogue.go_on(b"..", None, now, &mut write), DialogueProgress::Open);
        assert_eq!(dialogue.go_on(b"X..>YZ", None, now, &mut write), DialogueProgress::Open);
        assert_eq!(dialogue.go_on(b"Y", None, now, &mut write), DialogueProgress::Open);
        assert_eq!(dialogue.go_on(b"Zframe", None, now, &mut write), DialogueProgress::Over(5));
        assert!(dialogue.unanswered().is_empty());
        assert_eq!(sent, b"abc");
    }

    #[test]
    fn an_answer_that_does_not_come_is_waited_for_a_second() {
        let now = Instant::now();
        let steps =
            [step("a", "X"), step("b", ""), DialogueStep { send: b"c".to_vec(), answer: DialogueAnswer::Message }];
        let mut dialogue = Dialogue::new(&steps).unwrap();
        let mut write = |bytes: &[u8]| bytes.len();
        assert_eq!(dialogue.go_on(b"frames", Some(3), now, &mut write), DialogueProgress::Open);
        assert_eq!(dialogue.go_on(b"frames", None, now + PATIENCE, &mut write), DialogueProgress::Open);
        assert_eq!(dialogue.unanswered(), &steps[..1]);
        let message = dialogue.go_on(b"message.", Some(7), now + PATIENCE, &mut write);
        assert_eq!(message, DialogueProgress::Over(1));
        let mut dialogue = Dialogue::new(&steps[2..]).unwrap();
        // A line that takes nothing.
        assert_eq!(dialogue.go_on(b"", None, now, &mut |_| 0), DialogueProgress::Open);
        assert_eq!(dialogue.go_on(b"", None, now + PATIENCE, &mut |_| 0), DialogueProgress::Over(0));
        assert!(Dialogue::new(&[]).is_none());
    }

    #[test]
    fn bytes_are_shown_as_text_or_digits() {
        assert_eq!(shown(b"m 3\r"), "\"m 3\"");
        assert_eq!(shown(&[0xFA, 0xFF, 0x30]), "FA FF 30");
    }
}
