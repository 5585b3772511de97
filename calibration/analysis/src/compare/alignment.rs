//! The difference of two alignment matrices.

use super::curves::welch;
use super::requirement::Compliance;
use super::table::Form;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{f_limit, largest};

/// Probability that any misalignment counts as changed where none has. It is shared among those of both triads.
const FALSE_ALARM: f64 = 0.05;
/// Misalignments of a triad.
const MISALIGNMENTS: f64 = 6.0;

/// The difference of the alignment matrices of one triad: new less old.
#[derive(Clone, Debug, PartialEq)]
pub struct AlignmentComparison {
    /// Accelerometers or gyroscopes.
    pub kind: SensorKind,
    /// Row by row \[1e-6 rad\].
    pub difference_urad: [[f64; AXES]; AXES],
    /// Half the width of the band of each entry \[1e-6 rad\], if both tables have the errors of the misalignments. The
    /// bands of all triads hold the true differences, six a triad, at once with 95 %, by Student's t with Welch's
    /// degrees of freedom.
    pub half_width_urad: Option<[[f64; AXES]; AXES]>,
}

impl AlignmentComparison {
    /// Compares the matrices of one of `triads`.
    pub(super) fn of(kind: SensorKind, [old, new]: [&Form; 2], triads: usize) -> Self {
        let (triad, first) = match kind {
            SensorKind::Accelerometer => (0, 0),
            SensorKind::Gyroscope => (1, AXES),
        };
        let difference = (new.alignment[triad] - old.alignment[triad]) * 1e6;
        let half_width = |i: usize, j: usize| {
            let errors = [old, new].map(|form| Some(form.alignment_error[triad]?[(i, j)]));
            let variances = [errors[0]?, errors[1]?].map(|error| error * error);
            if variances == [0.0; 2] {
                return Some(0.0);
            }
            // A misalignment has the degrees of freedom of its sensor's curves. Where a table has no matrix its error
            // is 0, and they do not count.
            let freedom = |form: &Form| form.curves[first + i][0].freedom();
            let freedom = match variances {
                [0.0, _] => freedom(new)?,
                [_, 0.0] => freedom(old)?,
                both => welch(both, [freedom(old)?, freedom(new)?]),
            };
            // t squared is F with 1 and n degrees of freedom.
            let quantile = f_limit(FALSE_ALARM / (MISALIGNMENTS * triads as f64), 1.0, freedom).sqrt();
            Some(quantile * (variances[0] + variances[1]).sqrt() * 1e6)
        };
        let row = |i: usize| Some([half_width(i, 0)?, half_width(i, 1)?, half_width(i, 2)?]);
        let half_width_urad = || Some([row(0)?, row(1)?, row(2)?]);
        Self {
            kind,
            // Adding 0 turns -0 into 0.
            difference_urad: [0, 1, 2].map(|i| [0, 1, 2].map(|j| difference[(i, j)] + 0.0)),
            half_width_urad: half_width_urad(),
        }
    }

    /// Name of the triad.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self.kind {
            SensorKind::Accelerometer => "accelerometers",
            SensorKind::Gyroscope => "gyroscopes",
        }
    }

    /// Size of the largest entry \[1e-6 rad\].
    #[must_use]
    pub fn largest_urad(&self) -> f64 {
        largest(self.difference_urad.iter().flatten().map(|entry| entry.abs()))
    }

    /// The most that an entry can be, by its band \[1e-6 rad\].
    #[must_use]
    pub fn upper_urad(&self) -> Option<f64> {
        Some(largest(self.sizes()?.map(|(size, half)| size + half)))
    }

    /// What an entry is at least, by its band \[1e-6 rad\]; 0 if all may be 0.
    #[must_use]
    pub fn lower_urad(&self) -> Option<f64> {
        Some(largest(self.sizes()?.map(|(size, half)| size - half)))
    }

    /// Whether an entry next to the diagonal is outside of its band; `None` without errors. What is on the diagonal
    /// follows from the others.
    #[must_use]
    pub fn is_changed(&self) -> Option<bool> {
        let beside = |(index, (size, half)): (usize, (f64, f64))| index % (AXES + 1) != 0 && size > half;
        Some(self.sizes()?.enumerate().any(beside))
    }

    /// Whether all entries are within a bound \[1e-6 rad\]. Without errors the values decide.
    #[must_use]
    pub fn verdict(&self, bound_urad: f64) -> Compliance {
        let largest = self.largest_urad();
        Compliance::of(self.lower_urad().unwrap_or(largest), self.upper_urad().unwrap_or(largest), bound_urad)
    }

    /// Size and half width of each entry.
    fn sizes(&self) -> Option<impl Iterator<Item = (f64, f64)>> {
        let halves = self.half_width_urad.as_ref()?.iter().flatten();
        Some(self.difference_urad.iter().flatten().zip(halves).map(|(entry, half)| (entry.abs(), *half)))
    }
}
