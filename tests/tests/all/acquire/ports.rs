//! What is no serial line: TCP, UDP, a pipe, files, and Linux' IIO.

use super::{Acquire, assert_frames, counts, describe, dry_run, line, samples};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, text, wait_until};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::process::Signal;
use std::fs::{self, OpenOptions};
use std::io::{Write as _, pipe};
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::time::{Duration, Instant};

/// Frames of a VN-100, whose clock counts the periods: they may come in any rhythm within half a second.
fn frames(numbers: std::ops::Range<u64>) -> Vec<Vec<u8>> {
    numbers.map(|number| Emulator::Vn100.frame(number)).collect()
}

/// Describes a VN-100 at another source.
fn describe_at(domain: &TestDomain, source: &str) {
    let serial = format!("serial = \"{}\"\nbaud = 921600", line(domain).display());
    describe(domain, Emulator::Vn100, &[(serial.as_str(), source)]);
}

/// The rows that a dry run has printed so far.
fn printed(domain: &TestDomain) -> usize {
    fs::read_to_string(domain.path("acquire.out")).unwrap_or_default().lines().skip(1).count()
}

#[test]
fn a_tcp_connection_is_made_and_made_again() {
    let domain = TestDomain::new();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    describe_at(&domain, &format!("tcp = \"{}\"", listener.local_addr().unwrap()));
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
    let (mut stream, _) = listener.accept().unwrap();
    // In pieces, with a frame that is cut by the end of the connection.
    let mut bytes = frames(0..100).concat();
    bytes.extend(&Emulator::Vn100.frame(100)[..20]);
    bytes.chunks(31).for_each(|piece| stream.write_all(piece).unwrap());
    wait_until("rows", || printed(&domain) == 100);
    drop(stream);
    acquire.process.wait_for_log("went away: the other side closed it");
    let (mut stream, _) = listener.accept().unwrap();
    acquire.process.wait_for_log("is back");
    // The device has counted on.
    stream.write_all(&frames(102..200).concat()).unwrap();
    wait_until("rows", || printed(&domain) == 198);
    let (samples, tally) = acquire.end_dry();
    assert_frames(Emulator::Vn100, &samples, |raw| raw.sequence);
    let names = ["samples", "missing", "gaps", "outages", "sessions", "skipped/cut"];
    assert_eq!(counts(&tally, names), [198, 2, 1, 1, 1, 20], "{tally}");
}

/// A free port, which nobody has yet.
fn free_port() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

#[test]
fn udp_datagrams_of_one_frame_or_several_are_read() {
    let domain = TestDomain::new();
    let address = free_port();
    describe_at(&domain, &format!("udp = \"{address}\"\npeer = \"any\""));
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
    let hex = format!(":{:04X} ", address.port());
    wait_until("the socket", || fs::read_to_string("/proc/net/udp").unwrap().contains(&hex));
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    // The acquisition reads while the next are sent, so that its socket never is full.
    let frames = frames(0..120);
    let mut expected = 0;
    let (single, several) = frames.split_at(60);
    for datagram in single.iter().map(|frame| (frame.clone(), 1)).chain(several.chunks(4).map(|all| (all.concat(), 4)))
    {
        socket.send_to(&datagram.0, address).unwrap();
        expected += datagram.1;
        if expected % 20 == 0 {
            wait_until("rows", || printed(&domain) == expected);
        }
    }
    // An empty datagram is none, and the end of nothing.
    socket.send_to(&[], address).unwrap();
    let last = Emulator::Vn100.frame(120);
    socket.send_to(&last, address).unwrap();
    wait_until("the last row", || printed(&domain) == 121);
    let second = domain.run(&["acquire", "source.toml"]);
    let said = "give an address of this machine, as 0.0.0.0, and a port that no other program has";
    assert!(second.status.code() == Some(74) && text(&second.stderr).contains(said), "{}", text(&second.stderr));
    let (samples, tally) = acquire.end_dry();
    assert_frames(Emulator::Vn100, &samples, |raw| raw.sequence);
    assert_eq!(counts(&tally, ["samples", "missing", "sessions", "outages"]), [121, 0, 1, 0], "{tally}");
}

#[test]
fn a_pipe_ends_with_its_writer_and_every_row_is_there() {
    let domain = TestDomain::new();
    describe_at(&domain, "file = \"-\"");
    let (input, mut output) = pipe().unwrap();
    let mut command = domain.isotherm(&["acquire", "source.toml", "--dry-run", "--json"]);
    command.stdin(input);
    let writer = std::thread::spawn(move || {
        for frame in frames(0..150) {
            output.write_all(&frame).unwrap();
        }
    });
    let output = domain.finish(command);
    writer.join().unwrap();
    let log = text(&output.stderr);
    assert!(output.status.success(), "{log}");
    let rows = samples(&text(&output.stdout));
    assert_eq!(rows.len(), 150);
    assert_frames(Emulator::Vn100, &rows, |raw| raw.sequence);
    assert_eq!(counts(&super::tally_of(&log), ["samples", "missing", "sessions"]), [150, 0, 1], "{log}");
}

#[test]
fn a_file_is_read_at_once_or_at_the_rate_of_its_frames() {
    for emulator in [Emulator::Vn100, Emulator::Stim300, Emulator::Mtdata2, Emulator::Arduino] {
        let domain = TestDomain::new();
        let bytes: Vec<_> = (0..2000).flat_map(|number| emulator.frame(number)).collect();
        fs::write(domain.path("bytes"), bytes).unwrap();
        let port = if emulator == Emulator::Arduino { "115200" } else { "921600" };
        let serial = format!("serial = \"{}\"\nbaud = {port}", line(&domain).display());
        describe(&domain, emulator, &[(serial.as_str(), "file = \"bytes\"")]);
        let (rows, tally) = dry_run(&domain, &[]);
        assert_eq!((rows.len(), counts(&tally, ["missing", "sessions"])), (2000, [0, 1]), "{emulator:?}: {tally}");
        assert_frames(emulator, &rows, |raw| raw.sequence);
        let (again, _) = dry_run(&domain, &["--rows", "77"]);
        assert!(again.len() == 77 && again.iter().zip(&rows).all(|(a, b)| a.sequence == b.sequence));
        // At the rate of its frames: not all at once, and all of them.
        describe(&domain, emulator, &[(serial.as_str(), "file = \"bytes\"\npace = true")]);
        let begun = Instant::now();
        let (paced, tally) = dry_run(&domain, &["--rows", "150"]);
        let least = Duration::from_secs_f64(100.0 / emulator.rate());
        assert!(begun.elapsed() > least, "{emulator:?}: {tally}");
        assert_eq!(paced.len(), 150);
        assert_frames(emulator, &paced, |raw| raw.sequence);
    }
}

/// What a BMI270-like device has in sysfs, at 100 Hz: its temperature is not in its buffer.
const DEVICE: &str = "
name: bmi270
in_accel_scale: 0.000598
in_anglvel_scale: 0.001065
sampling_frequency: 100
in_temp_raw: 1024
in_temp_offset: 11776
in_temp_scale: 1.953125
current_timestamp_clock: realtime
buffer/enable: 0
buffer/length: 2
buffer/watermark: 1
";

/// A tree as sysfs, and a pipe as the device's node.
pub(super) fn tree(domain: &TestDomain) {
    let device = domain.path("root/sys/bus/iio/devices/iio:device0");
    let set = |name: &str, text: &str| {
        let path = device.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\n")).unwrap();
    };
    for line in DEVICE.lines().filter(|line| !line.is_empty()) {
        let (name, text) = line.split_once(": ").unwrap();
        set(name, text);
    }
    let channels = ["accel_x", "accel_y", "accel_z", "anglvel_x", "anglvel_y", "anglvel_z", "timestamp"];
    for (index, channel) in channels.into_iter().enumerate() {
        set(&format!("scan_elements/in_{channel}_en"), "0");
        set(&format!("scan_elements/in_{channel}_index"), &index.to_string());
        let kind = if channel == "timestamp" { "le:s64/64>>0" } else { "le:s16/16>>0" };
        set(&format!("scan_elements/in_{channel}_type"), kind);
    }
    fs::create_dir_all(domain.path("root/dev")).unwrap();
    mknodat(CWD, domain.path("root/dev/iio:device0"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
}

const IIO: &str = "
format = 1
imu = \"imu-a\"
[source]
kind = \"iio\"
[timing]
interval_s = 0.01
[iio]
device = \"bmi270\"
[accelerometer]
columns = [\"accel_x\", \"accel_y\", \"accel_z\"]
kind = \"reading\"
resolution = 1
[gyroscope]
columns = [\"anglvel_x\", \"anglvel_y\", \"anglvel_z\"]
kind = \"reading\"
resolution = 1
sign = [1, -1, 1]
[temperature]
columns = \"temp\"
";

#[test]
fn an_iio_device_gives_raw_counts_as_pulses_and_its_temperature() {
    const SCANS: u64 = 60;
    let domain = TestDomain::new();
    tree(&domain);
    domain.write("source.toml", IIO);
    let words = ["--dry-run", "--sysfs", "root"];
    let acquire = Acquire::start(&domain, "acquire", &words);
    let enabled = domain.path("root/sys/bus/iio/devices/iio:device0/buffer/enable");
    wait_until("the buffer", || fs::read_to_string(&enabled).is_ok_and(|text| text.trim() == "1"));
    let mut node = OpenOptions::new().write(true).open(domain.path("root/dev/iio:device0")).unwrap();
    let counts_of = |scan: u64| [scan as i16 * 3, -100 - scan as i16, 16_000, -7, 5 + scan as i16, scan as i16 % 5];
    let began = 1_000_000_000;
    for scan in 0..SCANS {
        let mut bytes: Vec<u8> = counts_of(scan).into_iter().flat_map(i16::to_le_bytes).collect();
        bytes.extend([0; 4]);
        bytes.extend((began + scan * 10_000_000).to_le_bytes());
        // A scan that comes in two pieces, and two that come in one.
        let (first, second) = bytes.split_at(scan as usize % 24);
        node.write_all(first).unwrap();
        node.write_all(second).unwrap();
    }
    wait_until("rows", || printed(&domain) == SCANS as usize);
    acquire.process.signal(Signal::TERM);
    let output = domain.path("acquire.out");
    let (status, log) = acquire.process.wait();
    assert!(status.success(), "{log}");
    let rows = samples(&fs::read_to_string(output).unwrap());
    assert_eq!(rows.len() as u64, SCANS);
    for (raw, scan) in rows.iter().zip(0..) {
        let [x, y, z, p, q, r] = counts_of(scan).map(i64::from);
        assert_eq!(super::pulses(raw), [x, y, z, p, -q, r], "{scan}");
        assert_eq!(raw.timestamp_ns, began + scan * 10_000_000);
        // (1024 + 11776) * 1.953125 milli-degC.
        assert_eq!(raw.accelerometers.head_temperature, [25.0; 3]);
    }
    assert_eq!(fs::read_to_string(&enabled).unwrap().trim(), "0", "the buffer is off again");
    assert_eq!(counts(&super::tally_of(&log), ["samples", "missing", "sessions"]), [SCANS, 0, 1], "{log}");
    // Another device's name is refused, with those that there are.
    domain.write("source.toml", &IIO.replace("device = \"bmi270\"", "device = \"adis16505\""));
    let refused = domain.run(&["acquire", "source.toml", "--dry-run", "--sysfs", "root"]);
    let log = text(&refused.stderr);
    assert!(refused.status.code().is_some_and(|code| code >= 65) && log.contains("bmi270"), "{log}");
}
