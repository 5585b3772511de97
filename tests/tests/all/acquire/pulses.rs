//! A device whose clock begins its second with a pulse that this machine receives, too: both are made up here, the
//! pulses in a tree as sysfs.

use super::{Acquire, counts};
use isotherm_client::UnixOffset;
use isotherm_tests::TestDomain;
use std::fs;
use std::io::Write as _;
use std::net::TcpListener;
use std::path::Path;
use std::thread::{self, sleep};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The interval, the second of the pulses, and where in it the first sample lies \[ns\].
const INTERVAL: i64 = 10_000_000;
const SECOND: i64 = 1_000_000_000;
const PHASE: i64 = 3_217_000;
/// Samples: 3 s.
const ROWS: i64 = 300;
/// By how much stamps may be off that come late by up to 23 ms \[ns\].
const BOUND: i64 = 100_000;

fn unix_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as i64
}

/// As the kernel, which shows a text whole or not at all.
fn show(path: &Path, unix_ns: i64, number: i64) {
    let text = format!("{}.{:09}#{number}\n", unix_ns / SECOND, unix_ns % SECOND);
    fs::write(path.with_extension("new"), text).unwrap();
    fs::rename(path.with_extension("new"), path).unwrap();
}

#[test]
fn pulses_give_a_sample_the_time_at_which_it_was_taken() {
    let domain = TestDomain::new();
    let pulses = domain.path("root/sys/class/pps/pps3/assert");
    fs::create_dir_all(pulses.parent().unwrap()).unwrap();
    // Before its first pulse a source shows this.
    show(&pulses, 0, 0);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let text = format!(
        "format = 1\nimu = \"imu-a\"\n[source]\nkind = \"lines\"\ntcp = \"{}\"\n[timing]\ninterval_s = 0.01\n\
         time = {{ column = \"time\", unit = \"us\", pps = 3 }}\n[lines]\nnames = [\"number\", \"time\", \"zero\", \"nothing\"]\n\
         [accelerometer]\ncolumns = [\"number\", \"zero\", \"nothing\"]\nkind = \"reading\"\nresolution = 1\nscale = 1\n\
         [temperature]\nconstant = 25.0\n",
        listener.local_addr().unwrap()
    );
    domain.write("source.toml", &text);
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run", "--sysfs", "root"]);
    let offset = UnixOffset::measure();
    let device = thread::spawn(move || {
        let (mut line, _) = listener.accept().unwrap();
        let begin = unix_ns();
        for number in 0..ROWS {
            // The device's clock begins anew with each pulse, and each sample comes some ms late.
            let since = number * INTERVAL + PHASE;
            let late = number * 7 % 23 * 1_000_000;
            while unix_ns() < begin + since + late {
                sleep(Duration::from_micros(500));
            }
            show(&pulses, begin + since / SECOND * SECOND, 1 + since / SECOND);
            writeln!(line, "{number},{},0,0", since % SECOND / 1000).unwrap();
        }
        begin
    });
    acquire.process.wait_for_log("reading tcp");
    let begin = device.join().unwrap();
    acquire.process.wait_for_log("went away");
    let (samples, tally) = acquire.end_dry();
    assert_eq!(counts(&tally, ["sessions", "missing", "incomplete"]), [1, 0, 0], "{tally}");
    assert_eq!(samples.len() as i64, ROWS);
    for sample in samples {
        let number = i64::from(sample.accelerometers.positive_pulses[0]);
        let taken_ns = offset.monotonic_ns(begin + number * INTERVAL + PHASE).unwrap().cast_signed();
        let late_ns = sample.timestamp_ns.cast_signed() - taken_ns;
        // A machine that stands still for a second makes a sample so much later, only by whole seconds.
        let off_ns = (late_ns + SECOND / 2).rem_euclid(SECOND) - SECOND / 2;
        assert!(off_ns.abs() <= BOUND, "{number}: {late_ns} ns late");
    }
}
