//! The raw samples of a recording, in whatever format it is: what `feed`, `replay` and `verify` read.

#[cfg(feature = "record")]
mod contained;
#[cfg(feature = "record")]
mod mcap;
#[cfg(feature = "record")]
mod pages;
#[cfg(feature = "record")]
mod parquet;

use crate::failure::{Exit, Failure};
use crate::files::open_recording;
use indicatif::ProgressBar;
use isotherm_client::{ImuId, RawSample};
use isotherm_shared::recording::{RawReader, RecordingError};
use std::fs::File;
use std::io::{self, Cursor, Read, Write as _};
use std::path::{Path, PathBuf};

/// The first bytes of Parquet and MCAP files.
const PARQUET: &[u8] = b"PAR1";
const MCAP: &[u8] = b"\x89MCAP0\r\n";

/// Which IMU's samples, of a recording that may have several.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "record"), expect(dead_code, reason = "CSV holds one IMU's"))]
pub enum Pick<'a> {
    /// This one's and no other's.
    Only(&'a ImuId),
    /// The only one's; among several this one's.
    Rather(&'a ImuId),
}

/// An iterator over the samples that ends at the first error.
pub struct Samples {
    path: PathBuf,
    source: Source,
    ended: bool,
}

enum Source {
    Csv(Box<RawReader<Box<dyn Read>>>),
    #[cfg(feature = "record")]
    Mcap(Box<mcap::McapSamples>),
    #[cfg(feature = "record")]
    Parquet(Box<parquet::ParquetSamples>, ProgressBar),
}

impl Samples {
    /// Opens a recording, its format told by its first bytes; `-` is stdin. `bar` follows the bytes.
    ///
    /// # Errors
    /// If it cannot be opened, or its beginning is wrong.
    pub fn open(path: &Path, pick: Pick<'_>, bar: &ProgressBar) -> Result<Self, Failure> {
        let io = |error: &io::Error| Failure::io("opening", path, error);
        let mut source = open_recording(path).map_err(|error| io(&error))?;
        let mut head = Vec::new();
        (&mut source).take(MCAP.len() as u64).read_to_end(&mut head).map_err(|error| io(&error))?;
        let failed = |error| Failure::recording(path, &error);
        let source = if head.starts_with(PARQUET) {
            let what = "a Parquet file cannot be read from a pipe: its directory is at its end; name the file";
            let file = File::open(path).ok().filter(|file| file.metadata().is_ok_and(|metadata| metadata.is_file()));
            let file = file.ok_or_else(|| Failure::new(Exit::Usage, what))?;
            Self::parquet(file, pick, bar).map_err(failed)?
        } else if head == MCAP {
            Self::mcap(Box::new(bar.wrap_read(Cursor::new(head).chain(source))), pick).map_err(failed)?
        } else {
            let source: Box<dyn Read> = Box::new(bar.wrap_read(Cursor::new(head).chain(source)));
            Source::Csv(Box::new(RawReader::new(source).map_err(failed)?))
        };
        Ok(Self { path: path.to_owned(), source, ended: false })
    }

    #[cfg(feature = "record")]
    fn parquet(file: File, pick: Pick<'_>, bar: &ProgressBar) -> Result<Source, RecordingError> {
        Ok(Source::Parquet(Box::new(parquet::ParquetSamples::open(file, pick)?), bar.clone()))
    }

    #[cfg(feature = "record")]
    fn mcap(source: Box<dyn Read>, pick: Pick<'_>) -> Result<Source, RecordingError> {
        Ok(Source::Mcap(Box::new(mcap::McapSamples::new(source, pick))))
    }

    #[cfg(not(feature = "record"))]
    fn parquet(_: File, _: Pick<'_>, _: &ProgressBar) -> Result<Source, RecordingError> {
        Err(left_out("Parquet"))
    }

    #[cfg(not(feature = "record"))]
    fn mcap(_: Box<dyn Read>, _: Pick<'_>) -> Result<Source, RecordingError> {
        Err(left_out("MCAP"))
    }
}

#[cfg(not(feature = "record"))]
fn left_out(format: &str) -> RecordingError {
    let message = format!("this isotherm was built without the feature `record`, which reads {format}; give CSV");
    RecordingError::Place { place: "byte 0".to_owned(), message }
}

impl Iterator for Samples {
    type Item = Result<RawSample, Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let (item, cut) = match &mut self.source {
            Source::Csv(reader) => (reader.next(), reader.cut()),
            #[cfg(feature = "record")]
            Source::Mcap(reader) => (reader.read().transpose(), reader.cut()),
            #[cfg(feature = "record")]
            Source::Parquet(reader, bar) => {
                let item = reader.read().transpose();
                bar.set_position(reader.bytes_read());
                (item, None)
            }
        };
        self.ended = !matches!(item, Some(Ok(_)));
        if let (None, Some(cut), false) = (&item, cut, cfg!(test)) {
            let _ = writeln!(io::stderr(), "isotherm: warning: {}: {cut}", self.path.display());
        }
        item.map(|item| item.map_err(|error| Failure::recording(&self.path, &error)))
    }
}

#[cfg(test)]
#[cfg(feature = "record")]
mod tests;
