//! The C interface: C and C++ programs as users write them, compiled with all warnings as errors, with a real service.
#![allow(clippy::panic, clippy::print_stderr, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::{Flags, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_tests::{Needs, RUN, TABLE, TestDomain, recording, skip, table, text, wait_until};
use std::fs::{self, File};
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const C: (&str, &str) = ("cc", "-std=c11");
const CPP: (&str, &str) = ("c++", "-std=c++17");

/// Compiles a program of the repository. Without the compiler it reports the test as skipped and returns `None`.
fn compile(domain: &TestDomain, (compiler, standard): (&str, &str), source: &str) -> Option<PathBuf> {
    if Command::new(compiler).arg("--version").output().is_err() {
        skip(&format!("there is no {compiler}"), Needs::Program);
        return None;
    }
    // The library of this build.
    let built = std::env::current_exe().unwrap().with_file_name("libisotherm_client.so");
    assert!(built.exists(), "{} is not built", built.display());
    for name in ["libisotherm_client.so", "libisotherm_client.so.0"] {
        let _ = symlink(&built, domain.path(name));
    }
    let (folder, program) = (domain.path(""), domain.path(&source.replace('/', "-").replace('.', "_")));
    let mut command = Command::new(compiler);
    command.args([standard, "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-pthread"]);
    command.arg(format!("-I{ROOT}/client/include")).arg(format!("{ROOT}/{source}")).arg("-o").arg(&program);
    command.arg(format!("-L{}", folder.display())).arg(format!("-Wl,-rpath,{}", folder.display()));
    let output = command.arg("-lisotherm_client").output().unwrap();
    assert!(output.status.success(), "{source}:\n{}", text(&output.stderr));
    Some(program)
}

/// Starts a program in the test's domain. Its output goes to the file `out`.
fn start(domain: &TestDomain, program: &Path, arguments: &[&str], out: &str) -> Child {
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::piped()).stdout(File::create(domain.path(out)).unwrap());
    command.env("ISOTHERM_DOMAIN", domain.client_domain().name()).env("ISOTHERM_ROOT", domain.path(""));
    // Cargo's path comes before the program's own and may lead to the library of an older build.
    command.env_remove("LD_LIBRARY_PATH");
    let child = command.stderr(Stdio::inherit()).spawn().unwrap();
    domain.register_process(child.id());
    child
}

/// Runs a program and asserts that it succeeds.
fn run(domain: &TestDomain, program: &Path, arguments: &[&str], out: &str) {
    let status = start(domain, program, arguments, out).wait().unwrap();
    assert!(status.success(), "{} {arguments:?}: {status}", program.display());
}

/// Asserts that the output of an example has the increment of every sample once, in order and exact to the bit.
fn assert_exact(printed: &str, samples: &[RawSample]) {
    let exact = table(TABLE);
    let rows: Vec<Vec<&str>> = printed.lines().map(|line| line.split(',').collect()).collect();
    let sequences: Vec<_> = rows.iter().map(|row| row[0].to_owned()).collect();
    assert_eq!(sequences, samples.iter().map(|sample| sample.sequence.to_string()).collect::<Vec<_>>());
    for (row, sample) in rows.iter().zip(samples) {
        let expected = answer(Some(&exact), sample);
        let increment: Vec<u64> = row[1..4].iter().map(|dv| dv.parse::<f64>().unwrap().to_bits()).collect();
        assert_eq!(increment, expected.velocity_increment.map(f64::to_bits), "{row:?}");
        if let Some([digits, flags]) = row.get(4..6) {
            assert_eq!(*digits, format!("{:016x}", expected.table));
            let sample_flags: Vec<_> = flags.split('|').filter(|name| *name != "late").collect();
            let none = if sample_flags.is_empty() { "-" } else { "" };
            assert_eq!(sample_flags.join("|") + none, Flags(expected.flags).to_string());
        }
    }
}

/// The output of a program, without its first line.
fn rows(domain: &TestDomain, out: &str) -> String {
    let printed = fs::read_to_string(domain.path(out)).unwrap();
    printed.split_once('\n').unwrap().1.to_owned()
}

#[test]
fn the_examples_compensate_exactly() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for (language, source) in [(C, "examples/c/acquisition.c"), (CPP, "examples/cpp/acquisition.cpp")] {
        let Some(program) = compile(&domain, language, source) else { continue };
        run(&domain, &program, &["imu-a", RUN], "out.csv");
        assert_exact(&rows(&domain, "out.csv"), &recording());
    }
    service.terminate();
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
    assert_exact(&fs::read_to_string(domain.path("read.csv")).unwrap(), &recording()[..SENT]);
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
    assert_exact(&rows(&domain, "out.csv"), &recording());
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

#[test]
fn the_cpp_wrapper_behaves_as_documented() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let Some(program) = compile(&domain, CPP, "tests/programs/wrapper.cpp") else { return };
    run(&domain, &program, &["imu-a"], "out");
    service.terminate();
}

#[test]
fn round_trips_allocate_nothing() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let program = compile(&domain, C, "tests/programs/allocations.c").unwrap();
    run(&domain, &program, &["imu-a", "20000"], "out");
    assert_eq!(fs::read_to_string(domain.path("out")).unwrap(), "0\n");
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
        // Valgrind runs one thread at a time. Without fair scheduling a spinning thread could keep the other one from running.
        let options = ["--quiet", "--fair-sched=yes", "--error-exitcode=9", "--leak-check=full", lost[0], lost[1]];
        let last = if recording { RUN } else { &pid };
        let words = [&options[..], &[program.to_str().unwrap(), "imu-a", last]].concat();
        run(&domain, Path::new("valgrind"), &words, "out.csv");
        service.terminate();
    }
}
