//! Prints `--help` on one screen, with the commands in groups and the usual options of a command.
//!
//! `eyebox help` shows all options.

use crate::headings;
use clap::builder::StyledStr;
use clap::{Arg, Command};
use std::ffi::OsString;

/// The groups of commands.
const GROUPS: [(&str, &[&str]); 7] = [
    ("Start", &["demo"]),
    ("Compute", &["solve", "refine"]),
    ("See", &["render", "preview"]),
    ("Show", &["show", "encode"]),
    ("Files", &["info", "convert"]),
    ("Measure", &["eval"]),
    ("Hardware", &["display", "tracker", "device"]),
];
/// The commands that the short help only names.
const DEVELOP: [&str; 4] = ["bench", "feed", "completions", "man"];

/// The usual options of all commands.
const USUAL: [&str; 17] = [
    "color",
    "depth",
    "depth-map",
    "display",
    "engine",
    "json",
    "out",
    "output",
    "overwrite",
    "prescription",
    "pupil",
    "quality",
    "scene",
    "set",
    "settings",
    "size",
    "views",
];

/// The usual options of single commands.
const OF_COMMANDS: [(&str, &[&str]); 10] = [
    ("bench", &["beside", "dry-run", "frames", "rounds", "steps"]),
    ("convert", &["at", "exposure", "focal-length", "phase-unit", "pitch", "wavelength"]),
    ("eval compare", &["frames", "hologram", "jod", "methods", "pupils", "steps"]),
    ("eval gaze", &["duration"]),
    ("eval score", &["at", "encoded", "jod", "test-pupils"]),
    ("preview", &["at", "encoded", "zoom"]),
    ("refine", &["at", "pupil-diameter", "spread", "steps"]),
    ("render", &["at", "binning", "encoded", "exposure", "path", "what"]),
    ("show", &["calibration", "duration", "frames", "loop", "rate", "record", "stats", "tracker", "view"]),
    ("solve", &["camera", "dry-run", "duration", "frames", "memory", "method", "rate", "seed", "steps"]),
];

/// The largest number of options of which a command shows all.
const MOST: usize = 18;
/// Width of a line of help that is not cut, columns.
const LINE: usize = 64;

/// Returns whether the arguments ask for the short help.
pub fn is_asked(given: &[OsString]) -> bool {
    let words = given.iter().skip(1).take_while(|word| *word != "--");
    given.get(1).is_some_and(|word| word != "help") && words.into_iter().any(|word| word == "--help" || word == "-h")
}

/// Returns the command line with the short help.
pub fn command(command: Command) -> Command {
    let text = front(&command);
    headings::of_leaves(command.override_help(text), &mut of_command)
}

/// Returns the help of the whole command.
fn front(command: &Command) -> String {
    let about = |command: &Command| clause(&command.get_about().map(ToString::to_string).unwrap_or_default());
    let mut text = format!("{}\n\nUsage: eyebox COMMAND [OPTIONS]\n\n", about(command));
    for (group, names) in GROUPS {
        let found: Vec<&Command> = names.iter().filter_map(|name| command.find_subcommand(name)).collect();
        let mut rows = Vec::new();
        for sub in found {
            if !sub.has_subcommands() {
                rows.push((sub.get_name().to_owned(), about(sub)));
            } else if group == "Measure" {
                let below = sub.get_subcommands().map(|s| (format!("{} {}", sub.get_name(), s.get_name()), about(s)));
                rows.extend(below);
            } else {
                let below: Vec<&str> = sub.get_subcommands().map(Command::get_name).collect();
                rows.push((sub.get_name().to_owned(), below.join(", ")));
            }
        }
        for (i, (name, about)) in rows.iter().enumerate() {
            let group = if i == 0 { group } else { "" };
            text += &format!("{group:10}{name:14}{about}\n");
        }
    }
    // The program for devices has none of them.
    let develop: Vec<&str> = DEVELOP.into_iter().filter(|name| command.find_subcommand(name).is_some()).collect();
    if !develop.is_empty() {
        text += &format!("{:10}{}\n", "Develop", develop.join(", "));
    }
    text + "\n`eyebox COMMAND --help` shows the usual options, `eyebox help COMMAND` all of them. `--version` prints the version.\n\
           Numbers may have a unit, such as 4mm, 0.5D, 520nm, 30Hz, 10s or 4GiB.\n"
}

/// Returns the usual options of a command.
fn own(path: &str) -> &'static [&'static str] {
    OF_COMMANDS.iter().find(|(known, _)| *known == path).map_or(&[][..], |(_, own)| own)
}

/// Returns a command with its usual options, in one list.
fn of_command(path: &str, command: Command) -> Command {
    let (count, own) = (command.get_opts().count(), own(path));
    let is_usual = |option: &Arg| {
        let long = option.get_long().unwrap_or_default();
        count <= MOST || USUAL.contains(&long) || own.contains(&long) || option.is_required_set()
    };
    let example = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let example: Vec<&str> = example.lines().skip(1).take_while(|line| line.starts_with("  ")).take(2).collect();
    let command = command.mut_args(|arg| {
        let arg = match arg.get_help().map(ToString::to_string) {
            Some(help) if !arg.is_positional() => arg.help(StyledStr::from(clause(&help))),
            Some(help) => arg.help(StyledStr::from(help)),
            None => arg,
        };
        let (is_hidden, takes) = (!arg.is_positional() && !is_usual(&arg), arg.get_action().takes_values());
        let arg = arg.help_heading(None::<&'static str>).hide(is_hidden);
        if takes { arg.hide_possible_values(true) } else { arg }
    });
    let more = format!("`eyebox help {path}` shows all options.");
    command.after_help(if example.is_empty() { more } else { format!("Examples:\n{}\n\n{more}", example.join("\n")) })
}

/// Returns the beginning of a help text that fits on a line, if it can be cut there.
fn clause(text: &str) -> String {
    let mut text = text.split(" [default").next().unwrap_or(text);
    for mark in ["; ", ". ", ": ", ", ", " ("] {
        // A cut within parentheses would leave one of them open.
        let is_whole = |head: &str| head.matches('(').count() == head.matches(')').count();
        if text.chars().count() > LINE
            && let Some((head, _)) = text.split_once(mark)
            && head.len() > 14
            && is_whole(head)
        {
            text = head;
        }
    }
    text.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Cli;

    #[test]
    fn help_is_one_screen() {
        let mut short = command(headings::command::<Cli>());
        assert!(short.render_help().to_string().lines().count() < 40);
        for (path, sub) in headings::leaves(&short) {
            let help = sub.clone().term_width(100).render_help().to_string();
            assert!(help.lines().count() < 45, "{path}: {help}");
        }
    }

    #[test]
    fn every_command_has_a_group_and_every_usual_option_exists() {
        let all = headings::command::<Cli>();
        for sub in all.get_subcommands() {
            let grouped = GROUPS.iter().any(|(_, names)| names.contains(&sub.get_name()));
            assert!(grouped != DEVELOP.contains(&sub.get_name()), "{}", sub.get_name());
        }
        let leaves = headings::leaves(&all);
        let has = |sub: &Command, long: &str| sub.get_opts().any(|option| option.get_long() == Some(long));
        let find = |name: &str| leaves.iter().find(|(path, _)| path == name).unwrap_or_else(|| panic!("{name}")).1;
        for (name, own) in OF_COMMANDS {
            let missing: Vec<_> = own.iter().filter(|long| !has(find(name), long)).collect();
            assert!(missing.is_empty(), "{name}: {missing:?}");
        }
        for long in USUAL {
            assert!(leaves.iter().any(|(_, sub)| has(sub, long)), "{long}");
        }
    }
}
