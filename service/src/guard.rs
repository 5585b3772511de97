//! Whether a new table may take the place of the one that was in force before: a lost digit must not go into the air.
//!
//! The tables are compared by [`TableDifference`]. A new table is compared with the one that was in force last, within
//! the limits that the configuration gives, or that follow from what that table states of its errors and ranges; and
//! with an *anchor*, within three times the limits, so that many small steps do not add up unseen. The anchor is the
//! table of the first start, the first calibration after a nominal table, or the last table that was accepted.
//! [`KeptTables`] keeps these tables over a restart, so that a restart installs no table that a reload has refused.
//!
//! Somebody who means the change accepts the table's digest with the command `reload`, by an [`Acceptance`].

use crate::config::Imu;
use crate::memory::{ForgottenTable, KeptTables};
use isotherm_client::{Domain, ImuId};
use isotherm_install::Acceptance;
use isotherm_shared::table::difference::{Change, MaxChange, TableDifference};
use isotherm_shared::table::{CoefficientTable, Digest};
use std::sync::Arc;

/// By how much more than the limits a table may differ from the anchor.
const ANCHOR_FACTOR: f64 = 3.0;

/// Guards the table of one IMU.
#[derive(Debug)]
pub(crate) struct Guard {
    imu: ImuId,
    limits: MaxChange,
    domain: Domain,
    /// What is known of earlier tables, of this service or the one before.
    memory: KeptTables,
    changes: Vec<Change>,
}

/// A table that may be taken, and what it changes.
#[derive(Debug)]
pub(crate) struct TableAdmission {
    /// Of each curve; empty if there is nothing to compare with.
    changes: Vec<Change>,
    /// The changes, or why there is no comparison, for the log.
    pub words: String,
    /// Whether the operator has accepted its digest, and it would have been refused without that.
    accepted: bool,
}

impl Guard {
    /// The guard of an IMU with this memory.
    pub(crate) fn new(imu: &Imu, domain: &Domain, memory: KeptTables) -> Self {
        let (imu, limits, domain) = (imu.id.clone(), imu.max_change, domain.clone());
        Self { imu, limits, domain, memory, changes: Vec::new() }
    }

    /// What is accepted now, whichever tables it is of. A caller that decides by it and uses it up reads it once for
    /// both.
    pub(crate) fn accepted(&self) -> Vec<Acceptance> {
        Acceptance::read_all(&self.domain, &self.imu)
    }

    /// The largest changes of each curve by the table in force; empty if there was nothing to compare it with.
    pub(crate) fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// The table that small steps are compared with, and the largest changes of each curve since then.
    pub(crate) fn anchor(&self) -> Option<(&Digest, Vec<Change>)> {
        let (anchor, in_force) = (self.memory.anchor.as_ref()?, self.memory.in_force.as_ref()?);
        Some((anchor.digest(), TableDifference::of(anchor, in_force).changes))
    }

    /// What is known of earlier tables.
    pub(crate) const fn memory(&self) -> &KeptTables {
        &self.memory
    }

    /// Compares a table with those that were in force before. `accepted` is what the operator accepts.
    ///
    /// # Errors
    /// Why it must not be taken.
    pub(crate) fn admit(&self, table: &CoefficientTable, accepted: &[Acceptance]) -> Result<TableAdmission, String> {
        if let Some(forgotten) = &self.memory.forgotten {
            return self.admit_without_memory(table, forgotten, accepted);
        }
        let Some(reference) = self.memory.reference() else {
            let words = "it is not known which table was in force before, so it is compared with none".to_owned();
            return Ok(TableAdmission { changes: Vec::new(), words, accepted: false });
        };
        if reference.digest() == table.digest() {
            let words = "the same as before".to_owned();
            return Ok(TableAdmission { changes: self.changes.clone(), words, accepted: false });
        }
        let difference = TableDifference::of(reference, table);
        let refusals = self.refusals(&difference, table);
        let accepted = !refusals.is_empty() && is_accepted(table.digest(), accepted);
        if !refusals.is_empty() && !accepted {
            return Err(refusal(&refusals, reference.digest()));
        }
        let words = format!("{difference}{}", if accepted { "; accepted by its digest" } else { "" });
        Ok(TableAdmission { changes: difference.changes, words, accepted })
    }

    /// A process that takes the memory away must not get a table into force by that.
    fn admit_without_memory(
        &self,
        table: &CoefficientTable,
        forgotten: &ForgottenTable,
        accepted: &[Acceptance],
    ) -> Result<TableAdmission, String> {
        let digest = table.digest().to_string();
        let accepted = is_accepted(table.digest(), accepted);
        if accepted || forgotten.digest.as_ref() == Some(&digest) {
            let how = if accepted { "accepted by its digest" } else { "the same as before, by its digest" };
            let words = format!("{how}; the tables that were in force before cannot be read");
            return Ok(TableAdmission { changes: Vec::new(), words, accepted });
        }
        let last = forgotten.digest.as_deref().unwrap_or("which is not known");
        let why = match forgotten.is_pending {
            true => "cannot be read, since the disk of the state folder does not answer",
            false => "was kept and cannot be read any more",
        };
        Err(format!("the table that was in force last, {last}, {why}, so this one cannot be compared with it"))
    }

    /// Why a table that differs so from the one in force last is refused; empty if it may be taken.
    fn refusals(&self, difference: &TableDifference, table: &CoefficientTable) -> Vec<String> {
        let mut refusals = self.limits.refusals(difference, 1.0);
        if refusals.is_empty()
            && let Some(anchor) = &self.memory.anchor
        {
            let difference = TableDifference::of(anchor, table);
            let with = |refusal| format!("{refusal}, in all steps since the anchor, {}", anchor.digest());
            refusals.extend(self.limits.refusals(&difference, ANCHOR_FACTOR).into_iter().map(with));
        }
        refusals
    }

    /// Notes that an admitted table is in force now.
    pub(crate) fn taken(&mut self, table: &Arc<CoefficientTable>, admission: TableAdmission) {
        self.changes = admission.changes;
        self.memory.take(table, admission.accepted);
    }

    /// Takes in what the state folder has, which was not known before. What is in force stays.
    pub(crate) fn recall(&mut self, memory: KeptTables, accepted: &[Acceptance]) {
        let in_force = std::mem::replace(&mut self.memory, memory).in_force;
        if let Some(in_force) = in_force {
            self.memory.take(&in_force, is_accepted(in_force.digest(), accepted));
        }
    }

    /// Makes the table in force the anchor, if its digest is among what the operator accepts. Returns whether that is
    /// new.
    pub(crate) fn take_anchor(&mut self, accepted: &[Acceptance]) -> bool {
        let Some(in_force) = self.memory.in_force.clone() else { return false };
        if self.memory.is_anchored() || !is_accepted(in_force.digest(), accepted) {
            return false;
        }
        self.memory.take(&in_force, true);
        true
    }
}

/// Why a table is refused, compared with the one that was in force last.
fn refusal(refusals: &[String], last: &Digest) -> String {
    /// So many lines leave room for the remedy.
    const MOST: usize = 8;
    let mut lines: Vec<_> = refusals.iter().take(MOST).cloned().collect();
    if let Some(more) = refusals.len().checked_sub(MOST).filter(|more| *more > 0) {
        lines.push(format!("and {more} more changes are too large"));
    }
    format!(
        "{}\nthis is too much for a calibration of the same IMU, compared with the table that was in force last, {last}",
        lines.join("\n")
    )
}

/// What to do about a refused table with this digest, whose file is there.
pub(crate) fn remedy(imu: &ImuId, refused: &Digest) -> String {
    format!(
        "correct the file, bring that table back, or accept this one with the command `reload --imu {imu} --accept {refused}`"
    )
}

/// Whether the operator has accepted the table of this digest.
pub(crate) fn is_accepted(digest: &Digest, accepted: &[Acceptance]) -> bool {
    accepted.iter().any(|acceptance| acceptance.is_of(digest))
}

#[cfg(test)]
mod measured_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::polynomial::Polynomial;
    use isotherm_shared::table::{Nominal, nominal_table};
    use std::path::PathBuf;

    const TABLE: &str = include_str!("../../tests/data/imu-a.toml");

    fn table(text: &str) -> Arc<CoefficientTable> {
        Arc::new(CoefficientTable::from_toml(text, None).unwrap())
    }

    /// The table with the bias of A1 raised by so many mg0.
    fn raised(mg0: f64) -> Arc<CoefficientTable> {
        table(&TABLE.replace("c0 = 793.55", &format!("c0 = {:?}", 793.55 + mg0 * 1e3)))
    }

    fn with_serial(text: &str, serial: &str) -> String {
        text.replacen("[imu]\n", &format!("[imu]\nserial = \"{serial}\"\n"), 1)
    }

    struct GuardedImu {
        folder: tempfile::TempDir,
        guard: Guard,
    }

    impl GuardedImu {
        fn new(memory: KeptTables) -> Self {
            let folder = tempfile::tempdir().unwrap();
            let domain = Domain::new("guard", &format!("{}", folder.path().display())).unwrap();
            let imu = Imu::new(ImuId::new("imu-a").unwrap(), PathBuf::new(), MaxChange::default());
            Self { folder, guard: Guard::new(&imu, &domain, memory) }
        }

        fn take(&mut self, table: &Arc<CoefficientTable>) -> Result<String, String> {
            let admission = self.guard.admit(table, &self.guard.accepted())?;
            let words = admission.words.clone();
            self.guard.taken(table, admission);
            Ok(words)
        }

        fn take_anchor(&mut self) -> bool {
            let accepted = self.guard.accepted();
            self.guard.take_anchor(&accepted)
        }

        fn accept(&self, table: &CoefficientTable) {
            Acceptance::write(&self.guard.domain, &self.guard.imu, &table.digest().to_string()).unwrap();
            assert!(self.folder.path().exists());
        }
    }

    #[test]
    fn many_small_steps_do_not_add_up_beyond_three_times_the_limits() {
        let mut guarded = GuardedImu::new(KeptTables::default());
        assert!(guarded.take(&raised(0.0)).unwrap().contains("compared with none"));
        for mg0 in [90.0, 180.0, 270.0] {
            guarded.take(&raised(mg0)).unwrap();
        }
        let refusal = guarded.take(&raised(310.0)).unwrap_err();
        let anchor = raised(0.0).digest().to_string();
        assert!(refusal.contains("A1 bias changes by 309837 ug0"), "{}", refusal);
        assert!(
            refusal.contains(&format!(
                "at most 300 mg0 is taken (max_change.bias), in all steps since the anchor, {anchor}"
            ))
        );
        // Back is always possible.
        guarded.take(&raised(270.0)).unwrap();
        let (digest, changes) = guarded.guard.anchor().unwrap();
        assert_eq!((digest.to_string(), changes[0].size.round()), (anchor, 269_858.0));
        // What is in force becomes the anchor by its digest, and the next step is taken.
        assert!(!guarded.take_anchor(), "nothing is accepted");
        guarded.accept(&raised(270.0));
        assert!(guarded.take_anchor() && !guarded.take_anchor());
        guarded.take(&raised(310.0)).unwrap();
        // A table that is accepted becomes the anchor, too.
        guarded.accept(&raised(900.0));
        assert!(guarded.take(&raised(900.0)).unwrap().ends_with("; accepted by its digest"));
        assert_eq!(guarded.guard.anchor().unwrap().0, raised(900.0).digest());
        // One that needs no acceptance does not.
        guarded.accept(&raised(910.0));
        guarded.take(&raised(910.0)).unwrap();
        assert_eq!(guarded.guard.anchor().unwrap().0, raised(900.0).digest());
    }

    #[test]
    fn the_first_calibration_after_a_nominal_table_is_the_anchor() {
        let nominal = Nominal::new(ImuId::new("imu-a").unwrap(), 10_000_000, [-40.0, 85.0]);
        let nominal = Arc::new(nominal_table(&nominal).unwrap());
        let calibrated = |mg0: f64| {
            let mut content = nominal.content().clone();
            content.axes[0].bias = Polynomial::new(&[mg0 * 1e3], 0.0, 1.0, [20.0, 50.0]).unwrap();
            Arc::new(CoefficientTable::new(content).unwrap().with_provenance())
        };
        let mut guarded = GuardedImu::new(KeptTables::default());
        guarded.take(&nominal).unwrap();
        let refusal = guarded.take(&calibrated(101.0)).unwrap_err();
        assert!(refusal.contains("A1 bias changes by 101000 ug0, from 0 to 101000 ug0"), "{refusal}");
        assert!(guarded.take(&calibrated(60.0)).unwrap().contains("this is the first calibration"));
        let anchor = |guarded: &GuardedImu| *guarded.guard.anchor().unwrap().0;
        // From here on it is the reference, and it stays the anchor.
        for mg0 in [155.0, 250.0, 345.0] {
            guarded.take(&calibrated(mg0)).unwrap();
        }
        assert_eq!(anchor(&guarded), *calibrated(60.0).digest());
        let refusal = guarded.take(&calibrated(365.0)).unwrap_err();
        assert!(
            refusal.contains(&format!("in all steps since the anchor, {}", calibrated(60.0).digest())),
            "{refusal}"
        );
        guarded.take(&nominal).unwrap_err();
        // The power failed between the two files, and either of them is still the nominal table.
        for (in_force, kept_anchor) in [
            (nominal.clone(), calibrated(60.0)),
            (calibrated(60.0), nominal.clone()),
            (nominal.clone(), nominal.clone()),
        ] {
            let kept = KeptTables { in_force: Some(in_force), anchor: Some(kept_anchor), ..KeptTables::default() };
            let mut guarded = GuardedImu::new(kept);
            guarded.take(&calibrated(60.0)).unwrap();
            assert_eq!(anchor(&guarded), *calibrated(60.0).digest());
        }
    }

    #[test]
    fn gyroscopes_that_come_or_go_need_an_acceptance() {
        let whole = include_str!("../../tests/data/imu-g.toml").replace("imu-g", "imu-a");
        let without = table(whole.split("[[gyroscope]]").next().unwrap());
        let mut guarded = GuardedImu::new(KeptTables::default());
        guarded.take(&table(&whole)).unwrap();
        let lost = guarded.take(&without).unwrap_err();
        assert!(lost.starts_with("the table before has gyroscopes, and this one has none"), "{}", lost);
        guarded.accept(&without);
        guarded.take(&without).unwrap();
        let gained = guarded.take(&table(&whole)).unwrap_err();
        assert!(gained.starts_with("this table has gyroscopes, and the one before has none"), "{gained}");
    }

    #[test]
    fn a_serial_number_may_change_unless_curves_do() {
        let (own, other) = (with_serial(TABLE, "7"), with_serial(TABLE, "8"));
        let mut guarded = GuardedImu::new(KeptTables::default());
        guarded.take(&table(&own)).unwrap();
        let exchanged = guarded.take(&table(&other.replace("c0 = 793.55", "c0 = 800.0"))).unwrap_err();
        assert!(exchanged.contains("imu.serial"), "{exchanged}");
        assert!(guarded.take(&table(&other)).unwrap().contains("serial 7 -> 8"));
    }

    #[test]
    fn a_sealed_table_is_followed_by_an_unsealed_one_only_with_acceptance() {
        let sealed = table(&raised(0.0).to_toml());
        let mut guarded = GuardedImu::new(KeptTables::default());
        guarded.take(&sealed).unwrap();
        // The same table without its digest is no way round.
        guarded.take(&raised(0.0)).unwrap();
        let refusal = guarded.take(&raised(0.001)).unwrap_err();
        assert!(refusal.contains("seal it with `check --seal`"), "{refusal}");
        guarded.take(&table(&raised(0.001).to_toml())).unwrap();
        guarded.accept(&raised(0.002));
        guarded.take(&raised(0.002)).unwrap();
        guarded.take(&raised(0.003)).unwrap();
        guarded.take(&sealed).unwrap();
    }

    #[test]
    fn a_memory_that_was_taken_away_admits_only_what_was_in_force() {
        let forgotten = |digest: Option<&Arc<CoefficientTable>>| KeptTables {
            forgotten: Some(ForgottenTable {
                digest: digest.map(|table| table.digest().to_string()),
                is_pending: false,
            }),
            ..KeptTables::default()
        };
        let mut guarded = GuardedImu::new(forgotten(Some(&table(TABLE))));
        let refusal = guarded.take(&raised(1.0)).unwrap_err();
        assert!(
            refusal.contains(&format!("in force last, {}, was kept and cannot be read", table(TABLE).digest())),
            "{refusal}"
        );
        assert!(guarded.take(&table(TABLE)).unwrap().starts_with("the same as before, by its digest"));
        // From now on it is known again.
        guarded.take(&raised(1.0)).unwrap();
        for digest in [Some(table(TABLE)), None] {
            let mut guarded = GuardedImu::new(forgotten(digest.as_ref()));
            guarded.take(&raised(900.0)).unwrap_err();
            guarded.accept(&raised(900.0));
            guarded.take(&raised(900.0)).unwrap();
            assert_eq!(guarded.guard.anchor().unwrap().0, raised(900.0).digest());
        }
    }

    #[test]
    fn a_memory_that_comes_late_has_the_anchor_and_the_table_in_force_stays() {
        let mut kept = KeptTables::default();
        kept.take(&raised(0.0), false);
        kept.take(&raised(90.0), false);
        let digest = Some(raised(90.0).digest().to_string());
        let forgotten = Some(ForgottenTable { digest, is_pending: true });
        let mut guarded = GuardedImu::new(KeptTables { forgotten, ..KeptTables::default() });
        guarded.take(&raised(90.0)).unwrap();
        assert_eq!(guarded.guard.anchor().unwrap().0, raised(90.0).digest());
        guarded.guard.recall(kept, &[]);
        assert_eq!(guarded.guard.anchor().unwrap().0, raised(0.0).digest());
        assert_eq!(guarded.guard.memory().in_force.as_ref().unwrap().digest(), raised(90.0).digest());
    }
}
