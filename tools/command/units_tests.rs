//! Each option that has a unit takes it, and refuses units of other dimensions.

use crate::commands::Cli;
use crate::{headings, usage};
use clap::error::ErrorKind;
use clap::{Arg, Command, Error, value_parser};
use eyebox::low_level::error::ErrorData;
use eyebox::low_level::quantity::QuantityError;
use std::collections::BTreeSet;
use std::error::Error as _;

/// Names of values, a value with other units than the plain one, the same with plain numbers, and one of another dimension.
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

/// Returns the options of all commands, with the path of their command and the name of their value.
fn options(command: &Command) -> impl Iterator<Item = (String, &Arg, String)> {
    headings::leaves(command).into_iter().flat_map(|(path, sub)| {
        let options = sub.get_opts().filter(|option| option.get_long().is_some());
        options.map(move |option| {
            let name = option.get_value_names().and_then(|names| names.first()).map_or("", |name| name.as_str());
            (path.clone(), option, name.to_owned())
        })
    })
}

/// Returns whether an option counts or decides random numbers.
fn is_seed(option: &Arg) -> bool {
    option.get_long().is_some_and(|name| name.ends_with("seed"))
}

/// Parses a command line with this option alone, which may lack other arguments.
fn given(command: &Command, path: &str, option: &Arg, value: &str) -> Result<(), Error> {
    let long = option.get_long().expect("a long name");
    let option = if option.is_require_equals_set() { format!("--{long}={value}") } else { format!("--{long} {value}") };
    // A value may hold spaces.
    let words =
        ["eyebox"].into_iter().chain(path.split(' ')).chain(option.splitn(2, ' ')).map(std::ffi::OsString::from);
    match command.clone().try_get_matches_from(usage::arguments(words.collect(), command)) {
        Err(error) if error.kind() != ErrorKind::MissingRequiredArgument => Err(error),
        _ => Ok(()),
    }
}

#[test]
fn each_option_with_a_unit_takes_it_and_no_other_dimension() {
    let command = headings::command::<Cli>();
    let mut seen = BTreeSet::new();
    for (path, option, name) in options(&command) {
        let Some((_, with, plain, other)) = WITH_UNITS.iter().find(|(known, ..)| *known == name) else { continue };
        if is_seed(option) {
            continue;
        }
        seen.insert(name.clone());
        let place = format!("{path} --{} <{name}>", option.get_long().unwrap_or_default());
        for value in [with, plain] {
            given(&command, &path, option, value).unwrap_or_else(|error| panic!("{place} {value}: {error}"));
        }
        let error = given(&command, &path, option, other).expect_err(&place);
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
    let sizes = options(&command).filter(|(_, _, name)| name == "HxW");
    let count = sizes.map(|(path, option, _)| {
        for value in ["256", "1080x1920", "1080p", "4k"] {
            given(&command, &path, option, value).unwrap_or_else(|error| panic!("{path} {value}: {error}"));
        }
    });
    assert!(count.count() > 10);
}

#[test]
fn each_number_has_a_unit_or_is_known_to_have_none() {
    let command = headings::command::<Cli>();
    let real = clap::builder::ValueParser::from(value_parser!(f64)).type_id();
    for (path, option, name) in options(&command) {
        let is_known = WITHOUT.contains(&&name[..]) || WITH_UNITS.iter().any(|(known, ..)| *known == name);
        if option.get_value_parser().type_id() == real {
            assert!(is_known, "{path} --{} <{name}>", option.get_long().unwrap_or_default());
        }
    }
}
