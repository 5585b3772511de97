//! Acquisition: from an IMU on a serial line, a network or Linux' IIO to the service.

pub mod iio;
