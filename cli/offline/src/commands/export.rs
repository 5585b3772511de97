//! `export`: a table as parameters of an autopilot.

use crate::parse::one_of;
use clap::Args;
use isotherm_autopilot::{Autopilot, Effect, ExportOptions, ExportedParameters, export, size};
use isotherm_documents::{load_table, read_text};
use isotherm_files::{StagedText, Trust, refuse_overlap};
use isotherm_fit::Origin;
use isotherm_recording::LogImu;
use isotherm_support::failure::{Failure, shown};
use std::path::{Path, PathBuf};
use tracing::info;

/// Write a table as parameters of an autopilot
///
/// Writes the biases of a table as parameters of PX4 or ArduPilot.
///
/// Both autopilots subtract a cubic of the temperature. The cubic of the table is written exactly, in float32. A part
/// of the table that parameters cannot express is refused with its size, unless --drop names it. The parameters of
/// other instances are not written.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm export imu-a.toml --to px4 --device-id 3014666,3080202 -o imu-a.params\n  isotherm export imu-a.toml --to ardupilot --instance 2 --at 25 -o imu-a.parm\n  isotherm export imu-a.toml --to ardupilot --drop lag,alignment -o imu-a.parm"
)]
pub struct Export {
    /// Read this coefficient table in degC
    #[arg(value_name = "TABLE")]
    table: PathBuf,
    /// Choose the autopilot
    #[arg(long, value_name = "AUTOPILOT", value_parser = one_of(Autopilot::NAMES))]
    to: Autopilot,
    /// Write the parameters to this file
    ///
    /// The name ends with .params for PX4, and with .parm for ArduPilot; - is stdout.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Set the IMU's number in the autopilot
    ///
    /// 0 to 3 for PX4, 1 to 5 for ArduPilot [default: as in the log that the table was made from, or the first]
    #[arg(long, value_name = "N")]
    instance: Option<u8>,
    /// Write ArduPilot's constants at this temperature [degC]
    ///
    /// Also writes CALTEMP, and as OFFS the biases at this temperature
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    at: Option<f64>,
    #[command(flatten)]
    parameters: ParameterArgs,
}

/// What the parameters of an autopilot need in addition to the table.
#[derive(Debug, Args)]
pub(super) struct ParameterArgs {
    /// Set PX4's device numbers of the IMU
    ///
    /// One number for the IMU, or one for accelerometers and one for gyroscopes; logs contain them as device_id
    /// [default: those of the log that the table was made from]
    #[arg(long, value_name = "ACC[,GYR]", value_parser = devices)]
    pub device_id: Option<[u32; 2]>,
    /// Drop this part of the table
    ///
    /// The parameters are written without it. Give several names with commas, or repeat the option.
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = one_of(Effect::NAMES))]
    pub drop: Vec<Effect>,
}

impl Export {
    pub(crate) fn run(self) -> Result<(), Failure> {
        refuse_overlap(&[(&self.table, "the table")], &[Some(&self.output)])?;
        let (table, _) = load_table(&self.table, None, Trust::Any)?;
        let log_imu = Origin::of_toml(&read_text(&self.table, Trust::Any)?.0, &table).log_imu;
        let options = ExportOptions { at_c: self.at, ..self.parameters.options(self.to, self.instance, log_imu) };
        let exported = export(&table, &options)?;
        StagedText::create(Some(&self.output))?.write(&exported.text)?.finish()?;
        tell_left_out(&exported);
        tell_exported(&exported, self.to, &self.output);
        if let Some(imu) = log_imu.filter(|_| self.instance.is_none()) {
            info!("they are for {imu}, as in the log that made the table");
        }
        Ok(())
    }
}

impl ParameterArgs {
    /// The options of an export. Instance and device numbers are those that are given, otherwise those of the log that
    /// made the table.
    pub(super) fn options(&self, to: Autopilot, instance: Option<u8>, log_imu: Option<LogImu>) -> ExportOptions {
        let of_log = |imu: LogImu| ExportOptions::of_log(to, imu.instance, imu.devices);
        let options = log_imu.map_or_else(|| ExportOptions::new(to), of_log).with(instance, self.device_id);
        ExportOptions { drop: self.drop.clone(), ..options }
    }
}

/// What was left out, and what is to be known.
pub(super) fn tell_left_out(exported: &ExportedParameters) {
    for loss in &exported.lost {
        info!("left out: {loss}");
    }
    tell_notes(&exported.notes);
}

pub(super) fn tell_notes(notes: &[String]) {
    notes.iter().for_each(|note| info!("note: {note}"));
}

/// What was written.
pub(super) fn tell_exported(exported: &ExportedParameters, autopilot: Autopilot, output: &Path) {
    let lines = exported.text.lines().filter(|line| !line.starts_with('#')).count();
    let to = if output == Path::new("-") { "stdout".into() } else { shown(output).to_string() };
    let gyroscopes = exported.difference.gyroscopes.map(|rate| format!(" and {} rad/s", size(rate)));
    let [low, high] = exported.range;
    info!(
        "{lines} parameters of {autopilot} in {to}; in float32 within {} m/s2{} of the table, from {low} to {high} degC",
        size(exported.difference.accelerometers),
        gyroscopes.unwrap_or_default(),
    );
}

/// One device number for both kinds of sensor, or one for each.
fn devices(text: &str) -> Result<[u32; 2], String> {
    let (accelerometers, gyroscopes) = text.split_once(',').unwrap_or((text, text));
    match (accelerometers.trim().parse(), gyroscopes.trim().parse()) {
        (Ok(accelerometers), Ok(gyroscopes)) => Ok([accelerometers, gyroscopes]),
        _ => Err("give one number, or two with a comma between them".to_owned()),
    }
}
