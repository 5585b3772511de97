//! Numbers as the autopilots' own files write them. Each is a float32 and reads back to the same one, so that it is
//! rounded once.

/// As in a `.params` file: the shortest digits, with an exponent under 1e-4.
pub(crate) fn shortest(value: f32) -> String {
    let text = format!("{value:?}");
    // The exponent has two digits at least.
    match text.split_once("e-") {
        Some((digits, exponent)) => format!("{digits}e-{exponent:0>2}"),
        None => text,
    }
}

/// As in a `.parm` file: without an exponent, with `decimals`, or with more where the value needs them.
pub(crate) fn decimal(value: f32, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.parse() == Ok(value) { text } else { value.to_string() }
}

/// A size for messages, with two or three digits.
#[must_use]
pub fn size(value: f64) -> String {
    match value {
        0.01..100.0 => format!("{value:.3}"),
        0.0 => "0".to_owned(),
        _ => format!("{value:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_look_as_in_the_files_of_the_autopilots() {
        let shortest = |value: f32| shortest(value);
        assert_eq!(shortest(0.0), "0.0");
        assert_eq!(shortest(-17.603_062), "-17.603062");
        assert_eq!(shortest(-8.825_049e-5), "-8.825049e-05");
        assert_eq!(shortest(1.2e-12), "1.2e-12");
        assert_eq!(shortest(0.001_25), "0.00125");
        assert_eq!((decimal(-17.6, 1), decimal(-17.603, 1)), ("-17.6".to_owned(), "-17.603".to_owned()));
        assert_eq!(decimal(1_353.387, 9), "1353.386962891");
        assert_eq!(decimal(1.2e-12, 9), "0.0000000000012");
    }

    #[test]
    fn every_number_reads_back_to_itself() {
        // Every bit pattern of a stride that is no power of two.
        for bits in (0..u32::MAX).step_by(100_003) {
            let value = f32::from_bits(bits);
            if value.is_finite() {
                for text in [shortest(value), decimal(value, 9), decimal(value, 1)] {
                    // As the ground station reads it: a double, then a float32.
                    assert_eq!(text.parse::<f64>().unwrap() as f32, value, "{text}");
                }
            }
        }
    }
}
