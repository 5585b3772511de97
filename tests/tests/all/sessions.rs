//! The flag `session`: on the first increment of a session that follows another one, whichever processes were killed
//! and started again in between, and on no other increment.

use isotherm_client::{Acquisition, CompensatedIncrement, IncrementReader, monotonic_ns};
use isotherm_shared::sequence::{Period, Seen, periods_between};
use isotherm_shared::wire::{Flags, RawSample};
use isotherm_tests::{Process, RUN, TIMEOUT, TestDomain, recording, wait_until};
use std::fs;

/// The delivery flags without `late`, which depends on the machine.
fn lost(increment: &CompensatedIncrement) -> Flags {
    Flags(increment.flags & Flags::LOST.0)
}

/// Sends a sample of 2.5 ms that ends now, and waits for its increment.
fn send(acquisition: &mut Acquisition) -> CompensatedIncrement {
    let mut loan = acquisition.loan().unwrap();
    let (session, sequence) = (loan.session, loan.sequence);
    *loan = RawSample { session, sequence, timestamp_ns: monotonic_ns(), ..recording()[0] };
    acquisition.compensate(loan, TIMEOUT).unwrap()
}

fn between(earlier: &CompensatedIncrement, later: &CompensatedIncrement) -> Option<u64> {
    // Its timestamp is when it was sent, too.
    let seen =
        |increment: &CompensatedIncrement| Seen { period: Period::from(increment), at_ns: increment.timestamp_ns };
    periods_between(seen(earlier), seen(later))
}

/// What is noted of the session that was served last.
fn note(domain: &TestDomain) -> Option<String> {
    let client = domain.client_domain();
    fs::read_to_string(format!("{}/{}session-imu-a", client.root_path(), client.prefix())).ok()
}

/// Waits until the session is noted, without which a service that is killed leaves the one before.
fn wait_for_note(domain: &TestDomain, session: u64) {
    let is_noted = |note: String| note.split_whitespace().nth(1) == Some(&session.to_string());
    wait_until("the session is noted", || note(domain).is_some_and(is_noted));
}

#[test]
fn each_session_but_the_first_is_flagged_once_and_the_periods_between_are_counted() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut reader = domain.reader("imu-a");
    assert_eq!(reader.lost_before(), None);
    let mut acquisition = domain.acquisition("imu-a");
    let mut last = send(&mut acquisition);
    assert_eq!(lost(&last), Flags(0), "the first session since boot");
    let (mut missing, mut steps) = (0, Vec::new());
    for _ in 0..3 {
        drop(acquisition);
        acquisition = domain.acquisition("imu-a");
        let first = send(&mut acquisition);
        assert_eq!(lost(&first), Flags::SESSION);
        let periods = between(&last, &first).unwrap();
        missing += periods;
        steps.push(Some(periods));
        last = first;
    }
    acquisition.begin_session().unwrap();
    let first = send(&mut acquisition);
    assert_eq!(lost(&first), Flags::SESSION, "also in one process");
    missing += between(&last, &first).unwrap();
    // A device whose clock begins anew.
    acquisition.begin_session().unwrap();
    let mut loan = acquisition.loan().unwrap();
    *loan = RawSample { session: loan.session, timestamp_ns: 2_500_000, ..recording()[0] };
    assert_eq!(lost(&acquisition.compensate(loan, TIMEOUT).unwrap()), Flags::SESSION);

    let status = domain.imu_status();
    assert_eq!((&status["sessions"], &status["flagged"]["session"]), (&6.into(), &5.into()), "{status}");
    assert_eq!((&status["session_missing"], &status["session_unknown"]), (&missing.into(), &1.into()), "{status}");
    assert_eq!((&status["gaps"], &status["missing"]), (&0.into(), &0.into()));
    let words = domain.run_ok(&["status"]);
    let expected = format!("between      sessions: {missing} periods missing, and 1 times an unknown number");
    assert!(words.contains(&expected), "{words}");
    // The reader looks by its own clock: it has read all at once, so that only clocks that disagree with that are none.
    let mut read = Vec::new();
    while let Some(increment) = reader.receive().unwrap() {
        read.push((lost(&increment), reader.lost_before()));
    }
    assert_eq!(read.len(), 6);
    assert_eq!((read[0], read[5]), ((Flags(0), None), (Flags::SESSION, None)));
    service.terminate();
}

#[test]
fn a_reader_tells_how_many_periods_are_missing() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut reader = domain.reader("imu-a");
    let mut acquisition = domain.acquisition("imu-a");
    let mut receive = || {
        let increment = reader.receive_timeout(TIMEOUT).unwrap().unwrap();
        (lost(&increment), reader.lost_before())
    };
    send(&mut acquisition);
    assert_eq!(receive(), (Flags(0), None), "nothing is known before the first");
    // Two loans that are dropped are two periods.
    drop(acquisition.loan().unwrap());
    drop(acquisition.loan().unwrap());
    send(&mut acquisition);
    assert_eq!(receive(), (Flags::GAP, Some(2)));
    // So is what goes by while the acquisition is away, whether or not its service is.
    let mut step = |acquisition: &mut Acquisition, sequence, timestamp_ns| {
        let mut loan = acquisition.loan().unwrap();
        *loan = RawSample { session: loan.session, sequence, timestamp_ns, ..recording()[0] };
        acquisition.compensate(loan, TIMEOUT).unwrap();
        receive()
    };
    let now = monotonic_ns();
    acquisition.begin_session().unwrap();
    assert_eq!(step(&mut acquisition, 7, now).0, Flags::SESSION);
    acquisition.begin_session().unwrap();
    assert_eq!(step(&mut acquisition, 3, now + 25_000_000), (Flags::SESSION, Some(9)));
    assert_eq!(step(&mut acquisition, 4, now + 27_500_000), (Flags(0), Some(0)));
    assert_eq!(step(&mut acquisition, 5, now + 90_000_000), (Flags::TIME_STEP, None));
    acquisition.begin_session().unwrap();
    assert_eq!(step(&mut acquisition, 5, now + 60_000_000_000), (Flags::SESSION, None), "of another clock");
    service.terminate();
}

#[test]
fn a_service_that_takes_over_knows_the_session_before_and_clean_forgets_it() {
    let domain = TestDomain::new();
    // A service that has served nothing leaves nothing.
    domain.serve_recording().kill();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let last = send(&mut acquisition);
    assert_eq!(lost(&last), Flags(0));
    // After a signal the last sample is noted as well. A service in between that serves nothing leaves that.
    service.terminate();
    domain.serve_recording().terminate();
    let mut service = domain.serve_recording();
    drop(acquisition);
    let mut acquisition = domain.acquisition("imu-a");
    let first = send(&mut acquisition);
    assert_eq!(lost(&first), Flags::SESSION);
    let status = domain.imu_status();
    let missing = between(&last, &first).unwrap();
    assert_eq!((&status["session_missing"], &status["session_unknown"]), (&missing.into(), &0.into()), "{status}");
    // After a kill the session is known, and the last sample is not.
    for begins in [false, true, false, true, true] {
        wait_for_note(&domain, acquisition.session());
        service.kill();
        service = domain.serve_recording();
        if begins {
            drop(acquisition);
            acquisition = domain.acquisition("imu-a");
        }
        let first = send(&mut acquisition);
        assert_eq!(lost(&first), if begins { Flags::SESSION } else { Flags(0) });
        assert!(!Flags(send(&mut acquisition).flags).intersects(Flags::SESSION));
        let status = domain.imu_status();
        let unknown = u64::from(begins);
        assert_eq!((&status["session_missing"], &status["session_unknown"]), (&0.into(), &unknown.into()), "{status}");
    }
    drop(acquisition);
    service.terminate();
    assert!(note(&domain).is_some());
    domain.run_ok(&["clean"]);
    assert_eq!(note(&domain), None);
    let service = domain.serve_recording();
    assert_eq!(lost(&send(&mut domain.acquisition("imu-a"))), Flags(0), "as if since boot");
    service.terminate();
}

#[test]
fn a_note_of_another_boot_counts_for_nothing() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    send(&mut acquisition);
    drop(acquisition);
    service.terminate();
    let text = note(&domain).unwrap();
    let (boot, rest) = text.split_once(' ').unwrap();
    let client = domain.client_domain();
    let path = format!("{}/{}session-imu-a", client.root_path(), client.prefix());
    for (text, expected) in [
        (format!("{} {rest}", boot.parse::<u64>().unwrap() ^ 1), Flags(0)),
        ("no note at all".to_owned(), Flags(0)),
        (text.clone(), Flags::SESSION),
    ] {
        fs::write(&path, text).unwrap();
        let service = domain.serve_recording();
        assert_eq!(lost(&send(&mut domain.acquisition("imu-a"))), expected);
        service.kill();
    }
}

/// An acquisition that is a process, a service that is one, and a reader that has seen it all.
struct Scene<'a> {
    domain: &'a TestDomain,
    service: Option<Process>,
    acquisition: Option<Process>,
    reader: IncrementReader,
    /// Session, the delivery flags but `late`, and what the reader says is missing before.
    seen: Vec<(u64, Flags, Option<u64>)>,
}

impl Scene<'_> {
    fn start_service(&mut self) {
        self.service = Some(self.domain.serve_recording());
    }

    fn start_acquisition(&mut self) {
        let arguments = ["feed", "--imu", "imu-a", "--rate", "100", "--timeout", "30", RUN];
        self.acquisition = Some(self.domain.spawn(&arguments));
    }

    fn kill_service(&mut self) {
        self.service.take().unwrap().kill();
    }

    fn kill_acquisition(&mut self) {
        self.acquisition.take().unwrap().kill();
    }

    fn drain(&mut self) {
        while let Some(increment) = self.reader.receive().unwrap() {
            self.seen.push((increment.session, lost(&increment), self.reader.lost_before()));
        }
    }

    /// Waits until increments have come, of another session than before if one `begins`, and their session is noted.
    fn goes_on(&mut self, begins: bool) {
        self.drain();
        let (before, last) = (self.seen.len(), self.seen.last().map(|(session, ..)| *session));
        wait_until("increments", || {
            self.drain();
            let new: Vec<_> =
                self.seen[before..].iter().filter(|(session, ..)| !begins || Some(*session) != last).collect();
            new.len() >= 10
        });
        wait_for_note(self.domain, self.seen[self.seen.len() - 1].0);
    }
}

/// All of it with SIGKILL. A session that goes on has no flag, also where its samples are sent again.
#[test]
fn whatever_is_killed_and_started_again_the_flag_is_there_exactly_where_a_session_begins() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let reader = domain.reader("imu-a");
    let mut scene = Scene { domain: &domain, service: Some(service), acquisition: None, reader, seen: Vec::new() };
    scene.start_acquisition();
    scene.goes_on(true);
    let mut sessions = 1;
    for round in 0..3 {
        // The service.
        scene.kill_service();
        scene.start_service();
        scene.goes_on(false);
        // The acquisition.
        scene.kill_acquisition();
        scene.start_acquisition();
        scene.goes_on(true);
        // The service, then the acquisition, which is started first in every other round.
        scene.kill_service();
        scene.kill_acquisition();
        if round == 1 {
            scene.start_acquisition();
            scene.start_service();
        } else {
            scene.start_service();
            scene.start_acquisition();
        }
        scene.goes_on(true);
        // The acquisition, then the service.
        scene.kill_acquisition();
        scene.kill_service();
        scene.start_service();
        scene.start_acquisition();
        scene.goes_on(true);
        // The new acquisition is connected to the old service when that dies.
        scene.kill_acquisition();
        scene.start_acquisition();
        scene.goes_on(true);
        scene.kill_service();
        scene.start_service();
        scene.goes_on(false);
        sessions += 4;
    }
    scene.kill_acquisition();
    scene.drain();
    let mut begun = Vec::new();
    for (session, flags, lost_before) in &scene.seen {
        let begins = begun.last() != Some(session);
        let expected = if begins && !begun.is_empty() { Flags::SESSION } else { Flags(0) };
        assert_eq!(*flags, expected, "session {} of {sessions}", begun.len());
        // The recording's clock begins anew. In a session later samples may come before those that are sent again.
        assert_eq!(lost_before.is_none(), begins, "session {} of {sessions}", begun.len());
        if begins {
            assert!(!begun.contains(session), "an earlier session comes again");
            begun.push(*session);
        }
    }
    assert_eq!(begun.len(), sessions);
    scene.service.take().unwrap().terminate();
}
