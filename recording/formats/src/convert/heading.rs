//! What the name of a column says that it is.

use super::unit::{Quantity, UnitWord, of_temperature, parts, without_brackets};
use isotherm_shared::wire::AXES;

/// Parts of names that are about a sensor, and no readings of it.
const BESIDE: [&str; 9] = ["temp", "std", "var", "cov", "bias", "clip", "err", "mag", "user"];

/// The name of a column.
#[derive(Clone, Debug, Default)]
pub(super) struct ColumnHeading {
    /// The name as the text has it.
    pub(super) name: String,
    /// Its parts in lower case, with what is in brackets.
    parts: Vec<String>,
    /// Its parts without brackets.
    base: Vec<String>,
    /// An index in brackets at its end.
    index: Option<usize>,
}

impl ColumnHeading {
    pub(super) fn new(name: &str) -> Self {
        let base = without_brackets(name);
        let index = base.trim_end().strip_suffix(']').and_then(|rest| rest.rsplit_once('['));
        let index = index.and_then(|(_, digits)| digits.parse().ok()).filter(|index| *index < AXES);
        Self { name: name.to_owned(), parts: parts(name), base: parts(&base), index }
    }

    fn has(&self, names: &[&str]) -> bool {
        self.parts.iter().any(|part| names.contains(&part.as_str()))
    }

    fn begins(&self, beginnings: &[&str]) -> bool {
        self.base.iter().any(|part| beginnings.iter().any(|beginning| part.starts_with(beginning)))
    }

    pub(super) fn is_time(&self) -> bool {
        let is_named = self.begins(&["time", "stamp", "second", "millis", "micros", "nanos"])
            || self.has(&["sec", "secs", "tow"])
            || matches!(&self.parts[..], [only] if ["s", "ms", "us", "ns"].contains(&only.as_str()));
        // A unit such as deg/sec is none of times.
        is_named && self.accelerometer().is_none() && self.gyroscope().is_none()
    }

    /// Whether it is named t, which is the time of a text that has no other one.
    pub(super) fn is_t(&self) -> bool {
        self.name.starts_with('t') && self.base.iter().any(|part| part == "t") && of_temperature(&self.name).is_none()
    }

    pub(super) fn is_temperature(&self) -> bool {
        let name = self.name.to_lowercase();
        let ends = ["degc", "degf", "celsius", "fahrenheit"].iter().any(|unit| name.trim_end().ends_with(unit));
        self.begins(&["temp"])
            || self.has(&["degc", "celsius"])
            || ends
            || self.base.first().is_some_and(|part| part == "t")
    }

    /// Whether it is named as the temperature of something else than the IMU.
    pub(super) fn is_of_another(&self) -> bool {
        self.begins(&["baro", "press", "mag", "cpu", "mcu", "ambient", "batt", "esc", "gps", "humid"])
    }

    /// Whether it is named as the temperature of these sensors.
    pub(super) fn is_of(&self, quantity: Quantity) -> bool {
        self.begins(match quantity {
            Quantity::Acceleration => &["acc"],
            Quantity::Rate => &["gyr"],
        })
    }

    /// The axis, from 0, if the name is that of an accelerometer.
    pub(super) fn accelerometer(&self) -> Option<usize> {
        let named = || self.begins(&["acc", "linear", "specific"]).then(|| self.axis())?;
        let short = || self.letter().filter(|_| self.base[0] == "a");
        self.reading(self.one_of(["ax", "ay", "az"]).or_else(named).or_else(short), Quantity::Acceleration)
    }

    /// The axis, from 0, if the name is that of a gyroscope.
    pub(super) fn gyroscope(&self) -> Option<usize> {
        let named = || self.begins(&["gyr", "omega", "angular", "rate", "angvel"]).then(|| self.axis())?;
        let is_axis = |part: &String| ["x", "y", "z"].contains(&part.as_str());
        let is_rate = |_: &usize| self.base[0] == "w" || self.base[0] == "g" && self.base.get(1).is_some_and(is_axis);
        let short = || self.letter().filter(is_rate);
        let found = self.one_of(["gx", "gy", "gz"]).or_else(|| self.one_of(["wx", "wy", "wz"]));
        let found = self.reading(found.or_else(named).or_else(short), Quantity::Rate);
        found.filter(|_| self.accelerometer().is_none())
    }

    /// The axis, unless the name is about something else of the sensor, or has a unit of the other quantity.
    fn reading(&self, axis: Option<usize>, quantity: Quantity) -> Option<usize> {
        let is_other = matches!(quantity.said(&self.name), UnitWord::Unknown(text) if quantity.is_other(&text));
        axis.filter(|_| !self.begins(&BESIDE) && !is_other)
    }

    /// The axis that a part of a name of several parts is.
    fn letter(&self) -> Option<usize> {
        ["x", "y", "z"].iter().position(|name| self.base.iter().skip(1).any(|part| part == name))
    }

    fn one_of(&self, names: [&str; AXES]) -> Option<usize> {
        names.iter().position(|name| self.base.iter().any(|part| part == name))
    }

    /// The axis that a part of the name is, or that its last part ends with, or an index.
    fn axis(&self) -> Option<usize> {
        let is = |names: [&str; AXES]| names.iter().position(|name| self.base.iter().any(|part| part == name));
        let ends = || {
            let last = self.base.last()?;
            ["x", "y", "z"].iter().position(|name| last.ends_with(name))
        };
        self.index.or_else(|| is(["x", "y", "z"])).or_else(|| is(["1", "2", "3"])).or_else(ends)
    }
}
