//! Time that is lost without a gap: the flag `time-step` in the increment, in `feed --delivery`, in status and metrics.

use isotherm_client::{Acquisition, CompensatedIncrement};
use isotherm_shared::wire::{Flags, RawSample};
use isotherm_tests::{RUN, TABLE, TIMEOUT, TestDomain, metrics_page, recording, text, wait_until};
use std::fs;

const MS: u64 = 1_000_000;

/// Sends a sample of 2.5 ms with this sequence and timestamp, and waits for its increment.
fn send(acquisition: &mut Acquisition, sequence: u64, timestamp_ns: u64) -> CompensatedIncrement {
    let mut loan = acquisition.loan().unwrap();
    *loan = RawSample { session: loan.session, sequence, timestamp_ns, ..recording()[0] };
    acquisition.compensate(loan, TIMEOUT).unwrap()
}

/// The delivery flags without `late`, which depends on the machine.
fn lost(increment: &CompensatedIncrement) -> Flags {
    Flags(increment.flags & Flags::LOST.0)
}

#[test]
fn a_clock_that_jumps_is_flagged_and_counted_and_nothing_else_is() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let (step, gap, none) = (Flags::TIME_STEP, Flags::GAP, Flags(0));
    // Sequence, timestamp in steps of half a millisecond, and what is expected. The interval is 2.5 ms.
    let samples = [
        (10, 2000, none),
        (11, 2005, none),
        // 2.5 ms more than an interval, and 1 ms less; then again in time.
        (12, 2015, step),
        (13, 2018, none),
        (14, 2023, none),
        (15, 2025, step),
        // The clock is set back.
        (16, 1000, step),
        // A gap is no step, whatever the time.
        (18, 9000, gap),
        (19, 9005, none),
        // 0 is not given.
        (20, 0, none),
        (21, 9900, none),
        (22, 9905, none),
    ];
    for (sequence, halves, expected) in samples {
        let increment = send(&mut acquisition, sequence, halves * MS / 2);
        assert_eq!(lost(&increment), expected, "sequence {sequence}");
        assert_eq!(Flags(increment.flags & Flags::SAMPLE.0), none);
    }
    // A new session begins anywhere.
    drop(acquisition);
    let mut acquisition = domain.acquisition("imu-a");
    assert_eq!(lost(&send(&mut acquisition, 23, 500 * MS)), Flags::SESSION);
    assert_eq!(lost(&send(&mut acquisition, 24, 900 * MS)), step);

    let status = domain.imu_status();
    assert_eq!((&status["flagged"]["time-step"], &status["flagged"]["gap"]), (&4.into(), &1.into()), "{status}");
    assert_eq!((&status["gaps"], &status["missing"]), (&1.into(), &1.into()));
    let (_exporter, address) = domain.export();
    let series = "isotherm_flagged_total{imu=\"imu-a\",flag=\"time-step\"} 4\n";
    wait_until("the metric", || metrics_page(&address).is_some_and(|page| page.contains(series)));
    service.terminate();
}

#[test]
fn a_resend_of_old_samples_has_no_step_and_is_not_compared_with() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    for sequence in 1..=4 {
        assert_eq!(lost(&send(&mut acquisition, sequence, sequence * 5 * MS / 2)), Flags(0));
    }
    service.kill();
    // The samples that the new service gets first begin its session; what was sent again has no step either.
    for sequence in 5..=7 {
        let mut loan = acquisition.loan().unwrap();
        *loan = RawSample { session: loan.session, sequence, timestamp_ns: sequence * 5 * MS / 2, ..recording()[0] };
        acquisition.send(loan).unwrap();
    }
    let service = domain.serve_recording();
    for sequence in 5..=7 {
        let mut increment = CompensatedIncrement::default();
        wait_until("the answer", || acquisition.receive().unwrap().map(|found| increment = found).is_some());
        assert_eq!((increment.sequence, lost(&increment)), (sequence, Flags(0)));
    }
    assert_eq!(lost(&send(&mut acquisition, 8, 20 * MS)), Flags(0));
    assert_eq!(lost(&send(&mut acquisition, 9, 30 * MS)), Flags::TIME_STEP);
    assert_eq!(domain.imu_status()["flagged"]["time-step"], 1);
    service.terminate();
}

/// The rows of the recording of which every 7th is left out; `renumber` closes the holes in the sequences.
fn without_every_seventh(rows: usize, renumber: bool) -> String {
    let all = fs::read_to_string(RUN).unwrap();
    let (header, body) = all.split_once('\n').unwrap();
    let kept = body.lines().take(rows).enumerate().filter(|(row, _)| row % 7 != 6);
    let lines = kept.enumerate().map(|(number, (row, line))| {
        let (_, rest) = line.split_once(',').unwrap();
        format!("{},{rest}\n", if renumber { number } else { row })
    });
    format!("{header}\n") + &lines.collect::<String>()
}

#[test]
fn feed_prints_the_step_in_its_own_column_and_replay_and_record_count_it() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    domain.write("lost.csv", &without_every_seventh(700, true));
    domain.write("gaps.csv", &without_every_seventh(700, false));
    let recorder = domain.spawn(&["record", "--imu", "imu-a", "--flush", "0.05", "-o", "r.mcap"]);
    recorder.wait_for_log("recording imu-a");
    let fed = domain.run_ok(&["feed", "--imu", "imu-a", "--delivery", "lost.csv"]);
    let mut lines = fed.lines();
    let header: Vec<_> = lines.next().unwrap().split(',').collect();
    assert_eq!(header[header.len() - 2..], ["flags", "delivery"]);
    for (row, line) in lines.enumerate() {
        let fields: Vec<_> = line.split(',').collect();
        let [flags, delivery] = [fields[header.len() - 2], fields[header.len() - 1]];
        assert_eq!((flags, delivery.contains("time-step")), ("-", row > 0 && row % 6 == 0), "{line}");
    }
    // Without the column the output is that of replay, byte for byte.
    let plain = domain.run_ok(&["feed", "--imu", "imu-a", "lost.csv"]);
    let replay = |file: &str| {
        let output = domain.run(&["replay", "--table", "imu-a.toml", file]);
        assert!(output.status.success());
        (text(&output.stdout), text(&output.stderr))
    };
    let (replayed, words) = replay("lost.csv");
    assert!(plain == replayed, "replay differs from feed");
    let words: Vec<_> = words.lines().collect();
    assert!(
        matches!(words[..], [warning, last]
        if warning.starts_with("isotherm: warning [time-step]: lost.csv: over 25 rows to sequence 49 timestamp_ns rises by 0.01 s more")
        && last == "isotherm: 600 increments, none flagged; 0 rows missing in 0 gaps, 99 time steps"),
        "{words:?}"
    );
    let (_, words) = replay("gaps.csv");
    let missing = "isotherm: warning [missing-rows]: gaps.csv: 99 rows missing in 99 gaps, of 699\n";
    let last = "isotherm: 600 increments, none flagged; 99 rows missing in 99 gaps, 0 time steps\n";
    assert_eq!(words, [missing, last].concat());
    let (_, words) = replay(RUN);
    assert_eq!(words, "isotherm: 4000 increments, none flagged\n");
    assert_eq!(domain.imu_status()["flagged"]["time-step"], 2 * 99);

    recorder.signal(rustix::process::Signal::TERM);
    let (status, log) = recorder.wait();
    assert!(status.success(), "{log}");
    for stream in ["raw", "increment"] {
        let summary = format!("imu-a {stream}: 1200 rows of 2 sessions, 0 missing, 0 repeats, 198 time steps");
        assert!(log.contains(&summary), "{log}");
        assert!(log.contains(&format!("warning: imu-a {stream}: over 25 rows to sequence 49 ")), "{log}");
    }
    service.terminate();
}

#[test]
fn a_recording_that_names_another_imu_is_refused_and_can_be_taken() {
    let domain = TestDomain::new();
    domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    let service = domain.serve(&["--imu", "imu-b=imu-b.toml"]);
    domain.write("imu-a.toml", TABLE);
    let files = ["r.mcap", "r.csv"];
    let recorders = files.map(|file| domain.spawn(&["record", "--imu", "imu-b", "--flush", "0.05", "-o", file]));
    recorders.iter().for_each(|recorder| recorder.wait_for_log("recording imu-b"));
    // Not as fast as it goes: a recorder on a busy machine would leave samples out, and verify then sees another run.
    domain.run_ok(&["feed", "--imu", "imu-b", "--rate", "2000", RUN]);
    for recorder in recorders {
        recorder.signal(rustix::process::Signal::TERM);
        let (status, log) = recorder.wait();
        assert!(status.success() && log.contains("raw: 4000 rows of 1 session, 0 missing"), "{log}");
    }
    service.terminate();
    let verify = ["verify", "--window", "0.5"];
    for file in files {
        for command in [&["replay", "-o", "out.csv"][..], &verify] {
            let run = |more: &[&str]| domain.run(&[command, more, &[file]].concat());
            let refused = run(&["--table", "imu-a.toml"]);
            if file == "r.csv" {
                assert_ne!(refused.status.code(), Some(78), "CSV names no IMU");
                continue;
            }
            let words = text(&refused.stderr);
            assert_eq!(refused.status.code(), Some(78), "{words}");
            assert!(words.contains("the recording is of imu-b, and the table imu-a.toml of imu-a"), "{words}");
            assert!(words.contains("--other-imu"), "{words}");
            assert!(command[0] == "verify" || !domain.path("out.csv").exists());
            let taken = run(&["--table", "imu-a.toml", "--other-imu"]);
            let own = run(&["--table", "imu-b.toml"]);
            // The recording moves, which verify refuses of any table.
            let code = if command[0] == "verify" { 65 } else { 0 };
            assert_eq!([&taken, &own].map(|run| run.status.code()), [Some(code); 2], "{}", text(&taken.stderr));
            assert!(!text(&own.stderr).contains("imu-a") && !text(&taken.stderr).contains("--other-imu"));
            let _ = fs::remove_file(domain.path("out.csv"));
        }
    }
}
