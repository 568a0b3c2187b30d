//! Prints the events of the library on standard error, one line each.

use crate::failure::in_options;
use std::io::{self, Stderr, Write};
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

/// Starts to print events that concern the user, such as a file that was cut off or a lost device. `verbose` 1 adds how
/// things are done, and 2 adds everything. A valid `RUST_LOG` replaces this choice.
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
        // If standard error is closed, nobody could read an error about it.
        .log_internal_errors(false)
        .with_ansi(false)
        .with_level(verbose > 0)
        .with_target(verbose > 0)
        .without_time();
    // If the Python package has computed before in this process, its warnings stay warnings of Python.
    let _ = tracing_subscriber::registry().with(lines.with_filter(targets)).try_init();
    if let Some(wrong) = wrong {
        tracing::warn!("RUST_LOG: not understood ({wrong}). Give targets and levels, such as eyebox=debug");
    }
}

/// Standard error, with the fields of the library as options of the command. Each line is written in one piece.
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
