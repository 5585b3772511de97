//! The time from a campaign's file to its table, compared with the CSV parser alone on the same file, in one run.
//!
//! 15 set points, 12 positions, 300 s each at 100 Hz: 5.4 million rows, unless `--smoke`.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

use isotherm_benches::BenchResult;
use isotherm_calibration::{CalibrationOptions, calibrate_accelerometers};
use isotherm_campaign::{Campaign, read_dwells};
use isotherm_recording::{CampaignCsvReader, RawCsvWriter};
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::{CampaignSchedule, Truth, campaign, campaign_toml};
use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, BufWriter};
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

fn main() -> ExitCode {
    let smoke = std::env::args().nth(1).as_deref() == Some("--smoke");
    match bench(smoke) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("fit: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The truth of the simulated campaign.
const TABLE: &str = include_str!("../../../examples/tables/imu-paper.toml");

fn bench(smoke: bool) -> BenchResult<()> {
    let folder = tempfile::Builder::new().prefix("iso-").tempdir()?;
    let path = folder.path().join("samples.csv");
    let table = CoefficientTable::from_toml(TABLE, None)?;
    let truth = Truth::of(table);
    let plan =
        CampaignSchedule { interval_ns: if smoke { 1_000_000_000 } else { 10_000_000 }, ..CampaignSchedule::default() };
    let (stated, rows) = (write(&truth, &plan, &path)?, plan.rows());
    let rounds = if smoke { 2 } else { 7 };
    let mut times: [Vec<Duration>; 4] = Default::default();
    for _ in 0..rounds {
        // Alternating, so that other load of the machine affects all alike.
        times[0].push(timed(|| parse(&path))?.0);
        times[1].push(timed(|| samples(&path))?.0);
        let (elapsed, dwells) = timed(|| Ok(read_dwells(&stated, CampaignCsvReader::new(File::open(&path)?)?)?))?;
        times[2].push(elapsed);
        times[3].push(timed(|| Ok(calibrate_accelerometers(&stated, dwells, CalibrationOptions::default())?))?.0);
    }
    let size = fs::metadata(&path)?.len() as f64;
    println!("{rows} rows, {:.0} MB, {rounds} rounds; the fastest and the slowest of each", size / 1e6);
    let names = [
        "CSV parser alone (csv-core)",
        "and numbers from text",
        "and dwells, checked",
        "checks, orders and fit of the dwells",
    ];
    for (name, times) in names.iter().zip(&mut times) {
        times.sort_unstable();
        let [best, worst] = [times[0], times[times.len() - 1]].map(|time| time.as_secs_f64());
        println!(
            "{name:38} {best:7.3} to {worst:7.3} s, {:6.2} million rows/s, {:5.0} MB/s",
            rows as f64 / best / 1e6,
            size / best / 1e6
        );
    }
    let ratio = times[2][0].as_secs_f64() / times[0][0].as_secs_f64();
    println!("reading into dwells takes {ratio:.2} times as long as the parser alone");
    println!("peak memory {:.1} MB", peak()?);
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

fn timed<T>(work: impl FnOnce() -> BenchResult<T>) -> BenchResult<(Duration, T)> {
    let begin = Instant::now();
    let result = work()?;
    Ok((begin.elapsed(), result))
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

/// Peak resident memory of this process \[MB\].
fn peak() -> BenchResult<f64> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).ok_or("no VmHWM in /proc/self/status")?;
    let kilobytes: f64 = line.trim().trim_end_matches("kB").trim().parse()?;
    Ok(kilobytes / 1e3)
}
