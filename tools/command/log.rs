//! What the library says while it works, on standard error: a line each.

use crate::failure::in_options;
use std::io::{self, Stderr, Write};
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

/// Shows what a user wants to know (a file that was cut off, a device that was lost); with `verbose` of 1 how things are done
/// as well, of 2 all. `RUST_LOG`, where it is set and makes sense, decides alone.
pub fn listen(verbose: u8) {
    let level = match verbose {
        0 => LevelFilter::INFO,
        1 => LevelFilter::DEBUG,
        _ => LevelFilter::TRACE,
    };
    let stated = std::env::var("RUST_LOG").ok().filter(|text| !text.is_empty()).map(|text| text.parse::<Targets>());
    let wrong = stated.as_ref().and_then(|parsed| parsed.as_ref().err()).map(ToString::to_string);
    let targets = stated.and_then(Result::ok).unwrap_or_else(|| Targets::new().with_target("eyebox", level));
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| InOptions(std::io::stderr()))
        // Nobody is left to be told that nobody listens.
        .log_internal_errors(false)
        .with_ansi(false)
        .with_level(verbose > 0)
        .with_target(verbose > 0)
        .without_time();
    tracing_subscriber::registry().with(lines.with_filter(targets)).init();
    if let Some(wrong) = wrong {
        tracing::warn!("RUST_LOG is not understood ({wrong}): give targets and levels, such as eyebox=debug");
    }
}

/// Standard error, with the fields of the library as options of the command. Each line comes in one piece.
struct InOptions(Stderr);

impl Write for InOptions {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        self.0.write_all(in_options(&String::from_utf8_lossy(line)).as_bytes())?;
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}
