//! Single mistakes that explain why groups do not agree, each by the repair that fixes it.
//!
//! Before any fit: an axis that does not feel gravity, and one that counts by a factor of what it does in the other
//! groups, by the ellipsoids of the groups. After it: axes, signs and the unit of the temperature of one group, by
//! refits of order 1 at most. A repair is named if it divides the residual by 8 and the next one leaves twice as much.

use super::choice::Data;
use super::groups::{Groups, spread};
use super::model::ellipsoid_about;
use super::reading::Reading;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{least_squares, median};
use isotherm_support::finding::{Finding, name};
use nalgebra::{DMatrix, DVector, Vector3};

/// Static poses of a group from which on an axis that does not vary is dead.
const LEAST_FOR_DEAD: usize = 6;
/// Errors of a mean that the means of a live axis vary by.
const NOISES: f64 = 10.0;
/// Means of all attitudes within so many standard deviations of a row have no gravity: it is 20 of them at least.
const ROW_NOISES: f64 = 6.0;
/// Static poses that differ by less are one attitude \[rad\].
const ONE_ATTITUDE: f64 = 0.05;
/// Squares of a circle's points, relative to that of the largest, are off by less.
const ON_CIRCLE: f64 = 0.1;
/// Static poses of a group whose ellipsoid is believed.
const LEAST_FOR_ELLIPSOID: usize = 9;
/// Condition number up to which it is.
const MAX_CONDITION: f64 = 30.0;
/// ln of the ratio to the other groups' scale factors that no unit has.
const FACTOR: f64 = 0.2;
/// A repair is named if it divides the residual by as much.
const NAMED: f64 = 8.0;
/// And if the next one leaves as many times the residual.
const APART: f64 = 2.0;

/// Names of the groups, for messages.
pub(super) type Names<'a> = dyn Fn(usize) -> String + 'a;

/// What the counts show before any fit.
pub(super) fn of_counts(
    readings: &[Reading],
    errors: &[[f64; AXES]],
    groups: &Groups,
    names: &Names<'_>,
) -> Option<Finding> {
    if let Some(finding) = never_turned(readings) {
        return Some(finding);
    }
    let dead = (0..groups.count).find_map(|group| dead(readings, errors, &groups.members(group), group, names));
    let alike = || alike(readings, errors);
    dead.or_else(|| no_gravity(readings)).or_else(alike).or_else(|| {
        let found = (0..groups.count).map(|group| scale_factors(readings, &groups.members(group)));
        factor(&found.collect::<Vec<_>>(), names)
    })
}

/// An axis that does not feel gravity.
fn dead(
    readings: &[Reading],
    errors: &[[f64; AXES]],
    members: &[usize],
    group: usize,
    names: &Names<'_>,
) -> Option<Finding> {
    let range = |axis: usize| spread(&members.iter().map(|i| readings[*i].net(axis)).collect::<Vec<_>>());
    let noise = |axis: usize| NOISES * median(members.iter().map(|i| errors[*i][axis]));
    let ranges = [0, 1, 2].map(range);
    let usual = median(ranges);
    let axis = (0..AXES).find(|axis| ranges[*axis] <= noise(*axis) && usual > noise(*axis))?;
    (members.len() >= LEAST_FOR_DEAD).then(|| {
        if is_circle(readings, members, axis) {
            let name = AXIS_NAMES[axis];
            let message = format!(
                "{}: over {} static poses {name} varies by {:.1} pulse/s while the others go round a circle: the IMU \
                 was turned only about {name}, or {name} is dead; put it down with +{name} and with -{name} up, too",
                names(group),
                members.len(),
                ranges[axis]
            );
            return Finding::fault(name::NEVER_TURNED, message);
        }
        let message = format!(
            "{}: {} does not feel gravity: over {} static poses its rate varies by {:.1} pulse/s, that of the others by {usual:.0}; look at \
             its column and its converter",
            names(group),
            AXIS_NAMES[axis],
            members.len(),
            ranges[axis]
        );
        Finding::fault(name::DEAD_AXIS, message)
    })
}

/// All static poses at one attitude, with gravity in the counts.
fn never_turned(readings: &[Reading]) -> Option<Finding> {
    let count = readings.len() as f64;
    let mean = Vector3::from_fn(|axis, _| readings.iter().map(|reading| reading.net(axis)).sum::<f64>() / count);
    let off = |reading: &Reading| Vector3::from_fn(|axis, _| reading.net(axis) - mean[axis]).norm();
    let most = readings.iter().map(off).fold(0.0, f64::max);
    let of_row =
        |axis: usize| median(readings.iter().map(|reading| reading.noise[axis] * (reading.rows.len() as f64).sqrt()));
    let noise = Vector3::from_fn(|axis, _| of_row(axis)).norm();
    let turned = most / mean.norm();
    (readings.len() > 1 && turned < ONE_ATTITUDE && mean.norm() > ROW_NOISES * noise).then(|| {
        let message = format!(
            "all {} static poses are one attitude within {:.1} degrees: the IMU was never turned; put it down on its faces, edges and corners",
            readings.len(),
            turned.to_degrees().max(0.1)
        );
        Finding::fault(name::NEVER_TURNED, message)
    })
}

/// Whether the other two axes of these readings lie on a circle, about any centre: least squares of
/// `x^2 + y^2 = 2 a x + 2 b y + c`.
fn is_circle(readings: &[Reading], members: &[usize], axis: usize) -> bool {
    let others = [(axis + 1) % AXES, (axis + 2) % AXES];
    let size = members.iter().flat_map(|i| others.map(|other| readings[*i].net(other).abs())).fold(0.0, f64::max);
    let at = |row: usize, other: usize| readings[members[row]].net(others[other]) / size;
    let design = DMatrix::from_fn(members.len(), 3, |row, k| if k < 2 { at(row, k) } else { 1.0 });
    let right = DVector::from_fn(members.len(), |row, _| -(at(row, 0).powi(2) + at(row, 1).powi(2)));
    least_squares(&design, &right).is_some_and(|found| {
        let left = &design * &found.change + &right;
        left.amax() < ON_CIRCLE
    })
}

/// Two axes that count alike at every attitude: one column was taken twice.
fn alike(readings: &[Reading], errors: &[[f64; AXES]]) -> Option<Finding> {
    let [first, second] = [[0, 1], [0, 2], [1, 2]].into_iter().find(|[a, b]| {
        let noise = NOISES * median(errors.iter().map(|error| error[*a]));
        readings.iter().all(|reading| (reading.net(*a) - reading.net(*b)).abs() <= noise)
    })?;
    (readings.len() >= LEAST_FOR_DEAD).then(|| {
        let message = format!(
            "{} and {} count alike in all {} static poses: one column was taken twice; correct the columns",
            AXIS_NAMES[first],
            AXIS_NAMES[second],
            readings.len()
        );
        Finding::fault(name::DEAD_AXIS, message)
    })
}

/// Rates that are the same at all attitudes, but for a few times the noise of a row.
fn no_gravity(readings: &[Reading]) -> Option<Finding> {
    let ranges = [0, 1, 2].map(|axis| spread(&readings.iter().map(|reading| reading.net(axis)).collect::<Vec<_>>()));
    let of_row =
        |axis: usize| median(readings.iter().map(|reading| reading.noise[axis] * (reading.rows.len() as f64).sqrt()));
    let same = (0..AXES).all(|axis| ranges[axis] <= ROW_NOISES * of_row(axis));
    (readings.len() > 1 && same).then(|| {
        let message = format!(
            "over {} static poses no axis varies by more than the noise of single rows: gravity is not in the counts, or all are one \
             attitude; look at the columns",
            readings.len()
        );
        Finding::fault(name::DEAD_AXIS, message)
    })
}

/// The scale factors that a single group shows; `None` unless its attitudes determine them.
fn scale_factors(readings: &[Reading], members: &[usize]) -> Option<[f64; AXES]> {
    let group: Vec<Reading> = members.iter().map(|i| readings[*i].clone()).collect();
    let found = ellipsoid_about(&group, 1.0, |_| 0.0).filter(|_| group.len() >= LEAST_FOR_ELLIPSOID)?;
    (found.condition < MAX_CONDITION && found.is_closed).then_some(found.scale_factor)
}

/// A group whose counts are a factor of what the others' are.
fn factor(found: &[Option<[f64; AXES]>], names: &Names<'_>) -> Option<Finding> {
    let known = || found.iter().enumerate().filter_map(|(group, found)| Some((group, (*found)?)));
    let ratios = |(group, ours): (usize, [f64; AXES])| {
        let others = |axis: usize| median(known().filter(|(other, _)| *other != group).map(|(_, found)| found[axis]));
        (group, [0, 1, 2].map(|axis| libm::log(ours[axis] / others(axis))))
    };
    let size = |ratios: &[f64; AXES]| ratios.iter().map(|ratio| ratio.abs()).fold(0.0, f64::max);
    let all = known().map(ratios).filter(|(_, ratios)| ratios.iter().all(|ratio| ratio.is_finite()));
    let (group, ratios) = all.max_by(|a, b| size(&a.1).total_cmp(&size(&b.1)))?;
    let axes: Vec<usize> = (0..AXES).filter(|axis| ratios[*axis].abs() > FACTOR).collect();
    if axes.is_empty() {
        return None;
    }
    let ratio = libm::exp(axes.iter().map(|axis| ratios[*axis]).sum::<f64>() / axes.len() as f64);
    let place = if known().count() == 2 {
        let other = known().map(|(other, _)| other).find(|other| *other != group)?;
        format!("one of {} and {}", names(group), names(other))
    } else {
        names(group)
    };
    let message = format!(
        "{place}: {} {} {ratio:.4} times what {} in the other groups: another unit of the counts, another range, or another IMU",
        list(&axes),
        if axes.len() == 1 { "counts" } else { "count" },
        if axes.len() == 1 { "it does" } else { "they do" },
    );
    Some(Finding::fault(name::SCALE_CHANGED, message))
}

fn list(axes: &[usize]) -> String {
    axes.iter().map(|axis| AXIS_NAMES[*axis]).collect::<Vec<_>>().join(", ")
}

/// A mistake in one group, and what fixes it.
#[derive(Clone, Copy)]
enum Repair {
    /// The axes in another order.
    Axes([usize; AXES]),
    /// Signs of the axes.
    Signs([f64; AXES]),
    /// The temperature in another unit: factor, then offset, and how a message says it.
    Temperature(f64, f64, &'static str),
}

impl Repair {
    fn all() -> Vec<Self> {
        let orders = [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]].map(Self::Axes);
        let signs =
            (1..8).map(|bits| Self::Signs([0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { -1.0 } else { 1.0 })));
        let units = [
            Self::Temperature(1.0 / 1.8, -32.0 / 1.8, "degrees Fahrenheit among degrees Celsius"),
            Self::Temperature(1.8, 32.0, "degrees Celsius among degrees Fahrenheit"),
            Self::Temperature(1.0, -273.15, "kelvin among degrees Celsius"),
        ];
        orders.into_iter().chain(signs).chain(units).collect()
    }

    /// Two repairs of one kind in two groups are one mistake seen from both.
    fn is_like(self, other: Self) -> bool {
        match (self, other) {
            (Self::Axes(_), Self::Axes(_)) | (Self::Temperature(..), Self::Temperature(..)) => true,
            (Self::Signs(a), Self::Signs(b)) => a == b,
            _ => false,
        }
    }

    fn fix(self, reading: &mut Reading) {
        match self {
            Self::Axes(order) => {
                reading.rates = order.map(|axis| reading.rates[axis]);
            }
            Self::Signs(signs) => {
                for (rates, sign) in reading.rates.iter_mut().zip(signs) {
                    if sign < 0.0 {
                        rates.swap(0, 1);
                    }
                }
            }
            Self::Temperature(factor, offset, _) => {
                let fix = |temperature: [f64; AXES]| temperature.map(|value| factor * value + offset);
                (reading.head, reading.board) = (fix(reading.head), fix(reading.board));
            }
        }
    }

    fn finding(self, place: &str, ratio: f64) -> Finding {
        let falls = format!("fixed, the residual falls {ratio:.0} times");
        match self {
            Self::Axes(order) => {
                let moved: Vec<_> = (0..AXES).filter(|axis| order[*axis] != *axis).collect();
                let message = format!("{place}: the axes {} are exchanged: {falls}; correct its columns", list(&moved));
                Finding::fault(name::AXES_EXCHANGED, message)
            }
            Self::Signs(signs) => {
                let turned: Vec<_> = (0..AXES).filter(|axis| signs[*axis] < 0.0).collect();
                let message = format!("{place}: the sign of {} is reversed: {falls}; correct it", list(&turned));
                Finding::fault(name::CHANNELS_EXCHANGED, message)
            }
            Self::Temperature(_, _, what) => {
                let message = format!("{place}: the temperature is in {what}: {falls}; convert it");
                Finding::fault(name::TEMPERATURE_SLOPE, message)
            }
        }
    }
}

/// The single repair of one group that explains why the groups differ.
pub(super) fn of_groups(data: Data<'_>, names: &Names<'_>) -> Option<Finding> {
    let order = data.groups.levels.saturating_sub(2).min(1);
    let rms = |readings: &[Reading]| {
        let data = Data { readings, ..data };
        let (model, fit) = data.fit(order, false)?;
        data.is_sane(&model, &fit).then(|| (fit.squares() / readings.len() as f64).sqrt())
    };
    let fixed = |group: usize, repair: Repair| {
        let mut readings = data.readings.to_vec();
        data.groups.members(group).into_iter().for_each(|i| repair.fix(&mut readings[i]));
        Some((rms(&readings)?, group, repair))
    };
    let all = (0..data.groups.count).flat_map(|group| Repair::all().into_iter().map(move |repair| (group, repair)));
    let mut tried: Vec<_> = all.filter_map(|(group, repair)| fixed(group, repair)).collect();
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (best, group, repair) = *tried.first()?;
    let now =
        data.fit(order, false).map_or(f64::INFINITY, |(_, fit)| (fit.squares() / data.readings.len() as f64).sqrt());
    let mut others = tried.iter().filter(|(_, other, like)| *other == group || !repair.is_like(*like)).skip(1);
    let next = others.next().map_or(f64::INFINITY, |(rms, ..)| *rms);
    if now <= NAMED * best || next <= APART * best {
        return None;
    }
    let twins: Vec<String> = tried
        .iter()
        .filter(|(rms, other, like)| *other != group && repair.is_like(*like) && *rms <= APART * best)
        .map(|(_, other, _)| names(*other))
        .collect();
    let place = match twins.as_slice() {
        [] => names(group),
        [other, ..] => format!("one of {} and {other}", names(group)),
    };
    Some(repair.finding(&place, now / best))
}
