//! Helpers that run the command in tests.

#![allow(dead_code, reason = "each test file uses what it needs")]

#[cfg(target_os = "linux")]
pub mod desk;
pub mod made;
#[cfg(target_os = "linux")]
pub mod power;
mod printed;
#[cfg(target_os = "linux")]
pub mod screen;
#[cfg(target_os = "linux")]
pub mod xorg;
#[cfg(target_os = "linux")]
pub mod xvfb;

pub use printed::Printed;

use std::path::Path;
use std::process::{Command, Output};

/// Returns the command to test. `EYEBOX_BINARY=FILE` names the command of another build, or a script that runs it.
pub fn program() -> String {
    std::env::var("EYEBOX_BINARY").unwrap_or_else(|_| env!("CARGO_BIN_EXE_eyebox").into())
}

/// Returns the command with its arguments in `folder`, with a cache that only tests use.
pub fn command(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.args(args).current_dir(folder).env("XDG_CACHE_HOME", std::env::temp_dir().join("eyebox-tests"));
    command
}

/// Runs the command and returns its output.
pub fn eyebox(folder: &Path, args: &[&str]) -> Output {
    command(folder, args).output().expect("the command starts")
}

/// Converts printed bytes to text.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must succeed, and returns its standard output.
pub fn done(folder: &Path, args: &[&str]) -> String {
    let answer = eyebox(folder, args);
    assert!(answer.status.success(), "{args:?}: {}", text(&answer.stderr));
    text(&answer.stdout)
}

/// Runs a command that must succeed, and returns the JSON object on its standard output.
pub fn json(folder: &Path, args: &[&str]) -> serde_json::Value {
    let said = done(folder, args);
    serde_json::from_str(&said).unwrap_or_else(|_| panic!("{args:?}: no JSON object: {said}"))
}

/// Reads a JSON document from a file.
pub fn document(file: &Path) -> serde_json::Value {
    let text = std::fs::read(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    serde_json::from_slice(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
}

/// Reads eyebox's attributes from the file of a hologram.
pub fn attributes(hologram: &Path) -> serde_json::Value {
    document(&hologram.join("zarr.json"))["attributes"]["eyebox"].take()
}

/// Returns the modification time of a file.
pub fn written(file: &Path) -> std::time::SystemTime {
    std::fs::metadata(file).and_then(|m| m.modified()).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
}

/// Returns whether a warning of a report has these words.
pub fn notes(of: &serde_json::Value, words: &str) -> bool {
    let notes = of.as_array().into_iter().flatten().filter_map(serde_json::Value::as_str);
    notes.into_iter().any(|note| note.has(words))
}

/// Error that a failed command prints as JSON.
#[derive(Debug, serde::Deserialize)]
pub struct Refusal {
    pub code: String,
    pub message: String,
    pub fields: serde_json::Value,
}

impl Refusal {
    /// Reads the last line of standard error as JSON.
    pub fn of(answer: &Output) -> Self {
        let said = text(&answer.stderr);
        let line = said.trim().lines().last().unwrap_or_default();
        let read: Result<serde_json::Value, _> = serde_json::from_str(line);
        let read = read.ok().and_then(|mut read| serde_json::from_value(read["error"].take()).ok());
        let read: Self = read.unwrap_or_else(|| panic!("no error as JSON: {said}"));
        assert!(!read.message.contains('\n') && !said.contains("panicked"), "{said}");
        read
    }

    /// Asserts the code, which is the first word of `what`. The message must hold the other words, such as options and
    /// numbers.
    #[track_caller]
    pub fn is(&self, what: &str) {
        let mut words = what.split(' ');
        assert_eq!(words.next(), Some(&self.code[..]), "{self:?}");
        assert!(words.all(|word| self.message.contains(word)), "{what}: {self:?}");
    }
}

/// Runs a command that must fail with exit code 2 and returns its error.
#[track_caller]
pub fn refusal(folder: &Path, args: &[&str]) -> Refusal {
    refusal_of(&mut command(folder, args))
}

/// Runs a command that must fail with exit code 2 and returns its error.
#[track_caller]
pub fn refusal_of(command: &mut Command) -> Refusal {
    Refusal::of(&failed(command))
}

/// Lets a command print its error as JSON.
pub fn with_json_errors(command: &mut Command) -> &mut Command {
    command.env("EYEBOX_JSON_ERRORS", "1")
}

/// Runs a command that must fail with exit code 2 and prints its error as JSON.
#[track_caller]
pub fn failed(command: &mut Command) -> Output {
    let answer = with_json_errors(command).output().expect("the command starts");
    assert_eq!(answer.status.code(), Some(2), "{command:?}: {}", text(&answer.stderr));
    answer
}

/// Runs a command that must fail with exit code 2 and [this error](Refusal::is), and must leave no file.
#[track_caller]
pub fn refused(folder: &Path, args: &[&str], out: &str, what: &str) {
    let answer = failed(&mut command(folder, args));
    let said = text(&answer.stderr);
    assert_eq!(said.trim().lines().count(), 1, "{args:?}: {said}");
    Refusal::of(&answer).is(what);
    assert!(!folder.join(out).exists(), "{args:?} left {out}");
    let part = |e: std::io::Result<std::fs::DirEntry>| e.unwrap().file_name().to_string_lossy().ends_with(".part");
    assert!(!std::fs::read_dir(folder).unwrap().any(part), "{args:?} left something half-written");
}

/// Asserts that `figures/` has each plot of a report's page as a complete SVG without a style sheet and as a PDF.
pub fn figures_of(report: &Path, page: &str) {
    let page = std::fs::read_to_string(report.join(page)).expect("a page");
    let files = std::fs::read_dir(report.join("figures")).expect("figures").map(|e| e.expect("an entry").path());
    let (svg, pdf): (Vec<_>, Vec<_>) = files.partition(|f| f.extension().is_some_and(|e| e == "svg"));
    assert_eq!([svg.len(), pdf.len()], [page.matches("<svg").count(); 2], "{svg:?}");
    for file in svg {
        let text = std::fs::read_to_string(&file).expect("text");
        let complete = text.starts_with("<svg") && text.contains("fill=\"#ffffff\"") && text.ends_with("</svg>");
        assert!(complete && !text.contains("class=") && !text.contains("var("), "{file:?}: {text}");
    }
    for file in pdf {
        let bytes = std::fs::read(&file).expect("bytes");
        assert!(bytes.starts_with(b"%PDF-1.") && bytes.trim_ascii_end().ends_with(b"%%EOF"), "{file:?}");
    }
}

/// Creates a temporary folder for one test.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Requests the end of a process twice, as two ctrl-C do. The two signals differ, because two of one kind that arrive
/// together count as one.
#[cfg(unix)]
pub fn interrupt_twice(id: u32) {
    let both = format!("kill -INT {id}; kill -TERM {id}");
    assert!(Command::new("sh").args(["-c", &both]).status().expect("sh").success(), "{id} has ended");
}
