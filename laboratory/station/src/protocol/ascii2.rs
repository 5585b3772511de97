//! A Voetsch chamber with temperature and humidity: ASCII-2, address 1.

use crate::chamber::{ChamberDevice, Mode};
use crate::wire::Protocol;

pub(super) struct Ascii2Protocol;

impl Protocol<ChamberDevice> for Ascii2Protocol {
    fn answer(&mut self, request: &[u8], device: &mut ChamberDevice) -> Vec<u8> {
        // A request with another address or without meaning has no reply.
        let text = String::from_utf8_lossy(request);
        let Some(command) = text.strip_prefix("$01") else { return Vec::new() };
        if command == "I" {
            let bits = format!("0{}{}0000000000000", u8::from(device.mode == Mode::Constant), u8::from(device.alarm));
            let (nominal, actual) = (device.set_point_c, device.air_c());
            return format!("{nominal:06.1} {actual:06.1} 0050.0 0047.3 {bits}\r").into_bytes();
        }
        let Some(fields) = command.strip_prefix("E ") else { return Vec::new() };
        let fields: Vec<_> = fields.split_ascii_whitespace().collect();
        let (Some(Ok(celsius)), Some(bits)) = (fields.first().map(|field| field.parse()), fields.last()) else {
            return Vec::new();
        };
        if device.set(celsius) {
            let start = bits.len() >= 8 && bits.as_bytes()[1] == b'1' && !device.alarm;
            device.switch(if start { Mode::Constant } else { Mode::Standby });
        }
        b"0\r".to_vec()
    }

    fn refuse(&self, _: &[u8]) -> Vec<u8> {
        Vec::new()
    }
}
