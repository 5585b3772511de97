//! The rate or the interval that a text says in a line above its header, as "// Sample rate: 120.0Hz".

/// What a rate is called by, and words that may stand before it.
const RATES: [&str; 8] = ["rate", "fs", "odr", "frequency", "freq", "samplerate", "samplingrate", "hz"];
const INTERVALS: [&str; 4] = ["interval", "period", "dt", "ts"];
const BEFORE: [&str; 18] = [
    "sample",
    "sampling",
    "samples",
    "output",
    "update",
    "data",
    "imu",
    "log",
    "logging",
    "logger",
    "sensor",
    "sensors",
    "measurement",
    "recording",
    "acquisition",
    "nominal",
    "the",
    "raw",
];
/// Units that are none of a rate of rows.
const OTHER: [&str; 8] = ["baud", "bps", "kbps", "fps", "s", "ms", "dps", "deg"];
/// Intervals that a mapping takes \[s\].
const RANGE: std::ops::RangeInclusive<f64> = 1e-6..=3600.0;

enum Token {
    Word(String),
    Number(f64),
}

/// The nominal interval \[s\] that these lines say; `None` if none says it, or if they disagree.
pub(super) fn interval_s<'a>(lines: impl Iterator<Item = &'a str>) -> Option<(f64, &'a str)> {
    let mut found: Option<(f64, &str)> = None;
    for line in lines {
        let Some(seconds) = of_line(line) else { continue };
        match found {
            Some((other, _)) if (other / seconds - 1.0).abs() > 1e-9 => return None,
            Some(_) => {}
            None => found = Some((seconds, line)),
        }
    }
    found
}

fn of_line(line: &str) -> Option<f64> {
    let tokens = tokens(line);
    let word = |at: usize| match tokens.get(at) {
        Some(Token::Word(word)) => Some(word.as_str()),
        _ => None,
    };
    let number = |at: usize| match tokens.get(at) {
        Some(Token::Number(number)) => Some(*number),
        _ => None,
    };
    for at in 0..tokens.len() {
        let Some(key) = word(at) else { continue };
        let is_key = at == 0 || word(at - 1).is_some_and(|before| BEFORE.contains(&before));
        let is_key = is_key || ["fs", "odr", "dt", "samplerate", "samplingrate"].contains(&key);
        // A unit or "is" may stand between.
        let (value, unit) = match (number(at + 1), number(at + 2)) {
            (Some(value), _) => (value, word(at + 2)),
            (None, Some(value)) if word(at + 1).is_some() => {
                let unit = word(at + 1).filter(|word| *word != "is" && *word != "in");
                (value, unit.or_else(|| word(at + 3)))
            }
            _ => continue,
        };
        let seconds = if is_key && RATES.contains(&key) {
            match unit {
                Some("khz") => 1e-3 / value,
                Some(unit) if OTHER.contains(&unit) => continue,
                _ => 1.0 / value,
            }
        } else if is_key && INTERVALS.contains(&key) {
            match unit {
                Some("s" | "sec" | "seconds") => value,
                Some("ms" | "milliseconds") => value / 1e3,
                Some("us" | "microseconds") => value / 1e6,
                None if key == "dt" => value,
                _ => continue,
            }
        } else {
            continue;
        };
        if RANGE.contains(&seconds) {
            return Some((seconds * 1e9).round() / 1e9);
        }
    }
    // "Sampled at 100 Hz"
    let is_sampled = (0..tokens.len()).any(|at| word(at).is_some_and(|word| word.starts_with("sampl")));
    let mut hertz = (1..tokens.len()).filter(|at| word(*at) == Some("hz")).filter_map(|at| number(at - 1));
    let seconds = hertz.next().filter(|_| is_sampled && hertz.next().is_none()).map(|hertz| 1.0 / hertz)?;
    RANGE.contains(&seconds).then_some((seconds * 1e9).round() / 1e9)
}

fn tokens(line: &str) -> Vec<Token> {
    let (mut tokens, mut rest) = (Vec::new(), line);
    while let Some(letter) = rest.chars().next() {
        let run = |is: fn(char) -> bool| rest.find(|letter: char| !is(letter)).unwrap_or(rest.len());
        let length = if letter.is_ascii_digit() {
            let length = run(|letter| letter.is_ascii_digit() || letter == '.');
            let number = rest[..length].trim_end_matches('.').parse();
            tokens.extend(number.ok().map(Token::Number));
            length
        } else if letter.is_alphabetic() {
            let length = run(char::is_alphabetic);
            tokens.push(Token::Word(rest[..length].to_lowercase()));
            length
        } else {
            letter.len_utf8()
        };
        rest = &rest[length..];
    }
    tokens
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_and_intervals_are_read_where_they_are_said() {
        for (line, seconds) in [
            ("// Sample rate: 120.0Hz", Some(0.008_333_333)),
            ("# rate 200 Hz", Some(0.005)),
            ("Fs = 100", Some(0.01)),
            ("Output rate,100", Some(0.01)),
            ("# Sampling Frequency (Hz): 416", Some(0.002_403_846)),
            ("% ODR: 1.6 kHz", Some(0.000_625)),
            ("// Update Rate: 100.0Hz", Some(0.01)),
            ("Sampled at 52 Hz", Some(0.019_230_769)),
            ("# sample interval = 5 ms", Some(0.005)),
            ("dt = 0.02", Some(0.02)),
            ("# sample rate is 50 Hz, range 16 g", Some(0.02)),
            ("Baud rate: 115200", None),
            ("# frame rate 30", None),
            ("# Angular rate 90 dps", None),
            ("# Firmware 2.5.1, scenario 5.9", None),
            ("# made by a logger", None),
            ("rate = 0", None),
            ("interval 7", None),
            ("", None),
        ] {
            assert_eq!(of_line(line), seconds, "{line}");
        }
        let both = ["accelerometer", "# rate 100 Hz", "// Sample rate: 100.0Hz"];
        assert_eq!(interval_s(both.into_iter()), Some((0.01, both[1])));
        assert_eq!(interval_s(["# rate 100 Hz", "# output rate 200 Hz"].into_iter()), None);
    }
}
