//! Streams: any chunking alike, one frame for one wrong byte, every byte counted.

use super::decode;
use crate::checksum::Sum;
use crate::description::Description;
use proptest::prelude::*;

const LENGTH: usize = 13;

/// Only accelerometers: two bytes of sync, a counter, three numbers, a temperature, a checksum.
fn description(checksum: &str) -> Description {
    let field =
        |name: &str, at: usize, kind: &str| format!("[[field]]\nname = \"{name}\"\nat = {at}\ntype = \"{kind}\"\n");
    let fields = field("n", 2, "u8")
        + &field("x", 3, "i16")
        + &field("y", 5, "i16")
        + &field("z", 7, "i16")
        + &field("t", 9, "i16");
    let text = format!(
        "format = 1\nimu = \"imu-a\"\n[source]\nkind = \"frames\"\nfile = \"-\"\n[timing]\ninterval_s = 0.01\n\
         counter = {{ column = \"n\" }}\n[frame]\nsync = [0xA5, 0x5A]\nlength = {LENGTH}\nbyte_order = \"big\"\nchecksum = {checksum}\n{fields}\
         [accelerometer]\ncolumns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\n[temperature]\ncolumns = \"t\"\n"
    );
    Description::from_toml(&text).unwrap_or_else(|faults| panic!("{faults}"))
}

const CRC: &str = "{ algorithm = \"CRC-16/XMODEM\", at = -2 }";

fn frame(counter: u8, payload: [u8; 8]) -> Vec<u8> {
    let mut frame = vec![0xA5, 0x5A, counter];
    frame.extend(payload);
    let sum = Sum::of("CRC-16/XMODEM").unwrap().over(&frame, 0) as u16;
    frame.extend(sum.to_be_bytes());
    frame
}

/// What is on the line.
#[derive(Clone, Debug)]
enum Piece {
    Frame([u8; 8]),
    Noise(Vec<u8>),
    Cut([u8; 8], usize),
}

/// Bytes that are often the sync or its beginning.
fn byte() -> impl Strategy<Value = u8> {
    prop_oneof![any::<u8>(), Just(0xA5), Just(0x5A)]
}

fn piece() -> impl Strategy<Value = Piece> {
    prop_oneof![
        4 => proptest::array::uniform8(byte()).prop_map(Piece::Frame),
        1 => proptest::collection::vec(byte(), 1..40).prop_map(Piece::Noise),
        1 => (proptest::array::uniform8(byte()), 1..LENGTH).prop_map(|(payload, cut)| Piece::Cut(payload, cut)),
    ]
}

fn line(pieces: &[Piece]) -> Vec<u8> {
    let mut line = Vec::new();
    for (counter, piece) in (0u8..=255).cycle().zip(pieces) {
        match piece {
            Piece::Frame(payload) => line.extend(frame(counter, *payload)),
            Piece::Noise(noise) => line.extend(noise),
            Piece::Cut(payload, cut) => line.extend(&frame(counter, *payload)[..*cut]),
        }
    }
    line
}

proptest! {
    #[test]
    fn any_chunking_gives_the_same(pieces in proptest::collection::vec(piece(), 1..30), cuts in proptest::collection::vec(1usize..50, 1..8)) {
        let line = line(&pieces);
        for checksum in [CRC, "{ algorithm = \"none\" }"] {
            let description = description(checksum);
            let whole = decode(&description, &line, &[line.len()]);
            prop_assert_eq!(&decode(&description, &line, &[1]), &whole);
            prop_assert_eq!(&decode(&description, &line, &cuts), &whole);
            let (rows, skipped, _) = whole;
            // Every byte is of a frame or counted.
            prop_assert_eq!(rows.len() * LENGTH + skipped.bytes() as usize, line.len());
        }
    }

    #[test]
    fn every_whole_frame_is_found(payloads in proptest::collection::vec(proptest::array::uniform8(byte()), 2..20)) {
        let pieces: Vec<_> = payloads.iter().map(|payload| Piece::Frame(*payload)).collect();
        let (rows, skipped, damaged) = decode(&description(CRC), &line(&pieces), &[7]);
        prop_assert_eq!((rows.len(), skipped.bytes(), damaged), (payloads.len(), 0, 0));
    }

    #[test]
    fn one_wrong_byte_costs_one_frame(payload in proptest::array::uniform8(any::<u8>()), at in 0..LENGTH, flip in 1..=255u8) {
        let mut line: Vec<_> = (0..5).flat_map(|counter| frame(counter, payload)).collect();
        line[2 * LENGTH + at] ^= flip;
        let (rows, skipped, damaged) = decode(&description(CRC), &line, &[11]);
        let counters: Vec<_> = rows.iter().map(|row| row[0].number).collect();
        prop_assert_eq!(counters, [0.0, 1.0, 3.0, 4.0]);
        prop_assert_eq!((skipped.bytes(), damaged), (LENGTH as u64, 1));
    }
}

/// A sync inside a payload, before a frame, and doubled frames.
#[test]
fn a_sync_inside_a_frame_begins_none() {
    let tricky = frame(1, [0xA5, 0x5A, 0xA5, 0x5A, 0xA5, 0x5A, 0xA5, 0x5A]);
    let line = [vec![0xA5], tricky.clone(), tricky.clone(), vec![0xA5, 0x5A], tricky].concat();
    let (rows, skipped, damaged) = decode(&description(CRC), &line, &[1]);
    assert_eq!(rows.len(), 3);
    assert_eq!((skipped.noise, skipped.checksum, damaged), (1, 2, 2));
}

/// Without a checksum a frame counts when another begins behind it.
#[test]
fn without_a_checksum_frames_confirm_each_other() {
    let description = description("{ algorithm = \"none\" }");
    let frames: Vec<_> = (0..4).flat_map(|counter| frame(counter, [counter; 8])).collect();
    let line = [vec![0xA5, 0x5A, 1, 2, 3], frames].concat();
    let (rows, skipped, _) = decode(&description, &line, &[4]);
    assert_eq!(rows.len(), 4);
    assert_eq!((skipped.unconfirmed, skipped.bytes()), (5, 5));
}

/// As long as its data, whatever they are: a search that began anew at each byte would not end in hours.
#[test]
fn a_megabyte_of_syncs_is_no_frame_and_takes_no_memory() {
    let description = description(CRC);
    let line = [0xA5, 0x5A].repeat(500_000);
    let (rows, skipped, _) = decode(&description, &line, &[4096]);
    assert_eq!((rows.len(), skipped.bytes()), (0, 1_000_000));
}
