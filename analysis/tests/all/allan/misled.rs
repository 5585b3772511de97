//! What would be certified as noise and is none: steps, filters, repeated values. None of them is seen in honest records.

use super::recording::{ALL, rows};
use super::simulated::{Truth, rates};
use isotherm_analysis::{Allan, NoiseAnalysis};

#[test]
#[ignore = "measures"]
fn measure() {
    let truths = [
        Truth { quantisation: 0.35, white: 1.0, flicker: 0.3, walk: 0.02 },
        Truth { quantisation: 0.35, white: 1.0, flicker: 0.0, walk: 0.0 },
        Truth { quantisation: 0.35, white: 1.0, flicker: 0.3, walk: 0.002 },
        Truth { quantisation: 0.0, white: 1.0, flicker: 1.0, walk: 0.0 },
        Truth { quantisation: 0.35, white: 1.0, flicker: 0.0, walk: 0.1 },
        Truth { quantisation: 0.0, white: 0.1, flicker: 0.0, walk: 0.3 },
        Truth { quantisation: 1.0, white: 0.1, flicker: 0.1, walk: 0.001 },
    ];
    for truth in truths {
        for (n, interval) in [(2048, 0.1), (8192, 0.1), (8192, 0.005)] {
            let (mut steps, mut filtered, mut holds) = (0, 0, 0);
            for seed in 0..50 {
                let mut rates = rates(&truth, n, seed);
                rates.iter_mut().for_each(|rate| *rate /= interval);
                let found = Allan::of(&rates, interval).unwrap();
                steps += usize::from(!found.steps.is_empty());
                filtered += usize::from(found.filtered_errors.is_some());
                holds += usize::from(found.model.is_some_and(|model| model.holds()));
            }
            println!("{truth:?} {n} {interval}: steps {steps} filtered {filtered} holds {holds} of 50");
        }
    }
    for counts in [0.05, 0.15, 0.25, 0.3, 0.4, 0.7, 1.0, 3.0, 20.0] {
        for offset in [4000.3, 4000.05, 4000.5, 4000.77] {
            let white = [1, 2, 3].map(|seed| {
                let truth = Truth { quantisation: 0.0, white: counts, flicker: 0.0, walk: 0.0 };
                rates(&truth, 8192, seed)
            });
            let found = NoiseAnalysis::of(&rows(&white, offset), None, ALL).unwrap();
            println!(
                "{counts} {offset}: cycle {:?} changes {:?} {:?}",
                found.sensors[0].limit_cycle(),
                found.sensors[0].changes,
                found.findings().iter().map(ToString::to_string).collect::<Vec<_>>()
            );
        }
    }
}
