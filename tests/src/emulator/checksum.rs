//! Checksums, bit by bit.

/// CRC-32/MPEG-2: polynomial 04C11DB7, start FFFFFFFF, nothing reflected or inverted.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    let mut register = u32::MAX;
    for byte in bytes {
        for bit in (0..8).rev() {
            let feedback = (register >> 31) ^ u32::from((byte >> bit) & 1);
            register = (register << 1) ^ (feedback * 0x04C1_1DB7);
        }
    }
    register
}

/// CRC-16/XMODEM: polynomial 1021, start 0, nothing reflected or inverted.
pub(super) fn crc16(bytes: &[u8]) -> u16 {
    let mut register = 0;
    for byte in bytes {
        for bit in (0..8).rev() {
            let feedback = (register >> 15) ^ u16::from((byte >> bit) & 1);
            register = (register << 1) ^ (feedback * 0x1021);
        }
    }
    register
}

/// The byte that makes the sum of all bytes 0.
pub(super) fn negative_sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum: u8, byte| sum.wrapping_sub(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_values() {
        assert_eq!(crc32(b"123456789"), 0x0376_E6E7);
        assert_eq!(crc16(b"123456789"), 0x31C3);
        // Of a public test, tstellanova/vectornav_vn300, test/test_decoder.c.
        assert_eq!((crc16(b""), crc16(b"ROCK"), crc16(b"12345678")), (0, 0x08FF, 0x9015));
        // Go to the configuration, Xsens.
        assert_eq!(negative_sum(&[0xFF, 0x30, 0x00]), 0xD1);
    }
}
