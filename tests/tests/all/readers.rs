//! Readers next to the acquisition, and peers that use the streams without the client library.

use crate::lag::status_readers;
use iceoryx2::prelude::PortFactory as _;
use isotherm_client::transport::stream::{self, INCREMENT_DEPTH, Ipc, IpcNode, RECORDER_DEPTH};
use isotherm_client::{CompensatedIncrement, ConnectError, IncrementReader, RawSample, join};
use isotherm_shared::compensate::answer;
use isotherm_shared::wire::Triad;
use isotherm_tests::programs::{C, compile, start};
use isotherm_tests::{
    RUN, TABLE, TIMEOUT, TestDomain, WHOLE_TABLE, id, recording, round_trip, same, table, wait_until,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, Resource, Rlimit, Signal, getrlimit, prlimit};
use std::collections::BTreeSet;
use std::sync::Barrier;
use std::time::{Duration, Instant};
use std::{fs, thread};

/// All increments that have arrived for a reader.
fn drain(reader: &mut IncrementReader) -> Vec<CompensatedIncrement> {
    std::iter::from_fn(|| reader.receive().unwrap()).collect()
}

#[test]
fn a_reader_may_start_before_the_service_or_late() {
    let domain = TestDomain::new();
    let mut early = IncrementReader::new(id("imu-a"), &domain.options());
    assert_eq!(early.receive().unwrap(), None);
    assert!(!early.is_connected());
    let service = domain.serve_recording();
    wait_until("the early reader's connection", || early.receive().unwrap().is_none() && early.is_connected());

    let mut acquisition = domain.acquisition("imu-a");
    let sample = recording()[0];
    for _ in 0..100 {
        round_trip(&mut acquisition, &sample);
    }
    let mut late = domain.reader("imu-a");
    // It does not wait for the service, and misses nothing from here on, since the service is there.
    let mut unwaiting = IncrementReader::new(id("imu-a"), &domain.options());
    assert!(unwaiting.is_connected());
    for _ in 0..50 {
        round_trip(&mut acquisition, &sample);
    }
    let sequences = |reader: &mut IncrementReader| drain(reader).iter().map(|i| i.sequence).collect::<Vec<_>>();
    assert_eq!(sequences(&mut early), (0..150).collect::<Vec<_>>());
    assert_eq!(sequences(&mut late), (100..150).collect::<Vec<_>>());
    assert_eq!(sequences(&mut unwaiting), (100..150).collect::<Vec<_>>());
    assert_eq!(domain.imu_status()["readers"], 4);
    service.terminate();
}

/// Whether the reader's descriptor becomes readable within a time.
fn is_readable(reader: &mut IncrementReader, time: Duration) -> bool {
    let descriptor = reader.descriptor().unwrap();
    let timeout = Timespec { tv_sec: time.as_secs() as i64, tv_nsec: time.subsec_nanos().into() };
    poll(&mut [PollFd::from_borrowed_fd(descriptor, PollFlags::IN)], Some(&timeout)).unwrap() == 1
}

#[test]
fn a_reader_that_waits_is_told_of_increments_and_of_nothing_else() {
    let domain = TestDomain::new();
    let mut early = IncrementReader::new(id("imu-a"), &domain.options());
    assert!(matches!(early.descriptor(), Err(ConnectError::NoService(_))));
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let sample = recording()[0];
    let (mut one, mut two) = (domain.reader("imu-a"), domain.reader("imu-a"));
    // From when the service has seen that somebody waits, every increment is announced; before, they are found by
    // looking.
    wait_until("the service's notification", || {
        round_trip(&mut acquisition, &sample);
        let told = is_readable(&mut one, Duration::from_millis(1));
        drain(&mut one);
        told
    });
    wait_until("that the last notification is seen", || {
        let is_quiet = !is_readable(&mut one, Duration::from_millis(50));
        drain(&mut one);
        is_quiet
    });
    for _ in 0..50 {
        assert!(one.receive().unwrap().is_none() && !is_readable(&mut one, Duration::ZERO), "nothing has come");
        let sequence = round_trip(&mut acquisition, &sample).sequence;
        assert!(is_readable(&mut one, TIMEOUT));
        assert_eq!(one.receive().unwrap().map(|increment| increment.sequence), Some(sequence));
    }
    // Several at once, and a second one who waits.
    drain(&mut two);
    assert!(two.descriptor().is_ok() && one.receive().unwrap().is_none());
    let sent: Vec<_> = (0..20).map(|_| round_trip(&mut acquisition, &sample).sequence).collect();
    let sequences = |reader: &mut IncrementReader| drain(reader).iter().map(|it| it.sequence).collect::<Vec<_>>();
    assert!(is_readable(&mut one, TIMEOUT));
    assert_eq!([sequences(&mut one), sequences(&mut two)], [sent.clone(), sent]);
    // Another service informs them, too.
    service.kill();
    let service = domain.serve_recording();
    let sequence = round_trip(&mut acquisition, &sample).sequence;
    for reader in [&mut one, &mut two] {
        assert!(is_readable(reader, TIMEOUT));
        assert_eq!(sequences(reader), [sequence]);
    }
    // Waiting with a time limit, for what is there and for what is not.
    let sequence = round_trip(&mut acquisition, &sample).sequence;
    assert_eq!(one.receive_timeout(TIMEOUT).unwrap().map(|increment| increment.sequence), Some(sequence));
    assert_eq!(one.receive_timeout(Duration::from_millis(50)).unwrap(), None);
    // When they have left, others who come are informed again.
    drop((one, two));
    let mut third = domain.reader("imu-a");
    wait_until("the notification of the third", || {
        round_trip(&mut acquisition, &sample);
        is_readable(&mut third, Duration::from_millis(1))
    });
    service.terminate();
}

#[test]
fn of_several_imus_each_reader_is_told_of_its_own() {
    let domain = TestDomain::new();
    let names = ["imu-a", "imu-b", "imu-c"];
    let of =
        |imu: &str| format!("{imu}={}", domain.write(&format!("{imu}.toml"), &TABLE.replace("imu-a", imu)).display());
    let served: Vec<_> = names.iter().map(|imu| of(imu)).collect();
    let service = domain.serve(&served.iter().flat_map(|served| ["--imu", served]).collect::<Vec<_>>());
    let mut acquisitions = names.map(|imu| domain.acquisition(imu));
    let mut reader = domain.reader("imu-b");
    let sample = recording()[0];
    wait_until("the notification of imu-b", || {
        round_trip(&mut acquisitions[1], &sample);
        is_readable(&mut reader, Duration::from_millis(1))
    });
    wait_until("that the last notification is seen", || {
        drain(&mut reader);
        !is_readable(&mut reader, Duration::from_millis(50))
    });
    for other in [0, 2] {
        round_trip(&mut acquisitions[other], &sample);
    }
    assert!(!is_readable(&mut reader, Duration::from_millis(50)));
    let sequence = round_trip(&mut acquisitions[1], &sample).sequence;
    assert!(is_readable(&mut reader, TIMEOUT));
    assert_eq!(drain(&mut reader).iter().map(|increment| increment.sequence).collect::<Vec<_>>(), [sequence]);
    service.terminate();
}

#[test]
fn readers_that_were_killed_while_they_waited_leave_their_places() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let node = join(domain.client_domain()).unwrap();
    let event = node.service_builder(&stream::arrival_name(&id("imu-a"))).event().open().unwrap();
    let listeners = || event.dynamic_config().number_of_listeners();
    let Some(program) = compile(&domain, C, "examples/c/reader.c") else { return };
    // More than there are places.
    for round in 0..3 {
        let begin = |number| start(&domain, &program, &["imu-a"], &format!("{round}-{number}"));
        let mut readers: Vec<_> = (0..8).map(begin).collect();
        wait_until("all of them wait", || listeners() == 8);
        round_trip(&mut acquisition, &recording()[0]);
        for reader in &mut readers {
            reader.kill().unwrap();
            reader.wait().unwrap();
        }
        wait_until("their places are free", || listeners() == 0);
    }
    let mut reader = domain.reader("imu-a");
    assert!(reader.descriptor().is_ok());
    let sequence = round_trip(&mut acquisition, &recording()[0]).sequence;
    assert!(is_readable(&mut reader, TIMEOUT));
    assert_eq!(drain(&mut reader)[0].sequence, sequence);
    service.terminate();
}

#[test]
fn a_reader_knows_whether_the_service_lives() {
    const ALIVE: Duration = Duration::from_millis(500);
    const DEAD: Duration = Duration::from_secs(2);
    let domain = TestDomain::new();
    let mut reader = IncrementReader::new(id("imu-a"), &domain.options());
    assert_eq!(reader.heartbeat_age().unwrap(), None);
    let service = domain.serve_recording();
    let mut is = |state: fn(Duration) -> bool| reader.heartbeat_age().unwrap().is_some_and(state);
    wait_until("a heartbeat", || is(|age| age < ALIVE));
    // The process is stopped as a whole, goes on, dies, and has a successor.
    service.signal(Signal::STOP);
    wait_until("no heartbeat", || is(|age| age > DEAD));
    service.signal(Signal::CONT);
    wait_until("the heartbeat again", || is(|age| age < ALIVE));
    service.kill();
    wait_until("the end", || is(|age| age > DEAD));
    let service = domain.serve_recording();
    wait_until("the successor's heartbeat", || is(|age| age < ALIVE));
    service.terminate();
}

/// The status has 32 places, and a program may have more readers: they share one, in all threads.
#[test]
fn all_readers_of_a_process_take_one_place_of_the_status() {
    const THREADS: usize = 4;
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let stages = Barrier::new(THREADS + 1);
    thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                let mut readers = [(); 2].map(|()| domain.reader("imu-a"));
                for reader in &mut readers {
                    wait_until("a heartbeat", || reader.heartbeat_age().unwrap().is_some());
                }
                stages.wait();
                stages.wait();
            });
        }
        stages.wait();
        assert_eq!(status_readers(&domain), 1);
        stages.wait();
    });
    assert_eq!(status_readers(&domain), 0);
    service.terminate();
}

/// A service whose descriptors are used up connects a reader as soon as it has some again.
#[test]
fn a_reader_for_which_the_service_has_no_descriptor_is_connected_later() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let sample = recording()[0];
    let mut send = || {
        round_trip(&mut acquisition, &sample);
    };
    send();
    let open = fs::read_dir(format!("/proc/{}/fd", service.pid())).unwrap().flatten();
    let open: BTreeSet<u64> = open.map(|entry| entry.file_name().to_str().unwrap().parse().unwrap()).collect();
    let first_free = (0..).find(|number| !open.contains(number));
    let whole = getrlimit(Resource::Nofile).maximum;
    let pid = Pid::from_raw(service.pid().try_into().unwrap());
    let limit = |current| prlimit(pid, Resource::Nofile, Rlimit { current, maximum: whole }).unwrap();
    limit(first_free);
    let mut reader = domain.reader("imu-a");
    (0..2).for_each(|_| send());
    assert_eq!(reader.receive().unwrap(), None, "the service has no descriptor for it");
    limit(whole);
    wait_until("the reader is connected", || {
        send();
        reader.receive().unwrap().is_some()
    });
    service.terminate();
}

#[test]
fn a_reader_that_does_not_read_sees_a_gap_and_disturbs_nobody() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut sleeper = domain.reader("imu-a");
    let fed = domain.run_ok(&["feed", "--imu", "imu-a", RUN]);
    assert!(fed == domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]));
    let read = drain(&mut sleeper);
    let last: Vec<_> = (4000 - INCREMENT_DEPTH as u64..4000).collect();
    assert_eq!(
        read.iter().map(|i| i.sequence).collect::<Vec<_>>(),
        last,
        "the newest, in order; the older ones are lost"
    );
    let status = domain.imu_status();
    assert_eq!((&status["compensated"], &status["transport_errors"]), (&4000.into(), &0.into()));
    service.terminate();
}

fn subscribe(node: &IpcNode) -> iceoryx2::port::subscriber::Subscriber<Ipc, RawSample, ()> {
    let raw = node.service_builder(&stream::raw_name(&id("imu-a"))).publish_subscribe::<RawSample>().open().unwrap();
    raw.subscriber_builder().create().unwrap()
}

#[test]
fn a_stalled_recorder_loses_its_own_copies_only() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let node = join(domain.client_domain()).unwrap();
    let recorder = subscribe(&node);
    let mut acquisition = domain.acquisition("imu-a");
    let (samples, exact) = (recording(), table(TABLE));
    for sample in &samples[..1000] {
        let increment = round_trip(&mut acquisition, sample);
        let raw = RawSample { session: increment.session, sequence: increment.sequence, ..*sample };
        assert!(same(&increment, &answer(Some(&exact), &raw)));
    }
    let recorded: Vec<_> = std::iter::from_fn(|| recorder.receive().unwrap()).map(|sample| sample.sequence).collect();
    assert_eq!(recorded, (0..RECORDER_DEPTH as u64).collect::<Vec<_>>(), "its queue keeps the first samples");
    let status = domain.imu_status();
    assert_eq!((&status["received"], &status["gaps"]), (&1000.into(), &0.into()));
    service.terminate();
}

#[test]
fn a_reader_gets_everything_once_across_restarts_of_service_and_acquisition() {
    let domain = TestDomain::new();
    let mut service = domain.serve_recording();
    let mut reader = domain.reader("imu-a");
    let mut read: Vec<CompensatedIncrement> = Vec::new();
    let short: String = fs::read_to_string(RUN).unwrap().lines().take(1001).map(|line| format!("{line}\n")).collect();
    domain.write("short.csv", &short);
    for run in 0..3 {
        let out = format!("fed-{run}.csv");
        let feed =
            domain.spawn(&["feed", "--imu", "imu-a", "--rate", "1000", "--window", "20", "short.csv", "-o", &out]);
        let begun = read.len();
        let deadline = Instant::now() + TIMEOUT;
        // The remaining increments fit into the reader's queue, so a delay of this process loses none.
        while read.len() < begun + 600 {
            assert!(Instant::now() < deadline, "the feed does not arrive");
            read.extend(drain(&mut reader));
        }
        service.kill();
        service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        let mut feed = Some(feed);
        while let Some(running) = feed.take() {
            read.extend(drain(&mut reader));
            assert!(Instant::now() < deadline + TIMEOUT, "the feed does not end");
            if domain.path(&out).exists() {
                let (status, log) = running.wait();
                assert!(status.success(), "{log}");
            } else {
                thread::sleep(Duration::from_millis(1));
                feed = Some(running);
            }
        }
        read.extend(drain(&mut reader));
        domain.run_ok(&["replay", "--table", "imu-a.toml", "short.csv", "-o", "replayed.csv"]);
        let text = |name: &str| fs::read_to_string(domain.path(name)).unwrap();
        assert!(text(&out) == text("replayed.csv"), "the feed wrote each increment once, in order");
    }
    let pairs: BTreeSet<_> = read.iter().map(|i| (i.session, i.sequence)).collect();
    assert_eq!(pairs.len(), read.len(), "each once");
    assert_eq!(pairs.len(), 3000, "all of them");
    let sessions: BTreeSet<_> = pairs.iter().map(|(session, _)| session).collect();
    assert_eq!(sessions.len(), 3);
    service.terminate();
}

/// As a process that uses iceoryx2 directly, without the client library.
#[test]
fn a_sender_that_never_notifies_and_repeats_itself_is_served() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut reader = domain.reader("imu-a");
    let node = join(domain.client_domain()).unwrap();
    let raw = node.service_builder(&stream::raw_name(&id("imu-a"))).publish_subscribe::<RawSample>().open().unwrap();
    let publisher = raw.publisher_builder().create().unwrap();
    let sample = RawSample { session: 9, ..recording()[0] };
    for sequence in [5, 6, 7, 5, 6, 100, 99, 8, 100] {
        publisher.send_copy(RawSample { sequence, ..sample }).unwrap();
    }
    let mut read = Vec::new();
    while read.len() < 6 {
        read.push(reader.receive_timeout(TIMEOUT).unwrap().expect("an increment"));
    }
    assert_eq!(read.iter().map(|i| i.sequence).collect::<Vec<_>>(), [5, 6, 7, 100, 99, 8]);
    assert!(
        read.iter().all(|i| i.latency_ns < u64::from(u32::MAX)),
        "without a send time the latency counts from the receipt"
    );
    wait_until("the counters", || domain.imu_status()["received"] == 9);
    assert_eq!((reader.receive().unwrap(), reader.repeats()), (None, 3));
    let status = domain.imu_status();
    assert_eq!((&status["gaps"], &status["missing"], &status["repeats"]), (&1.into(), &92.into(), &5.into()));
    service.terminate();
}

#[test]
fn any_bit_pattern_is_survived() {
    for text in [TABLE, &WHOLE_TABLE.replace("\"imu-g\"", "\"imu-a\"")] {
        survives_any_bit_pattern(text);
    }
}

fn survives_any_bit_pattern(text: &str) {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", text);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let node = join(domain.client_domain()).unwrap();
    let raw = node.service_builder(&stream::raw_name(&id("imu-a"))).publish_subscribe::<RawSample>().open().unwrap();
    let publisher = raw.publisher_builder().create().unwrap();
    // A plain subscriber: these sessions and sequences repeat, and the client's reader drops repeats.
    let increments = stream::open_increment(&node, &stream::increment_name(&id("imu-a"))).unwrap();
    let subscriber = increments.subscriber_builder().create().unwrap();
    let notifier =
        stream::open_event(&node, &stream::wake_name(&id("imu-a"))).unwrap().notifier_builder().create().unwrap();
    let (exact, mut state) = (table(text), 42u64);
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        [0, u64::MAX, state ^ (state >> 31)][(state >> 60) as usize % 3]
    };
    for number in 0..2000 {
        let mut hostile = RawSample {
            session: next(),
            sequence: next(),
            timestamp_ns: next(),
            interval_ns: if number % 2 == 0 { next() } else { next() % 10_000_000_000 },
            sent_ns: next(),
            telemetry_ns: next(),
            lag_ns: if number % 3 == 0 { next() } else { exact.lag_ns() },
            device: next(),
            ..RawSample::default()
        };
        for triad in [&mut hostile.accelerometers, &mut hostile.gyroscopes] {
            let mut doubles = || [(); 3].map(|()| f64::from_bits(next()));
            let [head_temperature, board_temperature, head_lagged] = [doubles(), doubles(), doubles()];
            let mut pulses = || [(); 3].map(|()| next() as u32);
            let [positive_pulses, negative_pulses] = [pulses(), pulses()];
            *triad = Triad { positive_pulses, negative_pulses, head_temperature, board_temperature, head_lagged };
        }
        publisher.send_copy(hostile).unwrap();
        notifier.notify().unwrap();
        let mut answered = None;
        wait_until("an answer", || {
            answered = subscriber.receive().unwrap().map(|sample| *sample);
            answered.is_some()
        });
        let increment = answered.unwrap();
        assert!(same(&increment, &answer(Some(&exact), &hostile)), "{hostile:?}");
        let triads = [increment.velocity_increment, increment.angle_increment];
        assert!(triads.as_flattened().iter().all(|value| !value.is_infinite()));
    }
    service.terminate();
}

#[test]
fn a_stream_created_by_another_process_is_named() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let node = join(domain.client_domain()).unwrap();
    let name = stream::raw_name(&id("imu-a"));
    let foreign = node.service_builder(&name).publish_subscribe::<RawSample>().create().unwrap();
    let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    let message = isotherm_tests::text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(
        message.contains("the raw stream of IMU imu-a: another process has created it with other settings"),
        "{message}"
    );
    drop(foreign);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    // The service's stream has its documented settings.
    let ours = stream::open_raw(&node, &stream::raw_name(&id("imu-a"))).unwrap();
    assert_eq!(iceoryx2::prelude::PortFactory::static_config(&ours).subscriber_max_buffer_size(), RECORDER_DEPTH);
    service.terminate();
}
