//! Rates of change over a sliding window, and whether they are low enough.

use super::plan::{Plan, SoakPlan};
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::{AXES, RawSample, Triad};
use std::array;
use std::collections::VecDeque;

/// Least number of points of a window where values are frequent. More frequent values are averaged, so that memory is
/// bounded.
const POINTS_PER_WINDOW: f64 = 64.0;
/// A window counts as full when its points span this fraction of it.
const FULL_FRACTION: f64 = 0.9;
/// Least number of points of a slope.
const MIN_POINTS: usize = 4;

/// The slope of a straight line through the values of the last `window_s`.
#[derive(Clone, Debug)]
pub(crate) struct RateWindow {
    window_s: f64,
    /// Time \[s\] and value of each point.
    points: VecDeque<[f64; 2]>,
    /// The values that the next point will be the mean of: count, sum of times, sum of values.
    open: [f64; 3],
}

impl RateWindow {
    /// An empty window of `window_s`.
    pub(crate) const fn new(window_s: f64) -> Self {
        Self { window_s, points: VecDeque::new(), open: [0.0; 3] }
    }

    /// Removes all points.
    pub(crate) fn clear(&mut self) {
        self.points.clear();
        self.open = [0.0; 3];
    }

    /// Adds `value` at `time_s`. A time before the last point clears the window first. A NaN or infinite value is
    /// ignored.
    pub(crate) fn add(&mut self, time_s: f64, value: f64) {
        if !value.is_finite() {
            return;
        }
        if self.points.back().is_some_and(|last| time_s < last[0]) {
            self.clear();
        }
        let [count, time, sum] = self.open;
        self.open = [count + 1.0, time + time_s, sum + value];
        if self.points.back().is_none_or(|last| time_s - last[0] >= self.window_s / POINTS_PER_WINDOW) {
            let [count, time, sum] = self.open;
            self.points.push_back([time / count, sum / count]);
            self.open = [0.0; 3];
        }
        // The first point is removed when the others fill the window without it. Where points are rare, the window gets
        // longer.
        while self.points.len() > MIN_POINTS
            && self.points.get(1).is_some_and(|second| time_s - second[0] >= self.window_s)
        {
            self.points.pop_front();
        }
    }

    /// Rate of change per hour; `None` until the window is full.
    pub(crate) fn per_h(&self) -> Option<f64> {
        let span = self.points.back()?[0] - self.points.front()?[0];
        (span >= FULL_FRACTION * self.window_s && self.points.len() >= MIN_POINTS).then(|| self.slope() * 3600.0)
    }

    /// Rate of change per second of all points, by least squares.
    fn slope(&self) -> f64 {
        let count = self.points.len() as f64;
        let [time, value] = self.points.iter().fold([0.0; 2], |[t, v], p| [t + p[0] / count, v + p[1] / count]);
        let (sxy, sxx) = self.points.iter().fold((0.0, 0.0), |(xy, xx), p| {
            let x = p[0] - time;
            (xy + x * (p[1] - value), xx + x * x)
        });
        sxy / sxx
    }
}

/// Head and board of each accelerometer, then of each gyroscope.
pub(crate) fn temperature(sample: &RawSample) -> [[f64; 2]; 2 * AXES] {
    let RawSample { accelerometers, gyroscopes, .. } = sample;
    let of = |triad: &Triad, axis: usize| [triad.head_temperature[axis], triad.board_temperature[axis]];
    array::from_fn(|sensor| of(if sensor < AXES { accelerometers } else { gyroscopes }, sensor % AXES))
}

/// The rates of change that decide whether a set point has settled.
#[derive(Clone, Debug)]
pub(crate) struct Trends {
    chamber: RateWindow,
    imus: Vec<ImuTrends>,
}

/// The rates of change of an IMU's temperatures.
#[derive(Clone, Debug)]
struct ImuTrends {
    /// What stands before the names of its sensors: the name of an IMU of a batch.
    name: String,
    /// Head and board of each accelerometer, and of each gyroscope if they are calibrated.
    sensors: Vec<[RateWindow; 2]>,
}

impl Trends {
    /// Empty windows for the IMUs of `plan`: for their accelerometers, and for their gyroscopes if they are calibrated.
    pub(crate) fn new(plan: &Plan) -> Self {
        let trend = || RateWindow::new(plan.soak.window_s);
        let sensors = if plan.turns.is_empty() { AXES } else { 2 * AXES };
        let imu = |plan: &Plan| ImuTrends {
            name: plan.member.as_ref().map_or_else(String::new, |member| format!("{} ", member.imu)),
            sensors: (0..sensors).map(|_| [trend(), trend()]).collect(),
        };
        Self { chamber: trend(), imus: plan.each().iter().map(imu).collect() }
    }

    /// Empties all windows, after an interruption.
    pub(crate) fn clear(&mut self) {
        self.chamber.clear();
        self.imus.iter_mut().flat_map(|imu| &mut imu.sensors).flatten().for_each(RateWindow::clear);
    }

    /// Leaves out the IMU number `imu` of the plan from now on: it is dropped.
    pub(crate) fn leave_out(&mut self, imu: usize) {
        self.imus[imu].sensors.clear();
    }

    /// Adds the temperature of the chamber's air \[degC\] at a laboratory time.
    pub(crate) fn chamber(&mut self, time_s: f64, air_c: f64) {
        self.chamber.add(time_s, air_c);
    }

    /// Adds the temperature of a sample of the IMU number `imu` of the plan, at the sample's own timestamp.
    pub(crate) fn sample(&mut self, imu: usize, sample: &RawSample) {
        let time_s = sample.timestamp_ns as f64 / 1e9;
        for (trends, [head, board]) in self.imus[imu].sensors.iter_mut().zip(temperature(sample)) {
            trends[0].add(time_s, head);
            trends[1].add(time_s, board);
        }
    }

    /// Rate of change of the chamber's air \[degC/h\]; `None` until its window is full.
    pub(crate) fn chamber_c_per_h(&self) -> Option<f64> {
        self.chamber.per_h()
    }

    /// Rate of change of the fastest temperature of all IMUs \[unit/h\], and its name; `None` until all windows are
    /// full.
    pub(crate) fn temperature_per_h(&self) -> Option<(f64, String)> {
        let mut fastest: Option<(f64, String)> = None;
        for ImuTrends { name: imu, sensors } in &self.imus {
            let names = AXIS_NAMES.iter().chain(&GYROSCOPE_NAMES);
            for (trends, name) in sensors.iter().zip(names) {
                for (trend, place) in trends.iter().zip(["head", "board"]) {
                    let rate = trend.per_h()?;
                    if fastest.as_ref().is_none_or(|(most, _)| rate.abs() > most.abs()) {
                        fastest = Some((rate, format!("{imu}{name} {place}")));
                    }
                }
            }
        }
        fastest
    }

    /// Which rate is not within its limit yet; `None` if all are.
    pub(crate) fn unsettled(&self, soak: &SoakPlan) -> Option<String> {
        let window = soak.window_s;
        let Some(chamber) = self.chamber_c_per_h() else {
            return Some(format!("chamber watched for less than {window:.0} s"));
        };
        if chamber.abs() > soak.chamber_c_per_h {
            return Some(format!("chamber {chamber:+.2} degC/h, limit {:?}", soak.chamber_c_per_h));
        }
        let limit = soak.temperature_per_h?;
        match self.temperature_per_h() {
            None => Some(format!("IMU watched for less than {window:.0} s")),
            Some((rate, which)) => (rate.abs() > limit).then(|| format!("{which} {rate:+.4} per h, limit {limit:?}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_slope_is_the_slope_however_fast_the_points_come() {
        for step_s in [0.01, 1.0, 10.0, 100.0, 160.0, 250.0] {
            let mut trend = RateWindow::new(600.0);
            for index in 0..(500.0 / step_s) as u32 {
                trend.add(f64::from(index) * step_s, 20.0);
                assert_eq!(trend.per_h(), None, "{step_s}");
            }
            for index in 0..(2000.0 / step_s) as u32 {
                let time_s = 600.0 + f64::from(index) * step_s;
                trend.add(time_s, 20.0 + time_s * 2.0 / 3600.0);
            }
            assert!((trend.per_h().unwrap() - 2.0).abs() < 1e-6, "{step_s}: {:?}", trend.per_h());
            assert!(trend.points.len() <= 130, "{step_s}: {}", trend.points.len());
            trend.add(3000.0, f64::NAN);
            trend.add(10.0, 1.0);
            assert_eq!(trend.per_h(), None);
        }
    }

    #[test]
    fn the_slowest_of_a_batch_is_waited_for_until_it_is_dropped() {
        let plan = Plan::from_toml(include_str!("../../../examples/plan-batch.toml"), Path::new("")).unwrap();
        let mut trends = Trends::new(&plan);
        for second in 0..1200_u64 {
            trends.chamber(second as f64, 20.0);
            for imu in 0..3 {
                let mut sample = RawSample { timestamp_ns: second * 1_000_000_000, ..RawSample::default() };
                sample.accelerometers = Triad::default();
                sample.accelerometers.head_temperature[2] =
                    second as f64 * 0.05 / 3600.0 * f64::from(u8::from(imu == 1));
                trends.sample(imu, &sample);
            }
        }
        let unsettled = trends.unsettled(&plan.soak);
        assert_eq!(unsettled.as_deref(), Some("imu-b A3 head +0.0500 per h, limit 0.03"));
        trends.leave_out(1);
        assert_eq!(trends.unsettled(&plan.soak), None);
    }

    #[test]
    fn gyroscopes_are_waited_for_if_they_are_calibrated() {
        let unsettled = |plan: &str| {
            let plan = Plan::from_toml(plan, Path::new("")).unwrap();
            let mut trends = Trends::new(&plan);
            for second in 0..1200_u64 {
                let mut sample = RawSample { timestamp_ns: second * 1_000_000_000, ..RawSample::default() };
                (sample.accelerometers, sample.gyroscopes) = (Triad::default(), Triad::default());
                sample.gyroscopes.board_temperature[1] = second as f64 * 0.05 / 3600.0;
                trends.chamber(second as f64, 20.0);
                trends.sample(0, &sample);
            }
            trends.unsettled(&plan.soak)
        };
        assert_eq!(unsettled(include_str!("../../../examples/plan.toml")), None);
        let whole = unsettled(include_str!("../../../examples/plan-whole.toml"));
        assert_eq!(whole.as_deref(), Some("G2 board +0.0500 per h, limit 0.03"));
    }
}
