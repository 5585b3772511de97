//! A megabyte of anything in the place of the table: it is refused, the watchdog is fed, and the service starts with
//! the kept table.

use super::supervisor::{Supervisor, WATCHDOG};
use super::{Ground, digest, try_all};
use crate::texts::generators;
use isotherm_shared::table::MAX_TABLE_BYTES;
use isotherm_tests::{TABLE, TIMEOUT, wait_until};
use std::fs;
use std::time::{Duration, Instant};

type Text = (String, Vec<u8>);

/// A megabyte of each kind, and its beginning, which is no larger than a table may be.
fn texts() -> Vec<Text> {
    let sizes = |(kind, bytes): (&str, Vec<u8>)| {
        let begin = bytes[..MAX_TABLE_BYTES as usize].to_vec();
        [(format!("1 MiB of {kind}"), bytes), (format!("128 KiB of {kind}"), begin)]
    };
    generators().into_iter().flat_map(sizes).collect()
}

/// Replaces the table by the text, and renames so that the service sees a whole file.
fn replace(ground: &Ground, text: &[u8]) {
    fs::write(ground.domain.path("new"), text).unwrap();
    fs::rename(ground.domain.path("new"), ground.domain.path("imu-a.toml")).unwrap();
}

/// Puts one text after the other over the table that is in force. Returns the longest time without a feed of the
/// watchdog.
fn replace_by_all(texts: &[Text]) -> Duration {
    let ground = Ground::new();
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    let service = ground.domain.start(ground.serve(&supervisor));
    let ready = supervisor.wait_for("READY=1", TIMEOUT).unwrap();
    let is_refused = || !ground.domain.imu_status()["last_reload_error"].is_null();
    let mut slowest = (Duration::ZERO, "");
    for (kind, bytes) in texts {
        let begun = Instant::now();
        replace(&ground, bytes);
        wait_until(kind, is_refused);
        slowest = slowest.max((begun.elapsed(), kind));
        replace(&ground, TABLE.as_bytes());
        wait_until("the table", || !is_refused());
    }
    assert_eq!(ground.domain.imu_status()["table"], digest(TABLE));
    assert!(supervisor.is_fed(Instant::now(), 1, TIMEOUT), "{}", service.log());
    let asked = Instant::now();
    let gap = supervisor.largest_gap(ready, asked);
    service.terminate();
    println!(
        "{} texts over the table in force: all refused, at most {:.2} s after the rename ({}); largest gap {:.2} s, \
         SIGTERM {:.2} s",
        texts.len(),
        slowest.0.as_secs_f64(),
        slowest.1,
        gap.as_secs_f64(),
        asked.elapsed().as_secs_f64()
    );
    gap
}

/// Starts with the text in the place of the table. Returns when the service was ready, and when it had ended.
fn start_with((kind, bytes): &Text) -> (Duration, Duration) {
    let ground = Ground::new();
    replace(&ground, bytes);
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    let begun = Instant::now();
    let service = ground.domain.start(ground.serve(&supervisor));
    assert!(supervisor.wait_for("READY=1", TIMEOUT).is_some(), "{kind}:\n{}", service.log());
    let ready = begun.elapsed();
    let status = ground.domain.imu_status();
    assert!(status["table"] == digest(TABLE) && !status["last_reload_error"].is_null(), "{kind}: {status}");
    let asked = Instant::now();
    service.terminate();
    (ready, asked.elapsed())
}

fn start_with_all(texts: &[Text]) {
    let outcomes = try_all(texts, start_with);
    let [ready, ended] = [0, 1].map(|which| outcomes.iter().map(|it| if which == 0 { it.0 } else { it.1 }).max());
    println!(
        "{} starts with a text in the place of the table: all with the kept table; ready after at most {:.2} s, SIGTERM \
         {:.2} s",
        outcomes.len(),
        ready.unwrap().as_secs_f64(),
        ended.unwrap().as_secs_f64()
    );
}

#[test]
fn a_text_in_the_place_of_the_table_stops_neither_service_nor_start() {
    let share: Vec<_> = texts().into_iter().step_by(11).collect();
    replace_by_all(&share);
    start_with_all(&share);
}

#[test]
#[ignore = "a minute: cargo test -p isotherm-tests --test all faults -- --ignored --nocapture"]
fn no_text_in_the_place_of_the_table_stops_service_or_start() {
    let gap = replace_by_all(&texts());
    // Half of what the unit file allows. This is for a machine that does nothing else.
    assert!(gap < WATCHDOG / 2, "{gap:?} without a feed");
    start_with_all(&texts());
}
