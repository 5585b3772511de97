//! The rate and the counter of a device against its description.

use super::Intake;
use crate::tally::of_described;
use crate::timeline::RATE_LIMIT;
use isotherm_support::failure::{Failure, tell};

/// So many new sessions without ten regular frames in between show a counter that is not as described.
const RESTARTS: u64 = 20;
/// By how much bytes may come late \[s\] without a device being taken for slow or fast: a busy machine, or what lay in
/// the line's buffer at the beginning.
const LATE_S: f64 = 0.25;
/// How long the rate is measured before it is judged \[s\], and before it is warned of.
const JUDGED_S: f64 = 2.0;
const WARNED_S: f64 = 10.0;
/// A deviation of the rate that is warned of.
const WARNED: f64 = 1e-3;

impl Intake {
    /// Whether the rate is another one: it is off by more than late bytes explain, and goes on to be. A device or a
    /// machine that stood still once is measured anew.
    fn is_off(&mut self, deviation: f64, seconds: f64) -> Option<f64> {
        let nominal = seconds / (1.0 + deviation);
        if (deviation.abs() - RATE_LIMIT) * nominal <= LATE_S {
            self.suspected = None;
            return None;
        }
        match self.suspected {
            Some((since, before)) if seconds >= since => {
                if seconds - since < JUDGED_S {
                    return None;
                }
                let now = (seconds - since) / (nominal - before).max(f64::EPSILON) - 1.0;
                if now.abs() > RATE_LIMIT && now.signum() == deviation.signum() {
                    return Some(now);
                }
                self.suspected = None;
                self.timeline.measure_anew(self.last_arrival);
            }
            _ => self.suspected = Some((seconds, nominal)),
        }
        None
    }

    /// Judges the rate.
    ///
    /// # Errors
    /// If it is not that of the description, or if the counter is not, and this IMU has not sent a sample yet.
    pub(crate) fn judge(&mut self) -> Result<(), Failure> {
        self.judge_counter()?;
        if self.timeline.is_other_rate() {
            self.tell_rate()?;
        } else {
            self.rates.is_over();
        }
        let Some((deviation, seconds)) = self.timeline.deviation(self.last_arrival) else { return Ok(()) };
        if seconds < JUDGED_S {
            return Ok(());
        }
        let taken = self.timeline.taken().0;
        let measured = taken * (1.0 + deviation);
        self.tally.deviation_ppm = deviation * 1e6;
        if let Some(off) = self.is_off(deviation, seconds) {
            self.suspected = None;
            self.timeline.adopt(taken * (1.0 + off), 1.0);
            return self.tell_rate();
        }
        if deviation.abs() > WARNED && seconds > WARNED_S && !self.warned_of_rate {
            self.warned_of_rate = true;
            let compared = self.compared(measured);
            tell("isotherm", format!("warning: {compared}: {}", of_described(deviation)));
        }
        Ok(())
    }

    fn judge_counter(&mut self) -> Result<(), Failure> {
        if self.restarts.sessions <= RESTARTS {
            return Ok(());
        }
        let message = format!(
            "{} new sessions within {} frames: the counter or the clock does not rise as described; compare \
             timing.counter.step and bits, or timing.time, with the data sheet",
            self.restarts.sessions, self.tally.frames
        );
        if !self.goes_on() {
            return Err(Failure::new(self.description.contradiction(), message));
        }
        self.counts.tell(|| format!("warning: {message}"));
        Ok(())
    }

    /// Says that the device has another rate, or refuses it before the first sample.
    fn tell_rate(&mut self) -> Result<(), Failure> {
        let (interval, step) = self.timeline.taken();
        let described = self.description.timing.counter.map_or(1, |(_, counter)| counter.step);
        let is_step = interval == self.description.timing.interval_ns as f64;
        let (compared, remedy) = match is_step {
            true => (
                format!(
                    "the device's counter rises by {step} from frame to frame, and timing.counter.step is {described}"
                ),
                "give the step that the data sheet has for this rate",
            ),
            false => (self.compared(interval), self.remedy(step != described)),
        };
        if !self.goes_on() {
            return Err(Failure::new(self.description.contradiction(), format!("{compared}; {remedy}")));
        }
        if self.tally.adopted_interval_ns != interval as u64 {
            self.tally.adopted_interval_ns = interval as u64;
            self.tally.adopted += 1;
            self.rates.is_over();
        }
        let consequence = match self.description.columns.adopts() {
            _ if is_step => "the periods are counted by what it does",
            true => "the samples have that interval from now on",
            false => "the samples are invalid, since the scale factors of counts hold for one interval",
        };
        self.rates.tell(|| format!("warning: {compared}: {consequence}; {remedy}"));
        Ok(())
    }

    fn compared(&self, measured: f64) -> String {
        let described = self.description.timing.interval_ns as f64;
        format!(
            "the device sends {:.6} Hz, an interval of {:.9} s, and timing.interval_s is {:.9}, {:.6} Hz",
            1e9 / measured,
            measured / 1e9,
            described / 1e9,
            1e9 / described
        )
    }

    const fn remedy(&self, has_other_step: bool) -> &'static str {
        if has_other_step {
            "give interval_s and counter.step of the rate that the device is set to, or set the device"
        } else {
            "give the interval that the device is set to, or set the device"
        }
    }
}
