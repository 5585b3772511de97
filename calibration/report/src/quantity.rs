//! Numbers and units as a page prints them.
//!
//! Findings, reasons and verdicts are the same text in the terminal and on a page. The terminal gets ASCII; a page gets
//! the signs of print, by [`printed`], which every text of a page passes through.

/// A text with the signs of print: `1.2e-6 g0 +- 3 deg/h` is `1.2 µg ± 3 °/h`. Names of files and digests stay as they
/// are.
pub(crate) fn printed(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    let mut words = text.split_inclusive(char::is_whitespace).peekable();
    let mut is_micro = false;
    while let Some(word) = words.next() {
        let (word, space) = word.split_at(word.trim_end().len());
        let prefix = if core::mem::take(&mut is_micro) { "µ" } else { "" };
        let Some(number) = MachineNumber::of(word) else {
            out = out + prefix + &unit(word) + space;
            continue;
        };
        let MachineNumber { before, mantissa, exponent, after } = number;
        is_micro = exponent == -6 && after.is_empty() && words.peek().is_some_and(|next| takes_micro(next));
        if is_micro {
            // A scale, as in "Error / 1e-6 g0", has no number.
            let is_scale = !before.is_empty()
                || out.trim_end().ends_with(|c: char| c == '/' || c == ':' || c.is_ascii_digit())
                || text.trim_end().split(' ').count() == 2;
            out += before;
            out += if mantissa == "1" && is_scale { String::new() } else { format!("{mantissa} ") }.as_str();
        } else {
            out = out + before + &power(mantissa, exponent) + after + space;
        }
    }
    out
}

/// A number with an exponent, and the punctuation around it.
struct MachineNumber<'a> {
    before: &'a str,
    mantissa: &'a str,
    exponent: i32,
    after: &'a str,
}

impl<'a> MachineNumber<'a> {
    fn of(word: &'a str) -> Option<Self> {
        let begin = word.find(|c: char| c.is_ascii_digit() || c == '-')?;
        let end = word.rfind(|c: char| c.is_ascii_digit())? + 1;
        let (before, number, after) = (&word[..begin], word.get(begin..end)?, &word[end..]);
        let (mantissa, exponent) = number.split_once('e')?;
        // A serial number may look like 12e4; no figure of a program does.
        let is_figure = mantissa.contains('.') || exponent.starts_with('-');
        let is_number = mantissa.chars().all(|c| c.is_ascii_digit() || matches!(c, '.' | '-'));
        let mut around = before.chars().chain(after.chars());
        (is_figure && is_number && mantissa.parse::<f64>().is_ok() && !around.any(char::is_alphanumeric))
            .then_some(Self { before, mantissa, exponent: exponent.parse().ok()?, after })
    }
}

/// Whether the first word is a unit of which millionths have a name.
fn takes_micro(text: &str) -> bool {
    ["g0", "rad"].into_iter().any(|unit| {
        let rest = text.strip_prefix(unit).map(|rest| rest.strip_prefix('.').unwrap_or(rest));
        rest.is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
    })
}

/// `mantissa * 10^exponent`, with a power of ten only where the number is very large or very small.
fn power(mantissa: &str, exponent: i32) -> String {
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len()) as i32 - exponent;
    match format!("{mantissa}e{exponent}").parse::<f64>() {
        Ok(value) if (-4..6).contains(&exponent) => format!("{value:.*}", decimals.max(0) as usize),
        _ if mantissa == "1" => power_of_ten(exponent),
        _ => format!("{mantissa} × {}", power_of_ten(exponent)),
    }
}

/// `10⁻³`.
pub(crate) fn power_of_ten(exponent: i32) -> String {
    let raised = |c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).unwrap_or(digit),
    };
    format!("10{}", exponent.to_string().chars().map(raised).collect::<String>())
}

/// A word in which units have their signs.
fn unit(word: &str) -> String {
    let word = &word.replace("positive_scale_factor", "K+").replace("negative_scale_factor", "K-");
    match word.as_str() {
        "+-" => return "±".to_owned(),
        ".." => return "to".to_owned(),
        _ => {}
    }
    let is_file = word.starts_with(['/', '~']) || word.contains("sha256:") || {
        let mut pairs = word.chars().zip(word.chars().skip(1));
        pairs.any(|(dot, next)| dot == '.' && next.is_alphabetic() || dot == '\\')
    };
    if is_file {
        return word.clone();
    }
    if let Some((low, high)) = word.split_once("..") {
        let is_range =
            low.ends_with(|c: char| c.is_ascii_digit()) && high.starts_with(|c: char| "-0123456789".contains(c));
        return if is_range { format!("{low} to {high}") } else { word.clone() };
    }
    let mut out = String::with_capacity(word.len() + 4);
    let mut rest = word.as_str();
    while !rest.is_empty() {
        let end = rest.find(|c: char| !c.is_alphanumeric()).unwrap_or(rest.len());
        let (name, after) = rest.split_at(end);
        let stands = |c: Option<char>| c.is_none_or(|c| "/()[]*·,;:.²".contains(c));
        let sign = match name {
            "g0" => "g",
            "ug0" => "µg",
            "mg0" => "mg",
            "deg" => "°",
            "degC" => "°C",
            "urad" => "µrad",
            "s2" if out.ends_with('/') => "s²",
            "sqrt" if after.starts_with('(') => "√",
            _ => name,
        };
        let stands = sign != name && stands(out.chars().next_back()) && stands(after.chars().next());
        out += if stands { sign } else { name };
        // The root is of the one unit in the parentheses.
        let inner = after.strip_prefix('(').and_then(|inner| inner.split_once(')')).filter(|_| stands && sign == "√");
        rest = match inner {
            Some((inner, after)) => {
                out += inner;
                after
            }
            None => {
                let separator = after.chars().next().map_or(0, char::len_utf8);
                out += if after.starts_with('*') { "·" } else { &after[..separator] };
                &after[separator..]
            }
        };
    }
    out
}

/// A text as a sentence: with a capital at its beginning, unless that is a name, and a full stop at its end.
pub(crate) fn sentence(text: &str) -> String {
    let is_word = text.split(' ').next().is_some_and(|word| word.chars().all(|c| c.is_ascii_lowercase()));
    let mut rest = text.chars();
    let first = rest.next().filter(|_| is_word).map(|first| first.to_ascii_uppercase());
    let rest = if first.is_some() { rest.as_str() } else { text };
    let stop = if rest.ends_with(['.', ':']) || rest.is_empty() { "" } else { "." };
    first.into_iter().collect::<String>() + rest + stop
}

/// A unit as it stands behind a quantity and a stroke.
pub(crate) fn divisor(unit: &str) -> String {
    if unit.contains(['/', ' ']) { format!("({unit})") } else { unit.to_owned() }
}

/// A number with so many significant digits; a dash if it is not finite.
pub(crate) fn digits(value: f64, digits: i32) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let power = libm::log10(value.abs()).floor() as i32;
    if (-4..6).contains(&power) {
        format!("{value:.*}", (digits - 1 - power).max(0) as usize)
    } else {
        printed(&format!("{value:.*e}", (digits - 1).max(0) as usize))
    }
}

/// A value with its unit, in the prefix that fits it.
pub(crate) fn with_unit(value: f64, unit: &str) -> String {
    let (factor, unit) = fitting(unit, value.abs());
    format!("{} {unit}", digits(value * factor, 3))
}

/// The unit in which values of this `size` are read without a power of ten, and the factor from `unit` to it.
pub(crate) fn fitting(unit: &str, size: f64) -> (f64, String) {
    match unit.strip_prefix("g0") {
        Some(rest) if size < 0.5e-3 => (1e6, format!("ug0{rest}")),
        Some(rest) if size < 0.5 => (1e3, format!("mg0{rest}")),
        _ => (1.0, unit.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_the_terminal_have_the_signs_of_print() {
        for (text, right) in [
            ("off by 1520.1e-6 g0 rms, or -3.2e-6 rad.", "off by 1520.1 µg rms, or -3.2 µrad."),
            ("Error / 1e-6 g0", "Error / µg"),
            ("rms [1e-6 g0], and", "rms [µg], and"),
            ("Unit: 1e-6 g0 in every row", "Unit: µg in every row"),
            ("1e-6 g0", "µg"),
            ("moves it by 3.123e0 1e-6 g0", "moves it by 3.123 µg"),
            ("An error of 1e-6 g0 tilts", "An error of 1 µg tilts"),
            ("1.25 +- 0.02 ug0", "1.25 ± 0.02 µg"),
            ("from 0.5 .. 5.5 degC, -1.5..2", "from 0.5 to 5.5 °C, -1.5 to 2"),
            ("3.123e0, (2.5e-3), 1.25e-9 and 4.5e12", "3.123, (0.0025), 1.25 × 10⁻⁹ and 4.5 × 10¹²"),
            ("below 1e-6 of it", "below 10⁻⁶ of it"),
            ("deg/sqrt(h) deg/h/g0 g0/(s sqrt(Hz))", "°/√h °/h/g g/(s √Hz)"),
            ("pulse/(s*g0) at 9.8 m/s2; mm/s2.", "pulse/(s·g) at 9.8 m/s²; mm/s²."),
            ("1 g0 of the base, 0.1 deg about", "1 g of the base, 0.1 ° about"),
        ] {
            assert_eq!(printed(text), right);
        }
    }

    #[test]
    fn names_and_digests_stay() {
        for text in [
            "sha256:12e45 1e4 12e4 g0.csv /data/g0/deg/h x-deg deg_1 runs/1.5e-6.csv",
            "12e34567890123456789 degrees, g00, -",
            "漢e-6 1é2e-3 \t\n e e-6 .e-6 1.2.3e-4",
        ] {
            assert_eq!(printed(text), text);
        }
    }

    #[test]
    fn a_sentence_begins_with_a_capital_but_a_name_stays() {
        let shown = ["no rows heat", "heating.BIN: it moves", "A1: off.", "run: off", "imu-b is off", ""].map(sentence);
        assert_eq!(shown, ["No rows heat.", "heating.BIN: it moves.", "A1: off.", "run: off.", "imu-b is off.", ""]);
    }

    #[test]
    fn figures_have_their_digits() {
        let shown = [0.0, 0.01234, 1.0, 12.345, 123.45, 12_345.6, 1.234e-7].map(|value| digits(value, 3));
        assert_eq!(shown, ["0", "0.0123", "1.00", "12.3", "123", "12346", "1.23 × 10⁻⁷"]);
        assert_eq!(digits(f64::NAN, 3), "–");
        assert_eq!(with_unit(-3.456e-3, "g0"), "-3.46 mg0");
        assert_eq!(fitting("g0/sqrt(Hz)", 4e-5), (1e6, "ug0/sqrt(Hz)".to_owned()));
    }
}
