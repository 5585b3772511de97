//! Strict reading of TOML files: unknown keys are faults, and all faults of a file are reported together.
//!
//! A [`Document`] hands out [`Section`]s. A key that is missing, has the wrong type or is never asked for becomes a
//! [`Fault`] with line and key, and reading goes on. Coefficient tables, service configurations and campaign files are
//! read this way.

mod faults;
mod syntax;

pub use faults::{Fault, Faults};
pub use syntax::MAX_TOKENS;

use crate::content::FileContent;
use crate::names::{ImuId, NAME_RULE};
use core::cell::{Cell, RefCell};
use core::ops::Range;
use isotherm_support::failure::one_line;
use syntax::Lines;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Largest file that is read: 1 MiB. A coefficient table is smaller:
/// [`MAX_TABLE_BYTES`](crate::table::MAX_TABLE_BYTES).
pub const MAX_BYTES: u64 = 1 << 20;

/// Limit of collected faults: a file can have a hundred thousand.
const MAX_FAULTS: usize = 100;

/// A parsed TOML file that collects faults while it is read.
pub struct Document<'a> {
    lines: Lines,
    root: Spanned<DeTable<'a>>,
    faults: RefCell<Vec<Fault>>,
    /// Faults that are only counted.
    more: Cell<usize>,
}

impl<'a> Document<'a> {
    /// Parses `text`.
    ///
    /// # Errors
    /// All syntax errors that the parser finds, duplicate keys included.
    pub fn parse(text: &'a str) -> Result<Self, Faults> {
        let lines = Lines::of(text);
        let root = syntax::parse(text, &lines)?;
        Ok(Self { lines, root, faults: RefCell::default(), more: Cell::default() })
    }

    /// As [`parse`](Self::parse), with one clear fault if `text` is CSV or of another known kind. `wanted` says what to
    /// give instead, for example "give the coefficient table".
    ///
    /// # Errors
    /// As [`parse`](Self::parse).
    pub fn parse_as(text: &'a str, wanted: &str) -> Result<Self, Faults> {
        other_instead(text.as_bytes(), text, wanted).map_or_else(|| Self::parse(text), Err)
    }

    /// The top level.
    pub fn root(&self) -> Section<'_, 'a> {
        Section { document: self, table: self.root.get_ref(), path: String::new(), line: 1, asked: RefCell::default() }
    }

    /// Whether the top level has `key`; distinguishes kinds of files.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        self.root.get_ref().contains_key(key)
    }

    /// Whether `key` of the top level is an array of tables (`[[key]]`).
    #[must_use]
    pub fn is_list(&self, key: &str) -> bool {
        self.root.get_ref().get(key).is_some_and(|value| value.get_ref().is_array())
    }

    /// Adds a fault at `line`. What keys and values of the file have in them makes no further line of it.
    pub fn fault(&self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        let mut faults = self.faults.borrow_mut();
        if faults.len() < MAX_FAULTS {
            let [key, message] = [key.into(), message.into()].map(|text| one_line(&text).into_owned());
            faults.push(Fault { line, key, message });
        } else {
            self.more.update(|more| more + 1);
        }
    }

    /// Returns `value` if reading found no fault.
    ///
    /// # Errors
    /// All faults, in the order of their lines.
    pub fn finish<T>(self, value: Option<T>) -> Result<T, Faults> {
        let mut faults = self.faults.into_inner();
        faults.sort_by_key(|fault| fault.line);
        if let (more @ 1.., Some(last)) = (self.more.get(), faults.last()) {
            faults.push(Fault { line: last.line, key: String::new(), message: format!("and {more} faults more") });
        }
        match value {
            Some(value) if faults.is_empty() => Ok(value),
            _ => Err(Faults(faults)),
        }
    }

    /// Byte range of the value of a top-level key in the text, for replacing it.
    #[must_use]
    pub fn span(&self, key: &str) -> Option<Range<usize>> {
        self.root.get_ref().get(key).map(Spanned::span)
    }

    fn line(&self, span: &Range<usize>) -> usize {
        self.lines.at(span.start)
    }
}

/// One table of a [`Document`]. [`finish`](Self::finish) reports every key that was never asked for.
pub struct Section<'d, 'a> {
    document: &'d Document<'a>,
    table: &'d DeTable<'a>,
    path: String,
    line: usize,
    asked: RefCell<Vec<&'static str>>,
}

impl<'d, 'a> Section<'d, 'a> {
    /// Line where the section begins.
    #[must_use]
    pub const fn line(&self) -> usize {
        self.line
    }

    /// Full path of one of its keys.
    #[must_use]
    pub fn key(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Changes the section's path in later messages, for example from `axis.1` to `axis.A1`.
    pub fn rename(&mut self, path: impl Into<String>) {
        self.path = path.into();
    }

    /// Reports `message` about `key`: at the key's line if it is present, otherwise at the section's.
    pub fn fault(&self, key: &str, message: impl Into<String>) {
        let line = self.table.get(key).map_or(self.line, |value| self.document.line(&value.span()));
        let key = if key.is_empty() { self.path.clone() } else { self.key(key) };
        self.document.fault(line, key, message);
    }

    /// As [`fault`](Self::fault) if `message` is `Some`; otherwise does nothing.
    pub fn refuse(&self, key: &str, message: Option<String>) {
        if let Some(message) = message {
            self.fault(key, message);
        }
    }

    /// As [`fault`](Self::fault) if it `is_wrong`.
    pub fn fault_if(&self, is_wrong: bool, key: &str, message: &str) {
        if is_wrong {
            self.fault(key, message);
        }
    }

    /// Reports `message` about each of `keys` that is present.
    pub fn forbid(&self, keys: &[&str], message: &str) {
        keys.iter().for_each(|key| self.fault_if(self.has(key), key, message));
    }

    /// Whether `key` is present, with a value of any type.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        self.table.get(key).is_some()
    }

    /// Whether `key` is `"?"`, or a text or a list of texts that begin with it: a value that is to be filled in.
    #[must_use]
    pub fn is_open(&self, key: &str) -> bool {
        let is_open = |value: &DeValue<'_>| value.as_str().is_some_and(|text| text.starts_with('?'));
        self.table.get(key).is_some_and(|value| match value.get_ref().as_array() {
            Some(list) => list.iter().any(|item| is_open(item.get_ref())),
            None => is_open(value.get_ref()),
        })
    }

    fn get(&self, key: &'static str) -> Option<&'d Spanned<DeValue<'a>>> {
        self.asked.borrow_mut().push(key);
        self.table.get(key)
    }

    fn required<T>(&self, key: &'static str, value: Option<T>, expected: &str) -> Option<T> {
        if value.is_none() && !self.has(key) {
            self.fault(key, format!("missing; give {expected}"));
        }
        value
    }

    fn wrong(&self, key: &str, value: &DeValue<'_>, expected: &str) {
        self.fault(key, format!("is {}, give {expected}", describe(value)));
    }

    /// A finite number; an integer is accepted too.
    pub fn optional_number(&self, key: &'static str) -> Option<f64> {
        let value = self.get(key)?.get_ref();
        let number = number_of(value);
        if number.is_none() {
            self.wrong(key, value, "a finite number");
        }
        number
    }

    /// A number over 0, which may be `inf`.
    pub fn optional_limit(&self, key: &'static str) -> Option<f64> {
        let value = self.get(key)?.get_ref();
        let number = match value {
            DeValue::Float(float) => float.as_str().parse().ok(),
            _ => number_of(value),
        };
        let number = number.filter(|number| *number > 0.0);
        if number.is_none() {
            self.wrong(key, value, "a number over 0, or inf");
        }
        number
    }

    /// A finite number, required; `expected` says in messages what to give.
    pub fn number(&self, key: &'static str, expected: &str) -> Option<f64> {
        let number = self.optional_number(key);
        self.required(key, number, expected)
    }

    /// A whole number from `range`.
    pub fn optional_integer(&self, key: &'static str, range: core::ops::RangeInclusive<i64>) -> Option<i64> {
        let value = self.get(key)?.get_ref();
        let integer = integer_of(value).filter(|integer| range.contains(integer));
        if integer.is_none() {
            self.wrong(key, value, &format!("a whole number from {} to {}", range.start(), range.end()));
        }
        integer
    }

    /// A whole number from `range`, required; `expected` says in messages what to give.
    pub fn integer(&self, key: &'static str, range: core::ops::RangeInclusive<i64>, expected: &str) -> Option<i64> {
        let integer = self.optional_integer(key, range);
        self.required(key, integer, expected)
    }

    /// A whole number from `range`, or a list of them.
    pub fn optional_integers(&self, key: &'static str, range: core::ops::RangeInclusive<i64>) -> Option<Vec<i64>> {
        let value = self.get(key)?.get_ref();
        let integers = match value.as_array() {
            Some(list) => list.iter().map(|item| integer_of(item.get_ref())).collect(),
            None => integer_of(value).map(|integer| vec![integer]),
        };
        let integers = integers.filter(|integers| integers.iter().all(|integer| range.contains(integer)));
        if integers.is_none() {
            let expected = format!("a whole number from {} to {}, or a list of them", range.start(), range.end());
            self.wrong(key, value, &expected);
        }
        integers
    }

    /// A whole number from `range`, or a list of them, required; `expected` says in messages what to give.
    pub fn integers(
        &self,
        key: &'static str,
        range: core::ops::RangeInclusive<i64>,
        expected: &str,
    ) -> Option<Vec<i64>> {
        let integers = self.optional_integers(key, range);
        self.required(key, integers, expected)
    }

    /// Bytes: those of a string, or a list of whole numbers from 0 to 255.
    pub fn optional_bytes(&self, key: &'static str) -> Option<Vec<u8>> {
        let value = self.get(key)?.get_ref();
        let byte = |item: &Spanned<DeValue<'_>>| integer_of(item.get_ref()).and_then(|byte| u8::try_from(byte).ok());
        let bytes = match value.as_array() {
            Some(list) => list.iter().map(byte).collect(),
            None => value.as_str().map(|text| text.as_bytes().to_vec()),
        };
        if bytes.is_none() {
            self.wrong(key, value, "a string in quotation marks, or a list of bytes from 0 to 255");
        }
        bytes
    }

    /// `true` or `false`.
    pub fn optional_bool(&self, key: &'static str) -> Option<bool> {
        let value = self.get(key)?.get_ref();
        if value.as_bool().is_none() {
            self.wrong(key, value, "true or false");
        }
        value.as_bool()
    }

    /// A string.
    pub fn optional_string(&self, key: &'static str) -> Option<&'d str> {
        let value = self.get(key)?.get_ref();
        if value.as_str().is_none() {
            self.wrong(key, value, "a string in quotation marks");
        }
        value.as_str()
    }

    /// A string, required; `expected` says in messages what to give.
    pub fn string(&self, key: &'static str, expected: &str) -> Option<&'d str> {
        let string = self.optional_string(key);
        self.required(key, string, expected)
    }

    /// A string or a non-empty list of strings, required; no string may be empty. `expected` says in messages what to
    /// give.
    pub fn strings(&self, key: &'static str, expected: &str) -> Option<Vec<&'d str>> {
        let strings = self.get(key).and_then(|value| {
            let strings: Option<Vec<_>> = match value.get_ref().as_array() {
                Some(list) => list.iter().map(|item| item.get_ref().as_str()).collect(),
                None => value.get_ref().as_str().map(|string| vec![string]),
            };
            let strings = strings.filter(|strings| !strings.is_empty() && strings.iter().all(|text| !text.is_empty()));
            if strings.is_none() {
                self.wrong(key, value.get_ref(), expected);
            }
            strings
        });
        self.required(key, strings, expected)
    }

    /// The name of an IMU, required.
    pub fn imu_id(&self, key: &'static str) -> Option<ImuId> {
        let name = self.string(key, &format!("the IMU's name, {NAME_RULE}"))?;
        let id = ImuId::new(name);
        self.refuse(key, id.is_none().then(|| format!("is {name:?}, give {NAME_RULE}")));
        id
    }

    /// One of the named values.
    pub fn optional_choice<T: Copy>(&self, key: &'static str, choices: &[(T, &str)]) -> Option<T> {
        let name = self.optional_string(key)?;
        let choice = choices.iter().find(|(_, n)| *n == name).map(|(value, _)| *value);
        if choice.is_none() {
            let names: Vec<_> = choices.iter().map(|(_, name)| format!("\"{name}\"")).collect();
            self.fault(key, format!("is \"{name}\", give {}", names.join(" or ")));
        }
        choice
    }

    /// One of the named values, required.
    pub fn choice<T: Copy>(&self, key: &'static str, choices: &[(T, &str)]) -> Option<T> {
        let choice = self.optional_choice(key, choices);
        let names: Vec<_> = choices.iter().map(|(_, name)| format!("\"{name}\"")).collect();
        self.required(key, choice, &names.join(" or "))
    }

    /// A list of finite numbers, required; `expected` says in messages what to give. The caller checks the count.
    pub fn numbers(&self, key: &'static str, expected: &str) -> Option<Vec<f64>> {
        let numbers = self.get(key).and_then(|value| {
            let list = numbers_of(value.get_ref());
            if list.is_none() {
                self.wrong(key, value.get_ref(), expected);
            }
            list
        });
        self.required(key, numbers, expected)
    }

    /// A list of lists of finite numbers, required.
    pub fn matrix(&self, key: &'static str, expected: &str) -> Option<Vec<Vec<f64>>> {
        let rows = self.get(key).and_then(|value| {
            let rows = value
                .get_ref()
                .as_array()
                .and_then(|rows| rows.iter().map(|row| numbers_of(row.get_ref())).collect::<Option<Vec<_>>>());
            if rows.is_none() {
                self.wrong(key, value.get_ref(), expected);
            }
            rows
        });
        self.required(key, rows, expected)
    }

    /// A sub-table, `[key]` or `key = { ... }`.
    pub fn optional_section(&self, key: &'static str) -> Option<Section<'d, 'a>> {
        let value = self.get(key)?;
        let Some(table) = value.get_ref().as_table() else {
            self.wrong(key, value.get_ref(), &format!("a section [{}]", self.key(key)));
            return None;
        };
        Some(Section {
            document: self.document,
            table,
            path: self.key(key),
            line: self.document.line(&value.span()),
            asked: RefCell::default(),
        })
    }

    /// A sub-table, required.
    pub fn section(&self, key: &'static str, expected: &str) -> Option<Section<'d, 'a>> {
        let section = self.optional_section(key);
        self.required(key, section, expected)
    }

    /// The tables of `[[key]]`; none if it is missing.
    pub fn list(&self, key: &'static str) -> Vec<Section<'d, 'a>> {
        let Some(value) = self.get(key) else { return Vec::new() };
        let tables = value.get_ref().as_array().and_then(|array| {
            let tables = array.iter().map(|item| Some((item.get_ref().as_table()?, item.span())));
            tables.collect::<Option<Vec<_>>>()
        });
        let Some(tables) = tables else {
            self.wrong(key, value.get_ref(), &format!("sections [[{}]]", self.key(key)));
            return Vec::new();
        };
        let section = |(index, (table, span)): (usize, (&'d DeTable<'a>, Range<usize>))| Section {
            document: self.document,
            table,
            path: format!("{}.{}", self.key(key), index + 1),
            line: self.document.line(&span),
            asked: RefCell::default(),
        };
        tables.into_iter().enumerate().map(section).collect()
    }

    /// Accepts `key` with any value, or its absence.
    pub fn ignore(&self, key: &'static str) {
        self.asked.borrow_mut().push(key);
    }

    /// Accepts `key` with any value, or its absence. If it is a section, its values can be looked at.
    pub fn unchecked(&self, key: &'static str) -> Option<LenientSection<'d, 'a>> {
        self.get(key)?.get_ref().as_table().map(LenientSection)
    }

    /// Reports every key that was never asked for.
    pub fn finish(self) {
        let mut asked = Vec::new();
        for key in self.asked.take() {
            if !asked.contains(&key) {
                asked.push(key);
            }
        }
        for (key, _) in self.table {
            if asked.contains(&key.get_ref().as_ref()) {
                continue;
            }
            if self.document.faults.borrow().len() >= MAX_FAULTS {
                self.document.more.update(|more| more + 1);
            } else {
                let name = key.get_ref();
                let path = if self.path.is_empty() { name.to_string() } else { format!("{}.{name}", self.path) };
                let message = format!("unknown key; known here: {}", asked.join(", "));
                self.document.fault(self.document.line(&key.span()), path, message);
            }
        }
    }
}

/// A section that nobody checks: a value that is not of the wanted kind is as good as absent.
#[derive(Clone, Copy)]
pub struct LenientSection<'d, 'a>(&'d DeTable<'a>);

impl<'d, 'a> LenientSection<'d, 'a> {
    /// Whether it has only this key.
    pub fn has_only(self, key: &str) -> bool {
        self.0.keys().all(|found| found.get_ref() == key)
    }

    /// A section in it.
    pub fn section(self, key: &str) -> Option<Self> {
        self.0.get(key)?.get_ref().as_table().map(Self)
    }

    /// The sections of an array; none if it is none. What is no section in it is left out.
    pub fn list(self, key: &str) -> Vec<LenientSection<'d, 'a>> {
        let all = self.0.get(key).and_then(|value| value.get_ref().as_array());
        all.into_iter().flatten().filter_map(|item| item.get_ref().as_table()).map(Self).collect()
    }

    /// Whether the value is `true`.
    pub fn is_true(self, key: &str) -> bool {
        self.0.get(key).and_then(|value| value.get_ref().as_bool()) == Some(true)
    }

    /// Whether the key is there, with any value.
    pub fn has(self, key: &str) -> bool {
        self.0.contains_key(key)
    }

    /// Whether the value is this text.
    pub fn is_text(self, key: &str, text: &str) -> bool {
        self.0.get(key).and_then(|value| value.get_ref().as_str()) == Some(text)
    }

    /// A finite number.
    pub fn number(self, key: &str) -> Option<f64> {
        number_of(self.0.get(key)?.get_ref())
    }

    /// A list of finite numbers.
    pub fn numbers(self, key: &str) -> Option<Vec<f64>> {
        numbers_of(self.0.get(key)?.get_ref())
    }

    /// A list of lists of finite numbers.
    pub fn matrix(self, key: &str) -> Option<Vec<Vec<f64>>> {
        self.0.get(key)?.get_ref().as_array()?.iter().map(|row| numbers_of(row.get_ref())).collect()
    }
}

fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) if text.len() <= 40 => format!("the string {text:?}"),
        DeValue::Integer(integer) => format!("the integer {}", integer.as_str()),
        DeValue::Float(float) => format!("the number {}", float.as_str()),
        other => format!("of type {}", other.type_str()),
    }
}

fn integer_of(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn number_of(value: &DeValue<'_>) -> Option<f64> {
    let number = match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(_) => integer_of(value).map(|integer| integer as f64),
        _ => None,
    };
    number.filter(|number: &f64| number.is_finite())
}

fn numbers_of(value: &DeValue<'_>) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(|item| number_of(item.get_ref())).collect()
}

/// The fault of a file that begins so and is no TOML but something else that is known.
fn other_instead(begin: &[u8], text: &str, wanted: &str) -> Option<Faults> {
    let message = match FileContent::of(begin) {
        Some(content) => format!("this is {}, not TOML; {wanted}; {}", content.name(), content.readers("FILE")),
        None if is_csv(text) => format!("this is CSV data, not TOML; {wanted}"),
        None => return None,
    };
    Some(Faults(vec![Fault { line: 1, key: String::new(), message }]))
}

/// The fault of a text that begins with these bytes and has over `limit`, the most that a file of this `kind` has, for
/// example "coefficient table".
#[must_use]
pub fn too_large(begin: &[u8], limit: u64, kind: &str) -> Faults {
    const HEADER: usize = 64 << 10;
    let begin = begin.get(..HEADER).unwrap_or(begin);
    if let Some(faults) = other_instead(begin, &String::from_utf8_lossy(begin), &format!("give the {kind}")) {
        return faults;
    }
    let message = format!("over {limit} bytes; no {kind} is that large");
    Faults(vec![Fault { line: 1, key: String::new(), message }])
}

/// Whether a text is CSV with a header row: names separated by commas, semicolons or tabs, and a next row with as many
/// values. Comments may stand above. Such a first line is never TOML.
fn is_csv(text: &str) -> bool {
    [',', ';', '\t'].into_iter().any(|separator| is_separated(text, separator))
}

fn is_separated(text: &str, separator: char) -> bool {
    let is_row = |line: &&str| !line.trim_start().is_empty() && !line.starts_with('#');
    let mut lines = text.trim_start_matches('\u{feff}').lines().filter(is_row);
    let name = |field: &str| {
        let field = field.trim().trim_matches('"');
        !field.is_empty() && field.chars().all(|c| c.is_alphanumeric() || "_-. []/".contains(c))
    };
    let Some(header) = lines.next() else { return false };
    let count = |line: &str| line.split(separator).count();
    count(header) > 1 && header.split(separator).all(name) && lines.next().is_none_or(|row| count(row) == count(header))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_wrong_is_reported_with_line_and_key() {
        let text = "a = 1\nb = \"x\"\nnumber = \"y\"\n[s]\nlist = [1, \"2\"]\nextra = 3\nnan = nan\n";
        let document = Document::parse(text).unwrap();
        let root = document.root();
        assert_eq!(root.number("a", "a number"), Some(1.0));
        assert_eq!(root.string("b", "a string"), Some("x"));
        assert_eq!(root.number("number", "a number"), None);
        assert_eq!(root.number("absent", "the answer"), None);
        let section = root.section("s", "a section").unwrap();
        assert_eq!(section.numbers("list", "numbers"), None);
        assert_eq!(section.optional_number("nan"), None);
        section.finish();
        root.finish();
        let faults = document.finish(Some(())).unwrap_err();
        assert_eq!(
            faults.to_string(),
            "line 1: absent: missing; give the answer\n\
             line 3: number: is the string \"y\", give a finite number\n\
             line 5: s.list: is of type array, give numbers\n\
             line 6: s.extra: unknown key; known here: list, nan\n\
             line 7: s.nan: is the number nan, give a finite number"
        );
    }

    #[test]
    fn syntax_errors_have_lines_too() {
        let faults = Document::parse("a = 1\nb = = 2\na = 3\n").err().unwrap();
        assert_eq!(faults.0.iter().map(|fault| fault.line).collect::<Vec<_>>(), [2, 3], "{faults}");
        let unknown: String = (0..5000).map(|n| format!("k{n} = 1\n")).collect();
        let document = Document::parse(&unknown).unwrap();
        document.root().finish();
        let faults = document.finish(Some(())).unwrap_err().0;
        assert_eq!((faults.len(), faults[MAX_FAULTS].message.as_str()), (MAX_FAULTS + 1, "and 4900 faults more"));
        let faults = Document::parse(&"no toml\n".repeat(1000)).err().unwrap();
        assert_eq!((faults.0.len(), faults.0[8].message.as_str()), (9, "and 992 lines more like this"));
    }

    #[test]
    fn a_syntax_error_shows_its_place() {
        let faults = |text: &str| Document::parse(text).err().unwrap().to_string();
        assert_eq!(
            faults("gravity = 9.8O15\n"),
            "line 1: not TOML: invalid float, expected nothing\n    gravity = 9.8O15\n                 ^"
        );
        // Of a long line, what stands around the place; what steers a terminal is escaped, and a tab is one space.
        let long = format!("{}\t\u{1b}[2J = = 1 # {}", "k".repeat(100), "c".repeat(100));
        let [k, c] = ["k".repeat(39), "c".repeat(27)];
        assert_eq!(
            faults(&long),
            format!(
                "line 1: not TOML: key with no value, expected `=`\n    ...{k} \\u{{1b}}[2J = = 1 # {c}...\n{}^",
                " ".repeat(47)
            )
        );
        // Of an empty line nothing, and behind the end of a line too.
        assert!(faults("a = \"\"\"\n").ends_with("line 2: not TOML: invalid multi-line basic string, expected `\"`"));
        assert!(faults("a = {").ends_with("expected `}`\n    a = {\n         ^"));
        assert!(faults("a = 1\na = 3\n").ends_with("duplicate key\n    a = 3\n    ^"));
    }

    #[test]
    fn errors_that_are_found_out_of_order_are_sorted_and_counted() {
        // What does not end is found at the end, and about its beginning.
        for text in
            ["x = 1O\na = [\n1,\n2", "a = [\n1,\n2", "[a\n[b\n[c", "a = 1\n= 2\na = 3", "\"\"\"\n\n\n", "é\né\r\n="]
        {
            let faults = Document::parse(text).err().unwrap().0;
            let lines: Vec<_> = faults.iter().map(|fault| fault.line).collect();
            assert!(lines.is_sorted() && lines.iter().all(|line| *line <= text.lines().count() + 1), "{faults:?}");
            assert!(faults.iter().all(|fault| !fault.message.contains("more like this")), "{faults:?}");
        }
    }

    #[test]
    fn the_first_look_refuses_exactly_what_the_crate_refuses() {
        const MARKS: &[u8] = b"ab=[]{}\"'#.,\n 1-_\\\r\t\x01";
        let mut state = 1_u64;
        let mut next = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        let mut right = 0;
        for _ in 0..50_000 {
            let text: String = (0..next(24)).map(|_| char::from(MARKS[next(MARKS.len())])).collect();
            let wrong = DeTable::parse(&text).is_err();
            right += usize::from(!wrong);
            assert_eq!(Document::parse(&text).is_err(), wrong, "{text:?}");
        }
        assert!(right > 1000, "{right}");
    }

    #[test]
    fn the_last_of_very_many_sections_knows_its_line() {
        let text = "[[s]]\n".repeat(MAX_TOKENS / 6);
        let document = Document::parse(&text).unwrap();
        let sections = document.root().list("s");
        assert_eq!(sections.last().unwrap().line(), sections.len());
    }

    #[test]
    fn a_recording_is_recognised_where_toml_is_wanted() {
        for text in
            ["a,b\n1,2\n", "\u{feff}\"set_point_c\",a1_head\r\n-25,1.5\r\n", "a,b,c\n", "a;b\n1,5;2\n", "a\tb\n1\t2\n"]
        {
            let faults = Document::parse_as(text, "give the table").err().unwrap();
            assert_eq!(faults.to_string(), "line 1: this is CSV data, not TOML; give the table", "{text}");
        }
        let faults = Document::parse_as("# of an afternoon\n\na,b\n1,2\n", "give the table").err().unwrap();
        assert_eq!(faults.to_string(), "line 1: this is CSV data, not TOML; give the table");
        for text in ["a = [1, 2\nb = 3\n", "x, y = 1\n", "", "name\nvalue\n", "a,b\n1\n", "key = \"a,b\nc,d\n"] {
            let faults = Document::parse_as(text, "give the table").err();
            assert!(faults.is_none_or(|faults| !faults.to_string().contains("CSV")), "{text}");
        }
    }
}
