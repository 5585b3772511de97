//! Another user who knows a name before its object is there, and makes the object first.

use super::tracer::{Call, End, Fate, Traced};
use super::{Ground, may_trace};
use isotherm_tests::{Needs, RUN, TIMEOUT, skip};
use std::fs::{self, File};
use std::os::unix::fs::chown;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

const NOBODY: u32 = 65_534;

#[test]
fn an_acquisition_whose_connections_another_user_makes_joins_again() {
    if !rustix::process::geteuid().is_root() {
        skip("only root can be another user", Needs::Machine);
        return;
    }
    if !may_trace() {
        return;
    }
    let ground = Ground::new();
    let service = ground.domain.serve(&["--config", "service.toml"]);
    let taken = Arc::<AtomicUsize>::default();
    let count = Arc::clone(&taken);
    // The other user is first with the names of the first connections.
    let take = move |call: &Call| {
        let is_new = call.name == "open" && call.path.ends_with(".connection") && !fs::exists(&call.path).unwrap();
        if is_new && call.changes && count.load(Ordering::Relaxed) < 2 {
            File::create(&call.path).unwrap();
            chown(&call.path, Some(NOBODY), Some(NOBODY)).unwrap();
            count.fetch_add(1, Ordering::Relaxed);
        }
        Fate::Happens
    };
    let feed = ground.domain.isotherm(&["feed", "--imu", "imu-a", RUN, "-o", "fed.csv", "--timeout", "20"]);
    let mut feed = Traced::start(feed, take);
    ground.domain.register_process(feed.pid);
    let end = feed.end(2 * TIMEOUT);
    assert_eq!(end, Some(End::Exited(0)), "{}", feed.log());
    assert!(taken.load(Ordering::Relaxed) > 0);
    let log = feed.log();
    assert!(log.contains("warning: IMU imu-a: cut off from the service: another user has made /dev/shm/"), "{log}");
    let replayed = ground.domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
    assert!(fs::read_to_string(ground.domain.path("fed.csv")).unwrap() == replayed);
    service.terminate();
}
