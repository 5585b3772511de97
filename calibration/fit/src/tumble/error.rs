//! Why an IMU cannot be calibrated by gravity's length.

use isotherm_campaign::StaticPoseError;
use isotherm_shared::table::ContentFault;

/// Why no table can be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TumbleError {
    /// A recording has no usable static pose.
    #[error("{name}: {error}")]
    StaticPose {
        /// Name of the recording.
        name: String,
        /// Why.
        error: StaticPoseError,
    },
    /// A static pose to leave out does not exist.
    #[error("there is no static pose {0}; there are {1}")]
    NothingToExclude(usize, usize),
    /// An option does not go with these recordings.
    #[error("{0}")]
    Options(String),
    /// The attitudes do not determine all parameters.
    #[error("{message}: {}; put the IMU down {attitude}{remedy}", parameters.join(", "))]
    Attitudes {
        /// What is wrong.
        message: String,
        /// The parameters that are determined worst, or not at all.
        parameters: Vec<String>,
        /// The attitude that helps most, in words.
        attitude: String,
        /// How many attitudes there are, which are missing, and what else helps.
        remedy: String,
    },
    /// The data do not allow what is asked for.
    #[error("{0}")]
    Refused(String),
    /// The result is not a valid table.
    #[error("the result is not a valid table: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Table(Vec<ContentFault>),
}
