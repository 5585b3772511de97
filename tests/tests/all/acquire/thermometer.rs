//! A thermometer that dies while its IMU goes on, and comes back: on a serial line, through the service, and offline.

use super::endings::Terminal;
use super::pipeline::{end, kept, read, received, replayed};
use super::{Acquire, counts, line, recorded};
use isotherm_client::Flags;
use isotherm_tests::{TestDomain, wait_until};
use std::fs;
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

const INTERVAL: Duration = Duration::from_millis(10);
/// What the device does.
const NEVER: u8 = 0;
const ALIVE: u8 = 1;
const DEAD: u8 = 2;
const OFF: u8 = 3;

/// Sends a line every interval until it is switched off.
fn device(terminal: &Terminal, does: &AtomicU8) {
    let begun = Instant::now();
    for number in 0_u32.. {
        let temperature = match does.load(Ordering::Relaxed) {
            ALIVE => "25.5",
            OFF => return,
            _ => "nan",
        };
        terminal.write_all(format!("{number},0.125,-0.25,9.75,{temperature}\n").as_bytes());
        sleep((begun + INTERVAL * (number + 1)).saturating_duration_since(Instant::now()));
    }
}

fn describe(domain: &TestDomain) {
    let line = line(domain).display().to_string();
    let text = format!(
        "format = 1\nimu = \"imu-a\"\n[source]\nkind = \"lines\"\nserial = \"{line}\"\nbaud = 115200\n[timing]\n\
         interval_s = 0.01\ncounter = {{ column = \"number\", bits = 32 }}\n[lines]\n\
         names = [\"number\", \"ax\", \"ay\", \"az\", \"temperature\"]\n[accelerometer]\ncolumns = [\"ax\", \"ay\", \"az\"]\n\
         kind = \"reading\"\nresolution = 1e-6\n[temperature]\ncolumns = \"temperature\"\ntemperature_max_age_s = 0.5\n"
    );
    domain.write("source.toml", &text);
}

#[test]
fn a_thermometer_that_dies_is_seen_live_and_offline_until_it_is_back() {
    let domain = TestDomain::new();
    let terminal = Terminal::new(&domain);
    describe(&domain);
    domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let reader = read(&domain, "read.csv");
    let others = ["raw.csv", "raw.mcap"].map(|name| {
        let reader = domain.spawn(&["record", "--imu", "imu-a", "--stream", "raw", "--flush", "0.1", "-o", name]);
        reader.wait_for_log("recording imu-a");
        reader
    });
    let does = AtomicU8::new(NEVER);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
    acquire.process.wait_for_log("reading");
    let tally = scope(|threads| {
        threads.spawn(|| device(&terminal, &does));
        acquire.process.wait_for_log("no temperature of temperature has come for 10 s");
        assert_eq!(received(&domain), 0);

        does.store(ALIVE, Ordering::Relaxed);
        wait_until("samples", || received(&domain) > 100);
        let status = domain.imu_status();
        assert_eq!((&status["temperature_stale"], &status["flagged"]["telemetry-stale"]), (&false.into(), &0.into()));
        assert!(domain.run_ok(&["status"]).contains("  temperature  read 0.0 s before the last sample"));

        does.store(DEAD, Ordering::Relaxed);
        wait_until("a stale temperature", || domain.imu_status()["temperature_stale"] == true);
        assert!(domain.imu_status()["temperature_age_s"].as_f64() > Some(0.5));
        assert!(domain.run_ok(&["status"]).contains("  STALE        the temperature was read "));
        acquire.process.wait_for_log("stale after 0.5 s");
        assert!(acquire.process.log().contains("temperature_max_age_s"), "{}", acquire.process.log());

        does.store(ALIVE, Ordering::Relaxed);
        wait_until("a temperature", || domain.imu_status()["temperature_stale"] == false);
        acquire.process.wait_for_log("the temperature has come again");
        let tally = acquire.end();
        does.store(OFF, Ordering::Relaxed);
        tally
    });
    end(reader);
    others.into_iter().for_each(end);

    let samples = recorded(&domain, "acquired.csv");
    let stale = samples.iter().filter(|raw| raw.is_marked_stale()).count();
    assert!(stale > 0 && stale < samples.len());
    assert_eq!(
        counts(&tally, ["stale", "service/answered"]),
        [stale, samples.len()].map(|count| count as u64),
        "{tally}"
    );
    for raw in &samples {
        assert_eq!(raw.is_marked_stale(), raw.temperature_age_s() > 0.5, "{raw:?}");
        assert!(raw.accelerometers.positive_pulses[2] > 97_000, "it is computed: {raw:?}");
    }
    // What was answered, what the recording replays to, and what a service makes of the recording.
    let exact = replayed(&domain, &samples, "acquired.csv");
    assert!(kept(&domain, "read.increments.csv") == exact);
    for name in ["acquired.csv", "raw.csv", "raw.mcap"] {
        let replay = domain.run_ok(&["replay", "--table", "imu-a.toml", name]);
        let flagged = Flags::TELEMETRY_STALE.to_string();
        assert_eq!(replay.lines().filter(|row| row.contains(&flagged)).count(), stale, "{name}");
        domain.run_ok(&["feed", "--imu", "imu-a", name, "--rate", "1000", "-o", "fed.csv"]);
        assert_eq!(fs::read_to_string(domain.path("fed.csv")).unwrap(), replay, "{name}");
    }
    service.terminate();
}
