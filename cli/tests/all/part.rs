//! `--from` and `--to` of the commands that read recordings.

use crate::common::{folder, run};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// A warm-up of 400 s at rest, a flight of 100 s, and rest again, 2 rows/s, from 1000 s on.
fn flight(path: &Path) {
    let mut state = 5_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
    };
    let mut text = "t,x,y,z,c\n".to_owned();
    for row in 0..1200_u32 {
        let celsius = -10.0 + 0.04 * f64::from(row);
        let shaken = if (800..1000).contains(&row) { 30.0 } else { 0.01 };
        let [x, y, z] = [0.002 * celsius, -0.001 * celsius, 9.80665].map(|value| value + shaken * noise());
        let time = 1000.0 + 0.5 * f64::from(row + 1);
        writeln!(text, "{time:.1},{x:.6},{y:.6},{z:.6},{celsius:.3}").unwrap();
    }
    fs::write(path, text).unwrap();
}

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\ninterval_s = 0.5\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\nresolution = 1e-6\nunit = \"m/s2\"\n[temperature]\ncolumns = \"c\"\n";

#[test]
fn a_part_of_a_recording_is_as_a_recording_of_that_part() {
    let folder = folder();
    let folder = folder.path();
    flight(&folder.join("f.txt"));
    fs::write(folder.join("m.toml"), MAPPING).unwrap();
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    let convert = ["convert", "f.txt", "--mapping", "m.toml"];
    run(folder, 0, &[&convert[..], &["-o", "all.csv", "--nominal", "n.toml", "--imu", "imu-b"]].concat());
    let rows = |text: &str| text.lines().count() - 1;
    // The first row begins at 1000 s: those of 0.5 to 2 s end at 1001 to 1002 s.
    let (_, err) = run(folder, 0, &[&convert[..], &["-o", "p.csv", "--from", "0.5", "--to", "2"]].concat());
    assert!(err.contains("3 rows are read, from 0.5 s to 2 s of the recording; the first begins after 0.5 s"), "{err}");
    let all = read("all.csv");
    let wanted: Vec<_> = all.lines().skip(2).take(3).collect();
    assert_eq!(read("p.csv").lines().skip(1).collect::<Vec<_>>(), wanted);
    // By time stamps, and both kinds mixed.
    for limits in
        [["--from", "1001000000000ns", "--to", "1002000000000ns"], ["--from", "0.5", "--to", "1002000000000ns"]]
    {
        run(folder, 0, &[&convert[..], &["-o", "s.csv"], &limits].concat());
        assert_eq!(read("s.csv"), read("p.csv"), "{limits:?}");
    }
    // The commands that read the text, and the recording that it became.
    let part = ["--from", "100", "--to", "350"];
    run(folder, 0, &[&convert[..], &["-o", "part.csv"], &part].concat());
    assert_eq!(rows(&read("part.csv")), 500);
    let replay = ["replay", "--table", "n.toml"];
    let (of_part, _) = run(folder, 0, &[&replay[..], &["part.csv"]].concat());
    for input in [&["all.csv"][..], &["f.txt", "--mapping", "m.toml"]] {
        let (out, err) = run(folder, 0, &[&replay[..], input, &part].concat());
        assert!(out == of_part && err.contains("500 rows are read"), "{err}");
    }
    let verify = ["verify", "--table", "n.toml", "--window", "5", "--json"];
    let (of_part, _) = run(folder, 0, &[&verify[..], &["part.csv"]].concat());
    assert_eq!(run(folder, 0, &[&verify[..], &["all.csv"], &part].concat()).0, of_part);
    let regress = ["regress", "--x", "a1_head", "--y", "a1_positive", "--json"];
    let (of_part, _) = run(folder, 0, &[&regress[..], &["part.csv"]].concat());
    let slope = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap()["orders"].clone();
    // A text of numbers names no interval: times count from the first stamp.
    let (out, _) =
        run(folder, 0, &[&regress[..], &["all.csv", "--from", "1100500000000ns", "--to", "1350000000000ns"]].concat());
    assert_eq!(slope(&out), slope(&of_part));
    assert!(run(folder, 65, &["regress", "f.txt", "--x", "c", "--y", "x", "--to", "5"]).1.contains("timestamp_ns"));
}

#[test]
fn a_flight_is_left_out_and_the_table_says_what_was_read() {
    let folder = folder();
    let folder = folder.path();
    flight(&folder.join("f.txt"));
    fs::write(folder.join("m.toml"), MAPPING).unwrap();
    let calibrate = ["calibrate", "warm-up", "f.txt", "--mapping", "m.toml", "--imu", "imu-b", "--order", "1"];
    let (_, err) = run(folder, 0, &[&calibrate[..], &["-o", "t.toml", "--to", "400"]].concat());
    assert!(err.contains("800 rows are read, up to 400 s of the recording"), "{err}");
    let table = fs::read_to_string(folder.join("t.toml")).unwrap();
    assert!(table.contains("part = \"up to 400 s\"\n"), "{table}");
    // What comes after is neither read nor judged: broken rows there do not matter.
    let text = fs::read_to_string(folder.join("f.txt")).unwrap();
    let line = |(number, line): (usize, &str)| match number {
        1000..1030 => format!("broken{line}\n"),
        _ => format!("{line}\n"),
    };
    let broken: String = text.lines().enumerate().map(line).collect();
    assert_ne!(text, broken);
    fs::write(folder.join("f.txt"), broken).unwrap();
    run(folder, 65, &[&calibrate[..], &["-o", "no.toml"]].concat());
    run(folder, 0, &[&calibrate[..], &["-o", "again.toml", "--to", "400"]].concat());
    let digest = |name: &str| fs::read_to_string(folder.join(name)).unwrap().lines().nth(1).map(str::to_owned);
    assert_eq!(digest("again.toml"), digest("t.toml"));
}

#[test]
fn a_part_that_cannot_be_is_refused_with_what_there_is() {
    let folder = folder();
    let folder = folder.path();
    flight(&folder.join("f.txt"));
    fs::write(folder.join("m.toml"), MAPPING).unwrap();
    let convert = ["convert", "f.txt", "--mapping", "m.toml", "-o", "p.csv"];
    for (code, part, word) in [
        (64, &["--from", "5", "--to", "5"][..], "--from is not before --to"),
        (64, &["--from", "-1"], "give seconds since the begin of the recording"),
        (64, &["--to", "soon"], "or a time stamp, as 12500000000ns or 2026-05-01T12:34:56Z"),
        (
            65,
            &["--from", "700"],
            "f.txt: no row from 700 s on; its rows are from 1000000000000ns to 1600000000000ns, over 600 s",
        ),
        (65, &["--to", "5ns"], "no row up to 5ns"),
    ] {
        let (_, err) = run(folder, code, &[&convert[..], part].concat());
        assert!(err.contains(word), "{part:?}: {err}");
    }
    assert!(!folder.join("p.csv").exists());
}
