use super::deviations::{phase, variance};
use super::moments::Moments;
use super::*;
use crate::allan::deviations::factors;
use isotherm_shared::wire::RawSample;

/// Frequencies of NIST SP 1065, section 5.10: a set of 9 and a random set of 1000.
fn random_set() -> Vec<f64> {
    let next = |x: &u64| Some(16807 * x % 2_147_483_647);
    core::iter::successors(Some(1_234_567_890), next).take(1000).map(|x| x as f64 / 2_147_483_647.0).collect()
}

#[test]
fn sets_of_nist_sp_1065() {
    let adev = |rates: &[f64], m| variance(&phase(rates, 1.0), m, 1.0).sqrt();
    let rates = random_set();
    let printed = [1, 10, 100].map(|m| format!("{:.6e}", adev(&rates, m)));
    assert_eq!(printed, ["2.922319e-1", "9.159953e-2", "3.241343e-2"]);
    let rates = [892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0];
    let printed = [1, 2].map(|m| format!("{:.5}", adev(&rates, m)));
    assert_eq!(printed, ["91.22945", "85.95287"]);
}

/// The moments by their definition: every lag, every term.
fn by_definition(factors: [usize; 2], n: usize, squares: [f64; 4]) -> f64 {
    let [m1, m2] = factors.map(|m| m as f64);
    let [l1, l2] = factors.map(|m| (n + 1 - 2 * m) as i64);
    let g = |t: f64| {
        let size = t.abs();
        let [quantisation, flicker] = if size == 0.0 { [1.0, 0.0] } else { [0.0, size * size * libm::log(size)] };
        let parts = [quantisation, -size / 2.0, flicker / core::f64::consts::TAU, size.powi(3) / 12.0];
        parts.iter().zip(squares).map(|(part, square)| part * square).sum::<f64>()
    };
    let second = [(0.0, 1.0), (1.0, -2.0), (2.0, 1.0)];
    let term = |lag: i64| {
        let count = (l1.min(l2 + lag) - lag.max(0)).max(0) as f64;
        let covariance = second.iter().flat_map(|a| second.iter().map(move |b| (a, b)));
        let covariance: f64 = covariance.map(|(a, b)| a.1 * b.1 * g(lag as f64 + a.0 * m1 - b.0 * m2)).sum();
        count * covariance * covariance
    };
    (1 - l2..l1).map(term).sum::<f64>() / (2.0 * l1 as f64 * l2 as f64 * m1 * m1 * m2 * m2)
}

#[test]
fn moments_are_those_of_the_definition() {
    let each = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    for squares in each.into_iter().chain([[1.0, 0.1, 0.01, 1e-5], [0.0, 0.0, 1.0, 1e-3]]) {
        for factors in
            [[1, 1], [1, 64], [3, 7], [2, 1024], [64, 256], [256, 256], [512, 1024], [813, 813], [1024, 1024]]
        {
            let [right, swapped] = [factors, [factors[1], factors[0]]].map(|it| by_definition(it, 4096, squares));
            let found = Moments::new(factors, 4096).covariance(&squares.into());
            assert!((found / right - 1.0).abs() < 1e-3, "{squares:?} {factors:?}: {found} {right}");
            assert!((swapped / right - 1.0).abs() < 1e-6, "{squares:?} {factors:?}: {swapped} {right}");
        }
    }
}

/// The covariance R(0) of a term with itself is that of the model, so the moments of one term are 2 AVAR^2.
#[test]
fn a_single_term_has_the_variance_of_the_model() {
    for squares in [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]] {
        let m = 16_usize;
        let length = m as f64;
        let terms = [3.0 / (length * length), 1.0 / length, FLICKER_FLOOR * FLICKER_FLOOR, length / 3.0];
        let variance: f64 = terms.iter().zip(squares).map(|(term, square)| term * square).sum();
        let found = Moments::new([m; 2], 2 * m).covariance(&squares.into());
        assert!((found / (2.0 * variance * variance) - 1.0).abs() < 1e-9, "{squares:?}: {found} {variance}");
    }
}

#[test]
fn factors_are_thirds_of_octaves_to_a_third_of_the_rows() {
    assert_eq!(factors(100), [1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32]);
    assert_eq!(factors(32768).len(), 38);
    assert_eq!(factors(32768).last(), Some(&10321));
}

/// By the formulas, without any shortcut.
#[test]
fn a_curve_is_that_of_the_definition() {
    let rates: Vec<f64> = random_set().iter().enumerate().map(|(row, rate)| rate + 1e-3 * row as f64).collect();
    let (interval_s, n) = (0.02, rates.len());
    let allan = Allan::of(&rates, interval_s).unwrap();
    for point in &allan.points {
        let m = point.factor;
        let mean = |from: usize| rates[from..from + m].iter().sum::<f64>() / m as f64;
        let squares: f64 = (0..=n - 2 * m).map(|k| (mean(k + m) - mean(k)).powi(2)).sum();
        let adev = (squares / (2.0 * (n + 1 - 2 * m) as f64)).sqrt();
        assert!((point.adev / adev - 1.0).abs() < 1e-12, "{m}: {} {adev}", point.adev);
    }
}

/// Rows in little memory are the rows: their times, counts and temperature, over gaps, late rows, sessions, long and
/// odd intervals.
#[test]
fn rows_that_are_kept_are_those_that_were_pushed() {
    let mut rows = rows::Rows::default();
    let mut all = Vec::new();
    let (mut random, mut sequence) = (isotherm_simulation::RandomGenerator::new(7, 0), 5_u64);
    for row in 0..5000_u64 {
        sequence += if row % 97 == 0 { 3 } else { 1 };
        let mut raw = RawSample { session: row / 2000, sequence, device: row / 3000, ..RawSample::default() };
        raw.interval_ns = if row % 501 == 0 { 10_000_000_000 } else { 1_000_000 + (row * 37 % 11) };
        raw.timestamp_ns = (1 << 60) + sequence * 1_000_000 + if row == 1500 { 7_000_000_000 } else { row * 31 % 13 };
        raw.accelerometers.positive_pulses = [row as u32, u32::MAX, 3];
        raw.accelerometers.negative_pulses = [7, row as u32, 0];
        raw.accelerometers.head_temperature = [(row / 100) as f64, 20.0, f64::NAN];
        raw.accelerometers.board_temperature = [random.normal(); 3];
        if row >= 1000 {
            raw.gyroscopes.positive_pulses = [1, 2, row as u32];
            raw.gyroscopes.head_temperature = [25.0 + (row / 7) as f64; 3];
        }
        rows.push(&raw, row >= 1000, row);
        all.push(raw);
    }
    assert_eq!((rows.len(), rows.pulses.len()), (5000, 6));
    for (number, (kept, pushed)) in rows.iter().zip(&all).enumerate() {
        // NaN is no number that equals itself.
        assert_eq!(format!("{kept:?}"), format!("{pushed:?}"), "{number}");
        assert_eq!(rows.period(number), isotherm_shared::sequence::Period::from(pushed));
    }
}

/// Rows of 10 ms: at rest, and in motion from 60 s to 70 s.
fn rest_and_motion(seed: u64) -> Vec<RawSample> {
    let mut random = isotherm_simulation::RandomGenerator::new(seed, 0);
    let row = |row: u64| {
        let mut raw = RawSample { sequence: row, timestamp_ns: (row + 1) * 10_000_000, ..RawSample::default() };
        raw.interval_ns = 10_000_000;
        let moves = if (6000..7000).contains(&row) { 4000.0 * libm::sin(row as f64 / 15.0) } else { 0.0 };
        raw.accelerometers.positive_pulses =
            [5000.0, 6000.0, 20_000.0].map(|mean: f64| (mean + moves + 20.0 * random.normal()).round() as u32);
        raw.accelerometers.head_temperature = [20.0 + (row / 500) as f64 / 10.0; 3];
        raw
    };
    (0..30_000).map(row).collect()
}

/// A border between two pieces of the search is not the end of a rest: neither at rest nor next to a motion.
#[test]
fn rests_are_the_same_in_pieces() {
    for seed in 0..5 {
        let rows = rest_and_motion(seed);
        let found = |piece_rows: usize| {
            let mut kept = NoiseRows::new(None, [0.0, f64::INFINITY]).in_pieces_of(piece_rows);
            rows.iter().for_each(|row| kept.push(row));
            kept.analyse().unwrap()
        };
        let whole = found(rows.len());
        assert!(whole.used.start.abs_diff(7000) < 100 && whole.used.end == rows.len(), "{:?}", whole.used);
        for piece_rows in [4100, 7300, 15_000] {
            let pieces = found(piece_rows);
            assert!(pieces.used.start.abs_diff(whole.used.start) < 50, "{:?} {:?}", pieces.used, whole.used);
            assert_eq!(pieces.used.end, whole.used.end);
            if pieces.used == whole.used {
                assert_eq!(pieces.sensors, whole.sensors);
            }
        }
    }
}

/// A row takes 8 bytes for each axis and 8 for its times, also where intervals are measured, and rows are lost.
#[test]
fn a_row_takes_little_memory() {
    let mut rows = rows::Rows::default();
    for (count, raw) in rest_and_motion(1).iter().enumerate().filter(|(row, _)| row % 50 != 7) {
        let interval_ns = raw.interval_ns + count as u64 % 17;
        rows.push(&RawSample { interval_ns, ..*raw }, false, raw.timestamp_ns);
    }
    let bytes = rows.bytes() as f64 / rows.len() as f64;
    assert!((32.0..35.0).contains(&bytes), "{bytes}");
}

#[test]
fn rates_that_never_change_have_no_deviation() {
    assert_eq!(Allan::of(&[7.5; 2000], 0.1), None);
    assert_eq!(Allan::of(&[1.0, 2.0], 0.1), None);
}

#[test]
fn counts_that_alternate_have_points_but_no_model() {
    let rates: Vec<f64> = (0..2000).map(|row| f64::from(row % 2)).collect();
    let found = Allan::of(&rates, 1.0).unwrap();
    assert!(found.model.is_none() && found.points.iter().all(|point| point.interval.is_none()));
    assert_eq!(found.points[1].adev, 0.0);
}
