//! Campaigns of several IMUs on one turntable: one that fails is dropped, and the others have what each would have by
//! itself.

use isotherm_automation::journal::{Entry, Journal, KeptStep};
use isotherm_automation::plan::Plan;
use isotherm_automation::timeline::units;
use isotherm_fit::sha256;
use isotherm_simulation::worst_errors;
use isotherm_tests::laboratory::{TestLaboratory, stdout_of_success};
use isotherm_tests::{TestDomain, table, text};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Dwells of the campaign.
const DWELLS: usize = 4 * 12;

/// Asserts that `table-{imu}.toml` of the campaign's folder is, to the byte, what `calibrate` makes of the same samples
/// and a campaign file of only this IMU. The time and the digest of the campaign file are left out: it is another file
/// at another time.
fn assert_as_alone(domain: &TestDomain, folder: &str, imu: &str) {
    let campaign = fs::read_to_string(domain.path(folder).join("campaign.toml")).unwrap();
    let others = |line: &str| line.starts_with("    { id = ") && !line.contains(&format!("\"{imu}\""));
    let alone: String = campaign.lines().filter(|line| !others(line)).map(|line| format!("{line}\n")).collect();
    assert!(alone.matches("{ id = ").count() == 1 && campaign.matches("{ id = ").count() > 1, "{campaign}");
    let at = format!("alone-{imu}");
    fs::create_dir(domain.path(&at)).unwrap();
    domain.write(&format!("{at}/campaign.toml"), &alone);
    fs::copy(domain.path(folder).join(format!("{imu}.csv")), domain.path(&at).join(format!("{imu}.csv"))).unwrap();
    let output =
        domain.run(&["calibrate", "turntable", &format!("{at}/campaign.toml"), "-o", &format!("{at}/table.toml")]);
    stdout_of_success(&output);
    let written = |path: &Path| {
        let text = fs::read_to_string(path).unwrap();
        let own = |line: &&str| !line.starts_with("time = ") && !line.starts_with("campaign_sha256 = ");
        text.lines().filter(own).map(|line| format!("{line}\n")).collect::<String>()
    };
    let alone = written(&domain.path(&at).join("table.toml"));
    assert_eq!(written(&domain.path(folder).join(format!("table-{imu}.toml"))), alone);
    assert!(alone.contains(&format!("imu = \"{imu}\"")) || alone.contains(&format!("id = \"{imu}\"")), "{alone}");
}

/// The bytes of an IMU's recording that the journal lists.
fn journalled(laboratory: &TestLaboratory, file: &str) -> usize {
    let units = laboratory.events("kept").into_iter().flat_map(|unit| {
        let others = unit["others"].as_array().cloned().unwrap_or_default();
        [vec![unit], others].concat()
    });
    units.filter(|unit| unit["file"] == file).map(|unit| unit["to"].as_u64().unwrap() as usize).max().unwrap()
}

#[test]
fn one_of_three_stops_sending_and_the_others_have_their_tables() {
    // 30 s of real time. With three set points F has one degree of freedom, and may find a slope not significant.
    let patience = ("stream_s = 30000", "stream_s = 14000");
    let changes = [("list_c = [20, 23]", "list_c = [14, 18, 22, 26]"), patience];
    let laboratory = TestLaboratory::with_imus(&["imu-a", "imu-b", "imu-c"], "", &[], &changes);
    let domain = &laboratory.domain;
    let checked = domain.run_ok(&["campaign", "check", "station/plan.toml"]);
    assert!(checked.contains("campaign of imu-a, imu-b, imu-c, 4 set points x 12 positions; about "), "{checked}");
    assert!(
        checked.contains("  imu-b, mounting [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], samples imu-b.csv, to install as "),
        "{checked}"
    );
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 4);
    laboratory.faults("silent:imu-b");
    laboratory.wait_for("dropped", 1);
    // The others may have the next one already.
    let units = laboratory.events_before("kept", "dropped");
    laboratory.wait_for("kept", units + 2);
    // Another runner knows who is dropped, also when the IMU sends again.
    runner.kill();
    laboratory.faults("");
    let status = laboratory.status_of(1);
    assert!(status.contains("NOT RUNNING") && status.contains("\nimu-b: dropped at 14 degC, position "), "{status}");
    let output = laboratory.run(&["--calibrate"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let last = said.lines().last().unwrap();
    assert!(
        last.contains("imu-b is dropped at 14 degC, position ") && last.contains(": no usable sample of imu-b for "),
        "{said}"
    );
    laboratory.assert_in_standby();

    // Every unit is complete for the others, and what there is of the one that was dropped stays as it was.
    let kept = laboratory.events("kept");
    assert_eq!(kept.len(), DWELLS);
    for (number, unit) in kept.iter().enumerate() {
        let files: Vec<_> =
            unit["others"].as_array().unwrap().iter().map(|other| other["file"].as_str().unwrap()).collect();
        let expected = if number < units { vec!["imu-b.csv", "imu-c.csv"] } else { vec!["imu-c.csv"] };
        assert_eq!((unit["file"].as_str(), files), (Some("imu-a.csv"), expected), "{unit}");
    }
    for imu in ["imu-a", "imu-b", "imu-c"] {
        let file = format!("{imu}.csv");
        assert_eq!(laboratory.file(&file).len(), journalled(&laboratory, &file));
    }
    let dropped = laboratory.events("dropped");
    assert_eq!((dropped.len(), dropped[0]["imu"].as_str()), (1, Some("imu-b")));
    for imu in ["imu-a", "imu-c"] {
        assert_as_alone(domain, "station/campaign", imu);
        // Each has its own coefficients along its own axes, within the noise of the short dwells.
        let fitted = table(&text(&laboratory.file(&format!("table-{imu}.toml"))));
        let truth = table(&fs::read_to_string(domain.path(&format!("station/truth-{imu}.toml"))).unwrap());
        let [bias, scale_factor] = worst_errors(&fitted, &truth);
        assert!(bias < 2.0 && scale_factor < 6.0, "{imu}: {bias} ug0, {scale_factor} ppm");
    }
    assert!(laboratory.file("table-imu-b.toml").is_empty());

    let status = laboratory.status();
    for part in ["imu-a: fit, ", "imu-b: dropped at 14 degC", "imu-c: fit, ", "imu-c: not installed, "] {
        assert!(status.contains(part), "{part}:\n{status}");
    }
    let json: Value =
        serde_json::from_str(&domain.run_ok(&["campaign", "status", "station/plan.toml", "--json"])).unwrap();
    assert_eq!(json["campaign"]["dropped"][0]["imu"], "imu-b");
    let [a, b] = [0, 1].map(|imu| &json["imus"][imu]);
    assert_eq!((a["imu"].as_str(), &a["dropped"], b["imu"].as_str()), (Some("imu-a"), &Value::Null, Some("imu-b")));
    assert!(
        a["outcome"]["fit"]["digest"].is_string() && b["outcome"]["fit"].is_null() && b["dropped"].is_string(),
        "{json}"
    );
    let page = text(&laboratory.file("live.html"));
    assert!(page.contains("Campaign of imu-a, imu-b, imu-c") && page.contains("Heads of imu-c"));
    let events = laboratory.events_on_page();
    assert_eq!(events.iter().filter(|event| *event == "dropped").count(), 1, "{events:?}");
    // Nothing is left to do, and one is still missing.
    let again = laboratory.run(&[]);
    assert_eq!(again.status.code(), Some(1));
    assert!(text(&again.stderr).contains("imu-b is dropped at "), "{}", text(&again.stderr));
    assert_eq!(laboratory.events("started").len(), 2);
}

/// A complete campaign of imu-b and imu-a from simulated samples: no instrument is needed. If `drops_b`, imu-b has its
/// dwells and not the verification run, and is dropped; otherwise there is no run.
fn complete_campaign(mounting_b: &str, drops_b: bool) -> (TestDomain, Plan) {
    let domain = TestDomain::new();
    let plan = include_str!("../../../../examples/plan.toml")
        .replace(
            "imu = \"imu-a\"\n",
            &format!("imus = [{{ id = \"imu-b\", mounting = {mounting_b} }}, {{ id = \"imu-a\" }}]\n"),
        )
        .replace("output = \"imu-a-campaign\"", "output = \"campaign\"")
        .replace("start_c = -25\nstop_c = 45\nstep_c = 5", "start_c = -20\nstop_c = 40\nstep_c = 10");
    let plan = plan.replace("runs = 2\nattitudes_deg = [[50, 130], [230, 130]]", "runs = 1");
    let plan = if drops_b { &plan[..] } else { plan.split("[verify]").next().unwrap() };
    let plan: String =
        plan.lines().filter(|line| !line.starts_with("install")).map(|line| format!("{line}\n")).collect();
    domain.write("plan.toml", &plan);
    let plan = Plan::load(&domain.path("plan.toml")).unwrap();
    fs::create_dir(&plan.output).unwrap();
    let (mut journal, _) = Journal::open(&plan).unwrap();
    let taken = |imu: &'static str| {
        let simulated =
            ["simulate", "campaign", "-o", imu, "--imu", imu, "--set-points", "-20:40:10", "--positioning", "0"];
        domain.run_ok(&simulated);
        let samples = fs::read(domain.path(imu).join("samples.csv")).unwrap();
        fs::write(plan.output.join(format!("{imu}.csv")), &samples).unwrap();
        // All bytes are those of the first dwell.
        move |unit: usize| {
            let bytes = if unit == 0 { &samples[..] } else { &[] };
            let from = (samples.len() - bytes.len()) as u64;
            let to = samples.len() as u64;
            KeptStep { unit, file: format!("{imu}.csv"), from, to, sha256: sha256(bytes), ..KeptStep::default() }
        }
    };
    let (first, second) = (taken("imu-b"), taken("imu-a"));
    for unit in 0..units(&plan) - usize::from(drops_b) {
        journal.write(Entry::Kept(KeptStep { others: vec![second(unit)], ..first(unit) })).unwrap();
    }
    if drops_b {
        journal.about(Some(&plan.each()[0].imu));
        journal.write(Entry::Dropped { reason: "at verification run 1: silent".to_owned() }).unwrap();
        journal.about(None);
        let file = "verify-1-imu-a.csv".to_owned();
        fs::write(plan.output.join(&file), "").unwrap();
        let run = KeptStep { unit: units(&plan) - 1, file, sha256: sha256(b""), ..KeptStep::default() };
        journal.write(Entry::Kept(run)).unwrap();
    }
    let [reason, turntable, chamber] =
        ["all data are taken", "turntable stopped", "chamber in standby"].map(String::from);
    journal.write(Entry::Safe { reason, stopped: false, turntable, chamber, certain: true }).unwrap();
    (domain, plan)
}

/// Its verification run is missing, all else is complete.
#[test]
fn an_imu_that_is_dropped_after_its_dwells_has_its_table() {
    let (domain, _) = complete_campaign("[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", true);
    let output = domain.run(&["campaign", "run", "plan.toml", "--calibrate"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let why = "it is not verified: the IMU is dropped, and verification runs of it are missing";
    assert!(said.contains(&format!("table-imu-b.toml is the table; it is not installed: {why}")), "{said}");
    assert!(said.contains("imu-b is dropped at verification run 1: silent"), "{said}");
    assert_as_alone(&domain, "campaign", "imu-b");
    let status = text(&domain.run(&["campaign", "status", "plan.toml"]).stdout);
    for part in ["imu-b: dropped at verification run 1", "imu-b: fit, ", &format!(": {why}"), "imu-a: fit, "] {
        assert!(status.contains(part), "{part}:\n{status}");
    }
    assert!(!status.contains("imu-b: verify-1"), "{status}");
}

/// imu-b does not sit as its mounting says.
#[test]
fn a_fit_that_is_refused_does_not_stop_the_others() {
    let (domain, plan) = complete_campaign("[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]", false);
    let output = domain.run(&["campaign", "run", "plan.toml", "--calibrate"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let refused: Vec<_> =
        said.lines().filter(|line| line.starts_with("isotherm: imu-b: ") || line.starts_with("imu-b: ")).collect();
    assert!(refused.iter().any(|line| line.contains("turned by 90 degrees")), "{said}");
    assert_as_alone(&domain, "campaign", "imu-a");
    assert!(!plan.output.join("table-imu-b.toml").exists());
    let status = domain.run(&["campaign", "status", "plan.toml"]);
    let status = text(&status.stdout);
    assert!(
        status.contains("imu-b: fit, ") && status.contains(": no table:") && status.contains("imu-a: fit, "),
        "{status}"
    );
}
