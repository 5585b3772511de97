//! What the pulses of readings stand for: enough for a nominal table.

use isotherm_shared::names::ImuId;
use isotherm_shared::readings::Resolution;
use isotherm_shared::table::Nominal;
use isotherm_shared::wire::RawSample;

/// What the pulses of converted readings stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// What one pulse over the nominal interval stands for.
    pub resolution: Resolution,
    /// The nominal interval \[ns\].
    pub interval_ns: u64,
    /// Whether there are gyroscopes.
    pub has_gyroscopes: bool,
    /// Largest readings of an accelerometer \[m/s2\] and of a gyroscope \[rad/s\], where a mapping says them.
    pub largest: [Option<f64>; 2],
    /// Numbers of accelerometer and gyroscope, in logs of autopilots that have them.
    pub devices: [Option<u32>; 2],
    /// Lowest and highest temperature of all sensors and boards in the rows, in its unit; where it is constant, one
    /// unit below and above.
    pub temperature: [f64; 2],
}

impl Scale {
    /// The scale of both, whose temperature is joined.
    ///
    /// # Errors
    /// What differs, with its article.
    pub fn with(self, other: &Self) -> Result<Self, &'static str> {
        let differs = [
            ("the nominal interval", self.interval_ns != other.interval_ns),
            ("the resolution", self.resolution != other.resolution),
            ("the presence of gyroscopes", self.has_gyroscopes != other.has_gyroscopes),
            ("the range of the sensors", self.largest != other.largest),
            ("the device", self.devices != other.devices),
        ];
        match differs.iter().find(|(_, differs)| *differs) {
            Some((what, _)) => Err(what),
            None => {
                let ([low, high], [other_low, other_high]) = (self.temperature, other.temperature);
                Ok(Self { temperature: [low.min(other_low), high.max(other_high)], ..self })
            }
        }
    }

    /// What [`nominal_table`](isotherm_shared::table::nominal_table) takes, with temperature in degC and standard
    /// gravity.
    #[must_use]
    pub fn nominal(&self, imu: &ImuId) -> Nominal {
        let [max_specific_force, max_angular_rate] = self.largest;
        let (resolution, has_gyroscopes) = (self.resolution, self.has_gyroscopes);
        let nominal = Nominal::new(imu.clone(), self.interval_ns, self.temperature);
        Nominal { resolution, has_gyroscopes, max_specific_force, max_angular_rate, ..nominal }
    }
}

/// The temperature of the rows so far: lowest and highest.
#[derive(Clone, Copy, Debug)]
pub(super) struct TemperatureRange([f64; 2]);

impl Default for TemperatureRange {
    fn default() -> Self {
        Self([f64::INFINITY, f64::NEG_INFINITY])
    }
}

impl TemperatureRange {
    /// Takes a row. What is no finite number is left out.
    pub(super) fn take(&mut self, sample: &RawSample) {
        let triads = [Some(&sample.accelerometers), Some(&sample.gyroscopes).filter(|triad| !triad.is_absent())];
        for triad in triads.into_iter().flatten() {
            let all = triad.head_temperature.iter().chain(&triad.board_temperature);
            for value in all.filter(|value| value.is_finite()) {
                self.0 = [self.0[0].min(*value), self.0[1].max(*value)];
            }
        }
    }

    /// The temperature of all rows, if they have only one.
    pub(super) fn only(self) -> Option<f64> {
        let [low, high] = self.0;
        (low == high).then_some(low)
    }

    /// The range; `None` without a finite value.
    pub(super) fn range(self) -> Option<[f64; 2]> {
        let [low, high] = self.0;
        match low < high {
            true => Some([low, high]),
            false => low.is_finite().then_some([low - 1.0, low + 1.0]),
        }
    }
}
