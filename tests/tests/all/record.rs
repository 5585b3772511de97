//! Recording in all formats, with restarts, kills, a stalled recorder, rotation and a full disk.
//!
//! Over 400 lines: every test uses how a recorder is started, fed and read.

use isotherm_client::{Acquisition, RawSample};
use isotherm_tests::{Process, RUN, TABLE, TIMEOUT, TestDomain, may_mount, recording, text, wait_until};
use rustix::process::Signal;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const FILES: [&str; 2] = ["r.csv", "r.mcap"];

/// Starts a recorder of `imu-a` that flushes every 50 ms.
fn record(domain: &TestDomain, more: &[&str]) -> Process {
    record_flushing(domain, "0.05", more)
}

fn record_flushing(domain: &TestDomain, seconds: &str, more: &[&str]) -> Process {
    domain.spawn(&[&["record", "--imu", "imu-a", "--flush", seconds], more].concat())
}

/// Writes the first rows of the recording to a file and returns its name.
fn shortened(domain: &TestDomain, rows: usize) -> &'static str {
    let text = fs::read_to_string(RUN).unwrap();
    domain.write("short.csv", &text.lines().take(rows + 1).map(|line| format!("{line}\n")).collect::<String>());
    "short.csv"
}

/// Sends samples with the recording's sequences and waits for each answer.
fn send(acquisition: &mut Acquisition, samples: &[RawSample]) {
    for sample in samples {
        let mut loan = acquisition.loan().unwrap();
        *loan = RawSample { session: loan.session, ..*sample };
        acquisition.compensate(loan, TIMEOUT).unwrap();
    }
}

/// The increments of a replayed recording, as CSV.
fn replay(domain: &TestDomain, file: &str) -> String {
    domain.run_ok(&["replay", "--table", "imu-a.toml", file])
}

/// The rows of a recording, which may still grow.
fn rows(domain: &TestDomain, file: &str) -> usize {
    let replayed = domain.run(&["replay", "--table", "imu-a.toml", file]);
    if replayed.status.success() { text(&replayed.stdout).lines().count() - 1 } else { 0 }
}

/// Ends a recorder with SIGTERM and returns its log.
fn end(recorder: Process) -> String {
    recorder.signal(Signal::TERM);
    let (status, log) = recorder.wait();
    assert!(status.success(), "{status}\n{log}");
    log
}

fn assert_contains(log: &str, text: &str) {
    assert!(log.contains(text), "{text:?} is not in:\n{log}");
}

#[test]
fn every_format_holds_every_sample_and_every_answer() {
    let domain = TestDomain::new();
    let recorders = FILES.map(|file| record(&domain, &["-o", file]));
    recorders.iter().for_each(|recorder| recorder.wait_for_log("waiting for a service that serves imu-a"));
    let service = domain.serve_recording();
    recorders.iter().for_each(|recorder| recorder.wait_for_log("recording imu-a"));
    let (mut acquisition, samples) = (domain.acquisition("imu-a"), recording());
    let short = shortened(&domain, 2000);
    for (round, chunk) in samples[..2000].chunks(500).enumerate() {
        send(&mut acquisition, chunk);
        // Wait after each part, so that no queue overflows on a slow machine.
        FILES.iter().for_each(|file| wait_until("the recorder", || rows(&domain, file) == round * 500 + chunk.len()));
    }
    for recorder in recorders {
        let log = end(recorder);
        assert_contains(&log, "imu-a raw: 2000 rows of 1 session, 0 missing, 0 repeats");
        assert_contains(&log, "imu-a increment: 2000 rows of 1 session, 0 missing, 0 repeats");
    }
    let exact = replay(&domain, short);
    let verified = domain.run_ok(&["verify", "--table", "imu-a.toml", "--window", "1", short]);
    drop(acquisition);
    for file in FILES {
        assert!(replay(&domain, file) == exact, "{file}");
        assert!(domain.run_ok(&["feed", "--imu", "imu-a", file]) == exact, "{file}");
        assert!(domain.run_ok(&["verify", "--table", "imu-a.toml", "--window", "1", file]) == verified, "{file}");
    }
    // The recorded increments equal the replayed ones, line by line.
    let increments = fs::read_to_string(domain.path("r.increments.csv")).unwrap();
    let columns = |line: &str| line.split(',').skip(2).take(8).collect::<Vec<_>>().join(",");
    assert!(increments.lines().map(columns).eq(exact.lines()), "recorded_ns and session come first");
    service.terminate();
}

#[test]
fn restarts_of_service_and_acquisition_are_one_recording() {
    let domain = TestDomain::new();
    let mut service = domain.serve_recording();
    let recorder = record(&domain, &["-o", "r.csv"]);
    recorder.wait_for_log("recording imu-a");
    let short = shortened(&domain, 300);
    for run in 0..3 {
        let fed = format!("fed-{run}.csv");
        let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "200", short, "-o", &fed]);
        wait_until("the feed", || rows(&domain, "r.csv") > run * 300 + 50);
        service.kill();
        service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        let (status, log) = feed.wait();
        assert!(status.success(), "{log}");
        wait_until("its end", || rows(&domain, "r.csv") == run * 300 + 300);
    }
    let log = end(recorder);
    assert_contains(&log, "imu-a raw: 900 rows of 3 sessions, 0 missing");
    assert_contains(&log, "imu-a increment: 900 rows of 3 sessions, 0 missing");
    assert!(!log.contains("warning"), "nothing is lost:\n{log}");
    let exact = replay(&domain, short);
    let rows: Vec<_> = exact.lines().skip(1).collect();
    assert!(replay(&domain, "r.csv").lines().skip(1).eq([&rows[..], &rows, &rows].concat()));
    service.terminate();
}

#[test]
fn a_stalled_recorder_loses_its_own_copies_only_and_counts_them() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let recorder = record(&domain, &["-o", "r.csv"]);
    recorder.wait_for_log("recording imu-a");
    let (mut acquisition, samples) = (domain.acquisition("imu-a"), recording());
    send(&mut acquisition, &samples[..100]);
    wait_until("the first rows", || rows(&domain, "r.csv") == 100);
    recorder.stop();
    // Every sample is answered: the stalled recorder disturbs nobody.
    send(&mut acquisition, &samples[100..]);
    assert_eq!(domain.imu_status()["gaps"], 0);
    recorder.resume();
    wait_until("what its queue held", || rows(&domain, "r.csv") == 612);
    let log = end(recorder);
    // Its raw queue kept the oldest samples, its increment queue the newest increments.
    assert_contains(&log, "imu-a raw: 612 rows of 1 session, 3388 missing, 0 repeats");
    assert_contains(&log, "imu-a increment: 612 rows of 1 session, 3388 missing, 0 repeats");
    assert!(fs::read_to_string(domain.path("r.increments.csv")).unwrap().contains(",3999,"));
    service.terminate();
}

/// SIGKILL at any moment leaves files with everything up to the last flush.
#[test]
fn a_killed_recorder_leaves_whole_files() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let (mut acquisition, samples) = (domain.acquisition("imu-a"), recording());
    let mut exact: Vec<String> = Vec::new();
    for (round, file) in FILES.iter().cycle().take(12).enumerate() {
        let name = format!("{round}-{file}");
        let recorder = record_flushing(&domain, "0.001", &["-o", &name]);
        recorder.wait_for_log("recording imu-a");
        let mut sent = 0;
        let mut send_until = |until: Instant| {
            while sent == 0 || Instant::now() < until {
                let raw =
                    RawSample { sequence: round as u64 * 100_000 + sent, ..samples[sent as usize % samples.len()] };
                send(&mut acquisition, &[raw]);
                sent += 1;
            }
        };
        let now = Instant::now();
        send_until(now + Duration::from_millis(50));
        // As `rows`, with the increments.
        let mut flushed = String::new();
        wait_until("rows", || {
            let replayed = domain.run(&["replay", "--table", "imu-a.toml", &name]);
            flushed = text(&replayed.stdout);
            replayed.status.success() && flushed.lines().count() > 1
        });
        // Then the kill comes at another moment in each round, within a few flushes.
        send_until(Instant::now() + Duration::from_micros(round as u64 * 7919 % 20_000));
        recorder.kill();
        let left = replay(&domain, &name);
        assert!(left.starts_with(&flushed), "{name}: what was flushed is there");
        exact.push(name);
        // A new recorder does not overwrite the file.
        let again = domain.run(&["record", "--imu", "imu-a", "-o", exact.last().unwrap()]);
        assert_eq!(again.status.code(), Some(74));
        assert_contains(&text(&again.stderr), "a recording is never replaced");
        assert!(replay(&domain, exact.last().unwrap()) == left);
    }
    service.terminate();
}

#[test]
fn files_rotate_and_the_next_recorder_continues_their_numbers() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let (mut acquisition, samples) = (domain.acquisition("imu-a"), recording());
    for (extension, pair) in [("csv", true), ("mcap", false)] {
        let name = format!("r.{extension}");
        let mut numbers = 0;
        let mut recorded = 0;
        for start in [0, 400] {
            let recorder = record(&domain, &["-o", &name, "--rotate-time", "0.1"]);
            recorder.wait_for_log("recording imu-a");
            let first = numbers + 1;
            acquisition.begin_session().unwrap();
            for chunk in samples[start..start + 400].chunks(100) {
                send(&mut acquisition, chunk);
                recorded += 100;
                let existing =
                    || (1..).map(|n| format!("r-{n:04}.{extension}")).take_while(|n| domain.path(n).exists());
                wait_until("rows", || existing().map(|name| rows(&domain, &name)).sum::<usize>() == recorded);
                wait_until("the next file", || existing().count() > numbers);
                numbers = existing().count();
            }
            let log = end(recorder);
            assert_contains(&log, "imu-a raw: 400 rows of 1 session, 0 missing");
            assert!(numbers > first, "{log}");
            numbers = (1..).take_while(|n| domain.path(&format!("r-{n:04}.{extension}")).exists()).count();
        }
        let parts = (1..=numbers).map(|n| replay(&domain, &format!("r-{n:04}.{extension}")));
        let parts: String =
            parts.flat_map(|part| part.lines().skip(1).map(|l| format!("{l}\n")).collect::<Vec<_>>()).collect();
        let whole = replay(&domain, RUN);
        assert!(whole.lines().skip(1).take(800).eq(parts.lines()), "{extension}");
        let names: Vec<_> = (1..=numbers).rev().map(|n| format!("r-{n:04}.{extension}")).collect();
        let command = ["replay", "--table", "imu-a.toml"].into_iter().chain(names.iter().map(String::as_str));
        let as_one = domain.run_ok(&command.collect::<Vec<_>>());
        assert!(as_one.lines().skip(1).eq(parts.lines()), "{extension}: the files as one recording");
        for n in 1..=numbers {
            assert_eq!(domain.path(&format!("r-{n:04}.increments.{extension}")).exists(), pair);
        }
    }
    service.terminate();
}

#[test]
fn what_cannot_be_recorded_is_refused_at_once() {
    let domain = TestDomain::new();
    domain.write("old.increments.csv", "precious");
    for (arguments, code, cause) in [
        (&["-o", "old.csv"][..], 74, "old.increments.csv exists"),
        (&["-o", "old.increments.csv"], 74, "old.increments.csv exists"),
        (&["-o", "{imu}.increments.csv", "--imu", "old", "--stream", "raw"], 74, "old.increments.csv exists"),
        (&["-o", "nowhere/r.csv"], 74, "writing nowhere/r.csv: "),
        (&["-o", "r.txt"], 64, "name the recording .csv or .mcap"),
        (&["-o", "-", "--format", "mcap"], 64, "stdout takes one stream"),
        (&["-o", "r.csv", "--imu", "imu-b"], 64, "put {imu} into the name"),
        (&["-o", "r.mcap", "--imu", "imu-a"], 64, "given twice"),
        (&["-o", "r.mcap", "--rotate-size", "5 pages"], 64, "give a number of bytes"),
    ] {
        let output = domain.run(&[&["record", "--imu", "imu-a"], arguments].concat());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        assert_contains(&text(&output.stderr), cause);
    }
    assert_eq!(fs::read_to_string(domain.path("old.increments.csv")).unwrap(), "precious");
    let left: Vec<_> = fs::read_dir(domain.path("")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["old.increments.csv"], "nothing was begun");
}

#[test]
fn several_imus_and_standard_output() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    domain.write("b.toml", &TABLE.replace("imu-a", "imu-b"));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=b.toml"]);
    let both = ["record", "--imu", "imu-a", "--imu", "imu-b", "--flush", "0.05", "-o"];
    let mcap = domain.spawn(&[&both[..], &["all.mcap"]].concat());
    let csv = domain.spawn(&[&both[..], &["of-{imu}.csv"]].concat());
    let piped =
        domain.isotherm_after(&[], "exec > out.csv", &["record", "--imu", "imu-b", "-o", "-", "--flush", "0.05"]);
    let piped = domain.start(piped);
    for recorder in [&mcap, &csv] {
        recorder.wait_for_log("recording imu-a");
        recorder.wait_for_log("recording imu-b");
    }
    piped.wait_for_log("recording imu-b");
    let samples = recording();
    send(&mut domain.acquisition("imu-a"), &samples[..100]);
    send(&mut domain.acquisition("imu-b"), &samples[100..250]);
    // The header is written to standard output together with the first rows.
    let printed = || fs::metadata(domain.path("out.csv")).unwrap().len() > 0 && rows(&domain, "out.csv") == 150;
    wait_until("rows", || rows(&domain, "of-imu-a.csv") == 100 && printed());
    assert_contains(&end(mcap), "imu-b raw: 150 rows of 1 session, 0 missing");
    end(csv);
    end(piped);
    let of = |imu: &str| domain.run_ok(&["replay", "--table", "imu-a.toml", "--other-imu", "--imu", imu, "all.mcap"]);
    for (imu, file) in [("imu-a", "of-imu-a.csv"), ("imu-b", "of-imu-b.csv"), ("imu-b", "out.csv")] {
        assert!(of(imu) == domain.run_ok(&["replay", "--table", "imu-a.toml", file]), "{file}");
    }
    for (imu, code) in [("imu-x", 65), ("imu-b", 78)] {
        let other = domain.run(&["replay", "--table", "imu-a.toml", "--imu", imu, "all.mcap"]);
        assert_eq!(other.status.code(), Some(code), "{imu}");
    }
    // As after a crash in the middle of a line or of a chunk.
    for file in ["out.csv", "all.mcap"] {
        let whole = fs::read(domain.path(file)).unwrap();
        fs::write(domain.path(file), &whole[..whole.len() - 10]).unwrap();
        let output = domain.run(&["replay", "--table", "imu-a.toml", "--other-imu", "--imu", "imu-b", file]);
        assert!(output.status.success());
        assert_contains(&text(&output.stderr), "the recording was not ended properly");
    }
    let output = domain.isotherm_after(&[], "true", &["replay", "--table", "imu-a.toml", "-"]).output().unwrap();
    assert_eq!(output.status.code(), Some(65), "empty input is not a recording");
    service.terminate();
}

#[test]
fn a_full_disk_stops_the_recording_until_there_is_room() {
    if !may_mount() {
        return;
    }
    for extension in ["csv", "mcap"] {
        let domain = TestDomain::new();
        let service = domain.serve_recording();
        fs::create_dir(domain.path("small")).unwrap();
        let name = format!("small/r.{extension}");
        let mount = "mount -t tmpfs -o size=1m tmpfs small && head -c 800k /dev/zero > small/fill";
        let arguments = ["record", "--imu", "imu-a", "-o", &name, "--flush", "0.05"];
        let recorder = domain.start(domain.isotherm_after(&["-m"], mount, &arguments));
        recorder.wait_for_log("recording imu-a");
        let inside = domain.path("small");
        let inside = format!("/proc/{}/root{}", recorder.pid(), inside.display());
        let (mut acquisition, samples) = (domain.acquisition("imu-a"), recording());
        let copy = |to: &str| fs::copy(format!("{inside}/r.{extension}"), domain.path(to)).unwrap();
        // Wait until the first rows are on the disk; then send samples until the disk is full.
        send(&mut acquisition, &samples[..10]);
        wait_until("the first rows", || {
            let file = format!("first.{extension}");
            copy(&file);
            let replayed = domain.run(&["replay", "--table", "imu-a.toml", &file]);
            replayed.status.success() && text(&replayed.stdout).lines().count() == 11
        });
        let (mut sent, deadline) = (10, Instant::now() + TIMEOUT);
        while recorder.count_in_log("No space left on device") == 0 {
            assert!(Instant::now() < deadline, "the disk does not fill up");
            let raw = RawSample { sequence: sent, ..samples[sent as usize % samples.len()] };
            send(&mut acquisition, &[raw]);
            sent += 1;
        }
        // The file on the full disk can be read.
        copy(&format!("full.{extension}"));
        let full = rows(&domain, &format!("full.{extension}"));
        assert!((10..=sent as usize).contains(&full), "{extension}: {full} of {sent}");
        // Make room for everything that the recorder may hold in memory.
        let mut more = Command::new("nsenter");
        more.args(["-m", "-t", &recorder.pid().to_string(), "mount", "-o", "remount,size=100m"])
            .arg(domain.path("small"));
        assert!(more.status().unwrap().success());
        recorder.wait_for_log("there is room again");
        // Samples that are sent from now on are recorded.
        let resumed_at = sent;
        let last = |file: &str| replay(&domain, file).lines().last().unwrap().split(',').next().unwrap().to_owned();
        wait_until("rows behind the full disk", || {
            send(&mut acquisition, &[RawSample { sequence: sent, ..samples[0] }]);
            sent += 1;
            copy(&format!("after.{extension}"));
            last(&format!("after.{extension}")).parse::<u64>().unwrap() >= resumed_at
        });
        let log = end(recorder);
        // Samples that were sent too fast may be lost, but each loss is counted. The last samples may not have arrived
        // yet.
        let counts = log.split("imu-a raw: ").nth(1).unwrap();
        let numbers: Vec<u64> = counts.split([' ', ',']).filter_map(|word| word.parse().ok()).take(3).collect();
        let [rows, sessions, missing] = numbers[..] else { panic!("{log}") };
        assert_eq!(sessions, 1);
        assert!((resumed_at + 1..=sent).contains(&(rows + missing)) && rows > full as u64, "{sent}: {log}");
        assert!(!Path::new(&inside).exists());
        service.terminate();
    }
}

#[test]
fn pieces_of_different_imus_are_refused() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=imu-b.toml"]);
    {
        let format = "mcap";
        let output = format!("{{imu}}.{format}");
        let recorder = record(&domain, &["--imu", "imu-b", "-o", &output, "--stream", "raw"]);
        recorder.wait_for_log_lines("recording imu-", 2);
        for imu in ["imu-a", "imu-b"] {
            domain.run_ok(&["feed", "--imu", imu, shortened(&domain, 20)]);
        }
        end(recorder);
        let (a, b) = (format!("imu-a.{format}"), format!("imu-b.{format}"));
        assert_eq!(rows(&domain, &a), 20);
        for pieces in [[&a, &b], [&b, &a]] {
            let output = domain.run(&["replay", "--table", "imu-a.toml", pieces[0], pieces[1]]);
            assert_eq!(output.status.code(), Some(65), "{pieces:?}");
            let cause = format!("{} is of imu-", pieces[1]);
            assert_contains(&text(&output.stderr), &cause);
            assert_contains(&text(&output.stderr), "give the pieces of one IMU");
        }
    }
    service.terminate();
}

#[test]
fn a_file_of_increments_is_recognised_where_raw_samples_are_wanted() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    {
        let format = "csv";
        let recorder = record(&domain, &["-o", &format!("flight.{format}")]);
        recorder.wait_for_log("recording imu-a");
        domain.run_ok(&["feed", "--imu", "imu-a", shortened(&domain, 20)]);
        end(recorder);
        let output = domain.run(&["replay", "--table", "imu-a.toml", &format!("flight.increments.{format}")]);
        assert_eq!(output.status.code(), Some(65));
        assert_contains(&text(&output.stderr), "these are increments; give the file of the raw samples");
    }
    service.terminate();
}
