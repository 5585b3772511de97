//! Mistakes that show without a trial: positions that are missing everywhere, channels without pulses, a wrong clock.

use super::cause::{Diagnosis, diagnosis};
use crate::checks::SetPoint;
use isotherm_campaign::{Campaign, Dwell};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, Severity, name};

/// Positions that no set point has.
pub(super) fn missing_everywhere(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    findings: &[Finding],
) -> Option<Diagnosis> {
    let missing: Vec<_> = (0..campaign.positions.len())
        .filter(|position| dwells.iter().all(|dwell| dwell.position != *position))
        .map(|position| campaign.positions[position].number.to_string())
        .collect();
    // A set point that lacks another position has its own cause.
    let has = |set_point: &SetPoint, position: usize| set_point.dwells.iter().any(|&d| dwells[d].position == position);
    let elsewhere = |position: usize| dwells.iter().any(|dwell| dwell.position == position);
    let lacks = |set_point: &SetPoint| {
        (0..campaign.positions.len()).any(|position| elsewhere(position) && !has(set_point, position))
    };
    let found = findings.iter().filter(|finding| finding.name == name::MISSING_POSITION).count();
    if missing.is_empty() || found != set_points.len() || found < 2 || set_points.iter().any(lacks) {
        return None;
    }
    let (verb, it, list) = match missing.as_slice() {
        [one] => ("is", "it", format!("position {one}")),
        many => ("are", "them", format!("positions {}", many.join(", "))),
    };
    let message = format!(
        "{list} of the campaign file {verb} missing at all {} set points: measure {it}, or take {it} out of the campaign file if the others \
         are enough",
        set_points.len()
    );
    Some(diagnosis(name::MISSING_POSITION, message, &[name::MISSING_POSITION, name::NO_PULSES]))
}

/// Channels without a pulse in the whole campaign, although the accelerometer points both ways.
pub(super) fn dead_channels(campaign: &Campaign, dwells: &[Dwell]) -> Option<Diagnosis> {
    let dead = |axis: usize, channel: usize| {
        let sign = [1.0, -1.0][channel];
        let pulses = |dwell: &Dwell| dwell.sums.rates(axis)[channel];
        dwells.iter().all(|dwell| pulses(dwell) == 0.0)
            && dwells.iter().any(|dwell| campaign.positions[dwell.position].specific_force[axis] * sign > 0.5)
    };
    let found: Vec<_> =
        (0..AXES).flat_map(|axis| (0..2).map(move |channel| (axis, channel))).filter(|&(a, c)| dead(a, c)).collect();
    let message = without_pulses(&found)?;
    Some(diagnosis(name::NO_PULSES, message, &[name::NO_PULSES, name::WRONG_POSITION, name::CHANNELS_DIFFER]))
}

/// What is said of the channels without pulses `dead`, each an axis and 0 for + or 1 for -.
fn without_pulses(dead: &[(usize, usize)]) -> Option<String> {
    let word = |channel: usize| ["+", "-"][channel];
    Some(match dead {
        [(axis, channel)] => format!(
            "the {} channel of {} gives no pulse in the whole campaign: fix its converter or cable, or the column a{}_{}, and measure again",
            word(*channel),
            AXIS_NAMES[*axis],
            axis + 1,
            ["positive", "negative"][*channel]
        ),
        [(a, _), (b, _)] if a == b => format!(
            "{} gives no pulse in the whole campaign: fix the accelerometer, its converter or cable, or the columns of its pulses, and \
             measure again",
            AXIS_NAMES[*a]
        ),
        [(_, a), (_, b), (_, c)] if a == b && b == c => format!(
            "no accelerometer gives a pulse on its {} channel in the whole campaign: the counts have lost their sign, or one channel was not \
             recorded; count both channels",
            word(*a)
        ),
        [] => return None,
        several => {
            // An accelerometer with two dead channels is one part.
            let part = |axis: usize| match several.iter().filter(|(a, _)| *a == axis).collect::<Vec<_>>()[..] {
                [] => None,
                [(_, channel)] => Some(format!("the {} channel of {}", word(*channel), AXIS_NAMES[axis])),
                _ => Some(AXIS_NAMES[axis].to_owned()),
            };
            let mut parts: Vec<_> = (0..AXES).filter_map(part).collect();
            let last = parts.pop().unwrap_or_default();
            format!(
                "{} and {last} give no pulse in the whole campaign: fix what they share, such as a supply, a connector or a converter, or the \
                 columns of their pulses, and measure again",
                parts.join(", ")
            )
        }
    })
}

/// Intervals or all times in a wrong unit: the checks have said which.
pub(super) fn clock(findings: &[Finding]) -> Option<Diagnosis> {
    // Single turns that are too fast, or the intervals of single dwells, have other causes and a place.
    let all = |name: &str| {
        let index = findings.iter().position(|f| f.severity == Severity::Fault && f.name == name && f.place.is_none());
        index.map(|index| (index, &findings[index]))
    };
    let explains = &[name::INTERVAL, name::IMPOSSIBLE_MOTION, name::IMPOSSIBLE_RAMP, name::SOAK, name::DURATION];
    match (all(name::IMPOSSIBLE_MOTION), all(name::INTERVAL)) {
        (Some((index, finding)), None) | (None, Some((index, finding))) => {
            Some(Diagnosis { finding: finding.clone(), explains, promoted: Some(index) })
        }
        _ => None,
    }
}
