//! Installing a table, until the service has judged it.

use crate::acceptance::Acceptance;
use crate::note::{TableJudgement, TableNote, has_notes, is_served};
use isotherm_client::{Domain, ImuId, domain_owner, prepare};
use isotherm_documents::{LoadError, load_table, load_table_text};
use isotherm_files::{Identity, Installation, Trust};
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::{Exit, Failure, one_line, quoted_path, shown};
use rustix::process::geteuid;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

/// How long the service may take to judge a file; it takes a quarter of a second where it polls.
const PATIENCE: Duration = Duration::from_secs(10);
/// A service that reads another file, or does not serve the IMU, has said so after this time.
const NOT_READ_LIMIT: Duration = Duration::from_secs(1);
const PAUSE: Duration = Duration::from_millis(20);

/// A table to install.
#[derive(Clone, Copy, Debug)]
pub struct NewTable<'a> {
    /// The table.
    pub table: &'a CoefficientTable,
    /// The text of its file.
    pub text: &'a str,
    /// Its file, for the commands in messages.
    pub source: &'a Path,
    /// Whether the service is to take it although it changes too much.
    pub is_accepted: bool,
}

/// What is known of how the service judges the file.
enum Judgement {
    Served,
    /// Why.
    NotServed(String),
    /// Why, and whether an operator can accept it.
    Refused(String, bool),
    /// It has not judged this state of the file.
    Open,
}

/// The sole right to install a table as this file.
pub struct TableInstaller<'a> {
    domain: &'a Domain,
    imu: &'a ImuId,
    target: &'a Path,
    installation: Installation,
    /// Whether a service lived at the beginning: one that ends meanwhile is being restarted.
    had_service: bool,
}

impl<'a> TableInstaller<'a> {
    /// Waits until no other process installs a table as `target`, 30 s at most.
    ///
    /// # Errors
    /// [`Exit::OtherUser`] if the domain belongs to another user and this one is not root, [`Exit::Temporary`] if
    /// another process keeps the right, and [`Exit::Io`] if no file can be written there.
    pub fn lock(domain: &'a Domain, imu: &'a ImuId, target: &'a Path) -> Result<Self, Failure> {
        domain_owner(domain)?;
        let installation = Installation::lock(target)?;
        Ok(Self { domain, imu, target, installation, had_service: is_served(domain)? })
    }

    /// Completes an installation that was interrupted, or takes it back if the service of the domain has refused its
    /// table.
    ///
    /// # Errors
    /// [`Exit::Io`] if it can be neither.
    pub fn settle(&self) -> Result<(), Failure> {
        let installation = &self.installation;
        if !installation.is_pending() {
            return Ok(());
        }
        let judgement = installation.state().map(|state| self.look(&state)).transpose()?;
        match judgement {
            Some(Judgement::Served | Judgement::NotServed(_)) => installation.complete(),
            Some(Judgement::Refused(..)) | None => installation.put_back(),
            Some(Judgement::Open) => Ok(()),
        }
    }

    /// Checks that the file is in the state with which the new table was compared; `None` if there was no file.
    ///
    /// # Errors
    /// If it is not.
    pub fn check_unchanged(&self, compared: Option<Identity>) -> Result<(), Failure> {
        if self.installation.state() == compared {
            return Ok(());
        }
        let message =
            format!("{} has changed meanwhile; run it again, to compare with what it is now", shown(self.target));
        Err(Failure::new(Exit::Failed, message))
    }

    /// The table that is installed now; `None` if there is no file.
    ///
    /// # Errors
    /// If it is no valid table.
    pub fn present(&self) -> Result<Option<CoefficientTable>, LoadError> {
        let read = || load_table(self.target, None, Trust::Any).map(|(table, _)| table);
        self.installation.state().map(|_| read()).transpose()
    }

    /// Installs the table, and waits until the service serves or refuses it, 10 s at most. The old table becomes the
    /// predecessor when the new one is served, or when no service reads it. Returns what has become of both, in lines
    /// for the operator.
    ///
    /// # Errors
    /// [`Exit::Config`] if the service refuses the table: the old one is then back. [`Exit::Temporary`] if the service
    /// has not judged it in that time: it stays, and another call goes on waiting. [`Exit::Io`] if it cannot be
    /// written, or its predecessor cannot be kept.
    pub fn install(self, new: &NewTable<'_>) -> Result<Vec<String>, Failure> {
        let digest = new.table.digest().to_string();
        let present = self.present().ok().flatten();
        let before = self.installation.state();
        let was_refused = before.map(|state| self.look(&state)).transpose()?;
        let was_refused = matches!(was_refused, Some(Judgement::Refused(..)));
        // What waits already was good.
        let is_kept = self.installation.is_pending() || (present.is_some() && !was_refused);
        let is_there = present.is_some_and(|present| is_same(&present, new.table));
        let was_there = is_there && !self.installation.is_pending() && !was_refused;
        let acceptance = new.is_accepted.then(|| self.accept(&digest)).transpose()?;
        if !is_there {
            self.installation.install(new.text).map_err(|failure| {
                acceptance.iter().for_each(Acceptance::remove);
                let now =
                    if self.installation.state() == before { "nothing is changed" } else { "the new table is there" };
                Failure { message: format!("{failure}; {now}"), ..failure }
            })?;
        }
        let not_served = match self.wait(&digest, new.is_accepted)? {
            Judgement::Served => None,
            Judgement::NotServed(why) => {
                // An acceptance waits for the service that reads the file, and for no other one.
                if is_served(self.domain)? {
                    acceptance.iter().for_each(Acceptance::remove);
                }
                Some(why)
            }
            Judgement::Refused(reason, can_be_accepted) => {
                acceptance.iter().for_each(Acceptance::remove);
                let now = if is_there && !self.installation.is_pending() {
                    "the file stays as it was"
                } else {
                    self.installation.put_back()?;
                    self.wait_until_judged();
                    match self.installation.state() {
                        Some(_) => "the table before is back",
                        None => "the file is removed again",
                    }
                };
                return Err(self.refusal(&digest, &reason, now, can_be_accepted.then_some(new.source)));
            }
            Judgement::Open => {
                let (place, limit) = (shown(self.target), PATIENCE.as_secs());
                let message = format!(
                    "{digest} is there as {place}, and the service has not judged it within {limit} s; run the same command again"
                );
                return Err(Failure::new(Exit::Temporary, message));
            }
        };
        let has_predecessor = is_kept && self.installation.is_pending();
        if is_kept { self.installation.complete() } else { self.installation.discard() }?;
        let (place, already) = (shown(self.target), if was_there { " already" } else { "" });
        let mut lines = vec![match not_served {
            None => format!("{digest} is served{already}, as {place}"),
            Some(why) => format!("{digest} is installed{already} as {place}, and not served: {why}"),
        }];
        if has_predecessor {
            let (previous, option) = (shown(self.installation.previous()), self.domain_option());
            let way_back = format!("isotherm{option} rollback {}", quoted_path(self.target));
            lines.push(format!("the table before is kept as {previous}; `{way_back}` brings it back"));
        }
        Ok(lines)
    }

    /// The table that a rollback installs, with its text and its file: the predecessor, which is the table that was
    /// replaced last. If a rollback was interrupted, the same one again.
    ///
    /// # Errors
    /// If there is none, or it is no valid table of the IMU.
    pub fn predecessor(&self) -> Result<(CoefficientTable, String, &Path), Failure> {
        let kept = self.installation.previous();
        let has_begun = || fs::read(self.target).ok() == fs::read(kept).ok();
        if self.installation.is_pending() && !has_begun() {
            self.installation.complete()?;
        }
        if !kept.exists() {
            let message = format!("{} has no predecessor: there is no {}", shown(self.target), shown(kept));
            return Err(Failure::new(Exit::Io, message));
        }
        let (table, text, _) = load_table_text(kept, Some(self.imu), Trust::Any)?;
        Ok((table, text, kept))
    }

    /// Whether an installation was interrupted, and it is not known whether its table is good.
    #[must_use]
    pub fn is_pending(&self) -> bool {
        self.installation.is_pending()
    }

    /// That the service refuses a table, with the commands that compare and accept that in the file `source`, if it can
    /// be accepted.
    fn refusal(&self, digest: &str, reason: &str, now: &str, source: Option<&Path>) -> Failure {
        let mut message = format!("{}: the service refuses {digest}: {reason}\n{now}", shown(self.target));
        let (place, option) = (quoted_path(self.target), self.domain_option());
        if let Some(source) = source.map(quoted_path) {
            if self.installation.state().is_some() && source != place {
                message += &format!("\ncompare: isotherm check --against {place} {source}");
            }
            message += &format!("\naccept:  isotherm{option} install --accept {digest} {source} {place}");
        }
        Failure::new(Exit::Config, message)
    }

    /// The option of the domain for a command, if it needs one.
    fn domain_option(&self) -> String {
        match self.domain.name() {
            Domain::DEFAULT => String::new(),
            name => format!(" --domain {name}"),
        }
    }

    fn accept(&self, digest: &str) -> Result<Acceptance, Failure> {
        let parent = Path::new(self.domain.root_path()).parent().and_then(|parent| fs::metadata(parent).ok());
        // In the folder of another user root would make one that the service of that user could not use.
        if !geteuid().is_root() || parent.is_none_or(|parent| parent.uid() == 0) {
            prepare(self.domain)?;
        }
        Acceptance::write(self.domain, self.imu, digest).map_err(|error| {
            let failure = Failure::io("accepting it in", Path::new(self.domain.root_path()), &error);
            Failure {
                message: format!("{failure}; nothing is changed; the folder appears when the service starts"),
                ..failure
            }
        })
    }

    /// Waits until the service knows again that the table that it serves is there.
    fn wait_until_judged(&self) {
        if let Ok(Some(back)) = self.present() {
            let _ = self.wait(&back.digest().to_string(), false);
        }
    }

    /// Waits until the service has judged the file as it is now, also if it is restarted meanwhile. It takes a table
    /// that it has refused if the operator accepts that.
    fn wait(&self, digest: &str, is_accepted: bool) -> Result<Judgement, Failure> {
        let begun = Instant::now();
        let Some(state) = self.installation.state() else { return Err(self.changed(digest)) };
        loop {
            let judgement = self.look(&state)?;
            if self.installation.state() != Some(state) {
                return Err(self.changed(digest));
            }
            let is_open = match judgement {
                Judgement::Open => true,
                Judgement::Refused(_, can_be_accepted) => is_accepted && can_be_accepted,
                Judgement::NotServed(_) => self.had_service,
                Judgement::Served => false,
            };
            if !is_open {
                return Ok(judgement);
            }
            if begun.elapsed() > PATIENCE {
                return Ok(if matches!(judgement, Judgement::NotServed(_)) { judgement } else { Judgement::Open });
            }
            if let Some(why) = (begun.elapsed() > NOT_READ_LIMIT).then(|| self.not_read(&state)).transpose()?.flatten()
            {
                return Ok(Judgement::NotServed(why));
            }
            thread::sleep(PAUSE);
        }
    }

    fn changed(&self, digest: &str) -> Failure {
        let message = format!("{} was {digest}, and another process has changed it meanwhile", shown(self.target));
        Failure::new(Exit::Failed, message)
    }

    /// How the service has judged this state of the file.
    fn look(&self, state: &Identity) -> Result<Judgement, Failure> {
        if !is_served(self.domain)? {
            let why = format!("no service runs in domain {:?}, and the next one will judge it", self.domain.name());
            return Ok(Judgement::NotServed(why));
        }
        let Some(TableNote { served, judged: Some(judged), .. }) = TableNote::read(self.domain, self.imu)? else {
            return Ok(Judgement::Open);
        };
        Ok(match judged {
            TableJudgement { file, .. } if file != state.to_string() => Judgement::Open,
            TableJudgement { refused: Some(reason), digest, .. } => Judgement::Refused(reason, digest.is_some()),
            TableJudgement { digest, .. } if served == digest => Judgement::Served,
            // A worker takes it in the next moment.
            TableJudgement { .. } => Judgement::Open,
        })
    }

    /// Why the service does not read the file, if it does not.
    fn not_read(&self, state: &Identity) -> Result<Option<String>, Failure> {
        let (name, imu) = (self.domain.name(), self.imu);
        Ok(match TableNote::read(self.domain, imu)? {
            Some(note) if Identity::of(Path::new(&note.table_file)).as_ref() == Some(state) => None,
            Some(note) => {
                Some(format!("the service of domain {name:?} reads {} for {imu}", one_line(&note.table_file)))
            }
            None => has_notes(self.domain).then(|| {
                format!(
                    "the service of domain {name:?} has no note of {imu}: it does not serve it, or its log says why"
                )
            }),
        })
    }
}

/// The file that the running service of the domain reads for an IMU.
///
/// # Errors
/// If no service runs, or it does not serve the IMU. Only the name of a file that has a table of this IMU is taken from
/// the service, or of one that is not there, if the service is this user's.
pub fn table_file(domain: &Domain, imu: &ImuId) -> Result<PathBuf, Failure> {
    let absent = |cause: String| Failure::new(Exit::Unavailable, format!("{cause}; name the file of the table"));
    if !is_served(domain)? {
        return Err(absent(format!("no service runs in domain {:?}", domain.name())));
    }
    let note = TableNote::read(domain, imu)?;
    let note = note.ok_or_else(|| absent(format!("the service of domain {:?} does not serve {imu}", domain.name())))?;
    let file = PathBuf::from(note.table_file);
    let is_own = domain_owner(domain)? == Some(geteuid().as_raw());
    let is_table = load_table(&file, Some(imu), Trust::Any).is_ok() || (is_own && fs::symlink_metadata(&file).is_err());
    if file.is_absolute() && is_table {
        return Ok(file);
    }
    Err(absent(format!("the service reads {} for {imu}, which is no table of it", shown(&file))))
}

/// Whether the installation of one in the place of the other changes nothing.
fn is_same(present: &CoefficientTable, new: &CoefficientTable) -> bool {
    let known = |table: &CoefficientTable| (*table.digest(), table.is_sealed(), *table.errors());
    known(present) == known(new)
}
