//! The rows of a campaign with gyroscopes: its dwells, and its turns row by row.

use crate::transients::RampRecording;
use isotherm_campaign::{Campaign, Dwell, Turn, read_dwells};
use isotherm_recording::{CampaignRow, RecordingError};
use isotherm_shared::table::GYROSCOPE_NAMES;
use isotherm_shared::wire::{AXES, RawSample, Triad, device};
use isotherm_support::finding::{Finding, RunNumber, Severity, name};

/// Rows of a turn that are shorter are added up to blocks of at least this length \[s\], so that memory does not grow
/// with the sampling rate.
const MIN_BLOCK: f64 = 0.02;

/// A block of a turn is at rest below this part of the fastest block's rate.
pub(super) const AT_REST: f64 = 0.01;

/// What the rows of a campaign say about both triads.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurements {
    /// The dwells, of the accelerometers.
    pub dwells: Vec<Dwell>,
    /// The same dwells and the turns, of the gyroscopes.
    pub gyroscopes: GyroscopeRuns,
    /// The first row that another unit took.
    pub other_device: Option<OtherDevice>,
    /// The ramps, in the order of the campaign file. They have their own recordings, which [`RampRecording::read`]
    /// reduces.
    pub ramps: Vec<RampRecording>,
    /// What was found in the files of the rows.
    pub findings: Vec<Finding>,
}

/// A row of another device than that of the campaign file's serial number or, without one, than that of the rows
/// before.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct OtherDevice {
    /// The line of the row.
    pub line: u64,
    /// The unit that took it, as [`device`] numbers it.
    pub device: u64,
    /// The unit that was expected.
    pub expected: u64,
}

/// The runs of the gyroscopes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GyroscopeRuns {
    /// Whether any row has pulses or temperature of a gyroscope.
    pub present: bool,
    /// The dwells; empty if the campaign file has no turns.
    pub dwells: Vec<Dwell>,
    /// The turns.
    pub turns: Vec<TurnRun>,
}

/// The rows of one turn: an unbroken run with one set point and the turn's number.
#[derive(Clone, Debug, PartialEq)]
pub struct TurnRun {
    /// Its sums, with the gyroscopes' pulses and temperature; `position` is the index into the campaign's turns.
    pub run: Dwell,
    /// The same with the accelerometers' pulses and temperature.
    pub accelerometers: Dwell,
    /// Its rows in order.
    pub blocks: Vec<TurnBlock>,
    /// Session and sequence of the last row.
    last: (u64, u64),
    /// Smallest and largest step of the sequence from row to row; a change of session is the largest step.
    steps: Option<[u64; 2]>,
}

/// One row of a turn, or some that are shorter than 20 ms together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnBlock {
    /// Line of its first row.
    pub line: u64,
    /// Time counted \[s\].
    pub seconds: f64,
    /// Pulses of the positive and of the negative channel, by gyroscope.
    pub pulses: [[f64; 2]; AXES],
}

impl OtherDevice {
    /// The fault that the row is.
    pub fn finding(self, campaign: &Campaign) -> Finding {
        let Self { line, device, expected } = self;
        let message = match &campaign.serial {
            Some(serial) => format!(
                "the row is from device {device:016x}, but {serial:?}, the serial number of the campaign file, is \
                 device {expected:016x}; give the samples of that IMU, or correct serial or the acquisition's serial \
                 number (--other-device makes the table anyway)"
            ),
            None => format!(
                "the row is from device {device:016x}, and those before are from device {expected:016x}; a campaign \
                 is of one IMU: take out the rows of the other (--other-device makes the table anyway)"
            ),
        };
        Finding { severity: Severity::Fault, name: name::OTHER_DEVICE, line: Some(line), place: None, message }
    }
}

impl TurnRun {
    fn new(row: &CampaignRow, turn: usize) -> Self {
        let last = (row.sample.session, row.sample.sequence);
        let [run, accelerometers] = [(); 2].map(|()| Dwell::new(row, turn));
        Self { run, accelerometers, blocks: Vec::new(), last, steps: None }
    }

    /// Whether rows are missing by their sequences. The rows may be sums, with the same step from each to the next.
    #[must_use]
    pub fn has_gap(&self) -> bool {
        self.steps.is_some_and(|[least, most]| least != most)
    }

    fn add(&mut self, row: &CampaignRow) {
        if self.run.rows > 0 {
            let (session, sequence) = self.last;
            let same_session = session == row.sample.session;
            let step = if same_session { row.sample.sequence.wrapping_sub(sequence) } else { u64::MAX };
            let [least, most] = self.steps.unwrap_or([step; 2]);
            // A new session is a gap even if the turn has only two rows.
            self.steps = Some([if same_session { least.min(step) } else { 0 }, most.max(step)]);
        }
        self.last = (row.sample.session, row.sample.sequence);
        self.run.add(&of_gyroscopes(row));
        self.accelerometers.add(row);
        let seconds = row.sample.interval_ns as f64 / 1e9;
        let Triad { positive_pulses, negative_pulses, .. } = row.sample.gyroscopes;
        let pulses = [0, 1, 2].map(|axis| [positive_pulses[axis], negative_pulses[axis]].map(f64::from));
        match self.blocks.last_mut() {
            Some(block) if block.seconds < MIN_BLOCK => {
                block.seconds += seconds;
                for (sum, more) in block.pulses.iter_mut().flatten().zip(pulses.iter().flatten()) {
                    *sum += more;
                }
            }
            _ => self.blocks.push(TurnBlock { line: row.line, seconds, pulses }),
        }
    }
}

/// The row with the gyroscopes in the place of the accelerometers, so that a [`Dwell`] adds them up.
fn of_gyroscopes(row: &CampaignRow) -> CampaignRow {
    CampaignRow { sample: RawSample { accelerometers: row.sample.gyroscopes, ..row.sample }, ..*row }
}

/// Where a run was: in a position, or in a turn.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum RunPlace {
    /// Index into the campaign's positions.
    Position(usize),
    /// Index into the campaign's turns.
    Turn(usize),
}

impl RunPlace {
    /// Its number in the samples.
    #[must_use]
    pub fn number(self, campaign: &Campaign) -> RunNumber {
        match self {
            Self::Position(index) => RunNumber::Position(campaign.positions[index].number),
            Self::Turn(index) => RunNumber::Turn(campaign.turns[index].start.number),
        }
    }
}

/// A dwell or a turn in the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedRun {
    /// Index of its set point.
    pub set_point: usize,
    /// Where it was.
    pub place: RunPlace,
    /// Lines of its first and last row.
    pub lines: [u64; 2],
    /// When its first row was taken \[ns\]; `None` if its times are not those of the other runs.
    pub start_ns: Option<u64>,
    /// Sum of its intervals \[s\].
    pub seconds: f64,
    /// Residual of each gyroscope \[arcsec\].
    pub residual: [f64; AXES],
}

/// Makes dwells and turns of the samples of `campaign`; as [`read_dwells`](isotherm_campaign::read_dwells), with the
/// gyroscopes.
///
/// # Errors
/// As [`read_dwells`](isotherm_campaign::read_dwells). In a campaign with turns, also gyroscope temperature that is not
/// finite, and a full counter.
pub fn read_measurements(
    campaign: &Campaign,
    rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
) -> Result<Measurements, RecordingError> {
    let mut runs = GyroscopeRuns::default();
    let mut previous = None;
    let (mut expected, mut other_device) = (campaign.serial.as_deref().map_or(0, device), None);
    let rows = rows.into_iter().map(|row| {
        let row = row?;
        // 0 is a unit that nobody has named.
        let CampaignRow { line, sample: RawSample { device, .. }, .. } = row;
        if expected == 0 {
            expected = device;
        } else if device != 0 && device != expected && other_device.is_none() {
            other_device = Some(OtherDevice { line, device, expected });
        }
        collect(campaign, &mut runs, &mut previous, &row)?;
        Ok(row)
    });
    let dwells = read_dwells(campaign, rows)?;
    Ok(Measurements { dwells, gyroscopes: runs, other_device, ..Measurements::default() })
}

/// Adds a row. `previous` has set point and number of the row before.
fn collect(
    campaign: &Campaign,
    runs: &mut GyroscopeRuns,
    previous: &mut Option<(f64, Option<u32>)>,
    row: &CampaignRow,
) -> Result<(), RecordingError> {
    runs.present |= !row.sample.gyroscopes.is_absent();
    let row = &CampaignRow { sample: RawSample { gyroscopes: row.sample.gyroscopes.or_zero(), ..row.sample }, ..*row };
    let place = Some((row.set_point_c, row.position));
    let goes_on = core::mem::replace(previous, place) == place;
    let Some(number) = row.position.filter(|_| !campaign.turns.is_empty()) else { return Ok(()) };
    if let Some(wrong) = implausible(&row.sample.gyroscopes) {
        let message = format!("set point {} degC, position {number}: {wrong}", row.set_point_c);
        return Err(RecordingError::Data { line: row.line, message });
    }
    let is_turn = |turn: &Turn| turn.start.number == number;
    if let Some(turn) = campaign.turns.iter().position(is_turn) {
        if !goes_on {
            runs.turns.push(TurnRun::new(row, turn));
        }
        runs.turns.last_mut().into_iter().for_each(|turn| turn.add(row));
    } else if let Some(position) = campaign.positions.iter().position(|position| position.number == number) {
        if !goes_on {
            runs.dwells.push(Dwell::new(row, position));
        }
        runs.dwells.last_mut().into_iter().for_each(|dwell| dwell.add(&of_gyroscopes(row)));
    }
    Ok(())
}

/// The reason why the gyroscopes' part of a sample cannot be used; `None` if it can.
#[must_use]
pub fn implausible(triad: &Triad) -> Option<String> {
    for (axis, gyroscope) in GYROSCOPE_NAMES.iter().enumerate() {
        for (temperature, name) in [(triad.head_temperature[axis], "head"), (triad.board_temperature[axis], "board")] {
            if !temperature.is_finite() {
                return Some(format!("g{}_{name} is {temperature}, which is not a temperature", axis + 1));
            }
        }
        if triad.positive_pulses[axis] == u32::MAX || triad.negative_pulses[axis] == u32::MAX {
            return Some(format!("the counter of {gyroscope} is full: saturated"));
        }
    }
    None
}
