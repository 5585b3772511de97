//! The rows of a recording in little memory: 8 bytes for each axis, 8 for the times, and what changes seldom where it
//! changes. A row of a recording takes over 250 bytes, and twelve hours at 1 kHz have 43 million.
//!
//! A block is as many rows as follow each other by sequence, of one session and unit, whose times and intervals differ
//! from those of the first by what 32 bits hold. A temperature value is kept with the row from which on it holds.

use isotherm_shared::sequence::Period;
use isotherm_shared::wire::{AXES, RawSample, Triad};

/// Temperature of a row: head, board and lagged, of accelerometers and gyroscopes.
const TEMPERATURE: usize = 6 * AXES;

/// The rows.
#[derive(Default)]
pub(super) struct Rows {
    blocks: Vec<Block>,
    /// Of each row: how far its stamp is from that of its block's regular times, and its interval from the block's
    /// \[ns\].
    times: Vec<[i32; 2]>,
    /// Of each axis and row: the pulses of both channels, the positive ones above.
    pub(super) pulses: Vec<Vec<u64>>,
    temperature: Vec<Change>,
    last: [u64; TEMPERATURE],
}

/// Rows that follow each other.
#[derive(Clone, Copy)]
struct Block {
    /// Its first row.
    begin: usize,
    first: Period,
    lag_ns: u64,
    device: u64,
    /// Begin of the first row since that of the recording \[ns\].
    begins_ns: u64,
}

/// Temperature that holds from a row on.
#[derive(Clone, Copy)]
struct Change {
    row: u32,
    /// Which of the values have it, a bit each.
    which: u32,
    value: f64,
}

impl Rows {
    /// Adds a row, with its gyroscopes or without. `begins_ns`: its begin since that of the recording.
    pub(super) fn push(&mut self, row: &RawSample, gyroscopes: bool, begins_ns: u64) {
        let period = Period::from(row);
        let fits = self.blocks.last().and_then(|block| block.times(self.times.len(), &period, row));
        let times = fits.unwrap_or_else(|| {
            let (lag_ns, device) = (row.lag_ns, row.device);
            self.blocks.push(Block { begin: self.times.len(), first: period, lag_ns, device, begins_ns });
            [0; 2]
        });
        self.temperature_of(row);
        let triads = if gyroscopes { &[row.accelerometers, row.gyroscopes][..] } else { &[row.accelerometers][..] };
        // Rows before the first with gyroscopes had no pulses.
        let rows = self.times.len();
        self.pulses.resize_with(self.pulses.len().max(triads.len() * AXES), || vec![0; rows]);
        for (axis, pulses) in self.pulses.iter_mut().enumerate() {
            let of_both = triads
                .get(axis / AXES)
                .map_or([0; 2], |triad| [triad.positive_pulses[axis % AXES], triad.negative_pulses[axis % AXES]]);
            pulses.push(u64::from(of_both[0]) << 32 | u64::from(of_both[1]));
        }
        self.times.push(times);
    }

    fn temperature_of(&mut self, row: &RawSample) {
        let values = temperature(row).map(f64::to_bits);
        let is_first = self.times.is_empty();
        let mut changed: u32 =
            (0..TEMPERATURE).filter(|of| is_first || values[*of] != self.last[*of]).fold(0, |all, of| all | 1 << of);
        while changed != 0 {
            // Axes often share a thermometer.
            let value = values[changed.trailing_zeros() as usize];
            let which = (0..TEMPERATURE).filter(|of| changed & 1 << of != 0 && values[*of] == value);
            let which = which.fold(0_u32, |all, of| all | 1 << of);
            let row = u32::try_from(self.times.len()).unwrap_or(u32::MAX);
            self.temperature.push(Change { row, which, value: f64::from_bits(value) });
            changed &= !which;
        }
        self.last = values;
    }

    pub(super) const fn len(&self) -> usize {
        self.times.len()
    }

    /// Bytes that the rows take.
    #[cfg(test)]
    pub(super) fn bytes(&self) -> usize {
        let pulses: usize = self.pulses.iter().map(|of| size_of_val(&of[..])).sum();
        pulses + size_of_val(&self.times[..]) + size_of_val(&self.blocks[..]) + size_of_val(&self.temperature[..])
    }

    /// The number of the block that a row is in.
    fn block(&self, row: usize) -> usize {
        self.blocks.partition_point(|block| block.begin <= row).saturating_sub(1)
    }

    /// When a row was, and of what.
    pub(super) fn period(&self, row: usize) -> Period {
        self.blocks[self.block(row)].period(row, self.times[row])
    }

    /// Begin and end of a row since the begin of the recording \[s\].
    pub(super) fn span_s(&self, row: usize) -> [f64; 2] {
        let block = &self.blocks[self.block(row)];
        let [period, first] = [block.period(row, self.times[row]), block.first];
        let begin = |period: &Period| i128::from(period.timestamp_ns) - i128::from(period.interval_ns);
        let begins_ns = i128::from(block.begins_ns) + begin(&period) - begin(&first);
        let begins_ns = u64::try_from(begins_ns).unwrap_or_default();
        [begins_ns, begins_ns + period.interval_ns].map(|ns| ns as f64 / 1e9)
    }

    /// The rows in turn.
    pub(super) fn iter(&self) -> impl Iterator<Item = RawSample> {
        let mut cursor = Cursor::default();
        core::iter::from_fn(move || cursor.next(self))
    }

    fn sample(&self, block: &Block, row: usize, values: &[f64; TEMPERATURE]) -> RawSample {
        let Period { session, sequence, timestamp_ns, interval_ns } = block.period(row, self.times[row]);
        let triad = |kind: usize| {
            let pulses = |shift: u32| {
                [0, 1, 2].map(|axis| self.pulses.get(kind * AXES + axis).map_or(0, |of| (of[row] >> shift) as u32))
            };
            let temperature = |of: usize| [0, 1, 2].map(|axis| values[(kind * 3 + of) * AXES + axis]);
            Triad {
                positive_pulses: pulses(32),
                negative_pulses: pulses(0),
                head_temperature: temperature(0),
                board_temperature: temperature(1),
                head_lagged: temperature(2),
            }
        };
        RawSample {
            session,
            sequence,
            timestamp_ns,
            interval_ns,
            lag_ns: block.lag_ns,
            device: block.device,
            accelerometers: triad(0),
            gyroscopes: triad(1),
            ..RawSample::default()
        }
    }

    /// The times, which are no longer needed, are given back.
    pub(super) fn forget_times(&mut self) {
        (self.times, self.blocks) = (Vec::new(), Vec::new());
    }

    /// Head temperature of a sensor, of each row in turn: the first row, and the value from it on.
    pub(super) fn head(&self, axis: usize) -> impl Iterator<Item = (usize, f64)> {
        let which = 1 << (axis / AXES * 3 * AXES + axis % AXES);
        let changes = self.temperature.iter().filter(move |change| change.which & which != 0);
        changes.map(|change| (change.row as usize, change.value))
    }
}

/// A place among the rows, which goes on from row to row.
pub(super) struct Cursor {
    row: usize,
    block: usize,
    change: usize,
    temperature: [f64; TEMPERATURE],
}

impl Default for Cursor {
    fn default() -> Self {
        Self { row: 0, block: 0, change: 0, temperature: [f64::NAN; TEMPERATURE] }
    }
}

impl Cursor {
    /// The next row. What says nothing of noise, when it was sent and when its temperature was read, is 0.
    pub(super) fn next(&mut self, rows: &Rows) -> Option<RawSample> {
        let row = self.row;
        if row == rows.len() {
            return None;
        }
        self.row += 1;
        self.block += usize::from(rows.blocks.get(self.block + 1).is_some_and(|next| next.begin == row));
        while let Some(change) = rows.temperature.get(self.change).filter(|change| change.row as usize <= row) {
            (0..TEMPERATURE)
                .filter(|of| change.which & 1 << of != 0)
                .for_each(|of| self.temperature[of] = change.value);
            self.change += 1;
        }
        Some(rows.sample(&rows.blocks[self.block], row, &self.temperature))
    }
}

impl Block {
    /// How far the next row, of this number, is from the regular times of the block; `None` if it begins a new block.
    fn times(&self, number: usize, period: &Period, row: &RawSample) -> Option<[i32; 2]> {
        let rows = (number - self.begin) as u64;
        let follows = period.session == self.first.session
            && self.first.sequence.checked_add(rows) == Some(period.sequence)
            && (self.lag_ns, self.device) == (row.lag_ns, row.device);
        let regular = i128::from(self.first.timestamp_ns) + i128::from(rows) * i128::from(self.first.interval_ns);
        let off = i128::from(period.timestamp_ns) - regular;
        let interval = i128::from(period.interval_ns) - i128::from(self.first.interval_ns);
        follows.then_some([i32::try_from(off).ok()?, i32::try_from(interval).ok()?])
    }

    fn period(&self, row: usize, [off, interval]: [i32; 2]) -> Period {
        let rows = (row - self.begin) as u64;
        let Period { session, sequence, timestamp_ns, interval_ns } = self.first;
        let regular = i128::from(timestamp_ns) + i128::from(rows) * i128::from(interval_ns);
        Period {
            session,
            sequence: sequence + rows,
            timestamp_ns: u64::try_from(regular + i128::from(off)).unwrap_or_default(),
            interval_ns: interval_ns.saturating_add_signed(interval.into()),
        }
    }
}

fn temperature(row: &RawSample) -> [f64; TEMPERATURE] {
    let mut values = [0.0; TEMPERATURE];
    let triads = [&row.accelerometers, &row.gyroscopes];
    let of = triads.map(|triad| [triad.head_temperature, triad.board_temperature, triad.head_lagged]);
    values.copy_from_slice(of.as_flattened().as_flattened());
    values
}
