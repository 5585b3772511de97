//! The compensation kernel: equation (17) of the source paper, for one raw sample and one table.
//!
//! # Derivation, units and signs
//! A sensor's converter counts N+ pulses on its positive and N- on its negative channel during the control period Ts. With the scale
//! factors K+ > 0 and K- < 0, the indicated input integrated over Ts is `N+/K+ + N-/K-`: the negative channel's term is negative because
//! K- is. The bias is what the sensor indicates without input, so it is subtracted. A bias with a transient coefficient t follows the
//! difference between the head's telemetry and its own first-order lag, which the sample carries. For an accelerometer (K \[pulse/(s*g0)\],
//! bias A \[g0\]) and a gyroscope (K \[pulse/arcsec\], bias D \[deg/h\], which is arcsec/s):
//!
//! ```text
//! A  = (A(U_head) + t d) * u              d = U_lagged - U_head;  u: the unit of the bias in g0
//! dv = |g0| * ( N+/K+(U_board) + N-/K-(U_board) - A * Ts )                         [m/s]
//! D  = D(U_head) + t d
//! da = ( N+/K+(U_board) + N-/K-(U_board) - D * Ts - s . dv/|g0| ) * ARCSEC         [rad]
//! ```
//! with |g0| \[m/s2\] carried by the table, and s the g-sensitivity \[deg/h/g0\] times the published velocity increment. A(U) is
//! equation (18), K+(U) and K-(U) are (19) and (20); the gyroscopes are not in the paper. Each triad may have an alignment matrix. Earth's
//! rate is not removed.
//!
//! # Arithmetic
//! The kernel is one expression in IEEE double, evaluated in the order written below without fused multiply-add, so that
//! the service, the replay and any other implementation agree bit for bit. It is a pure function of sample and table: no
//! filter, no state, no clock, no allocation, no panic for any bit pattern. An infinite result becomes NaN; only an
//! extrapolation far outside a range can give one.

use crate::lanes::Lanes;
use crate::polynomial::{Polynomial, Side};
use crate::table::{Axis, CoefficientTable, Gyroscopes, OutOfRange};
use crate::units::{ARCSEC, Bias, NegativeScaleFactor, PositiveScaleFactor};
use crate::wire::{AXES, CompensatedIncrement, Flags, MAX_INTERVAL_NS, RawSample, Triad};
use nalgebra::Matrix3;

/// The result of the kernel for one raw sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation {
    /// Velocity increment over Ts \[m/s\], NaN where it could not be computed.
    pub velocity_increment: [f64; AXES],
    /// Angle increment over Ts \[rad\], NaN where it could not be computed.
    pub angle_increment: [f64; AXES],
    /// Sample flags.
    pub flags: Flags,
}

/// Compensates one sample; equation (17).
#[must_use]
#[inline(always)]
pub fn compensate(table: &CoefficientTable, raw: &RawSample) -> Compensation {
    let content = table.content();
    let period = Period {
        ts: raw.interval_ns as f64 / 1e9,
        valid: has_valid_interval(raw),
        lagged: raw.lag_ns != 0 && raw.lag_ns == table.lag_ns(),
        out_of_range: content.out_of_range,
    };
    let (indicated, mut flags) = indicated(&content.axes, table.lanes(), &raw.accelerometers, &period);
    let mut dv = indicated.map(|value| finite(content.gravity * value));
    if let Some(matrix) = &content.alignment {
        dv = aligned(matrix, dv);
    }
    let mut da = [f64::NAN; AXES];
    if let Some((gyroscopes, lanes)) = table.gyroscopes() {
        let (angles, more) = angles(gyroscopes, lanes, &raw.gyroscopes, &period, dv.map(|dv| dv / content.gravity));
        da = angles;
        flags |= more;
    }
    if !period.valid {
        flags |= Flags::INTERVAL;
    }
    let age_ns = raw.timestamp_ns.saturating_sub(raw.telemetry_ns);
    if let Some(limit) = content.max_age_s
        && raw.telemetry_ns != 0
        && age_ns as f64 / 1e9 > limit
    {
        flags |= Flags::TELEMETRY_STALE;
    }
    if raw.device != 0 && table.device() != 0 && raw.device != table.device() {
        flags |= Flags::OTHER_DEVICE;
    }
    Compensation { velocity_increment: dv, angle_increment: da, flags }
}

/// What both triads of a sample have in common.
struct Period {
    /// Control period \[s\].
    ts: f64,
    /// Whether the control period can be compensated.
    valid: bool,
    /// Whether the lagged telemetry has the table's time constant.
    lagged: bool,
    out_of_range: OutOfRange,
}

/// Angle increments \[rad\] and their flags, for the published velocity increments \[g0*s\].
#[inline(always)]
fn angles(
    gyroscopes: &Gyroscopes,
    lanes: &Lanes,
    triad: &Triad,
    period: &Period,
    q: [f64; AXES],
) -> ([f64; AXES], Flags) {
    let (indicated, flags) = indicated(&gyroscopes.axes, lanes, triad, period);
    let mut flags = Flags(flags.0 & Flags::LAG_UNKNOWN.0) | Flags(flags.0 & !Flags::LAG_UNKNOWN.0).of_gyroscopes();
    let mut angles = indicated.map(finite);
    let q_known = q.iter().all(|q| q.is_finite());
    for (angle, g_sensitivity) in angles.iter_mut().zip(&gyroscopes.g_sensitivity) {
        match g_sensitivity {
            Some([s1, s2, s3]) if q_known => *angle = finite(*angle - ((s1 * q[0] + s2 * q[1]) + s3 * q[2])),
            Some(_) => flags |= Flags::G_UNKNOWN,
            None => {}
        }
    }
    if let Some(matrix) = &gyroscopes.alignment {
        angles = aligned(matrix, angles);
    }
    (angles.map(|angle| angle * ARCSEC), flags)
}

/// `matrix` times the increments of the sensors.
#[inline(always)]
fn aligned(m: &Matrix3<f64>, sensor: [f64; AXES]) -> [f64; AXES] {
    let mut out = [0.0; AXES];
    for (i, out) in out.iter_mut().enumerate() {
        *out = finite((m[(i, 0)] * sensor[0] + m[(i, 1)] * sensor[1]) + m[(i, 2)] * sensor[2]);
    }
    out
}

/// What the sensors of a triad indicate over Ts, less the bias: `(N+/K+ + N-/K-) - bias * Ts`, in g0*s or arcsec. NaN where it cannot be
/// computed; it may be infinite. The flags are those of accelerometers, bits 0 to 17, and [`Flags::LAG_UNKNOWN`].
#[inline(always)]
fn indicated(axes: &[Axis; AXES], lanes: &Lanes, triad: &Triad, period: &Period) -> ([f64; AXES], Flags) {
    let mut flags = Flags::default();
    // The term of a bias without one is -0: adding it changes no number, not even the sign of a zero.
    let mut transients = [-0.0; AXES];
    for (index, axis) in axes.iter().enumerate() {
        if axis.transient != 0.0 {
            match lag_difference(axis, triad, index).filter(|_| period.lagged) {
                Some(difference) => transients[index] = axis.transient * difference,
                None => flags |= Flags::LAG_UNKNOWN,
            }
        }
    }
    let values = match lanes.evaluate_inside(triad) {
        Some(values) if period.valid && values.are_finite() => {
            // All six divisions in one pass: the compiler does two at a time, and divisions take most of the kernel's time.
            let ([p1, p2, p3], [n1, n2, n3]) = (triad.positive_pulses, triad.negative_pulses);
            let mut inputs = [p1, p2, p3, n1, n2, n3].map(f64::from);
            for (input, k) in inputs.iter_mut().zip(&values.scale_factors) {
                *input /= k;
            }
            let mut indicated = [0.0; AXES];
            for (index, indicated) in indicated.iter_mut().enumerate() {
                let bias = (values.bias[index] + transients[index]) * axes[index].bias_unit.factor();
                *indicated = (inputs[index] + inputs[AXES + index]) - bias * period.ts;
            }
            indicated
        }
        _ => {
            let (values, outside) = slow_path(axes, *triad, period, transients);
            flags |= outside;
            values
        }
    };
    for (index, axis) in axes.iter().enumerate() {
        if let Some(limit) = axis.max_rate
            && period.valid
            && (f64::from(triad.positive_pulses[index]) + f64::from(triad.negative_pulses[index])) / period.ts > limit
        {
            flags |= Flags::rate(index);
        }
    }
    (values, flags)
}

/// Lagged minus present head telemetry; `None` if it is not finite, or larger than the width of the bias's range.
#[inline(always)]
fn lag_difference(axis: &Axis, triad: &Triad, index: usize) -> Option<f64> {
    let [low, high] = axis.bias.range();
    let difference = triad.head_lagged[index] - triad.head_temperature[index];
    // NaN and infinity are not at most the width.
    (difference.abs() <= high - low).then_some(difference)
}

/// All samples that are not inside all ranges: what the policy allows, and the flags that say why the sample took this path.
#[cold]
#[inline(never)]
fn slow_path(axes: &[Axis; AXES], triad: Triad, period: &Period, transients: [f64; AXES]) -> ([f64; AXES], Flags) {
    let mut flags = not_finite_flags(&triad);
    let mut indicated = [f64::NAN; AXES];
    for (index, axis) in axes.iter().enumerate() {
        let (head, board) = (triad.head_temperature[index], triad.board_temperature[index]);
        let outside = range_flags(index, axis, head, board);
        let rejected = outside != Flags::default() && period.out_of_range == OutOfRange::Reject;
        let unusable = rejected || !period.valid || flags.intersects(Flags::not_finite(index));
        flags |= outside;
        if unusable {
            continue;
        }
        let used = |polynomial: &Polynomial, telemetry: f64| match period.out_of_range {
            OutOfRange::Clamp => polynomial.clamp(telemetry),
            OutOfRange::Extrapolate | OutOfRange::Reject => telemetry,
        };
        let bias = axis.bias.at(used(&axis.bias, head)) + transients[index];
        indicated[index] = input(
            (triad.positive_pulses[index], axis.positive_scale_factor_at(used(&axis.positive_scale_factor, board))),
            (triad.negative_pulses[index], axis.negative_scale_factor_at(used(&axis.negative_scale_factor, board))),
            Bias(bias * axis.bias_unit.factor()),
            period.ts,
        );
    }
    (indicated, flags)
}

/// The result for a sample whose IMU has no table: NaN, flagged [`Flags::NO_TABLE`].
#[must_use]
#[cold]
pub fn uncompensated(raw: &RawSample) -> Compensation {
    let interval = if has_valid_interval(raw) { Flags::default() } else { Flags::INTERVAL };
    let flags = not_finite_flags(&raw.accelerometers) | interval | Flags::NO_TABLE;
    Compensation { velocity_increment: [f64::NAN; AXES], angle_increment: [f64::NAN; AXES], flags }
}

/// The input of one sensor over Ts \[g0*s or arcsec\]; NaN if a scale factor is not finite.
#[inline(always)]
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
#[inline(always)]
fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::NAN }
}

#[inline]
const fn has_valid_interval(raw: &RawSample) -> bool {
    raw.interval_ns != 0 && raw.interval_ns <= MAX_INTERVAL_NS
}

/// The flags of telemetry that is NaN or infinite.
fn not_finite_flags(triad: &Triad) -> Flags {
    let mut flags = Flags::default();
    for index in 0..AXES {
        if !(triad.head_temperature[index].is_finite() && triad.board_temperature[index].is_finite()) {
            flags |= Flags::not_finite(index);
        }
    }
    flags
}

/// The flags of telemetry outside its range; telemetry that is not finite gets none of them.
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

/// The answer to a raw sample without the delivery part: `latency_ns` is 0 and no delivery flag is set.
#[must_use]
#[inline(always)]
pub fn answer(table: Option<&CoefficientTable>, raw: &RawSample) -> CompensatedIncrement {
    let (compensation, id) = match table {
        Some(table) => (compensate(table, raw), table.id()),
        None => (uncompensated(raw), 0),
    };
    CompensatedIncrement {
        session: raw.session,
        sequence: raw.sequence,
        timestamp_ns: raw.timestamp_ns,
        interval_ns: raw.interval_ns,
        velocity_increment: compensation.velocity_increment,
        angle_increment: compensation.angle_increment,
        table: id,
        flags: compensation.flags.0,
        latency_ns: 0,
    }
}
