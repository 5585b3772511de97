//! `isothermd`, the program for a vehicle: its commands behave as those of `isotherm`.

use iceoryx2::config::Config;
use iceoryx2::node::NodeBuilder;
use iceoryx2::prelude::{CallbackProgression, FilePath, SemanticString as _, Service as _, ipc};
use isotherm_client::transport::stream::status_name;
use isotherm_tests::{RUN, TABLE, TestDomain, recording, round_trip, text, wait_until};
use serde_json::Value;

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
    // From then on the status has the same words, whenever it is asked for.
    wait_until("a second without samples", || {
        domain.run_ok(&["status"]).contains(" in the last second, the last sample ")
    });
    domain.write("bad.toml", &TABLE.replace("gravity_reference", "gravity"));
    // Both recognise the same kinds of files.
    domain.write("unknown.toml", "key = 1\n");
    domain.write("plan.toml", "limits = 3\n[[imu]]\n");
    domain.write("campaign.toml", "samples = \"campaign.csv\"\nformat = 1\n");
    for arguments in [
        &["status"][..],
        &["status", "--iceoryx2"],
        &["check", "imu-a.toml"],
        &["check", "bad.toml"],
        &["check", "nothing.toml"],
        &["check", "unknown.toml"],
        &["check", "--seal", "plan.toml"],
        &["check", "--seal", "campaign.toml"],
        &["serve", "--imu", "imu-b=bad.toml"],
        &["serve", "--config", "nothing.toml"],
        &["serve", "--help"],
        &["status", "--help"],
        &["check", "--help"],
    ] {
        let [daemon, isotherm] = ["isothermd", "isotherm"].map(|program| {
            let output = domain.finish(domain.program(program, arguments));
            // Only the program's name may differ, and in `status` the uptime and the figures of the last second.
            let said = [output.stdout, output.stderr].map(|printed| text(&printed).replace("isothermd", "isotherm"));
            // … and the latencies, which have no samples once they are old.
            let is_of_now =
                |line: &&str| line.contains(", up ") || [" second ", " minute "].iter().any(|it| line.contains(it));
            // The switches of messages are those of only `isotherm`.
            let printed = said.map(|printed| without_switches(&printed));
            let lines = printed.iter().flat_map(|printed| printed.lines()).filter(|line| !is_of_now(line));
            let is_figure = |word: &str| arguments[0] == "status" && word.parse::<f64>().is_ok();
            let words = lines.flat_map(str::split_whitespace).map(|word| if is_figure(word) { "figure" } else { word });
            let words: Vec<_> = words.map(str::to_owned).collect();
            (output.status.code(), words)
        });
        assert_eq!(daemon, isotherm, "{arguments:?}");
        assert!(!daemon.1.is_empty(), "{arguments:?}");
    }
    service.terminate();
}

/// The help without the options `--quiet` and `--verbose`.
fn without_switches(printed: &str) -> String {
    let mut is_switch = false;
    let kept = printed.lines().filter(|line| {
        let begins = line.trim_start().starts_with('-');
        is_switch = if begins { line.contains("--quiet") || line.contains("--verbose") } else { is_switch };
        !is_switch
    });
    kept.map(|line| format!("{line}\n")).collect()
}

/// As the program `iox2` does: with iceoryx2's own type of service, and nothing of the client library.
#[test]
fn iceoryx2_joins_a_running_domain_with_the_configuration_that_status_prints() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let file = domain.write("iceoryx2.toml", &domain.run_ok(&["status", "--iceoryx2"]));
    let config = Config::from_file(&FilePath::new(file.as_os_str().as_encoded_bytes()).unwrap()).unwrap();

    let mut names = Vec::new();
    ipc::Service::list(&config, |found| {
        names.push(found.static_details.name().to_string());
        CallbackProgression::Continue
    })
    .unwrap();
    names.sort_unstable();
    let rehearsals: Vec<_> = names.extract_if(.., |name| name.contains("/rehearsal/")).collect();
    let of_imu = ["arrival", "increment", "raw", "wake"].map(|stream| format!("isotherm/imu-a/{stream}"));
    assert_eq!(names, [&of_imu[..], &["isotherm/status".to_owned()]].concat());
    assert_eq!(rehearsals.len(), 2, "those of the worker: {rehearsals:?}");

    let node = NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap();
    let stream = node.service_builder(&status_name()).publish_subscribe::<[u8]>().open().unwrap();
    let subscriber = stream.subscriber_builder().create().unwrap();
    let mut status = Value::Null;
    wait_until("a status", || {
        let sample = subscriber.receive().unwrap();
        sample.is_some_and(|sample| {
            status = serde_json::from_slice(&sample).unwrap();
            true
        })
    });
    assert_eq!((&status["pid"], &status["imus"][0]["id"]), (&Value::from(service.pid()), &Value::from("imu-a")));
    drop((subscriber, stream, node));
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
