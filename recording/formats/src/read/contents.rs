//! What a recording has: its streams with their rows, and what is damaged.

use super::increments::read_increments;
use super::open::{SourceContent, open_source};
use super::recording::Samples;
use super::records::Records;
use super::skip::ChannelFilter;
use super::table::ImuChoice;
use isotherm_recording::{Progress, RecordingError};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::Failure;
use isotherm_support::finding::{Finding, name};
use isotherm_support::source::DataSource;
use mcap::records::Record;
use std::collections::{BTreeMap, HashMap};

/// What a recording of Isotherm has.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingContents {
    /// The name of its format.
    pub format: &'static str,
    /// The rows of each stream: `raw` or `increments` of a text, and the topics of MCAP.
    pub rows: BTreeMap<String, u64>,
    /// What is damaged and left out, and whether the end is missing.
    pub findings: Vec<Finding>,
}

impl RecordingContents {
    /// Reads a recording from beginning to end.
    ///
    /// # Errors
    /// If it cannot be read, or is no recording.
    pub fn of(source: &DataSource) -> Result<Self, Failure> {
        match open_source(source, &Progress::default(), None)? {
            SourceContent::Mcap(bytes) => {
                let records = Records::without(bytes, ChannelFilter::of(source, |_, _| true));
                of_mcap(records).map_err(|error| error.failure(source.name()))
            }
            SourceContent::Csv(_) => of_text(source),
        }
    }
}

fn of_text(source: &DataSource) -> Result<RecordingContents, Failure> {
    let of = |stream: &str, rows, findings| RecordingContents {
        format: "CSV",
        rows: BTreeMap::from([(stream.to_owned(), rows)]),
        findings,
    };
    match Samples::open(std::slice::from_ref(source), ImuChoice::Any, &Progress::default()) {
        Ok(mut samples) => {
            let rows = samples.by_ref().map(|row: Result<RawSample, Failure>| row.map(drop));
            let rows = rows.collect::<Result<Vec<_>, _>>()?.len() as u64;
            Ok(of("raw", rows, samples.recording().findings()))
        }
        Err(refused) => {
            let mut rows = 0;
            let read = read_increments(source, &ImuChoice::Any, &Progress::default(), |_| rows += 1);
            // A header with the columns of a stream was passed by that stream's reader.
            let line = |failure: &Failure| failure.place.as_ref().and_then(|(_, line)| *line);
            let further = |error: Failure| if line(&error) > line(&refused) { error } else { refused };
            read.map(|findings| of("increments", rows, findings)).map_err(further)
        }
    }
}

fn of_mcap(mut records: Records) -> Result<RecordingContents, RecordingError> {
    let (mut topics, mut rows) = (HashMap::new(), BTreeMap::new());
    let failed = |message: String| RecordingError::Place { place: "MCAP".to_owned(), message };
    while let Some(record) = records.next().map_err(|error| error.located(failed))? {
        match record {
            Record::Channel(channel) => {
                rows.entry(channel.topic.clone()).or_insert(0);
                topics.insert(channel.id, channel.topic);
            }
            Record::Message { header, .. } => {
                let rows = topics.get(&header.channel_id).and_then(|topic| rows.get_mut(topic));
                rows.into_iter().for_each(|rows| *rows += 1);
            }
            _ => {}
        }
    }
    let truncation = records.truncation().map(|text| Finding::warning(name::TRUNCATED, text));
    Ok(RecordingContents { format: "MCAP", rows, findings: records.damage().into_iter().chain(truncation).collect() })
}
