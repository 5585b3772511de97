use super::{apart, written};
use crate::failure::Failure;
use crate::files::{Guard, Output, load_table};
use crate::samples::{Pick, Samples};
use clap::Args;
use indicatif::ProgressBar;
use isotherm_client::ImuId;
use isotherm_shared::compensate::answer;
use isotherm_shared::recording::IncrementWriter;
use std::path::PathBuf;

/// Compensate a recording offline, with the very arithmetic of the service
///
/// The output equals that of `feed`, byte for byte.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm replay --table imu-a.toml run.csv -o increments.csv\n  zcat run.csv.gz | isotherm replay --table imu-a.toml - | head"
)]
pub struct Replay {
    /// Coefficient table
    #[arg(long, value_name = "TABLE")]
    table: PathBuf,
    /// Whose samples, in a recording of several IMUs [default: the table's IMU's]
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Recording of raw samples (CSV, Parquet, MCAP); - is stdin
    #[arg(value_name = "RAW")]
    recording: PathBuf,
    /// Where the increments go (CSV); - is stdout
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
}

impl Replay {
    pub fn run(self) -> Result<(), Failure> {
        apart(&[(&self.recording, "the recording itself"), (&self.table, "the table")], &[self.output.as_deref()])?;
        let (table, _) = load_table(&self.table, None, Guard::Lax)?;
        let pick = self.imu.as_ref().map_or(Pick::Rather(&table.content().imu), Pick::Only);
        let samples = Samples::open(&self.recording, pick, &ProgressBar::hidden())?;
        let path = self.output.as_deref();
        let sink = Output::create(path);
        let mut writer = match sink.and_then(|sink| IncrementWriter::new(sink, false)) {
            Ok(writer) => writer,
            Err(error) => return written(path, Err(error)),
        };
        for sample in samples {
            let sample = sample?;
            if let Err(error) = writer.write(&answer(Some(&table), &sample)) {
                return written(path, Err(error));
            }
        }
        written(path, writer.finish().and_then(Output::finish))
    }
}
