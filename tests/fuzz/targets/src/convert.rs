//! Input: a mapping, a zero byte, and foreign data in any format. They are converted, or refused with a message that a
//! terminal can show. The mapping that is proposed for a text is valid, or leaves open what the text does not say.

use crate::{check_faults, memory_file, within_budget};
use isotherm_recording_formats::convert::{Conversion, Mapping, Settings};
use isotherm_shared::document::MAX_BYTES;
use isotherm_shared::wire::MAX_INTERVAL_NS;
use isotherm_support::failure::{Exit, printable};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// The data, in memory, and a path that opens them.
static INPUT: LazyLock<(File, PathBuf)> = LazyLock::new(memory_file);

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let (mapping, data) = bytes.iter().position(|byte| *byte == 0).map_or((bytes, &[][..]), |at| {
        let (mapping, rest) = bytes.split_at(at);
        (mapping, &rest[1..])
    });
    let Ok(mapping) = str::from_utf8(mapping) else { return };
    if mapping.len() as u64 > MAX_BYTES {
        return;
    }
    if let Err(faults) = Mapping::from_toml(mapping) {
        check_faults(mapping, &faults);
    }
    fs::write(&INPUT.1, data).expect("memory takes all");
    let convert = |mapping: Option<&str>| within_budget(data.len(), || convert(mapping));
    convert(Some(mapping));
    if let Some(proposal) = convert(None) {
        if let Err(faults) = Mapping::from_toml(&proposal) {
            assert!(faults.0.iter().all(|fault| fault.message.contains('?')), "{faults}\n{proposal}");
        }
        convert(Some(&proposal));
    }
}

/// Converts the data. Returns the mapping that is proposed.
fn convert(mapping: Option<&str>) -> Option<String> {
    let named = mapping.map(|mapping| (Path::new("mapping.toml"), mapping));
    let converted =
        Conversion::open(&isotherm_files::source(&INPUT.1), named, &Settings::default()).and_then(|mut conversion| {
            let used = conversion.vehicle_state().in_use();
            assert!(used.windows(2).all(|pair| pair[0].end < pair[1].start), "{used:?}");
            let mut before = None;
            for sample in &mut conversion {
                let sample = sample?;
                let now = (sample.sequence, sample.timestamp_ns);
                assert!(before.is_none_or(|(sequence, time)| sequence < now.0 && time < now.1), "{before:?} {now:?}");
                assert!((1..=MAX_INTERVAL_NS).contains(&sample.interval_ns), "{}", sample.interval_ns);
                before = Some(now);
            }
            drop((conversion.notes(), conversion.findings()));
            Ok(())
        });
    let failure = converted.err()?;
    assert!([Exit::Data, Exit::Config, Exit::Usage].contains(&failure.exit), "{failure}");
    assert_eq!(printable(&failure.message), failure.message);
    (failure.exit == Exit::Usage && mapping.is_none())
        .then(|| failure.message.split_once("\n\n").map(|(_, proposal)| proposal.to_owned()))?
}
