//! Coverage of the confidence intervals: how many of the simulated campaigns have the truth in a 95 % interval.

use super::common::{calibrated, paper};
use isotherm_fit::CalibrationOptions;
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
                    let temperature = low + place * (high - low);
                    let error = curve.at(temperature) - polynomial.at(temperature) * unit;
                    let inside = error.abs() <= curve.interval(temperature, LEVEL).unwrap();
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
#[ignore = "half a minute: cargo test -p isotherm-fit --test all as_often -- --ignored --nocapture"]
fn intervals_contain_the_truth_as_often_as_their_level_states() {
    let hits = hits(200);
    let outside: Vec<_> = hits.iter().filter(|(_, count)| !(184..=196).contains(count)).collect();
    assert!(outside.is_empty(), "{outside:?}");
}

/// Shares of curves that are within their band everywhere, within their pointwise intervals everywhere, and within the
/// largest half width of either everywhere.
fn whole_curves(campaigns: u64, set_points: u32) -> [f64; 4] {
    const STEPS: u32 = 64;
    let step = 70.0 / f64::from(set_points - 1);
    let set_points_c = (0..set_points).map(|number| -25.0 + step * f64::from(number)).collect();
    let schedule = CampaignSchedule { set_points_c, interval_ns: 60_000_000_000, ..CampaignSchedule::default() };
    let seed = std::env::var("ISOTHERM_SEED").map_or(0, |text| text.parse::<u64>().unwrap());
    let (mut inside, mut curves) = ([0_u32; 4], 0_u32);
    for seed in seed * campaigns..(seed + 1) * campaigns {
        let truth = Truth::varied(paper().content(), seed).unwrap();
        let options = CalibrationOptions { order: Some(3), ..CalibrationOptions::default() };
        let (_, calibration) = calibrated(&truth, &schedule, seed, options).unwrap();
        for (part, right) in calibration.solution.axes.iter().zip(&truth.table.content().axes) {
            let unit = right.bias_unit.factor();
            let polynomials =
                [(&right.bias, unit), (&right.positive_scale_factor, 1.0), (&right.negative_scale_factor, 1.0)];
            for (curve, (polynomial, unit)) in part.curves.iter().zip(polynomials) {
                let [low, high] = curve.range();
                let quantile = curve.band_quantile(LEVEL).unwrap();
                let at = |step: u32| low + (high - low) * f64::from(step) / f64::from(STEPS);
                let errors: Vec<[f64; 3]> = (0..=STEPS)
                    .map(at)
                    .map(|u| {
                        let error = (curve.at(u) - polynomial.at(u) * unit).abs();
                        [error, curve.half_width(u, quantile).unwrap(), curve.interval(u, LEVEL).unwrap()]
                    })
                    .collect();
                let widest = |k: usize| errors.iter().map(|error| error[k]).fold(0.0, f64::max);
                let within = [
                    errors.iter().all(|[error, band, _]| error <= band),
                    errors.iter().all(|[error, _, interval]| error <= interval),
                    widest(0) <= widest(1),
                    widest(0) <= widest(2),
                ];
                inside.iter_mut().zip(within).for_each(|(count, within)| *count += u32::from(within));
                curves += 1;
            }
        }
    }
    let shares = inside.map(|count| f64::from(count) / f64::from(curves));
    println!(
        "{set_points} set points, {curves} curves: the truth is everywhere within the band in {:.1} %, within the pointwise \
         interval in {:.1} %; within the largest half width of the band in {:.1} %, of the interval in {:.1} %",
        100.0 * shares[0],
        100.0 * shares[1],
        100.0 * shares[2],
        100.0 * shares[3]
    );
    shares
}

#[test]
fn bands_contain_the_whole_truth_in_sixty_campaigns() {
    let [band, pointwise, ..] = whole_curves(60, 15);
    assert!((0.92..0.98).contains(&band), "{band}");
    assert!(pointwise < band - 0.03, "{pointwise}");
}

#[test]
#[ignore = "minutes: cargo test --release -p isotherm-fit --test all whole_truth -- --ignored --nocapture"]
fn bands_contain_the_whole_truth_as_often_as_their_level_states() {
    for set_points in [6, 8, 11, 15] {
        let [band, ..] = whole_curves(500, set_points);
        assert!((0.93..0.97).contains(&band), "{set_points} set points: {band}");
    }
}
