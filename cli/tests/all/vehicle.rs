//! Logs with several IMUs, as a user types it.

use crate::common::{assert_page, folder, run};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Rows of each IMU.
const ROWS: u32 = 600;
/// Device numbers of accelerometers and gyroscopes, by IMU.
const DEVICES: [[u32; 2]; 3] = [[2_753_028, 2_752_772], [3_080_202, 3_079_946], [2_490_378, 2_490_122]];

/// What an IMU warms up to \[degC\].
fn celsius(imu: usize, row: u32) -> f64 {
    let share = f64::from(row) / f64::from(ROWS);
    -10.0 + 3.0 * imu as f64 + (55.0 + 2.0 * imu as f64) * share
}

/// The biases of x, y, z \[m/s2\], and of the gyroscopes, a hundredth of them \[rad/s\].
fn biases(imu: usize, celsius: f64) -> [f64; 3] {
    let t = (celsius - 20.0) / 30.0;
    let size = 0.05 + 0.03 * imu as f64;
    [size * t, -size * t * t, size * (t - 0.5 * t * t * t)]
}

/// A DataFlash log as text, of IMUs that warm up at rest, a row a second. The temperature of those of `stuck` stands.
fn log(path: &Path, imus: usize, stuck: &[usize]) {
    let mut state = 7_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
    };
    let mut text = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n\
        FMT, 140, 35, PARM, QNff, TimeUS,Name,Value,Default\n\
        FMT, 131, 54, IMU, QBffffffIIfBBHH, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz\n"
        .to_owned();
    for (imu, [accelerometers, gyroscopes]) in DEVICES.iter().take(imus).enumerate() {
        let number = if imu == 0 { String::new() } else { (imu + 1).to_string() };
        writeln!(text, "PARM, 7, INS_ACC{number}_ID, {accelerometers}, 0").unwrap();
        writeln!(text, "PARM, 7, INS_GYR{number}_ID, {gyroscopes}, 0").unwrap();
    }
    for row in 0..ROWS {
        for imu in 0..imus {
            let celsius = celsius(imu, row);
            let [x, y, z] = biases(imu, celsius).map(|bias| bias + 0.01 * noise());
            let [p, q, r] = biases(imu, celsius).map(|bias| 0.01 * bias + 2e-4 * noise());
            let shown = if stuck.contains(&imu) { 25.0 } else { celsius };
            let (time, z) = (1_000_000 * u64::from(row) + 5_000_000, z - 9.80665);
            writeln!(
                text,
                "IMU, {time}, {imu}, {p:.7}, {q:.7}, {r:.7}, {x:.6}, {y:.6}, {z:.6}, 0, 0, {shown:.4}, 1, 1, 1000, 1000"
            )
            .unwrap();
        }
    }
    fs::write(path, text).unwrap();
}

fn calibrate<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["calibrate", "warm-up", "warm.log", "--imu", "my-drone", "--order", "3"], more].concat()
}

fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Largest error of the slopes that ArduPilot's parameters give an IMU from 0 to 40 degC \[m/s2\].
fn error_of(parameters: &str, imu: usize) -> f64 {
    let value = |name: &str| {
        let name = format!("INS_TCAL{}_ACC{name} ", imu + 1);
        let line = parameters.lines().find_map(|line| line.strip_prefix(&name));
        line.unwrap_or_else(|| panic!("no {name}")).parse::<f64>().unwrap() * 1e-6
    };
    let mut largest = 0.0_f64;
    for (axis, letter) in ["X", "Y", "Z"].iter().enumerate() {
        let coefficients = [1, 2, 3].map(|power| value(&format!("{power}_{letter}")));
        for celsius in (0..=40).map(f64::from) {
            let t = celsius - 35.0;
            let offset = coefficients[0] * t + coefficients[1] * t * t + coefficients[2] * t * t * t;
            let truth = biases(imu, celsius)[axis] - biases(imu, 35.0)[axis];
            largest = largest.max((offset - truth).abs());
        }
    }
    largest
}

#[test]
fn all_imus_get_a_table_and_the_vehicle_one_report_and_one_file_of_parameters() {
    let folder = folder();
    let folder = folder.path();
    log(&folder.join("warm.log"), 3, &[]);
    let more = ["-o", "{imu}.toml", "--export", "ardupilot=v.parm", "--export", "px4=v.params", "--report", "r.html"];
    let (_, err) = run(folder, 0, &calibrate(&more));
    assert!(err.contains("my-drone-0:\n") && err.contains("my-drone-2:\n"), "{err}");
    let (parm, params) = (read(folder, "v.parm"), read(folder, "v.params"));
    for (imu, devices) in DEVICES.iter().enumerate() {
        let table = read(folder, &format!("my-drone-{imu}.toml"));
        let [accelerometers, gyroscopes] = devices;
        let names = format!("instance = {imu}\ndevice_id = {accelerometers}\ngyroscope_device_id = {gyroscopes}\n");
        assert!(table.contains(&format!("id = \"my-drone-{imu}\"")) && table.contains(&names), "{table}");
        assert!(!table.contains("serial"), "a device number is no serial number: {table}");
        assert_eq!(parm.matches(&format!("INS_TCAL{}_ENABLE 1\n", imu + 1)).count(), 1);
        let error = error_of(&parm, imu);
        println!("IMU {imu}: slopes within {error:.5} m/s2 of the truth");
        assert!(error < 0.005, "{error}");
        for (letter, device) in [("A", accelerometers), ("G", gyroscopes)] {
            assert_eq!(params.matches(&format!("TC_{letter}{imu}_ID\t{device}\t6\n")).count(), 1, "{params}");
        }
    }
    for name in ["TC_A_ENABLE\t1\t6\n", "TC_G_ENABLE\t1\t6\n", "# Vehicle-Id"] {
        assert_eq!(params.matches(name).count(), 1, "{name}: {params}");
    }
    assert_page(
        &folder.join("r.html"),
        40,
        &["my-drone-0", "my-drone-1", "my-drone-2", "IMU 2 (device 2490378", "download=\"v.parm\""],
    );
    // One at a time gives the same tables, in one file each; and the same parameters.
    for imu in ["0", "1", "2"] {
        let alone = ["--instance", imu, "-o", "alone.toml", "--export", "ardupilot=alone.parm"];
        run(folder, 0, &calibrate(&alone));
        assert!(parm.contains(&read(folder, "alone.parm")), "{imu}");
        let digest = |text: &str| text.lines().find(|line| line.starts_with("digest")).map(str::to_owned);
        let renamed = read(folder, "alone.toml").replace("\"my-drone\"", &format!("\"my-drone-{imu}\""));
        let together = read(folder, &format!("my-drone-{imu}.toml"));
        let bias =
            |text: &str| text.lines().filter(|line| line.starts_with("bias")).map(str::to_owned).collect::<Vec<_>>();
        assert!(digest(&renamed).is_some() && bias(&renamed) == bias(&together), "{imu}");
    }
    // The parameters are read back, and a table knows where they belong.
    run(folder, 0, &["export", "my-drone-2.toml", "--to", "ardupilot", "-o", "two.parm"]);
    assert!(parm.contains(&read(folder, "two.parm")) && read(folder, "two.parm").starts_with("INS_TCAL3_ENABLE 1\n"));
    let (_, err) = run(folder, 0, &["export", "my-drone-1.toml", "--to", "px4", "-o", "one.params"]);
    assert!(err.contains("IMU 1 (device 3080202, that of the gyroscopes 3079946), as in the log that made"), "{err}");
    assert!(read(folder, "one.params").contains("TC_G1_ID\t3079946\t6\n"));
    run(
        folder,
        0,
        &["export", "my-drone-1.toml", "--to", "px4", "--instance", "0", "--device-id", "5", "-o", "0.params"],
    );
    assert!(read(folder, "0.params").contains("TC_A0_ID\t5\t6\n"));
    let import =
        ["import", "v.params", "--from", "px4", "--instance", "1", "--imu", "x", "--interval", "1", "-o", "x.toml"];
    run(folder, 0, &import);
}

#[test]
fn an_imu_that_is_refused_is_dropped_and_the_others_go_on() {
    let folder = folder();
    let folder = folder.path();
    log(&folder.join("warm.log"), 3, &[1]);
    fs::create_dir(folder.join("tables")).unwrap();
    let more = ["-o", "tables", "--export", "px4=v.params", "--export", "ardupilot=v.parm", "--report", "r.html"];
    let (out, err) = run(folder, 1, &calibrate(&[&more[..], &["--json"]].concat()));
    assert!(err.contains("my-drone-1 is dropped: "), "{err}");
    assert!(err.ends_with("warm.log: 1 of 3 IMUs dropped, the reasons are above: my-drone-1\n"), "{err}");
    let left = "note: TC_A_ENABLE is left out, because it holds for all IMUs, and my-drone-1 has no parameters here";
    assert!(err.contains(left), "{err}");
    let mut tables: Vec<_> = fs::read_dir(folder.join("tables")).unwrap().map(|it| it.unwrap().file_name()).collect();
    tables.sort();
    assert_eq!(tables, ["my-drone-0.toml", "my-drone-2.toml"]);
    let (parm, params) = (read(folder, "v.parm"), read(folder, "v.params"));
    assert!(parm.contains("INS_TCAL1_ENABLE 1") && parm.contains("INS_TCAL3_ENABLE 1") && !parm.contains("INS_TCAL2"));
    assert!(params.contains("TC_A2_ID") && !params.contains("TC_A1_") && !params.contains("ENABLE"), "{params}");
    let document: Value = serde_json::from_str(&out).unwrap();
    let imus = document["imus"].as_array().unwrap();
    assert_eq!(
        imus.iter().map(|imu| imu["imu"].as_str().unwrap()).collect::<Vec<_>>(),
        ["my-drone-0", "my-drone-1", "my-drone-2"]
    );
    assert_eq!((&imus[2]["instance"], &imus[2]["table"]), (&2.into(), &"tables/my-drone-2.toml".into()));
    assert_eq!(imus[2]["calibration"]["order"]["order"], 3);
    assert!(imus[1]["dropped"]["error"].is_string(), "{document}");
    assert!(read(folder, "r.html").contains("my-drone-1 is dropped"));
}

#[test]
fn one_imu_keeps_the_names_that_it_has() {
    let folder = folder();
    let folder = folder.path();
    log(&folder.join("warm.log"), 1, &[]);
    let (out, _) = run(folder, 0, &calibrate(&["-o", "table.toml", "--export", "px4=v.params", "--json"]));
    let document: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&document["imu"], &document["method"]), (&"my-drone".into(), &"one-attitude".into()));
    assert!(
        read(folder, "table.toml").contains("id = \"my-drone\"")
            && read(folder, "table.toml").contains("instance = 0\n")
    );
    assert!(read(folder, "v.params").contains("TC_A_ENABLE\t1\t6\n1\t1\tTC_A0_ID\t2753028\t6\n"));
    // A folder, and a name with the number, do for one, too.
    fs::create_dir(folder.join("tables")).unwrap();
    run(folder, 0, &calibrate(&["-o", "tables"]));
    run(folder, 0, &calibrate(&["-o", "{imu}-of-{instance}.toml"]));
    assert_eq!(read(folder, "tables/my-drone.toml").lines().nth(1), read(folder, "my-drone-of-0.toml").lines().nth(1));
}

#[test]
fn what_several_imus_would_share_is_refused_with_the_ways_on() {
    let folder = folder();
    let folder = folder.path();
    log(&folder.join("warm.log"), 2, &[]);
    let listed = "0 (device 2753028, 600 rows), 1 (device 3080202, 600 rows)";
    for output in ["table.toml", "-", "no-such-folder/"] {
        let (_, err) = run(folder, 64, &calibrate(&["-o", output]));
        for word in ["give a folder that is there", "{instance}", "--instance: ", listed] {
            assert!(err.contains(word), "{output} {word}: {err}");
        }
    }
    let each = ["-o", "{instance}.toml"];
    for (more, word) in [
        (&["--device-id", "5"][..], "each with the device numbers of the log"),
        (&["--nominal", "n.toml"], "--nominal names one table"),
        (&["--report", "1.toml"], "named for two outputs"),
        (&["--export", "px4=warm.log"], "the recording"),
    ] {
        let (_, err) = run(folder, 64, &calibrate(&[&each[..], more].concat()));
        assert!(err.contains(word), "{more:?}: {err}");
    }
    assert_eq!(fs::read_dir(folder).unwrap().count(), 1, "nothing is left of them");
}

#[test]
fn a_table_takes_its_own_imu_of_a_log_and_another_one_is_said() {
    let folder = folder();
    let folder = folder.path();
    log(&folder.join("warm.log"), 2, &[]);
    run(folder, 0, &calibrate(&["-o", "{instance}.toml"]));
    let replay = |code, table: &str, more: &[&str]| {
        run(folder, code, &[&["replay", "--table", table, "-o", "out.csv"], more].concat()).1
    };
    let err = replay(0, "1.toml", &["warm.log"]);
    assert!(err.contains("of IMU 1,") && err.contains("600 increments, none flagged"), "{err}");
    let other = "[other-device]: warm.log: the rows are of IMU 0 (device 2753028, that of the gyroscopes 2752772), and the \
                 table was made of IMU 1 (device 3080202, that of the gyroscopes 3079946); give the table of that IMU";
    let err = replay(0, "1.toml", &["warm.log", "--instance", "0"]);
    assert!(err.contains(&format!("warning {other}")), "{err}");
    replay(65, "1.toml", &["warm.log", "--instance", "0", "--strict"]);
    let verify =
        |code, more: &[&str]| run(folder, code, &[&["verify", "--table", "1.toml", "warm.log"], more].concat()).1;
    assert!(!verify(0, &[]).contains("other-device"));
    assert!(verify(65, &["--instance", "0"]).contains(&format!("fault {other}")));
    for accepted in [&["--other-device"][..], &["--accept", "other-device"]] {
        assert!(verify(0, &[&["--instance", "0"], accepted].concat()).contains(&format!("warning {other}")));
    }
    // The rows of a conversion have only the device.
    let (_, err) =
        run(folder, 0, &["convert", "warm.log", "-o", "run-{instance}.csv", "--nominal", "n-{instance}.toml"]);
    assert!(err.contains("600 rows in run-0.csv") && err.contains("600 rows in run-1.csv"), "{err}");
    assert!(read(folder, "n-1.toml").contains("id = \"imu-1\""));
    assert!(!replay(0, "1.toml", &["run-1.csv"]).contains("other-device"));
    let err = replay(0, "1.toml", &["run-0.csv"]);
    assert!(
        err.contains("run-0.csv: the rows name another device than the log that made the table, which is of IMU 1")
    );
    // A log with only other IMUs has no own one.
    let text = read(folder, "warm.log").replace("3080202", "77").replace("2753028", "78");
    fs::write(folder.join("other.log"), text).unwrap();
    let err = replay(64, "1.toml", &["other.log"]);
    assert!(err.contains("choose one with --instance: 0 (device 78, 600 rows)"), "{err}");
    let (_, err) = run(folder, 64, &["convert", "run-0.csv", "-o", "again-{instance}.csv"]);
    assert!(err.contains("{instance} in -o is for one log of an autopilot"), "{err}");
    let (_, err) = run(folder, 64, &["convert", "warm.log", "-o", "a-{instance}.csv", "--nominal", "n.toml"]);
    assert!(err.contains("put {instance} in the name"), "{err}");
}

#[test]
fn noise_takes_the_imu_of_its_table() {
    let folder = folder();
    let folder = folder.path();
    log(&folder.join("warm.log"), 2, &[]);
    run(folder, 0, &calibrate(&["-o", "{instance}.toml"]));
    // 600 rows are too few, which is said of the right ones.
    let (_, err) = run(folder, 65, &["noise", "warm.log", "--table", "0.toml"]);
    assert!(err.contains("at least 1000 rows are needed"), "{err}");
    let (_, err) = run(folder, 64, &["noise", "warm.log"]);
    assert!(err.contains("several IMUs; choose one with --instance"), "{err}");
}
