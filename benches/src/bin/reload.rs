//! How long a new table takes from `rename` to the first increment under it, while samples flow at 2 kHz.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

use isotherm_benches::{BenchDomain, BenchResult, IMU, TABLE, TIMEOUT};
use isotherm_client::{Acquisition, RawSample};
use isotherm_shared::table::CoefficientTable;
use std::fs;
use std::process::ExitCode;
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_micros(500);

fn main() -> ExitCode {
    let mut words = std::env::args().skip(1);
    let reloads = match words.next().as_deref() {
        Some("serve") => return isotherm_service::main(env!("CARGO_PKG_VERSION")),
        Some("--smoke") => 10,
        _ => 300,
    };
    match bench(reloads) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("reload: {error}");
            ExitCode::FAILURE
        }
    }
}

fn bench(reloads: usize) -> BenchResult<()> {
    let domain = BenchDomain::new()?;
    let _service = domain.serve("")?;
    let mut acquisition = Acquisition::connect(&IMU.parse()?, &domain.options())?;
    let texts = [1, 2].map(|number| TABLE.replace("9.8015", &format!("9.801{number}")));
    let ids = texts.each_ref().map(|text| CoefficientTable::from_toml(text, None).map(|table| table.id()));
    let (mut due, mut times) = (Instant::now(), Vec::with_capacity(reloads));
    for reload in 0..reloads {
        let id = ids[reload % 2].clone()?;
        // Some samples between two reloads, so that each reload is complete before the next one.
        for _ in 0..20 {
            round_trip(&mut acquisition, &mut due)?;
        }
        fs::write(domain.path("next.toml"), &texts[reload % 2])?;
        let renamed = Instant::now();
        fs::rename(domain.path("next.toml"), domain.path("table.toml"))?;
        while round_trip(&mut acquisition, &mut due)? != id {
            if renamed.elapsed() > TIMEOUT {
                return Err("the new table is not taken".into());
            }
        }
        times.push(renamed.elapsed());
    }
    times.sort_unstable();
    let at =
        |part: f64| times[((times.len() as f64 * part).ceil() as usize).clamp(1, times.len()) - 1].as_secs_f64() * 1e3;
    println!("from rename to the first increment under the new table, {reloads} reloads at 2 kHz [ms]:");
    println!("p50 {:.2}, p90 {:.2}, p99 {:.2}, max {:.2}", at(0.5), at(0.9), at(0.99), at(1.0));
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
