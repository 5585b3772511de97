//! `completions` and `man`: generated from the definition of the command line.

use clap::Args;
use clap_complete::Shell;
use isotherm_failure::{Exit, Failure};
use isotherm_files::check_written;
use std::io::{self, Write as _};
use std::path::PathBuf;

/// Print the completions of a shell
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm completions bash > ~/.local/share/bash-completion/completions/isotherm
  isotherm completions zsh > ~/.zfunc/_isotherm
  isotherm completions fish > ~/.config/fish/completions/isotherm.fish")]
pub struct Completions {
    shell: Shell,
}

impl Completions {
    pub fn run(self, mut program: clap::Command) -> Result<(), Failure> {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut program, "isotherm", &mut text);
        check_written(None, io::stdout().write_all(&text))
    }
}

/// Print the manual page, or write those of all commands into a folder
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm man | man -l -
  isotherm man -o ~/.local/share/man/man1")]
pub struct Man {
    /// Folder for isotherm.1, isotherm-serve.1 and so on; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

impl Man {
    pub fn run(self, program: clap::Command) -> Result<(), Failure> {
        let Some(folder) = self.output else {
            let mut text = Vec::new();
            let rendered = clap_mangen::Man::new(program).render(&mut text);
            return check_written(None, rendered.and_then(|()| io::stdout().write_all(&text)));
        };
        let made = std::fs::create_dir_all(&folder);
        let made = made.and_then(|()| clap_mangen::generate_to(program, &folder));
        made.map_err(|error| Failure::new(Exit::Io, format!("writing manual pages to {}: {error}", folder.display())))
    }
}
