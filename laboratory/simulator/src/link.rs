//! How the IMU hears of what the machines do: it asks `?`, and a machine answers a line with its time and all events since the last
//! answer. What happens after that has a later time, so that up to it the IMU knows everything.

use serde::{Deserialize, Serialize};
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

/// What a machine begins to do.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub enum Event {
    /// The chamber makes for a temperature \[degC\] at a rate \[degC/s\].
    Chamber { target_c: f64, ramp_c_per_s: f64 },
    /// An axis makes for an angle \[deg\] at a rate \[deg/s\], with an acceleration \[deg/s2\].
    GoTo { axis: usize, angle_deg: f64, rate: f64, acceleration: f64 },
    /// An axis stops with an acceleration \[deg/s2\].
    Stop { axis: usize, acceleration: f64 },
    /// The table swings by an amplitude \[deg\].
    Swing { amplitude_deg: f64 },
}

/// A machine's answer.
#[derive(Debug, Deserialize, Serialize)]
pub struct Answer {
    /// Simulated time \[s\].
    pub now_s: f64,
    /// With their times \[s\].
    pub events: Vec<(f64, Event)>,
}

/// The IMU's end.
pub struct Asking(BufReader<UnixStream>);

impl Asking {
    /// By a socket that was handed over as a standard stream.
    pub fn new(stream: impl AsFd) -> io::Result<Self> {
        Ok(Self(BufReader::new(stream.as_fd().try_clone_to_owned()?.into())))
    }

    /// Asks, and waits for the answer.
    pub fn ask(&mut self) -> io::Result<Answer> {
        self.0.get_mut().write_all(b"?")?;
        let mut line = String::new();
        self.0.read_line(&mut line)?;
        serde_json::from_str(&line).map_err(|_| io::Error::new(io::ErrorKind::UnexpectedEof, "the machine has gone"))
    }
}

/// A machine's end.
pub struct Answering(pub UnixStream);

impl Answering {
    /// By a socket that was handed over as a standard stream.
    pub fn new(stream: impl AsFd) -> io::Result<Self> {
        Ok(Self(stream.as_fd().try_clone_to_owned()?.into()))
    }

    /// Takes a question that `poll` has told of, and answers it. `false` if the IMU has gone.
    pub fn answer(&mut self, answer: &Answer) -> io::Result<bool> {
        if self.0.read(&mut [0])? == 0 {
            return Ok(false);
        }
        let line = serde_json::to_string(answer)? + "\n";
        self.0.write_all(line.as_bytes())?;
        Ok(true)
    }
}
