//! The schedule of the campaign on the turntable.
//!
//! It begins in equilibrium at the first set point. At each set point the chamber ramps, then soaks; `soak_s` includes
//! the ramp. Each position then takes `move_s` for the motion and `dwell_s` at rest. Only the rest gives rows, as many
//! whole periods as fit into it. Each angle of each dwell has a random error. The turns follow, each after another
//! `move_s`, in rows from rest to rest.

use crate::chain::{Chain, Noise};
use crate::imu::SimulatedImu;
use crate::model::Truth;
use crate::motion::InertialMotion;
use crate::random::RandomGenerator;
use crate::turntable::SimulatedTurntable;
use core::fmt::Write as _;
use isotherm_campaign::{Position, Scheme, TableAxis, Turn, outer_axis};
use isotherm_shared::wire::RawSample;
use nalgebra::Vector3;
use serde::Serialize;

/// Random stream of the errors of the turntable's angles in dwells.
const TURNTABLE_STREAM: u64 = 3;

/// Random stream of the errors of the turns' angles.
const TURN_STREAM: u64 = 7;

/// The schedule of a simulated campaign.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CampaignSchedule {
    /// Chamber temperatures, in order \[degC\].
    pub set_points_c: Vec<f64>,
    /// Magnitude of the chamber's ramp, over 0 \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Time from leaving one set point to the first motion at the next one, ramp included \[s\].
    pub soak_s: f64,
    /// Duration of the motion to a position \[s\].
    pub move_s: f64,
    /// Time at rest in a position \[s\].
    pub dwell_s: f64,
    /// Period of a row \[ns\].
    pub interval_ns: u64,
    /// Positions at each set point, in order. In a position without angles the specific force is the stated one,
    /// without tilt and angle errors, and Earth's rate is left out.
    #[serde(skip)]
    pub positions: Vec<Position>,
    /// The turns after the positions of each set point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turns: Option<TurnSchedule>,
    /// The simulated hardware.
    pub chain: Chain,
    /// Random deviations.
    pub noise: Noise,
}

/// The turns at each set point, from rest to rest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TurnSchedule {
    /// Rate of the axis, over 0 \[deg/s\].
    pub rate_deg_s: f64,
    /// Acceleration and deceleration, over 0 \[deg/s2\].
    pub acceleration_deg_s2: f64,
    /// Rest before the motion, and least rest after it \[s\].
    pub rest_s: f64,
    /// Period of a row, over 0 \[ns\].
    pub interval_ns: u64,
    /// The turns, in order. One without angles or about no axis of the turntable gives no rows.
    #[serde(skip)]
    pub turns: Vec<Turn>,
}

impl TurnSchedule {
    /// Six whole turns: about the outer axis at inner angle 0 and 90, then about the inner axis at outer angle 0, each
    /// forwards and back by `angle_deg`. They are numbered from `first`. 10 deg/s, 10 deg/s2, 5 s of rest, rows of 1 s.
    ///
    /// ```
    /// use isotherm_simulation::TurnSchedule;
    ///
    /// let turns = TurnSchedule::six_turns(13, 360.0).turns;
    /// assert_eq!((turns.len(), turns[0].start.number), (6, 13));
    /// assert_eq!((turns[0].angle_deg, turns[1].angle_deg), (360.0, -360.0)); // forwards and back
    /// ```
    #[must_use]
    pub fn six_turns(first: u32, angle_deg: f64) -> Self {
        let outer = |inner| (TableAxis::Outer, inner, outer_axis(inner));
        let axes = [outer(0.0), outer(90.0), (TableAxis::Inner, 0.0, Vector3::z())];
        let signed = axes.into_iter().flat_map(|axis| [(axis, angle_deg), (axis, -angle_deg)]);
        let turn = |(number, ((table_axis, inner, axis), angle_deg)): (u32, ((_, f64, Vector3<f64>), f64))| Turn {
            start: Position::at(number, 0.0, inner),
            axis: axis.into(),
            angle_deg,
            about: Some((table_axis, 1.0)),
        };
        Self {
            rate_deg_s: 10.0,
            acceleration_deg_s2: 10.0,
            rest_s: 5.0,
            interval_ns: 1_000_000_000,
            turns: (first..).zip(signed).map(turn).collect(),
        }
    }

    /// Number of rows of a turn: as many as it takes from rest to rest.
    fn rows(&self, turn: &Turn) -> u64 {
        if turn.about.is_none() || turn.start.angles.is_none() {
            return 0;
        }
        let (size, rate) = (turn.angle_deg.abs(), self.rate_deg_s);
        // A short turn does not reach the rate.
        let peak = rate.min((self.acceleration_deg_s2 * size).sqrt());
        let motion_s = if size > 0.0 { size / peak + peak / self.acceleration_deg_s2 } else { 0.0 };
        nanoseconds(2.0 * self.rest_s + motion_s).div_ceil(self.interval_ns.max(1))
    }
}

impl Default for CampaignSchedule {
    /// -25 to 45 degC every 5 degC at 1 degC/min; 70 min of soak, then twelve times 60 s of motion and 300 s at rest in
    /// rows of 10 s.
    fn default() -> Self {
        Self {
            set_points_c: (-5..=9).map(|step| 5.0 * f64::from(step)).collect(),
            ramp_c_per_s: 1.0 / 60.0,
            soak_s: 4200.0,
            move_s: 60.0,
            dwell_s: 300.0,
            interval_ns: 10_000_000_000,
            positions: Scheme::SixFacesTwoHeadings.positions(),
            turns: None,
            chain: Chain::default(),
            noise: Noise::default(),
        }
    }
}

impl CampaignSchedule {
    /// Number of rows of a dwell; 0 if the dwell is shorter than the period, or the period is 0.
    fn rows_per_dwell(&self) -> u64 {
        nanoseconds(self.dwell_s).checked_div(self.interval_ns).unwrap_or(0)
    }

    /// The turns at each set point.
    fn turns(&self) -> &[Turn] {
        self.turns.as_ref().map_or(&[], |schedule| &schedule.turns)
    }

    /// Number of rows of the campaign.
    #[must_use]
    pub fn rows(&self) -> u64 {
        let turns = self.turns.iter().flat_map(|schedule| schedule.turns.iter().map(|turn| schedule.rows(turn)));
        match self.rows_per_dwell() {
            0 => 0,
            rows => self.set_points_c.len() as u64 * (self.positions.len() as u64 * rows + turns.sum::<u64>()),
        }
    }

    /// The text of the campaign file, whose samples are in `samples` next to it.
    #[must_use]
    pub fn campaign_toml(&self, truth: &Truth, samples: &str) -> String {
        let content = truth.table.content();
        let (imu, unit) = (content.imu.as_str(), &content.temperature_unit);
        let text = campaign_toml(imu, samples, content.gravity, truth.gravity_local, unit, &self.positions);
        if self.turns().is_empty() {
            return text;
        }
        let latitude = format!("latitude_deg = {}   # north positive\n", truth.latitude_deg);
        self.turns().iter().fold(latitude + &text, |text, turn| text + "\n" + &turn.to_toml())
    }
}

/// Rest before the first row of a dwell or turn \[s\]. Without it, the part of a pulse that a converter holds from
/// another attitude would make every rate that changes its sign from dwell to dwell too small.
const SETTLING_S: f64 = 30.0;

/// A row of a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedRow {
    /// Set point of the chamber \[degC\].
    pub set_point_c: f64,
    /// Number of the position or turn.
    pub position: u32,
    /// The sample that the acquisition latched. Its sequence counts the rows from 0; its time is 0 when the campaign
    /// begins.
    pub raw: RawSample,
}

/// A simulated campaign: an iterator over its rows.
#[derive(Clone, Debug)]
pub struct SimulatedCampaign<'a> {
    schedule: &'a CampaignSchedule,
    imu: SimulatedImu,
    angle_noise: RandomGenerator,
    turn_noise: RandomGenerator,
    truth: Truth,
    /// Number of dwells and turns that have begun.
    begun: usize,
    /// Remaining rows of the current dwell or turn.
    rows_left: u64,
    set_point_c: f64,
    position: u32,
    state: TableState,
}

/// What the turntable does.
#[derive(Clone, Debug)]
enum TableState {
    /// It is at rest; every row feels the same.
    Dwell(InertialMotion),
    Turn(TurnInProgress),
}

/// Simulates `schedule` with the IMU that `truth` describes.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_shared::table::CoefficientTable;
/// use isotherm_simulation::{CampaignSchedule, Truth, campaign};
///
/// let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
/// let truth = Truth::of(table);
/// let schedule = CampaignSchedule { set_points_c: vec![0.0, 20.0, 40.0], ..CampaignSchedule::default() };
/// let rows: Vec<_> = campaign(&truth, &schedule, 1).collect();
/// assert_eq!(rows.len(), 3 * 12 * 30); // twelve positions of 300 s, in rows of 10 s
/// assert_eq!((rows[0].set_point_c, rows[0].position), (0.0, 1));
/// // The campaign file that belongs to these rows.
/// assert!(schedule.campaign_toml(&truth, "samples.csv").contains("imu = \"imu-a\""));
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn campaign<'a>(truth: &Truth, schedule: &'a CampaignSchedule, seed: u64) -> SimulatedCampaign<'a> {
    let first = schedule.set_points_c.first().copied().unwrap_or_default();
    SimulatedCampaign {
        schedule,
        imu: SimulatedImu::new(truth, &schedule.chain, &schedule.noise, first, seed),
        angle_noise: RandomGenerator::new(seed, TURNTABLE_STREAM),
        turn_noise: RandomGenerator::new(seed, TURN_STREAM),
        truth: truth.clone(),
        begun: 0,
        rows_left: 0,
        set_point_c: first,
        position: 0,
        state: TableState::Dwell(InertialMotion::default()),
    }
}

impl SimulatedCampaign<'_> {
    /// Begins the next dwell or turn; `None` after the last one.
    fn next_place(&mut self) -> Option<()> {
        let (schedule, rows) = (self.schedule, self.schedule.rows_per_dwell());
        let places = schedule.positions.len() + schedule.turns().len();
        let visit = self.begun.checked_div(places).filter(|_| rows > 0)?;
        let place = self.begun % places;
        self.set_point_c = *schedule.set_points_c.get(visit)?;
        if self.begun > 0 && matches!(self.state, TableState::Dwell(_)) {
            self.imu.wait(nanoseconds(schedule.dwell_s) - rows * schedule.interval_ns);
        }
        if place == 0 {
            self.imu.visit();
            self.imu.go_to(self.set_point_c, schedule.ramp_c_per_s);
            self.imu.wait(nanoseconds(schedule.soak_s));
        }
        self.imu.wait(nanoseconds(schedule.move_s));
        self.begun += 1;
        if let Some(position) = schedule.positions.get(place) {
            self.position = position.number;
            self.state = TableState::Dwell(self.dwell(position));
            self.rows_left = rows;
        } else if let Some(turns) = &schedule.turns {
            let turn = &turns.turns[place - schedule.positions.len()];
            self.position = turn.start.number;
            self.rows_left = turns.rows(turn);
            self.state = TableState::Turn(self.turn(turns, turn));
        }
        Some(())
    }

    /// What a row feels in `position`, at the angles where the turntable comes to rest, their errors included.
    fn dwell(&mut self, position: &Position) -> InertialMotion {
        let Some(angles) = position.angles else {
            let gravity = self.truth.gravity_local / self.truth.table.content().gravity;
            return InertialMotion::of_force(position.specific_force.map(|f| f * gravity));
        };
        let noise = self.schedule.noise.positioning_rad;
        let angles = angles.map(|angle| angle + (noise * self.angle_noise.normal()).to_degrees());
        self.imu.settle(&InertialMotion::at_rest(&self.truth, angles, SETTLING_S), SETTLING_S);
        InertialMotion::at_rest(&self.truth, angles, self.schedule.interval_ns as f64 / 1e9)
    }

    /// The turntable before `turn`, whose angle has an error.
    fn turn(&mut self, schedule: &TurnSchedule, turn: &Turn) -> TurnInProgress {
        let error_deg = (self.schedule.noise.turn_rad * self.turn_noise.normal()).to_degrees();
        let start = turn.start.angles.unwrap_or_default();
        self.imu.settle(&InertialMotion::at_rest(&self.truth, start, SETTLING_S), SETTLING_S);
        let (axis, sign) = match turn.about {
            Some((TableAxis::Inner, sign)) => (1, sign),
            Some((TableAxis::Outer, sign)) => (0, sign),
            None => (0, 0.0),
        };
        let target_deg = start[axis] + sign * (turn.angle_deg + error_deg);
        TurnInProgress {
            turntable: SimulatedTurntable::at(start),
            now_s: 0.0,
            command: Some(MoveCommand {
                at_s: schedule.rest_s,
                axis,
                target_deg,
                rate: schedule.rate_deg_s,
                acceleration: schedule.acceleration_deg_s2,
            }),
            interval_ns: schedule.interval_ns,
        }
    }
}

impl Iterator for SimulatedCampaign<'_> {
    type Item = SimulatedRow;

    fn next(&mut self) -> Option<SimulatedRow> {
        while self.rows_left == 0 {
            self.next_place()?;
        }
        self.rows_left -= 1;
        let (motion, interval_ns) = match &mut self.state {
            TableState::Dwell(motion) => (*motion, self.schedule.interval_ns),
            TableState::Turn(turn) => (turn.row(&self.truth), turn.interval_ns),
        };
        let raw = self.imu.step(&motion, interval_ns);
        Some(SimulatedRow { set_point_c: self.set_point_c, position: self.position, raw })
    }
}

/// A turn: the turntable at the end of the last row.
#[derive(Clone, Debug)]
struct TurnInProgress {
    turntable: SimulatedTurntable,
    /// Time since the first row began \[s\].
    now_s: f64,
    /// `None` once it has been given.
    command: Option<MoveCommand>,
    interval_ns: u64,
}

/// The command for the motion of a turn.
#[derive(Clone, Copy, Debug)]
struct MoveCommand {
    at_s: f64,
    axis: usize,
    target_deg: f64,
    /// deg/s.
    rate: f64,
    /// deg/s2.
    acceleration: f64,
}

impl TurnInProgress {
    /// What the IMU feels in the next row.
    fn row(&mut self, truth: &Truth) -> InertialMotion {
        let begin_s = self.now_s;
        InertialMotion::over(truth, self.interval_ns as f64 / 1e9, |time_s| self.angles_deg(begin_s + time_s))
    }

    /// Advances to `time_s` and gives outer and inner angle there \[deg\].
    fn angles_deg(&mut self, time_s: f64) -> [f64; 2] {
        if let Some(command) = self.command.take_if(|command| command.at_s <= time_s) {
            self.turntable.wait(command.at_s - self.now_s);
            self.now_s = command.at_s;
            self.turntable.go_to(command.axis, command.target_deg, command.rate, command.acceleration);
        }
        self.turntable.wait(time_s - self.now_s);
        self.now_s = time_s;
        self.turntable.angles_deg()
    }
}

/// The text of a campaign file.
///
/// `samples` is the path of the samples, relative to the campaign file. `gravity_reference` is the value of 1 g0 and
/// `gravity_local` the gravity in the laboratory, both \[m/s2\]. `temperature_unit` is the unit of the temperature.
#[must_use]
pub fn campaign_toml(
    imu: &str,
    samples: &str,
    gravity_reference: f64,
    gravity_local: f64,
    temperature_unit: &str,
    positions: &[Position],
) -> String {
    let mut text = heading_toml(imu, ["samples", samples], gravity_reference, gravity_local, temperature_unit);
    for Position { number, label, angles, specific_force } in positions {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n[[position]]\nnumber = {number}\nup = {}\n", quoted(label));
        if let Some([outer, inner]) = angles {
            let _ = writeln!(text, "outer_deg = {outer}\ninner_deg = {inner}");
        }
        // Adding 0 turns -0 into 0.
        let [a1, a2, a3] = specific_force.map(|f| f + 0.0);
        let _ = writeln!(text, "specific_force = [{a1}, {a2}, {a3}]   # along A1, A2, A3, in local gravity");
    }
    text
}

/// `text` as a string of TOML.
fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// The keys before the sections of a campaign file: those of [`campaign_toml`], and `file`, a key with the path of a
/// file.
pub(super) fn heading_toml(
    imu: &str,
    [key, file]: [&str; 2],
    gravity_reference: f64,
    gravity_local: f64,
    temperature_unit: &str,
) -> String {
    format!(
        "format = 1\nimu = \"{imu}\"\n{key} = {}\n\
         gravity_reference = {gravity_reference}   # m/s2, the value of 1 g0\n\
         gravity_local = {gravity_local}   # m/s2, at the station\n\
         temperature_unit = {}\n",
        quoted(file),
        quoted(temperature_unit)
    )
}

/// Seconds as whole nanoseconds; negative seconds give 0.
pub(super) fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
