//! A DataFlash log as lines of JSON: `mavlogdump.py --format json LOG.bin`.
//!
//! Source: pymavlink, tools/mavlogdump.py. A message is a line, `{"meta": {"type": "IMU", "timestamp": 1.7e9}, "data":
//! {"TimeUS": 20000, "I": 0, "GyrX": 0.01, ..}}`. Numbers that are none are `NaN`, which is no JSON.

use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// Lines of other programs, before the first message.
const ABOVE: usize = 20;

/// A message.
#[derive(Deserialize)]
pub struct JsonMessage {
    meta: Meta,
    data: BTreeMap<String, Value>,
}

#[derive(Deserialize)]
struct Meta {
    #[serde(rename = "type")]
    name: String,
}

/// The first message of data that begin with these bytes, if they are such a log.
pub fn first_message(beginning: &[u8]) -> Option<JsonMessage> {
    let lines = beginning.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii).take(ABOVE);
    lines.filter(|line| line.starts_with(b"{")).find_map(JsonMessage::read)
}

impl JsonMessage {
    /// That of a line.
    pub fn read(line: &[u8]) -> Option<Self> {
        let line = str::from_utf8(line).ok()?;
        match serde_json::from_str(line) {
            Ok(message) => Some(message),
            Err(_) if line.contains("NaN") || line.contains("Infinity") => {
                let numbers = line.replace("-Infinity", "null").replace("Infinity", "null").replace("NaN", "null");
                serde_json::from_str(&numbers).ok()
            }
            Err(_) => None,
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.meta.name
    }

    /// The names of its values, in the order of the alphabet.
    pub(super) fn columns(&self) -> impl Iterator<Item = &str> {
        self.data.keys().map(String::as_str)
    }

    /// As a line of a log as text, with these columns.
    pub(super) fn line<'a>(&self, columns: impl Iterator<Item = &'a str>) -> String {
        let value = |column| match self.data.get(column) {
            Some(Value::Number(number)) => number.to_string(),
            Some(Value::String(text)) => text.clone(),
            Some(Value::Null) => "nan".to_owned(),
            _ => String::new(),
        };
        std::iter::once(self.meta.name.clone()).chain(columns.map(value)).collect::<Vec<_>>().join(",")
    }
}
