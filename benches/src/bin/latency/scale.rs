//! Latency for different numbers of IMUs: with one that sends while the others are idle; and with all sending together,
//! compared with as many bare pairs, until the last sample is answered.

use crate::paced::{OwnWork, Pace, series_figures};
use crate::pairs::{Pair, alternate};
use crate::paths::{Isotherm, Path as _};
use isotherm_benches::{
    BenchDomain, BenchResult, Common, cores, figures, imu, nanoseconds, pin_apart, sample, served_by,
};
use serde_json::{Map, Value, json};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Numbers of IMUs.
const COUNTS: [usize; 3] = [1, 8, 32];
/// Rate at which all IMUs send together \[Hz\].
const RATE: u32 = 400;
/// Periods of a block in which all send together, and rounds of new processes.
const PERIODS: usize = 210;
const ROUNDS: usize = 6;

/// The ratios of the time until the last sample is answered.
const RATIOS: [&str; 4] =
    ["isotherm/iceoryx2", "isotherm_anticipate/iceoryx2", "isotherm_two_workers/iceoryx2", "iceoryx2_again/iceoryx2"];

pub(crate) fn measure(common: Common) -> BenchResult<Value> {
    let settings = served_by("spin", pin_apart());
    let mut idle = Map::new();
    for count in COUNTS {
        let domain = BenchDomain::new()?;
        let _service = domain.serve_many(count, 1, &settings)?;
        let mut path = Isotherm(domain.acquisition(&imu(0))?);
        let trips = common.of(5_000, 200_000);
        let mut times = Vec::with_capacity(trips);
        for turn in 0..trips + trips / 20 {
            let sent = Instant::now();
            black_box(path.round_trip(&sample())?);
            if turn >= trips / 20 {
                times.push(nanoseconds(sent.elapsed()));
            }
        }
        idle.insert(count.to_string(), figures(times).into());
    }

    let mut own = OwnWork::new();
    let together = COUNTS.iter().map(|count| Ok((count.to_string(), together(common, *count, &mut own)?)));
    let together = together.collect::<BenchResult<Map<_, _>>>()?;
    let p50 = |count: &str| idle[count]["p50_ns"].as_f64();
    let each = p50("32").zip(p50("1")).map(|(many, one)| (many - one) / 31.0);
    Ok(json!({"scale": {"idle": idle, "ns_per_idle_stream": each, "together": together, "rate_hz": RATE}}))
}

/// Measures `count` IMUs that send together.
fn together(common: Common, count: usize, own: &mut OwnWork) -> BenchResult<Value> {
    // Two workers and the acquisition spin, each on a core.
    let two_workers = count > 1 && cores().len() > 2;
    let [series] = alternate(
        common.rounds(1, ROUNDS),
        1,
        |pairs| {
            pairs.add_bare_together("iceoryx2", count)?;
            pairs.add_bare_together("iceoryx2_again", count)?;
            pairs.add_service_together("isotherm", count, 1, "spin")?;
            pairs.add_service_together("isotherm_anticipate", count, 1, "anticipate")?;
            if two_workers {
                pairs.add_service_together("isotherm_two_workers", count, 2, "spin")?;
            }
            Ok(())
        },
        |Pair { path, peer, .. }, _, times| {
            let pace = &mut Pace { period: Duration::from_secs(1) / RATE, count: common.block(PERIODS), own };
            path.paced(peer.as_ref(), pace, times)
        },
    )?;
    let mut figures = series_figures(&series, &RATIOS);
    if count > 1 && !two_workers {
        figures["two_workers"] = format!("not measured: {} cores", cores().len()).into();
    }
    Ok(figures)
}
