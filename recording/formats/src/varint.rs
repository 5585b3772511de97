//! Varints: unsigned integers in groups of 7 bits, the lowest group first, as in protobuf and Thrift.

/// Appends a number.
pub(crate) fn write(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Takes a number from the front of `bytes`; `None` if it is incomplete or has more than 64 bits.
pub(crate) fn read(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        // Only one bit is left for the tenth byte.
        if shift == 63 && byte > 1 {
            return None;
        }
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_number_is_read_again_and_nothing_behind_it() {
        let powers = (0..64).map(|bit| 1 << bit);
        for value in powers.flat_map(|power: u64| [power - 1, power, power + 1]).chain([u64::MAX]) {
            let mut written = Vec::new();
            write(&mut written, value);
            assert_eq!(written.len(), (64 - value.leading_zeros()).div_ceil(7).max(1) as usize, "{value}");
            written.extend([0xff, 1]);
            let mut rest = &written[..];
            assert_eq!((read(&mut rest), rest), (Some(value), &[0xff, 1][..]));
        }
    }

    #[test]
    fn an_incomplete_number_is_refused() {
        let mut whole = Vec::new();
        write(&mut whole, u64::MAX);
        assert_eq!(whole.len(), 10);
        for length in 0..10 {
            assert_eq!(read(&mut &whole[..length]), None, "{length} bytes");
        }
    }

    #[test]
    fn a_number_of_more_than_64_bits_or_10_bytes_is_refused() {
        let ended_by = |bytes: &[u8]| read(&mut &[&[0xff; 9], bytes].concat()[..]);
        assert_eq!(ended_by(&[1]), Some(u64::MAX));
        assert_eq!(ended_by(&[0]), Some(u64::MAX >> 1));
        // The tenth byte has more than the 64th bit.
        for tenth in [2, 3, 0x40, 0x7f] {
            assert_eq!(ended_by(&[tenth]), None, "{tenth:#x}");
        }
        // The tenth byte announces an eleventh. A number of 64 bits needs no more than ten bytes.
        for tenth in [0x80, 0x81, 0xff] {
            assert_eq!(ended_by(&[tenth, 0]), None, "{tenth:#x}");
            assert_eq!(read(&mut &[&[0x80; 9][..], &[tenth, 0]].concat()[..]), None, "{tenth:#x}");
        }
    }

    #[test]
    fn groups_of_zero_bits_at_the_end_do_not_change_a_number() {
        assert_eq!(read(&mut &[0x85, 0x80, 0x80, 0][..]), Some(5));
        assert_eq!(read(&mut &[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 1][..]), Some(1 << 63));
    }
}
