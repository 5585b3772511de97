//! The description that `docs/acquire.md` writes from a data sheet, an SBG Ellipse's.

use super::golden::bytes;
use super::{decode, take};
use crate::description::Description;
use crate::intake::Intake;
use std::path::Path;

/// `SBG_ECOM_LOG_IMU_SHORT`, put together by hand from doc/binaryProtocol.md and doc/binaryMessages.md of
/// SBG-Systems/sbgECom, 05c19cdd7c021a8474b2bffc8ca4ec274f6a9155, with a CRC of another program. No public frame of a
/// real device was found.
const IMU_SHORT: &str = "ff5a2c002000d2029649ff036666feff33330300b21763ff713d0a001f85ebff52b81e008019126b33";

/// `SBG_ECOM_LOG_EKF_QUAT` of a real device, as a public program has it in a comment; its repository is not known.
const QUATERNION: &str = "ff5a0700240068606f3ab9de7fbfe1b7c238d06002bdbfbcbeba2666003bdf2a003bf1d9183e1201000080db33";

fn text() -> &'static str {
    let page = include_str!("../../../docs/acquire.md");
    page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap()
}

fn description(text: &str) -> Description {
    Description::from_toml(text).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn the_page_s_description_decodes_what_its_data_sheet_says() {
    let description = description(text());
    let frame = bytes(IMU_SHORT);
    // Another message of the device is noise.
    let line = [bytes(QUATERNION), frame.clone(), frame[..40].to_vec()].concat();
    let (rows, skipped, _) = decode(&description, &line, &[7]);
    assert_eq!((rows.len(), skipped.noise, skipped.cut), (1, 45, 40));
    let numbers: Vec<_> = rows[0].iter().map(|value| value.number).collect();
    let (counts, rates) = ([-104_858.0, 209_715.0, -10_283_086.0], [671_089.0, -1_342_177.0, 2_013_266.0]);
    assert_eq!(numbers, [&[1_234_567_890.0, 1023.0][..], &counts, &rates, &[25.5]].concat());
    let mut intake = Intake::new(&description, 0.0, false);
    let (raw, _) = take(&mut intake, &rows[0]).unwrap();
    assert_eq!((raw.timestamp_ns, intake.tally.unhealthy), (1_234_567_890_000, 0));
    assert_eq!(raw.accelerometers.negative_pulses, [104_858, 0, 10_283_086]);
    assert_eq!(raw.gyroscopes.positive_pulses, [671_089, 0, 2_013_266]);
    // 2^-20 m/s2 and 2^-26 rad/s a count.
    let table = description.nominal(Path::new("/")).unwrap().to_toml();
    assert!(table.contains("c0 = 2056603566.08"), "{table}");
}

/// The rates' other scale.
#[test]
fn a_frame_whose_status_is_another_is_unhealthy() {
    let description = description(text());
    let (mut rows, ..) = decode(&description, &bytes(IMU_SHORT), &[64]);
    for (status, unhealthy) in [(0x7FF, 1), (0x3FE, 1), (0xFBFF, 0)] {
        rows[0][1].whole = Some(status);
        let mut intake = Intake::new(&description, 0.0, false);
        take(&mut intake, &rows[0]).unwrap();
        assert_eq!(intake.tally.unhealthy, unhealthy, "{status:x}");
    }
}

#[test]
fn a_real_frame_has_the_page_s_frame_and_checksum() {
    let other =
        text().replace("0x2C, 0x00, 0x20, 0x00", "0x07, 0x00, 0x24, 0x00").replace("length = 41", "length = 45");
    let (rows, skipped, _) = decode(&description(&other), &bytes(QUATERNION), &[1]);
    assert_eq!((rows.len(), skipped.bytes()), (1, 0));
}
