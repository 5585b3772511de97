//! The messages of a damaged MCAP file that are in whole chunks.
//!
//! A chunk is whole if its records match its CRC. Behind damage the next chunk is sought byte by byte. Schemas and
//! channels are in the chunks before the first message, and again in the summary of a file that was ended.

use super::account::{Account, Fate, Keys};
use super::chunks::{ChunkScan, ScanEvent};
use super::report::{RecordingFormat, RepairError, RepairReport, RowTime};
use crate::protobuf::{self, FieldNumber, FieldValue, with_varint};
use crate::read::random::RandomAccess;
use crate::write::mcap_options;
use isotherm_recording::columns::{RAW, SEQUENCE, SESSION, TIMESTAMP_NS};
use mcap::records::{Channel, MessageHeader, Record};
use mcap::write::NoSeek;
use std::collections::HashMap;
use std::io::{self, Write};

pub(super) fn repair(file: &RandomAccess, sink: &mut dyn Write) -> Result<RepairReport, RepairError> {
    let mut scan = ChunkScan::new(file).map_err(RepairError::Read)?;
    let mut descriptions = Descriptions::default();
    // A file that was ended has them again in its summary, with the number of messages.
    let mut counts = Vec::new();
    for record in scan.summary().map_err(RepairError::Read)? {
        descriptions.take(&record);
        if let Record::Statistics(statistics) = record {
            counts.extend(statistics.channel_message_counts);
        }
    }
    let profile = scan.profile().to_owned();
    let writer = mcap_options().profile(profile).create(NoSeek::new(sink)).map_err(unwritten)?;
    let mut repair = McapRepair { writer, descriptions, account: Account::default(), channels: HashMap::new() };
    let (mut metadata, mut has_checks) = (Vec::new(), true);
    while let Some(found) = scan.next().map_err(RepairError::Read)? {
        match found {
            ScanEvent::Records { records, is_checked, at } => {
                has_checks &= is_checked;
                let records = records.into_iter().map(|record| repair.take(record, at));
                records.collect::<Result<(), _>>()?;
                // A chunk of the new file has the messages of one of the old.
                repair.writer.flush().map_err(unwritten)?;
            }
            ScanEvent::Metadata(record) => metadata.push(record),
            ScanEvent::Damage { at, cause, has_rows } => {
                repair.account.hole("byte", at, cause, if has_rows { None } else { Some(0) });
            }
        }
    }
    let mut notes = Vec::new();
    if repair.account.is_whole() {
        metadata.iter().try_for_each(|record| repair.writer.write_metadata(record)).map_err(unwritten)?;
    } else if !metadata.is_empty() {
        notes.push("metadata records, as those that name tables, have no checks, and are left out".to_owned());
    }
    for (channel, count) in counts {
        if let Some(known) = repair.channel(channel)? {
            repair.account.expect(known.stream, count);
        }
    }
    repair.writer.finish().map_err(unwritten)?;
    Ok(repair.account.end(RecordingFormat::Mcap, has_checks, notes))
}

fn unwritten(error: mcap::McapError) -> RepairError {
    match error {
        mcap::McapError::Io(error) => RepairError::Write(error),
        error => RepairError::Write(io::Error::other(error)),
    }
}

/// Schemas and channels by their numbers.
#[derive(Default)]
struct Descriptions {
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    channels: HashMap<u16, Channel>,
}

impl Descriptions {
    fn take(&mut self, record: &Record<'_>) {
        match record {
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header.name.clone(), header.encoding.clone(), data.to_vec()));
            }
            Record::Channel(channel) => drop(self.channels.insert(channel.id, channel.clone())),
            _ => {}
        }
    }
}

struct McapRepair<W: Write> {
    writer: mcap::Writer<NoSeek<W>>,
    descriptions: Descriptions,
    account: Account,
    /// The channels that are written, by their numbers in the source.
    channels: HashMap<u16, WrittenChannel>,
}

#[derive(Clone, Copy)]
struct WrittenChannel {
    number: u16,
    stream: usize,
    /// The fields of session, sequence and time, of the recorder's messages.
    fields: Option<[FieldNumber; 3]>,
}

impl<W: Write> McapRepair<W> {
    fn take(&mut self, record: Record<'static>, at: u64) -> Result<(), RepairError> {
        self.descriptions.take(&record);
        let Record::Message { header, data } = record else { return Ok(()) };
        let Some(channel) = self.channel(header.channel_id)? else {
            let cause = format!("messages of channel {}, which nothing describes", header.channel_id);
            self.account.hole("byte", at, cause, None);
            return Ok(());
        };
        let row = match channel.fields {
            Some(fields) => row_of(&data, fields),
            None => Some(RowTime { session: 0, sequence: header.sequence.into(), timestamp_ns: header.publish_time }),
        };
        let Some(row) = row else {
            self.account.hole("byte", at, "a message that is not valid protobuf", None);
            return Ok(());
        };
        match (self.account.take(channel.stream, row), channel.fields) {
            (Fate::Taken, _) => self.write(channel, header, &data),
            (Fate::TakenIn(session), Some([field, ..])) => {
                let data = with_varint(&data, field.number, session);
                self.write(channel, header, &data)
            }
            (Fate::Repeated, _) => Ok(()),
            (Fate::OutOfOrder | Fate::TakenIn(_), _) => {
                self.account.hole("byte", at, format!("sequence {} does not rise", row.sequence), None);
                Ok(())
            }
        }
    }

    fn write(&mut self, channel: WrittenChannel, header: MessageHeader, data: &[u8]) -> Result<(), RepairError> {
        let header = MessageHeader { channel_id: channel.number, ..header };
        self.writer.write_to_known_channel(&header, data).map_err(unwritten)
    }

    /// The channel of the new file for one of the source; `None` if nothing describes it.
    fn channel(&mut self, number: u16) -> Result<Option<WrittenChannel>, RepairError> {
        if let Some(known) = self.channels.get(&number) {
            return Ok(Some(*known));
        }
        let Some(channel) = self.descriptions.channels.get(&number) else { return Ok(None) };
        let schema = self.descriptions.schemas.get(&channel.schema_id);
        let written = match schema {
            Some((name, encoding, data)) => self.writer.add_schema(name, encoding, data).map_err(unwritten)?,
            None if channel.schema_id == 0 => 0,
            None => return Ok(None),
        };
        let topic = &channel.topic;
        let added = self.writer.add_channel(written, topic, &channel.message_encoding, &channel.metadata);
        let added = added.map_err(unwritten)?;
        let fields = schema.filter(|_| channel.message_encoding == "protobuf").and_then(|(name, _, data)| {
            let fields = protobuf::fields(data, name)?;
            let field = |index: usize| fields.get(RAW[index].name).copied();
            Some([field(SESSION)?, field(SEQUENCE)?, field(TIMESTAMP_NS)?])
        });
        let parts = topic.strip_prefix("isotherm/").and_then(|topic| topic.rsplit_once('/'));
        let (name, keys) = match (parts, fields) {
            (Some((imu, "raw")), Some(_)) => (format!("{imu} raw"), Keys::Rising),
            (Some((imu, stream)), Some(_)) => (format!("{imu} {stream}"), Keys::Unordered),
            _ => (topic.clone(), Keys::Absent),
        };
        let fields = fields.filter(|_| keys != Keys::Absent);
        let known = WrittenChannel { number: added, stream: self.account.stream(&name, keys), fields };
        self.channels.insert(number, known);
        Ok(Some(known))
    }
}

fn row_of(message: &[u8], fields: [FieldNumber; 3]) -> Option<RowTime> {
    // A field that is not there is 0.
    let mut values = [0; 3];
    let is_valid = protobuf::decode(message, |number, value| {
        let field = fields.iter().position(|field| field.number == number);
        if let (Some(field), FieldValue::Varint(value)) = (field, value) {
            values[field] = value;
        }
    });
    let [session, sequence, timestamp_ns] = values;
    is_valid.then_some(RowTime { session, sequence, timestamp_ns })
}
