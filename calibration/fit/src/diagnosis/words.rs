//! What is said about a hypothesis that holds: the mistake and its remedy.

use super::explanation::EXPLAINS;
use super::hypothesis::{Hypothesis, PositionMistake};
use super::reduction::Trials;
use isotherm_campaign::{Position, SAME_DIRECTION, specific_force};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::name;
use nalgebra::{Matrix3, Vector3};

impl Trials<'_> {
    fn number(&self, position: usize) -> u32 {
        self.campaign.positions[position].number
    }

    /// Name and words of a hypothesis that holds at the set points `scope`.
    pub(super) fn describe(&self, hypothesis: &Hypothesis, scope: &[usize]) -> (&'static str, String) {
        let everywhere = scope.len() == self.set_points.len();
        let place = self.place(scope);
        let file = if everywhere { "in the campaign file" } else { "in these rows of the samples" };
        match hypothesis {
            Hypothesis::Positions(PositionMistake::Exchanged(i, j), _) => {
                let (i, j) = (self.number(*i).min(self.number(*j)), self.number(*i).max(self.number(*j)));
                let text = format!("positions {i} and {j} look exchanged{place}: exchange their numbers {file}");
                (name::POSITIONS_EXCHANGED, text)
            }
            Hypothesis::Positions(PositionMistake::Shifted(by), positions) => {
                let (first, actual, by) = (self.number(0), self.number(positions[0]), by.abs());
                let text = format!(
                    "the position numbers look shifted by {by} along the campaign file's list{place}: rows of number {first} were measured in \
                     position {actual}, and so on; correct the numbers {file}"
                );
                (name::POSITIONS_EXCHANGED, text)
            }
            Hypothesis::Axes { order, sign } => self.describe_axes(*order, *sign, &place, everywhere),
            Hypothesis::Cables(a, b) => (name::CHANNELS_EXCHANGED, describe_cables(*a, *b, &place, everywhere)),
            Hypothesis::Angles(off) => {
                let (key, off) = if off[0] != 0.0 { ("outer_deg", off[0]) } else { ("inner_deg", off[1]) };
                let text = format!(
                    "{key} of every position looks off by {off} degrees{place}: add {off} to it, and correct specific_force"
                );
                (name::HEADING, text)
            }
            Hypothesis::Off(position) => {
                (name::POSITION_OFF, self.describe_off(*position, scope, &[*position], &place))
            }
            Hypothesis::Intervals => {
                let text = format!(
                    "interval_ns is not the time from row to row in some of the dwells{place}, and with that time all dwells agree: give the \
                     measured time of each row"
                );
                (name::INTERVAL, text)
            }
        }
    }

    /// ` at set point 5 degC`; nothing for all set points.
    fn place(&self, scope: &[usize]) -> String {
        let of = |i: usize| self.set_points[i].set_point_c;
        let mut values: Vec<String> = scope.iter().map(|&i| of(i).to_string()).collect();
        values.dedup();
        match scope {
            _ if scope.len() == self.set_points.len() => String::new(),
            [one] => format!(" at set point {} degC", of(*one)),
            _ => format!(" at {} of {} set points ({} degC)", scope.len(), self.set_points.len(), values.join(", ")),
        }
    }

    fn describe_axes(
        &self,
        order: [usize; AXES],
        sign: [i8; AXES],
        place: &str,
        everywhere: bool,
    ) -> (&'static str, String) {
        // Where only a part of the campaign is wrong it is not the campaign file.
        let or_file = |fix: &str| if everywhere { format!(", or {fix}") } else { " in these rows".to_owned() };
        let flipped: Vec<usize> = (0..AXES).filter(|&axis| sign[axis] < 0).collect();
        let own: Vec<usize> = (0..AXES).filter(|&axis| order[axis] == axis).collect();
        // Determinant of the signed order: 1 for a turned IMU.
        let transposed = if own.len() == 1 { -1 } else { 1 };
        let proper = transposed * i32::from(sign[0] * sign[1] * sign[2]) == 1;
        let carried = carried(order, sign);
        // Then only the angles may be wrong, in a file without directions too.
        let along = self.campaign.mount == Some(Matrix3::identity());
        match (own.as_slice(), flipped.as_slice()) {
            ([_, _, _], flipped) => describe_signs(flipped, place, along, &or_file("correct the positions")),
            ([own], []) => describe_pair(*own, place, &or_file("their components in every specific_force")),
            ([about], [one]) if proper && one != about => describe_turn(*about, sign[0], place, along, &carried),
            _ => {
                let what = if proper {
                    "the IMU looks mounted otherwise than the campaign file states"
                } else {
                    "accelerometers look exchanged"
                };
                let text =
                    format!("{what}{place}: {carried}; correct every specific_force, or exchange cables or columns");
                (name::AXES_EXCHANGED, text)
            }
        }
    }

    /// `position 3 is 1.00 degrees from where the campaign file states it: ..`
    pub(super) fn describe_off(&self, position: usize, scope: &[usize], off: &[usize], place: &str) -> String {
        let stated = &self.campaign.positions[position];
        let number = stated.number;
        let direction = Vector3::from(stated.specific_force);
        let Some((offset, _)) = self.measured(position, scope, off) else {
            return format!(
                "position {number} is not where the campaign file states it{place}: measure it again, or leave it out"
            );
        };
        let actual = direction + offset;
        let angle = direction.angle(&actual).to_degrees();
        let length = actual.norm();
        // An angle of the same size would not change the length.
        if (length - 1.0).abs() > angle.to_radians() {
            return format!(
                "position {number} reads {length:.5} of the local gravity{place}: pulses were lost or counted twice, the interval is wrong, or \
                 the IMU moved; measure it again, or leave it out with --exclude"
            );
        }
        let same = |other: &&Position| {
            other.number != number && (Vector3::from(other.specific_force) - actual).norm() < 10.0 * SAME_DIRECTION
        };
        let other = self.campaign.positions.iter().find(same).filter(|_| angle > 5.0);
        let reads = other.map_or_else(String::new, |other| format!(", as position {} is", other.number));
        let angles = self.angle_off(stated, &actual).unwrap_or_default();
        format!(
            "position {number} is {angle:.2} degrees from where the campaign file states it{place}: the specific force was measured along \
             [{:.5}, {:.5}, {:.5}]{reads}{angles}; correct its angles and specific_force, measure it again, or leave it out with --exclude",
            actual[0], actual[1], actual[2]
        )
    }

    /// `, as at inner_deg = 91.00 instead of 90`, if one angle of the turntable explains the direction.
    fn angle_off(&self, stated: &Position, actual: &Vector3<f64>) -> Option<String> {
        let (mount, [outer, inner]) = (self.campaign.mount?, stated.angles?);
        let at = mount.transpose() * actual.normalize();
        let distance = |outer: f64, inner: f64| (Vector3::from(specific_force(outer, inner)) - at).norm();
        let before = distance(outer, inner);
        // f = (sin(outer) sin(inner), sin(outer) cos(inner), cos(outer)), with one of the angles as it is stated.
        let (sin_inner, cos_inner) = libm::sincos(inner.to_radians());
        let outer_at = libm::atan2(at[0] * sin_inner + at[1] * cos_inner, at[2]).to_degrees();
        let sign = libm::sin(outer.to_radians()).signum();
        let inner_at = libm::atan2(sign * at[0], sign * at[1]).to_degrees();
        let near = |angle: f64, stated: f64| stated + (angle - stated + 180.0).rem_euclid(360.0) - 180.0;
        let (outer_at, inner_at) = (near(outer_at, outer), near(inner_at, inner));
        let (by_outer, by_inner) = (distance(outer_at, inner), distance(outer, inner_at));
        if by_outer.min(by_inner) > before / EXPLAINS {
            return None;
        }
        Some(match by_outer < by_inner {
            true => format!(", as at outer_deg = {outer_at:.2} instead of {outer}"),
            false => format!(", as at inner_deg = {inner_at:.2} instead of {inner}"),
        })
    }
}

/// Single channels of two accelerometers that are exchanged.
fn describe_cables(a: [usize; 2], b: [usize; 2], place: &str, everywhere: bool) -> String {
    let channel = |[axis, channel]: [usize; 2]| format!("the {} channel of {}", ["+", "-"][channel], AXIS_NAMES[axis]);
    let column = |[axis, channel]: [usize; 2]| format!("a{}_{}", axis + 1, ["positive", "negative"][channel]);
    let here = if everywhere { "" } else { " in these rows" };
    format!(
        "{} and {} look exchanged{place}: exchange their cables, or the columns {} and {}{here}",
        channel(a),
        channel(b),
        column(a),
        column(b)
    )
}

/// The accelerometers of the campaign file that the columns carry, in words.
fn carried(order: [usize; AXES], sign: [i8; AXES]) -> String {
    let carried = [0, 1, 2].map(|column| {
        let axis = (0..AXES).find(|&axis| order[axis] == column).unwrap_or(column);
        format!("{}{}", if sign[axis] < 0 { "-" } else { "" }, AXIS_NAMES[axis])
    });
    format!("the columns a1, a2, a3 carry {}", carried.join(", "))
}

/// Both axes but `own` are exchanged; `or_file` is the remedy in the campaign file.
fn describe_pair(own: usize, place: &str, or_file: &str) -> (&'static str, String) {
    let pair: Vec<_> = (0..AXES).filter(|axis| *axis != own).map(|axis| AXIS_NAMES[axis]).collect();
    let text = format!("{} look exchanged{place}: exchange their cables or columns{or_file}", pair.join(" and "));
    (name::AXES_EXCHANGED, text)
}

/// The IMU is turned by 90 degrees about the axis `about`; `first` is the sign of the first axis.
fn describe_turn(about: usize, first: i8, place: &str, along: bool, carried: &str) -> (&'static str, String) {
    let inner = match (along, about) {
        (true, 2) => format!("; add {} to every inner_deg", if first < 0 { 90 } else { -90 }),
        _ => String::new(),
    };
    let text = format!(
        "the IMU looks turned by 90 degrees about {} against the campaign file{place} (heading, inner_deg or mounting), {carried}: \
         correct the angles and specific_force of every position{inner}",
        AXIS_NAMES[about]
    );
    (name::HEADING, text)
}

/// Every accelerometer in its own columns, and those in `flipped` with the other sign. `along` says whether the IMU is
/// along the turntable's axes, `or_file` how the campaign file can be corrected instead.
fn describe_signs(flipped: &[usize], place: &str, along: bool, or_file: &str) -> (&'static str, String) {
    match flipped {
        [axis] => {
            let (name, column) = (AXIS_NAMES[*axis], axis + 1);
            let mirrored = if along && *axis == 0 { ", or the sign of every inner_deg" } else { "" };
            let text = format!(
                "the two channels of {name} look exchanged{place}, or the sign of {name} in every specific_force{mirrored} (the data are the \
                 same): exchange a{column}_positive and a{column}_negative{or_file}"
            );
            (name::CHANNELS_EXCHANGED, text)
        }
        [a, b] => {
            let about = 3 - a - b;
            let text = format!(
                "the IMU looks turned by 180 degrees about {} against the campaign file{place} (heading, inner_deg or mounting), or the \
                 channels of {} and {} are exchanged (the data are the same): correct the angles and specific_force of every position{}",
                AXIS_NAMES[about],
                AXIS_NAMES[*a],
                AXIS_NAMES[*b],
                if along && about == 2 { "; add 180 to every inner_deg" } else { "" }
            );
            (name::HEADING, text)
        }
        _ => {
            let (outer, add) = match along {
                true => (", or outer_deg of every position is off by 180 degrees", "; add 180 to every outer_deg"),
                false => ("", ""),
            };
            let text = format!(
                "every specific_force looks to have the wrong sign{place}{outer}, or all channels are exchanged (the data are the same): the \
                 specific force of an axis that points up is +1; correct the positions{add}, or exchange the columns"
            );
            (name::CHANNELS_EXCHANGED, text)
        }
    }
}
