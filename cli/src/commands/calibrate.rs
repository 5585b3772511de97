//! `calibrate`: makes a coefficient table from a campaign.

mod arguments;
mod batch;
mod gravity_only;

use super::common::{Refused, or_document};
use crate::commands::calibrate::arguments::{Excluded, PolynomialOrder, Results};
use crate::progress::{bytes_bar, spinner};
pub(super) use arguments::Calibrate;
use isotherm_calibration::{
    AlignmentChoice, CalibrationError, CalibrationOptions, CampaignSource, Measurements, RampRecording, calibrate,
    calibrate_ramps, name, now, observable, read_measurements, sealed_ramp_table, sealed_table, sha256, tool,
};
use isotherm_campaign::{Campaign, IMU};
use isotherm_client::ImuId;
use isotherm_failure::{Exit, Failure, printable, tell};
use isotherm_files::{LoadError, StagedText, WorldWritable, load_table, print_data, read_text};
use isotherm_recording_formats::read::{ImuChoice, Places, Recording, RowKind};
use isotherm_report as report;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

impl Calibrate {
    pub(crate) fn run(self) -> Result<(), Failure> {
        or_document(self.json, self.make_tables())?
    }

    /// Makes the table, or those of a batch. The inner result tells which IMUs of a batch were dropped; what is printed
    /// has them too.
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

    /// Makes the table of one IMU and writes it. `text` is that of the campaign file, if there is one. The inner result
    /// tells whether the samples give a table; the outer one fails if the command line is wrong, or if the table cannot
    /// be written.
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
    let measurements = read_measurements(campaign, &mut rows);
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
