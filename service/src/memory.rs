//! Which tables were in force before, and the state folder that keeps them over a restart.
//!
//! For each IMU the folder has up to two files, each a table:
//!
//! | name | what |
//! |---|---|
//! | `IMU.toml` | the table that was in force last |
//! | `IMU.anchor.toml` | the anchor, with which small steps are compared |
//!
//! The anchor is the table of the first start, the first calibration after a nominal table, or the last table that was
//! accepted by its digest.
//!
//! `configuration.WORD.toml` is the text of the last configuration with which the service has started. The word stands
//! for the path of its file.
//!
//! What another user could have written or taken away is not believed.

use isotherm_client::{Domain, ImuId, Note, ROOT_VARIABLE, STATE_VARIABLE};
use isotherm_documents::{load_table, read_text};
use isotherm_files::{Trust, replace, uninterrupted};
use isotherm_shared::table::{CoefficientTable, UNSEALED};
use isotherm_support::failure::shown;
use rustix::fs::{FsWord, statfs};
use sha2::{Digest as _, Sha256};
use std::fs::{self, DirBuilder, File};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{env, io};

/// The tables of one IMU that a new one is compared with.
#[derive(Clone, Debug, Default)]
pub(crate) struct KeptTables {
    /// The table that was in force last.
    pub in_force: Option<Arc<CoefficientTable>>,
    /// The table of the first start, the first calibration after a nominal table, or the last one that was accepted.
    pub anchor: Option<Arc<CoefficientTable>>,
    /// The table that was kept last, if it cannot be read.
    pub forgotten: Option<ForgottenTable>,
}

/// A table that was in force last and cannot be read. Only a table of its digest, or one that is accepted, may follow.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) struct ForgottenTable {
    /// Its digest by the note in the domain's folder; `None` if there is no note.
    pub digest: Option<String>,
    /// Whether the disk of the state folder has not answered, so that it may still come.
    pub is_pending: bool,
}

impl KeptTables {
    /// What is known of an IMU while the disk of the state folder does not answer.
    pub(crate) fn pending(domain: &Domain, imu: &ImuId) -> Self {
        let forgotten = Some(ForgottenTable { digest: noted_digest(domain, imu), is_pending: true });
        Self { forgotten, ..Self::default() }
    }

    /// Whether the disk of the state folder has not answered.
    pub(crate) fn is_pending(&self) -> bool {
        self.forgotten.as_ref().is_some_and(|forgotten| forgotten.is_pending)
    }

    /// The table to compare a new one with, and to serve where there is no other.
    pub(crate) fn reference(&self) -> Option<&Arc<CoefficientTable>> {
        let anchor = self.anchor.as_ref().filter(|_| self.forgotten.is_none());
        self.in_force.as_ref().or(anchor)
    }

    /// Whether the table in force is the anchor.
    pub(crate) fn is_anchored(&self) -> bool {
        let digest = |table: &Option<Arc<CoefficientTable>>| table.as_ref().map(|table| *table.digest());
        digest(&self.in_force) == digest(&self.anchor)
    }

    /// Notes that this table is in force now. It becomes the anchor if it was accepted, if there is none, or if it is
    /// the first calibration after a nominal one.
    pub(crate) fn take(&mut self, table: &Arc<CoefficientTable>, accepted: bool) {
        // The same table without its digest is no unsealed table yet, so that none can follow it unnoticed.
        let is_unsealed = |before: &&Arc<CoefficientTable>| {
            before.digest() == table.digest() && before.is_sealed() && !table.is_sealed()
        };
        let table = &self.in_force.as_ref().filter(is_unsealed).unwrap_or(table).clone();
        self.in_force = Some(Arc::clone(table));
        if accepted || self.anchor.as_ref().is_none_or(|anchor| table.is_first_calibration_after(anchor)) {
            self.anchor = Some(Arc::clone(table));
        }
        self.forgotten = None;
    }
}

/// The digest of the table that was kept last for an IMU. It outlives the state folder, not a restart of the machine.
pub(crate) fn kept_note(domain: &Domain, imu: &ImuId) -> Note {
    Note::new(domain, &format!("kept-{imu}"))
}

/// The folder in which the tables of a domain are kept. It need not exist.
#[derive(Clone, Debug)]
pub(crate) struct StateFolder(PathBuf);

impl StateFolder {
    /// The folder that the environment of this process names.
    ///
    /// # Errors
    /// Why there is none.
    pub(crate) fn of(domain: &Domain) -> Result<Self, &'static str> {
        let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        // systemd names several folders with colons between them.
        let systemd =
            || env::var("STATE_DIRECTORY").ok()?.split(':').next().filter(|path| !path.is_empty()).map(PathBuf::from);
        // A domain that was given a folder of its own keeps what it has next to it.
        let root = || set(ROOT_VARIABLE).and_then(|_| Some(Path::new(domain.root_path()).parent()?.join(".state")));
        let user = || {
            set("XDG_STATE_HOME").or_else(|| Some(set("HOME")?.join(".local/state"))).map(|path| path.join("isotherm"))
        };
        let folder = set(STATE_VARIABLE).or_else(systemd).or_else(root).or_else(user);
        Ok(Self(folder.ok_or("this user has no home folder")?.join(domain.name())))
    }

    /// Reads what is kept for an IMU. The second part says what is kept and cannot be used.
    pub(crate) fn load(&self, domain: &Domain, imu: &ImuId) -> (KeptTables, Vec<String>) {
        let mut faults = Vec::new();
        let mut read = |name: &str| match self.read(name, imu) {
            Ok(table) => table.map(Arc::new),
            Err(cause) => {
                faults.push(cause);
                None
            }
        };
        let in_force = read(&format!("{imu}.toml"));
        let anchor = read(&format!("{imu}.anchor.toml")).or_else(|| in_force.clone());
        let noted = if in_force.is_none() { noted_digest(domain, imu) } else { None };
        let forgotten = noted.map(|digest| ForgottenTable { digest: Some(digest), is_pending: false });
        (KeptTables { in_force, anchor, forgotten }, faults)
    }

    /// The text of the configuration that was kept of the file at this path; `None` if there is none that can be
    /// believed.
    pub(crate) fn load_configuration(&self, file: &Path) -> Option<String> {
        check_owner(&self.0).ok()?;
        read_text(&self.configuration(file), Trust::Any).ok().map(|(text, _)| text)
    }

    /// Keeps the text of the configuration of the file at this path.
    ///
    /// # Errors
    /// The operating system's; what was kept before is then kept.
    pub(crate) fn store_configuration(&self, file: &Path, text: &str) -> io::Result<()> {
        self.make()?;
        if self.load_configuration(file).as_deref() == Some(text) {
            return Ok(());
        }
        replace(&self.configuration(file), text)
    }

    /// Where the configuration of the file at this path is kept. No name of an IMU has a dot.
    fn configuration(&self, file: &Path) -> PathBuf {
        let hash = Sha256::digest(file.as_os_str().as_encoded_bytes());
        let word: String = hash.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        self.0.join(format!("configuration.{word}.toml"))
    }

    /// Makes the folder, if it is not there, and checks whose it is.
    fn make(&self) -> io::Result<()> {
        if !self.0.is_dir() {
            DirBuilder::new().recursive(true).mode(0o700).create(&self.0)?;
            if let Some(parent) = self.0.parent() {
                // Some file systems cannot sync a folder.
                let _ = File::open(parent).and_then(|parent| parent.sync_all());
            }
        }
        check_owner(&self.0)
    }

    /// A table of the folder; `None` if there is none.
    fn read(&self, name: &str, imu: &ImuId) -> Result<Option<CoefficientTable>, String> {
        let path = self.0.join(name);
        let failed = |error: io::Error| format!("{}: {error}", shown(&path));
        // Another user may have made a folder that this user cannot enter.
        match check_owner(&self.0) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            checked => checked.map_err(failed)?,
        }
        if !path.try_exists().map_err(failed)? {
            return Ok(None);
        }
        // Nobody else can write in this folder, whatever the permissions of the file are.
        load_table(&path, Some(imu), Trust::Any).map(|(table, _)| Some(table)).map_err(|error| error.to_string())
    }

    /// Writes what is in `memory` and not in `kept`. The table in force comes last: until it is written, the one before
    /// is compared with.
    ///
    /// # Errors
    /// The operating system's; what was kept before is then kept.
    pub(crate) fn store(&self, imu: &ImuId, memory: &KeptTables, kept: &KeptTables) -> io::Result<()> {
        self.make()?;
        let files = [("anchor.toml", &memory.anchor, &kept.anchor), ("toml", &memory.in_force, &kept.in_force)];
        for (ending, table, before) in files {
            if let Some(table) = table
                && !before.as_ref().is_some_and(|before| is_same(before, table))
            {
                replace(&self.0.join(format!("{imu}.{ending}")), &text_of(table))?;
            }
        }
        Ok(())
    }

    /// Why a power cycle forgets what is in the folder; `None` if it does not.
    pub(crate) fn is_in_memory(&self) -> Option<String> {
        let in_memory = statfs(&self.0).is_ok_and(|found| found.f_type == TMPFS);
        in_memory.then(|| format!("{} is in memory", shown(&self.0)))
    }

    /// Where the table in force of an IMU is kept.
    pub(crate) fn path(&self, imu: &ImuId) -> PathBuf {
        self.0.join(format!("{imu}.toml"))
    }
}

/// The digest of the table that was kept last, by the note in the domain's folder.
fn noted_digest(domain: &Domain, imu: &ImuId) -> Option<String> {
    let digest = String::from_utf8(kept_note(domain, imu).read()?).ok()?;
    Some(digest.trim_ascii().to_owned()).filter(|digest| !digest.is_empty())
}

/// Whether a table that was kept need not be written again.
fn is_same(one: &CoefficientTable, other: &CoefficientTable) -> bool {
    let known = |table: &CoefficientTable| (*table.digest(), table.is_nominal(), table.is_sealed(), *table.errors());
    known(one) == known(other)
}

/// The table as it is kept: with a digest, and with what its provenance says of its errors. A table that was kept
/// without its provenance could not be distinguished from one that is not a calibration, nor one whose file has no
/// digest from a sealed one.
fn text_of(table: &CoefficientTable) -> String {
    let tool = if table.is_nominal() { "" } else { "tool = \"isothermd\"\n" };
    let unsealed = if table.is_sealed() { String::new() } else { format!("{UNSEALED} = true\n") };
    let errors = table.errors().to_toml(table.content());
    let provenance = format!("{tool}{unsealed}{errors}");
    let heading = if provenance.is_empty() { "" } else { "\n[provenance]\n" };
    format!("# Kept by the service; docs/operate.md says what for.\n{}{heading}{provenance}", table.to_toml())
}

/// What others can write or exchange is not believed: the folder must be this user's, and nobody else may be able to
/// put another one in its place or in the place of the folder above.
fn check_owner(folder: &Path) -> io::Result<()> {
    let own = rustix::process::geteuid().as_raw();
    let refused = |path: &Path, why: &str| Err(io::Error::other(format!("{} {why}", shown(path))));
    for (level, path) in folder.ancestors().take(3).enumerate() {
        let found = uninterrupted(|| fs::symlink_metadata(path))?;
        let is_trusted = found.uid() == own || level > 0 && found.uid() == 0;
        if !is_trusted {
            return refused(path, &format!("belongs to another user ({})", found.uid()));
        }
        // Permissions of a link say nothing. What it leads to counts, and its owner could have made that directly.
        let found = if found.is_symlink() { uninterrupted(|| fs::metadata(path))? } else { found };
        if !found.is_dir() {
            return refused(path, "is not a folder");
        }
        // A group that may write the folders above is the administrator's decision.
        let (others, sticky) = (if level == 0 { 0o022 } else { 0o002 }, found.mode() & 0o1000 != 0);
        if found.mode() & others != 0 && (level == 0 || !sticky) {
            return refused(path, "can be written by others");
        }
    }
    Ok(())
}

/// `TMPFS_MAGIC` of statfs(2).
const TMPFS: FsWord = 0x0102_1994;

/// The remedy where tables cannot be kept.
pub(crate) fn remedy() -> String {
    format!("name a folder that this user may write in {STATE_VARIABLE}")
}
