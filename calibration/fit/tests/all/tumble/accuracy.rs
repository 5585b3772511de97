//! Simulated campaigns: how far the estimates are off, and whether their standard errors say so.

use super::common::{STANDARD, SimulatedImu, Truth, campaign, cube, off, recording};
use isotherm_fit::{TumbleOptions, calibrate_tumble};
use isotherm_simulation::RandomGenerator;

#[test]
fn errors_are_as_large_as_their_standard_errors() {
    let (mut worst, mut squares, mut count) = ([0.0_f64; 3], [0.0; 3], [0.0; 3]);
    let campaigns = if std::env::var_os("ISOTHERM_NIGHTLY").is_some() { 28 } else { 10 };
    for seed in 0..campaigns {
        let truth = Truth::random(seed);
        let local = 9.79179;
        let mut imu = SimulatedImu::new(truth.clone(), seed, local / STANDARD);
        // Residuals are then 2.8e-6 g0 rms, as those of tumble3.
        imu.noise = 2e-5;
        let mut random = RandomGenerator::new(seed, 4);
        let temperatures = [-10.0, 25.0, 60.0];
        for temperature in temperatures {
            let directions: Vec<_> = cube().iter().map(|direction| off(&mut random, direction, 8.0)).collect();
            imu.tumble(&directions, temperature);
        }
        let found =
            calibrate_tumble(&campaign([local, STANDARD]), &[recording(&imu.rows)], &TumbleOptions::default()).unwrap();
        assert_eq!((found.readings.len(), found.too_short), (78, 0), "seed {seed}");
        assert!(found.unknowns.order == 1 && found.unknowns.split, "seed {seed}: {:?}", found.reasons);
        for temperature in [-9.8, 25.2, 60.2] {
            for axis in 0..3 {
                for quantity in 0..3 {
                    let sign = if quantity == 2 { -1.0 } else { 1.0 };
                    let right = sign * truth.value(axis, quantity, temperature);
                    let curve = &found.curves[axis][quantity];
                    let off = curve.at(temperature) - right;
                    let kind = usize::from(quantity > 0);
                    let size = if quantity == 0 { 1.0 } else { right };
                    worst[kind] = worst[kind].max((off / size).abs());
                    squares[kind] += (off / curve.standard_error(temperature).unwrap()).powi(2);
                    count[kind] += 1.0;
                }
            }
        }
        let errors = found.misalignment_error.unwrap();
        for (k, (i, j)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
            let off = found.misalignment[(i, j)] - truth.misalignment[(i, j)];
            worst[2] = worst[2].max(off.abs());
            squares[2] += (off / errors[k]).powi(2);
            count[2] += 1.0;
        }
    }
    let ratios = [0, 1, 2].map(|kind| (squares[kind] / count[kind]).sqrt());
    println!(
        "worst: bias {:.1}e-6 g0, K {:.1} ppm, m {:.1}e-6 rad; error over standard error {ratios:.2?}",
        worst[0] * 1e6,
        worst[1] * 1e6,
        worst[2] * 1e6
    );
    assert!(worst[0] < 16e-6 && worst[1] < 25e-6 && worst[2] < 6e-6, "{worst:?}");
    assert!(ratios.iter().all(|ratio| (0.6..1.3).contains(ratio)), "{ratios:?}");
}
