//! `arguments`: the commands and their options as JSON, for a program that asks for them, such as a page with fields.

use clap::{Arg, ArgAction, Args, Command};
use isotherm_files::print_data;
use isotherm_support::failure::Failure;
use serde_json::{Value, json};

/// Print the commands and their options as JSON
///
/// Prints every command that works on files, with its options and their help, for other programs.
#[derive(Debug, Args)]
pub struct Arguments {}

impl Arguments {
    pub(crate) fn run(self, mut program: Command) -> Result<(), Failure> {
        program.build();
        let mut commands = Vec::new();
        list(&program, "", &mut commands);
        print_data(&format!("{:#}\n", json!({ "commands": commands })))
    }
}

/// The commands below this one that do something by themselves, by their paths.
fn list(command: &Command, before: &str, found: &mut Vec<Value>) {
    let commands = command.get_subcommands().filter(|it| !it.is_hide_set() && it.get_name() != "help");
    for command in commands {
        let path = format!("{before}{}", command.get_name());
        if command.has_subcommands() {
            list(command, &format!("{path} "), found);
            continue;
        }
        let is_shown =
            |argument: &&Arg| !argument.is_hide_set() && !["help", "version"].contains(&argument.get_id().as_str());
        let options: Vec<_> =
            command.get_arguments().filter(is_shown).map(|argument| option(command, argument)).collect();
        found.push(json!({
            "name": path,
            "about": text(command.get_about()),
            "long_about": text(command.get_long_about()),
            "options": options,
        }));
    }
}

fn option(command: &Command, argument: &Arg) -> Value {
    let takes_value = argument.get_num_args().is_some_and(|count| count.takes_values());
    let names = argument.get_value_names().unwrap_or_default();
    let conflicts = command.get_arg_conflicts_with(argument);
    let possible: Vec<_> = argument
        .get_possible_values()
        .into_iter()
        .filter(|_| takes_value)
        .map(|value| json!({ "name": value.get_name(), "help": text(value.get_help()) }))
        .collect();
    let defaults: Vec<_> = argument.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
    let several = matches!(argument.get_action(), ArgAction::Append)
        || argument.get_num_args().is_some_and(|count| count.max_values() > 1);
    json!({
        "id": argument.get_id().as_str(),
        "long": argument.get_long(),
        "short": argument.get_short(),
        "positional": argument.is_positional(),
        "value_name": names.first().filter(|_| takes_value).map(|name| name.as_str()),
        "help": text(argument.get_help()),
        "long_help": text(argument.get_long_help()),
        "heading": argument.get_help_heading(),
        "required": argument.is_required_set(),
        "takes_value": takes_value,
        "multiple": takes_value && several,
        "delimiter": argument.get_value_delimiter(),
        "default": defaults.first().filter(|_| takes_value),
        "possible_values": possible,
        "conflicts": conflicts.iter().map(|other| other.get_id().as_str()).collect::<Vec<_>>(),
    })
}

/// A text of the help; empty if there is none.
fn text(help: Option<&clap::builder::StyledStr>) -> String {
    help.map(ToString::to_string).unwrap_or_default()
}
