//! The magnitude of the compensated specific force at rest, against gravity.

use crate::net::net;
use crate::static_pose::{StaticPoses, find_static_poses};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::median;
use isotherm_support::finding::{Finding, name};

/// Rows from the begin of a recording that are looked at; each takes 256 bytes.
pub const MAGNITUDE_ROWS: usize = 50_000;
/// Largest difference of the magnitude at rest from gravity, over gravity: no place on Earth, no bias of a table and no
/// turn of a static pose makes as much.
const MOST_OFF: f64 = 0.02;
/// Largest scatter of a row at rest, over gravity.
const MOST_SCATTER: f64 = 0.1;
/// Intervals \[ns\] that are taken for what they are: IMUs give rows neither faster nor slower. Others are looked at as
/// if they were [`USUAL_NS`].
const PLAUSIBLE_NS: [f64; 2] = [200e3, 2e9];
const USUAL_NS: f64 = 20e6;
/// How far a magnitude may be off gravity in another unit: the biases of cheap sensors are in it.
const AS_UNIT: f64 = 0.1;

/// That the magnitude of the compensated specific force at rest is not gravity: over 2 % off the local gravity of the
/// table, otherwise its g0. It is the median over the static poses of the first [`MAGNITUDE_ROWS`] rows; `None` if
/// there are none, or no output that is a number. Rows in motion are not judged.
#[must_use]
pub fn magnitude_at_rest(table: &CoefficientTable, rows: &[RawSample]) -> Option<Finding> {
    let rows = &rows[..rows.len().min(MAGNITUDE_ROWS)];
    let poses = poses(rows).filter(|poses| is_quiet(rows, poses))?;
    let magnitudes = poses.found.iter().map(|it| magnitude(table, poses.rows(rows, it.rows.clone())));
    let magnitudes: Vec<f64> = magnitudes.filter(|magnitude| magnitude.is_finite()).collect();
    let magnitude = if magnitudes.is_empty() { return None } else { median(magnitudes) };
    let g0 = table.content().gravity;
    let (gravity, source) = table.gravity_local().map_or((g0, "g0 of the table"), |local| (local, "local gravity"));
    let ratio = magnitude / gravity;
    ((ratio - 1.0).abs() > MOST_OFF).then(|| {
        let as_unit = |unit: f64| (magnitude * unit / gravity - 1.0).abs() <= AS_UNIT;
        let remedy = match () {
            () if as_unit(g0) => "; the readings look like g: give accelerometer.unit = \"g\" in a mapping (--mapping)",
            () if as_unit(g0 / 1e3) => {
                "; the readings look like mg: give accelerometer.unit = \"mg\" in a mapping (--mapping)"
            }
            () => "",
        };
        let message = format!(
            "{} g0 at rest: the specific force is {} m/s2, {source} {gravity} m/s2, {} times; counts, interval_ns, and \
             the table's scale factors and biases enter{remedy}",
            digits(magnitude / g0),
            digits(magnitude),
            digits(ratio),
        );
        Finding::fault(name::NOT_GRAVITY, message)
    })
}

/// Whether the rows of the static poses scatter by far less than gravity: what shakes may be in motion as well.
fn is_quiet(rows: &[RawSample], poses: &StaticPoses) -> bool {
    let norm = |counts: [f64; AXES]| counts.iter().map(|count| count * count).sum::<f64>().sqrt();
    let at_rest = || poses.found.iter().flat_map(|it| poses.rows(rows, it.rows.clone()));
    let magnitude = median(at_rest().map(|row| norm([0, 1, 2].map(|axis| net(row, axis)))));
    norm(poses.noise) < MOST_SCATTER * magnitude
}

/// The static poses, the times of which need not be right.
fn poses(rows: &[RawSample]) -> Option<StaticPoses> {
    let interval_ns = median(rows.iter().map(|row| row.interval_ns as f64));
    let [least, most] = PLAUSIBLE_NS;
    if (least..=most).contains(&interval_ns) {
        return find_static_poses(rows, None).ok();
    }
    let factor = USUAL_NS / interval_ns.max(1.0);
    let scaled = |ns: u64| (ns as f64 * factor) as u64;
    let first_ns = rows.first()?.timestamp_ns;
    let slower = |row: &RawSample| RawSample {
        timestamp_ns: scaled(row.timestamp_ns.saturating_sub(first_ns)),
        interval_ns: scaled(row.interval_ns),
        ..*row
    };
    find_static_poses(&rows.iter().map(slower).collect::<Vec<_>>(), None).ok()
}

/// The magnitude of the mean specific force of rows \[m/s2\].
fn magnitude<'a>(table: &CoefficientTable, rows: impl Iterator<Item = &'a RawSample>) -> f64 {
    let (mut sum, mut seconds) = ([0.0; AXES], 0.0);
    for row in rows {
        let increment = answer(Some(table), row).velocity_increment;
        (0..AXES).for_each(|axis| sum[axis] += increment[axis]);
        seconds += row.interval_ns as f64 / 1e9;
    }
    sum.iter().map(|sum| sum * sum).sum::<f64>().sqrt() / seconds
}

/// Four digits at least.
fn digits(value: f64) -> String {
    let before = libm::log10(value.abs().max(1e-300)).floor();
    format!("{value:.*}", (3.0 - before).clamp(0.0, 12.0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_simulation::{Chain, InertialMotion, Noise, SimulatedImu, Truth};

    /// Rows of 10 ms at rest, whose times are `factor` of the right ones, and what is found.
    fn found(factor: f64) -> Option<String> {
        let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None).unwrap();
        let (truth, noise) = (Truth::of(table), Noise { sensor_g0: 1e-4, ..Noise::NONE });
        let mut imu = SimulatedImu::new(&truth, &Chain::default(), &noise, 20.0, 1);
        let rows = (0..3000).map(|_| imu.step(&InertialMotion::of_force([0.6, -0.48, 0.64]), 10_000_000));
        let scaled = |ns: u64| (ns as f64 * factor) as u64;
        let rows: Vec<_> = rows
            .map(|row| RawSample {
                timestamp_ns: scaled(row.timestamp_ns),
                interval_ns: scaled(row.interval_ns),
                ..row
            })
            .collect();
        magnitude_at_rest(&truth.table, &rows).map(|finding| finding.message)
    }

    #[test]
    fn times_that_are_wrong_are_a_length_that_is_not_gravity() {
        assert_eq!(found(1.0), None);
        assert_eq!(found(1.01), None);
        for (factor, right) in [(1e-3, "1000"), (1e3, "0.0010"), (0.5, "2.00"), (1.05, "0.95")] {
            let message = found(factor).unwrap_or_else(|| panic!("{factor}"));
            assert!(message.starts_with(right) && message.contains(" g0 at rest: "), "{factor}: {message}");
        }
    }
}
