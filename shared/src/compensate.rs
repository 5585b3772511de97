//! The compensation kernel: equation (17) of the source paper, for one raw sample and one table.
//!
//! # Derivation, units and signs
//! An accelerometer's charge-balance converter counts N+ pulses on its positive and N- on its negative channel during
//! the control period Ts. With the scale factors K+ > 0 and K- < 0 \[pulse/(s*g0)\], the indicated specific force
//! integrated over Ts is `N+/K+ + N-/K-` \[g0*s\]: the negative channel's term is negative because K- is. The bias A
//! \[g0\] is what the sensor indicates without input, so it is subtracted:
//!
//! ```text
//! dv = |g0| * ( N+/K+(U_board) + N-/K-(U_board) - A(U_head) * Ts )                 [m/s]
//! ```
//! with |g0| \[m/s2\] carried by the table. A(U) is equation (18), K+(U) and K-(U) are (19) and (20); the head's
//! telemetry drives the bias, the board's both scale factors.
//!
//! # Arithmetic
//! The kernel is one expression in IEEE double, evaluated in the order written below without fused multiply-add, so that
//! the service, the replay and any other implementation agree bit for bit. It is a pure function of sample and table: no
//! filter, no state, no clock, no allocation, no panic for any bit pattern. An infinite result becomes NaN; only an
//! extrapolation far outside a range can give one.

use crate::lanes::LaneValues;
use crate::polynomial::{Polynomial, Side};
use crate::table::{Axis, CoefficientTable, Content, OutOfRange};
use crate::units::{Bias, NegativeScaleFactor, PositiveScaleFactor};
use crate::wire::{AXES, CompensatedIncrement, Flags, MAX_INTERVAL_NS, RawSample};

/// The result of the kernel for one raw sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation {
    /// Velocity increment over Ts \[m/s\], NaN where it could not be computed.
    pub velocity_increment: [f64; AXES],
    /// Sample flags.
    pub flags: Flags,
}

/// Compensates one sample; equation (17).
#[must_use]
#[inline(always)]
pub fn compensate(table: &CoefficientTable, raw: &RawSample) -> Compensation {
    let content = table.content();
    let ts = raw.interval_ns as f64 / 1e9;
    let valid_interval = has_valid_interval(raw);
    let (mut dv, mut flags) = match table.lanes().evaluate_inside(&raw.head_temperature, &raw.board_temperature) {
        Some(values) if valid_interval => (fast_path(&values, raw, ts, content.gravity), Flags::default()),
        _ => slow_path(content, *raw, ts),
    };
    for (index, axis) in content.axes.iter().enumerate() {
        if let Some(limit) = axis.max_rate
            && valid_interval
            && (f64::from(raw.positive_pulses[index]) + f64::from(raw.negative_pulses[index])) / ts > limit
        {
            flags |= Flags::rate(index);
        }
    }
    if let Some(m) = &content.alignment {
        let sensor = dv;
        for (i, out) in dv.iter_mut().enumerate() {
            *out = finite((m[(i, 0)] * sensor[0] + m[(i, 1)] * sensor[1]) + m[(i, 2)] * sensor[2]);
        }
    }
    let age_ns = raw.timestamp_ns.saturating_sub(raw.telemetry_ns);
    if let Some(limit) = content.max_age_s
        && raw.telemetry_ns != 0
        && age_ns as f64 / 1e9 > limit
    {
        flags |= Flags::TELEMETRY_STALE;
    }
    Compensation { velocity_increment: dv, flags }
}

/// Increments of the three axes \[m/s\] if all telemetry is inside its ranges and the interval is valid.
#[inline(always)]
fn fast_path(values: &LaneValues, raw: &RawSample, ts: f64, gravity: f64) -> [f64; AXES] {
    let mut dv = [0.0; AXES];
    for (index, dv) in dv.iter_mut().enumerate() {
        *dv = increment(
            (raw.positive_pulses[index], PositiveScaleFactor(values.positive_scale_factor[index])),
            (raw.negative_pulses[index], NegativeScaleFactor(values.negative_scale_factor[index])),
            Bias(values.bias[index]),
            ts,
            gravity,
        );
    }
    dv
}

/// All other samples: the increments that the policy allows \[m/s\], and the flags that say why the sample took this path.
#[cold]
#[inline(never)]
fn slow_path(table: &Content, raw: RawSample, ts: f64) -> ([f64; AXES], Flags) {
    let mut flags = flags_without_table(&raw);
    let mut dv = [f64::NAN; AXES];
    for (index, axis) in table.axes.iter().enumerate() {
        let (head, board) = (raw.head_temperature[index], raw.board_temperature[index]);
        let outside = range_flags(index, axis, head, board);
        let rejected = outside != Flags::default() && table.out_of_range == OutOfRange::Reject;
        let unusable = rejected || flags.intersects(Flags::INTERVAL | Flags::not_finite(index));
        flags |= outside;
        if unusable {
            continue;
        }
        let used = |polynomial: &Polynomial, telemetry: f64| match table.out_of_range {
            OutOfRange::Clamp => polynomial.clamp(telemetry),
            OutOfRange::Extrapolate | OutOfRange::Reject => telemetry,
        };
        dv[index] = increment(
            (raw.positive_pulses[index], axis.positive_scale_factor_at(used(&axis.positive_scale_factor, board))),
            (raw.negative_pulses[index], axis.negative_scale_factor_at(used(&axis.negative_scale_factor, board))),
            axis.bias_at(used(&axis.bias, head)),
            ts,
            table.gravity,
        );
    }
    (dv, flags)
}

/// The result for a sample whose IMU has no table: NaN, flagged [`Flags::NO_TABLE`].
#[must_use]
#[cold]
pub fn uncompensated(raw: &RawSample) -> Compensation {
    Compensation { velocity_increment: [f64::NAN; AXES], flags: flags_without_table(raw) | Flags::NO_TABLE }
}

/// Equation (17) for one axis \[m/s\].
#[inline(always)]
fn increment(
    (positive, k_plus): (u32, PositiveScaleFactor),
    (negative, k_minus): (u32, NegativeScaleFactor),
    bias: Bias,
    ts: f64,
    gravity: f64,
) -> f64 {
    if !(k_plus.0.is_finite() && k_minus.0.is_finite()) {
        return f64::NAN;
    }
    finite(gravity * ((f64::from(positive) / k_plus.0 + f64::from(negative) / k_minus.0) - bias.0 * ts))
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

/// The sample flags that do not depend on a table.
fn flags_without_table(raw: &RawSample) -> Flags {
    let mut flags = Flags::default();
    if !has_valid_interval(raw) {
        flags |= Flags::INTERVAL;
    }
    for index in 0..AXES {
        if !(raw.head_temperature[index].is_finite() && raw.board_temperature[index].is_finite()) {
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
        table: id,
        flags: compensation.flags.0,
        latency_ns: 0,
    }
}
