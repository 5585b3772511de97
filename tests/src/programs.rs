//! Acquisition programs as users write them, in C, C++ and Rust: compiled, started in a test's domain, and their output
//! checked.
#![allow(clippy::missing_panics_doc, clippy::panic, clippy::unwrap_used, reason = "in a test the panic is the report")]

use crate::{Needs, TestDomain, skip, table, text};
use isotherm_client::{Flags, RawSample};
use isotherm_shared::compensate::answer;
use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// The C compiler, and its standard.
pub const C: (&str, &str) = ("cc", "-std=c11");
/// The C++ compiler, and its standard.
pub const CPP: (&str, &str) = ("c++", "-std=c++17");

/// The C library of this build.
pub fn library() -> PathBuf {
    let built = std::env::current_exe().unwrap().with_file_name("libisotherm_client.so");
    assert!(built.exists(), "{} is not built", built.display());
    built
}

/// Compiles a program of the repository. Without the compiler it reports the test as skipped and returns `None`.
pub fn compile(domain: &TestDomain, language: (&str, &str), source: &str) -> Option<PathBuf> {
    compile_with(domain, language, source, &[])
}

/// As [`compile`], with more options of the compiler.
pub fn compile_with(
    domain: &TestDomain,
    (compiler, standard): (&str, &str),
    source: &str,
    options: &[&str],
) -> Option<PathBuf> {
    if Command::new(compiler).arg("--version").output().is_err() {
        skip(&format!("there is no {compiler}"), Needs::Program);
        return None;
    }
    let built = library();
    for name in ["libisotherm_client.so", "libisotherm_client.so.0"] {
        let _ = symlink(&built, domain.path(name));
    }
    let name = format!("{compiler}-{}", source.replace('/', "-").replace('.', "_"));
    let (folder, program) = (domain.path(""), domain.path(&name));
    let mut command = Command::new(compiler);
    // The language is the compiler's, whatever the file's name is.
    command.args(["-x", if standard == CPP.1 { "c++" } else { "c" }]);
    command.args([standard, "-O1", "-g", "-Wall", "-Wextra", "-Wshadow", "-Wpedantic", "-Werror", "-pthread"]);
    command.args(options);
    command
        .arg(format!("-I{ROOT}/client/include"))
        .arg(format!("{ROOT}/{source}"))
        .args(["-x", "none", "-o"])
        .arg(&program);
    command.arg(format!("-L{}", folder.display())).arg(format!("-Wl,-rpath,{}", folder.display()));
    let output = command.arg("-lisotherm_client").output().unwrap();
    assert!(output.status.success(), "{source}:\n{}", text(&output.stderr));
    Some(program)
}

/// The serial number that the examples send to the service.
pub const SERIAL: &str = "SN 42";

/// Starts a program in the test's domain. Its output goes to the file `out`.
pub fn start(domain: &TestDomain, program: &Path, arguments: &[&str], out: &str) -> Child {
    let mut command = Command::new(program);
    command
        .args(arguments)
        .current_dir(domain.path(""))
        .stdin(Stdio::piped())
        .stdout(File::create(domain.path(out)).unwrap());
    command.env("ISOTHERM_DOMAIN", domain.client_domain().name()).env("ISOTHERM_ROOT", domain.path(""));
    command.env("SERIAL", SERIAL);
    // Cargo's path comes before the program's own and may lead to the library of an older build.
    command.env_remove("LD_LIBRARY_PATH");
    let child = command.stderr(Stdio::inherit()).spawn().unwrap();
    domain.register_process(child.id());
    child
}

/// Runs a program and asserts that it succeeds.
pub fn run(domain: &TestDomain, program: &Path, arguments: &[&str], out: &str) {
    let status = start(domain, program, arguments, out).wait().unwrap();
    assert!(status.success(), "{} {arguments:?}: {status}", program.display());
}

/// Asserts that the output of an example has the increment of every sample once, in order and exact to the bit.
pub fn assert_exact(printed: &str, text: &str, samples: &[RawSample]) {
    let exact = table(text);
    let increments = if exact.content().gyroscopes.is_some() { 6 } else { 3 };
    let rows: Vec<Vec<&str>> = printed.lines().map(|line| line.split(',').collect()).collect();
    let sequences: Vec<_> = rows.iter().map(|row| row[0].to_owned()).collect();
    assert_eq!(sequences, samples.iter().map(|sample| sample.sequence.to_string()).collect::<Vec<_>>());
    for (row, sample) in rows.iter().zip(samples) {
        let expected = answer(Some(&exact), sample);
        let (values, rest) = row[1..].split_at(increments);
        let values: Vec<u64> = values.iter().map(|value| value.parse::<f64>().unwrap().to_bits()).collect();
        let exact = [expected.velocity_increment, expected.angle_increment].as_flattened()[..increments].to_vec();
        assert_eq!(values, exact.into_iter().map(f64::to_bits).collect::<Vec<_>>(), "{row:?}");
        if let [digits, flags] = rest {
            assert_eq!(*digits, format!("{:016x}", expected.table));
            // Not those that depend on the machine, and on the programs that were there before.
            let sample_flags: Vec<_> = flags.split('|').filter(|name| !["late", "session"].contains(name)).collect();
            let none = if sample_flags.is_empty() { "-" } else { "" };
            assert_eq!(sample_flags.join("|") + none, Flags(expected.flags).to_string());
        }
    }
}

/// The header and the rows of a recording of a whole IMU, in the columns of the examples.
pub fn whole_csv(samples: &[RawSample]) -> (String, Vec<String>) {
    let names = ["a1", "a2", "a3", "g1", "g2", "g3"];
    let columns =
        names.map(|name| ["positive", "negative", "head", "board"].map(|end| format!("{name}_{end}")).join(","));
    let row = |sample: &RawSample| {
        let sensors = [&sample.accelerometers, &sample.gyroscopes].map(|triad| {
            let sensor = |axis: usize| {
                let (positive, negative) = (triad.positive_pulses[axis], triad.negative_pulses[axis]);
                format!("{positive},{negative},{:?},{:?}", triad.head_temperature[axis], triad.board_temperature[axis])
            };
            [0, 1, 2].map(sensor).join(",")
        });
        format!("{},{},{},{}\n", sample.sequence, sample.timestamp_ns, sample.interval_ns, sensors.join(","))
    };
    (format!("sequence,timestamp_ns,interval_ns,{}\n", columns.join(",")), samples.iter().map(row).collect())
}

/// The output of a program, without its first line.
pub fn rows(domain: &TestDomain, out: &str) -> String {
    let printed = fs::read_to_string(domain.path(out)).unwrap();
    printed.split_once('\n').unwrap().1.to_owned()
}
