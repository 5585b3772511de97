//! What a campaign file says.

use crate::gravity::{GravitySource, Place, gravity_warning};
use crate::position::Position;
use crate::ramp::Ramp;
use crate::samples::SampleLayout;
use crate::turn::Turn;
use isotherm_shared::names::ImuId;
use isotherm_shared::table::OutOfRange;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::Finding;
use nalgebra::{Matrix3, Matrix3x2, Vector2, Vector3};

/// The content of a campaign file.
#[derive(Clone, Debug, PartialEq)]
pub struct Campaign {
    /// The IMU that was measured.
    pub imu: ImuId,
    /// Serial number, free text.
    pub serial: Option<String>,
    /// Files of the samples, relative to the campaign file: one file, or the pieces of one recording in any order. Not
    /// required with only ramps.
    pub samples: Vec<String>,
    /// How they are laid out; files by position are named by patterns.
    pub layout: SampleLayout,
    /// The scale factor of the accelerometers by their data sheet, within a factor of 2 \[pulse/(s*g0)\].
    pub nominal_scale_factor: Option<f64>,
    /// The value of 1 g0 \[m/s2\]; it is written into the table.
    pub gravity_reference: f64,
    /// Gravity at the station \[m/s2\].
    pub gravity_local: f64,
    /// Where it comes from; normal gravity only with `is_tumble`.
    pub gravity_source: GravitySource,
    /// Unit of the temperature; only a label.
    pub temperature_unit: String,
    /// The table's policy for temperature out of range, if stated; otherwise a fitted table clamps, and one of only
    /// ramps keeps the policy of its predecessor `curves`.
    pub out_of_range: Option<OutOfRange>,
    /// Temperature older than this is flagged \[s\]; it is written into the table.
    pub max_age_s: Option<f64>,
    /// Largest plausible rate of both channels together \[pulse/s\]; a higher rate means saturation. It is written into
    /// the table.
    pub max_rate: Option<f64>,
    /// Least time between two set points \[s\], if stated.
    pub soak_s: Option<f64>,
    /// The positions; none with only ramps. If `mount` only exchanges axes or their signs, the directions are computed
    /// exactly from the angles.
    pub positions: Vec<Position>,
    /// Orientation of the IMU on the turntable, if the angles are stated; see [`mount`](crate::mount()).
    pub mount: Option<Matrix3<f64>>,
    /// The turns from rest to rest; none if the gyroscopes are not calibrated.
    pub turns: Vec<Turn>,
    /// Latitude of the station \[deg\], north positive; always there with turns.
    pub latitude_deg: Option<f64>,
    /// Height of the station \[m\], see [`Place`]: with the latitude it checks local gravity.
    pub height_m: Option<f64>,
    /// The ramps, for the transients; none if they are not estimated.
    pub ramps: Vec<Ramp>,
    /// The table that gives what ramps do not show, relative to the campaign file. There if and only if the campaign
    /// has only ramps.
    pub curves: Option<String>,
    /// Whether the samples are recordings of a tumble: static poses, with only the magnitude of gravity as the
    /// reference. Then there are no positions, turns or ramps.
    pub is_tumble: bool,
    /// Where a table of order 0 is valid, in the temperature's unit; only with `is_tumble`.
    pub temperature_range: Option<[f64; 2]>,
}

impl Campaign {
    /// The campaign of a tumble, with gravity's length as the reference: local gravity and the
    /// value of 1 g0 \[m/s2\], and the temperature's unit. It has no files.
    ///
    /// ```
    /// use isotherm_campaign::Campaign;
    /// use isotherm_shared::names::ImuId;
    ///
    /// let imu = ImuId::new("imu-a").expect("a valid name");
    /// let campaign = Campaign::tumble(imu, [9.8012, 9.80665], "degC");
    /// assert!(campaign.is_tumble && campaign.positions.is_empty());
    /// ```
    #[must_use]
    pub fn tumble(imu: ImuId, [gravity_local, gravity_reference]: [f64; 2], temperature_unit: &str) -> Self {
        Self {
            imu,
            serial: None,
            samples: Vec::new(),
            layout: SampleLayout::Rows,
            nominal_scale_factor: None,
            gravity_reference,
            gravity_local,
            gravity_source: GravitySource::Stated,
            temperature_unit: temperature_unit.to_owned(),
            out_of_range: None,
            max_age_s: None,
            max_rate: None,
            soak_s: None,
            positions: Vec::new(),
            mount: None,
            turns: Vec::new(),
            latitude_deg: None,
            height_m: None,
            ramps: Vec::new(),
            curves: None,
            is_tumble: true,
            temperature_range: None,
        }
    }

    /// The campaign of recordings at one attitude while the temperature changes: the value of 1 g0 \[m/s2\], the
    /// temperature's unit, and what the recordings are called.
    #[must_use]
    pub fn warm_up(imu: ImuId, gravity: f64, temperature_unit: &str, recordings: &[String]) -> Self {
        let ramp = |samples: &String| Ramp { samples: samples.clone(), specific_force: None };
        let ramps = recordings.iter().map(ramp).collect();
        Self { is_tumble: false, ramps, ..Self::tumble(imu, [gravity; 2], temperature_unit) }
    }

    /// The campaign at a place, which checks its local gravity.
    #[must_use]
    pub const fn at_place(mut self, place: Place) -> Self {
        (self.latitude_deg, self.height_m) = (Some(place.latitude_deg()), Some(place.height_m()));
        self
    }

    /// The campaign with normal gravity at a place, where local gravity is not known.
    #[must_use]
    pub fn with_normal_gravity(self, place: Place) -> Self {
        let (gravity_local, gravity_source) = (place.normal_gravity(), GravitySource::Normal(place));
        Self { gravity_local, gravity_source, ..self.at_place(place) }
    }

    /// The warning that local gravity is over 0.002 m/s2 off normal gravity at the station, if latitude and height are
    /// stated.
    #[must_use]
    pub fn gravity_warning(&self) -> Option<Finding> {
        let place = Place::new(self.latitude_deg?, self.height_m?).ok()?;
        gravity_warning(self.gravity_local, place)
    }

    /// Whether there are ramps, and no positions: the samples give bias curves and transients, nothing else.
    #[must_use]
    pub const fn has_ramps_alone(&self) -> bool {
        self.positions.is_empty() && !self.is_tumble
    }

    /// Specific force along A1, A2, A3 in `position` \[g0\], and its derivatives by the base's tilt \[g0/rad\].
    /// Without a tilt, or without angles, the base is level and the derivatives are 0.
    ///
    /// ```text
    /// f = g_local/g0 * mount * R' u,    u = (-ty, tx, 1) / |(-ty, tx, 1)|
    /// ```
    #[must_use]
    pub fn force(&self, position: &Position, tilt: Option<[f64; 2]>) -> ([f64; AXES], [[f64; 2]; AXES]) {
        let gravity = self.gravity_local / self.gravity_reference;
        let level = Vector3::from(position.specific_force) * gravity;
        let (Some([tx, ty]), Some(mount), Some(by_tilt)) = (tilt, self.mount, position.by_tilt()) else {
            return (level.into(), [[0.0; 2]; AXES]);
        };
        let by_tilt = mount * Matrix3x2::from_fn(|i, j| by_tilt[i][j]) * gravity;
        let length = (1.0 + tx * tx + ty * ty).sqrt();
        let force = (level + by_tilt * Vector2::new(tx, ty)) / length;
        let change = by_tilt / length - force * Vector2::new(tx, ty).transpose() / (length * length);
        (force.into(), [0, 1, 2].map(|i| [change[(i, 0)], change[(i, 1)]]))
    }
}
