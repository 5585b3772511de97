//! Numbers as short texts for the screen.

/// Nanoseconds as microseconds, with at most two decimals.
pub(super) fn microseconds(ns: Option<u64>) -> String {
    let Some(ns) = ns else { return "-".to_owned() };
    let us = ns as f64 / 1e3;
    match us {
        ..9.995 => format!("{us:.2}"),
        ..999.95 => format!("{us:.1}"),
        _ => format!("{us:.0}"),
    }
}

/// A rate, without decimals unless it is small.
pub(super) fn whole(rate: Option<f64>) -> String {
    match rate {
        Some(rate) if rate == 0.0 || rate >= 9.95 => format!("{rate:.0}"),
        Some(rate) => format!("{rate:.1}"),
        None => "-".to_owned(),
    }
}

/// An elapsed time in seconds, minutes, hours or days.
pub(super) fn age(seconds: f64) -> String {
    let seconds = seconds.max(0.0) as u64;
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{} min", seconds / 60),
        7200..172_800 => format!("{} h", seconds / 3600),
        _ => format!("{} d", seconds / 86_400),
    }
}
