//! A recording bin by bin, and stretches of its bins.

use crate::transients::RampRecording;
use core::ops::Range;
use isotherm_shared::wire::AXES;

/// Temperature that no stretch can do without, as a part of the span of all.
const ENDS: f64 = 0.02;

/// A recording, bin by bin: a second, or a row if rows are longer.
pub(super) struct Bins {
    /// Middle of each bin since the recording began \[s\].
    pub ages: Vec<f64>,
    /// Head temperature of A1.
    pub temperature: Vec<f64>,
    /// Net rates of A1, A2, A3 and, where there are gyroscopes, G1, G2, G3 \[pulse/s\].
    pub rates: Vec<Vec<f64>>,
    /// Variance of a row within each bin \[pulse2/s2\], of the same; `None` of few rows.
    pub variances: Vec<Vec<Option<f64>>>,
    /// Step of the values of the same \[pulse/s\].
    pub steps: Vec<f64>,
}

impl Bins {
    pub(super) fn of(recording: &RampRecording) -> Self {
        let sensors = if recording.has_gyroscopes() { 2 * AXES } else { AXES };
        let (bins, begin_ns) = (recording.bins(), recording.times_of(&(0..recording.bins().len())).start);
        let net = |sensor: usize| bins.iter().map(|bin| bin.net_rate(sensor)).collect();
        Self {
            ages: bins.iter().map(|bin| (bin.middle_ns() - begin_ns) as f64 / 1e9).collect(),
            temperature: recording.temperature_of_bins(),
            rates: (0..sensors).map(net).collect(),
            variances: (0..sensors).map(|sensor| bins.iter().map(|bin| bin.variance(sensor)).collect()).collect(),
            steps: (0..sensors).map(|sensor| recording.step(sensor)).collect(),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.ages.len()
    }
}

/// Bins in turn that are used together, without what is left out between them.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    pub bins: Vec<usize>,
    /// Whether it begins with a bump, and how large it is \[rad\].
    pub bump_rad: Option<f64>,
}

impl Stretch {
    /// The span of temperature that it covers, without the outermost readings.
    pub(super) fn span(&self, bins: &Bins) -> f64 {
        let mut all: Vec<f64> = self.bins.iter().map(|bin| bins.temperature[*bin]).collect();
        all.sort_by(f64::total_cmp);
        let cut = (all.len() as f64 * ENDS / 2.0) as usize;
        let [low, high] = [all.get(cut), all.len().checked_sub(cut + 1).and_then(|last| all.get(last))];
        high.zip(low).map_or(0.0, |(high, low)| high - low)
    }

    /// The ranges of bins without a hole.
    pub(super) fn ranges(&self) -> Vec<Range<usize>> {
        let mut ranges: Vec<Range<usize>> = Vec::new();
        for bin in &self.bins {
            match ranges.last_mut() {
                Some(range) if range.end == *bin => range.end += 1,
                _ => ranges.push(*bin..bin + 1),
            }
        }
        ranges
    }
}
