//! Recording: all formats, restarts, kills, a stalled recorder, rotation, a full disk.
#![allow(clippy::panic, clippy::print_stderr, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::{Acquisition, RawSample};
use isotherm_tests::{PATIENCE, Process, RUN, World, may_mount, recording, text, wait_until};
use rustix::process::Signal;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const FILES: [&str; 3] = ["r.csv", "r.parquet", "r.mcap"];

/// A recorder of `imu-a` that flushes often.
fn record(world: &World, more: &[&str]) -> Process {
    record_flushing(world, "0.05", more)
}

fn record_flushing(world: &World, seconds: &str, more: &[&str]) -> Process {
    world.spawn(&[&["record", "--imu", "imu-a", "--flush", seconds], more].concat())
}

/// The beginning of the recording, as a file.
fn shortened(world: &World, rows: usize) -> &'static str {
    let text = fs::read_to_string(RUN).unwrap();
    world.write("short.csv", &text.lines().take(rows + 1).map(|line| format!("{line}\n")).collect::<String>());
    "short.csv"
}

/// Sends samples with the recording's sequences and waits for each answer.
fn send(acquisition: &mut Acquisition, samples: &[RawSample]) {
    for sample in samples {
        let mut loan = acquisition.loan().unwrap();
        *loan = RawSample { session: loan.session, ..*sample };
        acquisition.compensate(loan, PATIENCE).unwrap();
    }
}

/// What a recording gives when it is replayed.
fn replay(world: &World, file: &str) -> String {
    world.run_well(&["replay", "--table", "imu-a.toml", file])
}

fn rows(world: &World, file: &str) -> usize {
    replay(world, file).lines().count() - 1
}

/// SIGTERM; what it said.
fn end(recorder: Process) -> String {
    recorder.signal(Signal::TERM);
    let (status, log) = recorder.wait();
    assert!(status.success(), "{status}\n{log}");
    log
}

fn said(log: &str, text: &str) {
    assert!(log.contains(text), "{text:?} was not said:\n{log}");
}

#[test]
fn every_format_holds_every_sample_and_every_answer() {
    let world = World::new();
    let recorders = FILES.map(|file| record(&world, &["-o", file]));
    recorders.iter().for_each(|recorder| recorder.wait_for_log("waiting for a service that serves imu-a"));
    let service = world.serve_recording();
    recorders.iter().for_each(|recorder| recorder.wait_for_log("recording imu-a"));
    let (mut acquisition, samples) = (world.acquisition("imu-a"), recording());
    let short = shortened(&world, 2000);
    for (round, chunk) in samples[..2000].chunks(500).enumerate() {
        send(&mut acquisition, chunk);
        // So that no queue can overflow, however slow the machine is.
        FILES.iter().for_each(|file| wait_until("the recorder", || rows(&world, file) == round * 500 + chunk.len()));
    }
    for recorder in recorders {
        let log = end(recorder);
        said(&log, "imu-a raw: 2000 rows of 1 session, 0 missing, 0 repeats");
        said(&log, "imu-a increment: 2000 rows of 1 session, 0 missing, 0 repeats");
    }
    let exact = replay(&world, short);
    let verified = world.run_well(&["verify", "--table", "imu-a.toml", "--window", "1", short]);
    drop(acquisition);
    for file in FILES {
        assert!(replay(&world, file) == exact, "{file}");
        assert!(world.run_well(&["feed", "--imu", "imu-a", file]) == exact, "{file}");
        assert!(world.run_well(&["verify", "--table", "imu-a.toml", "--window", "1", file]) == verified, "{file}");
    }
    // The increments are those that were published, line by line.
    let increments = fs::read_to_string(world.path("r.increments.csv")).unwrap();
    let columns = |line: &str| line.split(',').skip(2).take(8).collect::<Vec<_>>().join(",");
    assert!(increments.lines().map(columns).eq(exact.lines()), "recorded_ns and session come first");
    service.terminate();
}

#[test]
fn restarts_of_service_and_acquisition_are_one_recording() {
    let world = World::new();
    let mut service = world.serve_recording();
    let recorder = record(&world, &["-o", "r.csv"]);
    recorder.wait_for_log("recording imu-a");
    let short = shortened(&world, 300);
    for run in 0..3 {
        let fed = format!("fed-{run}.csv");
        let feed = world.spawn(&["feed", "--imu", "imu-a", "--rate", "200", short, "-o", &fed]);
        wait_until("the feed", || rows(&world, "r.csv") > run * 300 + 50);
        service.kill();
        service = world.serve(&["--imu", "imu-a=imu-a.toml"]);
        let (status, log) = feed.wait();
        assert!(status.success(), "{log}");
        wait_until("its end", || rows(&world, "r.csv") == run * 300 + 300);
    }
    let log = end(recorder);
    said(&log, "imu-a raw: 900 rows of 3 sessions, 0 missing");
    said(&log, "imu-a increment: 900 rows of 3 sessions, 0 missing");
    let exact = replay(&world, short);
    let rows: Vec<_> = exact.lines().skip(1).collect();
    assert!(replay(&world, "r.csv").lines().skip(1).eq([&rows[..], &rows, &rows].concat()));
    service.terminate();
}

#[test]
fn a_stalled_recorder_loses_its_own_copies_only_and_counts_them() {
    let world = World::new();
    let service = world.serve_recording();
    let recorder = record(&world, &["-o", "r.csv"]);
    recorder.wait_for_log("recording imu-a");
    let (mut acquisition, samples) = (world.acquisition("imu-a"), recording());
    send(&mut acquisition, &samples[..100]);
    wait_until("the first rows", || rows(&world, "r.csv") == 100);
    recorder.stop();
    // Each is answered: nobody else notices.
    send(&mut acquisition, &samples[100..]);
    assert_eq!(world.imu_status()["gaps"], 0);
    recorder.go_on();
    wait_until("what its queue held", || rows(&world, "r.csv") == 612);
    let log = end(recorder);
    // The next ones of the raw samples, the last ones of the increments.
    said(&log, "imu-a raw: 612 rows of 1 session, 3388 missing, 0 repeats");
    said(&log, "imu-a increment: 612 rows of 1 session, 3388 missing, 0 repeats");
    assert!(fs::read_to_string(world.path("r.increments.csv")).unwrap().contains(",3999,"));
    service.terminate();
}

/// SIGKILL at any moment leaves files with everything up to the last flush.
#[test]
fn a_killed_recorder_leaves_whole_files() {
    let world = World::new();
    let service = world.serve_recording();
    let (mut acquisition, samples) = (world.acquisition("imu-a"), recording());
    let mut exact: Vec<String> = Vec::new();
    for (round, file) in FILES.iter().cycle().take(12).enumerate() {
        let name = format!("{round}-{file}");
        let recorder = record_flushing(&world, "0.001", &["-o", &name]);
        recorder.wait_for_log("recording imu-a");
        let mut sent = 0;
        let mut go = |until: Instant| {
            while sent == 0 || Instant::now() < until {
                let raw =
                    RawSample { sequence: round as u64 * 100_000 + sent, ..samples[sent as usize % samples.len()] };
                send(&mut acquisition, &[raw]);
                sent += 1;
            }
        };
        let now = Instant::now();
        go(now + Duration::from_millis(50));
        wait_until("rows", || rows(&world, &name) > 0);
        let flushed = replay(&world, &name);
        // Anywhere within a few flushes.
        go(Instant::now() + Duration::from_micros(round as u64 * 7919 % 20_000));
        recorder.kill();
        let left = replay(&world, &name);
        assert!(left.starts_with(&flushed), "{name}: what was flushed is there");
        exact.push(name);
        // And it is not written over.
        let again = world.run(&["record", "--imu", "imu-a", "-o", exact.last().unwrap()]);
        assert_eq!(again.status.code(), Some(74));
        said(&text(&again.stderr), "a recording is never replaced");
        assert!(replay(&world, exact.last().unwrap()) == left);
    }
    service.terminate();
}

#[test]
fn files_rotate_and_the_next_recorder_goes_on_behind_them() {
    let world = World::new();
    let service = world.serve_recording();
    let (mut acquisition, samples) = (world.acquisition("imu-a"), recording());
    for (extension, pair) in [("csv", true), ("parquet", true), ("mcap", false)] {
        let name = format!("r.{extension}");
        let mut numbers = 0;
        let mut recorded = 0;
        for start in [0, 400] {
            let recorder = record(&world, &["-o", &name, "--rotate-time", "0.1"]);
            recorder.wait_for_log("recording imu-a");
            let first = numbers + 1;
            acquisition.begin_session().unwrap();
            for chunk in samples[start..start + 400].chunks(100) {
                send(&mut acquisition, chunk);
                recorded += 100;
                let existing = || (1..).map(|n| format!("r-{n:04}.{extension}")).take_while(|n| world.path(n).exists());
                wait_until("rows", || existing().map(|name| rows(&world, &name)).sum::<usize>() == recorded);
                wait_until("the next file", || existing().count() > numbers);
                numbers = existing().count();
            }
            let log = end(recorder);
            said(&log, "imu-a raw: 400 rows of 1 session, 0 missing");
            assert!(numbers > first, "{log}");
            numbers = (1..).take_while(|n| world.path(&format!("r-{n:04}.{extension}")).exists()).count();
        }
        let parts = (1..=numbers).map(|n| replay(&world, &format!("r-{n:04}.{extension}")));
        let parts: String =
            parts.flat_map(|part| part.lines().skip(1).map(|l| format!("{l}\n")).collect::<Vec<_>>()).collect();
        let whole = replay(&world, RUN);
        assert!(whole.lines().skip(1).take(800).eq(parts.lines()), "{extension}");
        let names: Vec<_> = (1..=numbers).rev().map(|n| format!("r-{n:04}.{extension}")).collect();
        let command = ["replay", "--table", "imu-a.toml"].into_iter().chain(names.iter().map(String::as_str));
        let as_one = world.run_well(&command.collect::<Vec<_>>());
        assert!(as_one.lines().skip(1).eq(parts.lines()), "{extension}: the files as one recording");
        for n in 1..=numbers {
            assert_eq!(world.path(&format!("r-{n:04}.increments.{extension}")).exists(), pair);
        }
    }
    service.terminate();
}

#[test]
fn what_cannot_be_recorded_is_said_at_once() {
    let world = World::new();
    world.write("old.increments.csv", "precious");
    for (arguments, code, cause) in [
        (&["-o", "old.csv"][..], 74, "old.increments.csv exists"),
        (&["-o", "old.increments.csv"], 74, "old.increments.csv exists"),
        (&["-o", "{imu}.increments.csv", "--imu", "old", "--stream", "raw"], 74, "old.increments.csv exists"),
        (&["-o", "nowhere/r.csv"], 74, "writing nowhere/r.csv: "),
        (&["-o", "r.txt"], 64, "name it .csv, .parquet or .mcap"),
        (&["-o", "-", "--format", "mcap"], 64, "stdout takes one stream"),
        (&["-o", "r.csv", "--imu", "imu-b"], 64, "put {imu} into the name"),
        (&["-o", "r.mcap", "--imu", "imu-a"], 64, "given twice"),
        (&["-o", "r.mcap", "--rotate-size", "5 pages"], 64, "give a number of bytes"),
    ] {
        let output = world.run(&[&["record", "--imu", "imu-a"], arguments].concat());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        said(&text(&output.stderr), cause);
    }
    assert_eq!(fs::read_to_string(world.path("old.increments.csv")).unwrap(), "precious");
    let left: Vec<_> = fs::read_dir(world.path("")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["old.increments.csv"], "nothing was begun");
}

#[test]
fn several_imus_and_standard_output() {
    let world = World::new();
    world.write("imu-a.toml", isotherm_tests::TABLE);
    world.write("b.toml", &isotherm_tests::TABLE.replace("imu-a", "imu-b"));
    let service = world.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=b.toml"]);
    let both = ["record", "--imu", "imu-a", "--imu", "imu-b", "--flush", "0.05", "-o"];
    let mcap = world.spawn(&[&both[..], &["all.mcap"]].concat());
    let csv = world.spawn(&[&both[..], &["of-{imu}.csv"]].concat());
    let piped =
        world.isotherm_after(&[], "exec > out.csv", &["record", "--imu", "imu-b", "-o", "-", "--flush", "0.05"]);
    let piped = world.start(piped);
    for recorder in [&mcap, &csv] {
        recorder.wait_for_log("recording imu-a");
        recorder.wait_for_log("recording imu-b");
    }
    piped.wait_for_log("recording imu-b");
    let samples = recording();
    send(&mut world.acquisition("imu-a"), &samples[..100]);
    send(&mut world.acquisition("imu-b"), &samples[100..250]);
    // The standard output gets its header with the first rows.
    let printed = || fs::metadata(world.path("out.csv")).unwrap().len() > 0 && rows(&world, "out.csv") == 150;
    wait_until("rows", || rows(&world, "of-imu-a.csv") == 100 && printed());
    said(&end(mcap), "imu-b raw: 150 rows of 1 session, 0 missing");
    end(csv);
    end(piped);
    let of = |imu: &str| world.run_well(&["replay", "--table", "imu-a.toml", "--imu", imu, "all.mcap"]);
    for (imu, file) in [("imu-a", "of-imu-a.csv"), ("imu-b", "of-imu-b.csv"), ("imu-b", "out.csv")] {
        assert!(of(imu) == world.run_well(&["replay", "--table", "imu-a.toml", file]), "{file}");
    }
    let other = world.run(&["replay", "--table", "imu-a.toml", "--imu", "imu-x", "all.mcap"]);
    assert_eq!(other.status.code(), Some(65));
    // A crash in the middle of a line, or of a chunk.
    for file in ["out.csv", "all.mcap"] {
        let whole = fs::read(world.path(file)).unwrap();
        fs::write(world.path(file), &whole[..whole.len() - 10]).unwrap();
        let output = world.run(&["replay", "--table", "imu-a.toml", "--imu", "imu-b", file]);
        assert!(output.status.success());
        said(&text(&output.stderr), "the recording was not ended properly");
    }
    // A Parquet file has its footer at the end.
    let output = world.isotherm_after(&[], "true", &["replay", "--table", "imu-a.toml", "-"]).output().unwrap();
    assert_eq!(output.status.code(), Some(65), "nothing is no recording");
    service.terminate();
}

#[test]
fn a_full_disk_stops_the_recording_until_there_is_room() {
    if !may_mount() {
        return;
    }
    for extension in ["csv", "parquet", "mcap"] {
        let world = World::new();
        let service = world.serve_recording();
        fs::create_dir(world.path("small")).unwrap();
        let name = format!("small/r.{extension}");
        let mount = "mount -t tmpfs -o size=1m tmpfs small && head -c 800k /dev/zero > small/fill";
        let arguments = ["record", "--imu", "imu-a", "-o", &name, "--flush", "0.05"];
        let recorder = world.start(world.isotherm_after(&["-m"], mount, &arguments));
        recorder.wait_for_log("recording imu-a");
        let inside = world.path("small");
        let inside = format!("/proc/{}/root{}", recorder.pid(), inside.display());
        let (mut acquisition, samples) = (world.acquisition("imu-a"), recording());
        let copy = |to: &str| fs::copy(format!("{inside}/r.{extension}"), world.path(to)).unwrap();
        // The first rows are there before so many come at once that none of them has room.
        send(&mut acquisition, &samples[..10]);
        wait_until("the first rows", || {
            let file = format!("first.{extension}");
            copy(&file);
            let replayed = world.run(&["replay", "--table", "imu-a.toml", &file]);
            replayed.status.success() && text(&replayed.stdout).lines().count() == 11
        });
        let (mut sent, deadline) = (10, Instant::now() + PATIENCE);
        while recorder.count_in_log("No space left on device") == 0 {
            assert!(Instant::now() < deadline, "the disk does not fill up");
            let raw = RawSample { sequence: sent, ..samples[sent as usize % samples.len()] };
            send(&mut acquisition, &[raw]);
            sent += 1;
        }
        // What is written can be read meanwhile.
        copy(&format!("full.{extension}"));
        let full = rows(&world, &format!("full.{extension}"));
        assert!((10..=sent as usize).contains(&full), "{extension}: {full} of {sent}");
        // Room for all that can wait in memory, however much came while it was waited for.
        let mut more = Command::new("nsenter");
        more.args(["-m", "-t", &recorder.pid().to_string(), "mount", "-o", "remount,size=100m"])
            .arg(world.path("small"));
        assert!(more.status().unwrap().success());
        recorder.wait_for_log("there is room again");
        // What comes from now on is recorded again.
        let goes_on = sent;
        let last = |file: &str| replay(&world, file).lines().last().unwrap().split(',').next().unwrap().to_owned();
        wait_until("rows behind the full disk", || {
            send(&mut acquisition, &[RawSample { sequence: sent, ..samples[0] }]);
            sent += 1;
            copy(&format!("after.{extension}"));
            last(&format!("after.{extension}")).parse::<u64>().unwrap() >= goes_on
        });
        let log = end(recorder);
        // Sent as fast as this machine can, some may be lost, but none uncounted, though the last ones need not have come.
        let counts = log.split("imu-a raw: ").nth(1).unwrap();
        let numbers: Vec<u64> = counts.split([' ', ',']).filter_map(|word| word.parse().ok()).take(3).collect();
        let [rows, sessions, missing] = numbers[..] else { panic!("{log}") };
        assert_eq!(sessions, 1);
        assert!((goes_on + 1..=sent).contains(&(rows + missing)) && rows > full as u64, "{sent}: {log}");
        assert!(!Path::new(&inside).exists());
        service.terminate();
    }
}
