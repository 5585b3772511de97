//! A **dwell**: an unbroken run of rows with one set point and one position.
//!
//! Rows may be raw samples of any rate or sums over seconds: pulses and intervals are added up, temperature is averaged
//! over time. Only sums are kept, so that memory does not grow with the sampling rate.

use isotherm_recording::{CampaignRow, Continuity, Losses, TimeFault};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::median;

/// Sums over rows, of a dwell or of a block.
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
    /// Sum of the temperature's age at the middle of each row \[s\], if known, times the seconds of the row.
    age: f64,
}

impl DwellSums {
    fn add(&mut self, sample: &RawSample) {
        let seconds = sample.interval_ns as f64 / 1e9;
        self.seconds += seconds;
        if sample.temperature_time_ns() > 0 {
            let read_s = sample.temperature_time_ns() as f64 / 1e9;
            self.age += seconds * (sample.timestamp_ns as f64 / 1e9 - 0.5 * seconds - read_s);
        }
        for axis in 0..AXES {
            self.positive[axis] += f64::from(sample.accelerometers.positive_pulses[axis]);
            self.negative[axis] += f64::from(sample.accelerometers.negative_pulses[axis]);
            self.head[axis] += sample.accelerometers.head_temperature[axis] * seconds;
            self.board[axis] += sample.accelerometers.board_temperature[axis] * seconds;
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

    /// Mean temperature of the sensor head.
    #[must_use]
    pub fn head(&self, axis: usize) -> f64 {
        self.head[axis] / self.seconds
    }

    /// Mean temperature of the converter board.
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

/// Intervals and timestamps of rows that follow each other in one dwell and one session.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowSteps {
    /// Sum of the intervals of rows whose sequence is the previous one plus 1, and sum of the timestamps' steps \[s\].
    consecutive: [f64; 2],
    /// The same over all rows, and the sum of the timestamps' steps, each divided by its step of the sequence \[s\].
    all: [f64; 3],
}

impl RowSteps {
    fn add(&mut self, interval_s: f64, step_s: f64, sequence_step: u64) {
        if sequence_step == 1 {
            self.consecutive = [self.consecutive[0] + interval_s, self.consecutive[1] + step_s];
        }
        let [interval, step, one] = self.all;
        self.all = [interval + interval_s, step + step_s, one + step_s / sequence_step as f64];
    }

    fn merge(&mut self, other: &Self) {
        self.consecutive = [0, 1].map(|k| self.consecutive[k] + other.consecutive[k]);
        self.all = [0, 1, 2].map(|k| self.all[k] + other.all[k]);
    }
}

/// A part of a dwell, at least 1 s long; the checks compare blocks to find motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Line of its first row.
    pub line: u64,
    /// Sums over its rows.
    pub sums: DwellSums,
    /// Lowest and highest temperature of each head.
    pub head: [[f64; 2]; AXES],
    /// Lowest and highest temperature of each board.
    pub board: [[f64; 2]; AXES],
    /// Largest rate of a single row, both channels together \[pulse/s\].
    pub rate: [f64; AXES],
    /// Intervals and timestamps from row to row.
    pub steps: RowSteps,
}

/// Shortest block \[s\].
const MIN_BLOCK: f64 = 1.0;
/// Most blocks of a dwell; when they are full, neighbours are merged in pairs.
const MAX_BLOCKS: usize = 512;

/// An unbroken run of rows with one set point and one position.
#[derive(Clone, Debug, PartialEq)]
pub struct Dwell {
    /// Temperature that the chamber was set to \[degC\].
    pub set_point_c: f64,
    /// Index into the campaign's positions.
    pub position: usize,
    /// Lines of its first and last row.
    pub lines: [u64; 2],
    /// Number of rows.
    pub rows: u64,
    /// Begin of its first and end of its last row \[ns\]; `None` if its times are not those of the other dwells.
    pub time_ns: Option<[u64; 2]>,
    /// Sums over all rows.
    pub sums: DwellSums,
    /// Its blocks, in order of time.
    pub blocks: Vec<Block>,
    continuity: Continuity,
    /// Line of the row at which the first fault of time shows.
    time_fault_line: Option<u64>,
    block_length: f64,
    /// Session, sequence and timestamp of the last row.
    last: Option<(u64, u64, u64)>,
}

impl Dwell {
    /// A dwell of one row of `position`, an index of the file's positions.
    pub fn new(row: &CampaignRow, position: usize) -> Self {
        let begin = row.sample.timestamp_ns.saturating_sub(row.sample.interval_ns);
        Self {
            set_point_c: row.set_point_c,
            position,
            lines: [row.line; 2],
            rows: 0,
            time_ns: Some([begin; 2]),
            sums: DwellSums::default(),
            blocks: Vec::new(),
            continuity: Continuity::default(),
            time_fault_line: None,
            block_length: MIN_BLOCK,
            last: None,
        }
    }

    /// A dwell of which only means are known: the rates of both channels \[pulse/s\], and the temperature of head and
    /// board. It counts as one second without a time.
    #[must_use]
    pub fn of_means(
        line: u64,
        set_point_c: f64,
        position: usize,
        rates: [[f64; 2]; AXES],
        [head, board]: [[f64; AXES]; 2],
    ) -> Self {
        let [positive, negative] = [0, 1].map(|channel| rates.map(|rates| rates[channel]));
        let sums = DwellSums { seconds: 1.0, positive, negative, head, board, age: 0.0 };
        let block = Block {
            line,
            sums,
            head: head.map(|head| [head; 2]),
            board: board.map(|board| [board; 2]),
            rate: rates.map(|[positive, negative]| positive + negative),
            steps: RowSteps::default(),
        };
        Self {
            set_point_c,
            position,
            lines: [line; 2],
            rows: 1,
            time_ns: None,
            sums,
            blocks: vec![block],
            continuity: Continuity::default(),
            time_fault_line: None,
            block_length: MIN_BLOCK,
            last: None,
        }
    }

    /// Adds a row of the same position and set point.
    pub fn add(&mut self, row: &CampaignRow) {
        let sample = &row.sample;
        self.lines[1] = row.line;
        self.rows += 1;
        if let Some([_, end]) = &mut self.time_ns {
            *end = sample.timestamp_ns;
        }
        self.sums.add(sample);
        if self.continuity.add(sample) {
            self.time_fault_line = Some(row.line);
        }
        let seconds = sample.interval_ns as f64 / 1e9;
        let rate = |axis: usize| {
            (f64::from(sample.accelerometers.positive_pulses[axis])
                + f64::from(sample.accelerometers.negative_pulses[axis]))
                / seconds
        };
        let last = self.last.replace((sample.session, sample.sequence, sample.timestamp_ns));
        let block = self.open_block(row.line);
        block.sums.add(sample);
        if let Some((session, sequence, timestamp_ns)) = last
            && session == sample.session
            && sequence < sample.sequence
        {
            let sequence_step = sample.sequence - sequence;
            let step_s = sample.timestamp_ns.saturating_sub(timestamp_ns) as f64 / 1e9;
            block.steps.add(seconds, step_s, sequence_step);
        }
        for axis in 0..AXES {
            extend(&mut block.head[axis], [sample.accelerometers.head_temperature[axis]; 2]);
            extend(&mut block.board[axis], [sample.accelerometers.board_temperature[axis]; 2]);
            block.rate[axis] = block.rate[axis].max(rate(axis));
        }
    }

    /// The block that a row belongs to, which is a new one if the last is full.
    fn open_block(&mut self, line: u64) -> &mut Block {
        if self.blocks.last().is_none_or(|block| block.sums.seconds >= self.block_length) {
            if self.blocks.len() == MAX_BLOCKS {
                self.merge_pairs();
            }
            self.blocks.push(Block {
                line,
                sums: DwellSums::default(),
                head: [[f64::INFINITY, f64::NEG_INFINITY]; 3],
                board: [[f64::INFINITY, f64::NEG_INFINITY]; 3],
                rate: [0.0; 3],
                steps: RowSteps::default(),
            });
        }
        let last = self.blocks.len() - 1;
        &mut self.blocks[last]
    }

    fn merge_pairs(&mut self) {
        let merged = self.blocks.chunks(2).map(|pair| {
            let mut block = pair[0];
            for other in &pair[1..] {
                block.sums.merge(&other.sums);
                block.steps.merge(&other.steps);
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

    /// The interval over the timestamp's step between rows with consecutive sequences; NaN without such rows. It is
    /// that one of the median over the blocks and the ratio of the sums that is the one that is closer to 1: a broken
    /// timestamp does not change the median, and timestamps that jitter or are coarse do not change the sums.
    #[must_use]
    pub fn interval_ratio(&self) -> f64 {
        let steps = || self.blocks.iter().map(|block| block.steps.consecutive);
        let [interval, step] = steps().fold([0.0; 2], |sum, steps| [sum[0] + steps[0], sum[1] + steps[1]]);
        let (middle, all) = (median(steps().map(|[interval, step]| interval / step)), interval / step);
        if (all - 1.0).abs() < (middle - 1.0).abs() { all } else { middle }
    }

    /// Rows that are missing between the first and the last by their sequences, and steps of time.
    #[must_use]
    pub const fn losses(&self) -> Losses {
        self.continuity.losses()
    }

    /// The first fault of time, and the line of the row at which it shows.
    #[must_use]
    pub fn time_fault(&self) -> Option<(u64, TimeFault)> {
        self.time_fault_line.zip(self.continuity.fault())
    }

    /// Number of blocks with rows whose sequences are consecutive.
    #[must_use]
    pub fn blocks_with_consecutive_rows(&self) -> usize {
        self.blocks.iter().filter(|block| block.steps.consecutive[1] > 0.0).count()
    }

    /// The interval over the timestamp's step, and over its part of one sequence number, whatever the sequences are:
    /// medians over the blocks. The first is 1 for sums without gaps, the second for single samples of which only every
    /// n-th is there.
    #[must_use]
    pub fn sparse_interval_ratios(&self) -> [f64; 2] {
        [1, 2].map(|k| median(self.blocks.iter().map(|block| block.steps.all[0] / block.steps.all[k])))
    }

    /// Mean temperature of the sensor head. If its age is known, it is extrapolated to the middle of the counted time.
    #[must_use]
    pub fn head(&self, axis: usize) -> f64 {
        self.sums.head(axis) + self.head_per_s(axis) * self.age_s()
    }

    /// Mean temperature of the converter board. If its age is known, it is extrapolated to the middle of the counted
    /// time.
    #[must_use]
    pub fn board(&self, axis: usize) -> f64 {
        self.sums.board(axis) + self.drift_per_s(|sums| sums.board(axis)) * self.age_s()
    }

    /// Drift of the head's temperature, in its unit per second; 0 for a dwell of a single block.
    #[must_use]
    pub fn head_per_s(&self, axis: usize) -> f64 {
        self.drift_per_s(|sums| sums.head(axis))
    }

    /// Mean of the second half of the blocks minus mean of the first half, over half the counted time.
    fn drift_per_s(&self, temperature: impl Fn(&DwellSums) -> f64) -> f64 {
        let (first, second) = self.blocks.split_at(self.blocks.len() / 2);
        if first.is_empty() {
            return 0.0;
        }
        let mean =
            |blocks: &[Block]| blocks.iter().map(|block| temperature(&block.sums)).sum::<f64>() / blocks.len() as f64;
        (mean(second) - mean(first)) / (0.5 * self.sums.seconds)
    }

    /// Mean time from the reading of the temperature to the middle of the counted time. 0 if it is longer than the
    /// dwell: the drift within the dwell cannot be extrapolated so far.
    fn age_s(&self) -> f64 {
        let age_s = self.sums.age / self.sums.seconds;
        if age_s.abs() <= self.sums.seconds { age_s } else { 0.0 }
    }

    /// Lowest and highest temperature of the head.
    #[must_use]
    pub fn head_range(&self, axis: usize) -> [f64; 2] {
        joint_range(self.blocks.iter().map(|block| block.head[axis]))
    }

    /// Lowest and highest temperature of the board.
    #[must_use]
    pub fn board_range(&self, axis: usize) -> [f64; 2] {
        joint_range(self.blocks.iter().map(|block| block.board[axis]))
    }
}

fn extend(range: &mut [f64; 2], other: [f64; 2]) {
    *range = [range[0].min(other[0]), range[1].max(other[1])];
}

/// The smallest range that contains all `ranges`.
#[must_use]
pub fn joint_range(ranges: impl IntoIterator<Item = [f64; 2]>) -> [f64; 2] {
    let mut all = [f64::INFINITY, f64::NEG_INFINITY];
    ranges.into_iter().for_each(|range| extend(&mut all, range));
    all
}
