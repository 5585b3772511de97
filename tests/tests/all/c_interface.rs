//! The C interface: C and C++ programs as users write them, compiled with all warnings as errors, with a real service.

use isotherm_client::{Flags, RawSample};
use isotherm_recording::RawCsvReader;
use isotherm_tests::programs::{
    C, CPP, SERIAL, assert_exact, compile, compile_with, library, rows, run, start, whole_csv,
};
use isotherm_tests::{
    Needs, RUN, TABLE, TestDomain, WHOLE_TABLE, completed, recording, skip, table, text, wait_until, whole_recording,
};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

/// A recording of a whole IMU for [`WHOLE_TABLE`].
const WHOLE_RUN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/run-g.csv");

#[test]
fn the_examples_compensate_exactly() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for (language, source) in [(C, "examples/c/acquisition.c"), (CPP, "examples/cpp/acquisition.cpp")] {
        let Some(program) = compile(&domain, language, source) else { continue };
        run(&domain, &program, &["imu-a", RUN], "out.csv");
        assert_exact(&rows(&domain, "out.csv"), TABLE, &recording());
    }
    service.terminate();
}

/// Gyroscopes, the lag of the temperature, and the unit, in C and C++: as the kernel computes them from the samples
/// with what the library adds.
#[test]
fn the_examples_compensate_a_whole_imu_exactly() {
    let domain = TestDomain::new();
    // The table is of another device, which every increment shows.
    let other = WHOLE_TABLE.replace("gravity =", "serial = \"SN 43\"\ngravity =");
    domain.write("imu-g.toml", &other);
    let service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
    let samples = whole_recording(1000);
    let (header, lines) = whole_csv(&samples);
    let recording = domain.write("whole.csv", &(header + &lines.concat()));
    let expected = completed(&samples, table(WHOLE_TABLE).lag_ns(), SERIAL);
    for (language, source) in [(C, "examples/c/acquisition.c"), (CPP, "examples/cpp/acquisition.cpp")] {
        let Some(program) = compile(&domain, language, source) else { continue };
        run(&domain, &program, &["imu-g", recording.to_str().unwrap()], "out.csv");
        assert_exact(&rows(&domain, "out.csv"), &other, &expected);
        assert!(rows(&domain, "out.csv").lines().all(|line| line.contains("other-device")));
    }
    service.terminate();
}

/// A recording of a whole IMU with every peculiarity that a sample can have, and its increments in IEEE double, of
/// another hand than this code.
#[test]
fn all_bits_pass_through_the_structures_of_c_and_cpp() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let samples: Vec<RawSample> =
        RawCsvReader::new(File::open(WHOLE_RUN).unwrap()).unwrap().map(Result::unwrap).collect();
    let bytes: Vec<u8> = samples.iter().flat_map(sample_bytes).collect();
    let double = fs::read_to_string(WHOLE_RUN.replace(".csv", ".double.csv")).unwrap();
    let (_, double) = double.split_once('\n').unwrap();
    for language in [C, CPP] {
        let Some(program) = compile(&domain, language, "tests/programs/bytes.c") else { continue };
        let mut running = start(&domain, &program, &["imu-g"], "out");
        running.stdin.take().unwrap().write_all(&bytes).unwrap();
        assert!(running.wait().unwrap().success());
        let out = fs::read(domain.path("out")).unwrap();
        let (increments, rest) = out.as_chunks::<104>();
        assert_eq!((increments.len(), rest.len(), double.lines().count()), (samples.len(), 0, samples.len()));
        for (increment, row) in increments.iter().zip(double.lines()) {
            let longs: Vec<_> = increment.as_chunks().0.iter().map(|long| u64::from_ne_bytes(*long)).collect();
            let row: Vec<_> = row.split(',').collect();
            let expected = [0, 1, 2].map(|index| row[index].parse::<u64>().unwrap());
            assert_eq!(longs[1..4], expected);
            // A text has one NaN.
            let bits = |value: f64| if value.is_nan() { u64::MAX } else { value.to_bits() };
            let expected: Vec<_> = row[3..9].iter().map(|value| bits(value.parse().unwrap())).collect();
            assert_eq!(longs[4..10].iter().map(|value| bits(f64::from_bits(*value))).collect::<Vec<_>>(), expected);
            assert_eq!(Flags(longs[11]).only(Flags::SAMPLE).to_string(), row[9]);
        }
    }
    service.terminate();
}

/// Programs are compiled with more warnings than ours, or with an older standard.
#[test]
fn the_headers_pass_with_more_warnings_and_name_the_standard_that_they_need() {
    let domain = TestDomain::new();
    let more = ["-Wconversion", "-Wsign-conversion", "-Wold-style-cast"];
    for (language, options) in [(C, &more[..2]), (CPP, &more[..])] {
        let Some(program) = compile_with(&domain, language, "tests/programs/headers.c", options) else { continue };
        run(&domain, &program, &[], "out");
    }
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/programs/headers.c");
    let include = concat!("-I", env!("CARGO_MANIFEST_DIR"), "/../client/include");
    match Command::new(CPP.0).args(["-x", "c++", "-std=c++14", "-fsyntax-only", include, source]).output() {
        Ok(output) => assert!(!output.status.success() && text(&output.stderr).contains("needs C++17")),
        Err(_) => skip("there is no C++ compiler", Needs::Program),
    }
}

/// A temperature that a program forgets is no temperature of 0.
#[test]
fn a_temperature_that_is_not_filled_in_gives_nan_and_a_flag() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    for language in [C, CPP] {
        let Some(program) = compile(&domain, language, "tests/programs/initial.c") else { continue };
        run(&domain, &program, &["imu-g"], "out");
        let out = fs::read(domain.path("out")).unwrap();
        let (increments, rest) = out.as_chunks::<104>();
        assert_eq!((increments.len(), rest.len()), (2, 0));
        for increment in increments {
            let longs: Vec<_> = increment.as_chunks().0.iter().map(|long| u64::from_ne_bytes(*long)).collect();
            assert!(longs[4..10].iter().all(|value| f64::from_bits(*value).is_nan()), "{longs:?}");
            let flags = Flags(longs[11]);
            assert!((0..3).all(|axis| flags.intersects(Flags::not_finite(axis))), "{flags}");
        }
    }
    service.terminate();
}

/// A loan and `ISOTHERM_RAW_SAMPLE_INIT` are of an IMU without gyroscopes.
#[test]
fn samples_of_c_and_cpp_have_no_gyroscopes_until_they_are_filled_in() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    for language in [C, CPP] {
        let Some(program) = compile(&domain, language, "tests/programs/initial.c") else { continue };
        run(&domain, &program, &["imu-g", "2.5"], "out");
        let out = fs::read(domain.path("out")).unwrap();
        let (increments, rest) = out.as_chunks::<104>();
        assert_eq!((increments.len(), rest.len()), (2, 0));
        for increment in increments {
            let longs: Vec<_> = increment.as_chunks().0.iter().map(|long| u64::from_ne_bytes(*long)).collect();
            assert!(longs[4..7].iter().all(|velocity| f64::from_bits(*velocity).is_finite()), "{longs:?}");
            assert!(longs[7..10].iter().all(|angle| f64::from_bits(*angle).is_nan()), "{longs:?}");
            let flags = Flags(longs[11]).to_string();
            assert!(["g1", "g2", "g3"].iter().all(|name| flags.contains(&format!("{name}-not-finite"))), "{flags}");
        }
    }
    service.terminate();
}

/// The bytes of a sample in the order of its fields, which have no padding.
fn sample_bytes(raw: &RawSample) -> Vec<u8> {
    let longs = [raw.session, raw.sequence, raw.timestamp_ns, raw.interval_ns, raw.sent_ns, raw.telemetry_ns];
    let mut bytes = longs.into_iter().chain([raw.lag_ns, raw.device]).flat_map(u64::to_ne_bytes).collect::<Vec<_>>();
    for triad in [&raw.accelerometers, &raw.gyroscopes] {
        let pulses = [triad.positive_pulses, triad.negative_pulses];
        let temperature = [triad.head_temperature, triad.board_temperature, triad.head_lagged];
        bytes.extend(pulses.as_flattened().iter().flat_map(|count| count.to_ne_bytes()));
        bytes.extend(temperature.as_flattened().iter().flat_map(|value| value.to_ne_bytes()));
    }
    bytes
}

#[test]
fn the_c_reader_prints_every_increment() {
    // Fewer than the reader's queue holds, so that a slow reader loses none.
    const SENT: usize = 200;
    let domain = TestDomain::new();
    let [reader, acquisition] =
        ["examples/c/reader.c", "examples/c/acquisition.c"].map(|source| compile(&domain, C, source).unwrap());
    // The reader starts before the service.
    let mut reading = start(&domain, &reader, &["imu-a", &SENT.to_string()], "read.csv");
    let service = domain.serve_recording();
    wait_until("the reader", || domain.imu_status()["readers"] == 1);
    let head: String =
        fs::read_to_string(RUN).unwrap().lines().take(SENT + 1).map(|line| format!("{line}\n")).collect();
    let head = domain.write("head.csv", &head);
    run(&domain, &acquisition, &["imu-a", head.to_str().unwrap()], "out.csv");
    assert!(reading.wait().unwrap().success());
    assert_exact(&fs::read_to_string(domain.path("read.csv")).unwrap(), TABLE, &recording()[..SENT]);
    service.terminate();
}

#[test]
fn a_c_program_loses_nothing_when_the_service_is_killed() {
    let domain = TestDomain::new();
    let mut service = domain.serve_recording();
    let program = compile(&domain, C, "examples/c/acquisition.c").unwrap();
    let mut running = start(&domain, &program, &["imu-a", "/dev/stdin"], "out.csv");
    let mut reader = domain.reader("imu-a");
    let mut input = running.stdin.take().unwrap();
    let text = fs::read_to_string(RUN).unwrap();
    let (header, samples) = text.split_once('\n').unwrap();
    writeln!(input, "{header}").unwrap();
    let lines: Vec<_> = samples.split_inclusive('\n').collect();
    for part in lines.chunks(1000) {
        // The program soon has as many unanswered samples as allowed, and holds the next one.
        service.stop();
        input.write_all(part[..500].concat().as_bytes()).unwrap();
        service.kill();
        service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        input.write_all(part[500..].concat().as_bytes()).unwrap();
        let first: u64 = part[0].split_once(',').unwrap().0.parse().unwrap();
        wait_until("increments", || {
            reader.receive().unwrap().is_some_and(|increment| increment.sequence >= first + 500)
        });
    }
    drop(input);
    assert!(running.wait().unwrap().success());
    assert_exact(&rows(&domain, "out.csv"), TABLE, &recording());
    service.terminate();
}

#[test]
fn every_misuse_returns_an_error_code() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let program = compile(&domain, C, "tests/programs/abuse.c").unwrap();
    run(&domain, &program, &["imu-a", &service.pid().to_string()], "out");
    // The service is not affected.
    assert_eq!(domain.imu_status()["transport_errors"], 0);
    service.terminate();
}

/// A thread that locks memory touches its stack, and no more than that. Without the right to lock memory it lives, too.
#[test]
fn memory_is_locked_in_threads_with_small_stacks() {
    let domain = TestDomain::new();
    let program = compile(&domain, C, "tests/programs/stacks.c").unwrap();
    let codes = |program: &Path, words: &[&str]| {
        run(&domain, program, words, "out");
        fs::read_to_string(domain.path("out")).unwrap().lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let (granted, refused) = (["0"; 5], ["-15"; 5]);
    let found = codes(&program, &[]);
    assert!(found == granted || found == refused, "{found:?}");
    let counted = Path::new(env!("CARGO_BIN_EXE_counted"));
    assert_eq!(codes(counted, &["without-rights", program.to_str().unwrap()]), refused);
}

#[test]
fn the_cpp_wrapper_behaves_as_documented() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let Some(program) = compile(&domain, CPP, "tests/programs/wrapper.cpp") else { return };
    run(&domain, &program, &["imu-a"], "out");
    service.terminate();
}

#[test]
fn the_cpp_wrapper_returns_errors_where_there_are_no_exceptions() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let Some(program) = compile_with(&domain, CPP, "tests/programs/returning.cpp", &["-fno-exceptions"]) else {
        return;
    };
    run(&domain, &program, &["imu-a"], "out");
    service.terminate();
}

/// What the library exports is what `client/c/abi/symbols` lists: no less, which would break programs, and no more,
/// which they might come to use.
#[test]
fn the_library_exports_the_listed_functions() {
    let Ok(output) = Command::new("nm").args(["-D", "--defined-only"]).arg(library()).output() else {
        skip("there is no nm", Needs::Program);
        return;
    };
    let printed = text(&output.stdout);
    let mut exported: BTreeSet<_> = printed.lines().filter_map(|line| line.rsplit(' ').next()).collect();
    // One of the transport's, which the compiler exports from every library that contains it.
    exported.remove("__internal_default_logger");
    let listed = include_str!("../../../client/c/abi/symbols").lines();
    let listed: BTreeSet<_> = listed.filter_map(|line| line.strip_prefix(' ')?.split('@').next()).collect();
    assert_eq!(exported, listed);
}

#[test]
fn round_trips_allocate_nothing() {
    let domain = TestDomain::new();
    // With gyroscopes, transient terms and a lag.
    domain.write("imu-a.toml", &WHOLE_TABLE.replace("\"imu-g\"", "\"imu-a\""));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let program = compile(&domain, C, "tests/programs/allocations.c").unwrap();
    run(&domain, &program, &["imu-a", "20000"], "out");
    assert_eq!(fs::read_to_string(domain.path("out")).unwrap(), "0\n");
    service.terminate();
}

/// A signal that comes in the middle of a call, and of an allocation, finds its handle busy and allocates nothing.
#[test]
fn a_call_from_a_signal_handler_allocates_nothing() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let program = compile(&domain, C, "tests/programs/handler.c").unwrap();
    run(&domain, &program, &["imu-a"], "out");
    service.terminate();
}

/// Valgrind finds no invalid access and no leak.
#[test]
fn valgrind_finds_no_errors() {
    if Command::new("valgrind").arg("--version").output().is_err() {
        skip("there is no valgrind", Needs::Program);
        return;
    }
    for (source, recording) in [("examples/c/acquisition.c", true), ("tests/programs/abuse.c", false)] {
        let domain = TestDomain::new();
        let service = domain.serve_recording();
        let program = compile(&domain, C, source).unwrap();
        let pid = service.pid().to_string();
        let lost = ["--show-leak-kinds=definite,indirect", "--errors-for-leak-kinds=definite,indirect"];
        // Valgrind runs one thread at a time. Without fair scheduling a spinning thread could keep the other one from
        // running.
        // A forked child has the memory of its parent's helper threads, and not the threads.
        let known = concat!("--suppressions=", env!("CARGO_MANIFEST_DIR"), "/programs/forked.supp");
        let options =
            [known, "--quiet", "--fair-sched=yes", "--error-exitcode=9", "--leak-check=full", lost[0], lost[1]];
        // A part of the recording: valgrind is slow.
        let rows: String = fs::read_to_string(RUN).unwrap().split_inclusive('\n').take(801).collect();
        let part = domain.write("part.csv", &rows);
        let last = if recording { part.to_str().unwrap() } else { &pid };
        let words = [&options[..], &[program.to_str().unwrap(), "imu-a", last]].concat();
        run(&domain, Path::new("valgrind"), &words, "out.csv");
        service.terminate();
    }
}
