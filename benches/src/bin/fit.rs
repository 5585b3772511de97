//! The time from a campaign's file to its table, compared with only the CSV parser on the same file, in one run.
//!
//! 15 set points, 12 positions, 300 s each at 100 Hz: 5.4 million rows, unless `--smoke`.

use clap::Parser;
use isotherm_benches::{BenchDomain, BenchResult, Common, no_role, run, status_number};
use isotherm_campaign::{Campaign, read_dwells};
use isotherm_fit::{CalibrationOptions, calibrate_accelerometers};
use isotherm_recording::{CampaignCsvReader, RawCsvWriter};
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::{CampaignSchedule, Truth, campaign, campaign_toml};
use serde_json::json;
use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, BufWriter};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

/// The truth of the simulated campaign.
const TABLE: &str = include_str!("../../../examples/tables/imu-paper.toml");

/// What is timed.
const STEPS: [&str; 4] = [
    "only the CSV parser (csv-core)",
    "and numbers from text",
    "and dwells, checked",
    "checks, orders and fit of the dwells",
];

/// Measures the time from a campaign's file to its table
#[derive(Debug, Parser)]
struct FitArguments {
    #[command(flatten)]
    common: Common,
}

fn main() -> ExitCode {
    run(no_role, bench)
}

fn bench(FitArguments { common }: FitArguments) -> BenchResult<()> {
    let folder = BenchDomain::new()?;
    let path = folder.path("samples.csv");
    let table = CoefficientTable::from_toml(TABLE, None)?;
    let truth = Truth::of(table);
    let interval_ns = if common.smoke { 1_000_000_000 } else { 10_000_000 };
    let plan = CampaignSchedule { interval_ns, ..CampaignSchedule::default() };
    let stated = write(&truth, &plan, &path)?;
    let rounds = common.rounds(2, 7).max(1);
    let mut times: [Vec<f64>; STEPS.len()] = Default::default();
    for _ in 0..rounds {
        // Alternating, so that other load of the machine affects all alike.
        times[0].push(timed(|| parse(&path))?.0);
        times[1].push(timed(|| samples(&path))?.0);
        let (elapsed, dwells) = timed(|| Ok(read_dwells(&stated, CampaignCsvReader::new(File::open(&path)?)?)?))?;
        times[2].push(elapsed);
        times[3].push(timed(|| Ok(calibrate_accelerometers(&stated, dwells, CalibrationOptions::default())?))?.0);
    }
    times.iter_mut().for_each(|times| times.sort_unstable_by(f64::total_cmp));
    let (rows, bytes) = (plan.rows(), fs::metadata(&path)?.len());
    let steps = STEPS.iter().zip(&times).map(|(name, times)| {
        let best = times[0];
        json!({
            "step": name,
            "best_s": best,
            "worst_s": times.last(),
            "rows_per_s": (rows as f64 / best).round(),
            "mb_per_s": bytes as f64 / best / 1e6,
        })
    });
    let document = json!({
        "rows": rows,
        "bytes": bytes,
        "rounds": rounds,
        "steps": steps.collect::<Vec<_>>(),
        "dwells/parser": times[2][0] / times[0][0],
        "peak_memory_kb": status_number(Path::new("/proc/self"), "VmHWM"),
    });
    common.show(document);
    Ok(())
}

fn write(truth: &Truth, plan: &CampaignSchedule, path: &Path) -> BenchResult<Campaign> {
    let content = truth.table.content();
    let mut writer = RawCsvWriter::new(BufWriter::new(File::create(path)?), "set_point_c,position,", false)?;
    for row in campaign(truth, plan, 1) {
        writer.write(format_args!("{},{},", row.set_point_c, row.position), &row.raw)?;
    }
    writer.finish()?;
    let (imu, unit) = (content.imu.as_str(), &content.temperature_unit);
    let text = campaign_toml(imu, "samples.csv", content.gravity, truth.gravity_local, unit, &plan.positions);
    Ok(Campaign::from_toml(&text)?)
}

fn timed<T>(work: impl FnOnce() -> BenchResult<T>) -> BenchResult<(f64, T)> {
    let begin = Instant::now();
    let result = work()?;
    Ok((begin.elapsed().as_secs_f64(), result))
}

/// Splits the file into rows and fields and does nothing with them.
fn parse(path: &Path) -> BenchResult<usize> {
    let mut source = BufReader::with_capacity(1 << 16, File::open(path)?);
    let mut parser = csv_core::Reader::new();
    let (mut fields, mut ends, mut count) = (vec![0; 4096], vec![0; 64], 0);
    let (mut written, mut ended) = (0, 0);
    loop {
        let buffer = source.fill_buf()?;
        let (result, read, output, end) = parser.read_record(buffer, &mut fields[written..], &mut ends[ended..]);
        source.consume(read);
        (written, ended) = (written + output, ended + end);
        match result {
            csv_core::ReadRecordResult::Record => (count, written, ended) = (count + 1, 0, 0),
            csv_core::ReadRecordResult::InputEmpty => {}
            csv_core::ReadRecordResult::End => return Ok(count),
            _ => return Err("a row is too long".into()),
        }
    }
}

/// Reads every number and does nothing with it.
fn samples(path: &Path) -> BenchResult<usize> {
    let mut count = 0;
    for row in CampaignCsvReader::new(File::open(path)?)? {
        count += usize::from(core::hint::black_box(row?).position.is_some());
    }
    Ok(count)
}
