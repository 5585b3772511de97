//! One recording of a ramp, reduced while it is read: pulses by bins of a second, and the readings of the temperature.

use super::readings::{BIN_NS, Changes, Reading, Readings, interpolated};
use crate::screen::{BadRows, Screen};
use core::ops::Range;
use isotherm_campaign::{implausible, implausible_time};
use isotherm_recording::{CampaignRow, Continuity, Marks, RawCsvReader, RecordingError};
use isotherm_shared::table::Axis;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::SENSORS;
use isotherm_shared::wire::{AXES, RawSample, Triad};
use isotherm_support::finding::Finding;
use std::io::Read;

/// Fewest changes from row to row that give a variance.
const LEAST_CHANGES: u32 = 3;
/// One recording of an IMU at rest in one stay, while its temperature changes.
#[derive(Clone, Debug, PartialEq)]
pub struct RampRecording {
    name: String,
    previous_ns: Option<u64>,
    temperature_is_of_middle: bool,
    bins: Vec<Bin>,
    heads: [Readings; SENSORS],
    boards: [Readings; SENSORS],
    has_gyroscopes: bool,
    devices: [u64; 2],
    continuity: Continuity,
    /// What was found in its file before.
    findings: Vec<Finding>,
    fits_table: bool,
    marks: Marks,
    bad: BadRows,
    /// When the vehicle was armed or flew \[ns\].
    in_use: Vec<Range<u64>>,
    /// The last row that was good, for the changes from row to row.
    last: Option<Last>,
    steps: [Changes; SENSORS],
    /// Whether it is a stretch of a recording that has others.
    is_stretch: bool,
}

/// A row's end, and its net pulses.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Last {
    end_ns: u64,
    seconds: f64,
    net: [f64; SENSORS],
}

fn changes(now: &[f64; SENSORS], before: &[f64; SENSORS]) -> [f64; SENSORS] {
    core::array::from_fn(|sensor| now[sensor] - before[sensor])
}

/// Rows without a gap between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bin {
    /// Begin of the first row and end of the last \[ns\].
    pub begin_ns: u64,
    pub end_ns: u64,
    /// Sum of the intervals \[ns\].
    interval_ns: u64,
    /// Pulses of the positive and of the negative channel.
    pulses: [[u64; 2]; SENSORS],
    /// Number of rows.
    rows: u32,
    /// Time after it whose rows are there, but left out \[ns\].
    left_out_ns: u64,
    /// Sum of the squared changes of the net rates from row to row, and their number.
    changes: ([f32; SENSORS], u32),
}

impl RampRecording {
    /// An empty recording. `name` is what messages call it: its file.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            previous_ns: None,
            temperature_is_of_middle: false,
            bins: Vec::new(),
            heads: Default::default(),
            boards: Default::default(),
            has_gyroscopes: false,
            devices: [0; 2],
            continuity: Continuity::default(),
            findings: Vec::new(),
            fits_table: false,
            marks: Marks::default(),
            bad: BadRows::default(),
            in_use: Vec::new(),
            last: None,
            steps: Default::default(),
            is_stretch: false,
        }
    }

    /// The recording of these rows.
    ///
    /// # Errors
    /// At the first row that cannot be read or used, with its line; see [`add`](Self::add).
    pub fn read(
        name: impl Into<String>,
        rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
    ) -> Result<Self, RecordingError> {
        Self::read_with(name, rows, |recording, raw| recording.add(raw))
    }

    /// The same, of an IMU at rest: bad rows are found, counted in [`bad_rows`](Self::bad_rows), and left out. A row is
    /// bad if it holds a value that no sensor measured, such as a marker, a spike, no number, a temperature that no IMU
    /// has, or a value that stands still.
    ///
    /// Temperature whose time is not known is that of the middle of its row, as the pulses are: a log has both of one
    /// instant. At the end of a row of a second, a fast warm-up would be a tenth of a degree further.
    ///
    /// # Errors
    /// At the first row that cannot be read, or whose time or interval cannot be right, with its line.
    pub fn read_screened(
        name: impl Into<String>,
        rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
    ) -> Result<Self, RecordingError> {
        let mut screen = Screen::default();
        let mut recording = Self::read_with(name, rows, |recording, raw| {
            recording.temperature_is_of_middle = true;
            recording.arrive(raw, implausible_time)?;
            screen.add(raw, |raw, is_good| recording.take(raw, is_good));
            Ok(())
        })?;
        recording.bad = screen.finish(|raw, is_good| recording.take(raw, is_good));
        Ok(recording)
    }

    fn read_with(
        name: impl Into<String>,
        rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
        mut add: impl FnMut(&mut Self, &RawSample) -> Result<(), String>,
    ) -> Result<Self, RecordingError> {
        let mut recording = Self::new(name);
        let mut last = 0;
        for row in rows {
            let CampaignRow { line, sample, .. } = row?;
            add(&mut recording, &sample).map_err(|message| RecordingError::Data { line, message })?;
            last = line;
        }
        match recording.continuity.overlap() {
            Some(overlap) => Err(RecordingError::Data { line: last, message: overlap.to_string() }),
            None => Ok(recording),
        }
    }

    /// The recording in a CSV file of raw samples.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn from_csv(name: impl Into<String>, source: impl Read) -> Result<Self, RecordingError> {
        let mut reader = RawCsvReader::new(source)?;
        let rows = core::iter::from_fn(|| {
            let sample = reader.next()?;
            let line = reader.line();
            Some(sample.map(|sample| CampaignRow { line, set_point_c: 0.0, position: None, sample }))
        });
        Self::read(name, rows)
    }

    /// The longest time without rows, and when it begins after the first row \[s\].
    pub(super) fn largest_gap_s(&self) -> (f64, f64) {
        let begin_ns = self.bins.first().map_or(0, |bin| bin.begin_ns);
        let gaps = self.bins.windows(2).map(|pair| (pair[0].end_ns - begin_ns, pair[0].gap_ns(&pair[1])));
        let (at_ns, gap_ns) = gaps.max_by_key(|(_, gap_ns)| *gap_ns).unwrap_or_default();
        (at_ns as f64 / 1e9, gap_ns as f64 / 1e9)
    }

    /// How long rows are missing within it, and how long it lasts \[s\].
    pub(crate) fn missing_s(&self) -> (f64, f64) {
        let gaps = self.bins.windows(2).map(|pair| pair[0].gap_ns(&pair[1]));
        let ends = self.bins.first().zip(self.bins.last());
        let all_ns = ends.map_or(0, |(first, last)| last.end_ns - first.begin_ns);
        (gaps.sum::<u64>() as f64 / 1e9, all_ns as f64 / 1e9)
    }

    /// Usual time without rows between one bin and the next \[s\]: a hole, however long, does not change it.
    pub(crate) fn usual_gap_s(&self) -> f64 {
        let gaps = self.bins.windows(2).map(|pair| pair[1].begin_ns.saturating_sub(pair[0].end_ns) as f64 / 1e9);
        isotherm_statistics::median(gaps)
    }

    /// Head temperature of A1 before and after the longest time without rows.
    pub(super) fn temperature_around_gap(&self) -> Option<[f64; 2]> {
        let gap = |pair: &&[Bin]| pair[0].gap_ns(&pair[1]);
        let pair = self.bins.windows(2).max_by_key(gap)?;
        let (readings, times_ns) = (self.heads(0), [pair[0].middle_ns(), pair[1].middle_ns()]);
        if readings.is_empty() {
            return None;
        }
        let around = interpolated(&readings, &times_ns);
        Some([around[0], around[1]])
    }

    /// When the first of these bins begins \[ns\].
    pub(crate) fn begin_ns(&self, bins: &Range<usize>) -> u64 {
        self.bins[bins.start].begin_ns
    }

    /// What is missing in it.
    pub const fn continuity(&self) -> &Continuity {
        &self.continuity
    }

    /// The same recording, with what was found in its file.
    #[must_use]
    pub fn with_findings(self, findings: Vec<Finding>) -> Self {
        Self { findings, ..self }
    }

    /// The same recording, whose pulses were made for the table or not. Readings of any interval are right then.
    #[must_use]
    pub fn of_table(self, fits_table: bool) -> Self {
        Self { fits_table, ..self }
    }

    /// Whether its pulses were made for the table.
    pub(crate) const fn fits_table(&self) -> bool {
        self.fits_table
    }

    /// What was found in its file.
    pub(crate) fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// What messages call it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Adds the next sample. Gaps are allowed.
    ///
    /// # Errors
    /// Why the sample cannot be used: see [`implausible`]; a full counter or temperature that is not finite, of a
    /// gyroscope.
    pub fn add(&mut self, raw: &RawSample) -> Result<(), String> {
        let implausible = |raw: &RawSample, previous_ns| {
            implausible(raw, previous_ns).or_else(|| implausible_gyroscopes(&raw.gyroscopes.or_zero()))
        };
        self.arrive(raw, implausible)?;
        self.take(raw, true);
        Ok(())
    }

    /// What every row shows, whatever its values are.
    fn arrive(
        &mut self,
        raw: &RawSample,
        implausible: impl Fn(&RawSample, Option<u64>) -> Option<String>,
    ) -> Result<(), String> {
        if let Some(wrong) = implausible(raw, self.previous_ns) {
            return Err(wrong);
        }
        self.previous_ns = Some(raw.timestamp_ns);
        self.continuity.add(raw);
        self.marks.add(raw);
        if let Some(overlap) = self.continuity.overlap_so_far() {
            return Err(overlap.to_string());
        }
        self.has_gyroscopes |= !raw.gyroscopes.is_absent();
        // 0 is a unit that nobody has named.
        let free = self.devices.iter_mut().find(|known| **known == 0 || **known == raw.device);
        free.into_iter().for_each(|known| *known = raw.device);
        Ok(())
    }

    /// The values of a row; of a bad one, only its time.
    fn take(&mut self, raw: &RawSample, is_good: bool) {
        if !is_good {
            self.pass(raw);
            return;
        }
        let gyroscopes = raw.gyroscopes.or_zero();
        let unknown_ns = match self.temperature_is_of_middle {
            true => raw.timestamp_ns.saturating_sub(raw.interval_ns / 2),
            false => raw.timestamp_ns,
        };
        self.add_pulses(raw);
        for (sensor, triad) in [(0, &raw.accelerometers), (AXES, &gyroscopes)] {
            for axis in 0..AXES {
                self.heads[sensor + axis].add(raw, triad.head_temperature[axis], unknown_ns);
                self.boards[sensor + axis].add(raw, triad.board_temperature[axis], unknown_ns);
            }
        }
    }

    /// The last bin, if a row goes on with it.
    fn open_bin(&mut self, raw: &RawSample) -> Option<&mut Bin> {
        // The clock of the first row may have begun with it.
        let begin_ns = raw.timestamp_ns.saturating_sub(raw.interval_ns);
        let bin = self.bins.last_mut()?;
        let gap_ns = begin_ns.saturating_sub(bin.end_ns);
        (bin.end_ns - bin.begin_ns < BIN_NS && gap_ns <= raw.interval_ns / 2).then_some(bin)
    }

    /// Goes on after a row that is left out.
    fn pass(&mut self, raw: &RawSample) {
        self.last = None;
        if let Some(bin) = self.open_bin(raw) {
            bin.end_ns = raw.timestamp_ns;
        } else if let Some(bin) = self.bins.last_mut() {
            bin.left_out_ns += raw.interval_ns;
        }
    }

    fn add_pulses(&mut self, raw: &RawSample) {
        let triads = [&raw.accelerometers, &raw.gyroscopes];
        let pulses = core::array::from_fn(|sensor| {
            let (triad, axis) = (triads[sensor / AXES], sensor % AXES);
            [triad.positive_pulses[axis], triad.negative_pulses[axis]].map(u64::from)
        });
        let seconds = raw.interval_ns as f64 / 1e9;
        let net = pulses.map(|[positive, negative]: [u64; 2]| positive as f64 - negative as f64);
        let begin_ns = raw.timestamp_ns.saturating_sub(raw.interval_ns);
        let follows = |last: &Last| begin_ns.saturating_sub(last.end_ns) <= raw.interval_ns / 2;
        let last = self.last.replace(Last { end_ns: raw.timestamp_ns, seconds, net }).filter(follows);
        for (steps, change) in self.steps.iter_mut().zip(last.iter().flat_map(|last| changes(&net, &last.net))) {
            // A rounding of up to a pulse is no step.
            if change.abs() > 2.0 {
                steps.add(change / seconds);
            }
        }
        let change = last.map(|last| changes(&net.map(|n| n / seconds), &last.net.map(|n| n / last.seconds)));
        if let Some(bin) = self.open_bin(raw) {
            bin.end_ns = raw.timestamp_ns;
            bin.interval_ns += raw.interval_ns;
            bin.pulses.iter_mut().flatten().zip(pulses.iter().flatten()).for_each(|(sum, count)| *sum += count);
            bin.rows += 1;
            if let Some(change) = change {
                bin.changes.0.iter_mut().zip(change).for_each(|(sum, change)| *sum += (change * change) as f32);
                bin.changes.1 += 1;
            }
        } else {
            let (interval_ns, changes) = (raw.interval_ns, ([0.0; SENSORS], 0));
            self.bins.push(Bin {
                begin_ns,
                end_ns: raw.timestamp_ns,
                interval_ns,
                pulses,
                rows: 1,
                left_out_ns: 0,
                changes,
            });
        }
    }

    /// Whether it is a stretch of a recording, so that others are of the same unit.
    pub(super) const fn is_stretch(&self) -> bool {
        self.is_stretch
    }

    /// The bad rows that were left out while it was read.
    pub const fn bad_rows(&self) -> &BadRows {
        &self.bad
    }

    /// The same recording, of a vehicle that was armed or flew in these times, in order \[ns\]: no rows of them are at
    /// rest.
    #[must_use]
    pub fn with_in_use(self, in_use: Vec<Range<u64>>) -> Self {
        Self { in_use, ..self }
    }

    /// When the vehicle was armed or flew \[ns\].
    pub(crate) fn in_use(&self) -> &[Range<u64>] {
        &self.in_use
    }

    /// The least change of a sensor from row to row, but for some \[pulse/s\]; 0 if it never changes.
    pub(crate) fn step(&self, sensor: usize) -> f64 {
        self.steps[sensor].least()
    }

    /// The least change of the head temperature of A1, but for some; 0 if it never changes.
    pub(crate) fn step_of_temperature(&self) -> f64 {
        self.heads[0].steps.least()
    }

    /// Usual length of a row \[ns\].
    pub(crate) fn usual_row_ns(&self) -> u64 {
        let of_bin = |bin: &Bin| bin.interval_ns as f64 / f64::from(bin.rows.max(1));
        isotherm_statistics::median(self.bins.iter().map(of_bin)) as u64
    }

    /// Good rows of these bins.
    pub(crate) fn rows_of(&self, bins: &Range<usize>) -> usize {
        self.bins[bins.clone()].iter().map(|bin| bin.rows as usize).sum()
    }

    /// Begin and end of these bins \[ns\].
    pub(crate) fn times_of(&self, bins: &Range<usize>) -> Range<u64> {
        match &self.bins[bins.clone()] {
            [first, .., last] => first.begin_ns..last.end_ns,
            [one] => one.begin_ns..one.end_ns,
            [] => 0..0,
        }
    }

    /// These bins; what comes after them is left out.
    fn piece(&self, bins: &Range<usize>) -> impl Iterator<Item = Bin> {
        let last = bins.end - 1;
        bins.clone().map(move |bin| {
            let left_out_ns = if bin == last { u64::MAX } else { self.bins[bin].left_out_ns };
            Bin { left_out_ns, ..self.bins[bin] }
        })
    }

    /// The stretch of these bins, each range of which is in order, as a recording of its own. The `first` stretch of a
    /// recording keeps what is reported of the whole.
    pub(crate) fn stretch(&self, name: String, bins: &[Range<usize>], first: bool) -> Self {
        let times: Vec<Range<u64>> = bins.iter().map(|bins| self.times_of(bins)).collect();
        let whole = if first { self.clone() } else { Self { devices: self.devices, ..Self::new("") } };
        let of = |all: &[Readings; SENSORS]| core::array::from_fn(|sensor| all[sensor].within(&times));
        Self {
            name,
            bins: bins.iter().flat_map(|bins| self.piece(bins)).collect(),
            heads: of(&self.heads),
            boards: of(&self.boards),
            has_gyroscopes: self.has_gyroscopes,
            bad: self.bad.within(&times),
            steps: self.steps.clone(),
            is_stretch: true,
            ..whole
        }
    }

    /// Whether both have rows in common; see [`Marks`].
    pub fn has_rows_of(&self, other: &Self) -> bool {
        self.marks.share_rows_with(&other.marks) || self.bins == other.bins && self.heads == other.heads
    }

    /// Mean of what a sensor, 0 to 5, indicates \[g0 or deg/h\], its bias included, with the scale factors at mean
    /// board temperature; NaN without rows.
    pub(crate) fn mean_indicated(&self, sensor: usize, coefficients: &Axis) -> f64 {
        let boards = self.boards(sensor);
        let board = boards.iter().map(|reading| reading.temperature).sum::<f64>() / boards.len() as f64;
        let seconds: f64 = self.bins.iter().map(Bin::seconds).sum();
        let scale_factors = [&coefficients.positive_scale_factor, &coefficients.negative_scale_factor];
        let pulses = |channel: usize| self.bins.iter().map(|bin| bin.pulses[sensor][channel]).sum::<u64>() as f64;
        scale_factors.iter().enumerate().map(|(channel, k)| pulses(channel) / seconds / k.at(k.clamp(board))).sum()
    }

    /// The units that took the samples, the first two; 0 is none.
    pub const fn devices(&self) -> [u64; 2] {
        self.devices
    }

    /// Whether any sample has pulses or temperature of a gyroscope.
    pub const fn has_gyroscopes(&self) -> bool {
        self.has_gyroscopes
    }

    /// The rows, in order.
    pub(crate) fn bins(&self) -> &[Bin] {
        &self.bins
    }

    /// The readings of a sensor's head temperature, in order.
    pub(crate) fn heads(&self, sensor: usize) -> Vec<Reading> {
        self.heads[sensor].readings()
    }

    /// The readings of a sensor's board temperature, in order.
    pub(super) fn boards(&self, sensor: usize) -> Vec<Reading> {
        self.boards[sensor].readings()
    }

    /// Head temperature of A1 in the middle of each bin; empty without temperature.
    pub(crate) fn temperature_of_bins(&self) -> Vec<f64> {
        let (readings, times_ns) = (self.heads(0), self.bins.iter().map(Bin::middle_ns).collect::<Vec<_>>());
        if readings.is_empty() { Vec::new() } else { interpolated(&readings, &times_ns) }
    }

    /// Usual length of a bin \[s\]: that of a row, if rows are a second or longer, or have gaps between them.
    pub(crate) fn usual_interval_s(&self) -> f64 {
        isotherm_statistics::median(self.bins.iter().map(Bin::seconds))
    }

    /// Rates at which the head temperature of A1 moves, without sign, over parts of the recording \[1/s\].
    pub(crate) fn rates_of_temperature(&self, part: f64) -> Vec<f64> {
        let heads = self.heads(0);
        let ends = heads.first().zip(heads.last());
        let step_ns = ends.map_or(0.0, |(first, last)| (last.time_ns - first.time_ns) as f64 * part);
        let mut from = heads.first().copied();
        let mut rates = Vec::new();
        for reading in heads {
            let Some(Reading { time_ns, temperature }) = from else { break };
            let passed_ns = (reading.time_ns - time_ns) as f64;
            if passed_ns >= step_ns && passed_ns > 0.0 {
                rates.push((reading.temperature - temperature).abs() / (passed_ns / 1e9));
                from = Some(reading);
            }
        }
        rates
    }

    /// Least and largest head and board temperature of a sensor, 0 to 5; `None` without rows.
    pub(crate) fn extremes(&self, sensor: usize) -> [Option<[f64; 2]>; 2] {
        [&self.heads, &self.boards].map(|all| all[sensor].extremes)
    }
}

/// The reason why the part of the gyroscopes cannot be used.
fn implausible_gyroscopes(triad: &Triad) -> Option<String> {
    for (axis, name) in SensorKind::Gyroscope.names().iter().enumerate() {
        for (temperature, place) in [(triad.head_temperature[axis], "head"), (triad.board_temperature[axis], "board")] {
            if !temperature.is_finite() {
                return Some(format!("g{}_{place} is {temperature}, which is not a temperature", axis + 1));
            }
        }
        if triad.positive_pulses[axis] == u32::MAX || triad.negative_pulses[axis] == u32::MAX {
            return Some(format!("the counter of {name} is full: saturated"));
        }
    }
    None
}

impl Bin {
    pub(crate) const fn middle_ns(&self) -> u64 {
        self.begin_ns.midpoint(self.end_ns)
    }

    /// Time without rows up to the next bin \[ns\].
    const fn gap_ns(&self, next: &Self) -> u64 {
        next.begin_ns.saturating_sub(self.end_ns).saturating_sub(self.left_out_ns)
    }

    pub(super) fn seconds(&self) -> f64 {
        self.interval_ns as f64 / 1e9
    }

    /// Net pulse rate \[pulse/s\].
    pub(crate) fn net_rate(&self, sensor: usize) -> f64 {
        let [positive, negative] = self.rates(sensor);
        positive - negative
    }

    /// Half the mean squared change of a net rate from row to row: the variance of a row of white noise; `None` of too
    /// few rows.
    pub(crate) fn variance(&self, sensor: usize) -> Option<f64> {
        let (sums, count) = self.changes;
        (count >= LEAST_CHANGES).then(|| f64::from(sums[sensor]) / f64::from(count) / 2.0)
    }

    /// Pulse rates of the positive and of the negative channel \[pulse/s\].
    pub(super) fn rates(&self, sensor: usize) -> [f64; 2] {
        self.pulses[sensor].map(|count| count as f64 / self.seconds())
    }
}
