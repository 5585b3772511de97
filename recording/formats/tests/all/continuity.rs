//! The recordings that are shipped have no fault of time: neither jitter of a logger nor what a campaign leaves out
//! between its dwells is one.

use isotherm_files::sources;
use isotherm_recording::Progress;
use isotherm_recording::{Continuity, Losses};
use isotherm_recording_formats::read::{ImuChoice, Recording, RowKind};
use std::fs;
use std::path::{Path, PathBuf};

/// All files of the folders that may be recordings.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is_recording = path.extension().is_some_and(|end| ["csv", "mcap"].iter().any(|it| end == *it));
        if path.is_dir() {
            files(&path, found);
        } else if is_recording {
            found.push(path);
        }
    }
}

/// What is missing in each part of a recording: one for each run of rows with one set point and one position. `None` if
/// the file is no recording of these rows.
fn parts(path: &Path, kind: RowKind) -> Option<Vec<Continuity>> {
    let mut parts: Vec<Continuity> = Vec::new();
    let mut place = None;
    for row in
        Recording::open(&sources(&[path.to_owned()]).unwrap(), kind, ImuChoice::Any, &Progress::default()).ok()?
    {
        let Ok(row) = row else { return None };
        if place.replace((row.set_point_c, row.position)) != place {
            parts.push(Continuity::default());
        }
        if let Some(part) = parts.last_mut() {
            part.add(&row.sample);
        }
    }
    Some(parts)
}

#[test]
fn shipped_recordings_have_no_fault_of_time() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut all = Vec::new();
    for folder in ["tests/data", "examples", "calibration/fit/tests/data", "recording/formats/tests/data"] {
        files(&root.join(folder), &mut all);
    }
    let (mut recordings, mut campaigns, mut jumps) = (0, 0, 0);
    for path in all {
        if let Some(parts) = parts(&path, RowKind::Campaign) {
            (campaigns, jumps) = (campaigns + 1, jumps + parts.len() - 1);
            for part in parts {
                assert_eq!((part.fault(), part.losses()), (None, Losses::default()), "{}", path.display());
            }
        } else if let Some(parts) = parts(&path, RowKind::Sample) {
            recordings += 1;
            for part in parts {
                assert_eq!(part.fault(), None, "{}: {}", path.display(), part.losses());
            }
        }
    }
    // What the campaigns leave out between dwells would be steps.
    assert!(campaigns == 2 && jumps > 400 && recordings > 14, "{campaigns} {jumps} {recordings}");
}
