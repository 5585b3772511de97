//! Times as decimal numbers, to whole nanoseconds: never by way of a floating-point number.

/// A decimal number, with or without exponent, times a power of ten, to the nearest whole number.
pub(super) fn decimal_ns(text: &str, power: u32) -> Option<u64> {
    let (mantissa, exponent) = match text.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (text, 0),
    };
    let mantissa = mantissa.strip_prefix('+').unwrap_or(mantissa);
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    // Further digits are far below 1 ns, whatever the unit.
    let fraction = fraction.get(..fraction.len().min(20))?;
    let all = format!("{whole}{fraction}");
    if all.is_empty() || !all.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let exponent = exponent.checked_add(power as i32)?.checked_sub(fraction.len() as i32)?;
    scaled(all.parse().ok()?, exponent)
}

/// `mantissa * 10^exponent`, to the nearest whole number.
pub(super) fn scaled(mantissa: u128, exponent: i32) -> Option<u64> {
    let factor = 10_u128.checked_pow(exponent.unsigned_abs());
    let value = match (factor, exponent < 0) {
        _ if mantissa == 0 => 0,
        (Some(factor), false) => mantissa.checked_mul(factor)?,
        // The factor is even. Half of it is not added before, since the sum may be over 2^128.
        (Some(factor), true) => mantissa / factor + u128::from(mantissa % factor >= factor / 2),
        (None, false) => return None,
        (None, true) => 0,
    };
    u64::try_from(value).ok()
}
