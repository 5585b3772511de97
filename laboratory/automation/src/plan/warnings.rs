//! What a valid plan leaves unseen. It is reported before anything moves: runs that do not judge the whole table cost
//! another campaign.

use super::{Plan, VerificationPlan};
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};
use isotherm_verification::{DRIVEN, undriven};

/// Part of the set points' range that the verification runs should cover.
const COVERED: f64 = 0.8;

impl Plan {
    /// What the verification runs would not judge, and how they would; of a batch for each IMU.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let of_imu =
            |plan: &Self| plan.own_warnings().into_iter().map(|warning| format!("{}: {warning}", plan.imu)).collect();
        let of_batch: Vec<Vec<String>> = self.batch.iter().map(of_imu).collect();
        if self.is_batch() { of_batch.concat() } else { self.own_warnings() }
    }

    /// What the drivers of the instruments do not read.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        let unread = |finding, key: Option<&str>, text: &str| {
            key.map(|key| Finding::warning(finding, format!("{text}; give {key}, which docs/instruments.md explains")))
        };
        let alarms = "the chamber's alarms are not read: one is seen only when the air leaves its set point";
        let faults = "the table's faults are not read: one is seen only when the table does not arrive";
        let chamber = unread(name::ALARMS_NOT_READ, self.chamber.key_of_alarms(), alarms);
        let table = unread(name::FAULTS_NOT_READ, self.turntable.key_of_faults(), faults);
        chamber.into_iter().chain(table).collect()
    }

    fn own_warnings(&self) -> Vec<String> {
        let Some(verify) = &self.verify else { return Vec::new() };
        let missing = names(&undriven(&verify.forces()));
        let channels = (!missing.is_empty()).then(|| {
            let remedy = match self.opposite_attitudes() {
                Some(opposite) => {
                    let all: Vec<_> = verify.angles().chain(opposite).collect();
                    format!("{} drives all six", attitudes_deg(&all))
                }
                None => {
                    format!("give attitudes_deg with {DRIVEN} g0 or more along each accelerometer in both directions")
                }
            };
            format!("verify: no run drives {missing}: mistakes there stay unseen; {remedy}")
        });
        let [low, high] = self.range_c();
        let [from, to] = [verify.way.from_c.min(verify.way.to_c), verify.way.from_c.max(verify.way.to_c)];
        let part = ((to.min(high) - from.max(low)) / (high - low)).max(0.0);
        let range = (high > low && part < COVERED).then(|| {
            format!(
                "verify: {from} to {to} degC covers {:.0} % of the set points' range: what is beyond is not judged, and if it is over a tenth \
                 nothing is installed without --accept not-covered; {}",
                100.0 * part,
                self.whole_range()
            )
        });
        channels.into_iter().chain(range).collect()
    }

    /// Lowest and highest set point \[degC\].
    fn range_c(&self) -> [f64; 2] {
        let ends = [f64::INFINITY, f64::NEG_INFINITY];
        self.set_points_c.iter().fold(ends, |[low, high], &celsius| [low.min(celsius), high.max(celsius)])
    }

    /// The keys of runs that cover every set point.
    #[must_use]
    pub fn whole_range(&self) -> String {
        let [low, high] = self.range_c();
        format!("from_c = {low} and to_c = {high} covers it")
    }

    /// The keys that add the runs that are missing to runs that are taken; `None` if it is not known which they are.
    #[must_use]
    pub fn more_runs(&self) -> Option<String> {
        let verify = self.verify.as_ref()?;
        let taken = (0..verify.runs as usize).filter_map(|run| verify.attitude(run).angles);
        let all: Vec<_> = taken.chain(self.opposite_attitudes()?).collect();
        Some(format!("runs = {} and {}", all.len(), attitudes_deg(&all)))
    }

    /// The opposites of attitudes that are missing for all channels, within the limits of the turntable.
    fn opposite_attitudes(&self) -> Option<Vec<[f64; 2]>> {
        let verify = self.verify.as_ref()?;
        let (mut forces, mut added) = (verify.forces(), Vec::new());
        for attitude in &verify.attitudes {
            if undriven(&forces).is_empty() {
                break;
            }
            let [outer, inner] = attitude.angles.unwrap_or_default();
            let turned = [
                [outer + 180.0, inner],
                [outer - 180.0, inner],
                [180.0 - outer, inner + 180.0],
                [180.0 - outer, inner - 180.0],
            ];
            added.push(turned.into_iter().find(|angles| self.limits.angles(*angles).is_none())?);
            forces.push(attitude.specific_force.map(|along| -along));
        }
        undriven(&forces).is_empty().then_some(added)
    }
}

impl VerificationPlan {
    fn forces(&self) -> Vec<[f64; AXES]> {
        self.attitudes.iter().map(|attitude| attitude.specific_force).collect()
    }

    fn angles(&self) -> impl Iterator<Item = [f64; 2]> {
        self.attitudes.iter().filter_map(|attitude| attitude.angles)
    }
}

fn attitudes_deg(angles: &[[f64; 2]]) -> String {
    let pairs: Vec<_> = angles.iter().map(|[outer, inner]| format!("[{outer}, {inner}]")).collect();
    format!("attitudes_deg = [{}]", pairs.join(", "))
}

fn names<T: ToString>(parts: &[T]) -> String {
    parts.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}
