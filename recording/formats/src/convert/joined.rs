//! Accelerometers and gyroscopes that come apart, in two topics or two files, joined by time.
//!
//! The slower ones give the rows, with their times. Each reading of the faster ones belongs to the row that is nearest
//! in time, none to two rows. With rates that are not whole multiples of each other the rows have more and less of
//! them: the mean of a row's readings would weight a reading by how many others are in its row, and the noise density
//! would come out too large, by 5 % at 250 and 200 Hz. So a row is
//!
//! `m + (sum of the row's readings - n m) / r`
//!
//! with `m` the mean of all readings of nine rows, the row in their middle, `n` the number of the row's readings, and
//! `r` the usual one. Where `n` is `r` this is the mean of the readings. The sum over the rows has each reading once,
//! with the same weight; what is slow against nine rows is left as it is.
//!
//! An offset between the two clocks is followed, so that the borders between rows lie between readings, and jitter does
//! not move a reading to another row.

use super::stream::{RowStream, located};
use core::f64::consts::TAU;
use isotherm_recording::RecordingError;
use isotherm_recording::foreign::Units;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, LeftOutRows};
use isotherm_shared::readings::Resolution;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};
use std::collections::VecDeque;

/// Rows before and behind a row that the mean is taken of.
const BESIDE: usize = 4;
/// A reading is of no row if it is further from all of them than this part of the interval between rows.
const FAR: f64 = 0.75;
/// Rates within this part are equal: then the accelerometers give the rows.
const SAME: f64 = 0.01;
/// The part by which each reading moves the offset of the clocks.
const GAIN: f64 = 1.0 / 256.0;
/// Where the offset is over this part of the time between readings, it is one less or more.
const SLIP: f64 = 0.75;
/// Least length of the mean direction of the first readings' phases, if there is an offset.
const DIRECTED: f64 = 0.5;

/// Accelerometers and gyroscopes, joined.
pub(super) struct JoinedSource {
    /// Those of the rows, and the others, of which a row usually has several.
    slow: RowStream,
    fast: RowStream,
    /// Readings of the fast ones a row.
    usual: f64,
    /// What the fast ones' clock is ahead of the centre between their readings \[ns\].
    offset_ns: f64,
    /// Rows that wait for those behind them, and the last ones that were given out.
    rows: VecDeque<TriadRow>,
    before: VecDeque<TriadRow>,
    /// What rounding has left over.
    rest: [f64; AXES],
    first_ns: [Option<u64>; 2],
    tally: JoinTally,
}

/// A row, with what belongs to it of the fast ones.
#[derive(Clone, Copy)]
struct TriadRow {
    slow: ForeignRow,
    count: usize,
    pulses: [i64; AXES],
    last: Option<ForeignRow>,
}

#[derive(Default)]
struct JoinTally {
    rows: u64,
    readings: u64,
    /// Of the readings' times less those of their rows \[ns\].
    offset_ns: f64,
    /// Readings before the first row, and in gaps between rows.
    early: u64,
    between: u64,
    /// Rows without a reading that have the mean of their neighbours, and that are left out.
    filled: u64,
    left_out: u64,
}

impl JoinedSource {
    /// Joins these accelerometers and gyroscopes.
    pub(super) fn new(accelerometers: RowStream, gyroscopes: RowStream) -> Self {
        let are_slower = accelerometers.interval_ns >= gyroscopes.interval_ns * (1.0 - SAME);
        let (slow, fast) = if are_slower { (accelerometers, gyroscopes) } else { (gyroscopes, accelerometers) };
        let usual = (slow.interval_ns / fast.interval_ns).max(1.0);
        let mut joined = Self {
            slow,
            fast,
            usual,
            offset_ns: 0.0,
            rows: VecDeque::new(),
            before: VecDeque::new(),
            rest: [0.0; AXES],
            first_ns: [None; 2],
            tally: JoinTally::default(),
        };
        joined.find_offset();
        joined
    }

    /// How far a reading that is `after_ns` after its row is from where it would be if the readings lay evenly about
    /// the row.
    fn phase_ns(&self, after_ns: f64) -> f64 {
        let first = -(self.usual.round() - 1.0) / 2.0;
        let phase = after_ns / self.fast.interval_ns - first;
        (phase - phase.round()) * self.fast.interval_ns
    }

    /// Finds the offset of the clocks by the first readings, as the direction of their phases: with rates that are no
    /// whole multiples of each other they have none.
    fn find_offset(&mut self) {
        let (slow, fast) = (self.slow.rows.stamps(), self.fast.rows.stamps());
        self.first_ns = [slow.first().copied(), fast.first().copied()];
        let (mut row, mut count, mut sum) = (0, 0.0, [0.0, 0.0]);
        for time_ns in fast {
            while slow.get(row + 1).is_some_and(|next| next.abs_diff(time_ns) <= slow[row].abs_diff(time_ns)) {
                row += 1;
            }
            let Some(row_ns) = slow.get(row) else { break };
            let after_ns = difference(time_ns, *row_ns);
            if after_ns.abs() <= FAR * self.slow.interval_ns {
                let (sin, cos) = libm::sincos(TAU * self.phase_ns(after_ns) / self.fast.interval_ns);
                count += 1.0;
                sum = [sum[0] + cos, sum[1] + sin];
            }
        }
        if libm::hypot(sum[0], sum[1]) > DIRECTED * count {
            self.offset_ns = libm::atan2(sum[1], sum[0]) / TAU * self.fast.interval_ns;
        }
    }

    /// Takes the next row or reading, whichever comes first; false at the end.
    fn step(&mut self) -> Result<bool, RecordingError> {
        let (has_row, _) = (self.slow.load()?, self.fast.load()?);
        let far_ns = FAR * self.slow.interval_ns;
        let time = |reading: &ForeignRow| reading.timestamp_ns.unwrap_or(0);
        let Some(reading) = self.fast.next else {
            self.push_row();
            return Ok(has_row);
        };
        let after = |row: &ForeignRow| difference(time(&reading), time(row)) - self.offset_ns;
        let (of_last, of_next) = (self.rows.back().map(|row| after(&row.slow)), self.slow.next.as_ref().map(after));
        match (of_last, of_next) {
            // The row comes first, or it is the nearest one.
            (_, Some(next)) if next >= 0.0 || -next <= far_ns && of_last.is_none_or(|last| -next < last.abs()) => {
                self.push_row();
            }
            (Some(last), _) if last.abs() <= far_ns => {
                self.assign(&reading, last);
                self.fast.next = None;
            }
            // No row is near.
            (_, Some(_)) => {
                let is_early = self.rows.is_empty() && self.before.is_empty();
                *(if is_early { &mut self.tally.early } else { &mut self.tally.between }) += 1;
                self.fast.next = None;
            }
            (_, None) => return Ok(false),
        }
        Ok(true)
    }

    fn push_row(&mut self) {
        if let Some(slow) = self.slow.next.take() {
            self.rows.push_back(TriadRow { slow, count: 0, pulses: [0; AXES], last: None });
        }
    }

    /// Adds a reading to the last row, this time after it, less the offset \[ns\].
    fn assign(&mut self, reading: &ForeignRow, after_ns: f64) {
        let Some(row) = self.rows.back_mut() else { return };
        row.count += 1;
        let pulses = self.fast.pulses(reading);
        row.pulses.iter_mut().zip(pulses).for_each(|(sum, pulses)| *sum += pulses);
        row.last = Some(*reading);
        self.tally.readings += 1;
        self.tally.offset_ns += after_ns + self.offset_ns;
        self.offset_ns += GAIN * self.phase_ns(after_ns);
        let most_ns = SLIP * self.fast.interval_ns;
        if self.offset_ns.abs() > most_ns {
            self.offset_ns -= self.fast.interval_ns.copysign(self.offset_ns);
        }
    }

    /// The next row that is complete; `None` if it is left out.
    fn finished(&mut self, row: TriadRow) -> Option<ForeignRow> {
        let near_ns = (BESIDE as f64 + 0.5) * self.slow.interval_ns;
        let is_near = |other: &&TriadRow| {
            let [own, other] = [&row, *other].map(|row| row.slow.timestamp_ns.unwrap_or(0));
            difference(own, other).abs() <= near_ns
        };
        let has = |other: Option<&TriadRow>| other.filter(is_near).is_some_and(|other| other.count > 0);
        let is_between = has(self.before.back()) && has(self.rows.front());
        let about = self.before.iter().chain([&row]).chain(self.rows.iter().take(BESIDE)).filter(is_near);
        let (count, sums) = about.fold((0, [0; AXES]), |(count, sums), other| {
            (count + other.count, [0, 1, 2].map(|axis| sums[axis] + other.pulses[axis]))
        });
        if row.count == 0 && !is_between {
            self.tally.left_out += 1;
            return None;
        }
        self.tally.filled += u64::from(row.count == 0);
        self.tally.rows += 1;
        let (mut reading, own) = (row.slow, self.slow.pulses(&row.slow));
        let mut others = [0; AXES];
        for axis in 0..AXES {
            let mean = sums[axis] as f64 / count as f64;
            let more = (row.pulses[axis] as f64 - row.count as f64 * mean) / self.usual;
            let value = mean + more + self.rest[axis];
            // A single reading can be as large as a sample may have; a sum of deviations from the mean larger.
            let limited = value.round().clamp(-f64::from(u32::MAX), f64::from(u32::MAX));
            self.rest[axis] = (value - limited).clamp(-1.0, 1.0);
            others[axis] = limited as i64;
        }
        let [a, g] = if self.slow.are_gyroscopes { [others, own] } else { [own, others] };
        reading.pulses = [a[0], a[1], a[2], g[0], g[1], g[2]];
        let own = if self.slow.are_gyroscopes { AXES..2 * AXES } else { 0..AXES };
        reading.rest = std::array::from_fn(|index| if own.contains(&index) { reading.rest[index] } else { 0.0 });
        // The temperature is that of the accelerometers.
        if self.slow.are_gyroscopes {
            let last = row.last.or_else(|| self.before.iter().rev().find_map(|row| row.last));
            (reading.head, reading.board) = last.map_or((reading.head, reading.board), |last| (last.head, last.board));
        }
        Some(reading)
    }

    fn streams(&self) -> [&RowStream; 2] {
        if self.slow.are_gyroscopes { [&self.fast, &self.slow] } else { [&self.slow, &self.fast] }
    }
}

/// `a - b` \[ns\].
fn difference(a: u64, b: u64) -> f64 {
    (i128::from(a) - i128::from(b)) as f64
}

impl ForeignRows for JoinedSource {
    fn read(&mut self) -> Result<Option<ForeignRow>, RecordingError> {
        loop {
            // The last row may get further readings.
            while self.rows.len() < BESIDE + 2 && self.step()? {}
            let Some(row) = self.rows.pop_front() else { return Ok(None) };
            let reading = self.finished(row);
            self.before.push_back(row);
            if self.before.len() > BESIDE {
                self.before.pop_front();
            }
            if reading.is_some() {
                return Ok(reading);
            }
        }
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        located(self.slow.rows.source.error(place, message), self.slow.file.as_deref())
    }

    fn unit(&self) -> Option<&'static str> {
        self.slow.rows.source.unit()
    }

    fn units(&self) -> Result<Units, String> {
        let [accelerometers, gyroscopes] = self.streams();
        let (a, g) = (accelerometers.rows.source.units()?, gyroscopes.rows.source.units()?);
        let resolution = Resolution { accelerometer: a.resolution.accelerometer, gyroscope: g.resolution.gyroscope };
        Ok(Units { resolution, largest: [a.largest[0], g.largest[1]], devices: [a.devices[0], g.devices[1]] })
    }

    fn are_readings(&self) -> [bool; 2] {
        let [accelerometers, gyroscopes] = self.streams().map(|stream| stream.rows.source.are_readings());
        [accelerometers[0], gyroscopes[1]]
    }

    fn are_counts(&self) -> bool {
        self.streams().iter().any(|stream| stream.rows.source.are_counts())
    }

    fn has_gyroscopes(&self) -> bool {
        true
    }

    fn has_temperature(&self) -> bool {
        self.streams()[0].rows.source.has_temperature()
    }

    fn no_rows(&self) -> String {
        let [slow, fast] = [&self.slow, &self.fast].map(|stream| &stream.name);
        let [slow_ns, fast_ns] = self.first_ns.map(Option::unwrap_or_default);
        format!(
            "the times of {slow} and {fast} do not overlap: they begin at {slow_ns} ns and {fast_ns} ns; give files or \
             topics of the same time"
        )
    }

    fn notes(&self) -> Vec<String> {
        let JoinTally { rows, readings, offset_ns, early, .. } = &self.tally;
        let (slow, fast) = (&self.slow, &self.fast);
        let ms = offset_ns / (*readings).max(1) as f64 / 1e6;
        let side = if ms < 0.0 { "before" } else { "after" };
        let early = match early {
            0 => String::new(),
            early => format!("; {early} readings before the first row are left out"),
        };
        let note = format!(
            "the {} of {} and the {} of {} are joined by time: the rows are those of the {}, with {:.3} readings \
             of the {} a row, {:.3} ms {side} it on average{early}",
            slow.sensors(),
            slow.name,
            fast.sensors(),
            fast.name,
            slow.sensors(),
            *readings as f64 / (*rows).max(1) as f64,
            fast.sensors(),
            ms.abs()
        );
        let of_streams = self.streams().into_iter().flat_map(|stream| stream.rows.source.notes());
        of_streams.chain([note]).collect()
    }

    fn left_out_by_stamps(&self) -> LeftOutRows {
        let [accelerometers, gyroscopes] = self.streams().map(|stream| stream.rows.left_out());
        accelerometers.or_more(gyroscopes)
    }

    fn findings(&self) -> Vec<Finding> {
        let mut found: Vec<Finding> = Vec::new();
        for stream in self.streams() {
            for finding in stream.rows.findings(0).into_iter().chain(stream.rows.source.findings()) {
                if !found.contains(&finding) {
                    found.push(finding);
                }
            }
        }
        let JoinTally { between, filled, left_out, .. } = self.tally;
        let (rows, readings) = (self.slow.sensors(), self.fast.sensors());
        let mut add = |count: u64, what: String| {
            if count > 0 {
                found.push(Finding::warning(name::MISSING_ROWS, format!("{count} {what}")));
            }
        };
        add(
            filled,
            format!(
                "rows of the {rows} have no reading of the {readings} next to them, and have the mean of the rows \
                 about them"
            ),
        );
        add(
            left_out,
            format!("rows of the {rows} have no reading of the {readings}, nor do their neighbours; they are left out"),
        );
        add(between, format!("readings of the {readings} lie in gaps of the {rows}; they are left out"));
        found
    }
}
