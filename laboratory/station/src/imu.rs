//! The process of the IMU, or of the IMUs that share a turntable: it simulates one control period after the other and
//! publishes raw samples, as acquisitions do.

use super::faults::FaultSchedule;
use super::link::{DeviceEvent, DeviceReply, LinkClient};
use super::positioning::PositioningErrors;
use super::station::{SimulatedStation, StationImu, StationProcess};
use isotherm_client::{Acquisition, Domain, ImuId, Options, SendError};
use isotherm_documents::load_table;
use isotherm_files::Trust;
use isotherm_shared::wire::RawSample;
use isotherm_simulation as simulate;
use isotherm_simulation::{InertialMotion, SimulatedTurntable, Truth};
use isotherm_support::failure::{Exit, Failure, tell};
use nalgebra::Matrix3;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use std::{io, thread};

/// Shortest pause between two questions to the devices.
const PAUSE: Duration = Duration::from_millis(1);
/// Samples between two pauses when the IMU catches up after a stall. The pauses let the readers of the stream keep up.
const BURST: u32 = 32;
/// Interval between two attempts to connect to the service.
const CONNECT_INTERVAL: Duration = Duration::from_millis(200);
/// Longest wait for a connection, and for an increment while the queue is full.
const REPLY_TIMEOUT: Duration = Duration::from_millis(20);
/// Samples are dropped after the queue was full for this time, and those of a time in which this process was stopped
/// for longer.
const DROP_AFTER: Duration = Duration::from_secs(10);
/// A new set point begins another visit if the air was at the last one for longer than this \[s\].
const VISIT_S: f64 = 600.0;

/// Runs until SIGTERM or SIGINT, or until the process of a device has ended. SIGUSR1 restarts the acquisitions: the
/// service sees other sessions.
///
/// # Errors
/// If the true coefficients of an IMU cannot be read.
pub(crate) fn run(station: &SimulatedStation, folder: &Path, domain: &Domain) -> Result<(), Failure> {
    let ended = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        // If this fails, the signal ends the process at once, and the service cleans up.
        let _ = signal_hook::flag::register(signal, Arc::clone(&ended));
    }
    let restart = Arc::new(AtomicBool::new(false));
    let handled = signal_hook::flag::register(signal_hook::consts::SIGUSR1, Arc::clone(&restart));
    handled.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
    let failed = |error: io::Error| Failure::new(Exit::Io, format!("the simulated IMU: {error}"));
    let truths = station.imus.iter().map(|imu| {
        let table = load_table(&folder.join(&imu.truth), None, Trust::Any)?.0;
        let SimulatedStation { tilt_rad, gravity_local, latitude_deg, heading_deg, .. } = *station;
        let plays = station.plays.clone();
        Ok(Truth { plays, tilt_rad, gravity_local, latitude_deg, heading_deg, ..Truth::of(table) })
    });
    let truths = truths.collect::<Result<Vec<_>, Failure>>()?;
    let mut devices = [LinkClient::new(io::stdin()).map_err(failed)?, LinkClient::new(io::stdout()).map_err(failed)?];
    let mut imus = Vec::new();
    for (imu, truth) in station.imus.iter().zip(&truths) {
        let id: ImuId = imu.id.parse().map_err(|error| Failure::new(Exit::Config, format!("{error}")))?;
        let serial = truth.table.content().serial.clone();
        let output = SampleSender::new(&id, serial, domain.clone(), Arc::clone(&ended));
        imus.push((MountedImu::new(station, imu, truth), output));
    }
    let mut faults = FaultSchedule::new(folder, StationProcess::Imu);
    let mut last_turn = Instant::now();
    // The samples until then are not sent.
    let mut missed_s = 0.0;
    while !ended.load(Ordering::Relaxed) {
        if last_turn.elapsed() > DROP_AFTER {
            missed_s = station.now_s();
        }
        last_turn = Instant::now();
        let mut known_s = f64::INFINITY;
        for device in &mut devices {
            let Ok(DeviceReply { now_s, events }) = device.ask() else { return Ok(()) };
            known_s = known_s.min(now_s);
            for (imu, _) in &mut imus {
                imu.take_events(events.iter().copied());
            }
        }
        faults.reload_if_changed();
        let restarts = restart.swap(false, Ordering::Relaxed);
        for (imu, output) in &mut imus {
            if restarts {
                output.acquisition = None;
            }
            let mut burst = 0;
            while imu.end_s() <= known_s && !ended.load(Ordering::Relaxed) {
                let sample = imu.step();
                if imu.begin_s() >= missed_s && !faults.is_silent(imu.begin_s(), &output.imu) {
                    output.send(&sample);
                }
                burst += 1;
                if burst % BURST == 0 {
                    thread::sleep(PAUSE);
                }
            }
            output.receive();
        }
        let end_s = imus.iter().map(|(imu, _)| imu.end_s()).fold(f64::INFINITY, f64::min);
        let left = (end_s - station.now_s()) / station.speed;
        thread::sleep(Duration::from_secs_f64(left.clamp(0.0, 0.1)).max(PAUSE));
    }
    Ok(())
}

/// The IMU with the turntable and the chamber that it is in, at the end of the last simulated period.
pub struct MountedImu<'a> {
    truth: &'a Truth,
    /// The rotation from the turntable's axes to the IMU's.
    mounting: Matrix3<f64>,
    imu: simulate::SimulatedImu,
    turntable: SimulatedTurntable,
    interval_ns: u64,
    /// Number of simulated periods.
    periods: u64,
    /// Events of the devices that are later than the last simulated period.
    events: VecDeque<(f64, DeviceEvent)>,
    errors: PositioningErrors,
    /// The time that the turntable has reached \[s\].
    now_s: f64,
    target_c: f64,
    /// When the air reached its target temperature \[s\].
    arrived_s: f64,
}

impl<'a> MountedImu<'a> {
    /// At rest at both angles 0, in equilibrium with the laboratory.
    #[must_use]
    pub fn new(station: &SimulatedStation, imu: &StationImu, truth: &'a Truth) -> Self {
        let SimulatedStation { chain, noise, ambient_c, seed, interval_ns, .. } = station;
        let mounting = Matrix3::from_fn(|i, j| imu.mounting[i][j]);
        let mut imu = simulate::SimulatedImu::new(truth, chain, noise, *ambient_c, imu.seed);
        imu.visit();
        Self {
            truth,
            mounting,
            imu,
            turntable: SimulatedTurntable::default(),
            interval_ns: *interval_ns,
            periods: 0,
            events: VecDeque::new(),
            errors: PositioningErrors::new(noise, *seed),
            now_s: 0.0,
            target_c: *ambient_c,
            arrived_s: 0.0,
        }
    }

    /// Begin of the next period \[s\].
    #[must_use]
    pub fn begin_s(&self) -> f64 {
        (self.periods * self.interval_ns) as f64 / 1e9
    }

    /// End of the next period \[s\].
    #[must_use]
    pub fn end_s(&self) -> f64 {
        ((self.periods + 1) * self.interval_ns) as f64 / 1e9
    }

    /// Takes events of the devices, of which none is earlier than the end of the last simulated period.
    pub fn take_events(&mut self, events: impl IntoIterator<Item = (f64, DeviceEvent)>) {
        self.events.extend(events);
        self.events.make_contiguous().sort_by(|(a, _), (b, _)| a.total_cmp(b));
    }

    /// Angles of the turntable \[deg\] and temperature of the chamber's air \[degC\] at the end of the last simulated
    /// period.
    #[must_use]
    pub fn surroundings(&self) -> ([f64; 2], f64) {
        (self.turntable.angles_deg(), self.imu.chamber_c())
    }

    /// Simulates a period with the turntable's motion in it. Events of the chamber take effect from the beginning of
    /// the period.
    pub fn step(&mut self) -> RawSample {
        let (begin_s, end_s) = (self.begin_s(), self.end_s());
        let motion = InertialMotion::over(self.truth, self.interval_ns as f64 / 1e9, |time_s| {
            self.advance(begin_s + time_s);
            self.turntable.angles_deg()
        });
        self.periods += 1;
        let raw = self.imu.step(&motion.mounted(&self.mounting), self.interval_ns);
        if self.imu.chamber_c() != self.target_c {
            self.arrived_s = end_s;
        }
        raw
    }

    /// Moves the turntable on to `until_s`, with the events until then.
    fn advance(&mut self, until_s: f64) {
        while let Some((at_s, event)) = self.events.front().copied().filter(|(at_s, _)| *at_s <= until_s) {
            self.events.pop_front();
            self.wait(at_s);
            self.begin(event);
        }
        self.wait(until_s);
    }

    fn wait(&mut self, until_s: f64) {
        self.turntable.wait((until_s - self.now_s).max(0.0));
        self.now_s = until_s.max(self.now_s);
    }

    fn begin(&mut self, event: DeviceEvent) {
        match event {
            DeviceEvent::Chamber { target_c, ramp_c_per_s } => {
                if self.now_s - self.arrived_s > VISIT_S {
                    self.imu.visit();
                }
                (self.target_c, self.arrived_s) = (target_c, self.now_s);
                self.imu.go_to(target_c, ramp_c_per_s);
            }
            DeviceEvent::GoTo { axis, angle_deg, rate, acceleration } => {
                self.turntable.go_to(axis, self.errors.rest_deg(axis, angle_deg), rate, acceleration);
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
    /// Whether nothing was sent yet: the simulated IMU begins soaked.
    is_soaked: bool,
    last_attempt: Option<Instant>,
    /// Error of the last attempt to connect, so that it is printed only once.
    obstacle: String,
    /// When a sample was last sent, or the service connected.
    last_progress: Instant,
    ended: Arc<AtomicBool>,
}

impl SampleSender {
    fn new(imu: &ImuId, serial: Option<String>, domain: Domain, ended: Arc<AtomicBool>) -> Self {
        let options = Options { serial, ..Options::new(domain, REPLY_TIMEOUT) };
        Self {
            imu: imu.clone(),
            options,
            acquisition: None,
            is_soaked: true,
            last_attempt: None,
            obstacle: String::new(),
            last_progress: Instant::now(),
            ended,
        }
    }

    /// Sends a sample. Without a service the sample is dropped, as with a real IMU. If the service is late, this waits
    /// for it.
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
        if core::mem::take(&mut self.is_soaked) {
            acquisition.lag().soaked();
        }
        acquisition.lag().follow(raw);
        let Ok(mut loan) = acquisition.loan_record(raw) else { return };
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
            tell("isotherm", format_args!("the simulated IMU {}: {obstacle}; it keeps trying to connect", self.imu));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ChamberProtocol, TurntableProtocol};
    use isotherm_campaign::EARTH_RATE;
    use isotherm_shared::compensate::answer;
    use isotherm_shared::table::CoefficientTable;
    use isotherm_shared::units::ARCSEC;
    use isotherm_simulation::{Chain, Noise, Play};

    /// 5 s of rest, 37 s of turning by 360 degrees at 10 deg/s with 10 deg/s2, 5 s of rest.
    const REST_S: f64 = 5.0;
    const TURN_S: f64 = 37.0;
    const WHOLE_S: f64 = TURN_S + 2.0 * REST_S;
    /// Horizontal Earth's rate across the turn does not average out: over the rests, and over rate / acceleration.
    const ACROSS_S: f64 = 2.0 * REST_S + 1.0;

    fn station(interval_ns: u64) -> SimulatedStation {
        SimulatedStation {
            imus: vec![StationImu::new("imu-g", 0, 1, 1)],
            chamber: ChamberProtocol::Espec,
            chamber_port: String::new(),
            table: TurntableProtocol::Acutrol,
            table_port: String::new(),
            wrap: false,
            speed: 1.0,
            origin_ns: 0,
            interval_ns,
            seed: 1,
            ambient_c: 20.0,
            ramp_c_per_s: 0.05,
            tilt_rad: [0.0; 2],
            gravity_local: 9.8015,
            latitude_deg: 39.9,
            heading_deg: 30.0,
            chain: Chain { oscillation_c: 0.0, telemetry_lsb_micro: 0, ..Chain::default() },
            noise: Noise::NONE,
            plays: Vec::new(),
        }
    }

    fn truth(station: &SimulatedStation) -> Truth {
        let text = include_str!("../../../tests/data/imu-g.toml");
        let table = CoefficientTable::from_toml(text, None).unwrap();
        let SimulatedStation { latitude_deg, heading_deg, .. } = *station;
        Truth { latitude_deg, heading_deg, ..Truth::of(table) }
    }

    const fn go_to(axis: usize, angle_deg: f64) -> DeviceEvent {
        DeviceEvent::GoTo { axis, angle_deg, rate: 10.0, acceleration: 10.0 }
    }

    /// What the truth makes of the IMU's samples over `seconds`: the angles along the body's axes \[arcsec\] and the
    /// velocities \[g0 s\].
    fn compensated(imu: &mut MountedImu<'_>, seconds: f64) -> [[f64; 3]; 2] {
        let [mut angle, mut velocity] = [[0.0; 3]; 2];
        for _ in 0..(seconds * 1e9 / imu.interval_ns as f64).round() as u64 {
            let compensation = answer(Some(&imu.truth.table), &imu.step());
            let [angles, velocities] = [compensation.angle_increment, compensation.velocity_increment];
            angle.iter_mut().zip(angles).for_each(|(sum, increment)| *sum += increment / ARCSEC);
            velocity.iter_mut().zip(velocities).for_each(|(sum, increment)| *sum += increment / 9.8015);
        }
        [angle, velocity]
    }

    /// The pulses of a gyroscope are about an arc second; up to one stays in each channel at each end, and the
    /// alignment adds a thousandth.
    fn assert_near(found: [f64; 3], right: [f64; 3], tolerance: f64) {
        let off = found.iter().zip(right).map(|(found, right)| (found - right).abs()).fold(0.0, f64::max);
        assert!(off < tolerance, "{found:?}, not {right:?}");
    }

    #[test]
    fn over_a_whole_turn_the_gyroscopes_turn_by_its_angle_and_with_earth() {
        for interval_ns in [1_000_000_000, 100_000_000] {
            let station = station(interval_ns);
            let truth = truth(&station);
            let [x, y, z] = truth.earth_rate();
            assert!((z - EARTH_RATE * libm::sin(39.9_f64.to_radians())).abs() < 1e-9);
            let mut imu = MountedImu::new(&station, &station.imus[0], &truth);
            imu.events.push_back((REST_S, go_to(0, 360.0)));
            imu.events.push_back((REST_S, go_to(1, 0.0)));
            let [angle, force] = compensated(&mut imu, WHOLE_S);
            let around = 360.0 * 3600.0;
            assert_near(angle, [around + x * WHOLE_S, y * ACROSS_S, z * ACROSS_S], 2.5);
            assert_near(force, [0.0, 0.0, ACROSS_S], 1e-3);
            // Back, in two moves of which the first is stopped.
            let begin_s = WHOLE_S;
            imu.events.push_back((begin_s + 5.0, go_to(0, 0.0)));
            imu.events.push_back((begin_s + 15.0, DeviceEvent::Stop { axis: 0, acceleration: 50.0 }));
            imu.events.push_back((begin_s + 20.0, go_to(0, 0.0)));
            let [angle, _] = compensated(&mut imu, 60.0);
            assert!((angle[0] + around - x * 60.0).abs() < 2.5, "{angle:?}");
            assert_eq!((imu.turntable.angles_deg(), imu.turntable.rates_deg_s()), ([0.0; 2], [0.0; 2]));
            // About the vertical.
            let begin_s = begin_s + 60.0;
            imu.events.push_back((begin_s + REST_S, go_to(1, -360.0)));
            let [angle, force] = compensated(&mut imu, WHOLE_S);
            assert_near(angle, [x * ACROSS_S, y * ACROSS_S, z * WHOLE_S - around], 2.5);
            assert_near(force, [0.0, 0.0, WHOLE_S], 1e-3);
        }
    }

    /// Wherever a turn begins and ends within a period, nothing of it is lost; the sum of the error of each rest is in
    /// it.
    #[test]
    fn a_turn_between_the_edges_of_periods_is_whole_and_repeats() {
        let mut station = station(1_000_000_000);
        station.noise = Noise { positioning_rad: 10.0 * ARCSEC, turn_rad: 0.2 * ARCSEC, ..Noise::NONE };
        let truth = truth(&station);
        let [x, ..] = truth.earth_rate();
        let mut imu = MountedImu::new(&station, &station.imus[0], &truth);
        for turn in 0..20_u32 {
            let begin_s = f64::from(turn) * 50.0;
            let (target, turned_deg) = if turn % 2 == 0 { (360.0, 360.0) } else { (0.0, -360.0) };
            imu.events.push_back((begin_s + 5.0 + 0.37 * f64::from(turn % 7), go_to(0, target)));
            let [angle, _] = compensated(&mut imu, 50.0);
            let right = turned_deg * 3600.0 + x * 50.0;
            assert!((angle[0] - right).abs() < 2.5 + 1.2, "{turn}: {} {right}", angle[0]);
        }
        // A new position is off by its own error.
        let off = imu.errors.rest_deg(0, 77.0) - 77.0;
        assert!(off.abs() * 3600.0 > 1.5, "{off}");
    }

    /// The station's IMU remembers its temperature: on a ramp the element is behind its head by the time constant times
    /// the rate, and a play is at its end.
    #[test]
    fn lag_and_hysteresis_of_the_truth_are_felt() {
        let mut station = station(1_000_000_000);
        let still = truth(&station);
        let still = Truth { table: still.static_table(), ..still };
        station.plays =
            vec![Play { half_width: 0.1, accelerometers: [0.0, 3e-3, 0.0], gyroscopes: [0.0, 0.0, -200.0] }];
        let mut content = still.table.content().clone();
        content.lag_s = Some(120.0);
        content.format = content.least_format();
        content.axes[0].transient = 2e-3 / content.axes[0].bias_unit.factor();
        content.gyroscopes.as_mut().unwrap().axes[1].transient = 500.0;
        let table = CoefficientTable::new(content).unwrap();
        let moving = Truth { table, plays: station.plays.clone(), ..still.clone() };
        let mut imus = [&still, &moving].map(|truth| MountedImu::new(&station, &station.imus[0], truth));
        // 0.6 degC/min up: after 40 min heads and elements follow at that rate.
        let ramp = DeviceEvent::Chamber { target_c: 80.0, ramp_c_per_s: 0.01 };
        let [resting, moving] = imus.each_mut().map(|imu| {
            imu.truth = &still;
            imu.events.push_back((0.0, ramp));
            compensated(imu, 2400.0);
            compensated(imu, 100.0).map(|sums| sums.map(|sum| sum / 100.0))
        });
        // 0.01 degC/s are 4e-4 V/s: 48 mV behind; sums of 100 s are true to two pulses.
        let [angle, force] = [0, 1].map(|kind| [0, 1, 2].map(|i| moving[kind][i] - resting[kind][i]));
        let lag_v = -120.0 * 4e-4;
        assert_near(force.map(|f| f * 1e3), [2.0 * lag_v, 3.0 * -0.1, 0.0], 2e-3);
        assert_near(angle, [0.0, 500.0 * lag_v, -200.0 * -0.1], 0.15);
    }
}
