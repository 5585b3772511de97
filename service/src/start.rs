//! Which table each IMU is served with at the start.
//!
//! Each IMU is decided by itself. If its file is refused, damaged or absent, it is served with the table that was in
//! force last; without one its increments are NaN, flagged `no-table`. The service does not start if no IMU can be
//! served, or if the configuration asks for that.

use crate::config::{AtStart, Config, Imu};
use crate::events::{FileChange, FileReport};
use crate::guard::Guard;
use crate::imu::{FirstTable, TableRefusal, log_unlike_scale_factors};
use isotherm_support::failure::{Exit, Failure, shown};
use tracing::{error, info, warn};

/// What became of an IMU's file.
#[derive(Debug)]
enum TableChoice {
    /// Its table is served.
    File,
    /// There is no file yet, and the command line allows that.
    Uncalibrated(Failure),
    /// The table that was in force last is served.
    Kept(Failure),
    /// There is nothing to serve.
    Nothing(Failure),
}

/// Chooses the first tables. `reports` says what was found in the files, in the order of the IMUs; `None` if a file has
/// not been read yet.
///
/// # Errors
/// Why the service must not start: the faults of all files together.
pub(crate) fn choose(
    config: &Config,
    guards: Vec<Guard>,
    reports: Vec<Option<FileReport>>,
    allow_uncalibrated: bool,
) -> Result<Vec<FirstTable>, Failure> {
    let chosen = config.imus.iter().zip(guards).zip(reports);
    let chosen: Vec<_> =
        chosen.map(|((imu, guard), report)| choose_one(imu, guard, report, allow_uncalibrated)).collect();
    let is_served = chosen.iter().any(|(choice, _)| matches!(choice, TableChoice::File | TableChoice::Kept(_)));
    let must_exit = |choice: &TableChoice| match choice {
        TableChoice::File | TableChoice::Uncalibrated(_) => false,
        TableChoice::Kept(_) => config.at_start == AtStart::Exit,
        TableChoice::Nothing(_) => config.at_start == AtStart::Exit || !is_served,
    };
    let (mut failures, mut tables) = (Vec::new(), Vec::new());
    for (imu, (choice, first)) in config.imus.iter().zip(chosen) {
        let exits = must_exit(&choice);
        match choice {
            TableChoice::Kept(failure) | TableChoice::Nothing(failure) if exits => failures.push(failure),
            choice => log(imu, &choice, &first),
        }
        tables.push(first);
    }
    Failure::all(failures).map_or(Ok(tables), Err)
}

fn choose_one(
    imu: &Imu,
    guard: Guard,
    report: Option<FileReport>,
    allow_uncalibrated: bool,
) -> (TableChoice, FirstTable) {
    let modified_unix_s = report.as_ref().and_then(FileReport::modified_unix_s);
    let judged = report.as_ref().and_then(FileReport::judged);
    let is_absent = report.as_ref().is_some_and(|report| report.is_absent);
    let accepted = guard.accepted();
    let invalid = |failure: Failure| {
        let refused = TableRefusal::now(failure.message.clone(), None, modified_unix_s);
        (failure, refused)
    };
    let (failure, refused) = match report.map(|report| report.change) {
        Some(FileChange::Loaded(table)) => match guard.admit(&table, &accepted) {
            Ok(admission) => {
                let table = Some((table, admission));
                let refused = None;
                let first = FirstTable { guard, table, modified_unix_s, judged, refused, waits: false, accepted };
                return (TableChoice::File, first);
            }
            Err(reason) => {
                let message = format!("{}: {reason}", shown(&imu.table));
                let refused = TableRefusal::now(message, Some(table), modified_unix_s);
                // A disk that does not answer may do so at the next start.
                let exit = if guard.memory().is_pending() { Exit::Io } else { Exit::Config };
                (Failure::new(exit, refused.text(&imu.id)).at(&imu.table, None), refused)
            }
        },
        Some(FileChange::Refused(error)) => invalid(Failure::from(error)),
        Some(FileChange::Unchanged) | None => {
            let message = format!("reading {}: its disk does not answer; see to the disk", shown(&imu.table));
            invalid(Failure::new(Exit::Io, message).at(&imu.table, None))
        }
    };
    let reference = guard.memory().reference().cloned();
    let table = reference.and_then(|table| guard.admit(&table, &accepted).ok().map(|admission| (table, admission)));
    let choice = match &table {
        Some(_) => TableChoice::Kept(failure),
        None if allow_uncalibrated && is_absent => TableChoice::Uncalibrated(failure),
        None => TableChoice::Nothing(failure),
    };
    let waits = matches!(choice, TableChoice::Uncalibrated(_));
    let refused = Some(refused);
    let first = FirstTable { guard, table, modified_unix_s: None, judged, refused, waits, accepted: Vec::new() };
    (choice, first)
}

fn log(imu: &Imu, choice: &TableChoice, first: &FirstTable) {
    let (id, file) = (&imu.id, shown(&imu.table));
    let line = |failure: &Failure| failure.message.replace('\n', "; ");
    match (choice, &first.table) {
        (TableChoice::File, Some((table, admission))) => {
            info!(imu = %id, table = %table.digest(), %file, "table loaded: {}", admission.words);
            log_unlike_scale_factors(imu, table);
        }
        (TableChoice::Kept(failure), Some((table, _))) => error!(
            imu = %id, table = %table.digest(), %file,
            "the table file is not taken, and the table that was in force last is served: {}", line(failure)
        ),
        (TableChoice::Uncalibrated(failure), _) => warn!(imu = %id, "no table yet, serving NaN: {}", line(failure)),
        (TableChoice::Nothing(failure), _) => error!(
            imu = %id, %file,
            "there is no table for this IMU, and the others are served: its increments are NaN, flagged no-table: {}", line(failure)
        ),
        (TableChoice::File | TableChoice::Kept(_), None) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::KeptTables;
    use isotherm_client::{Domain, ImuId};
    use isotherm_documents::LoadError;
    use isotherm_shared::table::CoefficientTable;
    use isotherm_shared::table::difference::MaxChange;
    use std::path::PathBuf;
    use std::sync::Arc;

    const TABLE: &str = include_str!("../../tests/data/imu-a.toml");

    /// The state of a table's file.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum FileState {
        Good,
        /// A table that changes too much.
        Far,
        /// One of another serial number, with other curves.
        OtherDevice,
        Damaged,
        Absent,
        /// Its disk does not answer.
        Silent,
    }
    use FileState::{Absent, Damaged, Far, Good, OtherDevice, Silent};

    fn table(serial: &str, from: &str, to: &str) -> Arc<CoefficientTable> {
        let text = TABLE.replacen("[imu]\n", &format!("[imu]\nserial = \"{serial}\"\n"), 1).replace(from, to);
        Arc::new(CoefficientTable::from_toml(&text, None).unwrap())
    }

    fn report(state: FileState) -> Option<FileReport> {
        let refused =
            |cause: &str| FileChange::Refused(LoadError::Io { path: PathBuf::from("t"), cause: cause.to_owned() });
        let change = match state {
            Good => FileChange::Loaded(table("7", "c0 = 793.55", "c0 = 793.56")),
            Far => FileChange::Loaded(table("7", "91733.0", "9173.0")),
            OtherDevice => FileChange::Loaded(table("8", "c0 = 793.55", "c0 = 793.56")),
            Damaged | Absent => refused("no such file"),
            Silent => return None,
        };
        Some(FileReport { change, state: None, is_absent: state == Absent, is_requested: false })
    }

    /// Serves IMUs with these files, and with a table from before or none. For each IMU the result has whether it has a
    /// table and whether its file is refused; an error has the number of messages.
    fn serve(
        imus: &[(FileState, bool)],
        at_start: AtStart,
        allow_uncalibrated: bool,
    ) -> Result<Vec<(bool, bool)>, usize> {
        let folder = tempfile::tempdir().unwrap();
        let domain = Domain::new("start", &folder.path().display().to_string()).unwrap();
        let imu = Imu::new(ImuId::new("imu-a").unwrap(), PathBuf::from("t"), MaxChange::default());
        let config = Config { imus: vec![imu.clone(); imus.len()], at_start, ..Config::default() };
        let memory = |is_kept: bool| {
            let mut memory = KeptTables::default();
            if is_kept {
                memory.take(&table("7", "", ""), false);
            }
            memory
        };
        let guards = imus.iter().map(|(_, is_kept)| Guard::new(&imu, &domain, memory(*is_kept))).collect();
        let reports = imus.iter().map(|(state, _)| report(*state)).collect();
        match choose(&config, guards, reports, allow_uncalibrated) {
            Ok(tables) => Ok(tables.iter().map(|first| (first.table.is_some(), first.refused.is_some())).collect()),
            Err(failure) => {
                assert!(matches!(failure.exit, Exit::Config | Exit::Io));
                Err(failure.message.matches("t: ").count())
            }
        }
    }

    #[test]
    fn beside_a_good_kept_table_no_file_ends_the_start() {
        for state in [Far, OtherDevice, Damaged, Absent, Silent] {
            assert_eq!(serve(&[(state, true)], AtStart::Keep, false), Ok(vec![(true, true)]), "{state:?}");
            assert!(serve(&[(state, true)], AtStart::Exit, false).is_err(), "{state:?}");
            assert_eq!(
                serve(&[(state, true)], AtStart::Keep, true),
                Ok(vec![(true, true)]),
                "{state:?}: kept before NaN"
            );
        }
        assert_eq!(serve(&[(Good, true), (Good, false)], AtStart::Keep, false), Ok(vec![(true, false); 2]));
        assert_eq!(serve(&[(OtherDevice, false)], AtStart::Keep, false), Ok(vec![(true, false)]));
    }

    #[test]
    fn a_start_that_can_serve_nothing_names_all_faults() {
        assert_eq!(serve(&[(Damaged, false), (Absent, false)], AtStart::Keep, false), Err(2));
        assert_eq!(serve(&[(Absent, false)], AtStart::Keep, true), Ok(vec![(false, true)]));
        assert_eq!(serve(&[(Absent, false), (Damaged, false)], AtStart::Keep, true), Err(1));
    }

    #[test]
    fn an_imu_of_which_nothing_is_known_does_not_stop_the_others() {
        for (state, known) in
            [Damaged, Absent, Silent].into_iter().zip([(Far, true), (Good, false), (OtherDevice, true)])
        {
            let served = serve(&[known, (state, false)], AtStart::Keep, false);
            assert_eq!(served, Ok(vec![(true, known.0 != Good), (false, true)]), "{state:?}");
            assert!(serve(&[(Good, true), (state, false)], AtStart::Exit, false).is_err());
        }
    }
}
