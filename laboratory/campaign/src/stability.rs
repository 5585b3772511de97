//! Rates of change, over a window that slides.

use super::plan::Soak;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::{AXES, RawSample};
use std::collections::VecDeque;

/// Points of a window, at least; what comes faster is averaged, so that memory does not grow with the sampling rate.
const POINTS: f64 = 64.0;
/// A window is full when its points reach over this part of it.
const FULL: f64 = 0.9;
/// A slope needs so many points.
const LEAST: usize = 4;

/// A straight line through what came in the last while.
#[derive(Clone, Debug)]
pub struct Trend {
    window_s: f64,
    /// Time \[s\] and value.
    points: VecDeque<[f64; 2]>,
    /// What the next point is the mean of: their count, sums of time and value.
    open: [f64; 3],
}

impl Trend {
    /// Over `window_s`.
    pub const fn new(window_s: f64) -> Self {
        Self { window_s, points: VecDeque::new(), open: [0.0; 3] }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.points.clear();
        self.open = [0.0; 3];
    }

    /// Adds `value` at `time_s`. A time that falls begins anew; a value that is no number is left out.
    pub fn add(&mut self, time_s: f64, value: f64) {
        if !value.is_finite() {
            return;
        }
        if self.points.back().is_some_and(|last| time_s < last[0]) {
            self.clear();
        }
        let [count, time, sum] = self.open;
        self.open = [count + 1.0, time + time_s, sum + value];
        if self.points.back().is_none_or(|last| time_s - last[0] >= self.window_s / POINTS) {
            let [count, time, sum] = self.open;
            self.points.push_back([time / count, sum / count]);
            self.open = [0.0; 3];
        }
        // A point goes when the others fill the window without it: where points are rare it is longer instead.
        while self.points.len() > LEAST && self.points.get(1).is_some_and(|second| time_s - second[0] >= self.window_s)
        {
            self.points.pop_front();
        }
    }

    /// Change per hour; `None` until the window is full.
    pub fn per_h(&self) -> Option<f64> {
        let span = self.points.back()?[0] - self.points.front()?[0];
        (span >= FULL * self.window_s && self.points.len() >= LEAST).then(|| self.slope() * 3600.0)
    }

    /// Change per second of the points that there are, by least squares.
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

/// The rates that say whether a set point has settled.
#[derive(Clone, Debug)]
pub struct Trends {
    chamber: Trend,
    /// Of each accelerometer, head and board.
    imu: [[Trend; 2]; AXES],
}

impl Trends {
    /// Over `window_s`.
    pub fn new(window_s: f64) -> Self {
        let trend = || Trend::new(window_s);
        Self { chamber: trend(), imu: [0, 1, 2].map(|_| [trend(), trend()]) }
    }

    /// Forgets everything, after an interruption.
    pub fn clear(&mut self) {
        self.chamber.clear();
        self.imu.iter_mut().flatten().for_each(Trend::clear);
    }

    /// The chamber's air \[degC\] at a laboratory time.
    pub fn chamber(&mut self, time_s: f64, air_c: f64) {
        self.chamber.add(time_s, air_c);
    }

    /// A sample, at its own time.
    pub fn sample(&mut self, sample: &RawSample) {
        let time_s = sample.timestamp_ns as f64 / 1e9;
        for (axis, trends) in self.imu.iter_mut().enumerate() {
            trends[0].add(time_s, sample.head_temperature[axis]);
            trends[1].add(time_s, sample.board_temperature[axis]);
        }
    }

    /// Rate of the chamber's air \[degC/h\].
    pub fn chamber_c_per_h(&self) -> Option<f64> {
        self.chamber.per_h()
    }

    /// The fastest of the IMU's temperatures \[unit/h\], and which.
    pub fn telemetry_per_h(&self) -> Option<(f64, String)> {
        let mut fastest: Option<(f64, String)> = None;
        for (axis, trends) in self.imu.iter().enumerate() {
            for (trend, place) in trends.iter().zip(["head", "board"]) {
                let rate = trend.per_h()?;
                if fastest.as_ref().is_none_or(|(most, _)| rate.abs() > most.abs()) {
                    fastest = Some((rate, format!("{} {place}", AXIS_NAMES[axis])));
                }
            }
        }
        fastest
    }

    /// What is not settled yet; `None` if everything is.
    pub fn unsettled(&self, soak: &Soak) -> Option<String> {
        let window = soak.window_s;
        let Some(chamber) = self.chamber_c_per_h() else {
            return Some(format!("chamber watched for less than {window:.0} s"));
        };
        if chamber.abs() > soak.chamber_c_per_h {
            return Some(format!("chamber {chamber:+.2} degC/h, limit {:?}", soak.chamber_c_per_h));
        }
        let limit = soak.telemetry_per_h?;
        match self.telemetry_per_h() {
            None => Some(format!("IMU watched for less than {window:.0} s")),
            Some((rate, which)) => (rate.abs() > limit).then(|| format!("{which} {rate:+.4} per h, limit {limit:?}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_the_slope_however_fast_the_points_come() {
        for step_s in [0.01, 1.0, 10.0, 100.0, 160.0, 250.0] {
            let mut trend = Trend::new(600.0);
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
}
