//! The reader gets back what the recorder wrote, in every format, and reports damaged files as errors.
#![allow(clippy::unwrap_used, reason = "helpers of tests, in which the panic is the report")]

use super::{ImuChoice, Samples};
use crate::write::{Files, Format, Rotation};
use isotherm_files::{Disk, sources};
use isotherm_recording::Progress;
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_shared::wire::{CompensatedIncrement, RawSample, StreamSample, Triad};
use isotherm_support::failure::{Exit, Failure, printable};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const FORMATS: [(Format, &str); 2] = [(Format::Csv, "r.csv"), (Format::Mcap, "r.mcap")];

fn imu(name: &str) -> ImuId {
    name.parse().unwrap()
}

/// Pseudorandom numbers with a fixed seed.
pub(crate) struct TestRandom(pub(crate) u64);

impl TestRandom {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 ^ (self.0 >> 29)
    }
    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.next() >> 11) as usize % limit
    }
}

/// Samples that cover the whole range of every field.
fn samples(count: u64) -> Vec<RawSample> {
    let mut random = TestRandom(count);
    let mut edge = move || [0, u64::MAX, 1 << 63, random.next()][random.below(4)];
    let mut triad = || Triad {
        positive_pulses: [(); 3].map(|()| edge() as u32),
        negative_pulses: [(); 3].map(|()| edge() as u32),
        head_temperature: [0.1 + 0.2, f64::NAN, -0.0],
        board_temperature: [f64::INFINITY, f64::MIN_POSITIVE / 8.0, f64::from_bits(edge() >> 2)],
        head_lagged: [f64::from_bits(edge()), f64::from_bits(u64::MAX), -1.5],
    };
    let triads: Vec<_> = (0..count).map(|_| (triad(), triad())).collect();
    let made = (0..count).zip(triads).map(|(number, (accelerometers, gyroscopes))| RawSample {
        session: if number < count / 2 { u64::MAX } else { 3 },
        sequence: number * 7,
        timestamp_ns: edge(),
        interval_ns: edge(),
        sent_ns: 0,
        telemetry_ns: edge(),
        lag_ns: if number == 0 { 1 } else { edge() },
        device: if number == 0 { 1 } else { edge() },
        accelerometers,
        gyroscopes,
    });
    made.collect()
}

/// Writes the samples and as many increments, with several flushes.
fn write(folder: &Path, format: Format, name: &str, imus: &[ImuId], samples: &[RawSample]) -> PathBuf {
    let flush = samples.len() / 6 + 1;
    let path = folder.join(name);
    let streams: Vec<_> = (0..imus.len()).flat_map(|imu| StreamKind::BOTH.map(|stream| (imu, stream))).collect();
    let mut files = Files::create(&Disk, &path, format, Rotation::default(), imus, &streams).ok().unwrap();
    for (count, raw) in samples.iter().enumerate() {
        for imu in 0..imus.len() {
            let raw = RawSample { timestamp_ns: raw.timestamp_ns ^ imu as u64, ..*raw };
            let angle_increment = if raw.gyroscopes.is_absent() { [f64::NAN; 3] } else { [0.5; 3] };
            let (session, sequence) = (raw.session, raw.sequence);
            let increment = CompensatedIncrement { session, sequence, angle_increment, ..Default::default() };
            for sample in [StreamSample::Raw(raw), StreamSample::Increment(increment)] {
                files.write(&RecordedRow::new(imu, 5, sample)).ok().unwrap();
            }
        }
        if count % flush == 0 {
            files.flush().ok().unwrap();
        }
    }
    files.finish().ok().unwrap();
    path
}

pub(crate) fn read(path: &Path, choice: ImuChoice) -> Result<Vec<RawSample>, Failure> {
    Samples::open(&sources(&[path.to_owned()]).unwrap(), choice, &Progress::default())?.collect()
}

pub(crate) fn bits(samples: &[RawSample]) -> Vec<String> {
    let triad = |triad: &Triad| {
        let temperature = [triad.head_temperature, triad.board_temperature, triad.head_lagged];
        format!(
            "{:?} {:?} {:?}",
            triad.positive_pulses,
            triad.negative_pulses,
            temperature.map(|of| of.map(f64::to_bits))
        )
    };
    let text = |s: &RawSample| {
        let RawSample { session, sequence, timestamp_ns, interval_ns, telemetry_ns, lag_ns, device, .. } = s;
        let (accelerometers, gyroscopes) = (triad(&s.accelerometers), triad(&s.gyroscopes));
        format!(
            "{session} {sequence} {timestamp_ns} {interval_ns} {telemetry_ns} {lag_ns} {device} {accelerometers} {gyroscopes}"
        )
    };
    samples.iter().map(text).collect()
}

/// Samples as CSV gives them back: it has one NaN.
fn with_one_nan(samples: &[RawSample]) -> Vec<RawSample> {
    let mut samples = samples.to_vec();
    for triad in samples.iter_mut().flat_map(|raw| [&mut raw.accelerometers, &mut raw.gyroscopes]) {
        let temperature = [&mut triad.head_temperature, &mut triad.board_temperature, &mut triad.head_lagged];
        temperature.into_iter().flatten().filter(|value| value.is_nan()).for_each(|value| *value = f64::NAN);
    }
    samples
}

#[test]
fn every_format_gives_back_every_bit() {
    let folder = TempDir::new().unwrap();
    let a = imu("imu-a");
    for (format, name) in FORMATS {
        let samples = samples(3000);
        let path = write(folder.path(), format, name, std::slice::from_ref(&a), &samples);
        let read = read(&path, ImuChoice::Only(a.clone())).unwrap();
        let expected = if format == Format::Csv { with_one_nan(&samples) } else { samples };
        assert!(bits(&read) == bits(&expected), "{format:?}");
    }
    // No temporary files are left.
    let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["r.csv", "r.increments.csv", "r.mcap"]);
}

#[test]
fn one_of_several_imus_is_selected() {
    let folder = TempDir::new().unwrap();
    let imus = [imu("imu-a"), imu("imu-b"), imu("imu-c")];
    let samples = samples(10);
    let path = write(folder.path(), Format::Mcap, "all.mcap", &imus, &samples);
    for (number, id) in imus.iter().enumerate() {
        for choice in [ImuChoice::Only(id.clone()), ImuChoice::Prefer(id.clone())] {
            let read = read(&path, choice).unwrap();
            assert_eq!(read[3].timestamp_ns, samples[3].timestamp_ns ^ number as u64);
            assert_eq!(read.len(), samples.len());
        }
    }
    let other = imu("imu-x");
    let preferred = read(&path, ImuChoice::Prefer(other.clone())).unwrap_err();
    assert!(preferred.message.contains("several IMUs: imu-a, imu-b, imu-c; choose one with --imu"), "{preferred}");
    let only = read(&path, ImuChoice::Only(other.clone())).unwrap_err();
    assert!(only.message.contains("no raw samples of imu-x, but of imu-a, imu-b, imu-c"), "{only}");
    assert_eq!((preferred.exit, only.exit), (Exit::Data, Exit::Data));
    let one = write(folder.path(), Format::Mcap, "one.mcap", &imus[..1], &samples);
    assert_eq!(read(&one, ImuChoice::Prefer(other.clone())).unwrap().len(), 10, "the only one there is");
    let wrong = read(&one, ImuChoice::Only(other.clone())).unwrap_err();
    assert!(wrong.message.contains("no raw samples of imu-x, but of imu-a"), "{wrong}");
}

/// All flushed rows can be read, wherever the file ends.
#[test]
fn a_truncated_file_is_read_up_to_its_end() {
    let folder = TempDir::new().unwrap();
    let a = imu("imu-a");
    let samples = samples(500);
    for (format, name) in FORMATS {
        let path = write(folder.path(), format, name, std::slice::from_ref(&a), &samples);
        let whole = fs::read(&path).unwrap();
        let (mut counts, step) = (Vec::new(), whole.len() / 300);
        for length in (4000..whole.len()).step_by(step) {
            fs::write(&path, &whole[..length]).unwrap();
            let read = read(&path, ImuChoice::Only(a.clone())).unwrap();
            let expected = &samples[..read.len()];
            let expected = if format == Format::Csv { with_one_nan(expected) } else { expected.to_vec() };
            assert!(bits(&read) == bits(&expected), "{format:?} {length}");
            counts.push(read.len());
        }
        assert!(counts.is_sorted() && counts.last() >= Some(&400), "{format:?} {counts:?}");
    }
}

/// A file that is hardly more than its first bytes is bad data too, not an error of reading.
#[test]
fn beginnings_of_files_are_bad_data() {
    let folder = TempDir::new().unwrap();
    let a = imu("imu-a");
    let path = folder.path().join("begun");
    for (format, name) in FORMATS {
        let whole = fs::read(write(folder.path(), format, name, std::slice::from_ref(&a), &samples(40))).unwrap();
        for length in 0..40 {
            fs::write(&path, &whole[..length]).unwrap();
            let refused = read(&path, ImuChoice::Any).unwrap_err();
            assert_eq!(refused.exit, Exit::Data, "{format:?}, {length} bytes: {refused}");
        }
    }
    // An error of the operating system: EIO.
    assert_eq!(read(Path::new("/proc/self/mem"), ImuChoice::Any).unwrap_err().exit, Exit::Io);
}

/// A text in an MCAP file that claims 4 GB is left out before memory for it is requested.
#[test]
fn a_text_longer_than_its_record_is_left_out() {
    let folder = TempDir::new().unwrap();
    let path = write(folder.path(), Format::Mcap, "r.mcap", &[imu("imu-a")], &samples(40));
    let whole = fs::read(&path).unwrap();
    for text in ["isotherm/imu-a/raw", "isotherm.RawSample", "protobuf"] {
        // The last place is in the summary, which is not compressed.
        let place = whole.windows(text.len()).rposition(|window| window == text.as_bytes()).unwrap();
        let mut bytes = whole.clone();
        bytes[place - 4..place].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
        fs::write(&path, &bytes).unwrap();
        let opened =
            Samples::open(&sources(std::slice::from_ref(&path)).unwrap(), ImuChoice::Any, &Progress::default());
        let mut samples = opened.unwrap();
        assert_eq!(samples.by_ref().map(Result::unwrap).count(), 40);
        let findings = samples.recording().findings();
        assert!(findings[0].message.contains("a text that is longer than its record"), "{text}: {findings:?}");
    }
}

/// A piece that changes after its beginning has been read keeps its exit code.
#[test]
fn a_later_piece_that_has_become_bad_is_bad_data() {
    let folder = TempDir::new().unwrap();
    let imus = [imu("imu-a")];
    let (first, second) = (samples(40), samples(80));
    let late: Vec<_> = second.iter().map(|raw| RawSample { session: 9, ..*raw }).collect();
    let pieces = [("1.mcap", &first), ("2.mcap", &late)]
        .map(|(name, samples)| write(folder.path(), Format::Mcap, name, &imus, samples));
    let mut reading = Samples::open(&sources(&pieces).unwrap(), ImuChoice::Any, &Progress::default()).unwrap();
    let begun = reading.next().unwrap().unwrap();
    for piece in &pieces {
        fs::write(piece, "PAR1PAR1").unwrap();
    }
    let refused = reading.find_map(Result::err).unwrap();
    assert_eq!(refused.exit, Exit::Data, "{refused}, after {begun:?}");
}

/// Damages a file in one of the ways that files are damaged, by accident or on purpose.
fn damage(random: &mut TestRandom, whole: &[u8]) -> Vec<u8> {
    const LENGTHS: [u32; 8] = [0, 1, 0x7f, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_fff8, u32::MAX];
    // The longest integers of a footer and of a page header.
    const VARINTS: [&[u8]; 4] = [
        &[0xff, 0xff, 0xff, 0xff, 0x0f],
        &[0xfe, 0xff, 0xff, 0xff, 0x0f],
        &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01],
        &[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80],
    ];
    let mut bytes = whole.to_vec();
    for _ in 0..=random.below(3) {
        let size = bytes.len();
        if size < 16 {
            break;
        }
        // Half of the damage is in the last third of the file: a footer with sizes is there.
        let place = random.below(size);
        let place = if random.below(2) == 0 { size - 1 - place / 3 } else { place };
        let length = random.below(64).min(size - place);
        match random.below(8) {
            0 => bytes.truncate(place),
            1 => {
                let to = random.below(size);
                bytes.copy_within(place..place + length.min(size - to), to);
            }
            2 => drop(bytes.drain(place..place + length)),
            3 => drop(bytes.splice(place..place, whole[place.min(whole.len())..].iter().copied().take(length))),
            4 => bytes[place] ^= 1 << random.below(8),
            5 => {
                let varint = VARINTS[random.below(4)];
                bytes.splice(place..(place + random.below(varint.len() + 1)).min(size), varint.iter().copied());
            }
            6 => {
                let place = if random.below(2) == 0 { size - 8 } else { place.min(size - 4) };
                let length = LENGTHS[random.below(8)].wrapping_add(random.below(4) as u32);
                bytes[place..place + 4].copy_from_slice(&length.to_le_bytes());
            }
            _ => bytes[place] = [0, 1, 0x7f, 0x80, 0xff, random.next() as u8][random.below(6)],
        }
    }
    bytes
}

/// Any damaged file gives samples, and what is left out is named, or it is refused as bad data, with a place. It is
/// never an error of the operating system, and never a panic, and no row of MCAP is another one than was recorded.
/// `ISOTHERM_MUTATIONS` sets how many damaged files of each kind are read, from the first one or the one that
/// `ISOTHERM_MUTATION` names on.
#[test]
fn damaged_files_are_read_up_to_what_is_damaged() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (begin, count) = (number("ISOTHERM_MUTATION").unwrap_or(0), number("ISOTHERM_MUTATIONS").unwrap_or(250));
    let folder = TempDir::new().unwrap();
    let a = imu("imu-a");
    for (format, name) in FORMATS {
        let recorded = samples(40);
        let whole = fs::read(write(folder.path(), format, name, std::slice::from_ref(&a), &recorded)).unwrap();
        let recorded = bits(&recorded);
        let path = folder.path().join("damaged");
        let mut noticed = 0;
        for round in begin..begin + count {
            fs::write(&path, damage(&mut TestRandom(round), &whole)).unwrap();
            let input = ImuChoice::Only(a.clone());
            let read = Samples::open(&sources(std::slice::from_ref(&path)).unwrap(), input, &Progress::default())
                .and_then(|mut it| {
                    let rows = it.by_ref().collect::<Result<Vec<_>, _>>()?;
                    Ok((rows, it.recording().findings()))
                });
            match read {
                Ok((rows, findings)) => {
                    noticed += usize::from(!findings.is_empty());
                    assert!(rows.len() <= 200, "{name} {round}: {} rows", rows.len());
                    let is_recorded = bits(&rows).iter().all(|row| recorded.contains(row));
                    assert!(is_recorded || format == Format::Csv, "{name} {round}: a row that nobody recorded");
                }
                Err(failure) => {
                    assert_eq!(failure.exit, Exit::Data, "{name} {round}: {failure}");
                    assert_eq!(printable(&failure.message), failure.message);
                    noticed += 1;
                }
            }
        }
        assert!(noticed as u64 > count / 4, "{name}: {noticed} of {count}");
    }
}
