//! `top`: the live screen.

use crate::top;
use crate::top::Theme;
use clap::Args;
use isotherm_client::Domain;
use isotherm_support::failure::{Exit, Failure};
use std::env;
use std::ffi::OsString;
use std::io::{self, IsTerminal as _};

/// Watch the running service on a live screen
///
/// Waits if no service is running, and continues when it returns. Keys: q quits, up and down select an IMU, p pauses, ?
/// shows all others. NO_COLOR switches colours off.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm top\n  isotherm top --domain bench\n  ssh -t vehicle sudo -u isotherm isotherm top"
)]
pub(crate) struct Top {}

impl Top {
    pub(crate) fn run(self, domain: Domain) -> Result<(), Failure> {
        let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty());
        if !io::stdin().is_terminal() || !io::stdout().is_terminal() || set("TERM").is_none_or(|term| term == "dumb") {
            let message = "top needs a terminal with a cursor that moves; `isotherm status` prints the same once; over ssh use `ssh -t`";
            return Err(Failure::new(Exit::Usage, message));
        }
        // As in locale(7): the first of the three that is set counts.
        let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set).map(OsString::into_encoded_bytes);
        let locale = locale.unwrap_or_default().to_ascii_lowercase();
        let unicode = [&b"utf-8"[..], b"utf8"].iter().any(|name| locale.windows(name.len()).any(|part| part == *name));
        top::run(domain, Theme { colour: set("NO_COLOR").is_none(), unicode })
    }
}
