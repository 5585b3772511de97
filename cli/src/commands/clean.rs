//! `clean`: removes what a domain has left behind.

use clap::Args;
use isotherm_client::Domain;
use isotherm_files::{check_stdout, check_written, print};
use isotherm_service::clean::clean;
use isotherm_support::failure::Failure;

/// Remove the remains of a domain
///
/// Removes the files that a domain has left in shared memory and in its folder, if none of its processes is running.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm clean\n  isotherm clean --domain bench")]
pub(crate) struct Clean {}

impl Clean {
    pub(crate) fn run(self, domain: &Domain) -> Result<(), Failure> {
        check_written(None, check_stdout())?;
        let removed = clean(domain)?;
        print(&format!("domain {}: {removed} files removed\n", domain.name()))
    }
}
