//! Whether a file is a recording without rows: what a recorder leaves that began and got no row.

use crate::read::plausible::CREATOR;
use crate::read::records::Records;
use isotherm_recording::columns::{MCAP_MAGIC, columns};
use isotherm_recording::layouts;
use isotherm_recording::rows::header;
use isotherm_support::storage::Storage;
use mcap::records::Record;
use std::io::Cursor;
use std::path::Path;

/// Whether a recording can be created with this name: there is no such file, or one of this user without rows, that no
/// recorder is writing.
#[must_use]
pub fn is_vacant(storage: &dyn Storage, path: &Path) -> bool {
    storage.is_vacant(path, has_no_rows)
}

/// Whether these are the bytes of a recording without rows, or none.
pub(super) fn has_no_rows(bytes: &[u8]) -> bool {
    if bytes.is_empty() {
        return true;
    }
    if bytes.starts_with(MCAP_MAGIC) {
        return has_no_messages(bytes);
    }
    layouts().any(|(stream, layout)| bytes == header(&columns(stream, layout)))
}

/// Whether an MCAP file of the recorder has nothing but channels. A record that is cut, or wrong, may be of messages.
fn has_no_messages(bytes: &[u8]) -> bool {
    let mut records = Records::new(Box::new(Cursor::new(bytes.to_vec())));
    loop {
        match records.next() {
            Ok(Some(Record::Message { .. })) | Err(_) => return false,
            Ok(Some(_)) => {}
            Ok(None) => break,
        }
    }
    // A recorder that was killed has not ended its file.
    let is_cut = records.damage().is_some() || records.is_cut();
    !is_cut && records.library().starts_with(CREATOR)
}

#[cfg(test)]
mod tests {
    use crate::write::{Files, Format, Rotation};
    use isotherm_files::Disk;
    use isotherm_recording::rows::RecordedRow;
    use isotherm_shared::names::StreamKind;
    use isotherm_shared::wire::{RawSample, StreamSample};
    use std::{fs, io};

    #[test]
    fn a_recording_without_rows_is_replaced_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let streams = StreamKind::BOTH.map(|stream| (0, stream));
        for (format, name) in [(Format::Csv, "r.csv"), (Format::Mcap, "r.mcap")] {
            let path = folder.path().join(name);
            let create =
                || Files::create(&Disk, &path, format, Rotation::default(), &["imu-a".parse().unwrap()], &streams);
            let refused = || create().err().map(|error| error.1.kind()) == Some(io::ErrorKind::AlreadyExists);
            let mut first = create().ok().unwrap();
            assert!(refused(), "{name}: another recorder has begun it");
            first.finish().ok().unwrap();
            drop(first);
            // An empty recording, and an empty file.
            drop(create().ok().unwrap());
            fs::write(&path, "").unwrap();
            let mut third = create().ok().unwrap();
            let raw = RawSample { session: 1, sequence: 1, ..RawSample::default() };
            let row = RecordedRow::new(0, 1, StreamSample::Raw(raw));
            third.write(&row).ok().unwrap();
            third.flush().ok().unwrap();
            assert!(refused(), "{name}: it has a row");
            third.finish().ok().unwrap();
            drop(third);
            assert!(refused(), "{name}: it has a row");
            for other in ["a note", "\n", "PAR1", "sequence,timestamp_ns\n"] {
                fs::write(&path, other).unwrap();
                assert!(refused(), "{name}: {other:?}");
            }
            fs::remove_file(&path).unwrap();
            std::os::unix::fs::symlink(folder.path().join("none"), &path).unwrap();
            assert!(refused(), "{name}: a link");
        }
        assert!(!folder.path().join("none").exists());
    }
}
