//! Writes a long recording of an IMU at rest, for figures: `long_recording HOURS FILE.mcap`, or `FILE.csv`. Rows of
//! 1 ms, six sensors, temperature once a second.

use isotherm_files::Disk;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::write::{Files, Format, Rotation};
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::{RawSample, StreamSample, Triad};
use isotherm_support::failure::Failure;
use std::path::PathBuf;

/// Rows of an hour.
const HOUR: u64 = 3_600_000;

/// Numbers of about normal distribution: sums of four bytes.
struct Random(u64);

impl Random {
    fn pulses(&mut self, mean: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        mean + self.0.to_le_bytes()[..4].iter().map(|byte| u32::from(*byte)).sum::<u32>() / 16
    }
}

fn triad(random: &mut Random, means: [u32; 3], celsius: f64) -> Triad {
    Triad {
        positive_pulses: means.map(|mean| random.pulses(mean)),
        head_temperature: [celsius; 3],
        board_temperature: [celsius + 1.0; 3],
        ..Triad::ABSENT
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let hours: f64 = arguments.next().ok_or("hours?")?.parse()?;
    let path = PathBuf::from(arguments.next().ok_or("a file?")?);
    let format = Format::of_path(&path).ok_or("a name that ends with .mcap or .csv")?;
    let imus = ["imu-a".parse().map_err(|_| "a name")?];
    let mut files = Files::create(&Disk, &path, format, Rotation::default(), &imus, &[(0, StreamKind::Raw)])
        .map_err(|error| Failure::from(error).message)?;
    let mut random = Random(88_172_645_463_325_252);
    for row in 0..(hours * HOUR as f64) as u64 {
        let timestamp_ns = (row + 1) * 1_000_000;
        let celsius = 25.0 + libm::sin((row / 1000 * 1000) as f64 / 5e6);
        let celsius = (celsius * 100.0).round() / 100.0;
        let raw = RawSample {
            session: 1,
            sequence: row,
            timestamp_ns,
            interval_ns: 1_000_000,
            accelerometers: triad(&mut random, [500, 700, 2000], celsius),
            gyroscopes: triad(&mut random, [300, 400, 600], celsius),
            ..RawSample::default()
        };
        let row = RecordedRow::new(0, timestamp_ns, StreamSample::Raw(raw));
        files.write(&row).map_err(|error| Failure::from(error).message)?;
        if files.is_flush_due() {
            files.flush().map_err(|error| Failure::from(error).message)?;
        }
    }
    Ok(files.finish().map_err(|error| Failure::from(error).message)?)
}
