//! Prints mistakes on the command line, one line each, with a remedy that works.

use crate::commands::Cli;
use crate::renamed;
use crate::talk::{self, print_error};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory, Error};
use eyebox::low_level::error::ErrorData;
use eyebox::low_level::quantity::QuantityError;
use serde_json::Value;
use std::error::Error as _;
use std::ffi::OsString;
use std::path::Path;

/// Returns the arguments as clap takes them. `help --help` is `help help`, `help solve --help` is `help solve`, and
/// `--depth -3..3` is `--depth=-3..3`.
pub fn arguments(mut given: Vec<OsString>, command: &Command) -> Vec<OsString> {
    let count = given.len();
    if given.get(1).is_some_and(|a| a == "help") {
        given.retain(|a| a != "--help" && a != "-h");
        if given.len() < count && given.len() == 2 {
            given.push("help".into());
        }
    }
    for word in &mut given {
        // clap has a short and a long help. The long one is `--help=all`, or `eyebox help COMMAND`.
        match word.to_str() {
            Some("--help") => *word = "-h".into(),
            Some("--help=all") => *word = "--help".into(),
            Some("--") => break,
            _ => {}
        }
    }
    join_negative_values(given, command)
}

/// Joins an option with a value that begins with a minus and a digit. If clap accepted `-3..3` or `-1,0,4,1.5` as
/// values, it would also accept a following option as a value.
fn join_negative_values(given: Vec<OsString>, command: &Command) -> Vec<OsString> {
    let words: Vec<&str> = given.iter().skip(1).filter_map(|word| word.to_str()).collect();
    let Some((_, sub)) = named(command, &words) else { return given };
    let takes_value = |name: &str| {
        let option = sub.get_opts().find(|option| option.get_long() == Some(name));
        option.is_some_and(|option| option.get_action().takes_values() && !option.is_require_equals_set())
    };
    let is_option = |word: &OsString| word.to_str().and_then(|w| w.strip_prefix("--")).is_some_and(takes_value);
    let mut joined: Vec<OsString> = Vec::with_capacity(given.len());
    let mut words = given.into_iter().peekable();
    while let Some(mut word) = words.next() {
        if word == "--" {
            joined.push(word);
            break;
        }
        if is_option(&word)
            && let Some(value) = words.next_if(is_negative)
        {
            word.push("=");
            word.push(value);
        }
        joined.push(word);
    }
    joined.extend(words);
    joined
}

/// Returns the command that the words name, with its path, such as `eval score`.
fn named<'a>(command: &'a Command, words: &[&str]) -> Option<(String, &'a Command)> {
    let (at, sub) = words.iter().enumerate().find_map(|(at, word)| Some((at, command.find_subcommand(word)?)))?;
    let own = (sub.get_name().to_owned(), sub);
    if !sub.has_subcommands() {
        return Some(own);
    }
    Some(named(sub, &words[at + 1..]).map_or(own, |(path, leaf)| (format!("{} {path}", sub.get_name()), leaf)))
}

/// Returns whether a word begins like a negative number. No option does.
fn is_negative(word: &OsString) -> bool {
    let rest = word.to_str().and_then(|word| word.strip_prefix('-'));
    rest.is_some_and(|rest| rest.trim_start_matches('.').starts_with(|c: char| c.is_ascii_digit()))
}

/// Prints help and version as they are, and a mistake as one line.
pub fn print(error: &Error) -> u8 {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = error.print();
            if error.exit_code() == 0 { 0 } else { 2 }
        }
        _ => {
            print_error(&line(error), &data(error));
            2
        }
    }
}

/// Returns a mistake as data, with its kind in clap's name, the argument and the value. A quantity adds its unit and
/// the units that fit.
fn data(error: &Error) -> ErrorData {
    let kind = format!("{:?}", error.kind());
    let kind = kind.char_indices().fold(String::new(), |kind, (at, c)| match c {
        c if c.is_uppercase() && at > 0 => kind + "-" + &c.to_lowercase().to_string(),
        c => kind + &c.to_lowercase().to_string(),
    });
    let value = |kind| match error.get(kind)? {
        ContextValue::String(text) => Some(Value::from(text.as_str())),
        ContextValue::Strings(all) => Some(Value::from(all.as_slice())),
        _ => None,
    };
    let named = [
        ("argument", ContextKind::InvalidArg),
        ("value", ContextKind::InvalidValue),
        ("command", ContextKind::InvalidSubcommand),
        ("with", ContextKind::PriorArg),
    ];
    let named = named.into_iter().filter_map(|(name, kind)| Some((name.to_owned(), value(kind)?)));
    let mut code = format!("usage/{kind}");
    let mut fields = serde_json::Map::new();
    if let Some(quantity) = quantity(error) {
        let quantity = ErrorData::of(quantity);
        // A number without a unit is refused as before there were any.
        if quantity.fields.contains_key("unit") {
            code = format!("{code}/{}", quantity.code);
        }
        fields = quantity.fields;
    }
    fields.extend(named);
    ErrorData { code, fields }
}

/// Returns the error of the quantity for which a value is refused.
fn quantity(error: &Error) -> Option<&QuantityError> {
    let first = error.source()?;
    first.downcast_ref().or_else(|| first.source()?.downcast_ref())
}

/// Returns a mistake and its remedy in one line.
fn line(error: &Error) -> String {
    if error.kind() == ErrorKind::InvalidUtf8 {
        let wrong = talk::arguments().iter().find(|a| a.to_str().is_none()).cloned().unwrap_or_default();
        return format!("{}: the name is not UTF-8. Rename the file", wrong.display());
    }
    let (text, advice) = (error.to_string(), advice(error));
    // A similar name is no remedy if the new name is known.
    let is_renamed = advice.starts_with("; it is ");
    let lines: Vec<&str> = text
        .lines()
        .map(str::trim)
        .take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more information"))
        // No argument here takes a value that begins with a hyphen, so clap's tip for that does not work.
        .filter(|l| !l.is_empty() && !l.starts_with("tip: to pass '"))
        .filter(|l| !is_renamed || !l.starts_with("tip:"))
        .collect();
    let said = lines.join(" ").trim_start_matches("error: ").replace("tip: ", "; ").replace(" ; ", "; ");
    // The messages of the standard library about numbers contain no remedy.
    let said = ["invalid digit found in string", "cannot parse integer from empty string"]
        .iter()
        .fold(said, |said, what| said.replace(what, "expected a whole number, 0 or more"))
        .replace("number too large to fit in target type", "the number is too large")
        .replace("invalid float literal", "expected a number");
    format!("{said}{advice} (see --help)")
}

/// Returns a guess of the intended argument, such as a file whose name looks like options, or --out instead of
/// --output.
fn advice(error: &Error) -> String {
    let hyphened = |word: &&OsString| word.to_str().is_some_and(|w| w.starts_with('-')) && Path::new(word).exists();
    if let Some(file) = talk::arguments().iter().skip(1).find(hyphened) {
        return format!("; the file or folder of that name is given as ./{}", file.display());
    }
    let context = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.as_str(),
        _ => "",
    };
    if error.kind() == ErrorKind::InvalidSubcommand
        && let Some(now) = renamed::command(context(ContextKind::InvalidSubcommand))
    {
        return format!("; {now}");
    }
    if error.kind() == ErrorKind::UnknownArgument {
        let words: Vec<&str> = talk::arguments().iter().skip(1).filter_map(|word| word.to_str()).collect();
        let path = named(&Cli::command(), &words).map(|(path, _)| path).unwrap_or_default();
        let option = context(ContextKind::InvalidArg).trim_start_matches('-');
        if let Some(now) = renamed::option(&path, option.split('=').next().unwrap_or_default()) {
            return format!("; {now}");
        }
    }
    let is_output = context(ContextKind::InvalidArg).starts_with("--output");
    let is_file = [".zarr", ".npy", ".png", "/"].iter().any(|end| context(ContextKind::InvalidValue).ends_with(end));
    if is_output && is_file { "; the file to write is given by --out".into() } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::headings;

    fn joined(words: &str) -> String {
        let given = words.split(' ').map(OsString::from).collect();
        let words = arguments(given, &headings::command::<Cli>());
        words.iter().filter_map(|word| word.to_str()).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn negative_values_belong_to_the_option_before_them() {
        for (given, taken) in [
            ("eyebox render h.zarr --pupil -1,0,4,1.5 -o x.png", "eyebox render h.zarr --pupil=-1,0,4,1.5 -o x.png"),
            ("eyebox solve a.png --depth -.5D..3 --json", "eyebox solve a.png --depth=-.5D..3 --json"),
            ("eyebox -v solve a --psnr -5dB", "eyebox -v solve a --psnr=-5dB"),
            // The value of no option, the value of a switch, and the argument after an option without its value.
            ("eyebox solve a -1 --json -3 -o -2", "eyebox solve a -1 --json -3 -o -2"),
            ("eyebox render h --pupil -o x.png", "eyebox render h --pupil -o x.png"),
            ("eyebox render --pupil --json", "eyebox render --pupil --json"),
            ("eyebox solve -- --depth -3..3", "eyebox solve -- --depth -3..3"),
            ("eyebox solve a --joint-color -3", "eyebox solve a --joint-color -3"),
        ] {
            assert_eq!(joined(given), taken);
        }
    }

    #[test]
    fn a_following_option_is_not_a_value() {
        for words in ["render h.zarr --pupil -o x.png", "solve a --depth --json", "show a --focus --unsteered"] {
            let given = std::iter::once("eyebox").chain(words.split(' ')).map(OsString::from).collect();
            let command = headings::command::<Cli>();
            let error = command.clone().try_get_matches_from(arguments(given, &command)).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidValue, "{words}: {error}");
            assert!(error.to_string().contains("required"), "{error}");
        }
    }
}
