//! The lines of a parameter file, of either form: `NAME VALUE` with any blank or a comma between, or the five columns
//! vehicle, component, name, value, type. A `#` begins a comment. Parameters that nobody asks for are passed over.

use isotherm_shared::document::{Fault, Faults};
use std::collections::HashMap;

/// Limit of reported lines that are no parameters: a file of another kind has one on every line.
const MAX_LINE_FAULTS: usize = 8;

/// MAVLink's type of a float32, in the fifth column.
const FLOAT: &str = "9";

/// One parameter of the file.
struct Entry<'a> {
    line: usize,
    value: &'a str,
    kind: Option<&'a str>,
    /// The line of a second one with this name.
    again: Option<usize>,
}

/// The parameters of a file, and what has been found wrong with them.
pub(crate) struct Lines<'a> {
    entries: HashMap<&'a str, Entry<'a>>,
    faults: Vec<Fault>,
}

impl<'a> Lines<'a> {
    pub(crate) fn parse(text: &'a str) -> Self {
        let mut lines = Self { entries: HashMap::new(), faults: Vec::new() };
        let mut more = 0;
        for (text, line) in text.trim_start_matches('\u{feff}').lines().zip(1..) {
            let content = text.split('#').next().unwrap_or_default();
            let fields: Vec<&str> =
                content.split(|c: char| c.is_whitespace() || c == ',').filter(|field| !field.is_empty()).collect();
            let (name, value, kind) = match fields[..] {
                [] => continue,
                [name, value] if !name.starts_with('@') => (name, value, None),
                [_, _, name, value, kind] => (name, value, Some(kind)),
                _ if lines.faults.len() == MAX_LINE_FAULTS => {
                    more += 1;
                    continue;
                }
                _ => {
                    lines.fault(line, "", "is no parameter; give NAME VALUE, or the five columns of a .params file");
                    continue;
                }
            };
            let entry = lines.entries.entry(name).or_insert(Entry { line, value, kind, again: None });
            if entry.line != line && entry.again.is_none() {
                entry.again = Some(line);
            }
        }
        if let (1.., Some(last)) = (more, lines.faults.last().map(|fault| fault.line)) {
            lines.fault(last, "", format!("and {more} lines more like this"));
        }
        lines
    }

    fn fault(&mut self, line: usize, key: &str, message: impl Into<String>) {
        self.faults.push(Fault { line, key: key.to_owned(), message: message.into() });
    }

    /// A fault in the line of a parameter; in the first line if there is none.
    pub(crate) fn wrong(&mut self, name: &str, message: impl Into<String>) {
        let line = self.line(name).unwrap_or(1);
        self.fault(line, name, message);
    }

    /// The line of a parameter.
    pub(crate) fn line(&self, name: &str) -> Option<usize> {
        self.entries.get(name).map(|entry| entry.line)
    }

    /// Whether there is a parameter whose name begins so.
    pub(crate) fn any(&self, prefix: &str) -> bool {
        self.entries.keys().any(|name| name.starts_with(prefix))
    }

    /// The value of a parameter that need not be there.
    fn value(&mut self, name: &str, whole: bool) -> Option<f32> {
        let &Entry { line, value, kind, again } = self.entries.get(name)?;
        if let Some(again) = again {
            self.fault(again, name, format!("stands in line {line} too; leave one out"));
        }
        if kind.is_some_and(|kind| (kind == FLOAT) == whole) {
            let wanted = if whole { "a whole number, such as 6" } else { "9, a float32" };
            self.fault(line, name, format!("has the type {:?}; give {wanted}", kind.unwrap_or_default()));
            return None;
        }
        // As a ground station reads it: a double, which the autopilot then has as a float32.
        let number = value.parse::<f64>().ok().map(|number| number as f32).filter(|number| number.is_finite());
        let number = number.filter(|number| !whole || number.fract() == 0.0);
        if number.is_none() {
            let wanted = if whole { "a whole number" } else { "a finite number" };
            self.fault(line, name, format!("is {value:?}, give {wanted}"));
        }
        number
    }

    /// A whole number that need not be there.
    pub(crate) fn whole(&mut self, name: &str) -> Option<f32> {
        self.value(name, true)
    }

    /// A number that must be there. `beside` is a parameter in whose line its absence is reported.
    pub(crate) fn number(&mut self, name: &str, beside: &str) -> Option<f32> {
        if self.entries.contains_key(name) {
            return self.value(name, false);
        }
        let line = self.line(beside).unwrap_or(1);
        self.fault(line, name, "missing; give it, also if it is 0");
        None
    }

    /// Three numbers that must be there.
    pub(crate) fn three(&mut self, names: [String; 3], beside: &str) -> Option<[f32; 3]> {
        // All are read, so that all faults are found.
        match names.map(|name| self.number(&name, beside)) {
            [Some(x), Some(y), Some(z)] => Some([x, y, z]),
            _ => None,
        }
    }

    /// A lower and a higher temperature that must be there.
    pub(crate) fn range(&mut self, low: &str, high: &str, beside: &str) -> Option<[f32; 2]> {
        let [lowest, highest] = [low, high].map(|name| self.number(name, beside));
        let range = [lowest?, highest?];
        if range[0] < range[1] {
            return Some(range);
        }
        self.wrong(high, format!("is {}, which is not over {low}, {}; give a range", range[1], range[0]));
        None
    }

    /// A range that has been read; its faults have been reported.
    pub(crate) fn known_range(&self, low: &str, high: &str) -> Option<[f32; 2]> {
        let number = |name| self.entries.get(name)?.value.parse::<f64>().ok().map(|number| number as f32);
        Some([number(low)?, number(high)?])
    }

    /// What was read, if nothing is wrong.
    pub(crate) fn finish<T>(mut self, value: Option<T>) -> Result<T, Faults> {
        self.faults.sort_by_key(|fault| fault.line);
        match value {
            Some(value) if self.faults.is_empty() => Ok(value),
            _ => Err(Faults(self.faults)),
        }
    }
}
