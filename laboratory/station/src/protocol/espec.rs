//! An ESPEC P-300 without humidity.

use crate::chamber::{ChamberDevice, Mode, RANGE_C};
use crate::wire::Protocol;

pub(super) struct EspecProtocol;

impl Protocol<ChamberDevice> for EspecProtocol {
    fn answer(&mut self, request: &[u8], device: &mut ChamberDevice) -> Vec<u8> {
        let text = String::from_utf8_lossy(request);
        let reply = answer(text.trim(), device).unwrap_or_else(|reason| format!("NA:{reason}"));
        (reply + "\r\n").into_bytes()
    }

    fn refuse(&self, _: &[u8]) -> Vec<u8> {
        b"NA:CONT NOT READY-1\r\n".to_vec()
    }
}

fn answer(request: &str, device: &mut ChamberDevice) -> Result<String, &'static str> {
    let mode = match device.mode {
        Mode::Off => "OFF",
        Mode::Standby => "STANDBY",
        Mode::Constant => "CONSTANT",
    };
    let [low, high] = RANGE_C;
    let compact: String = request.chars().filter(|c| *c != ' ').collect();
    Ok(match compact.as_str() {
        "TYPE?" => format!("T,P300,{high:.1}"),
        "MON?" => format!("{:.1},,{mode},{}", device.air_c(), u8::from(device.alarm)),
        "TEMP?" => format!("{:.1},{:.1},{high:.1},{low:.1}", device.air_c(), device.set_point_c),
        "MODE?" => mode.to_owned(),
        "ALARM?" => if device.alarm { "1,7" } else { "0" }.to_owned(),
        command => {
            let (name, value) = command.split_once(',').ok_or("CMD ERR")?;
            let mode = match (name, value) {
                ("MODE", "CONSTANT") | ("POWER", "ON") => Some(Mode::Constant),
                ("MODE", "STANDBY") => Some(Mode::Standby),
                ("MODE", "OFF") | ("POWER", "OFF") => Some(Mode::Off),
                ("TEMP", _) => None,
                ("MODE" | "POWER", _) => return Err("PARA ERR"),
                _ => return Err("CMD ERR"),
            };
            match mode {
                Some(mode) => {
                    device.switch(if device.alarm && mode == Mode::Constant { Mode::Standby } else { mode });
                }
                None => {
                    let value = value.strip_prefix('S').and_then(|value| value.parse().ok()).ok_or("PARA ERR")?;
                    if !device.set(value) {
                        return Err("DATA OUT OF RANGE");
                    }
                }
            }
            format!("OK:{request}")
        }
    })
}
