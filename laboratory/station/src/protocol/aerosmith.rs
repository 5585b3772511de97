//! An Ideal Aerosmith table with two axes. A request begins with the number of the axis; a reply is a line, then the
//! prompt.

use crate::turntable::{Interlock, TurntableDevice};
use crate::wire::Protocol;

pub(super) struct AerosmithProtocol {
    rate: [f64; 2],
    acceleration: [f64; 2],
}

impl Default for AerosmithProtocol {
    fn default() -> Self {
        Self { rate: [10.0; 2], acceleration: [10.0; 2] }
    }
}

impl AerosmithProtocol {
    /// Executes a request and returns the line of the reply; `None` for an unknown request.
    fn command(&mut self, request: &str, device: &mut TurntableDevice) -> Option<String> {
        let axis = match request.get(..1)? {
            "1" => 0,
            "2" => 1,
            _ => return None,
        };
        let (command, value) = (request.get(1..4)?, request.get(4..)?);
        let number = value.parse::<f64>().ok();
        match command {
            "PPO" => return Some(format!("{:.4}", device.angle_deg(axis))),
            "PVE" => return Some(format!("{:.4}", device.rate_deg_s(axis))),
            "STA" => return Some(if device.interlock(axis) == Interlock::Fault { "4" } else { "0" }.to_owned()),
            "VEL" => self.rate[axis] = number?,
            "ACL" => self.acceleration[axis] = number?,
            "STO" => device.stop(axis),
            "MOV" => {
                // This model has no command for power: a move powers the axis, and resets a fault whose cause no longer
                // exists.
                device.reset(axis);
                device.close(axis);
                device.go_to(axis, number?, self.rate[axis], self.acceleration[axis]);
            }
            _ => return None,
        }
        Some(String::new())
    }
}

impl Protocol<TurntableDevice> for AerosmithProtocol {
    fn answer(&mut self, request: &[u8], device: &mut TurntableDevice) -> Vec<u8> {
        let reply = self.command(String::from_utf8_lossy(request).trim(), device);
        reply.map_or_else(Vec::new, |line| format!("{line}\r\n>\r\n").into_bytes())
    }

    fn refuse(&self, _: &[u8]) -> Vec<u8> {
        Vec::new()
    }
}
