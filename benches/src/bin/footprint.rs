//! What a small computer must have for `isothermd`: resident and shared memory for 1, 8 and 32 IMUs, and how long it
//! takes from the start of the process to the first increment.

use clap::Parser;
use isotherm_benches::{
    BenchDomain, BenchResult, Common, TIMEOUT, imu, nearest_rank, no_role, own_folder, run, sample, shared_memory,
    status_number,
};
use isotherm_client::{Acquisition, RawSample};
use serde_json::{Map, Value, json};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf, absolute};
use std::process::ExitCode;
use std::time::Instant;

/// Numbers of IMUs.
const COUNTS: [usize; 3] = [1, 8, 32];

/// Measures the memory of the daemon, and its start
#[derive(Debug, Parser)]
struct FootprintArguments {
    /// The daemon; isothermd beside this program if it is not given
    #[arg(long, value_name = "ISOTHERMD")]
    daemon: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

fn main() -> ExitCode {
    run(no_role, bench)
}

fn bench(FootprintArguments { daemon, common }: FootprintArguments) -> BenchResult<()> {
    let daemon = match daemon {
        Some(daemon) => absolute(daemon)?,
        None => own_folder()?.join("isothermd"),
    };
    let counts = COUNTS.iter().map(|count| Ok((count.to_string(), measure(common, &daemon, *count)?)));
    let imus = counts.collect::<BenchResult<Map<_, _>>>()?;
    common.show(json!({"imus": imus}));
    Ok(())
}

fn measure(common: Common, daemon: &Path, count: usize) -> BenchResult<Value> {
    let (rounds, samples) = (common.rounds(2, 20), common.of(10, 1000));
    let (mut starts, mut memory) = (Vec::new(), Value::Null);
    for _ in 0..rounds {
        let domain = BenchDomain::new()?;
        domain.configure_many(count, 1, "")?;
        let begun = Instant::now();
        let mut process = domain.spawn_program(daemon, &["serve", "--config", "service.toml"])?;
        // The acquisition waits for the service.
        let mut acquisition = domain.acquisition(&imu(0))?;
        round_trip(&mut acquisition)?;
        starts.push(begun.elapsed().as_secs_f64() * 1e3);
        let mut all = vec![acquisition];
        for index in 1..count {
            all.push(domain.acquisition(&imu(index))?);
        }
        for _ in 0..samples {
            all.iter_mut().try_for_each(round_trip)?;
        }
        let folder = PathBuf::from(format!("/proc/{}", process.pid()));
        let kb = |name| status_number(&folder, name);
        let prefix = domain.as_domain().prefix();
        let objects = shared_memory(&prefix).filter_map(|entry| entry.metadata().ok());
        let shared: u64 = objects.map(|object| object.blocks() * 512).sum();
        memory = json!({
            "rss_kb": kb("VmRSS"), "private_kb": kb("RssAnon"), "code_kb": kb("RssFile"), "highest_kb": kb("VmHWM"),
            "shared_memory_kb": shared / 1024, "threads": kb("Threads"),
        });
        drop(all);
        process.terminate();
        if !process.succeeds_within(TIMEOUT)? {
            return Err(domain.failure("the daemon failed"));
        }
    }
    starts.sort_unstable_by(f64::total_cmp);
    let [p50, max] = [0.5, 1.0].map(|part| nearest_rank(&starts, part));
    memory["starts"] = rounds.into();
    memory["first_increment_p50_ms"] = p50.into();
    memory["first_increment_max_ms"] = max.into();
    Ok(memory)
}

fn round_trip(acquisition: &mut Acquisition) -> BenchResult<()> {
    let mut loan = acquisition.loan()?;
    let (session, sequence) = (loan.session, loan.sequence);
    *loan = RawSample { session, sequence, ..sample() };
    acquisition.compensate(loan, TIMEOUT)?;
    Ok(())
}
