//! The pieces of a recording that rotates: which numbers are there, and which file a recorder has written.

use crate::read::plausible::CREATOR;
use crate::read::records::Records;
use isotherm_recording::columns::{MCAP_MAGIC, columns};
use isotherm_recording::layouts;
use isotherm_recording::rows::header;
use isotherm_support::source::ReadSeek;
use isotherm_support::storage::Storage;
use std::collections::BTreeSet;
use std::io::{self, Cursor, Read as _};
use std::path::Path;

/// The beginning of a file that shows whose it is \[bytes\]: the header of CSV with all columns is shorter.
const BEGIN: u64 = 1 << 13;

/// The numbers of the files next to `path` whose names are `path` with a number, `-0001` or higher, before the ending.
/// What stands between number and ending is not looked at.
pub(super) fn numbers(storage: &dyn Storage, path: &Path) -> BTreeSet<u32> {
    let Some(stem) = path.file_stem() else { return BTreeSet::new() };
    let begin = format!("{}-", stem.to_string_lossy());
    let end = path.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    let number = |name: &str| {
        let rest = name.strip_prefix(&begin).filter(|rest| rest.ends_with(&end))?;
        let digits = &rest[..rest.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(rest.len())];
        let number: u32 = digits.parse().ok()?;
        (digits == format!("{number:04}")).then_some(number)
    };
    storage.names_beside(path).iter().filter_map(|name| number(name)).collect()
}

/// Whether a file is a recording that a recorder of this user has written, and none is writing.
pub(super) fn is_own(storage: &dyn Storage, path: &Path) -> bool {
    storage.is_own(path, is_of_recorder)
}

/// Whether a file begins as the recorder's do.
fn is_of_recorder(file: &mut dyn ReadSeek) -> io::Result<bool> {
    let mut begin = Vec::new();
    (&mut *file).take(BEGIN).read_to_end(&mut begin)?;
    if begin.starts_with(MCAP_MAGIC) {
        let mut records = Records::new(Box::new(Cursor::new(begin)));
        // What follows the first records is cut.
        let _ = records.next();
        return Ok(records.library().starts_with(CREATOR));
    }
    Ok(layouts().any(|(stream, layout)| begin.starts_with(&header(&columns(stream, layout)))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::{Files, Format, Rotation};
    use isotherm_files::Disk;
    use isotherm_recording::rows::RecordedRow;
    use isotherm_shared::names::StreamKind;
    use isotherm_shared::wire::{RawSample, StreamSample};
    use std::fs;

    #[test]
    fn only_numbered_names_are_pieces() {
        let folder = tempfile::tempdir().unwrap();
        for name in [
            "r.csv",
            "r-0001.csv",
            "r-0003.increments.csv",
            "r-12345.csv",
            "r-12.csv",
            "r-00012.csv",
            "r-x.csv",
            "q-0004.csv",
            "r-0009",
            "r-0010.mcap",
        ] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(numbers(&Disk, &folder.path().join("r.csv")).into_iter().collect::<Vec<_>>(), [1, 3, 12_345]);
        assert!(numbers(&Disk, Path::new("/nowhere/r.csv")).is_empty());
    }

    /// Recordings of all formats are pieces once nobody writes them, and nothing else is.
    #[test]
    fn only_what_a_recorder_has_written_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let rotation =
            Rotation { size: Some(1), keep_free: Some(u64::MAX), delete_oldest: true, ..Rotation::default() };
        for (format, name) in [(Format::Csv, "r.csv"), (Format::Mcap, "r.mcap")] {
            let path = |number: u32| folder.path().join(name.replace('.', &format!("-{number:04}.")));
            let imus = ["imu-a".parse().unwrap()];
            let create = |rotation| {
                Files::create(&Disk, &folder.path().join(name), format, rotation, &imus, &[(0, StreamKind::Raw)])
            };
            let plain = Rotation { size: Some(1), ..Rotation::default() };
            fs::write(path(2), "a note").unwrap();
            std::os::unix::fs::symlink(path(2), path(3)).unwrap();
            for number in 4..7 {
                let mut files = create(plain).ok().unwrap();
                assert_eq!(files.current_paths(), [path(number)], "{name}: after the highest number");
                let raw = RawSample { session: 1, sequence: number.into(), ..RawSample::default() };
                files.write(&RecordedRow::new(0, 1, StreamSample::Raw(raw))).ok().unwrap();
                files.finish().ok().unwrap();
                assert!(!is_own(&Disk, &path(number)), "{name}: it is being written");
                drop(files);
                assert!(is_own(&Disk, &path(number)), "{name}");
            }
            let held = create(plain).ok().unwrap();
            assert_eq!(held.current_paths(), [path(7)]);
            // The disk never has so much room: all goes that may go, and that is not enough.
            let error = create(rotation).err().unwrap();
            assert!(error.is_full(), "{name}: {}", error.1);
            let left: Vec<_> = numbers(&Disk, &folder.path().join(name))
                .into_iter()
                .filter(|of| fs::symlink_metadata(path(*of)).is_ok())
                .collect();
            assert_eq!(left, [2, 3, 7], "{name}");
            assert_eq!(fs::read_to_string(path(2)).unwrap(), "a note");
            for number in [2, 3, 7] {
                fs::remove_file(path(number)).unwrap();
            }
        }
    }
}
