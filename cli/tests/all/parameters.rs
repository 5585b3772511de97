//! `export` and `import` on files.

use crate::common::{folder, run};
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/autopilot/tests/data");
const MEMS: [&str; 4] = ["--imu", "imu-a", "--interval", "0.0025"];

#[test]
fn parameters_become_a_table_and_parameters_again() {
    let folder = folder();
    let (params, parm) = (format!("{DATA}/full.params"), format!("{DATA}/full.parm"));
    let import = [&["import", &params, "--from", "px4", "-o", "imu-a.toml"], &MEMS[..]].concat();
    let (out, err) = run(folder.path(), 0, &import);
    assert!(out.is_empty() && err.starts_with("isotherm: table ") && err.ends_with(" of imu-a\n"), "{err}");
    run(folder.path(), 0, &["check", "imu-a.toml"]);
    let device = ["--device-id", "3014666,3080202"];
    let export = [&["export", "imu-a.toml", "--to", "px4", "-o", "-"], &device[..]].concat();
    let (out, err) = run(folder.path(), 0, &export);
    assert!(out.starts_with("# Sensor thermal compensation parameters\n#\n"), "{out}");
    assert!(out.contains("\n1\t1\tTC_G0_ID\t3080202\t6\n"), "{out}");
    assert!(err.starts_with("isotherm: 34 parameters of PX4 in stdout; in float32 within "), "{err}");
    let export = ["export", "imu-a.toml", "--to", "ardupilot", "--instance", "2", "--at", "-5", "-o", "imu-a.parm"];
    let (_, err) = run(folder.path(), 0, &export);
    assert!(err.contains("29 parameters of ArduPilot in imu-a.parm"), "{err}");
    let written = fs::read_to_string(folder.path().join("imu-a.parm")).unwrap();
    assert!(written.contains("\nINS_ACC2_CALTEMP -5.0\nINS_ACC2OFFS_X -0.0"), "{written}");
    let import = [&["import", "imu-a.parm", "--from", "ardupilot", "--instance", "2", "-o", "back.toml"], &MEMS[..]];
    run(folder.path(), 0, &import.concat());
    // The two tables differ by what float32 rounds.
    let bounds = "bias=0.1ug0,rate=0.01deg/h";
    run(folder.path(), 0, &["compare", "imu-a.toml", "back.toml", "--require", bounds]);
    let import = [&["import", &parm, "--from", "ardupilot", "--gravity", "9.81", "-o", "g.toml"], &MEMS[..]].concat();
    run(folder.path(), 0, &import);
    assert!(fs::read_to_string(folder.path().join("g.toml")).unwrap().contains("gravity = 9.81\n"));
}

#[test]
fn what_cannot_be_said_is_refused_or_left_out() {
    let folder = folder();
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let table = format!("{root}/examples/tables/imu-b.toml");
    let (_, err) = run(folder.path(), 78, &["export", &table, "--to", "ardupilot", "-o", "b.parm"]);
    for effect in ["scale-temperature", "negative-scale", "alignment"] {
        assert!(err.contains(&format!("--drop {effect} leaves it out")), "{err}");
    }
    assert!(!folder.path().join("b.parm").exists());
    let drop = ["--drop", "scale-temperature,negative-scale", "--drop", "alignment"];
    let (_, err) =
        run(folder.path(), 0, &[&["export", &table, "--to", "ardupilot", "-o", "b.parm"], &drop[..]].concat());
    assert!(err.contains("left out: alignment") && err.contains("note: outside of the range"), "{err}");
    let (_, err) = run(folder.path(), 64, &["export", &table, "--to", "px5", "-o", "b.parm"]);
    assert!(err.contains("px4, ardupilot"), "{err}");
    let (_, err) = run(folder.path(), 64, &["export", &table, "--to", "px4", "--drop", "scale", "-o", "b.params"]);
    assert!(err.contains("scale-temperature"), "{err}");
    run(folder.path(), 64, &["export", &table, "--to", "px4", "--device-id", "x", "-o", "b.params"]);
    run(folder.path(), 64, &["export", &table, "--to", "px4", "-o", &table]);
}

#[test]
fn a_broken_file_is_named_with_line_and_key() {
    let folder = folder();
    let text = fs::read_to_string(format!("{DATA}/full.parm")).unwrap().replace("ACC2_Y -27", "ACC2_Y nan");
    fs::write(folder.path().join("broken.parm"), text).unwrap();
    let import = [&["import", "broken.parm", "--from", "ardupilot", "-o", "imu-a.toml"], &MEMS[..]].concat();
    let (_, err) = run(folder.path(), 78, &import);
    assert!(err.contains("broken.parm:8: INS_TCAL1_ACC2_Y: is \"nan"), "{err}");
    assert!(!folder.path().join("imu-a.toml").exists());
}

/// A recording of an IMU that measures nothing, at these temperatures.
fn at_temperatures(temperatures: &[f64]) -> String {
    let sensors = ["a1", "a2", "a3", "g1", "g2", "g3"];
    let columns = sensors.map(|name| format!("{name}_positive,{name}_negative,{name}_head,{name}_board")).join(",");
    let row = |(row, celsius): (u64, &f64)| {
        let of_sensor = format!("0,0,{celsius},{celsius}");
        format!("{row},{},2500000,{}\n", (row + 1) * 2_500_000, [of_sensor.as_str(); 6].join(","))
    };
    let rows: String = (0..).zip(temperatures).map(row).collect();
    format!("sequence,timestamp_ns,interval_ns,{columns}\n{rows}")
}

/// `golden.csv` has what the firmwares' own functions subtract and add: that is what `replay` makes of the parameters.
#[test]
fn import_and_replay_give_what_the_firmwares_give() {
    let folder = folder();
    let folder = folder.path();
    let golden = fs::read_to_string(format!("{DATA}/golden.csv")).unwrap();
    for set in ["full", "heating"] {
        let rows: Vec<Vec<f64>> = golden
            .lines()
            .filter_map(|line| line.strip_prefix(&format!("{set},")))
            .map(|line| line.split(',').map(|number| number.parse().unwrap()).collect())
            .collect();
        assert_eq!(rows.len(), 72);
        // At the temperature, and at the calibration temperatures of both triads.
        let temperatures: Vec<f64> = rows.iter().flat_map(|row| [row[2], row[0], row[1]]).collect();
        fs::write(folder.join("rows.csv"), at_temperatures(&temperatures)).unwrap();
        let readings = |from: &str, file: &str| -> Vec<[f64; 6]> {
            let file = format!("{DATA}/{set}.{file}");
            run(folder, 0, &[&["import", &file, "--from", from, "-o", "t.toml"], &MEMS[..]].concat());
            run(folder, 0, &["replay", "--table", "t.toml", "rows.csv", "-o", "out.csv"]);
            let out = fs::read_to_string(folder.join("out.csv")).unwrap();
            let of_line = |line: &str| {
                let fields: Vec<_> = line.split(',').collect();
                core::array::from_fn(|sensor| fields[3 + sensor].parse::<f64>().unwrap() / 0.0025)
            };
            out.lines().skip(1).map(of_line).collect()
        };
        let [px4, ardupilot] = [readings("px4", "params"), readings("ardupilot", "parm")];
        for (number, row) in rows.iter().enumerate() {
            for sensor in 0..6 {
                let [at, accelerometers, gyroscopes] = [0, 1, 2].map(|of| ardupilot[3 * number + of][sensor]);
                let calibrated = if sensor < 3 { accelerometers } else { gyroscopes };
                let pairs = [(-px4[3 * number][sensor], row[3 + sensor]), (at - calibrated, row[9 + sensor])];
                for (ours, theirs) in pairs {
                    let bound = 2e-6 + 1e-6 * theirs.abs();
                    assert!((ours - theirs).abs() < bound, "{set} {}: {sensor}: {ours} {theirs}", row[2]);
                }
            }
        }
    }
}
