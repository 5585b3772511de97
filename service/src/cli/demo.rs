use crate::failure::Failure;
use clap::Args;

/// demo
#[derive(Debug, Args)]
pub struct Demo {}

impl Demo {
    pub fn run(self) -> Result<(), Failure> {
        Ok(())
    }
}
