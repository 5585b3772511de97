//! The former command line: of `calibrate`, which did three jobs by options, and options that have another name now.

use isotherm_pipeline::{CampaignFile, quoted};
use std::ffi::{OsStr, OsString};
use std::path::Path;

/// The command line that does now what these `arguments` of the program did, if they are former ones of `calibrate`.
pub fn replacement(arguments: &[OsString]) -> Option<String> {
    let words: Vec<_> = arguments.iter().map(|word| word.to_string_lossy()).collect();
    let [command, options @ ..] = words.as_slice() else { return None };
    let first = options.first().filter(|_| command == "calibrate")?;
    // Another word is a subcommand that is misspelt.
    if !first.starts_with('-') && !first.contains(['.', '/']) && !Path::new(OsStr::new(&**first)).exists() {
        return None;
    }
    let job = if options.iter().any(|word| word == "--gravity-only") {
        "tumble"
    } else if options.iter().any(|word| word == "--one-attitude") {
        "warm-up"
    } else {
        let file = options.iter().find(|word| word.ends_with(".toml"));
        file.map_or("turntable", |file| job_of_campaign(Path::new(&**file)))
    };
    let options = options.iter().filter(|word| *word != "--gravity-only" && *word != "--one-attitude");
    let options: String = options.map(|word| format!(" {}", quoted(word))).collect();
    Some(format!("isotherm calibrate {job}{options}"))
}

/// Former names of options, and today's.
const OPTIONS: [(&str, &str); 5] = [
    ("--standstills", "--static-poses"),
    ("--other-unit", "--other-device"),
    ("--telemetry-every", "--temperature-every"),
    ("--telemetry-noise", "--temperature-noise"),
    ("--telemetry-lsb", "--temperature-lsb"),
];

/// What is said of all options among these `arguments` that have another name now; `None` if there are none.
pub fn renamed_options(arguments: &[OsString]) -> Option<String> {
    let words = arguments.iter().map(|word| word.to_string_lossy());
    let options: Vec<_> = words.map(|word| word.split('=').next().unwrap_or_default().to_owned()).collect();
    let renamed = OPTIONS.iter().filter(|(old, _)| options.iter().any(|option| option == old));
    let renamed: Vec<_> = renamed.map(|(old, new)| format!("{old} is {new} now")).collect();
    (!renamed.is_empty()).then(|| renamed.join(", "))
}

/// The subcommand that takes a campaign file.
pub(super) fn job_of_campaign(path: &Path) -> &'static str {
    let campaigns = CampaignFile::read(path).and_then(|file| file.campaigns()).unwrap_or_default();
    if campaigns.iter().any(|campaign| campaign.is_tumble) { "tumble" } else { "turntable" }
}
