//! The two autopilots.

use crate::lines::Lines;
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// An autopilot with parameters for biases against temperature.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Autopilot {
    /// PX4: `TC_A0_X0_0` and others, in a `.params` file.
    Px4,
    /// ArduPilot: `INS_TCAL1_ACC1_X` and others, in a `.parm` file.
    ArduPilot,
}

impl Autopilot {
    /// Whose parameters of the temperature a text has; `None` if it has none, or those of both.
    #[must_use]
    pub fn of_text(text: &str) -> Option<Self> {
        let lines = Lines::parse(text);
        match (["TC_A", "TC_G"].iter().any(|begin| lines.any(begin)), lines.any("INS_TCAL")) {
            (true, false) => Some(Self::Px4),
            (false, true) => Some(Self::ArduPilot),
            _ => None,
        }
    }

    /// Both, with their names in options.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Px4, "px4"), (Self::ArduPilot, "ardupilot")];

    /// The name as its users write it.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Px4 => "PX4",
            Self::ArduPilot => "ArduPilot",
        }
    }

    /// Numbers of the instances: PX4 counts its IMUs from 0, ArduPilot from 1.
    #[must_use]
    pub const fn instances(self) -> RangeInclusive<u8> {
        match self {
            Self::Px4 => 0..=3,
            Self::ArduPilot => 1..=5,
        }
    }

    /// The instance that is given, or the first one.
    ///
    /// # Errors
    /// An instance that the autopilot does not have.
    pub(crate) fn instance(self, given: Option<u8>) -> Result<u8, InstanceError> {
        let instances = self.instances();
        let instance = given.unwrap_or(*instances.start());
        if instances.contains(&instance) { Ok(instance) } else { Err(InstanceError { autopilot: self, instance }) }
    }
}

impl fmt::Display for Autopilot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.title())
    }
}

impl FromStr for Autopilot {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::NAMES.iter().find(|(_, known)| *known == name);
        found.map(|(autopilot, _)| *autopilot).ok_or_else(|| format!("is {name:?}, give px4 or ardupilot"))
    }
}

/// An instance that the autopilot does not have.
#[derive(Clone, Copy, Debug, Eq, PartialEq, thiserror::Error)]
#[error(
    "the instance is {instance}; {autopilot} has {} to {}",
    self.autopilot.instances().start(),
    self.autopilot.instances().end()
)]
pub struct InstanceError {
    /// The autopilot.
    pub autopilot: Autopilot,
    /// The number that was given.
    pub instance: u8,
}
