//! A calibration from files: read, hash, fit, seal, report; and a verification run. The command, an automatic campaign
//! and Python differ in their arguments only.
//!
//! There are three ways to measure, and each has its entry: a campaign on a [turntable](Inputs::turntable) in the
//! chamber, a [tumble](Inputs::tumble) in many attitudes by hand, and a [warm-up](Inputs::warm_up) at one attitude.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_fit::CalibrationOptions;
//! use isotherm_pipeline::{CampaignFile, InputOptions, Inputs, no_bar};
//! use std::path::Path;
//!
//! let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/campaign/campaign.toml");
//! let file = CampaignFile::read(&path)?;
//! let campaign = file.campaign(None)?;
//! let (options, input) = (CalibrationOptions::default(), InputOptions::default());
//! let inputs = Inputs::turntable(&campaign, &file, Vec::new(), options, &input, &no_bar);
//! let inputs = inputs.map_err(|refusal| refusal.failure)?;
//! let outcome = inputs.fit(&campaign, Some(&file)).map_err(|refusal| refusal.failure)?;
//! assert!(outcome.table.contains("digest = ") && outcome.fitted.findings().is_empty());
//! # Ok(())
//! # }
//! ```

mod calibrate;
mod clock;
mod describe;
mod files;
mod laid_out;
mod proposal;
mod samples;
mod vehicle;
mod verify;

pub use calibrate::{InputOptions, InputOrigin, Inputs, JobFailure, JobOutcome};
pub use clock::now;
pub use describe::{DescribedKind, FileDescription, FindingExplanation, ImuSummary, JobFitness, TemperatureSpan};
pub use files::{Bar, CampaignFile, no_bar};
pub use proposal::propose;
pub use samples::{PositionFile, RowSource};
pub use vehicle::{INSTANCE, Vehicle, VehicleImu};
pub use verify::VerificationRun;
