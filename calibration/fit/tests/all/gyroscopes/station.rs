//! A station with a known truth: the rows that an IMU would give in dwells and turns.
//!
//! The physics is that of `isotherm_simulation`: Earth's rate, the integral of the motion, the charge balance. It
//! shares nothing with the fit. The station here differs from a simulated campaign: any mounting, any axis, speed
//! profiles that are not symmetric, a drift within a set point, wrong statements in the campaign file.
//!
//! Over 400 lines: campaigns and runs are of the same IMU, whose table is next to them.

use isotherm_campaign::{Campaign, outer_axis};
use isotherm_fit::{Calibration, CalibrationError, CalibrationOptions, calibrate, read_measurements};
use isotherm_recording::CampaignRow;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable, Content, Gyroscopes, OutOfRange, Turntable};
use isotherm_shared::units::BiasUnit;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_simulation::{InertialMotion, SimulatedGyroscopes, SimulatedTriad, Truth, worst_gyroscope_errors};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::fmt::Write as _;

const G0: f64 = 9.8015;

/// Misalignment of the accelerometers.
const ACCELEROMETERS: Matrix3<f64> = Matrix3::new(1.0, 2e-4, -1e-4, 3e-4, 1.0, 1e-4, -2e-4, 1e-4, 1.0);

/// A cubic of temperature \[V\].
pub(crate) type Cubic = [f64; 4];

pub(crate) fn cubic(c: &Cubic, u: f64) -> f64 {
    c[0] + u * (c[1] + u * (c[2] + u * c[3]))
}

/// One gyroscope.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gyroscope {
    pub bias: Cubic,
    pub kp: Cubic,
    pub kn: Cubic,
    pub s: [f64; 3],
    /// Row of M.
    pub m: [f64; 3],
}

/// A turn: number, axis in IMU coordinates, angle, and the angles at which it begins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TestTurn {
    pub number: u32,
    pub axis: [f64; 3],
    pub angle: f64,
    pub outer: f64,
    pub inner: f64,
}

/// The station and its IMU.
#[derive(Clone, Debug)]
pub(crate) struct Station {
    pub gyroscopes: [Gyroscope; 3],
    pub latitude: f64,
    pub heading: f64,
    pub tilt: [f64; 2],
    pub gravity: f64,
    /// IMU coordinates of the turntable's axes.
    pub mount: Matrix3<f64>,
    pub set_points: Vec<f64>,
    /// Outer and inner angle.
    pub positions: Vec<[f64; 2]>,
    pub turns: Vec<TestTurn>,
    /// deg/s, deg/s2 up and down.
    pub profile: [f64; 3],
    /// A turn is done in so many equal moves, with 2 s of rest between them.
    pub moves: u32,
    /// Rest before and after \[s\].
    pub rest: f64,
    pub dwell: f64,
    pub dwell_row: f64,
    pub turn_row: f64,
    /// Change of the temperature over a set point \[degC\].
    pub drift: f64,
    /// arcsec/sqrt(s).
    pub random_walk: f64,
    /// deg/h, relative, arcsec: of a set point, of a set point, of a turn.
    pub repeatability: [f64; 3],
    pub seed: u64,
    /// What the campaign file says instead, if it is wrong.
    pub stated_latitude: Option<f64>,
    /// Whether the campaign file has angles.
    pub angles: bool,
}

pub(crate) struct Random(pub u64);

impl Random {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    pub(crate) fn normal(&mut self) -> f64 {
        (-2.0 * libm::log(1.0 - self.uniform())).sqrt() * libm::cos(std::f64::consts::TAU * self.uniform())
    }
}

/// Six faces in two headings.
pub(crate) const S1: [[f64; 2]; 12] = [
    [0.0, 0.0],
    [0.0, 180.0],
    [180.0, 0.0],
    [180.0, 180.0],
    [90.0, 90.0],
    [270.0, 270.0],
    [90.0, 270.0],
    [270.0, 90.0],
    [90.0, 0.0],
    [270.0, 180.0],
    [90.0, 180.0],
    [270.0, 0.0],
];

/// The six turns of the data, numbered from 101.
pub(crate) fn six_turns(angle: f64) -> Vec<TestTurn> {
    let axes = [([1.0, 0.0, 0.0], 0.0), ([0.0, -1.0, 0.0], 90.0), ([0.0, 0.0, 1.0], 0.0)];
    let turns = axes.into_iter().flat_map(|(axis, inner)| [angle, -angle].map(|angle| (axis, inner, angle)));
    (101..)
        .zip(turns)
        .map(|(number, (axis, inner, angle))| TestTurn { number, axis, angle, outer: 0.0, inner })
        .collect()
}

impl Station {
    /// Another IMU and station for each seed; no noise.
    pub(crate) fn new(seed: u64) -> Self {
        let mut random = Random(seed.wrapping_mul(77).wrapping_add(5));
        let mut curve = |value: f64, change: f64| {
            // A curve that changes by about `change` over 1.1 to 3.9 V.
            let [a, b, c] = [0, 1, 2].map(|_| random.between(-change, change));
            let (x, y) = (-2.5 / 1.4, 1.0 / 1.4);
            // a t + b t^2 + c t^3 with t = x + y u.
            [
                value + a * x + b * x * x + c * x * x * x,
                y * (a + 2.0 * b * x + 3.0 * c * x * x),
                y * y * (b + 3.0 * c * x),
                c * y * y * y,
            ]
        };
        let scales = [0.85, 1.2, 0.97];
        let curves = scales.map(|k| [curve(-2.0, 3.0), curve(k, 60e-6 * k), curve(-k * 1.0007, 60e-6 * k)]);
        let gyroscopes = [0, 1, 2].map(|axis| {
            let [bias, kp, kn] = curves[axis];
            let mut m = [0, 1, 2].map(|_| random.between(-5e-4, 5e-4));
            m[axis] = 1.0;
            Gyroscope { bias, kp, kn, s: [0, 1, 2].map(|_| random.between(-1.0, 1.0)), m }
        });
        Self {
            gyroscopes,
            latitude: random.between(-70.0, 70.0),
            heading: random.between(0.0, 360.0),
            tilt: [random.between(-8e-5, 8e-5), random.between(-8e-5, 8e-5)],
            gravity: 9.80123,
            mount: Matrix3::identity(),
            set_points: (-5..=9).map(|step| 5.0 * f64::from(step)).collect(),
            positions: S1.to_vec(),
            turns: six_turns(360.0),
            profile: [10.0, 10.0, 7.0],
            moves: 1,
            rest: 5.3,
            dwell: 300.0,
            dwell_row: 10.0,
            turn_row: 1.0,
            drift: 0.05,
            random_walk: 0.0,
            repeatability: [0.0; 3],
            seed,
            stated_latitude: None,
            angles: true,
        }
    }

    /// With the noise that the bounds are for.
    pub(crate) fn noisy(self) -> Self {
        Self { random_walk: 0.003 * 60.0, repeatability: [0.003, 0.5e-6, 0.2], ..self }
    }

    /// Finer pulses: what is left is the method's error, not that of a pulse more or less.
    pub(crate) fn fine(mut self) -> Self {
        for gyroscope in &mut self.gyroscopes {
            (gyroscope.kp, gyroscope.kn) = (gyroscope.kp.map(|c| 50.0 * c), gyroscope.kn.map(|c| 50.0 * c));
        }
        self
    }

    /// Base to IMU at the angles.
    fn attitude(&self, outer: f64, inner: f64) -> Matrix3<f64> {
        let body = Rotation3::from_axis_angle(&Vector3::x_axis(), outer.to_radians())
            * Rotation3::from_axis_angle(&Vector3::z_axis(), inner.to_radians());
        self.mount * body.matrix().transpose()
    }

    /// Mounting, angles at the start and direction of the angles, with which a turntable does this turn. About the
    /// vertical of the station that is neither of its axes (by hand, on a rate table) it is the inner axis of another
    /// mounting.
    fn on_the_turntable(&self, turn: &TestTurn) -> (Matrix3<f64>, [f64; 2], [f64; 2]) {
        let start = [turn.outer, turn.inner];
        let axis = self.mount.transpose() * Vector3::from(turn.axis);
        let along = |direction: Vector3<f64>| Some(axis.dot(&direction)).filter(|cosine| cosine.abs() > 1.0 - 1e-5);
        if let Some(cosine) = along(outer_axis(turn.inner)) {
            return (self.mount, start, [cosine.signum(), 0.0]);
        }
        if let Some(cosine) = along(Vector3::z()) {
            return (self.mount, start, [0.0, cosine.signum()]);
        }
        let to_imu = self.attitude(turn.outer, turn.inner);
        let vertical = (to_imu.transpose() * Vector3::from(turn.axis)).z;
        assert!(vertical.abs() > 1.0 - 1e-5, "{turn:?}");
        (to_imu, [0.0; 2], [0.0, vertical.signum()])
    }

    /// The truth that the library simulates, on a turntable whose axes are those of the IMU.
    pub(crate) fn truth(&self) -> Truth {
        let polynomial = |c: &Cubic| Polynomial::new(c, 0.0, 1.0, [0.9, 4.2]).unwrap();
        let axis = |bias_unit, bias: &Cubic, kp: &Cubic, kn: &Cubic| Axis {
            bias_unit,
            bias: polynomial(bias),
            transient: 0.0,
            positive_scale_factor: polynomial(kp),
            negative_scale_factor: polynomial(kn),
            max_rate: None,
        };
        let accelerometer = axis(
            BiasUnit::MicroG0,
            &[-50.0, 80.0, 0.0, 0.0],
            &[90_775.0, 90.0, 0.0, 0.0],
            &[-90_675.0, 70.0, 0.0, 0.0],
        );
        let misalignment = Matrix3::from_fn(|i, j| self.gyroscopes[i].m[j]);
        let content = Content {
            format: 2,
            imu: "imu-g".parse().unwrap(),
            serial: None,
            gravity: G0,
            nominal_interval_s: None,
            temperature_unit: "V".to_owned(),
            out_of_range: OutOfRange::Clamp,
            max_age_s: None,
            lag_s: None,
            axes: [(); 3].map(|()| accelerometer.clone()),
            alignment: ACCELEROMETERS.try_inverse(),
            gyroscopes: Some(Gyroscopes {
                axes: self.gyroscopes.map(|g| axis(BiasUnit::DegreePerHour, &g.bias, &g.kp, &g.kn)),
                g_sensitivity: self.gyroscopes.map(|g| Some(g.s)),
                alignment: misalignment.try_inverse(),
            }),
        };
        Truth {
            tilt_rad: self.tilt,
            gravity_local: self.gravity,
            latitude_deg: self.latitude,
            heading_deg: self.heading,
            ..Truth::of(CoefficientTable::new(content).unwrap())
        }
    }

    /// Earth's rate in the base \[deg/h\].
    pub(crate) fn earth(&self) -> Vector3<f64> {
        self.truth().earth_rate().into()
    }

    /// The campaign file.
    pub(crate) fn file(&self) -> String {
        let latitude = self.stated_latitude.unwrap_or(self.latitude);
        let mut text = format!(
            "format = 1\nimu = \"imu-g\"\nsamples = \"samples.csv\"\ngravity_reference = {G0}\ngravity_local = {:?}\n\
             latitude_deg = {latitude:?}\ntemperature_unit = \"V\"\n",
            self.gravity
        );
        let place = |number: u32, outer: f64, inner: f64| {
            let f = self.attitude(outer, inner) * Vector3::z();
            let angles =
                if self.angles { format!("outer_deg = {outer:?}\ninner_deg = {inner:?}\n") } else { String::new() };
            format!("number = {number}\n{angles}specific_force = [{:.12}, {:.12}, {:.12}]\n", f.x, f.y, f.z)
        };
        for (number, [outer, inner]) in (1..).zip(&self.positions) {
            let _ = write!(text, "\n[[position]]\n{}", place(number, *outer, *inner));
        }
        for turn in &self.turns {
            let (axis, angle) = (turn.axis, turn.angle);
            let _ = write!(
                text,
                "\n[[turn]]\naxis = [{:?}, {:?}, {:?}]\nangle_deg = {angle:?}\n{}",
                axis[0],
                axis[1],
                axis[2],
                place(turn.number, turn.outer, turn.inner)
            );
        }
        text
    }

    pub(crate) fn campaign(&self) -> Campaign {
        Campaign::from_toml(&self.file()).unwrap_or_else(|faults| panic!("{faults}\n{}", self.file()))
    }

    fn recorder(&self, stream: u64) -> Recorder<'_> {
        let truth = self.truth();
        Recorder {
            station: self,
            accelerometers: SimulatedTriad::new(&truth.table.content().axes),
            gyroscopes: SimulatedGyroscopes::of(&truth).unwrap(),
            truth,
            random: Random(self.seed ^ stream),
            rows: Vec::new(),
            now: 0.0,
        }
    }

    /// A verification run: `rows` samples of 10 s at rest at these angles, while the temperature goes from one end of
    /// the set points to the other.
    pub(crate) fn run(&self, angles: [f64; 2], rows: u32) -> Vec<RawSample> {
        const SECONDS: f64 = 10.0;
        let mut recorder = self.recorder(0x0BAD_5EED);
        let at_rest = |seconds| mounted(&self.mount, InertialMotion::at_rest(&recorder.truth, angles, seconds));
        let (settling, motion) = (at_rest(30.0), at_rest(SECONDS));
        let (from, to) = (self.set_points[0], self.set_points[self.set_points.len() - 1]);
        recorder.settle(&settling, from);
        for row in 0..rows {
            let temperature = from + (to - from) * (f64::from(row) + 0.5) / f64::from(rows);
            recorder.row(0.0, 0, &motion, SECONDS, temperature);
        }
        recorder.rows.into_iter().map(|row| row.sample).collect()
    }

    /// The table that compensates this IMU exactly, with the turntable as it stands.
    pub(crate) fn table(&self) -> CoefficientTable {
        self.truth().table.measured_at(Some(self.gravity)).measured_on(Some(self.turntable()))
    }

    /// The turntable as it stands.
    pub(crate) fn turntable(&self) -> Turntable {
        Turntable {
            earth_rate_deg_h: self.earth().into(),
            earth_rate_standard_error: Some([0.0; 2]),
            freedom: 14,
            tilt_rad: self.tilt,
            mounting: self.mount,
        }
    }

    /// The rows of the whole campaign.
    pub(crate) fn rows(&self) -> Vec<CampaignRow> {
        let mut recorder = self.recorder(0xABCD);
        for &set_point in &self.set_points {
            recorder.set_point(set_point);
        }
        recorder.rows
    }

    /// Calibrates the rows with the campaign file.
    pub(crate) fn calibrate_rows(
        &self,
        rows: Vec<CampaignRow>,
        options: CalibrationOptions,
    ) -> Result<Calibration, CalibrationError> {
        let campaign = self.campaign();
        let measurements = read_measurements(&campaign, rows.into_iter().map(Ok)).unwrap();
        calibrate(&campaign, measurements, options)
    }

    pub(crate) fn calibrate(&self, options: CalibrationOptions) -> Result<Calibration, CalibrationError> {
        self.calibrate_rows(self.rows(), options)
    }

    /// The worst errors over the range: D \[deg/h\], K \[ppm\], s \[deg/h/g0\], M \[rad\].
    pub(crate) fn errors(&self, calibration: &Calibration) -> [f64; 4] {
        worst_gyroscope_errors(&calibration.table, &self.truth().table).unwrap()
    }
}

/// Temperature of head and board of a sensor (0 to 5) at a temperature.
pub(crate) fn head_and_board(sensor: usize, temperature: f64) -> [f64; 2] {
    let offset = sensor as f64 * 0.3;
    [1.1 + 0.04 * (temperature + 25.0 + offset), 1.26 + 0.04 * (temperature + 25.0 - offset)]
}

struct Recorder<'a> {
    station: &'a Station,
    truth: Truth,
    accelerometers: SimulatedTriad,
    gyroscopes: SimulatedGyroscopes,
    random: Random,
    rows: Vec<CampaignRow>,
    /// s.
    now: f64,
}

impl Recorder<'_> {
    fn set_point(&mut self, set_point: f64) {
        let station = self.station;
        self.now += 4200.0;
        let [bias, scale, _] = station.repeatability;
        let begin = self.now;
        let whole = station.positions.len() as f64 * (station.dwell + 60.0) + station.turns.len() as f64 * 120.0;
        let at = move |now: f64| set_point + station.drift * ((now - begin) / whole - 0.5);
        self.gyroscopes.visit(bias, scale, || self.random.normal());
        for (number, &angles) in (1..).zip(&station.positions) {
            self.now += 60.0;
            let at_rest = |seconds| mounted(&station.mount, InertialMotion::at_rest(&self.truth, angles, seconds));
            let (settling, row) = (at_rest(30.0), at_rest(station.dwell_row));
            self.settle(&settling, at(self.now));
            for _ in 0..(station.dwell / station.dwell_row).round() as usize {
                self.row(set_point, number, &row, station.dwell_row, at(self.now + 0.5 * station.dwell_row));
            }
        }
        for turn in &station.turns {
            self.now += 60.0;
            self.turn(set_point, turn, &at);
        }
    }

    fn turn(&mut self, set_point: f64, turn: &TestTurn, at: &dyn Fn(f64) -> f64) {
        let station = self.station;
        let angle = turn.angle + station.repeatability[2] * self.random.normal() / 3600.0;
        let one = Move::new(angle / f64::from(station.moves), station.profile);
        let rows =
            ((2.0 * station.rest + f64::from(station.moves) * one.seconds() + 2.0 * f64::from(station.moves - 1))
                / station.turn_row)
                .ceil() as usize;
        let (mount, start, direction) = station.on_the_turntable(turn);
        let angles = |t: f64| {
            let period = one.seconds() + 2.0;
            let turned: f64 = (0..station.moves).map(|k| one.angle(t - station.rest - period * f64::from(k))).sum();
            [0, 1].map(|k| start[k] + direction[k] * turned)
        };
        let settling = mounted(&mount, InertialMotion::at_rest(&self.truth, start, 30.0));
        self.settle(&settling, at(self.now));
        for row in 0..rows {
            let begin = row as f64 * station.turn_row;
            let motion = InertialMotion::over(&self.truth, station.turn_row, |t| angles(begin + t));
            let temperature = at(self.now + 0.5 * station.turn_row);
            self.row(set_point, turn.number, &mounted(&mount, motion), station.turn_row, temperature);
        }
    }

    /// The table has moved there, and stands for half a minute before the first row: what the charge balance holds has
    /// the sign of the rate at rest.
    fn settle(&mut self, motion: &InertialMotion, temperature: f64) {
        let mut sample = self.sample(30.0, temperature);
        self.feel(&mut sample.gyroscopes, motion, 30.0);
    }

    fn row(&mut self, set_point_c: f64, number: u32, motion: &InertialMotion, seconds: f64, temperature: f64) {
        let mut sample = self.sample(seconds, temperature);
        let triad = &mut sample.accelerometers;
        let force = ACCELEROMETERS * Vector3::from(motion.specific_force);
        let indicated = [0, 1, 2]
            .map(|axis| (force[axis] + self.accelerometers.bias(axis, triad.head_temperature[axis])) * seconds);
        let scale_factors = self.accelerometers.scale_factors(triad.board_temperature);
        self.accelerometers.convert(indicated, &scale_factors, triad);
        self.feel(&mut sample.gyroscopes, motion, seconds);
        self.now += seconds;
        let line = self.rows.len() as u64 + 2;
        self.rows.push(CampaignRow { line, set_point_c, position: Some(number), sample });
    }

    fn feel(&mut self, triad: &mut Triad, motion: &InertialMotion, seconds: f64) {
        let walk = [0, 1, 2].map(|_| self.station.random_walk * seconds.sqrt() * self.random.normal());
        self.gyroscopes.feel(motion, seconds, [triad.head_temperature, triad.board_temperature], walk, triad);
    }

    /// A sample without pulses.
    fn sample(&self, seconds: f64, temperature: f64) -> RawSample {
        let triad = |first: usize| {
            let readings = [0, 1, 2].map(|axis| head_and_board(first + axis, temperature));
            Triad {
                head_temperature: readings.map(|r| r[0]),
                board_temperature: readings.map(|r| r[1]),
                ..Triad::default()
            }
        };
        RawSample {
            sequence: self.rows.len() as u64,
            timestamp_ns: ((self.now + seconds) * 1e9).round() as u64,
            interval_ns: (seconds * 1e9).round() as u64,
            accelerometers: triad(0),
            gyroscopes: triad(3),
            ..RawSample::default()
        }
    }
}

/// What an IMU feels that is mounted so on the turntable. A left-handed one feels rates as it feels forces.
fn mounted(mount: &Matrix3<f64>, motion: InertialMotion) -> InertialMotion {
    let [angle, specific_force] =
        [motion.angle, motion.specific_force].map(|vector| (mount * Vector3::from(vector)).into());
    InertialMotion { angle, specific_force }
}

/// From rest to rest at constant accelerations.
struct Move {
    angle: f64,
    rate: f64,
    up: f64,
    down: f64,
}

impl Move {
    fn new(angle: f64, [rate, up, down]: [f64; 3]) -> Self {
        // A short move does not reach the full rate.
        let most = (2.0 * angle.abs() / (1.0 / up + 1.0 / down)).sqrt();
        Self { angle, rate: rate.min(most), up, down }
    }

    fn seconds(&self) -> f64 {
        self.angle.abs() / self.rate + 0.5 * self.rate * (1.0 / self.up + 1.0 / self.down)
    }

    /// The angle after `t` \[deg\].
    fn angle(&self, t: f64) -> f64 {
        let (begin, end) = (self.rate / self.up, self.seconds() - self.rate / self.down);
        let size = if t <= 0.0 {
            0.0
        } else if t < begin {
            0.5 * self.up * t * t
        } else if t < end {
            0.5 * self.rate * begin + self.rate * (t - begin)
        } else {
            self.angle.abs() - 0.5 * self.down * (self.seconds() - t).max(0.0).powi(2)
        };
        size * self.angle.signum()
    }
}
