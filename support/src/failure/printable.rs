//! Text for a terminal. Names and values come from files and streams of others, and a terminal obeys control
//! characters: it could be made to erase lines, to show another text than there is, or to type.

use std::borrow::Cow;
use std::fmt::{Display, Write as _};
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use tracing::{info, warn};

/// The text with every character escaped that steers a terminal, as in `\u{1b}`: control characters (C0, DEL, C1)
/// except line ends and tabs, and the characters that change the direction of writing.
///
/// ```
/// use isotherm_support::failure::printable;
///
/// // A name from a file must not move the cursor of a terminal.
/// assert!(!printable("imu\u{1b}[2J").contains('\u{1b}'));
/// assert_eq!(printable("two\nlines"), "two\nlines");
/// ```
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, steers)
}

/// As [`printable`], with line ends and tabs escaped, too: for what comes from a file or a stream and becomes part of a
/// line, such as a name or a value. A line end in it would forge a line of its own.
///
/// ```
/// use isotherm_support::failure::one_line;
///
/// assert_eq!(one_line("imu\nisotherm: all is well"), r"imu\u{a}isotherm: all is well");
/// ```
#[must_use]
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, |character| matches!(character, '\n' | '\t') || steers(character))
}

/// The name of a file for a message, as [`one_line`] text. Every message names its files by this function.
///
/// ```
/// use isotherm_support::failure::shown;
/// use std::path::Path;
///
/// assert_eq!(shown(Path::new("a\nb.toml")).to_string(), r"a\u{a}b.toml");
/// ```
#[must_use]
pub fn shown(path: &Path) -> impl Display + use<> {
    one_line(&path.to_string_lossy()).into_owned()
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if is_escaped(character) {
            // Writing to a String cannot fail.
            let _ = write!(escaped, "{}", character.escape_unicode());
        } else {
            escaped.push(character);
        }
    }
    Cow::Owned(escaped)
}

/// The word as a shell takes it.
#[must_use]
pub fn quoted(word: &str) -> String {
    let is_plain = |character: char| character.is_ascii_alphanumeric() || "-_./,=:+@%".contains(character);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

/// The path as a shell and a command take it: one that begins with a hyphen is no option.
#[must_use]
pub fn quoted_path(path: &Path) -> String {
    let path = path.to_string_lossy();
    quoted(&if path.starts_with('-') { format!("./{path}") } else { path.into_owned() })
}

/// Whether messages are events of `tracing`.
static ARE_EVENTS: AtomicBool = AtomicBool::new(false);

/// Makes an event of `tracing` of every further message: the program has a subscriber that prints them, or not.
pub fn tell_as_events() {
    ARE_EVENTS.store(true, Ordering::Relaxed);
}

/// Prints a message for the operator to stderr: the name of the program and the message, as [`printable`] text; or
/// makes an event of it, after [`tell_as_events`].
pub fn tell(program: &str, message: impl Display) {
    if !ARE_EVENTS.load(Ordering::Relaxed) {
        return tell_plainly(program, message);
    }
    let message = message.to_string();
    if message.starts_with("warning") { warn!("{message}") } else { info!("{message}") }
}

/// Prints a message for the operator to stderr in any case.
pub fn tell_plainly(program: &str, message: impl Display) {
    // There is no other place for the message if stderr is closed.
    let _ = writeln!(io::stderr(), "{program}: {}", printable(&message.to_string()));
}

fn steers(character: char) -> bool {
    match character {
        '\n' | '\t' => false,
        // Marks, embeddings, overrides and isolates of the direction of writing.
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => true,
        // Line and paragraph separator, which some terminals take for line ends.
        '\u{2028}' | '\u{2029}' => true,
        _ => character.is_control(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_steers_a_terminal_is_escaped_and_nothing_else() {
        let plain = "imu-a: phase;\n\tcause \u{b0}C \u{3c9} \u{65e5}\u{672c} \\u{1b} \u{a0}\u{1f600}";
        assert!(matches!(printable(plain), Cow::Borrowed(text) if text == plain));
        assert_eq!(printable("a\u{1b}[2Jb"), r"a\u{1b}[2Jb");
        assert_eq!(printable("\r\0\u{7}\u{7f}\u{9b}31m"), r"\u{d}\u{0}\u{7}\u{7f}\u{9b}31m");
        assert_eq!(printable("x\u{202e}y\u{2066}"), r"x\u{202e}y\u{2066}");
        let escaped: Vec<_> =
            (0..=0x10_ffff).filter_map(char::from_u32).filter(|c| steers(*c)).map(u32::from).collect();
        let controls = (0..0x20).chain(0x7f..0xa0).filter(|c| ![9, 10].contains(c));
        let others = [0x61c, 0x200e, 0x200f].into_iter().chain(0x2028..=0x202e).chain(0x2066..=0x2069);
        assert_eq!(escaped, controls.chain(others).collect::<Vec<u32>>());
        // Escaping twice is escaping once.
        assert_eq!(printable(&printable("\u{1b}]0;x\u{7}")), r"\u{1b}]0;x\u{7}");
    }
}
