//! One verification run: the samples of a recording under a table.

use isotherm_files::sources;
use isotherm_fit::Origin;
use isotherm_recording::Progress;
use isotherm_recording_formats::read::{Input, Samples};
use isotherm_shared::lag::ReadingLimits;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use isotherm_verification::{Collector, Setup, Stability};
use std::path::PathBuf;

/// A verification run: an iterator over its samples that judges what it returns.
pub struct VerificationRun<'t> {
    samples: Samples,
    recording: Vec<PathBuf>,
    collector: Collector<'t>,
}

impl<'t> VerificationRun<'t> {
    /// Opens the pieces of a recording, to be judged in windows of `window_s`. Lagged temperature that it lacks is
    /// computed with `lag_ns`, that of the table if `None`.
    ///
    /// # Errors
    /// If a piece cannot be opened.
    pub fn open(
        table: &'t CoefficientTable,
        recording: &[PathBuf],
        input: impl Into<Input>,
        lag_ns: Option<u64>,
        window_s: f64,
        bar: &Progress,
    ) -> Result<Self, Failure> {
        let mut samples = Samples::open_hashed(&sources(recording)?, input, bar)?;
        samples.set_lag(lag_ns.unwrap_or(table.lag_ns()));
        samples.set_limits(Some(ReadingLimits::of(table)));
        Ok(Self { samples, recording: recording.to_vec(), collector: Collector::new(table, window_s) })
    }

    /// The samples that are left; see [`Samples::imu`] for the IMU that they name, and after the last one
    /// [`Samples::recording`] for what was found in data of other programs.
    #[must_use]
    pub const fn samples(&self) -> &Samples {
        &self.samples
    }

    /// What was collected of the samples so far.
    #[must_use]
    pub const fn collector(&self) -> &Collector<'t> {
        &self.collector
    }

    /// Whether the table of this origin was made from this recording, by the samples so far.
    #[must_use]
    pub fn made(&self, origin: &Origin) -> bool {
        origin.is_made_from(self.collector.marks(), &self.samples.sha256_so_far())
    }

    /// What the run shows, after its last sample.
    ///
    /// # Errors
    /// If a sample that is left cannot be read, or if nothing can be judged.
    pub fn finish(mut self, setup: &Setup) -> Result<Stability, Failure> {
        self.try_for_each(|sample| sample.map(drop))?;
        let names: Vec<_> = self.recording.iter().map(|path| path.display().to_string()).collect();
        self.collector.finish(setup).map_err(|error| {
            let failure = Failure::new(Exit::Data, format!("{}: {error}", names.join(", ")));
            if let [file] = self.recording.as_slice() { failure.at(file, None) } else { failure }
        })
    }
}

impl Iterator for VerificationRun<'_> {
    type Item = Result<RawSample, Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        let sample = self.samples.next()?;
        if let Ok(sample) = &sample {
            self.collector.add(sample);
        }
        Some(sample)
    }
}
