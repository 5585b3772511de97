//! SVG elements, and an estimate of the width of texts that needs no font.

use maud::{Markup, html};
use std::fmt::Write;

/// The SVG elements written so far.
pub(super) struct Svg(pub(super) String);

impl Svg {
    pub(super) fn add(&mut self, part: &Markup) {
        self.0 += &part.0;
    }

    pub(super) fn path(&mut self, class: &str, d: &str) {
        if !d.is_empty() {
            self.add(&html! { path class=(class) d=(d) {} });
        }
    }

    /// Text at the baseline position, followed by a note.
    pub(super) fn text(&mut self, class: &str, x: f64, y: f64, text: &str, note: &str) {
        self.add(&html! {
            text class=(class) x=(short(x)) y=(short(y)) {
                (text)
                @if !note.is_empty() { tspan.n dx="10" { (note) } }
            }
        });
    }
}

/// Path data of a polyline.
pub(super) fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    let mut d = String::new();
    for (index, (x, y)) in points.enumerate() {
        _ = write!(d, "{}{} {}", if index == 0 { 'M' } else { 'L' }, short(x), short(y)); // writing to a String cannot fail
    }
    d
}

/// Path data of one point of a series: circle, square, triangle or diamond, all of about the same area.
pub(super) fn shape(index: usize, x: f64, y: f64, r: f64) -> String {
    let start = |dx: f64, dy: f64| format!("M{} {}", short(x + dx), short(y + dy));
    let (small, large) = (short(r), short(1.3 * r));
    let (width, double) = (short(1.8 * r), short(2.0 * r));
    match index % 4 {
        0 => start(-r, 0.0) + &format!("a{small} {small} 0 1 0 {double} 0a{small} {small} 0 1 0-{double} 0z"),
        1 => start(-0.9 * r, -0.9 * r) + &format!("h{width}v{width}h-{width}z"),
        2 => start(0.0, -1.3 * r) + &format!("l{large} {double}h-{}z", short(2.6 * r)),
        _ => start(0.0, -1.3 * r) + &format!("l{large} {large}l-{large} {large}l-{large}-{large}z"),
    }
}

/// A coordinate with one decimal at most.
pub(super) fn short(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map_or(text.clone(), String::from)
}

/// Upper estimate of the width of a text, for the usual sans-serif fonts.
pub(super) fn text_width(text: &str) -> f64 {
    let width = |c: char| match c {
        '.' | ',' | ' ' | '\u{2009}' | 'i' | 'j' | 'l' | '|' | '\'' => 4.2,
        'A'..='Z' | 'm' | 'w' | '%' | '@' => 10.0,
        c if (c as u32) < 0x1100 || (0x2000..0x2300).contains(&(c as u32)) => 7.4,
        _ => 13.5,
    };
    text.chars().map(width).sum()
}

/// The text, cut with an ellipsis if it is wider than `width`.
pub(super) fn cut(text: &str, width: f64) -> String {
    if text_width(text) <= width {
        return text.into();
    }
    let mut used = 10.0;
    let fits = |c: &char| {
        used += text_width(c.encode_utf8(&mut [0; 4]));
        used <= width
    };
    text.chars().take_while(fits).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut() {
        assert_eq!(cut("Bias / 1e-6 g0", 120.0), "Bias / 1e-6 g0");
        for long in ["W".repeat(500), "漢".repeat(500), "ill".repeat(500)] {
            let short = cut(&long, 100.0);
            assert!(short.ends_with('…') && text_width(&short) <= 100.0 && text_width(&short) > 70.0, "{short}");
        }
    }

    #[test]
    fn coordinates_are_short() {
        assert_eq!([12.0, 12.04, -0.26].map(short), ["12", "12", "-0.3"]);
        assert_eq!(path([(0.0, 1.5), (2.0, 3.0)].into_iter()), "M0 1.5L2 3");
    }
}
