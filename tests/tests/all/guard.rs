//! A table that changes too much does not go into force: not by a reload, not by a restart, only by its digest.

use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, Content};
use isotherm_shared::wire::Flags;
use isotherm_tests::{
    Needs, Process, TABLE, TestDomain, WHOLE_TABLE, recording, round_trip, skip, table, text, variant, wait_until,
};
use rustix::process::Signal;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, chown};
use std::path::PathBuf;
use std::process::Command;

const NOBODY: u32 = 65_534;

/// A digit of K+ of A1 is lost.
fn lost_digit() -> String {
    let text = TABLE.replace("91733.0", "9173.0");
    assert_ne!(text, TABLE);
    text
}

fn digest(text: &str) -> String {
    table(text).digest().to_string()
}

/// Starts the service with the table `imu-a.toml`, which must be refused: the one from before is served.
fn serve_kept(domain: &TestDomain, kept: &str) -> Process {
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let log = service.log();
    assert!(log.contains("the table file is not taken, and the table that was in force last is served: "), "{log}");
    assert!(log.contains(" ERROR "), "{log}");
    assert_eq!(in_force(domain), kept);
    service
}

/// Tries to start the service with a configuration that ends where a table is refused. Returns what it says.
fn refused_start(domain: &TestDomain) -> String {
    let config = "[reload]\nat_start = \"exit\"\n[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n";
    domain.write("exit.toml", config);
    let output = domain.run(&["serve", "--config", "exit.toml"]);
    assert_eq!(output.status.code(), Some(78), "{}", text(&output.stderr));
    text(&output.stderr)
}

/// Waits until the table in force is kept.
fn wait_until_kept(domain: &TestDomain) {
    wait_until("the table to be kept", || domain.imu_status()["table_kept"] == true);
}

/// Runs `reload` of a program, which must end with this exit code. Returns what it says.
fn reload(domain: &TestDomain, program: &str, accept: &str, code: i32) -> String {
    let output = domain.finish(domain.program(program, &["reload", "--imu", "imu-a", "--accept", accept]));
    assert_eq!(output.status.code(), Some(code), "{}", text(&output.stderr));
    text(&output.stderr)
}

fn in_force(domain: &TestDomain) -> String {
    domain.imu_status()["table"].as_str().unwrap().to_owned()
}

/// Installs a table that the service must refuse; returns why.
fn refuse(domain: &TestDomain, service: &Process, table: &str) -> String {
    let refused = service.count_in_log("table refused") + 1;
    domain.replace("imu-a.toml", table);
    service.wait_for_log_lines("table refused", refused);
    domain.imu_status()["last_reload_error"].as_str().unwrap().to_owned()
}

#[test]
fn a_lost_digit_is_refused_while_running_and_at_the_next_start_until_its_digest_is_accepted() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let (good, bad) = (digest(TABLE), digest(&lost_digit()));
    let reason = refuse(&domain, &service, &lost_digit());
    for part in [
        "A1 positive_scale_factor changes by 911470 ppm, from 90578.9 to 8018.93 pulse/(s*g0) at 4.2; at most 10 % is taken (max_change.scale)",
        &format!("in force last, {good}"),
        &format!("`reload --imu imu-a --accept {bad}`"),
    ] {
        assert!(reason.contains(part), "no {part:?} in {reason}");
    }
    // The old table stays, and file and table in force differ as long as it is so.
    assert_eq!(round_trip(&mut acquisition, &recording()[0]).table, table(TABLE).id());
    let status = domain.imu_status();
    assert_eq!((status["table"].as_str(), status["refused_table"].as_str()), (Some(&*good), Some(&*bad)));
    assert!(domain.run_ok(&["status"]).contains("  REFUSED      A1 positive_scale_factor changes by 911470 ppm"));

    // One digest is accepted, and by it no other table.
    let words = reload(&domain, "isotherm", &digest(&variant(1)), 78);
    assert!(words.contains(&format!("this is not the table of imu-a.toml, which has {bad}")), "{words}");
    assert_eq!(in_force(&domain), good);
    for wrong in ["117fc01d0047a7a2", "sha256:117fc01d0047a7a2"] {
        reload(&domain, "isotherm", wrong, 64);
    }

    // A restart, ordered or not, does not install what the reload has refused, and serves the table from before; so
    // does one after the domain was removed.
    service.kill();
    let service = serve_kept(&domain, &good);
    let status = domain.imu_status();
    assert_eq!((status["refused_table"].as_str(), &status["refusals"]), (Some(&*bad), &1.into()));
    assert!(status["last_reload_error"].as_str().unwrap().contains("A1 positive_scale_factor changes by 911470 ppm"));
    assert_eq!(round_trip(&mut acquisition, &recording()[1]).table, table(TABLE).id());
    service.terminate();
    drop(acquisition);
    domain.run_ok(&["clean"]);
    serve_kept(&domain, &good).terminate();
    // Unless it is to end then.
    let words = refused_start(&domain);
    assert!(words.contains("imu-a.toml: A1 positive_scale_factor changes by") && words.contains("--accept sha256:"));

    // Accepted without a service, it is taken at the next start, once.
    let words = reload(&domain, "isothermd", &bad, 0);
    assert!(words.contains("no service runs; the next one takes this table of imu-a at its start"), "{words}");
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    assert!(service.log().contains("; accepted by its digest") && service.log().contains("look for a lost digit"));
    assert_eq!(in_force(&domain), bad);
    // The way back changes as much; it is accepted while the service runs.
    let reason = refuse(&domain, &service, TABLE);
    assert!(reason.contains("changes by 10295600 ppm"), "{reason}");
    assert!(reload(&domain, "isothermd", &good, 0).contains(&format!("imu-a: {good} is in force, and kept")));
    let status = domain.imu_status();
    assert_eq!((in_force(&domain), &status["refused_table"]), (good, &serde_json::Value::Null));
    assert_eq!(status["last_reload_error"], serde_json::Value::Null);
    // An acceptance is used up.
    refuse(&domain, &service, &lost_digit());
    service.terminate();
    refused_start(&domain);
}

#[test]
fn what_a_table_states_limits_the_next_one_also_over_a_restart() {
    let domain = TestDomain::new();
    let provenance = "\n[provenance]\n[[provenance.curve]]\naxis = \"A1\"\nquantity = \"bias\"\nunit = \"ug0\"\nlargest_interval = 4.0\n";
    let with_c0 = |c0: &str| TABLE.replace("c0 = 793.55", &format!("c0 = {c0}"));
    let sealed = |c0: &str| format!("{}{provenance}", table(&with_c0(c0)).to_toml());
    domain.write("imu-a.toml", &sealed("793.55"));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    // A digit of the bias is lost before it is sealed, and a part of an unsealed file lies over the sealed one.
    let reason = refuse(&domain, &service, &sealed("79.55"));
    assert!(reason.contains("at most 39.979 ug0 is taken, by the errors and ranges"), "{reason}");
    let reason = refuse(&domain, &service, &with_c0("793.56"));
    assert!(reason.contains("digest: ") && reason.contains("seal it with `check --seal`"), "{reason}");
    wait_until_kept(&domain);
    service.kill();
    let service = serve_kept(&domain, &digest(TABLE));
    let reason = refuse(&domain, &service, &sealed("79.55"));
    assert!(reason.contains("at most 39.979 ug0 is taken"), "{reason}");
    // `check` says the same, of a table that it is about to seal.
    domain.write("old.toml", &sealed("793.55"));
    domain.write("new.toml", &with_c0("793.56"));
    let output = domain.run(&["check", "--against", "old.toml", "new.toml"]);
    assert!(text(&output.stderr).contains("seal it with `check --seal`"), "{}", text(&output.stderr));
    domain.run_ok(&["check", "--seal", "--against", "old.toml", "new.toml"]);
    // What is accepted is in force, and an unsealed table may follow it.
    domain.replace("imu-a.toml", &with_c0("893.55"));
    reload(&domain, "isothermd", &digest(&with_c0("893.55")), 0);
    wait_until_kept(&domain);
    service.kill();
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    domain.replace("imu-a.toml", &with_c0("893.56"));
    wait_until("an unsealed table after an unsealed one", || in_force(&domain) == digest(&with_c0("893.56")));
    service.terminate();
}

/// What may lie in the place of a table.
fn damage() -> Vec<(&'static str, Vec<u8>)> {
    let flipped = TABLE.replace("c0 = 793.55", "c0 = 7x3.55");
    vec![
        ("lost digit", lost_digit().into()),
        ("damaged", flipped.into()),
        ("empty", Vec::new()),
        ("zeros", vec![0; 4096]),
        ("huge", b"# \n".repeat(1 << 20)),
        ("of another IMU", TABLE.replace("\"imu-a\"", "\"imu-b\"").into()),
    ]
}

#[test]
fn whatever_lies_in_the_place_of_a_table_that_was_in_force_it_is_served_again() {
    let domain = TestDomain::new();
    domain.serve_recording().terminate();
    let file = domain.path("imu-a.toml");
    for (what, bytes) in damage() {
        fs::write(&file, bytes).unwrap();
        println!("{what}");
        let service = serve_kept(&domain, &digest(TABLE));
        assert!(domain.imu_status()["last_reload_error"].is_string());
        // A good file ends it.
        domain.replace("imu-a.toml", TABLE);
        service.wait_for_log("table file is good again, and the same as in force");
        service.kill();
    }
    for what in ["absent", "a folder", "a pipe"] {
        let _ = fs::remove_file(&file);
        match what {
            "a folder" => fs::create_dir(&file).unwrap(),
            "a pipe" => assert!(Command::new("mkfifo").arg(&file).status().unwrap().success()),
            _ => {}
        }
        serve_kept(&domain, &digest(TABLE)).terminate();
        let _ = fs::remove_dir(&file);
    }
    // Without a table from before it is as at a first start: all faults, and no service.
    fs::remove_dir_all(domain.path(".state")).unwrap();
    domain.run_ok(&["clean"]);
    for (what, bytes) in damage().into_iter().filter(|(what, _)| *what != "lost digit") {
        let _ = fs::remove_file(&file);
        fs::write(&file, bytes).unwrap();
        let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
        assert_eq!(output.status.code(), Some(78), "{what}: {}", text(&output.stderr));
    }
}

#[test]
fn each_imu_is_judged_by_itself() {
    let domain = TestDomain::new();
    let of = |imu: &str, text: &str| text.replace("\"imu-a\"", &format!("\"{imu}\""));
    domain.write("imu-a.toml", TABLE);
    domain.write("imu-b.toml", "format = 1\n");
    let both = ["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=imu-b.toml"];
    // An IMU of which nothing is known is served without a table, together with one that can be served. A first start
    // does so, too.
    let service = domain.serve(&both);
    assert!(service.log().contains("there is no table for this IMU, and the others are served"), "{}", service.log());
    let increment = round_trip(&mut domain.acquisition("imu-b"), &recording()[0]);
    assert!(
        Flags(increment.flags).intersects(Flags::NO_TABLE) && increment.velocity_increment.iter().all(|v| v.is_nan())
    );
    assert_eq!(round_trip(&mut domain.acquisition("imu-a"), &recording()[0]).table, table(TABLE).id());
    // Its table comes later.
    domain.replace("imu-b.toml", &of("imu-b", TABLE));
    wait_until("the table of imu-b", || domain.status()["imus"][1]["table"].is_string());
    service.terminate();
    // Now both are known, and neither needs its file.
    fs::remove_file(domain.path("imu-a.toml")).unwrap();
    domain.write("imu-b.toml", "format = 1\n");
    let service = domain.serve(&both);
    let status = domain.status();
    assert!((0..2).all(|imu| status["imus"][imu]["table"].is_string()), "{status}");
    assert!((0..2).all(|imu| status["imus"][imu]["last_reload_error"].is_string()), "{status}");
    service.terminate();
    // A table from before comes before an IMU without a table.
    let service = domain.serve(&[&["--allow-uncalibrated"], &both[..]].concat());
    assert_eq!(in_force(&domain), digest(TABLE));
    service.terminate();
}

#[test]
fn an_imu_whose_file_is_that_of_another_device_is_served_with_its_own_table() {
    let domain = TestDomain::new();
    let of_unit = |serial: &str, text: &str| text.replacen("[imu]\n", &format!("[imu]\nserial = \"{serial}\"\n"), 1);
    let (first, second) = (of_unit("7", TABLE), of_unit("8", &TABLE.replace("c0 = 793.55", "c0 = 790.0")));
    domain.write("imu-a.toml", &first);
    domain.serve(&["--imu", "imu-a=imu-a.toml"]).terminate();
    domain.write("imu-a.toml", &second);
    domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    let both = ["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=imu-b.toml"];
    let service = domain.serve(&both);
    assert_eq!(in_force(&domain), digest(&first));
    assert!(domain.status()["imus"][1]["table"].is_string(), "the other one is served");
    let words = domain.imu_status()["last_reload_error"].as_str().unwrap().to_owned();
    assert!(words.contains("imu.serial: it was \"7\", now it is \"8\", and the curves change too"), "{words}");
    assert!(words.contains(&format!("`reload --imu imu-a --accept {}`", digest(&second))), "{words}");
    reload(&domain, "isothermd", &digest(&second), 0);
    assert_eq!(in_force(&domain), digest(&second));
    // A number that is corrected changes no curve.
    let corrected = second.replace("\"8\"", "\"8b\"");
    domain.replace("imu-a.toml", &corrected);
    wait_until("the corrected number", || in_force(&domain) == digest(&corrected));
    service.terminate();
}

#[test]
fn many_small_steps_need_an_acceptance_too() {
    let domain = TestDomain::new();
    let raised = |mg0: f64| TABLE.replace("c0 = 793.55", &format!("c0 = {:?}", 793.55 + mg0 * 1e3));
    let service = domain.serve_recording();
    for mg0 in [90.0, 180.0, 270.0] {
        domain.replace("imu-a.toml", &raised(mg0));
        wait_until("the next step", || in_force(&domain) == digest(&raised(mg0)));
    }
    let reason = refuse(&domain, &service, &raised(310.0));
    let anchor = digest(TABLE);
    assert!(
        reason
            .contains(&format!("at most 300 mg0 is taken (max_change.bias), in all steps since the anchor, {anchor}"))
    );
    wait_until_kept(&domain);
    // Over a restart, too.
    service.kill();
    let service = serve_kept(&domain, &digest(&raised(270.0)));
    let status = domain.imu_status();
    assert_eq!(status["anchor"], *anchor);
    let words = domain.run_ok(&["status"]);
    let in_force_now = digest(&raised(270.0));
    assert!(words.contains(&format!("  anchor       {anchor}; changed since then, at most: 269858.")), "{words}");
    assert!(
        words.contains(&format!("`reload --imu imu-a --accept {in_force_now}` makes the table in force the anchor"))
    );
    reload(&domain, "isotherm", &in_force_now, 0);
    assert_eq!(domain.imu_status()["anchor"], *in_force_now);
    assert!(!domain.run_ok(&["status"]).contains("  anchor"));
    domain.replace("imu-a.toml", &raised(311.0));
    wait_until("the step from the new anchor", || in_force(&domain) == digest(&raised(311.0)));
    service.terminate();
}

#[test]
fn a_memory_that_was_taken_away_is_missed() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    wait_until_kept(&domain);
    service.kill();
    let state = domain.path(".state");
    fs::remove_dir_all(&state).unwrap();
    // The same table is known by its digest.
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    assert!(service.log().contains(&format!("the table {} was kept, and is missing now", digest(TABLE))));
    assert!(service.log().contains("the same as before, by its digest"), "{}", service.log());
    wait_until_kept(&domain);
    service.kill();
    // Another one is not taken, however little it differs.
    fs::remove_dir_all(&state).unwrap();
    domain.write("imu-a.toml", &variant(1));
    let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    assert_eq!(output.status.code(), Some(78), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("was kept and cannot be read any more"), "{}", text(&output.stderr));
    reload(&domain, "isothermd", &digest(&variant(1)), 0);
    domain.serve(&["--imu", "imu-a=imu-a.toml"]).terminate();
    // Removing only the kept table is no way round: that IMU has no table until its file is accepted. The others have
    // theirs.
    domain.write("imu-a.toml", &lost_digit());
    domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    let folder = state.join(domain.client_domain().name());
    for anchor in [true, false] {
        fs::remove_file(folder.join("imu-a.toml")).unwrap();
        if !anchor {
            fs::remove_file(folder.join("imu-a.anchor.toml")).unwrap();
        }
        let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=imu-b.toml"]);
        let status = domain.status();
        assert!(status["imus"][0]["table"].is_null() && status["imus"][1]["table"].is_string(), "{status}");
        let increment = round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
        assert!(Flags(increment.flags).intersects(Flags::NO_TABLE) && increment.velocity_increment[0].is_nan());
        let (accepted, next) = if anchor { (lost_digit(), variant(2)) } else { (variant(2), variant(2)) };
        reload(&domain, "isothermd", &digest(&accepted), 0);
        assert_eq!(in_force(&domain), digest(&accepted));
        service.terminate();
        domain.write("imu-a.toml", &next);
    }
}

/// A configuration of these IMUs.
fn configuration(imus: &[&str]) -> String {
    imus.iter().map(|imu| format!("[[imu]]\nid = \"{imu}\"\ntable = \"{imu}.toml\"\n")).collect()
}

#[test]
fn a_configuration_that_is_half_edited_does_not_end_the_service() {
    let domain = TestDomain::new();
    for imu in ["imu-a", "imu-b"] {
        domain.write(&format!("{imu}.toml"), &TABLE.replace("\"imu-a\"", &format!("\"{imu}\"")));
    }
    let whole = configuration(&["imu-a", "imu-b"]);
    let serve = &["serve", "--config", "service.toml"];
    let refused = |text_of_file: &str| {
        domain.write("service.toml", text_of_file);
        let output = domain.run(serve);
        assert_eq!(output.status.code(), Some(78), "{}", text(&output.stderr));
    };
    // None was kept.
    refused("[[imu]]\nid = \"imu-a\"\ntab");
    domain.write("service.toml", &whole);
    let service = domain.serve(&serve[1..]);
    let status = domain.status();
    assert!(status["configuration_file"].as_str().unwrap().ends_with("/service.toml"), "{status}");
    assert!(status["configuration_error"].is_null(), "{status}");
    service.terminate();
    for half in [&whole[..whole.len() - 3], "", "\0\0\0", "\u{1}[[imu", "[wait]\nstrategy = \"sleep\"\n"] {
        domain.write("service.toml", half);
        let service = domain.serve(&serve[1..]);
        service.wait_for_log("the last one that worked is in use: ");
        assert!(service.log().contains(" ERROR "), "{}", service.log());
        let status = domain.status();
        assert_eq!(status["imus"].as_array().unwrap().len(), 2, "{status}");
        assert!(status["configuration_error"].as_str().unwrap().contains("service.toml:"), "{status}");
        assert!(domain.run_ok(&["status"]).contains("REFUSED      the configuration "));
        let (exporter, address) = domain.export();
        wait_until("the metric", || {
            isotherm_tests::metrics_page(&address)
                .is_some_and(|page| page.contains("\nisotherm_configuration_refused 1\n"))
        });
        exporter.kill();
        // What is there is judged.
        assert_eq!(domain.run(&["check", "service.toml"]).status.code(), Some(78));
        let words = reload(&domain, "isotherm", &digest(TABLE), 0);
        assert!(words.contains("the last configuration that worked") && words.contains("service.toml:"), "{words}");
        service.kill();
    }
    // It is kept by the path without links.
    fs::create_dir(domain.path("etc")).unwrap();
    std::os::unix::fs::symlink(domain.path("service.toml"), domain.path("link.toml")).unwrap();
    domain.serve(&["--config", "link.toml"]).terminate();
    // Never for a file that is absent, for another file, with a group, or where the start is to end.
    refused(&format!("[domain]\ngroup = \"imu\"\n{whole}"));
    fs::remove_file(domain.path("service.toml")).unwrap();
    let output = domain.run(serve);
    assert_eq!(output.status.code(), Some(74), "{}", text(&output.stderr));
    domain.write("other.toml", "[[imu");
    assert_eq!(domain.run(&["serve", "--config", "other.toml"]).status.code(), Some(78));
    // Once it is corrected, the next start uses it.
    domain.write("service.toml", &configuration(&["imu-a"]));
    let service = domain.serve(&serve[1..]);
    assert!(domain.status()["configuration_error"].is_null());
    assert_eq!(domain.status()["imus"].as_array().unwrap().len(), 1);
    service.terminate();
    domain.write("service.toml", &format!("{whole}[reload]\nat_start = \"exit\"\n"));
    domain.serve(&serve[1..]).terminate();
    refused("[[imu");
}

#[test]
fn a_memory_of_another_user_is_none() {
    if !rustix::process::geteuid().is_root() {
        skip("only root can be another user", Needs::Machine);
        return;
    }
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    wait_until_kept(&domain);
    service.kill();
    // He was first with the folder, and what lies in it is what he wants to be served.
    let state = domain.path(".state");
    let folder = state.join(domain.client_domain().name());
    fs::write(folder.join("imu-a.toml"), lost_digit()).unwrap();
    for path in [&state, &folder, &folder.join("imu-a.toml")] {
        chown(path, Some(NOBODY), Some(NOBODY)).unwrap();
    }
    domain.write("imu-a.toml", &lost_digit());
    let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    assert_eq!(output.status.code(), Some(78), "{}", text(&output.stderr));
    let words = text(&output.stderr);
    assert!(
        words.contains("belongs to another user (65534)") && words.contains("was kept and cannot be read any more"),
        "{words}"
    );
    // The table that was kept is known by its digest.
    domain.write("imu-a.toml", TABLE);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    assert_eq!(in_force(&domain), digest(TABLE));
    service.terminate();
}

#[test]
fn an_acceptance_is_used_up_when_the_table_is_kept_and_not_before() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    wait_until_kept(&domain);
    // Nothing can be kept any more: a file is in the place of the folder.
    let folder = domain.path(".state").join(domain.client_domain().name());
    let aside = domain.path("aside");
    fs::rename(&folder, &aside).unwrap();
    fs::write(&folder, "").unwrap();
    let bad = digest(&lost_digit());
    refuse(&domain, &service, &lost_digit());
    let words = reload(&domain, "isotherm", &bad, 74);
    assert!(
        words.contains("imu-a: the table is in force, but it is not kept: keeping the table in force as "),
        "{words}"
    );
    let status = domain.imu_status();
    assert_eq!((in_force(&domain), &status["table_kept"]), (bad.clone(), &false.into()));
    assert!(domain.run_ok(&["status"]).contains("  NOT KEPT     keeping the table in force as "));
    // A kill loses nothing: the acceptance is still there.
    service.kill();
    fs::remove_file(&folder).unwrap();
    fs::rename(&aside, &folder).unwrap();
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    assert_eq!(in_force(&domain), bad);
    wait_until_kept(&domain);
    service.kill();
    // Now it is used up, and the way back is refused.
    domain.write("imu-a.toml", TABLE);
    serve_kept(&domain, &bad).terminate();
}

#[test]
fn a_refusal_lasts_as_long_as_the_file_and_an_acceptance_is_for_the_next_table_only() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let bad = digest(&lost_digit());
    refuse(&domain, &service, &lost_digit());
    // SIGHUP loads it again and changes nothing.
    service.signal(Signal::HUP);
    service.wait_for_log_lines("table refused", 2);
    assert_eq!((in_force(&domain), &domain.imu_status()["refused_table"]), (digest(TABLE), &bad.clone().into()));
    // The file that is in force again is good.
    domain.replace("imu-a.toml", TABLE);
    service.wait_for_log("table file is good again");
    assert_eq!(domain.imu_status()["refused_table"], serde_json::Value::Null);
    // A second service is refused before it touches what the first one keeps.
    domain.write("other.toml", &variant(1));
    let output = domain.run(&["serve", "--imu", "imu-a=other.toml"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    service.terminate();
    // Accepted for the next start; but another table is taken then, and the acceptance does not wait for later.
    domain.write("imu-a.toml", &variant(2));
    reload(&domain, "isotherm", &bad, 0);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    wait_until_kept(&domain);
    refuse(&domain, &service, &lost_digit());
    service.terminate();
    // Where the table from before is served, the acceptance waits: no table has been taken.
    fs::remove_file(domain.path("imu-a.toml")).unwrap();
    reload(&domain, "isotherm", &bad, 0);
    let service = domain.serve(&["--allow-uncalibrated", "--imu", "imu-a=imu-a.toml"]);
    wait_until_kept(&domain);
    domain.replace("imu-a.toml", &lost_digit());
    wait_until("the accepted table", || in_force(&domain) == bad);
    wait_until_kept(&domain);
    let reason = refuse(&domain, &service, &variant(3));
    assert!(reason.contains(&format!("in force last, {bad}")), "{reason}");
    reload(&domain, "isotherm", &digest(&variant(3)), 0);
    wait_until("the table", || domain.imu_status()["table"].as_str() == Some(&digest(&variant(3))));
    service.terminate();
}

#[test]
fn what_a_calibration_changes_is_taken_and_told_for_each_curve() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    assert!(service.log().contains("it is not known which table was in force before"));
    assert_eq!(domain.imu_status()["table_changes"], serde_json::json!([]));
    let next = TABLE
        .replace("c0 = 793.55", "c0 = 893.55")
        .replace("91733.0", "91742.0")
        .replace("\"clamp\"", "\"extrapolate\"");
    domain.replace("imu-a.toml", &next);
    wait_until("the next table", || in_force(&domain) == digest(&next));
    let log = service.log();
    let taken = log.lines().find(|line| line.contains("table taken")).unwrap();
    assert!(taken.contains("A1 bias changes by 99.9475 ug0, A1 positive_scale_factor by 99.3"), "{taken}");
    assert!(taken.contains("; in addition: out_of_range clamp -> extrapolate"), "{taken}");
    let status = domain.imu_status();
    let changes = status["table_changes"].as_array().unwrap();
    let names: Vec<_> = changes.iter().map(|change| change["name"].as_str().unwrap()).collect();
    assert_eq!(names.len(), 9, "{names:?}");
    assert_eq!((names[0], &changes[0]["unit"]), ("A1 bias", &"ug0".into()));
    assert!((changes[0]["size"].as_f64().unwrap() - 100.0 * 9.8015 / 9.80665).abs() < 1e-6);
    assert_eq!((&changes[2]["size"], &changes[2]["unit"]), (&0.0.into(), &"ppm".into()));
    assert!(
        domain
            .run_ok(&["status"])
            .contains("  changed      by the table in force, at most: 99.947 ug0 (A1 bias), 99.3")
    );
    // A restart compares with the table that is in force now: the same.
    wait_until_kept(&domain);
    service.kill();
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    assert!(service.log().contains("table loaded: the same as before"), "{}", service.log());
    service.terminate();
}

#[test]
fn limits_are_those_of_the_configuration_and_of_each_imu() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    let config = "[reload]\nmax_change = { bias = \"50ug0\", scale = \"40ppm\" }\n[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n\
                  [[imu]]\nid = \"imu-b\"\ntable = \"imu-b.toml\"\nmax_change = { bias = \"200ug0\" }\n";
    domain.write("service.toml", config);
    domain.run_ok(&["check", "--strict", "service.toml"]);
    // Those of the configuration hold for an IMU of the command line, too.
    let of = |imu: &str, text: &str| text.replace("\"imu-a\"", &format!("\"{imu}\""));
    domain.write("imu-c.toml", &of("imu-c", TABLE));
    let service = domain.serve(&["--config", "service.toml", "--imu", "imu-c=imu-c.toml"]);
    let next = TABLE.replace("c0 = 793.55", "c0 = 893.55");
    let reason = refuse(&domain, &service, &next);
    assert!(
        reason.contains("A1 bias changes by 99.9475 ug0") && reason.contains("at most 0.05 mg0 is taken"),
        "{reason}"
    );
    domain.replace("imu-b.toml", &of("imu-b", &next));
    wait_until("the table of imu-b", || {
        domain.status()["imus"][1]["table"].as_str() == Some(&digest(&of("imu-b", &next)))
    });
    domain.replace("imu-b.toml", &of("imu-b", &next.replace("91733.0", "91738.0")));
    domain.replace("imu-c.toml", &of("imu-c", &next));
    service.wait_for_log_lines("table refused", 3);
    let status = domain.status();
    let reason = |imu: usize| status["imus"][imu]["last_reload_error"].as_str().unwrap();
    assert!(reason(1).contains("at most 0.004 % is taken"), "{status}");
    assert!(reason(2).contains("at most 0.05 mg0 is taken"), "{status}");
    service.terminate();
}

/// The heating of a real IMU, as ArduPilot logs it.
const HEATING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/formats/tests/data/autopilots/heating.BIN");

/// A nominal table from -40 to 85 degC with twice the interval of the log, and the first calibration that `calibrate`
/// makes of the log: their texts.
fn nominal_and_first(domain: &TestDomain) -> [String; 2] {
    domain.run_ok(&["convert", HEATING, "--imu", "imu-a", "-o", "rows.csv", "--nominal", "nominal.toml"]);
    domain.run_ok(&["calibrate", "warm-up", HEATING, "--imu", "imu-a", "-o", "first.toml"]);
    let [nominal, first] = ["nominal.toml", "first.toml"].map(|name| fs::read_to_string(domain.path(name)).unwrap());
    let mut content = table(&nominal).content().clone();
    content.nominal_interval_s = content.nominal_interval_s.map(|interval| 2.0 * interval);
    let gyroscopes = content.gyroscopes.as_mut().unwrap();
    for axis in content.axes.iter_mut().chain(&mut gyroscopes.axes) {
        let wide = |curve: &Polynomial, factor: f64| {
            Polynomial::new(&[curve.coefficients()[0] * factor], 0.0, 1.0, [-40.0, 85.0]).unwrap()
        };
        axis.bias = wide(&axis.bias, 1.0);
        axis.positive_scale_factor = wide(&axis.positive_scale_factor, 0.5);
        axis.negative_scale_factor = wide(&axis.negative_scale_factor, 0.5);
    }
    [CoefficientTable::new(content).unwrap().to_toml(), first]
}

/// The text of a sealed table with another content, and with the provenance that it has.
fn changed(text: &str, change: impl FnOnce(&mut Content)) -> String {
    let mut content = table(text).content().clone();
    change(&mut content);
    let provenance = text.find("[provenance]").map_or("", |at| &text[at..]);
    format!("{}\n{provenance}", CoefficientTable::new(content).unwrap().to_toml())
}

/// Writes a configuration with this `at_start` and more lines of `[reload]`, and returns its name.
fn config(domain: &TestDomain, at_start: &str, more: &str) -> String {
    let name = format!("{at_start}.toml");
    let reload = format!("[reload]\nat_start = \"{at_start}\"\n{more}");
    domain.write(&name, &format!("{reload}[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n"));
    name
}

/// A kept table of imu-a in the state folder, by its ending.
fn kept_file(domain: &TestDomain, ending: &str) -> PathBuf {
    domain.path(".state").join(domain.client_domain().name()).join(format!("imu-a.{ending}"))
}

#[test]
fn the_first_calibration_follows_a_nominal_table_and_becomes_the_anchor() {
    let domain = TestDomain::new();
    let [nominal, first] = nominal_and_first(&domain);
    domain.write("imu-a.toml", &nominal);
    let config = config(&domain, "keep", "");
    let service = domain.serve(&["--config", &config]);
    wait_until_kept(&domain);
    // These gyroscopes are off by up to 4.4 deg/s.
    domain.run_ok(&["check", "--against", "imu-a.toml", "first.toml"]);
    domain.replace("imu-a.toml", &first);
    wait_until("the first calibration", || in_force(&domain) == digest(&first));
    let status = domain.imu_status();
    assert_eq!((&status["anchor"], &status["last_reload_error"]), (&digest(&first).into(), &serde_json::Value::Null));
    assert!(service.log().contains("this is the first calibration after a nominal table"), "{}", service.log());
    wait_until_kept(&domain);
    assert_eq!(digest(&fs::read_to_string(kept_file(&domain, "anchor.toml")).unwrap()), digest(&first));

    // There is no way back, and what follows is compared with the calibration.
    let reason = refuse(&domain, &service, &nominal);
    assert!(reason.contains("imu.nominal_interval_s: "), "{reason}");
    let of_one_interval = changed(&first, |content| {
        let gyroscopes = content.gyroscopes.as_mut().unwrap();
        for axis in content.axes.iter_mut().chain(&mut gyroscopes.axes) {
            axis.bias = Polynomial::new(&[0.0], 0.0, 1.0, axis.bias.range()).unwrap();
        }
    });
    let of_one_interval = of_one_interval.split("[provenance]").next().unwrap();
    let reason = refuse(&domain, &service, of_one_interval);
    assert!(reason.contains("the table before is a calibration and this one is no calibration"), "{reason}");
    let far = changed(&first, |content| {
        let bias = &content.axes[0].bias;
        let mut coefficients = bias.coefficients().to_vec();
        coefficients[0] += 0.15 * 9.80665 / content.axes[0].bias_unit.factor() / content.gravity;
        content.axes[0].bias = Polynomial::new(&coefficients, bias.center(), bias.scale(), bias.range()).unwrap();
    });
    let reason = refuse(&domain, &service, &far);
    assert!(reason.contains("A1 bias changes by 150000 ug0"), "{reason}");
    assert!(reason.contains(&format!("in force last, {}", digest(&first))), "{reason}");

    // So it is over a restart.
    service.kill();
    domain.replace("imu-a.toml", &first);
    let service = domain.serve(&["--config", &config]);
    assert!(service.log().contains("table loaded: the same as before"), "{}", service.log());
    let status = domain.imu_status();
    assert_eq!((in_force(&domain), &status["anchor"]), (digest(&first), &digest(&first).into()));
    let reason = refuse(&domain, &service, &far);
    assert!(reason.contains(&format!("in force last, {}", digest(&first))), "{reason}");
    service.terminate();
}

#[test]
fn a_first_calibration_that_was_installed_while_no_service_ran_is_taken_at_the_start() {
    let domain = TestDomain::new();
    let [nominal, first] = nominal_and_first(&domain);
    let config = config(&domain, "exit", "");
    let kept = ["toml", "anchor.toml"].map(|ending| kept_file(&domain, ending));
    // The state folder has the nominal table in force and as the anchor, or only as one of them.
    for lost in [None, Some(&kept[0]), Some(&kept[1])] {
        domain.write("imu-a.toml", &nominal);
        let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        wait_until_kept(&domain);
        service.terminate();
        if let Some(lost) = lost {
            fs::remove_file(lost).unwrap();
            domain.run_ok(&["clean"]);
        }
        domain.replace("imu-a.toml", &first);
        let service = domain.serve(&["--config", &config]);
        assert_eq!((in_force(&domain), &domain.imu_status()["anchor"]), (digest(&first), &digest(&first).into()));
        wait_until_kept(&domain);
        service.terminate();
        for path in &kept {
            assert_eq!(digest(&fs::read_to_string(path).unwrap()), digest(&first));
        }
        // At the next start it is no first calibration any more.
        domain.replace("imu-a.toml", &nominal);
        assert!(refused_start(&domain).contains("imu.nominal_interval_s: "));
        fs::remove_dir_all(domain.path(".state")).unwrap();
        domain.run_ok(&["clean"]);
    }
}

#[test]
fn a_first_calibration_of_another_unit_is_refused_while_running_and_at_the_start() {
    let domain = TestDomain::new();
    let [nominal, first] = nominal_and_first(&domain);
    let nominal = changed(&nominal, |content| content.serial = Some("17".to_owned()));
    domain.write("imu-a.toml", &nominal);
    let config = config(&domain, "keep", "max_change = { rate = \"5deg/s\" }\n");
    let service = domain.serve(&["--config", &config]);
    wait_until_kept(&domain);
    let constant = |curve: &Polynomial, value: f64| Polynomial::new(&[value], 0.0, 1.0, curve.range()).unwrap();
    // The quantum is twice the other one: the interval was changed, and the scale factors stayed.
    let halved = changed(&first, |content| {
        content.nominal_interval_s = content.nominal_interval_s.map(|interval| interval / 2.0);
    });
    let biased = changed(&first, |content| {
        let axes = &mut content.gyroscopes.as_mut().unwrap().axes;
        let factor = axes[1].bias_unit.factor();
        axes[1].bias = constant(&axes[1].bias, 32_400.0 / factor);
    });
    let other = changed(&first, |content| content.serial = Some("18".to_owned()));
    for (wrong, parts) in [
        (
            &halved,
            [
                "A1 positive_scale_factor changes by 500000 ppm",
                "(nominal_interval_s 0.2) to ",
                "(nominal_interval_s 0.05)",
            ],
        ),
        (
            &biased,
            [
                "G2 bias changes by 32400 deg/h, from 0 to 32400 deg/h",
                "at most 18000 deg/h is taken",
                "max_change.rate",
            ],
        ),
        (&other, ["imu.serial: it was \"17\", now it is \"18\"", "the curves change too", "in force last"]),
    ] {
        let reason = refuse(&domain, &service, wrong);
        let remedy = format!("`reload --imu imu-a --accept {}`", digest(wrong));
        for part in parts.into_iter().chain([&*remedy]) {
            assert!(reason.contains(part), "no {part:?} in {reason}");
        }
        assert_eq!(in_force(&domain), digest(&nominal));
    }
    service.terminate();
    for wrong in [&halved, &other] {
        domain.replace("imu-a.toml", wrong);
        assert!(refused_start(&domain).contains(&format!("--accept {}", digest(wrong))));
    }
    let service = domain.serve(&["--config", &config]);
    assert_eq!(in_force(&domain), digest(&nominal));
    // The right one is still taken.
    domain.replace("imu-a.toml", &first);
    wait_until("the first calibration", || in_force(&domain) == digest(&first));
    service.terminate();
}

#[test]
fn a_calibration_that_is_far_from_a_nominal_table_needs_an_acceptance_and_so_does_the_way_back() {
    let domain = TestDomain::new();
    let constant = |line: &str| match line.find(", c1 = ") {
        Some(end) => format!("{} }}\n", &line[..end]),
        None => format!("{line}\n"),
    };
    let nominal: String = TABLE.lines().map(constant).collect();
    let nominal = nominal.replace("91733.0", "45000.0");
    domain.write("imu-a.toml", &nominal);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    wait_until_kept(&domain);
    // Kept over a restart it is none either.
    service.kill();
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    assert!(service.log().contains("K+ and K- of A1 differ by more than a factor 2"), "{}", service.log());
    let reason = refuse(&domain, &service, TABLE);
    assert!(reason.contains("A1 positive_scale_factor changes by 10"), "{reason}");
    reload(&domain, "isotherm", &digest(TABLE), 0);
    // Nor is there a way round the limits through a nominal table.
    let reason = refuse(&domain, &service, &nominal);
    assert!(reason.contains("the table before is a calibration and this one is no calibration"), "{reason}");
    // With a provenance constant curves are a calibration, and stay one over a restart.
    let calibrated = format!("{nominal}[provenance]\ntool = \"by hand\"\n");
    refuse(&domain, &service, &calibrated);
    reload(&domain, "isotherm", &digest(&calibrated), 0);
    service.terminate();
    domain.replace("imu-a.toml", TABLE);
    assert!(refused_start(&domain).contains("A1 positive_scale_factor changes by"));
}

#[test]
fn another_device_of_temperature_range_policy_or_set_of_sensors_is_refused() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for (next, why) in [
        (
            TABLE.replace("unit = \"V\"", "unit = \"degC\""),
            "temperature.unit: the temperature was in \"V\", now it is in \"degC\"",
        ),
        (TABLE.replacen("range = [0.9, 4.2]", "range = [2.6, 4.2]", 1), "has less than half of the range before"),
        (TABLE.replacen("range = [0.9, 4.2]", "range = [5.0, 6.0]", 1), "has less than half of the range before"),
    ] {
        assert_ne!(next, TABLE);
        let reason = refuse(&domain, &service, &next);
        assert!(reason.contains(why), "{reason}");
    }
    let reason = refuse(&domain, &service, &TABLE.replace("\"clamp\"", "\"reject\""));
    assert!(reason.contains("temperature.out_of_range: it was \"clamp\", now it is \"reject\""), "{reason}");
    // A range that grows or shrinks a little is compared over what both have.
    let range = |range: &str| TABLE.replacen("range = [0.9, 4.2]", range, 1);
    for next in [range("range = [0.9, 4.4]"), range("range = [2.3, 4.2]"), TABLE.to_owned()] {
        domain.replace("imu-a.toml", &next);
        wait_until("the other range", || in_force(&domain) == digest(&next));
    }
    assert!(service.log().contains("; in addition: A1 ranges "), "{}", service.log());
    let whole = WHOLE_TABLE.replace("\"imu-g\"", "\"imu-a\"");
    let reason = refuse(&domain, &service, &whole);
    assert!(reason.contains("this table has gyroscopes, and the one before has none"), "{reason}");
    reload(&domain, "isotherm", &digest(&whole), 0);
    let log = service.log();
    assert!(log.contains("gyroscopes none -> yes") && log.contains("lag none -> 240"), "{log}");
    assert!(refuse(&domain, &service, TABLE).contains("the table before has gyroscopes, and this one has none"));
    service.terminate();
}

#[test]
fn what_cannot_be_kept_or_read_is_told_and_the_service_runs() {
    let domain = TestDomain::new();
    let state = |value: &str| {
        domain.write("imu-a.toml", TABLE);
        let mut command = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
        command.env("ISOTHERM_STATE", value);
        let service = domain.start(command);
        service.wait_for_log("ready");
        service
    };
    let service = state("/proc/none");
    service.wait_for_log("keeping the table in force as /proc/none/");
    service.terminate();
    // In memory it is lost with the machine.
    let memory = format!("/dev/shm/{}state", domain.client_domain().prefix());
    let service = state(&memory);
    service.wait_for_log(" is in memory; name another folder in ISOTHERM_STATE");
    service.terminate();
    fs::remove_dir_all(&memory).unwrap();
    // A folder that others may write is not believed; a damaged file is reported.
    let folder = domain.path("state").display().to_string();
    domain.run_ok(&["clean"]);
    let service = state(&folder);
    wait_until_kept(&domain);
    assert!(!service.log().contains("WARN"), "{}", service.log());
    service.terminate();
    let inner = format!("{folder}/{}", domain.client_domain().name());
    let kept = format!("{inner}/imu-a.toml");
    assert_eq!(digest(&fs::read_to_string(&kept).unwrap()), digest(TABLE));
    fs::set_permissions(&inner, fs::Permissions::from_mode(0o777)).unwrap();
    let service = state(&folder);
    assert!(service.log().contains("cannot be read: ") && service.log().contains(" can be written by others"));
    assert!(service.log().contains("the same as before, by its digest"), "{}", service.log());
    service.wait_for_log(" can be written by others; the next start compares with an older one");
    service.terminate();
    fs::set_permissions(&inner, fs::Permissions::from_mode(0o700)).unwrap();
    fs::write(&kept, "format = 1\n").unwrap();
    let service = state(&folder);
    assert!(service.log().contains("the table that was in force last cannot be read: "), "{}", service.log());
    wait_until_kept(&domain);
    service.terminate();
    // The next start compares again.
    assert_eq!(digest(&fs::read_to_string(&kept).unwrap()), digest(TABLE));
}

#[test]
fn check_compares_with_a_table_as_the_service_does() {
    let domain = TestDomain::new();
    domain.write("old.toml", TABLE);
    domain.write("new.toml", &TABLE.replace("c0 = 793.55", "c0 = 893.55"));
    domain.write("bad.toml", &lost_digit());
    let words = domain.run_ok(&["check", "--against", "old.toml", "new.toml", "old.toml"]);
    assert!(words.contains("not sealed\n  A1 bias changes by 99.9475 ug0\nold.toml: "), "{words}");
    assert!(words.ends_with("not sealed\n  no curve changes\n"), "{words}");
    let output = domain.run(&["check", "--against", "old.toml", "bad.toml"]);
    assert_eq!(output.status.code(), Some(78));
    assert!(text(&output.stderr).contains("bad.toml: A1 positive_scale_factor changes by 911470 ppm, from 90578.9"));
    // By itself it is valid, with a warning.
    let output = domain.run(&["check", "bad.toml"]);
    let warning =
        "bad.toml: warning: K+ and K- of A1 differ by more than a factor 2: 8282.47 and -90717.9 pulse/(s*g0)";
    assert!(output.status.success() && text(&output.stderr).contains(warning), "{}", text(&output.stderr));
    assert_eq!(domain.run(&["check", "--strict", "bad.toml"]).status.code(), Some(78));
    // Refused, a table is not sealed either.
    let output = domain.run(&["check", "--seal", "--against", "old.toml", "bad.toml"]);
    assert_eq!(output.status.code(), Some(78));
    assert_eq!(fs::read_to_string(domain.path("bad.toml")).unwrap(), lost_digit());
    // A nominal table is a reference for its quantum, and a table of another IMU is none.
    let constant = |line: &str| line.find(", c1 = ").map_or(line.to_owned(), |end| format!("{} }}", &line[..end]));
    let nominal: Vec<_> = TABLE.lines().map(constant).collect();
    domain.write("nominal.toml", &nominal.join("\n").replace("91733.0", "60000.0"));
    let output = domain.run(&["check", "--against", "nominal.toml", "old.toml"]);
    assert_eq!(output.status.code(), Some(78));
    assert!(text(&output.stderr).contains("A1 positive_scale_factor changes by "), "{}", text(&output.stderr));
    domain.write("other.toml", &TABLE.replace("imu-a", "imu-b"));
    let output = domain.run(&["check", "--against", "old.toml", "other.toml"]);
    assert!(text(&output.stderr).contains("imu.id: the table before is of imu-a, this one of imu-b"));
    domain.write("service.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"old.toml\"\n");
    let output = domain.run(&["check", "--against", "old.toml", "service.toml"]);
    assert!(text(&output.stderr).contains("only tables are compared"), "{}", text(&output.stderr));
}
