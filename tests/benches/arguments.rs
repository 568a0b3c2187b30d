//! Reads the arguments of a benchmark, runs it, and reports its error.

use clap::{Args, Parser};
use std::error::Error;
use std::process::ExitCode;

/// The argument that cargo adds to the arguments of a benchmark.
#[derive(Args)]
pub struct OfCargo {
    #[arg(long, hide = true)]
    bench: bool,
}

/// Runs a benchmark with its arguments.
pub fn start<A: Parser>(run: impl FnOnce(&A) -> Result<(), Box<dyn Error>>) -> ExitCode {
    match run(&A::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(2)
        }
    }
}
