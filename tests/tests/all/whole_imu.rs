//! The service of a whole IMU: what its status shows, samples of another device, and peers of another version.

use iceoryx2::prelude::ZeroCopySend;
use isotherm_client::transport::stream::{increment_name, raw_name};
use isotherm_client::{Acquisition, Flags, RawSample, device, join};
use isotherm_tests::{
    RUN, TABLE, TestDomain, WHOLE_TABLE, completed, id, recording, round_trip, text, wait_until, whole_recording,
};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// The keys of an IMU in the status, less those that are about a whole IMU.
const KEYS: [&str; 44] = [
    "temperature_age_s",
    "temperature_stale",
    "last_sample_unix_s",
    "rate_hz",
    "session_missing",
    "session_unknown",
    "id",
    "table",
    "table_file",
    "table_taken_unix_s",
    "table_modified_unix_s",
    "sample_lag_s",
    "nominal_interval_s",
    "pulse_velocity",
    "serial",
    "device",
    "other_device",
    "lag_s",
    "ranges",
    "head_temperature",
    "board_temperature",
    "received",
    "compensated",
    "gaps",
    "missing",
    "repeats",
    "sessions",
    "transport_errors",
    "waits_for_table",
    "flagged",
    "reloads",
    "refusals",
    "last_reload_error",
    "refused_unix_s",
    "refused_table",
    "table_changes",
    "table_kept",
    "keep_error",
    "anchor",
    "anchor_changes",
    "latency_ns",
    "latency_second_ns",
    "latency_minute_ns",
    "latency_distribution",
];

fn keys(object: &Value) -> BTreeSet<&str> {
    object.as_object().unwrap().keys().map(String::as_str).collect()
}

/// The lines of `isotherm status` about an IMU.
fn described(domain: &TestDomain, imu: &str) -> String {
    let status = domain.run_ok(&["status"]);
    let (_, rest) = status.split_once(&format!("\n{imu}\n")).unwrap();
    rest.split("\n\n").next().unwrap().to_owned()
}

#[test]
fn the_status_has_gyroscopes_only_where_the_table_has_them() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    domain.write("imu-g.toml", WHOLE_TABLE);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-g=imu-g.toml"]);
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    let sample = completed(&whole_recording(1), 240_000_000_000, "")[0];
    round_trip(&mut domain.acquisition("imu-g"), &sample);
    wait_until("both samples", || {
        let status = domain.status();
        [0, 1].iter().all(|imu| status["imus"][*imu]["received"] == 1)
    });
    let status = domain.status();
    let (plain, whole) = (&status["imus"][0], &status["imus"][1]);

    let mut expected: BTreeSet<_> = KEYS.into_iter().chain(["acquisition_connected", "readers", "closed"]).collect();
    assert_eq!(keys(plain), expected);
    assert!(["serial", "device", "other_device", "lag_s"].iter().all(|key| plain[key].is_null()), "{plain}");
    let named = |bits: &dyn Fn(u32) -> bool| {
        Flags::NAMES.into_iter().filter(|(bit, _)| bits(*bit)).map(|(_, name)| name).collect::<BTreeSet<_>>()
    };
    assert_eq!(keys(&plain["flagged"]), named(&|bit| bit < 21 || (24..=27).contains(&bit)));
    let text = described(&domain, "imu-a");
    assert!(!["  lag", "  G1", "UNIT"].iter().any(|part| text.contains(part)), "{text}");

    expected.insert("gyroscopes");
    assert_eq!(keys(whole), expected);
    assert_eq!(whole["lag_s"], 240.0);
    // The table has no serial number and no nominal interval.
    assert_eq!(keys(&whole["flagged"]), named(&|bit| ![22, 50].contains(&bit)));
    let gyroscopes = &whole["gyroscopes"];
    assert_eq!(gyroscopes["head_temperature"], json!(sample.gyroscopes.head_temperature));
    assert_eq!(gyroscopes["board_temperature"], json!(sample.gyroscopes.board_temperature));
    let range = [[0.9, 4.2]; 3];
    assert_eq!(gyroscopes["ranges"], json!({"unit": "V", "head": range, "board": range}));
    assert_eq!(whole["head_temperature"], json!(sample.accelerometers.head_temperature));
    let text = described(&domain, "imu-g");
    for line in ["  lag          240 s", "  G1           head 1.4000 in 0.9 .. 4.2 V, board 1.3900 in 0.9 .. 4.2 V"] {
        assert!(text.lines().any(|found| found == line), "no {line:?} in\n{text}");
    }

    // A table of format 1 takes all of it away again.
    let plain = TABLE.replace("\"imu-a\"", "\"imu-g\"");
    domain.accept("imu-g", &plain);
    domain.replace("imu-g.toml", &plain);
    wait_until("the other table", || domain.status()["imus"][1]["lag_s"].is_null());
    let status = domain.status();
    expected.remove("gyroscopes");
    assert_eq!(keys(&status["imus"][1]), expected);
    assert_eq!(keys(&status["imus"][1]["flagged"]), keys(&status["imus"][0]["flagged"]));
    service.terminate();
}

#[test]
fn samples_without_gyroscopes_give_no_angles_under_a_table_that_has_them() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let whole = completed(&whole_recording(1), 240_000_000_000, "")[0];
    let mut acquisition = domain.acquisition("imu-g");
    let expected = round_trip(&mut acquisition, &whole);
    assert!(expected.angle_increment.iter().all(|angle| angle.is_finite()));
    let bare = RawSample { sequence: 1, gyroscopes: RawSample::default().gyroscopes, ..whole };
    let increment = round_trip(&mut acquisition, &bare);
    assert!(increment.angle_increment.iter().all(|angle| angle.is_nan()), "{increment:?}");
    let absent = (0..3).map(|axis| Flags::not_finite(axis).of_gyroscopes()).fold(Flags(0), |all, flag| all | flag);
    assert_eq!(Flags(increment.flags).only(Flags::SAMPLE), Flags(expected.flags).only(Flags::SAMPLE) | absent);
    assert_eq!(increment.velocity_increment, expected.velocity_increment);
    service.terminate();
}

#[test]
fn gyroscopes_that_the_table_lacks_are_logged_once_a_session_and_table() {
    const LOGGED: &str = "the samples have gyroscopes, but the table has none";
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let uptime = || domain.status()["uptime_s"].as_f64().unwrap();
    let send_for_two_seconds = |acquisition: &mut Acquisition, sample: &RawSample| {
        let before = uptime();
        wait_until("two seconds", || {
            round_trip(acquisition, sample);
            uptime() > before + 2.0
        });
    };
    send_for_two_seconds(&mut acquisition, &recording()[0]);
    assert_eq!(service.count_in_log(LOGGED), 0, "{}", service.log());
    let whole = RawSample { gyroscopes: whole_recording(1)[0].gyroscopes, ..recording()[0] };
    send_for_two_seconds(&mut acquisition, &whole);
    assert_eq!(service.count_in_log(LOGGED), 1, "{}", service.log());
    service.terminate();
}

#[test]
fn samples_of_another_device_are_logged_once_a_session_and_table() {
    const LOGGED: &str = "the samples are of another device than the table";
    let with_serial = |serial: &str| TABLE.replace("id = \"imu-a\"", &format!("id = \"imu-a\"\nserial = \"{serial}\""));
    let domain = TestDomain::new();
    domain.write("imu-a.toml", &with_serial("SN 1"));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let other_device = || domain.imu_status()["other_device"].clone();
    let of_unit = |serial: &str| RawSample { device: device(serial), ..recording()[0] };
    let mut acquisition = domain.acquisition("imu-a");
    // Samples of the table's unit and of an unknown one are right.
    for sample in [of_unit("SN 1"), of_unit("")] {
        assert_eq!(round_trip(&mut acquisition, &sample).flags & Flags::OTHER_DEVICE.0, 0);
    }
    assert_eq!((other_device(), service.count_in_log(LOGGED)), (Value::Null, 0));
    assert_eq!(domain.imu_status()["device"], format!("{:016x}", device("SN 1")));

    for _ in 0..100 {
        let increment = round_trip(&mut acquisition, &of_unit("SN 2"));
        assert!(Flags(increment.flags).intersects(Flags::OTHER_DEVICE));
        assert!(increment.velocity_increment.iter().all(|dv| dv.is_finite()), "it is computed");
    }
    service.wait_for_log_lines(LOGGED, 1);
    let number = format!("{:016x}", device("SN 2"));
    assert_eq!(other_device(), number);
    assert_eq!(domain.imu_status()["flagged"]["other-device"], 100);
    let line = format!("  OTHER DEVICE the samples are of device {number}, the table of {:016x}", device("SN 1"));
    assert!(described(&domain, "imu-a").contains(&line), "{}", described(&domain, "imu-a"));
    let log = service.log();
    let logged = log.lines().find(|line| line.contains(LOGGED)).unwrap();
    assert!(logged.contains(&number) && logged.contains("SN 1"), "{logged}");

    // The control thread looks once a second: after two of its seconds it has seen these samples, and said nothing
    // more.
    let uptime = || domain.status()["uptime_s"].as_f64().unwrap();
    let before = uptime();
    wait_until("two more seconds", || {
        round_trip(&mut acquisition, &of_unit("SN 2"));
        uptime() > before + 2.0
    });
    assert_eq!(service.count_in_log(LOGGED), 1, "{}", service.log());

    // Another table, still of another device.
    domain.replace("imu-a.toml", &with_serial("SN 3"));
    wait_until("the table", || domain.imu_status()["device"] == format!("{:016x}", device("SN 3")));
    // The samples of before were answered with the table of before.
    let status = domain.imu_status();
    assert_eq!((&status["other_device"], &status["flagged"]["other-device"]), (&Value::Null, &0.into()), "{status}");
    round_trip(&mut acquisition, &of_unit("SN 2"));
    service.wait_for_log_lines(LOGGED, 2);
    assert_eq!(domain.imu_status()["flagged"]["other-device"], 1);
    let log = service.log();
    assert_eq!(log.lines().filter(|line| line.contains(LOGGED) && line.contains("SN 3")).count(), 1, "{log}");
    // Another session.
    drop(acquisition);
    let mut acquisition = domain.acquisition("imu-a");
    round_trip(&mut acquisition, &of_unit("SN 2"));
    service.wait_for_log_lines(LOGGED, 3);
    // The right table: nothing is said of it, and the status forgets the other unit.
    domain.replace("imu-a.toml", &with_serial(" SN 2\\t"));
    wait_until("the right table", || other_device().is_null());
    assert_eq!(round_trip(&mut acquisition, &of_unit("SN 2")).flags & Flags::OTHER_DEVICE.0, 0);
    service.terminate();
    domain.run_ok(&["check", "imu-a.toml"]);
}

/// The payload of raw streams in version 1, for its name and size.
#[derive(Clone, Copy, Debug, Default, ZeroCopySend)]
#[repr(C)]
#[type_name("isotherm.RawSample.v1")]
struct RawSampleV1([u64; 15]);

#[test]
fn a_stream_of_another_version_is_named() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let node = join(domain.client_domain()).unwrap();
    // A reader of version 1 that has survived its service.
    let raw = node.service_builder(&raw_name(&id("imu-a"))).publish_subscribe::<RawSampleV1>().create().unwrap();
    let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(69), "{message}");
    for part in [
        "creating the raw stream of IMU imu-a: ",
        "another version of Isotherm",
        "isotherm.RawSample.v1",
        "stop all processes",
    ] {
        assert!(message.contains(part), "no {part:?} in {message}");
    }
    drop(raw);
    // A service of version 1: no client waits for it to change.
    let raw = node.service_builder(&raw_name(&id("imu-a"))).publish_subscribe::<RawSampleV1>().create().unwrap();
    let increments =
        node.service_builder(&increment_name(&id("imu-a"))).publish_subscribe::<RawSampleV1>().create().unwrap();
    let feed = ["feed", "--imu", "imu-a", RUN];
    let record = ["record", "--imu", "imu-a", "--stream", "increment", "-o", "file.csv"];
    for (command, stream) in [(feed.as_slice(), "raw"), (&record, "increment")] {
        let output = domain.run(command);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(69), "{message}");
        for part in
            [&format!("stream isotherm/imu-a/{stream} "), "another version of Isotherm", "isotherm.RawSample.v1"]
        {
            assert!(message.contains(part), "no {part:?} in {message}");
        }
    }
    drop((raw, increments));
    let service = domain.serve_recording();
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    service.terminate();
}
