//! `import`: parameters of an autopilot as a table.

use crate::parse::one_of;
use crate::parse::{gravity, interval};
use clap::Args;
use isotherm_autopilot::{Autopilot, ImportError, ImportOptions, import};
use isotherm_documents::{LoadError, read_parameters};
use isotherm_files::{StagedText, refuse_overlap};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::STANDARD_GRAVITY;
use isotherm_support::failure::Failure;
use std::path::PathBuf;
use std::time::Duration;
use tracing::info;

/// Make a table from an autopilot's parameters
///
/// Makes a table from the parameters of PX4 or ArduPilot, for the service.
///
/// The table is for readings in m/s2 and rad/s: a pulse is 1e-6 m/s2 or 1e-7 rad/s over the interval. Its biases are
/// those that the firmware subtracts. The biases of ArduPilot are relative, 0 at 35 degC, unless the file also contains
/// CALTEMP and OFFS.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm import vehicle.params --from px4 --imu imu-a --interval 0.0025 -o imu-a.toml\n  isotherm import vehicle.parm --from ardupilot --instance 2 --imu imu-b --interval 0.001 -o imu-b.toml"
)]
pub struct Import {
    /// Read this parameter file
    ///
    /// A .params or .parm file. It can contain all parameters of the vehicle.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Choose the autopilot
    #[arg(long, value_name = "AUTOPILOT", value_parser = one_of(Autopilot::NAMES))]
    from: Autopilot,
    /// Name the IMU of the table
    #[arg(long, value_name = "ID")]
    imu: ImuId,
    /// Choose the IMU's number in the autopilot
    ///
    /// 0 to 3 for PX4, 1 to 5 for ArduPilot [default: the first]
    #[arg(long, value_name = "N")]
    instance: Option<u8>,
    /// Set the nominal interval of the readings [s]
    #[arg(long, value_name = "S", value_parser = interval)]
    interval: Duration,
    /// Set the value of 1 g0 [m/s2]
    #[arg(long, value_name = "G", default_value_t = STANDARD_GRAVITY, value_parser = gravity)]
    gravity: f64,
    /// Write the table to this file
    ///
    /// - is stdout
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
