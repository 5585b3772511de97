//! The compensation kernel: equation (17) of the source paper, for one raw sample and one table.
//!
//! # Derivation, units and signs
//! A sensor's converter counts N+ pulses on its positive and N- on its negative channel during the control period Ts.
//! With the scale factors K+ > 0 and K- < 0, the indicated input integrated over Ts is `N+/K+ + N-/K-`: the negative
//! channel's term is negative because K- is. The bias is what the sensor indicates without input, so it is subtracted.
//! A bias with a transient coefficient t follows the difference between the head's temperature and its own first-order
//! lag, which the sample carries. For an accelerometer (K \[pulse/(s*g0)\], bias A \[g0\]) and a gyroscope (K
//! \[pulse/arcsec\], bias D \[deg/h\], which is arcsec/s):
//!
//! ```text
//! A  = (A(U_head) + t d) * u              d = U_lagged - U_head;  u: the unit of the bias in g0
//! dv = |g0| * ( N+/K+(U_board) + N-/K-(U_board) - A * Ts )                         [m/s]
//! D  = D(U_head) + t d
//! da = ( N+/K+(U_board) + N-/K-(U_board) - D * Ts - s . dv/|g0| ) * ARCSEC         [rad]
//! ```
//! with |g0| \[m/s2\] carried by the table, and s the g-sensitivity \[deg/h/g0\] times the published velocity
//! increment. A(U) is equation (18), K+(U) and K-(U) are (19) and (20); the gyroscopes are not in the paper. Each triad
//! may have an alignment matrix. Earth's rate is not removed.
//!
//! # Arithmetic
//! The kernel is one expression in IEEE double, evaluated in the order written below without fused multiply-add, so
//! that the service, the replay and any other implementation agree bit for bit. It is a pure function of sample and
//! table: no filter, no state, no clock, no allocation, no panic for any bit pattern. An infinite result becomes NaN;
//! the coefficients of no real IMU give one inside the ranges.

use crate::kernel::Evaluation;
use crate::nominal::interval_fits;
use crate::polynomial::{Polynomial, Side};
use crate::table::{Axis, CoefficientTable, Content, OutOfRange};
use crate::units::{ARCSEC, Bias, NegativeScaleFactor, PositiveScaleFactor};
use crate::wire::{AXES, CompensatedIncrement, Flags, MAX_INTERVAL_NS, RawSample, Triad};
use nalgebra::Matrix3;
use std::sync::Arc;

/// The answer to a raw sample, without the delivery part: `latency_ns` is 0 and no delivery flag is set.
///
/// What cannot be computed is NaN, and flagged:
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_shared::{compensate::answer, table::CoefficientTable, wire::{Flags, RawSample}};
///
/// let table = CoefficientTable::from_toml(include_str!("../../tests/data/imu-a.toml"), None)?;
/// let mut raw = RawSample { interval_ns: 10_000_000, ..RawSample::default() };
/// raw.accelerometers.head_temperature = [2.5, f64::NAN, 5.0]; // V; the table is for 0.9 to 4.2 V
/// raw.accelerometers.board_temperature = [2.5; 3];
/// let increment = answer(Some(&table), &raw);
/// assert!(increment.velocity_increment[0].is_finite() && increment.velocity_increment[1].is_nan());
/// assert_eq!(Flags(increment.flags).to_string(), "a3-head-above|a2-not-finite");
/// assert!(Flags(answer(None, &raw).flags).intersects(Flags::NO_TABLE));
/// # Ok(())
/// # }
/// ```
#[must_use]
#[inline]
pub fn answer(table: Option<&CoefficientTable>, raw: &RawSample) -> CompensatedIncrement {
    let mut increment = CompensatedIncrement::default();
    answer_into(table, raw, &mut increment);
    increment
}

/// Writes the [`answer`] to a raw sample; equation (17). Without a table all increments are NaN, flagged
/// [`Flags::NO_TABLE`].
///
/// It writes each field once, to where the answer has to be: a copy would wait for these writes.
pub fn answer_into(table: Option<&CoefficientTable>, raw: &RawSample, increment: &mut CompensatedIncrement) {
    answer_with(&mut Evaluation::default(), table, raw, increment);
}

/// Answers the samples of a stream with one table. It evaluates bias and scale factors anew only where a temperature
/// differs from that of the sample before: a thermometer gives one value for many samples. The answers are those of
/// [`answer_into`], bit for bit.
#[derive(Clone, Debug)]
pub struct Compensator {
    table: Arc<CoefficientTable>,
    evaluation: Evaluation,
}

impl Compensator {
    /// One for this table.
    #[must_use]
    pub fn new(table: Arc<CoefficientTable>) -> Self {
        Self { table, evaluation: Evaluation::default() }
    }

    /// The table.
    #[must_use]
    pub fn table(&self) -> &CoefficientTable {
        &self.table
    }

    /// Writes the [`answer`] to a raw sample; equation (17).
    #[inline]
    pub fn answer_into(&mut self, raw: &RawSample, increment: &mut CompensatedIncrement) {
        answer_with(&mut self.evaluation, Some(&self.table), raw, increment);
    }
}

/// It is compiled here, once, and not again in each crate that calls it. The evaluation is of the table.
#[inline(never)]
fn answer_with(
    evaluation: &mut Evaluation,
    table: Option<&CoefficientTable>,
    raw: &RawSample,
    increment: &mut CompensatedIncrement,
) {
    increment.session = raw.session;
    increment.sequence = raw.sequence;
    increment.timestamp_ns = raw.timestamp_ns;
    increment.interval_ns = raw.interval_ns;
    increment.latency_ns = 0;
    increment.table = table.map_or(0, CoefficientTable::id);
    let Some(table) = table else {
        (increment.velocity_increment, increment.angle_increment) = ([f64::NAN; AXES], [f64::NAN; AXES]);
        increment.flags = uncompensated(raw).0;
        return;
    };
    let kernel = table.kernel();
    let period = Period {
        ts: raw.interval_ns as f64 / 1e9,
        valid: has_valid_interval(raw),
        lagged: raw.lag_ns != 0 && raw.lag_ns == kernel.lag_ns,
    };
    let mut flags;
    let usual = if period.valid { kernel.usual(evaluation, raw, period.lagged, period.ts) } else { None };
    if let Some((dv, da)) = usual {
        (increment.velocity_increment, increment.angle_increment) = (dv, da);
        flags = if kernel.has_transients && !period.lagged { Flags::LAG_UNKNOWN } else { Flags::default() };
    } else {
        (increment.velocity_increment, increment.angle_increment, flags) = any(table.content(), raw, &period);
    }
    if raw.is_marked_stale() || raw.temperature_age_s() > kernel.max_age_s {
        flags |= Flags::TELEMETRY_STALE;
    }
    if raw.device != 0 && kernel.device != 0 && raw.device != kernel.device {
        flags |= Flags::OTHER_DEVICE;
    }
    if kernel.nominal_ns != 0 && period.valid && !interval_fits(kernel.nominal_ns, raw.interval_ns) {
        flags |= Flags::INTERVAL_NOT_NOMINAL;
    }
    increment.flags = flags.0;
}

/// What all sensors of a sample have in common.
struct Period {
    /// Control period \[s\].
    ts: f64,
    /// Whether the control period can be compensated.
    valid: bool,
    /// Whether the lagged temperature has the table's time constant.
    lagged: bool,
}

/// Velocity increments \[m/s\], angle increments \[rad\] and flags of any sample, one sensor after the other, with what
/// the policy allows.
#[cold]
#[inline(never)]
fn any(content: &Content, raw: &RawSample, period: &Period) -> ([f64; AXES], [f64; AXES], Flags) {
    let (indicated, mut flags) = triad(content, &content.axes, &raw.accelerometers, period);
    if !period.valid {
        flags |= Flags::INTERVAL;
    }
    let dv = aligned(content.alignment.as_ref(), indicated.map(|value| finite(content.gravity * value)));
    let Some(gyroscopes) = &content.gyroscopes else { return (dv, [f64::NAN; AXES], flags) };
    let (mut angles, own) = triad(content, &gyroscopes.axes, &raw.gyroscopes, period);
    // Gyroscopes that are not there have no lag: the velocities lack nothing.
    if !(raw.gyroscopes.is_absent() && raw.gyroscopes.head_temperature[0].is_nan()) {
        flags |= own.only(Flags::LAG_UNKNOWN);
    }
    flags |= Flags(own.0 & !Flags::LAG_UNKNOWN.0).of_gyroscopes();
    let q = dv.map(|dv| dv / content.gravity);
    let q_known = q.iter().all(|q| q.is_finite());
    for (angle, g_sensitivity) in angles.iter_mut().zip(&gyroscopes.g_sensitivity) {
        *angle = finite(match g_sensitivity {
            Some([s1, s2, s3]) if q_known => finite(*angle) - ((s1 * q[0] + s2 * q[1]) + s3 * q[2]),
            Some(_) => {
                flags |= Flags::G_UNKNOWN;
                *angle
            }
            None => *angle,
        });
    }
    (dv, aligned(gyroscopes.alignment.as_ref(), angles).map(|angle| angle * ARCSEC), flags)
}

/// `matrix`, if there is one, times the increments of the sensors.
fn aligned(matrix: Option<&Matrix3<f64>>, sensor: [f64; AXES]) -> [f64; AXES] {
    let Some(m) = matrix else { return sensor };
    [0, 1, 2].map(|i| finite((m[(i, 0)] * sensor[0] + m[(i, 1)] * sensor[1]) + m[(i, 2)] * sensor[2]))
}

/// What the sensors of a triad indicate, NaN where it cannot be computed, and the flags, as those of accelerometers.
fn triad(content: &Content, axes: &[Axis; AXES], triad: &Triad, period: &Period) -> ([f64; AXES], Flags) {
    let (mut indicated, mut flags) = ([f64::NAN; AXES], not_finite_flags(triad));
    for (index, (axis, indicated)) in axes.iter().zip(&mut indicated).enumerate() {
        let (head, board) = (triad.head_temperature[index], triad.board_temperature[index]);
        let (positive, negative) = (triad.positive_pulses[index], triad.negative_pulses[index]);
        // The term of a bias without one is -0: adding it changes no number, not even the sign of a zero.
        let mut transient = -0.0;
        if axis.transient != 0.0 {
            match lag_difference(axis, triad, index).filter(|_| period.lagged) {
                Some(difference) => transient = axis.transient * difference,
                None => flags |= Flags::LAG_UNKNOWN,
            }
        }
        if let Some(limit) = axis.max_rate
            && period.valid
            && (f64::from(positive) + f64::from(negative)) / period.ts > limit
        {
            flags |= Flags::rate(index);
        }
        let outside = range_flags(index, axis, head, board);
        let rejected = outside != Flags::default() && content.out_of_range == OutOfRange::Reject;
        let unusable = rejected || !period.valid || flags.intersects(Flags::not_finite(index));
        flags |= outside;
        if unusable {
            continue;
        }
        let used = |polynomial: &Polynomial, temperature: f64| match content.out_of_range {
            OutOfRange::Clamp => polynomial.clamp(temperature),
            OutOfRange::Extrapolate | OutOfRange::Reject => temperature,
        };
        let k_plus = axis.positive_scale_factor_at(used(&axis.positive_scale_factor, board));
        let k_minus = axis.negative_scale_factor_at(used(&axis.negative_scale_factor, board));
        // A polynomial may cross zero beyond its range. With a scale factor of the wrong sign an increment would look
        // like one.
        let extrapolated = outside != Flags::default() && content.out_of_range == OutOfRange::Extrapolate;
        if extrapolated && !(k_plus.0 > 0.0 && k_minus.0 < 0.0) {
            continue;
        }
        let bias = axis.bias.at(used(&axis.bias, head)) + transient;
        let bias = Bias(bias * axis.bias_unit.factor());
        *indicated = input((positive, k_plus), (negative, k_minus), bias, period.ts);
    }
    (indicated, flags)
}

/// Lagged minus present head temperature; `None` if it is not finite, or larger than the width of the bias's range.
fn lag_difference(axis: &Axis, triad: &Triad, index: usize) -> Option<f64> {
    let [low, high] = axis.bias.range();
    let difference = triad.head_lagged[index] - triad.head_temperature[index];
    // NaN and infinity are not at most the width.
    (difference.abs() <= high - low).then_some(difference)
}

/// The flags of a sample whose IMU has no table.
#[cold]
fn uncompensated(raw: &RawSample) -> Flags {
    let interval = if has_valid_interval(raw) { Flags::default() } else { Flags::INTERVAL };
    not_finite_flags(&raw.accelerometers) | interval | Flags::NO_TABLE
}

/// The input of one sensor over Ts \[g0*s or arcsec\]; NaN if a scale factor is not finite.
fn input(
    (positive, k_plus): (u32, PositiveScaleFactor),
    (negative, k_minus): (u32, NegativeScaleFactor),
    bias: Bias,
    ts: f64,
) -> f64 {
    if !(k_plus.0.is_finite() && k_minus.0.is_finite()) {
        return f64::NAN;
    }
    (f64::from(positive) / k_plus.0 + f64::from(negative) / k_minus.0) - bias.0 * ts
}

/// Replaces infinity by NaN.
fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::NAN }
}

#[inline]
const fn has_valid_interval(raw: &RawSample) -> bool {
    raw.interval_ns != 0 && raw.interval_ns <= MAX_INTERVAL_NS
}

/// The flags of temperature that is NaN or infinite.
fn not_finite_flags(triad: &Triad) -> Flags {
    let mut flags = Flags::default();
    for index in 0..AXES {
        if !(triad.head_temperature[index].is_finite() && triad.board_temperature[index].is_finite()) {
            flags |= Flags::not_finite(index);
        }
    }
    flags
}

/// The flags of temperature outside its range; temperature that is not finite gets none of them.
fn range_flags(index: usize, axis: &Axis, head: f64, board: f64) -> Flags {
    let mut flags = Flags::default();
    if head.is_finite() {
        match axis.bias.side(head) {
            Side::Below => flags |= Flags::head_below(index),
            Side::Above => flags |= Flags::head_above(index),
            Side::Inside => {}
        }
    }
    if board.is_finite() {
        for polynomial in [&axis.positive_scale_factor, &axis.negative_scale_factor] {
            match polynomial.side(board) {
                Side::Below => flags |= Flags::board_below(index),
                Side::Above => flags |= Flags::board_above(index),
                Side::Inside => {}
            }
        }
    }
    flags
}
