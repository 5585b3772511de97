//! The paper's campaign, from the plan to the coefficient table in force, compared with `simulate campaign` and
//! `calibrate` of the same IMU.

use crate::laboratory::{BenchLaboratory, TIMEOUT};
use isotherm_benches::BenchResult;
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::{worst_errors, worst_gyroscope_errors};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// Laboratory time divided by real time.
const SPEED: u32 = 1000;

/// Runs the campaign with an exact turntable and with one that is off by 1 arcsec, and prints the figures.
pub(crate) fn bench() -> BenchResult<()> {
    ["0", "1"].into_iter().try_for_each(campaign)
}

fn campaign(positioning: &str) -> BenchResult<()> {
    let laboratory = BenchLaboratory::new(SPEED, positioning, &[], true)?;
    let begun = Instant::now();
    let mut runner = laboratory.run(&["--calibrate", "--alignment", "--require", "10"])?;
    if !runner.succeeds_within(TIMEOUT)? {
        return Err(laboratory.domain.failure("the campaign has failed"));
    }
    let took = begun.elapsed().as_secs_f64();
    let kept = laboratory.events("kept")?;
    let turns = kept.iter().filter(|unit| !unit["turn"].is_null()).count();
    let dwells = kept.iter().filter(|unit| unit["file"] == "campaign.csv").count() - turns;
    if let Some(wrong) = laboratory.wrong(kept.len(), 30)? {
        return Err(wrong.into());
    }
    let load = |path: &Path| -> BenchResult<CoefficientTable> {
        Ok(CoefficientTable::from_toml(&fs::read_to_string(path)?, None)?)
    };
    let truth = load(&laboratory.path("truth.toml"))?;
    let installed = load(&laboratory.domain.path("imu-a.toml"))?;
    println!(
        "automatic campaign at {SPEED} times, the table exact to {positioning} arcsec: {dwells} dwells, {turns} turns, {} runs, {took:.0} s of real time",
        kept.len() - dwells - turns
    );
    println!("installed and in force: {}", installed.digest());
    println!("worst error over the range against the truth: {}", errors(&installed, &truth)?);
    println!(
        "the same by simulate campaign and calibrate:  {}",
        errors(&load(&simulated(&laboratory, positioning)?)?, &truth)?
    );
    for (number, run) in kept.iter().filter(|unit| unit["file"] != "campaign.csv").enumerate() {
        println!("verification run {}: {} rows, {} s", number + 1, run["rows"], run["seconds"]);
    }
    let pauses: Vec<Value> = laboratory.events("paused")?;
    println!("pauses {}, units begun again {}", pauses.len(), laboratory.events("discarded")?.len());
    for line in laboratory.domain.output().lines().filter(|line| line.trim_start().starts_with('A')) {
        println!("{line}");
    }
    Ok(())
}

/// The largest errors of both triads.
fn errors(table: &CoefficientTable, truth: &CoefficientTable) -> BenchResult<String> {
    let [bias, scale_factor] = worst_errors(table, truth);
    let [drift, angle, g_sensitivity, misalignment] =
        worst_gyroscope_errors(table, truth).ok_or("the table has no gyroscopes")?;
    Ok(format!(
        "bias {bias:.3}e-6 g0, scale factors {scale_factor:.3} ppm; gyroscopes: bias {drift:.4} deg/h, scale factors {angle:.2} ppm, \
         g-sensitivity {g_sensitivity:.4} deg/h/g0, misalignment {misalignment:.1e} rad"
    ))
}

/// The coefficient table from `simulate campaign`, which uses no instruments.
fn simulated(laboratory: &BenchLaboratory, positioning: &str) -> BenchResult<std::path::PathBuf> {
    let run = |words: &[&str]| -> BenchResult<()> {
        let output = laboratory.domain.command(&std::env::current_exe()?).args(words).output()?;
        if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into()) }
    };
    run(&["simulate", "campaign", "-o", "simulated", "--imu", "imu-a", "--gyroscopes", "--positioning", positioning])?;
    run(&["calibrate", "turntable", "simulated/campaign.toml", "-o", "simulated.toml", "--alignment"])?;
    Ok(laboratory.domain.path("simulated.toml"))
}
