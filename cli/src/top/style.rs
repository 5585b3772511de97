//! Colours and characters, or what stands for them where there are none.

use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::bar;

/// What the terminal can show.
#[derive(Clone, Copy, Debug)]
pub struct Theme {
    /// Colours; else weight and inversion.
    pub colour: bool,
    /// Characters beyond ASCII.
    pub unicode: bool,
}

/// How much something matters.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub enum Weight {
    /// As it should be.
    Good,
    /// To be looked at.
    Warning,
    /// Increments are missing or wrong, or a table is not in force.
    Bad,
}

impl Theme {
    /// Of something that matters that much.
    pub fn weight(self, weight: Weight) -> Style {
        let plain = Style::new();
        match (weight, self.colour) {
            (Weight::Good, true) => plain.fg(Color::Green),
            (Weight::Good, false) => plain,
            (Weight::Warning, true) => plain.fg(Color::Yellow),
            (Weight::Warning, false) => plain.add_modifier(Modifier::BOLD),
            (Weight::Bad, true) => plain.fg(Color::Red).add_modifier(Modifier::BOLD),
            (Weight::Bad, false) => plain.add_modifier(Modifier::BOLD | Modifier::REVERSED),
        }
    }

    /// Of what names other things.
    pub fn label(self) -> Style {
        if self.colour { Style::new().fg(Color::Cyan) } else { Style::new() }
    }

    /// Of headings.
    pub const fn heading(self) -> Style {
        Style::new().add_modifier(Modifier::BOLD)
    }

    /// Of what is selected, and of bars across the screen.
    pub const fn inverse(self) -> Style {
        Style::new().add_modifier(Modifier::REVERSED)
    }

    /// Of curves.
    pub fn curve(self) -> Style {
        if self.colour { Style::new().fg(Color::Blue) } else { Style::new() }
    }

    /// Bars in eighths, or nearly.
    pub const fn bars(self) -> bar::Set<'static> {
        if self.unicode {
            bar::NINE_LEVELS
        } else {
            bar::Set {
                full: "#",
                seven_eighths: "#",
                three_quarters: "+",
                five_eighths: "+",
                half: "-",
                three_eighths: "-",
                one_quarter: "_",
                one_eighth: "_",
                empty: " ",
            }
        }
    }

    /// The line of a gauge and its marker.
    pub const fn gauge(self) -> (char, char) {
        if self.unicode { ('─', '●') } else { ('-', 'o') }
    }

    /// A rule across the screen.
    pub const fn rule(self) -> &'static str {
        if self.unicode { "─" } else { "-" }
    }
}
