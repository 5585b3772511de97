//! `completions` and `man`: generated from the definition of the command line.

use clap::Args;
use clap_complete::Shell;
use isotherm_failure::Failure;
use isotherm_files::{StagedText, check_written, print_data};
use std::fs;
use std::path::{Path, PathBuf};

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
        print_data(&String::from_utf8_lossy(&text))
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
            check_written(None, rendered)?;
            return print_data(&String::from_utf8_lossy(&text));
        };
        fs::create_dir_all(&folder).map_err(|error| Failure::io("making", &folder, &error))?;
        let mut program = program.disable_help_subcommand(true);
        program.build();
        write_pages(&program, &folder)
    }
}

/// Writes the page of a command and those of its subcommands.
fn write_pages(command: &clap::Command, folder: &Path) -> Result<(), Failure> {
    for subcommand in command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set()) {
        write_pages(subcommand, folder)?;
    }
    let page = clap_mangen::Man::new(command.clone());
    let path = folder.join(page.get_filename());
    StagedText::create(Some(&path))?.write_with(|output| page.render(output))?.finish()
}
