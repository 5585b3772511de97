//! What the attitudes allow: how an error of the standstills comes out in the output.
//!
//! ```text
//! D^2 = mean over attitudes, axes and the telemetry's range of g' (J'J)^-1 g,   g: derivatives of an axis' output by the unknowns
//! ```
//! D is the error of the output for an error of 1 in each standstill; D sqrt(n) does not fall with the number n of standstills, so it tells how
//! good their attitudes are.

use super::model::{GravityFit, GravityModel};
use super::reading::Reading;
use isotherm_shared::wire::AXES;
use nalgebra::{DMatrix, DVector, Vector3};

/// Above this D sqrt(n) no table is made.
pub const MOST: f64 = 100.0;
/// Above this D sqrt(n) a table has a warning.
pub const WARNED: f64 = 20.0;
/// Equal parts of the telemetry's range, with a point in the middle of each.
const POINTS: usize = 21;
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

/// The 26 directions of the faces, edges and corners of a cube, with the weights of their mean over the sphere (Lebedev, exact to the 7th
/// power).
fn directions() -> impl Iterator<Item = (Vector3<f64>, f64)> {
    let signs = [0.0, 1.0, -1.0];
    let all = signs.into_iter().flat_map(move |a| signs.into_iter().flat_map(move |b| signs.map(|c| [a, b, c])));
    all.filter_map(|direction| {
        let vector = Vector3::from(direction);
        let weight = match direction.iter().filter(|part| **part != 0.0).count() {
            1 => 1.0 / 21.0,
            2 => 4.0 / 105.0,
            3 => 27.0 / 840.0,
            _ => return None,
        };
        Some((vector.normalize(), weight))
    })
}

impl Dilution {
    /// Judges the attitudes of the standstills at a fit, or at its start.
    #[must_use]
    pub fn of(model: &GravityModel<'_>, fit: &GravityFit, readings: &[Reading], gravity: f64) -> Self {
        let root_n = (readings.len() as f64).sqrt();
        let times_root_n =
            fit.inverse.as_ref().map_or(f64::INFINITY, |inverse| mean_square(model, fit, inverse, gravity).sqrt() * root_n);
        Self { times_root_n, weakest: weakest(model, fit), help: help(model, fit, readings, gravity) }
    }
}

/// D^2.
fn mean_square(model: &GravityModel<'_>, fit: &GravityFit, inverse: &DMatrix<f64>, gravity: f64) -> f64 {
    let points = if model.unknowns.order == 0 { 1 } else { POINTS };
    let part = |point: usize| (point as f64 + 0.5) / points as f64;
    let at = |(direction, weight): (Vector3<f64>, f64), part: f64| {
        let by = model.derivatives_at(&fit.unknown, &(direction * gravity), part);
        weight * (&by * inverse * by.transpose()).trace() / AXES as f64
    };
    let all = (0..points).flat_map(|point| directions().map(move |direction| (direction, part(point))));
    all.map(|(direction, part)| at(direction, part)).sum::<f64>() / points as f64
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

/// The attitude of the 26, at one end or the middle of the telemetry's range, with which D is least.
fn help(model: &GravityModel<'_>, fit: &GravityFit, readings: &[Reading], gravity: f64) -> String {
    let parts: &[f64] = if model.unknowns.order == 0 { &[0.5] } else { &[0.0, 0.5, 1.0] };
    let normal = fit.jacobian.transpose() * &fit.jacobian;
    // What is not determined is known to some 10 percent, so that candidates can be compared.
    let ridge = DMatrix::identity(normal.nrows(), normal.nrows()) * (100.0 / readings.len() as f64).recip() * 1e-4;
    let cost = |direction: &Vector3<f64>, part: f64| {
        let force = direction * gravity;
        let by = model.derivatives_at(&fit.unknown, &force, part);
        let row: DVector<f64> = by.transpose() * direction;
        let inverse = (&normal + &ridge + &row * row.transpose()).try_inverse();
        inverse.map_or(f64::INFINITY, |inverse| mean_square(model, fit, &inverse, gravity))
    };
    let all = directions().flat_map(|(direction, _)| parts.iter().map(move |part| (direction, *part)));
    let best = all.map(|(direction, part)| (direction, part, cost(&direction, part))).min_by(|a, b| a.2.total_cmp(&b.2));
    let Some((direction, part, _)) = best else { return String::new() };
    let names: Vec<String> = (0..AXES)
        .filter(|axis| direction[*axis] != 0.0)
        .map(|axis| format!("{}A{}", if direction[axis] < 0.0 { "-" } else { "+" }, axis + 1))
        .collect();
    let up = match names.as_slice() {
        [one] => format!("with {one} up"),
        [one, two] => format!("with the edge between {one} and {two} up"),
        _ => format!("with the corner between {} up", names.join(", ")),
    };
    match part {
        _ if parts.len() == 1 => up,
        0.0 => format!("{up}, at the lowest telemetry"),
        1.0 => format!("{up}, at the highest telemetry"),
        _ => format!("{up}, at the middle of the telemetry's range"),
    }
}
