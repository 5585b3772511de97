//! Measurements of files by position, and of a sheet of means.

use crate::samples::PositionFile;
use isotherm_campaign::{Campaign, Dwell};
use isotherm_files::{open_recording, sources};
use isotherm_fit::{Measurements, read_measurements, sha256};
use isotherm_recording::{CampaignRow, Marks, Progress, RecordingError};
use isotherm_recording_formats::convert::{Mapping, MeanRow, TimeUnit, read_means};
use isotherm_recording_formats::read::{Input, Places, Recording, RowKind};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, Location, name};
use std::collections::HashMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Findings of files that the dwells show by themselves.
const OF_DWELLS: [&str; 4] = [name::MISSING_ROWS, name::TIME_STEP, name::INTERVAL, name::ONE_TEMPERATURE];
/// A time since 1970 that is later is a date \[ns\]: 2001.
const DATED_NS: u64 = 1_000_000_000_000_000_000;
/// Times of a day that were joined over a few days are earlier \[ns\]: a year.
const YEAR_NS: u64 = 31_536_000_000_000_000;
/// Largest sheet \[bytes\].
const SHEET: u64 = 1 << 26;

/// What was read of files.
#[derive(Default)]
pub(crate) struct PositionData {
    pub measurements: Measurements,
    pub places: Places,
    pub marks: Marks,
    /// SHA-256 of the sheet; of files by position, of the SHA-256 of all files in their order.
    pub sha256: String,
    pub notes: Vec<String>,
}

/// A file by position after its last row.
struct ReadFile {
    measurements: Measurements,
    sha256: String,
    path: PathBuf,
}

/// Reads files by position.
pub(crate) fn by_position(
    campaign: &Campaign,
    files: &[PositionFile],
    (input, mapping): (&Input, Option<&Mapping>),
    bar: &Progress,
) -> Result<PositionData, Failure> {
    let (mut all, mut found) = (PositionData::default(), Vec::new());
    let (mut before, mut read) = (0, Vec::new());
    for file in files {
        let opened = sources(std::slice::from_ref(&file.path))
            .and_then(|sources| Recording::open_hashed(&sources, RowKind::Sample, input.clone(), bar));
        let mut rows = opened.map_err(|failure| of_one_file(failure, file, !read.is_empty()))?;
        let (mut failed, mut last) = (None, 0);
        let of_file = core::iter::from_fn(|| match rows.next()? {
            Ok(row) => {
                all.marks.add(&row.sample);
                last = row.line;
                let (line, set_point_c, position) = (before + row.line, file.set_point_c, Some(file.position));
                Some(Ok(CampaignRow { line, set_point_c, position, ..row }))
            }
            Err(error) => {
                failed = Some(rows.failure(&error));
                None
            }
        });
        let measurements = read_measurements(campaign, of_file);
        if let Some(failure) = failed {
            return Err(of_one_file(failure, file, !read.is_empty()));
        }
        all.places.append(rows.places(), before);
        before += last.max(1);
        let measurements = measurements.map_err(|error| located(&all.places, &file.path, &error))?;
        if last == 0 {
            let message = format!("{}: there are no rows", shown(&file.path));
            return Err(of_one_file(Failure::new(Exit::Data, message).at(&file.path, None), file, true));
        }
        found.push((file.path.clone(), rows.findings()));
        for note in rows.notes().into_iter().filter(|note| !all.notes.contains(note)).collect::<Vec<_>>() {
            all.notes.push(note);
        }
        read.push(ReadFile { measurements, sha256: rows.sha256()?, path: file.path.clone() });
    }
    refuse_copies(&read)?;
    let hashes: Vec<_> = read.iter().map(|file| file.sha256.as_str()).collect();
    all.sha256 = sha256(hashes.join("\n").as_bytes());
    all.measurements = joined(read, mapping)?;
    all.measurements.findings = told_once(found);
    Ok(all)
}

/// Reads a sheet of means.
pub(crate) fn of_means(campaign: &Campaign, sheet: &Path, mapping: Mapping) -> Result<PositionData, Failure> {
    let mut bytes = Vec::new();
    let source = open_recording(sheet).map_err(|error| Failure::io("opening", sheet, &error))?;
    let read = source.take(SHEET + 1).read_to_end(&mut bytes);
    read.map_err(|error| Failure::io("reading", sheet, &error))?;
    if bytes.len() as u64 > SHEET {
        let message =
            format!("{}: over {} MiB; a sheet has a row for each position and set point", shown(sheet), SHEET >> 20);
        return Err(Failure::new(Exit::Data, message).at(sheet, None));
    }
    let sha256 = sha256(&bytes);
    let means = read_means(sheet, bytes, mapping)?;
    let mut dwells: Vec<Dwell> = Vec::new();
    for mean in means {
        let MeanRow { line, set_point_c, position, rates, temperature } = mean;
        let refused = |message: String| {
            let place = format!("{}:{line}: set point {set_point_c} degC, position {position}", shown(sheet));
            Failure::new(Exit::Data, format!("{place}: {message}")).at(sheet, Some(line))
        };
        let Some(index) = campaign.positions.iter().position(|known| known.number == position) else {
            let known: Vec<_> = campaign.positions.iter().map(|position| position.number.to_string()).collect();
            return Err(refused(format!(
                "no such position; the campaign file lists {}; give it as [[position]], or take the row out",
                known.join(", ")
            )));
        };
        let visit = dwells.iter().rev().take_while(|dwell| dwell.set_point_c == set_point_c);
        if let Some(other) = visit.into_iter().find(|dwell| dwell.position == index) {
            return Err(refused(format!("line {} has this mean, too; take one out", other.lines[0])));
        }
        dwells.push(Dwell::of_means(line, set_point_c, index, rates, temperature));
    }
    let mut places = Places::default();
    places.begin(sheet, None, 0);
    Ok(PositionData {
        measurements: Measurements { dwells, ..Measurements::default() },
        places,
        sha256,
        ..PositionData::default()
    })
}

/// The failure of a row of a file.
fn located(places: &Places, path: &Path, error: &RecordingError) -> Failure {
    match error {
        RecordingError::Data { line, message } => {
            Failure::new(Exit::Data, format!("{}: {message}", places.locate(*line)))
                .at(path, Some(places.within_piece(*line)))
        }
        _ => error.failure(path),
    }
}

/// The failure of a file, with what can be done without it. What all files have, the first one shows: then others can
/// be read, or it is empty.
fn of_one_file(failure: Failure, file: &PositionFile, others_are_right: bool) -> Failure {
    let is_empty = ["there are no rows", "the file is empty"].iter().any(|end| failure.message.ends_with(end));
    if !others_are_right && !is_empty {
        return failure;
    }
    let PositionFile { set_point_c, position, .. } = file;
    let message = format!(
        "{}; measure position {position} at {set_point_c} degC again, or take the file away and leave the \
         position out with --exclude {set_point_c}/{position}",
        failure.message
    );
    Failure { message, ..failure }
}

/// Refuses a file that is there twice.
fn refuse_copies(read: &[ReadFile]) -> Result<(), Failure> {
    let mut seen: HashMap<&str, &Path> = HashMap::new();
    for file in read {
        if let Some(other) = seen.insert(&file.sha256, &file.path) {
            let message =
                format!("{} is a copy of {}; give each position its own file", shown(&file.path), shown(other));
            return Err(Failure::new(Exit::Data, message).at(&file.path, None));
        }
    }
    Ok(())
}

/// The measurements of all files, in order of time, if their times are those of one clock.
fn joined(read: Vec<ReadFile>, mapping: Option<&Mapping>) -> Result<Measurements, Failure> {
    let mut spans: Vec<_> = read.iter().filter_map(|file| Some((file.time_ns()?, file.path.clone()))).collect();
    spans.sort();
    let overlap = spans.windows(2).find(|pair| pair[1].0[0] < pair[0].0[1]);
    let is_dated = spans.first().is_some_and(|(span, _)| span[0] > DATED_NS);
    if let Some([(_, before), (_, after)]) = overlap.filter(|_| is_dated) {
        let message = format!(
            "{} and {} have rows of the same time; correct the dates, or give the files that belong to the positions",
            shown(before),
            shown(after)
        );
        return Err(Failure::new(Exit::Data, message).at(after, None));
    }
    let time = mapping.map(|mapping| &mapping.time.column);
    let is_of_day =
        matches!(time, Some(Some((_, TimeUnit::Iso8601)))) && spans.last().is_some_and(|(span, _)| span[1] < YEAR_NS);
    let has_times = !matches!(time, Some(None)) && overlap.is_none() && !is_of_day;
    let mut all = Measurements::default();
    for ReadFile { measurements, .. } in read {
        all.dwells.extend(measurements.dwells);
        all.gyroscopes.present |= measurements.gyroscopes.present;
        all.gyroscopes.dwells.extend(measurements.gyroscopes.dwells);
        all.gyroscopes.turns.extend(measurements.gyroscopes.turns);
        all.other_device = all.other_device.or(measurements.other_device);
    }
    for dwell in all.dwells.iter_mut().chain(&mut all.gyroscopes.dwells) {
        dwell.time_ns = dwell.time_ns.filter(|_| has_times);
    }
    // Without times, in the order of set points and positions.
    all.dwells.sort_by_key(|dwell| dwell.time_ns);
    all.gyroscopes.dwells.sort_by_key(|dwell| dwell.time_ns);
    if has_times {
        all.gyroscopes.turns.sort_by_key(|turn| turn.run.time_ns);
    }
    Ok(all)
}

impl ReadFile {
    fn time_ns(&self) -> Option<[u64; 2]> {
        let turns = self.measurements.gyroscopes.turns.iter().map(|turn| &turn.run);
        self.measurements.dwells.iter().chain(turns).find_map(|run| run.time_ns)
    }
}

/// What was found in files, each name once: in how many, and of which the first.
fn told_once(found: Vec<(PathBuf, Vec<Finding>)>) -> Vec<Finding> {
    let mut all: Vec<(Finding, u64)> = Vec::new();
    for (path, findings) in found {
        let findings = findings.into_iter().filter(|finding| !OF_DWELLS.contains(&finding.name));
        for finding in findings {
            match all.iter_mut().find(|(told, _)| told.name == finding.name) {
                Some((_, more)) => *more += 1,
                None => all.push((finding.at(Location::Recording(shown(&path).to_string())), 0)),
            }
        }
    }
    let told = |(finding, more): (Finding, u64)| match more {
        0 => finding,
        _ => Finding { message: format!("{}; and {more} more files have such a finding", finding.message), ..finding },
    };
    all.into_iter().map(told).collect()
}
