//! Chunks of an MCAP file that are not unpacked, since all of their messages are of channels that nobody wants.
//!
//! The index of a chunk says which channels its messages have, not which channels it defines. So only a file whose
//! summary matches its check and has all channels is read in this way.

use super::summary::summary;
use isotherm_support::source::DataSource;
use mcap::records::{Channel, Record};
use std::collections::{HashMap, HashSet};

/// Channels that are not wanted, and the schemas and channels that the summary of the file has.
#[derive(Default)]
pub(crate) struct ChannelFilter {
    unwanted: HashSet<u16>,
    described: Vec<Record<'static>>,
}

/// A chunk, and what its index says so far.
pub(super) struct ChunkIndex {
    chunk: Vec<u8>,
    channels: HashSet<u16>,
    messages: u64,
}

impl ChannelFilter {
    /// The channels of a file for which `is_wanted` is false of channel and schema's name; none if the summary of the
    /// file does not have all channels, or if it is no file.
    pub(crate) fn of(of: &DataSource, is_wanted: impl Fn(&Channel, &str) -> bool) -> Self {
        Self::summed_up(of, is_wanted).unwrap_or_default()
    }

    fn summed_up(of: &DataSource, is_wanted: impl Fn(&Channel, &str) -> bool) -> Option<Self> {
        let mut file = of.is_file().then(|| of.open().ok()).flatten()?;
        let (mut schemas, mut channels, mut count) = (HashMap::new(), HashMap::new(), None);
        let described = summary(&mut file).ok()?;
        for record in &described {
            match record {
                Record::Schema { header, .. } => drop(schemas.insert(header.id, header.name.clone())),
                Record::Channel(channel) => drop(channels.insert(channel.id, channel.clone())),
                Record::Statistics(statistics) => count = Some(statistics.channel_count),
                _ => {}
            }
        }
        if count != u32::try_from(channels.len()).ok() {
            return None;
        }
        let schema = |channel: &Channel| schemas.get(&channel.schema_id).map_or("", String::as_str);
        let unwanted = channels.values().filter(|channel| !is_wanted(channel, schema(channel)));
        Some(Self { unwanted: unwanted.map(|channel| channel.id).collect(), described })
    }

    pub(super) fn is_empty(&self) -> bool {
        self.unwanted.is_empty()
    }

    /// The schemas and channels of the summary, once.
    pub(super) fn take_described(&mut self) -> impl Iterator<Item = Record<'static>> + use<> {
        let is_it = |record: &Record<'_>| matches!(record, Record::Schema { .. } | Record::Channel(_));
        core::mem::take(&mut self.described).into_iter().filter(is_it)
    }
}

impl ChunkIndex {
    pub(super) fn new(chunk: Vec<u8>) -> Self {
        Self { chunk, channels: HashSet::new(), messages: 0 }
    }

    pub(super) fn add(&mut self, channel: u16, messages: u64) {
        self.channels.insert(channel);
        self.messages += messages;
    }

    pub(super) fn chunk(&self) -> &[u8] {
        &self.chunk
    }

    /// The number of its messages if all are of unwanted channels. Without an index nobody knows.
    pub(super) fn all_unwanted(&self, unwanted: &ChannelFilter) -> Option<u64> {
        (!self.channels.is_empty() && self.channels.is_subset(&unwanted.unwanted)).then_some(self.messages)
    }
}
