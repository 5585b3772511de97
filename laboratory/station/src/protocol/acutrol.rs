//! An ACUTROL 3000 with two axes. Over TCP a reply has a header of eight bytes and no line end, as a public driver
//! expects it.

use crate::turntable::{Interlock, TurntableDevice};
use crate::wire::Protocol;

pub(super) struct AcutrolProtocol {
    tcp: bool,
    axes: [AxisState; 2],
}

/// Settings of an axis.
#[derive(Clone, Copy)]
struct AxisState {
    rate: f64,
    acceleration: f64,
    demand_deg: f64,
    in_position_mode: bool,
}

impl AcutrolProtocol {
    pub(super) fn new(tcp: bool) -> Self {
        Self { tcp, axes: [AxisState { rate: 10.0, acceleration: 10.0, demand_deg: 0.0, in_position_mode: false }; 2] }
    }

    fn frame(&self, reply: &str) -> Vec<u8> {
        if self.tcp {
            // One byte of the header has the value of a line feed.
            let mut frame = vec![0, 0, 0, reply.len() as u8, 0, b'\n', 0, 0];
            frame.extend(reply.as_bytes());
            return frame;
        }
        format!("{reply}\r\n").into_bytes()
    }

    /// Executes a request and returns the reply; `None` if it is refused.
    fn command(&mut self, request: &str, device: &mut TurntableDevice) -> Option<String> {
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
            ":read:position?" | ":read:pos?" => return Some(format!("{:.5}", device.angle_deg(axis(0)?))),
            ":read:rate?" => return Some(format!("{:.5}", device.rate_deg_s(axis(0)?))),
            ":interlock?" => return Some(format!("{:?}", device.interlock(axis(0)?))),
            ":interlock:reset" => device.reset(axis(0)?),
            // A fault shows in the interlock's state, not in the reply.
            ":interlock:close" => drop(device.close(axis(0)?)),
            ":interlock:open" => device.open(axis(0)?),
            ":limit:rate" | ":limit:acc" if arguments[0] != "pos" => return None,
            ":limit:rate" => self.axes[axis(1)?].rate = value(2)?,
            ":limit:acc" => self.axes[axis(1)?].acceleration = value(2)?,
            ":demand:position" | ":demand:pos" => {
                let index = axis(0)?;
                self.axes[index].demand_deg = value(1)?;
                if self.axes[index].in_position_mode {
                    self.follow_demand(index, device)?;
                }
            }
            ":mode:position" => self.follow_demand(axis(0)?, device)?,
            // Only rate 0 is simulated.
            ":demand:rate" => drop(value(1).filter(|rate| *rate == 0.0)?),
            ":mode:rate" | ":mode:off" => {
                self.axes[axis(0)?].in_position_mode = false;
                device.stop(axis(0)?);
            }
            _ => return None,
        }
        Some("OK".to_owned())
    }

    /// Enters position mode and moves the axis to its demand; `None` if that is refused.
    fn follow_demand(&mut self, index: usize, device: &mut TurntableDevice) -> Option<()> {
        let axis = &mut self.axes[index];
        axis.in_position_mode = device.interlock(index) == Interlock::Closed
            && device.go_to(index, axis.demand_deg, axis.rate, axis.acceleration);
        axis.in_position_mode.then_some(())
    }
}

impl Protocol<TurntableDevice> for AcutrolProtocol {
    fn answer(&mut self, request: &[u8], device: &mut TurntableDevice) -> Vec<u8> {
        for index in [0, 1] {
            self.axes[index].in_position_mode &= device.interlock(index) == Interlock::Closed;
        }
        let reply = self.command(String::from_utf8_lossy(request).trim(), device);
        self.frame(&reply.unwrap_or_else(|| "ERROR".to_owned()))
    }

    fn refuse(&self, _: &[u8]) -> Vec<u8> {
        self.frame("ERROR")
    }
}
