//! Logs that are cut, or have wrong bytes: rows before and behind are kept, and what is lost is reported with its
//! place.

use crate::logs::{Dataflash, ImuRow, Ulog, convert, converted, refused};
use isotherm_recording_formats::convert::Settings;
use isotherm_support::failure::Exit;

fn ulog(rows: u64) -> Ulog {
    let mut log = Ulog::new();
    log.message(b'P', b"\x0fchar[3] SYS_STRabc").message(b'L', b"6\x01\0\0\0\0\0\0\0armed");
    for row in 1..=rows {
        log.imu(row * 10_000);
    }
    log
}

fn dataflash(rows: u64) -> Dataflash {
    let mut log = Dataflash::new();
    log.parameter("INS_TCAL1_ENABLE", 0.0).message("MSG", "QZ", "TimeUS,Message", &["5", "ArduCopter"]);
    for row in 1..=rows {
        log.imu(&ImuRow { time_us: row * 10_000, ..ImuRow::default() });
    }
    log
}

/// Cuts a log at every place. What is left is read, with a warning unless it ends with a message, or refused.
fn cut_everywhere(data: &[u8], extension: &str, unit: &str, first: usize, ends: &[usize]) {
    let settings = Settings { interval_ns: Some(10_000_000), ..Settings::default() };
    let mut converted = 0;
    for length in first..data.len() {
        match convert(&data[..length], extension, &settings) {
            Ok((samples, told)) => {
                converted += 1;
                assert!(!samples.is_empty());
                let is_told = told.contains(&format!("warning [truncated]: no whole message comes from {unit} "));
                assert!(is_told || ends.contains(&length), "{length}: {told}");
            }
            Err(failure) => {
                assert_eq!(failure.exit, Exit::Data);
                let place = format!("{unit} ");
                let has_place =
                    failure.message.contains(&place) || failure.place.is_some_and(|(_, line)| line.is_some());
                assert!(has_place, "{length}: {}", failure.message);
            }
        }
    }
    assert!(converted > data.len() / 4, "{converted}");
}

#[test]
fn a_cut_at_every_byte_is_told() {
    let log = ulog(12).bytes;
    let mut ends = vec![16];
    while let Some(header) = log.get(ends[ends.len() - 1]..).and_then(|rest| rest.first_chunk::<3>()) {
        ends.push(ends[ends.len() - 1] + 3 + usize::from(u16::from_le_bytes([header[0], header[1]])));
    }
    assert_eq!(ends.last(), Some(&log.len()));
    cut_everywhere(&log, "ulg", "byte", 7, &ends);

    let log = dataflash(12).bytes;
    // Definitions have 89 bytes, PARM 3 + 8 + 16 + 4 + 4, MSG 3 + 8 + 64, IMU 54.
    let mut ends = vec![89];
    for length in [89, 35, 89, 75, 89].into_iter().chain([54; 12]) {
        ends.push(ends[ends.len() - 1] + length);
    }
    assert_eq!(ends.last(), Some(&log.len()));
    cut_everywhere(&log, "bin", "byte", 2, &ends);
}

#[test]
fn a_text_that_is_cut_loses_its_last_line_alone() {
    let text = dataflash(12).text;
    let end = text.trim_end().rfind('\n').unwrap() + 1;
    for length in end + 1..text.len() {
        let (samples, told) = converted(&text.as_bytes()[..length], "log", &Settings::default());
        // The last field may be shorter than it was.
        let is_whole = samples.len() == 12;
        assert!(is_whole || (samples.len() == 11 && told.contains("[truncated]: no whole message comes from line 18")));
        assert_eq!(is_whole, length >= text.len() - "1000\n".len() - 1, "{length} of {}: {told}", text.len());
    }
}

#[test]
fn wrong_bytes_lose_the_messages_that_they_hit() {
    let log = ulog(40).bytes;
    let row = (log.len() - ulog(0).bytes.len()) / 40;
    let begin = log.len() - 20 * row;
    // Lengths and types are wrong, zeros as of a lost block, and text. Where the damage begins within the message
    // before, nothing shows it: it is lost too.
    for (damage, lost) in [(&[0xff_u8; 8][..], 2), (&[0; 200], 4), (&[b' '; 100], 3)] {
        let mut damaged = log.clone();
        damaged[begin..begin + damage.len()].copy_from_slice(damage);
        let (samples, told) = converted(&damaged, "ulg", &Settings::default());
        assert_eq!((samples.len(), samples.last().map(|row| row.sequence)), (40 - lost, Some(39)), "{told}");
        assert!(
            told.contains(&format!(
                "are not messages of the log, the first is byte {}: it is damaged",
                begin - row / 2
            )),
            "{told}"
        );
    }
    let log = dataflash(40).bytes;
    let begin = log.len() - 20 * 54;
    for (damage, lost) in [(&[0xff_u8; 8][..], 2), (&[0; 200], 5), (&[0xa3, 0x95, 77], 1), (&[0xa3, 0x95, 128], 1)] {
        let mut damaged = log.clone();
        damaged[begin..begin + damage.len()].copy_from_slice(damage);
        let (samples, told) = converted(&damaged, "bin", &Settings::default());
        assert_eq!((samples.len(), samples.last().map(|row| row.sequence)), (40 - lost, Some(39)), "{told}");
        assert!(told.contains("warning [missing-rows]"), "{told}");
    }
}

#[test]
fn bytes_behind_the_last_message_are_told() {
    for tail in [&[0_u8; 5000][..], &[0xff; 5000]] {
        // The tail may have begun within the last message, which is left out.
        for (log, extension, last) in [(ulog(20).bytes, "ulg", 44), (dataflash(20).bytes, "bin", 54)] {
            let (samples, told) = converted(&[&log, tail].concat(), extension, &Settings::default());
            let place = format!("[truncated]: no whole message comes from byte {} on", log.len() - last);
            assert!(samples.len() == 19 && told.contains(&place), "{told}");
        }
    }
    let text = dataflash(20).text.replacen("IMU, 100000", "some words\nIMU, 100000", 1);
    let (samples, told) = converted(text.as_bytes(), "log", &Settings::default());
    assert!(
        samples.len() == 20 && told.contains("1 lines are not messages of the log, the first is line 16"),
        "{told}"
    );
}

#[test]
fn appended_data_are_read_behind_a_message_that_is_cut() {
    let mut log = ulog(20);
    let whole = log.bytes.len();
    // A cut message, whose length covers what is appended.
    log.bytes.extend([200, 0, b'D', 0, 0, 1, 2]);
    let offset = log.bytes.len();
    for row in 21..=30 {
        log.imu(row * 10_000);
    }
    log.bytes[16 + 3 + 8] = 1;
    log.bytes[16 + 3 + 16..16 + 3 + 24].copy_from_slice(&(offset as u64).to_le_bytes());
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    // The message before what is cut may be damaged: it is one of sensor_gyro, and its row is left out.
    assert_eq!((samples.len(), samples[28].sequence), (29, 29));
    let place = whole - 44;
    assert!(told.contains(&format!("51 bytes are not messages of the log, the first is byte {place}")), "{told}");
    // The same with a message that could be one.
    log.bytes[whole..whole + 2].copy_from_slice(&45_u16.to_le_bytes());
    assert_eq!(converted(&log.bytes, "ulg", &Settings::default()).0.len(), 30);
}

#[test]
fn any_byte_may_be_wrong() {
    let settings = Settings { interval_ns: Some(10_000_000), ..Settings::default() };
    let check = |data: &[u8], extension: &str| {
        if let Err(failure) = convert(data, extension, &settings) {
            assert!([Exit::Data, Exit::Usage].contains(&failure.exit), "{failure}");
        }
    };
    for (data, extension) in
        [(ulog(3).bytes, "ulg"), (dataflash(3).bytes, "bin"), (dataflash(3).text.into_bytes(), "log")]
    {
        for place in 0..data.len() {
            for wrong in [0, 0xff, data[place] ^ 0x10] {
                let mut damaged = data.clone();
                damaged[place] = wrong;
                check(&damaged, extension);
            }
        }
    }
}

#[test]
fn a_stream_is_refused_because_logs_are_read_twice() {
    let failure = isotherm_recording_formats::convert::Conversion::of_text(
        std::path::Path::new("no such file"),
        std::io::Cursor::new(ulog(3).bytes),
        None,
        &Settings::default(),
    );
    let failure = failure.err().unwrap();
    assert!(failure.exit == Exit::Usage && failure.message.contains("is read twice; give a file"), "{failure}");
    let mut cut = ulog(3).bytes;
    cut.truncate(10);
    let (_, message) = refused(&cut, "ulg", &Settings::default());
    assert!(message.contains("byte 10: the header of the file is cut"), "{message}");
}

#[test]
fn blocks_of_other_data_of_the_log_and_wild_times_are_left_out() {
    let log = ulog(200).bytes;
    let row = (log.len() - ulog(0).bytes.len()) / 200;
    // A block of the card with older data.
    let (from, to) = (log.len() - 180 * row + 10, log.len() - 100 * row + 31);
    let mut damaged = log.clone();
    damaged.copy_within(from..from + 20 * row, to);
    let (samples, told) = converted(&damaged, "ulg", &Settings::default());
    assert!((175..180).contains(&samples.len()) && samples.last().map(|row| row.sequence) == Some(199), "{told}");
    assert!(samples.windows(2).all(|pair| pair[0].timestamp_ns < pair[1].timestamp_ns));
    assert!(told.contains("rows of sensor_accel 0 have times that do not follow those of the other rows"), "{told}");
    assert!(told.contains("are not messages of the log"), "{told}");

    for wild in [4_213_092_985_657_280_000, u64::MAX, 0, 5_000_000] {
        let mut log = Dataflash::new();
        for row in 1..=100 {
            let time_us = if row == 70 { wild } else { row * 10_000 };
            log.imu(&ImuRow { time_us, ..ImuRow::default() });
        }
        for (data, extension) in [(&log.bytes[..], "bin"), (log.text.as_bytes(), "log")] {
            let (samples, told) = converted(data, extension, &Settings::default());
            assert_eq!((samples.len(), samples[98].sequence), (99, 99), "{told}");
            assert!(told.contains("1 rows of IMU 0 have times that do not follow"), "{told}");
            assert!(told.contains("left out, 1.00 % of all"), "{told}");
        }
    }
}

#[test]
fn a_sensor_that_stalls_is_called_one() {
    let mut log = Ulog::new();
    for row in 1..=100_u64 {
        log.imu(row.min(60) * 10_000);
    }
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert_eq!(samples.len(), 60);
    assert!(told.contains("warning [stalled]: sensor_accel 0 stalled: 40 rows repeat the sample"), "{told}");
}

#[test]
fn an_autopilot_that_was_started_again_within_the_log_is_refused() {
    let mut log = Dataflash::new();
    for row in (1..=100).chain(1..=80) {
        log.imu(&ImuRow { time_us: row * 10_000, ..ImuRow::default() });
    }
    let (exit, message) = refused(&log.bytes, "bin", &Settings::default());
    assert!(exit == Exit::Data && message.contains("80 of 180 rows of IMU have times that do not rise"), "{message}");
}

#[test]
fn a_number_of_an_imu_that_does_not_exist_is_damage() {
    let mut log = dataflash(100);
    log.imu(&ImuRow { time_us: 1_010_000, instance: 37, ..ImuRow::default() });
    let (samples, told) = converted(&log.bytes, "bin", &Settings::default());
    assert!(samples.len() == 100 && told.contains("1 rows are of IMUs that do not exist"), "{told}");
}
