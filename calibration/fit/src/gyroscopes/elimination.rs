//! The elimination of the components of Earth's rate that nobody knows.

use super::model::GyroscopeModel;
use isotherm_shared::wire::AXES;
use isotherm_statistics::MAX_SVD_STEPS;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

impl GyroscopeModel<'_> {
    /// The projectors off the components that nobody knows, each with its runs.
    pub(super) fn eliminations(&self, counted: &[bool]) -> Option<Vec<(Vec<usize>, DMatrix<f64>)>> {
        let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (index, run) in self.runs.iter().enumerate().filter(|(index, _)| counted[*index]) {
            if let Some(group) = run.group {
                groups.entry(group).or_default().push(index);
            }
        }
        groups
            .into_values()
            .map(|runs| {
                let projector = self.projector(&runs)?;
                Some((runs, projector))
            })
            .collect()
    }

    /// The projector of the rows of `runs` off the components of Earth's rate that they share.
    fn projector(&self, runs: &[usize]) -> Option<DMatrix<f64>> {
        let mut numbers: Vec<usize> =
            runs.iter().flat_map(|run| self.runs[*run].horizontal.iter().map(|(number, _)| *number)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let mut matrix: DMatrix<f64> = DMatrix::zeros(AXES * runs.len(), numbers.len());
        for (i, index) in runs.iter().enumerate() {
            let run = &self.runs[*index];
            for (number, direction) in &run.horizontal {
                let column = numbers.binary_search(number).ok()?;
                let angle = self.operators[*index] * direction / run.seconds.sqrt();
                for axis in 0..AXES {
                    matrix[(AXES * i + axis, column)] += self.sensitivity(axis).dot(&angle);
                }
            }
        }
        let basis = matrix.try_svd(true, false, f64::EPSILON, MAX_SVD_STEPS)?;
        let limit = 1e-9 * basis.singular_values.max();
        let columns: Vec<_> = (0..basis.singular_values.len()).filter(|k| basis.singular_values[*k] > limit).collect();
        let u = basis.u?.select_columns(&columns);
        Some(DMatrix::identity(u.nrows(), u.nrows()) - &u * u.transpose())
    }

    /// Applies the projectors to the rows of `matrix`.
    pub(super) fn eliminate(&self, matrix: &mut DMatrix<f64>) {
        for (runs, projector) in &self.eliminations {
            let rows: Vec<usize> = runs.iter().flat_map(|run| (0..AXES).map(move |axis| AXES * run + axis)).collect();
            let projected = projector * matrix.select_rows(&rows);
            for (i, row) in rows.into_iter().enumerate() {
                matrix.row_mut(row).copy_from(&projected.row(i));
            }
        }
    }
}
