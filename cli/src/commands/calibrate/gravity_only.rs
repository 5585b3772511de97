//! `calibrate --gravity-only`: a table without a turntable, from recordings of an IMU that was put down by hand.

use super::arguments::{Calibrate, GravityOnlyArgs};
use isotherm_campaign::{Campaign, Place};
use isotherm_support::failure::{Exit, Failure};
use std::path::PathBuf;

impl GravityOnlyArgs {
    /// Refuses options that need a calibration without a turntable.
    pub(super) fn refuse_options(&self) -> Result<(), Failure> {
        let given = [
            ("--scale-factor", self.scale_factor.is_some()),
            ("--no-misalignment", self.no_misalignment),
            ("--window", self.window.is_some()),
            ("--temperature-range", self.temperature_range.is_some()),
        ];
        refuse(
            &given,
            "is for calibrations without a turntable: --gravity-only, or method = \"gravity-only\" in the campaign file",
        )
    }
}

fn refuse(given: &[(&str, bool)], why: &str) -> Result<(), Failure> {
    let wrong = given.iter().find(|(_, given)| *given);
    wrong.map_or(Ok(()), |(name, _)| Err(Failure::new(Exit::Usage, format!("{name} {why}"))))
}

impl Calibrate {
    /// The campaign that the options describe, whose recordings are the files.
    pub(super) fn described(&self) -> Option<(Campaign, Vec<PathBuf>)> {
        let args = &self.without_turntable;
        let place = args.latitude.zip(args.height).and_then(|(latitude, height)| Place::new(latitude, height).ok());
        let gravity_local = args.gravity_local.or(place.map(Place::normal_gravity))?;
        let gravity = [gravity_local, args.gravity_reference?];
        let campaign = Campaign::tumble(args.imu.clone()?, gravity, args.temperature_unit.as_deref()?);
        let campaign = match place {
            Some(place) if args.gravity_local.is_some() => campaign.at_place(place),
            Some(place) => campaign.with_normal_gravity(place),
            None => campaign,
        };
        let files = self.campaign.iter().chain(&self.samples).cloned().collect();
        Some((campaign, files))
    }

    /// Refuses what is said of data of other programs, which have neither set points nor positions.
    pub(super) fn refuse_foreign(&self) -> Result<(), Failure> {
        let given = [("--mapping or another option for data of other programs", self.foreign.is_given())];
        refuse(&given, "is for --gravity-only and --one-attitude; a campaign has recordings alone")
    }

    /// Refuses options that need a turntable.
    pub(super) fn refuse_turntable(&self) -> Result<(), Failure> {
        let given = [
            ("--method", self.method.is_some()),
            ("--alignment", self.alignment),
            ("--no-alignment", self.no_alignment),
            ("--lag", self.lag.is_some()),
        ];
        refuse(&given, "is for campaigns on a turntable; without one leave it out")
    }
}
