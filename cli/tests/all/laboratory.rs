//! Files by position as a user has them: a campaign file is proposed, filled in, checked, and makes the table that rows
//! make; a run is verified at a position of it.

use crate::common::{folder, run};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

#[test]
fn files_by_position_are_proposed_checked_and_calibrated() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let simulate = ["simulate", "campaign", "-o", "c", "--seed", "4", "--set-points", "-20:40:20", "--dwell", "60"];
    run(folder.path(), 0, &simulate);
    let rows = fs::read_to_string(at("c/samples.csv")).unwrap();
    let header: Vec<_> = rows.lines().next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|other| *other == name).unwrap();
    let mut files: BTreeMap<String, String> = BTreeMap::new();
    for line in rows.lines().skip(1) {
        let fields: Vec<_> = line.split(',').collect();
        let of = |name: &str| fields[column(name)];
        let file = files
            .entry(format!("T{}_P{:0>2}.csv", of("set_point_c"), of("position")))
            .or_insert_with(|| "t_s;A1+;A1-;A2+;A2-;A3+;A3-;head_1;head_2;head_3;board_1;board_2;board_3\n".to_owned());
        let time_s: f64 = of("timestamp_ns").parse::<f64>().unwrap() / 1e9;
        let _ = write!(file, "{time_s}");
        for axis in 1..=3 {
            let _ = write!(file, ";{};{}", of(&format!("a{axis}_positive")), of(&format!("a{axis}_negative")));
        }
        for kind in ["head", "board"] {
            (1..=3).for_each(|axis| *file += &format!(";{}", of(&format!("a{axis}_{kind}")).replace('.', ",")));
        }
        file.push('\n');
    }
    fs::create_dir(at("measured")).unwrap();
    files.iter().for_each(|(name, text)| fs::write(at("measured").join(name), text).unwrap());
    run(folder.path(), 0, &["calibrate", "turntable", "--propose", "measured", "-o", "campaign.toml"]);
    let (_, err) = run(folder.path(), 78, &["check", "campaign.toml"]);
    assert!(err.contains("samples.accelerometer.gate_s: is \"?\", which is to be filled in"), "{err}");
    let proposed = fs::read_to_string(at("campaign.toml")).unwrap();
    let known = fs::read_to_string(at("c/campaign.toml")).unwrap();
    // Angles and directions are those of the turntable; the rest is filled in.
    let positions = &known[known.find("[[position]]").unwrap()..];
    let values: BTreeMap<&str, &str> = known.lines().filter_map(|line| line.split_once(" = ")).collect();
    let filled = proposed[..proposed.find("[[position]]").unwrap()].lines().map(|line| match line.split_once(" = ") {
        Some(("gate_s", _)) => "gate_s = 10".to_owned(),
        Some((key, value)) if value.starts_with("\"?\"") => format!("{key} = {}", values[key]),
        _ => line.to_owned(),
    });
    fs::write(at("campaign.toml"), filled.collect::<Vec<_>>().join("\n") + "\n" + positions).unwrap();
    run(folder.path(), 0, &["check", "campaign.toml"]);
    run(folder.path(), 0, &["calibrate", "turntable", "campaign.toml", "-o", "files.toml", "--report", "files.html"]);
    run(folder.path(), 0, &["calibrate", "turntable", "c/campaign.toml", "-o", "rows.toml"]);
    let [rows, files] = ["rows.toml", "files.toml"].map(|name| fs::read_to_string(at(name)).unwrap());
    let digest = |text: &str| text.lines().find(|line| line.starts_with("digest")).unwrap().to_owned();
    assert_eq!(digest(&rows), digest(&files));
    // A run at a position, with its number, its angles, and a direction that was typed with too few digits.
    let simulate =
        ["simulate", "run", "-o", "run", "--truth", "c/truth.toml", "--interval", "1", "--attitude", "1,0,0"];
    run(folder.path(), 0, &simulate);
    for attitude in ["5", "+x", "90,90"] {
        let campaign = ["--attitude", attitude, "--campaign", "campaign.toml"];
        let verify = ["verify", "--table", "files.toml", "run/run.csv", "--gravity-local", "9.8015"];
        // On the tilted base the two headings of +x differ.
        let code = if attitude == "+x" { 64 } else { 0 };
        let (_, err) = run(folder.path(), code, &[&verify[..], &campaign[..]].concat());
        assert_eq!(err.contains("give the number: 5, 6"), code == 64, "{err}");
    }
    let verify = ["verify", "--table", "files.toml", "run/run.csv", "--attitude", "0.99995,0.01,0"];
    let (_, err) = run(folder.path(), 0, &verify);
    assert!(err.contains("--attitude: 5 decimals leave up to 7.1e-6 g0") && err.contains("give 8 decimals"), "{err}");
    let (_, err) = run(folder.path(), 64, &["verify", "--table", "files.toml", "run/run.csv", "--attitude", "5"]);
    assert!(err.contains("give its campaign file, --campaign FILE"), "{err}");
}
