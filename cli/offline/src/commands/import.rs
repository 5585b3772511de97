//! `import`: parameters of an autopilot as a table.

use crate::parse::one_of;
use crate::parse::{gravity, interval};
use clap::Args;
use isotherm_autopilot::{Autopilot, ImportError, ImportOptions, import};
use isotherm_files::{LoadError, StagedText, read_parameters, refuse_overlap};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::STANDARD_GRAVITY;
use isotherm_support::failure::Failure;
use std::path::PathBuf;
use std::time::Duration;
use tracing::info;

/// Make a table of an autopilot's parameters
///
/// Make a table of parameters of PX4 or ArduPilot, which the service then serves.
///
/// The table is that of readings in m/s2 and rad/s, a pulse being 1e-6 m/s2 or 1e-7 rad/s over the interval. Its biases
/// are what the firmware subtracts. ArduPilot's are relative, 0 at 35 degC, unless the file has CALTEMP and OFFS too.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm import vehicle.params --from px4 --imu imu-a --interval 0.0025 -o imu-a.toml\n  isotherm import vehicle.parm --from ardupilot --instance 2 --imu imu-b --interval 0.001 -o imu-b.toml"
)]
pub struct Import {
    /// Read this file of parameters
    ///
    /// File of parameters: .params or .parm; it may have all others of the vehicle.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The autopilot
    #[arg(long, value_name = "AUTOPILOT", value_parser = one_of(Autopilot::NAMES))]
    from: Autopilot,
    /// The IMU of the table
    #[arg(long, value_name = "ID")]
    imu: ImuId,
    /// Choose the number of the IMU there
    ///
    /// Number of the IMU in the autopilot: 0 to 3 of PX4, 1 to 5 of ArduPilot [default: the first]
    #[arg(long, value_name = "N")]
    instance: Option<u8>,
    /// Nominal interval between two readings [s]
    #[arg(long, value_name = "S", value_parser = interval)]
    interval: Duration,
    /// The value of 1 g0 [m/s2]
    #[arg(long, value_name = "G", default_value_t = STANDARD_GRAVITY, value_parser = gravity)]
    gravity: f64,
    /// Where the table goes; - is stdout
    #[arg(short, long, value_name = "TABLE")]
    output: PathBuf,
}

impl Import {
    pub(crate) fn run(self) -> Result<(), Failure> {
        refuse_overlap(&[(&self.file, "the file of parameters")], &[Some(&self.output)])?;
        let text = read_parameters(&self.file)?;
        let options = ImportOptions {
            autopilot: self.from,
            instance: self.instance,
            imu: self.imu,
            interval_ns: self.interval.as_nanos() as u64,
            gravity: self.gravity,
        };
        let table = import(&text, &options).map_err(|error| match error {
            ImportError::Text(faults) => LoadError::Refused { path: self.file.clone(), faults }.into(),
            other => Failure::from(other),
        })?;
        StagedText::create(Some(&self.output))?.write(&table.to_toml())?.finish()?;
        info!("table {} of {}", table.digest(), table.content().imu);
        Ok(())
    }
}
