//! An acquisition process: reads samples from a recording, makes one round trip for each, and prints the increments as
//! CSV.
//!
//!     acquisition IMU RECORDING.csv [STATE [unknown]]
//!
//! Replace the recording by your hardware, and `follow` by a `reading` for each new temperature. STATE is the file in
//! which the lag of the temperatures is kept: a program that is started again with it goes on as if the temperatures
//! had gone straight on in the pause. Where there is no such file, the IMU is taken to be soaked; with `unknown`,
//! increments are flagged until three time constants have passed. The environment variable ISOTHERM_DOMAIN names the
//! domain, SERIAL the unit.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "it prints what it receives")]

use isotherm_client::{Acquisition, Flags, Options};
use isotherm_recording::RawCsvReader;
use std::env;
use std::error::Error;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::Path;
use std::time::Duration;

/// Longer than a service needs to start again.
const TIMEOUT: Duration = Duration::from_secs(20);

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<_> = env::args().skip(1).collect();
    let [imu, recording, rest @ ..] = words.as_slice() else {
        return Err("usage: acquisition IMU RECORDING.csv [STATE [unknown]]".into());
    };
    let state = rest.first().map(Path::new);
    // Waits up to 5 s for the service.
    let options = Options { serial: env::var("SERIAL").ok(), ..Options::from_environment()? };
    let mut acquisition = Acquisition::connect(&imu.parse()?, &options)?;
    begin(&mut acquisition, state, rest.get(1).is_some_and(|word| word == "unknown"));

    println!("sequence,a1_dv,a2_dv,a3_dv,g1_da,g2_da,g3_da,table,flags");
    let mut saved = *acquisition.lag().state();
    for sample in RawCsvReader::new(File::open(recording)?)? {
        let sample = sample?;
        // New temperatures; in most samples there are none.
        acquisition.lag().follow(&sample);
        if let Some(state) = state
            && acquisition.lag().state().sensors != saved.sensors
        {
            saved = *acquisition.lag().state();
            // Under another name first, so that the file is complete whenever this process ends.
            let staged = state.with_extension("new");
            fs::write(&staged, serde_json::to_string(&saved)?)?;
            fs::rename(&staged, state)?;
        }
        let loan = acquisition.loan_record(&sample)?; // keeps the record's sequence
        let increment = acquisition.compensate(loan, TIMEOUT)?;
        print!("{}", increment.sequence);
        for value in [increment.velocity_increment, increment.angle_increment].as_flattened() {
            print!(",{value:?}");
        }
        println!(",{:016x},{}", increment.table, Flags(increment.flags));
    }
    Ok(())
}

/// Goes on with the lag that a predecessor of this process has kept.
fn begin(acquisition: &mut Acquisition, state: Option<&Path>, unknown: bool) {
    let Some(state) = state else { return acquisition.lag().soaked() };
    let text = fs::read_to_string(state);
    match text.as_deref().map(serde_json::from_str) {
        Ok(Ok(lag)) => acquisition.lag().restore(&lag),
        // The first start: the IMU is soaked, if nothing else is said.
        Err(error) if error.kind() == ErrorKind::NotFound && !unknown => acquisition.lag().soaked(),
        other => {
            eprintln!(
                "{}: no state of the lag; flagged lag-unknown for three time constants: {other:?}",
                state.display()
            );
            acquisition.lag().forget();
        }
    }
}
