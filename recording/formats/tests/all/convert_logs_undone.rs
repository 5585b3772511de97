//! What ArduPilot corrects before it logs is undone. The corrections are applied here step by step, as the firmware
//! does: temperature, offset, scale, then the orientation as turns about fixed axes.

use crate::logs::{Dataflash, ImuRow, converted, refused};
use isotherm_recording_formats::convert::Settings;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_support::failure::Exit;

/// What the sensors read in each row, and the temperature.
fn truth(row: u64) -> ([f64; 3], [f64; 3], f64) {
    let phase = row as f64 / 7.0;
    ([0.5 + 0.1 * libm::sin(phase), -1.25, -9.5], [0.02, 0.03 * libm::cos(phase), -0.01], 10.0 + row as f64)
}

/// The corrections of an IMU.
#[derive(Clone, Copy)]
struct Applied {
    enable: u8,
    calibrated_at: [f64; 2],
    /// Of accelerometers and gyroscopes: orders 1 to 3 of x, y, z in millionths.
    polynomials: [[[f64; 3]; 3]; 2],
    offsets: [[f64; 3]; 2],
    scale: [f64; 3],
    /// Number of the orientation; roll, pitch, yaw [deg].
    orientation: (u8, [f64; 3]),
}

const RANGE: [f64; 2] = [15.0, 60.0];
const APPLIED: Applied = Applied {
    enable: 1,
    calibrated_at: [25.0, 70.0],
    polynomials: [
        [[-2500.0, 1800.0, 9000.0], [31.0, -17.0, 53.0], [0.7, 0.2, -0.9]],
        [[150.0, -90.0, 20.0], [1.5, 0.5, -2.0], [0.01, -0.02, 0.03]],
    ],
    offsets: [[0.25, -0.125, 0.5], [0.01, -0.02, 0.03]],
    scale: [1.01, 0.99, 1.002],
    orientation: (4, [0.0, 0.0, 180.0]),
};

impl Applied {
    fn to(&self, sensor: usize, raw: [f64; 3], celsius: f64) -> [f32; 3] {
        let polynomial = |axis: usize, celsius: f64| {
            let d = celsius.clamp(RANGE[0], RANGE[1]) - 35.0;
            let [c1, c2, c3] = [0, 1, 2].map(|order: usize| self.polynomials[sensor][order][axis] * 1e-6);
            c1 * d + c2 * d * d + c3 * d * d * d
        };
        let mut vector = raw;
        for (axis, value) in vector.iter_mut().enumerate() {
            if self.enable == 1 {
                *value += polynomial(axis, self.calibrated_at[sensor]) - polynomial(axis, celsius);
            }
            *value -= self.offsets[sensor][axis];
            *value *= if sensor == 0 { self.scale[axis] } else { 1.0 };
        }
        let [roll, pitch, yaw] = self.orientation.1;
        turned(turned(turned(vector, 0, roll), 1, pitch), 2, yaw).map(|value| value as f32)
    }

    /// Writes the parameters; `calibrations` and `sensors` are what the names of both sensors begin with.
    fn parameters(&self, log: &mut Dataflash, tcal: &str, calibrations: [&str; 2], sensors: [&str; 2]) {
        log.parameter("AHRS_ORIENTATION", self.orientation.0.into());
        log.parameter(&format!("{tcal}ENABLE"), self.enable.into());
        log.parameter(&format!("{tcal}TMIN"), RANGE[0] as f32).parameter(&format!("{tcal}TMAX"), RANGE[1] as f32);
        for (sensor, kind) in ["ACC", "GYR"].into_iter().enumerate() {
            log.parameter(&format!("{}CALTEMP", calibrations[sensor]), self.calibrated_at[sensor] as f32);
            for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
                log.parameter(&format!("{}OFFS_{name}", sensors[sensor]), self.offsets[sensor][axis] as f32);
                for order in 0..3 {
                    let value = self.polynomials[sensor][order][axis];
                    log.parameter(&format!("{tcal}{kind}{}_{name}", order + 1), value as f32);
                }
                if sensor == 0 {
                    log.parameter(&format!("{}SCAL_{name}", sensors[0]), self.scale[axis] as f32);
                }
            }
        }
    }

    fn row(&self, log: &mut Dataflash, instance: u8, row: u64) {
        let (acceleration, rate, celsius) = truth(row);
        let [acceleration, rate] = [self.to(0, acceleration, celsius), self.to(1, rate, celsius)];
        let time_us = (row + 1) * 20_000;
        log.imu(&ImuRow { time_us, instance, rate, acceleration, celsius: celsius as f32, health: 1 });
    }

    /// A log of the first IMU.
    fn log(&self) -> Dataflash {
        let mut log = Dataflash::new();
        self.parameters(&mut log, "INS_TCAL1_", ["INS_ACC1_", "INS_GYR1_"], ["INS_ACC", "INS_GYR"]);
        (0..60).for_each(|row| self.row(&mut log, 0, row));
        log
    }
}

/// A vector turned about a fixed axis.
fn turned(vector: [f64; 3], axis: usize, degrees: f64) -> [f64; 3] {
    let (sine, cosine) = libm::sincos(degrees.to_radians());
    let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut result = vector;
    result[next] = cosine * vector[next] - sine * vector[last];
    result[last] = sine * vector[next] + cosine * vector[last];
    result
}

/// Whether the rows are what the sensors read, but for what float32 rounds: 1e-6 m/s2 and 2e-8 rad/s.
fn check(samples: &[RawSample]) {
    let signed =
        |triad: &Triad, axis: usize| f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis]);
    assert_eq!(samples.len(), 60);
    for (row, sample) in (0..).zip(samples) {
        let (acceleration, rate, _) = truth(row);
        for axis in 0..3 {
            let off = signed(&sample.accelerometers, axis) * 1e-6 - acceleration[axis];
            assert!(off.abs() < 2e-6, "row {row}, axis {axis}: {off}");
            let off = signed(&sample.gyroscopes, axis) * 1e-7 - rate[axis];
            assert!(off.abs() < 1.2e-7, "row {row}, axis {axis}: {off}");
        }
    }
}

#[test]
fn temperature_calibration_offsets_scale_and_orientation_are_undone() {
    for enable in [0, 1, 2] {
        let applied = Applied { enable, ..APPLIED };
        let (samples, told) = converted(&applied.log().bytes, "bin", &Settings::default());
        check(&samples);
        let tcal = "the temperature calibration in force (INS_TCAL)";
        assert!(told.contains("offsets and scale of the accelerometers, offsets of the gyroscopes"), "{told}");
        assert_eq!(told.contains(tcal), enable == 1, "{told}");
        assert!(told.contains("AHRS_ORIENTATION 4"), "{told}");
    }
    check(&converted(APPLIED.log().text.as_bytes(), "log", &Settings::default()).0);
}

#[test]
fn every_orientation_in_steps_of_45_degrees_is_undone() {
    // Number, roll, pitch, yaw [deg], as ArduPilot documents AHRS_ORIENTATION.
    #[rustfmt::skip]
    let all: [(u8, [i16; 3]); 42] = [
        (0, [0, 0, 0]), (1, [0, 0, 45]), (2, [0, 0, 90]), (3, [0, 0, 135]), (4, [0, 0, 180]), (5, [0, 0, 225]),
        (6, [0, 0, 270]), (7, [0, 0, 315]), (8, [180, 0, 0]), (9, [180, 0, 45]), (10, [180, 0, 90]),
        (11, [180, 0, 135]), (12, [0, 180, 0]), (13, [180, 0, 225]), (14, [180, 0, 270]), (15, [180, 0, 315]),
        (16, [90, 0, 0]), (17, [90, 0, 45]), (18, [90, 0, 90]), (19, [90, 0, 135]), (20, [270, 0, 0]),
        (21, [270, 0, 45]), (22, [270, 0, 90]), (23, [270, 0, 135]), (24, [0, 90, 0]), (25, [0, 270, 0]),
        (26, [0, 180, 90]), (27, [0, 180, 270]), (28, [90, 90, 0]), (29, [180, 90, 0]), (30, [270, 90, 0]),
        (31, [90, 180, 0]), (32, [270, 180, 0]), (33, [90, 270, 0]), (34, [180, 270, 0]), (35, [270, 270, 0]),
        (36, [90, 180, 90]), (37, [90, 0, 270]), (39, [0, 315, 0]), (40, [90, 315, 0]), (42, [45, 0, 0]),
        (43, [315, 0, 0]),
    ];
    for (number, degrees) in all {
        let applied = Applied { orientation: (number, degrees.map(f64::from)), ..APPLIED };
        check(&converted(&applied.log().bytes, "bin", &Settings::default()).0);
    }
    for number in [38, 41, 44, 100, 101] {
        let applied = Applied { orientation: (number, [0.0; 3]), ..APPLIED };
        let (exit, message) = refused(&applied.log().bytes, "bin", &Settings::default());
        let expected = format!("AHRS_ORIENTATION is {number}, which cannot be undone; set it to 0 and log again");
        assert!(exit == Exit::Data && message.contains(&expected), "{message}");
    }
}

#[test]
fn each_imu_has_parameters_of_its_own() {
    let names = [
        (1, "INS_TCAL2_", ["INS_ACC2_", "INS_GYR2_"], ["INS_ACC2", "INS_GYR2"]),
        (2, "INS_TCAL3_", ["INS_ACC3_", "INS_GYR3_"], ["INS_ACC3", "INS_GYR3"]),
        (3, "INS4_TCAL_", ["INS4_ACC_", "INS4_GYR_"], ["INS4_ACC", "INS4_GYR"]),
        (4, "INS5_TCAL_", ["INS5_ACC_", "INS5_GYR_"], ["INS5_ACC", "INS5_GYR"]),
    ];
    let mut log = Dataflash::new();
    let own = |instance: u8| {
        let offsets = [[f64::from(instance); 3], [0.1 * f64::from(instance); 3]];
        Applied { offsets, scale: [1.0 + 0.01 * f64::from(instance); 3], ..APPLIED }
    };
    for (instance, tcal, calibrations, sensors) in names {
        own(instance).parameters(&mut log, tcal, calibrations, sensors);
    }
    (0..60).for_each(|row| names.iter().for_each(|(instance, ..)| own(*instance).row(&mut log, *instance, row)));
    for (instance, ..) in names {
        let settings = Settings { instance: Some(instance.into()), ..Settings::default() };
        check(&converted(&log.bytes, "bin", &settings).0);
    }
}

#[test]
fn a_change_within_the_log_is_undone_from_there_on() {
    // Rows come while the parameters are still being listed, and the calibration in force is learnt within the log.
    let mut log = Dataflash::new();
    let learning = Applied { enable: 2, ..APPLIED };
    (0..3).for_each(|row| learning.row(&mut log, 0, row));
    learning.parameters(&mut log, "INS_TCAL1_", ["INS_ACC1_", "INS_GYR1_"], ["INS_ACC", "INS_GYR"]);
    (3..30).for_each(|row| learning.row(&mut log, 0, row));
    let place = log.bytes.len();
    log.parameter("INS_TCAL1_ENABLE", 1.0);
    (30..60).for_each(|row| APPLIED.row(&mut log, 0, row));
    let (samples, told) = converted(&log.bytes, "bin", &Settings::default());
    check(&samples);
    let change = format!("corrections change 1 times within the log, first INS_TCAL1_ENABLE = 1 at byte {place}");
    assert!(told.contains(&change), "{told}");
    let place = log.bytes.len();
    log.parameter("AHRS_ORIENTATION", 8.0);
    let (exit, message) = refused(&log.bytes, "bin", &Settings::default());
    let expected = format!("byte {place}: AHRS_ORIENTATION changes to 8 within the log; split it there");
    assert!(exit == Exit::Data && message.contains(&expected), "{message}");
}

#[test]
fn what_cannot_be_undone_is_refused_by_name() {
    for (name, value, expected) in [
        ("INS_TCAL1_ENABLE", 3.0, "INS_TCAL1_ENABLE is 3, which is not known; set it to 0 and log again"),
        ("INS_ACCSCAL_Y", 0.0, "INS_ACCSCAL_Y is 0, which cannot be undone; set it to 1 and log again"),
    ] {
        let mut log = Dataflash::new();
        log.parameter(name, value).imu(&ImuRow::default());
        let (exit, message) = refused(&log.bytes, "bin", &Settings::default());
        assert!(exit == Exit::Data && message.contains(expected), "{message}");
    }
}
