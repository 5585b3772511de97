//! The checks of time: soak, intervals, missing rows, and motions and ramps that are too fast to be true.

use super::{Checker, SetPoint};
use isotherm_campaign::{Dwell, Position, SampleLayout};
use isotherm_recording::{CLOCK_TOLERANCE, MISSING, cause, part, unit_factor};
use isotherm_statistics::{median, robust_sd};
use isotherm_support::finding::{Finding, Location, RunNumber, Severity, name};
use nalgebra::{Rotation3, Vector3};

/// If the campaign states no soak, a shorter time between two set points gives a warning \[s\].
const USUAL_SOAK: f64 = 3600.0;
/// A smaller difference in all dwells gives a warning if it is over this: two oscillators differ by less …
const CLOCK_WARNING: f64 = 200e-6;
/// … and if it is over this many standard errors of the median over the dwells: timestamps may jitter.
const CLOCK_ERRORS: f64 = 5.0;
/// Standard error of the median of normal values, in those of the mean.
const MEDIAN_ERROR: f64 = 1.2533;
/// A single dwell is judged if it has at least this many blocks with consecutive rows.
const MIN_BLOCKS: usize = 5;
/// A dwell shorter than this part of the median counts as cut short.
const SHORT_DWELL: f64 = 0.6;
/// No turntable turns by more than [`FAST_TURN`] within this time \[s\].
const FAST_TURN_S: f64 = 0.2;
/// See [`FAST_TURN_S`] \[deg\].
const FAST_TURN: f64 = 45.0;
/// A plausible time from position to position, to guess the unit of the timestamps \[s\].
const PLAUSIBLE_TURN_S: f64 = 2.0;
/// No IMU changes its temperature faster than this \[degC/s\]: thermal shock chambers reach a twentieth of it.
const FAST_RAMP: f64 = 1.0;
/// A temperature that changes by less than this part of the distance between the set points is no ramp.
const RAMP: f64 = 0.5;
/// A campaign that lasts longer gives a warning \[s\]: 100 days.
const LONG_CAMPAIGN: f64 = 100.0 * 86_400.0;

impl Checker<'_> {
    /// The time between the last row of a set point and the first row of the next.
    pub(super) fn soak(&mut self) {
        let (limit, severity) = match self.campaign.soak_s {
            Some(stated) => (stated, Severity::Fault),
            None => (USUAL_SOAK, Severity::Warning),
        };
        for index in 1..self.dwells.len() {
            let (before, after) = (&self.dwells[index - 1], &self.dwells[index]);
            let Some(gap) = gap_s(before, after) else { continue };
            if before.set_point_c != after.set_point_c && gap < limit {
                let stated = if self.campaign.soak_s.is_some() { "the campaign file asks for" } else { "usual are" };
                let message = format!(
                    "its first dwell begins {gap:.0} s after the set point before; {stated} {limit:.0} s of soak"
                );
                self.report_set_point(severity, name::SOAK, after.set_point_c, Some(after.lines[0]), message);
            }
        }
    }

    /// The intervals against the timestamps, missing rows, and dwells that are cut short.
    pub(super) fn time(&mut self) {
        let line = self.dwells.first().map(|dwell| dwell.lines[0]);
        self.no_times();
        // What passes between two rates over a gate need not be counted.
        let are_rates = self.campaign.layout == SampleLayout::ByPosition { rates: true };
        let told = are_rates || self.intervals();
        self.lost_time();
        let elapsed = |[begin_ns, end_ns]: [u64; 2]| end_ns.saturating_sub(begin_ns) as f64 / 1e9;
        let ratio = |dwell: &Dwell| Some(dwell.sums.seconds / elapsed(dwell.time_ns?));
        let ratio = median(self.dwells.iter().filter_map(ratio));
        let sequences = self.dwells.iter().any(|dwell| dwell.blocks_with_consecutive_rows() > 0);
        let rows: u64 = self.dwells.iter().map(|dwell| dwell.rows).sum();
        let lost = self.dwells.iter().fold(0_u64, |lost, dwell| lost.saturating_add(dwell.losses().missing));
        let lost = if sequences { lost as f64 / (lost as f64 + rows as f64) } else { 0.0 };
        let mut report = |severity, name, message| {
            self.findings.push(Finding { severity, name, line, place: None, message });
        };
        if ratio > 1.0 + CLOCK_TOLERANCE && !told {
            let cause = "pulses are counted twice, or interval_ns is not in ns";
            report(
                Severity::Fault,
                name::INTERVAL,
                format!("the intervals add up to {ratio:.4} of the time that passed: {cause}"),
            );
        } else if lost > MISSING {
            let message = format!("{:.1} % of the rows are missing by their sequences", lost * 100.0);
            report(Severity::Warning, name::MISSING_ROWS, message);
        } else if ratio < 1.0 - CLOCK_TOLERANCE && !told {
            let cause = if sequences {
                "rows are missing"
            } else {
                "rows are missing, or interval_ns is not the time that was counted, and every scale factor is wrong by as much"
            };
            report(
                Severity::Warning,
                name::MISSING_ROWS,
                format!("the intervals add up to {ratio:.4} of the time that passed: {cause}"),
            );
        }
        self.duration(line);
        self.short_dwells();
    }

    /// That there are no times, or none that hold for the whole campaign, and what is not looked at.
    fn no_times(&mut self) {
        if self.dwells.iter().all(|dwell| dwell.time_ns.is_some()) {
            return;
        }
        let message = match self.campaign.layout {
            SampleLayout::Means => {
                "means have no times and no rows: soak, missing rows, drift and motion within a dwell, its noise and full \
                 converters are not looked at; temperature that changed within a dwell is an error that nothing shows"
            }
            _ => {
                "the samples have no times that hold for the whole campaign: soak, and motions and ramps that are too fast, \
                 are not looked at; give date and time as time.column"
            }
        };
        self.findings.push(Finding::warning(name::NO_TIMES, message.to_owned()));
    }

    /// A campaign that lasts too long.
    fn duration(&mut self, line: Option<u64>) {
        let end_of = |dwell: Option<&Dwell>, end: usize| dwell?.time_ns.map(|time_ns| time_ns[end]);
        let all_s = match (end_of(self.dwells.first(), 0), end_of(self.dwells.last(), 1)) {
            (Some(first), Some(last)) => last.saturating_sub(first) as f64 / 1e9,
            _ => 0.0,
        };
        if all_s > LONG_CAMPAIGN {
            let message = format!("the campaign lasts {:.0} days; are the times in ns?", all_s / 86_400.0);
            self.findings.push(Finding { line, ..Finding::warning(name::DURATION, message) });
        }
    }

    /// Dwells that are cut short.
    fn short_dwells(&mut self) {
        let usual = median(self.dwells.iter().map(|dwell| dwell.sums.seconds));
        for dwell in 0..self.dwells.len() {
            let (seconds, lines) = (self.dwells[dwell].sums.seconds, self.dwells[dwell].lines);
            if seconds < SHORT_DWELL * usual {
                let message = format!("{seconds:.1} s only, others have {usual:.1} s; is the file cut?");
                self.report_dwell(Severity::Warning, name::SHORT_DWELL, dwell, lines[1], message);
            }
        }
    }

    /// Time that is lost within a dwell without a hole in the sequences. Between dwells the table turns, and rows may
    /// be left out.
    fn lost_time(&mut self) {
        let faults =
            self.dwells.iter().enumerate().filter_map(|(dwell, it)| it.time_fault().map(|found| (dwell, found)));
        let faults: Vec<_> = faults.collect();
        let Some(&(dwell, (line, fault))) = faults.first() else { return };
        let others = match faults.len() {
            1 => String::new(),
            count => format!("; so it is in {} more dwells", count - 1),
        };
        self.report_dwell(Severity::Warning, name::TIME_STEP, dwell, line, format!("{fault}{others}"));
    }

    /// The interval against the timestamp's step between consecutive rows. Returns whether there is a fault.
    fn intervals(&mut self) -> bool {
        let is_off = |ratio: f64| (ratio - 1.0).abs() > CLOCK_TOLERANCE;
        let ratios: Vec<f64> = self.dwells.iter().map(Dwell::interval_ratio).collect();
        let all = median(ratios.iter().copied());
        if is_off(all) {
            let message =
                format!("interval_ns is {} of the time from row to row in all dwells: {}", part(all), cause(all));
            self.findings.push(Finding::whole(Severity::Fault, name::INTERVAL, message));
            return true;
        }
        let off =
            |dwell: &usize| is_off(ratios[*dwell]) && self.dwells[*dwell].blocks_with_consecutive_rows() >= MIN_BLOCKS;
        let off: Vec<usize> = (0..ratios.len()).filter(off).collect();
        if let Some(&first) = off.first() {
            let (ratio, line) = (ratios[first], self.dwells[first].lines[0]);
            let others = if off.len() > 1 { format!(" and in {} more dwells", off.len() - 1) } else { String::new() };
            let message =
                format!("interval_ns is {} of the time from row to row, here{others}: {}", part(ratio), cause(ratio));
            self.report_dwell(Severity::Fault, name::INTERVAL, first, line, message);
            return true;
        }
        let scatter: Vec<f64> = ratios.iter().map(|ratio| ratio - all).filter(|off| off.is_finite()).collect();
        let error = MEDIAN_ERROR * robust_sd(&scatter) / (scatter.len() as f64).sqrt();
        if (all - 1.0).abs() > CLOCK_WARNING.max(CLOCK_ERRORS * error) {
            let message = format!(
                "interval_ns is {all:.6} of the time from row to row in all dwells: every scale factor is wrong by {:.0} ppm, unless the pulses \
                 were counted in just this part of the time; give the measured time of each row",
                (all.recip() - 1.0).abs() * 1e6
            );
            self.findings.push(Finding::whole(Severity::Warning, name::INTERVAL, message));
        }
        // Sums, or a part of the samples, without consecutive sequences: only a ratio that is a device's factor is no
        // gap.
        let [step, sample] = [0, 1].map(|k| median(self.dwells.iter().map(|dwell| dwell.sparse_interval_ratios()[k])));
        if all.is_nan() && is_off(sample) && unit_factor(step).is_some() {
            let message =
                format!("interval_ns is {} of the time from row to row in all dwells: {}", part(step), cause(step));
            self.findings.push(Finding::whole(Severity::Fault, name::INTERVAL, message));
            return true;
        }
        false
    }

    /// Positions and temperatures that follow each other faster than is possible.
    pub(super) fn motion(&mut self, set_points: &[SetPoint]) {
        let found = [self.fast_turns(), self.fast_ramps(set_points)];
        self.findings.extend(found.into_iter().flatten());
    }

    /// Positions that are far apart and follow each other at once.
    fn fast_turns(&self) -> Option<Finding> {
        let position = |dwell: &Dwell| &self.campaign.positions[dwell.position];
        let turn = |pair: &(&Dwell, &Dwell)| turn_deg(position(pair.0), position(pair.1)) > FAST_TURN;
        let turns = || self.pairs().filter(turn);
        let usual_s = median(turns().filter_map(|(before, after)| gap_s(before, after)));
        let is_fast = |(before, after): &(&Dwell, &Dwell)| gap_s(before, after).is_some_and(|gap| gap < FAST_TURN_S);
        let fast: Vec<_> = turns().filter(is_fast).collect();
        let (before, after) = *fast.first()?;
        let more = if fast.len() > 1 { format!(", and {} more such turns", fast.len() - 1) } else { String::new() };
        let all = usual_s > 0.0 && fast.len() * 2 > turns().count();
        let factor = [1e3, 1e6, 1e9].into_iter().find(|factor| all && usual_s * factor >= PLAUSIBLE_TURN_S);
        let cause = match factor {
            Some(factor) => format!(
                "all times look {factor} times too short: give timestamp_ns and interval_ns in nanoseconds (multiply both by {factor})"
            ),
            None => "times or positions are wrong; fix the rows, with the true time of each".to_owned(),
        };
        let message = format!(
            "positions {} and {} are {:.0} degrees apart, {:.4} s after each other{more}; no turntable moves so fast: {cause}",
            position(before).number,
            position(after).number,
            turn_deg(position(before), position(after)),
            gap_s(before, after).unwrap_or_default()
        );
        // The unit of all times concerns no single dwell: `diagnosis::clock` distinguishes the two by the place.
        let here = factor.is_none().then_some(after);
        let place =
            |dwell: &Dwell| Location::SetPoint(dwell.set_point_c, Some(RunNumber::Position(position(dwell).number)));
        let whole = Finding::whole(Severity::Fault, name::IMPOSSIBLE_MOTION, message);
        Some(Finding { line: here.map(|dwell| dwell.lines[0]), place: here.map(place), ..whole })
    }

    /// Temperatures that change faster from set point to set point than those of any IMU.
    fn fast_ramps(&self, set_points: &[SetPoint]) -> Option<Finding> {
        // Degrees per unit of temperature, from the set points; the heads' mean, because one may be broken.
        let head = |dwell: &Dwell| (0..3).map(|axis| dwell.sums.head(axis)).sum::<f64>() / 3.0;
        let means: Vec<(f64, f64)> = set_points
            .iter()
            .map(|point| (point.set_point_c, median(point.dwells.iter().map(|&dwell| head(&self.dwells[dwell])))))
            .collect();
        let slope = super::scale::slope(&means);
        let ramp = |(before, after): (&Dwell, &Dwell)| {
            let asked = (after.set_point_c - before.set_point_c).abs();
            // Where temperature hardly depends on the chamber its noise is a large change of the temperature.
            let change = ((head(after) - head(before)) / slope).abs().min(2.0 * asked);
            let gap = gap_s(before, after)?;
            (asked > 0.0 && change > RAMP * asked).then(|| change / gap.max(1e-9))
        };
        let rate = median(self.pairs().filter_map(ramp));
        let message = format!(
            "from set point to set point the temperature changes by {rate:.1} degC/s; no IMU does: timestamp_ns is not in \
             nanoseconds, or not the time of the rows"
        );
        (rate > FAST_RAMP && rate.is_finite()).then(|| Finding::whole(Severity::Fault, name::IMPOSSIBLE_RAMP, message))
    }

    /// Each dwell with the next one.
    fn pairs(&self) -> impl Iterator<Item = (&Dwell, &Dwell)> {
        self.dwells.windows(2).map(|pair| (&pair[0], &pair[1]))
    }
}

/// Time from the last row of a dwell to the first of the next one \[s\]; `None` if no clock is that of both.
fn gap_s(before: &Dwell, after: &Dwell) -> Option<f64> {
    let [[_, end_ns], [begin_ns, _]] = [before.time_ns?, after.time_ns?];
    Some(begin_ns.saturating_sub(end_ns) as f64 / 1e9)
}

/// Angle of the rotation from one position to another \[deg\]; without angles, that between the specific forces.
fn turn_deg(from: &Position, to: &Position) -> f64 {
    let attitude = |[outer, inner]: [f64; 2]| {
        Rotation3::from_axis_angle(&Vector3::x_axis(), outer.to_radians())
            * Rotation3::from_axis_angle(&Vector3::z_axis(), inner.to_radians())
    };
    match (from.angles, to.angles) {
        (Some(from), Some(to)) => attitude(from).angle_to(&attitude(to)).to_degrees(),
        _ => Vector3::from(from.specific_force).angle(&Vector3::from(to.specific_force)).to_degrees(),
    }
}
