//! The fields of messages in an MCAP file, as columns. The file is read from beginning to end, so that an unfinished
//! file is read up to its last complete record. Chunks of other messages are passed over.

use super::fields::{FieldMap, decode, map_fields};
use super::records::Records;
use super::skip::ChannelFilter;
use super::table::{ImuChoice, TableReader, WantedColumn};
use crate::protobuf;
use isotherm_recording::RecordingError;
use isotherm_recording::steps;
use isotherm_shared::names::ImuId;
use isotherm_support::finding::Finding;
use isotherm_support::source::DataSource;
use mcap::records::{Channel, Record};
use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::rc::Rc;

/// Most streams that a message lists.
const LISTED: usize = 40;

/// Reads the wanted columns from the messages of one stream, which may have several channels.
pub(super) struct McapReader {
    records: Records,
    wanted: Vec<WantedColumn>,
    choice: ImuChoice,
    /// Whether only channels `isotherm/<imu>/raw` are read.
    raw: bool,
    /// Schemas that have the wanted columns, by id.
    schemas: HashMap<u16, Rc<FieldMap>>,
    /// Channels that have the wanted columns, by id.
    channels: HashMap<u16, OpenChannel>,
    /// The names of the streams that the choice allows, and how many of the channels are theirs.
    streams: BTreeMap<String, usize>,
    /// Whether a channel was added since the last message.
    new_channel: bool,
    /// Why the last unsuitable schema cannot be read, for messages.
    unreadable: Option<String>,
    /// The stream of the messages that have been returned.
    delivered: Option<String>,
    messages: u64,
}

/// A channel with the wanted columns.
struct OpenChannel {
    topic: String,
    imu: Option<ImuId>,
    fields: Rc<FieldMap>,
}

impl McapReader {
    /// Reads from `source`, which has the bytes of the source `of`; with `raw`, the messages of channels
    /// `isotherm/<imu>/raw`, otherwise those of any channel.
    pub(super) fn new(
        of: &DataSource,
        source: Box<dyn Read>,
        wanted: Vec<WantedColumn>,
        choice: ImuChoice,
        raw: bool,
    ) -> Self {
        let unwanted = ChannelFilter::of(of, |channel, _| is_readable(channel));
        Self {
            records: Records::without(source, unwanted),
            wanted,
            choice,
            raw,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            streams: BTreeMap::new(),
            new_channel: false,
            unreadable: None,
            delivered: None,
            messages: 0,
        }
    }

    /// Processes a record. Returns true if it was a message of the selected stream, whose values are then in `values`.
    fn take_record(&mut self, record: Record<'static>, values: &mut Vec<Option<u64>>) -> Result<bool, RecordingError> {
        match record {
            Record::Schema { header, data } if header.encoding == "protobuf" => {
                match protobuf::fields(&data, &header.name).map(|fields| map_fields(&self.wanted, &fields)) {
                    Some(Ok(fields)) => drop(self.schemas.insert(header.id, Rc::new(fields))),
                    Some(Err(lacking)) => self.unreadable = Some(format!("{}: {lacking}", header.name.escape_debug())),
                    None => {}
                }
            }
            Record::Channel(channel) => self.take_channel(&channel),
            Record::Message { header, data } => return self.take_message(header.channel_id, &data, values),
            _ => {}
        }
        Ok(false)
    }

    /// Keeps a channel that has the wanted columns.
    fn take_channel(&mut self, channel: &Channel) {
        steps::count(1);
        let topic = channel.topic.trim_start_matches('/').to_owned();
        let stream = topic.strip_prefix("isotherm/").and_then(|rest| rest.rsplit_once('/'));
        let imu = stream.and_then(|(imu, _)| ImuId::new(imu));
        let is_raw = imu.is_some() && stream.is_some_and(|(_, stream)| stream == "raw");
        if let Some(fields) = self.schemas.get(&channel.schema_id)
            && is_readable(channel)
            && (is_raw || !self.raw)
        {
            let open = OpenChannel { topic, imu, fields: Rc::clone(fields) };
            if let Some(name) = self.allowed(&open) {
                *self.streams.entry(name).or_default() += 1;
            }
            let before = self.channels.insert(channel.id, open);
            // Its number may have been another stream's.
            if let Some(name) = before.and_then(|before| self.allowed(&before))
                && let Some(channels) = self.streams.get_mut(&name)
            {
                *channels -= 1;
                if *channels == 0 {
                    self.streams.remove(&name);
                }
            }
            self.new_channel = true;
        }
    }

    /// The name of a channel's stream, if the choice allows it.
    fn allowed(&self, channel: &OpenChannel) -> Option<String> {
        let is_allowed = match &self.choice {
            ImuChoice::Only(wanted) if !self.raw => channel.imu.as_ref() == Some(wanted),
            _ => true,
        };
        is_allowed.then(|| self.stream_of(channel).to_owned())
    }

    fn take_message(
        &mut self,
        channel: u16,
        data: &[u8],
        values: &mut Vec<Option<u64>>,
    ) -> Result<bool, RecordingError> {
        self.messages += 1;
        if std::mem::take(&mut self.new_channel) {
            self.check_choice()?;
        }
        let channel = self.channels.get(&channel).filter(|channel| self.is_selected(channel));
        let Some(channel) = channel else { return Ok(false) };
        if self.delivered.is_none() {
            self.delivered = Some(self.stream_of(channel).to_owned());
        }
        decode(data, &self.wanted, &channel.fields, values).map_err(|message| self.error(message))?;
        Ok(true)
    }

    /// The name that identifies a channel's stream: the IMU's name, or the topic if any stream is wanted.
    fn stream_of<'a>(&self, channel: &'a OpenChannel) -> &'a str {
        match (&channel.imu, self.raw) {
            (Some(imu), true) => imu.as_str(),
            _ => &channel.topic,
        }
    }

    /// The names of the streams that the choice allows, as a message lists them.
    fn listed(&self) -> String {
        let names = self.streams.keys().take(LISTED).map(|name| name.escape_debug().to_string());
        let more = (self.streams.len() > LISTED).then(|| "..".to_owned());
        names.chain(more).collect::<Vec<_>>().join(", ")
    }

    /// Whether this channel's messages are returned, judged by the channels that are known so far.
    fn is_selected(&self, channel: &OpenChannel) -> bool {
        match &self.choice {
            ImuChoice::Only(wanted) => channel.imu.as_ref() == Some(wanted),
            ImuChoice::Prefer(wanted) if channel.imu.as_ref() == Some(wanted) => true,
            ImuChoice::Prefer(_) | ImuChoice::Any => self.streams.len() < 2,
        }
    }

    /// Checks that the choice selects one stream.
    fn check_choice(&self) -> Result<(), RecordingError> {
        let streams = &self.streams;
        let clear = match &self.choice {
            ImuChoice::Only(_) => self.raw || streams.len() < 2,
            ImuChoice::Prefer(wanted) => {
                let changed = self.delivered.as_ref().is_some_and(|delivered| delivered != wanted.as_str());
                streams.len() < 2 || (streams.contains_key(wanted.as_str()) && !changed)
            }
            ImuChoice::Any => streams.len() < 2,
        };
        if clear {
            return Ok(());
        }
        let names = self.listed();
        let what = if self.raw { "raw samples of several IMUs" } else { "several channels have these columns" };
        Err(self.error(format!("{what}: {names}; choose one with --imu")))
    }

    fn nothing_to_read(&self) -> String {
        if let Some(damage) = self.records.damage() {
            return damage.message;
        }
        let why = self.unreadable.as_ref().map(|why| format!("; {why}")).unwrap_or_default();
        match (&self.choice, self.raw) {
            (ImuChoice::Only(wanted) | ImuChoice::Prefer(wanted), true) if !self.streams.is_empty() => {
                let names = self.listed();
                format!("no raw samples of {wanted}, but of {names}; choose with --imu")
            }
            (_, true) => format!("no raw samples (a channel isotherm/<imu>/raw with messages isotherm.RawSample){why}"),
            (_, false) => format!("no channel with protobuf messages that have these columns{why}"),
        }
    }
}

/// Whether messages of a channel can be read, if they have the columns.
fn is_readable(channel: &Channel) -> bool {
    channel.message_encoding == "protobuf"
}

impl TableReader for McapReader {
    fn imu(&self) -> Option<&str> {
        self.delivered.as_deref().filter(|_| self.raw)
    }

    fn read(&mut self, values: &mut Vec<Option<u64>>) -> Result<bool, RecordingError> {
        loop {
            let record = self.records.next();
            match record.map_err(|error| error.located(|message| self.error(message)))? {
                Some(record) => {
                    if self.take_record(record, values)? {
                        return Ok(true);
                    }
                }
                None if self.delivered.is_none()
                    && !self.channels.values().any(|channel| self.is_selected(channel)) =>
                {
                    return Err(self.error(self.nothing_to_read()));
                }
                None => return Ok(false),
            }
        }
    }

    fn row(&self) -> u64 {
        self.messages + self.records.skipped()
    }

    fn unit(&self) -> &'static str {
        "message"
    }

    fn error(&self, message: String) -> RecordingError {
        let place = format!("byte {}, message {}", self.records.bytes(), self.row());
        RecordingError::Place { place, message }
    }

    fn damage(&self) -> Option<Finding> {
        self.records.damage()
    }

    fn truncation(&self) -> Option<String> {
        self.records.truncation()
    }
}
