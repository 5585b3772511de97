//! Commands of the VN-100. Source: UM001 v2.22, user interface, and registers 3, 6 and 75.

use super::Reaction;

/// What the outputs are set to.
pub(in crate::emulator) struct Vn100 {
    serial: String,
    /// Registers 6 and 75.
    ascii: String,
    binary: String,
    flash: (String, String),
    line: String,
}

/// Register 75 that sends the frames of the profile, but for the divisor of 800 Hz, which is the second number.
const BINARY: [&str; 5] = ["1", "", "05", "0001", "00D0"];

impl Vn100 {
    pub(in crate::emulator) fn new(serial: &str, is_new: bool) -> Self {
        let (ascii, binary) = if is_new { ("14", "0") } else { ("0", "1,2,05,0001,00D0") };
        let (ascii, binary) = (ascii.to_owned(), binary.to_owned());
        let flash = (ascii.clone(), binary.clone());
        Self { serial: serial.to_owned(), ascii, binary, flash, line: String::new() }
    }

    /// Whether it sends the frames of the profile.
    pub(in crate::emulator) fn sends(&self) -> bool {
        divisor(&self.binary).is_some()
    }

    /// What it sends with each sample in addition to them.
    pub(in crate::emulator) fn beside(&self) -> Vec<u8> {
        if self.ascii == "0" { Vec::new() } else { sealed("VNYMR,+010.071,+000.278,-002.026,-01.034") }
    }

    pub(in crate::emulator) fn reset(&mut self) {
        (self.ascii, self.binary) = self.flash.clone();
        self.line.clear();
    }

    pub(in crate::emulator) fn hear(&mut self, byte: u8) -> Reaction {
        match byte {
            b'$' => self.line.clear(),
            b'\n' => return self.command(),
            b'\r' => {}
            _ => self.line.push(char::from(byte)),
        }
        Reaction::default()
    }

    fn command(&mut self) -> Reaction {
        let line = std::mem::take(&mut self.line);
        let Some((text, sum)) = line.rsplit_once('*') else { return Reaction::writes(sealed("VNERR,03")) };
        // XX stands for any checksum.
        if sum != "XX" && !sealed(text).ends_with(format!("*{sum}\r\n").as_bytes()) {
            return Reaction::writes(sealed("VNERR,03"));
        }
        let (command, values) = text.split_once(',').unwrap_or((text, ""));
        let (register, values) = values.split_once(',').unwrap_or((values, ""));
        let (mut rate, mut stored) = (None, None);
        let answer = match (command, register.trim_start_matches('0')) {
            ("VNRRG", "3") => format!("VNRRG,03,{}", self.serial),
            ("VNRRG", "6") => format!("VNRRG,06,{}", self.ascii),
            ("VNWRG", "6") => {
                self.ascii = values.to_owned();
                text.to_owned()
            }
            ("VNWRG", "75") => {
                self.binary = values.to_owned();
                rate = divisor(values).map(|divisor| 800.0 / divisor);
                text.to_owned()
            }
            ("VNWNV", _) => {
                self.flash = (self.ascii.clone(), self.binary.clone());
                stored = Some("the settings".to_owned());
                text.to_owned()
            }
            ("VNRRG" | "VNWRG", _) => "VNERR,08".to_owned(),
            _ => "VNERR,04".to_owned(),
        };
        Reaction { write: sealed(&answer), rate, stored, ..Reaction::default() }
    }
}

/// The divisor of an output as the profile describes it.
fn divisor(binary: &str) -> Option<f64> {
    let values: Vec<_> = binary.split(',').collect();
    let same = |at: usize| at == 1 || values.get(at) == Some(&BINARY[at]);
    let is_described = values.len() == BINARY.len() && (0..BINARY.len()).all(same);
    values.get(1)?.parse().ok().filter(|divisor| is_described && *divisor > 0.0)
}

/// A line with its checksum.
fn sealed(text: &str) -> Vec<u8> {
    let sum = text.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("${text}*{sum:02X}\r\n").into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn say(device: &mut Vn100, text: &str) -> Reaction {
        text.bytes().map(|byte| device.hear(byte)).last().unwrap()
    }

    #[test]
    fn registers_are_read_and_written() {
        let mut device = Vn100::new("0100061897", true);
        assert!(!device.sends() && !device.beside().is_empty());
        let written = |device: &mut Vn100, text: &str| String::from_utf8(say(device, text).write).unwrap();
        // Question and answer of public programs.
        assert_eq!(written(&mut device, "$VNRRG,03*70\r\n"), "$VNRRG,03,0100061897*5C\r\n");
        assert!(written(&mut device, "$VNRRG,03*71\r\n").starts_with("$VNERR,03"));
        assert!(written(&mut device, "$VNRRG,99*XX\r\n").starts_with("$VNERR,08"));
        assert!(written(&mut device, "$VNABC*XX\r\n").starts_with("$VNERR,04"));
        assert!(written(&mut device, "$VNWRG,06,0*XX\r\n").starts_with("$VNWRG,06,0*"));
        let reaction = say(&mut device, "$VNWRG,75,1,4,05,0001,00D0*XX\r\n");
        assert_eq!((reaction.rate, device.sends(), device.beside().len()), (Some(200.0), true, 0));
        device.reset();
        assert!(!device.sends());
        assert!(say(&mut device, "$VNWNV*XX\r\n").stored.is_some());
    }
}
