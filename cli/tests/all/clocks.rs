//! A warm-up in a bag whose thermometer is stamped by another clock than its IMU: what each command does.

use crate::common::{folder, run};
use isotherm_recording_formats::ros::{ImuMessage, TemperatureMessage};
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::Path;

const BEGIN: u64 = 1_700_000_000_000_000_000;
const SECOND: u64 = 1_000_000_000;
/// Rows a second, and seconds of the warm-up.
const HERTZ: u64 = 20;
const SECONDS: u64 = 240;

/// Writes a warm-up. The stamps of both topics and the times of recording are made of the true times \[ns\].
fn warm_up(path: &Path, imu: fn(u64) -> u64, temperature: fn(u64) -> u64, log: fn(u64) -> u64) {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let mut channel = |schema: &str, topic: &str| {
        let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
        writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
    };
    let channels = [channel("sensor_msgs/msg/Imu", "/imu"), channel("sensor_msgs/msg/Temperature", "/temperature")];
    let mut state = 5_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
    };
    let frame_id = "imu".to_owned();
    for row in 0..HERTZ * SECONDS {
        let time_ns = BEGIN + row * SECOND / HERTZ;
        let celsius = 50.0 - 30.0 / (1.0 + row as f64 / (HERTZ * 60) as f64);
        let mut write = |channel: usize, data: &[u8]| {
            let log_time = log(time_ns);
            let header = MessageHeader { channel_id: channels[channel], sequence: 0, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, data).unwrap();
        };
        let mut data = Vec::new();
        if row % HERTZ == 1 {
            let message = TemperatureMessage { stamp_ns: temperature(time_ns), frame_id: frame_id.clone(), celsius };
            message.encode(&mut data).unwrap();
            write(1, &data);
            data.clear();
        }
        let message = ImuMessage {
            stamp_ns: imu(time_ns),
            frame_id: frame_id.clone(),
            linear_acceleration: Some([0.1, -0.2, 9.8].map(|mean| mean + 0.002 * celsius + 0.02 * noise())),
            angular_velocity: Some([0.001, 0.002, -0.001].map(|mean| mean + 1e-4 * celsius + 0.001 * noise())),
        };
        message.encode(&mut data).unwrap();
        write(0, &data);
    }
    writer.finish().unwrap();
    fs::write(path, writer.into_inner().into_inner()).unwrap();
}

const fn same(time_ns: u64) -> u64 {
    time_ns
}

const CALIBRATE: [&str; 7] = ["calibrate", "warm-up", "bag.mcap", "--imu", "imu-b", "-o", "table.toml"];
const CONVERT: [&str; 7] = ["convert", "bag.mcap", "-o", "run.csv", "--nominal", "nominal.toml", "--imu=imu-b"];
const REPLAY: [&str; 6] = ["replay", "bag.mcap", "--table", "nominal.toml", "-o", "out.csv"];

#[test]
fn clocks_that_are_apart_are_a_fault_in_calibrate_and_a_warning_elsewhere() {
    let folder = folder();
    let (folder, bag) = (folder.path(), folder.path().join("bag.mcap"));
    let say = |command: &[&str], more: &[&str], code: i32, severity: Option<&str>| {
        let (_, said) = run(folder, code, &[command, more].concat());
        match severity {
            Some(severity) => assert!(said.contains(&format!("{severity} [clocks-apart]: ")), "{said}"),
            None => assert!(!said.contains("clocks-apart"), "{said}"),
        }
    };
    warm_up(&bag, same, same, same);
    for command in [&CONVERT[..], &REPLAY, &CALIBRATE] {
        say(command, &[], 0, None);
    }
    fs::remove_file(folder.join("table.toml")).unwrap();
    warm_up(&bag, |time_ns| time_ns + 20 * SECOND, same, same);
    for command in [&CONVERT[..], &REPLAY] {
        say(command, &[], 0, Some("warning"));
    }
    say(&CALIBRATE, &[], 65, Some("fault"));
    assert!(!folder.join("table.toml").exists());
    say(&CALIBRATE, &["--accept", "clocks-apart"], 0, Some("warning"));
    say(&CALIBRATE, &["--time", "log"], 0, None);
    let tumble = ["calibrate", "tumble", "bag.mcap", "--imu", "imu-b", "-o", "t.toml"];
    let gravity = ["--gravity-local", "9.80665", "--gravity-reference", "9.80665", "--temperature-unit", "degC"];
    say(&tumble, &gravity, 65, Some("fault"));
}

#[test]
fn where_neither_stamps_nor_recording_show_the_temperature_every_command_refuses() {
    let folder = folder();
    let (folder, bag) = (folder.path(), folder.path().join("bag.mcap"));
    warm_up(&bag, same, |_| 0, same);
    for command in [&CONVERT[..], &REPLAY, &CALIBRATE] {
        let (_, said) = run(folder, 0, command);
        assert!(said.contains("warning [stamps]: ") && said.contains("recorded before it"), "{said}");
    }
    let increments = || fs::read_to_string(folder.join("out.csv")).unwrap();
    let by_recording = increments();
    warm_up(&bag, same, same, same);
    run(folder, 0, &REPLAY);
    assert!(increments() == by_recording, "the same temperatures");
    warm_up(&bag, same, |_| 0, |_| 7);
    for command in [&CONVERT[..], &REPLAY, &CALIBRATE] {
        let (_, said) = run(folder, 65, command);
        assert!(said.contains("nothing shows which temperature a row has"), "{said}");
    }
}
