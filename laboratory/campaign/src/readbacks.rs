//! What chamber, table and the IMU's telemetry said, beside the samples: readbacks.csv.

use isotherm_failure::Failure;
use isotherm_instruments::{ChamberReading, TurntableReading};
use isotherm_shared::wire::AXES;
use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Its file in the campaign's folder.
pub const READBACKS: &str = "readbacks.csv";
const HEADER: &str = "unix_s,laboratory_s,phase,chamber_air_c,chamber_set_point_c,chamber_running,outer_deg,inner_deg,\
                      outer_deg_s,inner_deg_s,a1_head,a1_board,a2_head,a2_board,a3_head,a3_board\n";

/// The open file.
pub struct Readbacks {
    file: File,
    path: PathBuf,
}

impl Readbacks {
    /// Opens it, or begins it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn open(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join(READBACKS);
        let open = || {
            let mut file = OpenOptions::new().read(true).append(true).create(true).open(&path)?;
            let mut rows = Vec::new();
            file.read_to_end(&mut rows)?;
            match rows.iter().rposition(|&byte| byte == b'\n') {
                // A row that was cut off goes.
                Some(last) => file.set_len(last as u64 + 1)?,
                None => {
                    file.set_len(0)?;
                    file.write_all(HEADER.as_bytes())?;
                }
            }
            Ok(file)
        };
        let file = open().map_err(|error: io::Error| Failure::io("opening", &path, &error))?;
        Ok(Self { file, path })
    }

    /// Adds a row; `telemetry` is head and board of each accelerometer, NaN before the first sample.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(
        &mut self,
        chamber: &ChamberReading,
        table: &TurntableReading,
        telemetry: [[f64; 2]; AXES],
        phase: &str,
        now: f64,
    ) -> Result<(), Failure> {
        let ([outer, inner], [outer_rate, inner_rate]) = (table.angles_deg, table.rates_deg_s);
        let row = format!(
            "{:.3},{now:.3},{phase},{:?},{:?},{},{outer:?},{inner:?},{outer_rate:?},{inner_rate:?}",
            isotherm_client::unix_s(),
            chamber.air_c,
            chamber.set_point_c,
            chamber.running
        );
        let row = telemetry.iter().flatten().fold(row, |row, value| format!("{row},{value:?}")) + "\n";
        self.file.write_all(row.as_bytes()).map_err(|error| Failure::io("writing", &self.path, &error))
    }
}
