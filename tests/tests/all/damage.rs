//! Recordings that are damaged, empty or cut short: what the commands say of them, and which rows they read.

use isotherm_client::{RawReader, RawSample};
use isotherm_tests::{Process, RUN, TIMEOUT, TestDomain, id, recording, text};
use rustix::process::Signal;
use std::fs;
use std::time::Instant;

const FILES: [&str; 2] = ["r.csv", "r.mcap"];

fn assert_contains(log: &str, text: &str) {
    assert!(log.contains(text), "{text:?} is not in:\n{log}");
}

/// Ends a recorder with SIGTERM and returns its log.
fn end(recorder: Process) -> String {
    recorder.signal(Signal::TERM);
    let (status, log) = recorder.wait();
    assert!(status.success(), "{status}\n{log}");
    log
}

/// Starts recorders into [`FILES`] that have seen the service.
fn record(domain: &TestDomain, more: &[&str]) -> [Process; 2] {
    let recorders =
        FILES.map(|file| domain.spawn(&[&["record", "--imu", "imu-a", "--flush", "0.05", "-o", file], more].concat()));
    recorders.iter().for_each(|recorder| recorder.wait_for_log("recording imu-a"));
    recorders
}

/// A recording of 600 rows in each format.
fn recorded(domain: &TestDomain) {
    let service = domain.serve_recording();
    let recorders = record(domain, &[]);
    let run = fs::read_to_string(RUN).unwrap();
    domain.write("short.csv", &run.lines().take(601).map(|line| format!("{line}\n")).collect::<String>());
    // Slow enough that several flushes, which make chunks, come between.
    domain.run_ok(&["feed", "--imu", "imu-a", "--rate", "1500", "short.csv", "-o", "fed.csv"]);
    for recorder in recorders {
        assert_contains(&end(recorder), "imu-a raw: 600 rows of 1 session, 0 missing, 0 repeats");
    }
    service.terminate();
}

/// The place of a text in bytes, after `skip` others.
fn place_of(bytes: &[u8], text: &[u8], skip: usize) -> usize {
    let places = (0..bytes.len() - text.len()).filter(|place| bytes[*place..].starts_with(text));
    places.into_iter().nth(skip).unwrap()
}

/// Exit code, stdout and stderr.
fn run(domain: &TestDomain, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = domain.run(arguments);
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_damaged_place_is_left_out_and_named() {
    let domain = TestDomain::new();
    recorded(&domain);
    let exact = domain.run_ok(&["replay", "--table", "imu-a.toml", "short.csv"]);
    for (file, least) in [("r.csv", 599), ("r.mcap", 150)] {
        let (code, said, _) = run(&domain, &["check", file]);
        assert!(code == Some(0) && said.contains("600 rows"), "{said}");
        let mut bytes = fs::read(domain.path(file)).unwrap();
        let place = match file {
            // Within the second chunk, in its records.
            "r.mcap" => place_of(&bytes, b"zstd", 1) + 100,
            _ => bytes.len() / 2,
        };
        // No number has this letter.
        bytes[place] = b'x';
        let bad = format!("bad-{file}");
        fs::write(domain.path(&bad), &bytes).unwrap();
        let (code, replayed, said) = run(&domain, &["replay", "--table", "imu-a.toml", &bad]);
        assert_eq!(code, Some(0), "{said}");
        assert_contains(&said, "bad-rows");
        let rows = replayed.lines().count() - 1;
        assert!((least..600).contains(&rows), "{file}: {rows}");
        // The answers to what is there are what they were, with their own times.
        assert!(replayed.lines().all(|line| exact.lines().any(|own| own == line)), "{file}");
        for command in [&["replay", "--table", "imu-a.toml", "--strict"][..], &["check"]] {
            let (code, _, said) = run(&domain, &[command, &[&bad]].concat());
            assert_eq!(code, Some(65), "{file}: {said}");
            assert_contains(&said, "bad-rows");
        }
    }
}

/// Recordings in CSV had a column `check` once, which means nothing now.
#[test]
fn a_column_that_nobody_knows_is_ignored() {
    let domain = TestDomain::new();
    recorded(&domain);
    let exact = domain.run_ok(&["replay", "--table", "imu-a.toml", "r.csv"]);
    let own = fs::read_to_string(domain.path("r.csv")).unwrap();
    let rows = own.lines().enumerate();
    let checked: String =
        rows.map(|(row, line)| line.to_owned() + if row == 0 { ",check\n" } else { ",00000000\n" }).collect();
    domain.write("checked.csv", &checked);
    assert_eq!(domain.run_ok(&["replay", "--table", "imu-a.toml", "checked.csv"]), exact);
}

#[test]
fn parquet_is_refused_with_the_lines_of_python_that_read_and_write_it() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", isotherm_tests::TABLE);
    domain.write("r.parquet", "PAR1\0\0PAR1");
    for command in [&["replay", "--table", "imu-a.toml", "r.parquet"][..], &["check", "r.parquet"]] {
        let (code, _, said) = run(&domain, command);
        assert!(code == Some(65) && said.contains("isotherm.from_arrow"), "{command:?} {said}");
    }
    let convert = ["convert", RUN, "-o", "new.parquet"];
    for command in [&["record", "--imu", "imu-a", "-o", "new.parquet"][..], &convert] {
        let (code, _, said) = run(&domain, command);
        assert!(code == Some(64) && said.contains("isotherm.to_arrow"), "{command:?} {said}");
    }
}

#[test]
fn increments_without_a_whole_row_are_refused_by_their_first_row() {
    let domain = TestDomain::new();
    domain
        .write("increments.csv", "sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags\n0,1,x,1,2,3,0,0\n");
    let (code, _, said) = run(&domain, &["check", "increments.csv"]);
    assert!(code == Some(65) && said.starts_with("isotherm: increments.csv:2: "), "{said}");
    domain.write("neither.csv", "sequence,timestamp_ns,other\n0,1,2\n");
    let (code, _, said) = run(&domain, &["check", "neither.csv"]);
    assert!(code == Some(65) && said.starts_with("isotherm: neither.csv:1: missing columns: interval_ns"), "{said}");
}

#[test]
fn an_empty_file_is_called_empty() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", isotherm_tests::TABLE);
    for file in FILES {
        domain.write(file, "");
        for command in [&["replay", "--table", "imu-a.toml", file][..], &["check", file]] {
            let (code, _, said) = run(&domain, command);
            assert_eq!((code, said), (Some(65), format!("isotherm: {file}: the file is empty\n")), "{command:?}");
        }
    }
}

#[test]
fn a_recorder_that_cannot_start_leaves_nothing_behind() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    // All places of readers.
    let readers: Vec<_> = (0..64).map_while(|_| RawReader::connect(id("imu-a"), &domain.options()).ok()).collect();
    assert!((4..64).contains(&readers.len()), "{}", readers.len());
    for file in FILES {
        let (code, _, said) = run(&domain, &["record", "--imu", "imu-a", "-o", file]);
        assert_eq!(code, Some(1), "{said}");
        assert_contains(&said, "reader places are taken");
        assert!(!said.contains("0 rows"), "nothing was recorded: {said}");
    }
    let left = || {
        let names = fs::read_dir(domain.path("")).unwrap().map(|entry| entry.unwrap().file_name());
        names.filter(|name| name.to_string_lossy().contains("r.")).count()
    };
    assert_eq!(left(), 0);
    drop(readers);
    record(&domain, &[]).into_iter().for_each(|recorder| drop(end(recorder)));
    service.terminate();
}

/// A recorder that got no row, as one that was killed while it waited, leaves a file that the next one replaces.
#[test]
fn a_recording_without_rows_blocks_no_later_start() {
    let domain = TestDomain::new();
    let start = |file: &str| {
        let recorder = domain.spawn(&["record", "--imu", "imu-a", "--flush", "0.05", "-o", file]);
        recorder.wait_for_log("waiting for a service");
        recorder
    };
    for file in FILES {
        start(file).kill();
        assert!(domain.path(file).exists());
        let second = start(file);
        // While a recorder waits for rows, its file is not free.
        let (code, _, said) = run(&domain, &["record", "--imu", "imu-a", "-o", file]);
        assert_eq!(code, Some(74), "{said}");
        assert_contains(&said, "exists; a recording is never replaced");
        end(second);
    }
    let service = domain.serve_recording();
    let recorders = record(&domain, &[]);
    let mut acquisition = domain.acquisition("imu-a");
    let samples = recording();
    for sample in &samples[..50] {
        isotherm_tests::round_trip(&mut acquisition, sample);
    }
    for recorder in recorders {
        assert_contains(&end(recorder), "imu-a raw: 50 rows of 1 session, 0 missing");
    }
    for file in FILES {
        let (code, ..) = run(&domain, &["record", "--imu", "imu-a", "-o", file]);
        assert_eq!(code, Some(74), "it has rows");
    }
    service.terminate();
}

/// The disk has no room for more until the end: the summary counts what is in the files, and the rest as missing.
#[test]
fn the_summary_counts_the_rows_that_are_in_the_files() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for file in ["r.csv", "r.mcap"] {
        // In blocks of 512 bytes: more than shared memory needs.
        let arguments = ["record", "--imu", "imu-a", "-o", file, "--flush", "0.05"];
        let recorder = domain.start(domain.isotherm_after(&[], "ulimit -f 3000", &arguments));
        recorder.wait_for_log("recording imu-a");
        let (mut acquisition, samples) = (domain.acquisition("imu-a"), recording());
        let deadline = Instant::now() + TIMEOUT;
        let mut sent = 0;
        while recorder.count_in_log("File too large") == 0 {
            assert!(Instant::now() < deadline, "the file does not reach the limit");
            let raw = RawSample { sequence: sent, ..samples[sent as usize % samples.len()] };
            isotherm_tests::round_trip(&mut acquisition, &raw);
            sent += 1;
        }
        let (status, log) = recorder.wait();
        assert_eq!(status.code(), Some(74), "{log}");
        let totals = |stream: &str| {
            let counts = log.split(&format!("imu-a {stream}: ")).nth(1).unwrap();
            counts.split([' ', ',']).filter_map(|word| word.parse().ok()).take(3).collect::<Vec<u64>>()
        };
        let in_files = |stream: &str| {
            let name = if stream == "raw" || file == "r.mcap" { file } else { "r.increments.csv" };
            let (code, said, error) = run(&domain, &["check", name]);
            assert_eq!(code, Some(0), "{error}");
            let rows = said.rsplit(stream).next().unwrap().trim_start_matches(['s', ':', ' ']);
            rows.split(' ').next().unwrap().parse::<u64>().unwrap()
        };
        let mut lost = 0;
        for stream in ["raw", "increment"] {
            let [rows, sessions, missing] = totals(stream)[..] else { panic!("{log}") };
            assert_eq!((rows, sessions), (in_files(stream), 1), "{file} {stream}: {log}");
            lost += missing;
        }
        assert!(lost > 0, "{log}");
        assert_contains(&log, "rows at the end could not be written; they are missing");
        drop(acquisition);
    }
    service.terminate();
}

/// Pieces of a flight whose wall clock was set back.
#[test]
fn pieces_are_in_order_of_their_sequences_whatever_the_clock_says() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", isotherm_tests::TABLE);
    let run_rows = fs::read_to_string(RUN).unwrap();
    let (header, rows) = run_rows.split_once('\n').unwrap();
    let rows: Vec<_> = rows.lines().take(900).collect();
    let mut names = Vec::new();
    // The clock is set back by an hour in the second piece.
    for (number, piece) in rows.chunks(300).enumerate() {
        let began = if number == 0 { 9_000_000_000_000_u64 } else { 5_400_000_000_000 + number as u64 * 1_000_000_000 };
        let row = |(at, row): (usize, &&str)| format!("{},77,{row}\n", began + at as u64 * 2_500_000);
        let text: String = piece.iter().enumerate().map(row).collect();
        let name = format!("flight-{number}.csv");
        domain.write(&name, &format!("recorded_ns,session,{header}\n{text}"));
        names.push(name);
    }
    domain.write("whole.csv", &format!("{header}\n{}\n", rows.join("\n")));
    let whole = domain.run_ok(&["replay", "--table", "imu-a.toml", "whole.csv"]);
    for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0]] {
        let pieces = order.map(|place: usize| names[place].as_str());
        let replay = [&["replay", "--table", "imu-a.toml"][..], &pieces].concat();
        assert!(domain.run_ok(&replay) == whole, "{order:?}");
        let regress =
            [&["regress", "--x", "sequence", "--y", "timestamp_ns", "--max-order", "1"][..], &pieces].concat();
        assert_eq!(domain.run(&regress).status.code(), Some(0));
    }
    // Rows that are there twice are refused, also where another session lies between.
    fs::copy(domain.path("flight-1.csv"), domain.path("again.csv")).unwrap();
    let other = fs::read_to_string(domain.path("flight-2.csv")).unwrap().replace(",77,", ",78,");
    domain.write("other.csv", &other);
    let (code, _, said) = run(&domain, &["replay", "--table", "imu-a.toml", "flight-1.csv", "other.csv", "again.csv"]);
    assert_eq!(code, Some(65), "{said}");
    assert_contains(&said, "the piece before is flight-1.csv: leave out the rows that are in both");
}
