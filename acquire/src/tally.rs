//! What has been counted.

use crate::link::LinkCounts;
use isotherm_client::{boot, monotonic_ns, unix_s};
use serde::Serialize;
use std::fmt;

/// Why bytes are no frame, or a line is no row.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Cause {
    /// No frame begins here.
    Noise,
    /// The length that a frame states is impossible, or a line is too long.
    Length,
    /// A checksum is wrong.
    Checksum,
    /// No frame follows, and there is no checksum.
    Unconfirmed,
    /// The checksum is right, but the items do not fill the frame or have other lengths.
    Items,
    /// A line has other columns than those described, or no numbers in them.
    Columns,
    /// The stream ended inside.
    Cut,
}

/// Bytes that were no frame, by cause; and what began and was not right.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq, Serialize)]
pub struct SkippedBytes {
    /// Bytes where no frame begins.
    pub noise: u64,
    /// Bytes of frames or lines whose length is impossible.
    pub length: u64,
    /// Bytes of frames or lines whose checksum is wrong.
    pub checksum: u64,
    /// Bytes of frames without checksum that no other frame follows.
    pub unconfirmed: u64,
    /// Bytes of frames whose items are not as described.
    pub items: u64,
    /// Bytes of lines whose columns are not as described.
    pub columns: u64,
    /// Bytes of what a stream ended inside of.
    pub cut: u64,
    /// Places where a frame or line began that was not right.
    pub damaged: u64,
    /// Frames whose checksum is right and whose items are not as described.
    pub unread: u64,
}

impl SkippedBytes {
    /// Counts bytes.
    pub fn add(&mut self, cause: Cause, bytes: u64) {
        let count = match cause {
            Cause::Noise => &mut self.noise,
            Cause::Length => &mut self.length,
            Cause::Checksum => &mut self.checksum,
            Cause::Unconfirmed => &mut self.unconfirmed,
            Cause::Items => &mut self.items,
            Cause::Columns => &mut self.columns,
            Cause::Cut => &mut self.cut,
        };
        *count += bytes;
    }

    /// All bytes.
    #[must_use]
    pub const fn bytes(&self) -> u64 {
        self.noise + self.length + self.checksum + self.unconfirmed + self.items + self.columns + self.cut
    }

    /// What was counted since `before`, as a text: empty, or the bytes by cause in brackets.
    pub(crate) fn since(&self, before: &Self) -> String {
        let both = self.causes().into_iter().zip(before.causes());
        let new = both.map(|((cause, now), (_, then))| (cause, now - then)).filter(|(_, bytes)| *bytes > 0);
        let new: Vec<_> = new.map(|(cause, bytes)| format!("{cause} {bytes}")).collect();
        if new.is_empty() { String::new() } else { format!(" ({})", new.join(", ")) }
    }

    /// The bytes by cause, with the names of the causes.
    #[must_use]
    pub const fn causes(&self) -> [(&'static str, u64); 7] {
        [
            ("noise", self.noise),
            ("length", self.length),
            ("checksum", self.checksum),
            ("unconfirmed", self.unconfirmed),
            ("items", self.items),
            ("columns", self.columns),
            ("cut", self.cut),
        ]
    }
}

/// What an acquisition from a device has counted since it began.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Tally {
    /// The IMU.
    pub imu: String,
    /// How long it has run \[s\].
    pub seconds: f64,
    /// Bytes received.
    pub bytes: u64,
    /// Frames, lines or scans received whole.
    pub frames: u64,
    /// Samples made of them.
    pub samples: u64,
    /// Samples of a device whose status is not healthy: their temperature is NaN.
    pub unhealthy: u64,
    /// Samples whose temperature is stale: they are computed, and flagged.
    pub stale: u64,
    /// Samples that are invalid since the device's rate is another one: their temperature is NaN. Before the IMU's
    /// first sample, frames that are not used while the rate seems to be another one.
    pub other_rate: u64,
    /// Times that another rate than the described one was taken for the device's.
    pub adopted: u64,
    /// The interval that was taken for the device's \[ns\]; 0 while it is the described one.
    pub adopted_interval_ns: u64,
    /// Frames with the number of the frame before, and datagrams that came after a later one.
    pub repeated: u64,
    /// Frames of items without those of the sensors: other messages of the device.
    pub others: u64,
    /// Frames without all columns of the sensors, or with one that is not finite.
    pub incomplete: u64,
    /// Frames before the first temperature.
    pub without_temperature: u64,
    /// Frames with a number of more pulses than a sample can have.
    pub out_of_range: u64,
    /// Gaps: places where control periods are missing.
    pub gaps: u64,
    /// Control periods that are missing in gaps.
    pub missing: u64,
    /// Gaps whose number of turns of the counter is not certain.
    pub ambiguous: u64,
    /// Sessions: the first, and one more each time the device started again or was away for over a turn of its counter.
    pub sessions: u64,
    /// Times that the device went away.
    pub outages: u64,
    /// Scans of two devices that found no partner.
    pub unpaired: u64,
    /// Datagrams of others than the peer.
    pub strangers: u64,
    /// Whether the device is there.
    pub is_there: bool,
    /// When the last frame was seen, within half a second \[s since 1970\]; 0 before the first.
    pub last_frame_s: f64,
    /// Frames a second over the last seconds \[Hz\].
    pub rate_hz: f64,
    /// How much the measured interval is over the one that is taken for the device's \[ppm\].
    pub deviation_ppm: f64,
    /// Bytes that were no frame.
    pub skipped: SkippedBytes,
    /// The serial number that the device has sent, if the description has one to compare it with.
    pub device: String,
    /// Whether the device is another one than the description's now.
    pub is_other: bool,
    /// Samples of another device than the description's.
    pub other_device: u64,
    /// How many of these were held, and not sent.
    pub held: u64,
    /// Questions and settings that the device has not answered as described.
    pub unanswered: u64,
    /// Times that the device said that it was just powered.
    pub power_ups: u64,
    /// What became of the samples.
    pub service: LinkCounts,
    /// Rows that were recorded and are lasting.
    pub recorded: u64,
    /// Rows that could not be recorded.
    pub not_recorded: u64,
}

/// How the rate is to the described one, by how much the interval is over the nominal one.
pub(crate) fn of_described(deviation: f64) -> String {
    let ratio = 1.0 / (1.0 + deviation);
    match ratio - 1.0 {
        over if over.abs() < 0.01 => format!("{:+.0} ppm of the described rate", over * 1e6),
        _ => format!("{ratio:.3} times the described rate"),
    }
}

/// A tally as the exporter of metrics reads it.
#[derive(Serialize)]
struct TallyDocument<'a> {
    /// When it was written, in Unix time \[s\].
    written_unix_s: f64,
    /// The same on `CLOCK_MONOTONIC` \[ns\], and the machine's start: how old the tally is.
    written_ns: u64,
    boot: u64,
    /// The interval that was taken for the device's \[s\]; 0 while it is the described one.
    adopted_interval_s: f64,
    #[serde(flatten)]
    tally: &'a Tally,
}

impl Tally {
    /// What the exporter of metrics reads.
    pub(crate) fn document(&self) -> impl Serialize {
        let adopted_interval_s = self.adopted_interval_ns as f64 / 1e9;
        let (written_unix_s, written_ns, boot) = (unix_s(), monotonic_ns(), boot());
        TallyDocument { written_unix_s, written_ns, boot, adopted_interval_s, tally: self }
    }
}

impl fmt::Display for Tally {
    /// One line; counts of 0 for faults are left out.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} frames in {:.1} s, {} samples", self.imu, self.frames, self.seconds, self.samples)?;
        if self.rate_hz > 0.0 {
            write!(f, ", {:.2} Hz ({})", self.rate_hz, of_described(self.deviation_ppm / 1e6))?;
        }
        if self.adopted_interval_ns > 0 {
            let hz = 1e9 / self.adopted_interval_ns as f64;
            write!(f, ", at {hz:.2} Hz instead of the described rate")?;
        }
        write!(f, "; {} missing in {} gaps", self.missing, self.gaps)?;
        if self.ambiguous > 0 {
            write!(f, ", {} of uncertain length", self.ambiguous)?;
        }
        let faults = [
            (self.unhealthy, "unhealthy"),
            (self.stale, "with a stale temperature"),
            (self.other_rate, "invalid for their rate"),
            (self.repeated, "repeated"),
            (self.others, "other messages"),
            (self.incomplete, "incomplete"),
            (self.without_temperature, "without temperature"),
            (self.out_of_range, "out of range"),
            (self.unpaired, "scans without partner"),
            (self.skipped.damaged, "damaged"),
            (self.skipped.unread, "with unknown items"),
            (self.other_device, "of another device"),
            (self.held, "held"),
            (self.unanswered, "unanswered questions"),
            (self.outages, "outages"),
            (self.strangers, "datagrams of others"),
            (self.sessions.saturating_sub(1), "new sessions"),
            (self.service.dropped, "dropped"),
            (self.service.unanswered, "not answered"),
            (self.service.invalid, "answered as invalid"),
            (self.not_recorded, "not recorded"),
        ];
        for (count, name) in faults.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, ", {count} {name}")?;
        }
        if self.skipped.bytes() > 0 {
            let causes = self.skipped.causes().into_iter().filter(|(_, bytes)| *bytes > 0);
            let causes: Vec<_> = causes.map(|(cause, bytes)| format!("{cause} {bytes}")).collect();
            write!(f, "; {} of {} bytes are no frame ({})", self.skipped.bytes(), self.bytes, causes.join(", "))?;
        }
        if self.service.connections > 0 {
            write!(f, "; {} sent, {} answered", self.service.sent, self.service.answered)?;
        }
        Ok(())
    }
}
