//! The automatic campaign, with a real service and the processes of a simulated station, hundreds of times as fast as
//! in a laboratory.
//!
//! Over 400 lines: all tests share one set-up of service, station and plan.

use crate::feed::{Feed, ids};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_simulation::worst_errors;
use isotherm_tests::laboratory::{TestLaboratory, station_part, stdout_of_success, wait_for_end, wait_long};
use isotherm_tests::{Process, table, text, wait_until};
use rustix::process::{Signal, kill_process};
use serde_json::Value;
use std::fs;
use std::process::Output;
use std::time::Duration;

/// A campaign of four set points and two verification runs, of an IMU with misalignments. Every fit of it is another
/// decision.
#[test]
fn from_a_plan_to_an_installed_table_and_back() {
    let verify = "\n[verify]\nruns = 2\nattitudes_deg = [[50, 130], [50, 310]]\nfrom_c = 12\nto_c = 32\nramp_c_per_h = 20\nhold_s = 60\n";
    let misaligned = "[alignment]\nmatrix = [[1, 2.8e-4, -1e-4], [1.2e-4, 1, 2e-4], [0, -1.5e-4, 1]]\n";
    let laboratory = TestLaboratory::with_truth(
        misaligned,
        &[],
        &[("list_c = [20, 23]", "list_c = [10, 18, 26, 34]"), ("[safe]", &format!("{verify}\n[safe]"))],
    );
    let domain = &laboratory.domain;
    assert_eq!(domain.imu_status()["table"], Value::Null);
    let checked = domain.run_ok(&["campaign", "check", "station/plan.toml"]);
    assert!(checked.contains("4 set points x 12 positions, 2 verification runs; about "), "{checked}");
    let output = laboratory.run(&["--calibrate", "--require", "10"]);
    let verdict = stdout_of_success(&output);
    assert!(verdict.contains("Output stability") && verdict.contains("is required: met"), "{verdict}");
    laboratory.assert_complete(50);
    let kept = laboratory.events("kept");
    let angles: Vec<_> = kept[48..].iter().map(|kept| kept["angles_deg"].clone()).collect();
    assert_eq!(angles, [serde_json::json!([50.0, 130.0]), serde_json::json!([50.0, 310.0])]);
    laboratory.assert_in_standby();
    // The fitted table is in force, and it equals the truth within the noise of the short dwells.
    let installed = fs::read_to_string(domain.path("imu-a.toml")).unwrap();
    let good = table(&installed);
    assert_eq!(domain.imu_status()["table"], good.digest().to_string());
    let truth = fs::read_to_string(domain.path("station/truth.toml")).unwrap();
    let [bias, scale_factor] = worst_errors(&good, &table(&truth));
    assert!(bias < 1.5 && scale_factor < 4.0, "{bias} ug0, {scale_factor} ppm");
    assert!(good.content().alignment.is_some(), "the IMU needs it");
    // The journal has an event for a set point that is left: after a crash it does not count as reached.
    let [reached, left] = ["reached", "left"].map(|event| laboratory.events(event).len());
    assert!(reached >= 5 && left >= reached - 1, "{reached} {left}");
    assert!(text(&laboratory.file("readbacks.csv")).lines().count() > 100);
    let page = text(&laboratory.file("live.html"));
    assert!(page.contains("all data are taken") && page.contains("</svg>") && !page.contains("http-equiv=\"refresh\""));
    let mut events = laboratory.events_on_page();
    // The ends of the range too are not judged, if the telemetry has lagged behind the chamber.
    events.dedup_by(|a, b| a == b && a == "not judged");
    assert_eq!(events, ["start", "end", "fit", "verified", "verified", "not judged", "installed"]);
    // A second run has nothing to do and does not touch the instruments.
    let before = laboratory.file("campaign.csv");
    stdout_of_success(&laboratory.run(&[]));
    assert!(laboratory.file("campaign.csv") == before && laboratory.events("started").len() == 1);

    laboratory.station.signal(Signal::TERM);
    wait_until("the end of the station", || laboratory.station.has_ended());
    what_is_in_force_is_not_replaced(&laboratory, &installed);
    the_axes_of_the_table_in_force_are_kept(&laboratory, &good);
    installed_and_rolled_back_under_a_feed(&laboratory, &good);
}

fn assert_has(said: &str, wanted: &[&str]) {
    for wanted in wanted {
        assert!(said.contains(wanted), "{wanted:?} is not in:\n{said}");
    }
}

/// A good table is in force. `installed` is its text.
fn what_is_in_force_is_not_replaced(laboratory: &TestLaboratory, installed: &str) {
    let digest = table(installed).digest().to_string();
    let status = laboratory.status();
    assert_has(
        &status,
        &["ended: all data are taken", &format!(": {digest}\n"), "verify-1.csv, at 50/130 deg: largest error "],
    );
    assert_has(
        &status,
        &["bias +- ", " ug0, scale factor +- ", "not judged: K- of A3 ", "installed, ", "imu-a.toml\n"],
    );

    // The same table again: its predecessor must not become itself.
    let same = laboratory.refused(&["--require", "10"], 0);
    assert_has(
        &same,
        &["with an alignment matrix, as the table in force", "installed as", " already", "has it in force"],
    );

    // The line of the documents on an IMU with misalignments, which passes by its factor.
    let without = laboratory.refused(&["--no-alignment", "--require", "10"], 1);
    let reasons = ["give --alignment, or a wider bias", "bias: A", "worse than the table in force: "];
    assert_has(&without, &reasons);
    assert_has(&without, &["nothing is installed; the table is left aside as ", "station/campaign/table.toml"]);
    let aside = table(&text(&laboratory.file("table.toml")));
    assert!(aside.content().alignment.is_none());
    let status = laboratory.status();
    assert_has(&status, &[&format!(": {}\n", aside.digest()), "; refused:\n  ", "\nnot installed, "]);
    let json: Value =
        serde_json::from_str(&laboratory.domain.run_ok(&["campaign", "status", "station/plan.toml", "--json"]))
            .unwrap();
    let outcome = &json["outcome"];
    assert_eq!(outcome["fit"]["digest"], aside.digest().to_string());
    assert!(outcome["verification"][0]["largest"]["error_g0"].as_f64().unwrap() > 50e-6, "{outcome}");
    assert!(outcome["verification"][0]["refused"].is_string() && outcome["installation"]["refused"].is_string());
    let events = laboratory.events_on_page();
    let last = events.rsplit(|event| event == "fit").next().unwrap();
    assert!(last[0] == "refused" && last.last().unwrap() == "not installed", "{events:?}");

    // The user's bounds win, but the comparison stays.
    let wide = "10,bias=10mg0,scale=1%,level=1deg";
    let worse = laboratory.refused(&["--no-alignment", "--require", wide], 1);
    assert_has(&worse, &["worse than the table in force: "]);
    assert!(!worse.contains("or a wider bias") && !worse.contains("bias: A"), "{worse}");

    let missed = laboratory.refused(&["--require", "bias=0.001ug0,level=0.01arcsec"], 1);
    assert_has(
        &missed,
        &["bias: A", "at most 0.001 ug0 is required: missed", "level: the level", "is required: missed"],
    );
    assert!(!missed.contains("scale: "), "that bound is the fit's: {missed}");
    assert!(!laboratory.has_predecessor());

    // Without --require nothing is installed, whatever is in force.
    let domain = &laboratory.domain;
    for (in_force, wanted) in [
        ("junk".to_owned(), "cannot be compared with; mend it"),
        (installed.replace("imu-a", "imu-b"), "is the table of imu-b, the plan is for imu-a"),
        (installed.replace("unit = \"V\"", "unit = \"degC\""), "takes telemetry in degC, the plan is for V"),
    ] {
        // Another content has another digest.
        let in_force: String = in_force.split_inclusive('\n').filter(|line| !line.starts_with("digest = ")).collect();
        domain.replace("imu-a.toml", &in_force);
        let said = laboratory.calibrate(&["--require", "10"], 78);
        assert_has(&said, &[wanted]);
        assert_eq!(fs::read_to_string(domain.path("imu-a.toml")).unwrap(), in_force);
        assert_has(&laboratory.status(), &["no table:", wanted]);
    }
    assert!(!laboratory.has_predecessor());
    domain.replace("imu-a.toml", installed);
}

/// A table with these changes.
fn changed(table: &CoefficientTable, change: impl FnOnce(&mut Content)) -> CoefficientTable {
    let mut content = table.content().clone();
    change(&mut content);
    CoefficientTable::new(content).unwrap()
}

/// The table in force has no alignment matrix, or covers more.
fn the_axes_of_the_table_in_force_are_kept(laboratory: &TestLaboratory, good: &CoefficientTable) {
    let domain = &laboratory.domain;
    let put_in_force = |table: &CoefficientTable| {
        domain.replace("imu-a.toml", &table.to_toml());
        wait_until("the table in force", || domain.imu_status()["table"] == table.digest().to_string());
    };
    put_in_force(&changed(good, |content| {
        for axis in &mut content.axes {
            let bias = &axis.bias;
            let [low, high] = bias.range();
            let range = [low - 0.2 * (high - low), high];
            axis.bias = Polynomial::new(bias.coefficients(), bias.center(), bias.scale(), range).unwrap();
        }
    }));
    assert_has(
        &laboratory.refused(&["--require", "10"], 1),
        &["bias of A1 covers ", "a campaign over the whole range"],
    );

    let plain = changed(good, |content| content.alignment = None);
    put_in_force(&plain);
    let kept = laboratory.refused(&["--require", "10"], 1);
    assert_has(&kept, &["without an alignment matrix, as the table in force", "give --alignment, or a wider bias"]);
    // A predecessor cannot be kept where a folder has its name.
    fs::create_dir(domain.path("imu-a.toml.previous")).unwrap();
    let said = laboratory.calibrate(&["--alignment", "--require", "10"], 74);
    assert_has(&said, &["imu-a.toml.previous is no regular file; move it away", "nothing is installed"]);
    assert_eq!(fs::read_to_string(domain.path("imu-a.toml")).unwrap(), plain.to_toml());
    assert_has(
        &laboratory.status(),
        &["verify-2.csv, at 50/310 deg: largest error ", "not installed, ", "no regular file"],
    );
    fs::remove_dir(domain.path("imu-a.toml.previous")).unwrap();
}

/// A worse table is in force. The fit replaces it and comes back, while a feed runs.
fn installed_and_rolled_back_under_a_feed(laboratory: &TestLaboratory, good: &CoefficientTable) {
    let domain = &laboratory.domain;
    let old = changed(good, |content| {
        let bias = &content.axes[0].bias;
        let mut coefficients = bias.coefficients().to_vec();
        coefficients[0] += 40e-6 / content.axes[0].bias_unit.factor();
        content.axes[0].bias = Polynomial::new(&coefficients, bias.center(), bias.scale(), bias.range()).unwrap();
    });
    domain.replace("imu-a.toml", &old.to_toml());
    wait_until("the old table", || domain.imu_status()["table"] == old.digest().to_string());
    let mut reader = domain.reader("imu-a");
    let mut wait_for = |table: &CoefficientTable| {
        wait_long("an increment of the table", || {
            std::iter::from_fn(|| reader.receive().unwrap()).any(|increment| increment.table == table.id())
        });
    };
    let feed = Feed::start(domain);
    wait_for(&old);
    let said = laboratory.calibrate(&["--require", "10"], 0);
    assert_has(&said, &["its predecessor is kept as ", "`isotherm rollback "]);
    wait_for(good);
    let previous = || table(&fs::read_to_string(domain.path("imu-a.toml.previous")).unwrap());
    assert_eq!(previous(), old);
    let rollback = || domain.run_ok(&["rollback", "imu-a.toml"]);
    assert_has(&rollback(), &[&format!("imu-a.toml is {} again", old.digest())]);
    wait_for(&old);
    assert_eq!(&previous(), good);
    assert_has(&laboratory.status(), &["installed, ", &format!("; {} is there now", old.digest())]);
    assert_has(&rollback(), &[&format!("imu-a.toml is {} again", good.digest())]);
    wait_for(good);
    assert_eq!(feed.end(), ids([&old, good, &old, good]));
    assert_eq!(domain.imu_status()["last_reload_error"], Value::Null);
}

#[test]
fn turns_of_an_imu_without_gyroscopes_end_at_its_first_sample() {
    let laboratory = TestLaboratory::new(&[
        ("temperature_unit = ", "latitude_deg = 39.9   # north positive\ntemperature_unit = "),
        ("[chamber]", "[turns]\n\n[chamber]"),
    ]);
    let check = laboratory.domain.run(&["campaign", "check", "station/plan.toml"]);
    let plan = stdout_of_success(&check);
    assert_has(&plan, &["2 set points x (12 positions and 6 turns)", "positions 1 to 12, turns 13 to 18"]);
    let output = laboratory.run(&[]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(65), "{said}");
    assert_has(&said, &["have no gyroscopes", "leave [turns] out of the plan", "safe state: table stopped"]);
    assert_eq!(laboratory.events("kept").len(), 0);
    laboratory.assert_in_standby();
}

#[test]
fn killed_twice_it_continues_with_the_first_missing_dwell() {
    let laboratory = TestLaboratory::new(&[]);
    let mut before = Vec::new();
    for count in [5, 15] {
        let runner = laboratory.spawn();
        laboratory.wait_for("kept", count);
        runner.kill();
        let kept = laboratory.events("kept");
        let end = kept.last().unwrap()["to"].as_u64().unwrap() as usize;
        let samples = laboratory.file("campaign.csv");
        assert!(samples.starts_with(&before) && samples.len() >= end);
        before = samples[..end].to_vec();
        let status = laboratory.domain.run(&["campaign", "status", "station/plan.toml"]);
        assert_eq!(status.status.code(), Some(1));
        assert!(text(&status.stdout).starts_with("NOT RUNNING"), "{}", text(&status.stdout));
    }
    stdout_of_success(&laboratory.run(&[]));
    // Completed dwells are unchanged to the byte, and every dwell is present once.
    assert!(laboratory.file("campaign.csv").starts_with(&before));
    laboratory.assert_complete(24);
    laboratory.assert_in_standby();
    assert_eq!(laboratory.events_on_page(), ["start", "start", "start", "end"]);
    let page = text(&laboratory.file("live.html"));
    assert_eq!(page.matches("the runner before ended without the safe state").count(), 2);
}

#[test]
fn stop_ends_it_in_the_safe_state_and_a_changed_plan_or_recording_is_refused() {
    let laboratory = TestLaboratory::new(&[]);
    let domain = &laboratory.domain;
    let stop = || domain.run(&["campaign", "stop", "station/plan.toml"]);
    assert_eq!(stop().status.code(), Some(69), "nobody runs it");
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 2);
    let second = laboratory.run(&[]);
    assert_eq!(second.status.code(), Some(1));
    assert!(
        text(&second.stderr).contains(&format!("pid {} runs this campaign", runner.pid())),
        "{}",
        text(&second.stderr)
    );
    let status: Value =
        serde_json::from_str(&domain.run_ok(&["campaign", "status", "station/plan.toml", "--json"])).unwrap();
    assert_eq!((status["pid"].as_u64(), status["campaign"]["units"].as_u64()), (Some(runner.pid().into()), Some(24)));
    let stopped = stop();
    assert!(stdout_of_success(&stopped).contains("safe state: table stopped"), "{}", text(&stopped.stdout));
    let (ended, log) = runner.wait();
    assert_eq!(ended.code(), Some(1), "{log}");
    assert!(log.contains("stopped by SIG") && log.contains("goes on with the next"), "{log}");
    laboratory.assert_in_standby();

    let plan = fs::read_to_string(domain.path("station/plan.toml")).unwrap();
    domain.write("station/plan.toml", &plan.replace("time_s = 60\n", "time_s = 70\n"));
    let changed = laboratory.run(&[]);
    assert_eq!(changed.status.code(), Some(78));
    assert!(text(&changed.stderr).contains("dwell.time_s: was 60.0, is 70.0"), "{}", text(&changed.stderr));
    domain.write("station/plan.toml", &plan);
    let mut samples = laboratory.file("campaign.csv");
    samples[500] ^= 1;
    fs::write(domain.path("station/campaign/campaign.csv"), samples).unwrap();
    let damaged = laboratory.run(&[]);
    assert_eq!(damaged.status.code(), Some(65), "{}", text(&damaged.stderr));
}

#[test]
fn an_instrument_that_disconnects_pauses_the_campaign_until_it_is_back() {
    // The turntable is so slow that every travel can be interrupted.
    let laboratory =
        TestLaboratory::new(&[("list_c = [20, 23]", "list_c = [20]"), ("rate_deg_s = 10", "rate_deg_s = 0.5")]);
    let runner = laboratory.spawn();
    for (count, phase, fault) in [
        (0, "soak", "port-loss:chamber"),
        (1, "travel", "missing:table"),
        (2, "travel", "garbled:chamber"),
        (3, "travel", "port-loss:table"),
        (4, "dwell", "garbled:chamber"),
    ] {
        laboratory.wait_for("kept", count);
        wait_long(phase, || laboratory.phase() == phase || laboratory.events("kept").len() > count);
        let pauses = laboratory.events("paused").len();
        laboratory.faults(fault);
        laboratory.wait_for("paused", pauses + 1);
        laboratory.faults("");
        laboratory.wait_for("resumed", pauses + 1);
    }
    let (success, log) = wait_for_end(runner);
    assert!(success, "{log}");
    laboratory.assert_complete(12);
    let events = laboratory.events_on_page();
    let count = |name: &str| events.iter().filter(|event| *event == name).count();
    let journalled = ["paused", "resumed", "discarded"].map(|event| laboratory.events(event).len());
    assert_eq!(["pause", "resume", "repeated dwell"].map(count), journalled, "{events:?}");
    assert!(journalled[0] >= 5 && text(&laboratory.file("live.html")).contains("class=\"mark\""));
}

#[test]
fn an_alarm_ends_it_in_the_safe_state_at_once() {
    let laboratory = TestLaboratory::new(&[("list_c = [20, 23]", "list_c = [20]")]);
    let runner = laboratory.spawn();
    laboratory.wait_for("reached", 1);
    laboratory.faults("alarm:chamber");
    let (ended, log) = wait_for_end(runner);
    assert!(!ended && log.contains("alarm"), "{log}");
    assert!(laboratory.events("paused").is_empty());
    laboratory.assert_in_standby();
    laboratory.faults("");
    // After the alarm is cleared the campaign can be started again. A signal ends it in the safe state too.
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 1);
    runner.signal(Signal::INT);
    let (ended, log) = wait_for_end(runner);
    assert!(!ended && log.contains("stopped by SIG"), "{log}");
    laboratory.assert_in_standby();
    assert_eq!(laboratory.events_on_page(), ["start", "alarm or fault", "start", "stop"]);
}

/// A campaign with a single set point.
fn one_set_point() -> TestLaboratory {
    TestLaboratory::new(&[("list_c = [20, 23]", "list_c = [20]")])
}

fn stop(laboratory: &TestLaboratory) -> Output {
    laboratory.domain.run(&["campaign", "stop", "station/plan.toml"])
}

#[test]
fn an_alarm_ends_the_campaign_while_the_other_instrument_is_disconnected() {
    let laboratory = one_set_point();
    let runner = laboratory.spawn();
    laboratory.wait_for("reached", 1);
    laboratory.faults("port-loss:table");
    laboratory.wait_for("paused", 1);
    laboratory.faults("port-loss:table\nalarm:chamber");
    wait_long("the end", || runner.has_ended());
    let (status, log) = runner.wait();
    // The turntable is disconnected and cannot be stopped.
    assert_eq!(status.code(), Some(69), "{log}");
    assert!(log.contains("the chamber has an alarm") && log.contains("table NOT known to be stopped"), "{log}");
    assert!(log.contains("GO THERE AND LOOK"), "{log}");
    laboratory.faults("");
    wait_until("the table", || laboratory.domain.path("station/table").exists());
    assert!(stdout_of_success(&stop(&laboratory)).contains("table stopped at"));
    laboratory.assert_in_standby();
    assert_eq!(stop(&laboratory).status.code(), Some(69), "nothing is left to do");
}

#[test]
fn reconnecting_the_turntable_does_not_reset_a_fault_that_came_meanwhile() {
    let laboratory = one_set_point();
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 1);
    laboratory.faults("port-loss:table\nalarm:table");
    laboratory.wait_for("paused", 1);
    laboratory.faults("");
    let (ended, log) = wait_for_end(runner);
    assert!(!ended && log.contains("the table has a fault: interlock of axis 1: Fault"), "{log}");
    laboratory.assert_in_standby();
}

#[test]
fn a_runner_that_cannot_continue_names_the_command_for_the_safe_state() {
    let laboratory = one_set_point();
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 1);
    runner.kill();
    let mut samples = laboratory.file("campaign.csv");
    samples[200] ^= 1;
    fs::write(laboratory.domain.path("station/campaign/campaign.csv"), samples).unwrap();
    let refused = laboratory.run(&[]);
    assert_eq!(refused.status.code(), Some(65));
    assert!(text(&refused.stderr).contains("`isotherm campaign stop` brings them into the safe state"));
    assert!(stdout_of_success(&stop(&laboratory)).contains("after its runner had ended without"));
    laboratory.assert_in_standby();
    let status = laboratory.domain.run_ok(&["campaign", "status", "station/plan.toml"]);
    assert!(status.starts_with("ended: requested after its runner had ended without"), "{status}");
    assert_eq!(stop(&laboratory).status.code(), Some(69));
}

#[test]
fn a_stream_that_stops_pauses_the_campaign_until_samples_come_again() {
    let laboratory =
        // 20 s of real time.
        TestLaboratory::new(&[("list_c = [20, 23]", "list_c = [20]"), ("stream_s = 30000", "stream_s = 14000")]);
    let imu = station_part(&laboratory.station, "imu");
    let paused = || {
        let status: Value = serde_json::from_slice(&laboratory.file("status.json")).unwrap_or_default();
        status["paused"].is_string()
    };
    // At the start, before the first sample.
    kill_process(imu, Signal::STOP).unwrap();
    let runner = laboratory.spawn();
    wait_long("the wait for samples", paused);
    kill_process(imu, Signal::CONT).unwrap();
    laboratory.wait_for("kept", 1);
    assert!(!paused(), "it is over");
    kill_process(imu, Signal::STOP).unwrap();
    laboratory.wait_for("paused", 1);
    let cause = laboratory.events("paused")[0]["cause"].as_str().unwrap().to_owned();
    // The first of these, unless the dwell is over its time before.
    let causes = ["no usable sample of imu-a for ", " s of usable samples in "];
    assert!(causes.iter().any(|words| cause.contains(words)), "{cause}");
    kill_process(imu, Signal::CONT).unwrap();
    let (success, log) = wait_for_end(runner);
    assert!(success, "{log}");
    laboratory.assert_complete(12);
}

/// The live page has the curves that the runner keeps. It does not read the readbacks again, which grow for days.
#[test]
fn the_live_page_has_the_earlier_curves_when_the_readbacks_are_truncated() {
    let laboratory = one_set_point();
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 1);
    let rows = || text(&laboratory.file("readbacks.csv")).lines().count() - 1;
    // No row is written between counting and truncation.
    runner.stop();
    let earlier = rows();
    let header = laboratory.file("readbacks.csv").iter().position(|byte| *byte == b'\n').unwrap() + 1;
    let file = fs::File::options().write(true).open(laboratory.domain.path("station/campaign/readbacks.csv")).unwrap();
    file.set_len(header as u64).unwrap();
    runner.resume();
    let (success, log) = wait_for_end(runner);
    assert!(success, "{log}");
    let later = rows();
    assert!(earlier > 2 && later > 2, "{earlier} {later}");
    let page = text(&laboratory.file("live.html"));
    assert!(page.contains("all data are taken"));
    let series = format!("Series: air ({0} points), set point ({0} points)", earlier + later);
    let found: Vec<_> = page.split("<desc>").skip(1).filter_map(|figure| figure.split("</desc>").next()).collect();
    assert!(found.contains(&series.as_str()), "{earlier} + {later} rows, but {found:?}");
}

/// The stop orders as they arrive at the simulated turntable.
const TURNTABLE_ORDERS: [&str; 4] = [":mode:off 1", ":interlock:open 1", ":mode:off 2", ":interlock:open 2"];

/// A campaign with a single set point at instruments on pseudo-terminals, or on TCP, with these keys of both lines.
fn with_lines(connection: &[&str], keys: &str) -> TestLaboratory {
    let [chamber, table] = ["driver = \"espec\"\n", "driver = \"acutrol\"\n"];
    let [chamber_keys, table_keys] = [chamber, table].map(|driver| format!("{driver}{keys}"));
    let changes = [("list_c = [20, 23]", "list_c = [20]"), (chamber, &chamber_keys), (table, &table_keys)];
    TestLaboratory::with_station(connection, &changes)
}

/// Asks the runner to end, and returns how to read the requests that an instrument gets from then on.
fn interrupt<'l>(laboratory: &'l TestLaboratory, runner: &Process) -> impl Fn(&str) -> Vec<String> + use<'l> {
    runner.stop();
    let requests = requests_from_now(laboratory);
    runner.signal(Signal::INT);
    runner.resume();
    requests
}

/// How to read the requests that an instrument gets from now on.
fn requests_from_now(laboratory: &TestLaboratory) -> impl Fn(&str) -> Vec<String> {
    laboratory.domain.replace("station/requests", "");
    |instrument: &str| {
        let requests = fs::read_to_string(laboratory.domain.path("station/requests")).unwrap();
        let mut lines = requests.lines().map(|line| line.splitn(3, ' ').collect::<Vec<_>>());
        let mine = lines.by_ref().filter(|line| line[1] == instrument);
        mine.map(|line| line[2].to_owned()).collect()
    }
}

/// Number of attempts at the safe state of an instrument.
const SAFE_ATTEMPTS: usize = 5;

/// Asserts that each order came at every attempt.
fn assert_repeated(orders: &[&str], requests: &[String]) {
    for order in orders {
        let count = requests.iter().filter(|request| request == order).count();
        assert!(count >= SAFE_ATTEMPTS, "{order}: {count} of {SAFE_ATTEMPTS} in {requests:?}");
    }
}

/// Asserts that the orders come first. Before them may be a request that was under way when the signal came, or the
/// rest of these orders, which a pause sends to a turntable that moves.
fn assert_first(orders: &[&str], requests: &[String]) {
    let orders: Vec<String> = orders.iter().map(ToString::to_string).collect();
    let begins = |at: usize| requests.get(at..).is_some_and(|requests| requests.starts_with(&orders));
    let are_orders = |at: usize| requests[..at].iter().all(|request| orders.contains(request));
    let is_first = (0..=orders.len()).any(|at| begins(at) && (at <= 1 || are_orders(at)));
    assert!(is_first, "{requests:?}");
}

/// However the lines disturb, the orders arrive before any request that waits for something, and the runner says what
/// is not sure.
fn the_orders_go_out_first(connection: &[&str]) {
    for fault in ["babble", "garbled", "missing"] {
        let laboratory = with_lines(connection, "quiet_s = 0.2\nretries = 1\n");
        let runner = laboratory.spawn();
        laboratory.wait_for("kept", 1);
        laboratory.faults(fault);
        laboratory.wait_for("paused", 1);
        let requests = interrupt(&laboratory, &runner);
        wait_long("the end", || runner.has_ended());
        let (status, log) = runner.wait();
        assert_eq!(status.code(), Some(69), "{log}");
        assert!(log.contains("stopped by SIGINT") && log.contains("GO THERE AND LOOK"), "{log}");
        assert_first(&["MODE,STANDBY"], &requests("chamber"));
        assert_first(&TURNTABLE_ORDERS, &requests("table"));
        assert_repeated(&["MODE,STANDBY"], &requests("chamber"));
        assert_repeated(&TURNTABLE_ORDERS, &requests("table"));
        if fault == "babble" {
            // The first cause may be a reply that the babble has spoiled.
            assert!(log.contains("babble: it sends without a request"), "{log}");
            let safe = laboratory.events("safe").pop().unwrap();
            assert!(safe["table"].as_str().unwrap().contains("babble:"), "{safe}");
        }
        // The next command finds still lines and confirms.
        laboratory.faults("");
        stdout_of_success(&stop(&laboratory));
        laboratory.assert_in_standby();
    }
}

#[test]
fn the_orders_go_out_first_on_serial_lines_that_do_not_work() {
    the_orders_go_out_first(&[]);
}

#[test]
fn the_orders_go_out_first_on_tcp_that_does_not_work() {
    the_orders_go_out_first(&["--tcp"]);
}

/// A campaign with a single set point, this chamber and this safe state.
fn with_chamber(chamber: &str, safe: &str) -> TestLaboratory {
    let with_keys = |driver: &str| format!("{driver}quiet_s = 0.2\nretries = 0\n");
    let [driver, turntable] = [chamber, "acutrol"].map(|driver| format!("driver = {driver:?}\n"));
    TestLaboratory::with_station(
        &["--chamber", chamber],
        &[
            ("list_c = [20, 23]", "list_c = [20]"),
            (&driver, &with_keys(&driver)),
            (&turntable, &with_keys(&turntable)),
            ("chamber = \"standby\"", &format!("chamber = {safe:?}")),
        ],
    )
}

/// The write of 62 to register 2730.
const F4T_STOP: &str = "\\x01\\x06\\n\\xaa\\x00>";

/// A process that has not reached the chamber before orders what it knows: without the unit of a Watlow F4T its stop in
/// place of ambient, without the outputs of an ASCII-2 chamber nothing.
#[test]
fn a_new_process_orders_what_it_can_on_lines_that_do_not_work() {
    for (chamber, safe, fault, order, attempts) in [
        // Attempts at ambient, then at standby.
        ("watlow-f4t", "ambient", "babble", Some(F4T_STOP), 2 * SAFE_ATTEMPTS),
        ("ascii2", "standby", "babble", None, 0),
        // The first readings are answered. They have the outputs.
        ("ascii2", "standby", "babble:table\nmissing:chamber@4-1000000", Some("$01E 0020.0 00"), SAFE_ATTEMPTS),
    ] {
        let laboratory = with_chamber(chamber, safe);
        let runner = laboratory.spawn();
        laboratory.wait_for("reached", 1);
        runner.kill();
        let requests = requests_from_now(&laboratory);
        laboratory.faults(fault);
        let stopped = stop(&laboratory);
        assert_eq!(stopped.status.code(), Some(69), "{}", text(&stopped.stderr));
        let chamber_requests = requests("chamber");
        let orders = chamber_requests.iter().filter(|request| order.is_some_and(|order| request.starts_with(order)));
        match order {
            Some(_) => assert!(orders.count() >= attempts, "{chamber_requests:?}"),
            None => assert!(chamber_requests.iter().all(|request| request == "$01I"), "{chamber_requests:?}"),
        }
        assert_repeated(&TURNTABLE_ORDERS, &requests("table"));
        // The next command finds still lines and confirms.
        laboratory.faults("");
        stdout_of_success(&stop(&laboratory));
        laboratory.assert_in_standby();
    }
}

/// A line that works gives the unit in time, and the chamber is not stopped. On a loaded machine that may take several
/// tries.
#[test]
fn a_new_process_holds_a_watlow_at_ambient() {
    let laboratory = with_chamber("watlow-f4t", "ambient");
    wait_long("a unit in time", || {
        let kept = laboratory.events("kept").len();
        let runner = laboratory.spawn();
        laboratory.wait_for("kept", kept + 1);
        runner.kill();
        let requests = requests_from_now(&laboratory);
        let held = stdout_of_success(&stop(&laboratory)).contains("chamber held at 20.0 degC");
        held && !requests("chamber").iter().any(|request| request.starts_with(F4T_STOP))
    });
}

/// A turntable that takes nothing does not delay the chamber's order; neither does a second signal change anything.
#[test]
fn a_dead_turntable_does_not_hold_the_chambers_order() {
    for connection in [&[][..], &["--tcp"]] {
        // On a busy machine the chamber that lives needs more than a second for a reply.
        let laboratory = with_lines(connection, "timeout_s = 2\nquiet_s = 0.2\nretries = 1\n");
        let runner = laboratory.spawn();
        laboratory.wait_for("kept", 1);
        laboratory.faults("dead:table");
        laboratory.wait_for("paused", 1);
        let requests = interrupt(&laboratory, &runner);
        wait_until("the chamber's order", || requests("chamber").contains(&"MODE,STANDBY".to_owned()));
        runner.signal(Signal::INT);
        wait_long("the end", || runner.has_ended());
        let (status, log) = runner.wait();
        assert_eq!(status.code(), Some(69), "{log}");
        assert_first(&["MODE,STANDBY"], &requests("chamber"));
        assert_eq!(requests("table"), [""; 0]);
        let safe = laboratory.events("safe").pop().unwrap();
        assert!(safe["chamber"].as_str().unwrap().starts_with("chamber in standby"), "{safe}");
        assert!(safe["table"].as_str().unwrap().starts_with("table NOT known to be stopped"), "{safe}");
    }
}

/// The lines may wait a minute for a reply, but not once the safe state is wanted.
#[test]
fn the_orders_wait_for_no_time_out() {
    for connection in [&[][..], &["--tcp"]] {
        let laboratory = with_lines(connection, "timeout_s = 60\nquiet_s = 0.2\n");
        let runner = laboratory.spawn();
        laboratory.wait_for("kept", 1);
        laboratory.domain.replace("station/requests", "");
        laboratory.faults("missing");
        // The runner waits for the reply to the last request.
        let sent = || fs::read_to_string(laboratory.domain.path("station/requests")).unwrap();
        let mut last = sent();
        wait_until("a request without a reply", || {
            std::thread::sleep(Duration::from_millis(500));
            let before = std::mem::replace(&mut last, sent());
            before == last
        });
        let requests = interrupt(&laboratory, &runner);
        wait_until("the orders", || {
            requests("chamber").first().is_some_and(|first| first == "MODE,STANDBY")
                && requests("table").starts_with(&TURNTABLE_ORDERS.map(ToOwned::to_owned))
        });
        runner.kill();
    }
}
