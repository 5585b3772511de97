//! `convert`: makes a recording of foreign data.

use super::common::{Acceptance, ForeignArgs};
use super::part::PartArgs;
use crate::progress::bytes_bar;
use clap::Args;
use indicatif::ProgressBar;
use isotherm_campaign::{LENGTH_ROWS, length_at_rest};
use isotherm_client::ImuId;
use isotherm_failure::{Exit, Failure, shown, tell};
use isotherm_files::{Output, StagedText, Trust, check_written, load_table, refuse_overlap};
use isotherm_finding::Finding;
use isotherm_job::{INSTANCE, Vehicle, VehicleImu};
use isotherm_recording::RawCsvWriter;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::convert::{Conversion, Scale};
use isotherm_recording_formats::read::ConversionPart;
use isotherm_recording_formats::write::ParquetStream;
use isotherm_shared::stream::StreamKind;
use isotherm_shared::table::{CoefficientTable, nominal_table};
use isotherm_shared::wire::{RawSample, StreamSample};
use std::io;
use std::path::{Path, PathBuf};

/// Make a recording of data from other programs: text, NovAtel logs, ROS messages, logs of autopilots
///
/// A text (CSV, with any separator) needs a mapping file, which says what its columns are; without one, the mapping
/// that would be is printed. NovAtel RAWIMU, RAWIMUX, RAWIMUS and RAWIMUSX in ASCII, sensor_msgs/msg/Imu in MCAP, ULog
/// of PX4, and DataFlash of ArduPilot (.bin, or .log as text) need none.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm convert logger.csv --mapping logger.toml -o run.csv\n  isotherm convert span.log --temperature 31.5 -o run.parquet\n  isotherm convert drive.mcap --topic /imu/data_raw -o run.csv\n  isotherm convert flight.ulg --instance 0 -o run.csv\n  isotherm convert flight.BIN -o 'run-{instance}.csv'\n  isotherm convert cold.csv warm.csv --mapping logger.toml -o runs/\n  isotherm convert mems.csv --mapping mems.toml -o run.csv --nominal imu-b.toml --imu imu-b"
)]
pub(crate) struct Convert {
    /// The foreign data; - is stdin, for text. Several files are sessions, each converted into a file of its own
    #[arg(value_name = "INPUT", required = true)]
    input: Vec<PathBuf>,
    /// Where the raw samples go: .csv or .parquet; - is stdout (CSV). Of several files the folder; with {instance} in
    /// the name, all IMUs of a log go to a file each
    #[arg(short, long, value_name = "REC")]
    output: PathBuf,
    /// Number of the session, which the samples then have in a column; of several files that of the first. Where the
    /// clock of a file starts again, the next one follows [default: none, and 1 for several files and such clocks]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    session: Option<u64>,
    /// Table of the IMU, by which the length of the specific force at rest is compared with gravity
    #[arg(long, value_name = "TABLE")]
    table: Option<PathBuf>,
    /// Where the nominal table of readings goes: scale factors by the resolution and the nominal interval, and nothing
    /// else
    ///
    /// With it the readings come back in m/s2 and rad/s, before any calibration. 1 g0 is 9.80665 m/s2
    #[arg(long, value_name = "TABLE.toml")]
    nominal: Option<PathBuf>,
    /// Unit of the telemetry in that table; a label [default: degC]
    #[arg(long, value_name = "UNIT", requires = "nominal")]
    temperature_unit: Option<String>,
    /// Name of the IMU, which a Parquet file and the nominal table have
    #[arg(long, value_name = "ID", default_value = "imu")]
    imu: ImuId,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    acceptance: Acceptance,
    #[command(flatten)]
    foreign: ForeignArgs,
}

/// A nominal table, and what it was made of.
type NominalTable = (Scale, CoefficientTable);

/// The rows of an input, all written.
struct Written {
    rows: ConversionPart,
    writer: Writer,
    /// The first ones.
    begin: Vec<RawSample>,
    last_session: u64,
}

enum Writer {
    Csv(Box<RawCsvWriter<Output>>),
    Parquet(Box<ParquetStream<Output>>),
}

impl Convert {
    pub(crate) fn run(self) -> Result<(), Failure> {
        if self.output.to_string_lossy().contains(INSTANCE) { self.convert_each() } else { self.convert_all() }
    }

    /// Converts each IMU of a log into a file of its own.
    fn convert_each(&self) -> Result<(), Failure> {
        let usage = |message: String| Err(Failure::new(Exit::Usage, message));
        let vehicle = Vehicle::of(&self.imu, &self.input, &self.foreign.read()?, &bytes_bar)?;
        let name = shown(&self.input[0]);
        if self.input.len() > 1 || vehicle.imus.iter().any(|imu| imu.instance.is_none()) {
            return usage(format!("{name}: {INSTANCE} in -o is for one log of an autopilot; give another name"));
        }
        if let Some(nominal) = self.nominal.as_deref().filter(|path| !VehicleImu::tells_apart(path)) {
            let nominal = shown(nominal);
            return usage(format!("--nominal {nominal}: each IMU has a table of its own; put {INSTANCE} in the name"));
        }
        for imu in &vehicle.imus {
            let one = Self {
                output: imu.path(&self.output),
                nominal: self.nominal.as_deref().map(|path| imu.path(path)),
                imu: imu.imu.clone(),
                foreign: ForeignArgs { instance: imu.instance, ..self.foreign.clone() },
                ..self.clone()
            };
            one.convert_all()?;
        }
        Ok(())
    }

    fn convert_all(&self) -> Result<(), Failure> {
        let outputs = self.outputs()?;
        let mut inputs: Vec<_> = self.input.iter().map(|input| (input.as_path(), "the data")).collect();
        inputs.extend(self.foreign.inputs());
        inputs.extend(self.table.iter().map(|table| (table.as_path(), "the table")));
        let all = outputs.iter().chain(&self.nominal).map(|output| Some(output.as_path())).collect::<Vec<_>>();
        refuse_overlap(&inputs, &all)?;
        let table = self.table.as_ref().map(|path| load_table(path, None, Trust::Any));
        let table = table.transpose()?.map(|(table, _)| table);
        let mut session = self.session.unwrap_or(u64::from(self.input.len() > 1));
        // Created first: what cannot be written is said before anything is converted.
        let staged = self.nominal.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let mut nominal = None;
        for (input, output) in self.input.iter().zip(&outputs) {
            session = self.convert(input, output, session, table.as_ref(), &mut nominal)? + 1;
        }
        match (staged, nominal) {
            (Some(staged), Some((_, table))) => staged.write(&table.to_toml())?.finish(),
            _ => Ok(()),
        }
    }

    /// The nominal table of what was converted, joined with that of the inputs `before`.
    fn nominal(
        &self,
        input: &Path,
        conversion: &Conversion,
        before: Option<&NominalTable>,
    ) -> Result<NominalTable, Failure> {
        let refused = |why: &str| {
            let message = format!("{}: no nominal table: {why}", shown(input));
            Failure::new(Exit::Data, message).at(input, None)
        };
        let own = conversion.scale().map_err(|why| refused(&why))?;
        let scale = match before {
            Some((before, _)) => before.with(&own),
            None => Ok(own),
        };
        let scale =
            scale.map_err(|what| refused(&format!("{what} is not that of the files before; convert it alone")))?;
        let mut nominal = scale.nominal(&self.imu);
        if let Some(unit) = &self.temperature_unit {
            nominal.temperature_unit.clone_from(unit);
        }
        let table = nominal_table(&nominal).map_err(|refusals| refused(&refusals.to_string()))?;
        Ok((scale, table))
    }

    /// The output of each input: the one that is named, or of several a file of the same name in that folder.
    fn outputs(&self) -> Result<Vec<PathBuf>, Failure> {
        let usage = |message: String| Err(Failure::new(Exit::Usage, message));
        if let [_] = self.input[..] {
            return Ok(vec![self.output.clone()]);
        }
        let folder = shown(&self.output);
        if !self.output.is_dir() {
            return usage(format!("{folder}: several files are converted into a folder; make it, and name it with -o"));
        }
        let mut outputs: Vec<PathBuf> = Vec::new();
        for input in &self.input {
            let Some(stem) = input.file_stem().filter(|_| input != Path::new("-")) else {
                return usage(format!("{}: of several inputs each is a file", shown(input)));
            };
            let output = self.output.join(stem).with_extension("csv");
            if outputs.contains(&output) {
                return usage(format!("two inputs would be {}; rename one", shown(&output)));
            }
            outputs.push(output);
        }
        Ok(outputs)
    }

    /// Converts an input; returns the last session of its rows.
    fn convert(
        &self,
        input: &Path,
        output: &Path,
        session: u64,
        table: Option<&CoefficientTable>,
        nominal: &mut Option<NominalTable>,
    ) -> Result<u64, Failure> {
        let extension = output.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let parquet = match extension.as_deref() {
            Some("parquet") => true,
            Some("mcap") => {
                let message = format!("{}: converted samples go to .csv or .parquet", shown(output));
                return Err(Failure::new(Exit::Usage, message));
            }
            _ => false,
        };
        let progress = bytes_bar(&[input.to_owned()], "reading");
        let written = match self.write(input, output, session, parquet, &progress)? {
            Some(written) => Some(written),
            // The header of a file without sessions is written already: it begins again with a column of them.
            None => self.write(input, output, 1, parquet, &progress)?,
        };
        progress.finish_and_clear();
        let Some(Written { rows, writer, begin, last_session }) = written else { return Ok(session) };
        let path = Some(output);
        let (conversion, notes) = (rows.conversion(), rows.notes());
        if self.nominal.is_some() {
            *nominal = Some(self.nominal(input, conversion, nominal.as_ref())?);
        }
        let table = table.or(nominal.as_ref().map(|(_, table)| table));
        let at_rest = table.and_then(|table| length_at_rest(table, &begin)).map(Finding::warned);
        let findings = conversion.findings().into_iter().chain(at_rest).collect();
        for note in notes {
            tell("isotherm", note);
        }
        let name = if self.input.len() > 1 { shown(input).to_string() } else { String::new() };
        // Before the file is put in place: what is refused leaves none.
        self.acceptance.admit(&name, findings).map_err(|refused| refused.failure)?;
        check_written(path, writer.finish())?;
        let to = if output == Path::new("-") { "stdout".into() } else { shown(output).to_string() };
        tell("isotherm", format_args!("{} rows in {to}", conversion.rows()));
        Ok(last_session)
    }
}

impl Convert {
    /// Writes the rows of an input; `None` if their clock starts again, and `session` is 0: they need sessions.
    fn write(
        &self,
        input: &Path,
        output: &Path,
        session: u64,
        parquet: bool,
        progress: &ProgressBar,
    ) -> Result<Option<Written>, Failure> {
        let mut foreign = self.foreign.read()?;
        (foreign.settings.session, foreign.settings.progress) = (session, Some(progress.clone()));
        let conversion = Conversion::of_file(input, foreign.named(), &foreign.settings)?;
        let layout = conversion.layout();
        let mut rows = self.part.get()?.of_conversion(conversion);
        let path = Some(output);
        let writer = Output::create(path).and_then(|sink| {
            if parquet {
                let stream = ParquetStream::new(sink, &self.imu, StreamKind::Raw, layout)?;
                return Ok(Writer::Parquet(Box::new(stream)));
            }
            let writer = match session {
                0 => RawCsvWriter::with_layout(sink, "", false, layout)?,
                _ => RawCsvWriter::of_sessions(sink, layout)?,
            };
            Ok(Writer::Csv(Box::new(writer.with_plain_whole_numbers())))
        });
        let mut writer = match writer {
            Ok(writer) => writer,
            Err(error) => return check_written(path, Err(error)).map(|()| None),
        };
        let (mut begin, mut last_session) = (Vec::new(), session);
        for sample in &mut rows {
            let sample = sample?;
            if session == 0 && sample.session > 0 {
                if [input, output].contains(&Path::new("-")) {
                    let message = "the clock starts again, so the rows need a session, but the header is written \
                                   already; give --session 1";
                    return Err(Failure::new(Exit::Data, format!("{}: {message}", shown(input))));
                }
                return Ok(None);
            }
            last_session = sample.session;
            if begin.len() < LENGTH_ROWS {
                begin.push(sample);
            }
            if let Err(error) = writer.write(&sample) {
                return check_written(path, Err(error)).map(|()| None);
            }
        }
        Ok(Some(Written { rows, writer, begin, last_session }))
    }
}

impl Writer {
    fn write(&mut self, sample: &RawSample) -> io::Result<()> {
        match self {
            Self::Csv(writer) => writer.write("", sample),
            Self::Parquet(writer) => {
                writer.write(&RecordedRow { imu: 0, recorded_ns: 0, sample: StreamSample::Raw(*sample) })
            }
        }
    }

    fn finish(self) -> io::Result<()> {
        match self {
            Self::Csv(writer) => writer.finish(),
            Self::Parquet(writer) => writer.finish(),
        }
        .and_then(Output::finish)
    }
}
