//! The blocks of all recordings, with the columns of the fit.
//!
//! Over 400 lines: what goes into the fit, from the recordings to the columns.

use super::equations::PieceEquations;
use super::options::{CurveSource, TransientsError};
use super::readings::{Reading, behind, interpolated};
use super::recording::RampRecording;
use core::ops::Range;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_shared::wire::SENSORS;
use isotherm_statistics::{Sweep, mean, sweeps};
use isotherm_support::checkpoint::checkpoint;

/// Most blocks of a recording.
const BLOCKS: usize = 400;
/// Least length of a block of a long recording \[s\].
const LEAST_BLOCK_S: f64 = 10.0;
/// Blocks of a recording that is too short for that.
const SHORT_BLOCKS: f64 = 48.0;
/// A polynomial goes on beyond its range by this part of it.
const BEYOND: f64 = 0.02;
/// A reading that goes away from both neighbours by more than this part of the range is broken.
const SPIKE: f64 = 0.1;
/// … and by more than so many steps of the temperature, by which a coarse one goes there and back.
const STEPS: f64 = 2.5;
/// Fewest blocks of a recording.
pub(super) const FEWEST_BLOCKS: usize = 24;
/// Pieces of a sweep.
const PIECES: usize = 4;
/// Half widths of the plays, as parts of the range of the temperature.
const PLAYS: [f64; 3] = [0.02, 0.07, 0.22];
/// The start that was not soaked is a column for this many time constants.
const START: f64 = 5.0;
/// Chebyshev polynomials of a curve, without its constant.
pub(super) const CURVE: usize = 3;

/// What all biases have in common.
pub(super) struct Ramps {
    /// Number of recordings.
    pub recordings: usize,
    /// Of all recordings, one after the other.
    pub blocks: Vec<Block>,
    /// The sweeps of all recordings.
    pub sweeps: Vec<RampSweep>,
    /// Least time constant of a search \[s\].
    pub least_tau_s: f64,
    /// Duration of the longest sweep \[s\].
    pub longest_sweep_s: f64,
    /// Part of the range of the temperature that heating and cooling of one recording share, of the recording with the
    /// largest one.
    pub shared: f64,
    pub biases: Vec<Bias>,
}

/// Some of the bins of a recording.
pub(super) struct Block {
    pub recording: usize,
    /// Middle, since the begin of the recording \[s\].
    pub age_s: f64,
    /// Middle in the recording, from -1 to 1.
    time: f64,
    /// Bins of the recording.
    pub bins: Range<usize>,
    /// Whether it is in no fit: the temperature of a sensor is beyond the range of a polynomial of the table.
    pub left_out: bool,
    /// Whether the fit with a time constant that is given does without it: the start may not have been soaked.
    pub unsoaked: bool,
}

impl Block {
    /// Whether the fits have it.
    pub(super) const fn is_fitted(&self) -> bool {
        !self.left_out && !self.unsoaked
    }
}

/// A sweep with its four pieces, which are ranges of blocks.
pub(super) struct RampSweep {
    pub recording: usize,
    pub heating: bool,
    pub pieces: Vec<Range<usize>>,
}

/// One sensor.
pub(super) struct Bias {
    pub kind: SensorKind,
    pub axis: usize,
    /// Lowest and highest head temperature of all recordings.
    pub range: [f64; 2],
    /// Largest specific force that it carries in a recording \[g0\]; 0 for gyroscopes.
    pub carried_g0: f64,
    /// Mean specific force that it carries, by recording \[g0\]; 0 for gyroscopes.
    pub carried: Vec<f64>,
    /// Mean head temperature, by block.
    pub temperature: Vec<f64>,
    /// Mean of what the sensor indicates, less the campaign's curve and the mean of the recording, by block \[g0 or
    /// deg/h\].
    pub values: Vec<f64>,
    /// Whether the temperature is beyond the range of a polynomial by more than 2 % of it, by block.
    outside: Vec<bool>,
    plays: Vec<[f64; PLAYS.len()]>,
    recordings: Vec<Temperature>,
}

/// Head temperature of one recording.
struct Temperature {
    readings: Vec<Reading>,
    /// Middles of its bins \[ns\], and the temperature there.
    times_ns: Vec<u64>,
    values: Vec<f64>,
}

/// Groups of columns of the fit, in the order in which one that depends on others is left out.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Column {
    Constant,
    Curve,
    Transient,
    Start,
    Plays,
    Time,
}

impl Ramps {
    /// # Errors
    /// If a recording is too short, or if its temperature does not change.
    pub(super) fn new(
        recordings: &[RampRecording],
        table: &CoefficientTable,
        curves: CurveSource,
    ) -> Result<Self, TransientsError> {
        let mut blocks = Vec::new();
        let mut least_tau_s = f64::INFINITY;
        for (number, recording) in recordings.iter().enumerate() {
            let found = blocks_of(number, recording)?;
            let interval_s = 2.0 * temperature_interval_s(&recording.heads(0));
            least_tau_s = least_tau_s.min(interval_s.max(block_s(recording) / 3.0));
            blocks.extend(found);
        }
        let gyroscopes = table.content().gyroscopes.as_ref();
        let gyroscopes = gyroscopes.filter(|_| recordings.iter().all(RampRecording::has_gyroscopes));
        let triads = [(SensorKind::Accelerometer, &table.content().axes)].into_iter();
        let triads = triads.chain(gyroscopes.map(|gyroscopes| (SensorKind::Gyroscope, &gyroscopes.axes)));
        let sensors = triads.flat_map(|(kind, axes)| axes.iter().enumerate().map(move |(axis, c)| (kind, axis, c)));
        let biases: Result<Vec<_>, _> = sensors
            .map(|(kind, axis, coefficients)| Bias::new(recordings, &blocks, kind, axis, coefficients, curves))
            .collect();
        let biases = biases?;
        for (i, block) in blocks.iter_mut().enumerate() {
            block.left_out = biases.iter().any(|bias| bias.outside[i]);
        }
        let mut ramps = Self {
            recordings: recordings.len(),
            blocks,
            sweeps: Vec::new(),
            least_tau_s,
            longest_sweep_s: 0.0,
            shared: 0.0,
            biases,
        };
        ramps.find_sweeps();
        Ok(ramps)
    }

    /// Finds sweeps in the mean head temperature of the accelerometers.
    fn find_sweeps(&mut self) {
        let temperature: Vec<f64> = (0..self.blocks.len())
            .map(|i| self.biases[..AXES].iter().map(|bias| bias.temperature[i]).sum::<f64>() / AXES as f64)
            .collect();
        let [low, high] = range_of(&temperature);
        for recording in 0..self.recordings {
            let Range { start: begin, end } = self.blocks_of(recording);
            let found = sweeps(&temperature[begin..end]);
            let extent = |heating: bool| {
                let of = found.iter().filter(|sweep| sweep.heating == heating);
                range_of(
                    &of.flat_map(|sweep| temperature[begin..end][sweep.values.clone()].iter().copied())
                        .collect::<Vec<_>>(),
                )
            };
            let (up, down) = (extent(true), extent(false));
            self.shared = self.shared.max((up[1].min(down[1]) - up[0].max(down[0])) / (high - low));
            for Sweep { values, heating } in found {
                let (first, last) = (&self.blocks[begin + values.start], &self.blocks[begin + values.end - 1]);
                self.longest_sweep_s = self.longest_sweep_s.max(last.age_s - first.age_s);
                let at = |piece: usize| begin + values.start + values.len() * piece / PIECES;
                let pieces = (0..PIECES).map(|piece| at(piece)..at(piece + 1)).filter(|piece| !piece.is_empty());
                self.sweeps.push(RampSweep { recording, heating, pieces: pieces.collect() });
            }
        }
    }

    /// Leaves out the blocks of the first `soak_s` of every recording.
    pub(super) fn leave_out_start(&mut self, soak_s: f64) {
        self.blocks.iter_mut().for_each(|block| block.unsoaked |= block.age_s <= soak_s);
    }

    /// Number of blocks that the fit has.
    pub(super) fn inside(&self) -> usize {
        self.blocks.iter().filter(|block| block.is_fitted()).count()
    }

    /// The blocks of a recording.
    pub(super) fn blocks_of(&self, recording: usize) -> Range<usize> {
        self.blocks.partition_point(|block| block.recording < recording)
            ..self.blocks.partition_point(|block| block.recording <= recording)
    }

    /// The columns of one kind.
    pub(super) fn columns(&self, column: Column) -> Range<usize> {
        let sizes = [
            (Column::Constant, self.recordings),
            (Column::Curve, CURVE),
            (Column::Transient, 1),
            (Column::Start, self.recordings),
            (Column::Plays, PLAYS.len()),
            (Column::Time, self.recordings),
        ];
        let before = sizes.iter().take_while(|(other, _)| *other != column).map(|(_, size)| size).sum();
        let size = sizes.iter().find(|(other, _)| *other == column).map_or(0, |(_, size)| *size);
        before..before + size
    }

    /// All columns of the kinds, in their order.
    pub(super) fn columns_of(&self, columns: &[Column]) -> Vec<usize> {
        columns.iter().flat_map(|column| self.columns(*column)).collect()
    }

    /// The row of every block of one bias: its columns with the time constant, and its value.
    pub(super) fn rows(&self, bias: &Bias, tau_s: f64) -> Vec<Vec<f64>> {
        checkpoint();
        let count = self.columns(Column::Time).end;
        let differences = self.differences(bias, tau_s);
        let row = |(i, block): (usize, &Block)| {
            let mut row = vec![0.0; count + 1];
            let [low, high] = bias.range;
            let x = (2.0 * bias.temperature[i] - low - high) / (high - low);
            let own = |column: Column| self.columns(column).start + block.recording;
            row[own(Column::Constant)] = 1.0;
            let curve = self.columns(Column::Curve).start;
            row[curve..curve + CURVE].copy_from_slice(&chebyshev(x));
            row[self.columns(Column::Transient).start] = differences[i];
            row[own(Column::Start)] = if block.age_s < START * tau_s { libm::exp(-block.age_s / tau_s) } else { 0.0 };
            row[self.columns(Column::Plays)].copy_from_slice(&bias.plays[i]);
            row[own(Column::Time)] = block.time;
            row[count] = bias.values[i];
            row
        };
        self.blocks.iter().enumerate().map(row).collect()
    }

    /// Normal equations of every piece of every sweep, from the rows.
    pub(super) fn equations(&self, rows: &[Vec<f64>]) -> Vec<Vec<PieceEquations>> {
        let piece = |recording: usize, piece: &Range<usize>| {
            checkpoint();
            let mut equations = PieceEquations::new(self.columns_of_recording(recording));
            let inside = piece.clone().filter(|block| self.blocks[*block].is_fitted());
            inside.for_each(|block| equations.add(&rows[block]));
            equations
        };
        self.sweeps.iter().map(|sweep| sweep.pieces.iter().map(|it| piece(sweep.recording, it)).collect()).collect()
    }

    /// The columns that are not 0 in rows of a recording, and the value, which comes after all columns.
    fn columns_of_recording(&self, recording: usize) -> Vec<usize> {
        use Column::{Constant, Curve, Plays, Start, Time, Transient};
        let own = |column: Column| match self.columns(column) {
            all if matches!(column, Constant | Start | Time) => all.start + recording..all.start + recording + 1,
            all => all,
        };
        let columns = [Constant, Curve, Transient, Start, Plays, Time].into_iter().flat_map(own);
        columns.chain([self.columns(Time).end]).collect()
    }

    /// Mean of d = L - U, by block.
    pub(super) fn differences(&self, bias: &Bias, tau_s: f64) -> Vec<f64> {
        let lag_ns = (tau_s * 1e9).round() as u64;
        let of = |temperature: &Temperature| {
            behind(&temperature.readings, &temperature.times_ns, &temperature.values, lag_ns)
        };
        let differences: Vec<Vec<f64>> = bias.recordings.iter().map(of).collect();
        self.blocks.iter().map(|block| mean(&differences[block.recording][block.bins.clone()])).collect()
    }
}

impl Bias {
    fn new(
        recordings: &[RampRecording],
        blocks: &[Block],
        kind: SensorKind,
        axis: usize,
        coefficients: &Axis,
        curves: CurveSource,
    ) -> Result<Self, TransientsError> {
        let mut bias = Self {
            kind,
            axis,
            range: [f64::INFINITY, f64::NEG_INFINITY],
            carried_g0: 0.0,
            carried: Vec::new(),
            temperature: Vec::new(),
            values: Vec::new(),
            outside: Vec::new(),
            plays: Vec::new(),
            recordings: Vec::new(),
        };
        for (number, recording) in recordings.iter().enumerate() {
            let own: Vec<&Block> = blocks.iter().filter(|block| block.recording == number).collect();
            bias.add(recording, &own, coefficients, curves)?;
        }
        let [low, high] = bias.range;
        let changes = high - low > 1e-9 * (high.abs() + low.abs());
        if !changes {
            let name = kind.names()[axis];
            return Err(TransientsError::Recording(format!(
                "the head temperature of {name} does not change; a ramp needs a change of temperature"
            )));
        }
        bias.add_plays(blocks);
        Ok(bias)
    }

    /// Adds a recording with its `blocks`.
    fn add(
        &mut self,
        recording: &RampRecording,
        blocks: &[&Block],
        coefficients: &Axis,
        curves: CurveSource,
    ) -> Result<(), TransientsError> {
        let sensor = self.axis + if self.kind == SensorKind::Gyroscope { AXES } else { 0 };
        debug_assert!(sensor < SENSORS);
        let times_ns: Vec<_> = recording.bins().iter().map(super::recording::Bin::middle_ns).collect();
        let (heads, boards) = readings(recording, sensor, self.kind.names()[self.axis])?;
        let head = interpolated(&heads, &times_ns);
        let board = interpolated(&boards, &times_ns);
        let values = indicated(recording, sensor, coefficients, curves, &head, &board);
        let means_of =
            |values: &[f64]| blocks.iter().map(|block| mean(&values[block.bins.clone()])).collect::<Vec<_>>();
        let (means, heads_of_blocks) = (means_of(&values), means_of(&head));
        let centre = mean(&means);
        self.carried.push(if self.kind == SensorKind::Accelerometer { centre } else { 0.0 });
        self.carried_g0 = self.carried.iter().fold(0.0, |most, force| force.abs().max(most));
        self.values.extend(means.iter().map(|value| value - centre));
        let places = heads_of_blocks.iter().zip(means_of(&board));
        self.outside.extend(places.map(|(head, board)| outside(coefficients, curves, *head, board)));
        self.temperature.extend(heads_of_blocks);
        let [low, high] = range_of(&heads.iter().map(|reading| reading.temperature).collect::<Vec<_>>());
        self.range = [self.range[0].min(low), self.range[1].max(high)];
        self.recordings.push(Temperature { readings: heads, times_ns, values: head });
        Ok(())
    }

    /// The plays' columns (z - U)/w. Each recording begins in the middle of the play.
    fn add_plays(&mut self, blocks: &[Block]) {
        let [low, high] = self.range;
        let by_recording: Vec<[Vec<f64>; PLAYS.len()]> = self
            .recordings
            .iter()
            .map(|temperature| {
                PLAYS.map(|part| {
                    let half_width = part * (high - low);
                    let mut z = temperature.values[0];
                    let column = |u: &f64| {
                        z = z.max(u - half_width).min(u + half_width);
                        (z - u) / half_width
                    };
                    temperature.values.iter().map(column).collect()
                })
            })
            .collect();
        let of = |block: &Block| {
            let plays = &by_recording[block.recording];
            core::array::from_fn(|play| mean(&plays[play][block.bins.clone()]))
        };
        self.plays = blocks.iter().map(of).collect();
    }
}

/// Head and board temperature of a sensor in a recording.
fn readings(
    recording: &RampRecording,
    sensor: usize,
    name: &str,
) -> Result<(Vec<Reading>, Vec<Reading>), TransientsError> {
    let (heads, boards) = (recording.heads(sensor), recording.boards(sensor));
    for (part, readings) in [("head", &heads), ("board", &boards)] {
        // Bad rows were left out of a stretch before, and its noise is a larger part of its range.
        let spike = spike(readings, recording.step_of_temperature()).filter(|_| !recording.is_stretch());
        if let Some(Reading { temperature, time_ns }) = spike {
            return Err(TransientsError::Recording(format!(
                "{}: the {part} temperature of {name} is {temperature} at {time_ns} ns, unlike the readings before and after it: a broken reading; leave \
                 its rows out",
                recording.name()
            )));
        }
    }
    if heads.is_empty() || boards.is_empty() {
        return Err(TransientsError::Recording(format!("{}: no temperature", recording.name())));
    }
    Ok((heads, boards))
}

/// What a sensor indicates in each bin, less the campaign's curve.
pub(super) fn indicated(
    recording: &RampRecording,
    sensor: usize,
    coefficients: &Axis,
    curves: CurveSource,
    head: &[f64],
    board: &[f64],
) -> Vec<f64> {
    let of_bin = |(bin, (head, board)): (&super::recording::Bin, (&f64, &f64))| {
        let [positive, negative] = bin.rates(sensor);
        let (k_plus, k_minus) = (&coefficients.positive_scale_factor, &coefficients.negative_scale_factor);
        let curve = match curves {
            CurveSource::Campaign => coefficients.bias_at(*head).0,
            CurveSource::Ramps => 0.0,
        };
        positive / k_plus.at(*board) + negative / k_minus.at(*board) - curve
    };
    recording.bins().iter().zip(head.iter().zip(board)).map(of_bin).collect()
}

/// Whether a curve of the table does not reach this temperature.
fn outside(coefficients: &Axis, curves: CurveSource, head: f64, board: f64) -> bool {
    curves == CurveSource::Campaign && beyond(&coefficients.bias, head)
        || beyond(&coefficients.positive_scale_factor, board)
        || beyond(&coefficients.negative_scale_factor, board)
}

/// Whether the temperature is beyond the range of a polynomial by more than 2 % of it: so far the polynomial goes on,
/// and a constant goes on everywhere.
fn beyond(polynomial: &Polynomial, temperature: f64) -> bool {
    let [low, high] = polynomial.range();
    let margin = BEYOND * (high - low);
    polynomial.coefficients().len() > 1 && !(low - margin..=high + margin).contains(&temperature)
}

/// Chebyshev polynomials of order 1, 2 and 3.
fn chebyshev(x: f64) -> [f64; CURVE] {
    [x, 2.0 * x * x - 1.0, (4.0 * x * x - 3.0) * x]
}

fn duration_s(recording: &RampRecording) -> f64 {
    let bins = recording.bins();
    bins.first().zip(bins.last()).map_or(0.0, |(first, last)| (last.end_ns - first.begin_ns) as f64 / 1e9)
}

/// Length of a block \[s\]: a multiple of the bins' usual length.
fn block_s(recording: &RampRecording) -> f64 {
    let mut lengths: Vec<f64> = recording.bins().iter().map(|bin| (bin.end_ns - bin.begin_ns) as f64 / 1e9).collect();
    let bin_s = median(&mut lengths).max(1e-3);
    let duration_s = duration_s(recording);
    let least = (duration_s / BLOCKS as f64).max(LEAST_BLOCK_S.min(duration_s / SHORT_BLOCKS));
    (least / bin_s - 1e-9).ceil() * bin_s
}

fn blocks_of(number: usize, recording: &RampRecording) -> Result<Vec<Block>, TransientsError> {
    let bins = recording.bins();
    let (length_s, duration_s) = (block_s(recording), duration_s(recording));
    let Some(first) = bins.first() else {
        return Err(TransientsError::Recording(format!("{}: no rows", recording.name())));
    };
    let age_s = |bin: &super::recording::Bin| (bin.middle_ns() - first.begin_ns) as f64 / 1e9;
    let mut blocks = Vec::new();
    let mut begin = 0;
    while begin < bins.len() {
        let index = (age_s(&bins[begin]) / length_s).floor();
        let count = bins[begin..].iter().take_while(|bin| (age_s(bin) / length_s).floor() == index).count();
        let own = begin..begin + count;
        begin += count;
        // The piece before a gap, and the last one, may be too short for a mean.
        if bins[own.clone()].iter().map(super::recording::Bin::seconds).sum::<f64>() < 0.5 * length_s {
            continue;
        }
        let age_s = mean(&bins[own.clone()].iter().map(age_s).collect::<Vec<_>>());
        blocks.push(Block {
            recording: number,
            age_s,
            time: 2.0 * age_s / duration_s - 1.0,
            bins: own,
            left_out: false,
            unsoaked: false,
        });
    }
    if blocks.len() < FEWEST_BLOCKS {
        let message = format!(
            "{}: {duration_s:.0} s give {} means of a second or a row, and {} of them in blocks without a gap; {FEWEST_BLOCKS} are needed at \
             least: record for longer, or with more rows",
            recording.name(),
            bins.len(),
            blocks.len()
        );
        return Err(TransientsError::Recording(message));
    }
    Ok(blocks)
}

/// A reading that goes away from both neighbours, to the same side, by more than a part of the usual range, and than a
/// coarse thermometer does by chance.
fn spike(readings: &[Reading], step: f64) -> Option<Reading> {
    let mut sorted: Vec<f64> = readings.iter().map(|reading| reading.temperature).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |part: usize| sorted.get(sorted.len() * part / 20).copied();
    let limit = (SPIKE * (at(19)? - at(1)?)).max(STEPS * step);
    let middle = |three: &[Reading]| {
        let [before, here, after] = [0, 1, 2].map(|i| three[i].temperature);
        let away = (here - before).min(here - after).max((before - here).min(after - here));
        (limit > 0.0 && away > limit).then_some(three[1])
    };
    readings.windows(3).find_map(middle)
}

/// Usual time between two readings \[s\].
fn temperature_interval_s(readings: &[Reading]) -> f64 {
    let mut steps: Vec<f64> =
        readings.windows(2).map(|pair| (pair[1].time_ns - pair[0].time_ns) as f64 / 1e9).collect();
    median(&mut steps)
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn range_of(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(*value), high.max(*value)])
}
