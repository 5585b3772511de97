//! The pauses of a campaign: until both instruments answer and samples arrive.

use super::{FIRST_RETRY_PAUSE, MAX_LOOP_PAUSE, MAX_RETRY_PAUSE, MIN_TIMEOUT, Runner, RunnerError};
use crate::journal::Entry;
use isotherm_support::failure::{Exit, Failure};

impl Runner<'_> {
    /// Connects both instruments and waits for samples. Nothing is commanded but the turntable's engagement, after a
    /// stop if an earlier runner left it engaged.
    pub(super) fn connect(&mut self) -> Result<(), RunnerError> {
        let reached = self.reached;
        self.wait_until_well(MIN_TIMEOUT.as_secs_f64() * self.clock.speed + self.plan.patience.stream_s)?;
        let names = self.station.names();
        self.progress.event(&format!("chamber: {}; turntable: {}", names[0], names[1]));
        let [chamber, turntable] = names;
        self.journal.write(Entry::Connected { chamber, turntable })?;
        self.may_drop = true;
        let now = self.clock.now();
        if self.reached.is_some() || self.machine.completed() > 0 {
            self.machine.resume(now, self.interruption_s + now, reached, &self.chamber.0)?;
        }
        Ok(())
    }

    /// Commands nothing until all is well again. The unit in progress is lost.
    pub(super) fn pause(&mut self, cause: String) -> Result<(), RunnerError> {
        self.progress.event(&format!("paused: {cause}"));
        self.journal.write(Entry::Paused { cause: cause.clone() })?;
        self.streams.discard();
        self.streams.reset_timing();
        let reached = self.machine.reached();
        let well_at = self.well_at;
        if self.machine.phase().is_moving() {
            self.station.stop_turntable();
        }
        self.paused = Some(cause);
        self.wait_until_well(self.plan.patience.pause_s.max(MIN_TIMEOUT.as_secs_f64() * self.clock.speed))?;
        let now = self.clock.now();
        self.journal.write(Entry::Resumed { after_s: now - well_at })?;
        self.progress.event("all is well again");
        self.trends.clear();
        self.ramp.clear();
        self.machine.resume(now, now - well_at, reached, &self.chamber.0)?;
        Ok(())
    }

    /// Waits until both instruments answer and samples arrive, for at most `patience_s`.
    pub(super) fn wait_until_well(&mut self, patience_s: f64) -> Result<(), RunnerError> {
        let begun = self.clock.now();
        let mut retry = FIRST_RETRY_PAUSE;
        loop {
            let cause = match self.check_all_well() {
                Ok(()) => {
                    self.paused = None;
                    return Ok(());
                }
                Err(RunnerError::Interrupted(cause)) => cause,
                Err(given_up) => return Err(given_up),
            };
            self.check_stop_signal()?;
            if self.clock.now() - begun > patience_s {
                // It has waited for them long enough.
                let silent = self.streams.silent(self.stream_patience_s(), 0.0);
                if self.drop_all(silent)? {
                    continue;
                }
                return Err(RunnerError::GivenUp(Failure::new(Exit::Unavailable, cause)));
            }
            self.paused.get_or_insert_with(|| cause.clone());
            let until = self.around.time.now() + retry;
            while self.around.time.now() < until {
                self.check_stop_signal()?;
                self.drain()?;
                self.update_progress();
                self.around.time.sleep_until(until.min(self.around.time.now() + MAX_LOOP_PAUSE));
            }
            retry = (retry * 2).min(MAX_RETRY_PAUSE);
        }
    }

    /// Connects and reads both instruments, and checks the stream.
    pub(super) fn check_all_well(&mut self) -> Result<(), RunnerError> {
        self.check_stop_signal()?;
        // Both instruments are read even if one is lost: an alarm of either ends the campaign.
        let chamber = self.station.connect_chamber().map_err(RunnerError::from).and_then(|()| self.read_chamber());
        if let Err(RunnerError::GivenUp(_) | RunnerError::Stopped(_)) = chamber {
            return chamber;
        }
        let turntable =
            self.station.connect_turntable().map_err(RunnerError::from).and_then(|()| self.read_turntable());
        if let Err(RunnerError::GivenUp(_) | RunnerError::Stopped(_)) = turntable {
            return turntable;
        }
        chamber.and(turntable)?;
        self.drain()?;
        self.check_streams()
    }
}
