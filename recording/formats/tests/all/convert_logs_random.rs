//! Random damage of logs: bytes that are overwritten, deleted or inserted, blocks of the same log, and times that are
//! wild. What is read is right, what is lost is reported, and nothing panics.
#![allow(clippy::print_stdout, reason = "a study prints its seed and its figures")]

use crate::logs::{Dataflash, ImuRow, Ulog, convert, converted};
use isotherm_recording_formats::convert::Settings;
use isotherm_shared::wire::RawSample;
use std::collections::HashMap;
use std::env;

/// Rows of a log.
const ROWS: u64 = 300;
/// Logs of each format in the normal tests.
const LOGS: u64 = 40;

/// Numbers that look random.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }

    /// Near -1 to 1.
    fn real(&mut self) -> f32 {
        self.next() as f32 / u64::MAX as f32 * 2.0 - 1.0
    }
}

/// The seed of a night, otherwise the one of the normal tests.
fn seed() -> u64 {
    let seed = env::var("ISOTHERM_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(1);
    println!("ISOTHERM_SEED={seed}");
    seed
}

/// The times of rows [us]: rising, with a jitter.
fn times(random: &mut Random) -> Vec<u64> {
    let begin = 5_000_000 + random.next() % 1_000_000;
    (0..ROWS).map(|row| begin + row * 10_000 + random.next() % 500).collect()
}

fn ulog(random: &mut Random) -> Vec<u8> {
    let mut log = Ulog::new();
    log.message(b'F', b"other:uint64_t timestamp;float[6] q;").subscribe(0, 30, "other");
    for time_us in times(random) {
        let values = [(); 6].map(|()| random.real());
        let celsius = 25.0 + random.real();
        log.gyro(0, time_us, [values[0], values[1], values[2]], celsius);
        log.accel(0, time_us, [values[3], values[4], values[5] - 9.5], celsius);
        if random.below(3) == 0 {
            log.message(b'D', &[&[30, 0][..], &time_us.to_le_bytes(), &[random.below(256) as u8; 24]].concat());
        }
    }
    log.bytes
}

fn dataflash(random: &mut Random) -> Dataflash {
    let mut log = Dataflash::new();
    log.parameter("INS_ACCOFFS_X", 0.125);
    for time_us in times(random) {
        let values = [(); 6].map(|()| random.real());
        let row = ImuRow {
            time_us,
            rate: [values[0], values[1], values[2]],
            acceleration: [values[3], values[4], values[5] - 9.5],
            celsius: 25.0 + random.real(),
            ..ImuRow::default()
        };
        log.imu(&row);
        if random.below(3) == 0 {
            log.message("BARO", "QBfB", "TimeUS,I,Alt,Pad", &[&time_us.to_string(), "0", "1.5", "7"]);
        }
    }
    log
}

/// What is done to a log from this byte on, and how many rows of a binary log may be wrong without a trace.
fn damage(data: &mut Vec<u8>, first: usize, random: &mut Random) -> usize {
    let at = first + random.below(data.len() - first);
    let longest = [8, 100, 2500][random.below(3)];
    let count = 1 + random.below(longest);
    let end = (at + count).min(data.len());
    let kind = random.below(6);
    match kind {
        0 => data[at..end].iter_mut().for_each(|byte| *byte = random.next() as u8),
        1 => data[at..end].fill(0),
        2 => data[at..end].fill(0xff),
        3 => drop(data.drain(at..end)),
        4 => {
            let inserted: Vec<_> = (0..count).map(|_| random.next() as u8).collect();
            drop(data.splice(at..at, inserted));
        }
        // A block of older or newer data of the log.
        _ => {
            let from = first + random.below(data.len() - first - (end - at));
            data.copy_within(from..from + (end - at), at);
        }
    }
    match kind {
        // Bytes within the body of one message, which may change the time of rates: those of two rows.
        0..=2 if end - at <= 54 => 2,
        // What is left begins where a message of the same length has the same byte.
        3 | 5 => 2,
        _ => 0,
    }
}

/// Converts what is left. Every row that no wrong byte can have hit is one of the undamaged log.
fn check(whole: &[RawSample], data: &[u8], extension: &str, what: &str) -> (usize, usize) {
    let settings = Settings { interval_ns: Some(10_000_000), ..Settings::default() };
    let (rows, told) = convert(data, extension, &settings).unwrap_or_else(|failure| panic!("{what}: {failure}"));
    let by_time: HashMap<u64, usize> =
        whole.iter().enumerate().map(|(number, row)| (row.timestamp_ns, number)).collect();
    // Behind a row that is lost the rates are means over more time.
    let mut before = None;
    let mut is_right = |row: &RawSample| {
        let Some(number) = by_time.get(&row.timestamp_ns) else { return false };
        let follows = before.replace(*number).is_some_and(|before| before + 1 == *number);
        let own = &whole[*number];
        own.accelerometers == row.accelerometers && (!follows || own.gyroscopes == row.gyroscopes)
    };
    assert!(rows.windows(2).all(|pair| pair[0].timestamp_ns < pair[1].timestamp_ns), "{what}");
    let wrong = rows.iter().filter(|row| !is_right(row)).count();
    let lost = whole.len().saturating_sub(rows.len());
    let is_told = ["missing-rows", "truncated", "rows-left-out", "stalled"].iter().any(|name| told.contains(name));
    // Whole messages that end the log leave no trace.
    let is_cut = rows.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1);
    assert!(lost == 0 || is_told || is_cut, "{what}: {lost} rows are lost, and nothing is reported: {told}");
    (wrong, lost)
}

/// The logs with damage; the place of each is behind the definitions.
fn study(logs: u64) {
    let mut random = Random(seed());
    let (mut wrong, mut lost, mut all) = (0, 0, 0);
    for number in 0..logs {
        let dataflash = dataflash(&mut random);
        for (data, extension) in
            [(ulog(&mut random), "ulg"), (dataflash.bytes, "bin"), (dataflash.text.into_bytes(), "log")]
        {
            let (whole, _) = converted(&data, extension, &Settings::default());
            assert_eq!(whole.len(), ROWS as usize);
            let mut damaged = data.clone();
            let most = damage(&mut damaged, 900, &mut random);
            // A line is cut and joined as numbers are.
            let most = if extension == "log" { 2 } else { most };
            let (of_wrong, of_lost) = check(&whole, &damaged, extension, &format!("{number} {extension}"));
            assert!(of_wrong <= most, "{number} {extension}: {of_wrong} rows are wrong, not {most}");
            wrong += of_wrong;
            lost += of_lost;
            all += 1;
        }
    }
    println!("{all} logs of {ROWS} rows: {wrong} rows are wrong, {lost} are lost");
}

#[test]
fn random_damage_is_read_around_and_told() {
    study(LOGS);
}

#[test]
#[ignore = "a study of the night"]
fn random_damage_of_many_logs_is_read_around_and_told() {
    study(2000);
}
