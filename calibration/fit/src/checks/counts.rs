//! Counts that are taken for rates, or rates for counts: gravity shows which is which.

use super::Checker;
use isotherm_campaign::SampleLayout;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;
use isotherm_support::finding::{Finding, Severity, name};

/// How far scale factors may be off the nominal one.
const NOMINAL: f64 = 2.0;
/// How far a length may be off a multiple of gravity.
const WHOLE: f64 = 0.03;
/// Multiples that gates give.
const MULTIPLES: std::ops::RangeInclusive<f64> = 2.0..=100.0;
/// The least part of the dwells that have gravity, or the scale factors are not known, and how far they may be off it.
const MOST: (f64, f64) = (0.8, 0.1);

impl Checker<'_> {
    /// Scale factors that are far off the nominal one of the campaign file.
    pub(super) fn nominal_scale_factor(&mut self) {
        let Some(nominal) = self.campaign.nominal_scale_factor else { return };
        let gravity = self.campaign.gravity_local / self.campaign.gravity_reference;
        let found = median((0..AXES).flat_map(|axis| self.nominal(axis)).filter(|k| *k > 0.0)) / gravity;
        let ratio = found / nominal;
        if !ratio.is_finite() || (NOMINAL.recip()..=NOMINAL).contains(&ratio) {
            return;
        }
        let keys = match self.campaign.layout {
            SampleLayout::Rows => "the rows",
            _ => "kind and gate_s",
        };
        let (times, cause) = match ratio > 1.0 {
            true => (ratio, "the numbers look like counts that are taken for rates, or gate_s is too short"),
            false => (ratio.recip(), "the numbers look like rates that are taken for counts, or gate_s is too long"),
        };
        let direction = if ratio > 1.0 { "larger" } else { "smaller" };
        let message = format!(
            "by gravity the scale factors are about {found:.4e} pulse/(s*g0), {times:.1} times {direction} than \
             nominal_scale_factor = {nominal}: {cause}; correct {keys}, or nominal_scale_factor"
        );
        self.findings.push(Finding::fault(name::COUNTS_OR_RATES, message));
    }

    /// Dwells whose specific force is a multiple of gravity, while most have gravity: files of another kind among them.
    /// Returns them.
    pub(super) fn multiples(&mut self) -> Vec<usize> {
        let scale_factors = [0, 1, 2].map(|axis| self.nominal(axis));
        if scale_factors.iter().flatten().any(|k| k.is_nan() || *k <= 1.0) {
            return Vec::new();
        }
        let length = |dwell: usize| {
            let indicated = scale_factors.iter().enumerate().map(|(axis, [up, down])| {
                let [positive, negative] = self.dwells[dwell].sums.rates(axis);
                positive / up - negative / down
            });
            indicated.map(|of_axis| of_axis * of_axis).sum::<f64>().sqrt()
        };
        let lengths: Vec<f64> = (0..self.dwells.len()).map(length).collect();
        let with_gravity = lengths.iter().filter(|length| (**length - 1.0).abs() < MOST.1).count();
        if (with_gravity as f64) < MOST.0 * lengths.len() as f64 {
            return Vec::new();
        }
        let of_dwells = lengths.iter().enumerate();
        let found: Vec<_> = of_dwells.filter_map(|(dwell, length)| Some((dwell, multiple(*length)?))).collect();
        for &(dwell, (factor, is_larger)) in &found {
            let (what, others) = if is_larger { ("counts", "rates") } else { ("rates", "counts") };
            let part = if is_larger { format!("{factor} times") } else { format!("1/{factor} of") };
            let message = format!(
                "{} indicate {part} gravity together, and gravity in most dwells: they look like {what} among {others} \
                 over {factor} s; give all files in one unit, or leave the dwell out with --exclude",
                AXIS_NAMES.join(", ")
            );
            self.report_dwell(Severity::Fault, name::COUNTS_OR_RATES, dwell, self.dwells[dwell].lines[0], message);
        }
        found.into_iter().map(|(dwell, _)| dwell).collect()
    }
}

/// The whole number over 1 that a length, or 1 over it, is; and whether it is the length.
fn multiple(length: f64) -> Option<(u32, bool)> {
    let is_larger = length > 1.0;
    let times = if is_larger { length } else { length.recip() };
    let whole = times.round();
    let is_it = MULTIPLES.contains(&whole) && (times / whole - 1.0).abs() < WHOLE;
    is_it.then_some((whole as u32, is_larger))
}
