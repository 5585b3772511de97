use super::parse::{
    SetPoints, direction, gravity, interval, numbers, ramp, scheme, set_points, size, sizes, vibration,
};
use super::{PAPER, seconds, written};
use crate::failure::{Exit, Failure};
use crate::files::{Guard, Output, load_table};
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use isotherm_calibration::positions::Scheme;
use isotherm_calibration::simulate::{
    self as simulation, Chain, MISALIGNMENT, Noise, Plan, TILT_RAD, Truth, campaign_toml,
};
use isotherm_client::Domain;
use isotherm_shared::recording::RawWriter;
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::{CoefficientTable, Refusal};
use isotherm_shared::wire::{AXES, RawSample};
use serde::Serialize;
use std::fmt::Display;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Most rows of a file: a hundred hours at 1 kHz, some 50 GB.
const MAX_ROWS: u64 = 360_000_000;
/// Rows between two looks of the progress bar.
const BAR_ROWS: u64 = 4096;

/// Make a campaign or a temperature run of a simulated IMU whose coefficients are known, or run a simulated station
///
/// The coefficients that the data come from are written beside them as truth.toml.
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
pub struct Simulate {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Campaign(Campaign),
    Run(Run),
    #[cfg(feature = "campaign")]
    Station(super::station::Station),
    #[cfg(feature = "campaign")]
    #[command(hide = true)]
    StationPart(super::station::StationPart),
}

/// A campaign on a two-axis turntable in a temperature chamber: campaign.toml, samples.csv, truth.toml
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm simulate campaign -o campaign\n  isotherm simulate campaign -o hundred --vary --seed 100 --set-points -20:40:10 --positions six-faces-six-edges\n  isotherm simulate campaign -o fast --interval 0.01 --telemetry-every 1 --vibration 0.01,35"
)]
struct Campaign {
    #[command(flatten)]
    common: Common,
    /// Positions of the turntable at each set point
    #[arg(long, value_name = "NAME", default_value = Scheme::NAMES[0].1, value_parser = PossibleValuesParser::new(Scheme::NAMES.map(|(_, name)| name)).map(scheme))]
    positions: Scheme,
    /// Set points of the chamber [degC], both ends included
    #[arg(long, value_name = "FROM:TO:STEP", default_value = "-25:45:5", allow_hyphen_values = true, value_parser = set_points)]
    set_points: SetPoints,
    /// From leaving a set point to the first move at the next, the ramp of 1 degC/min included [s]
    #[arg(long, value_name = "S", default_value = "4200", value_parser = seconds)]
    soak: Duration,
    /// Rest in each position [s]
    #[arg(long, value_name = "S", default_value = "300", value_parser = seconds)]
    dwell: Duration,
    /// Period of a row [s]
    #[arg(long, value_name = "S", default_value = "10", value_parser = interval)]
    interval: Duration,
    /// Tilt of the turntable's base about the laboratory's X and Y [arcsec]; 8.3,-12.4 unless given or drawn
    #[arg(long, value_name = "TX,TY", allow_hyphen_values = true, value_parser = numbers::<2>)]
    tilt: Option<[f64; 2]>,
    /// Error of the turntable's angles in each dwell, one sigma [arcsec]
    #[arg(long, value_name = "ARCSEC", default_value_t = 1.0, value_parser = size)]
    positioning: f64,
    /// The telemetry is read so often [s]; 0 for every row
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = size)]
    telemetry_every: f64,
}

/// A temperature run at rest, ramped from cold to hot: run.csv, truth.toml
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm simulate run -o run\n  isotherm simulate run -o run --truth campaign/truth.toml --seed 2\n  isotherm simulate run -o fast --interval 0.01 --telemetry-every 1 --ramp 60"
)]
struct Run {
    #[command(flatten)]
    common: Common,
    /// Control period [s]
    #[arg(long, value_name = "S", default_value = "0.1", value_parser = interval)]
    interval: Duration,
    /// Direction of the specific force along A1, A2, A3; any length
    #[arg(long, value_name = "A1,A2,A3", default_value = "0.60,-0.48,0.64", allow_hyphen_values = true, value_parser = direction)]
    attitude: [f64; AXES],
    /// First and last temperature of the chamber [degC]
    #[arg(long, value_name = "FROM,TO", default_value = "-25,45", allow_hyphen_values = true, value_parser = numbers::<2>)]
    temperatures: [f64; 2],
    /// Ramp of the chamber [degC/h]
    #[arg(long, value_name = "DEGC/H", default_value_t = 20.0, value_parser = ramp)]
    ramp: f64,
    /// Hold before the ramp, and again after it [s]
    #[arg(long, value_name = "S", default_value = "1800", value_parser = seconds)]
    hold: Duration,
    /// The telemetry is read so often [s]; 0 for every row
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = size)]
    telemetry_every: f64,
}

/// What both have.
#[derive(Debug, Args)]
pub(super) struct Common {
    /// Folder for the files; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: PathBuf,
    /// The same seed gives the same files
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub(super) seed: u64,
    /// Coefficients of the IMU, with its alignment; those of the source paper unless given
    #[arg(long, value_name = "TABLE")]
    truth: Option<PathBuf>,
    /// Draw another IMU of this kind, and another laboratory, from the seed
    #[arg(long)]
    vary: bool,
    /// Name of the IMU; as in the table unless given
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Local gravity [m/s2]; as the table's 1 g0 unless given or drawn
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_local: Option<f64>,
    /// White noise of a sensor in a mean over 1 s, one sigma [1e-6 g0]
    #[arg(long, value_name = "UG0", default_value_t = 5.0, value_parser = size)]
    sensor_noise: f64,
    /// What bias and scale factors do not repeat between visits of a set point, one sigma [1e-6 g0, 1e-6]
    #[arg(long, value_name = "UG0,PPM", default_value = "0.2,0.3", value_parser = sizes)]
    repeatability: [f64; 2],
    /// Noise of a telemetry reading, one sigma [V or degC]; 0.1 mV unless given
    #[arg(long, value_name = "U", value_parser = size)]
    telemetry_noise: Option<f64>,
    /// Resolution of the telemetry [1e-6 V or degC]; 76, 16 bits over 5 V, unless given; 0 for none
    #[arg(long, value_name = "U")]
    telemetry_lsb: Option<u32>,
    /// Vibration along all input axes: amplitude [g0] and frequency [Hz]
    #[arg(long, value_name = "G0,HZ", default_value = "0,0", value_parser = vibration)]
    vibration: [f64; 2],
}

impl Simulate {
    /// Whether it writes its files and ends, and leaves signals to others.
    pub fn is_brief(&self) -> bool {
        matches!(self.what, What::Campaign(_) | What::Run(_))
    }

    #[cfg_attr(
        not(feature = "campaign"),
        expect(unused_variables, reason = "only a station has processes in a domain")
    )]
    pub fn run(self, domain: &Domain) -> Result<(), Failure> {
        match self.what {
            What::Campaign(campaign) => campaign.run(),
            What::Run(run) => run.run(),
            #[cfg(feature = "campaign")]
            What::Station(station) => station.run(domain),
            #[cfg(feature = "campaign")]
            What::StationPart(part) => part.run(domain.clone()),
        }
    }
}

impl Campaign {
    fn run(self) -> Result<(), Failure> {
        let mut truth = self.common.truth()?;
        if let Some(tilt) = self.tilt {
            truth.tilt_rad = tilt.map(arcsec);
        }
        let (chain, mut noise) = self.common.chain_and_noise(&truth, self.telemetry_every)?;
        noise.positioning_rad = arcsec(self.positioning);
        let plan = Plan {
            set_points_c: self.set_points.0,
            soak_s: self.soak.as_secs_f64(),
            dwell_s: self.dwell.as_secs_f64(),
            interval_ns: self.interval.as_nanos() as u64,
            positions: self.positions.positions(),
            chain,
            noise,
            ..Plan::default()
        };
        reachable(&truth, &chain, &plan.set_points_c)?;
        if self.interval > self.dwell {
            return Err(usage("the interval is longer than the dwell; no row would fit"));
        }
        let step_c = plan.set_points_c.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        if step_c / plan.ramp_c_per_s >= plan.soak_s {
            return Err(usage("the chamber would still be ramping when the soak ends; give a longer --soak"));
        }
        let Common { output, seed, .. } = &self.common;
        let rows = simulation::campaign(&truth, &plan, *seed)
            .map(|row| (format!("{},{}", row.set_point_c, row.position), row.raw));
        let telemetry_ns = chain.telemetry_s > 0.0;
        write_rows(output, "samples.csv", "set_point_c,position", telemetry_ns, plan.rows(), rows)?;
        write_truth(output, &truth, "isotherm simulate campaign", *seed, &plan)?;
        let content = truth.table.content();
        let unit = &content.temperature_unit;
        let text =
            campaign_toml(&content.imu, "samples.csv", content.gravity, truth.gravity_local, unit, &plan.positions);
        write_text(output, "campaign.toml", &text)
    }
}

impl Run {
    fn run(self) -> Result<(), Failure> {
        let truth = self.common.truth()?;
        let (chain, noise) = self.common.chain_and_noise(&truth, self.telemetry_every)?;
        let [from_c, to_c] = self.temperatures;
        let run = simulation::Run {
            direction: self.attitude,
            from_c,
            to_c,
            ramp_c_per_s: self.ramp / 3600.0,
            hold_s: self.hold.as_secs_f64(),
            interval_ns: self.interval.as_nanos() as u64,
            chain,
            noise,
        };
        reachable(&truth, &chain, &self.temperatures)?;
        #[derive(Serialize)]
        struct Schedule<'a> {
            /// \[g0\]
            specific_force: [f64; AXES],
            #[serde(flatten)]
            run: &'a simulation::Run,
        }
        let schedule = Schedule { specific_force: run.specific_force(&truth), run: &run };
        let Common { output, seed, .. } = &self.common;
        let rows = simulation::run(&truth, &run, *seed).map(|raw| ("", raw));
        write_rows(output, "run.csv", "", chain.telemetry_s > 0.0, run.samples(), rows)?;
        write_truth(output, &truth, "isotherm simulate run", *seed, &schedule)
    }
}

impl Common {
    pub(super) fn truth(&self) -> Result<Truth, Failure> {
        let refused = |refusals: Vec<Refusal>| {
            let refusals: Vec<_> = refusals.iter().map(Refusal::to_string).collect();
            Failure::new(Exit::Config, format!("the truth cannot be a table: {}", refusals.join("; ")))
        };
        let given = match &self.truth {
            Some(path) => load_table(path, None, Guard::Lax)?.0,
            None => {
                let paper = CoefficientTable::from_toml(PAPER, None);
                paper.map_err(|faults| Failure::new(Exit::Failed, format!("the embedded table: {faults}")))?
            }
        };
        let mut content = given.content().clone();
        if let Some(imu) = &self.imu {
            content.imu = imu.clone();
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
        Ok(Truth { gravity_local: self.gravity_local.unwrap_or(truth.gravity_local), ..truth })
    }

    /// The telemetry is in the truth's unit; the positioning error, which a run does not have, is 0.
    pub(super) fn chain_and_noise(&self, truth: &Truth, telemetry_every: f64) -> Result<(Chain, Noise), Failure> {
        let volts = Chain::default();
        let (mut chain, telemetry_noise) = match truth.table.content().temperature_unit.as_str() {
            "V" => (volts, Noise::default().telemetry),
            "degC" => {
                let lsb = (f64::from(volts.telemetry_lsb_micro) / volts.telemetry_slope) as u32;
                let degrees = Chain { telemetry_zero: 0.0, telemetry_slope: 1.0, telemetry_lsb_micro: lsb, ..volts };
                (degrees, Noise::default().telemetry / volts.telemetry_slope)
            }
            unit => return Err(usage(format!("the truth's telemetry is in {unit}; V and degC can be simulated"))),
        };
        chain.telemetry_lsb_micro = self.telemetry_lsb.unwrap_or(chain.telemetry_lsb_micro);
        chain.telemetry_s = telemetry_every;
        [chain.vibration_g0, chain.vibration_hz] = self.vibration;
        let [bias_ug0, scale_factor_ppm] = self.repeatability;
        let noise = Noise {
            sensor_g0: self.sensor_noise / 1e6,
            telemetry: self.telemetry_noise.unwrap_or(telemetry_noise),
            bias_g0: bias_ug0 / 1e6,
            scale_factor: scale_factor_ppm / 1e6,
            ..Noise::NONE
        };
        Ok((chain, noise))
    }
}

pub(super) fn usage(message: impl Into<String>) -> Failure {
    Failure::new(Exit::Usage, message)
}

/// Refuses chamber temperatures at which the truth says nothing.
fn reachable(truth: &Truth, chain: &Chain, temperatures_c: &[f64]) -> Result<(), Failure> {
    let low = temperatures_c.iter().copied().fold(f64::INFINITY, f64::min);
    let high = temperatures_c.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    match truth.outside(chain, low, high) {
        None => Ok(()),
        Some(place) => Err(usage(format!("the chamber would leave the truth: {place}"))),
    }
}

/// Writes `rows` into `name`, with a bar on a terminal.
fn write_rows(
    folder: &Path,
    name: &str,
    leading: &str,
    telemetry_ns: bool,
    count: u64,
    rows: impl Iterator<Item = (impl Display, RawSample)>,
) -> Result<(), Failure> {
    if count > MAX_ROWS {
        return Err(usage(format!("{count} rows; up to {MAX_ROWS} can be simulated, give a longer interval")));
    }
    fs::create_dir_all(folder).map_err(|error| Failure::io("making", folder, &error))?;
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {elapsed} elapsed, {eta} left");
    // Draws on stderr, and only if that is a terminal.
    let bar = ProgressBar::new(count).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    write_file(folder, name, |sink| {
        let mut writer = RawWriter::new(sink, leading, telemetry_ns)?;
        for (index, (leading, raw)) in (0u64..).zip(rows) {
            if index.is_multiple_of(BAR_ROWS) {
                bar.set_position(index);
            }
            writer.write(leading, &raw)?;
        }
        bar.finish_and_clear();
        Ok(())
    })
}

pub(super) fn write_truth(
    folder: &Path,
    truth: &Truth,
    command: &str,
    seed: u64,
    schedule: &impl Serialize,
) -> Result<(), Failure> {
    let tool = format!("{command} {}", env!("CARGO_PKG_VERSION"));
    let text = truth.to_toml(&tool, seed, schedule);
    let text = text.map_err(|error| Failure::new(Exit::Failed, format!("writing the truth: {error}")))?;
    write_text(folder, "truth.toml", &text)
}

pub(super) fn write_text(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    write_file(folder, name, |sink| sink.write_all(text.as_bytes()))
}

/// Writes `folder/name` aside, makes it visible and says so.
fn write_file(folder: &Path, name: &str, write: impl FnOnce(&mut Output) -> io::Result<()>) -> Result<(), Failure> {
    let path = folder.join(name);
    let result = Output::create(Some(&path)).and_then(|mut sink| {
        write(&mut sink)?;
        sink.finish()
    });
    result.map_err(|error| Failure::io("writing", &path, &error))?;
    written(None, writeln!(io::stdout(), "{}", path.display()))
}

fn arcsec(angle: f64) -> f64 {
    (angle / 3600.0).to_radians()
}
