//! A Watlow F4T with one loop in degrees Celsius: Modbus RTU, address 1.

use crate::chamber::{ChamberMachine, Mode};
use crate::server::Speaker;

pub struct F4t;

/// Exceptions.
const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;
const BUSY: u8 = 6;

impl Speaker<ChamberMachine> for F4t {
    /// A frame that is broken, or another's, is passed over with all that is there: the pause that ends it is not simulated.
    fn take(&mut self, input: &mut Vec<u8>) -> Option<Vec<u8>> {
        let length = match input.get(1)? {
            16 => 9 + usize::from(*input.get(6)?),
            _ => 8,
        };
        if input.len() < length {
            return None;
        }
        let frame: Vec<u8> = input.drain(..length).collect();
        if crc(&frame) != 0 || frame[0] != 1 {
            input.clear();
            return None;
        }
        Some(frame)
    }

    fn answer(&mut self, request: &[u8], machine: &mut ChamberMachine) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let register = word(2);
        let reply = match request[1] {
            3 => {
                let words: Option<Vec<_>> = (0..word(4)).map(|index| read(register + index, machine)).collect();
                words.filter(|words| words.len() < 126).ok_or(ILLEGAL_ADDRESS).map(|words| {
                    let bytes = words.iter().flat_map(|word| word.to_be_bytes());
                    [1, 3, 2 * words.len() as u8].into_iter().chain(bytes).collect()
                })
            }
            6 => write(register, &[word(4)], machine).map(|()| request[..6].to_vec()),
            16 => {
                let words: Vec<_> = (7..request.len() - 2).step_by(2).map(word).collect();
                write(register, &words, machine).map(|()| request[..6].to_vec())
            }
            _ => Err(ILLEGAL_FUNCTION),
        };
        reply.map_or_else(|exception| frame(&[1, request[1] | 0x80, exception]), |reply| frame(&reply))
    }

    fn refuse(&self, request: &[u8]) -> Vec<u8> {
        frame(&[1, request[1] | 0x80, BUSY])
    }
}

/// A word of a float, the low word in the even register.
fn float(number: f64, register: u16, first: u16) -> u16 {
    let bits = (number as f32).to_bits();
    if register == first { bits as u16 } else { (bits >> 16) as u16 }
}

fn read(register: u16, machine: &ChamberMachine) -> Option<u16> {
    let mode = if machine.mode == Mode::Constant { 10 } else { 62 };
    Some(match register {
        2782..=2783 => float(machine.set_point_c, register, 2782),
        2820..=2821 => float(machine.air_c(), register, 2820),
        2730 | 2814 => mode,
        14080 => 15,
        1356 if machine.alarm => 76,
        1356 | 1456 | 1556 | 1656 => 61,
        _ => return None,
    })
}

fn write(register: u16, words: &[u16], machine: &mut ChamberMachine) -> Result<(), u8> {
    match (register, words) {
        (2782, &[low, high]) => {
            let number = f32::from_bits(u32::from(high) << 16 | u32::from(low));
            if machine.set(f64::from(number)) { Ok(()) } else { Err(ILLEGAL_VALUE) }
        }
        (2730, &[mode @ (10 | 62)]) => {
            // An alarm keeps it off.
            machine.switch(if mode == 10 && !machine.alarm { Mode::Constant } else { Mode::Off });
            Ok(())
        }
        (2730 | 2782, _) => Err(ILLEGAL_VALUE),
        _ => Err(ILLEGAL_ADDRESS),
    }
}

fn frame(bytes: &[u8]) -> Vec<u8> {
    let mut frame = bytes.to_vec();
    frame.extend(crc(bytes).to_le_bytes());
    frame
}

/// CRC-16 of Modbus; 0 over a frame with its CRC.
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xa001 } else { crc >> 1 })
    })
}
