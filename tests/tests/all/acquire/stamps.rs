//! Times and counts after outages, against when the emulated device wrote each frame. Devices that count nothing have
//! only their arrivals, which a busy machine makes late; the simulated worlds of the acquisition try those.

use super::{Acquire, Device, counts, describe, recorded};
use isotherm_client::RawSample;
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, wait_until};
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::fs;
use std::thread::sleep;
use std::time::Duration;

/// Rounds in which the emulator itself was late are drawn again, so often.
const ROUNDS: usize = 20;
/// An emulator is late if it writes a frame this long after it was due \[ns\].
const LATE_NS: u64 = 3_000_000;

/// When frames were written and due \[ns\], by number.
fn written(domain: &TestDomain) -> BTreeMap<u64, [u64; 2]> {
    let text = fs::read_to_string(domain.path("device.log")).unwrap();
    let row = |line: &str| {
        let mut numbers = line.split(' ').map(|number| number.parse::<u64>().unwrap());
        (numbers.next().unwrap(), [numbers.next().unwrap(), numbers.next().unwrap()])
    };
    text.lines().map(row).collect()
}

/// What happens in the middle of a stream.
#[derive(Clone, Copy, Debug)]
enum Outage {
    /// The device samples, and nothing comes for so long \[s\].
    Muted(f64),
    /// The adapter stalls for so long \[s\], and loses nothing.
    Stalled(f64),
    /// The acquisition stands still for so long \[s\].
    Stopped(f64),
}

/// One round: the samples, what was written, and the tally.
fn round(
    emulator: Emulator,
    changes: &[(&str, &str)],
    rate: f64,
    outage: Outage,
) -> (Vec<RawSample>, BTreeMap<u64, [u64; 2]>, serde_json::Value) {
    const BEFORE: u64 = 600;
    let domain = TestDomain::new();
    describe(&domain, emulator, changes);
    let (order, seconds) = match outage {
        Outage::Muted(seconds) => (vec!["--mute".to_owned(), format!("{BEFORE}:{seconds}")], seconds),
        Outage::Stalled(seconds) => (vec!["--stall".to_owned(), format!("{BEFORE}:{seconds}")], seconds),
        Outage::Stopped(_) => (Vec::new(), 0.0),
    };
    let log = domain.path("device.log").display().to_string();
    let frames = (BEFORE + 600 + (seconds * rate) as u64).to_string();
    let rate = rate.to_string();
    let fixed = ["--frames", &frames, "--rate", &rate, "--log", &log];
    let orders: Vec<_> = fixed.into_iter().chain(order.iter().map(String::as_str)).collect();
    let device = Device::start(&domain, emulator, &orders);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv", "--dry-run"]);
    if let Outage::Stopped(seconds) = outage {
        wait_until("samples", || fs::metadata(domain.path("acquired.csv")).is_ok_and(|file| file.len() > 60_000));
        acquire.process.signal(Signal::STOP);
        sleep(Duration::from_secs_f64(seconds));
        acquire.process.signal(Signal::CONT);
    }
    acquire.process.wait_for_log("went away");
    assert!(device.0.wait().0.success());
    let (_, tally) = acquire.end_dry();
    (recorded(&domain, "acquired.csv"), written(&domain), tally)
}

/// Every sample has the time at which its frame was written, within an interval and the jitter of before, and no period
/// is missing but those of the outage. A round that shows otherwise is drawn again if the emulator itself was late.
fn assert_stamps(emulator: Emulator, changes: &[(&str, &str)], rate: f64, outage: Outage) {
    for drawn in 1.. {
        let (samples, written, tally) = round(emulator, changes, rate, outage);
        let fault = fault(&samples, &written, &tally, rate, outage);
        let was_late = written.values().any(|[written, due]| written.saturating_sub(*due) > LATE_NS);
        let is_drawn_again = fault.is_some() && was_late && drawn < ROUNDS;
        println!("{emulator:?}, {outage:?}: {} samples, {fault:?}, drawn again: {is_drawn_again}", samples.len());
        if !is_drawn_again {
            return assert_eq!(fault, None, "{emulator:?}, {outage:?}: {tally}");
        }
    }
}

fn fault(
    samples: &[RawSample],
    written: &BTreeMap<u64, [u64; 2]>,
    tally: &serde_json::Value,
    rate: f64,
    outage: Outage,
) -> Option<String> {
    // What a stalled adapter writes late was due before.
    let is_due = matches!(outage, Outage::Stalled(_) | Outage::Stopped(_));
    if counts(tally, ["sessions", "ambiguous"]) != [1, 0]
        || samples.iter().any(|raw| !written.contains_key(&raw.sequence))
    {
        return Some("other counts".to_owned());
    }
    if !matches!(outage, Outage::Stopped(_)) && samples.len() != written.len() {
        return Some(format!("{} samples of {} frames", samples.len(), written.len()));
    }
    let offset = |raw: &RawSample| raw.timestamp_ns as f64 - written[&raw.sequence][usize::from(is_due)] as f64;
    let before: Vec<_> = samples.iter().filter(|raw| raw.sequence < 500).map(offset).collect();
    let usual = before.iter().sum::<f64>() / before.len() as f64;
    let jitter = before.iter().map(|offset| (offset - usual).abs()).fold(0.0, f64::max);
    let allowed = 1e9 / rate + jitter;
    let wrong = samples.iter().find(|raw| (offset(raw) - usual).abs() > allowed)?;
    Some(format!("{} ns at {}, and {allowed} are allowed", offset(wrong) - usual, wrong.sequence))
}

const COUNTER: &[(&str, &str)] = &[("interval_s = 0.001", "interval_s = 0.005")];

#[test]
fn a_silence_is_counted_and_timed() {
    for seconds in [0.1, 3.0] {
        assert_stamps(Emulator::Stim300, COUNTER, 200.0, Outage::Muted(seconds));
    }
}

#[test]
fn what_was_late_has_its_time() {
    assert_stamps(Emulator::Stim300, COUNTER, 200.0, Outage::Stalled(0.15));
    assert_stamps(Emulator::Stim300, COUNTER, 200.0, Outage::Stopped(1.0));
}

/// Silent for over the time after which it is opened again: it goes on. The silence is so long because a machine that
/// stands still for a part of it makes it shorter for the acquisition.
#[test]
fn a_silent_device_is_opened_again() {
    let domain = TestDomain::new();
    let reopen = ("baud = 921600", "baud = 921600\nreopen_after_s = 1");
    describe(&domain, Emulator::Vn100, &[reopen]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", "3400", "--mute", "400:6"]);
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
    acquire.process.wait_for_log("so it is opened again");
    acquire.process.wait_for_log("is back");
    acquire.process.wait_for_log("frames come");
    acquire.process.wait_for_log("the other side closed it");
    assert!(device.0.wait().0.success());
    let (samples, tally) = acquire.end_dry();
    assert_eq!(counts(&tally, ["missing", "sessions", "samples"]), [2400, 1, 1000], "{tally}");
    super::assert_frames(Emulator::Vn100, &samples, |raw| (raw.timestamp_ns - 1_000_000_000) / 2_500_000);
}

/// Datagrams: two in the wrong order are put in order, and those of others are dropped and counted.
#[test]
fn datagrams_are_put_in_order_and_those_of_others_dropped() {
    let domain = TestDomain::new();
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("127.0.0.1:{port}");
    let serial = format!("serial = \"{}\"\nbaud = 921600", super::line(&domain).display());
    let udp = format!("udp = \"{address}\"\npeer = \"127.0.0.1\"");
    describe(&domain, Emulator::Stim300, &[(&serial, &udp)]);
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
    acquire.process.wait_for_log("reading udp");
    let stranger = std::net::UdpSocket::bind("127.0.0.2:0").unwrap();
    stranger.send_to(&Emulator::Stim300.frame(7), &address).unwrap();
    let words = ["stim300", "--udp", &address, "--frames", "1500", "--swap-order", "400,700,1100"];
    assert!(domain.start(domain.program("isotherm-emulator", &words)).wait().0.success());
    wait_until("rows", || {
        super::samples(&fs::read_to_string(domain.path("acquire.out")).unwrap_or_default()).len() >= 1490
    });
    let (samples, tally) = acquire.end_dry();
    assert_eq!(
        counts(&tally, ["samples", "missing", "repeated", "sessions", "strangers"]),
        [1500, 0, 0, 1, 1],
        "{tally}"
    );
    super::assert_frames(Emulator::Stim300, &samples, |raw| raw.sequence);
}
