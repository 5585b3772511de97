//! How the IMU sits on the turntable: the rotation from the specific force at the angles to the stated one, and what is
//! wrong if none fits.

use crate::geometry::specific_force;
use crate::position::{Position, SAME_DIRECTION};
use isotherm_shared::document::Section;
use nalgebra::{Matrix3, Vector3};

/// Two directions are enough for a rotation if the sine of the angle between them is over this.
const MIN_ANGLE: f64 = 0.1;
/// Rotations are made of each position and this many that follow it …
const NEIGHBOURS: usize = 8;
/// … for this many positions: a file may have thousands.
const CANDIDATES: usize = 64;

/// Orientation of the IMU on the turntable: the orthogonal matrix from the specific force at the angles to the stated
/// one, along A1, A2, A3. A matrix that only exchanges axes or their signs is returned exactly. `None` if a position
/// has no angles, or if no such matrix explains all stated directions.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_campaign::{Position, mount};
///
/// // An IMU that is turned by 90 degrees about A3: where A1 should point up, -A2 does.
/// let stated = [(0.0, 0.0, [0.0, 0.0, 1.0]), (90.0, 90.0, [0.0, -1.0, 0.0]), (90.0, 0.0, [1.0, 0.0, 0.0])];
/// let at = |(outer, inner, specific_force)| Position { specific_force, ..Position::at(1, outer, inner) };
/// let positions = stated.map(at);
/// let rotation = mount(&positions).ok_or("no rotation explains these positions")?;
/// assert_eq!(rotation.column(0).as_slice(), [0.0, -1.0, 0.0]);
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn mount(positions: &[Position]) -> Option<Matrix3<f64>> {
    let pairs = pairs(positions)?;
    let rotation = exact_if_near(best_rotation(&pairs)?);
    pairs.iter().all(|pair| misfit(&rotation, pair) < SAME_DIRECTION).then_some(rotation)
}

/// The specific force at the angles, and the stated one.
type Pair = (Vector3<f64>, Vector3<f64>);

/// The pair of each position; `None` if one has no angles.
fn pairs(positions: &[Position]) -> Option<Vec<Pair>> {
    let pair = |position: &Position| {
        let [outer, inner] = position.angles?;
        Some((Vector3::from(specific_force(outer, inner)), Vector3::from(position.specific_force)))
    };
    positions.iter().map(pair).collect()
}

/// The orthogonal matrix that turns the forces at the angles best into the stated ones. `None` for directions in one
/// plane: they do not determine it, nor the parameters of the accelerometers.
fn best_rotation(pairs: &[Pair]) -> Option<Matrix3<f64>> {
    nearest_orthogonal(pairs.iter().map(|(at, stated)| stated * at.transpose()).sum())
}

/// The orthogonal matrix nearest to `matrix`; `None` if that has a rank under 3.
fn nearest_orthogonal(matrix: Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = matrix.svd(true, true);
    if svd.singular_values.min() < 1e-3 * svd.singular_values.max() {
        return None;
    }
    Some(svd.u? * svd.v_t?)
}

/// `rotation`, or the matrix that only exchanges axes or their signs if that is the same to a few digits.
fn exact_if_near(rotation: Matrix3<f64>) -> Matrix3<f64> {
    let exact = rotation.map(f64::round);
    if (rotation - exact).amax() < SAME_DIRECTION { exact } else { rotation }
}

/// The rotation that a matrix of a few digits states. A matrix that only exchanges axes or their signs is returned
/// exactly. `None` if the matrix has a rank under 3.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_campaign::nearest_rotation;
/// use nalgebra::Matrix3;
///
/// let stated = Matrix3::new(0.866, 0.5, 0.0, -0.5, 0.866, 0.0, 0.0, 0.0, 1.0); // 30 degrees, to three digits
/// let rotation = nearest_rotation(&stated).ok_or("a rank under 3")?;
/// assert!((rotation * rotation.transpose() - Matrix3::identity()).norm() < 1e-14);
/// assert!((rotation[(0, 1)] - 0.5).abs() < 1e-4);
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    nearest_orthogonal(*matrix).map(exact_if_near)
}

/// The key `mounting` of a section: the rotation from the turntable's axes to the IMU's, as stated; the identity if
/// there is no such key. `None`, and a fault, if it is no rotation to a few digits.
#[must_use]
pub fn mounting(section: &Section<'_, '_>) -> Option<Matrix3<f64>> {
    if !section.has("mounting") {
        section.ignore("mounting");
        return Some(Matrix3::identity());
    }
    let right = "three rows of three numbers, a rotation: the specific force along A1, A2, A3 is mounting times that at the \
                 table's angles";
    let rows = section.matrix("mounting", right)?;
    let flat: Vec<f64> = rows.iter().flatten().copied().collect();
    let matrix = (rows.len() == 3 && flat.len() == 9).then(|| Matrix3::from_row_slice(&flat));
    let rotation =
        |m: &Matrix3<f64>| (m * m.transpose() - Matrix3::identity()).amax() < SAME_DIRECTION && m.determinant() > 0.0;
    let matrix = matrix.filter(rotation);
    if matrix.is_none() {
        section.fault("mounting", format!("give {right}"));
    }
    matrix
}

/// Largest difference of a component between the stated force and that at the angles.
fn misfit(rotation: &Matrix3<f64>, (at, stated): &Pair) -> f64 {
    (rotation * at - stated).amax()
}

/// The positions whose angles and stated directions do not fit each other, while those of three quarters do. `None` if
/// a mounting of the IMU explains all of them, see [`mount`], if a position has no angles, or if no mounting explains
/// most of them: a turntable may have other axes and zeros than ours.
#[must_use]
pub(crate) fn contradiction(positions: &[Position]) -> Option<String> {
    if mount(positions).is_some() {
        return None;
    }
    let pairs = pairs(positions)?;
    let rotation = rotation_of_most(&pairs)?;
    let off: Vec<_> =
        positions.iter().zip(&pairs).filter(|(_, pair)| misfit(&rotation, pair) >= SAME_DIRECTION).collect();
    let numbers: Vec<_> = off.iter().map(|(position, _)| position.number.to_string()).collect();
    let degrees = off.iter().map(|(_, (at, stated))| (rotation * at).angle(stated).to_degrees()).fold(0.0, f64::max);
    match off.as_slice() {
        [] => None,
        [(position, (at, _))] => {
            let force = rotation * at;
            Some(format!(
                "the angles of position {} do not fit its specific_force, which differs by {degrees:.2} degrees from [{:.5}, {:.5}, {:.5}] at \
                 these angles, while all others fit: correct outer_deg, inner_deg or specific_force",
                position.number,
                force[0] + 0.0,
                force[1] + 0.0,
                force[2] + 0.0
            ))
        }
        _ => Some(format!(
            "the angles of positions {} do not fit their specific_force, by up to {degrees:.2} degrees, while those of the other {} fit: \
             correct outer_deg, inner_deg or specific_force",
            numbers.join(", "),
            pairs.len() - off.len()
        )),
    }
}

/// The mounting that explains three quarters of the positions at least.
fn rotation_of_most(pairs: &[Pair]) -> Option<Matrix3<f64>> {
    // Two directions give a rotation, and a reflection. That of two right positions explains all other right ones.
    let neighbours = |i: usize| i + 1..pairs.len().min(i + 1 + NEIGHBOURS);
    let candidates = (0..pairs.len().min(CANDIDATES)).flat_map(|i| neighbours(i).map(move |j| (i, j)));
    let candidates = candidates.flat_map(|(i, j)| {
        let ((at_a, stated_a), (at_b, stated_b)) = (pairs[i], pairs[j]);
        let rotation = move |sign| Some(frame(stated_a, stated_b, sign)? * frame(at_a, at_b, 1.0)?.transpose());
        [1.0, -1.0].into_iter().filter_map(rotation)
    });
    let fitting = |rotation: &Matrix3<f64>| -> Vec<Pair> {
        // Few digits of two directions are worth less than those of all.
        pairs.iter().copied().filter(|pair| misfit(rotation, pair) < 3.0 * SAME_DIRECTION).collect()
    };
    let most = candidates.map(|rotation| (rotation, fitting(&rotation))).max_by_key(|(_, fitting)| fitting.len());
    let (rotation, fitting) = most.filter(|(_, fitting)| 4 * fitting.len() >= 3 * pairs.len())?;
    Some(best_rotation(&fitting).unwrap_or(rotation))
}

/// The axes that two directions give, with the third one in the direction `sign`.
fn frame(a: Vector3<f64>, b: Vector3<f64>, sign: f64) -> Option<Matrix3<f64>> {
    let across = a.cross(&b);
    let third = across.try_normalize(MIN_ANGLE)?;
    Some(Matrix3::from_columns(&[a, third * sign, a.cross(&third)]))
}

/// What to add to every outer angle, so that angles and stated directions fit: 90 or -90 \[deg\]; `None` if neither
/// does.
#[must_use]
pub fn other_zero(positions: &[Position]) -> Option<f64> {
    let turned = |off: f64| {
        let turn = |position: &Position| Position {
            angles: position.angles.map(|[outer, inner]| [outer + off, inner]),
            ..position.clone()
        };
        let positions: Vec<_> = positions.iter().map(turn).collect();
        mount(&positions).is_some_and(|rotation| rotation.determinant() > 0.0)
    };
    [90.0, -90.0].into_iter().find(|off| turned(*off))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::positions::Scheme;

    #[test]
    fn the_mount_is_found_from_a_few_digits() {
        let rotation = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let mut positions = Scheme::SixFacesSixEdges.positions();
        for position in &mut positions {
            let force = rotation * Vector3::from(position.specific_force);
            position.specific_force = force.map(|f| (f * 1e3).round() / 1e3).into();
        }
        assert_eq!(mount(&positions), Some(rotation));
        // An oblique fixture is a rotation too.
        let oblique = nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 1.0).into_inner();
        for position in &mut positions {
            position.specific_force = (oblique * rotation.transpose() * Vector3::from(position.specific_force)).into();
        }
        assert!((mount(&positions).unwrap() - oblique).amax() < 1e-3);
        assert_eq!(contradiction(&positions), None);
        positions[3].specific_force = [0.0, 0.0, 1.0];
        assert_eq!(mount(&positions), None);
        assert!(contradiction(&positions).unwrap().contains("the angles of position 4 do not fit its specific_force"));
        positions[3].angles = None;
        assert_eq!((mount(&positions), contradiction(&positions)), (None, None));
    }

    #[test]
    fn angles_that_do_not_fit_are_named() {
        let oblique = nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 1.0).into_inner();
        let reflected = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        for (scheme, list) in Scheme::NAMES {
            for rotation in [Matrix3::identity(), oblique, reflected] {
                let mut stated = scheme.positions();
                for position in &mut stated {
                    let force = rotation * Vector3::from(position.specific_force);
                    position.specific_force = force.map(|f| (f * 1e3).round() / 1e3).into();
                }
                assert_eq!(contradiction(&stated), None, "{list}");
                for k in 0..stated.len() {
                    let mut one = stated.clone();
                    one[k].angles = stated[k].angles.map(|[outer, inner]| [outer + 0.3, inner]);
                    let message = contradiction(&one).unwrap();
                    let named = format!("the angles of position {} do not fit its specific_force, ", k + 1);
                    assert!(message.starts_with(&named), "{list} {k}: {message}");
                }
                let mut several = stated.clone();
                several[2].angles = Some([10.0, 20.0]);
                several[7].angles = Some([30.0, 40.0]);
                let message = contradiction(&several).unwrap();
                assert!(message.starts_with("the angles of positions 3, 8 do not fit"), "{list}: {message}");
                let mut all = stated;
                all.iter_mut().for_each(|p| p.angles = p.angles.map(|[outer, inner]| [outer + 90.0, inner]));
                assert_eq!(contradiction(&all), None, "{list}");
                let added = if rotation.determinant() > 0.0 { -90.0 } else { 90.0 };
                assert_eq!(other_zero(&all), Some(added), "{list}");
            }
        }
    }
}
