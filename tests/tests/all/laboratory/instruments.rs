//! The drivers of chambers and turntables, tested against the processes of the simulated station on pseudo-terminals
//! and TCP, and against scripted peers whose requests and replies are taken from public drivers.

use isotherm_instruments::{
    self as instruments, ChamberConfig, ChamberInstrument, ChamberReading, FaultKind, Instrument, InstrumentFault,
    RealTime, Surroundings, Time as _, TurntableConfig, TurntableInstrument, TurntableReading, turn_deg,
};
use isotherm_shared::document::{Document, Faults};
use isotherm_tests::{Process, TIMEOUT, TestDomain, text, wait_until};
use rustix::process::Signal;
use std::fs;
use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::thread::{self, JoinHandle};

/// Settings of the line with a long time-out: on a loaded machine a reply may be late without a fault.
const LONG_TIMEOUT: &str = "timeout_s = 20\nquiet_s = 0.05\nretries = 0\n";

/// The drivers, each with the configuration keys that match its simulated instrument.
const CHAMBERS: [(&str, &str); 3] = [("espec", ""), ("watlow-f4t", "pause_s = 0\n"), ("ascii2", "alarm_bit = 2\n")];
const TURNTABLES: [(&str, &str); 2] = [("acutrol", "gap_s = 0.05\n"), ("aerosmith", "fault_mask = 4\n")];

fn chamber_config(toml: &str) -> Result<ChamberConfig, Faults> {
    let document = Document::parse(toml)?;
    let root = document.root();
    let config = ChamberConfig::read(&root);
    root.finish();
    document.finish(config)
}

fn turntable_config(toml: &str) -> Result<TurntableConfig, Faults> {
    let document = Document::parse(toml)?;
    let root = document.root();
    let config = TurntableConfig::read(&root);
    root.finish();
    document.finish(config)
}

/// A running simulated station.
struct TestStation<'d> {
    domain: &'d TestDomain,
    process: Process,
}

impl<'d> TestStation<'d> {
    fn start(domain: &'d TestDomain, arguments: &[&str]) -> Self {
        let given = [&["simulate", "station", "-o", "station", "--imu", "imu-a"], arguments].concat();
        let process = domain.spawn(&given);
        Self { domain, process }
    }

    /// The port of an instrument. Waits until the station has written it to its description.
    fn port(&self, who: &str) -> String {
        let mut port = String::new();
        wait_until("the station's description", || {
            let json = fs::read_to_string(self.domain.path("station/station.json")).unwrap_or_default();
            let station: serde_json::Value = serde_json::from_str(&json).unwrap_or_default();
            port = station[format!("{who}_port")].as_str().unwrap_or_default().to_owned();
            !port.is_empty()
        });
        port
    }

    fn chamber(&self, keys: &str) -> Box<dyn ChamberInstrument> {
        let config = chamber_config(&format!("port = {:?}\n{keys}", self.port("chamber"))).unwrap();
        let mut chamber = chamber(&config);
        wait_until("the port", || chamber.line_mut().connect().is_ok());
        chamber
    }

    fn turntable(&self, keys: &str) -> Box<dyn TurntableInstrument> {
        let config = turntable_config(&format!("port = {:?}\n{keys}", self.port("table"))).unwrap();
        let mut turntable = turntable(&config);
        wait_until("the port", || turntable.line_mut().connect().is_ok());
        turntable
    }

    /// Sets the faults that are simulated from now on, one per line.
    fn faults(&self, lines: &str) {
        self.domain.replace("station/faults", lines);
    }
}

/// A chamber that no signal stops.
fn chamber(config: &ChamberConfig) -> Box<dyn ChamberInstrument> {
    instruments::chamber(config, &Surroundings::default())
}

/// A turntable that no signal stops.
fn turntable(config: &TurntableConfig) -> Box<dyn TurntableInstrument> {
    instruments::turntable(config, &Surroundings::default())
}

fn keys(driver: &str, own: &str, line: &str) -> String {
    format!("driver = \"{driver}\"\n{own}{line}")
}

fn fault_kind<T: std::fmt::Debug>(result: Result<T, InstrumentFault>) -> FaultKind {
    result.unwrap_err().kind
}

/// The fault of a request to a simulated instrument whose line is dead.
const fn dead_line(connection: &[&str]) -> FaultKind {
    if connection.is_empty() { FaultKind::Line } else { FaultKind::NoReply }
}

/// Sends a first order of the safe state.
fn order_at_once<I: Instrument + ?Sized>(
    instrument: &mut I,
    order: impl FnOnce(&mut I) -> Result<(), InstrumentFault>,
) -> Result<(), InstrumentFault> {
    instrument.line_mut().begin_orders(RealTime.now() + TIMEOUT);
    let result = order(instrument);
    instrument.line_mut().end_orders();
    result
}

/// Runs a test for all drivers at the same time: it mostly waits.
fn for_each_driver<const N: usize>(drivers: [(&'static str, &'static str); N], test: impl Fn(&str, &str) + Sync) {
    thread::scope(|scope| {
        for (driver, own) in drivers {
            scope.spawn(|| test(driver, own));
        }
    });
}

/// Runs a test on pseudo-terminals and on TCP.
fn over_serial_and_tcp(check: impl Fn(&[&str])) {
    check(&[]);
    check(&["--tcp"]);
}

#[test]
fn every_chamber_goes_where_it_is_sent_and_into_standby() {
    for_each_driver(CHAMBERS, |driver, own| {
        over_serial_and_tcp(|connection| {
            let domain = TestDomain::new();
            let station =
                TestStation::start(&domain, &[&["--speed", "2000", "--chamber", driver], connection].concat());
            let mut chamber = station.chamber(&keys(driver, own, LONG_TIMEOUT));
            let name = chamber.identify().unwrap();
            assert!(
                ["ESPEC P300", "Watlow F4T, address 1, loop 1, unit C", "ASCII-2, 4 values, 16 digital outputs"]
                    .contains(&name.as_str())
            );
            let ChamberReading { air_c, running, alarms, .. } = chamber.read().unwrap();
            assert!((air_c - 20.0).abs() < 0.2 && !running && alarms.is_empty(), "{driver}: {air_c}");
            chamber.set_point(-5.5).unwrap();
            chamber.run().unwrap();
            assert!(chamber.read().unwrap().running);
            wait_until("the set point", || (chamber.read().unwrap().air_c + 5.5).abs() < 0.2);
            assert_eq!(chamber.read().unwrap().set_point_c, -5.5);
            let refused = fault_kind(chamber.set_point(900.0));
            // ASCII-2 has no reply for a refusal: the driver reads the old set point back.
            assert_eq!(refused, if driver == "ascii2" { FaultKind::Mismatch } else { FaultKind::Refused });
            assert_eq!(chamber.read().unwrap().set_point_c, -5.5);
            chamber.standby().unwrap();
            assert!(!chamber.read().unwrap().running);
            wait_until("the drift", || chamber.read().unwrap().air_c > -4.5);
        });
    });
}

#[test]
fn every_turntable_goes_where_it_is_sent_and_stops() {
    for_each_driver(TURNTABLES, |driver, own| {
        over_serial_and_tcp(|connection| {
            let domain = TestDomain::new();
            let station = TestStation::start(&domain, &[&["--speed", "20", "--table", driver], connection].concat());
            let mut turntable = station.turntable(&keys(driver, own, LONG_TIMEOUT));
            let name = turntable.identify().unwrap();
            assert!(
                ["ACUTRONIC,ACUTROL3000,SIMULATED,0", "Aerosmith Table Language, axes 1 and 2"]
                    .contains(&name.as_str())
            );
            turntable.engage().unwrap();
            let reading = turntable.read().unwrap();
            let resolution_deg = reading.resolution_deg;
            assert_eq!(reading, TurntableReading { resolution_deg, ..TurntableReading::default() });
            assert!((1e-6..=2e-4).contains(&resolution_deg), "{resolution_deg}");
            turntable.move_to([90.0, -30.5], 10.0, 5.0).unwrap();
            wait_until("the position", || turntable.read().unwrap().angles_deg == [90.0, -30.5]);
            // The angle reaches its last digit before the rate is zero.
            wait_until("the rest", || turntable.read().unwrap().rates_deg_s == [0.0; 2]);
            assert_eq!(turntable.read().unwrap().angles_deg, [90.0, -30.5]);
            // This move takes hours, so it is not finished when it is stopped, even on a slow machine.
            turntable.engage().unwrap();
            turntable.move_to([700.0, 0.0], 0.05, 5.0).unwrap();
            wait_until("the turn", || turntable.read().unwrap().angles_deg[0] > 90.01);
            turntable.stop().unwrap();
            wait_until("the stop", || turntable.read().unwrap().rates_deg_s == [0.0; 2]);
            assert!(turntable.read().unwrap().angles_deg[0] < 690.0);
        });
    });
}

#[test]
fn each_fault_of_a_chambers_line_is_reported_and_the_next_request_is_answered() {
    for_each_driver(CHAMBERS, |driver, own| {
        over_serial_and_tcp(|connection| {
            let domain = TestDomain::new();
            let station = TestStation::start(&domain, &[&["--chamber", driver], connection].concat());
            let mut chamber = station.chamber(&keys(driver, own, LONG_TIMEOUT));
            chamber.set_point(23.5).unwrap();
            station.faults("garbled:chamber\n");
            // A Modbus frame with a garbled function code never counts as complete: the driver waits for the time-out.
            drop(chamber);
            let mut chamber = station.chamber(&keys(driver, own, "timeout_s = 0.5\nretries = 0\n"));
            // On a loaded machine some replies are late, which is another fault.
            wait_until("the garbled reply", || fault_kind(chamber.read()) == FaultKind::Garbled);
            station.faults("missing:chamber\n");
            wait_until("silence", || fault_kind(chamber.read()) == FaultKind::NoReply);
            // A pseudo-terminal takes no bytes then, TCP takes them and nobody reads.
            station.faults("dead:chamber\n");
            wait_until("the dead line", || chamber.read().is_err_and(|fault| fault.kind == dead_line(connection)));
            station.faults("");
            wait_until("the line", || chamber.run().is_ok());
            station.faults("babble:chamber\n");
            wait_until("babble", || chamber.read().is_err_and(|fault| fault.kind == FaultKind::Babble));
            // The order arrives all the same. It is not acknowledged.
            assert!(order_at_once(chamber.as_mut(), |chamber| chamber.standby()).is_err());
            station.faults("");
            wait_until("the line", || chamber.read().is_ok_and(|reading| !reading.running));
            drop(chamber);
            let mut chamber = station.chamber(&keys(driver, own, LONG_TIMEOUT));
            station.faults("duplicated:chamber\n");
            for set_point_c in [24.0, 25.0] {
                chamber.set_point(set_point_c).unwrap();
                assert_eq!(chamber.read().unwrap().set_point_c, set_point_c);
            }
            station.faults("alarm:chamber\n");
            assert_eq!(chamber.read().unwrap().alarms.len(), 1);
            assert_eq!(fault_kind(chamber.run()), FaultKind::Alarm, "{driver}");
            assert!(!chamber.read().unwrap().running);
            station.faults("port-loss:chamber\n");
            wait_until("the loss", || chamber.read().is_err_and(|fault| fault.kind == FaultKind::Line));
            station.faults("");
            wait_until("the return", || chamber.read().is_ok());
            assert_eq!(chamber.read().unwrap().set_point_c, 25.0);
            chamber.run().unwrap();
        });
    });
}

#[test]
fn each_fault_of_a_turntables_line_is_reported_and_the_next_request_is_answered() {
    for_each_driver(TURNTABLES, |driver, own| {
        over_serial_and_tcp(|connection| {
            let domain = TestDomain::new();
            let station = TestStation::start(&domain, &[&["--speed", "20", "--table", driver], connection].concat());
            let mut turntable = station.turntable(&keys(driver, own, LONG_TIMEOUT));
            turntable.engage().unwrap();
            station.faults("garbled:table\n");
            assert_eq!(fault_kind(turntable.read()), FaultKind::Garbled, "{driver}");
            station.faults("missing:table\n");
            let short_timeout = keys(driver, own, "timeout_s = 0.5\nretries = 0\n");
            drop(turntable);
            let mut turntable = station.turntable(&short_timeout);
            assert_eq!(fault_kind(turntable.read()), FaultKind::NoReply, "{driver}");
            station.faults("dead:table\n");
            wait_until("the dead line", || turntable.read().is_err_and(|fault| fault.kind == dead_line(connection)));
            station.faults("");
            // This motion takes hours.
            wait_until("the line", || turntable.move_to([0.0, 700.0], 0.05, 5.0).is_ok());
            station.faults("babble:table\n");
            wait_until("babble", || turntable.read().is_err_and(|fault| fault.kind == FaultKind::Babble));
            // The order arrives all the same. It is not acknowledged.
            assert!(order_at_once(turntable.as_mut(), |turntable| turntable.stop()).is_err());
            station.faults("");
            wait_until("the stop", || turntable.read().is_ok_and(|reading| reading.rates_deg_s == [0.0; 2]));
            drop(turntable);
            let mut turntable = station.turntable(&keys(driver, own, LONG_TIMEOUT));
            turntable.engage().unwrap();
            if driver == "acutrol" && !connection.is_empty() {
                // On TCP only a pause ends a reply, so the second copy is read as a part of it.
                station.faults("duplicated:table@1\n");
                assert_eq!(fault_kind(turntable.move_to([10.0, 20.0], 10.0, 5.0)), FaultKind::Garbled);
            } else {
                station.faults("duplicated:table\n");
            }
            turntable.move_to([10.0, 20.0], 10.0, 5.0).unwrap();
            wait_until("the position", || turntable.read().unwrap().angles_deg == [10.0, 20.0]);
            station.faults("alarm:table\n");
            wait_until("the alarm", || turntable.read().unwrap().faults.len() == 2);
            assert_eq!(fault_kind(turntable.engage()), FaultKind::Alarm, "{driver}");
            station.faults("port-loss:table\n");
            wait_until("the loss", || turntable.read().is_err_and(|fault| fault.kind == FaultKind::Line));
            station.faults("");
            wait_until("the return", || turntable.read().is_ok());
            if driver == "acutrol" {
                turntable.engage().unwrap();
            }
            turntable.move_to([-10.0, 0.0], 10.0, 5.0).unwrap();
            wait_until("the position", || turntable.read().unwrap().angles_deg == [-10.0, 0.0]);
            assert_eq!(turntable.read().unwrap().faults.len(), 0);
        });
    });
}

/// A controller reports a refusal if its protocol has a reply for it, and is silent if not.
#[test]
fn refusals_are_distinguished_from_silence() {
    for_each_driver(CHAMBERS, |driver, own| {
        let domain = TestDomain::new();
        let station = TestStation::start(&domain, &["--chamber", driver, "--fault", "na"]);
        let silent = driver == "ascii2";
        let line = if silent { "timeout_s = 0.5\nretries = 1\n" } else { LONG_TIMEOUT };
        let expected = if silent { FaultKind::NoReply } else { FaultKind::Refused };
        let mut chamber = station.chamber(&keys(driver, own, line));
        assert_eq!(fault_kind(chamber.read()), expected, "{driver}");
        assert_eq!(fault_kind(chamber.set_point(5.0)), expected, "{driver}");
    });
    for_each_driver(TURNTABLES, |driver, own| {
        let domain = TestDomain::new();
        let station = TestStation::start(&domain, &["--table", driver, "--fault", "na:table"]);
        let silent = driver == "aerosmith";
        let line = if silent { "timeout_s = 0.5\nretries = 1\n" } else { LONG_TIMEOUT };
        let expected = if silent { FaultKind::NoReply } else { FaultKind::Refused };
        let mut turntable = station.turntable(&keys(driver, own, line));
        assert_eq!(fault_kind(turntable.engage()), expected, "{driver}");
    });
}

#[test]
fn a_late_reply_is_never_taken_for_the_next_ones() {
    for_each_driver(TURNTABLES, |driver, own| {
        let domain = TestDomain::new();
        let station = TestStation::start(&domain, &["--speed", "20", "--table", driver]);
        let mut turntable = station.turntable(&keys(driver, own, LONG_TIMEOUT));
        turntable.engage().unwrap();
        turntable.move_to([30.0, 60.0], 20.0, 20.0).unwrap();
        wait_until("the position", || turntable.read().unwrap().angles_deg == [30.0, 60.0]);
        // The reply with the outer rate comes after 1.5 s. By then the outer angle is requested again, and its reply is
        // late too.
        let short_timeout = keys(driver, own, "timeout_s = 1.2\nquiet_s = 4\nretries = 0\n");
        drop(turntable);
        let mut turntable = station.turntable(&short_timeout);
        station.faults("late:table@2-3\n");
        let mut reading = turntable.read();
        assert_eq!(reading.as_ref().unwrap_err().kind, FaultKind::NoReply);
        while reading.as_ref().is_err_and(|fault| fault.kind == FaultKind::NoReply) {
            reading = turntable.read();
        }
        let TurntableReading { angles_deg, rates_deg_s, .. } = reading.unwrap();
        assert_eq!((angles_deg, rates_deg_s), ([30.0, 60.0], [0.0; 2]), "{driver}");
    });
}

#[test]
fn a_lost_request_is_repeated() {
    let domain = TestDomain::new();
    let station = TestStation::start(&domain, &["--fault", "missing:chamber@2"]);
    let mut chamber = station.chamber("driver = \"espec\"\ntimeout_s = 3\nquiet_s = 0.1\nretries = 4\n");
    chamber.set_point(31.0).unwrap();
    assert_eq!(chamber.read().unwrap().set_point_c, 31.0);
}

#[test]
fn simulated_overshoot_and_missing_settling_show_in_the_readings() {
    let domain = TestDomain::new();
    let station = TestStation::start(&domain, &["--speed", "500", "--fault", "overshoot"]);
    let mut chamber = station.chamber(&keys("espec", "", LONG_TIMEOUT));
    let mut turntable = station.turntable(&keys("acutrol", "", LONG_TIMEOUT));
    chamber.set_point(30.0).unwrap();
    chamber.run().unwrap();
    chamber.set_point(32.0).unwrap();
    wait_until("the overshoot", || chamber.read().unwrap().air_c > 33.5);
    wait_until("the return", || (chamber.read().unwrap().air_c - 32.0).abs() < 0.2);
    station.faults("never-there\nno-settle\n");
    chamber.set_point(25.0).unwrap();
    wait_until("a temperature near the set point", || (chamber.read().unwrap().air_c - 28.0).abs() < 0.2);
    turntable.engage().unwrap();
    turntable.move_to([5.0, 5.0], 10.0, 10.0).unwrap();
    wait_until("the swing", || {
        let TurntableReading { angles_deg, rates_deg_s, .. } = turntable.read().unwrap();
        turn_deg(angles_deg[0], 5.0).abs() < 0.1 && rates_deg_s[0].abs() > 0.05
    });
    station.faults("");
    wait_until("the end of the swing", || turntable.read().unwrap().angles_deg == [5.0, 5.0]);
    wait_until("the set point", || (chamber.read().unwrap().air_c - 25.0).abs() < 0.2);
}

#[test]
fn the_imu_follows_turntable_and_chamber_and_outlives_the_service() {
    let domain = TestDomain::new();
    let station = TestStation::start(&domain, &["--speed", "200"]);
    let mut chamber = station.chamber(&keys("espec", "", LONG_TIMEOUT));
    let mut turntable = station.turntable(&keys("acutrol", "", LONG_TIMEOUT));
    turntable.engage().unwrap();
    chamber.set_point(35.0).unwrap();
    chamber.run().unwrap();
    let serve = || domain.serve(&["--imu", "imu-a=station/truth.toml"]);
    let service = serve();
    let mut reader = domain.reader("imu-a");
    let mut wait_for = |what: &str, [x, y, z]: [f64; 3]| {
        wait_until(what, || {
            let latest = std::iter::from_fn(|| reader.receive().unwrap()).last();
            latest.is_some_and(|increment| {
                let force = increment.velocity_increment.map(|dv| dv / (increment.interval_ns as f64 / 1e9) / 9.8015);
                [force[0] - x, force[1] - y, force[2] - z].iter().all(|error| error.abs() < 1e-3)
            })
        });
    };
    wait_for("A3 up", [0.0, 0.0, 1.0]);
    turntable.move_to([90.0, 90.0], 10.0, 10.0).unwrap();
    wait_for("A1 up", [1.0, 0.0, 0.0]);
    service.kill();
    turntable.move_to([90.0, 180.0], 10.0, 10.0).unwrap();
    let service = serve();
    wait_for("A2 down, after another service", [0.0, -1.0, 0.0]);
    service.terminate();
    station.process.terminate();
}

#[test]
fn a_station_leaves_nothing_behind_even_when_it_is_killed() {
    let domain = TestDomain::new();
    let station = TestStation::start(&domain, &[]);
    let mut chamber = station.chamber(&keys("espec", "", LONG_TIMEOUT));
    chamber.identify().unwrap();
    let path = format!("/proc/{0}/task/{0}/children", station.process.pid());
    let mut children: Vec<String> = Vec::new();
    wait_until("its three processes", || {
        children = fs::read_to_string(&path).unwrap().split_whitespace().map(str::to_owned).collect();
        children.len() == 3
    });
    let ended = |pid: &String| {
        fs::read_to_string(format!("/proc/{pid}/stat"))
            .map_or(true, |stat| stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('Z')))
    };
    station.process.kill();
    wait_until("the end of its processes", || children.iter().all(ended));
    // The next station replaces the dangling link.
    let station = TestStation::start(&domain, &[]);
    let mut chamber = station.chamber(&keys("espec", "", LONG_TIMEOUT));
    chamber.identify().unwrap();
    station.process.signal(Signal::INT);
    let (status, log) = station.process.wait();
    assert!(status.success(), "{log}");
    let mut remaining: Vec<_> =
        fs::read_dir(domain.path("station")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    remaining.sort();
    assert_eq!(remaining, ["plan.toml", "truth.toml"]);
    assert_eq!(fault_kind(chamber.read()), FaultKind::Line);
}

/// A peer that expects the requests of the transcript in order and sends their replies. Any other request fails the
/// test.
fn scripted(transcript: &'static [(&'static [u8], &'static [u8])]) -> (String, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port =
        format!("port = \"tcp://{}\"\nretries = 0\ntimeout_s = 20\nquiet_s = 0.05\n", listener.local_addr().unwrap());
    let peer = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        for (request, reply) in transcript {
            let mut received = vec![0; request.len()];
            stream.read_exact(&mut received).unwrap();
            assert_eq!(text(&received), text(request));
            stream.write_all(reply).unwrap();
        }
        // The driver closes the connection without another request.
        assert_eq!(stream.read(&mut [0]).unwrap(), 0);
    });
    (port, peer)
}

/// Over TCP no line feed ends a reply. What a pause ends may be a begin: the first replies show the number of decimals.
#[test]
fn a_begin_of_a_number_is_no_reading() {
    const CUT: &[(&[u8], &[u8])] = &[(b":read:position? 1\r\n", b"HEADER.\n12")];
    const CUT_LATER: &[(&[u8], &[u8])] = &[
        (b":read:position? 1\r\n", b"HEADER.\n123.4567"),
        (b":read:position? 1\r\n", b"HEADER.\n123.4567"),
        (b":read:rate? 1\r\n", b"HEADER.\n0.0123"),
        (b":read:rate? 1\r\n", b"HEADER.\n0.0"),
    ];
    for transcript in [CUT, CUT_LATER] {
        let (port, peer) = scripted(transcript);
        let mut turntable =
            turntable(&turntable_config(&format!("driver = \"acutrol\"\ngap_s = 0.3\n{port}")).unwrap());
        let fault = turntable.read().unwrap_err();
        assert_eq!(fault.kind, FaultKind::Garbled, "{fault}");
        assert!(fault.to_string().contains("see reply_decimals"), "{fault}");
        drop(turntable);
        peer.join().unwrap();
    }
    const WHOLE: &[(&[u8], &[u8])] = &[
        (b":read:position? 1\r\n", b"HEADER.\n12"),
        (b":read:rate? 1\r\n", b"HEADER.\n0"),
        (b":read:position? 2\r\n", b"HEADER.\n0"),
        (b":read:rate? 2\r\n", b"HEADER.\n-0.5"),
        (b":interlock? 1\r\n", b"HEADER.\nClosed"),
        (b":interlock? 2\r\n", b"HEADER.\nClosed"),
    ];
    let (port, peer) = scripted(WHOLE);
    let keys = format!("driver = \"acutrol\"\ngap_s = 0.3\nreply_decimals = 0\n{port}");
    let reading = turntable(&turntable_config(&keys).unwrap()).read().unwrap();
    assert_eq!((reading.angles_deg, reading.rates_deg_s), ([12.0, 0.0], [0.0, -0.5]));
    peer.join().unwrap();
}

// The requests of AcutronicRobotics/acutrol, acutrol.py and ac117.json, and the replies that it expects after an 8-byte
// header.
#[test]
fn the_acutrol_driver_sends_what_a_public_driver_sends() {
    let transcript: &[(&[u8], &[u8])] = &[
        (b":utility:lockout on\r\n", b"HEADER.\nOK"),
        (b":interlock:reset 1\r\n", b"HEADER.\nOK"),
        (b":interlock:close 1\r\n", b"HEADER.\nOK"),
        (b":interlock:reset 2\r\n", b"HEADER.\nOK"),
        (b":interlock:close 2\r\n", b"HEADER.\nOK"),
        (b":interlock? 1\r\n", b"HEADER.\nClosed"),
        (b":interlock? 2\r\n", b"HEADER.\nClosed"),
        (b":mode:off 1\r\n", b"HEADER.\nOK"),
        (b":interlock:open 1\r\n", b"HEADER.\nOK"),
        (b":mode:off 2\r\n", b"HEADER.\nOK"),
        (b":interlock:open 2\r\n", b"HEADER.\nERR"),
    ];
    let (port, peer) = scripted(transcript);
    let mut turntable = turntable(&turntable_config(&format!("driver = \"acutrol\"\ngap_s = 0.3\n{port}")).unwrap());
    turntable.engage().unwrap();
    assert_eq!(fault_kind(turntable.stop()), FaultKind::Refused);
    drop(turntable);
    peer.join().unwrap();
}

// Requests and replies of IEAv-EFO/acutrol3000, python/acutrol3000.py, for two axes, one line each.
#[test]
fn the_acutrol_driver_reads_replies_as_a_public_driver_does() {
    let transcript: &[(&[u8], &[u8])] = &[
        (b":read:position? 3\r\n", b"90.0001\n"),
        (b":read:rate? 3\r\n", b"-0.005\n"),
        (b":read:position? 7\r\n", b"1.8E2\n"),
        (b":read:rate? 7\r\n", b"0\n"),
        (b":interlock? 3\r\n", b"Fault\n"),
        (b":interlock? 7\r\n", b"Closed\n"),
    ];
    let (port, peer) = scripted(transcript);
    let config = turntable_config(&format!("driver = \"acutrol\"\naxes = [3, 7]\nheader = 0\n{port}")).unwrap();
    let reading = turntable(&config).read().unwrap();
    assert_eq!((reading.angles_deg, reading.rates_deg_s), ([90.0001, 180.0], [-0.005, 0.0]));
    // The one of the two angles with more digits shows what the controller can.
    assert!((reading.resolution_deg - 1e-4).abs() < 1e-12, "{}", reading.resolution_deg);
    assert_eq!(reading.faults, ["interlock of axis 3: Fault"]);
    peer.join().unwrap();
}

#[test]
fn whole_turns_are_sent_as_they_are_unless_the_controller_counts_modulo_360() {
    const OK: &[u8] = b"\r\n>\r\n";
    const TURNED: &[(&[u8], &[u8])] = &[
        (b"1VEL10.000\r\n", OK),
        (b"1ACL10.000\r\n", OK),
        (b"2VEL10.000\r\n", OK),
        (b"2ACL10.000\r\n", OK),
        (b"1MOV720.000\r\n", OK),
        (b"2MOV-90.000\r\n", OK),
    ];
    const WRAPPED: &[(&[u8], &[u8])] = &[
        (b"1VEL10.000\r\n", OK),
        (b"1ACL10.000\r\n", OK),
        (b"2VEL10.000\r\n", OK),
        (b"2ACL10.000\r\n", OK),
        (b"1MOV0.000\r\n", OK),
        (b"2MOV270.000\r\n", OK),
    ];
    for (keys, transcript) in [("", TURNED), ("wrap = true\n", WRAPPED)] {
        let (port, peer) = scripted(transcript);
        let config = turntable_config(&format!("driver = \"aerosmith\"\n{keys}{port}")).unwrap();
        assert_eq!(config.wraps(), !keys.is_empty());
        turntable(&config).move_to([720.0, -90.0], 10.0, 10.0).unwrap();
        peer.join().unwrap();
    }
}

// Requests and replies of StaflSystems/ChamberConnectLibrary, p300.py and especinteract.py. The leading 1 is the RS-485
// address.
#[test]
fn the_espec_driver_sends_and_reads_what_a_public_driver_does() {
    let transcript: &[(&[u8], &[u8])] = &[
        (b"1,TYPE?\r\n", b"T,T,SCP220,100.0\r\n"),
        (b"1,MON?\r\n", b"23.1,45,CONSTANT,2\r\n"),
        (b"1,TEMP?\r\n", b"23.1,25.0,100.0,-50.0\r\n"),
        (b"1,ALARM?\r\n", b"2,1,13\r\n"),
        (b"1,TEMP, S-25.0\r\n", b"NA:DATA OUT OF RANGE\r\n"),
    ];
    let (port, peer) = scripted(transcript);
    let config = chamber_config(&format!("driver = \"espec\"\naddress = 1\n{port}")).unwrap();
    let mut chamber = chamber(&config);
    assert_eq!(chamber.identify().unwrap(), "ESPEC SCP220");
    let reading = chamber.read().unwrap();
    assert_eq!((reading.air_c, reading.set_point_c, reading.running), (23.1, 25.0, true));
    assert_eq!(reading.alarms, ["alarm 1", "alarm 13"]);
    let fault = chamber.set_point(-25.0).unwrap_err();
    assert_eq!(fault.kind, FaultKind::Refused);
    assert!(fault.to_string().contains("DATA OUT OF RANGE"), "{fault}");
    drop(chamber);
    peer.join().unwrap();
}

// Registers from StaflSystems/ChamberConnectLibrary, watlowf4t.py; the CRC of the frames is that of the Modbus
// specification.
#[test]
fn a_watlow_can_use_fahrenheit_and_send_the_high_word_first() {
    let transcript: &[(&[u8], &[u8])] = &[
        // Unit: F. Process value of loop 2 (2980): 77.0 degF.
        (&[5, 3, 0x37, 0x00, 0, 1, 0x8b, 0xfa], &[5, 3, 2, 0, 30, 0xc9, 0x8c]),
        (&[5, 3, 0x0b, 0xa4, 0, 2, 0x86, 0x48], &[5, 3, 4, 0x42, 0x9a, 0, 0, 0x8b, 0xa4]),
        // Set point: a register that does not exist.
        (&[5, 3, 0x0b, 0x7e, 0, 2, 0xa7, 0xb3], &[5, 0x83, 2, 0x81, 0x30]),
    ];
    let (port, peer) = scripted(transcript);
    let config =
        format!("driver = \"watlow-f4t\"\naddress = 5\nloop = 2\nword_order = \"high-first\"\npause_s = 0\n{port}");
    let fault = chamber(&chamber_config(&config).unwrap()).read().unwrap_err();
    assert_eq!(fault.kind, FaultKind::Refused, "{fault}");
    peer.join().unwrap();
}

#[test]
fn a_peer_that_never_stops_sending_is_given_up() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let peer = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        while stream.write_all(b"23.1,,CONSTANT,0\r\n").is_ok() {}
    });
    let config =
        chamber_config(&format!("driver = \"espec\"\nport = \"tcp://{address}\"\nquiet_s = 0.1\nretries = 1\n"));
    let mut chamber = chamber(&config.unwrap());
    let fault = chamber.read().unwrap_err();
    assert_eq!(fault.kind, FaultKind::Babble);
    assert!(fault.to_string().contains("babble: it sends without a request"), "{fault}");
    drop(chamber);
    peer.join().unwrap();
}

/// The peer answers nothing. The wait for its reply would take a minute, and the order would wait for silence after
/// that.
#[test]
fn a_signal_ends_the_wait_for_a_reply_and_the_order_follows_at_once() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let stop_signal = Arc::<AtomicUsize>::default();
    let signal = Arc::clone(&stop_signal);
    let peer = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut expect = |request: &[u8]| {
            let mut received = vec![0; request.len()];
            stream.read_exact(&mut received).unwrap();
            assert_eq!(text(&received), text(request));
        };
        expect(b"MON?\r\n");
        signal.store(2, Relaxed);
        expect(b"MODE,STANDBY\r\n");
        // Open until the order's reply has been waited for.
        stream
    });
    let config =
        chamber_config(&format!("driver = \"espec\"\nport = \"tcp://{address}\"\ntimeout_s = 60\nquiet_s = 0\n"));
    let mut chamber = instruments::chamber(&config.unwrap(), &Surroundings::real(&stop_signal));
    assert_eq!(fault_kind(chamber.read()), FaultKind::Stopped);
    // From now on nothing is sent but orders.
    assert_eq!(fault_kind(chamber.set_point(30.0)), FaultKind::Stopped);
    assert_eq!(fault_kind(order_at_once(chamber.as_mut(), |chamber| chamber.standby())), FaultKind::NoReply);
    drop(peer.join().unwrap());
}

#[test]
fn a_missing_peer_is_a_line_fault() {
    let domain = TestDomain::new();
    let port = domain.path("no-such-device").display().to_string();
    let config = chamber_config(&format!("driver = \"ascii2\"\nport = {port:?}\n")).unwrap();
    let fault = chamber(&config).read().unwrap_err();
    assert_eq!(fault.kind, FaultKind::Line);
    assert!(fault.to_string().contains(&port) && fault.to_string().contains("check cable"), "{fault}");
    // No program listens at port 1. A port that was just freed could belong to another test by now.
    let config = turntable_config("driver = \"aerosmith\"\nport = \"tcp://127.0.0.1:1\"\n").unwrap();
    assert_eq!(turntable(&config).read().unwrap_err().kind, FaultKind::Line);
}

#[test]
fn everything_wrong_with_a_section_is_reported_at_once() {
    let text = "driver = \"watlow-f4t\"\nport = \"tcp://host\"\nbaud = 1\nparity = \"mark\"\ntimeout_s = 0\nretries = 11\n\
                address = 0\nloop = 5\nword_order = \"little\"\ndecimals = 1\n";
    let faults = chamber_config(text).unwrap_err();
    let found: Vec<_> = faults.0.iter().map(|fault| fault.key.as_str()).collect();
    let expected = ["port", "baud", "parity", "timeout_s", "retries", "address", "loop", "word_order", "decimals"];
    assert_eq!(found, expected, "{faults}");
    assert_eq!(faults.0.iter().map(|fault| fault.line).collect::<Vec<_>>(), [2, 3, 4, 5, 6, 7, 8, 9, 10]);
    let faults = turntable_config("driver = \"espec\"\nport = \"x\"\n").unwrap_err();
    assert!(faults.to_string().contains("give \"acutrol\" or \"aerosmith\""), "{faults}");
    let faults =
        turntable_config("driver = \"aerosmith\"\nport = \"x\"\nform = \"{axis}\"\naxes = [1, 1]\n").unwrap_err();
    assert_eq!(faults.0.len(), 2, "{faults}");
}

#[test]
fn every_key_is_in_the_commented_plans() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/instruments");
    let plans = fs::read_dir(folder).unwrap().map(|file| fs::read_to_string(file.unwrap().path()).unwrap());
    let plans = plans.collect::<String>().replace("\n[chamber]", "\n[turntable]");
    let sections = |driver: &str| {
        let named = format!("driver = {driver:?}");
        plans.split("\n[turntable]").filter(|section| section.contains(&named)).collect::<String>()
    };
    // These have the keys of every line.
    let line = sections("espec");
    let known = |faults: Faults| {
        let message = faults.0.iter().find(|fault| fault.key == "unheard-of").unwrap().message.clone();
        let (_, keys) = message.split_once("known here: ").unwrap();
        keys.split(", ").map(str::to_owned).collect::<Vec<_>>()
    };
    for (driver, _) in CHAMBERS.iter().chain(&TURNTABLES) {
        let text = format!("driver = {driver:?}\nport = \"x\"\nunheard-of = 1\n");
        let is_chamber = CHAMBERS.iter().any(|(name, _)| name == driver);
        let faults = if is_chamber { chamber_config(&text).err() } else { turntable_config(&text).err() };
        for key in known(faults.unwrap()) {
            let given = format!("{key} = ");
            let there = sections(driver).contains(&given) || line.contains(&given);
            assert!(there, "{driver}: {key} is in no plan of examples/instruments");
        }
    }
}
