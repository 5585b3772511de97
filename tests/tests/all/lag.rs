//! Temperature in motion, and the unit: what an acquisition adds to its samples, with a real service.
//!
//! Over 400 lines: one property a test, for all of which the same table and samples serve.

use isotherm_client::transport::stream;
use isotherm_client::{
    Acquisition, CompensatedIncrement, Flags, LagOption, Options, RawReader, RawSample, SendError, Sensor,
    TimeConstant, boot, device, join, subscribers_of,
};
use isotherm_shared::compensate::answer;
use isotherm_shared::lag::{Lag, ReadingLimits};
use isotherm_shared::table::CoefficientTable;
use isotherm_tests::{TIMEOUT, TestDomain, WHOLE_TABLE, completed, id, same, table, wait_until, whole_recording};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// The time constant of the table \[ns\].
const LAG_NS: u64 = 240_000_000_000;

/// The table with another time constant.
fn with_lag(seconds: &str) -> String {
    WHOLE_TABLE.replace("time_constant_s = 240.0", &format!("time_constant_s = {seconds}"))
}

/// An acquisition of a soaked IMU.
fn connect(domain: &TestDomain, lag: LagOption, serial: Option<&str>) -> Acquisition {
    let options = Options { lag, serial: serial.map(str::to_owned), ..domain.options() };
    let mut acquisition = Acquisition::connect(&id("imu-g"), &options).unwrap();
    acquisition.lag().soaked();
    acquisition
}

fn fixed(seconds: f64) -> LagOption {
    LagOption::Fixed(TimeConstant::from_seconds(seconds).unwrap())
}

/// Sends a sample as it is, with its own sequence, and waits for the increment.
fn send(acquisition: &mut Acquisition, sample: &RawSample) -> CompensatedIncrement {
    let mut loan = acquisition.loan().unwrap();
    *loan = RawSample { session: loan.session, ..*sample };
    acquisition.compensate(loan, TIMEOUT).unwrap()
}

/// Feeds the readings of a sample, then sends it.
fn feed(acquisition: &mut Acquisition, sample: &RawSample) -> CompensatedIncrement {
    acquisition.lag().follow(sample);
    send(acquisition, sample)
}

fn is_lag_unknown(increment: &CompensatedIncrement) -> bool {
    Flags(increment.flags).intersects(Flags::LAG_UNKNOWN)
}

/// Asserts that an increment is the kernel's for this sample.
fn assert_exact(increment: &CompensatedIncrement, table: &CoefficientTable, raw: &RawSample) {
    let expected = answer(Some(table), &RawSample { session: increment.session, ..*raw });
    assert!(same(increment, &expected), "{increment:?}\n{expected:?}");
}

#[test]
fn increments_are_exact_with_the_time_constant_of_the_service() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let exact = table(WHOLE_TABLE);
    let samples = whole_recording(400);
    let mut acquisition = connect(&domain, LagOption::Service, Some(" SN 42\n"));
    assert_eq!(acquisition.lag().state().lag_ns, LAG_NS);
    for (sample, complete) in samples.iter().zip(completed(&samples, LAG_NS, "SN 42")) {
        let increment = feed(&mut acquisition, sample);
        assert_exact(&increment, &exact, &complete);
        assert!(!is_lag_unknown(&increment) && increment.angle_increment.iter().all(|angle| angle.is_finite()));
    }
    // Without a lag the last increment is another one, so the test would notice.
    let soaked = RawSample { lag_ns: 0, ..samples[399] };
    let increment = answer(Some(&exact), &soaked);
    let last = answer(Some(&exact), &completed(&samples, LAG_NS, "")[399]);
    assert_ne!(increment.velocity_increment, last.velocity_increment);
    assert_ne!(increment.angle_increment, last.angle_increment);
    service.terminate();
}

#[test]
fn readings_give_the_same_as_samples_that_are_followed() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let exact = table(WHOLE_TABLE);
    let samples = whole_recording(200);
    let mut acquisition = connect(&domain, LagOption::Service, None);
    for (index, (sample, complete)) in samples.iter().zip(completed(&samples, LAG_NS, "")).enumerate() {
        if index % 20 == 0 {
            let heads = [sample.accelerometers.head_temperature, sample.gyroscopes.head_temperature];
            for ((sensor, _), head) in Sensor::NAMES.into_iter().zip(heads.as_flattened()) {
                acquisition.lag().read(sensor, *head, sample.timestamp_ns);
            }
        }
        assert_exact(&send(&mut acquisition, sample), &exact, &complete);
    }
    service.terminate();
}

#[test]
fn the_options_are_obeyed() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let exact = table(WHOLE_TABLE);
    let samples = whole_recording(60);
    // A number that is not the table's: every increment is computed without the transient terms, and flagged.
    let mut acquisition = connect(&domain, fixed(100.0), None);
    for (sample, complete) in samples.iter().zip(completed(&samples, 100_000_000_000, "")) {
        let increment = feed(&mut acquisition, sample);
        assert_exact(&increment, &exact, &complete);
        assert!(is_lag_unknown(&increment));
    }
    drop(acquisition);
    // None: what the application fills in is sent.
    let mut acquisition = connect(&domain, LagOption::None, None);
    for (sample, complete) in samples.iter().zip(completed(&samples, LAG_NS, "")) {
        assert!(is_lag_unknown(&feed(&mut acquisition, sample)));
        let next = RawSample { sequence: complete.sequence + 1000, ..complete };
        acquisition.begin_session().unwrap();
        assert_exact(&feed(&mut acquisition, &next), &exact, &next);
        acquisition.begin_session().unwrap();
    }
    service.terminate();
}

#[test]
fn without_readings_and_with_a_sensor_that_is_not_fed_increments_are_flagged() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let mut acquisition = connect(&domain, LagOption::Service, None);
    let samples = whole_recording(4);
    assert!(is_lag_unknown(&send(&mut acquisition, &samples[0])), "no readings");
    for sensor in [Sensor::A1, Sensor::A2, Sensor::A3, Sensor::G1, Sensor::G2] {
        acquisition.lag().read(sensor, 1.2, 1);
    }
    assert!(is_lag_unknown(&send(&mut acquisition, &samples[1])), "G3 has a transient term, and no reading");
    acquisition.lag().read(Sensor::G3, 1.42, 1);
    assert!(!is_lag_unknown(&send(&mut acquisition, &samples[2])));
    service.terminate();
}

/// Tables with other time constants are put in force during a feed at 2 kHz. Every increment is that of its table and
/// of the sample as it was sent, and L is the same at each moment as if the time constant had been changed in one
/// state.
#[test]
fn reloads_with_other_time_constants_keep_the_lag() {
    const PERIOD: Duration = Duration::from_micros(500);
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let texts = ["120.0", "30.0", "86400.0", "0.1", "240.0"].map(with_lag);
    let tables: HashMap<u64, CoefficientTable> = texts.iter().map(|text| table(text)).map(|t| (t.id(), t)).collect();
    let mut raw = RawReader::connect(id("imu-g"), &domain.options()).unwrap();
    let mut acquisition = connect(&domain, LagOption::Service, None);
    let (mut model, mut flagged, started) = (Lag::new(0), Vec::new(), Instant::now());
    let mut samples = whole_recording(100_000).into_iter();
    let mut step = |acquisition: &mut Acquisition| {
        let sample = samples.next().unwrap();
        let due = started + PERIOD * u32::try_from(sample.sequence).unwrap();
        while Instant::now() < due {
            std::thread::yield_now();
        }
        let increment = feed(acquisition, &sample);
        let sent = raw.receive_timeout(TIMEOUT).unwrap().unwrap();
        model.lag_ns = sent.lag_ns;
        let mut expected = RawSample { session: sent.session, sent_ns: sent.sent_ns, ..sample };
        model.follow(&expected);
        model.fill(&mut expected);
        assert_eq!(sent, expected);
        assert_exact(&increment, &tables[&increment.table], &sent);
        increment
    };
    step(&mut acquisition);
    for text in &texts {
        let new = table(text);
        domain.replace("imu-g.toml", text);
        let mut count = 0;
        let until = Instant::now() + TIMEOUT;
        loop {
            assert!(Instant::now() < until, "no increment with the time constant of {text}");
            let increment = step(&mut acquisition);
            count += u32::from(is_lag_unknown(&increment));
            if increment.table == new.id() && !is_lag_unknown(&increment) {
                break;
            }
        }
        assert_eq!(acquisition.lag().state().lag_ns, new.lag_ns());
        flagged.push(count);
    }
    println!("flagged samples after each reload: {flagged:?}");
    assert!(flagged.iter().all(|count| *count > 0), "every reload had another time constant");
    assert_eq!(domain.imu_status()["gaps"], 0);
    service.terminate();
}

/// An acquisition whose time constant is not the table's is flagged and counted for every sample, and shown, until one
/// adopts the table's.
#[test]
fn a_table_with_another_time_constant_is_shown_until_it_is_adopted() {
    const SENT: u64 = 100;
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let samples = whole_recording(100_000);
    let mut next = samples.iter();
    let shows = |flagged: u64, lag_s: f64, sample_lag_s: f64, other: Option<&str>| {
        let imu = domain.imu_status();
        assert_eq!((&imu["flagged"]["lag-unknown"], &imu["lag_s"]), (&flagged.into(), &lag_s.into()));
        assert_eq!(imu["sample_lag_s"], sample_lag_s);
        let text = domain.run_ok(&["status"]);
        let line = text.lines().find(|line| line.contains("OTHER LAG")).map(str::trim);
        assert_eq!(line, other, "{text}");
        assert!(flagged == 0 || text.contains(&format!("lag-unknown {flagged}")), "{text}");
    };
    let mut acquisition = connect(&domain, fixed(240.0), None);
    (0..SENT).for_each(|_| assert!(!is_lag_unknown(&feed(&mut acquisition, next.next().unwrap()))));
    shows(0, 240.0, 240.0, None);
    let other = with_lag("120.0");
    domain.replace("imu-g.toml", &other);
    let mut flagged = 0;
    while flagged < SENT {
        let increment = feed(&mut acquisition, next.next().unwrap());
        // All of the new table, and none of the old one.
        assert_eq!(is_lag_unknown(&increment), increment.table == table(&other).id());
        flagged += u64::from(is_lag_unknown(&increment));
    }
    let words = "OTHER LAG    that of the samples is 240 s: the transient terms are left out, flagged lag-unknown";
    shows(SENT, 120.0, 240.0, Some(words));
    drop(acquisition);
    let mut acquisition = connect(&domain, LagOption::Service, None);
    (0..SENT).for_each(|_| assert!(!is_lag_unknown(&feed(&mut acquisition, next.next().unwrap()))));
    shows(SENT, 120.0, 120.0, None);
    service.terminate();
}

#[test]
fn a_state_of_another_clock_is_not_used() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", &with_lag("1.0"));
    let service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
    let samples = whole_recording(300);
    let mut kept = Lag::new(0);
    kept.follow(&RawSample { telemetry_ns: u64::MAX / 2, ..samples[0] });
    let mut acquisition = connect(&domain, LagOption::Service, None);
    acquisition.lag().restore(&kept);
    // As after a start of the machine: the clock begins again, and the lag is known after three time constants.
    for sample in &samples {
        assert_eq!(is_lag_unknown(&feed(&mut acquisition, sample)), sample.sequence < 60, "{}", sample.sequence);
    }
    service.terminate();
}

/// The subscribers of the status of a domain.
pub(crate) fn status_readers(domain: &TestDomain) -> usize {
    let node = join(domain.client_domain()).unwrap();
    let status = node.service_builder(&stream::status_name()).publish_subscribe::<[u8]>().open().unwrap();
    subscribers_of(domain.client_domain(), &status).pids.len()
}

#[test]
fn flags_of_another_cause_are_asked_for_once_a_table_and_occupy_no_place() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let mut acquisition = connect(&domain, LagOption::Service, None);
    assert_eq!(status_readers(&domain), 0);
    // A dead thermistor: the transient term of A1 is unknown in every increment.
    let mut samples = whole_recording(100_000).into_iter().map(|mut sample| {
        sample.accelerometers.head_temperature[0] = f64::NAN;
        sample
    });
    // The time constant of the first table is known already; that of the second must be asked for.
    for seconds in ["240.0", "120.0"] {
        let text = with_lag(seconds);
        domain.replace("imu-g.toml", &text);
        wait_until("the table, and the end of the question", || {
            let increment = feed(&mut acquisition, &samples.next().unwrap());
            assert!(is_lag_unknown(&increment));
            increment.table == table(&text).id()
                && acquisition.lag().state().lag_ns == table(&text).lag_ns()
                && status_readers(&domain) == 0
        });
        for (count, sample) in samples.by_ref().take(2000).enumerate() {
            assert!(is_lag_unknown(&feed(&mut acquisition, &sample)));
            assert!(count % 100 > 0 || status_readers(&domain) == 0);
        }
    }
    service.terminate();
}

/// An application that measures its temperature seldom gives its last readings again while increments are flagged.
#[test]
fn a_reading_that_is_given_again_is_none_but_asks_for_the_time_constant() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let mut samples = whole_recording(100_000).into_iter();
    let mut acquisition = connect(&domain, LagOption::Service, None);
    let readings = [(Sensor::A1, 1.2), (Sensor::A2, 1.3), (Sensor::A3, 1.4)];
    let gyroscopes = [(Sensor::G1, 1.2), (Sensor::G2, 1.3), (Sensor::G3, 1.42)];
    let readings = [readings, gyroscopes].concat();
    let read = |acquisition: &mut Acquisition, offset: f64, time_ns: u64| {
        readings.iter().for_each(|(sensor, value)| acquisition.lag().read(*sensor, value + offset, time_ns));
    };
    read(&mut acquisition, 0.0, 1);
    read(&mut acquisition, 0.1, 1_000_000_000);
    let sensors = acquisition.lag().state().sensors;
    let new = with_lag("120.0");
    domain.replace("imu-g.toml", &new);
    wait_until("an increment of the new table that is not flagged", || {
        let increment = send(&mut acquisition, &samples.next().unwrap());
        if is_lag_unknown(&increment) {
            read(&mut acquisition, 0.1, 1_000_000_000);
        }
        increment.table == table(&new).id() && !is_lag_unknown(&increment)
    });
    let limits = Some(ReadingLimits::of(&table(&new)));
    let lag_ns = 120_000_000_000;
    assert_eq!(*acquisition.lag().state(), Lag { lag_ns, sensors, boot: boot(), limits, ..Lag::default() });
    service.terminate();
}

#[test]
fn a_service_that_is_stopped_while_an_acquisition_connects_is_asked_later() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    service.stop();
    let mut acquisition = connect(&domain, LagOption::Service, None);
    assert_eq!(acquisition.lag().state().lag_ns, 0);
    // What is sent before the service answers has no lag.
    let mut samples = whole_recording(100_000).into_iter();
    let first = samples.next().unwrap();
    acquisition.lag().follow(&first);
    let mut loan = acquisition.loan().unwrap();
    *loan = RawSample { session: loan.session, ..first };
    acquisition.send(loan).unwrap();
    service.resume();
    let increment = acquisition.receive_timeout(TIMEOUT).unwrap().unwrap();
    assert!(is_lag_unknown(&increment));
    wait_until("the time constant", || !is_lag_unknown(&feed(&mut acquisition, &samples.next().unwrap())));
    assert_eq!(acquisition.lag().state().lag_ns, LAG_NS);
    service.terminate();
}

#[test]
fn a_table_without_a_lag_keeps_it_for_the_next_one() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let plain = without_lag();
    let mut acquisition = connect(&domain, LagOption::Service, None);
    let samples = whole_recording(100_000);
    let mut next = samples.iter();
    let mut last = 0;
    for text in [plain.as_str(), WHOLE_TABLE] {
        domain.replace("imu-g.toml", text);
        let new = table(text);
        wait_until("the table", || {
            let increment = feed(&mut acquisition, next.next().unwrap());
            last = increment.sequence as usize;
            assert!(!is_lag_unknown(&increment));
            increment.table == new.id()
        });
    }
    assert_eq!(*acquisition.lag().state(), {
        let limits = Some(ReadingLimits::of(&table(WHOLE_TABLE)));
        let mut model = Lag { boot: boot(), limits, ..Lag::new(LAG_NS) };
        samples[..=last].iter().for_each(|sample| model.follow(sample));
        model
    });
    service.terminate();
}

/// The table without lag and transient terms.
fn without_lag() -> String {
    let lines = WHOLE_TABLE.lines().filter(|line| !line.contains("lag]") && !line.contains("time_constant"));
    let plain = lines.collect::<Vec<_>>().join("\n");
    ["-35.0", "12.5", "0.83", "-0.046"]
        .iter()
        .fold(plain, |text, transient| text.replace(&format!(", transient = {transient}"), ""))
}

/// A table is put in force, taken back before the next reading, and put in force again: each time its time constant is
/// learnt.
#[test]
fn a_table_that_returns_is_asked_for_again() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let samples = whole_recording(100_000);
    let (first, second) = (with_lag("100.0"), WHOLE_TABLE.to_owned());
    for [base, other] in [[&without_lag(), &second], [&first, &second]] {
        let (base, other) = (base.as_str(), other.as_str());
        // Puts a table in force, and sends samples without readings until it answers. Returns whether its answer is
        // flagged.
        let put = |acquisition: &mut Acquisition, next: &mut std::slice::Iter<'_, RawSample>, text: &str| {
            domain.replace("imu-g.toml", text);
            let new = table(text);
            let mut last = None;
            wait_until("the table", || {
                let increment = send(acquisition, next.next().unwrap());
                last = Some(is_lag_unknown(&increment));
                increment.table == new.id()
            });
            last.unwrap()
        };
        let mut next = samples.iter();
        domain.replace("imu-g.toml", base);
        wait_until("the table", || domain.imu_status()["table"] == table(base).digest().to_string());
        let mut acquisition = connect(&domain, LagOption::Service, None);
        feed(&mut acquisition, next.next().unwrap());
        assert!(put(&mut acquisition, &mut next, other));
        put(&mut acquisition, &mut next, base);
        wait_until("the end of the question", || {
            feed(&mut acquisition, next.next().unwrap());
            acquisition.lag().state().lag_ns == table(base).lag_ns() && status_readers(&domain) == 0
        });
        put(&mut acquisition, &mut next, other);
        wait_until("the time constant", || !is_lag_unknown(&feed(&mut acquisition, next.next().unwrap())));
        assert_eq!(acquisition.lag().state().lag_ns, LAG_NS);
    }
    service.terminate();
}

#[test]
fn samples_are_resent_with_the_lag_that_they_were_sent_with() {
    let domain = TestDomain::new();
    let mut service = domain.serve_whole();
    let exact = table(WHOLE_TABLE);
    let samples = whole_recording(600);
    let expected = completed(&samples, LAG_NS, "SN 42");
    let mut acquisition = connect(&domain, LagOption::Service, Some("SN 42"));
    let mut answered = 0;
    for (part, rest) in samples.chunks(60).zip(expected.chunks(60)) {
        // Samples wait for the next service, while the temperature goes on.
        service.stop();
        for sample in part {
            acquisition.lag().follow(sample);
            let mut loan = acquisition.loan().unwrap();
            *loan = RawSample { session: loan.session, ..*sample };
            acquisition.send(loan).unwrap();
        }
        service.kill();
        service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
        for complete in rest {
            assert_exact(&acquisition.receive_timeout(TIMEOUT).unwrap().unwrap(), &exact, complete);
            answered += 1;
        }
    }
    assert_eq!(answered, samples.len());
    service.terminate();
}

#[test]
fn a_sample_that_was_merged_has_the_lag_of_its_last_period() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let samples = whole_recording(400);
    let mut acquisition = connect(&domain, LagOption::Service, None);
    service.stop();
    let mut merged = None::<isotherm_client::Loan>;
    for sample in &samples {
        acquisition.lag().follow(sample);
        let mut loan = match merged.take() {
            Some(mut first) => {
                first.merge(sample).unwrap();
                first
            }
            None => acquisition.loan().unwrap(),
        };
        if loan.interval_ns == 0 {
            *loan = RawSample { session: loan.session, ..*sample };
        }
        match acquisition.send(loan) {
            Ok(()) => {}
            Err(SendError::Full(loan)) => {
                assert_eq!(loan.lag_ns, 0, "it is as the application has left it");
                merged = Some(loan);
            }
            Err(other) => panic!("{other}"),
        }
    }
    service.resume();
    let depth = acquisition.depth();
    for _ in 0..depth {
        acquisition.receive_timeout(TIMEOUT).unwrap().unwrap();
    }
    let last = acquisition.compensate(merged.unwrap(), TIMEOUT).unwrap();
    let mut expected = samples[depth];
    samples[depth + 1..].iter().for_each(|later| expected.merge(later).unwrap());
    let complete = completed(&samples, LAG_NS, "")[samples.len() - 1];
    expected.lag_ns = complete.lag_ns;
    expected.accelerometers.head_lagged = complete.accelerometers.head_lagged;
    expected.gyroscopes.head_lagged = complete.gyroscopes.head_lagged;
    assert_eq!(last.interval_ns, 50_000_000 * (samples.len() - depth) as u64);
    assert_exact(&last, &table(WHOLE_TABLE), &expected);
    service.terminate();
}

#[test]
fn a_successor_goes_on_with_a_kept_lag() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let exact = table(WHOLE_TABLE);
    let samples = whole_recording(200);
    let expected = completed(&samples, LAG_NS, "");
    let mut kept = None::<String>;
    for part in 0..10 {
        let mut acquisition = connect(&domain, LagOption::Service, None);
        if let Some(text) = &kept {
            acquisition.lag().restore(&serde_json::from_str(text).unwrap());
        }
        for index in part * 20..(part + 1) * 20 {
            let increment = feed(&mut acquisition, &samples[index]);
            assert_exact(&increment, &exact, &expected[index]);
        }
        kept = Some(serde_json::to_string(acquisition.lag().state()).unwrap());
    }
    // Said to be soaked, it is another one.
    let mut acquisition = connect(&domain, LagOption::Service, None);
    let first = feed(&mut acquisition, &samples[180]);
    assert_ne!(first.velocity_increment, answer(Some(&exact), &expected[180]).velocity_increment);
    service.terminate();
}

/// Nobody knows what the temperatures were before an acquisition was started, or a device was.
#[test]
fn an_acquisition_begins_with_an_unknown_lag_and_so_does_a_session() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", &with_lag("1.0"));
    let service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
    let samples = whole_recording(400);
    let mut acquisition = Acquisition::connect(&id("imu-g"), &domain.options()).unwrap();
    for (index, sample) in samples.iter().enumerate() {
        if index == 200 {
            acquisition.begin_session().unwrap();
        }
        // Three time constants at 20 Hz.
        assert_eq!(is_lag_unknown(&feed(&mut acquisition, sample)), index % 200 < 60, "{index}");
    }
    acquisition.begin_session().unwrap();
    acquisition.lag().soaked();
    assert!(!is_lag_unknown(&feed(&mut acquisition, &samples[0])));
    service.terminate();
}

/// A thermometer that fails for a second does not poison the lag, and one call feeds all sensors.
#[test]
fn a_fault_of_the_thermometer_is_no_reading() {
    const SECOND: u64 = 1_000_000_000;
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let exact = table(WHOLE_TABLE);
    let mut acquisition = connect(&domain, LagOption::Service, None);
    let mut healthy = whole_recording(1)[0];
    for triad in [&mut healthy.accelerometers, &mut healthy.gyroscopes] {
        triad.head_temperature = [2.5; 3];
        triad.board_temperature = [2.5; 3];
    }
    let mut round_trip = |second: u64, head: f64| {
        acquisition.lag().reading_of_all(head, second * SECOND);
        let sample = RawSample { sequence: second, timestamp_ns: second * SECOND, ..healthy };
        (send(&mut acquisition, &sample), sample)
    };
    for second in 1..=100 {
        // 0.9 V are within the table, 0 V are not.
        let head = match second {
            50..52 => 0.9,
            70..72 => 0.0,
            _ => 2.5,
        };
        let (increment, sample) = round_trip(second, head);
        assert_eq!(is_lag_unknown(&increment), head < 2.5, "{second}");
        if head == 2.5 {
            let head_lagged = [2.5; 3];
            let accelerometers = isotherm_client::Triad { head_lagged, ..sample.accelerometers };
            let gyroscopes = isotherm_client::Triad { head_lagged, ..sample.gyroscopes };
            assert_exact(&increment, &exact, &RawSample { lag_ns: LAG_NS, accelerometers, gyroscopes, ..sample });
        }
    }
    service.terminate();
}

#[test]
fn samples_of_another_device_are_flagged() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", &WHOLE_TABLE.replace("gravity =", "serial = \"SN 42\"\ngravity ="));
    let service = domain.serve(&["--imu", "imu-g=imu-g.toml"]);
    let sample = whole_recording(1)[0];
    let flagged = |serial: Option<&str>, own: u64| {
        let mut acquisition = connect(&domain, LagOption::None, serial);
        let increment = send(&mut acquisition, &RawSample { device: own, ..sample });
        Flags(increment.flags).intersects(Flags::OTHER_DEVICE)
    };
    for (serial, own, expected) in [
        (Some("SN 42"), 0, false),
        (Some("\tSN 42 "), 0, false),
        (Some("SN 43"), 0, true),
        (Some(" "), 0, false),
        (None, 0, false),
        // A recording of another device has its own number.
        (Some("SN 42"), device("SN 43"), true),
        (Some("SN 43"), device("SN 42"), false),
    ] {
        assert_eq!(flagged(serial, own), expected, "{serial:?} {own:x}");
    }
    service.terminate();
}

#[test]
fn any_bits_in_the_new_fields_are_survived() {
    let domain = TestDomain::new();
    let service = domain.serve_whole();
    let exact = table(WHOLE_TABLE);
    let mut acquisition = connect(&domain, LagOption::Service, Some("SN 42"));
    let base = whole_recording(1)[0];
    let mut state = 11_u64;
    let mut word = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        match state >> 61 {
            0 => 0,
            1 => u64::MAX,
            2 => [LAG_NS, f64::NAN.to_bits(), f64::INFINITY.to_bits(), 1.0_f64.to_bits()][(state >> 32) as usize % 4],
            _ => state ^ state >> 31,
        }
    };
    for sequence in 0..20_000 {
        let mut raw = RawSample { sequence, lag_ns: word(), device: word() | 1, ..base };
        let triad = |triad: &mut isotherm_client::Triad, word: &mut dyn FnMut() -> u64| {
            triad.positive_pulses = [(); 3].map(|()| word() as u32);
            triad.head_lagged = [(); 3].map(|()| f64::from_bits(word()));
        };
        triad(&mut raw.accelerometers, &mut word);
        triad(&mut raw.gyroscopes, &mut word);
        if sequence % 3 == 0 {
            raw.gyroscopes.head_temperature = [(); 3].map(|()| f64::from_bits(word()));
            raw.gyroscopes.board_temperature = [(); 3].map(|()| f64::from_bits(word()));
        }
        if raw.lag_ns == 0 {
            raw.lag_ns = 1;
        }
        assert_exact(&feed(&mut acquisition, &raw), &exact, &raw);
    }
    assert_eq!(domain.imu_status()["compensated"], 20_000);
    service.terminate();
}
