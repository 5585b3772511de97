//! Foreign data through the program: exit codes, what is written, and the way to ROS and back.

use isotherm_tests::{RUN, TABLE, TestDomain, recording, text, wait_until};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::process::Signal;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/formats/tests/data/convert");
const NOVATEL: &str = "%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,607017,-1009773*1fb76c28\n";

/// Runs the program: exit code, stdout and stderr.
fn run(domain: &TestDomain, arguments: &[&str]) -> (i32, String, String) {
    let output = domain.run(arguments);
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

/// A domain with the real data in its folder.
fn domain() -> TestDomain {
    let domain = TestDomain::new();
    for name in ["source.csv", "mapping.toml", "source.expected.csv"] {
        domain.write(name, &fs::read_to_string(Path::new(DATA).join(name)).unwrap());
    }
    domain
}

#[test]
fn a_text_is_converted_byte_for_byte_to_a_file_a_pipe_and_mcap() {
    let domain = domain();
    let expected = fs::read_to_string(domain.path("source.expected.csv")).unwrap();
    let convert = |more: &[&str]| run(&domain, &[&["convert", "--mapping", "mapping.toml"], more].concat());
    let (code, stdout, stderr) = convert(&["source.csv", "-o", "run.csv"]);
    assert_eq!((code, stdout.as_str(), stderr.as_str()), (0, "", "isotherm: 300 rows in run.csv\n"));
    assert!(fs::read_to_string(domain.path("run.csv")).unwrap() == expected);
    let (code, stdout, stderr) = convert(&["source.csv", "-o", "-"]);
    assert_eq!((code, stderr.as_str()), (0, "isotherm: 300 rows in stdout\n"));
    assert!(stdout == expected);
    let piped = domain.isotherm(&["convert", "--mapping", "mapping.toml", "-", "-o", "-"]);
    let mut piped = piped;
    piped.stdin(fs::File::open(domain.path("source.csv")).unwrap());
    assert!(text(&piped.output().unwrap().stdout) == expected);
    // The same samples in MCAP: every command reads both alike.
    domain.write("imu-a.toml", TABLE);
    assert_eq!(convert(&["source.csv", "-o", "run.mcap", "--imu", "imu-a"]).0, 0);
    let replayed = |file: &str| domain.run_ok(&["replay", "--table", "imu-a.toml", file]);
    assert_eq!(replayed("run.csv").lines().count(), 301);
    assert!(replayed("run.csv") == replayed("run.mcap"));
    // The old content of an existing file stays until the new one is complete.
    let spoilt = fs::read_to_string(domain.path("source.csv")).unwrap().replace("1\n", "o\n");
    domain.write("spoilt.csv", &spoilt);
    let (code, _, stderr) = convert(&["spoilt.csv", "-o", "run.csv"]);
    assert_eq!(code, 65, "{stderr}");
    assert!(fs::read_to_string(domain.path("run.csv")).unwrap() == expected);
}

#[test]
fn what_is_wrong_has_its_exit_code_and_a_remedy() {
    let domain = domain();
    let (code, stdout, stderr) = run(&domain, &["convert", "source.csv", "-o", "run.csv"]);
    assert_eq!((code, stdout.as_str()), (64, ""));
    let (message, proposal) = stderr.split_once("\n\n").unwrap();
    assert!(message.contains("source.csv: which columns are what? Give --mapping"), "{message}");
    let proposal = proposal.replace("kind = \"?\"", "kind = \"reading\"").replace("offset = \"?\"", "offset = 32768");
    domain.write("proposed.toml", &proposal);
    assert_eq!(
        run(&domain, &["convert", "source.csv", "--mapping", "proposed.toml", "-o", "run.csv"]).0,
        0,
        "{proposal}"
    );
    assert!(fs::read(domain.path("run.csv")).unwrap() == fs::read(domain.path("source.expected.csv")).unwrap());

    assert_eq!(domain.run_ok(&["check", "mapping.toml"]), "mapping.toml: mapping of 7 columns of a text\n");
    let mapping = fs::read_to_string(domain.path("mapping.toml")).unwrap();
    domain.write("wrong.toml", &mapping.replace("kind = \"reading\"", "kind = \"speed\""));
    domain.write("other.toml", &mapping.replace("ax_counts", "acc_x"));
    domain.write("span.log", NOVATEL);
    domain.write("damaged.log", &format!("{NOVATEL}{}", NOVATEL.replace("309705", "309706")));
    domain.write("bag.db3", "SQLite format 3\0");
    let (code, _, stderr) = run(&domain, &["check", "wrong.toml"]);
    assert!(code == 78 && stderr.contains("wrong.toml:8: accelerometer.kind: is \"speed\""), "{stderr}");
    for (arguments, exit, message) in [
        (
            &["source.csv", "--mapping", "wrong.toml"][..],
            78,
            "wrong.toml:8: accelerometer.kind: is \"speed\", give \"reading\" or \"increment\"",
        ),
        (
            &["source.csv", "--mapping", "other.toml"],
            65,
            "source.csv:1: missing columns: acc_x; found: time_s, ax_counts",
        ),
        (&["source.csv", "--mapping", "none.toml"], 74, "reading none.toml"),
        (&["none.csv", "--mapping", "mapping.toml"], 74, "opening none.csv"),
        (&["damaged.log", "--interval", "0.01"], 65, "damaged.log:2: the CRC is 1fb76c28, but that of the line is"),
        (
            &["span.log"],
            65,
            "span.log:1: the nominal interval cannot be found from the time; give time.interval_s or --interval",
        ),
        (
            &["span.log", "--mapping", "mapping.toml"],
            78,
            "mapping.toml:7: accelerometer.columns: unknown key; known here: unit",
        ),
        (&["bag.db3"], 65, "convert it to MCAP"),
        (&["source.csv", "--topic", "/imu"], 64, "a topic is named, but this is not MCAP"),
    ] {
        let (code, _, stderr) = run(&domain, &[&["convert"], arguments, &["-o", "out.csv"]].concat());
        assert_eq!(code, exit, "{arguments:?}: {stderr}");
        assert!(stderr.contains(message), "{arguments:?}: {stderr}");
        assert!(!domain.path("out.csv").exists(), "{arguments:?}");
    }
    let (code, _, stderr) = run(&domain, &["convert", "source.csv", "--mapping", "mapping.toml", "-o", "source.csv"]);
    assert_eq!(code, 64);
    assert!(stderr.contains("source.csv is the data; write to another file"), "{stderr}");
}

/// RAWIMUS has Z first and -Y.
#[test]
fn a_log_of_novatel_needs_no_mapping() {
    let domain = domain();
    domain.write("span.log", &format!("<OK\r\n{NOVATEL}"));
    let (code, stdout, stderr) =
        run(&domain, &["convert", "span.log", "--interval", "0.01", "--temperature", "-31.5", "-o", "-"]);
    assert_eq!(code, 0, "{stderr}");
    let row = "0,1336494812253588000,10000000,4410363,0,-31.5,-31.5,2512321,0,-31.5,-31.5,329303960,0,-31.5,-31.5,\
               0,1009773,-31.5,-31.5,0,607017,-31.5,-31.5,309705,0,-31.5,-31.5";
    assert_eq!(stdout.lines().nth(1), Some(row));
    assert!(!stderr.contains("warning"), "{stderr}");
    let (_, stdout, stderr) = run(&domain, &["convert", "span.log", "--interval", "0.01", "-o", "-"]);
    assert!(stdout.contains("4410363,0,25,25,"));
    assert!(
        stderr.contains("warning [no-temperature]: the data have no temperature; 25 is in all rows as a placeholder"),
        "{stderr}"
    );
    domain.write("known.toml", "format = 1\n[time]\ninterval_s = 0.005\n[temperature]\nconstant = 7\n");
    assert!(domain.run_ok(&["check", "known.toml"]).contains("mapping of data whose columns are known"));
    let (_, stdout, _) = run(&domain, &["convert", "span.log", "--mapping", "known.toml", "-o", "-"]);
    assert!(stdout.contains("0,1336494812253588000,5000000,4410363,0,7,7,"), "{stdout}");
}

/// In one file the topics of `imu-a` and `imu_a` would be the same.
#[test]
fn imus_with_the_same_topics_are_not_recorded_into_one_file() {
    let domain = TestDomain::new();
    for imus in [["imu-a", "imu_a"], ["1", "imu_1"]] {
        let arguments = ["record", "--format", "ros", "--imu", imus[0], "--imu", imus[1], "-o", "drive.mcap"];
        let (code, _, stderr) = run(&domain, &arguments);
        assert_eq!(code, 64, "{stderr}");
        assert!(stderr.contains("record them into separate files: put {imu} into the name drive.mcap"), "{stderr}");
        assert!(!domain.path("drive.mcap").exists());
    }
}

#[test]
fn increments_go_to_ros_and_come_back() {
    let domain = TestDomain::new();
    let table = TABLE;
    domain.write("imu-a.toml", table);
    domain.write("celsius.toml", &table.replace("unit = \"V\"", "unit = \"degC\""));
    let (code, _, stderr) = run(&domain, &["replay", "--table", "imu-a.toml", RUN, "-o", "volts.mcap"]);
    assert!(code == 0 && stderr.contains("no sensor_msgs/msg/Temperature: the temperature is in V"), "{stderr}");
    let (code, _, stderr) = run(&domain, &["replay", "--table", "celsius.toml", RUN, "-o", "celsius.mcap"]);
    assert!(
        code == 0 && stderr.contains("4000 increments, none flagged") && !stderr.contains("Temperature"),
        "{stderr}"
    );
    let increments = domain.run_ok(&["replay", "--table", "celsius.toml", RUN]);
    let (code, back, stderr) = run(&domain, &["convert", "celsius.mcap", "-o", "-"]);
    assert_eq!(code, 0, "{stderr}");
    assert!(stderr.contains("the nominal interval is 0.0025 s") && !stderr.contains("warning"), "{stderr}");
    let heads = fs::read_to_string(RUN).unwrap();
    let columns =
        |text: &str| text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect::<Vec<Vec<_>>>();
    let (increments, back, heads) = (columns(&increments), columns(&back), columns(&heads));
    assert_eq!((back.len(), increments.len()), (4001, 4001));
    for ((increment, row), raw) in increments.iter().zip(&back).zip(&heads).skip(1) {
        let number = |text: &String| text.parse::<f64>().unwrap();
        assert_eq!(row[1], increment[1]);
        for axis in 0..3 {
            let pulses = number(&row[3 + 4 * axis]) - number(&row[4 + 4 * axis]);
            let seconds = number(&increment[2]) / 1e9;
            assert!((pulses * 1e-6 - number(&increment[3 + axis]) / seconds).abs() < 0.6e-6, "{increment:?} {row:?}");
        }
        let mean = (number(&raw[5]) + number(&raw[9]) + number(&raw[13])) / 3.0;
        assert!((number(&row[5]) - mean).abs() < 1e-9, "{raw:?} {row:?}");
    }
}

#[test]
fn a_recorder_writes_ros_messages_of_a_running_imu() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    // The table that the service has in force, but with temperature in degC: for the recorder it only has the name and
    // the unit.
    let table = TABLE.replace("unit = \"V\"", "unit = \"degC\"");
    domain.write("celsius.toml", &table);
    let options = ["record", "--imu", "imu-a", "--flush", "0.05", "--format", "ros"];
    let recorders = [
        domain.spawn(&[&options[..], &["-o", "plain.mcap"]].concat()),
        domain.spawn(&[&options[..], &["--table", "celsius.toml", "-o", "named.mcap"]].concat()),
    ];
    recorders.iter().for_each(|recorder| recorder.wait_for_log("recording imu-a"));
    let mut acquisition = domain.acquisition("imu-a");
    for sample in &recording()[..200] {
        isotherm_tests::round_trip(&mut acquisition, sample);
    }
    let rows = |file: &str| {
        let converted = domain.run(&["convert", file, "--interval", "0.0025", "-o", "-"]);
        text(&converted.stdout).lines().count().saturating_sub(1)
    };
    for file in ["plain.mcap", "named.mcap"] {
        wait_until("the recorder", || rows(file) == 200);
    }
    for recorder in recorders {
        recorder.signal(Signal::TERM);
        let (status, log) = recorder.wait();
        assert!(status.success() && log.contains("imu-a increment: 200 rows of 1 session, 0 missing"), "{log}");
    }
    let notes = |file: &str| run(&domain, &["convert", file, "-o", "-"]).2;
    assert!(
        notes("plain.mcap").contains("warning [no-temperature]: the data have no temperature"),
        "{}",
        notes("plain.mcap")
    );
    assert!(notes("named.mcap").contains("temperature of /imu_a/temperature, in degC"), "{}", notes("named.mcap"));
    for (wrong, message) in [
        (&["--format", "ros", "--stream", "raw", "-o", "x.mcap"][..], "leave out --stream"),
        (&["--table", "celsius.toml", "-o", "x.mcap"], "--table is for --format ros"),
        (&["--format", "ros", "-o", "-"], "stdout takes one stream of one IMU as CSV"),
    ] {
        let (code, _, stderr) = run(&domain, &[&["record", "--imu", "imu-a"], wrong].concat());
        assert!(code == 64 && stderr.contains(message), "{stderr}");
    }
    let other =
        run(&domain, &["record", "--imu", "imu-b", "--format", "ros", "--table", "celsius.toml", "-o", "x.mcap"]);
    assert!(other.0 == 64 && other.2.contains("celsius.toml: a table of imu-a, which is not recorded"), "{}", other.2);
    drop(acquisition);
    service.terminate();
}

/// A pipe among them would be waited for without end; one that is named by itself is read.
#[test]
fn of_a_folder_only_regular_files_are_read() {
    let domain = domain();
    let pipe = |name: &str| mknodat(CWD, domain.path(name), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    fs::create_dir(domain.path("measured")).unwrap();
    fs::create_dir(domain.path("bag")).unwrap();
    let rows: String = (0..20).map(|row| format!("{}.5,{row},{},{row}\n", row, 3 * row)).collect();
    for name in ["T20_P1.csv", "T20_P2.csv", "T40_P1.csv", "linked"] {
        domain.write(&format!("measured/{name}"), &format!("t_s,a1,a2,a3\n{rows}"));
    }
    fs::rename(domain.path("measured/linked"), domain.path("linked")).unwrap();
    symlink(domain.path("linked"), domain.path("measured/T40_P2.csv")).unwrap();
    pipe("measured/T60_P1.csv");
    let (code, proposed, said) = run(&domain, &["calibrate", "turntable", "--propose", "measured"]);
    assert_eq!(code, 0, "{said}");
    assert!(proposed.contains("files = \"measured/T{set_point_c}_P{position}.csv\""), "{proposed}");

    domain.write("imu-a.toml", TABLE);
    domain.run_ok(&["replay", "--table", "imu-a.toml", RUN, "-o", "bag/0.mcap"]);
    let convert = || run(&domain, &["convert", "bag", "-o", "out.csv", "--imu", "imu-b", "--nominal", "nominal.toml"]);
    for name in ["bag/1.mcap", "bag/metadata.yaml"] {
        pipe(name);
        let (code, _, said) = convert();
        assert_eq!(code, 0, "{said}");
    }
    fs::remove_file(domain.path("bag/metadata.yaml")).unwrap();
    domain.write("bag/metadata.yaml", "relative_file_paths:\n- 0.mcap\n- 1.mcap\n");
    let (code, _, said) = convert();
    assert!(code == 65 && said.contains("1.mcap, which is no file"), "{code}: {said}");
    // What has no end to wait for: the writer is there.
    let source = fs::read(domain.path("source.csv")).unwrap();
    pipe("named");
    let writer = domain.path("named");
    let writer = std::thread::spawn(move || fs::write(writer, source).unwrap());
    domain.run_ok(&["convert", "--mapping", "mapping.toml", "named", "-o", "named.csv"]);
    writer.join().unwrap();
    let expected = fs::read_to_string(domain.path("source.expected.csv")).unwrap();
    assert!(fs::read_to_string(domain.path("named.csv")).unwrap() == expected);
}
