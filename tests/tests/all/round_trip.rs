//! Raw samples are sent and exact increments come back, through real processes and real shared memory.
//!
//! Over 400 lines: these are the tests of the acquisition's round trip, in one place.

use isotherm_client::{ClosingNote, CompensateError, Domain, InFlight, SendError};
use isotherm_shared::compensate::answer;
use isotherm_shared::wire::{Flags, RawSample, Triad};
use isotherm_tests::{
    RUN, RUN_EXPECTED, TABLE, TIMEOUT, TestDomain, recording, round_trip, same, table, text, variant, wait_until,
};
use std::collections::HashMap;
use std::fs;
use std::process::Stdio;
use std::time::Duration;

/// The columns of a CSV text, by name.
fn columns(text: &str) -> HashMap<String, Vec<String>> {
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let mut columns: HashMap<_, Vec<_>> = header.iter().map(|name| (name.clone(), Vec::new())).collect();
    for fields in lines {
        assert_eq!(fields.len(), header.len());
        for (name, field) in header.iter().zip(fields) {
            columns.get_mut(name).unwrap().push(field);
        }
    }
    columns
}

#[test]
fn the_recording_comes_back_exactly_and_replay_agrees_to_the_byte() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let fed = domain.run_ok(&["feed", "--imu", "imu-a", RUN]);
    for window in ["1", "7", "1000"] {
        domain.run_ok(&["feed", "--imu", "imu-a", "--window", window, RUN, "-o", "fed.csv"]);
        assert!(fed == fs::read_to_string(domain.path("fed.csv")).unwrap(), "window {window}");
    }
    assert!(fed == domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]), "replay differs from feed");

    let (fed, expected) = (columns(&fed), columns(&fs::read_to_string(RUN_EXPECTED).unwrap()));
    let digest = table(TABLE).digest().to_string();
    assert!(fed["table"].iter().all(|table| *table == digest["sha256:".len()..][..16]));
    assert!(fed["flags"].iter().all(|flags| flags == "-"));
    let mut worst = 0.0_f64;
    for name in ["sequence", "timestamp_ns", "a1_dv", "a2_dv", "a3_dv"] {
        assert_eq!(fed[name].len(), expected[name].len());
        for (fed, expected) in fed[name].iter().zip(&expected[name]) {
            worst = worst.max((fed.parse::<f64>().unwrap() - expected.parse::<f64>().unwrap()).abs());
        }
    }
    assert!(worst <= 2e-16, "worst difference {worst:e} m/s");

    let status = domain.imu_status();
    assert_eq!((&status["received"], &status["compensated"]), (&16_000.into(), &16_000.into()));
    assert_eq!((&status["gaps"], &status["repeats"], &status["sessions"]), (&0.into(), &0.into(), &4.into()));
    assert_eq!(status["table"], digest);
    assert!(status["latency_ns"]["p50"].as_u64().unwrap() > 0);
    service.terminate();
}

/// Of 400 rows of 2.5 ms under a table of 1.25 ms, every fourth is off: a whole interval and a half more.
#[test]
fn service_and_replay_flag_the_same_intervals() {
    let domain = TestDomain::new();
    let table = TABLE.replacen("format = 1", "format = 3", 1);
    domain.write("imu-a.toml", &table.replacen("[imu]\n", "[imu]\nnominal_interval_s = 0.00125\n", 1));
    let odd = |row: usize, line: &str| {
        if row % 4 == 2 { line.replacen(",2500000,", ",4375000,", 1) } else { line.to_owned() }
    };
    let text = fs::read_to_string(RUN).unwrap();
    let lines = text.lines().take(401).enumerate().map(|(row, line)| odd(row, line) + "\n");
    domain.write("odd.csv", &lines.collect::<String>());
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let fed = domain.run_ok(&["feed", "--imu", "imu-a", "odd.csv"]);
    assert!(fed == domain.run_ok(&["replay", "--table", "imu-a.toml", "odd.csv"]), "replay differs from feed");
    let flags = &columns(&fed)["flags"];
    for (row, flags) in flags.iter().enumerate() {
        assert_eq!(flags, if row % 4 == 1 { "interval-not-nominal" } else { "-" }, "{row}");
    }
    assert_eq!(domain.imu_status()["flagged"]["interval-not-nominal"], 100);
    service.terminate();
}

#[test]
fn every_waiting_strategy_serves() {
    for strategy in ["spin", "anticipate", "block"] {
        let domain = TestDomain::new();
        domain.write("imu-a.toml", TABLE);
        let config = format!("[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n[wait]\nstrategy = \"{strategy}\"\n");
        domain.write("service.toml", &config);
        let service = domain.serve(&["--config", "service.toml"]);
        let samples = recording();
        let short =
            fs::read_to_string(RUN).unwrap().lines().take(401).map(|line| format!("{line}\n")).collect::<String>();
        domain.write("short.csv", &short);
        let fed = domain.run_ok(&["feed", "--imu", "imu-a", "--rate", "400", "short.csv"]);
        assert_eq!(fed.lines().count(), 401);
        assert_eq!(domain.status()["wait"], strategy);
        let mut acquisition = domain.acquisition("imu-a");
        for sample in &samples[..100] {
            let increment = round_trip(&mut acquisition, sample);
            let raw = RawSample { session: increment.session, sequence: increment.sequence, ..*sample };
            assert!(same(&increment, &answer(Some(&table(TABLE)), &raw)));
        }
        service.terminate();
    }
}

#[test]
fn data_go_through_pipes_and_messages_to_stderr() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut feed = domain.isotherm(&["feed", "--imu", "imu-a", "-", "-o", "-"]);
    let feed = feed.stdin(fs::File::open(RUN).unwrap()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let output = feed.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout), domain.run_ok(&["replay", "--table", "imu-a.toml", RUN, "-o", "/dev/stdout"]));
    service.terminate();
}

#[test]
fn two_imus_do_not_mix() {
    let domain = TestDomain::new();
    domain.write("a.toml", TABLE);
    domain.write("b.toml", &variant(77).replace("imu-a", "imu-b"));
    let service = domain.serve(&["--imu", "imu-a=a.toml", "--imu", "imu-b=b.toml"]);
    let feed = |imu: &str| {
        let mut command = domain.isotherm(&["feed", "--imu", imu, "--window", "5", RUN]);
        command.stdout(Stdio::piped()).spawn().unwrap()
    };
    let (a, b) = (feed("imu-a"), feed("imu-b"));
    let (a, b) = (a.wait_with_output().unwrap().stdout, b.wait_with_output().unwrap().stdout);
    assert!(text(&a) == domain.run_ok(&["replay", "--table", "a.toml", RUN]), "imu-a");
    assert!(text(&b) == domain.run_ok(&["replay", "--table", "b.toml", RUN]), "imu-b");
    assert!(a != b);
    let status = domain.status();
    assert_eq!((&status["imus"][0]["received"], &status["imus"][1]["received"]), (&4000.into(), &4000.into()));
    service.terminate();
}

#[test]
fn out_of_range_and_not_finite_temperature_under_each_policy() {
    let raw = |head: f64, board: f64| {
        let accelerometers = Triad {
            positive_pulses: [500; 3],
            negative_pulses: [20; 3],
            head_temperature: [head, 2.0, 2.0],
            board_temperature: [2.0, board, 2.0],
            head_lagged: [0.0; 3],
        };
        RawSample { interval_ns: 10_000_000, accelerometers, ..RawSample::default() }
    };
    let places = [2.0, 0.5, 5.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for policy in ["clamp", "extrapolate", "reject"] {
        let domain = TestDomain::new();
        let text = TABLE.replace("\"clamp\"", &format!("{policy:?}"));
        domain.write("imu-a.toml", &text);
        let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        let mut acquisition = domain.acquisition("imu-a");
        let inside = round_trip(&mut acquisition, &raw(2.0, 2.0));
        for head in places {
            for board in places {
                let increment = round_trip(&mut acquisition, &raw(head, board));
                let flags = Flags(increment.flags).only(Flags::SAMPLE);
                let mut expected = Flags::default();
                for (value, axis, below, above) in [
                    (head, 0, Flags::head_below(0), Flags::head_above(0)),
                    (board, 1, Flags::board_below(1), Flags::board_above(1)),
                ] {
                    let (flag, outside) = match value {
                        v if !v.is_finite() => (Flags::not_finite(axis), None),
                        v if v < 0.9 => (below, Some(0.9)),
                        v if v > 4.2 => (above, Some(4.2)),
                        _ => (Flags::default(), Some(value)),
                    };
                    expected |= flag;
                    let at = |value| if axis == 0 { raw(value, 2.0) } else { raw(2.0, value) };
                    let dv = increment.velocity_increment[axis];
                    let exact = |place| {
                        answer(Some(&table(&text.replace("[0.9, 4.2]", "[0.4, 5.1]"))), &at(place)).velocity_increment
                            [axis]
                    };
                    match outside {
                        None => assert!(dv.is_nan(), "{policy} {value}"),
                        Some(_) if flag == Flags::default() => assert_eq!(dv, inside.velocity_increment[axis]),
                        Some(end) if policy == "clamp" => assert_eq!(dv, exact(end)),
                        Some(_) if policy == "extrapolate" => assert_eq!(dv, exact(value)),
                        Some(_) => assert!(dv.is_nan(), "{policy} {value}"),
                    }
                }
                assert_eq!(flags, expected, "{policy} {head} {board}");
                assert_eq!(increment.velocity_increment[2], inside.velocity_increment[2], "A3 is not concerned");
            }
        }
        let bad_interval = round_trip(&mut acquisition, &RawSample { interval_ns: 0, ..raw(2.0, 2.0) });
        assert!(bad_interval.velocity_increment.iter().all(|dv| dv.is_nan()));
        assert_eq!(Flags(bad_interval.flags).only(Flags::SAMPLE), Flags::INTERVAL);
        let status = domain.imu_status();
        assert_eq!(status["flagged"]["a1-head-below"], 6);
        assert_eq!(status["flagged"]["a2-not-finite"], 18);
        assert_eq!(status["flagged"]["interval"], 1);
        service.terminate();
    }
}

#[test]
fn a_full_queue_hands_the_sample_back_and_a_merge_loses_no_velocity() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let samples = recording();
    let mut acquisition = domain.acquisition("imu-a");
    service.stop();
    let fill = |loan: &mut RawSample, sample: &RawSample| {
        *loan = RawSample { session: loan.session, sequence: loan.sequence, ..*sample };
    };
    let mut sent = Vec::new();
    let mut held = None;
    for sample in &samples[..200] {
        let mut loan = match held.take() {
            None => {
                let mut loan = acquisition.loan().unwrap();
                fill(&mut loan, sample);
                loan
            }
            Some(mut loan) => {
                let waiting: &mut isotherm_client::Loan = &mut loan;
                waiting.merge(sample).unwrap();
                loan
            }
        };
        loan.sent_ns = 0;
        let copy = *loan;
        match acquisition.send(loan) {
            Ok(()) => sent.push(copy),
            Err(SendError::Full(loan)) => held = Some(loan),
            Err(other) => panic!("{other}"),
        }
    }
    assert_eq!((sent.len(), acquisition.in_flight()), (acquisition.depth(), acquisition.depth()));
    service.resume();
    wait_until("the first answer", || match acquisition.receive().unwrap() {
        Some(increment) => same(&increment, &answer(Some(&table(TABLE)), &sent[0])),
        None => false,
    });
    let merged = held.take().unwrap();
    sent.push(*merged);
    acquisition.send(merged).unwrap();
    for raw in &sent[1..] {
        let increment = acquisition.receive_timeout(TIMEOUT).unwrap().unwrap();
        assert!(same(&increment, &answer(Some(&table(TABLE)), raw)), "{}", raw.sequence);
        assert_eq!(increment.flags & Flags::GAP.0, 0, "a merged sample leaves no gap");
    }
    let pulses =
        |samples: &[RawSample]| samples.iter().map(|s| u64::from(s.accelerometers.positive_pulses[0])).sum::<u64>();
    assert_eq!(pulses(&sent), pulses(&samples[..200]), "every pulse was sent once");
    service.terminate();
}

#[test]
fn missing_samples_are_flagged_and_counted() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let lines: Vec<_> = fs::read_to_string(RUN).unwrap().lines().map(str::to_owned).collect();
    let kept = |k: &usize| *k != 100 && !(200..203).contains(k);
    let text: String = (0..301).filter(kept).map(|k| lines[k].clone() + "\n").collect();
    domain.write("gaps.csv", &text);
    let fed = columns(&domain.run_ok(&["feed", "--imu", "imu-a", "--delivery", "gaps.csv"]));
    let flagged: Vec<_> = (0..fed["sequence"].len()).filter(|&k| fed["delivery"][k].contains("gap")).collect();
    let sequences: Vec<_> = flagged.iter().map(|&k| fed["sequence"][k].as_str()).collect();
    assert_eq!(sequences, ["100", "202"], "the samples after the gaps");
    let status = domain.imu_status();
    assert_eq!((&status["gaps"], &status["missing"], &status["flagged"]["gap"]), (&2.into(), &4.into(), &2.into()));
    service.wait_for_log("4 samples were missing");
    service.terminate();
}

#[test]
fn an_uncalibrated_imu_gets_nan_until_its_table_appears() {
    let domain = TestDomain::new();
    let refused = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    assert_eq!(refused.status.code(), Some(74), "{}", text(&refused.stderr));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--allow-uncalibrated"]);
    let mut acquisition = domain.acquisition("imu-a");
    let sample = recording()[0];
    let increment = round_trip(&mut acquisition, &sample);
    assert!(increment.velocity_increment.iter().all(|dv| dv.is_nan()));
    assert_eq!((Flags(increment.flags).only(Flags::SAMPLE), increment.table), (Flags::NO_TABLE, 0));
    assert_eq!(domain.imu_status()["table"], serde_json::Value::Null);
    // That it waits is no fault. A file that cannot be its table is one.
    let waits = || domain.imu_status()["waits_for_table"] == true;
    let words = domain.run_ok(&["status"]);
    assert!(waits() && words.contains("waits for its first table (") && !words.contains("REFUSED"), "{words}");
    domain.replace("imu-a.toml", "no table");
    wait_until("the refusal", || !waits());
    let words = domain.run_ok(&["status"]);
    assert!(words.contains("REFUSED") && !words.contains("waits for"), "{words}");
    fs::remove_file(domain.path("imu-a.toml")).unwrap();
    wait_until("the wait", waits);
    domain.replace("imu-a.toml", TABLE);
    wait_until("the first table", || round_trip(&mut acquisition, &sample).table == table(TABLE).id());
    let increment = round_trip(&mut acquisition, &sample);
    assert_eq!(Flags(increment.flags).only(Flags::SAMPLE), Flags::default());
    assert_eq!(increment.velocity_increment, answer(Some(&table(TABLE)), &sample).velocity_increment);
    service.terminate();
}

#[test]
fn a_round_trip_without_a_service_times_out_and_its_late_answer_is_kept() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let sample = recording()[7];
    service.stop();
    let loan = acquisition.loan().unwrap();
    let outcome = acquisition.compensate(loan, Duration::from_millis(30));
    assert!(matches!(outcome, Err(CompensateError::Timeout)), "{outcome:?}");
    service.resume();
    let increment = round_trip(&mut acquisition, &sample);
    assert_eq!(increment.velocity_increment, answer(Some(&table(TABLE)), &sample).velocity_increment);
    assert_eq!((acquisition.in_flight(), acquisition.late().waiting()), (0, 1));
    let late = acquisition.receive().unwrap().unwrap();
    assert_eq!((late.sequence + 1, acquisition.receive().unwrap()), (increment.sequence, None));
    service.terminate();
}

/// Late answers count neither as in flight nor for a full queue, and the oldest gives way.
#[test]
fn compensate_alone_never_fills() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let depth = acquisition.depth();
    let mut late = 0;
    for turn in 0..3 {
        // So many answers are late that a queue which they filled would be full before the last turn.
        service.stop();
        for _ in 0..depth - 1 {
            let loan = acquisition.loan().unwrap();
            let outcome = acquisition.compensate(loan, Duration::ZERO);
            assert!(matches!(outcome, Err(CompensateError::Timeout)), "turn {turn}: {outcome:?}");
            late += 1;
        }
        service.resume();
        let loan = acquisition.loan().unwrap();
        let (sequence, increment) = (loan.sequence, acquisition.compensate(loan, TIMEOUT).unwrap());
        assert_eq!((increment.sequence, increment.flags & Flags::GAP.0, acquisition.in_flight()), (sequence, 0, 0));
    }
    assert_eq!((acquisition.late().waiting(), acquisition.late().dropped() as usize), (depth, late - depth));
    let kept: Vec<_> = std::iter::from_fn(|| acquisition.receive().unwrap()).map(|late| late.sequence).collect();
    assert_eq!(kept.len(), depth);
    assert!(kept.is_sorted() && *kept.last().unwrap() == 3 * depth as u64 - 2, "{kept:?}");
    service.terminate();
}

/// The pattern of an acquisition that drops what a full queue hands back.
#[test]
fn a_period_that_is_dropped_is_a_gap() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let mut reader = domain.reader("imu-a");
    service.stop();
    let (mut sent, mut dropped) = (0, 0);
    for _ in 0..200 {
        let loan = acquisition.loan().unwrap();
        match acquisition.send(loan) {
            Ok(()) => sent += 1,
            Err(SendError::Full(_)) => dropped += 1,
            Err(other) => panic!("{other}"),
        }
    }
    assert_eq!((sent, dropped, acquisition.lost()), (acquisition.depth() as u64, 200 - sent, 200 - sent));
    service.resume();
    while acquisition.in_flight() > 0 {
        acquisition.receive_timeout(TIMEOUT).unwrap().unwrap();
    }
    // What was never measured leaves no hole.
    let (first, second) = (acquisition.loan().unwrap(), acquisition.loan().unwrap());
    acquisition.cancel(second);
    acquisition.cancel(first);
    let loan = acquisition.loan().unwrap();
    assert_eq!(loan.sequence, 200);
    assert!(Flags(acquisition.compensate(loan, TIMEOUT).unwrap().flags).intersects(Flags::GAP));
    let read: Vec<_> = (0..=sent).map(|_| reader.receive_timeout(TIMEOUT).unwrap().unwrap()).collect();
    let gaps: Vec<_> = read.iter().filter(|read| read.flags & Flags::GAP.0 != 0).map(|read| read.sequence).collect();
    assert_eq!(gaps, [200]);
    let status = domain.imu_status();
    assert_eq!((&status["gaps"], &status["missing"]), (&1.into(), &dropped.into()));
    assert_eq!(acquisition.close(), ClosingNote { lost: dropped, unanswered: 0 });
    service.terminate();
}

/// A loss with no sample after it, reported to a service that is away when it happens.
#[test]
fn what_was_lost_at_the_end_is_logged_and_kept_in_the_status() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    assert_eq!(domain.imu_status()["closed"], serde_json::Value::Null);
    let session = format!("{:016x}", acquisition.session());
    service.kill();
    let (mut sent, mut dropped) = (0, 0);
    for _ in 0..acquisition.depth() + 10 {
        let loan = acquisition.loan().unwrap();
        match acquisition.send(loan) {
            Ok(()) => sent += 1,
            Err(_) => dropped += 1,
        }
    }
    assert_eq!(acquisition.close(), ClosingNote { lost: dropped, unanswered: sent });
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    service.wait_for_log("10 control periods had not been sent");
    wait_until("the status", || !domain.imu_status()["closed"].is_null());
    let closed = domain.imu_status()["closed"].clone();
    assert_eq!(
        (&closed["lost"], &closed["unanswered"], &closed["session"]),
        (&10.into(), &sent.into(), &session.into())
    );
    let status = domain.run_ok(&["status"]);
    assert!(
        status.contains(&format!(": 10 periods not sent since it connected, {sent} samples unanswered")),
        "{status}"
    );
    // One that loses nothing leaves it.
    drop(domain.acquisition("imu-a"));
    assert_eq!(domain.imu_status()["closed"], closed);
    service.terminate();
}

#[test]
fn a_sequence_that_does_not_rise_is_handed_back() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let mut loan = acquisition.loan().unwrap();
    loan.sequence = 10;
    acquisition.compensate(loan, TIMEOUT).unwrap();
    let mut loan = acquisition.loan().unwrap();
    assert_eq!(loan.sequence, 11);
    loan.sequence = 10;
    let Err(SendError::Sequence(mut loan)) = acquisition.send(loan) else { panic!("sent") };
    loan.sequence = 12;
    assert_ne!(acquisition.compensate(loan, TIMEOUT).unwrap().flags & Flags::GAP.0, 0);
    let old = acquisition.session();
    let loan = acquisition.loan().unwrap();
    acquisition.send(loan).unwrap();
    assert_eq!(acquisition.begin_session(), Err(InFlight(1)));
    assert!(acquisition.receive_timeout(TIMEOUT).unwrap().is_some());
    acquisition.begin_session().unwrap();
    let loan = acquisition.loan().unwrap();
    assert!(loan.sequence == 0 && loan.session != old);
    assert_eq!(acquisition.compensate(loan, TIMEOUT).unwrap().flags & Flags::GAP.0, 0);
    service.terminate();
}

/// `feed` and `replay` have one rule: within a session the sequence rises, up to the highest number of 64 bits.
#[test]
fn the_highest_sequence_is_sent_and_none_after_it() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let run = fs::read_to_string(RUN).unwrap();
    let mut lines = run.lines();
    let header = lines.next().unwrap();
    let row = |sequence: u64, line: &str| format!("{sequence},{}\n", line.split_once(',').unwrap().1);
    let rows: Vec<_> = (u64::MAX - 2..=u64::MAX).zip(lines).map(|(sequence, line)| row(sequence, line)).collect();
    let rising = domain.write("rising.csv", &format!("{header}\n{}", rows.concat()));
    let rising = rising.to_str().unwrap();
    let table = domain.path("imu-a.toml");
    let replayed = domain.run_ok(&["replay", "--table", table.to_str().unwrap(), rising]);
    assert_eq!(domain.run_ok(&["feed", "--imu", "imu-a", rising]), replayed);
    assert!(replayed.contains("\n18446744073709551615,"), "{replayed}");
    let wrapped = format!("{header}\n{}{}", rows.concat(), row(0, &rows[0]));
    let wrapped = domain.write("wrapped.csv", &wrapped);
    for command in [&["replay", "--table", table.to_str().unwrap()][..], &["feed", "--imu", "imu-a"]] {
        let output = domain.run(&[command, &[wrapped.to_str().unwrap()]].concat());
        assert_eq!(output.status.code(), Some(65));
        assert!(text(&output.stderr).contains(":5: sequence 0 after 18446744073709551615"), "{}", text(&output.stderr));
    }
    // The library hands it back.
    let mut acquisition = domain.acquisition("imu-a");
    let mut loan = acquisition.loan().unwrap();
    loan.sequence = u64::MAX;
    assert_eq!(acquisition.compensate(loan, TIMEOUT).unwrap().sequence, u64::MAX);
    for sequence in [u64::MAX, 0] {
        let mut loan = acquisition.loan().unwrap();
        loan.sequence = sequence;
        assert!(matches!(acquisition.send(loan), Err(SendError::Sequence(_))));
    }
    acquisition.begin_session().unwrap();
    let loan = acquisition.loan().unwrap();
    assert_eq!(acquisition.compensate(loan, TIMEOUT).unwrap().sequence, 0);
    service.terminate();
}

#[test]
fn demo_prints_every_step_and_leaves_only_its_report() {
    let domain = TestDomain::new();
    let demo = domain.isotherm(&["demo"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let name = format!("demo-{}", demo.id());
    let output = demo.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    for word in ["Output stability", "1 reload", "0 lost, 0 out of order", "round trip", "p99.9"] {
        assert!(printed.contains(word), "{word:?} is missing in:\n{printed}");
    }
    let left: Vec<_> = fs::read_dir(domain.path("")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["isotherm-demo-report.txt"]);
    let demo_domain = Domain::new(&name, &domain.path(&name).display().to_string()).unwrap();
    let shared: Vec<_> = fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!shared.iter().any(|name| name.to_string_lossy().starts_with(&demo_domain.prefix())), "{shared:?}");
}

/// A caller that uses only `compensate` recovers after the service was gone so long that the queue filled up.
#[test]
fn compensate_alone_recovers_from_a_full_queue() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    service.kill();
    let mut attempts = 0;
    loop {
        let loan = acquisition.loan().unwrap();
        attempts += 1;
        match acquisition.compensate(loan, Duration::from_micros(100)) {
            Err(CompensateError::Timeout) => {}
            Err(CompensateError::Send(SendError::Full(_))) => break,
            other => panic!("{other:?}"),
        }
        assert!(attempts < 1000);
    }
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let sample = recording()[9];
    let exact = answer(Some(&table(TABLE)), &sample).velocity_increment;
    wait_until("an answer", || {
        let mut loan = acquisition.loan().unwrap();
        *loan = RawSample { session: loan.session, sequence: loan.sequence, ..sample };
        acquisition
            .compensate(loan, Duration::from_millis(20))
            .is_ok_and(|increment| increment.velocity_increment == exact)
    });
    service.terminate();
}

#[test]
fn the_longest_names_work() {
    let domain = TestDomain::new();
    let (name, imu) = ("d".repeat(32), "i".repeat(32));
    domain.write("t.toml", &TABLE.replace("imu-a", &imu));
    // With /tmp as temporary folder this is the longest allowed path. The default, /tmp/isotherm-NAME, is shorter.
    let isotherm = |arguments: &[&str]| {
        let mut command = domain.isotherm(arguments);
        command.env("ISOTHERM_DOMAIN", &name).env("ISOTHERM_ROOT", domain.path("").join("r".repeat(3)));
        command
    };
    let root = domain.path("").join("r".repeat(3)).join(&name).display().to_string();
    assert!(root.len() <= 52, "{root}");
    let mut service = isotherm(&["serve", "--imu", &format!("{imu}=t.toml")]).stderr(Stdio::null()).spawn().unwrap();
    let fed = isotherm(&["feed", "--imu", &imu, RUN]).output().unwrap();
    assert!(fed.status.success(), "{}", text(&fed.stderr));
    assert!(text(&fed.stdout) == domain.run_ok(&["replay", "--table", "t.toml", RUN]));
    isotherm_tests::kill(service.id(), rustix::process::Signal::TERM);
    assert!(service.wait().unwrap().success());
    assert!(isotherm(&["clean"]).status().unwrap().success());
}

#[test]
fn a_recording_is_never_overwritten_by_its_increments() {
    let domain = TestDomain::new();
    fs::copy(RUN, domain.path("run.csv")).unwrap();
    domain.write("imu-a.toml", TABLE);
    for command in [&["replay", "--table", "imu-a.toml"][..], &["feed", "--imu", "imu-a"]] {
        let output = domain.run(&[command, &["run.csv", "-o", "run.csv"]].concat());
        assert_eq!(output.status.code(), Some(64), "{}", text(&output.stderr));
    }
    assert_eq!(fs::read(domain.path("run.csv")).unwrap(), fs::read(RUN).unwrap());
}

#[test]
fn a_row_that_does_not_rise_ends_feed_and_replay_after_the_same_increments() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut rows: Vec<_> = fs::read_to_string(RUN).unwrap().lines().take(101).map(str::to_owned).collect();
    // A row that comes again.
    rows.push(rows[100].clone());
    domain.write("bad.csv", &rows.join("\n"));
    let fed = domain.run(&["feed", "--imu", "imu-a", "bad.csv"]);
    let replayed = domain.run(&["replay", "--table", "imu-a.toml", "bad.csv"]);
    assert_eq!((fed.status.code(), replayed.status.code()), (Some(65), Some(65)), "{}", text(&fed.stderr));
    assert_eq!(text(&fed.stdout), text(&replayed.stdout));
    assert_eq!(text(&fed.stdout).lines().count(), 101);
    service.terminate();
}
