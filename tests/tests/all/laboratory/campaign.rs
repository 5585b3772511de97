//! The automatic campaign, with a real service and the processes of a simulated station, hundreds of times as fast as
//! in a laboratory.

use crate::feed::{Feed, ids};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_simulation::worst_errors;
use isotherm_tests::laboratory::{TestLaboratory, stdout_of_success, wait_long};
use isotherm_tests::{Process, table, text, wait_until};
use rustix::process::Signal;
use serde_json::Value;
use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::process::{Command, Output};

/// A campaign of four set points and two verification runs, of an IMU with misalignments. Every fit of it is another
/// decision.
#[test]
fn from_a_plan_to_an_installed_table_and_back() {
    let verify = "\n[verify]\nruns = 2\nattitudes_deg = [[50, 130], [50, 310]]\nfrom_c = 10\nto_c = 34\nramp_c_per_h = 20\nhold_s = 600\n";
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
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 5);
    runner.kill();
    let end = laboratory.events("kept").last().unwrap()["to"].as_u64().unwrap() as usize;
    let before = laboratory.file("campaign.csv")[..end].to_vec();
    let status = laboratory.status_of(1);
    assert!(status.starts_with("NOT RUNNING"), "{status}");
    let output = laboratory.run(&["--calibrate", "--require", "10"]);
    // Completed dwells are unchanged to the byte.
    assert!(laboratory.file("campaign.csv").starts_with(&before));
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
    // The ends of the range too are not judged, if the temperature has lagged behind the chamber.
    events.dedup_by(|a, b| a == b && a == "not judged");
    assert_eq!(events, ["start", "start", "end", "fit", "verified", "verified", "not judged", "installed"]);
    // A second run has nothing to do and does not touch the instruments.
    let before = laboratory.file("campaign.csv");
    stdout_of_success(&laboratory.run(&[]));
    assert!(laboratory.file("campaign.csv") == before && laboratory.events("started").len() == 2);

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
    assert_has(&same, &["with an alignment matrix, as the table in force", " is served already, as "]);

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
        ("junk".to_owned(), "cannot be compared with; fix it"),
        (installed.replace("imu-a", "imu-b"), "is the table of imu-b, the plan is for imu-a"),
        (installed.replace("unit = \"V\"", "unit = \"degC\""), "takes temperature in degC, the plan is for V"),
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
    assert_has(&said, &["imu-a.toml.previous is not a regular file; move it away", "nothing is installed"]);
    assert_eq!(fs::read_to_string(domain.path("imu-a.toml")).unwrap(), plain.to_toml());
    assert_has(
        &laboratory.status(),
        &["verify-2.csv, at 50/310 deg: largest error ", "not installed, ", "not a regular file"],
    );
    fs::remove_dir(domain.path("imu-a.toml.previous")).unwrap();
}

/// A worse table is in force. The fit replaces it and comes back, while a feed runs.
fn installed_and_rolled_back_under_a_feed(laboratory: &TestLaboratory, good: &CoefficientTable) {
    let domain = &laboratory.domain;
    let old = changed(good, |content| {
        let bias = &content.axes[0].bias;
        let mut coefficients = bias.coefficients().to_vec();
        coefficients[0] += 4e-6 / content.axes[0].bias_unit.factor();
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
    assert_has(&said, &["the table before is kept as ", " rollback "]);
    wait_for(good);
    let previous = || table(&fs::read_to_string(domain.path("imu-a.toml.previous")).unwrap());
    assert_eq!(previous(), old);
    let rollback = || domain.run_ok(&["rollback", "imu-a.toml"]);
    // The errors that the fitted table states may be so small that the service refuses the old one.
    domain.accept("imu-a", &old.to_toml());
    assert_has(&rollback(), &[&format!("{} is served, as imu-a.toml", old.digest())]);
    wait_for(&old);
    assert_eq!(&previous(), good);
    assert_has(&laboratory.status(), &["installed, ", &format!("; {} is there now", old.digest())]);
    assert_has(&rollback(), &[&format!("{} is served, as imu-a.toml", good.digest())]);
    wait_for(good);
    assert_eq!(feed.end(), ids([&old, good, &old, good]));
    assert_eq!(domain.imu_status()["last_reload_error"], Value::Null);
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
    assert!(stdout_of_success(&stopped).contains("safe state: turntable stopped"), "{}", text(&stopped.stdout));
    let (ended, log) = runner.wait();
    assert_eq!(ended.code(), Some(1), "{log}");
    assert!(log.contains("stopped by campaign stop") && log.contains("continues with the next"), "{log}");
    laboratory.assert_in_standby();
    assert!(!domain.path("station/campaign/stop").exists(), "the request was answered");

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

/// A campaign with a single set point.
fn one_set_point() -> TestLaboratory {
    TestLaboratory::new(&[("list_c = [20, 23]", "list_c = [20]")])
}

fn stop(laboratory: &TestLaboratory) -> Output {
    laboratory.domain.run(&["campaign", "stop", "station/plan.toml"])
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

/// Somebody holds the lock and answers nothing: `campaign stop` goes into the safe state itself, and harms nobody.
#[test]
fn a_stop_that_nobody_answers_brings_the_instruments_into_the_safe_state() {
    let laboratory = one_set_point();
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 1);
    runner.kill();
    let lock = laboratory.domain.path("station/campaign/runner.lock");
    assert_eq!(fs::metadata(&lock).unwrap().permissions().mode() & 0o777, 0o600, "no other user may lock it");
    // The number of a process that is no runner, as of another container.
    let mut other = Command::new("sleep").arg("600").spawn().unwrap();
    fs::write(&lock, other.id().to_string()).unwrap();
    let held = fs::File::options().read(true).write(true).open(&lock).unwrap();
    held.lock().unwrap();
    let said = stdout_of_success(&stop(&laboratory));
    assert!(said.contains("requested while its runner did not answer"), "{said}");
    laboratory.assert_in_standby();
    assert_eq!(other.try_wait().unwrap(), None, "it was left alone");
    other.kill().unwrap();
    other.wait().unwrap();
    drop(held);
    stdout_of_success(&laboratory.run(&[]));
    laboratory.assert_complete(12);
}

/// Whatever is wrong with the folder: the instruments first, with a runner and after one. Nothing is written through
/// what others have put there.
#[test]
fn a_folder_that_everybody_may_write_is_complained_of_after_the_safe_state() {
    let laboratory = one_set_point();
    let domain = &laboratory.domain;
    let folder = domain.path("station/campaign");
    let open_to = |mode: u32| fs::set_permissions(&folder, Permissions::from_mode(mode)).unwrap();
    let stopped = |complaint: &str| {
        let requests = requests_from_now(&laboratory);
        let output = stop(&laboratory);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{said}");
        assert_has(&said, &["safe state: turntable stopped", "chamber in standby", complaint]);
        assert!(requests("chamber").contains(&"MODE,STANDBY".to_owned()));
        assert!(TURNTABLE_ORDERS.iter().all(|order| requests("table").iter().any(|request| request == order)));
    };
    let everybody = "everybody may write it; chmod o-w";
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 1);
    open_to(0o777);
    stopped(everybody);
    let (ended, log) = runner.wait();
    assert!(ended.code() == Some(1) && log.contains("stopped by campaign stop"), "{ended}: {log}");
    open_to(0o755);
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 2);
    runner.kill();
    let journal = laboratory.file("journal.jsonl");
    symlink("journal.jsonl", folder.join("status.json.new")).unwrap();
    open_to(0o1777);
    stopped(everybody);
    assert!(laboratory.file("journal.jsonl") == journal);
    fs::remove_file(folder.join("status.json.new")).unwrap();
    // A folder of one's own whose lock cannot be taken.
    open_to(0o755);
    fs::remove_file(folder.join("runner.lock")).unwrap();
    fs::create_dir(folder.join("runner.lock")).unwrap();
    stopped("runner.lock");
    fs::remove_dir(folder.join("runner.lock")).unwrap();
    stdout_of_success(&stop(&laboratory));
    stdout_of_success(&laboratory.run(&[]));
    laboratory.assert_complete(12);
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

/// Though the lines babble, the orders arrive before any request that waits for something, and the runner says what is
/// not sure. More faults: laboratory/bench/tests.
fn the_orders_go_out_first(connection: &[&str]) {
    let laboratory = with_lines(connection, "quiet_s = 0.2\nretries = 1\n");
    let runner = laboratory.spawn();
    laboratory.wait_for("kept", 1);
    laboratory.faults("babble");
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
    // The first cause may be a reply that the babble has spoiled.
    assert!(log.contains("babble: it sends without a request"), "{log}");
    let safe = laboratory.events("safe").pop().unwrap();
    assert!(safe["table"].as_str().unwrap().contains("babble:"), "{safe}");
    // The next command finds still lines and confirms.
    laboratory.faults("");
    stdout_of_success(&stop(&laboratory));
    laboratory.assert_in_standby();
}

#[test]
fn the_orders_go_out_first_on_serial_lines_that_do_not_work() {
    the_orders_go_out_first(&[]);
}

#[test]
fn the_orders_go_out_first_on_tcp_that_does_not_work() {
    the_orders_go_out_first(&["--tcp"]);
}
