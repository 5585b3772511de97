//! From measurements of an IMU to a coefficient table: campaigns on a two-axis turntable in a temperature chamber,
//! ramps of the temperature, and a tumble.
//!
//! This crate opens no file, starts no thread and reads no clock: the time of a calibration is an argument.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_fit::{CalibrationOptions, calibrate, read_measurements};
//! use isotherm_campaign::Campaign;
//! use isotherm_recording::CampaignCsvReader;
//!
//! let campaign = Campaign::from_toml(include_str!("../../../examples/campaign/campaign.toml"))?;
//! let samples: &[u8] = include_bytes!("../../../examples/campaign/samples.csv");
//! let measurements = read_measurements(&campaign, CampaignCsvReader::new(samples)?)?;
//! let calibration = calibrate(&campaign, measurements, CalibrationOptions::default())?;
//! assert_eq!(calibration.table.content().imu.as_str(), "imu-paper");
//! assert!((0..3).all(|axis| calibration.residual_sd(axis) < 10e-6)); // g0
//! # Ok(())
//! # }
//! ```

mod accelerometers;
mod accuracy;
mod admit;
mod alignment;
mod calibrate;
mod checks;
mod diagnosis;
mod effects;
mod error;
mod gyroscopes;
mod joint;
mod level;
mod noise;
mod one_stage;
mod options;
mod orders;
mod outcome;
mod provenance;
mod quality;
mod ramps;
mod reduce;
mod rest;
mod result;
mod screen;
mod sensor;
mod table;
mod transients;
mod triad;
mod tumble;
mod warm_up;

pub use accelerometers::{accelerometers_observable, calibrate_accelerometers};
pub use accuracy::{Accuracy, largest_band, largest_interval};
pub use alignment::{AlignmentChoice, is_needed};
pub use calibrate::{calibrate, observable};

pub use checks::{check, set_points};
pub use error::CalibrationError;
pub use gyroscopes::observability::TriadObservability;
pub use gyroscopes::runs::implausible;
pub use gyroscopes::solution::GyroscopeSolution;
pub use gyroscopes::{FittedRun, GyroscopeCalibration, Measurements, RunPlace, is_alignment_needed, read_measurements};
pub use joint::OneStageError;
pub use noise::noise_of_dwells;
pub use one_stage::solve;
pub use options::{CalibrationOptions, Method};
pub use outcome::{CalibrationData, CalibrationOutcome};
pub use provenance::{CampaignSource, CurveErrors, HashingStream, Origin, TableFile, sha256, tool};
pub use ramps::{RampCalibration, calibrate_ramps};
pub use reduce::reduce;
pub use rest::{LeftOutCause, LeftOutPart, RowAccount};
pub use result::Calibration;
pub use screen::{BadKind, BadRow, BadRows};
pub use sensor::{ReducedSensor, TriadUnits};
pub use table::axis_of;
pub use transients::{
    BiasTransient, Condition, CurveSource, LagChoice, Prediction, RampRecording, TransientOptions, TransientVerdict,
    Transients, TransientsError, fit,
};
pub use triad::CalibratedTriad;
pub use tumble::reading::Reading;
pub use tumble::{
    Evidence, Groups, ScaleFactorChoice, TumbleCalibration, TumbleError, TumbleOptions, TumbleRecording,
    calibrate_tumble, error_of_magnitude, errors_of_means, temperature_steps,
};
pub use warm_up::{
    BEHIND_S, BiasCurve, LEAST_WARM_UP_SPAN, OnBoard, OnBoardCurve, OrderChoice, Spread, SweepPoint, SweepSpan,
    TriedOrder, WarmUpCalibration, WarmUpOptions, calibrate_warm_up,
};
