//! The nominal table of a description.

use crate::description::{Description, Kind};
use crate::iio;
use isotherm_client::{Resolution, SourcePulses};
use isotherm_recording_formats::convert::{Kind as Count, Sensors};
use isotherm_shared::table::{CoefficientTable, Content, Nominal, PulseScale, Refusals, nominal_content};
use isotherm_support::failure::{Exit, Failure};
use std::path::Path;

/// Range of the temperature \[degC\], which a nominal table does not use.
const RANGE: [f64; 2] = [-40.0, 85.0];

impl Description {
    /// What the pulses of its samples are. `sysfs` as for [`nominal`](Self::nominal).
    pub(crate) fn pulses(&self, sysfs: &Path) -> SourcePulses {
        let (columns, interval_ns) = (&self.columns, self.timing.interval_ns);
        let one = self.nominal(sysfs).ok().map(|table| PulseScale::of(&table));
        let of_gyroscopes = columns.gyroscope.and(one).and_then(|one| one.angle);
        let are_readings =
            [columns.accelerometer.is_reading, columns.gyroscope.is_some_and(|gyroscope| gyroscope.is_reading)];
        let resolution = |one: f64, is_reading: bool| if is_reading { one * 1e9 / interval_ns as f64 } else { one };
        SourcePulses {
            interval_ns,
            are_counts: !columns.adopts(),
            are_readings,
            resolution: [
                one.map(|one| resolution(one.velocity[0], are_readings[0])),
                of_gyroscopes.map(|angle| resolution(angle[0], are_readings[1])),
            ],
        }
    }

    /// The nominal table of the source's samples: scale factors by what a pulse stands for, and nothing else. Its
    /// increments are the readings of the device.
    ///
    /// What a pulse stands for is said by `unit` or `scale` in the description, or by the kernel for IIO, whose devices
    /// are looked at: `sysfs` is `/`, or a tree for tests.
    ///
    /// # Errors
    /// If it is not known what a pulse stands for, or an IIO device cannot be looked at.
    pub fn nominal(&self, sysfs: &Path) -> Result<CoefficientTable, Failure> {
        let refused = |why: String| Failure::new(Exit::Config, format!("no nominal table: {why}"));
        let scales = match &self.kind {
            Kind::Iio(settings) => {
                let source = iio::open(sysfs, settings)?;
                // A scale that the kernel has cut off is none.
                source.scales().iter().map(|scale| (scale.rounding < 0.01).then_some(scale.scale)).collect()
            }
            _ => Vec::new(),
        };
        let of = |sensors: &Sensors, section: &str, resolution: f64, scales: &[Option<f64>]| {
            let one = match (scales, sensors.unit) {
                ([Some(x), Some(y), Some(z)], None) if x == y && y == z => Ok(*x),
                ([Some(_), Some(_), Some(_)], None) => Err(format!("{section}: the axes have different scales")),
                ([_, _, _], None) => Err(format!(
                    "{section}: the kernel gives the scale with a digit or two; give scale from the data sheet"
                )),
                (_, Some(unit)) => Ok(unit),
                (_, None) if sensors.kind == Count::Reading && resolution != 1.0 && sensors.offset == 0.0 => Ok(1.0),
                (_, None) => Err(format!(
                    "{section}: the numbers look like counts; give scale, what one stands for in m/s2 or rad/s, or of \
                     increments in m/s or rad"
                )),
            }?;
            let per_interval = match sensors.kind {
                Count::Increment => 1e9 / self.timing.interval_ns as f64,
                // A description has no counts and rates of a text.
                Count::Reading | Count::Count | Count::Rate => 1.0,
            };
            Ok((resolution * one * per_interval, sensors.range.map(|range| range * one)))
        };
        let resolution = &self.columns.resolution;
        let part = |from: usize| scales.get(from..from + 3).unwrap_or_default();
        let accelerometer = &self.sensors.accelerometer;
        let (accelerometer, max_specific_force) =
            of(accelerometer, "accelerometer", resolution.accelerometer, part(0)).map_err(refused)?;
        let gyroscope = self.sensors.gyroscope.as_ref();
        let gyroscope = gyroscope.map(|sensors| of(sensors, "gyroscope", resolution.gyroscope, part(3)));
        let has_gyroscopes = gyroscope.is_some();
        let (gyroscope, max_angular_rate) =
            gyroscope.transpose().map_err(refused)?.unwrap_or((Resolution::default().gyroscope, None));
        let nominal = Nominal {
            resolution: Resolution { accelerometer, gyroscope },
            has_gyroscopes,
            max_specific_force,
            max_angular_rate,
            ..Nominal::new(self.imu.clone(), self.timing.interval_ns, RANGE)
        };
        let content = nominal_content(&nominal).map_err(|refusal| Refusals(vec![refusal]));
        let content = content.map(|content| Content { serial: self.serial.clone(), ..content });
        let table = content.and_then(|content| CoefficientTable::new(content).map_err(Refusals));
        table.map_err(|refusals| refused(refusals.to_string()))
    }
}
