//! The part of a recording that is read: `--from` and `--to`.

use crate::convert::{Conversion, time_ns};
use core::fmt;
use isotherm_recording::{CampaignRow, RecordingError};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::Path;
use std::str::FromStr;

/// From this number of seconds on, 30 years, a time since the begin is rather a time stamp.
const MOST_S: f64 = 1e9;
/// For the rounding of times that are typed \[ns\].
const TOLERANCE_NS: f64 = 1.0;

/// A time in a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RecordingTime {
    /// Time since the first row of the recording begins \[s\]: its time stamp less its interval.
    Seconds(f64),
    /// A time stamp, as the rows have it \[ns\].
    Stamp(u64),
}

/// A number of seconds; a time stamp as `12500000000ns`; or a time as ISO 8601 has it, for rows whose stamps count from
/// 1970 or from midnight.
impl FromStr for RecordingTime {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(stamp) = text.strip_suffix("ns") {
            return stamp.trim_end().parse().map(Self::Stamp).map_err(|_| EXPECTED.to_owned());
        }
        match text.parse::<f64>() {
            Ok(seconds) if (0.0..MOST_S).contains(&seconds) => Ok(Self::Seconds(seconds)),
            Ok(_) => Err(EXPECTED.to_owned()),
            Err(_) => time_ns(text).map(|(ns, _)| Self::Stamp(ns)).ok_or_else(|| EXPECTED.to_owned()),
        }
    }
}

/// What a moment must be, for messages.
const EXPECTED: &str = "give seconds since the begin of the recording, from 0 and under 1e9, or a time stamp, as \
                        12500000000ns or 2026-05-01T12:34:56Z";

/// `600 s`, `12500000000ns`.
impl fmt::Display for RecordingTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Seconds(seconds) => write!(f, "{seconds} s"),
            Self::Stamp(ns) => write!(f, "{ns}ns"),
        }
    }
}

/// The part of a recording that is read; all of it by default.
///
/// With seconds, the rows that begin and end within it; with time stamps, those whose stamps are within it, both ends
/// included. Reading ends at the first row after it: what comes later is neither read nor judged.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Part {
    from: Option<RecordingTime>,
    to: Option<RecordingTime>,
}

impl Part {
    /// The part between two moments; `None` where there is no limit.
    ///
    /// ```
    /// use isotherm_recording_formats::read::{RecordingTime, Part};
    ///
    /// # fn main() -> Result<(), String> {
    /// let part = Part::new(Some("600".parse()?), Some(RecordingTime::Seconds(1200.0)))?;
    /// assert_eq!(part.to_string(), "from 600 s to 1200 s");
    /// assert!(Part::new(Some("600".parse()?), Some(RecordingTime::Seconds(600.0))).is_err());
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If the first is not before the second, as far as they can be compared.
    pub fn new(from: Option<RecordingTime>, to: Option<RecordingTime>) -> Result<Self, String> {
        let ordered = match (from, to) {
            (Some(RecordingTime::Seconds(from)), Some(RecordingTime::Seconds(to))) => from < to,
            (Some(RecordingTime::Stamp(from)), Some(RecordingTime::Stamp(to))) => from < to,
            _ => true,
        };
        if ordered { Ok(Self { from, to }) } else { Err(format!("{} is not before {}", told(from), told(to))) }
    }

    /// Whether it is all of a recording.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.from.is_none() && self.to.is_none()
    }

    /// What provenances have of it; `None` of all of a recording.
    #[must_use]
    pub fn told(&self) -> Option<String> {
        (!self.is_whole()).then(|| self.to_string())
    }

    /// The rows of this part, of foreign data.
    #[must_use]
    pub fn of_conversion(self, conversion: Conversion) -> ConversionPart {
        ConversionPart { conversion, clip: Clip::new(self), ended: false }
    }

    /// The rows of this part, of rows that are in memory. Messages call them `name`.
    pub fn of_rows<'a>(
        self,
        name: &'a str,
        rows: impl Iterator<Item = Result<CampaignRow, RecordingError>> + 'a,
    ) -> impl Iterator<Item = Result<CampaignRow, RecordingError>> + 'a {
        let (mut clip, mut rows, mut ended) = (Clip::new(self), rows, false);
        core::iter::from_fn(move || {
            while !ended {
                match rows.next() {
                    Some(Ok(row)) => match clip.judge(&row.sample) {
                        RowPlace::Before => {}
                        RowPlace::Within => return Some(Ok(row)),
                        RowPlace::After => ended = true,
                    },
                    Some(Err(error)) => return Some(Err(error)),
                    None => ended = true,
                }
                if ended && let Err(failure) = clip.check(Path::new(name)) {
                    return Some(Err(RecordingError::Piece(failure)));
                }
            }
            None
        })
    }
}

/// `from 600 s to 1200 s`.
impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.from, self.to) {
            (Some(from), Some(to)) => write!(f, "from {from} to {to}"),
            (Some(from), None) => write!(f, "from {from} on"),
            (None, Some(to)) => write!(f, "up to {to}"),
            (None, None) => f.write_str("all"),
        }
    }
}

/// The rows of a part of foreign data: an iterator that ends at the first error.
pub struct ConversionPart {
    conversion: Conversion,
    clip: Clip,
    ended: bool,
}

impl ConversionPart {
    /// The conversion, for what it reports after its last row.
    #[must_use]
    pub const fn conversion(&self) -> &Conversion {
        &self.conversion
    }

    /// What the operator should know, a line each. Valid after the last row.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        self.conversion.notes().into_iter().chain(self.clip.note()).collect()
    }

    fn advance(&mut self) -> Result<Option<RawSample>, Failure> {
        loop {
            let row = self.conversion.next_row().map_err(|error| self.conversion.failure(&error))?;
            match row.map(|(_, sample)| (sample, self.clip.judge(&sample))) {
                Some((_, RowPlace::Before)) => {}
                Some((sample, RowPlace::Within)) => {
                    self.conversion.keep(&sample);
                    return Ok(Some(sample));
                }
                Some((_, RowPlace::After)) | None => {
                    return self.clip.check(self.conversion.path()).map(|()| None);
                }
            }
        }
    }
}

impl Iterator for ConversionPart {
    type Item = Result<RawSample, Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = self.advance().transpose();
        self.ended = !matches!(item, Some(Ok(_)));
        item
    }
}

/// A moment that is there.
fn told(moment: Option<RecordingTime>) -> String {
    moment.map_or_else(String::new, |moment| moment.to_string())
}

/// Where a row lies.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum RowPlace {
    Before,
    Within,
    /// It and all further rows are left out.
    After,
}

/// Judges the rows of a recording in their order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Clip {
    part: Part,
    /// When the first row begins, which may be before 0, and the last stamp so far \[ns\].
    span_ns: Option<[i128; 2]>,
    before: u64,
    within: u64,
    /// From the begin of the recording to that of the first row within \[s\].
    offset_s: f64,
}

impl Clip {
    pub(crate) fn new(part: Part) -> Self {
        Self { part, ..Self::default() }
    }

    pub(crate) fn judge(&mut self, sample: &RawSample) -> RowPlace {
        self.judge_times(sample.timestamp_ns, sample.interval_ns)
    }

    /// Judges a row with this stamp, which counts over the interval before it.
    pub(crate) fn judge_times(&mut self, stamp_ns: u64, interval_ns: u64) -> RowPlace {
        let (ends_ns, begins_ns) = (i128::from(stamp_ns), i128::from(stamp_ns) - i128::from(interval_ns));
        let [begin_ns, last_ns] = self.span_ns.get_or_insert([begins_ns, ends_ns]);
        *last_ns = ends_ns;
        let since_ns = |ns: i128| (ns - *begin_ns) as f64;
        let is_before = self.part.from.is_some_and(|from| match from {
            RecordingTime::Seconds(seconds) => since_ns(begins_ns) < seconds * 1e9 - TOLERANCE_NS,
            RecordingTime::Stamp(from_ns) => stamp_ns < from_ns,
        });
        let is_after = self.part.to.is_some_and(|to| match to {
            RecordingTime::Seconds(seconds) => since_ns(ends_ns) > seconds * 1e9 + TOLERANCE_NS,
            RecordingTime::Stamp(to_ns) => stamp_ns > to_ns,
        });
        let offset_s = since_ns(begins_ns) / 1e9;
        if is_after {
            return RowPlace::After;
        }
        if is_before {
            self.before += 1;
            return RowPlace::Before;
        }
        if self.within == 0 {
            self.offset_s = offset_s;
        }
        self.within += 1;
        RowPlace::Within
    }

    /// Rows before the part, and seconds from the begin of the recording to its first row.
    pub(crate) const fn left_out(&self) -> (u64, f64) {
        (self.before, self.offset_s)
    }

    /// What the operator should know of rows that were left out. Valid after the last row.
    pub(crate) fn note(&self) -> Option<String> {
        let Self { within, offset_s, part, .. } = self;
        (!part.is_whole()).then(|| {
            format!(
                "{within} rows are read, {part} of the recording; the first begins after {offset_s} s, and further \
                 times count from there"
            )
        })
    }

    /// To be called after the last row.
    ///
    /// # Errors
    /// If no row is within the part, and there are rows.
    pub(crate) fn check(&self, path: &Path) -> Result<(), Failure> {
        let Some([begin_ns, last_ns]) = self.span_ns.filter(|_| self.within == 0) else { return Ok(()) };
        let seconds = (last_ns - begin_ns) as f64 / 1e9;
        let message = format!(
            "{}: no row {}; its rows are from {begin_ns}ns to {last_ns}ns, over {seconds} s; give a part of it",
            shown(path),
            self.part
        );
        Err(Failure::new(Exit::Data, message).at(path, None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps \[s\] that a part leaves, of 10 rows of 0.1 s from 5.1 s on, whose digits are not exact in binary.
    fn left(from: Option<&str>, to: Option<&str>) -> Vec<u64> {
        let moment = |text: Option<&str>| text.map(|text| text.parse().unwrap());
        let mut clip = Clip::new(Part::new(moment(from), moment(to)).unwrap());
        let stamps = (51..61).map(|tenth| tenth * 100_000_000);
        let judged = stamps.map(|stamp| (stamp, clip.judge_times(stamp, 100_000_000)));
        let kept = judged.take_while(|(_, judged)| *judged != RowPlace::After);
        kept.filter(|(_, judged)| *judged == RowPlace::Within).map(|(stamp, _)| stamp / 100_000_000).collect()
    }

    #[test]
    fn rows_begin_and_end_within_seconds_and_have_stamps_within_stamps() {
        assert_eq!(left(None, None).len(), 10);
        assert_eq!(left(Some("0.3"), Some("0.7")), [54, 55, 56, 57]);
        assert_eq!(left(Some("0.31"), Some("0.69")), [55, 56]);
        assert_eq!(left(Some("5400000000ns"), Some("5700000000ns")), [54, 55, 56, 57]);
        assert_eq!(left(Some("00:00:05.9"), None), [59, 60]);
        assert_eq!(left(Some("0.8"), Some("1970-01-01T00:00:05.9Z")), [59]);
        assert!(left(Some("1"), None).is_empty() && left(None, Some("0.05")).is_empty());
    }

    #[test]
    fn what_is_no_moment_is_refused() {
        for wrong in ["", "-1", "nan", "inf", "1e9", "1.5ns", "ns", "600s", "yesterday"] {
            assert!(wrong.parse::<RecordingTime>().is_err_and(|message| message.contains("seconds")), "{wrong}");
        }
        let stamp = |ns| Some(RecordingTime::Stamp(ns));
        assert!(Part::new(stamp(5), stamp(5)).is_err() && Part::new(stamp(5), stamp(6)).is_ok());
    }

    #[test]
    fn a_part_without_rows_says_what_there_is() {
        let mut clip = Clip::new(Part::new(Some(RecordingTime::Seconds(7.0)), None).unwrap());
        assert!(clip.check(Path::new("r.csv")).is_ok());
        clip.judge_times(5_100_000_000, 100_000_000);
        let failure = clip.check(Path::new("r.csv")).unwrap_err();
        assert!(
            failure
                .message
                .starts_with("r.csv: no row from 7 s on; its rows are from 5000000000ns to 5100000000ns, over 0.1 s")
        );
    }
}
