//! The C interface: programs in C and C++ as users write them, compiled with every warning an error, beside a real service.
#![allow(clippy::panic, clippy::print_stderr, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::{Flags, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_tests::{Needs, RUN, TABLE, World, recording, skip, table, text, wait_until};
use std::fs::{self, File};
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const C: (&str, &str) = ("cc", "-std=c11");
const CPP: (&str, &str) = ("c++", "-std=c++17");

/// Compiles a program of the repository; `None`, and a word about it, if there is no such compiler.
fn compile(world: &World, (compiler, standard): (&str, &str), source: &str) -> Option<PathBuf> {
    if Command::new(compiler).arg("--version").output().is_err() {
        skip(&format!("there is no {compiler}"), Needs::Program);
        return None;
    }
    // As `cargo build` leaves it, but from this build.
    let built = std::env::current_exe().unwrap().with_file_name("libisotherm_client.so");
    assert!(built.exists(), "{} is not built", built.display());
    for name in ["libisotherm_client.so", "libisotherm_client.so.0"] {
        let _ = symlink(&built, world.path(name));
    }
    let (folder, program) = (world.path(""), world.path(&source.replace('/', "-").replace('.', "_")));
    let mut command = Command::new(compiler);
    command.args([standard, "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-pthread"]);
    command.arg(format!("-I{ROOT}/client/include")).arg(format!("{ROOT}/{source}")).arg("-o").arg(&program);
    command.arg(format!("-L{}", folder.display())).arg(format!("-Wl,-rpath,{}", folder.display()));
    let output = command.arg("-lisotherm_client").output().unwrap();
    assert!(output.status.success(), "{source}:\n{}", text(&output.stderr));
    Some(program)
}

/// A program in a world, its output in a file of that name.
fn start(world: &World, program: &Path, arguments: &[&str], out: &str) -> Child {
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::piped()).stdout(File::create(world.path(out)).unwrap());
    command.env("ISOTHERM_DOMAIN", world.domain().name()).env("ISOTHERM_ROOT", world.path(""));
    let child = command.stderr(Stdio::inherit()).spawn().unwrap();
    world.watch(child.id());
    child
}

/// Runs a program to its end, which must be a good one.
fn run(world: &World, program: &Path, arguments: &[&str], out: &str) {
    let status = start(world, program, arguments, out).wait().unwrap();
    assert!(status.success(), "{} {arguments:?}: {status}", program.display());
}

/// That the examples' output is what the kernel makes of these samples: every increment once, in order, exact to the bit.
fn is_exact(printed: &str, samples: &[RawSample]) {
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

/// What a program has printed, without its first line.
fn rows(world: &World, out: &str) -> String {
    let printed = fs::read_to_string(world.path(out)).unwrap();
    printed.split_once('\n').unwrap().1.to_owned()
}

#[test]
fn the_examples_compensate_exactly() {
    let world = World::new();
    let service = world.serve_recording();
    for (language, source) in [(C, "examples/c/acquisition.c"), (CPP, "examples/cpp/acquisition.cpp")] {
        let Some(program) = compile(&world, language, source) else { continue };
        run(&world, &program, &["imu-a", RUN], "out.csv");
        is_exact(&rows(&world, "out.csv"), &recording());
    }
    service.terminate();
}

#[test]
fn the_reader_reads_all() {
    // Fewer than its queue holds, however slow it is.
    const SENT: usize = 200;
    let world = World::new();
    let [reader, acquisition] =
        ["examples/c/reader.c", "examples/c/acquisition.c"].map(|source| compile(&world, C, source).unwrap());
    // Before there is a service.
    let mut reading = start(&world, &reader, &["imu-a", &SENT.to_string()], "read.csv");
    let service = world.serve_recording();
    wait_until("the reader", || world.imu_status()["readers"] == 1);
    let head: String =
        fs::read_to_string(RUN).unwrap().lines().take(SENT + 1).map(|line| format!("{line}\n")).collect();
    let head = world.write("head.csv", &head);
    run(&world, &acquisition, &["imu-a", head.to_str().unwrap()], "out.csv");
    assert!(reading.wait().unwrap().success());
    is_exact(&fs::read_to_string(world.path("read.csv")).unwrap(), &recording()[..SENT]);
    service.terminate();
}

#[test]
fn a_c_program_loses_nothing_when_the_service_is_killed() {
    let world = World::new();
    let mut service = world.serve_recording();
    let program = compile(&world, C, "examples/c/acquisition.c").unwrap();
    let mut running = start(&world, &program, &["imu-a", "/dev/stdin"], "out.csv");
    let mut reader = world.reader("imu-a");
    let mut input = running.stdin.take().unwrap();
    let text = fs::read_to_string(RUN).unwrap();
    let (header, samples) = text.split_once('\n').unwrap();
    writeln!(input, "{header}").unwrap();
    let lines: Vec<_> = samples.split_inclusive('\n').collect();
    for part in lines.chunks(1000) {
        // It has as many samples unanswered as it may, and the next one in hand, or is on its way there.
        service.stop();
        input.write_all(part[..500].concat().as_bytes()).unwrap();
        service.kill();
        service = world.serve(&["--imu", "imu-a=imu-a.toml"]);
        input.write_all(part[500..].concat().as_bytes()).unwrap();
        let first: u64 = part[0].split_once(',').unwrap().0.parse().unwrap();
        wait_until("increments", || {
            reader.receive().unwrap().is_some_and(|increment| increment.sequence >= first + 500)
        });
    }
    drop(input);
    assert!(running.wait().unwrap().success());
    is_exact(&rows(&world, "out.csv"), &recording());
    service.terminate();
}

#[test]
fn whatever_is_done_wrong_is_answered_by_a_code() {
    let world = World::new();
    let service = world.serve_recording();
    let program = compile(&world, C, "tests/programs/abuse.c").unwrap();
    run(&world, &program, &["imu-a", &service.pid().to_string()], "out");
    // It goes on as if nothing had been.
    assert_eq!(world.imu_status()["transport_errors"], 0);
    service.terminate();
}

#[test]
fn the_wrapper_keeps_its_promises() {
    let world = World::new();
    let service = world.serve_recording();
    let Some(program) = compile(&world, CPP, "tests/programs/wrapper.cpp") else { return };
    run(&world, &program, &["imu-a"], "out");
    service.terminate();
}

#[test]
fn round_trips_allocate_nothing() {
    let world = World::new();
    let service = world.serve_recording();
    let program = compile(&world, C, "tests/programs/allocations.c").unwrap();
    run(&world, &program, &["imu-a", "20000"], "out");
    assert_eq!(fs::read_to_string(world.path("out")).unwrap(), "0\n");
    service.terminate();
}

/// No byte is used that is not there, and none is left behind.
#[test]
fn valgrind_finds_nothing() {
    if Command::new("valgrind").arg("--version").output().is_err() {
        skip("there is no valgrind", Needs::Program);
        return;
    }
    for (source, recording) in [("examples/c/acquisition.c", true), ("tests/programs/abuse.c", false)] {
        let world = World::new();
        let service = world.serve_recording();
        let program = compile(&world, C, source).unwrap();
        let pid = service.pid().to_string();
        let lost = ["--show-leak-kinds=definite,indirect", "--errors-for-leak-kinds=definite,indirect"];
        // Valgrind runs one thread at a time. Unless it is asked to take turns, a thread that spins can keep the other from ever running.
        let options = ["--quiet", "--fair-sched=yes", "--error-exitcode=9", "--leak-check=full", lost[0], lost[1]];
        let last = if recording { RUN } else { &pid };
        let words = [&options[..], &[program.to_str().unwrap(), "imu-a", last]].concat();
        run(&world, Path::new("valgrind"), &words, "out.csv");
        service.terminate();
    }
}
