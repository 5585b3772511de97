//! Coverage of the confidence intervals: how often a 95 % interval contains the truth in simulated campaigns.

use super::station::{Station, cubic};
use isotherm_fit::CalibrationOptions;
use isotherm_shared::table::GYROSCOPE_NAMES;

const LEVEL: f64 = 0.95;

/// The number of intervals that contain the truth, by name.
fn hits(campaigns: u64, make: impl Fn(u64) -> Station) -> Vec<(String, u64)> {
    let mut hits: Vec<(String, u64)> = Vec::new();
    let mut count = |name: String, hit: bool| match hits.iter_mut().find(|(known, _)| *known == name) {
        Some((_, count)) => *count += u64::from(hit),
        None => hits.push((name, u64::from(hit))),
    };
    let mut worst = [0.0_f64; 4];
    for seed in 1000..1000 + campaigns {
        let station = make(seed);
        let calibration =
            station.calibrate(CalibrationOptions { order: Some(3), ..CalibrationOptions::default() }).unwrap();
        for (worst, error) in worst.iter_mut().zip(station.errors(&calibration)) {
            *worst = worst.max(error);
        }
        let found = calibration.gyroscopes.as_ref().unwrap();
        for (axis, (part, right)) in found.solution.gyroscopes.iter().zip(&station.gyroscopes).enumerate() {
            let name = GYROSCOPE_NAMES[axis];
            for ((quantity, curve), truth) in
                ["D", "K+", "K-"].iter().zip(&part.curves).zip([right.bias, right.kp, right.kn])
            {
                let [low, high] = curve.range();
                for place in [0.0, 0.25, 0.5, 0.9] {
                    let u = low + place * (high - low);
                    let inside = (curve.at(u) - cubic(&truth, u)).abs() <= curve.interval(u, LEVEL).unwrap();
                    count(format!("{name} {quantity} at {place:.2}"), inside);
                }
            }
            for (k, half) in part.misalignment_interval(LEVEL).unwrap().into_iter().enumerate() {
                count(format!("{name} m{k}"), (part.misalignment[k] - right.m[(axis + 1 + k) % 3]).abs() <= half);
            }
            for (k, half) in part.g_sensitivity_interval(LEVEL).unwrap().into_iter().enumerate() {
                count(format!("{name} s{k}"), (part.g_sensitivity[k] - right.s[k]).abs() <= half);
            }
        }
        let earth = found.solution.earth.unwrap().into_iter().zip(found.solution.earth_error.unwrap());
        for ((k, (value, error)), right) in earth.enumerate().zip([station.earth().x, station.earth().y]) {
            let half = error * isotherm_statistics::student_quantile(LEVEL, 14);
            count(format!("w{k}"), (value - right).abs() <= half);
        }
    }
    println!(
        "worst of {campaigns}: D {:.4} deg/h, K {:.2} ppm, s {:.4} deg/h/g0, M {:.1e} rad",
        worst[0], worst[1], worst[2], worst[3]
    );
    hits
}

#[test]
fn intervals_contain_the_truth_in_twenty_campaigns() {
    // 53 intervals of 20 campaigns: together 95 % within what chance allows, and none far off by itself.
    let hits = hits(20, |seed| Station::new(seed).noisy());
    assert_eq!(hits.len(), 3 * (3 * 4 + 2 + 3) + 2);
    let all: u64 = hits.iter().map(|(_, count)| count).sum();
    let part = all as f64 / (20 * hits.len()) as f64;
    println!("{:.2} % of {} intervals", part * 100.0, 20 * hits.len());
    assert!((0.92..0.98).contains(&part), "{part}");
    assert!(hits.iter().all(|(_, count)| *count >= 15), "{hits:?}");
}

#[test]
#[ignore = "a minute: cargo test -p isotherm-fit --test all two_hundred -- --ignored --nocapture"]
fn intervals_contain_the_truth_in_two_hundred_campaigns() {
    let mut hits = hits(200, |seed| Station::new(seed).noisy());
    hits.sort_by_key(|(_, count)| *count);
    let all: u64 = hits.iter().map(|(_, count)| count).sum();
    println!(
        "{:.2} % of all; {}",
        all as f64 / (2 * hits.len()) as f64,
        hits.iter().map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
    );
    let mut raised = 0;
    for seed in 1000..1200 {
        let calibration = Station::new(seed).noisy().calibrate(CalibrationOptions::default()).unwrap();
        let orders: Vec<_> =
            calibration.gyroscopes.unwrap().orders.iter().flatten().map(|table| table.choice.order).collect();
        if orders.iter().any(|order| *order != 3) {
            raised += 1;
            println!("{orders:?}");
        }
    }
    println!("{raised} of 200 have an order over 3");
    // The 53 counts are binomial with 190 +- 3.1, the lowest of so many is over 178.
    assert!(hits.iter().all(|(_, count)| (178..=200).contains(count)), "{hits:?}");
    assert!((0.935..0.965).contains(&(all as f64 / (200 * hits.len()) as f64)));
}
