//! The command line with its options under headings if a command has many.

use clap::{Command, CommandFactory};

/// A command with fewer options shows them in one list.
const MIN_OPTIONS_WITH_HEADINGS: usize = 10;

/// Returns the command line of `C`, with its options under the headings that they name.
pub fn command<C: CommandFactory>() -> Command {
    of_leaves(C::command(), &mut |_, leaf| with_headings(leaf))
}

/// Changes every command that has no commands of its own, by its path, such as `eval score`.
pub fn of_leaves(command: Command, change: &mut dyn FnMut(&str, Command) -> Command) -> Command {
    of_leaves_below("", command, change)
}

fn of_leaves_below(path: &str, command: Command, change: &mut dyn FnMut(&str, Command) -> Command) -> Command {
    command.mut_subcommands(|sub| {
        let path = format!("{path}{}", sub.get_name());
        if sub.has_subcommands() { of_leaves_below(&format!("{path} "), sub, change) } else { change(&path, sub) }
    })
}

/// Returns every command that has no commands of its own, with its path.
#[cfg(test)]
pub fn leaves(command: &Command) -> Vec<(String, &Command)> {
    let own = command.get_subcommands().filter(|sub| sub.get_name() != "help");
    own.flat_map(|sub| match sub.has_subcommands() {
        true => leaves(sub).into_iter().map(|(path, leaf)| (format!("{} {path}", sub.get_name()), leaf)).collect(),
        false => vec![(sub.get_name().to_owned(), sub)],
    })
    .collect()
}

fn with_headings(sub: Command) -> Command {
    // A negative number is a value that its option refuses, and not an unknown option.
    let takes_none = |option: &clap::Arg| option.is_positional() || !option.get_action().takes_values();
    let sub = sub.mut_args(|option| if takes_none(&option) { option } else { option.allow_negative_numbers(true) });
    if sub.get_opts().count() < MIN_OPTIONS_WITH_HEADINGS {
        return sub.mut_args(|option| option.help_heading(None::<&'static str>));
    }
    sub
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Cli;

    #[test]
    fn every_option_of_a_command_with_many_has_a_heading() {
        let all = command::<Cli>();
        for (path, sub) in leaves(&all) {
            let many = sub.get_opts().count() >= MIN_OPTIONS_WITH_HEADINGS;
            for option in sub.get_opts() {
                let has = option.get_help_heading().is_some();
                assert_eq!(has, many, "--{} of {path}: its help_heading", option.get_id());
            }
        }
    }
}
