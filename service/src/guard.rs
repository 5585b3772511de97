//! Whether a new table may take the place of the one that was in force before: a lost digit must not go into the air.
//!
//! The tables are compared by [`TableDifference`], without errors or statistics. The table in force is kept in a folder
//! that outlives the service and its domain, so that a restart installs no table that a reload has refused. Somebody
//! who means the change accepts the table's digest with the command `reload`: by a [`Note`] in the domain's folder,
//! where nobody else can write.

use crate::config::Imu;
use isotherm_client::{Domain, ImuId, Note, ROOT_VARIABLE, STATE_VARIABLE};
use isotherm_files::{Trust, load_table, replace};
use isotherm_shared::table::difference::{Change, MaxChange, TableDifference};
use isotherm_shared::table::{CoefficientTable, Digest};
use rustix::fs::{FsWord, statfs};
use std::fs::DirBuilder;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::{env, io};
use tracing::warn;

/// Guards the table of one IMU.
#[derive(Debug)]
pub(crate) struct Guard {
    imu: ImuId,
    limits: MaxChange,
    acceptance: Note,
    /// Where the table in force is kept; `None` if it is not.
    kept: Option<PathBuf>,
    /// The last table in force, of this service or the one before.
    reference: Option<CoefficientTable>,
    changes: Vec<Change>,
}

/// A table that may be taken, and what it changes.
#[derive(Debug)]
pub(crate) struct Admission {
    /// Of each curve; empty if there is nothing to compare with.
    changes: Vec<Change>,
    /// The changes, or why there is no comparison, for the log.
    pub words: String,
}

/// The digest that is accepted for an IMU's table.
pub(crate) fn acceptance(domain: &Domain, imu: &ImuId) -> Note {
    Note::new(domain, &format!("accepted-{imu}"))
}

/// The table that was kept; `None` if there is none.
fn read_kept(path: &Path, imu: &ImuId) -> Result<Option<CoefficientTable>, String> {
    let failed = |error: io::Error| format!("{}: {error}", path.display());
    if !path.try_exists().map_err(failed)? {
        return Ok(None);
    }
    // Nobody else can write in this folder, whatever the permissions of the file are.
    check_owner(path.parent().unwrap_or(Path::new("/"))).map_err(failed)?;
    load_table(path, Some(imu), Trust::Any).map(|(table, _)| Some(table)).map_err(|error| error.to_string())
}

impl Guard {
    /// The guard of an IMU; reads which table was in force last. `folder` is that of [`state_folder`], if there is one.
    pub(crate) fn new(imu: &Imu, domain: &Domain, folder: Option<&Path>) -> Self {
        let kept = folder.map(|folder| folder.join(format!("{}.toml", imu.id)));
        let lost = |cause: String| warn!(imu = %imu.id, "the table that was in force last cannot be read: {cause}");
        let reference = kept.as_deref().and_then(|path| {
            read_kept(path, &imu.id).unwrap_or_else(|cause| {
                lost(cause);
                None
            })
        });
        let (imu, limits, acceptance) = (imu.id.clone(), imu.max_change, acceptance(domain, &imu.id));
        Self { imu, limits, acceptance, kept, reference, changes: Vec::new() }
    }

    /// Whether the operator has accepted the table of this digest.
    pub(crate) fn is_accepted(&self, digest: &str) -> bool {
        self.acceptance.read().is_some_and(|text| text.trim_ascii() == digest.as_bytes())
    }

    /// The largest changes of each curve by the table in force; empty if there was nothing to compare it with.
    pub(crate) fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Compares a table with the one that was in force last.
    ///
    /// # Errors
    /// Why it must not be taken: each curve with both values and the limit, and the remedy.
    pub(crate) fn admit(&self, table: &CoefficientTable) -> Result<Admission, String> {
        let alone = |words: &str| Ok(Admission { changes: Vec::new(), words: words.to_owned() });
        let Some(reference) = &self.reference else {
            return alone("it is not known which table was in force before, so it is compared with none");
        };
        if reference.digest() == table.digest() {
            return Ok(Admission { changes: self.changes.clone(), words: "the same as before".to_owned() });
        }
        let difference = TableDifference::of(reference, table);
        let refusals = self.limits.refusals(&difference);
        let accepted = !refusals.is_empty() && self.is_accepted(&table.digest().to_string());
        if !refusals.is_empty() && !accepted {
            return Err(self.refusal(&refusals, reference.digest(), table.digest()));
        }
        let words = format!("{difference}{}", if accepted { "; accepted by its digest" } else { "" });
        Ok(Admission { changes: difference.changes, words })
    }

    fn refusal(&self, refusals: &[String], from: &Digest, to: &Digest) -> String {
        /// So many lines leave room for the remedy.
        const MOST: usize = 8;
        let imu = &self.imu;
        let mut lines: Vec<_> = refusals.iter().take(MOST).cloned().collect();
        if let Some(more) = refusals.len().checked_sub(MOST).filter(|more| *more > 0) {
            lines.push(format!("and {more} more changes are too large"));
        }
        format!(
            "{}\nthis is too much for another calibration of the same IMU, compared with the table that was in force last, {from}; correct \
             the file, bring that table back, or accept this one with the command `reload --imu {imu} --accept {to}`",
            lines.join("\n")
        )
    }

    /// Notes that an admitted table is in force now: keeps it, and uses up any acceptance.
    pub(crate) fn taken(&mut self, table: &CoefficientTable, admission: Admission) {
        self.changes = admission.changes;
        // An acceptance that was not needed does not wait for a later table.
        self.acceptance.remove();
        // A table that was kept without its provenance could not be told from one that is no calibration.
        let provenance = if table.is_nominal() { "" } else { "\n[provenance]\ntool = \"isothermd\"\n" };
        let text = format!("# The table that was in force last.\n{}{provenance}", table.to_toml());
        if let Some(path) = &self.kept
            && let Err(error) = keep(path, &text)
        {
            warn!(
                imu = %self.imu,
                "keeping the table in force as {}: {error}; the next start compares with an older one, or with none; name a folder that this \
                 user may write in {STATE_VARIABLE}",
                path.display()
            );
        }
        self.reference = Some(table.clone());
    }
}

/// The folder in which the tables in force of `domain` are kept. It need not exist.
///
/// # Errors
/// Why there is none.
pub(crate) fn state_folder(domain: &Domain) -> Result<PathBuf, &'static str> {
    let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    // systemd names several folders with colons between them.
    let systemd =
        || env::var("STATE_DIRECTORY").ok()?.split(':').next().filter(|path| !path.is_empty()).map(PathBuf::from);
    // A domain that was given a folder of its own keeps what it has beside it.
    let root = || set(ROOT_VARIABLE).and_then(|_| Some(Path::new(domain.root_path()).parent()?.join(".state")));
    let user =
        || set("XDG_STATE_HOME").or_else(|| Some(set("HOME")?.join(".local/state"))).map(|path| path.join("isotherm"));
    let folder = set(STATE_VARIABLE).or_else(systemd).or_else(root).or_else(user);
    Ok(folder.ok_or("this user has no home folder")?.join(domain.name()))
}

/// Writes a file into the state folder, which is made if necessary.
fn keep(path: &Path, text: &str) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("/"));
    DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    check_owner(folder)?;
    replace(path, text)
}

/// What others can write is not believed.
fn check_owner(folder: &Path) -> io::Result<()> {
    let found = folder.metadata()?;
    let own = found.uid() == rustix::process::geteuid().as_raw() && found.mode() & 0o022 == 0;
    if own { Ok(()) } else { Err(io::Error::other("its folder belongs to another user, or others may write it")) }
}

/// Says so if the tables in force are not kept over a power cycle.
pub(crate) fn tell_if_not_kept(folder: &Result<PathBuf, &'static str>) {
    let cause = match folder {
        Ok(folder) if statfs(folder).is_ok_and(|found| found.f_type == TMPFS) => {
            format!("{} is in memory", folder.display())
        }
        Ok(_) => return,
        Err(cause) => (*cause).to_owned(),
    };
    warn!(
        "a power cycle forgets which tables were in force, and the next start takes any: {cause}; name another folder in {STATE_VARIABLE}"
    );
}

/// `TMPFS_MAGIC` of statfs(2).
const TMPFS: FsWord = 0x0102_1994;
