//! The lines of a parameter file, as ground stations and firmwares write and read them:
//!
//! | line | whose |
//! |---|---|
//! | `NAME VALUE`, `NAME,VALUE`, `NAME=VALUE` | ArduPilot's firmware and MAVProxy; Mission Planner |
//! | `NAME VALUE @READONLY`, `NAME VALUE DEFAULT` | ArduPilot's firmware; a list with defaults |
//! | vehicle, component, name, value, type | QGroundControl |
//! | `x + NAME [3,7] : VALUE` | PX4's command `param show` |
//!
//! A `#` or a `//` begins a comment. What nobody asks for is passed over, also if it is none of these. A line that
//! names a parameter of an IMU and is none of these is a fault.

use isotherm_shared::document::{Fault, Faults};
use std::collections::HashMap;

/// Limit of reported lines that are no parameters: a file of another kind may have many.
const MAX_LINE_FAULTS: usize = 8;

/// MAVLink's type of a float32, in the fifth column.
const FLOAT: &str = "9";

/// The firmware's mark of a parameter that cannot be set.
const READ_ONLY: &str = "@READONLY";

/// How the names begin that concern an IMU.
const OF_IMUS: [&str; 2] = ["TC_", "INS_"];

/// One parameter of the file.
struct ParameterEntry<'a> {
    line: usize,
    value: &'a str,
    kind: Option<&'a str>,
    /// The line of a second one with this name.
    again: Option<usize>,
}

/// The parameters of a file, and what has been found wrong with them.
pub(crate) struct Lines<'a> {
    entries: HashMap<&'a str, ParameterEntry<'a>>,
    /// The line of the first `@include`: parameters may stand in another file.
    include: Option<usize>,
    faults: Vec<Fault>,
}

/// Name, value and type of a line's words.
fn parameter<'a>(words: &[&'a str]) -> Option<(&'a str, &'a str, Option<&'a str>)> {
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    match *words {
        [name, ..] if name.starts_with('@') => None,
        [vehicle, component, name, value, kind] if is_number(vehicle) && is_number(component) => {
            Some((name, value, Some(kind)))
        }
        [name, value] | [name, value, READ_ONLY] => Some((name, value, None)),
        [name, value, default] if is_number(value) && is_number(default) => Some((name, value, None)),
        // The numbers in brackets are where PX4 has it in its lists.
        [.., name, first, last, ":", value] if first.starts_with('[') && last.ends_with(']') => {
            Some((name, value, None))
        }
        _ => None,
    }
}

/// A line without its comment.
fn content(line: &str) -> &str {
    let end = ["#", "//"].iter().filter_map(|mark| line.find(mark)).min();
    &line[..end.unwrap_or(line.len())]
}

/// A number as a ground station reads it: a double, which the autopilot then has as a float32. Whole numbers may be
/// hexadecimal.
fn number(value: &str) -> Option<f32> {
    let digits = value.strip_prefix("0x").or_else(|| value.strip_prefix("0X"));
    let number = match digits {
        Some(digits) => f64::from(u32::from_str_radix(digits, 16).ok()?),
        None => value.parse().ok()?,
    };
    Some(number as f32).filter(|number| number.is_finite())
}

impl<'a> Lines<'a> {
    pub(crate) fn parse(text: &'a str) -> Self {
        let mut lines = Self { entries: HashMap::new(), include: None, faults: Vec::new() };
        let mut more = 0;
        for (text, line) in text.trim_start_matches('\u{feff}').lines().zip(1..) {
            let separates = |c: char| c.is_whitespace() || matches!(c, ',' | '=');
            let words: Vec<&str> = content(text).split(separates).filter(|word| !word.is_empty()).collect();
            let Some((name, value, kind)) = parameter(&words) else {
                if words.first() == Some(&"@include") {
                    lines.include.get_or_insert(line);
                } else if words.iter().any(|word| OF_IMUS.iter().any(|begin| word.starts_with(begin))) {
                    if lines.faults.len() == MAX_LINE_FAULTS {
                        more += 1;
                    } else {
                        lines.fault(
                            line,
                            "",
                            "is not a parameter; give NAME VALUE, or the five columns of a .params file",
                        );
                    }
                }
                continue;
            };
            let entry = lines.entries.entry(name).or_insert(ParameterEntry { line, value, kind, again: None });
            if entry.line != line && entry.again.is_none() {
                entry.again = Some(line);
            }
        }
        if let (1.., Some(last)) = (more, lines.faults.last().map(|fault| fault.line)) {
            lines.fault(last, "", format!("and {more} lines more like this"));
        }
        lines
    }

    /// A sentence where parameters that are missing may stand, if the file includes others.
    pub(crate) fn elsewhere(&self) -> String {
        let include = self.include.map(|line| format!("; line {line} includes another file, which is not read"));
        include.unwrap_or_default()
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
        let &ParameterEntry { line, value, kind, again } = self.entries.get(name)?;
        if let Some(again) = again {
            self.fault(again, name, format!("stands in line {line} too; leave one out"));
        }
        if kind.is_some_and(|kind| (kind == FLOAT) == whole) {
            let wanted = if whole { "a whole number, such as 6" } else { "9, a float32" };
            self.fault(line, name, format!("has the type {:?}; give {wanted}", kind.unwrap_or_default()));
            return None;
        }
        let number = number(value).filter(|number| !whole || number.fract() == 0.0);
        if number.is_none() {
            let wanted = if whole { "a whole number" } else { "a finite number" };
            self.fault(line, name, format!("is {value:?}, give {wanted}"));
        }
        number
    }

    /// A number that need not be there.
    pub(crate) fn factor(&mut self, name: &str) -> Option<f32> {
        self.value(name, false)
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
        self.fault(line, name, format!("missing; give it, also if it is 0{}", self.elsewhere()));
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
        let number = |name| number(self.entries.get(name)?.value);
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
