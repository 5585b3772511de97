//! `convert`: makes a recording of foreign data.

use super::common::{AcceptanceArgs, ForeignArgs};
use super::part::PartArgs;
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_campaign::{MAGNITUDE_ROWS, magnitude_at_rest};
use isotherm_documents::load_table;
use isotherm_files::{Output, StagedText, Trust, check_written, refuse_overlap, source, sources};
use isotherm_fit::Origin;
use isotherm_pipeline::{INSTANCE, Vehicle, VehicleImu};
use isotherm_recording::{Layout, RawCsvWriter};
use isotherm_recording_formats::convert::{Conversion, Scale};
use isotherm_recording_formats::read::{ImuChoice, Input, Pieces, RowKind};
use isotherm_recording_formats::write::RowWriter;
use isotherm_shared::content::WRITE_PARQUET;
use isotherm_shared::names::ImuId;
use isotherm_shared::names::StreamKind;
use isotherm_shared::table::{CoefficientTable, nominal_table};
use isotherm_shared::wire::{RawSample, StreamSample};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::Finding;
use std::io;
use std::path::{Path, PathBuf};
use tracing::info;

/// Convert third-party data into a recording
///
/// Converts text, NovAtel logs, ROS messages, and logs of autopilots.
///
/// A text (CSV, with any separator) needs a mapping file, which describes its columns, unless their names say all. The
/// mapping that is used, or proposed, is printed. NovAtel RAWIMU, RAWIMUX, RAWIMUS and RAWIMUSX in ASCII,
/// sensor_msgs/msg/Imu in MCAP, ULog of PX4, and DataFlash of ArduPilot (.bin, or .log as text) need none.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm convert logger.csv --mapping logger.toml -o run.csv\n  isotherm convert span.log --temperature 31.5 -o run.mcap\n  isotherm convert drive.mcap --topic /imu/data_raw -o run.csv\n  isotherm convert flight.ulg --instance 0 -o run.csv\n  isotherm convert flight.BIN -o 'run-{instance}.csv'\n  isotherm convert cold.csv warm.csv --mapping logger.toml -o runs/\n  isotherm convert mems.csv --mapping mems.toml -o run.csv --nominal imu-b.toml --imu imu-b"
)]
pub struct Convert {
    /// Read these third-party data
    ///
    /// For text, - is stdin. The folder of a ROS bag stands for its files. Several files are either separate
    /// recordings, each converted into its own file, or pieces of one recording, which are joined in one file.
    #[arg(value_name = "INPUT", required = true)]
    input: Vec<PathBuf>,
    /// Write the raw samples to this file
    ///
    /// The name ends with .csv or .mcap; - is stdout (CSV). For several recordings it is a folder. If the name
    /// contains {instance}, each IMU of a log is written to its own file.
    #[arg(short, long, value_name = "REC")]
    output: PathBuf,
    /// Set the number of the session
    ///
    /// The samples then have a column with the number of their session. If there are several recordings, it is the
    /// number of the first. A new session begins where the clock of a recording starts again [default: no column; 1 for
    /// several recordings and such clocks]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    session: Option<u64>,
    /// Make the pulses of readings for this table
    ///
    /// Readings become pulses of the nominal interval of this coefficient table, whatever interval the data have. The
    /// magnitude of the specific force at rest is computed with the table, and compared with gravity.
    #[arg(long, value_name = "TABLE")]
    table: Option<PathBuf>,
    /// Write the nominal table of the readings
    ///
    /// A nominal table has only the scale factors that follow from the resolution and the nominal interval.
    ///
    /// It returns the readings in m/s2 and rad/s, before any calibration. 1 g0 is 9.80665 m/s2
    #[arg(long, value_name = "TABLE.toml")]
    nominal: Option<PathBuf>,
    /// Name the temperature's unit in that table
    ///
    /// The unit is a label [default: degC]
    #[arg(long, value_name = "UNIT", requires = "nominal")]
    temperature_unit: Option<String>,
    /// Name the IMU
    ///
    /// An MCAP file and the nominal table contain the name.
    #[arg(long, value_name = "ID", default_value = "imu")]
    imu: ImuId,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    acceptance: AcceptanceArgs,
    #[command(flatten)]
    foreign: ForeignArgs,
}

/// A nominal table, and what it was made of.
type NominalTable = (Scale, CoefficientTable);

impl Convert {
    pub(crate) fn run(mut self) -> Result<(), Failure> {
        self.input = sources(&self.input)?.iter().map(|source| source.name().to_owned()).collect();
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
        let distinct = if self.output.is_dir() { &outputs[..] } else { &outputs[..1] };
        let all = distinct.iter().chain(&self.nominal).map(|output| Some(output.as_path())).collect::<Vec<_>>();
        refuse_overlap(&inputs, &all)?;
        let table = self.table.as_ref().map(|path| load_table(path, None, Trust::Any));
        let table = table.transpose()?.map(|(table, _)| table);
        // Created first: what cannot be written is said before anything is converted.
        let staged = self.nominal.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let mut nominal = None;
        match self.input.as_slice() {
            [input] => self.convert(input, table.as_ref(), &mut nominal)?,
            _ => self.convert_pieces(&outputs, table.as_ref(), &mut nominal)?,
        }
        match (staged, nominal) {
            (Some(staged), Some((_, table))) => staged.write(&table.to_toml())?.finish(),
            _ => Ok(()),
        }
    }

    /// The nominal table of what was converted, joined with that of the inputs `before`.
    fn nominal(&self, input: &Path, own: Scale, before: Option<&NominalTable>) -> Result<NominalTable, Failure> {
        let refused = |why: &str| {
            let message = format!("{}: no nominal table: {why}", shown(input));
            Failure::new(Exit::Data, message).at(input, None)
        };
        let scale = match before {
            Some((before, _)) => before.with(&own),
            None => Ok(own),
        };
        let scale =
            scale.map_err(|what| refused(&format!("{what} is not that of the files before; convert it separately")))?;
        let mut nominal = scale.nominal(&self.imu);
        if let Some(unit) = &self.temperature_unit {
            nominal.temperature_unit.clone_from(unit);
        }
        let table = nominal_table(&nominal).map_err(|refusals| refused(&refusals.to_string()))?;
        Ok((scale, table))
    }

    /// The output of each input: the one that is named, which is that of all pieces of one recording, or of several
    /// inputs a file of the same name in that folder.
    fn outputs(&self) -> Result<Vec<PathBuf>, Failure> {
        let usage = |message: String| Err(Failure::new(Exit::Usage, message));
        if has_extension(&self.output, "parquet") {
            return usage(format!("{}: name it .csv or .mcap; {WRITE_PARQUET}", shown(&self.output)));
        }
        if self.input.len() > 1
            && let Some(pipe) = self.input.iter().find(|input| *input == Path::new("-"))
        {
            return usage(format!("{}: of several inputs each is a file", shown(pipe)));
        }
        if self.input.len() == 1 || !self.output.is_dir() {
            return Ok(vec![self.output.clone(); self.input.len()]);
        }
        let mut outputs: Vec<PathBuf> = Vec::new();
        for input in &self.input {
            let output = self.output.join(input.file_stem().unwrap_or_default()).with_extension("csv");
            if outputs.contains(&output) {
                return usage(format!("two inputs would be {}; rename one", shown(&output)));
            }
            outputs.push(output);
        }
        Ok(outputs)
    }

    /// Converts one input.
    fn convert(
        &self,
        input: &Path,
        table: Option<&CoefficientTable>,
        nominal: &mut Option<NominalTable>,
    ) -> Result<(), Failure> {
        let session = self.session.unwrap_or(0);
        if !self.convert_session(input, session, table, nominal)? {
            // The header of a file without sessions is written already: it begins again with a column of them.
            self.convert_session(input, 1, table, nominal)?;
        }
        Ok(())
    }

    /// The same from this session on. False if the clock starts again, and the session is 0: the rows need sessions.
    fn convert_session(
        &self,
        input: &Path,
        session: u64,
        table: Option<&CoefficientTable>,
        nominal: &mut Option<NominalTable>,
    ) -> Result<bool, Failure> {
        let progress = bytes_bar(&[input.to_owned()], "reading");
        let mut foreign = self.foreign.read_for(table, &Origin::default())?;
        foreign.settings.session = session;
        foreign.settings.progress = progress.clone();
        let conversion = Conversion::open(&source(input), foreign.named(), &foreign.settings)?;
        let output = Some(self.output.as_path());
        let mut file = match RowCounts::create(self, &self.output, conversion.layout(), foreign.settings.session) {
            Ok(file) => file,
            Err(error) => return check_written(output, Err(error)).map(|()| true),
        };
        let mut rows = self.part.get()?.of_conversion(conversion);
        let mut begin = Vec::new();
        for sample in &mut rows {
            let sample = sample?;
            if session == 0 && sample.session > 0 {
                if [input, &self.output].contains(&Path::new("-")) {
                    return Err(needs_session(input));
                }
                return Ok(false);
            }
            if begin.len() < MAGNITUDE_ROWS {
                begin.push(sample);
            }
            if let Err(error) = file.write(&sample) {
                return check_written(output, Err(error)).map(|()| true);
            }
        }
        progress.finish();
        let conversion = rows.conversion();
        if self.nominal.is_some() {
            let scale = conversion.scale().map_err(|why| {
                let message = format!("{}: no nominal table: {why}", shown(input));
                Failure::new(Exit::Data, message).at(input, None)
            })?;
            *nominal = Some(self.nominal(input, scale, None)?);
        }
        let table = table.or(nominal.as_ref().map(|(_, table)| table));
        let in_order = foreign.settings.in_order.then(|| "--in-order has no effect: there is one file".to_owned());
        let notes = rows.notes().into_iter().chain(in_order).collect();
        self.finish(vec![file], notes, conversion.findings(), magnitude_at_rest_of(table, &begin)).map(|()| true)
    }

    /// Converts several inputs: pieces of a recording into one file, or into a file each.
    fn convert_pieces(
        &self,
        outputs: &[PathBuf],
        table: Option<&CoefficientTable>,
        nominal: &mut Option<NominalTable>,
    ) -> Result<(), Failure> {
        let is_folder = self.output.is_dir();
        let first = self.session.unwrap_or(u64::from(is_folder));
        let progress = bytes_bar(&self.input, "reading");
        let input =
            Input::from((ImuChoice::Any, self.foreign.read_for(table, &Origin::default())?)).within(self.part.get()?);
        // Sessions more than recordings, since clocks have started again.
        let mut more = 0;
        let mut left = Some(Pieces::new(&sources(&self.input)?, RowKind::Sample, input)?);
        while let Some(pieces) = left.take() {
            let place = |path: &Path| self.input.iter().position(|input| input == path).unwrap_or(0);
            let name = pieces.paths().next().map(Path::to_owned).unwrap_or_default();
            let session = first + more + if is_folder { place(&name) as u64 } else { 0 };
            let mut rows = pieces.first_recording(&progress)?;
            let (mut written, mut begin, mut last) = (Vec::<RowCounts>::new(), Vec::new(), session);
            let mut piece = PathBuf::new();
            while let Some(row) = rows.next() {
                let row = row.map_err(|error| rows.failure(&error))?;
                let path = rows.places().path(row.line).unwrap_or(&name);
                if piece != path {
                    path.clone_into(&mut piece);
                    let layout = rows.foreign_layout().ok_or_else(|| {
                        let message = format!("{}: a recording needs no conversion; leave it out", shown(path));
                        Failure::new(Exit::Usage, message)
                    })?;
                    let output = &outputs[place(path)];
                    if written.last().is_none_or(|file| file.output != *output) {
                        match RowCounts::create(self, output, layout, session) {
                            Ok(file) => written.push(file),
                            Err(error) => return check_written(Some(output), Err(error)),
                        }
                    }
                }
                // The first one of a recording is 0.
                let sample = RawSample { session: session + row.sample.session, ..row.sample };
                if session == 0 && sample.session > 0 {
                    return Err(needs_session(path));
                }
                last = sample.session;
                if begin.len() < MAGNITUDE_ROWS {
                    begin.push(sample);
                }
                if let Some(file) = written.last_mut()
                    && let Err(error) = file.write(&sample)
                {
                    return check_written(Some(&file.output), Err(error));
                }
            }
            more += last - session;
            left = rows.others();
            if let Some(next) = left.iter().find_map(|pieces| pieces.paths().next()).filter(|_| !is_folder) {
                let [folder, next, name] = [&self.output, next, &name].map(|path| shown(path).to_string());
                return Err(Failure::new(
                    Exit::Usage,
                    format!(
                        "{folder}: several files are converted into a folder; make it, and name it with -o: {next} \
                         does not continue where the recording that begins with {name} ends"
                    ),
                ));
            }
            if self.nominal.is_some() {
                *nominal = Some(self.nominal(&name, rows.scale()?, nominal.as_ref())?);
            }
            let table = table.or(nominal.as_ref().map(|(_, table)| table));
            self.finish(written, rows.notes(), rows.findings(), magnitude_at_rest_of(table, &begin))?;
        }
        progress.finish();
        Ok(())
    }

    /// Prints what was found in a recording, and puts its files in place, unless that is refused.
    fn finish(
        &self,
        written: Vec<RowCounts>,
        notes: Vec<String>,
        findings: Vec<Finding>,
        at_rest: Option<Finding>,
    ) -> Result<(), Failure> {
        for note in notes {
            info!("{note}");
        }
        let findings = findings.into_iter().chain(at_rest).collect();
        self.acceptance.admit("", findings).map_err(|refused| refused.failure)?;
        for RowCounts { output, writer, rows } in written {
            check_written(Some(&output), writer.finish().and_then(Output::finish))?;
            let to = if output == Path::new("-") { "stdout".into() } else { shown(&output).to_string() };
            info!("{rows} rows in {to}");
        }
        Ok(())
    }
}

/// The failure of rows whose clock starts again.
fn needs_session(path: &Path) -> Failure {
    let message =
        "the clock starts again, so the rows need a session, but the header is written already; give --session 1";
    Failure::new(Exit::Data, format!("{}: {message}", shown(path)))
}

/// The specific force at rest in the first rows, if it is far from gravity.
fn magnitude_at_rest_of(table: Option<&CoefficientTable>, begin: &[RawSample]) -> Option<Finding> {
    table.and_then(|table| magnitude_at_rest(table, begin)).map(Finding::warned)
}

/// A file that is being written.
struct RowCounts {
    output: PathBuf,
    writer: RowWriter<Output>,
    rows: u64,
}

impl RowCounts {
    fn create(convert: &Convert, output: &Path, layout: Layout, session: u64) -> io::Result<Self> {
        let sink = Output::create(Some(output))?;
        let writer = if has_extension(output, "mcap") {
            RowWriter::mcap(sink, &convert.imu, StreamKind::Raw, layout)?
        } else {
            let writer = match session {
                0 => RawCsvWriter::with_layout(sink, "", false, layout)?,
                _ => RawCsvWriter::of_sessions(sink, false, layout)?,
            };
            writer.with_plain_whole_numbers().into()
        };
        Ok(Self { output: output.to_owned(), writer, rows: 0 })
    }

    fn write(&mut self, sample: &RawSample) -> io::Result<()> {
        self.rows += 1;
        self.writer.write(StreamSample::Raw(*sample))
    }
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
}
