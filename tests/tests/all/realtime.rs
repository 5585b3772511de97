//! Workers, cores, priorities and locked memory: settings take effect, or the service refuses them and names the
//! remedy.

use isotherm_client::{Acquisition, Flags, Realtime, SendError};
use isotherm_shared::compensate::answer;
use isotherm_tests::{Needs, TABLE, TestDomain, id, recording, round_trip, same, skip, table, text, wait_until};
use std::process::{Command, Stdio};
use std::thread;

fn write_config(domain: &TestDomain, keys_of_the_imu: &str, sections: &str) -> String {
    domain.write("imu-a.toml", TABLE);
    let imu = format!("[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n{keys_of_the_imu}");
    domain.write("service.toml", &format!("{imu}{sections}")).display().to_string()
}

#[test]
fn imus_are_spread_over_workers_and_each_is_served_exactly() {
    let domain = TestDomain::new();
    let mut config = String::new();
    for (index, name) in ["imu-a", "imu-b", "imu-c"].into_iter().enumerate() {
        domain.write(&format!("{name}.toml"), &TABLE.replace("\"imu-a\"", &format!("\"{name}\"")));
        config += &format!("[[imu]]\nid = \"{name}\"\ntable = \"{name}.toml\"\nworker = {}\n", index % 2);
    }
    domain.write("service.toml", &config);
    let service = domain.serve(&["--config", "service.toml"]);
    let table = table(TABLE);
    let mut acquisitions = ["imu-a", "imu-b", "imu-c"].map(|name| domain.acquisition(name));
    for sample in recording().iter().take(200) {
        for acquisition in &mut acquisitions {
            let increment = round_trip(acquisition, sample);
            assert_eq!(increment.velocity_increment, answer(Some(&table), sample).velocity_increment);
        }
    }
    let status = domain.status();
    let imus = |worker: usize| status["workers"][worker]["imus"].clone();
    assert_eq!((imus(0), imus(1)), (serde_json::json!(["imu-a", "imu-c"]), serde_json::json!(["imu-b"])));
    for imu in status["imus"].as_array().unwrap() {
        assert_eq!(imu["compensated"], 200);
    }
    service.terminate();
}

#[test]
fn a_short_queue_hands_the_next_sample_back_and_loses_nothing() {
    let domain = TestDomain::new();
    let config = write_config(&domain, "depth = 3\n", "");
    let service = domain.serve(&["--config", &config]);
    let mut acquisition = domain.acquisition("imu-a");
    assert_eq!(acquisition.depth(), 3);
    service.stop();
    let samples: Vec<_> = recording().into_iter().take(4).collect();
    let send = |acquisition: &mut Acquisition, index: usize| {
        let mut loan = acquisition.loan().unwrap();
        let (session, sequence) = (loan.session, loan.sequence);
        *loan = isotherm_client::RawSample { session, sequence, ..samples[index] };
        acquisition.send(loan)
    };
    for index in 0..3 {
        send(&mut acquisition, index).unwrap();
    }
    assert!(matches!(send(&mut acquisition, 3), Err(SendError::Full(_))));
    service.resume();
    let mut answers = Vec::new();
    wait_until("three answers", || {
        answers.extend(acquisition.receive().unwrap());
        answers.len() == 3
    });
    let table = table(TABLE);
    for (increment, sample) in answers.iter().zip(&samples) {
        let (session, sequence) = (increment.session, increment.sequence);
        let sample = isotherm_client::RawSample { session, sequence, ..*sample };
        assert!(same(increment, &answer(Some(&table), &sample)));
    }
    assert_eq!(domain.imu_status()["missing"], 0);
    service.terminate();
}

#[test]
fn an_answer_over_the_budget_is_flagged_and_counted() {
    // Every answer takes longer than 1 ns and less than 1 s.
    for (budget_us, late) in [(0.001, 20), (1e6, 0)] {
        let domain = TestDomain::new();
        let config = write_config(&domain, "", &format!("[latency]\nbudget_us = {budget_us}\n"));
        let service = domain.serve(&["--config", &config]);
        let mut acquisition = domain.acquisition("imu-a");
        for sample in recording().iter().take(20) {
            let increment = round_trip(&mut acquisition, sample);
            assert_eq!(Flags(increment.flags).intersects(Flags::LATE), late > 0);
        }
        assert_eq!(domain.imu_status()["flagged"]["late"], late);
        service.terminate();
    }
}

#[test]
fn the_status_has_latencies_of_the_last_second_and_minute() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    round_trip(&mut acquisition, &recording()[0]);
    wait_until("the statistics of the second with the sample", || {
        domain.imu_status()["latency_second_ns"]["count"] == 1
    });
    wait_until("the statistics of the next second", || domain.imu_status()["latency_second_ns"].is_null());
    let status = domain.imu_status();
    assert_eq!((&status["latency_minute_ns"]["count"], &status["latency_ns"]["count"]), (&1.into(), &1.into()));
    let max = |window: &str| status[window]["max"].as_u64().unwrap();
    assert_eq!(max("latency_minute_ns"), max("latency_ns"));
    service.terminate();
}

/// Whether this process may set a real-time priority.
fn may_be_real_time() -> bool {
    let settings = Realtime { priority: Some(1), ..Realtime::default() };
    thread::spawn(move || settings.apply()).join().unwrap().is_ok()
}

#[test]
fn settings_that_are_granted_are_in_force() {
    if !may_be_real_time() {
        skip("this user may not have real-time priorities", Needs::Machine);
        return;
    }
    let domain = TestDomain::new();
    let settings = "[realtime]\ncore = 0\npriority = 7\nlock_memory = true\ntimer_slack_ns = 2000\n";
    let config = write_config(&domain, "", settings);
    let service = domain.serve(&["--config", &config]);
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    let status = domain.status();
    let worker = &status["workers"][0];
    assert_eq!((&worker["cores"], &worker["priority"]), (&"0".into(), &7.into()), "{worker}");
    assert!(status["memory_locked_kb"].as_u64().unwrap() > 1000, "{}", status["memory_locked_kb"]);
    service.terminate();
}

#[test]
fn spinning_at_a_real_time_priority_is_warned_about_and_its_effect_is_logged() {
    if !may_be_real_time() {
        skip("this user may not have real-time priorities", Needs::Machine);
        return;
    }
    let domain = TestDomain::new();
    let config = write_config(&domain, "", "[wait]\nstrategy = \"spin\"\n[realtime]\ncore = 0\npriority = 1\n");
    let service = domain.serve(&["--config", &config]);
    service.wait_for_log("it stops a worker for some 50 ms of every second");
    // With the kernel's limit switched off there is no effect; otherwise the service reports it within seconds.
    if std::fs::read_to_string("/proc/sys/kernel/sched_rt_runtime_us").is_ok_and(|limit| limit.trim() != "-1") {
        // Some kernels enforce the limit only while another process needs the core.
        let mut neighbour =
            Command::new("sh").args(["-c", "taskset -p -c 0 $$ > /dev/null; while :; do :; done"]).spawn().unwrap();
        domain.register_process(neighbour.id());
        service.wait_for_log("held back for");
        neighbour.kill().unwrap();
        neighbour.wait().unwrap();
    }
    service.terminate();
}

#[test]
fn settings_that_are_not_granted_are_refused_with_the_remedy() {
    let cases = [
        ("core = 1023", vec!["realtime.core: binding to core 1023", "this process may use cores"]),
        ("priority = 60", vec!["realtime.priority: SCHED_FIFO 60", "CAP_SYS_NICE", "ulimit -r", "LimitRTPRIO=60"]),
        ("lock_memory = true", vec!["realtime.lock_memory", "CAP_IPC_LOCK", "ulimit -l", "LimitMEMLOCK=infinity"]),
    ];
    for (setting, words) in cases {
        let domain = TestDomain::new();
        let config = write_config(&domain, "", &format!("[realtime]\n{setting}\n"));
        let isotherm = isotherm_tests::binary("isotherm");
        let output = Command::new(env!("CARGO_BIN_EXE_counted"))
            .arg("without-rights")
            .arg(isotherm)
            .args(["serve", "--config", &config])
            .env("ISOTHERM_DOMAIN", domain.client_domain().name())
            .env("ISOTHERM_ROOT", domain.path(""))
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(78), "{message}");
        for word in words {
            assert!(message.contains(word), "{word:?} is not in: {message}");
        }
    }
    // A refused start leaves nothing behind: the next service starts.
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    assert_eq!(domain.acquisition("imu-a").imu(), &id("imu-a"));
    service.terminate();
}
