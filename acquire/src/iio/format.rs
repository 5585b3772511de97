//! How a number of a scan is stored: `[be|le]:[s|u]bits/storage[Xrepeat][>>shift]`.

/// The storage of one scan element, from its `_type` attribute.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Format {
    big_endian: bool,
    signed: bool,
    /// Bits of the number.
    bits: u32,
    /// Bytes of one number: 1, 2, 4 or 8.
    storage: usize,
    /// Numbers in the element.
    pub(super) repeat: usize,
    /// Bits below the number.
    shift: u32,
}

impl Format {
    /// The format that a `_type` attribute names; what cannot be read is named in the error.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let unknown = || format!("its type {text:?} is none of [be|le]:[s|u]BITS/STORAGE[XREPEAT][>>SHIFT]");
        let (order, rest) = text.split_once(':').ok_or_else(unknown)?;
        let big_endian = match order {
            "be" => true,
            "le" => false,
            _ => return Err(unknown()),
        };
        let (rest, shift) = match rest.split_once(">>") {
            Some((rest, shift)) => (rest, shift.parse().map_err(|_| unknown())?),
            None => (rest, 0),
        };
        let (bits, storage) = rest.split_once('/').ok_or_else(unknown)?;
        let (storage, repeat) = match storage.split_once('X') {
            Some((storage, repeat)) => (storage, repeat.parse().map_err(|_| unknown())?),
            None => (storage, 1),
        };
        let (signed, bits) = match bits.split_at_checked(1) {
            Some(("s", bits)) => (true, bits),
            Some(("u", bits)) => (false, bits),
            Some(("f", _)) => return Err(format!("its type {text:?} is floating point: counts are needed")),
            _ => return Err(unknown()),
        };
        let bits: u32 = bits.parse().map_err(|_| unknown())?;
        let storage: u32 = storage.parse().map_err(|_| unknown())?;
        Self::checked(Self { big_endian, signed, bits, storage: 0, repeat, shift }, storage)
            .map_err(|fault| format!("its type {text:?} {fault}"))
    }

    fn checked(format: Self, storage: u32) -> Result<Self, &'static str> {
        if !matches!(storage, 8 | 16 | 32 | 64) {
            return Err("has a storage of other than 8, 16, 32 or 64 bits");
        }
        if format.bits == 0 || format.shift > 63 || format.bits.saturating_add(format.shift) > storage {
            return Err("has bits outside its storage");
        }
        if !format.signed && format.bits == 64 {
            return Err("has 64 bits without a sign: one too many");
        }
        let storage = (storage / 8) as usize;
        let bytes = storage.checked_mul(format.repeat).filter(|bytes| bytes.is_power_of_two() && *bytes <= 1024);
        if bytes.is_none() {
            return Err("repeats other than 1, 2, 4, 8, ... times: kernels align it differently");
        }
        Ok(Self { storage, ..format })
    }

    /// Bytes of the whole element. Its place is a multiple of them.
    pub(super) fn bytes(&self) -> usize {
        self.storage * self.repeat
    }

    /// The number that begins with the first of these bytes; bytes that are not there count as 0.
    pub(super) fn decode(&self, bytes: &[u8]) -> i64 {
        let bytes = bytes.iter().take(self.storage);
        let add = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        let stored = if self.big_endian { bytes.fold(0, add) } else { bytes.rev().fold(0, add) };
        let above = 64 - self.bits;
        let number = (stored >> self.shift) << above;
        if self.signed { number.cast_signed() >> above } else { (number >> above).cast_signed() }
    }
}
