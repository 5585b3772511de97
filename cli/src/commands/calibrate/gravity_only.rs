//! `calibrate --gravity-only`: a table without a turntable, from recordings of an IMU that was put down by hand.

use super::arguments::{Calibrate, Excluded, GravityOnlyArgs, PolynomialOrder, Results};
use crate::commands::common::Refused;
use crate::progress::{bytes_bar, spinner};
use isotherm_calibration::{
    CampaignSource, GravityOnlyOptions, TumbleRecording, calibrate_gravity_only, now, sealed_gravity_only_table,
    sha256, tool,
};
use isotherm_campaign::Campaign;
use isotherm_failure::{Exit, Failure};
use isotherm_recording_formats::read::{ImuChoice, Recording, RowKind};
use isotherm_report as report;
use std::path::PathBuf;

impl GravityOnlyArgs {
    /// Refuses options that need a calibration without a turntable.
    pub(super) fn refuse_options(&self) -> Result<(), Failure> {
        let given = [
            ("--scale-factor", self.scale_factor.is_some()),
            ("--no-misalignment", self.no_misalignment),
            ("--window", self.window.is_some()),
            ("--temperature-range", self.temperature_range.is_some()),
        ];
        refuse(
            &given,
            "is for calibrations without a turntable: --gravity-only, or method = \"gravity-only\" in the campaign file",
        )
    }
}

fn refuse(given: &[(&str, bool)], why: &str) -> Result<(), Failure> {
    let wrong = given.iter().find(|(_, given)| *given);
    wrong.map_or(Ok(()), |(name, _)| Err(Failure::new(Exit::Usage, format!("{name} {why}"))))
}

impl Calibrate {
    /// The campaign that the options describe, whose recordings are the files.
    pub(super) fn described(&self) -> Option<(Campaign, Vec<PathBuf>)> {
        let args = &self.without_turntable;
        let gravity = [args.gravity_local?, args.gravity_reference?];
        let campaign = Campaign::gravity_only(args.imu.clone()?, gravity, args.temperature_unit.as_deref()?);
        let files = core::iter::once(&self.campaign).chain(&self.samples).cloned().collect();
        Some((campaign, files))
    }

    /// The table of recordings of an IMU that was put down by hand. `file` is the text of the campaign file, if there
    /// is one.
    pub(super) fn of_recordings(
        &self,
        campaign: &Campaign,
        paths: &[PathBuf],
        file: Option<&str>,
    ) -> Result<Results, Refused> {
        self.refuse_turntable()?;
        let (recordings, digests) = read(campaign, paths)?;
        let source = CampaignSource {
            tool: tool(),
            time: now(),
            campaign: file.and(self.campaign.file_name()).unwrap_or_default().to_string_lossy().into_owned(),
            campaign_sha256: file.map_or_else(String::new, |text| sha256(text.as_bytes())),
            samples_sha256: String::new(),
            ramps_sha256: Vec::new(),
        };
        let spinner = spinner("fitting");
        let fitted = calibrate_gravity_only(campaign, &recordings, &self.gravity_only_options()?);
        spinner.finish_and_clear();
        let fitted = fitted.map_err(|error| {
            let failure = error.failure();
            Refused { document: report::gravity_only::refusal(&error, &failure), failure }
        })?;
        if self.strict && !fitted.warnings.is_empty() {
            return Err(Failure::new(Exit::Data, format!("--strict: {}", fitted.warnings.join("\n"))).into());
        }
        let html = || report::gravity_only::html(campaign, &fitted, &source, &digests);
        Ok(Results {
            table: sealed_gravity_only_table(campaign, &fitted, &source, &digests)
                .map_err(|message| Failure::new(Exit::Failed, message))?,
            warnings: fitted.warnings.iter().map(|warning| format!("warning: {warning}")).collect(),
            text: report::gravity_only::text(&fitted),
            html: self.report.as_ref().map_or_else(String::new, |_| html()),
            json: report::gravity_only::json(&fitted),
        })
    }

    fn gravity_only_options(&self) -> Result<GravityOnlyOptions, Failure> {
        let args = &self.without_turntable;
        let standstill = |excluded: &Excluded| match excluded {
            Excluded::Standstill(number) => Ok(*number),
            Excluded::Dwell(..) => {
                let message = "--exclude: without a turntable there are no positions; give the number of a standstill";
                Err(Failure::new(Exit::Usage, message))
            }
        };
        Ok(GravityOnlyOptions {
            window_s: args.window.map_or(GravityOnlyOptions::default().window_s, |window| window.as_secs_f64()),
            order: match self.order {
                PolynomialOrder::Auto => None,
                PolynomialOrder::Fixed(order) => Some(order),
            },
            scale_factor: args.scale_factor.unwrap_or_default(),
            misalignment: !args.no_misalignment,
            exclude: self.exclude.iter().map(standstill).collect::<Result<_, _>>()?,
            temperature_range: args.temperature_range,
            other_device: self.other_device,
        })
    }

    /// Refuses options that need a turntable.
    fn refuse_turntable(&self) -> Result<(), Failure> {
        let given = [
            ("--method", self.method.is_some()),
            ("--alignment", self.alignment),
            ("--no-alignment", self.no_alignment),
            ("--lag", self.lag.is_some()),
            ("--accept", !self.accept.is_empty()),
            ("--verbose", self.verbose),
        ];
        refuse(&given, "is for campaigns on a turntable; without one leave it out")
    }
}

/// Reads the recordings. Returns them with the SHA-256 of each.
fn read(campaign: &Campaign, paths: &[PathBuf]) -> Result<(Vec<TumbleRecording>, Vec<String>), Failure> {
    let bar = bytes_bar(paths, "reading");
    let (mut recordings, mut digests) = (Vec::new(), Vec::new());
    for path in paths {
        let choice = ImuChoice::Prefer(campaign.imu.clone());
        let mut rows = Recording::open_hashed(core::slice::from_ref(path), RowKind::Sample, choice, &bar)?;
        let recording = TumbleRecording::read(path.display().to_string(), &mut rows);
        recordings.push(recording.map_err(|error| rows.failure(&error))?);
        digests.push(rows.sha256()?);
    }
    bar.finish_and_clear();
    Ok((recordings, digests))
}
