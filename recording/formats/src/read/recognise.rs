//! Whether a text is a recording, or data of another program.

use isotherm_recording::INCREMENT_CSV_COLUMNS;
use isotherm_recording::columns::{ColumnSet, RAW};
use std::io::{self, BufRead, Read as _};

/// Most bytes of a line that are looked at.
const MOST: u64 = 1 << 16;
/// Columns of a recording by which a text without mapping is one, though others may be missing.
const FEW: usize = 3;

/// The lines up to the first that is not blank.
pub(super) fn first_line(source: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut lines = Vec::new();
    let mut source = source.take(MOST);
    while source.read_until(b'\n', &mut lines)? > 0 && lines.trim_ascii().is_empty() {}
    Ok(lines)
}

/// Whether a text that begins with this line is a recording. With a mapping it must have all columns that a recording
/// has, since the mapping may be for columns of the same names. Without one three are enough, so that a recording that
/// lacks a column gets a message about it, and one of increments too.
pub(super) fn is_recording(line: &[u8], has_mapping: bool) -> bool {
    let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
    let names: Vec<_> = line.split(|byte| b",;\t \"\r\n".contains(byte)).filter(|name| !name.is_empty()).collect();
    let is_there = |name: &str| names.contains(&name.as_bytes());
    let mut columns = RAW.iter().filter(|column| column.set == ColumnSet::Always).map(|column| column.name);
    if has_mapping {
        return columns.all(is_there);
    }
    let increments = INCREMENT_CSV_COLUMNS.iter().filter(|name| is_there(name)).count();
    names.is_empty() || increments >= FEW || columns.filter(|name| is_there(name)).count() >= FEW
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_that_lacks_a_column_is_one_unless_a_mapping_says_what_the_columns_are() {
        let all: Vec<_> = RAW.iter().filter(|column| column.set == ColumnSet::Always).map(|it| it.name).collect();
        let all = all.join(",");
        for header in [all.clone(), format!("\u{feff}{all}\r\n"), all.replace(',', "\";\""), format!("u,{all},v")] {
            assert!(is_recording(header.as_bytes(), true) && is_recording(header.as_bytes(), false), "{header}");
        }
        let lacking = all.replace("interval_ns,", "");
        assert!(is_recording(lacking.as_bytes(), false) && !is_recording(lacking.as_bytes(), true));
        let increments = "sequence,timestamp_ns,a1_dv,a2_dv,a3_dv,table,flags";
        assert!(is_recording(increments.as_bytes(), false) && !is_recording(increments.as_bytes(), true));
        for header in ["sequence,timestamp_ns,ax,ay,az", "t;x;y;z", "a1_positives,a2_heads,timestamp"] {
            assert!(!is_recording(header.as_bytes(), false) && !is_recording(header.as_bytes(), true), "{header}");
        }
        assert!(is_recording(b"", false) && is_recording(b"\r\n", false));
        let mut text: &[u8] = b"\n \r\nt,x\n1,2\n";
        assert_eq!(first_line(&mut text).unwrap(), b"\n \r\nt,x\n");
        assert_eq!(first_line(&mut &b"t,x"[..]).unwrap(), b"t,x");
    }
}
