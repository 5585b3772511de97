//! The hypotheses about what is wrong with the positions, cables or angles.

use super::position_off::MAX_POSITIONS;
use super::reduction::{Direction, Reduction, Trials, in_order, with_exchanged};
use crate::checks::SetPoint;
use isotherm_campaign::{Dwell, Position, specific_force};
use isotherm_shared::wire::AXES;
use nalgebra::Vector3;

/// A hypothesis about what is wrong.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Hypothesis {
    /// The dwells of a position (by index) were measured in another: `[i]` is the index of the true position.
    Positions(PositionMistake, Vec<usize>),
    /// The pulses of accelerometer a are in the columns of accelerometer `order[a]`, with `sign[a]`.
    Axes { order: [usize; AXES], sign: [i8; AXES] },
    /// One channel of an accelerometer is exchanged with one of another: accelerometer and channel (0 is +) of both.
    Cables([usize; 2], [usize; 2]),
    /// Outer and inner angle of all positions are off \[deg\].
    Angles([f64; 2]),
    /// One position (by index) is not where the campaign file states it.
    Off(usize),
    /// The intervals are not the time from row to row.
    Intervals,
}

/// What is wrong with the numbers of the positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PositionMistake {
    /// Two are exchanged.
    Exchanged(usize, usize),
    /// All are shifted along the list by this.
    Shifted(isize),
}

impl Trials<'_> {
    /// Residual of a set point under a hypothesis \[g0\]; infinite if its scale factors have another sign.
    pub(super) fn residual(&self, hypothesis: &Hypothesis, set_point: &SetPoint) -> f64 {
        let (stated, in_place, as_counted) =
            (|dwell: &Dwell| self.directions[dwell.position], in_order([0, 1, 2]), |_: &Dwell| 1.0);
        let (reduction, sign) = match hypothesis {
            Hypothesis::Positions(_, positions) => (self.try_positions(set_point, &[], |at| positions[at]), [1; AXES]),
            Hypothesis::Off(position) => (self.try_positions(set_point, &[*position], |at| at), [1; AXES]),
            Hypothesis::Axes { order, sign } => {
                (self.reduce(set_point, &[], &stated, in_order(*order), &as_counted), *sign)
            }
            Hypothesis::Cables(a, b) => {
                (self.reduce(set_point, &[], &stated, with_exchanged(*a, *b), &as_counted), [1; AXES])
            }
            Hypothesis::Angles([outer, inner]) => {
                let turned = |dwell: &Dwell| self.turned(dwell.position, *outer, *inner);
                (self.reduce(set_point, &[], &turned, in_place, &as_counted), [1; AXES])
            }
            Hypothesis::Intervals => {
                let time =
                    |dwell: &Dwell| Some(dwell.interval_ratio()).filter(|ratio| *ratio > 0.0).map_or(1.0, f64::recip);
                (self.reduce(set_point, &[], &stated, in_place, &time), [1; AXES])
            }
        };
        reduction.filter(|reduction| reduction.sign == sign).map_or(f64::INFINITY, |reduction| reduction.sd)
    }

    /// The direction of a position whose angles are off.
    fn turned(&self, position: usize, outer_off: f64, inner_off: f64) -> Direction {
        let stated = &self.campaign.positions[position];
        let (Some(mount), Some([outer, inner])) = (self.campaign.mount, stated.angles) else {
            return self.directions[position];
        };
        let angles = [outer + outer_off, inner + inner_off];
        let force = mount * Vector3::from(specific_force(angles[0], angles[1]));
        let position = Position { angles: Some(angles), specific_force: force.into(), ..stated.clone() };
        self.campaign.force(&position, Some([0.0; 2]))
    }

    /// The hypotheses. `worst` is the set point that is worst explained by the campaign file.
    pub(super) fn hypotheses(&self, worst: &SetPoint, with_off: bool) -> Vec<Hypothesis> {
        let mut all = self.orders(worst);
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let channels = [[0, 0], [0, 1], [1, 0], [1, 1]];
            all.extend(channels.map(|[first, second]| Hypothesis::Cables([a, first], [b, second])));
        }
        if let Some(mount) = self.campaign.mount {
            let exact = mount == mount.map(f64::round);
            // Where the mount only exchanges axes these are signed orders of the accelerometers.
            let turned: &[[f64; 2]] =
                if exact { &[] } else { &[[0.0, 90.0], [0.0, 180.0], [0.0, -90.0], [180.0, 0.0]] };
            all.extend([[90.0, 0.0], [-90.0, 0.0]].iter().chain(turned).map(|off| Hypothesis::Angles(*off)));
        }
        let count = self.campaign.positions.len();
        if count <= MAX_POSITIONS {
            all.extend(self.renumbered(count));
            let off = (0..count).filter(|position| with_off && self.spread(&[*position], *position).is_some());
            all.extend(off.map(Hypothesis::Off));
        }
        if self.dwells.iter().any(|dwell| (dwell.interval_ratio() - 1.0).abs() > 0.01) {
            all.push(Hypothesis::Intervals);
        }
        all
    }

    /// The orders of the accelerometers whose scale factors have signs at this set point, but the stated one.
    fn orders(&self, set_point: &SetPoint) -> Vec<Hypothesis> {
        let orders = [[0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]].into_iter();
        let direction = |dwell: &Dwell| self.directions[dwell.position];
        let signed = orders.filter_map(|order| {
            let Reduction { sign, .. } = self.reduce(set_point, &[], &direction, in_order(order), &|_| 1.0)?;
            let stated = (order, sign) == ([0, 1, 2], [1; AXES]);
            (!sign.contains(&0) && !stated).then_some(Hypothesis::Axes { order, sign })
        });
        signed.collect()
    }

    /// Two of the `count` positions exchanged, or all shifted.
    fn renumbered(&self, count: usize) -> impl Iterator<Item = Hypothesis> {
        let pairs = (0..count).flat_map(move |i| (i + 1..count).map(move |j| (i, j)));
        let exchanged = pairs.filter(|(i, j)| self.directions[*i] != self.directions[*j]).map(move |(i, j)| {
            let mut positions: Vec<usize> = (0..count).collect();
            positions.swap(i, j);
            Hypothesis::Positions(PositionMistake::Exchanged(i, j), positions)
        });
        let shifted = [1, -1].map(|by| {
            let shifted = |position: usize| (position as isize + by).rem_euclid(count as isize) as usize;
            Hypothesis::Positions(PositionMistake::Shifted(by), (0..count).map(shifted).collect())
        });
        exchanged.chain(shifted)
    }
}
