//! Readings of chamber, turntable and IMU temperature over the whole campaign: `readbacks.csv`, one for each IMU of a
//! batch, and its curves for the live page.

use crate::curves::{CURVES, CurveRow, PlottedCurves};
use crate::plan::{Plan, READBACKS};
use isotherm_instruments::{ChamberReading, TurntableReading};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::Failure;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

const HEADER: &str = "unix_s,laboratory_s,phase,chamber_air_c,chamber_set_point_c,chamber_running,outer_deg,inner_deg,\
                      outer_deg_s,inner_deg_s,a1_head,a1_board,a2_head,a2_board,a3_head,a3_board";
/// More columns if the gyroscopes are calibrated.
const GYROSCOPES: &str = ",g1_head,g1_board,g2_head,g2_board,g3_head,g3_board";
/// Column of a row's time.
const UNIX_S: usize = 0;
/// Columns of the [`CURVES`], in their order.
const PLOTTED: [usize; CURVES] = [3, 4, 10, 12, 14, 11, 13, 15];
/// Length limit of a line that is read \[bytes\]: rows are shorter. A longer line stays in the file and is not plotted.
const MAX_LINE: u64 = 4096;

/// The open file and its curves.
pub(crate) struct Readbacks {
    file: File,
    path: PathBuf,
    curves: PlottedCurves,
    /// Whether the file has columns of the gyroscopes.
    has_gyroscopes: bool,
}

impl Readbacks {
    /// Opens the file for the IMU of `plan` or creates it, and reads the curves of the rows that it has. A new file has
    /// columns of the gyroscopes if they are calibrated.
    ///
    /// # Errors
    /// If it cannot be read or written.
    pub(crate) fn open(plan: &Plan) -> Result<Self, Failure> {
        Self::at(plan.output.join(plan.file(READBACKS, "csv")), !plan.turns.is_empty())
    }

    fn at(path: PathBuf, with_gyroscopes: bool) -> Result<Self, Failure> {
        let opened = open(&path, with_gyroscopes);
        let (file, curves, has_gyroscopes) = opened.map_err(|error| Failure::io("opening", &path, &error))?;
        Ok(Self { file, path, curves, has_gyroscopes })
    }

    /// Appends a row. `temperature` is head and board of each accelerometer, then of each gyroscope, NaN before the
    /// first sample. The times are laboratory time and Unix time \[s\].
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(
        &mut self,
        chamber: &ChamberReading,
        table: &TurntableReading,
        temperature: [[f64; 2]; 2 * AXES],
        phase: &str,
        [now, unix_s]: [f64; 2],
    ) -> Result<(), Failure> {
        let ([outer, inner], [outer_rate, inner_rate]) = (table.angles_deg, table.rates_deg_s);
        let row = format!(
            "{unix_s:.3},{now:.3},{phase},{:?},{:?},{},{outer:?},{inner:?},{outer_rate:?},{inner_rate:?}",
            chamber.air_c, chamber.set_point_c, chamber.running
        );
        let sensors = if self.has_gyroscopes { 2 * AXES } else { AXES };
        let temperature = temperature.iter().take(sensors).flatten();
        let row = temperature.fold(row, |row, value| format!("{row},{value:?}")) + "\n";
        self.file.write_all(row.as_bytes()).map_err(|error| Failure::io("writing", &self.path, &error))?;
        self.curves.add(curve_row(&row));
        Ok(())
    }

    /// The curves of all rows.
    pub(crate) const fn curves(&self) -> &PlottedCurves {
        &self.curves
    }
}

/// The file, the curves of its rows, and whether it has columns of the gyroscopes.
fn open(path: &Path, with_gyroscopes: bool) -> io::Result<(File, PlottedCurves, bool)> {
    let mut file = OpenOptions::new().read(true).append(true).create(true).open(path)?;
    let (mut reader, mut line) = (BufReader::new(&file), Vec::new());
    let (mut curves, mut complete, mut has_gyroscopes) = (PlottedCurves::default(), 0, with_gyroscopes);
    loop {
        line.clear();
        let mut length = (&mut reader).take(MAX_LINE).read_until(b'\n', &mut line)?;
        let too_long = length as u64 == MAX_LINE && !line.ends_with(b"\n");
        let ended = if too_long {
            length += reader.skip_until(b'\n')?;
            ends_with_newline(&file, complete + length as u64)?
        } else {
            line.ends_with(b"\n")
        };
        // Only an incomplete last row is removed, below.
        if !ended {
            break;
        }
        if complete == 0 {
            has_gyroscopes = line.trim_ascii_end().ends_with(GYROSCOPES.as_bytes());
        } else if !too_long {
            curves.add(curve_row(&String::from_utf8_lossy(&line)));
        }
        complete += length as u64;
    }
    file.set_len(complete)?;
    if complete == 0 {
        let more = if with_gyroscopes { GYROSCOPES } else { "" };
        file.write_all(format!("{HEADER}{more}\n").as_bytes())?;
    }
    Ok((file, curves, has_gyroscopes))
}

/// Whether the byte before `end` is a line end.
fn ends_with_newline(file: &File, end: u64) -> io::Result<bool> {
    let mut last = [0];
    file.read_exact_at(&mut last, end - 1)?;
    Ok(last == *b"\n")
}

/// The values of a row that are plotted; NaN where a field is not a number.
fn curve_row(row: &str) -> CurveRow {
    let fields: Vec<_> = row.trim_end().split(',').collect();
    let number = |column: usize| fields.get(column).and_then(|field| field.parse().ok()).unwrap_or(f64::NAN);
    CurveRow { unix_s: number(UNIX_S), values: PLOTTED.map(number) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const FILE: &str = "readbacks.csv";

    #[test]
    fn a_runner_goes_on_with_the_curves_of_the_one_before_and_without_its_cut_row() {
        let folder = tempfile::tempdir().unwrap();
        let chamber = ChamberReading { air_c: -5.0, set_point_c: -10.0, running: true, ..ChamberReading::default() };
        let temperature = [[1.0, 2.0], [3.0, 4.0], [5.0, f64::NAN], [7.0, 8.0], [9.0, 10.0], [11.0, 12.0]];
        let mut first = Readbacks::at(folder.path().join(FILE), false).unwrap();
        first.write(&chamber, &TurntableReading::default(), temperature, "soak", [7.0, 1.8e9]).unwrap();
        drop(first);
        let path = folder.path().join(FILE);
        let whole = fs::read(&path).unwrap();
        fs::write(&path, [&whole[..], b"1.0,2.0,so"].concat()).unwrap();

        let mut second = Readbacks::at(folder.path().join(FILE), false).unwrap();
        assert_eq!(fs::read(&path).unwrap(), whole);
        second.write(&chamber, &TurntableReading::default(), temperature, "dwell", [8.0, 1.8e9]).unwrap();
        let values = |curve: usize| second.curves().all(curve).map(|point| point.1).collect::<Vec<_>>();
        assert_eq!([values(0), values(1)], [[-5.0; 2], [-10.0; 2]]);
        assert_eq!([2, 3, 4, 5, 6].map(|curve| values(curve)[1]), [1.0, 3.0, 5.0, 2.0, 4.0]);
        assert!(values(7)[0].is_nan());
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.starts_with(HEADER) && text.lines().count() == 3, "{text}");
    }

    #[test]
    fn a_file_keeps_the_columns_that_it_was_begun_with() {
        for first in [true, false] {
            let folder = tempfile::tempdir().unwrap();
            for with_gyroscopes in [first, !first] {
                let mut readbacks = Readbacks::at(folder.path().join(FILE), with_gyroscopes).unwrap();
                let (chamber, table) = (ChamberReading::default(), TurntableReading::default());
                readbacks.write(&chamber, &table, [[1.0; 2]; 2 * AXES], "turn", [8.0, 1.8e9]).unwrap();
            }
            let text = fs::read_to_string(folder.path().join(FILE)).unwrap();
            assert_eq!(text.lines().next().unwrap().ends_with(",g3_board"), first);
            let columns: Vec<_> = text.lines().map(|line| line.split(',').count()).collect();
            assert_eq!(columns, [if first { 22 } else { 16 }; 3]);
        }
    }

    #[test]
    fn rows_that_cannot_be_read_stay_in_the_file_and_hide_none_behind_them() {
        let folder = tempfile::tempdir().unwrap();
        let chamber = ChamberReading { air_c: -5.0, ..ChamberReading::default() };
        drop(Readbacks::at(folder.path().join(FILE), false).unwrap());
        let path = folder.path().join(FILE);
        let row = |air_c: f64| format!("1.0,2.0,soak,{air_c},0,true,0,0,0,0,1,1,1,1,1,1\n").into_bytes();
        let long = [vec![b'x'; 3 * MAX_LINE as usize], b"\n".to_vec()].concat();
        let exact = [vec![b'x'; MAX_LINE as usize - 1], b"\n".to_vec()].concat();
        let before = fs::read(&path).unwrap();
        let complete = [before, row(1.0), long, row(2.0), b"\xff,\xfe\n".to_vec(), row(3.0), exact, row(4.0)].concat();
        for incomplete in [&b""[..], b"1.0,2.0,so", &[b'y'; 2 * MAX_LINE as usize], &[b'z'; MAX_LINE as usize]] {
            fs::write(&path, [&complete[..], incomplete].concat()).unwrap();
            let mut readbacks = Readbacks::at(folder.path().join(FILE), false).unwrap();
            assert_eq!(fs::read(&path).unwrap(), complete, "{} bytes too many", incomplete.len());
            readbacks
                .write(&chamber, &TurntableReading::default(), [[1.0; 2]; 2 * AXES], "dwell", [8.0, 1.8e9])
                .unwrap();
            let air: Vec<_> = readbacks.curves().all(0).map(|point| point.1).filter(|air_c| !air_c.is_nan()).collect();
            assert_eq!(air, [1.0, 2.0, 3.0, 4.0, -5.0]);
        }
    }
}
