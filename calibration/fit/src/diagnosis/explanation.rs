//! The hypothesis that explains the data.

use super::cause::{Diagnosis, MAX_GOOD, OF_FORCES, diagnosis};
use super::hypothesis::Hypothesis;
use super::position_off::{POSITION_OFF, POSITION_OFF_OTHERS};
use super::reduction::{GOOD, Trials, WRONG_SIGN};
use isotherm_support::finding::{Finding, Location, RunNumber, Severity, name};

/// A hypothesis must reduce the residuals by this factor.
pub(super) const EXPLAINS: f64 = 10.0;
/// Hypotheses whose residuals are within this factor of the best are as good as it is.
const AS_GOOD: f64 = 4.0;
/// More hypotheses that are equally good are no diagnosis.
const MAX_AMBIGUOUS: usize = 3;

/// Root mean square.
fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    (values.map(|v| v * v).sum::<f64>() / n).sqrt()
}

/// A hypothesis that explains the data.
struct Explanation {
    hypothesis: Hypothesis,
    /// Residual with it \[g0\].
    after: f64,
    /// The set points where it holds.
    scope: Vec<usize>,
}

/// A residual in words.
fn size(g0: f64) -> String {
    if g0 < 1e-3 { format!("{:.1}e-6 g0", g0 * 1e6) } else { format!("{g0:.3} g0") }
}

impl Trials<'_> {
    /// The hypothesis that explains the residuals. Where a position is off in dwells in which the IMU moved, by one of
    /// the `findings`, the motion is the cause.
    pub(super) fn forces(&self, with_off: bool, findings: &[Finding]) -> Option<Diagnosis> {
        let reducible: Vec<usize> = (0..self.set_points.len()).filter(|&i| !self.stated[i].is_nan()).collect();
        let worst = *reducible.iter().max_by(|&&a, &&b| self.stated[a].total_cmp(&self.stated[b]))?;
        if self.stated[worst] < GOOD {
            return None;
        }
        let before = rms(reducible.iter().map(|&i| self.stated[i]));
        let tried = self.hypotheses(&self.set_points[worst], with_off).into_iter();
        let mut found: Vec<_> =
            tried.filter_map(|hypothesis| self.holds(hypothesis, &reducible, worst, before)).collect();
        found.sort_by(|a, b| a.after.total_cmp(&b.after));
        let best = found.first()?.after;
        found.retain(|explanation| explanation.after < AS_GOOD * best);
        if found.len() > MAX_AMBIGUOUS {
            return None;
        }
        let signs = found.iter().flat_map(|it| &it.scope).any(|&i| self.stated[i] == WRONG_SIGN);
        let residuals = match signs {
            true => format!("as it is, scale factors have a wrong sign; corrected, residuals are {}", size(best)),
            false => format!("residuals {} -> {}", size(before), size(best)),
        };
        if let Some(first) = found.iter().find_map(|explanation| self.motion(explanation, findings)) {
            let mut finding = findings[first].clone();
            finding.severity = Severity::Fault;
            finding.message += &format!(" (without this position {residuals})");
            return Some(Diagnosis { finding, explains: OF_FORCES, promoted: Some(first) });
        }
        let texts: Vec<_> = found.iter().map(|it| self.describe(&it.hypothesis, &it.scope)).collect();
        let name = texts.first()?.0;
        let text = texts.into_iter().map(|(_, text)| text).collect::<Vec<_>>().join("; or ");
        let of_intervals = &[name::INTERVAL, name::WRONG_POSITION, name::POSITION_OFF];
        let explains = if name == name::INTERVAL { of_intervals } else { OF_FORCES };
        Some(diagnosis(name, format!("{text} ({residuals})"), explains))
    }

    /// The hypothesis as an explanation, if it holds at the set point `worst` and over all that are `reducible`, whose
    /// residuals are `before` without it.
    fn holds(&self, hypothesis: Hypothesis, reducible: &[usize], worst: usize, before: f64) -> Option<Explanation> {
        let holds = |stated: f64, residual: f64| residual < stated / EXPLAINS && residual < MAX_GOOD;
        let residual =
            |i: usize| Some(self.residual(&hypothesis, &self.set_points[i])).filter(|it| holds(self.stated[i], *it));
        residual(worst)?;
        let with: Vec<_> = reducible.iter().map(|&i| (i, residual(i))).collect();
        let after = rms(with.iter().map(|(i, residual)| residual.unwrap_or(self.stated[*i])));
        let scope: Vec<usize> = with.iter().filter(|(_, residual)| residual.is_some()).map(|(i, _)| *i).collect();
        // A smaller difference is an outlier: it is named after the fit, and kept.
        let is_outlier = |position: usize| {
            let offset = self.measured(position, &scope, &[position]).map_or(0.0, |(offset, _)| offset.norm());
            let spread = self.spread(&[position], position).unwrap_or(f64::INFINITY);
            offset < POSITION_OFF.max(POSITION_OFF_OTHERS * spread * after)
        };
        let only_outlier = matches!(hypothesis, Hypothesis::Off(position) if is_outlier(position));
        (holds(before, after) && !only_outlier).then_some(Explanation { hypothesis, after, scope })
    }

    /// The finding that the IMU moved in the position that is off, if it did wherever the position is off: the index of
    /// the first.
    fn motion(&self, Explanation { hypothesis, scope, .. }: &Explanation, findings: &[Finding]) -> Option<usize> {
        let Hypothesis::Off(position) = hypothesis else { return None };
        let number = RunNumber::Position(self.campaign.positions[*position].number);
        let moved = |i: &usize| {
            let place = Some(Location::SetPoint(self.set_points[*i].set_point_c, Some(number)));
            findings.iter().position(|finding| finding.name == name::NOT_STILL && finding.place == place)
        };
        let all: Option<Vec<usize>> = scope.iter().map(moved).collect();
        all?.first().copied()
    }
}
