//! What the verification runs have exercised together. What no run has exercised is not judged: the gate says so, and
//! does not install it where that can be told.
//!
//! - **Channels.** A run judges the scale factor of a channel if the specific force along the accelerometer has the
//!   sign of the channel, and at least [`DRIVEN`]. A channel that no run drives must agree with the table in force. No
//!   run at rest drives a channel of a gyroscope, see [`super::gyroscopes`].
//! - **Temperatures.** The runs must cover at least [`LEAST_COVERED`] of the range of every bias curve, also of the
//!   gyroscopes.

use super::{Gate, RANGE_TOLERANCE};
use crate::gate::allowed::Refusal;
use crate::stability::Coverage;
pub use crate::stability::DRIVEN;
use crate::stability::Stability;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{AXIS_NAMES, Axis, CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::largest;
use std::fmt;

/// Least part of the range of a bias curve that the runs must cover together.
pub(crate) const LEAST_COVERED: f64 = 0.5;
/// Number of points at which two curves are compared.
const POINTS: u32 = 65;

/// One of the two channels of a sensor's converter.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Channel {
    kind: SensorKind,
    axis: usize,
    positive: bool,
}

impl Channel {
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
        let at = |(curve, unit): (&Polynomial, f64), telemetry: f64| curve.at(telemetry) / unit;
        let telemetry = |point: u32| low + (high - low) * f64::from(point) / f64::from(POINTS - 1);
        let differences = (0..POINTS).map(|point| (at(new, telemetry(point)) / at(old, telemetry(point)) - 1.0).abs());
        (low < high).then(|| largest(differences))
    }
}

/// As in "K- of A1".
impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "K{} of {}", if self.positive { '+' } else { '-' }, self.kind.names()[self.axis])
    }
}

/// The channels of accelerometers that none of these specific forces \[g0\] drives.
#[must_use]
pub fn undriven(forces: &[[f64; AXES]]) -> Vec<Channel> {
    let channels = Channel::all(SensorKind::Accelerometer);
    channels.filter(|channel| !forces.iter().any(|force| channel.is_driven(*force))).collect()
}

/// What the runs together have exercised.
#[derive(Clone, Debug)]
pub struct Exercised {
    /// Specific force of each run \[g0\].
    forces: Vec<[f64; AXES]>,
    /// Lowest and highest telemetry of the heads. All runs of a plan have the same ramp, so that nothing between them
    /// is left out.
    head: [[f64; 2]; AXES],
    /// The same of the gyroscopes.
    gyroscope_head: [[f64; 2]; AXES],
}

impl Default for Exercised {
    fn default() -> Self {
        let nothing = [[f64::INFINITY, f64::NEG_INFINITY]; AXES];
        Self { forces: Vec::new(), head: nothing, gyroscope_head: nothing }
    }
}

impl Exercised {
    /// Adds a run: its attitude, and what it covers.
    pub fn add(&mut self, run: &Stability) {
        self.forces.push(run.specific_force);
        let add = |head: &mut [[f64; 2]; AXES], covered: &Coverage| {
            for ([low, high], [[from, to], _]) in head.iter_mut().zip(covered.telemetry) {
                (*low, *high) = (low.min(from), high.max(to));
            }
        };
        add(&mut self.head, &run.covered);
        if let Some(gyroscopes) = run.judged_gyroscopes() {
            add(&mut self.gyroscope_head, &gyroscopes.covered);
        }
    }

    /// What is not judged, a line each. Ends of the range that are within 5 % of it are not told.
    #[must_use]
    pub fn not_judged(&self, table: &CoefficientTable) -> Vec<String> {
        let channels = undriven(&self.forces).into_iter().map(|channel| format!("{channel} was not driven by any run"));
        let (part, missing) = self.least_covered(table);
        let range = (part < 1.0 - RANGE_TOLERANCE)
            .then(|| format!("the runs cover {:.0} % of the table's range: {missing} was not reached", 100.0 * part));
        let gyroscopes = table.content().gyroscopes.is_some().then(|| {
            "scale factors and misalignments of the gyroscopes, and their g-sensitivity across the specific forces of the runs: no run at rest \
             shows them"
                .to_owned()
        });
        channels.chain(range).chain(gyroscopes).collect()
    }

    /// Part of the range that is covered, for the bias curve of which that is least; and what of it is not, in words.
    fn least_covered(&self, table: &CoefficientTable) -> (f64, String) {
        let content = table.content();
        let sensors = |axes: &[Axis; AXES], names: [&'static str; AXES], head: [[f64; 2]; AXES]| {
            [0, 1, 2].map(|axis| (axes[axis].bias.range(), names[axis], head[axis]))
        };
        let gyroscopes = content.gyroscopes.iter();
        let gyroscopes = gyroscopes.flat_map(|it| sensors(&it.axes, GYROSCOPE_NAMES, self.gyroscope_head));
        let sensors = sensors(&content.axes, AXIS_NAMES, self.head).into_iter().chain(gyroscopes);
        let covered = sensors.map(|([low, high], name, [reached_low, reached_high])| {
            let (reached_low, reached_high) = (reached_low.clamp(low, high), reached_high.clamp(low, high));
            let part = ((reached_high - reached_low) / (high - low)).max(0.0);
            let gaps = if part > 0.0 { vec![[low, reached_low], [reached_high, high]] } else { vec![[low, high]] };
            let gaps = gaps.into_iter().filter(|[from, to]| to - from > RANGE_TOLERANCE * (high - low));
            let gaps: Vec<_> = gaps.map(|[from, to]| format!("{from:.4} to {to:.4}")).collect();
            (part, format!("bias of {name} over {} {}", gaps.join(" and "), content.temperature_unit))
        });
        covered.min_by(|(a, _), (b, _)| a.total_cmp(b)).unwrap_or_default()
    }
}

impl Gate {
    /// Why the table must not be installed, as the runs together show it.
    #[must_use]
    pub fn refuses_together(
        &self,
        runs: &Exercised,
        new: &CoefficientTable,
        in_force: Option<&CoefficientTable>,
    ) -> Vec<Refusal> {
        let bound = self.require.bias.unwrap_or(0.0);
        let mut found = Vec::new();
        for channel in undriven(&runs.forces) {
            let difference = in_force.and_then(|old| channel.difference(new, old)).filter(|most| *most > bound);
            found.extend(difference.map(|most| Refusal {
                by: "channel",
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
            for channel in Channel::all(SensorKind::Gyroscope) {
                let difference = channel.difference(new, old).filter(|most| *most > bounds.relative);
                found.extend(difference.map(|most| Refusal {
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
        let (part, missing) = runs.least_covered(new);
        if part < LEAST_COVERED {
            found.push(Refusal {
                by: "runs",
                cause: format!(
                    "the runs cover {:.0} % of the table's range, at least {:.0} % is required: {missing} was not reached; verify over the whole \
                     range",
                    100.0 * part,
                    100.0 * LEAST_COVERED
                ),
            });
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{changed, gate, run, truth, up_to};
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
            let mut runs = Exercised::default();
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
        let channel = Channel { kind: SensorKind::Accelerometer, axis: 0, positive: false };
        assert!(channel.difference(&good, &other_reference).unwrap() < 1e-12);
        assert!((channel.difference(&good, &wrong).unwrap() - 0.002).abs() < 1e-5);
    }

    /// The runs reach telemetry from 1 to 4; the table has 0.9 to 4.2.
    #[test]
    fn runs_that_cover_less_than_half_of_the_range_judge_no_table() {
        let good = truth();
        let mut whole = Exercised::default();
        whole.add(&run(&good, 0));
        assert_eq!(gate(0.0).refuses_together(&whole, &good, None), []);
        let of_range = |range: [f64; 2]| {
            let part = Exercised { head: [[1.0, 4.0], range, [1.0, 4.0]], ..whole.clone() };
            let refused = gate(0.0).refuses_together(&part, &good, None);
            (refused.into_iter().map(|refusal| refusal.cause).collect::<Vec<_>>(), part.not_judged(&good).pop())
        };
        let (refused, _) = of_range([1.0, 1.2]);
        assert_eq!(refused.len(), 1);
        assert!(
            refused[0].starts_with(
                "the runs cover 6 % of the table's range, at least 50 % is required: bias of A2 over 1.2000 to"
            ),
            "{refused:?}"
        );
        let (refused, not_judged) = of_range([1.1, 3.0]);
        assert_eq!(refused, Vec::<String>::new());
        let not_judged = not_judged.unwrap();
        assert!(
            not_judged.starts_with(
                "the runs cover 58 % of the table's range: bias of A2 over 0.9000 to 1.1000 and 3.0000 to 4.2000 V"
            ),
            "{not_judged}"
        );
        // The least covered curve is told, and of it what is over 5 % of the range.
        let others = of_range([0.95, 4.1]).1.unwrap();
        assert!(others.ends_with(": bias of A1 over 4.0000 to 4.2000 V was not reached"), "{others}");
        // No run, or none that reaches the table.
        assert!(of_range([5.0, 6.0]).0[0].contains(" 0 % "));
        assert!(!gate(0.0).refuses_together(&Exercised::default(), &up_to(2.0), None).is_empty());
    }
}
