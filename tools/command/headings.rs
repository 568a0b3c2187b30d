//! The command line as people read it: options under headings if a command has many.

use clap::{Command, CommandFactory};

/// A command with fewer options shows them in one list.
const MIN_OPTIONS_WITH_HEADINGS: usize = 10;

/// Returns the command line of `C`, with its options under the headings that they name.
pub fn command<C: CommandFactory>() -> Command {
    C::command().mut_subcommands(|sub| {
        // A negative number is the value of its option, which refuses it: no unknown option.
        let takes_none = |option: &clap::Arg| option.is_positional() || !option.get_action().takes_values();
        let sub = sub.mut_args(|option| if takes_none(&option) { option } else { option.allow_negative_numbers(true) });
        if sub.get_opts().count() < MIN_OPTIONS_WITH_HEADINGS {
            return sub.mut_args(|option| option.help_heading(None::<&'static str>));
        }
        sub
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Cli;

    #[test]
    fn every_option_of_a_command_with_many_has_a_heading() {
        for sub in command::<Cli>().get_subcommands() {
            let many = sub.get_opts().count() >= MIN_OPTIONS_WITH_HEADINGS;
            for option in sub.get_opts() {
                let has = option.get_help_heading().is_some();
                assert_eq!(has, many, "--{} of {}: its help_heading", option.get_id(), sub.get_name());
            }
        }
    }
}
