//! The process of the IMU: works the simulated time off in control periods and publishes raw samples, as an acquisition does.

use super::SimulatedStation;
use super::link::{Answer, Asking, Event};
use isotherm_calibration::simulate::{self, Random, SimulatedTurntable, Truth, specific_force};
use isotherm_client::{Acquisition, Domain, ImuId, Options, SendError};
use isotherm_failure::{Exit, Failure};
use isotherm_files::{Guard, load_table};
use isotherm_shared::wire::RawSample;
use std::collections::VecDeque;
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// The stream of the seed for the table's positioning errors, as in a simulated campaign.
const TURNTABLE: u64 = 3;
/// Least pause between two questions to the machines.
const PAUSE: Duration = Duration::from_millis(1);
/// After so many samples without a pause there is one, so that whoever reads along can follow when a stall is made up for.
const BURST: u32 = 32;
/// How often it looks for a service that is not there, and how long.
const LOOK: Duration = Duration::from_millis(200);
const PATIENCE: Duration = Duration::from_millis(20);
/// How long a service may leave everything unanswered before samples are dropped.
const SILENCE: Duration = Duration::from_secs(10);
/// A set point that comes after so long at the last one is another visit.
const VISIT_S: f64 = 600.0;

/// Runs until SIGTERM or SIGINT, or until a machine has gone.
///
/// # Errors
/// If the truth cannot be read.
pub fn run(station: &SimulatedStation, imu: &ImuId, folder: &Path, domain: Domain) -> Result<(), Failure> {
    let ended = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        // Without a handler the signal ends us as usual; the service cleans up behind us.
        let _ = signal_hook::flag::register(signal, Arc::clone(&ended));
    }
    let failed = |error: io::Error| Failure::new(Exit::Io, format!("the simulated IMU: {error}"));
    let table = load_table(&folder.join("truth.toml"), None, Guard::Lax)?.0;
    let SimulatedStation { tilt_rad, gravity_local, .. } = *station;
    let truth = Truth { tilt_rad, gravity_local, ..Truth::of(table) };
    let mut machines = [Asking::new(io::stdin()).map_err(failed)?, Asking::new(io::stdout()).map_err(failed)?];
    let mut body = Body::new(station, &truth);
    let mut output = SampleSender::new(imu, domain, Arc::clone(&ended));
    while !ended.load(Ordering::Relaxed) {
        let mut known_s = f64::INFINITY;
        for machine in &mut machines {
            let Ok(Answer { now_s, events }) = machine.ask() else { return Ok(()) };
            known_s = known_s.min(now_s);
            body.events.extend(events);
        }
        body.events.make_contiguous().sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let mut burst = 0;
        while body.end_s() <= known_s && !ended.load(Ordering::Relaxed) {
            output.send(&body.step());
            burst += 1;
            if burst % BURST == 0 {
                thread::sleep(PAUSE);
            }
        }
        output.receive();
        let left = (body.end_s() - station.now_s()) / station.speed;
        thread::sleep(Duration::from_secs_f64(left.clamp(0.0, 0.1)).max(PAUSE));
    }
    Ok(())
}

/// The IMU on its table in its chamber, as far as it has come.
struct Body<'a> {
    truth: &'a Truth,
    imu: simulate::SimulatedImu,
    turntable: SimulatedTurntable,
    interval_ns: u64,
    /// Periods that are over.
    periods: u64,
    /// What the machines have begun, not come to yet.
    events: VecDeque<(f64, Event)>,
    /// Errors of the angles \[deg\]: another one after each move.
    errors_deg: [f64; 2],
    positioning_deg: f64,
    random: Random,
    target_c: f64,
    /// Since when the air is where it was to go \[s\].
    arrived_s: f64,
}

impl<'a> Body<'a> {
    fn new(station: &SimulatedStation, truth: &'a Truth) -> Self {
        let SimulatedStation { chain, noise, ambient_c, seed, interval_ns, .. } = station;
        let mut imu = simulate::SimulatedImu::new(truth, chain, noise, *ambient_c, *seed);
        imu.visit();
        Self {
            truth,
            imu,
            turntable: SimulatedTurntable::default(),
            interval_ns: *interval_ns,
            periods: 0,
            events: VecDeque::new(),
            errors_deg: [0.0; 2],
            positioning_deg: noise.positioning_rad.to_degrees(),
            random: Random::new(*seed, TURNTABLE),
            target_c: *ambient_c,
            arrived_s: 0.0,
        }
    }

    /// End of the next period \[s\].
    fn end_s(&self) -> f64 {
        ((self.periods + 1) * self.interval_ns) as f64 / 1e9
    }

    /// Lets a period pass, with the angles of its middle. The chamber's events take effect from its beginning.
    fn step(&mut self) -> RawSample {
        let begin_s = (self.periods * self.interval_ns) as f64 / 1e9;
        let (mut now_s, middle_s, end_s) = (begin_s, (begin_s + self.end_s()) / 2.0, self.end_s());
        while let Some((at_s, event)) = self.events.front().copied().filter(|(at_s, _)| *at_s <= middle_s) {
            self.turntable.wait((at_s - now_s).max(0.0));
            now_s = at_s.max(now_s);
            self.events.pop_front();
            self.begin(event, now_s);
        }
        self.turntable.wait(middle_s - now_s);
        let [outer, inner] = self.turntable.angles_deg();
        let force = specific_force(self.truth, outer + self.errors_deg[0], inner + self.errors_deg[1]);
        // A turn begun in the second half.
        now_s = middle_s;
        while let Some((at_s, event)) = self.events.front().copied().filter(|(at_s, _)| *at_s <= end_s) {
            self.turntable.wait(at_s - now_s);
            now_s = at_s;
            self.events.pop_front();
            self.begin(event, now_s);
        }
        self.turntable.wait(end_s - now_s);
        self.periods += 1;
        let raw = self.imu.step(&force, self.interval_ns);
        if self.imu.chamber_c() != self.target_c {
            self.arrived_s = end_s;
        }
        raw
    }

    fn begin(&mut self, event: Event, now_s: f64) {
        match event {
            Event::Chamber { target_c, ramp_c_per_s } => {
                if now_s - self.arrived_s > VISIT_S {
                    self.imu.visit();
                }
                (self.target_c, self.arrived_s) = (target_c, now_s);
                self.imu.go_to(target_c, ramp_c_per_s);
            }
            Event::GoTo { axis, angle_deg, rate, acceleration } => {
                self.turntable.go_to(axis, angle_deg, rate, acceleration);
                self.errors_deg[axis] = self.positioning_deg * self.random.normal();
            }
            Event::Stop { axis, acceleration } => self.turntable.stop(axis, acceleration),
            Event::Swing { amplitude_deg } => self.turntable.swing(amplitude_deg),
        }
    }
}

/// Where the samples go: to the service, while there is one.
struct SampleSender {
    imu: ImuId,
    options: Options,
    acquisition: Option<Acquisition>,
    looked: Option<Instant>,
    /// What stood in the way when it last looked, so that it is told once.
    obstacle: String,
    /// When the service last had room.
    heard: Instant,
    ended: Arc<AtomicBool>,
}

impl SampleSender {
    fn new(imu: &ImuId, domain: Domain, ended: Arc<AtomicBool>) -> Self {
        let options = Options { domain, timeout: PATIENCE };
        Self {
            imu: imu.clone(),
            options,
            acquisition: None,
            looked: None,
            obstacle: String::new(),
            heard: Instant::now(),
            ended,
        }
    }

    /// Sends a sample. Without a service it is dropped, as in an IMU that nobody listens to; one that is behind is waited for.
    fn send(&mut self, raw: &RawSample) {
        if self.acquisition.is_none() && self.looked.is_none_or(|looked| looked.elapsed() > LOOK) {
            match Acquisition::connect(&self.imu, &self.options) {
                Ok(acquisition) => (self.acquisition, self.obstacle) = (Some(acquisition), String::new()),
                Err(error) => self.tell(&error.to_string()),
            }
            self.looked = Some(Instant::now());
            self.heard = Instant::now();
        }
        let Some(acquisition) = &mut self.acquisition else { return };
        let Ok(mut loan) = acquisition.loan() else { return };
        let session = loan.session;
        *loan = RawSample { session, ..*raw };
        loop {
            loan = match acquisition.send(loan) {
                Ok(()) => {
                    self.heard = Instant::now();
                    break;
                }
                Err(SendError::Full(back)) => back,
                // Another session begins with the next sample.
                Err(_) => return self.acquisition = None,
            };
            let answered = acquisition.receive_timeout(PATIENCE);
            if answered.is_err() {
                return self.acquisition = None;
            }
            if self.heard.elapsed() > SILENCE || self.ended.load(Ordering::Relaxed) {
                return;
            }
        }
        self.receive();
    }

    fn tell(&mut self, obstacle: &str) {
        if self.obstacle != obstacle {
            self.obstacle = obstacle.to_owned();
            // Nobody may be reading.
            let _ = writeln!(io::stderr(), "isotherm: the simulated IMU: {obstacle}; it goes on looking");
        }
    }

    /// Takes the answers that are there, and looks after the service.
    fn receive(&mut self) {
        let Some(acquisition) = &mut self.acquisition else { return };
        loop {
            match acquisition.receive() {
                Ok(Some(_)) => {}
                Ok(None) => return,
                Err(_) => return self.acquisition = None,
            }
        }
    }
}
