//! `calibrate`: makes a coefficient table from a campaign.

mod arguments;
mod batch;
mod gravity_only;
mod one_attitude;
mod vehicle;

use super::common::or_document;
use crate::commands::calibrate::arguments::{Excluded, PolynomialOrder};
use crate::progress::{bytes_bar, spinner};
pub(super) use arguments::Calibrate;
use isotherm_campaign::{Campaign, IMU};
use isotherm_client::ImuId;
use isotherm_files::{StagedText, print_data};
use isotherm_fit::{AlignmentChoice, CalibrationOptions, TumbleOptions};
use isotherm_pipeline::{CampaignFile, FitOptions, Inputs, Made, Refused, Source, propose};
use isotherm_support::failure::{Exit, Failure, printable, tell};
use isotherm_support::finding::name;
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Set point \[degC\] and number of a dwell or turn that is left out.
type Dwell = (f64, u32);

/// A table that is made, and the files that it and its report go to.
struct Staged {
    made: Made,
    table: StagedText,
    page: Option<StagedText>,
}

impl Calibrate {
    pub(crate) fn run(self) -> Result<(), Failure> {
        if let Some(folder) = &self.propose {
            return self.write_proposal(folder);
        }
        or_document(self.json, self.make_tables())?
    }

    /// Writes the campaign file that the files of a folder would have.
    fn write_proposal(&self, folder: &Path) -> Result<(), Failure> {
        let output = self.output.as_deref().filter(|path| *path != Path::new("-"));
        let beside = output.and_then(Path::parent).unwrap_or(Path::new(""));
        let text = propose(folder, beside)?;
        match output {
            Some(path) => StagedText::create(Some(path))?.write(&text)?.finish(),
            None => print_data(&text),
        }
    }

    /// Makes the table, or those of a batch. The inner result tells which IMUs of a batch were dropped; what is printed
    /// has them too.
    fn make_tables(&self) -> Result<Result<(), Failure>, Refused> {
        if self.json && self.output() == Path::new("-") {
            let message = "--json and -o - both go to stdout; give the table a file";
            return Err(Failure::new(Exit::Usage, message).into());
        }
        if let (true, Some(imu)) = (self.at_one_attitude.one_attitude, &self.without_turntable.imu) {
            return self.make_at_one_attitude(imu);
        }
        if let Some((campaign, recordings)) = self.described() {
            let made = self.make_table(&campaign, &recordings, None)??;
            return Ok(Ok(self.print_json(&made.json())?));
        }
        let file = CampaignFile::read(self.campaign())?;
        match (self.chosen(file.campaigns()?)?.as_slice(), &self.batch) {
            ([campaign], None) => {
                let made = self.make_table(campaign, &self.sample_files(campaign, &file)?, Some(&file))??;
                Ok(Ok(self.print_json(&made.json())?))
            }
            (campaigns, _) => self.make_batch(campaigns, &file),
        }
    }

    /// Makes the table of one IMU and writes it. `file` is the campaign file, if there is one. The inner result tells
    /// whether the samples give a table; the outer one fails if the command line is wrong, or if the table cannot be
    /// written.
    fn make_table(
        &self,
        campaign: &Campaign,
        samples: &[PathBuf],
        file: Option<&CampaignFile>,
    ) -> Result<Result<Made, Refused>, Refused> {
        match self.stage(campaign, samples, file)? {
            Ok(staged) => {
                self.write(campaign, &staged.made, staged.table, staged.page, Vec::new())?;
                Ok(Ok(staged.made))
            }
            Err(refused) => Ok(Err(refused)),
        }
    }

    /// Makes the table of one IMU; its files wait to be written. Results as of [`make_table`](Self::make_table).
    fn stage(
        &self,
        campaign: &Campaign,
        samples: &[PathBuf],
        file: Option<&CampaignFile>,
    ) -> Result<Result<Staged, Refused>, Refused> {
        self.refuse_overlaps(&[(campaign, samples)], file)?;
        // Both files are created before the fit, so that either both are written or none.
        let [output, report] = self.outputs(&campaign.imu);
        let table = StagedText::create(output.as_deref())?;
        let page = report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        match self.fit(campaign, samples, file) {
            Ok(made) => Ok(Ok(Staged { made, table, page })),
            Err(refused) if refused.failure.exit == Exit::Usage => Err(refused),
            Err(refused) => Ok(Err(refused)),
        }
    }

    /// The table of one IMU.
    fn fit(&self, campaign: &Campaign, samples: &[PathBuf], file: Option<&CampaignFile>) -> Result<Made, Refused> {
        if campaign.is_tumble {
            self.refuse_turntable()?;
        } else {
            self.without_turntable.refuse_options()?;
            self.refuse_foreign()?;
        }
        let options = self.options(campaign.is_tumble)?;
        // Those that the campaign file names are read as it says.
        let are_named = self.samples.is_empty() && file.is_some();
        let samples = if are_named { Vec::new() } else { Source::files(samples) };
        let inputs = Inputs::read(campaign, file, samples, &options, &bytes_bar)?;
        let spinner = spinner("fitting");
        let made = inputs.fit(campaign, file);
        spinner.finish_and_clear();
        self.named(made)
    }

    /// A refusal with the names of all faults that must be accepted, if the user accepts some.
    fn named(&self, made: Result<Made, Refused>) -> Result<Made, Refused> {
        made.map_err(|mut refused| {
            let left = refused.fit.as_ref().map(|fit| fit.0.acceptable()).unwrap_or_default();
            self.add_names(&mut refused, &left);
            refused
        })
    }

    /// Adds which faults must be accepted too, if the user accepts some and others are left.
    fn add_names(&self, refused: &mut Refused, left: &[&'static str]) {
        let accept = self.accepted();
        if !accept.is_empty() && !left.is_empty() {
            let all: Vec<_> = accept.iter().chain(left).copied().collect();
            let message = &mut refused.failure.message;
            let _ = write!(
                message,
                "\nthese faults must be accepted too, for a table in spite of all: --accept {}",
                all.join(",")
            );
            refused.document["error"] = Value::from(message.as_str());
        }
    }

    /// Writes the table, the report and what else is written already, and prints findings and text.
    fn write(
        &self,
        campaign: &Campaign,
        made: &Made,
        table: StagedText,
        page: Option<StagedText>,
        others: Vec<StagedText>,
    ) -> Result<(), Refused> {
        self.tell_made(made);
        let mut texts = vec![table.write(&made.table)?];
        texts.extend(page.map(|page| page.write(&made.html(campaign))).transpose()?);
        texts.extend(others);
        Ok(StagedText::finish_together(texts)?)
    }

    /// Prints findings, notes and text.
    fn tell_made(&self, made: &Made) {
        made.findings().for_each(|finding| tell("isotherm", finding));
        made.notes.iter().for_each(|note| tell("isotherm", note));
        if !self.json {
            let _ = io::stderr().write_all(printable(&made.text()).as_bytes());
        }
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
        [Some(self.output()), self.report.as_deref()].map(|path| path.map(named))
    }

    /// The files of the samples: those that are given, or that the campaign file names.
    fn sample_files(&self, campaign: &Campaign, file: &CampaignFile) -> Result<Vec<PathBuf>, Failure> {
        match self.samples.is_empty() {
            true => file.samples(campaign),
            false if campaign.has_ramps_alone() => {
                let message =
                    "samples are for positions, and the campaign file has ramps alone; name them as [[ramp]] in it";
                Err(Failure::new(Exit::Usage, message))
            }
            false => Ok(self.samples.clone()),
        }
    }

    /// Names of the faults that are accepted.
    fn accepted(&self) -> Vec<&'static str> {
        let also = [(self.other_device, name::OTHER_DEVICE), (self.replace_curves, name::ONE_DIRECTION)];
        let also = also.into_iter().filter_map(|(given, name)| given.then_some(name));
        self.acceptance.accept.iter().copied().chain(also).collect()
    }

    /// The options of the fit, `by_hand` or on a turntable.
    fn options(&self, by_hand: bool) -> Result<FitOptions, Failure> {
        let foreign = self.foreign.read()?;
        let mut options =
            FitOptions { symptoms: self.verbose, foreign, part: self.part.get()?, ..FitOptions::default() };
        let (dwells, standstills) = self.excluded(by_hand)?;
        let order = match self.order {
            PolynomialOrder::Auto => None,
            PolynomialOrder::Fixed(order) => Some(order),
        };
        options.turntable = CalibrationOptions {
            method: self.method.unwrap_or_default(),
            order,
            alignment: AlignmentChoice::of(self.alignment, self.no_alignment),
            exclude: dwells,
            accept: self.accepted(),
            strict: self.acceptance.strict,
            lag: self.lag.unwrap_or_default(),
            predecessor_lag_s: None,
            ..CalibrationOptions::default()
        };
        let args = &self.without_turntable;
        options.by_hand = TumbleOptions {
            window_s: args.window.map(|window| window.as_secs_f64()),
            order,
            scale_factor: args.scale_factor.unwrap_or_default(),
            misalignment: !args.no_misalignment,
            exclude: standstills,
            temperature_range: args.temperature_range,
            accept: self.accepted(),
            strict: self.acceptance.strict,
        };
        Ok(options)
    }

    /// What `--exclude` leaves out: dwells and turns, or standstills of an IMU that was put down by hand.
    fn excluded(&self, by_hand: bool) -> Result<(Vec<Dwell>, Vec<usize>), Failure> {
        let (mut dwells, mut standstills) = (Vec::new(), Vec::new());
        for excluded in &self.exclude {
            match (excluded, by_hand) {
                (Excluded::Dwell(set_point_c, number), false) => dwells.push((*set_point_c, *number)),
                (Excluded::Standstill(number), true) => standstills.push(*number),
                (_, false) => {
                    let message = "--exclude: give SET_POINT/NUMBER, for example -25/3";
                    return Err(Failure::new(Exit::Usage, message));
                }
                (_, true) => {
                    let message =
                        "--exclude: without a turntable there are no positions; give the number of a standstill";
                    return Err(Failure::new(Exit::Usage, message));
                }
            }
        }
        Ok((dwells, standstills))
    }
}
