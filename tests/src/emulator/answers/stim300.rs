//! Commands of the STIM300. Source: TS1524 rev. 31, sections 5.5.1 to 5.5.3, 7.5.1, 8 and 9 (p. 29-33, 47, 58-90).

use super::Reaction;
use crate::emulator::stim300::special;

/// What is set, in the words of its commands: datagram, output units of gyroscopes and accelerometers.
#[derive(Clone, Debug, Eq, PartialEq)]
struct Settings {
    datagram: String,
    gyroscopes: String,
    accelerometers: String,
}

/// The device's modes, and what it was set to.
pub(in crate::emulator) struct Stim300 {
    serial: String,
    wanted: Settings,
    flash: Settings,
    now: Settings,
    is_service: bool,
    /// What was heard since the last carriage return.
    line: String,
}

impl Stim300 {
    /// `unit`: what sends the frames of the profile, 1 for increments, 2 for means.
    pub(in crate::emulator) fn new(serial: &str, unit: &str, is_new: bool) -> Self {
        let of = |datagram: &str, unit: &str| Settings {
            datagram: datagram.to_owned(),
            gyroscopes: unit.to_owned(),
            accelerometers: unit.to_owned(),
        };
        let wanted = of("5,0", unit);
        let flash = if is_new { of("7,0", "0") } else { wanted.clone() };
        Self { serial: serial.to_owned(), now: flash.clone(), flash, wanted, is_service: false, line: String::new() }
    }

    /// Whether it sends the frames of the profile.
    pub(in crate::emulator) fn sends(&self) -> bool {
        !self.is_service && self.now == self.wanted
    }

    pub(in crate::emulator) fn reset(&mut self) {
        (self.now, self.is_service) = (self.flash.clone(), false);
        self.line.clear();
    }

    pub(in crate::emulator) fn hear(&mut self, byte: u8) -> Reaction {
        // Service mode echoes.
        let echo = if self.is_service { vec![byte] } else { Vec::new() };
        if byte != b'\r' {
            self.line.push(char::from(byte));
            return Reaction::writes(echo);
        }
        let line = std::mem::take(&mut self.line);
        let reaction = if self.is_service { self.service(&line) } else { self.normal(&line) };
        Reaction { write: [echo, reaction.write].concat(), ..reaction }
    }

    /// Not a word about what it does not know (p. 58).
    fn normal(&mut self, line: &str) -> Reaction {
        match line {
            "N" => Reaction { write: part_number(), replaced: 1, ..Reaction::default() },
            "I" => Reaction { write: serial_number(&self.serial), replaced: 1, ..Reaction::default() },
            "C" => Reaction { write: configuration(), replaced: 1, ..Reaction::default() },
            "SERVICEMODE" => {
                self.is_service = true;
                let serial = &self.serial;
                Reaction::writes(format!("SERIAL NUMBER = {serial}\rPRODUCT = STIM300\r\r>").into_bytes())
            }
            _ => Reaction::default(),
        }
    }

    fn service(&mut self, line: &str) -> Reaction {
        let (command, parameter) = line.split_once(' ').unwrap_or((line, ""));
        let (mut rate, mut stored) = (None, None);
        let answer = match (command, parameter) {
            ("d", "5,0") => {
                self.now.datagram = parameter.to_owned();
                "DATAGRAM = RATE, ACCELERATION, TEMPERATURE\rDATAGRAM TERMINATION = NONE\r".to_owned()
            }
            ("m", "0" | "1" | "2" | "3" | "4") => {
                let hertz = 125 << parameter.parse::<u32>().unwrap_or_default();
                rate = Some(f64::from(hertz));
                format!("SAMPLE RATE [samples/s] = {hertz}\r")
            }
            ("u", "g,1" | "g,2") => {
                self.now.gyroscopes = parameter[2..].to_owned();
                "GYRO OUTPUT UNIT = SET\r".to_owned()
            }
            ("u", "a,1" | "a,2") => {
                self.now.accelerometers = parameter[2..].to_owned();
                "ACCELEROMETER OUTPUT UNIT = SET\r".to_owned()
            }
            ("s", "") => {
                self.flash = self.now.clone();
                stored = Some("the configuration".to_owned());
                "CONFIGURATION SAVED\r".to_owned()
            }
            ("x", "N") => {
                self.is_service = false;
                return Reaction::writes(b"SYSTEM RETURNING TO NORMAL MODE.\r".to_vec());
            }
            ("", "") => String::new(),
            ("d" | "m" | "u" | "x", _) => "E003 INVALID PARAMETER\r".to_owned(),
            _ => "E001 UNKNOWN COMMAND\r".to_owned(),
        };
        Reaction { write: format!("{answer}\r>").into_bytes(), rate, stored, ..Reaction::default() }
    }
}

/// What it sends in Init Mode: part number, serial number, configuration.
pub(in crate::emulator) fn greeting(serial: &str) -> Vec<u8> {
    [part_number(), serial_number(serial), configuration()].concat()
}

/// 84167-440000-0321, revision K.
fn part_number() -> Vec<u8> {
    let mut bytes = vec![0xB1, 0x08, 0x41, 0x67, 0x2D, 0x44, 0x00, 0x00, 0x2D, 0x32, 0x10, 0x00];
    bytes.resize(15, 0);
    bytes.push(b'K');
    special(bytes)
}

/// N and 14 decimal digits, packed.
fn serial_number(serial: &str) -> Vec<u8> {
    let digits: Vec<u8> = serial.bytes().filter(u8::is_ascii_digit).map(|digit| digit - b'0').collect();
    let digit = |at: usize| digits.get(at).copied().unwrap_or_default();
    let mut bytes = vec![0xB5, b'N'];
    bytes.extend((0..7).map(|pair| digit(2 * pair) << 4 | digit(2 * pair + 1)));
    bytes.resize(16, 0);
    special(bytes)
}

fn configuration() -> Vec<u8> {
    let mut bytes = vec![0xBC, b'K', 4, 0x6A, 0x20];
    bytes.resize(22, 0x10);
    special(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn say(device: &mut Stim300, text: &str) -> (String, Vec<Reaction>) {
        let all: Vec<_> = text.bytes().map(|byte| device.hear(byte)).collect();
        let written = all.iter().flat_map(|reaction| reaction.write.clone()).map(char::from).collect();
        (written, all)
    }

    #[test]
    fn the_serial_number_is_asked_for() {
        let mut device = Stim300::new("N25582405002002", "1", false);
        let reaction = say(&mut device, "x\rI\r").1.pop().unwrap();
        assert_eq!(reaction.write[..9], [0xB5, 0x4E, 0x25, 0x58, 0x24, 0x05, 0x00, 0x20, 0x02]);
        assert_eq!((reaction.write.len(), reaction.replaced, device.sends()), (20, 1, true));
        assert_eq!(greeting("N25582405002002").len(), 20 + 20 + 26);
    }

    #[test]
    fn service_mode_sets_it_up_until_it_is_reset() {
        let mut device = Stim300::new("N1", "1", true);
        assert!(!device.sends());
        assert!(say(&mut device, "SERVICEMODE\r").0.ends_with("\r>"));
        let (written, all) = say(&mut device, "d 5,0\rm 2\ru g,1\ru a,1\rq\rm 9\r");
        assert!(written.contains("m 2\rSAMPLE RATE [samples/s] = 500\r\r>"), "{written}");
        assert!(written.contains("E001 UNKNOWN") && written.contains("E003 INVALID"), "{written}");
        assert_eq!(all.iter().find_map(|reaction| reaction.rate), Some(500.0));
        assert!(!device.sends());
        assert!(say(&mut device, "x N\r").0.ends_with("SYSTEM RETURNING TO NORMAL MODE.\r"));
        assert!(device.sends());
        device.reset();
        assert!(!device.sends());
        say(&mut device, "SERVICEMODE\r");
        assert!(say(&mut device, "s\r").1.iter().any(|reaction| reaction.stored.is_some()));
    }
}
