//! The keys that every instrument's section has: its line, and keys that several drivers have.

use isotherm_serial::{Parity, Serial};
use isotherm_shared::document::Section;
use std::time::Duration;

/// Checked settings of a line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineConfig {
    /// `/dev/ttyUSB0` or `tcp://host:port`.
    pub port: String,
    /// Rate \[Bd\].
    pub baud: u32,
    /// Data bits of a character, 7 or 8.
    pub data_bits: u8,
    /// Parity bit of a character.
    pub parity: Parity,
    /// Stop bits of a character, 1 or 2.
    pub stop_bits: u8,
    /// Longest wait for a reply, and for a TCP connection.
    pub timeout: Duration,
    /// How long the line must be quiet before the next request, after a reply was missing or garbled.
    pub quiet: Duration,
    /// Shortest silence before a request.
    pub pause: Duration,
    /// How often a request without a valid reply is repeated.
    pub retries: u32,
}

impl LineConfig {
    /// The serial line, if the port is one.
    pub(super) fn serial(&self) -> Serial {
        let &Self { ref port, baud, data_bits, parity, stop_bits, .. } = self;
        Serial { path: port.into(), baud, data_bits, parity, stop_bits }
    }

    /// How long so many bytes take on a serial line, with start, parity and stop bits.
    pub(super) fn transmission(&self, bytes: usize) -> Duration {
        Duration::from_secs_f64(bytes as f64 * self.serial().character_s())
    }

    /// Reads the keys. Defaults: `baud`, 8N1, a time-out of 1 s, `quiet_s` as long as the time-out, `pause_s`, 2
    /// retries.
    pub(super) fn read(section: &Section<'_, '_>, baud: i64, pause_s: f64) -> Option<Self> {
        let port = section.string("port", "a device as \"/dev/ttyUSB0\", or \"tcp://host:port\"").and_then(|port| {
            let address = port.strip_prefix("tcp://");
            let number = |address: &str| address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
            let right = !port.is_empty() && address.is_none_or(|address| number(address).is_some());
            let wrong =
                (!right).then(|| format!("is {port:?}, give a device as \"/dev/ttyUSB0\", or \"tcp://host:port\""));
            section.refuse("port", wrong);
            right.then(|| port.to_owned())
        });
        let baud = section.optional_integer("baud", 50..=4_000_000).unwrap_or(baud) as u32;
        let data_bits = section.optional_integer("data_bits", 7..=8).unwrap_or(8) as u8;
        let parity = section.optional_choice("parity", &Parity::NAMES).unwrap_or(Parity::None);
        let stop_bits = section.optional_integer("stop_bits", 1..=2).unwrap_or(1) as u8;
        let timeout = seconds(section, "timeout_s", 1.0, 60.0);
        let quiet = seconds(section, "quiet_s", timeout.as_secs_f64(), 60.0);
        let pause = seconds(section, "pause_s", pause_s, 10.0);
        let retries = section.optional_integer("retries", 0..=10).unwrap_or(2) as u32;
        section.fault_if(timeout.is_zero(), "timeout_s", "is 0, give how long a reply may take");
        Some(Self { port: port?, baud, data_bits, parity, stop_bits, timeout, quiet, pause, retries })
    }
}

/// Reads a number of seconds from 0 to `most`.
pub(super) fn seconds(section: &Section<'_, '_>, key: &'static str, default: f64, limit: f64) -> Duration {
    let given = section.optional_number(key);
    let right = given.filter(|seconds| (0.0..=limit).contains(seconds));
    let wrong = given.filter(|_| right.is_none());
    section.refuse(key, wrong.map(|seconds| format!("is {seconds:?}, give seconds from 0 to {limit:?}")));
    Duration::from_secs_f64(right.unwrap_or(default))
}

/// Reads the numbers of the outer and the inner axis.
pub(super) fn axes(section: &Section<'_, '_>) -> [u8; 2] {
    let Some(axes) = section.optional_integers("axes", 0..=99) else { return [1, 2] };
    match axes[..] {
        [outer, inner] if outer != inner => [outer as u8, inner as u8],
        _ => {
            section.fault("axes", "give the numbers of the outer and the inner axis, as [1, 2]");
            [1, 2]
        }
    }
}

/// Reads a driver's settings from a text.
#[cfg(test)]
pub(super) fn settings_of<S>(toml: &str, read: impl Fn(&Section<'_, '_>) -> S) -> S {
    let document = isotherm_shared::document::Document::parse(toml).unwrap();
    let settings = read(&document.root());
    document.finish(Some(settings)).unwrap()
}
