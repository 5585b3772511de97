//! Raw samples out of an MCAP file, read from its beginning to its end: a file that was not finished is read as far as it goes.

use super::Pick;
use super::contained::contained;
use crate::record::columns::{Kind, RAW, Stream, set};
use crate::record::protobuf::{self, Field};
use isotherm_client::{ImuId, RawSample};
use isotherm_shared::recording::{RecordingError, Rising};
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, parse_record};
use std::collections::{BTreeSet, HashMap};
use std::io::Read;

/// Longest record and chunk that is read. Writers' chunks have about 1 MB.
const LONGEST: usize = 64 << 20;
/// Read at once, at most.
const BUFFER: usize = 1 << 20;

/// An iterator over the samples of one IMU that ends at the first error.
pub struct McapSamples {
    source: Box<dyn Read>,
    reader: LinearReader,
    /// Whether one IMU is asked for, and which, or which is preferred among several.
    only: bool,
    wanted: ImuId,
    /// Schemas of raw samples.
    schemas: BTreeSet<u16>,
    /// Channels of raw samples, with their IMUs.
    channels: HashMap<u16, ImuId>,
    /// Whether one has been found since the last message.
    new_channel: bool,
    /// The IMU whose samples have been handed out.
    picked: Option<ImuId>,
    rising: Rising,
    bytes: u64,
    messages: u64,
    finished: bool,
    cut: bool,
}

/// What a record means to us.
enum Step {
    Sample(Box<RawSample>),
    Read(usize),
    Nothing,
    End,
}

impl McapSamples {
    pub fn new(source: Box<dyn Read>, pick: Pick<'_>) -> Self {
        // A chunk's checksum is known to be right before anything of it is used.
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LONGEST);
        let (only, wanted) = match pick {
            Pick::Only(imu) => (true, imu.clone()),
            Pick::Rather(imu) => (false, imu.clone()),
        };
        Self {
            source,
            reader: LinearReader::new_with_options(options),
            only,
            wanted,
            schemas: BTreeSet::new(),
            channels: HashMap::new(),
            new_channel: false,
            picked: None,
            rising: Rising::default(),
            bytes: 0,
            messages: 0,
            finished: false,
            cut: false,
        }
    }

    /// What is to be said about the end of the file, if there is something.
    pub fn cut(&self) -> Option<String> {
        let what = match (self.cut, self.finished) {
            (true, _) => "its last record is cut and left out",
            (false, false) => "it has no end record",
            _ => return None,
        };
        Some(format!("the recording was not ended properly: {what}; everything before has been read"))
    }

    pub fn read(&mut self) -> Result<Option<RawSample>, RecordingError> {
        loop {
            match self.step()? {
                Step::Sample(sample) => {
                    self.rising.check(&sample).map_err(|message| self.error(message))?;
                    return Ok(Some(*sample));
                }
                Step::Read(need) => {
                    let read = self.source.read(self.reader.insert(need.clamp(1, BUFFER)))?;
                    self.bytes += read as u64;
                    self.reader.notify_read(read);
                }
                Step::Nothing => {}
                Step::End if self.picked.is_none() && !self.channels.values().any(|imu| self.takes(imu)) => {
                    return Err(self.error(self.nothing_to_read()));
                }
                Step::End => return Ok(None),
            }
        }
    }

    fn step(&mut self) -> Result<Step, RecordingError> {
        let event = contained(|| {
            Some(match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(need)) => Ok(Event::Read(need)),
                Ok(LinearReadEvent::Record { opcode: op::FOOTER, .. }) => Ok(Event::Footer),
                Ok(LinearReadEvent::Record { opcode: opcode @ (op::SCHEMA | op::CHANNEL | op::MESSAGE), data }) => {
                    parse_record(opcode, data).map(|record| Event::Record(record.into_owned()))
                }
                Ok(LinearReadEvent::Record { .. }) => Ok(Event::Other),
                Err(error) => Err(error),
            })
        });
        let event = event.ok_or_else(|| self.error("a record that cannot be read".to_owned()))?;
        match event {
            None => Ok(Step::End),
            Some(Ok(Event::Read(need))) => Ok(Step::Read(need)),
            Some(Ok(Event::Footer)) => {
                self.finished = true;
                Ok(Step::Nothing)
            }
            Some(Ok(Event::Other)) => Ok(Step::Nothing),
            Some(Ok(Event::Record(record))) => self.record(record),
            // A file that ends in the middle of something.
            Some(Err(McapError::UnexpectedEof)) => {
                self.cut = true;
                Ok(Step::End)
            }
            Some(Err(error)) => Err(self.error(format!("not a valid MCAP file: {error}"))),
        }
    }

    fn record(&mut self, record: Record<'static>) -> Result<Step, RecordingError> {
        match record {
            Record::Schema { header, .. }
                if header.name == protobuf::message(Stream::Raw) && header.encoding == "protobuf" =>
            {
                self.schemas.insert(header.id);
            }
            Record::Channel(channel) => {
                let imu = channel.topic.trim_start_matches('/').strip_prefix("isotherm/");
                let imu = imu.and_then(|topic| topic.strip_suffix("/raw")).and_then(ImuId::new);
                if let Some(imu) = imu
                    && self.schemas.contains(&channel.schema_id)
                    && channel.message_encoding == "protobuf"
                {
                    self.channels.insert(channel.id, imu);
                    self.new_channel = true;
                }
            }
            Record::Message { header, data } => {
                self.messages += 1;
                if std::mem::take(&mut self.new_channel) {
                    self.check_pick()?;
                }
                if let Some(imu) = self.channels.get(&header.channel_id)
                    && self.takes(imu)
                {
                    self.picked = Some(imu.clone());
                    let sample = decode(&data).map_err(|message| self.error(message))?;
                    return Ok(Step::Sample(Box::new(sample)));
                }
            }
            _ => {}
        }
        Ok(Step::Nothing)
    }

    /// Whether this IMU's samples are the ones to hand out, as far as is known by now.
    fn takes(&self, imu: &ImuId) -> bool {
        *imu == self.wanted || (!self.only && self.channels.values().all(|other| other == imu))
    }

    /// With several IMUs and none asked for it must be clear whose samples are meant.
    fn check_pick(&self) -> Result<(), RecordingError> {
        let imus: BTreeSet<_> = self.channels.values().collect();
        let changed = self.picked.as_ref().is_some_and(|picked| *picked != self.wanted);
        if self.only || imus.len() < 2 || (imus.contains(&self.wanted) && !changed) {
            return Ok(());
        }
        Err(self.error(format!("raw samples of several IMUs: {}; choose one with --imu", names(&imus))))
    }

    fn nothing_to_read(&self) -> String {
        let imus: BTreeSet<_> = self.channels.values().collect();
        match imus.len() {
            0 => "no raw samples (a channel isotherm/<imu>/raw with messages isotherm.RawSample)".to_owned(),
            _ => format!("no raw samples of {}, but of {}; choose with --imu", self.wanted, names(&imus)),
        }
    }

    fn error(&self, message: String) -> RecordingError {
        let place = format!("byte {}, message {}", self.bytes, self.messages);
        RecordingError::Place { place, message }
    }
}

enum Event {
    Read(usize),
    Record(Record<'static>),
    Footer,
    Other,
}

fn names(imus: &BTreeSet<&ImuId>) -> String {
    imus.iter().map(|imu| imu.as_str()).collect::<Vec<_>>().join(", ")
}

fn decode(message: &[u8]) -> Result<RawSample, String> {
    let mut sample = RawSample::default();
    let mut wrong = None;
    let whole = protobuf::decode(message, |number, value| {
        let Some(place) = usize::try_from(number).ok().and_then(|number| number.checked_sub(1)) else { return };
        let Some(column) = RAW.get(place) else { return };
        match (column.kind, value) {
            (Kind::U64, Field::Varint(bits)) | (Kind::F64, Field::Fixed64(bits)) => set(&mut sample, place, bits),
            (Kind::U32, Field::Varint(bits)) if u32::try_from(bits).is_ok() => set(&mut sample, place, bits),
            _ => wrong = Some(column.name),
        }
    });
    match wrong {
        None if whole => Ok(sample),
        None => Err("a message that is no protobuf".to_owned()),
        Some(name) => Err(format!("{name} is not of its type, or does not fit into 32 bits")),
    }
}
