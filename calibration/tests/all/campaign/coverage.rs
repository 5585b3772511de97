//! Coverage of the confidence intervals: how many of the simulated campaigns have the truth in a 95 % interval.

use super::common::{calibrated, paper};
use isotherm_calibration::CalibrationOptions;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_simulation::{CampaignSchedule, Truth};

const LEVEL: f64 = 0.95;

/// Number of intervals of so many campaigns that contain the truth, by name.
fn hits(campaigns: u64) -> Vec<(String, u32)> {
    let schedule = CampaignSchedule { interval_ns: 60_000_000_000, ..CampaignSchedule::default() };
    let paper = paper();
    let mut hits: Vec<(String, u32)> = Vec::new();
    let mut count = |name: String, hit: bool| {
        match hits.iter_mut().find(|(known, _)| *known == name) {
            Some((_, count)) => *count += u32::from(hit),
            None => hits.push((name, u32::from(hit))),
        };
    };
    for seed in 0..campaigns {
        let truth = Truth::varied(paper.content(), seed).unwrap();
        let (_, calibration) =
            calibrated(&truth, &schedule, seed, CalibrationOptions { order: Some(3), ..CalibrationOptions::default() })
                .unwrap();
        let axes = calibration.solution.axes.iter().zip(&truth.table.content().axes);
        for (axis, ((part, right), axis_name)) in axes.zip(AXIS_NAMES).enumerate() {
            let unit = right.bias_unit.factor();
            let polynomials =
                [(&right.bias, unit), (&right.positive_scale_factor, 1.0), (&right.negative_scale_factor, 1.0)];
            for ((name, curve), (polynomial, unit)) in ["A", "K+", "K-"].iter().zip(&part.curves).zip(polynomials) {
                let [low, high] = curve.range();
                for place in [0.0, 0.25, 0.5, 0.9] {
                    let telemetry = low + place * (high - low);
                    let error = curve.at(telemetry) - polynomial.at(telemetry) * unit;
                    let inside = error.abs() <= curve.interval(telemetry, LEVEL).unwrap();
                    count(format!("{axis_name} {name} at {place:.2}"), inside);
                }
            }
            let interval = part.misalignment_interval(LEVEL).unwrap();
            for (k, (got, half)) in part.misalignment.iter().zip(interval).enumerate() {
                let right = truth.misalignment[(axis, (axis + 1 + k) % 3)];
                let inside = (got - right).abs() <= half;
                count(format!("{axis_name} m{k}"), inside);
            }
        }
    }
    for (name, count) in &hits {
        println!("{name:16} {count}");
    }
    assert_eq!(hits.len(), 3 * (3 * 4 + 2));
    hits
}

#[test]
fn intervals_contain_the_truth_in_forty_campaigns() {
    // 42 intervals of 40 campaigns: together 95 % within what chance allows, and none far off by itself.
    let hits = hits(40);
    let all: u32 = hits.iter().map(|(_, count)| count).sum();
    let part = f64::from(all) / (40 * hits.len()) as f64;
    assert!((0.93..0.97).contains(&part), "{part}");
    assert!(hits.iter().all(|(_, count)| *count >= 33), "{hits:?}");
}

#[test]
#[ignore = "half a minute: cargo test -p isotherm-calibration --test all as_often -- --ignored --nocapture"]
fn intervals_contain_the_truth_as_often_as_their_level_states() {
    let hits = hits(200);
    let outside: Vec<_> = hits.iter().filter(|(_, count)| !(184..=196).contains(count)).collect();
    assert!(outside.is_empty(), "{outside:?}");
}
