//! `export` and `import` on files.

use crate::common::{folder, run};
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../parameters/tests/data");
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
