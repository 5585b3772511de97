//! Recordings of a whole IMU: `feed` and `replay` agree to the last byte and with exact increments, `record` keeps
//! everything in every format, and the lag and the device of a recording reach the service.

use isotherm_recording::csv::Rows;
use isotherm_recording::{Layout, RawCsvReader, RawCsvWriter};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{RawSample, Triad, device};
use isotherm_tests::{
    TABLE, TIMEOUT, TestDomain, WHOLE_TABLE, completed, may_mount, text, wait_until, whole_recording,
};
use rustix::process::Signal;
use std::io::{BufWriter, pipe};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::{fs, thread};

const RUN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/run-g.csv");
const RUN_DOUBLE: &str = include_str!("../../data/run-g.double.csv");
const REPLAY: [&str; 3] = ["replay", "--table", "imu-g.toml"];
const FEED: [&str; 3] = ["feed", "--imu", "imu-g"];
const LAG_NS: u64 = 240_000_000_000;

/// The values of these columns of a CSV text, row by row.
fn columns(text: &str, names: &[&str]) -> Vec<Vec<String>> {
    let mut rows = Rows::new(text.as_bytes());
    assert!(rows.next_row().unwrap());
    let columns = rows.columns(names, "").unwrap();
    let mut found = Vec::new();
    while rows.next_row().unwrap() {
        let value = |column| rows.parse(column, "", |text| Some(text.to_owned())).unwrap();
        found.push(columns.iter().map(value).collect());
    }
    found
}

/// Writes samples as a recording.
fn write(domain: &TestDomain, name: &str, telemetry_ns: bool, layout: Layout, samples: &[RawSample]) {
    let mut writer = RawCsvWriter::with_layout(Vec::new(), "", telemetry_ns, layout).unwrap();
    samples.iter().for_each(|raw| writer.write("", raw).unwrap());
    fs::write(domain.path(name), writer.finish().unwrap()).unwrap();
}

const GYROSCOPES: Layout = Layout { device: false, gyroscopes: true, lag: false, unix_offset: false };
const WITH_LAG: Layout = Layout { lag: true, ..GYROSCOPES };
const WITH_DEVICE: Layout = Layout { device: true, ..GYROSCOPES };

/// The rows of a recording, which may still grow. One that has no whole beginning yet counts as empty.
fn rows(domain: &TestDomain, files: &[&str]) -> usize {
    let replayed = domain.run(&[&REPLAY[..], files].concat());
    if replayed.status.success() { text(&replayed.stdout).lines().count() - 1 } else { 0 }
}

/// The flags of increments, each with its count.
fn flags(increments: &str) -> Vec<(String, usize)> {
    let mut counted: Vec<(String, usize)> = Vec::new();
    for row in columns(increments, &["flags"]) {
        match counted.iter_mut().find(|(name, _)| *name == row[0]) {
            Some((_, count)) => *count += 1,
            None => counted.push((row[0].clone(), 1)),
        }
    }
    counted
}

#[test]
fn feed_and_replay_give_the_exact_increments_of_a_whole_imu() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let replayed = domain.run(&[&REPLAY[..], &[RUN]].concat());
    assert!(replayed.status.success(), "{}", text(&replayed.stderr));
    // The last line on stderr counts the flags, those of the gyroscopes too.
    let summary = text(&replayed.stderr).lines().last().unwrap().to_owned();
    for name in ["2000 increments, ", "lag-unknown ", "g-unknown ", "g1-head-below ", "g3-not-finite ", "g1-rate "] {
        assert!(summary.contains(name), "{name:?} is not in: {summary}");
    }
    let increments = text(&replayed.stdout);
    assert!(
        increments.starts_with("sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,g1_da,g2_da,g3_da,table,flags\n")
    );
    let (own, exact) = (numbers(&increments), numbers(RUN_DOUBLE));
    assert_eq!((own.len(), exact.len()), (2000, 2000));
    for (own, exact) in own.iter().zip(&exact) {
        assert_eq!(own, exact);
    }
    assert!(domain.run_ok(&[&FEED[..], &[RUN]].concat()) == increments);
    service.terminate();
}

/// Sequence, the bits of the increments and the flags, row by row. A text has one NaN.
fn numbers(text: &str) -> Vec<(String, Vec<u64>, String)> {
    let names = ["sequence", "a1_dv", "a2_dv", "a3_dv", "g1_da", "g2_da", "g3_da", "flags"];
    let bits = |text: &String| text.parse::<f64>().map(|value| if value.is_nan() { u64::MAX } else { value.to_bits() });
    let row =
        |row: Vec<String>| (row[0].clone(), row[1..7].iter().map(|text| bits(text).unwrap()).collect(), row[7].clone());
    columns(text, &names).into_iter().map(row).collect()
}

#[test]
fn every_format_keeps_a_whole_imu() {
    let domain = TestDomain::new();
    let files = ["r.csv", "r.mcap"];
    let recorders = files.map(|file| domain.spawn(&["record", "--imu", "imu-g", "--flush", "0.05", "-o", file]));
    recorders.iter().for_each(|recorder| recorder.wait_for_log("waiting for a service that serves imu-g"));
    let service = domain.serve_whole();
    recorders.iter().for_each(|recorder| recorder.wait_for_log("recording imu-g"));
    let exact = domain.run_ok(&[&REPLAY[..], &[RUN]].concat());
    let samples: Vec<_> = RawCsvReader::new(fs::File::open(RUN).unwrap()).unwrap().map(Result::unwrap).collect();
    let mut acquisition = domain.acquisition("imu-g");
    for (part, chunk) in samples.chunks(400).enumerate() {
        for sample in chunk {
            let mut loan = acquisition.loan().unwrap();
            *loan = RawSample { session: loan.session, device: device("S/N 7"), ..*sample };
            acquisition.compensate(loan, TIMEOUT).unwrap();
        }
        // Wait after each part, so that no queue overflows on a slow machine.
        files.iter().for_each(|file| wait_until("the recorder", || rows(&domain, &[file]) == part * 400 + chunk.len()));
    }
    drop(acquisition);
    for recorder in recorders {
        recorder.signal(Signal::TERM);
        let (status, log) = recorder.wait();
        assert!(status.success(), "{log}");
        for stream in ["raw", "increment"] {
            assert!(log.contains(&format!("imu-g {stream}: 2000 rows of 1 session, 0 missing, 0 repeats")), "{log}");
        }
        assert!(log.contains(" 2 files, ") || log.contains(" 1 file, "), "no file more than the streams have: {log}");
    }
    for file in files {
        assert!(domain.run_ok(&[&REPLAY[..], &[file]].concat()) == exact, "{file}");
        assert!(domain.run_ok(&[&FEED[..], &[file]].concat()) == exact, "{file}");
    }
    // The recorded increments equal the replayed ones, line by line; the raw samples know their unit.
    let increments = fs::read_to_string(domain.path("r.increments.csv")).unwrap();
    let of_replay = |line: &str| line.split(',').skip(2).take(11).collect::<Vec<_>>().join(",");
    assert!(increments.lines().map(of_replay).eq(exact.lines()), "recorded_ns and session come first");
    let raw = fs::read_to_string(domain.path("r.csv")).unwrap();
    let unit = format!("{:016x}", device("S/N 7"));
    assert!(columns(&raw, &["device"]).iter().all(|row| row[0] == unit));
    service.terminate();
}

/// Without lagged columns both compute the lag: with the time constant of the table in force, a given one, or none.
#[test]
fn feed_and_replay_compute_the_same_lag() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let samples = whole_recording(600);
    write(&domain, "bare.csv", false, GYROSCOPES, &samples);
    let timed: Vec<_> =
        samples.iter().map(|raw| RawSample { telemetry_ns: raw.timestamp_ns / 7 * 7, ..*raw }).collect();
    write(&domain, "timed.csv", true, GYROSCOPES, &timed);
    let of = |command: &[&str; 3], more: &[&str]| domain.run_ok(&[&command[..], more].concat());
    let mut all = Vec::new();
    for file in ["bare.csv", "timed.csv"] {
        for lag in [&[][..], &["--lag", "240"], &["--lag", "60.5"], &["--lag", "none"]] {
            let more = [lag, &[file]].concat();
            let replayed = of(&REPLAY, &more);
            assert!(of(&FEED, &more) == replayed, "{more:?}");
            let unknown = lag.last().is_some_and(|lag| ["60.5", "none"].contains(lag));
            let expected = if unknown { "lag-unknown" } else { "-" };
            assert_eq!(flags(&replayed), [(expected.to_owned(), 600)], "{more:?}");
            all.push(replayed);
        }
    }
    assert!(
        all[0] == all[1] && all[4] == all[5] && all[2] == all[3],
        "the table's is 240 s; without its own there is no term"
    );
    assert!(all[0] != all[2] && all[0] != all[4], "the lag matters, and so does when the temperature was read");
    // A recording that has the lag is used as it is.
    write(&domain, "lagged.csv", false, WITH_LAG, &completed(&samples, LAG_NS, ""));
    for lag in [&[][..], &["--lag", "60.5"], &["--lag", "none"]] {
        let more = [lag, &["lagged.csv"]].concat();
        assert!(of(&REPLAY, &more) == all[0] && of(&FEED, &more) == all[0], "{more:?}");
    }
    for wrong in ["0", "-1", "1e9", "soon", "NONE"] {
        for command in [REPLAY, FEED] {
            let output = domain.run(&[&command[..], &["--lag", wrong, "bare.csv"]].concat());
            assert_eq!(output.status.code(), Some(64), "{wrong}: {}", text(&output.stderr));
        }
    }
    service.terminate();
}

/// After a reload with another time constant, a running feed asks for it: some samples are flagged, then none.
#[test]
fn a_running_feed_takes_the_time_constant_of_a_new_table() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let (samples, sink) = pipe().unwrap();
    let mut command = domain.isotherm_after(&[], "exec > out.csv", &[&FEED[..], &["--rate", "1000", "-"]].concat());
    command.stdin(Stdio::from(samples));
    let feed = domain.start(command);
    let enough = Arc::<AtomicBool>::default();
    let stop = Arc::clone(&enough);
    let writer = thread::spawn(move || {
        let first = whole_recording(1)[0];
        let mut writer = RawCsvWriter::with_layout(BufWriter::new(sink), "", false, GYROSCOPES).unwrap();
        let mut sequence = 0;
        while !stop.load(Ordering::Relaxed) {
            let timestamp_ns = first.timestamp_ns * (sequence + 1);
            writer.write("", &RawSample { sequence, timestamp_ns, ..first }).unwrap();
            sequence += 1;
        }
        drop(writer.finish().unwrap());
    });
    // The table and the flags of each row that has come, each pair whenever it changes.
    let seen = |name: &str| {
        let text = fs::read_to_string(domain.path(name)).unwrap_or_default();
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let mut rows = if whole.is_empty() { Vec::new() } else { columns(whole, &["table", "flags"]) };
        rows.dedup();
        rows
    };
    let other = WHOLE_TABLE.replace("time_constant_s = 240.0", "time_constant_s = 30.0");
    let [first, second] =
        [WHOLE_TABLE, &other].map(|text| format!("{:016x}", CoefficientTable::from_toml(text, None).unwrap().id()));
    let row = |table: &str, flags: &str| vec![table.to_owned(), flags.to_owned()];
    wait_until("the first increments", || seen("out.csv") == [row(&first, "-")]);
    domain.replace("imu-g.toml", &other);
    wait_until("increments with the new lag", || seen("out.csv").last() == Some(&row(&second, "-")));
    enough.store(true, Ordering::Relaxed);
    writer.join().unwrap();
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    assert_eq!(seen("out.csv"), [row(&first, "-"), row(&second, "lag-unknown"), row(&second, "-")]);
    service.terminate();
}

#[test]
fn the_unit_of_a_recording_is_compared_with_the_tables() {
    let domain = TestDomain::new();
    let table = WHOLE_TABLE.replace("gravity =", "serial = \"S/N 7\"\ngravity =");
    domain.write("imu-g.toml", &table);
    let service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
    let samples = whole_recording(40);
    write(&domain, "unknown.csv", false, GYROSCOPES, &samples);
    for (file, serial) in [("same.csv", " S/N 7 "), ("other.csv", "S/N 8")] {
        let known: Vec<_> = samples.iter().map(|raw| RawSample { device: device(serial), ..*raw }).collect();
        write(&domain, file, false, WITH_DEVICE, &known);
    }
    for (file, expected) in [("unknown.csv", "-"), ("same.csv", "-"), ("other.csv", "other-device")] {
        let replayed = domain.run(&[&REPLAY[..], &[file]].concat());
        assert!(replayed.status.success());
        let (increments, log) = (text(&replayed.stdout), text(&replayed.stderr));
        assert_eq!(flags(&increments), [(expected.to_owned(), 40)], "{file}");
        let warning = ".csv: 40 samples are of another device than the table's, which has the serial number \"S/N 7\"";
        assert_eq!(log.contains(warning), expected != "-", "{log}");
        assert!(domain.run_ok(&[&FEED[..], &[file]].concat()) == increments, "{file}");
    }
    // The operator knows better than the recording.
    for (file, serial, expected) in [
        ("unknown.csv", "S/N 7", "-"),
        ("unknown.csv", "S/N 8", "other-device"),
        ("other.csv", "S/N 7", "-"),
        ("same.csv", "S/N 8", "other-device"),
    ] {
        let fed = domain.run_ok(&[&FEED[..], &["--serial", serial, file]].concat());
        assert_eq!(flags(&fed), [(expected.to_owned(), 40)], "{file} {serial}");
    }
    for nothing in ["", " \t"] {
        let refused = domain.run(&[&FEED[..], &["--serial", nothing, "other.csv"]].concat());
        assert_eq!(refused.status.code(), Some(64));
        assert!(text(&refused.stderr).contains("give the device's serial number, or leave --serial out"));
    }
    service.terminate();
}

/// A table without gyroscopes gives the same increments for a whole IMU as for only its accelerometers.
#[test]
fn an_accelerometers_table_gives_no_angles() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    write(&domain, "whole.csv", false, GYROSCOPES, &whole_recording(40));
    write(&domain, "half.csv", false, Layout::default(), &whole_recording(40));
    let replay = |file| domain.run_ok(&["replay", "--table", "imu-a.toml", file]);
    let increments = replay("half.csv");
    assert!(increments.starts_with("sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags\n"));
    assert!(replay("whole.csv") == increments);
    for file in ["half.csv", "whole.csv"] {
        assert!(domain.run_ok(&["feed", "--imu", "imu-a", file]) == increments, "{file}");
    }
    // The other way round: there is nothing to compute angles from.
    domain.write("imu-g.toml", WHOLE_TABLE);
    let replayed = domain.run_ok(&[&REPLAY[..], &["half.csv"]].concat());
    let expected = "g1-not-finite|g2-not-finite|g3-not-finite";
    assert!(columns(&replayed, &["flags"]).iter().all(|row| row[0] == expected), "{replayed}");
    let angles = columns(&replayed, &["g1_da", "g2_da", "g3_da"]);
    assert!(angles.iter().flatten().all(|angle| angle == "NaN"), "{replayed}");
    let velocities = columns(&replayed, &["a1_dv", "a2_dv", "a3_dv"]);
    assert!(velocities.iter().flatten().all(|velocity| velocity != "NaN"), "{replayed}");
    service.terminate();
}

#[test]
fn gyroscopes_that_only_a_recording_or_only_a_table_has_are_warned_of() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    domain.write("imu-g.toml", WHOLE_TABLE);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-g=imu-g.toml"]);
    write(&domain, "half.csv", false, Layout::default(), &whole_recording(40));
    write(&domain, "whole.csv", false, GYROSCOPES, &whole_recording(40));
    let zeroed: Vec<_> =
        whole_recording(40).iter().map(|raw| RawSample { gyroscopes: Triad::default(), ..*raw }).collect();
    write(&domain, "zeros.csv", false, GYROSCOPES, &zeroed);
    let missing = "has no gyroscopes, but the table has; the angle increments are NaN and flagged";
    let lacking = "has gyroscopes, but the table has none; there are no angle increments";
    let zeros = "all values of gyroscopes in the recording are 0; the angle increments mean nothing";
    let cases = [
        ("imu-g", "half.csv", missing),
        ("imu-g", "whole.csv", ""),
        ("imu-g", "zeros.csv", zeros),
        ("imu-a", "half.csv", ""),
        ("imu-a", "whole.csv", lacking),
    ];
    for (imu, file, cause) in cases {
        let table = format!("{imu}.toml");
        let replay = ["replay", "--table", &table, file];
        for command in [&replay[..], &["feed", "--imu", imu, file]] {
            let output = domain.run(command);
            let log = text(&output.stderr);
            let warnings = log.lines().filter(|line| line.contains("warning [no-gyroscopes]: from sequence 0 on "));
            let warnings: Vec<_> = warnings.collect();
            assert!(output.status.success() && warnings.len() == usize::from(!cause.is_empty()), "{command:?}: {log}");
            assert!(warnings.iter().all(|line| line.contains(cause)), "{command:?}: {log}");
        }
    }
    service.terminate();
}

/// An acquisition that learns more while it is recorded: the rows go on in the next file, and nothing is lost. A pipe
/// goes on without.
#[test]
fn columns_that_come_late_go_on_in_the_next_file() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let csv = domain.spawn(&["record", "--imu", "imu-g", "--flush", "0.05", "-o", "r.csv"]);
    let mcap = domain.spawn(&["record", "--imu", "imu-g", "--flush", "0.05", "-o", "r.mcap"]);
    let piped =
        domain.isotherm_after(&[], "exec > out.csv", &["record", "--imu", "imu-g", "-o", "-", "--flush", "0.05"]);
    let piped = domain.start(piped);
    [&csv, &mcap, &piped].iter().for_each(|recorder| recorder.wait_for_log("recording imu-g"));
    let samples = whole_recording(80);
    let known: Vec<_> = samples[40..].iter().map(|raw| RawSample { device: 7, ..*raw }).collect();
    let mut acquisition = domain.acquisition("imu-g");
    let mut send = |samples: &[RawSample]| {
        for sample in samples {
            let mut loan = acquisition.loan().unwrap();
            *loan = RawSample { session: loan.session, ..*sample };
            acquisition.compensate(loan, TIMEOUT).unwrap();
        }
    };
    send(&samples[..40]);
    // The header is written to standard output together with the first rows.
    let printed = || fs::metadata(domain.path("out.csv")).unwrap().len() > 0 && rows(&domain, &["out.csv"]) == 40;
    wait_until("the first rows", || rows(&domain, &["r.csv"]) == 40 && rows(&domain, &["r.mcap"]) == 40 && printed());
    send(&known);
    wait_until("rows without the device", || rows(&domain, &["out.csv"]) == 80);
    piped.signal(Signal::TERM);
    let (status, log) = piped.wait();
    assert!(status.success() && log.contains("imu-g raw: 80 rows of 1 session, 0 missing"), "{log}");
    assert_eq!(
        log.matches("warning: imu-g now has more columns than the header on stdout; they are left out").count(),
        1
    );
    csv.wait_for_log("imu-g now has more columns; they begin in r-0002.csv");
    wait_until("all rows", || rows(&domain, &["r.csv", "r-0002.csv"]) == 80 && rows(&domain, &["r.mcap"]) == 80);
    for recorder in [csv, mcap] {
        recorder.signal(Signal::TERM);
        let (status, log) = recorder.wait();
        assert!(status.success() && log.contains("imu-g raw: 80 rows of 1 session, 0 missing"), "{log}");
    }
    assert!(
        domain.run_ok(&[&REPLAY[..], &["r-0002.csv", "r.csv"]].concat())
            == domain.run_ok(&[&REPLAY[..], &["r.mcap"]].concat())
    );
    let later = fs::read_to_string(domain.path("r-0002.csv")).unwrap();
    assert_eq!(columns(&later, &["device"]), vec![vec!["0000000000000007".to_owned()]; 40]);
    service.terminate();
}

/// The disk is full when the rows need the next files: they wait for room, as at any other time.
#[test]
fn a_full_disk_delays_the_next_file() {
    if !may_mount() {
        return;
    }
    {
        let extension = "csv";
        let domain = TestDomain::new();
        let service = domain.serve_whole();
        fs::create_dir(domain.path("small")).unwrap();
        let name = format!("small/r.{extension}");
        let arguments = ["record", "--imu", "imu-g", "-o", &name, "--flush", "0.05"];
        let recorder =
            domain.start(domain.isotherm_after(&["-m"], "mount -t tmpfs -o size=1m tmpfs small", &arguments));
        recorder.wait_for_log("recording imu-g");
        let small = format!("/proc/{}/root{}", recorder.pid(), domain.path("small").display());
        let inside = |file: &str| format!("{small}/{file}");
        let samples = whole_recording(80);
        let mut acquisition = domain.acquisition("imu-g");
        let mut send = |samples: &[RawSample]| {
            for sample in samples {
                let mut loan = acquisition.loan().unwrap();
                *loan = RawSample { session: loan.session, ..*sample };
                acquisition.compensate(loan, TIMEOUT).unwrap();
            }
        };
        send(&samples[..40]);
        wait_until("the first rows", || {
            ["r", "r.increments"].iter().all(|name| {
                let copy = format!("{name}.{extension}");
                fs::copy(inside(&copy), domain.path(&copy)).unwrap();
                match *name {
                    "r" => rows(&domain, &[&copy]) == 40,
                    _ => fs::metadata(domain.path(&copy)).unwrap().len() > 0,
                }
            })
        });
        assert!(fs::write(inside("fill"), vec![0; 2 << 20]).is_err());
        let known: Vec<_> = samples[40..].iter().map(|raw| RawSample { device: 7, ..*raw }).collect();
        send(&known);
        recorder.wait_for_log("No space left on device");
        fs::remove_file(inside("fill")).unwrap();
        recorder.wait_for_log(&format!("imu-g now has more columns; they begin in small/r-0002.{extension}"));
        recorder.wait_for_log("there is room again");
        let pieces = [format!("r.{extension}"), format!("r-0002.{extension}")];
        wait_until("all rows", || {
            for piece in &pieces {
                fs::copy(inside(piece), domain.path(piece)).unwrap();
            }
            rows(&domain, &[&pieces[0], &pieces[1]]) == 80
        });
        recorder.signal(Signal::TERM);
        let (status, log) = recorder.wait();
        for stream in ["raw", "increment"] {
            assert!(log.contains(&format!("imu-g {stream}: 80 rows of 1 session, 0 missing")), "{log}");
        }
        assert!(status.success() && log.matches("No space left on device").count() == 1, "{log}");
        service.terminate();
    }
}
