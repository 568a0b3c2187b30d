//! Reads the keys of settings tables as options, with the same units, ranges and names.

use crate::Failure;
use clap::error::ErrorKind;
use clap::{ArgAction, ArgMatches, Args, Command};
use eyebox::low_level::error::Reason;
use eyebox::low_level::produce::GivenSettings;
use eyebox::low_level::reason;
use serde_json::{Map, Value};

/// The name of a table, and the options for its keys.
pub type TableOf = (&'static str, fn() -> Command);

/// A table of the settings.
pub trait Table: Args {
    /// Returns the options for the keys.
    fn table() -> Command {
        Self::augment_args(Command::new("settings").no_binary_name(true).disable_help_flag(true))
    }
}

impl<T: Args> Table for T {}

/// Reads a table of the settings.
///
/// # Errors
/// [`Failure::Setting`] with the key that is unknown or has no such value.
pub fn read<T: Args>(given: &GivenSettings, name: &'static str) -> Result<T, Failure> {
    let matches = parsed(given, (name, T::table))?;
    T::from_arg_matches(&matches).map_err(|error| wrong_value(name, error))
}

/// Returns the given and the default values of a table as a file has them.
pub fn effective(given: &GivenSettings, table: TableOf) -> Result<Map<String, Value>, Failure> {
    let matches = parsed(given, table)?;
    let mut all = Map::new();
    for option in (table.1)().get_arguments() {
        let id = option.get_id().as_str();
        let value = match option.get_action() {
            ArgAction::SetTrue => Value::Bool(matches.get_flag(id)),
            _ => match matches.get_raw(id) {
                Some(values) => {
                    let mut values: Vec<Value> = values.map(|value| of_text(&value.to_string_lossy())).collect();
                    if values.len() == 1 { values.remove(0) } else { Value::Array(values) }
                }
                None => continue,
            },
        };
        all.insert(id.to_owned(), value);
    }
    Ok(all)
}

/// Returns the value of an option as a number, a boolean or a text.
fn of_text(text: &str) -> Value {
    match serde_json::from_str(text) {
        Ok(value @ (Value::Bool(_) | Value::Number(_))) => value,
        _ => Value::String(text.to_owned()),
    }
}

/// Parses the keys of a table as options.
fn parsed(given: &GivenSettings, (name, table): TableOf) -> Result<ArgMatches, Failure> {
    let command = table();
    let keys = given.table(name).cloned().unwrap_or_default();
    let mut words = Vec::new();
    for (key, value) in &keys {
        let setting = format!("{name}.{key}");
        let Some(option) = command.get_arguments().find(|option| option.get_id().as_str() == key) else {
            let known: Vec<&str> = command.get_arguments().map(|option| option.get_id().as_str()).collect();
            let reason = reason!("no-such-setting", "no such setting: the table {name} has {}", known.join(", "));
            return Err(Failure::Setting { setting, reason });
        };
        let long = option.get_long().unwrap_or_default();
        let word = match (option.get_action(), value) {
            (ArgAction::SetTrue, Value::Bool(true)) => format!("--{long}"),
            (ArgAction::SetTrue, Value::Bool(false)) => continue,
            (ArgAction::SetTrue, _) => return Err(wrong_value(&setting, "expected true or false")),
            (_, value) => match text_of(value) {
                Some(text) => format!("--{long}={text}"),
                None => return Err(wrong_value(&setting, "expected a number or a text")),
            },
        };
        // Keys are parsed one after the other, so that an error names the right one.
        command.clone().try_get_matches_from([&word]).map_err(|error| wrong_value(&setting, why(&error)))?;
        words.push(word);
    }
    command.try_get_matches_from(words).map_err(|error| wrong_value(name, why(&error)))
}

fn wrong_value(setting: &str, why: impl ToString) -> Failure {
    Failure::Setting { setting: setting.to_owned(), reason: Reason::new("settings-value", why.to_string()) }
}

/// Returns the problem of a value without the name of an option.
fn why(error: &clap::Error) -> String {
    let text = error.to_string();
    let mut lines = text.lines().map(str::trim);
    let first = lines.next().unwrap_or_default().trim_start_matches("error: ");
    match error.kind() {
        ErrorKind::InvalidValue => {
            let value = first.split('\'').nth(1).unwrap_or_default();
            let possible = lines.find_map(|line| line.strip_prefix("[possible values: ")).unwrap_or_default();
            format!("'{value}' is not one of {}", possible.trim_end_matches(']'))
        }
        _ => match first.split_once("': ") {
            Some((_, why)) => why.to_owned(),
            None => first.to_owned(),
        },
    }
}

/// Returns a value of a file as the text of an option.
fn text_of(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(_) | Value::Bool(_) => Some(value.to_string()),
        Value::Array(all) => all.iter().map(text_of).collect::<Option<Vec<_>>>().map(|all| all.join(",")),
        _ => None,
    }
}
