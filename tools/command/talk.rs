//! Prints all output, and continues the work if nobody reads it any more.
//!
//! If the reader of a pipe has gone or the terminal was closed, printing ends. The work is finished and written, and
//! the exit code has its result. The macros replace the standard ones, which panic if nobody reads.

use eyebox::low_level::error::ErrorData;
use serde_json::{Map, Value, json};
use std::ffi::OsString;
use std::fmt::Arguments;
use std::io::{self, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

macro_rules! println {
    () => { $crate::talk::print_line(format_args!("")) };
    ($($text:tt)*) => { $crate::talk::print_line(format_args!($($text)*)) };
}
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::talk::note(format_args!($($text)*)) };
}
macro_rules! eprint {
    ($($text:tt)*) => { $crate::talk::write_note(format_args!($($text)*)) };
}

/// The version of the keys of reports.
const SCHEMA_VERSION: u32 = 1;
/// The environment variable that requests errors as JSON.
const AS_JSON: &str = "EYEBOX_JSON_ERRORS";

/// True after standard output was closed.
static CLOSED: AtomicBool = AtomicBool::new(false);
/// True after output was lost.
static LOST: AtomicBool = AtomicBool::new(false);

/// Arguments of the command. In the Python package they differ from the arguments of the process.
static ARGUMENTS: OnceLock<Vec<OsString>> = OnceLock::new();

/// Sets the arguments of the command.
pub fn set_arguments(arguments: &[OsString]) {
    let _ = ARGUMENTS.set(arguments.to_vec());
}

/// Returns the arguments of the command as they were typed, with the name of the program first.
pub fn arguments() -> &'static [OsString] {
    ARGUMENTS.get().map_or(&[], Vec::as_slice)
}

/// Prints a line on standard output.
pub fn print_line(text: Arguments<'_>) {
    if CLOSED.load(Relaxed) {
        return;
    }
    let mut out = io::stdout().lock();
    if let Err(error) = out.write_fmt(format_args!("{text}\n")) {
        drop(out);
        close(&error);
    }
}

/// The command that runs, such as `eval-score`.
static COMMAND: OnceLock<String> = OnceLock::new();

/// Sets the name of the command that runs.
pub fn set_command(name: &str) {
    let _ = COMMAND.set(name.replace(' ', "-"));
}

/// Prints the report of a command as one JSON object. Its first key, `schema`, has the command and the version of its
/// keys. The version rises when a key is removed or changes its meaning. New keys do not change it.
pub fn print_report(report: Value) {
    let schema = format!("{}/{SCHEMA_VERSION}", COMMAND.get().map_or("eyebox", String::as_str));
    let mut all = Map::from_iter([("schema".to_owned(), Value::from(schema))]);
    match report {
        Value::Object(report) => all.extend(report),
        other => drop(all.insert("value".into(), other)),
    }
    print_line(format_args!("{}", Value::Object(all)));
}

/// Prints a line on standard error, and ignores an error of that.
pub fn note(text: Arguments<'_>) {
    write_note(format_args!("{text}\n"));
}

/// Prints a part of a line on standard error.
pub fn write_note(text: Arguments<'_>) {
    let _ = io::stderr().write_fmt(text);
}

/// Prints an error as one line on standard error. It is JSON with `--json` or if [`AS_JSON`] is 1.
pub fn print_error(message: &str, data: &ErrorData) {
    let asked =
        arguments().iter().any(|word| word == "--json") || std::env::var_os(AS_JSON).is_some_and(|set| set == "1");
    if asked {
        let error = json!({ "code": data.code, "message": message, "fields": data.fields });
        eprintln!("{}", json!({ "error": error }));
    } else {
        eprintln!("eyebox: {message}");
    }
}

/// Ends printing on standard output. A closed pipe is no error, because the user ended the reader. Any other error is a
/// loss of output and is printed.
fn close(error: &io::Error) {
    CLOSED.store(true, Relaxed);
    if !is_broken_pipe(error) {
        let fields = [("reason".to_owned(), error.to_string().into())].into_iter().collect();
        let message = format!("standard output: cannot be written, and the output is lost: {error}");
        lose(&message, &ErrorData { code: "output/standard".into(), fields });
    }
}

/// Prints an error about an output that is lost. The work continues, and the exit code reports the error.
pub fn lose(message: &str, error: &ErrorData) {
    LOST.store(true, Relaxed);
    print_error(message, error);
}

/// Returns whether the reader of a pipe, or the terminal, has gone.
pub fn is_broken_pipe(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::BrokenPipe || error.raw_os_error() == Some(5)
}

/// Writes the buffered output. Returns whether all output was printed.
pub fn finish() -> bool {
    if let (false, Err(error)) = (CLOSED.load(Relaxed), io::stdout().flush()) {
        close(&error);
    }
    !LOST.load(Relaxed)
}
