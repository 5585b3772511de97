//! Arguments of `calibrate`, and what it prints.

use crate::commands::common::{Acceptance, ForeignArgs};
use crate::commands::export::ParameterArgs;
use crate::commands::part::PartArgs;
use crate::parse::{gravity, height, lag_choice, latitude, numbers, seconds};
use clap::{ArgGroup, Args};
use isotherm_autopilot::Autopilot;
use isotherm_client::ImuId;
use isotherm_fit::{LagChoice, Method, ScaleFactorChoice};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

/// Make a coefficient table from a campaign in the temperature chamber
///
/// Checks the samples, reduces every set point, chooses the orders, fits, and writes a sealed table with its
/// provenance. What the positions cannot observe is refused, never guessed. A campaign with turns gives the gyroscopes
/// too. Ramps give the lag of the sensing elements behind their telemetry, and transients of the biases where they show
/// them; ramps alone also the bias curves at one attitude.
///
/// Without a turntable: with --gravity-only, recordings of an IMU that was put down by hand in many attitudes take the
/// place of the campaign. The standstills in them are found, and the length of gravity is the reference. With
/// --one-attitude, recordings or logs of an IMU that warms up give the bias curves over temperature.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm calibrate campaign.toml -o imu-a.toml --report imu-a.html\n  isotherm calibrate campaign.toml -o imu-a.toml --order 3 --method two-stage --exclude -25/3\n  isotherm calibrate ramps.toml -o imu-a.toml --lag 240\n  isotherm calibrate --propose measured/ -o campaign.toml\n  isotherm calibrate campaign.toml -o 'tables/{imu}.toml' --batch batch.html\n  isotherm calibrate --one-attitude warm-up.ulg --imu imu-b -o imu-b.toml --export px4=imu-b.params\n  isotherm calibrate --one-attitude warm-up.BIN --imu my-drone -o 'my-drone-{instance}.toml' --export ardupilot=my-drone.parm\n  isotherm calibrate --gravity-only cold.csv warm.csv --imu imu-b --gravity-local 9.8123 --gravity-reference 9.80665 --temperature-unit degC -o imu-b.toml"
)]
pub(crate) struct Calibrate {
    /// Campaign file; it names the samples. With --gravity-only or --one-attitude: a recording
    #[arg(value_name = "CAMPAIGN.toml", required_unless_present = "propose")]
    pub(super) campaign: Option<PathBuf>,
    /// Samples (CSV, Parquet, MCAP), or the pieces of one recording in any order [default: those that the campaign file
    /// names]
    #[arg(value_name = "SAMPLES")]
    pub(super) samples: Vec<PathBuf>,
    /// Where the table goes; - is stdout. Of a log with several IMUs a folder, or a name with {instance} in it
    #[arg(short, long, value_name = "TABLE.toml", required_unless_present = "propose")]
    pub(super) output: Option<PathBuf>,
    /// Write the campaign file that the files in a folder would have, a file for each position at each set point, or a
    /// sheet of means: to -o, or to stdout
    ///
    /// Names tell set points and positions, gravity tells accelerometers from telemetry. What the files do not say is
    /// "?" there, or a comment
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["campaign", "kind", "report", "batch", "json"])]
    pub(super) propose: Option<PathBuf>,
    /// Where the report goes (HTML)
    #[arg(long, value_name = "R.html")]
    pub(super) report: Option<PathBuf>,
    /// Where the report of a batch goes (HTML): the spread of its IMUs, and which one stands out
    ///
    /// For a campaign file with several IMUs. In -o and --report, {imu} stands for the name of each
    #[arg(long, value_name = "BATCH.html", conflicts_with = "gravity_only")]
    pub(super) batch: Option<PathBuf>,
    /// Order of every polynomial, 0 to 7; auto chooses each from the data
    #[arg(long, value_name = "auto|N", default_value = "auto", allow_negative_numbers = true, value_parser = order)]
    pub(super) order: PolynomialOrder,
    /// one-stage fits all dwells at once, each with its own telemetry; two-stage fits each set point first, then the
    /// polynomials [default: one-stage]
    #[arg(long, value_name = "one-stage|two-stage", value_parser = method)]
    pub(super) method: Option<Method>,
    /// Give the table an alignment matrix, from the misalignments [default: if one exceeds its 99 % interval and 1e-6
    /// rad]
    ///
    /// It turns the axes of the output onto those of the turntable; how the IMU sat on the fixture is part of it. With
    /// gyroscopes both triads get one, or neither
    #[arg(long, conflicts_with = "no_alignment")]
    pub(super) alignment: bool,
    /// Give the table no alignment matrix: outputs stay along the sensors' input axes
    #[arg(long)]
    pub(super) no_alignment: bool,
    /// Print one JSON document to stdout instead of the text to stderr, also of a failure
    #[arg(long)]
    pub(super) json: bool,
    /// Time constant of the lag behind the telemetry [s], for example that of a sister unit; or none, for a table
    /// without transients [default: found in the ramps]
    ///
    /// Given, it need not show itself in the ramps. A transient of a bias is still written only if it predicts the
    /// sweeps left out
    #[arg(long, value_name = "auto|S|none", value_parser = lag_choice)]
    pub(super) lag: Option<LagChoice>,
    /// Leave a dwell or a turn out: set point in degC and number of the position or turn; may be repeated.
    /// With --gravity-only: the number of a standstill
    #[arg(long, value_name = "SET_POINT/NUMBER", allow_hyphen_values = true, value_parser = excluded)]
    pub(super) exclude: Vec<Excluded>,
    #[command(flatten)]
    pub(super) part: PartArgs,
    #[command(flatten)]
    pub(super) acceptance: Acceptance,
    /// Make the table also of samples of another unit than the campaign file's serial number says; the same as --accept
    /// other-device
    #[arg(long)]
    pub(super) other_device: bool,
    /// Write the curves of ramps alone also where their error is not known, and those that they replace depend on
    /// temperature or have an error; the same as --accept one-direction
    #[arg(long)]
    pub(super) replace_curves: bool,
    /// List all faults and warnings of a refused campaign, not the first ten, also those that a diagnosis explains
    #[arg(short, long)]
    pub(super) verbose: bool,
    #[command(flatten)]
    pub(super) without_turntable: GravityOnlyArgs,
    #[command(flatten)]
    pub(super) at_one_attitude: OneAttitudeArgs,
    #[command(flatten)]
    pub(super) foreign: ForeignArgs,
}

impl Calibrate {
    /// The campaign file, or the first recording.
    pub(super) fn campaign(&self) -> &Path {
        self.campaign.as_deref().unwrap_or(Path::new(""))
    }

    /// Where the table goes.
    pub(super) fn output(&self) -> &Path {
        self.output.as_deref().unwrap_or(Path::new("-"))
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) enum PolynomialOrder {
    Auto,
    Fixed(usize),
}

fn order(text: &str) -> Result<PolynomialOrder, String> {
    match text.parse() {
        _ if text == "auto" => Ok(PolynomialOrder::Auto),
        Ok(order @ 0..=7) => Ok(PolynomialOrder::Fixed(order)),
        _ => Err("give auto or an order from 0 to 7".to_owned()),
    }
}

fn method(text: &str) -> Result<Method, String> {
    let found = Method::NAMES.iter().find(|(_, name)| *name == text);
    found.map(|(method, _)| *method).ok_or_else(|| "give one-stage or two-stage".to_owned())
}

/// What is left out of the fit.
#[derive(Clone, Copy, Debug)]
pub(super) enum Excluded {
    /// Set point \[degC\] and number of a position or a turn.
    Dwell(f64, u32),
    /// Number of a standstill.
    Standstill(usize),
}

fn excluded(text: &str) -> Result<Excluded, String> {
    if let Ok(number) = text.parse() {
        return Ok(Excluded::Standstill(number));
    }
    let place = text.split_once('/').and_then(|(set_point, number)| {
        let set_point: f64 = set_point.trim().parse().ok()?;
        Some(Excluded::Dwell(set_point, number.trim().parse().ok()?)).filter(|_| set_point.is_finite())
    });
    place.ok_or_else(|| {
        "give SET_POINT/NUMBER, for example -25/3; without a turntable the number of a standstill".to_owned()
    })
}

/// The options of a calibration without a turntable.
#[derive(Debug, Args)]
#[command(
    next_help_heading = "Without a turntable",
    group = ArgGroup::new("local").args(["gravity_local", "latitude"]).multiple(true)
)]
pub(super) struct GravityOnlyArgs {
    /// Calibrate the accelerometers by the length of gravity alone: the recordings are of an IMU that was put down by
    /// hand in many attitudes
    ///
    /// Each file is a recording of its own, or data of another program. A campaign file with method = "gravity-only"
    /// does the same, and has the next six options as keys
    #[arg(long, group = "kind", requires_all = ["imu", "local", "gravity_reference", "temperature_unit"])]
    pub gravity_only: bool,
    /// The IMU that was measured; of a campaign file with several, the only one whose table is made
    #[arg(long, value_name = "ID")]
    pub imu: Option<ImuId>,
    /// Gravity where the recordings were made [m/s2]
    #[arg(long, value_name = "G", requires = "gravity_only", value_parser = gravity)]
    pub gravity_local: Option<f64>,
    /// Geodetic latitude there, north positive [deg]: with --height it checks --gravity-local, or gives normal gravity,
    /// whose error of 102 ppm (95 %) is then in the scale factors
    #[arg(long, value_name = "DEG", requires_all = ["gravity_only", "height"], allow_hyphen_values = true, value_parser = latitude)]
    pub latitude: Option<f64>,
    /// Height above the sea there [m]
    #[arg(long, value_name = "M", requires_all = ["gravity_only", "latitude"], allow_hyphen_values = true, value_parser = height)]
    pub height: Option<f64>,
    /// The value of 1 g0 [m/s2]; it is written into the table [default with --one-attitude: 9.80665]
    #[arg(long, value_name = "G", requires = "kind", value_parser = gravity)]
    pub gravity_reference: Option<f64>,
    /// Unit of the telemetry; a label
    #[arg(long, value_name = "UNIT", requires = "gravity_only")]
    pub temperature_unit: Option<String>,
    /// single: K- = -K+; split: each a curve of its own; auto: single, unless split is significant and the attitudes
    /// allow it [default: auto]
    #[arg(long, value_name = "auto|single|split", value_parser = scale_factor)]
    pub scale_factor: Option<ScaleFactorChoice>,
    /// Estimate no misalignments: they stay in the errors, and the table gets no alignment matrix
    #[arg(long)]
    pub no_misalignment: bool,
    /// Length of the windows that standstills are searched with [s] [default: 0.5, and 1 if the noise is correlated
    /// over that]
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub window: Option<Duration>,
    /// Where a table of order 0 is valid, in the telemetry's unit; required if the telemetry is constant [default: the
    /// measured range]
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = range)]
    pub temperature_range: Option<[f64; 2]>,
}

/// The options of a calibration at one attitude.
#[derive(Debug, Args)]
#[command(next_help_heading = "At one attitude")]
pub(super) struct OneAttitudeArgs {
    /// Fit bias curves to recordings at one attitude while the IMU warms up or cools, as PX4 and ArduPilot do
    ///
    /// Recordings, or logs of autopilots and data of other programs: readings need no table. Their error is the band
    /// between heating and cooling. Of a log with several IMUs each gets a table: their names are that of --imu with
    /// the number of the log behind it. --report and --export are then for all together
    #[arg(long, group = "kind", requires = "imu", conflicts_with_all = ["batch", "method", "alignment", "no_alignment", "exclude"])]
    pub one_attitude: bool,
    /// The table that gives everything but the bias curves ({instance} in its name is the number in the log): of the
    /// attitudes, or the nominal one that convert --nominal writes [default: made of the readings' resolution]
    #[arg(long, value_name = "TABLE.toml", requires = "one_attitude")]
    pub nominal: Option<PathBuf>,
    /// Reference temperature: accelerometers keep the bias of the nominal table there [default: mid range]
    #[arg(long, value_name = "T", requires = "one_attitude", allow_negative_numbers = true, value_parser = crate::parse::number)]
    pub at: Option<f64>,
    /// Show what the cubics of autopilots leave on the same rows, or the parameters of a file, which are on board
    #[arg(long, value_name = "px4,ardupilot,FILE", requires = "one_attitude", value_delimiter = ',')]
    pub beside: Vec<Beside>,
    /// Write the biases as parameters of an autopilot, too; may be repeated. Orders are then 3 at most, and there is no
    /// lag unless it is given
    #[arg(long, value_name = "px4=FILE|ardupilot=FILE", requires = "one_attitude", value_parser = exported)]
    pub export: Vec<(Autopilot, PathBuf)>,
    #[command(flatten)]
    pub parameters: ParameterArgs,
}

/// What is shown beside the curves of a table.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) enum Beside {
    /// The cubic that an autopilot's own script would make.
    Cubic(Autopilot),
    /// The parameters in a file.
    Parameters(PathBuf),
}

impl FromStr for Beside {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(autopilot) => Ok(Self::Cubic(autopilot)),
            Err(_) if text.contains(['.', '/']) => Ok(Self::Parameters(PathBuf::from(text))),
            Err(error) => Err(format!("{error}, or a file of parameters, such as vehicle.params")),
        }
    }
}

fn exported(text: &str) -> Result<(Autopilot, PathBuf), String> {
    let (autopilot, file) =
        text.split_once('=').filter(|(_, file)| !file.is_empty()).ok_or("give px4=FILE or ardupilot=FILE")?;
    Ok((autopilot.parse()?, PathBuf::from(file)))
}

fn scale_factor(text: &str) -> Result<ScaleFactorChoice, String> {
    let found = ScaleFactorChoice::NAMES.iter().find(|(_, name)| *name == text);
    found.map(|(choice, _)| *choice).ok_or_else(|| "give auto, single or split".to_owned())
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let [low, high] = numbers::<2>(text)?;
    if low < high { Ok([low, high]) } else { Err("give the lower end first".to_owned()) }
}
