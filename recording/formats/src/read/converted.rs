//! What the conversions of the foreign pieces of a recording report in the end.

use super::piece::Piece;
use crate::convert::{Conversion, Scale};
use isotherm_recording::LogImu;
use isotherm_recording::foreign::LeftOutRows;
use isotherm_shared::names::ImuId;
use isotherm_shared::table::Nominal;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, Location, name};
use std::path::{Path, PathBuf};

/// Most pieces that a line names.
const LISTED: usize = 3;

/// The pieces that have ended; `None` of a recording.
#[derive(Default)]
pub(super) struct ConversionEnds(Vec<(PathBuf, Option<ConversionEnd>)>);

/// What a conversion reports after its last row.
struct ConversionEnd {
    notes: Vec<String>,
    findings: Vec<Finding>,
    left_out: LeftOutRows,
    interval_ns: u64,
    scale: Result<Scale, String>,
    log_imu: Option<LogImu>,
    fits_table: bool,
}

impl ConversionEnds {
    /// Takes a piece after its last row.
    pub(super) fn take(&mut self, piece: &Piece) {
        let end = |conversion: &Conversion| ConversionEnd {
            notes: conversion.notes(),
            findings: conversion.findings(),
            left_out: conversion.left_out_by_stamps(),
            interval_ns: conversion.interval_ns(),
            scale: conversion.scale(),
            log_imu: conversion.log_imu(),
            fits_table: conversion.fits_table(),
        };
        self.0.push((piece.path.clone(), piece.source.conversion().map(end)));
    }

    fn foreign(&self) -> impl Iterator<Item = (&Path, &ConversionEnd)> {
        self.0.iter().filter_map(|(path, end)| Some((path.as_path(), end.as_ref()?)))
    }

    /// As [`Recording::notes`](super::Recording::notes).
    pub(super) fn notes(&self) -> Vec<String> {
        let named = |(paths, note): (Vec<&Path>, &String)| match self.0.len() {
            1 => note.clone(),
            _ => format!("{}: {note}", listed(&paths)),
        };
        self.once(|end| &end.notes).into_iter().map(named).collect()
    }

    /// As [`Recording::left_out_by_stamps`](super::Recording::left_out_by_stamps).
    pub(super) fn left_out_by_stamps(&self) -> LeftOutRows {
        let each = self.foreign().map(|(_, end)| end.left_out);
        each.fold(LeftOutRows::default(), |all, LeftOutRows { rows, of }| LeftOutRows {
            rows: all.rows + rows,
            of: all.of + of,
        })
    }

    /// As [`Recording::findings`](super::Recording::findings).
    pub(super) fn findings(&self) -> Vec<Finding> {
        let found = |(paths, finding): (Vec<&Path>, &Finding)| finding.clone().at(Location::Recording(listed(&paths)));
        self.once(|end| &end.findings).into_iter().map(found).chain(self.intervals()).collect()
    }

    /// What the pieces report, each once, with the pieces that report it.
    fn once<'a, T: PartialEq>(&'a self, told: impl Fn(&'a ConversionEnd) -> &'a Vec<T>) -> Vec<(Vec<&'a Path>, &'a T)> {
        let mut all: Vec<(Vec<&Path>, &T)> = Vec::new();
        for (path, end) in self.foreign() {
            for what in told(end) {
                match all.iter_mut().find(|(_, other)| *other == what) {
                    Some((paths, _)) => paths.push(path),
                    None => all.push((vec![path], what)),
                }
            }
        }
        all
    }

    /// Pieces with another nominal interval than the first: their readings count for another time.
    fn intervals(&self) -> Option<Finding> {
        let mut foreign = self.foreign();
        let (first, of) = foreign.next()?;
        let (path, other) = foreign.find(|(_, end)| end.interval_ns != of.interval_ns)?;
        let seconds = [of, other].map(|end| end.interval_ns as f64 / 1e9);
        let message = format!(
            "the nominal interval is {} s, but that of {} is {} s, and a table holds for one; give the interval",
            seconds[1],
            shown(first),
            seconds[0]
        );
        Some(Finding::warning(name::INTERVAL, message).at(Location::Recording(shown(path).to_string())))
    }

    /// As [`Recording::nominal`](super::Recording::nominal).
    pub(super) fn nominal(&self, imu: &ImuId) -> Result<Nominal, Failure> {
        self.scale().map(|scale| scale.nominal(imu))
    }

    /// As [`Recording::fits_table`](super::Recording::fits_table).
    pub(super) fn fits_table(&self) -> bool {
        self.foreign().count() == self.0.len() && self.foreign().all(|(_, end)| end.fits_table)
    }

    /// As [`Recording::log_imu`](super::Recording::log_imu).
    pub(super) fn log_imu(&self) -> Option<LogImu> {
        let of_piece = |(_, end): &(PathBuf, Option<ConversionEnd>)| end.as_ref()?.log_imu;
        let first = self.0.first().and_then(of_piece)?;
        self.0.iter().all(|piece| of_piece(piece) == Some(first)).then_some(first)
    }

    /// What the pulses of all pieces stand for.
    pub(super) fn scale(&self) -> Result<Scale, Failure> {
        let refused = |path: &Path, why: &str| {
            let message = format!("{}: no nominal table: {why}", shown(path));
            Failure::new(Exit::Data, message).at(path, None)
        };
        let mut joint: Option<(&Path, Scale)> = None;
        for (path, end) in &self.0 {
            let Some(end) = end else {
                return Err(refused(path, "a recording does not say what a pulse is; give a table"));
            };
            let scale = end.scale.as_ref().map_err(|why| refused(path, why))?;
            joint = match joint {
                None => Some((path, *scale)),
                Some((first, of)) => {
                    let both = of.with(scale).map_err(|what| {
                        refused(
                            path,
                            &format!("{what} is not that of {}; give files that belong together", shown(first)),
                        )
                    })?;
                    Some((first, both))
                }
            };
        }
        let (_, scale) = joint.ok_or_else(|| Failure::new(Exit::Data, "no nominal table: no rows have been read"))?;
        Ok(scale)
    }
}

/// The names of pieces.
fn listed(paths: &[&Path]) -> String {
    let named: Vec<_> = paths.iter().take(LISTED).map(|path| shown(path).to_string()).collect();
    let more = if paths.len() > LISTED { format!(" and {} more", paths.len() - LISTED) } else { String::new() };
    format!("{}{more}", named.join(", "))
}
