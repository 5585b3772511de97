//! Code that the targets share: samples with any bits, and the checks of every answer and every refusal.

use isotherm_shared::compensate::answer;
use isotherm_shared::document::Faults;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{CoefficientTable, OutOfRange};
use isotherm_shared::wire::{AXES, CompensatedIncrement, Flags, MAX_INTERVAL_NS, RawSample};

/// Size of a sample in shared memory \[bytes\].
pub const SAMPLE: usize = size_of::<RawSample>();

/// Checks that each fault has a line number within the text and a message.
pub fn check_faults(text: &str, faults: &Faults) {
    let lines = 1 + text.bytes().filter(|byte| *byte == b'\n').count();
    assert!((1..=101).contains(&faults.0.len()), "{} faults", faults.0.len());
    for fault in &faults.0 {
        assert!((1..=lines).contains(&fault.line), "line {} of {lines}: {fault}", fault.line);
        assert!(!fault.message.is_empty(), "{fault:?}");
    }
}

/// The sample with these bytes in shared memory.
#[must_use]
pub fn sample(bytes: &[u8; SAMPLE]) -> RawSample {
    let part = |at: usize| bytes[at..].first_chunk().copied().unwrap_or_default();
    let long = |at: usize| u64::from_ne_bytes(part(at));
    let double = |at: usize| f64::from_bits(long(at));
    let word = |at: usize| u32::from_ne_bytes(bytes[at..].first_chunk().copied().unwrap_or_default());
    RawSample {
        session: long(0),
        sequence: long(8),
        timestamp_ns: long(16),
        interval_ns: long(24),
        sent_ns: long(32),
        telemetry_ns: long(40),
        positive_pulses: [48, 52, 56].map(word),
        negative_pulses: [60, 64, 68].map(word),
        head_temperature: [72, 80, 88].map(double),
        board_temperature: [96, 104, 112].map(double),
    }
}

/// Whether two numbers are equal to the last bit; all NaNs count as equal.
#[must_use]
pub fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

/// Compensates a sample with any bits, and checks every guarantee about the answer.
pub fn checked(table: Option<&CoefficientTable>, raw: &RawSample) -> CompensatedIncrement {
    let found = answer(table, raw);
    let bits = found.velocity_increment.map(f64::to_bits);
    let again = answer(table, raw);
    assert_eq!((bits, found.flags), (again.velocity_increment.map(f64::to_bits), again.flags));
    assert_eq!((found.session, found.sequence), (raw.session, raw.sequence));
    assert_eq!((found.timestamp_ns, found.interval_ns), (raw.timestamp_ns, raw.interval_ns));
    assert_eq!((found.table, found.latency_ns), (table.map_or(0, CoefficientTable::id), 0));

    let invalid = raw.interval_ns == 0 || raw.interval_ns > MAX_INTERVAL_NS;
    let mut flags = Flags::default();
    let mut flag = |condition: bool, flag: Flags| flags |= if condition { flag } else { Flags::default() };
    flag(invalid, Flags::INTERVAL);
    flag(table.is_none(), Flags::NO_TABLE);
    // Axes that must have no increment, and axes whose extrapolation may overflow.
    let (mut without, mut may_overflow) = ([invalid || table.is_none(); AXES], [false; AXES]);
    for index in 0..AXES {
        let (head, board) = (raw.head_temperature[index], raw.board_temperature[index]);
        let finite = head.is_finite() && board.is_finite();
        flag(!finite, Flags::not_finite(index));
        without[index] |= !finite;
        let Some(content) = table.map(CoefficientTable::content) else { continue };
        let axis = &content.axes[index];
        let below = |p: &Polynomial, telemetry: f64| telemetry.is_finite() && telemetry < p.range()[0];
        let above = |p: &Polynomial, telemetry: f64| telemetry.is_finite() && telemetry > p.range()[1];
        let scale_factors = [&axis.positive_scale_factor, &axis.negative_scale_factor];
        let sides = [
            (below(&axis.bias, head), Flags::head_below(index)),
            (above(&axis.bias, head), Flags::head_above(index)),
            (scale_factors.iter().any(|p| below(p, board)), Flags::board_below(index)),
            (scale_factors.iter().any(|p| above(p, board)), Flags::board_above(index)),
        ];
        sides.iter().for_each(|side| flag(side.0, side.1));
        let outside = sides.iter().any(|side| side.0);
        without[index] |= outside && content.out_of_range == OutOfRange::Reject;
        may_overflow[index] = outside && content.out_of_range == OutOfRange::Extrapolate;
        let pulses = u64::from(raw.positive_pulses[index]) + u64::from(raw.negative_pulses[index]);
        let rate = pulses as f64 / (raw.interval_ns as f64 / 1e9);
        flag(!invalid && axis.max_rate.is_some_and(|limit| rate > limit), Flags::rate(index));
    }
    let age = raw.timestamp_ns.saturating_sub(raw.telemetry_ns) as f64 / 1e9;
    let limit = table.and_then(|table| table.content().max_age_s);
    flag(raw.telemetry_ns != 0 && limit.is_some_and(|limit| age > limit), Flags::TELEMETRY_STALE);
    assert_eq!(found.flags, flags.0, "{} instead of {flags}", Flags(found.flags));
    assert_eq!(flags.only(Flags::SAMPLE), flags);

    // An alignment combines the axes: what holds for one axis then holds for all.
    if table.is_some_and(|table| table.content().alignment.is_some()) {
        without = [without.contains(&true); AXES];
        may_overflow = [may_overflow.contains(&true); AXES];
    }
    for (index, dv) in found.velocity_increment.iter().enumerate() {
        assert!(!dv.is_infinite());
        assert!(dv.is_nan() || !without[index], "{dv} with {flags}");
        assert!(
            dv.is_finite() || without[index] || may_overflow[index],
            "no increment of A{}, {flags}: {raw:?}",
            index + 1
        );
    }
    found
}
