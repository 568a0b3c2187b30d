//! `--help` on one screen, with the commands in groups and the usual options of a command. `eyebox help` shows everything.

use clap::builder::StyledStr;
use clap::{Arg, Command};
use std::ffi::OsString;

/// The groups of commands.
const GROUPS: [(&str, &[&str]); 7] = [
    ("Start", &["demo"]),
    ("Compute", &["solve", "plan", "refine"]),
    ("See", &["view", "photograph", "film", "preview"]),
    ("Show", &["show", "play", "live", "encode"]),
    ("Files", &["inspect", "import", "export"]),
    ("Measure", &["score", "evaluate", "tradeoff", "study"]),
    ("Hardware", &["displays", "calibrate", "trackers", "monitors", "devices"]),
];

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
const OF_COMMANDS: [(&str, &[&str]); 14] = [
    ("bench", &["beside", "dry", "frames", "rounds", "steps"]),
    ("evaluate", &["frames", "hologram", "jod", "methods", "pupils", "steps"]),
    ("film", &["binning", "path"]),
    ("import", &["exposure", "focal-length", "phase-unit", "pitch", "wavelength"]),
    ("live", &["calibration", "duration", "monitor", "record", "stats", "tracker", "view"]),
    ("plan", &["frames", "memory", "method", "steps"]),
    ("play", &["duration", "loop", "monitor", "rate", "record", "speed", "stats"]),
    ("preview", &["at", "encoded", "zoom"]),
    ("refine", &["at", "diameter", "spread", "steps"]),
    ("score", &["at", "encoded", "jod", "no-jod", "pupils"]),
    ("show", &["calibration", "duration", "frames", "loop", "monitor", "rate", "record", "stats", "tracker", "view"]),
    ("solve", &["camera", "frames", "memory", "method", "psnr", "rate", "seconds", "seed", "steps"]),
    ("study", &["content", "duration", "rate"]),
    ("view", &["at", "encoded", "exposure"]),
];

/// Number of options up to which a command shows all of them.
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
    command.override_help(text).mut_subcommands(of_command)
}

/// Returns the help of the whole command.
fn front(command: &Command) -> String {
    let about = |name: &str| command.find_subcommand(name).and_then(Command::get_about).map(ToString::to_string);
    let mut text = format!(
        "{}\n\nUsage: eyebox COMMAND [OPTIONS]\n\n",
        command.get_about().map(ToString::to_string).unwrap_or_default()
    );
    for (group, names) in GROUPS {
        for (i, name) in names.iter().enumerate() {
            let group = if i == 0 { group } else { "" };
            let about = about(name).unwrap_or_default();
            text += &format!("{group:10}{name:12}{}\n", clause(&about));
        }
    }
    text += &format!("{:10}{}\n", "Develop", "bench, feed, completions, man");
    text + "\n`eyebox COMMAND --help` shows the usual options, `eyebox help COMMAND` all of them. `--version` prints the version.\n\
           Numbers may have a unit, such as 4mm, 0.5D, 520nm, 30Hz, 10s or 4GiB.\n"
}

/// Returns a command with its usual options, in one list.
fn of_command(command: Command) -> Command {
    let (name, count) = (command.get_name().to_owned(), command.get_opts().count());
    let own = OF_COMMANDS.iter().find(|(known, _)| *known == name).map_or(&[][..], |(_, own)| own);
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
    let more = format!("`eyebox help {name}` shows all options.");
    command.after_help(if example.is_empty() { more } else { format!("Examples:\n{}\n\n{more}", example.join("\n")) })
}

/// Returns the beginning of a help text that fits on a line, if it can be cut there.
fn clause(text: &str) -> String {
    let mut text = text.split(" [default").next().unwrap_or(text);
    for mark in ["; ", ": ", ", "] {
        if text.chars().count() > LINE
            && let Some((head, _)) = text.split_once(mark)
            && head.len() > 14
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
    use crate::headings;

    #[test]
    fn help_is_one_screen() {
        let mut short = command(headings::command::<Cli>());
        assert!(short.render_help().to_string().lines().count() < 40);
        for sub in short.clone().get_subcommands() {
            let help = sub.clone().term_width(100).render_help().to_string();
            assert!(help.lines().count() < 45, "{}: {help}", sub.get_name());
        }
    }

    #[test]
    fn every_command_has_a_group_and_every_usual_option_exists() {
        let all = headings::command::<Cli>();
        for sub in all.get_subcommands() {
            let of_developers = ["bench", "feed", "completions", "man"].contains(&sub.get_name());
            let grouped = GROUPS.iter().any(|(_, names)| names.contains(&sub.get_name()));
            assert!(grouped != of_developers, "{}", sub.get_name());
        }
        let has = |sub: &Command, long: &str| sub.get_opts().any(|option| option.get_long() == Some(long));
        for (name, own) in OF_COMMANDS {
            let sub = all.find_subcommand(name).unwrap();
            assert!(own.iter().all(|long| has(sub, long)), "{name}: {own:?}");
        }
        for long in USUAL {
            assert!(all.get_subcommands().any(|sub| has(sub, long)), "{long}");
        }
    }
}
