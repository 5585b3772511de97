//! Opens the file of a recording: its format by the first bytes, and the hash of all of them.

use isotherm_recording::Progress;
use isotherm_recording::columns::MCAP_MAGIC;
use isotherm_shared::content::{PARQUET_MAGIC, READ_PARQUET};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::source::DataSource;
use sha2::{Digest as _, Sha256};
use std::cell::RefCell;
use std::io::{self, Cursor, Read};
use std::rc::Rc;

/// The hash of the bytes of all pieces.
pub(super) type SharedHash = Rc<RefCell<Sha256>>;

/// An open file, by format.
pub(super) enum SourceContent {
    Csv(Box<dyn Read>),
    Mcap(Box<dyn Read>),
}

/// Opens a source and detects its format by the first bytes.
pub(super) fn open_source(
    of: &DataSource,
    bar: &Progress,
    hash: Option<&SharedHash>,
) -> Result<SourceContent, Failure> {
    let path = of.name();
    let io = |error: &io::Error| Failure::io("opening", path, error);
    let mut source = of.open().map_err(|error| io(&error))?;
    let mut magic = Vec::new();
    (&mut source).take(MCAP_MAGIC.len() as u64).read_to_end(&mut magic).map_err(|error| io(&error))?;
    if magic.is_empty() {
        return Err(Failure::new(Exit::Data, format!("{}: the file is empty", shown(path))).at(path, None));
    }
    if magic.starts_with(PARQUET_MAGIC) {
        return Err(Failure::new(Exit::Data, format!("{}: {READ_PARQUET}", shown(path))).at(path, None));
    }
    let is_mcap = magic == MCAP_MAGIC;
    let source = Box::new(bar.wrap(Cursor::new(magic).chain(source)));
    let source: Box<dyn Read> = match hash {
        Some(hash) => Box::new(HashingReader { source, hash: Rc::clone(hash) }),
        None => source,
    };
    Ok(if is_mcap { SourceContent::Mcap(source) } else { SourceContent::Csv(source) })
}

/// Hashes the bytes of a source as they are read. The rest of the source is hashed when this is dropped.
struct HashingReader {
    source: Box<dyn Read>,
    hash: SharedHash,
}

impl Read for HashingReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        self.hash.borrow_mut().update(&buffer[..read]);
        Ok(read)
    }
}

impl Drop for HashingReader {
    fn drop(&mut self) {
        let mut rest = [0; 1 << 13];
        while self.read(&mut rest).is_ok_and(|read| read > 0) {}
    }
}
