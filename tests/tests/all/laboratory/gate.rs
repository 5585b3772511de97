//! What the verification runs of a campaign judge, and what the gate does with what they do not judge. The data are
//! simulated and complete: no instrument is needed, and the command only fits, verifies and installs.

use isotherm_automation::journal::{Entry, Journal, KeptStep};
use isotherm_automation::plan::Plan;
use isotherm_automation::timeline::units;
use isotherm_fit::sha256;
use isotherm_tests::{Process, TestDomain, table, text, wait_until};
use serde_json::Value;
use std::fs;
use std::path::Path;

const PLAN: &str = include_str!("../../../../examples/plan.toml");
const EXAMPLE_ATTITUDES: &str = "runs = 2\nattitudes_deg = [[50, 130], [230, 130]]";
const ONE: &str = "runs = 1";
const OPPOSITE: &str = "runs = 2\nattitudes_deg = [[50, 130], [230, 130]]";

/// A complete campaign of `imu-a` in `campaign`, with its plan, the file `imu-a.toml` to install and a service that
/// watches it.
struct Complete {
    domain: TestDomain,
    _service: Process,
}

impl Complete {
    /// The samples of a simulated campaign from -20 to 40 degC, changed by `change`. Its first runs are those of
    /// `verify`, the lines of `[verify]` with the number of runs, from `from_c` to `to_c`.
    fn new(change: impl Fn(&str) -> String, verify: &str, [from_c, to_c]: [f64; 2]) -> Self {
        let domain = TestDomain::new();
        let service = domain.serve(&["--allow-uncalibrated", "--imu", "imu-a=imu-a.toml"]);
        let simulated = ["--imu", "imu-a", "--tilt", "0,0", "--positioning", "0", "--set-points", "-20:40:10"];
        domain.run_ok(&[&["simulate", "campaign", "-o", "simulated"], &simulated[..]].concat());
        let complete = Self { domain, _service: service };
        complete.plan(verify, [from_c, to_c]);
        let plan = complete.read_plan();
        fs::create_dir(&plan.output).unwrap();
        let (mut journal, _) = Journal::open(&plan).unwrap();
        let samples = change(&complete.read("simulated/samples.csv"));
        fs::write(plan.output.join("campaign.csv"), &samples).unwrap();
        fs::write(plan.output.join("campaign.toml"), &plan.campaign_toml).unwrap();
        let runs = plan.verify.as_ref().unwrap().runs as usize;
        for unit in 0..units(&plan) - runs {
            // All bytes are those of the first dwell.
            let bytes = if unit == 0 { samples.as_bytes() } else { &[] };
            let from = if unit == 0 { 0 } else { samples.len() as u64 };
            keep(&mut journal, KeptStep { from, ..kept(unit, "campaign.csv", bytes) });
        }
        drop(journal);
        complete.take_runs(0);
        complete
    }

    /// Writes the plan with these runs.
    fn plan(&self, verify: &str, [from_c, to_c]: [f64; 2]) {
        let plan = PLAN
            .replace("output = \"imu-a-campaign\"", "output = \"campaign\"")
            .replace("start_c = -25\nstop_c = 45\nstep_c = 5", "start_c = -20\nstop_c = 40\nstep_c = 10")
            .replace(EXAMPLE_ATTITUDES, verify)
            .replace("from_c = -25", &format!("from_c = {from_c}"))
            .replace("to_c = 45", &format!("to_c = {to_c}"));
        let plan: String =
            plan.lines().map(|line| line.split("  #").next().unwrap().trim_end().to_owned() + "\n").collect();
        self.domain.replace("plan.toml", &plan);
    }

    fn read_plan(&self) -> Plan {
        Plan::load(&self.domain.path("plan.toml")).unwrap()
    }

    /// Simulates the runs of the plan from this number on, and journals them.
    fn take_runs(&self, first: u32) {
        let plan = self.read_plan();
        let (mut journal, history) = Journal::open(&plan).unwrap();
        let verify = plan.verify.as_ref().unwrap();
        for (count, run) in (first..verify.runs).enumerate() {
            let file = format!("verify-{}.csv", run + 1);
            let join = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            let attitude = format!("--attitude={}", join(&verify.attitude(run as usize).specific_force));
            let temperatures = format!("--temperatures={},{}", verify.way.from_c, verify.way.to_c);
            let seed = (run + 2).to_string();
            let simulate = ["simulate", "run", "-o", "run", "--imu", "imu-a", "--interval", "10", "--hold", "600"];
            self.domain.run_ok(&[&simulate[..], &["--seed", &seed, &attitude, &temperatures]].concat());
            fs::rename(self.domain.path("run/run.csv"), plan.output.join(&file)).unwrap();
            let bytes = fs::read(plan.output.join(&file)).unwrap();
            keep(&mut journal, kept(history.kept.len() + count, &file, &bytes));
        }
        let [turntable, chamber] = ["turntable stopped", "chamber in standby"].map(String::from);
        let reason = "all data are taken".to_owned();
        journal.write(Entry::Safe { reason, stopped: false, turntable, chamber, certain: true }).unwrap();
    }

    /// Puts the table of the unchanged samples in force.
    fn put_good_in_force(&self) {
        self.domain.run_ok(&["calibrate", "turntable", "simulated/campaign.toml", "-o", "good.toml"]);
        let good = self.read("good.toml");
        self.domain.replace("imu-a.toml", &good);
        wait_until("the table in force", || self.domain.imu_status()["table"] == table(&good).digest().to_string());
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.domain.path(name)).unwrap()
    }

    /// Fits, verifies and installs; the command must end with this exit code. Returns stderr.
    fn calibrate(&self, code: i32) -> String {
        self.calibrate_with(&[], code)
    }

    fn calibrate_with(&self, options: &[&str], code: i32) -> String {
        let before = fs::read(self.domain.path("imu-a.toml")).ok();
        let run = ["campaign", "run", "plan.toml", "--calibrate", "--require", "10"];
        let output = self.domain.run(&[&run[..], options].concat());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{}\n{said}", text(&output.stdout));
        let installed = fs::read(self.domain.path("imu-a.toml")).ok() != before;
        assert_eq!(installed, code == 0, "{said}");
        said
    }

    fn status(&self) -> String {
        self.domain.run_ok(&["campaign", "status", "plan.toml"])
    }

    /// The warnings of `campaign check`.
    fn warnings(&self) -> String {
        let output = self.domain.run(&["campaign", "check", "plan.toml"]);
        assert!(output.status.success());
        text(&output.stderr)
    }
}

fn kept(unit: usize, file: &str, bytes: &[u8]) -> KeptStep {
    KeptStep { unit, file: file.to_owned(), to: bytes.len() as u64, sha256: sha256(bytes), ..KeptStep::default() }
}

fn keep(journal: &mut Journal, kept: KeptStep) {
    journal.write(Entry::Kept(kept)).unwrap();
}

/// The samples with the "-" channel of A1 too large by 1 + `error` where it measures gravity.
fn wrong_channel(samples: &str, error: f64) -> String {
    const A1_NEGATIVE: usize = 6;
    let header = samples.lines().next().unwrap();
    assert_eq!(header.split(',').nth(A1_NEGATIVE), Some("a1_negative"));
    let rows = samples.lines().skip(1).map(|row| {
        let mut columns: Vec<_> = row.split(',').map(ToOwned::to_owned).collect();
        let pulses: f64 = columns[A1_NEGATIVE].parse().unwrap();
        if pulses > 5e5 {
            columns[A1_NEGATIVE] = (pulses * (1.0 + error)).round().to_string();
        }
        columns.join(",")
    });
    [header.to_owned()].into_iter().chain(rows).map(|row| row + "\n").collect()
}

const WHOLE: [f64; 2] = [-20.0, 40.0];

/// A mistake in the two positions that drive one channel is in the table, and a run at one attitude shows nothing of
/// it.
#[test]
fn a_mistake_in_a_channel_is_not_installed_over_a_good_table() {
    let complete = Complete::new(|samples| wrong_channel(samples, 0.002), ONE, WHOLE);
    complete.put_good_in_force();
    let warnings = complete.warnings();
    let opposite = "attitudes_deg = [[50, 130], [230, 130]] drives all six\n";
    assert!(
        warnings.contains("no run drives K- of A1, K+ of A2, K- of A3: ") && warnings.ends_with(opposite),
        "{warnings}"
    );
    let checked = complete.domain.run(&["check", "plan.toml"]);
    assert!(checked.status.success() && text(&checked.stderr).ends_with(opposite), "{}", text(&checked.stderr));

    let said = complete.calibrate(1);
    let refused = "K- of A1, which no run drives, is 2";
    let remedy = "verify at an attitude that drives it: runs = 2 and attitudes_deg = [[50, 130], [230, 130]]";
    let reason = said.lines().find(|line| line.contains(refused)).unwrap_or_else(|| panic!("{said}"));
    assert!(reason.contains(" ppm off the table in force, at most ") && reason.ends_with(remedy), "{said}");
    assert!(said.contains("not judged: K- of A1 was not driven by any run\n"), "{said}");
    let status = complete.status();
    for once in ["\nnot judged: K- of A1 was not driven by any run\n", "\nnot judged: K+ of A2 was", refused] {
        assert_eq!(status.matches(once).count(), 1, "{once}\n{status}");
    }
    assert!(status.contains("\nverify-1.csv, at 50/130 deg: largest error "), "{status}");

    // The remedy: one more run, at the opposite attitude. It shows the mistake.
    complete.plan(OPPOSITE, WHOLE);
    complete.take_runs(1);
    assert_eq!(complete.warnings(), "");
    let said = complete.calibrate(1);
    assert!(!said.contains("not judged: ") && !said.contains("which no run drives"), "{said}");
    assert!(said.contains("verify-2.csv: bias: A1 1") && !said.contains("verify-1.csv: bias"), "{said}");
    assert!(said.trim_end().ends_with("campaign/table.toml; look at verify-2.html"), "{said}");
    let status = complete.status();
    for reason in said.lines().filter_map(|line| line.split_once("verify-2.csv: ").map(|(_, reason)| reason)) {
        assert_eq!(status.matches(&format!("\n  {reason}\n")).count(), 1, "{reason}\n{status}");
    }
    assert!(
        status.contains("\nverify-2.csv, at 230/130 deg: largest error ") && status.contains("; refused:\n"),
        "{status}"
    );
    assert!(status.trim_end().ends_with(": not shown by verify-2.csv"), "{status}");
}

/// Opposite attitudes judge a good table, each run by its own specific force.
#[test]
fn runs_at_opposite_attitudes_judge_every_channel_of_a_good_table() {
    let complete = Complete::new(ToOwned::to_owned, OPPOSITE, WHOLE);
    assert_eq!(complete.warnings(), "");
    let said = complete.calibrate(0);
    assert!(!said.contains("not judged") && said.contains(" is served, as imu-a.toml"), "{said}");
    let status: Value =
        serde_json::from_str(&complete.domain.run_ok(&["campaign", "status", "plan.toml", "--json"])).unwrap();
    let outcome = &status["outcome"];
    assert_eq!(outcome["not_judged"], serde_json::json!([]));
    assert_eq!(outcome["verification"][1]["angles_deg"], serde_json::json!([230.0, 130.0]));
    assert!(outcome["verification"].as_array().unwrap().iter().all(|run| run["refused"].is_null()), "{outcome}");
    // A run that is taken stays in the plan.
    complete.plan(ONE, WHOLE);
    let refused = complete.domain.run(&["campaign", "run", "plan.toml"]);
    assert_eq!(refused.status.code(), Some(78));
    assert!(text(&refused.stderr).contains("verify.2: was "), "{}", text(&refused.stderr));
}

/// Without a table in force there is nothing to compare with: what is not judged is reported.
#[test]
fn what_no_run_judges_is_told() {
    let complete = Complete::new(ToOwned::to_owned, ONE, WHOLE);
    let said = complete.calibrate(0);
    assert!(said.contains("not judged: K- of A3 was not driven by any run\n"), "{said}");
    assert!(complete.status().contains("\nnot judged: K- of A3 was not driven by any run\ninstalled, "));
    // And again, over that table.
    let output = complete.domain.run(&["campaign", "run", "plan.toml", "--calibrate", "--require", "10"]);
    assert!(output.status.success() && text(&output.stderr).contains(" already"), "{}", text(&output.stderr));
}

#[test]
fn runs_over_a_part_of_the_range_install_nothing_unless_that_is_accepted() {
    let wide = Complete::new(ToOwned::to_owned, OPPOSITE, [-20.0, 25.0]);
    let warnings = wide.warnings();
    assert!(warnings.contains(" -20 to 25 degC covers 75 % of"), "{warnings}");
    let said = wide.calibrate(1);
    let reason = said.lines().find(|line| line.contains("; verify over the whole range")).unwrap();
    assert!(reason.contains("no run is in 3.") && reason.contains(" V of "), "{reason}");
    assert!(reason.ends_with("--accept not-covered: from_c = -20 and to_c = 40 covers it"), "{reason}");
    let said = wide.calibrate_with(&["--accept", "not-covered"], 0);
    let told = said.lines().find(|line| line.contains("not judged: no run is in 3."));
    assert!(told.is_some_and(|line| line.ends_with(" % of its range")), "{said}");
    assert!(wide.status().contains("\nnot judged: no run is in 3."));
}

/// A user who has edited the campaign file learns that the plan's counts.
#[test]
fn an_edited_campaign_file_is_not_rewritten_in_silence() {
    let complete = Complete::new(ToOwned::to_owned, OPPOSITE, WHOLE);
    let run = || text(&complete.domain.run(&["campaign", "run", "plan.toml"]).stderr);
    assert!(!run().contains("campaign.toml"));
    let file = complete.domain.path("campaign/campaign.toml");
    let planned = fs::read_to_string(&file).unwrap();
    assert!(planned.contains("gravity_local = 9.8015 "));
    fs::write(&file, planned.replace("gravity_local = 9.8015 ", "gravity_local = 9.79 ")).unwrap();
    let said = run();
    assert!(said.contains("campaign.toml was not what the plan gives; it is written again from the plan"), "{said}");
    assert!(said.contains("was `gravity_local = 9.79 ") && said.contains("is `gravity_local = 9.8015 "), "{said}");
    assert_eq!(fs::read_to_string(&file).unwrap(), planned);
    fs::write(&file, "").unwrap();
    assert!(run().contains("line 1 was ``, is `"));
}

#[test]
fn a_target_whose_folder_is_missing_is_found_at_the_beginning() {
    let complete = Complete::new(ToOwned::to_owned, OPPOSITE, WHOLE);
    let domain = &complete.domain;
    std::os::unix::fs::symlink(Path::new("gone/imu-a.toml"), domain.path("imu-a.toml")).unwrap();
    for command in [&["campaign", "check", "plan.toml"][..], &["campaign", "run", "plan.toml", "--calibrate"]] {
        let refused = domain.run(command);
        assert_eq!(refused.status.code(), Some(78), "{command:?}");
        let said = text(&refused.stderr);
        assert!(said.contains("install: there is no folder gone; make it"), "{said}");
    }
}

/// A service refuses a table that changes too much; the runner reports that, and accepts nothing in the operator's
/// place.
#[test]
fn an_installation_that_the_service_refuses_is_reported() {
    let complete = Complete::new(str::to_owned, OPPOSITE, WHOLE);
    complete.domain.run_ok(&["calibrate", "turntable", "simulated/campaign.toml", "-o", "good.toml"]);
    // A bias of some 100 ug0 that is taken for as many mg0: every run shows that the fitted table is the better one.
    complete.domain.write("off.toml", &complete.read("good.toml").replacen("ug0", "mg0", 1));
    complete.domain.run_ok(&["check", "--seal", "off.toml"]);
    let off = complete.read("off.toml");
    complete.domain.replace("imu-a.toml", &off);
    let in_force = || complete.domain.imu_status()["table"] == table(&off).digest().to_string();
    wait_until("the table in force", in_force);
    let output = complete.domain.run(&["campaign", "run", "plan.toml", "--calibrate", "--require", "10"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(78), "{said}");
    let fitted = table(&complete.read("campaign/table.toml")).digest().to_string();
    for part in [
        &format!("the service refuses {fitted}: A1 bias changes by "),
        // Both in one unit: a thousandth of it is a bias of this IMU.
        " ug0 at ",
        &format!("install --accept {fitted} campaign/table.toml imu-a.toml"),
        "the table before is back",
    ] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    assert!(in_force());
    assert_eq!((complete.read("imu-a.toml"), complete.domain.path("imu-a.toml.previous").exists()), (off, false));
}
