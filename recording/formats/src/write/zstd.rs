//! Packs the chunks of an MCAP file with zstd.
//!
//! Rows repeat the bytes of the rows right before them. The search of the library keeps the first place of a text in a
//! block, and far places take more bits. Ours keeps the last one: files are a sixth smaller, in less time.

use ruzstd::encoding::{CompressionLevel, FrameCompressor, Matcher, Sequence};
use std::io::Cursor;
use std::mem::replace;

/// Longest block \[bytes\], which is also how far back a match is.
const BLOCK: usize = 1 << 17;
/// Lengths of the texts that are sought: a long one first, then a short one \[bytes\].
const LONG: usize = 8;
const SHORT: usize = 4;
/// Bits of the keys of the tables of places.
const KEY_BITS: u32 = 15;

/// Packs chunks, each as a frame of its own.
pub(super) struct ChunkCompressor(Box<FrameCompressor<Cursor<Vec<u8>>, Vec<u8>, NearestMatch>>);

impl Default for ChunkCompressor {
    fn default() -> Self {
        let compressor = FrameCompressor::new_with_matcher(NearestMatch::default(), CompressionLevel::Fastest);
        Self(Box::new(compressor))
    }
}

impl ChunkCompressor {
    /// The frame of these bytes.
    pub(super) fn pack(&mut self, bytes: Vec<u8>) -> Vec<u8> {
        self.0.set_source(Cursor::new(bytes));
        self.0.set_drain(Vec::new());
        self.0.compress();
        self.0.take_drain().unwrap_or_default()
    }
}

/// Finds the nearest text that repeats, within a block. So each block begins with bytes that are no match: the library
/// cannot encode a block in which no match has bytes before it.
#[derive(Default)]
struct NearestMatch {
    block: Vec<u8>,
    /// The places behind the last long and the last short text with each key; 0 without one.
    places: [Vec<u32>; 2],
}

impl NearestMatch {
    /// The places behind the last texts with the keys of the text at `at`, which takes their place.
    fn exchange(&mut self, at: usize) -> [u32; 2] {
        let Some(text) = self.block[at..].first_chunk() else { return [0; 2] };
        let text = u64::from_le_bytes(*text);
        let key = |text: u64| (text.wrapping_mul(0x9e37_79b1_85eb_ca87) >> (u64::BITS - KEY_BITS)) as usize;
        let [long, short] = &mut self.places;
        let short_text = text << (u64::BITS - 8 * SHORT as u32);
        let place = at as u32 + 1;
        [replace(&mut long[key(text)], place), replace(&mut short[key(short_text)], place)]
    }

    /// How many bytes at `at` are as those at the place before `behind`.
    fn common(&self, behind: u32, at: usize) -> usize {
        let Some(place) = behind.checked_sub(1) else { return 0 };
        let both = self.block[at..].iter().zip(&self.block[place as usize..]);
        both.take_while(|(one, other)| one == other).count()
    }

    /// The place behind the begin of the match at `at`, and its length; 0 without one.
    fn find(&mut self, at: usize) -> (u32, usize) {
        let [long, short] = self.exchange(at);
        let found = self.common(long, at);
        if found >= LONG {
            return (long, found);
        }
        let found = self.common(short, at);
        if found >= SHORT { (short, found) } else { (0, 0) }
    }
}

impl Matcher for NearestMatch {
    fn get_next_space(&mut self) -> Vec<u8> {
        vec![0; BLOCK]
    }

    fn get_last_space(&mut self) -> &[u8] {
        &self.block
    }

    fn commit_space(&mut self, space: Vec<u8>) {
        self.block = space;
        self.places = [(); 2].map(|()| vec![0; 1 << KEY_BITS]);
    }

    /// Matches are within a block.
    fn skip_matching(&mut self) {}

    fn start_matching(&mut self, mut handle_sequence: impl for<'a> FnMut(Sequence<'a>)) {
        let (mut literal, mut at) = (0, 0);
        while at < self.block.len() {
            let (behind, match_len) = self.find(at);
            if match_len == 0 {
                at += 1;
                continue;
            }
            let (literals, offset) = (&self.block[literal..at], at + 1 - behind as usize);
            handle_sequence(Sequence::Triple { literals, offset, match_len });
            let end = at + match_len;
            for inside in (at + 1..end).step_by(2) {
                self.exchange(inside);
            }
            (literal, at) = (end, end);
        }
        if literal < at {
            handle_sequence(Sequence::Literals { literals: &self.block[literal..] });
        }
    }

    fn reset(&mut self, _: CompressionLevel) {}

    fn window_size(&self) -> u64 {
        BLOCK as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ruzstd::decoding::FrameDecoder;

    fn assert_unpacks(compressor: &mut ChunkCompressor, bytes: &[u8]) {
        let mut unpacked = vec![0; bytes.len()];
        let length = FrameDecoder::new().decode_all(&compressor.pack(bytes.to_vec()), &mut unpacked).unwrap();
        assert!(length == bytes.len() && unpacked == bytes, "{} bytes became {length} others", bytes.len());
    }

    /// Texts of few letters repeat in all lengths; several of them fill more than a block.
    fn text() -> impl Strategy<Value = Vec<u8>> {
        let part = (prop::collection::vec(0..4_u8, 0..40), 1..200_usize);
        let repeated = part.prop_map(|(text, times)| text.repeat(times));
        let parts = prop::collection::vec(prop_oneof![repeated, prop::collection::vec(any::<u8>(), 0..3000)], 0..60);
        parts.prop_map(|parts| parts.concat())
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_bytes_are_unpacked_to_what_they_were(first in text(), second in text()) {
            let mut compressor = ChunkCompressor::default();
            assert_unpacks(&mut compressor, &first);
            assert_unpacks(&mut compressor, &second);
        }
    }

    #[test]
    fn blocks_of_every_kind_are_unpacked_to_what_they_were() {
        let mut compressor = ChunkCompressor::default();
        for length in [0, 1, 3, 4, 5, 1024, 1025, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 4] {
            assert_unpacks(&mut compressor, &vec![7; length]);
            assert_unpacks(&mut compressor, &(0..length).map(|index| (index % 251) as u8).collect::<Vec<_>>());
            assert_unpacks(&mut compressor, &(0..length).map(|index| ((index * index) >> 7) as u8).collect::<Vec<_>>());
        }
    }
}
