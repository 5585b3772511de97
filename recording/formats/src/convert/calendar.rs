//! Dates and times of ISO 8601 or as 31.12.2026, and times of a day.

/// What a field must be, for messages.
pub(super) const EXPECTED: &str =
    "a time of ISO 8601 from 1970 on, as 2026-05-01T12:34:56.789Z, or 01.05.2026 12:34:56, or hh:mm:ss";

/// The time of a text \[ns\], since 1970 or midnight, and whether it is one of a day. A time without a zone is UTC.
///
/// Read are `2026-05-01T12:34:56.789Z`, with a blank for the T, with a comma, with a zone as `+02:00`, and
/// `12:34:56.789`.
pub(crate) fn time_ns(text: &str) -> Option<(u64, bool)> {
    let text = text.trim();
    let Some((date, time)) = text.split_once(['T', 't', ' ']) else { return Some((of_day(text)?, true)) };
    let (time, zone_s) = zoned(time.trim_start())?;
    let seconds = i128::from(days(date)?) * 86_400 - i128::from(zone_s);
    let ns = seconds * 1_000_000_000 + i128::from(of_day(time)?);
    u64::try_from(ns).ok().map(|ns| (ns, false))
}

/// Whether a text is only a date, written with signs between its parts.
pub(super) fn is_date(text: &str) -> bool {
    text.contains(['-', '/', '.']) && days(text).is_some()
}

/// The time without its zone, and the zone's offset from UTC \[s\].
fn zoned(text: &str) -> Option<(&str, i64)> {
    if let Some(time) = text.strip_suffix(['Z', 'z']).or_else(|| text.strip_suffix("UTC")) {
        return Some((time.trim_end(), 0));
    }
    let Some(at) = text.rfind(['+', '-']) else { return Some((text, 0)) };
    let (time, zone) = text.split_at(at);
    let sign = if zone.starts_with('-') { -1 } else { 1 };
    let digits: String = zone[1..].chars().filter(|letter| *letter != ':').collect();
    let (hours, minutes) = match digits.len() {
        2 => (number(&digits)?, 0),
        4 => (number(&digits[..2])?, number(&digits[2..])?),
        _ => return None,
    };
    (hours < 24 && minutes < 60).then_some((time.trim_end(), sign * (hours * 3600 + minutes * 60)))
}

/// `hh:mm:ss` with any fraction \[ns\].
fn of_day(text: &str) -> Option<u64> {
    let mut parts = text.split(':');
    let (hours, minutes, seconds) = (number(parts.next()?)?, number(parts.next()?)?, parts.next()?);
    if parts.next().is_some() || hours > 23 || minutes > 59 {
        return None;
    }
    let seconds = seconds.replace(',', ".");
    let is_plain = seconds.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    let whole = seconds.split('.').next().filter(|whole| (1..=2).contains(&whole.len()));
    // 60 is a leap second.
    let ns =
        super::decimal::decimal_ns(&seconds, 9).filter(|ns| is_plain && whole.is_some() && *ns < 61_000_000_000)?;
    Some(ns + (hours * 3600 + minutes * 60).cast_unsigned() * 1_000_000_000)
}

/// Days since 1970 of `yyyy-mm-dd`, `yyyy/mm/dd`, `yyyymmdd` or `dd.mm.yyyy`.
fn days(text: &str) -> Option<i64> {
    let digits: String = match text.split('.').collect::<Vec<_>>()[..] {
        // The day comes first wherever dates have points.
        [day, month, year] if year.len() == 4 => format!("{year}{month:0>2}{day:0>2}"),
        _ => text.chars().filter(|letter| !['-', '/'].contains(letter)).collect(),
    };
    if digits.len() != 8 || !digits.is_ascii() {
        return None;
    }
    let (year, month, day) = (number(&digits[..4])?, number(&digits[4..6])?, number(&digits[6..])?);
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let months = [31, 28 + i64::from(is_leap), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let length = months.get(usize::try_from(month).ok()?.checked_sub(1)?)?;
    if !(1..=*length).contains(&day) || year < 1970 {
        return None;
    }
    let before = year - 1;
    let leap_days = before / 4 - before / 100 + before / 400 - 477;
    let in_year: i64 = months[..usize::try_from(month - 1).ok()?].iter().sum();
    Some((year - 1970) * 365 + leap_days + in_year + day - 1)
}

fn number(text: &str) -> Option<i64> {
    text.parse().ok().filter(|_| !text.is_empty() && text.len() <= 4 && text.bytes().all(|byte| byte.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_zones_and_times_of_a_day_are_read_exactly() {
        const NOON: u64 = 1_777_638_896_789_000_000;
        for text in [
            "2026-05-01T12:34:56.789Z",
            "2026-05-01 12:34:56.789",
            "2026-05-01T12:34:56,789+00:00",
            "2026-05-01T14:34:56.789+02:00",
            "2026-05-01T07:04:56.789-0530",
            "20260501T12:34:56.789Z",
            "2026/05/01 12:34:56.789",
            "01.05.2026 12:34:56,789",
            "1.5.2026 12:34:56.789",
        ] {
            assert_eq!(time_ns(text), Some((NOON, false)), "{text}");
        }
        assert_eq!(time_ns("1970-01-01T00:00:00Z"), Some((0, false)));
        assert_eq!(time_ns("2000-02-29T00:00:00.000000001"), Some((951_782_400_000_000_001, false)));
        assert_eq!(time_ns("2100-03-01T00:00:00"), Some((4_107_542_400_000_000_000, false)));
        assert_eq!(time_ns("12:34:56.5"), Some((45_296_500_000_000, true)));
        assert_eq!(time_ns("9:05:00"), Some((32_700_000_000_000, true)));
    }

    #[test]
    fn what_is_no_time_is_refused() {
        for text in [
            "",
            "12",
            "12:30",
            "24:00:00",
            "12:60:00",
            "12:00:61",
            "1:2:3:4",
            "2026-13-01T00:00:00",
            "2026-02-29T00:00:00",
            "1969-12-31T23:59:59Z",
            "2026-05-01",
            "2026-05-01T",
            "2026-05-01T12:00:00+25:00",
            "12:00:1e1",
            "\u{e9}:00:00",
            "2026-0\u{e9}-1T00:00:00",
            "12:00:-1",
            "32.01.2026 00:00:00",
            "1.13.2026 00:00:00",
            "1.5.26 00:00:00",
            "5/1/2026 12:00:00",
            "+1:00:00",
        ] {
            assert_eq!(time_ns(text), None, "{text}");
        }
    }
}
