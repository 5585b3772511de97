//! Samples of a stream that is there already.

use crate::description::Description;
use crate::frames::{DecodedFrame, FrameArrival};
use crate::intake::{Intake, RowArrival};
use crate::stream::StreamDecoder;
use crate::tally::Tally;
use isotherm_client::RawSample;

/// Makes samples of a stream that is there already, and gives each to `sink` with the number of its session, from 1.
/// Returns what was counted; `None` for IIO, which has no stream.
///
/// A piece of the stream has the time at which it came, or none, as a file has none: then frames follow each other at
/// the nominal interval, but for what a counter or a clock of the device says. Within a session sequences and times
/// rise.
pub fn samples_of<'a>(
    description: &Description,
    pieces: impl IntoIterator<Item = (&'a [u8], Option<FrameArrival>)>,
    sink: &mut impl FnMut(&RawSample, u64),
) -> Option<Tally> {
    let mut decoder = StreamDecoder::new(description)?;
    let mut intake = Intake::new(description, 0.0, false);
    for (piece, arrival) in pieces {
        intake.tally.bytes += piece.len() as u64;
        decoder.push(piece, arrival.unwrap_or_default(), &mut |found: DecodedFrame<'_>| {
            intake.take(found.row, RowArrival::of(&found, arrival.is_some()), &mut |raw, session| sink(&raw, session));
        });
    }
    decoder.end();
    intake.settle(&mut |raw, session| sink(&raw, session));
    intake.tally.skipped = *decoder.skipped();
    Some(intake.tally)
}
