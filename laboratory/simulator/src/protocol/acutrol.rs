//! An ACUTROL 3000 with two axes. Over TCP eight bytes stand in front of each reply and nothing behind it, as a public driver has it.

use super::take_line;
use crate::server::Speaker;
use crate::turntable::{Interlock, TurntableMachine};

pub struct Acutrol {
    tcp: bool,
    axes: [Axis; 2],
}

/// What is set for an axis.
#[derive(Clone, Copy)]
struct Axis {
    rate: f64,
    acceleration: f64,
    demand_deg: f64,
    /// Whether it is in position mode.
    follows: bool,
}

impl Acutrol {
    pub fn new(tcp: bool) -> Self {
        Self { tcp, axes: [Axis { rate: 10.0, acceleration: 10.0, demand_deg: 0.0, follows: false }; 2] }
    }

    fn frame(&self, reply: &str) -> Vec<u8> {
        if self.tcp {
            // Among the bytes in front is one that looks like a line feed.
            let mut frame = vec![0, 0, 0, reply.len() as u8, 0, b'\n', 0, 0];
            frame.extend(reply.as_bytes());
            return frame;
        }
        format!("{reply}\r\n").into_bytes()
    }

    fn command(&mut self, request: &str, machine: &mut TurntableMachine) -> Option<String> {
        let request = request.to_ascii_lowercase();
        let (name, arguments) = request.split_once(' ').unwrap_or((&request, ""));
        let arguments: Vec<_> = arguments.split(',').map(str::trim).collect();
        let axis = |at: usize| match arguments.get(at).copied() {
            Some("1") => Some(0),
            Some("2") => Some(1),
            _ => None,
        };
        let value = |at: usize| arguments.get(at).and_then(|value| value.parse::<f64>().ok());
        match name {
            "*idn?" => return Some("ACUTRONIC,ACUTROL3000,SIMULATED,0".to_owned()),
            ":utility:lockout" => {}
            ":read:position?" | ":read:pos?" => return Some(format!("{:.5}", machine.angle_deg(axis(0)?))),
            ":read:rate?" => return Some(format!("{:.5}", machine.rate_deg_s(axis(0)?))),
            ":interlock?" => return Some(format!("{:?}", machine.interlock(axis(0)?))),
            ":interlock:reset" => machine.reset(axis(0)?),
            // A fault shows in the interlock's state, not in the reply.
            ":interlock:close" => drop(machine.close(axis(0)?)),
            ":interlock:open" => machine.open(axis(0)?),
            ":limit:rate" | ":limit:acc" if arguments[0] != "pos" => return None,
            ":limit:rate" => self.axes[axis(1)?].rate = value(2)?,
            ":limit:acc" => self.axes[axis(1)?].acceleration = value(2)?,
            ":demand:position" | ":demand:pos" => {
                let index = axis(0)?;
                self.axes[index].demand_deg = value(1)?;
                if self.axes[index].follows {
                    self.follow(index, machine)?;
                }
            }
            ":mode:position" => self.follow(axis(0)?, machine)?,
            // The only rate that is simulated.
            ":demand:rate" => drop(value(1).filter(|rate| *rate == 0.0)?),
            ":mode:rate" | ":mode:off" => {
                self.axes[axis(0)?].follows = false;
                machine.stop(axis(0)?);
            }
            _ => return None,
        }
        Some("OK".to_owned())
    }

    fn follow(&mut self, index: usize, machine: &mut TurntableMachine) -> Option<()> {
        let axis = &mut self.axes[index];
        axis.follows = machine.interlock(index) == Interlock::Closed
            && machine.go_to(index, axis.demand_deg, axis.rate, axis.acceleration);
        axis.follows.then_some(())
    }
}

impl Speaker<TurntableMachine> for Acutrol {
    fn take(&mut self, input: &mut Vec<u8>) -> Option<Vec<u8>> {
        take_line(input)
    }

    fn answer(&mut self, request: &[u8], machine: &mut TurntableMachine) -> Vec<u8> {
        for index in [0, 1] {
            self.axes[index].follows &= machine.interlock(index) == Interlock::Closed;
        }
        let reply = self.command(String::from_utf8_lossy(request).trim(), machine);
        self.frame(&reply.unwrap_or_else(|| "ERROR".to_owned()))
    }

    fn refuse(&self, _: &[u8]) -> Vec<u8> {
        self.frame("ERROR")
    }
}
