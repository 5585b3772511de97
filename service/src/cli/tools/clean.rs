use super::written;
use crate::clean::clean;
use crate::failure::Failure;
use clap::Args;
use isotherm_client::Domain;
use std::io::{self, Write as _};

/// Remove what a domain has left behind in shared memory and its folder, when nothing of it runs
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm clean\n  isotherm clean --domain bench")]
pub struct Clean {}

impl Clean {
    pub fn run(self, domain: &Domain) -> Result<(), Failure> {
        let removed = clean(domain)?;
        written(None, writeln!(io::stdout(), "domain {}: {removed} files removed", domain.name()))
    }
}
