//! StaticPoses: the parts of a recording in which the IMU was at rest, found only from its counts.
//!
//! A window of W rows is at rest if it is as quiet as the quietest lasting level of the recording, and if at that level
//! averaging helps: the means of neighbouring windows differ by far less than the rows within them. Movement fails the
//! second at every level, so that no noise has to be known beforehand.
//!
//! ```text
//! S = mean over the axes of ln max(variance, step^2/4),    m: half-sample mode of S,    s: its spread below
//! R = Allan variance of the means / variance within, over |S - m| <= max(2 s, 0.1):    1/W for white noise
//! at rest: R < 0.4, otherwise the next lower level: S < m - min(s, 1.5)
//! ```

mod level;
mod windows;

use crate::counts;
use crate::net::steps;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::median;
use isotherm_support::checkpoint::checkpoint;
use level::{Level, norm};
use std::ops::Range;
use windows::{Counts, GAP, Windows};

/// Length of the windows of [`find_static_poses`] \[s\], if no other is asked for.
pub const STATIC_POSE_WINDOW_S: f64 = 0.5;
/// Most R of the level at rest.
const MOST_WANDER: f64 = 0.4;
/// Windows for noise that is correlated over half a second \[s\], and the most R with them.
const LONGER: (f64, f64) = (1.0, 0.3);
/// Windows that are tried for a message where rows are averaged over a second or more \[s\].
const AVERAGED_WINDOW_S: f64 = 1.5;
/// Half the mean squared change from row to row over the variance, 1 for white noise: less where rows are averaged.
const SMOOTH: f64 = 0.3;
/// R over white noise's, and scatter of the means \[rad\]: what scatters so is a hand, no sensor.
const HAND: (f64, f64) = (0.1, 5e-3);
/// Means of two windows at one attitude differ by at most so many standard errors.
const SAME_MEAN: f64 = 5.0;
/// The outermost window of a static pose that differs from its neighbour by more is a movement's.
const EDGE: f64 = 3.0;
/// Least length of a static pose \[s\].
const LEAST_LENGTH_S: f64 = 1.0;
/// A static pose that turns by more from its first to its last third is left out \[rad\] …
const MOST_TURN_RAD: f64 = 5e-3;
/// … if that is so many standard errors.
const SIGNIFICANT: f64 = 5.0;
/// Static poses that usually turn by more are none \[rad\]. Real ones reach 1.5e-3.
const USUAL_TURN_RAD: f64 = 2e-3;
/// Fewest static poses that are judged by their usual turn.
const LEAST_TURNS: usize = 3;

/// A part of a recording in which the IMU was at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticPose {
    /// Its rows; glitches among them are in [`StaticPoses::glitches`].
    pub rows: Range<usize>,
    /// Turn of the specific force from the first to the last third \[rad\]; a change of length is in it.
    pub turn_rad: f64,
    /// The turn over its standard error.
    pub significance: f64,
}

/// What [`find_static_poses`] found.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticPoses {
    /// Rows of a window, W.
    pub window_rows: usize,
    /// The static poses in order of time; each has at least W rows, and a second of them.
    pub found: Vec<StaticPose>,
    /// Static poses that are shorter.
    pub too_short: usize,
    /// Static poses that [`StaticPoses::without_turned`] left out.
    pub turned: usize,
    /// Standard deviation of the counts of a row at rest, of each accelerometer, at least half a step.
    pub noise: [f64; AXES],
    /// Step of the counts of each accelerometer.
    pub steps: [f64; AXES],
    /// Rows, in order, that leave their neighbours by far: they belong into no mean.
    pub glitches: Vec<usize>,
    /// Allan variance of the means of neighbouring windows at rest, over the variance within them, R.
    pub wander: f64,
}

/// Why there are no static poses.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StaticPoseError {
    /// There are no rows.
    #[error("there are no rows; is it the right recording?")]
    Empty,
    /// No two windows follow each other without a pause.
    #[error(
        "{cause}no static pose is found: two windows of {window_rows} rows never follow each other without a pause; record longer, or give a \
         shorter --window"
    )]
    TooFewRows {
        /// Rows of a window.
        window_rows: usize,
        /// What the counts show, or nothing.
        cause: String,
    },
    /// At no level does averaging help.
    #[error(
        "{cause}no static pose is found: over {window_rows} rows, the means wander by {wander:.2} of the rows' variance where they are \
         quietest, at rest by under {most}, and scatter by {:.1} mrad{}", scatter_rad * 1e3, averaged(*longer)
    )]
    NeverAtRest {
        /// Rows of a window.
        window_rows: usize,
        /// Allan variance of the windows' means over the variance within, at the lowest level.
        wander: f64,
        /// The limit.
        most: f64,
        /// Scatter of these means over the specific force \[rad\].
        scatter_rad: f64,
        /// Static poses that are found with longer windows, where the rows are correlated.
        longer: usize,
        /// What the counts show, or nothing.
        cause: String,
    },
    /// The quietest level moves as a whole.
    #[error(
        "{cause}no static pose is found: over {window_rows} rows, the quietest means scatter by {:.1} mrad, at rest by under {:.0} mrad",
        scatter_rad * 1e3, HAND.1 * 1e3
    )]
    Moving {
        /// Rows of a window.
        window_rows: usize,
        /// Scatter of the means over the specific force \[rad\].
        scatter_rad: f64,
        /// What the counts show, or nothing.
        cause: String,
    },
    /// All static poses turn.
    #[error("{poses} static poses are found, but the IMU turns in them, usually by {:.1} mrad, at rest by under {:.0} mrad",
        turn_rad * 1e3, USUAL_TURN_RAD * 1e3)]
    Turning {
        /// Static poses.
        poses: usize,
        /// Their median turn from the first to the last third \[rad\].
        turn_rad: f64,
    },
    /// There is none of the length that is needed.
    #[error("none of the {} static poses can be used: {too_short} are under {least_s:.1} s long without their ends, in {turned} the IMU turned", too_short + turned)]
    TooShort {
        /// Static poses that are too short.
        too_short: usize,
        /// Static poses in which the IMU turned.
        turned: usize,
        /// Least length \[s\].
        least_s: f64,
    },
}

/// The stretches of `rows` without a gap: no row comes later than 1.5 intervals after the row before, and the session
/// is the same.
#[must_use]
pub fn stretches(rows: &[RawSample]) -> Vec<Range<usize>> {
    let breaks = |pair: &[RawSample]| {
        let passed = pair[1].timestamp_ns.saturating_sub(pair[0].timestamp_ns) as f64;
        pair[1].session != pair[0].session || passed > GAP * pair[1].interval_ns as f64
    };
    let starts = rows.windows(2).enumerate().filter(|(_, pair)| breaks(pair)).map(|(i, _)| i + 1);
    let starts: Vec<usize> = core::iter::once(0).chain(starts).chain([rows.len()]).collect();
    starts.windows(2).map(|ends| ends[0]..ends[1]).filter(|rows| !rows.is_empty()).collect()
}

/// Begin of each row after that of the first one \[ns\]. A new session has a new clock; its rows follow those before
/// without a pause.
#[must_use]
pub fn begins_ns(rows: &[RawSample]) -> Vec<u64> {
    let mut begins = Begins::default();
    rows.iter().map(|row| begins.next_ns(row)).collect()
}

/// The begins of rows, as [`begins_ns`] gives them, row by row.
#[derive(Clone, Copy, Debug, Default)]
pub struct Begins {
    offset_ns: i128,
    /// Session and stamp of the row before.
    before: Option<(u64, u64)>,
}

impl Begins {
    /// The begin of the next row after that of the first one \[ns\].
    pub fn next_ns(&mut self, row: &RawSample) -> u64 {
        let begin_ns = i128::from(row.timestamp_ns) - i128::from(row.interval_ns);
        match self.before {
            None => self.offset_ns = -begin_ns,
            Some((session, timestamp_ns)) if session != row.session => {
                self.offset_ns += i128::from(timestamp_ns) - begin_ns;
            }
            Some(_) => {}
        }
        self.before = Some((row.session, row.timestamp_ns));
        u64::try_from(begin_ns + self.offset_ns).unwrap_or_default()
    }
}

/// Finds the static poses of a recording, with windows of `window_s` seconds, at least five rows. Without it windows
/// have [`STATIC_POSE_WINDOW_S`], or twice as much where the noise is correlated over them.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_campaign::find_static_poses;
/// use isotherm_shared::wire::RawSample;
///
/// // 10 samples a second: 20 s at rest on A3, 5 s of movement, 20 s at rest on A1. Noise of a few counts.
/// let row = |i: u64| {
///     let mut raw = RawSample { sequence: i, timestamp_ns: (i + 1) * 100_000_000, ..RawSample::default() };
///     raw.interval_ns = 100_000_000;
///     let noise = |axis: u64| 20 + (i * (7 + axis) * 2_654_435_761 >> 16) as u32 % 7;
///     raw.accelerometers.positive_pulses = [noise(0), noise(1), noise(2)];
///     let moving = (200..250).contains(&i);
///     let swing = if moving { (i as u32 * 397) % 1500 } else { 0 };
///     raw.accelerometers.positive_pulses[if i < 225 { 2 } else { 0 }] += 2000 - swing;
///     raw
/// };
/// let rows: Vec<_> = (0..450).map(row).collect();
/// let poses = find_static_poses(&rows, None)?;
/// assert_eq!((poses.window_rows, poses.found.len()), (10, 2));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If no two windows follow each other, if the IMU was never at rest, or if no static pose is long enough.
pub fn find_static_poses(rows: &[RawSample], window_s: Option<f64>) -> Result<StaticPoses, StaticPoseError> {
    if rows.is_empty() {
        return Err(StaticPoseError::Empty);
    }
    let (windows, level) = quietest(rows, window_s)?;
    let window_rows = windows.window_rows;
    let scatter_rad = level.scatter_rad(&windows);
    if level.wander > 1.0 / window_rows as f64 + HAND.0 && scatter_rad > HAND.1 {
        return Err(StaticPoseError::Moving { window_rows, scatter_rad, cause: counts::cause(rows) });
    }
    checkpoint();
    let least = windows.window_rows.max((LEAST_LENGTH_S * 1e9 / windows.interval_ns).round() as usize);
    let pieces = windows.runs(&level.at_rest(&windows), level.allan);
    let pieces: Vec<_> = pieces.into_iter().map(|run| windows.without_ends(run, level.allan)).collect();
    let long = pieces.iter().filter(|piece| piece.len() >= least);
    let found: Vec<_> = long.map(|piece| windows.pose(piece.clone(), level.allan)).collect();
    let too_short = pieces.len() - found.len();
    if found.is_empty() {
        let least_s = least as f64 * windows.interval_ns / 1e9;
        return Err(StaticPoseError::TooShort { too_short, turned: 0, least_s });
    }
    Ok(StaticPoses {
        window_rows,
        found,
        too_short,
        turned: 0,
        noise: level.variance.map(f64::sqrt),
        steps: steps(rows),
        glitches: windows.glitches,
        wander: level.wander,
    })
}

/// The windows and the level at rest: first without windows that do not change, which may be frozen.
fn quietest(rows: &[RawSample], window_s: Option<f64>) -> Result<(Windows, Level), StaticPoseError> {
    let usual = [(STATIC_POSE_WINDOW_S, MOST_WANDER), LONGER];
    let asked = window_s.map(|window_s| [(window_s, MOST_WANDER)]);
    let (mut window_rows, mut lowest) = (0, None);
    for &(window_s, most) in asked.as_ref().map_or(&usual[..], |asked| asked) {
        let windows = Windows::new(rows, window_s);
        for live_alone in [true, false] {
            checkpoint();
            match Level::quietest(&windows, live_alone, most) {
                Ok(level) => return Ok((windows, level)),
                Err(level) => {
                    lowest = level
                        .map(|level| (windows.window_rows, most, level.wander, level.scatter_rad(&windows)))
                        .or(lowest);
                }
            }
        }
        window_rows = windows.window_rows;
    }
    let cause = counts::cause(rows);
    let Some((window_rows, most, wander, scatter_rad)) = lowest else {
        return Err(StaticPoseError::TooFewRows { window_rows, cause });
    };
    let longer = if window_s.is_none() { averaged_poses(rows) } else { 0 };
    Err(StaticPoseError::NeverAtRest { window_rows, wander, most, scatter_rad, longer, cause })
}

/// Static poses that are found with windows of 1.5 s, where the rows are averaged or filtered: neighbours differ by far
/// less than the rows of a window scatter.
fn averaged_poses(rows: &[RawSample]) -> usize {
    let windows = Windows::new(rows, AVERAGED_WINDOW_S);
    let smooth = |level: &Level| level.roughness(&windows) < SMOOTH;
    if !Level::quietest(&windows, true, LONGER.1).is_ok_and(|level| smooth(&level)) {
        return 0;
    }
    let found = find_static_poses(rows, Some(AVERAGED_WINDOW_S)).and_then(StaticPoses::without_turned);
    found.map_or(0, |poses| poses.found.len())
}

fn averaged(poses: usize) -> String {
    if poses == 0 {
        return String::new();
    }
    format!(
        "; neighbouring rows are alike, as averaged or filtered ones are: --window {AVERAGED_WINDOW_S} finds {poses} static poses"
    )
}

impl StaticPoses {
    /// Rows of a static pose without glitches.
    pub fn rows<'a>(&'a self, rows: &'a [RawSample], of: Range<usize>) -> impl Iterator<Item = &'a RawSample> {
        let first = self.glitches.partition_point(|row| *row < of.start);
        let mut glitches = self.glitches[first..].iter().peekable();
        of.filter(move |row| glitches.next_if(|glitch| *glitch == row).is_none()).map(|row| &rows[row])
    }

    /// Leaves out those in which the IMU turned, where the length of the mean is wanted: a turn by theta makes it
    /// theta^2/24 too short.
    ///
    /// # Errors
    /// If the IMU usually turned, or if none is left.
    pub fn without_turned(mut self) -> Result<Self, StaticPoseError> {
        let n = self.found.len();
        let squares = self.found.iter().map(|pose| pose.significance.powi(2)).sum::<f64>() / n as f64;
        let turn_rad = median(self.found.iter().map(|pose| pose.turn_rad));
        // Chi-square with 3 n degrees of freedom, at rest.
        let by_chance = 3.0 + 3.0 * (6.0 / n as f64).sqrt();
        if n >= LEAST_TURNS && squares > by_chance && turn_rad > USUAL_TURN_RAD {
            return Err(StaticPoseError::Turning { poses: n, turn_rad });
        }
        self.found.retain(|pose| !pose.has_turned());
        self.turned += n - self.found.len();
        match self.found.is_empty() {
            true => Err(StaticPoseError::TooShort {
                too_short: self.too_short,
                turned: self.turned,
                least_s: LEAST_LENGTH_S,
            }),
            false => Ok(self),
        }
    }
}

impl StaticPose {
    fn has_turned(&self) -> bool {
        self.turn_rad > MOST_TURN_RAD && self.significance > SIGNIFICANT
    }
}

impl Windows {
    /// First and last window of each run at rest. A false alarm between two of one mean is passed over, and windows
    /// that lack rows, which say nothing.
    fn runs(&self, at_rest: &[bool], allan: Counts) -> Vec<[usize; 2]> {
        let mut runs: Vec<[usize; 2]> = Vec::new();
        for window in (0..at_rest.len()).filter(|window| at_rest[*window]) {
            let goes_on = |last: usize| {
                let lacking = (last + 1..window).filter(|between| !self.whole[*between]).count();
                let near = window - last - lacking <= self.window_rows && self.are_together(last, window);
                window == last + 1 || (near && !self.differ(last, window, SAME_MEAN, allan))
            };
            match runs.last_mut() {
                Some([_, last]) if goes_on(*last) => *last = window,
                _ => runs.push([window, window]),
            }
        }
        runs
    }

    /// The rows of a run, numbered without glitches, less what may belong to a movement before or after it: half a
    /// window, and more while the outermost window differs from its neighbour.
    fn without_ends(&self, [first, last]: [usize; 2], allan: Counts) -> Range<usize> {
        let (n, cut) = (self.window_rows, self.window_rows / 2);
        let before = first.checked_sub(1).is_some_and(|window| self.whole[window]);
        let after = self.whole.get(last + 1).is_some_and(|whole| *whole);
        let mut start = first + if before { cut } else { 0 };
        let mut end = last + n - if after { cut } else { 0 };
        while before && end >= start + 2 * n && self.differ(start, start + n, EDGE, allan) {
            start += cut;
        }
        while after && end >= start + 2 * n && self.differ(end - n, end - 2 * n, EDGE, allan) {
            end -= cut;
        }
        start..end
    }

    /// A static pose of rows that are numbered without glitches.
    fn pose(&self, piece: Range<usize>, allan: Counts) -> StaticPose {
        let third = (piece.len() / 3).max(1);
        let [first, last] =
            [piece.start..piece.start + third, piece.end - third..piece.end].map(|part| self.mean(part));
        let difference = [0, 1, 2].map(|axis| last[axis] - first[axis]);
        let error = |axis: usize| 2.0 * allan[axis] * self.window_rows as f64 / third as f64;
        StaticPose {
            turn_rad: norm(difference) / norm(self.mean(piece.clone())),
            significance: (0..AXES).map(|axis| difference[axis].powi(2) / error(axis)).sum::<f64>().sqrt(),
            rows: self.rows[piece.start]..self.rows[piece.end - 1] + 1,
        }
    }
}
