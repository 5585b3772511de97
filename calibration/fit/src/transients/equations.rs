//! Normal equations that are added up by pieces of the data, so that a fit without a piece costs nothing but its
//! solution. A piece is of one recording, and has only the columns of that: there may be dozens of recordings.
//!
//! Columns are of order 1 and the values are centred before, so that squaring the condition loses no digit that
//! matters.

use nalgebra::DMatrix;

/// A column whose part across the columns before it is smaller than the square root of this is not determined: its
/// coefficient is 0.
const DEPENDENT: f64 = 1e-9;

/// Sums of products of the columns and of the value, which is the last column.
#[derive(Clone, Debug)]
pub(super) struct NormalEquations(DMatrix<f64>);

/// Those of a piece, with the columns that are not 0 in it.
#[derive(Clone, Debug)]
pub(super) struct PieceEquations {
    /// Rising; the last one is the value.
    columns: Vec<usize>,
    sums: DMatrix<f64>,
}

/// Coefficients of all columns; 0 for those that were not used, or are not determined.
#[derive(Clone, Debug)]
pub(super) struct Coefficients {
    pub values: Vec<f64>,
    /// Sum of the squared residuals.
    pub squares: f64,
}

impl NormalEquations {
    /// Of no data, with this many columns.
    pub(super) fn new(columns: usize) -> Self {
        Self(DMatrix::zeros(columns + 1, columns + 1))
    }

    pub(super) fn plus(self, piece: &PieceEquations) -> Self {
        self.with(piece, 1.0)
    }

    pub(super) fn minus(self, piece: &PieceEquations) -> Self {
        self.with(piece, -1.0)
    }

    fn with(mut self, piece: &PieceEquations, factor: f64) -> Self {
        for (j, column) in piece.columns.iter().enumerate() {
            for (i, row) in piece.columns.iter().enumerate().skip(j) {
                self.0[(*row, *column)] += factor * piece.sums[(i, j)];
            }
        }
        self
    }

    /// Least squares with the columns `used`, in order of importance: one that depends on those before it is left out.
    pub(super) fn solve(&self, used: &[usize]) -> Coefficients {
        let value = self.0.nrows() - 1;
        // L of the Cholesky decomposition, by rows of the columns that are kept, and then of the value.
        let mut factor: Vec<Vec<f64>> = Vec::with_capacity(used.len() + 1);
        let mut kept: Vec<usize> = Vec::with_capacity(used.len());
        let mut squares = 0.0;
        for &column in used.iter().chain([&value]) {
            let mut row: Vec<f64> = Vec::with_capacity(kept.len() + 1);
            for (before, of) in kept.iter().zip(&factor) {
                let product: f64 = row.iter().zip(of).map(|(a, b)| a * b).sum();
                row.push((self.0[(column.max(*before), column.min(*before))] - product) / of[row.len()]);
            }
            let whole = self.0[(column, column)];
            let left = whole - row.iter().map(|a| a * a).sum::<f64>();
            if column == value {
                squares = left.max(0.0);
                factor.push(row);
            } else if left > DEPENDENT * whole {
                row.push(left.sqrt());
                kept.push(column);
                factor.push(row);
            }
        }
        let mut right = factor.pop().unwrap_or_default();
        let mut values = vec![0.0; value];
        for i in (0..kept.len()).rev() {
            let solved = right[i] / factor[i][i];
            values[kept[i]] = solved;
            for (j, right) in right.iter_mut().enumerate().take(i) {
                *right -= factor[i][j] * solved;
            }
        }
        Coefficients { values, squares }
    }
}

impl PieceEquations {
    /// Of no data.
    pub(super) fn new(columns: Vec<usize>) -> Self {
        let sums = DMatrix::zeros(columns.len(), columns.len());
        Self { columns, sums }
    }

    /// Adds a row: all columns and then the value.
    pub(super) fn add(&mut self, row: &[f64]) {
        for (j, column) in self.columns.iter().enumerate() {
            for (i, other) in self.columns.iter().enumerate().skip(j) {
                self.sums[(i, j)] += row[*other] * row[*column];
            }
        }
    }

    /// Together with another piece of the same recording.
    pub(super) fn and(mut self, other: &Self) -> Self {
        debug_assert_eq!(self.columns, other.columns);
        self.sums += &other.sums;
        self
    }
}

impl Coefficients {
    /// The fitted value of a row of columns.
    pub(super) fn of(&self, row: &[f64]) -> f64 {
        self.values.iter().zip(row).map(|(coefficient, column)| coefficient * column).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(rows: &[[f64; 4]]) -> PieceEquations {
        rows.iter().fold(PieceEquations::new(vec![0, 1, 2, 3]), |mut piece, row| {
            piece.add(row);
            piece
        })
    }

    fn equations(rows: &[[f64; 4]]) -> NormalEquations {
        NormalEquations::new(3).plus(&piece(rows))
    }

    #[test]
    fn least_squares_without_what_depends_on_others() {
        // y = 2 - 3 x, and a third column that is their sum.
        let rows: Vec<_> = (0..9).map(f64::from).map(|x| [1.0, x, 1.0 + x, 2.0 - 3.0 * x]).collect();
        let solved = equations(&rows).solve(&[0, 1, 2]);
        for (value, right) in solved.values.iter().zip([2.0, -3.0, 0.0]) {
            assert!((value - right).abs() < 1e-10, "{:?}", solved.values);
        }
        assert!(solved.squares < 1e-10);
        let mean = equations(&rows).solve(&[0]);
        assert!((mean.values[0] + 10.0).abs() < 1e-12);
        assert!((mean.squares - 9.0 * 60.0).abs() < 1e-9);
        assert!((solved.of(&[1.0, 5.0, 0.0]) + 13.0).abs() < 1e-9);
    }

    #[test]
    fn a_piece_has_some_of_the_columns() {
        // The constants of two recordings.
        let of = |recording: usize, values: [f64; 2]| {
            let mut piece = PieceEquations::new(vec![recording, 2, 3]);
            values.iter().zip([-1.0, 1.0]).for_each(|(value, x)| {
                let mut row = [0.0, 0.0, x, *value];
                row[recording] = 1.0;
                piece.add(&row);
            });
            piece
        };
        let (first, second) = (of(0, [1.0, 5.0]), of(1, [10.0, 14.0]));
        let both = NormalEquations::new(3).plus(&first).plus(&second);
        let assert_near = |values: &[f64], right: [f64; 3]| {
            assert!(values.iter().zip(right).all(|(value, right)| (value - right).abs() < 1e-12), "{values:?}");
        };
        assert_near(&both.solve(&[0, 1, 2]).values, [3.0, 12.0, 2.0]);
        assert_near(&both.minus(&second).solve(&[0, 1, 2]).values, [3.0, 0.0, 2.0]);
        let twice = NormalEquations::new(3).plus(&first.clone().and(&first)).solve(&[0, 2]);
        assert_near(&twice.values, [3.0, 0.0, 2.0]);
        assert!(twice.squares < 1e-12, "{}", twice.squares);
    }

    #[test]
    fn pieces_add_up() {
        let rows: Vec<_> = (0..9).map(f64::from).map(|x| [1.0, x, x * x, libm::sin(x)]).collect();
        let part = piece(&rows[..4]);
        let rest = equations(&rows).minus(&part);
        let direct = equations(&rows[4..]).solve(&[0, 1, 2]);
        for (a, b) in rest.solve(&[0, 1, 2]).values.iter().zip(&direct.values) {
            assert!((a - b).abs() < 1e-9);
        }
        let whole = rest.plus(&part).solve(&[0, 1, 2]).values;
        assert!(whole.iter().zip(&equations(&rows).solve(&[0, 1, 2]).values).all(|(a, b)| (a - b).abs() < 1e-9));
    }
}
