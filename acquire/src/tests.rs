#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic, reason = "in a test the panic is the report")]

mod descriptions;
mod golden;
mod gravity;
mod identity;
mod intake;
mod outages;
mod page;
mod streams;
mod thermometer;
mod times;
mod world;

use crate::description::Description;
use crate::intake::{Intake, RowArrival};
use crate::profiles::PROFILES;
use crate::stream::StreamDecoder;
use crate::tally::SkippedBytes;
use crate::{FrameArrival, Value};
use isotherm_client::RawSample;

/// A shipped profile.
fn profile(name: &str) -> Description {
    let text = PROFILES.iter().find(|(of, _)| *of == name).unwrap().1;
    Description::from_toml(text).unwrap()
}

/// The sample of a row that comes when it is read.
fn take(intake: &mut Intake, row: &[Value]) -> Option<(RawSample, u64)> {
    let mut taken = None;
    intake.take(row, RowArrival::default(), &mut |raw, session| taken = Some((raw, session)));
    taken
}

/// The rows of a stream that arrives in pieces of these lengths, in turn.
fn decode(description: &Description, bytes: &[u8], pieces: &[usize]) -> (Vec<Vec<Value>>, SkippedBytes, u64) {
    let mut decoder = StreamDecoder::new(description).unwrap();
    let (mut rows, mut damaged, mut rest) = (Vec::new(), 0, bytes);
    for piece in pieces.iter().cycle() {
        let (now, later) = rest.split_at((*piece).clamp(1, rest.len().max(1)).min(rest.len()));
        decoder.push(now, FrameArrival::default(), &mut |found| {
            damaged += found.damaged;
            rows.push(found.row.to_vec());
        });
        rest = later;
        if rest.is_empty() {
            break;
        }
    }
    decoder.end();
    (rows, *decoder.skipped(), damaged)
}
