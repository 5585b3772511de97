//! What became of fit, verification and installation, from the journal: also long after the runner has ended.

use super::journal::{self, Entry, JOURNAL, JournalLine, LargestError};
use super::page::utc;
use super::plan::Plan;
use isotherm_documents::load_table;
use isotherm_files::Trust;
use isotherm_support::failure::{Failure, shown};
use serde::Serialize;
use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};

/// What became of the last fit.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CampaignOutcome {
    /// The fit; `None` if there was none.
    pub fit: Option<FitOutcome>,
    /// The verification runs, in order.
    pub verification: Vec<VerificationOutcome>,
    /// What of the table no run judges.
    pub not_judged: Vec<String>,
    /// The installation; `None` if it has not come to that.
    pub installation: Option<InstallationOutcome>,
}

/// The last fit. Neither digest nor reason: it has begun, and it is running or its process was killed.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FitOutcome {
    /// Unix time of the entry \[s\].
    pub unix_s: f64,
    /// Digest of the table.
    pub digest: Option<String>,
    /// The bottom line; `None` without a table.
    pub accuracy: Option<String>,
    /// Why there is no table.
    pub refused: Option<String>,
}

/// A judged verification run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VerificationOutcome {
    /// Unix time of the entry \[s\].
    pub unix_s: f64,
    /// The run's file.
    pub run: String,
    /// Outer and inner angle of its attitude \[deg\].
    pub angles_deg: Option<[f64; 2]>,
    /// The largest error.
    pub largest: Option<LargestError>,
    /// Why the table must not be installed, one reason a line; `None` if nothing speaks against it.
    pub refused: Option<String>,
}

/// Whether the table was installed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InstallationOutcome {
    /// Unix time of the entry \[s\].
    pub unix_s: f64,
    /// The installed file; `None` if the table was left aside.
    pub file: Option<PathBuf>,
    /// Digest of the table in that file now; `None` if it cannot be read, or if its path is relative. Another one is
    /// there after a rollback.
    pub present: Option<String>,
    /// Why the table was left aside, one reason a line. Those of a run are with the run.
    pub refused: Option<String>,
}

/// What became of an IMU of a batch.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImuOutcome {
    /// Its name.
    pub imu: String,
    /// Where and why it was dropped; `None` if it was not.
    pub dropped: Option<String>,
    /// What became of its last fit.
    pub outcome: CampaignOutcome,
}

/// What became of the campaign of one IMU in `folder`.
///
/// # Errors
/// If the journal cannot be read.
pub fn outcome(folder: &Path) -> Result<CampaignOutcome, Failure> {
    let (lines, _) = journal::read(&folder.join(JOURNAL))?;
    Ok(present(of_lines(&lines)))
}

/// What became of each IMU of the batch of `plan`, in the order of the plan.
///
/// # Errors
/// If the journal cannot be read.
pub fn outcomes(plan: &Plan) -> Result<Vec<ImuOutcome>, Failure> {
    let (lines, _) = journal::read(&plan.output.join(JOURNAL))?;
    let history = journal::history(&lines);
    let of_imu = |plan: &Plan| {
        let about = |line: &&JournalLine| line.imu.as_deref() == Some(plan.imu.as_str());
        let dropped = history.reason_dropped(&plan.imu).map(ToOwned::to_owned);
        ImuOutcome { imu: plan.imu.to_string(), dropped, outcome: present(of_lines(lines.iter().filter(about))) }
    };
    Ok(plan.each().iter().map(of_imu).collect())
}

/// With the digest of the table that is in the installed file now.
fn present(mut outcome: CampaignOutcome) -> CampaignOutcome {
    if let Some(installation) = &mut outcome.installation {
        let file = installation.file.as_ref().filter(|file| file.is_absolute());
        let table = file.map(|file| load_table(file, None, Trust::Any));
        installation.present = table.and_then(Result::ok).map(|(table, _)| table.digest().to_string());
    }
    outcome
}

fn of_lines<'l>(lines: impl IntoIterator<Item = &'l JournalLine>) -> CampaignOutcome {
    let mut outcome = CampaignOutcome::default();
    for JournalLine { at, entry, .. } in lines {
        let unix_s = &at.unix_s;
        let unix_s = *unix_s;
        let installation = |file, refused| Some(InstallationOutcome { unix_s, file, present: None, refused });
        match entry.clone() {
            Entry::FitBegun => {
                outcome = CampaignOutcome {
                    fit: Some(FitOutcome { unix_s, ..FitOutcome::default() }),
                    ..CampaignOutcome::default()
                };
            }
            Entry::Calibrated { digest, accuracy } => {
                let fit = FitOutcome { unix_s, digest: Some(digest), accuracy: Some(accuracy), refused: None };
                outcome = CampaignOutcome { fit: Some(fit), ..CampaignOutcome::default() };
            }
            Entry::NotCalibrated { reason } => {
                let fit = FitOutcome { unix_s, refused: Some(reason), ..FitOutcome::default() };
                outcome = CampaignOutcome { fit: Some(fit), ..CampaignOutcome::default() };
            }
            Entry::Verified { run, angles_deg, largest, refused } => {
                outcome.verification.push(VerificationOutcome { unix_s, run, angles_deg, largest, refused });
            }
            Entry::NotJudged { reasons } => outcome.not_judged = reasons,
            Entry::NotInstalled { reason } => outcome.installation = installation(None, Some(reason)),
            Entry::Installed { file, .. } => outcome.installation = installation(Some(file), None),
            _ => {}
        }
    }
    outcome
}

/// One reason as it is, several as indented lines.
fn listed(reasons: &str) -> String {
    if reasons.contains('\n') { format!("\n  {}", reasons.replace('\n', "\n  ")) } else { format!(" {reasons}") }
}

/// The lines of [`CampaignOutcome`], each with the IMU's name, and one if it was dropped.
impl fmt::Display for ImuOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { imu, dropped, outcome } = self;
        if let Some(reason) = dropped {
            writeln!(f, "{imu}: dropped {}", reason.replace('\n', "; "))?;
        }
        outcome.to_string().lines().try_for_each(|line| writeln!(f, "{imu}: {line}"))
    }
}

/// One line for each step and reason; empty if there was no fit.
impl fmt::Display for CampaignOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(fit) = &self.fit else { return Ok(()) };
        let mut text = format!("fit, {}: ", utc(fit.unix_s));
        match (&fit.digest, &fit.refused) {
            (Some(digest), _) => text += digest,
            (None, Some(reason)) => text += &format!("no table:{}", listed(reason)),
            (None, None) => text += "begun, without a result yet",
        }
        if let Some(accuracy) = &fit.accuracy {
            text += &format!("\n{accuracy}");
        }
        for VerificationOutcome { run, angles_deg, largest, refused, .. } in &self.verification {
            let at = angles_deg.map_or_else(String::new, |[outer, inner]| format!(", at {outer}/{inner} deg"));
            let largest =
                largest.as_ref().map_or_else(|| "not judged".to_owned(), |largest| format!("largest error {largest}"));
            let refused = refused.as_ref().map_or_else(String::new, |causes| format!("; refused:{}", listed(causes)));
            write!(text, "\n{run}{at}: {largest}{refused}")?;
        }
        for reason in &self.not_judged {
            write!(text, "\nnot judged: {reason}")?;
        }
        if let Some(installation) = &self.installation {
            let InstallationOutcome { unix_s, file, present, refused } = installation;
            let clock = utc(*unix_s);
            match file {
                Some(file) => write!(text, "\ninstalled, {clock}: as {}", shown(file))?,
                None => write!(text, "\nnot installed, {clock}:{}", listed(refused.as_deref().unwrap_or_default()))?,
            }
            match (file, present) {
                (Some(_), Some(digest)) if Some(digest) != fit.digest.as_ref() => {
                    write!(text, "; {digest} is there now")?;
                }
                (Some(file), None) if file.is_absolute() => text += "; there is no whole table now",
                _ => {}
            }
        }
        for line in text.lines() {
            writeln!(f, "{line}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::stamp::Stamp;
    use super::*;

    fn lines(text: &str) -> CampaignOutcome {
        let lines: Vec<_> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        of_lines(&lines)
    }

    #[test]
    fn the_last_fit_counts() {
        let old = r#"{"unix_s":1.0,"event":"calibrated","digest":"sha256:1","accuracy":"within 5 ug0"}
{"unix_s":2.0,"event":"installed","digest":"sha256:1","file":"/imu-a.toml"}"#;
        let outcome = lines(old);
        assert_eq!(
            outcome.to_string(),
            "fit, 1970-01-01T00:00:01Z: sha256:1\nwithin 5 ug0\ninstalled, 1970-01-01T00:00:02Z: as /imu-a.toml; there is no whole table now\n"
        );
        let begun = lines(&format!("{old}\n{}", r#"{"unix_s":3.0,"event":"fit_begun"}"#));
        assert_eq!(begun.to_string(), "fit, 1970-01-01T00:00:03Z: begun, without a result yet\n");
        assert_eq!((begun.installation, begun.verification), (None, Vec::new()));
        assert_eq!(lines(r#"{"unix_s":1.0,"event":"left"}"#).to_string(), "");
    }

    #[test]
    fn every_step_has_its_line_with_the_reason() {
        let largest = LargestError { of: "A2".to_owned(), error_g0: 3e-6, interval_g0: 1e-7 };
        let run = |refused: Option<&str>| Entry::Verified {
            run: "verify-1.csv".to_owned(),
            angles_deg: refused.map(|_| [50.0, 130.0]),
            largest: Some(largest.clone()),
            refused: refused.map(ToOwned::to_owned),
        };
        let entries = [
            Entry::NotCalibrated { reason: "a fault".to_owned() },
            Entry::FitBegun,
            Entry::Calibrated { digest: "sha256:2".to_owned(), accuracy: "bias +- 1 ug0".to_owned() },
            run(None),
            run(Some("bias")),
            run(Some("bias\nscale")),
            Entry::NotJudged { reasons: vec!["K- of A1 was not driven by any run".to_owned()] },
            Entry::NotInstalled { reason: "verify-2.csv refuses it".to_owned() },
        ];
        // As the journal writes and reads them.
        let written = entries.into_iter().map(|entry| {
            serde_json::to_string(&JournalLine { at: Stamp { unix_s: 1.0, up: None }, imu: None, entry }).unwrap()
        });
        let written: Vec<_> = written.collect();
        assert_eq!(lines(&written[0]).to_string(), "fit, 1970-01-01T00:00:01Z: no table: a fault\n");
        assert_eq!(
            lines(&written.join("\n")).to_string(),
            "fit, 1970-01-01T00:00:01Z: sha256:2\nbias +- 1 ug0\n\
             verify-1.csv: largest error A2 3.000 +- 0.100e-6 g0\n\
             verify-1.csv, at 50/130 deg: largest error A2 3.000 +- 0.100e-6 g0; refused: bias\n\
             verify-1.csv, at 50/130 deg: largest error A2 3.000 +- 0.100e-6 g0; refused:\n  bias\n  scale\n\
             not judged: K- of A1 was not driven by any run\n\
             not installed, 1970-01-01T00:00:01Z: verify-2.csv refuses it\n"
        );
    }
}
