//! The options that all jobs of `calibrate` have, and the files that they write.

use crate::commands::common::{AcceptanceArgs, JsonOption};
use crate::commands::part::PartArgs;
use clap::Args;
use isotherm_campaign::{Campaign, IMU};
use isotherm_files::StagedText;
use isotherm_pipeline::{InputOptions, JobOutcome};
use isotherm_recording_formats::convert::Foreign;
use isotherm_report::with_files;
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure};
use isotherm_support::finding::name;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Where a table goes, and what is accepted for it.
#[derive(Debug, Args)]
pub(super) struct TableArgs {
    /// Write the report to this file (HTML)
    #[arg(long, value_name = "R.html")]
    pub report: Option<PathBuf>,
    /// Set the order of every polynomial
    ///
    /// An order from 0 to 7; auto chooses each from the data.
    #[arg(long, value_name = "auto|N", default_value = "auto", allow_negative_numbers = true)]
    pub order: PolynomialOrder,
    #[command(flatten)]
    pub json: JsonOption,
    #[command(flatten)]
    pub part: PartArgs,
    #[command(flatten)]
    pub acceptance: AcceptanceArgs,
    /// Accept samples of another device
    ///
    /// The samples can come from a device with another serial number, or from two devices. This is the same as --accept
    /// other-device.
    #[arg(long)]
    pub other_device: bool,
}

/// The order of every polynomial; `None` chooses each from the data.
#[derive(Clone, Copy, Debug)]
pub(super) struct PolynomialOrder(pub Option<usize>);

impl FromStr for PolynomialOrder {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.parse() {
            _ if text == "auto" => Ok(Self(None)),
            Ok(order @ 0..=7) => Ok(Self(Some(order))),
            _ => Err("give auto or an order from 0 to 7"),
        }
    }
}

impl TableArgs {
    /// Names of the faults that are accepted, with those of options of a `job`.
    pub(super) fn accepted(&self, job: Option<&'static str>) -> Vec<&'static str> {
        let device = self.other_device.then_some(name::OTHER_DEVICE);
        self.acceptance.accept.iter().copied().chain(device).chain(job).collect()
    }

    /// How recordings are read.
    pub(super) fn input(&self, foreign: Foreign, symptoms: bool) -> Result<InputOptions, Failure> {
        Ok(InputOptions { symptoms, foreign, part: self.part.get()? })
    }

    /// Refuses a document and a table that would both go to stdout.
    pub(super) fn check_stdout(&self, output: &Path) -> Result<(), Failure> {
        let message = "--json and -o - both go to stdout; give the table a file";
        let is_both = self.json.is_given() && output == Path::new("-");
        if is_both { Err(Failure::new(Exit::Usage, message)) } else { Ok(()) }
    }
}

/// The path with the name of an IMU in it.
pub(super) fn path_of(path: &Path, imu: &ImuId) -> PathBuf {
    match path.to_str() {
        Some(text) => PathBuf::from(text.replace(IMU, imu.as_str())),
        None => path.to_owned(),
    }
}

/// The files of a table and its report, which wait to be written.
pub(super) struct TableFiles {
    table: StagedText,
    page: Option<StagedText>,
}

impl TableFiles {
    /// Creates both before the fit, so that either both are written or none.
    pub(super) fn create(table: &Path, report: Option<&Path>) -> Result<Self, Failure> {
        let table = StagedText::create(Some(table))?;
        Ok(Self { table, page: report.map(|path| StagedText::create(Some(path))).transpose()? })
    }

    /// Writes both; they are put into place together with others. The report has `parameters`, name and text of each
    /// file.
    pub(super) fn write(
        self,
        campaign: &Campaign,
        outcome: &JobOutcome,
        parameters: &[(&str, &str)],
    ) -> Result<Vec<StagedText>, Failure> {
        let mut texts = vec![self.table.write(&outcome.table)?];
        let html = |page: StagedText| page.write(&with_files(&outcome.html(campaign), parameters));
        texts.extend(self.page.map(html).transpose()?);
        Ok(texts)
    }
}
