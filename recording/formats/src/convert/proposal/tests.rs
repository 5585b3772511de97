//! Mappings of texts of many programs.

use super::*;
use crate::convert::mapping::{Mapping, RowTimes, TimeUnit};
use crate::convert::{ColumnRef, Linear, Temperature};

fn proposal(text: &str) -> Result<String, RecordingError> {
    let (opening, source) = TextOpening::read(Box::new(std::io::Cursor::new(text.to_owned())), 0)?;
    ProposedMapping::of(&opening, source, 0, Path::new("in.csv"), None).map(|proposed| proposed.text)
}

/// A mapping in which nothing is open.
fn complete(text: &str) -> (String, Mapping) {
    let proposal = proposal(text).unwrap();
    let mapping = Mapping::from_toml(&proposal).unwrap_or_else(|faults| panic!("{faults}\n{proposal}"));
    (proposal, mapping)
}

/// The mapping of a text that leaves these keys open.
fn open(text: &str, keys: &[&str]) -> String {
    let proposal = proposal(text).unwrap();
    let faults = Mapping::from_toml(&proposal).unwrap_err();
    let found: Vec<_> = faults.0.iter().map(|fault| fault.key.as_str()).collect();
    assert_eq!(found, keys, "{faults}\n{proposal}");
    assert!(faults.0.iter().all(|fault| fault.message.contains('?')), "{faults}");
    proposal
}

fn name(name: &str) -> ColumnRef {
    ColumnRef::Name(name.to_owned())
}

#[test]
fn the_columns_of_many_programs_are_known_by_their_names() {
    for header in [
        "time_s,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps",
        "Timestamp (s),AccX (g),AccY (g),AccZ (g),GyroX (deg/s),GyroY (deg/s),GyroZ (deg/s)",
        "t [s],accel_x [m/s^2],accel_y [m/s^2],accel_z [m/s^2],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s]",
        "stamp.sec,linear_acceleration.x (m/s2),linear_acceleration.y,linear_acceleration.z,angular_velocity.x (rad/s),angular_velocity.y,angular_velocity.z",
        "seconds,acc_1 [mg],acc_2 [mg],acc_3 [mg],rate_1 [mdps],rate_2,rate_3",
        "sec,accx(g),accy,accz,wx(rad/s),wy,wz",
    ] {
        let (proposal, mapping) = complete(&format!("{header}\n0.01,1.5,2,3,4,5,6.5\n0.02,1,2,3,4,5,6\n"));
        let names: Vec<_> = header.split(',').map(name).collect();
        let time = RowTimes { column: Some((names[0].clone(), TimeUnit::Power(9))), ..RowTimes::default() };
        assert_eq!(mapping.time, time, "{proposal}");
        assert_eq!(mapping.accelerometer.columns, names[1..4], "{proposal}");
        assert_eq!(mapping.gyroscope.unwrap().columns, names[4..], "{proposal}");
        assert_eq!(mapping.temperature, Temperature::Constant(25.0));
        // One pulse is finer than noise, and no range of an IMU is too large for it.
        let resolution = if header.contains("[mg]") { 1e-3 } else { 1e-6 };
        assert_eq!(mapping.accelerometer.resolution, Some(resolution), "{proposal}");
    }
}

#[test]
fn what_nothing_says_is_left_open() {
    // A text without a header: nothing distinguishes its columns.
    let proposal = open(
        "1000\t1\t-2\t3\t4\t5\t6\n2000\t1\t2\t3\t4\t5\t6\n",
        &["time.interval_s", "accelerometer.columns", "accelerometer.unit"],
    );
    assert!(proposal.contains("header = false") && !proposal.contains("gyroscope"), "{proposal}");
    assert!(proposal.contains("# three of 1, 2, 3, 4, 5, 6, 7\n"), "{proposal}");
    let proposal = open("u,v,w,q\n1,2,3,4\n", &["time.interval_s", "accelerometer.columns", "accelerometer.unit"]);
    assert!(proposal.contains("# three of \"u\", \"v\", \"w\", \"q\""), "{proposal}");
    open("t [s],x,y,z\n1,0.5,0.1,9.8\n2,0.5,0.1,9.8\n", &["accelerometer.columns", "accelerometer.unit"]);
    // A number of a packet is no time, and a magnetometer in G is none in g.
    let text = "Packet number,Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g),Magnetometer X (G)\n\
                115,-0.0092,0.011,1.05,0.3\n117,0.013,-0.022,0.953,0.18\n";
    let proposal = open(text, &["time.interval_s"]);
    let given = Mapping::with_interval(&proposal, Some(3_906_250)).unwrap();
    assert_eq!((given.time.interval_ns, given.gyroscope), (Some(3_906_250), None));
    let proposal = open("t [s],ax (ft/s2),ay,az\n0.01,0.1,0.2,32.3\n0.02,0.1,0.2,32.3\n", &["accelerometer.unit"]);
    assert!(proposal.contains("the header says \"ft/s2\""), "{proposal}");
    open("t,ax,ay,az\n0.01,0.1,0.2,9.81\n0.02,0.1,0.2,9.81\n", &["time.unit", "accelerometer.unit"]);
    // Whole numbers may be counts of any kind, of any digital zero.
    open("t_ms,ax,ay,az\n10,1,2,300\n20,1,2,300\n", &["accelerometer.kind"]);
    open(
        "t_ms,ax,ay,az\n10,32768,32000,33000\n20,32768,32000,33000\n",
        &["accelerometer.kind", "accelerometer.offset"],
    );
}

#[test]
fn of_several_columns_that_may_be_the_same_none_is_taken() {
    let rows = "1,1,0.5,0.25,9.8,0.1,0.2,9.7\n2,2,0.5,0.25,9.8,0.1,0.2,9.7\n";
    let header = "time_s,stamp_s,accel_x_g,accel_y_g,accel_z_g,acc_x_g,acc_y_g,acc_z_g";
    let proposal = open(
        &format!("{header}\n{rows}"),
        &["time.column", "time.unit", "accelerometer.columns", "accelerometer.unit"],
    );
    assert!(proposal.contains("# one of \"time_s\", \"stamp_s\"\n"), "{proposal}");
    assert!(proposal.contains("three of \"accel_x_g\", \"accel_y_g\", \"accel_z_g\", \"acc_x_g\""), "{proposal}");
    // The only one of the times that says its unit is taken.
    let (_, mapping) = complete(&format!("{}\n{rows}", header.replace("stamp_s", "stamp").replace(",acc_", ",b_")));
    assert_eq!(mapping.time.column, Some((name("time_s"), TimeUnit::Power(9))));
}

/// The time and the temperature of a text.
fn time_and_temperature(text: &str) -> (Option<(ColumnRef, TimeUnit)>, Temperature) {
    let (_, mapping) = complete(text);
    (mapping.time.column, mapping.temperature)
}

#[test]
fn the_time_and_the_temperature_are_those_of_the_names() {
    let one = |column: &str, linear| {
        let columns = vec![name(column)];
        Temperature::Columns { head: columns.clone(), board: columns, linear }
    };
    for (text, time, temperature) in [
        ("T,time_s,ax_g,ay,az\n25.1,1,2,3,4\n25.0,1.01,2,3,4\n", "time_s", one("T", None)),
        ("T,t [s],ax_g,ay,az\n25.1,1,2,3,4\n25.0,1.01,2,3,4\n", "t [s]", one("T", None)),
        ("t [s],ax_g,ay,az,T [degC]\n1,2,3,4,25.1\n1.01,2,3,4,25.2\n", "t [s]", one("T [degC]", None)),
        (
            "t [s],ax_g,ay,az,temp (K)\n1,2,3,4,283.1\n1.01,2,3,4,283.2\n",
            "t [s]",
            one("temp (K)", Some(Linear { scale: 1.0, offset: -273.15 })),
        ),
    ] {
        assert_eq!(time_and_temperature(text), (Some((name(time), TimeUnit::Power(9))), temperature), "{text}");
    }
    // A calendar needs no unit.
    for row in ["2026-05-01T12:00:00.00Z,2,3,4\n2026-05-01T12:00:00.01Z,2,3,4\n", "23:59:59.99,2,3,4\n00:00:00,2,3,4\n"]
    {
        let (time, _) = time_and_temperature(&format!("when,ax_g,ay,az\n{row}"));
        assert_eq!(time, Some((name("when"), TimeUnit::Iso8601)));
    }
    // The temperatures of both sensors, and none of the barometer.
    let (_, found) = time_and_temperature(
        "t_s,acc_x_g,acc_y,acc_z,gyr_x_dps,gyr_y,gyr_z,baro_temp,acc_temp,gyr_temp\n1,2.5,3,4,5,6,7.5,8,21,22\n",
    );
    let Temperature::Columns { head, .. } = found else { panic!("{found:?}") };
    assert_eq!(head, ["acc_temp", "acc_temp", "acc_temp", "gyr_temp", "gyr_temp", "gyr_temp"].map(name));
    for other in ["temp1,temp2", "baro_temp,t_cpu_temp"] {
        open(&format!("t_s,ax_g,ay,az,{other}\n1,2,3,4,25,26\n2,2,3,4,25,26\n"), &["temperature.columns"]);
    }
    // Numbers that are no degrees Celsius.
    let text = "t_s,ax_g,ay,az,temp\n0.01,0.1,0.2,9.81,-17520\n0.02,0.1,0.2,9.81,-17500\n";
    open(text, &["temperature.scale", "temperature.offset"]);
}

#[test]
fn a_row_with_a_damaged_field_is_not_taken_for_the_names() {
    let (_, mapping) = complete("t_s,ax_g,ay,az\n1,ERR,0.5,9.8\n1.01,0.25,0.5,9.8\n1.02,0.25,0.5,9.8\n");
    assert_eq!(mapping.accelerometer.columns, ["ax_g", "ay", "az"].map(name));
    // Axes may be called by numbers.
    let proposal = open("t_s,1,2,3\n1,0.25,0.5,9.8\n", &["accelerometer.columns", "accelerometer.unit"]);
    assert!(proposal.contains("# three of \"1\", \"2\", \"3\"\n"), "{proposal}");
}

#[test]
fn names_are_quoted_as_toml_and_for_a_terminal() {
    let text = "t_s,a\u{1b}[2J x,a\\y,\"a \"\"z\"\"\"\n1,1,2,3\n2,1,2,3\n";
    let proposal = open(text, &["accelerometer.columns", "accelerometer.unit"]);
    assert!(matches!(printable(&proposal), Cow::Borrowed(_)), "{proposal}");
    assert!(proposal.contains(r#""a\U0000001B[2J x", "a\\y", "a \"z\"""#), "{proposal}");
}

#[test]
fn what_is_no_table_gets_no_mapping() {
    for text in ["a\nb\n", "", "one,two\n1,2\n"] {
        assert!(proposal(text).unwrap_err().to_string().contains("this is not a table of numbers"), "{text:?}");
    }
    let commas = "t,ax,ay,az\n0,01,0,5,-0,25,9,81\n0,02,0,5,-0,25,9,82\n";
    let refused = proposal(commas).unwrap_err().to_string();
    assert!(refused.contains("are decimal marks as well"), "{refused}");
    // In quotation marks, or between semicolons, they are clear.
    for clear in ["t [s],ax_g,ay,az\n\"0,01\",\"0,5\",\"-0,25\",1\n", "t [s];ax_g;ay;az\n0,01;0,5;-0,25;9,81\n"] {
        assert_eq!(complete(clear).1.time.column, Some((name("t [s]"), TimeUnit::Power(9))));
    }
}
