//! What columns are, by what their means do from position to position and from set point to set point.
//!
//! A channel of an accelerometer follows gravity: within a set point it changes from position to position by about its
//! largest value, and three of them together have one length. Temperature follows the set points, and hardly changes
//! from position to position. So no temperature is taken for an acceleration, whatever it is called.

use isotherm_statistics::median;

/// A channel changes from position to position by more than this part of its largest value.
const FOLLOWS_GRAVITY: f64 = 0.3;
/// Temperature changes from position to position by less than this part of what it changes from set point to set point.
const FOLLOWS_SET_POINT: f64 = 0.3;
/// The lengths of three axes differ by less, with scale factors that differ.
const SAME_LENGTH: f64 = 0.3;

/// The means of a position at a set point.
#[derive(Clone, Debug)]
pub(super) struct PositionMeans {
    pub set_point_c: f64,
    pub position: u32,
    /// Of each column; NaN where it has no numbers.
    pub columns: Vec<f64>,
}

/// The columns of the accelerometers.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Channels {
    /// Three with their signs.
    Signed([usize; 3]),
    /// The positive and the negative channels of the axes.
    Both([[usize; 2]; 3]),
}

/// What the columns are.
#[derive(Clone, Debug, Default)]
pub(super) struct ColumnRoles {
    pub channels: Option<Channels>,
    /// All columns that follow gravity.
    pub following_gravity: Vec<usize>,
    /// The columns of temperature, with their slope \[1/degC\].
    pub temperature: Vec<(usize, f64)>,
    /// Those that are neither.
    pub others: Vec<usize>,
    /// Whether the channels have one length in all positions.
    pub has_one_length: bool,
}

impl ColumnRoles {
    /// What these columns are. `candidates` are those of numbers that are no time.
    pub(super) fn of(means: &[PositionMeans], candidates: &[usize], names: &[String]) -> Self {
        let mut found = Self::default();
        for &column in candidates {
            let values = || means.iter().map(|row| row.columns[column]);
            let most = values().fold(0.0, |most: f64, value| most.max(value.abs()));
            let within = median(set_points(means).iter().map(|set_point| {
                let of = means.iter().filter(|row| row.set_point_c == *set_point).map(|row| row.columns[column]);
                span(of)
            }));
            let of_set_points: Vec<(f64, f64)> = set_points(means)
                .iter()
                .map(|set_point| {
                    let of = means.iter().filter(|row| row.set_point_c == *set_point);
                    (*set_point, median(of.map(|row| row.columns[column])))
                })
                .collect();
            let between = span(of_set_points.iter().map(|(_, mean)| *mean));
            if within > FOLLOWS_GRAVITY * most && within > between {
                found.following_gravity.push(column);
            } else if within < FOLLOWS_SET_POINT * between {
                found.temperature.push((column, slope(&of_set_points)));
            } else {
                found.others.push(column);
            }
        }
        found.channels = channels(means, &found.following_gravity, names);
        found.has_one_length = found.channels.as_ref().is_some_and(|channels| {
            let lengths: Vec<f64> = means.iter().map(|row| length(channels.net(row))).collect();
            let usual = median(lengths.iter().copied());
            lengths.iter().all(|length| (length / usual - 1.0).abs() < SAME_LENGTH)
        });
        found
    }
}

impl Channels {
    /// The numbers of the axes with their signs.
    pub(super) fn net(&self, row: &PositionMeans) -> [f64; 3] {
        match self {
            Self::Signed(columns) => columns.map(|column| row.columns[column]),
            Self::Both(axes) => axes.map(|[positive, negative]| row.columns[positive] - row.columns[negative]),
        }
    }

    /// All columns.
    pub(super) fn all(&self) -> Vec<usize> {
        match self {
            Self::Signed(columns) => columns.to_vec(),
            Self::Both(axes) => axes.iter().flatten().copied().collect(),
        }
    }

    /// The direction of the specific force in a position: the nearest of faces, edges and corners of a cube, if one is
    /// near, and whether it is.
    pub(super) fn direction(&self, means: &[PositionMeans], position: u32) -> ([f64; 3], bool) {
        let mut sum = [0.0; 3];
        for row in means.iter().filter(|row| row.position == position) {
            let net = self.net(row);
            let length = length(net);
            (0..3).for_each(|axis| sum[axis] += net[axis] / length);
        }
        let norm = length(sum);
        let mean = sum.map(|part| part / norm);
        let signs = mean.map(|part| if part.abs() < 0.35 { 0.0 } else { part.signum() });
        let size = length(signs);
        let nearest = signs.map(|part| part / size);
        let is_near = mean.iter().zip(nearest).all(|(a, b)| (a - b).abs() < 0.15);
        if is_near { (nearest, true) } else { (mean, false) }
    }
}

/// The channels of three axes among the columns that follow gravity: three with both signs, or six with none.
fn channels(means: &[PositionMeans], columns: &[usize], names: &[String]) -> Option<Channels> {
    let is_signed = |column: &usize| means.iter().any(|row| row.columns[*column] < 0.0);
    if let Ok(three) = <[usize; 3]>::try_from(columns) {
        return three.iter().all(is_signed).then_some(Channels::Signed(three));
    }
    let &[a, b, c, d, e, f] = columns else { return None };
    if columns.iter().any(is_signed) {
        return None;
    }
    let by_axis = [[a, b], [c, d], [e, f]];
    let by_sign = [[a, d], [b, e], [c, f]];
    // Both channels of an axis count at once only under vibration; two axes, whenever neither is horizontal.
    let together = |pairs: &[[usize; 2]; 3]| -> f64 {
        let of_row = |row: &PositionMeans| {
            pairs.iter().map(|[one, other]| row.columns[*one].min(row.columns[*other])).sum::<f64>()
        };
        means.iter().map(of_row).sum()
    };
    let pairs = if together(&by_axis) <= together(&by_sign) { by_axis } else { by_sign };
    let is_negative = |column: usize| {
        let name = names[column].to_lowercase();
        name.contains('-') && !name.contains('+')
            || ["neg", "minus"].iter().any(|word| name.contains(word))
            || name.ends_with(['n', 'm'])
    };
    Some(Channels::Both(pairs.map(
        |[one, other]| {
            if is_negative(one) && !is_negative(other) { [other, one] } else { [one, other] }
        },
    )))
}

fn set_points(means: &[PositionMeans]) -> Vec<f64> {
    let mut all: Vec<f64> = means.iter().map(|row| row.set_point_c).collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

fn span(values: impl Iterator<Item = f64>) -> f64 {
    let [low, high] =
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]);
    (high - low).max(0.0)
}

/// The slope of a straight line through points.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let [x, y] = [points.iter().map(|(x, _)| x).sum::<f64>() / n, points.iter().map(|(_, y)| y).sum::<f64>() / n];
    let xy: f64 = points.iter().map(|(px, py)| (px - x) * (py - y)).sum();
    let xx: f64 = points.iter().map(|(px, _)| (px - x).powi(2)).sum();
    xy / xx
}

fn length(of: [f64; 3]) -> f64 {
    of.iter().map(|part| part * part).sum::<f64>().sqrt()
}
