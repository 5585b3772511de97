//! The files of a folder that is a bag of ROS 2.

use isotherm_support::failure::{Exit, Failure, shown};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

/// What a bag says of itself.
const METADATA: &str = "metadata.yaml";
/// Largest one that is read \[bytes\].
const MOST: u64 = 1 << 24;

/// The files of these paths: the folder of a bag of ROS 2 stands for the files of the bag.
///
/// # Errors
/// If a folder has no bag in MCAP, with the program that makes one.
pub(super) fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut all = Vec::new();
    for path in paths {
        if path.is_dir() {
            all.extend(of_folder(path)?);
        } else {
            all.push(path.clone());
        }
    }
    Ok(all)
}

fn of_folder(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error: std::io::Error| Failure::io("reading", folder, &error);
    let refused = |message: &str| Err(Failure::new(Exit::Data, format!("{}: {message}", shown(folder))));
    let mut found: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if may_be_file(&path) {
            found.push(path);
        }
    }
    // Pieces have one order of times; the names decide where they have none.
    found.sort_unstable();
    let metadata = folder.join(METADATA);
    let listed = if found.contains(&metadata) { listed(&metadata)? } else { Vec::new() };
    let ends_in = |extension: &'static str| {
        move |path: &&PathBuf| path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
    };
    let has = |extension: &'static str| found.iter().any(|path| ends_in(extension)(&path));
    if has("db3") {
        return refused(
            "a bag of ROS 2 in SQLite (.db3); convert it to MCAP: ros2 bag convert -i FOLDER -o to_mcap.yaml, with the \
             lines `output_bags:`, `- uri: NEW`, `  storage_id: mcap` and `  all: true` in to_mcap.yaml; or \
             rosbags-convert --src FOLDER --dst NEW --dst-storage mcap",
        );
    }
    if has("zstd") || has("zst") {
        return refused("a bag of compressed files; unpack them, and name them: zstd -d --rm FOLDER/*.zstd");
    }
    if !listed.is_empty() {
        let files: Vec<_> = listed.iter().map(|name| folder.join(name)).collect();
        return match files.iter().find(|path| !may_be_file(path)) {
            Some(path) => refused(&format!("{METADATA} lists {}, which is no file", shown(path))),
            None => Ok(files),
        };
    }
    let files: Vec<_> = found.iter().filter(ends_in("mcap")).cloned().collect();
    if files.is_empty() {
        return refused("a folder without a bag of ROS in MCAP; name the files");
    }
    if !found.contains(&metadata) && files.len() > 1 {
        return refused(&format!("a folder without {METADATA}, whose files may be of several bags; name the files"));
    }
    Ok(files)
}

/// Whether it is a regular file, or not there, which is reported when it is read. A pipe would be waited for without
/// end.
fn may_be_file(path: &Path) -> bool {
    path.metadata().map_or(true, |found| found.is_file())
}

/// The files in MCAP that the description of a bag lists: lines `- NAME.mcap` behind `relative_file_paths:`.
fn listed(metadata: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error: std::io::Error| Failure::io("reading", metadata, &error);
    if fs::metadata(metadata).map_err(failed)?.len() > MOST {
        return Ok(Vec::new());
    }
    let text = fs::read(metadata).map_err(failed)?;
    let text = String::from_utf8_lossy(&text);
    let behind = text.lines().map(str::trim).skip_while(|line| *line != "relative_file_paths:").skip(1);
    let names = behind.map_while(|line| line.strip_prefix("- "));
    let names = names.map(|name| name.trim().trim_matches(|letter| letter == '"' || letter == '\''));
    // Files lie in the folder itself. A bag that was moved may list them with the folder that it was in.
    let names = names.filter_map(|name| Path::new(name).file_name().map(OsStr::to_owned));
    Ok(names.map(PathBuf::from).filter(|name| name.extension() == Some(OsStr::new("mcap"))).collect())
}
