//! What was used of a recording, what was left out, and why.

use super::bins::{Bins, Stretch};
use crate::screen::{BadKind, BadRows};
use crate::transients::{RampRecording, clock};
use core::ops::Range;
use isotherm_support::finding::{Finding, Severity, name};

/// Times that a message reports of a kind.
const TOLD: usize = 3;
/// Bad rows within this time are reported together \[ns\].
const TOGETHER_NS: u64 = 3_000_000_000;

/// Why a part of a recording is left out.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum LeftOutCause {
    /// The vehicle was armed or flew, as its log says.
    InUse,
    /// The IMU moved.
    Motion,
    /// The thermometer stood still while the biases went on.
    Thermometer,
    /// The IMU was at rest, but for too short a time or over too small a span of temperature.
    TooShort,
}

impl LeftOutCause {
    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::InUse => "the vehicle was armed or flew",
            Self::Motion => "the IMU moved",
            Self::Thermometer => "the thermometer stood still",
            Self::TooShort => "at rest, but too short",
        }
    }
}

/// A part of a recording that is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOutPart {
    /// Why.
    pub cause: LeftOutCause,
    /// Begin and end, since the recording began \[s\].
    pub age_s: [f64; 2],
}

/// What was used of the rows of one recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RowAccount {
    /// Name of the recording.
    pub recording: String,
    /// When the recording began \[ns\].
    pub begin_ns: u64,
    /// Rows that are used.
    pub rows: usize,
    /// Begin and end of each stretch that is used, since the recording began \[s\].
    pub used_s: Vec<[f64; 2]>,
    /// Bumps, after which the attitude is another one: when, since the recording began \[s\], and by how much \[rad\].
    pub bumps: Vec<[f64; 2]>,
    /// Parts that are left out, in order of time.
    pub left_out: Vec<LeftOutPart>,
    /// Bad rows in what is used. They are left out.
    pub bad: BadRows,
}

impl RowAccount {
    pub(super) fn of(
        recording: &RampRecording,
        bins: &Bins,
        causes: &[Option<LeftOutCause>],
        stretches: &[Stretch],
        used: &[&Stretch],
        dense: &[Range<u64>],
    ) -> Self {
        let whole = recording.times_of(&(0..bins.len()));
        let age_s = |ns: u64| ns.saturating_sub(whole.start) as f64 / 1e9;
        let ends = |stretch: &Stretch| {
            let ends = stretch.bins.first().zip(stretch.bins.last());
            ends.map_or(0..0, |(first, last)| recording.times_of(&(*first..last + 1)))
        };
        let mut parts: Vec<Option<LeftOutCause>> = causes.to_vec();
        for stretch in stretches.iter().filter(|it| !used.iter().any(|used| core::ptr::eq(*used, *it))) {
            stretch.bins.iter().for_each(|bin| parts[*bin] = Some(LeftOutCause::TooShort));
        }
        let ranges = used.iter().flat_map(|stretch| stretch.ranges());
        let times: Vec<_> = used.iter().map(|stretch| ends(stretch)).collect();
        let dense_s: Vec<[f64; 2]> = dense.iter().map(|time| [age_s(time.start), age_s(time.end)]).collect();
        let mut left_out = parts_of(&parts, |bins| {
            let times = recording.times_of(&bins);
            [age_s(times.start), age_s(times.end)]
        });
        // The bins of such a time are some of its rows.
        left_out
            .retain(|part| !dense_s.iter().any(|[from, to]| part.age_s[0] >= from - 1.0 && part.age_s[1] <= to + 1.0));
        left_out.extend(dense_s.into_iter().map(|age_s| LeftOutPart { cause: LeftOutCause::Motion, age_s }));
        left_out.sort_by(|a, b| a.age_s[0].total_cmp(&b.age_s[0]));
        let of_bump = |stretch: &Stretch| Some([age_s(ends(stretch).start), stretch.bump_rad?]);
        Self {
            recording: recording.name().to_owned(),
            begin_ns: whole.start,
            rows: ranges.map(|bins| recording.rows_of(&bins)).sum(),
            used_s: times.iter().map(|times| [age_s(times.start), age_s(times.end)]).collect(),
            bumps: stretches.iter().filter_map(of_bump).collect(),
            left_out,
            bad: recording.bad_rows().within(&times).without(dense),
        }
    }

    /// Part of the rows that are bad.
    #[must_use]
    pub fn bad_part(&self) -> f64 {
        self.bad.len() as f64 / (self.rows + self.bad.len()).max(1) as f64
    }

    /// `at 12:31 UTC` or `0:05:10 after its begin`.
    #[must_use]
    pub fn clock(&self, age_s: f64) -> String {
        clock(self.begin_ns + (age_s * 1e9) as u64, age_s)
    }

    /// What a stretch that is used is called.
    pub(super) fn name_of(&self, number: usize) -> String {
        let [from, to] = self.used_s[number].map(duration);
        format!("{} ({from} to {to})", self.recording)
    }

    /// The bad rows by kind, with times.
    #[must_use]
    pub fn bad_words(&self) -> String {
        let of_kind = |(kind, count): (BadKind, usize)| {
            let groups = self.bad_groups_s(kind);
            let time = |[first, last]: &[f64; 2]| match last - first < 1.0 {
                true => duration(*first),
                false => format!("{} to {}", duration(*first), duration(*last)),
            };
            let told: Vec<String> = groups.iter().take(TOLD).map(time).collect();
            let more = if groups.len() > TOLD { " .." } else { "" };
            format!("{} at {}{more}", kind.counted(count), told.join(", "))
        };
        self.bad.counts().into_iter().map(of_kind).collect::<Vec<_>>().join("; ")
    }

    /// First and last time of each group of bad rows of a kind, since the recording began \[s\].
    #[must_use]
    pub fn bad_groups_s(&self, kind: BadKind) -> Vec<[f64; 2]> {
        let age_s = |ns: u64| ns.saturating_sub(self.begin_ns) as f64 / 1e9;
        self.bad.groups(kind, TOGETHER_NS).into_iter().map(|group| group.map(age_s)).collect()
    }

    /// What is left out, with times.
    #[must_use]
    pub fn left_out_words(&self) -> String {
        let part = |part: &LeftOutPart| {
            let [from, to] = part.age_s.map(duration);
            format!("{from} to {to}: {}", part.cause.words())
        };
        let mut words: Vec<String> = self.left_out.iter().take(2 * TOLD).map(part).collect();
        if self.left_out.len() > words.len() {
            words.push(format!("{} more", self.left_out.len() - words.len()));
        }
        words.join(", ")
    }

    /// The findings: what moved, what stood still, and the bad rows, of which `most` are allowed.
    pub(super) fn findings(&self, most: f64) -> Vec<Finding> {
        let of = |message: String| format!("{}: {message}", self.recording);
        let mut findings = Vec::new();
        let has = |cause: LeftOutCause| self.left_out.iter().find(|part| part.cause == cause);
        let moved = has(LeftOutCause::InUse).or_else(|| has(LeftOutCause::Motion)).is_some();
        if (moved || !self.bumps.is_empty()) && !self.used_s.is_empty() {
            let used: Vec<String> =
                self.used_s.iter().map(|[from, to]| format!("{} to {}", duration(*from), duration(*to))).collect();
            let bumps: Vec<String> = self
                .bumps
                .iter()
                .take(TOLD)
                .map(|[age_s, size]| {
                    let size = if *size > 0.0 { format!(" by {:.1} mrad", size * 1e3) } else { String::new() };
                    format!("the IMU was bumped at {}{size}", duration(*age_s))
                })
                .collect();
            let left_out = self.left_out_words();
            let what: Vec<String> = bumps.into_iter().chain((!left_out.is_empty()).then_some(left_out)).collect();
            let each = if used.len() > 1 { ", with a constant each" } else { "" };
            let message = format!("at rest from {}, which is used{each}; {}", used.join(" and "), what.join("; "));
            findings.push(Finding::whole(Severity::Warning, name::MOTION, of(message)));
        }
        if let Some(part) = has(LeftOutCause::Thermometer) {
            let [from, to] = part.age_s.map(duration);
            let message = format!(
                "the thermometer stands still from {from} to {to} while the biases go on: these rows are left out"
            );
            findings.push(Finding::whole(Severity::Warning, name::TEMPERATURE_STUCK, of(message)));
        }
        if !self.bad.is_empty() {
            let part = self.bad_part();
            let is_too_much = part > most;
            let severity = if is_too_much { Severity::Fault } else { Severity::Warning };
            let remedy = match is_too_much {
                true => "; more than 5 % are too many: look at the sensor, its cable and its logger",
                false => "",
            };
            let message = format!(
                "{} of {} rows ({:.2} %) hold values that no sensor measured, and are left out: {}{remedy}",
                self.bad.len(),
                self.rows + self.bad.len(),
                part * 100.0,
                self.bad_words()
            );
            findings.push(Finding::whole(severity, name::BAD_ROWS, of(message)));
        }
        findings
    }

    /// Why nothing can be used.
    pub(super) fn refusal(&self, least: usize) -> String {
        format!(
            "{}: no part of {least} seconds or rows, whichever is longer, is at rest: {}; record the warm-up with the vehicle \
             disarmed, and held fast on firm ground",
            self.recording,
            self.left_out_words()
        )
    }
}

/// Bins in turn of one cause.
fn parts_of(causes: &[Option<LeftOutCause>], age_s: impl Fn(Range<usize>) -> [f64; 2]) -> Vec<LeftOutPart> {
    let mut parts = Vec::new();
    let mut start = 0;
    while start < causes.len() {
        let end = (start..causes.len()).find(|bin| causes[*bin] != causes[start]).unwrap_or(causes.len());
        parts.extend(causes[start].map(|cause| LeftOutPart { cause, age_s: age_s(start..end) }));
        start = end;
    }
    parts
}

/// `0:05:10`.
pub(super) fn duration(age_s: f64) -> String {
    let seconds = age_s.round() as u64;
    format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}
