//! `calibrate`: makes a coefficient table from a campaign.

use super::common::{Refused, inputs, or_document};
use crate::progress::{bytes_bar, spinner};
use clap::Args;
use isotherm_calibration::alignment::AlignmentChoice;
use isotherm_calibration::calibrate::{CalibrationOptions, Method};
use isotherm_calibration::campaign::Campaign;
use isotherm_calibration::checks::name;
use isotherm_calibration::gyroscopes::{Measurements, calibrate, observable, read};
use isotherm_calibration::provenance::{CampaignSource, now, sealed_table, sha256, tool};
use isotherm_calibration::report;
use isotherm_failure::{Exit, Failure, printable, tell};
use isotherm_files::{LoadError, StagedText, WorldWritable, print_data, read_text, refuse_overlap};
use isotherm_recording_formats::read::{ImuChoice, Places, Recording, RowKind};
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Make a coefficient table from a campaign in the temperature chamber
///
/// Checks the samples, reduces every set point, chooses the orders, fits, and writes a sealed table with its provenance. What
/// the positions cannot observe is refused, never guessed. A campaign with turns gives the gyroscopes too.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm calibrate campaign.toml -o imu-a.toml --report imu-a.html\n  isotherm calibrate campaign.toml -o imu-a.toml --order 3 --method two-stage --exclude -25/3"
)]
pub struct Calibrate {
    /// Campaign file; it names the samples
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
    /// Order of every polynomial, 0 to 7; auto chooses each from the data
    #[arg(long, value_name = "auto|N", default_value = "auto", allow_negative_numbers = true, value_parser = order)]
    order: PolynomialOrder,
    /// one-stage fits all dwells at once, each with its own telemetry; two-stage fits each set point first, then the polynomials
    #[arg(long, value_name = "one-stage|two-stage", default_value = "one-stage", value_parser = method)]
    method: Method,
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
    /// Leave a dwell or a turn out: set point in degC and number of the position or turn; may be repeated
    #[arg(long, value_name = "SET_POINT/NUMBER", allow_hyphen_values = true, value_parser = place)]
    exclude: Vec<(f64, u32)>,
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

fn place(text: &str) -> Result<(f64, u32), String> {
    let place = text.split_once('/').and_then(|(set_point, number)| {
        let set_point: f64 = set_point.trim().parse().ok()?;
        Some((set_point, number.trim().parse().ok()?)).filter(|_| set_point.is_finite())
    });
    place.ok_or_else(|| "give SET_POINT/NUMBER, for example -25/3".to_owned())
}

impl Calibrate {
    pub fn run(self) -> Result<(), Failure> {
        or_document(self.json, self.make_table())
    }

    fn make_table(self) -> Result<(), Refused> {
        if self.json && self.output == Path::new("-") {
            let message = "--json and -o - both go to stdout; give the table a file";
            return Err(Failure::new(Exit::Usage, message).into());
        }
        let (text, _) = read_text(&self.campaign, WorldWritable::Allow)?;
        let campaign = Campaign::from_toml(&text);
        let campaign = campaign.map_err(|faults| LoadError::Refused { path: self.campaign.clone(), faults })?;
        let folder = self.campaign.parent().unwrap_or(Path::new(""));
        let samples = match self.samples.is_empty() {
            true => campaign.samples.iter().map(|name| folder.join(name)).collect(),
            false => self.samples.clone(),
        };
        let mut files = inputs(&samples);
        files.push((&self.campaign, "the campaign file"));
        refuse_overlap(&files, &[Some(&self.output), self.report.as_deref()])?;
        let first = samples.first().unwrap_or(&self.campaign);
        // Checked first, because reading may take minutes.
        observable(&campaign).map_err(|error| error.failure(&self.campaign, first, |line| line.to_string()))?;
        // Both files are created before the fit, so that either both are written or none.
        let table = StagedText::create(Some(&self.output))?;
        let page = self.report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let (measurements, places, samples_sha256) = read_samples(&campaign, &samples)?;
        let locate = |line| places.locate(line);
        let accept: Vec<_> = self.accept.into_iter().chain(self.other_device.then_some(name::OTHER_DEVICE)).collect();
        let options = CalibrationOptions {
            method: self.method,
            order: match self.order {
                PolynomialOrder::Auto => None,
                PolynomialOrder::Fixed(order) => Some(order),
            },
            alignment: AlignmentChoice::of(self.alignment, self.no_alignment),
            exclude: self.exclude,
            accept: accept.clone(),
            strict: self.strict,
        };
        let spinner = spinner("fitting");
        let calibration = calibrate(&campaign, measurements, options);
        spinner.finish_and_clear();
        let calibration = calibration.map_err(|error| {
            let mut failure = error.failure_with(&self.campaign, first, locate, self.verbose);
            let left = error.acceptable();
            if !accept.is_empty() && !left.is_empty() {
                let all: Vec<_> = accept.iter().chain(&left).copied().collect();
                let _ = write!(
                    failure.message,
                    "\nthese faults must be accepted too, for a table in spite of all: --accept {}",
                    all.join(",")
                );
            }
            Refused { document: report::json::refusal(&error, &failure, locate), failure }
        })?;
        let source = CampaignSource {
            tool: tool(),
            time: now(),
            campaign: self.campaign.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            campaign_sha256: sha256(text.as_bytes()),
            samples_sha256,
        };
        let sealed = sealed_table(&campaign, &calibration, &source);
        let sealed = sealed.map_err(|message| Failure::new(Exit::Failed, message))?;
        for finding in &calibration.findings {
            tell("isotherm", finding.tagged(locate));
        }
        if !self.json {
            let _ = io::stderr().write_all(printable(&report::text::calibration(&calibration)).as_bytes());
        }
        let html = || report::calibration::html(&campaign, &calibration, &source);
        let mut texts = vec![table.write(&sealed)?];
        texts.extend(page.map(|page| page.write(&html())).transpose()?);
        StagedText::finish_together(texts)?;
        if self.json {
            print_data(&format!("{:#}\n", report::json::calibration(&calibration, locate)))?;
        }
        Ok(())
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
