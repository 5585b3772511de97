//! Numbers as short as a screen needs them.

/// Nanoseconds as microseconds, without more digits than it has.
pub fn microseconds(ns: Option<u64>) -> String {
    let Some(ns) = ns else { return "-".to_owned() };
    let us = ns as f64 / 1e3;
    match us {
        ..9.995 => format!("{us:.2}"),
        ..999.95 => format!("{us:.1}"),
        _ => format!("{us:.0}"),
    }
}

/// A rate, without decimals unless it is small.
pub fn whole(rate: Option<f64>) -> String {
    match rate {
        Some(rate) if rate == 0.0 || rate >= 9.95 => format!("{rate:.0}"),
        Some(rate) => format!("{rate:.1}"),
        None => "-".to_owned(),
    }
}

/// A time that has passed, for people.
pub fn age(seconds: f64) -> String {
    let seconds = seconds.max(0.0) as u64;
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{} min", seconds / 60),
        7200..172_800 => format!("{} h", seconds / 3600),
        _ => format!("{} d", seconds / 86_400),
    }
}
