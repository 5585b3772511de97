//! What is known of a run: attitude, gravity, latitude.

use crate::stability::earth_rate;
use crate::stability::earth_rate::EarthRate;
use core::fmt;
use isotherm_campaign::SAME_DIRECTION;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::AXES;
use serde::{Deserialize, Serialize};
/// Conditions of the run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    /// Direction of the specific force along A1, A2, A3, a unit vector; unknown if `None`.
    pub attitude: Option<[f64; AXES]>,
    /// Local gravity.
    pub gravity: LocalGravity,
    /// Earth's rate along the axes of the IMU; unknown if `None`.
    pub earth_rate: Option<EarthRate>,
    /// Whether samples of another device than the table's are judged; they are refused otherwise.
    pub other_device: bool,
}

/// Local gravity at the recording's place \[m/s2\], and who says so.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub enum LocalGravity {
    /// The user.
    Stated(f64),
    /// The provenance of the table: the recording is taken to come from the station that measured the table.
    Provenance(f64),
    /// Nobody. Neither the length of the output nor a constant error of an axis is then judged.
    Unknown,
}

impl LocalGravity {
    /// The stated value, otherwise that of the table's provenance.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_shared::table::CoefficientTable;
    /// use isotherm_verification::LocalGravity;
    ///
    /// let table = CoefficientTable::from_toml(include_str!("../../../../tests/data/imu-a.toml"), None)?;
    /// assert_eq!(LocalGravity::of(Some(9.8012), &table).value(), Some(9.8012));
    /// // This table has no provenance that could say where it was measured.
    /// assert_eq!(LocalGravity::of(None, &table), LocalGravity::Unknown);
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn of(stated: Option<f64>, table: &CoefficientTable) -> Self {
        stated.map(Self::Stated).or_else(|| table.gravity_local().map(Self::Provenance)).unwrap_or(Self::Unknown)
    }

    /// Its source as a word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stated(_) => "stated",
            Self::Provenance(_) => "provenance",
            Self::Unknown => "unknown",
        }
    }

    /// The value \[m/s2\], if it is known.
    #[must_use]
    pub const fn value(self) -> Option<f64> {
        match self {
            Self::Stated(value) | Self::Provenance(value) => Some(value),
            Self::Unknown => None,
        }
    }
}

/// The value with its source.
impl fmt::Display for LocalGravity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stated(value) => write!(f, "{value} m/s2, as stated"),
            Self::Provenance(value) => write!(f, "{value} m/s2, from the provenance of the table"),
            Self::Unknown => f.write_str(
                "unknown: neither the length of the output nor a constant error of an axis is judged; state --gravity-local, or take a table whose provenance has gravity_local",
            ),
        }
    }
}

impl Setup {
    /// `attitude` is a direction of any length. Earth's rate is unknown, and samples of another device are refused.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_verification::{LocalGravity, Setup};
    ///
    /// let setup = Setup::new(Some([0.0, 0.0, 2.0]), LocalGravity::Stated(9.8012)); // A3 up
    /// assert_eq!(setup.attitude, Some([0.0, 0.0, 1.0]));
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn new(attitude: Option<[f64; AXES]>, gravity: LocalGravity) -> Self {
        let attitude = attitude.map(|direction| {
            let length = direction.iter().map(|f| f * f).sum::<f64>().sqrt();
            direction.map(|f| f / length)
        });
        Self { attitude, gravity, earth_rate: None, other_device: false }
    }

    /// At these angles of the turntable \[deg\], if they are given: with Earth's rate and the attitude that the
    /// provenance of the table gives for them. The attitude from the angles is the finer one, as it includes the tilt
    /// of the base.
    ///
    /// # Errors
    /// If the provenance has no Earth's rate, or if the stated attitude is not that of the angles.
    pub fn at_angles(self, table: &CoefficientTable, angles_deg: Option<[f64; 2]>) -> Result<Self, String> {
        let Some(angles) = angles_deg else { return Ok(self) };
        let turntable = table.turntable().ok_or(
            "--angles needs a table whose provenance has earth_rate_deg_h, from a campaign with turns and angles: without it nothing says how \
             the IMU sat on the turntable",
        )?;
        let attitude = earth_rate::attitude(turntable, angles);
        let far = |stated: [f64; AXES]| stated.iter().zip(attitude).any(|(a, b)| (a - b).abs() > SAME_DIRECTION);
        if let Some(stated) = self.attitude.filter(|stated| far(*stated)) {
            let [[s1, s2, s3], [a1, a2, a3]] = [stated, attitude];
            return Err(format!(
                "--angles and --attitude do not agree: the angles give ({a1:.4}, {a2:.4}, {a3:.4}), the attitude is ({s1:.4}, {s2:.4}, {s3:.4}); \
                 correct one, or give only --angles"
            ));
        }
        Ok(Self { attitude: Some(attitude), earth_rate: Some(EarthRate::at(turntable, angles)), ..self })
    }
}
