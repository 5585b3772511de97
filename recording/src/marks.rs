//! Whether two recordings have rows in common, whatever their files are called and however they are cut.
//!
//! Rows in turn have a hash of their pulses, temperature, intervals and steps of time, if their pulses vary: the
//! accelerometers give at least eight different readings. A recording is marked by the least of the hashes of all its
//! windows. Those of a part are among those of the whole, as far as they lie in it.

use isotherm_shared::wire::RawSample;
use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::fmt;

/// Rows of a window that marks a recording.
const MARK_ROWS: usize = 32;
/// Marks of a recording.
const MARKS: usize = 24;
/// Least different readings in a window.
const VARIED: usize = 8;
/// Marks in common that no chance gives.
const COMMON: usize = 2;
/// Rows in turn that are the same in two recordings, at most …
const ROWS: usize = 1000;
/// Base of the polynomial over the hashes of the rows.
const BASE: u64 = 0x9e37_79b9_7f4a_7c15;

/// The marks of a recording, at most 24.
///
/// ```
/// use isotherm_recording::Marks;
/// use isotherm_shared::wire::RawSample;
///
/// let row = |n: u64| {
///     let mut row = RawSample { timestamp_ns: n * 1_000_000, interval_ns: 1_000_000, ..RawSample::default() };
///     row.accelerometers.positive_pulses = [(n * n % 97) as u32, (n * n % 89) as u32, 1000];
///     row
/// };
/// let whole: Marks = (0..2000).map(row).collect();
/// assert!(whole.share_rows_with(&(700..1300).map(row).collect()));
/// assert!(!whole.share_rows_with(&(2000..4000).map(row).collect()));
/// assert_eq!(whole.to_string().parse(), Ok(whole));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Marks {
    window: Window,
    least: BTreeSet<u64>,
}

/// The last rows of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
struct Window {
    /// Hashes of each row, and of only its pulses.
    rows: VecDeque<[u64; 2]>,
    hash: u64,
    /// How often each reading is in the window.
    readings: HashMap<u64, usize>,
    last_ns: Option<u64>,
}

/// A good mixture of the bits (splitmix64).
const fn mixed(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

fn hash(values: impl IntoIterator<Item = u64>) -> u64 {
    values.into_iter().fold(BASE, |hash, value| mixed(hash.wrapping_mul(BASE) ^ mixed(value.wrapping_add(BASE))))
}

impl Window {
    /// Takes a row. The hash of the last `width` rows, if there are as many and they vary.
    fn add(&mut self, row: &RawSample, width: usize) -> Option<u64> {
        let triad = &row.accelerometers;
        let pulses = hash(triad.positive_pulses.iter().chain(&triad.negative_pulses).map(|count| u64::from(*count)));
        let temperature = triad.head_temperature.iter().chain(&triad.board_temperature).map(|value| value.to_bits());
        let step_ns = self.last_ns.replace(row.timestamp_ns).map_or(0, |last| row.timestamp_ns.wrapping_sub(last));
        let of_row = hash([pulses, row.interval_ns, step_ns].into_iter().chain(temperature));
        self.hash = self.hash.wrapping_mul(BASE).wrapping_add(of_row);
        self.rows.push_back([of_row, pulses]);
        *self.readings.entry(pulses).or_default() += 1;
        if self.rows.len() > width
            && let Some([of_row, pulses]) = self.rows.pop_front()
        {
            let lead = BASE.wrapping_pow(u32::try_from(width).unwrap_or(u32::MAX));
            self.hash = self.hash.wrapping_sub(of_row.wrapping_mul(lead));
            if let Some(count) = self.readings.get_mut(&pulses) {
                *count -= 1;
                if *count == 0 {
                    self.readings.remove(&pulses);
                }
            }
        }
        (self.rows.len() == width && self.readings.len() >= VARIED).then(|| mixed(self.hash))
    }
}

impl Marks {
    /// Takes the next row.
    pub fn add(&mut self, row: &RawSample) {
        let Some(hash) = self.window.add(row, MARK_ROWS) else { return };
        self.least.insert(hash);
        if self.least.len() > MARKS {
            self.least.pop_last();
        }
    }

    /// Whether there are rows in both.
    #[must_use]
    pub fn share_rows_with(&self, other: &Self) -> bool {
        self.least.intersection(&other.least).count() >= COMMON
    }
}

impl FromIterator<RawSample> for Marks {
    fn from_iter<T: IntoIterator<Item = RawSample>>(rows: T) -> Self {
        let mut marks = Self::default();
        rows.into_iter().for_each(|row| marks.add(&row));
        // Two recordings with the same marks are equal.
        Self { window: Window::default(), ..marks }
    }
}

/// 16 hexadecimal digits for each.
impl fmt::Display for Marks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.least.iter().try_for_each(|mark| write!(f, "{mark:016x}"))
    }
}

impl std::str::FromStr for Marks {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "marks are 16 hexadecimal digits each".to_owned();
        let digits = text.as_bytes().chunks(16).map(|digits| {
            let digits = str::from_utf8(digits).ok().filter(|digits| digits.len() == 16).ok_or_else(wrong)?;
            u64::from_str_radix(digits, 16).map_err(|_| wrong())
        });
        Ok(Self { window: Window::default(), least: digits.collect::<Result<_, _>>()? })
    }
}

/// Whether 1000 rows in turn, or half of the shorter recording, are in both: equal in pulses, temperature and steps of
/// time. Rows whose pulses hardly vary show nothing.
#[must_use]
pub fn share_rows(one: &[RawSample], other: &[RawSample]) -> bool {
    let width = ROWS.min(one.len().min(other.len()) / 2).max(VARIED);
    let (mut window, mut again) = (Window::default(), Window::default());
    let known: HashSet<u64> = one.iter().filter_map(|row| window.add(row, width)).collect();
    other.iter().any(|row| again.add(row, width).is_some_and(|hash| known.contains(&hash)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(seed: u64, count: u64) -> Vec<RawSample> {
        let row = |n: u64| {
            let mut row = RawSample { timestamp_ns: n * 10_000_000, interval_ns: 10_000_000, ..RawSample::default() };
            let noise = |axis: u64| 900 + (mixed(seed ^ (n << 8) ^ axis) % 30) as u32;
            row.accelerometers.positive_pulses = [noise(0), noise(1), noise(2)];
            row.accelerometers.head_temperature = [25.0; 3];
            row
        };
        (1..=count).map(row).collect()
    }

    fn later(rows: &[RawSample]) -> Vec<RawSample> {
        rows.iter().map(|row| RawSample { timestamp_ns: row.timestamp_ns + 77, sequence: 9, ..*row }).collect()
    }

    #[test]
    fn parts_and_copies_at_another_time_share_rows_and_other_recordings_do_not() {
        let (one, two) = (rows(1, 5000), rows(2, 5000));
        let marks = |rows: &[RawSample]| rows.iter().copied().collect::<Marks>();
        for part in [&later(&one)[..], &one[1700..], &later(&one[..2600]), &[&two[..], &one[..]].concat()] {
            assert!(share_rows(&one, part) && marks(&one).share_rows_with(&marks(part)));
        }
        assert!(!share_rows(&one, &two) && !marks(&one).share_rows_with(&marks(&two)));
        // 990 rows in common are no 1000, and 60 of 100 are half.
        assert!(!share_rows(&one, &[&two[..2000], &one[..990]].concat()));
        assert!(share_rows(&one[..100], &[&one[20..80], &two[..40]].concat()));
        assert!(!share_rows(&[], &one) && marks(&[]).to_string().is_empty());
    }

    #[test]
    fn counts_that_hardly_vary_show_nothing() {
        let quiet = |rows: Vec<RawSample>| -> Vec<RawSample> {
            let mut rows = rows;
            rows.iter_mut()
                .for_each(|row| row.accelerometers.positive_pulses = [7 + u32::from(row.sequence % 2 == 0); 3]);
            rows
        };
        let (one, two) = (quiet(rows(1, 3000)), quiet(rows(2, 3000)));
        assert!(!share_rows(&one, &two) && one.into_iter().collect::<Marks>().to_string().is_empty());
        assert!("0123".parse::<Marks>().is_err() && "zz23456789abcdef".parse::<Marks>().is_err());
    }
}
