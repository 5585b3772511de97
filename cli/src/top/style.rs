//! Colours and characters, and their replacements on terminals without them.

use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::bar;

/// What the terminal can show.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Theme {
    /// Colours; without them bold and inverse text is used.
    pub colour: bool,
    /// Characters beyond ASCII.
    pub unicode: bool,
}

/// How serious something is.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub(crate) enum AlertLevel {
    /// Normal.
    Good,
    /// Needs attention.
    Warning,
    /// Increments are missing or wrong, or a table is not in force.
    Bad,
}

impl Theme {
    /// Style of an alert level.
    pub(crate) fn level(self, level: AlertLevel) -> Style {
        let plain = Style::new();
        match (level, self.colour) {
            (AlertLevel::Good, true) => plain.fg(Color::Green),
            (AlertLevel::Good, false) => plain,
            (AlertLevel::Warning, true) => plain.fg(Color::Yellow),
            (AlertLevel::Warning, false) => plain.add_modifier(Modifier::BOLD),
            (AlertLevel::Bad, true) => plain.fg(Color::Red).add_modifier(Modifier::BOLD),
            (AlertLevel::Bad, false) => plain.add_modifier(Modifier::BOLD | Modifier::REVERSED),
        }
    }

    /// Style of labels.
    pub(crate) fn label(self) -> Style {
        if self.colour { Style::new().fg(Color::Cyan) } else { Style::new() }
    }

    /// Style of headings.
    pub(crate) const fn heading(self) -> Style {
        Style::new().add_modifier(Modifier::BOLD)
    }

    /// Style of the selection, and of bars across the screen.
    pub(crate) const fn inverse(self) -> Style {
        Style::new().add_modifier(Modifier::REVERSED)
    }

    /// Style of curves.
    pub(crate) fn curve(self) -> Style {
        if self.colour { Style::new().fg(Color::Blue) } else { Style::new() }
    }

    /// Characters of bars in eighths; ASCII has fewer levels.
    pub(crate) const fn bars(self) -> bar::Set<'static> {
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

    /// Characters of a gauge's line and of its marker.
    pub(crate) const fn gauge(self) -> (char, char) {
        if self.unicode { ('─', '●') } else { ('-', 'o') }
    }

    /// Character of a horizontal rule.
    pub(crate) const fn rule(self) -> &'static str {
        if self.unicode { "─" } else { "-" }
    }
}
