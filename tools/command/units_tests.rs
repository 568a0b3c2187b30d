//! Each option that has a unit takes it, and refuses units of other dimensions.

use crate::commands::Cli;
use crate::renamed::tables;
use crate::{headings, usage};
use clap::error::ErrorKind;
use clap::{Arg, Command, Error, value_parser};
use eyebox::low_level::error::ErrorData;
use eyebox::low_level::quantity::QuantityError;
use std::collections::{BTreeMap, BTreeSet};
use std::error::Error as _;
use std::fmt;

/// Names of values, a value with other units than the plain one, the same with plain numbers, and one of another
/// dimension.
const WITH_UNITS: [(&str, &str, &str, &str); 21] = [
    ("UM", "0.008mm", "8", "8D"),
    ("NM", "0.52um", "520", "520s"),
    ("MM", "1.5cm", "15", "2D"),
    ("MM|D", "1500um", "1.5", "2s"),
    ("MIN..MAX", "2mm..0.6cm", "2..6", "2..6Hz"),
    ("X,Y,D,Z", "-1mm,0.1cm,4mm,2m", "-1,1,4,0.5D", "0,0,4D,0"),
    ("X,Y,DIAMETER", "-1mm,0.1cm,4mm", "-1,1,4", "0,0,4D"),
    ("S", "0.5min", "30", "30mm"),
    ("SECONDS", "500ms", "0.5", "2Hz"),
    ("UNIX", "4e9s", "4e9", "4e9Hz"),
    ("MINUTES", "1h", "60", "60mm"),
    ("MS", "0.02s", "20", "20mm"),
    ("HZ", "0.03kHz", "30", "30ms"),
    ("DB", "30dB", "30", "30mm"),
    ("CD/M2", "200cd/m2", "200", "200mm"),
    ("CELSIUS", "-5C", "-5", "5D"),
    ("PX", "64px", "64", "64mm"),
    ("AMOUNT", "4GiB", "4294967296", "4mm"),
    ("S C AXIS|none", "-2D -0.5D 30deg", "-2 -0.5 30", "-2mm"),
    ("X,Y", "3deg,-30arcmin", "3,-0.5", "3mm,0"),
    ("X,Y;X,Y;...", "0deg,0;60arcmin,0;0,1;0,2", "0,0;1,0;0,1;0,2", "0mm,0;1,0;0,1;0,2"),
];

/// Names of values that are numbers without a unit.
const WITHOUT: [&str; 8] = ["TIMES", "SHARE", "FACTOR", "N", "EXPOSURE", "UNIT", "SHARE|cold", "KEY=A..B"];

/// A command by its path, or a table of the settings.
#[derive(Clone)]
enum Place {
    Command(String),
    Table(&'static str, Box<Command>),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command(path) => f.write_str(path),
            Self::Table(name, _) => write!(f, "the table {name}"),
        }
    }
}

/// Returns the options of all commands and the keys of all tables, with the name of their value.
fn options(command: &Command) -> Vec<(Place, Arg, String)> {
    let commands = headings::leaves(command).into_iter().map(|(path, sub)| (Place::Command(path), sub.clone()));
    let tables = tables().into_iter().map(|(name, table)| (Place::Table(name, Box::new(table())), table()));
    let mut all = Vec::new();
    for (place, sub) in commands.chain(tables) {
        for option in sub.get_opts().filter(|option| option.get_long().is_some()) {
            let name = option.get_value_names().and_then(|names| names.first()).map_or("", |name| name.as_str());
            all.push((place.clone(), option.clone(), name.to_owned()));
        }
    }
    all
}

/// Returns whether an option counts or decides random numbers.
fn is_seed(option: &Arg) -> bool {
    option.get_long().is_some_and(|name| name.ends_with("seed"))
}

/// Parses a command line with this option alone, which may lack other arguments, or this key of a table.
fn given(command: &Command, place: &Place, option: &Arg, value: &str) -> Result<(), Error> {
    let long = option.get_long().expect("a long name");
    let parsed = match place {
        Place::Table(_, table) => Command::clone(table).try_get_matches_from([format!("--{long}={value}")]),
        Place::Command(path) => {
            let is_joined = option.is_require_equals_set();
            let option = if is_joined { format!("--{long}={value}") } else { format!("--{long} {value}") };
            // A value may hold spaces.
            let words = ["eyebox"].into_iter().chain(path.split(' ')).chain(option.splitn(2, ' '));
            let words = words.map(std::ffi::OsString::from).collect();
            command.clone().try_get_matches_from(usage::arguments(words, command))
        }
    };
    match parsed {
        Err(error) if error.kind() != ErrorKind::MissingRequiredArgument => Err(error),
        _ => Ok(()),
    }
}

#[test]
fn each_option_with_a_unit_takes_it_and_no_other_dimension() {
    let command = headings::command::<Cli>();
    let mut seen = BTreeSet::new();
    for (path, option, name) in &options(&command) {
        let Some((_, with, plain, other)) = WITH_UNITS.iter().find(|(known, ..)| *known == *name) else { continue };
        if is_seed(option) {
            continue;
        }
        seen.insert(name.clone());
        let place = format!("{path} --{} <{name}>", option.get_long().unwrap_or_default());
        for value in [with, plain] {
            given(&command, path, option, value).unwrap_or_else(|error| panic!("{place} {value}: {error}"));
        }
        let error = given(&command, path, option, other).expect_err(&place);
        let wrong: Option<&QuantityError> = error
            .source()
            .and_then(|first| first.downcast_ref().or_else(|| first.source().and_then(|second| second.downcast_ref())));
        let data = ErrorData::of(wrong.unwrap_or_else(|| panic!("{place} {other}: {error}")));
        assert_eq!(data.code, "other-dimension", "{place}");
        assert!(data.fields["fits"].as_array().is_some_and(|fits| !fits.is_empty()), "{place}: {data:?}");
    }
    assert_eq!(seen.len(), WITH_UNITS.len(), "{seen:?}");
}

#[test]
fn each_option_with_a_size_takes_its_names() {
    let command = headings::command::<Cli>();
    let options = options(&command);
    let sizes = options.iter().filter(|(_, _, name)| name == "HxW");
    let count = sizes.map(|(path, option, _)| {
        for value in ["256", "1080x1920", "1080p", "4k"] {
            given(&command, path, option, value).unwrap_or_else(|error| panic!("{path} {value}: {error}"));
        }
    });
    assert!(count.count() > 10);
}

#[test]
fn each_number_has_a_unit_or_is_known_to_have_none() {
    let command = headings::command::<Cli>();
    let real = clap::builder::ValueParser::from(value_parser!(f64)).type_id();
    for (path, option, name) in &options(&command) {
        let is_known = WITHOUT.contains(&&name[..]) || WITH_UNITS.iter().any(|(known, ..)| *known == *name);
        if option.get_value_parser().type_id() == real {
            assert!(is_known, "{path} --{} <{name}>", option.get_long().unwrap_or_default());
        }
    }
}

/// A name has one meaning in all commands, with the same type and a help text that begins in the same way.
#[test]
fn each_name_has_one_meaning_and_there_are_few() {
    let command = headings::command::<Cli>();
    let mut names: BTreeMap<String, Vec<(String, Arg)>> = BTreeMap::new();
    for (path, sub) in headings::leaves(&command) {
        for option in sub.get_opts() {
            let name = option.get_long().unwrap_or_default().to_owned();
            names.entry(name).or_default().push((path.clone(), option.clone()));
        }
    }
    assert!(names.len() <= 110, "{} names of options", names.len());
    let stem = |option: &Arg| {
        let help = option.get_help().map(ToString::to_string).unwrap_or_default();
        help.split_whitespace().next().unwrap_or_default().trim_end_matches([':', ',', ';']).to_lowercase()
    };
    let mut wrong = Vec::new();
    for (name, uses) in &names {
        let (first_path, first) = &uses[0];
        for (path, option) in &uses[1..] {
            let is_same_type = option.get_value_parser().type_id() == first.get_value_parser().type_id();
            if !is_same_type || stem(option) != stem(first) {
                let [a, b] = [first, option].map(|o| o.get_help().map(ToString::to_string).unwrap_or_default());
                wrong.push(format!("--{name}: {first_path} '{a}', {path} '{b}', same type {is_same_type}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
