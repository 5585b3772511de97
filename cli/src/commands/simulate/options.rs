//! Options of the simulated IMU, which all simulations share, and functions that write their files.

use super::memory::MemoryOptions;
use clap::Args;
use isotherm_documents::load_table;
use isotherm_files::{Output, StagedText, Trust, print};
use isotherm_offline::parse::{gravity, latitude, size, sizes, vibration};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{CoefficientTable, Content, ContentFault};
use isotherm_shared::wire::AXES;
use isotherm_simulation::{Chain, MISALIGNMENT, Noise, TILT_RAD, Truth, typical_gyroscopes};
use isotherm_support::failure::{Exit, Failure, shown};
use serde::Serialize;
use std::io;
use std::path::PathBuf;

/// Options of the simulated IMU.
#[derive(Debug, Args)]
pub(super) struct SimulatedImuOptions {
    /// Write the files into this folder
    ///
    /// The folder is created if it does not exist.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Set the seed; equal seeds give equal files
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: u64,
    /// Use the coefficients of this table
    ///
    /// They include the alignment. Default: the coefficients of the source paper.
    #[arg(long, value_name = "TABLE")]
    truth: Option<PathBuf>,
    /// Also simulate gyroscopes
    ///
    /// Implied by a TABLE with gyroscopes. Otherwise, typical gyroscopes are added.
    #[arg(long)]
    gyroscopes: bool,
    /// Set the latitude of the laboratory [deg]
    ///
    /// North is positive. Default: 39.9, unless --vary draws it. Only with gyroscopes.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = latitude)]
    latitude: Option<f64>,
    /// Draw another IMU from the seed
    ///
    /// The IMU is of the same kind; the laboratory is drawn, too.
    #[arg(long)]
    vary: bool,
    /// Name the IMU
    ///
    /// Default: the name in the table.
    #[arg(long, value_name = "ID")]
    imu: Vec<ImuId>,
    /// Set local gravity [m/s2]
    ///
    /// Default: the 1 g0 of the table, unless --vary draws it.
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_local: Option<f64>,
    /// Set the accelerometers' white noise [1e-6 g0]
    ///
    /// One sigma of a mean over 1 s
    #[arg(long, value_name = "UG0", default_value_t = 5.0, value_parser = size)]
    sensor_noise: f64,
    /// Set the repeatability at set points
    ///
    /// One sigma of the random deviation of the accelerometers' biases and scale factors at each visit of a set point
    /// [1e-6 g0, 1e-6]
    #[arg(long, value_name = "UG0,PPM", default_value = "0.2,0.3", value_parser = sizes)]
    repeatability: [f64; 2],
    /// Set the noise of a temperature reading
    ///
    /// One sigma [V or degC]. Default: 0.1 mV.
    #[arg(long, value_name = "U", value_parser = size)]
    temperature_noise: Option<f64>,
    /// Set the resolution of the temperature
    ///
    /// In 1e-6 V or degC; 0 switches it off. Default: 76, which is 16 bits over 5 V.
    #[arg(long, value_name = "U")]
    temperature_lsb: Option<u32>,
    /// Vibrate at this amplitude and frequency [g0, Hz]
    ///
    /// Along all input axes
    #[arg(long, value_name = "G0,HZ", default_value = "0,0", value_parser = vibration)]
    vibration: [f64; 2],
    #[command(flatten)]
    memory: MemoryOptions,
}

impl SimulatedImuOptions {
    /// The truth of the one IMU.
    pub(super) fn truth(&self) -> Result<Truth, Failure> {
        match &self.imu[..] {
            [] | [_] => self.first_truth(),
            _ => Err(usage("--imu: this simulates one IMU; isotherm simulate station has several on one turntable")),
        }
    }

    /// The truth of each IMU. The first one is that of a single IMU; the others are drawn from it and from the seeds
    /// that follow, and are in the same laboratory.
    pub(super) fn truths(&self) -> Result<Vec<Truth>, Failure> {
        if let Some((_, imu)) = self.imu.iter().enumerate().find(|(index, imu)| self.imu[..*index].contains(imu)) {
            return Err(usage(format!("--imu: {imu} is there twice")));
        }
        let first = self.first_truth()?;
        let content = first.table.content();
        let others = (2..).zip(self.imu.iter().skip(1)).map(|(number, imu)| {
            let serial = content.serial.as_ref().map(|serial| format!("{serial}-{number}"));
            let content = Content { imu: imu.clone(), serial, ..content.clone() };
            let truth = Truth::varied(&content, self.seed.wrapping_add(number - 1)).map_err(refused)?;
            let Truth { plays, tilt_rad, gravity_local, latitude_deg, heading_deg, .. } = first.clone();
            Ok(Truth { plays, tilt_rad, gravity_local, latitude_deg, heading_deg, ..truth })
        });
        let others = others.collect::<Result<Vec<_>, Failure>>()?;
        Ok([vec![first.clone()], others].concat())
    }

    fn first_truth(&self) -> Result<Truth, Failure> {
        let given = match &self.truth {
            Some(path) => load_table(path, None, Trust::Any)?.0,
            None => {
                let paper = CoefficientTable::from_toml(isotherm_demo::TABLE, None);
                paper.map_err(|faults| Failure::new(Exit::Failed, format!("the embedded table: {faults}")))?
            }
        };
        let mut content = given.content().clone();
        if let Some(imu) = self.imu.first() {
            content.imu = imu.clone();
        }
        if self.gyroscopes && content.gyroscopes.is_none() {
            content.gyroscopes = typical_gyroscopes(&chain_in(&content.temperature_unit)?.0);
            content.format = content.least_format();
        }
        self.memory.apply(&mut content)?;
        let plays = self.memory.plays(content.gyroscopes.is_some())?;
        if self.latitude.is_some() && content.gyroscopes.is_none() {
            return Err(usage("--latitude: only gyroscopes feel it; give --gyroscopes too"));
        }
        let truth = if self.vary {
            Truth::varied(&content, self.seed)
        } else if self.truth.is_none() {
            let gravity = content.gravity;
            Truth::new(content, MISALIGNMENT, TILT_RAD, gravity)
        } else {
            CoefficientTable::new(content).map(|table| Truth { tilt_rad: TILT_RAD, ..Truth::of(table) })
        };
        let truth = truth.map_err(refused)?;
        Ok(Truth {
            gravity_local: self.gravity_local.unwrap_or(truth.gravity_local),
            latitude_deg: self.latitude.unwrap_or(truth.latitude_deg),
            plays,
            ..truth
        })
    }

    /// Signal chain and noise, with the temperature in the truth's unit. The positioning error is 0; a run has none,
    /// and a campaign sets its own.
    pub(super) fn chain_and_noise(&self, truth: &Truth, temperature_every: f64) -> Result<(Chain, Noise), Failure> {
        let (mut chain, temperature_noise) = chain_in(&truth.table.content().temperature_unit)?;
        chain.telemetry_lsb_micro = self.temperature_lsb.unwrap_or(chain.telemetry_lsb_micro);
        chain.temperature_s = temperature_every;
        [chain.vibration_g0, chain.vibration_hz] = self.vibration;
        let [bias_ug0, scale_factor_ppm] = self.repeatability;
        let noise = Noise {
            sensor_g0: self.sensor_noise / 1e6,
            temperature: self.temperature_noise.unwrap_or(temperature_noise),
            bias_g0: bias_ug0 / 1e6,
            scale_factor: scale_factor_ppm / 1e6,
            positioning_rad: 0.0,
            ..Noise::default()
        };
        if truth.table.content().gyroscopes.is_some() {
            return Ok((chain, noise));
        }
        // Without gyroscopes, truth.toml does not mention them.
        let chain = Chain { gyroscope_head_offset_c: [0.0; AXES], gyroscope_board_offset_c: [0.0; AXES], ..chain };
        let Noise { sensor_g0, temperature, bias_g0, scale_factor, .. } = noise;
        Ok((chain, Noise { sensor_g0, temperature, bias_g0, scale_factor, ..Noise::NONE }))
    }
}

/// The signal chain with temperature in `unit`, and the noise of a reading in that unit.
fn chain_in(unit: &str) -> Result<(Chain, f64), Failure> {
    let (volts, noise) = (Chain::default(), Noise::default().temperature);
    match unit {
        "V" => Ok((volts, noise)),
        "degC" => {
            let lsb = (f64::from(volts.telemetry_lsb_micro) / volts.temperature_slope) as u32;
            let degrees = Chain { temperature_zero: 0.0, temperature_slope: 1.0, telemetry_lsb_micro: lsb, ..volts };
            Ok((degrees, noise / volts.temperature_slope))
        }
        unit => Err(usage(format!("the truth's temperature is in {unit}; V and degC can be simulated"))),
    }
}

/// The failure of a truth that no table can have.
fn refused(refusals: Vec<ContentFault>) -> Failure {
    let refusals: Vec<_> = refusals.iter().map(ContentFault::to_string).collect();
    Failure::new(Exit::Config, format!("the truth cannot be a table: {}", refusals.join("; ")))
}

/// A usage error.
pub(super) fn usage(message: impl Into<String>) -> Failure {
    Failure::new(Exit::Usage, message)
}

/// The text of truth.toml: the coefficients that the simulated data come from.
pub(super) fn truth_toml(
    truth: &Truth,
    command: &str,
    seed: u64,
    schedule: &impl Serialize,
) -> Result<String, Failure> {
    let tool = format!("{command} {}", env!("CARGO_PKG_VERSION"));
    let text = truth.to_toml(&tool, seed, schedule);
    text.map_err(|error| Failure::new(Exit::Failed, format!("writing the truth: {error}")))
}

/// The files of a simulation. They appear together: the data first, which the others describe.
#[derive(Default)]
pub(super) struct SimulatedFiles {
    paths: Vec<PathBuf>,
    texts: Vec<StagedText>,
}

impl SimulatedFiles {
    /// Adds a text.
    pub(super) fn add(&mut self, path: PathBuf, text: &str) -> Result<(), Failure> {
        self.add_with(path, |output| io::Write::write_all(output, text.as_bytes()))
    }

    /// Adds a file that this function writes.
    pub(super) fn add_with(
        &mut self,
        path: PathBuf,
        write: impl FnOnce(&mut Output) -> io::Result<()>,
    ) -> Result<(), Failure> {
        self.texts.push(StagedText::create(Some(&path))?.write_with(write)?);
        self.paths.push(path);
        Ok(())
    }

    /// Makes the files visible, and prints their paths.
    pub(super) fn finish(self) -> Result<(), Failure> {
        StagedText::finish_all(self.texts)?;
        self.paths.iter().try_for_each(|path| print(&format!("{}\n", shown(path))))
    }
}

/// Converts an angle from arc seconds to radians.
pub(super) fn arcsec(angle: f64) -> f64 {
    (angle / 3600.0).to_radians()
}
