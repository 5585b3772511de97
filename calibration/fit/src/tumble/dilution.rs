//! What the attitudes allow: how an error of the static poses comes out in the output.
//!
//! ```text
//! D^2 = mean over attitudes, axes and the temperature's range of g' (J'J)^-1 g
//! g: derivatives of an axis' output by the unknowns
//! ```
//! D is the error of the output for an error of 1 in each static pose; D sqrt(n) does not fall with the number n of
//! static poses, so it shows how good their attitudes are.

use super::attitudes::{directions, up};
use super::model::{GravityFit, GravityModel};
use super::reading::Reading;
use isotherm_shared::wire::AXES;
use nalgebra::{DMatrix, DVector, Vector3};

/// Above this D sqrt(n) no table is made.
pub(crate) const MOST: f64 = 100.0;
/// Above this D sqrt(n) a table has a warning.
pub(crate) const WARNED: f64 = 20.0;
/// Attitudes that the mean is taken over.
const ATTITUDES: usize = 200;
/// The golden angle \[rad\].
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
/// Share of the smallest eigenvalue in the largest below which a direction is not determined at all.
const UNDETERMINED: f64 = 1e-14;
/// An unknown is named if its part in the weakest direction is at least this share of the largest.
const NAMED: f64 = 0.3;

/// What the attitudes allow.
#[derive(Clone, Debug, PartialEq)]
pub struct Dilution {
    /// D sqrt(n); infinite if the attitudes do not determine all unknowns.
    pub times_root_n: f64,
    /// The unknowns of the weakest direction, by name.
    pub weakest: Vec<String>,
    /// The attitude that helps most, in words.
    pub help: String,
}

/// Directions evenly over the sphere: a spiral with the golden angle.
fn sphere() -> impl Iterator<Item = Vector3<f64>> {
    (0..ATTITUDES).map(|k| {
        let z = 1.0 - (2 * k + 1) as f64 / ATTITUDES as f64;
        let (sin, cos) = libm::sincos(k as f64 * GOLDEN_ANGLE);
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * cos, radius * sin, z)
    })
}

impl Dilution {
    /// Judges the attitudes of the static poses at a fit, or at its start.
    #[must_use]
    pub fn of(model: &GravityModel<'_>, fit: &GravityFit, readings: &[Reading], gravity: f64) -> Self {
        let root_n = (readings.len() as f64).sqrt();
        let moments = moments(model, fit, gravity);
        let of = |inverse: &DMatrix<f64>| mean_square(inverse, &moments).sqrt() * root_n;
        Self {
            times_root_n: fit.inverse.as_ref().map_or(f64::INFINITY, of),
            weakest: weakest(model, fit),
            help: help(model, fit, readings, gravity, &moments),
        }
    }
}

/// Where in the temperature's range the output is looked at: at its ends and in the middle.
fn parts(model: &GravityModel<'_>) -> &'static [f64] {
    if model.unknowns.order == 0 { &[0.5] } else { &[0.0, 0.5, 1.0] }
}

/// The mean of `g g'` over attitudes, axes and the temperature's range: D^2 is the trace of its product with (J'J)^-1.
fn moments(model: &GravityModel<'_>, fit: &GravityFit, gravity: f64) -> DMatrix<f64> {
    let parts = parts(model);
    let count = model.unknowns.count();
    let all = parts.iter().flat_map(|part| sphere().map(move |direction| (direction, *part)));
    let sum = all.fold(DMatrix::zeros(count, count), |sum, (direction, part)| {
        let by = model.derivatives_at(&fit.unknown, &(direction * gravity), part);
        sum + by.transpose() * by
    });
    sum / (AXES * parts.len() * ATTITUDES) as f64
}

fn mean_square(inverse: &DMatrix<f64>, moments: &DMatrix<f64>) -> f64 {
    inverse.component_mul(moments).sum()
}

/// The unknowns that the attitudes determine worst, or not at all.
fn weakest(model: &GravityModel<'_>, fit: &GravityFit) -> Vec<String> {
    let eigen = (fit.jacobian.transpose() * &fit.jacobian).symmetric_eigen();
    let (smallest, largest) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
    let weak = |value: f64| value <= smallest.max(UNDETERMINED * largest);
    let columns: Vec<usize> = (0..eigen.eigenvalues.len()).filter(|k| weak(eigen.eigenvalues[*k])).collect();
    let part = |row: usize| columns.iter().map(|k| eigen.eigenvectors[(row, *k)].powi(2)).sum::<f64>().sqrt();
    let parts: Vec<f64> = (0..eigen.eigenvalues.len()).map(part).collect();
    let most = parts.iter().copied().fold(0.0, f64::max);
    let mut named: Vec<usize> = (0..parts.len()).filter(|row| parts[*row] >= NAMED * most).collect();
    named.sort_by(|a, b| parts[*b].total_cmp(&parts[*a]));
    named.into_iter().map(|row| model.unknowns.name(row)).collect()
}

/// The attitude of the 26, at one end or the middle of the temperature's range, with which D is least.
fn help(
    model: &GravityModel<'_>,
    fit: &GravityFit,
    readings: &[Reading],
    gravity: f64,
    moments: &DMatrix<f64>,
) -> String {
    let parts = parts(model);
    let normal = fit.jacobian.transpose() * &fit.jacobian;
    // What is not determined is known to some 10 percent, so that candidates can be compared.
    let ridge = DMatrix::identity(normal.nrows(), normal.nrows()) * (100.0 / readings.len() as f64).recip() * 1e-4;
    let cost = |direction: &Vector3<f64>, part: f64| {
        let force = direction * gravity;
        let by = model.derivatives_at(&fit.unknown, &force, part);
        let row: DVector<f64> = by.transpose() * direction;
        let inverse = (&normal + &ridge + &row * row.transpose()).try_inverse();
        inverse.map_or(f64::INFINITY, |inverse| mean_square(&inverse, moments))
    };
    let all = directions().flat_map(|direction| parts.iter().map(move |part| (direction, *part)));
    let best =
        all.map(|(direction, part)| (direction, part, cost(&direction, part))).min_by(|a, b| a.2.total_cmp(&b.2));
    let Some((direction, part, _)) = best else { return String::new() };
    let up = format!("with {}", up(&direction));
    match part {
        _ if parts.len() == 1 => up,
        0.0 => format!("{up}, at the lowest temperature"),
        1.0 => format!("{up}, at the highest temperature"),
        _ => format!("{up}, at the middle of the temperature's range"),
    }
}
