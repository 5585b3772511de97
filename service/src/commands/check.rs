//! What `check` validates in a service configuration.

use crate::config::{Config, WorkerRealtime};
use isotherm_client::{Realtime, check_room};
use isotherm_documents::{LoadError, load_table};
use isotherm_files::Trust;
use isotherm_support::failure::{Failure, shown};
use std::path::Path;

/// Validates the text of a configuration, and the tables that it names. Returns a line for the operator, and warnings.
///
/// # Errors
/// All its faults, or those of its tables.
pub fn configuration(text: &str, path: &Path, trust: Trust) -> Result<(String, Vec<String>), Failure> {
    let config = Config::from_toml(text, path.parent().unwrap_or(Path::new("")));
    let config = config.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    let (mut failures, mut warnings) = (Vec::new(), refused_here(&config));
    for imu in &config.imus {
        match load_table(&imu.table, Some(&imu.id), trust) {
            Ok((table, _)) => {
                let unlike = table.content().unlike_scale_factors().into_iter();
                warnings.extend(unlike.map(|warning| format!("{}: {warning}", shown(&imu.table))));
            }
            Err(error) => failures.push(error.into()),
        }
    }
    Failure::all(failures).map_or(Ok(()), Err)?;
    Ok((format!("service configuration of {} IMUs, their tables valid", config.imus.len()), warnings))
}

/// What `serve` would refuse of a configuration on this machine, with the rights of this process.
fn refused_here(config: &Config) -> Vec<String> {
    let WorkerRealtime { cores, priority, lock_memory, timer_slack_ns } = &config.realtime;
    let (priority, lock_memory, timer_slack_ns) = (*priority, *lock_memory, Some(*timer_slack_ns));
    let once = Realtime { core: cores.first().copied(), priority, lock_memory, timer_slack_ns };
    let others = cores.iter().skip(1).map(|core| Realtime { core: Some(*core), ..Realtime::default() });
    let refusals = [once].into_iter().chain(others).flat_map(|setting| setting.refusals());
    let refusals = refusals.map(|error| format!("realtime.{error}"));
    let room = check_room(config.imus.len()).err().map(|error| error.to_string());
    refusals.chain(room).map(|refusal| format!("serve would refuse it here: {refusal}")).collect()
}
