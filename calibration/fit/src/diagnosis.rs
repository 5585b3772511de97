//! The single mistake that explains the data, if there is one: exchanged positions, cables, channels, a turned IMU, a
//! position that is off.
//!
//! # Method
//! Each set point is reduced by itself, all accelerometers together, with the base's tilt where the angles are known:
//!
//! ```text
//! rate+/K+ + rate-/K- = f_a + m_p f_p + m_o f_o + by_tilt t + A
//! ```
//! This is linear in 1/K+, 1/K-, A, m_p, m_o of each accelerometer and in t. A hypothesis changes the specific force of
//! dwells or the columns that are an accelerometer's, and the reduction is repeated. A hypothesis holds at a set point
//! where its residuals are a tenth of those without it, and its scale factors have the right signs. It explains the
//! data if, with it where it holds, the residuals of all set points together are a tenth of those without.
//!
//! The residuals do not change if both channels of an accelerometer are exchanged: K+ is then negative. So the six
//! orders of the accelerometers are tried, and the signs of the scale factors show the rest: exchanged channels, or a
//! turned IMU. Single channels of two accelerometers are exchanged one by one.

mod cause;
mod evident;
mod explanation;
mod hypothesis;
mod position_off;
mod reduction;
mod unit;
mod words;

use crate::checks::SetPoint;
pub(crate) use cause::Diagnosis;
use isotherm_campaign::{Campaign, Dwell};
use isotherm_support::finding::{Finding, Severity, name};
pub(crate) use position_off::positions_off;
use reduction::{MAX_DWELLS, Trials};

/// The single mistake that explains the `findings` about `dwells`; `None` if there is none, or if there are several. A
/// finding that is the mistake itself is taken out of the findings.
#[must_use]
pub(crate) fn diagnose(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    findings: &mut Vec<Finding>,
) -> Option<Diagnosis> {
    let found = single_cause(campaign, dwells, set_points, findings)?;
    if let Some(index) = found.promoted {
        findings.remove(index);
    }
    Some(found)
}

fn single_cause(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    findings: &[Finding],
) -> Option<Diagnosis> {
    if dwells.len() > MAX_DWELLS {
        return None;
    }
    if let Some(other) = unit::other_device(campaign, dwells, set_points) {
        return Some(other);
    }
    let faults = |names: &[&str]| findings.iter().any(|f| f.severity == Severity::Fault && names.contains(&f.name));
    let mut causes: Vec<Diagnosis> = Vec::new();
    causes.extend(evident::missing_everywhere(campaign, dwells, set_points, findings));
    causes.extend(evident::dead_channels(campaign, dwells));
    causes.extend(evident::clock(findings));
    // Positions that are missing, or channels without pulses, leave no set point that could be reduced.
    if causes.iter().all(|cause| cause.finding.name == name::IMPOSSIBLE_MOTION || cause.finding.name == name::INTERVAL)
    {
        // Motion within a dwell has been named, and is no wrong position.
        match Trials::new(campaign, dwells, set_points).forces(!faults(&[name::NOT_STILL]), findings) {
            Some(of_forces) => {
                // The intervals are then a part of what the hypothesis changes.
                causes.retain(|cause| cause.finding.name != of_forces.finding.name);
                causes.push(of_forces);
            }
            // Something else is wrong as well.
            None if faults(&[name::WRONG_POSITION, name::POSITION_OFF]) => return None,
            None => {}
        }
    }
    let mut causes = causes.into_iter();
    causes.next().filter(|_| causes.next().is_none())
}
