//! TOML files: tables, campaign files and the others.

use super::model::{DescribedKind, FileDescription};
use super::rows::ImuSummary;
use crate::files::CampaignFile;
use isotherm_documents::{LoadError, load_table, read_text};
use isotherm_files::Trust;
use isotherm_fit::observable;
use isotherm_recording_formats::convert::Mapping;
use isotherm_shared::document::{Document, MAX_BYTES};
use isotherm_shared::kind::FileKind;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::Path;

/// The format of the campaign file of a tumble.
pub(super) const TUMBLE: &str = "the campaign file of a tumble";

/// Whether a file is meant to be TOML, by its name, or by a beginning that is one.
pub(super) fn looks_so(path: &Path, beginning: &[u8]) -> bool {
    let is_named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    // A document is looked at up to its last whole line: keys and sections are there from the begin on.
    let whole = beginning.iter().rposition(|byte| *byte == b'\n').map_or(beginning, |end| &beginning[..end]);
    let is_document = || {
        let text = str::from_utf8(whole).ok();
        text.and_then(|text| Document::parse(text).ok()).is_some_and(|document| FileKind::of(&document).is_some())
    };
    is_named || beginning.len() as u64 <= MAX_BYTES && is_document()
}

impl FileDescription {
    pub(super) fn read_toml(&mut self, path: &Path) -> Result<(), Failure> {
        self.format = "TOML".to_owned();
        let (text, _) = read_text(path, Trust::Any)?;
        let refused = |faults| Failure::from(LoadError::Refused { path: path.to_owned(), faults });
        let kind = FileKind::of(&Document::parse(&text).map_err(refused)?);
        let Some(kind) = kind else {
            let message = "none of Isotherm's TOML files: it has no key of a table, a campaign file or a mapping";
            return Err(Failure::new(Exit::Config, format!("{}: {message}", shown(path))));
        };
        kind.name().clone_into(&mut self.format);
        match kind {
            FileKind::Table => {
                self.kind = DescribedKind::Table;
                let (table, _) = load_table(path, None, Trust::Any)?;
                self.imus.push(ImuSummary::of_table(&table));
                self.notes.push(format!("digest {}", table.digest()));
            }
            FileKind::Campaign => {
                self.kind = DescribedKind::Campaign;
                let file = CampaignFile { path: path.to_owned(), text };
                for campaign in file.campaigns()? {
                    if campaign.is_tumble {
                        TUMBLE.clone_into(&mut self.format);
                    }
                    self.imus.push(ImuSummary { imu: Some(campaign.imu.to_string()), ..ImuSummary::default() });
                    if !campaign.is_tumble && !campaign.has_ramps_alone() {
                        observable(&campaign)
                            .map_err(|error| Failure::new(Exit::Config, format!("{}: {error}", shown(path))))?;
                    }
                }
            }
            FileKind::Mapping => {
                self.kind = DescribedKind::Mapping;
                // It has none of data whose columns are known.
                let columns = Mapping::from_toml(&text).map(|mapping| mapping.columns().count());
                self.notes.extend(columns.ok().map(|columns| format!("it names {columns} columns")));
            }
            FileKind::Plan => self.kind = DescribedKind::Plan,
            FileKind::Source => self.kind = DescribedKind::Source,
            FileKind::Node => self.kind = DescribedKind::Node,
            FileKind::Configuration => self.kind = DescribedKind::Configuration,
        }
        Ok(())
    }
}
