//! Recordings and campaigns that have lost time, and what `check` says of settings that this machine refuses.

use crate::common::{folder, isotherm, run};
use isotherm_shared::readings::Resolution;
use isotherm_shared::table::{Nominal, nominal_table};
use serde_json::Value;
use std::fs;
use std::path::Path;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Leaves out every 7th of the rows `lost`, counted from 0, and renumbers the others. `sequence` is the column of the
/// sequence; with `None` the holes stay.
fn lose(text: &str, lost: core::ops::Range<usize>, sequence: Option<usize>) -> String {
    let (header, body) = text.split_once('\n').unwrap();
    let kept = body.lines().enumerate().filter(|(row, _)| !(lost.contains(row) && row % 7 == 6));
    let lines = kept.enumerate().map(|(number, (_, line))| {
        let mut fields: Vec<_> = line.split(',').map(str::to_owned).collect();
        if let Some(column) = sequence {
            fields[column] = number.to_string();
        }
        fields.join(",") + "\n"
    });
    format!("{header}\n") + &lines.collect::<String>()
}

/// Ten minutes at rest at 10 Hz in `run`, with the table `truth.toml`.
fn recording(folder: &Path) -> String {
    let simulate = ["simulate", "run", "-o", "run", "--temperatures", "20,20.3", "--ramp", "1", "--hold", "1"];
    run(folder, 0, &[&simulate[..], &["--sensor-noise", "40", "--seed", "3"]].concat());
    fs::read_to_string(folder.join("run/run.csv")).unwrap()
}

/// The table `run/truth.toml` with a nominal interval.
fn nominal(folder: &Path, name: &str, interval_s: f64) {
    let text = fs::read_to_string(folder.join("run/truth.toml")).unwrap();
    let line = |line: &str| match line {
        line if line.starts_with("digest") => String::new(),
        line if line.starts_with("format = ") => "format = 3\n".to_owned(),
        "[imu]" => format!("[imu]\nnominal_interval_s = {interval_s:?}\n"),
        line => format!("{line}\n"),
    };
    fs::write(folder.join(name), text.lines().map(line).collect::<String>()).unwrap();
}

#[test]
fn scale_factors_of_another_interval_are_found_wherever_a_table_meets_rows() {
    let folder = folder();
    let rows = recording(folder.path()).lines().count() - 1;
    let commands: [&[&str]; 3] = [&["replay", "-o", "i.csv"], &["verify", "--window", "10"], &["noise"]];
    let on = |code, command: &[&str], table: &str, more: &[&str]| {
        run(folder.path(), code, &[command, &["--table", table, "run/run.csv"], more].concat())
    };
    // The rows are of 0.1 s: once, and twice, the nominal interval.
    for interval_s in [0.1, 0.05] {
        nominal(folder.path(), "same.toml", interval_s);
        for command in commands {
            let (_, words) = on(0, command, "same.toml", &[]);
            assert!(!words.contains("nominal"), "{interval_s}: {words}");
        }
    }
    nominal(folder.path(), "other.toml", 0.07);
    let found = "[interval-not-nominal]: run/run.csv: the interval of the rows is 0.1 s, and the scale factors of the \
                 table are of 0.07 s (nominal_interval_s): 1.4286 of it, no whole multiple from 1 to 64; give the table";
    let (_, words) = on(0, commands[0], "other.toml", &[]);
    assert!(words.starts_with(&format!("isotherm: warning {found}")), "{words}");
    assert!(words.contains(&format!("{rows} flagged: interval-not-nominal {rows}")), "{words}");
    for command in &commands[1..] {
        let (_, words) = on(65, command, "other.toml", &[]);
        assert!(words.contains(&format!("fault {found}")), "{words}");
        let (_, words) = on(0, command, "other.toml", &["--accept", "interval-not-nominal"]);
        assert!(words.contains(&format!("warning {found}")), "{words}");
    }
}

const TIME: &str = "periods are lost without a hole in sequence, or interval_ns is too short";

#[test]
fn verify_and_noise_count_what_is_missing_and_warn_of_lost_time() {
    let folder = folder();
    let text = recording(folder.path());
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("lost.csv", &lose(&text, 0..35, Some(0)));
    write("gaps.csv", &lose(&text, 0..35, None));
    let verify = ["verify", "--table", "run/truth.toml", "--window", "10"];
    let noise = ["noise", "--table", "run/truth.toml"];
    let on = |command: &[&str], file: &str| run(folder.path(), 0, &[command, &[file]].concat());
    for (command, parts) in [(&verify[..], "within the recording"), (&noise[..], "in the recording")] {
        let (words, warnings) = on(command, "run/run.csv");
        assert!(!words.contains(parts) && !warnings.contains("timestamp_ns"), "{words}\n{warnings}");
        let (words, warnings) = on(command, "lost.csv");
        assert!(words.contains(&format!("{parts}: 0 rows missing in 0 gaps, 5 time steps\n")), "{words}");
        assert!(
            warnings.contains("warning [time-step]: lost.csv: over 25 rows to sequence 49 ") && warnings.contains(TIME),
            "{warnings}"
        );
        let (words, warnings) = on(command, "gaps.csv");
        assert!(words.contains(&format!("{parts}: 5 rows missing in 5 gaps, 0 time steps\n")), "{words}");
        assert!(!warnings.contains("timestamp_ns"), "{warnings}");
        let document: Value = serde_json::from_str(&on(&[command, &["--json"]].concat(), "lost.csv").0).unwrap();
        assert_eq!(document["losses"], serde_json::json!({ "missing": 0, "gaps": 0, "time_steps": 5 }));
    }
    let document: Value = serde_json::from_str(&on(&[&verify[..], &["--json"]].concat(), "lost.csv").0).unwrap();
    assert!(document["time_warning"].as_str().unwrap().ends_with(TIME));
    // Intervals that are 1000 times too short: what verify refuses, replay counts.
    let (header, body) = text.split_once('\n').unwrap();
    let short = body.replace(",100000000,", ",100000,");
    write("short.csv", &format!("{header}\n{short}"));
    let (_, words) = run(folder.path(), 0, &["replay", "--table", "run/truth.toml", "short.csv", "-o", "i.csv"]);
    let rows = body.lines().count();
    assert!(words.ends_with(&format!("; 0 rows missing in 0 gaps, {} time steps\n", rows - 1)), "{words}");
    let interval = "[interval]: short.csv: interval_ns is 1.000e-3 of the time from row to row, 0.0001 s against 0.1 s: \
                    it looks 1000 times too short";
    assert!(words.starts_with(&format!("isotherm: warning {interval}")) && !words.contains("time-step"), "{words}");
    let (_, words) = run(folder.path(), 65, &[&verify[..], &["short.csv"]].concat());
    assert!(words.contains("interval_ns is 1.000e-3 of the time from row to row"), "{words}");
    let (_, words) = run(folder.path(), 65, &[&noise[..], &["short.csv"]].concat());
    assert!(words.starts_with(&format!("isotherm: warning {interval}")), "{words}");
    // Rows that are missing: replay says how many, and with --strict it writes nothing.
    let replay = ["replay", "--table", "run/truth.toml", "gaps.csv", "-o", "gone.csv"];
    let (_, words) = run(folder.path(), 65, &[&replay[..], &["--strict"]].concat());
    assert!(words.contains("fault [missing-rows]: gaps.csv: 5 rows missing in 5 gaps, of "), "{words}");
    assert!(!folder.path().join("gone.csv").exists());
    let (_, words) = run(folder.path(), 0, &replay);
    assert!(words.ends_with("; 5 rows missing in 5 gaps, 0 time steps\n"), "{words}");
    run(folder.path(), 0, &[&replay[..], &["--strict", "--accept", "missing-rows"]].concat());
}

#[test]
fn calibrate_finds_lost_time_within_a_dwell_and_none_between_dwells() {
    let folder = folder();
    let simulate = ["simulate", "campaign", "-o", "c", "--set-points=-20:40:10", "--interval=1"];
    let simulated = isotherm(folder.path(), &simulate);
    assert!(simulated.status.success(), "{}", String::from_utf8_lossy(&simulated.stderr));
    let samples = folder.path().join("c/samples.csv");
    let text = fs::read_to_string(&samples).unwrap();
    let calibrate = ["calibrate", "turntable", "c/campaign.toml", "-o", "t.toml"];
    let (_, whole) = run(folder.path(), 0, &calibrate);
    assert!(!whole.contains("time-step") && !whole.contains("missing"), "{whole}");
    // Three periods of the first dwell.
    let text = lose(&text, 20..41, Some(2));
    fs::write(&samples, text).unwrap();
    let (_, words) = run(folder.path(), 0, &calibrate);
    assert!(
        words.contains("warning [time-step]: c/samples.csv:") && words.contains("position 1: over 25 rows"),
        "{words}"
    );
    assert!(
        words.contains(TIME) && words.contains("  within the dwells: 0 rows missing in 0 gaps, 3 time steps\n"),
        "{words}"
    );
    let (_, words) = run(folder.path(), 65, &[&calibrate[..], &["--strict"]].concat());
    assert!(words.contains("fault [time-step]: "), "{words}");
    let (_, words) = run(folder.path(), 0, &[&calibrate[..], &["--accept", "time-step"]].concat());
    assert!(words.contains("warning [time-step]: "), "{words}");
}

#[test]
fn check_warns_of_a_core_that_this_machine_does_not_have() {
    let folder = folder();
    let table = fs::read_to_string(Path::new(ROOT).join("tests/data/imu-a.toml")).unwrap();
    fs::write(folder.path().join("imu-a.toml"), table).unwrap();
    let write = |realtime: &str| {
        let text = format!("[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n{realtime}");
        fs::write(folder.path().join("service.toml"), text).unwrap();
    };
    write("[realtime]\ncore = 1023\n");
    let (words, warnings) = run(folder.path(), 0, &["check", "service.toml"]);
    assert!(words.contains("service configuration of 1 IMUs"), "{words}");
    let warning = "service.toml: warning: serve would refuse it here: realtime.core: binding to core 1023: ";
    assert!(
        warnings.starts_with(&format!("isotherm: {warning}")) && warnings.contains("this process may use"),
        "{warnings}"
    );
    let (words, failure) = run(folder.path(), 78, &["check", "--strict", "service.toml"]);
    assert!(words.is_empty() && failure.contains(warning), "{failure}");
    // What the machine has and allows gives no warning.
    write("");
    assert_eq!(run(folder.path(), 0, &["check", "--strict", "service.toml"]).1, "");
}

/// A text of readings at this rate for two seconds, and what each row reads.
fn text_of_readings(rate_hz: f64) -> (String, Vec<[f64; 3]>) {
    let reading = |row: u64| {
        let turn = (row % 89) as f64 / 100.0;
        [0.123_456 + turn, -0.345_678 - turn, 9.801_234]
    };
    let rows: Vec<_> = (0..(2.0 * rate_hz) as u64).map(reading).collect();
    let line = |(row, [x, y, z]): (usize, &[f64; 3])| {
        format!("{:.9},{x:.6},{y:.6},{z:.6},0.1,-0.2,0.05,25.0\n", (row + 1) as f64 / rate_hz)
    };
    let lines: String = rows.iter().enumerate().map(line).collect();
    (format!("time,ax,ay,az,gx,gy,gz,t\n{lines}"), rows)
}

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"time\"\nunit = \"s\"\n[accelerometer]\ncolumns = [\"ax\", \"ay\", \"az\"]\n\
                       kind = \"reading\"\nunit = \"m/s2\"\nresolution = 1e-6\n[gyroscope]\ncolumns = [\"gx\", \"gy\", \"gz\"]\n\
                       kind = \"reading\"\nunit = \"rad/s\"\nresolution = 1e-7\n[temperature]\ncolumns = [\"t\", \"t\", \"t\"]\n";

/// The columns of increments in a file.
fn columns<const N: usize>(path: &Path, names: [&str; N]) -> Vec<[f64; N]> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header: Vec<_> = lines.next().unwrap().split(',').collect();
    let places = names.map(|name| header.iter().position(|column| *column == name).unwrap_or_else(|| panic!("{name}")));
    lines
        .map(|line| {
            let fields: Vec<_> = line.split(',').collect();
            places.map(|place| fields[place].parse().unwrap())
        })
        .collect()
}

#[test]
fn readings_of_any_rate_have_the_same_value_with_one_table() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("m.toml", MAPPING);
    write("200.csv", &text_of_readings(200.0).0);
    let convert = ["convert", "--mapping", "m.toml", "--imu", "imu-a"];
    run(folder.path(), 0, &[&convert[..], &["200.csv", "-o", "raw.csv", "--nominal", "t.toml"]].concat());
    let replay = ["replay", "--table", "t.toml"];
    for rate_hz in [50.0, 100.0, 187.3, 200.0, 1000.0] {
        let (text, readings) = text_of_readings(rate_hz);
        write("data.csv", &text);
        let (_, words) =
            run(folder.path(), 0, &[&replay[..], &["data.csv", "--mapping", "m.toml", "-o", "i.csv"]].concat());
        assert!(!words.contains("[interval-not-nominal]"), "{rate_hz}: {words}");
        let increments = columns(&folder.path().join("i.csv"), ["interval_ns", "a1_dv", "a2_dv", "a3_dv"]);
        assert_eq!(increments.len(), readings.len());
        let mut sums = [[0.0; 3]; 2];
        for ([interval_ns, dv @ ..], reading) in increments.into_iter().zip(&readings) {
            for axis in 0..3 {
                let off = dv[axis] - reading[axis] * interval_ns / 1e9;
                assert!(off.abs() <= 1.001 * 1e-6 * 0.005, "{rate_hz} Hz, axis {axis}: {off} m/s");
                sums[0][axis] += dv[axis];
                sums[1][axis] += reading[axis] * interval_ns / 1e9;
            }
        }
        for (axis, (is, right)) in sums[0].iter().zip(sums[1]).enumerate() {
            let off = is - right;
            assert!(off.abs() <= 0.501 * 1e-6 * 0.005, "{rate_hz} Hz, the sum of axis {axis} is {off} m/s off");
        }
        // Converted for the table, the recording has the same pulses.
        run(folder.path(), 0, &[&convert[..], &["data.csv", "-o", "raw.csv", "--table", "t.toml"]].concat());
        run(folder.path(), 0, &[&replay[..], &["raw.csv", "-o", "j.csv"]].concat());
        let [direct, converted] = ["i.csv", "j.csv"].map(|name| fs::read(folder.path().join(name)).unwrap());
        assert_eq!(direct, converted, "{rate_hz}");
    }
}

#[test]
fn pulses_that_are_not_those_of_the_table_are_refused() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("m.toml", MAPPING);
    write("data.csv", &text_of_readings(200.0).0);
    let convert = ["convert", "data.csv", "-o", "raw.csv", "--imu", "imu-a"];
    run(folder.path(), 0, &[&convert[..], &["--mapping", "m.toml", "--nominal", "t.toml"]].concat());
    // Another resolution.
    write("coarse.toml", &MAPPING.replace("resolution = 1e-6", "resolution = 1e-5"));
    let table = ["--table", "t.toml"];
    for command in [&["replay", "-o", "i.csv"][..], &["verify"], &["noise"], &["convert", "-o", "raw.csv"]] {
        let (_, words) = run(folder.path(), 65, &[command, &table, &["data.csv", "--mapping", "coarse.toml"]].concat());
        assert!(words.contains("A1") && words.contains("5.0000e-8 m/s") && words.contains("5.0000e-9"), "{words}");
    }
    let warm_up = ["calibrate", "warm-up", "data.csv", "--mapping", "coarse.toml", "--nominal", "t.toml"];
    let (_, words) = run(folder.path(), 65, &[&warm_up[..], &["--imu", "imu-a", "-o", "u.toml"]].concat());
    assert!(words.contains("5.0000e-8 m/s"), "{words}");
}

#[test]
fn counts_of_another_interval_than_the_table_are_refused() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let mapping = "format = 1\n[time]\ncolumn = \"time\"\nunit = \"s\"\n[accelerometer]\ncolumns = [\"ax\", \"ay\", \"az\"]\n\
                   kind = \"reading\"\n[temperature]\ncolumns = [\"t\", \"t\", \"t\"]\n";
    write("m.toml", mapping);
    let text = |rate_hz: f64| {
        let line = |row: u64| format!("{:.9},12,-34,{},25.0\n", (row + 1) as f64 / rate_hz, 9800 + row % 5);
        let lines: String = (0..200).map(line).collect();
        format!("time,ax,ay,az,t\n{lines}")
    };
    let nominal = Nominal {
        has_gyroscopes: false,
        resolution: Resolution { accelerometer: 1e-3, gyroscope: 1e-3 },
        ..Nominal::new("imu-a".parse().unwrap(), 5_000_000, [-40.0, 85.0])
    };
    write("t.toml", &nominal_table(&nominal).unwrap().to_toml());
    for (rate_hz, code) in [(200.0, 0), (199.0, 0), (100.0, 65), (400.0, 65), (187.3, 65)] {
        write("counts.csv", &text(rate_hz));
        for command in ["replay", "convert"] {
            let words = [command, "counts.csv", "--mapping", "m.toml", "--table", "t.toml", "-o", "out.csv"];
            let (_, words) = run(folder.path(), code, &words);
            assert_eq!(words.contains("the counts are of an interval of"), code == 65, "{rate_hz}: {words}");
        }
    }
}
