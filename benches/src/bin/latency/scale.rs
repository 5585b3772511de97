//! Latency for different numbers of IMUs: with one that sends while the others are idle; and with all sending together,
//! beside as many bare pairs, until the last sample is answered.

use crate::Effort;
use crate::paced::{OwnWork, Pace, series_figures};
use crate::pairs::{Pair, alternate, couples};
use crate::paths::{Isotherm, Path as _};
use isotherm_benches::statistics::figures;
use isotherm_benches::{BenchDomain, BenchResult, cores, imu, pin, sample};
use isotherm_client::Acquisition;
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
const RATIOS: [(&str, &str); 4] = [
    ("isotherm", "iceoryx2"),
    ("isotherm_anticipate", "iceoryx2"),
    ("isotherm_two_workers", "iceoryx2"),
    ("iceoryx2_again", "iceoryx2"),
];

pub(crate) fn measure(effort: Effort) -> BenchResult<Value> {
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));
    let core = theirs.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();

    let mut idle = Map::new();
    for count in COUNTS {
        let domain = BenchDomain::new()?;
        let _service = domain.serve_many(count, 1, &format!("[wait]\nstrategy = \"spin\"\n{core}"))?;
        let mut path = Isotherm(Acquisition::connect(&imu(0).parse()?, &domain.options())?);
        let trips = effort.of(5_000, 200_000);
        let mut times = Vec::with_capacity(trips);
        for turn in 0..trips + trips / 20 {
            let sent = Instant::now();
            black_box(path.round_trip(&sample())?);
            if turn >= trips / 20 {
                times.push(u32::try_from(sent.elapsed().as_nanos()).unwrap_or(u32::MAX));
            }
        }
        idle.insert(count.to_string(), figures(times).into());
    }

    let mut own = OwnWork::new();
    let together = COUNTS.iter().map(|count| Ok((count.to_string(), together(effort, *count, &mut own)?)));
    let together = together.collect::<BenchResult<Map<_, _>>>()?;
    let p50 = |count: &str| idle[count]["p50_ns"].as_f64();
    let each = p50("32").zip(p50("1")).map(|(many, one)| (many - one) / 31.0);
    Ok(json!({"scale": {"idle": idle, "ns_per_idle_stream": each, "together": together, "rate_hz": RATE}}))
}

/// Measures `count` IMUs that send together.
fn together(effort: Effort, count: usize, own: &mut OwnWork) -> BenchResult<Value> {
    // Two workers and the acquisition spin, each on a core.
    let two_workers = count > 1 && cores().len() > 2;
    let [series] = alternate(
        effort.of(1, ROUNDS),
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
            let pace = &mut Pace { period: Duration::from_secs(1) / RATE, count: effort.of_block(PERIODS), own };
            path.paced(peer.as_ref(), pace, times)
        },
    )?;
    let mut figures = series_figures(&series, &couples(&RATIOS));
    if count > 1 && !two_workers {
        figures["two_workers"] = format!("not measured: {} cores", cores().len()).into();
    }
    Ok(figures)
}
