//! What `check` reads in addition to tables without a service and a laboratory: campaign files, mappings, recordings.

use isotherm_command::check::CheckedFiles;
use isotherm_documents::LoadError;
use isotherm_fit::observable;
use isotherm_pipeline::CampaignFile;
use isotherm_recording_formats::convert::{KnownColumns, Mapping};
use isotherm_recording_formats::read::RecordingContents;
use isotherm_shared::document::Document;
use isotherm_shared::kind::FileKind;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::name;
use std::path::Path;
use tracing::warn;

/// What is validated here. Files of a service and of an automatic campaign are named, and not read.
pub const CHECKED_FILES: CheckedFiles = CheckedFiles {
    laboratory: laboratory_file,
    recording: Some(recording),
    configuration: |_, path, _| Err(elsewhere(FileKind::Configuration, path)),
};

fn elsewhere(kind: FileKind, path: &Path) -> Failure {
    let message = format!("{}: {}; `isotherm check` on the machine of its service reads it", shown(path), kind.name());
    Failure::new(Exit::Usage, message)
}

/// Validates a campaign file or a mapping.
///
/// # Errors
/// All its faults; and any other kind of file.
fn laboratory_file(kind: FileKind, text: &str, path: &Path) -> Result<String, Failure> {
    match kind {
        FileKind::Campaign => campaign(text, path),
        FileKind::Mapping => mapping(text, path),
        FileKind::Plan | FileKind::Source | FileKind::Node | FileKind::Configuration | FileKind::Table => {
            Err(elsewhere(kind, path))
        }
    }
}

/// Reads a recording from beginning to end.
fn recording(path: &Path) -> Result<String, Failure> {
    let RecordingContents { format, rows, findings } = RecordingContents::of(&isotherm_files::source(path))?;
    let lines: Vec<_> = findings.iter().map(|finding| finding.tagged(|line| line.to_string()).to_string()).collect();
    if findings.iter().any(|finding| finding.name == name::BAD_ROWS) {
        return Err(Failure::new(Exit::Data, lines.join("\n")).at(path, None));
    }
    // A recorder that was killed leaves such a file.
    lines.iter().for_each(|line| warn!("{line}"));
    let counted =
        |(stream, rows): (&String, &u64)| format!("{stream}: {rows} row{}", if *rows == 1 { "" } else { "s" });
    let rows: Vec<_> = rows.iter().map(counted).collect();
    Ok(format!("recording in {format}, {}", rows.join(", ")))
}

fn mapping(text: &str, path: &Path) -> Result<String, Failure> {
    let refuse = |faults| LoadError::Refused { path: path.to_owned(), faults };
    // Data whose columns are known have no columns in their mapping.
    let has_columns = |document: &Document<'_>| {
        let sensors = document.root().unchecked("accelerometer");
        sensors.map_or(document.has("accelerometer"), |sensors| sensors.has("columns") || sensors.has("kind"))
    };
    if Document::parse(text).is_ok_and(|document| !has_columns(&document)) {
        KnownColumns::from_toml(text).map_err(refuse)?;
        return Ok("mapping of data whose columns are known".to_owned());
    }
    let mapping = Mapping::from_toml(text).map_err(refuse)?;
    Ok(format!("mapping of {} columns of a text", mapping.columns().count()))
}

fn campaign(text: &str, path: &Path) -> Result<String, Failure> {
    let file = CampaignFile { path: path.to_owned(), text: text.to_owned() };
    let campaigns = file.campaigns()?;
    let imus: Vec<_> = campaigns.iter().map(|campaign| campaign.imu.as_str()).collect();
    let imus = imus.join(", ");
    // The others differ only by their mountings.
    let Some(campaign) = campaigns.first() else { return Ok(String::new()) };
    let ramps = match campaign.ramps.len() {
        0 => String::new(),
        1 => ", 1 ramp".to_owned(),
        ramps => format!(", {ramps} ramps"),
    };
    if let Some(curves) = campaign.curves.as_ref().filter(|_| campaign.has_ramps_alone()) {
        return Ok(format!("campaign of {imus}{ramps} only, curves of {curves}"));
    }
    if campaign.is_tumble {
        let recordings = match campaign.samples.len() {
            1 => "1 recording".to_owned(),
            recordings => format!("{recordings} recordings"),
        };
        let each = if campaigns.len() > 1 { " each" } else { "" };
        return Ok(format!("campaign of {imus} without a turntable, {recordings}{each}"));
    }
    observable(campaign).map_err(|error| Failure::new(Exit::Config, format!("{}: {error}", shown(path))))?;
    let turns = match campaign.turns.len() {
        0 => String::new(),
        turns => format!(" and {turns} turns"),
    };
    let positions = campaign.positions.len();
    Ok(format!("campaign of {imus}, {positions} positions{turns} that observe everything{ramps}"))
}
