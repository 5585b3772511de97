//! Layouts of texts that need no mapping.

use crate::convert_ros::{Bag, imu};
use crate::foreign::Files;
use isotherm_files::source;
use isotherm_recording_formats::convert::{Conversion, Scale, Settings};
use isotherm_recording_formats::ros::ImuMessage;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;

const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Accelerations \[m/s2\] and rates \[rad/s\] of all rows.
const FORCE: [f64; 3] = [0.213, -0.117, 9.791];
const RATES: [f64; 3] = [0.0117, -0.0231, 0.0319];

/// Samples, scale and what is reported.
struct Told {
    samples: Vec<RawSample>,
    scale: Result<Scale, String>,
    notes: String,
    findings: String,
}

fn convert_named(name: &str, text: &str) -> Result<Told, Failure> {
    let mut conversion =
        Conversion::of_text(Path::new(name), Cursor::new(text.to_owned()), None, &Settings::default())?;
    let samples = conversion.by_ref().collect::<Result<Vec<_>, _>>()?;
    let findings = conversion.findings().iter().map(|it| format!("[{}]: {it}\n", it.name)).collect();
    Ok(Told { samples, scale: conversion.scale(), notes: conversion.notes().join("\n"), findings })
}

fn convert(text: &str) -> Told {
    let told = convert_named("in.csv", text).unwrap_or_else(|failure| panic!("{failure}"));
    // The mapping that is printed gives the same samples.
    let mapping = told.notes.split_once("\n\n").unwrap().1.split("\n\n").next().unwrap();
    let named = Some((Path::new("m.toml"), mapping));
    let saved = Conversion::of_text(Path::new("in.csv"), Cursor::new(text.to_owned()), named, &Settings::default());
    let saved: Vec<_> = saved.unwrap_or_else(|failure| panic!("{failure}\n{mapping}")).map(Result::unwrap).collect();
    assert!(saved == told.samples, "{mapping}");
    told
}

/// Readings of accelerometers and gyroscopes in m/s2 and rad/s.
fn readings(told: &Told, row: usize) -> [f64; 6] {
    let (sample, scale) = (&told.samples[row], told.scale.as_ref().unwrap());
    let net = |axis: usize| {
        let (triad, axis) = if axis < 3 { (&sample.accelerometers, axis) } else { (&sample.gyroscopes, axis - 3) };
        f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis])
    };
    let of = [scale.resolution.accelerometer, scale.resolution.gyroscope];
    std::array::from_fn(|axis| net(axis) * of[axis / 3])
}

fn assert_readings(told: &Told, gyroscopes: bool) {
    let right = FORCE.into_iter().chain(if gyroscopes { RATES } else { [0.0; 3] });
    for (found, right) in readings(told, 1).into_iter().zip(right) {
        assert!((found - right).abs() < 1e-4, "{found} {right}");
    }
}

fn joined<const N: usize>(values: [f64; N], factor: f64, digits: usize) -> String {
    values.map(|value| format!("{:.digits$}", value * factor)).join(",")
}

/// A text of 20 rows, 0.005 s apart, of a header and what follows the time \[ns\].
fn text(header: &str, row: impl Fn(u64) -> String) -> String {
    (0..20)
        .fold(format!("{header}\n"), |text, number| text + &row(1_403_636_579_758_555_392 + number * 5_000_000) + "\n")
}

#[test]
fn euroc_and_kalibr_are_read_as_they_are() {
    let euroc = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],\
                 a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]";
    let kalibr = "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z";
    for (name, header) in [("EuRoC", euroc), ("Kalibr's bag creator", kalibr)] {
        let row = |ns: u64| format!("{ns},{},{}", joined(RATES, 1.0, 9), joined(FORCE, 1.0, 9));
        let told = convert(&text(header, row));
        assert_readings(&told, true);
        assert_eq!((told.samples.len(), told.samples[1].timestamp_ns), (20, 1_403_636_579_763_555_392));
        assert_eq!(told.scale.unwrap().interval_ns, 5_000_000);
        assert!(told.notes.starts_with(&format!("a text as of {name}; ")), "{}", told.notes);
        assert!(told.notes.contains("unit = \"m/s2\"") && told.notes.contains("unit = \"rad/s\""), "{}", told.notes);
        assert!(told.findings.contains("[no-temperature]"), "{}", told.findings);
    }
    // Other columns next to them are another layout.
    let other = format!("{kalibr},qx");
    let other = text(&other, |ns| format!("{ns},{},{},1", joined(RATES, 1.0, 9), joined(FORCE, 1.0, 9)));
    assert_eq!(convert_named("in.csv", &other).err().unwrap().exit, Exit::Usage);
}

#[test]
fn topics_of_px4_are_read() {
    let combined = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,\
                    accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt";
    let row = |ns: u64| format!("{},{},5000,0,{},5000", ns / 1000, joined(RATES, 1.0, 6), joined(FORCE, 1.0, 6));
    let told = convert(&text(combined, row));
    assert_readings(&told, true);
    assert!(told.notes.contains("sensor_combined") && told.notes.contains("PX4 has corrected"), "{}", told.notes);

    // Sums over a time that is not that between the rows.
    let imu = "timestamp,timestamp_sample,accel_device_id,gyro_device_id,delta_angle[0],delta_angle[1],delta_angle[2],\
               delta_velocity[0],delta_velocity[1],delta_velocity[2],delta_angle_dt,delta_velocity_dt";
    let row = |ns: u64| {
        let [angles, velocities] = [joined(RATES, 0.002_497, 12), joined(FORCE, 0.002_503, 12)];
        format!("{0},{0},1,2,{angles},{velocities},2497,2503", ns / 1000)
    };
    let told = convert(&text(imu, row));
    assert_readings(&told, true);
    assert!(told.notes.contains("vehicle_imu"), "{}", told.notes);
    let none = text(imu, |ns| format!("{0},{0},1,2,0,0,0,0,0,0,0,0", ns / 1000));
    let refused = convert_named("in.csv", &none).err().unwrap();
    assert!(refused.message.contains("in.csv:2: delta_velocity_dt: the time of the sums is not over 0"), "{refused}");
}

#[test]
fn the_topics_of_one_kind_of_sensors_are_told_apart() {
    let header = "timestamp,timestamp_sample,device_id,x,y,z,temperature,error_count,clip_counter[0],clip_counter[1],\
                  clip_counter[2],samples";
    let row =
        |values| move |ns: u64| format!("{0},{0},4259850,{1},25.375,0,0,0,0,1", ns / 1000, joined(values, 1.0, 6));
    let accelerations = text(header, row(FORCE));
    for name in ["in.csv", "log_sensor_accel_0.csv"] {
        let told = convert_named(name, &accelerations).ok().unwrap();
        assert_readings(&told, false);
        assert!(
            told.samples[0].gyroscopes.is_absent() && told.samples[0].accelerometers.head_temperature == [25.375; 3]
        );
        assert!(!told.findings.contains("no-temperature") && told.notes.contains("sensor_accel"), "{}", told.notes);
    }
    for (name, text) in [("in.csv", text(header, row(RATES))), ("log_sensor_gyro_0.csv", accelerations)] {
        let refused = convert_named(name, &text).err().unwrap();
        assert_eq!(refused.exit, Exit::Data, "{refused}");
        assert!(refused.message.contains("it has only rates; give the file of the accelerometers"), "{refused}");
        assert!(refused.message.contains("--gyroscope-file"), "{refused}");
    }
}

/// Rows of an OpenLog Artemis, over midnight, with what stands above them.
fn openlog(above: &str) -> String {
    let mut text = above.to_owned();
    for row in 0..40 {
        let second = (f64::from(row) * 0.1 + 58.42) % 60.0;
        let time = if row < 16 { format!("23:59:{second:05.2}") } else { format!("00:00:{second:05.2}") };
        let [force, rates] = [joined(FORCE, 1e3 / 9.80665, 2), joined(RATES, 1.0 / DEGREE, 2)];
        let _ = write!(text, "07/01/2020,{time},{force},{rates},8.25,32.55,-63.60,{:.2},10.01\r\n", 21.25);
    }
    text
}

#[test]
fn an_openlog_artemis_is_read_with_and_without_its_header() {
    let header = "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz\r\n";
    let above =
        "SD card online\r\nData logging online\r\nSerial logging online\r\nIMU online\r\nNo Qwiic devices detected\r\n";
    // Rows may end in separators.
    let ended = openlog(above).replace(",10.01\r", ",10.01,,\r");
    for (text, columns) in
        [(openlog(header), "\"aX\", \"aY\", \"aZ\""), (openlog(above), "3, 4, 5"), (ended, "3, 4, 5")]
    {
        let told = convert(&text);
        assert_eq!(told.samples.len(), 40);
        let [a, g] = [readings(&told, 3)[2], readings(&told, 3)[5]];
        assert!((a - FORCE[2]).abs() < 6e-5 && (g - RATES[2]).abs() < 1e-4, "{a} {g}");
        assert!(told.samples.iter().all(|sample| sample.gyroscopes.head_temperature == [21.25; 3]));
        assert!(told.samples.windows(2).all(|pair| pair[1].timestamp_ns - pair[0].timestamp_ns == 100_000_000));
        let note = format!("columns = [{columns}]\nkind = \"reading\"\nunit = \"mg\"\n");
        assert!(told.notes.contains("OpenLog Artemis") && told.notes.contains(&note), "{}", told.notes);
    }
}

#[test]
fn counts_are_read_and_have_no_nominal_table() {
    // Of imu_tk, with a digital zero.
    let mut text = String::new();
    for row in 0..30_u32 {
        let counts = [33_123 + row, 33_276, 36_360 - row].map(|count| format!("{:.7e}", f64::from(count)));
        let _ = writeln!(text, "   {:.7e}   {}", f64::from(row) * 0.01 + 30.66, counts.join("   "));
    }
    let told = convert_named("xsens_acc.mat", &text).ok().unwrap();
    assert!(told.scale.is_err(), "counts stand for nothing that is known");
    assert_eq!(told.samples[2].accelerometers.positive_pulses, [357, 508, 3590]);
    assert!(told.samples[0].gyroscopes.is_absent() && told.notes.contains("imu_tk"), "{}", told.notes);
    let refused = convert_named("xsens_gyro.mat", &text).err().unwrap();
    assert!(refused.message.contains("--gyroscope-file"), "{refused}");

    // Of an Arduino.
    let arduino = |unit: &str, row: &str| text_of(&format!("{unit},ax,ay,az,gx,gy,gz,temp"), row);
    let told = convert(&arduino("micros", "120,-240,16384,-12,7,5,25.5"));
    assert_eq!((told.samples[1].timestamp_ns, told.samples.len()), (2_000_000, 30));
    assert_eq!(told.samples[0].accelerometers.negative_pulses, [0, 240, 0]);
    let why = told.scale.unwrap_err();
    assert!(why.starts_with("accelerometer: the numbers look like counts; "), "{why}");
    let [before, accelerometer, gyroscope] = &why.split("resolution = 1\n").collect::<Vec<_>>()[..] else {
        panic!("{why}")
    };
    let (_, before) = before.split_once("\n\n").unwrap();
    let filled = format!("{before}scale = 0.00059855\n{accelerometer}scale = 0.000133231\n{gyroscope}");
    let text = arduino("micros", "120,-240,16384,-12,7,5,25.5");
    let named = Some((Path::new("m.toml"), filled.as_str()));
    let mut conversion =
        Conversion::of_text(Path::new("in.csv"), Cursor::new(text), named, &Settings::default()).unwrap();
    assert_eq!(conversion.by_ref().filter(Result::is_ok).count(), 30);
    assert!((conversion.scale().unwrap().resolution.accelerometer - 0.000_598_55).abs() < 1e-12);
    // Counts of a thermometer, and readings in units that nothing says, are asked for.
    for row in ["120,-240,16384,-12,7,5,-3400", "0.12,-0.24,9.79,-1.5,0.25,1.5,25.5"] {
        let refused = convert_named("in.csv", &arduino("millis", row)).err().unwrap();
        assert_eq!(refused.exit, Exit::Usage, "{refused}");
    }
}

/// A text of 30 equal rows, 1000 apart.
fn text_of(header: &str, row: &str) -> String {
    (0..30).fold(format!("{header}\n"), |text, number| text + &format!("{},{row}\n", 1000 + number * 1000))
}

#[test]
fn messages_of_ros_in_other_units_are_told_by_a_mapping() {
    let mut bag = Bag::new();
    for number in 0..20 {
        let message = ImuMessage {
            linear_acceleration: Some(FORCE.map(|force| force / 9.80665)),
            angular_velocity: Some(RATES.map(|rate| rate / DEGREE)),
            ..imu(number)
        };
        bag.imu("/imu", &message);
    }
    let files = Files::new();
    let (bag, log) = (files.write("deg.mcap", bag.bytes()), files.write("span.log", NOVATEL));
    let units = "format = 1\n[accelerometer]\nunit = \"g\"\n[gyroscope]\nunit = \"deg/s\"\n";
    let named = Some((Path::new("m.toml"), units));
    let mut conversion = Conversion::open(&source(&bag), named, &Settings::default()).unwrap();
    let samples = conversion.by_ref().collect::<Result<Vec<_>, _>>().unwrap();
    let [notes, findings] = [conversion.notes().join("\n"), String::new()];
    assert_readings(&Told { samples, scale: conversion.scale(), notes: notes.clone(), findings }, true);
    assert!(notes.contains("the messages are in g and deg/s, as the mapping says"), "{notes}");
    let refused = Conversion::open(&source(&log), named, &Settings::default()).err().unwrap();
    assert!(refused.exit == Exit::Config && refused.message.contains("these data have their units"), "{refused}");
    let wrong = Some((Path::new("m.toml"), "format = 1\n[gyroscope]\nunit = \"g\"\n"));
    let refused = Conversion::open(&source(&bag), wrong, &Settings::default()).err().unwrap();
    assert!(refused.message.starts_with("m.toml:3: gyroscope.unit: is \"g\", give \"rad/s\" or"), "{refused}");
}

const NOVATEL: &str = "%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,607017,\
                       -1009773*1fb76c28\n";
