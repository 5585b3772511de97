//! The static poses of all recordings.

use super::error::TumbleError;
use super::reading::Reading;
use super::recording::TumbleRecording;
use super::temperature::temperature_steps;
use isotherm_campaign::{StaticPoses, begins_ns, faults, find_static_poses};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_support::finding::Finding;

/// What the search for static poses gave.
pub(super) struct PoseSearch {
    pub readings: Vec<Reading>,
    pub too_short: usize,
    pub turned: usize,
    pub noise: Vec<[f64; AXES]>,
    /// What is wrong with the counts.
    pub counts: Vec<Finding>,
}

impl PoseSearch {
    pub(super) fn of(recordings: &[TumbleRecording], window_s: Option<f64>) -> Result<Self, TumbleError> {
        let mut found = Self { readings: Vec::new(), too_short: 0, turned: 0, noise: Vec::new(), counts: Vec::new() };
        let has_gyroscopes = |row: &RawSample| {
            let triad = &row.gyroscopes;
            triad.positive_pulses.iter().chain(&triad.negative_pulses).any(|pulses| *pulses > 0)
        };
        let with_gyroscopes = recordings.iter().flat_map(|recording| &recording.rows).any(has_gyroscopes);
        for (index, recording) in recordings.iter().enumerate() {
            let TumbleRecording { name, rows, .. } = recording;
            let begins_ns = begins_ns(rows);
            let steps = temperature_steps(rows);
            let poses = find_static_poses(rows, window_s)
                .and_then(StaticPoses::without_turned)
                .map_err(|error| TumbleError::StaticPose { name: name.clone(), error })?;
            for pose in &poses.found {
                let number = found.readings.len() + 1;
                let range = pose.rows.clone();
                let start_s = begins_ns[range.start] as f64 / 1e9;
                found.readings.push(Reading::of(
                    [number, index],
                    rows,
                    range,
                    start_s,
                    &poses,
                    &steps,
                    with_gyroscopes,
                ));
            }
            let at_rest: Vec<_> = poses.found.iter().map(|pose| pose.rows.clone()).collect();
            found.counts.extend(faults(rows, &at_rest).into_iter().map(|finding| finding.at(recording.place())));
            found.too_short += poses.too_short;
            found.turned += poses.turned;
            found.noise.push(poses.noise);
        }
        Ok(found)
    }
}

/// The readings but those of the static poses of these numbers.
pub(super) fn excluding(mut readings: Vec<Reading>, numbers: &[usize]) -> Result<Vec<Reading>, TumbleError> {
    let count = readings.len();
    if let Some(missing) = numbers.iter().find(|number| !(1..=count).contains(number)) {
        return Err(TumbleError::NothingToExclude(*missing, count));
    }
    readings.retain(|reading| !numbers.contains(&reading.number));
    Ok(readings)
}
