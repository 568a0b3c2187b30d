//! The `eyebox` command reads arguments, calls the library, and prints results.
//!
//! The commands are `demo`, `solve`, `refine`, `render`, `preview`, `show`, `encode`, `info`, `convert`, `eval`,
//! `display`, `tracker`, `device`, `bench`, `feed`, `completions` and `man`. Functions that another program may call
//! belong in the library.
//! An error is one line on standard error with exit code 2 (3 if a display was lost), and no partial file remains. Long
//! work stops cleanly on the first ctrl-C. The second ctrl-C ends it at once with exit code 130.
//!
//! It is a library because the program `eyebox` (`main.rs`) and the Python package both have it.

// Commands of other builds use the same modules.
#![cfg_attr(not(feature = "all-commands"), allow(dead_code, unused_imports))]

// Before all modules that print, because its macros replace the standard ones.
#[macro_use]
mod talk;

mod args;
mod bench;
mod commands;
mod common;
mod convert;
mod demo;
mod device;
mod display;
mod dry;
mod encode;
mod eval;
mod experiment;
mod failure;
mod feed;
mod generate;
mod groups;
mod headings;
mod info;
mod jod;
mod log;
mod model_terms;
mod phases;
mod plan;
mod preview;
mod progress;
mod quality;
mod refine;
mod renamed;
mod render;
mod request;
mod roofline;
mod short_help;
mod show;
mod signals;
mod solve;
mod subject;
mod table;
mod tracker;
#[cfg(test)]
mod units_tests;
mod usage;
mod values;

use clap::{ArgMatches, FromArgMatches};
use commands::{Cli, Command};
use failure::Failure;
use std::ffi::OsString;

/// Runs the command with its arguments, the first of which is the name of the program. Returns the exit code.
///
/// A process runs it once, because signals, log and threads are set up for the rest of the process.
pub fn main(arguments: Vec<OsString>) -> u8 {
    common::begin();
    talk::set_arguments(&arguments);
    let (given, command): (Vec<_>, _) = (arguments, headings::command::<Cli>());
    let command = if short_help::is_asked(&given) { short_help::command(command) } else { command };
    let arguments = usage::arguments(given, &command);
    let parsed = command.try_get_matches_from(arguments);
    parsed.iter().for_each(|matches| talk::set_command(&path(matches)));
    let cli = match parsed.and_then(|m| Cli::from_arg_matches(&m)) {
        Ok(cli) => cli,
        Err(error) => return usage::print(&error),
    };
    log::listen(cli.verbose);
    signals::outlive_limits();
    #[cfg(unix)]
    signals::end_without_drafts();
    eyebox::low_level::engine::prepare_threads();
    let done = match &cli.command {
        #[cfg(feature = "all-commands")]
        Command::Demo(args) => demo::run(args),
        Command::Solve(args) => solve::run(args),
        #[cfg(feature = "all-commands")]
        Command::Refine(args) => refine::run(args),
        #[cfg(feature = "all-commands")]
        Command::Render(args) => render::run(args),
        #[cfg(feature = "all-commands")]
        Command::Preview(args) => preview::run(args),
        Command::Show(args) => show::run(args),
        #[cfg(feature = "all-commands")]
        Command::Encode(args) => encode::run(args),
        #[cfg(feature = "all-commands")]
        Command::Info(args) => info::run(args),
        #[cfg(feature = "all-commands")]
        Command::Convert(args) => convert::run(args),
        #[cfg(feature = "all-commands")]
        Command::Eval(eval) => eval::run(eval),
        #[cfg(feature = "all-commands")]
        Command::Display(display) => display::run(display),
        #[cfg(feature = "all-commands")]
        Command::Tracker(tracker) => tracker::run(tracker),
        Command::Device(device) => device::run(device),
        #[cfg(feature = "all-commands")]
        Command::Bench(args) => bench::run(args),
        #[cfg(feature = "all-commands")]
        Command::Feed(args) => feed::run(args),
        #[cfg(feature = "all-commands")]
        Command::Completions(args) => generate::completions(args, headings::command::<Cli>()),
        #[cfg(feature = "all-commands")]
        Command::Man(args) => generate::man(args, headings::command::<Cli>()),
    };
    match done {
        Ok(()) if talk::finish() => 0,
        Ok(()) => 2,
        Err(failure) => failure::print(&failure),
    }
}

/// Returns the name of the command that was parsed, such as `eval score`.
fn path(matches: &ArgMatches) -> String {
    match matches.subcommand() {
        Some((name, below)) => format!("{name} {}", path(below)).trim_end().to_owned(),
        None => String::new(),
    }
}
