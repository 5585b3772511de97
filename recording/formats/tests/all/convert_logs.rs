//! Logs of autopilots: ULog of PX4, DataFlash of ArduPilot. Damage and cuts are in `convert_logs_damaged.rs`.

use crate::logs::{Dataflash, IMU_FORMAT, IMU_NAMES, ImuRow, Ulog, converted, refused};
use isotherm_autopilot::logs::FoundImu;
use isotherm_autopilot::logs::LOG_ACCELERATION_PULSE;
use isotherm_autopilot::logs::LOG_RATE_PULSE;
use isotherm_files::source;
use isotherm_recording::LogImu;
use isotherm_recording_formats::convert::{Conversion, Settings, imus_of_log};
use isotherm_shared::wire::{RawSample, device};
use isotherm_support::failure::Exit;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

/// The rows of a real file, and all that is reported.
fn file(name: &str) -> (Vec<RawSample>, Vec<String>) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/autopilots").join(name);
    let mut conversion = Conversion::open(&source(&path), None, &Settings::default()).unwrap();
    let samples = (&mut conversion).collect::<Result<Vec<_>, _>>().unwrap();
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    let told = findings.chain(conversion.notes()).collect();
    (samples, told)
}

/// Signed pulses: A1, A2, A3, G1, G2, G3.
fn pulses(sample: &RawSample) -> [i64; 6] {
    let signed = |triad: &isotherm_shared::wire::Triad, axis: usize| {
        i64::from(triad.positive_pulses[axis]) - i64::from(triad.negative_pulses[axis])
    };
    core::array::from_fn(|index| match index {
        0..3 => signed(&sample.accelerometers, index),
        _ => signed(&sample.gyroscopes, index - 3),
    })
}

/// The same of values [m/s2, rad/s].
fn as_pulses(acceleration: [f64; 3], rate: [f64; 3]) -> [i64; 6] {
    let of = |value: f64, pulse: f64| (value / pulse).round() as i64;
    core::array::from_fn(|index| match index {
        0..3 => of(acceleration[index], LOG_ACCELERATION_PULSE),
        _ => of(rate[index - 3], LOG_RATE_PULSE),
    })
}

#[test]
fn a_real_ulog_has_the_rows_that_pyulog_reads() {
    let (samples, told) = file("heating.ulg");
    assert_eq!(samples.len(), 1959);
    let (first, last) = (&samples[0], &samples[1958]);
    assert_eq!((first.timestamp_ns, first.sequence, first.interval_ns), (269_000_000_000, 0, 100_000_000));
    assert_eq!((last.timestamp_ns, last.sequence), (464_800_000_000, 1958));
    let expected = as_pulses(
        [0.046_367_578_208_446_5, -0.018_992_504_104_971_886, -9.054_177_284_240_723],
        [-0.060_472_395_271_062_85, -0.014_319_815_672_934_055, 0.017_422_396_689_653_397],
    );
    assert_eq!(pulses(first), expected);
    let expected = as_pulses(
        [0.119_152_255_356_311_8, -0.021_411_480_382_084_846, -9.592_747_688_293_457],
        [-0.075_457_997_620_105_74, -0.000_817_590_393_126_010_9, 0.015_707_317_739_725_113],
    );
    assert_eq!(pulses(last), expected);
    for (sample, celsius) in [(first, -17.562_578_201_293_945), (last, 30.807_300_567_626_953)] {
        let [a, g] = [&sample.accelerometers, &sample.gyroscopes];
        let all = [a.head_temperature, a.board_temperature, g.head_temperature, g.board_temperature];
        assert_eq!(all, [[celsius; 3]; 4]);
        assert_eq!(sample.device, device("3014666"));
    }
    let all = told.join("\n");
    assert!(all.contains("device 3014666, that of the gyroscopes 3080202"), "{all}");
    assert!(all.contains("the nominal interval is 0.1 s"), "{all}");
    let cut = "warning [truncated]: no whole message comes from byte 199990 on; the rows before it are used";
    assert_eq!(told[0], cut);
    assert_eq!(told.iter().filter(|line| line.starts_with("warning")).count(), 1, "{all}");
}

#[test]
fn a_real_dataflash_log_has_the_rows_of_the_ulog() {
    let (ulog, _) = file("heating.ulg");
    let (samples, told) = file("heating.BIN");
    assert_eq!(samples.len(), 3500);
    for (one, other) in ulog.iter().zip(&samples) {
        assert_eq!(*one, RawSample { device: one.device, ..*other });
    }
    let last = &samples[3499];
    assert_eq!(last.timestamp_ns, 618_900_000_000);
    let expected = as_pulses(
        [0.206_187_263_131_141_66, -0.154_095_515_608_787_54, -9.471_776_962_280_273],
        [-0.056_451_033_800_840_38, 0.036_930_054_426_193_24, 0.021_113_552_153_110_504],
    );
    assert_eq!((pulses(last), last.device), (expected, 0));
    assert_eq!(last.accelerometers.head_temperature, [73.948_951_721_191_4; 3]);
    let all = told.join("\n");
    assert!(all.contains("undone: nothing, all are neutral; the log has no INS_ACCOFFS: they count as 0"), "{all}");
    assert!(!all.contains("warning"), "{all}");
}

#[test]
fn gyroscopes_are_the_means_of_their_rows_since_the_row_before() {
    let mut log = Ulog::new();
    // Rates of 1 to 6, one each 10 ms; rows of the accelerometers at 15, 30, 60, 65, 70 ms, the last two without one.
    let times: [(u64, bool); 11] = [
        (10, false),
        (15, true),
        (20, false),
        (30, true),
        (30, false),
        (40, false),
        (50, false),
        (60, true),
        (60, false),
        (65, true),
        (70, true),
    ];
    for (ms, is_accelerometer) in times {
        let value = ms as f32 / 10.0;
        match is_accelerometer {
            true => log.accel(0, ms * 1000, [value, 0.0, -9.5], 20.0 + value),
            false => log.gyro(0, ms * 1000, [value, 0.0, 0.25], 40.0 + value),
        };
    }
    let (samples, told) =
        converted(&log.bytes, "ulg", &Settings { interval_ns: Some(15_000_000), ..Settings::default() });
    let rates: Vec<_> = samples.iter().map(|sample| pulses(sample)[3]).collect();
    assert_eq!(rates, [10_000_000, 25_000_000, 50_000_000, 50_000_000, 50_000_000]);
    let heads: Vec<_> = samples.iter().map(|sample| sample.gyroscopes.head_temperature[0]).collect();
    assert_eq!(heads, [41.0, 42.5, 45.0, 45.0, 45.0]);
    assert_eq!(samples[3].accelerometers.head_temperature, [26.5; 3]);
    assert!(told.contains("warning [repeated]: 2 rows have the gyroscopes of the row before"), "{told}");
}

#[test]
fn rows_before_the_first_rate_are_left_out_and_without_any_there_are_no_gyroscopes() {
    let mut log = Ulog::new();
    for ms in 1..10 {
        log.accel(0, ms * 10_000, [0.0, 0.0, 9.5], 20.0);
    }
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert_eq!((samples.len(), samples[0].gyroscopes.is_absent()), (9, true));
    assert!(!told.contains("sensor_gyro"), "{told}");
    log.gyro(0, 95_000, [0.0; 3], 20.0).accel(0, 100_000, [0.0; 3], 20.0).accel(0, 110_000, [0.0; 3], 20.0);
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert_eq!((samples.len(), samples[0].timestamp_ns), (2, 100_000_000));
    assert!(told.contains("9 rows before the first of sensor_gyro are left out"), "{told}");
}

#[test]
fn several_imus_are_listed_and_one_is_chosen() {
    let mut log = Ulog::new();
    for row in 0..20_u64 {
        for imu in [0, 1] {
            let value = f32::from(imu);
            log.accel(imu, row * 10_000 + 1, [value, 0.0, 9.5], 20.0).gyro(
                imu,
                row * 10_000 + 1,
                [value, 0.0, 0.0],
                20.0,
            );
        }
    }
    let (exit, message) = refused(&log.bytes, "ulg", &Settings::default());
    assert_eq!(exit, Exit::Usage);
    let listed = "choose one with --instance: 0 (device 1000, 20 rows), 1 (device 1001, 20 rows)";
    assert!(message.contains(listed), "{message}");
    let chosen = |instance| Settings { instance: Some(instance), ..Settings::default() };
    let (samples, told) = converted(&log.bytes, "ulg", &chosen(1));
    assert_eq!((samples.len(), samples[0].device), (20, device("1001")));
    assert!(samples.iter().all(|sample| pulses(sample) == [1_000_000, 0, 9_500_000, 10_000_000, 0, 0]));
    assert!(told.contains("device 1001, that of the gyroscopes 2001"), "{told}");
    let (exit, message) = refused(&log.bytes, "ulg", &chosen(2));
    assert!(exit == Exit::Usage && message.contains("no IMU 2"), "{message}");
    let (exit, message) = refused(b"t,x\n", "csv", &chosen(0));
    assert!(exit == Exit::Usage && message.contains("this is not a log of an autopilot"), "{message}");

    let mut log = Dataflash::new();
    log.parameter("INS_ACC_ID", 2_753_028.0).parameter("INS_ACC2_ID", 3_080_202.0);
    for row in 0..20 {
        for instance in [0, 1] {
            log.imu(&ImuRow { time_us: row * 40_000, instance, ..ImuRow::default() });
        }
    }
    let imu = |instance, device| LogImu { instance, devices: [Some(device), None] };
    // That of a table, which may have been at another place.
    let preferred = |imu| Settings { preferred: Some(imu), ..Settings::default() };
    for (data, extension) in [(log.bytes.clone(), "bin"), (log.text.clone().into_bytes(), "log")] {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("log").with_extension(extension);
        fs::write(&path, &data).unwrap();
        let found = [imu(0, 2_753_028), imu(1, 3_080_202)].map(|imu| FoundImu { imu, rows: 20 });
        assert_eq!(imus_of_log(&source(&path), &Settings::default()).unwrap(), found);
        let (samples, _) = converted(&data, extension, &preferred(imu(0, 3_080_202)));
        assert_eq!(samples[0].device, device("3080202"));
        let (samples, _) = converted(&data, extension, &Settings { instance: Some(0), ..preferred(imu(0, 3_080_202)) });
        assert_eq!(samples[0].device, device("2753028"));
        assert_eq!(refused(&data, extension, &preferred(imu(1, 5))).0, Exit::Usage);
        let (exit, message) = refused(&data, extension, &Settings::default());
        let listed = "0 (device 2753028, 20 rows), 1 (device 3080202, 20 rows)";
        assert!(exit == Exit::Usage && message.contains(listed), "{message}");
        let (samples, _) = converted(&data, extension, &chosen(1));
        assert_eq!((samples.len(), samples[0].device), (20, device("3080202")));
    }
}

#[test]
fn other_messages_are_passed_over_and_dropouts_told() {
    let mut log = Ulog::new();
    log.message(b'I', b"\x0fchar[24] sourceof a test, which is long").message(b'M', b"\0\x06char a b");
    log.message(b'P', b"\x0fchar[3] SYS_STRabc").message(b'Q', b"\x01\x0dint32_t A_BCD\x01\0\0\0");
    log.message(b'F', b"inner:uint8_t[3] a;float b;").message(b'F', b"nested:uint64_t timestamp;inner[2] i;inner j;");
    log.subscribe(0, 40, "nested").message(b'D', &[&[40, 0][..], &[7; 8 + 21]].concat());
    for row in 1..=40_u64 {
        log.imu(row * 10_000 + if row > 20 { 500_000 } else { 0 });
        match row {
            5 => log.message(b'L', b"6\x01\0\0\0\0\0\0\0armed").message(b'C', b"6\x01\0\x01\0\0\0\0\0\0\0armed"),
            10 => log.message(b'z', b"a type of the future").message(b'D', &[99, 0, 1, 2, 3]),
            15 => log.message(b'S', &[0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12]).message(b'R', &[40, 0]),
            20 => log.message(b'O', &500_u16.to_le_bytes()),
            _ => &mut log,
        };
    }
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert_eq!((samples.len(), samples[39].sequence), (40, 89));
    assert!(told.contains("2 messages of unknown types are left out"), "{told}");
    assert!(told.contains("the logger dropped data 1 times, for 0.5 s in all, first at byte"), "{told}");
    assert!(told.contains("1 gaps, 50 rows missing by the time"), "{told}");
    assert!(!told.contains("not messages of the log"), "{told}");
}

#[test]
fn rows_of_corrected_topics_are_refused_with_the_setting_that_helps() {
    let mut log = Ulog::empty();
    for (number, name) in [(7, "sensor_combined"), (8, "vehicle_imu"), (9, "vehicle_imu_status")] {
        log.message(b'F', format!("{name}:uint64_t timestamp;").as_bytes()).subscribe(0, number, name);
        log.message(b'D', &[number as u8, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
    }
    let (exit, message) = refused(&log.bytes, "ulg", &Settings::default());
    assert_eq!(exit, Exit::Data);
    let corrected = "sensor_combined, vehicle_imu, vehicle_imu_status are corrected already";
    for part in [corrected, "bit 2 of SDLOG_PROFILE", &format!("byte {}", log.bytes.len())] {
        assert!(message.contains(part), "{message}");
    }
    let (_, message) = refused(&Ulog::empty().bytes, "ulg", &Settings::default());
    assert!(message.contains("no rows of sensor_accel"), "{message}");
    // A definition without an axis.
    let mut log = Ulog::empty();
    log.message(b'F', b"sensor_accel:uint64_t timestamp;float x;float y;").subscribe(0, 1, "sensor_accel");
    log.message(b'D', &[&[1, 0][..], &[0; 16]].concat());
    let (_, message) = refused(&log.bytes, "ulg", &Settings::default());
    assert!(message.contains("sensor_accel has no z") && message.contains(": byte "), "{message}");
    let mut log = Ulog::empty();
    log.bytes[16 + 3 + 8] = 2;
    let (_, message) = refused(&log.bytes, "ulg", &Settings::default());
    assert!(message.contains("byte 16: flags of a newer ULog"), "{message}");
}

#[test]
fn a_row_a_second_is_enough_and_told() {
    let mut log = Ulog::new();
    for row in 1..30 {
        log.imu(row * 1_000_000);
    }
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert_eq!((samples.len(), samples[0].interval_ns), (29, 1_000_000_000));
    assert!(told.contains("about one row a second, as PX4 logs by default: enough"), "{told}");
}

#[test]
fn another_device_or_no_number_is_a_fault() {
    let mut log = Ulog::new();
    for row in 1..20 {
        log.imu(row * 10_000);
    }
    log.accel_of(0, 200_000, 7, [0.0; 3], 20.0);
    let (_, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert!(told.contains("fault [other-device]: 1 rows of sensor_accel 0 are of another device"), "{told}");
}

#[test]
fn rows_without_numbers_are_left_out() {
    let mut log = Ulog::new();
    for row in 1..20 {
        log.imu(row * 10_000);
    }
    let place = log.bytes.len();
    log.accel(0, 200_000, [0.0, f32::NAN, 0.0], 20.0).gyro(0, 200_000, [0.0; 3], 20.0).imu(210_000);
    log.accel(0, 220_000, [0.0; 3], 20.0).gyro(0, 220_000, [0.0, 1e9, 0.0], 20.0);
    log.accel(0, 230_000, [0.0; 3], f32::NAN).gyro(0, 230_000, [0.0; 3], 20.0).imu(240_000);
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert_eq!((samples.len(), samples[20].timestamp_ns), (21, 240_000_000));
    let rows = "2 rows of sensor_accel 0 have values that no sensor gives";
    for part in [
        rows,
        &format!("the first is at byte {place}; they are left out"),
        "1 rows of sensor_accel 0 have no temperature",
    ] {
        assert!(told.contains(part), "{told}");
    }
    let mut log = Ulog::new();
    for row in 1..20 {
        log.accel(0, row * 10_000, [0.0; 3], f32::NAN);
    }
    let (_, message) = refused(&log.bytes, "ulg", &Settings::default());
    for part in ["no row can be used; 19 rows of sensor_accel 0 have no temperature", "--temperature gives one"] {
        assert!(message.contains(part), "{message}");
    }
    let given = Settings { temperature: Some(31.5), ..Settings::default() };
    assert_eq!(converted(&log.bytes, "ulg", &given).0[3].accelerometers.head_temperature, [31.5; 3]);
}

#[test]
fn binary_and_text_of_dataflash_are_the_same() {
    let mut log = Dataflash::new();
    log.message("MSG", "QZ", "TimeUS,Message", &["5", "ArduCopter, V4.5.7, and commas"]);
    log.parameter("INS_ACCOFFS_X", 0.125).parameter("SCHED_LOOP_RATE", 400.0);
    for row in 0..50_u64 {
        let x = row as f32 / 64.0;
        log.imu(&ImuRow {
            time_us: row * 40_000,
            acceleration: [x, 0.5, -9.5],
            celsius: 20.0 + x,
            ..ImuRow::default()
        });
    }
    let (binary, told) = converted(&log.bytes, "bin", &Settings::default());
    let (text, told_text) = converted(log.text.as_bytes(), "log", &Settings::default());
    assert_eq!((binary.len(), &binary), (50, &text));
    assert_eq!(told, told_text);
    assert_eq!(pulses(&binary[32])[0], 625_000);
    // Text with the marks and ends of other systems.
    let other = format!("\u{feff}\r\n{}", log.text.replace('\n', "\r\n"));
    assert_eq!(converted(other.as_bytes(), "log", &Settings::default()).0, text);
}

/// What a console, or a card with older data, put before the log is passed over, and reported.
#[test]
fn what_stands_before_a_dataflash_log_is_passed_over() {
    let mut log = Dataflash::new();
    log.parameter("INS_ACCOFFS_X", 0.125);
    for row in 0..50_u64 {
        log.imu(&ImuRow { time_us: row * 40_000, ..ImuRow::default() });
    }
    let (right, told) = converted(&log.bytes, "bin", &Settings::default());
    for before in [&b"ArduCopter V3.2\r\nFree RAM: 1234\r\n"[..], &[0; 512], b"\xa3\x95", &[0xa3; 60_000]] {
        let (rows, more) = converted(&[before, &log.bytes].concat(), "bin", &Settings::default());
        assert_eq!(rows, right);
        let count = before.len();
        let damage =
            format!("warning [missing-rows]: {count} bytes are not messages of the log, the first is byte 0: ");
        assert!(more.starts_with(&damage) && more.ends_with(&told), "{more}");
    }
    let text = format!("ArduCopter V3.2\r\n\r\nFree RAM: 1234\r\n{}", log.text);
    let (rows, more) = converted(text.as_bytes(), "log", &Settings::default());
    assert_eq!(rows, right);
    assert!(
        more.starts_with("warning [missing-rows]: 2 lines are not messages of the log, the first is line 1"),
        "{more}"
    );
}

/// The same log as mavlogdump writes it, with all messages and with `--types IMU,PARM`.
#[test]
fn lines_of_json_are_a_dataflash_log() {
    let mut log = Dataflash::new();
    log.parameter("INS_ACCOFFS_X", 0.125);
    let letters = "s#EEEoooeeO----".to_owned();
    log.message("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", &["8", "131", &letters, "F-0000000000000"]);
    for row in 0..50_u64 {
        let celsius = 20.1 + row as f32 / 7.0;
        log.imu(&ImuRow { time_us: row * 40_000, instance: (row % 2) as u8, celsius, ..ImuRow::default() });
    }
    let mut names = std::collections::HashMap::from([("FMT", "Type,Length,Name,Format,Columns".to_owned())]);
    let mut json = String::from("WARNING: Numpy missing, mathematical notation will not be supported..\n");
    for line in log.text.lines() {
        let (name, rest) = line.split_once(", ").unwrap();
        if name == "FMT" {
            let fields: Vec<_> = rest.splitn(5, ", ").collect();
            names.insert(fields[2], fields[4].to_owned());
        }
        let columns: Vec<_> = names[name].split(',').collect();
        let data = columns.iter().zip(rest.splitn(columns.len(), ", ")).map(|(column, value)| {
            let is_number = value.parse::<f64>().is_ok();
            if is_number { format!("\"{column}\": {value}") } else { format!("\"{column}\": \"{value}\"") }
        });
        let data: Vec<_> = data.collect();
        writeln!(
            json,
            "{{\"meta\": {{\"type\": \"{name}\", \"timestamp\": 1700000000.25}}, \"data\": {{{}}}}}",
            data.join(", ")
        )
        .unwrap();
    }
    let second = Settings { instance: Some(1), ..Settings::default() };
    let (right, told) = converted(log.text.as_bytes(), "log", &second);
    assert_eq!(right.len(), 25);
    let (rows, more) = converted(json.as_bytes(), "json", &second);
    assert_eq!(rows, right);
    assert!(more.ends_with(&told), "{more}\n{told}");
    let is_chosen = |line: &&str| line.contains("\"type\": \"IMU\"") || line.contains("\"type\": \"PARM\"");
    let chosen: String = json.lines().filter(is_chosen).map(|line| format!("{line}\n")).collect();
    assert_eq!(converted(chosen.as_bytes(), "json", &second), (right.clone(), told.clone()));
    // A line that is cut, and a temperature that is none.
    let mut lines: Vec<_> = chosen.lines().map(str::to_owned).collect();
    lines[10].truncate(60);
    lines[20] = lines[20].replace("\"T\": 2", "\"T\": NaN, \"X\": 2");
    let (rows, more) = converted(lines.join("\n").as_bytes(), "json", &second);
    assert_eq!(rows.len(), 23, "{more}");
    assert!(more.contains("1 lines are not messages of the log, the first is line 11"), "{more}");
    assert!(more.contains("1 rows of IMU 1 have no temperature, the first is at line 21"), "{more}");
    // A telemetry log is none of the autopilot's own.
    let temperature = "{\"meta\": {\"type\": \"SCALED_IMU2\", \"timestamp\": 1.5}, \"data\": {\"xacc\": 1}}\n";
    let (exit, message) = refused(temperature.as_bytes(), "json", &Settings::default());
    assert!(exit == Exit::Data && message.contains("a telemetry log of MAVLink; as lines of JSON"), "{message}");
}

#[test]
fn old_logs_have_the_instance_in_the_name() {
    let mut log = Dataflash::new();
    let (letters, names) = (IMU_FORMAT.replacen('B', "", 1), IMU_NAMES.replace("I,", ""));
    for row in 0..10_u64 {
        for name in ["IMU", "IMU2"] {
            let time = (row * 20_000 + 1).to_string();
            let x = if name == "IMU" { "0.5" } else { "0.25" };
            let values = [&time, "0", "0", "0", x, "0", "9.5", "0", "0", "30", "1", "1", "1000", "1000"];
            log.message(name, &letters, &names, &values);
        }
    }
    let settings = Settings { instance: Some(1), ..Settings::default() };
    for (data, extension) in [(log.bytes.clone(), "bin"), (log.text.clone().into_bytes(), "log")] {
        let (samples, _) = converted(&data, extension, &settings);
        assert_eq!((samples.len(), pulses(&samples[9])[0]), (10, 250_000));
    }
}

#[test]
fn rows_that_are_ill_or_of_other_units_are_told() {
    let mut log = Dataflash::new();
    for row in 0..10 {
        log.imu(&ImuRow { time_us: row * 20_000, health: u8::from(row != 5), ..ImuRow::default() });
    }
    let (_, told) = converted(&log.bytes, "bin", &Settings::default());
    assert!(told.contains("warning [imu-error]: in 1 rows the IMU reports to be ill"), "{told}");
    log.message("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", &["1", "131", "s#EEEooo--O--zz", "F-000000-----00"]);
    assert_eq!(converted(&log.bytes, "bin", &Settings::default()).0.len(), 10);
    log.message("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", &["1", "131", "s#EEEGGG--O--zz", "F-000000-----00"]);
    let (_, message) = refused(&log.bytes, "bin", &Settings::default());
    assert!(message.contains("byte ") && message.contains("AccX of IMU is in another unit"), "{message}");
    let mut log = Dataflash::new();
    log.message("TCLR", "QBBffffI", "TimeUS,I,SType,Temp,X,Y,Z,NSamp", &["1", "0", "0", "30", "0", "0", "9.5", "100"]);
    let (exit, message) = refused(&log.bytes, "bin", &Settings::default());
    assert!(exit == Exit::Data && message.contains("no rows of IMU; rows of TCLR by themselves"), "{message}");
}

#[test]
fn topics_are_subscribed_to_where_they_begin() {
    let mut log = Ulog::empty();
    let sensor = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;\
                  float temperature;uint8_t[3] clip_counter;";
    for name in ["sensor_accel", "sensor_gyro"] {
        log.message(b'F', format!("{name}:{sensor}").as_bytes());
    }
    log.subscribe(0, 10, "sensor_gyro").gyro(0, 10_000, [0.0; 3], 20.0);
    log.subscribe(0, 0, "sensor_accel").accel(0, 10_000, [0.0, 0.0, -9.5], 20.0);
    for row in 2..=30 {
        log.gyro(0, row * 10_000, [0.0; 3], 20.0).accel(0, row * 10_000, [0.0, 0.0, -9.5], 20.0);
    }
    let (samples, told) = converted(&log.bytes, "ulg", &Settings::default());
    assert_eq!((samples.len(), samples[0].timestamp_ns), (30, 10_000_000));
    assert!(!told.contains("warning"), "{told}");
}
