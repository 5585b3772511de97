//! Several recordings are sessions: converted together, and read together.

use crate::common::{folder, run};
use std::fs;
use std::path::Path;

pub(crate) const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\ninterval_s = 0.01\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\nresolution = 1e-5\n[temperature]\ncolumns = \"T\"\n";

/// An IMU that is put down in 12 attitudes, 6 s each, after a second of movement, at this temperature.
pub(crate) fn log(folder: &Path, name: &str, temperature: f64) {
    let directions = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [0.7, 0.7, 0.14],
        [0.7, -0.7, 0.14],
        [-0.6, 0.6, 0.53],
        [0.1, 0.7, -0.7],
        [-0.7, 0.1, 0.7],
        [0.57, 0.57, -0.59],
    ];
    let mut state = 7_u64;
    let mut noise = || {
        let sum = (0..12).fold(0.0, |sum, _| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum + (state >> 33) as f64 / (1_u64 << 31) as f64
        });
        sum - 6.0
    };
    let (mut text, mut row) = ("t,x,y,z,T\n".to_owned(), 0);
    for direction in directions.iter().chain(&directions) {
        let length = direction.iter().map(|part: &f64| part * part).sum::<f64>().sqrt();
        for step in 0..700 {
            row += 1;
            let value = |axis: usize, noise: f64| {
                let turn = if step < 100 {
                    3.0 * libm::sin(f64::from(step) * 0.35 * (axis as f64 + 1.0)) + noise
                } else {
                    0.0
                };
                direction[axis] / length * 9.81 * (1.0 + 2e-5 * temperature) + turn + 0.004 * noise
            };
            let [x, y, z] = [0, 1, 2].map(|axis| value(axis, noise()));
            let time = f64::from(row) * 0.01;
            text += &format!("{time:.3},{x:.5},{y:.5},{z:.5},{:.3}\n", temperature + 0.02 * noise());
        }
    }
    fs::write(folder.join(name), text).unwrap();
}

#[test]
fn verify_noise_and_replay_take_the_pieces_that_calibrate_took() {
    let folder = folder();
    let folder = folder.path();
    log(folder, "cold.csv", 5.0);
    log(folder, "warm.csv", 40.0);
    fs::write(folder.join("m.toml"), MAPPING).unwrap();
    fs::create_dir(folder.join("runs")).unwrap();
    run(folder, 0, &["convert", "cold.csv", "warm.csv", "--mapping", "m.toml", "-o", "runs"]);
    let header = "session,sequence,timestamp_ns,";
    for (name, session) in [("cold.csv", "1,"), ("warm.csv", "2,")] {
        let text = fs::read_to_string(folder.join("runs").join(name)).unwrap();
        let rows: Vec<_> = text.lines().collect();
        assert!(rows[0].starts_with(header) && rows[1..].iter().all(|row| row.starts_with(session)), "{}", rows[1]);
        run(folder, 0, &["convert", name, "--mapping", "m.toml", "-o", &format!("plain-{name}")]);
        // Apart from the column the samples are the same.
        let plain = fs::read_to_string(folder.join(format!("plain-{name}"))).unwrap();
        assert!(rows.iter().map(|row| row.split_once(',').unwrap().1).eq(plain.lines()));
        run(folder, 0, &["convert", name, "--mapping", "m.toml", "--session", &session[..1], "-o", "one.csv"]);
        assert_eq!(fs::read_to_string(folder.join("one.csv")).unwrap(), text);
    }
    let mut replayed = Vec::new();
    for pieces in [["runs/cold.csv", "runs/warm.csv"], ["plain-cold.csv", "plain-warm.csv"]] {
        let with = |command: &[&str]| run(folder, 0, &[command, &pieces].concat()).0;
        let options = ["--gravity-local", "9.81", "--gravity-reference", "9.81", "--temperature-unit", "degC"];
        with(&[&["calibrate", "tumble", "--imu", "imu-a", "-o", "t.toml"], &options[..]].concat());
        let (verified, err) = run(folder, 0, &[&["verify", "--table", "t.toml"], &pieces[..]].concat());
        assert!(verified.contains("48 static poses") && err.contains("own-recording"), "{verified}{err}");
        replayed.push(with(&["replay", "--table", "t.toml"]));
        let (_, err) = run(folder, 65, &[&["noise"], &pieces[..]].concat());
        assert!(err.contains("the longest stretch without a gap, a movement, a new session"), "{err}");
    }
    assert!(replayed[0] == replayed[1] && replayed[0].lines().count() == 33_601);
    // With a table, the pulses show that the data are in another unit.
    fs::write(folder.join("milli.toml"), MAPPING.replace("resolution = 1e-5", "resolution = 1e-2")).unwrap();
    for (mapping, code) in [("m.toml", 0), ("milli.toml", 65)] {
        let command = ["convert", "cold.csv", "--mapping", mapping, "--table", "t.toml", "-o", "again.csv"];
        let (_, err) = run(folder, code, &command);
        assert_eq!(err.contains("A1: one pulse of the source is 1.0000e-4 m/s"), code == 65, "{err}");
    }
    // What overlaps, or is a copy, is no session.
    fs::copy(folder.join("plain-cold.csv"), folder.join("copy.csv")).unwrap();
    let (_, err) = run(folder, 65, &["replay", "--table", "t.toml", "plain-cold.csv", "copy.csv"]);
    assert!(
        err.contains("copy.csv: its first row, of 10000000 ns, is there twice; the piece before is plain-cold.csv"),
        "{err}"
    );
}

#[test]
fn what_cannot_be_sessions_is_refused_and_check_knows_a_recording() {
    let folder = folder();
    let folder = folder.path();
    fs::write(folder.join("m.toml"), MAPPING).unwrap();
    for name in ["a.csv", "b.csv", "a.txt"] {
        fs::write(folder.join(name), "t,x,y,z,T\n0.01,1,2,3,25\n0.02,1,2,3,25\n").unwrap();
    }
    let refused = |arguments: &[&str], message: &str| {
        let (_, err) = run(folder, 64, &[&["convert", "--mapping", "m.toml"], arguments].concat());
        assert!(err.contains(message), "{err}");
    };
    refused(&["a.csv", "b.csv", "-o", "run.csv"], "run.csv: several files are converted into a folder; make it");
    fs::create_dir(folder.join("runs")).unwrap();
    refused(&["a.csv", "a.txt", "-o", "runs"], "two inputs would be runs/a.csv");
    refused(&["a.csv", "-", "-o", "runs"], "-: of several inputs each is a file");
    refused(&["a.csv", "b.csv", "-o", "."], "a.csv is the data; write to another file");
    run(folder, 0, &["convert", "--mapping", "m.toml", "a.csv", "b.csv", "--session", "5", "-o", "runs"]);
    assert!(fs::read_to_string(folder.join("runs/b.csv")).unwrap().contains("\n6,0,"));
    let (out, _) = run(folder, 0, &["check", "runs/a.csv"]);
    assert!(out.contains("runs/a.csv: recording in CSV, raw: 2 rows"), "{out}");
}
