//! `completions` and `man`: generated from the definition of the command line.

use clap::Args;
use clap_complete::Shell;
use isotherm_files::{StagedText, check_written, create_folder, print_data};
use isotherm_support::failure::Failure;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Print completions for a shell
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm completions bash > ~/.local/share/bash-completion/completions/isotherm
  isotherm completions zsh > ~/.zfunc/_isotherm
  isotherm completions fish > ~/.config/fish/completions/isotherm.fish")]
pub(crate) struct Completions {
    /// Print completions for this shell
    shell: Shell,
}

impl Completions {
    pub(crate) fn run(self) -> Result<(), Failure> {
        let mut program = crate::command();
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut program, "isotherm", &mut text);
        print_data(&String::from_utf8_lossy(&text))
    }
}

/// The commented example of the service's configuration: it has every key.
const CONFIGURATION: &str = include_str!("../../../examples/service.toml");

/// Print or write manual pages
///
/// Prints the manual page of isotherm, or writes the pages of all commands, programs and the configuration into a
/// folder.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm man | man -l -
  isotherm man -o ~/.local/share/man/man1")]
pub(crate) struct Man {
    /// Write all pages into this folder
    ///
    /// The pages are isotherm.1, isotherm-serve.1, isothermd.1, isotherm-service.5 and others. The folder is created if
    /// it does not exist.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

impl Man {
    pub(crate) fn run(self) -> Result<(), Failure> {
        let program = crate::command();
        let Some(folder) = self.output else {
            let mut text = Vec::new();
            let rendered = clap_mangen::Man::new(program).render(&mut text);
            check_written(None, rendered)?;
            return print_data(&String::from_utf8_lossy(&text));
        };
        create_folder(&folder).map_err(|error| Failure::io("making", &folder, &error))?;
        let version = isotherm_version::LONG_VERSION;
        let others = [isotherm_service::command, isotherm_exporter::command, isotherm_ros2::command];
        for program in [program].into_iter().chain(others.map(|command| command(version))) {
            let mut program = program.disable_help_subcommand(true);
            program.build();
            write_pages(&program, &folder)?;
        }
        let page = configuration_page();
        let file = StagedText::create(Some(&folder.join("isotherm-service.5")))?;
        file.write_with(|output| output.write_all(page.as_bytes()))?.finish()
    }
}

/// The manual page of the service's configuration, around the example.
fn configuration_page() -> String {
    let line = |line: &str| {
        let line = line.replace('\\', "\\e").replace('-', "\\-");
        // A line that begins with a full stop or an apostrophe would be a request.
        if line.starts_with(['.', '\'']) { format!("\\&{line}\n") } else { format!("{line}\n") }
    };
    let example: String = CONFIGURATION.lines().map(line).collect();
    format!(
        ".TH isotherm\\-service 5\n.SH NAME\nisotherm\\-service \\- configuration of the Isotherm service\n\
         .SH SYNOPSIS\n/etc/isotherm/service.toml\n\
         .SH DESCRIPTION\nThe file that isothermd(1) serve \\-\\-config reads, in TOML. This example has every key.\n\
         .nf\n\n{example}.fi\n\
         .SH EXAMPLES\n.nf\nisothermd check \\-\\-strict /etc/isotherm/service.toml\n.fi\n\
         .SH \"SEE ALSO\"\nisothermd(1), isothermd\\-serve(1), isothermd\\-check(1), isotherm(1)\n"
    )
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
