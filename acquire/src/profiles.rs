//! The profiles that come with the program, and which of them decodes a stream.

use crate::description::{Description, Kind, Port};
use crate::frames::{DecodedFrame, FrameArrival};
use crate::port::{PortRead, open_port, refused};
use crate::stream::StreamDecoder;
use isotherm_client::monotonic_ns;
use isotherm_serial::{Parity, Serial};
use isotherm_support::failure::Failure;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::Serialize;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The profiles: name and text, from `examples/acquire`.
pub const PROFILES: [(&str, &str); 9] = [
    ("adis16505", include_str!("../../examples/acquire/adis16505.toml")),
    ("arduino-mpu6050", include_str!("../../examples/acquire/arduino-mpu6050.toml")),
    ("bmi270", include_str!("../../examples/acquire/bmi270.toml")),
    ("icm42688", include_str!("../../examples/acquire/icm42688.toml")),
    ("kvh1750", include_str!("../../examples/acquire/kvh1750.toml")),
    ("mtdata2", include_str!("../../examples/acquire/mtdata2.toml")),
    ("stim300", include_str!("../../examples/acquire/stim300.toml")),
    ("stim300-rate", include_str!("../../examples/acquire/stim300-rate.toml")),
    ("vn100", include_str!("../../examples/acquire/vn100.toml")),
];

/// Frames after which a stream is decided.
const FRAMES: u64 = 100;
/// How long a line is listened to at one rate.
const LISTEN: Duration = Duration::from_secs(3);

/// What a profile made of a stream.
#[derive(Clone, Debug, Serialize)]
pub struct ProbeResult {
    /// The profile.
    pub profile: String,
    /// Rate of the line \[Bd\]; 0 for a stream that has none.
    pub baud: u32,
    /// Frames that were right.
    pub frames: u64,
    /// Frames that began and were not.
    pub damaged: u64,
    /// Bytes received.
    pub bytes: u64,
    /// Bytes that were in no frame.
    pub skipped: u64,
    /// Frames a second.
    pub rate_hz: f64,
    /// Whether frames have a checksum. Without one they may be right by chance.
    pub has_checksum: bool,
}

impl ProbeResult {
    /// Whether the stream is of this profile: its frames are nearly all bytes.
    #[must_use]
    pub const fn is_it(&self) -> bool {
        self.frames >= 10 && self.skipped * 2 < self.bytes
    }
}

struct Candidate {
    profile: &'static str,
    decoder: StreamDecoder,
    frames: u64,
    first_ns: u64,
    last_ns: u64,
    has_checksum: bool,
}

/// Tries all profiles of streams on a device: a serial line at this rate, or at the rates that the profiles have, or a
/// file of bytes. Returns what each profile made of it, the best first, at the rate that fits best.
///
/// # Errors
/// If the device cannot be opened or read.
pub fn probe(device: &Path, baud: Option<u32>, end: &AtomicBool) -> Result<Vec<ProbeResult>, Failure> {
    let is_file = device.is_file();
    let mut best: Vec<ProbeResult> = Vec::new();
    for baud in baud.map_or_else(|| if is_file { vec![0] } else { rates() }, |baud| vec![baud]) {
        let port = if is_file {
            Port::File { path: device.to_owned(), pace: false }
        } else {
            let (path, parity) = (device.to_owned(), Parity::None);
            Port::Serial(Serial { path, baud, data_bits: 8, parity, stop_bits: 1 })
        };
        let found = listen(&port, baud, end)?;
        let fits = |found: &[ProbeResult]| found.first().map_or(0, |first| first.frames);
        if best.is_empty() || fits(&found) > fits(&best) {
            best = found;
        }
        if best.first().is_some_and(ProbeResult::is_it) || end.load(Ordering::Relaxed) {
            break;
        }
    }
    Ok(best)
}

/// The rates of the profiles, the highest first.
fn rates() -> Vec<u32> {
    let rate = |description: Description| match description.kind {
        Kind::Frames(Port::Serial(serial), _) | Kind::Lines(Port::Serial(serial), _) => Some(serial.baud),
        _ => None,
    };
    let descriptions = PROFILES.iter().filter_map(|(_, text)| Description::from_toml(text).ok());
    let mut rates: Vec<_> = descriptions.filter_map(rate).chain([115_200, 460_800]).collect();
    rates.sort_unstable_by(|a, b| b.cmp(a));
    rates.dedup();
    rates
}

fn candidates() -> Vec<Candidate> {
    let candidate = |(profile, text): &(&'static str, &str)| {
        let description = Description::from_toml(text).ok()?;
        let has_checksum = match &description.kind {
            Kind::Frames(_, frame) => frame.checksum.is_some(),
            Kind::Lines(_, line) => line.checksum,
            Kind::Iio(_) | Kind::Messages(..) => false,
        };
        let decoder = StreamDecoder::new(&description)?;
        Some(Candidate { profile, decoder, frames: 0, first_ns: 0, last_ns: 0, has_checksum })
    };
    PROFILES.iter().filter_map(candidate).collect()
}

fn listen(port: &Port, baud: u32, end: &AtomicBool) -> Result<Vec<ProbeResult>, Failure> {
    let mut open = open_port(port, end)?;
    let mut all = candidates();
    let (mut buffer, mut bytes, began) = (vec![0; 1 << 14], 0, Instant::now());
    while began.elapsed() < LISTEN && !end.load(Ordering::Relaxed) && all.iter().all(|one| one.frames <= FRAMES) {
        let pause = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
        let _ = poll(&mut [PollFd::new(&open, PollFlags::IN)], Some(&pause));
        let count = match open.read(&mut buffer).map_err(|error| refused(port, &error))? {
            PortRead::Bytes(count) => count,
            PortRead::Nothing => continue,
            PortRead::End => break,
        };
        bytes += count as u64;
        let now = monotonic_ns();
        for one in &mut all {
            let (frames, first_ns, last_ns) = (&mut one.frames, &mut one.first_ns, &mut one.last_ns);
            one.decoder.push(&buffer[..count], FrameArrival { after_ns: now, by_ns: now }, &mut |_: DecodedFrame<
                '_,
            >| {
                *first_ns = if *frames == 0 { now } else { *first_ns };
                (*frames, *last_ns) = (*frames + 1, now);
            });
        }
    }
    let mut probed: Vec<_> = all.iter().map(|one| one.probed(baud, bytes)).collect();
    probed.sort_by_key(|one| std::cmp::Reverse((one.frames, one.has_checksum)));
    Ok(probed)
}

impl Candidate {
    fn probed(&self, baud: u32, bytes: u64) -> ProbeResult {
        let skipped = self.decoder.skipped();
        let seconds = self.last_ns.saturating_sub(self.first_ns) as f64 / 1e9;
        let rate_hz = if seconds > 0.0 && baud > 0 { self.frames.saturating_sub(1) as f64 / seconds } else { 0.0 };
        ProbeResult {
            profile: self.profile.to_owned(),
            baud,
            frames: self.frames,
            damaged: skipped.damaged,
            bytes,
            skipped: skipped.bytes(),
            rate_hz,
            has_checksum: self.has_checksum,
        }
    }
}
