//! Frames that do not arrive whole, and bytes that are none: the tally says what the device did.

use super::{Acquire, Device, assert_frames, counts, describe, dry_run, rate};
use isotherm_client::RawSample;
use isotherm_tests::TestDomain;
use isotherm_tests::emulator::Emulator;
use isotherm_tests::emulator::plan::Plan;
use std::fs;
use std::thread;

const FRAMES: u64 = 400;
const DROP: [u64; 4] = [60, 61, 62, 263];
const WRONG: [u64; 2] = [110, 261];
const DOUBLE: [u64; 2] = [151, 351];
const NOISE: [(u64, usize); 3] = [(210, 500), (262, 77), (390, 1)];

fn words<T>(all: &[T], word: impl Fn(&T) -> String) -> String {
    all.iter().map(word).collect::<Vec<_>>().join(",")
}

/// Messages of GNSS, which the MTi counts, among so many frames.
fn gnss(emulator: Emulator, frames: u64) -> u64 {
    if emulator == Emulator::Mtdata2 { (frames - 1) / 25 } else { 0 }
}

fn assert_sequences(emulator: Emulator, samples: &[RawSample], is_there: impl Fn(u64) -> bool, frames: u64) {
    let sequences: Vec<_> = samples.iter().map(|raw| raw.sequence).collect();
    assert_eq!(sequences, (0..frames).filter(|number| is_there(*number)).collect::<Vec<_>>(), "{emulator:?}");
    assert_frames(emulator, samples, |raw| raw.sequence);
}

#[test]
fn each_lost_wrong_and_doubled_frame_and_each_byte_of_noise_is_counted() {
    let check = |emulator: Emulator| {
        let domain = TestDomain::new();
        let (rate, changes) = rate(emulator);
        describe(&domain, emulator, changes);
        let number = |number: &u64| number.to_string();
        let noise = words(&NOISE, |(frame, bytes)| format!("{bytes}@{frame}"));
        let [drop, wrong, double] = [&DROP[..], &WRONG, &DOUBLE].map(|all| words(all, number));
        let (frames, rate) = (FRAMES.to_string(), rate.to_string());
        let orders = [
            "--rate", &rate, "--frames", &frames, "--drop", &drop, "--wrong", &wrong, "--double", &double, "--noise",
            &noise,
        ];
        let device = Device::start(&domain, emulator, &orders);
        let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
        acquire.process.wait_for_log("went away");
        assert!(device.0.wait().0.success());
        let (samples, tally) = acquire.end_dry();

        // Noise before a line without an end of its own takes that line along.
        let is_text = emulator == Emulator::Arduino;
        let is_behind_noise = |number: u64| NOISE.iter().any(|(frame, _)| *frame == number);
        let is_there =
            |number: u64| !(DROP.contains(&number) || WRONG.contains(&number) || is_text && is_behind_noise(number));
        assert_sequences(emulator, &samples, is_there, FRAMES);
        let there = (0..FRAMES).filter(|number| is_there(*number)).count() as u64;
        let others = gnss(emulator, FRAMES);
        let names = ["samples", "missing", "repeated", "others", "sessions", "ambiguous"];
        let exact = [there, FRAMES - there, DOUBLE.len() as u64, others, 1, 0];
        assert_eq!(counts(&tally, names), exact, "{emulator:?}: {tally}");
        assert_eq!(counts(&tally, ["frames"]), [there + others + DOUBLE.len() as u64], "{emulator:?}: {tally}");
        let gaps = (1..FRAMES).filter(|number| !is_there(*number) && is_there(number - 1)).count() as u64;
        assert_eq!(counts(&tally, ["gaps"]), [gaps], "{emulator:?}: {tally}");

        // Every byte is in a frame or counted.
        let (drop, wrong) = (DROP.to_vec(), WRONG.to_vec());
        let plan = Plan { drop, wrong, double: DOUBLE.to_vec(), noise: NOISE.to_vec(), ..Plan::new(emulator, FRAMES) };
        let bytes: usize = (0..FRAMES).map(|number| plan.bytes(number).len()).sum();
        let noise: usize = NOISE.iter().map(|(_, bytes)| bytes).sum();
        let damaged = (0..FRAMES).filter(|number| !is_there(*number) && !DROP.contains(number));
        let lost = noise + damaged.map(|number| emulator.frame(number).len()).sum::<usize>();
        let causes = ["noise", "length", "checksum", "unconfirmed", "items", "columns", "cut"];
        let skipped: u64 = causes.iter().map(|cause| counts(&tally, [&*format!("skipped/{cause}")])[0]).sum();
        assert_eq!((counts(&tally, ["bytes"]), skipped), ([bytes as u64], lost as u64), "{emulator:?}: {tally}");
        let [damaged] = counts(&tally, ["skipped/damaged"]);
        assert!(damaged >= WRONG.len() as u64, "{emulator:?}: {tally}");
    };
    thread::scope(|scope| {
        for emulator in Emulator::ALL {
            scope.spawn(move || check(emulator));
        }
    });
}

#[test]
fn frames_that_are_cut_cost_themselves_and_no_other() {
    const CUT: [u64; 3] = [51, 121, 122];
    for emulator in Emulator::ALL {
        let domain = TestDomain::new();
        let mut bytes = Vec::new();
        let mut lost = 0;
        for number in 0..FRAMES {
            let frame = emulator.frame(number);
            let whole = if CUT.contains(&number) { frame.len() - 1 - number as usize % 30 } else { frame.len() };
            lost += if CUT.contains(&number) { whole } else { 0 };
            bytes.extend(&frame[..whole]);
        }
        // The last one, too.
        let last = emulator.frame(FRAMES);
        bytes.extend(&last[..20]);
        fs::write(domain.path("bytes"), bytes).unwrap();
        let port = if emulator == Emulator::Arduino { "115200" } else { "921600" };
        let serial = format!("serial = \"{}\"\nbaud = {port}", super::line(&domain).display());
        describe(&domain, emulator, &[(serial.as_str(), "file = \"bytes\"")]);
        let (samples, tally) = dry_run(&domain, &[]);
        // The end of a line is in the cut piece, so that the next line is lost with it.
        let is_text = emulator == Emulator::Arduino;
        let is_there = |number: u64| !(CUT.contains(&number) || is_text && CUT.contains(&(number - number.min(1))));
        assert_sequences(emulator, &samples, is_there, FRAMES);
        let behind = if is_text { [52, 123].map(|number| emulator.frame(number).len()).iter().sum() } else { 0 };
        let causes = ["noise", "length", "checksum", "unconfirmed", "items", "columns", "cut"];
        let skipped: u64 = causes.iter().map(|cause| counts(&tally, [&*format!("skipped/{cause}")])[0]).sum();
        assert_eq!(skipped, (lost + behind + 20) as u64, "{emulator:?}: {tally}");
        let missing = if is_text { 5 } else { 3 };
        assert_eq!(counts(&tally, ["missing", "gaps", "sessions"]), [missing, 2, 1], "{emulator:?}: {tally}");
    }
}
