//! Split bags, and accelerometers and gyroscopes in two topics or two files, by every command that reads them.

use crate::common::{folder, run};
use isotherm_recording_formats::ros::ImuMessage;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::Path;

const BEGIN: u64 = 1_700_000_000_000_000_000;

/// Writes a bag of these messages.
fn bag(path: &Path, messages: &[(&str, ImuMessage)]) {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let mut channels = BTreeMap::new();
    for (topic, imu) in messages {
        let channel_id = *channels.entry(*topic).or_insert_with(|| {
            let schema = writer.add_schema("sensor_msgs/msg/Imu", "ros2msg", b"").unwrap();
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
        });
        let mut data = Vec::new();
        imu.encode(&mut data).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time: imu.stamp_ns, publish_time: imu.stamp_ns };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    fs::write(path, writer.into_inner().into_inner()).unwrap();
}

/// Normal numbers.
fn noise() -> impl FnMut() -> f64 {
    let mut state = 17_u64;
    move || {
        let sum = (0..12).fold(0.0, |sum, _| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum + (state >> 33) as f64 / (1_u64 << 31) as f64
        });
        sum - 6.0
    }
}

/// Messages at a rate \[Hz\], of accelerometers or of gyroscopes.
fn messages(topic: &'static str, hertz: f64, seconds: f64, is_gyroscope: bool) -> Vec<(&'static str, ImuMessage)> {
    let mut noise = noise();
    let row = |row: u64| {
        let mut three = |mean: [f64; 3], deviation: f64| mean.map(|mean| mean + deviation * noise());
        let [acceleration, rate] = match is_gyroscope {
            true => [[0.0; 3], three([0.001_3, -0.002_1, 0.003_7], 1.1e-3)],
            false => [three([0.13, 9.79, 0.31], 0.012), [0.0; 3]],
        };
        let imu = ImuMessage {
            stamp_ns: BEGIN + ((row as f64 + 0.2) * 1e9 / hertz) as u64,
            frame_id: "imu".to_owned(),
            angular_velocity: Some(rate),
            linear_acceleration: Some(acceleration),
        };
        (topic, imu)
    };
    (0..(hertz * seconds) as u64).map(row).collect()
}

const ACCEL: &str = "/camera/accel/sample";
const GYRO: &str = "/camera/gyro/sample";

/// N of each sensor, with its range.
fn densities(folder: &Path, data: &[&str]) -> Vec<[f64; 3]> {
    let convert = ["convert", "-o", "r.csv", "--nominal", "n.toml"];
    run(folder, 0, &[&convert[..], data].concat());
    let (text, _) = run(folder, 0, &[&["noise", "--table", "n.toml"], data].concat());
    let lines = text.lines().filter(|line| line.starts_with("  N "));
    let numbers = |line: &str| line.split_whitespace().filter_map(|word| word.parse().ok()).collect::<Vec<f64>>();
    lines.map(|line| <[f64; 3]>::try_from(numbers(line)).unwrap_or_else(|_| panic!("{line}"))).collect()
}

#[test]
fn noise_of_two_topics_is_that_of_each_alone() {
    for [accelerometers, gyroscopes] in [[100.0, 200.0], [63.0, 200.0], [250.0, 200.0], [400.0, 200.0]] {
        let folder = folder();
        let folder = folder.path();
        let a = messages(ACCEL, accelerometers, 60.0, false);
        let g = messages(GYRO, gyroscopes, 60.0, true);
        bag(&folder.join("both.mcap"), &[a, g].concat());
        let joined = densities(folder, &["both.mcap"]);
        let alone = [ACCEL, GYRO].map(|topic| densities(folder, &["both.mcap", "--topic", topic])).concat();
        assert_eq!((joined.len(), alone.len()), (6, 6), "{accelerometers} {gyroscopes}");
        for ([found, ..], [_, low, high]) in joined.iter().zip(&alone) {
            assert!((low..=high).contains(&found), "{accelerometers} {gyroscopes}: {found}, {low} to {high}");
        }
    }
}

#[test]
fn a_split_bag_is_one_recording_for_every_command() {
    let folder = folder();
    let folder = folder.path();
    let mut all = messages("/imu", 100.0, 24.0, false);
    let mut rates = messages("/imu", 100.0, 24.0, true);
    all.iter_mut().zip(&mut rates).for_each(|(row, rate)| row.1.angular_velocity = rate.1.angular_velocity.take());
    bag(&folder.join("whole.mcap"), &all);
    fs::create_dir(folder.join("drive")).unwrap();
    fs::write(folder.join("drive/metadata.yaml"), "rosbag2_bagfile_information:\n  version: 5\n").unwrap();
    let pieces = ["drive/drive_0.mcap", "drive/drive_1.mcap", "drive/drive_2.mcap"];
    pieces.iter().zip(all.chunks(800)).for_each(|(name, rows)| bag(&folder.join(name), rows));
    let ways = [vec!["drive"], pieces.to_vec(), vec![pieces[2], pieces[0], pieces[1]]];
    run(folder, 0, &["convert", "whole.mcap", "-o", "whole.csv", "--nominal", "n.toml", "--imu", "imu-a"]);
    let whole = fs::read_to_string(folder.join("whole.csv")).unwrap();
    for way in &ways {
        let (_, err) = run(folder, 0, &[&["convert"], &way[..], &["-o", "joined.csv"]].concat());
        assert!(fs::read_to_string(folder.join("joined.csv")).unwrap() == whole);
        assert!(err.contains("drive/drive_0.mcap to drive/drive_2.mcap: 3 pieces are joined"), "{err}");
        assert!(err.matches("[no-temperature]").count() == 1 && err.contains("2400 rows in joined.csv"), "{err}");
    }
    // Each in a file of its own, of one session; what is read of these is the whole again.
    fs::create_dir(folder.join("runs")).unwrap();
    run(folder, 0, &["convert", "drive", "-o", "runs"]);
    let second = fs::read_to_string(folder.join("runs/drive_1.csv")).unwrap();
    assert!(second.lines().count() == 801 && second.lines().nth(1).unwrap().starts_with("1,800,"), "{second:.99}");
    run(folder, 0, &["convert", pieces[1], "-o", "second.csv", "--interval", "0.01"]);
    run(folder, 0, &["convert", pieces[0], "-o", "first.csv", "--interval", "0.01"]);
    run(folder, 0, &["convert", pieces[2], "-o", "third.csv", "--interval", "0.01"]);
    let recordings = vec!["third.csv", "first.csv", "second.csv"];
    let table = ["--table", "n.toml"];
    let commands = [vec!["replay"], vec!["noise", "--json"], vec!["verify", "--window", "1", "--json"]];
    for command in &commands {
        let (of_whole, _) = run(folder, 0, &[&command[..], &table, &["whole.mcap"]].concat());
        for way in ways.iter().chain([&recordings]) {
            let (out, _) = run(folder, 0, &[&command[..], &table, way].concat());
            assert!(out == of_whole, "{command:?} {way:?}");
        }
    }
    // A piece that does not go on has no place in one file.
    let later = all[..800]
        .iter()
        .map(|(topic, imu)| (*topic, ImuMessage { stamp_ns: imu.stamp_ns + 100_000_000_000, ..imu.clone() }));
    bag(&folder.join("later.mcap"), &later.collect::<Vec<_>>());
    let (_, err) = run(folder, 64, &["convert", "drive", "later.mcap", "-o", "joined.csv"]);
    assert!(err.contains("make it, and name it with -o: later.mcap does not continue where"), "{err}");
    let (_, err) = run(folder, 0, &["convert", "later.mcap", "drive", "-o", "runs"]);
    assert!(err.contains("800 rows in runs/later.csv"), "{err}");
    assert!(fs::read_to_string(folder.join("runs/later.csv")).unwrap().contains("\n1,0,"));
    assert!(fs::read_to_string(folder.join("runs/drive_2.csv")).unwrap().contains("\n2,1600,"));
    let (_, err) = run(folder, 0, &["noise", "whole.mcap", "--in-order"]);
    assert!(err.contains("--in-order has no effect: there is one file"), "{err}");
}

/// An IMU of three sensors and three gyroscopes that is put down in attitudes, in two texts of counts about 32768.
#[test]
fn a_tumble_in_two_texts_and_in_split_texts_makes_the_table_of_the_whole() {
    let folder = folder();
    let folder = folder.path();
    crate::pieces::log(folder, "whole.csv", 21.3);
    let text = fs::read_to_string(folder.join("whole.csv")).unwrap();
    let rows: Vec<_> = text.lines().skip(1).collect();
    let part = |rows: &[&str]| format!("t,x,y,z,T\n{}\n", rows.join("\n"));
    // The border lies within a static pose.
    fs::write(folder.join("one.csv"), part(&rows[..9000])).unwrap();
    fs::write(folder.join("two.csv"), part(&rows[9000..])).unwrap();
    let mut noise = noise();
    let turn = |row: usize, noise: &mut dyn FnMut() -> f64| if row % 700 < 100 { 0.5 } else { 0.0 } + 1e-3 * noise();
    let of_gyroscopes = (0..rows.len()).map(|row| {
        let time = row as f64 * 0.01 + 0.013_7;
        format!("{time:.4},{:.6},{:.6},{:.6}\n", turn(row, &mut noise), 1e-3 * noise(), 2e-3 + 1e-3 * noise())
    });
    fs::write(folder.join("whole_gyro.csv"), "t,x,y,z\n".to_owned() + &of_gyroscopes.collect::<String>()).unwrap();
    fs::copy(folder.join("whole.csv"), folder.join("whole_acc.csv")).unwrap();
    fs::write(folder.join("m.toml"), crate::pieces::MAPPING).unwrap();
    let gyroscope = "[gyroscope]\ncolumns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\nresolution = 1e-6\n";
    fs::write(folder.join("two.toml"), format!("{}{gyroscope}", crate::pieces::MAPPING)).unwrap();
    let make = |data: &[&str]| {
        let options = ["--gravity-local=9.81", "--gravity-reference=9.81", "--temperature-unit=degC", "--imu=imu-a"];
        let more = ["--order", "0", "--temperature-range", "15,35", "-o", "t.toml"];
        let (_, err) = run(folder, 0, &[&["calibrate", "tumble"], &options[..], &more, data].concat());
        let table = fs::read_to_string(folder.join("t.toml")).unwrap();
        (table.lines().find(|line| line.starts_with("digest = ")).unwrap().to_owned(), err)
    };
    let (whole, err) = make(&["whole.csv", "--mapping", "m.toml"]);
    assert!(err.contains("24 static poses in 1 group"), "{err}");
    let (split, err) = make(&["two.csv", "one.csv", "--mapping", "m.toml"]);
    assert!(split == whole && err.contains("24 static poses in 1 group"), "{err}");
    assert!(err.contains("one.csv to two.csv: 2 pieces are joined"), "{err}");
    for data in [
        &["whole_gyro.csv", "whole_acc.csv", "--mapping", "two.toml"][..],
        &["whole_acc.csv", "--gyroscope-file", "whole_gyro.csv", "--mapping", "two.toml"],
    ] {
        let (joined, err) = make(data);
        assert!(joined == whole && err.contains("of whole_acc.csv and the gyroscopes of whole_gyro.csv"), "{err}");
    }
    let (_, err) =
        run(folder, 0, &["convert", "whole_acc.csv", "whole_gyro.csv", "--mapping", "two.toml", "-o", "r.csv"]);
    assert!(err.contains("with 1.000 readings of the gyroscopes a row"), "{err}");
    assert!(fs::read_to_string(folder.join("r.csv")).unwrap().lines().next().unwrap().contains(",g1_positive,"));
    let (_, err) = run(folder, 64, &["noise", "whole_acc.csv", "whole_gyro.csv", "--mapping", "m.toml"]);
    assert!(err.contains("the mapping has none: give [gyroscope]"), "{err}");
}
