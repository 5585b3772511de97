//! An MCAP file: chunks that are packed with zstd, with the index of each, and the summary. <https://mcap.dev/spec>

use super::zstd::ChunkCompressor;
use isotherm_recording::columns::MCAP_MAGIC;
use mcap::records::{MessageHeader, op};
use std::collections::BTreeMap;
use std::io;

/// A chunk ends at this length \[bytes\].
const CHUNK: usize = 1 << 20;
/// Length of a check \[bytes\].
const CRC: usize = 4;
const LIBRARY: &str = concat!("isotherm ", env!("CARGO_PKG_VERSION"));
const COMPRESSION: &[u8] = b"zstd";

/// Makes the bytes of an MCAP file. They are complete after each chunk.
#[derive(Default)]
pub(crate) struct McapContainer {
    /// What has not been taken, the length of what has, and the CRC of that.
    bytes: Vec<u8>,
    taken: u64,
    hasher: crc32fast::Hasher,
    chunk: OpenChunk,
    compressor: ChunkCompressor,
    /// The contents of schemas and channels without their numbers, which count from 1.
    schemas: Vec<Vec<u8>>,
    channels: Vec<Vec<u8>>,
    /// Messages of each channel, and the first and the last time of all \[ns\].
    counts: BTreeMap<u16, u64>,
    times: Option<(u64, u64)>,
    /// Records of the summary, and their number.
    chunks: (Vec<u8>, u32),
    metadata: (Vec<u8>, u32),
    is_finished: bool,
}

/// The records of a chunk, and where its messages are.
#[derive(Default)]
struct OpenChunk {
    records: Vec<u8>,
    times: Option<(u64, u64)>,
    /// Time and place of each message of each channel.
    index: BTreeMap<u16, Vec<u8>>,
}

impl McapContainer {
    /// Begins a file with this profile.
    pub(crate) fn new(profile: &str) -> Self {
        let mut container = Self { bytes: MCAP_MAGIC.to_vec(), ..Self::default() };
        record(&mut container.bytes, op::HEADER, &[&sized(profile.as_bytes()), &sized(LIBRARY.as_bytes())]);
        container
    }

    /// Takes what has been written since the last call, without the open chunk.
    pub(crate) fn take(&mut self) -> Vec<u8> {
        self.taken += self.bytes.len() as u64;
        self.hasher.update(&self.bytes);
        std::mem::take(&mut self.bytes)
    }

    /// Adds a schema, unless there is the same. Returns its number.
    ///
    /// # Errors
    /// If there are too many.
    pub(crate) fn add_schema(&mut self, name: &str, encoding: &str, data: &[u8]) -> io::Result<u16> {
        let content = [name.as_bytes(), encoding.as_bytes(), data].map(sized).concat();
        if let Some(known) = self.schemas.iter().position(|known| *known == content) {
            return Ok(known as u16 + 1);
        }
        describe(&mut self.chunk.records, op::SCHEMA, &mut self.schemas, content)
    }

    /// Adds a channel. Returns its number.
    ///
    /// # Errors
    /// If there are too many.
    pub(crate) fn add_channel(
        &mut self,
        schema: u16,
        topic: &str,
        encoding: &str,
        metadata: &BTreeMap<String, String>,
    ) -> io::Result<u16> {
        let texts = [topic, encoding].map(|text| sized(text.as_bytes())).concat();
        let content = [schema.to_le_bytes().to_vec(), texts, map(metadata)].concat();
        describe(&mut self.chunk.records, op::CHANNEL, &mut self.channels, content)
    }

    /// Adds a message of a channel, and ends the chunk if it is long enough.
    pub(crate) fn write(&mut self, header: &MessageHeader, data: &[u8]) {
        let (channel, time) = (header.channel_id, header.log_time);
        let index = self.chunk.index.entry(channel).or_default();
        index.extend(numbers([time, self.chunk.records.len() as u64]));
        let times = numbers([time, header.publish_time]);
        let parts: [&[u8]; 4] = [&channel.to_le_bytes(), &header.sequence.to_le_bytes(), &times, data];
        record(&mut self.chunk.records, op::MESSAGE, &parts);
        for times in [&mut self.chunk.times, &mut self.times] {
            let (first, last) = times.unwrap_or((time, time));
            *times = Some((first.min(time), last.max(time)));
        }
        *self.counts.entry(channel).or_default() += 1;
        if self.chunk.records.len() >= CHUNK {
            self.end_chunk();
        }
    }

    /// Adds a metadata record.
    pub(crate) fn write_metadata(&mut self, name: &str, metadata: &BTreeMap<String, String>) {
        self.end_chunk();
        let (begin, name) = (self.length(), sized(name.as_bytes()));
        record(&mut self.bytes, op::METADATA, &[&name, &map(metadata)]);
        let place = numbers([begin, self.length() - begin]);
        record(&mut self.metadata.0, op::METADATA_INDEX, &[&place, &name]);
        self.metadata.1 += 1;
    }

    /// Ends the open chunk. Its messages can be read then.
    pub(crate) fn end_chunk(&mut self) {
        let OpenChunk { records, times, index } = std::mem::take(&mut self.chunk);
        if records.is_empty() {
            return;
        }
        let (first, last) = times.unwrap_or_default();
        let (times, size, crc) = (numbers([first, last]), records.len() as u64, crc32fast::hash(&records));
        let packed = self.compressor.pack(records);
        let (compression, packed_size) = (sized(COMPRESSION), packed.len() as u64);
        let begin = self.length();
        let head = [&times[..], &size.to_le_bytes(), &crc.to_le_bytes(), &compression, &packed_size.to_le_bytes()];
        record(&mut self.bytes, op::CHUNK, &[&head.concat(), &packed]);
        let (end, mut places) = (self.length(), Vec::new());
        for (channel, entries) in index {
            places.extend(channel.to_le_bytes());
            places.extend(self.length().to_le_bytes());
            record(&mut self.bytes, op::MESSAGE_INDEX, &[&channel.to_le_bytes(), &sized(&entries)]);
        }
        let (place, index_size) = (numbers([begin, end - begin]), (self.length() - end).to_le_bytes());
        let sizes = numbers([packed_size, size]);
        let parts = [&times[..], &place, &sized(&places), &index_size, &compression, &sizes];
        record(&mut self.chunks.0, op::CHUNK_INDEX, &parts);
        self.chunks.1 += 1;
    }

    /// Ends the file with its summary. Nothing can be added then; a second call does nothing.
    pub(crate) fn finish(&mut self) {
        if std::mem::replace(&mut self.is_finished, true) {
            return;
        }
        self.end_chunk();
        let mut data = self.hasher.clone();
        data.update(&self.bytes);
        record(&mut self.bytes, op::DATA_END, &[&data.finalize().to_le_bytes()]);
        let (begin, mut summary, mut offsets) = (self.length(), Vec::new(), Vec::new());
        for (opcode, group) in self.summary() {
            if !group.is_empty() {
                let place = numbers([begin + summary.len() as u64, group.len() as u64]);
                record(&mut offsets, op::SUMMARY_OFFSET, &[&[opcode], &place]);
                summary.extend(group);
            }
        }
        let places = numbers([begin, begin + summary.len() as u64]);
        summary.extend(offsets);
        // The check is that of all before it, and is the last of the footer.
        record(&mut summary, op::FOOTER, &[&places, &[0; CRC]]);
        summary.truncate(summary.len() - CRC);
        let crc = crc32fast::hash(&summary).to_le_bytes();
        self.bytes.extend([&summary[..], &crc, MCAP_MAGIC].concat());
    }

    /// The groups of records of the summary.
    fn summary(&self) -> [(u8, Vec<u8>); 5] {
        let count = |(channel, count): (&u16, &u64)| [&channel.to_le_bytes()[..], &count.to_le_bytes()].concat();
        let counts: Vec<u8> = self.counts.iter().flat_map(count).collect();
        let (first, last) = self.times.unwrap_or_default();
        let attachments = 0_u32;
        let parts: [&[u8]; 8] = [
            &self.counts.values().sum::<u64>().to_le_bytes(),
            &(self.schemas.len() as u16).to_le_bytes(),
            &(self.channels.len() as u32).to_le_bytes(),
            &attachments.to_le_bytes(),
            &self.metadata.1.to_le_bytes(),
            &self.chunks.1.to_le_bytes(),
            &numbers([first, last]),
            &sized(&counts),
        ];
        let mut statistics = Vec::new();
        record(&mut statistics, op::STATISTICS, &parts);
        [
            (op::SCHEMA, described(op::SCHEMA, &self.schemas)),
            (op::CHANNEL, described(op::CHANNEL, &self.channels)),
            (op::STATISTICS, statistics),
            (op::CHUNK_INDEX, self.chunks.0.clone()),
            (op::METADATA_INDEX, self.metadata.0.clone()),
        ]
    }

    /// Length of the file without the open chunk \[bytes\].
    fn length(&self) -> u64 {
        self.taken + self.bytes.len() as u64
    }
}

/// Appends a record of these parts.
fn record(out: &mut Vec<u8>, opcode: u8, parts: &[&[u8]]) {
    let length = parts.iter().map(|part| part.len() as u64).sum::<u64>();
    out.push(opcode);
    out.extend(length.to_le_bytes());
    parts.iter().for_each(|part| out.extend_from_slice(part));
}

/// Numbers a content, and appends its record.
fn describe(out: &mut Vec<u8>, opcode: u8, contents: &mut Vec<Vec<u8>>, content: Vec<u8>) -> io::Result<u16> {
    let number = u16::try_from(contents.len() + 1).map_err(|_| io::Error::other("too many channels"))?;
    record(out, opcode, &[&number.to_le_bytes(), &content]);
    contents.push(content);
    Ok(number)
}

/// The records of all contents.
fn described(opcode: u8, contents: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    (1_u16..).zip(contents).for_each(|(number, content)| record(&mut out, opcode, &[&number.to_le_bytes(), content]));
    out
}

/// Bytes behind their length.
fn sized(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn numbers(numbers: [u64; 2]) -> Vec<u8> {
    numbers.map(u64::to_le_bytes).concat()
}

fn map(texts: &BTreeMap<String, String>) -> Vec<u8> {
    let pairs = texts.iter().flat_map(|(key, text)| [key, text]);
    sized(&pairs.flat_map(|text| sized(text.as_bytes())).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcap::Summary;
    use mcap::records::Record;
    use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
    use ruzstd::decoding::FrameDecoder;

    const MESSAGES: u64 = 30_000;

    fn header(channel_id: u16, number: u64) -> MessageHeader {
        MessageHeader {
            channel_id,
            sequence: number as u32,
            log_time: 1000 - number % 3 + number,
            publish_time: number,
        }
    }

    /// Messages of two channels in several chunks, a metadata record, and the channels.
    fn file() -> (Vec<u8>, [u16; 2]) {
        let mut container = McapContainer::new("p");
        let schema = container.add_schema("s", "e", b"text").unwrap();
        assert_eq!(container.add_schema("s", "e", b"text").unwrap(), schema);
        let metadata = BTreeMap::from([("key".to_owned(), "value".to_owned())]);
        let channels = ["one", "two"].map(|topic| container.add_channel(schema, topic, "e", &metadata).unwrap());
        let mut bytes = container.take();
        for number in 0..MESSAGES {
            container.write(&header(channels[usize::from(number % 10 == 0)], number), &number.to_le_bytes().repeat(9));
            bytes.extend(container.take());
            if number == MESSAGES / 2 {
                container.write_metadata("m", &metadata);
            }
        }
        container.finish();
        container.finish();
        bytes.extend(container.take());
        (bytes, channels)
    }

    /// The kinds of the records of a file whose checks of data and summary match.
    fn checked(mut bytes: &[u8]) -> Vec<u8> {
        let options = LinearReaderOptions::default().with_emit_chunks(true).with_validate_data_section_crc(true);
        let options = options.with_validate_summary_section_crc(true).with_check_finishes_after_end_magic(true);
        let (mut reader, mut kinds) = (LinearReader::new_with_options(options), Vec::new());
        while let Some(event) = reader.next_event() {
            match event.unwrap() {
                LinearReadEvent::Record { opcode, .. } => kinds.push(opcode),
                LinearReadEvent::ReadRequest(need) => {
                    let (now, rest) = bytes.split_at(need.min(bytes.len()));
                    reader.insert(need)[..now.len()].copy_from_slice(now);
                    reader.notify_read(now.len());
                    bytes = rest;
                }
            }
        }
        kinds
    }

    #[test]
    fn the_library_of_mcap_finds_every_record_by_the_summary() {
        let (bytes, channels) = file();
        let kinds = checked(&bytes);
        let count = |kind| kinds.iter().filter(|own| **own == kind).count();
        let summary = Summary::read(&bytes).unwrap().unwrap();
        let statistics = summary.stats.as_ref().unwrap();
        assert!(count(op::CHUNK) > 2 && statistics.chunk_count as usize == count(op::CHUNK));
        assert_eq!((statistics.schema_count, statistics.channel_count, statistics.metadata_count), (1, 2, 1));
        assert_eq!((statistics.message_start_time, statistics.message_end_time), (1000, 997 + MESSAGES));
        assert_eq!(statistics.message_count, MESSAGES);
        assert_eq!(statistics.channel_message_counts, [(channels[0], 27_000), (channels[1], 3000)].into());
        let topics: Vec<_> = channels.iter().map(|channel| summary.channels[channel].topic.as_str()).collect();
        assert_eq!(topics, ["one", "two"]);
        assert_eq!(*summary.channels[&channels[0]].schema.as_ref().unwrap().data, b"text"[..]);
        let place = &summary.metadata_indexes[0];
        let metadata = &bytes[place.offset as usize..][..place.length as usize];
        let Record::Metadata(metadata) = mcap::parse_record(op::METADATA, &metadata[9..]).unwrap() else { panic!() };
        assert_eq!((metadata.name.as_str(), metadata.metadata["key"].as_str()), ("m", "value"));
    }

    #[test]
    fn every_entry_of_an_index_is_the_place_of_its_message() {
        let (bytes, _) = file();
        let summary = Summary::read(&bytes).unwrap().unwrap();
        let mut found = 0;
        for index in &summary.chunk_indexes {
            let chunk = &bytes[index.chunk_start_offset as usize..][..index.chunk_length as usize];
            let Record::Chunk { header, data } = mcap::parse_record(op::CHUNK, &chunk[9..]).unwrap() else { panic!() };
            let mut records = vec![0; index.uncompressed_size as usize];
            assert_eq!(FrameDecoder::new().decode_all(&data, &mut records).unwrap(), records.len());
            assert_eq!(header.uncompressed_crc, crc32fast::hash(&records));
            for (channel, entries) in summary.read_message_indexes(&bytes, index).unwrap() {
                for entry in entries {
                    let record = &records[entry.offset as usize + 9..];
                    let Record::Message { header, .. } = mcap::parse_record(op::MESSAGE, record).unwrap() else {
                        panic!()
                    };
                    assert_eq!((header.channel_id, header.log_time), (channel.id, entry.log_time));
                    assert!((index.message_start_time..=index.message_end_time).contains(&entry.log_time));
                    found += 1;
                }
            }
        }
        assert_eq!(found, MESSAGES);
    }
}
