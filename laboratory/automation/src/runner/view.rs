//! What the runner shows of the campaign: status file, bars, log and live page.

use super::Runner;
use crate::machine::Phase;
use crate::plan::ThereAndBack;
use crate::progress::Snapshot;
use crate::readbacks::Readbacks;
use crate::step::CampaignStep;
use crate::timeline::{duration, left_s, turn_s, unit_s, units};

impl Runner<'_> {
    pub(super) fn unit_name(&self) -> String {
        self.machine.unit().map_or_else(|| "end".to_owned(), |unit| unit.name(self.plan))
    }

    /// Fraction of the unit in progress that is taken, 0 to 1; 0 outside one.
    pub(super) fn unit_fraction(&self) -> f64 {
        let takes_s = match self.machine.unit() {
            Some(CampaignStep::Dwell { .. }) => self.plan.dwell.time_s,
            Some(CampaignStep::Turn { turn, .. }) => turn_s(self.plan, &self.plan.turns[turn]),
            Some(unit @ (CampaignStep::Ramp(_) | CampaignStep::Run(_))) => {
                unit.way(self.plan).map_or(f64::INFINITY, ThereAndBack::time_s)
            }
            None => return 0.0,
        };
        (self.streams.collected_s() / takes_s).min(1.0)
    }

    /// Estimated time until the campaign is complete.
    pub(super) fn left_s(&self) -> f64 {
        let unit = self.machine.completed();
        let takes_s = unit_s(self.plan, unit).unwrap_or_default();
        let soak_s = self.plan.soak.time_s;
        let soaked = match self.machine.phase() {
            // The chamber may have left the set point where it was soaked.
            Phase::Sweep { .. } => soak_s,
            _ => self.machine.reached().map_or(0.0, |reached| (self.clock.now() - reached).min(soak_s)),
        };
        let first = match self.machine.unit() {
            Some(CampaignStep::Dwell { position, .. }) => position == 0,
            Some(unit) => unit.has_own_file(),
            None => false,
        };
        let done = self.streams.collected_s() + if first { soaked } else { 0.0 };
        left_s(self.plan, unit) - done.min(takes_s)
    }

    /// Updates status file, bars, log and live page, each as often as it is due.
    pub(super) fn update_progress(&mut self) {
        let now = self.clock.now();
        if self.progress.is_due(now, self.machine.phase().name()) {
            let snapshot = self.snapshot();
            self.progress.update(now, self.unit_fraction(), &snapshot);
            let written_at = self.around.time.now();
            if self.page_written.is_none_or(|last| written_at.since(last) >= self.page_period) {
                self.page_written = Some(written_at);
                self.write_page(&snapshot);
            }
        }
    }

    /// Writes the live page. A failure is only logged, because the page is soon written again.
    pub(super) fn write_page(&mut self, snapshot: &Snapshot) {
        let curves: Vec<_> = self.streams.readbacks().map(Readbacks::curves).collect();
        if let Err(error) = self.page.write(self.plan, snapshot, &curves) {
            tracing::warn!("writing the live page: {error}");
        }
    }

    /// The set point that the chamber goes to or holds \[degC\]; `None` after the last unit.
    pub(super) fn target_c(&self) -> Option<f64> {
        let unit = self.machine.unit()?;
        match (self.machine.phase(), unit.way(self.plan)) {
            (Phase::Sweep { leg, .. }, Some(way)) => Some(leg.end_c(way)),
            _ => Some(unit.set_point_c(self.plan)),
        }
    }

    pub(super) fn snapshot(&mut self) -> Snapshot {
        let waits_for = match self.machine.phase() {
            Phase::Soak { .. } => {
                let left = self.machine.reached().unwrap_or_default() + self.plan.soak.time_s - self.clock.now();
                if left > 0.0 {
                    format!("{} more", duration(left))
                } else {
                    self.trends.unsettled(&self.plan.soak).unwrap_or_default()
                }
            }
            Phase::Dwell { .. } | Phase::Turn(_) => format!("{:.0} s taken", self.streams.collected_s()),
            Phase::Sweep { held, .. } => {
                let taken = duration(self.streams.collected_s());
                let target = self.target_c().unwrap_or_default();
                let does = if held.is_some() { "holds at" } else { "ramps to" };
                format!("the chamber {does} {target} degC, {taken} taken")
            }
            _ => String::new(),
        };
        let read_at = |at: f64| at > f64::NEG_INFINITY;
        Snapshot {
            unix_s: self.clock.unix_s(),
            speed: self.clock.speed,
            phase: self.machine.phase().name().to_owned(),
            place: self.unit_name(),
            unit: self.units_kept,
            units: units(self.plan),
            waits_for,
            target_c: self.target_c(),
            commanded_c: self.machine.commanded_c(),
            air_c: read_at(self.chamber.1).then_some(self.chamber.0.air_c),
            chamber_c_per_h: self.trends.chamber_c_per_h(),
            temperature_per_h: self.trends.temperature_per_h().map(|(rate, _)| rate),
            angles_deg: read_at(self.turntable.1).then_some(self.turntable.0.angles_deg),
            repeated: self.station.repeated(),
            collected_s: self.streams.collected_s(),
            left_s: self.left_s(),
            paused: self.paused.clone(),
            well_unix_s: self.well.unix_s,
            well_up: self.well.up.clone(),
            ended: None,
            safe: false,
            dropped: self.dropped.clone(),
        }
    }
}
