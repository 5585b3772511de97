//! The pulses of an acquisition's samples, which are to be those of the table in force.

use super::Acquisition;
use crate::connect::Options;
use crate::error::ConnectError;
use crate::status::fetch_status;
use crate::table_watch::KnownTable;
use crate::warning::warn;
use isotherm_shared::readings::ReadingError;
use isotherm_shared::status::ServiceStatus;
use isotherm_shared::table::PulseMismatch;
use isotherm_shared::wire::{AXES, RawSample};
use std::time::Duration;

impl Acquisition {
    /// Writes the pulses of a sample: `specific_force` \[m/s2\] along A1, A2, A3, and `angular_rate` \[rad/s\] about
    /// G1, G2, G3, each the mean over the interval of the sample. Without `angular_rate` the gyroscopes become absent.
    /// What rounding leaves is carried to the next sample, so that their sum differs from the integral of the readings
    /// by half a pulse at most.
    ///
    /// The pulses are those of the table in force, with the [resolution](Options::resolution) of the options, whatever
    /// your own interval is: the increment is right at any rate. An `interval_ns` of 0 becomes the nominal interval of
    /// the table. When an increment names another table, the helper thread asks the service for its interval while
    /// samples go on.
    ///
    /// While nothing is known of the table, or its pulses stand for something else, samples are **invalid**: they are
    /// sent with temperatures of NaN, so that their increments are NaN and flagged, and a line on stderr says why.
    ///
    /// # Errors
    /// [`ReadingError`]; nothing is written or carried then. The control period is missing: leave its sequence out.
    pub fn fill(
        &mut self,
        sample: &mut RawSample,
        specific_force: [f64; AXES],
        angular_rate: Option<[f64; AXES]>,
    ) -> Result<(), ReadingError> {
        self.renew();
        let pulses = self.pulses.as_mut().ok_or(ReadingError::NoResolution)?;
        let readings = pulses.readings.as_mut().ok_or(ReadingError::NoResolution)?;
        if pulses.interval_ns == 0 && sample.interval_ns != 0 {
            // Without a table: as the nominal table of this interval would have them.
            pulses.interval_ns = sample.interval_ns;
        }
        readings.interval_ns = pulses.interval_ns;
        readings.fill(sample, specific_force, angular_rate)
    }

    /// The interval for which readings become pulses of the table in force \[ns\]; `None` while no table says it. If an
    /// answer has named another table, the helper thread of the acquisition reads the status, and a later call has the
    /// new one.
    pub fn pulse_interval(&mut self) -> Option<u64> {
        self.renew();
        self.pulses.as_ref().map(|pulses| pulses.interval_ns).filter(|interval_ns| *interval_ns != 0)
    }

    /// Reads the status, and compares the pulses with the table in force. A service that does not answer in time is
    /// asked again.
    pub(super) fn settle(&mut self) -> Result<(), ConnectError> {
        let Ok(status) = fetch_status(&Options::new(self.domain.clone(), Duration::ZERO)) else { return Ok(()) };
        self.learn(&status).map_err(|cause| ConnectError::Pulses { imu: self.imu.clone(), cause: cause.to_string() })
    }

    /// Takes the table in force. What waits, or is unanswered, gets the pulses of it.
    fn learn(&mut self, status: &ServiceStatus) -> Result<(), PulseMismatch> {
        if let Some(in_force) = self.watch.learn(status, &self.imu) {
            self.lag.learn(in_force);
        }
        let Some(pulses) = &mut self.pulses else { return Ok(()) };
        let KnownTable::Of(table) = self.watch.known else {
            pulses.is_unfit = false;
            return Ok(());
        };
        pulses.is_unfit = true;
        let interval_ns = pulses.source.interval_for(&table)?;
        pulses.is_unfit = false;
        let before = std::mem::replace(&mut pulses.interval_ns, interval_ns);
        if before != 0 && before != interval_ns {
            let samples = self.kept.places_mut().chain(self.state.places_mut());
            samples.for_each(|sample| pulses.source.rescale(sample, before, interval_ns));
        }
        Ok(())
    }

    /// Takes the table in force while samples go on.
    pub(super) fn learn_in_flight(&mut self, status: &ServiceStatus) {
        if let Err(cause) = self.learn(status) {
            warn(&self.imu, format_args!("samples are invalid: {cause}"));
        }
    }

    /// Makes a sample invalid whose pulses are not those of the table.
    #[inline]
    pub(super) fn judge(&self, sample: &mut RawSample) {
        if self.pulses.as_ref().is_some_and(|pulses| pulses.is_unfit) {
            sample.invalidate();
        }
    }
}
