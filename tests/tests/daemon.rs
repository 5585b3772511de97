//! `isothermd`, the program for a vehicle: its commands behave as those of `isotherm`.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_tests::{RUN, TABLE, TestDomain, recording, round_trip, text};

#[test]
fn serve_check_and_status_are_those_of_isotherm() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let service = domain.start(domain.program("isothermd", &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    let mut acquisition = domain.acquisition("imu-a");
    round_trip(&mut acquisition, &recording()[0]);
    drop(acquisition);
    let replayed = domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
    assert_eq!(domain.run_ok(&["feed", "--imu", "imu-a", RUN]), replayed);
    domain.write("bad.toml", &TABLE.replace("gravity_reference", "gravity"));
    for arguments in [
        &["status"][..],
        &["status", "--iceoryx2"],
        &["check", "imu-a.toml"],
        &["check", "bad.toml"],
        &["check", "nothing.toml"],
        &["serve", "--imu", "imu-b=bad.toml"],
        &["serve", "--config", "nothing.toml"],
        &["serve", "--help"],
        &["status", "--help"],
        &["check", "--help"],
    ] {
        let [daemon, isotherm] = ["isothermd", "isotherm"].map(|program| {
            let output = domain.finish(domain.program(program, arguments));
            // Only the program's name and the uptime in `status` may differ.
            let said = [output.stdout, output.stderr].map(|printed| text(&printed).replace("isothermd", "isotherm"));
            let lines = said.iter().flat_map(|printed| printed.lines()).filter(|line| !line.contains(", up "));
            let words: Vec<_> = lines.flat_map(str::split_whitespace).map(str::to_owned).collect();
            (output.status.code(), words)
        });
        assert_eq!(daemon, isotherm, "{arguments:?}");
        assert!(!daemon.1.is_empty(), "{arguments:?}");
    }
    service.terminate();
}

/// A new user's first status often shows late increments, so it explains them.
#[test]
fn status_explains_late_increments() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let config = "[latency]\nbudget_us = 0.001\n[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n";
    domain.write("service.toml", config);
    let service = domain.serve(&["--config", "service.toml"]);
    assert!(!domain.run_ok(&["status"]).contains("late:"), "nothing was late so far");
    domain.run_ok(&["feed", "--imu", "imu-a", RUN]);
    let status = domain.run_ok(&["status"]);
    assert!(status.contains("flagged      late 4000"), "{status}");
    assert!(
        status.contains("late: the increment is right, but it took longer than the budget of 0.001 us"),
        "{status}"
    );
    service.terminate();
}
