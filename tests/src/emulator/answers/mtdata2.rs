//! Messages to the MTi. Source: MTi User Manual MT0605P.E, p. 51 to 54; identifiers as the driver
//! ethz-asl/ethzasl_xsens_driver has them.

use super::Reaction;
use crate::emulator::checksum::negative_sum;
use crate::emulator::mtdata2::xbus;

/// The device's state.
pub(in crate::emulator) struct Mtdata2 {
    serial: String,
    is_config: bool,
    is_new: bool,
    heard: Vec<u8>,
}

impl Mtdata2 {
    /// One that is new is in the configuration.
    pub(in crate::emulator) fn new(serial: &str, is_new: bool) -> Self {
        Self { serial: serial.to_owned(), is_config: is_new, is_new, heard: Vec::new() }
    }

    /// Whether it sends frames.
    pub(in crate::emulator) fn sends(&self) -> bool {
        !self.is_config
    }

    pub(in crate::emulator) fn reset(&mut self) {
        self.is_config = self.is_new;
        self.heard.clear();
    }

    pub(in crate::emulator) fn hear(&mut self, byte: u8) -> Reaction {
        self.heard.push(byte);
        if self.heard[0] != 0xFA {
            self.heard.clear();
        }
        let Some(data) = self.heard.get(3).map(|length| usize::from(*length)) else { return Reaction::default() };
        if self.heard.len() < data + 5 {
            return Reaction::default();
        }
        let message = std::mem::take(&mut self.heard);
        if negative_sum(&message[1..]) != 0 {
            return Reaction::default();
        }
        let data = &message[4..message.len() - 1];
        match (message[2], self.is_config) {
            // GoToConfig, GoToMeasurement.
            (0x30, _) => {
                self.is_config = true;
                Reaction::writes(xbus(0x31, &[]))
            }
            (0x10, true) => {
                self.is_config = false;
                Reaction::writes(xbus(0x11, &[]))
            }
            // ReqDID.
            (0x00, true) => {
                let id = u32::from_str_radix(&self.serial, 16).unwrap_or_default();
                Reaction::writes(xbus(0x01, &id.to_be_bytes()))
            }
            // SetOutputConfiguration, which is kept.
            (0xC0, true) => Reaction {
                write: xbus(0xC1, data),
                stored: Some("the output configuration".to_owned()),
                ..Reaction::default()
            },
            // Error: invalid message.
            (_, true) => Reaction::writes(xbus(0x42, &[0x04])),
            (_, false) => Reaction::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn say(device: &mut Mtdata2, bytes: &[u8]) -> Vec<u8> {
        bytes.iter().flat_map(|byte| device.hear(*byte).write).collect()
    }

    #[test]
    fn it_says_who_it_is_in_the_configuration() {
        let mut device = Mtdata2::new("03801ABC", false);
        let ask = [0xFA, 0xFF, 0x00, 0x00, 0x01];
        assert!(say(&mut device, &ask).is_empty() && device.sends());
        assert_eq!(say(&mut device, &[0, 0xFA, 0xFF, 0x30, 0x00, 0xD1]), [0xFA, 0xFF, 0x31, 0x00, 0xD0]);
        assert!(!device.sends());
        assert_eq!(say(&mut device, &ask)[..8], [0xFA, 0xFF, 0x01, 0x04, 0x03, 0x80, 0x1A, 0xBC]);
        assert!(say(&mut device, &[0xFA, 0xFF, 0x00, 0x00, 0x02]).is_empty(), "a wrong checksum");
        assert_eq!(say(&mut device, &xbus(0x77, &[]))[2], 0x42);
        assert_eq!(say(&mut device, &[0xFA, 0xFF, 0x10, 0x00, 0xF1]), [0xFA, 0xFF, 0x11, 0x00, 0xF0]);
        assert!(device.sends());
    }
}
