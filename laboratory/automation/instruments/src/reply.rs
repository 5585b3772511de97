//! What drivers and lines share about replies: where a reply ends, what is wrong with it, and its text.

use super::fault::FaultKind;
use std::io;
use std::time::Duration;

/// Messages show at most this much of a reply \[bytes\].
const SHOWN: usize = 100;

/// Why an exchange failed: kind and message, without the instrument's name, which the line adds.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) struct ExchangeError(pub FaultKind, pub String);

impl ExchangeError {
    /// A reply that is damaged, or does not belong to the request.
    pub(crate) fn garbled(reply: &[u8]) -> Self {
        Self(FaultKind::Garbled, format!("a reply that makes no sense: {}", quoted(reply)))
    }

    /// A reply by which the instrument refuses the request.
    pub(crate) fn refused(reply: &str) -> Self {
        Self(FaultKind::Refused, format!("refused, {}", quoted(reply.trim().as_bytes())))
    }

    /// A port that cannot be opened or used.
    pub(super) fn line(phase: &str, error: &io::Error) -> Self {
        Self(FaultKind::Line, format!("{phase}: {error}"))
    }
}

/// A reply in quotation marks, without what is beyond [`SHOWN`].
fn quoted(reply: &[u8]) -> String {
    match reply.get(..SHOWN).filter(|_| reply.len() > SHOWN) {
        Some(begin) => format!("\"{}\".. ({} bytes)", begin.escape_ascii(), reply.len()),
        None => format!("\"{}\"", reply.escape_ascii()),
    }
}

/// How the end of a reply is found.
#[derive(Clone, Copy)]
pub(crate) struct Framing<'a> {
    /// Length of the reply at the beginning of these bytes, or `None` while it is incomplete.
    pub reply_length: &'a dyn Fn(&[u8]) -> Option<usize>,
    /// A pause of this length ends a reply too.
    pub gap: Option<Duration>,
}

/// Length of a reply that ends with a line feed.
pub(crate) fn line_feed(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == b'\n').map(|end| end + 1)
}

/// Length of a reply that ends with a carriage return.
pub(crate) fn carriage_return(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == b'\r').map(|end| end + 1)
}

/// The text of a reply without blanks around it. A reply with other bytes than printable ASCII is garbled.
pub(crate) fn text(reply: &[u8]) -> Result<&str, ExchangeError> {
    let trimmed = reply.trim_ascii();
    let printable = trimmed.iter().all(|&byte| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t'));
    let text = core::str::from_utf8(trimmed).ok().filter(|_| printable);
    text.ok_or_else(|| ExchangeError::garbled(reply))
}

/// Parses a finite number.
pub(crate) fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

/// An angle, and the value of its last digit: 0.001 for `12.345`.
pub(crate) fn angle(text: &str) -> Option<(f64, f64)> {
    let angle = number(text)?;
    let (mantissa, exponent) = text.trim().split_once(['e', 'E']).unwrap_or((text.trim(), "0"));
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len()) as i32;
    let exponent: i32 = exponent.parse().unwrap_or_default();
    Some((angle, 10_f64.powi(exponent.saturating_sub(decimals))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_has_the_value_of_its_last_digit() {
        for (text, expected) in [
            ("12.345", Some((12.345, 1e-3))),
            (" -0.00010 ", Some((-1e-4, 1e-5))),
            ("359", Some((359.0, 1.0))),
            ("3.5901E+02", Some((359.01, 1e-2))),
            ("OK", None),
        ] {
            let close = |(a, b): (f64, f64), (c, d): (f64, f64)| a == c && (b / d - 1.0).abs() < 1e-12;
            let found = angle(text);
            assert!(found == expected || found.zip(expected).is_some_and(|(a, b)| close(a, b)), "{text}: {found:?}");
        }
    }
}
