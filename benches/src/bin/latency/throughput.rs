//! Throughput with many samples in flight, compared with a bare iceoryx2 pair that is used in the same way.

use crate::pairs::spawn_echo;
use crate::paths::{Bare, Isotherm, Stream};
use isotherm_benches::{BenchDomain, BenchResult, Common, IMU, Spin, median, pin_apart, sample, served_by};
use serde_json::{Value, json};
use std::time::Instant;

/// Samples in flight.
const IN_FLIGHT: usize = 16;
/// Samples of a block.
const BLOCK: usize = 50_000;

pub(crate) fn measure(common: Common) -> BenchResult<Value> {
    let core = pin_apart();
    let rounds = common.rounds(2, 20);
    let (mut isotherm, mut iceoryx2) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        let (one, other) = (BenchDomain::new()?, BenchDomain::new()?);
        let service = one.serve(None, &served_by("spin", core))?;
        let mut path = Isotherm(one.acquisition(IMU)?);
        service.pause();
        let echo = spawn_echo(&other, core, IN_FLIGHT, 1)?;
        let mut bare = Bare::connect(other.as_domain(), IN_FLIGHT)?;
        echo.pause();

        service.resume();
        isotherm.push(block(&mut path)?);
        service.pause();
        echo.resume();
        iceoryx2.push(block(&mut bare)?);
        echo.pause();
    }
    let ratio = median(isotherm.iter().zip(&iceoryx2).map(|(isotherm, bare)| isotherm / bare).collect());
    let path = |times: Vec<f64>| {
        let ns = median(times);
        json!({"ns_per_sample": ns, "samples_per_s": ns.map(|ns| (1e9 / ns).round())})
    };
    Ok(json!({"throughput": {
        "in_flight": IN_FLIGHT,
        "rounds": rounds,
        "isotherm": path(isotherm),
        "iceoryx2": path(iceoryx2),
        "ns_per_sample isotherm/iceoryx2": ratio,
    }}))
}

/// Measures a block. Returns the time of a sample \[ns\].
fn block(path: &mut impl Stream) -> BenchResult<f64> {
    let sample = sample();
    let (mut sent, mut received) = (0, 0);
    let mut started = Instant::now();
    let mut spin = Spin::default();
    // The first tenth is not counted.
    while received < BLOCK + BLOCK / 10 {
        while sent < received + IN_FLIGHT {
            path.send(&sample)?;
            sent += 1;
        }
        if path.receive()?.is_some() {
            received += 1;
            spin = Spin::default();
            if received == BLOCK / 10 {
                started = Instant::now();
            }
        } else {
            spin.turn()?;
        }
    }
    let elapsed = started.elapsed();
    while received < sent {
        if path.receive()?.is_some() {
            received += 1;
        } else {
            spin.turn()?;
        }
    }
    Ok(elapsed.as_secs_f64() * 1e9 / BLOCK as f64)
}
