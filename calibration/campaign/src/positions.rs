//! Positions of the two-axis turntable: the specific force in each, and the parameters that a list of positions
//! determines.
//!
//! [`crate::geometry`] has the convention of the angles.

use crate::position::Position;

use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use nalgebra::DMatrix;

/// Lists of twelve positions that laboratories use.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Scheme {
    /// Six faces, each at two headings 180 degrees apart: a level error cancels in every pair.
    SixFacesTwoHeadings,
    /// Six faces and six edges at 45 degrees.
    SixFacesSixEdges,
    /// A four-point tumble about each of the three axes.
    FourPointTumble,
}

impl Scheme {
    /// Every scheme with its name.
    pub const NAMES: [(Self, &'static str); 3] = [
        (Self::SixFacesTwoHeadings, "six-faces-two-headings"),
        (Self::SixFacesSixEdges, "six-faces-six-edges"),
        (Self::FourPointTumble, "four-point-tumble"),
    ];

    /// Outer and inner angle of each position \[deg\].
    #[must_use]
    pub const fn angles(self) -> [[f64; 2]; 12] {
        match self {
            Self::SixFacesTwoHeadings => [
                [0.0, 0.0],
                [0.0, 180.0],
                [180.0, 0.0],
                [180.0, 180.0],
                [90.0, 90.0],
                [270.0, 270.0],
                [90.0, 270.0],
                [270.0, 90.0],
                [90.0, 0.0],
                [270.0, 180.0],
                [90.0, 180.0],
                [270.0, 0.0],
            ],
            Self::SixFacesSixEdges => [
                [45.0, 90.0],
                [0.0, 0.0],
                [45.0, 0.0],
                [90.0, 0.0],
                [135.0, 270.0],
                [180.0, 0.0],
                [90.0, 180.0],
                [90.0, 270.0],
                [135.0, 180.0],
                [90.0, 45.0],
                [90.0, 90.0],
                [90.0, 225.0],
            ],
            Self::FourPointTumble => [
                [90.0, 90.0],
                [90.0, 0.0],
                [90.0, 270.0],
                [90.0, 180.0],
                [0.0, 0.0],
                [270.0, 180.0],
                [180.0, 0.0],
                [270.0, 0.0],
                [0.0, 90.0],
                [270.0, 270.0],
                [180.0, 90.0],
                [270.0, 90.0],
            ],
        }
    }

    /// The positions, numbered from 1.
    #[must_use]
    pub fn positions(self) -> Vec<Position> {
        (1..).zip(self.angles()).map(|(number, [outer, inner])| Position::at(number, outer, inner)).collect()
    }
}

/// Number of parameters of an accelerometer that the positions must determine: A, K+, K- and two misalignments.
pub const PARAMETERS: usize = 5;

/// Derivatives of the indicated specific force by A, relative K+, relative K-, m onto the next axis and m onto the one
/// after, at the specific force `f`.
fn design(axis: usize, f: [f64; AXES]) -> [f64; PARAMETERS] {
    [1.0, f[axis].max(0.0), f[axis].min(0.0), f[(axis + 1) % AXES], f[(axis + 2) % AXES]]
}

/// Which parameters of one accelerometer a list of positions determines.
#[derive(Clone, Debug, PartialEq)]
pub struct Observability {
    /// Rank of the design matrix; 5 is full.
    pub rank: usize,
    /// Largest singular value over the smallest; infinite where the rank is not full.
    pub condition: f64,
    /// One-sigma error of each parameter for unit noise in each position, if the rank is full.
    pub sigma: Option<[f64; PARAMETERS]>,
    /// For each deficiency, the parameters that are not determined and positions that would help.
    pub deficiencies: Vec<String>,
}

/// A list with a larger condition is refused, because it amplifies noise too much.
pub const MAX_CONDITION: f64 = 100.0;

impl Observability {
    /// The observability of accelerometer `axis` (0 to 2).
    ///
    /// ```
    /// use isotherm_campaign::{MAX_CONDITION, Observability, PARAMETERS, Scheme};
    ///
    /// let positions = Scheme::SixFacesTwoHeadings.positions();
    /// let all = Observability::of(&positions, 0);
    /// assert!(all.rank == PARAMETERS && all.condition < MAX_CONDITION);
    /// // The first four have A3 up or down, which says little of A1; what is missing is named.
    /// let four = Observability::of(&positions[..4], 0);
    /// assert!(four.rank < PARAMETERS && four.sigma.is_none() && !four.deficiencies.is_empty());
    /// ```
    #[must_use]
    pub fn of(positions: &[Position], axis: usize) -> Self {
        let rows: Vec<_> = positions.iter().map(|position| design(axis, position.specific_force)).collect();
        // At least as many rows as columns, so that the decomposition has all five singular values.
        let count = rows.len().max(PARAMETERS);
        let matrix = DMatrix::from_fn(count, PARAMETERS, |i, j| rows.get(i).map_or(0.0, |row| row[j]));
        let svd = matrix.svd(false, true);
        let largest = svd.singular_values.max();
        let is_zero = |value: f64| value <= 1e-9 * largest.max(f64::MIN_POSITIVE);
        let rank = svd.singular_values.iter().filter(|value| !is_zero(**value)).count();
        let smallest = svd.singular_values.min();
        let condition = if rank < PARAMETERS { f64::INFINITY } else { largest / smallest };
        let mut deficiencies = Vec::new();
        let mut sigma = [0.0; PARAMETERS];
        if let Some(v) = &svd.v_t {
            for (k, &value) in svd.singular_values.iter().enumerate() {
                for (j, sum) in sigma.iter_mut().enumerate() {
                    *sum += (v[(k, j)] / value).powi(2);
                }
                // A deficiency is a combination of parameters to which no position is sensitive.
                if is_zero(value) || (rank == PARAMETERS && largest / value > MAX_CONDITION) {
                    let involved: Vec<_> = (0..PARAMETERS).filter(|&j| v[(k, j)].abs() > 0.05).collect();
                    deficiencies.push(deficiency(axis, &involved, positions));
                }
            }
        }
        let sigma = (rank == PARAMETERS).then(|| sigma.map(f64::sqrt));
        Self { rank, condition, sigma, deficiencies }
    }
}

/// Message with the parameters that are not determined and positions that would help.
fn deficiency(axis: usize, parameters: &[usize], positions: &[Position]) -> String {
    let (own, next, after) = (axis, (axis + 1) % AXES, (axis + 2) % AXES);
    let names = ["bias A", "K+", "K-", "misalignment", "misalignment"];
    let named: Vec<_> = parameters
        .iter()
        .map(|&j| match j {
            3 => format!("{} onto {}", names[3], AXIS_NAMES[next]),
            4 => format!("{} onto {}", names[4], AXIS_NAMES[after]),
            _ => names[j].to_owned(),
        })
        .collect();
    let has = |axis: usize, sign: f64| positions.iter().any(|p| p.specific_force[axis] * sign > 0.5);
    let mut wanted = Vec::new();
    for (axis, parameter) in [(own, 1), (next, 3), (after, 4)] {
        for (sign, word) in [(1.0, "up"), (-1.0, "down")] {
            let parameter = if axis == own && sign < 0.0 { 2 } else { parameter };
            if parameters.contains(&parameter) && !has(axis, sign) {
                wanted.push(format!("one with {} pointing {word}", AXIS_NAMES[axis]));
            }
        }
    }
    if wanted.is_empty() {
        wanted.push(format!(
            "positions that change {} without changing the others, such as faces at two headings",
            named.first().map_or("one", String::as_str)
        ));
    }
    format!(
        "{}: {} cannot be distinguished by these positions; missing: {}",
        AXIS_NAMES[own],
        named.join(", "),
        wanted.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{base_axes, specific_force};

    #[test]
    fn angles_give_the_specific_force() {
        for scheme in Scheme::NAMES {
            for position in scheme.0.positions() {
                let size: f64 = position.specific_force.iter().map(|f| f * f).sum();
                assert!((size - 1.0).abs() < 1e-15);
            }
        }
        assert_eq!(specific_force(270.0, 90.0), [-1.0, 0.0, 0.0]);
        assert_eq!(Position::at(7, 90.0, 270.0).label, "-x");
        let edge = specific_force(45.0, 90.0);
        assert!((edge[0] - 0.5_f64.sqrt()).abs() < 1e-15 && (edge[2] - 0.5_f64.sqrt()).abs() < 1e-15, "{edge:?}");
    }

    #[test]
    fn the_axes_of_the_base_give_the_specific_force_and_its_change_with_the_tilt() {
        for position in Scheme::SixFacesSixEdges.positions() {
            let [outer, inner] = position.angles.unwrap();
            let (axes, by_tilt) = (base_axes(outer, inner), position.by_tilt().unwrap());
            assert!((axes.determinant() - 1.0).abs() < 1e-15);
            for i in 0..AXES {
                assert_eq!(
                    [-axes[(i, 0)], axes[(i, 1)], axes[(i, 2)]],
                    [by_tilt[i][1], by_tilt[i][0], position.specific_force[i]]
                );
            }
        }
    }

    #[test]
    fn a_tilted_base_turns_the_specific_force() {
        // Against a small rotation of the base about X, which is the outer axis' own direction.
        for position in Scheme::SixFacesSixEdges.positions() {
            let [outer, inner] = position.angles.unwrap();
            let step = 1e-6_f64;
            let turned = specific_force(outer - step.to_degrees(), inner);
            let back = specific_force(outer + step.to_degrees(), inner);
            for ((a, b), by_tilt) in turned.iter().zip(back).zip(position.by_tilt().unwrap()) {
                assert!(((a - b) / (2.0 * step) + by_tilt[0]).abs() < 1e-9, "{position:?}");
            }
        }
    }

    #[test]
    fn headings_cancel_the_tilt() {
        for pair in Scheme::SixFacesTwoHeadings.positions().chunks(2) {
            let (a, b) = (pair[0].by_tilt().unwrap(), pair[1].by_tilt().unwrap());
            for axis in 0..AXES {
                assert_eq!([a[axis][0] + b[axis][0], a[axis][1] + b[axis][1]], [0.0, 0.0]);
            }
        }
    }

    #[test]
    fn the_usual_schemes_observe_everything() {
        // One-sigma errors for unit noise, from an independent computation.
        let edges = [0.402534, 0.874001, 0.874001, 0.527046, 0.527046];
        for (scheme, right) in
            [(Scheme::SixFacesTwoHeadings, [0.353553, 0.790569, 0.790569, 0.5, 0.5]), (Scheme::SixFacesSixEdges, edges)]
        {
            for axis in 0..AXES {
                let found = Observability::of(&scheme.positions(), axis);
                assert_eq!((found.rank, found.deficiencies.len()), (5, 0));
                for (got, right) in found.sigma.unwrap().into_iter().zip(right) {
                    assert!((got - right).abs() < 1e-6, "{scheme:?} {got} {right}");
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_observed_is_named() {
        // Twelve positions about one horizontal axis: A3 never leaves the horizontal.
        let plane: Vec<_> = (0..12).map(|k| Position::at(k + 1, 90.0, 30.0 * f64::from(k))).collect();
        let ranks = [0, 1, 2].map(|axis| Observability::of(&plane, axis).rank);
        assert_eq!(ranks, [4, 4, 3]);
        let a3 = Observability::of(&plane, 2).deficiencies.join("\n");
        assert!(a3.contains("K+") && a3.contains("one with A3 pointing up"), "{a3}");
        let no_down: Vec<_> = Scheme::SixFacesTwoHeadings.positions().into_iter().filter(|p| p.label != "-y").collect();
        let a2 = Observability::of(&no_down, 1).deficiencies;
        assert_eq!(a2.len(), 1);
        assert!(a2[0].starts_with("A2: K- ") && a2[0].ends_with("one with A2 pointing down"), "{a2:?}");
        assert!(Observability::of(&no_down, 0).deficiencies.is_empty());
        assert_eq!(Observability::of(&[], 0).rank, 0);
    }
}
