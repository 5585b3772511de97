//! A bare pair of ros2-client, for the bench: `bare publish RATE COUNT` and `bare subscribe COUNT`, which prints the
//! latencies from publishing to receiving [us] as JSON; and `bare count TOPIC...`, which prints once a second how many
//! messages each topic has had. `bare feed SECONDS IMU=RATE...` is an acquisition of several IMUs.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a program of a bench")]

use isotherm_client::{Acquisition, ImuId, Options, UnixOffset, monotonic_ns};
use isotherm_ros2::{IMU, SensorImu};
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{History, QosProfile, WhenFull};
use ros2_client::{Context, MessageTypeName, Name, Node, NodeName, NodeOptions};
use std::collections::BTreeMap;
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const TOPIC: &str = "/bare/imu/data_raw";

fn unix_ns() -> i64 {
    UnixOffset::measure().unix_ns(monotonic_ns())
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize| arguments.get(at).and_then(|text| text.parse::<f64>().ok()).expect("a number");
    if arguments.first().is_some_and(|word| word == "feed") {
        return feed(number(1), &arguments[2..]);
    }
    let is_publisher = arguments.first().is_some_and(|word| word == "publish");
    let domain = std::env::var("ROS_DOMAIN_ID").ok().and_then(|text| text.parse().ok()).expect("ROS_DOMAIN_ID");
    let participant = DomainParticipantBuilder::new(domain).with_only_networks([Ipv4Addr::LOCALHOST]).build();
    let context = Context::from_domain_participant(participant.expect("a participant")).expect("a context");
    let name = NodeName::new("/", if is_publisher { "bare_out" } else { "bare_in" }).expect("a name");
    let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
    let mut node = context.new_node(name, options).expect("a node");
    let qos = QosProfile::default().history(History::KeepLast { depth: 2000 }).reliability_reliable(WhenFull::Fail);
    if arguments.first().is_some_and(|word| word == "count") {
        return count(&mut node, &arguments[1..], &qos);
    }
    let topic = Name::parse(TOPIC).expect("a name");
    let topic = node.create_topic(&topic, MessageTypeName::new(IMU.0, IMU.1), &qos).expect("a topic");
    if !is_publisher {
        let subscription = node.create_subscription::<SensorImu>(&topic, None).expect("a subscription");
        println!("ready");
        let latencies = (0..number(1) as usize).map(|_| {
            let (_, info) = futures::executor::block_on(subscription.async_take()).expect("a message");
            let published = info.source_timestamp().expect("a source timestamp").to_nanos();
            (unix_ns() - published) as f64 / 1e3
        });
        println!("{{\"of_source_us\": {:?}}}", latencies.collect::<Vec<_>>());
        return;
    }
    let publisher = node.create_publisher::<SensorImu>(&topic, None).expect("a publisher");
    let spinner = node.spinner().expect("a spinner");
    std::thread::spawn(move || futures::executor::block_on(spinner.spin()));
    while node.subscription_count(TOPIC) == 0 {
        std::thread::sleep(Duration::from_millis(20));
    }
    println!("matched");
    let (begin, interval) = (Instant::now(), Duration::from_secs_f64(1.0 / number(1)));
    for period in 0..number(2) as u32 {
        std::thread::sleep((begin + interval * period).saturating_duration_since(Instant::now()));
        publisher.publish(SensorImu::default()).expect("room");
    }
    println!("driven");
    std::thread::sleep(Duration::from_secs(2));
}

/// Counts the messages of topics, each in a thread of its own.
fn count(node: &mut Node, topics: &[String], qos: &QosProfile) {
    let mut counts = BTreeMap::new();
    for name in topics {
        let topic = Name::parse(name).expect("a name");
        let topic = node.create_topic(&topic, MessageTypeName::new(IMU.0, IMU.1), qos).expect("a topic");
        let subscription = node.create_subscription::<SensorImu>(&topic, None).expect("a subscription");
        let count = Arc::new(AtomicU64::new(0));
        counts.insert(name, Arc::clone(&count));
        std::thread::spawn(move || {
            while futures::executor::block_on(subscription.async_take()).is_ok() {
                count.fetch_add(1, Ordering::Relaxed);
            }
        });
    }
    println!("ready");
    loop {
        std::thread::sleep(Duration::from_secs(1));
        let shown: Vec<_> =
            counts.iter().map(|(name, count)| format!("{name:?}: {}", count.load(Ordering::Relaxed))).collect();
        println!("{{{}}}", shown.join(", "));
    }
}

/// Sends samples of IMUs at their rates, each in a thread of its own, and takes the increments.
fn feed(seconds: f64, imus: &[String]) {
    let feeding: Vec<_> = imus
        .iter()
        .map(|word| {
            let (imu, rate) = word.split_once('=').expect("IMU=RATE");
            let (imu, rate): (ImuId, f64) = (imu.parse().expect("an IMU"), rate.parse().expect("a rate"));
            std::thread::spawn(move || feed_one(&imu, (1e9 / rate) as u64, (seconds * rate) as u64))
        })
        .collect();
    feeding.into_iter().for_each(|feeding| feeding.join().expect("every sample sent"));
}

fn feed_one(imu: &ImuId, interval_ns: u64, periods: u64) {
    let options = Options::from_environment().expect("a domain");
    let mut acquisition = Acquisition::connect(imu, &options).expect("the service");
    let begin_ns = monotonic_ns();
    let sleep_until = |ns: u64| std::thread::sleep(Duration::from_nanos(ns.saturating_sub(monotonic_ns())));
    for period in 1..=periods {
        let end_ns = begin_ns + period * interval_ns;
        sleep_until(end_ns);
        // A service that is late gets the period later.
        while acquisition.is_full() {
            sleep_until(monotonic_ns() + interval_ns);
            while acquisition.receive().expect("the service").is_some() {}
        }
        let mut sample = acquisition.loan().expect("a sample");
        (sample.timestamp_ns, sample.telemetry_ns, sample.interval_ns) = (end_ns, end_ns, interval_ns);
        let triad = &mut sample.accelerometers;
        (triad.positive_pulses, triad.head_temperature, triad.board_temperature) = ([100; 3], [1.1; 3], [1.2; 3]);
        acquisition.send(sample).expect("room");
        while acquisition.receive().expect("the service").is_some() {}
    }
    while acquisition.in_flight() > 0 {
        sleep_until(monotonic_ns() + interval_ns);
        while acquisition.receive().expect("the service").is_some() {}
    }
    acquisition.close();
}
