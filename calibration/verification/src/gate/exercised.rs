//! What the verification runs have exercised together. What no run has exercised is not judged: the gate says so, and
//! does not install it where that is known.
//!
//! - **Channels.** A run judges the scale factor of a channel if the specific force along the accelerometer has the
//!   sign of the channel, and at least [`DRIVEN`]. A channel that no run drives must agree with the table in force. No
//!   run at rest drives a channel of a gyroscope, see [`super::gyroscopes`].
//! - **Temperatures.** The runs together leave no hole of over a tenth of the range of a curve, of the gyroscopes of a
//!   bias; see [`Occupancy`](crate::Occupancy).

use super::{Gate, RANGE_TOLERANCE};
use crate::gate::allowed::GateRefusal;
use crate::stability::Coverage;
pub use crate::stability::DRIVEN;
use crate::stability::Stability;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::largest;
use std::fmt;

/// Number of points at which two curves are compared.
const POINTS: u32 = 65;

/// One of the two channels of a sensor's converter.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct ConverterChannel {
    kind: SensorKind,
    axis: usize,
    positive: bool,
}

impl ConverterChannel {
    fn all(kind: SensorKind) -> impl Iterator<Item = Self> {
        (0..AXES).flat_map(move |axis| [true, false].map(|positive| Self { kind, axis, positive }))
    }

    /// Whether an accelerometer's channel is driven by the specific force \[g0\].
    fn is_driven(self, force: [f64; AXES]) -> bool {
        let along = force[self.axis];
        (if self.positive { along } else { -along }) >= DRIVEN
    }

    /// The scale factor, and the size of its unit.
    fn curve(self, table: &CoefficientTable) -> Option<(&Polynomial, f64)> {
        let content = table.content();
        let (axes, unit) = match self.kind {
            SensorKind::Accelerometer => (&content.axes, content.gravity),
            SensorKind::Gyroscope => (&content.gyroscopes.as_ref()?.axes, 1.0),
        };
        let axis = &axes[self.axis];
        Some((if self.positive { &axis.positive_scale_factor } else { &axis.negative_scale_factor }, unit))
    }

    /// Largest relative difference of the channel's scale factor, of an accelerometer per m/s2, between two tables, in
    /// the range of both; `None` if they have none in common.
    fn difference(self, new: &CoefficientTable, old: &CoefficientTable) -> Option<f64> {
        let (new, old) = (self.curve(new)?, self.curve(old)?);
        let ([low, high], [old_low, old_high]) = (new.0.range(), old.0.range());
        let (low, high) = (low.max(old_low), high.min(old_high));
        let at = |(curve, unit): (&Polynomial, f64), temperature: f64| curve.at(temperature) / unit;
        let temperature = |point: u32| low + (high - low) * f64::from(point) / f64::from(POINTS - 1);
        let differences =
            (0..POINTS).map(|point| (at(new, temperature(point)) / at(old, temperature(point)) - 1.0).abs());
        (low < high).then(|| largest(differences))
    }
}

/// As in "K- of A1".
impl fmt::Display for ConverterChannel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "K{} of {}", if self.positive { '+' } else { '-' }, self.kind.names()[self.axis])
    }
}

/// The channels of accelerometers that none of these specific forces \[g0\] drives.
#[must_use]
pub fn undriven(forces: &[[f64; AXES]]) -> Vec<ConverterChannel> {
    let channels = ConverterChannel::all(SensorKind::Accelerometer);
    channels.filter(|channel| !forces.iter().any(|force| channel.is_driven(*force))).collect()
}

/// What the runs together have exercised.
#[derive(Clone, Debug, Default)]
pub struct ExercisedChannels {
    /// Specific force of each run \[g0\].
    forces: Vec<[f64; AXES]>,
    /// What of the table the runs exercise together.
    accelerometers: Option<Coverage>,
    /// The same of the gyroscopes.
    gyroscopes: Option<Coverage>,
}

impl ExercisedChannels {
    /// Adds a run: its attitude, and what it covers. All runs are judged under one table.
    pub fn add(&mut self, run: &Stability) {
        self.forces.push(run.specific_force);
        let add = |all: &mut Option<Coverage>, covered: &Coverage| {
            *all = Some(all.as_ref().map_or_else(|| covered.clone(), |all| all.and(covered)));
        };
        add(&mut self.accelerometers, &run.covered);
        if let Some(gyroscopes) = run.judged_gyroscopes() {
            add(&mut self.gyroscopes, &gyroscopes.covered);
        }
    }

    /// What the runs cover of `table`, by triad: nothing of one that no run shows.
    fn covered(&self, table: &CoefficientTable) -> Vec<Coverage> {
        let content = table.content();
        let of = |all: &Option<Coverage>, kind: SensorKind, axes: &[Axis; AXES]| {
            all.clone().unwrap_or_else(|| Coverage::of(&[], kind, axes, &content.temperature_unit))
        };
        let accelerometers = of(&self.accelerometers, SensorKind::Accelerometer, &content.axes);
        let gyroscopes = content.gyroscopes.as_ref().map(|it| of(&self.gyroscopes, SensorKind::Gyroscope, &it.axes));
        [accelerometers].into_iter().chain(gyroscopes).collect()
    }

    /// What is not judged, a line each. Holes of at most 5 % of a range are not among it.
    #[must_use]
    pub fn not_judged(&self, table: &CoefficientTable) -> Vec<String> {
        let channels = undriven(&self.forces).into_iter().map(|channel| format!("{channel} was not driven by any run"));
        let covered = self.covered(table);
        let holes = covered.iter().filter_map(|covered| covered.hole_over(RANGE_TOLERANCE));
        let holes = holes.map(|hole| format!("no run is in {hole}"));
        let gyroscopes = table.content().gyroscopes.is_some().then(|| {
            "scale factors and misalignments of the gyroscopes, and their g-sensitivity across the specific forces of the runs: no run at rest \
             shows them"
                .to_owned()
        });
        channels.chain(holes).chain(gyroscopes).collect()
    }
}

impl Gate {
    /// Why the table must not be installed, as the runs together show it.
    #[must_use]
    pub fn refuses_together(
        &self,
        runs: &ExercisedChannels,
        new: &CoefficientTable,
        in_force: Option<&CoefficientTable>,
    ) -> Vec<GateRefusal> {
        let bound = self.require.bias.unwrap_or(0.0);
        let mut found = Vec::new();
        for channel in undriven(&runs.forces) {
            let difference = in_force.and_then(|old| channel.difference(new, old)).filter(|most| *most > bound);
            found.extend(difference.map(|most| GateRefusal {
                by: GateRefusal::CHANNEL,
                cause: format!(
                    "{channel}, which no run drives, is {:.0} ppm off the table in force, at most {:.0} ppm is allowed; verify at an attitude \
                     that drives it",
                    most * 1e6,
                    bound * 1e6
                ),
            }));
        }
        if let Some((bounds, old)) = self.gyroscopes.zip(in_force) {
            found.extend(bounds.refuses(&runs.forces, new, old));
            for channel in ConverterChannel::all(SensorKind::Gyroscope) {
                let difference = channel.difference(new, old).filter(|most| *most > bounds.relative);
                found.extend(difference.map(|most| GateRefusal {
                    by: "gyroscopes",
                    cause: format!(
                        "{channel}, which no run at rest shows, is {:.0} ppm off the table in force, at most {:.0} ppm is allowed; look at the turns \
                         of the campaign, state a scale in --require, or move that table away if the IMU has changed",
                        most * 1e6,
                        bounds.relative * 1e6
                    ),
                }));
            }
        }
        if !self.accepts_holes {
            let holes = runs.covered(new).into_iter().filter_map(|covered| covered.hole());
            found.extend(holes.map(|hole| GateRefusal {
                by: GateRefusal::RUNS,
                cause: format!("no run is in {hole}; verify over the whole range, or accept it: --accept not-covered"),
            }));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{changed, gate, run, run_between, truth, up_to};
    use super::*;

    fn names(forces: &[[f64; AXES]]) -> String {
        undriven(forces).iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    }

    #[test]
    fn every_channel_is_driven_by_the_sign_and_the_size_of_the_specific_force() {
        let one = [0.5868, -0.4925, 0.6428];
        assert_eq!(names(&[one]), "K- of A1, K+ of A2, K- of A3");
        assert_eq!(names(&[one, one.map(|f| -f)]), "");
        assert_eq!(names(&[[0.95, 0.31, 0.0], [-0.95, -0.29, 0.0]]), "K- of A2, K+ of A3, K- of A3");
        assert_eq!(undriven(&[]).len(), 6);
    }

    /// A mistake in the two positions that drive one channel: the runs at one attitude show nothing of it.
    #[test]
    fn a_channel_that_no_run_drives_must_agree_with_the_table_in_force() {
        let off = |positive: bool, factor: f64| {
            changed(|content| {
                let axis = &mut content.axes[0];
                let curve = if positive { &mut axis.positive_scale_factor } else { &mut axis.negative_scale_factor };
                let coefficients: Vec<_> = curve.coefficients().iter().map(|c| c * factor).collect();
                *curve = Polynomial::new(&coefficients, curve.center(), curve.scale(), curve.range()).unwrap();
            })
        };
        let judge = |new: &CoefficientTable, in_force: Option<&CoefficientTable>| {
            let mut runs = ExercisedChannels::default();
            runs.add(&run(new, 0));
            (gate(0.0).refuses_together(&runs, new, in_force), runs.not_judged(new))
        };
        let good = truth();
        let wrong = off(false, 1.002);
        let (refused, not_judged) = judge(&wrong, Some(&good));
        assert!(refused.len() == 1 && refused[0].by == "channel", "{refused:?}");
        let cause = &refused[0].cause;
        assert!(cause.starts_with("K- of A1, which no run drives, is 2000 ppm off the table in force"), "{cause}");
        assert!(cause.ends_with("; verify at an attitude that drives it"), "{cause}");
        assert_eq!(not_judged[0], "K- of A1 was not driven by any run");
        // Within the bound of 1000 ppm; without a table in force; a channel that a run drives; no common range.
        assert_eq!(judge(&off(false, 1.0009), Some(&good)).0, []);
        assert_eq!(judge(&wrong, None).0, []);
        assert_eq!(judge(&off(true, 1.002), Some(&good)).0, []);
        assert_eq!(judge(&wrong, Some(&wrong)).0, []);
        // Another reference of gravity scales the table's numbers, and not its output.
        let other_reference = changed(|content| {
            let factor = 9.8 / content.gravity;
            content.gravity = 9.8;
            for axis in &mut content.axes {
                for curve in [&mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
                    let coefficients: Vec<_> = curve.coefficients().iter().map(|c| c * factor).collect();
                    *curve = Polynomial::new(&coefficients, curve.center(), curve.scale(), curve.range()).unwrap();
                }
            }
        });
        let channel = ConverterChannel { kind: SensorKind::Accelerometer, axis: 0, positive: false };
        assert!(channel.difference(&good, &other_reference).unwrap() < 1e-12);
        assert!((channel.difference(&good, &wrong).unwrap() - 0.002).abs() < 1e-5);
    }

    /// The runs reach temperature from 1 to 4; the table has 0.9 to 4.2 V.
    #[test]
    fn runs_that_leave_a_hole_judge_no_table_unless_that_is_accepted() {
        let good = truth();
        let mut whole = ExercisedChannels::default();
        whole.add(&run(&good, 0));
        assert_eq!(gate(0.0).refuses_together(&whole, &good, None), []);
        assert_eq!(
            whole.not_judged(&good),
            [
                "K- of A1 was not driven by any run",
                "K+ of A2 was not driven by any run",
                "K- of A3 was not driven by any run"
            ]
        );
        // The ends of the range, and nothing between; then two runs that leave a hole each, but not together.
        let parts = |parts: &[[f64; 2]]| {
            let mut runs = ExercisedChannels::default();
            parts.iter().for_each(|[from, to]| runs.add(&run_between(&good, *from, *to)));
            let refused = gate(0.0).refuses_together(&runs, &good, None);
            assert_eq!(Gate { accepts_holes: true, ..gate(0.0) }.refuses_together(&runs, &good, None), []);
            refused.into_iter().map(|refusal| refusal.cause).collect::<Vec<_>>()
        };
        let ends = parts(&[[0.9, 1.3], [3.9, 4.2]]);
        assert_eq!(
            ends,
            [
                "no run is in 1.31 to 3.87 V of bias of A1, 78 % of its range; verify over the whole range, or accept it: --accept not-covered"
            ]
        );
        assert_eq!(parts(&[[0.9, 2.5], [2.45, 4.2]]), Vec::<String>::new());
        assert_eq!(parts(&[[0.9, 2.5]]).len(), 1);
        // No run.
        assert!(!gate(0.0).refuses_together(&ExercisedChannels::default(), &up_to(2.0), None).is_empty());
    }
}
