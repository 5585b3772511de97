//! The rows of a campaign in CSV: raw samples with their set point and position.

use crate::columns::CAMPAIGN;
use crate::csv::CsvColumn;
use crate::error::RecordingError;
use crate::pieces::SequenceRule;
use crate::raw::RawCsvReader;
use isotherm_shared::wire::RawSample;
use std::io::Read;

/// What a set point is, for messages.
pub const SET_POINT: &str = "the chamber's set point in degC";
/// What a position is, for messages.
pub const POSITION: &str = "the number of a position, or nothing while the turntable moves";

/// One row of a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CampaignRow {
    /// Line in the file, from 1. In a recording of several pieces it counts over all pieces; in a format without lines
    /// it is the number of the row or message.
    pub line: u64,
    /// Set point of the chamber \[degC\]: a label that identifies the set point, not a measured value.
    pub set_point_c: f64,
    /// Number of the turntable's position; `None` while the turntable moves.
    pub position: Option<u32>,
    /// The sample that the acquisition latched.
    pub sample: RawSample,
}

/// Reads the rows of a campaign: raw samples with the columns `set_point_c` and `position`. `position` is empty in rows
/// that were taken while the turntable moved. An [`Iterator`] that ends at the first error.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_recording::CampaignCsvReader;
///
/// let samples: &[u8] = include_bytes!("../../examples/campaign/samples.csv");
/// let first = CampaignCsvReader::new(samples)?.next().ok_or("no row")??;
/// assert_eq!((first.line, first.set_point_c, first.position), (2, -25.0, Some(1)));
/// # Ok(())
/// # }
/// ```
pub struct CampaignCsvReader<R> {
    samples: RawCsvReader<R>,
    /// Set point and position.
    campaign: Option<[CsvColumn; 2]>,
    /// Whether no row was whole so far.
    is_first: bool,
}

impl<R: Read> CampaignCsvReader<R> {
    /// Reads the header row.
    ///
    /// # Errors
    /// [`RecordingError::Data`] if a column is missing or occurs twice.
    pub fn new(source: R) -> Result<Self, RecordingError> {
        let samples = RawCsvReader::new(source)?;
        let hint = "a campaign's rows are raw samples with the set point and the number of the position";
        let columns = samples.rows.columns(&CAMPAIGN.map(|column| column.name), hint)?;
        Ok(Self { samples, campaign: columns.try_into().ok(), is_first: true })
    }

    /// Reads raw samples as rows without position, whose set point is 0.
    ///
    /// # Errors
    /// As [`RawCsvReader::new`].
    pub fn of_samples(source: R) -> Result<Self, RecordingError> {
        Ok(Self { samples: RawCsvReader::new(source)?, campaign: None, is_first: true })
    }

    /// The reader of the rows' samples.
    pub const fn samples(&self) -> &RawCsvReader<R> {
        &self.samples
    }

    /// Sets the rule's state: that after the last sample of the previous piece of the recording.
    pub const fn set_sequence_rule(&mut self, rule: SequenceRule) {
        self.samples.set_sequence_rule(rule);
    }

    fn row(&self, sample: RawSample) -> Result<CampaignRow, RecordingError> {
        let rows = &self.samples.rows;
        let mut row = CampaignRow { line: rows.line(), set_point_c: 0.0, position: None, sample };
        if let Some([set_point, position]) = &self.campaign {
            let finite = |text: &str| text.parse().ok().filter(|value: &f64| value.is_finite());
            let number = |text: &str| if text.is_empty() { Some(None) } else { text.parse().ok().map(Some) };
            row.set_point_c = rows.parse(set_point, SET_POINT, finite)?;
            row.position = rows.parse(position, POSITION, number)?;
        }
        Ok(row)
    }
}

impl<R: Read> Iterator for CampaignCsvReader<R> {
    type Item = Result<CampaignRow, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let row = self.samples.next()?.and_then(|sample| self.row(sample));
            match row {
                // If the first one is damaged, all may be: it is not the file of a campaign.
                Err(error) if !self.samples.failed && !self.is_first => self.samples.leave_out_last(error).ok()?,
                row => {
                    self.is_first = false;
                    self.samples.failed |= row.is_err();
                    return Some(row);
                }
            }
        }
    }
}
