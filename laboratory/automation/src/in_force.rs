//! The table that an installation would replace: reading it, and what changes with the new one. What a new table must
//! show is in [`isotherm_verification::Gate`].

use super::plan::Plan;
use isotherm_client::{ImuId, Options, fetch_status};
use isotherm_documents::load_table;
use isotherm_files::{Identity, Trust};
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure, shown, tell};
use isotherm_verification::arcsec;
use std::path::Path;
use std::time::{Duration, Instant};
use std::{fs, io, thread};

/// Alignment matrices that turn the axes by less do not differ \[rad\]: two fits of one mounting differ by some 1e-6.
const SAME_AXES: f64 = 1e-5;
/// Longest time until the service has the installed table in force; it takes milliseconds if the service watches the
/// file.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Pause between two looks at the service's status.
const PAUSE: Duration = Duration::from_millis(50);

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

/// What changes in addition to the coefficients if `new` takes the place of `old`, the table in force, for the
/// operator.
#[must_use]
pub fn changes(old: &CoefficientTable, new: &CoefficientTable) -> Vec<String> {
    let (old, new) = (old.content(), new.content());
    let mut changes = Vec::new();
    let mut note = |name: &str, old: String, new: String| {
        if old != new {
            changes.push(format!("{name} was {old} in the table in force, is {new}"));
        }
    };
    let number = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| value.to_string());
    let name = |serial: &Option<String>| serial.clone().unwrap_or_else(|| "none".to_owned());
    let rate = |axes: &[Axis; AXES]| axes.each_ref().map(|axis| number(axis.max_rate)).join(", ");
    note("serial", name(&old.serial), name(&new.serial));
    note("max_age_s", number(old.max_age_s), number(new.max_age_s));
    note("max_rate", rate(&old.axes), rate(&new.axes));
    note("lag_s, which the acquisition must know,", number(old.lag_s), number(new.lag_s));
    note("nominal_interval_s", number(old.nominal_interval_s), number(new.nominal_interval_s));
    note("out_of_range", old.out_of_range.name().to_owned(), new.out_of_range.name().to_owned());
    match (old.alignment, new.alignment) {
        (Some(old), Some(new)) => {
            let turned = (new - old).abs().max();
            if turned > SAME_AXES {
                changes.push(format!(
                    "the alignment matrix turns the axes by up to {:.1} arcsec against the table in force: how the \
                     IMU sits on the fixture is in it; boresight the vehicle again",
                    arcsec(turned)
                ));
            }
        }
        (None, None) => {}
        (old, _) => {
            let [was, is] = if old.is_some() { ["with", "without"] } else { ["without", "with"] };
            changes.push(format!(
                "{is} an alignment matrix, the table in force is {was}: the axes turn; boresight the vehicle again"
            ));
        }
    }
    changes
}

/// Waits until the service's status shows that `imu` has the table in force.
///
/// # Errors
/// If the service refuses the table, or does not have it in force within [`TIMEOUT`].
pub(crate) fn wait_until_in_force(imu: &ImuId, table: &CoefficientTable, options: &Options) -> Result<(), Failure> {
    let begun = Instant::now();
    let digest = table.digest().to_string();
    loop {
        let mut is_refused = false;
        let cause = match fetch_status(options) {
            Ok(status) => match status.imus.into_iter().find(|served| served.id == imu.as_str()) {
                Some(served) if served.table.as_ref() == Some(&digest) => {
                    tell("isotherm", "the service has it in force");
                    return Ok(());
                }
                Some(served) => {
                    is_refused = served.refused_table.as_ref() == Some(&digest);
                    served.last_reload_error.unwrap_or_else(|| format!("it watches {}", served.table_file))
                }
                None => format!("it does not serve {imu}"),
            },
            Err(error) => error.to_string(),
        };
        if is_refused || begun.elapsed() > TIMEOUT {
            let message = format!("the table is installed, but the service does not have it in force: {cause}");
            return Err(Failure::new(Exit::Unavailable, message));
        }
        thread::sleep(PAUSE);
    }
}
