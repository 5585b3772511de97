//! Readings in m/s2 and rad/s: at every rate an increment has the value of the reading, whatever interval the table is
//! of, and samples that are not those of the table are invalid.

use isotherm_client::{
    Acquisition, CompensatedIncrement, ConnectError, Flags, Loan, Options, RawSample, Resolution, Triad,
};
use isotherm_shared::readings::Readings;
use isotherm_shared::table::{Nominal, nominal_table};
use isotherm_tests::{TIMEOUT, TestDomain, id, text, wait_until};
use std::fs;
use std::time::Duration;

const RESOLUTION: Resolution = Resolution { accelerometer: 1e-6, gyroscope: 1e-7 };
/// 50, 100, 187.3, 200 Hz and 1 kHz \[ns\].
const INTERVALS_NS: [u64; 5] = [20_000_000, 10_000_000, 5_339_029, 5_000_000, 1_000_000];

/// The nominal table of readings of this interval.
fn nominal(interval_ns: u64, resolution: Resolution) -> String {
    let nominal = Nominal { resolution, ..Nominal::new(id("imu-a"), interval_ns, [-40.0, 85.0]) };
    nominal_table(&nominal).unwrap().to_toml()
}

/// Puts a table in place, and accepts what it changes.
fn install(domain: &TestDomain, table: &str) {
    domain.replace("imu-a.toml", table);
    domain.accept("imu-a", table);
}

fn reading(number: u64) -> ([f64; 3], [f64; 3]) {
    let turn = (number % 97) as f64 / 7.0;
    ([0.123_456_78 + turn, -0.345_678_9 - turn, 9.801_234_56], [0.012_345_678, -turn, 7.292e-5])
}

fn connect(domain: &TestDomain, resolution: Resolution) -> Result<Acquisition, ConnectError> {
    Acquisition::connect(&id("imu-a"), &Options { resolution: Some(resolution), ..domain.options() })
}

fn set_temperature(sample: &mut RawSample) {
    for triad in [&mut sample.accelerometers, &mut sample.gyroscopes] {
        (triad.head_temperature, triad.board_temperature) = ([25.0; 3], [25.0; 3]);
    }
}

/// A sample of this reading.
fn filled(acquisition: &mut Acquisition, number: u64, interval_ns: u64) -> Loan {
    let mut sample = acquisition.loan().unwrap();
    (sample.timestamp_ns, sample.interval_ns) = ((number + 1) * interval_ns, interval_ns);
    let (force, rate) = reading(number);
    acquisition.fill(&mut sample, force, Some(rate)).unwrap();
    set_temperature(&mut sample);
    sample
}

/// Serves a period.
fn period(acquisition: &mut Acquisition, number: u64, interval_ns: u64) -> CompensatedIncrement {
    let sample = filled(acquisition, number, interval_ns);
    acquisition.compensate(sample, TIMEOUT).unwrap()
}

/// Whether an increment has the reading: within one pulse of `pulse_ns` over its interval.
fn has_reading(increment: &CompensatedIncrement, number: u64, pulse_ns: u64) -> bool {
    let ratio = pulse_ns as f64 / increment.interval_ns as f64;
    let (force, rate) = reading(number);
    let near = |is: [f64; 3], right: [f64; 3], resolution: f64| {
        is.iter().zip(right).all(|(is, right)| (is - right).abs() <= 1.001 * resolution * ratio)
    };
    near(increment.specific_force(), force, 1e-6) && near(increment.angular_rate(), rate, 1e-7)
}

#[test]
fn an_increment_has_the_value_of_the_reading_at_every_rate() {
    let domain = TestDomain::new();
    let table_ns = 5_000_000;
    domain.write("imu-a.toml", &nominal(table_ns, RESOLUTION));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    for interval_ns in INTERVALS_NS {
        let mut acquisition = connect(&domain, RESOLUTION).unwrap();
        let mut sums = [[0.0; 6]; 2];
        for number in 0..200 {
            let increment = period(&mut acquisition, number, interval_ns);
            assert!(has_reading(&increment, number, table_ns), "{interval_ns}: {increment:?}");
            let (force, rate) = reading(number);
            let seconds = interval_ns as f64 / 1e9;
            for axis in 0..3 {
                sums[0][axis] += increment.velocity_increment[axis];
                sums[1][axis] += force[axis] * seconds;
                sums[0][3 + axis] += increment.angle_increment[axis];
                sums[1][3 + axis] += rate[axis] * seconds;
            }
        }
        for (sensor, (is, right)) in sums[0].iter().zip(sums[1]).enumerate() {
            let half = if sensor < 3 { 0.5e-6 } else { 0.5e-7 } * table_ns as f64 / 1e9;
            let off = (is - right).abs();
            assert!(off <= 1.001 * half, "{interval_ns}: the sum of sensor {sensor} is {off} off");
        }
    }
    service.terminate();
}

#[test]
fn a_new_table_of_another_interval_gives_the_same_values() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", &nominal(5_000_000, RESOLUTION));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let mut acquisition = connect(&domain, RESOLUTION).unwrap();
    assert_eq!(acquisition.pulse_interval(), Some(5_000_000));
    let mut number = 0;
    let mut next = |acquisition: &mut Acquisition| {
        number += 1;
        (period(acquisition, number, 4_000_000), number)
    };
    let (increment, at) = next(&mut acquisition);
    assert!(has_reading(&increment, at, 5_000_000));
    let other = nominal(20_000_000, RESOLUTION);
    install(&domain, &other);
    // Until its interval is known increments are NaN, and each other one is right.
    wait_until("the new table", || {
        let (increment, at) = next(&mut acquisition);
        let is_invalid = Flags(increment.flags).intersects(Flags::NO_TABLE);
        assert!(is_invalid || has_reading(&increment, at, 20_000_000), "{increment:?}");
        increment.table == isotherm_tests::table(&other).id()
    });
    assert_eq!(acquisition.pulse_interval(), Some(20_000_000));
    // What follows is right, too.
    for _ in 0..100 {
        let (increment, at) = next(&mut acquisition);
        assert!(has_reading(&increment, at, 20_000_000), "{increment:?}");
    }
    service.terminate();
}

/// Periods that have waited while the service was away, and got another table meanwhile.
#[test]
fn what_was_kept_gets_the_pulses_of_the_table_that_it_meets() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", &nominal(5_000_000, RESOLUTION));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let mut acquisition = connect(&domain, RESOLUTION).unwrap();
    period(&mut acquisition, 0, 5_000_000);
    service.terminate();
    let mut sent = 100;
    for number in 1..sent {
        let sample = filled(&mut acquisition, number, 5_000_000);
        acquisition.keep(sample).unwrap();
    }
    install(&domain, &nominal(2_500_000, RESOLUTION));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    // Until the interval of the new table is known, increments are NaN; none has the pulses of the one before.
    let (mut number, mut last) = (1, None);
    wait_until("that all are answered", || {
        acquisition.pulse_interval();
        while let Some(increment) = acquisition.receive_timeout(Duration::ZERO).unwrap() {
            let is_right = has_reading(&increment, number, 5_000_000);
            assert!(is_right || Flags(increment.flags).intersects(Flags::NO_TABLE), "{increment:?}");
            (number, last) = (number + 1, Some(is_right));
        }
        acquisition.send_kept().unwrap();
        if acquisition.in_flight() == 0 && last != Some(true) {
            let sample = filled(&mut acquisition, sent, 5_000_000);
            acquisition.send(sample).unwrap();
            sent += 1;
        }
        number == sent && last == Some(true)
    });
    service.terminate();
}

#[test]
fn readings_of_another_resolution_do_not_join_and_are_invalid_in_flight() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", &nominal(5_000_000, RESOLUTION));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let other = Resolution { accelerometer: 2e-6, ..RESOLUTION };
    let refused = connect(&domain, other).err().map(|error| error.to_string()).unwrap();
    assert!(refused.contains("A1") && refused.contains("1.0000e-8") && refused.contains("5.0000e-9"), "{refused}");
    let mut acquisition = connect(&domain, RESOLUTION).unwrap();
    assert!(has_reading(&period(&mut acquisition, 1, 5_000_000), 1, 5_000_000));
    install(&domain, &nominal(5_000_000, other));
    let mut number = 1;
    wait_until("that the samples are invalid", || {
        number += 1;
        let increment = period(&mut acquisition, number, 5_000_000);
        Flags(increment.flags).intersects(Flags::INVALID) && increment.velocity_increment[0].is_nan()
    });
    // And right again with a table of this resolution.
    install(&domain, &nominal(5_000_000, RESOLUTION));
    wait_until("that they are valid", || {
        number += 1;
        has_reading(&period(&mut acquisition, number, 5_000_000), number, 5_000_000)
    });
    service.terminate();
}

/// A program that makes pulses by itself is judged by nobody.
#[test]
fn pulses_of_a_program_stay_as_they_are() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", &nominal(5_000_000, RESOLUTION));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let mut acquisition = domain.acquisition("imu-a");
    let triad = Triad { head_temperature: [25.0; 3], board_temperature: [25.0; 3], ..Triad::default() };
    let mut raw = RawSample { accelerometers: triad, gyroscopes: triad, ..RawSample::default() };
    let (force, rate) = reading(7);
    Readings::new(RESOLUTION, 10_000_000).fill(&mut raw, force, Some(rate)).unwrap();
    let mut sample = acquisition.loan().unwrap();
    *sample = RawSample { session: sample.session, sequence: sample.sequence, ..raw };
    let increment = acquisition.compensate(sample, TIMEOUT).unwrap();
    assert!((increment.specific_force()[2] - force[2] / 2.0).abs() < 1e-5, "{increment:?}");
    service.terminate();
}

/// Data of another program at rates that are not the table's: what `feed` gets from the service is what `replay` makes.
#[test]
fn feed_and_replay_make_the_same_of_readings_at_another_rate() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", &nominal(5_000_000, RESOLUTION));
    let sensors = |names: &str, unit: &str, resolution: &str| {
        format!("columns = [{names}]\nkind = \"reading\"\nunit = \"{unit}\"\nresolution = {resolution}\n")
    };
    let accelerometer = sensors("\"ax\", \"ay\", \"az\"", "m/s2", "1e-6");
    let gyroscope = sensors("\"gx\", \"gy\", \"gz\"", "rad/s", "1e-7");
    let mapping = format!(
        "format = 1\n[time]\ncolumn = \"time\"\nunit = \"s\"\n[accelerometer]\n{accelerometer}[gyroscope]\n{gyroscope}\
         [temperature]\ncolumns = [\"t\", \"t\", \"t\"]\n"
    );
    domain.write("m.toml", &mapping);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    for interval_ns in INTERVALS_NS {
        let line = |number: u64| {
            let ([ax, ay, az], [gx, gy, gz]) = reading(number);
            let seconds = ((number + 1) * interval_ns) as f64 / 1e9;
            format!("{seconds:.9},{ax:.8},{ay:.8},{az:.8},{gx:.9},{gy:.9},{gz:.9},25.0\n")
        };
        let lines: String = (0..300).map(line).collect();
        domain.write("data.csv", &format!("time,ax,ay,az,gx,gy,gz,t\n{lines}"));
        domain.run_ok(&["feed", "--imu", "imu-a", "data.csv", "--mapping", "m.toml", "-o", "fed.csv"]);
        domain.run_ok(&["replay", "--table", "imu-a.toml", "data.csv", "--mapping", "m.toml", "-o", "replayed.csv"]);
        let [fed, replayed] = ["fed.csv", "replayed.csv"].map(|name| fs::read_to_string(domain.path(name)).unwrap());
        assert!(fed == replayed && fed.lines().count() == 301, "{interval_ns}");
    }
    // Another resolution is refused before anything is sent.
    let received = domain.imu_status()["received"].clone();
    domain.write("m.toml", &mapping.replace("1e-6", "1e-5"));
    let output = domain.run(&["feed", "--imu", "imu-a", "data.csv", "--mapping", "m.toml", "-o", "refused.csv"]);
    assert_eq!(output.status.code(), Some(65), "{}", text(&output.stderr));
    assert_eq!(domain.imu_status()["received"], received);
    service.terminate();
}
