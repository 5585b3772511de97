//! Frames that nobody of this project wrote: `tests/data/golden.toml`.

use super::{decode, profile, take};
use crate::description::Description;
use crate::intake::Intake;
use std::collections::BTreeMap;
use std::path::Path;

#[derive(serde::Deserialize)]
struct Golden {
    frame: Vec<GoldenFrame>,
}

#[derive(serde::Deserialize)]
struct GoldenFrame {
    profile: Option<String>,
    description: Option<String>,
    source: String,
    bytes: String,
    #[serde(default = "yes")]
    valid: bool,
    #[serde(default = "yes")]
    healthy: bool,
    #[serde(default = "yes")]
    sample: bool,
    #[serde(default)]
    expected: BTreeMap<String, f64>,
}

const fn yes() -> bool {
    true
}

/// The bytes of hexadecimal digits.
pub(super) fn bytes(text: &str) -> Vec<u8> {
    let digits: Vec<_> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
    digits.chunks(2).map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
}

#[test]
fn golden_frames_decode_to_what_their_sources_say() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let golden: Golden = toml::from_str(&std::fs::read_to_string(folder.join("golden.toml")).unwrap()).unwrap();
    assert!(golden.frame.len() > 10);
    for frame in golden.frame {
        let GoldenFrame { profile: name, description, source, valid, healthy, sample, expected, .. } = &frame;
        let description = match (name, description) {
            (Some(name), _) => profile(name),
            (None, Some(file)) => Description::from_toml(&std::fs::read_to_string(folder.join(file)).unwrap()).unwrap(),
            (None, None) => panic!("{source}: names neither profile nor description"),
        };
        let bytes = bytes(&frame.bytes);
        let (rows, skipped, _) = decode(&description, &bytes, &[1]);
        assert_eq!(rows.len(), usize::from(*valid), "{source}: {skipped:?}");
        assert_eq!(skipped.bytes(), if *valid { 0 } else { bytes.len() as u64 }, "{source}");
        let Some(row) = rows.first() else { continue };
        let names = description.columns();
        for (field, value) in expected {
            let at =
                names.iter().position(|name| name == field).unwrap_or_else(|| panic!("{source}: no field {field}"));
            let number = row[at].number;
            assert!((number - value).abs() <= 1e-12 * value.abs(), "{source}: {field} is {number}, not {value}");
        }
        let mut intake = Intake::new(&description, 0.0, false);
        let taken = take(&mut intake, row);
        let is_sample = taken.is_some() || intake.tally.without_temperature == 1;
        assert_eq!(is_sample, *sample, "{source}: {:?}", intake.tally);
        if taken.is_some() {
            assert_eq!(intake.tally.unhealthy, u64::from(!healthy), "{source}");
        }
    }
}
