//! A calibration from files: read, hash, fit, seal, report; and a verification run. The command, an automatic campaign
//! and Python differ in their arguments only.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_fit::CalibrationOptions;
//! use isotherm_pipeline::{CampaignFile, FitOptions, Inputs, no_bar};
//! use std::path::Path;
//!
//! let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/campaign/campaign.toml");
//! let file = CampaignFile::read(&path)?;
//! let campaign = file.campaign(None)?;
//! let options = FitOptions { turntable: CalibrationOptions::default(), ..FitOptions::default() };
//! let inputs = Inputs::read(&campaign, Some(&file), Vec::new(), &options, &no_bar);
//! let inputs = inputs.map_err(|refused| refused.failure)?;
//! let made = inputs.fit(&campaign, Some(&file)).map_err(|refused| refused.failure)?;
//! assert!(made.table.contains("digest = ") && made.fitted.findings().is_empty());
//! # Ok(())
//! # }
//! ```

mod calibrate;
mod clock;
mod files;
mod laid_out;
mod proposal;
mod samples;
mod vehicle;
mod verify;

pub use calibrate::{FitOptions, Inputs, Made, Origin, Refused};
pub use clock::now;
pub use files::{Bar, CampaignFile, no_bar};
pub use proposal::propose;
pub use samples::{PositionFile, Source};
pub use vehicle::{INSTANCE, Vehicle, VehicleImu};
pub use verify::Run;
