//! The process of the IMU: it simulates one control period after the other and publishes raw samples, as an acquisition does.

use super::link::{Answer, DeviceEvent, LinkClient};
use super::station::SimulatedStation;
use isotherm_calibration::simulate::{self, Motion, RandomGenerator, SimulatedTurntable, Truth, specific_force};
use isotherm_client::{Acquisition, Domain, ImuId, Options, SendError};
use isotherm_failure::{Exit, Failure, tell};
use isotherm_files::{WorldWritable, load_table};
use isotherm_shared::wire::RawSample;
use std::collections::VecDeque;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Number of the random stream for the turntable's positioning errors, the same as in a simulated campaign.
const POSITIONING_STREAM: u64 = 3;
/// Shortest pause between two questions to the devices.
const PAUSE: Duration = Duration::from_millis(1);
/// Samples between two pauses when the IMU catches up after a stall. The pauses let the readers of the stream keep up.
const BURST: u32 = 32;
/// Interval between two attempts to connect to the service.
const CONNECT_INTERVAL: Duration = Duration::from_millis(200);
/// Longest wait for a connection, and for an increment while the queue is full.
const REPLY_TIMEOUT: Duration = Duration::from_millis(20);
/// Samples are dropped after the queue was full for this time.
const DROP_AFTER: Duration = Duration::from_secs(10);
/// A new set point begins another visit if the air was at the last one for longer than this \[s\].
const VISIT_S: f64 = 600.0;

/// Runs until SIGTERM or SIGINT, or until the process of a device has ended.
///
/// # Errors
/// If the IMU's true coefficients cannot be read.
pub fn run(station: &SimulatedStation, imu: &ImuId, folder: &Path, domain: Domain) -> Result<(), Failure> {
    let ended = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        // If this fails, the signal ends the process at once, and the service cleans up.
        let _ = signal_hook::flag::register(signal, Arc::clone(&ended));
    }
    let failed = |error: io::Error| Failure::new(Exit::Io, format!("the simulated IMU: {error}"));
    let table = load_table(&folder.join("truth.toml"), None, WorldWritable::Allow)?.0;
    let SimulatedStation { tilt_rad, gravity_local, .. } = *station;
    let truth = Truth { tilt_rad, gravity_local, ..Truth::of(table) };
    let mut devices = [LinkClient::new(io::stdin()).map_err(failed)?, LinkClient::new(io::stdout()).map_err(failed)?];
    let mut imu_model = MountedImu::new(station, &truth);
    let mut output = SampleSender::new(imu, domain, Arc::clone(&ended));
    while !ended.load(Ordering::Relaxed) {
        let mut known_s = f64::INFINITY;
        for device in &mut devices {
            let Ok(Answer { now_s, events }) = device.ask() else { return Ok(()) };
            known_s = known_s.min(now_s);
            imu_model.events.extend(events);
        }
        imu_model.events.make_contiguous().sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let mut burst = 0;
        while imu_model.end_s() <= known_s && !ended.load(Ordering::Relaxed) {
            output.send(&imu_model.step());
            burst += 1;
            if burst % BURST == 0 {
                thread::sleep(PAUSE);
            }
        }
        output.receive();
        let left = (imu_model.end_s() - station.now_s()) / station.speed;
        thread::sleep(Duration::from_secs_f64(left.clamp(0.0, 0.1)).max(PAUSE));
    }
    Ok(())
}

/// The IMU with the turntable and the chamber that it is in, at the end of the last simulated period.
struct MountedImu<'a> {
    truth: &'a Truth,
    imu: simulate::SimulatedImu,
    turntable: SimulatedTurntable,
    interval_ns: u64,
    /// Number of simulated periods.
    periods: u64,
    /// Events of the devices that are later than the last simulated period.
    events: VecDeque<(f64, DeviceEvent)>,
    /// Errors of the angles \[deg\], drawn anew for each move.
    errors_deg: [f64; 2],
    positioning_deg: f64,
    random: RandomGenerator,
    target_c: f64,
    /// When the air reached its target temperature \[s\].
    arrived_s: f64,
}

impl<'a> MountedImu<'a> {
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
            random: RandomGenerator::new(*seed, POSITIONING_STREAM),
            target_c: *ambient_c,
            arrived_s: 0.0,
        }
    }

    /// End of the next period \[s\].
    fn end_s(&self) -> f64 {
        ((self.periods + 1) * self.interval_ns) as f64 / 1e9
    }

    /// Simulates a period with the angles at its middle. Events of the chamber take effect from the beginning of the period.
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
        // Events in the second half of the period.
        now_s = middle_s;
        while let Some((at_s, event)) = self.events.front().copied().filter(|(at_s, _)| *at_s <= end_s) {
            self.turntable.wait(at_s - now_s);
            now_s = at_s;
            self.events.pop_front();
            self.begin(event, now_s);
        }
        self.turntable.wait(end_s - now_s);
        self.periods += 1;
        let raw = self.imu.step(&Motion::of_force(force), self.interval_ns);
        if self.imu.chamber_c() != self.target_c {
            self.arrived_s = end_s;
        }
        raw
    }

    fn begin(&mut self, event: DeviceEvent, now_s: f64) {
        match event {
            DeviceEvent::Chamber { target_c, ramp_c_per_s } => {
                if now_s - self.arrived_s > VISIT_S {
                    self.imu.visit();
                }
                (self.target_c, self.arrived_s) = (target_c, now_s);
                self.imu.go_to(target_c, ramp_c_per_s);
            }
            DeviceEvent::GoTo { axis, angle_deg, rate, acceleration } => {
                self.turntable.go_to(axis, angle_deg, rate, acceleration);
                self.errors_deg[axis] = self.positioning_deg * self.random.normal();
            }
            DeviceEvent::Stop { axis, acceleration } => self.turntable.stop(axis, acceleration),
            DeviceEvent::Swing { amplitude_deg } => self.turntable.swing(amplitude_deg),
        }
    }
}

/// Sends the samples to the service while it runs.
struct SampleSender {
    imu: ImuId,
    options: Options,
    acquisition: Option<Acquisition>,
    last_attempt: Option<Instant>,
    /// Error of the last attempt to connect, so that it is printed only once.
    obstacle: String,
    /// When a sample was last sent, or the service connected.
    last_progress: Instant,
    ended: Arc<AtomicBool>,
}

impl SampleSender {
    fn new(imu: &ImuId, domain: Domain, ended: Arc<AtomicBool>) -> Self {
        let options = Options::new(domain, REPLY_TIMEOUT);
        Self {
            imu: imu.clone(),
            options,
            acquisition: None,
            last_attempt: None,
            obstacle: String::new(),
            last_progress: Instant::now(),
            ended,
        }
    }

    /// Sends a sample. Without a service the sample is dropped, as with a real IMU. If the service is late, this waits for it.
    fn send(&mut self, raw: &RawSample) {
        if self.acquisition.is_none()
            && self.last_attempt.is_none_or(|last_attempt| last_attempt.elapsed() > CONNECT_INTERVAL)
        {
            match Acquisition::connect(&self.imu, &self.options) {
                Ok(acquisition) => (self.acquisition, self.obstacle) = (Some(acquisition), String::new()),
                Err(error) => self.print_obstacle(&error.to_string()),
            }
            self.last_attempt = Some(Instant::now());
            self.last_progress = Instant::now();
        }
        let Some(acquisition) = &mut self.acquisition else { return };
        let Ok(mut loan) = acquisition.loan() else { return };
        let session = loan.session;
        *loan = RawSample { session, ..*raw };
        loop {
            loan = match acquisition.send(loan) {
                Ok(()) => {
                    self.last_progress = Instant::now();
                    break;
                }
                Err(SendError::Full(back)) => back,
                // The next sample begins another session.
                Err(_) => return self.acquisition = None,
            };
            let answered = acquisition.receive_timeout(REPLY_TIMEOUT);
            if answered.is_err() {
                return self.acquisition = None;
            }
            if self.last_progress.elapsed() > DROP_AFTER || self.ended.load(Ordering::Relaxed) {
                return;
            }
        }
        self.receive();
    }

    fn print_obstacle(&mut self, obstacle: &str) {
        if self.obstacle != obstacle {
            self.obstacle = obstacle.to_owned();
            tell("isotherm", format_args!("the simulated IMU: {obstacle}; it keeps trying to connect"));
        }
    }

    /// Receives the increments that have arrived, and detects the end of the service.
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
