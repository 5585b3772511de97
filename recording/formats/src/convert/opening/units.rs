//! Units of columns, as they stand in a line of their own below the names.

/// Units in lower case, except those with a `/`, a `^` or a degree sign.
const UNITS: [&str; 41] = [
    "-", "s", "sec", "secs", "second", "seconds", "ms", "msec", "us", "usec", "\u{b5}s", "ns", "nsec", "g", "mg", "g0",
    "mps2", "m.s-2", "ms-2", "dps", "mdps", "rps", "rad", "deg", "degc", "c", "celsius", "k", "ut", "mt", "gauss",
    "mgauss", "hz", "v", "mv", "pa", "hpa", "mbar", "count", "counts", "lsb",
];

/// Whether a field is a unit, with or without brackets.
pub(super) fn is_unit(field: &str) -> bool {
    let unit = field.trim_matches(['[', ']', '(', ')', '{', '}', ' ']).to_lowercase();
    let is_short = unit.chars().count() <= 20 && !unit.is_empty();
    // Of a rate, such as `rad s-1` or `m*s^-2`; never a time such as 12:30 or a date.
    let is_compound = unit.contains(['/', '^', '\u{b0}', '\u{b2}']) || unit.ends_with("s-1") || unit.ends_with("s-2");
    is_short && (UNITS.contains(&unit.as_str()) || is_compound && unit.chars().any(char::is_alphabetic))
}
