//! A Watlow F4T with one loop in degrees Celsius: Modbus RTU, address 1.

use crate::chamber::{ChamberDevice, Mode};
use crate::wire::Protocol;

pub(super) struct F4tProtocol;

/// Modbus exception codes.
const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;
const BUSY: u8 = 6;

impl Protocol<ChamberDevice> for F4tProtocol {
    /// A damaged frame, or one with another address, is discarded with the rest of the input. A real controller would
    /// look for the pause between frames instead.
    fn take_request(&mut self, input: &mut Vec<u8>) -> Option<Vec<u8>> {
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

    fn answer(&mut self, request: &[u8], device: &mut ChamberDevice) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let register = word(2);
        let reply = match request[1] {
            3 => {
                let words: Option<Vec<_>> = (0..word(4)).map(|index| read(register + index, device)).collect();
                words.filter(|words| words.len() < 126).ok_or(ILLEGAL_ADDRESS).map(|words| {
                    let bytes = words.iter().flat_map(|word| word.to_be_bytes());
                    [1, 3, 2 * words.len() as u8].into_iter().chain(bytes).collect()
                })
            }
            6 => write(register, &[word(4)], device).map(|()| request[..6].to_vec()),
            16 => {
                let words: Vec<_> = (7..request.len() - 2).step_by(2).map(word).collect();
                write(register, &words, device).map(|()| request[..6].to_vec())
            }
            _ => Err(ILLEGAL_FUNCTION),
        };
        reply.map_or_else(|exception| frame(&[1, request[1] | 0x80, exception]), |reply| frame(&reply))
    }

    fn refuse(&self, request: &[u8]) -> Vec<u8> {
        frame(&[1, request[1] | 0x80, BUSY])
    }
}

/// The word of a float for `register`; the register `first` has the low word.
fn float(number: f64, register: u16, first: u16) -> u16 {
    let bits = (number as f32).to_bits();
    if register == first { bits as u16 } else { (bits >> 16) as u16 }
}

fn read(register: u16, device: &ChamberDevice) -> Option<u16> {
    let mode = match device.mode {
        Mode::Constant if device.is_manual => 54,
        Mode::Constant => 10,
        Mode::Off | Mode::Standby => 62,
    };
    Some(match register {
        2782..=2783 => float(device.set_point_c, register, 2782),
        2820..=2821 => float(device.air_c(), register, 2820),
        2730 | 2814 => mode,
        14080 => 15,
        1356 if device.alarm => 76,
        1356 | 1456 | 1556 | 1656 => 61,
        _ => return None,
    })
}

fn write(register: u16, words: &[u16], device: &mut ChamberDevice) -> Result<(), u8> {
    match (register, words) {
        (2782, &[low, high]) => {
            let number = f32::from_bits(u32::from(high) << 16 | u32::from(low));
            if device.set(f64::from(number)) { Ok(()) } else { Err(ILLEGAL_VALUE) }
        }
        (2730, &[mode @ (10 | 54 | 62)]) => {
            // With an alarm the chamber stays off.
            // In manual it goes on as it is, at a fixed power.
            device.is_manual = mode == 54;
            device.switch(if matches!(mode, 10 | 54) && !device.alarm { Mode::Constant } else { Mode::Off });
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

/// CRC-16 of Modbus. Over a frame with its CRC it is 0.
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xa001 } else { crc >> 1 })
    })
}
