//! An acquisition whose IMU delivers readings, as every MEMS does: m/s2 and rad/s become a sample, and its increment
//! becomes m/s2 and rad/s again, compensated.
//!
//!     example-mems IMU [SAMPLES]
//!
//! Replace `read_imu` by your driver. The resolution is that of the table, here of examples/tables/imu-mems.toml; the
//! interval is your own. The pace of an IMU, and what to do when the service is away: paced.rs. The
//! environment variable `ISOTHERM_DOMAIN` names the domain.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that prints")]

use isotherm_client::{Acquisition, Options, Resolution};
use std::env;
use std::error::Error;
use std::time::Duration;

const INTERVAL_NS: u64 = 2_500_000;
const RESOLUTION: Resolution = Resolution { accelerometer: 1e-6, gyroscope: 1e-7 };

/// Specific force \[m/s2\], angular rate \[rad/s\] and temperature \[degC\].
fn read_imu(sample: u64) -> ([f64; 3], [f64; 3], f64) {
    let turn = sample as f64 / 7.0;
    ([0.123_456_7, -0.234_567_8 - turn, 9.801_234_5], [0.012_345_67, -turn, 0.000_012_34], 31.25)
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<_> = env::args().skip(1).collect();
    let [imu, rest @ ..] = words.as_slice() else { return Err("usage: example-mems IMU [SAMPLES]".into()) };
    let samples = rest.first().map_or(Ok(8), |word| word.parse())?;
    let options = Options { resolution: Some(RESOLUTION), ..Options::from_environment()? };
    let mut acquisition = Acquisition::connect(&imu.parse()?, &options)?;
    for number in 0..samples {
        let (specific_force, angular_rate, temperature) = read_imu(number);
        let mut sample = acquisition.loan()?;
        (sample.timestamp_ns, sample.interval_ns) = ((number + 1) * INTERVAL_NS, INTERVAL_NS);
        if let Err(error) = acquisition.fill(&mut sample, specific_force, Some(angular_rate)) {
            eprintln!("{error}"); // the sample is dropped, a gap for every reader
            continue;
        }
        sample.accelerometers.head_temperature = [temperature; 3];
        sample.accelerometers.board_temperature = [temperature; 3];
        sample.gyroscopes.head_temperature = [temperature; 3];
        sample.gyroscopes.board_temperature = [temperature; 3];
        let increment = acquisition.compensate(sample, Duration::from_secs(20))?;
        let ([x, y, z], [p, q, r]) = (increment.specific_force(), increment.angular_rate());
        println!("{}: {x:.9} {y:.9} {z:.9} m/s2, {p:.9} {q:.9} {r:.9} rad/s", increment.sequence);
    }
    Ok(())
}
