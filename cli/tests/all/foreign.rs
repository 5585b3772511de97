//! Data of other programs in the place of a recording: as if they had been converted first.

use crate::common::{folder, run};
use crate::pieces::{MAPPING, log};
use isotherm_fit::sha256;
use std::fs;
use std::path::Path;

/// An IMU of six sensors at rest that warms up, 100 Hz.
fn still(folder: &Path) {
    let mut state = 11_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
    };
    let mut text = "t_s,ax,ay,az,gx,gy,gz,temp\n".to_owned();
    for row in 1..=8000 {
        let (time, temperature) = (f64::from(row) * 0.01, 20.0 + f64::from(row) * 0.002);
        let [x, y, z] = [0.1, -0.2, 9.80665].map(|value| value + 1e-5 * temperature + 0.01 * noise());
        let [p, q, r] = [0.001, 0.0, -0.002].map(|value| value + 0.001 * noise());
        text += &format!("{time:.2},{x:.6},{y:.6},{z:.6},{p:.7},{q:.7},{r:.7},{temperature:.3}\n");
    }
    fs::write(folder.join("still.csv"), text).unwrap();
    fs::write(folder.join("still.toml"), STILL).unwrap();
}

const STILL: &str = "format = 1\n[time]\ncolumn = \"t_s\"\nunit = \"s\"\n[accelerometer]\ncolumns = [\"ax\", \"ay\", \"az\"]\n\
     kind = \"reading\"\nresolution = 1e-6\nunit = \"m/s2\"\nrange = 78.5\n[gyroscope]\ncolumns = [\"gx\", \"gy\", \"gz\"]\n\
     kind = \"reading\"\nresolution = 1e-7\n[temperature]\ncolumns = \"temp\"\n";
const NOMINAL: [&str; 5] = ["-o", "run.csv", "--nominal", "nominal.toml", "--imu=imu-b"];

/// A folder with the text of an IMU at rest, the recording that it becomes, and their nominal table.
fn at_rest() -> tempfile::TempDir {
    let folder = folder();
    still(folder.path());
    run(folder.path(), 0, &[&["convert", "still.csv", "--mapping", "still.toml"][..], &NOMINAL].concat());
    folder
}

/// What a command prints of a recording and of the data that it was made of must be equal, but for their names.
fn assert_equal(folder: &Path, command: &[&str], recording: &[&str], data: &[&str]) -> String {
    let (converted, of_recording) = run(folder, 0, &[command, recording].concat());
    let (direct, of_data) = run(folder, 0, &[command, data].concat());
    assert!(converted == direct, "{command:?} {data:?}");
    // What the conversion reports comes first.
    let said = of_recording.replace(recording[0], data[0]);
    assert!(said.lines().all(|line| of_data.lines().any(|other| other == line)), "{said}\n--\n{of_data}");
    of_data
}

#[test]
fn replay_noise_and_verify_of_a_text_equal_those_of_its_recording_byte_for_byte() {
    let folder = at_rest();
    let folder = folder.path();
    let data = ["still.csv", "--mapping", "still.toml"];
    let said = assert_equal(folder, &["replay", "--table", "nominal.toml"], &["run.csv"], &data);
    assert!(said.contains("isotherm: the nominal interval is 0.01 s, found from the first 1000 rows"), "{said}");
    assert!(said.ends_with("isotherm: 8000 increments, none flagged\n"), "{said}");
    let analysis = ["--table", "nominal.toml", "--json"];
    assert_equal(folder, &[&["noise"], &analysis[..]].concat(), &["run.csv"], &data);
    assert_equal(folder, &[&["verify", "--window", "5"], &analysis[..]].concat(), &["run.csv"], &data);
    // From a pipe as from a file.
    let mut piped = std::process::Command::new(env!("CARGO_BIN_EXE_isotherm"));
    piped.args(["replay", "--table", "nominal.toml", "-", "--mapping", "still.toml"]).current_dir(folder);
    let piped = piped.stdin(fs::File::open(folder.join("still.csv")).unwrap()).output().unwrap();
    assert!(piped.status.success());
    assert!(piped.stdout == run(folder, 0, &["replay", "--table", "nominal.toml", "run.csv"]).0.into_bytes());
}

#[test]
fn a_bag_of_ros_needs_no_options_and_goes_beside_other_pieces() {
    let folder = at_rest();
    let folder = folder.path();
    run(folder, 0, &["replay", "--table", "nominal.toml", "run.csv", "-o", "bag.mcap"]);
    run(folder, 0, &["convert", "bag.mcap", "-o", "bag.csv", "--nominal", "bag.toml", "--imu", "imu-b"]);
    let said = assert_equal(folder, &["replay", "--table", "bag.toml"], &["bag.csv"], &["bag.mcap"]);
    assert!(said.contains("/imu_b/data_raw: A1, A2, A3 are x, y, z; one pulse is 0.000001 m/s2 or rad/s"), "{said}");
    // A part as a recording, and a part as the text that it was: the later one first.
    let parts = |name: &str| {
        let text = fs::read_to_string(folder.join(name)).unwrap();
        let lines: Vec<_> = text.lines().collect();
        let part = |rows: &[&str]| [&lines[..1], rows].concat().join("\n") + "\n";
        [part(&lines[1..5001]), part(&lines[5001..])]
    };
    fs::write(folder.join("begin.csv"), &parts("run.csv")[0]).unwrap();
    fs::write(folder.join("end.txt"), &parts("still.csv")[1]).unwrap();
    run(folder, 0, &["convert", "end.txt", "--mapping", "still.toml", "-o", "end.csv"]);
    let replay = ["replay", "--table", "nominal.toml"];
    let mixed = ["end.txt", "begin.csv", "--mapping", "still.toml"];
    let said = assert_equal(folder, &replay, &["end.csv", "begin.csv"], &mixed);
    assert!(said.contains("isotherm: end.txt: the nominal interval is 0.01 s"), "{said}");
    // Two texts whose interval is not the same.
    let slower = parts("still.csv")[0].replace("0.01,", "0.001,");
    let slower = slower.lines().enumerate().map(|(row, line)| match line.split_once(',') {
        Some((_, rest)) if row > 0 => format!("{:.2},{rest}\n", row as f64 * 0.02),
        _ => format!("{line}\n"),
    });
    fs::write(folder.join("slower.txt"), slower.collect::<String>()).unwrap();
    let (_, said) = run(folder, 0, &[&replay[..], &["slower.txt", "end.txt", "--mapping", "still.toml"]].concat());
    let differ = "warning [interval]: end.txt: the nominal interval is 0.01 s, but that of slower.txt is 0.02 s";
    assert!(said.contains(differ), "{said}");
    let strict =
        [&replay[..], &["slower.txt", "end.txt", "--mapping", "still.toml", "--strict", "-o", "no.csv"]].concat();
    assert!(run(folder, 65, &strict).1.contains("fault [interval]") && !folder.join("no.csv").exists());
}

#[test]
fn a_table_without_a_turntable_is_made_of_texts_and_knows_them() {
    let folder = folder();
    let folder = folder.path();
    log(folder, "cold.csv", 5.0);
    log(folder, "warm.csv", 40.0);
    fs::write(folder.join("m.toml"), MAPPING).unwrap();
    fs::create_dir(folder.join("runs")).unwrap();
    let data = ["cold.csv", "warm.csv", "--mapping", "m.toml"];
    run(folder, 0, &[&["convert"], &data[..], &["-o", "runs"]].concat());
    let make = |recordings: &[&str], table: &str| {
        let options = ["--gravity-local=9.81", "--gravity-reference=9.81", "--temperature-unit=degC", "--imu=imu-a"];
        run(folder, 0, &[&["calibrate", "tumble"], &options[..], recordings, &["-o", table]].concat());
        fs::read_to_string(folder.join(table)).unwrap()
    };
    let digest = |table: &str| table.lines().find(|line| line.starts_with("digest = ")).unwrap().to_owned();
    let (of_recordings, of_texts) = (make(&["runs/cold.csv", "runs/warm.csv"], "a.toml"), make(&data, "b.toml"));
    assert_eq!(digest(&of_recordings), digest(&of_texts));
    for name in ["cold.csv", "warm.csv"] {
        assert!(of_texts.contains(&sha256(&fs::read(folder.join(name)).unwrap())), "{name}");
    }
    let (out, err) = run(folder, 0, &[&["verify", "--table", "b.toml"], &data[..]].concat());
    assert!(out.starts_with("this recording made the table: no evidence\n48 static poses"), "{out}");
    assert!(err.contains("own-recording"), "{err}");
    // A campaign file without a turntable names texts, too.
    let campaign = "format = 1\nmethod = \"gravity-only\"\nimu = \"imu-a\"\nsamples = [\"cold.csv\", \"warm.csv\"]\n\
         gravity_reference = 9.81\ngravity_local = 9.81\ntemperature_unit = \"degC\"\n";
    fs::write(folder.join("campaign.toml"), campaign).unwrap();
    run(folder, 0, &["calibrate", "tumble", "campaign.toml", "--mapping", "m.toml", "-o", "c.toml"]);
    assert_eq!(digest(&fs::read_to_string(folder.join("c.toml")).unwrap()), digest(&of_texts));
    // What the conversion finds is judged with the rest, and is in the provenance.
    let text = fs::read_to_string(folder.join("cold.csv")).unwrap();
    let rows: Vec<_> =
        text.lines().enumerate().filter(|(row, _)| !(300..310).contains(row)).map(|(_, it)| it).collect();
    fs::write(folder.join("gap.csv"), rows.join("\n") + "\n").unwrap();
    let gap = make(&["gap.csv", "warm.csv", "--mapping", "m.toml"], "gap.toml");
    assert!(gap.contains("gap.csv: 1 gaps, 10 rows missing by the time, the first before row 300"), "{gap}");
}

#[test]
fn what_is_wrong_with_data_or_options_has_line_key_and_remedy() {
    let folder = at_rest();
    let folder = folder.path();
    fs::write(folder.join("key.toml"), STILL.replace("kind = \"reading\"\nresolution = 1e-6", "kind = \"rates\""))
        .unwrap();
    fs::write(folder.join("column.toml"), STILL.replace("\"ay\"", "\"acc_y\"")).unwrap();
    fs::write(folder.join("range.toml"), STILL.replace("range = 78.5", "range = -1")).unwrap();
    let still = fs::read_to_string(folder.join("still.csv")).unwrap();
    fs::write(folder.join("letter.csv"), still.replace("\n2.", "\n2.o")).unwrap();
    fs::write(folder.join("late.csv"), still.replace("\n70.", "\n7o.")).unwrap();
    fs::write(folder.join("log.ulg.gz"), b"\x1f\x8b\x08").unwrap();
    let header = fs::read_to_string(folder.join("run.csv")).unwrap();
    fs::write(folder.join("lacks.csv"), header.replacen("interval_ns", "interval", 1)).unwrap();
    let needless = "run.csv: a recording, which has all that is needed; leave out what is for other data: ";
    for (arguments, code, message) in [
        (&["still.csv"][..], 64, "still.csv: which columns are what? Give --mapping with a file such as"),
        (&["still.csv", "--mapping", "key.toml"], 78, "key.toml:7: accelerometer.kind: is \"rates\""),
        (&["still.csv", "--mapping", "range.toml"], 78, "range.toml:10: accelerometer.range: is -1"),
        (&["still.csv", "--mapping", "column.toml"], 65, "still.csv:1: missing columns: acc_y; found: t_s, ax"),
        (&["still.csv", "--mapping", "none.toml"], 74, "reading none.toml"),
        (&["letter.csv", "--mapping", "still.toml"], 65, "letter.csv:201: t_s is \"2.o00\""),
        (&["late.csv", "--mapping", "still.toml"], 65, "late.csv:7001: t_s is \"7o.00\""),
        (&["still.csv", "--mapping", "still.toml", "--topic", "/imu"], 64, "a topic is named, but this is not MCAP"),
        (
            &["still.csv", "--mapping", "still.toml", "--instance", "1"],
            64,
            "an instance is named, but this is not a log",
        ),
        (&["log.ulg.gz"], 65, "log.ulg.gz: compressed with gzip; unpack it first"),
        // The message about a recording says what it lacks.
        (&["lacks.csv"], 65, "lacks.csv:1: missing columns: interval_ns; found: sequence, timestamp_ns, interval"),
        (&["run.csv", "--mapping", "still.toml"], 64, &format!("{needless}mapping")),
        (&["run.csv", "--interval", "0.01", "--temperature", "-5"], 64, &format!("{needless}temperature, interval")),
    ] {
        for command in [&["replay", "--table", "nominal.toml"][..], &["verify", "--table", "nominal.toml"], &["noise"]]
        {
            let (_, err) = run(folder, code, &[command, arguments].concat());
            assert!(err.contains(message), "{command:?} {arguments:?}: {err}");
        }
    }
    let (_, err) =
        run(folder, 64, &["replay", "--table", "nominal.toml", "still.csv", "--mapping=still.toml", "-o=still.toml"]);
    assert!(err.contains("still.toml is the mapping; write to another file"), "{err}");
    let campaign = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/campaign/campaign.toml");
    let (_, err) = run(folder, 64, &["calibrate", "turntable", campaign, "--mapping", "still.toml", "-o", "t.toml"]);
    assert!(err.contains("unexpected argument '--mapping'"), "{err}");
}

#[test]
fn the_nominal_table_gives_readings_back_and_is_refused_where_no_unit_is_known() {
    let folder = at_rest();
    let folder = folder.path();
    let table = fs::read_to_string(folder.join("nominal.toml")).unwrap();
    for part in ["id = \"imu-b\"", "gravity = 9.80665", "nominal_interval_s = 0.01", "unit = \"degC\"", "20.002, 36.0"]
    {
        assert!(table.contains(part), "{part}\n{table}");
    }
    // K = g0 / (resolution * interval); the largest rate is that of the range.
    let number = |key: &str| {
        let at = table.split_once(key).unwrap().1;
        at.split(['\n', ' ']).next().unwrap().parse::<f64>().unwrap()
    };
    assert!((number("\"pulse/(s*g0)\", range = [20.002, 36.0], c0 = ") / 980_665_000.0 - 1.0).abs() < 1e-12);
    assert!((number("\"pulse/arcsec\", range = [20.002, 36.0], c0 = ") / 4_848.136_811_095_36 - 1.0).abs() < 1e-12);
    assert!((number("max_rate = ") / 7.85e9 - 1.0).abs() < 1e-6 && table.matches("max_rate").count() == 3);
    let (increments, _) = run(folder, 0, &["replay", "--table", "nominal.toml", "run.csv"]);
    let still = fs::read_to_string(folder.join("still.csv")).unwrap();
    for (increment, row) in increments.lines().zip(still.lines()).skip(1) {
        let increment: Vec<f64> = increment.split(',').take(9).filter_map(|it| it.parse().ok()).collect();
        let row: Vec<f64> = row.split(',').map(|it| it.parse().unwrap()).collect();
        for axis in 0..3 {
            assert!((increment[3 + axis] / 0.01 - row[1 + axis]).abs() < 1e-6, "{increment:?} {row:?}");
        }
    }
    let convert = |mapping: &str, more: &[&str], code: i32| {
        fs::write(folder.join("m.toml"), mapping).unwrap();
        fs::remove_file(folder.join("n.toml")).unwrap_or_default();
        let command = ["convert", "still.csv", "--mapping=m.toml", "-o=n.csv", "--nominal=n.toml"];
        let said = run(folder, code, &[&command, more].concat()).1;
        assert_eq!((folder.join("n.toml").exists(), folder.join("n.csv").exists()), (code == 0, code == 0), "{said}");
        said
    };
    let increments = STILL.replace("\"reading\"", "\"increment\"").replace("unit = \"m/s2\"\nrange = 78.5\n", "");
    assert!(convert(&increments, &[], 65).contains("still.csv: no nominal table: kind = \"increment\""));
    let counts = STILL.replace("unit = \"m/s2\"\n", "offset = 3\n");
    let said = convert(&counts, &[], 65);
    assert!(
        said.contains("accelerometer: the numbers look like counts; if they are readings, give its unit: "),
        "{said}"
    );
    // A unit that is not theirs shows at rest.
    let said = convert(&STILL.replace("\"m/s2\"", "\"g\""), &["--temperature-unit", "V"], 0);
    assert!(said.contains("[not-gravity]: 9.810 g0 at rest"), "{said}");
    assert!(fs::read_to_string(folder.join("n.toml")).unwrap().contains("unit = \"V\""));
}

/// A user who forgets the kind of the job, or gives a file of another one, gets a message about what the file is and
/// which command reads it.
#[test]
fn a_file_of_another_kind_is_named_with_the_command_that_reads_it() {
    const ULG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/formats/tests/data/autopilots/heating.ulg");
    const BIN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/formats/tests/data/autopilots/heating.BIN");
    const PARAMETERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/autopilot/tests/data/full.parm");
    const TABLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/imu-a.toml");
    const RUN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/run.csv");
    let folder = folder();
    let reads = |file: &str| format!("`isotherm calibrate warm-up --imu ID {file} -o ID.toml` makes a table");
    let imports = "`isotherm import FILE --from px4|ardupilot --imu ID --interval S -o ID.toml` makes a table of them";
    let imports = imports.to_owned();
    let import = |file: &'static str| vec!["import", file, "--from", "px4", "--imu", "a", "--interval", "1", "-o", "x"];
    let served = concat!("imu-a=", env!("CARGO_MANIFEST_DIR"), "/../recording/autopilot/tests/data/full.parm");
    let [ulog, dataflash] = ["this is a log of PX4 (ULog)", "this is a log of ArduPilot (DataFlash)"];
    let [csv, parameters] = ["this is a recording (CSV)", "this is parameters of an autopilot, not TOML; give "];
    for (arguments, kind, remedy) in [
        (vec!["calibrate", "turntable", ULG, "-o", "x"], ulog, reads(ULG)),
        (vec!["calibrate", "turntable", BIN, "-o", "x"], dataflash, reads(BIN)),
        (vec!["calibrate", "turntable", RUN, "-o", "x"], csv, reads("FILE")),
        (vec!["calibrate", "turntable", PARAMETERS, "-o", "x"], parameters, imports.clone()),
        (vec!["check", ULG], ulog, reads(ULG)),
        (vec!["check", PARAMETERS], parameters, imports.clone()),
        (import(ULG), ulog, reads(ULG)),
        (import(RUN), csv, reads(RUN)),
        (vec!["export", BIN, "--to", "px4", "-o", "x"], dataflash, reads(BIN)),
        (vec!["export", PARAMETERS, "--to", "px4", "-o", "x"], parameters, imports.clone()),
        (vec!["compare", TABLE, ULG], ulog, reads(ULG)),
        (vec!["replay", "--table", ULG, RUN], "give the coefficient table", reads(ULG)),
        (vec!["campaign", "check", ULG], ulog, reads(ULG)),
        (vec!["serve", "--imu", served], parameters, imports),
    ] {
        let (_, err) = run(folder.path(), 78, &arguments);
        assert!(err.contains(kind) && err.contains(&remedy), "{arguments:?}: {err}");
    }
    assert!(!folder.path().join("x").exists());
}
