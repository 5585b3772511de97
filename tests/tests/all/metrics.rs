//! Metrics for Prometheus: every metric is updated and documented, and misbehaving peers do not stop others from
//! reading them.

use isotherm_client::transport::stream::{Ipc, raw_name};
use isotherm_client::{Flags, RawSample, join, monotonic_ns};
use isotherm_shared::wire::Triad;
use isotherm_tests::{
    Needs, Process, TABLE, TIMEOUT, TestDomain, exchange, id, metrics_page, recording, round_trip, skip, text,
    wait_until,
};
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::Pid;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use std::{fs, thread};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// A table for `imu-a` of a whole IMU, with everything that a sample can be flagged for.
fn whole() -> String {
    let interval_s = recording()[0].interval_ns as f64 / 1e9;
    include_str!("../../../examples/tables/imu-whole.toml")
        .replace("\"imu-whole\"", "\"imu-a\"")
        .replace("format = 2", "format = 3")
        .replace("[temperature]", &format!("nominal_interval_s = {interval_s:?}\n\n[temperature]"))
}

/// Starts a service for `imu-a`, which may have no table yet, and the exporter of its metrics.
fn serve(domain: &TestDomain) -> (Process, Process, String) {
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--allow-uncalibrated"]);
    let (exporter, address) = domain.export();
    wait_until("the first page", || metrics_page(&address).is_some());
    (service, exporter, address)
}

fn scrape(address: &str) -> Scrape {
    Scrape::read(&metrics_page(address).unwrap())
}

/// The first page that shows these values for `imu-a`, and when its last sample came; a page may be half a second old,
/// and that time is known within a second.
fn scrape_with(address: &str, values: &[(&str, f64)]) -> Scrape {
    let mut page = None;
    wait_until(&format!("{values:?}"), || {
        let scrape = scrape(address);
        let shows =
            |(name, value): &(&str, f64)| scrape.samples.get(&format!("{name}{{imu=\"imu-a\"}}")) == Some(value);
        let last = scrape.samples.contains_key("isotherm_last_sample_timestamp_seconds{imu=\"imu-a\"}");
        let shows_all = last && values.iter().all(shows);
        page = Some(scrape);
        shows_all
    });
    page.unwrap()
}

/// A parsed page of metrics in the Prometheus text format.
struct Scrape {
    /// The type of each family.
    kinds: BTreeMap<String, String>,
    /// Values; the key is name and labels as on the page.
    samples: BTreeMap<String, f64>,
}

impl Scrape {
    /// Parses a page. Asserts that HELP, TYPE and samples have the order that the format requires.
    fn read(page: &str) -> Self {
        let (mut kinds, mut samples) = (BTreeMap::new(), BTreeMap::new());
        let mut family = String::new();
        for line in page.lines() {
            if let Some(help) = line.strip_prefix("# HELP ") {
                let (name, help) = help.split_once(' ').unwrap();
                assert!(!help.is_empty() && !kinds.contains_key(name), "{line}");
                family = name.to_owned();
            } else if let Some(kind) = line.strip_prefix("# TYPE ") {
                assert_eq!(kind.split_once(' ').unwrap().0, family, "{line}");
                kinds.insert(family.clone(), kind.split_once(' ').unwrap().1.to_owned());
            } else {
                let (series, value) = line.rsplit_once(' ').unwrap();
                let name = series.split('{').next().unwrap();
                let suffix = name.strip_prefix(family.as_str()).unwrap_or_else(|| panic!("{line} within {family}"));
                let histogram = kinds[&family] == "histogram";
                assert!(
                    suffix.is_empty() != histogram && (!histogram || matches!(suffix, "_bucket" | "_sum" | "_count")),
                    "{line}"
                );
                assert!(samples.insert(series.to_owned(), value.parse().unwrap()).is_none(), "{line} is there twice");
            }
        }
        Self { kinds, samples }
    }

    fn value(&self, series: &str) -> f64 {
        *self.samples.get(series).unwrap_or_else(|| panic!("{series} is not there"))
    }

    /// The names of all samples; queries use these.
    fn names(&self) -> BTreeSet<String> {
        self.samples.keys().map(|series| series.split('{').next().unwrap().to_owned()).collect()
    }
}

/// Sends arbitrary raw samples one by one, without the checks of the client library.
struct RawSender<'a> {
    domain: &'a TestDomain,
    publisher: iceoryx2::port::publisher::Publisher<Ipc, RawSample, ()>,
    sent: u64,
}

impl RawSender<'_> {
    fn send(&mut self, sample: RawSample) {
        self.sent += 1;
        self.publisher.send_copy(sample).unwrap();
        let sent = self.sent;
        wait_until("a sample's receipt", || self.domain.imu_status()["received"] == sent);
    }
}

fn with_temperature(triad: Triad, value: f64) -> Triad {
    Triad { head_temperature: [value; 3], board_temperature: [value; 3], ..triad }
}

#[test]
fn every_metric_is_updated() {
    let domain = TestDomain::new();
    // The service starts without a table.
    let (service, exporter, address) = serve(&domain);
    let node = join(domain.client_domain()).unwrap();
    let raw = node.service_builder(&raw_name(&id("imu-a"))).publish_subscribe::<RawSample>().open().unwrap();
    let discard = iceoryx2::prelude::BackpressureStrategy::DiscardData;
    let publisher = raw.publisher_builder().backpressure_strategy(discard).create().unwrap();
    let mut sender = RawSender { domain: &domain, publisher, sent: 0 };
    let sent_ns = || monotonic_ns().saturating_sub(1_000_000);
    let plain = RawSample { session: 1, sequence: 0, sent_ns: sent_ns(), ..recording()[0] };
    sender.send(plain);
    // The file is not there.
    scrape_with(&address, &[("isotherm_reload_failed", 1.0)]);
    for text in [TABLE, "format = 4\n", &whole()] {
        let digest = domain.imu_status()["table"].clone();
        let refusals = domain.imu_status()["refusals"].clone();
        if text == whole() {
            domain.accept("imu-a", text);
        }
        domain.replace("imu-a.toml", text);
        wait_until("a reload or a refusal", || {
            let status = domain.imu_status();
            status["table"] != digest || status["refusals"] != refusals
        });
    }

    let both = |triad: Triad| RawSample { accelerometers: triad, gyroscopes: triad, ..plain };
    let all = |value: f64| both(with_temperature(plain.accelerometers, value));
    let fast = both(Triad { positive_pulses: [u32::MAX; 3], ..plain.accelerometers });
    let stale = RawSample { timestamp_ns: 100_000_000_000, telemetry_ns: 1, ..plain };
    let other = RawSample { device: 1, interval_ns: plain.interval_ns / 5 * 6, ..plain };
    let odd = [all(-9.0), all(9.0), all(f64::NAN), fast, stale, other, RawSample { interval_ns: 0, ..plain }];
    for (sample, sequence) in odd.into_iter().zip(10..) {
        sender.send(RawSample { sequence, ..sample });
    }
    // Two more sessions, of which the first has another clock than the one before.
    // Both clocks go on alike, however long the sending takes.
    let now_ns = sent_ns();
    for (session, timestamp_ns, sent_ns) in [(2, 1_000_000_000, now_ns - 25_000_000), (3, 1_025_000_000, now_ns)] {
        sender.send(RawSample { session, timestamp_ns, sent_ns, ..plain });
    }
    let gyroscopes = Triad { head_temperature: [1.5; 3], board_temperature: [3.5; 3], ..Triad::default() };
    sender.send(RawSample { sequence: 3, sent_ns: sent_ns(), gyroscopes, ..plain });

    let values = [
        ("isotherm_samples_received_total", 11.0),
        ("isotherm_increments_total", 11.0),
        ("isotherm_samples_missing_total", 9.0),
        ("isotherm_gaps_total", 1.0),
        ("isotherm_samples_repeated_total", 1.0),
        ("isotherm_sessions_total", 3.0),
        ("isotherm_session_missing_periods_total", 9.0),
        ("isotherm_session_unknown_total", 1.0),
        ("isotherm_reloads_total", 1.0),
        ("isotherm_reload_failed", 0.0),
        ("isotherm_acquisition_connected", 1.0),
        ("isotherm_latency_seconds_count", 11.0),
    ];
    let scrape = scrape_with(&address, &values);
    // The samples have no lagged temperature, and the one of NaN no velocity increments.
    let all_names: Vec<_> = Flags::NAMES.iter().map(|(_, name)| *name).collect();
    for flag in all_names {
        assert!(scrape.value(&format!("isotherm_flagged_total{{imu=\"imu-a\",flag=\"{flag}\"}}")) > 0.0, "{flag}");
    }
    // A test cannot make these two rise: the transport does not fail, and a worker is not held back while a core is
    // free.
    let excluded = ["isotherm_transport_errors_total", "isotherm_worker_held_back_seconds_total"];
    for (series, value) in &scrape.samples {
        let name = series.split('{').next().unwrap();
        if scrape.kinds.get(name).is_some_and(|kind| kind == "counter") && !excluded.contains(&name) {
            assert!(*value > 0.0, "{series} is not fed");
        }
    }
    assert!(scrape.value("isotherm_reloads_refused_total{imu=\"imu-a\"}") >= 2.0);
    let bucket = |le: &str| scrape.value(&format!("isotherm_latency_seconds_bucket{{imu=\"imu-a\",le=\"{le}\"}}"));
    assert_eq!((bucket("2e-7"), bucket("+Inf")), (0.0, 11.0));
    let buckets: Vec<_> = ["1e-6", "1e-5", "1e-4", "1e-3", "1e-2", "1e-1", "1e0"].map(bucket).into();
    assert!(buckets.is_sorted() && bucket("5e-4") < 11.0, "cumulative; some were sent a millisecond ago: {buckets:?}");
    assert!(scrape.value("isotherm_latency_seconds_sum{imu=\"imu-a\"}") > 1e-3);
    let Triad { head_temperature, board_temperature, .. } = plain.accelerometers;
    for (axis, place, temperature) in [
        ("a1", "head", head_temperature[0]),
        ("a3", "board", board_temperature[2]),
        ("g2", "head", 1.5),
        ("g3", "board", 3.5),
    ] {
        let value = |name: &str| scrape.value(&format!("{name}{{imu=\"imu-a\",axis=\"{axis}\",place=\"{place}\"}}"));
        assert_eq!(value("isotherm_telemetry"), temperature);
        assert_eq!((value("isotherm_telemetry_range_low"), value("isotherm_telemetry_range_high")), (0.9, 4.2));
    }
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs_f64();
    let started = scrape.value("process_start_time_seconds");
    for name in ["isotherm_table_taken_timestamp_seconds", "isotherm_table_modified_timestamp_seconds"] {
        let time = scrape.value(&format!("{name}{{imu=\"imu-a\"}}"));
        assert!((started - 1.0..=now).contains(&time), "{name} {time}, from {started} to {now}");
    }
    assert!(scrape.value("process_resident_memory_bytes") > 1e6 && scrape.value("process_open_fds") > 10.0);
    assert_eq!(scrape.value("isotherm_latency_budget_seconds"), 5e-5);
    assert!(
        scrape.samples.keys().any(|series| series.starts_with("isotherm_table_info{imu=\"imu-a\",table=\"sha256:"))
    );
    exporter.terminate();
    service.terminate();
}

#[test]
fn an_imu_without_gyroscopes_has_no_series_of_them() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let (service, _exporter, address) = serve(&domain);
    let flags = |scrape: &Scrape| {
        let of_flag =
            |series: &String| series.split_once("flag=\"").map(|(_, rest)| rest.trim_end_matches("\"}").to_owned());
        scrape.samples.keys().filter_map(of_flag).collect::<BTreeSet<_>>()
    };
    let has_gyroscopes = |scrape: &Scrape| scrape.samples.keys().any(|series| series.contains("axis=\"g"));
    let names = |bits: &dyn Fn(u32) -> bool| {
        let named = Flags::NAMES.into_iter().filter(|(bit, _)| bits(*bit));
        named.map(|(_, name)| name.to_owned()).collect::<BTreeSet<_>>()
    };
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    let plain = scrape_with(&address, &[("isotherm_increments_total", 1.0)]);
    let before = plain.samples.keys().cloned().collect::<BTreeSet<_>>();
    assert_eq!(flags(&plain), names(&|bit| bit < 21 || (24..=27).contains(&bit)));
    assert!(!has_gyroscopes(&plain), "{before:?}");
    assert!(plain.samples.values().all(|value| !value.is_nan()));

    domain.accept("imu-a", &whole());
    domain.replace("imu-a.toml", &whole());
    wait_until("gyroscopes", || has_gyroscopes(&scrape(&address)));
    assert_eq!(flags(&scrape(&address)), names(&|_| true));
    // The sample has no lagged temperature.
    let accelerometers = recording()[0].accelerometers;
    let sample = RawSample { gyroscopes: accelerometers, ..recording()[0] };
    round_trip(&mut domain.acquisition("imu-a"), &sample);
    let lag_unknown = "isotherm_flagged_total{imu=\"imu-a\",flag=\"lag-unknown\"}";
    wait_until("the flag", || scrape(&address).value(lag_unknown) == 1.0);
    domain.accept("imu-a", TABLE);
    domain.replace("imu-a.toml", TABLE);
    wait_until("no gyroscopes", || !has_gyroscopes(&scrape(&address)));
    // What was counted stays.
    let mut after = scrape(&address).samples;
    assert_eq!(after.remove(lag_unknown), Some(1.0));
    // The table is another one, and has changed against the one before.
    let lasting =
        |series: &&String| !["isotherm_table_info", "isotherm_table_change"].iter().any(|it| series.starts_with(it));
    let left: BTreeSet<_> = after.keys().filter(lasting).collect();
    assert_eq!(left, before.iter().filter(lasting).collect());
    service.terminate();
}

/// All words in `text` that have the form of a metric's name.
fn metrics_in(text: &str) -> BTreeSet<String> {
    let words = text.split(|character: char| !character.is_ascii_alphanumeric() && character != '_');
    let ours = words.filter(|word| word.starts_with("isotherm_") || word.starts_with("process_"));
    ours.map(str::to_owned).collect()
}

/// The flags that queries in `text` name one by one; not those of a pattern with other characters than `|`.
fn flags_in(text: &str) -> BTreeSet<String> {
    let values = text
        .split("flag=")
        .skip(1)
        .filter_map(|rest| rest.trim_start_matches('~').strip_prefix('"')?.split('"').next());
    let plain = |value: &&str| value.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-|".contains(&byte));
    values.filter(plain).flat_map(|value| value.split('|')).map(str::to_owned).collect()
}

#[test]
fn dashboard_and_documents_name_only_existing_metrics_and_every_one_is_explained() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let (service, _exporter, address) = serve(&domain);
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    let scrape = scrape_with(&address, &[("isotherm_increments_total", 1.0)]);
    let names = scrape.names();

    let dashboard: Value =
        serde_json::from_str(&fs::read_to_string(format!("{ROOT}/examples/grafana-dashboard.json")).unwrap()).unwrap();
    let mut used = BTreeSet::new();
    let mut places = BTreeSet::new();
    for panel in dashboard["panels"].as_array().unwrap() {
        assert!(places.insert(panel["id"].as_u64()), "{panel}");
        for target in panel["targets"].as_array().into_iter().flatten() {
            assert_eq!(target["datasource"]["uid"], "${datasource}");
            used.extend(metrics_in(target["expr"].as_str().unwrap()));
        }
    }
    for variable in dashboard["templating"]["list"].as_array().unwrap() {
        used.extend(metrics_in(&variable["query"].to_string()));
    }
    assert!(used.is_subset(&names), "in the dashboard only: {:?}", used.difference(&names));

    let documents = fs::read_to_string(format!("{ROOT}/docs/operate.md")).unwrap();
    let (_, documents) = documents.split_once("\n## Metrics\n").unwrap();
    let documents = documents.split("\n## ").next().unwrap();
    let alerts = flags_in(documents);
    for flag in ["late", "lag-unknown", "other-device", "g-unknown", "interval-not-nominal"] {
        assert!(alerts.contains(flag), "no alert rule for {flag}");
    }
    let of_the_dashboard = flags_in(&dashboard["panels"].to_string().replace("\\\"", "\""));
    let known_flags: BTreeSet<_> = Flags::NAMES.into_iter().map(|(_, name)| name.to_owned()).collect();
    assert!(
        alerts.is_subset(&known_flags) && of_the_dashboard.is_subset(&known_flags),
        "{alerts:?} {of_the_dashboard:?}"
    );
    assert!(of_the_dashboard.contains("g-unknown"), "{of_the_dashboard:?}");
    let all: Vec<_> = scrape.kinds.keys().map(String::as_str).collect();
    let explained = domain.run_ok(&["explain", &all.join("|")]);
    for (name, kind) in &scrape.kinds {
        let heading = explained.lines().find_map(|line| line.strip_prefix(&format!("metric {name} ({kind}; ")));
        let labels = heading.unwrap_or_else(|| panic!("{name}, a {kind}, is not explained:\n{explained}"));
        let labels = labels.trim_end_matches(')').replace("no labels", "");
        let own = |series: &&String| series.split('{').next() == Some(name.as_str());
        for series in scrape.samples.keys().filter(own) {
            let wanted = labels.split(", ").filter(|label| !label.is_empty());
            assert!(wanted.clone().all(|label| series.contains(&format!("{label}=\""))), "{series}: {labels}");
            assert_eq!(series.matches("=\"").count(), wanted.count(), "{series}: {labels}");
        }
    }
    let listed = domain.run_ok(&["explain"]);
    let of_metrics = listed.lines().filter(|line| metrics_in(line.split_whitespace().next().unwrap_or("")).len() == 1);
    assert_eq!(of_metrics.count(), scrape.kinds.len(), "metrics that are not there are explained, too:\n{listed}");
    let mentioned = metrics_in(documents);
    let known: BTreeSet<_> = names.iter().chain(scrape.kinds.keys()).cloned().collect();
    let unknown: Vec<_> = mentioned.difference(&known).collect();
    assert!(unknown.is_empty(), "metrics in the documents only: {unknown:?}");
    service.terminate();
}

#[test]
fn misbehaving_peers_do_not_block_others() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let (service, exporter, address) = serve(&domain);
    let descriptors = || fs::read_dir(format!("/proc/{}/fd", exporter.pid())).unwrap().count();
    let before = descriptors();

    let idle: Vec<_> = (0..200).map(|_| TcpStream::connect(&address).unwrap()).collect();
    scrape(&address);
    assert!(descriptors() <= before + 20, "{before} before, {} now", descriptors());
    let mut slow = TcpStream::connect(&address).unwrap();
    slow.write_all(b"GET /metrics HTTP/1.1\r\n").unwrap();
    scrape(&address);
    slow.write_all(b"Host: x\r\n\r\n").unwrap();
    slow.set_read_timeout(Some(TIMEOUT)).unwrap();
    let mut first = [0; 12];
    slow.read_exact(&mut first).unwrap();
    assert_eq!(&first, b"HTTP/1.1 200", "a slow peer is served too");
    // The rest of the slow peer's page is still unread.
    scrape(&address);

    let status = |request: &[u8]| exchange(&address, request).lines().next().unwrap_or_default().to_owned();
    assert_eq!(status(b"GET / HTTP/1.1\r\n\r\n"), "HTTP/1.1 404 Not Found");
    assert!(exchange(&address, b"GET / HTTP/1.1\r\n\r\n").ends_with("the metrics are at /metrics\n"));
    assert_eq!(status(b"POST /metrics HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc"), "HTTP/1.1 405 Method Not Allowed");
    assert_eq!(status(&[b"\x16\x03\x01\x00\xff\0\xfe".as_slice(), b"\r\n\r\n"].concat()), "HTTP/1.1 400 Bad Request");
    let head = exchange(&address, b"HEAD /metrics HTTP/1.1\r\n\r\n");
    assert!(head.starts_with("HTTP/1.1 200 OK") && head.ends_with("\r\n\r\n"), "{head}");
    let mut huge = TcpStream::connect(&address).unwrap();
    huge.set_write_timeout(Some(TIMEOUT)).unwrap();
    let line = [b"X: ".as_slice(), &[b'x'; 1000], b"\r\n"].concat();
    // 100 MB if the server read all of it.
    let refused = (0..100_000).any(|_| huge.write_all(&line).is_err());
    assert!(refused, "headers without end are not refused");
    scrape(&address);

    // Peers that do not read their answers, and a flood of connections.
    let unread: Vec<_> = (0..50)
        .map(|_| {
            let mut stream = TcpStream::connect(&address).unwrap();
            stream.write_all(b"GET /metrics HTTP/1.1\r\n\r\n").unwrap();
            stream
        })
        .collect();
    let (served, begun) = (AtomicBool::new(false), Instant::now());
    thread::scope(|scope| {
        // The flood lasts until all pages have been received, so that none of them can come after it.
        scope.spawn(|| {
            let mut count = 0;
            while count < 2000 || !served.load(Ordering::Relaxed) && begun.elapsed() < 11 * TIMEOUT {
                drop(TcpStream::connect(&address));
                count += 1;
            }
        });
        // A newer connection replaces the oldest, so a scraper that is slow to send its request must try again.
        (0..10).for_each(|_| wait_until("a page during the flood", || metrics_page(&address).is_some()));
        served.store(true, Ordering::Relaxed);
    });
    let mut acquisition = domain.acquisition("imu-a");
    round_trip(&mut acquisition, &recording()[0]);
    drop((idle, slow, unread, huge));
    wait_until("their descriptors' return", || descriptors() <= before + 20);
    exporter.terminate();
    service.terminate();
}

#[test]
fn a_hanging_control_thread_makes_the_metrics_unavailable() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let (service, _exporter, address) = serve(&domain);
    let main = Pid::from_raw(service.pid().cast_signed());
    if ptrace::seize(main, ptrace::Options::empty()).is_ok() {
        ptrace::interrupt(main).unwrap();
        waitpid(main, Some(WaitPidFlag::__WALL)).unwrap();
        wait_until("the refusal", || metrics_page(&address).is_none());
        let answer = exchange(&address, b"GET /metrics HTTP/1.1\r\n\r\n");
        assert!(answer.starts_with("HTTP/1.1 503") && answer.contains("starting, or hangs"), "{answer}");
        ptrace::detach(main, None).unwrap();
        wait_until("metrics", || metrics_page(&address).is_some());
    } else {
        skip("this user may not trace a process", Needs::Machine);
    }
    service.terminate();
}

#[test]
fn the_exporter_waits_for_a_service_that_ends_and_returns() {
    let domain = TestDomain::new();
    let (exporter, address) = domain.export();
    exporter.wait_for_log("waiting for the service");
    assert!(metrics_page(&address).is_none());
    for _ in 0..2 {
        let service = domain.serve_recording();
        wait_until("metrics", || metrics_page(&address).is_some());
        service.kill();
        wait_until("none of a service that is dead", || metrics_page(&address).is_none());
    }
    exporter.terminate();
}

#[test]
fn a_port_that_others_can_reach_is_warned_about() {
    let domain = TestDomain::new();
    let exporter = domain.start(domain.program("isotherm-exporter", &["--listen", "0.0.0.0:0"]));
    exporter.wait_for_log("metrics at http://");
    assert_eq!(exporter.count_in_log("anybody who reaches"), 1, "{}", exporter.log());
    exporter.terminate();
}

#[test]
fn a_service_that_is_to_serve_metrics_itself_names_the_exporter() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let imu = "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n";
    domain.write("service.toml", &format!("{imu}[metrics]\nlisten = \"127.0.0.1:9464\"\n"));
    for words in [["serve", "--config", "service.toml"], ["check", "--strict", "service.toml"]] {
        let output = domain.run(&words);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(78), "{said}");
        let place = "service.toml:5: metrics.listen: ";
        let remedy =
            "remove [metrics], and start `isotherm-exporter --listen 127.0.0.1:9464` (unit isotherm-exporter.service)";
        assert!(said.contains(place) && said.contains(remedy), "{said}");
    }
}
