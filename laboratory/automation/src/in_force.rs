//! The table that an installation would replace. What a new table must show is in [`isotherm_verification::Gate`].

use super::plan::Plan;
use isotherm_documents::load_table;
use isotherm_files::{Identity, Trust};
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::Path;
use std::{fs, io};

/// The table that an installation would replace.
pub struct InForce {
    /// The table.
    pub table: CoefficientTable,
    /// The state of its file.
    pub state: Identity,
}

impl InForce {
    /// The table in the file `target`; `None` if there is no file.
    ///
    /// # Errors
    /// If the table cannot be read, or is for another IMU or other temperature than the plan: it can then not be
    /// compared with, and which axes the vehicle has is not known.
    pub fn read(target: &Path, plan: &Plan) -> Result<Option<Self>, Failure> {
        match fs::metadata(target) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Failure::io("reading the table in force", target, &error)),
            Ok(_) => {}
        }
        let place = shown(target);
        let (table, state) = load_table(target, None, Trust::Any).map_err(|error| {
            let failure = Failure::from(error);
            let message = format!(
                "{failure}\n{place}, the table in force, cannot be compared with; fix it (`isotherm rollback --imu {} {place}` brings a \
                 predecessor back), or move it away",
                plan.imu
            );
            Failure::new(failure.exit, message)
        })?;
        let refuse = |message: String| Err(Failure::new(Exit::Config, message));
        let (content, unit) = (table.content(), &plan.campaign.temperature_unit);
        if content.imu != plan.imu {
            return refuse(format!(
                "{place} is the table of {}, the plan is for {}; name another file in install",
                content.imu, plan.imu
            ));
        }
        if content.temperature_unit != *unit {
            return refuse(format!(
                "{place}, the table in force, takes temperature in {}, the plan is for {unit}; correct the plan, or move the table away if the \
                 acquisition has changed",
                content.temperature_unit
            ));
        }
        Ok(Some(Self { table, state }))
    }
}
