//! Proposals for texts of many programs.

use super::*;
use crate::convert::mapping::{Decimal, Mapping, TimeUnit};
use crate::convert::text::proposal;
use crate::convert::{ColumnRef, RowTimes, Temperature};

fn proposed(text: &'static str) -> (String, Mapping) {
    let rows = Box::new(text.as_bytes()) as Box<dyn Read>;
    let proposal = proposal(rows).unwrap();
    let mapping = Mapping::from_toml(&proposal).unwrap_or_else(|faults| panic!("{faults}\n{proposal}"));
    (proposal, mapping)
}

#[test]
fn the_columns_of_many_programs_are_recognised() {
    for header in [
        "time_s,ax_counts,ay_counts,az_counts,gx_counts,gy_counts,gz_counts",
        "Timestamp,AccX,AccY,AccZ,GyroX,GyroY,GyroZ",
        "t [s],accel_x [m/s^2],accel_y [m/s^2],accel_z [m/s^2],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s]",
        "header.stamp,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,angular_velocity.x,angular_velocity.y,angular_velocity.z",
        "seconds,acc_1 [m/s^2],acc_2 [m/s^2],acc_3 [m/s^2],rate_1,rate_2,rate_3",
        "sec,accx,accy,accz,wx,wy,wz",
    ] {
        let text = format!("{header}\n0.01,1.5,2,3,4,5,6.5\n0.02,1,2,3,4,5,6\n");
        let (proposal, mapping) = proposed(text.leak());
        let names: Vec<_> = header.split(',').map(|name| ColumnRef::Name(name.to_owned())).collect();
        assert_eq!(mapping.time.column, Some((names[0].clone(), TimeUnit::Power(9))), "{proposal}");
        assert_eq!(mapping.time.interval_ns, Some(10_000_000));
        assert_eq!(mapping.accelerometer.columns, names[1..4], "{proposal}");
        assert_eq!(mapping.gyroscope.unwrap().columns, names[4..], "{proposal}");
        assert_eq!((mapping.accelerometer.resolution, mapping.temperature), (Some(1e-6), Temperature::Constant(25.0)));
    }
}

#[test]
fn units_offsets_decimal_commas_and_temperatures_are_found() {
    let (proposal, mapping) = proposed(
        "# made by a logger\ntime_ms;AX;AY;AZ;Temp;note\n10;32768;32000;33000;25,5;1\n20;32768;32000;33000;25,6;1\n",
    );
    assert_eq!(mapping.time.column, Some((ColumnRef::Name("time_ms".to_owned()), TimeUnit::Power(6))), "{proposal}");
    assert_eq!((mapping.skip, mapping.decimal, mapping.time.interval_ns), (1, Some(Decimal::Comma), Some(10_000_000)));
    assert_eq!((mapping.accelerometer.offset, mapping.accelerometer.resolution), (32768.0, Some(1.0)));
    let temp = vec![ColumnRef::Name("Temp".to_owned())];
    assert_eq!(mapping.temperature, Temperature::Columns { head: temp.clone(), board: temp, linear: None });
    assert_eq!(mapping.gyroscope, None);
}

/// The proposal for a text, which leaves these keys open.
fn open(text: &'static str, keys: &[&str]) -> String {
    let rows = Box::new(text.as_bytes()) as Box<dyn Read>;
    let proposal = proposal(rows).unwrap();
    let faults = Mapping::from_toml(&proposal).unwrap_err();
    let found: Vec<_> = faults.0.iter().map(|fault| fault.key.as_str()).collect();
    assert_eq!(found, keys, "{faults}\n{proposal}");
    assert!(faults.0.iter().all(|fault| fault.message.contains('?')), "{faults}");
    proposal
}

#[test]
fn what_nothing_says_is_left_open() {
    // Counts of a text without a header: nothing distinguishes accelerometers from gyroscopes.
    let proposal = open("1000\t1\t-2\t3\t4\t5\t6\n2000\t1\t2\t3\t4\t5\t6\n", &["accelerometer.columns"]);
    assert!(proposal.contains("header = false") && proposal.contains("column = 1\n"), "{proposal}");
    assert!(proposal.contains("# three of 2, 3, 4, 5, 6, 7\n") && !proposal.contains("gyroscope"), "{proposal}");
    let proposal = open("u,v,w,q\n1,2,3,4\n", &["time.interval_s", "accelerometer.columns"]);
    assert!(proposal.contains("# three of \"u\", \"v\", \"w\", \"q\""), "{proposal}");
    // A number of a packet is no time, and a magnetometer in G is none in g.
    let text = "Packet number,Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g),Magnetometer X (G)\n\
                115,-0.0092,0.011,1.05,0.3\n117,0.013,-0.022,0.953,0.18\n";
    let proposal = open(text, &["time.interval_s"]);
    assert!(proposal.contains("unit = \"g\"                      # as the header says"), "{proposal}");
    let given = Mapping::with_interval(&proposal, Some(3_906_250)).unwrap();
    assert_eq!((given.time.interval_ns, given.gyroscope), (Some(3_906_250), None));
    let text = "t,ax (ft/s2),ay,az\n0.01,0.1,0.2,32.3\n0.02,0.1,0.2,32.3\n";
    assert!(open(text, &["accelerometer.unit"]).contains("the header says \"ft/s2\""));
    let text = "t,ax,ay,az,temp\n0.01,0.1,0.2,9.81,-17520\n0.02,0.1,0.2,9.81,-17500\n";
    let proposal = open(text, &["temperature.scale", "temperature.offset"]);
    assert!(proposal.contains("0.00294117647, offset = 36.53"), "{proposal}");
}

#[test]
fn units_of_headers_and_rates_above_them_are_used() {
    let (proposal, mapping) = proposed(
        "// Start RowTimes: 0\n// Sample rate: 120.0Hz\nCounter\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\n\
         37328\t-9.4\t-1.29\t-1.9\t-0.011\t0.008\t-0.01\n37329\t-9.58\t-1.08\t-1.72\t-0.022\t-0.0003\t0.013\n",
    );
    assert_eq!(
        (mapping.skip, mapping.time),
        (2, RowTimes { interval_ns: Some(8_333_333), ..RowTimes::default() }),
        "{proposal}"
    );
    assert!(proposal.contains("# nominal, as the text says: \"// Sample rate: 120.0Hz\""), "{proposal}");
    let (proposal, mapping) = proposed(
        "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (mg),Accelerometer Y (mg),\
         Accelerometer Z (mg),Temperature (K)\n0,0.0808,-0.051,0.0513,1.26,-1.11,1000.07,283.15\n\
         1,0.0348,-0.1087,0.054,2.19,0.56,999.1,283.22\n",
    );
    let gyroscope = mapping.gyroscope.unwrap();
    assert_eq!(mapping.accelerometer.unit, Some(9.80665e-3), "{proposal}");
    assert_eq!((gyroscope.unit, gyroscope.resolution), (Some(1f64.to_radians()), Some(1e-6)), "{proposal}");
    let Temperature::Columns { linear: Some(linear), .. } = mapping.temperature else { panic!("{proposal}") };
    assert_eq!((linear.scale, linear.offset), (1.0, -273.15));
    // Without a name the magnitude of gravity decides; x, y, z are in the order of the axes.
    let (proposal, mapping) = proposed(
        "time,seconds_elapsed,z,y,x\n1700000000000000000,0.005,9.79,-0.1,0.2\n\
                                        1700000000005000000,0.01,9.8,-0.11,0.21\n",
    );
    let name = |name: &str| ColumnRef::Name(name.to_owned());
    assert_eq!(mapping.accelerometer.columns, ["x", "y", "z"].map(name), "{proposal}");
    assert_eq!(mapping.time.column, Some((name("seconds_elapsed"), TimeUnit::Power(9))), "{proposal}");
    let sentence =
        "$VNYMR,+170.786,-005.153,+009.880,-00.1957,+00.2218,+00.6401,-00.952,-02.181,-09.575,-00.07,+00.62,-01.2\n";
    let proposal = open(format!("{sentence}{sentence}").leak(), &["time.interval_s"]);
    assert!(proposal.contains("header = false") && proposal.contains("columns = [8, 9, 10]"), "{proposal}");
    // The temperatures of both sensors, and none of the barometer.
    let (proposal, mapping) = proposed(
        "t,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z,baro_temp,acc_temp,gyr_temp\n1,2.5,3,4,5,6,7.5,8,21,22\n2,2,3,4,5,6,7.5,8,21,22\n",
    );
    let Temperature::Columns { head, .. } = mapping.temperature else { panic!("{proposal}") };
    assert_eq!(head, ["acc_temp", "acc_temp", "acc_temp", "gyr_temp", "gyr_temp", "gyr_temp"].map(name));
}

/// The unit of the time, its line, and the temperature.
fn time_and_temperature(text: &'static str) -> (ColumnRef, TimeUnit, String, Temperature) {
    let (proposal, mapping) = proposed(text);
    let (column, unit) = mapping.time.column.unwrap_or_else(|| panic!("{proposal}"));
    let line = proposal.lines().find(|line| line.starts_with("unit")).unwrap_or_default().to_owned();
    (column, unit, line, mapping.temperature)
}

#[test]
fn t_beside_a_time_is_the_temperature() {
    let name = |name: &str| ColumnRef::Name(name.to_owned());
    for (text, time, temperature) in [
        ("T,time_s,ax,ay,az\n25.1,1,2,3,4\n25.0,1.01,2,3,4\n", "time_s", "T"),
        ("timestamp,ax,ay,az,T\n1,2,3,4,25.1\n1.01,2,3,4,25.2\n", "timestamp", "T"),
        ("T,t,ax,ay,az\n25.1,1,2,3,4\n25.0,1.01,2,3,4\n", "t", "T"),
        ("t,ax,ay,az,T [degC]\n1,2,3,4,25.1\n1.01,2,3,4,25.2\n", "t", "T [degC]"),
    ] {
        let (column, _, _, found) = time_and_temperature(text);
        let columns = vec![name(temperature)];
        assert_eq!(
            (column, found),
            (name(time), Temperature::Columns { head: columns.clone(), board: columns, linear: None })
        );
    }
    // Only what is missing is a constant.
    let (_, _, _, two) = time_and_temperature("t,ax,ay,az,temp1,temp2\n1,2,3,4,5,6\n2,2,3,4,5,6\n");
    assert_eq!(two, Temperature::Columns { head: vec![name("temp1")], board: vec![name("temp1")], linear: None });
    let (_, _, _, none) = time_and_temperature("T,ax,ay,az\n1,2,3,4\n2,2,3,4\n");
    assert_eq!(none, Temperature::Constant(25.0));
}

#[test]
fn a_unit_by_size_is_called_a_guess_and_a_calendar_is_found() {
    for (text, unit, guess) in [
        ("timestamp,ax,ay,az\n1000,2,3,4\n1010,2,3,4\n", TimeUnit::Power(6), "# a guess, rows are 0.01 s apart then"),
        ("stamp,ax,ay,az\n1700000000123,2,3,4\n1700000000133,2,3,4\n", TimeUnit::Power(6), "a time since 1970"),
        ("stamp,ax,ay,az\n1700000000123000,2,3,4\n1700000000133000,2,3,4\n", TimeUnit::Power(3), "since 1970"),
        ("time_us,ax,ay,az\n1000,2,3,4\n11000,2,3,4\n", TimeUnit::Power(3), ""),
        ("when,ax,ay,az\n2026-05-01T12:00:00.00Z,2,3,4\n2026-05-01T12:00:00.01Z,2,3,4\n", TimeUnit::Iso8601, ""),
        ("clock;ax;ay;az\n23:59:59,990;2;3;4\n00:00:00,000;2;3;4\n", TimeUnit::Iso8601, ""),
    ] {
        let (_, found, line, _) = time_and_temperature(text);
        assert!(found == unit && line.contains(guess) && line.contains("guess") != guess.is_empty(), "{line}");
    }
}

#[test]
fn names_are_quoted_as_toml_and_for_a_terminal() {
    let text = "t,a\u{1b}[2J x,a\\y,\"a \"\"z\"\"\"\n1,1,2,3\n2,1,2,3\n";
    let proposal = open(text, &["accelerometer.columns"]);
    assert!(matches!(printable(&proposal), Cow::Borrowed(_)), "{proposal}");
    assert!(proposal.contains(r#""a\U0000001B[2J x", "a\\y", "a \"z\"""#), "{proposal}");
}

#[test]
fn what_is_no_table_gets_no_proposal() {
    for text in ["a\nb\n", "", "one,two\n1,2\n"] {
        let rows = Box::new(text.as_bytes()) as Box<dyn Read>;
        assert!(proposal(rows).unwrap_err().to_string().contains("this is not a table of numbers"), "{text:?}");
    }
}
