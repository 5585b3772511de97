//! The paper's campaign, from the plan to the table in force, beside `simulate campaign` and `calibrate` of the same IMU.

use crate::laboratory::{Laboratory, PATIENCE};
use isotherm_benches::Outcome;
use isotherm_calibration::simulate::worst_errors;
use isotherm_shared::table::CoefficientTable;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Laboratory time over real time.
const SPEED: u32 = 1000;

/// Runs it with a table that is exact and with one that is off by 1 arcsec, and prints the figures.
pub fn bench() -> Outcome<()> {
    ["0", "1"].into_iter().try_for_each(campaign)
}

fn campaign(positioning: &str) -> Outcome<()> {
    let laboratory = Laboratory::new(SPEED, positioning, &[], true)?;
    let begun = Instant::now();
    let mut runner = laboratory.run(&["--calibrate", "--alignment", "--require", "10"])?;
    if !runner.ends_well(PATIENCE)? {
        return Err(format!("the campaign has failed:\n{}", laboratory.world.log()).into());
    }
    let took = begun.elapsed().as_secs_f64();
    let kept = laboratory.events("kept")?;
    let dwells = kept.iter().filter(|unit| unit["file"] == "campaign.csv").count();
    if let Some(wrong) = laboratory.wrong(kept.len(), 30)? {
        return Err(wrong.into());
    }
    let load = |path: &Path| -> Outcome<CoefficientTable> {
        Ok(CoefficientTable::from_toml(&fs::read_to_string(path)?, None)?)
    };
    let truth = load(&laboratory.path("truth.toml"))?;
    let installed = load(&laboratory.world.path("imu-a.toml"))?;
    println!(
        "automatic campaign at {SPEED} times, the table exact to {positioning} arcsec: {dwells} dwells, {} runs, {took:.0} s of real time",
        kept.len() - dwells
    );
    println!("installed and in force: {}", installed.digest());
    let [bias, scale_factor] = worst_errors(&installed, &truth);
    println!("worst error over the range against the truth: bias {bias:.3}e-6 g0, scale factors {scale_factor:.3} ppm");
    let [bias, scale_factor] = worst_errors(&load(&simulated(&laboratory, positioning)?)?, &truth);
    println!("the same by simulate campaign and calibrate:  bias {bias:.3}e-6 g0, scale factors {scale_factor:.3} ppm");
    for (number, run) in kept.iter().filter(|unit| unit["file"] != "campaign.csv").enumerate() {
        println!("verification run {}: {} rows, {} s", number + 1, run["rows"], run["seconds"]);
    }
    let told: Vec<Value> = laboratory.events("paused")?;
    println!("pauses {}, dwells begun again {}", told.len(), laboratory.events("discarded")?.len());
    for line in laboratory.world.output().lines().filter(|line| line.trim_start().starts_with('A')) {
        println!("{line}");
    }
    Ok(())
}

/// The table that a campaign without any instruments gives.
fn simulated(laboratory: &Laboratory, positioning: &str) -> Outcome<std::path::PathBuf> {
    let run = |words: &[&str]| -> Outcome<()> {
        let status =
            Command::new(std::env::current_exe()?).args(words).current_dir(laboratory.world.path("")).output()?;
        if status.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&status.stderr).into()) }
    };
    run(&["simulate", "campaign", "-o", "simulated", "--imu", "imu-a", "--positioning", positioning])?;
    run(&["calibrate", "simulated/campaign.toml", "-o", "simulated.toml", "--alignment"])?;
    Ok(laboratory.world.path("simulated.toml"))
}
