//! A campaign: what a laboratory states about it (campaign.toml) and the dwells that its samples make.
//!
//! A **dwell** is an unbroken run of rows with one set point and one position. Rows may be raw samples of any rate or
//! sums over seconds: pulses and intervals are added up, telemetry is averaged over time. Only sums are kept, so that memory
//! does not grow with the sampling rate.

use crate::positions::{Position, SAME_DIRECTION, mount, specific_force};
use isotherm_recording::{CampaignRow, RecordingError};
use isotherm_shared::document::{Document, Faults, Section};
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::{AXIS_NAMES, GRAVITY_RANGE, OutOfRange};
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample};
use nalgebra::{Matrix3, Matrix3x2, Vector2, Vector3};

/// What a campaign file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Campaign {
    /// Whose campaign it is.
    pub imu: ImuId,
    /// Serial number, free text.
    pub serial: Option<String>,
    /// Files of the samples, relative to the campaign's: one, or the pieces of one recording in any order.
    pub samples: Vec<String>,
    /// The value of 1 g0 \[m/s2\]; goes into the table.
    pub gravity_reference: f64,
    /// Gravity at the station \[m/s2\].
    pub gravity_local: f64,
    /// Unit of the telemetry, a label.
    pub temperature_unit: String,
    /// Policy that the table gets.
    pub out_of_range: OutOfRange,
    /// Telemetry age that the table flags \[s\].
    pub max_age_s: Option<f64>,
    /// Largest plausible rate \[pulse/s\], both channels together: more is saturation; goes into the table.
    pub max_rate: Option<f64>,
    /// Least time between two set points \[s\], if stated.
    pub soak_s: Option<f64>,
    /// The positions. Where the stated directions are the turntable's, but for exchanged axes, they are exact.
    pub positions: Vec<Position>,
    /// How the IMU sits on the turntable, if the angles are stated; see [`mount`].
    pub mount: Option<Matrix3<f64>>,
}

impl Campaign {
    /// Reads a campaign file's text.
    ///
    /// # Errors
    /// All faults of the text with line and key.
    pub fn from_toml(text: &str) -> Result<Self, Faults> {
        let document = Document::parse_as(text, "give the campaign file that names it")?;
        let root = document.root();
        let campaign = campaign(&root);
        root.finish();
        document.finish(campaign)
    }

    /// Specific force along A1, A2, A3 in `position` \[g0\], and its derivatives by the base's tilt \[g0/rad\].
    /// Without a tilt, or without angles, the base is level and the derivatives are 0.
    ///
    /// ```text
    /// f = g_local/g0 * mount * R' u,    u = (-ty, tx, 1) / |(-ty, tx, 1)|
    /// ```
    #[must_use]
    pub fn force(&self, position: &Position, tilt: Option<[f64; 2]>) -> ([f64; AXES], [[f64; 2]; AXES]) {
        let gravity = self.gravity_local / self.gravity_reference;
        let level = Vector3::from(position.specific_force) * gravity;
        let (Some([tx, ty]), Some(mount), Some(by_tilt)) = (tilt, self.mount, position.by_tilt()) else {
            return (level.into(), [[0.0; 2]; AXES]);
        };
        let by_tilt = mount * Matrix3x2::from_fn(|i, j| by_tilt[i][j]) * gravity;
        let length = (1.0 + tx * tx + ty * ty).sqrt();
        let force = (level + by_tilt * Vector2::new(tx, ty)) / length;
        let change = by_tilt / length - force * Vector2::new(tx, ty).transpose() / (length * length);
        (force.into(), [0, 1, 2].map(|i| [change[(i, 0)], change[(i, 1)]]))
    }
}

fn campaign(root: &Section<'_, '_>) -> Option<Campaign> {
    let format = root.number("format", "format = 1, the version of this file format");
    if format.is_some_and(|format| format != 1.0) {
        root.fault("format", "unknown; this version reads format = 1");
    }
    let imu = root.imu_id("imu");
    let serial = root.optional_string("serial").map(str::to_owned);
    let samples = root.strings("samples", "the file of the samples, for example \"samples.csv\", or a list of files");
    let gravity = |key, right| {
        let value = root.number(key, right);
        let [low, high] = GRAVITY_RANGE;
        let wrong = value.filter(|value| !(low..=high).contains(value));
        root.refuse(key, wrong.map(|value| format!("is {value:?}, give {low} to {high} m/s2")));
        value
    };
    let gravity_reference = gravity("gravity_reference", "the value of 1 g0 in m/s2, for example 9.8015");
    let gravity_local = gravity("gravity_local", "gravity at the station in m/s2");
    let unit = root.string("temperature_unit", "the unit of the telemetry, for example \"V\"").map(str::to_owned);
    let out_of_range = root.optional_choice("out_of_range", &OutOfRange::NAMES).unwrap_or(OutOfRange::Clamp);
    let positive = |key| {
        let value = root.optional_number(key);
        let wrong = value.filter(|value| *value <= 0.0);
        root.refuse(key, wrong.map(|value| format!("is {value:?}, give a number over 0")));
        value
    };
    let (max_age_s, max_rate, soak_s) = (positive("max_age_s"), positive("max_rate"), positive("soak_s"));
    let sections = root.list("position");
    if sections.is_empty() {
        root.fault("position", "none; give one [[position]] each, with number and specific_force");
    }
    let mut positions: Vec<Position> = Vec::new();
    let mut complete = true;
    for section in sections {
        match position(&section) {
            Some(position) if positions.iter().any(|other| other.number == position.number) => {
                section.fault("number", format!("{} is there twice", position.number));
            }
            Some(position) => positions.push(position),
            None => complete = false,
        }
        section.finish();
    }
    let mount = mount(&positions);
    if let Some(turn) = mount.filter(|turn| *turn == turn.map(f64::round)) {
        for position in &mut positions {
            let [outer, inner] = position.angles.unwrap_or_default();
            position.specific_force = (turn * Vector3::from(specific_force(outer, inner))).map(|f| f + 0.0).into();
        }
    }
    Some(Campaign {
        imu: imu?,
        serial,
        samples: samples?.into_iter().map(str::to_owned).collect(),
        gravity_reference: gravity_reference?,
        gravity_local: gravity_local?,
        temperature_unit: unit?,
        out_of_range,
        max_age_s,
        max_rate,
        soak_s,
        positions: complete.then_some(positions)?,
        mount,
    })
}

fn position(section: &Section<'_, '_>) -> Option<Position> {
    const FORCE: &str = "the direction of the specific force along A1, A2, A3 in units of the local gravity, length 1: \
                         [0, 0, 1] where A3 points up";
    let number = section.optional_integer("number", 0..=i64::from(u32::MAX));
    if number.is_none() && !section.has("number") {
        section.fault("number", "missing; give the number that the samples carry");
    }
    let label = section.optional_string("up").unwrap_or_default().to_owned();
    let (outer, inner) = (section.optional_number("outer_deg"), section.optional_number("inner_deg"));
    if outer.is_some() != inner.is_some() {
        section.fault("", "give both outer_deg and inner_deg, or neither");
    }
    let angles = outer.zip(inner).map(|(outer, inner)| [outer, inner]);
    let force = if section.has("specific_force") {
        let force = section.numbers("specific_force", FORCE)?;
        let force = <[f64; AXES]>::try_from(force).ok();
        let length = force.map(|f| f.iter().map(|f| f * f).sum::<f64>().sqrt());
        match (force, length) {
            // A few digits are enough to say which way; at rest the length is 1.
            (Some(force), Some(length)) if (length - 1.0).abs() < SAME_DIRECTION => Some(force.map(|f| f / length)),
            _ => {
                section.fault("specific_force", format!("give {FORCE}"));
                None
            }
        }
    } else if let Some([outer, inner]) = angles {
        Some(specific_force(outer, inner))
    } else {
        section.fault("specific_force", format!("missing; give {FORCE}, or both angles"));
        None
    };
    Some(Position { number: u32::try_from(number?).ok()?, label, angles, specific_force: force? })
}

/// What rows add up to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DwellSums {
    /// Time counted \[s\].
    pub seconds: f64,
    /// Pulses of the positive channel.
    pub positive: [f64; AXES],
    /// Pulses of the negative channel.
    pub negative: [f64; AXES],
    head: [f64; AXES],
    board: [f64; AXES],
    /// Age of the telemetry in the middle of its row, where it is known, times the row's seconds.
    age: f64,
}

impl DwellSums {
    fn add(&mut self, sample: &RawSample) {
        let seconds = sample.interval_ns as f64 / 1e9;
        self.seconds += seconds;
        if sample.telemetry_ns > 0 {
            self.age += seconds * (sample.timestamp_ns as f64 / 1e9 - 0.5 * seconds - sample.telemetry_ns as f64 / 1e9);
        }
        for axis in 0..AXES {
            self.positive[axis] += f64::from(sample.positive_pulses[axis]);
            self.negative[axis] += f64::from(sample.negative_pulses[axis]);
            self.head[axis] += sample.head_temperature[axis] * seconds;
            self.board[axis] += sample.board_temperature[axis] * seconds;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.seconds += other.seconds;
        self.age += other.age;
        for axis in 0..AXES {
            self.positive[axis] += other.positive[axis];
            self.negative[axis] += other.negative[axis];
            self.head[axis] += other.head[axis];
            self.board[axis] += other.board[axis];
        }
    }

    /// Mean telemetry of the sensor head.
    #[must_use]
    pub fn head(&self, axis: usize) -> f64 {
        self.head[axis] / self.seconds
    }

    /// Mean telemetry of the converter board.
    #[must_use]
    pub fn board(&self, axis: usize) -> f64 {
        self.board[axis] / self.seconds
    }

    /// Rates of both channels \[pulse/s\].
    #[must_use]
    pub fn rates(&self, axis: usize) -> [f64; 2] {
        [self.positive[axis] / self.seconds, self.negative[axis] / self.seconds]
    }
}

/// A second or more of a dwell, for looking whether it was still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Line of its first row.
    pub line: u64,
    /// What its rows add up to.
    pub sums: DwellSums,
    /// Lowest and highest telemetry of each head.
    pub head: [[f64; 2]; AXES],
    /// Lowest and highest telemetry of each board.
    pub board: [[f64; 2]; AXES],
    /// Largest rate of both channels together in a row \[pulse/s\].
    pub rate: [f64; AXES],
}

/// Shortest block \[s\].
const BLOCK: f64 = 1.0;
/// More blocks of a dwell than this are merged in pairs.
const MAX_BLOCKS: usize = 512;

/// An unbroken run of rows with one set point and one position.
#[derive(Clone, Debug, PartialEq)]
pub struct Dwell {
    /// What the chamber was set to \[degC\].
    pub set_point_c: f64,
    /// Index into the campaign's positions.
    pub position: usize,
    /// Lines of its first and last row.
    pub lines: [u64; 2],
    /// Number of rows.
    pub rows: u64,
    /// Begin of its first and end of its last row \[ns\].
    pub time_ns: [u64; 2],
    /// What all rows add up to.
    pub sums: DwellSums,
    /// Its parts.
    pub blocks: Vec<Block>,
    block_length: f64,
}

impl Dwell {
    fn new(row: &CampaignRow, position: usize) -> Self {
        let begin = row.sample.timestamp_ns.saturating_sub(row.sample.interval_ns);
        Self {
            set_point_c: row.set_point_c,
            position,
            lines: [row.line; 2],
            rows: 0,
            time_ns: [begin; 2],
            sums: DwellSums::default(),
            blocks: Vec::new(),
            block_length: BLOCK,
        }
    }

    fn add(&mut self, row: &CampaignRow) {
        let sample = &row.sample;
        self.lines[1] = row.line;
        self.rows += 1;
        self.time_ns[1] = sample.timestamp_ns;
        self.sums.add(sample);
        let seconds = sample.interval_ns as f64 / 1e9;
        let rate =
            |axis: usize| (f64::from(sample.positive_pulses[axis]) + f64::from(sample.negative_pulses[axis])) / seconds;
        let block = match self.blocks.last_mut() {
            Some(block) if block.sums.seconds < self.block_length => block,
            _ => {
                if self.blocks.len() == MAX_BLOCKS {
                    self.halve();
                }
                self.blocks.push(Block {
                    line: row.line,
                    sums: DwellSums::default(),
                    head: [[f64::INFINITY, f64::NEG_INFINITY]; 3],
                    board: [[f64::INFINITY, f64::NEG_INFINITY]; 3],
                    rate: [0.0; 3],
                });
                let last = self.blocks.len() - 1;
                &mut self.blocks[last]
            }
        };
        block.sums.add(sample);
        for axis in 0..AXES {
            extend(&mut block.head[axis], [sample.head_temperature[axis]; 2]);
            extend(&mut block.board[axis], [sample.board_temperature[axis]; 2]);
            block.rate[axis] = block.rate[axis].max(rate(axis));
        }
    }

    fn halve(&mut self) {
        let merged = self.blocks.chunks(2).map(|pair| {
            let mut block = pair[0];
            for other in &pair[1..] {
                block.sums.merge(&other.sums);
                for axis in 0..AXES {
                    extend(&mut block.head[axis], other.head[axis]);
                    extend(&mut block.board[axis], other.board[axis]);
                    block.rate[axis] = block.rate[axis].max(other.rate[axis]);
                }
            }
            block
        });
        self.blocks = merged.collect();
        self.block_length *= 2.0;
    }

    /// Mean telemetry of the sensor head, in the middle of the time counted.
    #[must_use]
    pub fn head(&self, axis: usize) -> f64 {
        self.sums.head(axis) + self.head_per_s(axis) * self.age_s()
    }

    /// Mean telemetry of the converter board, in the middle of the time counted.
    #[must_use]
    pub fn board(&self, axis: usize) -> f64 {
        self.sums.board(axis) + self.per_s(|sums| sums.board(axis)) * self.age_s()
    }

    /// Drift of the head's telemetry, in its unit per second; 0 where there is nothing to tell it from.
    #[must_use]
    pub fn head_per_s(&self, axis: usize) -> f64 {
        self.per_s(|sums| sums.head(axis))
    }

    /// Second half less first half.
    fn per_s(&self, telemetry: impl Fn(&DwellSums) -> f64) -> f64 {
        let (first, second) = self.blocks.split_at(self.blocks.len() / 2);
        if first.is_empty() {
            return 0.0;
        }
        let mean =
            |blocks: &[Block]| blocks.iter().map(|block| telemetry(&block.sums)).sum::<f64>() / blocks.len() as f64;
        (mean(second) - mean(first)) / (0.5 * self.sums.seconds)
    }

    /// How long before the middle of the time counted the telemetry was read, on average. Its drift within the dwell says nothing
    /// about an age longer than the dwell.
    fn age_s(&self) -> f64 {
        let age_s = self.sums.age / self.sums.seconds;
        if age_s.abs() <= self.sums.seconds { age_s } else { 0.0 }
    }

    /// Lowest and highest telemetry of the head.
    #[must_use]
    pub fn head_range(&self, axis: usize) -> [f64; 2] {
        range(self.blocks.iter().map(|block| block.head[axis]))
    }

    /// Lowest and highest telemetry of the board.
    #[must_use]
    pub fn board_range(&self, axis: usize) -> [f64; 2] {
        range(self.blocks.iter().map(|block| block.board[axis]))
    }
}

fn extend(range: &mut [f64; 2], other: [f64; 2]) {
    *range = [range[0].min(other[0]), range[1].max(other[1])];
}

/// The range that holds all ranges.
#[must_use]
pub fn range(ranges: impl IntoIterator<Item = [f64; 2]>) -> [f64; 2] {
    let mut all = [f64::INFINITY, f64::NEG_INFINITY];
    ranges.into_iter().for_each(|range| extend(&mut all, range));
    all
}

/// Reads the samples of `campaign`: a [`CampaignCsvReader`](isotherm_recording::CampaignCsvReader), or rows from elsewhere.
///
/// # Errors
/// At the first row that cannot be read or used, with its line: an unknown position, time that does not rise, an interval out of
/// range or longer than the time since the row before, telemetry that is no number.
pub fn read(
    campaign: &Campaign,
    rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
) -> Result<Vec<Dwell>, RecordingError> {
    let mut dwells: Vec<Dwell> = Vec::new();
    let mut previous: Option<CampaignRow> = None;
    let mut open = false;
    for row in rows {
        let row = row?;
        let fault = |message: String| {
            let place = match row.position {
                Some(number) => format!("set point {} degC, position {number}: ", row.set_point_c),
                None => format!("set point {} degC: ", row.set_point_c),
            };
            Err(RecordingError::Data { line: row.line, message: place + &message })
        };
        let sample = &row.sample;
        if let Some(wrong) = implausible(sample, previous.as_ref().map(|row| row.sample.timestamp_ns)) {
            return fault(wrong);
        }
        let same = |last: &CampaignRow| (last.set_point_c, last.position) == (row.set_point_c, row.position);
        open &= previous.as_ref().is_some_and(same);
        previous = Some(row);
        let Some(number) = row.position else { continue };
        if !open {
            let Some(position) = campaign.positions.iter().position(|position| position.number == number) else {
                let known: Vec<_> = campaign.positions.iter().map(|position| position.number.to_string()).collect();
                return fault(format!("no such position; the campaign file lists {}", known.join(", ")));
            };
            dwells.push(Dwell::new(&row, position));
            open = true;
        }
        if let Some(dwell) = dwells.last_mut() {
            dwell.add(&row);
        }
    }
    Ok(dwells)
}

/// Why nothing can be done with a raw sample of a campaign, if so; `previous_ns` is the timestamp of the one before. The automatic campaign
/// leaves such samples out, `calibrate` refuses them.
#[must_use]
pub fn implausible(sample: &RawSample, previous_ns: Option<u64>) -> Option<String> {
    let RawSample { timestamp_ns, interval_ns, .. } = *sample;
    if interval_ns == 0 || interval_ns > MAX_INTERVAL_NS {
        return Some(format!("interval_ns is {interval_ns}, give 1 to {MAX_INTERVAL_NS}"));
    }
    if let Some(previous_ns) = previous_ns {
        if timestamp_ns <= previous_ns {
            return Some(format!("timestamp_ns {timestamp_ns} after {previous_ns}; time must rise from row to row"));
        }
        // A jittering clock is no fault; a wrong unit or an overlap is.
        if interval_ns / 3 * 2 > timestamp_ns - previous_ns {
            return Some(format!(
                "interval_ns is {interval_ns}, but only {} ns have passed since the row before; pulses would be counted twice",
                timestamp_ns - previous_ns
            ));
        }
    }
    for (axis, accelerometer) in AXIS_NAMES.iter().enumerate() {
        for (telemetry, name) in [(sample.head_temperature[axis], "head"), (sample.board_temperature[axis], "board")] {
            if !telemetry.is_finite() {
                return Some(format!("a{}_{name} is {telemetry}, which is no temperature", axis + 1));
            }
        }
        if sample.positive_pulses[axis] == u32::MAX || sample.negative_pulses[axis] == u32::MAX {
            return Some(format!("the counter of {accelerometer} is full: saturated"));
        }
    }
    None
}
