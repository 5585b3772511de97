//! Numbers in a frame: their type, their place, and what they stand for.

/// Order of the bytes of a number.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum ByteOrder {
    /// The most significant byte first.
    Big,
    /// The least significant byte first.
    Little,
}

impl ByteOrder {
    /// Every order with its name in descriptions.
    pub(crate) const NAMES: [(Self, &'static str); 2] = [(Self::Big, "big"), (Self::Little, "little")];
}

/// Type of a number.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum NumberType {
    /// Whole number without sign, of so many bytes: 1, 2, 3, 4, 8.
    Unsigned(usize),
    /// Whole number in two's complement, of so many bytes: 1, 2, 3, 4, 8.
    Signed(usize),
    /// IEEE 754, single.
    Float,
    /// IEEE 754, double.
    Double,
    /// 6 bytes: 4 of the fraction and then 2 of the whole number in two's complement, each in the order of the bytes.
    Fixed1632,
}

impl NumberType {
    /// Every type with its name in descriptions.
    pub(crate) const NAMES: [(Self, &'static str); 13] = [
        (Self::Unsigned(1), "u8"),
        (Self::Signed(1), "i8"),
        (Self::Unsigned(2), "u16"),
        (Self::Signed(2), "i16"),
        (Self::Unsigned(3), "u24"),
        (Self::Signed(3), "i24"),
        (Self::Unsigned(4), "u32"),
        (Self::Signed(4), "i32"),
        (Self::Unsigned(8), "u64"),
        (Self::Signed(8), "i64"),
        (Self::Float, "f32"),
        (Self::Double, "f64"),
        (Self::Fixed1632, "fp16.32"),
    ];

    /// Its length in bytes.
    #[must_use]
    pub(crate) const fn bytes(self) -> usize {
        match self {
            Self::Unsigned(bytes) | Self::Signed(bytes) => bytes,
            Self::Float => 4,
            Self::Double => 8,
            Self::Fixed1632 => 6,
        }
    }

    /// Whether it is a whole number.
    #[must_use]
    pub(crate) const fn is_whole(self) -> bool {
        matches!(self, Self::Unsigned(_) | Self::Signed(_))
    }

    /// Whether it is a whole number without sign.
    #[must_use]
    pub(crate) const fn is_unsigned(self) -> bool {
        matches!(self, Self::Unsigned(_))
    }

    /// The number in `bytes`, of which the first [`bytes`](Self::bytes) count. Missing ones count as 0.
    #[must_use]
    pub(crate) fn read(self, bytes: &[u8], order: ByteOrder) -> Value {
        let part = |from: usize, to: usize| unsigned(bytes.get(from..to).unwrap_or_default(), order);
        match self {
            Self::Unsigned(count) => {
                let number = part(0, count);
                Value { number: number as f64, whole: Some(number) }
            }
            Self::Signed(count) => {
                let unused = 64 - 8 * count as u32;
                let number = (part(0, count) << unused).cast_signed() >> unused;
                Value { number: number as f64, whole: Some(number.cast_unsigned()) }
            }
            Self::Float => Value::real(f64::from(f32::from_bits(part(0, 4) as u32))),
            Self::Double => Value::real(f64::from_bits(part(0, 8))),
            Self::Fixed1632 => {
                let (fraction, whole) = (part(0, 4), part(4, 6) as u16);
                Value::real(f64::from(whole.cast_signed()) + fraction as f64 / 2f64.powi(32))
            }
        }
    }
}

fn unsigned(bytes: &[u8], order: ByteOrder) -> u64 {
    let add = |sum: u64, byte: &u8| (sum << 8) | u64::from(*byte);
    match order {
        ByteOrder::Big => bytes.iter().fold(0, add),
        ByteOrder::Little => bytes.iter().rev().fold(0, add),
    }
}

/// What a column has in one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    /// The number; NaN where the row does not have it.
    pub number: f64,
    /// The same as a whole number, in two's complement; `None` if it is not one, or was scaled.
    pub whole: Option<u64>,
}

impl Value {
    /// What a row has that lacks the column.
    pub const ABSENT: Self = Self { number: f64::NAN, whole: None };

    /// Whether it is the same value, bit for bit.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        self.whole == other.whole && self.number.to_bits() == other.number.to_bits()
    }

    /// A number that may have a fraction.
    #[must_use]
    pub const fn real(number: f64) -> Self {
        Self { number, whole: None }
    }
}

/// A place in a frame: from its first byte, or from its end if negative.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct Place(pub isize);

impl Place {
    /// The place as an offset, in a frame of so many bytes; `None` if it is outside.
    #[must_use]
    pub(crate) fn within(self, length: usize) -> Option<usize> {
        let offset = if self.0 < 0 { length.checked_add_signed(self.0)? } else { self.0.unsigned_abs() };
        (offset <= length).then_some(offset)
    }
}

/// A field: a number of a frame that is a column of the source.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Field {
    /// Its name as a column.
    pub(crate) name: String,
    /// Its place in the frame, or in the data of its item.
    pub(crate) at: Place,
    /// Its type.
    pub(crate) number: NumberType,
    /// Order of its bytes.
    pub(crate) order: ByteOrder,
    /// What one unit of the number stands for.
    pub(crate) scale: f64,
    /// What is added after that.
    pub(crate) offset: f64,
}

impl Field {
    /// Its value in a frame, or in the data of an item.
    #[must_use]
    pub(crate) fn value(&self, bytes: &[u8]) -> Value {
        let Some(bytes) = self.at.within(bytes.len()).and_then(|at| bytes.get(at..)) else { return Value::ABSENT };
        let value = self.number.read(bytes, self.order);
        if self.is_plain() { value } else { Value::real(value.number * self.scale + self.offset) }
    }

    /// Whether its value is the number itself.
    #[must_use]
    pub(crate) const fn is_plain(&self) -> bool {
        self.scale == 1.0 && self.offset == 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_reads_its_bytes_in_both_orders() {
        let number = |kind: &str, bytes: &[u8], order| {
            let (kind, _) = NumberType::NAMES.into_iter().find(|(_, name)| *name == kind).unwrap();
            assert_eq!(kind.bytes(), bytes.len());
            kind.read(bytes, order).number
        };
        let cases: [(&str, &[u8], f64); 14] = [
            ("u8", &[0xfe], 254.0),
            ("i8", &[0xfe], -2.0),
            ("u16", &[0xff, 0x01], 65281.0),
            ("i16", &[0xff, 0x01], -255.0),
            ("u24", &[0x80, 0, 1], 8_388_609.0),
            ("i24", &[0x80, 0, 1], -8_388_607.0),
            ("i24", &[0x7f, 0xff, 0xff], 8_388_607.0),
            ("u32", &[0xff, 0xff, 0xff, 0xff], 4_294_967_295.0),
            ("i32", &[0x80, 0, 0, 0], -2_147_483_648.0),
            ("u64", &[0, 0, 1, 0, 0, 0, 0, 0], 1_099_511_627_776.0),
            ("i64", &[0xff; 8], -1.0),
            ("f32", &[0xc0, 0x49, 0x0f, 0xdb], -f64::from(std::f32::consts::PI)),
            ("f64", &[0x40, 0x09, 0x21, 0xfb, 0x54, 0x44, 0x2d, 0x18], std::f64::consts::PI),
            ("fp16.32", &[0x80, 0, 0, 0, 0xff, 0xff], -0.5),
        ];
        for (kind, bytes, expected) in cases {
            assert_eq!(number(kind, bytes, ByteOrder::Big), expected, "{kind}");
            let reversed: Vec<_> = match kind {
                "fp16.32" => bytes[..4].iter().rev().chain(bytes[4..].iter().rev()).copied().collect(),
                _ => bytes.iter().rev().copied().collect(),
            };
            assert_eq!(number(kind, &reversed, ByteOrder::Little), expected, "{kind}");
        }
        assert_eq!(NumberType::Signed(8).read(&[0xff; 8], ByteOrder::Big).whole, Some(u64::MAX));
    }
}
