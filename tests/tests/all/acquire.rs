//! `isotherm acquire` as users run it: emulated devices behind pseudo-terminals, sockets and pipes, the service,
//! readers, and what goes wrong with each of them. What must come out is known from the emulators, which share no code
//! with the decoder.

mod damage;
mod endings;
mod errors;
mod identity;
mod lag;
mod outages;
mod pipeline;
mod ports;
mod profiles;
mod pulses;
mod rates;
mod recording;
mod seen;
mod stamps;
mod thermometer;
mod units;

use isotherm_client::RawSample;
use isotherm_recording::RawCsvReader;
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{Process, TestDomain, text, wait_until};
use rustix::process::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// More frames than any test waits for.
const ENDLESS: &str = "100000000";

/// An emulated device, at the end `line` of the test's folder.
struct Device(Process);

impl Device {
    /// Starts one, which sends as soon as its line is opened.
    fn start(domain: &TestDomain, emulator: Emulator, words: &[&str]) -> Self {
        let line = line(domain);
        let link = line.to_str().unwrap().to_owned();
        let words = [&[emulator.profile(), "--link", &link], words].concat();
        let process = domain.start(domain.program("isotherm-emulator", &words));
        wait_until("the device's line", || fs::read_link(&line).is_ok_and(|terminal| terminal.exists()));
        Self(process)
    }

    /// Unplugs it.
    fn unplug(self, domain: &TestDomain) {
        // A killed device leaves its link, and the next terminal with that number is another test's.
        fs::remove_file(line(domain)).unwrap();
        self.0.kill();
    }
}

/// The line of a test's device.
fn line(domain: &TestDomain) -> PathBuf {
    domain.path("line")
}

/// The profile of a device, at the test's line. Each change is a text and what stands in its place.
fn profile(domain: &TestDomain, emulator: Emulator, changes: &[(&str, &str)]) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/acquire").join(emulator.profile());
    let mut text = fs::read_to_string(path.with_extension("toml")).unwrap();
    let line = line(domain).display().to_string();
    for (from, to) in [&[("/dev/ttyUSB0", line.as_str())], changes].concat() {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

/// Writes [`profile`] as `source.toml`.
fn describe(domain: &TestDomain, emulator: Emulator, changes: &[(&str, &str)]) {
    domain.write("source.toml", &profile(domain, emulator, changes));
}

/// The rate at which a device is tested \[Hz\], and what makes its profile that of this rate. A counter of 128 periods
/// must not turn while a process of a busy machine waits for its turn: the number of turns follows from the time.
fn rate(emulator: Emulator) -> (f64, &'static [(&'static str, &'static str)]) {
    match emulator {
        Emulator::Stim300 | Emulator::Stim300Rate | Emulator::Kvh1750 => {
            (200.0, &[("interval_s = 0.001", "interval_s = 0.005")])
        }
        other => (other.rate(), &[]),
    }
}

/// What one pulse stands for in the unit of the emulator's values: of accelerometers and gyroscopes.
fn resolution(emulator: Emulator) -> [f64; 2] {
    match emulator {
        Emulator::Stim300 | Emulator::Arduino => [1.0, 1.0],
        Emulator::Stim300Rate => [2_f64.powi(-19), 2_f64.powi(-14)],
        Emulator::Kvh1750 => [1e-6, 1e-9],
        Emulator::Vn100 => [1e-7, 1e-7],
        Emulator::Mtdata2 => [1e-6, 1e-6],
    }
}

/// Pulses of the six sensors.
fn pulses(raw: &RawSample) -> [i64; 6] {
    let of = |triad: &isotherm_client::Triad| {
        let both = triad.positive_pulses.iter().zip(&triad.negative_pulses);
        both.map(|(positive, negative)| i64::from(*positive) - i64::from(*negative)).collect::<Vec<_>>()
    };
    [of(&raw.accelerometers), of(&raw.gyroscopes)].concat().try_into().unwrap()
}

/// Asserts that samples are those of the emulator's frames, of which `number` gives the number. The sum of pulses is
/// never more than half a pulse off; after a gap it begins again.
fn assert_frames(emulator: Emulator, samples: &[RawSample], number: impl Fn(&RawSample) -> u64) {
    assert_frames_with(emulator, samples, number, resolution(emulator), [1.0; 6]);
}

fn assert_frames_with(
    emulator: Emulator,
    samples: &[RawSample],
    number: impl Fn(&RawSample) -> u64,
    resolution: [f64; 2],
    sign: [f64; 6],
) {
    let mut sums = [(0, 0.0); 6];
    let mut last = None;
    for raw in samples {
        let values: BTreeMap<_, _> = emulator.expected(number(raw)).into_iter().collect();
        if last.is_some_and(|last| last + 1 != raw.sequence) {
            sums = [(0, 0.0); 6];
        }
        last = Some(raw.sequence);
        let temperatures =
            [raw.accelerometers, raw.gyroscopes].map(|triad| [triad.head_temperature, triad.board_temperature]);
        for (axis, name) in ["ax", "ay", "az", "gx", "gy", "gz"].into_iter().enumerate() {
            let exact = sign[axis] * values[name] / resolution[axis / 3];
            let counted = pulses(raw)[axis];
            assert!((counted as f64 - exact).abs() <= 1.001, "{emulator:?} {name} of {raw:?}: {exact}");
            let (all, sum) = &mut sums[axis];
            (*all, *sum) = (*all + counted, *sum + exact);
            assert!((*all as f64 - *sum).abs() <= 0.501, "{emulator:?} {name} of {raw:?}: {all} {sum}");
            let own = values.get(format!("temperature_{name}").as_str());
            let temperature = *own.unwrap_or_else(|| &values["temperature"]);
            for of in temperatures[axis / 3] {
                assert_eq!(of[axis % 3], temperature, "{emulator:?} {name} of {raw:?}");
            }
        }
    }
}

/// The samples of rows in CSV.
fn samples(text: &str) -> Vec<RawSample> {
    RawCsvReader::new(text.as_bytes()).unwrap().map(Result::unwrap).collect()
}

/// The samples of a recording in CSV in the test's folder.
fn recorded(domain: &TestDomain, name: &str) -> Vec<RawSample> {
    RawCsvReader::new(File::open(domain.path(name)).unwrap()).unwrap().map(Result::unwrap).collect()
}

/// A running `isotherm acquire source.toml --json`.
struct Acquire {
    process: Process,
    output: PathBuf,
}

impl Acquire {
    /// Starts it. `name` is that of its output, without ending.
    fn start(domain: &TestDomain, name: &str, words: &[&str]) -> Self {
        let words = [&["acquire", "source.toml", "--json"], words].concat();
        let command = domain.isotherm_after(&[], &format!("exec > {name}.out"), &words);
        Self { process: domain.start(command), output: domain.path(&format!("{name}.out")) }
    }

    /// Waits for its end, which must be a success. Returns the last tally.
    fn wait(self) -> Value {
        let (status, log) = self.process.wait();
        assert!(status.success(), "{status}: {log}");
        let printed = fs::read_to_string(&self.output).unwrap();
        serde_json::from_str(printed.lines().last().unwrap_or_else(|| panic!("no tally: {log}"))).unwrap()
    }

    /// Ends a dry run with SIGTERM, which must be a success. Returns its samples and the last tally.
    fn end_dry(self) -> (Vec<RawSample>, Value) {
        self.process.signal(Signal::TERM);
        let (status, log) = self.process.wait();
        assert!(status.success(), "{status}: {log}");
        (samples(&fs::read_to_string(&self.output).unwrap()), tally_of(&log))
    }

    /// Ends it with SIGTERM, which must be a success. Returns the last tally.
    fn end(self) -> Value {
        self.process.signal(Signal::TERM);
        self.wait()
    }
}

/// Numbers of a tally; of a part of it as `skipped/noise`.
fn counts<const N: usize>(tally: &Value, names: [&str; N]) -> [u64; N] {
    let count = |name: &str| {
        let found = tally.pointer(&format!("/{name}"));
        found.and_then(Value::as_u64).unwrap_or_else(|| panic!("{name} in {tally}"))
    };
    names.map(count)
}

/// Runs `isotherm acquire source.toml --dry-run --json`, which must be a success. Returns the samples and the tally.
fn dry_run(domain: &TestDomain, words: &[&str]) -> (Vec<RawSample>, Value) {
    let output = domain.run(&[&["acquire", "source.toml", "--dry-run", "--json"], words].concat());
    let log = text(&output.stderr);
    assert!(output.status.success(), "{}: {log}", output.status);
    (samples(&text(&output.stdout)), tally_of(&log))
}

/// The last tally of a log.
fn tally_of(log: &str) -> Value {
    let line = log.lines().rev().find(|line| line.starts_with('{'));
    serde_json::from_str(line.unwrap_or_else(|| panic!("no tally: {log}"))).unwrap()
}
