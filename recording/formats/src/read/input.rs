//! What is known of the files of a recording, apart from their names.

use super::part::Part;
use super::table::ImuChoice;
use crate::convert::Foreign;

/// What is read of the files of a recording, and how.
#[derive(Clone, Debug)]
pub struct Input {
    /// The IMU whose rows are read, where a recording has several.
    pub imu: ImuChoice,
    /// How data of other programs are read, row by row as `isotherm convert` writes them; `None`: they are refused.
    pub foreign: Option<Foreign>,
    /// The part that is read, of each recording.
    pub part: Part,
}

impl Input {
    /// Only of this part of each recording.
    #[must_use]
    pub fn within(self, part: Part) -> Self {
        Self { part, ..self }
    }
}

/// Only recordings.
impl From<ImuChoice> for Input {
    fn from(imu: ImuChoice) -> Self {
        Self { imu, foreign: None, part: Part::default() }
    }
}

/// Recordings, and foreign data.
impl From<(ImuChoice, Foreign)> for Input {
    fn from((imu, foreign): (ImuChoice, Foreign)) -> Self {
        Self { imu, foreign: Some(foreign), part: Part::default() }
    }
}
