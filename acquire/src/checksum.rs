//! Checksums of frames.

use crate::number::{ByteOrder, NumberType, Place};
use crc::{Algorithm, Crc, Width};
use std::sync::{Mutex, PoisonError};

/// Algorithms of 16 bits, by their names in the catalogue of parametrised CRC algorithms.
pub(crate) const CRC_16: [(&Algorithm<u16>, &str); 31] = [
    (&crc::CRC_16_ARC, "CRC-16/ARC"),
    (&crc::CRC_16_CDMA2000, "CRC-16/CDMA2000"),
    (&crc::CRC_16_CMS, "CRC-16/CMS"),
    (&crc::CRC_16_DDS_110, "CRC-16/DDS-110"),
    (&crc::CRC_16_DECT_R, "CRC-16/DECT-R"),
    (&crc::CRC_16_DECT_X, "CRC-16/DECT-X"),
    (&crc::CRC_16_DNP, "CRC-16/DNP"),
    (&crc::CRC_16_EN_13757, "CRC-16/EN-13757"),
    (&crc::CRC_16_GENIBUS, "CRC-16/GENIBUS"),
    (&crc::CRC_16_GSM, "CRC-16/GSM"),
    (&crc::CRC_16_IBM_3740, "CRC-16/IBM-3740"),
    (&crc::CRC_16_IBM_SDLC, "CRC-16/IBM-SDLC"),
    (&crc::CRC_16_ISO_IEC_14443_3_A, "CRC-16/ISO-IEC-14443-3-A"),
    (&crc::CRC_16_KERMIT, "CRC-16/KERMIT"),
    (&crc::CRC_16_LJ1200, "CRC-16/LJ1200"),
    (&crc::CRC_16_M17, "CRC-16/M17"),
    (&crc::CRC_16_MAXIM_DOW, "CRC-16/MAXIM-DOW"),
    (&crc::CRC_16_MCRF4XX, "CRC-16/MCRF4XX"),
    (&crc::CRC_16_MODBUS, "CRC-16/MODBUS"),
    (&crc::CRC_16_NRSC_5, "CRC-16/NRSC-5"),
    (&crc::CRC_16_OPENSAFETY_A, "CRC-16/OPENSAFETY-A"),
    (&crc::CRC_16_OPENSAFETY_B, "CRC-16/OPENSAFETY-B"),
    (&crc::CRC_16_PROFIBUS, "CRC-16/PROFIBUS"),
    (&crc::CRC_16_RIELLO, "CRC-16/RIELLO"),
    (&crc::CRC_16_SPI_FUJITSU, "CRC-16/SPI-FUJITSU"),
    (&crc::CRC_16_T10_DIF, "CRC-16/T10-DIF"),
    (&crc::CRC_16_TELEDISK, "CRC-16/TELEDISK"),
    (&crc::CRC_16_TMS37157, "CRC-16/TMS37157"),
    (&crc::CRC_16_UMTS, "CRC-16/UMTS"),
    (&crc::CRC_16_USB, "CRC-16/USB"),
    (&crc::CRC_16_XMODEM, "CRC-16/XMODEM"),
];

/// Algorithms of 32 bits, by their names in that catalogue.
pub(crate) const CRC_32: [(&Algorithm<u32>, &str); 12] = [
    (&crc::CRC_32_AIXM, "CRC-32/AIXM"),
    (&crc::CRC_32_AUTOSAR, "CRC-32/AUTOSAR"),
    (&crc::CRC_32_BASE91_D, "CRC-32/BASE91-D"),
    (&crc::CRC_32_BZIP2, "CRC-32/BZIP2"),
    (&crc::CRC_32_CD_ROM_EDC, "CRC-32/CD-ROM-EDC"),
    (&crc::CRC_32_CKSUM, "CRC-32/CKSUM"),
    (&crc::CRC_32_ISCSI, "CRC-32/ISCSI"),
    (&crc::CRC_32_ISO_HDLC, "CRC-32/ISO-HDLC"),
    (&crc::CRC_32_JAMCRC, "CRC-32/JAMCRC"),
    (&crc::CRC_32_MEF, "CRC-32/MEF"),
    (&crc::CRC_32_MPEG_2, "CRC-32/MPEG-2"),
    (&crc::CRC_32_XFER, "CRC-32/XFER"),
];

/// How a sum is computed.
#[derive(Clone)]
pub(crate) enum Sum {
    /// All bytes, modulo 256.
    Added,
    /// What makes the sum of all bytes and the checksum 0, modulo 256.
    AddedToZero,
    /// The exclusive or of all bytes.
    Xor,
    /// A CRC of 16 bits.
    Crc16(Box<Crc<u16>>),
    /// A CRC of 32 bits.
    Crc32(Box<Crc<u32>>),
}

/// The parameters of a CRC that has no name: polynomial, initial value, reflection of input and output, final
/// exclusive or.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Parameters<W> {
    /// Polynomial without its highest term.
    pub(crate) polynomial: W,
    /// Initial value.
    pub(crate) init: W,
    /// Whether bytes go in with their lowest bit first.
    pub(crate) reflect_in: bool,
    /// Whether the result's bits are reversed.
    pub(crate) reflect_out: bool,
    /// What the result is combined with, by exclusive or.
    pub(crate) xorout: W,
}

impl Sum {
    /// The sum that has this name, unless it is a CRC with parameters.
    #[must_use]
    pub(crate) fn of(name: &str) -> Option<Self> {
        let crc_16 = || {
            CRC_16
                .iter()
                .find(|(_, of)| *of == name)
                .map(|(algorithm, _)| Self::Crc16(Box::new(Crc::<u16>::new(algorithm))))
        };
        let crc_32 = || {
            CRC_32
                .iter()
                .find(|(_, of)| *of == name)
                .map(|(algorithm, _)| Self::Crc32(Box::new(Crc::<u32>::new(algorithm))))
        };
        match name {
            "sum8" => Some(Self::Added),
            "sum8-negative" => Some(Self::AddedToZero),
            "xor8" => Some(Self::Xor),
            _ => crc_16().or_else(crc_32),
        }
    }

    /// A CRC of 16 bits with these parameters.
    #[must_use]
    pub(crate) fn crc_16(parameters: Parameters<u16>) -> Self {
        static KNOWN: AlgorithmCache<u16> = AlgorithmCache(Mutex::new(Vec::new()));
        Self::Crc16(Box::new(Crc::<u16>::new(KNOWN.algorithm(16, parameters))))
    }

    /// A CRC of 32 bits with these parameters.
    #[must_use]
    pub(crate) fn crc_32(parameters: Parameters<u32>) -> Self {
        static KNOWN: AlgorithmCache<u32> = AlgorithmCache(Mutex::new(Vec::new()));
        Self::Crc32(Box::new(Crc::<u32>::new(KNOWN.algorithm(32, parameters))))
    }

    /// Its type in a frame.
    #[must_use]
    pub(crate) const fn number(&self) -> NumberType {
        NumberType::Unsigned(match self {
            Self::Added | Self::AddedToZero | Self::Xor => 1,
            Self::Crc16(_) => 2,
            Self::Crc32(_) => 4,
        })
    }

    /// The sum of `bytes` and of `zeros` zeros after them.
    #[must_use]
    pub(crate) fn over(&self, bytes: &[u8], zeros: usize) -> u64 {
        const ZEROS: [u8; MAX_PAD] = [0; MAX_PAD];
        let zeros = &ZEROS[..zeros.min(MAX_PAD)];
        let sum = || bytes.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
        match self {
            Self::Added => sum().into(),
            Self::AddedToZero => sum().wrapping_neg().into(),
            Self::Xor => bytes.iter().fold(0u8, |sum, byte| sum ^ byte).into(),
            Self::Crc16(crc) => {
                let mut digest = crc.digest();
                digest.update(bytes);
                digest.update(zeros);
                digest.finalize().into()
            }
            Self::Crc32(crc) => {
                let mut digest = crc.digest();
                digest.update(bytes);
                digest.update(zeros);
                digest.finalize().into()
            }
        }
    }
}

/// Largest multiple to which a checksum's bytes are filled up with zeros.
pub(crate) const MAX_PAD: usize = 64;

/// Algorithms with parameters of a user. The library wants them for ever, so each is kept once.
struct AlgorithmCache<W: Width>(Mutex<Vec<&'static Algorithm<W>>>);

impl<W: Width + Copy + PartialEq> AlgorithmCache<W> {
    fn algorithm(&self, width: u8, wanted: Parameters<W>) -> &'static Algorithm<W> {
        let Parameters { polynomial: poly, init, reflect_in: refin, reflect_out: refout, xorout } = wanted;
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let same = known
            .iter()
            .find(|of| (of.poly, of.init, of.refin, of.refout, of.xorout) == (poly, init, refin, refout, xorout));
        if let Some(algorithm) = same {
            return algorithm;
        }
        // Neither check value nor residue is used.
        let (check, residue) = (init, init);
        let algorithm = Box::leak(Box::new(Algorithm { width, poly, init, refin, refout, xorout, check, residue }));
        known.push(algorithm);
        algorithm
    }
}

/// The checksum of a frame.
#[derive(Clone)]
pub(crate) struct Checksum {
    /// How it is computed.
    pub(crate) sum: Sum,
    /// Where it stands.
    pub(crate) at: Place,
    /// Order of its bytes.
    pub(crate) order: ByteOrder,
    /// First byte that is summed.
    pub(crate) from: Place,
    /// Byte after the last that is summed.
    pub(crate) to: Place,
    /// Zeros follow up to a multiple of this number, which are summed and not sent; 1 for none. At most [`MAX_PAD`].
    pub(crate) pad: usize,
}

impl Checksum {
    /// Whether a frame has the checksum of its bytes. `None` if the frame is too short for it.
    #[must_use]
    pub(crate) fn is_right(&self, frame: &[u8]) -> Option<bool> {
        let within = |place: Place| place.within(frame.len());
        let bytes = frame.get(within(self.from)?..within(self.to)?)?;
        let at = within(self.at)?;
        let stated = frame.get(at..at + self.sum.number().bytes())?;
        let zeros = bytes.len().next_multiple_of(self.pad.max(1)) - bytes.len();
        Some(self.sum.number().read(stated, self.order).whole == Some(self.sum.over(bytes, zeros)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn catalogue_and_parameters_give_the_check_values_of_the_catalogue() {
        for (algorithm, name) in CRC_16 {
            let parameters = Parameters {
                polynomial: algorithm.poly,
                init: algorithm.init,
                reflect_in: algorithm.refin,
                reflect_out: algorithm.refout,
                xorout: algorithm.xorout,
            };
            for sum in [Sum::of(name).unwrap(), Sum::crc_16(parameters), Sum::crc_16(parameters)] {
                assert_eq!(sum.over(b"123456789", 0), u64::from(algorithm.check), "{name}");
            }
        }
        for (algorithm, name) in CRC_32 {
            assert_eq!(Sum::of(name).unwrap().over(b"123456789", 0), u64::from(algorithm.check), "{name}");
        }
        assert_eq!(Sum::of("CRC-32/MPEG-2").unwrap().over(b"123456789", 0), 0x0376_e6e7);
        assert_eq!(Sum::of("CRC-16/XMODEM").unwrap().over(b"123456789", 0), 0x31c3);
        assert_eq!(Sum::of("sum8").unwrap().over(b"123456789", 0), 0xdd);
        assert_eq!(Sum::of("sum8-negative").unwrap().over(b"123456789", 0), 0x23);
        assert_eq!(Sum::of("xor8").unwrap().over(b"123456789", 0), 0x31);
        assert_eq!(
            Sum::of("CRC-32/MPEG-2").unwrap().over(b"12", 2),
            Sum::of("CRC-32/MPEG-2").unwrap().over(b"12\0\0", 0)
        );
        assert!(Sum::of("CRC-8/MAXIM").is_none());
    }
}
