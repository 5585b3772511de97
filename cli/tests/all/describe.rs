//! `describe` and `arguments`, as a page and a user ask for them.

use crate::common::{folder, run};
use serde_json::Value;
use std::fs;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Whether a file is good for a job, and the command line or the reason.
fn job<'a>(file: &'a Value, name: &str) -> (bool, &'a str) {
    let job = file["jobs"].as_array().unwrap().iter().find(|job| job["job"] == name).unwrap();
    let good = job["good"].as_bool().unwrap();
    (good, job[if good { "command" } else { "reason" }].as_str().unwrap())
}

#[test]
fn each_job_has_its_command_line_which_works_or_the_reason_against_it() {
    let folder = folder();
    for log in ["heating.ulg", "heating.BIN"] {
        fs::copy(format!("{ROOT}/recording/formats/tests/data/autopilots/{log}"), folder.path().join(log)).unwrap();
        let (out, _) = run(folder.path(), 0, &["describe", log, "--json"]);
        let document: Value = serde_json::from_str(&out).unwrap();
        let file = &document["files"][0];
        let imu = &file["imus"][0];
        assert_eq!((&file["kind"], &file["error"], &imu["instance"]), (&"data".into(), &Value::Null, &0.into()));
        assert!(imu["rows"].as_u64().unwrap() > 1900 && imu["rate_hz"].as_f64().unwrap().round() == 10.0, "{imu}");
        assert!(imu["temperature"]["high"].as_f64().unwrap() > 30.0 && imu["temperature"]["unit"] == "degC", "{imu}");
        for name in ["calibrate warm-up", "noise", "convert"] {
            let (good, line) = job(file, name);
            assert!(good, "{name}: {line}");
            let words: Vec<_> = line.split(' ').skip(1).collect();
            run(folder.path(), 0, &words);
        }
        let (good, reason) = job(file, "calibrate tumble");
        assert!(!good && reason.contains("about 1 attitudes"), "{reason}");
    }
    // What the line has written is described, too: a table, and parameters.
    let (out, _) = run(folder.path(), 0, &["describe", "heating.toml", "heating.params", "heating.parm", "--json"]);
    let document: Value = serde_json::from_str(&out).unwrap();
    let [table, px4, ardupilot] = [0, 1, 2].map(|index| &document["files"][index]);
    assert!(job(table, "compare").0 && job(table, "export").0 && !job(table, "noise").0, "{table}");
    assert!(job(px4, "import").1.contains("--from px4 --instance 0"), "{px4}");
    assert!(job(ardupilot, "import").1.contains("--from ardupilot --instance 1"), "{ardupilot}");
}

#[test]
fn what_cannot_be_read_is_described_with_the_option_that_is_missing() {
    let folder = folder();
    fs::write(folder.path().join("empty.csv"), "").unwrap();
    fs::write(folder.path().join("t.csv"), "t,ax,ay,az\n0,0,0,9.8\n0.1,0,0,9.8\n0.2,0,0,9.8\n").unwrap();
    let (out, err) = run(folder.path(), 74, &["describe", "empty.csv", "t.csv", "nowhere.ulg", "--json"]);
    let document: Value = serde_json::from_str(&out).unwrap();
    let errors = [0, 1, 2].map(|index| document["files"][index]["error"].as_str().unwrap().to_owned());
    assert!(errors[0].contains("the file is empty"), "{errors:?}");
    assert!(errors[1].contains("--mapping") && errors[1].contains("[accelerometer]"), "{errors:?}");
    assert!(errors[2].starts_with("opening nowhere.ulg") && err.contains(&errors[2]), "{errors:?}{err}");
}

#[test]
fn every_option_of_the_offline_commands_is_listed() {
    let (out, _) = run(folder().path(), 0, &["arguments"]);
    let document: Value = serde_json::from_str(&out).unwrap();
    let commands = document["commands"].as_array().unwrap();
    let warm_up = commands.iter().find(|command| command["name"] == "calibrate warm-up").unwrap();
    let option = |id: &str| warm_up["options"].as_array().unwrap().iter().find(|option| option["id"] == id).unwrap();
    assert_eq!((&option("imu")["required"], &option("order")["default"]), (&true.into(), &"auto".into()));
    assert_eq!((&option("logs")["positional"], &option("logs")["multiple"]), (&true.into(), &true.into()));
    assert_eq!(option("time")["possible_values"][0]["name"], "header");
    assert!(commands.iter().all(|command| command["name"] != "serve" && command["about"] != ""));
}
