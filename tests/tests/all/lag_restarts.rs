//! What a restart does to the lag of the temperatures, in C and Rust: the programs of `examples`, as users run them,
//! and the service are killed. `python/tests` does the same in Python.

use isotherm_client::{Flags, IncrementReader, RawSample, boot};
use isotherm_shared::compensate::answer;
use isotherm_shared::lag::Lag;
use isotherm_shared::wire::SENSORS;
use isotherm_tests::programs::{C, SERIAL, assert_exact, compile, rows, start, whole_csv};
use isotherm_tests::{TIMEOUT, TestDomain, WHOLE_TABLE, completed, same, table, wait_until, whole_recording};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Child;

/// Samples between two kills.
const PART: usize = 200;
/// File of the kept lag.
const STATE: &str = "lag.state";

/// The programs, each in a domain of its own.
fn programs() -> Vec<(TestDomain, PathBuf)> {
    let (c, rust) = (TestDomain::new(), TestDomain::new());
    let compiled = compile(&c, C, "examples/c/acquisition.c");
    let compiled = compiled.map(|program| (c, program));
    compiled.into_iter().chain([(rust, PathBuf::from(env!("CARGO_BIN_EXE_example-acquisition")))]).collect()
}

/// The table with another time constant.
fn with_lag(seconds: &str) -> String {
    WHOLE_TABLE.replace("time_constant_s = 240.0", &format!("time_constant_s = {seconds}"))
}

/// Starts a program, gives it rows, and asserts that each increment is the kernel's of the `expected` sample. Then it
/// waits for more rows.
fn run_part(
    domain: &TestDomain,
    program: &Path,
    words: &[&str],
    reader: &mut IncrementReader,
    [table_text, csv]: [&str; 2],
    expected: &[RawSample],
) -> Child {
    let mut running = start(domain, program, &[&["imu-g", "/dev/stdin"], words].concat(), "out.csv");
    // Borrowed, so that it stays open.
    running.stdin.as_mut().unwrap().write_all(csv.as_bytes()).unwrap();
    for raw in expected {
        let increment = reader.receive_timeout(TIMEOUT).unwrap().unwrap();
        let exact = answer(Some(&table(table_text)), &RawSample { session: increment.session, ..*raw });
        assert!(same(&increment, &exact), "{}:\n{increment:?}\n{exact:?}", program.display());
    }
    running
}

fn kill(mut running: Child) {
    running.kill().unwrap();
    running.wait().unwrap();
}

#[test]
fn a_killed_service_changes_no_lag() {
    for (domain, program) in programs() {
        let mut service = domain.serve_whole();
        let samples = whole_recording(5 * PART);
        let (header, lines) = whole_csv(&samples);
        let mut running = start(&domain, &program, &["imu-g", "/dev/stdin"], "out.csv");
        let mut reader = domain.reader("imu-g");
        let mut input = running.stdin.take().unwrap();
        // The program knows the time constant when it sends. A service that is stopped before would not have reported
        // it.
        input.write_all((header + &lines[0]).as_bytes()).unwrap();
        wait_until("the first increment", || reader.receive().unwrap().is_some());
        for (part, lines) in lines.chunks(PART).enumerate() {
            let lines = if part == 0 { &lines[1..] } else { lines };
            let [before, after] = [&lines[..PART / 2], &lines[PART / 2..]].map(<[String]>::concat);
            // The program has unanswered samples when the service dies.
            service.stop();
            input.write_all(before.as_bytes()).unwrap();
            service.kill();
            service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
            input.write_all(after.as_bytes()).unwrap();
            let middle = (part * PART + PART / 2) as u64;
            wait_until("increments of the new service", || {
                reader.receive().unwrap().is_some_and(|increment| increment.sequence >= middle)
            });
        }
        drop(input);
        assert!(running.wait().unwrap().success());
        // As if the service had never been killed, and without a flag.
        let expected = completed(&samples, table(WHOLE_TABLE).lag_ns(), SERIAL);
        assert_exact(&rows(&domain, "out.csv"), WHOLE_TABLE, &expected);
        assert_eq!(domain.imu_status()["flagged"]["lag-unknown"], 0);
        service.terminate();
    }
}

#[test]
fn a_killed_acquisition_hands_its_lag_over() {
    for (domain, program) in programs() {
        let service = domain.serve_whole();
        let samples = whole_recording(5 * PART);
        let (header, lines) = whole_csv(&samples);
        let expected = completed(&samples, table(WHOLE_TABLE).lag_ns(), SERIAL);
        let mut reader = domain.reader("imu-g");
        for (lines, expected) in lines.chunks(PART).zip(expected.chunks(PART)) {
            let csv = header.clone() + &lines.concat();
            kill(run_part(&domain, &program, &[STATE], &mut reader, [WHOLE_TABLE, &csv], expected));
        }
        assert_eq!(domain.imu_status()["flagged"]["lag-unknown"], 0);
        service.terminate();
    }
}

/// The samples as an acquisition sends them that begins with nothing known.
fn completed_from_unknown(samples: &[RawSample], lag_ns: u64) -> Vec<RawSample> {
    let mut lag = Lag::new(lag_ns);
    (0..SENSORS).for_each(|sensor| lag.forget(sensor));
    let mut all = completed(samples, lag_ns, SERIAL);
    for raw in &mut all {
        lag.follow(raw);
        lag.fill(raw);
        if !(0..SENSORS).all(|sensor| lag.is_known(sensor)) {
            raw.accelerometers.head_lagged = [f64::NAN; 3];
            raw.gyroscopes.head_lagged = [f64::NAN; 3];
        }
    }
    all
}

/// What becomes of a saved state.
type Loss = fn(Vec<u8>) -> Option<Vec<u8>>;

/// What one of the programs has saved, as if the machine had been started anew since.
fn of_another_boot(mut state: Vec<u8>) -> Vec<u8> {
    match serde_json::from_slice::<Lag>(&state) {
        Ok(lag) => serde_json::to_vec(&Lag { boot: lag.boot ^ 1, ..lag }).unwrap(),
        // The structure of C begins with it.
        Err(_) => {
            assert_eq!(state[..8], boot().to_ne_bytes());
            state[0] ^= 1;
            state
        }
    }
}

#[test]
fn a_killed_acquisition_that_hands_nothing_over_is_flagged_for_three_time_constants() {
    const LAG_NS: u64 = 1_000_000_000;
    /// New temperatures come each second, the first with the first sample.
    const FLAGGED: usize = 3 * 20;
    let text = with_lag("1.0");
    let samples = whole_recording(2 * PART);
    let (header, lines) = whole_csv(&samples);
    let undisturbed = completed(&samples, LAG_NS, SERIAL);
    let after = completed_from_unknown(&samples[PART..], LAG_NS);
    // The test would notice a lag that is not that of the unknown start, and it is near the right one when it is used.
    let head = |raw: &RawSample| (raw.accelerometers.head_temperature[0], raw.accelerometers.head_lagged[0]);
    let ((temperature, _), (_, right), (_, own)) =
        (head(&samples[PART + FLAGGED]), head(&undisturbed[PART + FLAGGED]), head(&after[FLAGGED]));
    assert!(own != right && (own - right).abs() < 0.06 * (temperature - right).abs(), "{own} {right} {temperature}");
    // The state is missing, useless, or of the time before the machine was started anew.
    let losses: [(&[&str], Loss); 3] = [
        (&[STATE, "unknown"], |_| None),
        (&[STATE], |_| Some(b"not a state".to_vec())),
        (&[STATE], |state| Some(of_another_boot(state))),
    ];
    for (words, loss) in losses {
        for (domain, program) in programs() {
            domain.write("imu-g.toml", &text);
            let service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
            let mut reader = domain.reader("imu-g");
            let csv = header.clone() + &lines[..PART].concat();
            kill(run_part(&domain, &program, &[STATE], &mut reader, [&text, &csv], &undisturbed[..PART]));
            assert_eq!(domain.imu_status()["flagged"]["lag-unknown"], 0);
            let state = fs::read(domain.path(STATE)).unwrap();
            fs::remove_file(domain.path(STATE)).unwrap();
            if let Some(state) = loss(state) {
                fs::write(domain.path(STATE), state).unwrap();
            }
            let csv = header.clone() + &lines[PART..].concat();
            kill(run_part(&domain, &program, words, &mut reader, [&text, &csv], &after));
            assert_eq!(domain.imu_status()["flagged"]["lag-unknown"], FLAGGED);
            service.terminate();
        }
    }
    let flagged = |raw: &RawSample| Flags(answer(Some(&table(&text)), raw).flags).intersects(Flags::LAG_UNKNOWN);
    assert_eq!(
        after.iter().map(flagged).collect::<Vec<_>>(),
        [vec![true; FLAGGED], vec![false; PART - FLAGGED]].concat()
    );
}

#[test]
fn a_killed_acquisition_begins_soaked_if_nothing_else_is_said() {
    let samples = whole_recording(2 * PART);
    let (header, lines) = whole_csv(&samples);
    let lag_ns = table(WHOLE_TABLE).lag_ns();
    for (domain, program) in programs() {
        let service = domain.serve_whole();
        let mut reader = domain.reader("imu-g");
        for part in [0..PART, PART..2 * PART] {
            let csv = header.clone() + &lines[part.clone()].concat();
            let expected = completed(&samples[part], lag_ns, SERIAL);
            kill(run_part(&domain, &program, &[], &mut reader, [WHOLE_TABLE, &csv], &expected));
        }
        assert_eq!(domain.imu_status()["flagged"]["lag-unknown"], 0);
        service.terminate();
    }
}
