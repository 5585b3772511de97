//! How long a new table takes from `rename` to the first increment under it, while samples flow at 2 kHz.

use clap::Parser;
use isotherm_benches::{BenchDomain, BenchResult, Common, IMU, TABLE, TIMEOUT, nearest_rank, no_role, run};
use isotherm_client::{Acquisition, RawSample};
use isotherm_shared::table::CoefficientTable;
use serde_json::json;
use std::process::ExitCode;
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_micros(500);
/// Between two reloads.
const PAUSE: Duration = Duration::from_millis(130);

/// Measures how long a new table takes until it is in force
#[derive(Debug, Parser)]
struct ReloadArguments {
    #[command(flatten)]
    common: Common,
}

fn main() -> ExitCode {
    run(no_role, bench)
}

fn bench(ReloadArguments { common }: ReloadArguments) -> BenchResult<()> {
    let reloads = common.rounds(10, 300);
    let domain = BenchDomain::new()?;
    let _service = domain.serve(None, "")?;
    let mut acquisition = domain.acquisition(IMU)?;
    let texts = [1, 2].map(|number| TABLE.replace("9.8015", &format!("9.801{number}")));
    let ids = texts.each_ref().map(|text| CoefficientTable::from_toml(text, None).map(|table| table.id()));
    let (mut due, mut times) = (Instant::now(), Vec::with_capacity(reloads));
    for reload in 0..reloads {
        let id = ids[reload % 2].clone()?;
        // The service loads a file that changes at most ten times a second. A single table does not wait.
        for _ in 0..PAUSE.div_duration_f64(PERIOD) as u32 {
            round_trip(&mut acquisition, &mut due)?;
        }
        let renamed = domain.replace("table.toml", &texts[reload % 2])?;
        while round_trip(&mut acquisition, &mut due)? != id {
            if renamed.elapsed() > TIMEOUT {
                return Err("the new table is not taken".into());
            }
        }
        times.push(renamed.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_unstable_by(f64::total_cmp);
    let [p50, p90, p99, max] = [0.5, 0.9, 0.99, 1.0].map(|part| nearest_rank(&times, part));
    common.show(json!({"reloads": reloads, "p50_ms": p50, "p90_ms": p90, "p99_ms": p99, "max_ms": max}));
    Ok(())
}

/// Sends the next sample when it is due. Returns the id of the table that it was compensated with.
fn round_trip(acquisition: &mut Acquisition, due: &mut Instant) -> BenchResult<u64> {
    *due += PERIOD;
    std::thread::sleep(due.saturating_duration_since(Instant::now()));
    let mut loan = acquisition.loan()?;
    let (session, sequence) = (loan.session, loan.sequence);
    *loan = RawSample { session, sequence, interval_ns: 500_000, ..RawSample::default() };
    Ok(acquisition.compensate(loan, TIMEOUT)?.table)
}
