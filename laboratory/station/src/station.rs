//! What a station is: its description, its processes and the protocols that its devices can have.

use isotherm_client::monotonic_ns;
use isotherm_shared::wire::AXES;
use isotherm_simulation::{Chain, Noise, Play};
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantNames};

/// An IMU of a station.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct StationImu {
    /// Its name.
    pub id: String,
    /// The rotation from the turntable's axes to its own, by rows.
    pub mounting: [[f64; AXES]; AXES],
    /// The file of its true coefficients in the station's folder.
    pub truth: String,
    /// Seed of its noise.
    pub seed: u64,
}

/// Mountings of the IMUs on one turntable, in order: each turns the axes of the one before.
const MOUNTINGS: [[[f64; AXES]; AXES]; 4] = [
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
];

impl StationImu {
    /// IMU number `number` of `count`, counted from 0, of a station with this seed. Each has another mounting and
    /// another seed.
    #[must_use]
    pub fn new(id: &str, number: usize, count: usize, seed: u64) -> Self {
        let truth = if count == 1 { "truth.toml".to_owned() } else { format!("truth-{id}.toml") };
        let mounting = MOUNTINGS[number % MOUNTINGS.len()];
        Self { id: id.to_owned(), mounting, truth, seed: seed.wrapping_add(number as u64) }
    }
}

/// A station, as described in its file DIR/station.json.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct SimulatedStation {
    /// The IMUs on the turntable, whose samples are published.
    pub imus: Vec<StationImu>,
    /// Protocol of the chamber.
    pub chamber: ChamberProtocol,
    /// Port of the chamber: a symbolic link to a pseudo-terminal, or `tcp://127.0.0.1:port`.
    pub chamber_port: String,
    /// Protocol of the turntable.
    pub table: TurntableProtocol,
    /// Port of the turntable.
    pub table_port: String,
    /// Whether the turntable takes angles modulo 360 degrees and goes the shorter way.
    pub wrap: bool,
    /// Simulated seconds per second.
    pub speed: f64,
    /// CLOCK_MONOTONIC at simulated time 0 \[ns\].
    pub origin_ns: u64,
    /// Control period of the IMU \[ns\].
    pub interval_ns: u64,
    /// Seed of the turntable's errors and of the phase of the chamber's oscillation.
    pub seed: u64,
    /// Temperature of the laboratory, and of the chamber at the beginning \[degC\].
    pub ambient_c: f64,
    /// The chamber's fastest ramp \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Tilt of the turntable's base \[rad\].
    pub tilt_rad: [f64; 2],
    /// Local gravity \[m/s2\].
    pub gravity_local: f64,
    /// Latitude, north positive \[deg\]. Only gyroscopes feel it.
    pub latitude_deg: f64,
    /// Heading of the turntable's outer axis, clockwise from north \[deg\]. Only gyroscopes feel it.
    pub heading_deg: f64,
    /// The IMU's measurement chain.
    pub chain: Chain,
    /// The random errors.
    pub noise: Noise,
    /// The hysteresis of the IMU's biases, which its true table does not describe.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plays: Vec<Play>,
}

impl SimulatedStation {
    /// Simulated time \[s\].
    pub(super) fn now_s(&self) -> f64 {
        monotonic_ns().saturating_sub(self.origin_ns) as f64 / 1e9 * self.speed
    }
}

/// One process of a station. Its text is its name in file names and messages.
#[derive(Clone, Copy, Debug, Eq, EnumString, IntoStaticStr, PartialEq, VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum StationProcess {
    /// The chamber.
    Chamber,
    /// The turntable.
    #[strum(serialize = "table")]
    Turntable,
    /// The IMUs.
    Imu,
}

/// Protocol of a chamber. Its text is the name of its driver.
#[derive(Clone, Copy, Debug, Deserialize, Eq, EnumString, IntoStaticStr, PartialEq, Serialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ChamberProtocol {
    /// ESPEC P-300.
    Espec,
    /// Watlow F4T.
    WatlowF4t,
    /// Voetsch and Weiss, ASCII-2.
    Ascii2,
}

/// Protocol of a turntable. Its text is the name of its driver.
#[derive(Clone, Copy, Debug, Deserialize, Eq, EnumString, IntoStaticStr, PartialEq, Serialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum TurntableProtocol {
    /// ACUTROL 3000.
    Acutrol,
    /// Ideal Aerosmith.
    Aerosmith,
}
