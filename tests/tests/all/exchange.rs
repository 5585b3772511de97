//! The one call that serves a control period: whatever happens to the service, a loop of it gets every increment once,
//! in the order of sending, and is never made to wait.

use crate::hot_loop::system_calls;
use crate::removal::remove_memory;
use isotherm_client::{Acquisition, CompensatedIncrement, ExchangeError, Flags, Loan, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_tests::programs::{SERIAL, start};
use isotherm_tests::{Needs, Process, TABLE, TIMEOUT, TestDomain, recording, same, skip, table, wait_until};
use nix::unistd::Pid;
use std::path::Path;
use std::time::Duration;

const PERIOD_NS: u64 = 2_500_000;
const WAIT: Duration = Duration::from_millis(1);

/// Exchanges period after period, and checks every increment.
struct Loop {
    acquisition: Acquisition,
    records: Vec<RawSample>,
    table: isotherm_shared::table::CoefficientTable,
    sent: u64,
    answered: u64,
}

impl Loop {
    fn new(domain: &TestDomain) -> Self {
        let acquisition = domain.acquisition("imu-a");
        Self { acquisition, records: recording(), table: table(TABLE), sent: 0, answered: 0 }
    }

    /// What is sent as this sequence.
    fn sample(&self, sequence: u64) -> RawSample {
        let time = (sequence + 1) * PERIOD_NS;
        let record = self.records[sequence as usize % self.records.len()];
        RawSample { sequence, timestamp_ns: time, telemetry_ns: time, interval_ns: PERIOD_NS, ..record }
    }

    fn loan(&mut self) -> Loan {
        let mut loan = self.acquisition.loan().unwrap();
        *loan = RawSample { session: loan.session, device: 0, ..self.sample(loan.sequence) };
        loan
    }

    fn check(&mut self, increment: &CompensatedIncrement) {
        assert_eq!(increment.sequence, self.answered, "each comes once, in the order of sending");
        let session = increment.session;
        let expected = answer(Some(&self.table), &RawSample { session, ..self.sample(increment.sequence) });
        assert!(same(increment, &expected), "{increment:?} {expected:?}");
        let lost = Flags(increment.flags).only(Flags::GAP | Flags::TIME_STEP);
        assert_eq!(lost, Flags::default(), "no time is missing: {increment:?}");
        self.answered += 1;
    }

    /// Serves a period; returns how many increments came.
    fn go(&mut self, timeout: Duration) -> usize {
        let loan = self.loan();
        let increments = self.acquisition.exchange(loan, timeout).unwrap().to_vec();
        self.sent += 1;
        increments.iter().for_each(|increment| self.check(increment));
        increments.len()
    }

    /// Serves periods until all increments have come.
    fn catch_up(&mut self) {
        wait_until("that all increments have come", || {
            self.go(WAIT);
            self.answered == self.sent
        });
        assert_eq!((self.acquisition.kept(), self.acquisition.lost(), self.acquisition.in_flight()), (0, 0, 0));
    }
}

/// Runs a loop while `away` happens to the service; returns the service after it.
fn survives(periods: usize, away: impl FnOnce(&TestDomain, Process, &mut dyn FnMut()) -> Process) {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut served = Loop::new(&domain);
    served.catch_up();
    let service = away(&domain, service, &mut || {
        for _ in 0..periods {
            served.go(Duration::ZERO);
        }
    });
    served.catch_up();
    // Another one, so that nothing hangs over.
    assert_eq!(served.go(TIMEOUT), 1);
    service.terminate();
}

#[test]
fn a_loop_survives_a_stall_and_gets_all_in_order() {
    survives(5000, |_, service, serve| {
        service.stop();
        serve();
        service.resume();
        service
    });
}

#[test]
fn a_loop_survives_12000_periods_without_a_service() {
    survives(12_000, |domain, service, serve| {
        service.kill();
        serve();
        domain.serve_recording()
    });
}

#[test]
fn a_loop_survives_the_removal_of_the_shared_memory() {
    survives(500, |domain, service, serve| {
        assert!(remove_memory(domain) > 10);
        serve();
        service
    });
}

#[test]
fn a_call_waits_for_its_own_increment_beyond_all_that_waits() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut served = Loop::new(&domain);
    service.stop();
    for _ in 0..300 {
        served.go(Duration::ZERO);
    }
    service.resume();
    assert_eq!(served.go(TIMEOUT), 301);
    service.terminate();
}

#[test]
fn what_has_no_place_comes_with_the_next_call() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut served = Loop::new(&domain);
    service.stop();
    for _ in 0..10 {
        served.go(Duration::ZERO);
    }
    service.resume();
    for most in [3, 0, 9] {
        let loan = served.loan();
        let mut arrived = vec![];
        served.acquisition.exchange_each(loan, TIMEOUT, most, |increment| arrived.push(increment)).unwrap();
        served.sent += 1;
        assert_eq!(arrived.len(), most);
        arrived.iter().for_each(|increment| served.check(increment));
    }
    served.catch_up();
    service.terminate();
}

#[test]
fn a_sequence_that_does_not_rise_is_the_only_refusal() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut served = Loop::new(&domain);
    served.go(TIMEOUT);
    let mut loan = served.loan();
    loan.sequence = 0;
    let Err(ExchangeError::Sequence(mut loan)) = served.acquisition.exchange(loan, WAIT) else { panic!() };
    loan.sequence = 1;
    assert_eq!(served.acquisition.exchange(loan, TIMEOUT).unwrap().len(), 1);
    service.terminate();
}

#[test]
fn a_service_with_less_room_gives_no_gap() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let config = |depth: u32| format!("[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\ndepth = {depth}\n");
    let serve = |depth| {
        domain.write("service.toml", &config(depth));
        domain.serve(&["--config", "service.toml"])
    };
    let service = serve(64);
    let mut served = Loop::new(&domain);
    served.catch_up();
    let mut service = Some(service);
    for depth in [8, 1, 64] {
        service.take().unwrap().kill();
        for _ in 0..200 {
            served.go(Duration::ZERO);
        }
        service = Some(serve(depth));
        served.catch_up();
        assert_eq!(served.acquisition.depth(), depth as usize);
        let imu = domain.imu_status();
        assert_eq!((&imu["gaps"], &imu["missing"]), (&0.into(), &0.into()), "depth {depth}: {imu}");
    }
    service.take().unwrap().terminate();
}

#[test]
fn an_idle_handle_disturbs_no_other() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=imu-b.toml"]);
    let idle = domain.acquisition("imu-b");
    let mut served = Loop::new(&domain);
    served.catch_up();
    assert!(remove_memory(&domain) > 10);
    served.catch_up();
    let nodes = || std::fs::read_dir(Path::new(domain.client_domain().root_path()).join("nodes")).unwrap().count();
    let joined = nodes();
    // A silence in which the acquisition looks several times whether it is cut off.
    service.stop();
    for _ in 0..4 {
        served.go(Duration::from_millis(300));
    }
    service.resume();
    served.catch_up();
    assert_eq!(nodes(), joined, "it has not joined again");
    drop(idle);
    service.terminate();
}

#[test]
fn the_thread_that_exchanges_makes_no_call_that_may_wait() {
    // What the C library's allocator, sleeping, waking the service, and waking the helper thread need, and a line that
    // the example prints. Then what gives up the connection to a service that has left, with the next sample: it is in
    // shared memory, and nothing of it waits.
    let harmless = [
        libc::SYS_brk,
        libc::SYS_clock_gettime,
        libc::SYS_clock_nanosleep,
        libc::SYS_futex,
        libc::SYS_madvise,
        libc::SYS_mmap,
        libc::SYS_munmap,
        libc::SYS_restart_syscall,
        libc::SYS_sched_yield,
        libc::SYS_sendto,
        libc::SYS_write,
        libc::SYS_close,
        libc::SYS_fchmod,
        libc::SYS_fcntl,
        libc::SYS_unlink,
    ];
    let domain = TestDomain::new();
    domain.write("imu-mems.toml", &include_str!("../../../examples/tables/imu-mems.toml").replace("S/N 0311", SERIAL));
    let service = domain.serve(&["--imu", "imu-mems=imu-mems.toml"]);
    let mut child = start(&domain, Path::new(env!("CARGO_BIN_EXE_example-paced")), &["imu-mems", "1000000"], "out");
    let mut reader = domain.reader("imu-mems");
    let mut newest = || std::iter::from_fn(|| reader.receive().unwrap()).last().map(|increment| increment.sequence);
    wait_until("increments", || newest() > Some(20));
    // It gets there only when it has joined again.
    let mut until = None;
    let calls = system_calls(Pid::from_raw(child.id().cast_signed()), || {
        let until = *until.get_or_insert_with(|| {
            assert!(remove_memory(&domain) > 10);
            newest().unwrap_or(20) + 2000
        });
        newest() > Some(until)
    });
    child.kill().unwrap();
    child.wait().unwrap();
    let Some(calls) = calls else {
        skip("this user may not trace a process", Needs::Machine);
        return;
    };
    assert!(service.count_in_log("ready") > 1, "the service has begun anew");
    let waits: Vec<_> = calls.iter().filter(|call| !harmless.contains(call)).collect();
    assert!(!calls.is_empty() && waits.is_empty(), "{waits:?}");
    service.terminate();
}
