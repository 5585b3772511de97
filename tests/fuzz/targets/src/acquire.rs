//! Input: the description of a source, the name of a shipped profile, or nothing for each of them; a zero byte; one
//! more than the number of pieces, their lengths less 1; a stream of bytes. The description is refused with line and
//! reason, or decodes the stream. In pieces of any lengths the frames are the same, and every byte is of a frame or
//! counted. The samples made of them have sequences and times that rise.

use crate::check_faults;
use isotherm_acquire::{Description, FrameArrival, PROFILES, SkippedBytes, StreamDecoder, samples_of};
use isotherm_shared::document::MAX_BYTES;
use isotherm_shared::wire::MAX_INTERVAL_NS;
use std::sync::LazyLock;

/// The shipped profiles with their names.
static SHIPPED: LazyLock<Vec<(&str, Description)>> = LazyLock::new(|| {
    let description = |text| Description::from_toml(text).unwrap_or_else(|faults| panic!("{faults}"));
    PROFILES.iter().map(|(name, text)| (*name, description(text))).collect()
});

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let (text, rest) = parted(bytes, bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len()));
    let (lengths, stream) = rest.split_at(rest.first().map_or(0, |count| usize::from(*count)).min(rest.len()));
    let lengths: Vec<_> = lengths.iter().skip(1).map(|length| usize::from(*length) + 1).collect();
    let Ok(text) = str::from_utf8(text) else { return };
    let mut shipped = SHIPPED.iter().filter(|(name, _)| text.is_empty() || *name == text).peekable();
    if shipped.peek().is_some() || text.len() as u64 > MAX_BYTES {
        return shipped.for_each(|(_, profile)| check(profile, stream, &lengths));
    }
    match Description::from_toml(text) {
        Ok(description) => {
            assert!(!description.summary().is_empty());
            check(&description, stream, &lengths);
        }
        Err(faults) => check_faults(text, &faults),
    }
}

/// The parts before and behind a byte.
fn parted(bytes: &[u8], at: usize) -> (&[u8], &[u8]) {
    let (before, rest) = bytes.split_at(at);
    (before, rest.get(1..).unwrap_or_default())
}

/// What decoders give.
#[derive(Debug, Default, PartialEq)]
struct Decoded {
    /// The bits of each number, and the whole numbers.
    rows: Vec<Vec<(u64, Option<u64>)>>,
    /// Bytes of each frame, and frames lost before it.
    sizes: Vec<(usize, u64)>,
    skipped: SkippedBytes,
}

/// The stream in pieces of these lengths, in turn; at once if there are none.
fn pieces<'a>(mut rest: &'a [u8], lengths: &[usize]) -> impl Iterator<Item = &'a [u8]> {
    let mut lengths = lengths.iter().cycle();
    std::iter::from_fn(move || {
        let length = lengths.next().map_or(rest.len(), |length| rest.len().min(*length));
        let (piece, later) = rest.split_at(length);
        rest = later;
        (length > 0).then_some(piece)
    })
}

/// Decodes a stream that arrives in pieces of these lengths.
fn decode(description: &Description, stream: &[u8], lengths: &[usize]) -> Option<Decoded> {
    let mut decoder = StreamDecoder::new(description)?;
    let mut decoded = Decoded::default();
    for piece in pieces(stream, lengths) {
        decoder.push(piece, FrameArrival::default(), &mut |found| {
            decoded.rows.push(found.row.iter().map(|value| (value.number.to_bits(), value.whole)).collect());
            decoded.sizes.push((found.bytes, found.damaged));
        });
    }
    decoder.end();
    decoded.skipped = *decoder.skipped();
    Some(decoded)
}

/// Checks every guarantee about a stream.
fn check(description: &Description, stream: &[u8], lengths: &[usize]) {
    let Some(whole) = decode(description, stream, &[]) else { return };
    let in_frames: usize = whole.sizes.iter().map(|(bytes, _)| bytes).sum();
    assert_eq!(in_frames as u64 + whole.skipped.bytes(), stream.len() as u64, "{whole:?}");
    let columns = description.columns().len();
    assert!(whole.rows.iter().all(|row| columns == 0 || row.len() == columns), "{columns} columns: {:?}", whole.rows);
    for lengths in [&[1], lengths] {
        assert_eq!(decode(description, stream, lengths).as_ref(), Some(&whole), "pieces of {lengths:?} bytes");
    }
    let frames = whole.rows.len() as u64;
    check_samples(description, pieces(stream, lengths).map(|piece| (piece, None)), frames);
    // Each piece comes as many milliseconds after the one before as it has bytes.
    let mut by_ns = 1_000_000_000;
    let timed = pieces(stream, lengths).map(|piece| {
        let after_ns = by_ns;
        by_ns += piece.len() as u64 * 1_000_000;
        (piece, Some(FrameArrival { after_ns, by_ns }))
    });
    check_samples(description, timed, frames);
}

/// Checks every guarantee about the samples of a stream.
fn check_samples<'a>(
    description: &Description,
    pieces: impl Iterator<Item = (&'a [u8], Option<FrameArrival>)>,
    frames: u64,
) {
    let (mut before, mut count) = (None, 0);
    let tally = samples_of(description, pieces, &mut |raw, session| {
        let now = (raw.sequence, raw.timestamp_ns);
        if let Some((of, (sequence, time))) = before {
            assert!(
                of < session || (of == session && sequence < now.0 && time < now.1),
                "{before:?} {session} {now:?}"
            );
        }
        assert!((1..=MAX_INTERVAL_NS).contains(&raw.interval_ns), "{}", raw.interval_ns);
        (before, count) = (Some((session, now)), count + 1);
    })
    .expect("the description has a stream");
    assert_eq!((tally.frames, tally.samples), (frames, count));
    let others = tally.repeated + tally.others + tally.incomplete + tally.without_temperature + tally.out_of_range;
    assert_eq!(tally.samples + others, frames, "{tally:?}");
    assert!(!tally.to_string().is_empty());
}
