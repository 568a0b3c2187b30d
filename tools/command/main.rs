//! The `eyebox` command: `demo`, `solve`, `plan`, `inspect`, `view`, `photograph`, `refine`, `study`, `live`, `score`, `tradeoff`,
//! `evaluate`, `export`, `import`, `encode`, `play`, `show`, `feed`, `preview`, `monitors`, `bench`, `devices`, `displays`, `trackers`,
//! `completions`, `man`.
//!
//! This room reads arguments, calls the runtime, and shows what came of it. Anything that a program would want to call
//! belongs in the runtime. Errors are one line on standard error and exit code 2 (3 where a display was lost);
//! nothing half-written stays behind. What takes long ends well on ctrl-C, and at once, with 130, on a second one.

// Before all that print.
#[macro_use]
mod talk;

mod args;
mod bench;
mod calibrate;
mod commands;
mod common;
mod demo;
mod devices;
mod displays;
mod dry;
mod encode;
mod evaluate;
mod experiment;
mod export;
mod failure;
mod feed;
mod film;
mod following;
mod generate;
mod groups;
mod headings;
mod import;
mod inspect;
mod jod;
mod live;
mod log;
mod model_terms;
mod patterns;
mod phases;
mod photograph;
mod plan;
mod play;
mod preview;
mod progress;
mod quality;
mod renamed;
mod request;
mod score;
mod session;
mod short_help;
mod show;
mod signals;
mod solve;
mod tracker_calibration;
mod trackers;
mod tradeoff;
#[cfg(test)]
mod units_tests;
mod usage;
mod values;
mod view;

use clap::FromArgMatches;
use commands::{Cli, Command};
use failure::Failure;
use std::process::ExitCode;

fn main() -> ExitCode {
    let (given, command): (Vec<_>, _) = (std::env::args_os().collect(), headings::command::<Cli>());
    let command = if short_help::is_asked(&given) { short_help::command(command) } else { command };
    let arguments = usage::arguments(given, &command);
    let parsed = command.try_get_matches_from(arguments);
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
        Command::Demo(args) => demo::run(args),
        Command::Solve(args) => solve::run(args),
        Command::Plan(args) => plan::run(args),
        Command::View(args) => view::run(args),
        Command::Photograph(args) => photograph::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Refine(args) => live::refine(args),
        Command::Study(args) => live::study(args),
        Command::Live(args) => live::live(args),
        Command::Score(args) => score::run(args),
        Command::Tradeoff(args) => tradeoff::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Export(args) => export::run(args),
        Command::Import(args) => import::run(args),
        Command::Encode(args) => encode::run(args),
        Command::Play(args) => play::run(args),
        Command::Show(args) => show::run(args),
        Command::Feed(args) => feed::run(args),
        Command::Film(args) => film::run(args),
        Command::Preview(args) => preview::run(args),
        Command::Monitors(args) => play::monitors(args),
        Command::Bench(args) => bench::run(args),
        Command::Devices(args) => devices::run(args),
        Command::Displays(args) => displays::run(args),
        Command::Completions(args) => generate::completions(args, headings::command::<Cli>()),
        Command::Man(args) => generate::man(args, headings::command::<Cli>()),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Trackers(args) => match &args.calibrate {
            Some(file) if args.describe.is_none() => tracker_calibration::run(args, file),
            _ => trackers::run(args),
        },
    };
    match done {
        Ok(()) if talk::finish() => ExitCode::SUCCESS,
        Ok(()) => ExitCode::from(2),
        Err(failure) => failure::print(&failure),
    }
}
