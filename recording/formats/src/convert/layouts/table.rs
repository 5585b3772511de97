//! The layouts that are known.

use super::super::roles::ColumnNumbers;
use isotherm_shared::wire::AXES;

/// Columns that a layout has: names without brackets, in lower case.
pub(in super::super) struct Layout {
    pub(in super::super) name: &'static str,
    /// The columns of the time and its unit. The first that is there is taken.
    pub(super) time: &'static [(&'static str, &'static str)],
    pub(super) accelerometer: [&'static str; AXES],
    pub(super) gyroscope: Option<[&'static str; AXES]>,
    /// Units of both; empty of counts.
    pub(super) units: [&'static str; 2],
    /// One pulse of both.
    pub(super) resolution: &'static str,
    /// The columns of the temperature. The first that is there is taken.
    pub(super) temperature: &'static [&'static str],
    /// Further columns that distinguish the layout from others.
    pub(super) also: &'static [&'static str],
    /// Whether it has no other column.
    pub(super) is_all: bool,
    /// Columns of the time \[us\] that accelerations and rates are sums over.
    pub(super) durations: Option<[&'static str; 2]>,
    /// What is known of the numbers in addition, for the note.
    pub(in super::super) remark: &'static str,
}

pub(super) const PLAIN: Layout = Layout {
    name: "",
    time: &[("timestamp", "us")],
    accelerometer: ["x", "y", "z"],
    gyroscope: None,
    units: ["m/s2", "rad/s"],
    resolution: "1e-6",
    temperature: &[],
    also: &[],
    is_all: false,
    durations: None,
    remark: "",
};

const CORRECTED: &str = "; PX4 has corrected the numbers by its calibration: a table would be of what is left";

pub(super) static LAYOUTS: [Layout; 10] = [
    Layout {
        name: "EuRoC",
        time: &[("timestamp", "ns")],
        accelerometer: ["a_rs_s_x", "a_rs_s_y", "a_rs_s_z"],
        gyroscope: Some(["w_rs_s_x", "w_rs_s_y", "w_rs_s_z"]),
        is_all: true,
        ..PLAIN
    },
    Layout {
        name: "Kalibr's bag creator",
        time: &[("timestamp", "ns")],
        accelerometer: ["alpha_x", "alpha_y", "alpha_z"],
        gyroscope: Some(["omega_x", "omega_y", "omega_z"]),
        is_all: true,
        ..PLAIN
    },
    Layout {
        name: "ulog2csv, sensor_combined",
        accelerometer: ["accelerometer_m_s2[0]", "accelerometer_m_s2[1]", "accelerometer_m_s2[2]"],
        gyroscope: Some(["gyro_rad[0]", "gyro_rad[1]", "gyro_rad[2]"]),
        remark: CORRECTED,
        ..PLAIN
    },
    VEHICLE_IMU,
    Layout { durations: Some(["dt", "dt"]), ..VEHICLE_IMU },
    Layout {
        name: "ulog2csv, sensor_accel",
        temperature: &["temperature"],
        also: &["temperature", "device_id", "error_count"],
        ..PLAIN
    },
    Layout { time: &[("micros", "us")], also: &["imu_degc", "output_hz"], ..OPENLOG },
    OPENLOG,
    ARDUINO,
    Layout { gyroscope: None, ..ARDUINO },
];

const VEHICLE_IMU: Layout = Layout {
    name: "ulog2csv, vehicle_imu",
    accelerometer: ["delta_velocity[0]", "delta_velocity[1]", "delta_velocity[2]"],
    gyroscope: Some(["delta_angle[0]", "delta_angle[1]", "delta_angle[2]"]),
    durations: Some(["delta_velocity_dt", "delta_angle_dt"]),
    remark: CORRECTED,
    ..PLAIN
};

const OPENLOG: Layout = Layout {
    name: "OpenLog Artemis",
    time: &[("rtctime", "iso8601")],
    accelerometer: ["ax", "ay", "az"],
    gyroscope: Some(["gx", "gy", "gz"]),
    units: ["mg", "deg/s"],
    resolution: "1e-3",
    temperature: &["imu_degc"],
    also: &["imu_degc"],
    ..PLAIN
};

const ARDUINO: Layout = Layout {
    name: "counts of an Arduino",
    time: &[("micros", "us"), ("millis", "ms")],
    accelerometer: ["ax", "ay", "az"],
    gyroscope: Some(["gx", "gy", "gz"]),
    units: ["", ""],
    resolution: "1",
    temperature: &["temp", "temperature", "t", "tmp"],
    is_all: true,
    ..PLAIN
};

/// An OpenLog Artemis without its header, and imu_tk, which has none: they are known by their numbers.
pub(super) static UNNAMED_OPENLOG: Layout = OPENLOG;
pub(super) static IMU_TK: Layout =
    Layout { name: "imu_tk", time: &[("", "s")], units: ["", ""], resolution: "1", ..PLAIN };

impl Layout {
    /// The columns of the sensors, the times that they are sums over, and what shows the layout.
    fn needed(&self) -> impl Iterator<Item = &'static str> {
        let sensors = self.accelerometer.into_iter().chain(self.gyroscope.into_iter().flatten());
        sensors.chain(self.also.iter().copied()).chain(self.durations.into_iter().flatten())
    }

    /// Whether a header with these columns is of the layout.
    pub(super) fn fits(&self, bases: &[String]) -> bool {
        let has = |wanted: &str| bases.iter().any(|base| base == wanted);
        let time = self.time.iter().find(|(column, _)| has(column));
        let temperature = self.temperature.iter().find(|column| has(column)).copied();
        let is_known = |base: &String| {
            let named = time.map(|(column, _)| *column).into_iter().chain(temperature);
            self.needed().chain(named).any(|column| column == base)
        };
        time.is_some()
            && self.needed().all(has)
            && (!self.is_all || bases.iter().all(|base| is_known(base) || base.is_empty()))
    }

    /// What the numbers of accelerometers (0) or gyroscopes (1) are.
    pub(super) fn numbers(&self, index: usize) -> ColumnNumbers {
        match self.units[index] {
            "" => ColumnNumbers::Counts,
            unit => ColumnNumbers::Unit(unit, self.resolution),
        }
    }
}
