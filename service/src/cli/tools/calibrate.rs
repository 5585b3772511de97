use super::{Aside, apart};
use crate::failure::{Exit, Failure};
use crate::files::{Guard, TableFileError, open_recording, read_text};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use isotherm_calibration::calibrate::{
    Calibration, CalibrationError, Method, Options, QUANTITIES, calibrate, observable,
};
use isotherm_calibration::campaign::{Campaign, Dwell, read};
use isotherm_calibration::checks::{Finding, Severity};
use isotherm_calibration::provenance::{Hashed, Source, provenance, sha256};
use isotherm_calibration::report::calibration::html;
use isotherm_shared::recording::CampaignReader;
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable};
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Make a coefficient table from a campaign in the temperature chamber
///
/// Checks the samples, reduces every set point, chooses the orders, fits, and writes a sealed table with its provenance. What
/// the positions cannot observe is refused, never guessed.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm calibrate campaign.toml -o imu-a.toml --report imu-a.html\n  isotherm calibrate campaign.toml -o imu-a.toml --order 3 --method two-stage --exclude -25/3"
)]
pub struct Calibrate {
    /// Campaign file; it names the samples
    #[arg(value_name = "CAMPAIGN.toml")]
    campaign: PathBuf,
    /// Where the table goes; - is stdout
    #[arg(short, long, value_name = "TABLE.toml")]
    output: PathBuf,
    /// Where the report goes (HTML)
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
    /// Order of every polynomial, 0 to 7; auto chooses each from the data
    #[arg(long, value_name = "auto|N", default_value = "auto", allow_negative_numbers = true, value_parser = order)]
    order: Order,
    /// All dwells at once, each with its own telemetry; or each set point first, then polynomials
    #[arg(long, value_name = "one-stage|two-stage", default_value = "one-stage", value_parser = method)]
    method: Method,
    /// Give the table an alignment matrix, from the misalignments
    #[arg(long)]
    alignment: bool,
    /// Leave a dwell out: set point in degC and number of the position; may be repeated
    #[arg(long, value_name = "SET_POINT/POSITION", allow_hyphen_values = true, value_parser = place)]
    exclude: Vec<(f64, u32)>,
}

#[derive(Clone, Copy, Debug)]
enum Order {
    Auto,
    Fixed(usize),
}

fn order(text: &str) -> Result<Order, String> {
    match text.parse() {
        _ if text == "auto" => Ok(Order::Auto),
        Ok(order @ 0..=7) => Ok(Order::Fixed(order)),
        _ => Err("give auto or an order from 0 to 7".to_owned()),
    }
}

fn method(text: &str) -> Result<Method, String> {
    let found = Method::NAMES.iter().find(|(_, name)| *name == text);
    found.map(|(method, _)| *method).ok_or_else(|| "give one-stage or two-stage".to_owned())
}

fn place(text: &str) -> Result<(f64, u32), String> {
    let place = text.split_once('/').and_then(|(set_point, position)| {
        let set_point: f64 = set_point.trim().parse().ok()?;
        Some((set_point, position.trim().parse().ok()?)).filter(|_| set_point.is_finite())
    });
    place.ok_or_else(|| "give SET_POINT/POSITION, for example -25/3".to_owned())
}

impl Calibrate {
    /// With every default.
    #[cfg(feature = "campaign")]
    pub fn of(campaign: &Path, output: &Path, report: &Path, alignment: bool) -> Self {
        Self {
            campaign: campaign.to_owned(),
            output: output.to_owned(),
            report: Some(report.to_owned()),
            order: Order::Auto,
            method: Method::OneStage,
            alignment,
            exclude: Vec::new(),
        }
    }

    pub fn run(self) -> Result<(), Failure> {
        self.calibrate().map(drop)
    }

    /// What has been written.
    pub fn calibrate(self) -> Result<Calibration, Failure> {
        let (text, campaign) = load_campaign(&self.campaign)?;
        let samples = self.campaign.parent().unwrap_or(Path::new("")).join(&campaign.samples);
        let inputs = [(self.campaign.as_path(), "the campaign file"), (&samples, "the samples")];
        apart(&inputs, &[Some(&self.output), self.report.as_deref()])?;
        // Before minutes are spent on reading.
        let refused = |error: &CalibrationError| failure(&self.campaign, &self.campaign, error);
        observable(&campaign).map_err(|error| refused(&error))?;
        // Both files, or none.
        let table = Aside::create(Some(&self.output))?;
        let report = self.report.as_deref().map(|path| Aside::create(Some(path))).transpose()?;
        let (dwells, samples_sha256) = read_samples(&campaign, &samples)?;
        let options = Options {
            method: self.method,
            order: match self.order {
                Order::Auto => None,
                Order::Fixed(order) => Some(order),
            },
            alignment: self.alignment,
            exclude: self.exclude.clone(),
        };
        let spinner = spinner("fitting");
        let calibration = calibrate(&campaign, dwells, options);
        spinner.finish_and_clear();
        let calibration = calibration.map_err(|error| failure(&self.campaign, &samples, &error))?;
        let source = Source {
            tool: tool(),
            time: now(),
            campaign: self.campaign.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            campaign_sha256: sha256(text.as_bytes()),
            samples_sha256,
        };
        let sealed = sealed(&campaign, &calibration, &source)?;
        for finding in &calibration.findings {
            let _ = writeln!(io::stderr(), "isotherm: warning: {}", located(&samples, finding));
        }
        let _ = io::stderr().write_all(summary(&calibration).as_bytes());
        let report = report.map(|report| report.write(&html(&campaign, &calibration, &source))).transpose()?;
        let table = table.write(&sealed)?;
        report.map_or(Ok(()), Aside::finish)?;
        table.finish()?;
        Ok(calibration)
    }
}

/// A campaign file with its text.
pub fn load_campaign(path: &Path) -> Result<(String, Campaign), Failure> {
    let (text, _) = read_text(path, Guard::Lax)?;
    let campaign = Campaign::from_toml(&text);
    let campaign = campaign.map_err(|faults| TableFileError::Refused { path: path.to_owned(), faults })?;
    Ok((text, campaign))
}

/// This program, for provenance.
pub fn tool() -> String {
    format!("isotherm {}", env!("CARGO_PKG_VERSION"))
}

/// The time to the second, RFC 3339 in UTC.
pub fn now() -> String {
    let now = jiff::Timestamp::now();
    now.round(jiff::Unit::Second).unwrap_or(now).to_string()
}

/// The samples of `campaign` and their SHA-256.
fn read_samples(campaign: &Campaign, path: &Path) -> Result<(Vec<Dwell>, String), Failure> {
    let source = open_recording(path).map_err(|error| Failure::io("opening the samples", path, &error))?;
    let bar = bytes_bar(path, "reading");
    let mut hashed = Hashed::new(bar.wrap_read(source));
    let failed = |error| Failure::recording(path, &error);
    let dwells = CampaignReader::new(&mut hashed).and_then(|rows| read(campaign, rows));
    bar.finish_and_clear();
    let dwells = dwells.map_err(failed)?;
    if dwells.is_empty() {
        return Err(Failure::new(Exit::Data, format!("{}: no rows; a campaign needs dwells", path.display())));
    }
    Ok((dwells, hashed.finish().1))
}

/// A progress bar over the bytes of a file; on stderr, and only if that is a terminal.
pub fn bytes_bar(path: &Path, what: &'static str) -> ProgressBar {
    if path == Path::new("-") {
        return ProgressBar::hidden();
    }
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let style = ProgressStyle::with_template("{msg} {bar:40} {bytes} of {total_bytes}, {eta} left");
    let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr_with_hz(10));
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())).with_message(what)
}

/// A sign of life during long work; on stderr, and only if that is a terminal.
pub fn spinner(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10)).with_message(what);
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

fn located(samples: &Path, finding: &Finding) -> String {
    match finding.line {
        Some(line) => format!("{}:{line}: {finding}", samples.display()),
        None => finding.to_string(),
    }
}

fn failure(campaign: &Path, samples: &Path, error: &CalibrationError) -> Failure {
    let exit = match error {
        CalibrationError::Positions(_) => Exit::Config,
        CalibrationError::NothingToExclude(..) => Exit::Usage,
        CalibrationError::Fit(_) | CalibrationError::Table(_) => Exit::Failed,
        CalibrationError::Faults(_) | CalibrationError::SetPoint { .. } | CalibrationError::Order { .. } => Exit::Data,
    };
    let message = match error {
        CalibrationError::Faults(findings) => {
            let line = |finding: &Finding| {
                let warning = if finding.severity == Severity::Warning { "warning: " } else { "" };
                format!("{warning}{}", located(samples, finding))
            };
            findings.iter().map(line).collect::<Vec<_>>().join("\n")
        }
        CalibrationError::NothingToExclude(..) => format!("--exclude: {error}"),
        CalibrationError::Positions(deficiencies) => {
            let line = |deficiency: &String| format!("{}: {deficiency}", campaign.display());
            deficiencies.iter().map(line).collect::<Vec<_>>().join("\n")
        }
        _ => format!("{}: {error}", samples.display()),
    };
    Failure::new(exit, message)
}

/// The table's text with its provenance, read back before it is believed.
fn sealed(campaign: &Campaign, calibration: &Calibration, source: &Source) -> Result<String, Failure> {
    let failed = |cause: String| Failure::new(Exit::Failed, format!("writing the table: {cause}"));
    let section = provenance(campaign, calibration, source).map_err(|error| failed(error.to_string()))?;
    let text = format!("{}\n{section}", calibration.table.to_toml());
    match CoefficientTable::from_toml(&text, Some(&campaign.imu)) {
        Ok(table) if table == calibration.table => Ok(text),
        Ok(_) => Err(failed("it does not read back the same".to_owned())),
        Err(faults) => Err(failed(faults.to_string())),
    }
}

/// What a person wants to know at once.
fn summary(calibration: &Calibration) -> String {
    let mut text = format!(
        "{} dwells at {} set points, {} fit, digest {}\n\n  curve                       order  leave-one-set-point-out rms    residual sd  why\n",
        calibration.dwells.len(),
        calibration.set_points.len(),
        calibration.options.method.name(),
        calibration.table.digest(),
    );
    // Writing to a String cannot fail.
    for (axis, tables) in calibration.orders.iter().enumerate() {
        for (quantity, orders) in tables.iter().enumerate() {
            let fit = &orders.regression.fits()[orders.choice.order];
            let size = fit.coefficients.first().map_or(1.0, |c| c.abs());
            let (factor, unit) = if quantity == 0 { (1e6, "ug0") } else { (1e6 / size, "ppm") };
            let _ = writeln!(
                text,
                "  {} {:22}  {:5}  {:>23.3} {unit}  {:>9.3} {unit}  {}",
                AXIS_NAMES[axis],
                QUANTITIES[quantity],
                orders.choice.order,
                fit.leave_one_out_rms.unwrap_or(f64::NAN) * factor,
                fit.residual_sd.unwrap_or(f64::NAN) * factor,
                orders.choice.reason.split(';').next().unwrap_or_default()
            );
        }
    }
    for (axis, part) in calibration.solution.axes.iter().enumerate() {
        let error = part.misalignment_error.unwrap_or([f64::NAN; 2]);
        let _ = writeln!(
            text,
            "  {} misalignment onto {} {:.3} +- {:.3}, onto {} {:.3} +- {:.3} [1e-6 rad]; residuals {:.3}e-6 g0 rms",
            AXIS_NAMES[axis],
            AXIS_NAMES[(axis + 1) % 3],
            part.misalignment[0] * 1e6,
            error[0] * 1e6,
            AXIS_NAMES[(axis + 2) % 3],
            part.misalignment[1] * 1e6,
            error[1] * 1e6,
            calibration.residual_sd(axis) * 1e6
        );
    }
    if let Some([x, y]) = calibration.solution.tilt {
        let _ = writeln!(text, "  base tilted by {:.2} and {:.2} [1e-6 rad] about X and Y", x * 1e6, y * 1e6);
    }
    text
}
