//! Device, acquisition, service and reader: nothing is lost, and what is recorded replays to what was answered.

use super::{Acquire, Device, assert_frames, counts, describe, recorded};
use isotherm_client::RawSample;
use isotherm_tests::emulator::Emulator;
use isotherm_tests::programs::{C, compile, start};
use isotherm_tests::{Process, TestDomain, wait_until};
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::fs;
use std::thread::sleep;
use std::time::Duration;

/// Describes a VN-100, which sends 400 Hz and has a clock, and starts a service with its nominal table.
pub(super) fn serve_vn100(domain: &TestDomain) -> Process {
    describe(domain, Emulator::Vn100, &[]);
    serve(domain)
}

fn serve(domain: &TestDomain) -> Process {
    domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
    domain.serve(&["--imu", "imu-a=imu-a.toml"])
}

/// Starts a reader that keeps what it reads, and waits until it has begun.
pub(super) fn read(domain: &TestDomain, file: &str) -> Process {
    let reader = domain.spawn(&["record", "--imu", "imu-a", "--flush", "0.1", "-o", file]);
    reader.wait_for_log("recording imu-a");
    reader
}

/// Number of samples that the service has received.
pub(super) fn received(domain: &TestDomain) -> u64 {
    let status = domain.imu_status();
    // For the output of a test that waits in vain.
    println!(
        "received {}, missing {}, connected {}",
        status["received"], status["missing"], status["acquisition_connected"]
    );
    status["received"].as_u64().unwrap()
}

/// What an increment says, by session and sequence: the text of its increments, its table and its flags.
type Increments = BTreeMap<(u64, u64), String>;

/// The columns that an answer has by itself, as text.
fn answers(text: &str, keys: impl Iterator<Item = (u64, u64)>) -> Increments {
    let (header, rows) = text.split_once('\n').unwrap();
    let names: Vec<_> = header.split(',').collect();
    // All but names, times and delivery, which a replay does not know.
    let is_own = |name: &str| {
        name.ends_with("_dv") || name.ends_with("_da") || ["interval_ns", "table", "flags"].contains(&name)
    };
    let of_row = |row: &str| {
        let columns = names.iter().zip(row.split(',')).filter(|(name, _)| is_own(name));
        columns.map(|(_, value)| value).collect::<Vec<_>>().join(",")
    };
    let all: Increments = keys.zip(rows.lines().map(of_row)).collect();
    assert_eq!(all.len(), rows.lines().count());
    all
}

/// The increments of a recording of the acquisition, replayed.
pub(super) fn replayed(domain: &TestDomain, samples: &[RawSample], file: &str) -> Increments {
    let text = domain.run_ok(&["replay", "--table", "imu-a.toml", file]);
    answers(&text, samples.iter().map(|raw| (raw.session, raw.sequence)))
}

/// Rows of the increments that a reader kept: session, sequence and the flags of delivery.
pub(super) fn rows(domain: &TestDomain, file: &str) -> Vec<(u64, u64, String)> {
    let text = fs::read_to_string(domain.path(file)).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let place = |name: &str| header.split(',').position(|column| column == name).unwrap();
    let [session, sequence, delivery] = ["session", "sequence", "delivery"].map(place);
    let row = |row: &str| {
        let fields: Vec<_> = row.split(',').collect();
        (fields[session].parse().unwrap(), fields[sequence].parse().unwrap(), fields[delivery].to_owned())
    };
    rows.lines().map(row).collect()
}

/// The increments that a reader kept.
pub(super) fn kept(domain: &TestDomain, file: &str) -> Increments {
    let text = fs::read_to_string(domain.path(file)).unwrap();
    answers(&text, rows(domain, file).into_iter().map(|(session, sequence, _)| (session, sequence)))
}

/// Asserts that both have the same increments.
fn assert_same(kept: &Increments, exact: &Increments) {
    let differs = kept.iter().zip(exact).find(|(kept, exact)| kept != exact);
    assert!(differs.is_none() && kept.len() == exact.len(), "{} and {}: {differs:?}", kept.len(), exact.len());
}

/// Ends a reader with SIGTERM.
pub(super) fn end(reader: Process) {
    reader.signal(Signal::TERM);
    let (status, log) = reader.wait();
    assert!(status.success(), "{status}: {log}");
}

#[test]
fn no_sample_is_lost_and_the_record_replays_to_what_was_answered() {
    const FRAMES: u64 = 1200;
    for (emulator, jitter_ms) in [(Emulator::Vn100, "16"), (Emulator::Vn100, "0"), (Emulator::Stim300Rate, "16")] {
        let domain = TestDomain::new();
        let service = if emulator == Emulator::Vn100 {
            serve_vn100(&domain)
        } else {
            describe(&domain, emulator, &[("interval_s = 0.001", "interval_s = 0.0025")]);
            serve(&domain)
        };
        let (reader, frames) = (read(&domain, "read.csv"), FRAMES.to_string());
        let in_c = compile(&domain, C, "examples/c/reader.c");
        let in_c = in_c.map(|program| start(&domain, &program, &["imu-a", &frames], "c.csv"));
        wait_until("the readers", || domain.imu_status()["readers"] == 1 + u64::from(in_c.is_some()));
        let device =
            Device::start(&domain, emulator, &["--frames", &frames, "--rate", "400", "--jitter-ms", jitter_ms]);
        let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
        acquire.process.wait_for_log("went away");
        wait_until("all answers", || received(&domain) == FRAMES);
        let tally = acquire.end();
        assert!(device.0.wait().0.success());
        end(reader);

        let names = ["frames", "samples", "service/sent", "service/answered"];
        assert_eq!(counts(&tally, names), [FRAMES; 4], "{tally}");
        let names = ["missing", "gaps", "repeated", "service/dropped", "service/invalid", "not_recorded", "ambiguous"];
        assert_eq!(counts(&tally, names), [0; 7], "{tally}");
        assert_eq!(counts(&tally, ["sessions", "service/connections", "outages"]), [1; 3], "{tally}");

        let samples = recorded(&domain, "acquired.csv");
        assert_eq!(samples.iter().map(|raw| raw.sequence).collect::<Vec<_>>(), (0..FRAMES).collect::<Vec<_>>());
        assert_frames(emulator, &samples, |raw| raw.sequence);
        let exact = replayed(&domain, &samples, "acquired.csv");
        assert_eq!(exact.len() as u64, FRAMES);
        assert_same(&kept(&domain, "read.increments.csv"), &exact);
        if let Some(mut in_c) = in_c {
            assert!(in_c.wait().unwrap().success());
            assert_in_c(&domain, &exact);
        }
        let status = domain.imu_status();
        let zero = 0.into();
        assert_eq!((&status["missing"], &status["repeats"], &status["compensated"]), (&zero, &zero, &FRAMES.into()));
        service.terminate();
    }
}

/// Asserts that the reader in C has printed the same increments.
fn assert_in_c(domain: &TestDomain, exact: &Increments) {
    let printed = fs::read_to_string(domain.path("c.csv")).unwrap();
    let printed: Vec<Vec<f64>> =
        printed.lines().map(|row| row.split(',').map(|word| word.parse().unwrap()).collect()).collect();
    assert_eq!(printed.len(), exact.len());
    for (row, ((_, sequence), text)) in printed.iter().zip(exact) {
        assert_eq!(row[0], *sequence as f64);
        // Interval, then velocity and angle.
        let numbers: Vec<f64> = text.split(',').skip(1).take(6).map(|word| word.parse().unwrap()).collect();
        assert_eq!(row[1..], numbers, "{sequence}");
    }
}

#[test]
fn a_service_that_stands_still_costs_no_sample() {
    const FRAMES: u64 = 2400;
    let domain = TestDomain::new();
    let service = serve_vn100(&domain);
    let reader = read(&domain, "read.csv");
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", &FRAMES.to_string()]);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
    wait_until("samples", || received(&domain) > 200);
    service.stop();
    sleep(Duration::from_millis(2500));
    service.resume();
    acquire.process.wait_for_log("went away");
    let tally = acquire.end();
    assert!(device.0.wait().0.success());
    end(reader);

    let [samples, missing, sent, answered, dropped] =
        counts(&tally, ["samples", "missing", "service/sent", "service/answered", "service/dropped"]);
    assert_eq!((samples, missing, sent), (FRAMES, 0, FRAMES - dropped), "{tally}");
    assert_eq!((dropped, answered), (0, sent), "{tally}");
    // The acquisition has recorded all, and those that were sent are answered, exactly so.
    let samples = recorded(&domain, "acquired.csv");
    assert_eq!(samples.iter().map(|raw| raw.sequence).collect::<Vec<_>>(), (0..FRAMES).collect::<Vec<_>>());
    let mut exact = replayed(&domain, &samples, "acquired.csv");
    let kept = kept(&domain, "read.increments.csv");
    exact.retain(|key, _| kept.contains_key(key));
    assert_eq!(kept.len() as u64, sent);
    assert_same(&kept, &exact);
    let rows = rows(&domain, "read.increments.csv");
    assert!(rows.windows(2).all(|pair| pair[0].1 + 1 == pair[1].1));
    let status = domain.imu_status();
    assert_eq!((&status["missing"], &status["gaps"]), (&0.into(), &0.into()), "{status}");
    service.terminate();
}
