//! What is wrong with a file.

use core::fmt;
use isotherm_support::failure::shown;
use std::path::Path;

/// One fault of a file.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Fault {
    /// Line, from 1.
    pub line: usize,
    /// The key as a path, for example `axis.A1.bias.c2`; empty if the fault concerns no key.
    pub key: String,
    /// What is wrong, and what to write instead.
    pub message: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.key.as_str() {
            "" => write!(f, "line {}: {}", self.line, self.message),
            key => write!(f, "line {}: {key}: {}", self.line, self.message),
        }
    }
}

/// All faults of a file, in the order of its lines.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub struct Faults(pub Vec<Fault>);

impl Faults {
    /// One line for each fault of the file of this name: `file:line: key: message`.
    #[must_use]
    pub fn of(&self, name: &Path) -> String {
        let name = shown(name);
        let line = |Fault { line, key, message }: &Fault| {
            let colon = if key.is_empty() { "" } else { ": " };
            format!("{name}:{line}: {key}{colon}{message}")
        };
        self.0.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, fault) in self.0.iter().enumerate() {
            if index > 0 {
                f.write_str("\n")?;
            }
            write!(f, "{fault}")?;
        }
        Ok(())
    }
}
