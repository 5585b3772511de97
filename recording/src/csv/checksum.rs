//! The checksum that NMEA 0183 has at the end of a line: `$VNYMR,+170.786,-005.153*68`.

/// A checksum at the end of a line: `*` and two hexadecimal digits.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Checksum {
    /// Place of the `*` in the line.
    pub at: usize,
    /// What the line says.
    pub stated: u8,
    /// XOR of the bytes between the `$` or `!` at the beginning, if there is one, and the `*`.
    pub computed: u8,
}

impl Checksum {
    /// That of a line, which may have its line end; `None` if it has no checksum.
    #[must_use]
    pub fn of(line: &[u8]) -> Option<Self> {
        let line = line.trim_ascii_end();
        let at = line.len().checked_sub(3)?;
        let (content, [b'*', digits @ ..]) = line.split_at(at) else { return None };
        let is_hexadecimal = digits.iter().all(u8::is_ascii_hexdigit);
        let stated = u8::from_str_radix(str::from_utf8(digits).ok()?, 16).ok().filter(|_| is_hexadecimal)?;
        let content = content.trim_ascii_start();
        let content = content.strip_prefix(b"$").or_else(|| content.strip_prefix(b"!")).unwrap_or(content);
        let computed = content.iter().fold(0, |sum, byte| sum ^ byte);
        Some(Self { at, stated, computed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_star_and_two_hexadecimal_digits_at_the_end_are_a_checksum() {
        // The example of the standard's descriptions.
        let line = b"$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n";
        assert_eq!(Checksum::of(line), Some(Checksum { at: 38, stated: 0x27, computed: 0x27 }));
        assert_eq!(Checksum::of(b" !AB*0f "), Some(Checksum { at: 4, stated: 0x0f, computed: 3 }));
        for none in [&b"1,2*3"[..], b"*+1", b"1*2g", b"", b"*1", b"1,2\n"] {
            assert_eq!(Checksum::of(none), None);
        }
    }
}
