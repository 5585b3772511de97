//! The link from the devices to the IMU. The IMU sends `?`, and a device answers with a line: its time, and all events
//! since the last answer. Later events have later times, so the IMU knows all events up to the time of the answer.

use serde::{Deserialize, Serialize};
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

/// The beginning of an action of a device.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub enum DeviceEvent {
    /// The chamber starts a ramp.
    Chamber {
        /// To this temperature \[degC\].
        target_c: f64,
        /// At this rate \[degC/s\].
        ramp_c_per_s: f64,
    },
    /// An axis starts a move.
    GoTo {
        /// 0 for the outer axis, 1 for the inner one.
        axis: usize,
        /// To this angle \[deg\].
        angle_deg: f64,
        /// At this rate \[deg/s\].
        rate: f64,
        /// With this acceleration \[deg/s2\].
        acceleration: f64,
    },
    /// An axis brakes to rest.
    Stop {
        /// 0 for the outer axis, 1 for the inner one.
        axis: usize,
        /// With this acceleration \[deg/s2\].
        acceleration: f64,
    },
    /// The turntable starts to oscillate, or ends it.
    Swing {
        /// Amplitude \[deg\]; 0 ends the oscillation.
        amplitude_deg: f64,
    },
}

/// A device's answer.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct DeviceReply {
    /// Simulated time of the answer \[s\].
    pub now_s: f64,
    /// Events since the last answer, with their simulated times \[s\].
    pub events: Vec<(f64, DeviceEvent)>,
}

/// The IMU's end.
pub(crate) struct LinkClient(BufReader<UnixStream>);

impl LinkClient {
    /// Uses a socket that was inherited as a standard stream.
    pub(crate) fn new(stream: impl AsFd) -> io::Result<Self> {
        Ok(Self(BufReader::new(stream.as_fd().try_clone_to_owned()?.into())))
    }

    /// Sends the question and waits for the answer.
    pub(crate) fn ask(&mut self) -> io::Result<DeviceReply> {
        self.0.get_mut().write_all(b"?")?;
        let mut line = String::new();
        self.0.read_line(&mut line)?;
        serde_json::from_str(&line).map_err(|_| io::Error::new(io::ErrorKind::UnexpectedEof, "the machine has gone"))
    }
}

/// A device's end.
pub(crate) struct LinkServer(pub UnixStream);

impl LinkServer {
    /// Uses a socket that was inherited as a standard stream.
    pub(crate) fn new(stream: impl AsFd) -> io::Result<Self> {
        Ok(Self(stream.as_fd().try_clone_to_owned()?.into()))
    }

    /// Receives a question, which `poll` has reported, and answers it. Returns `false` if the IMU's process has ended.
    pub(crate) fn answer(&mut self, answer: &DeviceReply) -> io::Result<bool> {
        if self.0.read(&mut [0])? == 0 {
            return Ok(false);
        }
        let line = serde_json::to_string(answer)? + "\n";
        self.0.write_all(line.as_bytes())?;
        Ok(true)
    }
}
