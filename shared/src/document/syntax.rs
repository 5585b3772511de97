//! The syntax of a text: a first look that takes memory and time in proportion to the length, whatever the text is.
//!
//! The crate `toml` collects an error for every byte of a text that is not TOML, which takes half a gigabyte for a
//! megabyte. Therefore its parser first runs into a sink that only counts, and keeps the errors of the first lines. The
//! tree is built of what has few errors and few tokens.

use super::faults::{Fault, Faults};
use core::ops::Range;
use isotherm_support::failure::one_line;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use toml::Spanned;
use toml::de::DeTable;
use toml_parser::decoder::Encoding;
use toml_parser::parser::{EventReceiver, RecursionGuard, parse_document};
use toml_parser::{ErrorSink, Expected, ParseError, Raw, Source, Span};

/// Limit of words, numbers, marks, gaps and line ends of a text. The largest file of the examples and tests has 2200.
pub const MAX_TOKENS: usize = 1 << 17;
/// Limit of reported syntax errors: a file that is not TOML has one on every line.
pub(super) const MAX_LINES: usize = 8;
/// With more errors than this the tree is not built.
const MAX_ERRORS: usize = 100;
/// Depth of arrays and tables within each other, as in the crate `toml`.
const MAX_DEPTH: u32 = 80;
/// What a message shows of a line before the place, and from the place on \[characters\].
const WINDOW: usize = 40;

/// Parses `text`.
///
/// # Errors
/// The first error of each of the first [`MAX_LINES`] lines that have one, in the order of the lines, and the count of
/// the others.
pub(super) fn parse<'a>(text: &'a str, lines: &Lines) -> Result<Spanned<DeTable<'a>>, Faults> {
    let mut errors = SyntaxErrors::new(text, lines);
    let source = Source::new(text);
    let count = source.lex().count();
    {
        // With its final capacity: a vector that grows takes three times as much.
        let mut tokens = Vec::with_capacity(count);
        tokens.extend(source.lex());
        let mut decoder = Decoder(source);
        parse_document(&tokens, &mut RecursionGuard::new(&mut decoder, MAX_DEPTH), &mut errors);
    }
    if errors.total > MAX_ERRORS || errors.total > 0 && count > MAX_TOKENS {
        return Err(errors.faults());
    }
    if count > MAX_TOKENS {
        let message = format!("has over {MAX_TOKENS} words, numbers and marks; no file that is read here has as many");
        return Err(Faults(vec![Fault { line: 1, key: String::new(), message }]));
    }
    let (root, found) = DeTable::parse_recoverable(text);
    for error in &found {
        errors.add(error.span().map_or(0, |span| span.start), || error.message().to_owned());
    }
    if found.is_empty() && errors.total == 0 { Ok(root) } else { Err(errors.faults()) }
}

/// Where the lines of a text end.
pub(super) struct Lines(Vec<usize>);

impl Lines {
    pub(super) fn of(text: &str) -> Self {
        Self(memchr::memchr_iter(b'\n', text.as_bytes()).collect())
    }

    /// The line of the byte at `offset`, from 1.
    pub(super) fn at(&self, offset: usize) -> usize {
        1 + self.0.partition_point(|&end| end < offset)
    }

    /// The bytes of a line, without its end. Below the last line there are none.
    fn range(&self, line: usize, text: &str) -> Range<usize> {
        let begin = line.checked_sub(2).map_or(0, |above| self.0.get(above).map_or(text.len() + 1, |end| end + 1));
        begin..self.0.get(line - 1).copied().unwrap_or(text.len())
    }
}

/// The errors of a text: all are counted, those of the first lines are kept.
struct SyntaxErrors<'a> {
    text: &'a str,
    lines: &'a Lines,
    /// Line of the last error, and its bytes: the next one is mostly in the same line.
    last: (usize, Range<usize>),
    /// Whether a line has an error.
    wrong: Vec<bool>,
    /// How many lines have one.
    wrong_lines: usize,
    /// Place and message of the first error of a line, for the first lines that have one.
    first: BTreeMap<usize, (usize, String)>,
    total: usize,
}

impl<'a> SyntaxErrors<'a> {
    fn new(text: &'a str, lines: &'a Lines) -> Self {
        Self {
            text,
            lines,
            last: (1, lines.range(1, text)),
            wrong: vec![false; lines.0.len() + 1],
            wrong_lines: 0,
            first: BTreeMap::new(),
            total: 0,
        }
    }

    fn add(&mut self, offset: usize, message: impl FnOnce() -> String) {
        self.total += 1;
        let (line, range) = &self.last;
        if !(range.start..=range.end).contains(&offset) {
            let next = self.lines.range(line + 1, self.text);
            let line = if (next.start..=next.end).contains(&offset) { line + 1 } else { self.lines.at(offset) };
            self.last = (line, self.lines.range(line, self.text));
        }
        let line = self.last.0;
        if let Some(wrong) = self.wrong.get_mut(line - 1) {
            self.wrong_lines += usize::from(!core::mem::replace(wrong, true));
        }
        if self.first.len() == MAX_LINES && self.first.last_key_value().is_some_and(|(last, _)| *last < line) {
            return;
        }
        // After an error the parser often reports others on the same line, which follow from it.
        match self.first.entry(line) {
            Entry::Occupied(entry) if entry.get().0 <= offset => {}
            Entry::Occupied(mut entry) => {
                entry.insert((offset, message()));
            }
            Entry::Vacant(entry) => {
                entry.insert((offset, message()));
                if self.first.len() > MAX_LINES {
                    self.first.pop_last();
                }
            }
        }
    }

    fn faults(self) -> Faults {
        let rest = self.wrong_lines - self.first.len();
        let fault = |(line, (offset, message)): (usize, (usize, String))| {
            let range = self.lines.range(line, self.text);
            let place = excerpt(self.text.get(range.clone()).unwrap_or_default(), offset.saturating_sub(range.start));
            let message = one_line(&message).into_owned();
            Fault { line, key: String::new(), message: format!("not TOML: {message}{place}") }
        };
        let mut faults: Vec<_> = self.first.into_iter().map(fault).collect();
        if rest > 0 {
            let line = faults.last().map_or(1, |fault| fault.line);
            faults.push(Fault { line, key: String::new(), message: format!("and {rest} lines more like this") });
        }
        Faults(faults)
    }
}

impl ErrorSink for SyntaxErrors<'_> {
    fn report_error(&mut self, error: ParseError) {
        self.add(error.unexpected().map_or(0, |span| span.start()), || message(&error));
    }
}

/// What `toml` says of an error.
fn message(error: &ParseError) -> String {
    let Some(expected) = error.expected() else { return error.description().to_owned() };
    let expected = expected.iter().map(|expected| match expected {
        Expected::Literal("\n") => "newline".to_owned(),
        Expected::Literal("`") => "'`'".to_owned(),
        Expected::Literal(text) => format!("`{text}`"),
        Expected::Description(text) => (*text).to_owned(),
        _ => "etc".to_owned(),
    });
    let expected = expected.collect::<Vec<_>>().join(", ");
    let expected = if expected.is_empty() { "nothing" } else { &expected };
    format!("{}, expected {expected}", error.description())
}

/// Two lines below a message: what stands around the byte at `place` of a line, and a mark below this byte. Nothing if
/// the line is empty.
fn excerpt(line: &str, place: usize) -> String {
    let line = line.trim_end();
    if line.is_empty() {
        return String::new();
    }
    let place = (0..=place.min(line.len())).rev().find(|at| line.is_char_boundary(*at)).unwrap_or(0);
    let (before, from) = line.split_at(place);
    let begin = before.char_indices().rev().nth(WINDOW - 1).map_or(0, |(at, _)| at);
    let end = from.char_indices().nth(WINDOW).map_or(from.len(), |(at, _)| at);
    let shown = |part: &str| one_line(&part.replace('\t', " ")).into_owned();
    let [left, right] = [begin > 0, end < from.len()].map(|cut| if cut { "..." } else { "" });
    let [before, from] = [shown(&before[begin..]), shown(&from[..end])];
    let width = left.len() + before.chars().count();
    format!("\n    {left}{before}{from}{right}\n    {:width$}^", "")
}

/// Decodes every key and value, and forgets it: that finds the errors within them.
struct Decoder<'a>(Source<'a>);

impl<'a> Decoder<'a> {
    fn raw(&self, span: Span, encoding: Option<Encoding>) -> Raw<'a> {
        let text = self.0.input().get(span.start()..span.end()).unwrap_or_default();
        Raw::new_unchecked(text, encoding, span)
    }
}

impl EventReceiver for Decoder<'_> {
    fn simple_key(&mut self, span: Span, encoding: Option<Encoding>, error: &mut dyn ErrorSink) {
        self.raw(span, encoding).decode_key(&mut (), error);
    }

    fn scalar(&mut self, span: Span, encoding: Option<Encoding>, error: &mut dyn ErrorSink) {
        let _ = self.raw(span, encoding).decode_scalar(&mut (), error);
    }

    fn comment(&mut self, span: Span, error: &mut dyn ErrorSink) {
        self.raw(span, None).decode_comment(error);
    }

    fn newline(&mut self, span: Span, error: &mut dyn ErrorSink) {
        self.raw(span, None).decode_newline(error);
    }
}
