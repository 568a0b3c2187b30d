//! Mistakes on the command line: one line each, with a remedy that works.

use crate::renamed;
use crate::talk::print_error;
use clap::Error;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use eyebox::low_level::error::ErrorData;
use serde_json::Value;
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

/// Returns the arguments as clap takes them: `help --help` is `help help`, and `help solve --help` is `help solve`.
pub fn arguments(mut given: Vec<OsString>) -> Vec<OsString> {
    let count = given.len();
    if given.get(1).is_some_and(|a| a == "help") {
        given.retain(|a| a != "--help" && a != "-h");
        if given.len() < count && given.len() == 2 {
            given.push("help".into());
        }
    }
    given
}

/// Prints help and version as they are, and a mistake as one line.
pub fn print(error: &Error) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = error.print();
            if error.exit_code() == 0 { ExitCode::SUCCESS } else { ExitCode::from(2) }
        }
        _ => {
            print_error(&line(error), &data(error));
            ExitCode::from(2)
        }
    }
}

/// Returns a mistake as data, with its kind in clap's name, the argument and the value.
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
    let fields = named.into_iter().filter_map(|(name, kind)| Some((name.to_owned(), value(kind)?))).collect();
    ErrorData { code: format!("usage/{kind}"), fields }
}

/// What is wrong, and what would be right.
fn line(error: &Error) -> String {
    if error.kind() == ErrorKind::InvalidUtf8 {
        let wrong = std::env::args_os().find(|a| a.to_str().is_none()).unwrap_or_default();
        return format!("{}: the name is not UTF-8: rename the file", wrong.display());
    }
    let text = error.to_string();
    let lines: Vec<&str> = text
        .lines()
        .map(str::trim)
        .take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more information"))
        // What begins with a hyphen is a value of nothing here.
        .filter(|l| !l.is_empty() && !l.starts_with("tip: to pass '"))
        .collect();
    let said = lines.join(" ").trim_start_matches("error: ").replace("tip: ", "; ").replace(" ; ", "; ");
    // What the standard library says of a number is no remedy.
    let said = ["invalid digit found in string", "cannot parse integer from empty string"]
        .iter()
        .fold(said, |said, what| said.replace(what, "expected a whole number, 0 or more"))
        .replace("number too large to fit in target type", "the number is too large")
        .replace("invalid float literal", "expected a number");
    format!("{said}{} (see --help)", advice(error))
}

/// What may be meant: a file whose name looks like options, or --out where a name of a display is expected.
fn advice(error: &Error) -> String {
    let hyphened = |word: &OsString| word.to_str().is_some_and(|w| w.starts_with('-')) && Path::new(word).exists();
    if let Some(file) = std::env::args_os().skip(1).find(hyphened) {
        return format!("; the file or folder of that name is given as ./{}", file.display());
    }
    let context = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.as_str(),
        _ => "",
    };
    if error.kind() == ErrorKind::UnknownArgument
        && let Some(command) = std::env::args().nth(1)
        && let Some(now) = renamed::option(&command, context(ContextKind::InvalidArg).trim_start_matches('-'))
    {
        return format!("; {now}");
    }
    let is_output = context(ContextKind::InvalidArg).starts_with("--output");
    let is_file = [".zarr", ".npy", ".png", "/"].iter().any(|end| context(ContextKind::InvalidValue).ends_with(end));
    if is_output && is_file { "; the file to write is given by --out".into() } else { String::new() }
}
