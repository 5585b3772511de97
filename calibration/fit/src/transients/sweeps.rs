//! What sweeps show against each other: the band between them, which is the error of a curve, and what no lag explains:
//! steps, another unit, rows that are missing.

use super::blocks::{Bias, Ramps};
use super::recording::RampRecording;
use super::result::BiasTransient;
use super::steps::{Step, words};
use crate::sensor::TriadUnits;
use isotherm_shared::polynomial::Polynomial;
use isotherm_statistics::{BINS, Disagreement, SweepBand, SweepValues, sweep_band};
use isotherm_support::finding::{Finding, Severity, name};

/// A step over this part of what a curve spans makes a wrong curve.
const STEP_OF_SPAN: f64 = 0.2;
/// A recording has another shape if the band with it is over this many times that of the others, and its own …
const OTHER_BAND: f64 = 5.0;
/// … over this part of what the curve spans …
const OTHER_SPAN: f64 = 0.2;
/// … and over this part of the difference of the specific forces that the axis carries: a scale factor changes less.
const OTHER_FORCE: f64 = 0.03;
/// More time without rows than this part of a recording is named.
const MISSING: f64 = 0.01;

/// The sweeps of a bias after `soak_s`, with what `residual` gives for each block.
pub(super) fn values(ramps: &Ramps, of: &Bias, soak_s: f64, residual: impl Fn(usize) -> f64) -> Vec<SweepValues> {
    let of_sweep = |sweep: &super::blocks::RampSweep| {
        let blocks = sweep.pieces.iter().flat_map(Clone::clone);
        let there = blocks.filter(|&i| ramps.blocks[i].age_s > soak_s && !ramps.blocks[i].left_out);
        let values = there.map(|i| (of.temperature[i], residual(i))).collect();
        SweepValues { recording: sweep.recording, heating: sweep.heating, values }
    };
    ramps.sweeps.iter().map(of_sweep).collect()
}

/// The error of a curve from the sweeps' residuals under what is written; `None` if less than half of the range has
/// heating and cooling.
pub(super) fn curve_error(sweeps: &[SweepValues], range: [f64; 2]) -> Option<SweepBand> {
    sweep_band(sweeps, range).filter(|band| 2 * band.both_directions >= BINS)
}

/// What a curve spans over a range.
pub(super) fn span(curve: &Polynomial, [low, high]: [f64; 2]) -> f64 {
    let values = (0..=BINS).map(|k| curve.at(curve.clamp(low + (high - low) * k as f64 / BINS as f64)));
    let [least, most] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], value| [a.min(value), b.max(value)]);
    most - least
}

/// Whether a step is so large that the curves would be wrong. `spans` are those of the biases' curves.
pub(super) fn spoils(steps: &[Step], spans: &[f64]) -> bool {
    steps.iter().any(|step| step.size.abs() > STEP_OF_SPAN * spans[step.bias])
}

/// The findings: steps first, since they make sweeps differ. `models` are the sweeps of each bias without the static
/// curve, and without curve and estimated transient.
pub(super) fn findings(
    ramps: &Ramps,
    recordings: &[RampRecording],
    steps: &[Vec<Step>],
    biases: &[BiasTransient],
    [still, lagless]: &[Vec<Vec<SweepValues>>; 2],
    spans: &[f64],
) -> Vec<Finding> {
    let mut all: Vec<Finding> = recordings.iter().filter_map(missing).collect();
    for steps in steps {
        let severity = if spoils(steps, spans) { Severity::Fault } else { Severity::Warning };
        all.extend(words(ramps, recordings, steps).map(|words| {
            let message = format!(
                "{words}; a bump, or a sensor that jumps, and no hysteresis: record this ramp again with the IMU held fast, or give \
                 what comes before or after as a ramp of its own"
            );
            Finding::whole(severity, name::RAMP_STEP, message)
        }));
    }
    if steps.iter().any(|steps| spoils(steps, spans)) {
        return all;
    }
    let others: Vec<(usize, usize, f64)> = (0..biases.len())
        .filter_map(|bias| {
            let (recording, differs) = other_device(&ramps.biases[bias], &still[bias], spans[bias])?;
            // A recording is of one device, whatever its stretches show.
            (!recordings[recording].is_stretch()).then_some((recording, bias, differs))
        })
        .collect();
    if let Some((recording, ..)) = others.first() {
        all.push(of_another_device(recordings, *recording, &others, biases));
        return all;
    }
    all.extend(disagreement(ramps, recordings, biases, lagless));
    all
}

/// The recording whose sweeps have another shape than the others', with the difference; the last one if there are two.
fn other_device(of: &Bias, sweeps: &[SweepValues], span: f64) -> Option<(usize, f64)> {
    let recordings = sweeps.iter().map(|sweep| sweep.recording).max()? + 1;
    let width = |keep: &dyn Fn(usize) -> bool| {
        let kept: Vec<_> = sweeps.iter().filter(|sweep| keep(sweep.recording)).cloned().collect();
        sweep_band(&kept, of.range).map_or(0.0, |band| 2.0 * band.half_width)
    };
    let all = sweep_band(sweeps, of.range)?;
    all.disagreement.as_ref()?;
    let differs = 2.0 * all.half_width;
    let [least, most] =
        of.carried.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], force| [a.min(*force), b.max(*force)]);
    let is_other = |recording: &usize| {
        let [rest, own] = [width(&|it| it != *recording), width(&|it| it == *recording)];
        differs > OTHER_BAND * rest.max(own)
    };
    let large = recordings > 1 && differs > (OTHER_SPAN * span).max(OTHER_FORCE * (most - least));
    (0..recordings).rev().find(|recording| large && is_other(recording)).map(|recording| (recording, differs))
}

fn of_another_device(
    recordings: &[RampRecording],
    recording: usize,
    others: &[(usize, usize, f64)],
    biases: &[BiasTransient],
) -> Finding {
    let sizes: Vec<_> = others
        .iter()
        .map(|(_, bias, differs)| {
            format!("{} by {}", biases[*bias].name(), TriadUnits::of(biases[*bias].kind).bias_text(*differs))
        })
        .collect();
    let rest = match recordings.len() {
        2 => format!("as {}", recordings[1 - recording].name()),
        _ => "as the others".to_owned(),
    };
    let message = format!(
        "{}: the biases do not change over temperature {rest} ({}), while the sweeps of each recording agree: a ramp of another device; give \
         the ramps of one device",
        recordings[recording].name(),
        sizes.join(", ")
    );
    Finding::whole(Severity::Fault, name::RAMP_DEVICE, message)
}

/// The warning that sweeps differ by more than their noise and a lag.
fn disagreement(
    ramps: &Ramps,
    recordings: &[RampRecording],
    biases: &[BiasTransient],
    lagless: &[Vec<SweepValues>],
) -> Option<Finding> {
    let found = biases.iter().zip(&ramps.biases).zip(lagless);
    let words: Vec<String> = found
        .filter_map(|((bias, of), sweeps)| {
            let Disagreement { difference, errors, at, sweeps } = sweep_band(sweeps, of.range)?.disagreement?;
            // What the table that is written leaves apart, if that is known.
            let (difference, at) =
                bias.curve_error.as_ref().map_or((difference, at), |band| (2.0 * band.half_width, band.at));
            let sweep = |index: usize| {
                let sweep = &ramps.sweeps[index];
                let direction = if sweep.heating { "heating" } else { "cooling" };
                match recordings {
                    [_] => direction.to_owned(),
                    _ => format!("{direction} of {}", recordings[sweep.recording].name()),
                }
            };
            Some(format!(
                "{} by {} at {at:.3}, {errors:.0} times their noise ({} and {})",
                bias.name(),
                TriadUnits::of(bias.kind).bias_text(difference),
                sweep(sweeps[0]),
                sweep(sweeps[1])
            ))
        })
        .collect();
    let message = format!(
        "sweeps differ by more than noise and a lag explain: {}; hysteresis, a drift with time, or a start that was not soaked",
        words.join("; ")
    );
    (!words.is_empty()).then(|| Finding::warning(name::RAMP_SWEEPS, message))
}

/// The warning that much of a recording is missing.
fn missing(recording: &RampRecording) -> Option<Finding> {
    let (missing_s, all_s) = recording.missing_s();
    let (at_s, gap_s) = recording.largest_gap_s();
    let [from, to] = recording.temperature_around_gap()?;
    (missing_s > MISSING * all_s).then(|| {
        let message = format!(
            "{}: rows are missing for {missing_s:.0} of {all_s:.0} s, the most for {gap_s:.0} s, {at_s:.0} s after its begin, from {from:.3} to \
             {to:.3} of a1_head: there the curves come only from other sweeps; give all pieces of the recording, or record the ramp again",
            recording.name()
        );
        Finding::warning(name::MISSING_ROWS, message)
    })
}
