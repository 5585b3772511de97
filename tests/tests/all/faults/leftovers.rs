//! What dead processes have left, with one word changed: READY at the second start at the latest.

use super::supervisor::Supervisor;
use super::{Ground, try_all};
use fastrand::Rng;
use isotherm_tests::{Process, RUN, TIMEOUT, wait_until};
use std::fs::{self, File};
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What came of the start that found the changed word.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum First {
    Ready,
    /// It ended, as a supervisor names it.
    Ended,
}

struct Outcome {
    /// Object and word.
    place: String,
    first: First,
    /// Until READY, both starts together.
    ready_after: Duration,
}

/// Kills a service with an acquisition and a recorder.
fn leave_objects(ground: &Ground) {
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    let service = ground.domain.start(ground.serve(&supervisor));
    supervisor.wait_for("READY=1", TIMEOUT).unwrap();
    let acquisition = ground.domain.spawn(&["feed", "--imu", "imu-a", RUN, "--rate", "100"]);
    let recorder = ground.domain.spawn(&["record", "--imu", "imu-a", "-o", "recorded.csv"]);
    let served = || ground.domain.imu_status();
    wait_until("samples and a recorder", || {
        served()["received"].as_u64() > Some(3) && served()["readers"].as_u64() > Some(1)
    });
    // Otherwise the next start clears the domain, whatever lies there.
    wait_until("a second of life", || !ground.is_in_its_first_second());
    [service, acquisition, recorder].into_iter().for_each(Process::kill);
}

/// The objects that are left, the small ones of the domain's folder included.
fn objects(ground: &Ground) -> Vec<PathBuf> {
    let domain = ground.domain.client_domain();
    let folders = ["/dev/shm", domain.root_path()];
    let files = folders.into_iter().flat_map(|folder| fs::read_dir(folder).unwrap().flatten());
    let own = files.filter(|file| file.file_name().to_string_lossy().starts_with(&domain.prefix()));
    let mut objects: Vec<_> = own.map(|file| file.path()).filter(|path| path.is_file()).collect();
    objects.sort();
    objects
}

/// Changes one word of one object.
fn change_a_word(objects: &[PathBuf], random: &mut Rng) -> String {
    loop {
        let path = &objects[random.usize(..objects.len())];
        // Some can only be read by their owner, who is this user.
        let Ok(file) = File::options().read(true).write(true).open(path) else { continue };
        let words = file.metadata().unwrap().len() / 8;
        if words == 0 {
            continue;
        }
        // Most of a large object is payload.
        let last = if random.bool() { words.min(64) } else { words };
        let word = random.u64(..last);
        let mut bytes = [0; 8];
        file.read_exact_at(&mut bytes, word * 8).unwrap();
        let old = u64::from_le_bytes(bytes);
        let new = match random.u8(..6) {
            0 => 0,
            1 => u64::MAX,
            2 => random.u64(..),
            3 => old ^ 1 << random.u8(..64),
            4 => old.wrapping_add(1),
            _ => old.wrapping_sub(1),
        };
        if new != old {
            file.write_all_at(&new.to_le_bytes(), word * 8).unwrap();
            return format!("{}, word {word}: {old:#x} to {new:#x}", path.display());
        }
    }
}

/// Starts after such a change, and once more if the first start ends.
fn start_after_change(seed: &u64) -> Outcome {
    let ground = Ground::new();
    leave_objects(&ground);
    let place = change_a_word(&objects(&ground), &mut Rng::with_seed(*seed));
    let begun = Instant::now();
    for first in [First::Ready, First::Ended] {
        let supervisor = Supervisor::listen(&ground.domain.path("notify"));
        let service = ground.domain.start(ground.serve(&supervisor));
        let deadline = Instant::now() + TIMEOUT;
        let is_ready = || supervisor.wait_for("READY=1", Duration::from_millis(5)).is_some();
        while !service.has_ended() && Instant::now() < deadline {
            if is_ready() {
                let ready_after = begun.elapsed();
                service.kill();
                return Outcome { place, first, ready_after };
            }
        }
        assert!(service.has_ended(), "{place}: hangs:\n{}", service.log());
        let (status, log) = service.wait();
        println!("{place}: {status}: {}", log.lines().last().unwrap_or_default());
    }
    panic!("{place}: not ready at the second start");
}

fn try_seeds(count: u64) {
    let outcomes = try_all(&(0..count).collect::<Vec<_>>(), start_after_change);
    let ended = outcomes.iter().filter(|outcome| outcome.first == First::Ended).count();
    let latest = outcomes.iter().max_by_key(|outcome| outcome.ready_after).unwrap();
    println!(
        "{count} starts with a changed word: {} ready at the first, {ended} at the second; the last after {:.2} s ({})",
        outcomes.len() - ended,
        latest.ready_after.as_secs_f64(),
        latest.place
    );
}

#[test]
fn it_serves_again_after_a_word_of_a_leftover_object_was_changed() {
    try_seeds(8);
}

#[test]
#[ignore = "minutes: cargo test -p isotherm-tests --test all faults -- --ignored --nocapture"]
fn it_serves_again_whatever_word_of_a_leftover_object_was_changed() {
    try_seeds(1000);
}
