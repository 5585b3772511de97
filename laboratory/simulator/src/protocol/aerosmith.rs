//! An Ideal Aerosmith table with two axes, the axis in front of the command: a line, then the prompt.

use super::take_line;
use crate::server::Speaker;
use crate::turntable::{Interlock, TurntableMachine};

pub struct Aerosmith {
    rate: [f64; 2],
    acceleration: [f64; 2],
}

impl Default for Aerosmith {
    fn default() -> Self {
        Self { rate: [10.0; 2], acceleration: [10.0; 2] }
    }
}

impl Aerosmith {
    /// The reply's line; `None` for what it does not know.
    fn command(&mut self, request: &str, machine: &mut TurntableMachine) -> Option<String> {
        let axis = match request.get(..1)? {
            "1" => 0,
            "2" => 1,
            _ => return None,
        };
        let (command, value) = (request.get(1..4)?, request.get(4..)?);
        let number = value.parse::<f64>().ok();
        match command {
            "PPO" => return Some(format!("{:.4}", machine.angle_deg(axis))),
            "PVE" => return Some(format!("{:.4}", machine.rate_deg_s(axis))),
            "STA" => return Some(if machine.interlock(axis) == Interlock::Fault { "4" } else { "0" }.to_owned()),
            "VEL" => self.rate[axis] = number?,
            "ACL" => self.acceleration[axis] = number?,
            "STO" => machine.stop(axis),
            "MOV" => {
                // Always powered; a fault whose cause has gone ends with the next move.
                machine.reset(axis);
                machine.close(axis);
                machine.go_to(axis, number?, self.rate[axis], self.acceleration[axis]);
            }
            _ => return None,
        }
        Some(String::new())
    }
}

impl Speaker<TurntableMachine> for Aerosmith {
    fn take(&mut self, input: &mut Vec<u8>) -> Option<Vec<u8>> {
        take_line(input)
    }

    fn answer(&mut self, request: &[u8], machine: &mut TurntableMachine) -> Vec<u8> {
        let reply = self.command(String::from_utf8_lossy(request).trim(), machine);
        reply.map_or_else(Vec::new, |line| format!("{line}\r\n>\r\n").into_bytes())
    }

    fn refuse(&self, _: &[u8]) -> Vec<u8> {
        Vec::new()
    }
}
