//! Numbers of a plan with a bound and a default; one beyond the bound is a fault, and the default replaces it.

use isotherm_shared::document::Section;

/// A number over 0, or `default`.
pub(super) fn positive(section: &Section<'_, '_>, key: &'static str, default: f64) -> f64 {
    let value = section.optional_number(key);
    section.refuse(key, value.filter(|v| *v <= 0.0).map(|v| format!("is {v:?}, give a number over 0")));
    value.unwrap_or(default)
}

/// A number not below 0, or `default`.
pub(super) fn not_negative(section: &Section<'_, '_>, key: &'static str, default: f64) -> f64 {
    let value = section.optional_number(key);
    section.refuse(key, value.filter(|v| *v < 0.0).map(|v| format!("is {v:?}, give a number from 0 up")));
    value.unwrap_or(default)
}

/// A number over 0 and up to `most`, or `default`.
pub(super) fn at_most(section: &Section<'_, '_>, key: &'static str, default: f64, limit: f64) -> f64 {
    let value = section.optional_number(key);
    let wrong = value.filter(|value| !(*value > 0.0 && *value <= limit));
    section.refuse(key, wrong.map(|value| format!("is {value:?}, give a number over 0 and up to {limit:?}")));
    value.unwrap_or(default)
}
