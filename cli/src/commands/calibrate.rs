//! `calibrate`: makes a coefficient table from a campaign.

mod batch;
mod gravity_only;

use super::common::{Refused, or_document};
use crate::progress::{bytes_bar, spinner};
use clap::Args;
use gravity_only::GravityOnlyArgs;
use isotherm_calibration::alignment::AlignmentChoice;
use isotherm_calibration::calibrate::{calibrate, observable};
use isotherm_calibration::checks::name;
use isotherm_calibration::error::CalibrationError;
use isotherm_calibration::gyroscopes::{Measurements, read};
use isotherm_calibration::options::{CalibrationOptions, Method};
use isotherm_calibration::provenance::{CampaignSource, now, sealed_ramp_table, sealed_table, sha256, tool};
use isotherm_calibration::ramps::calibrate_ramps;
use isotherm_calibration::transients::{LagChoice, RampRecording};
use isotherm_campaign::Campaign;
use isotherm_campaign::IMU;
use isotherm_client::ImuId;
use isotherm_failure::{Exit, Failure, printable, tell};
use isotherm_files::{LoadError, StagedText, WorldWritable, load_table, print_data, read_text};
use isotherm_recording_formats::read::{ImuChoice, Places, Recording, RowKind};
use isotherm_report as report;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Make a coefficient table from a campaign in the temperature chamber
///
/// Checks the samples, reduces every set point, chooses the orders, fits, and writes a sealed table with its provenance. What
/// the positions cannot observe is refused, never guessed. A campaign with turns gives the gyroscopes too. Ramps give the lag of the sensing
/// elements behind their telemetry, and transients of the biases where they show them; ramps alone also the bias curves at one attitude.
///
/// Without a turntable: with --gravity-only, recordings of an IMU that was put down by hand in many attitudes take the place of the campaign. The
/// standstills in them are found, and the length of gravity is the reference.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm calibrate campaign.toml -o imu-a.toml --report imu-a.html\n  isotherm calibrate campaign.toml -o imu-a.toml --order 3 --method two-stage --exclude -25/3\n  isotherm calibrate ramps.toml -o imu-a.toml --lag 240\n  isotherm calibrate campaign.toml -o 'tables/{imu}.toml' --batch batch.html\n  isotherm calibrate --gravity-only cold.csv warm.csv --imu imu-b --gravity-local 9.8123 --gravity-reference 9.80665 --temperature-unit degC -o imu-b.toml"
)]
pub struct Calibrate {
    /// Campaign file; it names the samples. With --gravity-only: a recording
    #[arg(value_name = "CAMPAIGN.toml")]
    campaign: PathBuf,
    /// Samples (CSV, Parquet, MCAP), or the pieces of one recording in any order [default: those that the campaign file names]
    #[arg(value_name = "SAMPLES")]
    samples: Vec<PathBuf>,
    /// Where the table goes; - is stdout
    #[arg(short, long, value_name = "TABLE.toml")]
    output: PathBuf,
    /// Where the report goes (HTML)
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
    /// Where the report of a batch goes (HTML): the spread of its IMUs, and which one stands out
    ///
    /// For a campaign file with several IMUs. In -o and --report, {imu} stands for the name of each
    #[arg(long, value_name = "BATCH.html", conflicts_with = "gravity_only")]
    batch: Option<PathBuf>,
    /// Order of every polynomial, 0 to 7; auto chooses each from the data
    #[arg(long, value_name = "auto|N", default_value = "auto", allow_negative_numbers = true, value_parser = order)]
    order: PolynomialOrder,
    /// one-stage fits all dwells at once, each with its own telemetry; two-stage fits each set point first, then the polynomials [default:
    /// one-stage]
    #[arg(long, value_name = "one-stage|two-stage", value_parser = method)]
    method: Option<Method>,
    /// Give the table an alignment matrix, from the misalignments [default: if one exceeds its 99 % interval and 1e-6 rad]
    ///
    /// It turns the axes of the output onto those of the turntable; how the IMU sat on the fixture is part of it. With gyroscopes both triads
    /// get one, or neither
    #[arg(long, conflicts_with = "no_alignment")]
    alignment: bool,
    /// Give the table no alignment matrix: outputs stay along the sensors' input axes
    #[arg(long)]
    no_alignment: bool,
    /// Print one JSON document to stdout instead of the text to stderr, also of a failure
    #[arg(long)]
    json: bool,
    /// Time constant of the lag behind the telemetry [s], for example that of a sister unit; or none, for a table without transients [default:
    /// found in the ramps]
    ///
    /// Given, it need not show itself in the ramps. A transient of a bias is still written only if it predicts the sweeps left out
    #[arg(long, value_name = "S|none", value_parser = lag)]
    lag: Option<LagChoice>,
    /// Leave a dwell or a turn out: set point in degC and number of the position or turn; may be repeated. With --gravity-only: the number of a
    /// standstill
    #[arg(long, value_name = "SET_POINT/NUMBER", allow_hyphen_values = true, value_parser = excluded)]
    exclude: Vec<Excluded>,
    /// Make the table in spite of a fault of this name, which stands in brackets in the fault's line; several with commas, or repeated. The
    /// names are written into the provenance
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = name::acceptable)]
    accept: Vec<&'static str>,
    /// Make the table also of samples of another unit than the campaign file's serial number says; the same as --accept other-device
    #[arg(long)]
    other_device: bool,
    /// Make no table if there is a warning that is not accepted
    #[arg(long)]
    strict: bool,
    /// List all faults and warnings of a refused campaign, not the first ten, also those that a diagnosis explains
    #[arg(short, long)]
    verbose: bool,
    #[command(flatten)]
    without_turntable: GravityOnlyArgs,
}

#[derive(Clone, Copy, Debug)]
enum PolynomialOrder {
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
enum Excluded {
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

pub(super) fn lag(text: &str) -> Result<LagChoice, String> {
    let lag_ns = crate::parse::lag(text)?;
    Ok(if lag_ns == 0 { LagChoice::None } else { LagChoice::Given(lag_ns as f64 / 1e9) })
}

/// What the samples gave, ready to be written.
struct Results {
    /// Text of the table file.
    table: String,
    /// Each warning as a line.
    warnings: Vec<String>,
    text: String,
    /// Empty without a report.
    html: String,
    json: Value,
}

impl Calibrate {
    pub fn run(self) -> Result<(), Failure> {
        or_document(self.json, self.make_tables())?
    }

    /// Makes the table, or those of a batch. The inner result tells which IMUs of a batch were dropped; what is printed has them too.
    fn make_tables(&self) -> Result<Result<(), Failure>, Refused> {
        if self.json && self.output == Path::new("-") {
            let message = "--json and -o - both go to stdout; give the table a file";
            return Err(Failure::new(Exit::Usage, message).into());
        }
        if let Some((campaign, recordings)) = self.described() {
            let results = self.make_table(&campaign, &recordings, None)??;
            return Ok(Ok(self.print_json(&results.json)?));
        }
        let (text, _) = read_text(&self.campaign, WorldWritable::Allow)?;
        let campaigns = Campaign::batch_from_toml(&text);
        let campaigns = campaigns.map_err(|faults| LoadError::Refused { path: self.campaign.clone(), faults })?;
        match (self.chosen(campaigns)?.as_slice(), &self.batch) {
            ([campaign], None) => {
                let results = self.make_table(campaign, &self.sample_files(campaign)?, Some(&text))??;
                Ok(Ok(self.print_json(&results.json)?))
            }
            (campaigns, _) => self.make_batch(campaigns, &text),
        }
    }

    /// Makes the table of one IMU and writes it. `text` is that of the campaign file, if there is one. The inner result tells whether the samples
    /// give a table; the outer one fails if the command line is wrong, or if the table cannot be written.
    fn make_table(
        &self,
        campaign: &Campaign,
        samples: &[PathBuf],
        text: Option<&str>,
    ) -> Result<Result<Results, Refused>, Refused> {
        self.refuse_overlaps(&[(campaign, samples)], text)?;
        // Both files are created before the fit, so that either both are written or none.
        let [output, report] = self.outputs(&campaign.imu);
        let table = StagedText::create(output.as_deref())?;
        let page = report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let fitted = match text {
            Some(text) if !campaign.gravity_only => self.of_campaign(campaign, samples, text),
            _ => self.of_recordings(campaign, samples, text),
        };
        match fitted {
            Ok(results) => Ok(Ok(self.write(results, table, page)?)),
            Err(refused) if refused.failure.exit == Exit::Usage => Err(refused),
            Err(refused) => Ok(Err(refused)),
        }
    }

    /// The table of one IMU on a turntable. `text` is that of the campaign file.
    fn of_campaign(&self, campaign: &Campaign, samples: &[PathBuf], text: &str) -> Result<Results, Refused> {
        self.without_turntable.refuse_options()?;
        let (ramp_files, curves_file) = (self.ramp_files(campaign), self.curves_file(campaign));
        let first = samples.first().unwrap_or(&self.campaign);
        let curves = curves_file.as_ref().map(|path| load_table(path, Some(&campaign.imu), WorldWritable::Allow));
        let curves = curves.transpose()?.map(|(table, _)| table);
        if curves.is_none() {
            // Checked first, because reading may take minutes.
            observable(campaign).map_err(|error| error.failure(&self.campaign, first, |line| line.to_string()))?;
        }
        let (mut measurements, places, samples_sha256) = match &curves {
            Some(_) => <_>::default(),
            None => read_samples(campaign, samples)?,
        };
        let (recordings, ramps_sha256) = read_ramps(campaign, &ramp_files)?;
        let locate = |line| places.locate(line);
        let options = self.options()?;
        let source = CampaignSource {
            tool: tool(),
            time: now(),
            campaign: self.campaign.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            campaign_sha256: sha256(text.as_bytes()),
            samples_sha256,
            ramps_sha256,
        };
        let refused = |error: CalibrationError| self.refused(&error, first, locate);
        let failed = |message| Failure::new(Exit::Failed, message);
        let spinner = spinner("fitting");
        if let Some(curves) = &curves {
            let fitted = calibrate_ramps(campaign, &recordings, curves, options);
            spinner.finish_and_clear();
            let fitted = fitted.map_err(refused)?;
            let html = || report::ramps::html(campaign, &fitted, &source);
            Ok(Results {
                table: sealed_ramp_table(campaign, &fitted, &source).map_err(failed)?,
                text: report::text::ramps(&fitted),
                html: self.report.as_ref().map_or_else(String::new, |_| html()),
                json: report::json::ramps(&fitted, locate),
                warnings: fitted.findings.iter().map(|finding| finding.tagged(locate)).collect(),
            })
        } else {
            measurements.ramps = recordings;
            let fitted = calibrate(campaign, measurements, options);
            spinner.finish_and_clear();
            let fitted = fitted.map_err(refused)?;
            let html = || report::calibration::html(campaign, &fitted, &source);
            Ok(Results {
                table: sealed_table(campaign, &fitted, &source).map_err(failed)?,
                text: report::text::calibration(&fitted),
                html: self.report.as_ref().map_or_else(String::new, |_| html()),
                json: report::json::calibration(&fitted, locate),
                warnings: fitted.findings.iter().map(|finding| finding.tagged(locate)).collect(),
            })
        }
    }

    /// Writes the table and the report, and prints warnings and text.
    fn write(&self, results: Results, table: StagedText, page: Option<StagedText>) -> Result<Results, Refused> {
        for warning in &results.warnings {
            tell("isotherm", warning);
        }
        if !self.json {
            let _ = io::stderr().write_all(printable(&results.text).as_bytes());
        }
        let mut texts = vec![table.write(&results.table)?];
        texts.extend(page.map(|page| page.write(&results.html)).transpose()?);
        StagedText::finish_together(texts)?;
        Ok(results)
    }

    /// Prints the document of `--json`.
    fn print_json(&self, document: &Value) -> Result<(), Failure> {
        if self.json { print_data(&format!("{document:#}\n")) } else { Ok(()) }
    }

    /// Where table and report of an IMU go.
    fn outputs(&self, imu: &ImuId) -> [Option<PathBuf>; 2] {
        let named = |path: &Path| match path.to_str() {
            Some(text) => PathBuf::from(text.replace(IMU, imu.as_str())),
            None => path.to_owned(),
        };
        [Some(self.output.as_path()), self.report.as_deref()].map(|path| path.map(named))
    }

    /// The files of the samples: those that are given, or that the campaign file names.
    fn sample_files(&self, campaign: &Campaign) -> Result<Vec<PathBuf>, Failure> {
        match self.samples.is_empty() {
            true => Ok(campaign.samples.iter().map(|name| self.beside(name)).collect()),
            false if campaign.has_ramps_alone() => {
                let message =
                    "samples are for positions, and the campaign file has ramps alone; name them as [[ramp]] in it";
                Err(Failure::new(Exit::Usage, message))
            }
            false => Ok(self.samples.clone()),
        }
    }

    fn ramp_files(&self, campaign: &Campaign) -> Vec<PathBuf> {
        campaign.ramps.iter().map(|ramp| self.beside(&ramp.samples)).collect()
    }

    fn curves_file(&self, campaign: &Campaign) -> Option<PathBuf> {
        campaign.curves.as_ref().map(|name| self.beside(name))
    }

    /// A file that the campaign file names.
    fn beside(&self, name: &str) -> PathBuf {
        self.campaign.parent().unwrap_or(Path::new("")).join(name)
    }

    /// Names of the faults that are accepted.
    fn accepted(&self) -> Vec<&'static str> {
        self.accept.iter().copied().chain(self.other_device.then_some(name::OTHER_DEVICE)).collect()
    }

    fn options(&self) -> Result<CalibrationOptions, Failure> {
        let dwell = |excluded: &Excluded| match excluded {
            Excluded::Dwell(set_point_c, number) => Ok((*set_point_c, *number)),
            Excluded::Standstill(_) => {
                Err(Failure::new(Exit::Usage, "--exclude: give SET_POINT/NUMBER, for example -25/3"))
            }
        };
        Ok(CalibrationOptions {
            method: self.method.unwrap_or_default(),
            order: match self.order {
                PolynomialOrder::Auto => None,
                PolynomialOrder::Fixed(order) => Some(order),
            },
            alignment: AlignmentChoice::of(self.alignment, self.no_alignment),
            exclude: self.exclude.iter().map(dwell).collect::<Result<_, _>>()?,
            accept: self.accepted(),
            strict: self.strict,
            lag: self.lag.unwrap_or_default(),
            predecessor_lag_s: None,
        })
    }

    /// The failure that `error` is. `first` is the first file of the samples.
    fn refused(&self, error: &CalibrationError, first: &Path, locate: impl Fn(u64) -> String + Copy) -> Refused {
        let mut failure = error.failure_with(&self.campaign, first, locate, self.verbose);
        let (accept, left) = (self.accepted(), error.acceptable());
        if !accept.is_empty() && !left.is_empty() {
            let all: Vec<_> = accept.iter().chain(&left).copied().collect();
            let _ = write!(
                failure.message,
                "\nthese faults must be accepted too, for a table in spite of all: --accept {}",
                all.join(",")
            );
        }
        Refused { document: report::json::refusal(error, &failure, locate), failure }
    }
}

/// Reads the samples. Returns their dwells and turns, the places of their rows, and the SHA-256 of the files.
fn read_samples(campaign: &Campaign, paths: &[PathBuf]) -> Result<(Measurements, Places, String), Failure> {
    let bar = bytes_bar(paths, "reading");
    let choice = ImuChoice::Prefer(campaign.imu.clone());
    let mut rows = Recording::open_hashed(paths, RowKind::Campaign, choice, &bar)?;
    let measurements = read(campaign, &mut rows);
    bar.finish_and_clear();
    let measurements = measurements.map_err(|error| rows.failure(&error))?;
    let places = rows.places().clone();
    Ok((measurements, places, rows.sha256()?))
}

/// Reads the ramps. Returns them with the SHA-256 of each.
fn read_ramps(campaign: &Campaign, paths: &[PathBuf]) -> Result<(Vec<RampRecording>, Vec<String>), Failure> {
    let bar = bytes_bar(paths, "reading ramps");
    let (mut recordings, mut digests) = (Vec::new(), Vec::new());
    for path in paths {
        let choice = ImuChoice::Prefer(campaign.imu.clone());
        let mut rows = Recording::open_hashed(core::slice::from_ref(path), RowKind::Sample, choice, &bar)?;
        let recording = RampRecording::read(path.display().to_string(), &mut rows);
        recordings.push(recording.map_err(|error| rows.failure(&error))?);
        digests.push(rows.sha256()?);
    }
    bar.finish_and_clear();
    Ok((recordings, digests))
}
