//! The attitude of a run: a direction, the angles of the turntable, or a position of a campaign file.

use crate::stability::turntable_attitude;
use isotherm_campaign::{Campaign, Position, SAME_DIRECTION, specific_force};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::AXES;
use nalgebra::Vector3;
use std::str::FromStr;

/// An error of the direction that is below this needs no more digits \[g0\].
const NEGLIGIBLE: f64 = 5e-8;
/// A length that is closer to 1 is that of a unit vector: nothing was rounded.
const EXACT: f64 = 1e-12;

/// The attitude of a run, as a user states it.
///
/// ```
/// use isotherm_verification::Attitude;
///
/// assert_eq!("0,0,1".parse(), Ok(Attitude::Direction { direction: [0.0, 0.0, 1.0], decimals: 0 }));
/// assert_eq!("90,180".parse(), Ok(Attitude::Angles([90.0, 180.0])));
/// assert_eq!("+x".parse(), Ok(Attitude::Position("+x".to_owned())));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Attitude {
    /// The direction of the specific force along A1, A2, A3, of any length.
    Direction {
        /// The direction.
        direction: [f64; AXES],
        /// Decimals of the component that has most of them.
        decimals: u32,
    },
    /// Outer and inner angle of the turntable \[deg\].
    Angles([f64; 2]),
    /// Number or name of a position of a campaign file.
    Position(String),
}

impl FromStr for Attitude {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<_> = text.split(',').map(str::trim).collect();
        let numbers: Option<Vec<f64>> =
            parts.iter().map(|part| part.parse().ok().filter(|number: &f64| number.is_finite())).collect();
        match numbers.as_deref() {
            Some(&[x, y, z]) => {
                let direction = [x, y, z];
                let is_some = direction.iter().any(|part| part.abs() > 1e-6);
                let is_right = is_some && direction.iter().all(|part| part.abs() < 1e6);
                let decimals = parts.iter().map(|part| decimals(part)).max().unwrap_or_default();
                let found = is_right.then_some(Self::Direction { direction, decimals });
                found.ok_or_else(|| "give a direction, for example 0,0,1".to_owned())
            }
            Some(&[outer, inner]) => Ok(Self::Angles([outer, inner])),
            _ if parts.len() == 1 && !text.trim().is_empty() => Ok(Self::Position(text.trim().to_owned())),
            _ => Err("give a direction along A1, A2, A3, for example 0,0,1; the angles of the turntable, \
                 OUTER,INNER; or with --campaign the number or name of a position"
                .to_owned()),
        }
    }
}

impl Attitude {
    /// The direction of the specific force along A1, A2, A3, as exactly as it is known. `campaign` says how the IMU sat
    /// on the turntable, and `tilt` is that of the base \[rad\], by the provenance of the table.
    ///
    /// # Errors
    /// If angles or a position need a campaign file, or if it has no such position.
    pub fn direction(
        &self,
        table: &CoefficientTable,
        campaign: Option<&Campaign>,
        tilt: Option<[f64; 2]>,
    ) -> Result<[f64; AXES], String> {
        match (self, campaign) {
            (Self::Direction { direction, .. }, _) => Ok(*direction),
            (Self::Angles([outer, inner]), Some(campaign)) => {
                let mount = campaign.mount.ok_or(
                    "--attitude: the positions of the campaign file do not say how the IMU sat on the \
                     turntable; give their angles, or the direction along A1, A2, A3",
                )?;
                let force = (mount * Vector3::from(specific_force(*outer, *inner))).into();
                let position = Position { specific_force: force, ..Position::at(0, *outer, *inner) };
                Ok(campaign.force(&position, tilt).0)
            }
            (Self::Angles(angles), None) => {
                let attitude = table.turntable().map(|turntable| turntable_attitude(turntable, *angles));
                attitude.ok_or_else(|| {
                    "--attitude: with angles of the turntable give the campaign file too, --campaign FILE: it \
                     says how the IMU sat on the turntable"
                        .to_owned()
                })
            }
            (Self::Position(name), Some(campaign)) => Ok(campaign.force(position(campaign, name, tilt)?, tilt).0),
            (Self::Position(name), None) => Err(format!(
                "--attitude: {name:?} is a position; give its campaign file, --campaign FILE, or a direction \
                 such as 0,0,1"
            )),
        }
    }

    /// What the digits of a typed direction leave, and how many it needs; `None` if that does not matter.
    #[must_use]
    pub fn note(&self) -> Option<String> {
        let &Self::Direction { direction, decimals } = self else { return None };
        let length = direction.iter().map(|part| part * part).sum::<f64>().sqrt();
        let rounded = direction.iter().filter(|part| **part != 0.0 && part.abs() != 1.0).count() as f64;
        let step = 10_f64.powi(-i32::try_from(decimals).unwrap_or(i32::MAX));
        // The length of a unit vector whose digits end differs by no more than they can be.
        let looks_rounded =
            decimals > 0 && (length - 1.0).abs() <= rounded.sqrt() * step && (length - 1.0).abs() > EXACT;
        let left = 0.5 * step * rounded.sqrt();
        if !looks_rounded || left <= NEGLIGIBLE {
            return None;
        }
        let needed = libm::log10(0.5 * rounded.sqrt() / NEGLIGIBLE).ceil();
        Some(format!(
            "--attitude: {decimals} decimals leave up to {:.1}e-6 g0 across the specific force, which counts as \
             an error of the table; give {needed} decimals, or with --campaign FILE the angles OUTER,INNER or the number \
             of a position",
            left * 1e6
        ))
    }
}

/// Decimals of a number as it is written.
fn decimals(text: &str) -> u32 {
    let digits = text.split(['e', 'E']).next().and_then(|mantissa| mantissa.split_once('.'));
    digits.map_or(0, |(_, decimals)| decimals.len() as u32)
}

/// The position of this number, or of this name if all of that name have one direction, also on a tilted base.
fn position<'c>(campaign: &'c Campaign, name: &str, tilt: Option<[f64; 2]>) -> Result<&'c Position, String> {
    let of_number = |number: u32| campaign.positions.iter().find(|position| position.number == number);
    if let Some(position) = name.parse().ok().and_then(of_number) {
        return Ok(position);
    }
    let named: Vec<_> = campaign.positions.iter().filter(|position| position.label == name).collect();
    let numbers = |positions: &[&Position]| {
        positions.iter().map(|position| position.number.to_string()).collect::<Vec<_>>().join(", ")
    };
    match named.as_slice() {
        [] => {
            let all: Vec<_> = campaign.positions.iter().collect();
            Err(format!("--attitude: the campaign file has no position {name:?}; it has {}", numbers(&all)))
        }
        [only] => Ok(only),
        [first, ..] => {
            let is_same = |other: &&Position| {
                other.specific_force.iter().zip(first.specific_force).all(|(a, b)| (a - b).abs() < SAME_DIRECTION)
            };
            let headings = tilt.is_none() || named.iter().all(|position| position.angles == first.angles);
            if named.iter().all(is_same) && headings {
                return Ok(first);
            }
            Err(format!(
                "--attitude: the campaign file has several positions {name:?}, whose headings differ; give the \
                 number: {}",
                numbers(&named)
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> CoefficientTable {
        CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None).unwrap()
    }

    fn campaign() -> Campaign {
        Campaign::from_toml(include_str!("../../../examples/campaign/campaign.toml")).unwrap()
    }

    #[test]
    fn digits_that_cost_more_than_is_negligible_are_told() {
        let note = |text: &str| text.parse::<Attitude>().unwrap().note();
        // The direction of a corner, to so many decimals.
        let five = note("0.57735,0.57735,0.57735").unwrap();
        assert!(five.contains("5 decimals leave up to 8.7e-6 g0") && five.contains("give 8 decimals"), "{five}");
        assert!(note("0.7071,-0.7071,0").unwrap().contains("4 decimals leave up to 70.7e-6 g0"));
        for exact in
            ["0,0,1", "0.60,-0.48,0.64", "1,1,1", "0.57735027,0.57735027,0.57735027", "0.0,0.0,-1.0", "3,1", "+x"]
        {
            assert_eq!(note(exact), None, "{exact}");
        }
        // The digits cost no more than is said.
        let exact = 3.0_f64.sqrt().recip();
        let error = [0.57735 - exact; 3].map(|off: f64| off * off).iter().sum::<f64>().sqrt();
        assert!(error < 8.7e-6);
    }

    #[test]
    fn angles_and_positions_are_exact_and_have_the_tilt_of_the_base() {
        let (table, campaign) = (table(), campaign());
        let direction = |text: &str, tilt| text.parse::<Attitude>().unwrap().direction(&table, Some(&campaign), tilt);
        assert_eq!(direction("5", None), Ok([1.0, 0.0, 0.0]));
        assert_eq!(direction("+x", None), Ok([1.0, 0.0, 0.0]));
        let angled = direction("45,0", None).unwrap();
        assert!((angled[1] - 0.5_f64.sqrt()).abs() < 1e-15 && (angled[2] - 0.5_f64.sqrt()).abs() < 1e-15, "{angled:?}");
        let tilt = Some([40e-6, -60e-6]);
        assert_eq!(direction("1", tilt), Ok(campaign.force(&campaign.positions[0], tilt).0));
        assert!(direction("1", tilt).unwrap()[0].abs() > 30e-6);
        // On a tilted base two headings of one name differ.
        let named = direction("+z", tilt).unwrap_err();
        assert!(named.contains("give the number: 1, 2"), "{named}");
        assert!(direction("13", None).unwrap_err().contains("no position \"13\"; it has 1, 2, 3"));
        for alone in ["1", "90,0"] {
            let refused = alone.parse::<Attitude>().unwrap().direction(&table, None, None).unwrap_err();
            assert!(refused.contains("--campaign FILE"), "{refused}");
        }
        for wrong in ["", "0,0,0", "1,2,3,4", "x,y,z", "1e9,0,0"] {
            assert!(wrong.parse::<Attitude>().is_err(), "{wrong}");
        }
    }
}
